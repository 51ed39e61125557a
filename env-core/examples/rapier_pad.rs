//! Compares Rapier's own soft bodies with the finite elements of this library: a ball is pushed
//! into a gel pad.
//!
//! `cargo run --release --features rapier-fem --example rapier_pad [OUT.json]` takes two minutes.
//! The pad has the same mesh, material and law (stable neo-Hookean tetrahedra) in both, and there
//! is no friction. Rapier moves a ball by a force until it rests; this library moves the ball to
//! the depth of that rest and computes the force. Uses one thread.

#[path = "../../tests/physics/bodies.rs"]
#[allow(dead_code)]
mod bodies;

use std::{env, error::Error, fs, time::Instant};

use bodies::gel_pad;
use nalgebra::{Isometry3, Vector3};
use rapier3d::prelude::{
    ColliderBuilder, PhysicsWorld, RigidBodyBuilder, SoftBodyBuilder, SoftBodyCellModel,
    SoftBodyMaterial, SoftBodySolver, Vector,
};
use ruffini_core::{
    deformation::{Law, Press, SoftBody},
    fem::{Element, Fem, Options},
    geometry::Shape,
};
use serde_json::{Value, json};

/// Length unit for Rapier (m). Rapier is given millimetres, kilograms and seconds, as it is tuned
/// for bodies of a few units; a force is then in mN, a stress in kPa.
const MM: f64 = 1e-3;
const RADIUS: f64 = 4.0;
const DENSITY: f32 = 1e-6;
/// Numbers of cells of the pad, which give 1,020 vertices.
const CELLS: [usize; 3] = [14, 16, 3];
/// Force on the ball (N).
const FORCE: f64 = 0.5;
/// Rapier's solvers of the soft body, each with the stiffness of its contacts relative to those of
/// rigid bodies (default 4).
const ASKED: [(&str, SoftBodySolver, f32); 4] = [
    ("fem", SoftBodySolver::Fem, 4.0),
    ("fem", SoftBodySolver::Fem, 40.0),
    ("fem", SoftBodySolver::Fem, 400.0),
    ("constraints", SoftBodySolver::Constraints, 40.0),
];
/// Length of a load step of the finite elements (m).
const FRAME: f64 = 1e-4;
/// Time step of Rapier (s), largest number of steps, and speed below which the ball rests (mm/s).
const STEP: f32 = 1.0 / 500.0;
const STEPS: usize = 3000;
const RESTS: f32 = 1e-2;

/// State in which Rapier's ball rests.
struct Rest {
    depth: f64,
    displacement: Vec<Vector3<f64>>,
    steps: usize,
    seconds: f64,
    speed: f32,
}

fn main() -> Result<(), Box<dyn Error>> {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    let pad = gel_pad(CELLS);
    let body =
        SoftBody::new(pad.mesh().clone(), Law::StableNeoHookean, pad.moduli()[0], pad.fixed())?;
    let mut rows = Vec::new();
    for (name, solver, stiffening) in ASKED {
        let rest = rested(&body, solver, stiffening);
        let found = compared(&body, &rest)?;
        eprintln!("{name}, {stiffening}: {found}");
        rows.push(json!({ "solver": name, "stiffening": stiffening, "found": found }));
    }
    let vertices = body.mesh().vertices.len();
    let report = json!({ "vertices": vertices, "force": FORCE, "rows": rows });
    let text = serde_json::to_string_pretty(&report)? + "\n";
    match env::args().nth(1) {
        Some(file) => fs::write(file, text)?,
        None => print!("{text}"),
    }
    Ok(())
}

