//! Pipelines of the passes: what they have in common.

use super::target::{COLOUR, DEPTH, SURFACES};

/// What tells one pipeline from another.
#[derive(Debug)]
pub(crate) struct Recipe<'a> {
    /// Name for people.
    pub(crate) label: &'a str,
    /// WGSL.
    pub(crate) text: String,
    /// Entry points of vertex and fragment.
    pub(crate) entries: [&'a str; 2],
    /// Layouts of the groups in order.
    pub(crate) groups: &'a [&'a wgpu::BindGroupLayout],
    /// Vertex buffers.
    pub(crate) buffers: &'a [wgpu::VertexBufferLayout<'a>],
    /// Triangles, strips or lines.
    pub(crate) topology: wgpu::PrimitiveTopology,
    /// Where the new depth holds.
    pub(crate) depth: wgpu::CompareFunction,
    /// Triangles that are left out.
    pub(crate) cull: Option<wgpu::Face>,
}

impl Recipe<'_> {
    /// A pipeline into the surface buffers; writes the depth.
    pub(crate) fn surfaces(self, device: &wgpu::Device) -> wgpu::RenderPipeline {
        let targets = SURFACES.map(|format| Some(format.into()));
        self.make(device, &targets, true)
    }

    /// A pipeline into the picture; reads the depth alone.
    pub(crate) fn picture(
        self,
        device: &wgpu::Device,
        blend: Option<wgpu::BlendState>,
    ) -> wgpu::RenderPipeline {
        let target = wgpu::ColorTargetState {
            format: COLOUR,
            blend,
            write_mask: wgpu::ColorWrites::ALL,
        };
        self.make(device, &[Some(target)], false)
    }

    fn make(
        self,
        device: &wgpu::Device,
        targets: &[Option<wgpu::ColorTargetState>],
        writes_depth: bool,
    ) -> wgpu::RenderPipeline {
        let module = super::shader(device, self.label, self.text);
        let groups: Vec<_> = self.groups.iter().map(|g| Some(*g)).collect();
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(self.label),
            bind_group_layouts: &groups,
            immediate_size: 0,
        });
        let buffers: Vec<_> = self.buffers.iter().cloned().map(Some).collect();
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.label),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(self.entries[0]),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &buffers,
            },
            primitive: wgpu::PrimitiveState {
                topology: self.topology,
                cull_mode: self.cull,
                ..Default::default()
            },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(writes_depth),
                depth_compare: Some(self.depth),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(self.entries[1]),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// A texture of a layout, for fragments.
pub(crate) fn texture_entry(
    binding: u32,
    sample_type: wgpu::TextureSampleType,
    view_dimension: wgpu::TextureViewDimension,
) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty: wgpu::BindingType::Texture {
            sample_type,
            view_dimension,
            multisampled: false,
        },
        count: None,
    }
}
