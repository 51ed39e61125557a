//! Forces of the elastic foundation at the end of a step: backward Euler in 8 unknowns.
//!
//! The unknowns are the velocities v of the object (6) and of the two slides at the end of the
//! step; Newton's method solves M (v − v₀) = h f(v), in each step together with the rigid contact
//! with a fixture ([`super::stops`]). The contact geometry is that at the beginning
//! of the step, so depth and stretch of a bristle are linear in v. A slipping bristle contributes
//! its secant stiffness, which makes its part a fixed-point iteration that does not overshoot.

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::{
    stops::{FixtureContact, FixtureImpulses},
    touch::{BristleContact, cut},
};
use crate::deformation::Wrench;

/// Velocity of the object's centre of mass, its angular velocity, and speeds of the slides along
/// the wrist's x.
pub(super) type Velocities = SVector<f64, 8>;
type Matrix8 = SMatrix<f64, 8, 8>;

/// Damping of the gel over its stiffness (s).
const DAMPING: f64 = 2e-3;
/// Relative difference between forces and their linearised prediction below which Newton's method
/// stops.
const CLOSE: f64 = 1e-6;
/// Length by which torques are divided for comparison with forces (m).
const LEVER: f64 = 0.02;
/// Largest number of Newton steps; two are usual.
const MOST_STEPS: usize = 8;

/// Moving bodies with their velocities and loads, without the elastic foundation.
pub(super) struct Bodies {
    pub(super) time_step: f64,
    /// Mass (kg) and inertia about the centre of mass along the world's axes (kg m²) of the object.
    pub(super) mass: f64,
    pub(super) inertia: Matrix3<f64>,
    /// Velocities at the beginning of the step.
    pub(super) motion: Velocities,
    /// Forces that do not depend on the motion (N, N m): weight, external force, drive,
    /// corrections.
    pub(super) loads: Velocities,
    /// Direction of motion of the slides.
    pub(super) axis: Vector3<f64>,
    pub(super) finger_mass: f64,
    /// Damping (N s/m) of each slide, and stiffness (N/m) of the spring on their common position.
    pub(super) slide_damping: f64,
    pub(super) centering: f64,
}

/// A touch with its lever arm, in world axes.
pub(super) struct LoadedBristle {
    pub(super) finger: usize,
    pub(super) touch: BristleContact,
    /// Position relative to the object's centre of mass (m).
    arm: Vector3<f64>,
    normal: Vector3<f64>,
    stretch: Vector3<f64>,
    /// Stretch at the beginning of the step less the slip in it (m).
    left: Vector3<f64>,
    /// Velocity of the pad at the bristle if the slides were at rest (m/s).
    base: Vector3<f64>,
    /// Factor on the normal force.
    gain: f64,
}

/// Force of one bristle on the object and its stiffness.
struct BristleForce {
    normal: Vector3<f64>,
    sideways: Vector3<f64>,
    /// −∂force/∂displacement along the normal and across it (N/m).
    stiffness: [f64; 2],
    /// Stretch at the beginning of the step less the slip in it (m).
    stretch: Vector3<f64>,
}

impl LoadedBristle {
    pub(super) fn new(
        finger: usize,
        touch: BristleContact,
        gain: f64,
        turn: &UnitQuaternion<f64>,
        arm: Vector3<f64>,
        base: Vector3<f64>,
    ) -> Self {
        let (normal, stretch) = (turn * touch.normal, turn * touch.stretch);
        Self { finger, touch, arm, normal, stretch, left: stretch, base, gain }
    }

    /// Velocity of the object relative to the pad (m/s).
    fn velocity(&self, bodies: &Bodies, motion: &Velocities) -> Vector3<f64> {
        let (linear, angular) = (motion.fixed_rows::<3>(0), motion.fixed_rows::<3>(3));
        let spin = Vector3::from(angular).cross(&self.arm);
        linear + spin - self.base - bodies.axis * motion[6 + self.finger]
    }

