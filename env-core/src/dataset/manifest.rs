//! Contents of a finished dataset: shards with their hashes, unsolved grasps, splits.

use std::collections::{BTreeMap, HashSet};

use serde::{Deserialize, Serialize};

use super::config::{DatasetConfig, Scenario};
use crate::objects::{self, Object};

/// Version of the files of a dataset. Version 1 (not stated in its files) stores anchors as two
/// positions in 64 bits each; version 2 stores the index of the contact point and one position in
/// 32 bits.
pub const FORMAT: u32 = 2;

/// Description of a finished dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of its files: [`FORMAT`].
    pub format: u32,
    /// Version of this library.
    pub version: String,
    /// Commit that the library was built from, or empty.
    pub commit: String,
    /// Configuration of the dataset.
    pub config: DatasetConfig,
    /// `true` if every grasp was checked to be reachable by a gripper before it was solved.
    #[serde(default)]
    pub approached: bool,
    /// Shards in the order of the catalogue.
    pub shards: Vec<Shard>,
    /// Grasps that ended early, with the number of frames solved before.
    pub unsolved: Vec<Unsolved>,
    /// Objects with fewer antipodal grasps than asked for, with their number of grasps.
    pub short: BTreeMap<String, usize>,
    /// Names of grasps by split.
    pub splits: BTreeMap<String, Split>,
}

/// File of grasps of one object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shard {
    /// Path within the dataset.
    pub file: String,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Size of the file (bytes).
    pub bytes: u64,
    /// Grasps with at least one frame.
    pub grasps: Vec<Solved>,
}

/// Grasp in a shard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Solved {
    /// Name of the object and number of the grasp.
    pub name: String,
    /// Index of the gel in the configuration.
    pub gel: usize,
    /// Number of frames.
    pub frames: usize,
}

/// Grasp that ended with an error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unsolved {
    /// Name of the object and number of the grasp.
    pub name: String,
    /// Number of frames solved before.
    pub frames: usize,
    /// Message of the error.
    pub error: String,
}

/// Grasps for training, validation and test.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Split {
    /// Grasps for training.
    pub train: Vec<String>,
    /// Grasps for model selection.
    pub validation: Vec<String>,
    /// Grasps for the test.
    pub test: Vec<String>,
}

/// Families left out of `novel-12`: each has one member, and the two differ most from all known
/// families. The paper does not state which two of its fourteen it leaves out.
const FARTHEST: [objects::Family; 2] = [objects::Family::HollowLemon, objects::Family::Cucumber];

/// Splits of `grasps`, which are given by object in the order of the catalogue.
/// `known-1`, `known-10` and `known-63` test on held-out grasps of known objects: of ten grasps the
/// last is for the test and the one before it for validation; of fewer likewise. `novel-14` and
/// `novel-12` test on objects of families that do not occur in training.
///
/// Of drawn indenters, every tenth is for the test of the split `presses`, and the one before it
/// for validation. Of meshes of one's own, presses are divided as grasps are.
///
/// With such meshes, `meshes` trains on the other objects and tests on all grasps of the meshes.
pub(super) fn splits(
    config: &DatasetConfig,
    grasps: &[(Object, Vec<String>)],
) -> BTreeMap<String, Split> {
    let planned = |object: &Object| config.grasps_of(object);
    let (mut splits, all) = match config.scenario {
        Scenario::Pads | Scenario::Soft => (of_grasps(grasps, planned), "known-63"),
        Scenario::Presses => {
            ([("presses".to_owned(), of_presses(grasps, planned))].into(), "presses")
        }
    };
    if !config.meshes.is_empty() {
        let unseen = unseen(splits[all].clone(), grasps);
        splits.insert("meshes".to_owned(), unseen);
    }
    splits
}

/// Moves the grasps of meshes in `split` to the test part, those of the others in it to training.
fn unseen(split: Split, grasps: &[(Object, Vec<String>)]) -> Split {
    let own = grasps.iter().filter(|(object, _)| object.family.is_none());
    let test: Vec<String> = own.flat_map(|(_, names)| names.clone()).collect();
    let Split { mut train, mut validation, test: drawn } = split;
    train.extend(drawn);
    let own: HashSet<&String> = test.iter().collect();
    for part in [&mut train, &mut validation] {
        part.retain(|name| !own.contains(name));
    }
    Split { train, validation, test }
}

fn of_presses(presses: &[(Object, Vec<String>)], planned: impl Fn(&Object) -> usize) -> Split {
    let mut split = Split::default();
    for (object, names) in presses {
        if object.family.is_none() {
            split.divide(names, planned(object));
            continue;
        }
        let number: usize =
            object.name.rsplit('-').next().and_then(|n| n.parse().ok()).unwrap_or(0);
        match number % 10 {
            9 => split.test.extend(names.clone()),
            8 => split.validation.extend(names.clone()),
            _ => split.train.extend(names.clone()),
        }
    }
    split
}

impl Split {
    /// Adds the grasps of an object: of ten, or of all that are `planned` if they are fewer, the
    /// last to the test part and the one before it to validation.
    fn divide(&mut self, names: &[String], planned: usize) {
        let last = planned.min(10);
        for name in names {
            let part = match last - number(name) % last {
                1 if last > 1 => &mut self.test,
                2 if last > 2 => &mut self.validation,
                _ => &mut self.train,
            };
            part.push(name.clone());
        }
    }
}

