//! Streams of bytes: TCP, both ends, and serial ports. They come and go; the link stays.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::counters::{Counters, LinkStats};
use super::peers::Peers;
use super::{Guard, Inlet, POLL, Stop, address_of, lock, monotonic_now};
use crate::wire::{Parser, RawFrame};

/// Frames that wait for a peer that does not take them as fast.
const OUTBOX: usize = 512;
/// A connection that is not there after this is tried again later.
const CONNECT_WITHIN: Duration = Duration::from_secs(2);
/// The first pause before the next try; it doubles up to the last.
const FIRST_PAUSE: Duration = Duration::from_millis(250);
const LAST_PAUSE: Duration = Duration::from_secs(5);
/// MAVLink peers send a heartbeat a second: one that says nothing for so long is gone, though nobody closed the connection.
const SILENCE: Duration = Duration::from_secs(30);
/// A peer that takes nothing for so long is gone.
const STALLED: Duration = Duration::from_secs(10);
/// Peers of one listening link.
const MAX_CONNECTIONS: usize = 32;
/// Stands for the one peer of a link that has no choice.
const THE_PEER: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::UNSPECIFIED), 0);

/// An open connection, with both directions.
trait Connection: Read + Write + Send {
    /// The same connection for another thread.
    fn share(&self) -> io::Result<Box<dyn Connection>>;
    /// Ends it for all threads.
    fn close(&self);
}

impl Connection for TcpStream {
    fn share(&self) -> io::Result<Box<dyn Connection>> {
        Ok(Box::new(self.try_clone()?))
    }

    fn close(&self) {
        // It may be closed already.
        let _closed = self.shutdown(Shutdown::Both);
    }
}

/// A serial port.
struct Port(Box<dyn serialport::SerialPort>);

impl Read for Port {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.0.read(bytes)
    }
}

impl Write for Port {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(()) // What is written leaves at the port's own pace; waiting for it would only cost time.
    }
}

impl Connection for Port {
    fn share(&self) -> io::Result<Box<dyn Connection>> {
        Ok(Box::new(Self(self.0.try_clone()?)))
    }

    fn close(&self) {
        // Reading and writing end when both threads have dropped it.
    }
}

type Opener = Box<dyn Fn() -> io::Result<Box<dyn Connection>> + Send>;

struct Shared {
    peers: Mutex<Peers>,
    /// Of each connection that is open.
    outboxes: Mutex<BTreeMap<SocketAddr, SyncSender<RawFrame>>>,
    deliver: Mutex<Box<dyn FnMut(RawFrame) + Send>>,
    guard: Arc<Guard>,
    problem: Mutex<Option<String>>,
    counters: Counters,
    stop: Stop,
    opened: Instant,
}

/// A link of streams. Dropping it closes them and waits for its threads.
pub(super) struct Stream {
    shared: Arc<Shared>,
    keeper: Option<JoinHandle<()>>,
    local: Option<SocketAddr>,
}

impl Stream {
    /// Takes connections there.
    pub(super) fn listen(at: SocketAddr, name: String, inlet: Inlet) -> io::Result<Self> {
        let listener = TcpListener::bind(at)?;
        listener.set_nonblocking(true)?;
        let local = Some(listener.local_addr()?);
        Self::start(Peers::learned(), local, name, inlet, move |shared, name| {
            accept(shared, name, &listener);
        })
    }

    /// Connects to `HOST:PORT`, and again when the connection is lost.
    pub(super) fn connect(to: String, name: String, inlet: Inlet) -> io::Result<Self> {
        let open: Opener = Box::new(move || {
            let stream = TcpStream::connect_timeout(&address_of(&to)?, CONNECT_WITHIN)?;
            prepare(&stream)?;
            Ok(Box::new(stream))
        });
        Self::keep(open, name, inlet)
    }

    /// Opens a serial port, and again when it is gone.
    pub(super) fn serial(
        device: String,
        baud: u32,
        name: String,
        inlet: Inlet,
    ) -> io::Result<Self> {
        let open: Opener = Box::new(move || {
            let port = serialport::new(&device, baud).timeout(POLL).open()?;
            Ok(Box::new(Port(port)))
        });
        Self::keep(open, name, inlet)
    }

