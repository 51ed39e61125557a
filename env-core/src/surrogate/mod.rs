//! The surrogate: a graph network in Candle that approximates finite elements on a fine mesh.
//!
//! The linear part of the response is computed, not learnt: linear elasticity with contact on cells
//! is solved first ([`LinearPad`]), and the network corrects its answer on the model mesh
//! ([`Surrogate`]). The network is trained on a dataset ([`train`]) and evaluated on presses outside
//! the training data ([`evaluate`], [`Summary`]).

mod adam;
mod answer;
mod budget;
mod corrector;
mod training_run;
#[cfg(test)]
mod double;
mod extension;
mod fast;
mod features;
mod graph;
mod layers;
mod linear;
mod linear_pad;
mod loss;
mod material;
mod metrics;
mod multi_scale;
mod ops;
pub mod paper;
mod parameters;
mod predicted;
mod run;
mod samples;
mod slip;
pub mod soft;
mod stress_head;
#[cfg(test)]
mod tests;
mod train;
mod trunk;
mod weights;

pub use answer::Surrogate;
pub use corrector::CorrectorConfig;
pub use linear_pad::LinearPad;
pub use metrics::{Evaluated, PressErrors, Spread, Summary};
pub use predicted::ErrorModel;
pub use run::{evaluate, train};
pub use train::{Epoch, Training};
pub use training_run::TrainingProgress;
pub use weights::{Card, Data, TrainingBounds};
