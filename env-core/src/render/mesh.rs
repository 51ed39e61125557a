//! Surface prepared for drawing: corner normals that keep edges crisp and curves smooth.

use nalgebra::{Point3, Vector3};

use crate::{
    Error, Result,
    geometry::{Incidence, Surface},
};

/// Angle between two faces below which they are shaded as one curved surface (rad).
const CREASE: f64 = 0.55;

/// Vertices, triangles and the normal at every corner of every triangle, in the body's frame (m).
#[derive(Clone, Debug)]
pub struct RenderMesh {
    pub(super) vertices: Vec<Point3<f64>>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Unit normals at the corners of each triangle.
    pub(super) normals: Vec<[Vector3<f32>; 3]>,
    /// Bounding sphere of the vertices.
    pub(super) center: Point3<f64>,
    pub(super) radius: f64,
}

impl RenderMesh {
    /// Creates the mesh of a surface.
    pub fn new(surface: &Surface) -> Self {
        Self::from_parts(surface.vertices().to_vec(), surface.triangles().to_vec())
    }

    /// Creates the mesh of the surface of a deformed body, whose `triangles` are those of its valid
    /// surface at rest. Returns an error if a vertex is not finite.
    pub(super) fn deformed(vertices: Vec<Point3<f64>>, triangles: &[[u32; 3]]) -> Result<Self> {
        if let Some(i) = vertices.iter().position(|v| !v.iter().all(|x| x.is_finite())) {
            return Err(Error::invalid("vertices", format!("{} at {i}", vertices[i]), "finite"));
        }
        Ok(Self::from_parts(vertices, triangles.to_vec()))
    }

    /// Number of vertices, and therefore of vertex colours.
    pub fn vertex_count(&self) -> usize {
        self.vertices.len()
    }

    fn from_parts(vertices: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> Self {
        let normals = corner_normals(&vertices, &triangles);
        let first = vertices[0];
        let (low, high) =
            vertices.iter().fold((first, first), |(low, high), v| (low.inf(v), high.sup(v)));
        let center = nalgebra::center(&low, &high);
        let radius = 0.5 * (high - low).norm();
        Self { vertices, triangles, normals, center, radius }
    }
}

/// Normal at each corner: the sum of the area vectors of those triangles around its vertex that
/// meet its own triangle at less than the crease angle.
///
/// Weighting by area keeps a large flat face flat beside a narrow bevel.
fn corner_normals(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<[Vector3<f32>; 3]> {
    let areas: Vec<Vector3<f64>> = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| vertices[i as usize]);
            (b - a).cross(&(c - a))
        })
        .collect();
    let units: Vec<Vector3<f64>> = areas.iter().map(unit).collect();
    let around = Incidence::around(vertices.len(), triangles);
    let smooth = CREASE.cos();
    let corner = |triangle: usize, vertex: u32| {
        let own = units[triangle];
        let near = around.of(vertex).iter().filter(|&&t| units[t as usize].dot(&own) >= smooth);
        let sum = near.map(|&t| areas[t as usize]).sum::<Vector3<f64>>();
        unit(&(sum + 1e-9 * areas[triangle])).cast::<f32>()
    };
    triangles.iter().enumerate().map(|(t, vertices)| vertices.map(|v| corner(t, v))).collect()
}

/// Unit vector along `v`, or along z for a triangle without area.
fn unit(v: &Vector3<f64>) -> Vector3<f64> {
    v.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;

    #[test]
    fn a_cuboid_is_crisp_and_a_sphere_smooth() {
        let cuboid = Shape::Cuboid { half_extents: Vector3::new(0.01, 0.02, 0.03) };
        for normals in RenderMesh::new(&cuboid.surface(8).unwrap()).normals {
            assert!(normals.iter().all(|n| n.amax() > 1.0 - 1e-6), "{normals:?}");
        }
        let sphere = RenderMesh::new(&Shape::Sphere { radius: 0.02 }.surface(40).unwrap());
        for (corners, normals) in sphere.triangles.iter().zip(&sphere.normals) {
            for (&v, normal) in corners.iter().zip(normals) {
                let exact = sphere.vertices[v as usize].coords.normalize();
                let error = normal.cast::<f64>().angle(&exact);
                // Normals interpolated over flat facets deviate by up to half of the angle that an
                // edge spans.
                assert!(error < 0.08, "{error} rad off the radius");
            }
        }
    }

    #[test]
    fn vertices_that_are_not_finite_are_refused() {
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, f64::NAN, 0.0]].map(Point3::from);
        let message = RenderMesh::deformed(corners.into(), &[[0, 1, 2]]).unwrap_err().to_string();
        assert!(message.contains("at 2, expected finite"), "{message}");
    }
}
