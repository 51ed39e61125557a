//! Tetrahedra for any solid with a signed distance: isosurface stuffing (Labelle and Shewchuk,
//! "Isosurface stuffing: fast tetrahedral meshes with good dihedral angles", SIGGRAPH 2007).
//!
//! The solid is laid over a body-centred cubic lattice of congruent tetrahedra: two long edges of
//! one spacing, along the axes, and four short ones of √3/2. Where the surface cuts an edge close
//! to a lattice point, that point is moved onto the cut; every lattice tetrahedron is then replaced
//! by its part inside. All vertices of the boundary lie on the surface. Dihedral angles stay
//! between 10.7° and 164.8° (proven in the paper for smooth solids; 16° to 150° in the tests, 9.9°
//! once on the sharp rim of a cup). Sharp edges are cut off within about half a spacing, and walls
//! thinner than a spacing may be lost.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

use super::{Shape, TetMesh};
use crate::{Error, Result};

/// Relative distance along a long and a short edge within which a cut pulls the lattice point onto
/// itself (section 3.2 of the paper).
const PULL: [f64; 2] = [0.24999, 0.41189];
/// Most lattice points in a solid's bounding box.
const MOST_POINTS: f64 = 2e6;

/// Lattice coordinates in half spacings: all even or all odd.
type LatticeSite = [i32; 3];

impl TetMesh {
    /// Meshes the solid inside `shape` with edges of about `spacing` (m).
    pub fn of_shape(shape: &Shape, spacing: f64) -> Result<Self> {
        if !(spacing.is_finite() && spacing > 0.0) {
            return Err(Error::invalid("spacing", format!("{spacing} m"), "a length above 0"));
        }
        let surface = shape.surface(32).ok_or_else(|| {
            Error::invalid("shape", "a half-space", "a solid of finite size to fill")
        })?;
        // The facets of a curved surface lie a little inside it.
        let margin = Vector3::repeat(spacing + 0.02 * surface.size());
        let (low, high) = surface.bounds();
        let (low, size) = (low - margin, high - low + 2.0 * margin);
        let points = 2.0 * size.iter().map(|s| s / spacing + 1.0).product::<f64>();
        if points > MOST_POINTS {
            let found = format!("{spacing} m, {points:.0} lattice points");
            return Err(Error::invalid("spacing", found, format!("at most {MOST_POINTS}")));
        }
        let cubes = size.map(|s| (s / spacing).ceil() as i32).into();
        let mut lattice = Lattice { shape, low, spacing, points: HashMap::new() };
        lattice.sample(cubes);
        lattice.pull();
        let mut filling = Filling::new(&lattice);
        for tet in lattice_tets(cubes) {
            filling.fill(&tet);
        }
        if filling.tets.is_empty() {
            let expected = "a spacing below the solid's thickness";
            return Err(Error::invalid("spacing", format!("{spacing} m"), expected));
        }
        let name = format!("of {spacing} m spacing");
        Self::new(&name, filling.vertices, filling.tets)
    }
}

/// A lattice point near the solid.
#[derive(Clone, Copy)]
struct LatticePoint {
    position: Point3<f64>,
    /// Distance to the surface (m), negative inside; 0 once pulled onto it.
    distance: f64,
}

struct Lattice<'a> {
    shape: &'a Shape,
    low: Point3<f64>,
    spacing: f64,
    points: HashMap<LatticeSite, LatticePoint>,
}

