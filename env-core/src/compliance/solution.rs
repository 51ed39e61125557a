//! One load step: the linear answer, then sweeps that correct it by the true forces.
//!
//! A sweep is a step of modified Newton: the body's own law gives the elastic force g(u), the
//! stiffness at rest K carries what is out of balance, and contact is settled anew with the offset
//! u₀ = u − K⁻¹ g(u) in place of none. That is a fixed-point iteration on u₀, and it is accelerated
//! ([`Mixing`]). A sweep is taken only if it lowers the unbalanced force; after one that did not, the
//! plain step is tried at half its length, then at a quarter.
//!
//! Arrays have V entries.

use nalgebra::Vector3;

use super::{
    balance::{Contact, Guess, norm},
    condensed::Condensed,
    mixing::Mixing,
};
use crate::{
    Error, Result,
    contact::Touch,
    fem::{Linearised, Workspace},
};

/// Shortest share of a plain step that is tried.
const SHORTEST: f64 = 0.25;
/// Sweeps that are mixed with the last.
const REMEMBERED: usize = 5;
/// Imbalance left in the contact of a sweep, relative to the unbalanced force before it.
const INEXACT: f64 = 1e-3;

/// Displacement of the body: its own offset and the linear response to loads.
#[derive(Clone)]
pub(super) struct Field {
    /// Displacement (m), known on the skin; inside the body where sweeps were asked for.
    pub(super) displacement: Vec<Vector3<f64>>,
    /// Its part that is not the response to the loads (m).
    pub(super) offset: Vec<Vector3<f64>>,
    /// Forces that the body gives way to (N).
    pub(super) loads: Vec<Vector3<f64>>,
}

impl Field {
    /// The displacement of all nodes (m).
    pub(super) fn complete(&self, rest: &Linearised, space: &mut Workspace) -> Vec<Vector3<f64>> {
        let mut displacement = rest.displacement(&self.loads, space);
        displacement.iter_mut().zip(&self.offset).for_each(|(u, u0)| *u += u0);
        displacement
    }
}

/// The search for a load step's solution.
pub(super) struct Solution<'a, 'b> {
    pub(super) condensed: &'a Condensed,
    pub(super) workspace: &'a mut Workspace,
    pub(super) contact: &'a mut Contact<'b>,
    /// Norm of the unbalanced force that needs no further work (N).
    pub(super) tolerance: f64,
    /// Newton steps of the contact and sweeps so far.
    pub(super) iterations: usize,
}

/// A field whose contact has settled.
struct Settled {
    field: Field,
    /// Forces on the free nodes of the zone (m).
    forces: Vec<Vector3<f64>>,
    touches: Vec<Touch>,
}

/// A settled field and how far its true forces are out of balance.
struct Judged {
    settled: Settled,
    /// What a plain sweep adds to the offset: K⁻¹ of the unbalanced force (m).
    step: Vec<Vector3<f64>>,
    /// Norm of the unbalanced force (N).
    residual: f64,
}

impl Solution<'_, '_> {
    /// The solution near the `guess` after at most `sweeps`, begun with `offset`.
    pub(super) fn find(
        &mut self,
        offset: &[Vector3<f64>],
        guess: Guess,
        sweeps: usize,
    ) -> Result<(Field, Vec<Touch>)> {
        let found = if sweeps == 0 {
            self.settle(offset.to_vec(), guess, 0.0)?
        } else {
            self.swept(offset, guess, sweeps)?
        };
        Ok((found.field, found.touches))
    }

    fn swept(&mut self, offset: &[Vector3<f64>], guess: Guess, sweeps: usize) -> Result<Settled> {
        let mut best = self.begin(offset, guess)?;
        let (mut mixing, mut share) = (Mixing::new(REMEMBERED), 1.0);
        mixing.record(&best.settled.field.offset, &best.step);
        for _ in 0..sweeps {
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

    /// The linear answer with `offset` or without, whichever leaves less out of balance.
    fn begin(&mut self, offset: &[Vector3<f64>], guess: Guess) -> Result<Judged> {
        let none = vec![Vector3::zeros(); offset.len()];
        let mut starts = Vec::new();
        if *offset != none[..]
            // What the offset fits is the step before: contact may find no balance with it here.
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

    /// What `settled` makes expect when its offset becomes `next`.
    fn guess(&self, settled: &Settled, next: &[Vector3<f64>]) -> Guess {
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

    /// Lets the contact settle with `offset`, near the `guess`, until `imbalance` (N) is left.
    fn settle(
        &mut self,
        offset: Vec<Vector3<f64>>,
        guess: Guess,
        imbalance: f64,
    ) -> Result<Settled> {
        let zone = self.contact.zone;
        let tolerance = imbalance.max(0.1 * self.tolerance);
        let (trial, iterations) = self.contact.settle(&zone.pick(&offset), guess, tolerance)?;
        self.iterations += iterations;
        let mut displacement = self.condensed.response(&zone.nodes, &trial.forces);
        displacement.iter_mut().zip(&offset).for_each(|(u, u0)| *u += u0);
        let loads = zone.spread(&trial.forces, offset.len());
        let field = Field { displacement, offset, loads };
        Ok(Settled { field, forces: trial.forces, touches: trial.touches })
    }

    /// Completes the displacement and compares the forces; `None` if an element is inverted.
    fn judge(&mut self, mut settled: Settled) -> Option<Judged> {
        let (rest, zone) = (&self.condensed.rest, self.contact.zone);
        settled.field.displacement = settled.field.complete(rest, self.workspace);
        let displacement = &settled.field.displacement;
        let elastic = rest.elastic_force(displacement, self.workspace)?;
        let mut left = zone.spread(&self.contact.nodal(&settled.touches), displacement.len());
        left.iter_mut().zip(&elastic).for_each(|(left, elastic)| *left -= elastic);
        rest.release(&mut left);
        let residual = norm(&left);
        let step = rest.displacement(&left, self.workspace);
        Some(Judged { settled, step, residual })
    }
}
