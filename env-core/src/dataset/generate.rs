//! Parallel solution of all grasps of a configuration, resumable after an interruption.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::{
        Mutex,
        atomic::{AtomicBool, Ordering},
    },
    time::Instant,
};

use rayon::prelude::*;
use serde::Serialize;

use super::{
    config::{DatasetConfig, Scenario},
    file::{self, read, sha256, write_whole},
    job::{GraspJob, Job, is_whole, jobs},
    manifest::{FORMAT, Manifest, Shard, Solved, Unsolved, splits},
    mesh_object::MeshObject,
    plan::{Plan, plans},
    read::claimed,
    record::{Entry, GraspTensors},
    setup::ScenarioBodies,
    tensor::entries,
};
use crate::{Error, Result, interrupt::Interrupt, objects::Object};

/// Progress of a generation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GenerationProgress {
    /// Grasps that are done, including those of earlier runs.
    pub done: usize,
    /// Total number of grasps.
    pub all: usize,
    /// Grasps processed in this run, including those that ended early.
    pub solved: usize,
    /// Frames solved in this run.
    pub frames: usize,
    /// Grasps of this run that ended early.
    pub unsolved: usize,
    /// Wall time of this run (s).
    pub seconds: f64,
    /// Approximate size of the whole dataset (bytes).
    pub bytes: u64,
}

/// Function that returns the reason why a gripper cannot reach a grasp of an object, if there is
/// one.
pub type Obstacle<'a> = dyn Fn(&Object, &Plan) -> Result<Option<String>> + Sync + 'a;

/// Options of a run.
#[derive(Clone, Copy, Default)]
pub struct Orders<'a> {
    /// Commit of this library, for the manifest.
    pub commit: &'a str,
    /// Check of every grasp before it is solved; one that cannot be reached is listed as unsolved.
    /// The model of the gripper is supplied by the caller.
    pub obstacle: Option<&'a Obstacle<'a>>,
    /// Number of threads; 0 uses one per core.
    pub threads: usize,
    /// Shards to make, by their names from [`shards`]; `None` makes all, and the manifest.
    pub only: Option<&'a [String]>,
    /// Request to stop at once; the grasps being solved are then solved anew by the next run.
    pub interrupt: Option<&'a Interrupt>,
}

/// Size and cost of a dataset, or of what is missing of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Grasps to solve.
    pub grasps: usize,
    /// Most frames of these grasps.
    pub frames: usize,
    /// Approximate size of these frames (bytes).
    pub bytes: u64,
    /// Approximate processor time (s).
    pub seconds: f64,
}

/// Processor time of a frame of one soft body of 2,000 nodes (s), the power of the number of nodes
/// with which it grows (both from `tests/reports/dataset.md`), and the factor of the number of
/// nodes with which quadratic elements cost as much as linear ones (400 presses of 850 nodes take
/// 5,400 s).
const FRAME: f64 = 1.25;
const NODES: f64 = 2000.0;
const POWER: f64 = 1.4;
const QUADRATIC: f64 = 3.2;

/// Estimates what [`generate`] with this `config` has to do in `folder`, which need not exist.
pub fn estimate(config: &DatasetConfig, folder: &Path) -> Result<Estimate> {
    let config = config.clone().validated()?;
    let plans = plans(&config)?;
    let jobs = jobs(&plans);
    let objects: Vec<_> = plans.iter().map(|(object, _)| object).collect();
    let setup = ScenarioBodies::new(&config, &objects, false)?;
    let open = jobs.iter().filter(|job| !is_whole(&folder.join(&job.file)));
    let grasps: usize = open.map(|job| job.missing(folder).len()).sum();
    let frames = grasps * config.most_frames();
    let factor = if config.truth_element == "p2" { QUADRATIC } else { 1.0 };
    let pair = config.scenario == Scenario::Pads || config.truth_linear_nodes > 0;
    let bodies = if pair { 2.0 } else { 1.0 };
    let frame = bodies * FRAME * (factor * config.truth_nodes as f64 / NODES).powf(POWER);
    Ok(Estimate {
        grasps,
        frames,
        bytes: frames as u64 * setup.bytes_a_frame(),
        seconds: frames as f64 * frame,
    })
}

/// Names of the shards of the dataset of `config`.
pub fn shards(config: &DatasetConfig) -> Result<Vec<String>> {
    let plans = plans(&config.clone().validated()?)?;
    Ok(jobs(&plans).into_iter().map(|job| job.file).collect())
}

