//! Pad meshes that are fine only near given points.

use nalgebra::Point3;

use super::{
    Grading, PadMesh, PadOutline, TetMesh,
    bisection::Bisection,
    pad_mesh::{NODES, kuhn},
};
use crate::{Error, Result};

/// An unstructured tetrahedral mesh of a pad.
#[derive(Clone, Debug, PartialEq)]
pub struct GradedPad {
    /// Mesh, with its vertices (V, 3) in the pad frame.
    pub mesh: TetMesh,
    /// Nodes bonded to the base.
    pub base: Vec<u32>,
}

/// Largest spacing, far from all points, absolute (m) and relative to the thickness, the smaller of
/// which applies: wide enough to cost little, narrow enough to resolve the rim.
const WIDEST: (f64, f64) = (3e-3, 0.75);
/// Growth of the spacing per distance from the nearest point, at most and at least: at the least,
/// any pad has more nodes than are allowed.
const GROWTH: (f64, f64) = (0.5, 0.005);
/// Smallest spacing, at the points, relative to the thickness.
const FINEST: f64 = 1e-3;
/// Most points around which the mesh may be refined.
const MOST_POINTS: usize = 10_000;
/// Distance of a point from the pad up to which it is taken, relative to the thickness: farther
/// ones are in another unit or frame.
const BESIDE: f64 = 2.0;
/// Ratio of two spacings at which the search for the finest one stops.
const APART: f64 = 1.03;
/// Ratio of two growths at which the search for the least one stops: their nodes differ by 3 %.
const GROWTH_APART: f64 = 1.01;

impl PadOutline {
    /// Returns the finest mesh of at most `nodes` nodes whose spacing grows with the distance from
    /// the nearest of `points` (m, in the pad frame). Points far from the pad are an error.
    ///
    /// The spacing at the points is a thousandth of the thickness or more. Where it cannot fall
    /// further, it grows the less with the distance the more nodes there may be, so that meshes of
    /// more and more nodes become finer everywhere.
    ///
    /// Kuhn's tetrahedra in cells of at most 3 mm are bisected ([`super::bisection`]) in a block of
    /// equal size with a flat face, whose columns are then shortened to the height of the pad.
    pub fn graded(&self, points: &[Point3<f64>], nodes: usize) -> Result<GradedPad> {
        self.graded_by(0.0, GROWTH.1, points, nodes)
    }

    /// Performs [`PadOutline::graded`] with no spacing less than `finest` (m). Where the spacing at
    /// the points is that, nodes are left over.
    pub fn graded_to(
        &self,
        finest: f64,
        points: &[Point3<f64>],
        nodes: usize,
    ) -> Result<GradedPad> {
        self.graded_by(finest, GROWTH.0, points, nodes)
    }

