//! Values as bytes: a mark whose last character counts versions, then postcard. Exact to the bit.

use serde::{Serialize, de::DeserializeOwned};

use crate::{Error, Result};

/// First bytes of a saved value.
pub(crate) type Mark = [u8; 8];

/// Serialises a value of numbers and lists.
pub(crate) fn to_bytes(mark: Mark, value: &impl Serialize) -> Vec<u8> {
    let body = postcard::to_stdvec(value).expect("numbers and lists are what postcard writes");
    [&mark[..], &body].concat()
}

/// Restores a value from the result of [`to_bytes`]; other bytes are an error about `name`.
pub(crate) fn from_bytes<T: DeserializeOwned>(mark: Mark, name: &str, bytes: &[u8]) -> Result<T> {
    let bad = |found: String| Error::invalid(name, found, format!("bytes of a saved {name}"));
    let Some(body) = bytes.strip_prefix(&mark) else {
        return Err(bad(format!("{} bytes without its mark", bytes.len())));
    };
    match postcard::take_from_bytes(body) {
        Ok((value, [])) => Ok(value),
        Ok((_, rest)) => Err(bad(format!("{} bytes too many", rest.len()))),
        Err(error) => Err(bad(format!("damaged bytes ({error})"))),
    }
}
