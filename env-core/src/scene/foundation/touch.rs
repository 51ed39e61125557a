//! Contact of the face of a pad with the object, evaluated at bristles.

use nalgebra::{Isometry3, Matrix3, Point3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::law::{Depth, FoundationLaw};
use crate::geometry::{PadOutline, Shape};

/// Number of bristles across and along a pad.
const COUNTS: [usize; 2] = [8, 10];
/// Largest z of the object's normal at which the surface counts as facing the pad. Above it the
/// bristle is beside an edge and is pushed straight into the gel.
const STEEPEST: f64 = -0.5;
/// Largest z of the normal at which it faces the pad in full.
const FLATTER: f64 = -0.7;

/// A bristle's position on the undeformed face, in the pad's frame.
struct Root {
    place: Vector3<f64>,
    /// Edges of the bristle's cell along the face (m).
    edges: [Vector3<f64>; 2],
    /// Places half of an edge further along it and half of it back (m).
    borders: [[Vector3<f64>; 2]; 2],
    /// Half of the longer edge (m).
    reach: f64,
    /// Position across and along the face over the edges in these directions.
    steps: [f64; 2],
}

impl Root {
    fn new(place: Vector3<f64>, edges: [Vector3<f64>; 2]) -> Self {
        let borders = edges.map(|edge| [0.5, -0.5].map(|share| place + share * edge));
        let reach = 0.5 * edges[0].norm().max(edges[1].norm());
        let steps = [0, 1].map(|axis| place[axis] / edges[axis][axis]);
        Self { place, edges, borders, reach, steps }
    }

    /// The `normal` turned so that the distance from the object grows by `rises` (m) along the
    /// edges of the cell.
    fn risen(&self, normal: &Vector3<f64>, rises: [f64; 2]) -> Vector3<f64> {
        let along = |axis: usize| {
            let edge = &self.edges[axis];
            (rises[axis] - normal.z * edge.z) / edge[axis]
        };
        let (x, y) = (along(0), along(1));
        Vector3::new(x, y, -(1.0 - x * x - y * y).max(0.25).sqrt()).normalize()
    }
}

/// Face of a pad, divided into one cell per bristle.
pub(super) struct BristleFace {
    roots: Vec<Root>,
    /// Area of a cell in plan view (m²).
    area: f64,
    /// Largest reach of a root (m).
    reach: f64,
    outline: PadOutline,
}

/// The object in a pad's frame.
pub(super) struct PlacedObject<'a> {
    shape: &'a Shape,
    /// Radius of a sphere about the origin of the object's frame that contains the object (m).
    radius: f64,
    pose: Isometry3<f64>,
    /// Rotation matrix of the pose.
    turn: Matrix3<f64>,
    /// True if the surface has creases, at which its normal jumps.
    is_creased: bool,
}

/// Anchor of a bristle that sticks to the object.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct BristleAnchor {
    /// Position in the object's frame (m).
    place: Point3<f64>,
    /// Fraction of its cell that sticks.
    cover: f64,
}

/// A bristle in contact, in the pad's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct BristleContact {
    pub(super) bristle: usize,
    /// Root of the bristle on the undeformed face (m).
    root: Vector3<f64>,
    /// Outward normal of the object.
    pub(super) normal: Vector3<f64>,
    pub(super) depth: Depth,
    /// Fraction of the cell that sticks.
    cover: f64,
    /// Normal force per mean depth (N/m).
    pub(super) stiffness: f64,
    /// Sideways stiffness (N/m).
    pub(super) shear: f64,
    /// Sideways motion of the object since the bristle stuck, less its slip (m).
    pub(super) stretch: Vector3<f64>,
}

impl BristleFace {
    /// Number of bristles.
    pub(super) const COUNT: usize = COUNTS[0] * COUNTS[1];

