//! Shapes that begin in a body: narrower at the skin than contact points are apart, or wide.

use std::f64::consts::PI;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use ruffini_core::{
    Error, Result,
    compliance::{Compliance, ComplianceOptions},
    deformation::{DeformationModel, Law, Moduli, Press, SoftBody},
    fem::{Element, Fem, FemOptions},
    geometry::{PadMesh, Shape},
    sensor::Sensor,
    surrogate::soft::SoftSurrogate,
};

use crate::fem::{GEL, MM};

/// Force on the frictionless pad of a GelSight Mini, of 900 nodes, of a shape that begins at a
/// place (mm), turned upside down if it is `inverted`, by finite elements and by linear elasticity
/// (N).
fn forces(shape: &Shape, place: [f64; 3], inverted: bool) -> [Result<Vector3<f64>>; 2] {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let pad = PadMesh::with_nodes(&sensor.outline, 900).unwrap();
    let body = SoftBody::new(pad.mesh, Law::NeoHookean, GEL, &pad.base).unwrap();
    let options = FemOptions { element: Element::P1, ..FemOptions::default() };
    let fem = Fem::new(body.clone(), options).unwrap();
    let compliance = Compliance::new(body, ComplianceOptions::default()).unwrap();
    let angle = if inverted { PI } else { 0.0 };
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle);
    let pose = Isometry3::from_parts((Vector3::from(place) * MM).into(), turn);
    let press = Press::along(vec![shape.clone()], vec![vec![pose]]).unwrap();
    let models: [&dyn DeformationModel; 2] = [&fem, &compliance];
    models.map(|model| Ok(model.solve_path(&press).pop().unwrap()?.wrench.force))
}

fn is_refused(force: &Result<Vector3<f64>>) -> bool {
    matches!(force, Err(Error::Penetrated { .. }))
}

#[test]
fn a_blade_that_goes_in_between_contact_points_is_refused() {
    let blade = Shape::Cuboid { half_extents: Vector3::new(0.0742, 0.2475, 0.8008) * MM };
    let found = forces(&blade, [4.889, -2.760, -0.256], false);
    assert!(found.iter().all(is_refused), "{found:?} N");
}

#[test]
fn a_tip_that_goes_in_between_contact_points_is_refused() {
    let cone = Shape::Cone { radius: 0.4314 * MM, half_height: 3.1647 * MM };
    let found = forces(&cone, [2.7684, -6.2647, 1.4628], true);
    assert!(found.iter().all(is_refused), "{found:?} N");
}

#[test]
fn a_narrow_shape_that_takes_the_skin_along_is_answered() {
    let pin = Shape::Cylinder { radius: 0.4 * MM, half_height: MM };
    for force in forces(&pin, [2.7684, -6.2647, 0.5], false) {
        let force = force.unwrap();
        assert!(force.z < 0.0 && force.xy().norm() < -0.3 * force.z, "{force:?} N");
    }
}

#[test]
fn plates_whose_corners_stand_beside_a_soft_ball_are_answered() {
    let ball = Shape::Sphere { radius: 20.0 * MM };
    let moduli = Moduli { young: 1e5, poisson: 0.45 };
    let model = SoftSurrogate::named("soft", &ball, moduli, 0.8).unwrap();
    let plate = Shape::Cuboid { half_extents: Vector3::new(10.0, 12.0, 2.0) * MM };
    let flip = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    let above = Isometry3::translation(0.0, 0.0, 21.6 * MM) * flip;
    let below = Isometry3::translation(0.0, 0.0, -21.6 * MM);
    let press = Press::along(vec![plate; 2], vec![vec![below, above]]).unwrap();
    let answer = model.solve_path(&press).pop().unwrap().unwrap();
    let pushed: f64 = answer.contact_force.iter().map(|force| force.z.abs()).sum();
    assert!(pushed > 0.5, "{pushed} N");
}
