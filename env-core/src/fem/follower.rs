//! Linear response of a pad to small motions of the object that it holds.
//!
//! The pad's stiffness at the object is K = C − Bᵀ A⁻¹ B, with A the stiffness of the pad, C that
//! of contact and B their coupling. Friction limits follow the depth.

use std::ops::AddAssign;

use nalgebra::{Matrix3x6, Matrix6, Point3, Vector3, Vector6};

use super::{
    direct::DirectSolver,
    gmres::gmres,
    push::product,
    springs::{Spring, missing},
    system::{Forces, Stiffness, System},
};

/// Linear response of a pad to small motions of the object, in six components.
pub(super) struct PadResponse {
    /// Derivative of the object's wrench on the pad with respect to the motion (N/m).
    pub(super) stiffness: Matrix6<f64>,
    /// Change of the pad's unknowns for each component of the motion.
    columns: [Vec<f64>; 6],
}

impl PadResponse {
    /// Linearises the pad at `forces`. `motion` gives the motion (3, 6) of the object's point at a
    /// place.
    pub(super) fn new(
        system: &System,
        solver: &mut DirectSolver,
        forces: &Forces,
        motion: impl Fn(&Point3<f64>) -> Matrix3x6<f64>,
    ) -> Self {
        let springs = system.springs(&forces.touches);
        let motions: Vec<_> = forces.touches.iter().map(|touch| motion(&touch.place)).collect();
        solver.make_hold(system, &forces.touches);
        let columns = columns(system, solver, &springs, &motions).unwrap_or_else(|| {
            if !solver.factorise(system, forces, Stiffness::Exact) {
                solver.factorise(system, forces, Stiffness::Filtered);
            }
            columns_of(system, solver, &springs, &motions).map(|(column, _)| column)
        });
        let mut stiffness = Matrix6::zeros();
        for (k, column) in columns.iter().enumerate() {
            let moved = solver.scatter(column);
            for (spring, motion) in springs.iter().zip(&motions) {
                let here = system.surface[spring.point as usize].interpolate(&moved);
                let change = spring.stiffness * (motion.column(k) - here);
                stiffness.column_mut(k).add_assign(motion.transpose() * change);
            }
        }
        Self { stiffness, columns }
    }

    /// Change of the displacements (N) of the pad's nodes for a `step` of the object.
    pub(super) fn ahead(&self, solver: &DirectSolver, step: &Vector6<f64>) -> Vec<Vector3<f64>> {
        let mut sum = vec![0.0; solver.size()];
        for (column, &share) in self.columns.iter().zip(step.iter()) {
            sum.iter_mut().zip(column).for_each(|(sum, x)| *sum += share * x);
        }
        solver.scatter(&sum)
    }
}

/// Pad's unknowns for each of six motions of the object, computed with the factor at hand; `None`
/// if there is none or the iteration does not converge.
fn columns(
    system: &System,
    solver: &mut DirectSolver,
    springs: &[Spring],
    motions: &[Matrix3x6<f64>],
) -> Option<[Vec<f64>; 6]> {
    solver.kept()?;
    let columns = columns_of(system, solver, springs, motions);
    columns.iter().all(|(_, converged)| *converged).then(|| columns.map(|(column, _)| column))
}

/// Returns the result of [`columns`], each column with `true` if it converged.
fn columns_of(
    system: &System,
    solver: &mut DirectSolver,
    springs: &[Spring],
    motions: &[Matrix3x6<f64>],
) -> [(Vec<f64>, bool); 6] {
    let missing = missing(springs, solver.springs());
    std::array::from_fn(|k| {
        let stretches = motions.iter().map(|motion| motion.column(k).into_owned());
        let mut first = solver.gather(&system.resistance(springs.iter().zip(stretches)));
        solver.solve(&mut first);
        let found = gmres(
            |x| {
                let mut y = product(system, solver, &missing, x, None);
                solver.solve(&mut y);
                y.iter_mut().zip(x).for_each(|(y, x)| *y += x);
                y
            },
            &first,
        );
        (found.x, found.converged)
    })
}
