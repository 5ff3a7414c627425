//! What the map view shows, as plain data: the map's surface, lines, vehicles, a goal, an overlay on the ground.
//!
//! A scene knows nothing of a graphics card. The app keeps one in an [`std::sync::Arc`], changes it with
//! [`std::sync::Arc::make_mut`] when the model changes and hands it to [`super::callback`] each frame; the meshes in it
//! are shared, so that a copy is cheap, and a scene equal to the last one is not drawn again.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use maps::frame::{Body, Isometry, Point, World};
use maps::tile::TileId;
use maps::traversability::{Cell, Traversability};
use maps::voxel::VoxelMap;

use super::mesh::{self, EDGE, TileMesh};

/// Red, green, blue and opacity.
pub type Rgba = [u8; 4];

/// What colour the voxels have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coloring {
    /// As the camera saw them; by height where no camera did.
    #[default]
    Camera,
    /// By height, on [`super::ramp::ramp`].
    Height,
    /// By how sure it is that they are occupied, on the same ramp.
    Certainty,
}

/// Which sides of the voxels are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Surfaces {
    /// All that are not covered by another voxel.
    #[default]
    All,
    /// Only of voxels that face the camera, as [`super::mesh`] tells: walls and ceilings are transparent from outside.
    Observed,
}

/// How the map is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// What colour the voxels have.
    pub coloring: Coloring,
    /// Which sides of them are shown.
    pub surfaces: Surfaces,
    /// The heights at the ends of the colour ramp; none takes those of the map, without its outliers.
    pub heights_m: Option<[f64; 2]>,
    /// Whether the ground has a metric grid and a north arrow.
    pub grid: bool,
    /// The colour of nothing.
    pub background: [u8; 3],
}

impl Default for Look {
    fn default() -> Self {
        Self {
            coloring: Coloring::default(),
            surfaces: Surfaces::default(),
            heights_m: None,
            grid: true,
            background: [24, 27, 32],
        }
    }
}

/// Whether a line has gaps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stroke {
    /// No gaps.
    Solid,
    /// Dashes and gaps of this length.
    Dashed {
        /// Of a dash, and of a gap.
        length_m: f64,
    },
}

/// A line through points; what is hidden of it shows faintly through what hides it.
#[derive(Clone, Debug, PartialEq)]
pub struct Polyline {
    /// Where it goes. Points that are not finite are left out.
    pub points: Vec<Point<World>>,
    /// Its colour.
    pub color: Rgba,
    /// Its width in pixels, however far away.
    pub width_px: f32,
    /// Whether it has gaps.
    pub stroke: Stroke,
}

/// What kind of vehicle a marker stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MarkerKind {
    /// Four rotors, with a line down to the ground.
    Copter,
    /// Four wheels.
    Rover,
}

/// How much a marker is to be trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Freshness {
    /// The pose has just come in: drawn solid.
    Fresh,
    /// The pose is old: drawn hollow.
    Stale {
        /// The vehicle may by now be this far away; a ring shows it.
        radius_m: f64,
    },
}

/// A vehicle on the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marker {
    /// Its shape.
    pub kind: MarkerKind,
    /// Where it is and where it heads.
    pub world_from_body: Isometry<World, Body>,
    /// Its identity colour.
    pub color: [u8; 3],
    /// Its true length; far away it is drawn larger, to be seen.
    pub length_m: f64,
    /// How much it is to be trusted.
    pub freshness: Freshness,
    /// Whether a ring on the ground marks it as the chosen one.
    pub selected: bool,
}

/// Where a vehicle is to go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GoalMarker {
    /// The place on the ground.
    pub position: Point<World>,
    /// The wanted heading, counter-clockwise from east; none if any will do.
    pub heading_rad: Option<f64>,
    /// The colour of the vehicle.
    pub color: [u8; 3],
}

/// A square on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundCell {
    /// Its middle.
    pub center: Point<World>,
    /// Its colour; transparent lets the map through.
    pub color: Rgba,
}

/// Squares on the ground, such as where a vehicle can drive.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overlay {
    /// The edge of a square.
    pub cell_m: f64,
    /// The squares. Those of one row and one colour are drawn at once if they follow one another from west to east.
    pub cells: Vec<GroundCell>,
}