    fn keep(open: Opener, name: String, inlet: Inlet) -> io::Result<Self> {
        let peers = Peers::fixed(THE_PEER);
        Self::start(peers, None, name, inlet, move |shared, _name| {
            keep_open(shared, &open);
        })
    }

    fn start(
        peers: Peers,
        local: Option<SocketAddr>,
        name: String,
        inlet: Inlet,
        run: impl FnOnce(&Arc<Shared>, &str) + Send + 'static,
    ) -> io::Result<Self> {
        let shared = Arc::new(Shared {
            peers: Mutex::new(peers),
            outboxes: Mutex::new(BTreeMap::new()),
            deliver: Mutex::new(inlet.deliver),
            guard: inlet.guard,
            problem: Mutex::new(None),
            counters: Counters::default(),
            stop: Stop::default(),
            opened: monotonic_now(),
        });
        let for_keeper = Arc::clone(&shared);
        let keeper = thread::Builder::new()
            .name(name.clone())
            .spawn(move || run(&for_keeper, &name))?;
        Ok(Self {
            shared,
            keeper: Some(keeper),
            local,
        })
    }

    pub(super) fn local_address(&self) -> Option<SocketAddr> {
        self.local
    }

    pub(super) fn problem(&self) -> Option<String> {
        lock(&self.shared.problem).clone()
    }

    /// Hands the frame to the connections where its target was heard, or to all; returns to how many.
    pub(super) fn send(&self, frame: &RawFrame) -> usize {
        let age = self.shared.opened.elapsed();
        let targets = lock(&self.shared.peers).targets(frame.target(), age);
        let outboxes = lock(&self.shared.outboxes);
        let mut reached = 0;
        for outbox in targets.iter().filter_map(|peer| outboxes.get(peer)) {
            match outbox.try_send(frame.clone()) {
                Ok(()) => reached += 1,
                Err(TrySendError::Full(_)) => self.shared.counters.dropped(),
                Err(TrySendError::Disconnected(_)) => {}
            }
        }
        reached
    }

    pub(super) fn stats(&self) -> LinkStats {
        let connected = lock(&self.shared.outboxes).len();
        self.shared.counters.stats(connected)
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.shared.stop.now();
        if let Some(keeper) = self.keeper.take()
            && keeper.thread().id() != thread::current().id()
        {
            // A panic of the callback was reported when it happened; there is nothing left to do about it.
            drop(keeper.join());
        }
    }
}

fn prepare(stream: &TcpStream) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(POLL))?;
    stream.set_write_timeout(Some(POLL))
}

/// Takes connections until the link is dropped.
fn accept(shared: &Arc<Shared>, name: &str, listener: &TcpListener) {
    let mut threads: Vec<JoinHandle<()>> = Vec::new();
    while !shared.stop.is_due() {
        threads.retain(|thread| !thread.is_finished());
        let Ok((stream, peer)) = listener.accept() else {
            thread::park_timeout(POLL); // Nobody knocks, or no more files may be opened.
            continue;
        };
        if threads.len() >= MAX_CONNECTIONS {
            continue; // Dropping it closes it.
        }
        let served = Arc::clone(shared);
        let thread = thread::Builder::new().name(name.to_owned()).spawn(move || {
            // Not all systems let a socket inherit that its listener does not block, or not.
            let ready = stream
                .set_nonblocking(false)
                .and_then(|()| prepare(&stream));
            if ready.is_ok() {
                lock(&served.peers).connected(peer, served.opened.elapsed());
                // It was closed, and that is all there is to say.
                let _closed = serve(&served, peer, Box::new(stream));
                lock(&served.peers).closed(peer);
            }
        });
        threads.extend(thread);
    }
    for thread in threads {
        drop(thread.join());
    }
}

