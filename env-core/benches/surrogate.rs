//! Time of a further motion of a held object by 1 µm on a gel pad: by the network and by the linear
//! model that it corrects, each without stress and residual, and complete, and by finite elements.
//!
//! Goal: 1 ms per press on one thread, everything included. The matrix products of the network are
//! also timed alone, beside one that is large enough for the highest rate (Gelem/s are GFLOP/s);
//! the goal is 60 % of that rate.

#![allow(missing_docs)] // criterion's macros expand to undocumented functions

use std::{hint::black_box, slice};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use faer::{Accum, MatMut, MatRef, Par, linalg::matmul::matmul};
use nalgebra::{Isometry3, Vector3};
use ruffini_core::{
    compliance::nodal::ContactResolution,
    deformation::{DeformationModel, Law, Moduli, Press, SoftBody, Wanted},
    fem::{Fem, FemOptions},
    geometry::Shape,
    sensor::Sensor,
    surrogate::{CorrectorConfig, LinearPad, Surrogate},
};

const MM: f64 = 1e-3;
const FRICTION: f64 = 0.8;
/// Parts of an answer, by name.
const WANTED: [(&str, Wanted); 3] = [
    ("moved", Wanted { stress: false, residual: false }),
    ("stressed", Wanted { stress: true, residual: false }),
    ("whole", Wanted { stress: true, residual: true }),
];