impl Overlay {
    /// Where `grid`'s vehicle can drive: teal where that is easy, brown where it is hard, orange where it must not be.
    /// A blocked cell has no height of its own and takes that of the drivable one before it in its row.
    pub fn of(grid: &Traversability) -> Self {
        const EASY: [f64; 3] = [48.0, 200.0, 184.0];
        const HARD: [f64; 3] = [150.0, 110.0, 60.0];
        const BLOCKED: Rgba = [232, 130, 40, 84];
        const SHADES: f64 = 8.0;
        let mut ground_m = 0.0;
        let cells = grid.cells().filter_map(|(index, cell)| {
            let color = match cell {
                Cell::Unknown => return None,
                Cell::Blocked => BLOCKED,
                Cell::Drivable { height_m, cost } => {
                    ground_m = height_m;
                    // Few shades, so that neighbours share one.
                    let hardness = (SHADES * cost / (1.0 + cost)).round() / SHADES;
                    let [r, g, b] =
                        std::array::from_fn(|i| EASY[i] + hardness * (HARD[i] - EASY[i]));
                    [r as u8, g as u8, b as u8, 64]
                }
            };
            let [x, y] = grid.center_of(index);
            Some(GroundCell {
                center: Point::new(x, y, ground_m),
                color,
            })
        });
        Self {
            cell_m: grid.resolution_m(),
            cells: cells.collect(),
        }
    }
}

/// A text in the picture, for the user interface to write.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// The pixel its middle belongs at.
    pub pixel: [f64; 2],
    /// What to write.
    pub text: String,
}

/// A mesh that is equal only to itself: comparing scenes must not read millions of vertices.
#[derive(Clone, Debug)]
pub(crate) struct SharedMesh(pub(crate) Arc<TileMesh>);

impl PartialEq for SharedMesh {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// All that is shown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// How the map is shown.
    pub look: Look,
    /// Nothing of the map above this height is shown, so that one looks into a room. Takes effect with the next
    /// [`Scene::update_map`].
    pub clip_above_m: Option<f64>,
    /// Lines.
    pub lines: Vec<Polyline>,
    /// Vehicles.
    pub markers: Vec<Marker>,
    /// Where one of them is to go.
    pub goal: Option<GoalMarker>,
    /// Squares on the ground.
    pub overlay: Option<Arc<Overlay>>,
    meshes: BTreeMap<TileId, SharedMesh>,
    resolution_m: f64,
    /// The first layer of voxels that is not in the meshes.
    top: Option<i32>,
}

impl Scene {
    /// Brings the meshes up to date with `map`, of which the tiles `changed` are new or different since the last call
    /// (`VoxelMap::take_changed_tiles`). Costs some milliseconds for each such tile and for each neighbour whose
    /// common border changed. Returns how many meshes were made.
    pub fn update_map(&mut self, map: &VoxelMap, changed: &[TileId]) -> usize {
        let top = self.clip_above_m.filter(|m| m.is_finite()).map(|height_m| {
            // A layer is shown if its middle is not above the plane.
            (height_m / map.resolution_m() - 0.5).floor() as i32 + 1
        });
        let mut dirty: BTreeSet<TileId> = changed.iter().copied().collect();
        if self.resolution_m.to_bits() != map.resolution_m().to_bits() {
            self.meshes.clear();
            self.resolution_m = map.resolution_m();
            dirty.extend(map.tile_ids());
        } else if top != self.top {
            let touched = |id: &TileId| is_touched_by_cut(*id, self.top, top);
            dirty.extend(map.tile_ids().into_iter().filter(touched));
        }
        self.top = top;

        let mut neighbours = BTreeSet::new();
        for &id in &dirty {
            let changed_sides = self.remesh(map, id);
            neighbours.extend(neighbours_over(id, changed_sides));
        }
        neighbours.retain(|id| !dirty.contains(id) && self.meshes.contains_key(id));
        for &id in &neighbours {
            self.remesh(map, id);
        }
        dirty.len() + neighbours.len()
    }

    /// The mesh of a tile.
    pub fn mesh(&self, id: TileId) -> Option<&TileMesh> {
        self.meshes.get(&id).map(|mesh| &*mesh.0)
    }

    /// How many quads the map has in all.
    pub fn quads(&self) -> usize {
        self.meshes().map(TileMesh::quads).sum()
    }

    /// The box about the occupied voxels.
    pub fn bounds(&self) -> Option<(Point<World>, Point<World>)> {
        self.meshes()
            .filter_map(TileMesh::bounds)
            .reduce(|(low, high), (other_low, other_high)| {
                (
                    Point::from_raw(low.raw.inf(&other_low.raw)),
                    Point::from_raw(high.raw.sup(&other_high.raw)),
                )
            })
    }

    /// The heights at the ends of the colour ramp, for a legend: as the look says, or those between which all but one
    /// in a hundred of the occupied voxels are.
    pub fn heights_m(&self) -> [f64; 2] {
        if let Some(heights_m) = self.look.heights_m {
            return heights_m;
        }
        let mut layers: BTreeMap<i64, u64> = BTreeMap::new();
        for (id, mesh) in &self.meshes {
            for (z, &count) in (0_i64..).zip(&mesh.0.layers) {
                if count > 0 {
                    *layers
                        .entry(i64::from(id.z) * i64::from(EDGE) + z)
                        .or_default() += u64::from(count);
                }
            }
        }
        let outliers = layers.values().sum::<u64>() / 200;
        let low = beyond(outliers, layers.iter());
        let high = beyond(outliers, layers.iter().rev());
        [
            low as f64 * self.resolution_m,
            (high + 1) as f64 * self.resolution_m,
        ]
    }

