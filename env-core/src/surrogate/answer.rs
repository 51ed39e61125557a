//! Trained network as a model of presses.

use std::{
    path::Path,
    sync::{Arc, OnceLock},
    time::Instant,
};

use nalgebra::{Isometry3, Unit, Vector3};

use super::{
    corrector::Corrector,
    fast::PadInference,
    features::{Fields, PadInput},
    graph::{LAYERS, PadGraph},
    linear::{LinearBaseline, LinearFields, LinearStress, PadFields, body},
    material::PadMaterial,
    parameters::Parameters,
    predicted::{self, ErrorModel},
    slip,
    weights::{self, Card, bearing_of},
};
use crate::{
    Error, Result,
    compliance::nodal::{ContactResolution, ContactSolution},
    contact::{Backing, SurfacePoint, clearance},
    deformation::{
        Deformation, DeformationModel, Drive, Moduli, PredictedError, Press, SoftBody, Wanted,
        Wrench, solve_frames, solve_in_parallel,
    },
    fem::Linearised,
    geometry::{PadMesh, PadOutline, Shape},
    sensor::Sensor,
};

/// A trained network on one gel. Copies share the precomputed data.
#[derive(Clone)]
pub struct Surrogate {
    trained: Arc<PadModel>,
    is_plain: bool,
}

struct PadModel {
    card: Card,
    network: PadInference,
    plain: Corrector,
    graph: PadGraph,
    gel: PadMaterial,
    linear: LinearBaseline,
    /// Elements of the model mesh, for the residual force of an answer.
    elements: Linearised,
    body: SoftBody,
    /// Contact points of finite elements on the model mesh, computed on first use.
    skin: OnceLock<Vec<SurfacePoint>>,
}

/// Largest residual force of a trusted answer, relative to the net contact force.
const UNBALANCED: f64 = 0.5;
/// Penetration of a contact point beyond which an answer without contact force is not trusted (m):
/// the penetration that finite elements allow where the pressure equals Young's modulus.
const PENETRATION: f64 = 2e-6;
/// Part of the contact on the walls of the pad from which the displacement is not corrected: none of
/// the presses that a network learnt from says what happens there.
const UNLEARNT: f64 = 0.03;
/// Largest number of trials in a force-driven press, and relative tolerance of the force.
const TRIES: usize = 16;
const FORCE: f64 = 1e-3;
/// Shipped weights.
pub(super) const SHIPPED: &[u8] = include_bytes!("../../assets/weights/pads.safetensors");

/// Greatest thickness that is tried in the search for a pad that fits the network (m), and its
/// step.
const THICKEST: f64 = 12e-3;
const STEP: f64 = 1e-4;

/// Returns an error that names a thickness that fits unless the mesh of the pad of `sensor`, of at
/// most `nodes` nodes, has the number of layers that the network requires.
fn fits(sensor: &Sensor, pad: &PadMesh, nodes: usize) -> Result<()> {
    let layers = |pad: &PadMesh| pad.cells[2] as usize;
    if layers(pad) == LAYERS {
        return Ok(());
    }
    let of_thickness = |thickness: f64| {
        let outline = PadOutline { thickness, ..sensor.outline };
        outline.validated().and_then(|outline| PadMesh::with_nodes(&outline, nodes))
    };
    let steps = (1..=(THICKEST / STEP) as u32).map(|i| f64::from(i) * STEP);
    let fitting: Vec<_> =
        steps.filter(|h| of_thickness(*h).is_ok_and(|pad| layers(&pad) == LAYERS)).collect();
    let of_this_plan = match fitting[..] {
        [] => String::new(),
        [low, .., high] => format!(", a thickness of {:.1} to {:.1} mm", 1e3 * low, 1e3 * high),
        [one] => format!(", a thickness of {:.1} mm", 1e3 * one),
    };
    let outline = &sensor.outline;
    let found = format!(
        "{}, a pad {:.1} mm thick, whose mesh has {} layers",
        sensor.name,
        1e3 * outline.thickness,
        layers(pad)
    );
    let expected = format!(
        "one of {LAYERS} layers, for which the network was trained{of_this_plan}; \
         \"compliance\" (LinearPad) and \"fem\" (Fem) take any pad"
    );
    Err(Error::invalid("sensor", found, expected))
}

impl Surrogate {
    /// Loads the shipped network for a gel of `sensor` with the given material and friction.
    pub fn new(sensor: &Sensor, moduli: Moduli, friction: f64) -> Result<Self> {
        Self::from_bytes("pads", SHIPPED, sensor, moduli, friction)
    }

