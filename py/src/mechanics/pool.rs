//! The threads that solve presses.

use std::{
    mem, process,
    sync::{Arc, Mutex, PoisonError},
};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::arrays::refused;

/// The pool and the process that started it: a forked child has none of its threads.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// The pool of this process, started at the first call with as many threads as there are cores, or
/// as `RAYON_NUM_THREADS` says.
pub(super) fn pool() -> PyResult<Arc<ThreadPool>> {
    // Nothing panics while the lock is held half-way.
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    match &*pool {
        Some((owner, pool)) if *owner == process::id() => Ok(pool.clone()),
        _ => {
            let started = ThreadPoolBuilder::new().build();
            let started = started.map_err(|error| refused("threads", error, "threads to start"))?;
            let started = Arc::new(started);
            // The parent's pool cannot be dropped here: its threads are not there to be joined.
            mem::forget(pool.replace((process::id(), started.clone())));
            Ok(started)
        }
    }
}
