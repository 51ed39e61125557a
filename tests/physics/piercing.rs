//! Shapes that begin in a pad and are narrower at the skin than contact points are apart.

use std::f64::consts::PI;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use ruffini_core::{
    Error, Result,
    compliance::{Compliance, ComplianceOptions},
    deformation::{DeformationModel, Law, Press, SoftBody},
    fem::{Element, Fem, FemOptions},
    geometry::{PadMesh, Shape},
    sensor::Sensor,
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
