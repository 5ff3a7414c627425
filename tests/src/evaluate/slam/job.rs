//! One method on one recording, in a process of its own: what it is told and what it leaves.
//!
//! A job is a JSON file, so that ours and a peer in another language take the same. In its folder it leaves, under the name
//! of the method, the estimated trajectory (`.txt`, in TUM format), what each frame took (`.csv`) and [`Measured`]
//! (`.json`).

use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::ValueEnum as _;
use maps::camera::{Pinhole, RgbdFrame};
use maps::time::Stamp;
use maps::trajectory::Trajectory;
use maps::trajectory::tum;
use sensors::RgbdSource as _;
use sensors::tum::{self as folder, MissingImages, TumFolder};
use serde::{Deserialize, Serialize};
use sitl::platform::body_from_uav_camera;
use sitl::scene::{Name, Scene};
use slam::{Aid, Seen, Slam, State};

use super::ghosts::{Hit, Keyframes, hit_by_movers};
use super::honesty::{self, Told};
use super::inertial;
use super::meter::{Meter, peak_mb};
use super::methods::{Inertial, Method};
use super::objects::Objects;
use super::positions::{self, Positions};

/// A lens, as a job's file has it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Lens {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Focal lengths and principal point in pixels.
    pub(super) fx: f64,
    pub(super) fy: f64,
    pub(super) cx: f64,
    pub(super) cy: f64,
    /// `[k1, k2, p1, p2, k3]`.
    pub(super) distortion: [f64; 5],
}

impl From<Pinhole> for Lens {
    fn from(camera: Pinhole) -> Self {
        Self {
            width: camera.width,
            height: camera.height,
            fx: camera.fx,
            fy: camera.fy,
            cx: camera.cx,
            cy: camera.cy,
            distortion: camera.distortion,
        }
    }
}

impl From<Lens> for Pinhole {
    fn from(lens: Lens) -> Self {
        Self {
            width: lens.width,
            height: lens.height,
            fx: lens.fx,
            fy: lens.fy,
            cx: lens.cx,
            cy: lens.cy,
            distortion: lens.distortion,
        }
    }
}

/// The simulated scene that a recording shows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Shown {
    pub(super) scene: String,
    pub(super) seed: u64,
}

impl Shown {
    pub(super) fn name(&self) -> anyhow::Result<Name> {
        let name = Name::from_str(&self.scene, false);
        name.map_err(|error| anyhow::anyhow!("{}: {error}", self.scene))
    }

    pub(super) fn build(&self) -> anyhow::Result<Scene> {
        Ok(Scene::generate(self.name()?, self.seed))
    }
}

/// What is to be run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Job {
    /// Name of the method: of [`super::methods::METHODS`], or of a peer.
    pub(super) method: String,
    /// The recording, in TUM layout.
    pub(super) recording: PathBuf,
    pub(super) camera: Lens,
    /// The value of a depth pixel at 1 m.
    pub(super) depth_factor: f64,
    /// Depth from farther away is not believed.
    pub(super) max_depth_m: f64,
    /// What a detector sees, if one has looked.
    pub(super) objects: Option<PathBuf>,
    /// What is shown, if it is simulated.
    pub(super) shown: Option<Shown>,
    /// Where results go.
    pub(super) out: PathBuf,
}

impl Job {
    /// Whether the recording has what the method is told by sensors that not every recording has.
    pub(super) fn suits(&self, method: &Method) -> bool {
        let has = |name| self.recording.join(positions::file(name)).is_file();
        let is_told =
            method.receiver.is_none_or(has) && (!method.takes_objects || self.objects.is_some());
        is_told
            && (method.inertial != Inertial::Missed || inertial::file(&self.recording).is_file())
    }

    /// The file with this ending that the job leaves.
    pub(super) fn file(&self, ending: &str) -> PathBuf {
        self.out.join(format!("{}.{ending}", self.method))
    }
}

