//! What the prior map, the drone and the ground vehicle report of a world, with the errors of each.
//!
//! | source | sees | errors |
//! |---|---|---|
//! | prior | 0.1 m voxels, from above and aslant, long ago | an offset of 6 cm, 3 cm of noise, 5 % wrong classes |
//! | UAV | 0.5 m cells, from above, every 2 s | an offset of 20 cm all along, 5 cm of jitter, cells always wrong, cells wrong at times |
//! | UGV | LiDAR returns, every 0.6 s | a drift of 3 cm, 2 cm of noise, stray returns, dust, people without a label |

use std::f64::consts::TAU;
use std::time::Duration;

use maps::bev::{BevGrid, BevView};
use maps::evidence::{Look, Mass, Mobility, Observation, Source, View};
use maps::frame::{Bev, Isometry, Point};
use maps::time::Stamp;
use maps::voxel::VoxelKey;
use nalgebra::{Isometry3, Matrix6, UnitQuaternion, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::judge::{index, key_at};
use super::noise::{fate, happens, normal};
use super::scenes::{DURATION_S, Scene};
use super::world::{
    HIGH, Kind, LONG_AGO_S, LOW, P, RESOLUTION_M, Truth, World, is_in_street, key_of, turned,
};

/// What one source says in one look.
pub(super) type Report = (Look, Vec<(VoxelKey, Observation)>);

/// All that was said of a street, in order, and the truth at the end.
pub(super) struct Recording {
    pub(super) reports: Vec<Report>,
    pub(super) truth: Truth,
    pub(super) end: Stamp,
}

/// The start of the mission: late enough for any prior map to have a stamp.
const START: Duration = Duration::from_hours(24 * 365);

fn stamp(at_s: f64) -> Stamp {
    Stamp::ZERO + START + Duration::from_secs_f64(at_s)
}

impl Recording {
    /// Drives and flies through a scene.
    pub(super) fn of(scene: Scene, seed: u64) -> anyhow::Result<Self> {
        let world = scene.world(seed);
        let random = |stream: u64| Pcg64::seed_from_u64(seed.wrapping_mul(16) + stream);
        let mut reports = vec![prior(&world, scene.prior_age(), &mut random(1))];
        reports.extend(uav(&world, seed, &mut random(2))?);
        reports.extend(ugv(&world, &mut random(3)));
        reports.sort_by_key(|(look, _)| (look.at, look.source));
        Ok(Self {
            reports,
            truth: world.truth(DURATION_S),
            end: stamp(DURATION_S),
        })
    }

    /// A part of the street, in columns of 1.6 m spread over it: voxels do not know of each other, so that it is as good for
    /// choosing parameters as the whole.
    #[must_use]
    pub(super) fn thinned(mut self) -> Self {
        let kept = |key: &VoxelKey| {
            let column = [i64::from(key.x >> 4), i64::from(key.y >> 4), 0];
            fate(0, column) < 0.25
        };
        for (_, seen) in &mut self.reports {
            seen.retain(|(key, _)| kept(key));
            seen.shrink_to_fit();
        }
        for keys in [&mut self.truth.surface, &mut self.truth.solid] {
            keys.retain(kept);
        }
        self
    }
}

/// Where a ray went.
#[derive(Clone, Copy)]
enum End {
    /// On, without a return.
    Lost,
    /// Into a solid, or into the ground or nothing at all.
    Return(Option<usize>),
}

/// What rays did to the voxels of the street in one look.
struct Marks {
    /// By voxel: rays that ended there and rays that passed.
    counts: Vec<[u16; 2]>,
    /// By voxel: who was hit last, counted from 1.
    solids: Vec<u16>,
}

impl Marks {
    fn new() -> Self {
        let volume = index(HIGH) + 1;
        Self {
            counts: vec![[0; 2]; volume],
            solids: vec![0; volume],
        }
    }

    /// A ray from `origin` that ended at `end`, or got lost there.
    fn ray(&mut self, origin: P, end: P, went: End) {
        let last = key_of(end);
        let delta = [end[0] - origin[0], end[1] - origin[1], end[2] - origin[2]];
        let steps = walk(origin, delta);
        for key in steps.filter(|key| *key != last && is_in_street(*key)) {
            let count = &mut self.counts[index(key)][1];
            *count = count.saturating_add(1);
        }
        if let (End::Return(solid), true) = (went, is_in_street(last)) {
            let at = index(last);
            self.counts[at][0] = self.counts[at][0].saturating_add(1);
            self.solids[at] = solid.map_or(0, |solid| solid as u16 + 1);
        }
    }

    /// Every voxel that a ray touched: hits, passes, and the solid that was hit.
    fn touched(&self) -> impl Iterator<Item = (VoxelKey, [u16; 2], Option<usize>)> {
        let all = self.counts.iter().zip(&self.solids).enumerate();
        all.filter(|(_, (counts, _))| **counts != [0; 2])
            .map(|(at, (counts, solid))| (key_at(at), *counts, usize::from(*solid).checked_sub(1)))
    }
}

/// The voxels along a straight line, first to last (J. Amanatides and A. Woo, 1987).
fn walk(origin: P, delta: P) -> impl Iterator<Item = VoxelKey> {
    let start = key_of(origin);
    let mut at = [start.x, start.y, start.z];
    let step = delta.map(|d| if d < 0.0 { -1 } else { 1 });
    let width: P = std::array::from_fn(|i| (RESOLUTION_M / delta[i]).abs());
    let mut next: P = std::array::from_fn(|i| {
        let edge = f64::from(at[i] + i32::from(step[i] > 0)) * RESOLUTION_M;
        if delta[i] == 0.0 {
            f64::INFINITY
        } else {
            (edge - origin[i]) / delta[i]
        }
    });
    let mut is_over = false;
    std::iter::from_fn(move || {
        if is_over {
            return None;
        }
        let key = VoxelKey::new(at[0], at[1], at[2]);
        let axis = (0..3)
            .min_by(|a, b| next[*a].total_cmp(&next[*b]))
            .unwrap_or(0);
        is_over = next[axis] > 1.0;
        at[axis] += step[axis];
        next[axis] += width[axis];
        Some(key)
    })
}

fn along(origin: P, direction: P, range_m: f64) -> P {
    std::array::from_fn(|i| origin[i] + direction[i] * range_m)
}

fn plus(a: P, b: P) -> P {
    std::array::from_fn(|i| a[i] + b[i])
}

/// A map made long before, from many places above the street.
fn prior(world: &World, age: Duration, random: &mut Pcg64) -> Report {
    const RAYS: usize = 9000;
    let offset: P = std::array::from_fn(|_| 0.06 * normal(random));
    let mut marks = Marks::new();
    for place in 0..36 {
        let at = |i: i32, count: i32, first: f64, apart: f64| first + f64::from(i % count) * apart;
        let origin = [
            at(place, 6, 2.0, 4.0),
            at(place / 6, 3, -5.0, 5.0),
            at(place / 18, 2, 5.0, 5.0),
        ];
        for _ in 0..RAYS {
            let (z, around) = (
                random.random_range(-1.0..0.05),
                random.random_range(0.0..TAU),
            );
            let flat = (1.0_f64 - z * z).max(0.0).sqrt();
            let direction = [flat * around.cos(), flat * around.sin(), z];
            let met = world.cast(origin, direction, LONG_AGO_S, &mut || random.random());
            if let Some(met) = met.filter(|met| met.range_m < 25.0) {
                let range_m = met.range_m + 0.03 * normal(random);
                let end = plus(along(origin, direction, range_m), offset);
                marks.ray(plus(origin, offset), end, End::Return(met.solid));
            }
        }
    }
    let seen = marks.touched().map(|(key, [hits, passes], solid)| {
        let is_occupied = u32::from(hits) * 4 > u32::from(passes);
        let kind = solid.map(|solid| world.solids[solid].kind);
        let mobility = match kind {
            _ if !is_occupied => Mobility::Unknown,
            _ if happens(random, 0.05) => Mobility::Movable,
            Some(Kind::Vehicle | Kind::Mover) => Mobility::Movable,
            Some(Kind::Fixed | Kind::Dust) | None => Mobility::Static,
        };
        let mass = if is_occupied {
            Mass::occupied_by(0.7)
        } else {
            Mass::free_by(0.6)
        };
        (key, observation(mass, mobility, None))
    });
    let look = Look {
        source: Source::Prior,
        at: Stamp::ZERO + START.saturating_sub(age),
        view: View(0),
    };
    (look, seen.collect())
}

fn observation(mass: Mass, mobility: Mobility, detection: Option<f32>) -> Observation {
    Observation {
        mass,
        mobility,
        detection,
    }
}

/// Where the ground vehicle is: it drives through the street.
fn ugv_at(at_s: f64) -> P {
    [24.0 * at_s / DURATION_S, 0.0, 0.0]
}

/// What a detector says of a solid in one look.
#[derive(Clone, Copy)]
struct Verdict {
    mobility: Mobility,
    detection: Option<f32>,
}

impl Verdict {
    fn of(kind: Kind, random: &mut Pcg64) -> Self {
        let luck: f64 = random.random();
        let mobility = match kind {
            Kind::Fixed if luck < 0.85 => Mobility::Static,
            Kind::Fixed if luck < 0.97 => Mobility::Unknown,
            Kind::Fixed => Mobility::Movable,
            Kind::Vehicle if luck < 0.85 => Mobility::Movable,
            Kind::Vehicle if luck < 0.88 => Mobility::Moving,
            Kind::Mover if luck < 0.78 => Mobility::Moving,
            Kind::Mover if luck < 0.88 => Mobility::Movable,
            Kind::Vehicle | Kind::Mover | Kind::Dust => Mobility::Unknown,
        };
        let is_boxed = matches!(mobility, Mobility::Movable | Mobility::Moving);
        Self {
            mobility,
            detection: is_boxed.then(|| random.random_range(0.5..0.95)),
        }
    }
}

/// LiDAR sweeps from a vehicle whose pose drifts.
fn ugv(world: &World, random: &mut Pcg64) -> Vec<Report> {
    const SWEEPS: u32 = 40;
    let mut drift = [0.0; 3];
    (0..SWEEPS)
        .map(|sweep| {
            let at_s = DURATION_S * f64::from(sweep + 1) / f64::from(SWEEPS);
            drift = drift.map(|d| 0.95 * d + 0.01 * normal(random));
            let error: P =
                std::array::from_fn(|i| drift[i] * [1.0, 1.0, 0.5][i] + 0.01 * normal(random));
            let yaw = 0.002 * normal(random);
            let position = plus(ugv_at(at_s), [0.0, 0.0, 1.6]);
            let marks = sweep_marks(world, at_s, position, (error, yaw), random);
            let verdicts: Vec<_> = world
                .solids
                .iter()
                .map(|solid| Verdict::of(solid.kind, random))
                .collect();
            let seen = marks.touched().map(|(key, [hits, _], solid)| {
                if hits == 0 {
                    return (
                        key,
                        observation(Mass::free_by(0.4), Mobility::Unknown, None),
                    );
                }
                let verdict = solid.map(|solid| verdicts[solid]);
                let mobility = verdict.map_or(Mobility::Unknown, |v| v.mobility);
                (
                    key,
                    observation(
                        Mass::occupied_by(0.7),
                        mobility,
                        verdict.and_then(|v| v.detection),
                    ),
                )
            });
            let look = Look {
                source: Source::Ugv,
                at: stamp(at_s),
                view: View(position[0].floor() as u32),
            };
            (look, seen.collect())
        })
        .collect()
}

/// One turn of a 32-beam LiDAR, laid into the map from where the vehicle believes to be.
fn sweep_marks(
    world: &World,
    at_s: f64,
    position: P,
    (error, yaw): (P, f64),
    random: &mut Pcg64,
) -> Marks {
    const BEAMS: u32 = 32;
    const AROUND: u32 = 320;
    const RANGE_M: f64 = 20.0;
    let mut marks = Marks::new();
    let phase: f64 = random.random();
    for beam in 0..BEAMS {
        let elevation = (-25.0 + 40.0 * f64::from(beam) / f64::from(BEAMS - 1)).to_radians();
        for step in 0..AROUND {
            let azimuth = TAU * (f64::from(step) + phase) / f64::from(AROUND);
            let direction = turned([elevation.cos(), 0.0, elevation.sin()], azimuth);
            let met = world.cast(position, direction, at_s, &mut || random.random());
            let met = met.filter(|met| met.range_m < RANGE_M);
            if happens(random, 0.03) {
                continue; // no return from a dark or wet thing
            }
            let (range_m, went) = match met {
                // A stray return, from rain or an insect.
                _ if happens(random, 0.002) => (random.random_range(1.0..10.0), End::Return(None)),
                Some(met) => {
                    let range_m = met.range_m + 0.02 * normal(random);
                    (range_m, End::Return(met.solid))
                }
                None => (RANGE_M, End::Lost),
            };
            let ray = turned(along([0.0; 3], direction, range_m), yaw);
            let origin = plus(position, error);
            marks.ray(origin, plus(origin, ray), went);
        }
    }
    marks
}

/// Bird's-eye views from a drone ahead of the vehicle, whose position is off all along.
fn uav(world: &World, seed: u64, random: &mut Pcg64) -> anyhow::Result<Vec<Report>> {
    const VIEWS: u32 = 12;
    const OFFSET_M: f64 = 0.2;
    const JITTER_M: f64 = 0.05;
    const YAW: f64 = 0.01;
    let offset: P = std::array::from_fn(|i| [OFFSET_M, OFFSET_M, 0.05][i] * normal(random));
    let variance = OFFSET_M * OFFSET_M + JITTER_M * JITTER_M;
    let covariance =
        Matrix6::from_diagonal(&[variance, variance, 0.005, 0.0, 0.0, YAW * YAW].into());
    (0..VIEWS)
        .map(|view| {
            let at_s = DURATION_S * (f64::from(view) + 0.5) / f64::from(VIEWS);
            let position = plus(ugv_at(at_s), [6.0, 0.0, 15.0]);
            let heading = 0.3 * normal(random);
            let hover = Hover {
                position,
                heading,
                at_s,
            };
            let grid = bev(world, seed, hover, random)?;
            let jitter: P = std::array::from_fn(|i| [JITTER_M, JITTER_M, 0.02][i] * normal(random));
            let believed = plus(plus([position[0], position[1], 0.0], offset), jitter);
            let yaw = heading + YAW * normal(random);
            let view = BevView {
                grid: &grid,
                world_from_bev: Isometry::claim(Isometry3::from_parts(
                    Vector3::from(believed).into(),
                    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw),
                )),
                covariance,
            };
            let seen = view.observations(RESOLUTION_M, LOW, HIGH)?;
            let look = Look {
                source: Source::Uav,
                at: stamp(at_s),
                view: View((position[0] / 4.0).floor() as u32),
            };
            Ok((look, seen))
        })
        .collect()
}

