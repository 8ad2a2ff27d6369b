//! The depth gauge: the layers along the planned axis and where the tool's tip is among them.
#![expect(
    clippy::cast_possible_truncation,
    reason = "f64 becomes f32 on the screen"
)]

use super::Status;
use crate::palette::{DEPTH, tissue_colour};
use egui::{Align2, Color32, FontId, Pos2, Rect, Stroke, Vec2, pos2};
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::Tissue;

/// Depths that the gauge shows, mm past the joint face.
const FROM_MM: f64 = -8.0;
/// The deepest.
const TO_MM: f64 = 32.0;
/// Distance of two samples along the axis, mm.
const STEP_MM: f64 = 0.25;

/// A stretch of one tissue along the planned axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Layer {
    /// Where it begins, mm past the joint face.
    pub(crate) from_mm: f64,
    /// Where it ends.
    pub(crate) to_mm: f64,
    /// Tissue class.
    pub(crate) class: u8,
}

/// The layers of an uncut bone along the planned axis.
pub(crate) fn layers(bone: &Bone, bone_from_plan: &Pose) -> Vec<Layer> {
    let mut found: Vec<Layer> = Vec::new();
    let mut depth = FROM_MM;
    while depth < TO_MM {
        let p = bone_from_plan.point(DVec3::Z * -(depth + 0.5 * STEP_MM));
        let class = class_at(bone, p);
        let to_mm = depth + STEP_MM;
        match found.last_mut() {
            Some(last) if last.class == class => last.to_mm = to_mm,
            _ => found.push(Layer {
                from_mm: depth,
                to_mm,
                class,
            }),
        }
        depth = to_mm;
    }
    found.retain(|l| l.class != Tissue::Air as u8);
    found
}

/// Tissue class of the voxel next to a point; air outside the solid bone.
fn class_at(bone: &Bone, p: DVec3) -> u8 {
    let grid = bone.grid();
    let last = DVec3::from_array(grid.dims.map(|n| n as f64)) * grid.spacing_mm;
    if p.cmplt(DVec3::ZERO).any() || p.cmpgt(last).any() {
        return Tissue::Air as u8;
    }
    bone.locate(crate::slices::voxel_at(grid, p))
        .filter(|&(chunk, at)| bone.chunk(chunk).solid[at] > 0)
        .map_or(Tissue::Air as u8, |(chunk, at)| bone.chunk(chunk).class[at])
}

/// Shows the gauge at the right edge of `view`.
pub(crate) fn show(ui: &egui::Ui, view: Rect, status: &Status) {
    if status.layers.is_empty() || view.height() < 160.0 || view.width() < 240.0 {
        return;
    }
    let painter = ui.painter();
    let bar = Rect::from_min_size(
        pos2(view.right() - 34.0, view.top() + 34.0),
        Vec2::new(14.0, view.height() - 78.0),
    );
    let y = |mm: f64| {
        let share = ((mm - FROM_MM) / (TO_MM - FROM_MM)).clamp(0.0, 1.0);
        bar.top() + bar.height() * share as f32
    };
    painter.rect_filled(bar.expand(2.0), 2.0, Color32::from_black_alpha(170));
    for layer in status.layers.iter() {
        let [r, g, b] = tissue_colour(layer.class);
        let part = Rect::from_min_max(
            pos2(bar.left(), y(layer.from_mm)),
            pos2(bar.right(), y(layer.to_mm)),
        );
        painter.rect_filled(part, 0.0, Color32::from_rgb(r, g, b));
    }
    let small = FontId::proportional(10.5);
    let grey = Color32::from_gray(0xb8);
    for mm in [0, 10, 20, 30] {
        let at = y(f64::from(mm));
        painter.hline(bar.left() - 4.0..=bar.left(), at, Stroke::new(1.0, grey));
        let place = pos2(bar.left() - 6.0, at);
        painter.text(
            place,
            Align2::RIGHT_CENTER,
            format!("{mm}"),
            small.clone(),
            grey,
        );
    }
    let above = pos2(bar.right() + 6.0, bar.top() - 6.0);
    painter.text(
        above,
        Align2::RIGHT_BOTTOM,
        "depth, mm",
        small.clone(),
        grey,
    );
    let Some(pose) = status.pose else { return };
    let at = y(f64::from(pose.depth_mm));
    let tip = pos2(bar.right() + 1.0, at);
    let triangle: Vec<Pos2> = vec![tip, tip + Vec2::new(9.0, -5.0), tip + Vec2::new(9.0, 5.0)];
    painter.add(egui::Shape::convex_polygon(triangle, DEPTH, Stroke::NONE));
    painter.hline(bar.x_range(), at, Stroke::new(1.5, DEPTH));
    let below = pos2(bar.right() + 6.0, bar.bottom() + 6.0);
    let text = format!("{:.1}", pose.depth_mm);
    painter.text(
        below,
        Align2::RIGHT_TOP,
        text,
        FontId::proportional(13.0),
        DEPTH,
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::bones::ball;

    #[test]
    fn the_layers_of_a_ball_are_where_they_were_planted() {
        // cartilage to 1.6 mm, plate to 3.2 mm, then cancellous bone to the other side
        let (bone, middle) = ball(80, DVec3::splat(0.4), 12.0);
        let plan = Pose::from_origin_and_z(middle + DVec3::X * 12.0, DVec3::X);
        let found = layers(&bone, &plan);
        let expected = [
            (0.0, 1.6, Tissue::Cartilage),
            (1.6, 3.2, Tissue::Subchondral),
            (3.2, 20.8, Tissue::Cancellous),
            (20.8, 22.4, Tissue::Subchondral),
            (22.4, 24.0, Tissue::Cartilage),
        ];
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (layer, (from, to, tissue)) in found.iter().zip(expected) {
            assert_eq!(layer.class, tissue as u8);
            assert!(
                (layer.from_mm - from).abs() < 0.5 && (layer.to_mm - to).abs() < 0.5,
                "{layer:?}"
            );
        }
    }
}
