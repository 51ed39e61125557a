//! InsertPeg: insert a held peg into a hole whose place is known roughly.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    Ending, EpisodeParameters, GradualGrip, Progress, Range, RewardTerm, Rules, Setting, Start,
    StateChannel, StepState, Task, TaskConfig, reward, setting::rising,
};
use crate::{
    Error, Result,
    geometry::Shape,
    scene::{Fixture, Workspace},
};

/// Height of the fixture, and depth of its hole (m).
const HEIGHT: f64 = 0.02;
/// Thickness of the fixture beside the hole (m).
const MARGIN: f64 = 0.025;
/// Height of the tip over the block at which `reach` is 0 (m).
const FAR: f64 = 0.01;
/// Distance of the tip from the hole's axis at which `align` is 1/e (m).
const BESIDE: f64 = 2e-3;
/// Depth from which a peg counts as inside the hole (m): more than one that is tilted on the rim
/// reaches.
const INSIDE: f64 = 1e-3;
/// Height of the tool centre over the fixture (m) that leaves 1 mm between it and the pads.
const LOWEST: f64 = 0.0137;
/// Named objects that are pegs.
const PEGS: [&str; 3] = ["square-peg", "round-peg", "hexagonal-peg"];

/// Settings of the task.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InsertPeg {
    grip: GradualGrip,
    /// Width of the hole less that of the peg (m).
    clearance: Range,
    /// Error of the hole's known position, in x and in y (m).
    hole_error: Range,
    /// Error of its known yaw (rad).
    hole_yaw_error: Range,
    /// Displacement of the peg in the hand, across and along the fingers (m).
    peg_offset: Range,
    /// Rotation of the peg about the line between the pads (rad).
    peg_tilt: Range,
    /// Depth that counts as inserted (m).
    insert_depth: f64,
    /// Largest force between peg and fixture (N).
    force_limit: f64,
}

impl Default for InsertPeg {
    fn default() -> Self {
        Self {
            grip: GradualGrip { start: 10.0, least: 2.0, rate: 5.0 },
            clearance: [0.5e-3, 2e-3],
            hole_error: [-3e-3, 3e-3],
            hole_yaw_error: [-5.0 * PI / 180.0, 5.0 * PI / 180.0],
            peg_offset: [-2e-3, 2e-3],
            peg_tilt: [-2.0 * PI / 180.0, 2.0 * PI / 180.0],
            insert_depth: 0.01,
            force_limit: 25.0,
        }
    }
}

