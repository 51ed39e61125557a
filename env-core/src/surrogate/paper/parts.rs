//! Grasps of a training run: a part for training, and two for evaluation.

use std::collections::BTreeMap;

use crate::dataset::Split;

/// Names of grasps.
pub(super) struct PaperSplit {
    pub(super) train: Vec<String>,
    /// The last grasp of each object that is trained on.
    pub(super) known: Vec<String>,
    /// Grasps of objects that are never trained on.
    pub(super) novel: Vec<String>,
}

impl PaperSplit {
    /// Divides a split whose test part has other objects than its training part; an object with one
    /// grasp is only trained on.
    pub(super) fn of(split: &Split) -> Self {
        let mut objects = BTreeMap::<&str, Vec<&String>>::new();
        for grasp in &split.train {
            let object = grasp.split_once('/').map_or(grasp.as_str(), |(object, _)| object);
            objects.entry(object).or_default().push(grasp);
        }
        let (mut train, mut known) = (Vec::new(), Vec::new());
        for mut grasps in objects.into_values() {
            grasps.sort_unstable();
            if grasps.len() > 1 {
                known.extend(grasps.pop().cloned());
            }
            train.extend(grasps.into_iter().cloned());
        }
        Self { train, known, novel: split.test.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_grasp_of_each_known_object_is_kept_for_judging() {
        let names = |names: &[&str]| names.iter().map(|&n| n.to_owned()).collect::<Vec<_>>();
        let train = names(&["cup/000", "cup/001", "ball/000", "cup/002"]);
        let test = names(&["apple/000"]);
        let parts = PaperSplit::of(&Split { train, validation: Vec::new(), test: test.clone() });
        assert_eq!(parts.train, names(&["ball/000", "cup/000", "cup/001"]));
        assert_eq!(parts.known, names(&["cup/002"]));
        assert_eq!(parts.novel, test);
    }
}