/// Generates the dataset of `config` in `folder`, or the missing part of it.
///
/// `watch` is called before the first grasp and after each; if it returns `false` the run stops,
/// and the next call continues it. Returns the manifest, or `None` if stopped or if only some
/// shards were asked for. Returns an error for an invalid configuration, a folder that holds
/// another dataset, a shard that is not part of it, or a full disk.
pub fn generate(
    config: &DatasetConfig,
    folder: &Path,
    orders: &Orders,
    watch: &(dyn Fn(&GenerationProgress) -> bool + Sync),
) -> Result<Option<Manifest>> {
    let config = config.clone().validated()?;
    let plans = plans(&config)?;
    let is_claimed = is_claimed(&config, folder)?;
    let jobs = jobs(&plans);
    let chosen = choose(&jobs, orders.only)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(orders.threads).build();
    let pool =
        pool.map_err(|error| Error::invalid("threads", orders.threads, error.to_string()))?;
    let objects: Vec<_> = plans.iter().map(|(object, _)| object).collect();
    let setup = pool.install(|| ScenarioBodies::new(&config, &objects, true))?;
    // Only now: a configuration whose bodies cannot be built would refuse the one that is mended.
    config.meshes.iter().try_for_each(|mesh| mesh.keep(folder))?;
    if !is_claimed {
        write_whole(&folder.join("config.json"), Claim::text(&config).as_bytes())?;
    }
    setup.keep(folder)?;
    let (packed, open): (Vec<&Job>, Vec<&Job>) =
        chosen.into_iter().partition(|job| is_whole(&folder.join(&job.file)));
    let tasks: Vec<_> = open.iter().flat_map(|job| job.missing(folder)).collect();
    let count = |jobs: &[&Job]| jobs.iter().map(|job| job.plans.len()).sum::<usize>();
    let all = count(&packed) + count(&open);
    let bytes = all as u64 * config.most_frames() as u64 * setup.bytes_a_frame();
    let progress =
        GenerationProgress { done: all - tasks.len(), all, bytes, ..GenerationProgress::default() };
    let work = Work {
        config: &config,
        setup: &setup,
        folder,
        obstacle: orders.obstacle,
        watch,
        interrupt: orders.interrupt.cloned().unwrap_or_default(),
        clock: Instant::now(),
        progress: Mutex::new(progress),
        stopped: AtomicBool::new(!watch(&progress)),
    };
    open.iter().try_for_each(|job| work.pack_if_complete(job))?;
    pool.install(|| tasks.par_iter().try_for_each(|task| work.solve(task)))?;
    if work.is_stopped() || orders.only.is_some() {
        return Ok(None);
    }
    let manifest = summary(&config, orders, &plans, &jobs, folder)?;
    let text = serde_json::to_string_pretty(&manifest).expect("plain data");
    write_whole(&folder.join("manifest.json"), text.as_bytes())?;
    // A run that was killed may have left parts of shards that it had just packed.
    let parts = folder.join("parts");
    fs::remove_dir_all(&parts).map_err(|error| Error::file(&parts, error))?;
    Ok(Some(manifest))
}

fn choose<'a>(jobs: &'a [Job<'a>], only: Option<&[String]>) -> Result<Vec<&'a Job<'a>>> {
    let Some(names) = only else { return Ok(jobs.iter().collect()) };
    let find = |name: &String| {
        let job = jobs.iter().find(|job| job.file == *name);
        job.ok_or_else(|| Error::invalid("shard", name, format!("one of {} names", jobs.len())))
    };
    names.iter().map(find).collect()
}

/// Contents of `config.json`, which identifies the dataset in a folder.
#[derive(Serialize)]
struct Claim<'a> {
    format: u32,
    #[serde(flatten)]
    config: &'a DatasetConfig,
}

impl Claim<'_> {
    fn text(config: &DatasetConfig) -> String {
        let claim = Claim { format: FORMAT, config: &config.stored() };
        serde_json::to_string_pretty(&claim).expect("plain data")
    }
}

/// Creates the folder with its subfolders if missing, and returns whether the dataset of `config`
/// lies there; an error if another one does.
fn is_claimed(config: &DatasetConfig, folder: &Path) -> Result<bool> {
    for name in ["shards", "parts", "meshes"] {
        let path = folder.join(name);
        fs::create_dir_all(&path).map_err(|error| Error::file(&path, error))?;
    }
    let path = folder.join("config.json");
    let Some(found) = file::text(&path)? else { return Ok(false) };
    if found == Claim::text(config) {
        return Ok(true);
    }
    let reason = if !found.contains(&format!("\"format\": {FORMAT},")) {
        format!("a dataset of another format lies here, expected format {FORMAT} or no folder")
    } else if let Some(mesh) = changed(config, &found) {
        format!("a dataset with another {mesh} lies here, expected that mesh or no folder")
    } else {
        "another dataset lies here, expected this configuration or no folder".to_owned()
    };
    Err(Error::file(&path, reason))
}

/// Path of a mesh of `config` that has another content in a stored configuration, if there is one.
fn changed<'a>(config: &'a DatasetConfig, stored: &str) -> Option<&'a str> {
    let before = claimed(stored).ok()?.meshes;
    let differs = |mesh: &&MeshObject| {
        before.iter().any(|old| old.name() == mesh.name() && old.sha256 != mesh.sha256)
    };
    config.meshes.iter().find(differs).map(|mesh| mesh.mesh.as_str())
}

