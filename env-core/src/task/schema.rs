//! Description of all tasks, channels and settings, from which the Python package takes its names,
//! checks and documentation.

use serde_json::{Map, Value, json};

use super::{
    Component, Ending, Setting, StartQuantity, StateChannel, TACTILE_CHANNELS, Task, TaskConfig,
    config::PLACE, objects::numbers, observation::components, read::OTHERS,
};
use crate::{
    Error,
    geometry::Shape,
    scene,
    tactile::{Channel, NODES},
};

/// The description as JSON: `tasks`, `settings` that all of them have, `channels`, those of tactile
/// fingers, `endings`, kinds of `shapes` and of `press_errors`.
pub fn schema() -> Value {
    let mut usual = TaskConfig::default();
    let own = usual.task.settings().len();
    let mut shared: Vec<_> = usual.settings().iter().map(Setting::describe).collect();
    shared.truncate(shared.len() - own);
    shared.extend(OTHERS.map(|(name, _)| json!({"name": name, "kind": "other"})));
    let channels = StateChannel::SHARED.map(|channel| describe(channel, &usual));
    let tactile = TACTILE_CHANNELS.into_iter().filter_map(Channel::named).map(|channel| {
        json!({"name": channel.name(), "size": channel.default_size(), "doc": channel.doc()})
    });
    json!({
        "tasks": Task::all().iter().map(task).collect::<Vec<_>>(),
        "settings": shared,
        "channels": channels,
        "tactile_channels": tactile.collect::<Vec<_>>(),
        "shapes": Shape::kinds().iter().map(kind).collect::<Vec<_>>(),
        "press_errors": Error::KINDS,
        "endings": Ending::ALL.map(|e| json!({"name": e.name(), "is_rule": e.is_of_the_task()})),
    })
}

fn kind(shape: &Shape) -> Value {
    let (lengths, has_edges) = (numbers(shape), shape.can_be_rounded());
    json!({"name": shape.name(), "lengths": lengths, "has_edges": has_edges})
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
    let settings = config.settings().iter().map(Setting::describe).collect::<Vec<_>>();
    let is_drawn = |quantity: StartQuantity| {
        let setting = quantity.setting();
        setting == "objects" || settings.iter().any(|each| each["name"] == setting)
    };
    let draws = StartQuantity::NAMED.iter().filter(|(_, quantity)| is_drawn(*quantity));
    json!({
        "name": task.name(),
        "doc": task.doc(),
        "max_episode_steps": config.max_episode_steps,
        "terms": terms.collect::<Vec<_>>(),
        "channels": channels,
        "usual_channels": config.channels(),
        "objects": config.objects,
        "settings": settings,
        "others": others(&config),
        "draws": draws.map(|(name, _)| name).collect::<Vec<_>>(),
    })
}

/// Settings that are no numbers with their defaults; entry by entry if they are mappings of
/// numbers.
fn others(config: &TaskConfig) -> Vec<Value> {
    let terms = config.task.terms().iter();
    let weights: Map<_, _> = terms.map(|term| (term.name.into(), term.weight.into())).collect();
    let default = |name| match name {
        "objects" => json!(config.objects),
        "max_episode_steps" => json!(config.max_episode_steps),
        "tactile" => json!(config.tactile),
        "sensor" => json!(config.sensor),
        "material" => json!(config.material),
        "network" => json!(config.network),
        "observation" => json!(config.channels()),
        "sensor_errors" => json!(config.sensor_errors),
        "reward_weights" => json!(weights),
        _ => unreachable!("{name} is a mapping of numbers"),
    };
    let plain = OTHERS.iter().filter_map(|&(name, about)| {
        let [range, doc] = about?;
        Some(
            json!({"name": name, "default": default(name), "range": range, "unit": "", "doc": doc}),
        )
    });
    let TaskConfig { resolution, scene, .. } = config;
    let nodes = [*NODES.start() as f64, *NODES.end() as f64];
    let about = "greatest number of nodes of a pad's mesh";
    let mut all: Vec<_> = plain.collect();
    all.push(entry("resolution.nodes", &json!(resolution.nodes), nodes, "", about));
    all.extend(
        resolution.counts().map(|(name, counts, most, doc)| {
            entry(name, &json!(counts), [1.0, most.into()], "", doc)
        }),
    );
    all.extend(scene.numbers().into_iter().map(
        |scene::BoundedNumber { name, value, bounds, unit, doc }| {
            entry(name, &json!(value), bounds, unit, doc)
        },
    ));
    let corners = [("low", scene.workspace.low), ("high", scene.workspace.high)];
    all.extend(corners.map(|(name, corner)| {
        let doc = format!("{name} corner of the box of the tool centre: x, y, z");
        entry(&format!("workspace.{name}"), &json!(corner), PLACE, "m", &doc)
    }));
    all
}

/// Setting that is a number, or numbers with the same bounds.
fn entry(name: &str, value: &Value, bounds: [f64; 2], unit: &str, doc: &str) -> Value {
    json!({"name": name, "default": value, "bounds": bounds, "unit": unit, "doc": doc})
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
            for other in task["others"].as_array().unwrap() {
                assert!(other.get("range").is_some() != other.get("bounds").is_some(), "{other}");
                assert!(!other["doc"].as_str().unwrap().is_empty(), "{other}");
            }
            assert!(task["terms"].as_array().is_some_and(|terms| !terms.is_empty()), "{task}");
            TaskConfig::from_json(&json!({"task": task["name"]}).to_string()).unwrap();
        }
    }
}
