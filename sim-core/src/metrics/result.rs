//! What was achieved against the plan.

use super::Metric;
use super::surface::{Achieved, carved_points};
use super::volumes::{Seat, Volumes, perforated_mm3, seat, volumes};
use crate::bone::Bone;
use crate::cut::Cut;
use crate::planning::component::Component;
use crate::planning::scapula::{Angles, Scapula};
use crate::pose::Pose;
use crate::tissue::Tissue;
use glam::{DMat3, DQuat, DVec3};

/// What is to be judged.
#[derive(Debug, Clone, Copy)]
pub struct Case<'a> {
    /// The bone.
    pub bone: &'a Bone,
    /// What was cut.
    pub cut: &'a Cut,
    /// What the plan cuts.
    pub planned: &'a Cut,
    /// The plan: the component's frame when it is seated as planned.
    pub bone_from_plan: &'a Pose,
    /// The component.
    pub component: &'a Component,
    /// Height of the uncut joint face on the plan's axis, plan frame, mm: the planned depth.
    pub native_mm: f64,
    /// The scapula's frame (LPS), where landmarks are known.
    pub scapula: Option<&'a Scapula>,
    /// Labels that were not to be touched.
    pub protected: &'a [u8],
    /// The reamer's recorded axis at its deepest, bone frame, outward.
    pub tool_axis: Option<DVec3>,
}

/// Where the achieved axis is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisSource {
    /// The wall of the central peg's hole.
    PegHole,
    /// The recorded reamer.
    Tool,
}

/// The achieved pose of the component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Unit axis, outward, plan frame.
    pub axis: DVec3,
    /// Where the axis is from.
    pub source: AxisSource,
    /// Middle of the back, plan frame, mm.
    pub apex: DVec3,
    /// Turn about the axis against the plan, degrees; `None` for fewer than two pegs found.
    pub roll_deg: Option<f64>,
    /// Plan frame from the seated component's frame.
    pub plan_from_component: Pose,
}

/// How far voxels move a fitted surface, mm: the sag of a chord of one spacing across the smallest radius
/// (a peg's), and what quantising and fitting add.
pub fn surface_uncertainty_mm(bone: &Bone, component: &Component) -> f64 {
    let h = bone.grid().spacing_mm.max_element();
    let radius = component
        .pegs
        .iter()
        .map(|p| 0.5 * p.diameter_mm)
        .fold(component.backside_radius_mm, f64::min);
    0.015 + h * h / (8.0 * radius)
}

/// The achieved pose, from the peg's hole or the recorded tool, and the reamed face.
pub fn placed(case: &Case<'_>, achieved: &Achieved) -> Option<Placed> {
    let central = achieved.pegs.first().copied().flatten();
    let tool = case
        .tool_axis
        .map(|a| case.bone_from_plan.inverse().vector(a))
        .and_then(DVec3::try_normalize);
    let (axis, source) = match (central, tool) {
        (Some(peg), _) => (peg.axis, AxisSource::PegHole),
        (None, Some(axis)) => (axis, AxisSource::Tool),
        (None, None) => return None,
    };
    // a hole says where the component sits across its axis, the reamed sphere how deep
    let face = achieved.face?;
    let apex = match (source, central) {
        (AxisSource::PegHole, Some(peg)) => {
            let at = case.component.pegs[0].at_mm;
            let on_axis = peg.centre + axis * (face.centre - peg.centre).dot(axis);
            let deep = on_axis - axis * face.radius_mm;
            deep - DVec3::new(at[0], at[1], 0.0)
        }
        _ => achieved.apex(axis)?,
    };
    let roll_deg = roll_deg(case.component, achieved);
    let y = DVec3::Y.reject_from_normalized(axis).try_normalize()?;
    let upright = DQuat::from_mat3(&DMat3::from_cols(y.cross(axis), y, axis)).normalize();
    let turn = DQuat::from_rotation_z(roll_deg.unwrap_or(0.0).to_radians());
    Some(Placed {
        axis,
        source,
        apex,
        roll_deg,
        plan_from_component: Pose::new((upright * turn).normalize(), apex),
    })
}

/// Turn of the line from the first peg to the farthest other one, degrees, counterclockwise seen from
/// outside.
fn roll_deg(component: &Component, achieved: &Achieved) -> Option<f64> {
    let first = achieved.pegs.first().copied().flatten()?;
    let at = |n: usize| {
        let [x, y] = component.pegs[n].at_mm;
        DVec3::new(x, y, 0.0)
    };
    let (n, other) = achieved
        .pegs
        .iter()
        .enumerate()
        .skip(1)
        .filter_map(|(n, p)| Some((n, (*p)?)))
        .max_by(|a, b| at(a.0).distance(at(0)).total_cmp(&at(b.0).distance(at(0))))?;
    let angle = |d: DVec3| libm::atan2(d.y, d.x);
    // holes cross the plane of the face where they begin
    let begin = |c: &crate::planning::fit::Cylinder| c.centre - c.axis * (c.centre.z / c.axis.z);
    let turned = angle(begin(&other) - begin(&first)) - angle(at(n) - at(0));
    let tau = core::f64::consts::TAU;
    Some((turned - (turned / tau).round() * tau).to_degrees())
}

