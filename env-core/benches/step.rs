//! Environment steps per second on one thread: `cargo bench --bench step`.

use std::{hint::black_box, sync::Arc};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use ruffini_core::{
    env::{Autoreset, Batch, Setup},
    scene::CATALOGUE,
    task::{Config, ObjectSpec},
};

const ROWS: usize = 16;

fn batch(objects: &[&str]) -> Batch {
    let objects = objects.iter().map(|name| ObjectSpec::Name((*name).into())).collect();
    let setup = Setup::new(Config { objects, ..Config::default() }).expect("default settings hold");
    let mut batch = Batch::new(Arc::new(setup), ROWS, 1, Autoreset::NextStep).expect("16 rows");
    batch.seed(&(0..ROWS as u64).map(Some).collect::<Vec<_>>()).expect("one seed a row");
    batch.reset(None).expect("default settings reset");
    batch
}

/// Actions (N, 5) that wander through the workspace and open and close, the same on every run.
fn actions(step: usize) -> Vec<f32> {
    let phase = |i: usize| (0.61 * i as f32 + 0.13 * step as f32).sin();
    (0..5 * ROWS).map(phase).collect()
}

fn steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step");
    group.throughput(Throughput::Elements(ROWS as u64));
    let all = Config::default().objects;
    let all: Vec<_> = all.iter().map(ToString::to_string).collect();
    let all: Vec<_> = all.iter().map(String::as_str).collect();
    let cases = CATALOGUE.iter().map(|name| (*name, vec![*name]));
    for (name, objects) in std::iter::once(("default objects", all)).chain(cases) {
        let (mut batch, mut step) = (batch(&objects), 0);
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                step += 1;
                black_box(batch.step(&actions(step)).expect("a running batch"))
            });
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20);
    targets = steps
}
criterion_main!(benches);
