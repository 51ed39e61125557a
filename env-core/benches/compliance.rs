//! Time of a press of a ball into a gel pad by linear compliance, with the finite elements beside it.
//!
//! Goal: 0.5 ms a press on about 1,000 nodes, one thread, no sweeps.

#![allow(missing_docs)] // criterion's macros expand to undocumented functions

#[allow(dead_code)] // Each of its users needs a part of it.
#[path = "../../tests/physics/bodies.rs"]
mod bodies;

use std::hint::black_box;

use bodies::{gel_pad, press_and_shear};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{Isometry3, Vector3};
use ruffini_core::{
    compliance::{Compliance, Options},
    deformation::{DeformationModel, History, Press},
    fem::{self, Fem},
    geometry::Shape,
};

const MM: f64 = 1e-3;
const FRICTION: f64 = 0.5;

fn ball() -> Vec<Shape> {
    vec![Shape::Sphere { radius: 4.0 * MM }]
}

fn at(x: f64, depth: f64) -> Vec<Isometry3<f64>> {
    vec![Isometry3::translation(x, 0.0, 4.0 * MM - depth)]
}

fn pressed(depth: f64) -> Press {
    Press::along(ball(), vec![at(0.0, depth)]).expect("a path of finite poses")
}

/// The next 50 µm of a ball that is 0.5 mm deep, as a control step of an environment asks for it.
fn moved_on(history: History) -> Press {
    let next = Press::along(ball(), vec![at(0.03 * MM, 0.54 * MM)]);
    next.and_then(|press| press.after(history)).expect("the same shapes")
}

fn pushed(force: f64) -> Press {
    Press::with_force(ball(), at(0.0, -0.1 * MM), force, -Vector3::z()).expect("a finite force")
}

fn presses(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("press");
    group.sample_size(20);
    for cells in [[14, 16, 3], [18, 22, 6]] {
        let body = gel_pad(cells);
        let nodes = body.mesh().vertices.len();
        let options = fem::Options { friction: FRICTION, ..fem::Options::default() };
        let mut fem = Fem::new(body.clone(), options).expect("the options are valid");
        let linear = Compliance::new(body, Options { friction: FRICTION, sweeps: 0 })
            .expect("the pad is bonded");
        let mut begun = linear.clone().solve(&[pressed(0.5 * MM)]);
        let history = begun.remove(0).expect("a shallow press").history;
        let questions = [
            ("0.5 mm", pressed(0.5 * MM)),
            ("1 mm", pressed(MM)),
            ("onwards", moved_on(history)),
            ("0.3 N", pushed(0.3)),
            ("20 frames", press_and_shear()),
        ];
        for (name, press) in questions {
            let id = |who: &str| BenchmarkId::new(format!("{nodes} nodes, {name}"), who);
            group.bench_function(id("wrench"), |b| b.iter(|| black_box(linear.wrenches(&press))));
            for sweeps in [0, 4] {
                let options = Options { friction: FRICTION, sweeps };
                let mut model = linear.with_options(options).expect("the options are valid");
                let presses = [press.clone()];
                group.bench_function(id(&format!("{sweeps} sweeps")), |bencher| {
                    bencher.iter(|| black_box(model.solve(&presses)));
                });
            }
            let presses = [press];
            group.bench_function(id("fem"), |b| b.iter(|| black_box(fem.solve(&presses))));
        }
    }
    group.finish();
}

criterion_group!(benches, presses);
criterion_main!(benches);
