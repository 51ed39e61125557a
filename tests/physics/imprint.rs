//! Height maps of pressed pads at the resolution of the camera: the object's own surface inside of
//! contact, the gel's outside, and the rim between them.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use ruffini_core::{
    deformation::{Deformation, DeformationModel, Press},
    geometry::Shape,
    tactile::{Channel, Choice, Resolution, TactileConfig, TactilePad},
};

const MM: f64 = 1e-3;
/// Pixels across and along.
const PIXELS: [u32; 2] = [240, 320];
/// Steepest gel beside an edge.
const STEEPEST: f64 = 2.0;

fn pad(sensor: &str, choice: Choice) -> TactilePad {
    let resolution = Resolution { depth: PIXELS, ..Resolution::default() };
    let config =
        TactileConfig { sensor: sensor.into(), choice, resolution, ..TactileConfig::default() };
    TactilePad::new(&config).unwrap().unwrap()
}

/// Presses `shape` from first touch into the pad by `depth`, its middle over (x, y), turned by
/// `about`.
fn pressed(
    pad: &TactilePad,
    shape: &Shape,
    about: Vector3<f64>,
    [x, y]: [f64; 2],
    depth: f64,
) -> Deformation {
    let turn = UnitQuaternion::from_scaled_axis(about);
    let surface = shape.surface(64).unwrap();
    let lowest = surface.vertices().iter().map(|p| (turn * p).z).fold(f64::INFINITY, f64::min);
    let at =
        |depth: f64| vec![Isometry3::from_parts(Vector3::new(x, y, -lowest - depth).into(), turn)];
    let press = Press::along(vec![shape.clone()], vec![at(0.0), at(depth)]).unwrap();
    pad.model().solve(&[press]).remove(0).unwrap()
}

struct Map {
    places: Vec<[f64; 2]>,
    heights: Vec<f64>,
}

impl Map {
    fn new(pad: &TactilePad, felt: Option<&Deformation>, shapes: &[&Shape]) -> Self {
        Self { places: pad.skin().pixels(), heights: Channel::Depth.read(pad.skin(), felt, shapes) }
    }

    fn cell(&self) -> [f64; 2] {
        let [first, next, above] = [0, 1, PIXELS[0] as usize].map(|pixel| self.places[pixel]);
        [next[0] - first[0], above[1] - first[1]]
    }

    /// Height at a place, bilinear between pixels (m).
    fn at(&self, place: [f64; 2]) -> f64 {
        let at = [0, 1].map(|i| (place[i] - self.places[0][i]) / self.cell()[i]);
        let [i, j] = at.map(|p| p.floor() as usize);
        let [s, t] = [at[0] - i as f64, at[1] - j as f64];
        let z = |i: usize, j: usize| self.heights[j * PIXELS[0] as usize + i];
        (1.0 - t) * ((1.0 - s) * z(i, j) + s * z(i + 1, j))
            + t * ((1.0 - s) * z(i, j + 1) + s * z(i + 1, j + 1))
    }
}

/// Distance of each point of the map from the object (m), negative inside.
fn gaps(map: &Map, shape: &Shape, pose: &Isometry3<f64>) -> Vec<f64> {
    let gap = |([x, y], z): (&[f64; 2], &f64)| {
        shape.distance(&pose.inverse_transform_point(&Point3::new(*x, *y, *z))).value
    };
    map.places.iter().zip(&map.heights).map(gap).collect()
}

