//! The faces by which a body is held: rigid, and nothing is felt there.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{ContactStep, Seen, SurfacePoint};
use crate::{Error, Result, geometry::Shape};

/// Points on the faces that are held.
pub struct Backing {
    points: Vec<SurfacePoint>,
    /// Where they stay (m).
    places: Vec<Point3<f64>>,
}

impl Backing {
    /// These `points` of a body whose nodes are at `rest` (N).
    pub fn new(points: Vec<SurfacePoint>, rest: &[Point3<f64>]) -> Self {
        let place = |point: &SurfacePoint| {
            let at = point.shares.iter().map(|&(node, share)| rest[node as usize].coords * share);
            Point3::from(at.sum::<Vector3<f64>>())
        };
        let places = points.iter().map(place).collect();
        Self { points, places }
    }

    /// An error if one of the `shapes` stands in it by more than `most` (m) at its pose `to`, or ran over a
    /// point of it by so much on its way `from` where it was: such a step has not converged to the
    /// `tolerance` (N) asked for. What is `seen` spares measurements the next time.
    pub fn check(
        &self,
        shapes: &[Shape],
        [from, to]: [&[Isometry3<f64>]; 2],
        [most, tolerance]: [f64; 2],
        seen: &mut Seen,
    ) -> Result<()> {
        let (from, places) = (from.to_vec(), self.places.clone());
        let mut step = ContactStep::new(shapes, &self.points, from, places, &[])
            .knowing(Vec::new(), std::mem::take(seen));
        let through = step.runs_over(to, most);
        let touches = step.touches(to, &self.places);
        *seen = step.into_seen();
        let depth = touches.iter().map(|touch| touch.depth).fold(0.0, f64::max);
        if depth > most {
            return Err(Error::Penetrated { depth, most });
        }
        let missed = Error::NotConverged { iterations: 0, residual: f64::INFINITY, tolerance };
        if through { Err(missed) } else { Ok(()) }
    }
}
