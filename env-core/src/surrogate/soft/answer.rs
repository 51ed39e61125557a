//! The network as a model of squeezes.

use std::{
    path::Path,
    sync::{Arc, Mutex, PoisonError},
    time::Instant,
};

use nalgebra::Vector3;

use super::{
    fast::{ObjectBuffers, ObjectInference},
    graph::ObjectGraph,
    grip::Grip,
    input::ObjectInput,
    linear::SoftBaseline,
    network::Soft,
    training::SoftCard,
};
use crate::{
    Error, Result, compliance,
    deformation::{
        Deformation, DeformationModel, Law, Moduli, Press, SoftBody, Wanted, Wrench, solve_frames,
        solve_in_parallel,
    },
    geometry::Shape,
    objects::tets_within,
    surrogate::{material::PadMaterial, parameters::Parameters, weights},
};

/// A trained network on one soft object. Copies share the precomputed data.
///
/// A press is of two equal cuboids, the fingers, whose sides at +z face the object; poses, fields
/// and wrenches are in the object's frame.
#[derive(Clone)]
pub struct SoftSurrogate(Arc<ObjectNetwork>);

struct ObjectNetwork {
    card: SoftCard,
    network: ObjectInference,
    graph: ObjectGraph,
    unit: PadMaterial,
    linear: SoftBaseline,
    body: SoftBody,
    /// Working memory of finished presses, for reuse: allocating it takes as long as the network.
    unused: Mutex<Vec<Memory>>,
}

/// Working memory of one press.
struct Memory {
    linear: compliance::Scratch,
    network: ObjectBuffers,
}

/// Shipped weights by name.
const KNOWN: [(&str, &[u8]); 1] =
    [("soft", include_bytes!("../../../assets/weights/soft.safetensors"))];

impl SoftSurrogate {
    /// Loads the shipped weights called `name` for an object of the given shape, material and
    /// friction.
    pub fn named(name: &str, shape: &Shape, moduli: Moduli, friction: f64) -> Result<Self> {
        let known = KNOWN.iter().find(|(known, _)| *known == name);
        let (name, bytes) = known.ok_or_else(|| {
            let names = KNOWN.map(|(name, _)| name).join(", ");
            Error::invalid("surrogate", name, format!("one of {names}, or a file's path"))
        })?;
        Self::from_bytes(name, bytes, shape, moduli, friction)
    }

    /// Performs [`SoftSurrogate::named`] with the weights in a file.
    pub fn load(path: &Path, shape: &Shape, moduli: Moduli, friction: f64) -> Result<Self> {
        let bytes = weights::read(path)?;
        Self::from_bytes(&path.display().to_string(), &bytes, shape, moduli, friction)
    }

    fn from_bytes(
        name: &str,
        bytes: &[u8],
        shape: &Shape,
        moduli: Moduli,
        friction: f64,
    ) -> Result<Self> {
        let (tensors, card): (_, SoftCard) = weights::of_kind(name, bytes)?;
        let parameters = Parameters::given(tensors)?;
        let network = Soft::new(&card.training.network, &parameters.builder())?;
        let mesh = tets_within(shape, card.model_nodes)?;
        let graph = ObjectGraph::new(&mesh);
        let network = ObjectInference::new(&network, &graph, &mesh)?;
        let unit = PadMaterial { moduli, friction, thickness: graph.length };
        let fine = tets_within(shape, card.linear_nodes)?;
        let linear = SoftBaseline::new(fine, &mesh, moduli, friction)?;
        let body = SoftBody::new(mesh, Law::default(), moduli, &[])?;
        let unused = Mutex::default();
        Ok(Self(Arc::new(ObjectNetwork { card, network, graph, unit, linear, body, unused })))
    }

    /// Description of the weights.
    pub fn card(&self) -> &SoftCard {
        &self.0.card
    }

