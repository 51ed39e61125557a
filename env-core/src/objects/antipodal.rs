//! Antipodal grasps: two contacts whose connecting line lies in both friction cones.
//!
//! Two opposite contacts with friction resist any force, and soft fingers any torque as well, if
//! and only if the line between them lies strictly inside both cones (Nguyen, "Constructing
//! force-closure grasps", 1988). The first contact is drawn uniformly from the surface, the second
//! lies on the ray along the inward normal there, and the approach direction is random. The same
//! seed gives the same grasps on one platform; on another, the last bits of sines may differ.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, Vector3};

use super::{clearance::Hand, draw::Draw};
use crate::{
    Error, Result,
    geometry::{Shape, Surface},
};

/// Grasp between two opposite contacts, in the object's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Antipodal {
    /// Pose of the tool frame: the origin midway between the contacts, x from the first to the
    /// second, z to the wrist.
    pub tool: Isometry3<f64>,
    /// Distance between the contacts (m).
    pub width: f64,
    /// Angle between x and the outward normal at the second contact (rad); at the first, x is the
    /// inward normal.
    pub angle: f64,
    /// Force-closure margin 1 − tan(angle)/μ: 1 on the axis of the cone, 0 on its surface.
    pub quality: f64,
    /// Distance of the line between the contacts from the centre of mass (m): the lever arm of the
    /// weight.
    pub lever: f64,
}

impl Antipodal {
    /// Poses of the pads' frames in the object's frame, that of the first contact first, with the
    /// apexes `apart` (m).
    pub fn pads(&self, apart: f64) -> [Isometry3<f64>; 2] {
        Hand::pads(&self.tool, apart)
    }
}

/// Reasons to reject a drawn grasp, in the order of the checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Rejection {
    /// The grasp, with the clearance of both pads, is wider than the gripper opens.
    TooWide,
    /// The line between the contacts lies outside the second friction cone.
    OutsideCone,
    /// Part of the object reaches above the palm.
    Palm,
    /// The hand reaches below the table.
    Table,
    /// The object reaches too deep into the gel beside the contacts.
    Face,
    /// A finger collides with the object on its path.
    Finger,
}

/// Result of a sampling.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampling {
    /// Accepted grasps, in the order they were drawn.
    pub grasps: Vec<Antipodal>,
    /// Number of rejected grasps by reason.
    pub rejected: BTreeMap<Rejection, usize>,
}

/// Sampler of antipodal grasps.
#[derive(Clone, Debug, PartialEq)]
pub struct GraspSampler {
    /// The gripper.
    pub hand: Hand,
    /// Coulomb coefficient μ between pads and object.
    pub friction: f64,
    /// Free travel of each pad before it touches (m).
    pub clearance: f64,
    /// Greatest depth of the object in the gel beside the contacts when the apexes touch (m).
    pub intrusion: f64,
    /// Height of a table's top along z of the object's frame (m), if it lies on one.
    pub table: Option<f64>,
}

impl Default for GraspSampler {
    /// Half of the `GelSight` Mini's friction at rest, as a margin; 5 mm of clearance on each side;
    /// an intrusion of half the gel's thickness; no table.
    fn default() -> Self {
        let hand = Hand::default();
        let intrusion = 0.5 * hand.pad.thickness;
        Self { hand, friction: 0.5, clearance: 0.005, intrusion, table: None }
    }
}

/// Number of draws for each grasp asked for.
const ATTEMPTS: usize = 200;
/// Edges round a circle of the triangulated surface from which points are drawn.
const SEGMENTS: u32 = 64;
/// Depth under the surface at which a ray through the solid starts (m): more than facets deviate
/// from the surface, less than the thickness of any wall.
const DEPTH: f64 = 5e-4;

impl GraspSampler {
    /// Draws up to `count` grasps of `shape`; fewer if 200 draws for each do not yield them.
    /// Returns an error if the shape has no finite surface or a setting is invalid.
    pub fn sample(&self, shape: &Shape, count: usize, seed: u64) -> Result<Sampling> {
        self.check()?;
        let target = Goal::new(shape)?;
        let mut draw = Draw::new(seed, 0, 1);
        let mut sampling = Sampling { grasps: Vec::new(), rejected: BTreeMap::new() };
        for _ in 0..ATTEMPTS * count {
            if sampling.grasps.len() == count {
                break;
            }
            match self.attempt(&target, &mut draw) {
                Ok(grasp) => sampling.grasps.push(grasp),
                Err(rejection) => *sampling.rejected.entry(rejection).or_default() += 1,
            }
        }
        Ok(sampling)
    }

    fn check(&self) -> Result<()> {
        let settings = [
            ("friction", self.friction, 10.0),
            ("clearance", self.clearance, 0.5 * self.hand.opening),
            ("intrusion", self.intrusion, self.hand.pad.thickness),
        ];
        for (name, value, most) in settings {
            if !(value > 0.0 && value <= most) {
                return Err(Error::invalid(name, value, format!("above 0, at most {most}")));
            }
        }
        Ok(())
    }

