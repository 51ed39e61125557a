//! Time of a signed-distance query and of a ray query, for each kind of shape.

use std::{hint::black_box, sync::Arc};

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Point3, Vector3};
use ruffini_core::geometry::{Shape, StarShaped, Wave};

fn shapes() -> Vec<(&'static str, Shape)> {
    let v = Vector3::new(0.01, 0.02, 0.03);
    let wave = |i: i32| Wave {
        amplitude: 0.05,
        vector: Vector3::new(f64::from(i), 2.0, -1.0),
        phase: 0.3 * f64::from(i),
    };
    let star = Shape::StarShaped(StarShaped::new(v, (0..6).map(wave).collect()));
    let mesh = Shape::Mesh(Arc::new(star.surface(64).expect("finite")));
    vec![
        ("sphere", Shape::Sphere { radius: 0.02 }),
        ("cuboid", Shape::Cuboid { half_extents: v }),
        ("cylinder", Shape::Cylinder { radius: 0.02, half_height: 0.03 }),
        ("capsule", Shape::Capsule { radius: 0.01, half_height: 0.02 }),
        ("cone", Shape::Cone { radius: 0.02, half_height: 0.03 }),
        ("prism, 6 sides", Shape::Prism { sides: 6, radius: 0.02, half_height: 0.03 }),
        ("annulus", Shape::Annulus { outer: 0.03, inner: 0.02, half_height: 0.01 }),
        ("ellipsoid", Shape::Ellipsoid { semi_axes: v }),
        ("cup", Shape::Cup { bottom: 0.02, rim: 0.03, half_height: 0.03, wall: 0.003 }),
        ("star-shaped, 6 waves", star),
        ("mesh, 5120 triangles", mesh),
    ]
}

/// Points within 3 mm of the surface, where fingers evaluate distances.
fn points(shape: &Shape) -> Vec<Point3<f64>> {
    let spread = |i: u32, step: f64| 0.08 * ((f64::from(i) * step).fract() - 0.5);
    (0..40_000)
        .map(|i| Point3::new(spread(i, 0.819_173), spread(i, 0.671_044), spread(i, 0.549_700)))
        .filter(|p| shape.distance(p).value.abs() < 0.003)
        .collect()
}

fn queries(criterion: &mut Criterion) {
    for (name, shape) in shapes() {
        let points = points(&shape);
        let mut next = points.iter().cycle();
        criterion.bench_function(&format!("distance/{name}"), |b| {
            b.iter(|| shape.distance(black_box(next.next().expect("points near the surface"))));
        });
        criterion.bench_function(&format!("ray/{name}"), |b| {
            b.iter(|| {
                let point = next.next().expect("points near the surface");
                shape.ray_gap(black_box(point), &-Vector3::x())
            });
        });
    }
}

criterion_group!(benches, queries);
criterion_main!(benches);
