//! The reference that methods are held against: a ray-march in `f64` on the CPU, through the fields as
//! the servo reads them. It shares no line with the shaders.
#![expect(
    clippy::cast_possible_truncation,
    reason = "compared with a picture of f32"
)]

use super::compare::Surfaces;
use crate::camera::Camera;
use crate::render::View;
use glam::{DVec2, DVec3};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::sample::Sampler;
use std::thread;

/// Shortest step, voxels.
const SHORTEST: f64 = 0.05;
/// Share of the distance to the surface that a step takes: interpolated distances are a little too
/// long beside edges.
const CAUTION: f64 = 0.7;
/// Halvings of the last step.
const HALVINGS: u32 = 24;

/// A reference of one view.
#[derive(Debug)]
pub struct Reference {
    /// Samples along each edge of a pixel.
    pub samples: u32,
    /// Share of each pixel's samples that show bone.
    pub coverage: Vec<f32>,
    /// Mean depth and normal of the pixels all of whose samples show one surface; 0 elsewhere.
    pub surfaces: Surfaces,
}

/// Marches `samples`² rays a pixel.
pub(crate) fn march(bone: &Bone, cut: &Cut, view: &View, samples: u32) -> Reference {
    let size = view.size;
    let rays = Rays::new(bone, cut, view, samples);
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let rows: Vec<u32> = (0..size[1]).collect();
    let share = rows.len().div_ceil(threads).max(1);
    let pixels: Vec<(f32, f32, [f32; 3])> = thread::scope(|scope| {
        let parts: Vec<_> = rows
            .chunks(share)
            .map(|part| {
                let rays = &rays;
                let work = move || {
                    let of_row = |&y: &u32| (0..size[0]).map(move |x| rays.pixel(x, y));
                    part.iter().flat_map(of_row).collect::<Vec<_>>()
                };
                // a failed start is done here instead
                thread::Builder::new().spawn_scoped(scope, work)
            })
            .collect();
        let joined = parts.into_iter().filter_map(Result::ok);
        joined.filter_map(|p| p.join().ok()).flatten().collect()
    });
    Reference {
        samples,
        coverage: pixels.iter().map(|p| p.0).collect(),
        surfaces: Surfaces {
            size,
            distances: pixels.iter().map(|p| p.1).collect(),
            normals: pixels.iter().map(|p| p.2).collect(),
        },
    }
}

struct Rays<'a> {
    sampler: Sampler<'a>,
    camera: Camera,
    size: [u32; 2],
    samples: u32,
    lo: DVec3,
    hi: DVec3,
    shortest: f64,
}

impl<'a> Rays<'a> {
    fn new(bone: &'a Bone, cut: &'a Cut, view: &View, samples: u32) -> Self {
        let (lo, hi) = bone.bounds();
        let spacing = bone.grid().spacing_mm;
        Self {
            sampler: Sampler::new(bone, cut),
            camera: view.camera,
            size: view.size,
            samples: samples.max(1),
            lo: lo - spacing,
            hi: hi + spacing,
            shortest: SHORTEST * spacing.min_element(),
        }
    }

    /// Share of the samples that show bone; distance and normal where all of them show one surface.
    fn pixel(&self, x: u32, y: u32) -> (f32, f32, [f32; 3]) {
        let n = self.samples;
        let mut hits = Vec::with_capacity((n * n) as usize);
        for s in 0..n * n {
            let within = DVec2::new(f64::from(s % n), f64::from(s / n));
            let at = DVec2::new(f64::from(x), f64::from(y)) + (within + 0.5) / f64::from(n);
            hits.extend(self.hit(at));
        }
        let all = (n * n) as usize;
        let share = hits.len() as f32 / all as f32;
        let depths = hits.iter().map(|h| h.0);
        let (lo, hi) = depths.fold((f64::INFINITY, 0.0f64), |(lo, hi), t| {
            (lo.min(t), hi.max(t))
        });
        if hits.len() < all || hi - lo > 1.0 {
            return (share, 0.0, [0.0; 3]);
        }
        let mean = hits.iter().map(|h| h.0).sum::<f64>() / all as f64;
        let normal: DVec3 = hits.iter().map(|h| h.1).sum();
        let normal = normal.try_normalize().unwrap_or(DVec3::ZERO);
        (share, mean as f32, normal.as_vec3().to_array())
    }

    /// Distance and normal where the ray through a place of the picture (pixels) meets bone.
    fn hit(&self, at: DVec2) -> Option<(f64, DVec3)> {
        let axes = self.camera.axes();
        let [w, h] = self.size.map(f64::from);
        let half = Camera::half_extent(w / h);
        let across = axes.right * (half.x * (2.0 * at.x / w - 1.0));
        let up = axes.up * (half.y * (1.0 - 2.0 * at.y / h));
        let direction = (axes.forward + across + up).try_normalize()?;
        let a = (self.lo - axes.eye) / direction;
        let b = (self.hi - axes.eye) / direction;
        let enter = a.min(b).max_element().max(0.0);
        let leave = a.max(b).min_element();
        let depth = |t: f64| f64::from(self.sampler.depth(axes.eye + direction * t));
        let mut t = enter;
        let mut before = enter;
        while t < leave {
            let d = depth(t);
            if d > 0.0 {
                let (mut outside, mut inside) = (before, t);
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (outside + inside);
                    if depth(middle) > 0.0 {
                        inside = middle;
                    } else {
                        outside = middle;
                    }
                }
                let gradient = self.sampler.fields(axes.eye + direction * inside).gradient;
                let normal = (-gradient.as_dvec3())
                    .try_normalize()
                    .unwrap_or(DVec3::ZERO);
                return Some((inside, normal));
            }
            before = t;
            t += (-d * CAUTION).max(self.shortest);
        }
        None
    }
}

impl Reference {
    /// The difference of a method's picture: its silhouette is the sum over pixels of how much bone it
    /// shows too much or too little.
    pub fn difference(&self, picture: &Surfaces, voxel_mm: f64) -> super::Difference {
        let mut difference = self.surfaces.difference(picture, voxel_mm);
        let shown = picture
            .distances
            .iter()
            .map(|&d| if d > 0.0 { 1.0 } else { 0.0 });
        let off = shown
            .zip(&self.coverage)
            .map(|(shown, &c): (f64, _)| (shown - f64::from(c)).abs());
        difference.silhouette_px = off.sum();
        difference.covered_px = self.coverage.iter().filter(|&&c| c >= 0.5).count();
        difference
    }
}
