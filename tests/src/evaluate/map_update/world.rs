//! The true world: solids that stand, come, go or drive, and what a ray meets.
//!
//! Truth is computed from the shapes themselves; nothing here looks at a map.

use maps::voxel::VoxelKey;

/// A position in the world frame, in metres.
pub(super) type P = [f64; 3];

/// The edge of a voxel.
pub(super) const RESOLUTION_M: f64 = 0.1;
/// The corner of the street with the least coordinates, in voxels: above the ground, which everybody gets right.
pub(super) const LOW: VoxelKey = VoxelKey::new(0, -80, 2);
/// The corner with the greatest, in voxels, inclusive.
pub(super) const HIGH: VoxelKey = VoxelKey::new(239, 79, 21);

/// What a solid is to a detector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Buildings, fences, poles, hedges, containers.
    Fixed,
    /// Cars that are parked.
    Vehicle,
    /// People and cars in traffic.
    Mover,
    /// Dust and exhaust: it returns rays and is not there.
    Dust,
}

/// An upright box.
#[derive(Clone, Debug)]
pub(super) struct Solid {
    pub(super) kind: Kind,
    /// Its middle when it comes, or at the start of the mission if it was always there.
    pub(super) center: P,
    /// Half of its edges.
    pub(super) half: P,
    pub(super) yaw: f64,
    /// The share of rays that pass through it.
    pub(super) holes: f64,
    /// From when to when it is there, in seconds of the mission; the prior map was made long before.
    pub(super) there_s: [f64; 2],
    /// Its velocity.
    pub(super) velocity: [f64; 2],
}

/// Always.
pub(super) const ALWAYS: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];
/// When the prior map was made: before anything of the mission.
pub(super) const LONG_AGO_S: f64 = -1.0;

impl Solid {
    pub(super) fn is_there(&self, at_s: f64) -> bool {
        (self.there_s[0]..self.there_s[1]).contains(&at_s)
    }

    pub(super) fn center_at(&self, at_s: f64) -> P {
        let since = at_s
            - if self.there_s[0].is_finite() {
                self.there_s[0]
            } else {
                0.0
            };
        let [x, y, z] = self.center;
        [
            x + self.velocity[0] * since,
            y + self.velocity[1] * since,
            z,
        ]
    }

    /// Where a point is in the axes of the solid.
    fn local(&self, p: P, at_s: f64) -> P {
        let center = self.center_at(at_s);
        turned(
            [p[0] - center[0], p[1] - center[1], p[2] - center[2]],
            -self.yaw,
        )
    }

    /// Where a ray enters it, as a multiple of `direction`.
    fn entered_by(&self, origin: P, direction: P, at_s: f64) -> Option<f64> {
        let (origin, direction) = (self.local(origin, at_s), turned(direction, -self.yaw));
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let to = |side: f64| (side * self.half[axis] - origin[axis]) / direction[axis];
            let (a, b) = (to(-1.0), to(1.0));
            // A direction along the slab gives infinities, or NaN on its very edge, which min and max ignore.
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        (enter <= leave && enter > 0.0).then_some(enter)
    }

    fn contains(&self, p: P, at_s: f64) -> bool {
        let local = self.local(p, at_s);
        (0..3).all(|axis| local[axis].abs() <= self.half[axis])
    }
}

/// All solids of a street.
#[derive(Clone, Debug, Default)]
pub(super) struct World {
    pub(super) solids: Vec<Solid>,
}

/// What a ray met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Met {
    /// How far away.
    pub(super) range_m: f64,
    /// The index of the solid; `None` for the ground.
    pub(super) solid: Option<usize>,
}

impl World {
    /// The nearest thing that a ray of unit direction meets at a time. `luck` says for each solid with holes whether the ray
    /// gets through.
    pub(super) fn cast(
        &self,
        origin: P,
        direction: P,
        at_s: f64,
        luck: &mut impl FnMut() -> f64,
    ) -> Option<Met> {
        let ground = (direction[2] < 0.0).then(|| Met {
            range_m: -origin[2] / direction[2],
            solid: None,
        });
        let mut nearest = ground;
        for (index, solid) in self.solids.iter().enumerate() {
            if !solid.is_there(at_s) {
                continue;
            }
            let Some(range_m) = solid.entered_by(origin, direction, at_s) else {
                continue;
            };
            let is_nearer = nearest.is_none_or(|met| range_m < met.range_m);
            if is_nearer && (solid.holes == 0.0 || luck() >= solid.holes) {
                nearest = Some(Met {
                    range_m,
                    solid: Some(index),
                });
            }
        }
        nearest
    }

    /// The true map at a time.
    pub(super) fn truth(&self, at_s: f64) -> Truth {
        let mut truth = Truth::default();
        for solid in self.solids.iter().filter(|solid| solid.is_there(at_s)) {
            let (surface, inside) = (surface(solid, at_s), inside(solid, at_s));
            match solid.kind {
                Kind::Fixed | Kind::Vehicle => {
                    truth.surface.extend(&surface);
                    truth.solid.extend(surface.iter().chain(&inside));
                }
                Kind::Mover | Kind::Dust => truth.open.extend(surface.iter().chain(&inside)),
            }
        }
        truth
    }
}

