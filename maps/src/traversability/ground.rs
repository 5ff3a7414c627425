//! Which cells a vehicle can drive on, from the voxels of each column.
//!
//! 1. The top of every occupied run with enough room for the vehicle above it is a surface. Surfaces of neighbouring
//!    columns at about the same height belong together. If it is known where the vehicle stands, the ground is what it can
//!    get to from there, in each column what it gets to first; else it is the lowest of the large ones. Whatever continues
//!    it is ground, too.
//! 2. The ground's height is the median of 5 × 5 columns, so that a voxel too high or too low is neither a step nor a hole,
//!    while a kerb, which is long, remains one.
//! 3. A cell is blocked by a *step* to a neighbour, by a *slope* of the plane through the ground under the vehicle, or by an
//!    *obstacle*: something between the highest step and the vehicle's height over the ground. Where no ground was seen, the
//!    nearest ground stands in.
//! 4. What remains is unknown, save for gaps that drivable ground closes around (morphological closing) at one height and
//!    through which no ray was seen to go deeper.
//!
//! A height is known to half a voxel at best. A rise of less than 1.5 voxels is therefore never a step, whatever the
//! vehicle's limit: for a limit below that, choose smaller voxels.

mod columns;
mod surface;

use crate::frame::{Point, World};
use crate::traversability::{
    Cell, ClassRule, ClassRules, Details, GridError, Hindrance, MAX_EDGE_CELLS, Traversability,
    Vehicle, distance,
};
use crate::voxel::VoxelMap;
use columns::Columns;
use surface::Surface;

/// How the ground is found and judged.
#[derive(Clone, Debug, PartialEq)]
pub struct GroundSettings {
    /// Gaps in the seen ground up to twice as wide are bridged at a cost; 0 bridges none. At most 16 cells are used.
    pub fill_radius_m: f64,
    /// What ground of a class is good for.
    pub classes: ClassRules,
    /// Where the vehicle stands, if known: the ground is what is connected to the surface nearest to this in its column,
    /// so that a bridge is driven over by who is on it and under by who is not.
    pub at: Option<Point<World>>,
}

impl Default for GroundSettings {
    fn default() -> Self {
        Self {
            fill_radius_m: 0.15,
            classes: ClassRules::default(),
            at: None,
        }
    }
}

/// Cost per metre of ground that was not seen but closed around.
const BRIDGED_COST: f64 = 1.0;
/// Cost per metre at the steepest slope; it grows with the square.
const SLOPE_COST: f64 = 1.0;
/// Cost per metre where the ground deviates from a plane by the highest step.
const ROUGHNESS_COST: f64 = 2.0;
const MAX_FILL_CELLS: f64 = 16.0;

impl Traversability {
    /// What `map` shows of the ground, at its resolution and over its known part, with default [`GroundSettings`]. A map
    /// wider than [`MAX_EDGE_CELLS`] is cut around its middle. Every cell is unknown in a map without ground.
    pub fn from_map(map: &VoxelMap, vehicle: &Vehicle) -> Self {
        Self::from_map_with(map, vehicle, &GroundSettings::default())
    }

    /// What `map` shows of the ground with other settings.
    pub fn from_map_with(map: &VoxelMap, vehicle: &Vehicle, settings: &GroundSettings) -> Self {
        let limits = Limits::new(map.resolution_m(), vehicle, settings);
        let Some(window) = Window::around(map, &limits) else {
            return Self::empty(map.resolution_m());
        };
        let columns = Columns::of(map, window);
        let seed = settings.at.and_then(|at| {
            let key = map.key_of(at);
            Some((window.cell(key.x, key.y)?, key.z))
        });
        let ground = columns::ground(&columns, seed, &limits);
        let surface = Surface::of(&ground, window.width, &limits);
        let (mut cells, details) = judged(&columns, &surface, &settings.classes, &limits);
        bridge(&mut cells, &columns, &limits);
        let origin_m = [
            f64::from(window.x) * limits.resolution_m,
            f64::from(window.y) * limits.resolution_m,
        ];
        let grid: Result<Self, GridError> =
            Self::from_cells(origin_m, limits.resolution_m, window.width, cells);
        let mut grid =
            grid.expect("the window is a rectangle within the limit, at a map's resolution");
        grid.details = details;
        grid
    }
}

