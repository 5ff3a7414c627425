//! From voxels to triangles: every side of an occupied voxel that borders on something else, as one quad.
//!
//! A side is *observed* if the voxel before it is known to be free: some ray passed there. Sides towards unknown space
//! were seen by nobody; without them the walls of a room are transparent from outside, as in a doll's house. The mesh
//! has the observed ones first, so that showing or hiding the others is only a shorter draw.
//!
//! Corners are darkened by how many of the three voxels that touch them before the side are occupied, and the quad is
//! split along its brighter diagonal: M. Lysenko, *Ambient occlusion for Minecraft-like worlds*, 2013.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use bytemuck::{Pod, Zeroable};
use maps::frame::{Point, World};
use maps::tile::TileId;
use maps::voxel::{Occupancy, Voxel, VoxelKey, VoxelMap};

/// Voxels along the edge of a tile.
pub(crate) const EDGE: i32 = 128;
/// More quads than this in one tile are left out: a tile of a real scene has less than a tenth.
const MAX_QUADS: usize = 1_000_000;

/// The corner of a quad.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Vertex {
    /// In voxels from the low corner of the tile, up to 128.
    pub position: [u8; 3],
    /// Bits 0 to 2 the side (east, west, north, south, up, down), 3 and 4 how open the corner is, 5 whether the voxel
    /// has a colour, 6 whether the side is the cut of a plane through something solid.
    pub flags: u8,
    /// The colour of the voxel.
    pub rgb: [u8; 3],
    /// How sure it is that the voxel is occupied.
    pub certainty: u8,
}

const HAS_COLOR: u8 = 1 << 5;
const IS_CUT: u8 = 1 << 6;

/// What is drawn of one tile.
#[derive(Clone, Debug, PartialEq)]
pub struct TileMesh {
    /// The low corner of the tile.
    pub(crate) origin: Point<World>,
    pub(crate) resolution_m: f64,
    /// Four for each quad, counter-clockwise from outside.
    pub(crate) vertices: Vec<Vertex>,
    pub(crate) observed_quads: usize,
    /// Occupied voxels in each layer, from the lowest up.
    pub(crate) layers: [u32; EDGE as usize],
    /// First and last occupied voxel along each axis, relative to the tile; `None` if there is none.
    pub(crate) extent: Option<[[i32; 3]; 2]>,
    /// A hash of the voxels on each side of the tile: what its neighbours' meshes depend on.
    pub(crate) borders: [u64; 6],
}

impl TileMesh {
    /// How many quads there are.
    pub fn quads(&self) -> usize {
        self.vertices.len() / 4
    }

    /// How many of them are sides that some ray has seen.
    pub fn observed_quads(&self) -> usize {
        self.observed_quads
    }

    /// The corners of the quads, four each.
    pub fn vertices(&self) -> &[Vertex] {
        &self.vertices
    }

    /// The box about the occupied voxels.
    pub fn bounds(&self) -> Option<(Point<World>, Point<World>)> {
        let at = |voxels: [i32; 3], plus: i32| {
            let [x, y, z] = voxels.map(|v| f64::from(v + plus) * self.resolution_m);
            self.origin + maps::frame::Vector::new(x, y, z)
        };
        self.extent.map(|[low, high]| (at(low, 0), at(high, 1)))
    }
}

/// The mesh of tile `id` as `map` knows it and its neighbours, without the voxels from layer `top` upwards; `None` if
/// nothing of the tile is known.
pub fn mesh_tile(map: &VoxelMap, id: TileId, top: Option<i32>) -> Option<TileMesh> {
    let block = Block::new(map, id, top)?;
    let (mut observed, mut unobserved) = (Vec::new(), Vec::new());
    let mut layers = [0; EDGE as usize];
    let mut extent: Option<[[i32; 3]; 2]> = None;
    for &(place, voxel) in &block.occupied {
        layers[place[2] as usize] += 1;
        let [low, high] = extent.get_or_insert([place; 2]);
        for axis in 0..3 {
            low[axis] = low[axis].min(place[axis]);
            high[axis] = high[axis].max(place[axis]);
        }
        for side in Side::ALL {
            let quads = match block.cell(side.before(place)) {
                Cell::Occupied => continue,
                Cell::Free | Cell::Cut { .. } => &mut observed,
                Cell::Unknown => &mut unobserved,
            };
            quads.push(block.quad(place, side, voxel));
        }
    }
    let observed_quads = observed.len().min(MAX_QUADS);
    let vertices = observed
        .into_iter()
        .chain(unobserved)
        .take(MAX_QUADS)
        .flatten()
        .collect();
    Some(TileMesh {
        origin: corner_of(id, map.resolution_m()),
        resolution_m: map.resolution_m(),
        vertices,
        observed_quads,
        layers,
        extent,
        borders: block.borders(),
    })
}