    fn attempt(&self, target: &Goal, draw: &mut Draw) -> std::result::Result<Antipodal, Rejection> {
        let (first, normal) = target.point(draw);
        let axis = -normal;
        let width = target.through(&first, &axis, draw);
        if width + 2.0 * self.clearance > self.hand.opening {
            return Err(Rejection::TooWide);
        }
        let second = first + width * axis;
        let angle = target.shape.distance(&second).normal.angle(&axis);
        let quality = 1.0 - angle.tan() / self.friction;
        if angle >= std::f64::consts::FRAC_PI_2 || quality <= 0.0 {
            return Err(Rejection::OutsideCone);
        }
        let tool = tool(&nalgebra::center(&first, &second), &axis, &draw.direction());
        self.reachable(target, &tool, width)?;
        let lever = axis.cross(&(target.center - first)).norm();
        Ok(Antipodal { tool, width, angle, quality, lever })
    }

    /// Returns as an error the first reason why the hand cannot reach `tool`, if there is one.
    fn reachable(
        &self,
        target: &Goal,
        tool: &Isometry3<f64>,
        width: f64,
    ) -> std::result::Result<(), Rejection> {
        let (hand, clearance) = (&self.hand, self.clearance);
        let top = target.top(tool);
        if top > hand.palm {
            return Err(Rejection::Palm);
        }
        let lowest = hand.lowest(tool, width + 2.0 * clearance);
        if self.table.is_some_and(|table| lowest < table) {
            return Err(Rejection::Table);
        }
        if hand.intrusion(target.shape, tool, width, clearance) > self.intrusion {
            return Err(Rejection::Face);
        }
        if !hand.fingers_are_free(target.shape, tool, [width, clearance, top]) {
            return Err(Rejection::Finger);
        }
        Ok(())
    }
}

/// Solid prepared for drawing points of its surface.
struct Goal<'a> {
    shape: &'a Shape,
    surface: Surface,
    center: Point3<f64>,
    /// Total area of the triangles up to each (m²).
    areas: Vec<f64>,
}

impl<'a> Goal<'a> {
    fn new(shape: &'a Shape) -> Result<Self> {
        let surface = shape.surface(SEGMENTS).ok_or_else(|| {
            Error::invalid("shape", "a half-space", "a solid of finite size to hold")
        })?;
        let mut sum = 0.0;
        let running = surface.triangles().iter().map(|t| {
            let [a, b, c] = t.map(|i| surface.vertices()[i as usize]);
            sum += 0.5 * (b - a).cross(&(c - a)).norm();
            sum
        });
        let areas = running.collect();
        let center = surface.mass_properties(1.0).center;
        Ok(Self { shape, surface, center, areas })
    }

    /// Draws a point of the exact surface and returns it with the outward normal there.
    fn point(&self, draw: &mut Draw) -> (Point3<f64>, Vector3<f64>) {
        let area = draw.uniform(0.0, self.areas[self.areas.len() - 1]);
        let triangle = self.areas.partition_point(|&sum| sum <= area);
        let [a, b, c] =
            self.surface.triangles()[triangle].map(|i| self.surface.vertices()[i as usize]);
        // The square root makes the distribution uniform over the triangle.
        let (root, share) = (draw.uniform(0.0, 1.0).sqrt(), draw.uniform(0.0, 1.0));
        let drawn = a + root * ((b - a) + share * (c - b));
        let distance = self.shape.distance(&drawn);
        (drawn - distance.value * distance.normal, distance.normal)
    }

    /// Length through the solid (m) from its surface point `from` along `axis`, chosen at random:
    /// to where the ray first leaves the solid or to where it last does. The two differ for a cup.
    fn through(&self, from: &Point3<f64>, axis: &Vector3<f64>, draw: &mut Draw) -> f64 {
        let far = 3.0 * self.surface.size();
        let last = self.shape.ray_gap(&(from + far * axis), &-axis).map_or(0.0, |gap| far - gap);
        if draw.coin() {
            return last;
        }
        let back = self.shape.ray_gap(&(from + DEPTH * axis), &-axis);
        back.filter(|&gap| gap < 0.0).map_or(last, |gap| DEPTH - gap)
    }

    /// Largest z of the solid in the tool frame (m).
    fn top(&self, tool: &Isometry3<f64>) -> f64 {
        let up = tool * Vector3::z();
        let heights = self.surface.vertices().iter().map(|v| up.dot(&v.coords));
        heights.fold(f64::NEG_INFINITY, f64::max) - up.dot(&tool.translation.vector)
    }
}

/// Tool frame at `middle` with x along `axis` and z as close to `towards` as possible.
fn tool(middle: &Point3<f64>, axis: &Vector3<f64>, towards: &Unit<Vector3<f64>>) -> Isometry3<f64> {
    let y = towards.cross(axis).try_normalize(1e-9).unwrap_or_else(|| {
        let aside = Vector3::ith(axis.iamin(), 1.0);
        aside.cross(axis).normalize()
    });
    let axes = Matrix3::from_columns(&[*axis, y, axis.cross(&y)]);
    let turn = Rotation3::from_matrix_unchecked(axes);
    Isometry3::from_parts(Translation3::from(middle.coords), turn.into())
}
