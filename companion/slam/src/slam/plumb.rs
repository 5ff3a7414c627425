//! Which way is up, by what an accelerometer felt while the camera went a way that is known.
//!
//! What it feels is gravity and its own acceleration. The second is known from three places on the way: between two moments
//! and the one in their midst, `h` before and after,
//!
//! ```text
//! ∫ w·(R·f - g) dt = ∫ w·p'' dt = (p₀ - p₁)/h + (p₂ - p₁)/h        w rises from 0 to 1 and falls to 0 again
//! g·h = ∫ w·R·f dt - (p₀ - 2·p₁ + p₂)/h
//! ```
//!
//! with `p` where the accelerometer was, `R` how it was turned, `f` what it felt, and `g` upwards. Errors of velocity cancel.
//!
//! - T. Lupton, S. Sukkarieh, *Visual-Inertial-Aided Navigation for High-Dynamic Motion in Built Environments Without Initial
//!   Conditions*, IEEE T-RO 2012: gravity in the frame of the first pose; here from single windows, without biases.

use std::collections::VecDeque;
use std::time::Duration;

use maps::time::Stamp;
use nalgebra::{Isometry3, Point3, Vector3};

use super::Slam;
use crate::aid::{Aid, Felt, GRAVITY_MPS2};
use crate::map::{KeyframeId, Renaming};
use crate::tracked::State;

/// From one end of a window to its middle, about.
const HALF: Duration = Duration::from_secs(1);
/// Neither an accelerometer nor vision is trusted where what is left is not gravity.
const NOT_GRAVITY_MPS2: f64 = 0.4;
/// Standard deviation where the camera goes evenly; what it grows by for each g of acceleration, as vision knows the scale of
/// the way to some percent; and by how much what is left is not gravity, beyond the bias of an accelerometer: if it is wrong upwards, it
/// is wrong sideways.
const SIGMA_RAD: f64 = 0.002;
const SIGMA_PER_G: f64 = 0.03;
const BIAS_MPS2: f64 = 0.03;
/// Uprights kept: half an hour. Beyond, every other one is forgotten.
const MOST: usize = 1800;

/// What an accelerometer has said so far.
#[derive(Default)]
pub(super) struct Plumb {
    /// The frames of the last window, without a gap.
    way: VecDeque<Moment>,
    resets: u32,
    pub(super) hung: Vec<Hung>,
    /// Those that came since the map was last bent.
    pub(super) new: usize,
}

/// A tracked frame, and what was felt since the one before.
struct Moment {
    at: Stamp,
    map: u32,
    keyframe: KeyframeId,
    keyframe_from_camera: Isometry3<f64>,
    felt: Felt,
}

/// Which way is up, as felt in the axes of a keyframe.
#[derive(Clone, Copy)]
pub(super) struct Hung {
    pub(super) map: u32,
    pub(super) keyframe: KeyframeId,
    pub(super) up: Vector3<f64>,
    pub(super) sigma_rad: f64,
}

impl Plumb {
    /// The map of that number has become part of another one.
    pub(super) fn rename(&mut self, was: u32, is: u32, renaming: Renaming) {
        for hung in self.hung.iter_mut().filter(|hung| hung.map == was) {
            (hung.map, hung.keyframe) = (is, renaming.keyframe(hung.keyframe));
        }
        for moment in self.way.iter_mut().filter(|moment| moment.map == was) {
            (moment.map, moment.keyframe) = (is, renaming.keyframe(moment.keyframe));
        }
    }
}

impl Slam {
    /// Keeps what was felt before the last frame; where that was not tracked, or the pose has jumped, a new window begins.
    pub(super) fn note_felt(&mut self, aid: &Aid<'_>) {
        let plumb = &mut self.plumb;
        if plumb.resets != self.reset_counter || self.state != State::Tracking {
            plumb.resets = self.reset_counter;
            plumb.way.clear();
        }
        let is_sound = |felt: &Felt| {
            let mut numbers = felt.specific_force.iter().chain(&felt.unit_in_camera);
            numbers.all(|n| n.is_finite())
        };
        let (Some(felt), Some(logged)) = (aid.felt.filter(is_sound), self.log.last()) else {
            return plumb.way.clear();
        };
        if self.state != State::Tracking || self.last.at != Some(logged.at) {
            return;
        }
        plumb.way.push_back(Moment {
            at: logged.at,
            map: logged.map,
            keyframe: logged.reference,
            keyframe_from_camera: logged.reference_from_camera,
            felt,
        });
        let lasts = plumb.way.front().map(|first| logged.at.since(first.at));
        if lasts.is_none_or(|lasts| lasts < 2 * HALF) {
            return;
        }
        if let Some(hung) = self.hang() {
            let plumb = &mut self.plumb;
            plumb.hung.push(hung);
            plumb.new += 1;
            if plumb.hung.len() > MOST {
                let mut keep = false;
                plumb.hung.retain(|_| {
                    keep = !keep;
                    keep
                });
            }
        }
        // The next window begins in the middle of this one.
        let from = self.last.at.map(|at| at - HALF);
        let passed = |m: &mut Moment| from.is_some_and(|from| m.at < from);
        while self.plumb.way.pop_front_if(passed).is_some() {}
    }

