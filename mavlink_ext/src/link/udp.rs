//! UDP: one socket, one reader thread, and a table of the peers heard.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Instant;

use super::counters::Counters;
use super::peers::Peers;
use super::{Inlet, LinkError, LinkStats, POLL, Stop, lock, monotonic_now};
use crate::wire::{Parser, RawFrame};

/// No UDP datagram is longer.
const MAX_DATAGRAM: usize = 65_536;

/// What the reader thread and the senders share. The table is locked for a few microseconds at a time.
struct Shared {
    socket: UdpSocket,
    peers: Mutex<Peers>,
    counters: Counters,
    stop: Stop,
    opened: Instant,
}

/// An open socket. Dropping it closes the socket and waits for its thread.
pub(super) struct Udp {
    shared: Arc<Shared>,
    reader: Option<JoinHandle<()>>,
    local: SocketAddr,
}

impl Udp {
    /// Listens there, and answers whom it hears.
    pub(super) fn listen(at: SocketAddr, name: String, inlet: Inlet) -> io::Result<Self> {
        Self::start(UdpSocket::bind(at)?, Peers::learned(), name, inlet)
    }

    /// Sends there.
    pub(super) fn connect(to: SocketAddr, name: String, inlet: Inlet) -> io::Result<Self> {
        let any = if to.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
        Self::start(UdpSocket::bind(any)?, Peers::fixed(to), name, inlet)
    }

    /// Sends to all that listen at this port of a network, until one of them answers: then to those that do.
    pub(super) fn broadcast(to: SocketAddr, name: String, inlet: Inlet) -> io::Result<Self> {
        let socket = UdpSocket::bind("0.0.0.0:0")?;
        socket.set_broadcast(true)?;
        Self::start(socket, Peers::called(to), name, inlet)
    }

    fn start(socket: UdpSocket, peers: Peers, name: String, inlet: Inlet) -> io::Result<Self> {
        socket.set_read_timeout(Some(POLL))?;
        let local = socket.local_addr()?;
        let shared = Arc::new(Shared {
            socket,
            peers: Mutex::new(peers),
            counters: Counters::default(),
            stop: Stop::default(),
            opened: monotonic_now(),
        });
        let for_reader = Arc::clone(&shared);
        let reader = thread::Builder::new()
            .name(name)
            .spawn(move || read(&for_reader, inlet))?;
        Ok(Self {
            shared,
            reader: Some(reader),
            local,
        })
    }

    pub(super) fn local_address(&self) -> SocketAddr {
        self.local
    }

    /// Sends to the peers where the frame's target was heard, or to all; returns to how many.
    pub(super) fn send(&self, frame: &RawFrame) -> Result<usize, LinkError> {
        let age = self.shared.opened.elapsed();
        let targets = lock(&self.shared.peers).targets(frame.target(), age);
        let mut reached = 0;
        for peer in targets {
            match self.shared.socket.send_to(frame.bytes(), peer) {
                Ok(sent) => {
                    reached += 1;
                    self.shared.counters.sent(sent);
                }
                Err(error) if is_loss(&error) => {}
                Err(source) => return Err(LinkError::Send { peer, source }),
            }
        }
        Ok(reached)
    }

    pub(super) fn stats(&self) -> LinkStats {
        let age = self.shared.opened.elapsed();
        let peers = lock(&self.shared.peers).targets(None, age).len();
        self.shared.counters.stats(peers)
    }
}

impl Drop for Udp {
    fn drop(&mut self) {
        self.shared.stop.now();
        if let Some(reader) = self.reader.take()
            && reader.thread().id() != thread::current().id()
        {
            // A panic of the callback was reported when it happened; there is nothing left to do about it.
            drop(reader.join());
        }
    }
}

fn read(shared: &Shared, mut inlet: Inlet) {
    let mut datagram = vec![0; MAX_DATAGRAM];
    while !shared.stop.is_due() {
        inlet.guard.keep();
        let Ok((length, sender)) = shared.socket.recv_from(&mut datagram) else {
            continue; // Nothing for a while, or an earlier datagram was refused by its receiver.
        };
        if !lock(&shared.peers).hears(sender) {
            continue;
        }
        shared.counters.received(length);
        let mut parser = Parser::new();
        parser.push(&datagram[..length]);
        for frame in parser.by_ref().flatten() {
            if !inlet.guard.takes(&frame) {
                continue;
            }
            shared.counters.heard();
            lock(&shared.peers).learn(sender, frame.from(), shared.opened.elapsed());
            (inlet.deliver)(frame);
        }
        parser.finish();
        shared.counters.bad(parser.bad_frames());
    }
}

/// Whether the error only means that this datagram is lost.
fn is_loss(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock
            | ErrorKind::ConnectionRefused
            | ErrorKind::ConnectionReset
            | ErrorKind::Interrupted
            | ErrorKind::NetworkUnreachable
            | ErrorKind::HostUnreachable
            | ErrorKind::NetworkDown
    )
}
