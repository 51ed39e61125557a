//! Grasps and presses of a dataset, drawn from its seed.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::{
    config::{DatasetConfig, Scenario},
    indentation::{FRICTIONS, Indentation},
};
use crate::{
    Error, Result,
    geometry::Shape,
    objects::{Antipodal, GraspSampler, Object},
};

/// Least depth (m), and the greatest over the thickness of the indenter.
const DEPTHS: (f64, f64) = (2e-5, 0.6);

/// Grasp to be solved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Name of the object and number of the grasp: `cup-2/007`.
    pub name: String,
    /// Name of the object.
    pub object: String,
    /// Index of the gel in the configuration.
    pub gel: usize,
    /// Pose of the tool in the object's frame: x from the first pad to the second.
    pub tool: Isometry3<f64>,
    /// Distance between the contacts (m).
    pub width: f64,
    /// Margin of force closure, 0 to 1.
    pub quality: f64,
    /// Force at which the grasp ends (N).
    pub force: f64,
    /// Shift of the second pad relative to the first along their faces (x, y of the second), over
    /// the closing of each.
    pub shear: [f64; 2],
    /// Rotation of the second pad relative to the first about their normals, over the closing
    /// (rad/m).
    pub twist: f64,
    /// Motion of an indenter, in place of a grasp.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub indentation: Option<Indentation>,
}

/// Objects of `config`, each with its grasps in order. An object may have fewer grasps than asked
/// for; one from a mesh file that has none is an error.
pub fn plans(config: &DatasetConfig) -> Result<Vec<(Object, Vec<Plan>)>> {
    let objects = config.objects()?.into_iter();
    let of_object = |object: &Object| match config.scenario {
        Scenario::Presses => {
            (0..config.grasps_of(object)).map(|i| draw_press(config, object, i)).collect()
        }
        Scenario::Pads | Scenario::Soft => grasps(config, object),
    };
    objects.map(|object| of_object(&object).map(|plans| (object, plans))).collect()
}

/// Draws the grasps of an object.
fn grasps(config: &DatasetConfig, object: &Object) -> Result<Vec<Plan>> {
    let count = config.grasps_of(object);
    let sampling = GraspSampler::default().sample(&object.shape, count, object.seed)?;
    if object.family.is_none() && sampling.grasps.is_empty() {
        let found = format!("{}, for which no grasp was found", object.name);
        return Err(Error::invalid("object", found, "a solid that the gripper can hold"));
    }
    let grasps = sampling.grasps.iter().enumerate();
    Ok(grasps.map(|(number, grasp)| draw_grasp(config, object, number, grasp)).collect())
}

fn draw_grasp(config: &DatasetConfig, object: &Object, number: usize, grasp: &Antipodal) -> Plan {
    let mut random = ChaCha8Rng::seed_from_u64(object.seed);
    random.set_stream(1 + number as u64);
    let mut uniform = || random.random::<f64>();
    let [low, high] = config.force;
    let (size, angle) = (config.shear * uniform().sqrt(), TAU * uniform());
    Plan {
        name: format!("{}/{number:03}", object.name),
        object: object.name.clone(),
        gel: choose(config, uniform()),
        tool: grasp.tool,
        width: grasp.width,
        quality: grasp.quality,
        force: low * (high / low).powf(uniform()),
        shear: [size * angle.cos(), size * angle.sin()],
        twist: config.twist * (2.0 * uniform() - 1.0),
        indentation: None,
    }
}

/// Thickness of an indenter (m): of a mesh, the shortest edge of its bounding box.
fn thickness_of(shape: &Shape) -> f64 {
    match shape {
        Shape::Mesh(surface) => {
            let (low, high) = surface.bounds();
            (high - low).min()
        }
        _ => shape.thickness(),
    }
}

