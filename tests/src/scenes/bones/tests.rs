use super::*;
use osteon_sim_core::bone::DenseBone;

/// The same function on the dense lattice.
fn dense(grid: Grid, body: &impl Body) -> Bone {
    let mut solid_mm = vec![0.0f32; grid.len()];
    let (mut density_hu, mut class, mut label) = (
        vec![-1000i16; grid.len()],
        vec![0u8; grid.len()],
        vec![0u8; grid.len()],
    );
    for k in 0..grid.dims[2] {
        for j in 0..grid.dims[1] {
            for i in 0..grid.dims[0] {
                let at = grid.dense_index(i, j, k);
                let value = body.value(grid.centre(i, j, k));
                solid_mm[at] = value as f32;
                if solid_mm[at] > -grid.band_mm() as f32 {
                    let tissue = body.tissue(grid.centre(i, j, k), f64::from(value as f32));
                    class[at] = tissue as u8;
                    density_hu[at] = hu(tissue);
                    label[at] = 1;
                }
            }
        }
    }
    let dense = DenseBone {
        density_hu: &density_hu,
        solid_mm: &solid_mm,
        class: &class,
        label: &label,
    };
    Bone::from_dense(grid, Pose::IDENTITY, &dense).expect("a bone")
}

fn same(a: &Bone, b: &Bone) {
    assert_eq!(a.chunk_count(), b.chunk_count());
    for chunk in 0..a.chunk_count() {
        assert_eq!(a.chunk_coord(chunk), b.chunk_coord(chunk));
        assert_eq!(a.bony_bricks(chunk), b.bony_bricks(chunk), "{chunk}");
        let (x, y) = (a.chunk(chunk), b.chunk(chunk));
        assert!(x.solid == y.solid, "{chunk}");
        assert!(x.class == y.class, "{chunk}");
        assert!(x.density_hu == y.density_hu && x.label == y.label);
    }
}

#[test]
fn a_bone_built_by_chunks_is_that_of_the_dense_lattice_bit_for_bit() {
    let built = scapula(1.3, 1.0).expect("a bone");
    same(
        &built.bone,
        &dense(*built.bone.grid(), &ScaledScapula::new(1.0)),
    );
    let classes: std::collections::BTreeSet<u8> = (0..built.bone.chunk_count())
        .flat_map(|c| built.bone.chunk(c).class.iter().copied())
        .collect();
    assert_eq!(classes.len(), 5, "all tissues and air");
    let grid = Grid::new([70, 41, 66], DVec3::new(0.5, 0.7, 0.4)).expect("a lattice");
    let body = Plate {
        top: 14.2,
        thickness: 6.0,
    };
    let built = build(grid, Pose::IDENTITY, &body).expect("a bone");
    same(&built.bone, &dense(grid, &body));
}

#[test]
fn the_plan_lies_on_the_surface() {
    for built in [
        scapula(1.5, 1.1).expect("a bone"),
        block(DVec3::new(20.0, 20.0, 16.0), DVec3::splat(1.0)).expect("a block"),
    ] {
        let cut = osteon_sim_core::cut::Cut::new(&built.bone);
        let at = |z: f64| {
            let p = built.bone_from_plan.point(DVec3::Z * z);
            osteon_sim_core::sample::fields(&built.bone, &cut, p).solid
        };
        assert!(at(0.0).abs() < 0.3, "{}", at(0.0));
        assert!(at(1.0) < 0.0 && at(-1.0) > 0.0);
    }
}
