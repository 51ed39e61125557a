//! Elastic energy of a meshed body, its forces on the nodes and its stiffness.

use nalgebra::{Matrix3, Vector3};

use super::{
    element::{Cell, Element, Nodes, linear_cells, quadratic_cells},
    material::{Material, Tangent, Volumetric},
    sparse::{FIXED, Matrix, Pattern},
};
use crate::deformation::SoftBody;

/// An elastic body in one discretisation. Nodal arrays have N entries.
pub(super) trait Solid: Send + Sync {
    /// Elastic energy (J), its gradient added to `gradient` (N), or `None` if an element is
    /// inverted. What the stiffness needs is kept in `strain`.
    fn evaluate(
        &self,
        displacement: &[Vector3<f64>],
        strain: &mut Strain,
        gradient: &mut [Vector3<f64>],
    ) -> Option<f64>;

    /// Adds ∂²E/∂u² at the last evaluated `strain`; `filtered` makes each element's part positive.
    fn assemble(&self, strain: &Strain, pattern: &Pattern, matrix: &mut Matrix, filtered: bool);

    /// Von Mises stress, volume average over each tetrahedron (T) in Pa.
    fn von_mises(&self, displacement: &[Vector3<f64>]) -> Vec<f64>;

    /// Sets of nodes that are coupled.
    fn couplings(&self) -> Vec<&[u32]>;

    /// Looks up where the cells' blocks lie in `pattern`.
    fn locate(&mut self, pattern: &Pattern);
}

/// State of the energy points, in the order of the cells.
#[derive(Clone, Debug, Default)]
pub(super) struct Strain {
    points: Vec<(Matrix3<f64>, Volumetric)>,
}

/// The body that `element` makes of `body`.
pub(super) fn solid(body: &SoftBody, nodes: &Nodes, element: Element) -> Box<dyn Solid> {
    let mesh = body.mesh();
    match element {
        Element::P1 => Box::new(Cells::new(body, linear_cells(mesh, body.moduli(), false))),
        Element::P1Bar => Box::new(Cells::new(body, linear_cells(mesh, body.moduli(), true))),
        Element::P2 => Box::new(Cells::new(body, quadratic_cells(mesh, nodes))),
    }
}

struct Cells<const M: usize> {
    cells: Vec<Cell<M>>,
    /// Material of each cell.
    materials: Vec<Material>,
    /// Where each cell's lower triangle goes, by rows.
    blocks: Vec<CellBlocks>,
    tets: usize,
}

/// For each pair (i, j), j ≤ i, of the cell's free nodes: the place of i and the pair's block.
type CellBlocks = Vec<(u32, u32)>;

impl<const M: usize> Cells<M> {
    fn new(body: &SoftBody, cells: Vec<Cell<M>>) -> Self {
        let moduli = |cell: &Cell<M>| &body.moduli()[cell.points[0].tet as usize];
        let materials = cells.iter().map(|cell| Material::new(body.law(), moduli(cell))).collect();
        Self { cells, materials, blocks: Vec::new(), tets: body.mesh().tets.len() }
    }
}

impl<const M: usize> Cell<M> {
    /// Deformation gradient F = 1 + Σ uₐ ⊗ ∇Nₐ at point `k`.
    fn deformation_gradient(&self, k: usize, displacement: &[Vector3<f64>]) -> Matrix3<f64> {
        let point = &self.points[k];
        let mut f = Matrix3::identity();
        for (&local, gradient) in point.local.iter().zip(&point.gradients) {
            let u = displacement[self.nodes[local as usize] as usize];
            f += u * gradient.transpose();
        }
        f
    }

    /// U of the cell's points: each its own, or that of their mean dilatation.
    fn volumetric(&self, material: &Material, states: &mut [(Matrix3<f64>, Volumetric)]) {
        if !self.averaged {
            for (f, volumetric) in states {
                *volumetric = material.volumetric(material.dilatation(f));
            }
            return;
        }
        let (mut volume, mut deformed) = (0.0, 0.0);
        for (point, (f, _)) in self.points.iter().zip(states.iter()) {
            volume += point.volume;
            deformed += point.volume * material.dilatation(f);
        }
        let shared = material.volumetric(deformed / volume);
        states.iter_mut().for_each(|(_, volumetric)| *volumetric = shared);
    }

    /// ∂θ/∂u times volume, summed over `points`, for the cell's nodes.
    fn dilatation_gradient(
        &self,
        material: &Material,
        points: std::ops::Range<usize>,
        states: &[(Matrix3<f64>, Volumetric)],
    ) -> (Vec<Vector3<f64>>, f64) {
        let (mut gradient, mut volume) = (vec![Vector3::zeros(); self.nodes.len()], 0.0);
        for (point, (f, _)) in self.points[points.clone()].iter().zip(&states[points]) {
            let slope = material.dilatation_gradient(f) * point.volume;
            for (&local, g) in point.local.iter().zip(&point.gradients) {
                gradient[local as usize] += slope * g;
            }
            volume += point.volume;
        }
        (gradient, volume)
    }

