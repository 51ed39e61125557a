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
use crate::{Result, dataset::Dataset};

/// Trains on the dataset in `data` and writes checkpoints, weights and their card into `out`;
/// resumes from the last checkpoint there. `watch` is called at every step and stops the run by
/// returning false. Returns the card, or `None` if stopped.
///
/// Errors: a dataset that cannot be read, a split without frames, a checkpoint of another run, a
/// gradient that is not finite.
pub fn train(
    data: &Path,
    out: &Path,
    training: &Training,
    trained_by: &str,
    watch: Watch,
) -> Result<Option<Card>> {
    let dataset = Dataset::open(data)?;
    let gels = Gels::new(dataset.config(), training.linear_nodes)?;
    let split = dataset.split(&training.split)?.clone();
    let parts = [&split.train[..], &split.validation, &split.test];
    let mut go_on = true;
    let ([samples, validation, test], lost) = gels.samples(&dataset, parts, &mut |done, all| {
        go_on = watch(&TrainingProgress::Shard { done, all });
        go_on
    })?;
    if !go_on {
        return Ok(None);
    }
    trainable(&training.split, &samples)?;
    let fingerprint = fingerprint(&dataset, &split);
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
/// part of a split.
///
/// Errors: weights of another kind, a dataset or a split that cannot be read.
pub fn evaluate(weights: &Path, data: &Path, split: &str) -> Result<Vec<Evaluated>> {
    let (name, bytes) = (weights.display().to_string(), weights::read(weights)?);
    let dataset = Dataset::open(data)?;
    let names = &dataset.split(split)?.test;
    match weights::variant(&name, &bytes, &[Card::VARIANTS, PaperCard::VARIANTS].concat())? {
        found if Card::VARIANTS.contains(&&*found) => corrector(&name, &bytes, &dataset, names),
        _ => paper::evaluate(&name, &bytes, &dataset, names),
    }
}

fn corrector(
    name: &str,
    bytes: &[u8],
    dataset: &Dataset,
    names: &[String],
) -> Result<Vec<Evaluated>> {
    let (vectors, card): (_, Card) = weights::of_kind(name, bytes)?;
    let network = Corrector::new(&card.network, &Parameters::given(vectors)?.builder())?;
    let gels = Gels::new(dataset.config(), card.linear_nodes)?;
    let ([samples], _) = gels.samples(dataset, [names], &mut |_, _| true)?;
    let found = judge_blended(&network, card.predicted.as_ref(), &gels, &samples)?;
    let found = found.into_iter().zip(judge_linear(&gels, &samples));
    let one = |(sample, (network, linear)): (Sample, _)| Evaluated {
        grasp: sample.grasp,
        network,
        linear: Some(linear),
    };
    Ok(samples.into_iter().zip(found).map(one).collect())
}
