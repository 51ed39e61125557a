//! Indentation against its closed forms, at small strain.
//!
//! E* = E / (1 − ν²). Ball of radius R: F = 4/3 E* √R δ^{3/2}; flat end of radius a: F = 2 E* a δ
//! (Johnson 1985, chapters 4 and 3). A layer of thickness h on a rigid base is stiffer by a series
//! in χ = √(Rδ)/h (Dimitriadis et al. 2002, bonded case).

use std::{f64::consts::PI, sync::LazyLock};

use nalgebra::{Isometry3, Point3, Vector3};
use ruffini_core::{
    deformation::{Law, Moduli, Press, SoftBody},
    fem::{Element, Fem, FemOptions},
    geometry::{PadMesh, PadOutline, Shape, TetMesh},
};

use crate::half_space::half_space;

const YOUNG: f64 = 2e5;
/// Width and depth, in contact radii, of a block that approximates a half-space: the base, at a
/// depth d, adds about a / d to the force.
const FAR: [f64; 2] = [1000.0; 2];

fn plane_strain_modulus(poisson: f64) -> f64 {
    YOUNG / (1.0 - poisson * poisson)
}

/// Force of `shape` (N), lowered by `depth` from first contact of its end, `reach` below its
/// origin.
fn force(
    shape: Shape,
    turn: f64,
    reach: f64,
    depth: f64,
    poisson: f64,
    block: (TetMesh, Vec<u32>),
) -> f64 {
    let (mesh, bonded) = block;
    let body = SoftBody::new(mesh, Law::Linear, Moduli { young: YOUNG, poisson }, &bonded).unwrap();
    // Contact compliance is less than 1e-4 of the depth; forces balance to 2e-5 of their sum, about
    // E a δ.
    let options = FemOptions {
        element: Element::P2,
        softness: 1e-3 * depth,
        tolerance: 1e-3 * YOUNG * depth * depth,
        ..FemOptions::default()
    };
    let pose = Isometry3::new(Vector3::z() * (reach - depth), Vector3::z() * turn);
    let press = Press::along(vec![shape], vec![vec![pose]]).unwrap();
    let frame = Fem::new(body, options).unwrap().solve_path(&press).pop().unwrap();
    -frame.unwrap().wrench.force.z
}

/// Force of a ball over Hertz's. Its contact radius by Hertz is that of `half_space`'s core patch.
fn ball_over_hertz(poisson: f64, n: usize, shells: usize, size: [f64; 2]) -> f64 {
    let patch = 1e-4f64;
    let (radius, depth) = (50.0 * patch, patch / 50.0);
    let hertz = 4.0 / 3.0 * plane_strain_modulus(poisson) * radius.sqrt() * depth.powf(1.5);
    let block = half_space(patch, n, shells, size);
    force(Shape::Sphere { radius }, 0.0, radius, depth, poisson, block) / hertz
}

/// Force of a flat punch over 2 E* a δ. It has as many sides as the mesh has round the patch, and a
/// is the radius of the disc of its area. It is large because contact is then evaluated at many
/// points of a face.
fn punch_over_exact(poisson: f64, n: usize) -> f64 {
    let (radius, half_height, depth) = (0.02, 0.1, 2e-5);
    let sector = PI / (4 * n) as f64;
    let equal_disc = radius * (sector.sin() / sector).sqrt();
    let exact = 2.0 * plane_strain_modulus(poisson) * equal_disc * depth;
    let punch = Shape::Prism { sides: 8 * n as u32, radius, half_height };
    let block = half_space(radius, n, 3 * n, FAR);
    force(punch, 0.5 * sector, half_height, depth, poisson, block) / exact
}

/// Extrapolated limit of values on meshes of sizes `coarse` and `fine` whose error decreases with
/// the power `order`.
fn extrapolated(coarse: (f64, f64), fine: (f64, f64), order: f64) -> f64 {
    fine.1 - (coarse.1 - fine.1) / ((coarse.0 / fine.0).powf(order) - 1.0)
}

/// Force of a ball over Hertz's on the coarser of two meshes of a half-space.
static BALL_ON_COARSE: LazyLock<f64> = LazyLock::new(|| ball_over_hertz(0.3, 1, 4, FAR));

