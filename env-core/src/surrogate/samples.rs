//! Training samples from a dataset: each solved frame of each pad with its linear answer.

use nalgebra::Point3;
use rayon::prelude::*;

use super::{
    features::{Gel, Question, Truth},
    graph::PadGraph,
};
use crate::{
    Result,
    compliance::{Compliance, Options},
    dataset::{Config, Dataset, PadFrames},
    deformation::{Deformation, Law, Moduli, Press, SoftBody},
    geometry::{PadMesh, Shape},
    sensor::Sensor,
};

/// A solved frame.
pub(super) struct Sample {
    /// Which of the graphs it lies on.
    pub(super) graph: usize,
    /// Which of the gels.
    pub(super) gel: usize,
    /// Name of its grasp.
    pub(super) grasp: String,
    pub(super) question: Question,
    pub(super) truth: Truth,
}

/// The gels of a dataset with their linear models, and the graphs of their sensors.
pub(super) struct Gels {
    pub(super) graphs: Vec<PadGraph>,
    pub(super) pads: Vec<Pad>,
}

/// A gel of a dataset.
pub(super) struct Pad {
    pub(super) graph: usize,
    pub(super) gel: Gel,
    linear: Compliance,
}

/// A pad mesh of a gel.
pub(super) fn body(pad: &PadMesh, moduli: Moduli) -> Result<SoftBody> {
    SoftBody::new(pad.mesh.clone(), Law::default(), moduli, &pad.base)
}

impl Gels {
    /// Those of `config`.
    pub(super) fn new(config: &Config) -> Result<Self> {
        let mut sensors: Vec<String> = config.gels.iter().map(|gel| gel.sensor.clone()).collect();
        sensors.sort();
        sensors.dedup();
        let meshes = sensors.iter().map(|name| Sensor::named(name)?.pad(config.model_nodes));
        let meshes = meshes.collect::<Result<Vec<_>>>()?;
        let pad = |gel: &crate::dataset::Gel| {
            let graph = sensors.iter().position(|name| *name == gel.sensor).unwrap_or_default();
            let moduli = Moduli { young: gel.young, poisson: gel.poisson };
            let options = Options { friction: gel.friction, sweeps: 0 };
            let linear = Compliance::new(body(&meshes[graph], moduli)?, options)?;
            let thickness = Sensor::named(&gel.sensor)?.outline.thickness;
            Ok(Pad { graph, gel: Gel { moduli, friction: gel.friction, thickness }, linear })
        };
        let pads = config.gels.par_iter().map(pad).collect::<Result<_>>()?;
        Ok(Self { graphs: meshes.iter().map(PadGraph::new).collect::<Result<_>>()?, pads })
    }

    /// Every frame of `dataset` whose grasp is `wanted`, and how many the linear model did not
    /// answer.
    pub(super) fn samples(
        &self,
        dataset: &Dataset,
        wanted: &(dyn Fn(&str) -> bool + Sync),
    ) -> Result<(Vec<Sample>, usize)> {
        let shard = |index: usize| {
            let (object, pads) = dataset.read(index)?;
            let pads = pads.iter().filter(|pad| wanted(&pad.grasp));
            let mut lost = 0;
            let mut samples = Vec::new();
            for pad in pads {
                let found = self.frames(&object.shape, pad)?;
                lost += pad.poses.len() - found.len();
                samples.extend(found);
            }
            Ok((samples, lost))
        };
        let shards: Vec<_> = (0..dataset.shards()).into_par_iter().map(shard).collect::<Result<_>>()?;
        let lost = shards.iter().map(|(_, lost)| lost).sum();
        Ok((shards.into_iter().flat_map(|(samples, _)| samples).collect(), lost))
    }

    fn frames(&self, shape: &Shape, frames: &PadFrames) -> Result<Vec<Sample>> {
        let pad = &self.pads[frames.gel];
        let shapes = [shape.clone().validated()?];
        let path = frames.poses.iter().map(|&pose| vec![pose]).collect();
        let press = Press::along(shapes.to_vec(), path)?;
        let answers = pad.linear.solve_path(&press);
        let places = &pad.linear.body().mesh().vertices;
        let solved = answers.into_iter().enumerate().filter_map(|(i, answer)| Some((i, answer.ok()?)));
        Ok(solved.map(|(frame, linear)| self.sample(pad, frames, frame, places, &shapes, &linear)).collect())
    }

    fn sample(
        &self,
        pad: &Pad,
        frames: &PadFrames,
        frame: usize,
        places: &[Point3<f64>],
        shapes: &[Shape],
        linear: &Deformation,
    ) -> Sample {
        let (graph, gel) = (&self.graphs[pad.graph], &pad.gel);
        let (nodes, tets) = (places.len(), graph.tets());
        let part = |field: &[f32], size: usize, unit: f64| -> Vec<f32> {
            let unit = unit as f32;
            field[frame * size..][..size].iter().map(|x| x / unit).collect()
        };
        let mut forces = part(&frames.contact_force, 3 * nodes, gel.force());
        forces.truncate(3 * graph.columns);
        let wrench = &frames.wrench[6 * frame..];
        Sample {
            graph: pad.graph,
            gel: frames.gel,
            grasp: frames.grasp.clone(),
            question: Question::new(graph, gel, places, shapes, linear),
            truth: Truth {
                displacement: part(&frames.displacement, 3 * nodes, gel.thickness),
                stress: part(&frames.von_mises, tets, gel.moduli.shear()),
                forces,
                force: std::array::from_fn(|i| (wrench[i] / gel.force()) as f32),
            },
        }
    }
}
