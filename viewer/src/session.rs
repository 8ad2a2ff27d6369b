//! What window and offscreen picture have in common: renderer beside mirror, counters, camera.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use crate::adapter::AdapterBrief;
use crate::camera::{Camera, Preset};
use crate::cli::ViewArgs;
use crate::link::Shared;
use crate::mirror::{End, Mirror, pose};
use crate::pace::Scale;
use crate::panels::gauge::{self, Layer};
use crate::render::look::{Places, ViewChoice};
use crate::render::{Renderer, View};
use crate::report::{FrameTimes, Report};
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::grid::{BRICK, BRICKS_PER_CHUNK, brick_origin};
use osteon_sim_core::pose::Pose;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Bricks uploaded before one frame: bounds the time for which the mirror is held.
const BRICKS_PER_FRAME: usize = 2048;
/// Frames a second where a graphics card draws.
const CARD_FPS: f64 = 30.0;
/// Frames a second where the CPU draws.
const CPU_FPS: f64 = 10.0;
/// Share of time that drawing may take, so that the rest of the machine breathes.
const MOST_LOAD: f64 = 0.8;

/// What this process did to stay out of the servo loop's way.
#[derive(Debug, Clone, Default)]
pub(crate) struct Manners {
    /// Priority of the process.
    pub(crate) priority: String,
    /// The core left to the servo loop.
    pub(crate) core_left_free: Option<usize>,
}

/// Renderer, camera and counters.
#[derive(Debug)]
pub(crate) struct Session {
    shared: Arc<Shared>,
    /// Draws.
    pub(crate) renderer: Renderer,
    /// Who draws.
    pub(crate) adapter: AdapterBrief,
    /// Resolution as a share of the window's.
    pub(crate) scale: Scale,
    /// From where.
    pub(crate) camera: Option<Camera>,
    /// Whether the tool is drawn.
    pub(crate) show_tool: bool,
    /// Whether there is a picture for each eye.
    pub(crate) stereo: bool,
    /// How the bone is shown.
    pub(crate) view: ViewChoice,
    /// Times of frames.
    pub(crate) times: FrameTimes,
    manners: Manners,
    // resyncs of the mirror whose bone is loaded; 0 = none
    loaded: u64,
    // centres of the bricks at the bone's surface, for framing
    outline: Vec<DVec3>,
    plan: Pose,
    lps_from_bone: Pose,
    /// The uncut bone's layers along the planned axis.
    pub(crate) layers: Arc<Vec<Layer>>,
    last: Option<(View, u64)>,
}

/// What a frame found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Drawn {
    /// A new picture.
    New,
    /// The old picture still holds.
    Unchanged,
}

impl Session {
    /// Around a renderer.
    pub(crate) fn new(
        shared: Arc<Shared>,
        renderer: Renderer,
        adapter: AdapterBrief,
        args: &ViewArgs,
        manners: Manners,
    ) -> Self {
        // a graphics card draws all pixels
        let asked = args.scale.or_else(|| (!adapter.is_cpu).then_some(1.0));
        Self {
            shared,
            renderer,
            scale: Scale::new(asked, 0.5),
            adapter,
            camera: None,
            show_tool: true,
            stereo: false,
            view: ViewChoice {
                method: args.renderer.unwrap_or_default(),
                ..ViewChoice::default()
            },
            lps_from_bone: Pose::IDENTITY,
            layers: Arc::new(Vec::new()),
            times: FrameTimes::default(),
            manners,
            loaded: 0,
            outline: Vec::new(),
            plan: Pose::IDENTITY,
            last: None,
        }
    }

    /// What link and renderer share.
    pub(crate) fn shared(&self) -> &Shared {
        &self.shared
    }

    /// Least time between two frames.
    pub(crate) fn pace(&self, last_frame: Duration) -> Duration {
        let fps = if self.adapter.is_cpu {
            CPU_FPS
        } else {
            CARD_FPS
        };
        Duration::from_secs_f64(1.0 / fps).max(last_frame.div_f64(MOST_LOAD))
    }

    /// Pixels of the 3-D view for a picture of `size` pixels.
    pub(crate) fn scaled(&self, size: [u32; 2]) -> [u32; 2] {
        size.map(|n| ((f64::from(n) * self.scale.now()).round() as u32).max(1))
    }

    /// Takes over what changed in the mirror, and draws if the picture changes. `size` in pixels.
    pub(crate) fn draw(&mut self, size: [u32; 2], shadows: bool) -> anyhow::Result<Drawn> {
        let shared = Arc::clone(&self.shared);
        let mut mirror = shared.mirror();
        let uploaded = self.take_over(&mut mirror, size)?;
        let stereo = self.stereo;
        let view = self.camera.map(|camera| {
            let camera = if stereo { camera.eye(-1.0) } else { camera };
            let tool = self.tool(&mirror);
            let places = Places {
                axes: camera.axes(),
                lps_from_bone: &self.lps_from_bone,
                bone_from_plan: &self.plan,
                tip: tool.map(|(_, bone_from_tool)| bone_from_tool.translation),
            };
            View {
                camera,
                size,
                tool,
                shadows,
                look: self.view.look(&places),
                plan: self.plan,
            }
        });
        drop(mirror);
        let Some(view) = view else {
            return Ok(Drawn::Unchanged);
        };
        let now = (view, self.loaded);
        if !uploaded && self.last == Some(now) {
            return Ok(Drawn::Unchanged);
        }
        self.renderer.draw(&view);
        if self.stereo {
            self.renderer.draw_right(&View {
                camera: camera_of(&view, 1.0),
                ..view
            });
        }
        self.renderer.check()?;
        self.last = Some(now);
        self.shared.frames.fetch_add(1, Ordering::Relaxed);
        Ok(Drawn::New)
    }