/// The hashes of a tile's sides as long as nothing of it is known.
pub(crate) fn unknown_borders() -> [u64; 6] {
    [hash_of(&[Cell::Unknown.code(); (EDGE * EDGE) as usize]); 6]
}

fn corner_of(id: TileId, resolution_m: f64) -> Point<World> {
    let [x, y, z] = [id.x, id.y, id.z].map(|i| f64::from(i) * f64::from(EDGE) * resolution_m);
    Point::new(x, y, z)
}

/// One of the six sides of a cube.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Side(u8);

impl Side {
    const ALL: [Self; 6] = [Self(0), Self(1), Self(2), Self(3), Self(4), Self(5)];

    /// The axis it is across, and in which direction it looks.
    fn axis(self) -> (usize, i32) {
        (usize::from(self.0 >> 1), 1 - 2 * i32::from(self.0 & 1))
    }

    fn before(self, mut place: [i32; 3]) -> [i32; 3] {
        let (axis, sign) = self.axis();
        place[axis] += sign;
        place
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Cell {
    Unknown,
    Free,
    Occupied,
    /// Above the cutting plane.
    Cut {
        through_occupied: bool,
    },
}

impl Cell {
    fn code(self) -> u8 {
        match self {
            Self::Unknown => 0,
            Self::Free | Self::Cut { .. } => 1,
            Self::Occupied => 2,
        }
    }
}

/// A tile's voxels in an array, and its neighbours' when they are asked for.
struct Block<'a> {
    map: &'a VoxelMap,
    low: VoxelKey,
    /// The first layer that is cut away, relative to the tile.
    top: i32,
    cells: Vec<Cell>,
    occupied: Vec<([i32; 3], Voxel)>,
}

impl<'a> Block<'a> {
    fn new(map: &'a VoxelMap, id: TileId, top: Option<i32>) -> Option<Self> {
        let tile = map.tile(id)?;
        let low = VoxelKey {
            x: id.x.checked_mul(EDGE)?,
            y: id.y.checked_mul(EDGE)?,
            z: id.z.checked_mul(EDGE)?,
        };
        let top = top.map_or(i32::MAX, |top| top.saturating_sub(low.z));
        let mut cells = vec![Cell::Unknown; (EDGE * EDGE * EDGE) as usize];
        let mut occupied = Vec::new();
        for (key, voxel) in tile.known() {
            let place = [key.x - low.x, key.y - low.y, key.z - low.z];
            let Some(index) = index_of(place) else {
                continue;
            };
            let is_occupied = voxel.log_odds.0 > 0;
            cells[index] = if is_occupied {
                Cell::Occupied
            } else {
                Cell::Free
            };
            if is_occupied && place[2] < top {
                occupied.push((place, voxel));
            }
        }
        Some(Self {
            map,
            low,
            top,
            cells,
            occupied,
        })
    }

    fn cell(&self, place: [i32; 3]) -> Cell {
        let uncut = index_of(place).map_or_else(|| self.outside(place), |index| self.cells[index]);
        if place[2] < self.top {
            uncut
        } else {
            Cell::Cut {
                through_occupied: uncut == Cell::Occupied,
            }
        }
    }

    fn outside(&self, place: [i32; 3]) -> Cell {
        let key = VoxelKey {
            x: self.low.x.saturating_add(place[0]),
            y: self.low.y.saturating_add(place[1]),
            z: self.low.z.saturating_add(place[2]),
        };
        match self.map.occupancy(key) {
            Occupancy::Unknown => Cell::Unknown,
            Occupancy::Free => Cell::Free,
            Occupancy::Occupied => Cell::Occupied,
        }
    }

    fn quad(&self, place: [i32; 3], side: Side, voxel: Voxel) -> [Vertex; 4] {
        // Around the quad, counter-clockwise for a side that looks along its axis.
        const AROUND: [[i32; 2]; 4] = [[0, 0], [1, 0], [1, 1], [0, 1]];
        let (axis, sign) = side.axis();
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let before = side.before(place);
        let is_cut = self.cell(before)
            == Cell::Cut {
                through_occupied: true,
            };
        let color = voxel.color.map(|color| color.0);
        let common =
            side.0 | if color.is_some() { HAS_COLOR } else { 0 } | if is_cut { IS_CUT } else { 0 };

        let open = AROUND.map(|[du, dv]| {
            let is_occupied = |along_u: bool, along_v: bool| {
                let mut touching = before;
                touching[u] += if along_u { 2 * du - 1 } else { 0 };
                touching[v] += if along_v { 2 * dv - 1 } else { 0 };
                self.cell(touching) == Cell::Occupied
            };
            openness([is_occupied(true, false), is_occupied(false, true)], || {
                is_occupied(true, true)
            })
        });
        let corner = |i: usize| {
            let mut position = place;
            position[axis] += i32::from(sign > 0);
            position[u] += AROUND[i][0];
            position[v] += AROUND[i][1];
            Vertex {
                position: position.map(|c| c as u8),
                flags: common | open[i] << 3,
                rgb: color.unwrap_or_default(),
                certainty: certainty(voxel),
            }
        };
        // Triangles share the diagonal from the first to the third corner: let it join the brighter pair.
        let first = usize::from(open[0] + open[2] < open[1] + open[3]);
        let order = if sign > 0 { [0, 1, 2, 3] } else { [0, 3, 2, 1] };
        std::array::from_fn(|i| corner(order[(i + first) % 4]))
    }

