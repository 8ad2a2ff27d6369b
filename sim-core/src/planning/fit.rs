//! Least-squares planes, spheres and cylinders through points.

use glam::{DMat3, DVec3};

/// Most steps of a Gauss–Newton search.
const STEPS: usize = 50;
/// A search ends where its step is shorter than this, mm or mm/mm.
const STEP_END: f64 = 1e-12;

/// A plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// The points' centroid.
    pub centre: DVec3,
    /// Unit normal; its sign is arbitrary.
    pub normal: DVec3,
    /// Root mean square distance of the points, mm.
    pub rms_mm: f64,
}

/// A sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub centre: DVec3,
    /// Radius, mm.
    pub radius_mm: f64,
    /// Root mean square distance of the points from its surface, mm.
    pub rms_mm: f64,
}

/// An endless cylinder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    /// A point on its axis: the one nearest to the points' centroid.
    pub centre: DVec3,
    /// Unit direction of its axis, on the side of the guess.
    pub axis: DVec3,
    /// Radius, mm.
    pub radius_mm: f64,
    /// Root mean square distance of the points from its surface, mm.
    pub rms_mm: f64,
}

fn centroid(points: &[DVec3]) -> DVec3 {
    points.iter().sum::<DVec3>() / points.len() as f64
}

fn rms(residuals: impl Iterator<Item = f64>, count: usize) -> f64 {
    (residuals.map(|r| r * r).sum::<f64>() / count as f64).sqrt()
}

