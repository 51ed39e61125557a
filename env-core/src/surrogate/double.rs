//! Rounding error of single precision: the corrector in double precision, written from its formulas
//! without any of its operations, compared with the fast path.
//! `cargo test precision -- --nocapture` prints the errors.

use candle_core::Tensor;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Point3, Vector3};

use super::{
    answer::SHIPPED,
    corrector::{Corrector, OF_LAYER},
    fast::PadInference,
    features::{DIRECTIONS, FEATURES, PadInput},
    graph::{LAYERS, Level, PadGraph},
    layers::{LayerNorm, Linear, Mlp, Round},
    linear::{LinearBaseline, LinearStress},
    material::PadMaterial,
    ops::Sparse,
    parameters::Parameters,
    weights::{self, Card},
};
use crate::{
    compliance::nodal::ContactResolution,
    deformation::{Moduli, Press},
    geometry::{PadMesh, Shape},
    sensor::Sensor,
};

/// Displacement (V, 3), stress (T) and forces on the face (C, 3), in the units of [`PadInput`].
type DoubleFields = [Vec<f64>; 3];

/// Converts a tensor of one or two dimensions.
fn matrix(tensor: &Tensor) -> DMatrix<f64> {
    let (rows, columns) = tensor.dims2().unwrap_or((1, tensor.elem_count()));
    let numbers: Vec<f32> = tensor.flatten_all().unwrap().to_vec1().unwrap();
    DMatrix::from_row_iterator(rows, columns, numbers.into_iter().map(f64::from))
}

/// A scale of a graph, and the features of its edges.
type Scale<'a> = (&'a Level, &'a Tensor);

fn wide(numbers: &[f32]) -> Vec<f64> {
    numbers.iter().map(|&x| f64::from(x)).collect()
}

/// x Wᵀ + b.
fn linear_layer(layer: &Linear, x: &DMatrix<f64>) -> DMatrix<f64> {
    let mut y = x * matrix(&layer.weight).transpose();
    let bias = matrix(&layer.bias);
    y.row_iter_mut().for_each(|mut row| row += &bias);
    y
}

fn relu(x: &DMatrix<f64>) -> DMatrix<f64> {
    x.map(|x| x.max(0.0))
}

fn mlp(layers: &Mlp, x: &DMatrix<f64>) -> DMatrix<f64> {
    linear_layer(&layers.second, &relu(&linear_layer(&layers.first, x)))
}

fn layer_norm(layer: &LayerNorm, x: &DMatrix<f64>) -> DMatrix<f64> {
    let (scale, shift) = (matrix(&layer.scale), matrix(&layer.shift));
    let mut y = x.clone();
    for mut row in y.row_iter_mut() {
        let mean = row.mean();
        let deviation = (row.map(|x| (x - mean).powi(2)).mean() + 1e-5).sqrt();
        let normal = row.map(|x| (x - mean) / deviation);
        row.copy_from(&(normal.component_mul(&scale) + &shift));
    }
    y
}

fn sparse(matrix: &Sparse, x: &DMatrix<f64>) -> DMatrix<f64> {
    let mut y = DMatrix::zeros(matrix.height(), x.ncols());
    for row in 0..matrix.height() {
        for (column, value) in matrix.row(row) {
            let mut sum = y.row_mut(row);
            sum += x.row(column) * f64::from(value);
        }
    }
    y
}

/// v + f(n, Σₛ relu(A nₛ + B nᵣ + C eₛᵣ)), n the layer norm of v.
fn round(round: &Round, v: &DMatrix<f64>, scale: Scale) -> DMatrix<f64> {
    let (level, features) = scale;
    let (n, width) = (layer_norm(&round.norm, v), v.ncols());
    let ends = linear_layer(&round.ends, &n);
    let edges = linear_layer(&round.edges, &matrix(features));
    let mut both = n.resize_horizontally(2 * width, 0.0);
    for receiver in 0..v.nrows() {
        let own = ends.view((receiver, width), (1, width));
        for edge in level.edges.starts[receiver]..level.edges.starts[receiver + 1] {
            let sender = level.edges.senders[edge as usize] as usize;
            let sum = ends.view((sender, 0), (1, width)) + own + edges.row(edge as usize);
            let mut heard = both.view_mut((receiver, width), (1, width));
            heard += relu(&sum.into_owned().resize_vertically(1, 0.0));
        }
    }
    v + mlp(&round.update, &both)
}