fn of_grasps(
    grasps: &[(Object, Vec<String>)],
    planned: impl Fn(&Object) -> usize,
) -> BTreeMap<String, Split> {
    let of = |chosen: &[&(Object, Vec<String>)]| {
        let mut split = Split::default();
        for (object, names) in chosen {
            split.divide(names, planned(object));
        }
        split
    };
    let known: Vec<_> =
        grasps.iter().filter(|(o, _)| o.split == objects::FamilySplit::Train).collect();
    let novel = grasps.iter().filter(|(o, _)| o.split == objects::FamilySplit::Novel);
    let ten: Vec<_> =
        (0..known.len().min(10)).map(|i| known[i * known.len() / known.len().min(10)]).collect();
    let judged = |left_out: &[objects::Family]| {
        let Split { mut train, validation, test } = of(&known);
        train.extend(test);
        let left_out = |o: &Object| o.family.is_some_and(|family| left_out.contains(&family));
        let kept = novel.clone().filter(|(o, _)| !left_out(o));
        Split { train, validation, test: kept.flat_map(|(_, names)| names.clone()).collect() }
    };
    let splits = [
        ("known-1", of(&known[..known.len().min(1)])),
        ("known-10", of(&ten)),
        ("known-63", of(&grasps.iter().collect::<Vec<_>>())),
        ("novel-14", judged(&[])),
        ("novel-12", judged(&FARTHEST)),
    ];
    splits.into_iter().map(|(name, split)| (name.to_owned(), split)).collect()
}

/// Number of the grasp called `name`, such as 7 of `cup-2/007`.
fn number(name: &str) -> usize {
    let digits = name.rsplit('/').next().unwrap_or_default();
    digits.parse().expect("a plan names its grasp by its number")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::objects::catalogue;

    fn grasps(count: usize) -> Vec<(Object, Vec<String>)> {
        let names = |o: &Object| (0..count).map(|i| format!("{}/{i:03}", o.name)).collect();
        catalogue(0).into_iter().take(63).map(|o| (o.clone(), names(&o))).collect()
    }

    #[test]
    fn no_grasp_is_in_two_parts_of_a_split() {
        for (name, Split { train, validation, test }) in of_grasps(&grasps(20), |_| 20) {
            let all: Vec<_> = [&train, &validation, &test].into_iter().flatten().collect();
            let distinct: BTreeSet<_> = all.iter().collect();
            assert_eq!(all.len(), distinct.len(), "{name} repeats a grasp");
            assert!(!train.is_empty() && !validation.is_empty() && !test.is_empty(), "{name}");
        }
    }

    #[test]
    fn three_grasps_of_an_object_make_every_part_of_a_split() {
        for planned in 1..30 {
            for (name, Split { train, validation, test }) in
                of_grasps(&grasps(planned), |_| planned)
            {
                let least = if name.starts_with("novel") { 1 } else { 2 };
                let found = [train, validation, test].map(|part| !part.is_empty());
                let expected = [true, planned > 2, planned >= least];
                assert_eq!(found, expected, "{name} of {planned} grasps an object");
            }
        }
    }

    #[test]
    fn a_grasp_that_is_missing_moves_no_other_to_another_part() {
        let (all, mut fewer) = (grasps(10), grasps(10));
        fewer[0].1.remove(3);
        let (all, fewer) = (of_grasps(&all, |_| 10), of_grasps(&fewer, |_| 10));
        for (name, mut split) in all {
            split.train.retain(|grasp| *grasp != "prism-1/003");
            assert_eq!(split, fewer[&name], "{name}");
        }
    }

    #[test]
    fn no_object_or_family_leaks_into_the_novel_ones() {
        let grasps = grasps(20);
        let family = |grasp: &String| {
            let object = grasp.split('/').next().unwrap();
            grasps.iter().find(|(o, _)| o.name == object).unwrap().0.family
        };
        let splits = of_grasps(&grasps, |_| 20);
        for (name, objects) in [("novel-14", 14), ("novel-12", 12)] {
            let Split { train, validation, test } = &splits[name];
            let seen: BTreeSet<_> = train.iter().chain(validation).map(family).collect();
            let judged: BTreeSet<_> = test.iter().map(family).collect();
            assert!(seen.is_disjoint(&judged), "{name}: {seen:?} and {judged:?}");
            assert_eq!(test.len(), 20 * objects, "{name}");
        }
        let objects = |name: &str| {
            let all = [&splits[name].train, &splits[name].test].into_iter().flatten();
            all.map(|g| g.split('/').next().unwrap()).collect::<BTreeSet<_>>().len()
        };
        assert_eq!(["known-1", "known-10", "known-63"].map(objects), [1, 10, 63]);
    }

    #[test]
    fn meshes_are_divided_by_grasp_and_are_the_test_of_a_split_of_their_own() {
        let mut all = grasps(1);
        let mug = Object { name: "mug-1".to_owned(), family: None, ..all[0].0.clone() };
        all.push((mug, (0..10).map(|i| format!("mug-1/{i:03}")).collect()));
        let mesh = |grasps| {
            let own = format!(r#"{{"mesh": "mug.obj", "grasps": {grasps}}}"#);
            serde_json::from_str(&own).unwrap()
        };
        for (scenario, among) in [(Scenario::Pads, "known-63"), (Scenario::Presses, "presses")] {
            let meshes = vec![mesh(10)];
            let config = DatasetConfig { scenario, grasps: 1, meshes, ..DatasetConfig::default() };
            let splits = splits(&config, &all);
            let parts = |name: &str| {
                let Split { train, validation, test } = &splits[name];
                [train, validation, test].map(|part| {
                    let own = part.iter().filter(|grasp| grasp.starts_with("mug-1/")).count();
                    [own, part.len() - own]
                })
            };
            assert_eq!(parts(among).map(|[own, _]| own), [8, 1, 1], "{among}");
            let [train, validation, test] = parts("meshes");
            assert_eq!([train[0], validation[0], test[0]], [0, 0, 10]);
            assert_eq!([train[1] + validation[1], test[1]], [63, 0], "drawn ones");
        }
    }
}
