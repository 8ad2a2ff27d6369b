//! What a session began with: written down, and made again from what is written.

use super::entry::pose_in_file;
use crate::feel::in_force;
use crate::import::hash_file;
use crate::link::DeviceInfo;
use crate::progress::Progress;
use crate::scene::file::{NAME as SCENE_FILE, PLAN as SCENE_PLAN};
use crate::scene::{self, Scene, SceneArgs};
use crate::tools::{self, Detail, ToolArgs};
use anyhow::{Context as _, anyhow, bail};
use glam::{DQuat, DVec3};
use osteon_protocol::ipc::WirePose;
use osteon_protocol::session::{Device, InputFile, SESSION_VERSION, SceneSource, Setup};
use osteon_sim_core::arm::Arm;
use osteon_sim_core::feel::{FIELDS, Feel};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::{DeviceScale, Servo, ServoSetup};
use osteon_sim_core::tool::Tool;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// What a servo is made from, beside files.
pub(crate) struct Begun<'a> {
    pub scene_args: &'a SceneArgs,
    pub tool_args: &'a ToolArgs,
    pub scene: &'a Scene,
    pub servo: &'a ServoSetup,
    pub device: &'a DeviceInfo,
    pub link_name: &'a str,
}

/// Writes a session's beginning down. Reads all input files once more, for their hashes.
pub(crate) fn describe(begun: &Begun<'_>) -> anyhow::Result<Setup> {
    let args = begun.scene_args;
    // a scene's file has the hashes of all that it is made of; one that is built in has no file
    let recipe = args.scene.as_ref().map(|dir| dir.join(SCENE_FILE));
    let recipe = recipe.filter(|path| path.exists());
    let plan = args.scene.as_ref().map(|dir| dir.join(SCENE_PLAN));
    let plan = plan.filter(|path| path.exists() && args.pose.is_none());
    let named = [
        ("scene", &recipe),
        ("plan", &plan),
        ("bone", &args.bone),
        ("labels", &args.labels),
        ("pose", &args.pose),
        ("tools", &begun.tool_args.tools),
    ];
    let mut files = Vec::new();
    for (role, path) in named {
        if let Some(path) = path {
            files.push(input_file(role, path)?);
        }
    }
    let path_of = |role: &str| {
        let file = files.iter().find(|f: &&InputFile| f.role == role);
        file.map(|f| f.path.clone())
    };
    let scale = begun.servo.device;
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    Ok(Setup {
        version: SESSION_VERSION,
        software: format!("osteon {}", env!("CARGO_PKG_VERSION")),
        began_unix_ns: now.map_or(0, |d| u64::try_from(d.as_nanos()).unwrap_or(0)),
        scene: SceneSource {
            bone: path_of("bone"),
            labels: path_of("labels"),
            keep: args.keep.clone(),
            pose: path_of("pose"),
            threshold_hu: args.threshold,
            voxel_mm: args.voxel_mm,
            seed: args.seed,
            scene: (args.scene.as_ref()).map(|scene| scene.display().to_string()),
        },
        tools: path_of("tools"),
        bone_hash: begun.scene.bone.digest(),
        tool_hashes: hashes(&begun.servo.tools),
        feel: in_force(&begun.servo.feel)
            .into_iter()
            .map(|(key, value)| (key.to_owned(), value))
            .collect(),
        tick_s: begun.servo.feel.tick_s,
        force_limit_n: begun.servo.force_limit_n,
        bone_from_base: pose_in_file(&begun.servo.bone_from_base),
        bone_from_plan: pose_in_file(&begun.servo.bone_from_plan),
        device: Device {
            link: begun.link_name.to_owned(),
            arm: begun.device.scale.arm.name().to_owned(),
            counts_per_rev: scale.counts_per_rev,
            gimbal_counts_per_rev: scale.gimbal_counts_per_rev,
            dac_max: scale.dac_max,
            nmm_per_count: scale.nmm_per_count,
        },
        files,
    })
}

