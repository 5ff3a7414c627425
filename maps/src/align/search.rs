//! Where to start: the guess is metres and degrees off, more than a step of Gauss and Newton can mend.
//!
//! Positions and yaws within three standard deviations of the guess are scored on a coarse grid: the share of samples that
//! land in a cell of the map with a surface of their kind, or beside one. A few samples score all poses, more score the
//! best of those, and the best that are well apart become the starts.
//!
//! - E. Olson, *Real-time correlative scan matching*, ICRA 2009.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::source::{Sample, Source};
use super::surface::{Level, Shape};

/// Samples that score every pose, and those that score the best again.
const FEW: usize = 250;
const MORE: usize = 1500;
/// How many poses are scored again.
const BEST: usize = 400;
/// How many starts there are at most, the guess among them.
const STARTS: usize = 8;
/// Samples further than this from their mean do not take part in the search.
const FARTHEST_M: f64 = 100.0;
/// Cells of the grid at most: the search gives way to the guess alone in a map that is that high all around.
const MOST_CELLS: usize = 1 << 24;
/// Poses at most: the steps grow until there are no more.
const MOST_POSES: usize = 1 << 18;
/// A sample in a cell with a surface of its kind counts this much, in a cell beside one [`BESIDE`].
const WITHIN: u8 = 3;
const BESIDE: u8 = 2;

/// How far to look around the guess.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    /// Along each axis of the world.
    pub(super) reach_m: Vector3<f64>,
    pub(super) yaw_rad: f64,
}

/// Poses from which to refine, the guess first, then the best.
pub(super) fn starts(
    level: &Level,
    source: &Source,
    guess: &Isometry3<f64>,
    window: &Window,
) -> Vec<Isometry3<f64>> {
    let Some(grid) = Grid::around(level, source, guess, window) else {
        return vec![*guess];
    };
    let lattice = Lattice::over(window, 1.5 * level.cell_m, source.radius_m);
    let poses = lattice.poses();
    let mut scored = score_all(&grid, &lattice, &source.thinned(FEW), guess, &poses);
    scored.truncate(BEST);
    let chosen: Vec<Step> = scored.into_iter().map(|(_, step)| step).collect();
    let scored = score_all(&grid, &lattice, &source.thinned(MORE), guess, &chosen);
    let mut kept: Vec<Step> = Vec::new();
    for (_, step) in scored {
        let apart = |other: &Step| (0..4).any(|axis| (step[axis] - other[axis]).abs() > 1);
        if kept.iter().all(apart) {
            kept.push(step);
        }
        if kept.len() == STARTS - 1 {
            break;
        }
    }
    let found = kept.iter().map(|step| lattice.pose(guess, *step));
    std::iter::once(*guess).chain(found).collect()
}

/// Steps from the guess: east, north, up, yaw.
type Step = [i32; 4];

/// The poses that are tried.
struct Lattice {
    step_m: f64,
    step_rad: f64,
    most: Step,
}

impl Lattice {
    fn over(window: &Window, step_m: f64, radius_m: f64) -> Self {
        let mut coarser = 1.0;
        loop {
            let step_m = step_m * coarser;
            let step_rad = step_m / radius_m;
            let most = |reach: f64, step: f64| (reach / step).ceil() as i32; // saturates
            let lattice = Self {
                step_m,
                step_rad,
                most: [
                    most(window.reach_m.x, step_m),
                    most(window.reach_m.y, step_m),
                    most(window.reach_m.z, step_m),
                    most(window.yaw_rad, step_rad),
                ],
            };
            let count: f64 = lattice
                .most
                .iter()
                .map(|m| 2.0 * f64::from(*m) + 1.0)
                .product();
            if count <= MOST_POSES as f64 {
                return lattice;
            }
            coarser *= 1.2;
        }
    }

    /// All steps, by yaw first.
    fn poses(&self) -> Vec<Step> {
        let range = |axis: usize| -self.most[axis]..=self.most[axis];
        let mut poses = Vec::new();
        for yaw in range(3) {
            for z in range(2) {
                for y in range(1) {
                    poses.extend(range(0).map(|x| [x, y, z, yaw]));
                }
            }
        }
        poses
    }

    fn turn(&self, yaw: i32) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), f64::from(yaw) * self.step_rad)
    }

    fn shift(&self, [x, y, z, _]: Step) -> Vector3<f64> {
        Vector3::new(f64::from(x), f64::from(y), f64::from(z)) * self.step_m
    }

    /// The guess, turned about the centre of the source and moved.
    fn pose(&self, guess: &Isometry3<f64>, step: Step) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::from(guess.translation.vector + self.shift(step)),
            self.turn(step[3]) * guess.rotation,
        )
    }
}

