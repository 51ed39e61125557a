//! Structured tetrahedral meshes of gel pads with graded spacing.
//!
//! Pad frame: x across, y along, z out of the gel; the origin is the apex, the centre of the
//! undeformed face, and the bonded base is the plane z = −thickness.
//!
//! A tensor grid of columns is cut into Kuhn's six tetrahedra a cell, mirrored from cell to cell so
//! that no diagonal direction is preferred. Every such tetrahedron has one vertical edge and spans
//! a triangle of its column's plan, so its volume is plan area × edge / 3: positive for any height
//! of the face. Spacing is constant in the contact zone and grows linearly with the distance from
//! it: with the density 1/h(s), nodes stand at equal steps of N(s) = ∫ ds / h(s).

use nalgebra::Point3;

use super::{PadOutline, TetMesh};
use crate::{Error, Result};

/// Node spacing of a pad mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grading {
    /// Distance between nodes in the contact zone (m).
    pub spacing: f64,
    /// Half-extent of the contact zone across and along, and its depth under the face (m).
    pub zone: [f64; 3],
    /// Growth of the spacing per distance from the zone: 0.3 makes neighbours differ by about 30 %.
    pub growth: f64,
}

/// A pad meshed on a structured grid: V nodes in layers of equal plan, T tetrahedra in grid cells.
#[derive(Clone, Debug, PartialEq)]
pub struct PadMesh {
    /// Vertices (V, 3) in the pad frame, face first, layer by layer; tetrahedra six to a grid cell.
    pub mesh: TetMesh,
    /// Nodes bonded to the base.
    pub base: Vec<u32>,
    /// Nodes of the face.
    pub face: Vec<u32>,
    /// Triangles of the face, counter-clockwise seen from outside.
    pub face_triangles: Vec<[u32; 3]>,
    /// Grid cells across, along and through the thickness.
    pub cells: [u32; 3],
}

/// Fewest and most nodes of a pad mesh.
pub(super) const NODES: std::ops::RangeInclusive<usize> = 100..=200_000;

impl Grading {
    /// Spacing `spacing` (m) in the middle half of the face and the upper quarter of the gel.
    fn central(outline: &PadOutline, spacing: f64) -> Self {
        let PadOutline { width, length, thickness, .. } = *outline;
        let half = 0.25 * width.min(length);
        Self { spacing, zone: [half, half, 0.25 * thickness], growth: 0.3 }
    }

    /// The same spacing (m) everywhere.
    pub fn uniform(spacing: f64) -> Self {
        Self { spacing, zone: [f64::INFINITY; 3], growth: 0.0 }
    }

    /// Number of intervals between nodes from 0 to `extent` along axis `axis`: N(extent), rounded
    /// up.
    fn intervals(&self, axis: usize, extent: f64) -> u32 {
        // An exact multiple must not round up by an ulp.
        (self.nodes_before(axis, extent) - 1e-9).ceil().max(1.0) as u32
    }

    /// Number of intervals before `s`: N(s) = ∫ ds / h(s), h = spacing + growth · (distance from
    /// the zone).
    fn nodes_before(&self, axis: usize, s: f64) -> f64 {
        let fine = s.min(self.zone[axis]);
        let coarse = self.growth * (s - fine) / self.spacing;
        let grown = if coarse > 0.0 { coarse.ln_1p() / self.growth } else { 0.0 };
        fine / self.spacing + grown
    }

    /// Positions of nodes from 0 to `extent`: N inverted at equal steps.
    fn positions(&self, axis: usize, extent: f64) -> Vec<f64> {
        let intervals = self.intervals(axis, extent);
        let (all, zone) = (self.nodes_before(axis, extent), self.zone[axis] / self.spacing);
        let position = |i: u32| {
            let n = all * f64::from(i) / f64::from(intervals);
            let fine = n.min(zone);
            let coarse = self.growth * (n - fine);
            let grown = if coarse > 0.0 { coarse.exp_m1() / self.growth } else { 0.0 };
            self.spacing * (fine + grown)
        };
        (0..intervals).map(position).chain([extent]).collect()
    }