    /// Performs [`Surrogate::new`] with the weights in a file.
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
        let (tensors, card): (_, Card) = weights::of_kind(name, bytes)?;
        let parameters = Parameters::given(tensors)?;
        let plain = Corrector::new(&card.network, &parameters.builder())?;
        let gel = PadMaterial { moduli, friction, thickness: sensor.outline.thickness };
        let pad = sensor.pad(card.model_nodes)?;
        fits(sensor, &pad, card.model_nodes)?;
        let linear =
            LinearBaseline::new(sensor, &gel, card.linear_nodes, &pad, ContactResolution::FAST)?;
        let body = body(&pad, moduli)?;
        let elements = Linearised::new(&body)?;
        let graph = PadGraph::new(&pad)?;
        let network = PadInference::new(&plain, &graph, &pad)?;
        let skin = OnceLock::new();
        let trained = PadModel { card, network, plain, graph, gel, linear, elements, body, skin };
        Ok(Self { trained: Arc::new(trained), is_plain: false })
    }

    /// Returns the same network evaluated by Candle's layers, the reference for the fast path.
    /// Answers differ by rounding only, and take longer.
    #[must_use]
    pub fn plain(&self) -> Self {
        Self { is_plain: true, ..self.clone() }
    }

    /// Description of the weights.
    pub fn card(&self) -> &Card {
        &self.trained.card
    }

    /// Body whose nodes and tetrahedra the answers refer to.
    pub fn body(&self) -> &SoftBody {
        &self.trained.body
    }

    /// Held faces of the pad.
    pub(crate) fn backing(&self) -> &Backing {
        self.trained.linear.backing()
    }

    /// Solves every frame of `press`, in order; the first that fails is an error and the last. In a
    /// force-driven press the corrected answer has the required force.
    pub fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        let (trained, is_plain) = (&self.trained, self.is_plain);
        match press.drive() {
            Drive::Translation { .. } => solve_frames(trained.linear.path(press), |linear| {
                let answer = trained.correct(press, linear?, Wanted::ALL, is_plain)?;
                trained.linear.on_face(press.shapes(), answer)
            }),
            Drive::Force { .. } => vec![self.last_on_face(press)],
        }
    }

    /// Solves `press` and returns its last frame, or an error if that is mostly on the walls.
    fn last_on_face(&self, press: &Press) -> Result<Deformation> {
        self.trained.linear.on_face(press.shapes(), self.last(press, Wanted::ALL)?)
    }

    /// Solves `press` and returns its last frame; earlier frames are not corrected by the network.
    fn last(&self, press: &Press, wanted: Wanted) -> Result<Deformation> {
        let is_plain = self.is_plain;
        match press.drive() {
            Drive::Translation { .. } => {
                let linear = self.trained.linear.path(press).pop().expect("a press has a frame")?;
                self.trained.correct(press, linear, wanted, is_plain)
            }
            Drive::Force { poses, force, direction } => {
                self.trained.push(press, poses, *force, direction, is_plain)
            }
        }
    }

    /// Returns whether an answer lies within the range of the training data: displacement (V) in m
    /// with `shapes` at `poses` (S), contact force (V) in N and norm of the residual force (N), 0
    /// if it was not computed.
    ///
    /// Poisson's ratio, friction and largest displacement must lie within those of the data. If
    /// there is contact force, the amplitude, the net force and the number of nodes that bear it
    /// must lie within [`TrainingBounds`], and the residual must be at most half the net force.
    /// Otherwise no contact point of finite elements may penetrate a shape.
    ///
    /// [`TrainingBounds`]: super::TrainingBounds
    pub fn is_in_distribution(
        &self,
        shapes: &[Shape],
        poses: &[Isometry3<f64>],
        displacement: &[Vector3<f64>],
        contact_force: &[Vector3<f64>],
        residual: f64,
    ) -> bool {
        let PadModel { card, gel, elements, body, skin, .. } = &*self.trained;
        let total = contact_force.iter().sum::<Vector3<f64>>().norm();
        let bearing = bearing_of(contact_force.iter().map(Vector3::norm));
        let deepest = displacement.iter().map(Vector3::norm).fold(0.0, f64::max);
        let [low, high] = card.usual.amplitude;
        let is_usual = if bearing > 0.0 {
            (low..=high).contains(&(deepest / gel.thickness))
                && bearing >= card.usual.bearing
                && total <= card.usual.force * gel.force()
                && residual <= UNBALANCED * total
        } else {
            let place = |point: &SurfacePoint| point.place(elements.places(), displacement);
            let skin = skin.get_or_init(|| elements.surface(body).0);
            let places: Vec<_> = skin.iter().map(place).collect();
            clearance(shapes, poses, &places) > -PENETRATION
        };
        is_usual && card.data.covers(gel, displacement)
    }
}

