//! Orthogonal slices of the CT through a point, as pictures.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "voxels of the lattice and grey values are clamped before the cast"
)]

use crate::mirror::Model;
use egui::{Color32, ColorImage};
use glam::DVec3;
use osteon_sim_core::grid::Grid;

/// Across which axis of the lattice a slice lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Across {
    /// x runs through the slices.
    X = 0,
    /// y does.
    Y = 1,
    /// z does.
    Z = 2,
}

impl Across {
    /// All three.
    pub(crate) const ALL: [Self; 3] = [Self::Z, Self::Y, Self::X];

    /// The lattice's axes to the right and upwards in the picture.
    pub(crate) fn axes(self) -> [usize; 2] {
        match self {
            Self::X => [1, 2],
            Self::Y => [0, 2],
            Self::Z => [0, 1],
        }
    }

    /// Name for people; the lattice lies along the patient's axes but for a few degrees.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::X => "sagittal",
            Self::Y => "coronal",
            Self::Z => "axial",
        }
    }
}

/// A grey scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GreyScale {
    /// CT number in the middle, HU.
    pub(crate) level_hu: f32,
    /// From black to white, HU.
    pub(crate) width_hu: f32,
}

impl Default for GreyScale {
    fn default() -> Self {
        Self {
            level_hu: 500.0,
            width_hu: 1600.0,
        }
    }
}

impl GreyScale {
    /// Grey of a CT number.
    pub(crate) fn grey(self, hu: f32) -> u8 {
        let share = (hu - self.level_hu) / self.width_hu.max(1.0) + 0.5;
        (share.clamp(0.0, 1.0) * 255.0).round() as u8
    }
}

/// The voxel next to a point of the bone frame (mm), within the lattice.
pub(crate) fn voxel_at(grid: &Grid, p: DVec3) -> [usize; 3] {
    let last = DVec3::from_array(grid.dims.map(|n| n as f64 - 1.0));
    let v = (p / grid.spacing_mm).round();
    if v.is_nan() {
        return [0; 3];
    }
    v.clamp(DVec3::ZERO, last).to_array().map(|v| v as usize)
}

/// What was cut away.
const CUT: Color32 = Color32::from_rgb(0x3a, 0x1f, 0x24);
/// Voxels that no chunk holds.
const NOTHING: Color32 = Color32::BLACK;

/// The slice through a voxel: one texel a voxel, the first axis to the right, the second upwards. Cut
/// voxels are dark red.
pub(crate) fn slice(
    model: &Model,
    across: Across,
    voxel: [usize; 3],
    scale: GreyScale,
) -> ColorImage {
    let grid = model.bone.grid();
    let [right, up] = across.axes();
    let [width, height] = [grid.dims[right], grid.dims[up]];
    let mut pixels = Vec::with_capacity(width * height);
    let mut at = voxel;
    for row in (0..height).rev() {
        at[up] = row;
        for column in 0..width {
            at[right] = column;
            pixels.push(model.bone.locate(at).map_or(NOTHING, |(chunk, offset)| {
                if model.cut.value(chunk, offset) < 0 && model.bone.chunk(chunk).solid[offset] > 0 {
                    CUT
                } else {
                    let hu = model.bone.chunk(chunk).density_hu[offset];
                    Color32::from_gray(scale.grey(f32::from(hu)))
                }
            }));
        }
    }
    ColorImage::new([width, height], pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::bones::{ball, carve};
    use crate::testing::stage::model;
    use osteon_sim_core::cut::Cut;

    #[test]
    fn a_slice_shows_bone_where_it_is_and_the_hole_in_it() {
        let (bone, middle) = ball(64, DVec3::new(0.5, 0.6, 0.7), 12.0);
        let mut cut = Cut::new(&bone);
        let hole = middle + DVec3::new(4.0, 0.0, 0.0);
        carve(&bone, &mut cut, |p| (p - hole).length() - 3.0);
        let model = model(&bone, cut);
        let grid = bone.grid();
        let centre = voxel_at(grid, middle);
        for across in Across::ALL {
            let image = slice(&model, across, centre, GreyScale::default());
            let [right, up] = across.axes();
            assert_eq!(image.size, [grid.dims[right], grid.dims[up]]);
            for row in 0..image.size[1] {
                for column in 0..image.size[0] {
                    let mut v = centre;
                    v[right] = column;
                    v[up] = image.size[1] - 1 - row;
                    let p = grid.centre(v[0], v[1], v[2]);
                    let pixel = image.pixels[row * image.size[0] + column];
                    let (depth, gone) = (12.0 - (p - middle).length(), 3.0 - (p - hole).length());
                    if depth > 0.1 && gone > 0.1 {
                        assert_eq!(pixel, CUT, "{across:?} {v:?}");
                    } else if depth > 0.1 && gone < -0.1 {
                        // bones::from_sdf: 300 HU inside, 900 at the surface
                        let hu = if depth > 1.5 { 300.0 } else { 900.0 };
                        assert_eq!(pixel, Color32::from_gray(GreyScale::default().grey(hu)));
                    }
                }
            }
        }
    }

    #[test]
    fn the_grey_scale_runs_from_black_to_white_and_points_beside_the_lattice_are_clamped() {
        let scale = GreyScale {
            level_hu: 100.0,
            width_hu: 200.0,
        };
        assert_eq!(
            [-500.0, 0.0, 100.0, 200.0, 900.0].map(|hu| scale.grey(hu)),
            [0, 0, 128, 255, 255]
        );
        let grid = Grid::new([10, 20, 30], DVec3::splat(0.5)).unwrap();
        assert_eq!(voxel_at(&grid, DVec3::splat(-9.0)), [0; 3]);
        assert_eq!(voxel_at(&grid, DVec3::splat(1e9)), [9, 19, 29]);
        assert_eq!(voxel_at(&grid, DVec3::splat(f64::NAN)), [0; 3]);
    }
}
