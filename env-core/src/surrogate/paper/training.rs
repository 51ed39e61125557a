//! Training runs of equal budget on the same data, and their results.

use std::{collections::BTreeMap, path::Path, time::Instant};

use rand::{SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::{
    card::{Judged, PaperCard},
    config::PaperTrainingConfig,
    judge::{judge_paper, thinned},
    parts::PaperSplit,
    patch::Density,
    run::{Frames, PaperRun},
    target::TrainablePaper,
};
use crate::{
    Result,
    dataset::Dataset,
    surrogate::{
        Spread, Summary, Training, TrainingProgress,
        budget::Pace,
        corrector::{Corrector, CorrectorConfig},
        metrics::{judge, judge_linear},
        samples::Gels,
        train::{Network, Trainer},
        training_run::trainable,
        weights::{self, counts},
    },
};

/// Network to train.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Run {
    /// One of the paper's networks, judged on object surfaces of both densities.
    Paper(PaperRun),
    /// The corrector of linear solutions, and the linear solutions themselves.
    Corrector(CorrectorConfig),
}

/// Errors during training, on a sample of the frames for evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Time trained (s) by the clock of training.
    pub seconds: f64,
    /// Gradient steps.
    pub steps: u64,
    /// Relative errors of displacement and stress by part.
    pub errors: BTreeMap<String, [Spread; 2]>,
}

/// Results of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Trained network.
    pub run: Run,
    /// Data and budget.
    pub training: PaperTrainingConfig,
    /// Numbers of grasps and frames by part: training, known objects and novel objects.
    pub counts: BTreeMap<String, [usize; 2]>,
    /// Number of trainable parameters.
    pub parameters: usize,
    /// Gradient steps.
    pub steps: u64,
    /// Duration of training by the clock of training, and wall time (s).
    pub seconds: [f64; 2],
    /// Errors during training.
    pub curve: Vec<Point>,
    /// Errors by part, and by density of the object's surface or by model.
    pub errors: BTreeMap<String, BTreeMap<String, Judged>>,
}

/// The weights of one of the paper's networks.
#[derive(Clone, Debug)]
pub struct PaperWeights {
    /// Description of the weights.
    pub card: PaperCard,
    /// Bytes of the file, card included.
    pub bytes: Vec<u8>,
}

/// Number of points of a learning curve, and of the frames of a part that they are computed on.
const POINTS: f64 = 12.0;
const FRAMES: usize = 40;

/// A trained network, its learning curve, and the duration of training (s).
struct FinishedTraining<N: Network> {
    trainer: Trainer<N>,
    curve: Vec<Point>,
    seconds: [f64; 2],
}

impl PaperTrainingConfig {
    /// Trains `run` on the dataset in `data` for the budget, timed by `clock` (s), and evaluates
    /// it. For one of the paper's networks, also returns the weights.
    ///
    /// Errors: a dataset that cannot be read, a split without frames, a gradient that is not
    /// finite.
    pub fn run(
        &self,
        run: &Run,
        data: &Path,
        trained_by: &str,
        clock: &dyn Fn() -> f64,
    ) -> Result<(Report, Option<PaperWeights>)> {
        let (settings, dataset) = (self.clone().validated()?, Dataset::open(data)?);
        match run {
            Run::Paper(paper) => {
                let (report, weights) = settings.paper(*paper, &dataset, trained_by, clock)?;
                Ok((report, Some(weights)))
            }
            Run::Corrector(network) => {
                Ok((settings.corrector(run, *network, &dataset, clock)?, None))
            }
        }
    }

    fn paper(
        &self,
        paper: PaperRun,
        dataset: &Dataset,
        trained_by: &str,
        clock: &dyn Fn() -> f64,
    ) -> Result<(Report, PaperWeights)> {
        let watch = &mut |_: &TrainingProgress| true;
        let frames = Frames::read(dataset, paper.density, self, watch)?.expect("nobody says no");
        let Frames { gels, train, tests } = &frames;
        let network = paper.network.validated()?;
        let trained = self.trained::<TrainablePaper>(network, gels, train, tests, clock)?;
        let network = &trained.trainer.network;
        let judged = frames.judged(network, clock, watch)?.expect("nobody says no");
        let mut errors = BTreeMap::new();
        for ((part, _), found) in tests.iter().zip(&judged) {
            let found = (name(paper.density), found.clone());
            errors.insert((*part).to_owned(), BTreeMap::from([found]));
        }
        let other = paper.density.other();
        let novel = &PaperSplit::of(dataset.split(&self.split)?).novel;
        let [test] = gels.samples(dataset, [novel], other, watch)?.expect("nobody says no");
        let found = judge_paper(network, gels, &thinned(test, OTHER * self.every), clock, watch)?;
        let found = (name(other), found.expect("nobody says no"));
        errors.entry("novel".to_owned()).or_default().extend([found]);
        let report = self.report(&Run::Paper(paper), &trained, frames.counts(), errors);
        let card = paper.card(self, dataset, &frames, judged, trained_by)?;
        let bytes = weights::to_bytes(&trained.trainer.parameters.vectors()?, &card);
        Ok((report, PaperWeights { card, bytes }))
    }

