//! Settings of a task, as they come from Python.

use serde::{Deserialize, Serialize};

use super::{Closing, Fragility, Holding, Layout, ObjectSpec, Softness, Task, Weights};
use crate::{
    Error, Result,
    deformation::Moduli,
    scene::{Gripper, Object, ObjectModel, SceneConfig, SoftPads, Workspace},
    tactile::{self, Choice, Material, Resolution},
};

/// Lower and upper end of a uniform draw.
pub type Range = [f64; 2];

/// Settings of an environment. Unknown names are errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Task of the agent.
    pub task: Task,
    /// Gripper, workspace and solver.
    pub scene: SceneConfig,
    /// Objects to draw from, with equal probability.
    pub objects: Vec<ObjectSpec>,
    /// Mass (kg).
    pub mass: Range,
    /// Coulomb coefficient of the object against pads and table.
    pub friction: Range,
    /// Size relative to the named object.
    pub size: Range,
    /// Position of the object: x and y, each in this range (m).
    pub position: Range,
    /// Yaw of the object about z (rad).
    pub yaw: Range,
    /// Start position of the tool centre: x and y, each in this range (m).
    pub start: Range,
    /// Height at which the tool centre starts (m).
    pub start_height: Range,
    /// Rise that counts as lifted (m).
    pub lift_height: f64,
    /// Time for which the lifted object must stay held (s).
    pub hold_time: f64,
    /// Grip force that changes by factors: in all tasks but GraspLift.
    pub closing: Option<Closing>,
    /// Stress limit of a fragile grasp: in GraspFragile only.
    pub fragility: Option<Fragility>,
    /// Disturbance of a held object: in HoldStill only.
    pub holding: Option<Holding>,
    /// Material of soft objects: in GraspSoft only.
    pub softness: Option<Softness>,
    /// Control steps after which an episode is truncated.
    pub max_episode_steps: u32,
    /// Model that computes touch.
    pub tactile: Choice,
    /// Name of the sensor on both fingers, or the path of its .toml file.
    pub sensor: String,
    /// Material of its gel: the name of a calibration, or moduli; the first calibration if `None`.
    pub material: Option<Material>,
    /// Resolution of the pads' mesh and of the channels.
    pub resolution: Resolution,
    /// Names of the observation's channels; see [`Config::channels`] for the default.
    pub observation: Option<Vec<String>>,
    /// Weights of the reward's terms.
    pub reward: Weights,
}

impl Default for Config {
    /// Default settings of GraspLift.
    fn default() -> Self {
        let objects =
            ["sphere", "cuboid", "cylinder", "prism", "annulus", "ellipsoid", "cup", "potato"];
        let touch = tactile::Config::default();
        Self {
            task: Task::GraspLift,
            scene: SceneConfig::default(),
            objects: objects.map(|name| ObjectSpec::Name(name.into())).into(),
            mass: [0.02, 0.2],
            friction: [0.5, 1.0],
            size: [0.9, 1.1],
            position: [-0.05, 0.05],
            yaw: [-std::f64::consts::PI, std::f64::consts::PI],
            start: [-0.05, 0.05],
            // High enough for the hand to be over the object before the pads are beside it.
            start_height: [0.12, 0.16],
            lift_height: 0.08,
            hold_time: 0.5,
            closing: None,
            fragility: None,
            holding: None,
            softness: None,
            max_episode_steps: 100,
            tactile: touch.choice,
            sensor: touch.sensor,
            material: touch.material,
            resolution: touch.resolution,
            observation: None,
            reward: Weights::of(Task::GraspLift),
        }
    }
}

/// Largest grip force of the tasks other than GraspLift, unless they need more (N).
const LIGHT_GRIP: f64 = 10.0;
/// Largest grip force of GraspFragile and HoldStill, which holds their heaviest and smoothest
/// objects with a margin (N).
const FIRM_GRIP: f64 = 20.0;
/// Centring stiffness of fingers that close gently (N/m): with the default stiffness, the spring
/// drives a finger with a grip force below 1 N at several times its closing speed.
const LIGHT_CENTERING: f64 = 1e3;

