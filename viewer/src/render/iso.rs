//! Smooth iso-surface: a ray for each pixel of the squares that can show bone (`iso.wgsl`).

use super::View;
use super::atlas::Atlas;
use super::method::{Context, Method, Squares};
use super::pipeline::Recipe;
use crate::mirror::Model;

/// The pipeline: all else is in the bone's textures.
#[derive(Debug)]
pub(crate) struct Iso {
    pipeline: wgpu::RenderPipeline,
}

impl Iso {
    /// The pipeline.
    pub(crate) fn new(context: &Context) -> Self {
        let recipe = Recipe {
            label: "iso",
            text: text(),
            entries: ["vertex_main", "fragment_main"],
            groups: &[&context.globals, &context.textures],
            buffers: &[Squares::LAYOUT],
            topology: wgpu::PrimitiveTopology::TriangleList,
            // first in the picture, and squares do not overlap
            depth: wgpu::CompareFunction::Always,
            cull: None,
        };
        Self {
            pipeline: recipe.surfaces(&context.device),
        }
    }
}

/// WGSL of the method.
pub(crate) fn text() -> String {
    super::shader_text(&[include_str!("atlas.wgsl"), include_str!("iso.wgsl")])
}

impl Method for Iso {
    fn changed(&mut self, _context: &Context, _model: &Model, _slot: usize) {}

    fn update(&mut self, _context: &Context, _model: &Model, _all: bool) -> anyhow::Result<()> {
        Ok(())
    }

    fn aim(&mut self, _context: &Context, _view: &View, _atlas: &Atlas) {}

    fn draw(&self, pass: &mut wgpu::RenderPass<'_>, squares: &Squares) {
        pass.set_pipeline(&self.pipeline);
        squares.draw(pass);
    }

    fn bytes(&self) -> u64 {
        0
    }
}