/// What was measured. Times are those of tracking and of the mapping behind it; reading and decoding pictures is left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Measured {
    /// Frames of the recording.
    pub(super) frames: usize,
    /// Of these, frames with a pose.
    pub(super) tracked: usize,
    /// On the wall.
    pub(super) fps: f64,
    pub(super) p50_ms: f64,
    pub(super) p99_ms: f64,
    /// Processor time of all threads, a frame.
    pub(super) cpu_ms: f64,
    /// The most memory that was resident, in 10⁶ bytes; where the system tells.
    pub(super) peak_mb: Option<f64>,
    /// How often the pose has jumped, if the method tells.
    #[serde(default)]
    pub(super) resets: Option<u32>,
    /// How far the poses are off that were told at once, where truth is known: this file has them.
    #[serde(default)]
    pub(super) live: Option<PathBuf>,
    /// How far off each of those poses was said to be, if the method tells: this file has it.
    #[serde(default)]
    pub(super) told: Option<PathBuf>,
    /// Of simulated scenes.
    #[serde(default)]
    pub(super) hit_by_movers: Option<Vec<Hit>>,
}

impl Measured {
    pub(super) fn read(path: &Path) -> anyhow::Result<Self> {
        let text =
            fs::read_to_string(path).with_context(|| format!("it left no {}", path.display()))?;
        serde_json::from_str(&text).with_context(|| format!("cannot read {}", path.display()))
    }
}

/// Runs the job of that file in this process.
pub fn run(file: &Path) -> anyhow::Result<()> {
    let text =
        fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let job: Job =
        serde_json::from_str(&text).with_context(|| format!("cannot read {}", file.display()))?;
    let method = Method::named(&job.method)?;
    let settings = folder::Settings {
        depth_factor: job.depth_factor,
        // An excerpt may have the lists of the whole; how many frames there were is among the figures.
        missing_images: MissingImages::Skip,
        ..folder::Settings::default()
    };
    let mut source = TumFolder::open(&job.recording, job.camera.into(), settings)?;
    let mut work = Work::new(&job, method)?;
    while let Some(frame) = work.meter.outside(|| source.next_frame())? {
        work.frame(&frame)?;
    }
    work.end(&job)
}

/// What one frame took, and what came of it.
struct Line {
    at: Stamp,
    took_ms: f64,
    is_tracked: bool,
    is_keyframe: bool,
    points: usize,
    moving_share: f64,
}

struct Work {
    slam: Slam,
    objects: Option<Objects>,
    positions: Option<Positions>,
    inertial: Option<inertial::Inertial>,
    meter: Meter,
    lines: Vec<Line>,
    live: Vec<(
        Stamp,
        maps::frame::Isometry<maps::frame::World, maps::frame::Camera>,
    )>,
    /// The covariances of those.
    told: Told,
    resets: u32,
    /// Of simulated scenes, for ghosts.
    keyframes: Option<Keyframes>,
}

impl Work {
    fn new(job: &Job, method: &Method) -> anyhow::Result<Self> {
        let settings = method.settings(job.max_depth_m);
        let objects = job.objects.as_deref().filter(|_| method.takes_objects);
        let mount = job.shown.as_ref().map(Shown::build).transpose()?;
        let mount = mount.as_ref().map(body_from_uav_camera);
        let positions = method.receiver.zip(mount.as_ref()).map(|(name, mount)| {
            Positions::read(&job.recording.join(positions::file(name)), mount)
        });
        let inertial = mount
            .as_ref()
            .filter(|_| method.inertial == Inertial::Given);
        let inertial =
            inertial.map(|mount| inertial::Inertial::read(&inertial::file(&job.recording), mount));
        let keyframes = job.shown.as_ref();
        let keyframes = keyframes.map(|_| Keyframes::create(&job.file("keyframes")));
        Ok(Self {
            slam: Slam::new(job.camera.into(), settings),
            objects: objects.map(Objects::read).transpose()?,
            positions: positions.transpose()?,
            inertial: inertial.transpose()?,
            meter: Meter::start(),
            lines: Vec::new(),
            live: Vec::new(),
            told: Vec::new(),
            resets: 0,
            keyframes: keyframes.transpose()?,
        })
    }

