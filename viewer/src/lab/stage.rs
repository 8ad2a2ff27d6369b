//! A bone before the renderer, without a window or a link.

use super::compare::{Surfaces, widen};
use super::reference::{self, Reference};
use crate::adapter::{self, AdapterBrief, Gpu};
use crate::bricks::{BrickMap, Dirty};
use crate::camera::Camera;
use crate::mirror::Model;
use crate::render::look::Look;
use crate::render::method::Kind;
use crate::render::{Renderer, View};
use anyhow::{Context as _, anyhow};
use glam::{DVec2, DVec3};
use osteon_protocol::ipc::ToolInfo;
use osteon_sim_core::bone::{Bone, ChunkData};
use osteon_sim_core::carve::{CarveStep, carve};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A bone, its cut and a camera before one renderer.
#[derive(Debug)]
pub struct Stage {
    gpu: Gpu,
    renderer: Renderer,
    model: Model,
    // the cut that tools change; bricks go from it to the model as over the link
    truth: Cut,
    plan: Pose,
    view: View,
    outline: Vec<DVec3>,
}

/// A graphics adapter, for computations.
#[derive(Debug)]
pub struct Adapter(Gpu);

impl Adapter {
    /// Opens the adapter that would draw.
    pub fn open() -> anyhow::Result<Self> {
        adapter::open().map(Self)
    }

    /// Device and queue.
    pub fn device(&self) -> (&wgpu::Device, &wgpu::Queue) {
        (&self.0.device, &self.0.queue)
    }

    /// Which it is.
    pub fn brief(&self) -> &AdapterBrief {
        &self.0.adapter
    }
}

/// Times of frames, ms, in order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Frames {
    /// Carved bricks taken over and drawn, submission to completion.
    pub whole_ms: Vec<f64>,
    /// The part before the drawing: bricks, meshes, uploads.
    pub update_ms: Vec<f64>,
}

impl Stage {
    /// Opens the adapter and puts up a bone. `plan` is `bone_from_plan`, `size` in pixels.
    pub fn new(
        bone: &Bone,
        cut: &Cut,
        plan: &Pose,
        tools: &[Tool],
        kind: Kind,
        size: [u32; 2],
    ) -> anyhow::Result<Self> {
        let gpu = adapter::open()?;
        let map = BrickMap::new(bone).map_err(|e| anyhow!(e))?;
        let mut model = Model {
            bone: Arc::new(bone.clone()),
            cut: cut.clone(),
            dirty: Dirty::all(&map),
            map: Arc::new(map),
        };
        let mut renderer = Renderer::new(&gpu.device, &gpu.queue);
        renderer.choose(kind, &model)?;
        renderer.load(&model, &infos(tools))?;
        renderer.upload(&mut model, usize::MAX)?;
        renderer.wait()?;
        let up = bone.lps_from_bone().inverse().vector(DVec3::Z);
        let camera = Camera::at_plan(plan, up);
        let mut stage = Self {
            outline: crate::session::brick_centres(bone),
            view: View {
                camera,
                size,
                tool: None,
                shadows: false,
                look: Look {
                    method: kind,
                    ..Look::default()
                },
                plan: *plan,
            },
            gpu,
            renderer,
            model,
            truth: cut.clone(),
            plan: *plan,
        };
        stage.show_whole();
        Ok(stage)
    }

    /// Who draws.
    pub fn adapter(&self) -> &AdapterBrief {
        &self.gpu.adapter
    }

    /// Frames the whole bone.
    pub fn show_whole(&mut self) {
        self.view.camera.fit(&self.outline, self.view.aspect());
    }

    /// Looks closely at the glenoid.
    pub fn show_glenoid(&mut self) {
        self.view.camera.close_up(self.plan.translation);
    }

    /// Turns the camera, in heights of the picture.
    pub fn turn(&mut self, by: DVec2) {
        self.view.camera.orbit(by);
    }

    /// Takes another stage's camera.
    pub fn stand_as(&mut self, other: &Self) {
        self.view = other.view;
    }

    /// Chunks in the last picture that were behind others and not drawn.
    pub fn hidden(&self) -> usize {
        self.renderer.fates().hidden
    }

    /// Size of the picture, pixels.
    pub fn resize(&mut self, size: [u32; 2]) {
        self.view.size = size;
    }

    /// Draws with shadows, or without.
    pub fn cast_shadows(&mut self, shadows: bool) {
        self.view.shadows = shadows;
    }

    /// Shows tool `index` at `bone_from_tool`, or none.
    pub fn hold(&mut self, tool: Option<(usize, Pose)>) {
        self.view.tool = tool;
    }