fn hashes(tools: &[Tool]) -> Vec<(String, u64)> {
    tools.iter().map(|t| (t.id.clone(), t.digest())).collect()
}

fn input_file(role: &str, path: &Path) -> anyhow::Result<InputFile> {
    let cannot = || {
        format!(
            "{}: cannot be read; check the path given with --{role}",
            path.display()
        )
    };
    let full = path.canonicalize().with_context(cannot)?;
    Ok(InputFile {
        role: role.to_owned(),
        path: full.display().to_string(),
        bytes: full.metadata().with_context(cannot)?.len(),
        xxh3: hash_file(&full).with_context(cannot)?,
    })
}

/// Where the files of a recording are now, if not where they were.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct Moved {
    /// The recorded CT, where it is now [default: where it was]
    #[arg(long, value_name = "PATH")]
    pub bone: Option<PathBuf>,
    /// The recorded label map, where it is now
    #[arg(long, value_name = "PATH")]
    pub labels: Option<PathBuf>,
    /// The recorded plan, where it is now
    #[arg(long, value_name = "FILE")]
    pub pose: Option<PathBuf>,
    /// The recorded tools file, where it is now
    #[arg(long, value_name = "FILE")]
    pub tools: Option<PathBuf>,
    /// The recorded scene's folder, where it is now
    #[arg(long, value_name = "DIR")]
    pub scene: Option<PathBuf>,
}

/// A session as it was before its first tick.
pub(crate) struct Restored {
    pub scene: Scene,
    pub tools: Vec<Tool>,
    pub feel: Feel,
    pub servo: Servo,
}

/// Makes a session again, with a progress bar. A file, bone or tool that is not the recorded one is an
/// error that names it.
pub(crate) fn restore(setup: &Setup, moved: &Moved) -> anyhow::Result<Restored> {
    let mut progress = Progress::new("loading bone");
    let restored = load(setup, moved, &mut |stage, share| {
        progress.show(stage, share);
    });
    progress.finish();
    restored
}

fn load(
    setup: &Setup,
    moved: &Moved,
    progress: &mut dyn FnMut(&str, f32),
) -> anyhow::Result<Restored> {
    for file in &setup.files {
        check_file(file, moved)?;
    }
    let now = |role: &str| {
        let file = setup.files.iter().find(|f| f.role == role);
        file.map(|f| path_now(f, moved))
    };
    let folder = now("scene").and_then(|file| file.parent().map(Path::to_path_buf));
    let scene_args = SceneArgs {
        scene: folder.or_else(|| setup.scene.scene.as_ref().map(PathBuf::from)),
        bone: now("bone"),
        labels: now("labels"),
        keep: setup.scene.keep.clone(),
        pose: now("pose"),
        threshold: setup.scene.threshold_hu,
        voxel_mm: setup.scene.voxel_mm,
        seed: setup.scene.seed,
        ..SceneArgs::default()
    };
    let tools = tools::load(
        &ToolArgs {
            tools: now("tools"),
        },
        Detail::Full,
    )?
    .tools;
    check_tools(setup, &tools)?;
    let scene = scene::load(&scene_args, progress)?;
    let hash = scene.bone.digest();
    if hash != setup.bone_hash {
        bail!(
            "{}: the bone is not the recorded one (XXH3 {hash:016x}, recorded {:016x}) although its files are; {} made it otherwise, replay with that release",
            scene.source,
            setup.bone_hash,
            setup.software
        );
    }
    let feel = feel_of(setup)?;
    let servo = Servo::new(ServoSetup {
        bone: Arc::clone(&scene.bone),
        tools: tools.clone(),
        bone_from_base: pose_of(&setup.bone_from_base)?,
        bone_from_plan: pose_of(&setup.bone_from_plan)?,
        device: scale_of(&setup.device)?,
        force_limit_n: setup.force_limit_n,
        feel,
    });
    Ok(Restored {
        servo: servo.ok_or_else(|| anyhow!("the recording has no tools, or too many"))?,
        scene,
        tools,
        feel,
    })
}

