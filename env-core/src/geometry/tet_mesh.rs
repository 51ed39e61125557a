//! Tetrahedral volume meshes: their validation, and quantities derived from them.

use std::collections::{BTreeSet, HashMap};

use nalgebra::{Point3, Vector3};

use super::Surface;
use crate::{Error, Result};

/// A tetrahedral mesh: V vertices, T tetrahedra.
///
/// [`TetMesh::new`] checks the properties that all users of a mesh rely on.
#[derive(Clone, Debug, PartialEq)]
pub struct TetMesh {
    /// Vertices (V, 3) in m.
    pub vertices: Vec<Point3<f64>>,
    /// Tetrahedra (T, 4), positively oriented: (b − a) × (c − a) · (d − a) > 0.
    pub tets: Vec<[u32; 4]>,
}

/// The worst tetrahedra of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshQuality {
    /// Smallest angle between two faces of a tetrahedron (rad).
    pub min_dihedral: f64,
    /// Largest angle between two faces of a tetrahedron (rad).
    pub max_dihedral: f64,
    /// Smallest 3 · inscribed radius / circumscribed radius: 1 for a regular tetrahedron, 0 flat.
    pub min_radius_ratio: f64,
}

/// For every vertex, the indices of the items that belong to it, in rising order.
#[derive(Clone, Debug, PartialEq)]
pub struct Incidence {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Incidence {
    /// Simplices around each of `count` vertices, of which `simplices` lists the corners.
    pub(crate) fn around<const N: usize>(count: usize, simplices: &[[u32; N]]) -> Self {
        let mut starts = vec![0; count + 1];
        for &v in simplices.iter().flatten() {
            starts[v as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = starts.clone();
        let mut items = vec![0; N * simplices.len()];
        for (i, corners) in simplices.iter().enumerate() {
            for &v in corners {
                items[next[v as usize] as usize] = i as u32;
                next[v as usize] += 1;
            }
        }
        Self { starts, items }
    }

    /// Items that belong to `vertex`.
    pub fn of(&self, vertex: u32) -> &[u32] {
        let [from, to] = [vertex, vertex + 1].map(|i| self.starts[i as usize] as usize);
        &self.items[from..to]
    }
}

/// Most vertices and most tetrahedra of a mesh: far more than can be solved, and few enough that a
/// damaged file does not exhaust the memory.
pub(super) const MOST_PARTS: usize = 4_000_000;
/// Volume over the longest edge cubed below which a tetrahedron is flat. A regular one has 0.118.
const FLAT: f64 = 1e-10;

/// Corners of the face opposite to each corner, counter-clockwise seen from outside.
pub(crate) const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];
/// Corners of the edges; edge 5 − e is opposite to edge e.
pub(crate) const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

impl TetMesh {
    /// Returns a mesh of these parts, or an error that names the first defect found: an index out
    /// of range, a non-finite or unused vertex, a flat tetrahedron, an overlap, or parts that are
    /// not connected.
    ///
    /// Tetrahedra of negative volume are reoriented; one that is folded over its neighbour is an
    /// error.
    pub fn new(name: &str, vertices: Vec<Point3<f64>>, tets: Vec<[u32; 4]>) -> Result<Self> {
        let mut mesh = Self { vertices, tets };
        let checked = mesh.check_parts().and_then(|()| {
            mesh.orient()?;
            mesh.check_faces()
        });
        checked.map_err(|reason| Error::BadMesh { name: name.to_owned(), reason })?;
        Ok(mesh)
    }

    /// Corners of tetrahedron `t` (m).
    pub fn corners(&self, t: usize) -> [Point3<f64>; 4] {
        self.tets[t].map(|i| self.vertices[i as usize])
    }

