//! Training of the soft objects' network, and its card.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{
    network::{Soft, SoftConfig},
    samples::{Objects, Part, SoftSample, squeezing},
};
use crate::{
    Error, Result,
    dataset::{Squeezes, sha256},
    surrogate::{
        Spread, Summary, Training, TrainingProgress,
        budget::{Budget, Pace},
        features::Fields,
        metrics::{errors, judge},
        train::{in_range, scaled},
        training_run::{TrainingRun, Watch},
        weights::{Data, NetworkCard, counts},
    },
};

/// Training configuration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SoftTrainingConfig {
    /// Seed of weights and batches.
    pub seed: u64,
    /// Number of epochs; forty if neither this nor `seconds` is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub epochs: Option<usize>,
    /// Budget of time (s) in place of epochs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Number of squeezes per step.
    pub batch: usize,
    /// Highest learning rate.
    pub rate: f64,
    /// Sizes of the network.
    pub network: SoftConfig,
}

impl Default for SoftTrainingConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            epochs: None,
            seconds: None,
            batch: 8,
            rate: 2e-3,
            network: SoftConfig::default(),
        }
    }
}

/// Errors of the network and of the linear solution on the same frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoftErrors {
    /// Errors of the network; `force` is half the difference of the fingers' forces.
    pub network: Summary,
    /// Errors of the linear solution.
    pub linear: Summary,
    /// Time of a linear solution that continues from the frame before (s).
    pub linear_seconds: Spread,
}

/// Description of a network, its training data and its errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoftCard {
    /// Form of the network: soft.
    pub variant: String,
    /// Training configuration, and sizes of the network.
    pub training: SoftTrainingConfig,
    /// Nodes of the model mesh, at most.
    pub model_nodes: usize,
    /// Nodes of the mesh of the linear model, at most.
    pub linear_nodes: usize,
    /// Gradient steps.
    pub steps: u64,
    /// Number of frames that the linear model failed to solve, and of all frames.
    pub lost: [usize; 2],
    /// Training data; the test part has objects of other families.
    pub data: Data,
    /// Errors on unseen grasps of known objects.
    pub known: SoftErrors,
    /// Errors on objects of families outside the training data.
    pub novel: SoftErrors,
}

impl NetworkCard for SoftCard {
    const VARIANTS: &'static [&'static str] = &["soft"];
}

/// Default number of epochs.
const EPOCHS: usize = 40;

impl SoftTrainingConfig {
    /// Returns this configuration with its budget filled in, or an error if a setting is out of
    /// range.
    fn validated(mut self) -> Result<Self> {
        Budget::filled(&mut self.epochs, self.seconds, EPOCHS)?;
        in_range(self.seed, self.rate, self.batch, 1)?;
        let SoftConfig { width, corner, down, up } = self.network;
        scaled(width, corner, &[&down[..], &up])?;
        Ok(self)
    }

    /// Trains on the dataset in `data` for the budget, timed by `clock` (s), and writes
    /// checkpoints, weights and their card into `out`; resumes from the last checkpoint there. The
    /// best of the whole epochs is chosen by validation. `watch` is called at every step and stops
    /// the run by returning false. Returns the card, or `None` if stopped.
    ///
    /// Errors: settings out of range, a dataset that cannot be read or has no frames to train on, a
    /// checkpoint of another run, a gradient that is not finite.
    pub fn train(
        &self,
        data: &Path,
        out: &Path,
        trained_by: &str,
        clock: &dyn Fn() -> f64,
        watch: Watch,
    ) -> Result<Option<SoftCard>> {
        let (settings, dataset) = (self.validated()?, Squeezes::open(data)?);
        let Some((objects, mut samples)) = Objects::read(&dataset, watch)? else { return Ok(None) };
        let count = samples.len();
        let names: Vec<_> = samples.iter().map(|s| s.grasp.clone()).collect();
        let text = serde_json::to_string(&(dataset.config(), names)).expect("plain data");
        let fingerprint = sha256(text);
        let [train, validation, known, novel] =
            [Part::Train, Part::Validation, Part::Known, Part::Novel]
                .map(|part| take(&mut samples, part));
        if train.is_empty() {
            let found = "no frames to train on";
            return Err(Error::invalid("data", found, "squeezes of known objects"));
        }
        let training = Training {
            seed: settings.seed,
            batch: settings.batch,
            rate: settings.rate,
            network: settings.network,
            ..Training::<SoftConfig>::default()
        };
        let pace = Pace::new(Budget::of(settings.epochs, settings.seconds)?, clock);
        let mut run =
            TrainingRun::<Soft>::resumed(training, &settings, fingerprint.clone(), pace, out)?;
        if !watch(&TrainingProgress::Samples { train: train.len(), lost: objects.lost })
            || !run.run(&objects, &train, &validation, watch)?
        {
            return Ok(None);
        }
        let (network, vectors) = run.chosen()?;
        let amplitude = train.iter().map(|s| f64::from(s.input.amplitude)).fold(0.0, f64::max);
        let card = SoftCard {
            variant: "soft".to_owned(),
            training: settings,
            model_nodes: dataset.config().model_nodes,
            linear_nodes: dataset.config().truth_nodes,
            steps: run.trainer.adam.steps,
            lost: [objects.lost, objects.lost + count],
            data: Data {
                train: counts(train.iter().map(|s| &s.grasp)),
                test: counts(novel.iter().map(|s| &s.grasp)),
                amplitude,
                ..Data::of(dataset.config(), fingerprint, trained_by)
            },
            known: judged(&network, &objects, &known)?,
            novel: judged(&network, &objects, &novel)?,
        };
        run.finish(&vectors, &card)?;
        Ok(Some(card))
    }
}

fn judged(network: &Soft, objects: &Objects, samples: &[SoftSample]) -> Result<SoftErrors> {
    let linear = |sample: &SoftSample| {
        let input = &sample.input;
        let fields = Fields {
            displacement: input.displacement.clone(),
            stress: input.stress.clone(),
            forces: input.forces.clone(),
            force: squeezing(&input.forces, &input.shares),
        };
        errors(&fields, &sample.target, &sample.unit)
    };
    Ok(SoftErrors {
        network: Summary::of(&judge(network, objects, samples)?),
        linear: Summary::of(&samples.iter().map(linear).collect::<Vec<_>>()),
        linear_seconds: Spread::of(samples.iter().map(|s| s.seconds).collect()),
    })
}

/// Removes the samples of a part from `samples` and returns them.
fn take(samples: &mut Vec<SoftSample>, part: Part) -> Vec<SoftSample> {
    samples.extract_if(.., |sample| sample.part == part).collect()
}
