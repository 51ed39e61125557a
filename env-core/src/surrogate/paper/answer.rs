//! One of the paper's networks as a model of presses.

use std::{path::Path, sync::Arc, time::Instant};

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::{
    card::PaperCard,
    config::Input,
    gels::{Graph, Pad},
    patch::PaperPatch,
    scene::PaperPush,
    target::TrainablePaper,
};
use crate::{
    Error, Result,
    deformation::{Drive, Moduli, Press, SoftBody, solve_frames, solve_in_parallel},
    geometry::Shape,
    interrupt,
    sensor::Sensor,
    surrogate::{linear::body, material::PadMaterial, weights},
};

/// A trained network of the paper's on one gel. Copies share the precomputed data.
#[derive(Clone)]
pub struct PaperNetwork(Arc<PaperModel>);

struct PaperModel {
    card: PaperCard,
    network: TrainablePaper,
    pad: Pad,
    body: SoftBody,
}

/// Answer of one of the paper's networks to a press, without contact forces.
#[derive(Clone, Debug)]
pub struct PaperAnswer {
    /// Displacement of the nodes (V, 3) in m.
    pub displacement: Vec<Vector3<f64>>,
    /// Von Mises equivalent of the Cauchy stress (T) in Pa.
    pub von_mises: Vec<f64>,
    /// Best-fit rigid motion of the gel, of variant B.
    pub rigid: Option<Isometry3<f64>>,
    /// Pose of the shape.
    pub pose: Isometry3<f64>,
    /// Wall time (s).
    pub seconds: f64,
}

/// Shipped weights by name.
const KNOWN: [(&str, &[u8]); 1] =
    [("paper-b", include_bytes!("../../../assets/weights/paper-b.safetensors"))];
/// Most nodes of the model mesh that a card may specify.
const MOST_NODES: usize = 20_000;

impl PaperNetwork {
    /// Names of shipped weights.
    pub fn names() -> impl Iterator<Item = &'static str> {
        KNOWN.into_iter().map(|(name, _)| name)
    }

    /// Loads the shipped weights called `name` for a gel of `sensor` with the given material and
    /// friction.
    pub fn named(name: &str, sensor: &Sensor, moduli: Moduli, friction: f64) -> Result<Self> {
        let known = KNOWN.iter().find(|(known, _)| *known == name);
        let (name, bytes) = known.ok_or_else(|| {
            let names = Self::names().collect::<Vec<_>>().join(", ");
            Error::invalid("paper network", name, format!("one of {names}, or a file's path"))
        })?;
        Self::from_bytes(name, bytes, sensor, moduli, friction)
    }

    /// Performs [`PaperNetwork::named`] with the weights in a file.
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
        let (network, card) = TrainablePaper::opened(name, bytes)?;
        if card.network.input == Input::Force {
            return Err(Error::file(name, "input force, expected translation"));
        }
        if card.model_nodes > MOST_NODES {
            let reason = format!("{} nodes, expected at most {MOST_NODES}", card.model_nodes);
            return Err(Error::file(name, reason));
        }
        let mesh = sensor.pad(card.model_nodes)?;
        let body = body(&mesh, moduli)?;
        let gel = PadMaterial { moduli, friction, thickness: sensor.outline.thickness };
        let pad = Pad { gel, graph: Arc::new(Graph::new(&mesh)) };
        Ok(Self(Arc::new(PaperModel { card, network, pad, body })))
    }

    /// Description of the weights.
    pub fn card(&self) -> &PaperCard {
        &self.0.card
    }

    /// The body whose nodes and tetrahedra the answers refer to.
    pub fn body(&self) -> &SoftBody {
        &self.0.body
    }

    /// Solves the presses in parallel, each on one thread, and returns their last frames.
    pub fn solve(&self, presses: &[Press]) -> Vec<Result<PaperAnswer>> {
        solve_in_parallel(presses, |press| {
            interrupt::check()?;
            let (input, path) = self.0.input(press)?;
            self.0.answer(&input, path.last().expect("a press has a frame"))
        })
    }

    /// Solves every frame of `press`, in order; the first that fails is an error and the last.
    ///
    /// Errors: several shapes, a shape without a surface, a press with a force or a history.
    pub fn solve_path(&self, press: &Press) -> Vec<Result<PaperAnswer>> {
        let (input, path) = match self.0.input(press) {
            Ok(found) => found,
            Err(error) => return vec![Err(error)],
        };
        solve_frames(&path, |pose| self.0.answer(&input, pose))
    }

    /// Returns whether an answer with that displacement (V, 3) in m, on this gel, lies within the
    /// range of the training data.
    pub fn is_in_distribution(&self, displacement: &[Vector3<f64>]) -> bool {
        self.0.card.data.covers(&self.0.pad.gel, displacement)
    }
}