/// The vehicle's limits in the map's units.
#[derive(Clone, Copy, Debug)]
struct Limits {
    resolution_m: f64,
    /// Free voxels needed above a surface.
    height: i32,
    /// Highest step, in voxels.
    step: f32,
    max_slope_rad: f64,
    /// Cells to either side in which a plane is laid through the ground.
    plane_cells: usize,
    fill_m: f64,
    /// Unknown cells around what is known, so that a vehicle at the edge is still on the grid.
    border: i32,
}

impl Limits {
    fn new(resolution_m: f64, vehicle: &Vehicle, settings: &GroundSettings) -> Self {
        let cells = |length_m: f64| length_m / resolution_m;
        let fill_cells = cells(settings.fill_radius_m).clamp(0.0, MAX_FILL_CELLS);
        let fill_cells = if fill_cells.is_nan() { 0.0 } else { fill_cells };
        let longest = cells(vehicle.length_m).clamp(1.0, 256.0).max(fill_cells);
        Self {
            resolution_m,
            height: (cells(vehicle.height_m) - 1e-6).ceil().clamp(1.0, 1e6) as i32,
            step: cells(vehicle.max_step_m).clamp(1.5, 1e6) as f32,
            max_slope_rad: vehicle.max_slope_rad.clamp(0.0, 1.5),
            plane_cells: (0.5 * cells(vehicle.length_m)).ceil().clamp(2.0, 8.0) as usize,
            fill_m: fill_cells * resolution_m,
            border: longest.ceil() as i32 + 2,
        }
    }

    /// The steepest slope, in voxels per cell.
    fn slope(&self) -> f32 {
        self.max_slope_rad.tan() as f32
    }
}

/// The columns of the map that a grid covers.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Window {
    /// Key of the south-western column.
    x: i32,
    /// Key of the south-western column.
    y: i32,
    width: usize,
    height: usize,
}

impl Window {
    fn around(map: &VoxelMap, limits: &Limits) -> Option<Self> {
        let (low, high) = map.bounds()?;
        let along = |low: i32, high: i32| {
            let cells = (high - low) as usize + 1 + 2 * limits.border as usize;
            let size = cells.min(MAX_EDGE_CELLS);
            let cut = i32::try_from((cells - size) / 2).unwrap_or(i32::MAX);
            (low - limits.border + cut, size)
        };
        let (x, width) = along(low.x, high.x);
        let (y, height) = along(low.y, high.y);
        Some(Self {
            x,
            y,
            width,
            height,
        })
    }

    fn cell(&self, x: i32, y: i32) -> Option<usize> {
        let column = usize::try_from(x.checked_sub(self.x)?).ok()?;
        let row = usize::try_from(y.checked_sub(self.y)?).ok()?;
        (column < self.width && row < self.height).then_some(row * self.width + column)
    }
}

/// Every cell with what was measured there, before gaps are bridged.
fn judged(
    columns: &Columns,
    surface: &Surface,
    classes: &ClassRules,
    limits: &Limits,
) -> (Vec<Cell>, Vec<Details>) {
    let nearest = surface.nearest_height();
    (0..surface.len())
        .map(|cell| {
            if let Some(height) = surface.height(cell) {
                return on_ground(columns, (surface, cell), classes, height, limits);
            }
            let hindrance = match nearest[cell] {
                Some(height) => columns.hinders_above(cell, height, limits),
                None => columns.has_occupied(cell).then_some(Hindrance::NoGround),
            };
            let judged = hindrance.map_or(Cell::Unknown, |_| Cell::Blocked);
            let details = Details {
                hindrance,
                ..Details::default()
            };
            (judged, details)
        })
        .unzip()
}

