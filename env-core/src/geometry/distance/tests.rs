use std::{f64::consts::PI, sync::Arc};

use nalgebra::{Point3, Vector3};
use rapier3d::parry::{
    math::Vector,
    query::PointQuery,
    shape::{TriMesh, TriMeshFlags},
};

use crate::geometry::{
    Distance, Shape,
    distance::ray::marched_gap,
    examples::{points, solids},
};

/// Length (m) that counts as rounding for solids of a few centimetres.
const ROUNDING: f64 = 1e-14;

fn with_meshes() -> Vec<Shape> {
    let mesh = |s: &Shape| Shape::Mesh(Arc::new(s.surface(16).unwrap()));
    let meshes: Vec<_> = solids().iter().map(mesh).collect();
    solids().into_iter().chain(meshes).chain([Shape::HalfSpace]).collect()
}

#[test]
fn the_foot_of_every_point_lies_on_the_surface() {
    for shape in with_meshes() {
        for p in points(2000, 0.05) {
            let Distance { value, normal } = shape.distance(&p);
            assert!((normal.norm() - 1.0).abs() < 1e-12, "{shape:?} at {p}: normal {normal}");
            let foot = shape.distance(&(p - value * normal)).value;
            // Newton on a star-shaped solid stops at 1e-12 of the radius, 3e-14 m.
            assert!(foot.abs() < 10.0 * ROUNDING, "{shape:?}: {foot} m at the foot of {p}");
        }
    }
}

#[test]
fn the_normal_is_the_gradient() {
    let h = 1e-7;
    for shape in with_meshes() {
        let (mut checked, count) = (0, 1000);
        for p in points(count, 0.04) {
            let around =
                |i: usize, sign: f64| shape.distance(&(p + sign * h * Vector3::ith(i, 1.0)));
            let Distance { normal, value } = shape.distance(&p);
            // Across the medial axis the gradient jumps, and difference quotients mean nothing.
            let smooth =
                |i| [1.0, -1.0].iter().all(|s| (around(i, *s).normal - normal).norm() < 1e-3);
            if !(0..3).all(smooth) || value.abs() < 10.0 * h {
                continue;
            }
            let quotient =
                Vector3::from_fn(|i, _| (around(i, 1.0).value - around(i, -1.0).value) / (2.0 * h));
            // Where an edge's region begins, the curvature jumps by 1/value and the quotient of a
            // step h is off by h times that; elsewhere rounding makes 1e-17 m / h.
            let error = (quotient - normal).norm();
            assert!(
                error < h / value.abs() + 1e-8,
                "{shape:?} at {p}: quotient {quotient}, normal {normal}"
            );
            checked += 1;
        }
        assert!(checked > count * 9 / 10, "{shape:?}: gradient exists at {checked} of {count}");
    }
}

#[test]
fn no_step_changes_the_distance_by_more_than_its_length() {
    for shape in with_meshes() {
        for (p, q) in points(3000, 0.05).zip(points(3000, 0.01).skip(7)) {
            let near = p + q.coords * (q.x / 0.01).powi(4);
            let (a, b) = (shape.distance(&p).value, shape.distance(&near).value);
            let step = (near - p).norm();
            assert!((a - b).abs() <= step + ROUNDING, "{shape:?}: {a} to {b} m in {step} m");
        }
    }
}

#[test]
fn exact_distances_agree_with_parry_on_fine_triangles() {
    for shape in solids() {
        let surface = shape.surface(320).unwrap();
        // Parry works in f32 with absolute tolerances: decimetres keep both small.
        let unit = 0.1;
        let vertices = surface.vertices().iter().map(|v| {
            let v = (v.coords / unit).map(|x| x as f32);
            Vector::new(v.x, v.y, v.z)
        });
        let triangles = surface.triangles().to_vec();
        let flags = TriMeshFlags::ORIENTED;
        let mesh = TriMesh::with_flags(vertices.collect(), triangles, flags).unwrap();
        for p in points(500, 0.04) {
            let q = (p.coords / unit).map(|x| x as f32);
            let distance = mesh.distance_to_local_point(Vector::new(q.x, q.y, q.z), false);
            let (theirs, ours) = (f64::from(distance) * unit, shape.distance(&p).value);
            // The sag of 320 facets round 3 cm is 1.5 µm; at the tip of the ellipsoid, of radius
            // 3.3 mm and facets of 0.6 mm, it is 14 µm. A rounded edge adds 0.4 µm.
            let stretched =
                matches!(shape, Shape::Ellipsoid { .. } | Shape::StarShaped(_) | Shape::Hollow(_));
            let round = matches!(shape, Shape::Rounded(_));
            let sag = if stretched {
                15e-6
            } else if round {
                2e-6
            } else {
                1.5e-6
            };
            assert!((theirs - ours).abs() < sag, "{shape:?} at {p}: {ours} m, parry {theirs} m");
        }
    }
}

