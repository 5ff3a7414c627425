//! Links: UDP, TCP and serial ports, each with threads of its own.
//!
//! | link | leads to |
//! |---|---|
//! | `udpin:HOST:PORT` | listens, and answers every peer it hears |
//! | `udpout:HOST:PORT` | one peer |
//! | `udpbcast:ADDRESS:PORT` | a whole network, until somebody answers; then to those that do |
//! | `tcpin:HOST:PORT` | listens for any number of peers |
//! | `tcpout:HOST:PORT` | one peer, connected to again and again |
//! | `serial:DEVICE:BAUD` | what is at the other end of the cable; the device may come and go |
//!
//! With `?signing=required&key=FILE` at its end, frames are signed and only signed ones are taken, see [`crate::signing`];
//! with `accepted` also unsigned ones. Who is not taken is no peer: nothing is sent there.
//!
//! A frame for an address that was heard goes only to the peers where it was heard; everything else goes to all of them.
//! Sending never waits: what a peer does not take in time is lost, as on the air.

mod counters;
mod guard;
mod peers;
mod stream;
#[cfg(test)]
mod tests;
mod udp;
mod uri;

use std::io::ErrorKind;
use std::net::{SocketAddr, ToSocketAddrs as _};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use std::{fmt, io};

use crate::signing::{KeyError, SigningStats};
use crate::wire::RawFrame;
pub use counters::LinkStats;
use guard::Guard;
use stream::Stream;
use udp::Udp;
pub use uri::{LinkSigning, LinkUri, Way};

/// How long a thread waits for bytes before it looks whether the link was dropped.
const POLL: Duration = Duration::from_millis(50);

/// What is done with what comes.
struct Inlet {
    /// With each frame that is taken, on the link's thread.
    deliver: Box<dyn FnMut(RawFrame) + Send>,
    guard: Arc<Guard>,
}

/// Why a link could not be opened or used.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The text is no link.
    #[error(
        "{uri:?} is no link, expected udpin:HOST:PORT, udpout:HOST:PORT, udpbcast:ADDRESS:PORT, tcpin:HOST:PORT, \
         tcpout:HOST:PORT or serial:DEVICE:BAUD, and ?signing=required&key=FILE behind it if frames are signed, or \
         accepted if only some are"
    )]
    Uri {
        /// What was given.
        uri: String,
    },
    /// The signing key cannot be used.
    #[error(transparent)]
    Key(#[from] KeyError),
    /// The host has no address.
    #[error("cannot resolve {host:?}")]
    Resolve {
        /// Host and port.
        host: String,
        /// What the system says.
        source: io::Error,
    },
    /// It could not be opened.
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

/// Tells threads to end.
#[derive(Debug, Default)]
struct Stop(AtomicBool);

impl Stop {
    fn now(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    fn is_due(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

enum Kind {
    Udp(Udp),
    Stream(Stream),
}

/// An open link. Dropping it closes it and waits for its threads.
pub struct Link {
    kind: Kind,
    guard: Arc<Guard>,
}

impl Link {
    /// Opens a link, see [`LinkUri`]. `deliver` is called on the link's thread with every good frame.
    ///
    /// A peer that cannot be connected to and a serial port that is not there are tried again, with pauses that grow;
    /// [`Self::problem`] says what is wrong meanwhile.
    pub fn open(
        uri: &str,
        deliver: impl FnMut(RawFrame) + Send + 'static,
    ) -> Result<Self, LinkError> {
        let parsed: LinkUri = uri.parse()?;
        let name = format!("mavlink {parsed}");
        let guard = Arc::new(Guard::open(parsed.signing.as_ref())?);
        let inlet = Inlet {
            deliver: Box::new(deliver),
            guard: Arc::clone(&guard),
        };
        let opened = match parsed.way {
            Way::UdpIn(at) => Udp::listen(resolve(&at)?, name, inlet).map(Kind::Udp),
            Way::UdpOut(to) => Udp::connect(resolve(&to)?, name, inlet).map(Kind::Udp),
            Way::UdpBroadcast(to) => Udp::broadcast(resolve(&to)?, name, inlet).map(Kind::Udp),
            Way::TcpIn(at) => Stream::listen(resolve(&at)?, name, inlet).map(Kind::Stream),
            Way::TcpOut(to) => Stream::connect(to, name, inlet).map(Kind::Stream),
            Way::Serial { device, baud } => {
                Stream::serial(device, baud, name, inlet).map(Kind::Stream)
            }
        };
        let kind = opened.map_err(|source| LinkError::Open {
            uri: uri.to_owned(),
            source,
        })?;
        Ok(Self { kind, guard })
    }

    /// The address of the socket that listens or sends, its port as chosen by the system where 0 was asked for; `None`
    /// where there is none.
    pub fn local_address(&self) -> Option<SocketAddr> {
        match &self.kind {
            Kind::Udp(udp) => Some(udp.local_address()),
            Kind::Stream(stream) => stream.local_address(),
        }
    }

    /// Sends a frame: to the peers where its target was heard, or to all. Returns to how many; 0 before any was heard.
    ///
    /// A full buffer or an unreachable peer loses the frame, as the air would; other failures are errors.
    pub fn send(&self, frame: &RawFrame) -> Result<usize, LinkError> {
        let Some(frame) = self.guard.sign(frame) else {
            return Ok(0);
        };
        match &self.kind {
            Kind::Udp(udp) => udp.send(&frame),
            Kind::Stream(stream) => Ok(stream.send(&frame)),
        }
    }

    /// What has gone through so far.
    pub fn stats(&self) -> LinkStats {
        match &self.kind {
            Kind::Udp(udp) => udp.stats(),
            Kind::Stream(stream) => stream.stats(),
        }
    }

    /// What was signed and what was not taken.
    pub fn signing_stats(&self) -> SigningStats {
        self.guard.stats()
    }

    /// Why it is not connected at present, or why frames are not taken.
    pub fn problem(&self) -> Option<String> {
        let connection = match &self.kind {
            Kind::Udp(_) => None,
            Kind::Stream(stream) => stream.problem(),
        };
        connection.or_else(|| self.guard.problem())
    }
}

impl fmt::Debug for Link {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Link")
            .field("local", &self.local_address())
            .field("stats", &self.stats())
            .finish_non_exhaustive()
    }
}

/// What is locked survives a callback that panicked: it is changed only between callbacks.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn resolve(host: &str) -> Result<SocketAddr, LinkError> {
    address_of(host).map_err(|source| LinkError::Resolve {
        host: host.to_owned(),
        source,
    })
}

fn address_of(host: &str) -> io::Result<SocketAddr> {
    let mut addresses = host.to_socket_addrs()?;
    addresses.next().ok_or_else(|| ErrorKind::NotFound.into())
}

#[expect(
    clippy::disallowed_methods,
    reason = "the shell around a socket: peers that fell silent are forgotten by real time"
)]
fn monotonic_now() -> Instant {
    Instant::now()
}
