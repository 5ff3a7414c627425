//! Automotive radars: objects with range, azimuth and range rate, seen the better the nearer and larger they are, among
//! clutter.
//!
//! By the radar equation, an object of cross section `σ` at range `R` returns with a signal-to-noise ratio of
//!
//! ```text
//! SNR = SNR₀ · (σ/σ₀) · (R₀/R)⁴           SNR₀ = 13 dB
//! P_D = P_FA^(1/(1 + SNR))                (Swerling 1: the object fluctuates from scan to scan)
//! ṙ = v·p/|p|                             negative when approaching
//! ```
//!
//! so that a car (σ₀ = 10 dBsm) is seen in half of the scans at `R₀`. Clutter is what the ground and walls return: as
//! many as a Poisson process brings, evenly over ranges and azimuths, at the range rate of things that stand still.
//! Objects do not hide one another, and two that are close do not merge: the caller leaves out what is hidden.
//!
//! An object with a number that is not finite is not seen.
//!
//! - M. A. Richards, *Fundamentals of Radar Signal Processing*, 2nd ed., McGraw-Hill, 2014, ch. 2 (radar equation),
//!   ch. 6 (Swerling 1).
//! - Continental, *ARS408-21* data sheet: ranges, fields of view and accuracies, as at the preset.

use std::time::Duration;

use maps::frame::{Point, Vector};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::process::happens;
use crate::vehicle::gnss::gaussian;

/// Signal-to-noise ratio of an object of the reference cross section at the reference range.
const REFERENCE_SNR_DB: f64 = 13.0;

/// The radar at its antenna: x forward along its axis, y left, z up, right-handed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RadarFrame;

/// What a beam can do at one azimuth to either side. Between two of these it changes evenly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamEdge {
    /// Off the axis.
    pub azimuth_rad: f64,
    /// Nothing beyond this is reported there.
    pub farthest_m: f64,
    /// Standard deviation of azimuths there.
    pub azimuth_noise_rad: f64,
}

/// One of the beams that a scan is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// From its axis to its border, by growing azimuth.
    pub edges: [BeamEdge; 3],
    /// Half of its height.
    pub elevation_rad: f64,
    /// Nothing nearer is reported.
    pub nearest_m: f64,
    /// Where a car is seen in half of the scans.
    pub reference_range_m: f64,
    /// Standard deviation of ranges.
    pub range_noise_m: f64,
    /// False objects in each scan, on average.
    pub clutter: f64,
}

/// A radar.
#[derive(Clone, Debug, PartialEq)]
pub struct RadarModel {
    /// Its beams; an object in several is reported by the first.
    pub beams: Vec<Beam>,
    /// The cross section that the reference ranges are for, in decibels over a square metre.
    pub reference_rcs_dbsm: f64,
    /// Probability of a false alarm in a cell, which sets the threshold.
    pub false_alarm: f64,
    /// Standard deviation of range rates.
    pub range_rate_noise_mps: f64,
    /// Least and largest range rate that is reported.
    pub range_rate_mps: [f64; 2],
    /// Standard deviation of reported cross sections.
    pub rcs_noise_db: f64,
    /// From scan to scan.
    pub period: Duration,
}

impl RadarModel {
    /// Continental ARS408-21: far 0.2 to 250 m within 9°, ±0.4 m, ±0.1°; near 0.2 to 70 m within 45° and 20 m at 60°,
    /// ±0.1 m, ±0.3° on the axis, ±1° at 45°, ±5° at 60°; 14° and 20° high; -400 to 200 km/h, ±0.1 km/h; every 72 ms.
    /// Its accuracies are taken as standard deviations, which is on the safe side. Reference ranges and clutter are
    /// ours.
    pub fn ars408() -> Self {
        Self {
            beams: vec![
                Beam {
                    edges: [
                        edge(0.0, 250.0, 0.1),
                        edge(4.0, 250.0, 0.1),
                        edge(9.0, 150.0, 0.1),
                    ],
                    elevation_rad: 7_f64.to_radians(),
                    nearest_m: 0.2,
                    reference_range_m: 200.0,
                    range_noise_m: 0.4,
                    clutter: 0.5,
                },
                Beam {
                    edges: [
                        edge(0.0, 70.0, 0.3),
                        edge(45.0, 70.0, 1.0),
                        edge(60.0, 20.0, 5.0),
                    ],
                    elevation_rad: 10_f64.to_radians(),
                    nearest_m: 0.2,
                    reference_range_m: 80.0,
                    range_noise_m: 0.1,
                    clutter: 1.5,
                },
            ],
            reference_rcs_dbsm: 10.0,
            false_alarm: 1e-6,
            range_rate_noise_mps: 0.1 / 3.6,
            range_rate_mps: [-400.0 / 3.6, 200.0 / 3.6],
            rcs_noise_db: 3.0,
            period: Duration::from_millis(72),
        }
    }
}

