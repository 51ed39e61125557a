//! Solved grasps as named tensors, and shards of them as files.
//!
//! F frames, V nodes and T tetrahedra of the model mesh, A anchors of all frames; 32-bit floats for
//! fields, 64-bit ones for poses (position, then quaternion x, y, z, w) and forces. Tensors of grasp
//! `007` begin with `007.`, those of its pads go on with `first.` or `second.`.

use std::{collections::HashMap, fs, path::Path};

use nalgebra::{Isometry3, Point3, Vector3};
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde::{Deserialize, Serialize};

use super::{config::Pads, plan::Plan, ramp::Frame};
use crate::{Error, Result, geometry::Transfer};

/// What a shard says of a grasp besides its tensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Entry {
    /// What was to be solved.
    pub(super) plan: Plan,
    /// Frames that were.
    pub(super) frames: usize,
    /// What ended it early.
    pub(super) error: Option<String>,
}

/// Key of the entries in a shard's metadata: there is one key, so its bytes have one order.
const ENTRIES: &str = "grasps";

/// Numbers with a shape.
struct Tensor {
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Tensor {
    /// Rows of `row` numbers each, kept with 32 bits.
    fn single(values: impl Iterator<Item = f64>, shape: &[usize]) -> Self {
        let bytes = values.flat_map(|value| (value as f32).to_le_bytes()).collect();
        Self { dtype: Dtype::F32, shape: shape.to_vec(), bytes }
    }

    fn double(values: impl Iterator<Item = f64>, shape: &[usize]) -> Self {
        let bytes = values.flat_map(f64::to_le_bytes).collect();
        Self { dtype: Dtype::F64, shape: shape.to_vec(), bytes }
    }

    fn counts(values: impl Iterator<Item = usize>, shape: &[usize]) -> Self {
        let bytes = values.flat_map(|value| (value as u32).to_le_bytes()).collect();
        Self { dtype: Dtype::U32, shape: shape.to_vec(), bytes }
    }
}

/// A shard being filled.
#[derive(Default)]
pub(super) struct Shard {
    tensors: Vec<(String, Tensor)>,
    entries: Vec<Entry>,
}

impl Shard {
    /// Adds a grasp; its fields are carried from the truth mesh to the model mesh.
    pub(super) fn add(&mut self, entry: Entry, frames: &[Frame], pads: &Pads, transfer: &Transfer) {
        let number = entry.plan.name.rsplit('/').next().unwrap_or_default().to_owned();
        let count = frames.len();
        let mut put = |name: &str, tensor| self.tensors.push((format!("{number}.{name}"), tensor));
        put("force", Tensor::double(frames.iter().map(|f| f.force), &[count]));
        put("closing", Tensor::double(frames.iter().map(|f| f.closing), &[count]));
        put("residual", Tensor::double(frames.iter().map(|f| f.grasped.residual), &[count]));
        let object = frames.iter().flat_map(|f| pose(&f.grasped.object));
        put("object", Tensor::double(object, &[count, 7]));
        for (side, name) in ["first", "second"].into_iter().enumerate() {
            for (what, tensor) in pad_tensors(frames, side, pads, transfer) {
                put(&format!("{name}.{what}"), tensor);
            }
        }
        self.entries.push(entry);
    }

    /// Writes the shard whole or not at all.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let views = self.tensors.iter().map(|(name, tensor)| {
            let view = TensorView::new(tensor.dtype, tensor.shape.clone(), &tensor.bytes);
            (name, view.expect("as many bytes as the shape says"))
        });
        let entries = serde_json::to_string(&self.entries).expect("plain data");
        let metadata = HashMap::from([(ENTRIES.to_owned(), entries)]);
        let bytes = safetensors::serialize(views, Some(metadata)).expect("valid tensors");
        write_whole(path, &bytes)
    }
}

