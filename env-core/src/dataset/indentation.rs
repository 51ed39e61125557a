//! An indenter of any size that moves through given poses into one pad.
//!
//! It touches with a drawn orientation at a drawn place, goes down in steps to a drawn depth, and
//! in two of five presses moves on sideways, twists and rolls, with the friction coefficient of the
//! press. Finite elements are solved on a mesh graded towards the part of the face that the
//! indenter would cover if the gel deformed nowhere else, alone or to correct linear elasticity with
//! finely resolved contact.

use std::{
    collections::HashSet,
    f64::consts::{FRAC_PI_4, TAU},
};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::{
    config::{DatasetConfig, GelConfig, Scenario},
    plan::{Plan, choose},
    record::{BodyFields, Named, of_frames, pose, wrenches},
    tensor::Tensor,
};
use crate::{
    Error, Result,
    compliance::{
        Compliance, ComplianceOptions,
        nodal::{ContactResolution, LayeredPad},
    },
    contact::between,
    deformation::{Deformation, History, Law, Moduli, Press, SoftBody},
    fem::{Carrier, Fem},
    geometry::{PadMesh, PadOutline, Shape},
    objects::Object,
    sensor::Sensor,
};

/// Motion of an indenter, as drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Indentation {
    /// Coefficient of friction.
    pub friction: f64,
    /// Orientation in which it touches.
    pub turn: UnitQuaternion<f64>,
    /// Place of its centre in plan, over the half extents of the pad.
    pub spot: [f64; 2],
    /// Depth (m).
    pub depth: f64,
    /// Sideways motion over the depth, and rotation about the place of touch (rad), after it is
    /// down.
    pub onward: Option<([f64; 2], Vector3<f64>)>,
}

/// Parts of the depth at which frames are taken.
const DOWN: [f64; 4] = [0.15, 0.4, 0.7, 1.0];
/// Parts of the onward motion at which frames are taken; the last goes back.
const ONWARD: [f64; 3] = [0.5, 1.0, 0.4];
/// Most frames of a press.
pub(super) const FRAMES: usize = DOWN.len() + ONWARD.len();
/// Least depth (m), and the greatest over the thickness of the indenter.
const DEPTHS: (f64, f64) = (2e-5, 0.6);
/// Coefficients of friction, each as frequent as the others.
const FRICTIONS: [f64; 8] = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.0, 2.0];
/// The least and the greatest of them.
pub(super) const FRICTION: [f64; 2] = [0.0, 2.0];
/// Distance between the places at which the face is searched for the indenter (m), coarse and fine.
const APART: [f64; 2] = [4e-4, 1e-4];
/// Height of its origin at which a drawn indenter is above the face (m).
const ABOVE: f64 = 0.2;
/// Newton steps in a load step, and in a frame, after which a press ends unsolved.
pub(super) const STEPS: usize = 25;
pub(super) const PATIENCE: usize = 40;
/// Greatest force, in units of E t² with the thickness t: 80 N on a GelSight Mini.
const STRONGEST: f64 = 17.0;

/// Draws the presses of an indenter.
pub(super) fn indentations(config: &DatasetConfig, object: &Object) -> Vec<Plan> {
    (0..config.grasps_of(object)).map(|number| draw(config, object, number)).collect()
}

/// Thickness of an indenter (m): of a mesh, the shortest edge of its bounding box.
fn thickness_of(shape: &Shape) -> f64 {
    match shape {
        Shape::Mesh(surface) => {
            let (low, high) = surface.bounds();
            (high - low).min()
        }
        _ => shape.thickness(),
    }
}

/// Height of an indenter's origin (m) at which all of it is above the face.
fn above(shape: &Shape) -> f64 {
    match shape {
        Shape::Mesh(surface) => {
            surface.vertices().iter().map(|v| v.coords.norm() + 0.02).fold(ABOVE, f64::max)
        }
        _ => ABOVE,
    }
}

