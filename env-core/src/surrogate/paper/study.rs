//! Runs of equal budget on equal data: what is trained, and what a run came to.

use std::{
    cell::Cell,
    collections::{BTreeMap, BTreeSet},
    path::Path,
    time::Instant,
};

use rand::{SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::{
    bodies::Bodies,
    card::PaperCard,
    config::PaperConfig,
    judge::{Judged, judge_paper, thinned},
    parts::Parts,
    patch::Density,
    samples::Sample,
    target::Told,
};
use crate::{
    Error, Result,
    dataset::Dataset,
    surrogate::{
        Contact, Spread, Summary, Training,
        corrector::{Corrector, CorrectorConfig},
        metrics::{judge, judge_linear},
        run::fingerprint,
        samples::Gels,
        train::{Network, Trainer},
        weights::{self, Data, Vectors},
    },
};

/// What is trained.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Run {
    /// One of the paper's networks, trained on object surfaces of a density and judged on both.
    Paper {
        /// Which.
        network: PaperConfig,
        /// Density that it is trained on.
        density: Density,
    },
    /// The corrector of linear answers, and the linear answers themselves.
    Corrector(CorrectorConfig),
}

/// Data and budget that runs have in common.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Study {
    /// Split of the dataset; the last grasp of each object to train on is judged on instead.
    pub split: String,
    /// What weights and batches are drawn from.
    pub seed: u64,
    /// Budget (s) by the clock that [`Study::run`] is given.
    pub seconds: f64,
    /// Presses in a gradient.
    pub batch: usize,
    /// Highest learning rate.
    pub rate: f64,
    /// Every how manieth frame is judged.
    pub every: usize,
}

impl Default for Study {
    /// A quarter of an hour, a press at a time: in that little, more steps are worth more than better ones.
    fn default() -> Self {
        let (seed, seconds, every) = (0, 900.0, 1);
        Self { split: "novel-14".to_owned(), seed, seconds, batch: 1, rate: 2e-3, every }
    }
}

/// Errors while training, on a sample of the frames that are judged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Time trained (s) by the study's clock.
    pub seconds: f64,
    /// Gradient steps.
    pub steps: u64,
    /// Relative errors of displacement and stress by part.
    pub errors: BTreeMap<String, [Spread; 2]>,
}

/// What a run came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// What was trained.
    pub run: Run,
    /// On which data and budget.
    pub study: Study,
    /// Grasps and frames by part: train, known objects' and novel objects' grasps.
    pub counts: BTreeMap<String, [usize; 2]>,
    /// Numbers that were learnt.
    pub parameters: usize,
    /// Gradient steps.
    pub steps: u64,
    /// What training took by the study's clock, and by the wall (s).
    pub seconds: [f64; 2],
    /// Errors on the way.
    pub curve: Vec<Point>,
    /// Errors by part and by answerer: a density of the object's surface, or a model.
    pub errors: BTreeMap<String, BTreeMap<String, Judged>>,
}

/// The weights of one of the paper's networks.
#[derive(Clone, Debug)]
pub struct Weights {
    /// What they are.
    pub card: PaperCard,
    /// The file, the card in it.
    pub bytes: Vec<u8>,
}

/// Points of a learning curve, and frames of a part that it is drawn from.
const POINTS: f64 = 12.0;
const FRAMES: usize = 40;

/// A trained network, its learning curve, and what training took (s).
struct Trained<N: Network> {
    trainer: Trainer<N>,
    curve: Vec<Point>,
    seconds: [f64; 2],
}

impl Study {
    /// Trains `run` on the dataset in `data` for the budget, told by `clock` (s), and judges it. For
    /// one of the paper's networks its weights come with it.
    ///
    /// Errors: a dataset that cannot be read, a split without frames, a gradient that is not finite.
    pub fn run(
        &self,
        run: &Run,
        data: &Path,
        trained_by: &str,
        clock: &dyn Fn() -> f64,
    ) -> Result<(Report, Option<Weights>)> {
        let dataset = Dataset::open(data)?;
        let parts = Parts::of(dataset.split(&self.split)?);
        match run {
            Run::Paper { network, density } => {
                let told = (*network, *density, trained_by);
                let (report, weights) = self.paper(run, told, &dataset, &parts, clock)?;
                Ok((report, Some(weights)))
            }
            Run::Corrector(network) => {
                Ok((self.corrector(run, *network, &dataset, &parts, clock)?, None))
            }
        }
    }

