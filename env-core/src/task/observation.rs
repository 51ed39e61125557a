//! Observation: named channels, defined in one table from which spaces, documentation and checks
//! are derived.

use nalgebra::{Isometry3, Vector3};

use super::{StateChannel, StepState, TaskConfig};
use crate::{
    Error, Result,
    deformation::Wrench,
    tactile::{Channel, MARKERS, Skin, Spec},
};

/// Source of a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Source {
    State(StateChannel),
    /// Both tactile fingers.
    Fingers(Channel),
}

impl Source {
    fn name(self) -> &'static str {
        match self {
            Self::State(channel) => channel.name(),
            Self::Fingers(channel) => channel.name(),
        }
    }
}

/// Names of the channels of tactile fingers. With these, "wrench" comes from the tactile model,
/// too.
pub const TACTILE_CHANNELS: [&str; Channel::ALL.len() - 1] = {
    let mut names = [""; Channel::ALL.len() - 1];
    let (mut channel, mut found) = (0, 0);
    while channel < Channel::ALL.len() {
        if !matches!(Channel::ALL[channel], Channel::Wrench) {
            names[found] = Channel::ALL[channel].name();
            found += 1;
        }
        channel += 1;
    }
    names
};

/// Consecutive entries of a channel that belong to one quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// Name of the quantity.
    pub name: String,
    /// Lower bounds, one per entry.
    pub low: Vec<f32>,
    /// Upper bounds, one per entry.
    pub high: Vec<f32>,
    /// SI unit, or pixel.
    pub unit: &'static str,
}

/// Place of a channel in an observation.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    /// Name of the channel.
    pub name: &'static str,
    /// Place of its first entry.
    pub first: usize,
    /// Number of its entries.
    pub size: usize,
    /// Number of entries of a point, such as 3 for the motion of a marker.
    pub point: usize,
    /// Number of sensors: 2 if each pad has its own, which come one after the other.
    pub sides: usize,
}

/// Chosen channels and their positions in a row of observations.
#[derive(Clone, Debug, PartialEq)]
pub struct ObservationLayout {
    sources: Vec<Source>,
    channels: Vec<(&'static str, Vec<Component>)>,
    low: Vec<f32>,
    high: Vec<f32>,
}

impl ObservationLayout {
    /// Layout of the configured channels, for tactile fingers of surface `skin` if given; returns
    /// an error if a name is unknown, repeated or missing.
    pub fn new(config: &TaskConfig, skin: Option<&Skin>) -> Result<Self> {
        // The wrench of tactile fingers comes from their model.
        let tactile = |source: Source| match (source, skin) {
            (Source::State(channel), Some(_)) => {
                Channel::named(channel.name()).map_or(source, Source::Fingers)
            }
            _ => source,
        };
        let sources: Vec<_> = Self::sources(config)?.into_iter().map(tactile).collect();
        let channel = |&source: &Source| match (source, skin) {
            (Source::Fingers(channel), Some(skin)) => (source.name(), of_fingers(channel, skin)),
            (Source::Fingers(_), None) => (source.name(), Vec::new()),
            (Source::State(channel), _) => (source.name(), components(channel, config)),
        };
        let pictured = skin.is_none_or(Skin::has_image);
        if !pictured && sources.contains(&Source::Fingers(Channel::Image)) {
            let expected = "a sensor whose file has camera.image, for the channel image";
            return Err(Error::invalid("sensor", &config.sensor, expected));
        }
        let channels: Vec<_> = sources.iter().map(channel).collect();
        let all = || channels.iter().flat_map(|(_, components)| components);
        let low = all().flat_map(|c| c.low.clone()).collect();
        let high = all().flat_map(|c| c.high.clone()).collect();
        Ok(Self { sources, channels, low, high })
    }

    /// Sources of the configured channels; returns an error if a name is unknown, repeated or
    /// missing.
    fn sources(config: &TaskConfig) -> Result<Vec<Source>> {
        let own = config.task.channels();
        let mut known: Vec<_> =
            StateChannel::SHARED.iter().chain(own).map(|&channel| Source::State(channel)).collect();
        if config.pads_feel() {
            known.extend(
                TACTILE_CHANNELS.into_iter().filter_map(Channel::named).map(Source::Fingers),
            );
        }
        let invalid = |found: &str| {
            let hint = match found {
                "predicted_error" => "; predicted_error needs tactile=\"surrogate\"",
                _ if TACTILE_CHANNELS.contains(&found) => "; set tactile for more",
                _ => "",
            };
            let known: Vec<_> = known.iter().map(|source| source.name()).collect();
            let expected = format!("one or more of {}, each once{hint}", known.join(", "));
            Error::invalid("observation", found, expected)
        };
        let mut sources = Vec::new();
        for name in config.channels() {
            let source = known.iter().find(|source| source.name() == name);
            let source = *source.ok_or_else(|| invalid(name))?;
            if sources.contains(&source) {
                return Err(invalid(&format!("{name} twice")));
            }
            if source == Source::State(StateChannel::Distractors) && config.task.distractors() == 0
            {
                let expected = "1 or more for the channel distractors";
                return Err(Error::invalid("distractors", 0, expected));
            }
            sources.push(source);
        }
        if sources.is_empty() { Err(invalid("no channel")) } else { Ok(sources) }
    }