    /// The object, to whose nodes and tetrahedra the answers refer.
    pub fn body(&self) -> &SoftBody {
        &self.0.body
    }

    /// Solves every frame of `press`, in order; the first that fails is an error and the last.
    pub fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        let half = match Grip::half_extents(press) {
            Ok(half) => half,
            Err(error) => return vec![Err(error)],
        };
        let mut scratch = ObjectBuffers::default();
        solve_frames(self.0.linear.path(press), |linear| {
            Ok(self.0.correct(press, &half, linear?, &mut scratch))
        })
    }

    /// Returns whether an answer with that displacement (V, 3) in m lies within the range of the
    /// training data.
    pub fn is_in_distribution(&self, displacement: &[Vector3<f64>]) -> bool {
        self.0.card.data.covers(&self.0.unit, displacement)
    }

    /// Wrenches of two fingers of these half-extents (m) on the object in an answer to their press,
    /// in the object's frame about its origin.
    pub fn of_fingers(&self, half_extents: &Vector3<f64>, answer: &Deformation) -> [Wrench; 2] {
        let grip = Grip::of(half_extents, &answer.poses);
        let mut wrenches = [Wrench::default(); 2];
        let nodes = self.body().mesh().vertices.iter().zip(&answer.displacement);
        for ((rest, u), force) in nodes.zip(&answer.contact_force) {
            let place = rest + u;
            wrenches[grip.nearer(&place)].add_force(force, &place.coords);
        }
        wrenches
    }
}

impl ObjectNetwork {
    /// Performs `work` with reused working memory.
    fn with_memory<T>(&self, work: impl FnOnce(&mut Memory) -> T) -> T {
        let unused = || self.unused.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = unused().pop();
        let new = || Memory { linear: self.linear.scratch(), network: ObjectBuffers::default() };
        let mut memory = kept.unwrap_or_else(new);
        let done = work(&mut memory);
        unused().push(memory);
        done
    }

    /// Corrects the linear solution with the network.
    fn correct(
        &self,
        press: &Press,
        half: &Vector3<f64>,
        linear: Deformation,
        scratch: &mut ObjectBuffers,
    ) -> Deformation {
        let start = Instant::now();
        let friction = press.friction().unwrap_or(self.unit.friction);
        let unit = PadMaterial { friction, ..self.unit };
        let grip = Grip::of(half, &linear.poses);
        let input = ObjectInput::new(&self.graph, &unit, &grip, &linear);
        if input.amplitude == 0.0 {
            return linear;
        }
        let output = self.network.forward(&input, &self.graph, scratch);
        let displacement = unit.displacement(&output.displacement);
        let contact_force = unit.forces(&output.forces);
        let arms = self.graph.places.iter().zip(&displacement).map(|(place, u)| place.coords + u);
        let wrench = Wrench::of_forces(contact_force.iter().copied().zip(arms));
        Deformation {
            displacement,
            contact_force,
            von_mises: unit.von_mises(&output.stress),
            wrench,
            seconds: linear.seconds + start.elapsed().as_secs_f64(),
            ..linear
        }
    }
}

impl DeformationModel for SoftSurrogate {
    /// Solves the presses in parallel, each on one thread; the frames before the last are not
    /// corrected.
    fn solve(&self, presses: &[Press]) -> Vec<Result<Deformation>> {
        self.solve_partially(presses, Wanted::ALL)
    }

    /// Performs [`DeformationModel::solve`]; the stress is always computed.
    fn solve_partially(&self, presses: &[Press], wanted: Wanted) -> Vec<Result<Deformation>> {
        let model = &*self.0;
        solve_in_parallel(presses, |press| {
            let half = Grip::half_extents(press)?;
            model.with_memory(|Memory { linear, network }| {
                let linear = model.linear.last(press, wanted.residual, linear)?;
                Ok(model.correct(press, &half, linear, network))
            })
        })
    }

    fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        self.solve_path(press)
    }
}
