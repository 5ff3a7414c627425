//! UDP links: one socket, one reader thread, and a table of the peers heard.
//!
//! `udpin:HOST:PORT` listens and answers every peer it hears; `udpout:HOST:PORT` sends to one. A frame for an address
//! that was heard goes only to the peers where it was heard; everything else goes to all of them.

mod peers;

use std::io::ErrorKind;
use std::net::{SocketAddr, ToSocketAddrs as _, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use std::{fmt, io};

use crate::wire::{Parser, RawFrame};
use peers::Peers;

/// How long the reader waits for a datagram before it looks whether the link was dropped.
const POLL: Duration = Duration::from_millis(50);
/// No UDP datagram is longer.
const MAX_DATAGRAM: usize = 65_536;

/// Why a link could not be opened or used.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The text is no link.
    #[error(
        "{uri:?} is no link, expected udpin:HOST:PORT or udpout:HOST:PORT; a serial port needs a bridge to UDP such as mavlink-router"
    )]
    Uri {
        /// What was given.
        uri: String,
    },
    /// The host has no address.
    #[error("cannot resolve {host:?}")]
    Resolve {
        /// Host and port.
        host: String,
        /// What the system says.
        source: io::Error,
    },
    /// The socket could not be opened.
    #[error("cannot open {uri:?}")]
    Open {
        /// The link.
        uri: String,
        /// What the system says.
        source: io::Error,
    },
    /// A frame could not be sent.
    #[error("cannot send to {peer}")]
    Send {
        /// Where to.
        peer: SocketAddr,
        /// What the system says.
        source: io::Error,
    },
}

/// Where a link leads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkUri {
    /// `udpin:HOST:PORT`: listens there.
    UdpIn(String),
    /// `udpout:HOST:PORT`: sends there.
    UdpOut(String),
}

impl LinkUri {
    /// `HOST:PORT`, as written.
    pub fn host_and_port(&self) -> &str {
        match self {
            Self::UdpIn(place) | Self::UdpOut(place) => place,
        }
    }
}

impl std::str::FromStr for LinkUri {
    type Err = LinkError;

    fn from_str(uri: &str) -> Result<Self, LinkError> {
        let wrong = || LinkError::Uri {
            uri: uri.to_owned(),
        };
        let (scheme, host_and_port) = uri.split_once(':').ok_or_else(wrong)?;
        let (host, port) = host_and_port.rsplit_once(':').ok_or_else(wrong)?;
        if host.is_empty() || port.parse::<u16>().is_err() {
            return Err(wrong());
        }
        match scheme {
            "udpin" => Ok(Self::UdpIn(host_and_port.to_owned())),
            "udpout" => Ok(Self::UdpOut(host_and_port.to_owned())),
            _ => Err(wrong()),
        }
    }
}

impl fmt::Display for LinkUri {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UdpIn(host) => write!(f, "udpin:{host}"),
            Self::UdpOut(host) => write!(f, "udpout:{host}"),
        }
    }
}

/// What has gone through a link since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkStats {
    /// Bytes of frames sent, to all peers together, without UDP and IP headers.
    pub bytes_sent: u64,
    /// Bytes of datagrams received.
    pub bytes_received: u64,
    /// Frames sent, to all peers together.
    pub frames_sent: u64,
    /// Good frames received.
    pub frames_received: u64,
    /// Damaged, cut off or unsupported frames received.
    pub bad_frames: u64,
    /// Peers that frames for all are sent to.
    pub peers: usize,
}

#[derive(Default)]
struct Counters {
    bytes_sent: AtomicU64,
    bytes_received: AtomicU64,
    frames_sent: AtomicU64,
    frames_received: AtomicU64,
    bad_frames: AtomicU64,
}

/// What the reader thread and the senders share. The table is locked for a few microseconds at a time.
struct Shared {
    socket: UdpSocket,
    peers: Mutex<Peers>,
    counters: Counters,
    stop: AtomicBool,
    opened: Instant,
}

/// An open link. Dropping it closes the socket and waits for its thread.
pub struct Link {
    shared: Arc<Shared>,
    reader: Option<JoinHandle<()>>,
    local: SocketAddr,
}

