//! The voxel map, made anew when poses were corrected.
//!
//! What went into a voxel map cannot be taken out of it. So a second map is filled beside the first, a few keyframes a
//! frame so that tracking goes on, and takes its place when it has caught up. Until then the first one stays as it is. Of
//! the two only what differs is said to have changed; a tile of which nothing is left goes out empty, so that nobody keeps
//! its ghost.

use std::collections::{BTreeSet, VecDeque};

use maps::scan::Scan;
use maps::tile::{Tile, TileId};
use maps::voxel::{Rgb, Sources, VoxelMap};
use slam::{DenseKeyframe, DenseUpdate};

use super::CLEARLY_BENEATH_M;

/// Keyframes inserted at once, at most, into a map that is made anew.
const AT_ONCE: usize = 2;

/// How many points went into a map, and where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Points {
    pub(super) all: u64,
    /// Of these, clearly beneath the floor.
    pub(super) beneath: u64,
}

/// A map and the points in it.
struct Filled {
    map: VoxelMap,
    points: Points,
}

/// The voxel map of all settled keyframes.
pub(super) struct DenseMap {
    shown: Filled,
    /// What will take its place.
    next: Option<Filled>,
    /// Keyframes that are still to be inserted, oldest first.
    waiting: VecDeque<DenseKeyframe>,
    /// Tiles by which the shown map differs from the one it has replaced.
    replaced: BTreeSet<TileId>,
    max_range_m: f64,
}

impl DenseMap {
    pub(super) fn new(resolution_m: f64, max_range_m: f64) -> Self {
        Self {
            shown: Filled::new(resolution_m),
            next: None,
            waiting: VecDeque::new(),
            replaced: BTreeSet::new(),
            max_range_m,
        }
    }

    /// The map so far: without the corrections that are being worked in.
    pub(super) fn map(&self) -> &VoxelMap {
        &self.shown.map
    }

    /// How many points are in it.
    pub(super) fn points(&self) -> Points {
        self.shown.points
    }

    /// Keeps in mind what is to be inserted.
    pub(super) fn take(&mut self, update: DenseUpdate) {
        if update.anew {
            self.waiting.clear();
            self.next = Some(Filled::new(self.shown.map.resolution_m()));
        }
        self.waiting.extend(update.keyframes);
    }

    /// Inserts what waits, a few keyframes at a time if the map is made anew; how many. Zero says that nothing is left.
    pub(super) fn insert_some(&mut self) -> usize {
        let most = if self.next.is_some() {
            AT_ONCE
        } else {
            usize::MAX
        };
        let target = self.next.as_mut().unwrap_or(&mut self.shown);
        let count = most.min(self.waiting.len());
        for keyframe in self.waiting.drain(..count) {
            target.insert(&keyframe, self.max_range_m);
        }
        if self.waiting.is_empty()
            && let Some(next) = self.next.take()
        {
            let before = std::mem::replace(&mut self.shown, next);
            self.note_differences(before.map);
        }
        count
    }

    fn note_differences(&mut self, mut before: VoxelMap) {
        self.replaced.extend(before.take_changed_tiles());
        let after = &mut self.shown.map;
        after.take_changed_tiles();
        let ids: BTreeSet<TileId> = before
            .tile_ids()
            .into_iter()
            .chain(after.tile_ids())
            .collect();
        let content = |map: &VoxelMap, id: TileId| map.tile(id).map(|tile| as_version(tile, 0));
        let differ = ids
            .into_iter()
            .filter(|&id| content(&before, id) != content(after, id));
        self.replaced.extend(differ);
    }

    /// The tiles that have changed since this was last asked, in order of their ids, with this version.
    pub(super) fn take_changed(&mut self, version: u64) -> Vec<Tile> {
        let mut ids = std::mem::take(&mut self.replaced);
        let map = &mut self.shown.map;
        ids.extend(map.take_changed_tiles());
        let tile = |id| {
            let nothing = || Tile::unknown(id, version, map.resolution_m());
            as_version(map.tile(id).unwrap_or_else(nothing), version)
        };
        ids.into_iter().map(tile).collect()
    }
}

fn as_version(mut tile: Tile, version: u64) -> Tile {
    tile.version = version;
    tile
}

impl Filled {
    fn new(resolution_m: f64) -> Self {
        Self {
            map: VoxelMap::new(resolution_m),
            points: Points::default(),
        }
    }

    fn insert(&mut self, keyframe: &DenseKeyframe, max_range_m: f64) {
        let pose = keyframe.world_from_camera;
        let (hits, colors): (Vec<_>, Vec<_>) = keyframe
            .points()
            .map(|(p, color)| (pose * p, Rgb(color)))
            .unzip();
        let beneath = hits.iter().filter(|p| p.raw.z < -CLEARLY_BENEATH_M).count();
        self.points.all += hits.len() as u64;
        self.points.beneath += beneath as u64;
        self.map.insert_scan(&Scan {
            colors: &colors,
            max_range_m,
            at: keyframe.at,
            source: Sources::UAV,
            ..Scan::new(pose.translation(), &hits)
        });
    }
}