/// Opens the connection and serves it, again and again, until the link is dropped.
fn keep_open(shared: &Arc<Shared>, open: &Opener) {
    let mut wait = FIRST_PAUSE;
    while !shared.stop.is_due() {
        let ended = open().and_then(|connection| {
            *lock(&shared.problem) = None;
            let since = monotonic_now();
            let ended = serve(shared, THE_PEER, connection);
            if since.elapsed() > LAST_PAUSE {
                wait = FIRST_PAUSE; // It worked for a while.
            }
            ended
        });
        if let Err(error) = ended {
            *lock(&shared.problem) = Some(error.to_string());
        }
        let until = monotonic_now() + wait;
        while monotonic_now() < until && !shared.stop.is_due() {
            thread::park_timeout(POLL);
        }
        wait = (wait * 2).min(LAST_PAUSE);
    }
}

/// Reads and writes until the connection ends, which is an error, or the link is dropped.
fn serve(
    shared: &Arc<Shared>,
    peer: SocketAddr,
    mut connection: Box<dyn Connection>,
) -> io::Result<()> {
    let writing = connection.share()?;
    let (outbox, frames) = sync_channel(OUTBOX);
    lock(&shared.outboxes).insert(peer, outbox);
    let for_writer = Arc::clone(shared);
    let writer = thread::Builder::new()
        .name("mavlink writer".to_owned())
        .spawn(move || write(&for_writer, &frames, writing));
    let ended = match writer {
        Ok(writer) => {
            let ended = read(shared, peer, connection.as_mut());
            connection.close();
            // Without its outbox the writer ends.
            lock(&shared.outboxes).remove(&peer);
            drop(writer.join());
            ended
        }
        Err(error) => Err(error),
    };
    lock(&shared.outboxes).remove(&peer);
    ended
}

fn read(shared: &Shared, peer: SocketAddr, connection: &mut dyn Connection) -> io::Result<()> {
    let mut bytes = vec![0; 4096];
    let mut parser = Parser::new();
    let mut bad = 0;
    let mut last_heard = monotonic_now();
    while !shared.stop.is_due() {
        shared.guard.keep();
        let length = match connection.read(&mut bytes) {
            Ok(0) => return Err(ErrorKind::ConnectionAborted.into()),
            Ok(length) => length,
            Err(error) if is_pause(&error) => {
                if last_heard.elapsed() > SILENCE {
                    return Err(ErrorKind::TimedOut.into());
                }
                continue;
            }
            Err(error) => return Err(error),
        };
        last_heard = monotonic_now();
        shared.counters.received(length);
        parser.push(&bytes[..length]);
        for frame in parser.by_ref().flatten() {
            if !shared.guard.takes(&frame) {
                continue;
            }
            shared.counters.heard();
            lock(&shared.peers).learn(peer, frame.from(), shared.opened.elapsed());
            (lock(&shared.deliver))(frame);
        }
        shared.counters.bad(parser.bad_frames() - bad);
        bad = parser.bad_frames();
    }
    Ok(())
}

fn write(shared: &Shared, frames: &Receiver<RawFrame>, mut connection: Box<dyn Connection>) {
    loop {
        match frames.recv_timeout(POLL) {
            Ok(frame) => {
                if write_all(shared, frame.bytes(), connection.as_mut()).is_err() {
                    connection.close();
                    return;
                }
                shared.counters.sent(frame.bytes().len());
            }
            Err(RecvTimeoutError::Timeout) if !shared.stop.is_due() => {}
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return,
        }
    }
}

/// Half a frame is worse than none: it is finished, unless the peer takes nothing for a long time.
fn write_all(shared: &Shared, mut bytes: &[u8], connection: &mut dyn Connection) -> io::Result<()> {
    let begun = monotonic_now();
    while !bytes.is_empty() {
        match connection.write(bytes) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(written) => bytes = &bytes[written..],
            Err(error) if is_pause(&error) => {
                if begun.elapsed() > STALLED || shared.stop.is_due() {
                    return Err(ErrorKind::TimedOut.into());
                }
            }
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Whether nothing came, or went, within [`POLL`].
fn is_pause(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
    )
}
