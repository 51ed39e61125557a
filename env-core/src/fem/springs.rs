//! Touching points as springs.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3, Vector3};

use super::system::System;
use crate::contact::{ContactStep, Touch};

/// Linearised contact of a surface point with a shape.
#[derive(Clone)]
pub(super) struct Spring {
    /// Index of the point.
    pub(super) point: u32,
    /// Derivative of minus the force on the point with respect to its position (N/m).
    pub(super) stiffness: Matrix3<f64>,
    pub(super) symmetric: bool,
}

impl Spring {
    /// The spring that cancels this one.
    pub(super) fn opposite(&self) -> Self {
        Self { point: self.point, stiffness: -self.stiffness, symmetric: false }
    }
}

impl System {
    /// Returns `touches` as springs whose friction limits follow the depth.
    pub(super) fn springs(&self, touches: &[Touch]) -> Vec<Spring> {
        let spring = |touch: &Touch| {
            let point = &self.surface[touch.point as usize];
            let slip = self.law.limit_coupling(point, touch);
            let (stiffness, symmetric) = (self.contact_stiffness(touch), slip.is_none());
            let stiffness = stiffness + slip.unwrap_or_default() * point.area;
            Spring { point: touch.point, stiffness, symmetric }
        };
        touches.iter().map(spring).collect()
    }

    /// Returns [`System::springs`] with the curvature of the shapes, which are at `poses`, where
    /// points slip or have no friction.
    pub(super) fn curved_springs(
        &self,
        touches: &[Touch],
        contact: &ContactStep,
        poses: &[Isometry3<f64>],
    ) -> Vec<Spring> {
        let mut springs = self.springs(touches);
        let is_free = |spring: &Spring| !spring.symmetric || self.law.friction == 0.0;
        let free = springs.iter_mut().zip(touches).filter(|(spring, _)| is_free(spring));
        for (spring, touch) in free {
            let (point, bend) = (&self.surface[touch.point as usize], contact.bend(touch, poses));
            spring.stiffness += self.law.curvature_term(point, touch, &bend) * point.area;
        }
        springs
    }

    /// Returns `touches` as springs whose friction limits are held fixed.
    pub(super) fn held_springs(&self, touches: &[Touch]) -> Vec<Spring> {
        let spring = |touch: &Touch| {
            let stiffness = self.contact_stiffness(touch);
            Spring { point: touch.point, stiffness, symmetric: true }
        };
        touches.iter().map(spring).collect()
    }

    /// Forces on the nodes (N) in N with which springs resist displacements of their points (m),
    /// one given with each spring.
    pub(super) fn resistance<'s>(
        &self,
        springs: impl Iterator<Item = (&'s Spring, Vector3<f64>)>,
    ) -> Vec<Vector3<f64>> {
        let mut forces = vec![Vector3::zeros(); self.nodes.places.len()];
        for (spring, stretch) in springs {
            let point = &self.surface[spring.point as usize];
            point.spread(&(spring.stiffness * stretch), &mut forces);
        }
        forces
    }
}

/// Springs that must be added to `others` to obtain `springs`.
pub(super) fn missing(springs: &[Spring], others: &[Spring]) -> Vec<Spring> {
    let mut of_point = BTreeMap::<u32, Matrix3<f64>>::new();
    for (springs, sign) in [(springs, 1.0), (others, -1.0)] {
        for spring in springs {
            *of_point.entry(spring.point).or_default() += spring.stiffness * sign;
        }
    }
    let some = of_point.into_iter().filter(|(_, stiffness)| *stiffness != Matrix3::zeros());
    some.map(|(point, stiffness)| Spring { point, stiffness, symmetric: false }).collect()
}
