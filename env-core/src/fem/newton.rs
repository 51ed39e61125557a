//! Equilibrium by Newton's method with a line search on the energy.
//!
//! A step is first tried with contact solved on its own nodes ([`super::condensed`]); it may raise
//! the residual for a few steps, but not the energy. If that fails, or contact involves too many
//! nodes, it is tried with the factor of an earlier step, corrected by GMRES for the contact
//! springs that are missing in it. The other methods are used if that fails, too, and for pushes.
//!
//! The stiffness is used unchanged where it is positive definite. Where it is not, its diagonal is
//! raised step by step, and if that is not enough it is filtered element by element, which is safe
//! but slow near the end (Longva et al. 2023, "Pitfalls of projection"). Friction is a minimisation
//! only while its limits are held fixed; they are renewed before every step. While points slip, the
//! step is first tried with the limits' dependence on depth: its matrix is unsymmetric, and is
//! solved by GMRES with the Cholesky factor as preconditioner.
//!
//! A press with given force has one more unknown, the travel of the shapes. Vectors of unknowns
//! hold three numbers for each free node, and then the travel if there is one.

use super::{
    direct::DirectSolver,
    gmres::{GmresSolution, dot, gmres, norm},
    push::{Border, ForceControl, product, solve},
    springs::{Spring, missing},
    system::{Configuration, Forces, Stiffness, System},
};
use crate::{
    Error, Result,
    contact::{ContactStep, Touch},
    interrupt,
};

/// Stopping criteria of the search for an equilibrium.
#[derive(Clone, Copy, Debug)]
pub(super) struct StoppingCriteria {
    /// Norm of the residual force (N).
    pub(super) tolerance: f64,
    /// Most Newton steps.
    pub(super) iterations: usize,
    /// Value of [`FemOptions::patience`](super::FemOptions).
    pub(super) patience: usize,
    /// `true` if every step is Newton's on the whole body, with a factor of its own: slow, and the
    /// reference for the fast methods.
    pub(super) plain: bool,
}

/// Outcome of the search for an equilibrium.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct NewtonOutcome {
    pub(super) iterations: usize,
    /// Norm of the residual force (N).
    pub(super) residual: f64,
}

/// Fraction of the expected decrease of energy that a step must achieve (Armijo).
const ARMIJO: f64 = 1e-4;
/// Largest part of the residual that may remain after a step by an earlier stiffness.
const HALF: f64 = 0.5;
/// Largest ratio of the residual to the lowest one after a step that does not halve it.
const RISE: f64 = 4.0;
/// Number of steps in a row that do not halve the lowest residual, above which the energy has to
/// decrease.
const DETOUR: u32 = 5;
/// Number of such steps that cost about as much as a factorisation.
const PATIENCE: f64 = 4.0;
/// Shortest fraction of a Newton step that is tried.
const SHORTEST: f64 = 1e-6;

/// Moves `state` to equilibrium within one load step.
pub(super) fn equilibrium(
    system: &System,
    solver: &mut DirectSolver,
    state: &mut Configuration,
    contact: &mut ContactStep,
    push: Option<&ForceControl>,
    limits: &StoppingCriteria,
) -> Result<(NewtonOutcome, Forces)> {
    let plain = limits.plain;
    let mut search =
        Search { system, solver, contact, push, plain, lowest: f64::INFINITY, above: 0 };
    let mut iterations = 0;
    let mut residual = f64::INFINITY;
    let mut found = system.forces(state, search.contact);
    while let Some(forces) = found {
        residual = norm(&search.residual(&forces));
        search.compare(residual);
        if residual <= limits.tolerance {
            return Ok((NewtonOutcome { iterations, residual }, forces));
        }
        if iterations == limits.iterations {
            break;
        }
        interrupt::check()?;
        iterations += 1;
        found = search.advance(state, &forces, limits.tolerance);
    }
    Err(Error::NotConverged { iterations, residual, tolerance: limits.tolerance })
}

/// A search for an equilibrium.
pub(super) struct Search<'a, 'b> {
    pub(super) system: &'a System,
    pub(super) solver: &'a mut DirectSolver,
    pub(super) contact: &'a mut ContactStep<'b>,
    pub(super) push: Option<&'a ForceControl>,
    /// Value of [`StoppingCriteria::plain`].
    pub(super) plain: bool,
    /// Residual (N) that later ones are compared with.
    lowest: f64,
    /// Number of steps taken since it was last halved.
    above: u32,
}

