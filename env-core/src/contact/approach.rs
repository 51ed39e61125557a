//! Motion of rigid shapes towards a surface.
//!
//! Shapes: C surface points, S rigid shapes.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{SurfacePoint, engulfing::SEGMENTS};
use crate::geometry::{Distance, Shape, TetMesh};

/// Steps of the depth of the deepest point after which a shape is no longer backed off.
const STEPS: usize = 100;
/// Least cosine between the direction in which a shape is backed off and the body's normal.
const STEEPEST: f64 = 0.5;
/// Travel without contact after which shapes are taken to miss the body (m).
const FARTHEST: f64 = 1.0;

/// Returns `poses` (S) with each shape that overlaps the surface moved out of it, opposite to the
/// direction in which it would push the surface. The surface points are at `places` (C) and belong
/// to a body at rest of this `mesh`.
///
/// A shape that is buried to its widest part or past it would push the surface aside or out of the
/// body, and would be taken to come from inside. It is moved out along the body's normal at its
/// deepest point. So is one that stands in the body between surface points.
pub fn backed_off(
    shapes: &[Shape],
    poses: &[Isometry3<f64>],
    surface: &[SurfacePoint],
    places: &[Point3<f64>],
    mesh: &TetMesh,
) -> Vec<Isometry3<f64>> {
    let mut apart = poses.to_vec();
    for (shape, pose) in shapes.iter().zip(&mut apart) {
        let Some(Overlap { mut deepest, place, push }) = overlap(shape, pose, surface, places)
        else {
            if let Some(place) = middle_inside(shape, pose, mesh) {
                pose.translation.vector += lift(shape, pose, mesh, &outward(mesh, &place));
            }
            continue;
        };
        let normal = outward(mesh, &place);
        // A half-space has no widest part.
        let is_from_outside = |away: &Vector3<f64>| {
            away.dot(&normal) >= STEEPEST || matches!(shape, Shape::HalfSpace)
        };
        let Some(away) = (-push).try_normalize(0.0).filter(is_from_outside) else {
            pose.translation.vector += lift(shape, pose, mesh, &normal);
            continue;
        };
        for _ in 0..STEPS {
            pose.translation.vector += away * deepest.max(1e-6);
            match overlap(shape, pose, surface, places) {
                Some(overlap) => deepest = overlap.deepest,
                None => break,
            }
        }
    }
    apart
}

/// Surface points inside a shape.
struct Overlap {
    /// Depth of the deepest point (m), and its place.
    deepest: f64,
    place: Point3<f64>,
    /// Sum of depth × area along the shape's normals (m³).
    push: Vector3<f64>,
}

/// Surface points inside a shape, if there are any.
fn overlap(
    shape: &Shape,
    pose: &Isometry3<f64>,
    surface: &[SurfacePoint],
    places: &[Point3<f64>],
) -> Option<Overlap> {
    let mut found = Overlap { deepest: 0.0, place: Point3::origin(), push: Vector3::zeros() };
    for (point, place) in surface.iter().zip(places) {
        let distance = shape.distance(&pose.inverse_transform_point(place));
        if distance.value < 0.0 {
            if -distance.value > found.deepest {
                (found.deepest, found.place) = (-distance.value, *place);
            }
            found.push -= pose.rotation * distance.normal * (distance.value * point.area);
        }
    }
    (found.deepest > 0.0).then_some(found)
}

/// Mean place of the corners of a shape that are inside the body of `mesh`, if there are any.
fn middle_inside(shape: &Shape, pose: &Isometry3<f64>, mesh: &TetMesh) -> Option<Point3<f64>> {
    let surface = shape.surface(SEGMENTS)?;
    let places = || mesh.vertices.iter().map(|place| place.coords);
    let low = places().fold(Vector3::repeat(f64::INFINITY), |low, place| low.inf(&place));
    let high = places().fold(Vector3::repeat(f64::NEG_INFINITY), |high, place| high.sup(&place));
    let is_near = |p: &Point3<f64>| (0..3).all(|i| low[i] <= p[i] && p[i] <= high[i]);
    let corners = surface.vertices().iter().map(|corner| pose * corner).filter(is_near);
    let inside: Vec<_> = corners.filter(|corner| mesh.contains(corner)).collect();
    let sum = inside.iter().map(|corner| corner.coords).sum::<Vector3<f64>>();
    (!inside.is_empty()).then(|| (sum / inside.len() as f64).into())
}

/// Motion (m) along `away` that brings all of a shape beyond the body of `mesh`; zero for a shape
/// without a bounded surface.
fn lift(shape: &Shape, pose: &Isometry3<f64>, mesh: &TetMesh, away: &Vector3<f64>) -> Vector3<f64> {
    let Some(surface) = shape.surface(SEGMENTS) else { return Vector3::zeros() };
    let height = |place: &Point3<f64>| away.dot(&place.coords);
    let corners = surface.vertices().iter().map(|corner| height(&(pose * corner)));
    let lowest = corners.fold(f64::INFINITY, f64::min);
    let top = mesh.vertices.iter().map(height).fold(f64::NEG_INFINITY, f64::max);
    away * (top - lowest).max(0.0)
}