impl Link {
    /// Opens `udpin:HOST:PORT` or `udpout:HOST:PORT`. `deliver` is called on the link's thread with every good frame.
    pub fn open(
        uri: &str,
        deliver: impl FnMut(RawFrame) + Send + 'static,
    ) -> Result<Self, LinkError> {
        let parsed: LinkUri = uri.parse()?;
        let open = |source| LinkError::Open {
            uri: uri.to_owned(),
            source,
        };
        let (socket, peers) = match &parsed {
            LinkUri::UdpIn(host) => (
                UdpSocket::bind(resolve(host)?).map_err(open)?,
                Peers::learned(),
            ),
            LinkUri::UdpOut(host) => {
                let remote = resolve(host)?;
                let any = if remote.is_ipv4() {
                    "0.0.0.0:0"
                } else {
                    "[::]:0"
                };
                (UdpSocket::bind(any).map_err(open)?, Peers::fixed(remote))
            }
        };
        socket.set_read_timeout(Some(POLL)).map_err(open)?;
        let local = socket.local_addr().map_err(open)?;
        let shared = Arc::new(Shared {
            socket,
            peers: Mutex::new(peers),
            counters: Counters::default(),
            stop: AtomicBool::new(false),
            opened: monotonic_now(),
        });
        let for_reader = Arc::clone(&shared);
        let reader = thread::Builder::new()
            .name(format!("mavlink {parsed}"))
            .spawn(move || read(&for_reader, deliver))
            .map_err(open)?;
        Ok(Self {
            shared,
            reader: Some(reader),
            local,
        })
    }

    /// The address of the socket; its port is the one chosen by the system where 0 was asked for.
    pub fn local_address(&self) -> SocketAddr {
        self.local
    }

    /// Sends a frame: to the peers where its target was heard, or to all. Returns to how many; 0 before any was heard.
    ///
    /// A full send buffer or an unreachable peer loses the frame, as the air would; other failures are errors.
    pub fn send(&self, frame: &RawFrame) -> Result<usize, LinkError> {
        let targets = lock(&self.shared.peers).targets(frame.target(), self.shared.age());
        let counters = &self.shared.counters;
        let mut reached = 0;
        for peer in targets {
            match self.shared.socket.send_to(frame.bytes(), peer) {
                Ok(sent) => {
                    reached += 1;
                    counters.frames_sent.fetch_add(1, Ordering::Relaxed);
                    counters
                        .bytes_sent
                        .fetch_add(sent as u64, Ordering::Relaxed);
                }
                Err(error) if is_loss(&error) => {}
                Err(source) => return Err(LinkError::Send { peer, source }),
            }
        }
        Ok(reached)
    }

    /// What has gone through so far.
    pub fn stats(&self) -> LinkStats {
        let counters = &self.shared.counters;
        let get = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        LinkStats {
            bytes_sent: get(&counters.bytes_sent),
            bytes_received: get(&counters.bytes_received),
            frames_sent: get(&counters.frames_sent),
            frames_received: get(&counters.frames_received),
            bad_frames: get(&counters.bad_frames),
            peers: lock(&self.shared.peers)
                .targets(None, self.shared.age())
                .len(),
        }
    }
}

impl fmt::Debug for Link {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Link")
            .field("local", &self.local)
            .field("stats", &self.stats())
            .finish_non_exhaustive()
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(reader) = self.reader.take()
            && reader.thread().id() != thread::current().id()
        {
            // A panic of the callback was reported when it happened; there is nothing left to do about it.
            drop(reader.join());
        }
    }
}

impl Shared {
    fn age(&self) -> Duration {
        self.opened.elapsed()
    }
}

fn read(shared: &Shared, mut deliver: impl FnMut(RawFrame)) {
    let mut datagram = vec![0; MAX_DATAGRAM];
    let counters = &shared.counters;
    while !shared.stop.load(Ordering::Relaxed) {
        let Ok((length, sender)) = shared.socket.recv_from(&mut datagram) else {
            continue; // Nothing for a while, or an earlier datagram was refused by its receiver.
        };
        if !lock(&shared.peers).hears(sender) {
            continue;
        }
        counters
            .bytes_received
            .fetch_add(length as u64, Ordering::Relaxed);
        let mut parser = Parser::new();
        parser.push(&datagram[..length]);
        for frame in parser.by_ref().flatten() {
            counters.frames_received.fetch_add(1, Ordering::Relaxed);
            lock(&shared.peers).learn(sender, frame.from(), shared.age());
            deliver(frame);
        }
        parser.finish();
        counters
            .bad_frames
            .fetch_add(parser.bad_frames(), Ordering::Relaxed);
    }
}