fn draw(config: &DatasetConfig, object: &Object, number: usize) -> Plan {
    let mut random = ChaCha8Rng::seed_from_u64(object.seed);
    random.set_stream(1 + number as u64);
    let mut uniform = || random.random::<f64>();
    // Half of them rest on a side or an end; the others have a random orientation.
    let mut tilt = Vector3::zeros();
    let turn = if uniform() < 0.5 {
        let quarter = |turns: f64| 0.25 * TAU * turns.floor();
        let side = UnitQuaternion::from_euler_angles(
            quarter(4.0 * uniform()),
            quarter(4.0 * uniform()),
            0.0,
        );
        tilt = Vector3::new(uniform() - 0.5, uniform() - 0.5, 0.0) * 0.2 * uniform();
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), TAU * uniform()) * side
    } else {
        let mut between = || 2.0 * uniform() - 1.0;
        let four = std::array::from_fn(|_| between() + between() + between());
        UnitQuaternion::new_normalize(nalgebra::Quaternion::from(four))
    };
    let gel = choose(config, uniform());
    let thickness = Sensor::named(&config.gels[gel].sensor).map_or(4e-3, |s| s.outline.thickness);
    let deepest = (config.depth * thickness).min(DEPTHS.1 * thickness_of(&object.shape));
    let depth = DEPTHS.0 * f64::max(deepest / DEPTHS.0, 1.0).powf(uniform().sqrt());
    let friction = FRICTIONS[(FRICTIONS.len() as f64 * uniform()) as usize];
    let spot = [uniform(), uniform()].map(|u| 1.9 * u - 0.95);
    let goes_on = uniform() < 0.4;
    let angle = |u: f64, most: f64| f64::min(depth / 5e-4, 1.0) * most * (2.0 * u - 1.0);
    let aside = [uniform(), uniform()].map(|u| 2.0 * u - 1.0);
    let rotation =
        Vector3::new(angle(uniform(), 0.14), angle(uniform(), 0.14), angle(uniform(), 0.18));
    let onward = goes_on.then_some((aside, rotation));
    // A third of those that rest do so exactly, the others are tilted by up to a few degrees.
    if uniform() < 1.0 / 3.0 {
        tilt = Vector3::zeros();
    }
    let turn = UnitQuaternion::from_scaled_axis(tilt) * turn;
    Plan {
        name: format!("{}/{number:03}", object.name),
        object: object.name.clone(),
        gel,
        tool: Isometry3::identity(),
        width: 0.0,
        quality: 0.0,
        force: 0.0,
        shear: [0.0; 2],
        twist: 0.0,
        indentation: Some(Indentation { friction, turn, spot, depth, onward }),
    }
}

/// Pad of a gel that indenters are pressed into.
pub(super) struct PressedPad {
    sensor: Sensor,
    /// Mesh on which fields are stored.
    pub(super) model: PadMesh,
    /// Finely resolved contact by linear elasticity, if it is wanted.
    contact: Option<LayeredPad>,
}

/// Nodes of the finite elements from which the influence of the pad's sides on finely resolved
/// contact is taken.
const ELEMENTS: usize = 2000;
/// Points along each side of a touching cell over which its force is spread: closer than the nodes of
/// the finest mesh.
const POINTS: u32 = 3;

