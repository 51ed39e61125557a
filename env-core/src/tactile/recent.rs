//! The most recently built instances of something that takes long to build.

use std::sync::{Mutex, PoisonError};

use crate::Result;

/// Instances `V`, newest first, with what each was built from.
pub(super) struct Recent<K, V> {
    built: Mutex<Vec<(K, V)>>,
    /// Greatest number of instances kept.
    most: usize,
}

impl<K: Clone + PartialEq, V: Clone> Recent<K, V> {
    /// Keeps `most` instances.
    pub(super) const fn new(most: usize) -> Self {
        Self { built: Mutex::new(Vec::new()), most }
    }

    /// Returns the instance built from `key`, or what `build` returns, which is kept.
    pub(super) fn get(&self, key: &K, build: impl FnOnce() -> Result<V>) -> Result<V> {
        let mut built = self.built.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, instance)) = built.iter().find(|(known, _)| known == key) {
            return Ok(instance.clone());
        }
        let instance = build()?;
        built.insert(0, (key.clone(), instance.clone()));
        built.truncate(self.most);
        Ok(instance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_are_kept_as_said_and_no_failures() {
        let recent = Recent::new(2);
        let build = |key: &u32| recent.get(key, || Ok((*key, key.to_string())));
        for key in [1, 2] {
            assert_eq!(build(&key).unwrap().0, key);
        }
        assert!(recent.get(&3, || Err(crate::Error::NoTrial)).is_err());
        let is_kept = |key: u32| recent.get(&key, || Err(crate::Error::NoTrial)).is_ok();
        assert_eq!([1, 2].map(is_kept), [true, true]);
        build(&3).unwrap();
        assert_eq!([1, 2, 3].map(is_kept), [false, true, true]);
    }
}
