//! From voxels to triangles: every side of an occupied voxel that borders on something else, as one quad.
//!
//! Every voxel also knows which way it faces: towards the free space about it,
//!
//! ```text
//! n = Σ d·[place + k·d is free]      d of the 26 directions, k = 1, 2, 4
//! ```
//!
//! as one of those directions. Rays come from inside a room, so its walls face inwards, and without the voxels that face
//! away from the camera they are transparent from outside, as in a doll's house. Thin things with free space on both
//! sides face nowhere in particular and are always shown, but for sides towards unknown space, which nobody has seen.
//!
//! Corners are darkened by how many of the three voxels that touch them before the side are occupied, and the quad is
//! split along its brighter diagonal: M. Lysenko, *Ambient occlusion for Minecraft-like worlds*, 2013.

use bytemuck::{Pod, Zeroable};
use maps::frame::{Point, World};
use maps::tile::TileId;
use maps::voxel::{Occupancy, Voxel, VoxelKey, VoxelMap};

/// How far from a voxel the free space is looked for in which it was seen.
const STEPS: [i32; 3] = [1, 2, 4];
/// So many voxels of a tile its neighbours' meshes depend on.
const REACH: i32 = 4;
/// Voxels along the edge of a tile.
pub(crate) const EDGE: i32 = 128;
/// More quads than this in one tile are left out: a tile of a real scene has less than a tenth.
const MAX_QUADS: usize = 1_000_000;

/// The corner of a quad.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Vertex {
    /// The place of the voxel from the low corner of the tile, 0 to 127; with 128 added where the corner is the higher one.
    pub place: [u8; 3],
    /// Bits 0 to 2 the side (east, west, north, south, up, down), 3 and 4 how open the corner is, 5 whether the voxel
    /// has a colour, 6 whether the side is the cut of a plane through something solid, 7 whether it borders on the
    /// unknown.
    pub flags: u8,
    /// The colour of the voxel.
    pub rgb: [u8; 3],
    /// Bits 0 to 4 the way the voxel faces, 5 to 7 how sure it is that it is occupied.
    pub facing: u8,
}

const HAS_COLOR: u8 = 1 << 5;
const IS_CUT: u8 = 1 << 6;
const IS_UNSEEN: u8 = 1 << 7;

/// What is drawn of one tile.
#[derive(Clone, Debug, PartialEq)]
pub struct TileMesh {
    /// The low corner of the tile.
    pub(crate) origin: Point<World>,
    pub(crate) resolution_m: f64,
    /// Four for each quad, counter-clockwise from outside.
    pub(crate) vertices: Vec<Vertex>,
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
    let mut vertices = Vec::new();
    let mut layers = [0; EDGE as usize];
    let mut extent: Option<[[i32; 3]; 2]> = None;
    for &(place, voxel) in &block.occupied {
        layers[place[2] as usize] += 1;
        let [low, high] = extent.get_or_insert([place; 2]);
        for axis in 0..3 {
            low[axis] = low[axis].min(place[axis]);
            high[axis] = high[axis].max(place[axis]);
        }
        let mut facing = None;
        for side in Side::ALL {
            if block.cell(side.before(place)) != Cell::Occupied && vertices.len() < 4 * MAX_QUADS {
                let facing = *facing
                    .get_or_insert_with(|| Facing::of(place, |at| block.uncut(at) == Cell::Free));
                vertices.extend(block.quad(place, side, (voxel, facing)));
            }
        }
    }
    Some(TileMesh {
        origin: corner_of(id, map.resolution_m()),
        resolution_m: map.resolution_m(),
        vertices,
        layers,
        extent,
        borders: block.borders,
    })
}

/// The hashes of a tile's sides as long as nothing of it is known.
pub(crate) const UNKNOWN_BORDERS: [u64; 6] = [0; 6];

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

