//! Detection of steps in which a point and a shape pass through each other without contact. Such
//! steps are rejected.
//!
//! Shapes: C surface points, S rigid shapes; pairs of them are numbered shape by shape (S × C).

use nalgebra::{Isometry3, Point3};

use super::{ContactStep, Touch, near::SURE};
use crate::geometry::Shape;

/// Thickness below which points must not pass through a shape at all (m); round the edges of
/// thicker ones they may slide.
const THIN: f64 = 1.2e-3;

impl ContactStep<'_> {
    /// Returns whether a point is nearer to the far side of the shape than to where it entered: the
    /// normals at the two places point away from each other. In a one-sided step, a point that has
    /// just met the shape may not even turn round an edge.
    pub fn passed_through(&self, touch: &Touch, poses: &[Isometry3<f64>]) -> bool {
        let (s, c) = (touch.shape as usize, touch.point as usize);
        let shape = &self.shapes[s];
        self.stuck[s * self.surface.len() + c].is_some_and(|entry| {
            let start = self.from[s].inverse_transform_point(&self.start[c]);
            let strict = self.one_sided && shape.distance(&start).value > 0.0;
            let entered = poses[s].rotation * shape.distance(&entry).normal;
            entered.dot(&touch.normal) < if strict { 0.5 } else { -0.5 }
        })
    }

    /// Returns whether a shape that moves to `poses` passes over a point by more than `depth` and
    /// leaves it behind, so that the point does not touch at the end of the step.
    pub fn runs_over(&mut self, poses: &[Isometry3<f64>], depth: f64) -> bool {
        let points = self.surface.len();
        poses.iter().enumerate().any(|(s, pose)| {
            (0..points).any(|c| {
                let [begin, end] =
                    [&self.from[s], pose].map(|pose| pose.inverse_transform_point(&self.start[c]));
                let gap = |p: &Point3<f64>| self.shapes[s].distance(p).value;
                let (pair, travel) = (s * points + c, (end - begin).norm());
                let seen = self.seen[pair];
                self.room[pair] = seen.1 - (begin - seen.0).norm();
                if self.room[pair] > SURE + travel {
                    return false;
                }
                let value = gap(&begin);
                (self.seen[pair], self.room[pair]) = ((begin, value), value);
                value < (end - begin).norm()
                    && runs_through(gap, &begin, &end, [depth - value.min(0.0), 0.0])
            })
        })
    }

    /// Returns whether a point went through a shape in its motion to `places` (C): through more
    /// than `depth` of a shape if one of them is thin, or to the opposite side.
    pub fn goes_through(
        &self,
        poses: &[Isometry3<f64>],
        places: &[Point3<f64>],
        depth: f64,
    ) -> bool {
        let thin = self.shapes.iter().any(|shape| shape.thickness() < THIN);
        thin && self.leaps(poses, places, depth) || self.changes_sides(poses, places, depth)
    }

    /// Returns whether a point went through more than `depth` of a shape in its motion to `places`
    /// (C), where it is outside or touches. The distances measured by the last
    /// [`ContactStep::touches`] save most measurements.
    fn leaps(&self, poses: &[Isometry3<f64>], places: &[Point3<f64>], depth: f64) -> bool {
        self.any_motion(poses, places, |pair, shape, begin, end| {
            let travel = (end - begin).norm();
            let (seen, value) = self.seen[pair];
            travel > 2.0 * depth
                && travel > value - (end - seen).norm()
                && leaps_through(shape, begin, end, depth)
        })
    }

    /// Returns [`ContactStep::leaps`] only for points that end on the side opposite to where they
    /// began: round the edge of a thick shape a point may slide far, though not to the far side.
    fn changes_sides(&self, poses: &[Isometry3<f64>], places: &[Point3<f64>], depth: f64) -> bool {
        self.any_motion(poses, places, |_, shape, begin, end| {
            changes_sides(shape, begin, end, depth)
        })
    }

    /// Returns whether `is_wrong` holds for any pair, given its index, its shape, and the ends of
    /// the point's path in the frame of the shape.
    fn any_motion(
        &self,
        poses: &[Isometry3<f64>],
        places: &[Point3<f64>],
        is_wrong: impl Fn(usize, &Shape, &Point3<f64>, &Point3<f64>) -> bool,
    ) -> bool {
        poses.iter().enumerate().any(|(s, pose)| {
            places.iter().enumerate().any(|(c, place)| {
                let begin = self.from[s].inverse_transform_point(&self.start[c]);
                let end = pose.inverse_transform_point(place);
                is_wrong(s * self.surface.len() + c, &self.shapes[s], &begin, &end)
            })
        })
    }
}

