//! Solves all grasps of a configuration, in parallel, and resumes where it was stopped.

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
use sha2::{Digest, Sha256};

use super::{
    config::{Config, Gel, Pads, SHARD},
    manifest::{Manifest, Shard, Solved, Unsolved, splits},
    plan::{Plan, plans},
    ramp::Ramp,
    record::{Entry, Shard as Filling, entries, write_mesh, write_whole},
};
use crate::{Error, Result, geometry::Transfer, objects::Object};

/// How far a generation has come.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// Grasps that are done, those of an earlier run included.
    pub done: usize,
    /// Grasps to do.
    pub all: usize,
    /// Grasps gone through in this run, those that ended early included.
    pub solved: usize,
    /// Frames solved in this run.
    pub frames: usize,
    /// Grasps of this run that ended early.
    pub unsolved: usize,
    /// Wall time of this run (s).
    pub seconds: f64,
    /// About the size of the whole dataset (bytes).
    pub bytes: u64,
}

/// A file to be filled.
struct Job<'a> {
    file: String,
    object: &'a Object,
    plans: &'a [Plan],
}

/// Makes the dataset of `config` in `folder` with `threads` threads, or what is missing of it.
///
/// `watch` is called before the first grasp and after each; false stops, and the next call goes on.
/// Returns the manifest, or `None` if stopped. Errors: a configuration that makes no sense, a folder
/// that holds another dataset, a disk that is full.
pub fn generate(
    config: &Config,
    folder: &Path,
    commit: &str,
    threads: usize,
    watch: &(dyn Fn(&Progress) -> bool + Sync),
) -> Result<Option<Manifest>> {
    let config = config.clone().validated()?;
    claim(&config, folder)?;
    let plans = plans(&config)?;
    let jobs = jobs(&plans);
    let missing: Vec<_> = jobs.iter().filter(|job| !is_whole(&folder.join(&job.file))).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| Error::invalid("threads", threads, error.to_string()))?;
    let pads = |gel: &Gel| {
        let pads = gel.pads(&config)?;
        let transfer = Transfer::new(pads.truth.body().mesh(), &pads.model.mesh)?;
        Ok((pads, transfer))
    };
    let gels = pool.install(|| config.gels.par_iter().map(pads).collect::<Result<Vec<_>>>())?;
    for (number, (pads, _)) in gels.iter().enumerate() {
        write_mesh(&folder.join(format!("gels/{number}.safetensors")), pads)?;
    }
    let count = |jobs: &[&Job]| jobs.iter().map(|job| job.plans.len()).sum::<usize>();
    let all = count(&jobs.iter().collect::<Vec<_>>());
    let bytes = all as u64 * config.frames as u64 * bytes_a_frame(&gels[0].0);
    let progress = Progress { done: all - count(&missing), all, bytes, ..Progress::default() };
    let work = Work {
        config: &config,
        gels: &gels,
        folder,
        watch,
        clock: Instant::now(),
        progress: Mutex::new(progress),
        stopped: AtomicBool::new(!watch(&progress)),
    };
    pool.install(|| missing.par_iter().try_for_each(|job| work.fill(job)))?;
    if work.stopped.load(Ordering::Relaxed) {
        return Ok(None);
    }
    let manifest = summary(&config, commit, &plans, &jobs, folder)?;
    let text = serde_json::to_string_pretty(&manifest).expect("plain data");
    write_whole(&folder.join("manifest.json"), text.as_bytes())?;
    Ok(Some(manifest))
}

/// Makes the folder and writes the configuration into it, or checks that it is the one there.
fn claim(config: &Config, folder: &Path) -> Result<()> {
    let failed = |path: &Path| {
        let path = path.display().to_string();
        move |error: std::io::Error| Error::File { path, reason: error.to_string() }
    };
    for name in ["shards", "gels"] {
        let path = folder.join(name);
        fs::create_dir_all(&path).map_err(failed(&path))?;
    }
    let path = folder.join("config.json");
    let text = serde_json::to_string_pretty(config).expect("plain data");
    match fs::read_to_string(&path) {
        Ok(found) if found == text => Ok(()),
        Ok(_) => Err(Error::File {
            path: path.display().to_string(),
            reason: "another dataset lies here, expected this configuration or no folder".into(),
        }),
        Err(_) => write_whole(&path, text.as_bytes()),
    }
}

