//! Fits the bristles of soft pads to finite elements: `calibrate_bed [SENSOR [NODES]]`.
//!
//! The pad of every calibration of the sensor is pressed by balls, cylinders and blocks, 0.1 to 1
//! mm deep, with a friction coefficient of 1, and sheared by a sideways motion of 0.05 mm. The four
//! numbers of `bristles` minimise the squared logarithmic error of all forces. The errors are
//! printed, followed by the line for `assets/sensors`.

use std::{env, f64::consts::FRAC_PI_2, process::ExitCode};

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use ruffini_core::{
    Result,
    deformation::{Law, Moduli, Press, SoftBody},
    fem::{Fem, Options},
    geometry::Shape,
    scene::{ObjectModel, SoftPads},
    sensor::{Bristles, Calibration, Sensor},
};

const MM: f64 = 1e-3;
const FRICTION: f64 = 1.0;
const DEPTHS: [f64; 6] = [0.1, 0.2, 0.3, 0.5, 0.7, 1.0];
/// Depths at which the indenter is moved sideways (`SHEARED`), and the distance (`ASIDE`), in mm.
const SHEARED: [f64; 2] = [0.3, 1.0];
const ASIDE: f64 = 0.05;

/// Indenter and its orientation.
struct Indenter {
    name: &'static str,
    object: ObjectModel,
    turn: UnitQuaternion<f64>,
    /// Distance from the origin of its frame down to its lowest point (m).
    reach: f64,
}

/// Normal force at every depth, and tangential force after every sideways motion (N).
struct Curve {
    normal: Vec<f64>,
    sideways: Vec<f64>,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let name = arguments.first().map_or("gelsight-mini", String::as_str);
    let nodes = arguments.get(1).and_then(|n| n.parse().ok()).unwrap_or(3000);
    match Sensor::named(name).and_then(|sensor| calibrate(&sensor, nodes)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn calibrate(sensor: &Sensor, nodes: usize) -> Result<()> {
    let indenters = indenters()?;
    for calibration in &sensor.calibrations {
        let fem = pad(sensor, calibration, nodes)?;
        let truth: Vec<Curve> = indenters.iter().map(|i| of_fem(&fem, i)).collect::<Result<_>>()?;
        let start = SoftPads::new(sensor, calibration);
        let fitted = fit(&indenters, &truth, start);
        println!("{} {}, {nodes} nodes: error of the bed (%)", sensor.name, calibration.name);
        for (indenter, truth) in indenters.iter().zip(&truth) {
            print_errors(indenter.name, &of_bed(&fitted, indenter), truth);
        }
        let Bristles { normal, coupling, shear, spread } = fitted.bristles;
        println!(
            "bristles = {{ normal = {normal:.3}, coupling = {coupling:.3}, \
             shear = {shear:.3}, spread = {spread:.3} }}"
        );
    }
    Ok(())
}

fn indenters() -> Result<Vec<Indenter>> {
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
        Ok(Indenter { name, object: ObjectModel::new(shape)?, turn, reach: reach * MM })
    };
    all.into_iter().map(indenter).collect()
}

impl Indenter {
    /// Poses that lead down to `depth` (mm) through the smaller depths, then sideways.
    fn path(&self, depth: f64) -> Vec<Isometry3<f64>> {
        let at = |x: f64, depth: f64| {
            let place = Vector3::new(x * MM, 0.0, self.reach - depth * MM);
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
    let moduli = Moduli { young: calibration.young, poisson: calibration.poisson };
    let body = SoftBody::new(pad.mesh, law, moduli, &pad.base)?;
    Fem::new(body, Options { friction: FRICTION, ..Options::default() })
}

fn of_fem(fem: &Fem, indenter: &Indenter) -> Result<Curve> {
    indenter.curve(|path| {
        let path = path.iter().map(|pose| vec![*pose]).collect();
        let press = Press::along(vec![indenter.object.shape().clone()], path)?;
        fem.solve_path(&press).into_iter().map(|frame| Ok(frame?.wrench.force)).collect()
    })
}

fn of_bed(pads: &SoftPads, indenter: &Indenter) -> Curve {
    let curve = indenter.curve(|path| {
        let wrenches = pads.wrenches(&indenter.object, FRICTION, path);
        Ok(wrenches.into_iter().map(|wrench| wrench.force).collect())
    });
    curve.expect("a bed always answers")
}

/// Sum of squared logarithmic errors. The normal force at 0.1 mm counts a third: there a depth
/// error of 10 µm, irrelevant to a grasp, changes the force by a fifth.
fn misfit(bed: &Curve, truth: &Curve) -> f64 {
    let error = |(a, b): (&f64, &f64)| (a.max(1e-9) / b).ln().powi(2);
    let normal = bed.normal.iter().zip(&truth.normal).map(error).enumerate();
    let sideways = bed.sideways.iter().zip(&truth.sideways).map(error);
    normal.map(|(i, e)| if i == 0 { e / 3.0 } else { e }).sum::<f64>() + sideways.sum::<f64>()
}

/// Finds the bristles of least misfit by pattern search.
fn fit(indenters: &[Indenter], truth: &[Curve], start: SoftPads) -> SoftPads {
    let with = |x: &[f64; 4]| {
        let [normal, coupling, shear, spread] = *x;
        let (normal, shear) = (normal.exp(), shear.exp());
        SoftPads { bristles: Bristles { normal, coupling, shear, spread }, ..start }
    };
    let loss = |x: &[f64; 4]| {
        let pads = with(x);
        indenters.iter().zip(truth).map(|(i, t)| misfit(&of_bed(&pads, i), t)).sum::<f64>()
    };
    let mut best = [0.0, 1.0, 0.0, 0.8];
    let (mut least, mut step) = (loss(&best), 0.1);
    while step > 5e-4 {
        let mut improved = false;
        // Factor and exponent are also changed together, along the narrow valley of the misfit.
        for way in [[1.0, 0.0], [0.0, 1.0], [1.0, 0.4], [1.0, -0.4]] {
            for (pair, sign) in [(0, 1.0), (0, -1.0), (2, 1.0), (2, -1.0)] {
                let mut next = best;
                next[pair] += sign * step * way[0];
                next[pair + 1] += sign * step * way[1];
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

fn print_errors(name: &str, bed: &Curve, truth: &Curve) {
    print!("  {name:18}");
    for (i, depth) in DEPTHS.iter().enumerate() {
        let error = 100.0 * (bed.normal[i] / truth.normal[i] - 1.0);
        print!("  {depth} mm {:7.3} N {error:+4.0}", truth.normal[i]);
    }
    for (i, depth) in SHEARED.iter().enumerate() {
        let error = 100.0 * (bed.sideways[i] / truth.sideways[i] - 1.0);
        print!("  aside at {depth} mm {:6.3} N {error:+4.0}", truth.sideways[i]);
    }
    println!();
}
