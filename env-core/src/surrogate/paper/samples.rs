//! Frames of a dataset as samples for the paper's networks.

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};

use super::{
    config::Input,
    gels::{Pad, PaperGels},
    patch::{Density, PaperPatch},
    rigid::{self, MOTION},
    scene::PaperPush,
};
use crate::{
    Result,
    dataset::{Dataset, PadFrames},
    objects::Object,
    surrogate::{
        features::Target,
        material::PadMaterial,
        training_run::{self, Watch},
    },
};

/// A solved frame.
pub(super) struct PaperSample {
    /// Index of the gel.
    pub(super) gel: usize,
    /// Name of its grasp.
    pub(super) grasp: String,
    /// The object's surface when it first touched.
    pub(super) patch: Arc<PaperPatch>,
    /// Motion of the object since then, in the pad's frame.
    pub(super) moved: Isometry3<f64>,
    pub(super) target: Target,
    /// Best-fit rigid motion of the gel, in units of its thickness.
    pub(super) rigid: [f32; MOTION],
}

impl PaperGels {
    /// Every frame of `dataset` whose grasp is in one of `parts`, for each part; `None` if `watch`
    /// stops it.
    pub(super) fn samples<const N: usize>(
        &self,
        dataset: &Dataset,
        parts: [&[String]; N],
        density: Density,
        watch: Watch,
    ) -> Result<Option<[Vec<PaperSample>; N]>> {
        let shard = |index: usize| {
            let (object, pads) = dataset.read(index)?;
            Ok(parts.map(|wanted| -> Vec<_> {
                let own = pads.iter().filter(|frames| wanted.contains(&frames.grasp));
                own.flat_map(|frames| self.frames(object, frames, density)).collect()
            }))
        };
        let Some(shards) = training_run::shards(dataset.shards(), shard, watch)? else {
            return Ok(None);
        };
        let mut samples = std::array::from_fn(|_| Vec::new());
        for shard in shards {
            samples.iter_mut().zip(shard).for_each(|(all, own): (&mut Vec<_>, _)| all.extend(own));
        }
        Ok(Some(samples))
    }

    fn frames(&self, object: &Object, frames: &PadFrames, density: Density) -> Vec<PaperSample> {
        let Pad { gel, graph } = &self.pads[frames.gel];
        let touch = graph.touch(&object.shape, frames.poses[0]);
        let surface = object.surface(density.segments());
        let patch = Arc::new(PaperPatch::new(&surface, &touch, graph.half, density));
        let one = |(i, pose): (usize, &Isometry3<f64>)| {
            let target = Target::new(frames, i, graph.columns, gel);
            PaperSample {
                gel: frames.gel,
                grasp: frames.grasp.clone(),
                patch: Arc::clone(&patch),
                moved: pose * touch.inverse(),
                rigid: self.pads[frames.gel].rigid(&target),
                target,
            }
        };
        frames.poses.iter().enumerate().map(one).collect()
    }
}

impl Pad {
    /// The best-fit rigid motion of a displacement, lengths in units of the thickness.
    fn rigid(&self, target: &Target) -> [f32; MOTION] {
        let PadMaterial { thickness, .. } = self.gel;
        let places: Vec<_> = self.graph.places.iter().map(|p| p.coords / thickness).collect();
        let moved = target.displacement.as_chunks::<3>().0.iter();
        let moved: Vec<_> = moved.map(|u| Vector3::from(*u).cast::<f64>()).collect();
        let (rotation, translation) = rigid::best_fit(&places, &moved);
        rigid::numbers(&rotation, &translation)
    }
}

impl PaperSample {
    /// Known quantity of the press, for a network with this `input`.
    pub(super) fn push(&self, input: Input) -> PaperPush {
        match input {
            Input::Translation => PaperPush::Moved(self.moved),
            Input::Force => PaperPush::Force(-f64::from(self.target.force[2])),
        }
    }

    /// Largest displacement, in units of thickness.
    pub(super) fn amplitude(&self) -> f64 {
        let moved = self.target.displacement.as_chunks::<3>().0.iter();
        moved.map(|u| f64::from(Vector3::from(*u).norm())).fold(0.0, f64::max)
    }

    /// Angle (rad) and translation, in units of thickness, of the gel's rigid motion.
    pub(super) fn turned(&self) -> [f64; 2] {
        rigid::apart(&rigid::STILL, &self.rigid)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::{
        compliance::{Compliance, ComplianceOptions},
        deformation::{Moduli, Press},
        geometry::Shape,
        sensor::Sensor,
        surrogate::linear::body,
    };

    /// A ball of 8 mm pressed 0.5 mm into a small pad, answered by `compliance`.
    pub(in super::super) fn pressed_ball() -> (PaperGels, PaperSample) {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let gel = PadMaterial { moduli, friction: 0.8, thickness: sensor.outline.thickness };
        let mesh = sensor.pad(200).unwrap();
        let graph = Arc::new(super::super::gels::Graph::new(&mesh));
        let ball = Shape::Sphere { radius: 8e-3 };
        let pose = Isometry3::translation(0.5e-3, 0.0, 7.5e-3);
        let press = Press::along(vec![ball.clone()], vec![vec![pose]]).unwrap();
        let options = ComplianceOptions { friction: gel.friction, corrections: 0 };
        let compliance = Compliance::new(body(&mesh, moduli).unwrap(), options).unwrap();
        let answer = compliance.solve_path(&press).pop().unwrap().unwrap();
        let flat =
            |v: &[Vector3<f64>]| v.iter().flat_map(|v| [v.x, v.y, v.z]).map(|x| x as f32).collect();
        let frames = PadFrames {
            friction: None,
            start: Isometry3::identity(),
            grasp: "ball/0".into(),
            gel: 0,
            poses: vec![pose],
            displacement: flat(&answer.displacement),
            contact_force: flat(&answer.contact_force),
            von_mises: answer.von_mises.iter().map(|&s| s as f32).collect(),
            wrench: [answer.wrench.force, answer.wrench.torque]
                .iter()
                .flat_map(|v| [v.x, v.y, v.z])
                .collect(),
        };
        let target = Target::new(&frames, 0, graph.columns, &gel);
        let touch = graph.touch(&ball, pose);
        let surface = ball.surface(Density::Coarse.segments()).unwrap();
        let patch = Arc::new(PaperPatch::new(&surface, &touch, graph.half, Density::Coarse));
        let pad = Pad { gel, graph };
        let rigid = pad.rigid(&target);
        let moved = pose * touch.inverse();
        let sample = PaperSample { gel: 0, grasp: frames.grasp, patch, moved, target, rigid };
        (PaperGels { pads: vec![pad] }, sample)
    }

    #[test]
    fn a_press_is_undone_along_the_pads_axis() {
        let (_, sample) = pressed_ball();
        let shift = sample.moved.translation.vector;
        // The crowned face and a ball 0.5 mm off its apex touch within the width of a cell.
        assert!(shift.xy().norm() < 1e-12 && (-6e-4..-3e-4).contains(&shift.z), "{shift}");
    }
}
