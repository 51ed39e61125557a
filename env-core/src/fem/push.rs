//! Shapes pushed with a given force: their travel is one more unknown.

use nalgebra::Vector3;

use super::{direct::DirectSolver, gmres::dot, springs::Spring, system::System};

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

impl Border {
    /// Computes the border of the stiffness that `solver` factorised last.
    pub(super) fn new(system: &System, solver: &mut DirectSolver, push: &ForceControl) -> Self {
        let mut unit = vec![0.0; solver.size() + 1];
        unit[solver.size()] = 1.0;
        let mut column = product(system, solver, solver.springs(), &unit, Some(push));
        let corner = column.pop().expect("the travel is the last unknown");
        let mut lifted = column.clone();
        solver.solve(&mut lifted);
        let schur = corner - dot(&column, &lifted);
        Self { column, lifted, schur }
    }
}

/// Multiplies `right` by the inverse of the stiffness matrix that `solver` factorised last, in
/// place.
pub(super) fn solve(solver: &mut DirectSolver, border: Option<&Border>, right: &mut Vec<f64>) {
    let last = if border.is_some() { right.pop() } else { None };
    solver.solve(right);
    if let (Some(border), Some(last)) = (border, last) {
        let pull = last - dot(&border.column, right);
        // Shapes that no longer touch have no stiffness and move by the longest travel.
        let travel = if border.schur > 0.0 { pull / border.schur } else { pull.signum() };
        let travel = travel.clamp(-LONGEST_TRAVEL, LONGEST_TRAVEL);
        right.iter_mut().zip(&border.lifted).for_each(|(x, lift)| *x -= lift * travel);
        right.push(travel);
    }
}

/// Forces of resistance of `springs` to a motion of the nodes by `unknowns`, and of the shapes
/// along `push` if the last unknown is their travel; as unknowns (N).
pub(super) fn product(
    system: &System,
    solver: &DirectSolver,
    springs: &[Spring],
    unknowns: &[f64],
    push: Option<&ForceControl>,
) -> Vec<f64> {
    let moved = solver.scatter(unknowns);
    let travel = push.map_or(Vector3::zeros(), |p| p.direction * unknowns[unknowns.len() - 1]);
    let stretch =
        |spring: &Spring| system.surface[spring.point as usize].interpolate(&moved) - travel;
    let stretches: Vec<_> = springs.iter().map(stretch).collect();
    let mut product =
        solver.gather(&system.resistance(springs.iter().zip(stretches.iter().copied())));
    product.extend(push.map(|push| {
        let forces =
            springs.iter().zip(&stretches).map(|(spring, stretch)| spring.stiffness * stretch);
        -push.direction.dot(&forces.sum::<Vector3<f64>>())
    }));
    product
}
