//! Reading of a dataset, finished or not.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use safetensors::{Dtype, SafeTensorError, SafeTensors, tensor::TensorView};
use serde::Deserialize;

use super::{
    config::{DatasetConfig, Scenario},
    file::{read, sha256, text},
    manifest::{Shard, Split, splits},
    record::Entry,
    tensor::entries,
};
use crate::{
    Error, Result,
    objects::{Object, catalogue},
};

/// Folder of solved grasps.
pub struct Dataset {
    folder: PathBuf,
    config: DatasetConfig,
    objects: Vec<Object>,
    /// Object index and path of each shard, in the order of the catalogue.
    shards: Vec<(usize, PathBuf)>,
    splits: BTreeMap<String, Split>,
}

/// One pad of a grasp, frame by frame: F frames, V nodes and T tetrahedra of the model mesh.
#[derive(Clone, Debug)]
pub struct PadFrames {
    /// Name of the grasp.
    pub grasp: String,
    /// Index of the gel in the configuration.
    pub gel: usize,
    /// Coefficient of friction, if it is not that of the gel.
    pub friction: Option<f64>,
    /// Pose of the object in the pad's frame at first touch.
    pub start: Isometry3<f64>,
    /// Poses of the object in the pad's frame (F).
    pub poses: Vec<Isometry3<f64>>,
    /// Displacement (F, V, 3) in m.
    pub displacement: Vec<f32>,
    /// Contact force on the nodes (F, V, 3) in N.
    pub contact_force: Vec<f32>,
    /// Von Mises stress (F, T) in Pa.
    pub von_mises: Vec<f32>,
    /// Force and torque of all contact (F, 6) in N and N m.
    pub wrench: Vec<f64>,
}

impl Dataset {
    /// Opens the dataset in `folder`. Splits are those of its manifest; for an unfinished dataset
    /// they are derived from the shards that exist.
    pub fn open(folder: &Path) -> Result<Self> {
        Self::of(folder, &[Scenario::Pads, Scenario::Presses])
    }

    /// Opens a dataset as [`Dataset::open`] does; returns an error if it is of none of
    /// these `scenarios`.
    pub(super) fn of(folder: &Path, scenarios: &[Scenario]) -> Result<Self> {
        let path = folder.join("config.json");
        let text = fs::read_to_string(&path).map_err(|error| Error::file(&path, error))?;
        let config = claimed(&text).map_err(|error| Error::file(&path, error))?;
        if !scenarios.contains(&config.scenario) {
            let [found, expected] =
                [config.scenario, scenarios[0]].map(|scenario| match scenario {
                    Scenario::Pads => "grasps by soft pads",
                    Scenario::Soft => "soft objects",
                    Scenario::Presses => "presses of indenters",
                });
            return Err(Error::file(&path, format!("{found}, expected {expected}")));
        }
        let mut objects = match config.scenario {
            Scenario::Pads | Scenario::Soft => catalogue(config.seed),
            Scenario::Presses => config.drawn(),
        };
        objects.extend(config.clone().with_files_in(&folder.join("meshes")).own_objects()?);
        let manifest = finished(&folder.join("manifest.json"))?;
        let mut shards = Vec::new();
        let mut grasps = Vec::new();
        for (number, object) in objects.iter().enumerate() {
            let mut names = Vec::new();
            for part in 0.. {
                let file = format!("shards/{}-{part:03}.safetensors", object.name);
                let path = folder.join(&file);
                let listed = manifest.as_ref().map(|said| said.shard(&file));
                if !path.exists() && !matches!(listed, Some(Some(_))) {
                    break;
                }
                let bytes = read(&path)?;
                if let Some(listed) = listed {
                    check(&path, &bytes, listed)?;
                }
                let solved = entries::<Entry>(&path, &bytes)?.into_iter().filter(|e| e.frames > 0);
                names.extend(solved.map(|entry| entry.plan.name));
                shards.push((number, path));
            }
            if !names.is_empty() {
                grasps.push((object.clone(), names));
            }
        }
        if shards.is_empty() {
            return Err(Error::file(folder.join("shards"), "no shards in it, expected some"));
        }
        let splits = match manifest {
            Some(said) => said.splits,
            None => splits(&config, &grasps),
        };
        Ok(Self { folder: folder.to_owned(), config, objects, shards, splits })
    }

    /// Configuration of the dataset.
    pub fn config(&self) -> &DatasetConfig {
        &self.config
    }

    /// Folder of the dataset.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Split called `name`, or an error that lists the existing ones.
    pub fn split(&self, name: &str) -> Result<&Split> {
        self.splits.get(name).ok_or_else(|| {
            let names: Vec<_> = self.splits.keys().map(String::as_str).collect();
            Error::invalid("split", name, format!("one of {}", names.join(", ")))
        })
    }

    /// Number of shards.
    pub fn shards(&self) -> usize {
        self.shards.len()
    }

    /// Reads the object and all pads of all grasps in shard `index`.
    pub fn read(&self, index: usize) -> Result<(&Object, Vec<PadFrames>)> {
        let (object, pads) = self.solved(index, |file, entry| {
            let sides = if entry.plan.indentation.is_some() { 1 } else { 2 };
            (0..sides).map(|side| pad(file, entry, side)).collect::<Found<Vec<_>>>()
        })?;
        Ok((object, pads.into_iter().flatten().collect()))
    }

