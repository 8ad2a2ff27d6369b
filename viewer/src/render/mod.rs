//! The 3-D view: bone and tool into surface buffers, light on them, a picture.
//!
//! [`Renderer::load`] takes a bone, [`Renderer::upload`] the bricks that changed, and
//! [`Renderer::draw`] a view. The picture is copied into a window by [`blit`] or read back. How the
//! bone gets into the surface buffers is a [`method`]'s business.

pub(crate) mod atlas;
pub(crate) mod blit;
pub(crate) mod boxes;
pub(crate) mod chunked;
pub(crate) mod frustum;
pub(crate) mod iso;
pub(crate) mod look;
pub(crate) mod method;
pub(crate) mod occlusion;
pub(crate) mod pipeline;
pub(crate) mod section;
pub(crate) mod shade;
pub(crate) mod target;
pub(crate) mod tiles;
pub(crate) mod tool;
pub(crate) mod uniforms;

use crate::adapter::Watch;
use crate::camera::Camera;
use crate::mirror::Model;
use atlas::Atlas;
use boxes::Boxes;
use glam::DVec3;
use look::Look;
use method::{Context, Fates, Kind, Method, Squares};
use occlusion::Reduce;
use osteon_protocol::ipc::ToolInfo;
use osteon_sim_core::pose::Pose;
use shade::Shade;
use std::sync::Arc;
use target::Target;
use tiles::Tiles;
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
    /// How the bone is shown.
    pub(crate) look: Look,
    /// `bone_from_plan`.
    pub(crate) plan: Pose,
}

impl View {
    /// Width over height.
    pub(crate) fn aspect(&self) -> f64 {
        f64::from(self.size[0]) / f64::from(self.size[1].max(1))
    }
}

/// The passes with their textures.
#[derive(Debug)]
pub(crate) struct Renderer {
    context: Context,
    watch: Watch,
    globals: wgpu::Buffer,
    globals_group: wgpu::BindGroup,
    shade: Shade,
    tool_pass: ToolPass,
    reduce: Reduce,
    boxes: Boxes,
    // corners of every chunk's box
    chunk_boxes: Vec<(DVec3, DVec3)>,
    tiles: Tiles,
    squares: Squares,
    target: Target,
    surfaces: wgpu::BindGroup,
    // the right eye's, where there are two pictures
    right: Option<(Target, wgpu::BindGroup)>,
    kind: Kind,
    // both or none: the bone that is loaded
    bone: Option<(Atlas, Box<dyn Method>)>,
}