    fn frame(&mut self, frame: &RgbdFrame) -> anyhow::Result<()> {
        let mut aid = Aid {
            objects: self.objects.as_ref().map(|objects| Seen {
                of: frame.at,
                objects: objects.at(frame.at),
            }),
            position: self.positions.as_mut().and_then(|p| p.until(frame.at)),
            ..Aid::default()
        };
        if let Some(inertial) = &mut self.inertial {
            inertial.tell(frame.at, &mut aid);
        }
        let slam = &mut self.slam;
        let (took, (tracked, settled)) = Meter::inside(|| {
            let tracked = slam.track_aided(frame, &aid);
            (tracked, slam.take_keyframes())
        });
        let tracked = tracked?;
        let is_tracked = tracked.state == State::Tracking;
        if is_tracked {
            self.live.push((frame.at, tracked.world_from_camera));
            self.told.push((frame.at, tracked.covariance));
        }
        self.resets = tracked.reset_counter;
        self.lines.push(Line {
            at: frame.at,
            took_ms: took.as_secs_f64() * 1e3,
            is_tracked,
            is_keyframe: tracked.keyframe,
            points: tracked.points,
            moving_share: tracked.moving_share,
        });
        if let Some(keyframes) = &mut self.keyframes {
            self.meter.outside(|| keyframes.add(&settled))?;
        }
        Ok(())
    }

    fn end(mut self, job: &Job) -> anyhow::Result<()> {
        let slam = &mut self.slam;
        let (_, settled) = Meter::inside(|| slam.finish());
        let (cpu, peak_mb) = (self.meter.cpu(), peak_mb());
        // Nothing below is measured.
        let trajectory = Trajectory::new(self.slam.trajectory())?;
        let write = |ending: &str, text: String| {
            let path = job.file(ending);
            fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
        };
        write("txt", tum::format(&trajectory))?;
        write("live.txt", tum::format(&Trajectory::new(self.live)?))?;
        honesty::write(&job.file("covariances.txt"), &self.told)?;
        write_lines(&job.file("csv"), &self.lines)?;
        let hit_by_movers = match (self.keyframes, &job.shown) {
            (Some(mut keyframes), Some(shown)) => {
                keyframes.add(&settled)?;
                Some(hit_by_movers(keyframes, shown, &job.recording)?)
            }
            _ => None,
        };
        let mut times: Vec<f64> = self.lines.iter().map(|line| line.took_ms).collect();
        let frames = times.len();
        let sum_ms: f64 = times.iter().sum();
        times.sort_by(f64::total_cmp);
        let measured = Measured {
            frames,
            tracked: self.lines.iter().filter(|line| line.is_tracked).count(),
            fps: 1e3 * frames as f64 / sum_ms.max(f64::MIN_POSITIVE),
            p50_ms: quantile(&times, 0.5),
            p99_ms: quantile(&times, 0.99),
            cpu_ms: cpu.as_secs_f64() * 1e3 / frames.max(1) as f64,
            peak_mb,
            resets: Some(self.resets),
            live: Some(job.file("live.txt")),
            told: Some(job.file("covariances.txt")),
            hit_by_movers,
        };
        write("json", serde_json::to_string(&measured)?)
    }
}

/// The least value that this share of all does not exceed; 0 of none.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
}

fn write_lines(path: &Path, lines: &[Line]) -> anyhow::Result<()> {
    let write = || -> std::io::Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        writeln!(file, "time_s,took_ms,tracked,keyframe,points,moving_share")?;
        for line in lines {
            let [tracked, keyframe] = [line.is_tracked, line.is_keyframe].map(u8::from);
            let Line {
                at,
                took_ms,
                points,
                moving_share,
                ..
            } = line;
            writeln!(
                file,
                "{at},{took_ms:.3},{tracked},{keyframe},{points},{moving_share:.4}"
            )?;
        }
        file.flush()
    };
    write().with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantile_is_a_value_that_occurred() {
        let values: Vec<f64> = (1..=200).map(f64::from).collect();
        for (share, expected) in [(0.0, 1.0), (0.5, 100.0), (0.99, 198.0), (1.0, 200.0)] {
            assert!(
                (quantile(&values, share) - expected).abs() < 1e-12,
                "{share}"
            );
        }
        assert!(quantile(&[], 0.5).abs() < 1e-12, "of nothing");
    }

    #[test]
    fn a_job_of_an_unknown_method_is_refused_by_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let job = Job {
            method: "magic".to_owned(),
            recording: folder.path().to_owned(),
            camera: sitl::depth_camera::d455().into(),
            depth_factor: 1000.0,
            max_depth_m: 6.0,
            objects: None,
            shown: None,
            out: folder.path().to_owned(),
        };
        let file = folder.path().join("job.json");
        fs::write(&file, serde_json::to_string(&job).expect("JSON")).expect("written");
        let error = run(&file).expect_err("no such method");
        assert!(error.to_string().contains("magic"), "{error}");
    }
}