    /// Reads the object of shard `index`, and applies `frames` to each of its grasps.
    pub(super) fn solved<T>(
        &self,
        index: usize,
        frames: impl Fn(&SafeTensors, &Entry) -> Found<T>,
    ) -> Result<(&Object, Vec<T>)> {
        let (object, path) = &self.shards[index];
        let bytes = read(path)?;
        let file = SafeTensors::deserialize(&bytes).map_err(|error| Error::file(path, error))?;
        let entries = entries::<Entry>(path, &bytes)?.into_iter().filter(|entry| entry.frames > 0);
        if let Some(name) = not_finite(&file) {
            return Err(Error::file(path, format!("{name} holds NaN, expected finite numbers")));
        }
        let all: Found<_> = entries.map(|entry| frames(&file, &entry)).collect();
        Ok((&self.objects[*object], all.map_err(|error| Error::file(path, error))?))
    }
}

/// Configuration in `config.json`, which also contains the version of the files.
pub(super) fn claimed(text: &str) -> serde_json::Result<DatasetConfig> {
    let mut claim: serde_json::Map<_, _> = serde_json::from_str(text)?;
    claim.remove("format");
    serde_json::from_value(claim.into())
}

/// Part of the manifest of a finished dataset.
#[derive(Deserialize)]
struct Finished {
    shards: Vec<Shard>,
    splits: BTreeMap<String, Split>,
}

impl Finished {
    fn shard(&self, file: &str) -> Option<&Shard> {
        self.shards.iter().find(|shard| shard.file == file)
    }
}

/// Reads a manifest; `None` if there is none.
fn finished(manifest: &Path) -> Result<Option<Finished>> {
    let said = text(manifest)?.map(|text| serde_json::from_str(&text));
    said.transpose().map_err(|error| Error::file(manifest, error))
}

/// Returns an error unless a shard's `bytes` are those that the manifest lists.
fn check(path: &Path, bytes: &[u8], listed: Option<&Shard>) -> Result<()> {
    let Some(listed) = listed else {
        let reason = "not in the manifest, expected the shards of one dataset";
        return Err(Error::file(path, reason));
    };
    let (found, expected) = (bytes.len() as u64, listed.bytes);
    if found < expected {
        let reason = format!("truncated: found {found} bytes, expected {expected}");
        return Err(Error::file(path, reason));
    }
    if sha256(bytes) != listed.sha256 {
        let reason = "damaged or of another dataset: its SHA-256 is not that of the manifest";
        return Err(Error::file(path, reason));
    }
    Ok(())
}

/// Name of a tensor with numbers that are not finite, if there is one.
fn not_finite(file: &SafeTensors) -> Option<String> {
    let finite = |view: &TensorView| match view.dtype() {
        Dtype::F32 => view.data().as_chunks().0.iter().all(|b| f32::from_le_bytes(*b).is_finite()),
        Dtype::F64 => view.data().as_chunks().0.iter().all(|b| f64::from_le_bytes(*b).is_finite()),
        _ => true,
    };
    file.tensors().into_iter().find(|(_, view)| !finite(view)).map(|(name, _)| name)
}

pub(super) type Found<T> = std::result::Result<T, SafeTensorError>;

/// 32-bit numbers of a tensor.
pub(super) fn single(file: &SafeTensors, name: &str) -> Found<Vec<f32>> {
    Ok(file.tensor(name)?.data().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
}

/// 64-bit numbers of a tensor.
pub(super) fn double(file: &SafeTensors, name: &str) -> Found<Vec<f64>> {
    Ok(file.tensor(name)?.data().as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect())
}

fn pad(file: &SafeTensors, entry: &Entry, side: usize) -> Found<PadFrames> {
    let number = entry.plan.name.rsplit('/').next().unwrap_or_default();
    let name = ["first", "second"][side];
    let single = |what: &str| single(file, &format!("{number}.{name}.{what}"));
    let double = |what: &str| double(file, &format!("{number}.{name}.{what}"));
    let poses = |what: &str| -> Found<Vec<_>> {
        Ok(double(what)?.as_chunks::<7>().0.iter().map(pose).collect())
    };
    let start = if entry.plan.indentation.is_some() {
        poses("start")?[0]
    } else {
        let closing = file.tensor(&format!("{number}.closing"))?.data().as_chunks().0[0];
        let closed = entry.plan.closed(&[Isometry3::identity(); 2], f64::from_le_bytes(closing));
        // The object is then at its initial pose, in whose frame the poses of pads are given.
        closed[side] * poses("pose")?[0].inverse()
    };
    Ok(PadFrames {
        start,
        friction: entry.plan.indentation.as_ref().map(|press| press.friction),
        grasp: entry.plan.name.clone(),
        gel: entry.plan.gel,
        poses: poses("press")?,
        displacement: single("displacement")?,
        contact_force: single("contact_force")?,
        von_mises: single("von_mises")?,
        wrench: double("wrench")?,
    })
}

pub(super) fn pose(&[x, y, z, i, j, k, w]: &[f64; 7]) -> Isometry3<f64> {
    let turn = UnitQuaternion::new_normalize(Quaternion::new(w, i, j, k));
    Isometry3::from_parts(Translation3::new(x, y, z), turn)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manifest_that_cannot_be_read_is_not_an_absent_one() {
        let folder = std::env::temp_dir().join(format!("ruffini-manifest-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let manifest = folder.join("manifest.json");
        assert!(matches!(finished(&manifest), Ok(None)));
        // Not UTF-8.
        fs::write(&manifest, [0xff]).unwrap();
        assert!(matches!(finished(&manifest), Err(Error::File { .. })));
        fs::remove_dir_all(&folder).unwrap();
    }
}
