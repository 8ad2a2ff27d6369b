//! A plan as JSON: the file that `--pose` takes, with what a component needs beside it.

use super::ClinicError;
use super::components::Data;
use glam::{DMat3, DQuat, DVec3};
use osteon_sim_core::planning::component::Component;
use osteon_sim_core::planning::scapula::{Landmarks, Scapula};
use osteon_sim_core::pose::Pose;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A plan. All places and directions are DICOM LPS, mm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlanFile {
    /// Names the frame.
    pub frame: String,
    /// Where the planned axis meets the uncut joint face.
    pub glenoid_centre: [f64; 3],
    /// The planned axis, out of the bone.
    pub glenoid_normal_outward: [f64; 3],
    /// The component's superior direction.
    pub superior: [f64; 3],
    /// Depth of the back's middle below `glenoid_centre`, mm.
    pub depth_mm: f64,
    /// The component.
    pub component: Data,
    /// The landmarks.
    pub landmarks: LandmarkData,
    /// Version and inclination of the uncut joint face, degrees.
    pub native_deg: [f64; 2],
    /// Version and inclination of the planned axis, degrees.
    pub planned_deg: [f64; 2],
    /// Radius of the sphere through the joint face, mm.
    pub face_radius_mm: f64,
    /// How far the joint face's points lie off it, root mean square, mm.
    pub face_rms_mm: f64,
    /// Points of the joint face.
    pub face_points: usize,
    /// Bone nearer to the vault's outside than this is a wall, mm; 0: none.
    pub wall_mm: f64,
}

/// The three landmarks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LandmarkData {
    /// Middle of the joint face as picked.
    pub glenoid_centre: [f64; 3],
    /// Medial end of the scapular spine.
    pub trigonum_spinae: [f64; 3],
    /// Lowest point of the blade.
    pub inferior_angle: [f64; 3],
}

impl LandmarkData {
    /// As vectors.
    pub fn landmarks(&self) -> Landmarks {
        Landmarks {
            glenoid_centre: DVec3::from_array(self.glenoid_centre),
            trigonum_spinae: DVec3::from_array(self.trigonum_spinae),
            inferior_angle: DVec3::from_array(self.inferior_angle),
        }
    }
}

impl PlanFile {
    /// Reads a plan; one without a component (the bare file of `--pose`) is refused.
    pub fn read(path: &Path) -> Result<Self, ClinicError> {
        // the part that every loader needs, with its own checks
        crate::scene::plan::read(path)?;
        let text = std::fs::read_to_string(path).map_err(|e| ClinicError::File {
            path: path.to_path_buf(),
            problem: format!("cannot be read ({e}); check the file"),
        })?;
        Self::parse(path, &text)
    }

    /// A plan's text; `path` is named in errors.
    pub fn parse(path: &Path, text: &str) -> Result<Self, ClinicError> {
        let refuse = |problem: String| ClinicError::File {
            path: path.to_path_buf(),
            problem,
        };
        let plan: Self = serde_json::from_str(text).map_err(|e| {
            refuse(format!(
                "is no plan of a component ({e}); make one with 'osteon plan'"
            ))
        })?;
        plan.component.checked().map_err(refuse)?;
        if !(0.0..=20.0).contains(&plan.depth_mm) {
            return Err(refuse(format!(
                "depth_mm = {} (allowed: 0 to 20)",
                plan.depth_mm
            )));
        }
        Scapula::of(&plan.landmarks.landmarks()).map_err(|e| refuse(e.to_string()))?;
        Ok(plan)
    }

    /// Its text.
    pub fn text(&self) -> Result<String, ClinicError> {
        serde_json::to_string_pretty(self)
            .map(|t| t + "\n")
            .map_err(|e| {
                ClinicError::Plan(format!(
                    "the plan cannot be written as JSON ({e}); report this"
                ))
            })
    }

    /// The component.
    pub fn component(&self) -> Result<Component, ClinicError> {
        self.component.checked().map_err(ClinicError::Plan)
    }

    /// The scapula's frame.
    pub fn scapula(&self) -> Result<Scapula, ClinicError> {
        Scapula::of(&self.landmarks.landmarks()).map_err(|e| ClinicError::Plan(e.to_string()))
    }

    /// The seated component's frame in LPS.
    pub fn lps_from_component(&self) -> Pose {
        let z = DVec3::from_array(self.glenoid_normal_outward)
            .try_normalize()
            .unwrap_or(DVec3::Z);
        let up = DVec3::from_array(self.superior).reject_from_normalized(z);
        let y = up
            .try_normalize()
            .unwrap_or_else(|| z.any_orthonormal_vector());
        let rotation = DQuat::from_mat3(&DMat3::from_cols(y.cross(z), y, z)).normalize();
        let origin = DVec3::from_array(self.glenoid_centre) - z * self.depth_mm;
        Pose::new(rotation, origin)
    }
}
