//! A spinning `LiDAR`: what its beams meet while it turns and the vehicle drives on.
//!
//! Each column has a time and a pose of its own, so that a sweep is sheared as a real one is. What moves is where it is at
//! that time, to within [`SLICES`] steps a turn. A return needs enough light: with the reflectivity `ρ` of the surface at
//! 905 nm, the angle of incidence `α` and clear air,
//!
//! ```text
//! P ∝ ρ·cos α / r²         lost with the probability  1 / (1 + (P/P_50)²)
//! ```
//!
//! where `P_50` is the light of which half the returns are seen: a surface of 10 % reflectivity at 80 m, as the data sheet
//! of the RS-LiDAR-32 promises. Ranges have white noise of 2 cm (data sheet: ±3 cm typical), and 1 of 1000 returns goes
//! missing for no reason. Intensity is calibrated: `255·ρ·cos α`.
//!
//! - `RoboSense`, *RS-LiDAR-32 user manual*: 32 beams from -25° to 15°, dense in the middle; 10 Hz; 0.4 to 200 m.
//! - A. Wallace et al., *Full waveform LiDAR for adverse weather conditions*, IEEE TVT 69, 2020, Eq. (1): the radar equation.

use maps::frame::{Body, Isometry, World};
use maps::time::Stamp;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use crate::noise::{at_cell, mix, normal, unit};
use crate::rays::{Hit, Rays};
use crate::scene::Instance;

/// In how many steps a turn things move.
pub const SLICES: usize = 16;
/// The beams' elevations in degrees, from the lowest.
const BEAMS_DEG: [f64; 32] = [
    -25.0, -14.638, -10.281, -7.91, -6.407, -5.407, -4.667, -4.0, -3.667, -3.333, -3.0, -2.667,
    -2.333, -2.0, -1.667, -1.333, -1.0, -0.667, -0.333, 0.0, 0.333, 0.667, 1.0, 1.333, 1.667,
    2.333, 3.333, 4.667, 7.0, 10.333, 13.0, 15.0,
];

/// How a sensor spins and what it sees.
#[derive(Clone, Debug, PartialEq)]
pub struct Lidar {
    /// Elevation of each beam, in radians, upwards.
    pub beams_rad: Vec<f64>,
    /// Columns a turn.
    pub columns: usize,
    /// How long a turn takes.
    pub turn: std::time::Duration,
    /// Nearest and farthest range.
    pub range_m: [f64; 2],
    /// Standard deviation of ranges.
    pub noise_m: f64,
    /// Where 10 % reflectivity is seen half the time.
    pub reach_m: f64,
    /// Share of returns that go missing for no reason.
    pub lost: f32,
    /// Where it is on the vehicle.
    pub body_from_sensor: Isometry3<f64>,
}

impl Lidar {
    /// An RS-LiDAR-32 at 10 Hz with 1024 columns, on a mast 1.2 m above the ground.
    pub fn rs_32() -> Self {
        Self {
            beams_rad: BEAMS_DEG
                .iter()
                .map(|degrees| degrees.to_radians())
                .collect(),
            columns: 1024,
            turn: std::time::Duration::from_millis(100),
            range_m: [0.4, 200.0],
            noise_m: 0.02,
            reach_m: 80.0,
            lost: 0.001,
            body_from_sensor: Isometry3::translation(0.0, 0.0, 1.2),
        }
    }
}

/// One return.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Return {
    /// Where, in the frame that the sensor has at that moment, as it reports it.
    pub point: [f32; 3],
    /// After the start of the sweep, in seconds.
    pub after_s: f32,
    /// 0 to 255.
    pub intensity: u8,
    /// Which beam, from the lowest.
    pub ring: u8,
    /// What it met: truth.
    pub instance: Instance,
    /// The range without noise: truth.
    pub true_range_m: f32,
}

