//! Solution of a press: an indenter that moves through given poses into one pad.
//!
//! Finite elements are solved on a mesh graded towards the part of the face that the indenter would
//! cover if the gel deformed nowhere else, alone or to correct linear elasticity with finely
//! resolved contact.

use nalgebra::{Isometry3, Point3};

use super::{
    config::{DatasetConfig, GelConfig, Scenario},
    indentation::{DOWN, covered},
    plan::Plan,
    record::{BodyFields, Named, of_frames, pose, wrenches},
    tensor::Tensor,
};
use crate::{
    Error, Result,
    compliance::{
        Compliance, ComplianceOptions,
        nodal::{ContactResolution, LayeredPad, Sides},
    },
    contact::between,
    deformation::{Deformation, History, Law, Press, SoftBody},
    fem::{Carrier, Fem, FemOptions},
    geometry::{PadMesh, Shape},
    sensor::Sensor,
};

/// Newton steps in a load step, and in a frame, after which a press ends unsolved.
const STEPS: usize = 25;
const PATIENCE: usize = 40;
/// Greatest force, in units of E t² with the thickness t: 80 N on a GelSight Mini.
const STRONGEST: f64 = 17.0;
/// Points along each side of a touching cell over which its force is spread: closer than the nodes
/// of the finest mesh.
const POINTS: u32 = 3;

/// Pad of a gel that indenters are pressed into.
pub(super) struct PressedPad {
    sensor: Sensor,
    /// Mesh on which fields are stored.
    pub(super) model: PadMesh,
    /// Finely resolved contact by linear elasticity, if it is wanted.
    contact: Option<LayeredPad>,
}

impl PressedPad {
    /// Builds the pad of a gel with fields on at most `nodes` nodes, and with finely resolved
    /// contact if `fine`.
    pub(super) fn new(gel: &GelConfig, nodes: usize, fine: bool) -> Result<Self> {
        let sensor = gel.sensor()?;
        let model = sensor.pad(nodes)?;
        let contact = || -> Result<_> {
            let moduli = gel.moduli();
            let body = SoftBody::new(model.mesh.clone(), Law::Linear, moduli, &model.base)?;
            let compliance = Compliance::new(body, ComplianceOptions::default())?;
            let sides = Sides::new(&sensor.outline, moduli, Sides::VERTICES)?;
            let layered = LayeredPad::new(&compliance, &sensor.outline, &model, &sides)?;
            layered.with(gel.friction, ContactResolution::FINE)
        };
        let contact = fine.then(contact).transpose()?;
        Ok(Self { sensor, model, contact })
    }

    /// Solves the press `plan`; returns the number of its frames, their tensors and the error that
    /// ended it early.
    pub(super) fn solve(
        &self,
        config: &DatasetConfig,
        shape: &Shape,
        plan: &Plan,
    ) -> (usize, Named, Option<Error>) {
        match self.frames(config, shape, plan) {
            Ok((start, SolvedPress { frames, fields, error })) => {
                let count = frames.len();
                let loose = || Error::invalid("press", "no force", "contact along the path");
                let error = error.or_else(|| frames.is_empty().then(loose));
                if frames.is_empty() {
                    return (0, Vec::new(), error);
                }
                let poses = frames.iter().flat_map(|f| pose(&f.poses[0]));
                let mut own = of_frames(&frames.iter().collect::<Vec<_>>(), &fields);
                own.push(("press", Tensor::double(poses, &[count, 7])));
                own.push(("start", Tensor::double(pose(&start), &[7])));
                own.push(("wrench", wrenches(fields.iter().map(|f| &f.wrench))));
                let named = own.into_iter().map(|(what, tensor)| (format!("first.{what}"), tensor));
                (count, named.collect(), error)
            }
            Err(error) => (0, Vec::new(), Some(error)),
        }
    }

    /// Pose at first touch, and the frames with contact, up to the first that is too strong.
    fn frames(
        &self,
        config: &DatasetConfig,
        shape: &Shape,
        plan: &Plan,
    ) -> Result<(Isometry3<f64>, SolvedPress)> {
        let drawn = plan.indentation.as_ref().expect("a press of an indenter");
        let (gel, outline) = (&config.gels[plan.gel], &self.sensor.outline);
        let shape = shape.clone().validated()?;
        let (start, path) = drawn.path(&shape, outline);
        let motion = Motion { start, path, depth: drawn.depth, friction: drawn.friction };
        let solved = self.solve_along(config, gel, shape, motion)?;
        let unit = gel.young * outline.thickness.powi(2);
        let held = |fields: &BodyFields| {
            let force = fields.wrench.force.norm() / unit;
            force > 0.0 && force < STRONGEST
        };
        let first = solved.fields.iter().position(held).unwrap_or(solved.fields.len());
        let fields: Vec<_> = solved.fields.into_iter().skip(first).take_while(held).collect();
        let frames = solved.frames.into_iter().skip(first).take(fields.len()).collect();
        Ok((start, SolvedPress { frames, fields, error: solved.error }))
    }

