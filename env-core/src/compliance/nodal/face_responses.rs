//! Displacement of the nodes of a pad under unit forces on those of its face, by finite elements.
//!
//! The mesh of a pad is its own mirror image in the planes x = 0 and y = 0, and so are its responses:
//! they are solved for a quarter of the face.
//!
//! Shapes: V nodes of the pad, N free ones, Q nodes of the quarter of the face where x, y ≤ 0.

use nalgebra::Vector3;

use crate::{
    Result,
    compliance::Compliance,
    deformation::{Law, SoftBody},
    fem::Linearised,
    geometry::{PadMesh, PadOutline},
};

/// Distance in thicknesses as far as the layer goes on beyond the sides of the pad.
const BEYOND: f64 = 2.5;

/// Displacement of the nodes of a pad under unit forces on those of its face.
pub struct FaceResponses {
    /// Nodes across, along and through the thickness, the last of which are fixed.
    nodes: [usize; 3],
    /// Displacement of the free nodes under a unit force along each axis on each node of the quarter
    /// (Q, 3, N) in m/N.
    rows: Vec<Vector3<f64>>,
}

impl Compliance {
    /// Responses of the body, whose mesh is that of the `pad`.
    pub(crate) fn face_responses(&self, pad: &PadMesh) -> FaceResponses {
        FaceResponses::new(&self.condensed.rest, pad, |node| node)
    }

    /// Influence of the sides and the curved face of the `pad`, whose mesh is that of the body: its
    /// responses less those of a flat layer without sides that has the same nodes in plan and depth,
    /// turned with the face. Both have the same error of the mesh. Returns an error if the layer
    /// cannot be meshed.
    pub fn side_responses(&self, pad: &PadMesh, outline: &PadOutline) -> Result<FaceResponses> {
        let (layer, nodes) = pad.as_layer(BEYOND * pad.thickness())?;
        let moduli = self.body().moduli()[0];
        let body = SoftBody::new(layer.mesh, Law::Linear, moduli, &layer.base)?;
        let of_layer =
            FaceResponses::new(&Linearised::new(&body)?, pad, |node| nodes[node as usize]);
        let mut sides = self.face_responses(pad);
        sides.subtract_tilted(&of_layer, pad, outline);
        Ok(sides)
    }
}

impl FaceResponses {
    /// Solves for `elements` whose node in the place of each of the pad's is `place`. Runs on the
    /// calling thread alone.
    fn new(elements: &Linearised, pad: &PadMesh, place: impl Fn(u32) -> u32) -> Self {
        let nodes = pad.cells.map(|cells| cells as usize + 1);
        let [nx, ny, nz] = nodes;
        let columns = |j: usize| (0..nx.div_ceil(2)).map(move |i| (j * nx + i) as u32);
        let quarter: Vec<_> = (0..ny.div_ceil(2)).flat_map(columns).map(&place).collect();
        let free: Vec<_> = (0..(nx * ny * (nz - 1)) as u32).map(place).collect();
        let rows = elements.unit_responses(&quarter, &free, &mut elements.workspace());
        Self { nodes, rows: rows.as_chunks::<3>().0.iter().map(|&u| u.into()).collect() }
    }

    /// Subtracts the responses of a layer to forces that are turned with the face of the `pad`, and
    /// turned so themselves.
    fn subtract_tilted(&mut self, layer: &Self, pad: &PadMesh, outline: &PadOutline) {
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
    use crate::{compliance::ComplianceOptions, deformation::Moduli, sensor::Sensor};

    #[test]
    fn a_quarter_of_the_face_tells_all() {
        for name in ["gelsight-mini", "digit"] {
            let outline = Sensor::named(name).unwrap().outline;
            let pad = PadMesh::with_nodes(&outline, 500).unwrap();
            let tilt = |node: u32| {
                let place = pad.mesh.vertices[node as usize];
                outline.tilt(place.x, place.y)
            };
            let moduli = Moduli { young: 3e5, poisson: 0.47 };
            let solid = SoftBody::new(pad.mesh.clone(), Law::Linear, moduli, &pad.base).unwrap();
            let options = ComplianceOptions { friction: 0.5, sweeps: 0 };
            let compliance = Compliance::new(solid, options).unwrap();
            let (layer, nodes) = pad.as_layer(BEYOND * pad.thickness()).unwrap();
            let body = SoftBody::new(layer.mesh, Law::Linear, moduli, &layer.base).unwrap();
            let layer = Linearised::new(&body).unwrap();
            let solved = |elements: &Linearised, place: &dyn Fn(u32) -> u32, node, force| {
                let mut forces = vec![Vector3::zeros(); elements.places().len()];
                forces[place(node) as usize] = force;
                let moved = elements.displacement(&forces, &mut elements.workspace());
                let at = |node| moved[place(node) as usize];
                (0..pad.mesh.vertices.len() as u32).map(at).collect::<Vec<_>>()
            };
            let own = compliance.face_responses(&pad);
            let sides = compliance.side_responses(&pad, &outline).unwrap();
            for &node in &pad.face {
                let force = Vector3::new(1.0, -0.5, 0.3 + f64::from(node));
                let by_pad = solved(&compliance.condensed.rest, &|node| node, node, force);
                let in_layer = tilt(node).tr_mul(&force);
                let by_layer = solved(&layer, &|node| nodes[node as usize], node, in_layer);
                let turned = (0..).zip(by_layer).map(|(node, u)| tilt(node) * u);
                let by_layer: Vec<_> = turned.collect();
                let most = by_pad.iter().map(Vector3::norm).fold(0.0, f64::max);
                let forces = [(node, force)];
                let found = own.displacement(&forces).into_iter().zip(sides.displacement(&forces));
                for ((own, sides), (by_pad, by_layer)) in found.zip(by_pad.iter().zip(&by_layer)) {
                    // Rounding of solves for thousands of unknowns, in nearly incompressible gel.
                    let errors = [own - by_pad, sides - (by_pad - by_layer)].map(|e| e.norm());
                    assert!(errors.iter().all(|e| *e < 1e-8 * most), "{errors:?} m of {most} m");
                }
            }
        }
    }
}
