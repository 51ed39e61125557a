//! Stress of the model mesh near the contact.
//!
//! Where the contact is small beside the mesh, the displacement interpolated between the nodes
//! misses most of the stress. Near the contact the displacement is therefore split into that of a
//! half-space under the forces on cells, whose strain is known in closed form, and the rest, which
//! is smooth and interpolated. For a force F on the face, the vector r from there to a point at depth d
//! below the face, ρ = |r|, m = 1 − 2ν and Φ = (F_x r_x + F_y r_y)/(ρ + d) + F_z ln(ρ + d), with z out
//! of the face, displacement and strain are 1/(4πμ) times
//!
//! - u = F/ρ + (F·r) r/ρ³ + m (Φ,x  Φ,y  Φ,d),
//! - ε = (F·r) (1/ρ³ − 3 r rᵀ/ρ⁵) + m H, where H is the Hessian of Φ in the plane, −Φ,dd normal to it
//!   and zero otherwise
//!
//! (Boussinesq's and Cerruti's solutions; Johnson 1985, Contact Mechanics, ch. 3). The force on a
//! cell acts at a point above its centre, so that it bears on the face as a smooth pressure about as
//! wide as the cell.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use crate::{
    deformation::Moduli,
    geometry::{PadMesh, sample_shares},
    simd::{LANES, vectorised},
};

/// Distance in plan from a cell up to which stress is computed so, in spacings of the nodes.
const REACH: f32 = 3.5;
/// Distances from the nearest cell, in spacings, up to which the stress of a tetrahedron is the mean
/// of the most samples, and of [`FEW`]; farther away it is that of its centre.
const CLOSE: [f32; 2] = [0.9, 2.0];
/// Distance in plan from the middle of a column, in spacings, up to which forces are taken one by one,
/// and side of the squares in which farther ones are merged.
const BESIDE: f32 = 1.7;
const MERGED: f32 = 0.25;
/// Samples along an edge of a tetrahedron, as those of [`sample_shares`].
const FEW: usize = 2;
const MOST: usize = 5;
/// Height over a cell, in its sides, at which the force on it acts, for cells narrow and wide against
/// the spacing of the nodes. The latter displaces the centre of the cell about as an even pressure.
pub(super) const LIFT: [f64; 2] = [0.3, 0.6];

/// One number for each of the points that are computed together.
type Lanes = [f32; LANES];

/// Tetrahedra of the model mesh in columns of grid cells.
pub(super) struct NearField {
    moduli: Moduli,
    /// Shares of the corners in each sample of a tetrahedron, by samples along an edge.
    samples: Vec<Vec<[f32; 4]>>,
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
    /// The same with the depths at which the elastic layer is displaced as they are.
    in_layer: Points,
    tets: Vec<ColumnTet>,
    /// Centres of the tetrahedra.
    centres: Points,
}

struct ColumnTet {
    tet: u32,
    /// Corners among those of the column.
    corners: [usize; 4],
    /// Gradients of the shape functions of the last three corners, by row (1/m).
    slopes: Matrix3<f64>,
}

/// Force (N) at a place of the face (m).
#[derive(Clone, Copy)]
pub(super) struct PointForce {
    pub(super) place: [f32; 2],
    pub(super) force: [f32; 3],
}

/// Points in the plan and in depth (m), in blocks.
#[derive(Default)]
struct Points {
    count: usize,
    blocks: Vec<[Lanes; 3]>,
}

