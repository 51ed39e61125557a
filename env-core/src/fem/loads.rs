//! Nodal forces that do the same work as given forces on points of a body.

use nalgebra::{Point3, Vector3};

use super::{
    Fem,
    element::{Element, quadratic_nodes, quadratic_shares},
    linearised::Linearised,
};
use crate::{Result, geometry::sites};

impl Fem {
    /// Linear elasticity of the body at rest, in the elements of the model; returns an error if its
    /// fixed nodes leave it free to move as a whole.
    pub(crate) fn linearised(&self) -> Result<Linearised> {
        Linearised::of(&self.body, self.system.element)
    }

    /// Nodal forces (N entries) in N that do the same work as `forces` (N) at points of the body at
    /// rest (m) or close to it, or an error if a point lies far off it.
    pub(crate) fn loads(
        &self,
        forces: &[(Point3<f64>, Vector3<f64>)],
    ) -> Result<Vec<Vector3<f64>>> {
        let (mesh, nodes) = (self.body.mesh(), &self.system.nodes);
        let points: Vec<_> = forces.iter().map(|(point, _)| *point).collect();
        let mut loads = vec![Vector3::zeros(); nodes.places.len()];
        let quadratic = (self.system.element == Element::P2).then(|| quadratic_nodes(mesh, nodes));
        for ((tet, l), (_, force)) in sites(mesh, &points)?.iter().zip(forces) {
            let tet = *tet as usize;
            // One beside a curved face is taken to the nearest facet.
            let inside = l.map(|share| share.max(0.0));
            let l = &inside.map(|share| share / inside.iter().sum::<f64>());
            let mut add = |(&node, share): (&u32, f64)| loads[node as usize] += force * share;
            match &quadratic {
                Some(nodes) => nodes[tet].iter().zip(quadratic_shares(l)).for_each(&mut add),
                None => mesh.tets[tet].iter().zip(*l).for_each(&mut add),
            }
        }
        Ok(loads)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        deformation::{Law, Moduli, SoftBody},
        fem::{FemOptions, examples::grid},
    };

    type DisplacementField = fn(&Point3<f64>) -> Vector3<f64>;

    #[test]
    fn loads_do_the_work_of_the_forces_they_stand_for() {
        let slope: DisplacementField = |p| Vector3::new(0.1 * p.y, 0.2 * p.z, -0.1 * p.x);
        let curve: DisplacementField =
            |p| Vector3::new(0.1 * p.y, 30.0 * p.x * p.z, 20.0 * p.z * p.z);
        let cases = [(Element::P1Bar, slope), (Element::P2, curve)];
        let forces = [
            (Point3::new(3.1e-4, 1.7e-3, 3e-3), Vector3::new(0.1, -0.2, -1.0)),
            (Point3::new(2.2e-3, 9e-4, 3e-3), Vector3::new(0.0, 0.4, -0.3)),
        ];
        for (element, field) in cases {
            let mesh = grid([3; 3], |p| p * 1e-3);
            let moduli = Moduli { young: 1e5, poisson: 0.45 };
            let body = SoftBody::new(mesh, Law::NeoHookean, moduli, &[0, 1, 4, 16]).unwrap();
            let options = FemOptions { element, ..FemOptions::default() };
            let fem = Fem::new(body, options).unwrap();
            let loads = fem.loads(&forces).unwrap();
            let nodal = fem.system.nodes.places.iter().map(field).zip(&loads);
            let work: f64 = nodal.map(|(u, load)| u.dot(load)).sum();
            let exact: f64 = forces.iter().map(|(p, force)| field(p).dot(force)).sum();
            // Rounding: the fields are those that the elements represent.
            assert!((work / exact - 1.0).abs() < 1e-12, "{element}: {work} J against {exact} J");
        }
    }

    #[test]
    fn a_point_far_off_the_body_is_an_error() {
        let moduli = Moduli { young: 1e5, poisson: 0.45 };
        let mesh = grid([3; 3], |p| p * 1e-3);
        let body = SoftBody::new(mesh, Law::NeoHookean, moduli, &[0, 1, 4, 16]).unwrap();
        let fem = Fem::new(body, FemOptions::default()).unwrap();
        assert!(fem.loads(&[(Point3::new(0.0, 0.0, 9e-3), Vector3::z())]).is_err());
    }
}