impl Rules for InsertPeg {
    fn name(&self) -> &'static str {
        "InsertPeg"
    }

    fn doc(&self) -> &'static str {
        DOC
    }

    fn terms(&self) -> &'static [RewardTerm] {
        const TERMS: [RewardTerm; 4] = [
            RewardTerm::new(
                "reach",
                0.1,
                reach,
                "the peg's tip is on the block or deeper; 0 at 1 cm over it, linear between",
            ),
            RewardTerm::new(
                "align",
                0.3,
                align,
                "the middle of the tip is on the hole's axis; falls to 1/e at 2 mm from it",
            ),
            RewardTerm::new("insert", 0.5, insert, "it is in by ``insert_depth``"),
            RewardTerm::new(
                "gentle",
                0.1,
                gentle,
                "it is in without force of the fixture; 0 at ``force_limit``, linear between",
            ),
        ];
        &TERMS
    }

    fn channels(&self) -> &'static [StateChannel] {
        &[StateChannel::Insertion]
    }

    fn usual_channels(&self, _: bool) -> &'static [&'static str] {
        &["proprio", "wrench"]
    }

    fn settings(&mut self) -> Vec<Setting<'_>> {
        let Self { grip, clearance, hole_error, hole_yaw_error, .. } = self;
        let mut settings = Vec::from(grip.settings());
        settings.extend([
            Setting::range(
                "clearance",
                clearance,
                [1e-4, 0.01],
                "m",
                "width of the hole less that of the peg",
            ),
            Setting::range(
                "hole_error",
                hole_error,
                [-0.01, 0.01],
                "m",
                "place of the hole from where it is said to be, x and y, each",
            ),
            Setting::range(
                "hole_yaw_error",
                hole_yaw_error,
                [-0.5, 0.5],
                "rad",
                "yaw of the hole from what it is said to be",
            ),
            Setting::range(
                "peg_offset",
                &mut self.peg_offset,
                [-5e-3, 5e-3],
                "m",
                "displacement of the peg in the hand, across and along the fingers, each",
            ),
            Setting::range(
                "peg_tilt",
                &mut self.peg_tilt,
                [-0.2, 0.2],
                "rad",
                "rotation of the peg about the line between the pads",
            ),
            Setting::number(
                "insert_depth",
                &mut self.insert_depth,
                [2e-3, HEIGHT],
                "m",
                "depth that counts as inserted",
            ),
            Setting::number(
                "force_limit",
                &mut self.force_limit,
                [1.0, 1e3],
                "N",
                "largest force between peg and fixture",
            ),
        ]);
        settings
    }

    fn unused_settings(&self) -> &'static [&'static str] {
        &["position", "yaw", "lift_height", "hold_time"]
    }

    fn adapt(&self, config: &mut TaskConfig) {
        config.choose_objects(&PEGS);
        config.move_gently();
        let gripper = &mut config.scene.gripper;
        (gripper.max_force, gripper.max_yaw_rate) = (super::config::FIRM_GRIP, 0.5);
        // The gel holds a peg with some 10 N/mm: contact is sensed in time at 0.8 mm in a control
        // step.
        gripper.max_speed = 0.02;
        let reach = 0.012;
        let (low, high) = ([-reach, -reach, HEIGHT + LOWEST], [reach, reach, 0.08]);
        config.scene.workspace = Workspace { low, high };
        // The tip starts 3.5 to 8.5 mm over the block.
        config.start_height = [0.0555, 0.0565];
        config.max_episode_steps = 150;
        (config.mass, config.size) = ([0.02, 0.06], [1.0, 1.0]);
    }

    fn validate(&self, config: &TaskConfig) -> Result<()> {
        // The hand is over the block when the peg is in, and the tip when the episode starts.
        let offset = self.peg_offset;
        let least = LOWEST + self.insert_depth - offset[0];
        let most = config.start_height[0] - HEIGHT + offset[0];
        for spec in &config.objects {
            let shape = spec.shape()?;
            Fixture::around(&shape, self.clearance[0], HEIGHT, MARGIN).map_err(|_| {
                let named = PEGS.join(", ");
                let expected = format!("one of {named}, or a cuboid, cylinder or prism as peg");
                Error::invalid("objects", spec, expected)
            })?;
            for size in config.size {
                let half = half_height(&shape.scaled(size));
                if !(least..=most).contains(&half) {
                    let found = format!("{spec}, {:.4} m long", 2.0 * half);
                    let expected = format!("a peg of {:.4} to {:.4} m", 2.0 * least, 2.0 * most);
                    return Err(Error::invalid("objects", found, expected));
                }
            }
        }
        // Where friction vanishes, the hand cannot press.
        rising("friction", config.friction, [0.01, 10.0])
    }

    fn start(&self) -> Start {
        Start::InHand
    }

    fn gradual_grip(&self) -> Option<&GradualGrip> {
        Some(&self.grip)
    }

    fn draw(
        &self,
        _: &TaskConfig,
        episode: &mut EpisodeParameters,
        uniform: &mut dyn FnMut(Range) -> f64,
    ) {
        episode.insertion = Some(Insertion {
            clearance: uniform(self.clearance),
            hole: [uniform(self.hole_error), uniform(self.hole_error)],
            hole_yaw: uniform(self.hole_yaw_error),
            offset: [uniform(self.peg_offset), uniform(self.peg_offset)],
            tilt: uniform(self.peg_tilt),
        });
    }

    fn fixture(&self, object: &Shape, episode: &EpisodeParameters) -> Result<Option<Fixture>> {
        let Some(insertion) = &episode.insertion else { return Ok(None) };
        let mut fixture = Fixture::around(object, insertion.clearance, HEIGHT, MARGIN)?;
        (fixture.place, fixture.yaw) = (insertion.hole, insertion.hole_yaw);
        Ok(Some(fixture))
    }

    fn pose_in_hand(&self, episode: &EpisodeParameters) -> Option<Isometry3<f64>> {
        episode.insertion.map(|insertion| {
            let [across, along] = insertion.offset;
            let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), insertion.tilt);
            Isometry3::from_parts(Translation3::new(0.0, across, along), turn)
        })
    }

    fn ending(&self, step: &StepState, progress: &Progress) -> Option<Ending> {
        if progress.is_out_of_hand(step) {
            return Some(Ending::Dropped);
        }
        if step.state.fixture.force.norm() <= self.force_limit {
            return None;
        }
        let depth = step.episode.insertion.map_or(0.0, |insertion| insertion.depth(step));
        Some(if depth < INSIDE {
            Ending::Overloaded
        } else if depth < wedging_depth(step.episode) {
            Ending::Wedged
        } else {
            Ending::Jammed
        })
    }

    /// The peg is in, and held.
    fn is_success(&self, step: &StepState, _: &Progress, _: &TaskConfig) -> bool {
        let depth = step.episode.insertion.map_or(0.0, |insertion| insertion.depth(step));
        step.both_touch() && depth >= self.insert_depth
    }
}

