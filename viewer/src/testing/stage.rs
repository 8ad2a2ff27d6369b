//! What picture tests have in common: adapter, model, renderer, camera.

use super::messages::tools;
use crate::adapter::{self, Gpu};
use crate::bricks::{BrickMap, Dirty};
use crate::camera::Camera;
use crate::mirror::Model;
use crate::offscreen::write_png;
use crate::render::look::Look;
use crate::render::{Renderer, View};
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use std::sync::Arc;

/// The adapter, or a loud word that the test saw nothing.
pub(crate) fn gpu(test: &str) -> Option<Gpu> {
    match adapter::open() {
        Ok(gpu) => Some(gpu),
        Err(e) => {
            eprintln!("SKIPPED {test}: {e:#}");
            None
        }
    }
}

pub(crate) fn model(bone: &Bone, cut: Cut) -> Model {
    let map = BrickMap::new(bone).unwrap();
    Model {
        bone: Arc::new(bone.clone()),
        cut,
        dirty: Dirty::all(&map),
        map: Arc::new(map),
    }
}

pub(crate) fn renderer(gpu: &Gpu, model: &mut Model) -> Renderer {
    let mut renderer = Renderer::new(&gpu.device, &gpu.queue);
    renderer.load(model, &tools()).unwrap();
    renderer.upload(model, usize::MAX).unwrap();
    renderer
}

pub(crate) fn picture(renderer: &mut Renderer, view: &View) -> Vec<u8> {
    renderer.draw(view);
    renderer.read().unwrap()
}

/// Keeps a picture to look at, where `OSTEON_PICTURES` names a folder.
pub(crate) fn keep(name: &str, size: [u32; 2], pixels: &[u8]) {
    if let Some(folder) = std::env::var_os("OSTEON_PICTURES") {
        let path = std::path::Path::new(&folder).join(format!("{name}.png"));
        write_png(&path, size, pixels).unwrap();
    }
}

pub(crate) fn view(camera: Camera, size: [u32; 2]) -> View {
    View {
        camera,
        size,
        tool: None,
        shadows: false,
        look: Look::default(),
        plan: Pose::IDENTITY,
    }
}

/// Looks along −x at a ball, from the given distance.
pub(crate) fn at_ball(middle: DVec3) -> Camera {
    let plan = Pose::from_origin_and_z(middle, DVec3::X);
    Camera::at_plan(&plan, DVec3::Z)
}
