//! Which squares of the picture can show bone.
//!
//! A software renderer runs a fragment's whole shader for every pixel that it is given, found or
//! not: it has no cheap way out for the background. So rays are sent only where the box of some
//! brick is projected. Conservative: a square without bone is harmless, a missing one would be a
//! hole.

use crate::camera::{Axes, Camera};
use glam::{DVec2, DVec3};

/// Edge of a square, pixels.
pub(crate) const EDGE: u32 = 16;

/// The squares of one picture.
#[derive(Debug, Default)]
pub(crate) struct Tiles {
    marked: Vec<bool>,
    // x in the low half, y in the high half; units of squares from the top left
    list: Vec<u32>,
}

/// A picture's geometry as the projection needs it.
struct Screen {
    axes: Axes,
    // half extent of the picture at unit depth
    half: DVec2,
    // squares along each axis, as a float, for half the picture's extent
    squares: DVec2,
    count: [u32; 2],
}

impl Tiles {
    /// Marks the squares that balls (middle and radius, mm) can touch, in a picture of `size` pixels, and returns them packed (x in the low 16 bits, y above).
    pub(crate) fn cover(
        &mut self,
        camera: &Camera,
        size: [u32; 2],
        balls: impl Iterator<Item = (DVec3, f64)>,
    ) -> &[u32] {
        let [width, height] = size.map(f64::from);
        let screen = Screen {
            axes: camera.axes(),
            half: Camera::half_extent(width / height.max(1.0)),
            squares: DVec2::new(width, height) / (2.0 * f64::from(EDGE)),
            count: size.map(|n| n.div_ceil(EDGE)),
        };
        let [nx, ny] = screen.count;
        self.list.clear();
        self.marked.clear();
        self.marked.resize((nx * ny) as usize, false);
        for (centre, radius) in balls {
            let Some([x, y]) = screen.span(centre, radius) else {
                continue;
            };
            for j in y.0..y.1 {
                for i in x.0..x.1 {
                    let seen = &mut self.marked[(j * nx + i) as usize];
                    if !core::mem::replace(seen, true) {
                        self.list.push(i | j << 16);
                    }
                }
            }
        }
        &self.list
    }
}

impl Screen {
    /// Half-open spans of squares, along x and y, of the box around a ball; `None` behind the eye.
    fn span(&self, centre: DVec3, radius: f64) -> Option<[(u32, u32); 2]> {
        let d = centre - self.axes.eye;
        let depth = d.dot(self.axes.forward);
        if depth + radius <= 0.0 {
            return None;
        }
        let across = DVec2::new(d.dot(self.axes.right), -d.dot(self.axes.up));
        let near = depth - radius;
        Some(core::array::from_fn(|a| {
            if near <= 1e-3 {
                return (0, self.count[a]);
            }
            let far = depth + radius;
            let (lo, hi) = (across[a] - radius, across[a] + radius);
            // the nearer face widens what lies outward, the farther one what lies inward
            let lo = if lo < 0.0 { lo / near } else { lo / far };
            let hi = if hi > 0.0 { hi / near } else { hi / far };
            let square = |v: f64| (v / self.half[a] + 1.0) * self.squares[a];
            let most = f64::from(self.count[a]);
            let whole = |v: f64| bounded(v, most);
            (whole(square(lo).floor()), whole(square(hi).floor() + 1.0))
        }))
    }
}

/// A count from a float: clamped to 0..=`most`, which is below 2³².
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the squares of a picture before the cast"
)]
fn bounded(value: f64, most: f64) -> u32 {
    value.clamp(0.0, most) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use osteon_sim_core::pose::Pose;

    #[test]
    fn every_point_of_a_ball_falls_into_a_marked_square() {
        let plan = Pose::from_origin_and_z(DVec3::new(40.0, 30.0, 20.0), DVec3::X);
        let size = [333, 250];
        let aspect = 333.0 / 250.0;
        let mut tiles = Tiles::default();
        for step in 0..200u32 {
            let t = f64::from(step);
            let mut camera = Camera::at_plan(&plan, DVec3::Z);
            camera.orbit(DVec2::new(0.037 * t, 0.4 * (0.31 * t).sin()));
            camera.zoom(f64::from(step % 23));
            let centre = DVec3::new(
                40.0 + 30.0 * (0.7 * t).sin(),
                30.0,
                20.0 + 25.0 * (1.1 * t).cos(),
            );
            let radius = 2.0 + f64::from(step % 7);
            let list = tiles
                .cover(&camera, size, [(centre, radius)].into_iter())
                .to_vec();
            let clip = camera.clip_from_bone(aspect).as_dmat4();
            for n in 0..500u32 {
                let (u, v) = (f64::from(n) * 0.618_034, f64::from(n) / 500.0 * 2.0 - 1.0);
                let (sin, cos) = (u * std::f64::consts::TAU).sin_cos();
                let ring = (1.0 - v * v).sqrt();
                let p = centre + radius * DVec3::new(ring * cos, ring * sin, v);
                let c = clip * p.extend(1.0);
                let ndc = DVec2::new(c.x, c.y) / c.w;
                if c.w <= 0.0 || ndc.abs().max_element() >= 1.0 {
                    continue;
                }
                let px = DVec2::new((ndc.x + 1.0) * 166.5, (1.0 - ndc.y) * 125.0);
                let at = px.as_uvec2() / EDGE;
                assert!(
                    list.contains(&(at.x | at.y << 16)),
                    "step {step} point {p} square {at}"
                );
            }
        }
    }

    #[test]
    fn a_ball_far_to_the_side_or_behind_marks_nothing_and_one_around_the_eye_all() {
        let camera = Camera::at_plan(&Pose::IDENTITY, DVec3::Y);
        let axes = camera.axes();
        let mut tiles = Tiles::default();
        let mut count =
            |p: DVec3, r: f64| tiles.cover(&camera, [160, 160], [(p, r)].into_iter()).len();
        assert_eq!(count(axes.right * 1000.0, 5.0), 0);
        assert_eq!(count(axes.eye - axes.forward * 50.0, 5.0), 0);
        assert_eq!(count(axes.eye, 5.0), 100);
        assert!((1..10).contains(&count(DVec3::ZERO, 5.0)));
    }
}