    /// What the window says.
    fn hang(&self) -> Option<Hung> {
        let way = &self.plumb.way;
        let (first, last) = (way.front()?, way.back()?);
        let map = self.map_of(first.map)?;
        let passed: Option<Vec<Passed>> = way
            .iter()
            .map(|m| {
                let keyframe = map.poses.get(m.keyframe.0 as usize)?;
                let pose = keyframe * m.keyframe_from_camera;
                (m.map == first.map).then(|| Passed {
                    at_s: m.at.since(first.at).as_secs_f64(),
                    place: (pose * Point3::from(m.felt.unit_in_camera)).coords,
                    pose,
                    force: m.felt.specific_force,
                })
            })
            .collect();
        let half_s = last.at.since(first.at).as_secs_f64() / 2.0;
        let passed = passed?;
        let middle = passed.partition_point(|p| p.at_s < half_s);
        let (up, kinematic_mps2) = gravity(&passed, middle)?;
        let wrong_mps2 = ((up.norm() - GRAVITY_MPS2).abs() - BIAS_MPS2).max(0.0);
        let keyframe = way.get(middle)?.keyframe;
        let pose = map.poses.get(keyframe.0 as usize)?;
        Some(Hung {
            map: first.map,
            keyframe,
            up: pose.rotation.inverse() * up.normalize(),
            sigma_rad: SIGMA_RAD + (SIGMA_PER_G * kinematic_mps2).hypot(wrong_mps2) / GRAVITY_MPS2,
        })
    }
}

/// A frame of the window.
struct Passed {
    at_s: f64,
    pose: Isometry3<f64>,
    /// Where the accelerometer was.
    place: Vector3<f64>,
    /// Felt since the frame before, in the axes midway.
    force: Vector3<f64>,
}

/// Gravity upwards in the world, m/s², and how strongly the camera accelerated; `None` where what is left is not gravity.
fn gravity(passed: &[Passed], middle: usize) -> Option<(Vector3<f64>, f64)> {
    let (first, apex, last) = (passed.first()?, passed.get(middle)?, passed.last()?);
    let (rise_s, fall_s) = (apex.at_s - first.at_s, last.at_s - apex.at_s);
    if rise_s <= 0.0 || fall_s <= 0.0 {
        return None;
    }
    let weight = |at_s: f64| ((at_s - first.at_s) / rise_s).min((last.at_s - at_s) / fall_s);
    let felt: Vector3<f64> = passed
        .windows(2)
        .filter_map(|pair| {
            let [before, after] = pair else { return None };
            let midway = before
                .pose
                .rotation
                .try_slerp(&after.pose.rotation, 0.5, 1e-9)?;
            let weight = weight(f64::midpoint(before.at_s, after.at_s));
            Some(midway * after.force * (weight * (after.at_s - before.at_s)))
        })
        .sum();
    let went = (first.place - apex.place) / rise_s + (last.place - apex.place) / fall_s;
    let whole_s = f64::midpoint(rise_s, fall_s);
    let up = (felt - went) / whole_s;
    let is_gravity = (up.norm() - GRAVITY_MPS2).abs() < NOT_GRAVITY_MPS2;
    is_gravity.then(|| (up, went.norm() / whole_s))
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;

    /// Two seconds of a way that speeds up and turns, in a world that leans by this much about x.
    fn way(lean_rad: f64) -> Vec<Passed> {
        let lean = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), lean_rad);
        let turn = |t: f64| UnitQuaternion::from_euler_angles(0.2, 0.3 * t.sin(), 0.8 * t);
        let place = |t: f64| Vector3::new(1.5 * t * t, 0.3 * (2.0 * t).sin(), 0.1 * t.powi(3));
        let acceleration = |t: f64| Vector3::new(3.0, -1.2 * (2.0 * t).sin(), 0.6 * t);
        let frames = (0..=60).map(|i| {
            let t = f64::from(i) / 30.0;
            let midway = t - 0.5 / 30.0;
            let force = acceleration(midway) + GRAVITY_MPS2 * Vector3::z();
            Passed {
                at_s: t,
                pose: Isometry3::from_parts((lean * place(t)).into(), lean * turn(t)),
                place: lean * place(t),
                force: turn(midway).inverse() * force,
            }
        });
        frames.collect()
    }

    #[test]
    fn gravity_is_what_is_left_when_the_way_is_known() {
        for lean_rad in [0.0, 0.05, -0.3] {
            let (up, kinematic_mps2) = gravity(&way(lean_rad), 30).expect("a way");
            let lean = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), lean_rad);
            let off_rad = up.angle(&(lean * Vector3::z()));
            assert!(off_rad < 5e-4, "{lean_rad}: {off_rad} rad off");
            assert!((2.5..3.5).contains(&kinematic_mps2), "{kinematic_mps2}");
        }
    }

    #[test]
    fn a_way_of_another_scale_and_a_unit_in_other_units_tell_nothing() {
        let mut in_g = way(0.0);
        for p in &mut in_g {
            p.force /= GRAVITY_MPS2;
        }
        assert!(gravity(&in_g, 30).is_none());
        let mut jumped = way(0.0);
        for p in &mut jumped[40..] {
            p.place.z += 2.0;
        }
        assert!(gravity(&jumped, 30).is_none());
        assert!(gravity(&way(0.0)[..1], 0).is_none());
    }
}
