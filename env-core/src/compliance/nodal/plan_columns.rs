//! Columns of nodes across and along a pad, between which the influence of its sides is
//! interpolated.

use crate::geometry::PadMesh;

/// Least distance of columns that are kept, at a side, and how much it grows with the distance from
/// there, up to the greatest; all lengths in thicknesses of the pad.
const AT_SIDE: f64 = 0.06;
const GROWTH: f64 = 0.35;
const INSIDE: f64 = 0.5;

/// Places of columns of nodes across and along a pad, ascending (m).
pub(super) struct PlanColumns([Vec<f64>; 2]);

impl PlanColumns {
    /// The columns of a mesh, whose face nodes are counted row after row across.
    pub(super) fn of(mesh: &PadMesh) -> Self {
        let across = mesh.cells[0] as usize + 1;
        let place = |node: &u32| mesh.mesh.vertices[*node as usize];
        Self([
            mesh.face.iter().take(across).map(|node| place(node).x).collect(),
            mesh.face.iter().step_by(across).map(|node| place(node).y).collect(),
        ])
    }

    /// Fewer of these columns, dense at the sides of a pad of that `thickness` (m), where their
    /// influence changes on short distances.
    pub(super) fn thinned(&self, thickness: f64) -> Self {
        let [x, y] = &self.0;
        Self([x, y].map(|columns| {
            let (first, last) = (columns[0], columns[columns.len() - 1]);
            let from_side = |at: f64| f64::min(at - first, last - at);
            let mut kept = vec![first];
            for pair in columns[1..].windows(2) {
                let [at, next] = [pair[0], pair[1]];
                let side = f64::min(from_side(kept[kept.len() - 1]), from_side(next));
                let most = f64::min(AT_SIDE * thickness + GROWTH * side, INSIDE * thickness);
                if next - kept[kept.len() - 1] > most {
                    kept.push(at);
                }
            }
            kept.push(last);
            kept
        }))
    }

    /// Numbers of columns across and along.
    pub(super) fn count(&self) -> [usize; 2] {
        self.0.each_ref().map(Vec::len)
    }

    /// Nodes around a point of the plan (m): their columns across and along, with weights that sum
    /// to 1. Those of a point beside the pad are those of the point at its side.
    pub(super) fn around(&self, point: [f64; 2]) -> [([usize; 2], f64); 4] {
        let [x, y] = [0, 1].map(|axis| {
            let columns = &self.0[axis];
            let after = columns.partition_point(|column| *column <= point[axis]);
            let first = after.clamp(1, columns.len() - 1) - 1;
            let share = (point[axis] - columns[first]) / (columns[first + 1] - columns[first]);
            (first, share.clamp(0.0, 1.0))
        });
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| {
            let by = |(_, share): (usize, f64), step: usize| match step {
                0 => 1.0 - share,
                _ => share,
            };
            ([x.0 + i, y.0 + j], by(x, i) * by(y, j))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::Sensor;

    #[test]
    fn columns_are_dense_at_the_sides_and_reach_them() {
        let outline = Sensor::named("gelsight-mini").unwrap().outline;
        let all = PlanColumns::of(&PadMesh::towards_sides(&outline, 1000).unwrap().halved());
        let few = all.thinned(outline.thickness);
        let nodes = |columns: &PlanColumns| columns.count().iter().product::<usize>();
        assert!(nodes(&few) < nodes(&all), "{:?} of {:?}", few.count(), all.count());
        for (axis, extent) in [(0, outline.width), (1, outline.length)] {
            let columns = &few.0[axis];
            let gaps: Vec<_> = columns.windows(2).map(|pair| pair[1] - pair[0]).collect();
            let middle = gaps[gaps.len() / 2];
            assert!((columns[columns.len() - 1] - columns[0] - extent).abs() < 1e-12);
            for gap in [gaps[0], gaps[gaps.len() - 1]] {
                assert!(gap < 6e-4 && gap < 0.5 * middle, "{gap} m of {gaps:?}");
            }
            assert!(gaps.iter().all(|gap| *gap < 2.6e-3), "{gaps:?}");
        }
    }

    #[test]
    fn a_field_that_is_linear_along_each_axis_is_interpolated_exactly() {
        let columns = PlanColumns([vec![-2.0, -1.5, 0.5, 2.0], vec![-1.0, 0.0, 3.0]]);
        let field = |[x, y]: [f64; 2]| 1.0 + 2.0 * x - y + 0.5 * x * y;
        for (point, inside) in
            [([-1.7, 2.0], [-1.7, 2.0]), ([0.0, 0.0], [0.0, 0.0]), ([9.0, -4.0], [2.0, -1.0])]
        {
            let parts = columns.around(point);
            let at = |[i, j]: [usize; 2]| [columns.0[0][i], columns.0[1][j]];
            let found: f64 = parts.iter().map(|(node, share)| field(at(*node)) * share).sum();
            assert!((found - field(inside)).abs() < 1e-12, "{found} at {point:?}");
        }
    }
}