    /// Stiffness of the cell: blocks of its nodes, lower triangle by rows, into `dense`.
    fn stiffness(
        &self,
        material: &Material,
        states: &[(Matrix3<f64>, Volumetric)],
        filtered: bool,
        dense: &mut Vec<Matrix3<f64>>,
    ) {
        let count = self.nodes.len();
        dense.clear();
        dense.resize(count * (count + 1) / 2, Matrix3::zeros());
        for (point, (f, volumetric)) in self.points.iter().zip(states) {
            let tangent = material.tangent(f, volumetric.pressure);
            let tangent = if filtered { tangent.filtered() } else { tangent };
            add_tangent(&tangent, &point.local, &point.gradients, point.volume, dense);
        }
        let groups = if self.averaged { 1 } else { self.points.len() };
        let size = self.points.len() / groups;
        for group in 0..groups {
            let points = group * size..(group + 1) * size;
            let stiffness = states[points.start].1.stiffness;
            let stiffness = if filtered { stiffness.abs() } else { stiffness };
            let (gradient, volume) = self.dilatation_gradient(material, points, states);
            for i in 0..count {
                let scaled = gradient[i] * (stiffness / volume);
                for j in 0..=i {
                    dense[i * (i + 1) / 2 + j] += scaled * gradient[j].transpose();
                }
            }
        }
    }
}

fn add_tangent<const M: usize>(
    tangent: &Tangent,
    local: &[u8; M],
    gradients: &[Vector3<f64>; M],
    volume: f64,
    dense: &mut [Matrix3<f64>],
) {
    for a in 0..M {
        for b in 0..M {
            let (i, j) = (local[a] as usize, local[b] as usize);
            if j <= i {
                let block = tangent.block(&gradients[a], &gradients[b]);
                dense[i * (i + 1) / 2 + j] += block * volume;
            }
        }
    }
}

impl<const M: usize> Solid for Cells<M> {
    fn evaluate(
        &self,
        displacement: &[Vector3<f64>],
        strain: &mut Strain,
        gradient: &mut [Vector3<f64>],
    ) -> Option<f64> {
        let mut energy = 0.0;
        strain.points.clear();
        for (cell, material) in self.cells.iter().zip(&self.materials) {
            let first = strain.points.len();
            for k in 0..cell.points.len() {
                let f = cell.deformation_gradient(k, displacement);
                if !material.admits(&f) {
                    return None;
                }
                strain.points.push((f, Volumetric::default()));
            }
            let states = &mut strain.points[first..];
            cell.volumetric(material, states);
            for (point, (f, volumetric)) in cell.points.iter().zip(states.iter()) {
                energy += point.volume * (material.distortion(f) + volumetric.energy);
                let stress = material.stress(f, volumetric.pressure) * point.volume;
                for (&local, g) in point.local.iter().zip(&point.gradients) {
                    gradient[cell.nodes[local as usize] as usize] += stress * g;
                }
            }
        }
        energy.is_finite().then_some(energy)
    }

    fn assemble(&self, strain: &Strain, pattern: &Pattern, matrix: &mut Matrix, filtered: bool) {
        let (mut dense, mut first) = (Vec::new(), 0);
        for ((cell, material), blocks) in self.cells.iter().zip(&self.materials).zip(&self.blocks) {
            let states = &strain.points[first..first + cell.points.len()];
            first += cell.points.len();
            cell.stiffness(material, states, filtered, &mut dense);
            for (&(high, block), value) in blocks.iter().zip(&dense) {
                matrix.add(pattern, high, block, value);
            }
        }
    }

    fn von_mises(&self, displacement: &[Vector3<f64>]) -> Vec<f64> {
        let (mut sum, mut volume) = (vec![0.0; self.tets], vec![0.0; self.tets]);
        for (cell, material) in self.cells.iter().zip(&self.materials) {
            for (k, point) in cell.points.iter().enumerate() {
                let f = cell.deformation_gradient(k, displacement);
                sum[point.tet as usize] += point.volume * material.von_mises(&f);
                volume[point.tet as usize] += point.volume;
            }
        }
        sum.iter().zip(&volume).map(|(sum, volume)| sum / volume).collect()
    }

    fn couplings(&self) -> Vec<&[u32]> {
        self.cells.iter().map(|cell| &cell.nodes[..]).collect()
    }

    fn locate(&mut self, pattern: &Pattern) {
        let place = |node: u32| pattern.place[node as usize];
        self.blocks = self
            .cells
            .iter_mut()
            .map(|cell| {
                sort_nodes(cell, place);
                let places: Vec<u32> = cell.nodes.iter().map(|&node| place(node)).collect();
                let free = places.iter().filter(|&&place| place != FIXED).count();
                let pairs = (0..free).flat_map(|i| (0..=i).map(move |j| (i, j)));
                pairs.map(|(i, j)| (places[i], pattern.block(places[i], places[j]))).collect()
            })
            .collect();
    }
}

/// Puts the cell's nodes in the order of elimination.
fn sort_nodes<const M: usize>(cell: &mut Cell<M>, place: impl Fn(u32) -> u32) {
    let mut rank: Vec<usize> = (0..cell.nodes.len()).collect();
    rank.sort_by_key(|&i| place(cell.nodes[i]));
    let mut renumbered = vec![0; rank.len()];
    rank.iter().enumerate().for_each(|(new, &old)| renumbered[old] = new as u8);
    cell.nodes = rank.iter().map(|&old| cell.nodes[old]).collect();
    for point in &mut cell.points {
        point.local = point.local.map(|old| renumbered[old as usize]);
    }
}
