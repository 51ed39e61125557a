//! Finite elements of an environment against those on a mesh that is refined under the contact.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use ruffini_core::{
    deformation::{DeformationModel, Press, SoftBody},
    fem::{Element, Fem, FemOptions},
    geometry::Shape,
    tactile::{Choice, TactileConfig, TactilePad},
};

const MM: f64 = 1e-3;
const FRICTION: f64 = 0.6;

/// A shape, its turn, and the height of its origin over its lowest point (m).
fn pressed() -> [(&'static str, Shape, UnitQuaternion<f64>, f64); 2] {
    let lying = UnitQuaternion::from_scaled_axis(Vector3::y() * std::f64::consts::FRAC_PI_2);
    [
        ("ball", Shape::Sphere { radius: 9.0 * MM }, UnitQuaternion::identity(), 9.0 * MM),
        ("cylinder", Shape::Cylinder { radius: 8.0 * MM, half_height: 4.0 * MM }, lying, 8.0 * MM),
    ]
}

#[test]
fn finite_elements_of_an_environment_are_right_in_force_and_displacement() {
    let config = TactileConfig { choice: Choice::Fem, ..TactileConfig::default() };
    let pad = TactilePad::new(&config).unwrap().unwrap();
    let sensor = config.sensor().unwrap();
    let (shared, _) = config.pad(&sensor).unwrap();
    let (law, moduli) = config.material(&sensor).unwrap();
    let grid = (-4..=4).flat_map(|i| (-4..=4).map(move |j| (f64::from(i) * MM, f64::from(j) * MM)));
    let near: Vec<_> = grid.map(|(x, y)| Point3::new(x, y, sensor.outline.height(x, y))).collect();
    let fine = sensor.outline.graded(&near, 900).unwrap();
    let body = SoftBody::new(fine.mesh, law, moduli, &fine.base).unwrap();
    let options = FemOptions { element: Element::P2, ..FemOptions::default() };
    let fine = Fem::new(body, options).unwrap();
    for (name, shape, turn, reach) in pressed() {
        let poses = [(0.0, 0.2), (0.0, 0.4), (0.1, 0.4)].map(|(y, depth)| {
            vec![Isometry3::from_parts(Vector3::new(0.0, y * MM, reach - depth * MM).into(), turn)]
        });
        let press = Press::along(vec![shape], poses.to_vec()).unwrap();
        let press = press.with_friction(FRICTION).unwrap();
        let [found, truth] = [pad.model() as &dyn DeformationModel, &fine]
            .map(|model| model.solve_path(&press).pop().unwrap().unwrap());
        let error = (found.wrench.force - truth.wrench.force).norm() / truth.wrench.force.norm();
        let carried = fine.carry(&truth.history, &shared.mesh).unwrap();
        let size = |u: &[Vector3<f64>]| u.iter().map(Vector3::norm_squared).sum::<f64>().sqrt();
        let off: Vec<_> =
            found.displacement.iter().zip(&carried.displacement).map(|(a, b)| a - b).collect();
        let displaced = size(&off) / size(&carried.displacement);
        println!("{name}: {error:.4} in force, {displaced:.4} in displacement");
        assert!(error < 0.05, "{name}: force off by {error}");
        assert!(displaced < 0.07, "{name}: displacement off by {displaced}");
        let sum: Vector3<f64> = found.contact_force.iter().sum();
        let gap = (sum - found.wrench.force).norm() / found.wrench.force.norm();
        assert!(gap < 1e-6, "{name}: forces on the nodes sum to {sum}, not {:?}", found.wrench);
        assert_eq!(found.von_mises.len(), shared.mesh.tets.len(), "{name}");
    }
}
