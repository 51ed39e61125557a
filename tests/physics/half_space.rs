//! Meshes of a block large enough to approximate a half-space or a layer, fine where it is pressed.

use std::{
    collections::BTreeMap,
    f64::consts::{FRAC_PI_2, FRAC_PI_4},
};

use nalgebra::{Point3, Vector3};
use ruffini_core::geometry::TetMesh;

use crate::bodies::{even, grid};

/// Radius and depth of the fine core, in radii of the patch.
const CORE: f64 = 2.0;

/// A block under z = 0, bonded all round, with a fine core under a patch of radius `a`: 2 n cells
/// across the patch, in rings, and `shells` that grow until the block reaches `width` patch radii
/// sideways and `depth` down. Returns the mesh and the nodes on its bonded sides.
pub(crate) fn half_space(
    a: f64,
    n: usize,
    shells: usize,
    [width, depth]: [f64; 2],
) -> (TetMesh, Vec<u32>) {
    let rings = 2 * n;
    let ticks: Vec<_> = even(-CORE, CORE, 2 * rings).into_iter().map(towards_rim).collect();
    let heights: Vec<_> = even(-CORE, 0.0, rings).into_iter().map(|t| -t * t / CORE).collect();
    let mut core = grid(&ticks, &ticks, &heights);
    core.vertices.iter_mut().for_each(|vertex| *vertex = in_rings(vertex) * a);
    extrude(&core, shells, &(Vector3::new(width, width, depth) / CORE))
}

/// Moves the ticks of [−2, 2] towards ±1, where the pressure under a punch is singular.
fn towards_rim(t: f64) -> f64 {
    let off = t.abs() - 1.0;
    t.signum() * (1.0 + off.signum() * off * off)
}

/// Maps squares about the z axis to circles (Shirley and Chiu 1997).
fn in_rings(p: &Point3<f64>) -> Point3<f64> {
    let radius = p.x.abs().max(p.y.abs());
    if radius == 0.0 {
        return *p;
    }
    let angle = if p.x.abs() == radius {
        FRAC_PI_4 * p.y / p.x + if p.x < 0.0 { 2.0 * FRAC_PI_2 } else { 0.0 }
    } else {
        p.y.signum() * FRAC_PI_2 - FRAC_PI_4 * p.x / p.y
    };
    Point3::new(radius * angle.cos(), radius * angle.sin(), p.z)
}

/// Adds `shells` around the buried faces of `core`, up to `size` times its size, and returns the
/// outermost nodes, too. Steps are even in r^(−1/3), which distributes the error of u ~ 1/r evenly.
fn extrude(core: &TetMesh, shells: usize, size: &Vector3<f64>) -> (TetMesh, Vec<u32>) {
    let buried = |face: &[u32; 3]| face.iter().any(|&n| core.vertices[n as usize].z < 0.0);
    let faces: Vec<_> = core.boundary().into_iter().filter(buried).collect();
    let mut skin: Vec<u32> = faces.iter().flatten().copied().collect();
    skin.sort_unstable();
    skin.dedup();
    let rank: BTreeMap<u32, u32> = skin.iter().copied().zip(0..).collect();
    let (first, step) = (core.vertices.len() as u32, skin.len() as u32);
    let node = |n: u32, k: u32| if k == 0 { n } else { first + (k - 1) * step + rank[&n] };
    let (mut vertices, mut tets) = (core.vertices.clone(), core.tets.clone());
    for k in 1..=shells as u32 {
        let t = f64::from(k) / shells as f64;
        let growth = size.map(|size| (1.0 + (size.powf(-1.0 / 3.0) - 1.0) * t).powi(-3));
        let grown =
            |&n: &u32| Point3::from(core.vertices[n as usize].coords.component_mul(&growth));
        vertices.extend(skin.iter().map(grown));
        for face in &faces {
            // Prisms are divided by increasing node number, so that neighbours match.
            let mut corners = *face;
            corners.sort_unstable();
            let [a, b, c] = corners.map(|n| node(n, k - 1));
            let [p, q, r] = corners.map(|n| node(n, k));
            tets.extend([[a, b, c, r], [a, b, q, r], [a, p, q, r]]);
        }
    }
    let outermost = skin.iter().map(|&n| node(n, shells as u32)).collect();
    (TetMesh::new("half-space", vertices, tets).unwrap(), outermost)
}
