//! Messages as a haptics process would send them.
#![expect(
    clippy::cast_possible_truncation,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use osteon_protocol::ipc::{Bricks, PoseUpdate, Scene, ToViewer, ToolInfo, WirePose};
use osteon_protocol::ipc_frame::{PieceValues, pack_bricks, pack_piece};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::{Cut, UNCUT};
use osteon_sim_core::grid::{BRICK_VOXELS, BRICKS_PER_CHUNK};
use osteon_sim_core::pose::Pose;

pub(crate) fn wire(pose: &Pose) -> WirePose {
    WirePose {
        rotation: pose.rotation.to_array(),
        translation_mm: pose.translation.to_array(),
    }
}

pub(crate) fn pose_at(translation_mm: [f64; 3]) -> PoseUpdate {
    let pose = WirePose {
        rotation: [0.0, 0.0, 0.0, 1.0],
        translation_mm,
    };
    PoseUpdate {
        tick: 1,
        tool: 0,
        spindle_on: true,
        paused: false,
        clutched: false,
        saturated: false,
        bone_from_tool: pose,
        bone_from_device: pose,
        force_n: [0.0, 0.0, 1.5],
        physical_force_n: 30.0,
        vibration_n: 0.05,
        spindle_rpm: 600.0,
        spindle_nmm: 400.0,
        spindle_load: 0.4,
        motion_scale: 1.0,
        depth_mm: 2.0,
        removed_mm3: 0.0,
        checkpoints: 0,
    }
}

/// Reamer and drill with a shank.
pub(crate) fn tools() -> Vec<ToolInfo> {
    let dome = (0..=24).map(|i| {
        let r = 18.0 * i as f32 / 24.0;
        [r, 30.0 - (900.0 - r * r).sqrt()]
    });
    let reamer = dome
        .chain([[18.0, 9.0], [5.0, 11.0], [5.0, 60.0], [0.0, 60.0]])
        .collect();
    let drill = vec![
        [0.0, 0.0],
        [4.0, 2.4],
        [4.0, 40.0],
        [3.0, 42.0],
        [3.0, 80.0],
        [0.0, 80.0],
    ];
    let tool = |name: &str, id: &str, outline_mm| ToolInfo {
        name: name.into(),
        id: id.into(),
        outline_mm,
        rpm: 800.0,
    };
    vec![
        tool("peg drill", "peg_drill", drill),
        tool("glenoid reamer", "reamer", reamer),
    ]
}

pub(crate) fn scene(bone: &Bone, bone_from_plan: &Pose) -> Scene {
    let grid = bone.grid();
    Scene {
        source: "synthetic bone".into(),
        dims: grid.dims.map(|n| n as u32),
        spacing_mm: grid.spacing_mm.to_array(),
        lps_from_bone: wire(bone.lps_from_bone()),
        bone_from_plan: wire(bone_from_plan),
        chunks: bone.chunk_count() as u32,
        solid_mm3: bone.solid_mm3(),
        tools: tools(),
        force_limit_n: 3.3,
        force_scale: 0.03,
    }
}

/// The scene and all pieces of a bone.
pub(crate) fn upload(bone: &Bone, bone_from_plan: &Pose) -> Vec<ToViewer> {
    let mut messages = vec![ToViewer::Scene(Box::new(scene(bone, bone_from_plan)))];
    for chunk in 0..bone.chunk_count() {
        let data = bone.chunk(chunk);
        let values = PieceValues {
            density_hu: data.density_hu,
            solid: data.solid,
            class: data.class,
            label: data.label,
        };
        let piece = pack_piece(
            chunk as u32,
            bone.chunk_coord(chunk),
            bone.bony_bricks(chunk),
            &values,
        );
        messages.push(ToViewer::BonePiece(piece.unwrap()));
    }
    messages
}

/// All bricks of `cut` that differ from the uncut bone, a few in each message.
pub(crate) fn brick_updates(bone: &Bone, cut: &Cut) -> Vec<Bricks> {
    let mut all = Vec::new();
    for chunk in 0..bone.chunk_count() {
        for brick in 0..BRICKS_PER_CHUNK {
            if let Some(values) = cut.brick(chunk, brick)
                && values.iter().any(|&v| v != UNCUT)
            {
                all.push(((chunk as u32, brick as u8), values));
            }
        }
    }
    all.chunks(20)
        .map(|part| {
            let ids = part.iter().map(|(id, _)| *id).collect();
            let values: Vec<i16> = part.iter().flat_map(|(_, v)| v.iter().copied()).collect();
            assert_eq!(values.len(), part.len() * BRICK_VOXELS);
            pack_bricks(cut.epoch(), cut.revision(), ids, &values).unwrap()
        })
        .collect()
}
