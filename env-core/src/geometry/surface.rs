//! Closed triangle surfaces and the mass properties of the solid inside.
//!
//! Volume, centroid and inertia by the divergence theorem, as sums over the tetrahedra that each
//! triangle spans with the origin; exact for the polyhedron.

use std::{collections::HashMap, f64::consts::TAU, sync::Arc};

use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

use super::{Distance, cached::Cached, distance::TriangleTree};
use crate::{Error, Result};

/// A watertight, outward-oriented triangle surface (m).
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    tree: Cached<TriangleTree>,
}

/// Mass, centre and inertia of a solid of uniform density.
#[derive(Clone, Debug, PartialEq)]
pub struct MassProperties {
    /// Mass (kg).
    pub mass: f64,
    /// Centre of mass (m).
    pub center: Point3<f64>,
    /// Inertia about the centre of mass (kg m²).
    pub inertia: Matrix3<f64>,
}

/// Most triangles of a surface: with more, the rigid-body engine and the renderer become slow.
const MOST_TRIANGLES: usize = 100_000;

/// The end of a message about a mesh that has too many triangles: a way to at `most` so many.
pub(crate) fn simplify(most: usize) -> String {
    format!(
        "; simplify it to fewer in MeshLab or Blender, or by trimesh's \
         simplify_quadric_decimation(face_count={most})"
    )
}

impl Surface {
    /// Returns a surface of these parts, or an error that names the first defect found: an index
    /// out of range, a non-finite vertex, an open or inconsistently oriented edge, no volume.
    ///
    /// Coincident vertices are merged; a surface oriented inwards as a whole is reversed.
    pub fn new(name: &str, vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Result<Self> {
        let bad = |reason: String| Error::BadMesh { name: name.to_owned(), reason };
        if triangles.is_empty() || triangles.len() > MOST_TRIANGLES {
            let (count, most) = (triangles.len(), MOST_TRIANGLES);
            let hint = if count > most { simplify(most) } else { String::new() };
            return Err(bad(format!("{count} triangles, expected 4 to {most}{hint}")));
        }
        if let Some(i) = vertices.iter().position(|v| !v.iter().all(|x| x.is_finite())) {
            return Err(bad(format!("vertex {i} is not finite")));
        }
        if let Some(i) = triangles.iter().flatten().find(|&&i| i as usize >= vertices.len()) {
            let count = vertices.len();
            return Err(bad(format!("a triangle uses vertex {i}, but there are {count}")));
        }
        let mut surface = merge_coincident(vertices, triangles);
        let unmatched = surface.unmatched_edges();
        if let Some(&(a, b)) = unmatched.first() {
            let at = |i: u32| surface.vertices[i as usize];
            let (a, b) = (at(a), at(b));
            return Err(bad(format!(
                "not watertight: the edge {a} – {b} (m) is not shared by exactly two triangles \
                 of one orientation, nor are {} others; `ruffini mesh FILE --repair OUT` closes \
                 small holes",
                unmatched.len() - 1
            )));
        }
        let volume = surface.mass_properties(1.0).mass;
        let (low, high) = surface.bounds();
        let box_volume = (high - low).product();
        if volume == 0.0 || !volume.is_finite() || volume.abs() < 1e-9 * box_volume {
            return Err(bad(format!("it encloses no volume ({volume:.3e} m³)")));
        }
        if volume < 0.0 {
            surface.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        Ok(surface)
    }

    /// Returns a surface of parts that are known to be valid.
    pub(super) fn from_parts(vertices: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> Self {
        Self { vertices, triangles, tree: Cached::default() }
    }

    /// Signed distance to the surface and its gradient at `point` (m).
    pub fn distance(&self, point: &Point3<f64>) -> Distance {
        self.tree().distance(point)
    }

    /// The triangles prepared for queries, on first use.
    pub(super) fn tree(&self) -> &TriangleTree {
        self.tree.get_or_init(|| TriangleTree::new(&self.vertices, &self.triangles))
    }

    /// Vertices (m).
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// Triangles, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Lower and upper corner of the axis-aligned bounding box (m).
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let first = self.vertices[0];
        self.vertices.iter().fold((first, first), |(low, high), v| (low.inf(v), high.sup(v)))
    }

    /// Longest edge of the bounding box (m).
    pub fn size(&self) -> f64 {
        let (low, high) = self.bounds();
        (high - low).max()
    }

    /// Mass properties of the solid inside at `density` (kg/m³).
    pub fn mass_properties(&self, density: f64) -> MassProperties {
        // Relative to a vertex, so that a body far from the origin loses no digits.
        let origin = self.vertices[0].coords;
        let (mut volume, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|i| self.vertices[i as usize].coords - origin);
            let tetrahedron = a.dot(&b.cross(&c)) / 6.0;
            let sum = a + b + c;
            volume += tetrahedron;
            first += tetrahedron / 4.0 * sum;
            let squares = [a, b, c, sum].iter().map(|v| v * v.transpose()).sum::<Matrix3<f64>>();
            second += tetrahedron / 20.0 * squares;
        }
        let center = first / volume;
        let covariance = second - volume * center * center.transpose();
        let inertia = Matrix3::identity() * covariance.trace() - covariance;
        MassProperties {
            mass: density * volume,
            center: (origin + center).into(),
            inertia: density * inertia,
        }
    }

    /// The same surface, `factor` times as large.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let vertices = self.vertices.iter().map(|v| v * factor).collect();
        Self::from_parts(vertices, self.triangles.clone())
    }

