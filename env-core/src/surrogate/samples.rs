//! Training samples from a dataset: each solved frame of each pad with its linear answer.
//!
//! Linear answers are stored in the dataset's folder, a file for each shard, and computed where
//! they are missing.

use std::{
    collections::{HashMap, HashSet},
    fs,
    path::Path,
};

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};

use super::{
    features::{PadInput, PadMaterial, Target},
    graph::PadGraph,
    linear::{Contact, LinearBaseline, LinearFields},
};
use crate::{
    Error, Result,
    dataset::{Config, Dataset, PadFrames, write_whole},
    deformation::{Moduli, Press},
    geometry::{PadMesh, Shape},
    sensor::Sensor,
};

/// A solved frame with its linear answer.
pub(super) struct Sample {
    /// Index of its graph.
    pub(super) graph: usize,
    /// Index of its gel.
    pub(super) gel: usize,
    /// Name of its grasp.
    pub(super) grasp: String,
    pub(super) question: PadInput,
    pub(super) truth: Target,
}

/// Gels of a dataset with their linear models, and graphs of their sensors.
pub(super) struct Gels {
    pub(super) graphs: Vec<PadGraph>,
    pub(super) pads: Vec<Pad>,
    /// Largest number of nodes of the linear models' mesh, and the kind of their contact points.
    nodes: usize,
    contact: Contact,
}

/// A gel of a dataset.
pub(super) struct Pad {
    pub(super) graph: usize,
    pub(super) gel: PadMaterial,
    mesh: PadMesh,
    linear: LinearBaseline,
}

/// Linear answers of a shard, frame by frame, one list per pad.
type Answers = Vec<Vec<LinearFields>>;

impl Gels {
    /// Prepares the gels of `config`, with linear models of at most `nodes` nodes.
    pub(super) fn new(config: &Config, nodes: usize, contact: Contact) -> Result<Self> {
        let mut sensors: Vec<&str> = config.gels.iter().map(|gel| gel.sensor.as_str()).collect();
        sensors.sort_unstable();
        sensors.dedup();
        let meshes = sensors.iter().map(|name| Sensor::named(name)?.pad(config.model_nodes));
        let meshes = meshes.collect::<Result<Vec<_>>>()?;
        let pad = |gel: &crate::dataset::GelConfig| {
            let sensor = Sensor::named(&gel.sensor)?;
            let graph = sensors.iter().position(|name| *name == gel.sensor).unwrap_or_default();
            let moduli = Moduli { young: gel.young, poisson: gel.poisson };
            let thickness = sensor.outline.thickness;
            let gel = PadMaterial { moduli, friction: gel.friction, thickness };
            let mesh = meshes[graph].clone();
            let linear = LinearBaseline::new(&sensor, &gel, nodes, contact, &mesh)?;
            Ok(Pad { graph, gel, mesh, linear })
        };
        let pads = config.gels.par_iter().map(pad).collect::<Result<_>>()?;
        let graphs = meshes.iter().map(PadGraph::new).collect::<Result<_>>()?;
        Ok(Self { graphs, pads, nodes, contact })
    }

