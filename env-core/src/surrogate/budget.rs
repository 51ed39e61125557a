//! Budget of a training run in epochs or time, and the share of it that is spent.

use std::cell::Cell;

use crate::{
    Error, Result,
    error::{positive, within},
};

/// Condition that ends a training run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Budget {
    /// Number of epochs.
    Epochs(usize),
    /// Duration (s).
    Seconds(f64),
}

impl Budget {
    /// Returns the budget from settings that must give exactly one of the two.
    pub(super) fn of(epochs: Option<usize>, seconds: Option<f64>) -> Result<Self> {
        match (epochs, seconds) {
            (Some(epochs), None) => {
                within("epochs", epochs, [1, 100_000]).map(|()| Self::Epochs(epochs))
            }
            (None, Some(seconds)) => positive("seconds", seconds).map(|()| Self::Seconds(seconds)),
            (epochs, seconds) => {
                let found = format!("epochs {epochs:?}, seconds {seconds:?}");
                Err(Error::invalid("budget", found, "epochs or seconds"))
            }
        }
    }

    /// Returns the budget from settings that give one of the two at most; `usual` epochs, which are
    /// filled in, if they give neither.
    pub(super) fn filled(
        epochs: &mut Option<usize>,
        seconds: Option<f64>,
        usual: usize,
    ) -> Result<Self> {
        if seconds.is_none() {
            epochs.get_or_insert(usual);
        }
        Self::of(*epochs, seconds)
    }
}

/// Spent share of a budget, by a clock (s) that matters only if the budget is a duration.
pub(super) struct Pace<'a> {
    budget: Budget,
    clock: &'a dyn Fn() -> f64,
    start: Cell<f64>,
}

impl<'a> Pace<'a> {
    /// Starts the time of a budget.
    pub(super) fn new(budget: Budget, clock: &'a dyn Fn() -> f64) -> Self {
        Self { budget, clock, start: clock().into() }
    }

    /// Time spent (s).
    pub(super) fn elapsed(&self) -> f64 {
        (self.clock)() - self.start.get()
    }

    /// Runs `aside` without counting its time, and returns its result.
    pub(super) fn pause<T>(&self, aside: impl FnOnce() -> T) -> T {
        let begun = (self.clock)();
        let result = aside();
        self.start.set(self.start.get() + (self.clock)() - begun);
        result
    }

    /// Share of the training run that is over after `epoch` epochs.
    pub(super) fn over(&self, epoch: usize) -> f64 {
        match self.budget {
            Budget::Epochs(all) => epoch as f64 / all as f64,
            Budget::Seconds(all) => self.elapsed() / all,
        }
    }

    /// Returns the share of the training run at the next step, after `steps` steps in epochs of
    /// `batches` steps, or `None` if the budget is spent.
    pub(super) fn share(&self, steps: u64, batches: usize) -> Option<f64> {
        match self.budget {
            Budget::Epochs(all) => {
                Some((steps + 1) as f64 / (batches * all) as f64).filter(|share| *share <= 1.0)
            }
            Budget::Seconds(all) => Some(self.elapsed() / all).filter(|share| *share < 1.0),
        }
    }

    /// Returns whether the same budget always ends after the same number of steps.
    pub(super) fn repeats(&self) -> bool {
        matches!(self.budget, Budget::Epochs(_))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_is_of_epochs_or_of_time() {
        assert_eq!(Budget::of(Some(3), None).unwrap(), Budget::Epochs(3));
        assert_eq!(Budget::of(None, Some(0.5)).unwrap(), Budget::Seconds(0.5));
        for (epochs, seconds) in
            [(Some(3), Some(0.5)), (None, None), (Some(0), None), (None, Some(f64::NAN))]
        {
            assert!(Budget::of(epochs, seconds).is_err(), "{epochs:?}, {seconds:?}");
        }
    }

    #[test]
    fn the_last_step_of_the_last_epoch_is_the_last() {
        let pace = Pace::new(Budget::Epochs(3), &|| 0.0);
        assert_eq!(
            [0, 20, 21].map(|steps| pace.share(steps, 7)),
            [Some(1.0 / 21.0), Some(1.0), None]
        );
        assert_eq!([pace.over(2) < 1.0, pace.over(3) < 1.0], [true, false]);
    }

    #[test]
    fn time_aside_is_not_spent() {
        let now = Cell::new(5.0);
        let clock = || now.get();
        let pace = Pace::new(Budget::Seconds(4.0), &clock);
        now.set(6.0);
        pace.pause(|| now.set(100.0));
        assert_eq!(pace.share(0, 1), Some(0.25));
        now.set(103.0);
        assert_eq!(pace.share(9, 1), None);
    }
}
