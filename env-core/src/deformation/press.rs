//! Presses of a soft body, and their solutions.

use std::ops::{Add, Sub};

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::History;
use crate::{
    Error, Result,
    geometry::{Footprint, PadOutline, Shape},
    saved::{self, Mark},
    sensor::MOST_FRICTION,
};

/// Most frames of a path that its footprint is made of, and most of its places.
const FRAMES_OF_FOOTPRINT: usize = 32;
const PLACES: usize = 4000;

const MARK: Mark = *b"deforma1";

/// Rigid shapes pressed into one soft body.
#[derive(Clone, Debug)]
pub struct Press {
    shapes: Vec<Shape>,
    drive: Drive,
    history: Option<History>,
    friction: Option<f64>,
}

/// Motion of the shapes. Poses are those of the shapes in the frame of the soft body.
#[derive(Clone, Debug)]
pub enum Drive {
    /// Motion through given poses.
    Translation {
        /// Poses of the shapes frame by frame (F, S).
        path: Vec<Vec<Isometry3<f64>>>,
    },
    /// Motion of all shapes together along a line until they press with a given force.
    Force {
        /// Poses of the shapes at the beginning of the line (S).
        poses: Vec<Isometry3<f64>>,
        /// Force of the shapes on the soft body along `direction` (N).
        force: f64,
        /// Direction of the motion and of the force component that counts.
        direction: Unit<Vector3<f64>>,
    },
}

/// Force and torque; on a soft body, about the origin of its frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wrench {
    /// Force (N).
    pub force: Vector3<f64>,
    /// Torque (N m).
    pub torque: Vector3<f64>,
}

impl Wrench {
    /// Resultant of forces (N), each with its arm (m) about the point of the torque.
    pub fn of_forces(forces: impl IntoIterator<Item = (Vector3<f64>, Vector3<f64>)>) -> Self {
        let mut sum = Self::default();
        forces.into_iter().for_each(|(force, arm)| sum.add_force(&force, &arm));
        sum
    }

    /// Adds a `force` (N) with its `arm` (m) about the point of the torque.
    pub fn add_force(&mut self, force: &Vector3<f64>, arm: &Vector3<f64>) {
        self.force += force;
        self.torque += arm.cross(force);
    }
}

impl Add for Wrench {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { force: self.force + other.force, torque: self.torque + other.torque }
    }
}

impl Sub for Wrench {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self { force: self.force - other.force, torque: self.torque - other.torque }
    }
}

/// Equilibrium of a soft body with the shapes that press it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Deformation {
    /// Displacement of the nodes (V, 3) in m.
    pub displacement: Vec<Vector3<f64>>,
    /// Von Mises equivalent of the Cauchy stress (T) in Pa.
    pub von_mises: Vec<f64>,
    /// Contact force on the nodes (V, 3) in N.
    pub contact_force: Vec<Vector3<f64>>,
    /// Resultant of all contact on the soft body.
    pub wrench: Wrench,
    /// Share of the normal force that the sliding part of the contact bears: points whose friction
    /// is at its limit.
    pub sliding: f64,
    /// Poses of the shapes (S).
    pub poses: Vec<Isometry3<f64>>,
    /// History from which a later press may continue.
    pub history: History,
    /// Newton steps, or sweeps of Gauss-Seidel, since the last frame.
    pub iterations: usize,
    /// Norm of the residual force (N); 0 where it is not asked for.
    pub residual: f64,
    /// Wall time (s).
    pub seconds: f64,
    /// Bounds of the relative errors that the model expects, if it predicts its own.
    pub predicted_error: Option<PredictedError>,
}

