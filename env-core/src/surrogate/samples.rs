//! Training samples from a dataset: each solved frame of each pad with its linear solution.

use std::collections::HashSet;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{
    features::{PadInput, Target},
    graph::PadGraph,
    linear::{LinearBaseline, LinearFields, LinearStress},
    material::PadMaterial,
};
use crate::{
    Result,
    compliance::nodal::ContactResolution,
    dataset::{Dataset, DatasetConfig, GelConfig, PadFrames, steps},
    deformation::Press,
    geometry::{PadMesh, Shape},
};

/// A solved frame with its linear solution.
pub(super) struct Sample {
    /// Index of its graph.
    pub(super) graph: usize,
    /// Index of its gel.
    pub(super) gel: usize,
    /// Name of its grasp.
    pub(super) grasp: String,
    pub(super) input: PadInput,
    pub(super) target: Target,
}

/// Gels of a dataset with their linear models, and graphs of their sensors.
pub(super) struct Gels {
    pub(super) graphs: Vec<PadGraph>,
    pub(super) pads: Vec<GelPad>,
    /// Load steps from one frame to the next.
    steps: usize,
}

/// A gel of a dataset.
pub(super) struct GelPad {
    pub(super) graph: usize,
    pub(super) gel: PadMaterial,
    mesh: PadMesh,
    linear: LinearBaseline,
}

impl Gels {
    /// Prepares the gels of `config`, with linear models of at most `nodes` nodes.
    pub(super) fn new(config: &DatasetConfig, nodes: usize) -> Result<Self> {
        let mut sensors = config.gels.iter().map(GelConfig::sensor).collect::<Result<Vec<_>>>()?;
        sensors.sort_by(|a, b| a.name.cmp(&b.name));
        sensors.dedup();
        let meshes = sensors.iter().map(|sensor| sensor.pad(config.model_nodes));
        let meshes = meshes.collect::<Result<Vec<_>>>()?;
        let pad = |gel: &GelConfig| {
            let sensor = gel.sensor()?;
            let graph = sensors.iter().position(|known| *known == sensor).unwrap_or_default();
            let moduli = gel.moduli();
            let thickness = sensor.outline.thickness;
            let gel = PadMaterial { moduli, friction: gel.friction, thickness };
            let mesh = meshes[graph].clone();
            let linear = LinearBaseline::new(&sensor, &gel, nodes, &mesh, ContactResolution::FAST)?;
            Ok(GelPad { graph, gel, mesh, linear })
        };
        let pads = config.gels.par_iter().map(pad).collect::<Result<_>>()?;
        let graphs = meshes.iter().map(PadGraph::new).collect::<Result<_>>()?;
        Ok(Self { graphs, pads, steps: config.truth_steps })
    }

    /// Holds graphs alone, for samples that are made elsewhere.
    #[cfg(test)]
    pub(super) fn of(graphs: Vec<PadGraph>) -> Self {
        Self { graphs, pads: Vec::new(), steps: 1 }
    }

    /// Returns every frame of `dataset` whose grasp is in one of `parts`, for each part, and the
    /// number of frames that the linear model failed to solve. `watch` is called after each shard;
    /// if it returns false, the samples so far are returned.
    pub(super) fn samples<const N: usize>(
        &self,
        dataset: &Dataset,
        parts: [&[String]; N],
        watch: &mut dyn FnMut(usize, usize) -> bool,
    ) -> Result<([Vec<Sample>; N], usize)> {
        let parts = parts.map(|names| names.iter().map(String::as_str).collect::<HashSet<_>>());
        let (mut samples, mut lost) = (std::array::from_fn(|_| Vec::new()), 0);
        for index in 0..dataset.shards() {
            let (object, pads) = dataset.read(index)?;
            let wanted = |frames: &PadFrames| parts.iter().any(|p| p.contains(&*frames.grasp));
            if pads.iter().any(wanted) {
                let shape = object.shape.clone().validated()?;
                let answers = pads.par_iter().map(|frames| self.answers(frames, &shape));
                let answers = answers.collect::<Result<Vec<_>>>()?;
                for (frames, answers) in pads.iter().zip(&answers) {
                    for (part, samples) in parts.iter().zip(&mut samples) {
                        if part.contains(&*frames.grasp) {
                            lost += frames.poses.len() - answers.len();
                            let one = |(i, answer)| self.sample(frames, i, &shape, answer);
                            samples.extend(answers.iter().enumerate().map(one));
                        }
                    }
                }
            }
            if !watch(index + 1, dataset.shards()) {
                break;
            }
        }
        Ok((samples, lost))
    }

