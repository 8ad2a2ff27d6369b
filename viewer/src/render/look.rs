//! How the bone is shown: method, colours, section plane, ghost.

use super::method::Kind;
use crate::camera::Axes;
use glam::DVec3;
use osteon_sim_core::pose::Pose;
use serde::{Deserialize, Serialize};

/// What the bone's colours say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(crate) enum Colouring {
    /// Bone outside, the layers on a cut.
    #[default]
    Bone = 0,
    /// The layers everywhere.
    Tissue = 1,
    /// Depth below the plan's origin.
    Plan = 2,
}

impl Colouring {
    /// All, in the order of their buttons.
    pub(crate) const ALL: [Self; 3] = [Self::Bone, Self::Tissue, Self::Plan];

    /// Name on a button.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Bone => "bone",
            Self::Tissue => "tissue",
            Self::Plan => "depth to plan",
        }
    }
}

/// A plane that hides what lies beyond it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SectionPlane {
    /// Unit, towards what is hidden; bone frame.
    pub(crate) normal: DVec3,
    /// Place along the normal, mm.
    pub(crate) offset_mm: f64,
}

/// How the bone is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Look {
    /// The renderer.
    pub(crate) method: Kind,
    /// The colours.
    pub(crate) colouring: Colouring,
    /// Hides the bone before it.
    pub(crate) section: Option<SectionPlane>,
    /// Centre and width of the grey scale of CT densities, HU.
    pub(crate) window_hu: [f32; 2],
    /// Whether the tool shows through bone.
    pub(crate) ghost: bool,
    /// Whether the chunks' boxes are drawn over the picture.
    pub(crate) boxes: bool,
}

/// A grey scale for bone: -50 to 1250 HU.
pub(crate) const BONE_WINDOW_HU: [f32; 2] = [600.0, 1300.0];

impl Default for Look {
    fn default() -> Self {
        Self {
            method: Kind::default(),
            colouring: Colouring::default(),
            section: None,
            window_hu: BONE_WINDOW_HU,
            ghost: false,
            boxes: false,
        }
    }
}

/// Which plane hides bone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(crate) enum Cutaway {
    /// None.
    #[default]
    Off,
    /// Across the patient's long axis.
    Axial,
    /// Front from back.
    Coronal,
    /// Left from right.
    Sagittal,
    /// Along the planned axis, as square to the line of sight as that allows.
    Plan,
    /// Square to the line of sight.
    Facing,
}

impl Cutaway {
    /// All, in the order of their buttons.
    pub(crate) const ALL: [Self; 6] = [
        Self::Off,
        Self::Axial,
        Self::Coronal,
        Self::Sagittal,
        Self::Plan,
        Self::Facing,
    ];

    /// Name on a button.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Axial => "axial",
            Self::Coronal => "coronal",
            Self::Sagittal => "sagittal",
            Self::Plan => "along the plan",
            Self::Facing => "facing",
        }
    }
}

/// What a person chose of the view.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct ViewChoice {
    /// The renderer.
    pub(crate) method: Kind,
    /// The colours.
    pub(crate) colouring: Colouring,
    /// The section plane through the tool's tip.
    pub(crate) cutaway: Cutaway,
    /// Its shift from there, mm.
    pub(crate) shift_mm: f64,
    /// Whether the tool shows through bone.
    pub(crate) ghost: bool,
    /// Whether the chunks' boxes are drawn over the picture.
    #[serde(default)]
    pub(crate) boxes: bool,
}

/// Where things are, for the section plane; bone frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Places<'a> {
    /// The camera.
    pub(crate) axes: Axes,
    /// `lps_from_bone`.
    pub(crate) lps_from_bone: &'a Pose,
    /// `bone_from_plan`.
    pub(crate) bone_from_plan: &'a Pose,
    /// The tool's tip, mm.
    pub(crate) tip: Option<DVec3>,
}

impl ViewChoice {
    /// The same by the next renderer.
    pub(crate) fn with_next_method(self) -> Self {
        Self {
            method: self.method.next(),
            ..self
        }
    }

    /// The same with the chunks' boxes or without.
    pub(crate) fn with_other_boxes(self) -> Self {
        Self {
            boxes: !self.boxes,
            ..self
        }
    }

    /// The same with the ghost on or off.
    pub(crate) fn with_other_ghost(self) -> Self {
        Self {
            ghost: !self.ghost,
            ..self
        }
    }

    /// What it means where the camera and the tool are now.
    pub(crate) fn look(self, places: &Places<'_>) -> Look {
        Look {
            method: self.method,
            colouring: self.colouring,
            section: self.section(places),
            window_hu: BONE_WINDOW_HU,
            ghost: self.ghost,
            boxes: self.boxes,
        }
    }

    /// The plane, its hidden side towards the eye. The section renderer has always one.
    fn section(self, places: &Places<'_>) -> Option<SectionPlane> {
        let patient = |axis: DVec3| places.lps_from_bone.inverse().vector(axis);
        let plan_axis = places.bone_from_plan.vector(DVec3::Z);
        let back = -places.axes.forward;
        let along_plan = (back - plan_axis * back.dot(plan_axis))
            .try_normalize()
            .unwrap_or_else(|| plan_axis.any_orthonormal_vector());
        let tip = places.tip.unwrap_or(places.bone_from_plan.translation);
        let (normal, point) = match (self.cutaway, self.method) {
            (Cutaway::Off, Kind::Section) | (Cutaway::Plan, _) => {
                (along_plan, places.bone_from_plan.translation)
            }
            (Cutaway::Off, _) => return None,
            (Cutaway::Axial, _) => (patient(DVec3::Z), tip),
            (Cutaway::Coronal, _) => (patient(DVec3::Y), tip),
            (Cutaway::Sagittal, _) => (patient(DVec3::X), tip),
            (Cutaway::Facing, _) => (back, tip),
        };
        let normal = if normal.dot(back) < 0.0 {
            -normal
        } else {
            normal
        };
        Some(SectionPlane {
            normal,
            offset_mm: normal.dot(point) + self.shift_mm,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;

    #[test]
    fn the_hidden_side_is_the_eyes_and_the_plane_holds_its_point() {
        let plan = Pose::from_origin_and_z(DVec3::new(5.0, -3.0, 8.0), DVec3::new(0.6, 0.7, 0.2));
        let mut camera = Camera::at_plan(&plan, DVec3::Z);
        let tip = DVec3::new(1.0, 2.0, 3.0);
        for turn in 0..40 {
            camera.orbit(glam::DVec2::new(0.17 * f64::from(turn), 0.05));
            let places = Places {
                axes: camera.axes(),
                lps_from_bone: &Pose::IDENTITY,
                bone_from_plan: &plan,
                tip: Some(tip),
            };
            for cutaway in Cutaway::ALL {
                let choice = ViewChoice {
                    cutaway,
                    ..ViewChoice::default()
                };
                let Some(plane) = choice.look(&places).section else {
                    assert_eq!(cutaway, Cutaway::Off);
                    continue;
                };
                assert!((plane.normal.length() - 1.0).abs() < 1e-12);
                assert!(plane.normal.dot(-places.axes.forward) >= 0.0);
                let on = match cutaway {
                    Cutaway::Plan => plan.point(DVec3::Z * 7.0),
                    _ => tip,
                };
                assert!(
                    (plane.normal.dot(on) - plane.offset_mm).abs() < 1e-9,
                    "{cutaway:?}"
                );
            }
        }
    }
}
