//! Three streets, after the paper's: a residential alley full of obstacles, an urban road with traffic, and an industrial
//! park whose prior map is a month old.

use std::f64::consts::FRAC_PI_2;
use std::time::Duration;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::world::{ALWAYS, Kind, Solid, World};

/// How long the mission takes.
pub(super) const DURATION_S: f64 = 24.0;

/// A street.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scene {
    /// A: narrow, cars parked on both sides, fences and hedges; the prior map is an hour old.
    ResidentialAlley,
    /// B: wide, with traffic; half of the parked vehicles have moved since the prior map of the day before.
    UrbanArterial,
    /// C: containers and pallets, most of which have moved since the prior map of the month before.
    IndustrialPark,
}

impl Scene {
    pub(super) const ALL: [Self; 3] = [
        Self::ResidentialAlley,
        Self::UrbanArterial,
        Self::IndustrialPark,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::ResidentialAlley => "residential-alley",
            Self::UrbanArterial => "urban-arterial",
            Self::IndustrialPark => "industrial-park",
        }
    }

    /// As in the paper's tables.
    pub(super) fn letter(self) -> char {
        match self {
            Self::ResidentialAlley => 'A',
            Self::UrbanArterial => 'B',
            Self::IndustrialPark => 'C',
        }
    }

    /// The age of the prior map when the mission starts.
    pub(super) fn prior_age(self) -> Duration {
        match self {
            Self::ResidentialAlley => Duration::from_hours(1),
            Self::UrbanArterial => Duration::from_hours(24),
            Self::IndustrialPark => Duration::from_hours(24 * 30),
        }
    }

    /// The world of a seed.
    pub(super) fn world(self, seed: u64) -> World {
        let mut builder = Builder {
            random: Pcg64::seed_from_u64(seed ^ ((self as u64 + 1) << 32)),
            world: World::default(),
        };
        match self {
            Self::ResidentialAlley => builder.residential_alley(),
            Self::UrbanArterial => builder.urban_arterial(),
            Self::IndustrialPark => builder.industrial_park(),
        }
        builder.world
    }
}

struct Builder {
    random: Pcg64,
    world: World,
}

