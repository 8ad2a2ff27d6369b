//! Edges of the chunks' boxes over the picture, coloured by what culling did with them.
#![expect(
    clippy::cast_possible_truncation,
    reason = "f64 becomes f32 for the GPU; 24 corners a chunk"
)]

use super::method::{Context, Fate};
use super::pipeline::Recipe;
use glam::DVec3;

/// A corner of an edge.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Corner {
    place: [f32; 3],
    colour: [u8; 4],
}

/// Corners that an edge of a box joins, as bits of x, y, z.
const EDGES: [(usize, usize); 12] = [
    (0, 1),
    (2, 3),
    (4, 5),
    (6, 7),
    (0, 2),
    (1, 3),
    (4, 6),
    (5, 7),
    (0, 4),
    (1, 5),
    (2, 6),
    (3, 7),
];

/// WGSL of the pass.
pub(crate) fn text() -> String {
    super::shader_text(&[include_str!("boxes.wgsl")])
}

/// Pipeline and edges.
#[derive(Debug)]
pub(crate) struct Boxes {
    pipeline: wgpu::RenderPipeline,
    buffer: Option<wgpu::Buffer>,
    count: u32,
}

impl Boxes {
    /// The pipeline.
    pub(crate) fn new(context: &Context) -> Self {
        let recipe = Recipe {
            label: "boxes",
            text: text(),
            entries: ["vertex_main", "fragment_main"],
            groups: &[&context.globals],
            buffers: &[wgpu::VertexBufferLayout {
                array_stride: size_of::<Corner>() as u64,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Unorm8x4],
            }],
            topology: wgpu::PrimitiveTopology::LineList,
            depth: wgpu::CompareFunction::Always,
            cull: None,
        };
        Self {
            pipeline: recipe.picture(&context.device, Some(wgpu::BlendState::ALPHA_BLENDING)),
            buffer: None,
            count: 0,
        }
    }

    /// Takes the boxes of a picture.
    pub(crate) fn set(
        &mut self,
        context: &Context,
        boxes: &[(DVec3, DVec3)],
        fate: &dyn Fn(usize) -> Fate,
    ) {
        let mut corners = Vec::with_capacity(24 * boxes.len());
        for (chunk, (lo, hi)) in boxes.iter().enumerate() {
            let colour = match fate(chunk) {
                Fate::Drawn => [110, 220, 130, 150],
                Fate::Hidden => [255, 90, 80, 230],
                Fate::Outside | Fate::Empty => continue,
            };
            let corner = |n: usize| {
                let axis = |a: usize| if n >> a & 1 == 1 { hi[a] } else { lo[a] } as f32;
                Corner {
                    place: [axis(0), axis(1), axis(2)],
                    colour,
                }
            };
            corners.extend(EDGES.iter().flat_map(|&(a, b)| [corner(a), corner(b)]));
        }
        self.count = corners.len() as u32;
        let bytes: &[u8] = bytemuck::cast_slice(&corners);
        let need = bytes.len() as u64;
        if self.buffer.as_ref().is_none_or(|b| b.size() < need) {
            self.buffer = Some(context.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("boxes"),
                size: need.max(256),
                usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }));
        }
        if let Some(buffer) = &self.buffer {
            context.queue.write_buffer(buffer, 0, bytes);
        }
    }

    /// Draws them; group 0 is set.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        let Some(buffer) = self.buffer.as_ref().filter(|_| self.count > 0) else {
            return;
        };
        pass.set_pipeline(&self.pipeline);
        pass.set_vertex_buffer(0, buffer.slice(..));
        pass.draw(0..self.count, 0..1);
    }
}
