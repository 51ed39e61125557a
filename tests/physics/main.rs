//! Physics of the whole crate against closed forms, one binary.

mod batch;
mod bodies;
mod compliance;
mod fem;
mod floors;
mod grasp;
mod objects;
mod peer;
