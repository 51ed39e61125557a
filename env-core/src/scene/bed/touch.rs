//! Where the face of a pad stands in the object.

use nalgebra::{Isometry3, Matrix3, Point3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::law::{Depth, Law};
use crate::geometry::{PadOutline, Shape};

/// Bristles across and along a pad.
const COUNTS: [usize; 2] = [8, 10];

/// A bristle's place on the undeformed face, in the pad's frame.
struct Root {
    place: Vector3<f64>,
    /// The face's own directions, one cell long (m).
    edges: [Vector3<f64>; 2],
}

/// The face of a pad as bristles.
pub(super) struct Face {
    roots: Vec<Root>,
    /// Area of the plan that a bristle stands for (m²).
    area: f64,
    outline: PadOutline,
}

/// The object as a pad's frame sees it.
pub(super) struct Obstacle<'a> {
    shape: &'a Shape,
    /// Radius about its frame's origin that holds all of it (m).
    radius: f64,
    pose: Isometry3<f64>,
    /// The rotation of the pose.
    turn: Matrix3<f64>,
}

/// A bristle that sticks to the object.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Anchor {
    /// Where, in the object's frame (m).
    place: Point3<f64>,
    /// Share of its cell that sticks.
    cover: f64,
}

/// A bristle that touches, in the pad's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Touch {
    pub(super) bristle: usize,
    /// Root of the bristle on the undeformed face (m).
    root: Vector3<f64>,
    /// Where the object's surface meets it (m).
    pub(super) place: Vector3<f64>,
    /// Outward normal of the object.
    pub(super) normal: Vector3<f64>,
    pub(super) depth: Depth,
    /// Share of the cell that sticks.
    cover: f64,
    /// Force over mean depth (N/m).
    pub(super) stiffness: f64,
    /// Sideways stiffness (N/m).
    pub(super) shear: f64,
    /// Sideways motion of the object since the bristle stuck, as far as it did not slip (m).
    pub(super) stretch: Vector3<f64>,
}

impl Face {
    pub(super) fn new(outline: &PadOutline) -> Self {
        let [across, along] = COUNTS;
        let cell = [outline.width / across as f64, outline.length / along as f64];
        let at = |i: usize, count: usize, cell: f64| (i as f64 + 0.5 - 0.5 * count as f64) * cell;
        let root = |i: usize| {
            let (x, y) = (at(i % across, across, cell[0]), at(i / across, along, cell[1]));
            let height = |dx: f64, dy: f64| outline.height(x + dx * cell[0], y + dy * cell[1]);
            let rise = [height(0.5, 0.0) - height(-0.5, 0.0), height(0.0, 0.5) - height(0.0, -0.5)];
            Root {
                place: Vector3::new(x, y, outline.height(x, y)),
                edges: [Vector3::new(cell[0], 0.0, rise[0]), Vector3::new(0.0, cell[1], rise[1])],
            }
        };
        Self {
            roots: (0..across * along).map(root).collect(),
            area: cell[0] * cell[1],
            outline: *outline,
        }
    }

    pub(super) fn count(&self) -> usize {
        self.roots.len()
    }

    /// The bristles that touch `obstacle`, stuck where `anchors` say.
    pub(super) fn touches(
        &self,
        obstacle: &Obstacle,
        law: &Law,
        anchors: &[Option<Anchor>],
        touches: &mut Vec<Touch>,
    ) {
        touches.clear();
        if !self.is_near(obstacle) {
            return;
        }
        for (bristle, root) in self.roots.iter().enumerate() {
            touches.extend(self.meet(root, obstacle).map(|(normal, depth)| Touch {
                bristle,
                root: root.place,
                place: root.place,
                normal,
                depth,
                cover: 0.0,
                stiffness: 0.0,
                shear: 0.0,
                stretch: Vector3::zeros(),
            }));
        }
        self.round(touches);
        touches.retain(|touch| touch.depth.cover() > 0.0);
        for touch in touches.iter_mut() {
            touch.cover = touch.depth.cover();
            touch.place = touch.root + touch.depth.middle * touch.normal;
            if let Some(anchor) = anchors[touch.bristle] {
                touch.hold(&anchor, &obstacle.pose);
            }
        }
        self.stiffen(touches, law);
    }

