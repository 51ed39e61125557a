//! Linear system of a Newton step: (1 + H C) δf = residual force, the contact force minus f.
//!
//! GMRES multiplies by C between the nodes that touch and by H = −∂t/∂u at the touching points. It
//! is preconditioned by the factors of an earlier system, recomputed only when GMRES no longer
//! converges with them: the touches change little from one step to the next.
//!
//! Shapes: m free nodes of a [`Zone`], A of them active.

use nalgebra::Vector3;

use super::{
    condensed::{Condensed, add_rows},
    preconditioner::{Preconditioner, Touching},
    zone::Zone,
};
use crate::fem::{GmresSolution, gmres};

/// Rank of a node that is not active.
const INACTIVE: u32 = u32::MAX;

/// Linear systems of one zone.
#[derive(Default)]
pub(super) struct Newton {
    /// Rank of each free node among the active, or [`INACTIVE`] (m).
    rank: Vec<u32>,
    /// Nodes on which a force has acted (A).
    active: Vec<u32>,
    /// Three rows of the compliance for each active node (3A, 3m) in m/N.
    rows: Vec<f64>,
    /// Compliance between the active nodes (3A, 3A) in m/N.
    between: Vec<f64>,
    preconditioner: Preconditioner,
}

impl Newton {
    /// Discards all data and prepares for a zone with `free` free nodes.
    pub(super) fn enter(&mut self, free: usize) {
        self.rank.clear();
        self.rank.resize(free, INACTIVE);
        self.active.clear();
        self.rows.clear();
        self.between.clear();
        self.preconditioner.clear();
    }

    /// Displacement of the free nodes under `forces` on them (m).
    pub(super) fn respond(
        &mut self,
        condensed: &Condensed,
        zone: &Zone,
        forces: &[Vector3<f64>],
    ) -> Vec<Vector3<f64>> {
        let acts = |&node: &usize| forces[node] != Vector3::zeros();
        self.activate(condensed, zone, (0..zone.free).filter(acts));
        let mut moved = vec![0.0; 3 * zone.free];
        for (&node, rows) in self.active.iter().zip(self.rows.chunks(9 * zone.free.max(1))) {
            let force = forces[node as usize];
            if force != Vector3::zeros() {
                add_rows(&mut moved, rows, &force.into());
            }
        }
        moved.as_chunks::<3>().0.iter().map(|&u| Vector3::from(u)).collect()
    }

    /// Solves for δf with the residual force `excess` (m) in N; `None` if the result is not finite.
    pub(super) fn solve(
        &mut self,
        condensed: &Condensed,
        zone: &Zone,
        touching: &[Touching],
        excess: &[Vector3<f64>],
    ) -> Option<Vec<Vector3<f64>>> {
        if touching.is_empty() {
            return Some(excess.to_vec());
        }
        let carriers = touching.iter().flat_map(|(point, _)| &point.shares);
        let carriers = carriers.map(|&(node, _)| node as usize).filter(|&node| node < zone.free);
        let acts = |&node: &usize| excess[node] != Vector3::zeros();
        self.activate(condensed, zone, (0..zone.free).filter(acts).chain(carriers));
        self.gather_between();
        let right: Vec<f64> =
            self.active.iter().flat_map(|&node| <[f64; 3]>::from(excess[node as usize])).collect();
        let stiffness = ContactStiffness::new(touching, &self.rank);
        let mut found = self.iterate(&stiffness, &right);
        if !found.as_ref().is_some_and(|found| found.converged) {
            self.preconditioner.factorise(&self.rank, &self.between, touching);
            found = self.iterate(&stiffness, &right);
        }
        let x = found?.x;
        let mut forces = vec![Vector3::zeros(); zone.free];
        for (&node, &force) in self.active.iter().zip(x.as_chunks::<3>().0) {
            forces[node as usize] = Vector3::from(force);
        }
        x.iter().all(|x| x.is_finite()).then_some(forces)
    }

    /// Approximate solution (3A) with the present preconditioner; `None` if there is none.
    fn iterate(&self, stiffness: &ContactStiffness, right: &[f64]) -> Option<GmresSolution> {
        if self.preconditioner.is_empty() {
            return None;
        }
        let mut moved = vec![0.0; right.len()];
        let product = |z: &[f64]| {
            let mut x = z.to_vec();
            self.preconditioner.apply(&mut x);
            moved.fill(0.0);
            let rows = self.between.chunks(3 * x.len());
            for (force, rows) in x.as_chunks::<3>().0.iter().zip(rows) {
                add_rows(&mut moved, rows, force);
            }
            stiffness.add_relief(&moved, &mut x);
            x
        };
        let mut found = gmres(product, right);
        self.preconditioner.apply(&mut found.x);
        Some(found)
    }

    /// Gathers the compliance between the active nodes, if nodes became active since the last call.
    fn gather_between(&mut self) {
        let size = 3 * self.active.len();
        if self.between.len() == size * size {
            return;
        }
        self.between.clear();
        for row in self.rows.chunks(3 * self.rank.len()) {
            let row = row.as_chunks::<3>().0;
            self.between.extend(self.active.iter().flat_map(|&node| row[node as usize]));
        }
    }

    /// Marks `nodes` as active and gathers the rows of those that were not.
    fn activate(&mut self, condensed: &Condensed, zone: &Zone, nodes: impl Iterator<Item = usize>) {
        for node in nodes {
            if self.rank[node] != INACTIVE {
                continue;
            }
            self.rank[node] = self.active.len() as u32;
            self.active.push(node as u32);
            let rows = condensed.rows(zone.ranks[node]);
            for row in rows.chunks(rows.len() / 3) {
                let row = row.as_chunks::<3>().0;
                self.rows.extend(zone.ranks.iter().flat_map(|&rank| row[rank as usize]));
            }
        }
    }
}

/// Stiffness of all touching points.
struct ContactStiffness<'a> {
    touching: &'a [Touching<'a>],
    /// Ranks and weights of the free nodes that each point is interpolated from, point after point.
    shares: Vec<(u32, f64)>,
    /// Number of these nodes for each point.
    counts: Vec<usize>,
}

impl<'a> ContactStiffness<'a> {
    /// Returns the stiffness of the `touching` points; `rank` (m) is the rank of each free node
    /// among the active.
    fn new(touching: &'a [Touching<'a>], rank: &[u32]) -> Self {
        let (mut shares, mut counts) = (Vec::new(), Vec::new());
        for (point, _) in touching {
            let free = point.shares.iter();
            let free = free.filter_map(|&(node, share)| Some((*rank.get(node as usize)?, share)));
            let before = shares.len();
            shares.extend(free);
            counts.push(shares.len() - before);
        }
        Self { touching, shares, counts }
    }

    /// Adds H × `moved` to `forces` (3A).
    fn add_relief(&self, moved: &[f64], forces: &mut [f64]) {
        let (moved, forces) = (moved.as_chunks::<3>().0, forces.as_chunks_mut::<3>().0);
        let mut rest = &self.shares[..];
        for ((_, stiffness), &count) in self.touching.iter().zip(&self.counts) {
            let (shares, others) = rest.split_at(count);
            rest = others;
            let mut here = Vector3::zeros();
            for &(rank, share) in shares {
                here += Vector3::from(moved[rank as usize]) * share;
            }
            let relief = stiffness * here;
            for &(rank, share) in shares {
                let force = &mut forces[rank as usize];
                (0..3).for_each(|i| force[i] += relief[i] * share);
            }
        }
    }
}
