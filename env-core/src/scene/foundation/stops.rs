//! Rigid contact of the object with a fixture, in the same step as the elastic foundation.
//!
//! The foundation is so stiff that a contact force missing from its balance would cause an error of
//! many times that force in its next step. So the two are solved together: the impulses λ of the
//! contact points satisfy, at the end of a step, 0 ≤ λₙ ⊥ g + h vₙ ≥ 0 with the gap g, and
//! Coulomb's law, with the velocities that follow from them and from the foundation (Jean 1999,
//! "The non-smooth contact dynamics method"). They are found by projected Gauss–Seidel sweeps.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Matrix3, Point3, SMatrix, SVector, Translation3, Vector3};
use rapier3d::{
    parry::{
        bounding_volume::BoundingVolume,
        query::{ContactManifold, DefaultQueryDispatcher, PersistentQueryDispatcher},
    },
    prelude::{Collider, Cuboid},
};

use crate::scene::units;

/// Velocity of the centre of mass and angular velocity of each body, and speeds of the slides along
/// the wrist's x.
pub(super) type Velocities<const N: usize> = SVector<f64, N>;

/// Distance below which a point takes part (m): twice what a peg moves in a Rapier step.
const NEAR: f64 = 2e-4;
/// Overlap that no object reaches (m), and by how much one is lifted for a second look (m).
const DEEPEST: f64 = 5e-3;
const LIFT: f64 = 1e-6;
/// Share of an overlap that is removed in one step.
const RECOVERY: f64 = 0.3;
/// Compliance of a contact point (m/N), which decides how points share a load.
const COMPLIANCE: f64 = 1e-8;
/// Cosine above which a normal counts as along an axis of a box.
const ALONG: f64 = 0.5;
/// Most sweeps, and relative change of the impulses at which they end.
const SWEEPS: usize = 60;
const CLOSE: f64 = 1e-3;
/// Directions in which the outermost points of one face are kept; the others bear nothing that
/// these cannot.
const DIRECTIONS: usize = 8;
/// Cosine between normals of one face.
const PARALLEL: f64 = 0.9999;

/// Point of the object next to the fixture.
#[derive(Clone, Debug)]
pub(in crate::scene) struct FixtureContact {
    /// Position relative to the object's centre of mass, in the axes of the world (m).
    arm: Vector3<f64>,
    /// Normal towards the object, and two directions across it, as columns.
    frame: Matrix3<f64>,
    /// Distance along the normal (m), negative inside.
    gap: f64,
}

/// Points at which `object` is next to the boxes of a fixture ([`crate::scene::Fixture::boxes`]),
/// relative to its centre of mass `center` (m).
pub(super) fn stops<'a>(
    boxes: impl Iterator<Item = &'a (Isometry3<f64>, Vector3<f64>)>,
    object: &Collider,
    center: &Vector3<f64>,
) -> Vec<FixtureContact> {
    let (mut stops, mut manifolds) = (Vec::new(), Vec::<ContactManifold<(), ()>>::new());
    let pose = units::si_pose(object.position());
    for (part, half) in boxes {
        let seen = units::pose(&part.inv_mul(&pose));
        let solid = Cuboid::new(units::vector(half));
        let reach = object.shape().compute_aabb(&seen).loosened(units::scalar(NEAR));
        if !solid.local_aabb().intersects(&reach) {
            continue;
        }
        // Polyhedra that only just touch are now and then found to overlap by all of their lengths.
        // Nearby they are not.
        let lifts = [0.0, LIFT, -LIFT, 2.0 * LIFT];
        let Some(lift) = lifts.into_iter().find(|&lift| {
            let lifted = Translation3::new(0.0, 0.0, lift) * pose;
            manifolds.clear();
            let found = DefaultQueryDispatcher.contact_manifolds(
                &units::pose(&part.inv_mul(&lifted)),
                &solid,
                object.shape(),
                units::scalar(NEAR),
                &mut manifolds,
                &mut None,
            );
            let mut points = manifolds.iter().flat_map(|manifold| &manifold.points);
            found.is_ok() && points.all(|point| units::si(point.dist) > -DEEPEST)
        }) else {
            continue;
        };
        for manifold in &manifolds {
            let normal = units::si_angular(manifold.local_n1);
            // Faces behind the walls and between neighbours are inside the block.
            if normal.x > ALONG || normal.y.abs() > ALONG {
                continue;
            }
            let normal = part.rotation * normal;
            for point in manifold.points.iter().filter(|p| units::si(p.dist) < NEAR) {
                let place = part * Point3::from(units::si_vector(point.local_p1));
                let gap = units::si(point.dist) - lift * normal.z;
                stops.push(FixtureContact::new(place.coords - center, normal, gap));
            }
        }
    }
    outermost(stops)
}

