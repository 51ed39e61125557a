//! Reading of squeezes of soft objects, finished or not.

use std::path::Path;

use nalgebra::{Isometry3, Point3};
use safetensors::{SafeTensorError, SafeTensors};

use super::{
    config::{DatasetConfig, Scenario},
    file::read,
    manifest::Split,
    read::{Dataset, Found, double, pose, single},
    record::Entry,
};
use crate::{Error, Result, geometry::TetMesh, objects::Object};

/// Folder of solved squeezes.
pub struct Squeezes(Dataset);

/// Soft object between two rigid fingers, frame by frame: F frames, V nodes and T tetrahedra of the
/// model mesh.
#[derive(Clone, Debug)]
pub struct SqueezeFrames {
    /// Name of the grasp.
    pub grasp: String,
    /// Index of the gel in the configuration.
    pub gel: usize,
    /// Poses of each finger's face in the object's initial frame, z into the object (F).
    pub fingers: [Vec<Isometry3<f64>>; 2],
    /// Wrench of the object on each finger, in the finger's frame: force and torque (F, 6) in N and
    /// N m.
    pub wrenches: [Vec<f64>; 2],
    /// Displacement (F, V, 3) in m.
    pub displacement: Vec<f32>,
    /// Contact force on the nodes (F, V, 3) in N.
    pub contact_force: Vec<f32>,
    /// Von Mises stress (F, T) in Pa.
    pub von_mises: Vec<f32>,
}

impl Squeezes {
    /// Opens the dataset in `folder`, as [`Dataset::open`] does.
    pub fn open(folder: &Path) -> Result<Self> {
        Dataset::of(folder, &[Scenario::Soft]).map(Self)
    }

    /// Configuration of the dataset.
    pub fn config(&self) -> &DatasetConfig {
        self.0.config()
    }

    /// Split called `name`, or an error that lists the existing ones.
    pub fn split(&self, name: &str) -> Result<&Split> {
        self.0.split(name)
    }

    /// Number of shards.
    pub fn shards(&self) -> usize {
        self.0.shards()
    }

    /// Reads the model mesh of an object.
    pub fn mesh(&self, object: &str) -> Result<TetMesh> {
        let path = self.0.folder().join(format!("meshes/{object}.safetensors"));
        let bad = |error: SafeTensorError| Error::file(&path, error);
        let bytes = read(&path)?;
        let file = SafeTensors::deserialize(&bytes).map_err(bad)?;
        let places = double(&file, "vertices").map_err(bad)?;
        let corners = file.tensor("tets").map_err(bad)?;
        let corners = corners.data().as_chunks().0.iter().map(|b| u32::from_le_bytes(*b));
        let corners: Vec<u32> = corners.collect();
        let vertices = places.as_chunks::<3>().0.iter().map(|&p| Point3::from(p)).collect();
        TetMesh::new(object, vertices, corners.as_chunks::<4>().0.to_vec())
    }

    /// Reads the object and the grasps in shard `index`.
    pub fn read(&self, index: usize) -> Result<(&Object, Vec<SqueezeFrames>)> {
        self.0.solved(index, squeeze)
    }
}

fn squeeze(file: &SafeTensors, entry: &Entry) -> Found<SqueezeFrames> {
    let number = entry.plan.name.rsplit('/').next().unwrap_or_default();
    let field = |what: &str| single(file, &format!("{number}.body.{what}"));
    let of = |finger: &str, what: &str| double(file, &format!("{number}.{finger}.{what}"));
    let poses = |finger: &str| -> Found<Vec<_>> {
        Ok(of(finger, "pose")?.as_chunks::<7>().0.iter().map(pose).collect())
    };
    Ok(SqueezeFrames {
        grasp: entry.plan.name.clone(),
        gel: entry.plan.gel,
        fingers: [poses("first")?, poses("second")?],
        wrenches: [of("first", "wrench")?, of("second", "wrench")?],
        displacement: field("displacement")?,
        contact_force: field("contact_force")?,
        von_mises: field("von_mises")?,
    })
}
