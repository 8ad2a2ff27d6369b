//! The tool pass: each tool's outline turned about its axis (`tool.wgsl`).
#![expect(
    clippy::cast_possible_truncation,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use super::method::Context;
use super::pipeline::Recipe;
use super::uniforms;
use crate::palette::STEEL;
use glam::{DVec3, Mat4, Vec2};
use osteon_protocol::ipc::ToolInfo;
use osteon_sim_core::pose::Pose;
use wgpu::util::DeviceExt as _;

/// Facets around the axis.
const FACETS: u16 = 64;
/// Corners sharper than this stay sharp: cosine of 32°.
const SMOOTH_COSINE: f32 = 0.85;
/// Farthest point of an outline, mm: a bound on what a message can make us draw.
const MOST_MM: f32 = 1000.0;

/// `Tool` of `tool.wgsl`.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct ToolUniform {
    clip_from_tool: [[f32; 4]; 4],
    bone_from_tool: [[f32; 4]; 4],
    colour: [f32; 4],
}

/// A corner of the mesh, tool frame, mm.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Corner {
    position: [f32; 3],
    normal: [f32; 3],
}

#[derive(Debug)]
struct Mesh {
    corners: wgpu::Buffer,
    indices: wgpu::Buffer,
    count: u32,
    balls: Vec<(DVec3, f64)>,
}

/// Pipeline and meshes of the tools.
#[derive(Debug)]
pub(crate) struct ToolPass {
    solid: wgpu::RenderPipeline,
    ghost: wgpu::RenderPipeline,
    uniform: wgpu::Buffer,
    group: wgpu::BindGroup,
    // in the order of the scene's tools; None = nothing to draw
    meshes: Vec<Option<Mesh>>,
}

impl ToolPass {
    /// The pipelines.
    pub(crate) fn new(context: &Context) -> Self {
        let device = &context.device;
        let layout = uniforms::layout(device);
        let uniform = uniforms::buffer(device, "tool", size_of::<ToolUniform>());
        let groups = [&context.globals, &context.textures, &layout];
        let recipe = |label, fragment, depth| Recipe {
            label,
            text: text(),
            entries: ["vertex_main", fragment],
            groups: &groups,
            buffers: &CORNERS,
            topology: wgpu::PrimitiveTopology::TriangleList,
            depth,
            cull: None,
        };
        let solid = recipe("tool", "fragment_main", wgpu::CompareFunction::Less);
        let ghost = recipe("ghost", "ghost_fragment", wgpu::CompareFunction::Greater);
        Self {
            group: uniforms::group(device, &layout, &uniform),
            solid: solid.surfaces(device),
            ghost: ghost.picture(device, Some(wgpu::BlendState::ALPHA_BLENDING)),
            uniform,
            meshes: Vec::new(),
        }
    }

    /// Makes the meshes of a scene's tools.
    pub(crate) fn load(&mut self, device: &wgpu::Device, tools: &[ToolInfo]) {
        self.meshes = tools.iter().map(|t| mesh(device, &t.outline_mm)).collect();
    }

    /// Puts the tool at a pose.
    pub(crate) fn place(&self, queue: &wgpu::Queue, clip_from_bone: Mat4, bone_from_tool: &Pose) {
        let rotation = bone_from_tool.rotation.as_quat();
        let placed =
            Mat4::from_rotation_translation(rotation, bone_from_tool.translation.as_vec3());
        let [r, g, b] = STEEL;
        let uniform = ToolUniform {
            clip_from_tool: (clip_from_bone * placed).to_cols_array_2d(),
            bone_from_tool: placed.to_cols_array_2d(),
            colour: [r, g, b, 0.35],
        };
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }

    /// Balls (middle in the tool frame, radius; mm) that hold all of tool `index`.
    pub(crate) fn balls(&self, index: usize) -> &[(DVec3, f64)] {
        match self.meshes.get(index) {
            Some(Some(mesh)) => &mesh.balls,
            _ => &[],
        }
    }

    /// Draws tool `index`; a tool that is not known is not drawn.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, index: usize) {
        self.draw_with(&self.solid, pass, index);
    }

    /// Draws what bone hides of tool `index` over the picture.
    pub(crate) fn draw_ghost(&self, pass: &mut wgpu::RenderPass<'_>, index: usize) {
        self.draw_with(&self.ghost, pass, index);
    }

    fn draw_with(
        &self,
        pipeline: &wgpu::RenderPipeline,
        pass: &mut wgpu::RenderPass<'_>,
        index: usize,
    ) {
        let Some(Some(mesh)) = self.meshes.get(index) else {
            return;
        };
        pass.set_pipeline(pipeline);
        pass.set_bind_group(2, &self.group, &[]);
        pass.set_vertex_buffer(0, mesh.corners.slice(..));
        pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..mesh.count, 0, 0..1);
    }
}

fn mesh(device: &wgpu::Device, outline_mm: &[[f32; 2]]) -> Option<Mesh> {
    let (corners, indices) = lathe(outline_mm);
    let buffer = |label, contents: &[u8], usage| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some(label),
            contents,
            usage,
        })
    };
    (!indices.is_empty()).then(|| Mesh {
        corners: buffer(
            "tool corners",
            bytemuck::cast_slice(&corners),
            wgpu::BufferUsages::VERTEX,
        ),
        indices: buffer(
            "tool indices",
            bytemuck::cast_slice(&indices),
            wgpu::BufferUsages::INDEX,
        ),
        count: indices.len() as u32,
        balls: balls(&corners),
    })
}