    /// Greatest depth at which the face stands in `obstacle` (m), 0 outside: climbed to from the deepest
    /// of `touches`.
    pub(super) fn indentation(&self, obstacle: &Obstacle, touches: &[Touch]) -> f64 {
        /// Halvings of a cell: to 0.04 mm, on which a ball of 1 mm rises by 1 µm.
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
            for way in [Vector2::x(), -Vector2::x(), Vector2::y(), -Vector2::y()] {
                let at = (best + step * way).inf(&half).sup(&-half);
                let there = depth(&at);
                if there > most {
                    (best, most) = (at, there);
                }
            }
        }
        most.max(0.0)
    }

    /// Whether any bristle could touch.
    fn is_near(&self, obstacle: &Obstacle) -> bool {
        let last = self.roots[self.roots.len() - 1].place.norm() + self.outline.thickness;
        obstacle.pose.translation.vector.norm() < obstacle.radius + last
            && obstacle.distance(&Vector3::zeros()).0 < last
    }

    /// Normal of the object and depth of the cell round a bristle, if it touches.
    fn meet(&self, root: &Root, obstacle: &Obstacle) -> Option<(Vector3<f64>, Depth)> {
        /// Steepest slope that counts as a face turned to the pad: past it the bristle stands beside
        /// an edge and is pushed back along itself.
        const STEEPEST: f64 = -0.5;
        let reach = 0.5 * root.edges[0].norm().max(root.edges[1].norm());
        let offset = root.place - obstacle.pose.translation.vector;
        if offset.norm_squared() > (obstacle.radius + reach).powi(2) {
            return None;
        }
        let (value, normal) = obstacle.distance(&root.place);
        if value > reach {
            return None;
        }
        if normal.z < STEEPEST {
            let spread = root.edges.map(|edge| normal.dot(&edge).powi(2)).iter().sum::<f64>();
            let depth = Depth { middle: -value, spread: 0.5 * spread.sqrt() };
            return (depth.middle > -depth.spread).then_some((normal, depth));
        }
        let middle = if normal.z > -STEEPEST && value < 0.0 {
            self.way_out(&root.place, obstacle, -value)
        } else {
            -value
        };
        (middle > 0.0).then_some((-Vector3::z(), Depth { middle, spread: 0.0 }))
    }

    /// Way down into the gel from a place inside the object to its surface that faces the pad (m), at
    /// least `start`: through a thin wall the nearest surface is the wrong one.
    fn way_out(&self, place: &Vector3<f64>, obstacle: &Obstacle, start: f64) -> f64 {
        const SHORTEST: f64 = 2e-5;
        let mut way = start;
        while way < self.outline.thickness {
            let (value, _) = obstacle.distance(&(place - Vector3::z() * way));
            if value >= 0.0 {
                return way - value;
            }
            way += (-value).max(SHORTEST);
        }
        self.outline.thickness
    }

    /// Lowers the depths from those of the bristles to the means of their cells: by (κ₁a² + κ₂b²)/24 where
    /// the object curves away from the face by κ along the cells' edges a and b.
    fn round(&self, touches: &mut [Touch]) {
        /// Sharpest curvature that a cell can feel (1/m).
        const SHARPEST: f64 = 250.0;
        let lowered = [0, 1].map(|axis| {
            let (mut weight, mut first, mut slope) = (0.0, 0.0, 0.0);
            let (mut second, mut mixed) = (0.0, 0.0);
            for touch in touches.iter() {
                let edge = &self.roots[touch.bristle].edges[axis];
                let (x, rise) = (touch.root[axis] / edge[axis], touch.normal.dot(edge));
                let w = touch.depth.cover();
                weight += w;
                first += w * x;
                slope += w * rise;
                second += w * x * x;
                mixed += w * x * rise;
            }
            let spread = weight * second - first * first;
            if spread <= 1e-6 * weight * weight {
                return 0.0;
            }
            // κ times the edge squared, by regression of the slope over the touch.
            let cell = self.roots[0].edges[axis][axis];
            let curved = (weight * mixed - first * slope) / spread;
            curved.clamp(0.0, SHARPEST * cell * cell) / 24.0
        });
        for touch in touches.iter_mut().filter(|touch| touch.depth.spread > 0.0) {
            touch.depth.middle -= lowered[0] + lowered[1];
        }
    }

    /// Gives every touch its share of the bed's stiffness.
    fn stiffen(&self, touches: &mut [Touch], law: &Law) {
        let (squares, covered) = touches.iter().fold((0.0, 0.0), |(squares, covered), touch| {
            let depth = &touch.depth;
            (squares + self.area * depth.mean_square(), covered + self.area * depth.cover())
        });
        let (stiffness, shear) = (law.foundation(squares), law.shear_foundation(covered));
        for touch in touches {
            touch.stiffness = self.area * stiffness;
            touch.shear = self.area * shear * touch.cover;
        }
    }
}

impl<'a> Obstacle<'a> {
    /// A `shape` at `pose`, within a `radius` (m) about its frame's origin.
    pub(super) fn new(shape: &'a Shape, radius: f64, pose: &Isometry3<f64>) -> Self {
        let turn = *pose.rotation.to_rotation_matrix().matrix();
        Self { shape, radius, pose: *pose, turn }
    }

    /// Signed distance (m) and outward normal at a place of the pad's frame.
    fn distance(&self, place: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let seen = self.turn.tr_mul(&(place - self.pose.translation.vector));
        let found = self.shape.distance(&Point3::from(seen));
        (found.value, self.turn * found.normal)
    }
}

impl Touch {
    /// Stretches the bristle to where it stuck. What touched since bears no force yet. A share that
    /// has come off by less than `SLACK` still counts, so that a tremor does not wear the bristle out.
    fn hold(&mut self, anchor: &Anchor, pose: &Isometry3<f64>) {
        const SLACK: f64 = 0.1;
        let way = (pose * anchor.place).coords - self.root;
        let along = way - self.normal * self.normal.dot(&way);
        self.cover = anchor.cover.clamp(self.cover, (1.0 + SLACK) * self.cover);
        self.stretch = along * f64::min(1.0, anchor.cover / self.cover);
    }

    /// Where the bristle sticks if it is stretched by `stretch` (m).
    pub(super) fn anchor(&self, stretch: &Vector3<f64>, pose: &Isometry3<f64>) -> Anchor {
        let place = pose.inverse_transform_point(&Point3::from(self.root + stretch));
        Anchor { place, cover: self.cover }
    }

    /// Force on the object (N) in the pad's frame if it stood still here, with a `gain` on its normal
    /// part; and the stretch that does not slip (m).
    pub(super) fn at_rest(&self, gain: f64, friction: f64) -> (Vector3<f64>, Vector3<f64>) {
        let normal = gain * self.stiffness * self.depth.mean();
        let sideways = cut(&(-self.shear * self.stretch), friction * normal);
        (sideways - normal * self.normal, -sideways / self.shear)
    }
}

/// `force`, shortened to `limit` if it is longer.
pub(super) fn cut(force: &Vector3<f64>, limit: f64) -> Vector3<f64> {
    let size = force.norm();
    if size > limit { force * (limit / size) } else { *force }
}
