//! The stiffness matrix of one run, its factor, and its condensation to a contact region.
//!
//! With the unknowns of the region's nodes (C) last, the elastic stiffness is L Lᵀ with L = [L_I 0;
//! · L_C]. The stiffness of the region alone, with all other nodes following it, is S = L_C L_Cᵀ
//! (the Schur complement).

use std::sync::Arc;

use faer::{
    Accum, Mat, MatRef, Par,
    linalg::matmul::triangular::{BlockStructure, matmul},
};
use nalgebra::Vector3;

use crate::contact::Touch;

use super::{
    pattern::Pattern,
    region::Region,
    solid::{AssemblyMap, Strain},
    sparse::Matrix,
    springs::Spring,
    system::{Forces, Stiffness, System},
};

/// A run's sparse direct solver.
pub(super) struct DirectSolver {
    pattern: Arc<Pattern>,
    map: Arc<AssemblyMap>,
    matrix: Matrix,
    /// Region in which contact is evaluated; `None` for the whole surface.
    region: Option<Region>,
    /// The elastic stiffness condensed to the region, while the matrix holds its factor.
    condensed: Option<CondensedStiffness>,
    /// `true` once the elastic stiffness alone was not positive definite.
    braced: bool,
    /// Method by which the factorised stiffness was made positive definite, and the springs in it.
    factored: Option<(Stiffness, Vec<Spring>)>,
}

/// An elastic stiffness condensed to the region.
pub(super) struct CondensedStiffness {
    /// L_C, lower triangular.
    corner: Mat<f64>,
    /// Lower triangle of S for the unknowns requested last.
    stiffness: Mat<f64>,
    /// Springs in it.
    springs: Vec<Spring>,
}

impl CondensedStiffness {
    /// L_C and the lower triangle of S for at least the last `size` unknowns of the region, and the
    /// springs in them.
    pub(super) fn of_last(&mut self, size: usize) -> (MatRef<'_, f64>, MatRef<'_, f64>, &[Spring]) {
        let all = self.corner.nrows();
        if self.stiffness.nrows() < size || self.stiffness.nrows() > 2 * size {
            let size = all.min(size + 3 * (size / 24));
            let corner = self.corner.submatrix(all - size, all - size, size, size);
            self.stiffness = Mat::zeros(size, size);
            matmul(
                &mut self.stiffness,
                BlockStructure::TriangularLower,
                Accum::Replace,
                corner,
                BlockStructure::TriangularLower,
                corner.transpose(),
                BlockStructure::TriangularUpper,
                1.0,
                Par::Seq,
            );
        }
        let size = self.stiffness.nrows();
        let corner = self.corner.submatrix(all - size, all - size, size, size);
        (corner, self.stiffness.as_ref(), &self.springs)
    }
}

impl DirectSolver {
    /// Returns a solver for contact in `region`, or everywhere.
    pub(super) fn new(system: &System, region: Option<Region>) -> Self {
        let (pattern, map) = match &region {
            Some(region) => system.pattern_around(&region.nodes),
            None => system.whole_pattern(),
        };
        let matrix = pattern.matrix();
        Self { pattern, map, matrix, region, condensed: None, braced: false, factored: None }
    }

    /// Replaces the solver by one for the whole surface if some of `touches` are outside its
    /// region.
    pub(super) fn make_hold(&mut self, system: &System, touches: &[Touch]) {
        if self.region.as_ref().is_some_and(|region| !region.holds(touches)) {
            *self = Self::new(system, None);
        }
    }

    pub(super) fn region(&self) -> Option<&Region> {
        self.region.as_ref()
    }

    /// Returns whether the elastic stiffness condensed to the region is what was factorised last.
    pub(super) fn is_condensed(&self) -> bool {
        self.condensed.is_some()
    }

    /// The region, and the elastic stiffness condensed to it.
    pub(super) fn condensed(&mut self) -> Option<(&Region, &mut CondensedStiffness)> {
        Some((self.region.as_ref()?, self.condensed.as_mut()?))
    }

    /// Discards the last factor.
    pub(super) fn forget(&mut self) {
        self.condensed = None;
        self.factored = None;
    }

    /// The springs in the factor, if it is that of an exact stiffness with contact.
    pub(super) fn kept(&self) -> Option<&[Spring]> {
        let kept = self.factored.as_ref().filter(|(how, _)| *how == Stiffness::Exact);
        kept.map(|(_, springs)| &springs[..])
    }

    /// The springs in the factor.
    pub(super) fn springs(&self) -> &[Spring] {
        self.factored.as_ref().map_or(&[], |(_, springs)| springs)
    }