    /// Solves the frames of a press.
    fn solve_along(
        &self,
        config: &DatasetConfig,
        gel: &GelConfig,
        shape: Shape,
        motion: Motion,
    ) -> Result<SolvedPress> {
        let Motion { start, path, depth, friction } = motion;
        let (width, points) = covered(&shape, &path, &self.sensor.outline, depth);
        let finest = width / config.truth_across;
        let run = PressRun { pad: self, config, gel, shape, start, path, friction, finest, points };
        match &self.contact {
            Some(contact) => run.corrected(contact),
            None => run.direct(),
        }
    }
}

/// Solves one press of the first gel of `config`, with its friction, as the presses of a dataset
/// are solved.
///
/// The indenter touches first at `start` and moves through the poses of `path`, the first four of
/// which are straight below. Returns the fields of each frame on the pad's mesh of
/// [`model_nodes`](DatasetConfig::model_nodes), and the error that ended it early. Returns an error
/// for a configuration that is not one of presses, a path without a pose, or a mesh that cannot be
/// made.
pub fn solve_press(
    config: &DatasetConfig,
    shape: &Shape,
    start: Isometry3<f64>,
    path: Vec<Isometry3<f64>>,
) -> Result<(Vec<BodyFields>, Option<Error>)> {
    if config.scenario != Scenario::Presses {
        let found = format!("{:?}", config.scenario).to_lowercase();
        return Err(Error::invalid("scenario", found, "presses"));
    }
    let Some(down) = path.iter().take(DOWN.len()).next_back() else {
        return Err(Error::invalid("path", "first touch alone", "poses of frames after it"));
    };
    let (gel, depth) = (&config.gels[0], start.translation.z - down.translation.z);
    let pad = PressedPad::new(gel, config.model_nodes, config.truth_linear_nodes > 0)?;
    let motion = Motion { start, path, depth, friction: gel.friction };
    let solved = pad.solve_along(config, gel, shape.clone().validated()?, motion)?;
    Ok((solved.fields, solved.error))
}

/// Motion of an indenter, with its friction.
struct Motion {
    /// Pose at first touch.
    start: Isometry3<f64>,
    /// Poses of the frames.
    path: Vec<Isometry3<f64>>,
    /// Depth to which it goes straight down (m).
    depth: f64,
    friction: f64,
}

/// Frames of a press by finite elements on its truth mesh, what is stored of them, and the error
/// that ended it early.
struct SolvedPress {
    frames: Vec<Deformation>,
    fields: Vec<BodyFields>,
    error: Option<Error>,
}

/// A press of an indenter that is to be solved.
struct PressRun<'a> {
    pad: &'a PressedPad,
    config: &'a DatasetConfig,
    gel: &'a GelConfig,
    shape: Shape,
    /// Pose at first touch.
    start: Isometry3<f64>,
    /// Poses of the frames.
    path: Vec<Isometry3<f64>>,
    friction: f64,
    /// Least spacing of the nodes of its truth mesh (m), and places that the mesh is graded
    /// towards.
    finest: f64,
    points: Vec<Point3<f64>>,
}

