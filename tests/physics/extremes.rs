//! Extreme presses (stiff, nearly incompressible, sharp, deep, rough, badly meshed) are solved or
//! refused with a specific error.

use std::f64::consts::{FRAC_PI_4, PI, SQRT_2};

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use rayon::ThreadPoolBuilder;
use ruffini_core::{
    Error, Result,
    compliance::{Compliance, ComplianceOptions, nodal::ContactResolution},
    contact::is_engulfed,
    deformation::{
        Deformation, DeformationModel, History, Law, ModelIdentity, Moduli, Numbering, Press,
        SoftBody,
    },
    fem::{Element, Fem, FemOptions},
    geometry::{PadMesh, Shape, TetMesh},
    sensor::Sensor,
    surrogate::LinearPad,
};

use crate::{
    bodies::{even, grid, nodes_where},
    fem::{
        GEL, MM, along, ball, ball_at, base, block, block_mesh, last, plate_at, relative, rough,
    },
};

/// Force of the shapes into the block (N).
fn pressing(frame: &Deformation) -> f64 {
    -frame.wrench.force.z
}

fn plate() -> Vec<Shape> {
    vec![Shape::HalfSpace]
}

/// A body held at its base, with moduli that depend on the height.
fn layered(mesh: TetMesh, moduli: impl Fn(f64) -> Moduli, options: FemOptions) -> Fem {
    let moduli = mesh.tets.iter().map(|tet| {
        let height = |&node: &u32| 0.25 * mesh.vertices[node as usize].z;
        moduli(tet.iter().map(height).sum())
    });
    let (moduli, base) = (moduli.collect(), base(&mesh));
    Fem::new(SoftBody::graded(mesh, Law::NeoHookean, moduli, &base).unwrap(), options).unwrap()
}

#[test]
fn the_answer_is_the_same_from_a_thousand_to_a_thousand_million_pascals() {
    let press = |young| {
        last(&block(Moduli { young, ..GEL }, 3, rough(0.5)), ball(), vec![ball_at(0.0, MM)])
    };
    let reference = press(2e5);
    for young in [1e3, 1e9] {
        let frame = press(young);
        let force = pressing(&frame) / young * 2e5;
        // The residual may be 1e-7 N; at 1 kPa the force is 5 mN.
        let error = (force / pressing(&reference) - 1.0).abs();
        assert!(error < 1e-4, "{young} Pa: scaled force off by {error:.1e}");
        let error = relative(&frame.displacement, &reference.displacement);
        assert!(error < 1e-4, "{young} Pa: displacements differ by {error:.1e}");
    }
}

#[test]
fn small_bodies_are_too_soft_by_what_the_contact_gives() {
    // The contact softness of 2 µm does not scale with the body.
    let moduli = Moduli { poisson: 0.45, ..GEL };
    let force = |scale: f64| {
        let mut mesh = block_mesh(3);
        let base = base(&mesh);
        mesh.vertices.iter_mut().for_each(|vertex| *vertex *= scale);
        let body = SoftBody::new(mesh, Law::NeoHookean, moduli, &base).unwrap();
        let ball = vec![Shape::Sphere { radius: 4.0 * MM * scale }];
        let pose = vec![Isometry3::translation(0.0, 0.0, 3.5 * MM * scale)];
        pressing(&last(&Fem::new(body, rough(0.5)).unwrap(), ball, vec![pose])) / (scale * scale)
    };
    let [whole, tenth, hundredth] = [1.0, 0.1, 0.01].map(force);
    let [tenth, hundredth] = [tenth, hundredth].map(|force| 1.0 - force / whole);
    assert!((0.02..0.04).contains(&tenth), "0.8 mm across: {tenth} too soft");
    assert!((0.14..0.20).contains(&hundredth), "0.08 mm across: {hundredth} too soft");
}

