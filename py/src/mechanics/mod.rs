//! Python classes of soft bodies, rigid shapes, presses and the models that solve them.
//!
//! Shapes: V vertices, T tetrahedra, S rigid shapes, F frames of a path, P points. SI units.

mod answer;
pub(crate) mod arrays;
mod body;
mod catalogue;
mod grasp;
mod mesh;
mod model;
mod paper;
pub(crate) mod press;
mod shape;
pub(crate) mod skin;
mod soft;
mod surrogate;
mod transfer;

pub(crate) use answer::{Deformation, History};
pub(crate) use body::{SoftBody, sensor};
pub(crate) use catalogue::{Antipodal, Object, objects};
pub(crate) use grasp::{Grasp, Grasped};
pub(crate) use mesh::TetMesh;
pub(crate) use model::{Compliance, Fem};
pub(crate) use paper::{PaperAnswer, PaperNetwork};
pub(crate) use press::Press;
pub(crate) use shape::Shape;
pub(crate) use skin::Skin;
pub(crate) use soft::SoftSurrogate;
pub(crate) use surrogate::{LinearPad, Surrogate};
pub(crate) use transfer::Transfer;
