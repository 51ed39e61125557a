//! Patches of tetrahedra that share one dilatation, which avoids volumetric locking in `p1-bar`.
//!
//! In a nearly incompressible mesh every linear tetrahedron must keep its volume, and these are
//! more constraints than the nodes have degrees of freedom. Averaging J over disjoint patches (de
//! Souza Neto, Pires and Owen 2005, "F-bar-based linear triangles and tetrahedra") leaves about one
//! constraint per node. Here a patch is the ring of tetrahedra around an edge, longest edges first:
//! in a hexahedral cell cut into six tetrahedra that is the cell.

use std::collections::BTreeMap;

use nalgebra::Point3;

use crate::{
    deformation::Moduli,
    geometry::{EDGES, FACES, TetMesh},
};

/// The mesh's edges, each with its nodes in ascending order, and the tetrahedra around it.
pub(super) fn edges(mesh: &TetMesh) -> BTreeMap<[u32; 2], Vec<u32>> {
    let mut edges: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
    for (i, tet) in mesh.tets.iter().enumerate() {
        for [a, b] in EDGES {
            let (a, b) = (tet[a], tet[b]);
            edges.entry([a.min(b), a.max(b)]).or_default().push(i as u32);
        }
    }
    edges
}

/// Disjoint patches that cover all tetrahedra; within a patch the moduli are equal.
pub(super) fn patches(mesh: &TetMesh, moduli: &[Moduli]) -> Vec<Vec<u32>> {
    let mut patches: Vec<Vec<u32>> = Vec::new();
    let mut patch_of: Vec<Option<usize>> = vec![None; mesh.tets.len()];
    for ring in rings_by_length(mesh) {
        let alike = ring.iter().all(|&t| moduli[t as usize] == moduli[ring[0] as usize]);
        if alike && ring.len() >= 3 && ring.iter().all(|&t| patch_of[t as usize].is_none()) {
            for &t in &ring {
                patch_of[t as usize] = Some(patches.len());
            }
            patches.push(ring);
        }
    }
    adopt_rest(mesh, moduli, &mut patches, &mut patch_of);
    patches
}

/// Rings of tetrahedra around edges, longest edge first; ties are resolved by position, not by
/// number.
fn rings_by_length(mesh: &TetMesh) -> Vec<Vec<u32>> {
    let key = |&[a, b]: &[u32; 2]| {
        let [a, b] = [a, b].map(|n| mesh.vertices[n as usize]);
        let middle: Point3<f64> = nalgebra::center(&a, &b);
        [-(b - a).norm_squared(), middle.x, middle.y, middle.z]
    };
    let mut rings: Vec<_> =
        edges(mesh).into_iter().map(|(edge, ring)| (key(&edge), ring)).collect();
    rings.sort_by(|(a, _), (b, _)| a.partial_cmp(b).expect("coordinates are finite"));
    rings.into_iter().map(|(_, ring)| ring).collect()
}

/// Adds every remaining tetrahedron to the smallest patch it shares a face with, and to the first
/// of equal ones: the order of patches does not depend on the nodes' numbers.
fn adopt_rest(
    mesh: &TetMesh,
    moduli: &[Moduli],
    patches: &mut Vec<Vec<u32>>,
    patch_of: &mut [Option<usize>],
) {
    let beside = face_neighbours(mesh);
    loop {
        let homes: Vec<(u32, usize)> = (0..mesh.tets.len())
            .filter(|&t| patch_of[t].is_none())
            .filter_map(|t| {
                let alike = beside[t].iter().filter(|&&n| moduli[n as usize] == moduli[t]);
                let near = alike.filter_map(|&n| patch_of[n as usize]);
                near.min_by_key(|&p| (patches[p].len(), p)).map(|p| (t as u32, p))
            })
            .collect();
        for &(t, patch) in &homes {
            patch_of[t as usize] = Some(patch);
            patches[patch].push(t);
        }
        if homes.is_empty() {
            break;
        }
    }
    patches.extend((0..mesh.tets.len()).filter(|&t| patch_of[t].is_none()).map(|t| vec![t as u32]));
}

/// For each tetrahedron, those that share a face with it.
fn face_neighbours(mesh: &TetMesh) -> Vec<Vec<u32>> {
    let mut beside = vec![Vec::new(); mesh.tets.len()];
    for owners in faces(mesh).values() {
        if let [(a, _), (b, _)] = owners[..] {
            beside[a as usize].push(b);
            beside[b as usize].push(a);
        }
    }
    beside
}

/// The mesh's faces by their sorted nodes, with each owner and the face's number in it.
pub(super) fn faces(mesh: &TetMesh) -> BTreeMap<[u32; 3], Vec<(u32, usize)>> {
    let mut faces: BTreeMap<[u32; 3], Vec<(u32, usize)>> = BTreeMap::new();
    for (i, tet) in mesh.tets.iter().enumerate() {
        for (k, face) in FACES.iter().enumerate() {
            let mut nodes = face.map(|corner| tet[corner]);
            nodes.sort_unstable();
            faces.entry(nodes).or_default().push((i as u32, k));
        }
    }
    faces
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::geometry::Shape;

    #[test]
    fn patches_are_the_same_however_the_mesh_is_numbered() {
        let semi_axes = Vector3::new(0.010, 0.008, 0.006);
        let mesh = TetMesh::of_shape(&Shape::Ellipsoid { semi_axes }, 2e-3).unwrap();
        let (nodes, tets) = (mesh.vertices.len(), mesh.tets.len());
        // Primes that divide neither number make permutations.
        assert!(
            !nodes.is_multiple_of(1009) && !tets.is_multiple_of(1013),
            "{nodes} nodes, {tets} tetrahedra"
        );
        let [node, tet] = [(1009, nodes), (1013, tets)].map(|(p, n)| move |i: usize| i * p % n);
        let mut other = mesh.clone();
        for (i, place) in mesh.vertices.iter().enumerate() {
            other.vertices[node(i)] = *place;
        }
        for (t, [a, b, c, d]) in mesh.tets.iter().enumerate() {
            other.tets[tet(t)] = [b, c, a, d].map(|&n| node(n as usize) as u32);
        }
        let moduli = vec![Moduli { young: 1e5, poisson: 0.45 }; tets];
        let sorted = |mesh: &TetMesh, number: &dyn Fn(usize) -> usize| {
            let numbered = |patch: Vec<u32>| {
                let mut patch: Vec<_> = patch.into_iter().map(|t| number(t as usize)).collect();
                patch.sort_unstable();
                patch
            };
            let mut patches: Vec<_> = patches(mesh, &moduli).into_iter().map(numbered).collect();
            patches.sort_unstable();
            patches
        };
        let [plain, renumbered] = [sorted(&mesh, &|t| tet(t)), sorted(&other, &|t| t)];
        let alike = plain.iter().filter(|patch| renumbered.binary_search(patch).is_ok()).count();
        assert!(alike == plain.len(), "{alike} of {} patches are the same", plain.len());
    }
}
