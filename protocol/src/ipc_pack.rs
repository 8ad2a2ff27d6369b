//! LZ4 blocks of the viewer link: the immutable bone chunk by chunk, and the cut brick by brick.
//!
//! The unpacked size is known before unpacking, so a block is unpacked into a buffer of that size
//! and can never ask for more.

use crate::ipc::{BRICK_BYTES, BonePiece, Bricks, MAX_BRICKS, PIECE_BYTES};
use crate::ipc_frame::IpcError;

/// Voxels of a chunk.
const PIECE_VOXELS: usize = 32 * 32 * 32;
const _: () = assert!(PIECE_BYTES == PIECE_VOXELS * (2 + 2 + 1 + 1));

/// The values of one chunk: 32 768 of each, brick-major.
#[derive(Debug, Clone, Copy)]
pub struct PieceValues<'a> {
    /// CT number, HU.
    pub density_hu: &'a [i16],
    /// Signed distance to the surface, in the lattice's quantum, positive inside.
    pub solid: &'a [i16],
    /// Tissue class.
    pub class: &'a [u8],
    /// Structure label.
    pub label: &'a [u8],
}

/// [`PieceValues`] as they come out of a [`BonePiece`]: 32 768 of each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnpackedPiece {
    /// CT number, HU.
    pub density_hu: Vec<i16>,
    /// Signed distance to the surface, in the lattice's quantum, positive inside.
    pub solid: Vec<i16>,
    /// Tissue class.
    pub class: Vec<u8>,
    /// Structure label.
    pub label: Vec<u8>,
}

/// Packs chunk number `chunk` at chunk coordinate `coord` with its mask of bony bricks.
pub fn pack_piece(
    chunk: u32,
    coord: [u16; 3],
    bony: u64,
    values: &PieceValues<'_>,
) -> Result<BonePiece, IpcError> {
    let lengths = [
        values.density_hu.len(),
        values.solid.len(),
        values.class.len(),
        values.label.len(),
    ];
    if lengths != [PIECE_VOXELS; 4] {
        return Err(IpcError::Range("chunk's voxel count"));
    }
    let mut raw = Vec::with_capacity(PIECE_BYTES);
    append_le(values.density_hu, &mut raw);
    append_le(values.solid, &mut raw);
    raw.extend_from_slice(values.class);
    raw.extend_from_slice(values.label);
    Ok(BonePiece {
        chunk,
        coord,
        bony,
        lz4: lz4_flex::block::compress(&raw),
    })
}

/// Unpacks a chunk; refuses a block that does not unpack to exactly [`PIECE_BYTES`].
pub fn unpack_piece(piece: &BonePiece) -> Result<UnpackedPiece, IpcError> {
    let raw = unpack_exact(&piece.lz4, PIECE_BYTES, "bone piece")?;
    let (density_hu, rest) = raw.split_at(2 * PIECE_VOXELS);
    let (solid, rest) = rest.split_at(2 * PIECE_VOXELS);
    let (class, label) = rest.split_at(PIECE_VOXELS);
    Ok(UnpackedPiece {
        density_hu: from_le(density_hu),
        solid: from_le(solid),
        class: class.to_vec(),
        label: label.to_vec(),
    })
}

/// Packs the cut of the bricks `ids` (chunk, brick): `values` holds 512 of each, in their order.
pub fn pack_bricks(
    epoch: u32,
    revision: u64,
    ids: Vec<(u32, u8)>,
    values: &[i16],
) -> Result<Bricks, IpcError> {
    if ids.len() > MAX_BRICKS {
        return Err(IpcError::Range("number of bricks"));
    }
    if 2 * values.len() != ids.len() * BRICK_BYTES {
        return Err(IpcError::Range("bricks' voxel count"));
    }
    let mut raw = Vec::with_capacity(2 * values.len());
    append_le(values, &mut raw);
    Ok(Bricks {
        epoch,
        revision,
        ids,
        lz4: lz4_flex::block::compress(&raw),
    })
}