    /// The first layer of voxels that is cut away; for picking.
    pub(crate) fn top(&self) -> Option<i32> {
        self.top
    }

    pub(crate) fn shared_meshes(&self) -> impl Iterator<Item = &Arc<TileMesh>> {
        self.meshes.values().map(|mesh| &mesh.0)
    }

    pub(crate) fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    fn meshes(&self) -> impl Iterator<Item = &TileMesh> {
        self.meshes.values().map(|mesh| &*mesh.0)
    }

    /// Replaces the mesh of a tile; returns which of its sides differ from before.
    fn remesh(&mut self, map: &VoxelMap, id: TileId) -> [bool; 6] {
        let mesh = mesh::mesh_tile(map, id, self.top).map(Arc::new);
        let now = mesh
            .as_ref()
            .map_or(mesh::UNKNOWN_BORDERS, |mesh| mesh.borders);
        let before = match mesh {
            Some(mesh) => self.meshes.insert(id, SharedMesh(mesh)),
            None => self.meshes.remove(&id),
        };
        let before = before.map_or(mesh::UNKNOWN_BORDERS, |mesh| mesh.0.borders);
        std::array::from_fn(|side| now[side] != before[side])
    }
}

/// The first layer with which more than `outliers` voxels have been passed.
fn beyond<'a>(outliers: u64, mut layers: impl Iterator<Item = (&'a i64, &'a u64)>) -> i64 {
    let mut passed = 0;
    layers
        .find(|(_, count)| {
            passed += **count;
            passed > outliers
        })
        .map_or(0, |(&z, _)| z)
}

/// Whether moving the cut from one layer to another alters what is seen of a tile.
fn is_touched_by_cut(id: TileId, from: Option<i32>, to: Option<i32>) -> bool {
    let layer = |top: Option<i32>| top.map_or(i64::MAX, i64::from);
    let (low, high) = (layer(from).min(layer(to)), layer(from).max(layer(to)));
    let first = i64::from(id.z) * i64::from(EDGE);
    // The layer below the cut shows its upper sides.
    first <= high && first + i64::from(EDGE) >= low
}

/// The neighbours that touch at least one changed side and none that is unchanged: a voxel on an edge or a corner of
/// the tile belongs to all the sides that meet there.
fn neighbours_over(id: TileId, changed: [bool; 6]) -> Vec<TileId> {
    let mut ids = Vec::new();
    for place in 0..27 {
        let step = [place % 3 - 1, place / 3 % 3 - 1, place / 9 - 1];
        let touches_only_changed = (0..3).all(|axis| match step[axis] {
            0 => true,
            1 => changed[2 * axis],
            _ => changed[2 * axis + 1],
        });
        if step != [0; 3] && touches_only_changed {
            ids.push(TileId {
                x: id.x.saturating_add(step[0]),
                y: id.y.saturating_add(step[1]),
                z: id.z.saturating_add(step[2]),
            });
        }
    }
    ids
}

#[cfg(test)]
mod tests {
    use maps::voxel::{LogOdds, Voxel, VoxelKey};
    use proptest::prelude::*;

    use super::*;

    const SOLID: Voxel = Voxel::new(LogOdds(70));
    const ORIGIN: TileId = TileId { x: 0, y: 0, z: 0 };
    const EAST: TileId = TileId { x: 1, y: 0, z: 0 };

    fn add(map: &mut VoxelMap, [x, y, z]: [i32; 3]) {
        map.set_voxel(VoxelKey { x, y, z }, SOLID);
    }

    fn refresh(scene: &mut Scene, map: &mut VoxelMap) -> usize {
        let changed = map.take_changed_tiles();
        scene.update_map(map, &changed)
    }

    fn quads(scene: &Scene, id: TileId) -> Option<usize> {
        scene.mesh(id).map(TileMesh::quads)
    }

    #[test]
    fn a_changed_tile_replaces_its_mesh_and_leaves_the_others_alone() {
        let (mut map, mut scene) = (VoxelMap::new(0.1), Scene::default());
        add(&mut map, [5, 5, 5]);
        add(&mut map, [200, 5, 5]);
        refresh(&mut scene, &mut map);
        assert_eq!(
            (quads(&scene, ORIGIN), quads(&scene, EAST)),
            (Some(6), Some(6))
        );
        let before = scene.clone();
        add(&mut map, [6, 5, 5]);
        assert_eq!(refresh(&mut scene, &mut map), 1);
        assert_eq!(quads(&scene, ORIGIN), Some(10));
        assert_eq!(scene.meshes[&EAST], before.meshes[&EAST]);
        assert_ne!(scene, before);
    }

