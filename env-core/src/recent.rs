//! Instances of something that takes long to build, shared by all that need the same one.

use std::{
    panic::resume_unwind,
    process,
    sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError, Weak},
    thread,
    time::Duration,
};

use rayon::ThreadPoolBuilder;

use crate::{
    Error, Result,
    interrupt::{self, Interrupt},
};

/// Interval between looks at a turn.
const POLL: Duration = Duration::from_millis(2);

/// Instances `V`, with what each was built from: all that are in use, and the last few that were
/// asked for. What they are built from equals itself: it has no NaN.
///
/// Threads that need the same instance wait for the one that builds it, others do not. Nor does a
/// child that was forked while its parent built: it builds its own.
pub(crate) struct Recent<K, V> {
    instances: Mutex<Instances<K, V>>,
    /// Greatest number of instances kept whether or not they are in use.
    most: usize,
}

struct Instances<K, V> {
    all: Vec<(K, Weak<V>)>,
    /// Instances kept whether or not they are in use, the last that was asked for first.
    last: Vec<Arc<V>>,
    /// Keys of the instances being built, with the process that builds each.
    building: Vec<(K, u32, Arc<Mutex<()>>)>,
}

impl<K: Clone + PartialEq + Sync, V: Send + Sync> Recent<K, V> {
    /// Keeps the `most` instances that were asked for last, whether or not they are in use.
    pub(crate) const fn new(most: usize) -> Self {
        let instances = Instances { all: Vec::new(), last: Vec::new(), building: Vec::new() };
        Self { instances: Mutex::new(instances), most }
    }

    /// Returns the instance built from `key`, or what `build` returns.
    ///
    /// `build` runs [`alone`], since a thread of a pool that waited in it could take up a task that
    /// needs the same instance, and would wait for itself.
    pub(crate) fn get(&self, key: &K, build: impl FnOnce() -> Result<V> + Send) -> Result<Arc<V>> {
        loop {
            let turn = match self.find(key) {
                Ok(found) => return Ok(found),
                Err(turn) => turn,
            };
            let _having_turn = in_turn(&turn)?;
            if !self.instances().is_open(&turn) {
                // Whoever had this turn before is done, or failed.
                continue;
            }
            let built = alone(build).map(Arc::new);
            let mut instances = self.instances();
            instances.building.retain(|(_, _, other)| !Arc::ptr_eq(other, &turn));
            let built = built?;
            instances.all.push((key.clone(), Arc::downgrade(&built)));
            let last = instances.keep(&built, self.most);
            drop(instances);
            drop(last);
            return Ok(built);
        }
    }

    /// Returns the instance built from `key`, or the lock to hold while it is built.
    fn find(&self, key: &K) -> std::result::Result<Arc<V>, Arc<Mutex<()>>> {
        let mut instances = self.instances();
        let found = instances.find(key);
        let last = found.as_ref().ok().map(|found| instances.keep(found, self.most));
        // Frees memory, perhaps much, when others may go on.
        drop(instances);
        drop(last);
        found
    }

    fn instances(&self) -> MutexGuard<'_, Instances<K, V>> {
        unpoisoned(&self.instances)
    }
}

impl<K: Clone + PartialEq, V> Instances<K, V> {
    fn find(&mut self, key: &K) -> std::result::Result<Arc<V>, Arc<Mutex<()>>> {
        self.all.retain(|(_, instance)| instance.strong_count() > 0);
        let known = self.all.iter().find(|(known, _)| known == key);
        if let Some(found) = known.and_then(|(_, instance)| instance.upgrade()) {
            return Ok(found);
        }
        let process = process::id();
        let is_it = |(of, by, _): &&(K, u32, _)| of == key && *by == process;
        if let Some((.., turn)) = self.building.iter().find(is_it) {
            return Err(Arc::clone(turn));
        }
        let turn = Arc::new(Mutex::new(()));
        self.building.push((key.clone(), process, Arc::clone(&turn)));
        Err(turn)
    }

    /// Returns whether an instance is yet to be built in this turn.
    fn is_open(&self, turn: &Arc<Mutex<()>>) -> bool {
        self.building.iter().any(|(.., open)| Arc::ptr_eq(open, turn))
    }

    /// Keeps an instance as the one that was asked for last, and returns those that are no longer
    /// kept.
    fn keep(&mut self, instance: &Arc<V>, most: usize) -> Vec<Arc<V>> {
        self.last.retain(|other| !Arc::ptr_eq(other, instance));
        self.last.insert(0, Arc::clone(instance));
        self.last.split_off(most.min(self.last.len()))
    }
}

