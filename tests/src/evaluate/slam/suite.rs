//! One case after the other, and of each one method after the other, each in a process of its own.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::Context as _;
use maps::frame::Camera;
use maps::trajectory::{Trajectory, tum};
use sitl::depth_camera::d455;
use sitl::scene::Name;

use super::super::make_folder;
use super::film;
use super::ghosts::{self, Hit};
use super::honesty;
use super::job::{Job, Lens, Measured, Shown};
use super::judge::{self, Row};
use super::methods::{Method, STATIC};
use super::peer::{self, Peer};
use super::recordings::{self, Layout, Recording};

/// Depth from farther away is not believed: what a depth camera is good for indoors, and in daylight (as the companion's
/// configuration for streets has it).
const INDOORS_M: f64 = 6.0;
const OUTDOORS_M: f64 = 10.0;

/// Something to run the methods on.
pub(super) struct Case {
    pub(super) name: String,
    pub(super) kind: Kind,
}

pub(super) enum Kind {
    Recorded(Recording),
    Simulated(Shown),
}

/// A case that can be run.
struct Ready {
    /// As every job of it is, but for the method.
    job: Job,
    truth: Option<Trajectory<Camera>>,
    /// Holds the pictures of a simulated one; removed when it goes.
    _film: tempfile::TempDir,
}

/// What has come out so far.
#[derive(Default)]
pub(super) struct Found {
    pub(super) rows: Vec<Row>,
    pub(super) notes: Vec<String>,
}

/// What every case is measured with.
pub(super) struct Suite<'a> {
    pub(super) methods: &'a [&'static Method],
    pub(super) peer: Option<&'a Peer>,
    pub(super) out: &'a Path,
    pub(super) objects: Option<&'a Path>,
    pub(super) say: &'a mut dyn FnMut(&str),
}

impl Suite<'_> {
    /// Runs every method on a case. Those that fail are noted.
    pub(super) fn measure(&mut self, case: &Case, found: &mut Found) -> anyhow::Result<()> {
        let ready = self.prepare(case)?;
        if ready.truth.is_none() {
            found
                .notes
                .push(format!("{}: {}", case.name, why_without_truth(case)));
        }
        let first = found.rows.len();
        let mut hit: Vec<(usize, Vec<Hit>)> = Vec::new();
        let names = self.methods.iter().filter(|method| ready.job.suits(method));
        let mut names: Vec<&str> = names.map(|method| method.name).collect();
        names.extend(self.peer.map(|_| peer::NAME));
        for name in names {
            match self.attempt(case, &ready, name) {
                Ok((row, hits)) => {
                    hit.extend(hits.map(|hits| (found.rows.len(), hits)));
                    found.rows.push(row);
                }
                Err(error) => {
                    (self.say)(&format!("{} {name}: {error:#}", case.name));
                    found
                        .notes
                        .push(format!("{} {name} was not measured: {error:#}", case.name));
                }
            }
        }
        if let Kind::Simulated(shown) = &case.kind {
            let hits: Vec<&[Hit]> = hit.iter().map(|(_, hits)| hits.as_slice()).collect();
            for ((row, _), ghosts) in hit.iter().zip(ghosts::count(shown, &hits)?) {
                found.rows[*row].figures.extend([
                    ("ghost_voxels", ghosts.all as f64),
                    ("ghost_people_voxels", ghosts.of_people as f64),
                ]);
            }
            share_ghosts(&mut found.rows[first..]);
        }
        Ok(())
    }

    /// Makes the case's folder and what its jobs need.
    fn prepare(&mut self, case: &Case) -> anyhow::Result<Ready> {
        let out = self.out.join("slam").join(&case.name);
        make_folder(&out)?;
        let film = tempfile::Builder::new().prefix("film-").tempdir_in(&out)?;
        let mut job = Job {
            method: String::new(),
            recording: film.path().to_owned(),
            camera: d455().into(),
            depth_factor: 1000.0,
            max_depth_m: INDOORS_M,
            objects: None,
            shown: None,
            out: out.clone(),
        };
        let truth = match &case.kind {
            Kind::Recorded(recording) => {
                let truth = match &recording.layout {
                    Layout::Tum(camera) => {
                        job.recording.clone_from(&recording.folder);
                        (job.camera, job.depth_factor) = (Lens::from(*camera), 5000.0);
                        recordings::truth(&recording.folder)?
                    }
                    Layout::SevenScenes => {
                        let camera = recordings::list_seven_scenes(&recording.folder, film.path())?;
                        job.camera = camera.into();
                        None
                    }
                };
                let objects = self
                    .objects
                    .map(|folder| folder.join(format!("{}.txt", case.name)));
                job.objects = objects.filter(|path| path.is_file());
                truth
            }
            Kind::Simulated(shown) => {
                let say = &mut *self.say;
                let truth = film::film(shown, film.path(), &mut |text| {
                    say(&format!("{}: {text}", case.name));
                })?;
                if shown.name()? != Name::Room {
                    job.max_depth_m = OUTDOORS_M;
                }
                job.depth_factor = film::DEPTH_FACTOR;
                job.objects = Some(film.path().join("objects.txt"));
                job.shown = Some(shown.clone());
                Some(truth)
            }
        };
        if let Some(truth) = &truth {
            let path = out.join("truth.txt");
            fs::write(&path, tum::format(truth))
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(Ready {
            job,
            truth,
            _film: film,
        })
    }

    /// Runs one method, and judges what it leaves.
    fn attempt(
        &mut self,
        case: &Case,
        ready: &Ready,
        method: &str,
    ) -> anyhow::Result<(Row, Option<Vec<Hit>>)> {
        let job = Job {
            method: method.to_owned(),
            ..ready.job.clone()
        };
        // So that no result of an earlier run is taken for this one's.
        let _absent = fs::remove_file(job.file("json"));
        let file = job.file("job.json");
        fs::write(&file, serde_json::to_string_pretty(&job)?)
            .with_context(|| format!("cannot write {}", file.display()))?;
        (self.say)(&format!("{} {method}", case.name));
        match self.peer {
            Some(peer) if method == peer::NAME => peer.measure(&file)?,
            _ => run_apart(&file)?,
        }
        let measured = Measured::read(&job.file("json"))?;
        let read = |path: &Path| -> anyhow::Result<Trajectory<Camera>> {
            let text = fs::read_to_string(path)
                .with_context(|| format!("it left no {}", path.display()))?;
            tum::parse(&text).with_context(|| format!("cannot read {}", path.display()))
        };
        let mut figures = judge::cost(&measured);
        if let Some(truth) = &ready.truth {
            figures.extend(judge::accuracy(truth, &read(&job.file("txt"))?));
            if let Some(live) = &measured.live {
                let live = read(live)?;
                // Of recordings, the truth is not known better than the pose, or is of a body beside the camera.
                if let (Some(told), Some(_)) = (&measured.told, &job.shown) {
                    figures.extend(honesty::figures(truth, &live, &honesty::read(told)?));
                }
                let live = judge::accuracy(truth, &live);
                let ate = live.into_iter().find(|(key, _)| *key == "ate_rmse_m");
                figures.extend(ate.map(|(_, value)| ("ate_live_m", value)));
            }
        }
        let row = Row {
            case: case.name.clone(),
            method: method.to_owned(),
            figures,
        };
        Ok((row, measured.hit_by_movers))
    }
}

