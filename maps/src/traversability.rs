//! Where a ground vehicle can drive: one surface per column of the map, what hinders there, and how far it is to it.
//!
//! Every cell of a 2-D grid at the map's resolution is *drivable*, with the height of its ground and a cost, *blocked* (a
//! step, a slope, an obstacle in the height band of the vehicle) or *unknown* (no ground was seen). What hangs higher
//! over the ground than the vehicle is tall does not hinder: a table, a bridge, a ceiling. One surface means that a bridge
//! is driven under or over, not both: which of them follows from where the vehicle stands
//! ([`ground::GroundSettings::at`]). How the cells follow from voxels is told in [`ground`], and why one is blocked in its
//! [`Details`].
//!
//! The grid knows for every cell how far the nearest blocked cell is, exactly, measured to its edge; what lies outside the
//! grid is unknown.

mod distance;
pub mod ground;
mod layers;

pub use layers::{ClassRule, ClassRules, Details, Hindrance, Layer};

use crate::frame::{Point, World};

/// The widest grid along either axis, in cells (205 m at 0.05 m). A larger map is cut around the middle of what is known.
pub const MAX_EDGE_CELLS: usize = 4096;

/// A car-like vehicle. Its reference point is the middle of the rear axle, on the ground: poses, paths and turning radii
/// are those of that point. The footprint is a rectangle whose overhangs before the front and behind the rear axle are
/// equal, so its centre is half a wheelbase ahead of the reference point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vehicle {
    /// Length of the footprint.
    pub length_m: f64,
    /// Width of the footprint.
    pub width_m: f64,
    /// Height: what hangs lower over the ground is an obstacle.
    pub height_m: f64,
    /// Distance between the axles.
    pub wheelbase_m: f64,
    /// Smallest radius the middle of the rear axle can follow, forward and in reverse.
    pub min_turning_radius_m: f64,
    /// Highest step it climbs.
    pub max_step_m: f64,
    /// Steepest slope it climbs, in any direction.
    pub max_slope_rad: f64,
}

impl Default for Vehicle {
    /// The small rover of the demo: 0.42 m × 0.30 m, turning within 0.45 m.
    fn default() -> Self {
        Self {
            length_m: 0.42,
            width_m: 0.30,
            height_m: 0.35,
            wheelbase_m: 0.26,
            min_turning_radius_m: 0.45,
            max_step_m: 0.05,
            max_slope_rad: 0.35,
        }
    }
}

/// What is known of driving over one cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cell {
    /// No ground was seen here.
    Unknown,
    /// The ground is `height_m` above the world's origin; each metre over it costs `1 + cost` metres of flat ground.
    Drivable {
        /// Height of the ground.
        height_m: f64,
        /// Extra cost per metre for slope, roughness and bridged gaps; 0 is best.
        cost: f64,
    },
    /// The vehicle must not be here.
    Blocked,
}

/// One cell of a grid: `x` columns east and `y` rows north of the south-western one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellIndex {
    /// Column, growing east.
    pub x: usize,
    /// Row, growing north.
    pub y: usize,
}

/// Why cells do not make a grid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GridError {
    /// The numbers of cells do not agree.
    #[error("a grid {width} cells wide cannot have {cells} cells")]
    Shape {
        /// Cells along x.
        width: usize,
        /// Cells in all.
        cells: usize,
    },
    /// More than [`MAX_EDGE_CELLS`] along one axis.
    #[error("a grid of {width} x {height} cells is larger than {MAX_EDGE_CELLS} along one axis")]
    TooLarge {
        /// Cells along x.
        width: usize,
        /// Cells along y.
        height: usize,
    },
    /// The resolution is not a positive number or the origin not finite.
    #[error("a grid cannot have its origin at ({x_m}, {y_m}) m and cells of {resolution_m} m")]
    Geometry {
        /// Western edge.
        x_m: f64,
        /// Southern edge.
        y_m: f64,
        /// Edge of a cell.
        resolution_m: f64,
    },
}