#[test]
fn a_layer_a_million_times_stiffer_is_rigid() {
    // A soft layer under a stiff one deforms as if a rigid plate were glued to it.
    let soft = Moduli { young: 1e3, poisson: 0.45 };
    let side = even(-4.0 * MM, 4.0 * MM, 8);
    let two = grid(&side, &side, &even(-4.0 * MM, 0.0, 8));
    let one = grid(&side, &side, &even(-4.0 * MM, -2.0 * MM, 4));
    let stiff_above = |z: f64| if z > -2.0 * MM { Moduli { young: 1e9, ..soft } } else { soft };
    let options = FemOptions { tolerance: 1e-10, softness: 2e-7, ..rough(100.0) };
    let both = last(&layered(two, stiff_above, options), plate(), vec![plate_at(0.0, -0.2 * MM)]);
    let alone = last(&layered(one, |_| soft, options), plate(), vec![plate_at(0.0, -2.2 * MM)]);
    let [both, alone] = [both, alone].map(|frame| pressing(&frame));
    // The plate's contact yields a little at the rim, unlike the glue.
    assert!((both / alone - 1.0).abs() < 5e-3, "{both} N against {alone} N");
}

#[test]
fn a_block_is_squeezed_to_thirty_percent_of_its_height() {
    let path: Vec<_> = (1..=14).map(|i| plate_at(0.0, -0.2 * MM * f64::from(i))).collect();
    for poisson in [0.3, 0.45, 0.49, 0.499] {
        for friction in [0.0, 1.0] {
            let squeeze = |element| {
                let options = FemOptions { element, ..rough(friction) };
                along(&block(Moduli { poisson, ..GEL }, 2, options), plate(), path.clone())
            };
            for frames in [Element::P1Bar, Element::P2].map(squeeze) {
                let last = frames.last().unwrap();
                assert!(last.residual <= 1e-7, "ν {poisson} μ {friction}: {} N", last.residual);
                // Without friction, coarse blocks buckle during the press, but the force stays far
                // above 10 N.
                assert!(pressing(last) > 10.0, "ν {poisson} μ {friction}: {} N", pressing(last));
            }
        }
    }
}

/// A long box on its edge, a cone on its point and a small tip, each with its extent below its
/// origin.
fn sharp() -> [(Shape, UnitQuaternion<f64>, f64); 3] {
    let about_x = |angle| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle);
    [
        (
            Shape::Cuboid { half_extents: Vector3::new(5.0, 3.0, 3.0) * MM },
            about_x(FRAC_PI_4),
            3.0 * SQRT_2 * MM,
        ),
        (Shape::Cone { radius: 3.0 * MM, half_height: 3.0 * MM }, about_x(PI), 3.0 * MM),
        (Shape::Sphere { radius: 0.5 * MM }, about_x(0.0), 0.5 * MM),
    ]
}

#[test]
fn an_edge_a_point_and_a_small_tip_go_in_by_a_millimetre_at_once() {
    for (element, cells) in [(Element::P1Bar, 4), (Element::P2, 2)] {
        let fem = block(GEL, cells, FemOptions { element, ..rough(0.0) });
        for (shape, turn, reach) in sharp() {
            let at = |depth: f64| {
                let place = Vector3::new(0.1 * MM, 0.2 * MM, reach - depth);
                vec![Isometry3::from_parts(place.into(), turn)]
            };
            let in_steps = |count: u32| {
                let depth = |i| MM * f64::from(i) / f64::from(count);
                let path = (0..=count).map(|i| at(depth(i))).collect();
                pressing(&last(&fem, vec![shape.clone()], path))
            };
            let (once, slowly) = (in_steps(1), in_steps(10));
            assert!(slowly > 0.1, "{element} {shape:?}: {slowly} N");
            // The nearest contact point may end on either side of an edge or a point.
            let error = (once / slowly - 1.0).abs();
            assert!(error < 0.03, "{element} {shape:?}: {once} N at once, {slowly} N slowly");
        }
    }
}

