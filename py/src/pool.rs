//! Thread pool for whatever runs in parallel, other than the rows of environments.
//!
//! Rayon's own pool is started once a process. A forked child takes it for started and waits for
//! threads that it does not have, so nothing may run in parallel in that one.

use std::{
    mem, process,
    sync::{Arc, Mutex, PoisonError},
};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use ruffini_core::interrupt::Interrupt;

use crate::{mechanics::arrays::refused, signals::interruptible};

/// Pool, with the id of the process that started it: a forked child has none of its threads.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Runs `work` in the pool, without the GIL; Ctrl-C ends it early.
pub(crate) fn in_pool<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    run(py, pool()?.as_ref(), work)
}

/// Performs [`in_pool`] in a pool that ends afterwards, so that functions of Python that `work`
/// calls may use the other one, even if it has a single thread.
pub(crate) fn in_new_pool<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    run(py, &started()?, work)
}

fn run<T: Send>(py: Python<'_>, pool: &ThreadPool, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    interruptible(py, || {
        let interrupt = Interrupt::current();
        pool.install(|| interrupt.during(work))
    })
}

fn started() -> PyResult<ThreadPool> {
    let started = ThreadPoolBuilder::new().build();
    started.map_err(|error| refused("threads", error, "threads to start"))
}

/// Pool of this process, started at the first call with one thread per core, or as many as
/// `RAYON_NUM_THREADS` sets.
fn pool() -> PyResult<Arc<ThreadPool>> {
    // A panic elsewhere cannot leave the value half-written, so a poisoned lock is usable.
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    match &*pool {
        Some((owner, pool)) if *owner == process::id() => Ok(pool.clone()),
        _ => {
            let started = Arc::new(started()?);
            // A forked child cannot drop the parent's pool: its threads do not exist here and
            // cannot be joined.
            mem::forget(pool.replace((process::id(), started.clone())));
            Ok(started)
        }
    }
}