impl Search<'_, '_> {
    /// Gradient of the energy with respect to the unknowns (N).
    pub(super) fn residual(&self, forces: &Forces) -> Vec<f64> {
        let mut residual = self.solver.gather(&forces.gradient);
        if let Some(push) = self.push {
            let along = |touch: &Touch| self.system.contact_force(touch).dot(&push.direction);
            residual.push(forces.touches.iter().map(along).sum::<f64>() - push.force);
        }
        residual
    }

    /// Compares a `residual` (N) with the lowest.
    fn compare(&mut self, residual: f64) {
        if residual <= HALF * self.lowest {
            (self.lowest, self.above) = (residual, 0);
        } else {
            self.above += 1;
        }
    }

    /// Takes one Newton step from `state`; `None` if none was found that lowers the energy.
    fn advance(
        &mut self,
        state: &mut Configuration,
        forces: &Forces,
        tolerance: f64,
    ) -> Option<Forces> {
        if let Some(next) = self.condensed_step(state, forces, tolerance) {
            return Some(next);
        }
        (self.lowest, self.above) = (f64::INFINITY, 0);
        self.solver.make_hold(self.system, &forces.touches);
        let springs = self.system.curved_springs(&forces.touches, self.contact, &state.poses);
        if let Some(next) = self.kept_step(state, forces, &springs, tolerance) {
            return Some(next);
        }
        let residual = self.residual(forces);
        for stiffness in Stiffness::SAFER {
            // The next attempt at a load step checks again, and returns the error.
            if interrupt::check().is_err() {
                return None;
            }
            if !self.solver.factorise(self.system, forces, stiffness) {
                continue;
            }
            let border = self.push.map(|push| Border::new(self.system, self.solver, push));
            let mut step = residual.iter().map(|r| -r).collect::<Vec<_>>();
            solve(self.solver, border.as_ref(), &mut step);
            let missing = missing(&springs, self.solver.springs());
            let found = self
                .coupled_step(state, forces, &missing, (border.as_ref(), &step), tolerance)
                .or_else(|| self.line_search(state, forces, &step, dot(&step, &residual)));
            if found.is_some() {
                return found;
            }
        }
        None
    }

    /// Takes the full step by the elastic stiffness of an earlier step with present contact, if it
    /// halves the residual.
    fn kept_step(
        &mut self,
        state: &mut Configuration,
        forces: &Forces,
        springs: &[Spring],
        tolerance: f64,
    ) -> Option<Forces> {
        if self.push.is_some() || self.plain {
            return None;
        }
        let missing = missing(springs, self.solver.kept()?);
        let mut step = self.residual(forces).iter().map(|r| -r).collect();
        solve(self.solver, None, &mut step);
        let found = self.with_springs(&missing, None, &step);
        if !found.converged {
            return None;
        }
        self.full_step(state, forces, &found.x, tolerance)
    }

    /// Takes the full step with friction limits that follow the depth, if points slip and it halves
    /// the residual.
    fn coupled_step(
        &mut self,
        state: &mut Configuration,
        forces: &Forces,
        missing: &[Spring],
        (border, step): (Option<&Border>, &[f64]),
        tolerance: f64,
    ) -> Option<Forces> {
        if missing.is_empty() {
            return None;
        }
        let step = self.with_springs(missing, border, step).x;
        self.full_step(state, forces, &step, tolerance)
    }

    /// Corrects the `step` of the stiffness that was factorised last for the springs that are
    /// `missing` in it.
    fn with_springs(
        &mut self,
        missing: &[Spring],
        border: Option<&Border>,
        step: &[f64],
    ) -> GmresSolution {
        let product = |x: &[f64]| {
            let mut y = product(self.system, self.solver, missing, x, self.push);
            solve(self.solver, border, &mut y);
            y.iter_mut().zip(x).for_each(|(y, x)| *y += x);
            y
        };
        gmres(product, step)
    }

