//! Frames of a dataset of squeezes with their linear solutions.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    sync::Arc,
};

use candle_core::{Device, Tensor};
use candle_nn::VarBuilder;
use nalgebra::{Isometry3, Vector3};

use super::{
    graph::ObjectGraph,
    grip::Grip,
    input::ObjectInput,
    linear::SoftBaseline,
    network::{Soft, SoftConfig},
};
use crate::{
    Result,
    dataset::{SqueezeFrames, Squeezes},
    deformation::{Deformation, Press},
    geometry::Shape,
    objects::FamilySplit,
    surrogate::{
        features::{Fields, Target},
        loss::{WEIGHTS, relative},
        material::PadMaterial,
        samples::in_units,
        train::{Loss, Network, mirror_signs},
        training_run::{self, Watch},
    },
};

/// A solved frame.
pub(super) struct SoftSample {
    /// Index of the object.
    pub(super) object: usize,
    /// Name of its grasp.
    pub(super) grasp: String,
    /// Part of the data to which it belongs.
    pub(super) part: Part,
    /// Units: the object's material and size, and the friction.
    pub(super) unit: PadMaterial,
    pub(super) input: ObjectInput,
    /// The linear solution's time (s).
    pub(super) seconds: f64,
    pub(super) target: Target,
}

/// Part of the data to which a grasp belongs: of ten grasps of an object of a known family the last
/// is for evaluation and the one before it for validation; all of a novel one are for evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Part {
    Train,
    Validation,
    Known,
    Novel,
}

/// The objects of a dataset, and its frames.
pub(super) struct Objects {
    pub(super) graphs: Vec<Arc<ObjectGraph>>,
    /// Number of frames that the linear model failed to solve.
    pub(super) lost: usize,
}

impl Objects {
    /// Reads the objects and frames of a dataset; `None` if `watch` stops it.
    pub(super) fn read(data: &Squeezes, watch: Watch) -> Result<Option<(Self, Vec<SoftSample>)>> {
        let mut meshes = BTreeMap::new();
        for shard in 0..data.shards() {
            let name = data.read(shard)?.0.name.clone();
            if let Entry::Vacant(vacant) = meshes.entry(name) {
                let mesh = data.mesh(vacant.key())?;
                vacant.insert(mesh);
            }
        }
        let graphs: Vec<_> = meshes.values().map(ObjectGraph::new).map(Arc::new).collect();
        let gels = &data.config().gels;
        let shard = |shard: usize| -> Result<(Vec<SoftSample>, usize)> {
            let (object, grasps) = data.read(shard)?;
            let number = meshes.keys().position(|name| *name == object.name);
            let number = number.expect("every shard's object has its mesh");
            let graph = &graphs[number];
            let (mut samples, mut lost, mut models) = (Vec::new(), 0, BTreeMap::new());
            for frames in &grasps {
                let gel = &gels[frames.gel];
                let moduli = gel.moduli();
                if let Entry::Vacant(vacant) = models.entry(frames.gel) {
                    let fine = object.tets_within(data.config().truth_nodes)?;
                    vacant.insert(SoftBaseline::new(
                        fine,
                        &meshes[&object.name],
                        moduli,
                        gel.friction,
                    )?);
                }
                let unit = PadMaterial { moduli, friction: gel.friction, thickness: graph.length };
                let outline = gel.sensor()?.outline;
                let half = 0.5 * Vector3::new(outline.width, outline.length, outline.thickness);
                let answers = answers(&models[&frames.gel], frames, &half)?;
                lost += frames.fingers[0].len() - answers.len();
                let part = part(object.split, &frames.grasp);
                samples.extend(answers.iter().enumerate().map(|(i, answer)| {
                    let grip = Grip::of(&half, &answer.poses);
                    let input = ObjectInput::new(graph, &unit, &grip, answer);
                    let target = target(frames, i, &input.shares, &unit);
                    let (grasp, seconds) = (frames.grasp.clone(), answer.seconds);
                    SoftSample { object: number, grasp, part, unit, input, seconds, target }
                }));
            }
            Ok((samples, lost))
        };
        let Some(shards) = training_run::shards(data.shards(), shard, watch)? else {
            return Ok(None);
        };
        let lost = shards.iter().map(|(_, lost)| lost).sum();
        let samples = shards.into_iter().flat_map(|(samples, _)| samples).collect();
        Ok(Some((Self { graphs, lost }, samples)))
    }
}

