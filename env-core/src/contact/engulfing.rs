//! Shapes wholly inside the body: they contain no surface point, so contact does not detect them.

use std::cell::LazyCell;

use nalgebra::{Isometry3, Point3, Vector3};

use crate::{
    Error, Result,
    geometry::{Distance, Shape, TetMesh},
};

/// Segments round a circle of the triangulated shape.
pub(super) const SEGMENTS: u32 = 16;

/// Returns whether `shape` at its `pose` lies wholly in the region that `contains` its points. A
/// half-space never does.
pub fn is_within(
    shape: &Shape,
    pose: &Isometry3<f64>,
    contains: impl Fn(&Point3<f64>) -> bool,
) -> bool {
    // One point of the shape's surface rules out nearly all cases.
    let Distance { value, normal } = shape.distance(&Point3::origin());
    if !contains(&(pose * Point3::from(-value * normal))) {
        return false;
    }
    let Some(surface) = shape.surface(SEGMENTS) else { return false };
    surface.vertices().iter().all(|corner| contains(&(pose * corner)))
}

/// Returns whether `shape` at its `pose` lies wholly inside the body of this `mesh`, whose nodes
/// are displaced (V or more) in m. A half-space is never inside.
pub fn is_engulfed(
    shape: &Shape,
    pose: &Isometry3<f64>,
    mesh: &TetMesh,
    displacement: &[Vector3<f64>],
) -> bool {
    let moved = || mesh.vertices.iter().zip(displacement).map(|(p, u)| p + u);
    let deformed =
        LazyCell::new(|| TetMesh { vertices: moved().collect(), tets: mesh.tets.clone() });
    let spanned = |point: &Point3<f64>| {
        (0..3).all(|i| moved().any(|p| p[i] <= point[i]) && moved().any(|p| p[i] >= point[i]))
    };
    is_within(shape, pose, |point| spanned(point) && deformed.contains(point))
}

/// Refuses the first poses of a press from rest if one of its `shapes`, given its index, is
/// `engulfed`: wholly inside the body without touching a surface point.
pub fn check_first(shapes: usize, engulfed: impl Fn(usize) -> bool) -> Result<()> {
    match (0..shapes).find(|&i| engulfed(i)) {
        None => Ok(()),
        Some(i) => {
            let expected = "a first pose outside the body or across its surface";
            Err(Error::invalid(format!("pose of shape {i}"), "all inside", expected))
        }
    }
}

/// Returns whether one of the `places` is inside a `shape` at its `pose`.
pub fn holds(shape: &Shape, pose: &Isometry3<f64>, places: &[Point3<f64>]) -> bool {
    let inside = |p: &Point3<f64>| shape.distance(&pose.inverse_transform_point(p)).value < 0.0;
    places.iter().any(inside)
}

/// Returns whether one of the `shapes` at their `poses` is engulfed. Shapes whose index is `felt`,
/// because they touch the surface, are skipped.
pub fn engulfs_unfelt(
    shapes: &[Shape],
    poses: &[Isometry3<f64>],
    felt: impl Fn(u32) -> bool,
    mesh: &TetMesh,
    displacement: &[Vector3<f64>],
) -> bool {
    (0..)
        .zip(shapes.iter().zip(poses))
        .any(|(s, (shape, pose))| !felt(s) && is_engulfed(shape, pose, mesh, displacement))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_engulfs_what_is_all_inside_it() {
        // A unit cube on z = 0, pulled up to twice its height.
        let cube = Shape::Cuboid { half_extents: Vector3::repeat(0.5) };
        let mut mesh = TetMesh::of_shape(&cube, 0.3).unwrap();
        mesh.vertices.iter_mut().for_each(|p| *p += Vector3::repeat(0.5));
        let stretched: Vec<_> = mesh.vertices.iter().map(|p| Vector3::new(0.0, 0.0, p.z)).collect();
        let ring = Shape::Annulus { outer: 0.3, inner: 0.2, half_height: 0.05 };
        let cup = Shape::Cup { bottom: 0.2, rim: 0.3, half_height: 0.2, wall: 0.01 };
        let at = |shape: &Shape, z: f64| {
            is_engulfed(shape, &Isometry3::translation(0.5, 0.5, z), &mesh, &stretched)
        };
        assert!([&ring, &cup].iter().all(|shape| at(shape, 0.5) && at(shape, 1.5)));
        assert!(!at(&ring, 1.98) && !at(&cup, 1.9), "across the surface");
        assert!(!at(&ring, 2.2) && !at(&cup, -0.5) && !at(&Shape::HalfSpace, 1.0));
    }
}
