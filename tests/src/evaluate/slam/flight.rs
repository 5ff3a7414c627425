//! Where the drone flies in simulated scenes.
//!
//! Over a street, 300 m to and fro along its middle at 7.5 m/s, at the height at which the scene's own drone flies: it speeds up
//! and slows down over three seconds, leans into that as a multirotor has to, and turns on the spot.
//!
//! ```text
//! v(u) = v (3u² - 2u³)    s(u) = v τ (u³ - u⁴/2)    u = t/τ        while it speeds up, τ = 3 s
//! pitch = atan(a/g)       heading = π (3u² - 2u³)   u = t/6 s      while it turns
//! ```
//!
//! In the alley it flies 75 m to and fro twice, so that the second round sees what the first one saw, from the same
//! direction; in the other streets 150 m once. In the room it flies the simulator's own round.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use maps::frame::{Body, Isometry, World};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use sitl::platform::{self, Platform};
use sitl::scene::{Name, Scene};
use sitl::way::Way;

const SPEED_MPS: f64 = 7.5;
const SPEED_UP_S: f64 = 3.0;
const TURN_S: f64 = 6.0;
/// To the right of the street's middle, on its way.
const ASIDE_M: f64 = 0.5;
const GRAVITY_MPS2: f64 = 9.81;
/// Between two known poses; in between it goes straight.
const STEP: Duration = Duration::from_millis(10);
/// How long the room is filmed.
const ROOM: Duration = Duration::from_secs(20);

/// Lets the drone fly in that scene; how long the flight lasts.
pub(super) fn take_off(scene: &mut Scene, name: Name, seed: u64) -> anyhow::Result<Duration> {
    if name == Name::Room {
        return Ok(ROOM);
    }
    let route = Route::of(name);
    let lasts = route.lasts();
    let pose = |at_s: f64| {
        route
            .pose(scene, at_s, seed)
            .context("a scene without a street")
    };
    let way = Way::new(STEP, pose(0.0)?);
    let steps = (lasts.as_secs_f64() / STEP.as_secs_f64()).ceil() as u32;
    for step in 1..=steps {
        way.push(pose((STEP * step).as_secs_f64())?);
    }
    way.end();
    scene.follow(Platform::Uav, Arc::new(way));
    Ok(lasts)
}

/// Turning points along a street, in metres.
struct Route(&'static [f64]);

/// Where it is on its route.
struct Place {
    along_m: f64,
    left_m: f64,
    /// Counter-clockwise from along the street.
    turned_rad: f64,
    /// Along its heading.
    acceleration_mps2: f64,
}

impl Route {
    fn of(name: Name) -> Self {
        match name {
            Name::ResidentialAlley => Self(&[0.0, 75.0, 0.0, 75.0, 0.0]),
            _ => Self(&[-40.0, 110.0, -40.0]),
        }
    }

    fn legs(&self) -> impl Iterator<Item = (usize, [f64; 2])> {
        let pairs = self.0.windows(2).map(|pair| [pair[0], pair[1]]);
        pairs.enumerate()
    }

    fn lasts(&self) -> Duration {
        let legs: f64 = self.legs().map(|(_, leg)| leg_s(leg)).sum();
        let turns = self.0.len().saturating_sub(2) as f64;
        Duration::from_secs_f64(legs + turns * TURN_S)
    }

    fn place(&self, at_s: f64) -> Place {
        let mut begins_s = 0.0;
        let last = self.0.len() - 2;
        for (index, leg) in self.legs() {
            let (lasts_s, back) = (leg_s(leg), (index % 2) as f64);
            let t = at_s - begins_s;
            let side = if index % 2 == 0 { -1.0 } else { 1.0 };
            if t < lasts_s || index == last {
                let (way_m, acceleration_mps2) = along_leg(leg, t.min(lasts_s));
                return Place {
                    along_m: leg[0] + (leg[1] - leg[0]).signum() * way_m,
                    left_m: side * ASIDE_M,
                    turned_rad: PI * back,
                    acceleration_mps2,
                };
            }
            if t < lasts_s + TURN_S {
                let share = smooth((t - lasts_s) / TURN_S);
                return Place {
                    along_m: leg[1],
                    left_m: side * ASIDE_M * (1.0 - 2.0 * share),
                    turned_rad: PI * (back + share),
                    acceleration_mps2: 0.0,
                };
            }
            begins_s += lasts_s + TURN_S;
        }
        // The last leg has no end.
        Place {
            along_m: self.0[last + 1],
            left_m: 0.0,
            turned_rad: 0.0,
            acceleration_mps2: 0.0,
        }
    }

    fn pose(&self, scene: &Scene, at_s: f64, seed: u64) -> Option<Isometry<World, Body>> {
        let place = self.place(at_s);
        let over = platform::over_street(scene, place.along_m, place.left_m)?;
        let shake = |axis: u32, hz: f64| {
            // None at first, so that a map that is made from there knows where up is.
            let grown = (at_s / 2.0).min(1.0);
            let phase = TAU * (seed as f64 * 0.618_034 + f64::from(axis) * 0.754_878).fract();
            grown * (TAU * hz * at_s + phase).sin()
        };
        let pitch = (place.acceleration_mps2 / GRAVITY_MPS2).atan();
        let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, place.turned_rad)
            * UnitQuaternion::from_euler_angles(
                0.014 * shake(1, 0.9),
                pitch + 0.014 * shake(2, 1.1),
                0.02 * shake(3, 0.3),
            );
        let sway = Translation3::new(0.0, 0.2 * shake(4, 0.13), 0.2 * shake(5, 0.11));
        Some(Isometry::claim(
            over.raw * Isometry3::from_parts(sway, turn),
        ))
    }
}

