//! Passages with planted bones and ticks.

use super::layers::{Layer, Layers};
use super::{Passage, Passages, expected_s};
use crate::haptics::record::{Felt, Flags, TickRecord};
use crate::link::LinkStats;
use core::f64::consts::{PI, TAU};
use glam::{DQuat, DVec3};
use osteon_sim_core::bone::{Bone, DenseBone};
use osteon_sim_core::chain::GuardCounts;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::{TISSUES, Tissue, hu_of_density};
use osteon_sim_core::tool::Tool;
use osteon_sim_core::tool::revolved::{Face, Form, Part, Revolved};

/// Voxels of the slab, mm, and the height of its surface in the bone frame, mm.
const H: f64 = 0.5;
const SURFACE: f64 = 16.0;

/// Half a space of layers: 2 mm of cartilage, 2 mm of plate, then cancellous bone, all of one density
/// (g/cm³); the plan's origin lies 1 mm under the surface, in the middle.
#[expect(clippy::cast_possible_truncation, reason = "densities and millimetres")]
fn slab(density: f64) -> (Bone, Pose) {
    let grid = Grid::new([49, 49, 40], DVec3::splat(H)).expect("a lattice");
    let depth = |n: usize| SURFACE - H * (n / (49 * 49)) as f64;
    let class = |n: usize| match depth(n) {
        d if d < 2.0 => Tissue::Cartilage as u8,
        d if d < 4.0 => Tissue::Subchondral as u8,
        _ => Tissue::Cancellous as u8,
    };
    let solid: Vec<f32> = (0..grid.len()).map(|n| depth(n) as f32).collect();
    let dense = DenseBone {
        density_hu: &vec![hu_of_density(density).round() as i16; grid.len()],
        solid_mm: &solid,
        class: &(0..grid.len()).map(class).collect::<Vec<u8>>(),
        label: &vec![1; grid.len()],
    };
    let bone = Bone::from_dense(grid, Pose::IDENTITY, &dense).expect("a bone");
    let origin = DVec3::new(12.0, 12.0, SURFACE - 1.0);
    (bone, Pose::new(DQuat::IDENTITY, origin))
}

fn layer(tissue: Tissue, from_mm: f64, to_mm: f64) -> Layer {
    Layer {
        tissue,
        from_mm,
        to_mm,
    }
}

/// A tick with the tip `depth` mm under the surface of three layers, beside the axis by `off` mm.
fn tick(tick: u64, depth: f64, off: f64, force: f64) -> TickRecord {
    TickRecord {
        tick,
        wake_ns: 0,
        duration_ns: 0,
        read_ns: 0,
        compute_ns: 0,
        roundtrip_ns: None,
        skipped: 0,
        state: None,
        stylus_in_base: DVec3::ZERO,
        bone_from_device: Pose::IDENTITY,
        bone_from_tool: Pose::new(DQuat::IDENTITY, DVec3::new(off, 0.0, 1.0 - depth)),
        force_n: DVec3::Z * force,
        felt: Felt::default(),
        tool: 1,
        flags: Flags::default(),
        removed_by_class: [0; TISSUES],
        epoch: 0,
        checkpoints: 0,
        revision: 0,
        drive: None,
        trips: 0,
        guards: GuardCounts::default(),
        link: LinkStats::default(),
        ring_overflows: 0,
    }
}

/// Surface 1 mm over the plan's origin, two tools.
fn passages() -> Passages {
    let layers = Layers {
        surface_mm: 1.0,
        layers: vec![
            layer(Tissue::Cartilage, 0.0, 2.0),
            layer(Tissue::Subchondral, 2.0, 4.0),
            layer(Tissue::Cancellous, 4.0, 8.0),
        ],
    };
    Passages::new(layers, Pose::IDENTITY, 2)
}

fn report(passages: &Passages) -> Vec<Passage> {
    passages.report(&Tool::standard_set())
}

#[test]
fn layers_along_an_axis() {
    let (bone, bone_from_plan) = slab(1.0);
    let found = Layers::along(&bone, &bone_from_plan);
    // the surface to a step; borders between classes to half a voxel and a step
    assert!((found.surface_mm - 1.0).abs() < 0.06, "{found:?}");
    let truth = [
        (Tissue::Cartilage, 0.0, 2.0),
        (Tissue::Subchondral, 2.0, 4.0),
        (Tissue::Cancellous, 4.0, 8.0),
    ];
    assert_eq!(found.layers.len(), truth.len(), "{found:?}");
    for (layer, (tissue, from, to)) in found.layers.iter().zip(truth) {
        assert_eq!(layer.tissue, tissue);
        assert!((layer.from_mm - from).abs() < 0.31, "{found:?}");
        assert!((layer.to_mm - to).abs() < 0.31, "{found:?}");
    }
    for pair in found.layers.windows(2) {
        assert!((pair[0].to_mm - pair[1].from_mm).abs() < 1e-9, "{found:?}");
    }
    let aside = Pose::new(DQuat::IDENTITY, DVec3::new(900.0, 0.0, 0.0));
    assert_eq!(Layers::along(&bone, &aside).layers, []);
}

