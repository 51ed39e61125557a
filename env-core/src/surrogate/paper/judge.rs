//! Errors of a model on one part of the frames.

use super::{
    card::Judged,
    config::Input,
    gels::PaperGels,
    samples::PaperSample,
    target::{TrainablePaper, fields, motion, rigid_apart},
};
use crate::{
    Result,
    dataset::Dataset,
    surrogate::{
        Evaluated, Spread, TrainingProgress,
        metrics::{errors, judge, relative},
        train::Network,
        training_run::Watch,
    },
};

/// Errors of one of the paper's networks; `None` if `watch`, called before each press, stops it.
pub(super) fn judge_paper(
    network: &TrainablePaper,
    gels: &PaperGels,
    test: &[PaperSample],
    clock: &dyn Fn() -> f64,
    watch: Watch,
) -> Result<Option<Judged>> {
    let (mut presses, mut seconds) = (Vec::new(), 0.0);
    let (mut rigid, mut target, mut object) = (Vec::new(), Vec::new(), Vec::new());
    for sample in test {
        if !watch(&TrainingProgress::Step) {
            return Ok(None);
        }
        let start = clock();
        let answer = network.output(gels, sample, 0)?;
        seconds += (clock() - start) / test.len() as f64;
        let (true_fields, gel) = TrainablePaper::target(gels, sample);
        presses.push(errors(&fields(&answer)?, true_fields, gel));
        let in_units = |[angle, distance]: [f64; 2]| [distance * gel.thickness, angle.to_degrees()];
        rigid.extend(rigid_apart(&answer, sample)?.map(in_units));
        target.push(in_units(sample.turned()));
        if network.input == Input::Force {
            let (found, moved) = (answer.object.flatten_all()?.to_vec1()?, motion(gels, sample));
            object.push(relative(&found, &moved));
        }
    }
    let spreads = |pairs: &[[f64; 2]]| {
        let spread = |i: usize| Spread::of(pairs.iter().map(|pair| pair[i]).collect());
        (!pairs.is_empty()).then(|| [spread(0), spread(1)])
    };
    Ok(Some(Judged {
        rigid: spreads(&rigid),
        rigid_truth: spreads(&target),
        object: (!object.is_empty()).then(|| Spread::of(object)),
        ..Judged::of(&presses, Some(seconds))
    }))
}

/// Errors of the network in the `bytes` of weights called `name` on the grasps of those `names`,
/// press by press.
pub(in super::super) fn evaluate(
    name: &str,
    bytes: &[u8],
    dataset: &Dataset,
    names: &[String],
) -> Result<Vec<Evaluated>> {
    let (network, card) = TrainablePaper::opened(name, bytes)?;
    let gels = PaperGels::new(dataset.config())?;
    let samples = gels.samples(dataset, [names], card.density, &mut |_| true)?;
    let [samples] = samples.expect("nobody says no");
    let found = judge(&network, &gels, &samples)?.into_iter();
    let one = |(sample, network): (PaperSample, _)| Evaluated {
        grasp: sample.grasp,
        network,
        linear: None,
    };
    Ok(samples.into_iter().zip(found).map(one).collect())
}

/// Every n-th item of `test`, with n = `every`.
pub(super) fn thinned<T>(test: Vec<T>, every: usize) -> Vec<T> {
    test.into_iter().step_by(every.max(1)).collect()
}