fn why_without_truth(case: &Case) -> &'static str {
    match &case.kind {
        Kind::Recorded(Recording {
            layout: Layout::SevenScenes,
            ..
        }) => "no ATE: its poses are KinectFusion's, not motion capture, and of every 8th frame",
        Kind::Recorded(_) | Kind::Simulated(_) => "no ATE: it has no groundtruth.txt",
    }
}

/// Of what the static method leaves.
pub(super) fn share_ghosts(rows: &mut [Row]) {
    for (voxels, share) in [
        ("ghost_voxels", "ghost_share"),
        ("ghost_people_voxels", "ghost_people_share"),
    ] {
        let of = rows.iter().find(|row| row.method == STATIC);
        let of = of.and_then(|row| row.get(voxels));
        let Some(of) = of.filter(|count| *count > 0.0) else {
            continue;
        };
        for row in &mut *rows {
            let part = row.get(voxels).map(|count| count / of);
            row.figures.extend(part.map(|part| (share, part)));
        }
    }
}

/// Runs a job in a process of its own, which is this program again.
fn run_apart(job: &Path) -> anyhow::Result<()> {
    let program = std::env::current_exe().context("cannot find this program")?;
    let output = Command::new(&program)
        .args(["slam", "--out"])
        .arg(job.parent().unwrap_or(Path::new(".")))
        .arg("--slam-job")
        .arg(job)
        // What it says when it fails is the error, not where in our code it came from.
        .env("RUST_BACKTRACE", "0")
        .output()
        .with_context(|| format!("cannot run {}", program.display()))?;
    anyhow::ensure!(
        output.status.success(),
        "it failed with {}: {}",
        output.status,
        tail(&output.stderr)
    );
    Ok(())
}

/// The last lines that a program said.
pub(super) fn tail(said: &[u8]) -> String {
    let text = String::from_utf8_lossy(said);
    let lines: Vec<&str> = text
        .lines()
        .filter(|line| !line.trim().is_empty())
        .collect();
    lines[lines.len().saturating_sub(3)..].join(" | ")
}
