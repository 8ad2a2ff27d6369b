//! Seeded numbers, poses, tools and places on them.

use glam::{DQuat, DVec3, Vec3};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::revolved::{Face, Form, Part, Revolved};
use osteon_sim_core::tool::{STEEL, Shape, Tool};

/// Numbers from a seed: splitmix64.
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In `0..n`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    pub fn within(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Each component within ± `half`.
    pub fn vector(&mut self, half: f64) -> DVec3 {
        DVec3::from_array([(); 3].map(|()| self.within(-half, half)))
    }

    /// A unit vector.
    pub fn direction(&mut self) -> DVec3 {
        loop {
            let v = self.vector(1.0);
            if (0.01..1.0).contains(&v.length_squared()) {
                return v / v.length();
            }
        }
    }

    pub fn rotation(&mut self) -> DQuat {
        let axis = self.direction();
        DQuat::from_axis_angle(axis, self.within(0.0, std::f64::consts::TAU))
    }
}

/// A tool of faces, for carving alone.
pub fn tool_of(solid: Revolved) -> Tool {
    Tool {
        name: "test".to_owned(),
        id: "test".to_owned(),
        shape: Shape::Revolved(solid),
        elements: Vec::new(),
        facets: Vec::new(),
        rpm: 1000.0,
        lips: 2,
        stall_nmm: None,
        colour: STEEL,
    }
}

fn random_part(random: &mut Random, size: f64) -> Part {
    let mm = |v: f64| (size * v) as f32;
    let foot = random.within(-0.3, 0.3);
    let plane = |at: f64, up: bool| Form::Plane {
        height_mm: mm(at),
        up,
    };
    let (low, high) = (plane(foot, false), plane(foot + 0.8, true));
    let wide = random.within(0.5, 1.0);
    let half_angle = random.within(20.0, 80.0) as f32;
    let ball = Form::Ball {
        radius_mm: mm(wide),
        centre_mm: mm(foot + wide),
    };
    let ring = Form::Ring {
        disc_mm: mm(random.within(0.0, 0.5)),
        centre_mm: mm(foot + 0.5),
        radius_mm: mm(random.within(0.2, 0.5)),
    };
    let side = Form::cylinder(mm(random.within(0.3, 1.0)));
    let forms = match random.below(7) {
        0 => vec![ball],
        1 => vec![Form::cone(mm(foot), half_angle, true), side, high],
        2 => vec![ball, side, high],
        3 => vec![ring],
        4 => vec![side, low, high],
        5 => vec![
            Form::cone(mm(foot), half_angle, true),
            Form::cone(mm(foot + 0.9), half_angle, false),
        ],
        _ => vec![ring, high, Form::cone(mm(foot), half_angle, true)],
    };
    let face = |form| Face {
        form,
        cutting: true,
    };
    Part {
        faces: forms.into_iter().map(face).collect(),
    }
}

/// A union of 1 to 4 parts of all kinds of faces, about `size` mm in radius.
pub fn random_solid(random: &mut Random, size: f64) -> Revolved {
    loop {
        let count = 1 + random.below(4);
        let parts = (0..count).map(|_| random_part(random, size)).collect();
        if let Ok(solid) = Revolved::new(parts) {
            return solid;
        }
    }
}

/// A point on the surface of a shape, tool frame.
pub fn on_surface(random: &mut Random, shape: &Shape) -> DVec3 {
    let bounds = shape.bounds();
    let far = 4.0 * bounds.lo.abs().max(bounds.hi.abs()).length();
    let sd = |p: DVec3| shape.signed_distance(p.as_vec3());
    loop {
        let z = random.within(bounds.lo.z, bounds.hi.z);
        let mut inside = DVec3::new(0.0, 0.0, z);
        if sd(inside) < 0.0 {
            let mut outside = inside + random.direction() * far;
            for _ in 0..50 {
                let middle = 0.5 * (inside + outside);
                if sd(middle) < 0.0 {
                    inside = middle;
                } else {
                    outside = middle;
                }
            }
            return inside;
        }
    }
}

/// A random pose that brings a point of the shape's surface to `place`.
pub fn touching(random: &mut Random, shape: &Shape, place: DVec3) -> Pose {
    let p = on_surface(random, shape);
    let rotation = random.rotation();
    Pose::new(rotation, place - rotation * p)
}

/// Signed distance of faces with their growth, mm, all in `f64`; of any other tool its own.
pub fn grown_distance(shape: &Shape, mean_square: f64, p: DVec3) -> f64 {
    let Shape::Revolved(solid) = shape else {
        let p: Vec3 = p.as_vec3();
        return f64::from(shape.signed_distance(p));
    };
    let (r, z) = (p.truncate().length(), p.z);
    let of_part = |part: &Part| {
        let of_face =
            |face: &Face| face_distance(face.form, r, z) - face.form.grown_mm(mean_square);
        let faces = part.faces.iter().map(of_face);
        faces.fold(f64::NEG_INFINITY, f64::max)
    };
    solid
        .parts
        .iter()
        .map(of_part)
        .fold(f64::INFINITY, f64::min)
}

/// Signed distance of (r, z) to a face, mm.
pub fn face_distance(form: Form, r: f64, z: f64) -> f64 {
    let wide = |v: f32| f64::from(v);
    match form {
        Form::Plane { height_mm, up } => {
            let above = z - wide(height_mm);
            if up { above } else { -above }
        }
        Form::Cone {
            normal_r,
            normal_z,
            offset_mm,
        } => wide(normal_r) * r + wide(normal_z) * z - wide(offset_mm),
        Form::Ball {
            radius_mm,
            centre_mm,
        } => r.hypot(z - wide(centre_mm)) - wide(radius_mm),
        Form::Ring {
            disc_mm,
            centre_mm,
            radius_mm,
        } => (r - wide(disc_mm)).max(0.0).hypot(z - wide(centre_mm)) - wide(radius_mm),
    }
}
