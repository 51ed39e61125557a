//! The paper's networks: MeshGraphNets (Pfaff et al. 2021) as `DefGraspNets` (Huang et al. 2023)
//! use them on grasps, in the three variants of the paper's ablation.
//!
//! - Baseline: nodes and edges; stress is decoded at nodes (averaged to tetrahedra, where it is
//!   evaluated).
//! - A: tetrahedra receive messages from their corners, t' = f(t, {v}) + t, and send none back;
//!   stress is decoded at them.
//! - B: in addition, a global feature is updated by all nodes, g' = f(mean v) + g, and enters the
//!   update of every node, v' = f(v, Σ e, g) + v; it is decoded into the gel's best-fit rigid
//!   motion. A bonded gel hardly moves as a whole, so that motion is small here.
//!
//! They are trained on the same frames as the corrector, by its trainer and nearly its loss,
//! without linear solutions as input. None of them has contact forces as output: [`PaperNetwork`]
//! has displacement, stress and, of B, rigid motion. [`PaperRun`] trains one;
//! [`PaperTrainingConfig`] compares them at equal budgets.

mod answer;
mod blocks;
mod card;
mod config;
mod gels;
mod run;
mod judge;
mod network;
mod parts;
mod patch;
mod rigid;
mod samples;
mod scene;
mod training;
mod target;

pub use answer::{PaperAnswer, PaperNetwork};
pub use card::{Judged, PaperCard};
pub use config::{Input, PaperConfig, PaperTrainingConfig, Variant};
pub(super) use judge::evaluate;
pub use patch::Density;
pub use run::PaperRun;
pub use training::{PaperWeights, Point, Report, Run};
