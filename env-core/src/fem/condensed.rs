//! Contact solved on the few nodes that it involves.
//!
//! Within one Newton step the body is linear, A du = −g − c(u + du) with c the gradient of contact,
//! friction included, and all nonlinear terms act on the nodes (C) near the shapes. On these alone
//! the system reads S v + c(u_C + v) = b, with S the stiffness condensed to them: a small dense
//! system whose own Newton steps cost very little. The motion of the other nodes follows from it.
//!
//! Where A is not positive definite alone, it is condensed with the springs K of present contact
//! held in it, and S = S′ − K.

use faer::{Col, MatRef, Scale};
use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    dense::DenseFactor,
    direct::DirectSolver,
    gmres::norm,
    newton::Search,
    region::{NEAR, Region},
    springs::Spring,
    system::{Configuration, Forces, System},
};
use crate::contact::{ContactStep, Touch};

/// Most Newton steps of the small system.
const STEPS: usize = 30;
/// Shares of such a step that are tried with friction; the last is taken even if the residual
/// rises. Without friction whole steps converge, and shorter ones may end on the wrong side of an
/// edge.
const SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.125];
/// Exponent p: for N unknowns in all, a dense system of at most Nᵖ unknowns is used, since solving
/// it a few times costs less than factorising the sparse one.
const WORTH: f64 = 0.77;
/// Tolerance of the small system, as a part of the residual.
const INEXACT: f64 = 1e-4;

impl Search<'_, '_> {
    /// Takes a step in which contact is solved exactly and the body by a stiffness that may be an
    /// earlier step's, if it halves the residual; by the present stiffness, even if it does not.
    pub(super) fn condensed_step(
        &mut self,
        state: &mut Configuration,
        forces: &Forces,
        tolerance: f64,
    ) -> Option<Forces> {
        let holds = self.solver.region().is_some_and(|region| region.holds(&forces.touches));
        if self.push.is_some() || self.plain || !holds || !self.is_narrow(state) {
            return None;
        }
        if self.solver.is_condensed() {
            let next = self.balanced_steps(state, forces, tolerance);
            if next.is_ok() {
                return next.ok();
            }
        }
        if !self.solver.condense(self.system, forces) {
            return None;
        }
        match self.balanced_steps(state, forces, tolerance) {
            Ok(next) => Some(next),
            Err(step) => self.bold_step(state, forces, &step?),
        }
    }

    /// Takes the full step to the equilibrium of the linear body, first with contact near the
    /// shapes alone, then in the whole region, if it halves the residual. Returns the last step
    /// found if it does not.
    fn balanced_steps(
        &mut self,
        state: &mut Configuration,
        forces: &Forces,
        tolerance: f64,
    ) -> Result<Forces, Option<Vec<f64>>> {
        let limit = f64::max(0.1 * tolerance, INEXACT * norm(&self.residual(forces)));
        let mut last = None;
        for margin in [NEAR, f64::INFINITY] {
            let (contact, now) = (&mut *self.contact, (&*state, forces));
            let step = balanced_step(self.system, self.solver, contact, now, [margin, limit]);
            let Some(step) = step else { continue };
            if let Some(next) = self.full_step(state, forces, &step, tolerance) {
                return Ok(next);
            }
            last = Some(step);
        }
        Err(last)
    }

    /// Returns whether the points that may touch are few enough for a dense system.
    fn is_narrow(&mut self, state: &Configuration) -> bool {
        let Some(region) = self.solver.region() else { return false };
        let places = region.places(self.system, &state.displacement);
        let near = self.contact.within(NEAR, &region.points, &state.poses, &places);
        is_worth(3 * region.carriers(&near), self.solver.size())
    }
}

/// Step (unknowns) to the equilibrium of the linear body with contact up to `tolerance` (N), if
/// only points within `margin` (m) of the shapes come to touch; `None` if it is not found, or leads
/// through a shape.
fn balanced_step(
    system: &System,
    solver: &mut DirectSolver,
    contact: &mut ContactStep,
    (state, forces): (&Configuration, &Forces),
    [margin, tolerance]: [f64; 2],
) -> Option<Vec<f64>> {
    let mut unknowns: Vec<f64> = solver.gather(&forces.gradient).iter().map(|r| -r).collect();
    solver.solve_lower(&mut unknowns);
    let (region, condensed) = solver.condensed()?;
    let places = region.places(system, &state.displacement);
    let near = contact.within(margin, &region.points, &state.poses, &places);
    let count = 3 * region.carriers(&near);
    if !is_worth(count, unknowns.len()) {
        return None;
    }
    let (corner, stiffness, held) = condensed.of_last(count);
    let first = unknowns.len() - corner.nrows();
    let lower = Col::from_fn(corner.nrows(), |i| unknowns[first + i]);
    let start = region.points.iter().copied().zip(places).zip(&near);
    let start = start.filter(|(_, near)| **near).map(|(point, _)| point).unzip();
    let mut small = CondensedSystem {
        system,
        region,
        start,
        stiffness,
        held,
        poses: &state.poses,
        load: lower,
    };
    // The present contact is included in g.
    small.load = corner * &small.load + small.pushed(&forces.touches)?;
    let motion = small.balance(contact, tolerance, corner)?;
    let upper = corner.transpose() * &motion;
    upper.iter().zip(&mut unknowns[first..]).for_each(|(z, to)| *to = *z);
    solver.solve_upper(&mut unknowns);
    Some(unknowns)
}