#[test]
fn a_box_of_triangles_measures_like_the_exact_box() {
    let exact = Shape::Cuboid { half_extents: Vector3::new(0.01, 0.02, 0.03) };
    let mesh = Shape::Mesh(Arc::new(exact.surface(8).unwrap()));
    for p in points(5000, 0.05) {
        let (a, b) = (exact.distance(&p), mesh.distance(&p));
        assert!((a.value - b.value).abs() < ROUNDING, "{p}: {} and {} m", a.value, b.value);
        let parallel = a.normal.dot(&b.normal);
        // Inside, points of the medial planes have several nearest faces; Halton points miss them.
        assert!(parallel > 1.0 - 1e-12, "{p}: normals {} and {}", a.normal, b.normal);
    }
}

#[test]
fn signs_of_a_mesh_are_those_of_its_winding_number() {
    for shape in solids() {
        let surface = shape.surface(24).unwrap();
        for p in points(300, 0.04) {
            // Solid angle of every triangle (Van Oosterom and Strackee 1983): 4π in all, or 0.
            let angle = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|i| surface.vertices()[i as usize] - p);
                let (x, y, z) = (a.norm(), b.norm(), c.norm());
                let below = x * y * z + a.dot(&b) * z + b.dot(&c) * x + c.dot(&a) * y;
                2.0 * a.dot(&b.cross(&c)).atan2(below)
            };
            let turns = surface.triangles().iter().map(angle).sum::<f64>() / (4.0 * PI);
            let distance = surface.distance(&p).value;
            assert_eq!(
                distance < 0.0,
                turns > 0.5,
                "{shape:?} at {p}: {distance} m, {turns} turns"
            );
        }
    }
}

#[test]
fn landmarks_have_their_closed_form() {
    let at = |shape: &Shape, p: [f64; 3]| shape.distance(&Point3::from(p));
    let close = |found: f64, exact: f64, what: &str| {
        assert!((found - exact).abs() < ROUNDING, "{what}: {found} m against {exact} m");
    };
    let cuboid = Shape::Cuboid { half_extents: Vector3::new(0.01, 0.02, 0.03) };
    close(at(&cuboid, [0.02, 0.03, 0.04]).value, 3f64.sqrt() * 0.01, "off a corner");
    let cone = Shape::Cone { radius: 0.03, half_height: 0.02 };
    close(at(&cone, [0.0, 0.0, 0.03]).value, 0.01, "above the apex");
    // The inscribed sphere of a cone of base 3 and height 4 (slant 5) has radius 3·4/(3+5).
    close(at(&cone, [0.0, 0.0, -0.005]).value, -0.015, "incentre");
    let cup = Shape::Cup { bottom: 0.02, rim: 0.02, half_height: 0.03, wall: 0.004 };
    close(at(&cup, [0.0, 0.0, -0.028]).value, -0.002, "in the bottom");
    close(at(&cup, [0.018, 0.0, 0.0]).value, -0.002, "in the wall");
    close(at(&cup, [0.0, 0.0, 0.0]).value, 0.016, "in the hollow");
    let prism = Shape::Prism { sides: 4, radius: 0.02 * 2f64.sqrt(), half_height: 0.01 };
    close(at(&prism, [0.03, 0.03, 0.0]).value, 2f64.sqrt() * 0.01, "off an edge");
    let annulus = Shape::Annulus { outer: 0.03, inner: 0.02, half_height: 0.01 };
    close(at(&annulus, [0.0; 3]).value, 0.02, "in the hole");
}