/// Half of what the drone sees, across.
const FOOTPRINT_M: f64 = 8.0;

/// From where and when a view is taken.
#[derive(Clone, Copy)]
struct Hover {
    position: P,
    heading: f64,
    at_s: f64,
}

impl Hover {
    /// Where a point of the world is in the grid, for somebody who knows where he is.
    fn local(&self, p: P) -> Point<Bev> {
        let [dx, dy] = [p[0] - self.position[0], p[1] - self.position[1]];
        let [x, y, _] = turned([dx, dy, 0.0], -self.heading);
        Point::new(x, y, p[2])
    }

    /// Which cell of the world a cell of the grid is.
    fn place(&self, [x, y, layer]: [usize; 3]) -> [i64; 3] {
        let middle = |c: usize| (c as f64 - 63.5) * BevGrid::CELL_M;
        let [wx, wy, _] = plus(
            turned([middle(x), middle(y), 0.0], self.heading),
            self.position,
        );
        let [px, py] = [wx, wy].map(|c| (c / BevGrid::CELL_M).floor() as i64);
        [px, py, i64::try_from(layer).unwrap_or(0)]
    }
}

/// What rays from above did to a cell.
#[derive(Clone, Copy, Default)]
struct Column {
    hits: u32,
    passes: u32,
    solid: Option<usize>,
}

