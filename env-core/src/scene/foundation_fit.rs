//! Fit of the elastic foundation of soft pads to finite elements.
//!
//! The pad is pressed by balls, cylinders and blocks, 0.1 to 1 mm deep (less if it is thinner than
//! 3.5 mm), with a friction coefficient of 1, and sheared by a sideways motion of 0.05 mm. The four
//! coefficients minimise the squared logarithmic error of all forces.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::{ObjectModel, SoftPads};
use crate::{
    Result,
    deformation::{Law, Press, SoftBody},
    fem::{Fem, FemOptions},
    geometry::Shape,
    interrupt::Interrupt,
    sensor::{Calibration, ElasticFoundation, Sensor},
};

const MM: f64 = 1e-3;
const FRICTION: f64 = 1.0;
/// Thickness of pads that are pressed to all of [`DEPTHS`] (m); thinner ones less, in proportion.
const THICKNESS: f64 = 3.5e-3;
const DEPTHS: [f64; 6] = [0.1, 0.2, 0.3, 0.5, 0.7, 1.0];
/// Depths at which the indenter is moved sideways (`SHEARED`), and the distance (`ASIDE`), in mm.
const SHEARED: [f64; 2] = [0.3, 1.0];
const ASIDE: f64 = 0.05;

/// An elastic foundation, and how well it represents the finite elements.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundationFit {
    /// Coefficients of least error.
    pub foundation: ElasticFoundation,
    /// Errors by indenter.
    pub errors: Vec<FoundationError>,
}

/// Relative errors of the forces of an elastic foundation on one indenter.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundationError {
    /// Name of the indenter.
    pub indenter: &'static str,
    /// Depths (m), and error of the normal force at each.
    pub normal: Vec<[f64; 2]>,
    /// Error of the tangential force at the third and at the last of these depths.
    pub tangential: Vec<f64>,
}

/// Indenter and its orientation.
struct Indenter {
    name: &'static str,
    object: ObjectModel,
    turn: UnitQuaternion<f64>,
    /// Distance from the origin of its frame down to its lowest point (m).
    reach: f64,
    /// Length that stands for a millimetre of depth (m).
    unit: f64,
}

/// Normal force at every depth, and tangential force after every sideways motion (N).
struct Curve {
    normal: Vec<f64>,
    sideways: Vec<f64>,
}

/// Fits the elastic foundation of the pad of `sensor` with `calibration` to finite elements on a
/// mesh of at most `nodes` nodes. Takes about a minute of processor time with 1,000 of them.
/// Returns an error if an indenter's press is not solved.
pub fn fit_foundation(
    sensor: &Sensor,
    calibration: &Calibration,
    nodes: usize,
) -> Result<FoundationFit> {
    let unit = MM * (sensor.outline.thickness / THICKNESS).min(1.0);
    let indenters = indenters(unit)?;
    let fem = pad(sensor, calibration, nodes)?;
    let interrupt = Interrupt::current();
    let of_fem = |indenter| interrupt.during(|| of_fem(&fem, indenter));
    let truth: Vec<_> = indenters.par_iter().map(of_fem).collect::<Result<_>>()?;
    let fitted = fit(&indenters, &truth, SoftPads::new(sensor, calibration));
    let error = |(indenter, truth): (&Indenter, &Curve)| {
        let found = of_foundation(&fitted, indenter);
        let relative = |a: &[f64], b: &[f64]| -> Vec<f64> {
            a.iter().zip(b).map(|(a, b)| a / b - 1.0).collect()
        };
        let normal = relative(&found.normal, &truth.normal);
        FoundationError {
            indenter: indenter.name,
            normal: DEPTHS.into_iter().zip(normal).map(|(d, e)| [d * unit, e]).collect(),
            tangential: relative(&found.sideways, &truth.sideways),
        }
    };
    let errors = indenters.iter().zip(&truth).map(error).collect();
    Ok(FoundationFit { foundation: fitted.foundation, errors })
}

fn indenters(unit: f64) -> Result<Vec<Indenter>> {
    let upright = UnitQuaternion::identity();
    let along = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    let across = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2);
    let ball = |r: f64| (Shape::Sphere { radius: r * MM }, upright, r);
    let bar = |r: f64, turn| (Shape::Cylinder { radius: r * MM, half_height: 20.0 * MM }, turn, r);
    let block = |x: f64, y: f64, z: f64| {
        (Shape::Cuboid { half_extents: Vector3::new(x, y, z) * MM }, upright, z)
    };
    let all = [
        ("ball, 4 mm", ball(4.0)),
        ("ball, 7.5 mm", ball(7.5)),
        ("ball, 10 mm", ball(10.0)),
        ("ball, 15 mm", ball(15.0)),
        ("bar along, 5 mm", bar(5.0, along)),
        ("bar along, 15 mm", bar(15.0, along)),
        ("bar across, 15 mm", bar(15.0, across)),
        ("block, 10 × 10 mm", block(5.0, 5.0, 5.0)),
        ("block, 30 × 40 mm", block(15.0, 20.0, 15.0)),
    ];
    let indenter = |(name, (shape, turn, reach)): (&'static str, (Shape, _, f64))| {
        Ok(Indenter { name, object: ObjectModel::new(shape)?, turn, reach: reach * MM, unit })
    };
    all.into_iter().map(indenter).collect()
}