impl Config {
    /// Default settings of `task`.
    pub fn of(task: Task) -> Self {
        let mut config = Self { task, reward: Weights::of(task), ..Self::default() };
        if task == Task::GraspLift {
            return config;
        }
        config.scene.gripper.max_force = LIGHT_GRIP;
        let objects = match task {
            Task::GraspLift => &[][..],
            // Only objects that meet the pads with neither an edge nor a flat face.
            Task::GraspFragile => &["sphere", "cylinder", "ellipsoid"],
            // Only objects that rigid faces touch first with neither a flat face nor an edge.
            Task::GraspSoft => &["sphere", "ellipsoid", "potato", "lemon"],
            // Also no objects that turn about the line between two contact points, which rigid pads
            // cannot prevent.
            Task::HoldStill => &["sphere", "cuboid", "cylinder", "prism"],
        };
        config.objects = objects.iter().map(|&name| ObjectSpec::Name(name.into())).collect();
        match task {
            Task::GraspLift => {}
            Task::GraspFragile => {
                config.scene.gripper.max_force = FIRM_GRIP;
                // The trial grip of the lightest object is 0.5 N; the force must grow slowly enough
                // to sense the contact before that.
                config.begin_round_the_object(Closing { grip_rate: 5.0, ..Closing::default() });
                config.mass = [0.05, 0.4];
                config.friction = [0.3, 1.0];
                config.size = [0.8, 1.2];
                config.fragility = Some(Fragility::default());
            }
            Task::GraspSoft => {
                config.scene.gripper.pad_thickness = DEEP;
                config.begin_round_the_object(Closing {
                    start_grip: 0.1,
                    least_grip: 0.1,
                    ..Closing::default()
                });
                config.mass = [0.02, 0.06];
                config.friction = [0.6, 1.0];
                config.size = [1.0, 1.0];
                config.softness = Some(Softness::default());
            }
            Task::HoldStill => {
                config.scene.gripper.max_force = FIRM_GRIP;
                config.start_height = [0.08, 0.12];
                config.move_gently();
                config.mass = [0.02, 0.15];
                config.friction = [0.2, 1.6];
                config.closing = Some(Closing { start_grip: 5.0, ..Closing::default() });
                config.holding = Some(Holding::default());
            }
        }
        config
    }

    /// Starts the hand around an object in the middle, restricts it to gentle vertical motion, and
    /// sets a small lift height.
    fn begin_round_the_object(&mut self, closing: Closing) {
        self.closing = Some(closing);
        (self.lift_height, self.max_episode_steps) = (0.03, 60);
        self.scene.gripper.centering_stiffness = LIGHT_CENTERING;
        self.move_gently();
    }

    /// Restricts the hand to vertical motion, so gentle that it hardly shakes a held object.
    fn move_gently(&mut self) {
        let SceneConfig { gripper, workspace, .. } = &mut self.scene;
        (gripper.max_speed, gripper.max_acceleration, gripper.max_yaw_rate) = (0.1, 1.0, 0.0);
        for corner in [&mut workspace.low, &mut workspace.high] {
            corner[..2].fill(0.0);
        }
        (self.position, self.start) = ([0.0; 2], [0.0; 2]);
    }

    /// Settings of touch.
    pub fn touch(&self) -> tactile::Config {
        let Self { tactile: choice, sensor, material, resolution, .. } = self.clone();
        tactile::Config { choice, sensor, material, resolution }
    }

    /// Coulomb coefficient at `share` (0 to 1) of its range: in equal steps, or, in HoldStill, in
    /// equal ratios, so that no grip force suits more of the range than another.
    pub fn friction_at(&self, share: f64) -> f64 {
        let [low, high] = self.friction;
        match self.holding {
            Some(_) => low * (high / low).powf(share),
            None => low + (high - low) * share,
        }
    }

    /// Names of the observation's channels: those that are set, or the default ones of the task.
    pub fn channels(&self) -> Vec<&str> {
        match &self.observation {
            Some(names) => names.iter().map(String::as_str).collect(),
            None => self.task.usual_channels(self.tactile != Choice::None).into(),
        }
    }

    /// Returns whether the pads are soft and tactile: not with rigid fingers, nor if the object is
    /// the soft part.
    pub fn pads_feel(&self) -> bool {
        self.tactile != Choice::None && self.softness.is_none()
    }