/// Locks `mutex`; a panic elsewhere leaves what it guards whole.
fn unpoisoned<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Waits for a turn; an interrupt ends the waiting.
fn in_turn(turn: &Mutex<()>) -> Result<MutexGuard<'_, ()>> {
    loop {
        match turn.try_lock() {
            Ok(guard) => return Ok(guard),
            Err(TryLockError::Poisoned(guard)) => return Ok(guard.into_inner()),
            Err(TryLockError::WouldBlock) => interrupt::check()?,
        }
        thread::sleep(POLL);
    }
}

/// Runs `build` in threads that end afterwards, as many as the caller's pool has, or one if it is
/// called outside of one: a process in which rayon's own threads have started cannot be forked.
fn alone<T: Send>(build: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    let failed = |error: String| Error::invalid("threads", error, "a thread to start");
    let interrupt = Interrupt::current();
    let is_in_pool = rayon::current_thread_index().is_some();
    let threads = if is_in_pool { rayon::current_num_threads() } else { 1 };
    let run = || {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|error| failed(error.to_string()))?;
        pool.install(|| interrupt.during(build))
    };
    thread::scope(|scope| {
        let started = thread::Builder::new().spawn_scoped(scope, run);
        let started = started.map_err(|error| failed(error.to_string()))?;
        started.join().unwrap_or_else(|panic| resume_unwind(panic))
    })
}

#[cfg(test)]
mod tests {
    use std::sync::{
        Barrier,
        atomic::{AtomicUsize, Ordering},
    };

    use super::*;

    #[test]
    fn what_is_in_use_and_the_last_few_are_kept() {
        let recent = Recent::new(2);
        let build = |key: u32| recent.get(&key, || Ok(key)).unwrap();
        let is_kept = |key: u32| recent.get(&key, || Err(Error::NoTrial)).is_ok();
        let first = build(1);
        assert!(!is_kept(4));
        drop([2, 3, 2, 5].map(build));
        assert_eq!([3, 4].map(is_kept), [false; 2]);
        assert_eq!([2, 5].map(is_kept), [true; 2]);
        assert!(Arc::ptr_eq(&first, &build(1)));
        assert_eq!([2, 5].map(is_kept), [false, true]);
        drop(first);
        drop([2, 5].map(build));
        assert!(!is_kept(1));
    }

    #[test]
    fn threads_wait_for_the_same_and_for_no_other() {
        let (recent, built, both) = (Recent::new(2), AtomicUsize::new(0), Barrier::new(2));
        let slow = |key: &u32| {
            let build = || {
                // Both are being built at once, or this waits for ever.
                both.wait();
                thread::sleep(Duration::from_millis(20));
                built.fetch_add(1, Ordering::Relaxed);
                Ok(*key)
            };
            assert_eq!(*recent.get(key, build).unwrap(), *key);
        };
        thread::scope(|scope| {
            for key in [&1, &2, &1, &2, &1] {
                scope.spawn(move || slow(key));
            }
        });
        assert_eq!(built.load(Ordering::Relaxed), 2);
    }

    #[test]
    fn a_failure_ends_no_other_turn() {
        let (recent, tries) = (Recent::new(1), AtomicUsize::new(0));
        let attempt = || {
            thread::sleep(Duration::from_millis(2));
            if tries.fetch_add(1, Ordering::Relaxed) < 3 { Err(Error::NoTrial) } else { Ok(7) }
        };
        let found = thread::scope(|scope| {
            let threads = [(); 8].map(|()| scope.spawn(|| recent.get(&0, attempt).is_ok()));
            threads.map(|thread| thread.join().unwrap())
        });
        assert_eq!(found.iter().filter(|is_ok| !**is_ok).count(), 3);
        assert_eq!(tries.load(Ordering::Relaxed), 4);
        assert!(recent.instances().building.is_empty());
    }

    #[test]
    fn threads_of_a_pool_that_need_the_same_do_not_wait_for_themselves() {
        let recent = Recent::new(1);
        let pool = ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        pool.scope(|scope| {
            for _ in 0..64 {
                let build = || {
                    let all = std::sync::Mutex::new(0);
                    rayon::scope(|scope| {
                        (0..8).for_each(|_| scope.spawn(|_| *unpoisoned(&all) += 1));
                    });
                    Ok(all.into_inner().unwrap())
                };
                let recent = &recent;
                scope.spawn(move |_| assert_eq!(*recent.get(&(), build).unwrap(), 8));
            }
        });
    }

    #[test]
    fn an_interrupt_and_a_panic_reach_who_asked() {
        let recent = Recent::new(1);
        let interrupt = Interrupt::default();
        interrupt.request();
        let checked = || crate::interrupt::check().map(|()| 1);
        assert_eq!(interrupt.during(|| recent.get(&(), checked)), Err(Error::Interrupted));
        let panics = || recent.get(&(), || panic!("a bad mesh"));
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(panics)).is_err());
        assert_eq!(recent.get(&(), checked).as_deref(), Ok(&1));
    }
}
