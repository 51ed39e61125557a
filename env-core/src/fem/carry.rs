//! Transfer of solutions to another mesh of the body, with the interpolation of the element.
//!
//! The displacement of a quadratic element is curved between its nodes, and its stress varies
//! within it. Transferred as linear and constant, both are wrong by several per cent on meshes of
//! some thousand nodes.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::{
    Fem,
    element::{Element, barycentric, quadratic_gradients, quadratic_nodes, quadratic_shares},
    material::Material,
    solid::Solid,
};
use crate::{
    Error, Result,
    geometry::{Site, TetMesh, Transfer, samples},
};

/// An operator that maps the states of a model (N nodes) to fields on another mesh of its body (V′,
/// T′).
pub struct Carrier {
    transfer: Transfer,
    reading: Interpolation,
}

/// Fields on the target mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Carried {
    /// Displacement of the vertices (V′) in m.
    pub displacement: Vec<Vector3<f64>>,
    /// Von Mises stress, volume average over the tetrahedra (T′) in Pa.
    pub von_mises: Vec<f64>,
}

/// Interpolation of a state between the nodes.
enum Interpolation {
    Linear(Arc<dyn Solid>),
    Quadratic(Quadratic),
}

/// Quadratic elements of the source (T) and the points at which they are evaluated.
struct Quadratic {
    nodes: Vec<[u32; 10]>,
    /// Gradients of the barycentric coordinates (1/m).
    gradients: Vec<[Vector3<f64>; 4]>,
    materials: Vec<Material>,
    /// Sample points in each tetrahedron of the target (T′).
    samples: Vec<Vec<Site>>,
}

impl Carrier {
    /// Returns the operator from `fem` `to` a mesh, or an error if that is not one of the same
    /// body.
    pub fn new(fem: &Fem, to: &TetMesh) -> Result<Self> {
        let transfer = Transfer::new(fem.body().mesh(), to)?;
        let reading = match fem.system.element {
            Element::P2 => Interpolation::Quadratic(Quadratic::new(fem, to)?),
            Element::P1 | Element::P1Bar => Interpolation::Linear(fem.system.solid.clone()),
        };
        Ok(Self { transfer, reading })
    }

    /// Returns the fields of a state of the model that this was made for, given by its nodes'
    /// displacements (N).
    pub fn fields(&self, nodal: &[Vector3<f64>]) -> Carried {
        let (displacement, von_mises) = match &self.reading {
            Interpolation::Linear(solid) => {
                (self.transfer.interpolate(nodal), self.transfer.average(&solid.von_mises(nodal)))
            }
            Interpolation::Quadratic(elements) => {
                let place = |site| elements.displacement(nodal, site);
                let mean = |sites: &Vec<Site>| elements.mean(nodal, sites);
                let displacement = self.transfer.sites().iter().map(place).collect();
                (displacement, elements.samples.iter().map(mean).collect())
            }
        };
        Carried { displacement, von_mises }
    }

    /// Returns the fields of a solution `nonlinear` (N) by this operator's model plus the
    /// difference `better` − `linear` of two solutions by the linear law: `linear` (N) on the same
    /// mesh, and `better` by the model of `finer`, an operator to the same mesh. The deformation
    /// gradient is that of the nonlinear solution times the exponential of the difference of the
    /// linear gradients, which inverts no element. Returns an error if the elements are not
    /// quadratic.
    pub(crate) fn corrected(
        &self,
        [nonlinear, linear]: [&[Vector3<f64>]; 2],
        (finer, better): (&Self, &[Vector3<f64>]),
    ) -> Result<Carried> {
        let (Interpolation::Quadratic(own), Interpolation::Quadratic(fine)) =
            (&self.reading, &finer.reading)
        else {
            return Err(Error::invalid("element", "linear elements", "p2"));
        };
        let place = |(at, at_finer): (&Site, &Site)| {
            own.displacement(nonlinear, at) - own.displacement(linear, at)
                + fine.displacement(better, at_finer)
        };
        let stress = |(at, at_finer): (&Site, &Site)| {
            let f = own.deformation_gradient(nonlinear, at);
            let difference =
                fine.deformation_gradient(better, at_finer) - own.deformation_gradient(linear, at);
            own.materials[at.0 as usize].von_mises(&(f * difference.exp()))
        };
        let mean = |(at, at_finer): (&Vec<Site>, &Vec<Site>)| {
            at.iter().zip(at_finer).map(stress).sum::<f64>() / at.len() as f64
        };
        let sites = self.transfer.sites().iter().zip(finer.transfer.sites());
        Ok(Carried {
            displacement: sites.map(place).collect(),
            von_mises: own.samples.iter().zip(&fine.samples).map(mean).collect(),
        })
    }

    /// Converts forces on the vertices (V) to forces on the target's (V′) of equal sum and torque
    /// (N).
    pub fn spread(&self, forces: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        self.transfer.spread(forces)
    }
}

impl Quadratic {
    fn new(fem: &Fem, to: &TetMesh) -> Result<Self> {
        let (body, mesh) = (fem.body(), fem.body().mesh());
        Ok(Self {
            nodes: quadratic_nodes(mesh, &fem.system.nodes),
            gradients: (0..mesh.tets.len()).map(|t| barycentric(mesh.corners(t)).0).collect(),
            materials: body.moduli().iter().map(|m| Material::new(body.law(), m)).collect(),
            samples: samples(mesh, to)?,
        })
    }

    fn displacement(&self, nodal: &[Vector3<f64>], (tet, l): &Site) -> Vector3<f64> {
        let nodes = self.nodes[*tet as usize].iter();
        nodes.zip(quadratic_shares(l)).map(|(&node, share)| nodal[node as usize] * share).sum()
    }

