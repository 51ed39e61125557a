//! Observation: named channels, defined in one table from which spaces, documentation and checks
//! are derived.

use nalgebra::Vector3;

use super::{Config, Moment};
use crate::{
    Error, Result,
    scene::Wrench,
    tactile::{Channel, MARKERS, Skin, Spec},
};

/// Names of the channels that every environment has, in the order of the table.
pub const CHANNELS: [&str; 5] = ["proprio", "object", "wrench", "properties", "time"];
/// Names of the channels of tactile fingers. With these, "wrench" comes from the tactile model,
/// too.
pub const TACTILE_CHANNELS: [&str; 8] = [
    Channel::Markers.name(),
    Channel::Displacement.name(),
    Channel::Stress.name(),
    Channel::TetStress.name(),
    Channel::Traction.name(),
    Channel::Slip.name(),
    Channel::Depth.name(),
    Channel::Trust.name(),
];

/// Consecutive entries of a channel that belong to one quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// Name of the quantity.
    pub name: String,
    /// Lower bounds, one per entry.
    pub low: Vec<f32>,
    /// Upper bounds, one per entry.
    pub high: Vec<f32>,
    /// SI unit.
    pub unit: &'static str,
}

/// Chosen channels and their positions in a row of observations.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    channels: Vec<(&'static str, Vec<Component>)>,
    low: Vec<f32>,
    high: Vec<f32>,
}

impl Layout {
    /// Layout of the configured channels, for tactile fingers of surface `skin` if given; returns
    /// an error if a name is unknown, repeated or missing.
    pub fn new(config: &Config, skin: Option<&Skin>) -> Result<Self> {
        let named = |name| {
            let felt = skin.zip(Channel::named(name));
            (name, felt.map_or_else(|| components(name, config), |(s, c)| of_fingers(c, s)))
        };
        let channels: Vec<_> = Self::check(config)?.into_iter().map(named).collect();
        let all = || channels.iter().flat_map(|(_, components)| components);
        let low = all().flat_map(|c| c.low.clone()).collect();
        let high = all().flat_map(|c| c.high.clone()).collect();
        Ok(Self { channels, low, high })
    }

    /// Names of the configured channels; returns an error if one is unknown, repeated or missing.
    pub(super) fn check(config: &Config) -> Result<Vec<&'static str>> {
        let tactile = if config.pads_feel() { &TACTILE_CHANNELS } else { &[][..] };
        let known = [&CHANNELS, config.task.channels(), tactile].concat();
        let invalid = |found: &str| {
            let hint =
                if TACTILE_CHANNELS.contains(&found) { "; set tactile for more" } else { "" };
            let expected = format!("one or more of {}, each once{hint}", known.join(", "));
            Error::invalid("observation", found, expected)
        };
        let mut names = Vec::new();
        for name in config.channels() {
            let name = *known.iter().find(|c| **c == name).ok_or_else(|| invalid(name))?;
            if names.contains(&name) {
                return Err(invalid(&format!("{name} twice")));
            }
            names.push(name);
        }
        if names.is_empty() { Err(invalid("no channel")) } else { Ok(names) }
    }

    /// Channels with their components, in order.
    pub fn channels(&self) -> &[(&'static str, Vec<Component>)] {
        &self.channels
    }

    /// Number of entries of one observation.
    pub fn size(&self) -> usize {
        self.low.len()
    }

    /// Writes the observation of `moment` into `row`.
    pub fn write(&self, moment: &Moment, row: &mut [f32]) {
        let mut rest = row;
        for channel in 0..self.channels.len() {
            rest = self.write_channel(channel, moment, rest);
        }
    }

    /// Writes channel number `channel` to the beginning of `row` and returns the rest of `row`.
    pub fn write_channel<'r>(
        &self,
        channel: usize,
        moment: &Moment,
        row: &'r mut [f32],
    ) -> &'r mut [f32] {
        let (name, components) = &self.channels[channel];
        let size = components.iter().map(|component| component.low.len()).sum();
        let (here, rest) = row.split_at_mut(size);
        let mut writer = Writer { row: here, at: 0 };
        match (*name, moment.feeling.zip(Channel::named(name))) {
            (_, Some((feeling, channel))) => {
                for felt in feeling.fingers {
                    channel
                        .read(feeling.skin, felt.as_ref())
                        .into_iter()
                        .for_each(|x| writer.push(x));
                }
            }
            ("proprio", _) => proprio(moment, &mut writer),
            ("object", _) => object(moment, &mut writer),
            ("wrench", _) => moment.state.fingers.iter().for_each(|f| writer.wrench(&f.wrench)),
            ("properties", _) => properties(moment, &mut writer),
            ("squeeze", _) => squeeze(moment, &mut writer),
            ("deformation", _) => deformation(moment, &mut writer),
            ("share", _) => writer.push(moment.share_of_limit()),
            ("limit", _) => writer.push(moment.draw.stress_limit.unwrap_or_default()),
            _ => writer.push(moment.time),
        }
        debug_assert_eq!(writer.at, size, "{name} writes what the table declares");
        rest
    }

    /// Returns whether every entry is within its declared bounds (and so finite).
    pub fn holds(&self, row: &[f32]) -> bool {
        row.iter().zip(&self.low).zip(&self.high).all(|((x, low), high)| low <= x && x <= high)
    }
}

