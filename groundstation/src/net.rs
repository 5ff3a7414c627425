//! Links and the recording: all that touches sockets and files while the program runs.
//!
//! Each link has its own reader thread and puts what it hears into one bounded channel; when that is full, frames are
//! dropped and counted, since telemetry repeats itself and tiles are resent. The recording has a thread of its own that
//! loses nothing: its channel blocks. Copies of commands have one, too, since they go out every few milliseconds.

mod copier;
mod copies;

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::link::{Link, LinkError, LinkStats};
use mavlink_ext::tlog::TlogWriter;
use mavlink_ext::{Address, RawFrame};

use crate::clock::Clock;
use copier::Copier;

/// Frames that may wait to be handled.
const WAITING_FRAMES: usize = 8192;
/// What has been recorded is in the file after this time.
const FLUSH_EVERY: Duration = Duration::from_secs(1);

/// One frame as it came in.
#[derive(Clone, Debug)]
pub struct Received {
    /// On which link, counted from 0 in the order they were opened.
    pub link: usize,
    /// When.
    pub at: Stamp,
    /// What.
    pub frame: RawFrame,
}

/// All links.
#[derive(Debug)]
pub struct Net {
    clock: Clock,
    links: Vec<Option<Arc<Link>>>,
    copier: Copier,
    sender: SyncSender<Received>,
    receiver: Receiver<Received>,
    dropped: Arc<AtomicU64>,
}

impl Net {
    /// No link yet.
    pub fn new(clock: Clock) -> io::Result<Self> {
        let (sender, receiver) = sync_channel(WAITING_FRAMES);
        Ok(Self {
            clock,
            links: Vec::new(),
            copier: Copier::start(clock)?,
            sender,
            receiver,
            dropped: Arc::default(),
        })
    }

    /// Opens the next link. One that cannot be opened keeps its number.
    pub fn open(&mut self, uri: &str) -> Result<(), LinkError> {
        let (link, clock) = (self.links.len(), self.clock);
        let (sender, dropped) = (self.sender.clone(), Arc::clone(&self.dropped));
        let copies = self.copier.shared();
        let opened = Link::open(uri, move |frame| {
            let received = Received {
                link,
                at: clock.now(),
                frame,
            };
            copies.heard(received.at, link, &received.frame);
            if let Err(TrySendError::Full(_)) = sender.try_send(received) {
                dropped.fetch_add(1, Ordering::Relaxed);
            }
        });
        let (opened, result) = match opened {
            Ok(opened) => (Some(Arc::new(opened)), Ok(())),
            Err(error) => (None, Err(error)),
        };
        self.copier.add(opened.clone());
        self.links.push(opened);
        result
    }

    /// The next frame that has come in; waits for one at most `patience`.
    pub fn next(&self, patience: Duration) -> Option<Received> {
        if patience.is_zero() {
            return self.receiver.try_recv().ok();
        }
        self.receiver.recv_timeout(patience).ok()
    }

    /// Sends on one link, or on all; commands several times where the link loses frames, see [`mavlink_ext::repeat`].
    pub fn send(&self, link: Option<usize>, frame: &RawFrame) -> Result<(), LinkError> {
        let chosen = self
            .links
            .iter()
            .enumerate()
            .filter(|(number, _)| link.is_none_or(|only| only == *number));
        for link in chosen.filter_map(|(_, link)| link.as_ref()) {
            link.send(frame)?;
        }
        self.copier.sent(link, frame);
        Ok(())
    }

    /// These commands are not wanted any more at this vehicle: no copy of them is sent.
    pub fn forget(&self, vehicle: Address, commands: &[u16]) {
        self.copier.forget(vehicle, commands);
    }

    /// Copies that were sent since the last call, and when.
    pub fn take_copies(&self) -> Vec<(Stamp, RawFrame)> {
        self.copier.take_sent()
    }

    /// What has gone over each link, and what is wrong with it; `None` of one that could not be opened.
    pub fn stats(&self) -> impl Iterator<Item = Option<(LinkStats, Option<String>)>> {
        let links = self.links.iter();
        links.map(|link| link.as_ref().map(|link| (link.stats(), link.problem())))
    }

    /// Frames that were dropped because too many waited.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

/// Why nothing is recorded.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be made.
    #[error("cannot record to {}: {source}{}", path.display(), remedy(source))]
    Create {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It could not be written to its end.
    #[error("the recording {} is incomplete: {reason}", path.display())]
    Incomplete {
        /// Which file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

fn remedy(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::AlreadyExists => "; it is left as it is: choose another name, or move it",
        _ => "",
    }
}

/// Writes everything sent and received to a telemetry log.
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    sender: Option<SyncSender<(u64, RawFrame)>>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl Recorder {
    /// Starts a new file; one that is there is left alone.
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        let create = |source| RecordError::Create {
            path: path.to_owned(),
            source,
        };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(create)?;
        }
        let mut log = TlogWriter::new(BufWriter::new(File::create_new(path).map_err(create)?));
        let (sender, receiver) = sync_channel::<(u64, RawFrame)>(WAITING_FRAMES);
        let write = move || loop {
            match receiver.recv_timeout(FLUSH_EVERY) {
                Ok((unix_us, frame)) => log.write(unix_us, &frame)?,
                Err(RecvTimeoutError::Timeout) => log.flush()?,
                Err(RecvTimeoutError::Disconnected) => return log.flush(),
            }
        };
        let thread = Builder::new()
            .name("recorder".to_owned())
            .spawn(write)
            .map_err(create)?;
        Ok(Self {
            path: path.to_owned(),
            sender: Some(sender),
            thread: Some(thread),
        })
    }

    /// Adds a frame. Errors are told by [`Recorder::finish`].
    pub fn record(&mut self, unix_us: u64, frame: &RawFrame) {
        if let Some(sender) = &self.sender
            && sender.send((unix_us, frame.clone())).is_err()
        {
            self.sender = None;
        }
    }

    /// Whether the file can still be written.
    pub fn is_recording(&self) -> bool {
        self.sender.is_some()
    }

    /// Writes what is left and closes the file.
    pub fn finish(mut self) -> Result<(), RecordError> {
        self.sender = None;
        let Some(thread) = self.thread.take() else {
            return Ok(());
        };
        let incomplete = |reason: String| RecordError::Incomplete {
            path: self.path.clone(),
            reason,
        };
        match thread.join() {
            Ok(written) => written.map_err(|error| incomplete(error.to_string())),
            Err(_) => Err(incomplete("its thread panicked".to_owned())),
        }
    }
}