#[test]
fn a_shape_that_begins_inside_the_body_is_refused_by_all_models() {
    let fem = block(GEL, 2, rough(0.0));
    let compliance = Compliance::new(fem.body().clone(), ComplianceOptions::default()).unwrap();
    let pad = mini(0.5);
    let models: [&dyn DeformationModel; 4] =
        [&fem, &compliance, &compliance.at_nodes().unwrap(), &pad];
    let tip = vec![Shape::Sphere { radius: 0.5 * MM }];
    let inside = vec![Isometry3::translation(0.0, 0.0, -2.0 * MM)];
    // The ring does not contain its own centre.
    let ring = vec![Shape::Annulus { outer: 1.5 * MM, inner: 0.9 * MM, half_height: 0.7 * MM }];
    for (shape, model) in [tip, ring].iter().flat_map(|shape| models.map(|model| (shape, model))) {
        let press = Press::along(shape.clone(), vec![inside.clone()]).unwrap();
        let error = model.solve_path(&press).pop().unwrap().unwrap_err();
        assert!(error.to_string().contains("across its surface"), "{error}");
    }
}

/// Linear elasticity of a GelSight Mini's pad.
fn mini(friction: f64) -> LinearPad {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    LinearPad::new(&sensor, GEL, friction, 1000, ContactResolution::FAST).unwrap()
}

/// The faces of a coarse mesh lie under a curved face by more than the skin above this ball.
#[test]
fn a_ball_just_under_a_curved_face_is_refused() {
    let sensor = Sensor::named("digit").unwrap();
    let pad = LinearPad::new(&sensor, GEL, 0.0, 1000, ContactResolution::FAST).unwrap();
    // In the middle of the widest cell of the mesh.
    let (radius, x, y) = (0.2 * MM, 9.0 * MM, 13.29 * MM);
    let at = |z: f64| vec![Isometry3::translation(x, y, sensor.outline.height(x, y) + z)];
    let first = |z: f64| {
        let press = Press::along(vec![Shape::Sphere { radius }], vec![at(z)]).unwrap();
        pad.solve_path(&press).pop().unwrap()
    };
    let (under, ball) = (-1.04 * radius, Shape::Sphere { radius });
    let mesh = PadMesh::with_nodes(&sensor.outline, 2000).unwrap().mesh;
    let still = vec![Vector3::zeros(); mesh.vertices.len()];
    assert!(!is_engulfed(&ball, &at(under)[0], &mesh, &still), "the mesh would tell, too");
    let error = first(under).unwrap_err();
    assert!(error.to_string().contains("across its surface"), "{error}");
    let across = first(0.7 * radius).unwrap();
    assert!(across.wrench.force.z < 0.0, "{:?}", across.wrench);
}

#[test]
fn a_shape_that_begins_in_a_pad_has_come_down_on_it() {
    let pad = mini(0.5);
    let upright = UnitQuaternion::identity();
    let tilted = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.3);
    let cone = |radius, half_height| Shape::Cone { radius, half_height };
    let pin = |radius| Shape::Cylinder { radius, half_height: 2.0 * MM };
    for (shape, [x, y, z], turn) in [
        (cone(0.73 * MM, 1.85 * MM), [0.31, 0.0, -0.6], tilted),
        (pin(0.5 * MM), [0.31, 0.0, 0.8], upright),
        (pin(MM), [0.31, 0.0, 1.5], upright),
        (Shape::Sphere { radius: 0.5 * MM }, [0.31, 0.0, 0.0], upright),
        // As wide as they are deep, and most of the skin inside them nearest to their sides.
        (pin(1.186 * MM), [-4.948, 3.809, 0.9], upright),
        (Shape::Capsule { radius: 1.6 * MM, half_height: 3.35 * MM }, [0.91, -4.92, 2.9], upright),
        (
            Shape::Prism { sides: 5, radius: 1.965 * MM, half_height: 6.7 * MM },
            [-2.44, 3.29, 4.9],
            upright,
        ),
        // On its base, with little but its apex in the skin.
        (cone(0.286 * MM, 0.835 * MM), [-0.723, 0.895, -0.443], upright),
    ] {
        let force = |heights: &[f64]| {
            let at = |&z: &f64| {
                vec![Isometry3::from_parts(Translation3::from(Vector3::new(x, y, z) * MM), turn)]
            };
            let path = heights.iter().map(at).collect();
            let press = Press::along(vec![shape.clone()], path).unwrap();
            pad.solve_path(&press).pop().unwrap().unwrap().wrench.force
        };
        let (once, lowered) = (force(&[z]), force(&[z + 4.0, z]));
        assert!(lowered.z < -0.05, "{shape:?}: {lowered:?} N");
        // Load steps from another height, with friction, differ by up to 4 %.
        let off = (once - lowered).norm() / lowered.norm();
        assert!(off < 0.05, "{shape:?}: {once:?} N at once, {lowered:?} N from above");
    }
}

