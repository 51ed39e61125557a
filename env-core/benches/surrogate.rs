//! Time of a ball's next 50 µm into a gel pad: by the network, by the linear answer that it corrects,
//! by finite elements as fine as its teacher.
//!
//! Goal: 1 ms a press on one thread, everything included.

#![allow(missing_docs)] // criterion's macros expand to undocumented functions

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Isometry3;
use ruffini_core::{
    compliance::{self, Compliance},
    deformation::{Deformation, History, Law, Moduli, Press, SoftBody},
    fem::{self, Fem},
    geometry::Shape,
    sensor::Sensor,
    surrogate::Surrogate,
};

const MM: f64 = 1e-3;
const FRICTION: f64 = 0.8;

fn pressed(x: f64, depth: f64) -> Press {
    let ball = vec![Shape::Sphere { radius: 4.0 * MM }];
    let pose = Isometry3::translation(x, 0.0, 4.0 * MM - depth);
    Press::along(ball, vec![vec![pose]]).expect("a path of finite poses")
}

fn onwards(history: History) -> Press {
    pressed(0.03 * MM, 0.54 * MM).after(history).expect("the same shapes")
}

fn presses(criterion: &mut Criterion) {
    let sensor = Sensor::named("gelsight-mini").expect("a known sensor");
    let moduli = Moduli { young: 3e5, poisson: 0.47 };
    let network = Surrogate::named("default", &sensor, moduli, FRICTION).expect("shipped weights");
    let pad = sensor.pad(network.card().linear_nodes).expect("a mesh of that size");
    let body = SoftBody::new(pad.mesh, Law::NeoHookean, moduli, &pad.base).expect("a sound mesh");
    let options = compliance::Options { friction: FRICTION, sweeps: 0 };
    let linear = Compliance::new(body.clone(), options).expect("a bonded pad");
    let options = fem::Options { friction: FRICTION, ..fem::Options::default() };
    let elements = Fem::new(body, options).expect("valid options");
    let history = |mut path: Vec<ruffini_core::Result<Deformation>>| {
        path.swap_remove(0).expect("a shallow press").history
    };
    let mut group = criterion.benchmark_group("onwards by 50 µm");
    group.sample_size(20);
    let press = onwards(history(network.solve_path(&pressed(0.0, 0.5 * MM))));
    group.bench_function("surrogate", |b| b.iter(|| black_box(network.solve_path(&press))));
    group.bench_function("linear", |b| b.iter(|| black_box(linear.solve_path(&press))));
    let press = onwards(history(elements.solve_path(&pressed(0.0, 0.5 * MM))));
    group.bench_function("fem", |b| b.iter(|| black_box(elements.solve_path(&press))));
    group.finish();
}

criterion_group!(benches, presses);
criterion_main!(benches);
