//! Contact of a pad on cells: how much friction it can have, and what the pad's sides do to it.

use nalgebra::{Isometry3, Point3, Vector3};
use ruffini_core::{
    compliance::nodal::{self, ContactResolution},
    deformation::{DeformationModel, Law, PredictedError, Press, SoftBody, Wanted},
    fem::{Element, Fem, FemOptions},
    geometry::{PadOutline, Shape},
    sensor::Sensor,
    surrogate::{LinearPad, Surrogate},
};

use crate::{
    bodies::even,
    fem::{GEL, MM, rough},
};

/// With more friction, the contact of a cell on an incline has no solution or several.
#[test]
fn friction_for_which_cells_have_no_single_solution_is_refused() {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let most = nodal::MOST_FRICTION;
    let with = |friction| LinearPad::new(&sensor, GEL, friction, 1000, ContactResolution::FAST);
    assert!(with(1.01 * most).is_err_and(|error| error.to_string().contains("friction")));
    let pad = with(most).unwrap();
    let ball = vec![Shape::Sphere { radius: 4.0 * MM }];
    let at = |x: f64, depth: f64| vec![Isometry3::translation(x * MM, 0.0, (4.0 - depth) * MM)];
    let pressed = [0.25, 0.5, 0.75, 1.0].map(|depth| at(0.0, depth));
    let dragged = (1..=6).map(|k| at(0.5 * f64::from(k), 1.0));
    let press = Press::along(ball, pressed.into_iter().chain(dragged).collect()).unwrap();
    let refused = press.clone().with_friction(1.01 * most).unwrap();
    let error = pad.solve_path(&refused).pop().unwrap().unwrap_err();
    assert!(error.to_string().contains("friction"), "{error}");
    // Where all of the contact sticks, more friction changes little.
    let [some, much] = [0.5 * most, most].map(|friction| {
        let press = press.clone().with_friction(friction).unwrap();
        pad.solve_path(&press).pop().unwrap().unwrap().wrench.force
    });
    assert!(
        (much - some).norm() < 0.3 * some.norm(),
        "{much} N, {some} N with half of the friction"
    );
}

/// What a side does to contact beside it changes on distances as short as its own: cells of a
/// millimetre did not resolve it, and nodes moved farther than the ball that pressed them.
#[test]
fn beside_a_side_nodes_move_no_farther_than_the_ball_that_presses_them() {
    let outline = PadOutline::flat(20.0 * MM, 20.0 * MM, 4.0 * MM);
    let sensor = Sensor { outline, ..Sensor::named("gelsight-mini").unwrap() };
    let cells = LinearPad::new(&sensor, GEL, 0.0, 1000, ContactResolution::FAST).unwrap();
    let (radius, deepest) = (2.0, 0.3);
    for x in [9.3, 9.8] {
        let at = |depth: f64| vec![Isometry3::translation(x * MM, 0.0, (radius - depth) * MM)];
        let path = vec![at(-0.1), at(0.5 * deepest), at(deepest)];
        let press = Press::along(vec![Shape::Sphere { radius: radius * MM }], path).unwrap();
        let around: Vec<_> = even(-0.8, 0.8, 8)
            .into_iter()
            .flat_map(|y| even(x - 0.8, 10.0, 8).into_iter().map(move |x| [x, y]))
            .map(|[x, y]| Point3::new(x, y, 0.0) * MM)
            .collect();
        let pad = outline.graded(&around, 800).unwrap();
        let body = SoftBody::new(pad.mesh, Law::Linear, GEL, &pad.base).unwrap();
        let elements = Fem::new(body, FemOptions { element: Element::P2, ..rough(0.0) }).unwrap();
        let [found, right] = [&cells as &dyn DeformationModel, &elements]
            .map(|model| model.solve_path(&press).pop().unwrap().unwrap());
        let off = (found.wrench.force - right.wrench.force).norm() / right.wrench.force.norm();
        let most = found.displacement.iter().map(Vector3::norm).fold(0.0, f64::max);
        assert!(off < 0.06, "{:?}, {:?} by elements", found.wrench.force, right.wrench.force);
        assert!(most < 1.1 * deepest * MM, "{most} m at {x} mm");
    }
}

/// Contact is felt on the face alone: a press on a wall of the pad must not be answered with nearly
/// no force.
#[test]
fn presses_on_the_walls_are_refused_and_those_on_their_edge_predict_large_errors() {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let linear = LinearPad::new(&sensor, GEL, 0.5, 1000, ContactResolution::FAST).unwrap();
    let network = Surrogate::new(&sensor, GEL, 0.5).unwrap();
    let models: [&dyn DeformationModel; 2] = [&linear, &network];
    let (radius, half) = (2.0 * MM, 0.5 * sensor.outline.width);
    let press = |from: [f64; 2], to: [f64; 2]| {
        let pose = |t: f64| {
            let [x, z] = [0, 1].map(|i| from[i] + t * (to[i] - from[i]));
            vec![Isometry3::translation(x, 0.0, z)]
        };
        let path = (0..=6).map(|k| pose(f64::from(k) / 6.0)).collect();
        Press::along(vec![Shape::Sphere { radius }], path).unwrap()
    };
    let beside = half + radius;
    let on_wall = press([beside + MM, -1.5 * MM], [beside - 0.4 * MM, -1.5 * MM]);
    for model in models {
        let answers = [model.solve(std::slice::from_ref(&on_wall)), model.solve_path(&on_wall)];
        for mut answers in answers {
            let error = answers.pop().unwrap().unwrap_err();
            assert!(error.kind() == "on-walls" && error.to_string().contains("Fem"), "{error}");
        }
        // An environment goes on.
        let answer = model.solve_partially(std::slice::from_ref(&on_wall), Wanted::default());
        assert!(answer[0].is_ok());
    }
    let felt = network.solve_partially(&[on_wall], Wanted::default()).remove(0).unwrap();
    assert!(felt.predicted_error.unwrap().force > 0.9, "{:?}", felt.predicted_error);
    // Over the edge of the wall a part is felt.
    let (x, top) = (half + 0.8 * MM, sensor.outline.height(half, 0.0));
    let on_edge = network.solve(&[press([x, top + 2.5 * MM], [x, top + 1.4 * MM])]);
    let predicted = on_edge[0].as_ref().unwrap().predicted_error.unwrap();
    let PredictedError { displacement, stress, force } = predicted;
    assert!(displacement > 0.2 && stress > 0.05 && force > 0.05, "{predicted:?}");
}
