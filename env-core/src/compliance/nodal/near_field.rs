//! Stress of the model mesh near the contact.
//!
//! Where the contact is small beside the mesh, the displacement interpolated between the nodes
//! misses most of the stress. Near the contact the displacement is therefore split into that of a
//! half-space under the forces on cells, whose strain is known in closed form, and the rest, which
//! is smooth and interpolated. The force on a cell acts at a point above its centre, so that it
//! bears on the face as a smooth pressure about as wide as the cell.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use super::half_space::{HalfSpace, Lanes, PointForce};
use crate::{
    deformation::Moduli,
    geometry::{PadMesh, sample_shares},
    simd::{LANES, vectorised},
};

/// Distance in plan from a cell up to which stress is computed so, in spacings of the nodes.
const REACH: f32 = 3.5;
/// Distances from the nearest cell, in spacings, up to which the stress of a tetrahedron is the
/// mean of the most samples, and of [`FEW`]; farther away it is that of its centre.
const CLOSE: [f32; 2] = [0.9, 2.0];
/// Distance in plan from the middle of a column, in spacings, up to which forces are taken one by
/// one, and side of the squares in which farther ones are merged.
const BESIDE: f32 = 1.7;
const MERGED: f32 = 0.25;
/// Samples along an edge of a tetrahedron, as those of [`sample_shares`].
const FEW: usize = 2;
const MOST: usize = 5;
/// Samples that are written together: those of a tetrahedron with [`FEW`] along an edge.
const TOGETHER: usize = 4;
/// Height over a cell, in its sides, at which the force on it acts, for cells narrow and wide
/// against the spacing of the nodes. The latter displaces the centre of the cell about as an even
/// pressure.
pub(super) const LIFT: [f64; 2] = [0.3, 0.6];

/// Tetrahedra of the model mesh in columns of grid cells.
pub(super) struct NearField {
    moduli: Moduli,
    /// Samples of a tetrahedron, by their number along an edge.
    rules: Vec<SampleRule>,
    columns: Vec<Column>,
}

/// Grid cells of the model mesh over each other.
struct Column {
    /// Centre in plan (m).
    centre: [f32; 2],
    /// Root of its area in plan (m).
    spacing: f32,
    /// Corners of its tetrahedra.
    nodes: Vec<u32>,
    /// Places of the corners in plan and in depth below the face (m).
    places: Vec<[f32; 3]>,
    /// These places, with the depths at which the elastic layer is displaced as the mesh is.
    in_layer: Points,
    tets: Vec<ColumnTet>,
    /// Centres of the tetrahedra.
    centres: Points,
}

struct ColumnTet {
    tet: u32,
    /// Corners among those of the column.
    corners: [usize; 4],
    /// Gradients of the shape functions of the last three corners, by corner (1/m).
    slopes: [[f32; 3]; 3],
}

/// Samples of a tetrahedron.
struct SampleRule {
    count: usize,
    /// Shares of the corners, by corner; the last samples may be repeated.
    shares: Vec<[[f32; TOGETHER]; 4]>,
}

/// Samples of the tetrahedra of a column, one after another.
struct ColumnSamples {
    /// Places in plan and in depth (m).
    places: [Vec<f32>; 3],
    /// Strain of the interpolated displacement: xx, yy, zz, xy, xz and yz.
    smooth: [Vec<f32>; 6],
    /// Number of each tetrahedron's.
    counts: Vec<usize>,
    /// Number of all.
    count: usize,
}

/// Forces, and their places in blocks.
struct PointForces {
    forces: Vec<PointForce>,
    places: Vec<[Lanes; 2]>,
}

/// Points in the plan and in depth (m), in blocks.
#[derive(Default)]
struct Points {
    count: usize,
    blocks: Vec<[Lanes; 3]>,
}

