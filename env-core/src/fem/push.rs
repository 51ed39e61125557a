//! Shapes pushed with a given force: their travel is one more unknown.

use nalgebra::Vector3;

use super::{
    newton::{Search, dot},
    springs::product,
};

/// Longest travel of pushed shapes in one Newton step (m).
const LONGEST_TRAVEL: f64 = 5e-4;

/// A constant force with which the shapes are pushed.
#[derive(Clone, Copy, Debug)]
pub(super) struct ForceControl {
    pub(super) direction: Vector3<f64>,
    /// Force along `direction` (N).
    pub(super) force: f64,
}

/// Row and column of the travel in the stiffness matrix, with the other unknowns eliminated.
pub(super) struct Border {
    /// Coupling of the travel with the other unknowns.
    column: Vec<f64>,
    /// Inverse of the stiffness matrix times `column`.
    lifted: Vec<f64>,
    /// Stiffness of the travel with the body free to follow (Schur complement).
    schur: f64,
}

impl Search<'_, '_> {
    /// Computes the border of the stiffness that was factorised last, if there is a push.
    pub(super) fn border(&mut self) -> Option<Border> {
        let mut unit = vec![0.0; self.solver.size() + 1];
        *unit.last_mut()? = 1.0;
        let springs = self.solver.springs();
        let mut column = product(self.system, self.solver, springs, &unit, Some(self.push?));
        let corner = column.pop()?;
        let mut lifted = column.clone();
        self.solver.solve(&mut lifted);
        let schur = corner - dot(&column, &lifted);
        Some(Border { column, lifted, schur })
    }

    /// Multiplies `right` by the inverse of the stiffness matrix, in place.
    pub(super) fn solve(&mut self, border: Option<&Border>, right: &mut Vec<f64>) {
        let last = if border.is_some() { right.pop() } else { None };
        self.solver.solve(right);
        if let (Some(border), Some(last)) = (border, last) {
            let pull = last - dot(&border.column, right);
            // Shapes that no longer touch have no stiffness and move by the longest travel.
            let travel = if border.schur > 0.0 { pull / border.schur } else { pull.signum() };
            let travel = travel.clamp(-LONGEST_TRAVEL, LONGEST_TRAVEL);
            right.iter_mut().zip(&border.lifted).for_each(|(x, lift)| *x -= lift * travel);
            right.push(travel);
        }
    }
}