/// Scores poses, best first; of equals, the one nearest to the guess.
fn score_all(
    grid: &Grid,
    lattice: &Lattice,
    samples: &[Sample],
    guess: &Isometry3<f64>,
    poses: &[Step],
) -> Vec<(u32, Step)> {
    // Turned samples by yaw, in cells of the grid.
    let turned: Vec<Vec<(Vector3<f32>, usize)>> = (-lattice.most[3]..=lattice.most[3])
        .map(|yaw| {
            let rotation = lattice.turn(yaw) * guess.rotation;
            let landed = |sample: &Sample| {
                let at = rotation * sample.at + guess.translation.vector - grid.corner;
                let kind = Kind::of(sample.shape, &(rotation * sample.axis));
                ((at / grid.cell_m).cast::<f32>(), kind as usize)
            };
            samples.iter().map(landed).collect()
        })
        .collect();
    let mut scored: Vec<(u32, Step)> = poses
        .par_iter()
        .map(|step| {
            let shift = (lattice.shift(*step) / grid.cell_m).cast::<f32>();
            let at_yaw = &turned[(step[3] + lattice.most[3]) as usize];
            let score = at_yaw
                .iter()
                .map(|(at, kind)| u32::from(grid.score(at + shift, *kind)))
                .sum();
            (score, *step)
        })
        .collect();
    let far = |step: &Step| step.iter().map(|c| i64::from(*c).pow(2)).sum::<i64>();
    scored.sort_by_key(|(score, step)| (std::cmp::Reverse(*score), far(step), *step));
    scored
}

/// The kinds of surface told apart while searching.
#[derive(Clone, Copy)]
enum Kind {
    Level,
    Upright,
    Any,
}

impl Kind {
    fn of(shape: Shape, axis: &Vector3<f64>) -> Self {
        match shape {
            Shape::Plane if axis.z.abs() > 0.8 => Self::Level,
            Shape::Plane if axis.z.abs() < 0.5 => Self::Upright,
            Shape::Line if axis.z.abs() > 0.8 => Self::Upright,
            _ => Self::Any,
        }
    }
}

/// Scores by cell and kind of sample, dense around the guess.
struct Grid {
    cell_m: f64,
    corner: Vector3<f64>,
    size: [usize; 3],
    scores: Vec<[u8; 3]>,
}

impl Grid {
    /// `None` if no surface of the map is within reach.
    fn around(
        level: &Level,
        source: &Source,
        guess: &Isometry3<f64>,
        window: &Window,
    ) -> Option<Self> {
        let cell_m = level.cell_m;
        let reach = window.reach_m.add_scalar(2.0 * cell_m);
        let farthest = source
            .samples
            .iter()
            .map(|s| s.at.norm())
            .fold(0.0, f64::max)
            .min(FARTHEST_M);
        let around = reach.add_scalar(farthest);
        let near = |p: &Vector3<f64>| {
            let d = p - guess.translation.vector;
            (0..3).all(|axis| d[axis].abs() <= around[axis])
        };
        let surfaces: Vec<_> = level.surfaces.iter().filter(|s| near(&s.center)).collect();
        let first = surfaces.first()?.center;
        let (low, high) = surfaces.iter().fold((first, first), |(low, high), s| {
            (low.inf(&s.center), high.sup(&s.center))
        });
        let corner = low.map(|c| ((c / cell_m).floor() - 1.0) * cell_m);
        let size: [usize; 3] =
            std::array::from_fn(|axis| ((high[axis] - corner[axis]) / cell_m) as usize + 2);
        if size.iter().map(|n| *n as f64).product::<f64>() > MOST_CELLS as f64 {
            return None;
        }
        let mut grid = Self {
            cell_m,
            corner,
            size,
            scores: vec![[0; 3]; size.iter().product()],
        };
        for surface in surfaces {
            grid.add(&surface.center, Kind::of(surface.shape, &surface.axis));
        }
        Some(grid)
    }

    fn add(&mut self, center: &Vector3<f64>, kind: Kind) {
        let kinds: &[usize] = match kind {
            Kind::Level => &[0, 2],
            Kind::Upright => &[1, 2],
            Kind::Any => &[0, 1, 2],
        };
        let at = (center - self.corner) / self.cell_m;
        let beside = [
            [0, 0, 0],
            [1, 0, 0],
            [-1, 0, 0],
            [0, 1, 0],
            [0, -1, 0],
            [0, 0, 1],
            [0, 0, -1],
        ];
        for step in beside {
            let value = if step == [0; 3] { WITHIN } else { BESIDE };
            let there = (at + Vector3::from(step.map(f64::from))).cast::<f32>();
            let Some(cell) = self.cell(there) else {
                continue;
            };
            for &kind in kinds {
                let score = &mut self.scores[cell][kind];
                *score = (*score).max(value);
            }
        }
    }

    fn score(&self, at: Vector3<f32>, kind: usize) -> u8 {
        self.cell(at).map_or(0, |cell| self.scores[cell][kind])
    }

    fn cell(&self, at: Vector3<f32>) -> Option<usize> {
        // Casts saturate: what is below the corner must be told apart from the first cell.
        if at.x < 0.0 || at.y < 0.0 || at.z < 0.0 {
            return None;
        }
        let [x, y, z] = [at.x as usize, at.y as usize, at.z as usize];
        let inside = x < self.size[0] && y < self.size[1] && z < self.size[2];
        inside.then(|| (z * self.size[1] + y) * self.size[0] + x)
    }
}
