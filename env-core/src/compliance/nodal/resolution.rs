//! Resolution of contact on cells.

use std::str::FromStr;

use crate::{Error, Result};

/// Number of grids, each with cells half as long as those of the one before.
pub(super) const LEVELS: u32 = 8;

/// Fineness of contact on a body with several grids of cells.
#[derive(Clone, Copy, Debug)]
pub struct ContactResolution {
    /// Most cells that touch on a level unless it is the coarsest.
    pub most: usize,
    /// Number of touching cells below which a finer level is taken. Cells of the next level are
    /// quarters.
    pub few: usize,
    /// Sweeps times the square of the number of nodes that touch, summed over a frame, after which
    /// it counts as not converged.
    pub work: usize,
}

impl ContactResolution {
    /// Resolution for many presses a second. The work is some seconds: the whole pad under a block
    /// 2 mm deep takes a twentieth of it; a wall thinner than the first cells, which touches
    /// thousands of small ones, takes all.
    pub const FAST: Self = Self { most: 96, few: 12, work: 200_000_000 };
    /// Resolution at which displacement and force are within some per cent of their limit, also
    /// under edges; a press takes seconds.
    pub const FINE: Self = Self { most: 800, few: 160, work: 20_000_000_000 };
}

impl FromStr for ContactResolution {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        match name {
            "fast" => Ok(Self::FAST),
            "fine" => Ok(Self::FINE),
            _ => Err(Error::invalid("contact", name, "fast or fine")),
        }
    }
}
