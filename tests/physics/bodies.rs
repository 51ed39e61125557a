//! Meshes of boxes for tests, and a gel pad with the path of a ball on it.

use nalgebra::{Isometry3, Point3};
use ruffini_core::{
    deformation::{Law, Moduli, Press, SoftBody},
    geometry::{Shape, TetMesh},
};

const MM: f64 = 1e-3;

/// A pad of 20.75 × 25.25 × 4 mm, finer in the middle, bonded underneath, its free face at z = 0.
pub(crate) fn gel_pad(cells: [usize; 3]) -> SoftBody {
    let [x, y] = [(10.375 * MM, cells[0]), (12.625 * MM, cells[1])]
        .map(|(half, count)| graded(half, count, 4.0));
    let mesh = grid(&x, &y, &even(-4.0 * MM, 0.0, cells[2]));
    let base = nodes_where(&mesh, |p| p.z < -3.999 * MM);
    let gel = Moduli { young: 2e5, poisson: 0.48 };
    SoftBody::new(mesh, Law::NeoHookean, gel, &base).expect("a pad is a body")
}

/// A ball of radius 4 mm pressed in by 1 mm in ten frames, then moved aside by 0.5 mm in ten.
pub(crate) fn press_and_shear() -> Press {
    let at = |x: f64, depth: f64| vec![Isometry3::translation(x, 0.0, 4.0 * MM - depth)];
    let down = (1..=10).map(|i| at(0.0, 0.1 * MM * f64::from(i)));
    let aside = (1..=10).map(|i| at(0.05 * MM * f64::from(i), MM));
    let ball = vec![Shape::Sphere { radius: 4.0 * MM }];
    Press::along(ball, down.chain(aside).collect()).expect("a path of finite poses")
}

/// A box cut by the coordinate planes `xs`, `ys`, `zs`, each cell into six tetrahedra round a
/// diagonal (Kuhn), mirrored from cell to cell so that no direction is preferred.
pub(crate) fn grid(xs: &[f64], ys: &[f64], zs: &[f64]) -> TetMesh {
    let index = |i: usize, j: usize, k: usize| ((i * ys.len() + j) * zs.len() + k) as u32;
    let mut vertices = Vec::new();
    for &x in xs {
        for &y in ys {
            vertices.extend(zs.iter().map(|&z| Point3::new(x, y, z)));
        }
    }
    let mut tets = Vec::new();
    for i in 0..xs.len() - 1 {
        for j in 0..ys.len() - 1 {
            for k in 0..zs.len() - 1 {
                let corner = |offset: [usize; 3]| {
                    let at = |cell: usize, o: usize| {
                        cell + if cell.is_multiple_of(2) { o } else { 1 - o }
                    };
                    index(at(i, offset[0]), at(j, offset[1]), at(k, offset[2]))
                };
                for [a, b] in [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]] {
                    let (mut first, mut second) = ([0; 3], [0; 3]);
                    first[a] = 1;
                    (second[a], second[b]) = (1, 1);
                    tets.push([[0; 3], first, second, [1; 3]].map(corner));
                }
            }
        }
    }
    for tet in &mut tets {
        let [a, b, c, d] = tet.map(|n| vertices[n as usize]);
        if (b - a).cross(&(c - a)).dot(&(d - a)) < 0.0 {
            tet.swap(2, 3);
        }
    }
    TetMesh { vertices, tets }
}

/// `count` + 1 coordinates from `low` to `high`, equally spaced.
pub(crate) fn even(low: f64, high: f64, count: usize) -> Vec<f64> {
    (0..=count).map(|i| low + (high - low) * i as f64 / count as f64).collect()
}

/// `count` + 1 coordinates from −`half` to `half`, `ratio` times as dense in the middle as at the
/// ends.
pub(crate) fn graded(half: f64, count: usize, ratio: f64) -> Vec<f64> {
    // Density falls linearly, so x(t) = half ((1 − c) t + c t |t|) with slopes 1 − c and 1 + c.
    let c = (ratio - 1.0) / (ratio + 1.0);
    even(-1.0, 1.0, count).into_iter().map(|t| half * ((1.0 - c) * t + c * t * t.abs())).collect()
}

/// Nodes of `mesh` at which `chosen` holds.
pub(crate) fn nodes_where(mesh: &TetMesh, chosen: impl Fn(&Point3<f64>) -> bool) -> Vec<u32> {
    (0..mesh.vertices.len() as u32).filter(|&n| chosen(&mesh.vertices[n as usize])).collect()
}
