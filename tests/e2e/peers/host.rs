//! Our end of a link to a peer: a service behind a socket.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use maps::time::Stamp;
use mavlink_ext::dialect::tandem::{HEARTBEAT_DATA, MavAutopilot, MavType};
use mavlink_ext::link::Link;
use mavlink_ext::{Address, Message, RawFrame};

use super::free_port;

pub(super) const AUTOPILOT: Address = Address::new(1, 1);
pub(super) const COMPANION: Address = Address::new(1, 191);

/// What an end of a link does: frames out, for what comes in and when time passes.
pub(super) trait Service: Send + 'static {
    fn handle(&mut self, now: Stamp, frame: &RawFrame) -> Vec<RawFrame>;
    fn tick(&mut self, now: Stamp) -> Vec<RawFrame>;
}

/// Runs a service behind a socket until it is stopped, and gives it back.
pub(super) struct Host<S> {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<S>,
    /// Where the peer has to listen.
    pub(super) port: u16,
}

impl<S: Service> Host<S> {
    pub(super) fn start(mut service: S) -> Self {
        let port = free_port();
        let (sender, frames) = sync_channel(1000);
        let uri = format!("udpout:127.0.0.1:{port}");
        let link = Link::open(&uri, move |frame| drop(sender.try_send(frame)));
        let link = link.expect("loopback has free ports");
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let serve = move || {
            let begun = clock();
            while !stopped.load(Ordering::Relaxed) {
                let heard = frames.recv_timeout(Duration::from_millis(5)).ok();
                let now = Stamp::ZERO + clock().saturating_sub(begun);
                let answers = heard.map_or(Vec::new(), |frame| service.handle(now, &frame));
                for frame in answers.iter().chain(&service.tick(now)) {
                    link.send(frame).expect("loopback takes it");
                }
            }
            service
        };
        let thread = Builder::new().name("service".to_owned()).spawn(serve);
        let thread = thread.expect("there are threads");
        Self { stop, thread, port }
    }

    pub(super) fn stop(self) -> S {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().expect("the service does not panic")
    }
}

pub(super) fn heartbeat(mavtype: MavType, autopilot: MavAutopilot) -> Message {
    Message::HEARTBEAT(HEARTBEAT_DATA {
        mavtype,
        autopilot,
        mavlink_version: 3,
        ..HEARTBEAT_DATA::default()
    })
}

#[expect(
    clippy::disallowed_methods,
    reason = "a peer of another program, in real time"
)]
pub(super) fn clock() -> Duration {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
    since_1970.unwrap_or_default()
}