/// Objects with edges, holes and round sides, each with a turn.
fn objects() -> Vec<(Shape, Vector3<f64>)> {
    let (tilt, flat) = (Vector3::new(0.1, 0.05, 0.3), Vector3::zeros());
    let lying = Vector3::new(std::f64::consts::FRAC_PI_2, 0.0, 0.0);
    let cuboid = Shape::Cuboid { half_extents: Vector3::new(3.1, 2.6, 4.0) * MM };
    let prism = Shape::Prism { sides: 6, radius: 4.0 * MM, half_height: 5.0 * MM };
    let cup = Shape::Cup { bottom: 5.0 * MM, rim: 6.0 * MM, half_height: 6.0 * MM, wall: 1.5 * MM };
    let rounded = cuboid.clone().rounded(0.5 * MM).unwrap();
    vec![
        (Shape::Sphere { radius: 5.0 * MM }, flat),
        (cuboid.clone(), flat),
        (cuboid, tilt),
        (rounded, tilt),
        (prism.clone(), flat),
        (Shape::Mesh(Arc::new(prism.surface(1).unwrap())), tilt),
        (prism, lying),
        (cup, Vector3::new(std::f64::consts::PI, 0.0, 0.0)),
    ]
}

#[test]
fn the_rim_of_a_pressed_ball_is_a_circle_within_a_pixel() {
    let (radius, depth, middle) = (7.5 * MM, 0.8 * MM, [0.3 * MM, -0.5 * MM]);
    let ball = Shape::Sphere { radius };
    for choice in [Choice::Compliance, Choice::Surrogate, Choice::Fem] {
        let pad = pad("gelsight-mini", choice);
        let felt = pressed(&pad, &ball, Vector3::zeros(), middle, depth);
        let centre = felt.poses[0].translation.vector;
        let rims = |shapes: &[&Shape]| -> Vec<f64> {
            let map = Map::new(&pad, Some(&felt), shapes);
            let beside = |angle: f64, r: f64| {
                let place = [centre.x + r * angle.cos(), centre.y + r * angle.sin()];
                centre.z - (radius * radius - r * r).sqrt() - map.at(place)
            };
            let rim = |k: u32| {
                let angle = f64::from(k).to_radians();
                // 10 µm under the ball, a hundredth of a pixel in the picture.
                let from = (100..500).map(|i| f64::from(i) * 0.01 * MM);
                from.into_iter().find(|r| beside(angle, *r) > 1e-5).unwrap()
            };
            (0..360).step_by(3).map(rim).collect()
        };
        let scatter = |rims: &[f64]| {
            let mean = rims.iter().sum::<f64>() / rims.len() as f64;
            (rims.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / rims.len() as f64).sqrt()
        };
        let [with, without] = [&[&ball][..], &[]].map(|shapes| scatter(&rims(shapes)));
        let pixel = pad.skin().pixels()[1][0] - pad.skin().pixels()[0][0];
        println!("{choice:?}: {with:.1e} m, by the mesh {without:.1e} m, a pixel {pixel:.1e} m");
        assert!(
            with < pixel,
            "{choice:?}: radii scatter by {with:.1e} m, a pixel is {pixel:.1e} m"
        );
        assert!(without > 2.0 * with, "{choice:?}: by the mesh they scatter by {without:.1e} m");
    }
}

#[test]
fn heights_are_continuous_and_outside_of_the_object() {
    for (sensor, choice) in [("gelsight-mini", Choice::Compliance), ("digit", Choice::Compliance)] {
        let pad = pad(sensor, choice);
        for (shape, about) in objects() {
            let felt = pressed(&pad, &shape, about, [0.4 * MM, -0.3 * MM], 0.6 * MM);
            let map = Map::new(&pad, Some(&felt), &[&shape]);
            let deepest =
                gaps(&map, &shape, &felt.poses[0]).into_iter().fold(f64::INFINITY, f64::min);
            let (nx, cell) = (PIXELS[0] as usize, map.cell());
            // Gel that stands beside an edge over a wall that leans is lowered into it, by less than
            // a pixel.
            let is_smooth = matches!(shape, Shape::Sphere { .. } | Shape::Rounded(_));
            let leans = !is_smooth && about != Vector3::zeros();
            let most = if leans { 0.5 * cell[0] } else { 1e-7 };
            assert!(deepest > -most, "{sensor}, {shape:?}: {deepest:.1e} m inside of the object");
            for (pixel, z) in map.heights.iter().enumerate() {
                let steps = [
                    (pixel % nx > 0).then(|| (pixel - 1, cell[0])),
                    (pixel >= nx).then(|| (pixel - nx, cell[1])),
                ];
                for (other, apart) in steps.into_iter().flatten() {
                    let slope = (z - map.heights[other]).abs() / apart;
                    assert!(
                        slope < STEEPEST + 1e-6,
                        "{sensor}, {shape:?}: slope {slope} at {:?}",
                        map.places[pixel]
                    );
                }
            }
        }
    }
}

