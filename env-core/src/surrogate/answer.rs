//! The network as an answerer of presses.

use std::{path::Path, time::Instant};

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{
    corrector::{Batch, Corrector},
    features::{Gel, Question},
    graph::PadGraph,
    linear::{Carried, Linear, body},
    weights::{self, Card},
};
use crate::{
    Error, Result,
    deformation::{Deformation, DeformationModel, Moduli, Press, SoftBody, Wrench},
    fem::Linearised,
    sensor::Sensor,
};

/// A trained network on one gel.
pub struct Surrogate {
    card: Card,
    network: Corrector,
    graph: PadGraph,
    gel: Gel,
    linear: Linear,
    /// The model mesh's elements, which judge an answer.
    elements: Linearised,
    body: SoftBody,
}

/// Weights that are known by name.
const KNOWN: [(&str, &[u8]); 0] = [];

impl Surrogate {
    /// The shipped weights of that name on a gel of `sensor` with the given material and friction.
    pub fn named(name: &str, sensor: &Sensor, moduli: Moduli, friction: f64) -> Result<Self> {
        let known = KNOWN.iter().find(|(known, _)| *known == name);
        let (name, bytes) = known.ok_or_else(|| {
            let names = KNOWN.map(|(name, _)| name).join(", ");
            Error::invalid("surrogate", name, format!("one of {names}, or a file's path"))
        })?;
        Self::from_bytes(name, bytes, sensor, moduli, friction)
    }

    /// As [`Surrogate::named`], with the weights in a file.
    pub fn load(path: &Path, sensor: &Sensor, moduli: Moduli, friction: f64) -> Result<Self> {
        let bytes = weights::read(path)?;
        Self::from_bytes(&path.display().to_string(), &bytes, sensor, moduli, friction)
    }

    fn from_bytes(
        name: &str,
        bytes: &[u8],
        sensor: &Sensor,
        moduli: Moduli,
        friction: f64,
    ) -> Result<Self> {
        let (tensors, card): (_, Card) = weights::from_bytes(name, bytes)?;
        let parameters = weights::parameters(tensors)?;
        let network = Corrector::new(&card.network, &parameters.builder())?;
        let gel = Gel { moduli, friction, thickness: sensor.outline.thickness };
        let pad = sensor.pad(card.model_nodes)?;
        let linear = Linear::new(sensor, &gel, card.linear_nodes, &pad)?;
        let body = body(&pad, moduli)?;
        let elements = Linearised::new(&body)?;
        Ok(Self { network, graph: PadGraph::new(&pad)?, gel, linear, elements, body, card })
    }

    /// What the weights are.
    pub fn card(&self) -> &Card {
        &self.card
    }

    /// The body whose nodes and tetrahedra the answers refer to.
    pub fn body(&self) -> &SoftBody {
        &self.body
    }

    /// Every frame of `press`, in order; the first that is not solved is an error and the last.
    pub fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        let answers = self.linear.path(press).into_iter();
        answers.map(|linear| self.correct(press, linear?)).collect()
    }

    /// Whether an answer with that displacement (V, 3) in m, on this gel, is like what the network has
    /// learnt from.
    pub fn knows(&self, displacement: &[Vector3<f64>]) -> bool {
        let data = &self.card.data;
        let within = |x: f64, [low, high]: [f64; 2]| (low..=high).contains(&x);
        let deepest = displacement.iter().map(Vector3::norm).fold(0.0, f64::max);
        deepest <= data.amplitude * self.gel.thickness
            && within(self.gel.moduli.poisson, data.poisson)
            && within(self.gel.friction, data.friction)
    }

    /// What the network makes of the linear answer.
    fn correct(&self, press: &Press, linear: Deformation) -> Result<Deformation> {
        let start = Instant::now();
        let carried = self.linear.carry(&linear);
        let places = &self.body.mesh().vertices;
        let question = Question::new(&self.graph, &self.gel, places, press.shapes(), &carried);
        let corrected = if question.amplitude > 0.0 {
            self.corrected(&question, &carried)?
        } else {
            carried
        };
        let Carried { displacement, contact_force, von_mises, poses } = corrected;
        let residual = self.residual(&displacement, &contact_force)?;
        Ok(Deformation {
            wrench: wrench(places, &displacement, &contact_force),
            displacement,
            von_mises,
            contact_force,
            poses,
            history: linear.history,
            iterations: linear.iterations,
            residual,
            seconds: linear.seconds + start.elapsed().as_secs_f64(),
        })
    }

    fn corrected(&self, question: &Question, carried: &Carried) -> Result<Carried> {
        let answer = self.network.forward(&Batch::new(&[question])?, &self.graph)?;
        let vectors = |tensor: &candle_core::Tensor, unit: f64| -> Result<Vec<Vector3<f64>>> {
            let numbers: Vec<f32> = tensor.flatten_all()?.to_vec1()?;
            let vector = |&v: &[f32; 3]| Vector3::from(v).cast::<f64>() * unit;
            Ok(numbers.as_chunks::<3>().0.iter().map(vector).collect())
        };
        let mut contact_force = vectors(&answer.forces, self.gel.force())?;
        contact_force.extend(&carried.contact_force[self.graph.columns..]);
        let stress: Vec<f32> = answer.stress.flatten_all()?.to_vec1()?;
        let shear = self.gel.moduli.shear();
        Ok(Carried {
            displacement: vectors(&answer.displacement, self.gel.thickness)?,
            contact_force,
            von_mises: stress.iter().map(|s| f64::from(s.max(0.0)) * shear).collect(),
            poses: carried.poses.clone(),
        })
    }

    /// Norm of the force out of balance by the model mesh's own elements (N).
    fn residual(&self, displacement: &[Vector3<f64>], contact: &[Vector3<f64>]) -> Result<f64> {
        let mut workspace = self.elements.workspace();
        let elastic = self.elements.elastic_force(displacement, &mut workspace);
        let mut left = elastic.ok_or(Error::Inverted)?;
        left.iter_mut().zip(contact).for_each(|(left, force)| *left -= force);
        self.elements.release(&mut left);
        Ok(left.iter().map(Vector3::norm_squared).sum::<f64>().sqrt())
    }
}

/// Resultant of forces on displaced nodes.
fn wrench(
    places: &[Point3<f64>],
    displacement: &[Vector3<f64>],
    forces: &[Vector3<f64>],
) -> Wrench {
    let mut wrench = Wrench::default();
    for ((place, u), force) in places.iter().zip(displacement).zip(forces) {
        wrench.force += force;
        wrench.torque += (place.coords + u).cross(force);
    }
    wrench
}

impl DeformationModel for Surrogate {
    /// Presses are solved in parallel, each on one thread. Poses given by force are those at which the
    /// linear model presses that hard.
    fn solve(&mut self, presses: &[Press]) -> Vec<Result<Deformation>> {
        let last = |press: &Press| {
            let path = self.solve_path(press);
            path.into_iter().next_back().expect("a press has a frame")
        };
        presses.par_iter().map(last).collect()
    }
}