/// Draws a press of an indenter.
fn draw_press(config: &DatasetConfig, object: &Object, number: usize) -> Result<Plan> {
    let mut random = ChaCha8Rng::seed_from_u64(object.seed);
    random.set_stream(1 + number as u64);
    let mut uniform = || random.random::<f64>();
    let (turn, mut tilt) = draw_turn(&mut uniform);
    let gel = choose(config, uniform());
    let thickness = config.gels[gel].sensor()?.outline.thickness;
    let deepest = (config.depth * thickness).min(DEPTHS.1 * thickness_of(&object.shape));
    let depth = DEPTHS.0 * f64::max(deepest / DEPTHS.0, 1.0).powf(uniform().sqrt());
    let friction = FRICTIONS[(FRICTIONS.len() as f64 * uniform()) as usize];
    let spot = [uniform(), uniform()].map(|u| 1.9 * u - 0.95);
    let goes_on = uniform() < 0.4;
    let angle = |u: f64, most: f64| f64::min(depth / 5e-4, 1.0) * most * (2.0 * u - 1.0);
    let aside = [uniform(), uniform()].map(|u| 2.0 * u - 1.0);
    let rotation =
        Vector3::new(angle(uniform(), 0.14), angle(uniform(), 0.14), angle(uniform(), 0.18));
    let onward = goes_on.then_some((aside, rotation));
    // A third of those that rest do so exactly, the others are tilted by up to a few degrees.
    if uniform() < 1.0 / 3.0 {
        tilt = Vector3::zeros();
    }
    let turn = UnitQuaternion::from_scaled_axis(tilt) * turn;
    Ok(Plan {
        name: format!("{}/{number:03}", object.name),
        object: object.name.clone(),
        gel,
        tool: Isometry3::identity(),
        width: 0.0,
        quality: 0.0,
        force: 0.0,
        shear: [0.0; 2],
        twist: 0.0,
        indentation: Some(Indentation { friction, turn, spot, depth, onward }),
    })
}

/// Draws an orientation and the tilt of it, a rotation vector. Half of the indenters rest on a side
/// or an end, the others have a random orientation without a tilt.
fn draw_turn(mut uniform: impl FnMut() -> f64) -> (UnitQuaternion<f64>, Vector3<f64>) {
    if uniform() < 0.5 {
        let quarter = |turns: f64| 0.25 * TAU * turns.floor();
        let side = UnitQuaternion::from_euler_angles(
            quarter(4.0 * uniform()),
            quarter(4.0 * uniform()),
            0.0,
        );
        let tilt = Vector3::new(uniform() - 0.5, uniform() - 0.5, 0.0) * 0.2 * uniform();
        (UnitQuaternion::from_axis_angle(&Vector3::z_axis(), TAU * uniform()) * side, tilt)
    } else {
        let mut between = || 2.0 * uniform() - 1.0;
        let four = std::array::from_fn(|_| between() + between() + between());
        (UnitQuaternion::new_normalize(nalgebra::Quaternion::from(four)), Vector3::zeros())
    }
}

/// Index of the gel at `point`, from 0 to 1, on the line of their shares laid end to end.
fn choose(config: &DatasetConfig, point: f64) -> usize {
    let all: f64 = config.gels.iter().map(|gel| gel.share).sum();
    let mut rest = point * all;
    let over = |share: f64| {
        rest -= share;
        rest < 0.0
    };
    let shares = config.gels.iter().map(|gel| gel.share);
    shares.map(over).position(|found| found).unwrap_or(config.gels.len() - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grasps_are_drawn_from_the_seed_and_not_from_each_other() {
        let config = DatasetConfig { objects: 5, grasps: 4, ..DatasetConfig::default() };
        let more = DatasetConfig { grasps: 6, ..config.clone() };
        let (few, many) = (plans(&config).unwrap(), plans(&more).unwrap());
        for ((object, few), (_, many)) in few.iter().zip(&many) {
            assert_eq!(few[..], many[..few.len()], "{}", object.name);
        }
        let other = plans(&DatasetConfig { seed: 1, ..config }).unwrap();
        assert!(few.iter().zip(&other).all(|((_, a), (_, b))| a[0].tool != b[0].tool));
    }

    #[test]
    fn gels_are_drawn_by_their_shares() {
        let config = DatasetConfig::default();
        let mut counts = vec![0.0; config.gels.len()];
        for i in 0..1000 {
            counts[choose(&config, (f64::from(i) + 0.5) / 1000.0)] += 0.01;
        }
        for (count, gel) in counts.iter().zip(&config.gels) {
            assert!((count - gel.share).abs() < 0.011, "{count} of {}", gel.share);
        }
    }
}
