//! Part of the surface that one load step can touch, with its part of the compliance.

use nalgebra::{Isometry3, Point3, Vector3};

use super::condensed::{Condensed, INSIDE};
use crate::{
    contact::{SurfacePoint, Touch},
    deformation::Anchor,
    geometry::Shape,
};

/// Facets near the shapes. Nodes and points are renumbered: m free nodes, then fixed ones.
pub(super) struct Zone {
    /// `true` for the facets that belong to the zone.
    facets: Vec<bool>,
    /// Index of each point among all surface points, ascending.
    points: Vec<u32>,
    /// The points, interpolated from nodes of the zone.
    pub(super) surface: Vec<SurfacePoint>,
    /// Index of each node in the mesh.
    pub(super) nodes: Vec<u32>,
    /// Number of free nodes, m.
    pub(super) free: usize,
    /// Positions of the nodes at rest.
    pub(super) places: Vec<Point3<f64>>,
    /// Ranks of the free nodes among the skin nodes (m).
    pub(super) ranks: Vec<u32>,
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
            let point = &condensed.surface[point as usize];
            let shares = point.shares.iter().map(|&(node, s)| (local[node as usize], s)).collect();
            SurfacePoint { shares, ..*point }
        };
        Self {
            surface: points.iter().map(renumbered).collect(),
            places: nodes.iter().map(|&node| condensed.rest.places()[node as usize]).collect(),
            ranks: nodes[..free].iter().map(|&node| condensed.rank[node as usize]).collect(),
            facets,
            points,
            nodes,
            free,
        }
    }

    /// Facets of the zone and those `near` the shapes, if one of the latter is touched but not in
    /// the zone when the nodes are displaced (V); else `None`.
    pub(super) fn grown(
        &self,
        condensed: &Condensed,
        shapes: &[Shape],
        poses: &[Isometry3<f64>],
        displacement: &[Vector3<f64>],
        near: &[bool],
    ) -> Option<Vec<bool>> {
        let (rest, surface) = (condensed.rest.places(), &condensed.surface);
        let touches = |point: &SurfacePoint| {
            let place = point.place(rest, displacement);
            shapes.iter().zip(poses).any(|(shape, pose)| {
                shape.distance(&pose.inverse_transform_point(&place)).value < 0.0
            })
        };
        let lacking = condensed.facets.iter().zip(near.iter().zip(&self.facets));
        let lacking = lacking.filter(|(_, (near, has))| **near && !**has);
        let mut points = lacking.flat_map(|(facet, _)| facet.points.clone());
        let grows = points.any(|point| touches(&surface[point as usize]));
        let union = || self.facets.iter().zip(near).map(|(has, near)| *has || *near).collect();
        grows.then(union)
    }

    pub(super) fn covers(&self, facets: &[bool]) -> bool {
        self.facets.iter().zip(facets).all(|(has, needed)| *has || !needed)
    }

    /// Restricts a field on the mesh's nodes (V) to the nodes of the zone.
    pub(super) fn pick(&self, nodal: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        self.nodes.iter().map(|&node| nodal[node as usize]).collect()
    }

    /// Extends a field on the nodes of the zone to all `count` nodes of the mesh, with zero
    /// elsewhere.
    pub(super) fn spread(&self, local: &[Vector3<f64>], count: usize) -> Vec<Vector3<f64>> {
        let mut nodal = vec![Vector3::zeros(); count];
        for (&node, value) in self.nodes.iter().zip(local) {
            nodal[node as usize] = *value;
        }
        nodal
    }

    /// The `anchors` of the body that lie in the zone, numbered by its points.
    pub(super) fn anchors_in(&self, anchors: &[Anchor]) -> Vec<Anchor> {
        let inside = |anchor: &Anchor| {
            let point = self.points.binary_search(&anchor.point).ok()? as u32;
            Some(Anchor { point, ..*anchor })
        };
        anchors.iter().filter_map(inside).collect()
    }

    /// The zone's `anchors`, numbered by the surface points of the whole body.
    pub(super) fn anchors_out(&self, mut anchors: Vec<Anchor>) -> Vec<Anchor> {
        for anchor in &mut anchors {
            anchor.point = self.points[anchor.point as usize];
        }
        anchors
    }

    /// The `touches` of the body that lie in the zone, numbered by its points.
    pub(super) fn touches_in(&self, touches: &[Touch]) -> Vec<Touch> {
        let inside = |touch: &Touch| {
            let point = self.points.binary_search(&touch.point).ok()? as u32;
            Some(Touch { point, ..*touch })
        };
        touches.iter().filter_map(inside).collect()
    }

    /// The zone's `touches`, numbered by the surface points of the whole body.
    pub(super) fn touches_out(&self, mut touches: Vec<Touch>) -> Vec<Touch> {
        for touch in &mut touches {
            touch.point = self.points[touch.point as usize];
        }
        touches
    }
}