    pub(super) fn new(outline: &PadOutline) -> Self {
        let [across, along] = COUNTS;
        let cell = [outline.width / across as f64, outline.length / along as f64];
        let at = |i: usize, count: usize, cell: f64| (i as f64 + 0.5 - 0.5 * count as f64) * cell;
        let root = |i: usize| {
            let (x, y) = (at(i % across, across, cell[0]), at(i / across, along, cell[1]));
            let height = |dx: f64, dy: f64| outline.height(x + dx * cell[0], y + dy * cell[1]);
            let rise = [height(0.5, 0.0) - height(-0.5, 0.0), height(0.0, 0.5) - height(0.0, -0.5)];
            let edges = [Vector3::new(cell[0], 0.0, rise[0]), Vector3::new(0.0, cell[1], rise[1])];
            Root::new(Vector3::new(x, y, outline.height(x, y)), edges)
        };
        let roots: Vec<_> = (0..Self::COUNT).map(root).collect();
        let reach = roots.iter().map(|root| root.reach).fold(0.0, f64::max);
        Self { roots, area: cell[0] * cell[1], reach, outline: *outline }
    }

    /// Replaces `touches` by the bristles in contact with `obstacle`, held at their `anchors`.
    pub(super) fn touches(
        &self,
        obstacle: &PlacedObject,
        law: &FoundationLaw,
        anchors: &[Option<BristleAnchor>],
        touches: &mut Vec<BristleContact>,
    ) {
        touches.clear();
        if !self.is_near(obstacle) {
            return;
        }
        self.meet(obstacle, touches);
        self.round(touches);
        let (mut squares, mut covered) = (0.0, 0.0);
        touches.retain_mut(|touch| {
            let cover = touch.depth.cover();
            if cover > 0.0 {
                squares += self.area * touch.depth.mean_square();
                covered += self.area * cover;
                touch.cover = cover;
                if let Some(anchor) = anchors[touch.bristle] {
                    touch.hold(&anchor, &obstacle.pose);
                }
            }
            cover > 0.0
        });
        let (stiffness, shear) = (law.foundation(squares), law.shear_foundation(covered));
        for touch in touches {
            touch.stiffness = self.area * stiffness;
            touch.shear = self.area * shear * touch.cover;
        }
    }

    /// Adds the bristles that meet `obstacle`, with depths at the bristles.
    fn meet(&self, obstacle: &PlacedObject, touches: &mut Vec<BristleContact>) {
        // Where the exact distance is known, it is larger than `reach` nearer to that place than
        // the rest. The factor is far above rounding.
        let is_exact = obstacle.shape.distance_error() == 0.0;
        let (mut known, mut free) = (Vector3::zeros(), 0.0);
        for (bristle, root) in self.roots.iter().enumerate() {
            let (offset, reach) = (root.place - obstacle.pose.translation.vector, root.reach);
            if offset.norm_squared() > (obstacle.radius + reach).powi(2)
                || (root.place - known).norm_squared() < free
            {
                continue;
            }
            let (value, normal) = obstacle.distance(&root.place);
            if value > reach {
                if is_exact {
                    let rest = (value - self.reach).max(0.0);
                    (known, free) = (root.place, 0.999_999 * rest * rest);
                }
                continue;
            }
            let met = self.meet_at(root, obstacle, value, &normal);
            if let Some((normal, depth)) = met {
                touches.push(BristleContact {
                    bristle,
                    root: root.place,
                    normal,
                    depth,
                    cover: 0.0,
                    stiffness: 0.0,
                    shear: 0.0,
                    stretch: Vector3::zeros(),
                });
            }
        }
    }

