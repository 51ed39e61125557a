//! A training run: samples, epochs, checkpoints, a card.

use std::{fmt::Write as _, fs, path::Path, time::Instant};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::{
    corrector::Corrector,
    metrics::{PressErrors, Summary, judge, judge_linear},
    samples::{Gels, Sample},
    train::{Epoch, Trainer, Training},
    weights::{self, Card, Data, Vectors},
};
use crate::{
    Error, Result,
    dataset::{Dataset, Split, write_whole},
};

/// What a run has come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// A shard of the dataset has been read, its linear answers made where they were missing.
    Shard {
        /// Shards so far.
        done: usize,
        /// Shards of the dataset.
        all: usize,
    },
    /// The samples are there: those to train on, and those that the linear model did not answer.
    Samples {
        /// Frames to train on.
        train: usize,
        /// Frames without a linear answer.
        lost: usize,
    },
    /// A step of training is done.
    Batch,
    /// An epoch is over.
    Epoch {
        /// Errors on its batches.
        epoch: Epoch,
        /// Errors on the validation part, if it has frames.
        validation: Option<Summary>,
        /// Wall time until the last epoch at this pace (s).
        left: f64,
    },
}

/// What a checkpoint says beside its tensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Checkpoint {
    training: Training,
    data: String,
    epoch: usize,
    steps: u64,
    best: Option<f64>,
}

/// Names of the files in a run's folder.
const LAST: &str = "last.safetensors";
const BEST: &str = "best.safetensors";
const WEIGHTS: &str = "weights.safetensors";
const CARD: &str = "card.toml";

/// Trains on the dataset in `data` and writes checkpoints, weights and their card into `out`; goes on
/// from the last checkpoint there. `watch` is called after every epoch; false stops. Returns the card,
/// or `None` if stopped.
///
/// Errors: a dataset that cannot be read, a split without frames, a checkpoint of another run, a
/// gradient that is not finite.
pub fn train(
    data: &Path,
    out: &Path,
    training: &Training,
    trained_by: &str,
    watch: &mut dyn FnMut(&Progress) -> bool,
) -> Result<Option<Card>> {
    let dataset = Dataset::open(data)?;
    let gels = Gels::new(dataset.config(), training.linear_nodes, training.contact)?;
    let split = dataset.split(&training.split)?.clone();
    let parts = [&split.train[..], &split.validation, &split.test];
    let mut go_on = true;
    let ([samples, validation, test], lost) = gels.samples(&dataset, parts, &mut |done, all| {
        go_on = watch(&Progress::Shard { done, all });
        go_on
    })?;
    if !go_on {
        return Ok(None);
    }
    if samples.is_empty() {
        let found = format!("{} with no frames to train on", training.split);
        return Err(Error::invalid("split", found, "a split with frames in the dataset"));
    }
    fs::create_dir_all(out).map_err(|error| Error::file(out, &error))?;
    let fingerprint = fingerprint(&dataset, &split);
    let mut run = Run::resumed(training, out, fingerprint)?;
    go_on = watch(&Progress::Samples { train: samples.len(), lost });
    while go_on && run.trainer.epoch < training.epochs {
        go_on = run.epoch(&gels, &samples, &validation, out, watch)?;
    }
    if run.trainer.epoch < training.epochs {
        return Ok(None);
    }
    let network = run.chosen(out)?;
    let card = run.card(&dataset, &gels, [&samples, &test], &network, trained_by)?;
    write_whole(&out.join(WEIGHTS), &weights::to_bytes(&network.1, &card))?;
    let text = toml::to_string_pretty(&card).expect("plain data");
    write_whole(&out.join(CARD), text.as_bytes())?;
    Ok(Some(card))
}

struct Run {
    trainer: Trainer<Corrector>,
    data: String,
    best: Option<f64>,
}

impl Run {
    /// A new run, or the one whose checkpoint is in `out`.
    fn resumed(training: &Training, out: &Path, data: String) -> Result<Self> {
        let path = out.join(LAST);
        let mut trainer = Trainer::new(training.clone())?;
        if !path.exists() {
            return Ok(Self { trainer, data, best: None });
        }
        let bytes = weights::read(&path)?;
        let (vectors, checkpoint): (_, Checkpoint) =
            weights::from_bytes(&path.display().to_string(), &bytes)?;
        if checkpoint.training != *training || checkpoint.data != data {
            let reason =
                "a run on other data or with other settings, expected this one's checkpoint";
            return Err(Error::file(&path, &reason));
        }
        trainer.restore(&vectors, checkpoint.epoch, checkpoint.steps)?;
        Ok(Self { trainer, data, best: checkpoint.best })
    }