impl NearField {
    /// Prepares the tetrahedra of `model`, whose layers are displaced as the elastic layer at the
    /// `depths` (m).
    pub(super) fn new(model: &PadMesh, depths: &[f64], moduli: Moduli) -> Self {
        let (mesh, count) = (&model.mesh, model.face.len());
        let [nx, ny, nz] = model.cells.map(|cells| cells as usize);
        let column = |first: usize| {
            let nodes = (0..=nz)
                .flat_map(|layer| [0, 1, nx + 1, nx + 2].map(|away| layer * count + first + away));
            let nodes: Vec<_> = nodes.collect();
            let place = |&node: &usize| {
                let (place, face) = (mesh.vertices[node], mesh.vertices[node % count]);
                [place.x, place.y, face.z - place.z].map(|x| x as f32)
            };
            let places: Vec<_> = nodes.iter().map(place).collect();
            let in_layer = nodes.iter().zip(&places);
            let in_layer = in_layer.map(|(node, [x, y, _])| [*x, *y, depths[node / count] as f32]);
            let of = |layer: usize| {
                let cell = (layer * ny + first / (nx + 1)) * nx + first % (nx + 1);
                6 * cell..6 * cell + 6
            };
            let tet = |tet: usize| {
                let [a, b, c, d] = mesh.corners(tet);
                let edges = Matrix3::from_columns(&[b - a, c - a, d - a]);
                let corner = |node: u32| nodes.iter().position(|own| *own == node as usize);
                let slopes = edges.try_inverse().expect("soft bodies have no flat tetrahedra");
                ColumnTet {
                    tet: tet as u32,
                    corners: mesh.tets[tet].map(|node| corner(node).expect("a grid of columns")),
                    slopes: slopes.transpose().cast().into(),
                }
            };
            let [low, high] = [first, first + nx + 2].map(|node| mesh.vertices[node]);
            let (middle, sides) = (nalgebra::center(&low, &high), high - low);
            let tets: Vec<_> = (0..nz).flat_map(of).map(tet).collect();
            Column {
                centre: [middle.x as f32, middle.y as f32],
                spacing: (sides.x * sides.y).sqrt() as f32,
                in_layer: Points::new(in_layer),
                centres: Points::new(tets.iter().map(|tet| tet.centre(&places))),
                nodes: nodes.into_iter().map(|node| node as u32).collect(),
                places,
                tets,
            }
        };
        let first = |j: usize| (0..nx).map(move |i| j * (nx + 1) + i);
        let columns = (0..ny).flat_map(first).map(column).collect();
        let rules = (0..=MOST).map(SampleRule::new).collect();
        Self { moduli, rules, columns }
    }

    /// Von Mises stress (T) in Pa of tetrahedra near `forces`, each spread over a cell with `side`
    /// (m), under which the nodes have the `displacement` (V) in m; `None` of those farther away.
    pub(super) fn von_mises(
        &self,
        forces: &[PointForce],
        side: f64,
        displacement: &[Vector3<f64>],
    ) -> Vec<Option<f64>> {
        let tets = self.columns.iter().map(|column| column.tets.len());
        let mut all = vec![None; tets.clone().sum()];
        let m = (1.0 - 2.0 * self.moduli.poisson) as f32;
        let scale = self.scale() as f32;
        let spacings = self.columns.iter().map(|column| column.spacing);
        let square = MERGED * spacings.fold(f32::INFINITY, f32::min);
        // Wide cells have squares of their own.
        let is_wide = side > f64::from(square);
        let merged = if is_wide { forces.to_vec() } else { merged(forces, square) };
        let (forces, merged) = (PointForces::new(forces.to_vec()), PointForces::new(merged));
        let (low, high) = forces.corners();
        let (mut near, mut squares) = (Vec::new(), Vec::new());
        let (mut samples, mut norms) = (self.samples(tets.max().unwrap_or(0)), Vec::new());
        for column in &self.columns {
            let reach = REACH * column.spacing;
            let is_far =
                |i: usize| column.centre[i] < low[i] - reach || column.centre[i] > high[i] + reach;
            if is_far(0) || is_far(1) {
                continue;
            }
            near.clear();
            let nearest = forces.distances_squared(column.centre, &mut squares);
            if nearest < (BESIDE * column.spacing).powi(2) {
                forces.within(reach, &squares, &mut near);
            } else {
                merged.distances_squared(column.centre, &mut squares);
                merged.within(reach, &squares, &mut near);
            }
            if near.is_empty() {
                continue;
            }
            let along = (f64::from(column.spacing) / side).clamp(FEW as f64, MOST as f64) as usize;
            let lift = side * LIFT[usize::from(along <= FEW)];
            let space = HalfSpace { m, lift: lift as f32 };
            let rest = self.rest(column, &near, space, displacement);
            self.sample(column, &near, along, &rest, &mut samples);
            samples.deviator_norms(space, &near, scale, &mut norms);
            let mut remaining = norms.as_flattened();
            for (tet, count) in column.tets.iter().zip(&samples.counts) {
                let (norms, others) = remaining.split_at(*count);
                let mean = norms.iter().sum::<f32>() / *count as f32;
                let stress = 6.0_f64.sqrt() * self.moduli.shear() * f64::from(mean);
                all[tet.tet as usize] = Some(stress);
                remaining = others;
            }
        }
        all
    }

