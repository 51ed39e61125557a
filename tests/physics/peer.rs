//! Comparison with an independent solver: the same pad, ball, material and contact law in
//! scikit-fem.
//!
//! The numbers come from `tests/reference/peer.py`, which describes them.

use nalgebra::Vector3;
use ruffini_core::{
    deformation::{Deformation, SoftBody},
    fem::{Element, Fem, FemOptions},
};
use serde::Deserialize;

use crate::bodies::{gel_pad, press_and_shear};

/// Last frames of the reference for one element.
#[derive(Deserialize)]
struct ReferenceFrames {
    press: ReferenceFrame,
    shear: ReferenceFrame,
}

#[derive(Deserialize)]
struct ReferenceFrame {
    /// Force on the pad (N).
    force: Vector3<f64>,
    /// Displacement of the vertices (m), x, y, z of each in turn.
    displacement: Vec<f64>,
    /// Von Mises stress of the tetrahedra (Pa).
    von_mises: Vec<f64>,
}

fn answers(json: &str) -> ReferenceFrames {
    serde_json::from_str(json).expect("the peer's file is JSON")
}

/// Relative L² distance of fields given as pairs (ours, theirs) with weights.
fn distance(pairs: impl Iterator<Item = (f64, f64, f64)>) -> f64 {
    let add = |(gap, size): (f64, f64), (weight, ours, theirs): (f64, f64, f64)| {
        (gap + weight * (ours - theirs).powi(2), size + weight * theirs.powi(2))
    };
    let (gap, size) = pairs.fold((0.0, 0.0), add);
    (gap / size).sqrt()
}

/// Relative distances of displacement, von Mises stress and force.
fn distances(body: &SoftBody, ours: &Deformation, theirs: &ReferenceFrame) -> [f64; 3] {
    let mesh = body.mesh();
    let volume = |t: usize| mesh.tet_volume(t);
    assert_eq!(theirs.displacement.len(), 3 * mesh.vertices.len());
    assert_eq!(theirs.von_mises.len(), mesh.tets.len());
    // A vertex represents a quarter of its tetrahedra.
    let mut share = vec![0.0; mesh.vertices.len()];
    for (t, tet) in mesh.tets.iter().enumerate() {
        for &node in tet {
            share[node as usize] += volume(t) / 4.0;
        }
    }
    let weights = share.iter().flat_map(|&share| [share; 3]);
    let displacement = ours.displacement.iter().flat_map(|u| [u.x, u.y, u.z]);
    let displacement = weights.zip(displacement).zip(&theirs.displacement);
    let stress = ours.von_mises.iter().zip(&theirs.von_mises).enumerate();
    [
        distance(displacement.map(|((weight, ours), &theirs)| (weight, ours, theirs))),
        distance(stress.map(|(t, (&ours, &theirs))| (volume(t), ours, theirs))),
        (ours.wrench.force - theirs.force).norm() / theirs.force.norm(),
    ]
}

fn compare(element: Element, friction: f64, frame: usize, theirs: &ReferenceFrame) {
    let options = FemOptions { element, friction, ..FemOptions::default() };
    let fem = Fem::new(gel_pad([14, 16, 3]), options).unwrap();
    let ours = fem.solve_path(&press_and_shear()).swap_remove(frame).unwrap();
    let [displacement, von_mises, force] = distances(fem.body(), &ours, theirs);
    let report = format!(
        "{element}, μ {friction}: displacement {:.3} %, von Mises {:.3} %, force {:.3} %; \
         {:.5?} N against {:.5?} N",
        100.0 * displacement,
        100.0 * von_mises,
        100.0 * force,
        ours.wrench.force.as_slice(),
        theirs.force.as_slice(),
    );
    println!("{report}");
    // Agreement of independent codes among themselves on one mesh.
    assert!(displacement < 0.02 && von_mises < 0.02 && force < 0.01, "{report}");
}

#[test]
fn linear_elements_agree_with_scikit_fem() {
    let theirs = answers(include_str!("../reference/peer_p1.json"));
    compare(Element::P1, 0.0, 9, &theirs.press);
    compare(Element::P1, 0.5, 19, &theirs.shear);
}

#[test]
fn quadratic_elements_agree_with_scikit_fem() {
    let theirs = answers(include_str!("../reference/peer_p2.json"));
    compare(Element::P2, 0.0, 9, &theirs.press);
    compare(Element::P2, 0.5, 19, &theirs.shear);
}
