//! Map of the contact traction.
//!
//! Each nodal force is distributed over the four nearest cells by bilinear weights at the displaced
//! node, extrapolated beyond the outermost centres. The sum of the map is therefore the contact
//! force, and its moment in the plane of the map is that of the nodal forces, whatever the grid.

use nalgebra::Vector3;

use super::{face::PlanGrid, skin::Skin};
use crate::deformation::Deformation;

/// Contact force on the pad per area of each cell (G, 3) in Pa.
pub(super) fn map(skin: &Skin, deformation: &Deformation) -> Vec<Vector3<f64>> {
    let grid = &skin.grid;
    let mut map = vec![Vector3::zeros(); (grid.counts[0] * grid.counts[1]) as usize];
    let nodes =
        deformation.contact_force.iter().zip(&deformation.displacement).zip(&skin.face.places);
    for ((force, moved), place) in nodes.filter(|((force, _), _)| **force != Vector3::zeros()) {
        let traction = force / skin.cell_area();
        let [across, along] = [0, 1].map(|axis| weights(grid, axis, place[axis] + moved[axis]));
        for (j, along) in along {
            for (i, across) in across {
                map[(j * grid.counts[0] + i) as usize] += traction * (along * across);
            }
        }
    }
    map
}

/// Two neighbouring cells along `axis`, with their shares of a force at `place` (m).
fn weights(grid: &PlanGrid, axis: usize, place: f64) -> [(u32, f64); 2] {
    let count = grid.counts[axis];
    if count == 1 {
        return [(0, 1.0), (0, 0.0)];
    }
    let index = place / grid.cell[axis] + 0.5 * f64::from(count) - 0.5;
    let first = (index.max(0.0) as u32).min(count - 2);
    let share = index - f64::from(first);
    [(first, 1.0 - share), (first + 1, share)]
}
