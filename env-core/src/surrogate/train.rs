//! Training: batches over threads, a rate that falls with a cosine, checkpoints that resume exactly.

use std::{f64::consts::PI, time::Instant};

use candle_core::Tensor;
use candle_nn::VarBuilder;
use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    adam::{self, Adam},
    budget::Budget,
    corrector::CorrectorConfig,
    features::{Gel, Target},
    linear::Contact,
    metrics::Fields,
    parameters::Parameters,
    weights::Vectors,
};
use crate::{Error, Result};

/// A network that can be trained and judged.
pub(super) trait Network: Sized + Sync {
    /// Its sizes.
    type Config: Clone + Send;
    /// A press and its truth.
    type Sample: Sync;
    /// What samples share.
    type Ground: Sync;

    fn new(config: &Self::Config, vb: &VarBuilder) -> candle_core::Result<Self>;

    /// The graph that a sample lies on; those of one graph are computed together.
    fn graph(sample: &Self::Sample) -> usize;

    /// What a sample's answer should be, in the units of its gel.
    fn truth<'a>(ground: &'a Self::Ground, sample: &'a Self::Sample) -> (&'a Target, &'a Gel);

    /// What training makes small, on samples of one graph seen in one of its mirrors.
    fn loss(&self, ground: &Self::Ground, samples: &[&Self::Sample], mirror: usize)
    -> Result<Loss>;

    /// The answer to a sample's question, in the units of [`Target`].
    fn answer(&self, ground: &Self::Ground, sample: &Self::Sample) -> Result<Fields>;
}

/// What training makes small.
pub(super) struct Loss {
    /// A scalar to go down.
    pub(super) total: Tensor,
    /// Mean errors of its parts.
    pub(super) parts: [f32; 4],
}

/// How a network of sizes `C` is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Training<C = CorrectorConfig> {
    /// What weights and batches are drawn from.
    pub seed: u64,
    /// Split of the dataset to train on.
    pub split: String,
    /// Times that every sample is seen.
    pub epochs: usize,
    /// Presses in a gradient.
    pub batch: usize,
    /// Highest learning rate.
    pub rate: f64,
    /// Share of the steps over which the rate rises.
    pub warmup: f64,
    /// Largest norm of a gradient.
    pub clip: f64,
    /// Nodes of the mesh of the linear model, at most.
    pub linear_nodes: usize,
    /// Where the linear model feels contact.
    pub contact: Contact,
    /// Whether presses are also seen in the pad's mirrors.
    pub mirrors: bool,
    /// Sizes of the network.
    pub network: C,
}

impl<C: Default> Default for Training<C> {
    fn default() -> Self {
        Self {
            seed: 0,
            split: "novel-14".to_owned(),
            epochs: 40,
            batch: 16,
            rate: 2e-3,
            warmup: 0.05,
            clip: 1.0,
            linear_nodes: 2000,
            contact: Contact::default(),
            mirrors: true,
            network: C::default(),
        }
    }
}

impl Training {
    /// This training, if a network can be trained so.
    pub fn validated(self) -> Result<Self> {
        let CorrectorConfig { width, corner, down, up } = self.network;
        positive("rate", self.rate)?;
        positive("clip", self.clip)?;
        seeded(self.seed)?;
        Budget::of(Some(self.epochs), None)?;
        within("batch", self.batch, [PIECE, 4096])?;
        scaled(width, corner, &[&down[..], &up])?;
        Ok(self)
    }
}

/// Whether a setting is a number above 0.
pub(super) fn positive(name: &'static str, value: f64) -> Result<()> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(Error::invalid(name, value, "a number above 0"))
}

/// Whether a setting is between two others, both included.
pub(super) fn within(name: &'static str, count: usize, [least, most]: [usize; 2]) -> Result<()> {
    if (least..=most).contains(&count) {
        return Ok(());
    }
    Err(Error::invalid(name, count, format!("{least} to {most}")))
}

/// Whether a card can tell a seed: TOML has no larger numbers.
pub(super) fn seeded(seed: u64) -> Result<()> {
    if i64::try_from(seed).is_ok() {
        return Ok(());
    }
    Err(Error::invalid("seed", seed, format!("at most {}", i64::MAX)))
}

/// Whether a network of several scales can have such sizes.
pub(super) fn scaled(width: usize, corner: usize, rounds: &[&[usize]]) -> Result<()> {
    within("width", width, [4, 512])?;
    within("corner", corner, [1, 256])?;
    rounds.iter().copied().flatten().try_for_each(|&rounds| within("rounds", rounds, [0, 16]))
}

impl<C> Training<C> {
    /// Learning rate when a share `done` of the training is.
    fn rate(&self, done: f64) -> f64 {
        let rise = (done / self.warmup.max(1e-9)).min(1.0);
        self.rate * rise * (0.01 + 0.495 * (1.0 + (PI * done).cos()))
    }
}

/// An epoch of training.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Epoch {
    /// Epochs so far.
    pub epoch: usize,
    /// Steps so far.
    pub steps: u64,
    /// Mean relative errors on the batches; the corrector's are those of displacement, stress, nodal
    /// forces and net force.
    pub errors: [f32; 4],
    /// Wall time of it (s).
    pub seconds: f64,
}

/// A network being trained.
pub(super) struct Trainer<N: Network> {
    pub(super) training: Training<N::Config>,
    pub(super) parameters: Parameters,
    pub(super) network: N,
    pub(super) adam: Adam,
    pub(super) epoch: usize,
}

