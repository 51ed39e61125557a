//! Requests to end a computation early.
//!
//! A press that is solved [`Interrupt::during`] ends with [`Error::Interrupted`] soon after
//! [`Interrupt::request`]: all models check for it before every frame, those that solve frames by
//! load steps before each of these, Newton's method of the finite elements before every step, and
//! the making of a pad's tables between its parts.

use std::{
    cell::RefCell,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use crate::{Error, Result};

thread_local! {
    /// Interrupt of the computation that this thread works on.
    static CURRENT: RefCell<Interrupt> = RefCell::default();
}

/// A request to end a computation, shared by its copies.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicBool>);

/// Puts back the interrupt of the computation that this thread worked on before.
struct Before(Interrupt);

impl Drop for Before {
    fn drop(&mut self) {
        CURRENT.set(std::mem::take(&mut self.0));
    }
}

impl Interrupt {
    /// Requests the end.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Returns whether the end is requested.
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Runs `work` on this thread, obeying this request.
    pub fn during<T>(&self, work: impl FnOnce() -> T) -> T {
        let _before = Before(CURRENT.replace(self.clone()));
        work()
    }

    /// Interrupt of the computation that this thread works on, for other threads that take part.
    pub fn current() -> Self {
        CURRENT.with_borrow(Clone::clone)
    }
}

/// Returns an error if the end of the computation that this thread works on is requested.
pub(crate) fn check() -> Result<()> {
    if CURRENT.with_borrow(Interrupt::is_requested) { Err(Error::Interrupted) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_reaches_the_computation_and_no_other() {
        let interrupt = Interrupt::default();
        interrupt.request();
        assert_eq!(interrupt.during(check), Err(Error::Interrupted));
        assert_eq!(interrupt.during(|| Interrupt::default().during(check)), Ok(()));
        assert_eq!(check(), Ok(()));
    }
}
