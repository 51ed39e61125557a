//! Von Mises stress of a pad's tetrahedra, many at a time and without derivatives.
//!
//! Kuhn's six tetrahedra are mirrored from cell to cell ([`PadMesh`]), so in every second cell of a
//! row tetrahedra of one kind have corners at the same offsets from the cell. If nodes of even and
//! odd index along x and y are stored apart, such corners are contiguous in memory and are read as
//! vectors, without gathering.

use super::von_mises::{EPSILON, FLATTEST, ShapeGradients};
use crate::{geometry::PadMesh, simd::LANES};

/// One number for each of the tetrahedra that are computed together.
type Lanes = [f32; LANES];

/// Tetrahedra of a pad in runs of one kind.
#[derive(Clone, Debug)]
pub(in super::super) struct PadStress {
    /// Offset from one component of a node's displacement to the next.
    stride: usize,
    /// Index of the first component of each node's displacement (V).
    nodes: Vec<u32>,
    /// Length of an arranged displacement.
    size: usize,
    runs: Vec<TetRun>,
    /// Gradients of the shape functions of the last three corners, by row and column, for each
    /// block of each run.
    gradients: Vec<[[Lanes; 3]; 3]>,
    /// Index of the stress of each tetrahedron in the output (T).
    places: Vec<u32>,
}

/// Tetrahedra of one kind in every second cell of a layer.
#[derive(Clone, Copy, Debug)]
struct TetRun {
    /// Index of the first component of each corner of the first tetrahedron.
    corners: [u32; 4],
    blocks: u32,
}

impl PadStress {
    /// Prepares the tetrahedra of `pad`, with lengths in units of `length` (m).
    pub(in super::super) fn new(pad: &PadMesh, length: f64) -> Self {
        let [nx, ny, nz] = pad.cells.map(|cells| cells as usize);
        let half = [nx / 2 + 1, ny / 2 + 1];
        let kind = half[0] * half[1];
        let stride = 4 * kind;
        let layer = (nx + 1) * (ny + 1);
        let node = |node: usize| {
            let [i, j, k] = [node % layer % (nx + 1), node % layer / (nx + 1), node / layer];
            (3 * stride * k + kind * (2 * (j % 2) + i % 2) + half[0] * (j / 2) + i / 2) as u32
        };
        let nodes: Vec<u32> = (0..pad.mesh.vertices.len()).map(node).collect();
        let slopes = ShapeGradients::new(&pad.mesh, length).slopes;
        let mut places = vec![0; pad.mesh.tets.len()];
        let (mut runs, mut gradients) = (Vec::new(), Vec::<[[Lanes; 3]; 3]>::new());
        let kinds = (0..nz).flat_map(|k| (0..4).map(move |kind| (k, kind)));
        for ((k, parity), path) in kinds.flat_map(|of| (0..6).map(move |path| (of, path))) {
            let of = |i: usize, j: usize| 6 * ((k * ny + j) * nx + i) + path;
            let [first_i, first_j] = [parity % 2, parity / 2];
            if first_i >= nx || first_j >= ny {
                continue;
            }
            let corners = |t: usize| pad.mesh.tets[t].map(|node| nodes[node as usize]);
            let start = corners(of(first_i, first_j));
            let from = gradients.len();
            for j in (first_j..ny).step_by(2) {
                for i in (first_i..nx).step_by(2) {
                    let (lane, t) = (half[0] * (j / 2) + i / 2, of(i, j));
                    let expected = start.map(|corner| corner + lane as u32);
                    assert_eq!(corners(t), expected, "Kuhn's tetrahedra, cell by cell");
                    let block = from + lane / LANES;
                    gradients.resize(gradients.len().max(block + 1), [[[0.0; LANES]; 3]; 3]);
                    for (r, row) in gradients[block].iter_mut().enumerate() {
                        for (c, entry) in row.iter_mut().enumerate() {
                            entry[lane % LANES] = slopes[t][(r, c)];
                        }
                    }
                    places[t] = (from * LANES + lane) as u32;
                }
            }
            runs.push(TetRun { corners: start, blocks: (gradients.len() - from) as u32 });
        }
        // The last block of a run may read past the nodes of its kind.
        let size = 3 * stride * (nz + 1) + LANES;
        Self { stride, nodes, size, runs, gradients, places }
    }

    /// Returns the displacements of the nodes (V) in the order in which [`PadStress::stress`] reads
    /// them.
    pub(in super::super) fn arranged<T: Copy + Default>(&self, u: &[[T; 3]]) -> Vec<T> {
        let mut arranged = vec![T::default(); self.size];
        for (&at, u) in self.nodes.iter().zip(u) {
            for (axis, &u) in u.iter().enumerate() {
                arranged[at as usize + axis * self.stride] = u;
            }
        }
        arranged
    }

    /// Number of values that [`PadStress::stress`] writes.
    pub(in super::super) fn count(&self) -> usize {
        LANES * self.gradients.len()
    }

