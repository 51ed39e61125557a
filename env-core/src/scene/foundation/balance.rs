//! Forces of the elastic foundation at the end of a step: backward Euler in N = 6 B + 2 unknowns.
//!
//! The unknowns are the velocities v of the B bodies that the pads touch (6 each), the object
//! first, and of the two slides at the end of the step; Newton's method solves M (v − v₀) = h f(v),
//! in each step together with the rigid contact with a fixture ([`super::stops`]). The contact
//! geometry is that at the beginning of the step, so depth and stretch of a bristle are linear in
//! v. A slipping bristle contributes its secant stiffness, which makes its part a fixed-point
//! iteration that does not overshoot.

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::{
    stops::{FixtureContact, FixtureImpulses, Velocities},
    touch::{BristleContact, cut},
};
use crate::{deformation::Wrench, scene::MOST_DISTRACTORS};

type StiffnessMatrix<const N: usize> = SMatrix<f64, N, N>;

/// Number of unknowns with as many bodies as a scene can have.
const MOST_UNKNOWNS: usize = 6 * (1 + MOST_DISTRACTORS) + 2;

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
    /// Bodies that the pads may touch (B), the object first.
    pub(super) inertias: Vec<Inertia>,
    /// Velocities at the beginning of the step (N).
    pub(super) motion: Vec<f64>,
    /// Forces that do not depend on the motion (N): weight, external force, drive, corrections, in
    /// N and N m.
    pub(super) loads: Vec<f64>,
    /// Direction of motion of the slides.
    pub(super) axis: Vector3<f64>,
    pub(super) finger_mass: f64,
    /// Damping (N s/m) of each slide, and stiffness (N/m) of the spring on their common position.
    pub(super) slide_damping: f64,
    pub(super) centering: f64,
}

/// Inertia of a body.
pub(super) struct Inertia {
    /// Mass (kg).
    pub(super) mass: f64,
    /// Moments about the centre of mass along the world's axes (kg m²).
    pub(super) moments: Matrix3<f64>,
}

/// A touch with its lever arm, in world axes.
pub(super) struct LoadedBristle {
    pub(super) finger: usize,
    /// Place of the touched body among [`Bodies::inertias`].
    pub(super) body: usize,
    pub(super) touch: BristleContact,
    /// Position relative to the body's centre of mass (m).
    arm: Vector3<f64>,
    normal: Vector3<f64>,
    stretch: Vector3<f64>,
    /// Stretch at the beginning of the step less the slip in it (m).
    left: Vector3<f64>,
    /// Velocity of the pad at the bristle if the slides were at rest (m/s).
    base: Vector3<f64>,
    /// Factor on the normal force.
    gain: f64,
    /// Stiffness along the normal and across it at the last motion of the balance (N/m).
    stiffness: [f64; 2],
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
        body: usize,
        touch: BristleContact,
        gain: f64,
        turn: &UnitQuaternion<f64>,
        arm: Vector3<f64>,
        base: Vector3<f64>,
    ) -> Self {
        let (normal, stretch) = (turn * touch.normal, turn * touch.stretch);
        let (left, stiffness) = (stretch, [0.0; 2]);
        Self { finger, body, touch, arm, normal, stretch, left, base, gain, stiffness }
    }

    /// Returns whether `other` is of the same finger and body, all of whose contacts are in a row.
    fn is_of_pair(&self, other: &Self) -> bool {
        (self.finger, self.body) == (other.finger, other.body)
    }

    /// Velocity of the body relative to the pad (m/s).
    fn velocity(&self, bodies: &Bodies, motion: &[f64]) -> Vector3<f64> {
        let own = &motion[6 * self.body..][..6];
        let linear = Vector3::from_column_slice(&own[..3]);
        let spin = Vector3::from_column_slice(&own[3..]).cross(&self.arm);
        linear + spin - self.base - bodies.axis * motion[slide(motion, self.finger)]
    }

    #[inline]
    fn answer(&self, bodies: &Bodies, motion: &[f64], friction: f64) -> BristleForce {
        let velocity = self.velocity(bodies, motion);
        let approach = velocity.dot(&self.normal);
        let (touch, h) = (&self.touch, bodies.time_step);
        let depth = touch.depth.moved(h * approach);
        let stiffness = self.gain * touch.stiffness;
        let pressing = stiffness * (depth.mean() + DAMPING * approach * depth.cover());
        let (pressing, across) = (pressing.max(0.0), velocity - approach * self.normal);
        let stretch = self.stretch + h * across;
        let trial = -touch.shear * (stretch + DAMPING * across);
        let sideways = cut(&trial, friction * pressing);
        let held = if sideways == trial { 1.0 } else { sideways.norm() / trial.norm() };
        let along = if pressing > 0.0 { stiffness * depth.cover() } else { 0.0 };
        BristleForce {
            normal: -pressing * self.normal,
            sideways,
            stiffness: [along, held * touch.shear],
            stretch: if held < 1.0 {
                self.stretch - (stretch - held * (stretch + DAMPING * across))
            } else {
                self.stretch
            },
        }
    }
}