    fn deformation_gradient(&self, nodal: &[Vector3<f64>], (tet, l): &Site) -> Matrix3<f64> {
        let tet = *tet as usize;
        let mut f = Matrix3::identity();
        let gradients = quadratic_gradients(l, &self.gradients[tet]);
        for (&node, gradient) in self.nodes[tet].iter().zip(gradients) {
            f += nodal[node as usize] * gradient.transpose();
        }
        f
    }

    /// Von Mises stress (Pa).
    fn von_mises(&self, nodal: &[Vector3<f64>], site: &Site) -> f64 {
        self.materials[site.0 as usize].von_mises(&self.deformation_gradient(nodal, site))
    }

    fn mean(&self, nodal: &[Vector3<f64>], sites: &[Site]) -> f64 {
        sites.iter().map(|site| self.von_mises(nodal, site)).sum::<f64>() / sites.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::{
        deformation::{Law, Moduli, SoftBody},
        fem::{FemOptions, examples::grid},
    };

    /// A cube of 3 mm in cells of 1 mm, and one in cells of 1.5 mm.
    fn setup(element: Element) -> (Fem, TetMesh) {
        let [fine, coarse] = [3, 2].map(|n| grid([n; 3], |p| p * (0.003 / f64::from(n))));
        let moduli = Moduli { young: 1e5, poisson: 0.45 };
        let body = SoftBody::new(fine, Law::NeoHookean, moduli, &[0, 1, 4, 16]).unwrap();
        (Fem::new(body, FemOptions { element, ..FemOptions::default() }).unwrap(), coarse)
    }

    type ExactField = fn(&Point3<f64>) -> Vector3<f64>;

    fn linear(p: &Point3<f64>) -> Vector3<f64> {
        Vector3::new(0.1 * p.y, 0.2 * p.z, -0.1 * p.x)
    }

    fn quadratic(p: &Point3<f64>) -> Vector3<f64> {
        linear(p) + 30.0 * Vector3::new(p.x * p.y, p.z * p.z, p.x * p.z)
    }

    #[test]
    fn what_an_element_can_be_arrives_exactly() {
        let cases: [(Element, ExactField); 3] =
            [(Element::P1Bar, linear), (Element::P2, linear), (Element::P2, quadratic)];
        for (element, field) in cases {
            let (fem, target) = setup(element);
            let nodal: Vec<_> = fem.system.nodes.places.iter().map(field).collect();
            let carried = Carrier::new(&fem, &target).unwrap().fields(&nodal);
            let exact = target.vertices.iter().map(field);
            let mut pairs = carried.displacement.iter().zip(exact);
            // Rounding of displacements of a millimetre.
            assert!(pairs.all(|(a, b)| (a - b).norm() < 1e-16), "{element}");
        }
    }

    #[test]
    fn a_correction_is_the_difference_of_linear_solutions_on_two_meshes() {
        let (fem, target) = setup(Element::P2);
        let mesh = grid([2; 3], |p| p * 0.0015);
        let moduli = Moduli { young: 1e5, poisson: 0.45 };
        let body = SoftBody::new(mesh, Law::NeoHookean, moduli, &[0, 1, 3, 9]).unwrap();
        let options = FemOptions { element: Element::P2, ..FemOptions::default() };
        let other = Fem::new(body, options).unwrap();
        let [own, finer] = [&fem, &other].map(|fem| Carrier::new(fem, &target).unwrap());
        let nodal = |fem: &Fem, field: ExactField, part: f64| -> Vec<_> {
            fem.system.nodes.places.iter().map(|p| field(p) * part).collect()
        };
        // From rest, small; and where both linear solutions are one, the nonlinear is left as it
        // is.
        for (part, scales) in [(1e-4, [0.0, 1.0, 3.0, 2.0]), (1.0, [1.0, 1.0, 1.0, 1.0])] {
            let [nonlinear, linear, better, sum] = scales.map(|scale| scale * part);
            let states = [nonlinear, linear].map(|scale| nodal(&fem, quadratic, scale));
            let better = nodal(&other, quadratic, better);
            let found = own.corrected([&states[0], &states[1]], (&finer, &better)).unwrap();
            let exact = own.fields(&nodal(&fem, quadratic, sum));
            let mut pairs = found.displacement.iter().zip(&exact.displacement);
            // Rounding of displacements of a millimetre.
            assert!(pairs.all(|(a, b)| (a - b).norm() < 1e-16));
            for (found, exact) in found.von_mises.iter().zip(&exact.von_mises) {
                // Strains of some 1e-5 leave out their squares.
                assert!((found / exact - 1.0).abs() < 1e-3, "{found} Pa against {exact} Pa");
            }
        }
    }

    #[test]
    fn stress_within_a_quadratic_element_is_averaged_where_it_varies() {
        // Shear γ = 2 k z beside stretches of first order in γ²: σ = √3 μ γ.
        let k = 0.1;
        let (fem, target) = setup(Element::P2);
        let bent = |p: &Point3<f64>| Vector3::x() * (k * p.z * p.z);
        let nodal: Vec<_> = fem.system.nodes.places.iter().map(bent).collect();
        let carried = Carrier::new(&fem, &target).unwrap().fields(&nodal);
        let mu = Moduli { young: 1e5, poisson: 0.45 }.shear();
        for (t, stress) in carried.von_mises.iter().enumerate() {
            let middle = target.corners(t).iter().map(|p| p.z).sum::<f64>() / 4.0;
            let exact = 3f64.sqrt() * mu * 2.0 * k * middle;
            // γ² = 4e-7 is left out, and 35 points represent the tetrahedron.
            assert!((stress / exact - 1.0).abs() < 1e-5, "{stress} Pa against {exact} Pa");
        }
    }
}
