//! What the simulated world is like, against what it is to be like.
//!
//! For each street, over test seeds and moments of a drive: how many road users the ground vehicle's cameras could see
//! (`objects`, a frame), and which share of them other things hide (`occlusion`), beside the paper's Table 7; the same for
//! the drone's camera (`uav_occlusion`); and the light: the mean level of the drone's picture (`brightness`, 0 to 1) and the
//! share of the ground vehicle's front picture that is blown out or black (`clipped`).
//!
//! Then the noise models: parameters recovered from what sensors report, beside those configured ([`sensors`]).
//!
//! A road user counts if it is within 40 m and would cover 100 pixels of one camera if nothing else were there.

mod sensors;

use ::sitl::depth_camera::d455;
use ::sitl::platform;
use ::sitl::render::{Moment, Picture, Stage};
use ::sitl::scene::{Instance, Name, Scene};
use ::sitl::truth::{boxes, sight};
use maps::time::Stamp;
use rayon::prelude::*;

use super::{Figures, Outcome, Request, Table};

/// The first test seed.
const SEED: u64 = 1100;
const SEEDS: u64 = 5;
/// Moments of each drive, and how far they are apart.
const MOMENTS: u64 = 10;
const APART_NANOS: u64 = 3_000_000_000;
const REACH_M: f64 = 40.0;
const LEAST_PIXELS: u32 = 100;

/// What the paper's Table 7 says: the share hidden, and the light.
fn paper(name: Name) -> Option<(f64, &'static str)> {
    match name {
        Name::ResidentialAlley => Some((0.40, "normal")),
        Name::UrbanArterial => Some((0.32, "normal")),
        Name::IndustrialPark => Some((0.25, "complex")),
        Name::SuburbanRoad => Some((0.17, "backlit, low")),
        Name::UnderBridge | Name::Room => None,
    }
}

/// Sums over frames.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    frames: f64,
    objects: f64,
    hidden: f64,
    uav_objects: f64,
    uav_hidden: f64,
    brightness: f64,
    clipped: f64,
}

/// Measures every street.
pub(super) fn run(request: &mut Request<'_>) -> anyhow::Result<Outcome> {
    let first = request.seed.unwrap_or(SEED);
    let mut figures = Figures::default();
    let mut rows = Vec::new();
    for name in Name::STREETS {
        let seeds: Vec<u64> = (first..first + SEEDS).collect();
        let tallies: Vec<Tally> = seeds.par_iter().map(|seed| drive(name, *seed)).collect();
        let sum = tallies.into_iter().fold(Tally::default(), Tally::plus);
        let case = name.to_string();
        let measured = [
            ("objects", sum.objects / sum.frames),
            ("occlusion", sum.hidden / sum.objects.max(1.0)),
            ("uav_occlusion", sum.uav_hidden / sum.uav_objects.max(1.0)),
            ("brightness", sum.brightness / sum.frames),
            ("clipped", sum.clipped / sum.frames),
        ];
        for (metric, value) in measured {
            figures.set(&[&case, metric], value)?;
        }
        let (wanted, light) = paper(name).map_or((String::new(), ""), |(occlusion, light)| {
            (format!("{occlusion:.2}"), light)
        });
        let [objects, occlusion, uav, brightness, clipped] =
            measured.map(|(_, value)| format!("{value:.2}"));
        (request.say)(&format!("{case} done"));
        rows.push(vec![
            case,
            objects,
            occlusion,
            wanted,
            uav,
            brightness,
            clipped,
            light.to_owned(),
        ]);
    }
    let header = [
        "scene",
        "objects",
        "occlusion",
        "paper",
        "uav occlusion",
        "brightness",
        "clipped",
        "light of the paper",
    ];
    let streets = Table {
        title: format!("Streets, {SEEDS} seeds from {first}, {MOMENTS} moments each"),
        header: header.map(str::to_owned).into(),
        rows,
    };
    let errors = sensors::all(first);
    for found in &errors {
        figures.set(&["sensors", &found.name], found.measured)?;
    }
    Ok(Outcome {
        figures,
        text: format!("{streets}\n{}", table_of(&errors)),
    })
}

/// What sensors do beside what they are set to.
fn table_of(errors: &[sensors::Recovered]) -> Table {
    let row = |found: &sensors::Recovered| {
        let ratio = found.measured / found.configured;
        vec![
            found.name.clone(),
            format!("{:.3e}", found.measured),
            format!("{:.3e}", found.configured),
            format!("{ratio:.3}"),
        ]
    };
    Table {
        title: "Sensors: what comes out beside what was put in".to_owned(),
        header: ["parameter", "recovered", "configured", "ratio"]
            .map(str::to_owned)
            .into(),
        rows: errors.iter().map(row).collect(),
    }
}

fn drive(name: Name, seed: u64) -> Tally {
    let scene = Scene::generate(name, seed);
    let stage = Stage::new(&scene);
    (1..=MOMENTS)
        .map(|moment| look(&stage.at(Stamp::from_nanos(moment * APART_NANOS)), seed))
        .fold(Tally::default(), Tally::plus)
}

fn look(moment: &Moment<'_>, seed: u64) -> Tally {
    let scene = moment.scene();
    let body = platform::ugv(scene, moment.at());
    let near: Vec<Instance> = boxes(scene, moment.at())
        .iter()
        .filter(|user| (user.thing.centre() - body.translation().raw).norm() < REACH_M)
        .map(|user| user.thing.instance)
        .collect();
    let views = platform::ugv_views(moment);
    let clipped = share(&views[0].1, |level| !(5.0..250.0).contains(&level));
    let by_ugv = sight(moment, &platform::ugv_lens(), &views);
    let camera = d455();
    let pose = platform::uav_camera(scene, moment.at(), seed);
    let picture = moment.picture(&camera, pose);
    let brightness = mean_level(&picture) / 255.0;
    let by_uav = sight(moment, &camera, &[(pose, picture)]);
    let [(objects, hidden), (uav_objects, uav_hidden)] = [&by_ugv, &by_uav].map(|seen| {
        let counted = near.iter().filter_map(|instance| seen.get(instance));
        counted
            .filter(|sight| sight.alone >= LEAST_PIXELS)
            .fold((0.0, 0.0), |(count, sum), sight| {
                (count + 1.0, sum + sight.occlusion())
            })
    });
    Tally {
        frames: 1.0,
        objects,
        hidden,
        uav_objects,
        uav_hidden,
        brightness,
        clipped,
    }
}

fn level(pixel: [u8; 3]) -> f64 {
    pixel.iter().map(|c| f64::from(*c)).sum::<f64>() / 3.0
}

fn mean_level(picture: &Picture) -> f64 {
    picture.rgb.iter().copied().map(level).sum::<f64>() / picture.rgb.len() as f64
}

fn share(picture: &Picture, counts: impl Fn(f64) -> bool) -> f64 {
    let counted = picture.rgb.iter().filter(|pixel| counts(level(**pixel)));
    counted.count() as f64 / picture.rgb.len() as f64
}

impl Tally {
    fn plus(self, other: Self) -> Self {
        Self {
            frames: self.frames + other.frames,
            objects: self.objects + other.objects,
            hidden: self.hidden + other.hidden,
            uav_objects: self.uav_objects + other.uav_objects,
            uav_hidden: self.uav_hidden + other.uav_hidden,
            brightness: self.brightness + other.brightness,
            clipped: self.clipped + other.clipped,
        }
    }
}
