//! Files of named tensors with a card, a text that describes them, and a hash of both.
//!
//! A file is safetensors, with the card in its metadata, where it is the only entry, so that the
//! bytes do not depend on an order. The tensor [`HASH`] is the SHA-256 of the card and the other
//! tensors. Files without it, as earlier versions wrote them, are read unchecked.

use std::collections::BTreeMap;

use safetensors::{SafeTensors, serialize};
use sha2::{Digest, Sha256};

pub use safetensors::{Dtype, tensor::TensorView};

/// Metadata key of the card.
const CARD: &str = "card";
/// Name of the tensor that holds the hash (32 bytes).
const HASH: &str = "sha256";

/// Type, shape and little-endian bytes of tensors, by name.
pub type Parts = BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>;

/// Tensors and card of a file whose bytes are those that were written.
pub struct TensorFile<'a> {
    /// Tensors by name, without the hash.
    pub tensors: BTreeMap<String, TensorView<'a>>,
    /// Text that describes them.
    pub card: String,
}

impl<'a> TensorFile<'a> {
    /// Reads a file's `bytes`. Returns what was found if that is no such file, or a damaged one.
    pub fn read(bytes: &'a [u8]) -> Result<Self, String> {
        let part = |error| format!("not a whole .safetensors file ({error})");
        let file = SafeTensors::deserialize(bytes).map_err(part)?;
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(part)?;
        let mut texts = metadata.metadata().clone().unwrap_or_default();
        let Some(card) = texts.remove(CARD) else {
            let is_shard = texts.contains_key("grasps");
            return Err(if is_shard { "a shard of a dataset" } else { "no card" }.to_owned());
        };
        let mut tensors: BTreeMap<_, _> = file.tensors().into_iter().collect();
        let given = tensors.remove(HASH);
        let all =
            tensors.iter().map(|(name, view)| (&**name, view.dtype(), view.shape(), view.data()));
        if given.is_some_and(|given| given.data() != hash(&card, all)) {
            return Err("other bytes than were written, by their SHA-256".to_owned());
        }
        Ok(Self { tensors, card })
    }

    /// Returns the bytes of a file of the tensors `parts`, as many bytes of each as its shape says,
    /// with `card`.
    pub fn to_bytes(mut parts: Parts, card: String) -> Vec<u8> {
        let all =
            parts.iter().map(|(name, (dtype, shape, data))| (&**name, *dtype, &**shape, &**data));
        let hash = hash(&card, all);
        parts.insert(HASH.to_owned(), (Dtype::U8, vec![hash.len()], hash));
        let views = parts.iter().map(|(name, (dtype, shape, data))| {
            let view = TensorView::new(*dtype, shape.clone(), data);
            (name, view.expect("as many bytes as the shape says"))
        });
        serialize(views, Some([(CARD.to_owned(), card)].into())).expect("valid tensors")
    }
}

/// SHA-256 of a `card` and of names, types, shapes and bytes of `tensors`, in the order of names.
fn hash<'t>(
    card: &str,
    tensors: impl Iterator<Item = (&'t str, Dtype, &'t [usize], &'t [u8])>,
) -> Vec<u8> {
    let mut hash = Sha256::new();
    // Lengths first, so that nothing can move from one part to the next.
    let mut add = |bytes: &[u8]| {
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    };
    add(card.as_bytes());
    for (name, dtype, shape, data) in tensors {
        add(name.as_bytes());
        add(format!("{dtype:?} {shape:?}").as_bytes());
        add(data);
    }
    hash.finalize().to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file() -> Vec<u8> {
        let part = |numbers: [f32; 2]| {
            (Dtype::F32, vec![2], numbers.iter().flat_map(|x| x.to_le_bytes()).collect())
        };
        let parts = [("a", part([1.0, 2.0])), ("b", part([0.5, 0.25]))];
        let parts = parts.map(|(name, part)| (name.to_owned(), part)).into();
        TensorFile::to_bytes(parts, "a card".to_owned())
    }

    #[test]
    fn what_is_written_is_read() {
        let bytes = file();
        assert_eq!(bytes, file(), "the same tensors are other bytes");
        let read = TensorFile::read(&bytes).unwrap();
        assert_eq!(read.card, "a card");
        assert_eq!(read.tensors.keys().collect::<Vec<_>>(), ["a", "b"]);
        assert_eq!(read.tensors["b"].data(), [0.5f32, 0.25].map(f32::to_le_bytes).as_flattened());
    }

    #[test]
    fn every_byte_that_changes_is_noticed() {
        let whole = file();
        let good = TensorFile::read(&whole).unwrap();
        for i in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[i] ^= 1;
            // The name of the hash may change, which leaves the rest as it was.
            if let Ok(read) = TensorFile::read(&bytes) {
                assert_eq!(read.card, good.card, "byte {i}");
                for (name, view) in &good.tensors {
                    assert_eq!(&read.tensors[name], view, "byte {i}");
                }
            }
        }
    }
}