/// Unit normal of the body of `mesh` at its face nearest to `place`.
fn outward(mesh: &TetMesh, place: &Point3<f64>) -> Vector3<f64> {
    let corners = |face: [u32; 3]| face.map(|node| mesh.vertices[node as usize].coords);
    let apart = |face: &[u32; 3]| {
        (corners(*face).iter().sum::<Vector3<f64>>() / 3.0 - place.coords).norm_squared()
    };
    let faces = mesh.boundary().into_iter();
    let [a, b, c] =
        corners(faces.min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("a body has faces"));
    (b - a).cross(&(c - a)).normalize()
}

/// Moves the shapes at `poses` (S) along `direction` until their `clearance` (m) is less than
/// `near` (m), and returns whether it becomes so. Each step is as long as the clearance, but at
/// least `shortest` (m), so that no shape passes the body.
pub fn advance_to_contact(
    poses: &mut [Isometry3<f64>],
    direction: &Vector3<f64>,
    [near, shortest]: [f64; 2],
    clearance: impl Fn(&[Isometry3<f64>]) -> f64,
) -> bool {
    let mut travel = 0.0;
    while travel < FARTHEST {
        let gap = clearance(poses);
        if gap < near {
            return true;
        }
        let step = gap.max(shortest);
        travel += step;
        for pose in &mut *poses {
            pose.translation.vector += direction * step;
        }
    }
    false
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

/// Index of the nearest shape, and the distance with its normal in the frame of the body.
pub fn nearest(shapes: &[Shape], poses: &[Isometry3<f64>], place: &Point3<f64>) -> (u32, Distance) {
    let measure = |(s, (shape, pose)): (usize, (&Shape, &Isometry3<f64>))| {
        let found = shape.distance(&pose.inverse_transform_point(place));
        (s as u32, Distance { value: found.value, normal: pose.rotation * found.normal })
    };
    let all = shapes.iter().zip(poses).enumerate().map(measure);
    all.min_by(|(_, a), (_, b)| a.value.total_cmp(&b.value)).expect("a press has a shape")
}

/// Distance of `place` from the nearest shape (m), that of [`nearest`] without its normal.
pub fn gap(shapes: &[Shape], poses: &[Isometry3<f64>], place: &Point3<f64>) -> f64 {
    let pairs = shapes.iter().zip(poses);
    let all = pairs.map(|(shape, pose)| shape.distance(&pose.inverse_transform_point(place)).value);
    all.min_by(f64::total_cmp).expect("a press has a shape")
}

/// Interpolates between two sets of poses at the fraction `t`.
pub fn between(from: &[Isometry3<f64>], to: &[Isometry3<f64>], t: f64) -> Vec<Isometry3<f64>> {
    if t == 1.0 {
        return to.to_vec();
    }
    from.iter().zip(to).map(|(from, to)| from.lerp_slerp(to, t)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shape_between_surface_points_is_moved_out_of_the_body() {
        // A unit cube on z = 0 and a ball that stands out at its top; no surface points.
        let cube = Shape::Cuboid { half_extents: Vector3::repeat(0.5) };
        let mut mesh = TetMesh::of_shape(&cube, 0.3).unwrap();
        mesh.vertices.iter_mut().for_each(|p| *p += Vector3::repeat(0.5));
        let ball = [Shape::Sphere { radius: 0.1 }];
        let moved = |z: f64| {
            let first = [Isometry3::translation(0.5, 0.5, z)];
            backed_off(&ball, &first, &[], &[], &mesh)[0].translation.z
        };
        // The ball is triangulated, so its lowest corner may be a little higher than the ball.
        assert!((moved(0.95) - 1.1).abs() < 0.01, "{} m", moved(0.95));
        assert!((moved(1.2) - 1.2).abs() < 1e-15, "{} m", moved(1.2));
    }

    #[test]
    fn a_gap_is_the_distance_of_the_nearest_shape_to_the_bit() {
        let half_extents = Vector3::new(0.02, 0.03, 0.01);
        let shapes = [Shape::Sphere { radius: 0.02 }, Shape::Cuboid { half_extents }];
        let turn = Vector3::new(0.3, -0.2, 0.1);
        let poses =
            [0.03, -0.01].map(|x| Isometry3::new(Vector3::new(x, 0.01, 0.02), x * 9.0 * turn));
        for i in 0..100 {
            let direction = Vector3::new(f64::from(i).sin(), f64::from(3 * i).cos(), 0.3);
            let place = Point3::from(1e-3 * f64::from(i) * direction);
            let (found, right) = (gap(&shapes, &poses, &place), nearest(&shapes, &poses, &place));
            assert_eq!(found.to_bits(), right.1.value.to_bits(), "{found} m at {place}");
        }
    }

    #[test]
    fn shapes_advance_until_one_is_near_or_all_have_missed() {
        let (wall, near) = (0.01, 2e-6);
        let height = |poses: &[Isometry3<f64>]| poses[0].translation.z;
        let advanced = |clearance: &dyn Fn(f64) -> f64| {
            let mut poses = [Isometry3::identity()];
            let gap = |poses: &[_]| clearance(height(poses));
            let met = advance_to_contact(&mut poses, &Vector3::z(), [near; 2], gap);
            (met, height(&poses))
        };
        let (met, z) = advanced(&|z| 0.5 * (wall - z));
        assert!(met && z <= wall && wall - z < 2.0 * near, "{z} m of {wall} m");
        let (met, z) = advanced(&|_| 0.3);
        assert!(!met && (1.0..1.3).contains(&z), "{z} m");
    }
}
