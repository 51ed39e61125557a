//! Physics of the whole crate against closed forms, one binary.

mod approach;
mod batch;
mod bodies;
mod cells;
mod closed_forms;
mod compliance;
mod correction;
mod extremes;
mod feel;
mod fem;
mod floors;
mod foundation;
mod grasp;
mod half_space;
mod imprint;
mod insertion;
mod interrupt;
mod nodal;
mod objects;
mod peer;
mod piercing;
mod sliding;
mod soft;
mod tactile;
mod tasks;