/// Half-space with m = 1 − 2ν, and the height over its face from which forces act (m).
#[derive(Clone, Copy)]
struct HalfSpace {
    m: f32,
    lift: f32,
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
                ColumnTet {
                    tet: tet as u32,
                    corners: mesh.tets[tet].map(|node| corner(node).expect("a grid of columns")),
                    slopes: edges.try_inverse().expect("soft bodies have no flat tetrahedra"),
                }
            };
            let [low, high] = [first, first + nx + 2].map(|node| mesh.vertices[node]);
            let (middle, sides) = (nalgebra::center(&low, &high), high - low);
            let tets: Vec<_> = (0..nz).flat_map(of).map(tet).collect();
            Column {
                centre: [middle.x as f32, middle.y as f32],
                spacing: (sides.x * sides.y).sqrt() as f32,
                in_layer: Points::new(in_layer),
                centres: Points::new(tets.iter().map(|tet| tet.at(&places, &[0.25; 4]))),
                nodes: nodes.into_iter().map(|node| node as u32).collect(),
                places,
                tets,
            }
        };
        let first = |j: usize| (0..nx).map(move |i| j * (nx + 1) + i);
        let columns = (0..ny).flat_map(first).map(column).collect();
        let shares = |along: usize| {
            let shares = sample_shares(along as u32);
            shares.iter().map(|shares| shares.map(|share| share as f32)).collect()
        };
        Self { moduli, samples: (0..=MOST).map(shares).collect(), columns }
    }

    /// Replaces the von Mises stress (T) in Pa of tetrahedra near `forces`, each spread over a cell
    /// with `side` (m), under which the nodes have the `displacement` (V) in m.
    pub(super) fn refine(
        &self,
        forces: &[PointForce],
        side: f64,
        displacement: &[Vector3<f64>],
        von_mises: &mut [f64],
    ) {
        let m = (1.0 - 2.0 * self.moduli.poisson) as f32;
        let scale = self.scale() as f32;
        let spacings = self.columns.iter().map(|column| column.spacing);
        let merged = merged(forces, MERGED * spacings.fold(f32::INFINITY, f32::min));
        let (low, high) = corners(forces);
        let (mut near, mut norms) = (Vec::new(), Vec::new());
        for column in &self.columns {
            let reach = REACH * column.spacing;
            let is_far =
                |i: usize| column.centre[i] < low[i] - reach || column.centre[i] > high[i] + reach;
            if is_far(0) || is_far(1) {
                continue;
            }
            let within = |force: &PointForce, spacings: f32| {
                let [x, y] = [0, 1].map(|i| force.place[i] - column.centre[i]);
                x * x + y * y < (spacings * column.spacing).powi(2)
            };
            let is_beside = forces.iter().any(|force| within(force, BESIDE));
            let all = if is_beside { forces } else { &merged };
            near.clear();
            near.extend(all.iter().filter(|force| within(force, REACH)));
            if near.is_empty() {
                continue;
            }
            let along = (f64::from(column.spacing) / side).clamp(FEW as f64, MOST as f64) as usize;
            let lift = side * LIFT[usize::from(along <= FEW)];
            let space = HalfSpace { m, lift: lift as f32 };
            let (points, counts) = self.points(column, &near, along);
            let rest = self.rest(column, &near, space, displacement);
            let smooth = points.constant(column.tets.iter().map(|tet| tet.strain(&rest)), &counts);
            norms.clear();
            vectorised(
                #[inline(always)]
                || {
                    for (at, smooth) in points.blocks.iter().zip(&smooth) {
                        norms.push(deviator_norm(&space.strain(at, &near), scale, smooth));
                    }
                },
            );
            let mut remaining = norms.as_flattened();
            for (tet, count) in column.tets.iter().zip(counts) {
                let (norms, others) = remaining.split_at(count);
                let mean = norms.iter().sum::<f32>() / count as f32;
                von_mises[tet.tet as usize] =
                    6.0_f64.sqrt() * self.moduli.shear() * f64::from(mean);
                remaining = others;
            }
        }
    }

    /// Samples of the tetrahedra of a column, and the number of each tetrahedron's: those close to
    /// the forces have `along` along an edge.
    fn points(&self, column: &Column, forces: &[PointForce], along: usize) -> (Points, Vec<usize>) {
        let mut points = Points::default();
        let [close, middle] = CLOSE.map(|spacings| (spacings * column.spacing).powi(2));
        let mut distances = Vec::new();
        vectorised(
            #[inline(always)]
            || {
                for at in &column.centres.blocks {
                    distances.push(distance_squared(at, forces));
                }
            },
        );
        let number = |(tet, distance): (&ColumnTet, &f32)| {
            let samples = match *distance {
                nearest if nearest < close => &self.samples[along],
                nearest if nearest < middle => &self.samples[FEW],
                _ => &self.samples[1],
            };
            for shares in samples {
                points.push(tet.at(&column.places, shares));
            }
            samples.len()
        };
        let counts = column.tets.iter().zip(distances.as_flattened()).map(number).collect();
        (points, counts)
    }

    /// Displacement (m) of the corners of a column less that of the half-space under the `forces`.
    fn rest(
        &self,
        column: &Column,
        forces: &[PointForce],
        space: HalfSpace,
        displacement: &[Vector3<f64>],
    ) -> Vec<Vector3<f64>> {
        let mut moved = Vec::new();
        vectorised(
            #[inline(always)]
            || {
                for at in &column.in_layer.blocks {
                    moved.push(space.displacement(at, forces));
                }
            },
        );
        let scale = self.scale();
        let rest = |(i, node): (usize, &u32)| {
            let u = [0, 1, 2].map(|axis| f64::from(moved[i / LANES][axis][i % LANES]));
            displacement[*node as usize] - Vector3::from(u) * scale
        };
        column.nodes.iter().enumerate().map(rest).collect()
    }

    /// 1/(4πμ) (m²/N).
    fn scale(&self) -> f64 {
        1.0 / (4.0 * std::f64::consts::PI * self.moduli.shear())
    }
}