    fn epoch(
        &mut self,
        gels: &Gels,
        samples: &[Sample],
        validation: &[Sample],
        out: &Path,
        watch: &mut dyn FnMut(&Progress) -> bool,
    ) -> Result<bool> {
        let start = Instant::now();
        let mut on = || watch(&Progress::Batch);
        let Some(epoch) = self.trainer.epoch(gels, samples, &mut on)? else { return Ok(false) };
        let judged = || judge(&self.trainer.network, gels, validation);
        let errors = (!validation.is_empty()).then(judged).transpose()?;
        let validation = errors.map(|errors| Summary::of(&errors));
        if let Some(found) = validation {
            let force = found.force.map_or(0.0, |force| force.median);
            let error = found.displacement.median + found.stress.median + force;
            if self.best.is_none_or(|best| error < best) {
                self.best = Some(error);
                let vectors = self.trainer.parameters.vectors()?;
                write_whole(&out.join(BEST), &weights::to_bytes(&vectors, &self.checkpoint()))?;
            }
        }
        let vectors = self.trainer.vectors()?;
        write_whole(&out.join(LAST), &weights::to_bytes(&vectors, &self.checkpoint()))?;
        let rest = (self.trainer.training.epochs - self.trainer.epoch) as f64;
        let left = rest * start.elapsed().as_secs_f64();
        Ok(watch(&Progress::Epoch { epoch, validation, left }))
    }

    fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            training: self.trainer.training.clone(),
            data: self.data.clone(),
            epoch: self.trainer.epoch,
            steps: self.trainer.adam.steps,
            best: self.best,
        }
    }

    /// The weights of the best epoch by validation, or of the last where there was none.
    fn chosen(&self, out: &Path) -> Result<(Corrector, Vectors)> {
        let vectors = if self.best.is_some() {
            let path = out.join(BEST);
            let (vectors, _): (_, Checkpoint) =
                weights::from_bytes(&path.display().to_string(), &weights::read(&path)?)?;
            vectors
        } else {
            self.trainer.parameters.vectors()?
        };
        let parameters = weights::parameters(vectors.clone())?;
        Ok((Corrector::new(&self.trainer.training.network, &parameters.builder())?, vectors))
    }

    fn card(
        &self,
        dataset: &Dataset,
        gels: &Gels,
        [train, test]: [&[Sample]; 2],
        (network, _): &(Corrector, Vectors),
        trained_by: &str,
    ) -> Result<Card> {
        let training = &self.trainer.training;
        let config = dataset.config();
        let amplitudes = train.iter().map(|sample| f64::from(sample.question.amplitude));
        Ok(Card {
            variant: "corrector".to_owned(),
            network: training.network,
            model_nodes: config.model_nodes,
            linear_nodes: training.linear_nodes,
            contact: training.contact,
            training: training.clone(),
            data: Data {
                train: counts(train),
                test: counts(test),
                amplitude: amplitudes.fold(0.0, f64::max),
                ..Data::of(config, self.data.clone(), trained_by)
            },
            test: Summary::of(&judge(network, gels, test)?),
            linear: Summary::of(&judge_linear(gels, test)),
        })
    }
}

/// Grasps and frames.
fn counts(samples: &[Sample]) -> [usize; 2] {
    let mut grasps: Vec<&str> = samples.iter().map(|sample| sample.grasp.as_str()).collect();
    grasps.sort_unstable();
    grasps.dedup();
    [grasps.len(), samples.len()]
}

/// SHA-256 of what a dataset is made of and of the grasps of a split.
pub(super) fn fingerprint(dataset: &Dataset, split: &Split) -> String {
    let text = serde_json::to_string(&(dataset.config(), split)).expect("plain data");
    hex(&Sha256::digest(text))
}

/// Bytes as two digits each.
pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// Errors on one part of a split, press by press with the names of their grasps: the network's and the
/// linear answer's.
pub fn evaluate(
    weights: &Path,
    data: &Path,
    split: &str,
) -> Result<Vec<(String, PressErrors, PressErrors)>> {
    let (vectors, card): (_, Card) =
        weights::of_kind(&weights.display().to_string(), &weights::read(weights)?)?;
    let network = Corrector::new(&card.network, &weights::parameters(vectors)?.builder())?;
    let dataset = Dataset::open(data)?;
    let gels = Gels::new(dataset.config(), card.linear_nodes, card.contact)?;
    let names = &dataset.split(split)?.test;
    let ([samples], _) = gels.samples(&dataset, [names], &mut |_, _| true)?;
    let found = judge(&network, &gels, &samples)?.into_iter().zip(judge_linear(&gels, &samples));
    Ok(samples.iter().zip(found).map(|(s, (net, linear))| (s.grasp.clone(), net, linear)).collect())
}
