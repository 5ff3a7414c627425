//! The thread that sends copies of commands when their time has come: the window has other times.

use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle};

use maps::time::Stamp;
use mavlink_ext::link::Link;
use mavlink_ext::{Address, RawFrame};

use super::copies::Copies;
use crate::clock::Clock;

/// Sends copies as long as it lives.
#[derive(Debug)]
pub(super) struct Copier {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// What the window's, the links' and the copier's thread share.
#[derive(Debug)]
pub(super) struct Shared {
    clock: Clock,
    state: Mutex<State>,
    /// Something is due at another time, or it is over.
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    copies: Copies,
    links: Vec<Option<Arc<Link>>>,
    /// Copies that were sent, and when.
    sent: Vec<(Stamp, RawFrame)>,
    is_over: bool,
}

impl Copier {
    pub(super) fn start(clock: Clock) -> io::Result<Self> {
        let shared = Arc::new(Shared {
            clock,
            state: Mutex::default(),
            changed: Condvar::new(),
        });
        let for_thread = Arc::clone(&shared);
        let thread = Builder::new()
            .name("copies".to_owned())
            .spawn(move || for_thread.run())?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// For the threads of links.
    pub(super) fn shared(&self) -> Arc<Shared> {
        Arc::clone(&self.shared)
    }

    /// The next link was opened, or could not be.
    pub(super) fn add(&self, link: Option<Arc<Link>>) {
        self.shared.lock().links.push(link);
    }

    /// A frame was sent on a link, or on all.
    pub(super) fn sent(&self, link: Option<usize>, frame: &RawFrame) {
        let now = self.shared.clock.now();
        self.shared.lock().copies.sent(now, link, frame);
        self.shared.changed.notify_one();
    }

    /// These commands are not wanted any more at this vehicle.
    pub(super) fn forget(&self, vehicle: Address, commands: &[u16]) {
        self.shared.lock().copies.forget(vehicle, commands);
    }

    /// Copies that were sent since the last call, and when.
    pub(super) fn take_sent(&self) -> Vec<(Stamp, RawFrame)> {
        std::mem::take(&mut self.shared.lock().sent)
    }
}

impl Drop for Copier {
    fn drop(&mut self) {
        let links = {
            let mut state = self.shared.lock();
            state.is_over = true;
            std::mem::take(&mut state.links)
        };
        // The last of them may wait for its thread, which may wait for the lock.
        drop(links);
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread of copies has panicked");
        }
    }
}

impl Shared {
    /// A frame came on a link.
    pub(super) fn heard(&self, now: Stamp, link: usize, frame: &RawFrame) {
        let mut state = self.lock();
        let before = state.copies.next_due();
        state.copies.heard(now, link, frame);
        if state.copies.next_due() != before {
            self.changed.notify_one();
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn run(&self) {
        let mut state = self.lock();
        while !state.is_over {
            let now = self.clock.now();
            let due = state.copies.due(now);
            if !due.is_empty() {
                let links = state.links.clone();
                // A link may be slow to take a frame, and those who hear must not wait for it.
                drop(state);
                let sent = due.into_iter().filter(|(link, frame)| {
                    let link = links.get(*link).and_then(Option::as_ref);
                    link.is_some_and(|link| link.send(frame).is_ok())
                });
                let sent: Vec<_> = sent.map(|(_, frame)| (now, frame)).collect();
                // Should these be the last of a link, its end waits for its thread, which may wait for the lock.
                drop(links);
                state = self.lock();
                state.sent.extend(sent);
                continue;
            }
            let waiting = |poisoned: PoisonError<_>| poisoned.into_inner();
            state = match state.copies.next_due() {
                Some(at) => {
                    let patience = at.since(self.clock.now());
                    let woken = self.changed.wait_timeout(state, patience);
                    woken.unwrap_or_else(PoisonError::into_inner).0
                }
                None => self.changed.wait(state).unwrap_or_else(waiting),
            };
        }
    }
}
