//! Training from end to end, on presses of a ball solved by finite elements on the model mesh
//! itself.

use nalgebra::Isometry3;

use super::{
    Surrogate, adam,
    answer::SHIPPED,
    budget::{Budget, Pace},
    corrector::{Corrector, CorrectorConfig},
    features::{PadInput, Target, flat},
    graph::PadGraph,
    linear::{LinearBaseline, LinearStress, body},
    loss::parts,
    material::PadMaterial,
    samples::{Gels, Sample},
    train::{Trainer, Training},
    weights,
};
use crate::{
    compliance::nodal::ContactResolution,
    deformation::{DeformationModel, Moduli, Press, Wanted},
    fem::{Fem, FemOptions},
    geometry::Shape,
    sensor::Sensor,
};

const GEL: Moduli = Moduli { young: 3e5, poisson: 0.47 };
const FRICTION: f64 = 0.8;

/// Press of a ball to `depth` (m) near the middle of a face, above it if negative.
fn press(depth: f64) -> Press {
    let pose = Isometry3::translation(1e-3, 0.5e-3, 0.004 - depth);
    Press::along(vec![Shape::Sphere { radius: 0.004 }], vec![vec![pose]]).unwrap()
}

/// Returns gels without linear models, for samples made by hand.
fn gels(graph: PadGraph) -> Gels {
    Gels::of(vec![graph])
}

fn samples(depths: &[f64]) -> (PadGraph, Vec<Sample>) {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let pad = sensor.pad(1000).unwrap();
    let graph = PadGraph::new(&pad).unwrap();
    let gel = PadMaterial { moduli: GEL, friction: FRICTION, thickness: sensor.outline.thickness };
    let linear = LinearBaseline::new(&sensor, &gel, 1000, &pad, ContactResolution::FAST).unwrap();
    let options = FemOptions { friction: FRICTION, ..FemOptions::default() };
    let elements = Fem::new(body(&pad, GEL).unwrap(), options).unwrap();
    let sample = |&depth: &f64| {
        let press = press(depth);
        let answer = linear.path(&press).swap_remove(0).unwrap();
        let target = elements.solve_path(&press).swap_remove(0).unwrap();
        let (places, shapes) = (&pad.mesh.vertices, press.shapes());
        let mut forces = flat(&target.contact_force, gel.force());
        forces.truncate(3 * graph.columns);
        Sample {
            graph: 0,
            gel: 0,
            grasp: "ball/000".to_owned(),
            input: PadInput::new(
                &graph,
                &gel,
                places,
                shapes,
                &linear.carry(&answer, LinearStress::OF_NETWORK).unwrap(),
            ),
            target: Target {
                displacement: flat(&target.displacement, gel.thickness),
                stress: target.von_mises.iter().map(|s| (s / GEL.shear()) as f32).collect(),
                forces,
                force: (target.wrench.force / gel.force()).map(|x| x as f32).into(),
            },
        }
    };
    let samples = depths.iter().map(sample).collect();
    (graph, samples)
}

fn small() -> Training {
    let network = CorrectorConfig { width: 16, corner: 8, ..CorrectorConfig::default() };
    Training { network, epochs: 2, batch: 4, ..Training::default() }
}

/// Returns the steps of an epoch in a training run of `epochs` epochs.
fn steps(epochs: usize) -> impl FnMut(&Trainer<Corrector>, usize) -> crate::Result<Option<f64>> {
    let pace = Pace::new(Budget::Epochs(epochs), &|| 0.0);
    move |trainer, batches| Ok(pace.share(trainer.adam.steps, batches))
}

#[test]
fn every_parameter_gets_a_gradient() {
    let (graph, samples) = samples(&[8e-4]);
    let mut trainer = Trainer::<Corrector>::new(small()).unwrap();
    // Output layers start at zero and block the gradients of the layers before them until they have
    // moved.
    for _ in 0..2 {
        trainer.epoch(&gels(graph.clone()), &samples, &mut steps(2)).unwrap().unwrap();
    }
    let loss = parts(&trainer.network, &[&samples[0]], &graph, 0).unwrap().total().unwrap();
    let variables = trainer.parameters.all();
    let gradients = adam::gradients(&variables, &loss.backward().unwrap()).unwrap();
    for (name, gradient) in &gradients {
        assert!(gradient.iter().any(|g| *g != 0.0), "{name} gets none");
    }
}

