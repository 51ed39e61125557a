//! Storage of condensed bodies on disk.
//!
//! Each body has one file, named after the SHA-256 of its mesh, moduli, fixed nodes and the version
//! of this format. The file holds that hash, the SHA-256 of the numbers, and the numbers
//! (little-endian f64). If it is missing, damaged or of another length, the numbers are computed
//! and stored. A file is written under a temporary name and then renamed, so that no reader sees an
//! incomplete one.

use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
};

use sha2::{Digest, Sha256};

use crate::{Error, Result, deformation::SoftBody};

/// Version of the stored numbers; it changes with the format, the element or the stiffness.
const VERSION: &str = "ruffini compliance 1: p1-bar at rest";

type Hash = [u8; 32];

/// File of one body's compliance in a directory.
pub(super) struct Stored {
    key: Hash,
    path: PathBuf,
}

impl Stored {
    pub(super) fn of(body: &SoftBody, directory: &Path) -> Self {
        let key = key(body);
        let [.., name] = key.as_chunks::<8>().0 else { unreachable!("a hash has 32 bytes") };
        let name = u64::from_be_bytes(*name);
        Self { key, path: directory.join(format!("compliance-{name:016x}.bin")) }
    }

    /// Returns the `count` stored numbers, or those of `compute`, which it then stores.
    pub(super) fn read_or_compute(
        &self,
        count: usize,
        compute: impl FnOnce() -> Vec<f64>,
    ) -> Result<Vec<f64>> {
        if let Some(values) = self.read(count) {
            return Ok(values);
        }
        let values = compute();
        self.write(&values).map_err(|error| Error::file(&self.path, error))?;
        Ok(values)
    }

    fn read(&self, count: usize) -> Option<Vec<f64>> {
        let bytes = fs::read(&self.path).ok()?;
        let (key, rest) = bytes.split_first_chunk::<32>()?;
        let (hash, numbers) = rest.split_first_chunk::<32>()?;
        let sound = *key == self.key && numbers.len() == 8 * count && *hash == digest(numbers);
        let (numbers, _) = numbers.as_chunks::<8>();
        sound.then(|| numbers.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
    }

    fn write(&self, values: &[f64]) -> io::Result<()> {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let directory = self.path.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(directory)?;
        // Several processes may write at once: each has a file of its own until it is complete.
        let unfinished = self.path.with_extension(format!("{}.part", std::process::id()));
        let mut file = fs::File::create(&unfinished)?;
        file.write_all(&self.key)?;
        file.write_all(&digest(&bytes))?;
        file.write_all(&bytes)?;
        file.sync_all()?;
        fs::rename(&unfinished, &self.path)
    }
}

fn digest(bytes: &[u8]) -> Hash {
    Sha256::digest(bytes).into()
}

fn key(body: &SoftBody) -> Hash {
    let mut hash = Sha256::new();
    hash.update(VERSION);
    let mesh = body.mesh();
    for count in [mesh.vertices.len(), mesh.tets.len(), body.fixed().len()] {
        hash.update((count as u64).to_le_bytes());
    }
    let moduli = body.moduli().iter().flat_map(|m| [m.young, m.poisson]);
    let places = mesh.vertices.iter().flat_map(|place| place.coords.iter().copied());
    for number in places.chain(moduli) {
        hash.update(number.to_le_bytes());
    }
    for node in mesh.tets.as_flattened().iter().chain(body.fixed()) {
        hash.update(node.to_le_bytes());
    }
    hash.finalize().into()
}
