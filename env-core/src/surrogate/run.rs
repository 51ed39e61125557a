//! Training and evaluation of the corrector.

use std::path::Path;

use rayon::prelude::*;

use super::{
    budget::{Budget, Pace},
    corrector::Corrector,
    features::Fields,
    metrics::{Evaluated, PressErrors, Summary, errors, judge_linear},
    paper::{self, PaperCard},
    parameters::Parameters,
    predicted::{self, ErrorModel, JudgedAnswer},
    samples::{Gels, Sample},
    train::{Network, Training},
    training_run::{TrainingProgress, TrainingRun, Watch, trainable},
    weights::{self, Card, Data, NetworkCard, TrainingBounds, counts, fingerprint},
};
use crate::{
    Error, Result,
    dataset::{Dataset, sha256},
};

/// Trains on the dataset in `data` and writes checkpoints, weights and their card into `out`;
/// resumes from the last checkpoint there. `watch` is called at every step and stops the run by
/// returning false. Returns the card, or `None` if stopped.
///
/// A second dataset, `coarser`, may hold presses of the same gels that were solved less accurately.
/// A feature of the network tells it which solution it is to meet; its answers are like those of
/// `data`.
///
/// Errors: a dataset that cannot be read, one of other gels, a split without frames, a checkpoint
/// of another run, a gradient that is not finite.
pub fn train(
    data: &Path,
    coarser: Option<&Path>,
    out: &Path,
    training: &Training,
    trained_by: &str,
    watch: Watch,
) -> Result<Option<Card>> {
    let dataset = Dataset::open(data)?;
    let lower = coarser.map(Dataset::open).transpose()?;
    if let (Some(lower), Some(path)) = (&lower, coarser) {
        same_pads(&dataset, lower).map_err(|reason| Error::file(path, reason))?;
    }
    let gels = Gels::new(dataset.config(), training.linear_nodes)?;
    let Some(read) = TrainingSamples::read(&gels, &dataset, lower.as_ref(), training, watch)?
    else {
        return Ok(None);
    };
    let TrainingSamples { samples, validation, test, lost, low_fidelity, fingerprint } = read;
    let pace = Pace::new(Budget::Epochs(training.epochs), &|| 0.0);
    let mut run = TrainingRun::<Corrector>::resumed(
        training.clone(),
        training,
        fingerprint.clone(),
        pace,
        out,
    )?;
    if !watch(&TrainingProgress::Samples { train: samples.len(), lost })
        || !run.run(&gels, &samples, &validation, watch)?
    {
        return Ok(None);
    }
    let (network, vectors) = run.chosen()?;
    let config = dataset.config();
    let amplitudes = samples.iter().map(|sample| sample.target.amplitude());
    let predicted = error_model(&network, &gels, &validation)?;
    let found = judge_blended(&network, predicted.as_ref(), &gels, &test)?;
    let card = Card {
        variant: "corrector".to_owned(),
        network: training.network,
        model_nodes: config.model_nodes,
        linear_nodes: training.linear_nodes,
        training: training.clone(),
        data: Data {
            train: counts(samples.iter().map(|s| &s.grasp)),
            low_fidelity,
            test: counts(test.iter().map(|s| &s.grasp)),
            amplitude: amplitudes.fold(0.0, f64::max),
            ..Data::of(config, fingerprint, trained_by)
        },
        predicted,
        usual: TrainingBounds::of(samples.iter().map(|sample| &sample.target)),
        test: Summary::of(&found),
        linear: Summary::of(&judge_linear(&gels, &test)),
    };
    run.finish(&vectors, &card)?;
    Ok(Some(card))
}

/// Samples of a training run, those of a less accurate dataset first.
struct TrainingSamples {
    samples: Vec<Sample>,
    validation: Vec<Sample>,
    test: Vec<Sample>,
    /// Number of frames left out because the linear model failed to solve them.
    lost: usize,
    /// Numbers of grasps and frames of the less accurate dataset to train on.
    low_fidelity: [usize; 2],
    /// Hash of the data and their split.
    fingerprint: String,
}

impl TrainingSamples {
    /// Reads the parts of the split of `dataset`, and of the less accurate `lower`; `None` if
    /// `watch` stops it. Returns an error if one of them has no frames to train on.
    fn read(
        gels: &Gels,
        dataset: &Dataset,
        lower: Option<&Dataset>,
        training: &Training,
        watch: Watch,
    ) -> Result<Option<Self>> {
        let shards = dataset.shards() + lower.map_or(0, Dataset::shards);
        let (mut parts, mut fingerprints) = ([const { Vec::new() }; 3], Vec::new());
        let (mut lost, mut read, mut go_on, mut low_fidelity) = (0, 0, true, [0; 2]);
        for (dataset, is_lower) in lower.map(|d| (d, true)).into_iter().chain([(dataset, false)]) {
            let split = dataset.split(&training.split)?.clone();
            let names = [&split.train[..], &split.validation, &split.test];
            let (found, missing) = gels.samples(dataset, names, &mut |done, _| {
                go_on = watch(&TrainingProgress::Shard { done: read + done, all: shards });
                go_on
            })?;
            if !go_on {
                return Ok(None);
            }
            trainable(&training.split, &found[0])?;
            if is_lower {
                low_fidelity = counts(found[0].iter().map(|s| &s.grasp));
            }
            for (part, found) in parts.iter_mut().zip(found) {
                let sample = |s: Sample| if is_lower { s.of_low_fidelity() } else { s };
                part.extend(found.into_iter().map(sample));
            }
            (lost, read) = (lost + missing, read + dataset.shards());
            fingerprints.push(fingerprint(dataset, &split));
        }
        let [samples, validation, test] = parts;
        let fingerprint = match &fingerprints[..] {
            [one] => one.clone(),
            all => sha256(all.join(" ")),
        };
        Ok(Some(Self { samples, validation, test, lost, low_fidelity, fingerprint }))
    }
}