const fn edge(azimuth_deg: f64, farthest_m: f64, azimuth_noise_deg: f64) -> BeamEdge {
    BeamEdge {
        azimuth_rad: azimuth_deg.to_radians(),
        farthest_m,
        azimuth_noise_rad: azimuth_noise_deg.to_radians(),
    }
}

/// Something that a radar may see: the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Where it is.
    pub position: Point<RadarFrame>,
    /// Its velocity relative to the radar, in m/s.
    pub velocity: Vector<RadarFrame>,
    /// Its cross section in decibels over a square metre: a car has 10, a person -5.
    pub rcs_dbsm: f64,
}

/// What a radar reports. It does not measure height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Along the line of sight.
    pub range_m: f64,
    /// Counter-clockwise from the axis.
    pub azimuth_rad: f64,
    /// Negative when approaching.
    pub range_rate_mps: f64,
    /// Its cross section in decibels over a square metre.
    pub rcs_dbsm: f64,
    /// Whose return it is.
    pub source: Source,
}

/// Whose return a detection is: the truth, for judging results and nothing else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// That of the target with this index.
    Target(usize),
    /// Nobody's.
    Clutter,
}

/// A radar.
#[derive(Clone, Debug)]
pub struct Radar {
    model: RadarModel,
    random: Pcg64,
}

impl Radar {
    /// One of that model.
    pub fn new(model: RadarModel, seed: u64) -> Self {
        Self {
            model,
            random: Pcg64::seed_from_u64(seed),
        }
    }

    /// One scan: the targets that are seen, in their order, and clutter. The radar itself moves with `own_velocity`
    /// (m/s), which what stands still seems to do backwards.
    pub fn scan(&mut self, targets: &[Target], own_velocity: Vector<RadarFrame>) -> Vec<Detection> {
        let mut seen = Vec::new();
        for (index, target) in targets.iter().enumerate() {
            seen.extend(self.look(target, Source::Target(index)));
        }
        for index in 0..self.model.beams.len() {
            let beam = self.model.beams[index];
            for _ in 0..poisson(beam.clutter, &mut self.random) {
                seen.extend(self.clutter(&beam, own_velocity));
            }
        }
        seen
    }

    /// The return of a target, if there is one. Draws the same numbers either way.
    fn look(&mut self, target: &Target, source: Source) -> Option<Detection> {
        let model = &self.model;
        let sight = Sight::of(target);
        let view = model
            .beams
            .iter()
            .find_map(|b| Some((b, b.edge_at(&sight)?)));
        let chance = view.map_or(0.0, |(beam, _)| {
            model.detection(beam, sight.range_m, target)
        });
        let is_seen = happens(chance, &mut self.random);
        let noise = [(); 4].map(|()| gaussian(&mut self.random));
        let (beam, edge) = view?;
        let [least, largest] = model.range_rate_mps;
        let reported = (least..=largest).contains(&sight.range_rate_mps);
        (is_seen && reported).then(|| Detection {
            range_m: (sight.range_m + beam.range_noise_m * noise[0]).max(0.0),
            azimuth_rad: sight.azimuth_rad + edge.azimuth_noise_rad * noise[1],
            range_rate_mps: sight.range_rate_mps + model.range_rate_noise_mps * noise[2],
            rcs_dbsm: target.rcs_dbsm + model.rcs_noise_db * noise[3],
            source,
        })
    }

