//! Time of a frame at 640 × 480 on one core, with and without antialiasing.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Isometry3, Vector3};
use ruffini_core::{
    geometry::Shape,
    render::{Color, Finish, GripperParts, Item, PinholeCamera, RenderMesh, Renderer, table},
};

fn frames(criterion: &mut Criterion) {
    let (parts, table) = (GripperParts::default(), table());
    let cup = Shape::Cup { bottom: 0.022, rim: 0.032, half_height: 0.035, wall: 0.002 };
    let cup = RenderMesh::new(&cup.surface(48).expect("a cup is finite"));
    let top = Item::new(&table, Isometry3::identity(), Color::srgb(214, 211, 205));
    let held = Isometry3::translation(0.0, 0.0, 0.065);
    let mut items = parts.items(&Isometry3::new(Vector3::z() * 0.065, Vector3::z()), [0.027; 2]);
    items.push(top.with_finish(Finish::Ground { spacing: 0.025 }));
    items.push(Item::new(&cup, held, Color::srgb(64, 132, 190)));
    let mut group = criterion.benchmark_group("a frame of 640 x 480");
    group.throughput(Throughput::Elements(1));
    for samples in [1, 2] {
        let mut renderer = Renderer::with_samples(640, 480, samples).expect("a valid size");
        let mut picture = vec![0; 640 * 480 * 3];
        group.bench_function(format!("{samples} x {samples} samples a pixel"), |bencher| {
            bencher.iter(|| {
                let camera = black_box(PinholeCamera::default());
                renderer.draw_into(&camera, &items, &mut picture).expect("valid items");
            });
        });
    }
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