/// Which voxels should be occupied, not in order and some more than once.
#[derive(Clone, Debug, Default)]
pub(super) struct Truth {
    /// Where there is a surface of something that stays.
    pub(super) surface: Vec<VoxelKey>,
    /// The same, and what is inside.
    pub(super) solid: Vec<VoxelKey>,
    /// Where something moves at the moment: neither answer is wrong.
    pub(super) open: Vec<VoxelKey>,
}

/// The voxels of the street that the faces of a solid pass through, its underside left out.
fn surface(solid: &Solid, at_s: f64) -> Vec<VoxelKey> {
    const STEP_M: f64 = 0.04;
    let center = solid.center_at(at_s);
    let mut keys = Vec::new();
    for (axis, side) in [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0), (2, 1.0)] {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let steps = |axis: usize| (2.0 * solid.half[axis] / STEP_M).ceil().max(1.0) as usize;
        for i in 0..=steps(u) {
            for j in 0..=steps(v) {
                let along = |axis: usize, i: usize| {
                    solid.half[axis] * (2.0 * i as f64 / steps(axis) as f64 - 1.0)
                };
                let mut p = [0.0; 3];
                (p[axis], p[u], p[v]) = (side * solid.half[axis], along(u, i), along(v, j));
                let p = turned(p, solid.yaw);
                keys.push(key_of([
                    p[0] + center[0],
                    p[1] + center[1],
                    p[2] + center[2],
                ]));
            }
        }
    }
    keys.retain(|key| is_in_street(*key));
    keys.sort_unstable();
    keys.dedup();
    keys
}

/// The voxels of the street whose middle is in a solid.
fn inside(solid: &Solid, at_s: f64) -> Vec<VoxelKey> {
    let center = solid.center_at(at_s);
    let reach = solid.half[0].hypot(solid.half[1]).max(solid.half[2]);
    let low = key_of(center.map(|c| c - reach));
    let high = key_of(center.map(|c| c + reach));
    let mut keys = Vec::new();
    for z in low.z.max(LOW.z)..=high.z.min(HIGH.z) {
        for y in low.y.max(LOW.y)..=high.y.min(HIGH.y) {
            for x in low.x.max(LOW.x)..=high.x.min(HIGH.x) {
                let middle = [x, y, z].map(|c| (f64::from(c) + 0.5) * RESOLUTION_M);
                if solid.contains(middle, at_s) {
                    keys.push(VoxelKey::new(x, y, z));
                }
            }
        }
    }
    keys
}

pub(super) fn key_of(p: P) -> VoxelKey {
    let [x, y, z] = p.map(|c| (c / RESOLUTION_M).floor() as i32);
    VoxelKey::new(x, y, z)
}

pub(super) fn is_in_street(key: VoxelKey) -> bool {
    (LOW.x..=HIGH.x).contains(&key.x)
        && (LOW.y..=HIGH.y).contains(&key.y)
        && (LOW.z..=HIGH.z).contains(&key.z)
}

/// About the vertical.
pub(super) fn turned([x, y, z]: P, yaw: f64) -> P {
    let (sin, cos) = yaw.sin_cos();
    [cos * x - sin * y, sin * x + cos * y, z]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn car(there_s: [f64; 2], velocity: [f64; 2]) -> Solid {
        Solid {
            kind: Kind::Vehicle,
            center: [5.0, 0.0, 0.7],
            half: [2.0, 0.9, 0.7],
            yaw: 0.0,
            holes: 0.0,
            there_s,
            velocity,
        }
    }

    fn range_m(world: &World, at_s: f64) -> Option<f64> {
        let met = world.cast([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], at_s, &mut || 0.0)?;
        Some(met.range_m)
    }

    #[test]
    fn a_ray_meets_what_is_there_where_it_is() {
        let world = World {
            solids: vec![car([0.0, 10.0], [1.0, 0.0])],
        };
        assert_eq!(range_m(&world, -1.0), None, "not yet there");
        assert_eq!(range_m(&world, 0.0), Some(3.0));
        assert_eq!(range_m(&world, 4.0), Some(7.0), "four metres on");
        assert_eq!(range_m(&world, 10.0), None, "gone");
    }

    #[test]
    fn the_truth_is_a_shell_around_what_is_inside() {
        let world = World {
            solids: vec![car(ALWAYS, [0.0; 2])],
        };
        let truth = world.truth(0.0);
        let inside = VoxelKey::new(50, 0, 7);
        assert!(truth.solid.contains(&inside) && !truth.surface.contains(&inside));
        assert!(truth.surface.contains(&VoxelKey::new(30, 0, 7)));
        assert!(truth.open.is_empty());
    }
}
