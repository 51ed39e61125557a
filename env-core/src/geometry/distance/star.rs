//! Distance to a star-shaped solid.
//!
//! The surface is F(x) = √(xᵀAx) − 1 − S(x/|x|) = 0 with A = diag(1/eᵢ²) and S the sum of waves and
//! bumps. The search starts from the nearest facet of a triangulation; Newton's method on the
//! surface then finds the nearest point of the smooth surface. The tangential Hessian of ½|x − p|²
//! there is I + λ ∇²F with λ = (p − x)·∇F / |∇F|².
//!
//! Accuracy: to rounding wherever the nearest point is unique by more than twice the facets' sag
//! (0.1 % of the radius for smooth blobs). Closer to the medial axis the result may be the other of
//! two almost equal minima, and the distance is off by at most that sag.

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Point3, Vector3};

use super::Distance;
use crate::geometry::{StarShaped, Surface, star_shaped::Modulation};

/// Facet edges round a great circle.
const SEGMENTS: u32 = 80;
/// Newton steps; 2 to 4 are usual.
const MOST_STEPS: usize = 30;

impl StarShaped {
    pub(in crate::geometry) fn distance(&self, point: &Point3<f64>) -> Distance {
        let p = point.coords;
        let coarse = self.facets().distance(point);
        let mut x = self.onto_surface(&(p - coarse.value * coarse.normal));
        for _ in 0..MOST_STEPS {
            let step = self.newton_step(&x, &p);
            let next = self.shortened(&x, &step, &p);
            let moved = (next - x).norm();
            x = next;
            if moved <= 1e-12 * x.norm() {
                break;
            }
        }
        let normal = self.slope(&x).0.normalize();
        let inside = p.norm() < self.radius(&p.try_normalize(0.0).unwrap_or(Vector3::z()));
        let value = (p - x).norm() * if inside { -1.0 } else { 1.0 };
        Distance { value, normal }
    }

    /// Triangulation from which searches start, built on first use.
    pub(super) fn facets(&self) -> &Surface {
        self.facets.get_or_init(|| Surface::radial(SEGMENTS, |d| self.radius(d)))
    }

    /// F and its derivative along `direction` at `x`.
    pub(super) fn implicit(&self, x: &Vector3<f64>, direction: &Vector3<f64>) -> (f64, f64) {
        let height = self.relative_height(&x.normalize());
        let level = x.component_div(self.semi_axes()).norm() - 1.0 - height;
        (level, self.slope(x).0.dot(direction))
    }

    /// The surface point on the ray from the origin through `x`.
    pub(super) fn onto_surface(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let direction = x.try_normalize(0.0).unwrap_or(Vector3::z());
        self.radius(&direction) * direction
    }

    /// Tangential step towards the surface point nearest to `p`: Newton's where the Hessian is
    /// positive definite, along the gradient where it is not.
    fn newton_step(&self, x: &Vector3<f64>, p: &Vector3<f64>) -> Vector3<f64> {
        let (slope, curvature) = self.slope(x);
        let normal = slope.normalize();
        let first = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
        let tangents = Matrix3x2::from_columns(&[first, normal.cross(&first)]);
        let offset = p - x;
        let gradient = tangents.transpose() * offset;
        let lambda = offset.dot(&slope) / slope.norm_squared();
        let hessian = Matrix2::identity() + lambda * tangents.transpose() * curvature * tangents;
        let definite = hessian[(0, 0)] > 0.0 && hessian.determinant() > 0.0;
        let inverse = hessian.try_inverse().filter(|_| definite);
        tangents * inverse.map_or(gradient, |inverse| inverse * gradient)
    }

    /// Surface point at the end of `step`, which is halved until it does not lead away from `p`.
    fn shortened(&self, x: &Vector3<f64>, step: &Vector3<f64>, p: &Vector3<f64>) -> Vector3<f64> {
        let before = (p - x).norm_squared();
        let mut share = 1.0;
        while share > 1e-6 {
            let next = self.onto_surface(&(x + share * step));
            if (p - next).norm_squared() <= before {
                return next;
            }
            share *= 0.5;
        }
        *x
    }

    /// ∇F and ∇²F at `x`.
    fn slope(&self, x: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let radius = x.norm();
        let d = x / radius;
        let weights = self.semi_axes().map(|e| 1.0 / (e * e));
        let (weighted, root) =
            (x.component_mul(&weights), x.component_div(self.semi_axes()).norm());
        // Gradient and Hessian of S over unconstrained vectors, then by the chain rule through x ↦
        // x/|x|.
        let Modulation { gradient: g, hessian: h, .. } = self.modulation(&d);
        let across = Matrix3::identity() - d * d.transpose();
        let tangent = across * g;
        let mixed = d * tangent.transpose();
        let second = (across * h * across - g.dot(&d) * across - mixed - mixed.transpose())
            / (radius * radius);
        let quadric = Matrix3::from_diagonal(&weights) / root
            - weighted * weighted.transpose() / root.powi(3);
        (weighted / root - tangent / radius, quadric - second)
    }
}