/// A tile's voxels in an array, and its neighbours' when they are asked for.
struct Block<'a> {
    map: &'a VoxelMap,
    low: VoxelKey,
    /// The first layer that is cut away, relative to the tile.
    top: i32,
    cells: Vec<Cell>,
    occupied: Vec<([i32; 3], Voxel)>,
    borders: [u64; 6],
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
        let mut borders = UNKNOWN_BORDERS;
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
            add_to_borders(&mut borders, place, index, cells[index]);
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
            borders,
        })
    }

    fn uncut(&self, place: [i32; 3]) -> Cell {
        index_of(place).map_or_else(|| self.outside(place), |index| self.cells[index])
    }

    fn cell(&self, place: [i32; 3]) -> Cell {
        let uncut = self.uncut(place);
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

    fn quad(&self, place: [i32; 3], side: Side, (voxel, facing): (Voxel, Facing)) -> [Vertex; 4] {
        // Around the quad, counter-clockwise for a side that looks along its axis.
        const AROUND: [[i32; 2]; 4] = [[0, 0], [1, 0], [1, 1], [0, 1]];
        let (axis, sign) = side.axis();
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let before = side.before(place);
        let color = voxel.color.map(|color| color.0);
        let common = side.0
            | if color.is_some() { HAS_COLOR } else { 0 }
            | match self.cell(before) {
                Cell::Cut {
                    through_occupied: true,
                } => IS_CUT,
                Cell::Unknown => IS_UNSEEN,
                Cell::Free | Cell::Occupied | Cell::Cut { .. } => 0,
            };

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
            let mut is_high = [0; 3];
            is_high[axis] = i32::from(sign > 0);
            is_high[u] = AROUND[i][0];
            is_high[v] = AROUND[i][1];
            Vertex {
                place: std::array::from_fn(|axis| (place[axis] | is_high[axis] << 7) as u8),
                flags: common | open[i] << 3,
                rgb: color.unwrap_or_default(),
                facing: facing.0 | certainty(voxel) << 5,
            }
        };
        // Triangles share the diagonal from the first to the third corner: let it join the brighter pair.
        let first = usize::from(open[0] + open[2] < open[1] + open[3]);
        let order = if sign > 0 { [0, 1, 2, 3] } else { [0, 3, 2, 1] };
        std::array::from_fn(|i| corner(order[(i + first) % 4]))
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

/// 0 for as likely free, 7 for as sure as a voxel can be.
fn certainty(voxel: Voxel) -> u8 {
    const SUREST: u32 = 70;
    (u32::from(voxel.log_odds.0.max(0).unsigned_abs()).min(SUREST) * 7 / SUREST) as u8
}

/// Which way a voxel faces: -1, 0 or 1 along each axis, plus one, as digits of base three.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Facing(u8);

impl Facing {
    /// Free space on one side by less than this says nothing.
    const LEAST: i32 = 4;
    /// Of the angle between where a voxel faces and where the camera looks, as a cosine: beyond it the camera is behind.
    /// The shader has it too. Facing is rounded, so what is seen edge-on stays.
    const BEHIND: f64 = 0.15;

    /// Of the voxel at `place` among those that are free.
    pub(crate) fn of(place: [i32; 3], is_free: impl Fn([i32; 3]) -> bool) -> Self {
        let mut sum = [0; 3];
        for i in 0..27 {
            let direction = [i % 3, i / 3 % 3, i / 9].map(|digit| digit - 1);
            let is_free_at = |step: i32| {
                direction != [0; 3]
                    && is_free(std::array::from_fn(|axis| {
                        place[axis] + step * direction[axis]
                    }))
            };
            let free: i32 = STEPS.iter().map(|&step| i32::from(is_free_at(step))).sum();
            for axis in 0..3 {
                sum[axis] += free * direction[axis];
            }
        }
        let most = sum.map(i32::abs).into_iter().fold(0, i32::max);
        if most < Self::LEAST {
            return Self(13);
        }
        // More than 22.5° off an axis is between two.
        let [x, y, z] = sum.map(|c| {
            if 12 * c.abs() >= 5 * most {
                c.signum() + 1
            } else {
                1
            }
        });
        Self((x + 3 * y + 9 * z) as u8)
    }

    /// Whether a voxel that faces so is not shown to a camera that looks at it along `direction`, of length 1.
    /// `is_unseen`: whether its side there borders on the unknown.
    pub(crate) fn hides(self, direction: nalgebra::Vector3<f64>, is_unseen: bool) -> bool {
        let digits = [self.0 % 3, self.0 / 3 % 3, self.0 / 9].map(|digit| f64::from(digit) - 1.0);
        let facing = nalgebra::Vector3::from(digits);
        match facing.try_normalize(0.5) {
            Some(facing) => facing.dot(&direction) > Self::BEHIND,
            None => is_unseen,
        }
    }
}

fn index_of(place: [i32; 3]) -> Option<usize> {
    place
        .iter()
        .all(|c| (0..EDGE).contains(c))
        .then(|| ((place[2] * EDGE + place[1]) * EDGE + place[0]) as usize)
}

/// Adds a known voxel to the hashes of the sides that it is within reach of. A sum, so that order does not matter and
/// unknown ones cost nothing.
fn add_to_borders(borders: &mut [u64; 6], place: [i32; 3], index: usize, cell: Cell) {
    let hash = scrambled(2 * index as u64 + 1 + u64::from(cell == Cell::Occupied));
    for (axis, &along) in place.iter().enumerate() {
        if along >= EDGE - REACH {
            borders[2 * axis] = borders[2 * axis].wrapping_add(hash);
        }
        if along < REACH {
            borders[2 * axis + 1] = borders[2 * axis + 1].wrapping_add(hash);
        }
    }
}

/// The finisher of `SplitMix64`: G. Steele, D. Lea, C. Flood, *Fast splittable pseudorandom number generators*, 2014.
fn scrambled(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use maps::voxel::{LogOdds, Rgb};
    use proptest::prelude::*;

    use super::*;

    const SOLID: Voxel = Voxel::new(LogOdds(70));
    const FREE: Voxel = Voxel::new(LogOdds(-40));
    const ORIGIN: TileId = TileId { x: 0, y: 0, z: 0 };

    fn key([x, y, z]: [i32; 3]) -> VoxelKey {
        VoxelKey { x, y, z }
    }

    /// In voxels from the low corner of the tile.
    fn corner(vertex: Vertex) -> [u8; 3] {
        vertex.place.map(|c| (c & 127) + (c >> 7))
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
        assert!(cut.iter().all(|v| corner(**v)[2] == 5 && v.flags & 7 == 4));
        check_quads(&map, ORIGIN, Some(8), 6 * 25);
        let uncut = mesh_tile(&map, ORIGIN, Some(8)).expect("known");
        assert!(
            uncut.vertices().iter().all(|v| v.flags & IS_CUT == 0),
            "its own top is no cut"
        );
        check_quads(&map, ORIGIN, Some(-300), 0);
    }

    #[test]
    fn a_wall_faces_the_space_in_which_the_sensor_was() {
        let wall = |free: std::ops::Range<i32>| {
            let cells = move |[x, _, _]: [i32; 3]| free.contains(&x);
            Facing::of([0, 0, 0], cells)
        };
        let (east, west) = (nalgebra::Vector3::x(), -nalgebra::Vector3::x());
        assert!(
            wall(1..9).hides(east, false),
            "seen from the west, it faces away"
        );
        assert!(
            !wall(1..9).hides(west, true),
            "seen from the east, all of it is there"
        );
        assert!(
            !wall(-9..9).hides(east, false) && !wall(-9..9).hides(west, false),
            "free on both sides"
        );
        assert!(wall(0..0).hides(east, true), "nobody has seen it");
        let along = nalgebra::Vector3::new(0.1, 0.99, 0.0);
        assert!(!wall(1..9).hides(along, false), "edge-on it stays");
    }

    #[test]
    fn a_side_towards_the_unknown_says_so() {
        let mut map = map_of([[5, 5, 5]]);
        map.set_voxel(key([5, 5, 6]), FREE);
        let mesh = mesh_tile(&map, ORIGIN, None).expect("known");
        let seen: Vec<_> = mesh
            .vertices()
            .iter()
            .filter(|v| v.flags & IS_UNSEEN == 0)
            .collect();
        assert_eq!(seen.len(), 4);
        assert!(seen.iter().all(|v| corner(**v)[2] == 6));
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
            let up = |v: &&Vertex| corner(**v) == position && v.flags & 7 == 4;
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
                color: Some(color),
                ..Voxel::new(LogOdds(35))
            },
        );
        let mesh = mesh_tile(&map, ORIGIN, None).expect("known");
        let kept = map
            .voxel(key([0, 0, 0]))
            .and_then(|v| v.color)
            .expect("a colour");
        for vertex in mesh.vertices() {
            assert_eq!((vertex.rgb, vertex.facing >> 5), (kept.0, 3));
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
                let [a, b, c, d] = [0, 1, 2, 3].map(|i: usize| nalgebra::Vector3::from(corner(quad[i]).map(f64::from)));
                let normal = (b - a).cross(&(c - a));
                prop_assert!((normal.norm() - 1.0).abs() < 1e-9 && (b - a + (d - c)).norm() < 1e-9);
                prop_assert!(normal.dot(&(a - center)) > 0.0, "clockwise from outside");
            }
        }
    }
}
