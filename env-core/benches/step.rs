//! Environment steps per second on one thread, rigid and tactile, and the cost of soft pads in a
//! grasp: `cargo bench --bench step`.

use std::{hint::black_box, sync::Arc};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::Isometry3;
use ruffini_core::{
    deformation::Wrench,
    env::{Autoreset, Batch, Setup},
    scene::{CATALOGUE, Command, ObjectModel, Scene, SceneConfig, SceneObject, SoftPads, named},
    sensor::Sensor,
    tactile::Choice,
    task::{ObjectSpec, Task, TaskConfig},
};

const ROWS: usize = 16;

fn batch(objects: &[&str]) -> Batch {
    let objects = objects.iter().map(|name| ObjectSpec::Name((*name).into())).collect();
    started(TaskConfig { objects, tactile: Choice::None, ..TaskConfig::default() })
}

fn started(config: TaskConfig) -> Batch {
    let setup = Setup::new(config).expect("settings hold");
    let mut batch = Batch::new(Arc::new(setup), ROWS, 1, Autoreset::NextStep).expect("16 rows");
    batch.seed(&(0..ROWS as u64).map(Some).collect::<Vec<_>>()).expect("one seed a row");
    batch.reset(None).expect("settings reset");
    batch
}

/// Actions (N, 5) that move the hand through the workspace and open and close it, the same in every
/// run.
fn actions(step: usize) -> Vec<f32> {
    let phase = |i: usize| (0.61 * i as f32 + 0.13 * step as f32).sin();
    (0..5 * ROWS).map(phase).collect()
}

fn steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step");
    group.throughput(Throughput::Elements(ROWS as u64));
    let all = TaskConfig::default().objects;
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

/// Times a control step of 40 ms in which both fingers hold an object of 100 g with 5 N and its
/// state is read; soft pads are also corrected.
fn grasps(criterion: &mut Criterion) {
    let sensor = Sensor::named("gelsight-mini").expect("a known sensor");
    let soft = SoftPads::new(&sensor, &sensor.calibrations[0]);
    let configs =
        [("rigid", SceneConfig::default()), ("soft", SceneConfig::default().with_pads(soft))];
    let mut group = criterion.benchmark_group("grasp");
    for name in ["sphere", "cuboid", "cylinder", "prism", "cup", "potato"] {
        let model = ObjectModel::new(named(name).expect("a known name")).expect("a sound shape");
        for (pads, config) in &configs {
            let pose = Isometry3::translation(0.0, 0.0, 0.1);
            let object = SceneObject { model: &model, scale: 1.0, mass: 0.1, friction: 0.8, pose };
            let tool_center = pose.translation.vector;
            let mut scene = Scene::new(config, &object, &tool_center, 0.0).expect("a sound scene");
            let hold = Command { grip: 5.0, ..Command::default() };
            scene.set_gravity(0.0);
            (0..25).for_each(|_| scene.step(&hold));
            scene.set_gravity(config.physics.gravity);
            group.bench_function(format!("{name}, {pads}"), |bencher| {
                bencher.iter(|| {
                    scene.step(&hold);
                    let wrenches = scene.state().fingers.map(|finger| finger.wrench);
                    for (finger, wrench) in wrenches.iter().enumerate() {
                        scene.correct(finger, black_box::<&Wrench>(wrench));
                    }
                });
            });
        }
    }
    group.finish();
}

/// Times environment steps in which both fingers hold an object with 20 N and observe the markers.
fn touches(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("touch");
    group.throughput(Throughput::Elements(ROWS as u64));
    for name in ["sphere", "cuboid", "cylinder", "prism", "potato"] {
        let mut config = TaskConfig::of(&Task::named("HoldStill").expect("a known task"));
        config.objects = vec![ObjectSpec::Name(name.into())];
        config.tactile = Choice::Surrogate;
        config.scene.gripper.max_force = 40.0;
        config.observation = Some(["proprio", "wrench", "markers"].map(String::from).into());
        config.set("start_grip", &20.0.into()).expect("a setting of HoldStill");
        let mut batch = started(config);
        let hold = [0.0; 5].repeat(ROWS);
        group.bench_function(name, |bencher| {
            bencher.iter(|| black_box(batch.step(&hold).expect("a running batch")));
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20);
    targets = steps, grasps, touches
}
criterion_main!(benches);