#[test]
fn ellipsoids_from_needle_to_disc_answer_on_their_axes() {
    for semi_axes in [[1e-4, 1e-4, 0.02], [0.02, 0.02, 1e-4], [0.01, 0.02, 0.03], [0.02; 3]] {
        let semi_axes = Vector3::from(semi_axes);
        let shape = Shape::Ellipsoid { semi_axes };
        let center = shape.distance(&Point3::origin()).value;
        assert!(
            (center + semi_axes.min()).abs() < ROUNDING,
            "{semi_axes}: {center} m at the centre"
        );
        for i in 0..3 {
            for outside in [0.01, 1e-9] {
                let p = Point3::from(-(semi_axes[i] + outside) * Vector3::ith(i, 1.0));
                let d = shape.distance(&p);
                assert!((d.value - outside).abs() < ROUNDING, "{p}: {} m", d.value);
                assert!((d.normal + Vector3::ith(i, 1.0)).norm() < 1e-6, "{p}: {}", d.normal);
            }
        }
    }
}

#[test]
fn rays_end_where_marching_by_the_distance_ends() {
    for shape in with_meshes() {
        for (p, d) in points(400, 0.05).zip(points(400, 1.0).skip(3)) {
            let direction = d.coords.normalize();
            let inside = shape.distance(&p).value < 0.0;
            let marched = if inside {
                march(&shape, &p, &-direction).map(|s| -s)
            } else {
                march(&shape, &p, &direction)
            };
            let gap = shape.ray_gap(&p, &direction);
            let agree = match (gap, marched) {
                // Sphere tracing stops 1e-9 m off the surface, which a slanted ray meets a little
                // later.
                (Some(a), Some(b)) => (a - b).abs() < 2e-6,
                (None, None) => true,
                // A grazing ray, nowhere deeper than the facets' sag, 0.1 % of the radius.
                (None, Some(_)) => {
                    let along = (0..5000).map(|i| p + 2e-5 * f64::from(i) * direction);
                    let depth = along.map(|x| -shape.distance(&x).value).fold(0.0, f64::max);
                    matches!(shape, Shape::StarShaped(_) | Shape::Hollow(_)) && depth < 3e-5
                }
                (Some(_), None) => false,
            };
            assert!(agree, "{shape:?} from {p} along {direction}: {gap:?}, marched {marched:?}");
        }
    }
}

/// Distance to the surface along a ray by sphere tracing, in steps of the distance itself, or
/// `None` if that grows for good.
fn march(shape: &Shape, p: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
    let mut along = 0.0;
    while along < 1000.0 {
        let step = shape.distance(&(p + along * direction)).value.abs();
        if step < 1e-9 {
            return Some(along);
        }
        along += step;
    }
    None
}

#[test]
fn steep_rays_end_by_steps_of_the_distance_where_their_formula_ends() {
    for shape in Shape::kinds() {
        let mut met = 0;
        for (p, d) in points(400, 0.05).zip(points(400, 1.0).skip(3)) {
            let direction = d.coords.normalize();
            let Some(gap) = shape.ray_gap(&p, &direction) else { continue };
            let normal = shape.distance(&(p + gap * direction)).normal;
            if normal.dot(&direction) > -0.1 {
                continue;
            }
            let found = marched_gap(|point| shape.distance(point).value, &p, &direction, 0.0);
            let found = found.expect("a steep ray arrives");
            // It stops 1e-12 m off the surface.
            assert!((found - gap).abs() < 1e-10, "{shape:?} from {p}: {found} m against {gap} m");
            met += 1;
        }
        assert!(met > 5, "{shape:?}: {met} rays");
    }
}

#[test]
fn gaps_through_a_thin_wall_keep_their_sign() {
    let cup = Shape::Cup { bottom: 0.02, rim: 0.02, half_height: 0.03, wall: 0.001 };
    let gap = |x: f64| cup.ray_gap(&Point3::new(x, 0.0, 0.0), &-Vector3::x());
    let close = |found: Option<f64>, exact: f64| {
        let found = found.expect("the ray meets the wall");
        assert!((found - exact).abs() < ROUNDING, "gap {found} m against {exact} m");
    };
    close(gap(0.025), 0.005);
    close(gap(0.0195), -0.0005);
    // Through the wall: the next surface is the other side of the hollow.
    close(gap(0.018), 0.037);
    assert_eq!(gap(-0.021), None);
}

#[test]
fn a_larger_copy_measures_larger_distances() {
    for shape in solids() {
        let (twice, p) = (shape.scaled(2.0), Point3::new(0.013, -0.007, 0.011));
        let (a, b) = (shape.distance(&p).value, twice.distance(&(2.0 * p)).value);
        assert!((2.0 * a - b).abs() < ROUNDING, "{shape:?}: twice {a} m against {b} m");
    }
}