    /// Room for the most samples of a column of that many `tets`.
    fn samples(&self, tets: usize) -> ColumnSamples {
        let room = (tets * self.rules[MOST].count + TOGETHER).next_multiple_of(LANES);
        let [places, smooth] = [3, 6].map(|parts| vec![vec![0.0; room]; parts]);
        ColumnSamples {
            places: places.try_into().expect("three axes"),
            smooth: smooth.try_into().expect("six parts"),
            counts: Vec::new(),
            count: 0,
        }
    }

    /// Writes the samples of the tetrahedra of a column under the `rest` of the displacement of its
    /// corners (m): those close to the forces have `along` along an edge.
    fn sample(
        &self,
        column: &Column,
        forces: &[PointForce],
        along: usize,
        rest: &[[f32; 4]],
        samples: &mut ColumnSamples,
    ) {
        let [close, middle] = CLOSE.map(|spacings| (spacings * column.spacing).powi(2));
        let mut distances = vec![[0.0; LANES]; column.centres.blocks.len()];
        vectorised(
            #[inline(always)]
            || {
                for (at, distances) in column.centres.blocks.iter().zip(&mut distances) {
                    *distances = distance_squared(at, forces);
                }
            },
        );
        samples.counts.clear();
        samples.count = 0;
        vectorised(
            #[inline(always)]
            || {
                for (tet, distance) in column.tets.iter().zip(distances.as_flattened()) {
                    let rule = match *distance {
                        nearest if nearest < close => along,
                        nearest if nearest < middle => FEW,
                        _ => 1,
                    };
                    let corners = tet.corners.map(|corner| column.places[corner]);
                    samples.add(&self.rules[rule], &corners, &tet.strain(rest));
                }
            },
        );
    }

    /// Displacement (m) of the corners of a column less that of the half-space under the `forces`:
    /// three numbers and one that is not used.
    fn rest(
        &self,
        column: &Column,
        forces: &[PointForce],
        space: HalfSpace,
        displacement: &[Vector3<f64>],
    ) -> Vec<[f32; 4]> {
        let mut moved = vec![[[0.0; LANES]; 3]; column.in_layer.blocks.len()];
        vectorised(
            #[inline(always)]
            || {
                for (at, moved) in column.in_layer.blocks.iter().zip(&mut moved) {
                    *moved = space.displacement(at, forces);
                }
            },
        );
        let scale = self.scale();
        let rest = |(i, node): (usize, &u32)| {
            let u = [0, 1, 2].map(|axis| f64::from(moved[i / LANES][axis][i % LANES]));
            let rest = displacement[*node as usize] - Vector3::from(u) * scale;
            [rest.x as f32, rest.y as f32, rest.z as f32, 0.0]
        };
        column.nodes.iter().enumerate().map(rest).collect()
    }

    /// 1/(4πμ) (m²/N).
    fn scale(&self) -> f64 {
        1.0 / (4.0 * std::f64::consts::PI * self.moduli.shear())
    }
}

impl ColumnTet {
    /// Centre, given the `places` of the corners of the column.
    fn centre(&self, places: &[[f32; 3]]) -> [f32; 3] {
        let corners = self.corners.map(|corner| places[corner]);
        std::array::from_fn(|i| 0.25 * corners.iter().map(|corner| corner[i]).sum::<f32>())
    }

    /// Strain under the `displacement` (m) of the corners of its column: xx, yy, zz, xy, xz and yz.
    #[inline(always)]
    fn strain(&self, displacement: &[[f32; 4]]) -> [f32; 6] {
        let [a, b, c, d] = self.corners.map(|corner| displacement[corner]);
        let mut gradient = [[0.0; 4]; 3];
        for (end, slopes) in [b, c, d].into_iter().zip(&self.slopes) {
            for (by_axis, slope) in gradient.iter_mut().zip(slopes) {
                (0..4).for_each(|i| by_axis[i] += (end[i] - a[i]) * slope);
            }
        }
        let [x, y, z] = gradient;
        let [xy, xz, yz] = [x[1] + y[0], x[2] + z[0], y[2] + z[1]].map(|twice| 0.5 * twice);
        [x[0], y[1], z[2], xy, xz, yz]
    }
}

