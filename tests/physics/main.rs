//! Physics of the whole crate against closed forms, one binary.

mod grasp;