    /// Number of unknowns.
    pub(super) fn size(&self) -> usize {
        self.pattern.size()
    }

    /// Converts a nodal vector (N) to unknowns.
    pub(super) fn gather(&self, nodal: &[Vector3<f64>]) -> Vec<f64> {
        self.pattern.gather(nodal)
    }

    /// Converts unknowns to a nodal vector (N), zero where nodes are fixed.
    pub(super) fn scatter(&self, unknowns: &[f64]) -> Vec<Vector3<f64>> {
        self.pattern.scatter(unknowns)
    }

    /// Factorises the stiffness at `forces`, contact included; returns `false` if it is not
    /// positive definite.
    pub(super) fn factorise(&mut self, system: &System, forces: &Forces, how: Stiffness) -> bool {
        self.assemble(system, &forces.strain, how);
        let springs = system.held_springs(&forces.touches);
        self.add(system, &springs);
        self.factored = self.matrix.factorise(&self.pattern).then_some((how, springs));
        self.factored.is_some()
    }

    /// Adds `springs`, in groups of consecutive ones whose points are interpolated from the same
    /// nodes.
    fn add(&mut self, system: &System, springs: &[Spring]) {
        let point = |spring: &Spring| &system.surface[spring.point as usize];
        for group in springs.chunk_by(|a, b| point(a).has_carriers_of(point(b))) {
            let shares = &point(&group[0]).shares;
            for (i, &(a, _)) in shares.iter().enumerate() {
                for (j, &(b, _)) in shares[..=i].iter().enumerate() {
                    let Some(position) = self.pattern.position(a, b) else { continue };
                    let part = |spring: &Spring| {
                        let shares = &point(spring).shares;
                        spring.stiffness * (shares[i].1 * shares[j].1)
                    };
                    self.matrix.add(position, &group.iter().map(part).sum());
                }
            }
        }
    }

    /// Factorises the elastic stiffness at `forces` and condenses it to the region. Once it is not
    /// positive definite alone, the springs of contact are added; returns `false` if that does not
    /// help.
    pub(super) fn condense(&mut self, system: &System, forces: &Forces) -> bool {
        if !self.braced {
            self.assemble(system, &forces.strain, Stiffness::Exact);
            self.braced = !self.matrix.factorise(&self.pattern);
        }
        let springs = if self.braced {
            if !self.factorise(system, forces, Stiffness::Exact) {
                return false;
            }
            self.springs().to_vec()
        } else {
            Vec::new()
        };
        let corner = self.matrix.corner(&self.pattern);
        self.condensed = Some(CondensedStiffness { corner, stiffness: Mat::new(), springs });
        true
    }

    /// Fills the matrix with the elastic stiffness.
    fn assemble(&mut self, system: &System, strain: &Strain, how: Stiffness) {
        self.forget();
        self.matrix.clear();
        let filtered = how == Stiffness::Filtered;
        system.solid.assemble(strain, &self.map, &mut self.matrix, filtered);
        let shift = match how {
            Stiffness::Shifted(share) => share,
            _ if system.floating => PROXIMAL,
            _ => 0.0,
        };
        if shift > 0.0 {
            let mean = self.matrix.mean_diagonal(&self.pattern);
            self.matrix.shift(&self.pattern, shift * mean);
        }
    }

    /// Solves with the last factor, in place.
    pub(super) fn solve(&mut self, right: &mut [f64]) {
        self.matrix.solve(&self.pattern, right);
    }

    /// Solves L x = `right` in place.
    pub(super) fn solve_lower(&mut self, right: &mut [f64]) {
        self.matrix.solve_lower(&self.pattern, right);
    }

    /// Solves Lᵀ x = `right` in place.
    pub(super) fn solve_upper(&mut self, right: &mut [f64]) {
        self.matrix.solve_upper(&self.pattern, right);
    }
}

/// Share of the mean diagonal added for a body that nothing holds: among the steps that differ by a
/// motion of the whole body it selects the shortest.
const PROXIMAL: f64 = 1e-8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_nodes_are_condensed() {
        for nodes in 1..40 {
            let corner = Mat::identity(120, 120);
            let mut condensed =
                CondensedStiffness { corner, stiffness: Mat::new(), springs: Vec::new() };
            let (_, stiffness, _) = condensed.of_last(3 * nodes);
            let size = stiffness.nrows();
            assert!(
                size >= 3 * nodes && size.is_multiple_of(3),
                "{size} unknowns of {nodes} nodes"
            );
        }
    }
}
