//! Tetrahedral volume meshes.

use nalgebra::Point3;

/// A tetrahedral mesh: V vertices, T tetrahedra.
#[derive(Clone, Debug, PartialEq)]
pub struct TetMesh {
    /// Vertices (V, 3) in m.
    pub vertices: Vec<Point3<f64>>,
    /// Tetrahedra (T, 4), positively oriented: (b − a) × (c − a) · (d − a) > 0.
    pub tets: Vec<[u32; 4]>,
}