fn jobs(plans: &[(Object, Vec<Plan>)]) -> Vec<Job<'_>> {
    let mut jobs = Vec::new();
    for (object, plans) in plans {
        for (i, plans) in plans.chunks(SHARD).enumerate() {
            let file = format!("shards/{}-{i:03}.safetensors", object.name);
            jobs.push(Job { file, object, plans });
        }
    }
    jobs
}

fn is_whole(path: &Path) -> bool {
    fs::read(path).is_ok_and(|bytes| entries(path, &bytes).is_ok())
}

/// About the bytes of a frame of two pads: fields, and the anchors of the tenth of the contact points
/// that touch on average.
fn bytes_a_frame(pads: &Pads) -> u64 {
    let mesh = &pads.model.mesh;
    let anchors = pads.truth.contact_points().len() / 10;
    2 * (24 * mesh.vertices.len() + 4 * mesh.tets.len() + 48 * anchors + 200) as u64
}

/// A run on the shards that are missing.
struct Work<'a> {
    config: &'a Config,
    gels: &'a [(Pads, Transfer)],
    folder: &'a Path,
    watch: &'a (dyn Fn(&Progress) -> bool + Sync),
    clock: Instant,
    progress: Mutex<Progress>,
    stopped: AtomicBool,
}

impl Work<'_> {
    /// Solves the grasps of a shard and writes it, unless stopped.
    fn fill(&self, job: &Job) -> Result<()> {
        let object = job.object.shape.clone().validated()?;
        let mut shard = Filling::default();
        for plan in job.plans {
            if self.stopped.load(Ordering::Relaxed) {
                return Ok(());
            }
            let (pads, transfer) = &self.gels[plan.gel];
            let depth = self.config.depth * pads.sensor.outline.thickness;
            let ramp = Ramp { frames: self.config.frames, depth };
            let (frames, error) = ramp.solve(plan, &object, &pads.truth);
            let error = error.map(|error| error.to_string());
            self.report(frames.len(), error.is_some());
            let entry = Entry { plan: plan.clone(), frames: frames.len(), error };
            shard.add(entry, &frames, pads, transfer);
        }
        shard.write(&self.folder.join(&job.file))
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

/// Reads back every shard.
fn summary(
    config: &Config,
    commit: &str,
    plans: &[(Object, Vec<Plan>)],
    jobs: &[Job],
    folder: &Path,
) -> Result<Manifest> {
    let (mut shards, mut unsolved) = (Vec::new(), Vec::new());
    for job in jobs {
        let path: PathBuf = folder.join(&job.file);
        let failed = |error: std::io::Error| Error::File {
            path: path.display().to_string(),
            reason: error.to_string(),
        };
        let bytes = fs::read(&path).map_err(failed)?;
        let mut grasps = Vec::new();
        for Entry { plan, frames, error } in entries(&path, &bytes)? {
            let name = plan.name;
            unsolved.extend(error.map(|error| Unsolved { name: name.clone(), frames, error }));
            if frames > 0 {
                grasps.push(Solved { name, gel: plan.gel, frames });
            }
        }
        let sha256 = hex(&Sha256::digest(&bytes));
        let file = job.file.clone();
        shards.push(Shard { file, sha256, bytes: bytes.len() as u64, grasps });
    }
    let there = |object: &Object| {
        let all = shards.iter().flat_map(|shard| &shard.grasps);
        let own = all.filter(|grasp| grasp.name.split('/').next() == Some(&object.name));
        own.map(|grasp| grasp.name.clone()).collect::<Vec<_>>()
    };
    let by_object: Vec<_> = plans.iter().map(|(o, _)| (o.clone(), there(o))).collect();
    let short = plans.iter().filter(|(_, plans)| plans.len() < config.grasps);
    Ok(Manifest {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: commit.to_owned(),
        config: config.clone(),
        short: short.map(|(object, plans)| (object.name.clone(), plans.len())).collect(),
        splits: splits(&by_object),
        shards,
        unsolved,
    })
}

fn hex(bytes: &[u8]) -> String {
    let digit = |value: u8| char::from_digit(value.into(), 16).expect("half a byte is a digit");
    bytes.iter().flat_map(|byte| [digit(byte >> 4), digit(byte & 15)]).collect()
}