    fn validated(&self) -> Result<()> {
        if !(self.spacing.is_finite() && self.spacing > 0.0) {
            let found = format!("{} m", self.spacing);
            return Err(Error::invalid("spacing", found, "a length above 0"));
        }
        if !(0.0..=2.0).contains(&self.growth) {
            return Err(Error::invalid("growth", self.growth, "0 to 2"));
        }
        if !self.zone.iter().all(|&z| z >= 0.0) {
            return Err(Error::invalid("zone", format!("{:?} m", self.zone), "lengths from 0"));
        }
        Ok(())
    }
}

impl PadMesh {
    /// Meshes a pad, finest in its contact zone.
    pub fn new(outline: &PadOutline, grading: &Grading) -> Result<Self> {
        let outline = outline.validated()?;
        grading.validated()?;
        let count = node_count(&outline, grading);
        if count > *NODES.end() as f64 {
            let found = format!("{count} nodes at a spacing of {} m", grading.spacing);
            return Err(Error::invalid("pad mesh", found, format!("at most {}", NODES.end())));
        }
        let across = mirrored(&grading.positions(0, 0.5 * outline.width));
        let along = mirrored(&grading.positions(1, 0.5 * outline.length));
        let down = grading.positions(2, outline.thickness);
        Self::of_positions([&across, &along, &down], |x, y| outline.height(x, y))
    }

    /// Meshes columns at positions across and along, with layers at depths `down` under the apex,
    /// and the face at a `height` (m) over it.
    fn of_positions(
        [across, along, down]: [&[f64]; 3],
        height: impl Fn(f64, f64) -> f64,
    ) -> Result<Self> {
        let [nx, ny, nz] = [across, along, down].map(<[f64]>::len);
        let thickness = down[nz - 1];
        let mut vertices = Vec::with_capacity(nx * ny * nz);
        for depth in down {
            for &y in along {
                for &x in across {
                    // Depths are those under the apex; other columns are shortened.
                    let share = 1.0 - depth / thickness;
                    vertices.push(Point3::new(
                        x,
                        y,
                        share * (thickness + height(x, y)) - thickness,
                    ));
                }
            }
        }
        Self::of_vertices([nx, ny, nz], vertices)
    }

    /// Takes `vertices` in columns, x fastest, then y, as nodes.
    fn of_vertices([nx, ny, nz]: [usize; 3], vertices: Vec<Point3<f64>>) -> Result<Self> {
        let mesh = TetMesh::new("pad", vertices, kuhn(nx, ny, nz))?;
        let (plane, all) = ((nx * ny) as u32, (nx * ny * nz) as u32);
        let face_triangles = mesh.boundary();
        Ok(Self {
            base: (all - plane..all).collect(),
            face: (0..plane).collect(),
            face_triangles: face_triangles
                .into_iter()
                .filter(|triangle| triangle.iter().all(|&i| i < plane))
                .collect(),
            cells: [nx, ny, nz].map(|n| n as u32 - 1),
            mesh,
        })
    }

    /// Ends of the edge in whose middle each node of [`PadMesh::halved`] lies; twice the same node
    /// if it is one of this mesh.
    pub fn ends_of_halves(&self) -> Vec<[u32; 2]> {
        let [nx, ny, nz] = self.cells.map(|cells| 2 * cells as usize + 1);
        let [across, along, _] = self.cells.map(|cells| cells as usize + 1);
        // All edges lead from even places to odd ones along the axes on which their ends differ.
        let end = |half: [usize; 3], parity: usize| {
            let [i, j, k] = half.map(|half| half / 2 + half % 2 * ((half / 2 + parity) % 2));
            ((k * along + j) * across + i) as u32
        };
        let row = |k: usize, j: usize| (0..nx).map(move |i| [i, j, k]);
        let places = (0..nz).flat_map(|k| (0..ny).flat_map(move |j| row(k, j)));
        places.map(|half| [end(half, 0), end(half, 1)]).collect()
    }

