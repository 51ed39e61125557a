//! The question that every soft-body model answers, and the answer.
//!
//! A [`SoftBody`] is pressed by rigid shapes: a [`Press`]. The answer is a [`Deformation`]. Whoever
//! can answer implements [`DeformationModel`]. Everything is in the frame of the soft body, SI units.
//!
//! Shapes: V nodes of the mesh, T tetrahedra, S rigid shapes, F frames of a path.

mod body;
mod history;
mod press;

pub use body::{Law, Moduli, SoftBody};
pub use history::{Anchor, History};
pub use press::{Deformation, DeformationModel, Drive, Press, Wanted, Wrench};
