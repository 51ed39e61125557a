//! Settings of a task, as they come from Python.

use serde::Serialize;

use super::{ObjectSpec, Range, RewardWeights, SensorErrors, Setting, Task};
use crate::{
    Error, Result,
    deformation::Moduli,
    scene::{Gripper, SceneConfig, SoftPads, Workspace},
    sensor::Sensor,
    tactile::{Choice, GelMaterial, Resolution, TactileConfig},
};

/// Settings of an environment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TaskConfig {
    /// Task of the agent, with the settings that only it has.
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
    /// Control steps after which an episode is truncated.
    pub max_episode_steps: u32,
    /// Model that computes touch.
    pub tactile: Choice,
    /// Name of the sensor on both fingers, or the path of its .toml file.
    pub sensor: String,
    /// Material of its gel: the name of a calibration, or moduli; the first calibration if `None`.
    pub material: Option<GelMaterial>,
    /// Path of the network's weights; the shipped ones if `None`.
    pub network: Option<String>,
    /// Young's modulus of the gel relative to that of its material.
    pub gel_stiffness: Range,
    /// Resolution of the pads' mesh and of the channels.
    pub resolution: Resolution,
    /// Errors of sensors, by the name of their channel.
    pub sensor_errors: SensorErrors,
    /// Names of the observation's channels; see [`TaskConfig::channels`] for the default.
    pub observation: Option<Vec<String>>,
    /// Weights of the reward's terms.
    pub reward: RewardWeights,
}

impl Default for TaskConfig {
    /// Default settings of the first task.
    fn default() -> Self {
        Self::of(&Task::default())
    }
}

/// Largest grip force of the tasks other than GraspLift, unless they need more (N).
pub(super) const LIGHT_GRIP: f64 = 10.0;
/// Largest grip force of GraspFragile and HoldStill, which holds their heaviest and smoothest
/// objects with a margin (N).
pub(super) const FIRM_GRIP: f64 = 20.0;
/// Centring stiffness of fingers that close gently (N/m): with the default stiffness, the spring
/// drives a finger with a grip force below 1 N at several times its closing speed.
const LIGHT_CENTERING: f64 = 1e3;

impl TaskConfig {
    /// Default settings of `task`.
    pub fn of(task: &Task) -> Self {
        let objects =
            ["sphere", "cuboid", "cylinder", "prism", "annulus", "ellipsoid", "cup", "potato"];
        let touch = TactileConfig::default();
        let mut config = Self {
            reward: RewardWeights::of(task),
            task: task.clone(),
            scene: SceneConfig::default(),
            objects: Vec::new(),
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
            max_episode_steps: 100,
            tactile: touch.choice,
            sensor: touch.sensor,
            material: touch.material,
            network: touch.network,
            gel_stiffness: AS_CALIBRATED,
            resolution: touch.resolution,
            sensor_errors: SensorErrors::new(),
            observation: None,
        };
        config.choose_objects(&objects);
        task.adapt(&mut config);
        config
    }

    /// Replaces the objects by those of the catalogue with these names.
    pub(super) fn choose_objects(&mut self, names: &[&str]) {
        self.objects = names.iter().map(|&name| ObjectSpec::Name(name.into())).collect();
    }

    /// Starts the hand around an object in the middle, restricts it to gentle vertical motion, and
    /// sets a small lift height.
    pub(super) fn begin_round_the_object(&mut self) {
        (self.lift_height, self.max_episode_steps) = (0.03, 60);
        self.scene.gripper.centering_stiffness = LIGHT_CENTERING;
        self.move_gently();
    }

    /// Restricts the hand to vertical motion, so gentle that it hardly shakes a held object.
    pub(super) fn move_gently(&mut self) {
        let SceneConfig { gripper, workspace, .. } = &mut self.scene;
        (gripper.max_speed, gripper.max_acceleration, gripper.max_yaw_rate) = (0.1, 1.0, 0.0);
        for corner in [&mut workspace.low, &mut workspace.high] {
            corner[..2].fill(0.0);
        }
        (self.position, self.start) = ([0.0; 2], [0.0; 2]);
    }

    /// Settings of touch.
    pub fn touch(&self) -> TactileConfig {
        let Self { tactile: choice, sensor, material, resolution, network, .. } = self.clone();
        TactileConfig { choice, sensor, material, resolution, network }
    }

    /// Paths of the files that the settings name: sensor, network and meshes.
    pub fn files(&self) -> Vec<&str> {
        let sensor = Some(&*self.sensor).filter(|sensor| Sensor::is_file(sensor));
        let meshes = self.objects.iter().filter_map(ObjectSpec::file);
        sensor.into_iter().chain(self.network.as_deref()).chain(meshes).collect()
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
        self.tactile != Choice::None && self.task.soft_material().is_none()
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
        if let Some(material) = self.task.soft_material() {
            let [low, high] = material.young;
            let moduli = Moduli { young: 0.5 * (low + high), poisson: material.poisson };
            let pads = SoftPads::on_elastic(&self.scene.gripper, moduli, MIDDLING);
            self.scene = self.scene.with_pads(pads);
        } else if feels {
            let (_, moduli) = touch.material(&sensor)?;
            let pads = SoftPads::new(&sensor, touch.calibration(&sensor)?);
            self.scene = self.scene.with_pads(SoftPads { young: moduli.young, ..pads });
        }
        Ok(self)
    }

    /// The numeric settings: the common ones that have an effect, then those of the task.
    pub fn settings(&mut self) -> Vec<Setting<'_>> {
        let unused = self.task.unused_settings();
        let Self {
            mass, friction, size, position, yaw, start, start_height, gel_stiffness, ..
        } = self;
        let mut settings = vec![
            Setting::range("mass", mass, [1e-6, 1e3], "kg", "mass of the object"),
            Setting::range(
                "friction",
                friction,
                [0.0, 10.0],
                "",
                "Coulomb coefficient of the object against pads and table; up to 4 with ``tactile`` \
                 \"surrogate\" and \"compliance\"",
            ),
            Setting::range("size", size, [0.1, 10.0], "", "size relative to the named object"),
            Setting::range(
                "position",
                position,
                PLACE,
                "m",
                "x and y of the object, each, in ``workspace``",
            ),
            Setting::range("yaw", yaw, [-7.0, 7.0], "rad", "yaw of the object about z"),
            Setting::range(
                "start",
                start,
                PLACE,
                "m",
                "x and y of the tool centre, each, in ``workspace``",
            ),
            Setting::range("start_height", start_height, PLACE, "m", "height of the tool centre"),
            Setting::number(
                "lift_height",
                &mut self.lift_height,
                [0.001, PLACE[1]],
                "m",
                "rise that counts as lifted",
            ),
            Setting::number(
                "hold_time",
                &mut self.hold_time,
                [0.0, 60.0],
                "s",
                "time for which the lifted object must stay held",
            ),
            Setting::range(
                "gel_stiffness",
                gel_stiffness,
                [0.1, 10.0],
                "",
                "Young's modulus of the gel relative to that of its material",
            ),
        ];
        settings.retain(|setting| !unused.contains(&setting.name));
        settings.extend(self.task.settings());
        settings
    }
}

/// Stiffness of a gel that is the material's own.
pub(super) const AS_CALIBRATED: Range = [1.0, 1.0];
/// Typical radius of a soft object (m).
const MIDDLING: f64 = 0.018;
/// Bounds of every place (m): the scene's limits of a workspace.
pub(super) const PLACE: Range = [-1.0, 1.0];
/// Gap between pads and table at the bottom of the default workspace (m).
const CLEARANCE: f64 = 1e-3;