impl PressedPad {
    /// Builds the pad of a gel with fields on at most `nodes` nodes, and with finely resolved contact
    /// if `fine`.
    pub(super) fn new(gel: &GelConfig, nodes: usize, fine: bool) -> Result<Self> {
        let sensor = Sensor::named(&gel.sensor)?;
        let model = sensor.pad(nodes)?;
        let contact = || -> Result<_> {
            let pad = sensor.pad(ELEMENTS)?;
            let moduli = Moduli { young: gel.young, poisson: gel.poisson };
            let body = SoftBody::new(pad.mesh.clone(), Law::Linear, moduli, &pad.base)?;
            let options = ComplianceOptions { friction: gel.friction, sweeps: 0 };
            let (compliance, fine) = (Compliance::new(body, options)?, ContactResolution::FINE);
            let (meshes, sides) = ((&pad, &model), compliance.side_responses(&pad)?);
            Ok(LayeredPad::new(&compliance, &sensor.outline, meshes, fine, &sides))
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

/// Solves one press of the first gel of `config`, with its friction, as the presses of a dataset are
/// solved.
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
    /// Least spacing of the nodes of its truth mesh (m), and places that the mesh is graded towards.
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
    /// nonlinear law changes on the truth mesh. Most of the error of a mesh is that of its contact and
    /// is the same by both laws, so that their difference needs fewer nodes than a solution.
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
        let fine = self.gel.graded(&pad.sensor, near, size, config)?;
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
        self.gel.graded(&self.pad.sensor, near, (self.config.truth_nodes, law), self.config)
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

impl Indentation {
    /// Pose at first touch, and those of the frames.
    fn path(&self, shape: &Shape, outline: &PadOutline) -> (Isometry3<f64>, Vec<Isometry3<f64>>) {
        let [x, y] = [0.5 * self.spot[0] * outline.width, 0.5 * self.spot[1] * outline.length];
        let at = |z: f64| Isometry3::from_parts(Translation3::new(x, y, z), self.turn);
        let mut places = face(outline, APART[0]);
        let gap = |places: &[Point3<f64>], z: f64| {
            let pose = at(z);
            let gaps =
                places.iter().map(|p| shape.distance(&pose.inverse_transform_point(p)).value);
            gaps.fold(f64::INFINITY, f64::min)
        };
        // The smallest gap is at most the distance that is left.
        let lower = |places: &[Point3<f64>], mut z: f64| {
            for _ in 0..500 {
                let gap = gap(places, z);
                if gap < 1e-7 {
                    break;
                }
                z -= gap;
            }
            z
        };
        let z = lower(&places, above(shape));
        let pose = at(z + APART[0]);
        let near = |p: &Point3<f64>| shape.distance(&pose.inverse_transform_point(p)).value;
        places.retain(|p| near(p) < 4.0 * APART[0]);
        let around: Vec<_> = places.iter().flat_map(|p| finer(outline, p)).collect();
        let touch = at(lower(&around, z + APART[0]));
        let down = |part: f64| Translation3::new(0.0, 0.0, -part * self.depth) * touch;
        let mut path: Vec<_> = DOWN.iter().map(|part| down(*part)).collect();
        if let Some(([x, y], rotation)) = self.onward {
            let bottom = down(1.0);
            // It turns about the place where it touched first.
            let pose = touch;
            let near = |p: &Point3<f64>| shape.distance(&pose.inverse_transform_point(p)).value;
            let pivot = around.iter().min_by(|a, b| near(a).total_cmp(&near(b)));
            let pivot = pivot.map_or(bottom.translation.vector, |p| p.coords);
            path.extend(ONWARD.iter().map(|part| {
                let turn = UnitQuaternion::from_scaled_axis(rotation * *part);
                let moved = Vector3::new(x, y, 0.0) * (self.depth * part);
                Translation3::from(moved + pivot) * turn * Translation3::from(-pivot) * bottom
            }));
        }
        (touch, path)
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

/// Places on the face, `apart` (m) from each other.
fn face(outline: &PadOutline, apart: f64) -> Vec<Point3<f64>> {
    let line = |extent: f64| {
        let count = (extent / apart).ceil() as usize;
        (0..=count).map(move |i| (i as f64 / count as f64 - 0.5) * extent)
    };
    let place = |x: f64, y: f64| Point3::new(x, y, outline.height(x, y));
    line(outline.width).flat_map(|x| line(outline.length).map(move |y| place(x, y))).collect()
}

/// Places on the face around one of those that are [`APART`].
fn finer(outline: &PadOutline, place: &Point3<f64>) -> Vec<Point3<f64>> {
    let count = (APART[0] / APART[1]).ceil() as i32;
    let (x, y) = (place.x, place.y);
    let step = |i: i32| f64::from(i) * APART[1];
    let all = (-count / 2..=count / 2)
        .flat_map(|i| (-count / 2..=count / 2).map(move |j| (x + step(i), y + step(j))));
    let within =
        |(x, y): &(f64, f64)| x.abs() <= 0.5 * outline.width && y.abs() <= 0.5 * outline.length;
    all.filter(within).map(|(x, y)| Point3::new(x, y, outline.height(x, y))).collect()
}

/// Width (m) of what the indenter covers at the deepest and the last of its poses, and places on the
/// face there and beside it.
fn covered(
    shape: &Shape,
    path: &[Isometry3<f64>],
    outline: &PadOutline,
    depth: f64,
) -> (f64, Vec<Point3<f64>>) {
    let last = path.len() - 1;
    let ends = [DOWN.len() - 1, DOWN.len() + 1].map(|end| path[last.min(end)]);
    let gap = |p: &Point3<f64>| {
        let gaps = ends.iter().map(|pose| shape.distance(&pose.inverse_transform_point(p)).value);
        gaps.fold(f64::INFINITY, f64::min)
    };
    let coarse = face(outline, APART[0]).into_iter().filter(|p| gap(p) < APART[0]);
    let mut fine: Vec<_> = coarse.flat_map(|p| finer(outline, &p)).collect();
    let least = fine.iter().map(gap).fold(f64::INFINITY, f64::min);
    fine.retain(|p| gap(p) < f64::max(0.0, least + 0.2 * depth));
    let square = |p: &Point3<f64>| [p.x, p.y].map(|x| (x / APART[1]).round() as i64);
    fine.sort_unstable_by_key(square);
    fine.dedup_by_key(|p| square(p));
    let width = width_of(&fine.iter().map(square).collect());
    // Wide contact needs fewer.
    let every = fine.len().div_ceil(4000).max(1);
    (width, fine.into_iter().step_by(every).collect())
}

/// Mean width (m) of a region of `squares` with sides of [`APART`]: four times its area over its
/// perimeter, which is the diameter of a disc and twice the thickness of a ring.
fn width_of(squares: &HashSet<[i64; 2]>) -> f64 {
    let sides = |[x, y]: &[i64; 2]| {
        let around = [[x - 1, *y], [x + 1, *y], [*x, y - 1], [*x, y + 1]];
        around.iter().filter(|square| !squares.contains(*square)).count()
    };
    // Along a smooth boundary there are 4/π times as many sides as it is long, on average.
    let perimeter = FRAC_PI_4 * squares.iter().map(sides).sum::<usize>() as f64;
    4.0 * squares.len() as f64 / perimeter.max(1.0) * APART[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disc_is_as_wide_as_its_diameter_and_a_ring_as_twice_its_thickness() {
        let between = |low: f64, high: f64| {
            let squares = (-60..=60).flat_map(|x| (-60..=60).map(move |y| [x, y]));
            let far = |[x, y]: &[i64; 2]| (*x as f64).hypot(*y as f64);
            squares.filter(|square| (low..high).contains(&far(square))).collect()
        };
        for (low, high, width) in [(0.0, 20.0, 40.0), (0.0, 50.0, 100.0), (40.0, 46.0, 12.0)] {
            let found = width_of(&between(low, high)) / APART[1];
            assert!((found / width - 1.0).abs() < 0.05, "{found} for {width}");
        }
        assert!(width_of(&HashSet::new()) == 0.0);
    }
}