#[test]
fn one_press_can_be_learnt_by_heart() {
    let (graph, samples) = samples(&[1e-3]);
    let network = CorrectorConfig::default();
    let training = Training { epochs: 1500, rate: 2e-3, mirrors: false, network, ..small() };
    let mut trainer = Trainer::<Corrector>::new(training).unwrap();
    let gels = gels(graph.clone());
    let before = parts(&trainer.network, &[&samples[0]], &graph, 0).unwrap().values().unwrap();
    for _ in 0..1500 {
        trainer.epoch(&gels, &samples, &mut steps(1500)).unwrap().unwrap();
    }
    let after = parts(&trainer.network, &[&samples[0]], &graph, 0).unwrap().values().unwrap();
    assert!(before[0] > 0.02 && before[3] > 0.02, "nothing to learn: {before:?}");
    let is_learnt = |part: usize| after[part] < 0.125 * before[part];
    assert!([0, 1, 3].into_iter().all(is_learnt), "{after:?}, {before:?} before");
}

#[test]
fn a_resumed_training_is_the_same_to_the_bit() {
    let (graph, samples) = samples(&[4e-4, 8e-4]);
    let gels = gels(graph);
    let mut straight = Trainer::<Corrector>::new(small()).unwrap();
    let mut first = Trainer::<Corrector>::new(small()).unwrap();
    for _ in 0..2 {
        straight.epoch(&gels, &samples, &mut steps(2)).unwrap().unwrap();
    }
    first.epoch(&gels, &samples, &mut steps(2)).unwrap().unwrap();
    let mut resumed = Trainer::<Corrector>::new(small()).unwrap();
    resumed.restore(&first.vectors().unwrap(), first.epoch, first.adam.steps).unwrap();
    resumed.epoch(&gels, &samples, &mut steps(2)).unwrap().unwrap();
    assert_eq!(straight.vectors().unwrap(), resumed.vectors().unwrap());
}

#[test]
fn without_contact_the_answer_is_exactly_zero() {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let network = Surrogate::new(&sensor, GEL, FRICTION).unwrap();
    let answer = network.solve_path(&press(-1e-4)).swap_remove(0).unwrap();
    assert!(answer.displacement.iter().chain(&answer.contact_force).all(|v| v.norm() == 0.0));
    assert_eq!(answer.wrench.force.norm(), 0.0);
    let is_in_distribution = |displacement: &[nalgebra::Vector3<f64>], poses: &[Isometry3<f64>]| {
        network.is_in_distribution(
            press(0.0).shapes(),
            poses,
            displacement,
            &answer.contact_force,
            0.0,
        )
    };
    assert!(is_in_distribution(&answer.displacement, &answer.poses));
    let deepest = network.card().data.amplitude * sensor.outline.thickness;
    let deep = vec![nalgebra::Vector3::z() * -1.01 * deepest; answer.displacement.len()];
    assert!(!is_in_distribution(&deep, &answer.poses), "farther than it ever saw");
    let unfelt = [Isometry3::translation(0.0, 0.0, -1e-5) * answer.poses[0]];
    assert!(is_in_distribution(&answer.displacement, &unfelt), "still above the skin");
    let unfelt = [Isometry3::translation(0.0, 0.0, -1.1e-4) * answer.poses[0]];
    assert!(!is_in_distribution(&answer.displacement, &unfelt), "in the skin, and nothing felt");
}

#[test]
fn plainly_evaluated_it_answers_the_same() {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let fast = Surrogate::new(&sensor, GEL, FRICTION).unwrap();
    let plain = fast.plain().solve_path(&press(6e-4)).swap_remove(0).unwrap();
    let answer = fast.solve_path(&press(6e-4)).swap_remove(0).unwrap();
    let near = |found: &[f64], oracle: &[f64]| {
        let scale = oracle.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let near = found.iter().zip(oracle).all(|(a, b)| (a - b).abs() < 1e-4 * scale);
        assert!(found.len() == oracle.len() && scale > 0.0 && near, "of {scale}");
    };
    let flat = |vectors: &[nalgebra::Vector3<f64>]| -> Vec<f64> {
        vectors.iter().flat_map(|v| [v.x, v.y, v.z]).collect()
    };
    near(&flat(&answer.displacement), &flat(&plain.displacement));
    near(&flat(&answer.contact_force), &flat(&plain.contact_force));
    near(&answer.von_mises, &plain.von_mises);
    let moved =
        fast.plain().solve_partially(&[press(6e-4)], Wanted::default()).swap_remove(0).unwrap();
    near(&flat(&answer.displacement), &flat(&moved.displacement));
}