/// Without friction the skin slides off a round end and up past the widest part. Linear elasticity
/// then holds it apart beside the shape, with nothing under it.
#[test]
fn what_would_pierce_the_skin_is_refused() {
    let pad = mini(0.0);
    let capsule = Shape::Capsule { radius: 0.55 * MM, half_height: 0.77 * MM };
    let lens = Shape::Ellipsoid { semi_axes: Vector3::new(0.211, 0.1266, 0.338) * MM };
    let axis = Unit::new_normalize(Vector3::new(0.375, 0.927, 0.0));
    let tilt = UnitQuaternion::from_axis_angle(&axis, PI);
    for (shape, [x, y, z], turn) in [
        (capsule, [0.0, 0.0, 0.6], UnitQuaternion::identity()),
        (lens, [-2.292, -3.339, -0.121], tilt),
    ] {
        // Lowered from 1.5 mm above that place to `end` (mm) above it.
        let force = |end: f64, steps: i32| {
            let at = |i: i32| {
                let up = 1.5 + (end - 1.5) * f64::from(i) / f64::from(steps);
                vec![Isometry3::from_parts((Vector3::new(x, y, z + up) * MM).into(), turn)]
            };
            let press = Press::along(vec![shape.clone()], (0..=steps).map(at).collect()).unwrap();
            pad.solve_path(&press).pop().unwrap().map(|frame| frame.wrench.force)
        };
        for steps in [1, 9] {
            let error = force(0.0, steps);
            assert!(error.is_err(), "{shape:?} in {steps} steps: {error:?} N");
            let above = force(0.3, steps).unwrap();
            assert!(above.z < -1e-3, "{shape:?} in {steps} steps: {above:?} N before it pierces");
        }
    }
}

#[test]
fn a_tip_is_felt_on_faces_eight_millimetres_wide() {
    let tip = vec![Shape::Sphere { radius: 0.5 * MM }];
    for element in [Element::P1Bar, Element::P2] {
        let wide = grid(
            &even(-4.0 * MM, 4.0 * MM, 1),
            &even(-4.0 * MM, 4.0 * MM, 1),
            &even(-4.0 * MM, 0.0, 1),
        );
        let fem = layered(wide, |_| GEL, FemOptions { element, ..rough(0.02) });
        for i in 0..6 {
            let [x, y] = [0.37, -0.23].map(|way| way * f64::from(i));
            let force = |z: f64| {
                let at = |z: f64| vec![Isometry3::translation(x * MM, y * MM, z * MM)];
                let press = Press::along(tip.clone(), vec![at(0.6), at(z)]).unwrap();
                fem.solve_path(&press).pop().unwrap().map(|frame| pressing(&frame))
            };
            let felt = force(0.3).unwrap();
            assert!(felt > 0.2, "{element}: {felt} N at place {i}, 0.2 mm deep");
            let unfelt = force(-5.3).is_ok_and(|force| force < 1e-6);
            assert!(!unfelt, "{element}: went through at place {i} without a force");
        }
    }
}

