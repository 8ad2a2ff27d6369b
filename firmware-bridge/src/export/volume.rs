//! The bone as it was left, as a volume of CT numbers.

use crate::import::{Kind, PlaneError, VolumeFile};
use anyhow::bail;
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::{CHUNK, voxel_in_chunk};
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;

/// CT number of what is no bone, HU.
const AIR_HU: i16 = -1000;

/// Calls `plane` with the CT numbers of each layer, x fastest, from z = 0 on.
fn planes<E>(
    bone: &Bone,
    cut: &Cut,
    mut plane: impl FnMut(&[i16]) -> Result<(), E>,
) -> Result<(), E> {
    let [nx, ny, nz] = bone.grid().dims;
    let mut values = vec![AIR_HU; nx * ny];
    for k in 0..nz {
        values.fill(AIR_HU);
        for (cy, cx) in chunks_of([nx, ny]) {
            let Some(chunk) = bone.chunk_at([cx, cy, k / CHUNK]) else {
                continue;
            };
            let data = bone.chunk(chunk);
            for j in cy * CHUNK..((cy + 1) * CHUNK).min(ny) {
                for i in cx * CHUNK..((cx + 1) * CHUNK).min(nx) {
                    let voxel = voxel_in_chunk(i % CHUNK, j % CHUNK, k % CHUNK);
                    if data.solid[voxel].min(cut.value(chunk, voxel)) > 0 {
                        values[j * nx + i] = data.density_hu[voxel];
                    }
                }
            }
        }
        plane(&values)?;
    }
    Ok(())
}

fn chunks_of([nx, ny]: [usize; 2]) -> impl Iterator<Item = (usize, usize)> {
    let across = nx.div_ceil(CHUNK);
    (0..ny.div_ceil(CHUNK)).flat_map(move |y| (0..across).map(move |x| (y, x)))
}

/// Writes NIfTI-1.
pub(super) fn nifti(path: &Path, bone: &Bone, cut: &Cut) -> anyhow::Result<()> {
    let mut file = VolumeFile::create(path, bone.grid(), bone.lps_from_bone(), Kind::I16)?;
    let mut floats = Vec::new();
    let written = planes(bone, cut, |values| {
        floats.clear();
        floats.extend(values.iter().map(|v| f32::from(*v)));
        file.plane(&floats)
    });
    match written {
        Ok(()) => {}
        Err(PlaneError::Import(e)) => return Err(e.into()),
        // every value is an i16
        Err(PlaneError::Value(v)) => bail!("{}: {v} HU does not fit", path.display()),
    }
    file.finish()?;
    Ok(())
}

/// Writes NRRD (teem's format, version 4): raw, little endian, world LPS.
pub(super) fn nrrd(path: &Path, bone: &Bone, cut: &Cut) -> std::io::Result<()> {
    let grid = bone.grid();
    let place = bone.lps_from_bone();
    let text = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let directions: Vec<String> = [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .zip(grid.spacing_mm.to_array())
        .map(|(axis, h)| text(place.vector(axis) * h))
        .collect();
    let [nx, ny, nz] = grid.dims;
    let mut file = BufWriter::with_capacity(1 << 20, File::create(path)?);
    write!(
        file,
        "NRRD0004\n# Osteon: CT numbers in HU of the bone that is left, {AIR_HU} elsewhere\ntype: int16\ndimension: 3\nspace: left-posterior-superior\nsizes: {nx} {ny} {nz}\nspace directions: {}\nkinds: domain domain domain\nendian: little\nencoding: raw\nspace units: \"mm\" \"mm\" \"mm\"\nspace origin: {}\n\n",
        directions.join(" "),
        text(place.translation)
    )?;
    planes(bone, cut, |values| {
        values
            .iter()
            .try_for_each(|v| file.write_all(&v.to_le_bytes()))
    })?;
    file.flush()?;
    file.get_ref().sync_all()
}