#[test]
fn stress_is_in_proportion_to_youngs_modulus() {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let stiff = Moduli { young: 2.0 * GEL.young, ..GEL };
    let answer = |moduli| {
        let network = Surrogate::new(&sensor, moduli, FRICTION).unwrap();
        network.solve_path(&press(6e-4)).swap_remove(0).unwrap()
    };
    let (soft, stiff) = (answer(GEL), answer(stiff));
    let ratio = stiff.wrench.force.z / soft.wrench.force.z;
    // The contact solver's tolerance is an absolute force, the same for both.
    assert!((ratio / 2.0 - 1.0).abs() < 1e-3, "{ratio} for 2");
    let (high, low) = (stiff.von_mises[100], soft.von_mises[100]);
    assert!((high / low / 2.0 - 1.0).abs() < 5e-3, "{high} Pa for twice {low} Pa");
}

#[test]
fn a_force_is_that_of_the_answer() {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let network = Surrogate::new(&sensor, GEL, FRICTION).unwrap();
    let down = -nalgebra::Vector3::z();
    let start = vec![Isometry3::translation(0.0, 0.0, 0.0045)];
    let ball = vec![Shape::Sphere { radius: 0.004 }];
    let press = Press::with_force(ball, start, 1.5, down).unwrap();
    let answer = network.solve_path(&press).swap_remove(0).unwrap();
    let force = answer.wrench.force.dot(&down);
    assert!((force / 1.5 - 1.0).abs() < 1e-3, "{force} N for 1.5 N");
}

#[test]
fn damaged_weights_are_named() {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let folder = std::env::temp_dir().join(format!("ruffini-weights-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("weights.safetensors");
    let message = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let loaded = Surrogate::load(&path, &sensor, GEL, FRICTION);
        loaded.map(|_| ()).unwrap_err().to_string()
    };
    let good = SHIPPED;
    assert!(message(b"").contains("weights.safetensors"));
    assert!(message(&good[..good.len() - 4]).contains("weights.safetensors"));
    let mut flipped = good.to_vec();
    flipped[good.len() / 2] ^= 1;
    assert!(message(&flipped).contains("SHA-256"));
    // A header that announces more bytes than there are allocates nothing.
    assert!(message(&[&u64::MAX.to_le_bytes()[..], b"{}"].concat()).contains("weights"));
    let (mut vectors, card): (_, weights::Card) = weights::from_bytes("pads", good).unwrap();
    let (_, values) = vectors.values_mut().next().unwrap();
    values[0] = f32::NAN;
    assert!(message(&weights::to_bytes(&vectors, &card)).contains("expected finite numbers"));
    let (mut vectors, card): (_, weights::Card) = weights::from_bytes("pads", good).unwrap();
    vectors.remove("corners.weight");
    assert!(message(&weights::to_bytes(&vectors, &card)).contains("corners.weight: missing"));
    let (vectors, mut card): (_, weights::Card) = weights::from_bytes("pads", good).unwrap();
    card.network.width += 1;
    assert!(message(&weights::to_bytes(&vectors, &card)).contains("expected"));
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Checks that an untrained network corrects nothing.
#[test]
fn an_untrained_network_is_the_linear_answer_but_for_the_strain() {
    let (graph, samples) = samples(&[8e-4]);
    let network = Corrector::new(
        &CorrectorConfig::default(),
        &super::parameters::Parameters::drawn(0).builder(),
    );
    let input = &samples[0].input;
    let batch = super::corrector::PadBatch::new(&[input]).unwrap();
    let answer = network.unwrap().forward(&batch, &graph).unwrap();
    let displacement: Vec<f32> = answer.displacement.flatten_all().unwrap().to_vec1().unwrap();
    assert_eq!(displacement, input.displacement);
    let stress: Vec<f32> = answer.stress.flatten_all().unwrap().to_vec1().unwrap();
    assert_eq!(stress, input.stress);
}
