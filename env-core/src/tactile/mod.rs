//! Touch: the pad of a sensor, the model that solves its presses, and the channels computed from a
//! solution.
//!
//! A [`Finger`] keeps the contact's history and turns the motion of the rigid bodies into a
//! [`Press`](crate::deformation::Press); a [`Model`] solves all presses at once; a [`Channel`] is a
//! pure function of the resulting [`Deformation`](crate::deformation::Deformation), or of its
//! absence. Everything is in the frame of the pad: x across, y along, z out of the gel, the origin
//! at its apex.

mod channel;
mod config;
mod depth;
mod ease;
mod face;
mod finger;
mod image;
mod imprint;
mod lower;
mod model;
mod object;
mod round;
mod shell;
mod skin;
mod smooth_face;
mod traction;

pub use channel::{Channel, Spec};
pub(crate) use config::NODES;
pub use config::{Choice, GelMaterial, Resolution, TactileConfig};
pub use finger::Finger;
pub(crate) use imprint::RaisedFace;
pub use model::{Model, TactileModel, TactilePad};
pub use object::{MARKERS, SoftObject, Squeezed};
pub use shell::Shell;
pub use skin::{PadDeformations, Skin, peak_stress};