/// Where a vehicle can drive, on a grid with its first cell in the south-west.
#[derive(Clone, Debug, PartialEq)]
pub struct Traversability {
    origin_m: [f64; 2],
    resolution_m: f64,
    width: usize,
    cells: Vec<Cell>,
    to_blocked: Vec<f32>,
    to_untrusted: Vec<f32>,
    /// Empty if the grid was not made from a map.
    details: Vec<Details>,
}

impl Traversability {
    /// A grid of given cells, row by row from the south, its south-western corner at `origin_m` (x, y).
    pub fn from_cells(
        origin_m: [f64; 2],
        resolution_m: f64,
        width: usize,
        cells: Vec<Cell>,
    ) -> Result<Self, GridError> {
        if (width == 0 && !cells.is_empty()) || (width > 0 && !cells.len().is_multiple_of(width)) {
            return Err(GridError::Shape {
                width,
                cells: cells.len(),
            });
        }
        let height = cells.len().checked_div(width).unwrap_or(0);
        if width.max(height) > MAX_EDGE_CELLS {
            return Err(GridError::TooLarge { width, height });
        }
        let [x_m, y_m] = origin_m;
        if !(x_m.is_finite() && y_m.is_finite() && resolution_m.is_finite() && resolution_m > 0.0) {
            return Err(GridError::Geometry {
                x_m,
                y_m,
                resolution_m,
            });
        }
        let marked = |hinders: fn(&Cell) -> bool| {
            let marked: Vec<bool> = cells.iter().map(hinders).collect();
            distance::to_marked(&marked, width, resolution_m)
        };
        let to_blocked = marked(|cell| matches!(cell, Cell::Blocked));
        let to_untrusted = marked(|cell| !matches!(cell, Cell::Drivable { .. }));
        Ok(Self {
            origin_m,
            resolution_m,
            width,
            cells,
            to_blocked,
            to_untrusted,
            details: Vec::new(),
        })
    }

    fn empty(resolution_m: f64) -> Self {
        Self {
            origin_m: [0.0; 2],
            resolution_m,
            width: 0,
            cells: Vec::new(),
            to_blocked: Vec::new(),
            to_untrusted: Vec::new(),
            details: Vec::new(),
        }
    }

    /// Cells along x and along y.
    pub fn size(&self) -> (usize, usize) {
        let height = self.cells.len().checked_div(self.width).unwrap_or(0);
        (self.width, height)
    }

    /// The south-western corner of the first cell, (x, y).
    pub fn origin_m(&self) -> [f64; 2] {
        self.origin_m
    }

    /// Edge of a cell.
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// The cell at a place; `None` outside the grid or for a place that is not finite.
    pub fn index_of(&self, x_m: f64, y_m: f64) -> Option<CellIndex> {
        let (width, height) = self.size();
        let along = |at: f64, origin: f64, count: usize| {
            let cell = (at - origin) / self.resolution_m;
            (cell >= 0.0 && cell < count as f64).then_some(cell as usize)
        };
        Some(CellIndex {
            x: along(x_m, self.origin_m[0], width)?,
            y: along(y_m, self.origin_m[1], height)?,
        })
    }

    /// The middle of a cell, (x, y).
    pub fn center_of(&self, index: CellIndex) -> [f64; 2] {
        [
            self.origin_m[0] + (index.x as f64 + 0.5) * self.resolution_m,
            self.origin_m[1] + (index.y as f64 + 0.5) * self.resolution_m,
        ]
    }

    /// What is known at a place; outside the grid nothing is.
    pub fn cell(&self, x_m: f64, y_m: f64) -> Cell {
        self.index_of(x_m, y_m)
            .map_or(Cell::Unknown, |index| self.cell_at(index))
    }

    /// What is known of a cell; outside the grid nothing is.
    pub fn cell_at(&self, index: CellIndex) -> Cell {
        let (width, height) = self.size();
        if index.x < width && index.y < height {
            self.cells[index.y * width + index.x]
        } else {
            Cell::Unknown
        }
    }

    /// What was measured on a cell; none outside, or where the grid was not made from a map.
    pub fn details(&self, index: CellIndex) -> Option<&Details> {
        let (width, height) = self.size();
        let inside = index.x < width && index.y < height;
        self.details
            .get(index.y * width + index.x)
            .filter(|_| inside)
    }

