//! Influence of the sides of a pad on displacement between its contact cells.
//!
//! The change by the sides, the rim and the curved face against an elastic layer ([`Sides`]) is
//! smooth but for short distances from the sides. It is taken between tractions that fall off
//! linearly around nodes of the elements' face, which are denser towards the sides.
//!
//! Shapes: C nodes, counted row after row along y.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use nalgebra::{Point3, Vector3};

use super::{kernel::Columns, plan_columns::PlanColumns, sides::Sides};
use crate::simd::vectorised;

/// Compliance of a pad less that of a layer, between tractions around some nodes of its face.
pub(super) struct SideCompliance {
    columns: PlanColumns,
    /// Displacement around all nodes under unit forces around each along each axis (3C, 3C) in m/N.
    entries: Vec<f32>,
    /// Nodes along x and y.
    count: [u32; 2],
}

/// Nodes in a rectangle, counted row after row along y: first node along x and y, and numbers of
/// them.
#[derive(Clone, Copy, Default)]
pub(super) struct Around {
    first: [u32; 2],
    count: [u32; 2],
}

impl Around {
    /// The smallest that contains some nodes, given by their places along x and y.
    pub(super) fn of(nodes: impl Iterator<Item = [u32; 2]>) -> Self {
        let none = ([u32::MAX; 2], [0; 2]);
        let (first, end) = nodes.fold(none, |(first, end), node| {
            let wider = |axis: usize| (first[axis].min(node[axis]), end[axis].max(node[axis] + 1));
            let [x, y] = [wider(0), wider(1)];
            ([x.0, y.0], [x.1, y.1])
        });
        let count = [0, 1].map(|axis| end[axis].saturating_sub(first[axis]));
        Self { first, count }
    }

    /// Number of nodes.
    pub(super) fn len(&self) -> usize {
        (self.count[0] * self.count[1]) as usize
    }

    /// Number of the node at a place along x and y.
    pub(super) fn number(&self, node: [u32; 2]) -> u32 {
        (node[0] - self.first[0]) * self.count[1] + node[1] - self.first[1]
    }
}

impl SideCompliance {
    /// Takes the influence of the `sides` between some nodes of their face.
    pub(super) fn new(sides: &Sides) -> Self {
        let columns = PlanColumns::of(&sides.mesh).thinned(sides.mesh.thickness());
        let count = columns.count().map(|count| count as u32);
        let loads = loads(sides, &columns);
        let row = |from: &[(u32, f64)], axis: usize| -> Vec<f32> {
            let force = |&(node, share): &(u32, f64)| (node, Vector3::ith(axis, share));
            let moved = sides.displacement(&from.iter().map(force).collect::<Vec<_>>());
            let seen = |to: &Vec<(u32, f64)>| -> [f32; 3] {
                let part = |&(node, share): &(u32, f64)| moved[node as usize] * share;
                to.iter().map(part).sum::<Vector3<f64>>().cast().into()
            };
            loads.iter().flat_map(seen).collect()
        };
        let rows = loads.iter().flat_map(|from| [0, 1, 2].map(|axis| row(from, axis)));
        Self { entries: rows.flatten().collect(), columns, count }
    }

    /// Number of nodes C.
    pub(super) fn len(&self) -> usize {
        (self.count[0] * self.count[1]) as usize
    }

    /// Place of a node along x and y.
    pub(super) fn place(&self, node: u32) -> [u32; 2] {
        [node / self.count[1], node % self.count[1]]
    }

    /// Nodes around a point of the face, with weights that sum to 1.
    pub(super) fn around(&self, point: &Point3<f64>) -> [(u32, f64); 4] {
        let parts = self.columns.around([point.x, point.y]);
        parts.map(|([i, j], share)| (i as u32 * self.count[1] + j as u32, share))
    }

    /// Numbers in a row.
    fn size(&self) -> usize {
        3 * self.len()
    }