    /// Greatest depth of the face inside `obstacle` (m), 0 outside, by a pattern search from the
    /// deepest of `touches`.
    pub(super) fn indentation(&self, obstacle: &PlacedObject, touches: &[BristleContact]) -> f64 {
        /// Halvings of a cell, to 0.04 mm; within that distance the height of a ball of 1 mm varies
        /// by 1 µm.
        const HALVINGS: i32 = 6;
        let deepest = touches.iter().max_by(|a, b| a.depth.middle.total_cmp(&b.depth.middle));
        let Some(deepest) = deepest else { return 0.0 };
        let depth = |at: &Vector2<f64>| {
            let place = Vector3::new(at.x, at.y, self.outline.height(at.x, at.y));
            -obstacle.distance(&place).0
        };
        let half = 0.5 * Vector2::new(self.outline.width, self.outline.length);
        let mut best = deepest.root.xy();
        let mut most = depth(&best).max(deepest.depth.middle);
        for halving in 1..=HALVINGS {
            let step = self.roots[0].edges[0].norm() * 0.5f64.powi(halving);
            for direction in [Vector2::x(), -Vector2::x(), Vector2::y(), -Vector2::y()] {
                let at = (best + step * direction).inf(&half).sup(&-half);
                let there = depth(&at);
                if there > most {
                    (best, most) = (at, there);
                }
            }
        }
        most.max(0.0)
    }

    /// Returns whether any bristle could touch `obstacle`.
    fn is_near(&self, obstacle: &PlacedObject) -> bool {
        let last = self.roots[self.roots.len() - 1].place.norm() + self.outline.thickness;
        obstacle.pose.translation.vector.norm() < obstacle.radius + last
            && obstacle.distance(&Vector3::zeros()).0 < last
    }

    /// Normal of the object and depth of the cell of a bristle, if it touches, from the distance
    /// `value` (m) and its `normal` at the root.
    fn meet_at(
        &self,
        root: &Root,
        obstacle: &PlacedObject,
        value: f64,
        normal: &Vector3<f64>,
    ) -> Option<(Vector3<f64>, Depth)> {
        if normal.z < STEEPEST {
            let face = obstacle.only_face(&root.place, root.reach);
            let rises = [0, 1].map(|axis| {
                let edge = &root.edges[axis];
                if !obstacle.is_creased {
                    return normal.dot(edge);
                }
                if let Some(face) = face {
                    let [one, other] = &root.borders[axis];
                    return obstacle.beyond(face, one) - obstacle.beyond(face, other);
                }
                let ends = root.borders[axis].each_ref().map(|place| obstacle.distance(place));
                creased_rise(edge, (value, normal), ends)
            });
            // Rules out most of the cells beside the contact without the slow `hypot`.
            let squared = rises[0] * rises[0] + rises[1] * rises[1];
            if value > 0.0 && 4.0 * value * value > 1.000_001 * squared {
                return None;
            }
            let depth = Depth { middle: -value, spread: 0.5 * rises[0].hypot(rises[1]) };
            let touches = depth.middle > -depth.spread;
            return touches.then(|| (root.risen(normal, rises), depth));
        }
        let middle = if normal.z > -STEEPEST && value < 0.0 {
            self.way_out(&root.place, obstacle, -value)
        } else {
            -value
        };
        (middle > 0.0).then_some((-Vector3::z(), Depth { middle, spread: 0.0 }))
    }

    /// Distance from a place inside the object, straight into the gel, to the object's surface that
    /// faces the pad (m), at least `start`. In a thin wall the nearest surface may be the wrong
    /// one.
    fn way_out(&self, place: &Vector3<f64>, obstacle: &PlacedObject, start: f64) -> f64 {
        const SHORTEST: f64 = 2e-5;
        let mut travel = start;
        while travel < self.outline.thickness {
            let (value, _) = obstacle.distance(&(place - Vector3::z() * travel));
            if value >= 0.0 {
                return travel - value;
            }
            travel += (-value).max(SHORTEST);
        }
        self.outline.thickness
    }

