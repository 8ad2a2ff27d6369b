//! A number that tells two tools apart.

use super::{Shape, Tool};
use glam::Vec3;
use xxhash_rust::xxh3::Xxh3;

impl Tool {
    /// XXH3-64 of all that the servo reads of the tool; its name and colour are not in it.
    pub fn digest(&self) -> u64 {
        let mut all = Xxh3::new();
        match &self.shape {
            // numbers are printed so that they read back to the same bits
            Shape::Revolved(solid) => all.update(format!("{solid:?}").as_bytes()),
            Shape::Grid(grid) => {
                vector(&mut all, grid.origin);
                all.update(&grid.spacing_mm.to_bits().to_le_bytes());
                all.update(format!("{:?} {:?}", grid.dims, grid.bounds).as_bytes());
                for values in grid.values.chunks(1 << 16) {
                    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
                    all.update(&bytes);
                }
            }
        }
        for element in &self.elements {
            vector(&mut all, element.position);
            vector(&mut all, element.normal);
            all.update(&element.area_mm2.to_bits().to_le_bytes());
            all.update(&element.radius_mm.to_bits().to_le_bytes());
            all.update(&[u8::from(element.cutting)]);
        }
        all.update(&self.rpm.to_bits().to_le_bytes());
        all.update(&[self.lips, u8::from(self.stall_nmm.is_some())]);
        all.update(&self.stall_nmm.unwrap_or(0.0).to_bits().to_le_bytes());
        all.digest()
    }
}

fn vector(all: &mut Xxh3, v: Vec3) {
    for c in v.to_array() {
        all.update(&c.to_bits().to_le_bytes());
    }
}