/// The outermost of the points that have one normal.
fn outermost(stops: Vec<FixtureContact>) -> Vec<FixtureContact> {
    let mut faces: Vec<Vec<FixtureContact>> = Vec::new();
    for stop in stops {
        let same =
            |face: &&mut Vec<FixtureContact>| face[0].normal().dot(&stop.normal()) > PARALLEL;
        match faces.iter_mut().find(same) {
            Some(face) => face.push(stop),
            None => faces.push(vec![stop]),
        }
    }
    let mut kept = Vec::new();
    for face in &mut faces {
        if face.len() > DIRECTIONS {
            let frame = face[0].frame;
            let mut chosen: Vec<usize> = (0..DIRECTIONS)
                .map(|k| {
                    let angle = TAU * k as f64 / DIRECTIONS as f64;
                    let direction = frame * Vector3::new(0.0, angle.cos(), angle.sin());
                    let reach = |i: &usize| face[*i].arm.dot(&direction);
                    let all = 0..face.len();
                    all.max_by(|a, b| reach(a).total_cmp(&reach(b))).unwrap_or_default()
                })
                .collect();
            // The deepest is not always one of them.
            let gap = |i: &usize| face[*i].gap;
            chosen.extend((0..face.len()).min_by(|a, b| gap(a).total_cmp(&gap(b))));
            chosen.sort_unstable();
            chosen.dedup();
            kept.extend(chosen.into_iter().map(|i| face[i].clone()));
        } else {
            kept.append(face);
        }
    }
    kept
}

impl FixtureContact {
    fn normal(&self) -> Vector3<f64> {
        self.frame.column(0).into_owned()
    }

    fn new(arm: Vector3<f64>, normal: Vector3<f64>, gap: f64) -> Self {
        let normal = normal.normalize();
        let least = normal.iamin();
        let first = normal.cross(&Vector3::ith(least, 1.0)).normalize();
        let frame = Matrix3::from_columns(&[normal, first, normal.cross(&first)]);
        Self { arm, frame, gap }
    }

    /// Derivative of the velocity along the frame with respect to the motion.
    fn jacobian<const N: usize>(&self) -> SMatrix<f64, 3, N> {
        let mut rows = SMatrix::<f64, 3, N>::zeros();
        for (i, direction) in self.frame.column_iter().enumerate() {
            rows.fixed_view_mut::<1, 3>(i, 0).copy_from(&direction.transpose());
            let turn = self.arm.cross(&direction.into_owned());
            rows.fixed_view_mut::<1, 3>(i, 3).copy_from(&turn.transpose());
        }
        rows
    }
}

/// Contact points with their impulses, kept between the Newton steps of one time step.
pub(super) struct FixtureImpulses<const N: usize> {
    points: Vec<(SMatrix<f64, 3, N>, f64)>,
    impulses: Vec<Vector3<f64>>,
}

