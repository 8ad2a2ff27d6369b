//! CT densities on a section plane (`section.wgsl`), the bone behind it by ray-marching.

use super::View;
use super::atlas::{Atlas, Density};
use super::method::{Context, Method, Squares};
use super::pipeline::Recipe;
use crate::mirror::Model;

/// Pipeline and densities.
#[derive(Debug)]
pub(crate) struct Section {
    pipeline: wgpu::RenderPipeline,
    density: Density,
}

impl Section {
    /// Room for a model's densities.
    pub(crate) fn new(context: &Context, model: &Model) -> anyhow::Result<Self> {
        let density = Density::new(&context.device, model)?;
        let recipe = Recipe {
            label: "section",
            text: text(),
            entries: ["vertex_main", "section_fragment"],
            groups: &[&context.globals, &context.textures, density.layout()],
            buffers: &[Squares::LAYOUT],
            topology: wgpu::PrimitiveTopology::TriangleList,
            depth: wgpu::CompareFunction::Always,
            cull: None,
        };
        Ok(Self {
            pipeline: recipe.surfaces(&context.device),
            density,
        })
    }
}

/// WGSL of the method.
pub(crate) fn text() -> String {
    super::shader_text(&[
        include_str!("atlas.wgsl"),
        include_str!("iso.wgsl"),
        include_str!("section.wgsl"),
    ])
}

impl Method for Section {
    fn changed(&mut self, context: &Context, model: &Model, slot: usize) {
        self.density.upload(&context.queue, model, slot);
    }

    fn update(&mut self, _context: &Context, _model: &Model, _all: bool) -> anyhow::Result<()> {
        Ok(())
    }

    fn aim(&mut self, _context: &Context, _view: &View, _atlas: &Atlas) {}

    fn draw(&self, pass: &mut wgpu::RenderPass<'_>, squares: &Squares) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(2, self.density.group(), &[]);
        squares.draw(pass);
    }

    fn bytes(&self) -> u64 {
        self.density.bytes()
    }
}
