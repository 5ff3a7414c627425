//! Grids around a vehicle that are filled from the faces of the scene themselves.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point2, Point3, Vector3};

use crate::render::Moment;
use crate::scene::{Class, Face};

/// Cells along an edge of the street from above, and of the voxels.
pub(super) const BEV_CELLS: usize = 128;
/// Edge of a cell and of a voxel.
pub(super) const BEV_CELL_M: f64 = 0.5;
/// Layers of voxels.
pub(super) const LAYERS: usize = 16;
/// The bottom of the lowest layer, above the ground below the vehicle: the road is in the middle of the second layer.
pub(super) const LOWEST_M: f64 = -0.75;
/// Faces are sampled this often along the edge of a voxel.
const SAMPLES: f64 = 4.0;

/// A square grid from above around a frame: row 0 is farthest ahead, column 0 farthest to the left.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    pub(super) cells: usize,
    pub(super) cell_m: f64,
}

impl Grid {
    /// Where the middle of a cell is, forward and to the left.
    pub(super) fn middle(self, row: usize, column: usize) -> Point2<f64> {
        let from_middle =
            |index: usize| (self.cells as f64 / 2.0 - index as f64 - 0.5) * self.cell_m;
        Point2::new(from_middle(row), from_middle(column))
    }

    /// Row (or column) of a coordinate, perhaps outside.
    fn index(self, forward_or_left: f64) -> f64 {
        self.cells as f64 / 2.0 - forward_or_left / self.cell_m
    }

    /// Marks the cells of which the middle lies in a convex outline, counter-clockwise from above, or this close to it.
    pub(super) fn fill(self, outline: &[Point2<f64>], near_m: f64, mut mark: impl FnMut(usize)) {
        let range = |axis: usize| {
            let at = |p: &Point2<f64>| self.index(p[axis]);
            let low = outline.iter().map(at).fold(f64::INFINITY, f64::min);
            let high = outline.iter().map(at).fold(f64::NEG_INFINITY, f64::max);
            let [low, high] = [low - near_m / self.cell_m, high + near_m / self.cell_m];
            // A saturating cast: what is outside is cut off.
            (low.max(0.0) as usize)..(high.max(0.0).ceil() as usize).min(self.cells)
        };
        for row in range(0) {
            for column in range(1) {
                let middle = self.middle(row, column);
                let is_left_of = |i: usize| {
                    let (from, to) = (outline[i], outline[(i + 1) % outline.len()]);
                    (to - from).perp(&(middle - from)) >= -near_m * (to - from).norm()
                };
                if (0..outline.len()).all(is_left_of) {
                    mark(row * self.cells + column);
                }
            }
        }
    }
}

/// The class of the surface that covers most of each voxel at that moment: layer by layer from the lowest, each laid out as
/// [`Grid`]; [`Class::Sky`] where there is none.
pub(super) fn voxels(moment: &Moment<'_>, world_from_body: &Isometry3<f64>) -> Vec<Class> {
    let (scene, body_from_world) = (moment.scene(), world_from_body.inverse());
    let mut counts: BTreeMap<(usize, Class), u32> = BTreeMap::new();
    for face in moment.faces() {
        let class = scene.class_of(face.instance);
        let corners = face.corners().map(|corner| body_from_world * corner.raw);
        if is_outside(&corners) {
            continue;
        }
        let edges = [face.edge_u, face.edge_v].map(|edge| body_from_world * edge.raw);
        each_sample(face, (corners[0], edges), |place| {
            if let Some(voxel) = voxel_of(place) {
                *counts.entry((voxel, class)).or_default() += 1;
            }
        });
    }
    let mut most = vec![(0, Class::Sky); LAYERS * BEV_CELLS * BEV_CELLS];
    for ((voxel, class), count) in counts {
        if count > most[voxel].0 {
            most[voxel] = (count, class);
        }
    }
    most.into_iter().map(|(_, class)| class).collect()
}

fn voxel_of(place: Point3<f64>) -> Option<usize> {
    let half = BEV_CELLS as f64 / 2.0;
    let indices = [
        (place.z - LOWEST_M) / BEV_CELL_M,
        half - place.x / BEV_CELL_M,
        half - place.y / BEV_CELL_M,
    ];
    let [layer, row, column] = indices.map(f64::floor);
    let size = BEV_CELLS as f64;
    let is_inside = (0.0..LAYERS as f64).contains(&layer)
        && (0.0..size).contains(&row)
        && (0.0..size).contains(&column);
    is_inside.then_some((layer as usize * BEV_CELLS + row as usize) * BEV_CELLS + column as usize)
}

