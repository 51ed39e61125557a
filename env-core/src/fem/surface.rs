//! Contact surface of a discretised body.
//!
//! Linear faces are flat. Between two nodes at a distance h on a ball of radius R such a face cuts
//! off a cap of height h²/8R; contact moves this cap out of the ball and drives the nodes deeper,
//! so that on a coarse mesh the force is a quarter too high. The surface of `p1-bar` is therefore
//! quadratic over every face, like that of `p2`, with the middle of an edge e lifted by −⅛ eᵀ𝐇e off
//! its chord: 𝐇 is the second derivative of the surface at the edge's ends, fitted to the
//! neighbours there. The middles are constant weighted sums of the nodes, so that forces and
//! stiffness remain derivatives of an energy.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, Point3, Vector2, Vector3};

use super::{
    element::{Element, Nodes},
    patches::faces,
    spacing::{Spacing, longest_edge},
};
use crate::{
    contact::{Backing, SurfacePoint},
    deformation::SoftBody,
    geometry::{FACES, TetMesh},
};

/// Cosine of the angle between a face and the mean normal at its node below which the node lies on
/// an edge of the body, not within a curved surface.
const CREASE: f64 = 0.8;

/// Sum of the absolute weights in eᵀ𝐇e, 4 on a regular lattice, above which a fit is discarded.
const WILD: f64 = 32.0;

/// A face of the body's boundary.
struct FreeFacet {
    /// Nodes, counter-clockwise from outside.
    ends: [u32; 3],
    /// Its tetrahedron.
    tet: u32,
    /// Unit normal at rest.
    normal: Vector3<f64>,
    /// Area at rest (m²).
    area: f64,
}

/// Nodes with their weights.
type NodeWeights = Vec<(u32, f64)>;

/// Returns the contact points of the body's surface, and its backing: the faces whose nodes are all
/// fixed.
pub(super) fn surface(
    body: &SoftBody,
    nodes: &Nodes,
    element: Element,
    spacing: Spacing,
) -> (Vec<SurfacePoint>, Backing) {
    let mesh = body.mesh();
    let facets = facets(mesh);
    let curvatures = match element {
        Element::P1Bar => curvatures(mesh, &facets),
        _ => BTreeMap::new(),
    };
    let middle = |a: u32, b: u32| match element {
        Element::P2 => vec![(nodes.middle(a, b), 1.0)],
        _ => lifted_middle(mesh, &curvatures, a, b),
    };
    let (mut points, mut held, mut rim) = (Vec::new(), Vec::new(), BTreeMap::new());
    for FreeFacet { ends, tet, area, .. } in facets {
        let is_held = ends.iter().all(|&node| nodes.fixed[node as usize]);
        let middles = [0, 1, 2].map(|i| middle(ends[i], ends[(i + 1) % 3]));
        let pieces = spacing.pieces(longest_edge(mesh, ends));
        let rule = face_rule(pieces);
        let (area, young) = (area / rule.len() as f64, body.moduli()[tet as usize].young);
        let point = |l: &[f64; 3]| {
            let shares = quadratic_shares(ends, &middles, l);
            SurfacePoint { shares, area, young }
        };
        if !is_held {
            points.extend(rule.iter().map(point));
            continue;
        }
        held.extend(rule.iter().map(point));
        for i in 0..3 {
            let edge = [ends[i], ends[(i + 1) % 3]];
            // An edge of two held faces lies within the held surface, not at its rim.
            if rim.remove(&[edge[1], edge[0]]).is_none() {
                rim.insert(edge, edge_rule(i, pieces).map(|l| point(&l)).collect::<Vec<_>>());
            }
        }
    }
    let still = vec![Vector3::zeros(); nodes.places.len()];
    let held = held.iter().chain(rim.values().flatten());
    (points, Backing::new(held.map(|point| point.place(&nodes.places, &still))))
}

fn facets(mesh: &TetMesh) -> Vec<FreeFacet> {
    let outer = faces(mesh).into_values().filter(|owners| owners.len() == 1);
    let facet = |(tet, face): (u32, usize)| {
        let ends = FACES[face].map(|corner| mesh.tets[tet as usize][corner]);
        let [a, b, c] = ends.map(|node| mesh.vertices[node as usize]);
        let twice = (b - a).cross(&(c - a));
        FreeFacet { ends, tet, normal: twice.normalize(), area: 0.5 * twice.norm() }
    };
    outer.map(|owners| facet(owners[0])).collect()
}