/// Hole of an episode, and place of the peg in the hand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Insertion {
    /// Width of the hole less that of the peg (m).
    pub clearance: f64,
    /// Position of the hole's axis (m).
    pub hole: [f64; 2],
    /// Yaw of the hole (rad).
    pub hole_yaw: f64,
    /// Displacement of the peg in the hand, across and along the fingers (m).
    pub offset: [f64; 2],
    /// Rotation of the peg about the line between the pads (rad).
    pub tilt: f64,
}

impl Insertion {
    /// Pose of the hole's mouth (m): z along the axis, upwards.
    pub fn mouth(&self) -> Isometry3<f64> {
        let place = Vector3::new(self.hole[0], self.hole[1], HEIGHT);
        Isometry3::new(place, Vector3::z() * self.hole_yaw)
    }

    /// Middle of the peg's tip in the frame of the hole's mouth (m).
    pub fn tip(&self, step: &StepState) -> Vector3<f64> {
        let tip = Point3::new(0.0, 0.0, -step.episode.half_extents[2]);
        self.mouth().inverse_transform_point(&(step.state.object.pose * tip)).coords
    }

    /// Depth of the tip in the hole (m); 0 beside it and over it.
    pub fn depth(&self, step: &StepState) -> f64 {
        let tip = self.tip(step);
        if tip.xy().norm() <= self.clearance + INSIDE { (-tip.z).max(0.0) } else { 0.0 }
    }

    /// Yaw of the hand from the hole's (rad), in [−π, π).
    pub fn yaw(&self, step: &StepState) -> f64 {
        (step.state.wrist.yaw - self.hole_yaw + PI).rem_euclid(TAU) - PI
    }
}

/// Half of the length of a peg (m), 0 of other shapes.
fn half_height(peg: &Shape) -> f64 {
    match peg.sharp() {
        Shape::Cuboid { half_extents } => half_extents.z,
        Shape::Cylinder { half_height, .. } | Shape::Prism { half_height, .. } => *half_height,
        _ => 0.0,
    }
}