    /// Volume of tetrahedron `t` (m³).
    pub fn tet_volume(&self, t: usize) -> f64 {
        let [a, b, c, d] = self.corners(t);
        (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
    }

    /// Returns whether a `displacement` of the vertices (V) in m turns a tetrahedron inside out.
    pub fn is_folded_by(&self, displacement: &[Vector3<f64>]) -> bool {
        let moved = self.vertices.iter().zip(displacement).map(|(vertex, u)| vertex + u);
        let places: Vec<_> = moved.collect();
        self.tets.iter().any(|tet| {
            let [a, b, c, d] = tet.map(|i| places[i as usize]);
            (b - a).cross(&(c - a)).dot(&(d - a)) <= 0.0
        })
    }

    /// Extent along z (m).
    pub fn height(&self) -> f64 {
        let heights = || self.vertices.iter().map(|vertex| vertex.z);
        heights().fold(f64::NEG_INFINITY, f64::max) - heights().fold(f64::INFINITY, f64::min)
    }

    /// Volume (m³).
    pub fn volume(&self) -> f64 {
        (0..self.tets.len()).map(|t| self.tet_volume(t)).sum()
    }

    /// Returns whether `point` (m) lies in a tetrahedron.
    pub fn contains(&self, point: &Point3<f64>) -> bool {
        (0..self.tets.len()).any(|t| {
            let corners = self.corners(t);
            FACES.iter().all(|face| {
                let [a, b, c] = face.map(|i| corners[i]);
                (b - a).cross(&(c - a)).dot(&(point - a)) <= 0.0
            })
        })
    }

    /// Faces on the boundary, counter-clockwise seen from outside, in the order of the tetrahedra.
    pub fn boundary(&self) -> Vec<[u32; 3]> {
        let mut uses: HashMap<[u32; 3], u32> = HashMap::with_capacity(4 * self.tets.len());
        for face in self.faces() {
            *uses.entry(sorted(face)).or_default() += 1;
        }
        self.faces().filter(|&face| uses[&sorted(face)] == 1).collect()
    }

    /// Returns the boundary as a watertight surface with its own vertices.
    pub fn surface(&self) -> Result<Surface> {
        let (mut vertices, mut number) = (Vec::new(), HashMap::new());
        let mut place = |i: u32| {
            *number.entry(i).or_insert_with(|| {
                vertices.push(self.vertices[i as usize]);
                vertices.len() as u32 - 1
            })
        };
        let triangles: Vec<_> = self.boundary().into_iter().map(|t| t.map(&mut place)).collect();
        Surface::new("boundary", &vertices, &triangles)
    }

    /// Edges, lower vertex first, in rising order.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let pairs = self.tets.iter().flat_map(|t| EDGES.map(|[i, j]| [t[i], t[j]]));
        let unique: BTreeSet<_> = pairs.map(|[i, j]| [i.min(j), i.max(j)]).collect();
        unique.into_iter().collect()
    }

    /// For every vertex, the tetrahedra that it is a corner of.
    pub fn tets_of_vertices(&self) -> Incidence {
        Incidence::around(self.vertices.len(), &self.tets)
    }

    /// Angles between the faces of tetrahedron `t` (rad), one for every edge.
    fn dihedrals(&self, t: usize) -> [f64; 6] {
        let p = self.corners(t);
        let normals = FACES.map(|f| (p[f[1]] - p[f[0]]).cross(&(p[f[2]] - p[f[0]])).normalize());
        // The two faces at an edge are those opposite to the corners of the opposite edge.
        std::array::from_fn(|e| {
            let [k, l] = EDGES[5 - e];
            std::f64::consts::PI - normals[k].angle(&normals[l])
        })
    }

    /// 3 · inscribed radius / circumscribed radius of tetrahedron `t`.
    fn radius_ratio(&self, t: usize) -> f64 {
        let p = self.corners(t);
        let area = |f: [usize; 3]| 0.5 * (p[f[1]] - p[f[0]]).cross(&(p[f[2]] - p[f[0]])).norm();
        let six_volumes = 6.0 * self.tet_volume(t);
        let inscribed = 0.5 * six_volumes / FACES.map(area).iter().sum::<f64>();
        let [u, v, w] = [p[1] - p[0], p[2] - p[0], p[3] - p[0]];
        let center = u.norm_squared() * v.cross(&w)
            + v.norm_squared() * w.cross(&u)
            + w.norm_squared() * u.cross(&v);
        3.0 * inscribed * 2.0 * six_volumes / center.norm()
    }