    /// The same pad with the middles of all edges as nodes, too: two cells in the place of one
    /// along each axis, with the same polyhedron as its surface.
    #[must_use]
    pub fn halved(&self) -> Self {
        let middle = |[a, b]: [u32; 2]| {
            nalgebra::center(&self.mesh.vertices[a as usize], &self.mesh.vertices[b as usize])
        };
        let vertices = self.ends_of_halves().into_iter().map(middle).collect();
        let count = self.cells.map(|cells| 2 * cells as usize + 1);
        Self::of_vertices(count, vertices).expect("halves of good tetrahedra are good")
    }

    /// The pad as a flat layer of the same thickness that goes on beyond the sides as far as
    /// `reach` (m) or farther, with the same nodes in plan and depth where the pad is; and the
    /// layer's node in the place of each of the pad's.
    pub fn as_layer(&self, reach: f64) -> Result<(Self, Vec<u32>)> {
        /// Growth of the spacing from one column to the next. Even numbers of them keep the pattern
        /// of the tetrahedra.
        const GROWTH: f64 = 1.6;
        let [nx, ny, nz] = self.cells.map(|cells| cells as usize + 1);
        let at = |node: usize| self.mesh.vertices[node];
        let middle = ny / 2 * nx + nx / 2;
        let down: Vec<_> = (0..nz).map(|k| at(middle).z - at(k * nx * ny + middle).z).collect();
        let beyond = |inside: Vec<f64>| {
            let (mut outside, last) = (Vec::new(), inside[inside.len() - 1]);
            let (mut end, mut spacing) = (last, last - inside[inside.len() - 2]);
            while end < last + reach || outside.len() % 2 == 1 {
                spacing *= GROWTH;
                end += spacing;
                outside.push(end);
            }
            let before = outside.iter().rev().map(|x| -x);
            (before.chain(inside).chain(outside.iter().copied()).collect::<Vec<_>>(), outside.len())
        };
        let (across, left) = beyond((0..nx).map(|i| at(i).x).collect());
        let (along, under) = beyond((0..ny).map(|j| at(j * nx).y).collect());
        let layer = Self::of_positions([&across, &along, &down], |_, _| 0.0)?;
        let place = |node: usize| {
            let [i, j, k] = [node % nx, node / nx % ny, node / nx / ny];
            (k * along.len() + j + under) * across.len() + i + left
        };
        Ok((layer, (0..nx * ny * nz).map(|node| place(node) as u32).collect()))
    }

    /// Returns the finest [`Grading::central`] mesh of at most `nodes` nodes.
    pub fn with_nodes(outline: &PadOutline, nodes: usize) -> Result<Self> {
        if !NODES.contains(&nodes) {
            let expected = format!("{} to {}", NODES.start(), NODES.end());
            return Err(Error::invalid("nodes", nodes, expected));
        }
        let outline = outline.validated()?;
        Self::new(&outline, &finest(&outline, nodes, |h| Grading::central(&outline, h)))
    }

    /// Returns the finest mesh of at most `nodes` nodes that is finest at the sides, as far as 0.7
    /// thicknesses from them: for the influence of the sides, which is smooth in the middle.
    pub fn towards_sides(outline: &PadOutline, nodes: usize) -> Result<Self> {
        let outline = outline.validated()?;
        let (near, depth) = (0.7 * outline.thickness, 0.25 * outline.thickness);
        let graded = |spacing| Grading { spacing, zone: [near, near, depth], growth: 0.3 };
        let grading = finest(&outline, nodes, graded);
        let inwards = |axis: usize, half: f64| {
            let from_side = grading.positions(axis, half);
            mirrored(&from_side.iter().rev().map(|p| half - p).collect::<Vec<_>>())
        };
        let (across, along) = (inwards(0, 0.5 * outline.width), inwards(1, 0.5 * outline.length));
        let down = grading.positions(2, outline.thickness);
        Self::of_positions([&across, &along, &down], |x, y| outline.height(x, y))
    }

    /// Height of the apex above the base (m).
    pub fn thickness(&self) -> f64 {
        self.base.first().map_or(0.0, |&node| -self.mesh.vertices[node as usize].z)
    }

    /// Layer of `node`: 0 on the face, `cells[2]` on the base.
    pub fn layer(&self, node: u32) -> u32 {
        node / self.face.len() as u32
    }

