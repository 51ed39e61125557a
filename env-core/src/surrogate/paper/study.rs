//! Runs of equal budget on equal data, and their errors.

use std::{collections::BTreeMap, path::Path, time::Instant};

use serde::{Deserialize, Serialize};

use super::{
    bodies::Bodies,
    config::{Input, PaperConfig},
    patch::Density,
    samples::Sample,
    target::{Told, fields, motion, rigid_apart},
};
use crate::{
    Error, Result,
    dataset::Dataset,
    surrogate::{
        Contact, PressErrors, Spread, Summary, Training,
        corrector::{Corrector, CorrectorConfig},
        metrics::{errors, judge, judge_linear, relative},
        samples::Gels,
        train::{Network, Trainer},
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
pub struct Study {
    /// Split of the dataset.
    pub split: String,
    /// What weights and batches are drawn from.
    pub seed: u64,
    /// Budget (s) by the clock that [`Study::run`] is given.
    pub seconds: f64,
    /// Presses in a gradient.
    pub batch: usize,
    /// Highest learning rate.
    pub rate: f64,
    /// Every how manieth frame of the test part is judged.
    pub every: usize,
}

/// Errors of an answerer, and what else is known of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// By the corrector's measures; null where the answerer does not say.
    pub summary: Summary,
    /// Error of the gel's rigid motion: translation (m) and rotation (degrees).
    pub rigid: Option<[Spread; 2]>,
    /// The true rigid motion: translation (m) and rotation (degrees).
    pub rigid_truth: Option<[Spread; 2]>,
    /// Relative error of the object's motion since touch, where only the force is told.
    pub object: Option<Spread>,
    /// Mean time of a press, everything but the linear answer included (s by the study's clock).
    pub seconds: f64,
}

/// What a run came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// What was trained.
    pub run: Run,
    /// On which data and budget.
    pub study: Study,
    /// Grasps and frames trained on.
    pub train: [usize; 2],
    /// Grasps and frames judged on.
    pub test: [usize; 2],
    /// Numbers that were learnt.
    pub parameters: usize,
    /// Gradient steps.
    pub steps: u64,
    /// What training took by the study's clock, and by the wall (s).
    pub seconds: [f64; 2],
    /// Errors on the test part by answerer.
    pub errors: BTreeMap<String, Judged>,
}

impl Study {
    /// Trains `run` on the dataset in `data` for the budget, told by `clock` (s), and judges it.
    ///
    /// Errors: a dataset that cannot be read, a split without frames, a gradient that is not finite.
    pub fn run(&self, run: &Run, data: &Path, clock: &dyn Fn() -> f64) -> Result<Report> {
        match run {
            Run::Paper { network, density } => self.paper(run, *network, *density, data, clock),
            Run::Corrector(network) => self.corrector(run, *network, data, clock),
        }
    }

    fn paper(
        &self,
        run: &Run,
        network: PaperConfig,
        density: Density,
        data: &Path,
        clock: &dyn Fn() -> f64,
    ) -> Result<Report> {
        let dataset = Dataset::open(data)?;
        let bodies = Bodies::new(dataset.config())?;
        let split = dataset.split(&self.split)?;
        let samples = bodies.samples(&dataset, &split.train, density)?;
        let (trainer, seconds) = self.trained::<Told>(network, &bodies, &samples, clock)?;
        let mut errors = BTreeMap::new();
        let mut counted = [0; 2];
        for (name, density) in [("coarse", Density::Coarse), ("dense", Density::Dense)] {
            let test = self.judged(bodies.samples(&dataset, &split.test, density)?);
            counted = counts(test.iter().map(|sample| sample.grasp.as_str()));
            let found = judge_paper(&trainer.network, &bodies, &test, network, clock)?;
            errors.insert(name.to_owned(), found);
        }
        let train = counts(samples.iter().map(|sample| sample.grasp.as_str()));
        Ok(self.report(run, &trainer, [train, counted], seconds, errors))
    }