/// Name, shape, its extent below its origin (m), and the depth at which it is held (m).
struct HeldShape(&'static str, Shape, f64, f64);

fn held() -> [HeldShape; 3] {
    let ball = |radius| Shape::Sphere { radius };
    let block = Shape::Cuboid { half_extents: Vector3::repeat(20.0 * MM) };
    [
        HeldShape("ball 8 mm", ball(8.0 * MM), 8.0 * MM, 1.5 * MM),
        HeldShape("ball 30 mm", ball(30.0 * MM), 30.0 * MM, 0.9 * MM),
        HeldShape("block 40 mm", block, 20.0 * MM, 0.5 * MM),
    ]
}

impl HeldShape {
    fn press(&self, path: &[(f64, f64)]) -> Press {
        let Self(_, shape, reach, _) = self;
        let pose = |&(x, depth)| vec![Isometry3::translation(x, 0.0, reach - depth)];
        Press::along(vec![shape.clone()], path.iter().map(pose).collect()).expect("finite poses")
    }

    /// Press that moves the shape by 1 µm down and 1 µm sideways from where `model` holds it.
    fn onwards(&self, model: &impl DeformationModel) -> Press {
        let depth = self.3;
        let steps = 1 + (depth / (0.2 * MM)) as usize;
        let down = (0..=steps).map(|i| (0.0, depth * i as f64 / steps as f64));
        let mut path = model.solve_path(&self.press(&down.collect::<Vec<_>>()));
        let end = path.pop().expect("a path has frames").expect("a press that is solved");
        self.press(&[(1e-6, depth + 1e-6)]).after(end.history).expect("the same shapes")
    }
}

fn presses(criterion: &mut Criterion) {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let sensor = Sensor::named("gelsight-mini").expect("a known sensor");
    let moduli = Moduli { young: 3e5, poisson: 0.47 };
    let network = Surrogate::new(&sensor, moduli, FRICTION).expect("shipped weights");
    let nodes = network.card().model_nodes;
    let linear = LinearPad::new(&sensor, moduli, FRICTION, nodes, ContactResolution::FAST)
        .expect("a known sensor");
    let pad = sensor.pad(network.card().linear_nodes).expect("a mesh of that size");
    let body = SoftBody::new(pad.mesh, Law::NeoHookean, moduli, &pad.base).expect("a sound mesh");
    let options = FemOptions { friction: FRICTION, ..FemOptions::default() };
    let elements = Fem::new(body, options).expect("valid options");
    for held in held() {
        let mut group = criterion.benchmark_group(held.0);
        group.sample_size(20);
        let press = held.onwards(&network);
        for (what, wanted) in WANTED {
            let solve = || one.install(|| network.solve_partially(slice::from_ref(&press), wanted));
            group.bench_function(format!("surrogate {what}"), |b| b.iter(|| black_box(solve())));
        }
        let press = held.onwards(&linear);
        for (what, wanted) in WANTED {
            let solve = || one.install(|| linear.solve_partially(slice::from_ref(&press), wanted));
            group.bench_function(format!("linear {what}"), |b| b.iter(|| black_box(solve())));
        }
        let press = held.onwards(&elements);
        group.bench_function("fem whole", |b| b.iter(|| black_box(elements.solve_path(&press))));
        group.finish();
    }
}

/// Matrix product, as rows and columns of the left factor, and columns of the right one.
type ProductSize = [usize; 3];

/// Numbers of input features and of outputs of a column of nodes, and of its nodes.
const FEATURES: usize = 38;
const OUTPUTS: usize = 16;
const NODES: usize = 4;

/// Matrix products of `network` in a press on a pad of `cells`, as on the fast path.
fn products(network: &CorrectorConfig, cells: [u32; 3]) -> Vec<ProductSize> {
    let (w, mut size) = (network.width, [cells[0] + 1, cells[1] + 1]);
    let mut rows = Vec::new();
    for _ in 0..network.down.len() {
        rows.push((size[0] * size[1]) as usize);
        size = size.map(|n| n.div_ceil(2));
    }
    // Encoder, heads of the nodes, corners of tetrahedra; then rounds on each scale, and links
    // between scales.
    let mut found = vec![[rows[0], FEATURES, w], [rows[0], w, w], [rows[0], w, w]];
    found.extend([[rows[0], w, OUTPUTS], [rows[0], w, NODES * network.corner]]);
    let rounds = network.down.iter().zip(&rows).chain(network.up.iter().zip(&rows));
    for (&rounds, &rows) in rounds {
        found.extend([[rows, w, 3 * w], [rows, w, w], [rows, w, w]].repeat(rounds));
    }
    found.extend(rows.windows(2).flat_map(|pair| [[pair[1], w, w], [pair[0], w, w]]));
    found
}

fn flops(products: &[ProductSize]) -> u64 {
    products.iter().map(|[rows, inner, columns]| 2 * (rows * inner * columns) as u64).sum()
}

fn dense(criterion: &mut Criterion) {
    let sensor = Sensor::named("gelsight-mini").expect("a known sensor");
    let cells = sensor.pad(1000).expect("a mesh of that size").cells;
    let mut group = criterion.benchmark_group("dense");
    for (name, products) in [
        ("a product of 1024", vec![[1024; 3]]),
        ("surrogate", products(&CorrectorConfig::default(), cells)),
    ] {
        let most = |size: fn(&ProductSize) -> usize| products.iter().map(size).max().unwrap_or(0);
        let a = vec![0.5_f32; most(|[rows, inner, _]| rows * inner)];
        let b = vec![0.25_f32; most(|[_, inner, columns]| inner * columns)];
        let mut c = vec![0.0_f32; most(|[rows, _, columns]| rows * columns)];
        group.throughput(Throughput::Elements(flops(&products)));
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                for &[rows, inner, columns] in &products {
                    let a = MatRef::from_row_major_slice(&a[..rows * inner], rows, inner);
                    let b = MatRef::from_row_major_slice(&b[..inner * columns], inner, columns);
                    let c = &mut c[..rows * columns];
                    let c = MatMut::from_row_major_slice_mut(c, rows, columns);
                    matmul(c, Accum::Add, a, b, 1.0, Par::Seq);
                }
                black_box(&mut c);
            });
        });
    }
    group.finish();
}

criterion_group!(benches, presses, dense);
criterion_main!(benches);
