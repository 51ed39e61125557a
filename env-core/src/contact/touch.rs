//! Detection of surface points inside a shape, with their depth and slip.
//!
//! Shapes: C surface points, S rigid shapes; pairs of them are numbered shape by shape (S × C).

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::SurfacePoint;
use crate::{
    deformation::Anchor,
    geometry::{Distance, Shape},
};

/// A surface point inside a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Index of the shape.
    pub shape: u32,
    /// Index of the surface point.
    pub point: u32,
    /// Position of the point (m).
    pub place: Point3<f64>,
    /// Depth inside the shape (m), above 0.
    pub depth: f64,
    /// Outward normal of the shape.
    pub normal: Vector3<f64>,
    /// Tangential displacement from where the point sticks to where it is (m).
    pub slip: Vector3<f64>,
}

/// Curvature of a shape at a touching point.
#[derive(Clone, Debug)]
pub struct Bend {
    /// Derivative of the normal with respect to the point's position, ∂n/∂x (1/m); symmetric.
    pub turn: Matrix3<f64>,
    /// Normal component of the vector from the sticking place to the point (m).
    pub lift: f64,
}

/// Distance over which the turn of a normal is measured (m).
const SHORT: f64 = 1e-8;
/// Largest turn of a normal over that distance; more is an edge.
const SMOOTH: f64 = 1e-3;

/// Contact within one load step: the shapes move from one set of poses to another.
#[derive(Clone, Debug)]
pub struct ContactStep<'a> {
    pub(super) shapes: &'a [Shape],
    pub(super) surface: &'a [SurfacePoint],
    /// Poses at the beginning (S).
    pub(super) from: Vec<Isometry3<f64>>,
    /// Positions of the surface points at the beginning (C).
    pub(super) start: Vec<Point3<f64>>,
    /// Sticking places of the pairs, in the frame of the shape (S × C): from an earlier step, or
    /// set when the pair first touches.
    pub(super) stuck: Vec<Option<Point3<f64>>>,
    /// Last measured position of each pair in the frame of the shape, and the distance there (S ×
    /// C).
    pub(super) seen: Vec<(Point3<f64>, f64)>,
    /// Lower bound of each pair's distance at the beginning (S × C).
    pub(super) room: Vec<f64>,
    /// Displacement of the nodes at the beginning (N), empty if unknown.
    pub(super) origin: Vec<Vector3<f64>>,
    /// `true` if points that meet a shape must stay on the side where they meet it.
    pub one_sided: bool,
}

impl<'a> ContactStep<'a> {
    /// Returns a step that begins with the shapes at `from`, the surface points at `start`, and the
    /// points that touched stuck at `anchors`.
    pub fn new(
        shapes: &'a [Shape],
        surface: &'a [SurfacePoint],
        from: Vec<Isometry3<f64>>,
        start: Vec<Point3<f64>>,
        anchors: &[Anchor],
    ) -> Self {
        let pairs = shapes.len() * surface.len();
        let mut stuck = vec![None; pairs];
        for anchor in anchors {
            stuck[anchor.shape as usize * surface.len() + anchor.point as usize] =
                Some(anchor.place);
        }
        let seen = vec![(Point3::origin(), 0.0); pairs];
        let (room, origin) = (vec![0.0; pairs], Vec::new());
        Self { shapes, surface, from, start, stuck, seen, room, origin, one_sided: false }
    }

    /// Finds the surface points inside the shapes at `poses`, with the points at `places` (C).
    pub fn touches(&mut self, poses: &[Isometry3<f64>], places: &[Point3<f64>]) -> Vec<Touch> {
        self.found(poses, &places.iter().enumerate())
    }

    /// Returns [`ContactStep::touches`] for the `points` only, which are at `places`.
    pub fn touches_among(
        &mut self,
        points: &[u32],
        poses: &[Isometry3<f64>],
        places: &[Point3<f64>],
    ) -> Vec<Touch> {
        self.found(poses, &points.iter().map(|&c| c as usize).zip(places))
    }

