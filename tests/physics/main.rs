//! What must hold for the simulated physics, against closed forms and conservation laws.

mod bodies;
mod fem;