/// Components of a tactile channel for both fingers.
fn of_fingers(channel: Channel, skin: &Skin) -> Vec<Component> {
    let component = |side: &str, spec: &Spec| {
        let count = spec.shape.iter().product();
        let shape = spec.shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(" x ");
        Component {
            name: format!("{}, {side} pad: {shape}", spec.name),
            low: vec![spec.low as f32; count],
            high: vec![spec.high as f32; count],
            unit: spec.unit,
        }
    };
    let specs = channel.specs(skin);
    let of = |side: &'static str| specs.iter().map(move |spec| component(side, spec));
    of("−x").chain(of("+x")).collect()
}

/// Components of each channel that is not tactile.
fn components(channel: &str, config: &Config) -> Vec<Component> {
    let (gripper, workspace) = (&config.scene.gripper, &config.scene.workspace);
    // Margin for rounding to single precision.
    let about = |x: f64| (x + 1e-3 * x.abs().max(1e-3) * x.signum()) as f32;
    // The velocities along two axes of the world can add up along one axis of a turned wrist.
    let diagonal = std::f64::consts::SQRT_2 * gripper.max_speed;
    let both = |name: &str, n: usize, limit: f64, unit| Component {
        name: name.to_owned(),
        low: vec![about(-limit); n],
        high: vec![about(limit); n],
        unit,
    };
    let between = |name: &str, n: usize, low: f64, high: f64, unit| Component {
        name: name.to_owned(),
        low: vec![low as f32; n],
        high: vec![high as f32; n],
        unit,
    };
    match channel {
        "proprio" => vec![
            Component {
                name: "tool centre position".to_owned(),
                low: workspace.low.map(|x| (x - 1e-4) as f32).into(),
                high: workspace.high.map(|x| (x + 1e-4) as f32).into(),
                unit: "m",
            },
            both("sine and cosine of yaw", 2, 1.0, ""),
            both("tool centre velocity, in the wrist's frame", 3, diagonal, "m/s"),
            both("yaw rate", 1, gripper.max_yaw_rate, "rad/s"),
            between("opening", 1, -0.05, gripper.max_opening + 0.05, "m"),
            both("opening rate", 1, 2.0 * FASTEST, "m/s"),
            both("grip force command", 1, gripper.max_force, "N"),
            both("normal force of each pad", 2, STRONGEST, "N"),
        ],
        "object" => vec![
            both("position from the tool centre, in the wrist's frame", 3, 2.0, "m"),
            both("first two columns of the rotation in the wrist's frame", 6, 1.0, ""),
            both("velocity, in the wrist's frame", 3, FASTEST, "m/s"),
            both("angular velocity, in the wrist's frame", 3, 2000.0, "rad/s"),
            both("rise over the table", 1, 2.0, "m"),
        ],
        "wrench" => vec![
            both("force on the −x pad, in its frame", 3, STRONGEST, "N"),
            both("torque on the −x pad about its face's centre", 3, STRONGEST, "N m"),
            both("force on the +x pad, in its frame", 3, STRONGEST, "N"),
            both("torque on the +x pad about its face's centre", 3, STRONGEST, "N m"),
        ],
        "properties" => vec![
            between("mass", 1, 0.0, 1001.0, "kg"),
            between("friction coefficient", 1, 0.0, 10.01, ""),
            between("half of the bounding box's edges", 3, 0.0, 10.0, "m"),
        ],
        "squeeze" => vec![
            between("root mean square deformation of the object", 1, 0.0, 0.1, "m"),
            between("highest and mean von Mises stress in the object", 2, 0.0, 1e9, "Pa"),
        ],
        "deformation" => {
            vec![both(
                "how the object's markers are displaced, in the wrist's frame",
                3 * MARKERS,
                0.1,
                "m",
            )]
        }
        "share" => {
            vec![between("highest stress in the pads, of the episode's limit", 1, 0.0, 1e4, "")]
        }
        "limit" => {
            vec![between("stress in the pads that ends the episode", 1, 0.0, 1e10, "Pa")]
        }
        _ => vec![between("time since the start of the episode", 1, 0.0, 1.1e6, "s")],
    }
}