    fn take_over(&mut self, mirror: &mut Mirror, size: [u32; 2]) -> anyhow::Result<bool> {
        let resyncs = mirror.resyncs;
        let (Some(scene), Some(model)) = (mirror.scene.clone(), &mut mirror.model) else {
            if self.loaded != 0 {
                self.renderer.unload();
                self.loaded = 0;
            }
            return Ok(false);
        };
        self.renderer.choose(self.view.method, model)?;
        if self.loaded != resyncs {
            self.renderer.load(model, &scene.tools)?;
            self.loaded = resyncs;
            self.outline = brick_centres(&model.bone);
            self.plan = pose(&scene.bone_from_plan).unwrap_or(Pose::IDENTITY);
            // DICOM LPS: z is the patient's superior direction
            self.layers = Arc::new(gauge::layers(&model.bone, &self.plan));
            self.lps_from_bone = *model.bone.lps_from_bone();
            let up = model.bone.lps_from_bone().inverse().vector(DVec3::Z);
            self.camera = Some(Camera::at_plan(&self.plan, up));
            self.show_whole(size);
        }
        let behind = self.renderer.is_behind();
        let uploaded = self.renderer.upload(model, BRICKS_PER_FRAME)?;
        Ok(uploaded > 0 || behind)
    }

    /// Whether something that changes the picture waits to be done.
    pub(crate) fn is_behind(&self) -> bool {
        if self.renderer.is_behind() {
            return true;
        }
        let mirror = self.shared.mirror();
        mirror
            .model
            .as_ref()
            .is_some_and(|m| !m.dirty.is_empty() || self.loaded != mirror.resyncs)
    }

    fn tool(&self, mirror: &Mirror) -> Option<(usize, Pose)> {
        let update = mirror.pose.filter(|_| self.show_tool)?;
        Some((usize::from(update.tool), pose(&update.bone_from_tool)?))
    }

    /// Frames the whole bone.
    pub(crate) fn show_whole(&mut self, size: [u32; 2]) {
        let aspect = f64::from(size[0]) / f64::from(size[1].max(1));
        if let Some(camera) = &mut self.camera {
            camera.fit(&self.outline, aspect);
        }
    }

    /// Looks at the joint from one of the usual places.
    pub(crate) fn look_from(&mut self, preset: Preset) {
        let tool = self.tool(&self.shared.mirror());
        if let Some(camera) = &mut self.camera {
            camera.look_from(preset, &self.plan, tool.map(|(_, pose)| pose));
        }
    }

    /// Looks closely at the glenoid.
    pub(crate) fn show_glenoid(&mut self) {
        if let Some(camera) = &mut self.camera {
            camera.close_up(self.plan.translation);
        }
    }

    /// Writes the report that was asked for.
    pub(crate) fn report(
        &self,
        args: &ViewArgs,
        mode: &'static str,
        frame_ms_of: &'static str,
    ) -> anyhow::Result<()> {
        let Some(path) = &args.report else {
            return Ok(());
        };
        let mirror = self.shared.mirror();
        let end = match &mirror.end {
            Some(End::Bye(reason)) => format!("bye: {reason}"),
            Some(End::Failed(reason)) => format!("failed: {reason}"),
            None => "the viewer ended first".to_owned(),
        };
        let report = Report {
            mode,
            adapter: self.adapter.clone(),
            size: args.size,
            render_scale: self.scale.now(),
            renderer: self.view.method.name(),
            adapter_bytes: self.renderer.bytes(),
            frames: self.shared.frames.load(Ordering::Relaxed),
            frame_ms_of,
            frame_ms: self.times.quantiles(),
            updates: mirror.updates,
            resyncs: mirror.resyncs,
            chunks: mirror.chunks().0,
            priority: self.manners.priority.clone(),
            core_left_free: self.manners.core_left_free,
            end,
        };
        drop(mirror);
        report.write(path)
    }
}

/// The camera of the right eye, from that of the left.
fn camera_of(left: &View, side: f64) -> Camera {
    left.camera.eye(2.0 * side)
}

/// Centres of the bricks that hold solid bone, bone frame, mm.
pub(crate) fn brick_centres(bone: &Bone) -> Vec<DVec3> {
    let spacing = bone.grid().spacing_mm;
    let mut centres = Vec::new();
    for chunk in 0..bone.chunk_count() {
        let solid = bone.chunk(chunk).solid;
        let coord = bone.chunk_coord(chunk);
        for brick in 0..BRICKS_PER_CHUNK {
            let values = &solid[brick * BRICK.pow(3)..(brick + 1) * BRICK.pow(3)];
            if values.iter().all(|&d| d <= 0) {
                continue;
            }
            let inner = brick_origin(brick);
            let voxel: [f64; 3] = core::array::from_fn(|a| {
                (usize::from(coord[a]) * 32 + inner[a] + BRICK / 2) as f64
            });
            centres.push(DVec3::from_array(voxel) * spacing);
        }
    }
    centres
}
