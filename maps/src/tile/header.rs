//! What stands before the payload of a tile.
//!
//! ```text
//! magic "TDTL" · format · codec · content · x y z · version · resolution [· base version · base digest] · CRC-32C · payload
//!     4 bytes      u8       u8      u8      3 i16     u64        f64             u64            u64           u32   (little-endian)
//! ```
//!
//! `content` holds the [`Detail`] in its lowest two bits, and in the next whether the tile is a change of a base. The
//! checksum is over everything but itself.

use super::{Base, Detail, TileError, TileId};
use crate::voxel::VoxelMap;

const MAGIC: [u8; 4] = *b"TDTL";
/// The layout of the header that is written and read. Format 1 carried no detail and no base.
const FORMAT: u8 = 2;
/// The coder of the payload. Codec 1 had a single model.
const CODEC: u8 = 2;
const DETAIL_BITS: u8 = 3;
const HAS_BASE: u8 = 4;

/// What a compressed tile says of itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileHeader {
    /// Which tile.
    pub id: TileId,
    /// Counted up by the sender with every change.
    pub version: u64,
    /// The edge of a voxel.
    pub resolution_m: f64,
    /// How much it tells of each voxel.
    pub detail: Detail,
    /// The version that it is a change of; `None` if it is whole.
    pub base: Option<Base>,
}

impl TileHeader {
    /// Reads the header of a compressed tile and checks that no byte of the tile is damaged. The payload may still be one
    /// that no encoder wrote; only decoding tells.
    pub fn read(bytes: &[u8]) -> Result<Self, TileError> {
        Self::split(bytes).map(|(header, _)| header)
    }

    /// The header and the payload.
    pub(super) fn split(bytes: &[u8]) -> Result<(Self, &[u8]), TileError> {
        let mut rest = bytes;
        if take(&mut rest)? != MAGIC {
            return Err(TileError::NotATile);
        }
        let [format] = take(&mut rest)?;
        check_format(format)?;
        let [codec, content] = take(&mut rest)?;
        check_codec(codec)?;
        let mut coordinate = || take(&mut rest).map(i16::from_le_bytes).map(i32::from);
        let id = TileId {
            x: coordinate()?,
            y: coordinate()?,
            z: coordinate()?,
        };
        let version = u64::from_le_bytes(take(&mut rest)?);
        let resolution_m = f64::from_le_bytes(take(&mut rest)?);
        let base = if content & HAS_BASE == 0 {
            None
        } else {
            Some(Base {
                version: u64::from_le_bytes(take(&mut rest)?),
                digest: u64::from_le_bytes(take(&mut rest)?),
            })
        };
        let checked = &bytes[..bytes.len() - rest.len()];
        let stored = u32::from_le_bytes(take(&mut rest)?);
        let computed = checksum(checked, rest);
        if stored != computed {
            return Err(TileError::Damaged { stored, computed });
        }
        if content & !(DETAIL_BITS | HAS_BASE) != 0 {
            return Err(TileError::OtherContent(content));
        }
        let header = Self {
            id,
            version,
            resolution_m,
            detail: Detail::ALL[usize::from(content & DETAIL_BITS)],
            base,
        };
        header.check().map(|()| (header, rest))
    }

    fn check(&self) -> Result<(), TileError> {
        if !self.id.is_in_world() {
            return Err(TileError::OutsideWorld(self.id));
        }
        if !VoxelMap::RESOLUTION_M.contains(&self.resolution_m) {
            return Err(TileError::BadResolution {
                id: self.id,
                tile_m: self.resolution_m,
            });
        }
        Ok(())
    }

    /// The bytes before the payload; the checksum's are yet to be put in by [`seal`].
    pub(super) fn write(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(4096);
        let has_base = if self.base.is_some() { HAS_BASE } else { 0 };
        bytes.extend(MAGIC);
        bytes.extend([FORMAT, CODEC, self.detail as u8 | has_base]);
        for c in [self.id.x, self.id.y, self.id.z] {
            // What is outside of the world stays so.
            let c = c.clamp(i32::from(i16::MIN), i32::from(i16::MAX)) as i16;
            bytes.extend(c.to_le_bytes());
        }
        bytes.extend(self.version.to_le_bytes());
        bytes.extend(self.resolution_m.to_le_bytes());
        if let Some(base) = self.base {
            bytes.extend(base.version.to_le_bytes());
            bytes.extend(base.digest.to_le_bytes());
        }
        bytes.extend([0; 4]);
        bytes
    }
}

/// Puts the checksum into a tile whose header, this included, has `header` bytes.
pub(super) fn seal(bytes: &mut [u8], header: usize) {
    let (head, payload) = bytes.split_at_mut(header);
    let (head, stored) = head.split_at_mut(header - 4);
    stored.copy_from_slice(&checksum(head, payload).to_le_bytes());
}

fn check_format(found: u8) -> Result<(), TileError> {
    if found == FORMAT {
        return Ok(());
    }
    Err(TileError::OtherFormat {
        found,
        known: FORMAT,
    })
}

fn check_codec(found: u8) -> Result<(), TileError> {
    if found == CODEC {
        return Ok(());
    }
    Err(TileError::OtherCodec {
        found,
        known: CODEC,
    })
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N], TileError> {
    bytes
        .split_off(..N)
        .and_then(|head| head.try_into().ok())
        .ok_or(TileError::TooShort)
}

fn checksum(head: &[u8], payload: &[u8]) -> u32 {
    crc32c::crc32c_append(crc32c::crc32c(head), payload)
}
