//! Thickness of the walls of solids, meshes included.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::Shape;

/// Most triangles from which thickness is measured.
const MOST_TRIANGLES: usize = 20_000;

impl Shape {
    /// Returns [`Shape::thickness`]; of star-shaped solids and meshes, the shortest way (m) from
    /// the middle of a triangle of the surface straight through the solid. Infinite for a
    /// half-space.
    pub fn thinnest_wall(&self) -> f64 {
        let thickness = self.thickness();
        let Some(surface) = self.surface(32).filter(|_| thickness.is_infinite()) else {
            return thickness;
        };
        let inside = 1e-6 * surface.size();
        let each = surface.triangles().len() / MOST_TRIANGLES + 1;
        let corners = |triangle: &[u32; 3]| triangle.map(|i| surface.vertices()[i as usize].coords);
        let triangles: Vec<_> = surface.triangles().iter().step_by(each).map(corners).collect();
        let solid = Self::Mesh(Arc::new(surface));
        let through = |[a, b, c]: &[Vector3<f64>; 3]| {
            let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
            let start = Point3::from((a + b + c) / 3.0 - inside * normal);
            // From inside, it is minus the way back along the ray.
            Some(inside - solid.ray_gap(&start, &normal).filter(|gap| *gap < 0.0)?)
        };
        triangles.iter().filter_map(through).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Surface;

    #[test]
    fn the_thinnest_wall_of_a_mesh_is_that_of_the_solid_it_was_made_of() {
        let half_extents = Vector3::new(0.02, 0.01, 0.001);
        let cup = Shape::Cup { bottom: 0.016, rim: 0.016, half_height: 0.02, wall: 5e-4 };
        for (solid, off) in [(Shape::Cuboid { half_extents }, 1e-9), (cup, 0.02)] {
            let mesh = Shape::Mesh(Arc::new(solid.surface(64).unwrap()));
            let (found, exact) = (mesh.thinnest_wall(), solid.thickness());
            assert!((found / exact - 1.0).abs() <= off, "{found} m against {exact} m");
            assert_eq!(solid.thinnest_wall(), exact);
        }
        assert_eq!(Shape::HalfSpace.thinnest_wall(), f64::INFINITY);
        let ball = Shape::Mesh(Arc::new(Surface::radial(64, |_| 0.02))).thinnest_wall();
        assert!((0.0395..0.04).contains(&ball), "{ball} m through a ball of 0.04 m");
    }
}