    /// Why a cell is blocked; none where it is not, or where that is not known.
    pub fn hindrance(&self, index: CellIndex) -> Option<Hindrance> {
        self.details(index)?.hindrance
    }

    /// One kind of what is known of a cell; none where there is nothing to show.
    pub fn layer(&self, layer: Layer, index: CellIndex) -> Option<f64> {
        let (width, height) = self.size();
        if index.x >= width || index.y >= height {
            return None;
        }
        let at = index.y * width + index.x;
        let (height_m, cost) = match self.cells[at] {
            Cell::Drivable { height_m, cost } => (Some(height_m), Some(cost)),
            Cell::Unknown | Cell::Blocked => (None, None),
        };
        let details = self.details.get(at);
        let seen = details.filter(|_| self.cells[at] != Cell::Unknown);
        match layer {
            Layer::Height => height_m,
            Layer::Cost => cost,
            Layer::Clearance => Some(f64::from(self.to_blocked[at])).filter(|d| d.is_finite()),
            Layer::Step => seen.map(|d| f64::from(d.step_m)),
            Layer::Slope => seen.map(|d| f64::from(d.slope_rad)),
            Layer::Roughness => seen.map(|d| f64::from(d.roughness_m)),
            Layer::Headroom => seen
                .map(|d| f64::from(d.headroom_m))
                .filter(|d| d.is_finite()),
            Layer::Class => seen
                .filter(|d| d.class != crate::voxel::ClassId::NONE)
                .map(|d| f64::from(d.class.0)),
        }
    }