#[cfg(test)]
mod tests {
    use maps::camera::{Pinhole, RgbdFrame};
    use maps::time::Stamp;
    use slam::{Settings, Slam};

    use super::*;

    /// A keyframe of a patterned wall, 2 m away.
    fn keyframe() -> DenseKeyframe {
        let camera = Pinhole {
            width: 160,
            height: 120,
            fx: 130.0,
            fy: 130.0,
            cx: 79.5,
            cy: 59.5,
            distortion: [0.0; 5],
        };
        let patch = |i: usize| {
            let hash = (i % 160 / 6 * 73_856_093) ^ (i / 160 / 6 * 19_349_663);
            (hash.wrapping_mul(0x9e37_79b9) >> 11) as u8
        };
        let frame = RgbdFrame {
            at: Stamp::ZERO,
            width: 160,
            height: 120,
            rgb: (0..160 * 120).map(|i| [patch(i); 3]).collect(),
            depth_m: vec![2.0; 160 * 120],
        };
        let mut slam = Slam::new(camera, Settings::default());
        slam.track(&frame).expect("a good frame");
        let mut update = slam.finish();
        assert_eq!((update.anew, update.keyframes.len()), (false, 1));
        update.keyframes.remove(0)
    }

    fn moved(keyframe: &DenseKeyframe, east_m: f64) -> DenseKeyframe {
        let mut moved = keyframe.clone();
        moved.world_from_camera.raw.translation.vector.x += east_m;
        moved
    }

    fn is_empty(tile: &Tile) -> bool {
        *tile == Tile::unknown(tile.id, tile.version, tile.resolution_m)
    }

    fn update(anew: bool, keyframes: Vec<DenseKeyframe>) -> DenseUpdate {
        DenseUpdate { anew, keyframes }
    }

    #[test]
    fn whoever_follows_the_tiles_keeps_no_ghosts_of_a_map_made_anew() {
        let first = keyframe();
        let mut dense = DenseMap::new(0.1, 10.0);
        let mut copy = VoxelMap::new(0.1);
        dense.take(update(false, vec![first.clone(), moved(&first, 60.0)]));
        assert_eq!(dense.insert_some(), 2);
        for tile in dense.take_changed(1) {
            copy.set_tile(&tile).expect("the same resolution");
        }
        assert_eq!(copy.digest(), dense.map().digest());
        let before = dense.map().tile_ids();

        // The loop says that the first is in fact far to the west; the second stays.
        dense.take(update(
            true,
            vec![moved(&first, -40.0), moved(&first, 60.0)],
        ));
        while dense.insert_some() > 0 {}
        let changed = dense.take_changed(2);
        assert!(changed.iter().all(|tile| tile.version == 2));
        let emptied: Vec<TileId> = changed
            .iter()
            .filter(|tile| is_empty(tile))
            .map(|tile| tile.id)
            .collect();
        assert!(!emptied.is_empty() && emptied.iter().all(|id| before.contains(id)));
        let stayed = dense
            .map()
            .tile_ids()
            .into_iter()
            .filter(|id| before.contains(id));
        assert!(
            stayed.clone().count() > 0,
            "else the next line shows nothing"
        );
        for id in stayed {
            assert!(changed.iter().all(|tile| tile.id != id), "{id} is the same");
        }
        for tile in changed {
            let decoded = Tile::decode(&tile.encode()).expect("what was encoded");
            copy.set_tile(&decoded).expect("the same resolution");
        }
        assert_eq!(copy.digest(), dense.map().digest());
        assert!(dense.take_changed(3).is_empty(), "all was told");
    }

    #[test]
    fn the_old_map_is_shown_until_the_new_one_has_caught_up() {
        let first = keyframe();
        let mut dense = DenseMap::new(0.1, 10.0);
        dense.take(update(false, vec![first.clone()]));
        dense.insert_some();
        let (before, points) = (dense.map().digest(), dense.points());
        dense.take_changed(1);
        let all = (0..5)
            .map(|i| moved(&first, 0.5 + 0.1 * f64::from(i)))
            .collect();
        dense.take(update(true, all));
        assert_eq!(dense.insert_some(), AT_ONCE);
        dense.take(update(false, vec![moved(&first, 1.2)]));
        assert_eq!(dense.insert_some(), AT_ONCE);
        assert_eq!((dense.map().digest(), dense.points()), (before, points));
        assert!(dense.take_changed(2).is_empty());
        assert_eq!(dense.insert_some(), 2, "the one that came in between too");
        assert_ne!(dense.map().digest(), before);
        assert_eq!(dense.points().all, 6 * points.all);
        assert_eq!(dense.insert_some(), 0);
    }

    #[test]
    fn a_correction_that_leaves_no_keyframe_empties_the_map() {
        let mut dense = DenseMap::new(0.1, 10.0);
        dense.take(update(false, vec![keyframe()]));
        dense.insert_some();
        let told = dense.take_changed(1).len();
        dense.take(update(true, Vec::new()));
        dense.insert_some();
        let emptied = dense.take_changed(2);
        assert_eq!(emptied.len(), told);
        assert!(emptied.iter().all(is_empty));
        assert_eq!(dense.points(), Points::default());
    }
}
