//! Three orthogonal CT slices through the tool's tip, with a crosshair and the grey scale.
#![expect(
    clippy::cast_possible_truncation,
    reason = "f64 becomes f32 on the screen"
)]

use crate::mirror::Mirror;
use crate::slices::{Across, GreyScale, slice, voxel_at};
use egui::{
    Color32, ColorImage, Rect, RichText, Slider, Stroke, TextureHandle, TextureOptions, Vec2, pos2,
};
use glam::DVec3;

/// Colour of the crosshair.
const CROSS: Color32 = Color32::from_rgb(0xff, 0xd0, 0x4a);

/// What the slices were made of: made again where it differs.
type Key = ([usize; 3], u64, GreyScale);

/// The slices on the screen.
#[derive(Default)]
pub(crate) struct Slices {
    textures: [Option<TextureHandle>; 3],
    key: Option<Key>,
    // edges of a voxel along the lattice's axes, mm; voxels along them
    spacing_mm: DVec3,
    dims: [usize; 3],
    /// The grey scale.
    pub(crate) scale: GreyScale,
}

impl Slices {
    /// Takes over what a slice through the tool's tip shows, where that changed.
    pub(crate) fn take(&mut self, ctx: &egui::Context, mirror: &Mirror) {
        let Some(model) = &mirror.model else {
            self.key = None;
            return;
        };
        let plan = mirror
            .scene
            .as_ref()
            .map(|s| s.bone_from_plan.translation_mm);
        let tip = mirror
            .pose
            .map(|p| p.bone_from_tool.translation_mm)
            .or(plan);
        let grid = model.bone.grid();
        let voxel = voxel_at(grid, DVec3::from_array(tip.unwrap_or_default()));
        // bricks are counted: any cut that arrives may show
        let key = (voxel, mirror.updates + (mirror.resyncs << 40), self.scale);
        if self.key == Some(key) {
            return;
        }
        self.key = Some(key);
        (self.spacing_mm, self.dims) = (grid.spacing_mm, grid.dims);
        for (texture, across) in self.textures.iter_mut().zip(Across::ALL) {
            let image: ColorImage = slice(model, across, voxel, self.scale);
            match texture {
                Some(texture) => texture.set(image, TextureOptions::LINEAR),
                None => {
                    *texture = Some(ctx.load_texture(across.name(), image, TextureOptions::LINEAR));
                }
            }
        }
    }

    /// Shows them one below the other.
    pub(crate) fn show(&mut self, ui: &mut egui::Ui) {
        super::heading(ui, "CT at the tip (T)");
        let Some((voxel, _, _)) = self.key else {
            ui.label("No bone yet.");
            return;
        };
        let grey = Color32::from_gray(0xa8);
        // what is left beside three names and two sliders
        let room = Vec2::new(
            ui.available_width(),
            (ui.available_height() - 62.0) / 3.0 - 24.0,
        );
        ui.vertical_centered(|ui| {
            for (texture, across) in self.textures.iter().zip(Across::ALL) {
                let Some(texture) = texture else { continue };
                ui.label(RichText::new(across.name()).color(grey));
                self.show_one(ui, texture, across, voxel, room);
            }
        });
        ui.spacing_mut().slider_width = 84.0;
        egui::Grid::new("grey scale").num_columns(2).show(ui, |ui| {
            ui.label(RichText::new("level").color(grey));
            ui.add(Slider::new(&mut self.scale.level_hu, -500.0..=2000.0).suffix(" HU"));
            ui.end_row();
            ui.label(RichText::new("width").color(grey));
            ui.add(Slider::new(&mut self.scale.width_hu, 100.0..=4000.0).suffix(" HU"));
            ui.end_row();
        });
    }

    /// One slice, as large as there is room, with the crosshair.
    fn show_one(
        &self,
        ui: &mut egui::Ui,
        texture: &TextureHandle,
        across: Across,
        voxel: [usize; 3],
        room: Vec2,
    ) {
        let [right, up] = across.axes();
        let mm = |axis: usize| self.dims[axis] as f32 * self.spacing_mm[axis] as f32;
        let size = Vec2::new(mm(right), mm(up));
        let size = size * (room.x / size.x).min(room.y.max(40.0) / size.y);
        let (rect, _) = ui.allocate_exact_size(size, egui::Sense::hover());
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        ui.painter()
            .image(texture.id(), rect, whole, Color32::WHITE);
        let share = |axis: usize| (voxel[axis] as f32 + 0.5) / self.dims[axis] as f32;
        let x = rect.left() + rect.width() * share(right);
        let y = rect.bottom() - rect.height() * share(up);
        let stroke = Stroke::new(1.0, CROSS.gamma_multiply(0.8));
        ui.painter().hline(rect.x_range(), y, stroke);
        ui.painter().vline(x, rect.y_range(), stroke);
    }
}