fn is_outside(corners: &[Point3<f64>; 4]) -> bool {
    let half = BEV_CELLS as f64 * BEV_CELL_M / 2.0;
    let highest = LOWEST_M + LAYERS as f64 * BEV_CELL_M;
    let beyond = |axis: usize, low: f64, high: f64| {
        corners.iter().all(|corner| corner[axis] < low)
            || corners.iter().all(|corner| corner[axis] > high)
    };
    beyond(0, -half, half) || beyond(1, -half, half) || beyond(2, LOWEST_M, highest)
}

/// Places on a face, not farther from one another than a share of a voxel; the smallest face has one.
fn each_sample(
    face: &Face,
    (corner, [u, v]): (Point3<f64>, [Vector3<f64>; 2]),
    mut sample: impl FnMut(Point3<f64>),
) {
    let step_m = BEV_CELL_M / SAMPLES;
    let rows = (v.norm() / step_m).ceil().max(1.0);
    for row in 0..rows as usize {
        let up = (row as f64 + 0.5) / rows;
        let [left, right] = [face.top[0] * up, 1.0 + (face.top[1] - 1.0) * up];
        let columns = ((right - left) * u.norm() / step_m).ceil().max(1.0);
        for column in 0..columns as usize {
            let along = left + (right - left) * (column as f64 + 0.5) / columns;
            sample(corner + u * along + v * up);
        }
    }
}

#[cfg(test)]
mod tests {
    use maps::time::Stamp;

    use super::*;
    use crate::platform;
    use crate::render::Stage;
    use crate::scene::{Name, Scene};
    use crate::truth::boxes;

    #[test]
    fn cells_are_filled_where_their_middle_is_inside() {
        let grid = Grid {
            cells: 4,
            cell_m: 1.0,
        };
        let mut filled = Vec::new();
        // From 0 to 1.9 ahead, from 0.4 right to 1.1 left.
        let outline = [(0.0, -0.4), (1.9, -0.4), (1.9, 1.1), (0.0, 1.1)];
        grid.fill(&outline.map(|(x, y)| Point2::new(x, y)), 0.0, |cell| {
            filled.push(cell);
        });
        assert_eq!(filled, [1, 5]);
        let far = [(50.0, 50.0), (60.0, 50.0), (60.0, 60.0)];
        grid.fill(&far.map(|(x, y)| Point2::new(x, y)), 0.0, |cell| {
            panic!("{cell} is filled");
        });
    }

    #[test]
    fn voxels_of_cars_are_in_the_boxes_of_cars_and_the_road_is_one_layer() {
        let scene = Scene::generate(Name::ResidentialAlley, 1002);
        let at = Stamp::from_nanos(6_000_000_000);
        let body = platform::ugv(&scene, at).raw;
        let voxels = voxels(&Stage::new(&scene).at(at), &body);
        let cars = boxes(&scene, at);
        let cars: Vec<_> = cars
            .iter()
            .filter(|user| user.thing.class == Class::Car)
            .collect();
        let grid = Grid {
            cells: BEV_CELLS,
            cell_m: BEV_CELL_M,
        };
        let mut found = 0;
        for (i, class) in voxels.iter().enumerate() {
            let (layer, cell) = (i / (BEV_CELLS * BEV_CELLS), i % (BEV_CELLS * BEV_CELLS));
            if *class == Class::Road {
                assert_eq!(layer, 1, "the road is level");
            }
            if *class == Class::Car {
                let middle = grid.middle(cell / BEV_CELLS, cell % BEV_CELLS);
                let place = body * Point3::new(middle.x, middle.y, 0.0);
                // Mirrors stick out, and then half the diagonal of a voxel.
                let near = cars.iter().any(|car| {
                    let p = car.thing.place.inverse() * place;
                    let half = car.thing.size / 2.0;
                    p.x.abs() < half.x + 0.36 && p.y.abs() < half.y + 0.36 + 0.25
                });
                assert!(near, "{middle}, layer {layer}");
                found += 1;
            }
        }
        assert!(found > 100, "{found} voxels");
    }
}
