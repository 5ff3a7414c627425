//! `evaluate slam`: how well, how fast and in how much memory the SLAM finds its way, and what ghosts its map keeps.
//!
//! Every recording with a depth camera in the data folder, and flights over simulated streets and through a simulated room among
//! people and traffic ([`flight`]), by each method ([`methods`]). Each run is a process of its own ([`job`]), one after the
//! other, so that its time, its processor time and its memory are its own.
//!
//! - `ate_rmse_m`: root mean square of the distances to the true positions after the best rigid alignment, over all frames with
//!   a pose, as the TUM benchmark's tool has it (`ate_evo_m`: as `evo` does; `ate_live_m`: of the poses that were told at once,
//!   before later frames improved them). Quote `tracked_share` beside it.
//! - `rpe_trans_m`, `rpe_rot_deg`: the relative error from frame to frame as `evo` has it, and `rpe_1s_…` over a second as
//!   the TUM benchmark's tool has it. Bonn's truth is of a marker body beside the camera, so that its relative error holds the
//!   lever between them.
//! - `drift_percent`, `end_percent`: see [`maps::trajectory::drift`], over stretches of 100 m, of paths of at least 150 m.
//! - `nees`, `nees_likely_share`: whether poses are as far off as they are said to be, of simulated cases: see [`honesty`].
//! - `fps`, `p50_ms`, `p99_ms` on the wall; `cpu_ms` of all threads, a frame; `peak_mb`: resident memory. Reading and
//!   decoding pictures is left out of the times.
//! - `ghost_voxels`, `ghost_share`, and `ghost_people_…` of people alone: see [`ghosts`]; the shares are of what
//!   `no-dynamics` leaves.

mod columns;
mod film;
mod flight;
mod ghosts;
mod honesty;
mod inertial;
mod job;
mod judge;
mod meter;
mod methods;
mod objects;
mod peer;
mod positions;
mod recordings;
mod suite;

use std::path::{Path, PathBuf};

use sitl::scene::Name;

use super::{Figures, Outcome, Request};
use job::Shown;
use methods::{METHODS, Method};
use peer::Peer;
use recordings::LeftOut;
use suite::{Case, Found, Kind, Suite};

pub use job::run as run_job;

/// The first of the seeds that nothing is tuned on.
const SEED: u64 = 1100;
/// Where recordings are if nobody says where.
const DATA: &str = "../shared/data";
/// The paper's streets, and the room.
const SCENES: [Name; 5] = [
    Name::ResidentialAlley,
    Name::UrbanArterial,
    Name::IndustrialPark,
    Name::SuburbanRoad,
    Name::Room,
];
/// What can be asked of this suite alone.
#[derive(Clone, Debug, PartialEq, Eq, clap::Args)]
pub struct Options {
    /// slam: also run ORB-SLAM3, installed into this folder if it is not there
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "../orbslam3")]
    pub peer: Option<PathBuf>,
    /// slam: folder with RECORDING.txt for each recording a detector has seen: `stamp left top right bottom score class`
    #[arg(long, value_name = "DIR")]
    pub objects: Option<PathBuf>,
    /// slam: only cases whose name holds one of these words
    #[arg(long, value_name = "WORD", value_delimiter = ',')]
    pub cases: Vec<String>,
    /// slam: only these methods
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    pub methods: Vec<String>,
    /// slam: how many seeds of each simulated scene
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seeds: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            peer: None,
            objects: None,
            cases: Vec::new(),
            methods: Vec::new(),
            seeds: 1,
        }
    }
}

/// Measures; some 20 minutes.
pub(super) fn run(request: &mut Request<'_>) -> anyhow::Result<Outcome> {
    let options = request.slam;
    let methods = chosen(&options.methods)?;
    let mut found = Found::default();
    let cases = cases(request, &mut found.notes)?;
    anyhow::ensure!(!cases.is_empty(), "there is no case to run");
    let peer = options.peer.as_deref().and_then(|environment| {
        (request.say)("preparing ORB-SLAM3");
        let folders = cases.iter().filter_map(|case| match &case.kind {
            Kind::Recorded(recording) => Some(recording.folder.as_path()),
            Kind::Simulated(_) => None,
        });
        let peer = Peer::prepare(environment, &folders.collect::<Vec<_>>());
        let peer = peer.inspect_err(|error| {
            found
                .notes
                .push(format!("ORB-SLAM3 was not measured: {error:#}"));
        });
        peer.ok()
    });
    for case in &cases {
        let mut suite = Suite {
            methods: &methods,
            peer: peer.as_ref(),
            out: request.out,
            objects: options.objects.as_deref(),
            say: request.say,
        };
        // One that fails does not lose the others.
        if let Err(error) = suite.measure(case, &mut found) {
            (suite.say)(&format!("{}: {error:#}", case.name));
            found
                .notes
                .push(format!("{} was not measured: {error:#}", case.name));
        }
    }
    found.into_outcome()
}

impl Found {
    fn into_outcome(self) -> anyhow::Result<Outcome> {
        anyhow::ensure!(
            !self.rows.is_empty(),
            "nothing was measured: {}",
            self.notes.join("; ")
        );
        let mut figures = Figures::default();
        for row in &self.rows {
            for (metric, value) in &row.figures {
                figures.set(&[&row.case, &row.method, metric], *value)?;
            }
        }
        let notes = self.notes.join("\n");
        Ok(Outcome {
            figures,
            text: format!("{}\n{notes}", judge::table(&self.rows)),
        })
    }
}

fn chosen(names: &[String]) -> anyhow::Result<Vec<&'static Method>> {
    if names.is_empty() {
        return Ok(METHODS.iter().collect());
    }
    names.iter().map(|name| Method::named(name)).collect()
}

fn cases(request: &Request<'_>, notes: &mut Vec<String>) -> anyhow::Result<Vec<Case>> {
    let data = request
        .data
        .map_or_else(|| PathBuf::from(DATA), Path::to_owned);
    let mut cases = Vec::new();
    if request.data.is_some() || data.is_dir() {
        let (found, left_out) = recordings::find(&data)?;
        cases.extend(found.into_iter().map(|recording| Case {
            name: recording.name.clone(),
            kind: Kind::Recorded(recording),
        }));
        notes.extend(
            left_out
                .into_iter()
                .map(|LeftOut { name, why }| format!("{name} is left out: {why}")),
        );
    } else {
        notes.push(format!(
            "no recordings: there is no {}, name their folder with --data",
            data.display()
        ));
    }
    let first = request.seed.unwrap_or(SEED);
    for scene in SCENES {
        for seed in first..first.saturating_add(request.slam.seeds) {
            cases.push(Case {
                name: format!("sitl-{scene}-{seed}"),
                kind: Kind::Simulated(Shown {
                    scene: scene.to_string(),
                    seed,
                }),
            });
        }
    }
    let words = &request.slam.cases;
    cases.retain(|case| words.is_empty() || words.iter().any(|word| case.name.contains(word)));
    Ok(cases)
}

#[cfg(test)]
mod tests;
