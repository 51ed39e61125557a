//! Elastic energy of a meshed body, its forces on the nodes and its stiffness.

use nalgebra::{Matrix3, Vector3};

use super::{
    cell::PointState,
    element::{Cell, Element, Nodes, linear_cells, quadratic_cells},
    material::{Material, Volumetric},
    pattern::{BlockPosition, Pattern},
    sparse::Matrix,
};
use crate::deformation::SoftBody;

/// An elastic body in one discretisation. Nodal arrays have N entries.
pub(super) trait Solid: Send + Sync {
    /// Returns the elastic energy (J) and adds its gradient to `gradient` (N), or returns `None` if
    /// an element is inverted. Stores in `strain` the state that the stiffness is computed from.
    fn evaluate(
        &self,
        displacement: &[Vector3<f64>],
        strain: &mut Strain,
        gradient: &mut [Vector3<f64>],
    ) -> Option<f64>;

    /// Adds ∂²E/∂u² at the last evaluated `strain` to `matrix`, at the positions in `map`;
    /// `filtered` makes each element's part positive.
    fn assemble(&self, strain: &Strain, map: &AssemblyMap, matrix: &mut Matrix, filtered: bool);

    /// Von Mises stress, volume average over each tetrahedron (T) in Pa; NaN for an inverted one.
    fn von_mises(&self, displacement: &[Vector3<f64>]) -> Vec<f64>;

    /// Cauchy stress, volume average over each tetrahedron (T) in Pa; NaN for one whose element has
    /// an inverted part.
    fn cauchy(&self, displacement: &[Vector3<f64>]) -> Vec<Matrix3<f64>>;

    /// Sets of nodes that are coupled.
    fn couplings(&self) -> Vec<&[u32]>;

    /// Positions of the parts of the stiffness in `pattern`.
    fn assembly_map(&self, pattern: &Pattern) -> AssemblyMap;
}

/// Position of the coupling of each pair (i, j), j ≤ i, of each cell's nodes, if both are free.
pub(super) type AssemblyMap = Vec<Option<BlockPosition>>;

/// State of the energy points, in the order of the cells.
#[derive(Clone, Debug, Default)]
pub(super) struct Strain {
    points: Vec<PointState>,
}

/// Discretises `body` by elements of the kind `element`.
pub(super) fn solid(body: &SoftBody, nodes: &Nodes, element: Element) -> Box<dyn Solid> {
    let mesh = body.mesh();
    match element {
        Element::P1 => Box::new(Cells::new(body, linear_cells(mesh, body.moduli(), false))),
        Element::P1Bar => Box::new(Cells::new(body, linear_cells(mesh, body.moduli(), true))),
        Element::P2 => Box::new(Cells::new(body, quadratic_cells(mesh, nodes))),
    }
}

struct Cells<const M: usize> {
    all: Vec<Cell<M>>,
    /// Material of each cell.
    materials: Vec<Material>,
    tets: usize,
}