    /// The worst angles and radius ratio of all tetrahedra.
    pub fn quality(&self) -> MeshQuality {
        let mut worst = MeshQuality { min_dihedral: 9.0, max_dihedral: 0.0, min_radius_ratio: 1.0 };
        for t in 0..self.tets.len() {
            for angle in self.dihedrals(t) {
                worst.min_dihedral = worst.min_dihedral.min(angle);
                worst.max_dihedral = worst.max_dihedral.max(angle);
            }
            worst.min_radius_ratio = worst.min_radius_ratio.min(self.radius_ratio(t));
        }
        worst
    }

    /// All faces, four to a tetrahedron, counter-clockwise seen from outside it.
    fn faces(&self) -> impl Iterator<Item = [u32; 3]> {
        self.tets.iter().flat_map(|t| FACES.map(|f| f.map(|i| t[i])))
    }

    fn check_parts(&self) -> std::result::Result<(), String> {
        let (v, t) = (self.vertices.len(), self.tets.len());
        if t == 0 || t > MOST_PARTS || v > MOST_PARTS {
            let most = MOST_PARTS;
            return Err(format!("{v} vertices, {t} tetrahedra, expected 1 to {most} of them"));
        }
        if let Some(i) = self.vertices.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(format!("vertex {i} is not finite"));
        }
        let mut used = vec![false; v];
        for (t, corners) in self.tets.iter().enumerate() {
            for &i in corners {
                let Some(used) = used.get_mut(i as usize) else {
                    return Err(format!("tetrahedron {t} uses vertex {i}, but there are {v}"));
                };
                *used = true;
            }
        }
        match used.iter().position(|used| !used) {
            Some(i) => Err(format!("vertex {i} belongs to no tetrahedron")),
            None => Ok(()),
        }
    }

    /// Swaps two corners of every tetrahedron of negative volume.
    fn orient(&mut self) -> std::result::Result<(), String> {
        for t in 0..self.tets.len() {
            let p = self.corners(t);
            let longest = EDGES.map(|[i, j]| (p[i] - p[j]).norm()).into_iter().fold(0.0, f64::max);
            let volume = self.tet_volume(t);
            if volume.abs() <= FLAT * longest.powi(3) {
                return Err(format!(
                    "tetrahedron {t} {:?} is flat: {volume:.2e} m³ with an edge of {longest:.2e} m",
                    self.tets[t]
                ));
            }
            if volume < 0.0 {
                self.tets[t].swap(1, 2);
            }
        }
        Ok(())
    }

