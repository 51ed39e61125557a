//! A training run in a folder: epochs, checkpoints, choice of the best network, weights and card.

use std::{collections::BTreeSet, fs, path::Path, time::Instant};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{
    budget::Pace,
    metrics::{Summary, judge},
    parameters::{Parameters, Vectors},
    train::{Epoch, Network, Trainer, Training},
    weights,
};
use crate::{Error, Result, dataset::write_whole};

/// Progress of a training run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TrainingProgress {
    /// Shards of the dataset have been read, and linear solutions computed.
    Shard {
        /// Number of shards read so far.
        done: usize,
        /// Number of shards in the dataset.
        all: usize,
    },
    /// All samples have been read.
    Samples {
        /// Number of frames to train on.
        train: usize,
        /// Number of frames left out because the linear model failed to solve them.
        lost: usize,
    },
    /// A step of training, or the evaluation of a press, is about to begin.
    Step,
    /// An epoch has ended.
    Epoch {
        /// Results of the epoch.
        epoch: Epoch,
        /// Errors on the validation frames, if there are any.
        validation: Option<Summary>,
        /// Estimated wall time until the end (s).
        left: f64,
    },
}

/// Callback at every step of a training run; stops the run by returning false.
pub(super) type Watch<'a> = &'a mut dyn FnMut(&TrainingProgress) -> bool;

/// Metadata of a checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Checkpoint {
    /// Settings as JSON.
    settings: String,
    /// Fingerprint of the data.
    data: String,
    epoch: usize,
    steps: u64,
    best: Option<f64>,
}

/// Applies `read` to each of `all` shards, in parallel on all threads; returns `None` if `watch`
/// stops it.
pub(super) fn shards<T: Send>(
    all: usize,
    read: impl Fn(usize) -> Result<T> + Sync,
    watch: Watch,
) -> Result<Option<Vec<T>>> {
    let (mut found, some) = (Vec::new(), rayon::current_num_threads());
    for first in (0..all).step_by(some) {
        let last = (first + some).min(all);
        let part: Vec<T> = (first..last).into_par_iter().map(&read).collect::<Result<_>>()?;
        found.extend(part);
        if !watch(&TrainingProgress::Shard { done: last, all }) {
            return Ok(None);
        }
    }
    Ok(Some(found))
}

/// Returns an error if a split has no frames to train on.
pub(super) fn trainable<S>(split: &str, samples: &[S]) -> Result<()> {
    if samples.is_empty() {
        let found = format!("{split} with no frames to train on");
        return Err(Error::invalid("split", found, "a split with frames in the dataset"));
    }
    Ok(())
}

/// Names of the files in the folder of a training run.
const LAST: &str = "last.safetensors";
const BEST: &str = "best.safetensors";
const WEIGHTS: &str = "weights.safetensors";
const CARD: &str = "card.toml";
/// Largest number of parameters of a network, so that a checkpoint, with two moments for each,
/// stays below the size limit for reading.
const MOST: usize = weights::MOST as usize / 16;

/// A training run whose files are in a folder. A run of a given number of epochs writes a
/// checkpoint after each and resumes from it bit for bit; a run of a given duration writes none.
pub(super) struct TrainingRun<'a, N: Network> {
    pub(super) trainer: Trainer<N>,
    out: &'a Path,
    pace: Pace<'a>,
    settings: String,
    data: String,
    best: Option<f64>,
}

impl<'a, N: Network> TrainingRun<'a, N> {
    /// Resumes the run whose checkpoint is in `out`, or creates a new one if there is none.
    ///
    /// Errors: a checkpoint on other data than those of fingerprint `data`, or with other
    /// `settings`.
    pub(super) fn resumed(
        training: Training<N::Config>,
        settings: &impl Serialize,
        data: String,
        pace: Pace<'a>,
        out: &'a Path,
    ) -> Result<Self> {
        fs::create_dir_all(out).map_err(|error| Error::file(out, error))?;
        let settings = serde_json::to_string(settings).expect("plain data");
        let trainer = Trainer::new(training)?;
        let mut run = Self { trainer, out, pace, settings, data, best: None };
        let numbers = run.trainer.parameters.count();
        if numbers > MOST {
            return Err(Error::invalid(
                "network",
                format!("{numbers} numbers"),
                format!("at most {MOST}"),
            ));
        }
        let path = out.join(LAST);
        if !path.exists() {
            return Ok(run);
        }
        let (vectors, found) = checkpoint(&path)?;
        if found.settings != run.settings {
            let reason = format!(
                "its run had other settings, {}: expected those, or another folder",
                differences(&found.settings, &run.settings)
            );
            return Err(Error::file(&path, reason));
        }
        if found.data != run.data {
            let reason = "its run was on other data, expected those, or another folder";
            return Err(Error::file(&path, reason));
        }
        run.trainer.restore(&vectors, found.epoch, found.steps)?;
        run.best = found.best;
        Ok(run)
    }

