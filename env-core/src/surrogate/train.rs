//! Training: batches over threads, a cosine schedule of the learning rate, checkpoints that resume
//! exactly.

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
    features::{Fields, Target},
    material::PadMaterial,
    parameters::{Parameters, Vectors},
};
use crate::{
    Error, Result,
    error::{positive, within},
};

/// A network that can be trained and evaluated.
pub(super) trait Network: Sized + Sync {
    /// Sizes of the network.
    type Config: Clone + Send;
    /// A press and its true solution.
    type Sample: Sync;
    /// Data shared by all samples.
    type Ground: Sync;

    fn new(config: &Self::Config, vb: &VarBuilder) -> candle_core::Result<Self>;

    /// Index of a sample's graph; samples on one graph are computed together.
    fn graph(sample: &Self::Sample) -> usize;

    /// True solution of a sample, in the units of its gel.
    fn target<'a>(
        ground: &'a Self::Ground,
        sample: &'a Self::Sample,
    ) -> (&'a Target, &'a PadMaterial);

    /// Loss on samples of one graph seen in one of its mirrors.
    fn loss(&self, ground: &Self::Ground, samples: &[&Self::Sample], mirror: usize)
    -> Result<Loss>;

    /// Answer to a sample, in the units of [`Target`].
    fn answer(&self, ground: &Self::Ground, sample: &Self::Sample) -> Result<Fields>;
}

/// Loss on a batch.
pub(super) struct Loss {
    /// Scalar that training minimises.
    pub(super) total: Tensor,
    /// Mean errors of its parts.
    pub(super) parts: [f32; 4],
}

/// Signs of x, y and z in mirror 0 to 3: none, x, y, both.
pub(super) fn mirror_signs(mirror: usize) -> [f64; 3] {
    [mirror & 1, mirror >> 1 & 1, 0].map(|flip| if flip == 1 { -1.0 } else { 1.0 })
}

/// Training configuration of a network with sizes `C`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Training<C = CorrectorConfig> {
    /// Seed of weights and batches.
    pub seed: u64,
    /// Split of the dataset to train on.
    pub split: String,
    /// Number of epochs, in each of which every sample is used once.
    pub epochs: usize,
    /// Number of presses per step.
    pub batch: usize,
    /// Highest learning rate.
    pub rate: f64,
    /// Share of the run over which the learning rate rises.
    pub warmup: f64,
    /// Norm to which longer gradients are scaled down.
    pub clip: f64,
    /// Largest number of nodes of the linear model's mesh.
    pub linear_nodes: usize,
    /// True if presses are also used as seen in the pad's mirrors.
    pub mirrors: bool,
    /// Sizes of the network.
    pub network: C,
}

impl<C: Default> Default for Training<C> {
    fn default() -> Self {
        Self {
            seed: 0,
            split: "novel-14".to_owned(),
            epochs: 80,
            batch: 16,
            rate: 2e-3,
            warmup: 0.05,
            clip: 1.0,
            linear_nodes: 2000,
            mirrors: true,
            network: C::default(),
        }
    }
}

impl Training {
    /// Returns this configuration, or an error if a value is out of range.
    pub fn validated(self) -> Result<Self> {
        let CorrectorConfig { width, corner, down, up } = self.network;
        in_range(self.seed, self.rate, self.batch, PIECE)?;
        positive("clip", self.clip)?;
        Budget::of(Some(self.epochs), None)?;
        scaled(width, corner, &[&down[..], &up])?;
        Ok(self)
    }
}

/// Returns an error unless the seed of a training run, its highest learning rate and its number of
/// presses per step, at least `least`, are in range.
pub(super) fn in_range(seed: u64, rate: f64, batch: usize, least: usize) -> Result<()> {
    // The largest integer of TOML, the format of cards.
    if i64::try_from(seed).is_err() {
        return Err(Error::invalid("seed", seed, format!("at most {}", i64::MAX)));
    }
    positive("rate", rate)?;
    within("batch", batch, [least, 4096])
}

/// Returns an error if the sizes of a network of several scales are out of range.
pub(super) fn scaled(width: usize, corner: usize, rounds: &[&[usize]]) -> Result<()> {
    within("width", width, [4, 512])?;
    within("corner", corner, [1, 256])?;
    rounds.iter().copied().flatten().try_for_each(|&rounds| within("rounds", rounds, [0, 16]))
}

impl<C> Training<C> {
    /// Learning rate after a share `done` of the training run.
    fn rate(&self, done: f64) -> f64 {
        let rise = (done / self.warmup.max(1e-9)).min(1.0);
        self.rate * rise * (0.01 + 0.495 * (1.0 + (PI * done).cos()))
    }
}

/// Results of an epoch of training.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Epoch {
    /// Number of epochs so far.
    pub epoch: usize,
    /// Number of steps so far.
    pub steps: u64,
    /// Mean relative errors on the batches; for the corrector, of displacement, stress, nodal
    /// forces and net force.
    pub errors: [f32; 4],
    /// Wall time of the epoch (s).
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

/// Prefixes of the names of first and second moments.
const MOMENTS: [&str; 2] = ["moment-1", "moment-2"];
/// Indices of samples on one graph, which one thread computes, and the index of their mirror.
type Piece = (Vec<usize>, usize);
/// Largest number of samples in a piece.
const PIECE: usize = 4;

impl<N: Network> Trainer<N> {
    pub(super) fn new(training: Training<N::Config>) -> Result<Self> {
        let parameters = Parameters::drawn(training.seed);
        let network = N::new(&training.network, &parameters.builder())?;
        Ok(Self { training, parameters, network, adam: Adam::default(), epoch: 0 })
    }

    /// Weights and moments of the optimiser, by name.
    pub(super) fn vectors(&self) -> Result<Vectors> {
        let mut all = self.parameters.vectors()?;
        for (name, moments) in &self.adam.moments {
            for (which, values) in MOMENTS.iter().zip(moments) {
                all.insert(format!("{which}.{name}"), (vec![values.len()], values.clone()));
            }
        }
        Ok(all)
    }

    /// Restores the state that [`Trainer::vectors`] returned after `epoch` epochs and `steps`
    /// steps.
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

    /// Draws the batches of one epoch.
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

    /// Trains for one epoch over `samples`, or returns `None` once `share` does, with the weights
    /// of an unfinished epoch. `share` is called before each step with the number of steps in the
    /// epoch, and returns the share of the training run that is over.
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

    /// Performs a step at learning rate `rate` and returns the mean errors before it.
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