impl PadModel {
    /// Solves a force-driven press: searches for the force on the linear model at which the
    /// corrected answer has the required force.
    fn push(
        &self,
        press: &Press,
        poses: &[Isometry3<f64>],
        force: f64,
        direction: &Unit<Vector3<f64>>,
        is_plain: bool,
    ) -> Result<Deformation> {
        let (mut asked, mut reached, mut travel) = (force, 0.0, 0.0);
        let [mut low, mut high] = [0.0, f64::INFINITY];
        let mut last = None;
        for trial in 0..TRIES {
            let same = press.with_other_force(asked);
            // The linear solution may not reach the force of a trial.
            let of_press = |error| match error {
                Error::Unreachable { .. } if last.is_some() => {
                    Error::Unreachable { force, reached, travel }
                }
                other => other,
            };
            let linear = self.linear.path(&same).swap_remove(0).map_err(of_press)?;
            let answer = self.correct(press, linear, Wanted::ALL, is_plain)?;
            reached = answer.wrench.force.dot(direction);
            let moved = answer.poses[0].translation.vector - poses[0].translation.vector;
            travel = moved.dot(direction);
            if (reached / force - 1.0).abs() < FORCE {
                return Ok(answer);
            }
            *(if reached < force { &mut low } else { &mut high }) = asked;
            let slope = last.map(|[a, r]: [f64; 2]| (reached - r) / (asked - a));
            let by_slope = slope.map(|slope| 1.0 + (force - reached) / (slope * asked));
            let by_share = force / reached.max(f64::MIN_POSITIVE);
            last = Some([asked, reached]);
            let factor = by_slope.filter(|factor| *factor > 0.0).unwrap_or(by_share);
            asked *= factor.clamp(0.5, 2.0);
            // The force jumps when another node comes into contact, and secant steps would
            // oscillate there: bisect.
            let closed = low < high && high.is_finite();
            if low < high && !(low..high).contains(&asked) || closed && trial >= TRIES / 2 {
                asked = (low * high).sqrt();
            }
        }
        Err(Error::Unreachable { force, reached, travel })
    }

    /// Corrects the linear solution with the network.
    fn correct(
        &self,
        press: &Press,
        settled: ContactSolution,
        wanted: Wanted,
        is_plain: bool,
    ) -> Result<Deformation> {
        let start = Instant::now();
        // Candle's layers always compute the stress.
        let with_stress = wanted.stress || is_plain;
        let stress = if with_stress { LinearStress::OF_NETWORK } else { LinearStress::Omitted };
        let linear = self.linear.carry(&settled, stress)?;
        let places = &self.body.mesh().vertices;
        let on_walls = self.linear.share_on_walls(press.shapes(), &settled.history.poses);
        let friction = press.friction().unwrap_or(self.gel.friction);
        let gel = PadMaterial { friction, ..self.gel };
        let input = PadInput::new(&self.graph, &gel, places, press.shapes(), &linear);
        let LinearFields { fields: linear, cells } = linear;
        let (answer, residual, predicted_error) = if input.amplitude > 0.0 {
            let mut fields = self.network_fields(&input, with_stress, is_plain)?;
            let blend = |model: &ErrorModel| model.blended(&input, &mut fields);
            let predicted_error = self.card.predicted.as_ref().map(blend);
            predicted::blend(
                &input,
                [f64::max(1.0 - on_walls / UNLEARNT, 0.0), 1.0, 1.0],
                &mut fields,
            );
            let (answer, residual) = if wanted.residual {
                self.unfolded(&input, fields, &linear)?
            } else {
                (self.in_si(&fields, &linear), 0.0)
            };
            (answer, residual, predicted_error)
        } else {
            let residual = wanted.residual.then(|| self.residual(&linear).ok_or(Error::Inverted));
            (linear, residual.transpose()?.unwrap_or_default(), None)
        };
        let PadFields { displacement, contact_force, von_mises, poses } = answer;
        let ContactSolution { sliding, history, iterations, seconds, .. } = settled;
        let sliding = slip::corrected(sliding, &cells, places, &contact_force, friction);
        let predicted_error = PredictedError::with_unfelt(predicted_error, on_walls);
        let arms = places.iter().zip(&displacement).map(|(place, u)| place.coords + u);
        let wrench = Wrench::of_forces(contact_force.iter().copied().zip(arms));
        Ok(Deformation {
            wrench,
            sliding,
            displacement,
            von_mises,
            contact_force,
            poses,
            history,
            iterations,
            residual,
            seconds: seconds + start.elapsed().as_secs_f64(),
            predicted_error,
        })
    }

