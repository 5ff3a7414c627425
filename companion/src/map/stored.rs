//! Maps in a tile store: read as they are or were, and added to.

use std::path::Path;
use std::time::Duration;

use maps::time::Stamp;
use maps::voxel::VoxelMap;
use store::{AsOf, Settings, Store, StoreError};

use super::MapError;
use super::files::OpenedMap;

/// How every `SQLite` file begins.
pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";

/// The map of a store as it was `as_of` then.
pub(super) fn open(path: &Path, as_of: AsOf) -> Result<OpenedMap, MapError> {
    let store = Store::open(path, Settings::default())?;
    let versions = store.versions(as_of)?;
    let mut map: Option<VoxelMap> = None;
    for version in &versions {
        let damaged = || {
            MapError::Store(StoreError::NotAStore {
                path: path.to_owned(),
            })
        };
        let tile = store.tile(version.id, as_of)?.ok_or_else(damaged)?;
        let map = map.get_or_insert_with(|| VoxelMap::new(tile.resolution_m));
        map.set_tile(&tile).map_err(|source| MapError::Mixed {
            path: path.to_owned(),
            source,
        })?;
    }
    let newest = versions.iter().map(|version| version.at).max();
    let (Some(map), Some(newest)) = (map, newest) else {
        return Err(MapError::NothingYet {
            path: path.to_owned(),
        });
    };
    Ok(OpenedMap {
        map,
        kind: format!(
            "tile store, {} tiles, the newest of {:.1} s after 1970",
            versions.len(),
            newest.as_secs_f64()
        ),
        unclassified: 0,
        resident_bytes: None,
    })
}

/// What an import has done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Imported {
    /// Tiles that are new in the store or other than before.
    pub changed: usize,
    /// Tiles that the store had just like that.
    pub same: usize,
}

/// Puts every tile of a map into the store at `path`, which is made if there is none, as the newest version of it. Tiles
/// that the map does not have stay.
pub fn import(map: &VoxelMap, path: &Path, since_1970: Duration) -> Result<Imported, MapError> {
    let mut store = Store::open(path, Settings::default())?;
    let now = Stamp::ZERO + since_1970;
    let there = store.versions(AsOf::Newest)?;
    if let Some(first) = there.first()
        && let Some(tile) = store.tile(first.id, AsOf::Newest)?
        && tile.resolution_m.to_bits() != map.resolution_m().to_bits()
    {
        return Err(MapError::Resolution {
            path: path.to_owned(),
            there_m: tile.resolution_m,
            here_m: map.resolution_m(),
        });
    }
    let mut done = Imported {
        changed: 0,
        same: 0,
    };
    for mut tile in map.tile_ids().into_iter().filter_map(|id| map.tile(id)) {
        let newest = there.iter().find(|version| version.id == tile.id);
        if newest.is_some_and(|version| version.digest == tile.digest()) {
            done.same += 1;
            continue;
        }
        tile.version = newest.map_or(1, |version| version.version + 1);
        store.put(&tile, now)?;
        done.changed += 1;
    }
    store.flush()?;
    Ok(done)
}