/// Barycentric coordinates of points on a face whose edges are cut into `pieces`: the centroids of
/// equal triangles.
fn face_rule(pieces: u32) -> Vec<[f64; 3]> {
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

/// Barycentric coordinates of points on the edge from corner `i` to the next, cut into `pieces`.
fn edge_rule(i: usize, pieces: u32) -> impl Iterator<Item = [f64; 3]> {
    (0..=pieces).map(move |k| {
        let mut l = [0.0; 3];
        l[(i + 1) % 3] = f64::from(k) / f64::from(pieces);
        l[i] = 1.0 - l[(i + 1) % 3];
        l
    })
}

/// Weights of a quadratic face at barycentric coordinates `l`: L(2L − 1) of its corners, 4 L L′ of
/// the middles of its edges.
fn quadratic_shares(ends: [u32; 3], middles: &[NodeWeights; 3], l: &[f64; 3]) -> NodeWeights {
    let mut sum = BTreeMap::new();
    for i in 0..3 {
        *sum.entry(ends[i]).or_insert(0.0) += l[i] * (2.0 * l[i] - 1.0);
        let bubble = 4.0 * l[i] * l[(i + 1) % 3];
        for &(node, weight) in &middles[i] {
            *sum.entry(node).or_insert(0.0) += bubble * weight;
        }
    }
    sum.into_iter().filter(|&(_, weight)| weight.abs() > 1e-12).collect()
}

/// Second derivatives of the surface at a smooth node.
struct Curvature {
    node: u32,
    /// Neighbours.
    ring: Vec<u32>,
    /// Tangents.
    frame: [Vector3<f64>; 2],
    /// Matrix (3, R) in 1/m² that gives H₁₁, H₁₂ and H₂₂ of a field from its differences to the R
    /// neighbours.
    fit: DMatrix<f64>,
}

impl Curvature {
    /// Weights of the nodes' positions in eᵀ𝐇e along `edge` (m).
    fn along(&self, edge: &Vector3<f64>) -> NodeWeights {
        let [x, y] = self.frame.map(|t| t.dot(edge));
        let weight = |i: usize| {
            let h = self.fit.column(i);
            x * x * h[0] + 2.0 * x * y * h[1] + y * y * h[2]
        };
        let mut weights: NodeWeights =
            self.ring.iter().enumerate().map(|(i, &node)| (node, weight(i))).collect();
        weights.push((self.node, -weights.iter().map(|(_, w)| w).sum::<f64>()));
        weights
    }
}

/// Curvatures by node, where the surface is smooth.
fn curvatures(mesh: &TetMesh, facets: &[FreeFacet]) -> BTreeMap<u32, Curvature> {
    let mut around: BTreeMap<u32, Vec<&FreeFacet>> = BTreeMap::new();
    for facet in facets {
        facet.ends.iter().for_each(|&node| around.entry(node).or_default().push(facet));
    }
    let smooth = |(node, facets): (u32, Vec<&FreeFacet>)| {
        let normal: Vector3<f64> = facets.iter().map(|f| f.normal * f.area).sum();
        let normal = normal.try_normalize(0.0)?;
        let flat = facets.iter().all(|f| f.normal.dot(&normal) > CREASE);
        let ring: BTreeSet<u32> =
            facets.iter().flat_map(|f| f.ends).filter(|&n| n != node).collect();
        flat.then(|| (node, curvature(&mesh.vertices, node, ring.into_iter().collect(), &normal)))
    };
    around.into_iter().filter_map(smooth).collect()
}

/// Fits g·ξ + ½ ξᵀ𝐇ξ to the differences of a field at `ring` from `node`, with more weight on
/// nearer ones.
fn curvature(
    places: &[Point3<f64>],
    node: u32,
    ring: Vec<u32>,
    normal: &Vector3<f64>,
) -> Curvature {
    let first = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
    let frame = [first, normal.cross(&first)];
    let away = |&n: &u32| places[n as usize] - places[node as usize];
    let scale = ring.iter().map(|n| away(n).norm()).sum::<f64>() / ring.len() as f64;
    let mut rows = DMatrix::zeros(ring.len(), 5);
    let mut weights = Vec::new();
    for (i, n) in ring.iter().enumerate() {
        let at = Vector2::from(frame.map(|t| t.dot(&away(n)) / scale));
        let weight = 1.0 / at.norm();
        let row = [at.x, at.y, 0.5 * at.x * at.x, at.x * at.y, 0.5 * at.y * at.y];
        row.iter().enumerate().for_each(|(j, value)| rows[(i, j)] = weight * value);
        weights.push(weight);
    }
    let inverse = rows.pseudo_inverse(1e-6).expect("the tolerance is not negative");
    let mut fit = inverse.rows(2, 3) / (scale * scale);
    fit.column_iter_mut().zip(&weights).for_each(|(mut column, &weight)| column *= weight);
    Curvature { node, ring, frame, fit }
}

/// Weights of the middle of an edge, ½(a + b) − ⅛ eᵀ𝐇e with the mean 𝐇 of its smooth ends. An end
/// whose neighbours are too uneven for a reliable fit is left out.
fn lifted_middle(
    mesh: &TetMesh,
    curvatures: &BTreeMap<u32, Curvature>,
    a: u32,
    b: u32,
) -> NodeWeights {
    let edge = mesh.vertices[b as usize] - mesh.vertices[a as usize];
    let mut weights = vec![(a, 0.5), (b, 0.5)];
    let tame = |bend: &NodeWeights| bend.iter().map(|(_, w)| w.abs()).sum::<f64>() < WILD;
    let bends = [a, b].into_iter().filter_map(|end| Some(curvatures.get(&end)?.along(&edge)));
    let bends: Vec<_> = bends.filter(tame).collect();
    for bend in &bends {
        let share = -0.125 / bends.len() as f64;
        weights.extend(bend.iter().map(|(node, w)| (*node, share * w)));
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::{
        super::spacing::{Faces, USUAL},
        *,
    };
    use nalgebra::Isometry3;

    use crate::{
        Error,
        deformation::{Law, Moduli},
        geometry::{PadMesh, PadOutline, Shape},
    };

    /// Largest distance between the contact surface of a pad bent to z = f(x, y) and the exact
    /// surface, at least two cells from the rim.
    fn distance(element: Element, f: impl Fn(f64, f64) -> f64) -> f64 {
        let pad = PadMesh::with_nodes(&PadOutline::flat(0.02, 0.02, 0.004), 1000).unwrap();
        let moduli = Moduli { young: 1e5, poisson: 0.45 };
        let body = SoftBody::new(pad.mesh.clone(), Law::default(), moduli, &pad.base).unwrap();
        let nodes = Nodes::new(&body, element);
        let face: BTreeSet<u32> = pad.face.iter().copied().collect();
        let (points, _) = surface(&body, &nodes, element, Faces::new(&body, USUAL).usual);
        let inner = points.iter().filter(|point| {
            point.shares.iter().all(|(node, _)| {
                let p = nodes.places[*node as usize];
                face.contains(node) && p.x.abs() < 5e-3 && p.y.abs() < 5e-3
            })
        });
        let off = |point: &SurfacePoint| {
            let bent: Vec<_> =
                nodes.places.iter().map(|p| Vector3::new(0.0, 0.0, f(p.x, p.y))).collect();
            let place = point.place(&nodes.places, &bent);
            (place.z - f(place.x, place.y)).abs()
        };
        let off: Vec<_> = inner.map(off).collect();
        assert!(off.len() > 10 && off.iter().all(|off| off.is_finite()));
        off.into_iter().fold(0.0, f64::max)
    }

    #[test]
    fn weights_keep_planes_and_nearly_a_ball() {
        let plane = |x: f64, y: f64| 1e-3 + 0.1 * x - 0.3 * y;
        let ball = |x: f64, y: f64| (8e-3f64.powi(2) - x * x - y * y).sqrt();
        // Rounding of places of a centimetre.
        assert!(distance(Element::P1Bar, plane) < 1e-16);
        let [flat, lifted] = [Element::P1, Element::P1Bar].map(|e| distance(e, ball));
        assert!(flat > 3e-5 && lifted < 0.3 * flat, "{lifted} m off, flat faces {flat} m");
    }

    #[test]
    fn what_holds_a_body_is_looked_at_up_to_its_corners() {
        let pad = PadMesh::with_nodes(&PadOutline::flat(0.02, 0.02, 0.004), 1000).unwrap();
        let moduli = Moduli { young: 1e5, poisson: 0.45 };
        let body = SoftBody::new(pad.mesh.clone(), Law::default(), moduli, &pad.base).unwrap();
        let nodes = Nodes::new(&body, Element::P1Bar);
        let usual = Faces::new(&body, USUAL).usual;
        let (_, backing) = surface(&body, &nodes, Element::P1Bar, usual);
        let corner = pad.mesh.vertices[pad.base[0] as usize];
        let at = [Isometry3::translation(0.0, 0.0, corner.z)];
        let held = |inner: f64| {
            let ring = Shape::Annulus { outer: 0.02, inner, half_height: 1e-3 };
            backing.check(&[ring], [&at, &at], 2e-5)
        };
        let farthest = corner.x.hypot(corner.y);
        assert!(held(farthest + 1e-6).is_ok(), "a ring round the body");
        let error = held(farthest - 5e-5).unwrap_err();
        assert!(matches!(error, Error::Penetrated { .. }), "a ring in its corners: {error}");
    }

    #[test]
    fn an_edge_of_the_body_stays_sharp() {
        let pad = PadMesh::with_nodes(&PadOutline::flat(0.02, 0.02, 0.004), 300).unwrap();
        let facets = facets(&pad.mesh);
        let smooth = curvatures(&pad.mesh, &facets);
        let at_rim = |p: &Point3<f64>| p.x.abs() > 0.00999 || p.y.abs() > 0.00999;
        assert!(smooth.len() > 20);
        for node in smooth.keys() {
            let place = &pad.mesh.vertices[*node as usize];
            let top_edge = at_rim(place) && place.z > -1e-9;
            assert!(!top_edge, "the edge at {place} is smooth");
        }
    }
}