    /// Converts depths at the bristles to means over their cells: lowers them by (κ₁a² + κ₂b²)/24,
    /// where κ₁ and κ₂ are the curvatures of the object away from the face along the cells' edges a
    /// and b.
    fn round(&self, touches: &mut [BristleContact]) {
        /// Largest curvature that cells resolve (1/m).
        const SHARPEST: f64 = 250.0;
        let (mut weight, mut sums) = (0.0, [[0.0; 4]; 2]);
        for touch in touches.iter() {
            let (root, w) = (&self.roots[touch.bristle], touch.depth.cover());
            weight += w;
            for (axis, [first, slope, second, mixed]) in sums.iter_mut().enumerate() {
                let (x, rise) = (root.steps[axis], touch.normal.dot(&root.edges[axis]));
                *first += w * x;
                *slope += w * rise;
                *second += w * x * x;
                *mixed += w * x * rise;
            }
        }
        let lowered = [0, 1].map(|axis| {
            let [first, slope, second, mixed] = sums[axis];
            let spread = weight * second - first * first;
            if spread <= 1e-6 * weight * weight {
                return 0.0;
            }
            // κ times the squared edge, by linear regression of the slope over the contact.
            let cell = self.roots[0].edges[axis][axis];
            let curved = (weight * mixed - first * slope) / spread;
            curved.clamp(0.0, SHARPEST * cell * cell) / 24.0
        });
        for touch in touches.iter_mut().filter(|touch| touch.depth.spread > 0.0) {
            touch.depth.middle -= lowered[0] + lowered[1];
        }
    }
}

impl<'a> PlacedObject<'a> {
    /// Creates an obstacle from `shape` at `pose`, contained in a sphere of `radius` (m) about its
    /// frame's origin.
    pub(super) fn new(shape: &'a Shape, radius: f64, pose: &Isometry3<f64>) -> Self {
        let turn = *pose.rotation.to_rotation_matrix().matrix();
        Self { shape, radius, pose: *pose, turn, is_creased: shape.is_creased() }
    }

    /// Signed distance (m) and outward normal at a `place` in the pad's frame.
    fn distance(&self, place: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let seen = self.turn.tr_mul(&(place - self.pose.translation.vector));
        let found = self.shape.distance(&Point3::from(seen));
        (found.value, self.turn * found.normal)
    }

    /// Axis across the face of a cuboid that is nearest to every point within `reach` of `place`
    /// (m), with half of the extent along it (m).
    fn only_face(&self, place: &Vector3<f64>, reach: f64) -> Option<(usize, f64)> {
        let Shape::Cuboid { half_extents } = self.shape else { return None };
        // Larger by more than rounding.
        let reach = 1.001 * reach;
        let p = self.turn.tr_mul(&(place - self.pose.translation.vector)).abs();
        let beyond = p - half_extents;
        let face = beyond.imax();
        let farthest_in = f64::min(-reach, beyond[face] - 2.0 * reach);
        let is_only =
            p[face] > reach && (0..3).all(|axis| axis == face || beyond[axis] < farthest_in);
        is_only.then(|| (face, half_extents[face]))
    }

    /// Distance of a `place` from a face of [`PlacedObject::only_face`] (m).
    fn beyond(&self, (axis, half): (usize, f64), place: &Vector3<f64>) -> f64 {
        self.turn.column(axis).dot(&(place - self.pose.translation.vector)).abs() - half
    }
}

impl BristleContact {
    /// Point at which the bristle meets the object's surface (m).
    pub(super) fn place(&self) -> Vector3<f64> {
        self.root + self.depth.middle * self.normal
    }

    /// Sets the stretch from `anchor`. The part of the cell that has come into contact since is
    /// unstretched. Sticking area that has lost contact counts up to the fraction `SLACK` of the
    /// contact, so that vibration does not release the bristle.
    fn hold(&mut self, anchor: &BristleAnchor, pose: &Isometry3<f64>) {
        const SLACK: f64 = 0.1;
        let stretch = (pose * anchor.place).coords - self.root;
        let along = stretch - self.normal * self.normal.dot(&stretch);
        self.cover = anchor.cover.clamp(self.cover, (1.0 + SLACK) * self.cover);
        self.stretch = along * f64::min(1.0, anchor.cover / self.cover);
    }

