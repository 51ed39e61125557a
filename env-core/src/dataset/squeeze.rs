//! Soft object squeezed by two rigid fingers and held by their friction alone.
//!
//! The fingers are boxes with the outline of a sensor's pad. They close as the pads do on a rigid
//! object ([`super::ramp`]). The object is a free body; its shape and pose result from equilibrium.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    plan::Plan,
    ramp::{Ramp, touching},
    record::{Named, of_bodies, pose, wrenches},
    tensor::Tensor,
};
use crate::{
    Error, Result,
    deformation::{Deformation, History, Press, Wrench},
    fem::{Carrier, Fem},
    geometry::{PadOutline, RigidFit, Shape},
};

/// Solved frame of a squeeze. Poses are in the object's initial frame.
pub(super) struct SqueezeFrame {
    /// Closing of each finger since first touch (m).
    closing: f64,
    /// Mean force of the fingers along their normals (N).
    force: f64,
    /// Poses of the fingers' frames: origin at the middle of the face, z into the object.
    fingers: [Isometry3<f64>; 2],
    /// Wrench of the object on each finger, in the finger's frame.
    wrenches: [Wrench; 2],
    /// Rigid motion closest to the object's.
    motion: RigidFit,
    body: Deformation,
}

/// Squeeze to be solved.
pub(super) struct Squeeze<'a> {
    /// Finite-element model of the object.
    pub(super) object: &'a Fem,
    /// Outline of the fingers' faces, which are flat.
    pub(super) outline: PadOutline,
    pub(super) ramp: Ramp,
}

impl Squeeze<'_> {
    /// Solves the frames of `plan`; returns them with the error that ended the squeeze before its
    /// force, depth or last frame.
    pub(super) fn solve(&self, plan: &Plan) -> (Vec<SqueezeFrame>, Option<Error>) {
        let (finger, points) = (self.finger(), self.object.contact_points());
        let gap = |face: &Isometry3<f64>| {
            let pose = self.pose(face);
            let distance =
                |p: &Point3<f64>| finger.distance(&pose.inverse_transform_point(p)).value;
            points.iter().map(distance).fold(f64::INFINITY, f64::min)
        };
        let touching = match touching(plan, gap) {
            Ok(touching) => touching,
            Err(error) => return (Vec::new(), Some(error)),
        };
        let mut history = None;
        self.ramp.climb(plan.force, |closing| {
            let fingers = plan.closed(&touching, closing);
            let body = self.squeezed(&fingers, history.take())?;
            history = Some(body.history.clone());
            let frame = self.frame(closing, fingers, body)?;
            Ok((frame.force, frame))
        })
    }

    fn finger(&self) -> Shape {
        let PadOutline { width, length, thickness, .. } = self.outline;
        Shape::Cuboid { half_extents: 0.5 * Vector3::new(width, length, thickness) }
    }

    /// Pose of a finger's box whose face is at `face`.
    fn pose(&self, face: &Isometry3<f64>) -> Isometry3<f64> {
        face * Isometry3::translation(0.0, 0.0, -0.5 * self.outline.thickness)
    }

    fn squeezed(&self, faces: &[Isometry3<f64>; 2], from: Option<History>) -> Result<Deformation> {
        let poses = faces.iter().map(|face| self.pose(face)).collect();
        let press = Press::along(vec![self.finger(); 2], vec![poses])?;
        let press = match from {
            Some(history) => press.after(history)?,
            None => press,
        };
        self.object.solve_path(&press).pop().expect("a press has a frame or an error")
    }

    fn frame(
        &self,
        closing: f64,
        fingers: [Isometry3<f64>; 2],
        body: Deformation,
    ) -> Result<SqueezeFrame> {
        let rest = &self.object.body().mesh().vertices;
        let moved: Vec<_> = rest.iter().zip(&body.displacement).map(|(p, u)| p + u).collect();
        let wrenches = shares(&fingers, &moved, &body.contact_force);
        let force = -0.5 * (wrenches[0].force.z + wrenches[1].force.z);
        let motion = RigidFit::new(rest, &moved)?;
        Ok(SqueezeFrame { closing, force, fingers, wrenches, motion, body })
    }
}

/// Wrench of the object on each finger. Every node's contact force is assigned to the nearer
/// finger: a node could touch both only if it were within an element of either.
fn shares(
    faces: &[Isometry3<f64>; 2],
    places: &[Point3<f64>],
    forces: &[Vector3<f64>],
) -> [Wrench; 2] {
    let mut wrenches = [Wrench::default(); 2];
    for (place, force) in places.iter().zip(forces).filter(|(_, f)| **f != Vector3::zeros()) {
        let seen = faces.map(|face| face.inverse_transform_point(place));
        let nearer = usize::from(seen[1].z.abs() < seen[0].z.abs());
        let force = -(faces[nearer].rotation.inverse() * force);
        wrenches[nearer].add_force(&force, &seen[nearer].coords);
    }
    wrenches
}

/// Tensors of a squeeze. Names of those of the object begin with `body.`, of those of the fingers
/// with `first.` or `second.`.
pub(super) fn of_squeeze(frames: &[SqueezeFrame], carrier: &Carrier) -> Named {
    let count = frames.len();
    let number =
        |field: fn(&SqueezeFrame) -> f64| Tensor::double(frames.iter().map(field), &[count]);
    let motion = frames.iter().flat_map(|f| pose(&f.motion.motion));
    let mut tensors = vec![
        ("force".to_owned(), number(|f| f.force)),
        ("closing".to_owned(), number(|f| f.closing)),
        ("motion".to_owned(), Tensor::double(motion, &[count, 7])),
        ("deviation".to_owned(), number(|f| f.motion.residual)),
    ];
    for (side, name) in ["first", "second"].into_iter().enumerate() {
        let placed = frames.iter().flat_map(|f| pose(&f.fingers[side]));
        tensors.push((format!("{name}.pose"), Tensor::double(placed, &[count, 7])));
        let all = frames.iter().map(|f| &f.wrenches[side]);
        tensors.push((format!("{name}.wrench"), wrenches(all)));
    }
    let bodies: Vec<_> = frames.iter().map(|f| &f.body).collect();
    let own = of_bodies(&bodies, carrier).into_iter();
    tensors.extend(own.map(|(what, tensor)| (format!("body.{what}"), tensor)));
    tensors
}
