//! The mirror against an independently filled cut, and against nonsense.

use super::bones::{ball, carve};
use super::messages::{brick_updates, pose_at, scene, upload};
use crate::mirror::{Answer, Mirror, MirrorError};
use glam::DVec3;
use osteon_protocol::ipc::{Bricks, Digest, ToViewer};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;

fn digest_of(cut: &Cut, bone: &Bone) -> Digest {
    let d = cut.digest(bone);
    Digest {
        epoch: d.epoch,
        revision: d.revision,
        hash: d.hash,
        changed_chunks: d.changed_chunks,
    }
}

fn loaded(bone: &Bone) -> Mirror {
    let mut mirror = Mirror::default();
    for message in upload(bone, &Pose::IDENTITY) {
        assert_eq!(mirror.take(message), Ok(Answer::None));
    }
    mirror
}

fn notched(bone: &Bone, middle: DVec3) -> Cut {
    let mut cut = Cut::new(bone);
    carve(bone, &mut cut, |p| {
        (p - middle - DVec3::X * 14.0).length() - 7.0
    });
    cut
}

#[test]
fn the_mirror_comes_to_the_senders_digest() {
    let (bone, middle) = ball(80, DVec3::new(0.5, 0.6, 0.7), 15.0);
    let cut = notched(&bone, middle);
    let mut mirror = loaded(&bone);
    let updates = brick_updates(&bone, &cut);
    assert!(updates.len() > 1);
    for update in updates {
        assert_eq!(mirror.take(ToViewer::Bricks(update)), Ok(Answer::None));
    }
    let theirs = digest_of(&cut, &bone);
    assert!(theirs.changed_chunks > 0);
    // what the other side claims must not colour the answer
    let claim = Digest {
        hash: !theirs.hash,
        changed_chunks: 99,
        ..theirs
    };
    assert_eq!(
        mirror.take(ToViewer::Digest(claim)),
        Ok(Answer::Digest(theirs))
    );
    assert_eq!(mirror.resyncs, 1);
}

#[test]
fn a_missing_brick_changes_the_digest() {
    let (bone, middle) = ball(80, DVec3::splat(0.6), 15.0);
    let cut = notched(&bone, middle);
    let mut mirror = loaded(&bone);
    let mut updates = brick_updates(&bone, &cut);
    updates.pop();
    for update in updates {
        mirror.take(ToViewer::Bricks(update)).unwrap();
    }
    let theirs = digest_of(&cut, &bone);
    let Ok(Answer::Digest(own)) = mirror.take(ToViewer::Digest(theirs)) else {
        panic!("no digest")
    };
    assert_ne!(own.hash, theirs.hash);
}

#[test]
fn a_reset_drops_the_cut_and_late_bricks_of_the_old_epoch() {
    let (bone, middle) = ball(80, DVec3::splat(0.6), 15.0);
    let cut = notched(&bone, middle);
    let mut mirror = loaded(&bone);
    for update in brick_updates(&bone, &cut) {
        mirror.take(ToViewer::Bricks(update)).unwrap();
    }
    let model = mirror.model.as_mut().unwrap();
    while model.dirty.pop().is_some() {}
    mirror.take(ToViewer::Reset { epoch: 1 }).unwrap();
    assert!(
        !mirror.model.as_ref().unwrap().dirty.is_empty(),
        "the old cut stays on the screen"
    );
    for update in brick_updates(&bone, &cut) {
        mirror.take(ToViewer::Bricks(update)).unwrap();
    }
    let mut fresh = Cut::new(&bone);
    fresh.reset(1);
    let theirs = digest_of(&fresh, &bone);
    assert_eq!(
        mirror.take(ToViewer::Digest(theirs)),
        Ok(Answer::Digest(theirs))
    );
}

#[test]
fn a_second_scene_begins_anew() {
    let (bone, _) = ball(64, DVec3::ONE, 20.0);
    let mut mirror = loaded(&bone);
    for message in upload(&bone, &Pose::IDENTITY) {
        mirror.take(message).unwrap();
    }
    assert_eq!(mirror.resyncs, 2);
    assert_eq!(mirror.chunks(), (bone.chunk_count(), bone.chunk_count()));
}

#[test]
fn nonsense_is_refused_in_one_line() {
    let (bone, _) = ball(64, DVec3::ONE, 20.0);
    let whole = upload(&bone, &Pose::IDENTITY);
    let piece = |n: usize| match &whole[n] {
        ToViewer::BonePiece(p) => p.clone(),
        other => panic!("{other:?}"),
    };
    let bad = |f: &dyn Fn(&mut osteon_protocol::ipc::Scene)| {
        let mut s = scene(&bone, &Pose::IDENTITY);
        f(&mut s);
        vec![ToViewer::Scene(Box::new(s))]
    };
    let bricks = |id: (u32, u8)| {
        let lz4 = osteon_protocol::ipc_frame::pack_bricks(0, 1, vec![id], &[0; 512])
            .unwrap()
            .lz4;
        let mut messages = whole.clone();
        messages.push(ToViewer::Bricks(Bricks {
            epoch: 0,
            revision: 1,
            ids: vec![id],
            lz4,
        }));
        messages
    };
    let mut torn = piece(1);
    torn.lz4.truncate(10);
    let mut far = piece(1);
    far.coord = [900, 0, 0];
    let cases = [
        vec![ToViewer::BonePiece(piece(1))],
        vec![whole[0].clone(), ToViewer::BonePiece(piece(2))],
        vec![whole[0].clone(), ToViewer::BonePiece(torn)],
        vec![whole[0].clone(), ToViewer::BonePiece(far)],
        bad(&|s| s.chunks = 0),
        bad(&|s| s.chunks = u32::MAX),
        bad(&|s| s.dims = [0, 5, 5]),
        bad(&|s| s.spacing_mm = [1.0, f64::NAN, 1.0]),
        bad(&|s| s.bone_from_plan.rotation = [0.0; 4]),
        bad(&|s| s.lps_from_bone.translation_mm = [f64::INFINITY, 0.0, 0.0]),
        bricks((u32::MAX, 0)),
        bricks((0, 64)),
        vec![ToViewer::Bricks(Bricks {
            epoch: 0,
            revision: 0,
            ids: vec![],
            lz4: vec![],
        })],
    ];
    for (n, case) in cases.into_iter().enumerate() {
        let mut mirror = Mirror::default();
        let outcome: Result<Vec<_>, MirrorError> =
            case.into_iter().map(|m| mirror.take(m)).collect();
        let line = outcome
            .map_err(|e| e.to_string())
            .expect_err(&format!("case {n}"));
        assert!(!line.is_empty() && !line.contains('\n'), "{line}");
    }
}

#[test]
fn a_pose_that_cannot_be_drawn_is_dropped() {
    let mut mirror = Mirror::default();
    let good = pose_at([1.0, 2.0, 3.0]);
    mirror.take(ToViewer::Pose(good)).unwrap();
    let mut bad = good;
    bad.bone_from_tool.rotation = [f64::NAN; 4];
    mirror.take(ToViewer::Pose(bad)).unwrap();
    assert_eq!(mirror.pose, Some(good));
}
