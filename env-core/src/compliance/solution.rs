//! One load step: the linear solution, then corrections by the forces of the body's own law.
//!
//! A correction is a step of modified Newton: the body's own law gives the elastic force g(u), the
//! stiffness at rest K relates the residual force to a displacement, and contact is solved again
//! with the offset u₀ = u − K⁻¹ g(u) instead of zero. This is a fixed-point iteration on u₀,
//! accelerated by [`Mixing`]. A correction is accepted only if it lowers the residual force; after
//! a rejected one, the plain step is tried at half its length, then at a quarter.
//!
//! Shapes: V nodes of the mesh, m free nodes of the zone.

use nalgebra::Vector3;

use super::{
    balance::{Contact, Guess, norm},
    condensed::Condensed,
    mixing::Mixing,
};
use crate::{
    Error, Result,
    contact::Touch,
    fem::{Linearised, SolverWorkspace},
};

/// Smallest share of a plain step that is tried.
const SHORTEST: f64 = 0.25;
/// Number of earlier corrections mixed with the last.
const REMEMBERED: usize = 5;
/// Residual allowed in the contact of a correction, relative to the residual force before it.
const INEXACT: f64 = 1e-3;

/// Displacement of the body: an offset plus the linear response to loads.
#[derive(Clone)]
pub(super) struct LinearDisplacement {
    /// Displacement (V) in m, known on the skin; inside the body only if corrections were asked
    /// for.
    pub(super) displacement: Vec<Vector3<f64>>,
    /// Part of the displacement that is not the response to the loads (V) in m.
    pub(super) offset: Vec<Vector3<f64>>,
    /// Applied nodal forces (V) in N.
    pub(super) loads: Vec<Vector3<f64>>,
}

impl LinearDisplacement {
    /// Displacement of all nodes (V) in m.
    pub(super) fn complete(
        &self,
        rest: &Linearised,
        space: &mut SolverWorkspace,
    ) -> Vec<Vector3<f64>> {
        let mut displacement = rest.displacement(&self.loads, space);
        displacement.iter_mut().zip(&self.offset).for_each(|(u, u0)| *u += u0);
        displacement
    }
}

/// Search for the solution of a load step.
pub(super) struct Solution<'a, 'b> {
    pub(super) condensed: &'a Condensed,
    pub(super) workspace: &'a mut SolverWorkspace,
    pub(super) contact: &'a mut Contact<'b>,
    /// Norm of the residual force at which the search ends (N).
    pub(super) tolerance: f64,
    /// Newton steps of the contact and corrections taken so far.
    pub(super) iterations: usize,
}

/// Displacement field with its contact in balance.
struct BalancedField {
    field: LinearDisplacement,
    /// Forces on the free nodes of the zone (m) in N.
    forces: Vec<Vector3<f64>>,
    touches: Vec<Touch>,
}

/// Iterate of the corrections: a field in balance with its residual force.
struct Iterate {
    settled: BalancedField,
    /// Change of the offset in a plain correction: K⁻¹ × residual force (V) in m.
    step: Vec<Vector3<f64>>,
    /// Norm of the residual force (N).
    residual: f64,
}

impl Solution<'_, '_> {
    /// Finds the solution near the `guess`, starting from `offset`, with at most so many
    /// `corrections`.
    pub(super) fn find(
        &mut self,
        offset: &[Vector3<f64>],
        guess: Guess,
        corrections: usize,
    ) -> Result<(LinearDisplacement, Vec<Touch>)> {
        let found = if corrections == 0 {
            self.settle(offset.to_vec(), guess, 0.0)?
        } else {
            self.corrected(offset, guess, corrections)?
        };
        Ok((found.field, found.touches))
    }