    /// Every cell, row by row from the south-west.
    pub fn cells(&self) -> impl Iterator<Item = (CellIndex, Cell)> + '_ {
        self.cells.iter().enumerate().map(|(i, &cell)| {
            let index = CellIndex {
                x: i % self.width,
                y: i / self.width,
            };
            (index, cell)
        })
    }

    /// The ground at a place, where it is drivable.
    pub fn on_ground(&self, x_m: f64, y_m: f64) -> Option<Point<World>> {
        match self.cell(x_m, y_m) {
            Cell::Drivable { height_m, .. } => Some(Point::new(x_m, y_m, height_m)),
            Cell::Unknown | Cell::Blocked => None,
        }
    }

    /// Distance from a place to the edge of the nearest blocked cell: 0 inside one, infinite if there is none, NaN for a
    /// place that is not finite. Exact at the middle of a cell; elsewhere never too large, and too small by 0.7 cells at
    /// most.
    pub fn clearance_m(&self, x_m: f64, y_m: f64) -> f64 {
        self.bounds_at(&self.to_blocked, x_m, y_m)[0]
    }

    /// Distance from the middle of each cell to the nearest blocked one, row by row.
    pub(crate) fn to_blocked(&self) -> &[f32] {
        &self.to_blocked
    }

    /// Distance from the middle of each cell to the nearest blocked or unknown one, row by row. What lies outside the
    /// grid does not count.
    pub(crate) fn to_untrusted(&self) -> &[f32] {
        &self.to_untrusted
    }

    /// A copy in which the unknown cells that `covers` selects do not count as untrusted: their distances, row by row.
    pub(crate) fn to_untrusted_except(&self, covers: impl Fn([f64; 2]) -> bool) -> Vec<f32> {
        let marked: Vec<bool> = self
            .cells()
            .map(|(index, cell)| match cell {
                Cell::Drivable { .. } => false,
                Cell::Blocked => true,
                Cell::Unknown => !covers(self.center_of(index)),
            })
            .collect();
        distance::to_marked(&marked, self.width, self.resolution_m)
    }

    /// The cell nearest to a place, inside the grid or not; `None` in a grid without cells.
    pub(crate) fn nearest_index(&self, x_m: f64, y_m: f64) -> Option<CellIndex> {
        let (width, height) = self.size();
        let along = |at: f64, origin: f64, count: usize| {
            let cell = (at - origin) / self.resolution_m;
            Some(cell.clamp(0.0, count.checked_sub(1)? as f64) as usize)
        };
        Some(CellIndex {
            x: along(x_m, self.origin_m[0], width)?,
            y: along(y_m, self.origin_m[1], height)?,
        })
    }

    /// A lower and an upper bound of a distance that is known at the middle of the cells: it changes by no more than the way
    /// there.
    pub(crate) fn bounds_at(&self, distances: &[f32], x_m: f64, y_m: f64) -> [f64; 2] {
        let Some(index) = self.nearest_index(x_m, y_m) else {
            return [f64::INFINITY; 2];
        };
        let [cx, cy] = self.center_of(index);
        let known = f64::from(distances[index.y * self.width + index.x]);
        let (dx, dy) = (x_m - cx, y_m - cy);
        let way = (dx * dx + dy * dy).sqrt();
        let least = known - way;
        let least = if least.is_nan() {
            least
        } else {
            least.max(0.0)
        };
        [least, known + way]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLAT: Cell = Cell::Drivable {
        height_m: 0.0,
        cost: 0.0,
    };

    fn one_blocked_of_5_by_3() -> Traversability {
        let mut cells = vec![FLAT; 15];
        cells[5 + 1] = Cell::Blocked;
        Traversability::from_cells([10.0, 20.0], 0.1, 5, cells).expect("a grid")
    }

    #[test]
    fn clearance_is_measured_from_the_edge_of_the_blocked_cell() {
        let grid = one_blocked_of_5_by_3();
        let from_three_cells_east = grid.clearance_m(10.45, 20.15);
        assert!((from_three_cells_east - 0.25).abs() < 1e-6, "2.5 cells");
        assert!(grid.clearance_m(10.15, 20.15).abs() < 1e-9, "inside");
        assert!(grid.clearance_m(10.41, 20.15) <= 0.21 + 1e-6, "never more");
        assert!(grid.clearance_m(f64::NAN, 20.0).is_nan());
    }

    #[test]
    fn outside_the_grid_nothing_is_known() {
        let grid = one_blocked_of_5_by_3();
        assert_eq!(grid.cell(9.99, 20.1), Cell::Unknown);
        assert_eq!(grid.cell(10.51, 20.1), Cell::Unknown);
        assert_eq!(grid.cell(f64::NAN, 20.1), Cell::Unknown);
        assert_eq!(grid.cell(f64::INFINITY, 20.1), Cell::Unknown);
        assert_eq!(grid.cell(10.01, 20.01), FLAT);
        assert_eq!(grid.cell_at(CellIndex { x: 5, y: 0 }), Cell::Unknown);
        assert_eq!(grid.on_ground(10.15, 20.15), None, "blocked");
    }

    #[test]
    fn cells_that_make_no_grid_are_refused() {
        let shape = Traversability::from_cells([0.0, 0.0], 0.1, 4, vec![FLAT; 15]);
        assert!(matches!(shape, Err(GridError::Shape { .. })));
        let wide = Traversability::from_cells([0.0, 0.0], 0.1, 5000, vec![FLAT; 5000]);
        assert!(matches!(wide, Err(GridError::TooLarge { .. })));
        for resolution_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let grid = Traversability::from_cells([0.0, 0.0], resolution_m, 1, vec![FLAT]);
            assert!(
                matches!(grid, Err(GridError::Geometry { .. })),
                "{resolution_m}"
            );
        }
        let empty = Traversability::from_cells([0.0, 0.0], 0.1, 0, Vec::new()).expect("no cells");
        assert_eq!(empty.size(), (0, 0));
        assert_eq!(empty.cell(0.0, 0.0), Cell::Unknown);
        assert!(empty.clearance_m(0.0, 0.0).is_infinite());
    }

    #[test]
    fn a_cells_middle_is_in_that_cell() {
        let grid = one_blocked_of_5_by_3();
        for (index, cell) in grid.cells() {
            let [x, y] = grid.center_of(index);
            assert_eq!(grid.index_of(x, y), Some(index));
            assert_eq!(grid.cell(x, y), cell);
        }
    }
}
