//! Tools from TOML: `firmware-bridge/tools/examples.toml` teaches the format.

use super::mesh_tool::{MeshEntry, meshed};
use super::{Detail, LoadedTools, MAX_TOOLS, ToolError};
use osteon_sim_core::tool::revolved::{
    Face, Form, MAX_ALL_FACES, MAX_FACES, MAX_PARTS, Part, Revolved, RevolvedError,
};
use osteon_sim_core::tool::{STEEL, Tool};
use serde::Deserialize;
use std::io::Read as _;
use std::ops::RangeInclusive;
use std::path::Path;

/// Longest tools file, bytes.
const MAX_BYTES: u64 = 1 << 20;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ToolsFile {
    #[serde(default)]
    tool: Vec<Entry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Entry {
    pub name: String,
    pub id: String,
    pub rpm: f64,
    pub lips: u8,
    pub colour: Option<[u8; 3]>,
    #[serde(default)]
    part: Vec<PartEntry>,
    mesh: Option<MeshEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PartEntry {
    cone: Option<Cone>,
    cone_down: Option<Cone>,
    ball: Option<Ball>,
    ring: Option<Ring>,
    cylinder: Option<Cylinder>,
    from_mm: Option<f32>,
    to_mm: Option<f32>,
    #[serde(default)]
    cutting: Vec<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Cone {
    apex_mm: f32,
    half_angle_deg: f32,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Ball {
    radius_mm: f32,
    centre_mm: f32,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Ring {
    disc_mm: f32,
    centre_mm: f32,
    radius_mm: f32,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Cylinder {
    radius_mm: f32,
}

/// A tool of the file, for messages.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub path: &'a Path,
    pub tool: &'a str,
}

impl Place<'_> {
    pub(super) fn fault(&self, field: impl Into<String>, problem: impl Into<String>) -> ToolError {
        ToolError::Field {
            path: self.path.to_owned(),
            tool: self.tool.to_owned(),
            field: field.into(),
            problem: problem.into(),
        }
    }

    pub(super) fn range(
        &self,
        field: impl Into<String>,
        value: f64,
        range: RangeInclusive<f64>,
    ) -> Result<(), ToolError> {
        if range.contains(&value) {
            return Ok(());
        }
        let (lo, hi) = range.into_inner();
        Err(self.fault(field, format!("{value} is out of range; give {lo} to {hi}")))
    }
}

/// Reads a tools file and what it names.
pub(crate) fn load(path: &Path, detail: Detail) -> Result<LoadedTools, ToolError> {
    let text = read(path)?;
    parse(path, &text, detail)
}

fn read(path: &Path) -> Result<String, ToolError> {
    let fault = |reason: String| ToolError::Read {
        path: path.to_owned(),
        reason,
    };
    // asked first: opening a pipe would wait for its writer
    let about = std::fs::metadata(path).map_err(|e| fault(e.to_string()))?;
    if !about.is_file() || about.len() > MAX_BYTES {
        return Err(fault("no regular file of at most 1 MiB".to_owned()));
    }
    let mut text = String::new();
    std::fs::File::open(path)
        .and_then(|f| f.take(MAX_BYTES).read_to_string(&mut text))
        .map_err(|e| fault(e.to_string()))?;
    Ok(text)
}

/// Tools of a text; `path` is for messages and for the folder of meshes.
pub(crate) fn parse(path: &Path, text: &str, detail: Detail) -> Result<LoadedTools, ToolError> {
    let file: ToolsFile = toml::from_str(text).map_err(|e| {
        let before = e.span().and_then(|s| text.get(..s.start)).unwrap_or("");
        ToolError::Syntax {
            path: path.to_owned(),
            line: before.matches('\n').count() + 1,
            problem: e.message().replace('\n', " "),
        }
    })?;
    if file.tool.is_empty() || file.tool.len() > MAX_TOOLS {
        return Err(ToolError::Count {
            path: path.to_owned(),
            count: file.tool.len(),
        });
    }
    let mut loaded = LoadedTools {
        tools: Vec::new(),
        notes: Vec::new(),
    };
    for (n, entry) in file.tool.iter().enumerate() {
        let number = (n + 1).to_string();
        let tool = if entry.id.is_empty() {
            &number
        } else {
            &entry.id
        };
        let place = Place { path, tool };
        check_words(place, entry)?;
        if loaded.tools.iter().any(|t| t.id == entry.id) {
            return Err(place.fault("id", "two tools have it; give each its own"));
        }
        place.range("rpm", entry.rpm, 1.0..=200_000.0)?;
        place.range("lips", entry.lips.into(), 0.0..=64.0)?;
        let tool = match (&entry.mesh, entry.part.is_empty()) {
            (Some(mesh), true) => meshed(place, entry, mesh, detail, &mut loaded.notes)?,
            (None, false) => revolved(place, entry)?,
            _ => {
                return Err(place.fault(
                    "part",
                    "a tool has either [[tool.part]] tables or one [tool.mesh]; give one of the two",
                ));
            }
        };
        let tip = tool.shape.bounds().lo.z;
        if tip.abs() > 0.5 {
            loaded.notes.push(format!(
                "tool {}: its lowest point is at z = {tip:.2} mm; the stylus holds the point z = 0",
                tool.id
            ));
        }
        loaded.tools.push(tool);
    }
    Ok(loaded)
}

fn check_words(place: Place<'_>, entry: &Entry) -> Result<(), ToolError> {
    let name = entry.name.trim();
    if name.is_empty() || name.len() > 200 || name.chars().any(char::is_control) {
        return Err(place.fault("name", "give 1 to 200 bytes of text on one line"));
    }
    let plain = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_' || b == b'-';
    if entry.id.is_empty() || entry.id.len() > 40 || !entry.id.bytes().all(plain) {
        return Err(place.fault(
            "id",
            "give 1 to 40 of a to z, 0 to 9, '_' and '-'; reports use it",
        ));
    }
    Ok(())
}

fn revolved(place: Place<'_>, entry: &Entry) -> Result<Tool, ToolError> {
    let mut parts = Vec::new();
    for (n, part) in entry.part.iter().enumerate() {
        parts.push(convex(place, n + 1, part)?);
    }
    let solid = Revolved::new(parts).map_err(|e| match e {
        RevolvedError::Parts(n) => {
            place.fault("part", format!("{n} parts; give 1 to {MAX_PARTS}"))
        }
        RevolvedError::Faces(n) => place.fault(
            format!("part {}", n + 1),
            format!("give 1 to {MAX_FACES} faces"),
        ),
        RevolvedError::AllFaces(n) => place.fault(
            "part",
            format!("{n} faces in all; give at most {MAX_ALL_FACES}"),
        ),
        RevolvedError::Number(n, _) => {
            place.fault(format!("part {}", n + 1), "a number out of its range")
        }
        RevolvedError::Open(n) => place.fault(
            format!("part {}", n + 1),
            "its faces enclose nothing, or leave it open; check from_mm and to_mm, or add a cylinder",
        ),
    })?;
    let extent = (solid.bounds.hi - solid.bounds.lo).max_element();
    place.range("part", extent, 0.5..=200.0)?;
    let spindle = (entry.rpm, entry.lips);
    let colour = entry.colour.unwrap_or(STEEL);
    Ok(Tool::revolved(
        [entry.name.trim(), &entry.id],
        solid,
        spindle,
        colour,
    ))
}

/// The faces of a part that are there, by the names that `cutting` knows them by.
fn forms(part: &PartEntry) -> Vec<(&'static str, Form)> {
    let mut forms = Vec::new();
    if let Some(c) = &part.cone {
        forms.push(("cone", Form::cone(c.apex_mm, c.half_angle_deg, true)));
    }
    if let Some(c) = &part.cone_down {
        forms.push(("cone_down", Form::cone(c.apex_mm, c.half_angle_deg, false)));
    }
    if let Some(b) = &part.ball {
        let (radius_mm, centre_mm) = (b.radius_mm, b.centre_mm);
        forms.push((
            "ball",
            Form::Ball {
                radius_mm,
                centre_mm,
            },
        ));
    }
    if let Some(r) = &part.ring {
        forms.push((
            "ring",
            Form::Ring {
                disc_mm: r.disc_mm,
                centre_mm: r.centre_mm,
                radius_mm: r.radius_mm,
            },
        ));
    }
    if let Some(c) = &part.cylinder {
        forms.push(("cylinder", Form::cylinder(c.radius_mm)));
    }
    for (name, height, up) in [("from", part.from_mm, false), ("to", part.to_mm, true)] {
        if let Some(height_mm) = height {
            forms.push((name, Form::Plane { height_mm, up }));
        }
    }
    forms
}

fn convex(place: Place<'_>, number: usize, part: &PartEntry) -> Result<Part, ToolError> {
    check_numbers(place, number, part)?;
    let forms = forms(part);
    let there: Vec<&str> = forms.iter().map(|(name, _)| *name).collect();
    if let Some(name) = part.cutting.iter().find(|c| !there.contains(&c.as_str())) {
        let name: String = name.chars().take(20).collect();
        return Err(place.fault(
            format!("part {number}: cutting"),
            format!(
                "'{}' is no face of this part; it has: {}",
                name.escape_debug(),
                there.join(", ")
            ),
        ));
    }
    let faces = forms.iter().map(|&(name, form)| Face {
        form,
        cutting: part.cutting.iter().any(|c| c == name),
    });
    Ok(Part {
        faces: faces.collect(),
    })
}

fn check_numbers(place: Place<'_>, number: usize, part: &PartEntry) -> Result<(), ToolError> {
    const RADIUS: RangeInclusive<f64> = 0.1..=500.0;
    const HEIGHT: RangeInclusive<f64> = -400.0..=400.0;
    let check = |field: &str, value: f32, range: RangeInclusive<f64>| {
        place.range(format!("part {number}: {field}"), value.into(), range)
    };
    for (name, cone) in [("cone", &part.cone), ("cone_down", &part.cone_down)] {
        if let Some(c) = cone {
            check(&format!("{name}.apex_mm"), c.apex_mm, HEIGHT)?;
            check(
                &format!("{name}.half_angle_deg"),
                c.half_angle_deg,
                2.0..=88.0,
            )?;
        }
    }
    if let Some(b) = &part.ball {
        check("ball.radius_mm", b.radius_mm, RADIUS)?;
        check("ball.centre_mm", b.centre_mm, HEIGHT)?;
    }
    if let Some(r) = &part.ring {
        check("ring.disc_mm", r.disc_mm, 0.0..=500.0)?;
        check("ring.centre_mm", r.centre_mm, HEIGHT)?;
        check("ring.radius_mm", r.radius_mm, RADIUS)?;
    }
    if let Some(c) = &part.cylinder {
        check("cylinder.radius_mm", c.radius_mm, RADIUS)?;
    }
    for (name, height) in [("from_mm", part.from_mm), ("to_mm", part.to_mm)] {
        if let Some(z) = height {
            check(name, z, HEIGHT)?;
        }
    }
    Ok(())
}