/// The plane of least squares; `None` for fewer than three points or points on a line.
pub fn plane(points: &[DVec3]) -> Option<Plane> {
    if points.len() < 3 {
        return None;
    }
    let centre = centroid(points);
    let spread = points.iter().fold(DMat3::ZERO, |sum, p| {
        let d = *p - centre;
        sum + DMat3::from_cols(d * d.x, d * d.y, d * d.z)
    });
    let (values, vectors) = eigen(spread);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    // two small spreads: a line, whose plane is undetermined
    if values[order[1]] <= 1e-9 * values[order[2]] || !values[order[2]].is_finite() {
        return None;
    }
    let normal = vectors.col(order[0]);
    Some(Plane {
        centre,
        normal,
        rms_mm: rms(
            points.iter().map(|p| (*p - centre).dot(normal)),
            points.len(),
        ),
    })
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix, by Jacobi rotations (Golub & Van Loan,
/// *Matrix Computations*, 8.5).
fn eigen(mut a: DMat3) -> ([f64; 3], DMat3) {
    let mut vectors = DMat3::IDENTITY;
    for _ in 0..STEPS {
        let off = a.x_axis.y.abs() + a.x_axis.z.abs() + a.y_axis.z.abs();
        let scale = a.x_axis.x.abs() + a.y_axis.y.abs() + a.z_axis.z.abs();
        if off <= 1e-15 * scale || !off.is_finite() {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let apq = a.col(p)[q];
            if apq == 0.0 {
                continue;
            }
            let theta = (a.col(q)[q] - a.col(p)[p]) / (2.0 * apq);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let t = if theta == 0.0 { 1.0 } else { t };
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = c;
            turn.col_mut(q)[q] = c;
            turn.col_mut(q)[p] = s;
            turn.col_mut(p)[q] = -s;
            a = turn.transpose() * a * turn;
            vectors *= turn;
        }
    }
    ([a.x_axis.x, a.y_axis.y, a.z_axis.z], vectors)
}

/// Solves `m x = b` by elimination with pivots; `None` where `m` is singular.
fn solve<const N: usize>(mut m: [[f64; N]; N], mut b: [f64; N]) -> Option<[f64; N]> {
    let largest = m.iter().flatten().fold(0.0_f64, |a, v| a.max(v.abs()));
    for k in 0..N {
        let pivot = (k..N).max_by(|&p, &q| m[p][k].abs().total_cmp(&m[q][k].abs()))?;
        m.swap(k, pivot);
        b.swap(k, pivot);
        if m[k][k].abs() <= 1e-14 * largest || !largest.is_finite() {
            return None;
        }
        for row in k + 1..N {
            let f = m[row][k] / m[k][k];
            let above = m[k];
            for (v, above) in m[row].iter_mut().zip(above).skip(k) {
                *v -= f * above;
            }
            b[row] -= f * b[k];
        }
    }
    let mut x = [0.0; N];
    for k in (0..N).rev() {
        let rest: f64 = (k + 1..N).map(|c| m[k][c] * x[c]).sum();
        x[k] = (b[k] - rest) / m[k][k];
    }
    Some(x)
}

/// One Gauss–Newton step for residuals with their derivatives.
fn step<const N: usize>(rows: impl Iterator<Item = (f64, [f64; N])>) -> Option<[f64; N]> {
    let (mut m, mut b) = ([[0.0; N]; N], [0.0; N]);
    for (residual, derivative) in rows {
        for i in 0..N {
            b[i] -= derivative[i] * residual;
            for j in 0..N {
                m[i][j] += derivative[i] * derivative[j];
            }
        }
    }
    solve(m, b)
}

/// The sphere of least squared distances: the algebraic fit, then Gauss–Newton on the true distances.
/// `None` for fewer than four points or points in a plane.
pub fn sphere(points: &[DVec3]) -> Option<Sphere> {
    if points.len() < 4 {
        return None;
    }
    let origin = centroid(points);
    // |p|² = 2 c·p + k
    let algebraic = points.iter().map(|p| {
        let d = *p - origin;
        (-d.length_squared(), [2.0 * d.x, 2.0 * d.y, 2.0 * d.z, 1.0])
    });
    let [x, y, z, k] = step(algebraic)?;
    let mut centre = DVec3::new(x, y, z);
    let mut radius = (k + centre.length_squared()).max(0.0).sqrt();
    for _ in 0..STEPS {
        let rows = points.iter().map(|p| {
            let d = *p - origin - centre;
            let length = d.length().max(1e-9);
            (
                length - radius,
                [-d.x / length, -d.y / length, -d.z / length, -1.0],
            )
        });
        let [dx, dy, dz, dr] = step(rows)?;
        let moved = DVec3::new(dx, dy, dz);
        centre += moved;
        radius += dr;
        if moved.length() + dr.abs() < STEP_END * (1.0 + radius) {
            break;
        }
    }
    let residuals = points
        .iter()
        .map(|p| (*p - origin - centre).length() - radius);
    let sphere = Sphere {
        centre: origin + centre,
        radius_mm: radius,
        rms_mm: rms(residuals, points.len()),
    };
    (radius.is_finite() && radius > 0.0 && sphere.centre.is_finite()).then_some(sphere)
}

/// The cylinder of least squared distances about an axis near `guess` (Gauss–Newton on shift, tilt and
/// radius). `None` for fewer than six points, or where the search does not end.
pub fn cylinder(points: &[DVec3], guess: DVec3) -> Option<Cylinder> {
    if points.len() < 6 {
        return None;
    }
    let middle = centroid(points);
    let mut axis = guess.try_normalize()?;
    let mut centre = middle;
    let mut radius = rms(
        points
            .iter()
            .map(|p| (*p - middle).reject_from_normalized(axis).length()),
        points.len(),
    );
    for _ in 0..STEPS {
        let (u, v) = axis.any_orthonormal_pair();
        let rows = points.iter().map(|p| {
            let d = *p - centre;
            let along = d.dot(axis);
            let radial = d - axis * along;
            let length = radial.length().max(1e-9);
            let n = radial / length;
            let (nu, nv) = (n.dot(u), n.dot(v));
            (length - radius, [-nu, -nv, -nu * along, -nv * along, -1.0])
        });
        let [du, dv, tu, tv, dr] = step(rows)?;
        centre += u * du + v * dv;
        axis = (axis + u * tu + v * tv).try_normalize()?;
        radius += dr;
        if du.abs() + dv.abs() + tu.abs() + tv.abs() + dr.abs() < STEP_END * (1.0 + radius) {
            break;
        }
    }
    let residual = |p: &DVec3| (*p - centre).reject_from_normalized(axis).length() - radius;
    let found = Cylinder {
        centre: centre + axis * (middle - centre).dot(axis),
        axis,
        radius_mm: radius,
        rms_mm: rms(points.iter().map(residual), points.len()),
    };
    (radius > 0.0 && radius.is_finite() && found.centre.is_finite()).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on a golden spiral: even, and free of symmetry.
    fn spiral(count: u32) -> impl Iterator<Item = (f64, f64)> {
        (0..count).map(move |n| {
            (
                (f64::from(n) + 0.5) / f64::from(count),
                2.399_963 * f64::from(n),
            )
        })
    }

    #[test]
    fn a_planted_plane_is_found_and_a_line_refused() {
        let normal = DVec3::new(2.0, -1.0, 2.0) / 3.0;
        let (u, v) = normal.any_orthonormal_pair();
        let points: Vec<DVec3> = spiral(50)
            .map(|(r, a)| {
                DVec3::new(5.0, 6.0, 7.0) + 12.0 * r * (u * libm::cos(a) + v * libm::sin(a))
            })
            .collect();
        let found = plane(&points).expect("a plane");
        assert!(found.normal.dot(normal).abs() > 1.0 - 1e-12 && found.rms_mm < 1e-9);
        let line: Vec<DVec3> = (0..9).map(|n| DVec3::ONE * f64::from(n)).collect();
        assert_eq!(plane(&line), None);
    }

    #[test]
    fn a_planted_cap_of_a_sphere_is_found() {
        let centre = DVec3::new(-3.0, 4.0, 40.0);
        let points: Vec<DVec3> = spiral(200)
            .map(|(r, a)| {
                let z = 1.0 - 0.15 * r;
                let s = (1.0 - z * z).sqrt();
                centre + 34.0 * DVec3::new(s * libm::cos(a), s * libm::sin(a), -z)
            })
            .collect();
        let found = sphere(&points).expect("a sphere");
        assert!(found.centre.distance(centre) < 1e-8 && (found.radius_mm - 34.0).abs() < 1e-8);
        let flat: Vec<DVec3> = points.iter().map(|p| DVec3::new(p.x, p.y, 0.0)).collect();
        assert_eq!(sphere(&flat), None);
    }

    #[test]
    fn a_planted_cylinder_is_found_from_a_guess_12_degrees_off() {
        let axis = DVec3::new(0.3, -0.2, 0.9).try_normalize().expect("an axis");
        let (u, v) = axis.any_orthonormal_pair();
        let on = DVec3::new(1.0, 2.0, 3.0);
        // three quarters of the way round only
        let points: Vec<DVec3> = spiral(300)
            .map(|(r, a)| {
                let a = (a % core::f64::consts::TAU) * 0.75;
                on + axis * (14.0 * r) + 4.0 * (u * libm::cos(a) + v * libm::sin(a))
            })
            .collect();
        let guess = (axis + u * 0.2).try_normalize().expect("an axis");
        let found = cylinder(&points, guess).expect("a cylinder");
        assert!(found.axis.dot(axis) > 1.0 - 1e-12);
        assert!((found.centre - on).reject_from_normalized(axis).length() < 1e-8);
        assert!((found.radius_mm - 4.0).abs() < 1e-8 && found.rms_mm < 1e-8);
    }
}