#[test]
fn a_ball_presses_as_hertz_says() {
    // Displacements proportional to r^{3/2} at the rim allow an energy error of third order.
    let (coarse, fine) = (*BALL_ON_COARSE, ball_over_hertz(0.3, 2, 8, FAR));
    let limit = extrapolated((1.0, coarse), (0.5, fine), 3.0);
    println!("ball: {coarse:.4}, {fine:.4}, extrapolated {limit:.4} of Hertz's force");
    assert!((limit - 1.0).abs() < 0.01, "{coarse}, {fine}, extrapolated {limit} of Hertz's force");
}

#[test]
fn a_flat_end_presses_as_its_closed_form_says() {
    // Displacements proportional to √r at the rim, on rings at distances r = s² with even s: second
    // order.
    let [coarse, fine] = [2, 3].map(|n| punch_over_exact(0.3, n));
    let limit = extrapolated((1.0 / 2.0, coarse), (1.0 / 3.0, fine), 2.0);
    println!("punch: {coarse:.4}, {fine:.4}, extrapolated {limit:.4} of 2 E* a δ");
    assert!((limit - 1.0).abs() < 0.01, "{coarse}, {fine}, extrapolated {limit} of 2 E* a δ");
}

/// Coefficient of the base's effect on the force: α₀ of Dimitriadis et al. (2002), bonded.
fn base_effect(poisson: f64) -> f64 {
    -(1.2876 - 1.4678 * poisson + 1.3442 * poisson * poisson) / (1.0 - poisson)
}

/// Force on a bonded layer over Hertz's, by the series of Dimitriadis et al. (2002).
fn dimitriadis(chi: f64, poisson: f64) -> f64 {
    let beta = (0.6387 - 1.0277 * poisson + 1.5164 * poisson * poisson) / (1.0 - poisson);
    let (x, alpha) = (2.0 * chi / PI, base_effect(poisson));
    let cubic = alpha.powi(3) + 4.0 * PI * PI / 15.0 * beta;
    let quartic = alpha * (alpha.powi(3) + 3.0 * PI * PI / 5.0 * beta);
    1.0 - alpha * x + (alpha * x).powi(2) - cubic * x.powi(3) + quartic * x.powi(4)
}

#[test]
fn a_bonded_layer_stiffens_as_dimitriadis_says() {
    let poisson = 0.3;
    // At χ = 0.2 the series lacks 1.2 %, a seventh of its second-order term (the lift of the base
    // feeds back as f = (1 + k f)^{3/2}).
    let chi = 0.2;
    // Meshes with the same core are too stiff by about the same factor.
    let layer = ball_over_hertz(poisson, 1, 3, [4.0 / chi, 1.0 / chi]) / *BALL_ON_COARSE;
    let series = dimitriadis(chi, poisson);
    println!("layer, χ {chi}: {layer:.4} of the half-space, Dimitriadis {series:.4}");
    assert!((layer / series - 1.0).abs() < 0.015, "χ {chi}: {layer}, series {series}");
}

/// Force of a small ball on a bonded pad of 4 mm over that of the series; the contact radius is
/// 1/57 of the thickness.
fn small_ball_over_series(mesh: TetMesh, bonded: Vec<u32>) -> f64 {
    let (radius, depth, poisson) = (5e-4f64, 1e-5f64, 0.45);
    let hertz = 4.0 / 3.0 * plane_strain_modulus(poisson) * radius.sqrt() * depth.powf(1.5);
    let series = hertz * dimitriadis((radius * depth).sqrt() / 4e-3, poisson);
    force(Shape::Sphere { radius }, 0.0, radius, depth, poisson, (mesh, bonded)) / series
}

#[test]
fn a_small_ball_is_felt_by_a_pad_that_is_fine_under_it() {
    let outline = PadOutline::flat(0.02525, 0.02075, 0.004);
    let patch = (5e-4f64 * 1e-5).sqrt();
    let on_disc = |i: i32| {
        // Points of equal area on a spiral.
        let (r, angle) = (patch * (f64::from(i) / 60.0).sqrt(), 2.4 * f64::from(i));
        Point3::new(r * angle.cos(), r * angle.sin(), 0.0)
    };
    let points: Vec<_> = (0..=60).map(on_disc).collect();
    let pad = outline.graded(&points, 1000).unwrap();
    let fine = small_ball_over_series(pad.mesh, pad.base);
    let usual = PadMesh::with_nodes(&outline, 2000).unwrap();
    let usual = small_ball_over_series(usual.mesh, usual.base);
    println!("small ball: {fine:.4} of the series; {usual:.4} on twice as many nodes as usual");
    assert!((fine - 1.0).abs() < 0.03, "{fine} of the force");
    assert!((usual - 1.0).abs() > 0.3, "{usual} of the force where the pad is not fine");
}