#[test]
fn a_flat_contact_is_the_face_of_the_object_up_to_its_edges() {
    let half = [3.1 * MM, 2.6 * MM];
    let cuboid = Shape::Cuboid { half_extents: Vector3::new(half[0], half[1], 4.0 * MM) };
    for choice in [Choice::Compliance, Choice::Surrogate, Choice::Fem] {
        let pad = pad("gelsight-mini", choice);
        let (middle, depth) = ([0.4 * MM, -0.3 * MM], 0.6 * MM);
        let felt = pressed(&pad, &cuboid, Vector3::zeros(), middle, depth);
        let map = Map::new(&pad, Some(&felt), &[&cuboid]);
        let face = felt.poses[0].translation.z - 4.0 * MM;
        for (place, z) in map.places.iter().zip(&map.heights) {
            let within =
                |beyond: f64| (0..2).all(|i| (place[i] - middle[i]).abs() < half[i] + beyond);
            let off = z - face;
            assert!(!within(0.0) || off.abs() < 1e-9, "{choice:?}: {off:.1e} m off at {place:?}");
            // Farther out the pad's own rim lies lower.
            let is_moat = within(2.0 * MM) && off < -1e-9;
            assert!(!is_moat, "{choice:?}: a moat of {off:.1e} m at {place:?}");
        }
    }
}

#[test]
fn far_from_contact_heights_are_those_of_the_mesh() {
    let pad = pad("gelsight-mini", Choice::Compliance);
    let ball = Shape::Sphere { radius: 4.0 * MM };
    let felt = pressed(&pad, &ball, Vector3::zeros(), [2.0 * MM, -5.0 * MM], 0.4 * MM);
    let [with, mesh] = [&[&ball][..], &[]].map(|shapes| Map::new(&pad, Some(&felt), shapes));
    let mut far = 0;
    for ((place, with), mesh) in with.places.iter().zip(&with.heights).zip(&mesh.heights) {
        // The contact, and four rings of triangles with edges of up to 2.2 mm around it.
        if (place[0] - 2.0 * MM).hypot(place[1] + 5.0 * MM) > 12.0 * MM {
            assert_eq!(with, mesh, "at {place:?} m");
            far += 1;
        }
    }
    assert!(far > 5_000, "{far} pixels are far");
    let rest = Map::new(&pad, None, &[]);
    assert!(rest.heights.iter().zip(&mesh.heights).any(|(rest, mesh)| rest != mesh));
}

#[test]
fn a_contact_between_the_border_and_the_middle_is_the_object() {
    let pad = pad("gelsight-mini", Choice::Surrogate);
    let ball = Shape::Sphere { radius: 4.0 * MM };
    for middle in [[6.5 * MM, 0.0], [-5.0 * MM, 8.5 * MM]] {
        let felt = pressed(&pad, &ball, Vector3::zeros(), middle, 0.7 * MM);
        let map = Map::new(&pad, Some(&felt), &[&ball]);
        let gaps = gaps(&map, &ball, &felt.poses[0]);
        for (place, gap) in map.places.iter().zip(gaps) {
            if (place[0] - middle[0]).hypot(place[1] - middle[1]) < 0.9 * MM {
                assert!(gap.abs() < 1e-9, "{gap:.1e} m off the ball at {place:?} m");
            }
        }
    }
}
