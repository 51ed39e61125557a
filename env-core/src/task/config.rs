//! Settings of the grasp task, as they come from Python.

use serde::{Deserialize, Serialize};

use super::{Layout, ObjectSpec, Weights};
use crate::{
    Error, Result,
    scene::{Gripper, Object, ObjectModel, SceneConfig, SoftPads, Workspace},
    tactile::{self, Choice, Material, Resolution},
};

/// Lower and upper end of a uniform draw.
pub type Range = [f64; 2];

/// Everything that defines the task. Unknown names are errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Gripper, workspace and solver.
    pub scene: SceneConfig,
    /// Objects to draw from, each as likely as the next.
    pub objects: Vec<ObjectSpec>,
    /// Mass (kg).
    pub mass: Range,
    /// Coulomb coefficient of the object against pads and table.
    pub friction: Range,
    /// Size relative to the named object.
    pub size: Range,
    /// Where the object lies: x and y, each in this range (m).
    pub position: Range,
    /// How the object is turned about z (rad).
    pub yaw: Range,
    /// Where the tool centre starts: x and y, each in this range (m).
    pub start: Range,
    /// Height at which the tool centre starts (m).
    pub start_height: Range,
    /// Rise that counts as lifted (m).
    pub lift_height: f64,
    /// Time for which the lifted object must stay held (s).
    pub hold_time: f64,
    /// Control steps after which an episode is truncated.
    pub max_episode_steps: u32,
    /// Which model answers what the fingers feel.
    pub tactile: Choice,
    /// Name of the sensor on both fingers, or the path of its .toml file.
    pub sensor: String,
    /// What its gel is made of: a calibration's name, or numbers; its first calibration if none.
    pub material: Option<Material>,
    /// How finely touch is computed and seen.
    pub resolution: Resolution,
    /// Names of the observation's channels; see [`Config::channels`] for what holds if none.
    pub observation: Option<Vec<String>>,
    /// Weights of the reward's terms.
    pub reward: Weights,
}

impl Default for Config {
    fn default() -> Self {
        let objects =
            ["sphere", "cuboid", "cylinder", "prism", "annulus", "ellipsoid", "cup", "potato"];
        let touch = tactile::Config::default();
        Self {
            scene: SceneConfig::default(),
            objects: objects.map(|name| ObjectSpec::Name(name.into())).into(),
            mass: [0.02, 0.2],
            friction: [0.5, 1.0],
            size: [0.9, 1.1],
            position: [-0.05, 0.05],
            yaw: [-std::f64::consts::PI, std::f64::consts::PI],
            start: [-0.05, 0.05],
            start_height: [0.08, 0.12],
            lift_height: 0.08,
            hold_time: 0.5,
            max_episode_steps: 100,
            tactile: touch.choice,
            sensor: touch.sensor,
            material: touch.material,
            resolution: touch.resolution,
            observation: None,
            reward: Weights::default(),
        }
    }
}

impl Config {
    /// Settings from JSON; an error names the setting, what was found and what was expected.
    pub fn from_json(json: &str) -> Result<Self> {
        let deserializer = &mut serde_json::Deserializer::from_str(json);
        let config: Self = serde_path_to_error::deserialize(deserializer).map_err(|error| {
            let path = error.path().to_string();
            let name = if path == "." { "settings".to_owned() } else { path };
            let reason = error.into_inner().to_string();
            let reason = reason.split(" at line ").next().unwrap_or_default().to_owned();
            Error::Setting { name, reason }
        })?;
        config.validate()?;
        Ok(config)
    }

    /// What is set about touch.
    pub fn touch(&self) -> tactile::Config {
        let Self { tactile: choice, sensor, material, resolution, .. } = self.clone();
        tactile::Config { choice, sensor, material, resolution }
    }

    /// Names of the observation's channels: body and object, and the markers of fingers that feel,
    /// where nothing else is asked for.
    pub fn channels(&self) -> Vec<&str> {
        match &self.observation {
            Some(names) => names.iter().map(String::as_str).collect(),
            None if self.tactile == Choice::None => vec!["proprio", "object"],
            None => vec!["proprio", "object", "markers"],
        }
    }

    /// These settings with the sensor's pads on the fingers, soft if these are to feel; an error if
    /// other pads were asked for.
    pub fn with_sensor(mut self) -> Result<Self> {
        let (touch, usual) = (self.touch(), Gripper::default());
        let sensor = touch.sensor()?;
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
            } else if *size != of_sensor && self.tactile != Choice::None {
                let expected = format!("{of_sensor} m, as the sensor {} has it", self.sensor);
                return Err(Error::invalid(format!("gripper.{name}"), *size, expected));
            }
        }
        let lowest = &mut self.scene.workspace.low[2];
        if *lowest == Workspace::default().low[2] {
            *lowest = lowest.max(0.5 * sensor.outline.length + CLEARANCE);
        }
        if self.tactile != Choice::None {
            let (_, moduli) = touch.material(&sensor)?;
            let pads = SoftPads::new(&sensor, touch.calibration(&sensor)?);
            self.scene = self.scene.with_pads(SoftPads { young: moduli.young, ..pads });
        }
        Ok(self)
    }

    /// An error that names the first setting out of its range.
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
        Layout::check(self)?;
        self.reward.validate()
    }

    /// The objects ready for the scene, checked at both ends of their ranges.
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

    /// Some side of the object must pass between the open pads.
    fn fits(&self, spec: &ObjectSpec, model: &ObjectModel) -> Result<()> {
        let (low, high) = model.surface().bounds();
        let narrow = (high - low).min() * self.size[1];
        let opening = self.scene.gripper.max_opening;
        if narrow < opening {
            return Ok(());
        }
        let found = format!("{spec}, {narrow:.3} m across its narrowest side");
        Err(Error::invalid("objects", found, format!("less than the opening of {opening} m")))
    }
}

/// Room that is left under the pads where the workspace is not set (m).
const CLEARANCE: f64 = 1e-3;

fn ordered(name: &str, range: Range, low: f64, high: f64) -> Result<()> {
    let [from, to] = range;
    if low <= from && from <= to && to <= high {
        return Ok(());
    }
    let found = if from == to { format!("{from}") } else { format!("{range:?}") };
    Err(Error::invalid(name, found, format!("a rising range within {low} to {high}")))
}