/// Unpacks the cut: 512 values a brick, in the order of [`Bricks::ids`]. Refuses a block that does
/// not unpack to exactly that.
pub fn unpack_bricks(bricks: &Bricks) -> Result<Vec<i16>, IpcError> {
    if bricks.ids.len() > MAX_BRICKS {
        return Err(IpcError::Range("number of bricks"));
    }
    let raw = unpack_exact(&bricks.lz4, bricks.ids.len() * BRICK_BYTES, "brick block")?;
    Ok(from_le(&raw))
}

fn unpack_exact(lz4: &[u8], size: usize, what: &'static str) -> Result<Vec<u8>, IpcError> {
    let mut raw = vec![0; size];
    match lz4_flex::block::decompress_into(lz4, &mut raw) {
        Ok(length) if length == size => Ok(raw),
        Ok(_) | Err(_) => Err(IpcError::Block(what)),
    }
}

fn append_le(values: &[i16], raw: &mut Vec<u8>) {
    raw.extend(values.iter().flat_map(|v| v.to_le_bytes()));
}

fn from_le(raw: &[u8]) -> Vec<i16> {
    let (pairs, _) = raw.as_chunks::<2>();
    pairs.iter().map(|p| i16::from_le_bytes(*p)).collect()
}

#[cfg(test)]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "test patterns wrap on purpose"
)]
mod tests {
    use super::*;

    fn ramp(seed: usize) -> Vec<i16> {
        (0..PIECE_VOXELS)
            .map(|n| (n.wrapping_mul(seed) >> 3) as i16)
            .collect()
    }

    fn bytes(seed: usize) -> Vec<u8> {
        (0..PIECE_VOXELS).map(|n| (n / seed) as u8).collect()
    }

    #[test]
    fn a_piece_comes_back_value_by_value() {
        let (density, solid, class, label) = (ramp(31), ramp(7), bytes(9), bytes(500));
        let values = PieceValues {
            density_hu: &density,
            solid: &solid,
            class: &class,
            label: &label,
        };
        let piece = pack_piece(5, [1, 2, 3], 0xF0, &values).unwrap();
        assert_eq!((piece.chunk, piece.coord, piece.bony), (5, [1, 2, 3], 0xF0));
        let back = unpack_piece(&piece).unwrap();
        assert_eq!(
            (back.density_hu, back.solid, back.class, back.label),
            (density, solid, class, label)
        );
    }

    #[test]
    fn a_piece_of_another_length_is_refused_on_both_sides() {
        let (density, solid, class) = (ramp(31), ramp(7), bytes(9));
        let values = PieceValues {
            density_hu: &density,
            solid: &solid,
            class: &class,
            label: &class[1..],
        };
        assert!(pack_piece(0, [0; 3], 0, &values).is_err());
        for size in [0, PIECE_BYTES - 1, PIECE_BYTES + 1, 64 << 20] {
            let piece = BonePiece {
                chunk: 0,
                coord: [0; 3],
                bony: 0,
                lz4: lz4_flex::block::compress(&vec![0; size]),
            };
            assert_eq!(
                unpack_piece(&piece),
                Err(IpcError::Block("bone piece")),
                "{size} bytes"
            );
        }
    }

    #[test]
    fn bricks_come_back_in_the_order_of_their_ids() {
        let values: Vec<i16> = (0..1024).map(|n| n - 500).collect();
        let bricks = pack_bricks(2, 77, vec![(9, 63), (1, 0)], &values).unwrap();
        assert_eq!(unpack_bricks(&bricks).unwrap(), values);
        let none = pack_bricks(0, 0, Vec::new(), &[]).unwrap();
        assert_eq!(unpack_bricks(&none).unwrap(), Vec::<i16>::new());
    }

    #[test]
    fn bricks_of_another_count_are_refused_on_both_sides() {
        assert!(pack_bricks(0, 0, vec![(0, 0)], &[0; 511]).is_err());
        let many = vec![(0, 0); MAX_BRICKS + 1];
        assert!(pack_bricks(0, 0, many.clone(), &vec![0; many.len() * 512]).is_err());
        let mut bricks = pack_bricks(0, 0, vec![(0, 0)], &[3; 512]).unwrap();
        bricks.ids.push((0, 1));
        assert_eq!(unpack_bricks(&bricks), Err(IpcError::Block("brick block")));
        bricks.ids = many;
        assert!(unpack_bricks(&bricks).is_err());
    }
}
