//! Shards to be filled, and the grasps missing from them.

use std::{
    fs,
    path::Path,
    sync::atomic::{AtomicBool, AtomicUsize, Ordering},
};

use super::{
    file::{read, write_whole},
    plan::Plan,
    record::GraspTensors,
    tensor::{Tensors, entries},
};
use crate::{Result, objects::Object};

/// Number of grasps in a shard.
const SHARD: usize = 10;

/// Shard to be filled.
pub(super) struct Job<'a> {
    /// Path within the dataset.
    pub(super) file: String,
    pub(super) object: &'a Object,
    pub(super) plans: &'a [Plan],
    /// Number of grasps not stored yet, for a shard that is not packed.
    pub(super) missing: AtomicUsize,
    /// `true` if it is packed or being packed.
    pub(super) packed: AtomicBool,
}

/// Grasp to be solved and stored.
pub(super) struct GraspJob<'a> {
    pub(super) job: &'a Job<'a>,
    pub(super) plan: &'a Plan,
    /// Path within the dataset where it is stored until its shard is complete.
    pub(super) part: String,
}

/// Shards of all objects, in order.
pub(super) fn jobs(plans: &[(Object, Vec<Plan>)]) -> Vec<Job<'_>> {
    let mut jobs = Vec::new();
    for (object, plans) in plans {
        for (i, plans) in plans.chunks(SHARD).enumerate() {
            let file = format!("shards/{}-{i:03}.safetensors", object.name);
            let (missing, packed) = (AtomicUsize::new(plans.len()), AtomicBool::new(false));
            jobs.push(Job { file, object, plans, missing, packed });
        }
    }
    jobs
}

/// Returns whether a shard or part exists and is readable.
pub(super) fn is_whole(path: &Path) -> bool {
    read(path).is_ok_and(|bytes| entries::<serde::de::IgnoredAny>(path, &bytes).is_ok())
}

impl Job<'_> {
    /// Grasps not stored in `folder` yet; also records their number.
    pub(super) fn missing(&self, folder: &Path) -> Vec<GraspJob<'_>> {
        let tasks = self.plans.iter().map(|plan| GraspJob { job: self, plan, part: part(plan) });
        let missing: Vec<_> = tasks.filter(|task| !is_whole(&folder.join(&task.part))).collect();
        self.missing.store(missing.len(), Ordering::Release);
        missing
    }

    /// Writes the shard from its parts and removes them.
    pub(super) fn pack(&self, folder: &Path) -> Result<()> {
        let mut shard = GraspTensors { tensors: Vec::new(), entries: Vec::new() };
        for plan in self.plans {
            let Tensors { tensors, entries } = GraspTensors::read(&folder.join(part(plan)))?;
            shard.tensors.extend(tensors);
            shard.entries.extend(entries);
        }
        write_whole(&folder.join(&self.file), &shard.to_bytes())?;
        for plan in self.plans {
            // A part that cannot be removed here is removed when the dataset is finished.
            let _ = fs::remove_file(folder.join(part(plan)));
        }
        Ok(())
    }
}

fn part(plan: &Plan) -> String {
    format!("parts/{}.safetensors", plan.name.replace('/', "-"))
}
