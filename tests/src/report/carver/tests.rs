use super::*;
use crate::measure::surface::{envelope, errors};
use crate::measure::swept::Swept;
use crate::measure::volume::accounts;
use crate::scenes::{bones, press};
use std::collections::BTreeSet;

/// Removes every solid voxel whose centre is in the tool: the plainest of all methods.
struct Brute<'a> {
    bone: &'a Bone,
    tool: &'a Tool,
    gone: BTreeSet<[usize; 3]>,
}

impl Baseline for Brute<'_> {
    fn name(&self) -> &'static str {
        "brute"
    }
    fn theirs(&self) -> &'static str {
        ""
    }
    fn inferred(&self) -> &'static str {
        ""
    }
    fn event(&mut self, bone_from_tool: &Pose) -> u64 {
        let back = bone_from_tool.inverse();
        let [nx, ny, nz] = self.bone.grid().dims;
        let mut removed = 0;
        for voxel in
            (0..nz).flat_map(|k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])))
        {
            let p = self.bone.grid().centre(voxel[0], voxel[1], voxel[2]);
            let inside = self.tool.shape.signed_distance(back.point(p).as_vec3()) < 0.0;
            let solid = self
                .bone
                .locate(voxel)
                .is_some_and(|(chunk, at)| self.bone.chunk(chunk).solid[at] > 0);
            removed += u64::from(inside && solid && self.gone.insert(voxel));
        }
        removed
    }
    fn restore(&mut self) {
        self.gone.clear();
    }
    fn is_removed(&self, voxel: [usize; 3]) -> bool {
        self.gone.contains(&voxel)
    }
    fn bytes(&self) -> usize {
        0
    }
}

#[test]
fn a_method_of_whole_voxels_and_ours_are_measured_by_the_same_measure() {
    let h = 0.8;
    let built = bones::block(DVec3::new(46.0, 46.0, 18.0), DVec3::splat(h)).expect("a block");
    let tool = Tool::glenoid_reamer();
    let way = press::straight(3.0, glam::DVec2::new(0.11, 0.07), 6).placed(&built.bone_from_plan);
    let method = Brute {
        bone: &built.bone,
        tool: &tool,
        gone: BTreeSet::new(),
    };
    let mut brute = Rival::new(&built.bone, Box::new(method));
    let mut kernel = Kernel::new(&built.bone, &tool);
    let swept = Swept::new(tool.shape.clone(), &way.poses);
    let points = envelope(&swept, &built.bone, 1500);
    let (mut rms, mut excess) = (Vec::new(), Vec::new());
    for carver in [&mut kernel as &mut dyn Carver, &mut brute] {
        let mut along = Along::new(carver, &way.poses);
        along.reset();
        let hits = (0..way.events()).filter(|&n| along.event(n)).count();
        assert!(hits >= 5);
        let e = errors(&points, DVec3::splat(h), 3.0, &|p| carver.cut_mm(p));
        assert_eq!(e.smooth.lost, 0);
        rms.push(e.smooth.rms_um);
        let account = accounts(&swept, &built.bone, &[&|v| carver.is_removed(v)])[0];
        let volume = carver.removed_mm3() / account.mm3 - 1.0;
        assert!(volume.abs() < 0.03, "{} {volume}", carver.name());
        assert_eq!(account.missed, 0, "{}", carver.name());
        excess.push(account.excess);
    }
    // ours grows the face by h²/6R = 3.6 µm: one voxel in 220 of a layer
    assert_eq!(excess[1], 0);
    assert!(excess[0] < 40, "{excess:?}");
    // physics.md: h/√12 without a sub-voxel field, h²/(6R) with one
    assert!(
        (rms[1] / (1e3 * h / 12.0_f64.sqrt()) - 1.0).abs() < 0.25,
        "{rms:?}"
    );
    assert!(rms[0] < 15.0, "{rms:?}");
}
