//! Influence of the sides and the curved face of a pad, by quadratic finite elements.
//!
//! The influence is the response of the pad's elements less that of a flat layer without sides,
//! turned with the face, on the same nodes: both have the same error of discretisation, which
//! cancels. The elements are quadratic because linear ones are too inaccurate under forces on
//! single nodes.
//!
//! Shapes: F nodes of the elements' face, middles of edges among them.

use nalgebra::Vector3;

use super::face_responses::FaceResponses;
use crate::{
    Result,
    deformation::{Law, Moduli, SoftBody},
    fem::{Element, Linearised},
    geometry::{PadMesh, PadOutline},
    interrupt,
};

/// Distance in thicknesses as far as the layer goes on beyond the sides of the pad.
const BEYOND: f64 = 1.5;

/// Influence of the sides of a pad on its compliance.
pub struct Sides {
    /// All nodes of the elements as vertices.
    pub(super) mesh: PadMesh,
    responses: FaceResponses,
}

impl Sides {
    /// Vertices that suffice: twice as many change errors in displacement by 0.1 points.
    pub const VERTICES: usize = 1000;

    /// Solves for a pad on at most `vertices` vertices of quadratic elements, finest at the sides.
    /// Returns an error if it cannot be meshed.
    pub fn new(outline: &PadOutline, moduli: Moduli, vertices: usize) -> Result<Self> {
        let pad = PadMesh::towards_sides(outline, vertices)?;
        let (layer, in_layer) = pad.as_layer(BEYOND * pad.thickness())?;
        let (mesh, ends) = (pad.halved(), pad.ends_of_halves());
        let linearised = |pad: &PadMesh| {
            let body = SoftBody::new(pad.mesh.clone(), Law::Linear, moduli, &pad.base)?;
            Linearised::of(&body, Element::P2)
        };
        let solved = |elements: &Linearised, vertex: &dyn Fn(u32) -> u32| {
            FaceResponses::new(elements, &mesh, |node| {
                let [a, b] = ends[node as usize].map(vertex);
                elements.node_between(a, b)
            })
        };
        let of_layer = linearised(&layer)?;
        interrupt::check()?;
        let by_layer = solved(&of_layer, &|vertex| in_layer[vertex as usize]);
        interrupt::check()?;
        let of_pad = linearised(&pad)?;
        interrupt::check()?;
        let mut responses = solved(&of_pad, &|vertex| vertex);
        interrupt::check()?;
        responses.subtract_tilted(&by_layer, &mesh, outline);
        Ok(Self { mesh, responses })
    }

    /// Displacement of the vertices of the mesh in m under forces (N) on some of its face.
    pub(super) fn displacement(&self, forces: &[(u32, Vector3<f64>)]) -> Vec<Vector3<f64>> {
        self.responses.displacement(forces)
    }

    /// Area of the face that each of its nodes represents (F) in m².
    pub(super) fn areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.mesh.face.len()];
        for corners in &self.mesh.face_triangles {
            let [a, b, c] = corners.map(|node| self.mesh.mesh.vertices[node as usize]);
            let third = (b - a).cross(&(c - a)).norm() / 6.0;
            for &node in corners {
                areas[node as usize] += third;
            }
        }
        areas
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::Sensor;

    #[test]
    fn sides_are_the_pad_less_the_layer_that_turns_with_its_face() {
        let outline = Sensor::named("gelsight-mini").unwrap().outline;
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let sides = Sides::new(&outline, moduli, 120).unwrap();
        let pad = PadMesh::towards_sides(&outline, 120).unwrap();
        let (layer, in_layer) = pad.as_layer(BEYOND * pad.thickness()).unwrap();
        let (mesh, ends) = (pad.halved(), pad.ends_of_halves());
        let elements = [&pad, &layer].map(|pad| {
            let body = SoftBody::new(pad.mesh.clone(), Law::Linear, moduli, &pad.base).unwrap();
            Linearised::of(&body, Element::P2).unwrap()
        });
        let place = |node: u32| {
            let [a, b] = ends[node as usize];
            let layer = [a, b].map(|vertex| in_layer[vertex as usize]);
            [elements[0].node_between(a, b), elements[1].node_between(layer[0], layer[1])]
        };
        let solved = |i: usize, node: u32, force: Vector3<f64>| {
            let mut forces = vec![Vector3::zeros(); elements[i].places().len()];
            forces[place(node)[i] as usize] = force;
            elements[i].displacement(&forces, &mut elements[i].workspace())
        };
        let tilt = |node: u32| {
            let vertex = mesh.mesh.vertices[node as usize];
            outline.tilt(vertex.x, vertex.y)
        };
        for &node in mesh.face.iter().step_by(5) {
            let force = Vector3::new(1.0, -0.5, 0.3);
            let by_pad = solved(0, node, force);
            let by_layer = solved(1, node, tilt(node).tr_mul(&force));
            let most = by_pad.iter().map(Vector3::norm).fold(0.0, f64::max);
            for (other, found) in (0..).zip(sides.displacement(&[(node, force)])) {
                let [own, flat] = place(other).map(|node| node as usize);
                let right = by_pad[own] - tilt(other) * by_layer[flat];
                // Rounding of solves for thousands of unknowns, in nearly incompressible gel.
                assert!((found - right).norm() < 1e-8 * most, "{found} m instead of {right} m");
            }
        }
    }
}
