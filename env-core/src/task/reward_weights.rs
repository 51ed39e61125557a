//! Weights of the terms of a task's reward.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Task;
use crate::{Error, Result};

/// Largest number of terms of a task.
pub(super) const MOST: usize = 8;

/// Relative weights of a task's terms, in its order.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct RewardWeights(pub(super) Vec<f64>);

/// Name of the weights in the settings.
const NAME: &str = "reward_weights";

impl RewardWeights {
    /// Default weights of `task`.
    pub fn of(task: &Task) -> Self {
        let terms = task.terms();
        assert!(terms.len() <= MOST, "{} has more than {MOST} terms", task.name());
        Self(terms.iter().map(|term| term.weight).collect())
    }

    /// Replaces the weights that are `given` by name; returns an error unless all belong to terms
    /// of `task`.
    pub(super) fn set(&mut self, given: &BTreeMap<String, f64>, task: &Task) -> Result<()> {
        for (name, &weight) in given {
            let Some(place) = task.terms().iter().position(|term| term.name == name) else {
                let own: Vec<_> = task.terms().iter().map(|term| term.name).collect();
                let expected = format!("terms of {}: {}", task.name(), own.join(", "));
                return Err(Error::invalid(NAME, name, expected));
            };
            self.0[place] = weight;
        }
        Ok(())
    }

    /// Returns an error unless the weights are finite and not negative, and one is above zero.
    pub(super) fn validate(&self) -> Result<()> {
        let sound = self.0.iter().all(|weight| (0.0..=1e6).contains(weight));
        if sound && self.0.iter().sum::<f64>() > 0.0 {
            return Ok(());
        }
        Err(Error::invalid(NAME, format!("{:?}", self.0), "weights of 0 to 1e6, not all 0"))
    }
}