    fn borders(&self) -> [u64; 6] {
        Side::ALL.map(|side| {
            let (axis, sign) = side.axis();
            let layer = if sign > 0 { EDGE - 1 } else { 0 };
            let mut codes = Vec::with_capacity((EDGE * EDGE) as usize);
            for u in 0..EDGE {
                for v in 0..EDGE {
                    let mut place = [layer; 3];
                    place[(axis + 1) % 3] = u;
                    place[(axis + 2) % 3] = v;
                    codes.push(index_of(place).map_or(0, |index| self.cells[index].code()));
                }
            }
            hash_of(&codes)
        })
    }
}

/// 0 for a corner in a niche, 3 for one with nothing beside it.
fn openness([along_u, along_v]: [bool; 2], diagonal: impl FnOnce() -> bool) -> u8 {
    if along_u && along_v {
        0
    } else {
        3 - u8::from(along_u) - u8::from(along_v) - u8::from(diagonal())
    }
}

/// 0 for as likely free, 255 for as sure as a voxel can be.
fn certainty(voxel: Voxel) -> u8 {
    const SUREST: u32 = 70;
    (u32::from(voxel.log_odds.0.max(0).unsigned_abs()).min(SUREST) * 255 / SUREST) as u8
}

fn index_of(place: [i32; 3]) -> Option<usize> {
    place
        .iter()
        .all(|c| (0..EDGE).contains(c))
        .then(|| ((place[2] * EDGE + place[1]) * EDGE + place[0]) as usize)
}

fn hash_of(codes: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    codes.hash(&mut hasher);
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use maps::voxel::{LogOdds, Rgb};
    use proptest::prelude::*;

    use super::*;

    const SOLID: Voxel = Voxel {
        log_odds: LogOdds(70),
        color: None,
    };
    const FREE: Voxel = Voxel {
        log_odds: LogOdds(-40),
        color: None,
    };
    const ORIGIN: TileId = TileId { x: 0, y: 0, z: 0 };

    fn key([x, y, z]: [i32; 3]) -> VoxelKey {
        VoxelKey { x, y, z }
    }

    fn map_of(voxels: impl IntoIterator<Item = [i32; 3]>) -> VoxelMap {
        let mut map = VoxelMap::new(0.1);
        for place in voxels {
            map.set_voxel(key(place), SOLID);
        }
        map
    }

    fn cube(low: i32, high: i32) -> impl Iterator<Item = [i32; 3]> {
        (low..high)
            .flat_map(move |x| (low..high).flat_map(move |y| (low..high).map(move |z| [x, y, z])))
    }

    #[track_caller]
    fn check_quads(map: &VoxelMap, id: TileId, top: Option<i32>, quads: usize) {
        assert_eq!(
            mesh_tile(map, id, top).map(|mesh| mesh.quads()),
            Some(quads),
            "of tile {id:?}"
        );
    }

    #[test]
    fn a_single_voxel_has_six_sides() {
        check_quads(&map_of([[5, 6, 7]]), ORIGIN, None, 6);
        check_quads(&map_of([[127, 0, 127]]), ORIGIN, None, 6);
        check_quads(
            &map_of([[-1, -128, -5]]),
            TileId {
                x: -1,
                y: -1,
                z: -1,
            },
            None,
            6,
        );
    }

    #[test]
    fn a_solid_block_has_only_its_surface() {
        check_quads(&map_of(cube(3, 8)), ORIGIN, None, 6 * 5 * 5);
    }

    #[test]
    fn neighbours_in_the_next_tile_hide_sides() {
        let map = map_of([[127, 4, 4], [128, 4, 4]]);
        check_quads(&map, ORIGIN, None, 5);
        check_quads(&map, TileId { x: 1, y: 0, z: 0 }, None, 5);
    }

    #[test]
    fn what_is_unknown_has_no_mesh_and_what_is_free_an_empty_one() {
        let mut map = VoxelMap::new(0.1);
        assert_eq!(mesh_tile(&map, ORIGIN, None), None);
        map.set_voxel(key([1, 1, 1]), FREE);
        check_quads(&map, ORIGIN, None, 0);
        assert_eq!(
            mesh_tile(&map, ORIGIN, None).and_then(|mesh| mesh.bounds()),
            None
        );
    }

    #[test]
    fn a_cut_shows_the_inside_as_its_upper_side() {
        let map = map_of(cube(3, 8));
        let mesh = mesh_tile(&map, ORIGIN, Some(5)).expect("known");
        assert_eq!(mesh.quads(), 2 * 25 + 4 * 5 * 2, "two layers are left");
        let cut: Vec<_> = mesh
            .vertices()
            .iter()
            .filter(|v| v.flags & IS_CUT != 0)
            .collect();
        assert_eq!(cut.len(), 25 * 4);
        assert!(cut.iter().all(|v| v.position[2] == 5 && v.flags & 7 == 4));
        check_quads(&map, ORIGIN, Some(8), 6 * 25);
        let uncut = mesh_tile(&map, ORIGIN, Some(8)).expect("known");
        assert!(
            uncut.vertices().iter().all(|v| v.flags & IS_CUT == 0),
            "its own top is no cut"
        );
        check_quads(&map, ORIGIN, Some(-300), 0);
    }

    #[test]
    fn only_sides_towards_free_space_are_observed() {
        let mut map = map_of([[5, 5, 5]]);
        map.set_voxel(key([5, 5, 6]), FREE);
        let mesh = mesh_tile(&map, ORIGIN, None).expect("known");
        assert_eq!((mesh.quads(), mesh.observed_quads()), (6, 1));
        assert!(
            mesh.vertices()[..4].iter().all(|v| v.position[2] == 6),
            "observed ones come first"
        );
    }

    #[test]
    fn a_corner_in_a_niche_is_darker_than_an_open_one() {
        // A floor with a wall on its west.
        let mut floor: Vec<_> = (0..4)
            .flat_map(|x| (0..4).map(move |y| [x, y, 0]))
            .collect();
        floor.extend((0..4).map(|y| [0, y, 1]));
        let mesh = mesh_tile(&map_of(floor), ORIGIN, None).expect("known");
        let openness_at = |position: [u8; 3]| {
            let up = |v: &&Vertex| v.position == position && v.flags & 7 == 4;
            mesh.vertices()
                .iter()
                .filter(up)
                .map(|v| v.flags >> 3 & 3)
                .min()
        };
        assert_eq!(openness_at([1, 2, 1]), Some(1), "at the foot of the wall");
        assert_eq!(openness_at([3, 2, 1]), Some(3), "out in the open");
    }

    #[test]
    fn a_vertex_has_the_colour_and_the_certainty_of_its_voxel() {
        let mut map = VoxelMap::new(0.1);
        let color = Rgb([248, 0, 248]);
        map.set_voxel(
            key([0, 0, 0]),
            Voxel {
                log_odds: LogOdds(35),
                color: Some(color),
            },
        );
        let mesh = mesh_tile(&map, ORIGIN, None).expect("known");
        let kept = map
            .voxel(key([0, 0, 0]))
            .and_then(|v| v.color)
            .expect("a colour");
        for vertex in mesh.vertices() {
            assert_eq!((vertex.rgb, vertex.certainty), (kept.0, 127));
            assert_ne!(vertex.flags & HAS_COLOR, 0);
        }
    }

    proptest! {
        #[test]
        fn there_is_a_quad_wherever_occupied_meets_not_occupied(
            places in prop::collection::btree_set(prop::array::uniform3(120..136_i32), 0..200)
        ) {
            let map = map_of(places.iter().copied());
            let sides: usize = places
                .iter()
                .flat_map(|place| Side::ALL.map(|side| side.before(*place)))
                .filter(|before| !places.contains(before))
                .count();
            let quads: usize = map.tile_ids().into_iter().filter_map(|id| mesh_tile(&map, id, None)).map(|mesh| mesh.quads()).sum();
            prop_assert_eq!(quads, sides);
        }

        #[test]
        fn every_quad_is_a_square_that_looks_away_from_its_voxel(place in prop::array::uniform3(0..128_i32)) {
            let mesh = mesh_tile(&map_of([place]), ORIGIN, None).expect("known");
            let center = nalgebra::Vector3::from(place.map(f64::from)).add_scalar(0.5);
            for quad in mesh.vertices().chunks_exact(4) {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i: usize| nalgebra::Vector3::from(quad[i].position.map(f64::from)));
                let normal = (b - a).cross(&(c - a));
                prop_assert!((normal.norm() - 1.0).abs() < 1e-9 && (b - a + (d - c)).norm() < 1e-9);
                prop_assert!(normal.dot(&(a - center)) > 0.0, "clockwise from outside");
            }
        }
    }
}
