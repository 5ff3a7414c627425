//! Threads that make sequences, and who watches them.

use std::collections::BTreeMap;
use std::fs::{self, File as Handle, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::disk::{Disk, Part, cannot};
use super::files::File;
use super::record::{self, Record, SEQUENCE};
use super::world::World;
use super::{DatasetError, Job, Layout, Settings, opv2v, tandem};
use crate::scene::Scene;

/// News that may wait. A thread that finds no room waits too: whoever listens does little.
const QUEUE: usize = 64;
/// What one frame says about the others may be off by this share.
const MARGIN: f64 = 1.15;

/// How far a set is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Frames that are written.
    pub frames: u64,
    /// Frames that are to be written.
    pub all_frames: u64,
    /// Bytes that are written.
    pub bytes: u64,
    /// About how many there will be.
    pub all_bytes: u64,
    /// Sequences that are whole, with those that were there before.
    pub sequences: usize,
    /// Sequences of the set.
    pub all_sequences: usize,
    /// Bytes that the disk has room for.
    pub room: u64,
}

/// What was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Sequences that were made now.
    pub made: usize,
    /// Sequences that were there already.
    pub kept: usize,
    /// Sequences that are missing yet, because it was told to stop.
    pub missing: usize,
    /// Bytes that were written.
    pub bytes: u64,
}

/// What threads tell.
enum News {
    Frame(u64),
    Whole(Job, Record),
    Failed(DatasetError),
}

/// Makes all sequences that are missing, until `stop`: then each thread ends after the frame that it is at. `watch` is
/// called before the first frame and after each.
pub fn run(
    settings: &Settings,
    disk: &dyn Disk,
    stop: &AtomicBool,
    watch: impl FnMut(&Progress),
) -> Result<Outcome, DatasetError> {
    settings.check()?;
    let folder = settings.folder();
    fs::create_dir_all(&folder).map_err(cannot("make", &folder))?;
    let _lock = lock(&folder)?;
    record::compare(settings)?;
    let mut records = BTreeMap::new();
    let mut missing = Vec::new();
    for job in settings.jobs() {
        match record::whole(settings, job)? {
            Some(record) => drop(records.insert(job.to_string(), record)),
            None => missing.push(job),
        }
    }
    let pool = pool(settings.threads)?;
    let per_frame = pool.install(|| probe(settings, &records))?;
    let room = disk.room(&folder).map_err(cannot("look at", &folder))?;
    let progress = Progress {
        all_frames: missing.len() as u64 * u64::from(settings.frames),
        all_bytes: expected(settings, &per_frame, &missing),
        sequences: records.len(),
        all_sequences: records.len() + missing.len(),
        room,
        ..Progress::default()
    };
    if progress.all_bytes > room {
        return Err(DatasetError::NoRoom {
            folder,
            needed: progress.all_bytes,
            free: room,
        });
    }
    record::write_manifest(disk, settings, &records)?;
    let mut told = Told {
        progress,
        records,
        failure: None,
    };
    let kept = told.records.len();
    work(settings, disk, (stop, &missing), &mut told, watch)?;
    let written = record::write_manifest(disk, settings, &told.records);
    if let Some(failure) = told.failure {
        return Err(failure);
    }
    written?;
    let made = told.records.len() - kept;
    Ok(Outcome {
        made,
        kept,
        missing: missing.len() - made,
        bytes: told.progress.bytes,
    })
}

/// What has been told so far.
struct Told {
    progress: Progress,
    records: BTreeMap<String, Record>,
    failure: Option<DatasetError>,
}