/// All metrics of the result.
pub fn metrics(case: &Case<'_>) -> Vec<Metric> {
    let points = carved_points(case.bone, case.cut, &case.bone_from_plan.inverse());
    let achieved = Achieved::find(&points, case.component);
    let place = placed(case, &achieved);
    let mut all = Vec::new();
    if let Some(place) = &place {
        all.extend(pose(case, &achieved, place));
    } else {
        let why = "no reamed face, or neither a peg's hole nor a recorded axis";
        let names = [
            ("version_error", "°"),
            ("inclination_error", "°"),
            ("centre_error", "mm"),
            ("depth_error", "mm"),
        ];
        all.extend(names.map(|(name, unit)| Metric::missing(name, unit, why)));
    }
    let bone_from_component = place.as_ref().map_or(*case.bone_from_plan, |p| {
        case.bone_from_plan.then(&p.plan_from_component)
    });
    let plan_from_bone = case.bone_from_plan.inverse();
    let in_place = seat(case.bone, case.cut, &bone_from_component, case.component);
    let against_plan = seat(case.bone, case.cut, case.bone_from_plan, case.component);
    let ideal = seat(case.bone, case.planned, case.bone_from_plan, case.component);
    all.extend(surface(case, &[in_place, against_plan, ideal]));
    let sums = volumes(
        case.bone,
        (case.cut, case.planned),
        &plan_from_bone,
        case.component,
        case.protected,
    );
    let planned_sums = volumes(
        case.bone,
        (case.planned, case.planned),
        &plan_from_bone,
        case.component,
        case.protected,
    );
    all.extend(amounts(case, &sums, &planned_sums));
    all.push(
        Metric::new(
            "perforation",
            perforated_mm3(case.bone, case.cut, &plan_from_bone),
            "mm³",
            "swept outside of the bone, deeper than 5 mm under the planned back",
        )
        .within(2.0 * case.bone.grid().voxel_mm3())
        .planned(0.0),
    );
    all
}

/// Axis, centre and depth.
#[expect(clippy::too_many_lines, reason = "a list")]
fn pose(case: &Case<'_>, achieved: &Achieved, place: &Placed) -> Vec<Metric> {
    let surface_mm = surface_uncertainty_mm(case.bone, case.component);
    let length = case
        .component
        .pegs
        .first()
        .map_or(10.0, |p| (p.length_mm - p.diameter_mm).max(4.0));
    let (angle_deg, note) = match place.source {
        AxisSource::PegHole => (
            libm::atan2(2.0 * surface_mm, length).to_degrees(),
            "axis of the central peg's hole against the plan",
        ),
        AxisSource::Tool => (
            0.0,
            "the reamer's recorded axis at its deepest against the plan",
        ),
    };
    let anterior = match case.scapula.map(|s| s.side) {
        Some(crate::planning::scapula::Side::Left) => -1.0,
        _ => 1.0,
    };
    let a = place.axis;
    let version = libm::atan2(anterior * a.x, a.z).to_degrees();
    let inclination = libm::atan2(a.y, a.z).to_degrees();
    let tilt = libm::atan2(a.truncate().length(), a.z).to_degrees();
    let mut all = vec![
        Metric::new("version_error", version, "°", note)
            .within(angle_deg)
            .planned(0.0),
        Metric::new("inclination_error", inclination, "°", note)
            .within(angle_deg)
            .planned(0.0),
        Metric::new(
            "axis_error",
            tilt,
            "°",
            "angle between achieved and planned axis",
        )
        .within(angle_deg)
        .planned(0.0),
    ];
    all.extend(anatomic(case, place, angle_deg));
    all.push(match place.roll_deg {
        Some(deg) => Metric::new("roll_error", deg, "°", "turn about the axis, from two pegs")
            .within(2.0 * angle_deg)
            .planned(0.0),
        None => Metric::missing("roll_error", "°", "needs the holes of two pegs"),
    });
    let c = place.apex;
    let face_rms = achieved.face.map_or(0.0, |f| f.rms_mm);
    let depth_mm = surface_mm + face_rms / (achieved.face_points.len().max(1) as f64).sqrt();
    let centre_note = "middle of the achieved back, in the plan's plane";
    all.extend([
        Metric::new(
            "centre_ap",
            anterior * c.x,
            "mm",
            "anterior positive; middle of the achieved back",
        )
        .within(2.0 * surface_mm)
        .planned(0.0),
        Metric::new(
            "centre_si",
            c.y,
            "mm",
            "superior positive; middle of the achieved back",
        )
        .within(2.0 * surface_mm)
        .planned(0.0),
        Metric::new("centre_error", c.truncate().length(), "mm", centre_note)
            .within(2.0 * surface_mm)
            .planned(0.0),
        // c.z > 0: not deep enough
        Metric::new(
            "depth_error",
            -c.z,
            "mm",
            "deeper than planned positive; along the planned axis",
        )
        .within(depth_mm)
        .planned(0.0),
        Metric::new(
            "medialisation",
            case.native_mm - c.z,
            "mm",
            "from the uncut face on the planned axis to the achieved back",
        )
        .within(depth_mm)
        .planned(case.native_mm),
    ]);
    all
}

