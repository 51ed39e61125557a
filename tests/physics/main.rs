//! Physics of the whole crate against closed forms, one binary.

mod batch;
mod floors;
mod grasp;