    /// Bytes on the adapter for the bone and the picture.
    pub fn bytes(&self) -> u64 {
        self.renderer.bytes()
    }

    /// Moves a tool through the bone and takes over what it cut.
    pub fn carve(&mut self, tool: &Tool, step: &CarveStep) -> anyhow::Result<()> {
        let mut changed = Vec::new();
        let bone = Arc::clone(&self.model.bone);
        carve(&bone, &mut self.truth, tool, step, &mut |chunk, brick| {
            changed.push((chunk, brick));
        });
        for (chunk, brick) in changed {
            if let Some(values) = self.truth.brick(chunk, brick) {
                self.model.set_brick(chunk, brick, values)?;
            }
        }
        Ok(())
    }

    /// Takes over what changed, draws, waits for the end; time of all, and of what came before the
    /// drawing.
    pub fn frame(&mut self) -> anyhow::Result<(Duration, Duration)> {
        let begin = Instant::now();
        self.renderer.upload(&mut self.model, usize::MAX)?;
        let update = begin.elapsed();
        self.renderer.draw(&self.view);
        self.renderer.wait()?;
        Ok((begin.elapsed(), update))
    }

    /// The same frame `count` times.
    pub fn idle(&mut self, count: usize) -> anyhow::Result<Frames> {
        let mut frames = Frames::default();
        for _ in 0..count {
            frames.push(self.frame()?);
        }
        Ok(frames)
    }

    /// A frame after each step of a cut; the carving itself is not counted.
    pub fn carving(&mut self, tool: &Tool, steps: &[CarveStep]) -> anyhow::Result<Frames> {
        let mut frames = Frames::default();
        for step in steps {
            self.carve(tool, step)?;
            frames.push(self.frame()?);
        }
        Ok(frames)
    }

    /// Draws, and reads the surface buffers back.
    pub fn surfaces(&mut self) -> anyhow::Result<Surfaces> {
        self.frame()?;
        let normals = self.renderer.read_normals()?;
        let unit = |n: &[u16; 4]| [n[0], n[1], n[2]].map(widen);
        Ok(Surfaces {
            size: self.view.size,
            distances: self.renderer.read_distances()?,
            normals: normals.iter().map(unit).collect(),
        })
    }

    /// Draws, and reads the picture back as RGBA bytes.
    pub fn picture(&mut self) -> anyhow::Result<Vec<u8>> {
        self.frame()?;
        self.renderer.read()
    }

    /// Draws, and writes the picture as a PNG.
    pub fn write_picture(&mut self, path: &Path) -> anyhow::Result<()> {
        let pixels = self.picture()?;
        crate::offscreen::write_png(path, self.view.size, &pixels)
    }

    /// The reference of what is before the camera, with `samples`² rays a pixel.
    pub fn reference(&self, samples: u32) -> Reference {
        reference::march(&self.model.bone, &self.model.cut, &self.view, samples)
    }
}

impl Frames {
    fn push(&mut self, (whole, update): (Duration, Duration)) {
        self.whole_ms.push(whole.as_secs_f64() * 1e3);
        self.update_ms.push(update.as_secs_f64() * 1e3);
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "f64 becomes f32 as on the wire"
)]
fn narrowed(value: f64) -> f32 {
    value as f32
}

/// What the viewer is told of tools.
fn infos(tools: &[Tool]) -> Vec<ToolInfo> {
    let info = |tool: &Tool| ToolInfo {
        name: tool.name.clone(),
        id: tool.id.clone(),
        outline_mm: tool.shape.outline(),
        rpm: narrowed(tool.rpm),
    };
    tools.iter().map(info).collect()
}

/// The part of a bone that is its first `count` chunks, in order of their distance from `near` (bone
/// frame, mm).
pub fn nearest_chunks(bone: &Bone, near: DVec3, count: usize) -> anyhow::Result<Bone> {
    let mut order: Vec<usize> = (0..bone.chunk_count()).collect();
    let far = |chunk: usize| {
        let (lo, hi) = crate::render::chunked::chunk_box(bone, chunk);
        near.distance_squared(0.5 * (lo + hi))
    };
    order.sort_by(|&a, &b| far(a).total_cmp(&far(b)));
    let mut part = Bone::new(*bone.grid(), *bone.lps_from_bone());
    for &chunk in order.iter().take(count) {
        let own = bone.chunk(chunk);
        let data = ChunkData { ..own };
        part.push_chunk(bone.chunk_coord(chunk), bone.bony_bricks(chunk), &data)
            .map_err(|e| anyhow!("{e}"))
            .context("a part of the bone")?;
    }
    Ok(part)
}