/// Balls along the axis that hold a lathe's corners, and so its triangles: every triangle joins
/// corners of one segment, and a segment lies in the ball about its middle.
fn balls(corners: &[Corner]) -> Vec<(DVec3, f64)> {
    let per_segment = 2 * (usize::from(FACETS) + 1);
    corners
        .chunks(per_segment)
        .map(|segment| {
            let z = segment.iter().map(|c| f64::from(c.position[2]));
            let (lo, hi) = z.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), z| {
                (lo.min(z), hi.max(z))
            });
            let middle = DVec3::Z * (0.5 * (lo + hi));
            let radius = segment.iter().map(|c| {
                let at = glam::Vec3::from(c.position).as_dvec3();
                (at - middle).length()
            });
            (middle, radius.fold(0.0, f64::max))
        })
        .collect()
}

/// Turns an outline of (r, z) points about z. Each segment has its own corners, so that edges stay
/// sharp; where two segments meet at a small angle, they share a normal. Segments without length
/// and points that are not finite or out of bounds are left out.
pub(crate) fn lathe(outline_mm: &[[f32; 2]]) -> (Vec<Corner>, Vec<u32>) {
    let points: Vec<Vec2> = outline_mm
        .iter()
        .map(|&p| Vec2::from(p))
        .filter(|p| p.abs().max_element() <= MOST_MM)
        .collect();
    let segments: Vec<(Vec2, Vec2, Vec2)> = points
        .windows(2)
        .filter_map(|w| {
            // outward is to the right of the way from the apex to the shank
            let along = (w[1] - w[0]).try_normalize()?;
            Some((w[0], w[1], Vec2::new(along.y, -along.x)))
        })
        .collect();
    let mut corners = Vec::new();
    let mut indices = Vec::new();
    for (i, &(a, b, normal)) in segments.iter().enumerate() {
        let before = i.checked_sub(1).and_then(|j| segments.get(j));
        let at_a = smoothed(normal, before.map(|s| s.2));
        let at_b = smoothed(normal, segments.get(i + 1).map(|s| s.2));
        ring(&mut corners, &mut indices, [(a, at_a), (b, at_b)]);
    }
    (corners, indices)
}

fn smoothed(own: Vec2, other: Option<Vec2>) -> Vec2 {
    match other {
        Some(other) if own.dot(other) > SMOOTH_COSINE => {
            (own + other).try_normalize().unwrap_or(own)
        }
        _ => own,
    }
}

fn ring(corners: &mut Vec<Corner>, indices: &mut Vec<u32>, ends: [(Vec2, Vec2); 2]) {
    let base = corners.len() as u32;
    for facet in 0..=FACETS {
        let angle = core::f32::consts::TAU * f32::from(facet) / f32::from(FACETS);
        let (sin, cos) = angle.sin_cos();
        for (point, normal) in ends {
            corners.push(Corner {
                position: [point.x * cos, point.x * sin, point.y],
                normal: [normal.x * cos, normal.x * sin, normal.y],
            });
        }
    }
    for facet in 0..u32::from(FACETS) {
        let at = base + 2 * facet;
        indices.extend([at, at + 2, at + 1, at + 1, at + 2, at + 3]);
    }
}

/// WGSL of the pass.
pub(crate) fn text() -> String {
    super::shader_text(&[include_str!("tool.wgsl")])
}

/// How a pipeline reads [`Corner`]s.
const CORNERS: [wgpu::VertexBufferLayout<'static>; 1] = [wgpu::VertexBufferLayout {
    array_stride: size_of::<Corner>() as u64,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3],
}];

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Volume inside a closed mesh by the divergence theorem, mm³; positive where the triangles
    /// turn outward.
    fn volume(corners: &[Corner], indices: &[u32]) -> f32 {
        let at = |i: u32| Vec3::from(corners[i as usize].position);
        indices
            .chunks_exact(3)
            .map(|t| at(t[0]).dot(at(t[1]).cross(at(t[2]))) / 6.0)
            .sum()
    }

    #[test]
    fn a_turned_cone_has_a_cones_volume_and_outward_normals() {
        let (corners, indices) = lathe(&[[0.0, 0.0], [3.0, 4.0], [0.0, 4.0]]);
        let exact = core::f32::consts::PI * 9.0 * 4.0 / 3.0;
        let got = volume(&corners, &indices);
        assert!((got / exact - 1.0).abs() < 0.01, "{got} {exact}");
        let middle = Vec3::new(0.0, 0.0, 2.5);
        for c in &corners {
            assert!(
                (Vec3::from(c.position) - middle).dot(Vec3::from(c.normal)) > 0.0,
                "{c:?}"
            );
        }
    }

    #[test]
    fn nonsense_in_an_outline_is_left_out() {
        let (corners, indices) = lathe(&[[0.0, 0.0], [f32::NAN, 1.0], [0.0, 0.0], [1e30, 2.0]]);
        assert!(corners.is_empty() && indices.is_empty());
        assert!(lathe(&[]).1.is_empty());
    }
}