    /// Returns these settings with the sensor's pad dimensions on the fingers, and with soft pads
    /// if they are tactile; returns an error if tactile fingers are to have other pad dimensions.
    pub fn with_sensor(mut self) -> Result<Self> {
        let (touch, usual) = (self.touch(), Gripper::default());
        let sensor = touch.sensor()?;
        let feels = self.pads_feel();
        let gripper = &mut self.scene.gripper;
        for (name, size, usual, of_sensor) in [
            ("pad_width", &mut gripper.pad_width, usual.pad_width, sensor.outline.width),
            ("pad_length", &mut gripper.pad_length, usual.pad_length, sensor.outline.length),
            (
                "pad_thickness",
                &mut gripper.pad_thickness,
                usual.pad_thickness,
                sensor.outline.thickness,
            ),
        ] {
            if *size == usual {
                *size = of_sensor;
            } else if *size != of_sensor && feels {
                let expected = format!("{of_sensor} m, as the sensor {} has it", self.sensor);
                return Err(Error::invalid(format!("gripper.{name}"), *size, expected));
            }
        }
        let lowest = &mut self.scene.workspace.low[2];
        if *lowest == Workspace::default().low[2] {
            *lowest = lowest.max(0.5 * sensor.outline.length + CLEARANCE);
        }
        if let Some(softness) = &self.softness {
            let [low, high] = softness.young;
            let moduli = Moduli { young: 0.5 * (low + high), poisson: softness.poisson };
            let pads = SoftPads::on_elastic(&self.scene.gripper, moduli, MIDDLING);
            self.scene = self.scene.with_pads(pads);
        } else if feels {
            let (_, moduli) = touch.material(&sensor)?;
            let pads = SoftPads::new(&sensor, touch.calibration(&sensor)?);
            self.scene = self.scene.with_pads(SoftPads { young: moduli.young, ..pads });
        }
        Ok(self)
    }

    /// Returns an error that names the first setting out of its range.
    pub fn validate(&self) -> Result<()> {
        self.scene.validate()?;
        let workspace = &self.scene.workspace;
        let flat = [0, 1].map(|axis| (workspace.low[axis], workspace.high[axis]));
        let (low, high) = (flat[0].0.max(flat[1].0), flat[0].1.min(flat[1].1));
        ordered("mass", self.mass, 1e-6, 1e3)?;
        ordered("friction", self.friction, 0.0, 10.0)?;
        ordered("size", self.size, 0.1, 10.0)?;
        ordered("position", self.position, low, high)?;
        ordered("yaw", self.yaw, -7.0, 7.0)?;
        ordered("start", self.start, low, high)?;
        ordered("start_height", self.start_height, workspace.low[2], workspace.high[2])?;
        ordered("lift_height", [self.lift_height; 2], 0.001, workspace.high[2])?;
        ordered("hold_time", [self.hold_time; 2], 0.0, 60.0)?;
        if !(1..=1_000_000).contains(&self.max_episode_steps) {
            return Err(Error::invalid(
                "max_episode_steps",
                self.max_episode_steps,
                "1 to 1000000 steps",
            ));
        }
        if !(1..=1000).contains(&self.objects.len()) {
            return Err(Error::invalid("objects", self.objects.len(), "1 to 1000 objects"));
        }
        self.touch().validate()?;
        self.validate_task()?;
        Layout::check(self)?;
        self.reward.validate(self.task)
    }

