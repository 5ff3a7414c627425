//! The threads between the camera and the rest: `sensor-decode`, which also seeks features → `slam` → `tile-encode`; beside
//! `slam`, where one is configured, the `detector`.
//!
//! The channels between them are bounded and a full one makes the sender wait: a recording loses no frame and the map
//! no tile; what is slow shows as latency. [`uav`] does the work; here are its thread, its pace and its stop-watch.

pub mod detecting;
pub mod uav;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use maps::camera::RgbdFrame;
use maps::tile::TileId;
use maps::time::Stamp;
use sensors::beside::Beside;
use sensors::live::{Live, Losses};
use sensors::mcap::McapFile;
use sensors::prefetch::Prefetch;
use sensors::tum::TumFolder;
use sensors::zenoh::ZenohSource;
use sensors::{RgbdSource, SourceError};
use slam::{FrameError, Look, Tracked};

use crate::clock::Clock;
use crate::config::{MappingSettings, Pace, SourcePlace, SourceSettings};
use crate::event::Event;
use crate::output::{self, Ate};
use detecting::{DetectorFigures, Lookout};
use uav::{FloorFigures, MapFigures, MapUpdate, Mapper};

/// How many frames are decoded ahead of the one that is tracked.
const DECODED_AHEAD: usize = 4;

/// How many map updates may wait to be encoded.
const UPDATES_WAITING: usize = 2;

/// One frame has been processed.
#[derive(Clone, Debug)]
pub struct FrameDone {
    /// When it came out of the source, on the program's clock: for a recording at its own pace, when the shutter was
    /// open.
    pub released: Stamp,
    /// What SLAM made of it; `None` if it could not be used at all.
    pub tracked: Option<Tracked>,
    /// How many settled keyframes went into the map.
    pub keyframes: usize,
    /// How long tracking took.
    pub tracking: Duration,
    /// How long it took to put settled keyframes into the map.
    pub mapping: Duration,
}

impl FrameDone {
    /// Tracking and mapping together.
    pub fn duration(&self) -> Duration {
        self.tracking + self.mapping
    }
}

/// Tiles that have changed, ready for the wire.
#[derive(Clone, Debug)]
pub struct TilesChanged {
    /// The whole map with these tiles in it.
    pub map: MapFigures,
    /// All of one version.
    pub tiles: Vec<EncodedTile>,
}

/// One tile, ready for the wire.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EncodedTile {
    /// Which tile.
    pub id: TileId,
    /// Rises with every change.
    pub version: u64,
    /// [`maps::tile::Tile::encode`].
    pub bytes: Vec<u8>,
}

/// The source has ended.
#[derive(Clone, Debug)]
pub struct SourceEnded {
    /// Why.
    pub ending: Ending,
    /// How far the trajectory is from the truth, where the recording has it.
    pub ate: Option<Ate>,
    /// The final map.
    pub map: MapFigures,
    /// The floor on which it stands; none if no frame could be used.
    pub floor: Option<FloorFigures>,
    /// What of a live camera's messages was not used; none of a recording.
    pub losses: Option<Losses>,
    /// What the detector has done, where there is one.
    pub detector: Option<DetectorFigures>,
}

/// Why a source has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The recording was over.
    Finished,
    /// We were asked to stop.
    Stopped,
    /// Something failed, in one line.
    Failed(String),
}

/// Opens the source of the configuration: a folder is in TUM layout, a file is MCAP. A live camera is waited for.
pub fn open_source(settings: &SourceSettings) -> Result<Box<dyn RgbdSource>, SourceError> {
    let topics = settings.topics.clone();
    Ok(match &settings.place {
        SourcePlace::Recording(path) if path.is_dir() => {
            Box::new(TumFolder::open(path, settings.camera, settings.tum)?)
        }
        SourcePlace::Recording(path) => Box::new(McapFile::open(path, topics)?),
        SourcePlace::Live(session, patience) => {
            Box::new(ZenohSource::open(session, topics, *patience)?)
        }
    })
}

/// How many frames are decoded ahead: of a live camera as few as can be, as the newest frame matters.
pub(crate) fn decoded_ahead(source: &dyn RgbdSource) -> usize {
    if source.live().is_some() {
        1
    } else {
        DECODED_AHEAD
    }
}

/// How a source is processed.
pub struct Plan {
    /// Localisation and mapping.
    pub mapping: MappingSettings,
    /// What knows people and vehicles.
    pub lookout: Option<Lookout>,
    /// How fast a recording is played.
    pub pace: Pace,
    /// Folder for the trajectory and the map.
    pub out: PathBuf,
}

