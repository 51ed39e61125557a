//! Soft objects between two rigid fingers: the paper's first scenario.
//!
//! The linear part of the response is computed, as with pads: the free object, condensed to its
//! skin ([`crate::compliance::Compliance::free`]), settles between the fingers with friction. A
//! graph network on the object's own mesh corrects that answer ([`network`]). Its input is in the
//! frame of the grip ([`grip`]), in units of the object's size and stiffness, and the mesh enters
//! as a graph ([`graph`]): one network serves all objects.

mod answer;
mod fast;
mod graph;
mod grip;
mod input;
mod linear;
mod network;
mod samples;
mod training;

pub use answer::SoftSurrogate;
pub use network::SoftConfig;
pub use training::{SoftCard, SoftErrors, SoftTrainingConfig};
