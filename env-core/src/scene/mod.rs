//! The rigid world: a parallel-jaw gripper, a table and free bodies, simulated by Rapier: the
//! object to be grasped, and distractors beside it if the task has any.
//!
//! The wrist is kinematic with its origin at the tool centre. Two force-limited fingers slide along
//! its x axis; a spring on their common displacement keeps them centred. The pads and the finger
//! bodies behind them collide with the free bodies only. Contact is rigid with Coulomb friction,
//! except for soft pads ([`Pads::Soft`]), whose faces are an elastic foundation of bristles on a
//! rigid core. A [`Fixture`] is a block with a hole that stands on the table.
//!
//! Rapier computes in decimetres, because parry's tolerances are absolute and suit that scale;
//! everything that enters or leaves this module is SI. The solver's settings are those of
//! [`Physics`].

mod approach;
mod catalogue;
mod collider;
mod config;
mod contact;
mod fixture;
mod foundation;
mod foundation_fit;
mod gripper;
mod held;
mod hull;
mod object;
mod resting;
mod setup;
mod state;
mod units;
mod world;
mod wrist;

pub use approach::{Approach, ApproachFailure};
pub use catalogue::{CATALOGUE, named};
pub use collider::ObjectModel;
pub use config::{
    BoundedNumber, Gripper, MOST_DISTRACTORS, Pads, Physics, SceneConfig, SoftPads, Workspace,
};
pub use fixture::Fixture;
pub use foundation_fit::{FoundationError, FoundationFit, fit_foundation};
pub use object::SceneObject;
pub use state::{BodyState, Failure, FingerState, SceneState, WristState};
pub use world::{Command, Scene};