    /// Takes the smallest spacing from `finest` (m), then the smallest growth from `least_growth`.
    fn graded_by(
        &self,
        finest: f64,
        least_growth: f64,
        points: &[Point3<f64>],
        nodes: usize,
    ) -> Result<GradedPad> {
        let outline = self.validated()?;
        if !(1..=MOST_POINTS).contains(&points.len()) {
            let expected = format!("1 to {MOST_POINTS} points");
            return Err(Error::invalid("around", points.len(), expected));
        }
        if let Some(point) = points.iter().find(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(Error::invalid("around", point, "finite places"));
        }
        let beside = |p: &Point3<f64>| {
            let over = [p.x.abs() - 0.5 * outline.width, p.y.abs() - 0.5 * outline.length];
            over.into_iter().chain([p.z, -p.z - outline.thickness]).fold(0.0, f64::max)
        };
        if let Some(point) = points.iter().find(|p| beside(p) > BESIDE * outline.thickness) {
            let expected = format!("places within {} m of the pad", BESIDE * outline.thickness);
            return Err(Error::invalid("around", point, expected));
        }
        let block = PadOutline::flat(outline.length, outline.width, outline.thickness);
        let widest = WIDEST.0.min(WIDEST.1 * outline.thickness);
        let coarse = PadMesh::new(&block, &Grading::uniform(widest))?;
        let [nx, ny, nz] = coarse.cells.map(|n| n as usize + 1);
        let least = coarse.mesh.vertices.len();
        if !(least..=*NODES.end()).contains(&nodes) {
            let expected = format!("{least} to {} for a pad of this size", NODES.end());
            return Err(Error::invalid("nodes", nodes, expected));
        }
        let points: Vec<_> = points.iter().map(|p| outline.straightened(p)).collect();
        let away = |p: &Point3<f64>| {
            let squared = points.iter().map(|q| (p - q).norm_squared());
            squared.fold(f64::INFINITY, f64::min).sqrt()
        };
        let start = Bisection::new(coarse.mesh.vertices, kuhn(nx, ny, nz));
        let refined = |spacing: f64, growth: f64| {
            let mut pad = start.clone();
            pad.refine(|p| spacing + growth * away(p), nodes).then_some(pad)
        };
        let finest = f64::max(FINEST * outline.thickness, finest);
        let found = smallest(finest, widest, APART, |spacing| refined(spacing, GROWTH.0));
        let (spacing, mut pad) = found.unwrap_or_else(|| (widest, start.clone()));
        if spacing <= APART * finest {
            let less = |growth| refined(spacing, growth);
            let found = smallest(least_growth, GROWTH.0, GROWTH_APART, less);
            pad = found.map_or(pad, |(_, pad)| pad);
        }
        let base = |p: &Point3<f64>| p.z <= -outline.thickness * (1.0 - 1e-12);
        let base = (0..).zip(&pad.vertices).filter(|(_, p)| base(p)).map(|(i, _)| i).collect();
        let vertices = pad.vertices.iter().map(|p| outline.crowned(p)).collect();
        Ok(GradedPad { mesh: TetMesh::new("pad", vertices, pad.corners().collect())?, base })
    }

    /// Maps a point of the block of equal size with a flat face to the pad.
    fn crowned(&self, p: &Point3<f64>) -> Point3<f64> {
        let share = 1.0 + p.z / self.thickness;
        let height = self.thickness + self.height(p.x, p.y);
        Point3::new(p.x, p.y, share * height - self.thickness)
    }

    /// Maps a point of the pad to that block.
    fn straightened(&self, p: &Point3<f64>) -> Point3<f64> {
        let height = self.thickness + self.height(p.x, p.y);
        let share = (p.z + self.thickness) / height.max(f64::MIN_POSITIVE);
        Point3::new(p.x, p.y, self.thickness * (share - 1.0))
    }
}