/// Pushes the ball onto Rapier's pad.
fn rested(body: &SoftBody, solver: SoftBodySolver, stiffening: f32) -> Rest {
    let start = Instant::now();
    let mut world = PhysicsWorld::new();
    world.gravity = Vector::ZERO;
    let settings = &mut world.integration_parameters;
    settings.dt = STEP;
    settings.soft_bodies.fem.max_linear_iterations = 1000;
    settings.soft_bodies.contact_stiffening = stiffening;
    let millimetres = |v: &Vector3<f64>| (v / MM).cast::<f32>();
    let places = body.mesh().vertices.iter().map(|p| millimetres(&p.coords));
    let places: Vec<_> = places.map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let moduli = body.moduli()[0];
    let material = SoftBodyMaterial {
        young_modulus: (moduli.young * MM) as f32,
        poisson_ratio: moduli.poisson as f32,
        elastic_damping_ratio: 1.0,
        ..SoftBodyMaterial::default()
    };
    let volume: f64 = body.mesh().tets.iter().map(|tet| volume(body, tet)).sum();
    let gel = SoftBodyBuilder::new(places.clone())
        .cells(body.mesh().tets.clone())
        .cell_model(SoftBodyCellModel::NeoHookean)
        .solver(solver)
        .material(material)
        .edges(Vec::new())
        .mass(DENSITY * (volume / MM.powi(3)) as f32)
        .pinned_particles(body.fixed().iter().copied())
        .surface_collider(ColliderBuilder::ball(1.0).friction(0.0))
        .particle_radius(1e-3)
        .can_sleep(false);
    let gel = world.insert_soft_body(gel);
    let above = RigidBodyBuilder::dynamic()
        .translation(Vector::new(0.0, 0.0, RADIUS as f32 + 0.01))
        .lock_rotations()
        .enabled_translations(false, false, true)
        .additional_mass(1e-2)
        .linear_damping(20.0)
        .can_sleep(false);
    let ball = ColliderBuilder::ball(RADIUS as f32).friction(0.0).density(0.0);
    let (ball, _) = world.insert(above, ball);
    world.bodies[ball].add_force(Vector::new(0.0, 0.0, -(FORCE / MM) as f32), true);
    let (mut steps, mut speed) = (0, f32::INFINITY);
    while steps < STEPS && (steps < 50 || speed > RESTS) {
        world.step();
        steps += 1;
        speed = world.bodies[ball].linvel().length();
    }
    let seconds = start.elapsed().as_secs_f64();
    let moved = world.soft_bodies[gel].particle_positions().zip(&places);
    let displacement = moved.map(|(now, rest)| {
        let by = now - *rest;
        Vector3::new(by.x, by.y, by.z).cast::<f64>() * MM
    });
    let depth = (RADIUS - f64::from(world.bodies[ball].translation().z)) * MM;
    Rest { depth, displacement: displacement.collect(), steps, seconds, speed }
}

/// Moves the ball of the finite elements to the depth at which Rapier's ball rests, and compares.
fn compared(body: &SoftBody, rest: &Rest) -> Result<Value, Box<dyn Error>> {
    let options = Options { element: Element::P1, friction: 0.0, ..Options::default() };
    let fem = Fem::new(body.clone(), options)?;
    let ball = vec![Shape::Sphere { radius: RADIUS * MM }];
    let frames = (rest.depth / FRAME).ceil();
    let depths = (1..=frames as usize).map(|i| rest.depth * i as f64 / frames);
    let path = depths.map(|d| vec![Isometry3::translation(0.0, 0.0, RADIUS * MM - d)]);
    let begun = Instant::now();
    let answer = fem.solve_path(&Press::along(ball, path.collect())?).pop().expect("a frame")?;
    let seconds = begun.elapsed().as_secs_f64();
    let (mut off, mut all) = (0.0, 0.0);
    for (theirs, ours) in rest.displacement.iter().zip(&answer.displacement) {
        off += (theirs - ours).norm_squared();
        all += ours.norm_squared();
    }
    Ok(json!({
        "depth": rest.depth,
        "force_ours": answer.wrench.force.norm(),
        "force_error": FORCE / answer.wrench.force.norm() - 1.0,
        "displacement_error": (off / all).sqrt(),
        "steps": rest.steps,
        "speed": f64::from(rest.speed) * MM,
        "seconds": rest.seconds,
        "seconds_ours": seconds,
    }))
}

fn volume(body: &SoftBody, tet: &[u32; 4]) -> f64 {
    let [a, b, c, d] = tet.map(|n| body.mesh().vertices[n as usize]);
    (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
}