    /// Returns an error that names the first setting that the task lacks or does not have.
    fn validate_task(&self) -> Result<()> {
        let (task, tactile) = (self.task, self.tactile);
        if task == Task::GraspFragile && tactile == Choice::None {
            let expected =
                "surrogate, compliance or fem: GraspFragile limits the stress in the pads";
            return Err(Error::invalid("tactile", "none", expected));
        }
        let closes = [Task::GraspFragile, Task::GraspSoft, Task::HoldStill];
        belongs("closing", self.closing.as_ref(), task, &closes)?;
        belongs("fragility", self.fragility.as_ref(), task, &[Task::GraspFragile])?;
        belongs("softness", self.softness.as_ref(), task, &[Task::GraspSoft])?;
        if let Some(softness) = &self.softness {
            if tactile != Choice::Surrogate {
                let expected = "surrogate: it answers for the soft object";
                return Err(Error::invalid("tactile", serde_json::json!(tactile), expected));
            }
            if self.size != [1.0, 1.0] {
                let found = format!("{:?}", self.size);
                return Err(Error::invalid("size", found, "1: soft objects have one size"));
            }
            ordered("young", softness.young, 1e3, 1e8)?;
            ordered("poisson", [softness.poisson; 2], 0.0, 0.499)?;
            ordered("crush", [softness.crush; 2], 0.01, 1.0)?;
        }
        belongs("holding", self.holding.as_ref(), task, &[Task::HoldStill])?;
        let most = self.scene.gripper.max_force;
        if let Some(closing) = &self.closing {
            ordered("least_grip", [closing.least_grip; 2], 0.01, most)?;
            ordered("start_grip", [closing.start_grip; 2], closing.least_grip, most)?;
            ordered("grip_rate", [closing.grip_rate; 2], 0.01, 100.0)?;
        }
        if let Some(fragility) = &self.fragility {
            ordered("spare", [fragility.spare; 2], 1.0, 100.0)?;
            ordered("margin", fragility.margin, 0.01, 100.0)?;
            self.validate_trials(fragility)?;
        }
        let Some(holding) = &self.holding else { return Ok(()) };
        ordered("friction", self.friction, 0.01, 10.0)?;
        ordered("load", holding.load, 0.0, 1e3)?;
        ordered("shaking", holding.shaking, 0.0, 1e3)?;
        ordered("shaking_frequency", holding.frequency, 0.0, 0.5 / self.scene.physics.time_step)?;
        ordered("slip_limit", [holding.slip_limit; 2], 1e-5, 0.02)?;
        ordered("thrift", [holding.thrift; 2], 1.0, 100.0)
    }

    /// Models of the objects, checked at both ends of the ranges of mass and size.
    pub fn models(&self) -> Result<Vec<ObjectModel>> {
        let models: Vec<_> = self.objects.iter().map(ObjectSpec::model).collect::<Result<_>>()?;
        for (spec, model) in self.objects.iter().zip(&models) {
            for (mass, scale) in self.mass.into_iter().zip(self.size) {
                let pose = model.rest(scale, 0.0, 0.0, 0.0);
                let object = Object { model, scale, mass, friction: self.friction[0], pose };
                object.validate(&self.scene.gripper)?;
            }
            self.fits(spec, model)?;
        }
        Ok(models)
    }

    /// Returns an error unless the object fits between the open pads: across its narrowest side in
    /// GraspLift, across a horizontal side in the other tasks.
    fn fits(&self, spec: &ObjectSpec, model: &ObjectModel) -> Result<()> {
        let (low, high) = model.surface().bounds();
        let narrow = match self.task {
            Task::HoldStill | Task::GraspFragile | Task::GraspSoft => {
                model.width_in_hand(self.size[1])
            }
            Task::GraspLift => (high - low).min() * self.size[1],
        };
        let opening = self.scene.gripper.max_opening;
        if narrow < opening {
            return Ok(());
        }
        let found = format!("{spec}, {narrow:.3} m across its narrowest side");
        Err(Error::invalid("objects", found, format!("less than the opening of {opening} m")))
    }
}

/// Thickness of the fingers in GraspSoft (m): they may overlap the undeformed object by up to three
/// quarters of it.
const DEEP: f64 = 0.012;
/// Typical radius of a soft object (m).
const MIDDLING: f64 = 0.018;
/// Gap between pads and table at the bottom of the default workspace (m).
const CLEARANCE: f64 = 1e-3;

/// Returns an error if a setting that belongs to the tasks `owners` is missing in one of them or
/// given in another task.
fn belongs<T: Serialize>(name: &str, value: Option<&T>, task: Task, owners: &[Task]) -> Result<()> {
    match value {
        None if owners.contains(&task) => {
            Err(Error::invalid(name, "none", format!("a value: {}", task.name())))
        }
        Some(_) if !owners.contains(&task) => {
            let expected = format!("nothing: {} has no such setting", task.name());
            Err(Error::invalid(name, serde_json::json!(value), expected))
        }
        _ => Ok(()),
    }
}

fn ordered(name: &str, range: Range, low: f64, high: f64) -> Result<()> {
    let [from, to] = range;
    if low <= from && from <= to && to <= high {
        return Ok(());
    }
    let found = if from == to { format!("{from}") } else { format!("{range:?}") };
    Err(Error::invalid(name, found, format!("a rising range within {low} to {high}")))
}
