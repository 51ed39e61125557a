//! The part of an object's surface that a pad can reach, as nodes and edges.

use std::collections::{BTreeSet, HashMap};

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::geometry::Surface;

/// Density of the nodes on an object's surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Density {
    /// Edges of at most 3 mm.
    Coarse,
    /// Edges of at most 1.5 mm: four times as many nodes.
    Dense,
}

impl Density {
    /// Coarse for dense, dense for coarse.
    pub(super) fn other(self) -> Self {
        match self {
            Self::Coarse => Self::Dense,
            Self::Dense => Self::Coarse,
        }
    }

    /// Edges round a circle of the surface that is cut from.
    pub(super) fn segments(self) -> u32 {
        match self {
            Self::Coarse => 48,
            Self::Dense => 96,
        }
    }

    /// Longest edge (m).
    fn spacing(self) -> f64 {
        match self {
            Self::Coarse => 3e-3,
            Self::Dense => 1.5e-3,
        }
    }
}

/// Nodes beyond the pad's sides that are kept (m), and beyond its face.
const BESIDE: f64 = 3e-3;
const AWAY: f64 = 15e-3;

/// Nodes and edges on a part of a surface.
#[derive(Clone, Debug)]
pub(super) struct PaperPatch {
    /// Nodes in the pad's frame (m).
    pub(super) places: Vec<Vector3<f64>>,
    /// Receiver and sender of each directed edge, sorted.
    pub(super) pairs: Vec<(u32, u32)>,
}

impl PaperPatch {
    /// The part of `surface` at `pose` within reach of a pad of the given half-extents, its edges
    /// halved until none is longer than the spacing of `density`.
    pub(super) fn new(
        surface: &Surface,
        pose: &Isometry3<f64>,
        half: [f64; 2],
        density: Density,
    ) -> Self {
        let reach = Vector3::new(half[0] + BESIDE, half[1] + BESIDE, AWAY);
        let mut places: Vec<_> = surface.vertices().iter().map(|p| (pose * p).coords).collect();
        let mut middles = HashMap::new();
        let mut left = surface.triangles().to_vec();
        let mut kept = Vec::new();
        while let Some(triangle) = left.pop() {
            if misses(&triangle.map(|i| places[i as usize]), &reach) {
                continue;
            }
            let sides =
                [0, 1, 2].map(|i| [triangle[i], triangle[(i + 1) % 3], triangle[(i + 2) % 3]]);
            let length = |&[a, b, _]: &[u32; 3]| (places[a as usize] - places[b as usize]).norm();
            let longest = |a: &[u32; 3], b: &[u32; 3]| length(a).total_cmp(&length(b));
            let [a, b, c] = sides.into_iter().max_by(longest).expect("three sides");
            if length(&[a, b, c]) <= density.spacing() {
                kept.push(triangle);
                continue;
            }
            let middle = *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                places.push(0.5 * (places[a as usize] + places[b as usize]));
                (places.len() - 1) as u32
            });
            left.extend([[a, middle, c], [middle, b, c]]);
        }
        Self::of(&places, &kept)
    }

    /// The nodes and edges of `triangles`.
    fn of(places: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Self {
        let used: BTreeSet<u32> = triangles.iter().flatten().copied().collect();
        let number: HashMap<u32, u32> = used.iter().zip(0..).map(|(&i, n)| (i, n)).collect();
        let sides = triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        let both = sides.flat_map(|(a, b)| [(number[&a], number[&b]), (number[&b], number[&a])]);
        let pairs: BTreeSet<_> = both.collect();
        let places = used.iter().map(|&i| places[i as usize]).collect();
        Self { places, pairs: pairs.into_iter().collect() }
    }

    /// Numbers of the at most `most` nodes nearest to `place`, none farther than `radius`, when
    /// they lie at `places`.
    pub(super) fn nearest(
        places: &[Point3<f64>],
        place: &Point3<f64>,
        radius: f64,
        most: usize,
    ) -> Vec<u32> {
        let distances = places.iter().map(|p| (p - place).norm()).zip(0..);
        let mut near: Vec<(f64, u32)> = distances.filter(|(d, _)| *d <= radius).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.iter().take(most).map(|&(_, i)| i).collect()
    }
}

/// Returns whether the bounds of a triangle and those of `reach` are apart.
fn misses(corners: &[Vector3<f64>; 3], reach: &Vector3<f64>) -> bool {
    let [a, b, c] = corners;
    let (low, high) = (a.inf(b).inf(c), a.sup(b).sup(c));
    (0..3).any(|i| low[i] > reach[i] || high[i] < -reach[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;

    #[test]
    fn a_large_flat_side_has_nodes_within_reach() {
        let block = Shape::Cuboid { half_extents: Vector3::repeat(0.025) }.surface(8).unwrap();
        let pose = Isometry3::translation(0.0, 0.0, 0.025);
        let count = |density| {
            let patch = PaperPatch::new(&block, &pose, [7e-3, 9e-3], density);
            for &(a, b) in &patch.pairs {
                let length = (patch.places[a as usize] - patch.places[b as usize]).norm();
                assert!(length <= density.spacing(), "{length} m for {density:?}");
                assert!(patch.pairs.binary_search(&(b, a)).is_ok());
            }
            patch.places.len()
        };
        let [coarse, dense] = [Density::Coarse, Density::Dense].map(count);
        // 20 mm by 24 mm at 3 mm, cut through in diagonals.
        assert!((60..400).contains(&coarse), "{coarse}");
        assert!((3 * coarse..6 * coarse).contains(&dense), "{dense} for {coarse}");
    }
}