/// The running threads. Dropping it stops them and waits.
pub struct Pipeline {
    /// Dropped to stop the `slam` thread.
    stop: Option<SyncSender<()>>,
    /// Ends its wait for a live camera.
    live: Option<Live>,
    threads: Vec<JoinHandle<()>>,
}

impl Pipeline {
    /// Starts to process a source; what happens goes to `events`.
    pub fn start(
        source: Box<dyn RgbdSource>,
        plan: Plan,
        clock: Clock,
        events: SyncSender<(Stamp, Event)>,
    ) -> io::Result<Self> {
        let (stop, stopped) = sync_channel(0);
        let (updates, waiting) = sync_channel(UPDATES_WAITING);
        let camera = source.camera();
        let live = source.live();
        let ahead = decoded_ahead(source.as_ref());
        let front_end = Mapper::front_end(camera, &plan.mapping);
        let source = Prefetch::with(source, ahead, move |frame| front_end.look(frame))?;
        // A live camera has a pace of its own.
        let pace = live.as_ref().map_or(plan.pace, |_| Pace::Fast);
        let watch = live.clone().map(Watch::new);
        let send = events.clone();
        let encode = Builder::new()
            .name("tile-encode".into())
            .spawn(move || encode_updates(&waiting, clock, &send))?;
        let slam = Builder::new().name("slam".into()).spawn(move || {
            let mut work = Work {
                mapper: Mapper::new(camera, &plan.mapping, plan.lookout),
                pacer: Pacer::new(pace),
                watch,
                clock,
                events: &events,
            };
            let mut source = source;
            let ending = work.run(&mut source, &stopped, &updates);
            source.finish();
            let ended = end(&mut work.mapper, &source, &plan.out, ending, &updates);
            // Fails only where nobody listens any more.
            let _delivered = updates.send(Update::Ended(ended));
        })?;
        Ok(Self {
            stop: Some(stop),
            live,
            threads: vec![slam, encode],
        })
    }

    /// Asks the threads to end after the frame in hand; [`SourceEnded`] still comes.
    pub fn stop(&mut self) {
        self.stop = None;
        if let Some(live) = &self.live {
            live.stop();
        }
    }

    /// Whether all threads have ended.
    pub fn is_finished(&self) -> bool {
        self.threads.iter().all(JoinHandle::is_finished)
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        self.stop();
        for thread in self.threads.drain(..) {
            // A panic there has been printed by the thread itself.
            let _outcome = thread.join();
        }
    }
}

/// What was found in a frame, ahead of its tracking.
pub(crate) type Seen = Result<Look, FrameError>;

/// What goes from `slam` to `tile-encode`.
enum Update {
    Tiles(MapUpdate),
    Ended(SourceEnded),
}

struct Work<'a> {
    mapper: Mapper,
    pacer: Pacer,
    /// Of a live camera.
    watch: Option<Watch>,
    clock: Clock,
    events: &'a SyncSender<(Stamp, Event)>,
}

impl Work<'_> {
    /// Until the source ends, fails or is stopped.
    fn run(
        &mut self,
        source: &mut Prefetch<Seen>,
        stopped: &Receiver<()>,
        updates: &SyncSender<Update>,
    ) -> Ending {
        while stopped.try_recv() == Err(TryRecvError::Empty) {
            let (frame, seen) = match source.next_made() {
                Ok(Some(made)) => made,
                // A live camera ends when it is stopped.
                Ok(None) if self.watch.is_some() => return Ending::Stopped,
                Ok(None) => return Ending::Finished,
                Err(error) => return Ending::Failed(chain(&error)),
            };
            if let Some(watch) = &mut self.watch {
                watch.look(self.clock.now());
            }
            let wait = self.pacer.wait(self.clock.now(), frame.at);
            if !wait.is_zero() && stopped.recv_timeout(wait) != Err(RecvTimeoutError::Timeout) {
                break;
            }
            let taken = (&frame, seen, source.beside());
            let done = process(&mut self.mapper, taken, self.clock);
            let event = (self.clock.now(), Event::FrameDone(Box::new(done)));
            let update = self.mapper.update(frame.at).map(Update::Tiles);
            let delivered = self.events.send(event).is_ok()
                && update.is_none_or(|update| updates.send(update).is_ok());
            if !delivered {
                break;
            }
        }
        Ending::Stopped
    }
}

