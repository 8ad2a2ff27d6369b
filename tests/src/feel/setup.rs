//! Bones, tools and the servo's setup for the bench. All that depends on how the servo takes its
//! parameters is here.

use super::device::OMNI;
use super::hand::Hand;
use super::plant::PlantSpec;
use glam::{DQuat, DVec3};
use osteon_sim_core::bone::{Bone, DenseBone};
use osteon_sim_core::chain::FORCE_LIMIT_N;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::{DeviceScale, Servo, ServoSetup};
use osteon_sim_core::tissue::{Tissue, hu_of_density};
use osteon_sim_core::tool::revolved::{Face, Form, Part, Revolved};
use osteon_sim_core::tool::{STEEL, Tool};
use std::sync::Arc;

/// A flat piece of bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slab {
    /// Extent of the lattice, mm.
    pub extent_mm: DVec3,
    /// Voxels, mm.
    pub spacing_mm: DVec3,
    /// Tilt of the face against the lattice, about y, degrees.
    pub tilt_deg: f64,
    /// g/cm³.
    pub density: f64,
    /// Thickness of the bone under its face, mm; infinite: a half space.
    pub thickness_mm: f64,
}

impl Default for Slab {
    fn default() -> Self {
        Self {
            extent_mm: DVec3::new(24.0, 24.0, 16.0),
            spacing_mm: DVec3::splat(0.5),
            tilt_deg: 0.0,
            density: 1.9,
            thickness_mm: f64::INFINITY,
        }
    }
}

/// A bone and where the base frame lies in it.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The bone.
    pub bone: Arc<Bone>,
    /// Base frame: origin on the face, z outward.
    pub bone_from_base: Pose,
    /// Tools.
    pub tools: Vec<Tool>,
}

impl Slab {
    /// The bone, its face through the lattice's centre.
    pub fn scene(&self, tools: Vec<Tool>) -> Scene {
        let rotation = DQuat::from_rotation_y(self.tilt_deg.to_radians());
        // off the voxels' planes, as a patient's bone would be
        let centre = 0.5 * self.extent_mm + DVec3::new(0.01, 0.02, 0.03);
        let normal = rotation * DVec3::Z;
        let bone = bone_of(self.extent_mm, self.spacing_mm, self.density, |p| {
            let depth = normal.dot(centre - p);
            depth.min(self.thickness_mm - depth)
        });
        Scene {
            bone,
            bone_from_base: Pose::new(rotation, centre),
            tools,
        }
    }
}

/// A bone of one density (g/cm³) and class cancellous whose signed distance, mm, positive inside, is
/// `distance(point in the bone frame)`.
pub fn bone_of(
    extent_mm: DVec3,
    spacing_mm: DVec3,
    density: f64,
    distance: impl Fn(DVec3) -> f64,
) -> Arc<Bone> {
    layered(extent_mm, spacing_mm, |p| {
        (distance(p), density, Tissue::Cancellous)
    })
}

/// A bone of which `matter(point in the bone frame)` says the signed distance, mm, positive inside, the
/// density, g/cm³, and the class.
pub fn layered(
    extent_mm: DVec3,
    spacing_mm: DVec3,
    matter: impl Fn(DVec3) -> (f64, f64, Tissue),
) -> Arc<Bone> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a lattice of some hundred voxels"
    )]
    let dims = (extent_mm / spacing_mm).to_array().map(|n| n as usize + 1);
    let grid = Grid::new(dims, spacing_mm).expect("a valid lattice");
    let mut solid = vec![0.0f32; grid.len()];
    let mut hu = vec![0i16; grid.len()];
    let mut class = vec![0; grid.len()];
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                let (distance, density, tissue) = matter(grid.centre(i, j, k));
                let at = grid.dense_index(i, j, k);
                #[expect(
                    clippy::cast_possible_truncation,
                    reason = "fields are f32 and i16; the casts saturate"
                )]
                {
                    solid[at] = distance as f32;
                    hu[at] = hu_of_density(density).round() as i16;
                }
                class[at] = tissue as u8;
            }
        }
    }
    let label = vec![1; grid.len()];
    let dense = DenseBone {
        density_hu: &hu,
        solid_mm: &solid,
        class: &class,
        label: &label,
    };
    Arc::new(Bone::from_dense(grid, Pose::IDENTITY, &dense).expect("a bone"))
}