    /// Index of the stress of each tetrahedron in the output of [`PadStress::stress`] (T).
    pub(in super::super) fn places(&self) -> &[u32] {
        &self.places
    }

    /// Writes the result of [`ShapeGradients::stress`] to `stress`, at [`PadStress::places`].
    #[inline(always)]
    pub(in super::super) fn stress(&self, arranged: &[f32], stress: &mut Vec<f32>) {
        stress.resize(self.count(), 0.0);
        let mut blocks = self.gradients.iter().zip(stress.as_chunks_mut::<LANES>().0);
        for run in &self.runs {
            let blocks = (0..run.blocks as usize).zip(&mut blocks);
            for (block, (gradients, stress)) in blocks {
                let mut u: [[&Lanes; 3]; 4] = [[&[0.0; LANES]; 3]; 4];
                for (u, &corner) in u.iter_mut().zip(&run.corners) {
                    for (axis, u) in u.iter_mut().enumerate() {
                        let at = corner as usize + axis * self.stride + block * LANES;
                        *u = arranged[at..].first_chunk().expect("room for a block");
                    }
                }
                *stress = von_mises(&u, gradients);
            }
        }
    }
}

#[inline(always)]
fn lanes(f: impl Fn(usize) -> f32) -> Lanes {
    let mut lanes = [0.0; LANES];
    for (i, lane) in lanes.iter_mut().enumerate() {
        *lane = f(i);
    }
    lanes
}

/// Stress over μ for the displacements of the corners, by corner and axis.
#[inline(always)]
fn von_mises([first, u @ ..]: &[[&Lanes; 3]; 4], gradients: &[[Lanes; 3]; 3]) -> Lanes {
    let mut f = [[[0.0; LANES]; 3]; 3];
    for (r, row) in f.iter_mut().enumerate() {
        for (c, entry) in row.iter_mut().enumerate() {
            let own = if r == c { 1.0 } else { 0.0 };
            *entry = lanes(|i| {
                own + (u[0][r][i] - first[r][i]) * gradients[0][c][i]
                    + (u[1][r][i] - first[r][i]) * gradients[1][c][i]
                    + (u[2][r][i] - first[r][i]) * gradients[2][c][i]
            });
        }
    }
    let [[a, b, c], [d, e, g], [h, k, l]] = &f;
    lanes(|i| {
        let j = a[i] * (e[i] * l[i] - g[i] * k[i]) - b[i] * (d[i] * l[i] - g[i] * h[i])
            + c[i] * (d[i] * k[i] - e[i] * h[i]);
        let xx = a[i] * a[i] + b[i] * b[i] + c[i] * c[i];
        let yy = d[i] * d[i] + e[i] * e[i] + g[i] * g[i];
        let zz = h[i] * h[i] + k[i] * k[i] + l[i] * l[i];
        let xy = a[i] * d[i] + b[i] * e[i] + c[i] * g[i];
        let xz = a[i] * h[i] + b[i] * k[i] + c[i] * l[i];
        let yz = d[i] * h[i] + e[i] * k[i] + g[i] * l[i];
        let third = (xx + yy + zz) / 3.0;
        let diagonal = (xx - third).powi(2) + (yy - third).powi(2) + (zz - third).powi(2);
        let square = diagonal + 2.0 * (xy * xy + xz * xz + yz * yz);
        (1.5 * square + EPSILON).sqrt() / j.max(FLATTEST)
    })
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::geometry::{Grading, PadOutline};

    #[test]
    fn every_tetrahedron_has_the_stress_that_it_has_alone() {
        let outline = PadOutline { radius_along: 0.2, ..PadOutline::flat(0.02525, 0.02075, 0.004) };
        // Grids of one or two cells a side, rows that are a multiple of the vector width, and not.
        for spacing in [0.02, 0.004, 0.0021, 0.0007, 0.0004] {
            let pad = PadMesh::new(&outline, &Grading::uniform(spacing)).unwrap();
            let mut random = ChaCha8Rng::seed_from_u64(3);
            let mut number = || random.random_range(-0.05_f32..0.05);
            let u: Vec<[f32; 3]> =
                pad.mesh.vertices.iter().map(|_| std::array::from_fn(|_| number())).collect();
            let (tets, own) = (pad.mesh.tets.len(), PadStress::new(&pad, 0.004));
            let mut plain = vec![0.0; tets];
            ShapeGradients::new(&pad.mesh, 0.004).stress(u.as_flattened(), &mut plain);
            let mut found = Vec::new();
            own.stress(&own.arranged(&u), &mut found);
            assert!(own.places().len() == tets && found.iter().all(|s| s.is_finite()));
            for (plain, &place) in plain.iter().zip(own.places()) {
                let error = (found[place as usize] / plain - 1.0).abs();
                assert!(error < 1e-4, "{} for {plain} at {spacing} m", found[place as usize]);
            }
        }
    }
}
