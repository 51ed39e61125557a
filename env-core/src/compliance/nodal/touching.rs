//! Compliance between the nodes that touch, for sweeps over their forces.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use nalgebra::Vector3;

use crate::simd::vectorised;

/// Nodes that touch or have touched, with their displacement under unit forces on each other. Nodes
/// are added as they come to touch, and what is known of the others is kept.
///
/// Shapes: N nodes, R ≥ 3N numbers in a row.
#[derive(Default)]
pub(super) struct TouchingCompliance {
    /// Level whose nodes these are.
    level: usize,
    /// Numbers of the nodes, ascending, each with the node's place in the rows (N).
    places: Vec<(u32, u32)>,
    /// Displacement of the nodes under unit forces on each along each axis (3N, R) in m/N; the rest
    /// of a row, and rows after them, are of nodes that are forgotten.
    rows: Vec<f32>,
    /// R.
    width: usize,
    /// Displacement of the nodes (3N) in m.
    pub(super) moved: Vec<f32>,
    /// Displacement of some nodes under unit forces on one.
    part: Vec<f32>,
}

/// Rows are made for this many nodes more than there are.
const SPARE: usize = 32;

impl TouchingCompliance {
    /// Forgets all nodes.
    pub(super) fn clear(&mut self) {
        self.places.clear();
    }

    /// Forgets all nodes unless they are of this `level`.
    pub(super) fn keep(&mut self, level: usize) {
        if level != self.level {
            self.clear();
            self.level = level;
        }
    }

    /// Adds those of the `nodes`, given by ascending numbers, that are not there yet, and returns the
    /// places of all of `nodes` in the rows. `gather` sets the displacement of some nodes under unit forces
    /// along each axis on one of them (3, 3 × number of nodes).
    pub(super) fn add(
        &mut self,
        nodes: &[u32],
        mut gather: impl FnMut(u32, &[u32], &mut [f32]),
    ) -> Vec<u32> {
        let is_new = |node: &&u32| self.place(**node).is_none();
        let added: Vec<u32> = nodes.iter().filter(is_new).copied().collect();
        if !added.is_empty() {
            let before = self.places.len();
            self.widen(3 * (before + added.len()));
            self.places.extend(added.iter().copied().zip(before as u32..));
            self.places.sort_unstable();
            let all: Vec<u32> = self.places.iter().map(|(node, _)| *node).collect();
            for &(loaded, place) in &self.places {
                let at = if (place as usize) < before { &added } else { &all };
                self.part.clear();
                self.part.resize(9 * at.len(), 0.0);
                gather(loaded, at, &mut self.part);
                let rows = &mut self.rows[3 * place as usize * self.width..][..3 * self.width];
                let parts = self.part.chunks_exact(3 * at.len());
                for (row, part) in rows.chunks_exact_mut(self.width).zip(parts) {
                    let row = row.as_chunks_mut::<3>().0;
                    for (k, block) in part.as_chunks::<3>().0.iter().enumerate() {
                        let to = if (place as usize) < before {
                            before + k
                        } else {
                            self.places[k].1 as usize
                        };
                        row[to] = *block;
                    }
                }
            }
        }
        nodes.iter().map(|&node| self.place(node).expect("all are there")).collect()
    }

    /// Place of a node in the rows, if it is there.
    fn place(&self, node: u32) -> Option<u32> {
        let found = self.places.binary_search_by_key(&node, |place| place.0);
        found.ok().map(|k| self.places[k].1)
    }

    /// Makes room for rows of `size` numbers, as many.
    fn widen(&mut self, size: usize) {
        if size > self.width {
            let width = size + 3 * SPARE;
            let mut rows = vec![0.0; size * width];
            if self.width > 0 {
                let pairs = rows.chunks_exact_mut(width).zip(self.rows.chunks_exact(self.width));
                pairs.for_each(|(to, row)| to[..row.len()].copy_from_slice(row));
            }
            (self.rows, self.width) = (rows, width);
        }
        self.rows.resize(usize::max(self.rows.len(), size * self.width), 0.0);
    }