impl SampleRule {
    /// Returns the rule with that many samples `along` an edge.
    fn new(along: usize) -> Self {
        let shares = sample_shares(along as u32);
        let together = |shares: &[[f64; 4]]| {
            let of = |corner: usize, i: usize| shares[i.min(shares.len() - 1)][corner] as f32;
            std::array::from_fn(|corner| std::array::from_fn(|i| of(corner, i)))
        };
        Self { count: shares.len(), shares: shares.chunks(TOGETHER).map(together).collect() }
    }
}

impl ColumnSamples {
    /// Adds the samples of a tetrahedron with these `corners` and the `smooth` strain.
    #[inline(always)]
    fn add(&mut self, rule: &SampleRule, corners: &[[f32; 3]; 4], smooth: &[f32; 6]) {
        // Those beyond its number are overwritten by the next tetrahedron's.
        for (first, shares) in (self.count..).step_by(TOGETHER).zip(&rule.shares) {
            let room = first..first + TOGETHER;
            for (axis, places) in self.places.iter_mut().enumerate() {
                let mut sum = [0.0; TOGETHER];
                for (corner, shares) in corners.iter().zip(shares) {
                    (0..TOGETHER).for_each(|i| sum[i] += shares[i] * corner[axis]);
                }
                places[room.clone()].copy_from_slice(&sum);
            }
            for (all, part) in self.smooth.iter_mut().zip(smooth) {
                all[room.clone()].copy_from_slice(&[*part; TOGETHER]);
            }
        }
        self.counts.push(rule.count);
        self.count += rule.count;
    }

    /// Writes to `norms` the norm of the deviator of each sample's strain: that of `space` under
    /// `forces` times `scale` plus the smooth one.
    fn deviator_norms(
        &self,
        space: HalfSpace,
        forces: &[PointForce],
        scale: f32,
        norms: &mut Vec<Lanes>,
    ) {
        norms.resize(self.count.div_ceil(LANES), [0.0; LANES]);
        let places = self.places.each_ref().map(|all| all.as_chunks().0);
        let smooth = self.smooth.each_ref().map(|all| all.as_chunks().0);
        vectorised(
            #[inline(always)]
            || {
                for (block, norms) in norms.iter_mut().enumerate() {
                    let strain = space.strain(&places.map(|all| all[block]), forces);
                    *norms = deviator_norm(&strain, scale, &smooth.map(|all| all[block]));
                }
            },
        );
    }
}

impl PointForces {
    fn new(forces: Vec<PointForce>) -> Self {
        // Lanes without a force of their own are infinitely far away.
        let mut places = vec![[[f32::INFINITY; LANES]; 2]; forces.len().div_ceil(LANES)];
        for (i, force) in forces.iter().enumerate() {
            (0..2).for_each(|axis| places[i / LANES][axis][i % LANES] = force.place[axis]);
        }
        Self { forces, places }
    }

    /// Writes the squared distances (m²) in plan of the forces from a `centre`, and returns the
    /// least.
    fn distances_squared(&self, centre: [f32; 2], squares: &mut Vec<Lanes>) -> f32 {
        squares.resize(self.places.len(), [0.0; LANES]);
        let mut least = [f32::INFINITY; LANES];
        vectorised(
            #[inline(always)]
            || {
                for ([x, y], squares) in self.places.iter().zip(squares.iter_mut()) {
                    for i in 0..LANES {
                        let (x, y) = (x[i] - centre[0], y[i] - centre[1]);
                        squares[i] = x * x + y * y;
                        least[i] = least[i].min(squares[i]);
                    }
                }
            },
        );
        least.into_iter().fold(f32::INFINITY, f32::min)
    }

    /// Adds to `near` the forces whose squared distances are less than that of `reach` (m).
    fn within(&self, reach: f32, squares: &[Lanes], near: &mut Vec<PointForce>) {
        let all = self.forces.iter().zip(squares.as_flattened());
        near.extend(all.filter(|(_, square)| **square < reach * reach).map(|(force, _)| *force));
    }