fn on_ground(
    columns: &Columns,
    (surface, cell): (&Surface, usize),
    classes: &ClassRules,
    height: f32,
    limits: &Limits,
) -> (Cell, Details) {
    let metres = |voxels: f32| (f64::from(voxels) * limits.resolution_m) as f32;
    let plane = surface.plane(cell);
    // Half a voxel over the plane's extent is less than the map can tell.
    let doubt = 0.5 / (2 * limits.plane_cells + 1) as f64;
    let (slope, steepest) = (f64::from(plane.slope), limits.max_slope_rad.tan());
    let class = columns.class_of_ground(cell, height, limits);
    let mut details = Details {
        step_m: metres(surface.step(cell)),
        slope_rad: plane.slope.atan(),
        roughness_m: metres(plane.roughness),
        headroom_m: metres(columns.headroom(cell, height)),
        class,
        hindrance: None,
    };
    let rule = classes.of(class);
    details.hindrance = if surface.is_edge(cell) {
        Some(Hindrance::Step {
            rise_m: details.step_m,
        })
    } else if slope > steepest + doubt {
        Some(Hindrance::Slope {
            angle_rad: details.slope_rad,
        })
    } else {
        (rule == ClassRule::Blocked).then_some(Hindrance::Class { class })
    };
    if details.hindrance.is_some() {
        return (Cell::Blocked, details);
    }
    let steep = (slope - doubt).max(0.0) / steepest.max(1e-6);
    // Of that, up to half a voxel is how heights are rounded.
    let rough = (f64::from(plane.roughness) - 0.5).max(0.0) / f64::from(limits.step);
    let by_class = match rule {
        ClassRule::Cost(cost) => cost.max(0.0),
        ClassRule::Blocked => 0.0,
    };
    let drivable = Cell::Drivable {
        height_m: (f64::from(height) + 0.5) * limits.resolution_m,
        cost: SLOPE_COST * steep * steep + ROUGHNESS_COST * rough + by_class,
    };
    (drivable, details)
}

/// Makes unknown cells drivable that drivable ground closes around.
fn bridge(cells: &mut [Cell], columns: &Columns, limits: &Limits) {
    if limits.fill_m <= 0.0 {
        return;
    }
    let (width, resolution_m) = (columns.width(), limits.resolution_m);
    let is_ground: Vec<bool> = cells
        .iter()
        .map(|cell| matches!(cell, Cell::Drivable { .. }))
        .collect();
    let to_ground = distance::to_marked(&is_ground, width, resolution_m);
    // So that a gap of just twice the radius is bridged, whatever the rounding.
    let radius = limits.fill_m as f32 + 1e-6;
    let far: Vec<bool> = to_ground.iter().map(|&d| d > radius).collect();
    let to_far = distance::to_marked(&far, width, resolution_m);
    let seen = cells.to_vec();
    for (i, cell) in cells.iter_mut().enumerate() {
        if *cell != Cell::Unknown || to_far[i] <= radius {
            continue;
        }
        let Some(height_m) = height_between(&seen, width, i, limits) else {
            continue;
        };
        if !columns.is_seen_below(i, (height_m / resolution_m - 0.5) as f32, limits) {
            *cell = Cell::Drivable {
                height_m,
                cost: BRIDGED_COST,
            };
        }
    }
}

/// The height of the ground around a gap, weighted by nearness; `None` if it is not about one height.
fn height_between(cells: &[Cell], width: usize, at: usize, limits: &Limits) -> Option<f64> {
    let reach = (limits.fill_m / limits.resolution_m).ceil() as usize + 1;
    let (x, y, rows) = (at % width, at / width, cells.len() / width);
    let (mut sum, mut weights) = (0.0, 0.0);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for v in y.saturating_sub(reach)..=(y + reach).min(rows - 1) {
        for u in x.saturating_sub(reach)..=(x + reach).min(width - 1) {
            if let Cell::Drivable { height_m, .. } = cells[v * width + u] {
                let (dx, dy) = (u.abs_diff(x) as f64, v.abs_diff(y) as f64);
                let weight = 1.0 / (dx * dx + dy * dy).max(1.0);
                sum += weight * height_m;
                weights += weight;
                low = low.min(height_m);
                high = high.max(height_m);
            }
        }
    }
    let across = 2.0 * reach as f64 * limits.max_slope_rad.tan() + f64::from(limits.step);
    (weights > 0.0 && high - low <= across * limits.resolution_m).then(|| sum / weights)
}

#[cfg(test)]
mod tests;
