//! Transfer of fields from one mesh of a body to another.
//!
//! Reference solutions are computed on a finer mesh than that of the fast models. Displacements are
//! interpolated at the other mesh's vertices, stresses are averaged over its tetrahedra, and nodal
//! forces are distributed to the vertices around them, which keeps their resultant.

use std::{
    collections::BTreeMap,
    ops::{AddAssign, Mul},
};

use nalgebra::{Matrix3, Point3, Vector3};

use super::TetMesh;
use crate::{Error, Result};

/// A point in a tetrahedron: its number and the barycentric coordinates.
pub(crate) type Site = (u32, [f64; 4]);

/// An operator that maps fields on one mesh (V vertices, T tetrahedra) to another (V′, T′).
#[derive(Clone, Debug, PartialEq)]
pub struct Transfer {
    /// Tetrahedra of the source and the target.
    tets: [Vec<[u32; 4]>; 2],
    /// Positions of the target's vertices in the source (V′).
    sites: Vec<Site>,
    /// Positions of the source's vertices in the target (V).
    homes: Vec<Site>,
    /// Source tetrahedra that overlap each target tetrahedron, with shares that sum to 1, in one
    /// list; `starts` holds the index at which each target's entries begin (T′ + 1).
    parts: Vec<(u32, f64)>,
    starts: Vec<u32>,
}

/// Sample points along an edge of a tetrahedron.
const SAMPLES: u32 = 5;
/// Least barycentric coordinate at which a point outside still counts as near a tetrahedron.
const NEAR: f64 = -1.0;

impl Transfer {
    /// Returns the transfer `from` a mesh `to` another of the same body, or an error if a vertex of
    /// one lies far off the other.
    pub fn new(from: &TetMesh, to: &TetMesh) -> Result<Self> {
        let [source, target] = [from, to].map(Locator::new);
        let sites = to.vertices.iter().map(|p| source.site(p)).collect::<Result<_>>()?;
        let homes = from.vertices.iter().map(|p| target.site(p)).collect::<Result<_>>()?;
        let (mut parts, mut starts) = (Vec::new(), vec![0]);
        for sites in sampled(&source, to) {
            parts.extend(shares(&sites?));
            starts.push(parts.len() as u32);
        }
        Ok(Self { tets: [from.tets.clone(), to.tets.clone()], sites, homes, parts, starts })
    }

    /// Positions of the target's vertices in the source (V′).
    pub(crate) fn sites(&self) -> &[Site] {
        &self.sites
    }

    /// Interpolates a nodal field (V) at the target's vertices (V′).
    pub fn interpolate(&self, nodal: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let at = |&(tet, l): &Site| {
            let corners = self.tets[0][tet as usize];
            (0..4).map(|i| nodal[corners[i] as usize] * l[i]).sum()
        };
        self.sites.iter().map(at).collect()
    }

    /// Converts nodal forces (V) to nodal forces of the target (V′) with the same force and torque.
    pub fn spread(&self, forces: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut spread = vec![Vector3::zeros(); self.sites.len()];
        for ((tet, l), force) in self.homes.iter().zip(forces) {
            for (&corner, &share) in self.tets[1][*tet as usize].iter().zip(l) {
                spread[corner as usize] += force * share;
            }
        }
        spread
    }

    /// Averages a field on tetrahedra (T) over those of the target (T′).
    pub fn average<F>(&self, values: &[F]) -> Vec<F>
    where
        F: Copy + Default + AddAssign + Mul<f64, Output = F>,
    {
        let mean = |parts: &[(u32, f64)]| {
            let mut sum = F::default();
            for &(tet, share) in parts {
                sum += values[tet as usize] * share;
            }
            sum
        };
        self.parts().map(mean).collect()
    }

    /// Source tetrahedra that overlap each target tetrahedron (T′), with shares that sum to 1.
    pub(crate) fn parts(&self) -> impl ExactSizeIterator<Item = &[(u32, f64)]> {
        self.starts.windows(2).map(|ends| &self.parts[ends[0] as usize..ends[1] as usize])
    }
}

impl TetMesh {
    /// Tetrahedra that contain the points (P), with barycentric coordinates; `None` outside.
    pub fn locate(&self, points: &[Point3<f64>]) -> Vec<Option<(u32, [f64; 4])>> {
        /// Barycentric coordinate by which a point on a face may lie outside of both sides.
        const ROUNDING: f64 = 1e-9;
        let locator = Locator::new(self);
        let find =
            |point: &Point3<f64>| locator.nearest(point).filter(|site| least(site) >= -ROUNDING);
        points.iter().map(find).collect()
    }
}

/// Tetrahedra that contain `sites`, each with the share of the sites in it.
fn shares(sites: &[Site]) -> impl Iterator<Item = (u32, f64)> {
    let mut counts = BTreeMap::<u32, u32>::new();
    for &(tet, _) in sites {
        *counts.entry(tet).or_default() += 1;
    }
    let all = sites.len() as f64;
    counts.into_iter().map(move |(tet, count)| (tet, f64::from(count) / all))
}

