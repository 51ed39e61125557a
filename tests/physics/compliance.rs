//! Linear elasticity condensed to the surface, against finite elements.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use ruffini_core::{
    Result,
    compliance::{Compliance, Options},
    deformation::{Deformation, Law, Moduli, Press, SoftBody},
    fem::{self, Fem},
    geometry::{Shape, TetMesh},
};

use crate::bodies::{even, graded, grid, nodes_where};

const GEL: Moduli = Moduli { young: 2e5, poisson: 0.48 };
const MM: f64 = 1e-3;

/// A pad of 20.75 × 25.25 × 4 mm, finer in the middle: about 1,000 nodes.
fn pad_mesh() -> TetMesh {
    let [x, y] =
        [(10.375 * MM, 14), (12.625 * MM, 16)].map(|(half, count)| graded(half, count, 4.0));
    grid(&x, &y, &even(-4.0 * MM, 0.0, 3))
}

fn bonded(mesh: TetMesh, law: Law) -> SoftBody {
    let base = nodes_where(&mesh, |p| p.z < -3.999 * MM);
    SoftBody::new(mesh, law, GEL, &base).unwrap()
}

fn fem(body: &SoftBody, friction: f64) -> Fem {
    Fem::new(body.clone(), fem::Options { friction, ..fem::Options::default() }).unwrap()
}

fn compliance(body: &SoftBody, friction: f64, sweeps: usize) -> Compliance {
    Compliance::new(body.clone(), Options { friction, sweeps }).unwrap()
}

fn ball() -> Shape {
    Shape::Sphere { radius: 4.0 * MM }
}

fn cuboid() -> Shape {
    Shape::Cuboid { half_extents: Vector3::new(3.0, 2.5, 4.0) * MM }
}

/// A shape of half-height 4 mm pressed in by `depth`, then moved aside by `x`.
fn at(x: f64, depth: f64) -> Vec<Isometry3<f64>> {
    vec![Isometry3::translation(x, 0.0, 4.0 * MM - depth)]
}

fn relative(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let rest: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum();
    (rest / b.iter().map(Vector3::norm_squared).sum::<f64>()).sqrt()
}

fn frames(found: Vec<Result<Deformation>>) -> Vec<Deformation> {
    found.into_iter().collect::<Result<_>>().unwrap()
}

#[test]
fn explore() {
    for law in [Law::Linear, Law::NeoHookean] {
        let body = bonded(pad_mesh(), law);
        for (name, shape) in [("ball", ball()), ("box", cuboid())] {
            for friction in [0.0, 0.5] {
                for path in [
                    vec![at(0.0, 1e-5)],
                    vec![at(0.0, 0.25 * MM)],
                    vec![at(0.0, 0.5 * MM)],
                    vec![at(0.0, MM)],
                    (1..=10)
                        .map(|i| at(0.0, 0.1 * MM * f64::from(i)))
                        .chain((1..=10).map(|i| at(0.05 * MM * f64::from(i), MM)))
                        .collect(),
                ] {
                    let press = Press::along(vec![shape.clone()], path.clone()).unwrap();
                    let truth = fem(&body, friction).solve_path(&press);
                    let Ok(truth) = truth.into_iter().collect::<Result<Vec<_>>>() else {
                        println!("fem failed");
                        continue;
                    };
                    let t = truth.last().unwrap();
                    let linear = compliance(&body, friction, 0);
                    for sweeps in [0, 1, 2, 4, 8, 12] {
                        let model = linear.with_options(Options { friction, sweeps }).unwrap();
                        let w0 = std::time::Instant::now();
                        let wr = model.wrenches(&press);
                        let ws = w0.elapsed().as_secs_f64();
                        match model.solve_path(&press).pop().unwrap() {
                            Err(e) => println!(
                                "{law} {name} {friction} {} frames {sweeps}: {e}",
                                path.len()
                            ),
                            Ok(d) => {
                                let vm: f64 = d
                                    .von_mises
                                    .iter()
                                    .zip(&t.von_mises)
                                    .map(|(a, b)| (a - b).powi(2))
                                    .sum::<f64>()
                                    .sqrt()
                                    / t.von_mises.iter().map(|b| b * b).sum::<f64>().sqrt();
                                println!(
                                    "{law} {name} μ{friction} {} frames s{sweeps}: F {:?} / {:?} u {:.2e} vm {:.2e} its {} res {:.1e} t {:.2} ms wr {:.2} ms/frame fem {:.1} ms",
                                    path.len(),
                                    d.wrench
                                        .force
                                        .as_slice()
                                        .iter()
                                        .map(|x| (x * 1e5).round() / 1e5)
                                        .collect::<Vec<_>>(),
                                    t.wrench
                                        .force
                                        .as_slice()
                                        .iter()
                                        .map(|x| (x * 1e5).round() / 1e5)
                                        .collect::<Vec<_>>(),
                                    relative(&d.displacement, &t.displacement),
                                    vm,
                                    d.iterations,
                                    d.residual,
                                    d.seconds * 1e3,
                                    ws * 1e3 / wr.len() as f64,
                                    t.seconds * 1e3
                                );
                            }
                        }
                    }
                }
            }
        }
    }
    let _ = (UnitQuaternion::<f64>::identity(), frames);
}