    /// Returns an error if the name of a configured channel is unknown, repeated or missing.
    pub(super) fn check(config: &TaskConfig) -> Result<()> {
        Self::sources(config).map(|_| ())
    }

    /// Channels with their components, in order.
    pub fn channels(&self) -> &[(&'static str, Vec<Component>)] {
        &self.channels
    }

    /// Place of each channel, in order.
    pub fn spans(&self) -> impl Iterator<Item = Span> {
        let mut next = 0;
        self.sources.iter().zip(&self.channels).map(move |(source, (name, components))| {
            let size = components.iter().map(|component| component.low.len()).sum();
            let first = next;
            next += size;
            let by_pad = matches!(source, Source::Fingers(_) | Source::State(StateChannel::Wrench));
            let point = match source {
                Source::Fingers(channel) => channel.point(),
                Source::State(_) => 1,
            };
            Span { name, first, size, point, sides: if by_pad { 2 } else { 1 } }
        })
    }

    /// Lower and upper bounds of all entries.
    pub fn bounds(&self) -> [&[f32]; 2] {
        [&self.low, &self.high]
    }

    /// Number of entries of one observation.
    pub fn size(&self) -> usize {
        self.low.len()
    }

    /// Writes the observation of `step` into `row`.
    pub fn write(&self, step: &StepState, row: &mut [f32]) {
        let mut rest = row;
        for channel in 0..self.channels.len() {
            rest = self.write_channel(channel, step, rest);
        }
    }

    /// Writes channel number `channel` to the beginning of `row` and returns the rest of `row`.
    pub fn write_channel<'r>(
        &self,
        channel: usize,
        step: &StepState,
        row: &'r mut [f32],
    ) -> &'r mut [f32] {
        let (name, components) = &self.channels[channel];
        let size = components.iter().map(|component| component.low.len()).sum();
        let (here, rest) = row.split_at_mut(size);
        let mut writer = Writer { row: here, at: 0 };
        match self.sources[channel] {
            Source::Fingers(channel) => {
                let pads = step.pads.expect("tactile channels are of tactile fingers");
                for (finger, deformation) in pads.fingers.into_iter().enumerate() {
                    let (shapes, raised) = (pads.shapes(finger), &pads.raised[finger]);
                    for x in channel.read_with(pads.skin, deformation, &shapes, raised) {
                        writer.push(x);
                    }
                }
            }
            Source::State(channel) => writer.channel(channel, step),
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

/// Components of a channel that is not tactile.
pub(super) fn components(channel: StateChannel, config: &TaskConfig) -> Vec<Component> {
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
        StateChannel::Proprio => vec![
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
        StateChannel::Object => vec![
            both("position from the tool centre, in the wrist's frame", 3, 2.0, "m"),
            both("first two columns of the rotation in the wrist's frame", 6, 1.0, ""),
            both("velocity, in the wrist's frame", 3, FASTEST, "m/s"),
            both("angular velocity, in the wrist's frame", 3, 2000.0, "rad/s"),
            both("rise over the table", 1, 2.0, "m"),
        ],
        StateChannel::Wrench => vec![
            both("force, −x pad", 3, STRONGEST, "N"),
            both("torque, −x pad", 3, STRONGEST, "N m"),
            both("force, +x pad", 3, STRONGEST, "N"),
            both("torque, +x pad", 3, STRONGEST, "N m"),
        ],
        StateChannel::Properties => vec![
            between("mass", 1, 0.0, 1001.0, "kg"),
            between("friction coefficient", 1, 0.0, 10.01, ""),
            between("half of the bounding box's edges", 3, 0.0, 10.0, "m"),
        ],
        StateChannel::Squeeze => vec![
            between("root mean square deformation of the object", 1, 0.0, 0.1, "m"),
            between("highest and mean von Mises stress in the object", 2, 0.0, 1e9, "Pa"),
        ],
        StateChannel::Deformation => {
            vec![both(
                "displacement of the object's markers, in the wrist's frame",
                3 * MARKERS,
                0.1,
                "m",
            )]
        }
        StateChannel::StressRatio => {
            vec![between("highest stress in the pads over the episode's limit", 1, 0.0, 1e4, "")]
        }
        StateChannel::StressLimit => {
            vec![between("stress in the pads that ends the episode", 1, 0.0, 1e10, "Pa")]
        }
        StateChannel::Insertion => vec![
            both("middle of the peg's tip from the hole's mouth, in the hole's frame", 3, 2.0, "m"),
            both("yaw of the hand from the hole's", 1, std::f64::consts::PI, "rad"),
            both("force of the fixture on the peg, in the hole's frame", 3, STRONGEST, "N"),
        ],
        // Described as of one where there is none.
        StateChannel::Distractors => (1..=config.task.distractors().max(1))
            .flat_map(|i| {
                let place = format!("position {i} from the tool centre, in the wrist's frame");
                let turn = format!("first two columns of rotation {i} in the wrist's frame");
                [both(&place, 3, 10.0, "m"), both(&turn, 6, 1.0, "")]
            })
            .collect(),
        StateChannel::Time => {
            vec![between("time since the start of the episode", 1, 0.0, 1.1e6, "s")]
        }
    }
}

/// Bound of every speed (m/s): the scene's limit, with a margin for rounding.
const FASTEST: f64 = 21.0;
/// Bound of contact forces (N) and torques (N m), above which an impact counts as out of range.
const STRONGEST: f64 = 5000.0;

/// Writer that fills a row from the left.
struct Writer<'a> {
    row: &'a mut [f32],
    at: usize,
}

impl Writer<'_> {
    fn channel(&mut self, channel: StateChannel, step: &StepState) {
        match channel {
            StateChannel::Proprio => self.proprio(step),
            StateChannel::Object => self.object(step),
            StateChannel::Wrench => step.state.fingers.iter().for_each(|f| self.wrench(&f.wrench)),
            StateChannel::Properties => {
                self.push(step.episode.mass);
                self.push(step.episode.friction);
                self.vector(&step.episode.half_extents.into());
            }
            StateChannel::Time => self.push(step.time),
            StateChannel::StressRatio => self.push(step.stress_ratio()),
            StateChannel::StressLimit => self.push(step.episode.stress_limit.unwrap_or_default()),
            StateChannel::Squeeze => {
                let numbers = step.squeezed.map(|s| [s.deviation, s.peak, s.mean]);
                for x in numbers.unwrap_or_default() {
                    self.push(x);
                }
            }
            StateChannel::Deformation => self.deformation(step),
            StateChannel::Insertion => self.insertion(step),
            StateChannel::Distractors => self.distractors(step),
        }
    }

