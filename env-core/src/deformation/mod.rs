//! Input and output of the soft-body models.
//!
//! A [`SoftBody`] is pressed by rigid shapes, as described by a [`Press`]; the result is a
//! [`Deformation`]. Models implement [`DeformationModel`]; those that solve a press by load steps
//! share their subdivision. Everything is in the frame of the soft body, in SI units.
//!
//! Shapes: V nodes of the mesh, T tetrahedra, S rigid shapes, F frames of a path.

mod body;
pub(crate) mod history;
mod load_steps;
mod press;

pub use body::{Law, Moduli, SoftBody};
pub use history::{Anchor, History, ModelIdentity, Numbering};
pub(crate) use load_steps::{
    FrameDrive, NextStep, solve_frames, solve_in_parallel, solve_in_steps,
};
pub use press::{Deformation, DeformationModel, Drive, PredictedError, Press, Wanted, Wrench};