    /// Displacement around all nodes (3C) in m under forces around each (C) in N.
    pub(super) fn field(&self, forces: &[Vector3<f32>]) -> Vec<f32> {
        let mut sum = vec![0.0; self.size()];
        let forces = forces.iter().flat_map(|force| <[f32; 3]>::from(*force));
        vectorised(
            #[inline(always)]
            || {
                for (force, row) in forces.clone().zip(self.entries.chunks_exact(self.size())) {
                    if force != 0.0 {
                        sum.iter_mut().zip(row).for_each(|(sum, c)| *sum += force * c);
                    }
                }
            },
        );
        sum
    }

    /// Adds to `rows` the displacement of the T nodes that are `around` under unit forces along
    /// each axis (3, 3T), shared among the nodes `loaded`.
    pub(super) fn add_rows(&self, loaded: [(u32, f32); 4], around: &Around, rows: &mut [f32]) {
        let Around { first, count } = *around;
        let (size, width) = (self.size(), 3 * count[1] as usize);
        let places = (first[0]..first[0] + count[0]).map(|x| x * self.count[1] + first[1]);
        vectorised(
            #[inline(always)]
            || {
                for (from, by) in loaded {
                    let mut rows = rows.chunks_exact_mut(width);
                    for axis in 0..3 {
                        let row = &self.entries[size * (3 * from as usize + axis)..][..size];
                        for place in places.clone() {
                            let part = &row[3 * place as usize..][..width];
                            let sum = rows.next().expect("a row for each axis and place");
                            sum.iter_mut().zip(part).for_each(|(sum, c)| *sum += by * c);
                        }
                    }
                }
            },
        );
    }

    /// Displacement around node `at` under unit forces around node `loaded` (m/N).
    #[inline(always)]
    pub(super) fn block(&self, loaded: u32, at: u32) -> Columns {
        let ([loaded, at], size) = ([loaded as usize, at as usize], self.size());
        let part = |axis| &self.entries[size * (3 * loaded + axis) + 3 * at..][..3];
        let [x, y, z] = [part(0), part(1), part(2)];
        [x[0], x[1], x[2], 0.0, y[0], y[1], y[2], 0.0, z[0], z[1], z[2], 0.0]
    }
}

/// Nodes of the face of `sides` that bear tractions around each node (C) where their `columns`
/// cross, with shares of the force.
fn loads(sides: &Sides, columns: &PlanColumns) -> Vec<Vec<(u32, f64)>> {
    let [across, along] = columns.count();
    let mut loads = vec![Vec::new(); across * along];
    for (&node, area) in sides.mesh.face.iter().zip(sides.areas()) {
        let place = &sides.mesh.mesh.vertices[node as usize];
        for ([i, j], share) in columns.around([place.x, place.y]) {
            if share > 1e-9 {
                loads[i * along + j].push((node, share * area));
            }
        }
    }
    for loads in &mut loads {
        let sum: f64 = loads.iter().map(|(_, share)| share).sum();
        for (_, share) in loads {
            *share /= sum;
        }
    }
    loads
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        compliance::nodal::grid::{CellGrid, CellLevels},
        deformation::Moduli,
        geometry::PadOutline,
    };

    #[test]
    fn sides_soften_what_is_near_them_and_not_what_is_far() {
        let outline = PadOutline::flat(0.032, 0.032, 0.003);
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let sides = Sides::new(&outline, moduli, 300).unwrap();
        let grid = CellGrid::new(&CellLevels::new(&outline, [16; 2], 2, moduli, &sides), 0);
        // Change of the displacement of a cell along z under a force on it, over that by the layer.
        let responses = grid.responses();
        let change = |[i, j]: [u32; 2]| {
            let rank = 16 * i + j;
            responses.at(rank, 2, 3 * rank as usize + 2) / f64::from(grid.layer().at([0, 0])[10])
                - 1.0
        };
        let (middle, corner) = (change([8, 8]), change([0, 0]));
        assert!(
            middle.abs() < 2e-3 && corner > 0.2,
            "{middle} in the middle, {corner} at a corner"
        );
    }
}