    /// Grid cell of tetrahedron `tet`.
    pub fn cell(&self, tet: u32) -> u32 {
        tet / 6
    }
}

/// The finest of the gradings by spacing (m) whose mesh has at most `nodes` nodes.
fn finest(outline: &PadOutline, nodes: usize, graded: impl Fn(f64) -> Grading) -> Grading {
    let fits = |h: f64| node_count(outline, &graded(h)) <= nodes as f64;
    // The count falls in steps as the spacing grows: halve the interval down to one step.
    let (mut fine, mut coarse) = (1e-3 * outline.thickness, outline.length.max(outline.width));
    while coarse > fine * (1.0 + 1e-6) {
        let middle = (fine * coarse).sqrt();
        *(if fits(middle) { &mut coarse } else { &mut fine }) = middle;
    }
    graded(coarse)
}

fn node_count(outline: &PadOutline, grading: &Grading) -> f64 {
    let extents = [0.5 * outline.width, 0.5 * outline.length, outline.thickness];
    let [x, y, z] = [0, 1, 2].map(|axis| f64::from(grading.intervals(axis, extents[axis])));
    (2.0 * x + 1.0) * (2.0 * y + 1.0) * (z + 1.0)
}

/// Mirrors positions from 0 upwards to both sides of 0.
fn mirrored(half: &[f64]) -> Vec<f64> {
    half[1..].iter().rev().map(|x| -x).chain(half.iter().copied()).collect()
}

