//! Finite elements: linear tetrahedra, alone or in patches, and quadratic ones.
//!
//! Shapes: N nodes (the mesh's V, then for `p2` the middles of its edges), T tetrahedra.

use std::{fmt, str::FromStr};

use nalgebra::{Matrix3, Point3, Vector3};

use super::patches::{edges, patches};
use crate::{
    Error, Result,
    deformation::{Moduli, Numbering, SoftBody},
    geometry::{EDGES, TetMesh},
};

/// Kind of finite element.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Element {
    /// Linear tetrahedron. Far too stiff for ν of 0.45 and above (volumetric locking).
    P1,
    /// Linear tetrahedron whose dilatation is averaged over patches of about six.
    #[default]
    P1Bar,
    /// Quadratic tetrahedron with straight edges at rest, used as the reference.
    P2,
}

impl From<Element> for Numbering {
    fn from(element: Element) -> Self {
        match element {
            Element::P1 | Element::P1Bar => Self::Vertices,
            Element::P2 => Self::VerticesAndEdges,
        }
    }
}

impl Element {
    /// Names of the elements in files and in Python.
    pub const NAMES: [(&str, Self); 3] =
        [("p1", Self::P1), ("p1-bar", Self::P1Bar), ("p2", Self::P2)];
}

impl FromStr for Element {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let known = Self::NAMES.map(|(name, _)| name).join(", ");
        let element = Self::NAMES.iter().find(|(known, _)| *known == name);
        element.map(|&(_, e)| e).ok_or_else(|| Error::invalid("element", name, known))
    }
}

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Self::NAMES.iter().find(|(_, e)| e == self).map_or("", |(name, _)| *name);
        f.write_str(name)
    }
}

/// An integration point of the rest state, at which the energy density is evaluated; its element
/// has M nodes.
#[derive(Clone, Debug)]
pub(super) struct EnergyPoint<const M: usize> {
    /// Tetrahedron it lies in.
    pub(super) tet: u32,
    /// Its nodes, as indices into those of its cell.
    pub(super) local: [u8; M],
    /// Gradients of their shape functions (1/m).
    pub(super) gradients: [Vector3<f64>; M],
    /// Volume that it represents (m³).
    pub(super) volume: f64,
}

/// A set of energy points that is assembled as one dense block.
#[derive(Clone, Debug)]
pub(super) struct Cell<const M: usize> {
    /// Nodes.
    pub(super) nodes: Vec<u32>,
    pub(super) points: Vec<EnergyPoint<M>>,
    /// `true` if all points share one dilatation.
    pub(super) averaged: bool,
}

/// Nodes of an element kind on a mesh.
#[derive(Clone, Debug)]
pub(super) struct Nodes {
    /// Positions at rest (N).
    pub(super) places: Vec<Point3<f64>>,
    /// Ends of the edges whose middles are the nodes from V on, ascending.
    pub(super) edges: Vec<[u32; 2]>,
    /// `true` for every node that is held fixed (N).
    pub(super) fixed: Vec<bool>,
}

impl Nodes {
    pub(super) fn new(body: &SoftBody, element: Element) -> Self {
        let mesh = body.mesh();
        let mut places = mesh.vertices.clone();
        let mut fixed = vec![false; places.len()];
        body.fixed().iter().for_each(|&node| fixed[node as usize] = true);
        let mut middles = Vec::new();
        if element == Element::P2 {
            middles.extend(edges(mesh).into_keys());
            for &[a, b] in &middles {
                let (a, b) = (a as usize, b as usize);
                places.push(nalgebra::center(&places[a], &places[b]));
                fixed.push(fixed[a] && fixed[b]);
            }
        }
        Self { places, edges: middles, fixed }
    }

    /// The node in the middle of edge ab.
    pub(super) fn middle(&self, a: u32, b: u32) -> u32 {
        let vertices = self.places.len() - self.edges.len();
        let found = self.edges.binary_search(&[a.min(b), a.max(b)]);
        (vertices + found.expect("every edge has a middle")) as u32
    }
}