impl Lattice<'_> {
    fn sample(&mut self, cubes: [i32; 3]) {
        for (parity, n) in [(0, cubes.map(|n| n + 1)), (1, cubes)] {
            for i in 0..n[0] {
                for j in 0..n[1] {
                    for k in 0..n[2] {
                        let site = [i, j, k].map(|x| 2 * x + parity);
                        let offset = Vector3::from(site.map(f64::from)) * (0.5 * self.spacing);
                        let position = self.low + offset;
                        let distance = self.shape.distance(&position).value;
                        self.points.insert(site, LatticePoint { position, distance });
                    }
                }
            }
        }
    }

    /// Moves every point onto the nearest cut of its edges, if one is near enough.
    fn pull(&mut self) {
        let neighbours = neighbours();
        let mut sites: Vec<LatticeSite> = self.points.keys().copied().collect();
        sites.sort_unstable();
        for site in sites {
            let point = self.points[&site];
            // No edge is longer than one spacing.
            if point.distance == 0.0 || point.distance.abs() > self.spacing {
                continue;
            }
            let mut nearest: Option<(f64, Point3<f64>)> = None;
            for &(step, limit) in &neighbours {
                let beside = [0, 1, 2].map(|a| site[a] + step[a]);
                let Some(other) = self.points.get(&beside) else { continue };
                if point.distance * other.distance >= 0.0 {
                    continue;
                }
                let (share, cut) = self.cut(&point, other);
                let relative = share / limit;
                if relative < 1.0 && nearest.is_none_or(|(least, _)| relative < least) {
                    nearest = Some((relative, cut));
                }
            }
            if let Some((_, position)) = nearest {
                self.points.insert(site, LatticePoint { position, distance: 0.0 });
            }
        }
    }

    /// Intersection of the surface with the edge between points on both sides of it: the share of
    /// the edge from `a`, and the position, by the Illinois variant of the false-position method.
    fn cut(&self, a: &LatticePoint, b: &LatticePoint) -> (f64, Point3<f64>) {
        let at = |t: f64| a.position + t * (b.position - a.position);
        let (mut low, mut high) = ((0.0, a.distance), (1.0, b.distance));
        let mut t = 0.5;
        for _ in 0..60 {
            t = (low.0 * high.1 - high.0 * low.1) / (high.1 - low.1);
            let value = self.shape.distance(&at(t)).value;
            if value.abs() <= 1e-9 * self.spacing {
                break;
            }
            if (value > 0.0) == (high.1 > 0.0) {
                high = (t, value);
                low.1 *= 0.5;
            } else {
                low = (t, value);
                high.1 *= 0.5;
            }
        }
        (t, at(t))
    }
}

/// The 14 edges of a lattice point: the step to the other end, and the limit of [`PULL`].
fn neighbours() -> Vec<(LatticeSite, f64)> {
    let signs = [-1, 1];
    let long = (0..3).flat_map(|axis| {
        signs.map(|sign| {
            let mut step = [0; 3];
            step[axis] = 2 * sign;
            (step, PULL[0])
        })
    });
    let short = (0..8).map(|i: i32| ([i & 1, i >> 1 & 1, i >> 2 & 1].map(|b| 2 * b - 1), PULL[1]));
    long.chain(short).collect()
}

/// The tetrahedra of the lattice over a box of cubes: around every face between two cubes, their
/// centres and each edge of the face. Corners 0–1 and 2–3 are the long edges.
fn lattice_tets(cubes: [i32; 3]) -> impl Iterator<Item = [LatticeSite; 4]> {
    let [nx, ny, nz] = cubes;
    let all = (0..nx).flat_map(move |i| (0..ny).flat_map(move |j| (0..nz).map(move |k| [i, j, k])));
    all.flat_map(move |cube| (0..3).map(move |axis| (cube, axis)))
        .filter(move |(cube, axis)| cube[*axis] + 1 < cubes[*axis])
        .flat_map(|(cube, axis)| {
            let center = cube.map(|x| 2 * x + 1);
            let moved = |from: LatticeSite, axis: usize, by: i32| {
                let mut site = from;
                site[axis] += by;
                site
            };
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let face = moved(center, axis, 1);
            let ring =
                [(-1, -1), (1, -1), (1, 1), (-1, 1)].map(|(a, b)| moved(moved(face, u, a), v, b));
            (0..4).map(move |i| [center, moved(center, axis, 2), ring[i], ring[(i + 1) % 4]])
        })
}