    fn paper(
        &self,
        run: &Run,
        (network, density, trained_by): (PaperConfig, Density, &str),
        dataset: &Dataset,
        parts: &Parts,
        clock: &dyn Fn() -> f64,
    ) -> Result<(Report, Weights)> {
        let bodies = Bodies::new(dataset.config())?;
        let samples = bodies.samples(dataset, &parts.train, density)?;
        let judged = [&parts.known, &parts.novel].map(|part| -> Result<_> {
            Ok(thinned(bodies.samples(dataset, part, density)?, self.every))
        });
        let [known, novel] = judged;
        let tests = [("known", known?), ("novel", novel?)];
        let trained = self.trained::<Told>(network, &bodies, &samples, &tests, clock)?;
        let told = &trained.trainer.network;
        let mut errors = BTreeMap::new();
        let mut counted = BTreeMap::from([counts("train", samples.iter().map(|s| &s.grasp))]);
        for (part, test) in &tests {
            let found = judge_paper(told, &bodies, test, clock)?;
            errors.insert((*part).to_owned(), BTreeMap::from([(name(density), found)]));
            counted.extend([counts(part, test.iter().map(|s| &s.grasp))]);
        }
        let other = density.other();
        let test = thinned(bodies.samples(dataset, &parts.novel, other)?, OTHER * self.every);
        let found = judge_paper(told, &bodies, &test, clock)?;
        errors.entry("novel".to_owned()).or_default().insert(name(other), found);
        let report = self.report(run, &trained, counted, errors);
        let fingerprint = fingerprint(dataset, dataset.split(&self.split)?);
        let amplitude = samples.iter().map(Sample::amplitude).fold(0.0, f64::max);
        let [train, test] = ["train", "novel"].map(|part| report.counts[part]);
        let card = PaperCard {
            variant: network.variant.name().to_owned(),
            network,
            density,
            model_nodes: dataset.config().model_nodes,
            study: self.clone(),
            data: Data {
                train,
                test,
                amplitude,
                ..Data::of(dataset.config(), fingerprint, trained_by)
            },
            known: report.errors["known"][&name(density)].clone(),
            novel: report.errors["novel"][&name(density)].clone(),
        };
        let vectors: Vectors = trained.trainer.parameters.vectors()?;
        let bytes = weights::to_bytes(&vectors, &card);
        Ok((report, Weights { card, bytes }))
    }

    fn corrector(
        &self,
        run: &Run,
        network: CorrectorConfig,
        dataset: &Dataset,
        parts: &Parts,
        clock: &dyn Fn() -> f64,
    ) -> Result<Report> {
        let linear_nodes = Training::<CorrectorConfig>::default().linear_nodes;
        let gels = Gels::new(dataset.config(), linear_nodes, Contact::Points)?;
        let all = [&parts.train[..], &parts.known, &parts.novel];
        let ([samples, known, novel], _) = gels.samples(dataset, all, &mut |_, _| true)?;
        let [known, novel] = [known, novel].map(|part| thinned(part, self.every));
        let tests = [("known", known), ("novel", novel)];
        let trained = self.trained::<Corrector>(network, &gels, &samples, &tests, clock)?;
        let mut errors = BTreeMap::new();
        let mut counted = BTreeMap::from([counts("train", samples.iter().map(|s| &s.grasp))]);
        for (part, test) in &tests {
            let start = clock();
            let found = judge(&trained.trainer.network, &gels, test)?;
            let each = (clock() - start) / test.len().max(1) as f64;
            let linear = Judged::of(&judge_linear(&gels, test), None);
            let found = Judged::of(&found, Some(each));
            let both = [("corrector".to_owned(), found), ("linear".to_owned(), linear)];
            errors.insert((*part).to_owned(), both.into());
            counted.extend([counts(part, test.iter().map(|s| &s.grasp))]);
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
    ) -> Result<Trained<N>>
    where
        N::Config: Default,
    {
        if samples.is_empty() {
            let found = format!("{} with no frames to train on", self.split);
            return Err(Error::invalid("split", found, "a split with frames in the dataset"));
        }
        let training = Training {
            seed: self.seed,
            split: self.split.clone(),
            batch: self.batch,
            rate: self.rate,
            network,
            ..Training::default()
        };
        let mut trainer = Trainer::<N>::new(training)?;
        let (start, wall, mut curve) = (Cell::new(clock()), Instant::now(), Vec::<Point>::new());
        let spent = || (clock() - start.get()) / self.seconds;
        trainer.spend(ground, samples, &spent, &mut |trainer| {
            if spent() * POINTS >= (curve.len() + 1) as f64 {
                let begun = clock();
                let (seconds, steps) = (spent() * self.seconds, trainer.adam.steps);
                let errors = glance(&trainer.network, ground, tests)?;
                curve.push(Point { seconds, steps, errors });
                // The budget is for training alone.
                start.set(start.get() + clock() - begun);
            }
            Ok(())
        })?;
        let seconds = [clock() - start.get(), wall.elapsed().as_secs_f64()];
        Ok(Trained { trainer, curve, seconds })
    }

    fn report<N: Network>(
        &self,
        run: &Run,
        Trained { trainer, curve, seconds }: &Trained<N>,
        counts: BTreeMap<String, [usize; 2]>,
        errors: BTreeMap<String, BTreeMap<String, Judged>>,
    ) -> Report {
        let learnt = trainer.parameters.all().iter().map(|(_, var)| var.elem_count()).sum();
        let (run, study, steps) = (*run, self.clone(), trainer.adam.steps);
        let (curve, seconds) = (curve.clone(), *seconds);
        Report { run, study, counts, parameters: learnt, steps, seconds, curve, errors }
    }
}

/// Of the density that is not trained on, one in so many of the judged frames is judged.
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

/// Grasps and frames of a part.
fn counts<'a>(part: &str, grasps: impl Iterator<Item = &'a String>) -> (String, [usize; 2]) {
    let all: Vec<_> = grasps.collect();
    let grasps: BTreeSet<_> = all.iter().collect();
    (part.to_owned(), [grasps.len(), all.len()])
}