/// Input of a network for a press.
struct PaperInput<'a> {
    shape: &'a Shape,
    pad: Pad,
    /// Pose of the shape at first touch, along the pad's axis, and its surface there; `None` if it
    /// never touches.
    touch: Option<(Isometry3<f64>, PaperPatch)>,
}

impl PaperModel {
    /// Returns the network's input, and the poses of the shape frame by frame.
    fn input<'a>(&self, press: &'a Press) -> Result<(PaperInput<'a>, Vec<Isometry3<f64>>)> {
        let [shape] = press.shapes() else {
            return Err(Error::invalid("shapes", press.shapes().len(), "one"));
        };
        let Drive::Translation { path } = press.drive() else {
            return Err(Error::invalid("press", "a force", "a path: the input is the translation"));
        };
        if press.history().is_some() {
            return Err(Error::invalid("history", "one", "none: the network has no memory"));
        }
        let surface = shape.surface(self.card.density.segments());
        let surface = surface
            .ok_or_else(|| Error::invalid("shape", format!("{shape:?}"), "a finite surface"))?;
        let mut pad = Pad { gel: self.pad.gel, graph: Arc::clone(&self.pad.graph) };
        pad.gel.friction = press.friction().unwrap_or(pad.gel.friction);
        let path: Vec<_> = path.iter().map(|poses| poses[0]).collect();
        let first = path.iter().find(|pose| pad.graph.touches(shape, pose));
        let touch = first.map(|&pose| {
            let touch = pad.graph.touch(shape, pose);
            (touch, PaperPatch::new(&surface, &touch, pad.graph.half, self.card.density))
        });
        Ok((PaperInput { shape, pad, touch }, path))
    }

    /// Answer with the shape at `pose`; all displacements are zero if it does not touch.
    fn answer(&self, input: &PaperInput, pose: &Isometry3<f64>) -> Result<PaperAnswer> {
        let (start, PaperInput { shape, pad, touch }) = (Instant::now(), input);
        let still = |rows: usize| vec![Vector3::zeros(); rows];
        let (displacement, von_mises, rigid) = match touch {
            Some((touch, patch)) if pad.graph.touches(shape, pose) => {
                let push = PaperPush::Moved(pose * touch.inverse());
                let output = self.network.answer_to(pad, patch, push)?;
                let displacement: Vec<f32> = output.displacement.flatten_all()?.to_vec1()?;
                let stress: Vec<f32> = output.stress.to_vec1()?;
                let motion = output.rigid.map(|m| m.to_vec1::<f32>()).transpose()?;
                (
                    pad.gel.displacement(&displacement),
                    pad.gel.von_mises(&stress),
                    motion.map(|numbers| isometry(&numbers, pad.gel.thickness)),
                )
            }
            _ => {
                let mesh = self.body.mesh();
                let rigid = self.network.has_motion().then(Isometry3::identity);
                (still(mesh.vertices.len()), vec![0.0; mesh.tets.len()], rigid)
            }
        };
        let seconds = start.elapsed().as_secs_f64();
        Ok(PaperAnswer { displacement, von_mises, rigid, pose: *pose, seconds })
    }
}

/// A motion of 12 numbers in units of `length`.
fn isometry(numbers: &[f32], length: f64) -> Isometry3<f64> {
    let rotation = Matrix3::from_row_slice(&numbers[..9]).cast::<f64>();
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rotation));
    let translation = Vector3::from_column_slice(&numbers[9..12]).cast::<f64>() * length;
    Isometry3::from_parts(Translation3::from(translation), rotation)
}

