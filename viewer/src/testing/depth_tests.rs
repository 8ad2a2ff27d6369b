//! Depths of the surface buffers against closed forms: planted answers.

use super::bones::ball;
use super::stage::{at_ball, gpu, model, renderer, view};
use crate::camera::Camera;
use crate::render::View;
use glam::DVec3;
use osteon_sim_core::carve::{CarveStep, carve};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use osteon_sim_core::tool::revolved::Revolved;

/// Unit direction of the ray through the middle of a pixel, and the eye.
pub(crate) fn ray(view: &View, x: u32, y: u32) -> (DVec3, DVec3) {
    let axes = view.camera.axes();
    let half = Camera::half_extent(view.aspect());
    let across = |n: u32, of: u32| (f64::from(n) + 0.5) / f64::from(of) * 2.0 - 1.0;
    let (u, v) = (across(x, view.size[0]), -across(y, view.size[1]));
    let d = axes.forward + axes.right * (half.x * u) + axes.up * (half.y * v);
    (axes.eye, d / d.length())
}

/// Both distances from the eye at which a ray crosses a sphere.
fn crossings((eye, d): (DVec3, DVec3), middle: DVec3, radius: f64) -> Option<(f64, f64)> {
    let to = eye - middle;
    let b = to.dot(d);
    let root = b * b - (to.length_squared() - radius * radius);
    (root > 0.0).then(|| (-b - root.sqrt(), -b + root.sqrt()))
}

/// Root of the mean square and the largest.
fn rms(errors: &[f64]) -> (f64, f64) {
    let square: f64 = errors.iter().map(|e| e * e).sum();
    let most = errors.iter().fold(0.0_f64, |m, e| m.max(e.abs()));
    ((square / errors.len() as f64).sqrt(), most)
}

/// A ball of bone of 14 mm with a ball of 8 mm carved into its face by the product's kernel, voxels
/// of 0.5 mm: the depth of the carved surface within 0.02 mm RMS of the sphere's.
#[test]
fn a_carved_sphere_lies_where_geometry_puts_it() {
    let Some(gpu) = gpu("carved sphere") else {
        return;
    };
    let (bone, middle) = ball(80, DVec3::splat(0.5), 14.0);
    let mut camera = at_ball(middle);
    camera.close_up(middle);
    let towards = -camera.axes().forward;
    // the carved ball's middle lies outside: the whole hollow is in sight
    let (hollow, radius) = (middle + towards * 15.0, 8.0);
    let tool = Tool::revolved(
        ["ball", "ball"],
        Revolved::ball(8.0),
        (1000.0, 2),
        [200, 200, 200],
    );
    let pose = Pose::new(glam::DQuat::IDENTITY, hollow);
    let step = CarveStep {
        tool: 0,
        before: pose,
        after: pose,
    };
    let mut cut = Cut::new(&bone);
    carve(&bone, &mut cut, &tool, &step, &mut |_, _| {});
    let mut model = model(&bone, cut);
    let mut renderer = renderer(&gpu, &mut model);
    let view = view(camera, [640, 480]);
    renderer.draw(&view);
    let distances = renderer.read_distances().unwrap();
    let (mut of_cut, mut of_bone) = (Vec::new(), Vec::new());
    for (at, &t) in (0u32..).zip(&distances) {
        let ray = ray(&view, at % view.size[0], at / view.size[0]);
        let Some((near, _)) = crossings(ray, middle, 14.0) else {
            continue;
        };
        let p = ray.0 + ray.1 * near;
        let from_rim = (p - hollow).length() - radius;
        if from_rim.abs() < 0.5 {
            // a voxel at the rim, where two surfaces meet, is rounded: it is not what is asked
            continue;
        }
        if from_rim < 0.0 {
            let (_, far) = crossings(ray, hollow, radius).unwrap();
            of_cut.push(f64::from(t) - far);
        } else if (p - middle).dot(-ray.1) > 0.3 * 14.0 {
            of_bone.push(f64::from(t) - near);
        }
    }
    let (cut_rms, cut_most) = rms(&of_cut);
    let (bone_rms, bone_most) = rms(&of_bone);
    eprintln!(
        "carved sphere, h = 0.5 mm: RMS {cut_rms:.4} mm, most {cut_most:.4} mm of {} pixels; \
         ball: RMS {bone_rms:.4}, most {bone_most:.4} of {}",
        of_cut.len(),
        of_bone.len()
    );
    assert!(of_cut.len() > 10_000 && of_bone.len() > 10_000);
    assert!(cut_rms <= 0.02, "{cut_rms}");
    assert!(cut_most <= 0.1, "{cut_most}");
    assert!(bone_rms <= 0.02, "{bone_rms}");
}
