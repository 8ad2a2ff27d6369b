//! A number that tells two bones apart.

use super::Bone;
use xxhash_rust::xxh3::Xxh3;

impl Bone {
    /// XXH3-64 of all that the servo reads of the bone: lattice, frame, chunks. The bits of every machine
    /// are the same. Reads all of it: not for the servo's loop.
    pub fn digest(&self) -> u64 {
        let mut all = Xxh3::new();
        for n in self.grid.dims {
            all.update(&(n as u64).to_le_bytes());
        }
        let turn = self.lps_from_bone.rotation.to_array();
        let place = self.lps_from_bone.translation.to_array();
        let spacing = self.grid.spacing_mm.to_array();
        for v in spacing.iter().chain(&turn).chain(&place) {
            all.update(&v.to_bits().to_le_bytes());
        }
        let mut bytes = Vec::new();
        for chunk in 0..self.chunk_count() {
            for c in self.chunk_coord(chunk) {
                all.update(&c.to_le_bytes());
            }
            all.update(&self.bony_bricks(chunk).to_le_bytes());
            let data = self.chunk(chunk);
            for values in [data.density_hu, data.solid] {
                bytes.clear();
                bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
                all.update(&bytes);
            }
            all.update(data.class);
            all.update(data.label);
        }
        all.digest()
    }
}