impl Lidar {
    /// One turn that starts then. `pose` says where the vehicle is at any moment of it.
    pub fn sweep(
        &self,
        rays: &Rays<'_>,
        start: Stamp,
        pose: impl Fn(Stamp) -> Isometry<World, Body> + Sync,
        seed: u64,
    ) -> Vec<Return> {
        let moment = start.as_nanos() ^ seed.rotate_left(24);
        let seed = mix(mix(moment as u32) ^ (moment >> 32) as u32);
        let per_slice = self.columns.div_ceil(SLICES).max(1);
        let slices: Vec<_> = (0..self.columns).step_by(per_slice).collect();
        let sweeps: Vec<Vec<Return>> = slices
            .par_iter()
            .map(|&first| {
                let last = (first + per_slice).min(self.columns);
                let scene = rays.at(start + self.after((first + last) as f64 / 2.0));
                let mut returns = Vec::new();
                for column in first..last {
                    let after = self.after(column as f64);
                    let sensor = pose(start + after).raw * self.body_from_sensor;
                    // Clockwise from behind, seen from above.
                    let share = column as f64 / self.columns as f64;
                    let azimuth = std::f64::consts::PI * (1.0 - 2.0 * share);
                    for (ring, elevation) in (0..).zip(&self.beams_rad) {
                        let ray = direction(azimuth, *elevation);
                        let from: Point3<f64> = sensor.translation.vector.into();
                        let hit = scene.cast(from, sensor * ray, self.range_m[1]);
                        let seed =
                            at_cell(i32::from(ring), i32::try_from(column).unwrap_or(0), seed);
                        let seen = hit.and_then(|hit| self.receive(&hit, ray, seed));
                        returns.extend(seen.map(|seen| Return {
                            after_s: after.as_secs_f32(),
                            ring,
                            ..seen
                        }));
                    }
                }
                returns
            })
            .collect();
        sweeps.concat()
    }

    fn after(&self, column: f64) -> std::time::Duration {
        self.turn.mul_f64(column / self.columns as f64)
    }

    /// What comes back, if anything does.
    fn receive(&self, hit: &Hit, ray: Vector3<f64>, seed: u32) -> Option<Return> {
        let reflected = f64::from(hit.face.material.at_905_nm()) * hit.facing;
        let light = reflected / 0.1 * (self.reach_m / hit.range_m.max(0.1)).powi(2);
        let lost = 1.0 / (1.0 + light * light);
        let noisy = hit.range_m + self.noise_m * f64::from(normal(mix(seed ^ 1)));
        let is_seen = f64::from(unit(mix(seed ^ 2))) >= lost && unit(mix(seed ^ 3)) >= self.lost;
        let is_in_range = noisy >= self.range_m[0] && noisy <= self.range_m[1];
        (is_seen && is_in_range).then(|| Return {
            point: (ray * noisy).map(|c| c as f32).into(),
            after_s: 0.0,
            intensity: (reflected * 255.0).clamp(0.0, 255.0) as u8,
            ring: 0,
            instance: hit.face.instance,
            true_range_m: hit.range_m as f32,
        })
    }
}