/// Returns whether the straight path from `begin` to `end` lies deeper than the first of two depths
/// somewhere and ends less deep than the second. `gap` must change no faster than the point moves,
/// so the path is followed in steps as long as the gap.
pub(super) fn runs_through(
    gap: impl Fn(&Point3<f64>) -> f64,
    begin: &Point3<f64>,
    end: &Point3<f64>,
    [depth, left]: [f64; 2],
) -> bool {
    let travel = end - begin;
    let (length, mut gone, mut deep) = (travel.norm(), 0.0, false);
    while !deep && gone < length {
        let value = gap(&(begin + travel * (gone / length)));
        deep = value < -depth;
        gone += value.abs().max(depth);
    }
    deep && gap(end) > -left
}

/// Returns whether a point whose straight path in the frame of `shape` leads from `begin` to `end`
/// went through it: more than `depth` (m) deep through a thin one, or to the opposite side of a
/// thick one. Round the edges of the latter it may slide.
pub fn went_through(shape: &Shape, begin: &Point3<f64>, end: &Point3<f64>, depth: f64) -> bool {
    if shape.thickness() < THIN {
        leaps_through(shape, begin, end, depth)
    } else {
        changes_sides(shape, begin, end, depth)
    }
}

/// Returns whether the straight path from `begin` to `end`, in the frame of `shape`, leads more
/// than `depth` (m) deeper than it begins and ends less than `depth` deep.
fn leaps_through(shape: &Shape, begin: &Point3<f64>, end: &Point3<f64>, depth: f64) -> bool {
    let gap = |p: &Point3<f64>| shape.distance(p).value;
    let sunk = gap(begin).min(0.0);
    runs_through(gap, begin, end, [depth - sunk, depth])
}

/// Returns [`leaps_through`] only for paths that end on the side opposite to where they began.
fn changes_sides(shape: &Shape, begin: &Point3<f64>, end: &Point3<f64>, depth: f64) -> bool {
    let normal = |p: &Point3<f64>| shape.distance(p).normal;
    (end - begin).norm() > 0.5 * shape.thickness()
        && leaps_through(shape, begin, end, depth)
        && normal(begin).dot(&normal(end)) < -0.5
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::{super::touch::tests::surface, *};

    #[test]
    fn a_shape_that_runs_over_a_point_is_noticed() {
        let (shapes, surface) = ([Shape::Sphere { radius: 0.01 }], surface());
        let start = vec![Point3::origin()];
        let from = Isometry3::translation(0.0, 0.0, 0.011);
        let mut step = ContactStep::new(&shapes, &surface, vec![from], start, &[]);
        let mut ends_at =
            |x: f64, z: f64| step.runs_over(&[Isometry3::translation(x, 0.0, z)], 1e-5);
        assert!(ends_at(0.0, -0.011), "right through");
        assert!(!ends_at(0.0, -0.009), "ends inside, where it is felt");
        assert!(!ends_at(0.0, 0.02), "away");
        assert!(!ends_at(0.05, 0.011), "past");
    }

    #[test]
    fn a_point_that_changes_sides_is_noticed() {
        // A plate 0.4 mm thick comes down on a point; a step later the point is above it or below.
        let shapes = [Shape::Cuboid { half_extents: Vector3::new(0.01, 0.01, 2e-4) }];
        let from = Isometry3::translation(0.0, 0.0, 3e-4);
        let poses = [Isometry3::identity()];
        let surface = surface();
        let leaps = |x: f64, z: f64| {
            let start = vec![Point3::origin()];
            let mut step = ContactStep::new(&shapes, &surface, vec![from], start, &[]);
            let places = [Point3::new(x, 0.0, z)];
            step.touches(&poses, &places);
            step.leaps(&poses, &places, 2e-5)
        };
        assert!(leaps(0.0, 2.1e-4), "above");
        assert!(leaps(0.0, 1.99e-4), "touching from above");
        assert!(!leaps(0.0, -1.99e-4), "touching from below");
        assert!(!leaps(0.003, -2.1e-4), "slid along below");
        assert!(!leaps(0.0, 0.0), "inside, where it is felt");
    }

    #[test]
    fn a_point_that_ends_opposite_on_a_thick_shape_is_noticed() {
        let (shapes, surface) = ([Shape::Sphere { radius: 0.01 }], surface());
        let from = Isometry3::translation(0.0, 0.0, 0.0099);
        let sides = |x: f64, z: f64| {
            let start = vec![Point3::origin()];
            let step = ContactStep::new(&shapes, &surface, vec![from], start, &[]);
            step.changes_sides(&[Isometry3::identity()], &[Point3::new(x, 0.0, z)], 2e-5)
        };
        assert!(sides(0.0, 0.011), "right through");
        assert!(!sides(0.0, -0.0101), "taken along below");
        assert!(!sides(0.0101, 0.0), "a quarter of the way round");
        assert!(!sides(0.0, 0.005), "inside, where it is felt");
    }
}