const LAYERS: usize = 5;

fn flat([x, y, layer]: [usize; 3]) -> usize {
    (layer * BevGrid::CELLS + y) * BevGrid::CELLS + x
}

/// The view from above: cells that rays end in, cells that they pass, and a network's mistakes about them.
fn bev(world: &World, seed: u64, hover: Hover, random: &mut Pcg64) -> anyhow::Result<BevGrid> {
    let mut grid = BevGrid::new(LAYERS)?;
    let columns = overhead(world, hover, &grid, random);
    for x in 0..BevGrid::CELLS {
        for y in 0..BevGrid::CELLS {
            for layer in 0..LAYERS {
                let at = [x, y, layer];
                let Column {
                    hits,
                    passes,
                    solid,
                } = columns[flat(at)];
                // Some cells of the world the network always gets wrong, some at times.
                let fate = fate(seed, hover.place(at));
                let is_occupied = hits >= 2 && fate > 0.04 && !happens(random, 0.05);
                let is_clear = hits < 2 && passes >= 3;
                let is_imagined = is_clear && (fate > 0.99 || happens(random, 0.01));
                let Some(cell) = grid.cell_mut(at) else {
                    continue;
                };
                if is_occupied || is_imagined {
                    let kind = solid.map(|solid| world.solids[solid].kind);
                    cell.mass = Mass::occupied_by(0.6);
                    cell.mobility =
                        kind.map_or(Mobility::Unknown, |kind| Verdict::of(kind, random).mobility);
                } else if is_clear {
                    cell.mass = Mass::free_by(0.5);
                }
            }
        }
    }
    Ok(grid)
}

