//! What all grasps of a dataset share: bodies, meshes, and the way between them.

use std::path::Path;

use rayon::prelude::*;

use super::{
    config::{Config, Gel, Pads},
    plan::Plan,
    ramp::Ramp,
    record::{Entry, Shard, of_pads},
    tensor::write_whole,
};
use crate::{Result, geometry::Transfer, objects::Object};

/// The pads of every gel.
pub(super) struct Setup {
    gels: Vec<(Pads, Transfer)>,
}

impl Setup {
    /// Builds the pads and writes their meshes into `folder`, where they are missing.
    pub(super) fn new(config: &Config, folder: &Path) -> Result<Self> {
        let pads = |(number, gel): (usize, &Gel)| {
            let pads = gel.pads(config)?;
            let transfer = Transfer::new(pads.truth.body().mesh(), &pads.model.mesh)?;
            let path = folder.join(format!("meshes/{number}.safetensors"));
            if !path.is_file() {
                write_whole(&path, &pads.mesh_file())?;
            }
            Ok((pads, transfer))
        };
        Ok(Self { gels: config.gels.par_iter().enumerate().map(pads).collect::<Result<_>>()? })
    }

    /// The grasp of `object` that `plan` says, as a shard of its own.
    pub(super) fn solve(&self, config: &Config, object: &Object, plan: &Plan) -> Result<Shard> {
        let (pads, transfer) = &self.gels[plan.gel];
        let object = object.shape.clone().validated()?;
        let depth = config.depth * pads.sensor.outline.thickness;
        let ramp = Ramp { frames: config.frames, depth };
        let (frames, error) = ramp.solve(plan, &object, &pads.truth);
        let error = error.map(|error| error.to_string());
        let entry = Entry { plan: plan.clone(), frames: frames.len(), error };
        Ok(Shard::of_grasp(entry, of_pads(&frames, transfer)))
    }

    /// About the bytes of a frame of two pads: fields, and the anchors of the tenth of the contact
    /// points that touch on average.
    pub(super) fn bytes_a_frame(&self) -> u64 {
        let (Pads { model, truth, .. }, _) = &self.gels[0];
        let (nodes, tets) = (model.mesh.vertices.len(), model.mesh.tets.len());
        2 * (24 * nodes + 4 * tets + 20 * (truth.contact_points().len() / 10) + 200) as u64
    }
}
