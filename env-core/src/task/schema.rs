//! Description of all tasks, channels and settings, from which the Python package takes its names,
//! checks and documentation.

use serde_json::{Value, json};

use super::{
    Component, Ending, Setting, StateChannel, TACTILE_CHANNELS, Task, TaskConfig,
    observation::components, read::OTHERS,
};
use crate::Error;

/// The description as JSON: `tasks`, `settings` that all of them have, `channels`, `endings`, and
/// kinds of `press_errors`.
pub fn schema() -> Value {
    let mut usual = TaskConfig::default();
    let own = usual.task.settings().len();
    let mut shared: Vec<_> = usual.settings().iter().map(Setting::describe).collect();
    shared.truncate(shared.len() - own);
    let other = |(name, doc): (&str, &str)| json!({"name": name, "kind": "other", "doc": doc});
    shared.extend(OTHERS.map(other));
    let channels = StateChannel::SHARED.map(|channel| describe(channel, &usual));
    json!({
        "tasks": Task::all().iter().map(task).collect::<Vec<_>>(),
        "settings": shared,
        "channels": channels,
        "tactile_channels": TACTILE_CHANNELS,
        "press_errors": Error::KINDS,
        "endings": Ending::ALL.map(|e| json!({"name": e.name(), "is_rule": e.is_of_the_task()})),
    })
}

fn describe(channel: StateChannel, config: &TaskConfig) -> Value {
    let component = |c: Component| json!({"name": c.name, "size": c.low.len(), "unit": c.unit});
    let components = components(channel, config).into_iter().map(component).collect::<Vec<_>>();
    json!({"name": channel.name(), "doc": channel.doc(), "components": components})
}

fn task(task: &Task) -> Value {
    let mut config = TaskConfig::of(task);
    let terms = task.terms().iter();
    let terms = terms.map(|t| json!({"name": t.name, "weight": t.weight, "doc": t.doc}));
    let channels = task.channels().iter().map(|&channel| describe(channel, &config));
    let channels = channels.collect::<Vec<_>>();
    json!({
        "name": task.name(),
        "doc": task.doc(),
        "max_episode_steps": config.max_episode_steps,
        "terms": terms.collect::<Vec<_>>(),
        "channels": channels,
        "usual_channels": config.channels(),
        "objects": config.objects,
        "settings": config.settings().iter().map(Setting::describe).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_describes_its_settings_with_defaults_in_bounds() {
        let schema = schema();
        let tasks = schema["tasks"].as_array().unwrap();
        assert_eq!(tasks.len(), Task::all().len());
        for task in tasks {
            for setting in task["settings"].as_array().unwrap() {
                assert!(!setting["doc"].as_str().unwrap().is_empty(), "{setting}");
                let [low, high] = [0, 1].map(|end| setting["bounds"][end].as_f64().unwrap());
                assert!(low < high, "{setting}");
            }
            assert!(task["terms"].as_array().is_some_and(|terms| !terms.is_empty()), "{task}");
            TaskConfig::from_json(&json!({"task": task["name"]}).to_string()).unwrap();
        }
    }
}