fn direction(azimuth: f64, elevation: f64) -> Vector3<f64> {
    let (up, flat) = elevation.sin_cos();
    let (left, forward) = azimuth.sin_cos();
    Vector3::new(flat * forward, flat * left, up)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform;
    use crate::scene::{Class, Material, Name, Scene};

    fn still(_: Stamp) -> Isometry<World, Body> {
        Isometry::claim(Isometry3::translation(0.0, -1.2, 0.0))
    }

    #[test]
    fn returns_lie_on_surfaces_up_to_the_noise_of_the_data_sheet() {
        let scene = Scene::generate(Name::UrbanArterial, 1001);
        let rays = Rays::new(&scene);
        let lidar = Lidar::rs_32();
        let returns = lidar.sweep(&rays, Stamp::from_nanos(5_000_000_000), still, 3);
        assert!(returns.len() > 20_000, "{} of 32768", returns.len());
        let errors: Vec<f64> = returns
            .iter()
            .map(|seen| f64::from(Vector3::from(seen.point).norm() - seen.true_range_m))
            .collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let variance = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / errors.len() as f64;
        // Three standard errors of 20,000 samples.
        assert!(mean.abs() < 3.0 * 0.02 / 141.0, "{mean}");
        assert!(
            (variance.sqrt() - 0.02).abs() < 3.0 * 0.02 / 200.0,
            "{}",
            variance.sqrt()
        );
        let road = returns
            .iter()
            .filter(|r| scene.class_of(r.instance) == Class::Road);
        let above = road.map(|r| f64::from(r.point[2]) + 1.2);
        assert!(above.fold(0.0, |most: f64, z| most.max(z.abs())) < 0.1);
    }

    #[test]
    fn a_sweep_from_a_moving_vehicle_is_sheared_by_its_way() {
        let scene = Scene::generate(Name::IndustrialPark, 3);
        let rays = Rays::new(&scene);
        let lidar = Lidar {
            noise_m: 0.0,
            lost: 0.0,
            ..Lidar::rs_32()
        };
        let start = Stamp::from_nanos(20_000_000_000);
        let pose = |at| platform::ugv(&scene, at);
        let returns = lidar.sweep(&rays, start, pose, 1);
        let on_its_own_pose = |seen: &Return, at: Stamp| {
            let sensor = pose(at).raw * lidar.body_from_sensor;
            sensor * Point3::from(seen.point.map(f64::from))
        };
        let is_road = |seen: &&Return| scene.class_of(seen.instance) == Class::Road;
        for seen in returns.iter().filter(is_road) {
            let at = start + std::time::Duration::from_secs_f32(seen.after_s);
            // Paint is 4 mm thick.
            let up = on_its_own_pose(seen, at).z;
            assert!((-1e-3..5e-3).contains(&up), "{up}");
        }
        // Taken for one moment, the last returns are off by the way of a turn: 3 m/s for 0.1 s.
        let last = returns.last().expect("returns");
        let end = start + std::time::Duration::from_secs_f32(last.after_s);
        let off = on_its_own_pose(last, end) - on_its_own_pose(last, start);
        assert!((off.norm() - 0.3).abs() < 0.01, "{}", off.norm());
    }

    #[test]
    fn the_same_seed_and_moment_give_the_same_sweep_on_any_number_of_threads() {
        let scene = Scene::generate(Name::ResidentialAlley, 2);
        let rays = Rays::new(&scene);
        let sweep = |threads, nanos, seed| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let lidar = Lidar {
                columns: 128,
                ..Lidar::rs_32()
            };
            pool.expect("threads")
                .install(|| lidar.sweep(&rays, Stamp::from_nanos(nanos), still, seed))
        };
        assert!(sweep(1, 5, 1) == sweep(2, 5, 1));
        assert!(sweep(1, 5, 1) != sweep(1, 5, 2));
        assert!(sweep(1, 5, 1) != sweep(1, 6, 1));
    }

    #[test]
    fn dark_surfaces_are_lost_sooner_than_bright_ones() {
        let lidar = Lidar {
            lost: 0.0,
            ..Lidar::rs_32()
        };
        let scene = Scene::generate(Name::Room, 1);
        let share = |material, range_m| {
            let hit = Hit {
                range_m,
                facing: 1.0,
                face: crate::scene::Face {
                    material,
                    ..scene.still()[0]
                },
            };
            let seen = |i: &u32| lidar.receive(&hit, Vector3::x(), mix(*i)).is_some();
            (0..4000).filter(seen).count() as f64 / 4000.0
        };
        let [sign, tyre] = [Material::Sign { seed: 1 }, Material::Rubber];
        assert!(share(sign, 30.0) > 0.99 && share(tyre, 30.0) > 0.95);
        assert!(share(sign, 150.0) > 0.8 && share(tyre, 150.0) < 0.3);
        let half = share(tyre, 80.0 * 1.2_f64.sqrt());
        assert!(
            (half - 0.5).abs() < 0.03,
            "12 % reflectivity at its reach: {half}"
        );
    }
}