    /// Holds graphs alone, for samples that are made elsewhere.
    #[cfg(test)]
    pub(super) fn of(graphs: Vec<PadGraph>) -> Self {
        Self { graphs, pads: Vec::new(), nodes: 0, contact: Contact::Points }
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
                let answers = self.answers(dataset, index, &shape, &pads)?;
                for (frames, answers) in pads.iter().zip(&answers) {
                    for (part, samples) in parts.iter().zip(&mut samples) {
                        if part.contains(&*frames.grasp) {
                            lost += frames.poses.len() - answers.len();
                            let one = |(i, linear)| self.sample(frames, i, &shape, linear);
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

    /// Reads the linear answers of a shard, or computes and stores them.
    fn answers(
        &self,
        dataset: &Dataset,
        index: usize,
        shape: &Shape,
        pads: &[PadFrames],
    ) -> Result<Answers> {
        let path_of = |frames: &PadFrames| self.linear_path(frames, shape);
        if self.contact == Contact::Cells {
            // Quick, and files would not keep the contact of cells.
            return pads.par_iter().map(path_of).collect();
        }
        let shard = dataset.name(index);
        let kind = match self.contact {
            Contact::Points => String::new(),
            Contact::Nodes | Contact::Cells => format!("{}-", self.contact.name()),
        };
        let name = format!("linear/{kind}{}-{shard}.safetensors", self.nodes);
        let path = dataset.folder().join(name);
        if let Some(stored) = read(&path, pads) {
            return Ok(stored);
        }
        let answers: Answers = pads.par_iter().map(path_of).collect::<Result<_>>()?;
        write(&path, &answers)?;
        // Files have single precision: the run that computes them must train on the same numbers as
        // later ones.
        read(&path, pads).ok_or_else(|| Error::file(&path, &"not what was written"))
    }

    /// Computes the linear answers to the frames of a press, up to the first that fails.
    fn linear_path(&self, frames: &PadFrames, shape: &Shape) -> Result<Vec<LinearFields>> {
        let linear = &self.pads[frames.gel].linear;
        let poses = std::iter::once(&frames.start).chain(&frames.poses);
        let poses = poses.map(|&pose| vec![pose]).collect();
        let mut press = Press::along(vec![shape.clone()], poses)?;
        if let Some(friction) = frames.friction {
            press = press.with_friction(friction)?;
        }
        let answers = linear.path(&press).into_iter().map_while(Result::ok).skip(1);
        Ok(answers.map(|answer| linear.carry(&answer, true)).collect())
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
            question: PadInput::new(graph, gel, places, std::slice::from_ref(shape), linear),
            truth: Target::new(frames, frame, graph.columns, gel),
        }
    }
}

impl Target {
    /// Extracts a frame of a finite-element solution on a pad of `columns` columns.
    pub(super) fn new(frames: &PadFrames, frame: usize, columns: usize, gel: &PadMaterial) -> Self {
        let part = |field: &[f32], unit: f64| -> Vec<f32> {
            let (size, unit) = (field.len() / frames.poses.len(), unit as f32);
            field[frame * size..][..size].iter().map(|x| x / unit).collect()
        };
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

/// Writes answers atomically: a file is complete or absent.
fn write(path: &Path, answers: &Answers) -> Result<()> {
    let vectors = |field: &[Vector3<f64>]| -> Vec<f64> {
        field.iter().flat_map(|v| [v.x, v.y, v.z]).collect()
    };
    let mut fields: Vec<(String, Vec<u8>)> = Vec::new();
    for (pad, answers) in answers.iter().enumerate() {
        let mut put = |name: &str, of: &dyn Fn(&LinearFields) -> Vec<f64>| {
            let numbers = answers.iter().flat_map(of);
            let bytes = numbers.flat_map(|x| (x as f32).to_le_bytes()).collect();
            fields.push((format!("{pad}.{name}"), bytes));
        };
        put("displacement", &|answer| vectors(&answer.displacement));
        put("contact_force", &|answer| vectors(&answer.contact_force));
        put("von_mises", &|answer| answer.von_mises.clone());
    }
    let views = fields.iter().map(|(name, bytes)| {
        let view = TensorView::new(Dtype::F32, vec![bytes.len() / 4], bytes);
        (name, view.expect("as many bytes as the shape says"))
    });
    let bytes =
        safetensors::serialize(views.collect::<HashMap<_, _>>(), None).expect("valid tensors");
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder).map_err(|error| Error::file(folder, &error))?;
    write_whole(path, &bytes)
}

/// A frame's fields and the pose of its shape.
type Row<'a> = (((&'a [f64], &'a [f64]), &'a [f64]), &'a Isometry3<f64>);

/// Reads the answers to the presses of `pads` from a file, or returns `None` if it is not valid.
fn read(path: &Path, pads: &[PadFrames]) -> Option<Answers> {
    let bytes = fs::read(path).ok()?;
    let file = SafeTensors::deserialize(&bytes).ok()?;
    let pad = |(number, frames): (usize, &PadFrames)| {
        let (nodes, tets) = (
            frames.displacement.len() / frames.poses.len(),
            frames.von_mises.len() / frames.poses.len(),
        );
        let field = |name: &str| -> Option<Vec<f64>> {
            let tensor = file.tensor(&format!("{number}.{name}")).ok()?;
            let numbers = tensor.data().as_chunks().0.iter();
            Some(numbers.map(|bytes| f64::from(f32::from_le_bytes(*bytes))).collect())
        };
        let vectors =
            |numbers: &[f64]| numbers.as_chunks::<3>().0.iter().map(|&v| v.into()).collect();
        let (displacement, force) = (field("displacement")?, field("contact_force")?);
        let stress = field("von_mises")?;
        let each = displacement.chunks(nodes).zip(force.chunks(nodes)).zip(stress.chunks(tets));
        let frame = |(((u, f), s), pose): Row| LinearFields {
            displacement: vectors(u),
            contact_force: vectors(f),
            von_mises: s.to_vec(),
            poses: vec![*pose],
            cells: None,
        };
        Some(each.zip(&frames.poses).map(frame).collect())
    };
    pads.iter().enumerate().map(pad).collect()
}
