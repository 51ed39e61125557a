//! Settings from JSON: the given values replace the default settings of the named task.

use std::collections::BTreeMap;

use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Map, Value};

use super::{Task, TaskConfig};
use crate::{Error, Result};

/// Names of the settings that are no numbers; of those that are no mappings of numbers, with the
/// allowed values and a description.
pub(super) const OTHERS: [(&str, Option<[&str; 2]>); 13] = [
    (
        "objects",
        Some([
            "1 to 1,000 of them",
            "objects to draw from: names, mesh files, ``{\"mesh\": path, \"scale\": metres}``, or \
             ``{\"shape\": \"sphere\", \"radius\": 0.02}`` and the like",
        ]),
    ),
    (
        "max_episode_steps",
        Some(["1 to 1,000,000 steps", "control steps after which an episode is truncated"]),
    ),
    (
        "tactile",
        Some([
            "``\"surrogate\"``, ``\"compliance\"``, ``\"fem\"``, ``\"none\"``",
            "model that computes touch: a network, linear elasticity, finite elements, or none, with \
             rigid pads",
        ]),
    ),
    (
        "sensor",
        Some(["``\"gelsight-mini\"``, ``\"digit\"``, a .toml file", "sensor on both fingers"]),
    ),
    (
        "material",
        Some([
            "a name in the sensor's file, or ``{\"young\": Pa, \"poisson\": ratio}``, above 0 Pa and \
             0 to 0.4999995",
            "gel: a calibration of the sensor, or its Young's modulus and Poisson's ratio; none is the \
             sensor's first calibration",
        ]),
    ),
    (
        "network",
        Some([
            "a .safetensors file",
            "weights of ``tactile=\"surrogate\"``, as ``ruffini network train`` writes them; none is \
             the network that comes with the package",
        ]),
    ),
    ("resolution", None),
    ("observation", Some(["channels as above", "names of the observed channels"])),
    (
        "sensor_errors",
        Some([
            "``noise``, ``offset``, ``drift`` and ``hysteresis`` 0 to 1e9 in the unit of the channel, \
             ``gain`` 0 to 100, each a number or a range, or such by quantity; ``dead`` 0 to 1, \
             ``delay`` 0 to 25 steps",
            "errors of observed channels, as in ``{\"markers\": {\"noise\": (1e-5, 3e-5), \"gain\": \
             (0.9, 1.1), \"offset\": 1e-5, \"drift\": 1e-6, \"hysteresis\": 1e-5, \"dead\": 0.02, \
             \"delay\": 1}}``: deviation of noise in each step, factor, deviation of an offset drawn \
             at each reset, deviation of drift after a second, half-width of the loop between loading \
             and unloading, share of dead points, steps of delay; ranges are drawn from at each \
             reset for each pad; of channels with several quantities, each may have its own, as in \
             ``{\"wrench\": {\"noise\": {\"force\": 0.02, \"torque\": 1e-4}}}``",
        ]),
    ),
    (
        "reward_weights",
        Some([
            "0 to 1,000,000 each, not all 0",
            "weights of the reward's terms; one that is not named keeps its own",
        ]),
    ),
    ("gripper", None),
    ("workspace", None),
    ("physics", None),
];

impl TaskConfig {
    /// Reads settings: the values in `json` replace the default settings of its task, mappings
    /// entry by entry. An error names the setting, the value found and the value expected.
    pub fn from_json(json: &str) -> Result<Self> {
        let given: Value =
            serde_json::from_str(json).map_err(|error| unreadable("settings", ".", &error))?;
        let mut given: BTreeMap<String, Value> = read("settings", &given)?;
        let task = match given.remove("task") {
            Some(Value::String(name)) => Task::named(&name)?,
            Some(other) => return Err(Error::invalid("task", other, "the name of a task")),
            None => Task::default(),
        };
        let mut config = Self::of(&task);
        for (name, value) in &given {
            config.set(name, value)?;
        }
        config.validate()?;
        Ok(config)
    }

    /// Replaces the setting called `name`, or the given entries of a mapping, without a check of
    /// its range.
    pub fn set(&mut self, name: &str, value: &Value) -> Result<()> {
        if let Some(mut setting) = self.settings().into_iter().find(|own| own.name == name) {
            return setting.set(value);
        }
        match name {
            "objects" => self.objects = read(name, &listed(value))?,
            "max_episode_steps" => self.max_episode_steps = read(name, value)?,
            "tactile" => self.tactile = read(name, value)?,
            "sensor" => self.sensor = read(name, value)?,
            "material" => self.material = read(name, value)?,
            "network" => self.network = read(name, value)?,
            "resolution" => self.resolution = overlaid(name, &self.resolution, value)?,
            "observation" => self.observation = read(name, &listed(value))?,
            "sensor_errors" => self.sensor_errors = read(name, value)?,
            "reward_weights" => self.reward.set(&read(name, value)?, &self.task)?,
            "gripper" => self.scene.gripper = overlaid(name, &self.scene.gripper, value)?,
            "workspace" => self.scene.workspace = overlaid(name, &self.scene.workspace, value)?,
            "physics" => self.scene.physics = overlaid(name, &self.scene.physics, value)?,
            _ => return Err(self.unknown(name, value)),
        }
        Ok(())
    }

