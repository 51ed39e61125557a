//! Outer surface of a soft body, for rendering.
//!
//! Shapes: B nodes of the boundary, in the order of the mesh.

use nalgebra::Point3;

use crate::deformation::Deformation;

/// Whole surface of a pad or soft object at rest, base and sides of a pad included.
#[derive(Debug)]
pub struct Shell {
    /// Indices of the boundary nodes in the mesh (B).
    nodes: Vec<u32>,
    places: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// Tetrahedra around each node, with weights that sum to 1 (B).
    shares: Vec<Vec<(u32, f64)>>,
}

impl Shell {
    /// Creates the surface from the triangles of a mesh's `boundary`, the `places` of its nodes,
    /// and for each node the tetrahedra around it with their weights (`shares`).
    pub(super) fn new(
        places: &[Point3<f64>],
        boundary: &[[u32; 3]],
        shares: &[Vec<(u32, f64)>],
    ) -> Self {
        let mut nodes: Vec<u32> = boundary.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        let mut of_node = vec![0; places.len()];
        for (own, &node) in nodes.iter().enumerate() {
            of_node[node as usize] = own as u32;
        }
        Self {
            places: nodes.iter().map(|&node| places[node as usize]).collect(),
            triangles: boundary.iter().map(|t| t.map(|node| of_node[node as usize])).collect(),
            shares: nodes.iter().map(|&node| shares[node as usize].clone()).collect(),
            nodes,
        }
    }

    /// Corners of the triangles, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Positions of the nodes (B) in m, at rest if `deformation` is `None`.
    pub fn places(&self, deformation: Option<&Deformation>) -> Vec<Point3<f64>> {
        let Some(deformation) = deformation else { return self.places.clone() };
        let nodes = self.nodes.iter().zip(&self.places);
        nodes.map(|(&node, place)| place + deformation.displacement[node as usize]).collect()
    }

    /// Von Mises stress at the nodes (B) in Pa, the mean of the tetrahedra around each; 0 if
    /// `deformation` is `None`.
    pub fn stress(&self, deformation: Option<&Deformation>) -> Vec<f64> {
        let Some(deformation) = deformation else { return vec![0.0; self.nodes.len()] };
        let mean = |shares: &Vec<(u32, f64)>| {
            shares.iter().map(|&(tet, share)| share * deformation.von_mises[tet as usize]).sum()
        };
        self.shares.iter().map(mean).collect()
    }
}
