//! A thread that records and publishes what sensors see.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::bail;
use maps::time::Stamp;

use super::Settings;
use crate::flight::LAP;
use crate::record::{self, Follow, Plan, RecordError, Recording};
use crate::simulation::Event;

/// The longest run whose sensors are read, if nobody ends it.
const LONGEST: Duration = Duration::from_hours(24);
/// Being later than this is worth a word.
const LATE: Duration = Duration::from_secs(1);

pub(super) struct Recorder {
    /// Dropped to stop the thread.
    stop: Option<SyncSender<()>>,
    thread: JoinHandle<Result<Recording, RecordError>>,
}

impl Recorder {
    /// Where there is no run to follow, the end of the recording is the end of the run; if it is published, too, it keeps
    /// step with the clock.
    pub(super) fn start(
        settings: &Settings,
        follow: Option<Follow>,
        inbox: &SyncSender<Event>,
        clock: impl Fn() -> Stamp + Send + 'static,
    ) -> std::io::Result<Self> {
        let is_live = settings.zenoh.is_some();
        let plan = Plan {
            setup: settings.setup.clone(),
            file: settings.record.clone(),
            zenoh: settings.zenoh.clone(),
            duration: match settings.duration {
                Some(duration) => duration,
                None if is_live || follow.is_some() => LONGEST,
                None => LAP,
            },
        };
        let at_end = follow.is_none().then(|| inbox.clone());
        let mut pace = Pace {
            is_kept: is_live && follow.is_none(),
            is_told: is_live,
            has_warned: false,
        };
        let (stop, stopped) = sync_channel(0);
        let work = move || {
            let recording = record::record(&plan, follow.as_ref(), |done| {
                if done.subsec_millis() == 0 && done.as_secs().is_multiple_of(10) {
                    tracing::info!(seconds = done.as_secs(), "sensors");
                }
                pace.go_on(done, clock(), &stopped)
            });
            if recording.is_err() {
                tracing::warn!(
                    "recording has ended with an error, which is told at the end of the run"
                );
            }
            if let Some(inbox) = at_end {
                // Nobody listens any more only if the run has been stopped already.
                let _already_stopped = inbox.send(Event::Stop);
            }
            recording
        };
        let thread = thread::Builder::new().name("recorder".into()).spawn(work)?;
        Ok(Self {
            stop: Some(stop),
            thread,
        })
    }

    /// Ends it after what it draws now.
    pub(super) fn stop(&mut self) {
        self.stop = None;
    }

    /// Waits until it has caught up with a run that has ended, or is told to stop once more.
    pub(super) fn catch_up(&mut self, events: &Receiver<Event>) {
        if !self.thread.is_finished() {
            tracing::info!("drawing what is left of the recording; stop once more to leave it out");
        }
        while !self.thread.is_finished() {
            match events.recv_timeout(Duration::from_millis(50)) {
                Ok(Event::Stop) | Err(RecvTimeoutError::Disconnected) => return self.stop(),
                Ok(_) | Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    pub(super) fn finish(self) -> anyhow::Result<Recording> {
        match self.thread.join() {
            Ok(recording) => Ok(recording?),
            Err(_panic) => bail!("the recorder has stopped with a panic"),
        }
    }
}

/// How drawing keeps step with the clock.
struct Pace {
    /// Whether nothing is drawn before its time.
    is_kept: bool,
    /// Whether being late is worth a word.
    is_told: bool,
    has_warned: bool,
}

impl Pace {
    /// Waits until it is time; whether it has not been stopped.
    fn go_on(&mut self, done: Duration, now: Stamp, stopped: &Receiver<()>) -> bool {
        let due = Stamp::ZERO + done;
        if self.is_told && !self.has_warned && now.since(due) > LATE {
            self.has_warned = true;
            tracing::warn!(
                "drawing takes longer than real time: what is published comes late; leave sensors out with --aboard"
            );
        }
        let wait = due.since(now);
        if self.is_kept && !wait.is_zero() {
            return stopped.recv_timeout(wait) == Err(RecvTimeoutError::Timeout);
        }
        stopped.try_recv() == Err(TryRecvError::Empty)
    }
}