    fn answer(&self, bodies: &Bodies, motion: &Velocities, friction: f64) -> BristleForce {
        let velocity = self.velocity(bodies, motion);
        let approach = velocity.dot(&self.normal);
        let (touch, h) = (&self.touch, bodies.time_step);
        let depth = touch.depth.moved(h * approach);
        let stiffness = self.gain * touch.stiffness;
        let pressing = stiffness * (depth.mean() + DAMPING * approach * depth.cover());
        let (pressing, across) = (pressing.max(0.0), velocity - approach * self.normal);
        let way = self.stretch + h * across;
        let trial = -touch.shear * (way + DAMPING * across);
        let sideways = cut(&trial, friction * pressing);
        let held = if sideways == trial { 1.0 } else { sideways.norm() / trial.norm() };
        let along = if pressing > 0.0 { stiffness * depth.cover() } else { 0.0 };
        BristleForce {
            normal: -pressing * self.normal,
            sideways,
            stiffness: [along, held * touch.shear],
            stretch: if held < 1.0 {
                self.stretch - (way - held * (way + DAMPING * across))
            } else {
                self.stretch
            },
        }
    }
}

impl Bodies {
    /// Forces of the foundation on object (torque about its centre of mass) and slides at the end
    /// of the step (N, N m), and mean forces of `stops` in the step, if these meet no other contact
    /// in it.
    pub(super) fn balance(
        &self,
        contacts: &[LoadedBristle],
        stops: &[FixtureContact],
        friction: f64,
    ) -> (Velocities, Velocities) {
        let (mut motion, mut stopped) = (self.motion, FixtureImpulses::new(stops));
        let (mut forces, mut stiffness) = self.linearised(contacts, &motion, friction);
        for _ in 0..MOST_STEPS {
            let step = self.newton_step(&motion, &forces, &stiffness, friction, &mut stopped);
            let expected = forces - stiffness * step * (self.time_step + DAMPING);
            motion += step;
            (forces, stiffness) = self.linearised(contacts, &motion, friction);
            if size(&(forces - expected)) <= CLOSE * size(&expected) {
                break;
            }
        }
        (forces, stopped.sum() / self.time_step)
    }

    /// Wrench of each finger on the object (N, N m about its centre of mass, in world axes) at the
    /// end of a step with this `motion`. Stores the remaining stretch in `contacts`.
    pub(super) fn exerted(
        &self,
        contacts: &mut [LoadedBristle],
        motion: &Velocities,
        friction: f64,
    ) -> [Wrench; 2] {
        let mut wrenches = [Wrench::default(); 2];
        for contact in contacts {
            let answer = contact.answer(self, motion, friction);
            let force = answer.normal + answer.sideways;
            let wrench = &mut wrenches[contact.finger];
            wrench.force += force;
            wrench.torque += contact.arm.cross(&force);
            contact.left = answer.stretch;
        }
        wrenches
    }

    /// Converts a wrench of `finger` on the object about its centre of mass to forces on the
    /// unknowns; the finger bears the reaction.
    pub(super) fn loads_of(&self, finger: usize, wrench: &Wrench) -> Velocities {
        let mut forces = Velocities::zeros();
        forces.fixed_rows_mut::<3>(0).copy_from(&wrench.force);
        forces.fixed_rows_mut::<3>(3).copy_from(&wrench.torque);
        forces[6 + finger] = -self.axis.dot(&wrench.force);
        forces
    }

    /// Forces of the foundation on the unknowns and their stiffness −∂f/∂x.
    fn linearised(
        &self,
        contacts: &[LoadedBristle],
        motion: &Velocities,
        friction: f64,
    ) -> (Velocities, Matrix8) {
        let (mut forces, mut stiffness) = (Velocities::zeros(), Matrix8::zeros());
        for finger in 0..2 {
            let (mut wrench, mut sums) = (Wrench::default(), Sums::default());
            for contact in contacts.iter().filter(|contact| contact.finger == finger) {
                let answer = contact.answer(self, motion, friction);
                let force = answer.normal + answer.sideways;
                wrench.force += force;
                wrench.torque += contact.arm.cross(&force);
                sums.add(contact, answer.stiffness);
            }
            forces += self.loads_of(finger, &wrench);
            sums.spread(&self.axis, finger, &mut stiffness);
        }
        (forces, stiffness)
    }