impl Graph {
    /// Returns whether `shape` at `pose` reaches under the face.
    fn touches(&self, shape: &Shape, pose: &Isometry3<f64>) -> bool {
        let inside = |p: &Point3<f64>| shape.distance(&pose.inverse_transform_point(p)).value < 0.0;
        self.places[..self.columns].iter().any(inside)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHIPPED: &[u8] = KNOWN[0].1;

    fn opened(bytes: &[u8]) -> Result<PaperNetwork> {
        let sensor = Sensor::named("gelsight-mini")?;
        PaperNetwork::from_bytes("mine", bytes, &sensor, Moduli { young: 3e5, poisson: 0.47 }, 0.8)
    }

    fn ball(heights: &[f64]) -> Press {
        let path = heights.iter().map(|&z| vec![Isometry3::translation(0.0, 0.0, z)]).collect();
        Press::along(vec![Shape::Sphere { radius: 8e-3 }], path).unwrap()
    }

    #[test]
    fn nothing_moves_before_the_object_touches_and_deeper_presses_move_more() {
        let network = opened(SHIPPED).unwrap();
        let answers = network.solve_path(&ball(&[8.5e-3, 7.7e-3, 7.2e-3]));
        let size = |answer: &Result<PaperAnswer>| -> [f64; 2] {
            let PaperAnswer { displacement, von_mises, rigid, .. } = answer.as_ref().unwrap();
            assert!(rigid.is_some());
            let moved = displacement.iter().map(Vector3::norm_squared).sum::<f64>().sqrt();
            [moved, von_mises.iter().sum::<f64>()]
        };
        let [none, light, deep] = [0, 1, 2].map(|i| size(&answers[i]));
        assert_eq!(none, [0.0, 0.0]);
        assert!(light[0] > 0.0 && deep[0] > 1.5 * light[0], "{deep:?} m after {light:?} m");
        assert!(light[1] > 0.0 && deep[1] > 1.5 * light[1], "{deep:?} Pa after {light:?} Pa");
        let last = network.solve(&[ball(&[8.5e-3, 7.7e-3, 7.2e-3])]).pop().unwrap();
        assert_eq!(size(&last), deep);
    }

    #[test]
    fn what_a_network_told_poses_cannot_answer_is_an_error() {
        let network = opened(SHIPPED).unwrap();
        let message = |press: Press| network.solve(&[press])[0].as_ref().unwrap_err().to_string();
        let (here, sphere) = (Isometry3::translation(0.0, 0.0, 7.5e-3), ball(&[7.5e-3]));
        let shape = sphere.shapes()[0].clone();
        let force = Press::with_force(vec![shape.clone()], vec![here], 1.0, -Vector3::z());
        assert!(message(force.unwrap()).contains("a path"));
        let two = Press::along(vec![shape.clone(), shape], vec![vec![here, here]]);
        assert!(message(two.unwrap()).contains("shapes: found 2"));
        let plane = Press::along(vec![Shape::HalfSpace], vec![vec![Isometry3::identity()]]);
        assert!(message(plane.unwrap()).contains("a finite surface"));
    }

    #[test]
    fn a_press_ends_when_it_is_requested() {
        let (network, interrupt) = (opened(SHIPPED).unwrap(), interrupt::Interrupt::default());
        interrupt.request();
        let press = ball(&[7.5e-3, 7.2e-3]);
        let path = interrupt.during(|| network.solve_path(&press));
        let last = interrupt.during(|| network.solve(&[press]));
        for found in [path, last] {
            assert_eq!(found.len(), 1);
            assert_eq!(found[0].as_ref().err(), Some(&Error::Interrupted));
        }
    }

    #[test]
    fn damaged_and_other_weights_are_named() {
        let refused = |bytes: &[u8], what: &str| {
            let error = opened(bytes).err().expect(what).to_string();
            assert!(error.contains(what), "{error}, expected {what}");
        };
        for cut in [0, 7, 100, SHIPPED.len() / 2, SHIPPED.len() - 1] {
            refused(&SHIPPED[..cut], "mine");
        }
        let corrector = include_bytes!("../../../assets/weights/pads.safetensors");
        refused(corrector, "weights of corrector, expected paper-baseline");
        // Tensors of an agent are of other types, too.
        let agent = include_bytes!("../../../../py/python/ruffini/agents/GraspLift-v0.safetensors");
        refused(agent, "weights of an agent, expected paper-baseline");
        let (mut tensors, card) = weights::of_kind::<PaperCard>("mine", SHIPPED).unwrap();
        let refused_with = |change: &dyn Fn(&mut PaperCard), what: &str| {
            let mut card = card.clone();
            change(&mut card);
            refused(&weights::to_bytes(&tensors, &card), what);
        };
        refused_with(
            &|card| card.network.input = Input::Force,
            "input force, expected translation",
        );
        refused_with(&|card| card.model_nodes = MOST_NODES + 1, "expected at most");
        refused_with(&|card| card.network.rounds += 1, "missing from the weights");
        refused_with(
            &|card| card.network.width *= 2,
            "mine: encoder.nodes.first.weight: found shape",
        );
        tensors.values_mut().next().unwrap().1[0] = f32::NAN;
        refused(&weights::to_bytes(&tensors, &card), "expected finite numbers");
    }
}
