//! Bounded memory: far tiles are handed out, to be kept in a store, and taken back when they are wanted.
//!
//! Nothing the store holds can be lost. A tile that was handed out is *away*: scans still add to it, but what they add is
//! kept apart from what is in the store. The map gives such a half tile to nobody, neither as a tile nor as a change nor by
//! evicting it again, until the tile is restored; then the two are put together. Their log-odds add up.

use super::VoxelMap;
use super::grid::TileNode;
use crate::frame::{Point, World};
use crate::tile::{Tile, TileError, TileId};

/// Why a tile was not taken back.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum RestoreError {
    /// The map has it: taking it back would undo what has happened since.
    #[error("tile {0} was not handed out")]
    NotAway(TileId),
    /// Something newer was handed out.
    #[error("tile {id} was handed out with version {handed_out}, this is version {found}")]
    Older {
        /// The tile.
        id: TileId,
        /// The version that was handed out.
        handed_out: u64,
        /// The version that was to be taken back.
        found: u64,
    },
    /// No map takes it.
    #[error(transparent)]
    Refused(#[from] TileError),
}

impl VoxelMap {
    /// Takes out the tiles all of which are further than `keep_m` from a place, sorted. Those stay of which the map has
    /// yet to say that they changed ([`Self::take_changed_tiles`]), and those that are away already.
    #[must_use = "the map no longer has them"]
    pub fn evict(&mut self, around: Point<World>, keep_m: f64) -> Vec<Tile> {
        let far: Vec<_> = self
            .tile_ids()
            .into_iter()
            .filter(|id| self.distance_m(*id, around) > keep_m)
            .filter(|id| self.tiles.get(*id).is_some_and(|tile| !tile.changed))
            .collect();
        let tiles: Vec<_> = far.into_iter().filter_map(|id| self.tile(id)).collect();
        for tile in &tiles {
            self.tiles.remove(tile.id);
            self.away.insert(tile.id, tile.version);
        }
        tiles
    }

    /// The tiles that were handed out and have not come back, sorted.
    pub fn away_tiles(&self) -> impl Iterator<Item = TileId> {
        self.away.keys().copied()
    }

    /// Those of them to which scans have added something: they should be restored.
    pub fn wanted_tiles(&self) -> impl Iterator<Item = TileId> {
        self.away_tiles()
            .filter(|id| self.tiles.get(*id).is_some_and(TileNode::is_any_known))
    }

    /// Takes back a tile that was handed out, and adds what scans have added since. It counts as changed if they have.
    pub fn restore(&mut self, tile: &Tile) -> Result<(), RestoreError> {
        self.check(tile)?;
        let id = tile.id;
        let handed_out = *self.away.get(&id).ok_or(RestoreError::NotAway(id))?;
        if tile.version < handed_out {
            return Err(RestoreError::Older {
                id,
                handed_out,
                found: tile.version,
            });
        }
        self.away.remove(&id);
        let added = self.tiles.remove(id);
        let node = self.tiles.get_or_insert(id);
        node.replace(tile);
        node.changed = false;
        for (at, newer) in added.iter().flat_map(TileNode::blocks) {
            node.edit(at, |block| block.add(newer));
        }
        node.commit();
        Ok(())
    }

    /// From a place to the nearest point of a tile.
    fn distance_m(&self, id: TileId, from: Point<World>) -> f64 {
        let edge_m = f64::from(TileId::EDGE) * self.resolution_m;
        let low = nalgebra::Vector3::new(id.x, id.y, id.z).map(f64::from) * edge_m;
        let inside = from.raw.coords.sup(&low).inf(&low.add_scalar(edge_m));
        (from.raw.coords - inside).norm()
    }
}

impl TileNode {
    fn is_any_known(&self) -> bool {
        self.blocks().any(|(_, block)| !block.is_unknown())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::Scan;
    use crate::voxel::{LogOdds, VoxelKey};

    fn see(map: &mut VoxelMap, x_m: f64) {
        let hit = [Point::new(x_m + 2.05, 0.05, 0.05)];
        map.insert_scan(&Scan::new(Point::new(x_m + 0.05, 0.05, 0.05), &hit));
    }

    fn wall(map: &VoxelMap, x_m: f64) -> Option<LogOdds> {
        let key = map.key_of(Point::new(x_m + 2.05, 0.05, 0.05));
        map.voxel(key).map(|voxel| voxel.log_odds)
    }

    #[test]
    fn what_was_handed_out_comes_back_as_it_was() {
        let mut map = VoxelMap::new(0.1);
        for x_m in [0.0, 100.0] {
            see(&mut map, x_m);
        }
        let digest = map.digest();
        assert_eq!(map.evict(Point::origin(), 50.0), [], "not yet told");
        map.take_changed_tiles();
        let tiles = map.evict(Point::origin(), 50.0);
        assert_eq!(tiles.len(), 1);
        assert_eq!(wall(&map, 100.0), None);
        assert_eq!(map.tile_ids(), [TileId { x: 0, y: 0, z: 0 }]);
        assert_eq!(map.away_tiles().collect::<Vec<_>>(), [tiles[0].id]);
        assert_eq!(map.wanted_tiles().count(), 0);
        assert_eq!(map.restore(&tiles[0]), Ok(()));
        assert_eq!(map.digest(), digest);
        assert_eq!(map.take_changed_tiles(), []);
        assert_eq!(
            map.restore(&tiles[0]),
            Err(RestoreError::NotAway(tiles[0].id))
        );
    }

    #[test]
    fn scans_of_a_tile_that_is_away_are_added_to_it_and_never_stand_for_it() {
        let mut map = VoxelMap::new(0.1);
        see(&mut map, 100.0);
        map.take_changed_tiles();
        let tiles = map.evict(Point::origin(), 50.0);
        let id = tiles[0].id;
        see(&mut map, 100.0);
        assert_eq!(wall(&map, 100.0), Some(LogOdds(17)), "what is new is known");
        // There is no way to get the half tile out.
        assert_eq!(map.tile(id), None);
        assert_eq!(map.tile_ids(), []);
        assert_eq!(map.take_changed_tiles(), []);
        assert_eq!(map.evict(Point::origin(), 50.0), []);
        assert_eq!(map.wanted_tiles().collect::<Vec<_>>(), [id]);
        let older = Tile {
            version: 0,
            ..tiles[0].clone()
        };
        assert_eq!(
            map.restore(&older).map_err(|e| e.to_string()),
            Err("tile 7/0/0 was handed out with version 1, this is version 0".to_owned())
        );
        assert_eq!(map.restore(&tiles[0]), Ok(()));
        assert_eq!(wall(&map, 100.0), Some(LogOdds(34)));
        let free = map.voxel(VoxelKey::new(1010, 0, 0));
        assert_eq!(free.map(|v| v.log_odds), Some(LogOdds(-16)));
        assert_eq!(map.take_changed_tiles(), [id]);
        assert_eq!(map.tile(id).map(|tile| tile.version), Some(2));
    }
}