/// Kuhn's six tetrahedra for every cell of an nx × ny × nz grid of nodes, x fastest: the paths from
/// one corner of the cell to the opposite one along its edges. In every second cell along an axis
/// the paths run the other way, so that neighbours agree on their common diagonal.
pub(super) fn kuhn(nx: usize, ny: usize, nz: usize) -> Vec<[u32; 4]> {
    const PATHS: [[usize; 3]; 6] =
        [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let stride = [1, nx, nx * ny];
    let mut tets = Vec::with_capacity(6 * (nx - 1) * (ny - 1) * (nz - 1));
    for k in 0..nz - 1 {
        for j in 0..ny - 1 {
            for i in 0..nx - 1 {
                let cell = [i, j, k];
                let from: usize = (0..3).map(|a| (cell[a] + cell[a] % 2) * stride[a]).sum();
                tets.extend(PATHS.map(|path| {
                    let mut node = from;
                    let mut step = |axis: usize| {
                        let back = cell[axis] % 2 == 1;
                        node = if back { node - stride[axis] } else { node + stride[axis] };
                        node as u32
                    };
                    [from as u32, step(path[0]), step(path[1]), step(path[2])]
                }));
            }
        }
    }
    tets
}

impl PadMesh {
    /// Triangle of the face at (x, y) with barycentric coordinates in plan, or `None` off the face.
    pub fn under(&self, x: f64, y: f64) -> Option<([u32; 3], [f64; 3])> {
        under(&self.mesh.vertices, &self.face_triangles, x, y)
    }
}

/// Triangle of a face at (x, y) with barycentric coordinates in plan, or `None` off the face.
pub fn under(
    vertices: &[Point3<f64>],
    triangles: &[[u32; 3]],
    x: f64,
    y: f64,
) -> Option<([u32; 3], [f64; 3])> {
    /// Barycentric coordinate by which a point on a common edge may lie outside of both neighbours.
    const ROUNDING: f64 = 1e-9;
    triangles.iter().find_map(|corners| {
        let shares = plan_shares(&corners.map(|node| vertices[node as usize]), x, y)?;
        shares.iter().all(|&share| share >= -ROUNDING).then_some((*corners, shares))
    })
}

/// Barycentric coordinates of (x, y) in the plan of a triangle, or `None` if that has no area.
pub fn plan_shares([a, b, c]: &[Point3<f64>; 3], x: f64, y: f64) -> Option<[f64; 3]> {
    let twice = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
        (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1])
    };
    let ([a, b, c], p) = ([a, b, c].map(|v| [v.x, v.y]), [x, y]);
    let area = twice(a, b, c);
    let parts = [twice(p, b, c), twice(a, p, c), twice(a, b, p)];
    (area != 0.0).then(|| parts.map(|part| part / area))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::geometry::examples::mini;

    fn outlines() -> [PadOutline; 2] {
        [mini(), PadOutline::flat(0.02525, 0.02075, 0.004)]
    }

    #[test]
    fn every_resolution_keeps_its_quality_and_budget() {
        // Nodes asked for, and the smallest dihedral angle (degrees) of the crowned and flat pad.
        let table = [
            (500, [17.0, 28.0]),
            (1000, [11.0, 19.0]),
            (3000, [9.0, 16.0]),
            (10_000, [5.5, 10.5]),
            (15_000, [5.0, 9.0]),
        ];
        for (nodes, least) in table {
            for (outline, least) in outlines().iter().zip(least) {
                let pad = PadMesh::with_nodes(outline, nodes).unwrap();
                let (count, quality) = (pad.mesh.vertices.len(), pad.mesh.quality());
                assert!(count <= nodes && count > nodes * 4 / 5, "{count} nodes for {nodes}");
                let found = quality.min_dihedral.to_degrees();
                assert!(found > least, "{count} nodes: {found}°, expected {least}° or more");
                let most = quality.max_dihedral.to_degrees();
                assert!(most < 117.0, "{count} nodes: {most}°, expected 117° or less");
            }
        }
    }

    #[test]
    fn the_face_of_a_pad_is_known_by_its_outline() {
        for outline in outlines() {
            let pad = PadMesh::with_nodes(&outline, 400).unwrap();
            assert_eq!(outline.face_of(&pad.mesh), pad.face_triangles);
            let graded = outline.graded(&[Point3::new(1e-3, 2e-3, 0.0)], 800).unwrap();
            let area = |mesh: &TetMesh| {
                let places = |t: &[u32; 3]| t.map(|i| mesh.vertices[i as usize]);
                let in_plan = |[a, b, c]: [Point3<f64>; 3]| 0.5 * (b - a).cross(&(c - a)).z;
                outline.face_of(mesh).iter().map(places).map(in_plan).sum::<f64>()
            };
            for mesh in [&pad.mesh, &graded.mesh] {
                assert!((area(mesh) / (outline.length * outline.width) - 1.0).abs() < 1e-9);
            }
        }
        let [crowned, flat] = outlines();
        let pad = PadMesh::with_nodes(&crowned, 400).unwrap();
        assert_eq!(flat.face_of(&pad.mesh), Vec::<[u32; 3]>::new());
    }

    #[test]
    fn fifteen_thousand_nodes_reach_the_spacing_of_truth_meshes() {
        let pad = PadMesh::with_nodes(&mini(), 15_000).unwrap();
        let zone = |i: &u32| {
            let p = pad.mesh.vertices[*i as usize];
            p.x.abs() < 0.005 && p.y.abs() < 0.005
        };
        let inside = pad.face_triangles.iter().filter(|t| t.iter().all(zone));
        let longest = inside.flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).map(|edge| {
            let [a, b] = edge.map(|i| pad.mesh.vertices[i as usize]);
            (a - b).abs().max()
        });
        let spacing = longest.fold(0.0, f64::max);
        assert!(
            (0.2e-3..0.37e-3).contains(&spacing),
            "{spacing} m between nodes of the contact zone"
        );
    }

    #[test]
    fn the_volume_converges_to_that_under_the_face() {
        for outline in outlines() {
            // Midpoint rule, 400 × 400.
            let (n, PadOutline { width, length, thickness, .. }) = (400, outline);
            let at = |i: u32, extent: f64| ((f64::from(i) + 0.5) / f64::from(n) - 0.5) * extent;
            let heights = (0..n * n).map(|i| outline.height(at(i / n, width), at(i % n, length)));
            let mean = thickness + heights.sum::<f64>() / f64::from(n * n);
            let exact = width * length * mean;
            let error = |h: f64| {
                let pad = PadMesh::new(&outline, &Grading::uniform(h)).unwrap();
                pad.mesh.volume() / exact - 1.0
            };
            let (coarse, fine) = (error(1.2e-3), error(0.4e-3));
            // Linear facets under a face of slope jumps: second order, (0.4 mm)²/8/5.2 mm of 4 mm.
            assert!(fine.abs() < 1e-3, "{fine} of {exact} m³");
            // The midpoint sum of 160,000 terms itself is good to 1e-11.
            assert!(fine.abs() <= coarse.abs() / 3.0 + 1e-11, "{coarse}, then {fine}");
        }
    }

    #[test]
    fn base_and_face_lie_where_the_frame_says() {
        for outline in outlines() {
            let pad = PadMesh::with_nodes(&outline, 1000).unwrap();
            let at = |i: u32| pad.mesh.vertices[i as usize];
            assert!(pad.base.iter().all(|&i| (at(i).z + 0.004).abs() < 1e-18));
            for &i in &pad.face {
                let (p, exact) = (at(i), outline.height(at(i).x, at(i).y));
                assert!((p.z - exact).abs() < 1e-15, "{p}: face at {exact} m");
                assert_eq!(pad.layer(i), 0);
            }
            assert!(pad.face.iter().any(|&i| at(i).coords.norm() < 1e-15), "no node at the apex");
            assert!(pad.base.iter().all(|&i| pad.layer(i) == pad.cells[2]));
            let on_face: f64 = pad
                .face_triangles
                .iter()
                .map(|t| {
                    let [a, b, c] = t.map(|i| at(i).xy());
                    0.5 * (b - a).perp(&(c - a))
                })
                .sum();
            let plan = outline.width * outline.length;
            assert!((on_face / plan - 1.0).abs() < 1e-12, "{on_face} m² over {plan} m²");
        }
    }

    #[test]
    fn halves_add_the_middle_of_every_edge_and_keep_the_volume() {
        for outline in outlines() {
            let pad = PadMesh::with_nodes(&outline, 300).unwrap();
            let (halved, mut ends) = (pad.halved(), pad.ends_of_halves());
            for ends in &mut ends {
                ends.sort_unstable();
            }
            let (same, other): (Vec<_>, Vec<_>) = ends.into_iter().partition(|[a, b]| a == b);
            assert!(same.iter().map(|[a, _]| *a).eq(0..pad.mesh.vertices.len() as u32));
            let pair =
                |tet: &[u32; 4], i: usize, j: usize| [tet[i].min(tet[j]), tet[i].max(tet[j])];
            let of_tet = |tet| (0..4).flat_map(move |j| (0..j).map(move |i| pair(tet, i, j)));
            let edges: BTreeSet<_> = pad.mesh.tets.iter().flat_map(of_tet).collect();
            assert_eq!(other.len(), edges.len());
            assert_eq!(other.into_iter().collect::<BTreeSet<_>>(), edges);
            let volumes = [&pad, &halved].map(|pad| pad.mesh.volume());
            assert!((volumes[1] / volumes[0] - 1.0).abs() < 1e-12, "{volumes:?} m³");
            let is_low = |&i: &u32| (halved.mesh.vertices[i as usize].z + 0.004).abs() < 1e-15;
            assert!(halved.base.iter().all(is_low));
        }
    }

    #[test]
    fn meshes_towards_the_sides_are_finest_there() {
        for outline in outlines() {
            for nodes in [700, 2000, 4000] {
                let pad = PadMesh::towards_sides(&outline, nodes).unwrap();
                let (count, across) = (pad.mesh.vertices.len(), pad.cells[0] as usize + 1);
                assert!(count <= nodes && count > nodes * 3 / 5, "{count} nodes for {nodes}");
                let columns: Vec<_> =
                    pad.face[..across].iter().map(|i| pad.mesh.vertices[*i as usize].x).collect();
                let apart: Vec<_> = columns.windows(2).map(|pair| pair[1] - pair[0]).collect();
                let middle = apart[apart.len() / 2];
                assert!(apart[0] < 0.5 * middle, "{} m at the sides, {middle} m inside", apart[0]);
                assert!((columns[0] + 0.5 * outline.width).abs() < 1e-15 && apart[0] > 0.0);
                for &i in &pad.face {
                    let p = pad.mesh.vertices[i as usize];
                    assert!((p.z - outline.height(p.x, p.y)).abs() < 1e-15, "{p}");
                }
            }
        }
    }

    #[test]
    fn a_layer_has_the_nodes_of_the_pad_and_goes_on_beyond_it() {
        let (pad, reach) = (PadMesh::with_nodes(&mini(), 1000).unwrap(), 0.01);
        let (layer, nodes) = pad.as_layer(reach).unwrap();
        assert_eq!(nodes.len(), pad.mesh.vertices.len());
        for (own, node) in pad.mesh.vertices.iter().zip(&nodes) {
            let at = layer.mesh.vertices[*node as usize];
            assert!((at - own).xy().norm() < 1e-15, "{own} at {at}");
            // Both are at the same share of the height over the base.
            let [high, share] = [own.z, at.z].map(|z| (z + 0.004) / 0.004);
            let height = 1.0 + mini().height(own.x, own.y) / 0.004;
            assert!((high - share * height).abs() < 1e-12, "{own} at {at}");
        }
        let end = layer.mesh.vertices.iter().fold(Point3::origin(), |end, p| end.sup(p));
        assert!(end.x > 0.5 * 0.02075 + reach && end.y > 0.5 * 0.02525 + reach, "{end}");
        assert!(layer.face.iter().all(|&i| layer.mesh.vertices[i as usize].z == 0.0));
    }

    #[test]
    fn the_mesh_is_its_own_mirror_image() {
        let pad = PadMesh::with_nodes(&mini(), 1000).unwrap();
        let key = |p: Point3<f64>| [p.x, p.y, p.z].map(|x| (x * 1e12).round() as i64);
        let tets = |signs: [f64; 2]| {
            let mirrored = |i: u32| {
                let p = pad.mesh.vertices[i as usize];
                key(Point3::new(p.x * signs[0], p.y * signs[1], p.z))
            };
            let mut all: Vec<_> = pad.mesh.tets.iter().map(|t| t.map(mirrored)).collect();
            for tet in &mut all {
                tet.sort_unstable();
            }
            all.sort_unstable();
            all
        };
        let straight = tets([1.0, 1.0]);
        assert_eq!(tets([-1.0, 1.0]), straight);
        assert_eq!(tets([1.0, -1.0]), straight);
    }

    #[test]
    fn six_tetrahedra_fill_each_cell() {
        let grading = Grading { spacing: 0.5e-3, zone: [2e-3, 3e-3, 1e-3], growth: 0.5 };
        let pad = PadMesh::new(&PadOutline::flat(0.02, 0.01, 0.003), &grading).unwrap();
        let [nx, ny, _] = pad.cells;
        for (t, tet) in pad.mesh.tets.iter().enumerate() {
            let cell = pad.cell(t as u32);
            let low = [cell % nx, cell / nx % ny, cell / nx / ny];
            for &node in tet {
                let (i, j) = (node % (nx + 1), node / (nx + 1) % (ny + 1));
                let at = [i, j, pad.layer(node)];
                assert!((0..3).all(|a| at[a] == low[a] || at[a] == low[a] + 1), "{t}: {at:?}");
            }
        }
    }

    #[test]
    fn impossible_pads_are_named() {
        let message = |outline: PadOutline| outline.validated().unwrap_err().to_string();
        let flat = PadOutline::flat(0.02525, 0.02075, 0.004);
        assert!(message(PadOutline { thickness: 0.0, ..flat }).starts_with("thickness"));
        assert!(message(PadOutline { radius_along: 0.01, ..flat }).starts_with("radius_along"));
        assert!(message(PadOutline { rim_width: 0.001, ..flat }).starts_with("rim_width"));
        assert!(message(PadOutline { radius_across: 0.0105, ..flat }).starts_with("thickness"));
        let fine = PadMesh::new(&flat, &Grading::uniform(1e-5)).unwrap_err().to_string();
        assert!(fine.contains("at most 200000"), "{fine}");
        assert!(PadMesh::new(&flat, &Grading::uniform(f64::NAN)).is_err());
        assert!(PadMesh::with_nodes(&flat, 20).unwrap_err().to_string().starts_with("nodes"));
    }
}
