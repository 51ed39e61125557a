//! Balance of contact and elastic forces on the condensed surface.
//!
//! Under forces f on its nodes the surface is displaced by u = u₀ + C f. The shapes exert f = t(u),
//! the contact law integrated over the surface points. Newton's method on f − t(u₀ + C f) solves
//! (1 + C H) δu = C (t − f) on the touching nodes, with H = −∂t/∂u. Distances and normals of the
//! shapes are evaluated on the displaced surface in every step, and Coulomb's cone is enforced by
//! return mapping at every point (Wriggers 2006, ch. 9). Where the full step does not halve the
//! residual force, a line search on the energy follows, with the friction limits held fixed.
//!
//! Shapes: m free nodes of a [`Zone`].

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::{condensed::Condensed, newton::Newton, zone::Zone};
use crate::{
    Error, Result,
    contact::{ContactLaw, ContactStep, SurfacePoint, Touch},
    deformation::Wrench,
    error::StepDefect,
};

/// Contact of a zone with the shapes at one set of poses.
pub(super) struct Contact<'a> {
    pub(super) condensed: &'a Condensed,
    pub(super) zone: &'a Zone,
    pub(super) law: &'a ContactLaw,
    pub(super) step: ContactStep<'a>,
    pub(super) poses: &'a [Isometry3<f64>],
    pub(super) newton: &'a mut Newton,
}

/// Nodal forces tried by Newton's method, and the state of the surface under them.
pub(super) struct Trial {
    /// Applied nodal forces (m) in N.
    pub(super) forces: Vec<Vector3<f64>>,
    /// Displacement of all nodes of the zone in m.
    pub(super) displacement: Vec<Vector3<f64>>,
    pub(super) touches: Vec<Touch>,
    /// Residual force: contact force minus `forces` (m) in N.
    pub(super) excess: Vec<Vector3<f64>>,
    /// Norm of `excess` (N).
    imbalance: f64,
}

/// Initial guess for the balance.
#[derive(Clone, Default)]
pub(super) struct Guess {
    /// Forces on the free nodes in an earlier balance (m) in N.
    pub(super) forces: Vec<Vector3<f64>>,
    /// Touches in that balance.
    pub(super) touches: Vec<Touch>,
    /// Motion of the shape since then relative to each of these points, in m.
    pub(super) motion: Vec<Vector3<f64>>,
}

/// Change of the forces, with the change of displacement of the free nodes that it causes.
pub(super) struct NewtonStep {
    forces: Vec<Vector3<f64>>,
    pub(super) displacement: Vec<Vector3<f64>>,
}

/// Greatest number of Newton steps.
const MOST: usize = 40;
/// Accepted residual force, relative to the forces.
const RELATIVE: f64 = 1e-5;