/// Returns why the presses of `lower` cannot be learnt from together with those of `dataset`.
fn same_pads(dataset: &Dataset, lower: &Dataset) -> std::result::Result<(), String> {
    let [fine, low] = [dataset, lower].map(Dataset::config);
    let differs = [
        ("gels", fine.gels != low.gels),
        ("model_nodes", fine.model_nodes != low.model_nodes),
        ("truth_steps", fine.truth_steps != low.truth_steps),
    ];
    match differs.iter().find(|(_, differs)| *differs) {
        None => Ok(()),
        Some((what, _)) => {
            Err(format!("{what}: found others, expected those of the finer dataset"))
        }
    }
}

/// Fits the prediction of errors to the answers of `network` to `samples`.
fn error_model(network: &Corrector, gels: &Gels, samples: &[Sample]) -> Result<Option<ErrorModel>> {
    let one = |sample: &Sample| {
        let fields = network.answer(gels, sample)?;
        let judged = |fields: &Fields| {
            let found = errors(fields, &sample.target, &gels.pads[sample.gel].gel);
            [found.displacement, found.stress, found.force]
        };
        Ok(JudgedAnswer {
            terms: predicted::terms(&sample.input, &fields),
            network: judged(&fields),
            linear: judged(&Fields::linear(&sample.input)),
        })
    };
    let answers = samples.par_iter().map(one).collect::<Result<Vec<_>>>()?;
    Ok(ErrorModel::fit(&answers))
}

/// Errors of the answers of `network` to `samples`, blended with the linear solutions by `model`,
/// as [`super::Surrogate`] gives them.
fn judge_blended(
    network: &Corrector,
    model: Option<&ErrorModel>,
    gels: &Gels,
    samples: &[Sample],
) -> Result<Vec<PressErrors>> {
    let one = |sample: &Sample| {
        let mut fields = network.answer(gels, sample)?;
        if let Some(model) = model {
            model.blended(&sample.input, &mut fields);
        }
        Ok(errors(&fields, &sample.target, &gels.pads[sample.gel].gel))
    };
    samples.par_iter().map(one).collect()
}

/// Computes the errors of a corrector, or of one of the paper's networks, on each press of the test
/// part of a split; if `coarser`, as answers to presses of the less accurate of two datasets.
///
/// Errors: weights of another kind, a dataset or a split that cannot be read.
pub fn evaluate(weights: &Path, data: &Path, split: &str, coarser: bool) -> Result<Vec<Evaluated>> {
    let (name, bytes) = (weights.display().to_string(), weights::read(weights)?);
    let dataset = Dataset::open(data)?;
    let names = &dataset.split(split)?.test;
    match weights::variant(&name, &bytes, &[Card::VARIANTS, PaperCard::VARIANTS].concat())? {
        found if Card::VARIANTS.contains(&&*found) => {
            corrector(&name, &bytes, &dataset, names, coarser)
        }
        _ if coarser => {
            let expected = "weights of a corrector, which alone know of coarser solutions";
            Err(Error::invalid("coarser", "weights of the paper's networks", expected))
        }
        _ => paper::evaluate(&name, &bytes, &dataset, names),
    }
}

fn corrector(
    name: &str,
    bytes: &[u8],
    dataset: &Dataset,
    names: &[String],
    coarser: bool,
) -> Result<Vec<Evaluated>> {
    let (vectors, card): (_, Card) = weights::of_kind(name, bytes)?;
    let network = Corrector::new(&card.network, &Parameters::given(vectors)?.builder())?;
    let gels = Gels::new(dataset.config(), card.linear_nodes)?;
    let ([mut samples], _) = gels.samples(dataset, [names], &mut |_, _| true)?;
    if coarser {
        samples = samples.into_iter().map(Sample::of_low_fidelity).collect();
    }
    let found = judge_blended(&network, card.predicted.as_ref(), &gels, &samples)?;
    let found = found.into_iter().zip(judge_linear(&gels, &samples));
    let one = |(sample, (network, linear)): (Sample, _)| Evaluated {
        grasp: sample.grasp,
        network,
        linear: Some(linear),
    };
    Ok(samples.into_iter().zip(found).map(one).collect())
}