    /// The same surface, moved by `offset` (m).
    #[must_use]
    pub fn moved(&self, offset: &Vector3<f64>) -> Self {
        let vertices = self.vertices.iter().map(|v| v + offset).collect();
        Self::from_parts(vertices, self.triangles.clone())
    }

    /// Returns the surface of the solid inside minus the solid inside `cavity`, which lies within.
    pub(super) fn without(&self, cavity: &Self) -> Self {
        let first = self.vertices.len() as u32;
        let vertices = [&self.vertices[..], &cavity.vertices].concat();
        let turned = cavity.triangles.iter().map(|&[a, b, c]| [a, c, b].map(|i| first + i));
        Self::from_parts(vertices, self.triangles.iter().copied().chain(turned).collect())
    }

    /// The same surface with coincident vertices merged, and without the triangles that vanish.
    pub(super) fn merged(&self) -> Self {
        merge_coincident(&self.vertices, &self.triangles)
    }

    /// Box with edges along the axes.
    pub(crate) fn cuboid(half_extents: &Vector3<f64>) -> Self {
        let corner = |i: u32| {
            let sign = |bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            Point3::from(Vector3::new(sign(0), sign(1), sign(2)).component_mul(half_extents))
        };
        let faces =
            [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Self::from_parts((0..8).map(corner).collect(), triangles)
    }

    /// Surface swept by a profile of (radius, z) points turned about z in `segments` steps.
    ///
    /// The profile runs with the solid on its left, either from the axis to the axis or as a loop
    /// that ends where it began.
    pub(crate) fn revolved(profile: &[[f64; 2]], segments: u32, phase: f64) -> Self {
        let is_loop = profile.len() > 2 && profile[0] == profile[profile.len() - 1];
        let rings = profile[..profile.len() - usize::from(is_loop)].iter().map(|&[radius, z]| {
            let point = move |j: u32| {
                let angle = phase + TAU * f64::from(j) / f64::from(segments);
                Point3::new(radius * angle.cos(), radius * angle.sin(), z)
            };
            (0..if radius == 0.0 { 1 } else { segments }).map(point).collect()
        });
        Self::lofted(rings, is_loop)
    }

    /// Surface through rings of points, counter-clockwise seen from above, each of as many points
    /// or of a single one. The last ring is joined to the first if it `is_loop`.
    pub(super) fn lofted(rings: impl Iterator<Item = Vec<Point3<f64>>>, is_loop: bool) -> Self {
        let (mut vertices, mut numbers, mut most) = (Vec::new(), Vec::new(), 0);
        for ring in rings {
            let count = ring.len() as u32;
            numbers.push((vertices.len() as u32, count));
            most = count.max(most);
            vertices.extend(ring);
        }
        if is_loop {
            numbers.push(numbers[0]);
        }
        let at = |(first, count): (u32, u32), j: u32| first + j % count;
        let mut triangles = Vec::new();
        for (&low, &high) in numbers.iter().zip(&numbers[1..]) {
            for j in 0..most {
                let [a, b] = [at(low, j), at(low, j + 1)];
                let [c, d] = [at(high, j), at(high, j + 1)];
                if a != b {
                    triangles.push([a, b, d]);
                }
                if c != d {
                    triangles.push([a, d, c]);
                }
            }
        }
        Self::from_parts(vertices, triangles)
    }

    /// Surface at distance `radius(d)` from the origin along every unit vector d, from a subdivided
    /// icosahedron with about `segments` edges round a great circle.
    pub(crate) fn radial(segments: u32, radius: impl Fn(&Vector3<f64>) -> f64) -> Self {
        let (mut directions, mut triangles) = icosahedron();
        let levels = (f64::from(segments) / 5.0).log2().round().clamp(1.0, 6.0) as u32;
        for _ in 0..levels {
            triangles = subdivide(&mut directions, &triangles);
        }
        let vertices = directions.iter().map(|d| Point3::from(radius(d) * d)).collect();
        Self::from_parts(vertices, triangles)
    }

    /// Returns a directed edge that is used twice, or whose reverse is not used.
    fn unmatched_edges(&self) -> Vec<(u32, u32)> {
        let mut count: HashMap<(u32, u32), i32> = HashMap::new();
        for &[a, b, c] in &self.triangles {
            for edge in [(a, b), (b, c), (c, a)] {
                *count.entry(edge).or_default() += 1;
            }
        }
        let matched = |&(a, b): &(u32, u32), n: i32| n == 1 && count.get(&(b, a)) == Some(&1);
        let unmatched = count.iter().filter(|&(edge, &n)| !matched(edge, n));
        let mut edges: Vec<_> = unmatched.map(|(&edge, _)| edge).collect();
        edges.sort_unstable();
        edges
    }
}

fn merge_coincident(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Surface {
    let mut index = HashMap::new();
    let mut merged = Vec::new();
    let renumbered: Vec<u32> = vertices
        .iter()
        .map(|v| {
            // Adding zero turns −0 into 0, which is the same point.
            let key = [v.x + 0.0, v.y + 0.0, v.z + 0.0].map(f64::to_bits);
            *index.entry(key).or_insert_with(|| {
                merged.push(*v);
                merged.len() as u32 - 1
            })
        })
        .collect();
    let triangles = triangles
        .iter()
        .map(|t| t.map(|i| renumbered[i as usize]))
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect();
    Surface::from_parts(merged, triangles)
}

fn icosahedron() -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let golden = f64::midpoint(1.0, 5f64.sqrt());
    let mut corners = Vec::new();
    for (a, b) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
        corners.extend([[0.0, a, b], [a, b, 0.0], [b, 0.0, a]].map(Vector3::from));
    }
    let near = |i: usize, j: usize| (corners[i] - corners[j]).norm() < 2.1;
    let mut triangles = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if near(i, j) && near(j, k) && near(k, i) {
                    let outward = corners[i].dot(&corners[j].cross(&corners[k])) > 0.0;
                    let [i, j, k] = [i, j, k].map(|n| n as u32);
                    triangles.push(if outward { [i, j, k] } else { [i, k, j] });
                }
            }
        }
    }
    (corners.iter().map(Vector3::normalize).collect(), triangles)
}

