//! The part of the surface that one load step can touch, with its part of the compliance.

use nalgebra::{Isometry3, Point3, Vector3};

use super::condensed::{Condensed, Facet, INSIDE, add_rows};
use crate::{
    contact::{SurfacePoint, Touch},
    deformation::Anchor,
    geometry::Shape,
};

/// Facets near the shapes. Nodes and points are numbered anew: m free nodes, then fixed ones.
pub(super) struct Zone {
    /// Whether each facet belongs to it.
    facets: Vec<bool>,
    /// Number of each point among all, ascending.
    points: Vec<u32>,
    /// The points, carried by nodes of the zone.
    pub(super) surface: Vec<SurfacePoint>,
    /// The mesh's number of each node.
    pub(super) nodes: Vec<u32>,
    /// Number of free nodes, m.
    pub(super) free: usize,
    /// Places of the nodes at rest.
    pub(super) places: Vec<Point3<f64>>,
    /// Compliance between the free nodes (3m, 3m) in m/N.
    compliance: Vec<f64>,
}

/// Facets that some shape may touch when the nodes are displaced, or come within `margin` (m).
pub(super) fn reached(
    condensed: &Condensed,
    shapes: &[Shape],
    poses: &[Isometry3<f64>],
    displacement: &[Vector3<f64>],
    margin: f64,
) -> Vec<bool> {
    let near = |facet: &Facet| {
        let moved = || facet.nodes.iter().map(|&node| displacement[node as usize]);
        let mean = moved().sum::<Vector3<f64>>() / facet.nodes.len() as f64;
        let spread = moved().map(|u| (u - mean).norm_squared()).fold(0.0, f64::max).sqrt();
        let (centre, reach) = (facet.centre + mean, facet.radius + facet.gain * spread + margin);
        shapes.iter().zip(poses).any(|(shape, pose)| {
            shape.distance(&pose.inverse_transform_point(&centre)).value < reach
        })
    };
    condensed.facets.iter().map(near).collect()
}

impl Zone {
    pub(super) fn new(condensed: &Condensed, facets: Vec<bool>) -> Self {
        let chosen = condensed.facets.iter().zip(&facets).filter(|(_, chosen)| **chosen);
        let points: Vec<u32> = chosen.clone().flat_map(|(facet, _)| facet.points.clone()).collect();
        let mut nodes: Vec<u32> = chosen.flat_map(|(facet, _)| facet.nodes.clone()).collect();
        nodes.sort_unstable_by_key(|&node| (!condensed.rest.is_free(node), node));
        nodes.dedup();
        let free = nodes.partition_point(|&node| condensed.rest.is_free(node));
        let mut local = vec![INSIDE; condensed.rank.len()];
        for (i, &node) in nodes.iter().enumerate() {
            local[node as usize] = i as u32;
        }
        let renumbered = |&point: &u32| {
            let point = &condensed.rest.surface()[point as usize];
            let shares = point.shares.iter().map(|&(node, s)| (local[node as usize], s)).collect();
            SurfacePoint { shares, ..*point }
        };
        Self {
            surface: points.iter().map(renumbered).collect(),
            places: nodes.iter().map(|&node| condensed.rest.places()[node as usize]).collect(),
            compliance: gathered(condensed, &nodes[..free]),
            facets,
            points,
            nodes,
            free,
        }
    }

    /// Adds the facets that the shapes may touch when the nodes are displaced (V), if they do touch
    /// one that it lacks; whether they do.
    pub(super) fn grow(
        &mut self,
        condensed: &Condensed,
        shapes: &[Shape],
        poses: &[Isometry3<f64>],
        displacement: &[Vector3<f64>],
    ) -> bool {
        let near = reached(condensed, shapes, poses, displacement, 0.0);
        let (rest, surface) = (condensed.rest.places(), condensed.rest.surface());
        let touches = |point: &SurfacePoint| {
            let place = point.place(rest, displacement);
            shapes.iter().zip(poses).any(|(shape, pose)| {
                shape.distance(&pose.inverse_transform_point(&place)).value < 0.0
            })
        };
        let lacking = condensed.facets.iter().zip(near.iter().zip(&self.facets));
        let lacking = lacking.filter(|(_, (near, has))| **near && !**has);
        let mut points = lacking.flat_map(|(facet, _)| facet.points.clone());
        if !points.any(|point| touches(&surface[point as usize])) {
            return false;
        }
        let union = self.facets.iter().zip(near).map(|(has, near)| *has || near).collect();
        *self = Self::new(condensed, union);
        true
    }

