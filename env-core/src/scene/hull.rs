//! Convex hulls as Rapier's colliders.
//!
//! Rapier joins triangles whose normals differ by less than 1.5° to one face, with the normal of
//! one of them. On a finely meshed round surface they join all the way round, and a face is bent or
//! none is left. Where that happens, a hull of fewer vertices takes the hull's place.

use std::panic::catch_unwind;

use rapier3d::{
    parry::shape::{ConvexPolyhedron, Shape},
    prelude::Vector,
};

use super::units;
use crate::geometry::Surface;

/// Greatest distance of a vertex outside a face of a simplified hull, relative to the surface's size.
/// They are tried in order until the faces are sound. With the first, a surface of 50 mm is off by
/// 0.05 mm; Rapier lets objects overlap by 0.02 mm. The faces of the catalogue's ellipsoids, which have
/// 162 vertices, differ from the ellipsoids by up to 9e-3.
const TOLERANCES: [f64; 4] = [1e-3, 2e-3, 4e-3, 8e-3];
/// Greatest height of a vertex above the lowest of a sound face, along the face's normal and
/// relative to the hull's size. Where Rapier joins a few triangles of a potato, it is 6e-3.
const BENT: f32 = 0.02;
/// Share of the volume that sound faces enclose at least. Faces of a thin needle may be joined all
/// the way round, and bent by little.
const ENCLOSED: f64 = 0.9;

/// Returns the convex hull of points in Rapier's units; `None` if Rapier finds none.
pub(super) fn of_points(points: &[Vector]) -> Option<ConvexPolyhedron> {
    // Rounding may lead its algorithm to a panic.
    catch_unwind(|| ConvexPolyhedron::from_convex_hull(points)).ok().flatten()
}

/// Returns the convex hull of a surface in Rapier's units, to within one of [`TOLERANCES`] if the
/// exact one has bent faces; `None` if that has them as well.
pub(super) fn of_surface(surface: &Surface) -> Option<ConvexPolyhedron> {
    of_points(&vertices(surface)).filter(|hull| is_sound(hull, surface)).or_else(|| {
        TOLERANCES.iter().find_map(|tolerance| {
            let few = surface.convex_hull(tolerance * surface.size())?;
            let hull = ConvexPolyhedron::from_convex_mesh(vertices(&few), few.triangles());
            hull.filter(|hull| is_sound(hull, &few))
        })
    })
}

/// Vertices in Rapier's units.
pub(super) fn vertices(surface: &Surface) -> Vec<Vector> {
    surface.vertices().iter().map(|v| units::vector(&v.coords)).collect()
}

/// Returns whether a hull's faces are flat, have nothing above them and enclose the solid
/// inside `surface`.
fn is_sound(hull: &ConvexPolyhedron, surface: &Surface) -> bool {
    let most = BENT * hull.local_aabb().extents().max_element();
    let (points, corners) = (hull.points(), hull.vertices_adj_to_face());
    let all_flat = hull.faces().iter().all(|face| {
        let first = face.first_vertex_or_edge as usize;
        let own = &corners[first..first + face.num_vertices_or_edges as usize];
        let heights = own.iter().map(|&i| points[i as usize].dot(face.normal));
        let lowest = heights.fold(f32::INFINITY, f32::min);
        points.iter().all(|p| p.dot(face.normal) - lowest <= most)
    });
    all_flat && volume(hull) > ENCLOSED * surface.mass_properties(1.0).mass
}

/// Volume that a hull's faces enclose (m³).
pub(super) fn volume(hull: &ConvexPolyhedron) -> f64 {
    f64::from(hull.mass_properties(1.0).mass()) / units::UNIT.powi(3)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    /// Ball of 20,480 triangles and cylinder of 1,024 sides, each 50 mm high.
    fn fine() -> [Surface; 2] {
        let can = [[0.0, -0.025], [0.02, -0.025], [0.02, 0.025], [0.0, 0.025]];
        [Surface::radial(160, |_| 0.025), Surface::revolved(&can, 1024, 0.0)]
    }

    #[test]
    fn hulls_of_finely_meshed_round_solids_have_their_extents_and_volume() {
        for surface in fine() {
            let (hull, size) = (of_surface(&surface).unwrap(), surface.size());
            assert!(hull.points().len() < 2500, "{} vertices", hull.points().len());
            let ratio = volume(&hull) / surface.mass_properties(1.0).mass;
            assert!(ratio > 0.995 && ratio < 1.0 + 1e-5, "{ratio} times the volume");
            for k in 0..500 {
                // Golden angle: evenly over the sphere.
                let (z, angle) = (1.0 - f64::from(k) / 250.0, 2.399_963 * f64::from(k));
                let r = (1.0 - z * z).sqrt();
                let towards = Vector3::new(r * angle.cos(), r * angle.sin(), z);
                let extent = |points: &mut dyn Iterator<Item = Vector3<f64>>| {
                    points.map(|p| p.dot(&towards)).fold(0.0, f64::max)
                };
                let exact = extent(&mut surface.vertices().iter().map(|v| v.coords));
                let found = extent(&mut hull.points().iter().map(|&p| units::si_vector(p)));
                let gap = (exact - found) / size;
                // Rounding to f32 adds 1e-7; beside an edge, a vertex is farther from the hull than
                // from the planes of its faces.
                assert!(gap > -1e-6 && gap < 1.5e-3, "{gap} of the size towards {towards}");
            }
        }
    }

    #[test]
    fn a_hull_with_sound_faces_is_kept_as_it_is() {
        let coarse = Surface::radial(40, |d| 0.02 + 0.004 * d.x * d.y);
        let exact = ConvexPolyhedron::from_convex_hull(&vertices(&coarse)).unwrap();
        assert_eq!(of_surface(&coarse), Some(exact));
    }

    #[test]
    fn joined_faces_are_not_sound() {
        for surface in fine() {
            let exact = of_points(&vertices(&surface));
            assert!(exact.is_none_or(|hull| !is_sound(&hull, &surface)));
        }
    }
}