    /// Least and greatest coordinates of their places (m).
    fn corners(&self) -> ([f32; 2], [f32; 2]) {
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for PointForce { place, .. } in &self.forces {
            for i in 0..2 {
                (low[i], high[i]) = (low[i].min(place[i]), high[i].max(place[i]));
            }
        }
        (low, high)
    }
}

impl Points {
    fn new(points: impl Iterator<Item = [f32; 3]>) -> Self {
        let mut all = Self::default();
        points.for_each(|point| all.push(point));
        all
    }

    fn push(&mut self, point: [f32; 3]) {
        let lane = self.count % LANES;
        if lane == 0 {
            // Lanes without a point of their own hold the first.
            self.blocks.push(point.map(|x| [x; LANES]));
        }
        let last = self.blocks.last_mut().expect("a block was added");
        (0..3).for_each(|axis| last[axis][lane] = point[axis]);
        self.count += 1;
    }
}

/// Norm of the deviator of `strain` times `scale` plus `smooth`, of the parts xx, yy, zz, xy, xz
/// and yz.
#[inline(always)]
fn deviator_norm(strain: &[Lanes; 6], scale: f32, smooth: &[Lanes; 6]) -> Lanes {
    let mut norms = [0.0; LANES];
    for i in 0..LANES {
        let part = |part: usize| smooth[part][i] + scale * strain[part][i];
        let mean = (part(0) + part(1) + part(2)) / 3.0;
        let [x, y, z] = [part(0) - mean, part(1) - mean, part(2) - mean];
        let [xy, xz, yz] = [part(3), part(4), part(5)];
        norms[i] = (x * x + y * y + z * z + 2.0 * (xy * xy + xz * xz + yz * yz)).sqrt();
    }
    norms
}

/// Resultants of the `forces` in squares of a `side` (m), at their centres.
fn merged(forces: &[PointForce], side: f32) -> Vec<PointForce> {
    let mut squares = BTreeMap::<[i32; 2], (f32, PointForce)>::new();
    for PointForce { place, force } in forces {
        let size = Vector3::from(*force).norm();
        let none = (0.0, PointForce { place: [0.0; 2], force: [0.0; 3] });
        let (sum, square) = squares.entry(place.map(|x| (x / side).floor() as i32)).or_insert(none);
        *sum += size;
        (0..2).for_each(|i| square.place[i] += size * place[i]);
        (0..3).for_each(|i| square.force[i] += force[i]);
    }
    let loaded = squares.into_values().filter(|(sum, _)| *sum > 0.0);
    loaded
        .map(|(sum, square)| PointForce { place: square.place.map(|x| x / sum), ..square })
        .collect()
}