    /// Checks that every face has at most one tetrahedron on each side, and that all tetrahedra are
    /// connected through faces.
    fn check_faces(&self) -> std::result::Result<(), String> {
        let mut owner: HashMap<[u32; 3], usize> = HashMap::with_capacity(4 * self.tets.len());
        let mut group: Vec<usize> = (0..self.tets.len()).collect();
        for (i, face) in self.faces().enumerate() {
            let t = i / 4;
            // Rotated to its lowest vertex first: the same key on the same side only.
            if let Some(other) = owner.insert(rotated(face), t) {
                return Err(format!(
                    "tetrahedra {other} and {t} lie on the same side of their face {face:?}: \
                     one is inverted or they overlap"
                ));
            }
            let [a, b, c] = face;
            if let Some(&beside) = owner.get(&rotated([a, c, b])) {
                join(&mut group, t, beside);
            }
        }
        let parts = (0..group.len()).filter(|&t| group[t] == t).count();
        if parts > 1 {
            return Err(format!("{parts} parts that share no face, expected one connected body"));
        }
        Ok(())
    }
}

fn sorted(mut face: [u32; 3]) -> [u32; 3] {
    face.sort_unstable();
    face
}

fn rotated([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

/// Unites the groups of `a` and `b` (union–find with path halving).
fn join(group: &mut [usize], a: usize, b: usize) {
    let mut root = |mut i: usize| {
        while group[i] != i {
            group[i] = group[group[i]];
            i = group[i];
        }
        i
    };
    let (a, b) = (root(a), root(b));
    group[a.max(b)] = a.min(b);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A regular tetrahedron of edge √8.
    fn regular() -> (Vec<Point3<f64>>, Vec<[u32; 4]>) {
        let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
        (corners.map(Point3::from).to_vec(), vec![[0, 1, 2, 3]])
    }

    /// Two tetrahedra on either side of the triangle 0 1 2.
    fn pair() -> (Vec<Point3<f64>>, Vec<[u32; 4]>) {
        let corners =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.2, 0.2, -1.0]];
        (corners.map(Point3::from).to_vec(), vec![[0, 1, 2, 3], [0, 2, 1, 4]])
    }

    #[test]
    fn a_regular_tetrahedron_has_its_angles_radii_and_volume() {
        let (vertices, tets) = regular();
        let mesh = TetMesh::new("regular", vertices, tets).unwrap();
        let MeshQuality { min_dihedral, max_dihedral, min_radius_ratio } = mesh.quality();
        let exact = (1f64 / 3.0).acos();
        for angle in [min_dihedral, max_dihedral] {
            assert!((angle - exact).abs() < 1e-12, "{angle} rad against {exact} rad");
        }
        assert!((min_radius_ratio - 1.0).abs() < 1e-12, "{min_radius_ratio}");
        let volume = mesh.volume();
        assert!((volume - 8.0 / 3.0).abs() < 1e-12, "{volume} m³ against 8/3 m³");
        assert!(mesh.contains(&Point3::origin()) && !mesh.contains(&Point3::new(0.0, 0.0, 2.0)));
    }

    #[test]
    fn the_boundary_is_watertight_and_faces_outwards() {
        let (vertices, tets) = pair();
        let mesh = TetMesh::new("pair", vertices, tets).unwrap();
        assert_eq!(mesh.boundary().len(), 6);
        let enclosed = mesh.surface().unwrap().mass_properties(1.0).mass;
        let volume = mesh.volume();
        assert!((enclosed - volume).abs() < 1e-15, "{enclosed} m³ against {volume} m³");
        assert_eq!(mesh.surface().unwrap().triangles().len(), 6);
    }

    #[test]
    fn incidence_lists_every_corner_once() {
        let (vertices, tets) = pair();
        let mesh = TetMesh::new("pair", vertices, tets).unwrap();
        let incidence = mesh.tets_of_vertices();
        let lists: Vec<_> = (0..5).map(|v| incidence.of(v).to_vec()).collect();
        assert_eq!(lists, [vec![0, 1], vec![0, 1], vec![0, 1], vec![0], vec![1]]);
        assert_eq!(mesh.edges().len(), 9);
    }

    #[test]
    fn corner_order_is_put_right() {
        let (vertices, tets) = pair();
        let straight = TetMesh::new("pair", vertices.clone(), tets.clone()).unwrap();
        let swapped = tets.iter().map(|&[a, b, c, d]| [a, c, b, d]).collect();
        let turned = TetMesh::new("pair", vertices, swapped).unwrap();
        assert!((0..2).all(|t| turned.tet_volume(t) == straight.tet_volume(t)));
    }

    #[test]
    fn defects_are_named() {
        let (vertices, tets) = pair();
        let message = |v: &[Point3<f64>], t: &[[u32; 4]]| {
            TetMesh::new("pair", v.to_vec(), t.to_vec()).unwrap_err().to_string()
        };
        let moved = |i: usize, to: [f64; 3]| {
            let mut vertices = vertices.clone();
            vertices[i] = to.into();
            vertices
        };
        assert!(message(&vertices, &[]).contains("0 tetrahedra"));
        assert!(message(&vertices, &[[0, 1, 2, 7]]).contains("tetrahedron 0 uses vertex 7"));
        assert!(message(&vertices, &tets[..1]).contains("vertex 4 belongs to no tetrahedron"));
        assert!(message(&moved(2, [f64::NAN; 3]), &tets).contains("vertex 2 is not finite"));
        assert!(message(&moved(4, [0.2, 0.2, 0.0]), &tets).contains("tetrahedron 1 [0, 2, 1, 4]"));
        assert!(message(&moved(4, [0.2, 0.2, 0.5]), &tets).contains("inverted or they overlap"));
        assert!(message(&vertices, &[tets[0], tets[1], tets[0]]).contains("overlap"));
        let mut apart = vertices.clone();
        apart.extend(vertices[..4].iter().map(|p| p + Vector3::x() * 3.0));
        let unconnected = message(&apart, &[tets[0], tets[1], [5, 6, 7, 8]]);
        assert!(unconnected.contains("2 parts that share no face"), "{unconnected}");
    }
}