/// Tracks a frame, puts what has settled into the map, and takes the time.
pub(crate) fn process(
    mapper: &mut Mapper,
    (frame, seen, beside): (&RgbdFrame, Seen, Beside),
    clock: Clock,
) -> FrameDone {
    let released = clock.now();
    let tracked = seen.and_then(|look| mapper.track_seen(frame, look, &beside));
    let tracked_at = clock.now();
    let keyframes = mapper.insert_settled();
    FrameDone {
        released,
        tracked: tracked
            .inspect_err(|error| tracing::warn!(%error, "frame left out"))
            .ok(),
        keyframes,
        tracking: tracked_at.since(released),
        mapping: clock.now().since(tracked_at),
    }
}

/// The last keyframes and tiles, the files, and how good it was.
fn end(
    mapper: &mut Mapper,
    source: &Prefetch<Seen>,
    out: &Path,
    ending: Ending,
    updates: &SyncSender<Update>,
) -> SourceEnded {
    if let Some(update) = mapper.finish() {
        // Fails only where nobody listens any more.
        let _delivered = updates.send(Update::Tiles(update));
    }
    let trajectory = mapper.trajectory();
    let ending = match (output::write_map(out, mapper.map(), &trajectory), ending) {
        (Err(error), Ending::Finished | Ending::Stopped) => Ending::Failed(chain(&error)),
        (_, ending) => ending,
    };
    SourceEnded {
        ending,
        ate: output::ate(source.truth(), &trajectory),
        map: mapper.figures(),
        floor: mapper.floor(),
        losses: source.live().map(|live| live.losses()),
        detector: mapper.detector(),
    }
}

/// Tells of what a live camera sends and is not used, now and then.
struct Watch {
    live: Live,
    told: Losses,
    next: Stamp,
}

/// How often losses are told.
const TELL_LOSSES_EVERY: Duration = Duration::from_secs(10);

impl Watch {
    fn new(live: Live) -> Self {
        Self {
            live,
            told: Losses::default(),
            next: Stamp::ZERO,
        }
    }

    fn look(&mut self, now: Stamp) {
        let losses = self.live.losses();
        if losses == self.told || now < self.next {
            return;
        }
        let Losses {
            overflowed,
            damaged,
            unpaired,
            late,
        } = losses;
        tracing::warn!(
            overflowed,
            damaged,
            unpaired,
            late,
            "messages of the camera were left out so far"
        );
        self.told = losses;
        self.next = now + TELL_LOSSES_EVERY;
    }
}

/// An error and its causes in one line.
pub(crate) fn chain<E: std::error::Error + 'static>(error: &E) -> String {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}

/// The thread `tile-encode`.
fn encode_updates(waiting: &Receiver<Update>, clock: Clock, events: &SyncSender<(Stamp, Event)>) {
    for update in waiting {
        let event = match update {
            Update::Ended(ended) => Event::SourceEnded(ended),
            Update::Tiles(update) => Event::TilesChanged(encode(&update)),
        };
        if events.send((clock.now(), event)).is_err() {
            return;
        }
    }
}

/// Makes the tiles of an update ready for the wire.
pub fn encode(update: &MapUpdate) -> TilesChanged {
    let encoded = |tile: &maps::tile::Tile| EncodedTile {
        id: tile.id,
        version: tile.version,
        bytes: tile.encode(),
    };
    TilesChanged {
        map: update.map,
        tiles: update.tiles.iter().map(encoded).collect(),
    }
}

/// When a frame of a recording is due.
struct Pacer {
    pace: Pace,
    /// When the first frame was released, and its stamp in the recording.
    start: Option<(Stamp, Stamp)>,
}

impl Pacer {
    fn new(pace: Pace) -> Self {
        Self { pace, start: None }
    }

    /// How long to wait at `now` for the frame that was recorded at `at`.
    fn wait(&mut self, now: Stamp, at: Stamp) -> Duration {
        let (started, first) = *self.start.get_or_insert((now, at));
        match self.pace {
            Pace::Fast => Duration::ZERO,
            Pace::Recorded => (started + at.since(first)).since(now),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_is_played_at_its_own_pace_and_never_ahead_of_it() {
        let ms = |ms: u64| Stamp::from_nanos(1_000_000 * ms);
        let mut pacer = Pacer::new(Pace::Recorded);
        assert_eq!(pacer.wait(ms(500), ms(90_000)), Duration::ZERO, "the first");
        assert_eq!(pacer.wait(ms(510), ms(90_033)), Duration::from_millis(23));
        assert_eq!(pacer.wait(ms(700), ms(90_066)), Duration::ZERO, "behind");
        let mut pacer = Pacer::new(Pace::Fast);
        assert_eq!(pacer.wait(ms(500), ms(90_000)), Duration::ZERO);
        assert_eq!(pacer.wait(ms(501), ms(99_000)), Duration::ZERO);
    }
}
