//! The socket of a bridge.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::{Bridge, Step};

/// Longer than any packet of `ArduPilot`'s, so that one that is too long shows.
const LONGEST: usize = 2048;
/// How long to wait for a packet before looking whether to end.
const WAIT: Duration = Duration::from_millis(100);
/// After so many waits, whoever sends next is taken for `ArduPilot`: it restarts at another port.
const SILENT_WAITS: u32 = 10;

/// When to end.
#[derive(Clone, Copy, Debug)]
pub struct Until<'a> {
    /// When this is set.
    pub stop: &'a AtomicBool,
    /// When so much time was simulated.
    pub simulated: Option<Duration>,
}

impl Until<'_> {
    fn is_over(&self, bridge: &Bridge<'_>) -> bool {
        let done = self.simulated.is_some_and(|end| bridge.simulated() >= end);
        done || self.stop.load(Ordering::Relaxed)
    }
}

/// Answers whoever sends frames, one sender at a time, until it is over. What is refused is logged the first time and then ever
/// more rarely.
pub fn serve(bridge: &mut Bridge<'_>, socket: &UdpSocket, until: Until<'_>) -> io::Result<()> {
    socket.set_read_timeout(Some(WAIT))?;
    let mut buffer = [0; LONGEST];
    let mut peer: Option<SocketAddr> = None;
    let mut silent = 0;
    while !until.is_over(bridge) {
        let (length, from) = match socket.recv_from(&mut buffer) {
            Ok(received) => received,
            Err(error) if is_nothing(&error) => {
                silent += 1;
                continue;
            }
            Err(error) => return Err(error),
        };
        if let Some(peer) = peer.filter(|peer| *peer != from && silent < SILENT_WAITS) {
            bridge.refuse();
            warn_rarely(bridge, &format!("ArduPilot is at {peer}"), from);
            continue;
        }
        match bridge.handle(&buffer[..length]) {
            Ok((step, answer)) => {
                if peer != Some(from) || step == Step::Restarted {
                    tracing::info!(%from, "ArduPilot is there");
                }
                peer = Some(from);
                silent = 0;
                // It asks again if the answer is lost.
                if let Err(error) = socket.send_to(answer, from) {
                    tracing::warn!(%error, %from, "an answer is lost");
                }
            }
            Err(error) => warn_rarely(bridge, &error.to_string(), from),
        }
    }
    Ok(())
}

/// The 1st, 10th, 100th and so on.
fn warn_rarely(bridge: &Bridge<'_>, reason: &str, from: SocketAddr) {
    let refused = bridge.counters().refused;
    let mut power = refused;
    while power > 1 && power.is_multiple_of(10) {
        power /= 10;
    }
    if power == 1 {
        tracing::warn!(%from, refused, reason, "a packet is refused");
    }
}

/// Nothing has come, or a sender has gone: both pass.
fn is_nothing(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock
            | ErrorKind::TimedOut
            | ErrorKind::Interrupted
            | ErrorKind::ConnectionReset
            | ErrorKind::ConnectionRefused
    )
}
