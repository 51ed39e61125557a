//! Equilibrium by Newton's method with a line search on the energy.
//!
//! The stiffness is used as it is where it is positive definite. Where it is not, its diagonal is
//! raised step by step, and if that is not enough it is filtered element by element, which is safe
//! but slow near the end (Longva et al. 2023, "Pitfalls of projection"). Friction is a minimisation
//! only while its limits are held; they are renewed before every step. While points slip, the step
//! is first tried with the limits' dependence on depth: its matrix is unsymmetric, and is solved by
//! GMRES with the Cholesky factor as preconditioner.
//!
//! A press with given force has one more unknown, the travel of the shapes. Vectors of unknowns hold
//! three numbers for each free node, and then the travel if there is one.

use nalgebra::{Matrix3, Vector3};

use super::{
    gmres::gmres,
    sparse::Matrix,
    system::{Forces, State, Stiffness, System},
};
use crate::{
    Error, Result,
    contact::{ContactStep, Touch},
};

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Norm of the unbalanced force (N).
    pub(super) tolerance: f64,
    /// Newton steps.
    pub(super) iterations: usize,
}

/// A constant force with which the shapes are pushed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Push {
    pub(super) direction: Vector3<f64>,
    /// Force along `direction` (N).
    pub(super) force: f64,
}

/// How the search for an equilibrium ended.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Balance {
    pub(super) iterations: usize,
    /// Norm of the unbalanced force (N).
    pub(super) residual: f64,
}

/// Fraction of the expected fall of energy that a step must bring (Armijo).
const ARMIJO: f64 = 1e-4;
/// Shortest fraction of a Newton step that is tried.
const SHORTEST: f64 = 1e-6;
/// Longest travel of pushed shapes in one Newton step (m).
const LONGEST_TRAVEL: f64 = 5e-4;

/// Moves `state` to equilibrium within one load step.
pub(super) fn equilibrium(
    system: &System,
    matrix: &mut Matrix,
    state: &mut State,
    contact: &mut ContactStep,
    push: Option<&Push>,
    limits: &Limits,
) -> Result<(Balance, Forces)> {
    let mut search = Search { system, matrix, contact, push };
    let mut iterations = 0;
    let mut residual = f64::INFINITY;
    let mut found = system.forces(state, search.contact);
    while let Some(forces) = found {
        residual = norm(&search.residual(&forces));
        if residual <= limits.tolerance {
            return Ok((Balance { iterations, residual }, forces));
        }
        if iterations == limits.iterations {
            break;
        }
        iterations += 1;
        found = search.advance(state, &forces);
    }
    Err(Error::NotConverged { iterations, residual, tolerance: limits.tolerance })
}

struct Search<'a, 'b> {
    system: &'a System,
    matrix: &'a mut Matrix,
    contact: &'a mut ContactStep<'b>,
    push: Option<&'a Push>,
}

/// The travel's row and column of the stiffness matrix, eliminated.
struct Border {
    /// Coupling of the travel with the other unknowns.
    column: Vec<f64>,
    /// The matrix's solution for `column`.
    lifted: Vec<f64>,
    /// Stiffness of the travel when the body follows.
    schur: f64,
}

impl Search<'_, '_> {
    /// Gradient of the energy by the unknowns (N).
    fn residual(&self, forces: &Forces) -> Vec<f64> {
        let mut residual = self.system.pattern.gather(&forces.gradient);
        if let Some(push) = self.push {
            let along = |touch: &Touch| self.system.contact_force(touch).dot(&push.direction);
            residual.push(forces.touches.iter().map(along).sum::<f64>() - push.force);
        }
        residual
    }

    /// One Newton step from `state`, or `None` if none was found that lowers the energy.
    fn advance(&mut self, state: &mut State, forces: &Forces) -> Option<Forces> {
        let residual = self.residual(forces);
        for stiffness in Stiffness::SAFER {
            self.system.assemble(forces, self.matrix, stiffness);
            if !self.matrix.factorise(&self.system.pattern) {
                continue;
            }
            let border = self.border(forces);
            let mut step = residual.iter().map(|r| -r).collect::<Vec<_>>();
            self.solve(border.as_ref(), &mut step);
            let found = self
                .coupled_step(state, forces, border.as_ref(), &step)
                .or_else(|| self.line_search(state, forces, &step, dot(&step, &residual)));
            if found.is_some() {
                return found;
            }
        }
        None
    }