    fn corrector(
        &self,
        run: &Run,
        network: CorrectorConfig,
        dataset: &Dataset,
        clock: &dyn Fn() -> f64,
    ) -> Result<Report> {
        let parts = PaperSplit::of(dataset.split(&self.split)?);
        let linear_nodes = Training::<CorrectorConfig>::default().linear_nodes;
        let gels = Gels::new(dataset.config(), linear_nodes)?;
        let all = [&parts.train[..], &parts.known, &parts.novel];
        let ([samples, known, novel], _) = gels.samples(dataset, all, &mut |_, _| true)?;
        let [known, novel] = [known, novel].map(|part| thinned(part, self.every));
        let tests = [("known", known), ("novel", novel)];
        let trained = self.trained::<Corrector>(network, &gels, &samples, &tests, clock)?;
        let mut errors = BTreeMap::new();
        let mut counted =
            BTreeMap::from([("train".to_owned(), counts(samples.iter().map(|s| &s.grasp)))]);
        for (part, test) in &tests {
            let start = clock();
            let found = judge(&trained.trainer.network, &gels, test)?;
            let each = (clock() - start) / test.len().max(1) as f64;
            let linear = Judged::of(&judge_linear(&gels, test), None);
            let found = Judged::of(&found, Some(each));
            let both = [("corrector".to_owned(), found), ("linear".to_owned(), linear)];
            errors.insert((*part).to_owned(), both.into());
            counted.insert((*part).to_owned(), counts(test.iter().map(|s| &s.grasp)));
        }
        Ok(self.report(run, &trained, counted, errors))
    }

    fn trained<N: Network>(
        &self,
        network: N::Config,
        ground: &N::Ground,
        samples: &[N::Sample],
        tests: &[(&str, Vec<N::Sample>)],
        clock: &dyn Fn() -> f64,
    ) -> Result<FinishedTraining<N>>
    where
        N::Config: Default,
    {
        trainable(&self.split, samples)?;
        let mut trainer = Trainer::<N>::new(self.training(network))?;
        let (pace, wall) = (Pace::new(self.budget()?, clock), Instant::now());
        let mut curve = Vec::<Point>::new();
        let mut share = |trainer: &Trainer<N>, batches: usize| {
            let (seconds, steps) = (pace.elapsed(), trainer.adam.steps);
            let share = pace.share(steps, batches);
            if share.unwrap_or(1.0) * POINTS >= (curve.len() + 1) as f64 {
                // The budget is for training alone.
                let errors = pace.pause(|| glance(&trainer.network, ground, tests))?;
                curve.push(Point { seconds, steps, errors });
            }
            Ok(share)
        };
        while trainer.epoch(ground, samples, &mut share)?.is_some() {}
        let seconds = [pace.elapsed(), wall.elapsed().as_secs_f64()];
        Ok(FinishedTraining { trainer, curve, seconds })
    }

    fn report<N: Network>(
        &self,
        run: &Run,
        FinishedTraining { trainer, curve, seconds }: &FinishedTraining<N>,
        counts: BTreeMap<String, [usize; 2]>,
        errors: BTreeMap<String, BTreeMap<String, Judged>>,
    ) -> Report {
        let learnt = trainer.parameters.count();
        let (run, training, steps) = (*run, self.clone(), trainer.adam.steps);
        let (curve, seconds) = (curve.clone(), *seconds);
        Report { run, training, counts, parameters: learnt, steps, seconds, curve, errors }
    }
}

/// Of the density that is not trained on, one in so many of the frames for evaluation is used.
const OTHER: usize = 3;

/// Errors of displacement and stress on a few frames of each part.
fn glance<N: Network>(
    network: &N,
    ground: &N::Ground,
    tests: &[(&str, Vec<N::Sample>)],
) -> Result<BTreeMap<String, [Spread; 2]>> {
    let one = |(part, test): &(&str, Vec<N::Sample>)| {
        let mut few: Vec<_> = test.iter().collect();
        few.shuffle(&mut ChaCha8Rng::seed_from_u64(0));
        few.truncate(FRAMES);
        let Summary { displacement, stress, .. } = Summary::of(&judge(network, ground, &few)?);
        Ok(((*part).to_owned(), [displacement, stress]))
    };
    tests.iter().map(one).collect()
}

fn name(density: Density) -> String {
    match density {
        Density::Coarse => "coarse".to_owned(),
        Density::Dense => "dense".to_owned(),
    }
}