    /// Displacement of the node at a `place` (m).
    pub(super) fn moved(&self, place: u32) -> Vector3<f64> {
        let moved: [f32; 3] = std::array::from_fn(|i| self.moved[3 * place as usize + i]);
        Vector3::from(moved).cast()
    }

    /// Sets the displacement of the nodes at `places` (m), that of others to zero.
    pub(super) fn set_moved(&mut self, places: &[u32], moved: impl Iterator<Item = Vector3<f64>>) {
        self.moved.clear();
        self.moved.resize(3 * self.places.len(), 0.0);
        for (place, moved) in places.iter().zip(moved) {
            self.moved[3 * *place as usize..][..3].copy_from_slice(moved.cast::<f32>().as_slice());
        }
    }

    /// Adds to the displacement the response to a `force` (N) on the node at a `place`.
    pub(super) fn give_way(&mut self, place: u32, force: &Vector3<f64>) {
        let rows = &self.rows[3 * place as usize * self.width..][..3 * self.width];
        let (x, rest) = rows.split_at(self.width);
        let (y, z) = rest.split_at(self.width);
        let (force, moved): ([f32; 3], _) = (force.cast().into(), &mut self.moved[..]);
        vectorised(
            #[inline(always)]
            || add(moved, [x, y, z], force),
        );
    }
}

#[inline(always)]
fn add(sum: &mut [f32], [x, y, z]: [&[f32]; 3], force: [f32; 3]) {
    let count = sum.len();
    let (x, y, z) = (&x[..count], &y[..count], &z[..count]);
    for i in 0..count {
        sum[i] += force[0] * x[i] + force[1] * y[i] + force[2] * z[i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sets numbers that tell of which nodes and axes they are.
    fn tell(loaded: u32, nodes: &[u32], rows: &mut [f32]) {
        let width = 3 * nodes.len();
        for (place, number) in rows.iter_mut().enumerate() {
            let (axis, node, i) = (place / width, nodes[place % width / 3], place % 3);
            *number = (1000 * loaded + 100 * axis as u32 + 10 * node + i as u32) as f32;
        }
    }

    /// Displacement of the `nodes` under unit forces on each other.
    fn between(touching: &mut TouchingCompliance, nodes: &[u32]) -> Vec<f32> {
        let places = touching.add(nodes, tell);
        let mut found = Vec::new();
        for (from, axis) in places.iter().flat_map(|from| [0, 1, 2].map(|axis| (from, axis))) {
            touching.set_moved(&[], std::iter::empty());
            touching.give_way(*from, &Vector3::ith(axis, 1.0));
            found.extend(places.iter().flat_map(|at| <[f64; 3]>::from(touching.moved(*at))));
        }
        found.into_iter().map(|u| u as f32).collect()
    }

    #[test]
    fn displacement_is_that_gathered_whenever_nodes_are_added() {
        let many: Vec<u32> = (0..60).map(|i| 3 * i).collect();
        let mut touching = TouchingCompliance::default();
        for nodes in [&[1, 4, 6][..], &[1, 4, 6], &[0, 1, 6, 7], &[], &[2, 3], &many, &[3, 4]] {
            let found = between(&mut touching, nodes);
            let mut gathered = vec![0.0; 9 * nodes.len() * nodes.len()];
            for (k, &loaded) in nodes.iter().enumerate() {
                tell(loaded, nodes, &mut gathered[9 * nodes.len() * k..][..9 * nodes.len()]);
            }
            assert_eq!(found, gathered, "{nodes:?}");
        }
        touching.keep(1);
        let mut asked = 0;
        touching.add(&[3], |_, _, _| asked += 1);
        assert_eq!(asked, 1, "another level's nodes are others");
    }

    #[test]
    fn displacement_is_added_up() {
        let mut touching = TouchingCompliance::default();
        let places = touching.add(&[2, 5], tell);
        touching.set_moved(&places, [Vector3::repeat(1.0); 2].into_iter());
        touching.give_way(places[1], &Vector3::new(1.0, 0.0, -1.0));
        // The rows along x and z differ by 200.
        assert_eq!(touching.moved(places[0]), Vector3::repeat(-199.0));
        assert_eq!(touching.moved(places[1]), Vector3::repeat(-199.0));
    }
}
