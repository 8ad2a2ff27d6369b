//! The surgical plan: where the joint face is and which way is outward.
//!
//! A JSON file with `glenoid_centre` and `glenoid_normal_outward`, DICOM LPS, mm; other fields are
//! not read, except that a `frame` which does not name LPS is refused.

use super::SceneError;
use glam::DVec3;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use serde_json::Value;
use std::path::Path;

/// Longest plan file, bytes.
const MAX_BYTES: u64 = 1 << 20;
/// How far outside the bone's box a joint face may lie, mm.
const FAR_MM: f64 = 30.0;

/// Plan frame (origin at the joint face's centre, z outward) in the DICOM LPS frame, mm.
pub fn read(path: &Path) -> Result<Pose, SceneError> {
    let refuse = |problem: String| SceneError::Plan {
        path: path.to_path_buf(),
        problem,
    };
    of_json(&json(path)?).map_err(refuse)
}

/// The same of a text; `path` is named in errors.
pub fn parse(path: &Path, text: &str) -> Result<Pose, SceneError> {
    let refuse = |problem: String| SceneError::Plan {
        path: path.to_path_buf(),
        problem,
    };
    let json = serde_json::from_str(text).map_err(|e| refuse(format!("is not JSON ({e})")))?;
    of_json(&json).map_err(refuse)
}

fn of_json(json: &Value) -> Result<Pose, String> {
    if let Some(frame) = json.get("frame")
        && !frame.as_str().is_some_and(|f| f.contains("LPS"))
    {
        return Err(format!(
            "frame = {frame}: only DICOM LPS is read; convert the numbers"
        ));
    }
    let centre = vector(json, "glenoid_centre")?;
    let outward = vector(json, "glenoid_normal_outward")?;
    if !(1e-3..=1e3).contains(&outward.length()) {
        return Err("glenoid_normal_outward has no usable length; give a unit vector".to_owned());
    }
    Ok(Pose::from_origin_and_z(centre, outward))
}

/// Thickness of the wall that a plan asks for, mm; 0 where it says nothing.
pub fn wall_mm(path: &Path) -> Result<f64, SceneError> {
    Ok(json(path)?
        .get("wall_mm")
        .and_then(Value::as_f64)
        .unwrap_or(0.0))
}

fn json(path: &Path) -> Result<Value, SceneError> {
    let refuse = |problem: String| SceneError::Plan {
        path: path.to_path_buf(),
        problem,
    };
    let length = std::fs::metadata(path)
        .map_err(|e| refuse(format!("cannot be read ({e}); check the path")))?
        .len();
    if length > MAX_BYTES {
        return Err(refuse(format!(
            "{length} bytes are no plan; give the pose's JSON file"
        )));
    }
    let text = std::fs::read_to_string(path)
        .map_err(|e| refuse(format!("cannot be read ({e}); check the file")))?;
    serde_json::from_str(&text).map_err(|e| refuse(format!("is not JSON ({e}); correct the file")))
}

/// Three finite numbers of at most 100 m.
fn vector(json: &Value, field: &str) -> Result<DVec3, String> {
    let value = json
        .get(field)
        .ok_or_else(|| format!("{field} is missing; add [x, y, z] in LPS mm"))?;
    let numbers: Option<Vec<f64>> = value
        .as_array()
        .filter(|a| a.len() == 3)
        .map(|a| a.iter().filter_map(Value::as_f64).collect());
    match numbers.as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|v| v.abs() < 1e5) => Ok(DVec3::new(x, y, z)),
        _ => {
            let text: String = value.to_string().chars().take(60).collect();
            Err(format!(
                "{field} = {text} is not three numbers in mm; give [x, y, z]"
            ))
        }
    }
}

/// Refuses a plan far from the bone: another patient's, or one in RAS.
pub fn check_near(path: &Path, grid: &Grid, bone_from_plan: &Pose) -> Result<(), SceneError> {
    let far = DVec3::from_array(grid.dims.map(|n| (n - 1) as f64)) * grid.spacing_mm;
    let centre = bone_from_plan.translation;
    let distance = centre.distance(centre.clamp(DVec3::ZERO, far));
    if distance <= FAR_MM {
        return Ok(());
    }
    Err(SceneError::Plan {
        path: path.to_path_buf(),
        problem: format!(
            "glenoid_centre lies {distance:.0} mm outside the bone; give this patient's plan in LPS mm"
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Pose, SceneError> {
        let dir = tempfile::tempdir().expect("temporary directory");
        let path = dir.path().join("plan.json");
        std::fs::write(&path, text).expect("written");
        read(&path)
    }

    #[test]
    fn the_frame_sits_at_the_centre_and_looks_outward() {
        let pose = read_text(
            r#"{"frame": "DICOM LPS", "glenoid_centre": [1, -2.5, 3e1],
                "glenoid_normal_outward": [0, -2, 0], "other": null}"#,
        )
        .expect("a plan");
        assert_eq!(pose.point(DVec3::ZERO), DVec3::new(1.0, -2.5, 30.0));
        assert!(pose.vector(DVec3::Z).distance(-DVec3::Y) < 1e-12);
    }

    #[test]
    fn each_bad_plan_is_one_line_with_file_and_field() {
        let cases = [
            ("", "not JSON"),
            ("[1]", "glenoid_centre is missing"),
            (r#"{"glenoid_centre": [1, 2]}"#, "glenoid_centre = [1,2]"),
            (r#"{"glenoid_centre": [1, "2", 3]}"#, "glenoid_centre"),
            (r#"{"glenoid_centre": [1, 2, 1e300]}"#, "glenoid_centre"),
            (
                r#"{"glenoid_centre": [1, 2, 3]}"#,
                "glenoid_normal_outward is missing",
            ),
            (
                r#"{"glenoid_centre": [1, 2, 3], "glenoid_normal_outward": [0, 0, 0]}"#,
                "glenoid_normal_outward has no usable length",
            ),
            (r#"{"frame": "RAS", "glenoid_centre": [1, 2, 3]}"#, "frame"),
        ];
        for (text, expected) in cases {
            let error = read_text(text).expect_err(text).to_string();
            assert!(
                error.contains("plan.json") && error.contains(expected),
                "{error}"
            );
            assert!(!error.contains('\n'));
        }
        let error = read(Path::new("/nowhere/plan.json")).expect_err("no file");
        assert!(error.to_string().contains("/nowhere/plan.json"));
    }
}
