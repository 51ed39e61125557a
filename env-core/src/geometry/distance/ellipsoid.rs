//! Distance to an ellipsoid.
//!
//! The nearest point x to p satisfies p − x = t ∇(Σ xᵢ²/eᵢ²)/2, so xᵢ = eᵢ² pᵢ / (t + eᵢ²) and t is
//! the largest root of s(t) = ‖(eᵢ pᵢ / (t + eᵢ²))ᵢ‖ = 1 (Eberly, "Distance from a point to an
//! ellipse, an ellipsoid, or a hyperellipsoid", 2013). The equation solved is 1/s(t) = 1, nearly
//! linear in t, as in the trust-region step of Moré and Sorensen (1983): Newton's method from the
//! left is monotone.

use nalgebra::Vector3;

use super::Distance;

/// Smallest coordinate relative to its semi-axis; smaller ones are raised to it. This keeps p off
/// the planes of symmetry, where the root can merge with a pole, and changes the result by no more
/// than rounding.
const OFF_SYMMETRY: f64 = 1e-15;
/// Newton steps; 3 to 6 are usual, more only next to the focal ellipse.
const MOST_STEPS: usize = 100;

pub(in crate::geometry) fn distance(p: &Vector3<f64>, semi_axes: &Vector3<f64>) -> Distance {
    let signs = p.map(|x| 1f64.copysign(x));
    let p = p.abs().zip_map(semi_axes, |x, e| x.max(OFF_SYMMETRY * e));
    let scaled = p.component_mul(semi_axes);
    // Relative to the pole at −e² of the shortest axis, near which t itself would lose its digits.
    let shortest = semi_axes.min();
    let squares = semi_axes.map(|e| (e - shortest) * (e + shortest));
    let mut from_pole = (scaled - squares).max();
    for _ in 0..MOST_STEPS {
        let shifted = squares.add_scalar(from_pole);
        let terms = scaled.component_div(&shifted);
        let s = terms.norm();
        let slope = terms.component_mul(&terms).component_div(&shifted).sum();
        let step = (s - 1.0) * s * s / slope;
        from_pole += step;
        if step.abs() <= 1e-15 * shifted.min() {
            break;
        }
    }
    // p − x = t x/e², which keeps its digits and its sign next to the surface.
    let gradient = p.component_div(&squares.add_scalar(from_pole));
    let length = gradient.norm();
    Distance {
        value: (from_pole - shortest * shortest) * length,
        normal: gradient.component_mul(&signs) / length,
    }
}
