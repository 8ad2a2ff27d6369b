//! `osteon plan`: from landmarks and a scene to a planned component.

use super::ClinicError;
use super::components::{self, Data};
use super::plan_file::{LandmarkData, PlanFile};
use crate::progress::Progress;
use crate::scene::{Scene, SceneArgs, SceneError, file, load};
use glam::DVec3;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::planning::component::{Component, LEAST_COVER, LEAST_WALL_MM, Misfit};
use osteon_sim_core::planning::face::{self, Face, first_surface};
use osteon_sim_core::planning::scapula::{Angles, Scapula};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::sample::Sampler;
use osteon_sim_core::tissue::Tissue;
use std::path::PathBuf;

/// The joint face is looked for within this of the picked centre, mm.
const FACE_MM: f64 = 17.0;
/// Share of the back that the proposed depth brings into contact.
const CONTACT: f64 = 0.9;
/// Deepest proposal, mm.
const MOST_DEPTH_MM: f64 = 8.0;
/// Largest version and inclination of a plan, degrees.
const MOST_DEG: f64 = 40.0;

/// Options of planning.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Landmarks are places in the patient (DICOM LPS, mm): the middle of the joint face, the trigonum spinae (medial
end of the scapular spine) and the inferior angle (lowest point of the blade). Friedman's axis runs from the
trigonum to the glenoid's centre; version and inclination are angles to it, anteversion and superior positive.