/// Version and inclination in the scapula's frame.
fn anatomic(case: &Case<'_>, place: &Placed, angle_deg: f64) -> Vec<Metric> {
    let Some(scapula) = case.scapula else {
        let why = "no landmarks: give glenoid centre, trigonum spinae and inferior angle";
        return vec![
            Metric::missing("version", "°", why),
            Metric::missing("inclination", "°", why),
        ];
    };
    let lps_from_plan = case.bone.lps_from_bone().then(case.bone_from_plan);
    let angles = |axis: DVec3| -> Angles { scapula.angles(lps_from_plan.vector(axis)) };
    let (got, plan) = (angles(place.axis), angles(DVec3::Z));
    let note = "to the scapular plane and Friedman's axis; anteversion and superior positive";
    vec![
        Metric::new("version", got.version_deg, "°", note)
            .within(angle_deg)
            .planned(plan.version_deg),
        Metric::new("inclination", got.inclination_deg, "°", note)
            .within(angle_deg)
            .planned(plan.inclination_deg),
    ]
}

fn surface(case: &Case<'_>, [in_place, against_plan, ideal]: &[Seat; 3]) -> Vec<Metric> {
    let mm = surface_uncertainty_mm(case.bone, case.component);
    vec![
        Metric::new(
            "seating",
            100.0 * in_place.seated,
            "%",
            "of the back, away from pegs, with bone within 0.5 mm; component at the achieved pose",
        )
        .within(100.0 * mm)
        .planned(100.0 * ideal.seated),
        Metric::new(
            "surface_rms",
            against_plan.rms_mm,
            "mm",
            "carved surface over the planned back",
        )
        .within(mm)
        .planned(ideal.rms_mm),
        Metric::new(
            "surface_max",
            against_plan.max_mm,
            "mm",
            "carved surface over the planned back",
        )
        .within(2.0 * mm)
        .planned(ideal.max_mm),
    ]
}

fn amounts(case: &Case<'_>, sums: &Volumes, planned: &Volumes) -> Vec<Metric> {
    // a reamed disc moved by the surface's uncertainty
    let area = core::f64::consts::PI * 0.25 * case.component.reamer_mm.powi(2);
    let mm3 = surface_uncertainty_mm(case.bone, case.component) * area;
    let of = |tissue: Tissue, name| {
        let at = tissue as usize;
        Metric::new(name, sums.removed[at], "mm³", "removed")
            .within(mm3)
            .planned(sums.planned[at])
    };
    let share = |plate: [f64; 2]| {
        if plate[0] > 0.0 {
            100.0 * plate[1] / plate[0]
        } else {
            100.0
        }
    };
    let mut all = vec![
        of(Tissue::Cartilage, "removed_cartilage"),
        of(Tissue::Subchondral, "removed_subchondral"),
        of(Tissue::Cancellous, "removed_cancellous"),
        of(Tissue::Cortical, "removed_cortical"),
        Metric::new(
            "removed_beyond_plan",
            sums.over,
            "mm³",
            "removed where the plan leaves bone",
        )
        .within(mm3)
        .planned(0.0),
        Metric::new(
            "left_of_plan",
            sums.under,
            "mm³",
            "left where the plan removes bone",
        )
        .within(mm3)
        .planned(0.0),
        Metric::new(
            "plate_preserved",
            share(sums.plate),
            "%",
            "of the subchondral bone under the component's outline",
        )
        .within(100.0 * mm3 / sums.plate[0].max(1.0))
        .planned(share(planned.plate)),
    ];
    all.push(
        Metric::new(
            "protected_removed",
            sums.protected,
            "mm³",
            "of structures that were not to be touched",
        )
        .within(2.0 * case.bone.grid().voxel_mm3())
        .planned(0.0),
    );
    all
}