/// Squared distances (m²) of the points `at` from the nearest of the `forces`.
#[inline(always)]
fn distance_squared(at: &[Lanes; 3], forces: &[PointForce]) -> Lanes {
    let mut least = [f32::INFINITY; LANES];
    for PointForce { place: [x, y], .. } in forces {
        for i in 0..LANES {
            let (x, y, d) = (at[0][i] - x, at[1][i] - y, at[2][i]);
            least[i] = least[i].min(x * x + y * y + d * d);
        }
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::Sensor;

    #[test]
    fn stress_is_that_of_the_samples_one_by_one() {
        let pad = Sensor::named("gelsight-mini").unwrap().pad(1000).unwrap();
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let layers = pad.cells[2] as usize;
        let depths: Vec<_> = (0..=layers).map(|k| 4e-3 * k as f64 / layers as f64).collect();
        let near_field = NearField::new(&pad, &depths, moduli);
        let wave = |p: &nalgebra::Point3<f64>| (p.coords.yzx() * 300.0).map(f64::sin) * 5e-5;
        let displacement: Vec<_> = pad.mesh.vertices.iter().map(wave).collect();
        // Cells as wide as columns, which are taken one by one, and small ones, merged far away.
        for side in [1.3e-3, 2e-4] {
            let cell = |i: i32| {
                let place = [i % 5, i / 5].map(|k| ((f64::from(k) - 1.7) * side) as f32);
                let part = i as f32 - 9.0;
                PointForce { place, force: [1e-3 * part, -2e-3, -1e-2 - 5e-5 * part * part] }
            };
            let forces: Vec<_> = (0..25).map(cell).collect();
            let found = near_field.von_mises(&forces, side, &displacement);
            let most = found.iter().flatten().copied().fold(0.0, f64::max);
            let near = found.iter().flatten().count();
            assert!(near > 200 && near < found.len(), "{near} of {} near", found.len());
            for column in &near_field.columns {
                let right = near_field.one_by_one(column, &forces, side, &displacement);
                for (t, tet) in column.tets.iter().enumerate() {
                    let (found, right) =
                        (found[tet.tet as usize], right.as_ref().map(|all| all[t]));
                    assert_eq!(found.is_some(), right.is_some(), "tetrahedron {}", tet.tet);
                    let error = found.unwrap_or(0.0) - right.unwrap_or(0.0);
                    // Both have single precision.
                    assert!(error.abs() < 1e-5 * most, "{found:?} Pa for {right:?} of {most} Pa");
                }
            }
        }
    }

    impl NearField {
        /// Stress (Pa) of the tetrahedra of a column, if it is near.
        fn one_by_one(
            &self,
            column: &Column,
            forces: &[PointForce],
            side: f64,
            displacement: &[Vector3<f64>],
        ) -> Option<Vec<f64>> {
            let away = |force: &PointForce| {
                let [x, y] = [0, 1].map(|i| force.place[i] - column.centre[i]);
                x.hypot(y) / column.spacing
            };
            let least = self.columns.iter().map(|c| c.spacing).fold(f32::INFINITY, f32::min);
            let is_beside = forces.iter().any(|force| away(force) < BESIDE);
            let mut near = if is_beside { forces.to_vec() } else { merged(forces, MERGED * least) };
            near.retain(|force| away(force) < REACH);
            if near.is_empty() {
                return None;
            }
            let along = (f64::from(column.spacing) / side).clamp(FEW as f64, MOST as f64) as usize;
            let lift = (side * LIFT[usize::from(along <= FEW)]) as f32;
            let space = HalfSpace { m: (1.0 - 2.0 * self.moduli.poisson) as f32, lift };
            let lanes = |point: [f32; 3]| point.map(|x| [x; LANES]);
            let rest = |corner: usize| -> Vector3<f64> {
                let (block, lane) = (&column.in_layer.blocks[corner / LANES], corner % LANES);
                let moved = space.displacement(&lanes(block.map(|axis| axis[lane])), &near);
                let u = displacement[column.nodes[corner] as usize];
                u - Vector3::from(moved.map(|u| f64::from(u[0]))) * self.scale()
            };
            let stress = |tet: &ColumnTet| {
                let places = tet.corners.map(|corner| Vector3::from(column.places[corner]));
                let distance = |force: &PointForce| {
                    let [x, y] = force.place;
                    (places.iter().sum::<Vector3<f32>>() / 4.0 - Vector3::new(x, y, 0.0)).norm()
                };
                let nearest = near.iter().map(distance).fold(f32::INFINITY, f32::min);
                let rule = match nearest / column.spacing {
                    x if x < CLOSE[0] => along,
                    x if x < CLOSE[1] => FEW,
                    _ => 1,
                };
                let [a, b, c, d] = tet.corners.map(rest);
                let slopes = Matrix3::from(tet.slopes).transpose().cast::<f64>();
                let gradient = Matrix3::from_columns(&[b - a, c - a, d - a]) * slopes;
                let smooth = (gradient + gradient.transpose()) * 0.5;
                let norm = |shares: &[f64; 4]| {
                    let place: Vector3<f32> =
                        places.iter().zip(shares).map(|(p, share)| p * *share as f32).sum();
                    let strain = space.strain(&lanes(place.into()), &near);
                    let [xx, yy, zz, xy, xz, yz] = strain.map(|e| f64::from(e[0]));
                    let own = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) * self.scale();
                    let all = smooth + own;
                    (all - Matrix3::from_diagonal_element(all.trace() / 3.0)).norm()
                };
                let shares = sample_shares(rule as u32);
                let mean = shares.iter().map(norm).sum::<f64>() / shares.len() as f64;
                6.0_f64.sqrt() * self.moduli.shear() * mean
            };
            Some(column.tets.iter().map(stress).collect())
        }
    }
}