/// The mesh under construction.
struct Filling<'a> {
    lattice: &'a Lattice<'a>,
    vertices: Vec<Point3<f64>>,
    tets: Vec<[u32; 4]>,
    /// Rank that decides between the diagonals of a four-sided face: the one from its first vertex
    /// is taken. Cuts of short edges come first: of the orders tried this gives the best angles.
    rank: Vec<(u8, LatticeSite)>,
    of_site: HashMap<LatticeSite, u32>,
    of_edge: HashMap<[LatticeSite; 2], u32>,
}

impl<'a> Filling<'a> {
    fn new(lattice: &'a Lattice<'a>) -> Self {
        Self {
            lattice,
            vertices: Vec::new(),
            tets: Vec::new(),
            rank: Vec::new(),
            of_site: HashMap::new(),
            of_edge: HashMap::new(),
        }
    }

    /// Adds the part of one lattice tetrahedron that is inside.
    fn fill(&mut self, tet: &[LatticeSite; 4]) {
        let distance = |site: &LatticeSite| self.lattice.points[site].distance;
        let pick = |keep: fn(f64) -> bool| -> Vec<LatticeSite> {
            tet.iter().copied().filter(|site| keep(distance(site))).collect()
        };
        let (inside, on, outside) = (pick(|d| d < 0.0), pick(|d| d == 0.0), pick(|d| d > 0.0));
        match (&inside[..], &on[..], &outside[..]) {
            ([], ..) => {}
            (_, _, []) => {
                let corners = tet.map(|site| self.corner(site));
                self.tets.push(corners);
            }
            ([a], on, outside) => {
                let mut corners = vec![self.corner(*a)];
                corners.extend(on.iter().map(|&z| self.corner(z)));
                corners.extend(outside.iter().map(|&d| self.cut(*a, d)));
                self.tets.push(corners.try_into().expect("four corners of one tetrahedron"));
            }
            (&[a, b], &[z], &[d]) => {
                let quad = [self.corner(a), self.corner(b), self.cut(b, d), self.cut(a, d)];
                let apex = self.corner(z);
                self.pyramid(quad, apex);
            }
            (&[a, b], [], &[c, d]) => {
                let ends = [a, b].map(|p| [self.corner(p), self.cut(p, c), self.cut(p, d)]);
                self.prism(ends);
            }
            (&[a, b, c], [], &[d]) => {
                let inner = [a, b, c].map(|p| self.corner(p));
                let cuts = [a, b, c].map(|p| self.cut(p, d));
                self.prism([inner, cuts]);
            }
            _ => unreachable!("four corners"),
        }
    }

    fn corner(&mut self, site: LatticeSite) -> u32 {
        *self.of_site.entry(site).or_insert_with(|| {
            self.vertices.push(self.lattice.points[&site].position);
            self.rank.push((2, site));
            self.vertices.len() as u32 - 1
        })
    }

    /// The vertex where the surface cuts the edge from `inside` to `outside`.
    fn cut(&mut self, inside: LatticeSite, outside: LatticeSite) -> u32 {
        *self.of_edge.entry([inside, outside]).or_insert_with(|| {
            let [a, b] = [inside, outside].map(|site| self.lattice.points[&site]);
            self.vertices.push(self.lattice.cut(&a, &b).1);
            let long = (inside[0] - outside[0]) % 2 == 0;
            self.rank.push((u8::from(long), inside));
            self.vertices.len() as u32 - 1
        })
    }

    fn first<const N: usize>(&self, of: [u32; N]) -> usize {
        let rank = |&i: &usize| self.rank[of[i] as usize];
        (0..N).min_by_key(rank).expect("not empty")
    }