#[test]
fn a_wall_a_tenth_of_a_millimetre_thick_is_felt_wherever_it_stands() {
    // The force on the ring's edge is about constant per length, whatever contact points lie under
    // it.
    let wall = 0.1 * MM;
    let ring = vec![Shape::Annulus { outer: 1.5 * MM, inner: 1.5 * MM - wall, half_height: MM }];
    let fem = block(GEL, 4, rough(0.0));
    let force = |x: f64| {
        let at = |z: f64| vec![Isometry3::translation(x * MM, 0.07 * MM, z)];
        pressing(&last(&fem, ring.clone(), vec![at(1.1 * MM), at(0.8 * MM)]))
    };
    let forces = [0.0, 0.05, 0.1, 0.15].map(force);
    let (least, most) =
        forces.iter().fold((f64::INFINITY, 0f64), |(low, high), &f| (low.min(f), high.max(f)));
    // The stiffness of the mesh around the edge, of cells of a millimetre, varies with the place.
    assert!(least > 0.8 * most, "{forces:?} N");
}

#[test]
fn a_wall_too_thin_to_be_felt_is_refused() {
    let card = Shape::Cuboid { half_extents: Vector3::new(2.0, 2.0, 0.01) * MM };
    let press = Press::along(vec![card], vec![plate_at(0.0, 0.0)]).unwrap();
    let error = block(GEL, 1, rough(0.0)).solve_path(&press).pop().unwrap().unwrap_err();
    assert!(matches!(&error, Error::Invalid { name, .. } if name.contains("thickness")), "{error}");
}

#[test]
fn a_thin_wall_is_refused_only_where_it_comes_near_a_wide_face() {
    // Cells of 4 mm, and beside them some of 100 mm, divided into 128 pieces at most: too coarse
    // for a ring with a wall of 0.5 mm.
    let mut long = even(-12.0 * MM, 12.0 * MM, 6);
    long.push(112.0 * MM);
    let mesh = grid(&long, &even(-8.0 * MM, 8.0 * MM, 4), &even(-4.0 * MM, 0.0, 1));
    let body = SoftBody::new(mesh.clone(), Law::default(), GEL, &base(&mesh)).unwrap();
    let free = SoftBody::new(mesh, Law::default(), GEL, &[]).unwrap();
    let ring = Shape::Annulus { outer: 1.5 * MM, inner: MM, half_height: MM };
    let at = |x: f64, z: f64| vec![Isometry3::translation(x * MM, 0.0, z * MM)];
    let along = |path: &[[f64; 2]]| {
        let path = path.iter().map(|[x, z]| at(*x, *z)).collect();
        Press::along(vec![ring.clone()], path).unwrap()
    };
    let pushed =
        |x: f64| Press::with_force(vec![ring.clone()], at(x, 1.1), 0.01, -Vector3::z()).unwrap();
    let near = [along(&[[0.0, 0.9]]), along(&[[0.0, 1.1], [1.0, 0.9]]), pushed(0.0)];
    let wide = [
        along(&[[60.0, 0.9]]),
        along(&[[0.0, 0.9], [60.0, 0.9]]),
        along(&[[0.0, 2.0], [200.0, 2.0]]),
        pushed(60.0),
        near[0].clone().after(moved_by(60.0 * MM, &body)).unwrap(),
    ];
    let fem = Fem::new(body.clone(), rough(0.0)).unwrap();
    let linear = Compliance::new(body, ComplianceOptions::default()).unwrap();
    let turned = Fem::new(free, rough(0.0)).unwrap();
    let too_thin = |mut frames: Vec<Result<Deformation>>| match frames.pop().unwrap() {
        Ok(frame) => {
            assert!(pressing(&frame) > 0.0, "{} N", pressing(&frame));
            false
        }
        Err(error) => {
            assert!(
                matches!(&error, Error::Invalid { name, .. } if name.contains("thickness")),
                "{error}"
            );
            true
        }
    };
    for (i, press) in near.iter().enumerate() {
        assert!(!too_thin(fem.solve_path(press)), "press {i}");
        assert!(!too_thin(linear.solve_path(press)), "press {i}");
        assert!(too_thin(turned.solve_path(press)), "press {i} of a free body");
    }
    for (i, press) in wide.iter().enumerate() {
        assert!(too_thin(fem.solve_path(press)), "press {i} of wide faces");
        assert!(too_thin(linear.solve_path(press)), "press {i} of wide faces");
    }
}

