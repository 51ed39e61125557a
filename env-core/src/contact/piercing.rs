//! Shapes that pierce the skin: where they are narrower than contact points are apart, they slip in
//! between these, and the skin is not pushed ahead of their end.
//!
//! The depth of a corner of a shape is measured under the plane through the nearest contact points,
//! once with the body at rest and once deformed. Of 441 random presses with balls, solids with
//! edges, objects and gears, half left 6 % of the former or less, 99 % less than 0.6, and none more
//! than 0.61; a skin that is not pushed ahead leaves 0.9 and more.
//!
//! Shapes: C surface points, N nodes, S rigid shapes.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::{SurfacePoint, engulfing::SEGMENTS};
use crate::{
    Error, Result,
    geometry::{Shape, TetMesh},
};

/// Part of a shape's depth, and depth (m), that may be left under the deformed skin.
const LEFT: [f64; 2] = [0.9, 5e-4];
/// [`LEFT`] for a shape that begins in the body, and so comes from above, but pushes more aside
/// than down. Random presses that were wrong in this way left 0.59 of their depth and 0.1 mm, or
/// more.
const LEFT_ASIDE: [f64; 2] = [0.5, 5e-5];
/// Surface points that the plane of the skin is laid through.
const AROUND: usize = 6;
/// Most corners of a shape whose depth is measured.
const CORNERS: usize = 32;
/// Part of the greatest depth from which corners count as the end of a shape.
const END: f64 = 0.98;
/// Distance from a shape within which surface points are looked for first (m).
const NEAR: f64 = 5e-4;

/// Surface of a body, at rest and deformed.
pub struct DeformedSkin<'a> {
    mesh: &'a TetMesh,
    surface: &'a [SurfacePoint],
    displacement: &'a [Vector3<f64>],
    /// Surface points at rest (C).
    rest: Vec<Point3<f64>>,
    /// Lower and upper corner of the box around the body at rest.
    bounds: [Vector3<f64>; 2],
    /// Greatest displacement of a node (m).
    reach: f64,
}

/// Surface points at rest, and the same points displaced.
type Places = [Vec<Point3<f64>>; 2];

/// Depth of the end of a shape under the skin.
struct Sunk {
    /// The end.
    corner: Point3<f64>,
    /// Depth under the skin at rest, and deformed (m).
    depths: [f64; 2],
    /// Outward normal of the skin at rest.
    normal: Vector3<f64>,
}

impl<'a> DeformedSkin<'a> {
    /// Returns the skin of the body of `mesh` through the points of its `surface` (C), whose nodes
    /// are at `places` (N) at rest and displaced (N) in m.
    pub fn new(
        mesh: &'a TetMesh,
        surface: &'a [SurfacePoint],
        places: &[Point3<f64>],
        displacement: &'a [Vector3<f64>],
    ) -> Self {
        let at = |&(node, share): &(u32, f64)| places[node as usize].coords * share;
        let place = |point: &SurfacePoint| point.shares.iter().map(at).sum::<Vector3<f64>>().into();
        let rest = surface.iter().map(place).collect();
        let bounds = bounds(&mesh.vertices);
        let reach = displacement.iter().map(Vector3::norm_squared).fold(0.0, f64::max).sqrt();
        Self { mesh, surface, displacement, rest, bounds, reach }
    }

    /// Returns an error if one of the `shapes` at their `poses`, which push the body with `forces`
    /// (S), leaves too much of its depth under the deformed skin. Forces that push aside count only
    /// if the shapes `begin` in the body.
    pub fn check(
        &self,
        shapes: &[Shape],
        poses: &[Isometry3<f64>],
        forces: &[Vector3<f64>],
        begin: bool,
    ) -> Result<()> {
        for ((shape, pose), force) in shapes.iter().zip(poses).zip(forces) {
            let Some(Sunk { corner, depths: [depth, left], normal }) = self.sunk(shape, pose)
            else {
                continue;
            };
            let down = -force.dot(&normal);
            let aside = begin && (force + normal * down).norm() > down;
            let [part, least] = if aside { LEFT_ASIDE } else { LEFT };
            let most = f64::max(part * depth, least);
            // Beside a curved body, the plane of its skin lies over corners that are outside.
            if left > most && self.mesh.contains(&corner) {
                return Err(Error::Penetrated { depth: left, most });
            }
        }
        Ok(())
    }