/// Place of the slide of `finger` among the unknowns.
fn slide(unknowns: &[f64], finger: usize) -> usize {
    unknowns.len() - 2 + finger
}

impl Bodies {
    /// Forces of the foundation and mean forces of `stops` in the step on the unknowns (N), and the
    /// wrench of the stops on the object (torque about its centre of mass), if these meet no other
    /// contact in it.
    pub(super) fn balance(
        &self,
        contacts: &mut [LoadedBristle],
        stops: &[FixtureContact],
        friction: f64,
    ) -> (Vec<f64>, Wrench) {
        match self.inertias.len() {
            1 => self.balanced::<8>(contacts, stops, friction),
            2 => self.balanced::<14>(contacts, stops, friction),
            _ => self.balanced::<MOST_UNKNOWNS>(contacts, stops, friction),
        }
    }

    fn balanced<const N: usize>(
        &self,
        contacts: &mut [LoadedBristle],
        stops: &[FixtureContact],
        friction: f64,
    ) -> (Vec<f64>, Wrench) {
        let (mut motion, mut stopped) =
            (padded::<N>(&self.motion), FixtureImpulses::<N>::new(stops));
        let mut forces = self.exerted_on_unknowns(contacts, &motion, friction);
        for _ in 0..MOST_STEPS {
            let stiffness = stiffness(contacts, &self.axis);
            let step = self.newton_step(&motion, &forces, &stiffness, friction, &mut stopped);
            let expected = forces - stiffness * step * (self.time_step + DAMPING);
            motion += step;
            forces = self.exerted_on_unknowns(contacts, &motion, friction);
            if size(&(forces - expected)) <= CLOSE * size(&expected) {
                break;
            }
        }
        let stopped = stopped.sum() / self.time_step;
        forces += stopped;
        let (bodies, slides) = forces.as_slice().split_at(N - 2);
        let forces = [&bodies[..6 * self.inertias.len()], slides].concat();
        (forces, wrench_of(stopped.as_slice(), 0))
    }

    /// Wrenches of the fingers on each body (B) in N and N m about its centre of mass, in world
    /// axes, at the end of a step with this `motion` (N). Stores the remaining stretch in
    /// `contacts`.
    pub(super) fn exerted(
        &self,
        contacts: &mut [LoadedBristle],
        motion: &[f64],
        friction: f64,
    ) -> Vec<[Wrench; 2]> {
        let mut wrenches = vec![[Wrench::default(); 2]; self.inertias.len()];
        for contact in contacts {
            let answer = contact.answer(self, motion, friction);
            let force = answer.normal + answer.sideways;
            wrenches[contact.body][contact.finger].add_force(&force, &contact.arm);
            contact.left = answer.stretch;
        }
        wrenches
    }

    /// Adds a wrench of `finger` on a body about its centre of mass to the `forces` on the
    /// unknowns; the finger bears the reaction.
    pub(super) fn add(&self, forces: &mut [f64], body: usize, finger: usize, wrench: &Wrench) {
        let parts = wrench.force.iter().chain(&wrench.torque);
        forces[6 * body..].iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
        let slide = slide(forces, finger);
        forces[slide] -= self.axis.dot(&wrench.force);
    }

    /// Forces of the foundation on the unknowns. Stores the stiffness that belongs to them in
    /// `contacts`.
    fn exerted_on_unknowns<const N: usize>(
        &self,
        contacts: &mut [LoadedBristle],
        motion: &Velocities<N>,
        friction: f64,
    ) -> Velocities<N> {
        let mut forces = Velocities::<N>::zeros();
        for pair in contacts.chunk_by_mut(LoadedBristle::is_of_pair) {
            let (finger, body) = (pair[0].finger, pair[0].body);
            let mut wrench = Wrench::default();
            for contact in pair {
                let answer = contact.answer(self, motion.as_slice(), friction);
                wrench.add_force(&(answer.normal + answer.sideways), &contact.arm);
                contact.stiffness = answer.stiffness;
            }
            self.add(forces.as_mut_slice(), body, finger, &wrench);
        }
        forces
    }

