//! Rows as bytes: a mark with the version, the fingerprint of the settings, a checksum and the row
//! itself.

use std::fs;

use sha2::{Digest, Sha256};

use super::{Row, Setup};
use crate::{Error, Result, task::TaskConfig};

const MARK: [u8; 8] = *b"ruffini5";
const HEADER: usize = 24;

/// First bytes of the SHA-256 of the settings without the time limit, which does not change the
/// state of the bodies, and of the files that they name.
pub(super) fn fingerprint(config: &TaskConfig) -> Result<[u8; 8]> {
    let untimed = TaskConfig { max_episode_steps: 0, ..config.clone() };
    let mut bytes =
        serde_json::to_vec(&untimed).expect("settings came from JSON or validated values");
    for path in config.files() {
        let content = fs::read(path).map_err(|error| Error::file(path, error))?;
        bytes.extend(Sha256::digest(content));
    }
    Ok(digest(&bytes))
}

fn digest(bytes: &[u8]) -> [u8; 8] {
    let hash = Sha256::digest(bytes);
    std::array::from_fn(|i| hash[i])
}

/// Serialises a row and its latest observation (D): everything on which its future depends, except
/// the quantities given for its next starts ([`super::Batch::give`]).
pub(super) fn save(row: &Row, observation: &[f32], setup: &Setup) -> Vec<u8> {
    let body = postcard::to_stdvec(&(row, observation));
    let body = body.expect("a row holds nothing that postcard refuses");
    [&MARK[..], &setup.fingerprint, &digest(&body), &body].concat()
}

/// Restores the row and observation (D) from the result of [`save`]. Returns an error for bytes
/// from other settings or damaged bytes.
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
    let (mut row, observation): (Row, Vec<f32>) =
        postcard::from_bytes(body).map_err(|error| bad(error.to_string()))?;
    let (found, expected) = (observation.len(), setup.layout.size());
    if found != expected {
        return Err(bad(format!("an observation of {found} numbers, expected {expected}")));
    }
    row.attach(setup)?;
    Ok((row, observation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tactile::Choice;

    fn rigid(sensor: &str) -> TaskConfig {
        TaskConfig { tactile: Choice::None, sensor: sensor.into(), ..TaskConfig::default() }
    }

    #[test]
    fn an_observation_of_another_length_is_refused() {
        let (setup, mut row) = (Setup::new(rigid("gelsight-mini")).unwrap(), Row::new(0));
        row.reset(&setup).unwrap();
        let size = setup.layout().size();
        let error = |length: usize| load(&save(&row, &vec![0.0; length], &setup), &setup).err();
        assert_eq!(error(size), None);
        let message = error(size + 1).unwrap().to_string();
        assert!(message.contains(&format!("{} numbers, expected {size}", size + 1)), "{message}");
    }

    #[test]
    fn a_file_with_another_content_makes_other_settings() {
        let path = std::env::temp_dir().join(format!("ruffini-print-{}.toml", std::process::id()));
        let config = rigid(&path.display().to_string());
        let print = |text: &str| {
            fs::write(&path, text).unwrap();
            fingerprint(&config).unwrap()
        };
        let text = crate::sensor::template();
        assert_eq!(print(&text), print(&text));
        assert_ne!(print(&text), print(&text.replace("0.004", "0.005")));
        fs::remove_file(&path).unwrap();
        assert!(fingerprint(&config).is_err());
    }
}
