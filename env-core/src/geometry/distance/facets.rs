//! Triangles of a placed solid, for pictures: rasterised, they are quicker than a ray through each
//! pixel.

use nalgebra::{Point3, Similarity3, Vector3};

use crate::geometry::{Shape, StarShaped};

/// Corners of a triangle (m), counter-clockwise seen from outside.
type Corners = [Point3<f64>; 3];

/// Longest edge of the triangles of a smooth solid of hand size (m).
const FINE: f64 = 4e-4;
/// Most parts into which an edge of a facet is cut.
const MOST_PARTS: f64 = 16.0;
/// Margin for the sag of the facets of a smooth solid, over its largest semi-axis.
const SAG: f64 = 0.02;

impl Shape {
    /// Triangles of the solid's surface, enlarged and placed by `place`: at least those that meet
    /// the box between the corners `within` (m), which may be infinite. `None` for a solid of which
    /// rays are as quick ([`Self::ray_gap`]).
    ///
    /// Exact for meshes, prisms and cuboids. Those of smooth solids have edges e of up to 0.4 mm
    /// and corners on the surface, from which they are e²/6R off where its radius is R: 2 µm at 15
    /// mm.
    pub fn triangles_near(
        &self,
        place: &Similarity3<f64>,
        within: &[Point3<f64>; 2],
    ) -> Option<Vec<Corners>> {
        let triangles = match self {
            Self::Mesh(surface) => surface.tree().near(place, within),
            Self::Prism { .. } | Self::Cuboid { .. } => self.surface(0)?.tree().near(place, within),
            Self::StarShaped(star) => star.triangles_near(place, within),
            Self::Hollow(hollow) => {
                let mut outer = hollow.solid().triangles_near(place, within);
                let cavity = place.prepend_scaling(hollow.cavity());
                let inner = hollow.solid().triangles_near(&cavity, within);
                outer.extend(inner.iter().map(|t| [0, 2, 1].map(|i| hollow.cavity() * t[i])));
                outer
            }
            Self::Sampled(sampled) => {
                let place = place.prepend_scaling(sampled.scale());
                return sampled.exact().triangles_near(&place, within);
            }
            _ => return None,
        };
        Some(triangles.iter().map(|corners| corners.map(|corner| place * corner)).collect())
    }
}

impl StarShaped {
    /// Facets that may meet the box `within` once they are placed, cut into triangles with corners
    /// on the surface; before they are placed.
    fn triangles_near(
        &self,
        place: &Similarity3<f64>,
        [low, high]: &[Point3<f64>; 2],
    ) -> Vec<Corners> {
        let margin = Vector3::repeat(SAG * place.scaling() * self.semi_axes().max());
        let facets = self.facets().tree().near(place, &[low - margin, high + margin]);
        let edges = facets.iter().flat_map(|[a, b, c]| [b - a, c - b, a - c]);
        let longest = place.scaling() * edges.map(|edge| edge.norm()).fold(0.0, f64::max);
        // As many for all, so that neighbours share the corners along their edge.
        let parts = (longest / FINE).ceil().clamp(1.0, MOST_PARTS) as usize;
        facets.iter().flat_map(|facet| self.cut(facet, parts)).collect()
    }

    /// Cuts a facet into `parts`² triangles, with their corners moved onto the surface.
    fn cut(&self, [a, b, c]: &Corners, parts: usize) -> Vec<Corners> {
        let [along, across] = [b - a, c - a].map(|edge| edge / parts as f64);
        let corner = |i: usize, j: usize| {
            Point3::from(self.onto_surface(&(a.coords + i as f64 * along + j as f64 * across)))
        };
        let rows: Vec<Vec<_>> =
            (0..=parts).map(|i| (0..=parts - i).map(|j| corner(i, j)).collect()).collect();
        let mut triangles = Vec::with_capacity(parts * parts);
        for (row, next) in rows.iter().zip(&rows[1..]) {
            for j in 0..next.len() {
                triangles.push([row[j], next[j], row[j + 1]]);
                if j + 1 < next.len() {
                    triangles.push([next[j], next[j + 1], row[j + 1]]);
                }
            }
        }
        triangles
    }
}