Without --version and --inclination the component's axis is that of the joint face; without --depth it goes as
deep as brings 90 % of its back onto bone (cartilage does not count). The plan is written into the scene as plan.json.")]
pub struct PlanArgs {
    /// The scene's folder
    pub scene: PathBuf,
    /// Middle of the joint face
    #[arg(long, value_name = "X,Y,Z", value_parser = place, allow_hyphen_values = true)]
    pub glenoid_centre: Place,
    /// Medial end of the scapular spine
    #[arg(long, value_name = "X,Y,Z", value_parser = place, allow_hyphen_values = true)]
    pub trigonum_spinae: Place,
    /// Lowest point of the blade
    #[arg(long, value_name = "X,Y,Z", value_parser = place, allow_hyphen_values = true)]
    pub inferior_angle: Place,
    /// Component by its id
    #[arg(long, value_name = "ID", default_value = "peg_m")]
    pub component: String,
    /// Components of your own (TOML) instead of the built-in ones
    #[arg(long, value_name = "FILE")]
    pub components: Option<PathBuf>,
    /// Planned version, degrees, anteversion positive [default: the joint face's own]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub version: Option<f64>,
    /// Planned inclination, degrees, superior positive [default: the joint face's own]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub inclination: Option<f64>,
    /// Depth of the back's middle below the uncut face, mm [default: 90 % contact]
    #[arg(long, value_name = "MM")]
    pub depth: Option<f64>,
    /// Turn of the component about its axis, degrees
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub roll: f64,
    /// Bone of this thickness at the vault's outside is so hard that a tool stands before it, mm (CT scenes)
    #[arg(long, value_name = "MM", default_value_t = 0.0)]
    pub wall: f64,
    /// Write the plan elsewhere and leave the scene alone
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Three numbers, LPS, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place(pub [f64; 3]);

fn place(text: &str) -> Result<Place, String> {
    let parts: Vec<f64> = text
        .split(',')
        .filter_map(|p| p.trim().parse().ok())
        .filter(|v: &f64| v.is_finite() && v.abs() < 1e5)
        .collect();
    match parts[..] {
        [x, y, z] if text.split(',').count() == 3 => Ok(Place([x, y, z])),
        _ => Err("give three numbers in mm: X,Y,Z (LPS)".to_owned()),
    }
}

/// Plans, telling on stderr what was found.
#[expect(clippy::print_stderr, reason = "what a command-line program says")]
pub fn run(args: &PlanArgs) -> anyhow::Result<()> {
    if file::built_in(&args.scene).is_some() && args.out.is_none() {
        return Err(ClinicError::Plan(
            "a built-in scene keeps its plan; give --out FILE for another".to_owned(),
        )
        .into());
    }
    let mut bar = Progress::new("plan");
    let plan = plan(args, &mut |stage, share| bar.show(stage, share));
    bar.finish();
    let plan = plan?;
    let folder = file::path_in(&args.scene);
    let in_scene = folder
        .parent()
        .map_or_else(PathBuf::new, PathBuf::from)
        .join(file::PLAN);
    let to = args.out.as_ref().unwrap_or(&in_scene);
    super::write_whole(to, &plan.text()?)?;
    for line in lines(&plan) {
        eprintln!("{line}");
    }
    eprintln!("plan: {}", to.display());
    Ok(())
}

fn lines(plan: &PlanFile) -> Vec<String> {
    let [version, inclination] = plan.native_deg;
    let [planned_version, planned_inclination] = plan.planned_deg;
    vec![
        format!(
            "joint face: version {version:.1}°, inclination {inclination:.1}°; sphere of {:.1} mm through {} points, {:.2} mm rms off it",
            plan.face_radius_mm, plan.face_points, plan.face_rms_mm
        ),
        format!(
            "plan: {} at version {planned_version:.1}°, inclination {planned_inclination:.1}°, {:.2} mm deep{}",
            plan.component.name,
            plan.depth_mm,
            if plan.wall_mm > 0.0 {
                format!(", wall of {} mm", plan.wall_mm)
            } else {
                String::new()
            }
        ),
    ]
}

/// Makes the plan.
pub fn plan(args: &PlanArgs, progress: &mut dyn FnMut(&str, f32)) -> Result<PlanFile, ClinicError> {
    let component = chosen(args)?;
    check_numbers(args)?;
    let landmarks = LandmarkData {
        glenoid_centre: args.glenoid_centre.0,
        trigonum_spinae: args.trigonum_spinae.0,
        inferior_angle: args.inferior_angle.0,
    };
    let scapula =
        Scapula::of(&landmarks.landmarks()).map_err(|e| ClinicError::Plan(e.to_string()))?;
    let guess = scapula.lps_from_plan(scapula.origin, scapula.lateral, 0.0);
    let mut scene_args = SceneArgs {
        scene: Some(args.scene.clone()),
        ..SceneArgs::default()
    };
    scene_args.recipe.lps_from_plan = Some(guess);
    let scene = load(&scene_args, progress).map_err(|e| match e {
        SceneError::Plan { problem, .. } => {
            ClinicError::Plan(format!("the plan lies outside the bone: {problem}"))
        }
        other => other.into(),
    })?;
    propose(args, &scene, (&scapula, landmarks), &component)
}

/// A plan on a loaded bone.
pub fn propose(
    args: &PlanArgs,
    scene: &Scene,
    (scapula, landmarks): (&Scapula, LandmarkData),
    component: &Component,
) -> Result<PlanFile, ClinicError> {
    let lps_from_bone = *scene.bone.lps_from_bone();
    let bone_from_lps = lps_from_bone.inverse();
    let guess = scapula.lps_from_plan(scapula.origin, scapula.lateral, 0.0);
    let face = find_face(scene, &bone_from_lps.then(&guess))?;
    let native = scapula.angles(lps_from_bone.vector(face.plane.normal));
    let planned = Angles {
        version_deg: args.version.unwrap_or(native.version_deg),
        inclination_deg: args.inclination.unwrap_or(native.inclination_deg),
    };
    let outward = scapula.direction(planned);
    // the picked centre, brought onto the face along the planned axis
    let picked = bone_from_lps.point(scapula.origin);
    let axis = bone_from_lps.vector(outward);
    let centre = on_face(scene, picked, axis)?;
    let lps_centre = lps_from_bone.point(centre);
    let at_depth = |depth: f64| {
        bone_from_lps.then(&scapula.lps_from_plan(lps_centre - outward * depth, outward, args.roll))
    };
    let depth_mm = match args.depth {
        Some(depth) => depth,
        None => contact_depth(scene, component, &at_depth(0.0))?,
    };
    let seated = at_depth(depth_mm);
    component
        .check(&scene.bone, &seated)
        .map_err(|misfit| ClinicError::Plan(misfit_text(component, misfit)))?;
    let superior = lps_from_bone.vector(seated.vector(DVec3::Y));
    Ok(PlanFile {
        frame: "DICOM LPS, mm".to_owned(),
        glenoid_centre: lps_centre.to_array(),
        glenoid_normal_outward: outward.to_array(),
        superior: superior.to_array(),
        depth_mm,
        component: Data::of(component),
        landmarks,
        native_deg: [native.version_deg, native.inclination_deg],
        planned_deg: [planned.version_deg, planned.inclination_deg],
        face_radius_mm: face.sphere.radius_mm,
        face_rms_mm: face.sphere.rms_mm,
        face_points: face.points.len(),
        wall_mm: args.wall,
    })
}

fn chosen(args: &PlanArgs) -> Result<Component, ClinicError> {
    let all = components::load(args.components.as_deref())?;
    let ids: Vec<String> = all.iter().map(|c| c.id.clone()).collect();
    all.into_iter()
        .find(|c| c.id == args.component)
        .ok_or_else(|| {
            ClinicError::Plan(format!(
                "--component {}: there is none; one of {}",
                args.component,
                ids.join(", ")
            ))
        })
}

fn check_numbers(args: &PlanArgs) -> Result<(), ClinicError> {
    let within = |option: &str, value: f64, least: f64, most: f64| {
        if (least..=most).contains(&value) {
            Ok(())
        } else {
            Err(ClinicError::Plan(format!(
                "{option} {value}: allowed are {least} to {most}"
            )))
        }
    };
    within(
        "--version",
        args.version.unwrap_or(0.0),
        -MOST_DEG,
        MOST_DEG,
    )?;
    within(
        "--inclination",
        args.inclination.unwrap_or(0.0),
        -MOST_DEG,
        MOST_DEG,
    )?;
    within("--depth", args.depth.unwrap_or(0.0), 0.0, 20.0)?;
    within("--roll", args.roll, -180.0, 180.0)?;
    within("--wall", args.wall, 0.0, 10.0)
}

/// The joint face: once about the transverse axis, then about the normal found.
fn find_face(scene: &Scene, bone_from_guess: &Pose) -> Result<Face, ClinicError> {
    let none = || {
        ClinicError::Plan(format!(
            "no joint face within {FACE_MM} mm of the glenoid's centre: the plan lies outside the bone, or the threshold is wrong; pick the centre anew"
        ))
    };
    let first = face::find(&scene.bone, bone_from_guess, FACE_MM).ok_or_else(none)?;
    let turned = Pose::from_origin_and_z(bone_from_guess.translation, first.plane.normal);
    face::find(&scene.bone, &turned, FACE_MM).ok_or_else(none)
}

/// Where the axis through `picked` (bone frame, unit axis outward) meets the uncut bone.
fn on_face(scene: &Scene, picked: DVec3, axis: DVec3) -> Result<DVec3, ClinicError> {
    const ABOVE_MM: f64 = 10.0;
    let cut = Cut::new(&scene.bone);
    let sampler = Sampler::new(&scene.bone, &cut);
    let from = picked + axis * ABOVE_MM;
    let depth = |p: DVec3| f64::from(sampler.depth(p));
    first_surface(&depth, from, -axis, 2.0 * ABOVE_MM)
        .filter(|t| *t > 0.0)
        .map(|t| from - axis * t)
        .ok_or_else(|| {
            ClinicError::Plan(format!(
                "the glenoid's centre lies more than {ABOVE_MM} mm from the bone's surface along the planned axis: the plan lies outside the bone; pick it anew"
            ))
        })
}

/// The depth at which the planned share of the back touches bone, mm.
fn contact_depth(
    scene: &Scene,
    component: &Component,
    bone_from_component: &Pose,
) -> Result<f64, ClinicError> {
    const ABOVE_MM: f64 = 15.0;
    let cut = Cut::new(&scene.bone);
    let sampler = Sampler::new(&scene.bone, &cut);
    let depth = |p: DVec3| f64::from(sampler.depth(p));
    let inward = bone_from_component.vector(-DVec3::Z);
    let mut needed: Vec<f64> = component
        .back_points(1.0)
        .iter()
        .map(|point| {
            let from = bone_from_component.point(point.position + DVec3::Z * ABOVE_MM);
            first_surface(&depth, from, inward, 2.0 * ABOVE_MM).map_or(f64::INFINITY, |t| {
                t + cartilage_mm(&sampler, from + inward * t, inward) - ABOVE_MM
            })
        })
        .collect();
    needed.sort_unstable_by(f64::total_cmp);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a length"
    )]
    let at = (CONTACT * needed.len() as f64) as usize;
    let depth = needed.get(at).copied().unwrap_or(f64::INFINITY).max(0.0);
    if depth > MOST_DEPTH_MM {
        return Err(ClinicError::Plan(format!(
            "component {} does not fit: {:.0} % of its back touch bone only at {depth:.1} mm (at most {MOST_DEPTH_MM} mm); take a smaller one, or other angles",
            component.id,
            100.0 * CONTACT
        )));
    }
    Ok(depth)
}