    fn corrected(
        &mut self,
        offset: &[Vector3<f64>],
        guess: Guess,
        corrections: usize,
    ) -> Result<BalancedField> {
        let mut best = self.begin(offset, guess)?;
        let (mut mixing, mut share) = (Mixing::new(REMEMBERED), 1.0);
        mixing.record(&best.settled.field.offset, &best.step);
        for _ in 0..corrections {
            if best.residual <= self.tolerance || share < SHORTEST {
                break;
            }
            self.iterations += 1;
            let from = &best.settled.field.offset;
            let plain = || from.iter().zip(&best.step).map(|(x, r)| x + r * share).collect();
            let next = if share == 1.0 { mixing.next(&mixing.shares()) } else { plain() };
            let guess = self.guess(&best.settled, &next);
            let tried = self.settle(next, guess, INEXACT * best.residual);
            let tried = tried.ok().and_then(|settled| self.judge(settled));
            if let Some(tried) = &tried {
                mixing.record(&tried.settled.field.offset, &tried.step);
            }
            match tried {
                Some(better) if better.residual < best.residual => (best, share) = (better, 1.0),
                _ => share *= 0.5,
            }
        }
        Ok(best.settled)
    }

    /// Solves contact with `offset` and without, and returns the result with the smaller residual
    /// force.
    fn begin(&mut self, offset: &[Vector3<f64>], guess: Guess) -> Result<Iterate> {
        let none = vec![Vector3::zeros(); offset.len()];
        let mut starts = Vec::new();
        if *offset != none[..]
            // The offset belongs to the previous step: contact may find no balance with it here.
            && let Ok(settled) = self.settle(offset.to_vec(), guess.clone(), 0.0)
        {
            starts.extend(self.judge(settled));
        }
        match self.settle(none, guess, 0.0) {
            Ok(settled) => starts.extend(self.judge(settled)),
            Err(error) if starts.is_empty() => return Err(error),
            Err(_) => {}
        }
        let least = starts.into_iter().min_by(|a, b| a.residual.total_cmp(&b.residual));
        least.ok_or(Error::Inverted)
    }

    /// Initial guess for the contact when the offset of `settled` becomes `next`.
    fn guess(&self, settled: &BalancedField, next: &[Vector3<f64>]) -> Guess {
        let zone = self.contact.zone;
        let change: Vec<_> = settled.field.offset.iter().zip(next).map(|(a, b)| a - b).collect();
        let change = zone.pick(&change);
        let motion = |touch: &Touch| zone.surface[touch.point as usize].interpolate(&change);
        Guess {
            forces: settled.forces.clone(),
            motion: settled.touches.iter().map(motion).collect(),
            touches: settled.touches.clone(),
        }
    }

    /// Solves contact with `offset`, near the `guess`, until its residual is `imbalance` (N) or a
    /// tenth of the tolerance, whichever is larger.
    fn settle(
        &mut self,
        offset: Vec<Vector3<f64>>,
        guess: Guess,
        imbalance: f64,
    ) -> Result<BalancedField> {
        let zone = self.contact.zone;
        let tolerance = imbalance.max(0.1 * self.tolerance);
        let (trial, iterations) = self.contact.settle(&zone.pick(&offset), guess, tolerance)?;
        self.iterations += iterations;
        let mut displacement = self.condensed.response(&zone.nodes, &trial.forces);
        displacement.iter_mut().zip(&offset).for_each(|(u, u0)| *u += u0);
        let loads = zone.spread(&trial.forces, offset.len());
        let field = LinearDisplacement { displacement, offset, loads };
        Ok(BalancedField { field, forces: trial.forces, touches: trial.touches })
    }

    /// Completes the displacement and computes the residual force; `None` if an element is
    /// inverted.
    fn judge(&mut self, mut settled: BalancedField) -> Option<Iterate> {
        let (rest, zone) = (&self.condensed.rest, self.contact.zone);
        settled.field.displacement = settled.field.complete(rest, self.workspace);
        let displacement = &settled.field.displacement;
        let elastic = rest.elastic_force(displacement, self.workspace)?;
        let mut left = zone.spread(&self.contact.nodal(&settled.touches), displacement.len());
        left.iter_mut().zip(&elastic).for_each(|(left, elastic)| *left -= elastic);
        rest.release(&mut left);
        let residual = norm(&left);
        let step = rest.displacement(&left, self.workspace);
        Some(Iterate { settled, step, residual })
    }
}
