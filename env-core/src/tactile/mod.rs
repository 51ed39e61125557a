//! What a pressed fingertip feels: the pad of a sensor, a model that answers its presses, and the
//! channels that an answer becomes.
//!
//! A [`Finger`] keeps the contact's history and makes a [`Press`](crate::deformation::Press) of what
//! the rigid world did; a [`Model`] answers all presses at once; a [`Channel`] is a pure function of
//! the [`Deformation`](crate::deformation::Deformation) that came back, or of none. Everything is in
//! the frame of the pad: x across, y along, z out of the gel, the origin at its apex.

mod channel;
mod config;
mod depth;
mod finger;
mod model;
mod object;
mod shell;
mod skin;
mod slip;
mod traction;

pub use channel::{Channel, Spec};
pub use config::{Choice, Config, Material, Resolution};
pub use finger::Finger;
pub use model::{Model, Touch};
pub use object::{MARKERS, SoftObject, Squeezed};
pub use shell::Shell;
pub use skin::{Feeling, Felt, Skin, peak_stress};