fn subdivide(directions: &mut Vec<Vector3<f64>>, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut middles = HashMap::new();
    let mut middle = |a: u32, b: u32| {
        *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
            directions.push((directions[a as usize] + directions[b as usize]).normalize());
            directions.len() as u32 - 1
        })
    };
    let mut finer = Vec::with_capacity(4 * triangles.len());
    for &[a, b, c] in triangles {
        let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
        finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    finer
}

/// Outward unit normals at the `vertices` of `triangles`: means weighted by area, zero where there
/// is none.
pub(crate) fn vertex_normals(
    vertices: &[Point3<f64>],
    triangles: &[[u32; 3]],
) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::<f64>::zeros(); vertices.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| vertices[vertex as usize]);
        let twice_area = (b - a).cross(&(c - a));
        for &vertex in triangle {
            normals[vertex as usize] += twice_area;
        }
    }
    normals.iter().map(|sum| sum.try_normalize(0.0).unwrap_or_default()).collect()
}

/// Serialises a shared surface as its vertices and triangles.
pub(super) fn serialize<S: Serializer>(
    surface: &Arc<Surface>,
    to: S,
) -> std::result::Result<S::Ok, S::Error> {
    (surface.vertices(), surface.triangles()).serialize(to)
}

/// Reverses [`serialize`], and checks the surface as one of a file.
pub(super) fn deserialize<'de, D: Deserializer<'de>>(
    from: D,
) -> std::result::Result<Arc<Surface>, D::Error> {
    let (vertices, triangles): (Vec<_>, Vec<_>) = Deserialize::deserialize(from)?;
    Surface::new("saved", &vertices, &triangles).map(Arc::new).map_err(D::Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Shape, examples::solids};

    #[test]
    fn every_shape_has_a_watertight_outward_surface() {
        for shape in solids() {
            let surface = shape.validated().unwrap().surface(32).unwrap();
            let checked = Surface::new("shape", &surface.vertices, &surface.triangles);
            assert_eq!(checked.as_ref(), Ok(&surface), "{surface:?}");
        }
    }

    #[test]
    fn volumes_converge_to_the_closed_forms() {
        let (pi, r, h) = (std::f64::consts::PI, 0.02, 0.03);
        let cases = [
            (Shape::Sphere { radius: r }, 4.0 / 3.0 * pi * r.powi(3)),
            (Shape::Cylinder { radius: r, half_height: h }, 2.0 * pi * r * r * h),
            (Shape::Cone { radius: r, half_height: h }, 2.0 / 3.0 * pi * r * r * h),
            (
                Shape::Capsule { radius: r, half_height: h },
                2.0 * pi * r * r * h + 4.0 / 3.0 * pi * r.powi(3),
            ),
            (
                Shape::Annulus { outer: 0.03, inner: r, half_height: h },
                2.0 * pi * h * (0.03f64.powi(2) - r * r),
            ),
        ];
        for (shape, exact) in cases {
            let volume = |n| shape.surface(n).unwrap().mass_properties(1.0).mass;
            let (coarse, fine) = (volume(40) / exact - 1.0, volume(80) / exact - 1.0);
            let rate = (coarse / fine).log2();
            assert!((rate - 2.0).abs() < 0.1, "{shape:?}: rate {rate}, error {fine}");
        }
    }

    #[test]
    fn mass_properties_of_a_cuboid_are_exact_wherever_it_lies() {
        let surface = Surface::cuboid(&Vector3::new(0.01, 0.02, 0.03));
        let offset = Vector3::new(0.5, -0.25, 1.0);
        let moved: Vec<_> = surface.vertices.iter().map(|v| v + offset).collect();
        let p = Surface::new("moved", &moved, &surface.triangles).unwrap().mass_properties(1000.0);
        let mass = 1000.0 * 0.02 * 0.04 * 0.06;
        let exact = [(0.04, 0.06), (0.02, 0.06), (0.02, 0.04)]
            .map(|(a, b): (f64, f64)| mass / 12.0 * (a * a + b * b));
        assert!((p.mass / mass - 1.0).abs() < 1e-12, "{} kg against {mass} kg", p.mass);
        assert!((p.center.coords - offset).norm() < 1e-12, "{}", p.center);
        for (i, exact) in exact.into_iter().enumerate() {
            let found = p.inertia[(i, i)];
            assert!((found / exact - 1.0).abs() < 1e-9, "{found} kg m² against {exact} kg m²");
        }
    }

    #[test]
    fn defects_are_named() {
        let good = Surface::cuboid(&Vector3::repeat(0.01));
        let message =
            |v: &[Point3<f64>], t: &[[u32; 3]]| Surface::new("box", v, t).unwrap_err().to_string();
        let (v, t) = (&good.vertices, &good.triangles);
        assert!(message(v, &t[1..]).contains("not watertight"));
        assert!(message(v, &[[0, 1, 9]]).contains("uses vertex 9"));
        assert!(message(v, &[]).contains("0 triangles"));
        let mut turned = t.clone();
        turned[3].swap(0, 1);
        assert!(message(v, &turned).contains("not watertight"));
        let mut infinite = v.clone();
        infinite[2].x = f64::NAN;
        assert!(message(&infinite, t).contains("vertex 2 is not finite"));
        let flat: Vec<_> = v.iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect();
        assert!(Surface::new("flat", &flat, t).is_err());
    }

    #[test]
    fn a_small_solid_is_accepted_far_from_the_origin_and_a_flat_one_is_not() {
        let cube = Surface::cuboid(&Vector3::repeat(4.5e-4));
        let at = |flat: f64| -> Vec<_> {
            let place = |v: &Point3<f64>| Point3::new(1.0 + v.x, 1.0 + v.y, 1.0 + flat * v.z);
            cube.vertices.iter().map(place).collect()
        };
        let volume =
            Surface::new("cube", &at(1.0), &cube.triangles).map(|s| s.mass_properties(1.0));
        let volume = volume.unwrap().mass;
        assert!((volume / 9e-4f64.powi(3) - 1.0).abs() < 1e-9, "{volume} m³");
        assert!(Surface::new("flat", &at(0.0), &cube.triangles).is_err());
    }

    #[test]
    fn an_inward_surface_is_turned_round() {
        let good = Surface::cuboid(&Vector3::repeat(0.01));
        let inward: Vec<_> = good.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
        let turned = Surface::new("box", &good.vertices, &inward).unwrap();
        assert!(turned.mass_properties(1.0).mass > 0.0);
    }
}