impl<const M: usize> Cells<M> {
    fn new(body: &SoftBody, cells: Vec<Cell<M>>) -> Self {
        let moduli = |cell: &Cell<M>| &body.moduli()[cell.points[0].tet as usize];
        let materials = cells.iter().map(|cell| Material::new(body.law(), moduli(cell))).collect();
        Self { all: cells, materials, tets: body.mesh().tets.len() }
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
        for (cell, material) in self.all.iter().zip(&self.materials) {
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

    fn assemble(&self, strain: &Strain, map: &AssemblyMap, matrix: &mut Matrix, filtered: bool) {
        let (mut dense, mut first, mut positions) = (Vec::new(), 0, map.iter());
        for (cell, material) in self.all.iter().zip(&self.materials) {
            let states = &strain.points[first..first + cell.points.len()];
            first += cell.points.len();
            cell.stiffness(material, states, filtered, &mut dense);
            for (value, position) in dense.iter().zip(&mut positions) {
                if let Some(position) = position {
                    matrix.add(*position, value);
                }
            }
        }
    }

    fn von_mises(&self, displacement: &[Vector3<f64>]) -> Vec<f64> {
        let (mut sum, mut volume) = (vec![0.0; self.tets], vec![0.0; self.tets]);
        for (cell, material) in self.all.iter().zip(&self.materials) {
            for (k, point) in cell.points.iter().enumerate() {
                let f = cell.deformation_gradient(k, displacement);
                let stress = if material.admits(&f) { material.von_mises(&f) } else { f64::NAN };
                sum[point.tet as usize] += point.volume * stress;
                volume[point.tet as usize] += point.volume;
            }
        }
        sum.iter().zip(&volume).map(|(sum, volume)| sum / volume).collect()
    }

    fn cauchy(&self, displacement: &[Vector3<f64>]) -> Vec<Matrix3<f64>> {
        let (mut sum, mut volume) = (vec![Matrix3::zeros(); self.tets], vec![0.0; self.tets]);
        for (cell, material) in self.all.iter().zip(&self.materials) {
            let state = |k| (cell.deformation_gradient(k, displacement), Volumetric::default());
            let mut states: Vec<PointState> = (0..cell.points.len()).map(state).collect();
            if states.iter().all(|(f, _)| material.admits(f)) {
                cell.volumetric(material, &mut states);
            } else {
                for (_, volumetric) in &mut states {
                    volumetric.pressure = f64::NAN;
                }
            }
            for (point, (f, volumetric)) in cell.points.iter().zip(&states) {
                let stress = material.cauchy(f, volumetric.pressure);
                sum[point.tet as usize] += point.volume * stress;
                volume[point.tet as usize] += point.volume;
            }
        }
        sum.iter().zip(&volume).map(|(sum, volume)| sum / *volume).collect()
    }

    fn couplings(&self) -> Vec<&[u32]> {
        self.all.iter().map(|cell| &cell.nodes[..]).collect()
    }

    fn assembly_map(&self, pattern: &Pattern) -> AssemblyMap {
        let pairs = |cell: &Cell<M>| {
            let nodes = &cell.nodes;
            let row = |i: usize| (0..=i).map(move |j| pattern.position(nodes[i], nodes[j]));
            (0..nodes.len()).flat_map(row).collect::<Vec<_>>()
        };
        self.all.iter().flat_map(pairs).collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3};

    use super::*;
    use crate::{
        deformation::{Law, Moduli},
        fem::examples::grid,
        geometry::TetMesh,
    };

    /// A cube of 27 nodes in 48 tetrahedra, its inner node out of line.
    fn cube() -> TetMesh {
        let mut mesh = grid([2; 3], |p| p * 0.001);
        mesh.vertices[13] += Vector3::new(2e-4, -1e-4, 1.5e-4);
        mesh
    }

    fn setup(law: Law, element: Element, fixed: &[u32]) -> (Nodes, Box<dyn Solid>, Pattern) {
        let moduli = Moduli { young: 1e5, poisson: 0.45 };
        let body = SoftBody::new(cube(), law, moduli, fixed).unwrap();
        let nodes = Nodes::new(&body, element);
        let solid = solid(&body, &nodes, element);
        let pattern = Pattern::new(&nodes.places, &nodes.fixed, &solid.couplings());
        (nodes, solid, pattern)
    }

    fn every() -> impl Iterator<Item = (Law, Element)> {
        let elements = Element::NAMES.map(|(_, element)| element);
        Law::NAMES.into_iter().flat_map(move |(_, law)| elements.map(|element| (law, element)))
    }

    fn displaced(nodes: &Nodes, f: &Matrix3<f64>) -> Vec<Vector3<f64>> {
        nodes.places.iter().map(|x| (f - Matrix3::identity()) * x.coords).collect()
    }

    fn inside(x: &Point3<f64>) -> bool {
        x.iter().all(|&x| x > 1e-6 && x < 0.002 - 1e-6)
    }

    #[test]
    fn a_uniform_strain_is_in_equilibrium_on_a_distorted_mesh() {
        let f = Matrix3::new(1.1, 0.2, 0.0, -0.1, 0.9, 0.1, 0.05, 0.0, 1.2);
        for (law, element) in every() {
            let (nodes, solid, _) = setup(law, element, &[]);
            let mut forces = vec![Vector3::zeros(); nodes.places.len()];
            solid.evaluate(&displaced(&nodes, &f), &mut Strain::default(), &mut forces).unwrap();
            let largest = forces.iter().map(Vector3::norm).fold(0.0, f64::max);
            for (x, force) in nodes.places.iter().zip(&forces).filter(|(x, _)| inside(x)) {
                // Sums of a few dozen terms of the size of the largest force.
                let rest = force.norm() / largest;
                assert!(rest < 1e-9, "{law} {element}: {rest:.1e} of the largest force at {x}");
            }
        }
    }

    /// P: its columns are the forces on the sides x, y, z = 2 mm over their areas.
    fn mean_stress(law: Law, element: Element, f: &Matrix3<f64>) -> Matrix3<f64> {
        let (nodes, solid, _) = setup(law, element, &[]);
        let mut forces = vec![Vector3::zeros(); nodes.places.len()];
        solid.evaluate(&displaced(&nodes, f), &mut Strain::default(), &mut forces).unwrap();
        // The nodes of two opposite sides carry the whole force across the middle.
        let moment: Matrix3<f64> =
            nodes.places.iter().zip(&forces).map(|(x, f)| f * x.coords.transpose()).sum();
        moment / 0.002f64.powi(3)
    }

    #[test]
    fn cauchy_stress_of_a_uniform_strain_is_that_of_the_forces() {
        let f = Matrix3::new(1.1, 0.2, 0.0, -0.1, 0.9, 0.1, 0.05, 0.0, 1.2);
        for (law, element) in every() {
            let (nodes, solid, _) = setup(law, element, &[]);
            let first = mean_stress(law, element, &f);
            let exact = match law {
                Law::Linear => first,
                _ => first * f.transpose() / f.determinant(),
            };
            for found in solid.cauchy(&displaced(&nodes, &f)) {
                let error = (found - exact).norm() / exact.norm();
                assert!(error < 1e-8, "{law} {element}: {found} Pa against {exact} Pa");
            }
        }
    }

    /// The virial of the forces on the deformed nodes is the integral of the Cauchy stress.
    #[test]
    fn cauchy_stress_of_an_uneven_strain_adds_up_to_the_virial_of_the_forces() {
        let (mesh, f) = (cube(), Matrix3::new(1.1, 0.2, 0.0, -0.1, 0.9, 0.1, 0.05, 0.0, 1.2));
        for (law, element) in every().filter(|(law, _)| *law != Law::Linear) {
            let (nodes, solid, _) = setup(law, element, &[]);
            let mut moved = displaced(&nodes, &f);
            moved[13] += Vector3::new(-1e-4, 2e-4, 1e-4);
            let mut forces = vec![Vector3::zeros(); moved.len()];
            solid.evaluate(&moved, &mut Strain::default(), &mut forces).unwrap();
            let places = nodes.places.iter().zip(&moved).map(|(x, u)| x.coords + u);
            let virial: Matrix3<f64> =
                places.zip(&forces).map(|(x, force)| force * x.transpose()).sum();
            let stress = solid.cauchy(&moved);
            let volume = |tet: &[u32; 4]| {
                let [a, b, c, d] =
                    tet.map(|i| mesh.vertices[i as usize].coords + moved[i as usize]);
                (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
            };
            let whole: Matrix3<f64> =
                mesh.tets.iter().zip(&stress).map(|(tet, stress)| stress * volume(tet)).sum();
            let error = (whole - virial).norm() / virial.norm();
            // Within a quadratic element stress and volume vary, and the means are taken apart.
            assert!(element == Element::P2 || error < 1e-9, "{law} {element}: {error:.1e}");
            for (stress, von_mises) in stress.iter().zip(solid.von_mises(&moved)) {
                let deviator = stress - Matrix3::identity() * (stress.trace() / 3.0);
                let own = (1.5 * deviator.norm_squared()).sqrt();
                assert!((stress - stress.transpose()).norm() < 1e-9 * stress.norm(), "{stress}");
                // Of quadratic elements it is the mean of the equivalents, which is not less.
                let off = own / von_mises - 1.0;
                let even = if element == Element::P2 { -0.5..1e-9 } else { -1e-9..1e-9 };
                assert!(even.contains(&off), "{law} {element}: {own} Pa, {von_mises} Pa");
            }
        }
    }

    #[test]
    fn stretch_and_shear_by_half_give_the_stress_of_the_law() {
        let moduli = Moduli { young: 1e5, poisson: 0.45 };
        let (mu, lambda) = (moduli.shear(), moduli.lambda());
        let stretch = Matrix3::from_diagonal(&[1.5, 1.0, 1.0].into());
        let mut shear = Matrix3::identity();
        shear[(1, 0)] = 0.5;
        for (law, element) in every() {
            // Confined stretch by s: P₁₁ from dψ/ds; shear by γ at J = 1: P₂₁ from dψ/dγ.
            let s = 1.5f64;
            let (tension, drag) = match law {
                Law::NeoHookean => (mu * (s - 1.0 / s) + lambda * s.ln() / s, mu * 0.5),
                Law::StableNeoHookean => (mu * (s - 1.0) + (lambda + mu) * (s - 1.0), mu * 0.5),
                Law::Corotated => {
                    // Singular values of [[1, 0], [γ, 1]] sum to √(4 + γ²).
                    let sum = (4.0 + 0.25f64).sqrt();
                    let drag = 2.0 * mu * 0.5 * (1.0 - 1.0 / sum);
                    ((2.0 * mu + lambda) * (s - 1.0), drag)
                }
                _ => ((2.0 * mu + lambda) * (s - 1.0), mu * 0.5),
            };
            let [pulled, sheared] = [stretch, shear].map(|f| mean_stress(law, element, &f));
            let found = [pulled[(0, 0)], sheared[(1, 0)]];
            for (found, exact) in found.into_iter().zip([tension, drag]) {
                let error = (found / exact - 1.0).abs();
                assert!(error < 1e-8, "{law} {element}: {found} Pa against {exact} Pa");
            }
        }
    }

    #[test]
    fn pulled_by_half_with_free_sides_it_bears_the_tension_of_the_law() {
        let moduli = Moduli { young: 1e5, poisson: 0.45 };
        let (mu, lambda, s) = (moduli.shear(), moduli.lambda(), 1.5f64);
        for (law, element) in every() {
            // P₁₁ and P₂₂ at stretches s, t and t, J = s t²; t is where P₂₂ = 0.
            let stresses = |t: f64| {
                let j = s * t * t;
                match law {
                    Law::NeoHookean => [s, t].map(|x| mu * (x - 1.0 / x) + lambda * j.ln() / x),
                    Law::StableNeoHookean => {
                        [s, t].map(|x| mu * x + ((lambda + mu) * (j - 1.0) - mu) * j / x)
                    }
                    Law::Corotated => {
                        [s, t].map(|x| 2.0 * mu * (x - 1.0) + lambda * (j - 1.0) * j / x)
                    }
                    _ => [s, t].map(|x| 2.0 * mu * (x - 1.0) + lambda * (s + 2.0 * t - 3.0)),
                }
            };
            let (mut low, mut high) = (0.5, 1.0);
            for _ in 0..60 {
                let t = 0.5 * (low + high);
                if stresses(t)[1] > 0.0 { high = t } else { low = t }
            }
            let f = Matrix3::from_diagonal(&[s, low, low].into());
            let found = mean_stress(law, element, &f);
            let tension = stresses(low)[0];
            let rest = (found - Matrix3::from_diagonal(&[tension, 0.0, 0.0].into())).norm();
            assert!(rest < 1e-8 * tension, "{law} {element}: {found} Pa against {tension} Pa");
        }
    }

    #[test]
    fn forces_and_stiffness_are_derivatives_of_the_energy() {
        let f = Matrix3::new(1.1, 0.1, 0.0, -0.1, 0.95, 0.05, 0.05, 0.0, 1.0);
        let base: Vec<u32> = (0..27).filter(|n| n % 3 == 0).collect();
        for (law, element) in every() {
            let (nodes, solid, pattern) = setup(law, element, &base);
            let wave = |x: &Point3<f64>| Vector3::new(x.z, x.x, x.y).map(|x| (2e3 * x).sin());
            let mut start = displaced(&nodes, &f);
            start.iter_mut().zip(&nodes.places).for_each(|(u, x)| *u += 3e-5 * wave(x));
            let direction: Vec<_> =
                pattern.scatter(&pattern.gather(
                    &nodes.places.iter().map(|x| wave(&x.yzx()) * 1e-3).collect::<Vec<_>>(),
                ));
            let at = |t: f64| {
                let u: Vec<_> = start.iter().zip(&direction).map(|(u, du)| u + du * t).collect();
                let (mut strain, mut forces) = (Strain::default(), vec![Vector3::zeros(); u.len()]);
                let energy = solid.evaluate(&u, &mut strain, &mut forces).unwrap();
                (energy, forces, strain)
            };
            let step = 1e-5;
            let ((low, low_forces, _), (_, forces, strain), (high, high_forces, _)) =
                (at(-step), at(0.0), at(step));
            let slope: f64 = forces.iter().zip(&direction).map(|(f, du)| f.dot(du)).sum();
            let difference = (high - low) / (2.0 * step);
            // The step changes strains by 1e-5: truncation 1e-10, rounding 1e-16/1e-5, some decades
            // of margin.
            let error = (difference / slope - 1.0).abs();
            assert!(error < 1e-7, "{law} {element}: {difference} J against {slope} J");
            let change: Vec<_> = high_forces.iter().zip(&low_forces).map(|(h, l)| h - l).collect();
            let mut unknowns = pattern.gather(&change);
            let mut matrix = pattern.matrix();
            solid.assemble(&strain, &solid.assembly_map(&pattern), &mut matrix, false);
            assert!(matrix.factorise(&pattern), "{law} {element}: not positive definite");
            matrix.solve(&pattern, &mut unknowns);
            let solved = pattern.scatter(&unknowns);
            let size: f64 = direction.iter().map(Vector3::norm_squared).sum();
            let rest =
                solved.iter().zip(&direction).map(|(s, w)| (s / (2.0 * step) - w).norm_squared());
            let error = (rest.sum::<f64>() / size).sqrt();
            // As above, times the condition number of a block of 18 free nodes, about 1e2.
            assert!(error < 1e-5, "{law} {element}: relative error {error:.1e}");
        }
    }
}
