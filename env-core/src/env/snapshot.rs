//! Rows as bytes: a mark with the version, the fingerprint of the settings, a checksum and the row
//! itself.

use sha2::{Digest, Sha256};

use super::{Row, Setup};
use crate::{Error, Result, task::TaskConfig};

const MARK: [u8; 8] = *b"ruffini4";
const HEADER: usize = 24;

/// First bytes of the SHA-256 of the settings without the time limit, which does not change the
/// state of the bodies. Files are known by their paths alone.
pub(super) fn fingerprint(config: &TaskConfig) -> [u8; 8] {
    let config = TaskConfig { max_episode_steps: 0, ..config.clone() };
    digest(&serde_json::to_vec(&config).expect("settings came from JSON or validated values"))
}

fn digest(bytes: &[u8]) -> [u8; 8] {
    let hash = Sha256::digest(bytes);
    std::array::from_fn(|i| hash[i])
}

/// Serialises a row and its latest observation (D): everything on which its future depends.
pub(super) fn save(row: &Row, observation: &[f32], setup: &Setup) -> Vec<u8> {
    let body = postcard::to_stdvec(&(row, observation));
    let body = body.expect("a row holds nothing that postcard refuses");
    [&MARK[..], &setup.fingerprint, &digest(&body), &body].concat()
}

/// Restores the row and observation from the result of [`save`]. Returns an error for bytes from
/// other settings or damaged bytes.
pub(super) fn load(bytes: &[u8], setup: &Setup) -> Result<(Row, Vec<f32>)> {
    let bad = |reason: String| Error::BadState { reason };
    let Some((header, body)) = bytes.split_at_checked(HEADER) else {
        return Err(bad(format!("{} bytes, expected at least {HEADER}", bytes.len())));
    };
    if header[..8] != MARK {
        return Err(bad("not a snapshot of this version of ruffini".into()));
    }
    if header[8..16] != setup.fingerprint {
        return Err(bad("taken from an environment with other settings".into()));
    }
    if header[16..] != digest(body) {
        return Err(bad("damaged: the checksum does not match".into()));
    }
    let (mut row, observation): (Row, _) =
        postcard::from_bytes(body).map_err(|error| bad(error.to_string()))?;
    row.attach(setup)?;
    Ok((row, observation))
}
