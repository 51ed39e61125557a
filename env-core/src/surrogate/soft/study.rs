//! Training of the soft objects' network within a budget, and its card.

use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::{
    network::{Soft, SoftConfig},
    samples::{Objects, Part, Sample, squeezing},
};
use crate::{
    Error, Result,
    dataset::Squeezes,
    surrogate::{
        Spread, Summary,
        metrics::{Fields, errors, judge},
        run::hex,
        train::{Trainer, Training},
        weights::{self, Data, Kind},
    },
};

/// How a network is trained.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SoftStudy {
    /// What weights and batches are drawn from.
    pub seed: u64,
    /// Budget (s) by the clock that [`SoftStudy::run`] is given.
    pub seconds: f64,
    /// Squeezes in a gradient.
    pub batch: usize,
    /// Highest learning rate.
    pub rate: f64,
    /// Sizes of the network.
    pub network: SoftConfig,
}

impl Default for SoftStudy {
    fn default() -> Self {
        Self { seed: 0, seconds: 900.0, batch: 8, rate: 2e-3, network: SoftConfig::default() }
    }
}

/// Errors of the network and of the linear answer on the same frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoftErrors {
    /// The network's; `force` is half the difference of what the fingers exert.
    pub network: Summary,
    /// The linear answer's.
    pub linear: Summary,
    /// Time of a linear answer, of a path from the last frame (s).
    pub linear_seconds: Spread,
}

/// What a network is, what it learnt from and how well.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoftCard {
    /// Form of the network: soft.
    pub variant: String,
    /// How it was trained, and its sizes.
    pub study: SoftStudy,
    /// Nodes of the model mesh, at most.
    pub model_nodes: usize,
    /// Nodes of the mesh of the linear model, at most.
    pub linear_nodes: usize,
    /// Gradient steps.
    pub steps: u64,
    /// Frames that the linear model did not answer, and all.
    pub lost: [usize; 2],
    /// What it was trained on; tested on objects of other families.
    pub data: Data,
    /// Errors on unseen grasps of known objects.
    pub known: SoftErrors,
    /// Errors on objects of families that it never saw.
    pub novel: SoftErrors,
}

impl Kind for SoftCard {
    const VARIANTS: &'static [&'static str] = &["soft"];
}

impl SoftStudy {
    /// Trains on the dataset in `data` for the budget, told by `clock` (s); the card, and the weights
    /// as a file. `watch` hears the steps, the share of the budget and the errors on the batches.
    pub fn run(
        &self,
        data: &Path,
        trained_by: &str,
        clock: &dyn Fn() -> f64,
        watch: &dyn Fn(u64, f64, &SoftErrors),
    ) -> Result<(SoftCard, Vec<u8>)> {
        let (objects, mut samples) = Objects::read(data)?;
        let names: Vec<_> = samples.iter().map(|s| s.grasp.clone()).collect();

        let [train, spare, known, novel] = [Part::Train, Part::Spare, Part::Known, Part::Novel]
            .map(|part| take(&mut samples, part));
        if train.is_empty() {
            return Err(Error::invalid(
                "data",
                "no frames to train on",
                "squeezes of known objects",
            ));
        }
        let training = Training {
            seed: self.seed,
            batch: self.batch,
            rate: self.rate,
            network: self.network,
            ..Training::<SoftConfig>::default()
        };
        let mut trainer = Trainer::<Soft>::new(training)?;
        let start = clock();
        let spent = || (clock() - start) / self.seconds;
        let mut reports = 0.0;
        trainer.spend(&objects, &train, &spent, &mut |trainer| {
            if spent() * 10.0 >= reports + 1.0 {
                reports += 1.0;
                watch(trainer.adam.steps, spent(), &judged(&trainer.network, &objects, &spare)?);
            }
            Ok(())
        })?;
        let dataset = Squeezes::open(data)?;
        let count = names.len();
        let text = serde_json::to_string(&(dataset.config(), names)).expect("plain data");
        let fingerprint = hex(&Sha256::digest(text));
        let amplitude = train.iter().map(|s| f64::from(s.question.amplitude)).fold(0.0, f64::max);
        let card = SoftCard {
            variant: "soft".to_owned(),
            study: *self,
            model_nodes: dataset.config().model_nodes,
            linear_nodes: dataset.config().truth_nodes,
            steps: trainer.adam.steps,
            lost: [objects.lost, objects.lost + count],
            data: Data {
                train: counts(&train),
                test: counts(&novel),
                amplitude,
                ..Data::of(dataset.config(), fingerprint, trained_by)
            },
            known: judged(&trainer.network, &objects, &known)?,
            novel: judged(&trainer.network, &objects, &novel)?,
        };
        let bytes = weights::to_bytes(&trainer.parameters.vectors()?, &card);
        Ok((card, bytes))
    }
}

fn counts(samples: &[Sample]) -> [usize; 2] {
    let mut grasps: Vec<_> = samples.iter().map(|sample| &sample.grasp).collect();
    grasps.dedup();
    [grasps.len(), samples.len()]
}

fn judged(network: &Soft, objects: &Objects, samples: &[Sample]) -> Result<SoftErrors> {
    let linear = |sample: &Sample| {
        let question = &sample.question;
        let fields = Fields {
            displacement: question.displacement.clone(),
            stress: question.stress.clone(),
            forces: question.forces.clone(),
            force: squeezing(&question.forces, &question.shares),
        };
        errors(&fields, &sample.truth, &sample.unit)
    };
    Ok(SoftErrors {
        network: Summary::of(&judge(network, objects, samples)?),
        linear: Summary::of(&samples.iter().map(linear).collect::<Vec<_>>()),
        linear_seconds: Spread::of(samples.iter().map(|s| s.seconds).collect()),
    })
}

/// Takes those of a part out of `samples`.
fn take(samples: &mut Vec<Sample>, part: Part) -> Vec<Sample> {
    samples.extract_if(.., |sample| sample.part == part).collect()
}