impl<const N: usize> FixtureImpulses<N> {
    pub(super) fn new(stops: &[FixtureContact]) -> Self {
        let points = stops.iter().map(|stop| (stop.jacobian(), stop.gap)).collect();
        Self { points, impulses: vec![Vector3::zeros(); stops.len()] }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Sum of the impulses on the unknowns (N s, N m s).
    pub(super) fn sum(&self) -> Velocities<N> {
        let pairs = self.points.iter().zip(&self.impulses);
        pairs.map(|((rows, _), impulse)| rows.tr_mul(impulse)).sum()
    }

    /// Finds the impulses with which the velocities, `free` without them, obey the contact law
    /// after a step of `time` (s); an impulse p changes the velocities by `inverse` (p).
    pub(super) fn solve(
        &mut self,
        free: &Velocities<N>,
        time: f64,
        friction: f64,
        inverse: impl Fn(&Velocities<N>) -> Velocities<N>,
    ) {
        let responses: Vec<_> =
            self.points.iter().map(|(rows, _)| PointResponse::new(rows, &inverse)).collect();
        let mut motion = free + inverse(&self.sum());
        let soft = COMPLIANCE / (time * time);
        for _ in 0..SWEEPS {
            let (mut change, mut largest) = (0.0_f64, 0.0_f64);
            let points = self.points.iter().zip(&responses).zip(&mut self.impulses);
            for (((rows, gap), response), kept) in points {
                let impulse = *kept;
                let velocity = rows * motion;
                let bias = if *gap > 0.0 { gap / time } else { RECOVERY * gap / time };
                let along = -(velocity.x + bias + soft * impulse.x) / (response.along + soft);
                let pressing = (impulse.x + along).max(0.0);
                let moved = rows.fixed_rows::<2>(1)
                    * (motion + response.motion.column(0) * (pressing - impulse.x));
                let mut sideways = impulse.fixed_rows::<2>(1) - moved / (response.across + soft);
                let limit = friction * pressing;
                if sideways.norm() > limit {
                    sideways *= limit / sideways.norm();
                }
                let next = Vector3::new(pressing, sideways.x, sideways.y);
                let step = next - impulse;
                motion += response.motion * step;
                *kept = next;
                change = change.max(step.norm());
                largest = largest.max(next.norm());
            }
            if change <= CLOSE * largest {
                break;
            }
        }
    }
}

/// Response to unit impulses at a contact point.
struct PointResponse<const N: usize> {
    /// Change of the velocities by an impulse along each direction of the frame.
    motion: SMatrix<f64, N, 3>,
    /// Change of the point's velocity along the normal (1/kg).
    along: f64,
    /// The greater of the two changes across it (1/kg), which keeps the sweeps from overshooting.
    across: f64,
}

impl<const N: usize> PointResponse<N> {
    fn new(rows: &SMatrix<f64, 3, N>, inverse: impl Fn(&Velocities<N>) -> Velocities<N>) -> Self {
        let column = |i: usize| inverse(&rows.row(i).transpose());
        let motion = SMatrix::from_columns(&[column(0), column(1), column(2)]);
        let own = rows * motion;
        let across = 0.5 * (own[(1, 1)] + own[(2, 2)])
            + (0.25 * (own[(1, 1)] - own[(2, 2)]).powi(2) + own[(1, 2)].powi(2)).sqrt();
        Self { motion, along: own[(0, 0)], across }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::{
        geometry::Shape,
        scene::{Fixture, ObjectModel},
    };

    #[test]
    fn a_peg_that_just_touches_its_block_does_not_overlap_it() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let square = Shape::Cuboid { half_extents: Vector3::new(0.006, 0.006, 0.03) };
        let hexagonal = Shape::Prism { sides: 6, radius: 0.007, half_height: 0.03 };
        for shape in [square, hexagonal] {
            let model = ObjectModel::new(shape).unwrap();
            let fixture = Fixture::around(model.shape(), 1e-3, 0.02, 0.02).unwrap();
            let boxes = fixture.boxes();
            let mut collider = model.scaled(1.0).unwrap().build();
            let mut count = 0;
            for _ in 0..200_000 {
                let mut draw = || rng.random_range(-1.0..1.0);
                let tilt = Vector3::new(0.1 * draw(), 0.1 * draw(), 0.3 * draw());
                let turn = UnitQuaternion::from_scaled_axis(tilt);
                let tip = model.surface().vertices().iter().map(|place| turn * place.coords);
                let tip = tip.min_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
                // Just about the edge of the hole.
                let (part, half) = &boxes[(2.5 + 2.5 * draw()) as usize % boxes.len()];
                let edge = part * Point3::new(-half.x, 0.4 * half.y * draw(), half.z);
                let place = edge.coords - tip + 2e-6 * Vector3::from_fn(|_, _| draw());
                let pose = Isometry3::from_parts(place.into(), turn);
                collider.set_position(units::pose(&pose));
                let stops = stops(boxes.iter(), &collider, &place);
                count += usize::from(!stops.is_empty());
                let deepest = stops.iter().map(|stop| stop.gap).fold(0.0, f64::min);
                assert!(
                    deepest > -1e-4,
                    "{} overlaps by {deepest} m at {pose}",
                    model.shape().name()
                );
            }
            assert!(count > 1000, "touched {count} times");
        }
    }
}