    /// Answer of the network.
    fn network_fields(
        &self,
        input: &PadInput,
        with_stress: bool,
        is_plain: bool,
    ) -> Result<Fields> {
        if is_plain {
            return Ok(self.plain.fields(input, &self.graph)?);
        }
        Ok(self.network.forward(input, with_stress))
    }

    /// Converts an answer to SI; what the network does not correct is that of `linear`.
    fn in_si(&self, fields: &Fields, linear: &PadFields) -> PadFields {
        let mut contact_force = self.gel.forces(&fields.forces);
        contact_force.extend(&linear.contact_force[self.graph.columns..]);
        PadFields {
            displacement: self.gel.displacement(&fields.displacement),
            contact_force,
            von_mises: self.gel.von_mises(&fields.stress),
            poses: linear.poses.clone(),
        }
    }

    /// Converts an answer to SI with a half, a quarter or none of its correction of the linear
    /// solution while it turns a tetrahedron inside out; returns it with the norm of its residual
    /// force (N), or an error if the linear solution turns one inside out, too.
    fn unfolded(
        &self,
        input: &PadInput,
        mut fields: Fields,
        linear: &PadFields,
    ) -> Result<(PadFields, f64)> {
        // Of the correction that is left.
        for share in [1.0, 0.5, 0.5, 0.0] {
            predicted::blend(input, [share; 3], &mut fields);
            let answer = self.in_si(&fields, linear);
            if let Some(residual) = self.residual(&answer) {
                return Ok((answer, residual));
            }
        }
        Err(Error::Inverted)
    }

    /// Norm of the residual force by the elements of the model mesh (N); `None` where a tetrahedron
    /// is inside out.
    fn residual(&self, answer: &PadFields) -> Option<f64> {
        self.elements.residual(&answer.displacement, &answer.contact_force)
    }
}

impl DeformationModel for Surrogate {
    /// Solves the presses in parallel, each on one thread.
    fn solve(&self, presses: &[Press]) -> Vec<Result<Deformation>> {
        solve_in_parallel(presses, |press| self.last_on_face(press))
    }

    fn solve_partially(&self, presses: &[Press], wanted: Wanted) -> Vec<Result<Deformation>> {
        solve_in_parallel(presses, |press| self.last(press, wanted))
    }

    fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        self.solve_path(press)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::{super::linear::CellContact, *};

    #[test]
    fn a_correction_that_turns_a_tetrahedron_inside_out_is_reduced() {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let network = Surrogate::new(&sensor, moduli, 0.5).unwrap();
        let (model, mesh) = (&*network.trained, network.body().mesh());
        let away = |place: &Point3<f64>| place.coords.norm();
        let apex = (0..mesh.vertices.len())
            .min_by(|&a, &b| away(&mesh.vertices[a]).total_cmp(&away(&mesh.vertices[b])));
        let (apex, layer) = (apex.unwrap(), sensor.outline.thickness / LAYERS as f64);
        let nodes = mesh.vertices.len();
        let still = LinearFields {
            fields: PadFields {
                displacement: vec![Vector3::zeros(); nodes],
                contact_force: vec![Vector3::zeros(); nodes],
                von_mises: vec![0.0; mesh.tets.len()],
                poses: vec![Isometry3::translation(0.0, 0.0, 0.1)],
            },
            cells: CellContact { nodes: Vec::new(), spacing: 1e-3 },
        };
        let shapes = [Shape::Sphere { radius: 4e-3 }];
        let input = |linear: &LinearFields| {
            PadInput::new(&model.graph, &model.gel, &mesh.vertices, &shapes, linear)
        };
        let pushed = |layers: f64| {
            let mut fields = Fields::linear(&input(&still));
            fields.displacement[3 * apex + 2] = (-layers / LAYERS as f64) as f32;
            fields.stress[0] = 1.0;
            fields
        };
        for (layers, share) in [(0.5, 1.0), (1.6, 0.5), (3.2, 0.25), (1e3, 0.0)] {
            let fields = pushed(layers);
            let (answer, residual) = model.unfolded(&input(&still), fields, &still.fields).unwrap();
            assert!(residual.is_finite());
            let expected = -share * layers * layer;
            assert!((answer.displacement[apex].z - expected).abs() < 1e-9, "{layers} layers");
            let stress = share * moduli.shear();
            assert!(
                (answer.von_mises[0] - stress).abs() < 1e-6 * moduli.shear(),
                "{layers} layers"
            );
        }
        let mut folded = still.clone();
        folded.fields.displacement[apex].z = -1e3 * layer;
        let refused = model.unfolded(&input(&folded), pushed(1e3), &folded.fields);
        assert_eq!(refused.err(), Some(Error::Inverted));
    }
}