impl Contact<'_> {
    /// Finds forces in balance near those of the `guess`, and returns them with the number of
    /// Newton steps taken. `offset` (m) is the displacement without forces. A residual of
    /// `tolerance` (N) or less is always accepted.
    pub(super) fn settle(
        &mut self,
        offset: &[Vector3<f64>],
        guess: Guess,
        tolerance: f64,
    ) -> Result<(Trial, usize)> {
        let not_converged = |iterations, residual| Error::NotConverged {
            iterations,
            residual,
            tolerance: tolerance.max(RELATIVE * residual),
        };
        let passed = Error::StepTooLong { defect: StepDefect::PassedSurface };
        let mut at = self.begin(offset, guess).ok_or(passed)?;
        for iterations in 0..MOST {
            if at.imbalance <= tolerance.max(RELATIVE * norm(&at.forces)) {
                return Ok((at, iterations));
            }
            let residual = at.imbalance;
            at = self.advance(offset, &at).ok_or(not_converged(iterations + 1, residual))?;
        }
        Err(not_converged(MOST, at.imbalance))
    }

    /// Returns the first state of Newton's method: the `guess` advanced by one linear step. `None`
    /// if a point is then on the far side of a shape.
    fn begin(&mut self, offset: &[Vector3<f64>], guess: Guess) -> Option<Trial> {
        let Guess { mut forces, mut touches, motion } = guess;
        let mut excess = vec![Vector3::zeros(); self.zone.free];
        if touches.is_empty() {
            let still = self.displaced(offset, &forces);
            touches = deepest(self.touches(&still)?);
            excess = self.nodal(&touches);
            excess.truncate(self.zone.free);
        }
        for (touch, motion) in touches.iter().zip(&motion) {
            let push = self.hessian(touch, false) * motion;
            for (node, share) in self.carriers(touch) {
                excess[node] += push * share;
            }
        }
        if let Some(changes) = self.newton_forces(&touches, &excess, false) {
            forces.iter_mut().zip(&changes).for_each(|(force, change)| *force += change);
        }
        let displacement = self.displaced(offset, &forces);
        self.trial(forces, displacement)
    }

    /// Displacement of the surface under `forces` (m); `offset` (m) is the displacement without
    /// them.
    fn displaced(&mut self, offset: &[Vector3<f64>], forces: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut displacement = offset.to_vec();
        for (u, du) in displacement.iter_mut().zip(self.respond(forces)) {
            *u += du;
        }
        displacement
    }

    /// Finds the touches on the surface displaced by `displacement`; `None` if a point is on the
    /// far side of a shape.
    pub(super) fn touches(&mut self, displacement: &[Vector3<f64>]) -> Option<Vec<Touch>> {
        let zone = self.zone;
        let place = |point: &SurfacePoint| point.place(&zone.places, displacement);
        let places: Vec<Point3<f64>> = zone.surface.iter().map(place).collect();
        let touches = self.step.touches(self.poses, &places);
        let deep = |touch: &Touch| touch.depth > self.law.deep();
        let through = |touch: &Touch| deep(touch) && self.step.passed_through(touch, self.poses);
        (!touches.iter().any(through)).then_some(touches)
    }

    /// Force of a shape at a touching point (N).
    pub(super) fn force(&self, touch: &Touch) -> Vector3<f64> {
        self.law.force(&self.zone.surface[touch.point as usize], touch)
    }

    /// Share of the normal force of `touches` that slides.
    pub(super) fn sliding(&self, touches: &[Touch]) -> f64 {
        self.law.sliding_share(touches.iter().map(|touch| (self.force(touch), touch.normal)))
    }

    /// Forces of `touches` on the nodes of the zone (N).
    pub(super) fn nodal(&self, touches: &[Touch]) -> Vec<Vector3<f64>> {
        let mut nodal = vec![Vector3::zeros(); self.zone.nodes.len()];
        for touch in touches {
            let force = self.force(touch);
            for &(node, share) in &self.zone.surface[touch.point as usize].shares {
                nodal[node as usize] += force * share;
            }
        }
        nodal
    }

    /// Resultant of `touches`.
    pub(super) fn wrench(&self, touches: &[Touch]) -> Wrench {
        Wrench::of_forces(touches.iter().map(|touch| (self.force(touch), touch.place.coords)))
    }

    fn trial(
        &mut self,
        forces: Vec<Vector3<f64>>,
        displacement: Vec<Vector3<f64>>,
    ) -> Option<Trial> {
        let touches = self.touches(&displacement)?;
        let mut excess = self.nodal(&touches);
        excess.truncate(self.zone.free);
        excess.iter_mut().zip(&forces).for_each(|(excess, force)| *excess -= force);
        let imbalance = norm(&excess);
        Some(Trial { forces, displacement, touches, excess, imbalance })
    }

    /// Returns the state after a `share` of `step`.
    pub(super) fn moved(&mut self, at: &Trial, step: &NewtonStep, share: f64) -> Option<Trial> {
        let add = |to: &[Vector3<f64>], change: &[Vector3<f64>]| {
            let mut sum = to.to_vec();
            sum.iter_mut().zip(change).for_each(|(x, dx)| *x += dx * share);
            sum
        };
        let forces = add(&at.forces, &step.forces);
        self.trial(forces, add(&at.displacement, &step.displacement))
    }

    /// Returns the state after one Newton step, or `None` if no acceptable step was found.
    fn advance(&mut self, offset: &[Vector3<f64>], at: &Trial) -> Option<Trial> {
        let some_are_free = at.touches.iter().any(|touch| self.is_free(touch));
        for exact in [true, false] {
            if exact && !some_are_free {
                continue;
            }
            let forces = self.newton_forces(&at.touches, &at.excess, exact)?;
            let displacement = self.respond(&forces);
            let step = NewtonStep { forces, displacement };
            let full = self.moved(at, &step, 1.0);
            if full.as_ref().is_some_and(|full| full.imbalance <= 0.5 * at.imbalance) {
                return full;
            }
            let found = self.line_search(offset, at, &step, full);
            if found.is_some() {
                return found;
            }
        }
        None
    }

    /// Returns whether a touching point can move along the shape: it slips, or has no friction.
    fn is_free(&self, touch: &Touch) -> bool {
        let point = &self.zone.surface[touch.point as usize];
        self.law.friction == 0.0 || self.law.limit_coupling(point, touch).is_some()
    }

    /// Stiffness of a touch (N/m). If `exact`, the friction limit follows the depth, and the normal
    /// the curvature of the shape; energy may rise along the step of such a stiffness.
    fn hessian(&self, touch: &Touch, exact: bool) -> Matrix3<f64> {
        let point = &self.zone.surface[touch.point as usize];
        let mut hessian = self.law.hessian(point, touch, self.law.limit(point, touch));
        if exact && self.is_free(touch) {
            hessian += self.law.limit_coupling(point, touch).unwrap_or_default();
            hessian += self.law.curvature_term(point, touch, &self.step.bend(touch, self.poses));
        }
        hessian * point.area
    }

    /// Free nodes that a touching point is interpolated from, with their weights.
    fn carriers(&self, touch: &Touch) -> impl Iterator<Item = (usize, f64)> + Clone {
        let zone = self.zone;
        let shares = zone.surface[touch.point as usize].shares.iter();
        let shares = shares.map(|&(node, share)| (node as usize, share));
        shares.filter(|&(node, _)| node < zone.free)
    }

    /// Newton step of the forces for the residual force `excess`.
    fn newton_forces(
        &mut self,
        touches: &[Touch],
        excess: &[Vector3<f64>],
        exact: bool,
    ) -> Option<Vec<Vector3<f64>>> {
        let stiffness =
            |touch: &Touch| (&self.zone.surface[touch.point as usize], self.hessian(touch, exact));
        let touching: Vec<_> = touches.iter().map(stiffness).collect();
        self.newton.solve(self.condensed, self.zone, &touching, excess)
    }

    /// Displacement of the free nodes under `forces` on them (m).
    fn respond(&mut self, forces: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        self.newton.respond(self.condensed, self.zone, forces)
    }
}

/// Keeps the touches at least half as deep as the deepest. They lie close to where a round shape
/// will touch, and an edge pushes none of them sideways.
fn deepest(mut touches: Vec<Touch>) -> Vec<Touch> {
    let deepest = touches.iter().map(|touch| touch.depth).fold(0.0, f64::max);
    touches.retain(|touch| touch.depth >= 0.5 * deepest);
    touches
}

pub(super) fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

pub(super) fn norm(a: &[Vector3<f64>]) -> f64 {
    dot(a, a).sqrt()
}