impl Indenter {
    /// Poses that lead down to `depth` through the smaller depths, then sideways.
    fn path(&self, depth: f64) -> Vec<Isometry3<f64>> {
        let at = |x: f64, depth: f64| {
            let place = Vector3::new(x * self.unit, 0.0, self.reach - depth * self.unit);
            Isometry3::from_parts(place.into(), self.turn)
        };
        let down = DEPTHS.into_iter().filter(|d| *d <= depth).map(|d| at(0.0, d));
        down.chain([at(ASIDE, depth)]).collect()
    }

    /// Computes the curve of a model; `answer` returns its force on the pad (N) in each pose of a
    /// path.
    fn curve(
        &self,
        answer: impl Fn(&[Isometry3<f64>]) -> Result<Vec<Vector3<f64>>>,
    ) -> Result<Curve> {
        let mut curve = Curve { normal: Vec::new(), sideways: Vec::new() };
        for depth in SHEARED {
            let mut forces = answer(&self.path(depth))?;
            curve.sideways.extend(forces.pop().map(|force| force.x));
            curve.normal = forces.iter().map(|force| -force.z).collect();
        }
        Ok(curve)
    }
}

fn pad(sensor: &Sensor, calibration: &Calibration, nodes: usize) -> Result<Fem> {
    let pad = sensor.pad(nodes)?;
    let law: Law = calibration.law.parse()?;
    let body = SoftBody::new(pad.mesh, law, calibration.into(), &pad.base)?;
    Fem::new(body, FemOptions { friction: FRICTION, ..FemOptions::default() })
}

fn of_fem(fem: &Fem, indenter: &Indenter) -> Result<Curve> {
    indenter.curve(|path| {
        let path = path.iter().map(|pose| vec![*pose]).collect();
        let press = Press::along(vec![indenter.object.shape().clone()], path)?;
        fem.solve_path(&press).into_iter().map(|frame| Ok(frame?.wrench.force)).collect()
    })
}

fn of_foundation(pads: &SoftPads, indenter: &Indenter) -> Curve {
    let curve = indenter.curve(|path| {
        let wrenches = pads.wrenches(&indenter.object, FRICTION, path);
        Ok(wrenches.into_iter().map(|wrench| wrench.force).collect())
    });
    curve.expect("a foundation always answers")
}

/// Sum of squared logarithmic errors. The normal force at the least depth counts a third: there a
/// depth error of 10 µm, irrelevant to a grasp, changes the force by a fifth.
fn misfit(foundation: &Curve, truth: &Curve) -> f64 {
    let error = |(a, b): (&f64, &f64)| (a.max(1e-9) / b.max(1e-9)).ln().powi(2);
    let normal = foundation.normal.iter().zip(&truth.normal).map(error).enumerate();
    let sideways = foundation.sideways.iter().zip(&truth.sideways).map(error);
    normal.map(|(i, e)| if i == 0 { e / 3.0 } else { e }).sum::<f64>() + sideways.sum::<f64>()
}

/// Finds the foundation of least misfit by pattern search.
fn fit(indenters: &[Indenter], truth: &[Curve], start: SoftPads) -> SoftPads {
    let with = |x: &[f64; 4]| {
        let [normal, coupling, shear, spread] = *x;
        let (normal, shear) = (normal.exp(), shear.exp());
        SoftPads { foundation: ElasticFoundation { normal, coupling, shear, spread }, ..start }
    };
    let loss = |x: &[f64; 4]| {
        let pads = with(x);
        let pairs = indenters.iter().zip(truth);
        pairs.map(|(i, t)| misfit(&of_foundation(&pads, i), t)).sum::<f64>()
    };
    let mut best = [0.0, 1.0, 0.0, 0.8];
    let (mut least, mut step) = (loss(&best), 0.1);
    while step > 5e-4 {
        let mut improved = false;
        // Factor and exponent are also changed together, along the narrow valley of the misfit.
        for direction in [[1.0, 0.0], [0.0, 1.0], [1.0, 0.4], [1.0, -0.4]] {
            for (pair, sign) in [(0, 1.0), (0, -1.0), (2, 1.0), (2, -1.0)] {
                let mut next = best;
                next[pair] += sign * step * direction[0];
                next[pair + 1] += sign * step * direction[1];
                let there = loss(&next);
                if there < least {
                    (best, least, improved) = (next, there, true);
                }
            }
        }
        if !improved {
            step *= 0.5;
        }
    }
    with(&best)
}
