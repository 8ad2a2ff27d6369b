//! Thin plates: case 6.

use super::super::device::FINE;
use super::super::guided::Guided;
use super::super::peers::plate_crossed_n;
use super::super::setup::{Scene, Spec, ball, bone_of};
use super::{Case, Worst};
use glam::{DQuat, DVec3};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use rayon::prelude::*;

/// A plate that is some voxels thick, its middle on a voxel's plane or off it by a share of a voxel.
#[derive(Debug, Clone, Copy)]
struct Plate {
    voxel_mm: f64,
    voxels: f64,
    off: f64,
}

impl Plate {
    fn thickness_mm(self) -> f64 {
        self.voxel_mm * self.voxels
    }

    fn scene(self, tool: Tool) -> Scene {
        let h = self.voxel_mm;
        let extent = DVec3::new(44.0, 44.0, 16.0);
        let half = 0.5 * self.thickness_mm();
        // an odd number of voxels has its middle on a voxel, an even one between two
        let between = if self.voxels % 2.0 == 0.0 { 0.5 } else { 0.0 };
        let middle = ((8.0 / h).round() + between + self.off) * h;
        let bone = bone_of(extent, DVec3::splat(h), 1.9, |p| {
            half - (p.z - middle).abs()
        });
        let top = DVec3::new(22.01, 22.02, middle + half);
        Scene {
            bone,
            bone_from_base: Pose::new(DQuat::IDENTITY, top),
            tools: vec![tool],
        }
    }

    /// The lowest place of the proxy over the thickness (0: on the face, −1: through), and the force at
    /// the end, N: the device goes 9 mm deep, and 2 mm to the side.
    fn pressed(self, tool: Tool) -> (f64, f64) {
        let mut spec = Spec::at(self.scene(tool));
        spec.scale = FINE;
        let mut guided = Guided::new(&spec, DVec3::Z * 8.0, false);
        let mut lowest = f64::MAX;
        for to in [DVec3::Z * -9.0, DVec3::new(2.0, 1.0, -9.0)] {
            guided.glide_seen(to, 60.0, |g| lowest = lowest.min(g.proxy_mm().z));
        }
        guided.rest(0.1);
        (lowest / self.thickness_mm(), guided.force_n().length())
    }
}

/// Case 6.
pub(super) fn plates() -> Case {
    let mut all = Vec::new();
    for voxel_mm in [0.47, 0.5, 1.0] {
        for voxels in [1.0, 2.0, 3.0] {
            for off in [0.0, 0.2] {
                let plate = Plate {
                    voxel_mm,
                    voxels,
                    off,
                };
                all.extend(
                    [ball(3.0), Tool::peg_drill(), Tool::glenoid_reamer()].map(|t| (plate, t)),
                );
            }
        }
    }
    let pressed: Vec<_> = all
        .into_par_iter()
        .map(|(plate, tool)| (plate, tool.id.clone(), plate.pressed(tool)))
        .collect();
    let (mut through, mut force) = (Worst::default(), f64::MAX);
    for (plate, tool, (lowest, force_n)) in &pressed {
        through.note(-lowest, || {
            format!(
                "{tool}, {} voxels of {} mm, off by {}",
                plate.voxels, plate.voxel_mm, plate.off
            )
        });
        force = force.min(*force_n);
    }
    let penalty: Vec<String> = [0.47, 1.0, 3.0]
        .map(|t| format!("{:.2} N at {t} mm", plate_crossed_n(0.5, t)))
        .into();
    Case {
        id: 6,
        name: "Thin plates",
        criterion: "plates of 1, 2 and 3 voxels of 0.47, 0.5 and 1 mm, spindle off, three tools, pressed to 3.3 N and then \
                    sideways: never crossed (the proxy stays less than half the thickness inside)"
            .to_owned(),
        measured: format!(
            "least force {force:.3} N; deepest {}; a pure penalty lets through at {}",
            through.words("of the thickness"),
            penalty.join(", ")
        ),
        pass: through.value < 0.5 && force > 3.29,
    }
}
