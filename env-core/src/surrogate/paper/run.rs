//! Training of one of the paper's networks into a folder.

use std::{collections::BTreeMap, path::Path};

use serde::{Deserialize, Serialize};

use super::{
    card::{Judged, PaperCard},
    config::{PaperConfig, PaperTrainingConfig},
    gels::PaperGels,
    judge::{judge_paper, thinned},
    parts::PaperSplit,
    patch::Density,
    samples::PaperSample,
    target::TrainablePaper,
};
use crate::{
    Result,
    dataset::Dataset,
    surrogate::{
        TrainingProgress,
        budget::Pace,
        training_run::{TrainingRun, Watch, trainable},
        weights::{Data, counts, fingerprint},
    },
};

/// One of the paper's networks on the surfaces of objects.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PaperRun {
    /// Variant and size of the network.
    pub network: PaperConfig,
    /// Density of the surfaces that it is trained on.
    pub density: Density,
}

impl Default for PaperRun {
    fn default() -> Self {
        Self { network: PaperConfig::default(), density: Density::Coarse }
    }
}

/// The frames of a training run.
pub(super) struct Frames {
    pub(super) gels: PaperGels,
    pub(super) train: Vec<PaperSample>,
    /// Unseen grasps of known objects, and novel objects.
    pub(super) tests: [(&'static str, Vec<PaperSample>); 2],
}

impl Frames {
    /// Reads the frames that `settings` ask for from `dataset`; `None` if `watch` stops it.
    pub(super) fn read(
        dataset: &Dataset,
        density: Density,
        settings: &PaperTrainingConfig,
        watch: Watch,
    ) -> Result<Option<Self>> {
        let PaperSplit { train, known, novel } = PaperSplit::of(dataset.split(&settings.split)?);
        let gels = PaperGels::new(dataset.config())?;
        let found = gels.samples(dataset, [&train, &known, &novel], density, watch)?;
        Ok(found.map(|[train, known, novel]| {
            let [known, novel] = [known, novel].map(|part| thinned(part, settings.every));
            Self { gels, train, tests: [("known", known), ("novel", novel)] }
        }))
    }

    /// Errors of a network on known and on novel objects; `None` if `watch` stops it.
    pub(super) fn judged(
        &self,
        network: &TrainablePaper,
        clock: &dyn Fn() -> f64,
        watch: Watch,
    ) -> Result<Option<[Judged; 2]>> {
        let [(_, known), (_, novel)] = &self.tests;
        let Some(known) = judge_paper(network, &self.gels, known, clock, watch)? else {
            return Ok(None);
        };
        let novel = judge_paper(network, &self.gels, novel, clock, watch)?;
        Ok(novel.map(|novel| [known, novel]))
    }

    /// Numbers of grasps and frames by part.
    pub(super) fn counts(&self) -> BTreeMap<String, [usize; 2]> {
        let tests = self.tests.iter().map(|(part, test)| (*part, test));
        let parts = tests.chain([("train", &self.train)]);
        parts.map(|(part, all)| (part.to_owned(), counts(all.iter().map(|s| &s.grasp)))).collect()
    }
}

impl PaperRun {
    /// Trains on the dataset in `data` by `settings`, timed by `clock` (s), and writes checkpoints,
    /// weights and their card into `out`; resumes from the last checkpoint there. The
    /// last weights are evaluated, without a choice by validation. `watch` is called at every step
    /// and stops the run by returning false. Returns the card, or `None` if stopped.
    ///
    /// Errors: settings out of range, a dataset that cannot be read, a split without frames, a
    /// checkpoint of another run, a gradient that is not finite.
    pub fn train(
        &self,
        settings: &PaperTrainingConfig,
        data: &Path,
        out: &Path,
        trained_by: &str,
        clock: &dyn Fn() -> f64,
        watch: Watch,
    ) -> Result<Option<PaperCard>> {
        let (settings, network) = (settings.clone().validated()?, self.network.validated()?);
        let dataset = Dataset::open(data)?;
        let Some(frames) = Frames::read(&dataset, self.density, &settings, watch)? else {
            return Ok(None);
        };
        let Frames { gels, train, .. } = &frames;
        trainable(&settings.split, train)?;
        let print = fingerprint(&dataset, dataset.split(&settings.split)?);
        let (training, pace) = (settings.training(network), Pace::new(settings.budget()?, clock));
        let mut run =
            TrainingRun::<TrainablePaper>::resumed(training, &(self, &settings), print, pace, out)?;
        if !watch(&TrainingProgress::Samples { train: train.len(), lost: 0 })
            || !run.run(gels, train, &[], watch)?
        {
            return Ok(None);
        }
        let (network, vectors) = run.chosen()?;
        let Some(judged) = frames.judged(&network, clock, watch)? else { return Ok(None) };
        let card = self.card(&settings, &dataset, &frames, judged, trained_by)?;
        run.finish(&vectors, &card)?;
        Ok(Some(card))
    }

    /// Card of weights trained on `frames`.
    pub(super) fn card(
        &self,
        settings: &PaperTrainingConfig,
        dataset: &Dataset,
        frames: &Frames,
        [known, novel]: [Judged; 2],
        trained_by: &str,
    ) -> Result<PaperCard> {
        let (counts, config) = (frames.counts(), dataset.config());
        let fingerprint = fingerprint(dataset, dataset.split(&settings.split)?);
        Ok(PaperCard {
            variant: self.network.variant.name().to_owned(),
            network: self.network,
            density: self.density,
            model_nodes: config.model_nodes,
            training: settings.clone(),
            data: Data {
                train: counts["train"],
                test: counts["novel"],
                amplitude: frames.train.iter().map(PaperSample::amplitude).fold(0.0, f64::max),
                ..Data::of(config, fingerprint, trained_by)
            },
            known,
            novel,
        })
    }
}