/// What a depth camera that looks down finds in each cell.
fn overhead(world: &World, hover: Hover, grid: &BevGrid, random: &mut Pcg64) -> Vec<Column> {
    const RAYS: u32 = 120;
    const STEP_M: f64 = 0.15;
    const TOP_M: f64 = 2.5;
    let mut columns = vec![Column::default(); LAYERS * BevGrid::CELLS * BevGrid::CELLS];
    let position = hover.position;
    for i in 0..RAYS * RAYS {
        let mut to = |i: u32| {
            let share = (f64::from(i) + random.random::<f64>()) / f64::from(RAYS);
            FOOTPRINT_M * (2.0 * share - 1.0)
        };
        let aim = turned([to(i % RAYS), to(i / RAYS), 0.0], hover.heading);
        let down = Vector3::new(aim[0], aim[1], -position[2]).normalize();
        let direction = [down.x, down.y, down.z];
        let Some(met) = world.cast(position, direction, hover.at_s, &mut || random.random()) else {
            continue;
        };
        let range_m = met.range_m + 0.04 * normal(random);
        let cell_at = |range_m: f64| grid.cell_at(hover.local(along(position, direction, range_m)));
        let end = cell_at(range_m);
        let mut last = None;
        let mut at_m = (position[2] - TOP_M) / -direction[2];
        while at_m < range_m {
            let cell = cell_at(at_m);
            if let Some(cell) = cell.filter(|_| cell != last && cell != end) {
                columns[flat(cell)].passes += 1;
            }
            last = cell;
            at_m += STEP_M;
        }
        let Some(end) = end else { continue };
        let column = &mut columns[flat(end)];
        // The ground does not make its cell occupied.
        if met.solid.is_some() {
            column.hits += 1;
            column.solid = met.solid;
        } else {
            column.passes += 1;
        }
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_visits_each_voxel_between_its_ends_once() {
        let keys: Vec<_> = walk([0.05, 0.05, 0.05], [0.5, -0.2, 0.0]).collect();
        assert_eq!(keys.first(), Some(&VoxelKey::new(0, 0, 0)));
        assert_eq!(keys.last(), Some(&VoxelKey::new(5, -2, 0)));
        assert_eq!(keys.len(), 8, "five steps along x, two along y");
    }

    #[test]
    fn every_source_speaks_and_the_same_seed_says_the_same() {
        let speak = || {
            Recording::of(Scene::ResidentialAlley, 3)
                .expect("good poses")
                .thinned()
        };
        let (one, other) = (speak(), speak());
        assert_eq!(one.reports, other.reports);
        for source in Source::ALL {
            let said: usize = one
                .reports
                .iter()
                .filter(|(look, _)| look.source == source)
                .map(|(_, seen)| seen.len())
                .sum();
            assert!(said > 1000, "{source:?} {said}");
        }
        assert!(one.reports.is_sorted_by_key(|(look, _)| look.at));
    }
}