/// Held while a program writes to a split; the system lets go of it when the program ends, however it does.
fn lock(folder: &Path) -> Result<Handle, DatasetError> {
    let path = folder.join(".lock");
    let file = Handle::create(&path).map_err(cannot("make", &path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(DatasetError::Busy(folder.to_owned())),
        Err(TryLockError::Error(error)) => Err(cannot("lock", &path)(error)),
    }
}

fn pool(threads: usize) -> Result<ThreadPool, DatasetError> {
    let pool = ThreadPoolBuilder::new().num_threads(threads.max(1)).build();
    pool.map_err(|_cause| DatasetError::Threads(threads))
}

/// Bytes of a frame of each scene; and that what is there already is what this program makes.
fn probe(
    settings: &Settings,
    records: &BTreeMap<String, Record>,
) -> Result<BTreeMap<String, f64>, DatasetError> {
    let one = |scene: &crate::scene::Name| {
        let jobs = settings.seeds.clone().map(|seed| Job {
            scene: *scene,
            seed,
        });
        let known = jobs
            .clone()
            .find_map(|job| Some((job, records.get(&job.to_string())?)));
        let (job, frame) = match known {
            Some((job, _)) => (job, 0),
            None => (
                Job {
                    scene: *scene,
                    seed: settings.seeds.start,
                },
                settings.frames / 2,
            ),
        };
        let scene = Scene::generate(job.scene, job.seed);
        let files = frame_files(settings, job, &World::new(&scene, job.seed), frame)?;
        let mut bytes: u64 = files.iter().map(|file| file.bytes.len() as u64).sum();
        if let Some((job, record)) = known {
            compare(&settings.folder().join(job.to_string()), &files)?;
            bytes = record.bytes / u64::from(settings.frames);
        }
        Ok((job.scene.to_string(), bytes as f64))
    };
    settings.scenes.par_iter().map(one).collect()
}

fn compare(folder: &Path, files: &[File]) -> Result<(), DatasetError> {
    for file in files {
        let path = folder.join(&file.name);
        if fs::read(&path).map_err(cannot("read", &path))? != file.bytes {
            return Err(DatasetError::Version {
                folder: folder.to_owned(),
                file: file.name.clone(),
            });
        }
    }
    Ok(())
}

fn expected(settings: &Settings, per_frame: &BTreeMap<String, f64>, missing: &[Job]) -> u64 {
    let of = |job: &Job| {
        per_frame
            .get(&job.scene.to_string())
            .copied()
            .unwrap_or(0.0)
    };
    let frames: f64 = missing.iter().map(of).sum();
    (frames * f64::from(settings.frames) * MARGIN) as u64
}

/// Lets threads loose on the sequences, and listens to them.
fn work(
    settings: &Settings,
    disk: &dyn Disk,
    (stop, missing): (&AtomicBool, &[Job]),
    told: &mut Told,
    mut watch: impl FnMut(&Progress),
) -> Result<(), DatasetError> {
    watch(&told.progress);
    let workers = settings.threads.clamp(1, missing.len().max(1));
    // Each works alone, since one that waits for another must not begin a second sequence meanwhile: memory.
    let pools = (0..workers).map(|worker| pool((settings.threads + worker) / workers));
    let pools: Vec<ThreadPool> = pools.collect::<Result<_, _>>()?;
    let next = AtomicUsize::new(0);
    let failed = AtomicBool::new(false);
    let go_on = || !stop.load(Ordering::Relaxed) && !failed.load(Ordering::Relaxed);
    let (tell, news) = sync_channel(QUEUE);
    thread::scope(|scope| {
        for pool in &pools {
            let (tell, next, go_on) = (tell.clone(), &next, &go_on);
            let work = move || {
                while let Some(job) = missing.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if !go_on() || !pool.install(|| attempt(settings, disk, *job, go_on, &tell)) {
                        return;
                    }
                }
            };
            let spawned = thread::Builder::new()
                .name("sequences".into())
                .spawn_scoped(scope, work);
            if spawned.is_err() {
                failed.store(true, Ordering::Relaxed);
                told.failure = Some(DatasetError::Threads(workers));
            }
        }
        drop(tell);
        listen(&news, told, &failed, &mut watch);
    });
    Ok(())
}

fn listen(
    news: &Receiver<News>,
    told: &mut Told,
    failed: &AtomicBool,
    watch: &mut impl FnMut(&Progress),
) {
    for news in news {
        match news {
            News::Frame(bytes) => {
                told.progress.frames += 1;
                told.progress.bytes += bytes;
            }
            News::Whole(job, record) => {
                told.progress.sequences += 1;
                told.records.insert(job.to_string(), record);
            }
            News::Failed(error) => {
                failed.store(true, Ordering::Relaxed);
                // The others fail for the same reason, or for this one's.
                told.failure.get_or_insert(error);
            }
        }
        watch(&told.progress);
    }
}

/// Makes a sequence and tells of it; whether another may follow.
fn attempt(
    settings: &Settings,
    disk: &dyn Disk,
    job: Job,
    go_on: &(dyn Fn() -> bool + Sync),
    tell: &SyncSender<News>,
) -> bool {
    let news = match sequence(settings, disk, job, go_on, tell) {
        Ok(None) => return false,
        Ok(Some(record)) => News::Whole(job, record),
        Err(error) => News::Failed(error),
    };
    let is_whole = matches!(news, News::Whole(..));
    tell.send(news).is_ok() && is_whole
}

/// `None` if it was told to stop.
fn sequence(
    settings: &Settings,
    disk: &dyn Disk,
    job: Job,
    go_on: &(dyn Fn() -> bool + Sync),
    tell: &SyncSender<News>,
) -> Result<Option<Record>, DatasetError> {
    let whole: PathBuf = settings.folder().join(job.to_string());
    let mut part = Part::create(disk, &whole)?;
    let scene = Scene::generate(job.scene, job.seed);
    let world = World::new(&scene, job.seed);
    if settings.layout == Layout::Opv2v {
        let text = opv2v::protocol(&job.scene.to_string(), job.seed, settings.rate_hz);
        part.write(&File {
            name: "data_protocol.yaml".into(),
            bytes: text.into_bytes(),
        })?;
    }
    for frame in 0..settings.frames {
        if !go_on() {
            return Ok(None);
        }
        let mut bytes = 0;
        for file in frame_files(settings, job, &world, frame)? {
            part.write(&file)?;
            bytes += file.bytes.len() as u64;
        }
        if tell.send(News::Frame(bytes)).is_err() {
            return Ok(None);
        }
    }
    let record = Record::new(settings, job, &part.digests);
    part.finish(&whole, SEQUENCE, &record.text())?;
    Ok(Some(record))
}

fn frame_files(
    settings: &Settings,
    job: Job,
    world: &World<'_>,
    frame: u32,
) -> Result<Vec<File>, DatasetError> {
    let (at, stem) = (settings.stamp(frame), format!("{frame:06}"));
    let files = match settings.layout {
        Layout::Tandem => tandem::frame(world, at, &stem),
        Layout::Opv2v => opv2v::frame(world, at, &stem),
    };
    files.map_err(|source| DatasetError::Picture {
        sequence: job.to_string(),
        source,
    })
}