impl Deformation {
    /// Solution for a body whose Young's modulus is `stiffness` times this one's: displacements are
    /// the same, stresses and forces are in proportion to it. The history stays this body's.
    #[must_use]
    pub fn stiffened(mut self, stiffness: f64) -> Self {
        if stiffness == 1.0 {
            return self;
        }
        self.von_mises.iter_mut().for_each(|stress| *stress *= stiffness);
        self.contact_force.iter_mut().for_each(|force| *force *= stiffness);
        self.wrench.force *= stiffness;
        self.wrench.torque *= stiffness;
        self.residual *= stiffness;
        self
    }

    /// Serialises the solution, exact to the bit.
    pub fn to_bytes(&self) -> Vec<u8> {
        saved::to_bytes(MARK, self)
    }

    /// Restores a solution from the result of [`Deformation::to_bytes`]; other bytes are an error.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        saved::from_bytes(MARK, "deformation", bytes)
    }
}

/// Relative errors against fine finite elements that 19 of 20 answers stay below.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PredictedError {
    /// Of the displacement, ‖û − u‖ / ‖u‖ over all nodes.
    pub displacement: f64,
    /// Of the von Mises stress, over all tetrahedra.
    pub stress: f64,
    /// Of the net force.
    pub force: f64,
}

impl PredictedError {
    /// Greatest error that is predicted.
    pub const MOST: f64 = 3.0;

    /// Errors of an answer with the errors `of_felt` contact, where a `share` of the contact is not
    /// felt at all: force and stress lack at least that share. Displacement lacks more, for it is
    /// small where contact is felt beside an edge; its root was large enough in the presses of the
    /// report `rim`.
    pub(crate) fn with_unfelt(of_felt: Option<Self>, share: f64) -> Option<Self> {
        if share == 0.0 {
            return of_felt;
        }
        let Self { displacement, stress, force } = of_felt.unwrap_or_default();
        let (displacement, stress) = (displacement.max(share.sqrt()), stress.max(share));
        Some(Self { displacement, stress, force: force.max(share) })
    }
}

/// Parts of a solution that cost extra.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// `true` for the von Mises stress; otherwise a model may leave it empty.
    pub stress: bool,
    /// `true` for the norm of the residual force; otherwise a model may leave it 0.
    pub residual: bool,
}

impl Wanted {
    /// All parts.
    pub const ALL: Self = Self { stress: true, residual: true };
}

/// Model that solves presses of one soft body.
pub trait DeformationModel: Send + Sync {
    /// Solves each press and returns its last frame, in order. A press that fails is an error in
    /// its place.
    fn solve(&self, presses: &[Press]) -> Vec<Result<Deformation>>;

    /// Solves each press as [`DeformationModel::solve`] does; optional parts of the solutions that
    /// are not `wanted` may be left out.
    fn solve_partially(&self, presses: &[Press], wanted: Wanted) -> Vec<Result<Deformation>> {
        let _ = wanted;
        self.solve(presses)
    }

    /// Solves every frame of `press`, in order; the first that fails is an error and the last.
    fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>>;
}

impl Drive {
    /// Poses of the shapes at the beginning of the press (S), without regard to a history.
    pub fn first(&self) -> &[Isometry3<f64>] {
        match self {
            Self::Translation { path } => &path[0],
            Self::Force { poses, .. } => poses,
        }
    }
}

impl Press {
    /// Returns a press that moves `shapes` through the poses of `path` (F, S).
    pub fn along(shapes: Vec<Shape>, path: Vec<Vec<Isometry3<f64>>>) -> Result<Self> {
        if path.is_empty() {
            return Err(Error::invalid("path", "no frames", "at least one"));
        }
        path.iter().try_for_each(|poses| check_poses(shapes.len(), poses))?;
        Self::new(shapes, Drive::Translation { path })
    }

