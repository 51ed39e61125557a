//! Settings from JSON: the given values replace the default settings of the named task.

use serde::{Deserialize, de::DeserializeOwned};
use serde_json::Value;

use super::{Config, Task};
use crate::{Error, Result};

impl Config {
    /// Reads settings: the values in `json` replace the default settings of its task, mappings
    /// entry by entry. An error names the setting, the value found and the value expected.
    pub fn from_json(json: &str) -> Result<Self> {
        #[derive(Deserialize)]
        struct Chosen {
            #[serde(default)]
            task: Task,
        }
        let given: Value = serde_json::from_str(json).map_err(|error| unreadable(".", &error))?;
        let Chosen { task } = read(&given)?;
        let usual = serde_json::to_value(Self::of(task));
        let mut settings = usual.expect("usual settings are plain numbers and names");
        overlay(&mut settings, given);
        let config: Self = read(&settings)?;
        config.validate()?;
        Ok(config)
    }
}

fn read<T: DeserializeOwned>(value: &Value) -> Result<T> {
    serde_path_to_error::deserialize(value)
        .map_err(|error| unreadable(&error.path().to_string(), error.inner()))
}

fn unreadable(path: &str, error: &serde_json::Error) -> Error {
    let name = if path == "." { "settings".to_owned() } else { path.to_owned() };
    let reason = error.to_string();
    let reason = reason.split(" at line ").next().unwrap_or_default().to_owned();
    Error::Setting { name, reason }
}

/// Merges `given` into `settings`, mappings entry by entry.
fn overlay(settings: &mut Value, given: Value) {
    match (settings, given) {
        (Value::Object(settings), Value::Object(given)) => {
            for (name, value) in given {
                overlay(settings.entry(name).or_insert(Value::Null), value);
            }
        }
        (settings, given) => *settings = given,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_given_is_as_usual_for_the_task() {
        for task in [Task::GraspLift, Task::GraspFragile, Task::GraspSoft, Task::HoldStill] {
            let name = serde_json::to_string(&task).unwrap();
            let config = Config::from_json(&format!(r#"{{"task": {name}}}"#)).unwrap();
            assert_eq!(config, Config::of(task));
        }
        let json =
            r#"{"task": "hold-still", "holding": {"load": [1, 2]}, "reward": {"thrift": 0}}"#;
        let (config, usual) = (Config::from_json(json).unwrap(), Config::of(Task::HoldStill));
        let [holding, of_usual] = [&config, &usual].map(|c| c.holding.clone().unwrap());
        assert_eq!((holding.load, holding.shaking), ([1.0, 2.0], of_usual.shaking));
        assert_ne!(config.reward, usual.reward);
        assert_eq!(config.scene, usual.scene);
    }
}