    /// Change of `motion` in a Newton step, with the impulses of the stops that belong to it.
    fn newton_step<const N: usize>(
        &self,
        motion: &Velocities<N>,
        foundation: &Velocities<N>,
        stiffness: &StiffnessMatrix<N>,
        friction: f64,
        stopped: &mut FixtureImpulses<N>,
    ) -> Velocities<N> {
        let h = self.time_step;
        let mut matrix = stiffness * (h * (h + DAMPING));
        let mut forces = padded::<N>(&self.loads) + foundation;
        let change = motion - padded::<N>(&self.motion);
        let mut momentum = Velocities::<N>::zeros();
        for body in 0..N / 6 {
            let at = 6 * body;
            let Some(Inertia { mass, moments }) = self.inertias.get(body) else {
                // The unknowns of no body stay zero.
                (at..at + 6).for_each(|i| matrix[(i, i)] = 1.0);
                continue;
            };
            for i in at..at + 3 {
                matrix[(i, i)] += mass;
                momentum[i] = mass * change[i];
            }
            let mut turning = matrix.fixed_view_mut::<3, 3>(at + 3, at + 3);
            turning += moments;
            let turned = moments * change.fixed_rows::<3>(at + 3);
            momentum.fixed_rows_mut::<3>(at + 3).copy_from(&turned);
        }
        let slides = [N - 2, N - 1];
        let common = 0.5 * self.centering * (h * (motion[N - 2] + motion[N - 1]));
        for i in slides {
            forces[i] -= self.slide_damping * motion[i] + common;
            matrix[(i, i)] += self.finger_mass + h * self.slide_damping;
            for j in slides {
                matrix[(i, j)] += 0.5 * h * h * self.centering;
            }
            momentum[i] = self.finger_mass * change[i];
        }
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

/// Stiffness −∂f/∂x of the foundation's forces on the unknowns, from that stored in `contacts`,
/// with slides along `axis`.
fn stiffness<const N: usize>(
    contacts: &[LoadedBristle],
    axis: &Vector3<f64>,
) -> StiffnessMatrix<N> {
    let mut stiffness = StiffnessMatrix::<N>::zeros();
    for pair in contacts.chunk_by(LoadedBristle::is_of_pair) {
        let mut sums = Sums::default();
        for contact in pair {
            sums.add(contact);
        }
        sums.spread(axis, pair[0].body, pair[0].finger, &mut stiffness);
    }
    stiffness
}

/// The unknowns of some bodies and the slides, with zeros for further bodies.
fn padded<const N: usize>(unknowns: &[f64]) -> Velocities<N> {
    let (bodies, slides) = unknowns.split_at(unknowns.len() - 2);
    let mut all = Velocities::<N>::zeros();
    all.as_mut_slice()[..bodies.len()].copy_from_slice(bodies);
    all.as_mut_slice()[N - 2..].copy_from_slice(slides);
    all
}

/// Part of forces on the unknowns that acts on a body.
pub(super) fn wrench_of(forces: &[f64], body: usize) -> Wrench {
    let own = &forces[6 * body..][..6];
    let [force, torque] = [0, 3].map(|i| Vector3::from_column_slice(&own[i..i + 3]));
    Wrench { force, torque }
}

/// Magnitude of forces on the unknowns (N), with torques divided by `LEVER`.
fn size<const N: usize>(forces: &Velocities<N>) -> f64 {
    let of = |body: usize| {
        let turning = forces.fixed_rows::<3>(6 * body + 3).norm() / LEVER;
        forces.fixed_rows::<3>(6 * body).norm().max(turning)
    };
    let slides = forces[N - 2].abs().max(forces[N - 1].abs());
    (0..N / 6).map(of).fold(slides, f64::max)
}

/// Sums over the touches of one finger and body from which their stiffness is assembled.
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
    fn add(&mut self, contact: &LoadedBristle) {
        let [along, across] = contact.stiffness;
        let (arm, n) = (&contact.arm, &contact.normal);
        self.across += across;
        self.first += across * arm;
        self.second += across * arm * arm.transpose();
        let turn = arm.cross(n);
        let lever = SVector::<f64, 6>::new(n.x, n.y, n.z, turn.x, turn.y, turn.z);
        for (mut column, part) in self.normal.column_iter_mut().zip(&lever) {
            column += ((along - across) * part) * lever;
        }
    }

    /// Adds Σ Jᵀ K J with J = (1, −[r]×, −axis) to `stiffness`.
    fn spread<const N: usize>(
        &self,
        axis: &Vector3<f64>,
        body: usize,
        finger: usize,
        stiffness: &mut StiffnessMatrix<N>,
    ) {
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
        let (at, slide) = (6 * body, N - 2 + finger);
        let mut block = stiffness.fixed_view_mut::<6, 6>(at, at);
        block += object;
        for i in 0..6 {
            stiffness[(at + i, slide)] += column[i];
            stiffness[(slide, at + i)] += column[i];
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