/// Depth up to which a peg can wedge (m): its width times the coefficient of friction. Nearer the
/// mouth, the line between two opposite contacts is inside both cones of friction, so that they
/// hold the peg against any force (Whitney, "Quasi-static assembly of compliantly supported rigid
/// parts", 1982).
fn wedging_depth(episode: &EpisodeParameters) -> f64 {
    let [x, y, _] = episode.half_extents;
    2.0 * episode.friction * x.max(y)
}

/// Settings of InsertPeg, the only task that has the terms below, and the peg's tip.
fn settings(config: &TaskConfig) -> &InsertPeg {
    match &config.task {
        Task::InsertPeg(task) => task,
        other => unreachable!("a term of InsertPeg in {}", other.name()),
    }
}

/// 1 with the tip on the block or below, 0 at `FAR` over it.
fn reach(step: &StepState, _: &Progress, _: &TaskConfig) -> f64 {
    let tip = step.episode.insertion.map_or(FAR, |insertion| insertion.tip(step).z);
    reward::falling(tip.max(0.0), FAR)
}

/// 1 with the tip on the hole's axis, exponential in the distance from it.
fn align(step: &StepState, _: &Progress, _: &TaskConfig) -> f64 {
    let aside = step.episode.insertion.map(|insertion| insertion.tip(step).xy().norm());
    aside.map_or(0.0, |aside| (-aside / BESIDE).exp())
}

/// Depth of the held peg in the hole relative to the depth of success.
fn insert(step: &StepState, _: &Progress, config: &TaskConfig) -> f64 {
    let depth = step.episode.insertion.map_or(0.0, |insertion| insertion.depth(step));
    if step.both_touch() { (depth / settings(config).insert_depth).min(1.0) } else { 0.0 }
}

/// 1 without force of the fixture, 0 at its limit; multiplied by `insert`, so that staying away
/// earns nothing.
fn gentle(step: &StepState, progress: &Progress, config: &TaskConfig) -> f64 {
    let force = step.state.fixture.force.norm();
    reward::falling(force, settings(config).force_limit) * insert(step, progress, config)
}

const DOC: &str = r#"Insert a held peg into a hole whose place is known to a few millimetres.

World, channels and settings are those of :class:`GraspLiftEnv`, with these differences.
On the table stands a block, 20 mm high, with an upright hole of the peg's cross-section. The hole
is said to be in the middle, at x = y = 0, with its sides along x and y; where it is, how it is
turned, how wide it is, and how the peg lies in the hand is drawn and not observed. A square, a
round or a hexagonal peg, 12 mm wide and 60 mm long, is in the hand; contact of its tip with the
block is felt through the gel.

## Action
As of :class:`GraspLiftEnv`, but slower: 0.02 m/s and 0.5 rad/s. The fifth number changes the grip by a factor of 1.2 per step at most, between ``least_grip`` and 20 N.

## Observation
By default ``proprio`` and ``wrench``. The channel ``insertion`` has what is hidden.

{channels}

## Reward
{terms}

## Start
The hand has gripped the middle of the peg with ``start_grip``, 10 N, and holds its tip 3.5 to
8.5 mm over the block. ``peg_offset`` is drawn for each of the two directions along the pads' faces.

## End
Truncated after ``max_episode_steps`` steps, 150 by default. Also terminated, with
``info["ending"]``: ``dropped``, when no pad touches the peg or it has slipped by 2 cm; and when
the fixture presses on the peg with more than ``force_limit``: ``overloaded`` beside the hole,
``wedged`` or ``jammed`` in it. A peg can wedge, that is be held by two contacts whatever is done,
at depths below its width times the coefficient of friction. Deeper it can only jam: another force
would let it slide on. ``info["is_success"]`` is true while both pads press on the peg and its tip
is ``insert_depth`` in the hole.

## Settings
Those of :class:`GraspLiftEnv`, with these differences:

{settings}

``position``, ``yaw``, ``lift_height`` and ``hold_time`` are errors. ``objects`` are
upright cuboids, cylinders and prisms, so long that the hand is over the block when they are in."#;
