//! Pictures against closed forms and against each other. Skipped, aloud, without an adapter.

use super::bones::{ball, carve, scapula_like, surgery};
use super::stage::{at_ball, gpu, keep, model, picture, renderer, view};
use crate::bricks::Dirty;
use crate::camera::Camera;
use crate::render::look::Look;
use crate::render::{Renderer, View};
use glam::{DQuat, DVec3};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;

fn differing(a: &[u8], b: &[u8]) -> usize {
    a.chunks_exact(4)
        .zip(b.chunks_exact(4))
        .filter(|(x, y)| x != y)
        .count()
}

#[test]
fn the_silhouette_of_a_ball_has_the_area_of_its_cone_of_rays() {
    let Some(gpu) = gpu("ball") else { return };
    for spacing in [DVec3::splat(0.5), DVec3::new(0.4, 0.6, 0.9)] {
        let radius = 14.0;
        let (bone, middle) = ball(80, spacing, radius);
        let mut model = model(&bone, Cut::new(&bone));
        let mut renderer = renderer(&gpu, &mut model);
        let mut camera = at_ball(middle);
        camera.close_up(middle);
        let size = [480, 360];
        let view = view(camera, size);
        let pixels = picture(&mut renderer, &view);
        keep("ball", size, &pixels);
        let mut empty = Renderer::new(&gpu.device, &gpu.queue);
        empty.draw(&view);
        // the background alone: the same camera with the ball behind the eye
        let mut away = camera;
        away.close_up(middle + DVec3::new(0.0, 0.0, 4000.0));
        let background = picture(
            &mut renderer,
            &View {
                camera: away,
                ..view
            },
        );
        let covered = differing(&pixels, &background) as f64;
        // a ball at distance d subtends a cone of half angle asin(r/d); its circle on the picture
        // has the radius tan(that) in units of the half height at unit depth
        let axes = camera.axes();
        let sine = radius / (axes.eye - middle).length();
        let tangent = sine / (1.0 - sine * sine).sqrt();
        let in_px = tangent / Camera::half_extent(1.0).y * f64::from(size[1]) / 2.0;
        let expected = std::f64::consts::PI * in_px * in_px;
        assert!(
            (covered / expected - 1.0).abs() < 0.01,
            "spacing {spacing}: {covered} {expected}"
        );
    }
}

#[test]
fn an_adapter_that_is_gone_is_an_error_and_no_panic() {
    let Some(gpu) = gpu("lost adapter") else {
        return;
    };
    let (bone, middle) = ball(40, DVec3::splat(0.5), 8.0);
    let mut model = model(&bone, Cut::new(&bone));
    let mut renderer = renderer(&gpu, &mut model);
    let view = view(at_ball(middle), [64, 48]);
    renderer.draw(&view);
    renderer.wait().unwrap();
    gpu.device.destroy();
    // a new size asks for new textures
    renderer.draw(&View {
        size: [80, 60],
        ..view
    });
    let said = renderer.wait().unwrap_err().to_string();
    assert!(
        said.contains("start the viewer again") && !said.contains('\n'),
        "{said}"
    );
}

#[test]
fn a_notch_changes_the_pixels_where_it_is_and_no_others() {
    let Some(gpu) = gpu("notch") else { return };
    let (bone, middle) = ball(80, DVec3::splat(0.5), 14.0);
    let camera = {
        let mut c = at_ball(middle);
        c.close_up(middle);
        c
    };
    let size = [480, 360];
    let view = view(camera, size);
    let towards = -camera.axes().forward;
    let mut model = model(&bone, Cut::new(&bone));
    let mut renderer = renderer(&gpu, &mut model);
    let before = picture(&mut renderer, &view);
    let mut cut = Cut::new(&bone);
    carve(&bone, &mut cut, |p| {
        (p - middle - towards * 14.0).length() - 5.0
    });
    model.cut = cut;
    model.dirty = Dirty::all(&model.map);
    renderer.upload(&mut model, usize::MAX).unwrap();
    let after = picture(&mut renderer, &view);
    keep("notch", size, &after);
    let pixel = |x: u32, y: u32| 4 * (y * size[0] + x) as usize;
    let (cx, cy) = (size[0] / 2, size[1] / 2);
    let centre = pixel(cx, cy)..pixel(cx, cy) + 4;
    assert_ne!(before[centre.clone()], after[centre]);
    // the rim of the notch lies within 5 mm of the axis: 30 mm make half the height
    let reach = 5.6 / 30.0 * f64::from(size[1]) / 2.0 * 1.15;
    // occlusion is felt up to 4 mm further
    let reach = reach + 5.0 / 30.0 * f64::from(size[1]) / 2.0;
    for y in 0..size[1] {
        for x in 0..size[0] {
            let far = f64::from(x.abs_diff(cx)).hypot(f64::from(y.abs_diff(cy))) > reach;
            let at = pixel(x, y);
            assert!(
                !far || before[at..at + 4] == after[at..at + 4],
                "pixel {x},{y} changed"
            );
        }
    }
    assert!(differing(&before, &after) > 1000);
}