/// History of a ring that stood `x` aside of the middle of `body`.
fn moved_by(x: f64, body: &SoftBody) -> History {
    History {
        model: ModelIdentity::new(Numbering::Vertices, body, &body.mesh().vertices),
        displacement: vec![Vector3::zeros(); body.mesh().vertices.len()],
        poses: vec![Isometry3::translation(x, 0.0, 2.0 * MM)],
        anchors: vec![],
        forces: vec![],
        folded: false,
    }
}

#[test]
fn friction_up_to_five_stiffens() {
    let force =
        |friction| pressing(&last(&block(GEL, 4, rough(friction)), ball(), vec![ball_at(0.0, MM)]));
    let forces = [0.0, 0.1, 0.3, 1.0, 5.0].map(force);
    assert!(forces.windows(2).all(|pair| pair[1] > pair[0]), "{forces:?} N");
}

/// The block of 3 cells with columns of cells of width `width` in the middle, four across.
fn with_needles(width: f64) -> TetMesh {
    let mut side = even(-4.0 * MM, 4.0 * MM, 6);
    side.splice(3..=3, even(-width, width, 4));
    grid(&side, &side, &even(-4.0 * MM, 0.0, 3))
}

/// The block of 3 cells with a vertex in every tetrahedron, at a relative `height` over a face.
fn with_slivers(height: f64) -> TetMesh {
    let mesh = block_mesh(3);
    let (mut vertices, mut tets) = (mesh.vertices.clone(), Vec::new());
    for (t, &[a, b, c, d]) in mesh.tets.iter().enumerate() {
        let [p, q, r, s] = mesh.corners(t).map(|p| p.coords);
        let new = vertices.len() as u32;
        vertices.push(((p + q + r) / 3.0 * (1.0 - height) + s * height).into());
        tets.extend([[a, b, c, new], [a, b, new, d], [a, new, c, d], [new, b, c, d]]);
    }
    TetMesh::new("slivers", vertices, tets).unwrap()
}

#[test]
fn needles_and_slivers_do_no_harm() {
    // Needles 1 µm thick and 1.3 mm long; slivers with a relative height of 1e-5. Beside needles
    // the faces of p1-bar stay flat like those of p1, which is a quarter stiffer on this mesh.
    let moduli = Moduli { poisson: 0.3, ..GEL };
    for (element, tolerance) in [(Element::P1, 1e-3), (Element::P1Bar, 0.25), (Element::P2, 2e-3)] {
        let options = FemOptions { element, ..rough(0.5) };
        let force = |mesh: TetMesh| {
            let fem = layered(mesh, |_| moduli, options);
            pressing(&last(&fem, ball(), vec![ball_at(0.0, 0.5 * MM)]))
        };
        let plain = force(block_mesh(3));
        for other in [with_needles(2e-6), with_slivers(1e-5)].map(force) {
            // Thin elements add few effective degrees of freedom.
            let error = (other / plain - 1.0).abs();
            assert!(error < tolerance, "{element}: {other} N against {plain} N");
        }
    }
}

fn pushed(fem: &Fem, shape: Shape, pose: Vec<Isometry3<f64>>, force: f64) -> Result<Deformation> {
    let press = Press::with_force(vec![shape], pose, force, -Vector3::z()).unwrap();
    fem.solve_path(&press).pop().unwrap()
}