/// Run over the missing grasps.
struct Work<'a> {
    config: &'a DatasetConfig,
    setup: &'a ScenarioBodies,
    folder: &'a Path,
    obstacle: Option<&'a Obstacle<'a>>,
    watch: &'a (dyn Fn(&GenerationProgress) -> bool + Sync),
    interrupt: Interrupt,
    clock: Instant,
    progress: Mutex<GenerationProgress>,
    stopped: AtomicBool,
}

impl Work<'_> {
    /// Solves a grasp and stores it, unless stopped; after the last one of a shard, packs the
    /// shard.
    fn solve(&self, task: &GraspJob) -> Result<()> {
        if self.is_stopped() {
            return Ok(());
        }
        let (object, plan) = (task.job.object, task.plan);
        let obstacle = self.obstacle.map(|obstacle| obstacle(object, plan)).transpose()?.flatten();
        let part = if let Some(reason) = obstacle {
            GraspTensors::unreached(plan, reason)
        } else {
            let solve = || self.setup.solve(self.config, object, plan);
            let part = self.interrupt.during(solve)?;
            if self.interrupt.is_requested() {
                return Ok(());
            }
            part
        };
        write_whole(&self.folder.join(&task.part), &part.to_bytes())?;
        let Entry { frames, error, .. } = &part.entries[0];
        self.report(*frames, error.is_some());
        task.job.missing.fetch_sub(1, Ordering::AcqRel);
        self.pack_if_complete(task.job)
    }

    fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed) || self.interrupt.is_requested()
    }

    /// Packs a shard if all of its parts exist and no other thread packs it.
    fn pack_if_complete(&self, job: &Job) -> Result<()> {
        let complete = job.missing.load(Ordering::Acquire) == 0;
        if complete && !job.packed.swap(true, Ordering::AcqRel) {
            job.pack(self.folder)?;
        }
        Ok(())
    }

    fn report(&self, frames: usize, unsolved: bool) {
        let mut progress = self.progress.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        progress.done += 1;
        progress.solved += 1;
        progress.frames += frames;
        progress.unsolved += usize::from(unsolved);
        progress.seconds = self.clock.elapsed().as_secs_f64();
        if !(self.watch)(&progress) {
            self.stopped.store(true, Ordering::Relaxed);
        }
    }
}

/// Reads back every shard and returns the manifest.
fn summary(
    config: &DatasetConfig,
    orders: &Orders,
    plans: &[(Object, Vec<Plan>)],
    jobs: &[Job],
    folder: &Path,
) -> Result<Manifest> {
    let (mut shards, mut unsolved) = (Vec::new(), Vec::new());
    for job in jobs {
        let path: PathBuf = folder.join(&job.file);
        let bytes = read(&path)?;
        let mut grasps = Vec::new();
        for Entry { plan, frames, error } in entries(&path, &bytes)? {
            let name = plan.name;
            unsolved.extend(error.map(|error| Unsolved { name: name.clone(), frames, error }));
            if frames > 0 {
                grasps.push(Solved { name, gel: plan.gel, frames });
            }
        }
        let sha256 = sha256(&bytes);
        let file = job.file.clone();
        shards.push(Shard { file, sha256, bytes: bytes.len() as u64, grasps });
    }
    let there = |object: &Object| {
        let all = shards.iter().flat_map(|shard| &shard.grasps);
        let own = all.filter(|grasp| grasp.name.split('/').next() == Some(&object.name));
        own.map(|grasp| grasp.name.clone()).collect::<Vec<_>>()
    };
    let by_object: Vec<_> = plans.iter().map(|(o, _)| (o.clone(), there(o))).collect();
    let short = plans.iter().filter(|(object, plans)| plans.len() < config.grasps_of(object));
    Ok(Manifest {
        format: FORMAT,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: orders.commit.to_owned(),
        config: config.stored(),
        approached: orders.obstacle.is_some(),
        short: short.map(|(object, plans)| (object.name.clone(), plans.len())).collect(),
        splits: splits(config, &by_object),
        shards,
        unsolved,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configuration_that_cannot_be_read_is_not_overwritten() {
        let folder = std::env::temp_dir().join(format!("ruffini-claim-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let (path, config) = (folder.join("config.json"), DatasetConfig::default());
        // Not UTF-8.
        fs::write(&path, [0xff]).unwrap();
        let generated = generate(&config, &folder, &Orders::default(), &|_| false);
        assert!(matches!(generated, Err(Error::File { .. })));
        assert_eq!(fs::read(&path).unwrap(), [0xff]);
        fs::remove_file(&path).unwrap();
        assert!(!is_claimed(&config, &folder).unwrap());
        fs::write(&path, Claim::text(&config)).unwrap();
        assert!(is_claimed(&config, &folder).unwrap());
        fs::remove_dir_all(&folder).unwrap();
    }
}