fn part(split: FamilySplit, grasp: &str) -> Part {
    let number: usize = grasp.rsplit('/').next().and_then(|n| n.parse().ok()).unwrap_or_default();
    match (split, number % 10) {
        (FamilySplit::Novel, _) => Part::Novel,
        (_, 9) => Part::Known,
        (_, 8) => Part::Validation,
        _ => Part::Train,
    }
}

/// Linear solutions to the frames of a grasp, up to the first that fails.
fn answers(
    model: &SoftBaseline,
    frames: &SqueezeFrames,
    half: &Vector3<f64>,
) -> Result<Vec<Deformation>> {
    let finger = Shape::Cuboid { half_extents: *half };
    let back = Isometry3::translation(0.0, 0.0, -half.z);
    let path = frames.fingers[0].iter().zip(&frames.fingers[1]);
    let path = path.map(|(a, b)| vec![a * back, b * back]).collect();
    let press = Press::along(vec![finger; 2], path)?;
    Ok(model.path(&press).into_iter().map_while(Result::ok).collect())
}

/// Finite elements' solution of a frame.
fn target(frames: &SqueezeFrames, frame: usize, shares: &[f32], unit: &PadMaterial) -> Target {
    let part = |field: &[f32], unit: f64| in_units(field, frame, frames.fingers[0].len(), unit);
    let forces = part(&frames.contact_force, unit.force());
    let force = squeezing(&forces, shares);
    Target {
        displacement: part(&frames.displacement, unit.thickness),
        stress: part(&frames.von_mises, unit.moduli.shear()),
        forces,
        force,
    }
}

/// Half the difference of the forces of two fingers, from forces on nodes.
pub(super) fn squeezing(forces: &[f32], shares: &[f32]) -> [f32; 3] {
    let nodes = forces.as_chunks::<3>().0.iter().zip(shares);
    nodes.fold([0.0; 3], |sum, (force, share)| std::array::from_fn(|i| sum[i] + share * force[i]))
}

impl Network for Soft {
    type Config = SoftConfig;
    type Sample = SoftSample;
    type Ground = Objects;

    fn new(config: &SoftConfig, vb: &VarBuilder) -> candle_core::Result<Self> {
        Self::new(config, vb)
    }

    fn graph(_sample: &SoftSample) -> usize {
        0
    }

    fn target<'a>(_objects: &'a Objects, sample: &'a SoftSample) -> (&'a Target, &'a PadMaterial) {
        (&sample.target, &sample.unit)
    }

    fn loss(&self, objects: &Objects, samples: &[&SoftSample], mirror: usize) -> Result<Loss> {
        let mut total = Tensor::zeros((), candle_core::DType::F32, &Device::Cpu)?;
        let mut parts = [0.0; 4];
        for sample in samples {
            let graph = &objects.graphs[sample.object];
            let answer = self.forward(&sample.input, graph, &mirror_signs(mirror).into())?;
            let target = &sample.target;
            let errors = [
                (&answer.displacement, &target.displacement[..]),
                (&answer.stress, &target.stress),
                (&answer.forces, &target.forces),
                (&answer.force, &target.force),
            ];
            for (i, (found, target)) in errors.into_iter().enumerate() {
                let target = Tensor::from_slice(target, (1, target.len()), &Device::Cpu)?;
                let error = relative(&found.reshape(target.shape())?, &target)?.mean_all()?;
                parts[i] += error.to_scalar::<f32>()? / samples.len() as f32;
                total = (total + (error * (WEIGHTS[i] / samples.len() as f64))?)?;
            }
        }
        Ok(Loss { total, parts })
    }

    fn answer(&self, objects: &Objects, sample: &SoftSample) -> Result<Fields> {
        let graph = &objects.graphs[sample.object];
        let answer = self.forward(&sample.input, graph, &mirror_signs(0).into())?;
        Ok(Fields::of([&answer.displacement, &answer.stress, &answer.forces, &answer.force])?)
    }
}