    /// Finds which of the numbered `points`, given with their positions, are inside the shapes.
    fn found<'p>(
        &mut self,
        poses: &[Isometry3<f64>],
        points: &(impl Iterator<Item = (usize, &'p Point3<f64>)> + Clone),
    ) -> Vec<Touch> {
        let mut touches = Vec::new();
        for (s, pose) in poses.iter().enumerate() {
            for (c, place) in points.clone() {
                let local = pose.inverse_transform_point(place);
                if let Some(Distance { value, normal }) = self.inside(s, c, &local) {
                    let normal = pose.rotation * normal;
                    let stuck = self.sticks_at(s, c, pose);
                    let stretch = place - pose * stuck;
                    touches.push(Touch {
                        shape: s as u32,
                        point: c as u32,
                        place: *place,
                        depth: -value,
                        normal,
                        slip: stretch - normal * normal.dot(&stretch),
                    });
                }
            }
        }
        touches
    }

    /// Distance of point `c` at `local` in the frame of shape `s`, if it is inside. A distance
    /// changes no faster than the point moves, so most points need no measurement.
    fn inside(&mut self, s: usize, c: usize, local: &Point3<f64>) -> Option<Distance> {
        let seen = &mut self.seen[s * self.surface.len() + c];
        if (local - seen.0).norm() < seen.1 {
            return None;
        }
        let distance = self.shapes[s].distance(local);
        *seen = (*local, distance.value);
        (distance.value < 0.0).then_some(distance)
    }

    /// Sticking place of the pair in the frame of the shape. A new pair sticks where the shape,
    /// moving to `pose`, met the point's position at the beginning of the step.
    fn sticks_at(&mut self, s: usize, c: usize, pose: &Isometry3<f64>) -> Point3<f64> {
        let pair = s * self.surface.len() + c;
        *self.stuck[pair].get_or_insert_with(|| {
            let (shape, from, start) = (&self.shapes[s], &self.from[s], &self.start[c]);
            let seen_from = |t: f64| from.lerp_slerp(pose, t).inverse_transform_point(start);
            let gap = |t: f64| shape.distance(&seen_from(t)).value;
            seen_from(first_touch(gap))
        })
    }

    /// Curvature of the shape at a `touch`; none beside an edge.
    pub fn bend(&self, touch: &Touch, poses: &[Isometry3<f64>]) -> Bend {
        let (shape, pose) = (touch.shape as usize, &poses[touch.shape as usize]);
        let normal = |place: &Point3<f64>| {
            pose.rotation * self.shapes[shape].distance(&pose.inverse_transform_point(place)).normal
        };
        let column = |k| normal(&(touch.place + Vector3::ith(k, SHORT))) - touch.normal;
        let turn = Matrix3::from_columns(&[column(0), column(1), column(2)]);
        let turn = if turn.norm() < SMOOTH { turn / SHORT } else { Matrix3::zeros() };
        let stuck = self.stuck[shape * self.surface.len() + touch.point as usize];
        let stretch = stuck.map_or(touch.slip, |stuck| touch.place - pose * stuck);
        Bend { turn: 0.5 * (turn + turn.transpose()), lift: touch.normal.dot(&stretch) }
    }

    /// Anchors of the touching pairs after the step. `back` gives the vector from a point to where
    /// it sticks.
    pub fn anchors(
        &self,
        poses: &[Isometry3<f64>],
        touches: &[Touch],
        back: impl Fn(&Touch) -> Vector3<f64>,
    ) -> Vec<Anchor> {
        let anchor = |touch: &Touch| {
            let place = touch.place + back(touch);
            let place = poses[touch.shape as usize].inverse_transform_point(&place);
            Anchor { shape: touch.shape, point: touch.point, place }
        };
        touches.iter().map(anchor).collect()
    }
}

/// First root of a falling `gap` over [0, 1] by false position; 0 if it begins at or below zero, 1
/// if it does not fall below zero.
pub fn first_touch(gap: impl Fn(f64) -> f64) -> f64 {
    let (mut open, mut closed) = ((0.0, gap(0.0)), (1.0, gap(1.0)));
    if open.1 <= 0.0 {
        return 0.0;
    }
    if closed.1 >= 0.0 {
        return 1.0;
    }
    for _ in 0..4 {
        let t = open.0 + (closed.0 - open.0) * open.1 / (open.1 - closed.1);
        let value = gap(t);
        *(if value > 0.0 { &mut open } else { &mut closed }) = (t, value);
    }
    open.0 + (closed.0 - open.0) * open.1 / (open.1 - closed.1)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn surface() -> Vec<SurfacePoint> {
        vec![SurfacePoint { shares: vec![(0, 1.0)], area: 1e-6, young: 1e5 }]
    }

    #[test]
    fn no_touch_is_missed_however_a_point_wanders() {
        let (shapes, surface) = ([Shape::Sphere { radius: 0.01 }], surface());
        let start = vec![Point3::new(0.0, 0.0, 0.03)];
        let poses = vec![Isometry3::identity()];
        let mut step = ContactStep::new(&shapes, &surface, poses.clone(), start, &[]);
        for i in 0..200 {
            let angle = 0.1 * f64::from(i);
            let place = Point3::new(0.0, 0.012 * angle.sin(), 0.013 * (0.7 * angle).cos());
            let touches = step.touches(&poses, &[place]);
            let depth = 0.01 - place.coords.norm();
            assert_eq!(touches.len(), usize::from(depth > 0.0), "depth {depth} m");
            if let [touch] = touches[..] {
                assert!((touch.depth - depth).abs() < 1e-17, "{} against {depth}", touch.depth);
            }
        }
    }

    #[test]
    fn a_point_sticks_where_the_shape_ran_into_it() {
        // The ball comes down 3 mm and meets a point off its axis after less than that.
        let (shapes, surface) = ([Shape::Sphere { radius: 0.01 }], surface());
        let point = Point3::new(0.004, 0.0, 0.0);
        let from = Isometry3::translation(0.0, 0.0, 0.011);
        let pose = Isometry3::translation(0.0, 0.0, 0.008);
        let mut step = ContactStep::new(&shapes, &surface, vec![from], vec![point], &[]);
        assert!(step.touches(&[pose], &[Point3::new(0.004, 0.0, -1.2e-3)]).is_empty());
        let touches = step.touches(&[pose], &[Point3::new(0.004, 0.0, -5e-4)]);
        let height = (0.01f64.powi(2) - 0.004f64.powi(2)).sqrt();
        let expected = Point3::new(0.004, 0.0, -height);
        let found = step.stuck[0].unwrap();
        assert_eq!(touches.len(), 1);
        // Four rounds of false position on a gently curved gap.
        assert!((found - expected).norm() < 1e-7, "{found} against {expected}");
    }
}