    /// Depth of the end of `shape` at its `pose`: of that corner among the deepest which has least
    /// of it left. `None` if no corner is under the skin at rest.
    fn sunk(&self, shape: &Shape, pose: &Isometry3<f64>) -> Option<Sunk> {
        let surface = shape.surface(SEGMENTS)?;
        let corners = surface.vertices().iter().map(|corner| pose * corner);
        let mut corners: Vec<_> =
            corners.filter(|corner| is_between(corner, &self.bounds, 0.0)).collect();
        if corners.is_empty() {
            return None;
        }
        let centre = middle(&corners);
        let (_, outward) = self.plane(&self.near(&[centre])?, 0, &centre)?;
        corners.sort_by(|a, b| outward.dot(&a.coords).total_cmp(&outward.dot(&b.coords)));
        corners.truncate(CORNERS);
        let places = self.near(&corners)?;
        let plane = |place: &Point3<f64>| self.plane(&places, 0, place);
        let depth = |corner: &Point3<f64>| {
            let (middle, normal) = plane(corner)?;
            Some((*corner, normal.dot(&(middle - corner)), normal))
        };
        let under: Vec<_> =
            corners.iter().filter_map(depth).filter(|under| under.1 > 0.0).collect();
        let deepest = under.iter().map(|(_, depth, _)| *depth).fold(0.0, f64::max);
        let end = under.into_iter().filter(|(_, depth, _)| *depth >= END * deepest);
        let sunk = end.filter_map(|(corner, depth, normal)| {
            let (middle, moved) = self.plane(&places, 1, &corner)?;
            Some(Sunk { corner, depths: [depth, moved.dot(&(middle - corner))], normal })
        });
        let part = |sunk: &Sunk| sunk.depths[1] / sunk.depths[0];
        sunk.min_by(|a, b| part(a).total_cmp(&part(b)))
    }

    /// Surface points around one or more `corners`; `None` if the body has too few.
    fn near(&self, corners: &[Point3<f64>]) -> Option<Places> {
        if self.rest.len() < AROUND {
            return None;
        }
        let around = bounds(corners);
        let within = |margin: f64| {
            let near = move |(_, place): &(_, &Point3<f64>)| is_between(place, &around, margin);
            self.surface.iter().zip(&self.rest).filter(near)
        };
        let mut margin = NEAR;
        while within(margin).take(AROUND).count() < AROUND {
            margin *= 2.0;
        }
        let moved = |(point, place): (&SurfacePoint, &Point3<f64>)| {
            (*place, place + point.interpolate(self.displacement))
        };
        Some(within(2.0 * margin + self.reach).map(moved).unzip().into())
    }

    /// Plane of the skin at rest (0) or deformed (1) next to `place`: a point and the outward
    /// normal.
    fn plane(
        &self,
        places: &Places,
        state: usize,
        place: &Point3<f64>,
    ) -> Option<(Point3<f64>, Vector3<f64>)> {
        let around = nearest(&places[state], place)?;
        let [rest, here] = [0, state].map(|of| around.map(|i| places[of][i]));
        let centre = middle(&here);
        let spread = here.iter().map(|point| {
            let apart = point - centre;
            apart * apart.transpose()
        });
        let spread = spread.sum::<Matrix3<f64>>().symmetric_eigen();
        let normal: Vector3<f64> = spread.eigenvectors.column(spread.eigenvalues.imin()).into();
        let [low, high] = &self.bounds;
        let outward = middle(&rest).coords - 0.5 * (low + high);
        Some((centre, if normal.dot(&outward) < 0.0 { -normal } else { normal }))
    }
}

/// Lower and upper corner of the box around `places`.
fn bounds(places: &[Point3<f64>]) -> [Vector3<f64>; 2] {
    let far = Vector3::repeat(f64::INFINITY);
    let low = places.iter().fold(far, |low, place| low.inf(&place.coords));
    [low, places.iter().fold(-far, |high, place| high.sup(&place.coords))]
}