    /// A return of the ground or a wall, somewhere in a beam; none where the beam does not reach.
    fn clutter(&mut self, beam: &Beam, own_velocity: Vector<RadarFrame>) -> Option<Detection> {
        let [across, along] = [(); 2].map(|()| self.random.random::<f64>());
        let [rate, rcs] = [(); 2].map(|()| gaussian(&mut self.random));
        let azimuth_rad = (2.0 * across - 1.0) * beam.edges[2].azimuth_rad;
        let range_m = beam.nearest_m + along * (beam.edges[0].farthest_m - beam.nearest_m);
        let (sin, cos) = azimuth_rad.sin_cos();
        let still = -(own_velocity.raw.x * cos + own_velocity.raw.y * sin);
        let still = if still.is_finite() { still } else { 0.0 };
        let reaches = beam.between(azimuth_rad.abs())?.farthest_m >= range_m;
        reaches.then(|| Detection {
            range_m,
            azimuth_rad,
            range_rate_mps: still + self.model.range_rate_noise_mps * rate,
            // What is just above the threshold: smaller than a car, by as much as it likes.
            rcs_dbsm: self.model.reference_rcs_dbsm - 10.0 - 5.0 * rcs.abs(),
            source: Source::Clutter,
        })
    }
}

impl RadarModel {
    /// The probability that a beam sees a target at that range.
    fn detection(&self, beam: &Beam, range_m: f64, target: &Target) -> f64 {
        let nearer_db = 40.0 * (beam.reference_range_m / range_m).log10();
        let snr_db = REFERENCE_SNR_DB + target.rcs_dbsm - self.reference_rcs_dbsm + nearer_db;
        let snr = 10_f64.powf(snr_db / 10.0);
        self.false_alarm.powf(1.0 / (1.0 + snr))
    }
}

/// Where a target is as a radar sees it.
struct Sight {
    range_m: f64,
    azimuth_rad: f64,
    elevation_rad: f64,
    range_rate_mps: f64,
}

impl Sight {
    fn of(target: &Target) -> Self {
        let p = target.position.raw.coords;
        let range_m = p.norm();
        Self {
            range_m,
            azimuth_rad: p.y.atan2(p.x),
            elevation_rad: p.z.atan2(p.x.hypot(p.y)),
            range_rate_mps: target.velocity.raw.dot(&p) / range_m,
        }
    }
}

impl Beam {
    /// What it can do in that direction, if the target is within its reach.
    fn edge_at(&self, sight: &Sight) -> Option<BeamEdge> {
        let edge = self.between(sight.azimuth_rad.abs())?;
        // Comparisons, all of which NaN fails.
        let is_high = sight.elevation_rad.abs() <= self.elevation_rad;
        let is_far = sight.range_m >= self.nearest_m && sight.range_m <= edge.farthest_m;
        (is_high && is_far).then_some(edge)
    }

    /// What it can do at that azimuth to either side, if it reaches there.
    fn between(&self, azimuth_rad: f64) -> Option<BeamEdge> {
        let pair = self
            .edges
            .windows(2)
            .find(|pair| azimuth_rad <= pair[1].azimuth_rad)?;
        let width = pair[1].azimuth_rad - pair[0].azimuth_rad;
        let share = ((azimuth_rad - pair[0].azimuth_rad) / width).clamp(0.0, 1.0);
        let mix = |of: fn(&BeamEdge) -> f64| of(&pair[0]) + (of(&pair[1]) - of(&pair[0])) * share;
        Some(BeamEdge {
            azimuth_rad,
            farthest_m: mix(|e| e.farthest_m),
            azimuth_noise_rad: mix(|e| e.azimuth_noise_rad),
        })
    }
}

/// How often something happens that happens `mean` times on average (Knuth, *The Art of Computer Programming* 2,
/// §3.4.1).
fn poisson(mean: f64, random: &mut Pcg64) -> u32 {
    let end = (-mean).exp();
    let mut product = random.random::<f64>();
    let mut count = 0;
    while product > end {
        product *= random.random::<f64>();
        count += 1;
    }
    count
}

#[cfg(test)]
mod tests;
