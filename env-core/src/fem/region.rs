//! The part of the surface on which contact is evaluated in a load step.

use nalgebra::{Isometry3, Point3, Vector3};

use super::system::System;
use crate::{
    contact::{ContactStep, SurfacePoint, Touch},
    geometry::Shape,
};

/// Distance to a shape within which a surface point may come to touch it (m).
pub(super) const NEAR: f64 = 2e-4;
/// Distance to a shape within which surface points belong to a new region (m). It exceeds [`NEAR`],
/// so that the region can be used for several steps.
const WIDE: f64 = 4e-4;
/// Most nodes of a region: its condensed stiffness is a dense matrix.
const MOST_NODES: usize = 500;

/// Surface points that may touch, and the free nodes that they are interpolated from.
pub(super) struct Region {
    /// `true` for every surface point that belongs to the region (C).
    member: Vec<bool>,
    /// Its surface points, ascending.
    pub(super) points: Vec<u32>,
    /// Its nodes, in the order of elimination.
    pub(super) nodes: Vec<u32>,
    /// Nodes of each of its points, as ranks among the region's nodes, with their weights; fixed
    /// nodes are left out.
    pub(super) shares: Vec<Vec<(u32, f64)>>,
}

impl Region {
    /// Returns the region of the points that are `near` (C) enough, in which the nodes of the
    /// nearest points come last; `None` if these are too many nodes.
    fn new(system: &System, near: &[f64]) -> Option<Self> {
        let surface = &system.surface;
        let member: Vec<bool> = near.iter().map(|&distance| distance < WIDE).collect();
        let points: Vec<u32> = (0u32..).zip(&member).filter(|(_, m)| **m).map(|(c, _)| c).collect();
        let mut nearest = vec![f64::INFINITY; system.nodes.places.len()];
        for &c in &points {
            for &(node, _) in &surface[c as usize].shares {
                let nearest = &mut nearest[node as usize];
                *nearest = nearest.min(near[c as usize]);
            }
        }
        let carries = |&node: &u32| {
            nearest[node as usize] < f64::INFINITY && !system.nodes.fixed[node as usize]
        };
        let mut nodes: Vec<u32> = (0..nearest.len() as u32).filter(carries).collect();
        if nodes.len() > MOST_NODES {
            return None;
        }
        nodes.sort_by(|&a, &b| nearest[b as usize].total_cmp(&nearest[a as usize]));
        let mut rank = vec![None; nearest.len()];
        (0..).zip(&nodes).for_each(|(i, &node)| rank[node as usize] = Some(i));
        let ranked = |c: &u32| {
            let shares = surface[*c as usize].shares.iter();
            shares.filter_map(|&(node, share)| Some((rank[node as usize]?, share))).collect()
        };
        let shares = points.iter().map(ranked).collect();
        Some(Self { member, points, nodes, shares })
    }

    /// Returns the region around shapes that move through all of `path`, or else only to its first
    /// poses, with the surface at `places` (C); `None` if even that has too many nodes.
    pub(super) fn along(
        system: &System,
        shapes: &[Shape],
        path: &[Vec<Isometry3<f64>>],
        places: &[Point3<f64>],
    ) -> Option<Self> {
        let near = |path| Self::new(system, &near(shapes, path, places, WIDE));
        near(path).or_else(|| near(&path[..1]))
    }

    /// Returns whether no point outside the region comes near the shapes at `poses`, with the
    /// surface at `places` (C).
    pub(super) fn suits(
        &self,
        contact: &mut ContactStep,
        poses: &[Isometry3<f64>],
        places: &[Point3<f64>],
    ) -> bool {
        let mut outside = contact.near(poses, NEAR);
        outside.retain(|&c| !self.member[c as usize]);
        let places: Vec<_> = outside.iter().map(|&c| places[c as usize]).collect();
        !contact.within(NEAR, &outside, poses, &places).contains(&true)
    }

    /// First unknown of each node that surface point `point` is interpolated from, counted among
    /// the `last` unknowns of the region, and its weight; `None` if the point also depends on other
    /// nodes of the region.
    pub(super) fn carriers_among_last(
        &self,
        last: usize,
        point: u32,
    ) -> Option<impl Iterator<Item = (usize, f64)> + Clone> {
        let left_out = self.nodes.len() - last / 3;
        let shares = &self.shares[self.points.binary_search(&point).ok()?];
        let held = shares.iter().all(|&(rank, _)| rank as usize >= left_out);
        let place = move |&(rank, share): &(u32, f64)| (3 * (rank as usize - left_out), share);
        held.then(|| shares.iter().map(place))
    }

    /// Returns whether all `touches` are at points of the region.
    pub(super) fn holds(&self, touches: &[Touch]) -> bool {
        touches.iter().all(|touch| self.member[touch.point as usize])
    }

    /// Number of the region's last nodes that include all nodes of the points chosen by `is_near`.
    pub(super) fn carriers(&self, is_near: &[bool]) -> usize {
        let near = self.shares.iter().zip(is_near).filter(|(_, near)| **near);
        let first = near.flat_map(|(shares, _)| shares).map(|&(rank, _)| rank as usize).min();
        self.nodes.len() - first.unwrap_or(self.nodes.len())
    }

    /// Positions of the region's points when the nodes are displaced.
    pub(super) fn places(
        &self,
        system: &System,
        displacement: &[Vector3<f64>],
    ) -> Vec<Point3<f64>> {
        let point = |c: &u32| -> &SurfacePoint { &system.surface[*c as usize] };
        let place = |c| point(c).place(&system.nodes.places, displacement);
        self.points.iter().map(place).collect()
    }
}

/// Smallest distance of a shape to each of `places` (C) on its `path` (m), where that is less than
/// `margin`. A distance changes no faster than the point moves, which saves most of the
/// measurements.
fn near(
    shapes: &[Shape],
    path: &[Vec<Isometry3<f64>>],
    places: &[Point3<f64>],
    margin: f64,
) -> Vec<f64> {
    let nearest = |place: &Point3<f64>| {
        let mut nearest = f64::INFINITY;
        for (s, shape) in shapes.iter().enumerate() {
            let mut seen = (Point3::origin(), margin);
            for poses in path {
                let local = poses[s].inverse_transform_point(place);
                if (local - seen.0).norm() >= seen.1 - margin {
                    seen = (local, shape.distance(&local).value);
                    nearest = f64::min(nearest, seen.1);
                }
            }
        }
        nearest
    };
    places.iter().map(nearest).collect()
}
