//! Time of a press of a ball into a gel pad by linear compliance, compared with finite elements.
//!
//! Goal: 0.5 ms per press on about 1,000 nodes, on one thread, without corrections.

#![allow(missing_docs)] // criterion's macros expand to undocumented functions

#[allow(dead_code)] // Each of its users needs a part of it.
#[path = "../../tests/physics/bodies.rs"]
mod bodies;

use std::{f64::consts::FRAC_PI_2, hint::black_box};

use bodies::{gel_pad, press_and_shear};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{Isometry3, Vector3};
use ruffini_core::{
    compliance::{Compliance, ComplianceOptions},
    deformation::{DeformationModel, History, Press},
    fem::{Fem, FemOptions},
    geometry::Shape,
    objects::{Object, catalogue},
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

/// Press that moves a ball 0.5 mm deep by another 50 µm, as in a control step of an environment.
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
        let options = FemOptions { friction: FRICTION, ..FemOptions::default() };
        let fem = Fem::new(body.clone(), options).expect("the options are valid");
        let models = [0, 4].map(|corrections| {
            let options = ComplianceOptions { friction: FRICTION, corrections };
            (corrections, Compliance::new(body.clone(), options).expect("the pad is bonded"))
        });
        let mut begun = models[0].1.solve(&[pressed(0.5 * MM)]);
        let history = begun.remove(0).expect("a shallow press").history;
        let presses_by_name = [
            ("0.5 mm", pressed(0.5 * MM)),
            ("1 mm", pressed(MM)),
            ("onwards", moved_on(history)),
            ("0.3 N", pushed(0.3)),
            ("20 frames", press_and_shear()),
        ];
        for (name, press) in presses_by_name {
            let id = |who: &str| BenchmarkId::new(format!("{nodes} nodes, {name}"), who);
            for (corrections, model) in &models {
                let presses = [press.clone()];
                group.bench_function(id(&format!("{corrections} corrections")), |bencher| {
                    bencher.iter(|| black_box(model.solve(&presses)));
                });
            }
            let presses = [press];
            group.bench_function(id("fem"), |b| b.iter(|| black_box(fem.solve(&presses))));
        }
    }
    group.finish();
}

/// Shapes turned so that their lowest part touches, with the pose of first touch.
fn objects() -> Vec<(&'static str, Shape, Isometry3<f64>)> {
    let about_y = |angle: f64| Isometry3::rotation(Vector3::y() * angle);
    let cylinder = Shape::Cylinder { radius: 10.0 * MM, half_height: 30.0 * MM };
    let cuboid = Shape::Cuboid { half_extents: Vector3::repeat(15.0 * MM) };
    let is_star = |object: &Object| matches!(object.shape, Shape::StarShaped(_));
    let star = catalogue(1).into_iter().find(is_star).expect("the catalogue has fruit").shape;
    let solids = [
        ("ball", ball().remove(0), Isometry3::identity()),
        ("edge", cuboid, about_y(0.5)),
        ("cylinder", cylinder, about_y(FRAC_PI_2)),
        ("star", star, Isometry3::identity()),
    ];
    let on_top = |(name, shape, turn): (&'static str, Shape, Isometry3<f64>)| {
        let surface = shape.surface(128).expect("no half-space");
        let lowest = surface.vertices().iter().map(|v| (turn * v).z).fold(0.0, f64::min);
        (name, shape, Isometry3::translation(0.0, 0.0, -lowest) * turn)
    };
    solids.into_iter().map(on_top).collect()
}

/// Times a control step of 0.1 mm after a press of 0.5 mm (deeper, sideways, and a rotation), the
/// first touch, and ten frames from there, for each object.
fn steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step");
    group.sample_size(20);
    let options = ComplianceOptions { friction: FRICTION, corrections: 0 };
    let model = Compliance::new(gel_pad([14, 16, 3]), options).expect("the pad is bonded");
    for (object, shape, top) in objects() {
        let at = |x: f64, depth: f64| vec![Isometry3::translation(x, 0.0, -depth) * top];
        let along = |path| Press::along(vec![shape.clone()], path).expect("finite poses");
        let down = |frames: i32| (1..=frames).map(|i| at(0.0, 0.1 * MM * f64::from(i))).collect();
        let begun = model.solve(&[along(down(5))]).remove(0).expect("a shallow press").history;
        let then = |poses| along(vec![poses]).after(begun.clone()).expect("the same shapes");
        let twist = Isometry3::rotation(Vector3::z() * 1f64.to_radians());
        let presses_by_name = [
            ("on", then(at(0.0, 0.6 * MM))),
            ("aside", then(at(0.1 * MM, 0.5 * MM))),
            ("round", then(vec![twist * at(0.0, 0.5 * MM)[0]])),
            ("first touch", along(down(1))),
            ("10 frames", along(down(10))),
        ];
        for (name, press) in presses_by_name {
            let id = |who: &str| BenchmarkId::new(format!("{object}, {name}"), who);
            let presses = [press];
            group.bench_function(id("whole"), |b| b.iter(|| black_box(model.solve(&presses))));
        }
    }
    group.finish();
}

criterion_group!(benches, presses, steps);
criterion_main!(benches);
