//! Named tensors in safetensors files.

use std::{collections::HashMap, path::Path};

use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde::{Serialize, de::DeserializeOwned};

use super::file::read;
use crate::{Error, Result};

/// Numbers with their type and shape.
pub(super) struct Tensor {
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Tensor {
    /// Returns a tensor of 32-bit floats.
    pub(super) fn single(values: impl IntoIterator<Item = f64>, shape: &[usize]) -> Self {
        let bytes = values.into_iter().flat_map(|value| (value as f32).to_le_bytes()).collect();
        Self { dtype: Dtype::F32, shape: shape.to_vec(), bytes }
    }

    pub(super) fn double(values: impl IntoIterator<Item = f64>, shape: &[usize]) -> Self {
        let bytes = values.into_iter().flat_map(f64::to_le_bytes).collect();
        Self { dtype: Dtype::F64, shape: shape.to_vec(), bytes }
    }

    pub(super) fn counts(values: impl IntoIterator<Item = usize>, shape: &[usize]) -> Self {
        let bytes = values.into_iter().flat_map(|value| (value as u32).to_le_bytes()).collect();
        Self { dtype: Dtype::U32, shape: shape.to_vec(), bytes }
    }
}

/// Tensors of a file by name, and metadata of each part of it.
pub(super) struct Tensors<Entry> {
    pub(super) tensors: Vec<(String, Tensor)>,
    pub(super) entries: Vec<Entry>,
}

/// Key of the entries in a file's metadata. It is the only key, so that the order of the bytes is
/// fixed.
const ENTRIES: &str = "grasps";

impl<Entry: Serialize + DeserializeOwned> Tensors<Entry> {
    /// Reads a file; returns an error if it is missing or damaged.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let bytes = read(path)?;
        let found = SafeTensors::deserialize(&bytes).map_err(|error| Error::file(path, error))?;
        let keep = |(name, view): (String, TensorView)| {
            let (dtype, shape) = (view.dtype(), view.shape().to_vec());
            (name, Tensor { dtype, shape, bytes: view.data().to_vec() })
        };
        let tensors = found.tensors().into_iter().map(keep).collect();
        Ok(Self { tensors, entries: entries(path, &bytes)? })
    }

    /// Serialises the tensors; the bytes do not depend on their order.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let views = self.tensors.iter().map(|(name, tensor)| {
            let view = TensorView::new(tensor.dtype, tensor.shape.clone(), &tensor.bytes);
            (name, view.expect("as many bytes as the shape says"))
        });
        let entries = serde_json::to_string(&self.entries).expect("plain data");
        let metadata = HashMap::from([(ENTRIES.to_owned(), entries)]);
        safetensors::serialize(views, Some(metadata)).expect("valid tensors")
    }
}

/// Reads the entries in a file's bytes; returns an error if the file is damaged.
pub(super) fn entries<Entry: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<Vec<Entry>> {
    let bad = |reason: String| Error::file(path, reason);
    SafeTensors::deserialize(bytes)
        .map_err(|error| bad(format!("damaged or truncated, expected a shard ({error})")))?;
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| bad(e.to_string()))?;
    let text = metadata.metadata().as_ref().and_then(|map| map.get(ENTRIES));
    let text = text.ok_or_else(|| bad(format!("no \"{ENTRIES}\" in its metadata")))?;
    serde_json::from_str(text).map_err(|error| bad(error.to_string()))
}
