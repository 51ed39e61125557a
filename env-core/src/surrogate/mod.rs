//! The surrogate: a graph network in Candle that answers presses as finely meshed finite elements do.
//!
//! What linear elasticity can say is computed and not learnt: `compliance`, condensed on a mesh as fine
//! as the truth's, answers first, and the network corrects its answer on the coarser model mesh
//! ([`Surrogate`]). It learns from a dataset ([`train`]) and is judged on grasps, objects and families
//! that it never saw ([`evaluate`], [`Summary`]).

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
mod loss;
mod metrics;
mod multi_scale;
mod ops;
pub mod paper;
mod parameters;
mod run;
mod samples;
pub mod soft;
mod stress_head;
#[cfg(test)]
mod tests;
mod train;
mod trunk;
mod weights;

pub use answer::Surrogate;
pub use corrector::CorrectorConfig;
pub use linear::Contact;
pub use metrics::{PressErrors, Spread, Summary};
pub use run::{Evaluated, evaluate, train};
pub use train::{Epoch, Training};
pub use training_run::Progress;
pub use weights::{Card, Data, Usual};
