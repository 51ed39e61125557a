//! Time of a converged frame on the path of a ball into a gel pad, one thread.
//!
//! Goals: 25 ms on about 1,000 nodes, 150 ms on 3,000, 1 s on 10,000.

#![allow(missing_docs)] // criterion's macros expand to undocumented functions

#[path = "../../tests/physics/bodies.rs"]
mod bodies;

use bodies::{even, graded, grid, nodes_where};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::Isometry3;
use ruffini_core::{
    deformation::{Law, Moduli, Press, SoftBody},
    fem::{Fem, Options},
    geometry::Shape,
};

const MM: f64 = 1e-3;

/// A pad of 20.75 × 25.25 × 4 mm, finer in the middle.
fn pad(cells: [usize; 3], friction: f64) -> Fem {
    let [x, y] = [(10.375 * MM, cells[0]), (12.625 * MM, cells[1])]
        .map(|(half, count)| graded(half, count, 4.0));
    let mesh = grid(&x, &y, &even(-4.0 * MM, 0.0, cells[2]));
    let base = nodes_where(&mesh, |p| p.z < -3.999 * MM);
    let gel = Moduli { young: 2e5, poisson: 0.48 };
    let body = SoftBody::new(mesh, Law::default(), gel, &base).expect("a pad is a body");
    Fem::new(body, Options { friction, ..Options::default() }).expect("the options are valid")
}

/// A ball pressed in by 1 mm in ten frames, then moved aside by 0.5 mm in ten.
fn path() -> Press {
    let at = |x: f64, depth: f64| vec![Isometry3::translation(x, 0.0, 4.0 * MM - depth)];
    let down = (1..=10).map(|i| at(0.0, 0.1 * MM * f64::from(i)));
    let aside = (1..=10).map(|i| at(0.05 * MM * f64::from(i), MM));
    let ball = vec![Shape::Sphere { radius: 4.0 * MM }];
    Press::along(ball, down.chain(aside).collect()).expect("a path of finite poses")
}

fn frames(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("20 frames");
    group.sample_size(10);
    for cells in [[14, 16, 3], [18, 22, 6], [28, 34, 9]] {
        for friction in [0.0, 0.5] {
            let fem = pad(cells, friction);
            let name = format!("{} nodes, μ {friction}", fem.body().mesh().vertices.len());
            let press = path();
            group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
                bencher.iter(|| fem.solve_path(&press));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