    /// Computes the linear solutions to the frames of a press, from first touch and by load steps,
    /// up to the first that fails.
    fn answers(&self, frames: &PadFrames, shape: &Shape) -> Result<Vec<LinearFields>> {
        let linear = &self.pads[frames.gel].linear;
        let froms = std::iter::once(&frames.start).chain(&frames.poses);
        let between = |(from, to)| steps(from, to, self.steps);
        let mut poses = vec![vec![frames.start]];
        poses.extend(froms.zip(&frames.poses).flat_map(between));
        let mut press = Press::along(vec![shape.clone()], poses)?;
        if let Some(friction) = frames.friction {
            press = press.with_friction(friction)?;
        }
        let solved = linear.path(&press).into_iter().map_while(Result::ok);
        let framed = solved.skip(self.steps).step_by(self.steps);
        framed.map(|found| linear.carry(&found, LinearStress::OF_NETWORK)).collect()
    }

    fn sample(
        &self,
        frames: &PadFrames,
        frame: usize,
        shape: &Shape,
        linear: &LinearFields,
    ) -> Sample {
        let pad = &self.pads[frames.gel];
        let graph = &self.graphs[pad.graph];
        let friction = frames.friction.unwrap_or(pad.gel.friction);
        let gel = &PadMaterial { friction, ..pad.gel };
        let places: &[Point3<f64>] = &pad.mesh.mesh.vertices;
        Sample {
            graph: pad.graph,
            gel: frames.gel,
            grasp: frames.grasp.clone(),
            input: PadInput::new(graph, gel, places, std::slice::from_ref(shape), linear),
            target: Target::new(frames, frame, graph.columns, gel),
        }
    }
}

impl Sample {
    /// Marks the solution as the less accurate one of two kinds.
    pub(super) fn of_low_fidelity(self) -> Self {
        let grasp = format!("{}, coarser", self.grasp);
        Self { input: self.input.of_low_fidelity(), grasp, ..self }
    }
}

impl Target {
    /// Largest displacement over the pad's thickness.
    pub(super) fn amplitude(&self) -> f64 {
        let norm = |u: &[f32; 3]| Vector3::from(*u).cast::<f64>().norm();
        self.displacement.as_chunks().0.iter().map(norm).fold(0.0, f64::max)
    }

    /// Extracts a frame of a finite-element solution on a pad of `columns` columns.
    pub(super) fn new(frames: &PadFrames, frame: usize, columns: usize, gel: &PadMaterial) -> Self {
        let part = |field: &[f32], unit: f64| in_units(field, frame, frames.poses.len(), unit);
        let mut forces = part(&frames.contact_force, gel.force());
        forces.truncate(3 * columns);
        let wrench = &frames.wrench[6 * frame..];
        Self {
            displacement: part(&frames.displacement, gel.thickness),
            stress: part(&frames.von_mises, gel.moduli.shear()),
            forces,
            force: std::array::from_fn(|i| (wrench[i] / gel.force()) as f32),
        }
    }
}

/// A frame of a field of so many `frames`, over its `unit`.
pub(super) fn in_units(field: &[f32], frame: usize, frames: usize, unit: f64) -> Vec<f32> {
    let (size, unit) = (field.len() / frames, unit as f32);
    field[frame * size..][..size].iter().map(|x| x / unit).collect()
}