    /// Returns a press that moves `shapes` from `poses` along `direction` until they press with
    /// `force` (N).
    pub fn with_force(
        shapes: Vec<Shape>,
        poses: Vec<Isometry3<f64>>,
        force: f64,
        direction: Vector3<f64>,
    ) -> Result<Self> {
        check_poses(shapes.len(), &poses)?;
        if !(force.is_finite() && force > 0.0) {
            return Err(Error::invalid("force", force, "a finite force above 0 N"));
        }
        let direction = Unit::try_new(direction, 1e-12)
            .filter(|d| d.iter().all(|x| x.is_finite()))
            .ok_or_else(|| {
                let found = format!("{:?}", direction.data.0[0]);
                Error::invalid("direction", found, "a vector with a length")
            })?;
        Self::new(shapes, Drive::Force { poses, force, direction })
    }

    /// Returns this press with the final state of another as its start.
    pub fn after(mut self, history: History) -> Result<Self> {
        let (found, shapes) = (history.poses.len(), self.shapes.len());
        if found != shapes {
            let expected = format!("one of {shapes}, those of the press");
            return Err(Error::invalid("history", format!("one of {found} shapes"), expected));
        }
        if let Some(anchor) = history.anchors.iter().find(|a| a.shape as usize >= self.shapes.len())
        {
            let expected = format!("anchors on {} shapes", self.shapes.len());
            return Err(Error::invalid("history", anchor.shape, expected));
        }
        let places = history.anchors.iter().map(|anchor| &anchor.place.coords);
        let vectors = history.displacement.iter().chain(places).chain(&history.forces);
        let mut numbers = vectors.flat_map(|v| v.iter());
        if let Some(x) = numbers.find(|x| !x.is_finite()) {
            return Err(Error::invalid("history", x, "finite displacements, anchors and forces"));
        }
        self.history = Some(history);
        Ok(self)
    }

    /// Returns a press from rest with only the last frame of this one; `None` if this one is such a
    /// press or is driven by a force.
    pub fn final_frame(&self) -> Option<Self> {
        let Drive::Translation { path } = &self.drive else { return None };
        if self.history.is_none() && path.len() < 2 {
            return None;
        }
        let drive = Drive::Translation { path: vec![path.last()?.clone()] };
        Some(Self { drive, history: None, ..self.clone() })
    }

    /// Returns this press with another force (N) in place of its own, if a force drives it.
    pub(crate) fn with_other_force(&self, other: f64) -> Self {
        let mut press = self.clone();
        if let Drive::Force { force, .. } = &mut press.drive {
            *force = other;
        }
        press
    }

    /// Returns this press with its own coefficient of friction, 0 to 100, in place of the model's.
    pub fn with_friction(mut self, friction: f64) -> Result<Self> {
        if !(0.0..=MOST_FRICTION).contains(&friction) {
            let expected = format!("a coefficient from 0 to {MOST_FRICTION}");
            return Err(Error::invalid("friction", friction, expected));
        }
        self.friction = Some(friction);
        Ok(self)
    }

    fn new(shapes: Vec<Shape>, drive: Drive) -> Result<Self> {
        if shapes.is_empty() {
            return Err(Error::invalid("shapes", "none", "at least one rigid shape"));
        }
        let shapes = shapes.into_iter().map(Shape::validated).collect::<Result<_>>()?;
        Ok(Self { shapes, drive, history: None, friction: None })
    }

    /// The rigid shapes (S).
    pub fn shapes(&self) -> &[Shape] {
        &self.shapes
    }

    /// Places on the face of a pad (in its frame, m) that the shapes would cover along the path if
    /// the gel deformed nowhere else, towards which a mesh can be graded.
    ///
    /// # Errors
    ///
    /// A press with a force, whose depth is not known, and one that does not reach the face.
    pub fn footprint(&self, outline: &PadOutline) -> Result<Vec<Point3<f64>>> {
        let Drive::Translation { path } = &self.drive else {
            let expected = "points, or a press along a path: how deep a force goes is not known";
            return Err(Error::invalid("around", "a press with a force", expected));
        };
        let every = path.len().div_ceil(FRAMES_OF_FOOTPRINT);
        // From the last on, which is the deepest as a rule.
        let frames = path.iter().rev().step_by(every.max(1));
        let placed: Vec<_> =
            frames.flat_map(|frame| self.shapes.iter().zip(frame.iter().copied())).collect();
        let found = Footprint::new(outline, &placed, |least| f64::max(0.0, 1.2 * least));
        let places = found.places(PLACES);
        if places.is_empty() {
            let found = "a press that does not reach the pad";
            return Err(Error::invalid("around", found, "one that touches its face"));
        }
        Ok(places)
    }