    fn pyramid(&mut self, quad: [u32; 4], apex: u32) {
        let from = self.first(quad);
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| quad[(from + i) % 4]);
        self.tets.extend([[a, b, c, apex], [a, c, d, apex]]);
    }

    /// Splits a prism between two triangles with matching corners. Diagonals from the first vertex
    /// of every side never form a cycle (Dompierre et al., "How to subdivide pyramids, prisms and
    /// hexahedra into tetrahedra", 1999).
    fn prism(&mut self, [p, q]: [[u32; 3]; 2]) {
        let first = self.first([p[0], p[1], p[2], q[0], q[1], q[2]]);
        let (p, q) = if first < 3 { (p, q) } else { (q, p) };
        let [a, b, c] = [0, 1, 2].map(|i| p[(first + i) % 3]);
        let [d, e, f] = [0, 1, 2].map(|i| q[(first + i) % 3]);
        self.tets.push([a, d, e, f]);
        if self.first([b, f, c, e]) < 2 {
            self.tets.extend([[a, b, c, f], [a, b, f, e]]);
        } else {
            self.tets.extend([[a, b, c, e], [a, e, c, f]]);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::geometry::examples::solids;

    #[test]
    fn every_solid_is_filled_well() {
        let star = solids().pop().expect("examples");
        let mesh = Shape::Mesh(Arc::new(star.surface(32).unwrap()));
        for shape in solids().into_iter().chain([mesh]) {
            let spacing = 0.0023;
            let mesh = TetMesh::of_shape(&shape, spacing).unwrap();
            // The bounds of Labelle and Shewchuk for these PULLs.
            let quality = mesh.quality();
            let [least, most] = [quality.min_dihedral, quality.max_dihedral].map(f64::to_degrees);
            assert!(least > 10.7 && most < 164.8, "{shape:?}: {least}° to {most}°");
            let surface = mesh.surface().unwrap();
            for vertex in surface.vertices() {
                let off = shape.distance(vertex).value;
                assert!(off.abs() <= 1e-9 * spacing, "{shape:?}: {off} m off the surface");
            }
            let enclosed = surface.mass_properties(1.0).mass;
            let volume = mesh.volume();
            // Sums of some 40,000 terms.
            assert!((enclosed / volume - 1.0).abs() < 1e-10, "{enclosed} m³ against {volume} m³");
        }
    }

    #[test]
    fn the_volume_of_a_ball_converges_at_second_order() {
        let radius = 0.02;
        let exact = 4.0 / 3.0 * std::f64::consts::PI * radius * radius * radius;
        let error = |spacing: f64| {
            let mesh = TetMesh::of_shape(&Shape::Sphere { radius }, spacing).unwrap();
            1.0 - mesh.volume() / exact
        };
        let (coarse, fine) = (error(0.004), error(0.002));
        let rate = (coarse / fine).log2();
        assert!((rate - 2.0).abs() < 0.15, "rate {rate}: errors {coarse} and {fine}");
    }

    #[test]
    fn edges_are_about_as_long_as_asked() {
        let spacing = 0.002;
        let mesh = TetMesh::of_shape(&Shape::Sphere { radius: 0.02 }, spacing).unwrap();
        let edges = mesh.edges();
        let length =
            |&[a, b]: &[u32; 2]| (mesh.vertices[a as usize] - mesh.vertices[b as usize]).norm();
        let mean = edges.iter().map(length).sum::<f64>() / edges.len() as f64;
        // Six edges of a lattice tetrahedron: two of 1 and four of 0.87 spacings.
        assert!((mean / spacing - 0.91).abs() < 0.05, "{mean} m for a spacing of {spacing} m");
    }

    #[test]
    fn what_cannot_be_filled_is_named() {
        let message = |shape: &Shape, h| TetMesh::of_shape(shape, h).unwrap_err().to_string();
        let ball = Shape::Sphere { radius: 0.01 };
        assert!(message(&Shape::HalfSpace, 0.01).contains("a half-space"));
        assert!(message(&ball, 0.0).contains("above 0"));
        assert!(message(&ball, 1e-5).contains("lattice points"));
        let sheet = Shape::Cuboid { half_extents: Vector3::new(0.02, 0.02, 1e-5) };
        let lost = message(&sheet, 0.0101);
        assert!(lost.contains("thickness") || lost.contains("parts"), "{lost}");
    }
}
