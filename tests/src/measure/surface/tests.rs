use super::*;
use crate::scenes::bones;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;

fn ball(radius: f64) -> Shape {
    crate::report::carving::tools::burr(2.0 * radius).shape
}

#[test]
fn a_planted_offset_is_measured() {
    let built = bones::block(DVec3::new(30.0, 30.0, 26.0), DVec3::splat(0.5)).expect("a block");
    // deep enough: the ball's cap lies all inside the bone
    let pose = built
        .bone_from_plan
        .then(&Pose::new(glam::DQuat::IDENTITY, DVec3::Z * -12.0));
    let swept = Swept::of_poses(ball(6.0), vec![pose]);
    let points = envelope(&swept, &built.bone, 2000);
    assert!(points.len() >= 1500, "{}", points.len());
    for planted in [0.05, -0.02] {
        let centre = pose.point(DVec3::Z * 6.0);
        // a capped cylinder above, a ball below, both larger by the offset
        let cut = |p: DVec3| {
            let q = p - centre;
            let beside = if q.z > 0.0 {
                q.truncate().length()
            } else {
                q.length()
            };
            (beside - 6.0 - planted) as f32
        };
        let e = errors(&points, DVec3::splat(0.5), 2.0, &cut);
        assert!(
            (e.smooth.mean_um - 1e3 * planted).abs() < 0.3,
            "{:?}",
            e.smooth
        );
        assert!((e.smooth.rms_um - 1e3 * planted.abs()).abs() < 0.3);
        assert_eq!(e.smooth.lost, 0);
    }
    // nothing was cut: every point is a failure, none is a zero
    let e = errors(&points, DVec3::splat(0.5), 2.0, &|_| 1.0);
    assert_eq!(
        (e.smooth.points, e.smooth.lost + e.crease.lost),
        (0, points.len())
    );
}

#[test]
fn corners_of_the_tool_are_creases_and_its_faces_are_not() {
    let built = bones::block(DVec3::new(46.0, 46.0, 26.0), DVec3::splat(0.5)).expect("a block");
    let tool = Tool::glenoid_reamer();
    let pose = built
        .bone_from_plan
        .then(&Pose::new(glam::DQuat::IDENTITY, DVec3::Z * -9.0));
    let swept = Swept::of_poses(tool.shape, vec![pose]);
    let points = envelope(&swept, &built.bone, 2000);
    let (mut near, mut far) = (0, 0);
    for p in &points {
        let q = pose.inverse().point(p.position);
        let from_rim = (q.truncate().length() - 18.0).hypot(q.z - 6.0);
        if from_rim < 0.6 {
            assert!(p.crease, "{q}");
            near += 1;
        }
        if from_rim > 0.8 {
            assert!(!p.crease, "{q}");
            far += 1;
        }
    }
    assert!(near > 20 && far > 1000, "{near} {far}");
}

#[test]
fn errors_count_what_was_lost_apart() {
    let e = Errors::of([Some(0.003), None, Some(-0.001)].into_iter());
    assert_eq!((e.points, e.lost), (2, 1));
    assert!((e.mean_um - 1.0).abs() < 1e-9 && (e.max_um - 3.0).abs() < 1e-9);
    assert!((e.rms_um - 5.0_f64.sqrt()).abs() < 1e-9);
}