/// The table survives a callback that panicked: it is changed only between callbacks.
fn lock(peers: &Mutex<Peers>) -> std::sync::MutexGuard<'_, Peers> {
    peers.lock().unwrap_or_else(PoisonError::into_inner)
}

fn resolve(host: &str) -> Result<SocketAddr, LinkError> {
    let failed = |source| LinkError::Resolve {
        host: host.to_owned(),
        source,
    };
    host.to_socket_addrs()
        .map_err(failed)?
        .next()
        .ok_or_else(|| failed(ErrorKind::NotFound.into()))
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

#[expect(
    clippy::disallowed_methods,
    reason = "the shell around a socket: peers that fell silent are forgotten by real time"
)]
fn monotonic_now() -> Instant {
    Instant::now()
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, sync_channel};

    use super::*;
    use crate::dialect::Message;
    use crate::dialect::tandem::{COMMAND_LONG_DATA, HEARTBEAT_DATA};
    use crate::wire::{Address, Encoder};

    const PATIENCE: Duration = Duration::from_secs(10);

    fn open(uri: &str) -> (Link, Receiver<RawFrame>) {
        let (sender, receiver) = sync_channel(100);
        let link = Link::open(uri, move |frame| {
            sender.send(frame).expect("the test reads what comes");
        })
        .expect("loopback has free ports");
        (link, receiver)
    }

    fn heartbeat(from: Address) -> RawFrame {
        Encoder::new(from).encode(&Message::HEARTBEAT(HEARTBEAT_DATA::default()))
    }

    fn command_for(target: Address) -> RawFrame {
        let command = COMMAND_LONG_DATA {
            target_system: target.system.0,
            target_component: target.component.0,
            ..COMMAND_LONG_DATA::default()
        };
        Encoder::new(Address::new(255, 190)).encode(&Message::COMMAND_LONG(command))
    }

    #[test]
    fn a_listener_answers_every_peer_and_addresses_the_one_that_was_heard() {
        let (listener, heard) = open("udpin:127.0.0.1:0");
        assert_eq!(
            listener.send(&heartbeat(Address::new(255, 190))).ok(),
            Some(0)
        );
        let uri = format!("udpout:{}", listener.local_address());
        let (copter, copter_hears) = open(&uri);
        let (rover, rover_hears) = open(&uri);
        for (link, address) in [(&copter, Address::new(1, 1)), (&rover, Address::new(2, 1))] {
            assert_eq!(link.send(&heartbeat(address)).ok(), Some(1));
            assert_eq!(heard.recv_timeout(PATIENCE), Ok(heartbeat(address)));
        }

        let for_rover = command_for(Address::new(2, 1));
        assert_eq!(listener.send(&for_rover).ok(), Some(1));
        let for_all = heartbeat(Address::new(255, 190));
        assert_eq!(listener.send(&for_all).ok(), Some(2));
        assert_eq!(rover_hears.recv_timeout(PATIENCE), Ok(for_rover));
        assert_eq!(rover_hears.recv_timeout(PATIENCE), Ok(for_all.clone()));
        assert_eq!(copter_hears.recv_timeout(PATIENCE), Ok(for_all));

        let stats = listener.stats();
        assert_eq!(
            (stats.frames_sent, stats.frames_received, stats.peers),
            (3, 2, 2)
        );
        assert_eq!(stats.bad_frames, 0);
    }

    #[test]
    fn garbage_is_counted_and_the_frame_after_it_delivered() {
        let (listener, heard) = open("udpin:127.0.0.1:0");
        let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback has free ports");
        let frame = heartbeat(Address::new(1, 1));
        let mut damaged = frame.bytes().to_vec();
        damaged[12] ^= 0x40;
        for datagram in [
            &damaged,
            &frame.bytes()[..15].to_vec(),
            &frame.bytes().to_vec(),
        ] {
            socket
                .send_to(datagram, listener.local_address())
                .expect("loopback takes it");
        }
        assert_eq!(heard.recv_timeout(PATIENCE), Ok(frame));
        assert_eq!(listener.stats().bad_frames, 2);
    }

    #[test]
    fn what_is_no_link_is_refused_with_what_was_expected() {
        for uri in [
            "",
            "udpin",
            "udpin:host",
            "tcp:host:1",
            "udpin::1",
            "udpout:h:70000",
        ] {
            let error = Link::open(uri, |_| {}).expect_err(uri);
            assert!(matches!(error, LinkError::Uri { .. }), "{error}");
        }
    }
}
