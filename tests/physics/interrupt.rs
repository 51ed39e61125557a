//! Requests to end a computation, which all models obey.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use ruffini_core::{
    Error,
    compliance::{Compliance, ComplianceOptions, nodal::ContactResolution},
    deformation::{DeformationModel, Moduli, Press},
    geometry::Shape,
    interrupt::Interrupt,
    sensor::Sensor,
    surrogate::{LinearPad, Surrogate, soft::SoftSurrogate},
};

use crate::fem::{GEL, MM, ball, ball_at, block, rough};

/// A path and a push of a ball into a pad.
fn presses() -> Vec<Press> {
    let path = vec![ball_at(0.0, 0.1 * MM), ball_at(0.0, 0.2 * MM)];
    let push = Press::with_force(ball(), ball_at(0.0, 0.0), 0.1, -Vector3::z());
    vec![Press::along(ball(), path).unwrap(), push.unwrap()]
}

/// A press of a ball of 20 mm between two fingers.
fn squeeze() -> Vec<Press> {
    let half_extents = Vector3::new(10.0, 12.0, 2.0) * MM;
    let flip = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let away = 21.6 * MM;
    let poses = vec![
        Isometry3::translation(0.0, 0.0, -away),
        Isometry3::translation(0.0, 0.0, away) * flip,
    ];
    vec![Press::along(vec![Shape::Cuboid { half_extents }; 2], vec![poses]).unwrap()]
}

#[test]
fn all_models_end_when_it_is_requested() {
    let fem = block(GEL, 2, rough(0.5));
    let points = Compliance::new(fem.body().clone(), ComplianceOptions::default()).unwrap();
    let nodes = points.at_nodes().unwrap();
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let moduli = Moduli { young: 3e5, poisson: 0.47 };
    let linear = LinearPad::new(&sensor, moduli, 0.5, 1000, ContactResolution::FAST).unwrap();
    let network = Surrogate::new(&sensor, moduli, 0.5).unwrap();
    let object = Shape::Sphere { radius: 20.0 * MM };
    let soft = SoftSurrogate::named("soft", &object, Moduli { young: 1e5, poisson: 0.45 }, 0.8);
    let soft = soft.unwrap();
    let cases: [(&str, &dyn DeformationModel, _); 6] = [
        ("finite elements", &fem, presses()),
        ("points", &points, presses()),
        ("nodes", &nodes, presses()),
        ("linear pad", &linear, presses()),
        ("network", &network, presses()),
        ("soft object", &soft, squeeze()),
    ];
    for (name, model, presses) in cases {
        let interrupt = Interrupt::default();
        let (paths, ends) = interrupt.during(|| {
            interrupt.request();
            let path = |press| model.solve_path(press).into_iter().map(Result::err).collect();
            (presses.iter().map(path).collect::<Vec<Vec<_>>>(), model.solve(&presses))
        });
        for path in paths {
            assert_eq!(path, [Some(Error::Interrupted)], "{name}");
        }
        for end in ends {
            assert_eq!(end.err(), Some(Error::Interrupted), "{name}");
        }
        let plain = model.solve(&presses);
        assert!(plain.iter().all(Result::is_ok), "{name}: {:?}", plain[0].as_ref().err());
    }
}