    /// Change of `motion` in a Newton step, with the impulses of the stops that belong to it.
    fn newton_step(
        &self,
        motion: &Velocities,
        foundation: &Velocities,
        stiffness: &Matrix8,
        friction: f64,
        stopped: &mut FixtureImpulses,
    ) -> Velocities {
        let h = self.time_step;
        let mut matrix = stiffness * (h * (h + DAMPING));
        for i in 0..3 {
            matrix[(i, i)] += self.mass;
        }
        let mut turning = matrix.fixed_view_mut::<3, 3>(3, 3);
        turning += self.inertia;
        let mut forces = self.loads + foundation;
        let common = 0.5 * self.centering * (h * (motion[6] + motion[7]));
        for i in [6, 7] {
            forces[i] -= self.slide_damping * motion[i] + common;
            matrix[(i, i)] += self.finger_mass + h * self.slide_damping;
            for j in [6, 7] {
                matrix[(i, j)] += 0.5 * h * h * self.centering;
            }
        }
        let change = motion - self.motion;
        let mut momentum = change * self.mass;
        let turned = self.inertia * change.fixed_rows::<3>(3);
        momentum.fixed_rows_mut::<3>(3).copy_from(&turned);
        momentum[6] = self.finger_mass * change[6];
        momentum[7] = self.finger_mass * change[7];
        let rest = forces * h - momentum;
        let Some(factor) = matrix.cholesky() else { return Velocities::zeros() };
        let mut step = factor.solve(&rest);
        if !stopped.is_empty() {
            stopped.solve(&(motion + step), h, friction, |impulse| factor.solve(impulse));
            step += factor.solve(&stopped.sum());
        }
        step
    }
}

/// Magnitude of forces on the unknowns (N), with torques divided by `LEVER`.
fn size(forces: &Velocities) -> f64 {
    let turning = forces.fixed_rows::<3>(3).norm() / LEVER;
    forces.fixed_rows::<3>(0).norm().max(turning).max(forces[6].abs()).max(forces[7].abs())
}

/// Sums over the touches of one finger from which its stiffness is assembled.
#[derive(Default)]
struct Sums {
    /// Σ c, Σ c r, Σ c r rᵀ of the stiffness c across the normals.
    across: f64,
    first: Vector3<f64>,
    second: Matrix3<f64>,
    /// Σ (k − c) g gᵀ with g = (n, r × n).
    normal: SMatrix<f64, 6, 6>,
}

impl Sums {
    fn add(&mut self, contact: &LoadedBristle, [along, across]: [f64; 2]) {
        let (arm, n) = (&contact.arm, &contact.normal);
        self.across += across;
        self.first += across * arm;
        self.second += across * arm * arm.transpose();
        let turn = arm.cross(n);
        let lever = SVector::<f64, 6>::new(n.x, n.y, n.z, turn.x, turn.y, turn.z);
        self.normal.ger(along - across, &lever, &lever, 1.0);
    }

    /// Adds Σ Jᵀ K J with J = (1, −[r]×, −axis) to `stiffness`.
    fn spread(&self, axis: &Vector3<f64>, finger: usize, stiffness: &mut Matrix8) {
        let mut object = self.normal;
        let skew = self.first.cross_matrix();
        let (mut a, c) = (object.fixed_view_mut::<3, 3>(0, 0), self.across);
        a += Matrix3::identity() * c;
        let mut b = object.fixed_view_mut::<3, 3>(3, 0);
        b += skew;
        let mut b = object.fixed_view_mut::<3, 3>(0, 3);
        b -= skew;
        let mut d = object.fixed_view_mut::<3, 3>(3, 3);
        d += Matrix3::identity() * self.second.trace() - self.second;
        // The motion of the slide along the axis is subtracted from that of the object.
        let column = -(object.fixed_view::<6, 3>(0, 0) * axis);
        let diagonal = -column.fixed_rows::<3>(0).dot(axis);
        let mut block = stiffness.fixed_view_mut::<6, 6>(0, 0);
        block += object;
        let slide = 6 + finger;
        for i in 0..6 {
            stiffness[(i, slide)] += column[i];
            stiffness[(slide, i)] += column[i];
        }
        stiffness[(slide, slide)] += diagonal;
    }
}

impl LoadedBristle {
    /// Stretch at the beginning of the step less the slip in it (m), in the pad's frame.
    pub(super) fn stretch_left(&self, turn: &UnitQuaternion<f64>) -> Vector3<f64> {
        turn.inverse_transform_vector(&self.left)
    }
}