    /// Anchor of the bristle at a stretch of `stretch` (m) and `pose` of the object.
    pub(super) fn anchor(&self, stretch: &Vector3<f64>, pose: &Isometry3<f64>) -> BristleAnchor {
        let place = pose.inverse_transform_point(&Point3::from(self.root + stretch));
        BristleAnchor { place, cover: self.cover }
    }

    /// Force on the object (N) in the pad's frame if it were at rest here, with a factor `gain` on
    /// its normal part, and the stretch that remains after slip (m).
    pub(super) fn at_rest(&self, gain: f64, friction: f64) -> (Vector3<f64>, Vector3<f64>) {
        let normal = gain * self.stiffness * self.depth.mean();
        let sideways = cut(&(-self.shear * self.stretch), friction * normal);
        (sideways - normal * self.normal, -sideways / self.shear)
    }
}

/// Growth of the distance from a creased object along the `edge` of a cell (m), from the distances
/// and normals in its middle and at the ends.
///
/// Where a crease crosses the cell, the normal is the mean of those beside it. That of the middle
/// alone would turn at once, and the object would jump. Where the middle lies under an edge, beyond
/// which no face is, its normal is that of no face: the face at the other end counts, and fades out
/// to where the bristle is beside the edge. A bristle that came and went there with a force would
/// make a held object tremble.
fn creased_rise(
    edge: &Vector3<f64>,
    middle: (f64, &Vector3<f64>),
    ends: [(f64, Vector3<f64>); 2],
) -> f64 {
    let ((value, normal), [(one, its_normal), (other, other_normal)]) = (middle, ends);
    let facing = if its_normal.z < other_normal.z { its_normal } else { other_normal };
    if its_normal.z.max(other_normal.z) < STEEPEST {
        one - other
    } else if value > 0.0 && facing.z < STEEPEST {
        let share = (STEEPEST - normal.z) / (STEEPEST - FLATTER);
        share.min(1.0) * facing.dot(edge)
    } else {
        normal.dot(edge)
    }
}

