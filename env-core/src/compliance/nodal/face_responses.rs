//! Displacement of the nodes of a pad under unit forces on those of its face, by finite elements.
//!
//! The mesh of a pad is its own mirror image in the planes x = 0 and y = 0, and so are its
//! responses: they are solved for a quarter of the face.
//!
//! Shapes: V nodes of the pad, N free ones, Q nodes of the quarter of the face where x, y ≤ 0.

use nalgebra::Vector3;

use crate::{
    compliance::Compliance,
    fem::Linearised,
    geometry::{PadMesh, PadOutline},
};

/// Displacement of the nodes of a pad under unit forces on those of its face.
pub struct FaceResponses {
    /// Nodes across, along and through the thickness, the last of which are fixed.
    nodes: [usize; 3],
    /// Displacement of the free nodes under a unit force along each axis on each node of the
    /// quarter (Q, 3, N) in m/N.
    rows: Vec<Vector3<f64>>,
}

impl Compliance {
    /// Responses of the body, whose mesh is that of the `pad`.
    pub(crate) fn face_responses(&self, pad: &PadMesh) -> FaceResponses {
        FaceResponses::new(&self.condensed.rest, pad, |node| node)
    }
}

impl FaceResponses {
    /// Solves for `elements` whose node in the place of each of the pad's is `place`.
    pub(super) fn new(elements: &Linearised, pad: &PadMesh, place: impl Fn(u32) -> u32) -> Self {
        let nodes = pad.cells.map(|cells| cells as usize + 1);
        let [nx, ny, nz] = nodes;
        let columns = |j: usize| (0..nx.div_ceil(2)).map(move |i| (j * nx + i) as u32);
        let quarter: Vec<_> = (0..ny.div_ceil(2)).flat_map(columns).map(&place).collect();
        let free: Vec<_> = (0..(nx * ny * (nz - 1)) as u32).map(place).collect();
        let solve = &|loaded: &[u32]| -> Vec<Vector3<f64>> {
            let rows = elements.unit_responses(loaded, &free, &mut elements.workspace());
            rows.as_chunks::<3>().0.iter().map(|&u| u.into()).collect()
        };
        // Threads of their own: a thread of a pool that waited for others could be handed a task
        // that waits for these responses.
        let parts = quarter.len().div_ceil(rayon::current_num_threads());
        let rows = std::thread::scope(|scope| {
            let parts: Vec<_> =
                quarter.chunks(parts).map(|loaded| scope.spawn(move || solve(loaded))).collect();
            let rows = parts.into_iter().map(|part| part.join().expect("a solve does not panic"));
            rows.collect::<Vec<_>>().concat()
        });
        Self { nodes, rows }
    }

    /// Subtracts the responses of a layer to forces that are turned with the face of the `pad`, and
    /// turned so themselves.
    pub(super) fn subtract_tilted(&mut self, layer: &Self, pad: &PadMesh, outline: &PadOutline) {
        let [nx, ny, nz] = self.nodes;
        let (half, free, plane) = (nx.div_ceil(2), nx * ny * (nz - 1), nx * ny);
        let tilt = |&node: &u32| {
            let place = pad.mesh.vertices[node as usize];
            outline.tilt(place.x, place.y)
        };
        let tilts: Vec<_> = pad.face.iter().map(tilt).collect();
        for (number, rows) in self.rows.chunks_exact_mut(3 * free).enumerate() {
            let loaded = &tilts[number / half * nx + number % half];
            let by_layer = &layer.rows[3 * number * free..];
            for (axis, row) in rows.chunks_exact_mut(free).enumerate() {
                for (node, u) in row.iter_mut().enumerate() {
                    let part = |i: usize| by_layer[i * free + node] * loaded[(axis, i)];
                    *u -= tilts[node % plane] * (part(0) + part(1) + part(2));
                }
            }
        }
    }

    /// Displacement (V) in m under forces (N) on some nodes of the face.
    pub(super) fn displacement(&self, forces: &[(u32, Vector3<f64>)]) -> Vec<Vector3<f64>> {
        let [nx, ny, nz] = self.nodes;
        let free = nx * ny * (nz - 1);
        let mut sum = vec![Vector3::zeros(); nx * ny * nz];
        for (node, force) in forces {
            let [i, j] = [*node as usize % nx, *node as usize / nx];
            // Nodes and vectors are reflected to and from the quarter that is known.
            let [turn_x, turn_y] = [2 * i >= nx, 2 * j >= ny];
            let across = |i: usize| if turn_x { nx - 1 - i } else { i };
            let along = |j: usize| if turn_y { ny - 1 - j } else { j };
            let sign = |turn: bool| if turn { -1.0 } else { 1.0 };
            let signs = Vector3::new(sign(turn_x), sign(turn_y), 1.0);
            let reflected = |u: &Vector3<f64>| -> Vector3<f64> { u.component_mul(&signs) };
            let first = 3 * (along(j) * nx.div_ceil(2) + across(i));
            for (axis, &f) in reflected(force).iter().enumerate().filter(|(_, f)| **f != 0.0) {
                let row = &self.rows[(first + axis) * free..][..free];
                for (line, known) in row.chunks_exact(nx).enumerate() {
                    let at = line / ny * ny + along(line % ny);
                    let sum = &mut sum[nx * at..][..nx];
                    for (i, u) in known.iter().enumerate() {
                        sum[across(i)] += reflected(u) * f;
                    }
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        compliance::ComplianceOptions,
        deformation::{Law, Moduli, SoftBody},
        sensor::Sensor,
    };

    #[test]
    fn a_quarter_of_the_face_tells_all() {
        for name in ["gelsight-mini", "digit"] {
            let pad = PadMesh::with_nodes(&Sensor::named(name).unwrap().outline, 500).unwrap();
            let moduli = Moduli { young: 3e5, poisson: 0.47 };
            let solid = SoftBody::new(pad.mesh.clone(), Law::Linear, moduli, &pad.base).unwrap();
            let options = ComplianceOptions { friction: 0.5, corrections: 0 };
            let compliance = Compliance::new(solid, options).unwrap();
            let (own, elements) = (compliance.face_responses(&pad), &compliance.condensed.rest);
            for &node in &pad.face {
                let force = Vector3::new(1.0, -0.5, 0.3 + f64::from(node));
                let mut forces = vec![Vector3::zeros(); elements.places().len()];
                forces[node as usize] = force;
                let right = elements.displacement(&forces, &mut elements.workspace());
                let most = right.iter().map(Vector3::norm).fold(0.0, f64::max);
                for (found, right) in own.displacement(&[(node, force)]).iter().zip(&right) {
                    // Rounding of solves for thousands of unknowns, in nearly incompressible gel.
                    let error = (found - right).norm();
                    assert!(error < 1e-8 * most, "{error} m of {most} m");
                }
            }
        }
    }
}