/// Bound of every speed (m/s): the scene's limit, with a margin for rounding.
const FASTEST: f64 = 21.0;
/// Bound of contact forces (N) and torques (N m), above which an impact counts as out of range.
const STRONGEST: f64 = 5000.0;

fn proprio(moment: &Moment, writer: &mut Writer) {
    let (wrist, fingers) = (&moment.state.wrist, &moment.state.fingers);
    writer.vector(&wrist.pose.translation.vector);
    writer.push(wrist.yaw.sin());
    writer.push(wrist.yaw.cos());
    writer.vector(&wrist.pose.rotation.inverse_transform_vector(&wrist.velocity));
    writer.push(wrist.yaw_rate);
    writer.push(moment.state.opening());
    writer.push(fingers[0].velocity + fingers[1].velocity);
    writer.push(moment.grip);
    // Adding zero turns the −0 of an idle pad into 0.
    for finger in fingers {
        writer.push(finger.normal_force() + 0.0);
    }
}

fn object(moment: &Moment, writer: &mut Writer) {
    let (state, wrist) = (moment.state, &moment.state.wrist.pose.rotation);
    let seen = state.object_in_wrist();
    writer.vector(&seen.translation.vector);
    writer.vector(&(seen.rotation * Vector3::x()));
    writer.vector(&(seen.rotation * Vector3::y()));
    writer.vector(&wrist.inverse_transform_vector(&state.object.velocity));
    writer.vector(&wrist.inverse_transform_vector(&state.object.angular_velocity));
    writer.push(moment.rise());
}

fn squeeze(moment: &Moment, writer: &mut Writer) {
    let numbers = moment.squeezed.map(|s| [s.deviation, s.peak, s.mean]);
    numbers.unwrap_or_default().into_iter().for_each(|x| writer.push(x));
}

fn deformation(moment: &Moment, writer: &mut Writer) {
    let turn = moment.state.object_in_wrist().rotation.to_rotation_matrix().into_inner();
    let seen = moment.squeezed.map_or_else(Vec::new, |squeezed| squeezed.seen(&turn));
    for i in 0..MARKERS {
        writer.vector(&seen.get(i).copied().unwrap_or_default());
    }
}

fn properties(moment: &Moment, writer: &mut Writer) {
    writer.push(moment.draw.mass);
    writer.push(moment.draw.friction);
    writer.vector(&moment.draw.half_extents.into());
}

/// Writer that fills a row from the left.
struct Writer<'a> {
    row: &'a mut [f32],
    at: usize,
}

impl Writer<'_> {
    fn push(&mut self, x: f64) {
        self.row[self.at] = x as f32;
        self.at += 1;
    }

    fn vector(&mut self, v: &Vector3<f64>) {
        v.iter().for_each(|&x| self.push(x));
    }

    fn wrench(&mut self, wrench: &Wrench) {
        self.vector(&wrench.force);
        self.vector(&wrench.torque);
    }
}
