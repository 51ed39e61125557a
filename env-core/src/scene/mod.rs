//! The rigid world: a parallel-jaw gripper, a table and one free object, moved by Rapier.
//!
//! The wrist is kinematic with its origin at the tool centre; two force-limited fingers slide along
//! its x axis and are held centred by a common-mode spring. Pads, and the finger bodies behind
//! them, touch only the object. Contact is rigid with Coulomb friction, but for soft pads
//! ([`Pads::Soft`]), whose faces are a bed of bristles on a rigid core.
//!
//! Rapier works here in decimetres, because parry's tolerances are absolute and suit that scale;
//! everything that enters or leaves this module is SI. The solver's settings are those of
//! [`Physics`]; each names what it is for.

mod approach;
mod bed;
mod catalogue;
mod collider;
mod config;
mod contact;
mod gripper;
mod held;
mod state;
mod units;
mod world;

pub use approach::{Approach, Obstacle};
pub use catalogue::{CATALOGUE, named};
pub use collider::ObjectModel;
pub use config::{Gripper, Object, Pads, Physics, SceneConfig, SoftPads, Workspace};
pub use state::{BodyState, Failure, FingerState, SceneState, Wrench, WristState};
pub use world::{Command, Scene};