/// Gradients of the barycentric coordinates (1/m) and the volume (m³) of a tetrahedron.
pub(super) fn barycentric([a, b, c, d]: [Point3<f64>; 4]) -> ([Vector3<f64>; 4], f64) {
    let edges = Matrix3::from_columns(&[b - a, c - a, d - a]);
    let inverse = edges.try_inverse().expect("a soft body has no flat tetrahedron");
    let [u, v, w] = [0, 1, 2].map(|i| inverse.row(i).transpose());
    ([-(u + v + w), u, v, w], edges.determinant() / 6.0)
}

/// Linear tetrahedra; `averaged` ones in patches that share one dilatation.
pub(super) fn linear_cells(mesh: &TetMesh, moduli: &[Moduli], averaged: bool) -> Vec<Cell<4>> {
    let groups = if averaged {
        patches(mesh, moduli)
    } else {
        (0..mesh.tets.len() as u32).map(|tet| vec![tet]).collect()
    };
    let cell = |group: Vec<u32>| {
        let mut nodes: Vec<u32> = group.iter().flat_map(|&t| mesh.tets[t as usize]).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let points = group.iter().map(|&tet| {
            let (gradients, volume) = barycentric(mesh.corners(tet as usize));
            let local = mesh.tets[tet as usize].map(|node| index_in(&nodes, node));
            EnergyPoint { tet, local, gradients, volume }
        });
        let points = points.collect();
        Cell { nodes, points, averaged }
    };
    groups.into_iter().map(cell).collect()
}

fn index_in(nodes: &[u32], node: u32) -> u8 {
    nodes.iter().position(|&n| n == node).expect("a cell holds the nodes of its points") as u8
}

/// Barycentric coordinates of the four-point rule, exact for quadratic polynomials (Hammer 1956).
const FOUR_POINTS: [[f64; 4]; 4] = {
    const A: f64 = 0.585_410_196_624_968_5;
    const B: f64 = 0.138_196_601_125_010_5;
    [[A, B, B, B], [B, A, B, B], [B, B, A, B], [B, B, B, A]]
};

/// Nodes of the quadratic tetrahedra (T): corners first, then the middles of the edges in the order
/// of [`EDGES`].
pub(super) fn quadratic_nodes(mesh: &TetMesh, nodes: &Nodes) -> Vec<[u32; 10]> {
    let of = |ends: &[u32; 4]| {
        let middles = EDGES.map(|[a, b]| nodes.middle(ends[a], ends[b]));
        std::array::from_fn(|i| if i < 4 { ends[i] } else { middles[i - 4] })
    };
    mesh.tets.iter().map(of).collect()
}

/// Quadratic tetrahedra.
pub(super) fn quadratic_cells(mesh: &TetMesh, nodes: &Nodes) -> Vec<Cell<10>> {
    let cell = |(tet, nodes): (u32, [u32; 10])| {
        let (gradients, volume) = barycentric(mesh.corners(tet as usize));
        let points = FOUR_POINTS.map(|l| EnergyPoint {
            tet,
            local: std::array::from_fn(|i| i as u8),
            gradients: quadratic_gradients(&l, &gradients),
            volume: volume / 4.0,
        });
        Cell { nodes: nodes.to_vec(), points: points.to_vec(), averaged: false }
    };
    (0..).zip(quadratic_nodes(mesh, nodes)).map(cell).collect()
}

/// Quadratic shape functions at barycentric coordinates `l`: L(2L − 1) at the corners and 4 L L′ at
/// the middles.
pub(super) fn quadratic_shares(l: &[f64; 4]) -> [f64; 10] {
    std::array::from_fn(|i| {
        if let 0..4 = i {
            l[i] * (2.0 * l[i] - 1.0)
        } else {
            let [a, b] = EDGES[i - 4];
            4.0 * l[a] * l[b]
        }
    })
}

/// Gradients of [`quadratic_shares`].
pub(super) fn quadratic_gradients(l: &[f64; 4], g: &[Vector3<f64>; 4]) -> [Vector3<f64>; 10] {
    std::array::from_fn(|i| {
        if let 0..4 = i {
            (4.0 * l[i] - 1.0) * g[i]
        } else {
            let [a, b] = EDGES[i - 4];
            4.0 * (l[a] * g[b] + l[b] * g[a])
        }
    })
}