impl Builder {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.random.random_range(low..high)
    }

    /// Something that stands on the ground, with these edges.
    fn stand(
        &mut self,
        kind: Kind,
        [x, y]: [f64; 2],
        [length, width, height]: [f64; 3],
        yaw: f64,
    ) -> &mut Solid {
        self.world.solids.push(Solid {
            kind,
            center: [x, y, 0.5 * height],
            half: [0.5 * length, 0.5 * width, 0.5 * height],
            yaw,
            holes: 0.0,
            there_s: ALWAYS,
            velocity: [0.0; 2],
        });
        let last = self.world.solids.len() - 1;
        &mut self.world.solids[last]
    }

    /// Houses on both sides, their fronts at about `front` from the middle of the road, with gaps between them.
    fn houses(&mut self, front: f64) {
        for side in [-1.0, 1.0] {
            let mut x = self.between(-3.0, 0.0);
            while x < 25.0 {
                let (length, setback) = (self.between(4.0, 8.0), self.between(0.0, 0.8));
                let (depth, height) = (5.0, self.between(2.6, 6.0));
                let y = side * (front + setback + 0.5 * depth);
                self.stand(
                    Kind::Fixed,
                    [x + 0.5 * length, y],
                    [length, depth, height],
                    0.0,
                );
                x += length + self.between(0.6, 2.0);
            }
        }
    }

    /// A row of thin posts.
    fn poles(&mut self, y: f64, apart: f64) {
        let mut x = self.between(0.0, apart);
        while x < 24.0 {
            self.stand(Kind::Fixed, [x, y], [0.12, 0.12, 4.0], 0.0);
            x += apart;
        }
    }

    /// A fence or hedge that lets a share of the rays through.
    fn screen(&mut self, [x, y]: [f64; 2], [length, thickness, height]: [f64; 3], holes: f64) {
        self.stand(Kind::Fixed, [x, y], [length, thickness, height], 0.0)
            .holes = holes;
    }

    /// Parking places along `y`: each is empty, taken for good, left since the prior map, taken since, left during the
    /// mission, or taken during it.
    fn parking(&mut self, y: f64, changes: Changes) {
        let mut x = self.between(0.5, 3.0);
        while x < 23.5 {
            let (length, width, height) = (
                self.between(3.8, 4.6),
                self.between(1.65, 1.85),
                self.between(1.4, 1.9),
            );
            let (jitter, yaw) = (self.between(-0.15, 0.15), self.between(-0.06, 0.06));
            let middle = self.between(0.3, 0.7) * DURATION_S;
            let there_s = match self.between(0.0, 1.0) {
                c if c < changes.since_prior => [f64::NEG_INFINITY, -0.5],
                c if c < 2.0 * changes.since_prior => [-0.5, f64::INFINITY],
                c if c < 2.0 * changes.since_prior + changes.during => [f64::NEG_INFINITY, middle],
                c if c < 2.0 * (changes.since_prior + changes.during) => [middle, f64::INFINITY],
                _ => ALWAYS,
            };
            // The body, and a narrower cabin on it.
            let hood = 0.55 * height;
            self.stand(Kind::Vehicle, [x, y + jitter], [length, width, hood], yaw)
                .there_s = there_s;
            let cabin = self.stand(
                Kind::Vehicle,
                [x - 0.2, y + jitter],
                [0.55 * length, 0.9 * width, height],
                yaw,
            );
            cabin.there_s = there_s;
            x += length + self.between(0.7, 2.5);
        }
    }

    /// Somebody or something that moves along the road from a time on, and the dust behind it if it is fast.
    fn mover(&mut self, [x, y]: [f64; 2], size: [f64; 3], velocity: [f64; 2], from_s: f64) {
        let there_s = [from_s, DURATION_S + 1.0];
        let yaw = velocity[1].atan2(velocity[0]);
        let mover = self.stand(Kind::Mover, [x, y], size, yaw);
        (mover.there_s, mover.velocity) = (there_s, velocity);
        if velocity[0].hypot(velocity[1]) > 3.0 {
            let puffs = 3;
            for puff in 0..puffs {
                let after = from_s + 1.0 + 0.7 * f64::from(puff);
                let at = [
                    x + velocity[0] * (after - from_s),
                    y + velocity[1] * (after - from_s),
                ];
                let dust = self.stand(Kind::Dust, at, [1.5, 1.5, 0.9], 0.0);
                (dust.there_s, dust.holes) = ([after, after + 3.0], 0.9);
            }
        }
    }

    fn pedestrians(&mut self, count: usize, side_m: f64) {
        for _ in 0..count {
            let (x, speed) = (self.between(4.0, 20.0), self.between(-1.4, 1.4));
            let y = if self.between(0.0, 1.0) < 0.5 {
                side_m
            } else {
                -side_m
            };
            let sway = self.between(-0.1, 0.1);
            self.mover([x, y], [0.4, 0.5, 1.75], [speed, sway], 0.0);
        }
    }

    fn residential_alley(&mut self) {
        self.houses(5.4);
        self.poles(-4.6, 7.0);
        for (y, height) in [(4.7, 1.3), (-4.9, 1.0)] {
            let (x, length) = (self.between(4.0, 18.0), self.between(5.0, 9.0));
            self.screen([x, y], [length, 0.08, height], 0.6);
        }
        let (x, length) = (self.between(3.0, 20.0), self.between(3.0, 6.0));
        self.screen([x, 4.2], [length, 0.5, 1.2], 0.35);
        let changes = Changes {
            since_prior: 0.1,
            during: 0.08,
        };
        self.parking(2.9, changes);
        self.parking(-3.1, changes);
        self.pedestrians(3, 1.6);
    }

    fn urban_arterial(&mut self) {
        self.houses(7.0);
        self.poles(6.1, 6.0);
        self.poles(-6.2, 6.0);
        let (x, length) = (self.between(6.0, 16.0), self.between(6.0, 10.0));
        self.screen([x, 6.4], [length, 0.08, 1.1], 0.6);
        let changes = Changes {
            since_prior: 0.2,
            during: 0.12,
        };
        self.parking(4.9, changes);
        self.parking(-5.0, changes);
        for _ in 0..3 {
            let (from_s, speed) = (self.between(0.0, 18.0), self.between(4.0, 8.0));
            self.mover([26.0, 2.4], [4.3, 1.8, 1.5], [-speed, 0.0], from_s);
        }
        let (x, speed) = (self.between(12.0, 16.0), self.between(0.2, 0.8));
        self.mover([x, -2.6], [4.3, 1.8, 1.5], [speed, 0.0], 0.0);
        self.pedestrians(4, 6.6);
    }

    fn industrial_park(&mut self) {
        self.stand(Kind::Fixed, [12.0, 8.6], [30.0, 2.0, 6.0], 0.0);
        self.stand(Kind::Fixed, [12.0, -8.4], [30.0, 1.5, 6.0], 0.0);
        self.screen([12.0, -6.9], [20.0, 0.08, 2.0], 0.7);
        self.poles(6.8, 8.0);
        for (side, kind) in [(1.0, Kind::Fixed), (-1.0, Kind::Vehicle)] {
            let mut x = self.between(1.0, 3.0);
            while x < 22.0 {
                let (size, setback) = (
                    [
                        self.between(2.0, 5.0),
                        self.between(1.2, 2.2),
                        self.between(1.0, 2.6),
                    ],
                    self.between(0.0, 1.0),
                );
                let turned = if self.between(0.0, 1.0) < 0.3 {
                    FRAC_PI_2
                } else {
                    0.0
                };
                let yaw = turned + self.between(-0.1, 0.1);
                let there_s = match self.between(0.0, 1.0) {
                    c if c < 0.3 => [f64::NEG_INFINITY, -0.5],
                    c if c < 0.6 => [-0.5, f64::INFINITY],
                    c if c < 0.68 => [f64::NEG_INFINITY, 0.5 * DURATION_S],
                    _ => ALWAYS,
                };
                let y = side * (3.4 + setback + 0.5 * size[1]);
                self.stand(kind, [x, y], size, yaw).there_s = there_s;
                x += size[0] + self.between(0.4, 2.0);
            }
        }
        for _ in 0..2 {
            let (x, from_s, speed) = (
                self.between(2.0, 20.0),
                self.between(0.0, 12.0),
                self.between(-2.0, 2.0),
            );
            self.mover([x, 2.2], [2.4, 1.2, 2.1], [speed, 0.0], from_s);
        }
        self.mover([26.0, -2.2], [4.5, 2.0, 2.4], [-4.0, 0.0], 6.0);
        self.pedestrians(2, 2.8);
    }
}

/// How likely a parking place changes, each way.
#[derive(Clone, Copy)]
struct Changes {
    since_prior: f64,
    during: f64,
}

#[cfg(test)]
mod tests {
    use super::super::world::LONG_AGO_S;
    use super::*;

    #[test]
    fn every_scene_changes_after_its_prior_map_and_moves_during_the_mission() {
        for scene in Scene::ALL {
            let there = |at_s: f64| -> usize {
                (0..4_u64)
                    .flat_map(|seed| scene.world(seed).solids)
                    .filter(|s| s.is_there(at_s) != s.is_there(DURATION_S))
                    .count()
            };
            assert!(there(LONG_AGO_S) > 0, "{}", scene.name());
            assert!(there(0.0) > 0, "{}", scene.name());
        }
    }

    #[test]
    fn a_seed_gives_one_world() {
        let describe = |seed| format!("{:?}", Scene::UrbanArterial.world(seed));
        assert_eq!(describe(7), describe(7));
        assert_ne!(describe(7), describe(8));
    }
}