    fn border(&mut self, forces: &Forces) -> Option<Border> {
        let direction = self.push?.direction;
        let stiffness = |touch: &Touch| Some(self.system.contact_stiffness(touch));
        let mut unit = vec![0.0; self.system.pattern.size() + 1];
        *unit.last_mut()? = 1.0;
        let mut column = self.contact_product(&forces.touches, stiffness, &unit, Some(direction));
        let corner = column.pop()?;
        let mut lifted = column.clone();
        self.matrix.solve(&self.system.pattern, &mut lifted);
        let schur = corner - dot(&column, &lifted);
        Some(Border { column, lifted, schur })
    }

    /// Multiplies by the inverse of the stiffness matrix.
    fn solve(&mut self, border: Option<&Border>, right: &mut Vec<f64>) {
        let last = if border.is_some() { right.pop() } else { None };
        self.matrix.solve(&self.system.pattern, right);
        if let (Some(border), Some(last)) = (border, last) {
            let pull = last - dot(&border.column, right);
            // Shapes that have lost touch have no stiffness, and go as far as they may.
            let travel = if border.schur > 0.0 { pull / border.schur } else { pull.signum() };
            let travel = travel.clamp(-LONGEST_TRAVEL, LONGEST_TRAVEL);
            right.iter_mut().zip(&border.lifted).for_each(|(x, lift)| *x -= lift * travel);
            right.push(travel);
        }
    }

    /// Sum over the touches of `stiffness` times the relative motion `unknowns`, as forces on the
    /// unknowns.
    fn contact_product(
        &self,
        touches: &[Touch],
        stiffness: impl Fn(&Touch) -> Option<Matrix3<f64>>,
        unknowns: &[f64],
        direction: Option<Vector3<f64>>,
    ) -> Vec<f64> {
        let moved = self.system.pattern.scatter(unknowns);
        let travel = direction.map_or(Vector3::zeros(), |d| d * unknowns[unknowns.len() - 1]);
        let (mut forces, mut total) = (vec![Vector3::zeros(); moved.len()], Vector3::zeros());
        for touch in touches {
            let Some(stiffness) = stiffness(touch) else { continue };
            let point = &self.system.surface[touch.point as usize];
            let force = stiffness * (point.interpolate(&moved) - travel);
            total += force;
            for &(node, share) in &point.shares {
                forces[node as usize] += force * share;
            }
        }
        let mut product = self.system.pattern.gather(&forces);
        product.extend(direction.map(|d| -d.dot(&total)));
        product
    }

    /// The full step with friction limits that follow the depth, if points slip and it halves the
    /// residual.
    fn coupled_step(
        &mut self,
        state: &mut State,
        forces: &Forces,
        border: Option<&Border>,
        step: &[f64],
    ) -> Option<Forces> {
        let system = self.system;
        let coupling = |touch: &Touch| {
            let point = &system.surface[touch.point as usize];
            Some(system.law.limit_coupling(point, touch)? * point.area)
        };
        if !forces.touches.iter().any(|touch| coupling(touch).is_some()) {
            return None;
        }
        let direction = self.push.map(|push| push.direction);
        let product = |x: &[f64]| {
            let mut y = self.contact_product(&forces.touches, coupling, x, direction);
            self.solve(border, &mut y);
            y.iter_mut().zip(x).for_each(|(y, x)| *y += x);
            y
        };
        let step = gmres(product, step).x;
        let trial = self.moved(state, &step, 1.0);
        let next = self.system.forces(&trial, self.contact)?;
        if norm(&self.residual(&next)) > 0.5 * norm(&self.residual(forces)) {
            return None;
        }
        *state = trial;
        Some(next)
    }

    /// Backtracks along `step` until the energy has fallen enough for its `slope` (Armijo).
    fn line_search(
        &mut self,
        state: &mut State,
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
                // Near the end the fall of energy drowns in rounding, but the force does not.
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

    fn moved(&self, state: &State, step: &[f64], share: f64) -> State {
        let mut moved = state.clone();
        let change = self.system.pattern.scatter(step);
        for (u, du) in moved.displacement.iter_mut().zip(&change) {
            *u += du * share;
        }
        if let Some(push) = self.push {
            let travel = push.direction * (share * step[step.len() - 1]);
            moved.poses.iter_mut().for_each(|pose| pose.translation.vector += travel);
        }
        moved
    }

    /// Energy with friction cut at `limits`, less the work of the push (J).
    fn energy(&self, state: &State, forces: &Forces, limits: &FrictionLimits) -> f64 {
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

/// The friction limit of every pair of shape and surface point while a step is searched (Pa).
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

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}