/// A flat bone of one density in which a tool already stands, its tip `depth_mm` below the face and its
/// origin the base frame's: engaged all over. The base's axes are the lattice's.
pub fn socket(
    tool: &Tool,
    extent_mm: DVec3,
    depth_mm: f64,
    density: f64,
    spacing_mm: f64,
) -> Scene {
    let foot = DVec3::new(
        0.5 * extent_mm.x,
        0.5 * extent_mm.y,
        extent_mm.z - depth_mm - 2.0,
    ) + DVec3::new(0.01, 0.02, 0.03);
    let bone = bone_of(extent_mm, DVec3::splat(spacing_mm), density, |p| {
        let own = f64::from(tool.shape.signed_distance((p - foot).as_vec3()));
        own.min(foot.z + depth_mm - p.z)
    });
    Scene {
        bone,
        bone_from_base: Pose::new(DQuat::IDENTITY, foot),
        tools: vec![tool.clone()],
    }
}

/// A ball that cuts all over, mm; its apex is the tool's origin.
pub fn ball(radius_mm: f32) -> Tool {
    let face = Face {
        form: Form::Ball {
            radius_mm,
            centre_mm: radius_mm,
        },
        cutting: true,
    };
    let solid = Revolved::new(vec![Part { faces: vec![face] }]).expect("a ball");
    Tool::revolved(["Ball", "ball"], solid, (1000.0, 6), STEEL)
}

/// What a bench is made from.
#[derive(Debug, Clone)]
pub struct Spec {
    /// Bone, place and tools.
    pub scene: Scene,
    /// Parameters of the feel; not checked against their ranges.
    pub feel: Feel,
    /// The device's mechanics.
    pub plant: PlantSpec,
    /// Who holds it.
    pub hand: Hand,
    /// The device's numbers.
    pub scale: DeviceScale,
    /// From a sample to its command in force, ticks.
    pub delay_ticks: usize,
}

impl Spec {
    /// The typical device without a hand and with one tick of delay at a scene.
    pub fn at(scene: Scene) -> Self {
        Self {
            scene,
            feel: Feel::default(),
            plant: PlantSpec::TYPICAL,
            hand: Hand::NONE,
            scale: OMNI,
            delay_ticks: 1,
        }
    }

    /// A 3 mm ball on a flat, hard slab.
    pub fn flat() -> Self {
        Self::at(Slab::default().scene(vec![ball(3.0)]))
    }

    /// Held by `hand`, with a delay of `delay_ticks`.
    #[must_use]
    pub fn with(mut self, hand: Hand, delay_ticks: usize) -> Self {
        self.hand = hand;
        self.delay_ticks = delay_ticks;
        self
    }

    /// Another stiffness of the coupling, N/mm.
    #[must_use]
    pub fn stiff(mut self, stiffness_n_per_mm: f64) -> Self {
        self.feel.coupling.stiffness_n_per_mm = stiffness_n_per_mm;
        self
    }

    /// Guards on, or all that can be turned off turned off.
    #[must_use]
    pub fn guarded(mut self, on: bool) -> Self {
        if !on {
            self.feel = unguarded(&self.feel);
        }
        self
    }

    /// The servo that it describes.
    pub fn servo(&self) -> Servo {
        let setup = ServoSetup {
            bone: Arc::clone(&self.scene.bone),
            tools: self.scene.tools.clone(),
            bone_from_base: self.scene.bone_from_base,
            bone_from_plan: self.scene.bone_from_base,
            device: self.scale,
            force_limit_n: FORCE_LIMIT_N,
            feel: self.feel,
        };
        Servo::new(setup).expect("tools")
    }
}

/// The same feel without what keeps the loop passive: damping, passivity controller, slew, heat.
pub fn unguarded(feel: &Feel) -> Feel {
    let mut bare = *feel;
    bare.guard.damping_n_s_per_mm = 0.0;
    bare.guard.passivity_n_s_per_mm = 0.0;
    bare.guard.rise_n_per_ms = FORCE_LIMIT_N;
    bare.guard.continuous_n = FORCE_LIMIT_N;
    bare
}
