//! GraspLift: grasp an object that lies on the table, and lift it.

use serde::Serialize;

use super::{RewardTerm, Rules, Setting, StateChannel, reward};
use crate::scene::MOST_DISTRACTORS;

/// Settings of the task.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GraspLift {
    /// Number of other objects on the table.
    distractors: u32,
}

impl Rules for GraspLift {
    fn name(&self) -> &'static str {
        "GraspLift"
    }

    fn doc(&self) -> &'static str {
        DOC
    }

    fn terms(&self) -> &'static [RewardTerm] {
        const TERMS: [RewardTerm; 5] = [
            RewardTerm::new(
                "reach",
                0.1,
                reward::reach,
                "the tool centre is at the object's middle; 1/4 at 10 cm",
            ),
            RewardTerm::new("grasp", 0.1, reward::grasp, "both pads press with 1 N or more"),
            RewardTerm::new(
                "lift",
                0.5,
                reward::lift,
                "the grasped object has risen by ``lift_height``",
            ),
            RewardTerm::new("hold", 0.2, reward::hold, "it has been up for ``hold_time``"),
            RewardTerm::new(
                "effort",
                0.1,
                reward::effort,
                "it is lifted without grip force; 0 at the largest, linear between",
            ),
        ];
        &TERMS
    }

    fn channels(&self) -> &'static [StateChannel] {
        &[StateChannel::Distractors]
    }

    fn settings(&mut self) -> Vec<Setting<'_>> {
        let most = MOST_DISTRACTORS as u32;
        let doc =
            "other objects on the table, drawn from ``objects``, with the friction of the object";
        vec![Setting::count("distractors", &mut self.distractors, [0, most], "", doc)]
    }

    fn distractors(&self) -> usize {
        self.distractors as usize
    }

    fn usual_channels(&self, tactile: bool) -> &'static [&'static str] {
        if tactile { &["proprio", "object", "markers"] } else { &["proprio", "object"] }
    }
}

const DOC: &str = r#"Grasp an object of unknown shape, mass and friction with two fingers, and lift it.

A parallel-jaw gripper hangs over a table on which one object rests. The agent moves the wrist
and commands the grip force, 25 times per second.

## Action
``Box(-1, 1, (5,), float32)``: velocity of the tool centre along the wrist's x (the direction of
grip), y, z (times 0.25 m/s), yaw rate (times 2 rad/s), grip force of each finger (times 40 N;
positive closes, negative opens). The grip force follows its command at 100 N/s
(``gripper={"max_force_rate": ...}``). Components outside [-1, 1] count as the nearer bound; one
that is not finite is a ``ValueError``.

## Observation
One-level ``Dict`` of the chosen channels, or with ``obs="flat"`` their concatenation in the
chosen order. ``env.unwrapped.channels()`` lists their components, bounds and units.

{channels}

By default ``proprio``, ``object`` and ``markers``. Unless ``tactile="none"`` makes the pads
rigid, there are also the following channels, first of the pad on −x, then of the one on +x, in
the pad's frame (x across, y along the finger, z out of the gel), flat; `resolution` sets their
sizes. Without contact each is exactly 0, except ``depth`` and ``image``. With soft pads,
``wrench`` comes from the tactile model.

{tactile_channels}

## Reward
{terms}

## Start
Object, size, mass, friction, position, yaw and the tool centre are drawn from their ranges by
the environment's seed; the tool centre is 12 to 16 cm over the table (``start_height``).
With ``distractors`` other objects of ``objects`` lie 1 to 6 cm beside the one to be grasped,
which is drawn as without them. They have sizes and masses of their own and move freely. Pads
feel whatever they touch, also two objects at once: all tactile channels, ``wrench`` and the
pads' forces in ``proprio`` include distractors. ``object``, ``properties``, reward, success and
endings are about the object to be grasped alone. A distractor at the back or the side of a
finger is felt by nothing. The network was trained on one object at a time.

## End
Truncated after ``max_episode_steps`` steps, 100 by default (with ``gymnasium.make`` its wrapper
counts the steps, and :meth:`set_state` does not restore the count); a lift does not end the
episode.
Terminated, with the reason in ``info["ending"]``, when the object leaves the table
(``object_lost``), a body's state becomes infinite (``non_finite``) or leaves the declared
bounds (``out_of_range``), the engine fails (``engine_error``), or the tactile model cannot
solve a press (``press_failed``, with the kind of the error in ``info["press_error"]``; rarely,
mostly when a finger stands in a wall of the object); the last observation is then the last
valid one. If a press fails along its path but can be solved at the end of the path from rest,
the episode continues without the history of friction, and ``info["press_error"]`` has the kind
of the error. ``info["is_success"]`` is true while the object is lifted and has been for
``hold_time``.

## Picture
With a `tactile` model, pads have their deformed shape and are coloured by von Mises stress.
While a pad touches, the upper right corner shows its face, seen from the object, beside the
colour scale: from 0 to 0.3 of Young's modulus, or to the limit of :class:`GraspFragileEnv`.
Stress for the picture is computed only when a picture is rendered.

## Settings
A default of two numbers is a range to draw from, which can also be given as one number. *Range*
is what is allowed; the unit 1 stands for ratios, counts and what is no number.
``gripper.max_force`` is an entry of a mapping, ``gripper={"max_force": 20}``; entries that are not
given keep their defaults.

{settings}"#;
