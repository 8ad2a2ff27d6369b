//! How far two pictures of surfaces differ.

/// What the surface buffers hold, pixel by pixel from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Surfaces {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Distance from the eye, mm; 0 where there is nothing.
    pub distances: Vec<f32>,
    /// Outward normals, bone frame, unit; zero where there is nothing.
    pub normals: Vec<[f32; 3]>,
}

/// Two pictures' difference.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Difference {
    /// Pixels that show bone in the first.
    pub covered_px: usize,
    /// Pixels that show bone in one of the two only.
    pub silhouette_px: f64,
    /// Root mean square of the depths' difference where both show bone and neither is at an edge, mm.
    pub depth_rms_mm: f64,
    /// The difference that 99 of 100 such pixels do not exceed, mm.
    pub depth_p99_mm: f64,
    /// Root mean square of the angle between the normals there, degrees.
    pub normal_rms_deg: f64,
    /// Pixels that count for the depth.
    pub inner_px: usize,
}

/// Depths of neighbouring pixels that differ by more than this belong to different surfaces, mm.
const EDGE_MM: f32 = 2.0;

impl Surfaces {
    /// Whether a pixel shows bone and all eight around it show the same surface.
    fn is_inner(&self, x: u32, y: u32) -> bool {
        let [w, h] = self.size;
        if x == 0 || y == 0 || x + 1 >= w || y + 1 >= h {
            return false;
        }
        let at = |x: u32, y: u32| self.distances[(y * w + x) as usize];
        let own = at(x, y);
        own > 0.0
            && (y - 1..=y + 1).all(|j| {
                (x - 1..=x + 1).all(|i| {
                    let other = at(i, j);
                    other > 0.0 && (other - own).abs() < EDGE_MM
                })
            })
    }

    /// Pixels that show bone.
    pub fn covered(&self) -> usize {
        self.distances.iter().filter(|&&d| d > 0.0).count()
    }

    /// The difference to another picture of the same size and view. `voxel_mm` > 0 also leaves out pixels
    /// whose depths differ by more than five voxels: there one of the two sees past an edge that the
    /// other still shows.
    pub fn difference(&self, other: &Self, voxel_mm: f64) -> Difference {
        let [w, h] = self.size;
        let mut depths = Vec::new();
        let mut angle_squares = 0.0;
        let mut silhouette = 0usize;
        for y in 0..h {
            for x in 0..w {
                let at = (y * w + x) as usize;
                let (a, b) = (self.distances[at], other.distances[at]);
                if (a > 0.0) != (b > 0.0) {
                    silhouette += 1;
                }
                if !(self.is_inner(x, y) && other.is_inner(x, y)) {
                    continue;
                }
                let depth = f64::from(a - b);
                if voxel_mm > 0.0 && depth.abs() > 5.0 * voxel_mm {
                    continue;
                }
                depths.push(depth.abs());
                angle_squares += angle_deg(self.normals[at], other.normals[at]).powi(2);
            }
        }
        depths.sort_by(f64::total_cmp);
        let count = depths.len().max(1) as f64;
        let square: f64 = depths.iter().map(|d| d * d).sum();
        let rank = depths.len() * 99 / 100;
        Difference {
            covered_px: self.covered(),
            silhouette_px: silhouette as f64,
            depth_rms_mm: (square / count).sqrt(),
            depth_p99_mm: depths.get(rank).copied().unwrap_or(0.0),
            normal_rms_deg: (angle_squares / count).sqrt(),
            inner_px: depths.len(),
        }
    }
}

/// Angle between two directions, degrees; 0 where one is missing.
fn angle_deg(a: [f32; 3], b: [f32; 3]) -> f64 {
    let (a, b) = (
        glam::Vec3::from(a).as_dvec3(),
        glam::Vec3::from(b).as_dvec3(),
    );
    if a.length_squared() < 0.25 || b.length_squared() < 0.25 {
        return 0.0;
    }
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// A half float's value.
pub(crate) fn widen(half: u16) -> f32 {
    let magnitude = u32::from(half & 0x7fff);
    // subnormal halves are below what a normal's component can mean
    let value = if magnitude < 0x0400 {
        0.0
    } else {
        f32::from_bits((magnitude << 13) + 0x3800_0000)
    };
    if half & 0x8000 == 0 { value } else { -value }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(distance: f32, normal: [f32; 3]) -> Surfaces {
        Surfaces {
            size: [10, 10],
            distances: vec![distance; 100],
            normals: vec![normal; 100],
        }
    }

    #[test]
    fn planted_differences_are_found() {
        let (sin, cos) = 10.0f32.to_radians().sin_cos();
        let a = flat(100.0, [0.0, 0.0, 1.0]);
        let mut b = flat(100.25, [sin, 0.0, cos]);
        b.distances[5] = 0.0;
        let d = a.difference(&b, 0.0);
        assert_eq!((d.covered_px, d.inner_px), (100, 61), "{d:?}");
        assert!((d.silhouette_px - 1.0).abs() < 1e-12);
        assert!((d.depth_rms_mm - 0.25).abs() < 1e-6 && (d.depth_p99_mm - 0.25).abs() < 1e-6);
        assert!((d.normal_rms_deg - 10.0).abs() < 1e-3);
        let same = a.difference(&a, 0.0);
        assert!(same.silhouette_px + same.depth_rms_mm + same.normal_rms_deg < 1e-12);
    }

    #[test]
    fn halves_widen_to_their_value() {
        for (half, value) in [(0x3c00, 1.0), (0xbc00, -1.0), (0x3555, 0.333_25), (0, 0.0)] {
            assert!((widen(half) - value).abs() < 1e-5, "{half:x}");
        }
    }
}
