//! Training: batches over threads, a rate that falls with a cosine, checkpoints that resume exactly.

use std::{collections::BTreeMap, f64::consts::PI, time::Instant};

use candle_core::Tensor;
use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    adam::{self, Adam},
    corrector::{Corrector, CorrectorConfig},
    loss::parts,
    parameters::Parameters,
    samples::{Gels, Sample},
};
use crate::{Error, Result};

/// How a network is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Training {
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
    /// Whether presses are also seen in the pad's mirrors.
    pub mirrors: bool,
    /// Sizes of the network.
    pub network: CorrectorConfig,
}

impl Default for Training {
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
            mirrors: true,
            network: CorrectorConfig::default(),
        }
    }
}

impl Training {
    /// This training, if a network can be trained so.
    pub fn validated(self) -> Result<Self> {
        let positive = [("rate", self.rate), ("clip", self.clip)];
        if let Some((name, value)) = positive.iter().find(|(_, x)| !(*x > 0.0 && x.is_finite())) {
            return Err(Error::invalid(*name, value, "a number above 0"));
        }
        let CorrectorConfig { width, corner, down, up } = self.network;
        let rounds = down.iter().chain(&up).copied().max().unwrap_or(0);
        let counts = [
            ("epochs", self.epochs, 1, 100_000),
            ("batch", self.batch, PIECE, 4096),
            ("width", width, 4, 512),
            ("corner", corner, 1, 256),
            ("rounds", rounds, 0, 16),
        ];
        for (name, count, least, most) in counts {
            if !(least..=most).contains(&count) {
                return Err(Error::invalid(name, count, format!("{least} to {most}")));
            }
        }
        Ok(self)
    }

    /// Learning rate at a step of all `steps`.
    fn rate(&self, step: u64, steps: u64) -> f64 {
        let done = (step + 1) as f64 / steps.max(1) as f64;
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
    /// Mean relative errors on the batches: displacement, stress, nodal forces, net force.
    pub errors: [f32; 4],
    /// Wall time of it (s).
    pub seconds: f64,
}

/// A network being trained.
pub(super) struct Trainer {
    pub(super) training: Training,
    pub(super) parameters: Parameters,
    pub(super) network: Corrector,
    pub(super) adam: Adam,
    pub(super) epoch: usize,
}

/// Shapes and values by name.
type Vectors = BTreeMap<String, (Vec<usize>, Vec<f32>)>;
/// What the names of first and second moments begin with.
const MOMENTS: [&str; 2] = ["moment-1", "moment-2"];
/// A part of a batch that one thread computes.
const PIECE: usize = 4;

impl Trainer {
    pub(super) fn new(training: Training) -> Result<Self> {
        let parameters = Parameters::drawn(training.seed);
        let network = Corrector::new(&training.network, &parameters.builder())?;
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
        let missing = |name: &str| Error::Network { reason: format!("{name}: not in the checkpoint") };
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

    /// Batches of one epoch: pieces of sample numbers on one graph, and a mirror for each.
    fn batches(&self, samples: &[Sample]) -> Vec<Vec<(Vec<usize>, usize)>> {
        let mut random = ChaCha8Rng::seed_from_u64(self.training.seed);
        random.set_stream(1 + self.epoch as u64);
        let graphs = 1 + samples.iter().map(|sample| sample.graph).max().unwrap_or(0);
        let mut pieces = Vec::new();
        for graph in 0..graphs {
            let mut own: Vec<usize> =
                (0..samples.len()).filter(|&i| samples[i].graph == graph).collect();
            own.shuffle(&mut random);
            let mirrors = if self.training.mirrors { 4 } else { 1 };
            let cut = own.chunks(PIECE).map(|piece| (piece.to_vec(), random.random_range(0..mirrors)));
            pieces.extend(cut.collect::<Vec<_>>());
        }
        pieces.shuffle(&mut random);
        pieces.chunks((self.training.batch / PIECE).max(1)).map(<[_]>::to_vec).collect()
    }

    /// One epoch over `samples`, or `None` if `go_on`, asked before each step, says no: the weights are
    /// then somewhere within the epoch.
    pub(super) fn epoch(
        &mut self,
        gels: &Gels,
        samples: &[Sample],
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Epoch>> {
        let start = Instant::now();
        let batches = self.batches(samples);
        let all = (batches.len() * self.training.epochs) as u64;
        let variables = self.parameters.all();
        let mut sums = [0.0; 4];
        for batch in &batches {
            if !go_on() {
                return Ok(None);
            }
            let network = &self.network;
            let piece = |(piece, mirror): &(Vec<usize>, usize)| {
                let samples: Vec<&Sample> = piece.iter().map(|&i| &samples[i]).collect();
                let parts = parts(network, &samples, &gels.graphs[samples[0].graph], *mirror)?;
                let store = parts.total()?.backward()?;
                Ok((adam::gradients(&variables, &store)?, parts.values()?))
            };
            let found: Vec<_> = batch.par_iter().map(piece).collect::<Result<_>>()?;
            let (gradients, values): (Vec<_>, Vec<_>) = found.into_iter().unzip();
            let (gradient, norm) = adam::mean(&gradients, self.training.clip);
            if !norm.is_finite() {
                let reason = format!("gradient of norm {norm} after {} steps", self.adam.steps);
                return Err(Error::Network { reason });
            }
            let rate = self.training.rate(self.adam.steps, all);
            self.adam.step(&variables, &gradient, rate)?;
            for value in &values {
                let count = (values.len() * batches.len()) as f32;
                sums.iter_mut().zip(value).for_each(|(sum, value)| *sum += value / count);
            }
        }
        self.epoch += 1;
        let seconds = start.elapsed().as_secs_f64();
        Ok(Some(Epoch { epoch: self.epoch, steps: self.adam.steps, errors: sums, seconds }))
    }
}