    /// The error of a setting that the task does not have.
    fn unknown(&self, name: &str, value: &Value) -> Error {
        let has = |mut of: Self| of.settings().iter().any(|setting| setting.name == name);
        if Task::all().iter().map(Self::of).any(has) {
            let expected = format!("nothing: {} has no such setting", self.task.name());
            return Error::invalid(name, value, expected);
        }
        let mut config = self.clone();
        let mut known: Vec<_> = config.settings().iter().map(|setting| setting.name).collect();
        known.extend(OTHERS.map(|(name, _)| name));
        Error::invalid("settings", name, format!("one of {}", known.join(", ")))
    }
}

/// `value`, or a list of it if it is one name.
fn listed(value: &Value) -> Value {
    if value.is_string() { Value::Array(vec![value.clone()]) } else { value.clone() }
}

/// `usual` with the entries that are `given`.
fn overlaid<T: Serialize + DeserializeOwned>(name: &str, usual: &T, given: &Value) -> Result<T> {
    let usual = serde_json::to_value(usual).expect("settings are plain numbers and names");
    let Value::Object(mut entries) = usual else { unreachable!("a struct is a mapping") };
    let given: Map<String, Value> = read(name, given)?;
    entries.extend(given);
    read(name, &Value::Object(entries))
}

/// Converts the setting called `name`; an error has the path within it.
fn read<T: DeserializeOwned>(name: &str, value: &Value) -> Result<T> {
    serde_path_to_error::deserialize(value)
        .map_err(|error| unreadable(name, &error.path().to_string(), error.inner()))
}

fn unreadable(name: &str, path: &str, error: &serde_json::Error) -> Error {
    let name = match path {
        "." => name.to_owned(),
        _ if path.starts_with('[') => format!("{name}{path}"),
        _ => format!("{name}.{path}"),
    };
    let reason = error.to_string();
    let reason = reason.split(" at line ").next().unwrap_or_default().to_owned();
    Error::Setting { name, reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_of_poissons_ratio_is_that_of_sensors() {
        let material = OTHERS.iter().find(|(name, _)| *name == "material").unwrap();
        let range = material.1.unwrap()[0];
        assert!(range.ends_with(&format!("0 to {}", crate::sensor::LARGEST_POISSON)), "{range}");
    }

    #[test]
    fn the_text_of_tactile_names_every_model() {
        // The error lists the variants.
        let error = TaskConfig::default().set("tactile", &"?".into()).unwrap_err().to_string();
        let (_, variants) = error.split_once("expected one of ").unwrap();
        let names = |text: &str, mark| {
            let mut names: Vec<_> =
                text.split(mark).skip(1).step_by(2).map(str::to_owned).collect();
            names.sort();
            names
        };
        let tactile = OTHERS.iter().find(|(name, _)| *name == "tactile").unwrap();
        assert_eq!(names(tactile.1.unwrap()[0], '"'), names(variants, '`'), "{error}");
    }

    #[test]
    fn what_is_not_given_is_as_usual_for_the_task() {
        for task in Task::all() {
            let config =
                TaskConfig::from_json(&format!(r#"{{"task": "{}"}}"#, task.name())).unwrap();
            assert_eq!(config, TaskConfig::of(&task));
        }
        let json =
            r#"{"task": "HoldStill", "load": [1, 2], "reward_weights": {"grip_economy": 0}}"#;
        let config = TaskConfig::from_json(json).unwrap();
        let mut usual = TaskConfig::of(&Task::named("HoldStill").unwrap());
        assert_ne!((&config.task, &config.reward), (&usual.task, &usual.reward));
        usual.set("load", &serde_json::json!([1.0, 2.0])).unwrap();
        assert_eq!((&config.task, &config.scene), (&usual.task, &usual.scene));
    }

    #[test]
    fn a_setting_without_effect_is_refused_by_name() {
        for task in Task::all() {
            for name in task.unused_settings() {
                let mut config = TaskConfig::of(&task);
                let error = config.set(name, &serde_json::json!(0.05)).unwrap_err().to_string();
                let expected = format!("nothing: {} has no such setting", task.name());
                assert_eq!(error, format!("{name}: found 0.05, expected {expected}"));
                TaskConfig::default().set(name, &serde_json::json!(0.05)).unwrap();
            }
        }
    }

    #[test]
    fn every_documented_setting_can_be_set() {
        let usual = TaskConfig::default();
        let Value::Object(defaults) = serde_json::to_value(&usual).unwrap() else { unreachable!() };
        for (name, _) in OTHERS {
            // Of a mapping, no entry is given.
            let value = defaults.get(name).cloned().unwrap_or_else(|| Map::new().into());
            let mut config = usual.clone();
            config.set(name, &value).unwrap();
            assert_eq!(config, usual, "{name}");
            let error = config.set(name, &Value::Bool(true)).unwrap_err().to_string();
            assert!(error.starts_with(name), "{name}: {error}");
        }
    }
}