/// Positions in the mesh `from` of sample points that represent equal volumes of each tetrahedron
/// of a mesh `to` of the same body (T′).
pub(crate) fn samples(from: &TetMesh, to: &TetMesh) -> Result<Vec<Vec<Site>>> {
    sampled(&Locator::new(from), to).collect()
}

/// Positions in `mesh` of points in it or near its surface (P), or an error if one lies far off.
pub(crate) fn sites(mesh: &TetMesh, points: &[Point3<f64>]) -> Result<Vec<Site>> {
    let locator = Locator::new(mesh);
    points.iter().map(|point| locator.site(point)).collect()
}

fn sampled(source: &Locator, to: &TetMesh) -> impl Iterator<Item = Result<Vec<Site>>> {
    let sites = |t: usize| points(&to.corners(t)).iter().map(|p| source.site(p)).collect();
    (0..to.tets.len()).map(sites)
}

/// Sample points that represent equal volumes of a tetrahedron.
fn points(corners: &[Point3<f64>; 4]) -> Vec<Point3<f64>> {
    let sum =
        |shares: &[f64; 4]| -> Vector3<f64> { (0..4).map(|a| corners[a].coords * shares[a]).sum() };
    sample_shares(SAMPLES).iter().map(|shares| Point3::from(sum(shares))).collect()
}

/// Barycentric coordinates of points that represent equal volumes of a tetrahedron, `along` of them
/// on an edge: n (n + 1) (n + 2) / 6 in all.
pub(crate) fn sample_shares(along: u32) -> Vec<[f64; 4]> {
    let mut shares = Vec::new();
    for i in 0..along {
        for j in 0..along - i {
            for k in 0..along - i - j {
                let counts = [i, j, k, along - 1 - i - j - k];
                shares.push(counts.map(|count| (f64::from(count) + 0.25) / f64::from(along)));
            }
        }
    }
    shares
}

/// A grid of boxes that finds the tetrahedron at a point.
struct Locator<'a> {
    mesh: &'a TetMesh,
    /// Inverse of the matrix of edges from corner a, which gives the barycentric coordinates b, c
    /// and d of a place, and the position of corner a (T).
    inverse: Vec<(Matrix3<f64>, Point3<f64>)>,
    low: Point3<f64>,
    /// Side of a box (m).
    side: f64,
    /// Boxes along each axis.
    counts: [usize; 3],
    /// Tetrahedra that reach into each box, or near it.
    boxes: Vec<Vec<u32>>,
}

impl<'a> Locator<'a> {
    fn new(mesh: &'a TetMesh) -> Self {
        let bounds = |points: &[Point3<f64>]| {
            let first = (points[0], points[0]);
            points.iter().fold(first, |(low, high), p| (low.inf(p), high.sup(p)))
        };
        let (low, high) = bounds(&mesh.vertices);
        let extent = high - low;
        // About two tetrahedra to a box.
        let side = 1.26 * (extent.product() / mesh.tets.len() as f64).cbrt();
        let counts = std::array::from_fn(|a| (extent[a] / side) as usize + 1);
        let inverse = |t: usize| {
            let [a, b, c, d] = mesh.corners(t);
            let edges = Matrix3::from_columns(&[b - a, c - a, d - a]);
            (edges.try_inverse().expect("a mesh has no flat tetrahedron"), a)
        };
        let inverse = (0..mesh.tets.len()).map(inverse).collect();
        let boxes = vec![Vec::new(); counts.iter().product()];
        let mut locator = Self { mesh, inverse, low, side, counts, boxes };
        for t in 0..mesh.tets.len() {
            let (low, high) = bounds(&mesh.corners(t));
            let reach = Vector3::repeat(0.5 * side);
            let [from, to] = [low - reach, high + reach].map(|p| locator.cell(&p));
            for x in from[0]..=to[0] {
                for y in from[1]..=to[1] {
                    for z in from[2]..=to[2] {
                        let place = locator.number([x, y, z]);
                        locator.boxes[place].push(t as u32);
                    }
                }
            }
        }
        locator
    }

    /// Box that contains a point, or the nearest one.
    fn cell(&self, point: &Point3<f64>) -> [usize; 3] {
        let along = |a: usize| ((point[a] - self.low[a]) / self.side).max(0.0) as usize;
        std::array::from_fn(|a| along(a).min(self.counts[a] - 1))
    }

    fn number(&self, [x, y, z]: [usize; 3]) -> usize {
        (x * self.counts[1] + y) * self.counts[2] + z
    }

    /// Tetrahedron that contains the point, or the one of its box that it is least far outside of.
    fn nearest(&self, point: &Point3<f64>) -> Option<Site> {
        let near = self.boxes[self.number(self.cell(point))].iter().map(|&t| self.inside(t, point));
        near.max_by(|a, b| least(a).total_cmp(&least(b)))
    }

