//! Data shared by all grasps of a dataset: bodies, meshes, and the transfer of fields between them.

use std::{collections::BTreeMap, path::Path};

use nalgebra::Point3;
use rayon::prelude::*;

use super::{
    config::{DatasetConfig, GelConfig, PadModels, Scenario},
    file::write_whole,
    plan::Plan,
    press::PressedPad,
    ramp::Ramp,
    record::{Entry, GraspTensors, mesh_file, of_pads, wrenches},
    squeeze::{Squeeze, of_squeeze},
    weight::Weight,
};
use crate::{Result, fem::Carrier, geometry::TetMesh, objects::Object};

/// Bodies and meshes of the soft side.
pub(super) enum ScenarioBodies {
    /// Pads of every gel.
    Pads(Vec<(PadModels, Carrier)>),
    /// Soft objects by name.
    Soft(BTreeMap<String, Meshes>),
    /// Pads of every gel.
    Presses(Vec<PressedPad>),
}

/// Meshes of a soft object.
pub(super) struct Meshes {
    truth: TetMesh,
    model: TetMesh,
    /// Contact points of the truth mesh.
    points: Vec<Point3<f64>>,
}

impl ScenarioBodies {
    /// Meshes the soft bodies; with `linear`, pads under presses get the models that the
    /// configuration adds to finite elements, which take seconds.
    pub(super) fn new(config: &DatasetConfig, objects: &[&Object], linear: bool) -> Result<Self> {
        let pads = |gel: &GelConfig| {
            let pads = gel.pads(config)?;
            let carrier = Carrier::new(&pads.truth, &pads.model.mesh)?;
            Ok((pads, carrier))
        };
        let soft = |object: &&Object| {
            let truth = object.tets_within(config.truth_nodes)?;
            let model = object.tets_within(config.model_nodes)?;
            let points = config.gels[0].object(truth.clone(), config)?.contact_points();
            Ok((object.name.clone(), Meshes { truth, model, points }))
        };
        let linear = linear && config.truth_linear_nodes > 0;
        let pressed = |gel: &GelConfig| PressedPad::new(gel, config.model_nodes, linear);
        let gels = config.gels.par_iter();
        Ok(match config.scenario {
            Scenario::Pads => Self::Pads(gels.map(pads).collect::<Result<_>>()?),
            Scenario::Presses => Self::Presses(gels.map(pressed).collect::<Result<_>>()?),
            Scenario::Soft => Self::Soft(objects.par_iter().map(soft).collect::<Result<_>>()?),
        })
    }

    /// Writes the meshes on which fields are stored into `folder`, where they are missing.
    pub(super) fn keep(&self, folder: &Path) -> Result<()> {
        let keep = |name: &str, bytes: &dyn Fn() -> Vec<u8>| {
            let path = folder.join(format!("meshes/{name}.safetensors"));
            if path.is_file() { Ok(()) } else { write_whole(&path, &bytes()) }
        };
        match self {
            Self::Pads(gels) => {
                let mut gels = gels.iter().enumerate();
                gels.try_for_each(|(i, (pads, _))| keep(&i.to_string(), &|| pads.mesh_file()))
            }
            Self::Presses(gels) => {
                gels.iter().enumerate().try_for_each(|(i, PressedPad { model, .. })| {
                    keep(&i.to_string(), &|| mesh_file(&model.mesh, &model.base, &[]))
                })
            }
            Self::Soft(objects) => {
                objects.iter().try_for_each(|(name, Meshes { model, points, .. })| {
                    keep(name, &|| mesh_file(model, &[], points))
                })
            }
        }
    }

    /// Solves the grasp `plan` of `object` and returns it as a shard of its own.
    pub(super) fn solve(
        &self,
        config: &DatasetConfig,
        object: &Object,
        plan: &Plan,
    ) -> Result<GraspTensors> {
        let ramp = |length: f64| Ramp { frames: config.frames, depth: config.depth * length };
        let (frames, tensors, error) = match self {
            Self::Pads(gels) => {
                let (pads, carrier) = &gels[plan.gel];
                let weight =
                    Weight::new(object, config.density, &plan.tool, &config.gels[plan.gel]);
                let shape = object.shape.clone().validated()?;
                let ramp = ramp(pads.sensor.outline.thickness);
                let (frames, error) = ramp.solve(plan, &shape, &weight, &pads.truth);
                let mut tensors = of_pads(&frames, carrier);
                if config.density > 0.0 {
                    tensors.push(("load".to_owned(), wrenches(frames.iter().map(|f| &f.load))));
                }
                (frames.len(), tensors, error)
            }
            Self::Presses(gels) => gels[plan.gel].solve(config, &object.shape, plan),
            Self::Soft(objects) => {
                let (meshes, gel) = (&objects[&object.name], &config.gels[plan.gel]);
                let object = gel.object(meshes.truth.clone(), config)?;
                let outline = gel.sensor()?.outline;
                let squeeze = Squeeze { object: &object, outline, ramp: ramp(0.5 * plan.width) };
                let (frames, error) = squeeze.solve(plan);
                let carrier = Carrier::new(&object, &meshes.model)?;
                (frames.len(), of_squeeze(&frames, &carrier), error)
            }
        };
        let error = error.map(|error| error.to_string());
        Ok(GraspTensors::of_grasp(Entry { plan: plan.clone(), frames, error }, tensors))
    }

    /// Approximate size of a frame in bytes: fields, and the anchors of the contact points that
    /// touch, a tenth of them on average.
    pub(super) fn bytes_a_frame(&self) -> u64 {
        let body = |mesh: &TetMesh, points: usize| {
            24 * mesh.vertices.len() + 4 * mesh.tets.len() + 20 * (points / 10) + 200
        };
        let bytes = match self {
            Self::Pads(gels) => {
                let (PadModels { model, truth, .. }, _) = &gels[0];
                2 * body(&model.mesh, truth.contact_points().len())
            }
            Self::Presses(gels) => body(&gels[0].model.mesh, 0),
            Self::Soft(objects) => {
                let sizes = objects.values().map(|meshes| body(&meshes.model, meshes.points.len()));
                sizes.sum::<usize>() / objects.len()
            }
        };
        bytes as u64
    }
}