/// What the names of first and second moments begin with.
const MOMENTS: [&str; 2] = ["moment-1", "moment-2"];
/// Sample numbers on one graph and the mirror they are seen in, which one thread computes.
type Piece = (Vec<usize>, usize);
/// Samples in a piece, at most.
const PIECE: usize = 4;

impl<N: Network> Trainer<N> {
    pub(super) fn new(training: Training<N::Config>) -> Result<Self> {
        let parameters = Parameters::drawn(training.seed);
        let network = N::new(&training.network, &parameters.builder())?;
        Ok(Self { training, parameters, network, adam: Adam::default(), epoch: 0 })
    }

    /// Weights and the optimiser's moments, by name.
    pub(super) fn vectors(&self) -> Result<Vectors> {
        let mut all = self.parameters.vectors()?;
        for (name, moments) in &self.adam.moments {
            for (which, values) in MOMENTS.iter().zip(moments) {
                all.insert(format!("{which}.{name}"), (vec![values.len()], values.clone()));
            }
        }
        Ok(all)
    }

    /// Goes back to what [`Trainer::vectors`] gave after `epoch` epochs and `steps` steps.
    pub(super) fn restore(&mut self, vectors: &Vectors, epoch: usize, steps: u64) -> Result<()> {
        let missing =
            |name: &str| Error::Network { reason: format!("{name}: not in the checkpoint") };
        for (name, variable) in self.parameters.all() {
            let find = |name: &str| vectors.get(name).ok_or_else(|| missing(name));
            let (shape, values) = find(&name)?;
            let tensor = Tensor::from_slice(values, shape.as_slice(), variable.device())?;
            variable.set(&tensor)?;
            let [first, second] = MOMENTS.map(|which| find(&format!("{which}.{name}")));
            self.adam.moments.insert(name, [first?.1.clone(), second?.1.clone()]);
        }
        (self.epoch, self.adam.steps) = (epoch, steps);
        Ok(())
    }

    /// Batches of one epoch.
    fn batches(&self, samples: &[N::Sample]) -> Vec<Vec<Piece>> {
        let mut random = ChaCha8Rng::seed_from_u64(self.training.seed);
        random.set_stream(1 + self.epoch as u64);
        let graphs = 1 + samples.iter().map(N::graph).max().unwrap_or(0);
        let mut pieces = Vec::new();
        for graph in 0..graphs {
            let mut own: Vec<usize> =
                (0..samples.len()).filter(|&i| N::graph(&samples[i]) == graph).collect();
            own.shuffle(&mut random);
            let mirrors = if self.training.mirrors { 4 } else { 1 };
            let cut = own
                .chunks(PIECE.min(self.training.batch))
                .map(|piece| (piece.to_vec(), random.random_range(0..mirrors)));
            pieces.extend(cut.collect::<Vec<_>>());
        }
        pieces.shuffle(&mut random);
        pieces.chunks((self.training.batch / PIECE).max(1)).map(<[_]>::to_vec).collect()
    }

    /// One epoch over `samples`, or `None` if `share` says none: asked before each step, with the number
    /// of steps in the epoch, for the share of the training that is done. The weights are then somewhere
    /// within the epoch.
    pub(super) fn epoch(
        &mut self,
        ground: &N::Ground,
        samples: &[N::Sample],
        share: &mut dyn FnMut(&Self, usize) -> Result<Option<f64>>,
    ) -> Result<Option<Epoch>> {
        let (start, batches) = (Instant::now(), self.batches(samples));
        let mut errors = [0.0; 4];
        for batch in &batches {
            let Some(share) = share(self, batches.len())? else { return Ok(None) };
            let parts = self.step(ground, samples, batch, self.training.rate(share))?;
            errors.iter_mut().zip(parts).for_each(|(sum, x)| *sum += x / batches.len() as f32);
        }
        self.epoch += 1;
        let seconds = start.elapsed().as_secs_f64();
        Ok(Some(Epoch { epoch: self.epoch, steps: self.adam.steps, errors, seconds }))
    }

    /// A step at learning rate `rate`; the mean errors before it.
    fn step(
        &mut self,
        ground: &N::Ground,
        samples: &[N::Sample],
        batch: &[Piece],
        rate: f64,
    ) -> Result<[f32; 4]> {
        let variables = self.parameters.all();
        let network = &self.network;
        let piece = |(piece, mirror): &Piece| {
            let samples: Vec<_> = piece.iter().map(|&i| &samples[i]).collect();
            let loss = network.loss(ground, &samples, *mirror)?;
            let store = loss.total.backward()?;
            Ok((adam::gradients(&variables, &store)?, loss.parts))
        };
        let found: Vec<_> = batch.par_iter().map(piece).collect::<Result<_>>()?;
        let (gradients, parts): (Vec<_>, Vec<_>) = found.into_iter().unzip();
        let (gradient, norm) = adam::mean(&gradients, self.training.clip);
        if !norm.is_finite() {
            let reason = format!("gradient of norm {norm} after {} steps", self.adam.steps);
            return Err(Error::Network { reason });
        }
        self.adam.step(&variables, &gradient, rate)?;
        let mean = |i: usize| parts.iter().map(|parts| parts[i]).sum::<f32>() / parts.len() as f32;
        Ok(std::array::from_fn(mean))
    }
}