    fn corrector(
        &self,
        run: &Run,
        network: CorrectorConfig,
        data: &Path,
        clock: &dyn Fn() -> f64,
    ) -> Result<Report> {
        let dataset = Dataset::open(data)?;
        let linear_nodes = Training::<CorrectorConfig>::default().linear_nodes;
        let gels = Gels::new(dataset.config(), linear_nodes, Contact::Points)?;
        let split = dataset.split(&self.split)?;
        let parts = [split.train.as_slice(), &split.test];
        let ([samples, test], _) = gels.samples(&dataset, parts, &mut |_, _| true)?;
        let test = self.judged(test);
        let (trainer, seconds) = self.trained::<Corrector>(network, &gels, &samples, clock)?;
        let start = clock();
        let found = judge(&trainer.network, &gels, &test)?;
        let each = (clock() - start) / test.len().max(1) as f64;
        let plain = |errors: &[PressErrors], seconds: f64| {
            let summary = Summary::of(errors);
            Judged { summary, rigid: None, rigid_truth: None, object: None, seconds }
        };
        let errors = BTreeMap::from([
            ("corrector".to_owned(), plain(&found, each)),
            ("linear".to_owned(), plain(&judge_linear(&gels, &test), 0.0)),
        ]);
        let counted = [&samples, &test].map(|part| counts(part.iter().map(|s| s.grasp.as_str())));
        Ok(self.report(run, &trainer, counted, seconds, errors))
    }

    /// The frames that are judged.
    fn judged<T>(&self, test: Vec<T>) -> Vec<T> {
        test.into_iter().step_by(self.every.max(1)).collect()
    }

    fn trained<N: Network>(
        &self,
        network: N::Config,
        ground: &N::Ground,
        samples: &[N::Sample],
        clock: &dyn Fn() -> f64,
    ) -> Result<(Trainer<N>, [f64; 2])>
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
        let (start, wall) = (clock(), Instant::now());
        trainer.spend(ground, samples, &|| (clock() - start) / self.seconds)?;
        Ok((trainer, [clock() - start, wall.elapsed().as_secs_f64()]))
    }

    fn report<N: Network>(
        &self,
        run: &Run,
        trainer: &Trainer<N>,
        [train, test]: [[usize; 2]; 2],
        seconds: [f64; 2],
        errors: BTreeMap<String, Judged>,
    ) -> Report {
        let learnt = trainer.parameters.all().iter().map(|(_, var)| var.elem_count()).sum();
        let (run, study, steps) = (*run, self.clone(), trainer.adam.steps);
        Report { run, study, train, test, parameters: learnt, steps, seconds, errors }
    }
}

fn judge_paper(
    network: &Told,
    bodies: &Bodies,
    test: &[Sample],
    config: PaperConfig,
    clock: &dyn Fn() -> f64,
) -> Result<Judged> {
    let (mut presses, mut seconds) = (Vec::new(), 0.0);
    let (mut rigid, mut truth, mut object) = (Vec::new(), Vec::new(), Vec::new());
    for sample in test {
        let start = clock();
        let answer = network.says(bodies, sample, 0)?;
        seconds += (clock() - start) / test.len() as f64;
        let (true_fields, gel) = Told::truth(bodies, sample);
        presses.push(errors(&fields(&answer)?, true_fields, gel));
        let in_units = |[angle, way]: [f64; 2]| [way * gel.thickness, angle.to_degrees()];
        rigid.extend(rigid_apart(&answer, sample)?.map(in_units));
        truth.push(in_units(sample.turned()));
        if config.input == Input::Force {
            let (found, moved) = (answer.object.flatten_all()?.to_vec1()?, motion(bodies, sample));
            object.push(relative(&found, &moved));
        }
    }
    let spreads = |pairs: &[[f64; 2]]| {
        let spread = |i: usize| Spread::of(pairs.iter().map(|pair| pair[i]).collect());
        (!pairs.is_empty()).then(|| [spread(0), spread(1)])
    };
    let (rigid, rigid_truth) = (spreads(&rigid), spreads(&truth));
    let object = (!object.is_empty()).then(|| Spread::of(object));
    Ok(Judged { summary: Summary::of(&presses), rigid, rigid_truth, object, seconds })
}

/// Grasps and frames.
fn counts<'a>(grasps: impl Iterator<Item = &'a str>) -> [usize; 2] {
    let all: Vec<&str> = grasps.collect();
    let grasps: std::collections::BTreeSet<_> = all.iter().collect();
    [grasps.len(), all.len()]
}
