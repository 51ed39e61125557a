//! Computations that Ctrl-C ends.

use std::{
    panic::resume_unwind,
    sync::mpsc::{RecvTimeoutError, channel},
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
    let (interrupt, mut raised) = (Interrupt::default(), None);
    let found = thread::scope(|scope| {
        let (done, ended) = channel();
        let obeying = interrupt.clone();
        let run = move || {
            let found = obeying.during(work);
            // Nobody listens if this thread has panicked.
            let _ = done.send(());
            found
        };
        let worker = thread::Builder::new().stack_size(STACK).spawn_scoped(scope, run);
        let worker = worker.expect("the system has a thread left");
        loop {
            let waited = py.detach(|| ended.recv_timeout(POLL));
            if let Err(error) = py.check_signals() {
                interrupt.request();
                raised.get_or_insert(error);
            }
            if waited != Err(RecvTimeoutError::Timeout) {
                break py.detach(|| worker.join());
            }
        }
    });
    let found = found.unwrap_or_else(|panic| resume_unwind(panic));
    raised.map_or(Ok(found), Err)
}
