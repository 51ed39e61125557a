//! Sweeps until the forces are in balance with the shapes at their poses.
//!
//! Forward and backward sweeps converge slowly where many nodes touch, because the remaining error
//! varies little from node to node. Pairs of sweeps are therefore mixed with earlier ones
//! ([`Mixing`]). Displacements are mixed with the same shares as the forces that cause them, so no
//! response is recomputed.

use nalgebra::Vector3;

use super::{super::mixing::Mixing, patch::Patch};
use crate::{Error, Result};

/// Number of sweeps between measurements of the distances: two pairs.
const SWEEPS: usize = 4;
/// Greatest number of measurements.
const MOST: usize = 60;
/// Accepted change of a force in one sweep, relative to the largest force.
const RELATIVE: f64 = 5e-4;
/// Change of a force that counts as none (N).
const NONE: f64 = 1e-9;
/// Number of earlier pairs mixed with the last. Two halve the number of sweeps under a wide block;
/// more bring no further gain.
const MIXED: usize = 2;

impl Patch<'_> {
    /// Brings the forces into balance and returns the number of sweeps taken.
    pub(super) fn settle(&mut self) -> Result<usize> {
        let sweeps = self.settle_to(RELATIVE, MIXED)?;
        self.catch_up();
        Ok(sweeps)
    }

    /// Performs [`Patch::settle`] until no force changes by more than `relative` × the largest
    /// force, mixing with `mixed` earlier pairs.
    fn settle_to(&mut self, relative: f64, mixed: usize) -> Result<usize> {
        // Change of a force in the first sweep after the distances were last measured, and force.
        let (mut sweeps, mut first, mut strongest) = (0, 0.0, 0.0);
        let mut past = Past::new(mixed);
        for _ in 0..MOST {
            if !self.measure() {
                return Ok(sweeps);
            }
            let mut before = Vec::new();
            for sweep in 0..SWEEPS {
                let back = sweep % 2 == 1;
                if !back {
                    before = self.forces();
                }
                let change;
                (change, strongest) = self.sweep(back);
                sweeps += 1;
                if sweep == 0 {
                    first = change;
                }
                if change <= relative * strongest + NONE {
                    if sweep == 0 {
                        return Ok(sweeps);
                    }
                    break;
                }
                if back {
                    self.mix(&mut past, &before);
                }
            }
        }
        let tolerance = relative * strongest;
        Err(Error::NotConverged { iterations: sweeps, residual: first, tolerance })
    }

    /// Mixes the last pair of sweeps, which began with the forces `before`, with those of the
    /// `past`.
    fn mix(&mut self, past: &mut Past, before: &[Vector3<f64>]) {
        let step: Vec<_> = self.forces().iter().zip(before).map(|(f, b)| f - b).collect();
        let touching = self.members.iter().map(|member| member.target.is_some()).collect();
        let runs = self.runs.iter().map(|&[first, last]| first..last);
        let here: Vec<f32> =
            runs.clone().flat_map(|run| &self.displacement[run]).copied().collect();
        let (forces, moved) = past.mixed(touching, before, &step, here);
        self.members.iter_mut().zip(forces).for_each(|(member, force)| member.force = force);
        let mut moved = moved.into_iter();
        for run in runs {
            self.displacement[run].iter_mut().zip(&mut moved).for_each(|(u, to)| *u = to);
        }
    }

    fn forces(&self) -> Vec<Vector3<f64>> {
        self.members.iter().map(|member| member.force).collect()
    }
}

/// Record of the last pairs of sweeps over the same touching nodes.
struct Past {
    depth: usize,
    touching: Vec<bool>,
    mixing: Mixing,
    /// Displacement of the runs after each pair.
    ends: Vec<Vec<f32>>,
    /// Squared norm of the change of the forces in the last pair (N²).
    change: f64,
}

impl Past {
    fn new(depth: usize) -> Self {
        let (mixing, touching, ends) = (Mixing::new(depth), Vec::new(), Vec::new());
        Self { depth, touching, mixing, ends, change: f64::INFINITY }
    }