/// Halves the interval of logarithms from `least` to `most` until their ratio is `apart`; returns
/// the smallest value for which `find` found something, and what it found.
fn smallest<T>(
    mut least: f64,
    mut most: f64,
    apart: f64,
    find: impl Fn(f64) -> Option<T>,
) -> Option<(f64, T)> {
    let mut best = None;
    while most > apart * least {
        let middle = (least * most).sqrt();
        match find(middle) {
            Some(found) => (most, best) = (middle, Some((middle, found))),
            None => least = middle,
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::examples::mini;

    fn ring() -> Vec<Point3<f64>> {
        let on = |i: i32| {
            let angle = f64::from(i) * 0.2;
            Point3::new(2e-3 + 1e-3 * angle.cos(), 1e-3 * angle.sin(), -4e-5)
        };
        (0..31).map(on).collect()
    }

    fn shortest_edge(pad: &GradedPad) -> f64 {
        let at = |i: u32| pad.mesh.vertices[i as usize];
        let edges = pad.mesh.edges().into_iter().map(|[a, b]| (at(b) - at(a)).norm());
        edges.fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn it_fills_the_pad_and_keeps_quality_and_budget() {
        // Even the coarse cells resolve the volume that the rim cuts off nearly as well as
        // fine ones.
        let whole = PadMesh::with_nodes(&mini(), 20_000).unwrap().mesh.volume();
        for nodes in [1000, 3000, 10_000] {
            let pad = mini().graded(&ring(), nodes).unwrap();
            let count = pad.mesh.vertices.len();
            assert!(count <= nodes && count > nodes * 3 / 5, "{count} nodes for {nodes}");
            let (volume, quality) = (pad.mesh.volume(), pad.mesh.quality());
            assert!((volume / whole - 1.0).abs() < 0.01, "{volume} m³ of {whole} m³");
            let least = quality.min_dihedral.to_degrees();
            assert!(least > 20.0, "{nodes} nodes: an angle of {least}°");
        }
    }

    /// The surface is closed: no vertex lies in the middle of a neighbour's edge.
    #[test]
    fn neighbours_share_whole_faces() {
        let pad = mini().graded(&ring(), 3000).unwrap();
        let [wide, long] = [mini().width, mini().length];
        let at = |i: u32| pad.mesh.vertices[i as usize];
        let plan = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| at(i).xy());
            0.5 * (b - a).perp(&(c - a))
        };
        let areas: Vec<_> = pad.mesh.boundary().iter().map(plan).collect();
        for sign in [1.0, -1.0] {
            let area: f64 = areas.iter().map(|a| (sign * a).max(0.0)).sum();
            assert!((area / (wide * long) - 1.0).abs() < 1e-9, "{area} m² on one side");
        }
    }

    #[test]
    fn it_is_fine_where_it_is_told_to_be() {
        let pad = mini().graded(&ring(), 4000).unwrap();
        let edges = pad.mesh.edges().into_iter().map(|[a, b]| {
            let [a, b] = [a, b].map(|i| pad.mesh.vertices[i as usize]);
            (nalgebra::center(&a, &b), (b - a).norm())
        });
        let (mut near, mut far) = (f64::INFINITY, f64::INFINITY);
        for (middle, length) in edges {
            let away = ring().iter().map(|p| (p - middle).norm()).fold(f64::INFINITY, f64::min);
            let least = if away < 2e-4 { &mut near } else { &mut far };
            if !(2e-4..8e-3).contains(&away) {
                *least = least.min(length);
            }
        }
        assert!(near < 2e-4 && far > 8e-4, "{near} m near, {far} m far");
    }

    #[test]
    fn it_is_no_finer_than_it_is_told_to_be() {
        let [free, bound] = [0.0, 1e-3].map(|finest| mini().graded_to(finest, &ring(), 4000));
        let [free, bound] = [free.unwrap(), bound.unwrap()];
        assert!(bound.mesh.vertices.len() < free.mesh.vertices.len() / 2);
        // Bisection halves edges that are longer than the spacing.
        let [free, bound] = [&free, &bound].map(shortest_edge);
        assert!(bound > 0.4e-3 && free < 0.4e-3, "{bound} m bound, {free} m free");
    }

    /// One point, at a node of the coarse cells and away from them, two that are near each other,
    /// and one above the rim.
    fn few() -> [Vec<Point3<f64>>; 4] {
        let at = |x, y| Point3::new(x, y, 0.0);
        [
            vec![at(0.0, 0.0)],
            vec![at(1e-3, -1e-3)],
            vec![at(0.0, 0.0), at(2e-4, 0.0)],
            vec![at(8e-3, 11e-3)],
        ]
    }

    #[test]
    fn few_points_use_up_the_nodes_as_many_do() {
        for points in few() {
            let mut finest = f64::INFINITY;
            for nodes in [800, 1500, 4000, 8000] {
                let pad = mini().graded(&points, nodes).unwrap();
                let count = pad.mesh.vertices.len();
                assert!(count <= nodes && count > nodes * 4 / 5, "{count} nodes for {nodes}");
                let shortest = shortest_edge(&pad);
                let before = finest * (1.0 + 1e-9);
                assert!(shortest <= before, "{nodes} nodes: {shortest} m after {finest} m");
                finest = shortest;
            }
        }
    }

    #[test]
    fn more_nodes_make_the_mesh_finer_away_from_a_single_point() {
        let point = Point3::new(1e-3, -1e-3, 0.0);
        let longest = |nodes| {
            let pad = mini().graded(&[point], nodes).unwrap();
            let edges = pad.mesh.edges().into_iter();
            let edges = edges.map(|[a, b]| [a, b].map(|i| pad.mesh.vertices[i as usize]));
            let near = edges.filter(|[a, b]| (nalgebra::center(a, b) - point).norm() < 2e-3);
            near.map(|[a, b]| (b - a).norm()).fold(0.0, f64::max)
        };
        let [coarse, fine] = [1000, 8000].map(longest);
        assert!(fine < 0.6 * coarse, "{coarse} m on 1,000 nodes, {fine} m on 8,000");
    }

    /// Datasets are resumed with meshes equal to the bit: points, nodes asked for, nodes,
    /// tetrahedra and the last vertex (nm).
    #[test]
    fn meshes_that_had_no_nodes_left_over_stay_as_they_are() {
        let [_, one, two, _] = few();
        let same = |mesh: &TetMesh, vertices: usize, tets: usize, last: [f64; 3]| {
            assert_eq!((mesh.vertices.len(), mesh.tets.len()), (vertices, tets));
            let (found, [x, y, z]) = (mesh.vertices[vertices - 1], last.map(|x| 1e-9 * x));
            let away = (found - Point3::new(x, y, z)).norm();
            assert!(away < 1e-12, "{found} is {away} m off");
        };
        let table = [
            (&one, 550, [547, 2164], [1_053_710.938, -1_025_781.250, -6_679.469]),
            (&one, 900, [898, 3878], [992_919.922, -1_006_054.688, -13_916.844]),
            (&two, 900, [897, 3876], [222_900.391, 19_726.562, -15_811.978]),
            (&ring(), 900, [895, 3870], [1_458_984.375, 946_875.000, -134_820.544]),
            (&ring(), 1500, [1493, 6736], [2_350_585.938, -867_968.750, -22_567.000]),
        ];
        for (points, nodes, [vertices, tets], last) in table {
            let GradedPad { mesh, .. } = mini().graded(points, nodes).unwrap();
            same(&mesh, vertices, tets, last);
        }
        let table = [
            (3e-4, &one, 2000, [411, 1500], [972_656.250, -1_578_125.000, -9_486.459]),
            (2e-5, &two, 2000, [901, 3900], [222_900.391, 19_726.563, -15_811.978]),
            (1e-6, &one, 2000, [911, 3950], [1_023_315.430, -1_006_054.688, -14_146.794]),
            (2e-5, &ring(), 2000, [1992, 9182], [3_242_187.500, 1_578_125.000, -292_612.784]),
        ];
        for (finest, points, nodes, [vertices, tets], last) in table {
            let GradedPad { mesh, .. } = mini().graded_to(finest, points, nodes).unwrap();
            same(&mesh, vertices, tets, last);
        }
    }

    #[test]
    fn the_base_lies_where_the_frame_says() {
        let pad = mini().graded(&ring(), 2000).unwrap();
        let bottom = |i: u32| pad.mesh.vertices[i as usize].z < -mini().thickness + 1e-9;
        assert!(pad.base.iter().all(|&i| bottom(i)));
        let count = (0..pad.mesh.vertices.len() as u32).filter(|&i| bottom(i)).count();
        assert_eq!(pad.base.len(), count);
    }

    #[test]
    fn what_cannot_be_is_named() {
        let message =
            |points: &[Point3<f64>], nodes| mini().graded(points, nodes).unwrap_err().to_string();
        assert!(message(&[], 2000).starts_with("around"));
        assert!(message(&[Point3::new(f64::NAN, 0.0, 0.0)], 2000).contains("finite"));
        let in_mm = Point3::new(1.0, 0.0, 0.0);
        assert!(message(&[in_mm], 2000).contains("within 0.008 m of the pad"));
        assert!(message(&ring(), 200).starts_with("nodes"));
    }
}