    /// Motion of the shapes.
    pub fn drive(&self) -> &Drive {
        &self.drive
    }

    /// Press of the same shapes that begins from rest where this one ends; `None` for one that ends
    /// at a force.
    pub fn at_end(&self) -> Option<Result<Self>> {
        let Drive::Translation { path } = &self.drive else { return None };
        Some(Self::along(self.shapes.clone(), vec![path.last()?.clone()]))
    }

    /// State from which the press starts; `None` for a start from rest.
    pub fn history(&self) -> Option<&History> {
        self.history.as_ref()
    }

    /// Returns whether the press starts from rest with the shapes at `poses` (S).
    pub(crate) fn begins_at(&self, poses: &[Isometry3<f64>]) -> bool {
        self.history.is_none() && self.drive.first() == poses
    }

    /// Coefficient of Coulomb friction; `None` for that of the model.
    pub fn friction(&self) -> Option<f64> {
        self.friction
    }
}

fn check_poses(shapes: usize, poses: &[Isometry3<f64>]) -> Result<()> {
    if poses.len() != shapes {
        return Err(Error::invalid(
            "poses",
            poses.len(),
            format!("one for each of {shapes} shapes"),
        ));
    }
    for pose in poses {
        let numbers = pose.translation.vector.iter().chain(pose.rotation.coords.iter());
        if !numbers.copied().all(f64::is_finite) {
            return Err(Error::invalid("pose", pose, "finite numbers"));
        }
        if (pose.rotation.norm() - 1.0).abs() > 1e-6 {
            return Err(Error::invalid("pose", pose.rotation, "a unit quaternion"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::deformation::{Anchor, history::tests::foreign};

    fn ball() -> Vec<Shape> {
        vec![Shape::Sphere { radius: 0.004 }]
    }

    #[test]
    fn presses_that_make_no_sense_are_refused() {
        let (here, z) = (Isometry3::identity(), Vector3::z());
        let mut nowhere = here;
        nowhere.translation.vector.x = f64::NAN;
        assert!(Press::along(ball(), vec![]).is_err());
        assert!(Press::along(ball(), vec![vec![here, here]]).is_err());
        assert!(Press::along(ball(), vec![vec![nowhere]]).is_err());
        assert!(Press::along(vec![], vec![vec![]]).is_err());
        assert!(Press::along(vec![Shape::Sphere { radius: -1.0 }], vec![vec![here]]).is_err());
        for force in [0.0, -1.0, f64::INFINITY] {
            assert!(Press::with_force(ball(), vec![here], force, z).is_err(), "{force} N");
        }
        assert!(Press::with_force(ball(), vec![here], 1.0, Vector3::zeros()).is_err());
    }

    #[test]
    fn a_history_of_other_shapes_is_refused() {
        let here = Isometry3::identity();
        let press = Press::along(ball(), vec![vec![here]]).unwrap();
        let anchor = Anchor { shape: 1, point: 0, place: Point3::origin() };
        let history = |poses: usize, anchors: Vec<Anchor>| History {
            model: foreign(),
            displacement: vec![Vector3::zeros(); 4],
            poses: vec![here; poses],
            anchors,
            forces: vec![],
            folded: false,
        };
        assert!(press.clone().after(history(1, vec![])).is_ok());
        assert!(press.clone().after(history(2, vec![])).is_err());
        assert!(press.after(history(1, vec![anchor])).is_err());
    }
}