    #[test]
    fn a_neighbour_is_made_anew_only_if_the_common_border_changed() {
        let (mut map, mut scene) = (VoxelMap::new(0.1), Scene::default());
        add(&mut map, [128, 5, 5]);
        refresh(&mut scene, &mut map);
        assert_eq!(quads(&scene, EAST), Some(6));
        add(&mut map, [127, 5, 5]);
        assert_eq!(refresh(&mut scene, &mut map), 2);
        assert_eq!(quads(&scene, EAST), Some(5), "its west side is covered now");
    }

    #[test]
    fn an_update_that_changes_nothing_costs_nothing_and_is_equal() {
        let (mut map, mut scene) = (VoxelMap::new(0.1), Scene::default());
        add(&mut map, [1, 2, 3]);
        refresh(&mut scene, &mut map);
        let before = scene.clone();
        assert_eq!(scene.update_map(&map, &[]), 0);
        assert_eq!(scene, before);
    }

    #[test]
    fn moving_the_cut_shows_and_hides_what_is_above_it() {
        let (mut map, mut scene) = (VoxelMap::new(0.1), Scene::default());
        for z in 0..300 {
            add(&mut map, [5, 5, z]);
        }
        refresh(&mut scene, &mut map);
        assert_eq!(scene.quads(), 4 * 300 + 2);
        for (clip_above_m, layers) in [
            (10.0, 100),
            (12.8, 128),
            (12.84, 128),
            (12.86, 129),
            (25.6, 256),
            (-1.0, 0),
        ] {
            scene.clip_above_m = Some(clip_above_m);
            scene.update_map(&map, &[]);
            let expected = if layers == 0 { 0 } else { 4 * layers + 2 };
            assert_eq!(scene.quads(), expected, "cut at {clip_above_m} m");
        }
        scene.clip_above_m = None;
        scene.update_map(&map, &[]);
        assert_eq!(scene.quads(), 4 * 300 + 2);
    }

    #[test]
    fn the_ramp_spans_the_heights_without_the_outliers() {
        let (mut map, mut scene) = (VoxelMap::new(0.1), Scene::default());
        for x in 0..100 {
            for z in 0..10 {
                add(&mut map, [x, 0, z]);
            }
        }
        add(&mut map, [0, 0, 99]);
        add(&mut map, [0, 0, -99]);
        refresh(&mut scene, &mut map);
        let [low, high] = scene.heights_m();
        assert!(
            low.abs() < 1e-9 && (high - 1.0).abs() < 1e-9,
            "{low} m to {high} m"
        );
        scene.look.heights_m = Some([-1.0, 2.0]);
        let [low, high] = scene.heights_m();
        assert!((low + 1.0).abs() < 1e-9 && (high - 2.0).abs() < 1e-9);
    }

    #[test]
    fn an_overlay_has_a_cell_for_each_that_is_known_at_the_height_of_the_ground() {
        let easy = Cell::Drivable {
            height_m: 0.3,
            cost: 0.0,
        };
        let hard = Cell::Drivable {
            height_m: 0.3,
            cost: 9.0,
        };
        let cells = vec![easy, Cell::Blocked, Cell::Unknown, hard];
        let grid = Traversability::from_cells([1.0, 2.0], 0.5, 2, cells).expect("two rows of two");
        let overlay = Overlay::of(&grid);
        let centers: Vec<_> = overlay.cells.iter().map(|cell| cell.center).collect();
        let expected =
            [[1.25, 2.25], [1.75, 2.25], [1.75, 2.75]].map(|[x, y]| Point::new(x, y, 0.3));
        assert_eq!(centers, expected);
        let colors: BTreeSet<_> = overlay.cells.iter().map(|cell| cell.color).collect();
        assert_eq!(colors.len(), 3);
    }

    proptest! {
        #[test]
        fn updates_one_by_one_end_as_one_update_of_all(
            steps in prop::collection::vec((prop::array::uniform3(124..132_i32), any::<bool>()), 1..40)
        ) {
            let (mut map, mut scene) = (VoxelMap::new(0.1), Scene::default());
            for ([x, y, z], is_solid) in steps {
                let log_odds = LogOdds(if is_solid { 70 } else { -40 });
                map.set_voxel(VoxelKey { x, y, z }, Voxel::new(log_odds));
                let changed = map.take_changed_tiles();
                scene.update_map(&map, &changed);
            }
            let mut at_once = Scene::default();
            at_once.update_map(&map, &map.tile_ids());
            for id in map.tile_ids() {
                prop_assert_eq!(scene.mesh(id), at_once.mesh(id));
            }
        }
    }
}
