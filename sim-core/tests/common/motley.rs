//! A ball of bone of many kinds, and random steps through it.

use super::random::{Random, random_solid, tool_of, touching};
use glam::DVec3;
use osteon_sim_core::bone::{Bone, DenseBone};
use osteon_sim_core::carve::CarveStep;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::hu_of_density;
use osteon_sim_core::tool::Tool;

/// A ball of bone across eight chunks whose voxels are each of a random class and label.
pub fn motley(random: &mut Random) -> Bone {
    let (dims, spacing) = ([44, 40, 38], DVec3::new(0.5, 0.6, 0.55));
    let grid = Grid::new(dims, spacing).expect("a grid");
    let middle = grid.centre(22, 20, 19);
    let mut solid = vec![0.0; grid.len()];
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                let away = (grid.centre(i, j, k) - middle).length();
                solid[grid.dense_index(i, j, k)] = (9.0 - away) as f32;
            }
        }
    }
    // runs of one kind and of many, so that lines are uniform, mixed in class, in label, in both
    let kinds: Vec<[u8; 2]> = (0..grid.len())
        .scan([3, 1], |kind, _| {
            match random.below(6) {
                0 => kind[0] = random.below(5) as u8,
                1 => kind[1] = random.below(256) as u8,
                _ => {}
            }
            Some(*kind)
        })
        .collect();
    let hu = vec![hu_of_density(1.0).round() as i16; grid.len()];
    let class: Vec<u8> = kinds.iter().map(|k| k[0]).collect();
    let label: Vec<u8> = kinds.iter().map(|k| k[1]).collect();
    let dense = DenseBone {
        density_hu: &hu,
        solid_mm: &solid,
        class: &class,
        label: &label,
    };
    Bone::from_dense(grid, Pose::IDENTITY, &dense).expect("a bone")
}

/// A short random step of a tool that touches the bone's surface or lies in it.
pub fn random_step(random: &mut Random, tools: &[Tool], middle: DVec3) -> CarveStep {
    let tool = random.below(tools.len());
    let place = middle + random.direction() * random.within(3.0, 9.5);
    let before = touching(random, &tools[tool].shape, place);
    let after = Pose::new(
        before.rotation.slerp(random.rotation(), 0.01),
        before.translation + random.vector(0.4),
    );
    CarveStep {
        tool: tool as u8,
        before,
        after,
    }
}

/// Five random tools.
pub fn tools(random: &mut Random) -> Vec<Tool> {
    (0..5)
        .map(|_| {
            let size = random.within(1.0, 3.0);
            tool_of(random_solid(random, size))
        })
        .collect()
}