impl ColumnTet {
    /// Point with these shares of the corners, whose `places` are those of the column.
    fn at(&self, places: &[[f32; 3]], shares: &[f32; 4]) -> [f32; 3] {
        let corners = self.corners.map(|corner| places[corner]);
        std::array::from_fn(|i| (0..4).map(|a| shares[a] * corners[a][i]).sum())
    }

    /// Strain under the `displacement` (m) of the corners of its column: xx, yy, zz, xy, xz and yz.
    fn strain(&self, displacement: &[Vector3<f64>]) -> [f32; 6] {
        let [a, b, c, d] = self.corners.map(|corner| displacement[corner]);
        let gradient = Matrix3::from_columns(&[b - a, c - a, d - a]) * self.slopes;
        let strain = (gradient + gradient.transpose()) * 0.5;
        [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|at| strain[at] as f32)
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

    /// The `strains` of tetrahedra at their points, in the same blocks; `counts` are the numbers of
    /// their points.
    fn constant(
        &self,
        strains: impl Iterator<Item = [f32; 6]>,
        counts: &[usize],
    ) -> Vec<[Lanes; 6]> {
        let mut all = vec![[[0.0; LANES]; 6]; self.blocks.len()];
        let mut point = 0;
        for (strain, count) in strains.zip(counts) {
            for _ in 0..*count {
                let block = &mut all[point / LANES];
                (0..6).for_each(|part| block[part][point % LANES] = strain[part]);
                point += 1;
            }
        }
        all
    }
}

/// Norm of the deviator of `strain` times `scale` plus `smooth`, of the parts xx, yy, zz, xy, xz and
/// yz.
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

/// Least and greatest coordinates of the places of `forces` (m).
fn corners(forces: &[PointForce]) -> ([f32; 2], [f32; 2]) {
    let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for PointForce { place, .. } in forces {
        for i in 0..2 {
            (low[i], high[i]) = (low[i].min(place[i]), high[i].max(place[i]));
        }
    }
    (low, high)
}

/// 1/ρ and 1/(ρ + d), for ρ² and d.
#[inline(always)]
fn inverses(square: f32, d: f32) -> (f32, f32) {
    let rho = square.sqrt();
    let both = 1.0 / (square * (rho + d));
    (rho * (rho + d) * both, square * both)
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

impl HalfSpace {
    /// Displacement of the points `at` under `forces`, times 4πμ: x, y and z.
    #[inline(always)]
    fn displacement(self, at: &[Lanes; 3], forces: &[PointForce]) -> [Lanes; 3] {
        let mut sum = [[0.0; LANES]; 3];
        for PointForce { place, force: [fx, fy, fz] } in forces {
            for i in 0..LANES {
                let (x, y, d) = (at[0][i] - place[0], at[1][i] - place[1], at[2][i] + self.lift);
                let (r, w) = inverses(x * x + y * y + d * d, d);
                let plane = fx * x + fy * y;
                let along = (plane - fz * d) * r * r * r;
                // Part of the gradient of Φ that is along r in the plane.
                let inwards = (fz - plane * w) * w * r;
                sum[0][i] += fx * (r + self.m * w) + x * (along + self.m * inwards);
                sum[1][i] += fy * (r + self.m * w) + y * (along + self.m * inwards);
                sum[2][i] += fz * r - d * along + self.m * (fz - plane * w) * r;
            }
        }
        sum
    }

    /// Strain of the points `at` under `forces`, times 4πμ: xx, yy, zz, xy, xz and yz.
    #[inline(always)]
    fn strain(self, at: &[Lanes; 3], forces: &[PointForce]) -> [Lanes; 6] {
        let mut sum = [[0.0; LANES]; 6];
        for PointForce { place, force: [fx, fy, fz] } in forces {
            for i in 0..LANES {
                let (x, y, d) = (at[0][i] - place[0], at[1][i] - place[1], at[2][i] + self.lift);
                let (r, w) = inverses(x * x + y * y + d * d, d);
                let (plane, cube) = (fx * x + fy * y, r * r * r);
                let even = (plane - fz * d) * cube;
                let along = -3.0 * even * r * r;
                // Factors in the Hessian of Φ: of F_x x and its like, of x² and its like, of 1.
                let turn = self.m * w * w * r;
                let square =
                    plane * (2.0 * turn * w * r + turn * r * r) - self.m * fz * r * r * w * (r + w);
                let unit = self.m * fz * r * w - plane * turn;
                let (both, all) = (along + square, even + unit);
                sum[0][i] += both * x * x + all - 2.0 * turn * fx * x;
                sum[1][i] += both * y * y + all - 2.0 * turn * fy * y;
                sum[2][i] += along * d * d + (1.0 - self.m) * even;
                sum[3][i] += both * x * y - turn * (fx * y + fy * x);
                sum[4][i] -= along * x * d;
                sum[5][i] -= along * y * d;
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;

    const FORCES: [PointForce; 2] = [
        PointForce { place: [0.2, -0.1], force: [0.7, -0.3, -1.0] },
        PointForce { place: [-0.4, 0.3], force: [0.0, 0.5, 0.2] },
    ];

    fn lanes([x, y, depth]: [f32; 3]) -> [Lanes; 3] {
        [x, y, depth].map(|x| [x; LANES])
    }

    #[test]
    fn strain_is_the_derivative_of_displacement() {
        const STEP: f32 = 1e-2;
        let space = HalfSpace { m: 0.4, lift: 0.1 };
        for point in [[0.0, 0.0, 0.6], [1.1, -0.3, 0.9], [-0.6, 0.8, 0.2], [0.2, -0.1, 1.4]] {
            let moved = |axis: usize, step: f32| {
                let mut point = point;
                // Depth grows against z.
                point[axis] += if axis == 2 { -step } else { step };
                space.displacement(&lanes(point), &FORCES).map(|u| u[0])
            };
            let by = |axis| {
                let [there, back] = [moved(axis, STEP), moved(axis, -STEP)];
                Vector3::from(there) - Vector3::from(back)
            };
            let gradient = Matrix3::from_columns(&[by(0), by(1), by(2)]) / (2.0 * STEP);
            let right = (gradient + gradient.transpose()) * 0.5;
            let [xx, yy, zz, xy, xz, yz] = space.strain(&lanes(point), &FORCES).map(|e| e[0]);
            let found = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
            let error = (found - right).norm() / right.norm();
            assert!(error < 5e-3, "{found} instead of {right} at {point:?}");
        }
    }

    /// The stress across a plane under the face, summed over the plane, is the force on the face.
    #[test]
    fn stress_across_a_plane_bears_the_force() {
        const RADII: usize = 400;
        const ANGLES: usize = 32;
        let (nu, depth) = (0.3, 0.5);
        let space = HalfSpace { m: (1.0 - 2.0 * nu) as f32, lift: 0.0 };
        let force = Vector3::new(0.7, -0.3, -1.0);
        let load = PointForce { place: [0.0; 2], force: force.map(|f| f as f32).into() };
        let mut sum = Vector3::zeros();
        for slope in (0..RADII).map(|i| (i as f64 + 0.5) * FRAC_PI_2 / RADII as f64) {
            let radius = depth * slope.tan();
            let ring = depth / slope.cos().powi(2) * FRAC_PI_2 / RADII as f64;
            for angle in (0..ANGLES).map(|i| i as f64 * 2.0 * PI / ANGLES as f64) {
                let at = [radius * angle.cos(), radius * angle.sin(), depth].map(|x| x as f32);
                let strain = space.strain(&lanes(at), &[load]).map(|e| f64::from(e[0]));
                let [xx, yy, zz, _, xz, yz] = strain;
                // Strain is times 4πμ, so that stress is 2μ of it over 4πμ.
                let normal = zz + nu / (1.0 - 2.0 * nu) * (xx + yy + zz);
                let area = radius * ring * 2.0 * PI / ANGLES as f64;
                sum += Vector3::new(xz, yz, normal) * (area / (2.0 * PI));
            }
        }
        assert!((sum - force).norm() < 2e-3, "{sum} instead of {force}");
    }
}
