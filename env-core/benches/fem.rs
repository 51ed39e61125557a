//! Time of a converged frame on the path of a ball into a gel pad, and of a whole grasp, on one
//! thread.
//!
//! Goals: 25 ms per frame on about 1,000 nodes, 150 ms on 3,000, 1 s on 10,000; 5 s per grasp of 50
//! frames on 900.

#![allow(missing_docs)] // criterion's macros expand to undocumented functions

#[path = "../../tests/physics/bodies.rs"]
mod bodies;

use std::f64::consts::FRAC_PI_2;

use bodies::{gel_pad, press_and_shear};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use ruffini_core::{
    deformation::{Moduli, SoftBody, Wrench},
    fem::{Fem, FemOptions, Grasp},
    geometry::Shape,
    sensor::Sensor,
};

fn frames(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("20 frames");
    group.sample_size(10);
    for cells in [[14, 16, 3], [18, 22, 6], [28, 34, 9]] {
        for friction in [0.0, 0.5] {
            let options = FemOptions { friction, ..FemOptions::default() };
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

/// Poses of two pads that face each other along x, with `gap` (m) between their bases and shifted
/// by `aside` (m) along z.
fn facing(gap: f64, aside: f64) -> [Isometry3<f64>; 2] {
    [1.0, -1.0].map(|side| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), side * FRAC_PI_2);
        Isometry3::from_parts(Vector3::new(-side * 0.5 * gap, 0.0, aside).into(), turn)
    })
}

/// Times grasps by two pads of the GelSight Mini, closed by 1.36 mm in 35 frames and then moved
/// sideways by 0.45 mm in 15.
fn grasps(criterion: &mut Criterion) {
    let sensor = Sensor::named("gelsight-mini").expect("the sensor is known");
    let gel = &sensor.calibrations[0];
    let pad = sensor.pad(1000).expect("a pad has that many nodes");
    let top = pad.mesh.vertices.iter().map(|p| p.z).fold(f64::MIN, f64::max);
    let moduli = Moduli::from(gel);
    let law = gel.law.parse().expect("the law is known");
    let body = SoftBody::new(pad.mesh, law, moduli, &pad.base).expect("a pad is a body");
    let fem = Fem::new(body, FemOptions { friction: 0.8, ..FemOptions::default() });
    let fem = fem.expect("the options are valid");
    let half_extents = Vector3::new(0.010, 0.008, 0.006);
    let crooked = UnitQuaternion::from_scaled_axis(Vector3::new(0.01, 0.02, 0.01));
    let straight = UnitQuaternion::identity();
    let mut group = criterion.benchmark_group("grasp of 50 frames");
    group.sample_size(10);
    for (name, object, turn, wide) in [
        ("ball", Shape::Sphere { radius: 0.012 }, straight, 0.02398),
        ("cylinder", Shape::Cylinder { radius: 0.01, half_height: 0.015 }, straight, 0.01998),
        ("crooked box", Shape::Cuboid { half_extents }, crooked, 0.0204),
    ] {
        let gap = wide + 2.0 * top;
        let closing = (0..35).map(|i| facing(gap - 4e-5 * f64::from(i), 0.0));
        let moving = (1..=15).map(|i| facing(gap - 4e-5 * 34.0, 3e-5 * f64::from(i)));
        let start = Isometry3::from_parts(Vector3::zeros().into(), turn);
        let path = closing.chain(moving).collect();
        let grasp = Grasp { object, start, path, load: Wrench::default() };
        group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
            bencher.iter(|| {
                let frames = grasp.solve([&fem, &fem]);
                assert!(frames.len() == 50 && frames.last().is_some_and(Result::is_ok), "{name}");
            });
        });
    }
    group.finish();
}

criterion_group!(benches, frames, grasps);
criterion_main!(benches);
