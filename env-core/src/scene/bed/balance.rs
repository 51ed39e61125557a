//! The bed's forces at the end of a step: backward Euler in 8 unknowns.
//!
//! Unknown are the velocities v of the object (6) and of the two slides at the end of the step; the
//! balance is M (v − v₀) = h f(v), solved by Newton's method. Contact geometry is that of the
//! beginning, so a bristle's depth and stretch are linear in v. A slipping bristle enters with its
//! secant stiffness, which makes its part a fixed-point iteration that does not overshoot.

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::touch::{Touch, cut};
use crate::scene::Wrench;

/// Velocity of the object's centre of mass, angular velocity, speeds of the slides along the wrist's x.
pub(super) type Motion = SVector<f64, 8>;
type Stiffness = SMatrix<f64, 8, 8>;

/// Time by which the gel's damping force lags its elastic one (s); stiffness-proportional.
const DAMPING: f64 = 2e-3;
/// Newton stops where the forces differ by less than this from the linearised ones, relative.
const CLOSE: f64 = 1e-6;
/// Lever at which torques count as forces (m).
const LEVER: f64 = 0.02;
/// Most Newton steps; two are usual.
const MOST_STEPS: usize = 8;

/// Everything that moves, beside the bed.
pub(super) struct Bodies {
    pub(super) time_step: f64,
    /// Mass (kg) and inertia about the centre of mass along the world's axes (kg m²) of the object.
    pub(super) mass: f64,
    pub(super) inertia: Matrix3<f64>,
    /// At the beginning of the step.
    pub(super) motion: Motion,
    /// All forces that do not depend on the motion (N, N m): weight, drive, corrections.
    pub(super) loads: Motion,
    /// Direction in which slides move.
    pub(super) axis: Vector3<f64>,
    pub(super) finger_mass: f64,
    /// Damping (N s/m) of each slide, and stiffness (N/m) of the spring on their common position.
    pub(super) slide_damping: f64,
    pub(super) centering: f64,
}

/// A touch with its lever, in axes of the world.
pub(super) struct Contact {
    pub(super) finger: usize,
    pub(super) touch: Touch,
    /// From the object's centre of mass (m).
    arm: Vector3<f64>,
    normal: Vector3<f64>,
    stretch: Vector3<f64>,
    /// Stretch at the end of the step, as far as the bristle does not slip (m).
    left: Vector3<f64>,
    /// Velocity of the pad there, slides at rest (m/s).
    base: Vector3<f64>,
    /// Factor on the normal force.
    gain: f64,
}

/// Force of one bristle on the object and how it changes with the object's motion.
struct Answer {
    normal: Vector3<f64>,
    sideways: Vector3<f64>,
    /// −∂force/∂motion along the normal and across (N/m).
    stiffness: [f64; 2],
    /// Stretch that the bristle ends with (m).
    stretch: Vector3<f64>,
}

impl Contact {
    pub(super) fn new(
        finger: usize,
        touch: Touch,
        gain: f64,
        turn: &UnitQuaternion<f64>,
        arm: Vector3<f64>,
        base: Vector3<f64>,
    ) -> Self {
        let (normal, stretch) = (turn * touch.normal, turn * touch.stretch);
        Self { finger, touch, arm, normal, stretch, left: stretch, base, gain }
    }

    /// Velocity of the object against the pad (m/s).
    fn velocity(&self, bodies: &Bodies, motion: &Motion) -> Vector3<f64> {
        let (linear, angular) = (motion.fixed_rows::<3>(0), motion.fixed_rows::<3>(3));
        let spin = Vector3::from(angular).cross(&self.arm);
        linear + spin - self.base - bodies.axis * motion[6 + self.finger]
    }

    fn answer(&self, bodies: &Bodies, motion: &Motion, friction: f64) -> Answer {
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
        Answer {
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
    /// Forces of the bed on object (about its centre of mass) and slides at the end of the step (N,
    /// N m), if nothing else is met in it.
    pub(super) fn balance(&self, contacts: &[Contact], friction: f64) -> Motion {
        let mut motion = self.motion;
        let (mut forces, mut stiffness) = self.linearised(contacts, &motion, friction);
        for _ in 0..MOST_STEPS {
            let step = self.newton_step(&motion, &forces, &stiffness);
            let expected = forces - stiffness * step * (self.time_step + DAMPING);
            motion += step;
            (forces, stiffness) = self.linearised(contacts, &motion, friction);
            if size(&(forces - expected)) <= CLOSE * size(&expected) {
                break;
            }
        }
        forces
    }

    /// What each finger exerts on the object (N, N m about its centre of mass, in axes of the world) at
    /// the end of a step with this `motion`; `contacts` learn the stretch that they are left with.
    pub(super) fn exerted(
        &self,
        contacts: &mut [Contact],
        motion: &Motion,
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

    /// A wrench on the object about its centre of mass as forces on the unknowns: the finger bears
    /// its reaction.
    pub(super) fn loads_of(&self, finger: usize, wrench: &Wrench) -> Motion {
        let mut forces = Motion::zeros();
        forces.fixed_rows_mut::<3>(0).copy_from(&wrench.force);
        forces.fixed_rows_mut::<3>(3).copy_from(&wrench.torque);
        forces[6 + finger] = -self.axis.dot(&wrench.force);
        forces
    }

    /// Forces of the bed and their stiffness −∂f/∂x.
    fn linearised(
        &self,
        contacts: &[Contact],
        motion: &Motion,
        friction: f64,
    ) -> (Motion, Stiffness) {
        let (mut forces, mut stiffness) = (Motion::zeros(), Stiffness::zeros());
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

    fn newton_step(&self, motion: &Motion, bed: &Motion, stiffness: &Stiffness) -> Motion {
        let h = self.time_step;
        let mut matrix = stiffness * (h * (h + DAMPING));
        for i in 0..3 {
            matrix[(i, i)] += self.mass;
        }
        let mut turning = matrix.fixed_view_mut::<3, 3>(3, 3);
        turning += self.inertia;
        let mut forces = self.loads + bed;
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
        matrix.cholesky().map_or_else(Motion::zeros, |factor| factor.solve(&rest))
    }
}

/// Size of forces on the unknowns (N), torques at a lever of `LEVER`.
fn size(forces: &Motion) -> f64 {
    let turning = forces.fixed_rows::<3>(3).norm() / LEVER;
    forces.fixed_rows::<3>(0).norm().max(turning).max(forces[6].abs()).max(forces[7].abs())
}

/// Sums over the touches of one finger that its stiffness is made of.
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
    fn add(&mut self, contact: &Contact, [along, across]: [f64; 2]) {
        let (arm, n) = (&contact.arm, &contact.normal);
        self.across += across;
        self.first += across * arm;
        self.second += across * arm * arm.transpose();
        let turn = arm.cross(n);
        let lever = SVector::<f64, 6>::new(n.x, n.y, n.z, turn.x, turn.y, turn.z);
        self.normal.ger(along - across, &lever, &lever, 1.0);
    }

    /// Adds Σ Jᵀ K J, J = (1, −[r]×, −axis).
    fn spread(&self, axis: &Vector3<f64>, finger: usize, stiffness: &mut Stiffness) {
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
        // The slide moves against the object along the axis.
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

impl Contact {
    /// Stretch that the bristle is left with (m), in the pad's frame.
    pub(super) fn stretch_left(&self, turn: &UnitQuaternion<f64>) -> Vector3<f64> {
        turn.inverse_transform_vector(&self.left)
    }
}
