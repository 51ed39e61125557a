//! Motion of rigid shapes towards a surface.
//!
//! Shapes: C surface points, S rigid shapes.

use nalgebra::{Isometry3, Point3, Vector3};

use super::SurfacePoint;
use crate::geometry::Shape;

/// Returns `poses` (S) with each shape that overlaps the surface moved out of it, opposite to the
/// direction in which it would push the surface. The surface points are at `places` (C).
pub fn backed_off(
    shapes: &[Shape],
    poses: &[Isometry3<f64>],
    surface: &[SurfacePoint],
    places: &[Point3<f64>],
) -> Vec<Isometry3<f64>> {
    let mut apart = poses.to_vec();
    for (shape, pose) in shapes.iter().zip(&mut apart) {
        let (mut deepest, push) = overlap(shape, pose, surface, places);
        let Some(away) = (-push).try_normalize(0.0) else { continue };
        for _ in 0..100 {
            if deepest == 0.0 {
                break;
            }
            pose.translation.vector += away * deepest.max(1e-6);
            deepest = overlap(shape, pose, surface, places).0;
        }
    }
    apart
}

/// Depth of the deepest point inside the shape (m), and the sum of depth × area along the normals
/// (m³).
fn overlap(
    shape: &Shape,
    pose: &Isometry3<f64>,
    surface: &[SurfacePoint],
    places: &[Point3<f64>],
) -> (f64, Vector3<f64>) {
    let (mut deepest, mut push) = (0f64, Vector3::zeros());
    for (point, place) in surface.iter().zip(places) {
        let distance = shape.distance(&pose.inverse_transform_point(place));
        if distance.value < 0.0 {
            deepest = deepest.max(-distance.value);
            push -= pose.rotation * distance.normal * (distance.value * point.area);
        }
    }
    (deepest, push)
}

/// Smallest signed distance of any of `places` to any shape (m).
pub fn clearance(shapes: &[Shape], poses: &[Isometry3<f64>], places: &[Point3<f64>]) -> f64 {
    let pairs = shapes.iter().zip(poses);
    let distance = |(shape, pose): (&Shape, &Isometry3<f64>)| {
        let measure = |p| shape.distance(&pose.inverse_transform_point(p)).value;
        places.iter().map(measure).fold(f64::INFINITY, f64::min)
    };
    pairs.map(distance).fold(f64::INFINITY, f64::min)
}

/// Interpolates between two sets of poses at the fraction `t`.
pub fn between(from: &[Isometry3<f64>], to: &[Isometry3<f64>], t: f64) -> Vec<Isometry3<f64>> {
    if t == 1.0 {
        return to.to_vec();
    }
    from.iter().zip(to).map(|(from, to)| from.lerp_slerp(to, t)).collect()
}
