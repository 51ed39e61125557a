//! One load step: the linear answer, then sweeps that correct it by the true residual.
//!
//! A sweep is a step of modified Newton: the body's own law gives the elastic force g(u), the
//! stiffness at rest carries what is out of balance, and contact is settled anew with the offset
//! u₀ = u − K⁻¹ g(u) in place of none. A step is taken, halved or dropped so that the unbalanced
//! force falls.
//!
//! Arrays have V entries; m is the number of free nodes of the contact's zone.

use nalgebra::Vector3;

use super::balance::{Contact, Guess};
use crate::{
    Error, Result,
    contact::Touch,
    fem::{Linearised, Workspace},
};

/// Shares of a sweep's step that are tried.
const SHARES: [f64; 3] = [1.0, 0.5, 0.25];

/// Displacement of the nodes, and its part that is not the linear response to contact (m).
#[derive(Clone)]
pub(super) struct Field {
    pub(super) displacement: Vec<Vector3<f64>>,
    pub(super) offset: Vec<Vector3<f64>>,
}

/// The search for a load step's solution.
pub(super) struct Solution<'a, 'b> {
    pub(super) rest: &'a Linearised,
    pub(super) workspace: &'a mut Workspace,
    pub(super) contact: &'a mut Contact<'b>,
    /// Norm of the unbalanced force that needs no further work (N).
    pub(super) tolerance: f64,
    /// Newton steps and sweeps so far.
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
    /// Elastic force (N).
    elastic: Vec<Vector3<f64>>,
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
        if sweeps == 0 {
            let settled = self.settle(offset.to_vec(), guess)?;
            return Ok((settled.field, settled.touches));
        }
        let mut best = self.begin(offset, guess)?;
        for _ in 0..sweeps {
            if best.residual <= self.tolerance {
                break;
            }
            self.iterations += 1;
            match self.sweep(&best)? {
                Some(better) => best = better,
                None => break,
            }
        }
        Ok((best.settled.field, best.settled.touches))
    }

    /// The linear answer with `offset` or without, whichever leaves less out of balance.
    fn begin(&mut self, offset: &[Vector3<f64>], guess: Guess) -> Result<Judged> {
        let none = vec![Vector3::zeros(); offset.len()];
        let mut starts = Vec::new();
        if *offset != none[..] {
            let settled = self.settle(offset.to_vec(), guess.clone())?;
            starts.extend(self.judge(settled));
        }
        let settled = self.settle(none, guess)?;
        starts.extend(self.judge(settled));
        let least = starts.into_iter().min_by(|a, b| a.residual.total_cmp(&b.residual));
        least.ok_or(Error::NotConverged {
            iterations: self.iterations,
            residual: f64::INFINITY,
            tolerance: self.tolerance,
        })
    }

    /// A better solution, or `None` if the sweep found none.
    fn sweep(&mut self, from: &Judged) -> Result<Option<Judged>> {
        let Field { displacement, offset } = &from.settled.field;
        let mut next = self.rest.displacement(&from.elastic, self.workspace);
        next.iter_mut().zip(displacement).for_each(|(x, u)| *x = u - *x);
        let guess = self.guess(&from.settled, &next);
        let target = self.settle(next, guess)?;
        for share in SHARES {
            let field = Field {
                displacement: blend(displacement, &target.field.displacement, share),
                offset: blend(offset, &target.field.offset, share),
            };
            let Some(touches) = self.contact.touches(&self.contact.zone.pick(&field.displacement))
            else {
                continue;
            };
            let forces = blend(&from.settled.forces, &target.forces, share);
            if let Some(judged) = self.judge(Settled { field, forces, touches })
                && judged.residual < from.residual
            {
                return Ok(Some(judged));
            }
        }
        Ok(None)
    }

    /// What `settled` makes expect when its offset becomes `next` (V).
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

    /// Lets the contact settle with `offset` (V), near the `guess`.
    fn settle(&mut self, offset: Vec<Vector3<f64>>, guess: Guess) -> Result<Settled> {
        let zone = self.contact.zone;
        let local = zone.pick(&offset);
        let (trial, iterations) = self.contact.settle(&local, guess, 0.1 * self.tolerance)?;
        self.iterations += iterations;
        let loads = zone.spread(&trial.forces, offset.len());
        let mut displacement = self.rest.displacement(&loads, self.workspace);
        displacement.iter_mut().zip(&offset).for_each(|(u, u0)| *u += u0);
        let field = Field { displacement, offset };
        Ok(Settled { field, forces: trial.forces, touches: trial.touches })
    }

    /// `None` if an element is inverted.
    fn judge(&mut self, settled: Settled) -> Option<Judged> {
        let displacement = &settled.field.displacement;
        let elastic = self.rest.elastic_force(displacement, self.workspace)?;
        let nodal = self.contact.nodal(&settled.touches);
        let contact = self.contact.zone.spread(&nodal, displacement.len());
        let residual = self.rest.imbalance(&elastic, &contact);
        Some(Judged { settled, elastic, residual })
    }
}

fn blend(from: &[Vector3<f64>], to: &[Vector3<f64>], share: f64) -> Vec<Vector3<f64>> {
    if share == 1.0 {
        return to.to_vec();
    }
    from.iter().zip(to).map(|(a, b)| a.lerp(b, share)).collect()
}
