//! The bone pass: a background, and a ray for each pixel of the squares that can show bone
//! (`bone.wgsl`).

use super::atlas::{Atlas, AtlasLayout};
use super::target::{COLOUR, DEPTH};
use super::tiles::Tiles;
use super::{View, shader, shader_text};

/// Vertices of a square.
const SQUARE: u32 = 6;

/// Pipelines of bone and background.
#[derive(Debug)]
pub(crate) struct BonePass {
    bone: wgpu::RenderPipeline,
    background: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    tiles: Tiles,
    squares: wgpu::Buffer,
    // squares of the next picture
    count: u32,
}

impl BonePass {
    /// The pipelines; `globals` is the layout of group 0.
    pub(crate) fn new(device: &wgpu::Device, globals: &wgpu::BindGroupLayout) -> Self {
        let layout = textures_layout(device);
        let module = shader(device, "bone", shader_text(include_str!("bone.wgsl")));
        Self {
            bone: bone_pipeline(device, &module, &[Some(globals), Some(&layout)]),
            background: background_pipeline(device, &module, &[Some(globals)]),
            layout,
            tiles: Tiles::default(),
            squares: squares_buffer(device, 1024),
            count: 0,
        }
    }

    /// Layout of the group that [`Atlas`] makes.
    pub(crate) fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// Chooses the squares for a view.
    pub(crate) fn aim(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        view: &View,
        layout: &AtlasLayout,
    ) {
        let radius = layout.brick_radius_mm;
        let list = self
            .tiles
            .cover(&view.camera, view.size, &layout.centres_mm, radius);
        let bytes: &[u8] = bytemuck::cast_slice(list);
        if bytes.len() as u64 > self.squares.size() {
            self.squares = squares_buffer(device, bytes.len() as u64);
        }
        queue.write_buffer(&self.squares, 0, bytes);
        // a picture has at most 2²⁰ squares
        self.count = u32::try_from(list.len()).unwrap_or(0);
    }

    /// Draws the background everywhere.
    pub(crate) fn draw_background(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_pipeline(&self.background);
        pass.draw(0..3, 0..1);
    }

    /// Draws the bone in the squares that were chosen.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, atlas: &Atlas) {
        pass.set_pipeline(&self.bone);
        pass.set_bind_group(1, atlas.group(), &[]);
        pass.set_vertex_buffer(0, self.squares.slice(..));
        pass.draw(0..SQUARE, 0..self.count);
    }
}

fn squares_buffer(device: &wgpu::Device, bytes: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("squares"),
        size: bytes,
        usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn bone_pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    groups: &[Option<&wgpu::BindGroupLayout>],
) -> wgpu::RenderPipeline {
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("bone"),
        layout: Some(&pipeline_layout(device, groups)),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vertex_main"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<u32>() as u64,
                step_mode: wgpu::VertexStepMode::Instance,
                attributes: &wgpu::vertex_attr_array![0 => Uint32],
            })],
        },
        primitive: wgpu::PrimitiveState::default(),
        // first in the picture, and squares do not overlap
        depth_stencil: Some(depth_state(wgpu::CompareFunction::Always)),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some("fragment_main"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(COLOUR.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

fn background_pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    groups: &[Option<&wgpu::BindGroupLayout>],
) -> wgpu::RenderPipeline {
    let mut depth = depth_state(wgpu::CompareFunction::Always);
    depth.depth_write_enabled = Some(false);
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("background"),
        layout: Some(&pipeline_layout(device, groups)),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("background_vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(depth),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some("background_fragment"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(COLOUR.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

fn pipeline_layout(
    device: &wgpu::Device,
    groups: &[Option<&wgpu::BindGroupLayout>],
) -> wgpu::PipelineLayout {
    device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("bone"),
        bind_group_layouts: groups,
        immediate_size: 0,
    })
}

/// Depth that is written where `compare` holds.
pub(crate) fn depth_state(compare: wgpu::CompareFunction) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: DEPTH,
        depth_write_enabled: Some(true),
        depth_compare: Some(compare),
        stencil: wgpu::StencilState::default(),
        bias: wgpu::DepthBiasState::default(),
    }
}

fn textures_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let texture = |binding, sample_type| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty: wgpu::BindingType::Texture {
            sample_type,
            view_dimension: wgpu::TextureViewDimension::D3,
            multisampled: false,
        },
        count: None,
    };
    let filtered = wgpu::TextureSampleType::Float { filterable: true };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("bone"),
        entries: &[
            texture(0, wgpu::TextureSampleType::Uint),
            texture(1, filtered),
            texture(2, filtered),
            wgpu::BindGroupLayoutEntry {
                binding: 3,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
                count: None,
            },
        ],
    })
}