impl Renderer {
    /// Pipelines and an empty picture.
    pub(crate) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        let context = Context {
            device: device.clone(),
            queue: queue.clone(),
            globals: uniforms::layout(device),
            textures: atlas::textures_layout(device),
        };
        let globals = uniforms::buffer(device, "globals", size_of::<Globals>());
        let shade = Shade::new(&context);
        let target = Target::new(device, [1, 1]);
        Self {
            globals_group: uniforms::group(device, &context.globals, &globals),
            tool_pass: ToolPass::new(&context),
            reduce: Reduce::new(&context),
            boxes: Boxes::new(&context),
            chunk_boxes: Vec::new(),
            tiles: Tiles::default(),
            squares: Squares::new(device),
            surfaces: shade.group(device, &target),
            target,
            right: None,
            shade,
            watch: Watch::new(device),
            context,
            globals,
            kind: Kind::default(),
            bone: None,
        }
    }

    /// Makes room for a model's bricks; all of them are dirty afterwards in a fresh model.
    pub(crate) fn load(&mut self, model: &Model, tools: &[ToolInfo]) -> anyhow::Result<()> {
        self.bone = None;
        let (device, queue) = (&self.context.device, &self.context.queue);
        let atlas = Atlas::new(device, queue, model, &self.context.textures)?;
        let method = method::make(self.kind, &self.context, model)?;
        self.tool_pass.load(device, tools);
        let chunks = 0..model.bone.chunk_count();
        self.chunk_boxes = chunks.map(|c| chunked::chunk_box(&model.bone, c)).collect();
        self.bone = Some((atlas, method));
        Ok(())
    }

    /// Forgets the bone.
    pub(crate) fn unload(&mut self) {
        self.bone = None;
    }

    /// Draws by another method from now on; does nothing where it is the same.
    pub(crate) fn choose(&mut self, kind: Kind, model: &Model) -> anyhow::Result<()> {
        if self.kind == kind {
            return Ok(());
        }
        self.kind = kind;
        if let Some((_, method)) = &mut self.bone {
            *method = method::make(kind, &self.context, model)?;
            for slot in 0..model.map.slots() {
                method.changed(&self.context, model, slot);
            }
        }
        Ok(())
    }

    /// Takes over at most `most` dirty bricks, oldest first, and returns how many were; with
    /// `usize::MAX` the method works to its end.
    pub(crate) fn upload(&mut self, model: &mut Model, most: usize) -> anyhow::Result<usize> {
        let Some((atlas, method)) = &mut self.bone else {
            return Ok(0);
        };
        let mut count = 0;
        while count < most
            && let Some(slot) = model.dirty.pop()
        {
            atlas.upload(&self.context.queue, model, slot);
            method.changed(&self.context, model, slot);
            count += 1;
        }
        method.update(&self.context, model, most == usize::MAX)?;
        Ok(count)
    }

    /// Whether the method has work left that changes the picture.
    pub(crate) fn is_behind(&self) -> bool {
        self.bone.as_ref().is_some_and(|(_, m)| m.is_behind())
    }

    /// What became of the chunks in the last picture.
    pub(crate) fn fates(&self) -> Fates {
        let all = 0..self.chunk_boxes.len();
        self.bone
            .as_ref()
            .map_or_else(Fates::default, |(_, m)| Fates::of(all.map(|c| m.fate(c))))
    }

    /// Bytes on the adapter for bone and picture.
    pub(crate) fn bytes(&self) -> u64 {
        let of = |(atlas, method): &(Atlas, Box<dyn Method>)| atlas.bytes() + method.bytes();
        self.bone.as_ref().map_or(0, of) + self.target.bytes()
    }

    /// Draws into the target. The work is submitted, not waited for.
    pub(crate) fn draw(&mut self, view: &View) {
        if self.target.size() != view.size {
            self.target = Target::new(&self.context.device, view.size);
            self.surfaces = self.shade.group(&self.context.device, &self.target);
        }
        self.aim(view);
        let mut encoder = self
            .context
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let tool = view.tool.map(|(index, _)| index);
        if let Some((atlas, method)) = &mut self.bone {
            {
                let mut pass = self.target.begin_surfaces(&mut encoder, true);
                pass.set_bind_group(0, &self.globals_group, &[]);
                pass.set_bind_group(1, atlas.group(), &[]);
                method.draw(&mut pass, &self.squares);
                if let Some(index) = tool {
                    self.tool_pass.draw(&mut pass, index);
                }
            }
            if method.is_culling() {
                let next = wgpu::CommandEncoderDescriptor::default();
                let next = self.context.device.create_command_encoder(&next);
                let first = core::mem::replace(&mut encoder, next);
                let distances = &self.target.surface_views()[2];
                let pyramid = self
                    .reduce
                    .pyramid(&self.context, first, distances, view.size);
                // an adapter that does not answer hides nothing
                method.cull(view, pyramid.unwrap_or(None).as_ref());
                let mut pass = self.target.begin_surfaces(&mut encoder, false);
                pass.set_bind_group(0, &self.globals_group, &[]);
                pass.set_bind_group(1, atlas.group(), &[]);
                method.draw_rest(&mut pass);
            }
            if view.look.boxes {
                self.boxes
                    .set(&self.context, &self.chunk_boxes, &|c| method.fate(c));
            }
        }
        {
            let mut pass = self.target.begin_picture(&mut encoder);
            pass.set_bind_group(0, &self.globals_group, &[]);
            self.shade.draw_background(&mut pass);
            if let Some((atlas, _)) = &self.bone {
                pass.set_bind_group(1, atlas.group(), &[]);
                self.shade.draw(&mut pass, &self.surfaces, &self.squares);
                if let Some(index) = tool.filter(|_| view.look.ghost) {
                    self.tool_pass.draw_ghost(&mut pass, index);
                }
                if view.look.boxes {
                    self.boxes.draw(&mut pass);
                }
            }
        }
        self.context.queue.submit([encoder.finish()]);
    }

    /// Draws the right eye's view into a picture of its own.
    pub(crate) fn draw_right(&mut self, view: &View) {
        let device = &self.context.device;
        let (target, surfaces) = self.right.take().unwrap_or_else(|| {
            let target = Target::new(device, view.size);
            let surfaces = self.shade.group(device, &target);
            (target, surfaces)
        });
        let left = core::mem::replace(&mut self.target, target);
        let left_surfaces = core::mem::replace(&mut self.surfaces, surfaces);
        self.draw(view);
        let target = core::mem::replace(&mut self.target, left);
        let surfaces = core::mem::replace(&mut self.surfaces, left_surfaces);
        self.right = Some((target, surfaces));
    }

    /// Writes what the passes read of a view.
    fn aim(&mut self, view: &View) {
        let Context { device, queue, .. } = &self.context;
        let layout = self.bone.as_ref().map(|(atlas, _)| atlas.layout());
        let globals = Globals::new(view, layout);
        queue.write_buffer(&self.globals, 0, bytemuck::bytes_of(&globals));
        let clip_from_bone = view.camera.clip_from_bone(view.aspect());
        let mut balls = Vec::new();
        if let Some((index, bone_from_tool)) = view.tool {
            self.tool_pass.place(queue, clip_from_bone, &bone_from_tool);
            let placed = self.tool_pass.balls(index).iter();
            balls.extend(placed.map(|&(middle, radius)| (bone_from_tool.point(middle), radius)));
        }
        if let Some((atlas, method)) = &mut self.bone {
            let layout = atlas.layout();
            let bricks = layout.centres_mm.iter();
            let all = bricks.map(|&c| (c, layout.brick_radius_mm)).chain(balls);
            let list = self.tiles.cover(&view.camera, view.size, all);
            self.squares.set(device, queue, list);
            method.aim(&self.context, view, atlas);
        }
    }

    /// An error where the adapter failed since the start.
    pub(crate) fn check(&self) -> anyhow::Result<()> {
        self.watch.check()
    }

    /// Waits until all submitted work is done.
    pub(crate) fn wait(&self) -> anyhow::Result<()> {
        self.context
            .device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|e| {
                anyhow::anyhow!("the graphics adapter stopped answering ({e}); restart the viewer")
            })?;
        self.check()
    }

    /// The picture's view, for [`blit`].
    pub(crate) fn picture(&self) -> Arc<wgpu::TextureView> {
        self.target.picture()
    }

    /// The right eye's picture; the left one's where there is none.
    pub(crate) fn picture_right(&self) -> Arc<wgpu::TextureView> {
        self.right
            .as_ref()
            .map_or_else(|| self.target.picture(), |(t, _)| t.picture())
    }

    /// The picture as RGBA bytes, row by row from the top.
    pub(crate) fn read(&self) -> anyhow::Result<Vec<u8>> {
        self.target.read(&self.context.device, &self.context.queue)
    }

    /// Distance of each pixel's point from the eye, mm; 0 where there is nothing.
    pub(crate) fn read_distances(&self) -> anyhow::Result<Vec<f32>> {
        let Context { device, queue, .. } = &self.context;
        let bytes = self.target.read_surface(device, queue, 2)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }

    /// Normal of each pixel's point and its kind, as half floats.
    pub(crate) fn read_normals(&self) -> anyhow::Result<Vec<[u16; 4]>> {
        let Context { device, queue, .. } = &self.context;
        let bytes = self.target.read_surface(device, queue, 1)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }
}

/// The WGSL text of a pass: the shared part and its own.
pub(crate) fn shader_text(own: &[&str]) -> String {
    let parts = [include_str!("common.wgsl")].into_iter();
    parts
        .chain(own.iter().copied())
        .collect::<Vec<_>>()
        .join("\n")
}

pub(crate) fn shader(device: &wgpu::Device, label: &str, text: String) -> wgpu::ShaderModule {
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(text.into()),
    })
}

#[cfg(test)]
mod tests;
