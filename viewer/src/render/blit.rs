//! Copies the picture into egui's pass (`blit.wgsl`).

use super::uniforms;
use std::sync::Arc;

/// `Copy` of `blit.wgsl`.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct CopyUniform {
    target_px: [f32; 4],
    options: [f32; 4],
}

/// Pipeline of the copy.
#[derive(Debug)]
pub(crate) struct Blit {
    pipeline: Arc<wgpu::RenderPipeline>,
    layout: wgpu::BindGroupLayout,
    uniform: wgpu::Buffer,
    encodes_srgb: bool,
}

impl Blit {
    /// The pipeline for a screen of format `screen`.
    pub(crate) fn new(device: &wgpu::Device, screen: wgpu::TextureFormat) -> Self {
        let layout = layout(device);
        Self {
            pipeline: Arc::new(pipeline(device, &layout, screen)),
            uniform: uniforms::buffer(device, "copy", size_of::<CopyUniform>()),
            encodes_srgb: screen.is_srgb(),
            layout,
        }
    }

    /// A callback that shows `picture` in `rect` (points) of a window with `pixels_per_point`.
    pub(crate) fn paint(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        picture: &wgpu::TextureView,
        rect: egui::Rect,
        pixels_per_point: f32,
    ) -> egui::PaintCallback {
        let px = rect * pixels_per_point;
        let uniform = CopyUniform {
            // egui rounds a callback's viewport to whole pixels
            target_px: [
                px.min.x.round(),
                px.min.y.round(),
                px.width().round(),
                px.height().round(),
            ],
            options: [if self.encodes_srgb { 1.0 } else { 0.0 }, 0.0, 0.0, 0.0],
        };
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("copy"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(picture),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: self.uniform.as_entire_binding(),
                },
            ],
        });
        let pipeline = Arc::clone(&self.pipeline);
        egui_wgpu::Callback::new_paint_callback(rect, Paint { pipeline, group })
    }
}

struct Paint {
    pipeline: Arc<wgpu::RenderPipeline>,
    group: wgpu::BindGroup,
}

impl egui_wgpu::CallbackTrait for Paint {
    fn paint(
        &self,
        _info: egui::PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        _resources: &egui_wgpu::CallbackResources,
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.draw(0..3, 0..1);
    }
}

fn layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty,
        count: None,
    };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("copy"),
        entries: &[
            entry(
                0,
                wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Float { filterable: false },
                    view_dimension: wgpu::TextureViewDimension::D2,
                    multisampled: false,
                },
            ),
            entry(
                1,
                wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
            ),
        ],
    })
}

fn pipeline(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    screen: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let module = super::shader(device, "copy", include_str!("blit.wgsl").to_owned());
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("copy"),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("copy"),
        layout: Some(&pipeline_layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex_main"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment_main"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(screen.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