#[test]
fn a_hundred_newtons_are_borne() {
    // The pressure is eight times Young's modulus on the block's face.
    for friction in [0.0, 0.5] {
        let frame =
            pushed(&block(GEL, 3, rough(friction)), Shape::HalfSpace, plate_at(0.0, 0.0), 100.0);
        let force = pressing(&frame.unwrap());
        assert!((force - 100.0).abs() < 1e-6, "μ {friction}: {force} N");
    }
    // A ball displaces the gel and reaches the base before the force is so large.
    let large = || vec![Isometry3::translation(0.0, 0.0, 20.0 * MM)];
    let ball = |force| {
        pushed(&block(GEL, 3, rough(0.0)), Shape::Sphere { radius: 20.0 * MM }, large(), force)
    };
    let force = pressing(&ball(70.0).unwrap());
    assert!((force - 70.0).abs() < 1e-6, "{force} N");
    let error = ball(100.0).unwrap_err();
    let on_the_base = matches!(error, Error::Unreachable { reached, travel, .. }
        if reached > 70.0 && (travel - 4.0 * MM).abs() < 0.05 * MM);
    assert!(on_the_base, "{error}");
}

#[test]
fn a_force_that_is_never_met_is_named() {
    let pad = block(GEL, 2, rough(0.2));
    // The ball of 4 mm passes the frictionless block of 4 mm before the force is so large.
    let through = pushed(&block(GEL, 3, rough(0.0)), ball()[0].clone(), ball_at(0.0, 0.0), 100.0);
    let too_much = pushed(&pad, ball()[0].clone(), ball_at(0.0, 0.0), 1e5);
    let start = ball_at(0.0, 0.1 * MM);
    let aside = Press::with_force(ball(), start, 1.0, Vector3::x()).unwrap();
    let aside = pad.solve_path(&aside).pop().unwrap();
    for error in [through, too_much, aside].map(Result::unwrap_err) {
        let named = matches!(error, Error::Unreachable { reached, force, .. } if reached < force);
        assert!(named, "{error}");
    }
}

/// Work of a ball on a block along a closed path, and its maximum along the path (J).
fn round_trip(fem: &Fem) -> (f64, f64) {
    const STEPS: u32 = 16;
    let corners = [[0.0, 0.0], [0.0, 0.4], [0.3, 0.4], [0.3, 0.2], [0.0, 0.2], [0.0, 0.0]];
    let mut path = vec![ball_at(0.0, 0.0)];
    for pair in corners.windows(2) {
        path.extend((1..=STEPS).map(|i| {
            let t = f64::from(i) / f64::from(STEPS);
            let [x, depth] = [0, 1].map(|k| pair[0][k] + (pair[1][k] - pair[0][k]) * t);
            ball_at(x * MM, depth * MM)
        }));
    }
    let (mut work, mut most) = (0.0, 0f64);
    for pair in along(fem, ball(), path).windows(2) {
        let way = pair[1].poses[0].translation.vector - pair[0].poses[0].translation.vector;
        work += 0.5 * (pair[0].wrench.force + pair[1].wrench.force).dot(&way);
        most = most.max(work);
    }
    (work, most)
}

#[test]
fn no_energy_is_won_round_a_closed_path() {
    for element in [Element::P1Bar, Element::P2] {
        let work = |friction| round_trip(&block(GEL, 3, FemOptions { element, ..rough(friction) }));
        let (lost, most) = work(0.0);
        // Error of the trapezium rule in 16 steps a side; half as many give two to four times as
        // much.
        assert!(lost.abs() < 2e-3 * most, "{element}: {lost:.2e} J of {most:.2e} J");
        for friction in [0.2, 0.5] {
            let (lost, most) = work(friction);
            assert!(lost > 0.1 * most, "{element} μ {friction}: {lost:.2e} J of {most:.2e} J");
        }
    }
}

#[test]
fn one_two_and_four_threads_give_the_same_bits() {
    let press = |i| {
        let depth = 0.1 * MM * f64::from(i);
        Press::along(ball(), vec![ball_at(0.0, depth), ball_at(0.1 * MM, depth)]).unwrap()
    };
    let presses: Vec<_> = (1..=6).map(press).collect();
    let answers = [1, 2, 4].map(|threads| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let fem = block(GEL, 3, rough(0.5));
        let frames = pool.install(|| fem.solve(&presses));
        frames.into_iter().map(|frame| frame.unwrap().history).collect::<Vec<_>>()
    });
    assert_eq!(answers[0], answers[1]);
    assert_eq!(answers[0], answers[2]);
}

