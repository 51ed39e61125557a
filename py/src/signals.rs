//! Computations that Ctrl-C ends.

use std::{
    panic::resume_unwind,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

use pyo3::prelude::*;
use ruffini_core::interrupt::Interrupt;

/// Interval between checks for signals.
const POLL: Duration = Duration::from_millis(20);
/// Stack of the thread that computes, as large as that of a main thread (bytes).
const STACK: usize = 8 << 20;

/// Runs `work` without the GIL in another thread, since Python handles signals in its main thread
/// only, which is this one or not. Raises what a signal raises, KeyboardInterrupt for Ctrl-C, once
/// `work` has ended early.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    let (interrupt, done, mut raised) = (Interrupt::default(), AtomicBool::new(false), None);
    let found = thread::scope(|scope| {
        let (obeying, done, waiting) = (interrupt.clone(), &done, thread::current());
        let run = move || {
            let found = obeying.during(work);
            done.store(true, Ordering::Release);
            waiting.unpark();
            found
        };
        let worker = thread::Builder::new().stack_size(STACK).spawn_scoped(scope, run);
        let worker = worker.expect("the system has a thread left");
        // A panic ends the thread without a sign.
        while !done.load(Ordering::Acquire) && !worker.is_finished() {
            py.detach(|| thread::park_timeout(POLL));
            if let Err(error) = py.check_signals() {
                interrupt.request();
                raised.get_or_insert(error);
            }
        }
        py.detach(|| worker.join())
    });
    let found = found.unwrap_or_else(|panic| resume_unwind(panic));
    raised.map_or(Ok(found), Err)
}
