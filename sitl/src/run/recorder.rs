//! A thread that records.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::bail;

use super::Settings;
use crate::flight::LAP;
use crate::record::{self, Follow, Plan, RecordError, Recording};
use crate::simulation::Event;

/// The longest recording of a run that nobody ends.
const LONGEST: Duration = Duration::from_hours(24);

pub(super) struct Recorder {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Result<Recording, RecordError>>,
}

impl Recorder {
    /// Where there is no run to follow, the end of the recording is the end of the run.
    pub(super) fn start(
        settings: &Settings,
        file: &Path,
        follow: Option<Follow>,
        inbox: &SyncSender<Event>,
    ) -> std::io::Result<Self> {
        let plan = Plan {
            setup: settings.setup.clone(),
            file: file.to_owned(),
            duration: match (settings.duration, &follow) {
                (Some(duration), _) => duration,
                (None, None) => LAP,
                (None, Some(_)) => LONGEST,
            },
        };
        let at_end = follow.is_none().then(|| inbox.clone());
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let work = move || {
            let recording = record::record(&plan, follow, |done| {
                if done.subsec_millis() == 0 && done.as_secs().is_multiple_of(10) {
                    tracing::info!(seconds = done.as_secs(), "recording");
                }
                !stopped.load(Ordering::Relaxed)
            });
            if let Some(inbox) = at_end {
                // Nobody listens any more only if the run has been stopped already.
                let _already_stopped = inbox.send(Event::Stop);
            }
            recording
        };
        let thread = thread::Builder::new().name("recorder".into()).spawn(work)?;
        Ok(Self { stop, thread })
    }

    /// Ends it after what it draws now.
    pub(super) fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Waits until it has caught up with a run that has ended, or is told to stop once more.
    pub(super) fn catch_up(&self, events: &Receiver<Event>) {
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