#[test]
fn a_steady_feed_is_timed_layer_by_layer() {
    let mut passages = passages();
    // 2 mm/s from 0.5 mm over the surface; the force is the depth's layer
    for n in 0..3000u32 {
        let depth = 0.002 * f64::from(n) - 0.5;
        let force = if depth < 2.0 { 0.5 } else { 0.9 };
        passages.add(&tick(u64::from(n), depth, 0.5, force));
    }
    let report = report(&passages);
    let words: Vec<_> = report.iter().map(|p| (p.tool.as_str(), p.tissue)).collect();
    let reamer = ["cartilage", "subchondral", "cancellous"].map(|t| ("reamer", t));
    assert_eq!(words, reamer, "the tool that never came near is not named");
    let seconds = |n: usize| report[n].seconds.expect("passed");
    assert!((seconds(0) - 1.05).abs() < 0.002, "from its touch");
    assert!((seconds(1) - 1.0).abs() < 0.002, "{report:?}");
    assert_eq!(report[2].seconds, None);
    assert!((report[2].reached_mm.expect("entered") - 5.498).abs() < 1e-9);
    let mean = |n: usize| report[n].mean_force_n.expect("entered");
    assert!((mean(0) - 0.5).abs() < 1e-3 && (mean(1) - 0.9).abs() < 1e-3);
    assert!((report[0].peak_force_n.expect("entered") - 0.9).abs() < 1e-9);
}

#[test]
fn a_stall_a_withdrawal_and_a_gap() {
    let mut passages = passages();
    for n in 0..1000 {
        passages.add(&tick(n, 0.01, 0.0, 0.3));
    }
    // out, without force: neither time of another layer nor part of the mean
    for n in 1000..2000 {
        passages.add(&tick(n, -0.8, 0.0, 0.0));
    }
    let stalled = report(&passages);
    assert_eq!((stalled[0].seconds, stalled[1].reached_mm), (None, None));
    assert_eq!(stalled[1].mean_force_n, None);
    assert_eq!(
        (stalled[0].inside_s, stalled[1].inside_s),
        (Some(1.0), None)
    );
    assert!((stalled[0].mean_force_n.expect("touched") - 0.3).abs() < 1e-9);
    // 500 periods that the servo skipped, then through at once
    let late = TickRecord {
        skipped: 500,
        ..tick(2000, 2.5, 0.0, 0.3)
    };
    passages.add(&late);
    let through = report(&passages);
    assert_eq!(through[0].seconds, Some(2.5));
    assert_eq!(through[0].reached_mm, Some(2.0));
    assert!(through[1].reached_mm.is_some() && through[1].seconds.is_none());
}

#[test]
fn what_does_not_count() {
    let mut passages = passages();
    let flags = [
        Flags {
            waiting: true,
            ..Flags::default()
        },
        Flags {
            embedded: true,
            ..Flags::default()
        },
        Flags {
            paused: true,
            ..Flags::default()
        },
    ];
    for flags in flags {
        passages.add(&TickRecord {
            flags,
            ..tick(0, 3.0, 0.0, 1.0)
        });
    }
    passages.add(&tick(1, 3.0, 3.1, 1.0));
    passages.add(&tick(2, -1.1, 0.0, 1.0));
    // a tool that there is not
    passages.add(&TickRecord {
        tool: 7,
        ..tick(3, 3.0, 0.0, 1.0)
    });
    assert_eq!(report(&passages), []);
    passages.add(&tick(4, 3.0, 2.9, 1.0));
    assert_eq!(report(&passages)[0].seconds, Some(0.0));
    // a reset heals the bone and begins anew
    passages.add(&TickRecord {
        epoch: 1,
        ..tick(5, 0.5, 0.0, 0.7)
    });
    let anew = report(&passages);
    assert_eq!((anew[0].seconds, anew[0].reached_mm), (None, Some(0.5)));
}

/// A flat disc against the closed form t = d/v, v = (F − A p₁ρ²) ω R/(2 A λ u₁ρ² c).
#[test]
fn a_flat_disc_is_expected_to_take_what_the_closed_form_says() {
    let density = 0.6;
    let (bone, bone_from_plan) = slab(density);
    let layers = Layers::along(&bone, &bone_from_plan);
    let flat = |height_mm: f32, up: bool| Face {
        form: Form::Plane { height_mm, up },
        cutting: !up,
    };
    let side = Face {
        form: Form::cylinder(6.0),
        cutting: false,
    };
    let part = Part {
        faces: vec![flat(0.0, false), flat(10.0, true), side],
    };
    let disc = Revolved::new(vec![part]).expect("a disc");
    let tool = Tool::revolved(["disc", "disc"], disc, (1000.0, 2), [0; 3]);
    let feel = Feel::default();
    let push = 0.2;
    let found = expected_s(&bone, &bone_from_plan, &layers, &tool, &feel, push);
    let (area, rho2) = (PI * 36.0, density * density);
    let rest = feel.force_scale * area * 0.005 * rho2;
    let slope = feel.force_scale * 2.0 * area * 40.0 * rho2 * 0.95 / (1000.0 * TAU / 60.0 * 6.0);
    for (seconds, layer) in found.iter().zip(&layers.layers) {
        let truth = (layer.to_mm - layer.from_mm) * slope / (push - rest);
        let seconds = seconds.expect("passed");
        assert!(
            (seconds / truth - 1.0).abs() < 0.03,
            "{seconds} s for {truth} s"
        );
    }
    // below yield nothing is passed
    let stalled = expected_s(&bone, &bone_from_plan, &layers, &tool, &feel, 0.9 * rest);
    assert_eq!(stalled, [None; 3]);
}