#[test]
fn uploading_changed_bricks_gives_the_picture_of_a_full_rebuild() {
    let Some(gpu) = gpu("updates") else { return };
    let (bone, plan) = scapula_like(1.0);
    let mut cut = Cut::new(&bone);
    surgery(&bone, &mut cut, &plan);
    let mut camera = Camera::at_plan(&plan, DVec3::Z);
    camera.close_up(plan.translation);
    let view = view(camera, [400, 300]);

    let mut mirror = super::messages::upload(&bone, &plan).into_iter().fold(
        crate::mirror::Mirror::default(),
        |mut m, message| {
            m.take(message).unwrap();
            m
        },
    );
    let mut updated = renderer(&gpu, mirror.model.as_mut().unwrap());
    let uncut = picture(&mut updated, &view);
    for update in super::messages::brick_updates(&bone, &cut) {
        mirror
            .take(osteon_protocol::ipc::ToViewer::Bricks(update))
            .unwrap();
    }
    let own = mirror.model.as_mut().unwrap();
    let (changed, all) = (own.dirty.len(), own.map.slots());
    assert!(
        changed > 0 && changed < all / 2,
        "{changed} of {all} bricks uploaded"
    );
    updated.upload(own, usize::MAX).unwrap();
    let incremental = picture(&mut updated, &view);

    let mut whole = model(&bone, cut);
    let mut rebuilt = renderer(&gpu, &mut whole);
    let full = picture(&mut rebuilt, &view);
    assert_eq!(differing(&incremental, &full), 0);
    assert!(differing(&incremental, &uncut) > 2000);
}

#[test]
fn the_tool_hides_the_bone_behind_it_and_is_hidden_by_the_bone_before_it() {
    let Some(gpu) = gpu("depth") else { return };
    let (bone, middle) = ball(80, DVec3::splat(0.5), 14.0);
    let mut model = model(&bone, Cut::new(&bone));
    let mut renderer = renderer(&gpu, &mut model);
    let mut camera = at_ball(middle);
    camera.close_up(middle);
    let towards = -camera.axes().forward;
    let size = [240, 180];
    let mut at = |offset: f64| {
        // the drill lies across the line of sight
        let along = camera.axes().right;
        let pose = Pose::from_origin_and_z(middle + towards * offset - along * 40.0, along);
        let view = View {
            tool: Some((0, pose)),
            ..view(camera, size)
        };
        let pixels = picture(&mut renderer, &view);
        keep(
            if offset > 0.0 {
                "tool_before"
            } else {
                "tool_behind"
            },
            size,
            &pixels,
        );
        pixels
    };
    let (before, behind) = (at(25.0), at(-25.0));
    let centre = 4 * (size[1] / 2 * size[0] + size[0] / 2) as usize;
    let bare = picture(&mut renderer, &view(camera, size));
    assert_ne!(before[centre..centre + 3], bare[centre..centre + 3]);
    assert_eq!(behind[centre..centre + 3], bare[centre..centre + 3]);
    assert_ne!(
        differing(&behind, &bare),
        0,
        "the drill's ends stick out behind the ball"
    );
}

#[test]
fn something_like_a_scapula_is_drawn_in_time() {
    let Some(gpu) = gpu("scapula") else { return };
    let (bone, plan) = scapula_like(0.5);
    let mut cut = Cut::new(&bone);
    surgery(&bone, &mut cut, &plan);
    let mut model = model(&bone, cut);
    let begin = std::time::Instant::now();
    let mut renderer = renderer(&gpu, &mut model);
    renderer.wait().unwrap();
    eprintln!(
        "{} bricks uploaded in {:?}",
        model.map.slots(),
        begin.elapsed()
    );
    let mut camera = Camera::at_plan(&plan, DVec3::Z);
    let corners: Vec<DVec3> = (0..8)
        .map(|c| {
            DVec3::new(
                f64::from(c & 1) * 95.0,
                f64::from(c >> 1 & 1) * 45.0,
                5.0 + f64::from(c >> 2) * 115.0,
            )
        })
        .collect();
    camera.fit(&corners, 16.0 / 9.0);
    let lifted = Pose::new(plan.rotation * DQuat::IDENTITY, plan.point(DVec3::Z * 25.0));
    for (name, size, shadows) in [
        ("scapula", [640, 360], false),
        ("scapula_fine", [1280, 720], true),
    ] {
        let view = View {
            camera,
            size,
            tool: Some((1, lifted)),
            shadows,
            look: Look::default(),
            plan,
        };
        drop(picture(&mut renderer, &view));
        let times = (0..8).map(|_| {
            let begin = std::time::Instant::now();
            renderer.draw(&view);
            renderer.wait().unwrap();
            begin.elapsed()
        });
        let best = times.min().unwrap();
        eprintln!(
            "{name}: {size:?}, best of 8: {best:?} on {}",
            gpu.adapter.name
        );
        let pixels = picture(&mut renderer, &view);
        keep(name, size, &pixels);
    }
    camera.close_up(plan.translation);
    let close = View {
        camera,
        size: [1280, 720],
        tool: None,
        shadows: true,
        look: Look::default(),
        plan,
    };
    let pixels = picture(&mut renderer, &close);
    keep("glenoid", close.size, &pixels);
    // bone is lighter than any background: it must cover a good part of the close-up
    let light = pixels.chunks_exact(4).filter(|p| p[0] > 110).count();
    assert!(light * 8 > pixels.len() / 4, "{light}");
}