    /// Trains until the budget is spent and records the best epoch by `validation`; returns false
    /// if `watch` stops it.
    pub(super) fn run(
        &mut self,
        ground: &N::Ground,
        samples: &[N::Sample],
        validation: &[N::Sample],
        watch: Watch,
    ) -> Result<bool> {
        while self.pace.over(self.trainer.epoch) < 1.0 {
            if !self.epoch(ground, samples, validation, watch)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn epoch(
        &mut self,
        ground: &N::Ground,
        samples: &[N::Sample],
        validation: &[N::Sample],
        watch: Watch,
    ) -> Result<bool> {
        let (start, before) = (Instant::now(), self.pace.over(self.trainer.epoch));
        let (pace, mut stopped) = (&self.pace, false);
        let share = &mut |trainer: &Trainer<N>, batches: usize| {
            stopped = !watch(&TrainingProgress::Step);
            Ok(if stopped { None } else { pace.share(trainer.adam.steps, batches) })
        };
        let Some(epoch) = self.trainer.epoch(ground, samples, share)? else {
            return Ok(!stopped);
        };
        let mut validated = None;
        if self.pace.repeats() {
            if !validation.is_empty() {
                let found = Summary::of(&judge(&self.trainer.network, ground, validation)?);
                self.keep_if_best(&found)?;
                validated = Some(found);
            }
            self.write(LAST, &self.trainer.vectors()?, &self.checkpoint())?;
        }
        let over = self.pace.over(self.trainer.epoch);
        let left = start.elapsed().as_secs_f64() * (1.0 - over).max(0.0) / (over - before);
        Ok(watch(&TrainingProgress::Epoch { epoch, validation: validated, left }))
    }

    fn keep_if_best(&mut self, found: &Summary) -> Result<()> {
        let force = found.force.map_or(0.0, |force| force.median);
        let error = found.displacement.median + found.stress.median + force;
        if self.best.is_none_or(|best| error < best) {
            self.best = Some(error);
            self.write(BEST, &self.trainer.parameters.vectors()?, &self.checkpoint())?;
        }
        Ok(())
    }

    fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            settings: self.settings.clone(),
            data: self.data.clone(),
            epoch: self.trainer.epoch,
            steps: self.trainer.adam.steps,
            best: self.best,
        }
    }

    /// Network of the best epoch by validation, or of the last if there was no validation, with its
    /// weights.
    pub(super) fn chosen(&self) -> Result<(N, Vectors)> {
        let vectors = match self.best {
            Some(_) => checkpoint(&self.out.join(BEST))?.0,
            None => self.trainer.parameters.vectors()?,
        };
        let parameters = Parameters::given(vectors.clone())?;
        Ok((N::new(&self.trainer.training.network, &parameters.builder())?, vectors))
    }

    /// Writes the weights and their card.
    pub(super) fn finish(&self, vectors: &Vectors, card: &impl Serialize) -> Result<()> {
        self.write(WEIGHTS, vectors, card)?;
        let text = toml::to_string_pretty(card).expect("plain data");
        write_whole(&self.out.join(CARD), text.as_bytes())
    }

    fn write(&self, name: &str, vectors: &Vectors, card: &impl Serialize) -> Result<()> {
        write_whole(&self.out.join(name), &weights::to_bytes(vectors, card))
    }
}

/// Names the settings that differ between two JSON objects, or two lists of them, with both values.
fn differences(before: &str, now: &str) -> String {
    fn add(place: &str, before: &Value, now: &Value, found: &mut Vec<String>) {
        match (before, now) {
            _ if before == now => {}
            (Value::Object(old), Value::Object(new)) => {
                let names: BTreeSet<_> = old.keys().chain(new.keys()).collect();
                for name in names {
                    let place =
                        if place.is_empty() { name.clone() } else { format!("{place}.{name}") };
                    let of = |object: &Map<String, Value>| object.get(name).cloned();
                    let [old, new] = [old, new].map(|object| of(object).unwrap_or_default());
                    add(&place, &old, &new, found);
                }
            }
            // Several objects at the top, as of networks that keep settings apart.
            (Value::Array(old), Value::Array(new))
                if place.is_empty() && old.len() == new.len() =>
            {
                old.iter().zip(new).for_each(|(old, new)| add(place, old, new, found));
            }
            _ => found.push(format!("{place} {before} (now {now})")),
        }
    }
    let [before, now] = [before, now].map(|text| serde_json::from_str(text).unwrap_or(Value::Null));
    let mut found = Vec::new();
    add("", &before, &now, &mut found);
    found.join(", ")
}

fn checkpoint(path: &Path) -> Result<(Vectors, Checkpoint)> {
    weights::from_bytes(&path.display().to_string(), &weights::read(path)?)
}
