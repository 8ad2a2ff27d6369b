//! The light pass: surface buffers to picture (`shade.wgsl`).

use super::method::{Context, Squares};
use super::pipeline::{Recipe, texture_entry};
use super::target::Target;

/// Pipelines of light and background.
#[derive(Debug)]
pub(crate) struct Shade {
    light: wgpu::RenderPipeline,
    background: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

/// WGSL of the pass.
pub(crate) fn text() -> String {
    super::shader_text(&[include_str!("atlas.wgsl"), include_str!("shade.wgsl")])
}

impl Shade {
    /// The pipelines.
    pub(crate) fn new(context: &Context) -> Self {
        let device = &context.device;
        let layout = layout(device);
        let light = Recipe {
            label: "light",
            text: text(),
            entries: ["vertex_main", "fragment_main"],
            groups: &[&context.globals, &context.textures, &layout],
            buffers: &[Squares::LAYOUT],
            topology: wgpu::PrimitiveTopology::TriangleList,
            depth: wgpu::CompareFunction::Always,
            cull: None,
        };
        let background = Recipe {
            label: "background",
            text: text(),
            entries: ["background_vertex", "background_fragment"],
            groups: &[&context.globals],
            buffers: &[],
            topology: wgpu::PrimitiveTopology::TriangleList,
            depth: wgpu::CompareFunction::Always,
            cull: None,
        };
        Self {
            light: light.picture(device, None),
            background: background.picture(device, None),
            layout,
        }
    }

    /// The group of a target's surface buffers.
    pub(crate) fn group(&self, device: &wgpu::Device, target: &Target) -> wgpu::BindGroup {
        let views = target.surface_views();
        let entries: Vec<_> = (0u32..)
            .zip(views)
            .map(|(binding, view)| wgpu::BindGroupEntry {
                binding,
                resource: wgpu::BindingResource::TextureView(view),
            })
            .collect();
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("surfaces"),
            layout: &self.layout,
            entries: &entries,
        })
    }

    /// Draws the background everywhere.
    pub(crate) fn draw_background(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_pipeline(&self.background);
        pass.draw(0..3, 0..1);
    }

    /// Draws what the surface buffers hold; groups 0 and 1 are set.
    pub(crate) fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        surfaces: &wgpu::BindGroup,
        squares: &Squares,
    ) {
        pass.set_pipeline(&self.light);
        pass.set_bind_group(2, surfaces, &[]);
        squares.draw(pass);
    }
}

fn layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let plain = wgpu::TextureSampleType::Float { filterable: false };
    let flat = wgpu::TextureViewDimension::D2;
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("surfaces"),
        entries: &[0, 1, 2].map(|binding| texture_entry(binding, plain, flat)),
    })
}