#[test]
fn a_ball_in_a_wall_by_most_of_its_width_is_not_let_go_on_the_other_side() {
    // Press 1186 of the stability report: moved down onto the wall's edge and past its foot in one
    // frame. The ball was 0.48 mm deep in the wall of 0.6 mm, and ended below it without a force.
    let wall = grid(
        &even(-0.3 * MM, 0.3 * MM, 2),
        &even(-4.0 * MM, 4.0 * MM, 6),
        &even(-4.0 * MM, 0.0, 3),
    );
    let stiff = |_| Moduli { young: 8.25e8, poisson: 0.492 };
    let fem = layered(wall, stiff, rough(0.0585));
    let at = |z: f64| vec![Isometry3::translation(-0.157 * MM, -1.63 * MM, z)];
    let force = |z: f64| {
        let ball = vec![Shape::Sphere { radius: 1.48 * MM }];
        let press = Press::along(ball, vec![at(1.54 * MM), at(z)]).unwrap();
        fem.solve_path(&press).pop().unwrap().map(|frame| pressing(&frame))
    };
    let on_edge = force(1.3 * MM).unwrap();
    assert!(on_edge > 10.0, "{on_edge} N on the edge");
    let end = force(-6.26 * MM);
    let unfelt = end.as_ref().is_ok_and(|force| force.abs() < 1e-6);
    assert!(!unfelt, "upright again, {end:?} N");
}

#[test]
fn nothing_goes_through_what_holds_the_body() {
    // Presses 2671 and 3503 of the stability report (a cup that sank into a pad between its contact
    // points and a tip that inverted a linear film), and a ball that started in the base. All ended
    // below the body without a force.
    let below = |fem: &Fem, shape: Shape, begin: Isometry3<f64>, way: f64| {
        // A ball 0.02 mm deep is answered.
        let place = vec![Isometry3::translation(0.0, 0.0, 1.98 * MM)];
        let felt = last(fem, vec![Shape::Sphere { radius: 2.0 * MM }], vec![place]);
        assert!(pressing(&felt) > 1e-5, "{} N", pressing(&felt));
        let end = Translation3::new(0.0, 0.0, -way) * begin;
        let press = Press::along(vec![shape], vec![vec![begin], vec![end]]).unwrap();
        let end = fem.solve_path(&press).pop().unwrap();
        assert!(end.is_err(), "below the body, {:?}", end.map(|frame| frame.wrench));
    };
    let pad = Sensor::named("gelsight-mini").unwrap().pad(300).unwrap();
    let moduli = Moduli { young: 19.2e3, poisson: 0.223 };
    let pad = SoftBody::new(pad.mesh, Law::NeoHookean, moduli, &pad.base).unwrap();
    let pad = Fem::new(pad, FemOptions { element: Element::P2, ..rough(0.0) }).unwrap();
    let r = 1.6237 * MM;
    let cup = Shape::Cup { bottom: 0.7 * r, rim: r, half_height: r, wall: 0.1 * r };
    let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    let place = Translation3::new(-4.224 * MM, -6.522 * MM, -1.534 * MM);
    below(&pad, cup, Isometry3::from_parts(place, over), 8.16 * MM);
    let side = even(-4.0 * MM, 4.0 * MM, 6);
    let film = grid(&side, &side, &even(-0.2 * MM, 0.0, 3));
    let base = nodes_where(&film, |p| p.z < -0.199 * MM);
    let film = SoftBody::new(film, Law::Linear, GEL, &base).unwrap();
    let film = Fem::new(film, FemOptions { element: Element::P2, ..rough(0.147) }).unwrap();
    let ball = Shape::Sphere { radius: 0.5 * MM };
    let place = Isometry3::translation(1.346 * MM, -1.486 * MM, 0.576 * MM);
    below(&film, ball.clone(), place, 1.55 * MM);
    let in_the_base = Isometry3::translation(0.0, 0.0, -4.2 * MM);
    below(&block(GEL, 1, rough(0.0)), ball, in_the_base, 2.0 * MM);
}