/// Way from the joint's surface through its cartilage to bone, mm: a component sits on bone.
fn cartilage_mm(sampler: &Sampler<'_>, surface: DVec3, inward: DVec3) -> f64 {
    const STEP_MM: f64 = 0.05;
    const MOST: u32 = 120;
    let soft = |n: &u32| {
        let p = surface + inward * (STEP_MM * (f64::from(*n) + 0.5));
        let matter = sampler.matter(p);
        matter.is_some_and(|m| m.class == Tissue::Cartilage as u8)
    };
    STEP_MM * (0..MOST).take_while(soft).count() as f64
}

fn misfit_text(component: &Component, misfit: Misfit) -> String {
    let id = &component.id;
    match misfit {
        Misfit::Uncovered(cover) => format!(
            "component {id} does not fit: {:.0} % of its back lie over bone (at least {:.0} %); take a smaller one or move the centre",
            100.0 * cover,
            100.0 * LEAST_COVER
        ),
        Misfit::Peg(n, wall) if wall < 0.0 => format!(
            "component {id} does not fit: peg {} leaves the bone by {:.1} mm or more; take a shorter one, or other angles",
            n + 1,
            -wall
        ),
        Misfit::Peg(n, wall) => format!(
            "component {id} does not fit: peg {} has {wall:.1} mm of bone around it (at least {LEAST_WALL_MM} mm); take a shorter one, or other angles",
            n + 1
        ),
    }
}
