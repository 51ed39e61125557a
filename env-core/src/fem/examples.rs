//! Examples shared by the tests of this module: boxes of tetrahedra.

use nalgebra::Point3;

use crate::geometry::TetMesh;

/// A lattice of unit cubes, `cells` along each axis, each cut into six tetrahedra round a diagonal
/// (Kuhn), with every vertex mapped by `place`. Vertices are numbered along z first, then y, then
/// x.
pub(super) fn grid(cells: [u32; 3], place: impl Fn(Point3<f64>) -> Point3<f64>) -> TetMesh {
    let [nx, ny, nz] = cells;
    let at = |[i, j, k]: [u32; 3]| (i * (ny + 1) + j) * (nz + 1) + k;
    let lattice = |nx: u32, ny: u32, nz: u32| {
        (0..nx).flat_map(move |i| (0..ny).flat_map(move |j| (0..nz).map(move |k| [i, j, k])))
    };
    let point = |index: [u32; 3]| place(Point3::from(index.map(f64::from)));
    let vertices: Vec<_> = lattice(nx + 1, ny + 1, nz + 1).map(point).collect();
    let mut tets = Vec::new();
    for cell in lattice(nx, ny, nz) {
        for [a, b] in [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]] {
            let mut corner = cell;
            let mut tet = [at(cell); 4];
            for (step, axis) in [a, b, 3 - a - b].into_iter().enumerate() {
                corner[axis] += 1;
                tet[step + 1] = at(corner);
            }
            tets.push(tet);
        }
    }
    TetMesh::new("grid", vertices, tets).expect("a lattice has no defects")
}