impl PressRun<'_> {
    /// Solves the press on its truth mesh.
    fn direct(&self) -> Result<SolvedPress> {
        let fem = self.fem(Law::default())?;
        let carrier = Carrier::new(&fem, &self.pad.model.mesh)?;
        let (frames, error) = self.by_elements(&fem)?;
        let fields = frames.iter().map(|frame| BodyFields::of(frame, &carrier)).collect();
        Ok(SolvedPress { frames, fields, error })
    }

    /// Solves the press by linear elasticity with finely resolved `contact`, and adds what the
    /// nonlinear law changes on the truth mesh. Most of the error of a mesh is that of its contact
    /// and is the same by both laws, so that their difference needs fewer nodes than a solution.
    fn corrected(&self, contact: &LayeredPad) -> Result<SolvedPress> {
        let Self { config, pad, .. } = self;
        let (settled, unsettled) =
            self.along(|press| contact.settled_path(press), |found| &found.history)?;
        let [nonlinear, linear] = [self.fem(Law::default())?, self.fem(Law::Linear)?];
        let (mut frames, unsolved) = self.by_elements(&nonlinear)?;
        let (less, unsolved_linear) = self.by_elements(&linear)?;
        let ends =
            [(settled.len(), unsettled), (frames.len(), unsolved), (less.len(), unsolved_linear)];
        let (_, mut error) = ends.into_iter().min_by_key(|(count, _)| *count).expect("three ends");

        let near = (0.5 * self.finest, &self.points[..]);
        let size = (config.truth_linear_nodes, Law::Linear);
        let fine = self.graded(near, size)?;
        let elastic = fine.linearised()?;
        let mut workspace = elastic.workspace();
        let carrier = Carrier::new(&nonlinear, &pad.model.mesh)?;
        let finer = Carrier::new(&fine, &pad.model.mesh)?;
        let mut fields = Vec::new();
        for ((more, less), settled) in frames.iter().zip(&less).zip(&settled) {
            let loads = fine.loads(&contact.point_forces(settled, POINTS))?;
            let better = elastic.displacement(&loads, &mut workspace);
            let states = [more, less].map(|frame| &frame.history.displacement[..]);
            let carried = carrier.corrected(states, (&finer, &better))?;
            if !carried.von_mises.iter().all(|stress| stress.is_finite()) {
                error = Some(Error::Inverted);
                break;
            }
            let [mut contact_force, linear] =
                [more, less].map(|frame| carrier.spread(&frame.contact_force));
            contact_force.iter_mut().zip(linear).for_each(|(force, linear)| *force -= linear);
            for (node, borne) in contact.contacts(settled) {
                contact_force[node as usize] += borne.force;
            }
            let wrench = settled.wrench + (more.wrench - less.wrench);
            fields.push(BodyFields { carried, contact_force, wrench });
        }
        frames.truncate(fields.len());
        Ok(SolvedPress { frames, fields, error })
    }

    /// Finite elements by `law` on the truth mesh.
    fn fem(&self, law: Law) -> Result<Fem> {
        let near = (self.finest, &self.points[..]);
        self.graded(near, (self.config.truth_nodes, law))
    }

    /// Builds the finite elements of the pad by `law` on a mesh of at most `nodes` nodes, graded
    /// towards `points` with no spacing less than `finest` (m).
    fn graded(
        &self,
        (finest, points): (f64, &[Point3<f64>]),
        (nodes, law): (usize, Law),
    ) -> Result<Fem> {
        let pad = self.pad.sensor.outline.graded_to(finest, points, nodes)?;
        let limits = FemOptions { iterations: STEPS, patience: PATIENCE, ..FemOptions::default() };
        self.gel.body((pad.mesh, law), &pad.base, self.config, limits)
    }

    fn by_elements(&self, fem: &Fem) -> Result<(Vec<Deformation>, Option<Error>)> {
        self.along(|press| fem.solve_path(press), |frame| &frame.history)
    }

    /// Solves the frames in the configured number of load steps each, up to the first that fails;
    /// returns its error.
    fn along<T>(
        &self,
        solve: impl Fn(&Press) -> Vec<Result<T>>,
        history: impl Fn(&T) -> &History,
    ) -> Result<(Vec<T>, Option<Error>)> {
        let Self { shape, start, path, .. } = self;
        let mut frames = Vec::<T>::new();
        for (from, to) in std::iter::once(start).chain(path).zip(path) {
            let mut steps = steps(from, to, self.config.truth_steps);
            if frames.is_empty() {
                // Else each model would come from where it takes such a shape to come from.
                steps.insert(0, vec![*from]);
            }
            let mut press =
                Press::along(vec![shape.clone()], steps)?.with_friction(self.friction)?;
            if let Some(before) = frames.last() {
                press = press.after(history(before).clone())?;
            }
            match solve(&press).pop().expect("a press has a frame or an error") {
                Ok(frame) => frames.push(frame),
                Err(error) => return Ok((frames, Some(error))),
            }
        }
        Ok((frames, None))
    }
}

/// Poses at the ends of `count` equal load steps between two frames.
pub(crate) fn steps(
    from: &Isometry3<f64>,
    to: &Isometry3<f64>,
    count: usize,
) -> Vec<Vec<Isometry3<f64>>> {
    (1..=count).map(|i| between(&[*from], &[*to], i as f64 / count as f64)).collect()
}
