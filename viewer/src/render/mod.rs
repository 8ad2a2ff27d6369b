//! The 3-D view: bone and tool into an own colour and depth target.
//!
//! [`Renderer::load`] takes a bone, [`Renderer::upload`] the bricks that changed, and
//! [`Renderer::draw`] a view. The picture is copied into a window by [`blit`] or read back.

pub(crate) mod atlas;
pub(crate) mod blit;
pub(crate) mod bone;
pub(crate) mod target;
pub(crate) mod tiles;
pub(crate) mod tool;
pub(crate) mod uniforms;

use crate::camera::Camera;
use crate::mirror::Model;
use atlas::Atlas;
use bone::BonePass;
use osteon_protocol::ipc::ToolInfo;
use osteon_sim_core::pose::Pose;
use std::sync::Arc;
use target::Target;
use tool::ToolPass;
use uniforms::Globals;

/// What is to be seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct View {
    /// From where.
    pub(crate) camera: Camera,
    /// Width and height of the picture, pixels.
    pub(crate) size: [u32; 2],
    /// The tool's index and `bone_from_tool`; `None` = no tool is drawn.
    pub(crate) tool: Option<(usize, Pose)>,
    /// Whether the key light casts shadows (half as much work again).
    pub(crate) shadows: bool,
}

impl View {
    /// Width over height.
    pub(crate) fn aspect(&self) -> f64 {
        f64::from(self.size[0]) / f64::from(self.size[1].max(1))
    }
}

/// Bone and tool passes with their textures.
#[derive(Debug)]
pub(crate) struct Renderer {
    device: wgpu::Device,
    queue: wgpu::Queue,
    globals: wgpu::Buffer,
    globals_group: wgpu::BindGroup,
    bone_pass: BonePass,
    tool_pass: ToolPass,
    atlas: Option<Atlas>,
    target: Target,
}

impl Renderer {
    /// Pipelines and an empty picture.
    pub(crate) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        let layout = uniforms::layout(device);
        let globals = uniforms::buffer(device, "globals", size_of::<Globals>());
        let globals_group = uniforms::group(device, &layout, &globals);
        Self {
            bone_pass: BonePass::new(device, &layout),
            tool_pass: ToolPass::new(device, &layout),
            target: Target::new(device, [1, 1]),
            device: device.clone(),
            queue: queue.clone(),
            globals,
            globals_group,
            atlas: None,
        }
    }

    /// Makes room for a model's bricks; all of them are dirty afterwards in a fresh model.
    pub(crate) fn load(&mut self, model: &Model, tools: &[ToolInfo]) -> anyhow::Result<()> {
        self.atlas = None;
        let atlas = Atlas::new(&self.device, &self.queue, model, self.bone_pass.layout())?;
        self.atlas = Some(atlas);
        self.tool_pass.load(&self.device, tools);
        Ok(())
    }

    /// Forgets the bone.
    pub(crate) fn unload(&mut self) {
        self.atlas = None;
    }

    /// Uploads at most `most` dirty bricks and returns how many were.
    pub(crate) fn upload(&mut self, model: &mut Model, most: usize) -> usize {
        match &mut self.atlas {
            Some(atlas) => atlas.upload(&self.queue, model, most),
            None => 0,
        }
    }

    /// Draws into the target. The work is submitted, not waited for.
    pub(crate) fn draw(&mut self, view: &View) {
        if self.target.size() != view.size {
            self.target = Target::new(&self.device, view.size);
        }
        let globals = Globals::new(view, self.atlas.as_ref().map(Atlas::layout));
        self.queue
            .write_buffer(&self.globals, 0, bytemuck::bytes_of(&globals));
        let clip_from_bone = view.camera.clip_from_bone(view.aspect());
        if let Some((_, bone_from_tool)) = view.tool {
            self.tool_pass
                .place(&self.queue, clip_from_bone, &bone_from_tool);
        }
        if let Some(atlas) = &self.atlas {
            self.bone_pass
                .aim(&self.device, &self.queue, view, atlas.layout());
        }
        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = self.target.begin(&mut encoder);
            pass.set_bind_group(0, &self.globals_group, &[]);
            self.bone_pass.draw_background(&mut pass);
            if let Some(atlas) = &self.atlas {
                self.bone_pass.draw(&mut pass, atlas);
                if let Some((index, _)) = view.tool {
                    self.tool_pass.draw(&mut pass, index);
                }
            }
        }
        self.queue.submit([encoder.finish()]);
    }

    /// Waits until all submitted work is done.
    pub(crate) fn wait(&self) -> anyhow::Result<()> {
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|e| {
                anyhow::anyhow!("the graphics adapter stopped answering ({e}); restart the viewer")
            })?;
        Ok(())
    }

    /// The picture's view, for [`blit`].
    pub(crate) fn picture(&self) -> Arc<wgpu::TextureView> {
        self.target.picture()
    }

    /// The picture as RGBA bytes, row by row from the top.
    pub(crate) fn read(&self) -> anyhow::Result<Vec<u8>> {
        self.target.read(&self.device, &self.queue)
    }
}

/// The WGSL text of a pass: the shared part and its own.
pub(crate) fn shader_text(own: &str) -> String {
    format!("{}\n{own}", include_str!("common.wgsl"))
}

pub(crate) fn shader(device: &wgpu::Device, label: &str, text: String) -> wgpu::ShaderModule {
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(text.into()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use wgpu::naga;

    #[test]
    fn all_shaders_are_valid() {
        let texts = [
            shader_text(include_str!("bone.wgsl")),
            shader_text(include_str!("tool.wgsl")),
            include_str!("blit.wgsl").to_owned(),
        ];
        for text in texts {
            let module = naga::front::wgsl::parse_str(&text)
                .unwrap_or_else(|e| panic!("{}", e.emit_to_string(&text)));
            let flags = naga::valid::ValidationFlags::all();
            let mut validator =
                naga::valid::Validator::new(flags, naga::valid::Capabilities::empty());
            let checked = validator.validate(&module);
            assert!(checked.is_ok(), "{:?}", checked.err());
        }
    }

    #[test]
    fn the_uniforms_have_the_size_that_the_shader_reads() {
        for (text, name, size) in [
            (
                shader_text(include_str!("bone.wgsl")),
                "Globals",
                size_of::<Globals>(),
            ),
            (
                shader_text(include_str!("tool.wgsl")),
                "Tool",
                size_of::<tool::ToolUniform>(),
            ),
        ] {
            let module = naga::front::wgsl::parse_str(&text).unwrap();
            let span = module.types.iter().find_map(|(_, t)| match &t.inner {
                naga::TypeInner::Struct { span, .. } if t.name.as_deref() == Some(name) => {
                    Some(*span)
                }
                _ => None,
            });
            assert_eq!(span, u32::try_from(size).ok(), "{name}");
        }
    }
}