fn pad_tensors(
    frames: &[Frame],
    side: usize,
    pads: &Pads,
    transfer: &Transfer,
) -> Vec<(&'static str, Tensor)> {
    let count = frames.len();
    let [nodes, tets] = [pads.model.mesh.vertices.len(), pads.model.mesh.tets.len()];
    let pad = |frame: &Frame| frame.grasped.pads[side].clone();
    let all =
        |field: &dyn Fn(&Frame) -> Vec<f64>| frames.iter().flat_map(field).collect::<Vec<_>>();
    let flat = |vectors: Vec<Vector3<f64>>| {
        vectors.iter().flat_map(|v| [v.x, v.y, v.z]).collect::<Vec<f64>>()
    };
    let displacement = all(&|f| flat(transfer.interpolate(&pad(f).displacement)));
    let force = all(&|f| flat(transfer.spread(&pad(f).contact_force)));
    let stress = all(&|f| transfer.average(&pad(f).von_mises));
    let wrench = all(&|f| {
        let wrench = pad(f).wrench;
        flat(vec![wrench.force, wrench.torque])
    });
    let pressed = all(&|f| pose(&pad(f).poses[0]).to_vec());
    let placed = all(&|f| pose(&f.pads[side]).to_vec());
    let rest = pads.truth.contact_points();
    let place = |p: Point3<f64>| [p.x, p.y, p.z];
    let anchors: Vec<_> = frames.iter().map(|f| pad(f).history.anchors).collect();
    let each = || anchors.iter().flatten();
    let total = each().count();
    let from = each().flat_map(|anchor| place(rest[anchor.point as usize]));
    let at = each().flat_map(|anchor| place(anchor.place));
    vec![
        ("displacement", Tensor::single(displacement.into_iter(), &[count, nodes, 3])),
        ("contact_force", Tensor::single(force.into_iter(), &[count, nodes, 3])),
        ("von_mises", Tensor::single(stress.into_iter(), &[count, tets])),
        ("wrench", Tensor::double(wrench.into_iter(), &[count, 6])),
        ("press", Tensor::double(pressed.into_iter(), &[count, 7])),
        ("pose", Tensor::double(placed.into_iter(), &[count, 7])),
        ("iterations", Tensor::counts(frames.iter().map(|f| pad(f).iterations), &[count])),
        ("residual", Tensor::double(frames.iter().map(|f| pad(f).residual), &[count])),
        ("anchors", Tensor::counts(anchors.iter().map(Vec::len), &[count])),
        ("anchor_rest", Tensor::double(from, &[total, 3])),
        ("anchor_place", Tensor::double(at, &[total, 3])),
    ]
}

fn pose(pose: &Isometry3<f64>) -> [f64; 7] {
    let (p, q) = (pose.translation, pose.rotation);
    [p.x, p.y, p.z, q.i, q.j, q.k, q.w]
}

/// The model mesh of a gel: `vertices` (V, 3) in m, `tets` (T, 4), and `fixed` nodes.
pub(super) fn write_mesh(path: &Path, pads: &Pads) -> Result<()> {
    let mesh = &pads.model.mesh;
    let places = mesh.vertices.iter().flat_map(|p| [p.x, p.y, p.z]);
    let corners = mesh.tets.iter().flatten().map(|&i| i as usize);
    let base = pads.model.base.iter().map(|&i| i as usize);
    let tensors = [
        ("vertices", Tensor::double(places, &[mesh.vertices.len(), 3])),
        ("tets", Tensor::counts(corners, &[mesh.tets.len(), 4])),
        ("fixed", Tensor::counts(base, &[pads.model.base.len()])),
    ];
    let views = tensors.iter().map(|(name, tensor)| {
        let view = TensorView::new(tensor.dtype, tensor.shape.clone(), &tensor.bytes);
        (*name, view.expect("as many bytes as the shape says"))
    });
    write_whole(path, &safetensors::serialize(views, None).expect("valid tensors"))
}

/// The entries of a shard's bytes, or an error if it is damaged.
pub(super) fn entries(path: &Path, bytes: &[u8]) -> Result<Vec<Entry>> {
    let bad = |reason: String| Error::File { path: path.display().to_string(), reason };
    SafeTensors::deserialize(bytes).map_err(|error| bad(error.to_string()))?;
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| bad(e.to_string()))?;
    let text = metadata.metadata().as_ref().and_then(|map| map.get(ENTRIES));
    let text = text.ok_or_else(|| bad(format!("no \"{ENTRIES}\" in its metadata")))?;
    serde_json::from_str(text).map_err(|error| bad(error.to_string()))
}

/// Writes a file so that it is there whole or not at all, whenever the process is killed.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let failed = |error: std::io::Error| Error::File {
        path: path.display().to_string(),
        reason: error.to_string(),
    };
    let partial = path.with_extension("partial");
    let write = || {
        use std::io::Write;
        let mut file = fs::File::create(&partial)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&partial, path)
    };
    write().map_err(failed)
}
