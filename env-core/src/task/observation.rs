//! The observation: named channels, each a row of the one table that spaces, documentation and
//! checks come from.

use nalgebra::Vector3;

use super::{Config, Moment};
use crate::{Error, Result, scene::Wrench};

/// Names of all channels, in the order of the table.
pub const CHANNELS: [&str; 5] = ["proprio", "object", "wrench", "properties", "time"];

/// Some neighbouring entries of a channel that share bounds and unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// What they are.
    pub name: &'static str,
    /// Lower bounds, one an entry.
    pub low: Vec<f32>,
    /// Upper bounds, one an entry.
    pub high: Vec<f32>,
    /// SI unit.
    pub unit: &'static str,
}

/// The chosen channels and where they lie in a row of observations.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    channels: Vec<(&'static str, Vec<Component>)>,
    low: Vec<f32>,
    high: Vec<f32>,
}

impl Layout {
    /// The layout of the configured channels; an unknown, repeated or missing name is an error.
    pub fn new(config: &Config) -> Result<Self> {
        let known = format!("one or more of {}, each once", CHANNELS.join(", "));
        let unknown = |found: &str| Error::invalid("observation", found, known.clone());
        let mut channels = Vec::new();
        for name in &config.observation {
            let name = *CHANNELS.iter().find(|c| *c == name).ok_or_else(|| unknown(name))?;
            if channels.iter().any(|(n, _)| *n == name) {
                return Err(unknown(&format!("{name} twice")));
            }
            channels.push((name, components(name, config)));
        }
        if channels.is_empty() {
            return Err(unknown("no channel"));
        }
        let all = || channels.iter().flat_map(|(_, components)| components);
        let low = all().flat_map(|c| c.low.clone()).collect();
        let high = all().flat_map(|c| c.high.clone()).collect();
        Ok(Self { channels, low, high })
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
        let mut writer = Writer { row, at: 0 };
        for (name, _) in &self.channels {
            match *name {
                "proprio" => proprio(moment, &mut writer),
                "object" => object(moment, &mut writer),
                "wrench" => moment.state.fingers.iter().for_each(|f| writer.wrench(&f.wrench)),
                "properties" => properties(moment, &mut writer),
                _ => writer.push(f64::from(moment.steps.0) / f64::from(moment.steps.1)),
            }
        }
        debug_assert_eq!(writer.at, self.size(), "every channel writes what the table declares");
    }

    /// Whether every entry is within its declared bounds (and so finite).
    pub fn holds(&self, row: &[f32]) -> bool {
        row.iter().zip(&self.low).zip(&self.high).all(|((x, low), high)| low <= x && x <= high)
    }
}

/// The table: what each channel consists of.
fn components(channel: &str, config: &Config) -> Vec<Component> {
    let (gripper, workspace) = (&config.scene.gripper, &config.scene.workspace);
    // Room for rounding to single precision.
    let about = |x: f64| (x + 1e-3 * x.abs().max(1e-3) * x.signum()) as f32;
    let both = |name, n: usize, limit: f64, unit| Component {
        name,
        low: vec![about(-limit); n],
        high: vec![about(limit); n],
        unit,
    };
    let between = |name, n: usize, low: f64, high: f64, unit| Component {
        name,
        low: vec![low as f32; n],
        high: vec![high as f32; n],
        unit,
    };
    match channel {
        "proprio" => vec![
            Component {
                name: "tool centre position",
                low: workspace.low.map(|x| (x - 1e-4) as f32).into(),
                high: workspace.high.map(|x| (x + 1e-4) as f32).into(),
                unit: "m",
            },
            both("sine and cosine of yaw", 2, 1.0, ""),
            both("tool centre velocity", 3, gripper.max_speed, "m/s"),
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
        _ => vec![between("share of the episode that is over", 1, 0.0, 1.0, "")],
    }
}

/// Speed that no body exceeds (m/s): the scene's cap, with room for rounding.
const FASTEST: f64 = 21.0;
/// Force past which an impact counts as out of range (N, N m).
const STRONGEST: f64 = 5000.0;

fn proprio(moment: &Moment, writer: &mut Writer) {
    let (wrist, fingers) = (&moment.state.wrist, &moment.state.fingers);
    writer.vector(&wrist.pose.translation.vector);
    writer.push(wrist.yaw.sin());
    writer.push(wrist.yaw.cos());
    writer.vector(&wrist.velocity);
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

fn properties(moment: &Moment, writer: &mut Writer) {
    writer.push(moment.draw.mass);
    writer.push(moment.draw.friction);
    writer.vector(&moment.draw.half_extents.into());
}

/// Fills a row from the left.
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