/// Returns whether a dense system of `size` is used for this number of unknowns in all.
fn is_worth(size: usize, unknowns: usize) -> bool {
    size as f64 <= (unknowns as f64).powf(WORTH)
}

/// The system on the nodes of the points that may touch.
struct CondensedSystem<'a> {
    system: &'a System,
    region: &'a Region,
    /// Surface points that may touch, and their positions before the step.
    start: (Vec<u32>, Vec<Point3<f64>>),
    /// Lower triangle of S′.
    stiffness: MatRef<'a, f64>,
    /// Springs held in it.
    held: &'a [Spring],
    poses: &'a [Isometry3<f64>],
    /// Right-hand side b (N).
    load: Col<f64>,
}

impl CondensedSystem<'_> {
    /// Motion v of the nodes in equilibrium, by Newton's method with backtracking on the residual
    /// force; S′ = `corner` `corner`ᵀ.
    fn balance(
        &self,
        contact: &mut ContactStep,
        tolerance: f64,
        corner: MatRef<'_, f64>,
    ) -> Option<Col<f64>> {
        let mut motion = Col::zeros(self.load.nrows());
        let (mut touches, mut rest) = self.residual(contact, corner, &motion)?;
        let shares = if self.system.law.friction > 0.0 { &SHARES[..] } else { &SHARES[..1] };
        for _ in 0..STEPS {
            let size = rest.norm_l2();
            if size <= tolerance {
                return Some(motion);
            }
            let step = self.newton_step(contact, &touches, rest)?;
            let tried = shares.iter().find_map(|&share| {
                let moved = &motion + &step * Scale(share);
                let (touches, rest) = self.residual(contact, corner, &moved)?;
                let falls = rest.norm_l2() < size || Some(&share) == shares.last();
                falls.then_some((moved, touches, rest))
            });
            (motion, touches, rest) = tried?;
        }
        None
    }

    /// Touches when the nodes have moved, and the residual force; S′ = `corner` `corner`ᵀ.
    fn residual(
        &self,
        contact: &mut ContactStep,
        corner: MatRef<'_, f64>,
        motion: &Col<f64>,
    ) -> Option<(Vec<Touch>, Col<f64>)> {
        let touches = self.touches(contact, motion)?;
        let mut rest = &self.load - corner * (corner.transpose() * motion);
        rest -= self.pushed(&touches)?;
        for spring in self.held {
            let carriers = self.carriers(spring.point)?;
            let moved: Vector3<f64> = carriers.clone().map(|(i, s)| part(motion, i) * s).sum();
            add(&mut rest, &(spring.stiffness * moved), carriers);
        }
        Some((touches, rest))
    }

    /// Touches when the nodes have moved; `None` if a point came out on the far side of a shape.
    fn touches(&self, contact: &mut ContactStep, motion: &Col<f64>) -> Option<Vec<Touch>> {
        let (points, start) = &self.start;
        let moved = |(&c, start): (&u32, &Point3<f64>)| {
            let shift: Vector3<f64> = self.carriers(c)?.map(|(i, s)| part(motion, i) * s).sum();
            Some(start + shift)
        };
        let places: Vec<_> = points.iter().zip(start).map(moved).collect::<Option<_>>()?;
        let touches = contact.touches_among(points, self.poses, &places);
        let through = |touch: &Touch| {
            touch.depth > self.system.law.deep() && contact.passed_through(touch, self.poses)
        };
        (!touches.iter().any(through)).then_some(touches)
    }

    fn carriers(&self, point: u32) -> Option<impl Iterator<Item = (usize, f64)> + Clone> {
        self.region.carriers_among_last(self.load.nrows(), point)
    }

    /// Gradient c of contact: minus the forces of `touches` on the nodes.
    fn pushed(&self, touches: &[Touch]) -> Option<Col<f64>> {
        let mut sum = Col::zeros(self.load.nrows());
        for touch in touches {
            let force = self.system.contact_force(touch);
            add(&mut sum, &-force, self.carriers(touch.point)?);
        }
        Some(sum)
    }

    /// Newton step (S′ − K + ∂c)⁻¹ `rest`.
    fn newton_step(
        &self,
        contact: &ContactStep,
        touches: &[Touch],
        mut rest: Col<f64>,
    ) -> Option<Col<f64>> {
        let factor = |mut springs: Vec<Spring>| {
            springs.extend(self.held.iter().map(Spring::opposite));
            DenseFactor::new(self.region, self.stiffness, &springs)
        };
        // Where the curvature makes it unstable, it is solved as if the shape were flat.
        factor(self.system.curved_springs(touches, contact, self.poses))
            .or_else(|| factor(self.system.springs(touches)))?
            .solve(&mut rest);
        let finite = rest.iter().all(|x| x.is_finite());
        finite.then_some(rest)
    }
}

/// Adds `force` on a point to those on its carriers.
fn add(forces: &mut Col<f64>, force: &Vector3<f64>, carriers: impl Iterator<Item = (usize, f64)>) {
    for (i, share) in carriers {
        for k in 0..3 {
            forces[i + k] += force[k] * share;
        }
    }
}

/// Motion of the node whose unknowns begin at `i`.
fn part(motion: &Col<f64>, i: usize) -> Vector3<f64> {
    Vector3::new(motion[i], motion[i + 1], motion[i + 2])
}