fn rounds(all: &[Round], v: DMatrix<f64>, scale: Scale) -> DMatrix<f64> {
    all.iter().fold(v, |v, one| round(one, &v, scale))
}

/// Returns √(3/2 dev b : dev b) / J of every tetrahedron for `u` (V, 3) in units of `length`.
fn von_mises(pad: &PadMesh, length: f64, u: &[f64]) -> Vec<f64> {
    let place = |node: u32| Vector3::from_column_slice(&u[3 * node as usize..][..3]);
    let stress = |t: usize| {
        let [a, b, c, d] = pad.mesh.corners(t);
        let edges = Matrix3::from_columns(&[b - a, c - a, d - a]) / length;
        let [a, b, c, d] = pad.mesh.tets[t].map(place);
        let strain = Matrix3::from_columns(&[b - a, c - a, d - a]);
        let f = Matrix3::identity() + strain * edges.try_inverse().expect("no flat tetrahedron");
        let b = f * f.transpose();
        let deviator = b - Matrix3::from_diagonal_element(b.trace() / 3.0);
        (1.5 * deviator.norm_squared() + 1e-10).sqrt() / f.determinant().max(0.5)
    };
    (0..pad.mesh.tets.len()).map(stress).collect()
}

/// Evaluates `network` for an input on a pad whose layer is `length` thick (m).
fn forward(
    network: &Corrector,
    input: &PadInput,
    graph: &PadGraph,
    pad: &PadMesh,
    length: f64,
) -> DoubleFields {
    let features = DMatrix::from_row_slice(graph.columns, FEATURES, &wide(&input.features));
    let PadGraph { levels, edges, .. } = graph;
    let [first, second, third] = [0, 1, 2].map(|scale| (&levels[scale], &edges[scale]));
    let scales = &network.scales;
    let [[raise, lower], [raise_more, lower_more]] =
        [first, second].map(|(level, _)| level.links.as_ref().expect("a coarser scale"));
    let fine = rounds(&scales.down[0], mlp(&scales.encoder, &features), first);
    let middle = linear_layer(&scales.lower[0], &sparse(lower, &fine));
    let middle = rounds(&scales.down[1], middle, second);
    let coarse = linear_layer(&scales.lower[1], &sparse(lower_more, &middle));
    let mut coarse = rounds(&scales.down[2], coarse, third);
    let mean = DMatrix::from_rows(&[coarse.row_mean()]);
    let shared = mlp(&scales.global, &mean);
    coarse.row_iter_mut().for_each(|mut row| row += &shared);
    let middle = middle + linear_layer(&scales.raise[1], &sparse(raise_more, &coarse));
    let middle = rounds(&scales.up[1], middle, second);
    let fine = fine + linear_layer(&scales.raise[0], &sparse(raise, &middle));
    let latent = layer_norm(&scales.norm, &rounds(&scales.up[0], fine, first));

    let output = mlp(&network.nodes, &latent);
    let amplitude = f64::from(input.amplitude);
    let (mut displacement, mut forces) = (wide(&input.displacement), wide(&input.forces));
    for column in 0..graph.columns {
        let growth = |first: usize, axis: usize| 1.0 + output[(column, first + 3 + axis / 2)];
        let gate = f64::from(input.gates[column]) * f64::from(input.strongest);
        let first = OF_LAYER * LAYERS;
        let own = Vector3::from_column_slice(&forces[3 * column..][..3]).norm();
        let along = output[(column, first + 5)] * gate + output[(column, first + 6)] * own;
        for axis in 0..3 {
            for layer in 0..LAYERS {
                let first = OF_LAYER * layer;
                let u = &mut displacement[3 * (layer * graph.columns + column) + axis];
                *u = *u * growth(first, axis) + output[(column, first + axis)] * amplitude;
                for direction in 0..DIRECTIONS {
                    let along = input.directions[3 * (DIRECTIONS * column + direction) + axis];
                    *u += output[(column, first + 5 + direction)] * f64::from(along);
                }
            }
            let force = &mut forces[3 * column + axis];
            *force = *force * growth(first, axis) + output[(column, first + axis)] * gate;
            *force += along * f64::from(input.normals[3 * column + axis]);
        }
    }
    let [before, after] =
        [&wide(&input.displacement), &displacement].map(|u| von_mises(pad, length, u));
    let (corner, width) =
        (linear_layer(&network.corners, &latent), network.strain.bias.elem_count());
    let stress = (0..graph.tets()).map(|t| {
        let linear = f64::from(input.stress[t]);
        let unit = amplitude + f64::from(f32::MIN_POSITIVE);
        let strains = DMatrix::from_row_slice(1, 3, &[linear, before[t], after[t]]) / unit;
        let mut hidden = linear_layer(&network.strain, &strains);
        for &node in &pad.mesh.tets[t] {
            let (layer, column) = (node as usize / graph.columns, node as usize % graph.columns);
            hidden += corner.view((column, layer * width), (1, width));
        }
        linear + after[t] - before[t]
            + linear_layer(&network.stress, &relu(&hidden))[(0, 0)] * amplitude
    });
    let stress = stress.collect();
    [displacement, stress, forces]
}