fn path_now(file: &InputFile, moved: &Moved) -> PathBuf {
    let scene = moved.scene.as_ref().map(|dir| dir.join(SCENE_FILE));
    let plan = moved.scene.as_ref().map(|dir| dir.join(SCENE_PLAN));
    let now = match file.role.as_str() {
        "plan" => &plan,
        "bone" => &moved.bone,
        "labels" => &moved.labels,
        "pose" => &moved.pose,
        "tools" => &moved.tools,
        "scene" => &scene,
        _ => &None,
    };
    now.clone().unwrap_or_else(|| PathBuf::from(&file.path))
}

fn check_file(file: &InputFile, moved: &Moved) -> anyhow::Result<()> {
    let now = input_file(&file.role, &path_now(file, moved))?;
    if (now.bytes, &now.xxh3) == (file.bytes, &file.xxh3) {
        return Ok(());
    }
    bail!(
        "{}: is not the file of the recording ({} bytes with XXH3 {}, recorded {} with {}); bring that back, or say with --{} where it is",
        now.path,
        now.bytes,
        now.xxh3,
        file.bytes,
        file.xxh3,
        file.role
    )
}

fn check_tools(setup: &Setup, tools: &[Tool]) -> anyhow::Result<()> {
    let source = setup.tools.as_deref().unwrap_or("the built-in tools");
    let now = hashes(tools);
    if now.len() != setup.tool_hashes.len() {
        bail!(
            "{source}: {} tools, recorded {}; replay with {}",
            now.len(),
            setup.tool_hashes.len(),
            setup.software
        );
    }
    for (now, recorded) in now.iter().zip(&setup.tool_hashes) {
        if now != recorded {
            bail!(
                "{source}: tool {} is not the recorded one (XXH3 {:016x}, recorded {} with {:016x}); bring back the file of its mesh, or replay with {}",
                now.0,
                now.1,
                recorded.0,
                recorded.1,
                setup.software
            );
        }
    }
    Ok(())
}

fn feel_of(setup: &Setup) -> anyhow::Result<Feel> {
    let mut feel = Feel {
        tick_s: setup.tick_s,
        ..Feel::default()
    };
    for (key, value) in &setup.feel {
        let field = FIELDS.iter().find(|f| f.key == key);
        let field = field.ok_or_else(|| {
            anyhow!(
                "this release has no parameter {key}; replay with {}",
                setup.software
            )
        })?;
        field
            .set(&mut feel, *value)
            .map_err(|e| anyhow!("recorded parameter {e}; replay with {}", setup.software))?;
    }
    if setup.feel.len() != FIELDS.len() {
        bail!(
            "the recording has {} parameters, this release {}; replay with {}",
            setup.feel.len(),
            FIELDS.len(),
            setup.software
        );
    }
    Ok(feel)
}

fn pose_of(wire: &WirePose) -> anyhow::Result<Pose> {
    let pose = Pose::new(
        DQuat::from_array(wire.rotation),
        DVec3::from_array(wire.translation_mm),
    );
    if pose.is_valid() {
        return Ok(pose);
    }
    bail!("the recording's setup holds a pose that is no rigid transform; the file is damaged")
}

fn scale_of(device: &Device) -> anyhow::Result<DeviceScale> {
    let arm = Arm::of_name(&device.arm).ok_or_else(|| {
        anyhow!(
            "this release has no arm '{}'; replay with the one that recorded",
            device.arm
        )
    })?;
    Ok(DeviceScale {
        arm,
        counts_per_rev: device.counts_per_rev,
        gimbal_counts_per_rev: device.gimbal_counts_per_rev,
        dac_max: device.dac_max,
        nmm_per_count: device.nmm_per_count,
    })
}
