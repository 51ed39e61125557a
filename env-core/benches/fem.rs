//! Time of a converged frame on the path of a ball into a gel pad, one thread.
//!
//! Goals: 25 ms on about 1,000 nodes, 150 ms on 3,000, 1 s on 10,000.

#![allow(missing_docs)] // criterion's macros expand to undocumented functions

#[path = "../../tests/physics/bodies.rs"]
mod bodies;

use bodies::{gel_pad, press_and_shear};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use ruffini_core::fem::{Fem, Options};

fn frames(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("20 frames");
    group.sample_size(10);
    for cells in [[14, 16, 3], [18, 22, 6], [28, 34, 9]] {
        for friction in [0.0, 0.5] {
            let options = Options { friction, ..Options::default() };
            let fem = Fem::new(gel_pad(cells), options).expect("the options are valid");
            let name = format!("{} nodes, μ {friction}", fem.body().mesh().vertices.len());
            let press = press_and_shear();
            group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
                bencher.iter(|| fem.solve_path(&press));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