/// It covers half of what it would at speed while it speeds up and while it slows down.
fn leg_s(leg: [f64; 2]) -> f64 {
    (leg[1] - leg[0]).abs() / SPEED_MPS + SPEED_UP_S
}

/// How far it has come on a leg, and its acceleration, from the leg's start to its end.
fn along_leg(leg: [f64; 2], t: f64) -> (f64, f64) {
    let (length_m, lasts_s) = ((leg[1] - leg[0]).abs(), leg_s(leg));
    let ramp = |t: f64| {
        let u = (t / SPEED_UP_S).clamp(0.0, 1.0);
        let way_m = SPEED_MPS * SPEED_UP_S * (u.powi(3) - u.powi(4) / 2.0);
        (way_m, SPEED_MPS / SPEED_UP_S * 6.0 * u * (1.0 - u))
    };
    if t < SPEED_UP_S {
        ramp(t)
    } else if t > lasts_s - SPEED_UP_S {
        let (way_m, acceleration) = ramp(lasts_s - t);
        (length_m - way_m, -acceleration)
    } else {
        (SPEED_MPS * (t - SPEED_UP_S / 2.0), 0.0)
    }
}

/// From 0 to 1, at rest at both ends.
fn smooth(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flight_over_a_street_is_300_m_long_and_smooth() {
        for name in [Name::ResidentialAlley, Name::SuburbanRoad] {
            let scene = Scene::generate(name, 1100);
            let route = Route::of(name);
            let count = (route.lasts().as_secs_f64() * 50.0) as u32;
            let poses: Vec<_> = (0..=count)
                .map(|i| {
                    route
                        .pose(&scene, f64::from(i) * 0.02, 7)
                        .expect("a street")
                        .raw
                })
                .collect();
            let steps = poses
                .windows(2)
                .map(|pair| (pair[1].translation.vector - pair[0].translation.vector).norm());
            let length_m: f64 = steps.clone().sum();
            assert!((295.0..330.0).contains(&length_m), "{name}: {length_m} m");
            let fastest = steps.fold(0.0, f64::max) / 0.02;
            assert!((7.0..9.0).contains(&fastest), "{name}: {fastest} m/s");
            let turns = poses
                .windows(2)
                .map(|pair| pair[0].rotation.angle_to(&pair[1].rotation) / 0.02);
            let turning = turns.fold(0.0, f64::max);
            assert!(turning < 1.2, "{name}: {turning} rad/s");
        }
    }

    #[test]
    fn it_comes_back_to_where_it_took_off() {
        for name in Name::STREETS {
            let route = Route::of(name);
            let [start, end] = [0.0, route.lasts().as_secs_f64()].map(|t| route.place(t).along_m);
            assert!((start - end).abs() < 1e-6, "{name}: {start} and {end}");
        }
    }

    #[test]
    fn over_the_alley_it_sees_the_same_again_from_the_same_direction() {
        let route = Route::of(Name::ResidentialAlley);
        let round_s = 2.0 * (leg_s([0.0, 75.0]) + TURN_S);
        for t in [4.0, 8.0, 12.0] {
            let [first, again] = [t, t + round_s].map(|t| route.place(t));
            assert!((first.along_m - again.along_m).abs() < 1e-9, "{t} s");
            assert!((first.turned_rad - again.turned_rad).abs() < 1e-9, "{t} s");
        }
    }
}