/// Relative L² distance.
fn apart(found: &[f32], exact: &[f64]) -> f64 {
    assert_eq!(found.len(), exact.len());
    let (found, exact) = (DVector::from_vec(wide(found)), DVector::from_column_slice(exact));
    (found - &exact).norm() / exact.norm()
}

/// Presses of a ball, block or tip, each with its depth (m), beside the middle of the face.
fn presses() -> Vec<(&'static str, f64, Press)> {
    let sides = Vector3::repeat(0.004);
    let shapes = [
        ("ball", Shape::Sphere { radius: 0.004 }, 0.004),
        ("block", Shape::Cuboid { half_extents: sides }, 0.004),
        ("tip", Shape::Sphere { radius: 0.001 }, 0.001),
    ];
    let depths = [1e-6, 1e-5, 1e-4, 1e-3, 2e-3];
    let pairs = shapes.iter().flat_map(|shape| depths.map(|depth| (shape, depth)));
    let press = |((name, shape, reach), depth): (&(&'static str, Shape, f64), f64)| {
        let pose = Isometry3::translation(1e-3, 0.5e-3, reach - depth);
        (*name, depth, Press::along(vec![shape.clone()], vec![vec![pose]]).unwrap())
    };
    pairs.map(press).collect()
}

#[test]
fn precision_single_is_enough() {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let (mut worst, mut count) = ([0.0_f64; 3], 0);
    let (tensors, card): (_, Card) = weights::of_kind("pads", SHIPPED).unwrap();
    let parameters = Parameters::given(tensors).unwrap();
    let network = Corrector::new(&card.network, &parameters.builder()).unwrap();
    let pad = sensor.pad(card.model_nodes).unwrap();
    let graph = PadGraph::new(&pad).unwrap();
    let fast = PadInference::new(&network, &graph, &pad).unwrap();
    for poisson in [0.0, 0.4999] {
        let moduli = Moduli { young: 3e5, poisson };
        let gel = PadMaterial { moduli, friction: 0.8, thickness: sensor.outline.thickness };
        let linear =
            LinearBaseline::new(&sensor, &gel, card.linear_nodes, &pad, ContactResolution::FAST)
                .unwrap();
        for (name, depth, press) in presses() {
            let Ok(answer) = linear.path(&press).swap_remove(0) else { continue };
            let places: &[Point3<f64>] = &pad.mesh.vertices;
            let carried = linear.carry(&answer, LinearStress::OF_NETWORK).unwrap();
            let input = PadInput::new(&graph, &gel, places, press.shapes(), &carried);
            if input.amplitude == 0.0 {
                continue;
            }
            let found = fast.forward(&input, true);
            let exact = forward(&network, &input, &graph, &pad, gel.thickness);
            let off = [
                apart(&found.displacement, &exact[0]),
                apart(&found.stress, &exact[1]),
                apart(&found.forces, &exact[2]),
            ];
            let [u, stress, forces] = off;
            println!("{poisson} {name} {depth:.0e} m: {u:.1e} {stress:.1e} {forces:.1e}");
            worst = std::array::from_fn(|i| worst[i].max(off[i]));
            count += 1;
        }
    }
    let [u, stress, forces] = worst;
    println!(
        "{count} presses, worst: u {u:.1e}, von Mises stress {stress:.1e}, forces {forces:.1e}"
    );
    // At a micrometre of displacement in four millimetres, strain keeps only four digits next to
    // the 1 in F = 1 + ∇u.
    assert!(count > 20 && u < 2e-6 && stress < 2e-3 && forces < 2e-6, "{count}: {worst:?}");
}
