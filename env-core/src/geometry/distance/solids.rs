//! Solids whose nearest surface point has a closed form.

use nalgebra::{Vector2, Vector3};

use super::{Distance, length_and_direction};

#[inline]
pub(in crate::geometry) fn sphere(p: &Vector3<f64>, radius: f64) -> Distance {
    let (length, normal) = length_and_direction(p, &Vector3::z());
    Distance { value: length - radius, normal }
}

#[inline]
pub(in crate::geometry) fn cuboid(p: &Vector3<f64>, half_extents: &Vector3<f64>) -> Distance {
    let beyond = p.abs() - half_extents;
    let signs = p.map(|x| 1f64.copysign(x));
    let (nearest_face, largest) = beyond.argmax();
    if beyond.iter().filter(|beyond| **beyond > 0.0).count() <= 1 {
        let mut normal = Vector3::zeros();
        normal[nearest_face] = signs[nearest_face];
        return Distance { value: largest, normal };
    }
    let outside = beyond.sup(&Vector3::zeros());
    let (value, direction) = length_and_direction(&outside, &outside);
    Distance { value, normal: direction.component_mul(&signs) }
}

#[inline]
pub(in crate::geometry) fn cylinder(p: &Vector3<f64>, radius: f64, half_height: f64) -> Distance {
    let (from_axis, outward) = radial(p);
    extruded(from_axis - radius, outward, p.z, half_height)
}

pub(in crate::geometry) fn annulus(
    p: &Vector3<f64>,
    outer: f64,
    inner: f64,
    half_height: f64,
) -> Distance {
    let (from_axis, outward) = radial(p);
    if from_axis > f64::midpoint(outer, inner) {
        extruded(from_axis - outer, outward, p.z, half_height)
    } else {
        extruded(inner - from_axis, -outward, p.z, half_height)
    }
}

pub(in crate::geometry) fn capsule(p: &Vector3<f64>, radius: f64, half_height: f64) -> Distance {
    let on_axis = Vector3::z() * p.z.clamp(-half_height, half_height);
    let (length, normal) = length_and_direction(&(p - on_axis), &Vector3::x());
    Distance { value: length - radius, normal }
}

/// Prism over a regular polygon with corners at `radius`, a side facing +x.
pub(in crate::geometry) fn prism(
    p: &Vector3<f64>,
    sides: u32,
    radius: f64,
    half_height: f64,
) -> Distance {
    let sector = std::f64::consts::TAU / f64::from(sides);
    let apothem = radius * (0.5 * sector).cos();
    let half_side = radius * (0.5 * sector).sin();
    // Turned so that the nearest side faces +x.
    let (sin, cos) = ((p.y.atan2(p.x) / sector).round() * sector).sin_cos();
    let turned = Vector2::new(cos * p.x + sin * p.y, cos * p.y - sin * p.x);
    let beyond = Vector2::new(turned.x - apothem, turned.y.abs() - half_side);
    let (value, normal) = if beyond.y <= 0.0 || beyond.x <= 0.0 {
        (beyond.x, Vector2::x())
    } else {
        let length = beyond.norm();
        (length, Vector2::new(beyond.x, beyond.y.copysign(turned.y)) / length)
    };
    let back = Vector3::new(cos * normal.x - sin * normal.y, sin * normal.x + cos * normal.y, 0.0);
    extruded(value, back, p.z, half_height)
}

/// Solid of revolution about z under a `profile` of (radius, z) points, solid on its left, that
/// runs from the axis to the axis.
///
/// The nearest point lies in the half-plane of the axis and the point, so the problem is planar.
#[inline]
pub(in crate::geometry) fn revolved(p: &Vector3<f64>, profile: &[[f64; 2]]) -> Distance {
    let (from_axis, outward) = radial(p);
    let at = Vector2::new(from_axis, p.z);
    let segment = |i: usize| (Vector2::from(profile[i]), Vector2::from(profile[i + 1]));
    let normal = |i: usize| {
        let (a, b) = segment(i);
        Vector2::new(b.y - a.y, a.x - b.x).normalize()
    };
    let (mut nearest, mut squared, mut along) = (0, f64::INFINITY, 0.0);
    for i in 0..profile.len() - 1 {
        let (a, b) = segment(i);
        let t = (at - a).dot(&(b - a)) / (b - a).norm_squared();
        let d = (at - a - t.clamp(0.0, 1.0) * (b - a)).norm_squared();
        if d < squared {
            (nearest, squared, along) = (i, d, t);
        }
    }
    let lift = |v: Vector2<f64>| outward * v.x + Vector3::z() * v.y;
    let (a, b) = segment(nearest);
    let n = normal(nearest);
    if (0.0..=1.0).contains(&along) {
        return Distance { value: n.dot(&(at - a)), normal: lift(n) };
    }
    // A corner: the sum of its sides' normals points outwards. Past the axis the profile goes on as
    // its own mirror image.
    let (corner, beside) =
        if along < 0.0 { (a, nearest.checked_sub(1)) } else { (b, Some(nearest + 1)) };
    let other = match beside.filter(|&i| i + 1 < profile.len()) {
        Some(i) => normal(i),
        None => Vector2::new(-n.x, n.y),
    };
    Distance::from_edge(&lift(at - corner), &lift(n + other))
}

/// Distance to the part of an infinite prism between −`half_height` and `half_height`, from the
/// distance `side` to its lateral surface and the normal `outward` there.
fn extruded(side: f64, outward: Vector3<f64>, z: f64, half_height: f64) -> Distance {
    let cap = z.abs() - half_height;
    let up = Vector3::z() * 1f64.copysign(z);
    if side > 0.0 && cap > 0.0 {
        let value = side.hypot(cap);
        Distance { value, normal: (outward * side + up * cap) / value }
    } else if side > cap {
        Distance { value: side, normal: outward }
    } else {
        Distance { value: cap, normal: up }
    }
}

/// Distance from the z axis and the direction away from it.
fn radial(p: &Vector3<f64>) -> (f64, Vector3<f64>) {
    length_and_direction(&Vector3::new(p.x, p.y, 0.0), &Vector3::x())
}