    /// Takes the full `step` if it halves the residual. Discards the factor if convergence at this
    /// rate would take more steps than a new factor is worth.
    pub(super) fn full_step(
        &mut self,
        state: &mut Configuration,
        forces: &Forces,
        step: &[f64],
        tolerance: f64,
    ) -> Option<Forces> {
        let trial = self.moved(state, step, 1.0);
        let next = self.system.forces(&trial, self.contact)?;
        let [before, after] = [forces, &next].map(|forces| norm(&self.residual(forces)));
        if after > HALF * before {
            return None;
        }
        let far = (after / tolerance).ln() > PATIENCE * (before / after).ln();
        if after > tolerance && far {
            self.solver.forget();
        }
        *state = trial;
        Some(next)
    }

    /// Takes the full `step` by a stiffness of the present state, unless the energy rises, or the
    /// residual rises far above the lowest or has not been halved for long. Where the body is bent
    /// much, the residual rises first and then falls the faster.
    pub(super) fn bold_step(
        &mut self,
        state: &mut Configuration,
        forces: &Forces,
        step: &[f64],
    ) -> Option<Forces> {
        let trial = self.moved(state, step, 1.0);
        let next = self.system.forces(&trial, self.contact)?;
        let after = norm(&self.residual(&next));
        if after > RISE * self.lowest || self.above >= DETOUR {
            return None;
        }
        let limits = self.friction_limits(&forces.touches);
        if self.energy(&trial, &next, &limits) > self.energy(state, forces, &limits) {
            return None;
        }
        self.solver.forget();
        *state = trial;
        Some(next)
    }

    /// Backtracks along `step` until the energy has decreased enough for its `slope` (Armijo).
    fn line_search(
        &mut self,
        state: &mut Configuration,
        forces: &Forces,
        step: &[f64],
        slope: f64,
    ) -> Option<Forces> {
        if slope >= 0.0 {
            return None;
        }
        let limits = self.friction_limits(&forces.touches);
        let energy = self.energy(state, forces, &limits);
        let rounding = 1e-10 * energy.abs().max(forces.elastic);
        let mut share = 1.0;
        while share > SHORTEST {
            let trial = self.moved(state, step, share);
            if let Some(next) = self.system.forces(&trial, self.contact) {
                let change = self.energy(&trial, &next, &limits) - energy;
                // Near convergence the decrease of energy is lost in rounding, but that of the
                // force is not.
                let drowned = -slope < rounding && {
                    norm(&self.residual(&next)) < norm(&self.residual(forces))
                };
                if drowned || change <= ARMIJO * share * slope {
                    *state = trial;
                    return Some(next);
                }
            }
            share *= 0.5;
        }
        None
    }

    /// Returns `state` after a `share` of a `step`.
    pub(super) fn moved(&self, state: &Configuration, step: &[f64], share: f64) -> Configuration {
        let mut moved = state.clone();
        let change = self.solver.scatter(step);
        for (u, du) in moved.displacement.iter_mut().zip(&change) {
            *u += du * share;
        }
        if let Some(push) = self.push {
            let travel = push.direction * (share * step[step.len() - 1]);
            moved.poses.iter_mut().for_each(|pose| pose.translation.vector += travel);
        }
        moved
    }

    /// Energy with friction limited to `limits`, less the work of the push (J).
    fn energy(&self, state: &Configuration, forces: &Forces, limits: &FrictionLimits) -> f64 {
        let work = self.push.map_or(0.0, |push| {
            push.force * push.direction.dot(&state.poses[0].translation.vector)
        });
        forces.elastic + self.system.contact_energy(&forces.touches, |t| limits.of(t)) - work
    }

    fn friction_limits(&self, touches: &[Touch]) -> FrictionLimits {
        let surface = &self.system.surface;
        let shapes = touches.iter().map(|touch| touch.shape as usize + 1).max().unwrap_or(0);
        let mut of_pair = vec![0.0; shapes * surface.len()];
        for touch in touches {
            let limit = self.system.law.limit(&surface[touch.point as usize], touch);
            of_pair[touch.shape as usize * surface.len() + touch.point as usize] = limit;
        }
        FrictionLimits { points: surface.len(), of_pair }
    }
}

/// Friction limit of every pair of shape and surface point while a step is searched (Pa).
struct FrictionLimits {
    points: usize,
    of_pair: Vec<f64>,
}

impl FrictionLimits {
    /// The limit at a touch; 0 for a pair that did not touch when the search began.
    fn of(&self, touch: &Touch) -> f64 {
        let pair = touch.shape as usize * self.points + touch.point as usize;
        self.of_pair.get(pair).copied().unwrap_or(0.0)
    }
}