    /// Tetrahedron that contains the point, or is near it.
    fn site(&self, point: &Point3<f64>) -> Result<Site> {
        let best = self.nearest(point);
        best.filter(|site| least(site) > NEAR).ok_or_else(|| Error::BadMesh {
            name: "transfer".to_owned(),
            reason: format!(
                "{point} lies off the other mesh of {} tetrahedra: expected two meshes of one body",
                self.mesh.tets.len()
            ),
        })
    }

    fn inside(&self, tet: u32, point: &Point3<f64>) -> Site {
        let (inverse, origin) = &self.inverse[tet as usize];
        let l = inverse * (point - origin);
        (tet, [1.0 - l.sum(), l.x, l.y, l.z])
    }
}

/// Least barycentric coordinate: negative outside of the tetrahedron.
fn least(site: &Site) -> f64 {
    site.1.into_iter().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{PadMesh, PadOutline};

    /// A crowned pad in two resolutions.
    fn meshes() -> [TetMesh; 2] {
        let outline = PadOutline {
            radius_along: 0.2,
            radius_across: 0.1,
            ..PadOutline::flat(0.02525, 0.02075, 0.004)
        };
        [3000, 700].map(|nodes| PadMesh::with_nodes(&outline, nodes).unwrap().mesh)
    }

    #[test]
    fn linear_fields_are_carried_exactly() {
        let [fine, coarse] = meshes();
        let field = |p: &Point3<f64>| Vector3::new(1.0 + p.x - 2.0 * p.z, p.y, 3.0 * p.x + p.z);
        let on = |mesh: &TetMesh| mesh.vertices.iter().map(field).collect::<Vec<_>>();
        for (from, to) in [(&fine, &coarse), (&coarse, &fine)] {
            let carried = Transfer::new(from, to).unwrap().interpolate(&on(from));
            // Rounding of a field of size 1.
            assert!(carried.iter().zip(on(to)).all(|(a, b)| (a - b).norm() < 1e-12));
        }
    }

    #[test]
    fn forces_keep_their_resultant() {
        let [fine, coarse] = meshes();
        let force = |p: &Point3<f64>| Vector3::new(p.y.sin(), p.x * p.z, 1.0 + p.x);
        let forces: Vec<_> = fine.vertices.iter().map(force).collect();
        let spread = Transfer::new(&fine, &coarse).unwrap().spread(&forces);
        let resultant = |mesh: &TetMesh, forces: &[Vector3<f64>]| {
            let torque = mesh.vertices.iter().zip(forces).map(|(p, f)| p.coords.cross(f));
            (forces.iter().sum::<Vector3<f64>>(), torque.sum::<Vector3<f64>>())
        };
        let (before, after) = (resultant(&fine, &forces), resultant(&coarse, &spread));
        // Rounding of some thousand forces of size 1.
        assert!((before.0 - after.0).norm() < 1e-9 && (before.1 - after.1).norm() < 1e-9);
    }

    #[test]
    fn averages_keep_the_mean() {
        let [fine, coarse] = meshes();
        let middle =
            |mesh: &TetMesh, t: usize| nalgebra::center(&mesh.corners(t)[0], &mesh.corners(t)[2]);
        let values: Vec<f64> =
            (0..fine.tets.len()).map(|t| 1.0 + (300.0 * middle(&fine, t).x).sin()).collect();
        let transfer = Transfer::new(&fine, &coarse).unwrap();
        let mean = |mesh: &TetMesh, values: &[f64]| {
            let weighted = values.iter().enumerate().map(|(t, v)| v * mesh.tet_volume(t));
            weighted.sum::<f64>() / mesh.volume()
        };
        let (before, after) = (mean(&fine, &values), mean(&coarse, &transfer.average(&values)));
        assert!((after / before - 1.0).abs() < 2e-3, "{after} against {before}");
        let constant = transfer.average(&vec![2.5; fine.tets.len()]);
        assert!(constant.iter().all(|v| (v - 2.5).abs() < 1e-14));
    }

    #[test]
    fn meshes_of_different_bodies_are_refused() {
        let [fine, mut coarse] = meshes();
        coarse.vertices.iter_mut().for_each(|p| p.x += 0.02);
        let error = Transfer::new(&fine, &coarse).unwrap_err();
        assert!(error.to_string().contains("expected two meshes of one body"), "{error}");
    }

    #[test]
    fn points_are_located_with_the_shares_that_give_them() {
        let [mesh, _] = meshes();
        let inside = Point3::new(1.3e-3, -2.1e-3, -1.7e-3);
        let corner = mesh.vertices[7];
        let far = Point3::new(0.0, 0.0, 1e-3);
        let found = mesh.locate(&[inside, corner, far]);
        for (point, site) in [inside, corner].iter().zip(&found) {
            let (tet, shares) = site.expect("a tetrahedron has the point");
            let sum = |i: usize| mesh.corners(tet as usize)[i].coords * shares[i];
            let again: Vector3<f64> = (0..4).map(sum).sum();
            assert!((again - point.coords).norm() < 1e-15, "{again} for {point}");
            assert!(shares.iter().all(|&share| share > -1e-9), "{shares:?}");
        }
        assert_eq!(found[2], None);
    }
}