    fn proprio(&mut self, step: &StepState) {
        let (wrist, fingers) = (&step.state.wrist, &step.state.fingers);
        self.vector(&wrist.pose.translation.vector);
        self.push(wrist.yaw.sin());
        self.push(wrist.yaw.cos());
        self.vector(&wrist.pose.rotation.inverse_transform_vector(&wrist.velocity));
        self.push(wrist.yaw_rate);
        self.push(step.state.opening());
        self.push(fingers[0].velocity + fingers[1].velocity);
        self.push(step.grip);
        // Adding zero turns the −0 of an idle pad into 0.
        for finger in fingers {
            self.push(finger.normal_force() + 0.0);
        }
    }

    fn object(&mut self, step: &StepState) {
        let (state, wrist) = (step.state, &step.state.wrist.pose.rotation);
        self.pose(&state.object_in_wrist());
        self.vector(&wrist.inverse_transform_vector(&state.object.velocity));
        self.vector(&wrist.inverse_transform_vector(&state.object.angular_velocity));
        self.push(step.rise());
    }

    fn distractors(&mut self, step: &StepState) {
        for body in &step.state.distractors {
            self.pose(&step.state.wrist.pose.inv_mul(&body.pose));
        }
    }

    /// Position and first two columns of the rotation.
    fn pose(&mut self, pose: &Isometry3<f64>) {
        self.vector(&pose.translation.vector);
        self.vector(&(pose.rotation * Vector3::x()));
        self.vector(&(pose.rotation * Vector3::y()));
    }

    fn deformation(&mut self, step: &StepState) {
        let turn = step.state.object_in_wrist().rotation.to_rotation_matrix().into_inner();
        let markers = step.squeezed.map_or_else(Vec::new, |squeezed| squeezed.seen(&turn));
        for i in 0..MARKERS {
            self.vector(&markers.get(i).copied().unwrap_or_default());
        }
    }

    fn insertion(&mut self, step: &StepState) {
        let Some(insertion) = &step.episode.insertion else {
            return (0..7).for_each(|_| self.push(0.0));
        };
        self.vector(&insertion.tip(step));
        self.push(insertion.yaw(step));
        let turn = insertion.mouth().rotation.inverse();
        self.vector(&(turn * step.state.fixture.force));
    }

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