    pub(super) fn covers(&self, facets: &[bool]) -> bool {
        self.facets.iter().zip(facets).all(|(has, needed)| *has || !needed)
    }

    /// A field on the mesh's nodes (V), on the nodes of the zone.
    pub(super) fn pick(&self, nodal: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        self.nodes.iter().map(|&node| nodal[node as usize]).collect()
    }

    /// A field on the nodes of the zone, on all `count` of the mesh; zero elsewhere.
    pub(super) fn spread(&self, local: &[Vector3<f64>], count: usize) -> Vec<Vector3<f64>> {
        let mut nodal = vec![Vector3::zeros(); count];
        for (&node, value) in self.nodes.iter().zip(local) {
            nodal[node as usize] = *value;
        }
        nodal
    }

    /// Those of the mesh's `anchors` that lie in the zone.
    pub(super) fn anchors_in(&self, anchors: &[Anchor]) -> Vec<Anchor> {
        let inside = |anchor: &Anchor| {
            let point = self.points.binary_search(&anchor.point).ok()? as u32;
            Some(Anchor { point, ..*anchor })
        };
        anchors.iter().filter_map(inside).collect()
    }

    /// The zone's `anchors` as the mesh's.
    pub(super) fn anchors_out(&self, mut anchors: Vec<Anchor>) -> Vec<Anchor> {
        for anchor in &mut anchors {
            anchor.point = self.points[anchor.point as usize];
        }
        anchors
    }

    /// Those of the mesh's `touches` that lie in the zone.
    pub(super) fn touches_in(&self, touches: &[Touch]) -> Vec<Touch> {
        let inside = |touch: &Touch| {
            let point = self.points.binary_search(&touch.point).ok()? as u32;
            Some(Touch { point, ..*touch })
        };
        touches.iter().filter_map(inside).collect()
    }

    /// The zone's `touches` as the mesh's.
    pub(super) fn touches_out(&self, mut touches: Vec<Touch>) -> Vec<Touch> {
        for touch in &mut touches {
            touch.point = self.points[touch.point as usize];
        }
        touches
    }

    /// Row of the compliance for component `i` of the force on free node `node` (3m).
    fn row(&self, node: usize, i: usize) -> &[f64] {
        let size = 3 * self.free;
        &self.compliance[(3 * node + i) * size..][..size]
    }

    /// The compliance between some free `nodes` (A), by columns (3A, 3A) in m/N; it is symmetric.
    pub(super) fn compliance_between(&self, nodes: &[usize], compliance: &mut Vec<f64>) {
        compliance.clear();
        for &node in nodes {
            for i in 0..3 {
                let row = self.row(node, i).as_chunks::<3>().0;
                nodes.iter().for_each(|&other| compliance.extend(row[other]));
            }
        }
    }

    /// Displacement of the free nodes under `forces` on them (m).
    pub(super) fn respond(&self, forces: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut numbers = vec![0.0; 3 * self.free];
        for (node, force) in forces.iter().enumerate().filter(|(_, f)| **f != Vector3::zeros()) {
            add_rows(&mut numbers, [0, 1, 2].map(|i| self.row(node, i)), force);
        }
        numbers.as_chunks::<3>().0.iter().map(|&u| Vector3::from(u)).collect()
    }
}

/// The compliance between `nodes`.
fn gathered(condensed: &Condensed, nodes: &[u32]) -> Vec<f64> {
    let ranks: Vec<u32> = nodes.iter().map(|&node| condensed.rank[node as usize]).collect();
    let mut compliance = Vec::with_capacity(9 * nodes.len() * nodes.len());
    for &rank in &ranks {
        for i in 0..3 {
            let row = condensed.row(rank, i);
            for &column in &ranks {
                compliance.extend_from_slice(&row[3 * column as usize..][..3]);
            }
        }
    }
    compliance
}