/// Returns `force`, shortened to `limit` if it is longer.
pub(super) fn cut(force: &Vector3<f64>, limit: f64) -> Vector3<f64> {
    let size = force.norm();
    if size > limit { force * (limit / size) } else { *force }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Translation3, UnitQuaternion};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::{scene::SoftPads, sensor::Sensor};

    /// Normal and depth of a bristle from all the distances that these are defined by.
    fn met(face: &BristleFace, root: &Root, at: &PlacedObject) -> Option<(Vector3<f64>, Depth)> {
        let (value, normal) = at.distance(&root.place);
        let reach = 0.5 * root.edges[0].norm().max(root.edges[1].norm());
        if value > reach {
            return None;
        }
        if normal.z < -0.5 {
            let rises = root.edges.each_ref().map(|edge| {
                let ends = [0.5, -0.5].map(|share| at.distance(&(root.place + share * edge)));
                if at.is_creased {
                    creased_rise(edge, (value, &normal), ends)
                } else {
                    normal.dot(edge)
                }
            });
            let depth = Depth { middle: -value, spread: 0.5 * rises[0].hypot(rises[1]) };
            return (-value > -depth.spread).then(|| (root.risen(&normal, rises), depth));
        }
        let is_wrong = normal.z > 0.5 && value < 0.0;
        let way = is_wrong.then(|| face.way_out(&root.place, at, -value));
        let middle = way.unwrap_or(-value);
        (middle > 0.0).then_some((-Vector3::z(), Depth { middle, spread: 0.0 }))
    }

    #[test]
    fn distances_that_are_not_asked_for_would_change_nothing() {
        let outline = Sensor::named("gelsight-mini").unwrap().outline;
        let face = BristleFace::new(&outline);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut shapes = Shape::kinds();
        shapes.push(Shape::Cuboid { half_extents: Vector3::new(0.02, 0.015, 0.001) });
        shapes.extend(Shape::kinds().iter().filter_map(|shape| shape.rounded(0.001).ok()));
        for shape in shapes.iter().map(Shape::sampled) {
            let surface = shape.surface(32).unwrap();
            let lengths = surface.vertices().iter().map(|vertex| vertex.coords.norm());
            let radius = 1.01 * lengths.fold(0.0, f64::max);
            let mut count = 0;
            for trial in 0..60 {
                let mut draw = || rng.random_range(-1.0..1.0);
                // A face, or a side, is nearly parallel to the pad in half of the trials.
                let size = if trial % 2 == 0 { 3.0 } else { 0.02 };
                let turn = UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| size * draw()));
                let quarter = UnitQuaternion::from_axis_angle(
                    &[Vector3::x_axis(), Vector3::y_axis()][trial / 2 % 2],
                    std::f64::consts::FRAC_PI_2 * (trial / 4 % 4) as f64,
                );
                let mut place = Translation3::new(0.01 * draw(), 0.01 * draw(), 0.1);
                let depth = 1e-3 * (1.0 + draw());
                let at = |place| {
                    PlacedObject::new(&shape, radius, &Isometry3::from_parts(place, turn * quarter))
                };
                for _ in 0..100 {
                    place.z -= at(place).distance(&Vector3::zeros()).0.max(0.0);
                }
                place.z -= depth;
                let (obstacle, mut touches) = (at(place), Vec::new());
                face.meet(&obstacle, &mut touches);
                count += touches.len();
                let bits = |bristle: usize, normal: &Vector3<f64>, depth: &Depth| {
                    let numbers = [normal.x, normal.y, normal.z, depth.middle, depth.spread];
                    (bristle, numbers.map(f64::to_bits))
                };
                let found = touches.iter().map(|t| bits(t.bristle, &t.normal, &t.depth));
                let slow = face.roots.iter().enumerate().filter_map(|(bristle, root)| {
                    met(&face, root, &obstacle)
                        .map(|(normal, depth)| bits(bristle, &normal, &depth))
                });
                assert!(found.eq(slow), "{shape:?} at {}", obstacle.pose);
            }
            assert!(count > 200, "{shape:?} met {count} bristles");
        }
    }

    /// A block that slides and tilts over a domed face, in steps of at most a micrometre.
    #[test]
    fn a_bristle_that_comes_under_an_edge_adds_its_force_little_by_little() {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        let law = FoundationLaw::new(&SoftPads::new(&sensor, &sensor.calibrations[0]));
        let face = BristleFace::new(&sensor.outline);
        let shape = Shape::Cuboid { half_extents: Vector3::new(0.006, 0.006, 0.02) };
        let anchors = vec![None; BristleFace::COUNT];
        let force = |step: i32| {
            let share = f64::from(step) * 1e-4;
            let turn = UnitQuaternion::from_euler_angles(0.03 * share, 0.05 - 0.1 * share, 0.1);
            let pose = Isometry3::from_parts(
                Translation3::new(0.003 * share, 0.004 - 0.002 * share, 0.02 - 2e-4),
                turn,
            );
            let obstacle = PlacedObject::new(&shape, 0.03, &pose);
            let mut touches = Vec::new();
            face.touches(&obstacle, &law, &anchors, &mut touches);
            let force = |touch: &BristleContact| touch.at_rest(1.0, 0.5).0;
            touches.iter().map(force).sum::<Vector3<f64>>()
        };
        let forces: Vec<_> = (0..=10_000).map(force).collect();
        let jumps = forces.windows(2).map(|pair| (pair[1] - pair[0]).norm());
        let most = jumps.fold(0.0, f64::max);
        assert!(forces[0].norm() > 1.0 && most < 0.07, "{most} N of {} N", forces[0].norm());
    }
}