    /// Mixes a pair of sweeps with the pairs before it and returns forces and displacements. The
    /// pair went over the `touching` nodes, changed the forces `before` by `step` and ended with
    /// the displacements `here`. Earlier pairs are discarded if other nodes touched in them or if
    /// the change of the forces has grown.
    fn mixed(
        &mut self,
        touching: Vec<bool>,
        before: &[Vector3<f64>],
        step: &[Vector3<f64>],
        here: Vec<f32>,
    ) -> (Vec<Vector3<f64>>, Vec<f32>) {
        let change = step.iter().map(Vector3::norm_squared).sum();
        if touching != self.touching || change > self.change {
            *self = Self { touching, ..Self::new(self.depth) };
        }
        self.change = change;
        self.mixing.record(before, step);
        let shares = self.mixing.shares();
        let mut moved = here.clone();
        for (end, share) in self.ends.iter().zip(&shares) {
            let away = end.iter().zip(&here).map(|(end, here)| end - here);
            moved.iter_mut().zip(away).for_each(|(u, away)| *u += *share as f32 * away);
        }
        self.ends.push(here);
        if self.ends.len() > self.depth {
            self.ends.remove(0);
        }
        (self.mixing.next(&shares), moved)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::Isometry3;

    use super::*;
    use crate::{
        compliance::{
            Compliance, ComplianceOptions,
            nodal::{
                contact_nodes::ContactNodes,
                patch::{Move, NodalScratch},
            },
        },
        deformation::{Moduli, SoftBody},
        geometry::{PadMesh, PadOutline, Shape},
    };

    /// Forces under a block of 12 mm pressed by 0.2 mm and sheared by `aside` (m), and the number
    /// of sweeps taken.
    fn under_a_block(relative: f64, mixed: usize, aside: f64) -> (Vec<Vector3<f64>>, usize) {
        let pad = PadMesh::with_nodes(&PadOutline::flat(0.02, 0.02, 0.004), 900).unwrap();
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let body = SoftBody::new(pad.mesh, crate::deformation::Law::default(), moduli, &pad.base);
        let model =
            Compliance::new(body.unwrap(), ComplianceOptions { friction: 0.8, corrections: 0 })
                .unwrap();
        let nodes = ContactNodes::new(Arc::clone(&model.condensed));
        let shapes = [Shape::Cuboid { half_extents: Vector3::repeat(6e-3) }];
        let [from, to] =
            [(0.0, 6e-3), (aside, 5.8e-3)].map(|(x, z)| [Isometry3::translation(x, 3e-4, z)]);
        let motion = Move { shapes: &shapes, from: &from, to: &to };
        let mut scratch = NodalScratch::default();
        let law = &model.settings.law;
        let reach = [f64::INFINITY, 1e-3];
        let patch = Patch::new(&nodes, law, motion, reach, usize::MAX, &[], &mut scratch);
        let mut patch = patch.unwrap();
        let sweeps = patch.settle_to(relative, mixed).unwrap();
        (patch.forces(), sweeps)
    }

    #[test]
    fn mixed_sweeps_end_where_plain_ones_do_and_sooner() {
        for aside in [0.0, 1e-4, 4e-4] {
            let (plain, slow) = under_a_block(1e-5, 0, aside);
            let (mixed, quick) = under_a_block(1e-5, MIXED, aside);
            let norm = |forces: &[Vector3<f64>]| {
                forces.iter().map(Vector3::norm_squared).sum::<f64>().sqrt()
            };
            let apart: Vec<_> = plain.iter().zip(&mixed).map(|(a, b)| a - b).collect();
            let error = norm(&apart) / norm(&plain);
            assert!(error < 1e-3, "{aside} m aside: forces are {error:.1e} apart");
            assert!(4 * quick < 3 * slow, "{aside} m aside: {quick} sweeps against {slow}");
        }
    }
}