/// Returns whether `place` is in the box of these `bounds`, widened by `margin` (m).
fn is_between(place: &Point3<f64>, [low, high]: &[Vector3<f64>; 2], margin: f64) -> bool {
    (0..3).all(|i| low[i] - margin <= place[i] && place[i] <= high[i] + margin)
}

/// Mean of `places`.
fn middle(places: &[Point3<f64>]) -> Point3<f64> {
    let sum = places.iter().map(|place| place.coords).sum::<Vector3<f64>>();
    Point3::from(sum / places.len() as f64)
}

/// Indices of the points nearest to `place`; `None` if there are too few.
fn nearest(points: &[Point3<f64>], place: &Point3<f64>) -> Option<[usize; AROUND]> {
    let mut found = [(f64::INFINITY, 0); AROUND];
    for (i, point) in points.iter().enumerate() {
        let apart = (point - place).norm_squared();
        if apart < found[AROUND - 1].0 {
            let at = found.partition_point(|(nearer, _)| *nearer <= apart);
            found[at..].rotate_right(1);
            found[at] = (apart, i);
        }
    }
    found[AROUND - 1].0.is_finite().then(|| found.map(|(_, i)| i))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MM: f64 = 1e-3;

    /// Returns the answer for a blade of 0.2 × 0.2 mm that stands `depth` (m) under the face z = 0
    /// of a block and pushes it with `force` (N). The skin has points 0.4 mm apart, and `left` (m)
    /// of the depth is left under it.
    fn checked(depth: f64, left: f64, force: Vector3<f64>, begin: bool) -> Result<()> {
        let block = Shape::Cuboid { half_extents: Vector3::new(4.0, 4.0, 2.0) * MM };
        let mut mesh = TetMesh::of_shape(&block, 2.0 * MM).unwrap();
        mesh.vertices.iter_mut().for_each(|p| p.z -= 2.0 * MM);
        let along = |i: i32| 0.4 * MM * f64::from(i);
        let row = |i| (-9..=9).map(move |j| Point3::new(along(i), along(j), 0.0));
        let places: Vec<_> = (-9..=9).flat_map(row).collect();
        let point = |node| SurfacePoint { shares: vec![(node, 1.0)], area: 1e-8, young: 1e5 };
        let surface: Vec<_> = (0..places.len() as u32).map(point).collect();
        let displacement = vec![Vector3::new(0.0, 0.0, left - depth); places.len()];
        let blade = [Shape::Cuboid { half_extents: Vector3::new(0.1, 0.1, 2.0) * MM }];
        let poses = [Isometry3::translation(0.2 * MM, 0.2 * MM, 2.0 * MM - depth)];
        DeformedSkin::new(&mesh, &surface, &places, &displacement).check(
            &blade,
            &poses,
            &[force],
            begin,
        )
    }

    #[test]
    fn a_shape_whose_depth_is_left_under_the_skin_is_refused() {
        let (down, aside) = (-Vector3::z(), Vector3::x());
        let refused = |depth: f64, left, force, begin| {
            let found = checked(depth * MM, left * MM, force, begin);
            assert!(matches!(found, Ok(()) | Err(Error::Penetrated { .. })), "{found:?}");
            found.is_err()
        };
        assert!(refused(0.6, 0.59, down, true), "nothing is pushed ahead");
        assert!(refused(0.6, 0.59, Vector3::zeros(), false), "nothing is felt");
        assert!(!refused(0.6, 0.4, down, true), "a third is pushed ahead");
        assert!(!refused(0.4, 0.39, down, true), "no deeper than contact allows");
        assert!(refused(0.4, 0.3, aside, true), "pushes aside");
        assert!(!refused(0.4, 0.3, aside, false), "pushes aside after another motion");
        assert!(!refused(0.4, 0.1, aside, true), "pushes aside with the skin ahead");
        assert!(!refused(-0.1, -0.1, down, true), "over the skin");
    }

    #[test]
    fn what_is_left_is_told_with_what_may_be() {
        let found = checked(0.8 * MM, 0.78 * MM, Vector3::zeros(), true).unwrap_err();
        let Error::Penetrated { depth, most } = found else { panic!("{found}") };
        assert!((depth - 0.78 * MM).abs() < 1e-9, "{depth} m left");
        assert!((most - 0.72 * MM).abs() < 1e-9, "{most} m allowed");
    }
}
