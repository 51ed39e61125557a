//! Points of a discretised body's surface at which contact is felt.
//!
//! Between two nodes on a ball of radius R a flat face cuts off a cap of height h²/8R. Pressed out
//! of the ball, as `p1` does it, such faces drive their nodes deeper, which a coarse mesh feels as a
//! force a quarter too high; and a mesh of linear tetrahedra has no freedom to follow the ball at
//! more points than it has nodes. `p1-bar` therefore feels contact at its nodes, and on its faces
//! only what is sharper than a ball of radius [`DENTED`]: its face points are recessed by the cap
//! that such a ball would cut off. An edge or a tip between the nodes sinks in by that and no more: at most e²/6R on a face of longest edge e.

use std::collections::BTreeMap;

use super::{
    element::{Element, Nodes},
    patches::{FACES, faces},
};
use crate::{contact::SurfacePoint, deformation::SoftBody};

/// Contact points lie about this close (m), so that a tip of half a millimetre is not missed.
const SPACING: f64 = 4e-4;
/// Pieces into which a face's edges are cut: at least and at most.
const PIECES: (f64, f64) = (2.0, 8.0);
/// Radius of the ball that `p1-bar` feels at its nodes alone (m).
const DENTED: f64 = 2.5e-3;

/// A face of the body's boundary that is not held all round.
struct Facet {
    /// Nodes, counter-clockwise from outside.
    ends: [u32; 3],
    /// Squared lengths of the edges from each node to the next (m²).
    edges: [f64; 3],
    /// Area at rest (m²).
    area: f64,
    /// Young's modulus under it (Pa).
    young: f64,
}

/// Points of the body's surface at which contact is felt; faces held all round have none.
pub(super) fn surface_points(
    body: &SoftBody,
    nodes: &Nodes,
    element: Element,
) -> Vec<SurfacePoint> {
    let facets = facets(body, nodes);
    let mut points = match element {
        Element::P1Bar => node_points(&facets),
        _ => Vec::new(),
    };
    for facet in &facets {
        let rule = facet.rule();
        points.extend(rule.iter().map(|l| SurfacePoint {
            shares: match element {
                Element::P2 => quadratic_shares(nodes, facet.ends, l),
                _ => facet.ends.into_iter().zip(*l).collect(),
            },
            area: facet.area / rule.len() as f64,
            young: facet.young,
            recess: if element == Element::P1Bar { facet.cap(l) } else { 0.0 },
        }));
    }
    points
}

fn facets(body: &SoftBody, nodes: &Nodes) -> Vec<Facet> {
    let mesh = body.mesh();
    let facet = |owners: Vec<(u32, usize)>| {
        let [(tet, face)] = owners[..] else { return None };
        let ends = FACES[face].map(|corner| mesh.tets[tet as usize][corner]);
        let [a, b, c] = ends.map(|node| mesh.vertices[node as usize]);
        let held = ends.iter().all(|&node| nodes.fixed[node as usize]);
        (!held).then(|| Facet {
            ends,
            edges: [b - a, c - b, a - c].map(|edge| edge.norm_squared()),
            area: 0.5 * (b - a).cross(&(c - a)).norm(),
            young: body.moduli()[tet as usize].young,
        })
    };
    faces(mesh).into_values().filter_map(facet).collect()
}

impl Facet {
    /// Barycentric coordinates of points on it: the centroids of equal triangles.
    fn rule(&self) -> Vec<[f64; 3]> {
        let longest = self.edges.into_iter().fold(0.0, f64::max).sqrt();
        let pieces = (longest / SPACING).ceil().clamp(PIECES.0, PIECES.1) as u32;
        let mut rule = Vec::new();
        for i in 0..pieces {
            for j in 0..pieces - i {
                let mut add = |corner: f64| {
                    let [a, b] = [i, j].map(|k| (f64::from(k) + corner) / f64::from(pieces));
                    rule.push([a, b, 1.0 - a - b]);
                };
                add(1.0 / 3.0);
                if i + j + 1 < pieces {
                    add(2.0 / 3.0);
                }
            }
        }
        rule
    }

    /// Height over it, at barycentric coordinates `l`, of a ball of radius [`DENTED`] through its
    /// nodes (m).
    fn cap(&self, l: &[f64; 3]) -> f64 {
        let sum: f64 = (0..3).map(|i| l[i] * l[(i + 1) % 3] * self.edges[i]).sum();
        0.5 * sum / DENTED
    }
}

/// The facets' nodes, each with a third of the facets around it and the stiffest of their moduli.
fn node_points(facets: &[Facet]) -> Vec<SurfacePoint> {
    let mut around: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
    for facet in facets {
        for node in facet.ends {
            let (area, young) = around.entry(node).or_default();
            *area += facet.area / 3.0;
            *young = young.max(facet.young);
        }
    }
    let point = |(node, (area, young))| SurfacePoint {
        shares: vec![(node, 1.0)],
        area,
        young,
        recess: 0.0,
    };
    around.into_iter().map(point).collect()
}

/// Shape functions of a quadratic face at barycentric coordinates `l`.
fn quadratic_shares(nodes: &Nodes, ends: [u32; 3], l: &[f64; 3]) -> Vec<(u32, f64)> {
    let corners = (0..3).map(|i| (ends[i], l[i] * (2.0 * l[i] - 1.0)));
    let middles = [[0, 1], [1, 2], [2, 0]];
    let middles = middles.map(|[i, j]| (nodes.middle(ends[i], ends[j]), 4.0 * l[i] * l[j]));
    corners.chain(middles).collect()
}
