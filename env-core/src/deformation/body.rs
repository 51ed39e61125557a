//! Soft body: a meshed elastic solid, part of it bonded to a rigid base.

use std::{fmt, str::FromStr, sync::Arc};

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::{
    Error, Result,
    geometry::TetMesh,
    sensor::{Calibration, LARGEST_POISSON},
};

/// Stress–strain law of an isotropic solid, given by its energy density ψ; J is the determinant of
/// the deformation gradient F and I₁ the trace of `FᵀF`.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Law {
    /// ψ = μ/2 (I₁ − 3) − μ ln J + λ/2 (ln J)² (Bonet and Wood 2008, eq. 6.28).
    #[default]
    NeoHookean,
    /// ψ = μ/2 (I₁ − 3) − μ (J − 1) + (λ + μ)/2 (J − 1)² (Smith, de Goes and Kim 2018, eq. 13, in
    /// the Lamé parameters of small strain).
    StableNeoHookean,
    /// ψ = μ ‖F − R‖² + λ/2 (J − 1)², R the rotation nearest to F (Stomakhin et al. 2012).
    Corotated,
    /// ψ = μ ε:ε + λ/2 (tr ε)², ε = sym(F − 1): small strains and small rotations only.
    Linear,
}

impl Law {
    /// All laws with their names in files and in Python.
    pub const NAMES: [(&str, Self); 4] = [
        ("neo-hookean", Self::NeoHookean),
        ("stable-neo-hookean", Self::StableNeoHookean),
        ("corotated", Self::Corotated),
        ("linear", Self::Linear),
    ];
}

impl FromStr for Law {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let known = Self::NAMES.map(|(name, _)| name).join(", ");
        let law = Self::NAMES.iter().find(|(known, _)| *known == name);
        law.map(|&(_, law)| law).ok_or_else(|| Error::invalid("law", name, known))
    }
}

impl fmt::Display for Law {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Self::NAMES.iter().find(|(_, law)| law == self).map_or("", |(name, _)| *name);
        f.write_str(name)
    }
}

/// Elastic moduli of an isotropic solid at small strain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moduli {
    /// Young's modulus E (Pa).
    pub young: f64,
    /// Poisson's ratio ν, from 0 to just under 0.5.
    pub poisson: f64,
}

impl From<&Calibration> for Moduli {
    fn from(&Calibration { young, poisson, .. }: &Calibration) -> Self {
        Self { young, poisson }
    }
}

impl Moduli {
    /// Shear modulus μ = E / 2(1 + ν) (Pa).
    pub fn shear(&self) -> f64 {
        self.young / (2.0 * (1.0 + self.poisson))
    }

    /// First Lamé parameter λ = E ν / (1 + ν)(1 − 2ν) (Pa).
    pub fn lambda(&self) -> f64 {
        let nu = self.poisson;
        self.young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    }

    /// Returns an error unless a solid can have these moduli.
    pub(crate) fn check(&self) -> Result<()> {
        if !(self.young.is_finite() && self.young > 0.0) {
            return Err(Error::invalid("young", self.young, "a finite modulus above 0 Pa"));
        }
        if !(0.0..=LARGEST_POISSON).contains(&self.poisson) {
            let expected = format!("a ratio from 0 to {LARGEST_POISSON}");
            return Err(Error::invalid("poisson", self.poisson, expected));
        }
        Ok(())
    }
}

/// Meshed elastic solid in its own frame, with the nodes of its base held fixed.
#[derive(Clone, Debug)]
pub struct SoftBody {
    mesh: Arc<TetMesh>,
    law: Law,
    moduli: Vec<Moduli>,
    fixed: Vec<u32>,
}

impl SoftBody {
    /// Returns a solid of one material. `fixed` lists nodes that never move; without any the body
    /// is free.
    pub fn new(mesh: TetMesh, law: Law, moduli: Moduli, fixed: &[u32]) -> Result<Self> {
        let count = mesh.tets.len();
        Self::graded(mesh, law, vec![moduli; count], fixed)
    }

    /// Returns a solid with its own `moduli` in every tetrahedron (T).
    pub fn graded(mesh: TetMesh, law: Law, moduli: Vec<Moduli>, fixed: &[u32]) -> Result<Self> {
        check_mesh(&mesh)?;
        if moduli.len() != mesh.tets.len() {
            let expected = format!("one for each of {} tetrahedra", mesh.tets.len());
            return Err(Error::invalid("moduli", moduli.len(), expected));
        }
        moduli.iter().try_for_each(Moduli::check)?;
        let mut fixed = fixed.to_vec();
        fixed.sort_unstable();
        fixed.dedup();
        if let Some(&node) = fixed.last().filter(|&&node| node as usize >= mesh.vertices.len()) {
            let expected = format!("nodes below {}", mesh.vertices.len());
            return Err(Error::invalid("fixed", node, expected));
        }
        Ok(Self { mesh: Arc::new(mesh), law, moduli, fixed })
    }

    /// The undeformed mesh.
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    /// Stress–strain law.
    pub fn law(&self) -> Law {
        self.law
    }

    /// Moduli (T).
    pub fn moduli(&self) -> &[Moduli] {
        &self.moduli
    }

    /// Nodes that never move, ascending.
    pub fn fixed(&self) -> &[u32] {
        &self.fixed
    }

    /// Young's modulus of the stiffest tetrahedron (Pa).
    pub fn stiffest(&self) -> f64 {
        self.moduli.iter().map(|m| m.young).fold(0.0, f64::max)
    }
}

fn check_mesh(mesh: &TetMesh) -> Result<()> {
    let bad = |reason: String| Err(Error::BadMesh { name: "soft body".to_owned(), reason });
    let count = mesh.vertices.len();
    if mesh.tets.is_empty() {
        return bad("no tetrahedra".to_owned());
    }
    if let Some(i) = mesh.vertices.iter().position(|v| !v.iter().all(|x| x.is_finite())) {
        return bad(format!("vertex {i} is not finite"));
    }
    for (i, tet) in mesh.tets.iter().enumerate() {
        if let Some(node) = tet.iter().find(|&&node| node as usize >= count) {
            return bad(format!("tetrahedron {i} uses vertex {node}, but there are {count}"));
        }
        let corners = tet.map(|node| mesh.vertices[node as usize]);
        let (volume, longest) = (volume(&corners), longest_edge(&corners));
        if volume <= FLATTEST * longest.powi(3) {
            return bad(format!(
                "tetrahedron {i} has volume {volume:.3e} m³ at a longest edge of {longest:.3e} m, \
                 expected more than {FLATTEST:.0e} of its cube"
            ));
        }
    }
    let parts = parts(mesh);
    if parts != 1 {
        return bad(format!("{parts} unconnected parts (unused vertices count), expected 1"));
    }
    Ok(())
}

/// Smallest volume of a tetrahedron over its longest edge cubed; a regular one has 0.118.
const FLATTEST: f64 = 1e-9;

fn volume([a, b, c, d]: &[Point3<f64>; 4]) -> f64 {
    (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
}

fn longest_edge(corners: &[Point3<f64>; 4]) -> f64 {
    let edges = corners.iter().flat_map(|a| corners.iter().map(move |b| Vector3::norm(&(b - a))));
    edges.fold(0.0, f64::max)
}

/// Number of connected parts of the mesh, counting unused vertices.
fn parts(mesh: &TetMesh) -> usize {
    let mut leader: Vec<usize> = (0..mesh.vertices.len()).collect();
    for tet in &mesh.tets {
        let first = root(&mut leader, tet[0] as usize);
        for &node in &tet[1..] {
            let other = root(&mut leader, node as usize);
            leader[other] = first;
        }
    }
    (0..leader.len()).filter(|&node| leader[node] == node).count()
}

fn root(leader: &mut [usize], mut node: usize) -> usize {
    while leader[node] != node {
        leader[node] = leader[leader[node]];
        node = leader[node];
    }
    node
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_sensors_know_the_laws() {
        assert_eq!(Law::NAMES.map(|(name, _)| name), crate::sensor::LAWS);
    }

    fn tetrahedron() -> TetMesh {
        let vertices = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        TetMesh { vertices: vertices.map(Point3::from).to_vec(), tets: vec![[0, 1, 2, 3]] }
    }

    fn gel() -> Moduli {
        Moduli { young: 2e5, poisson: 0.48 }
    }

    fn message(mesh: TetMesh, moduli: Moduli, fixed: &[u32]) -> String {
        SoftBody::new(mesh, Law::NeoHookean, moduli, fixed).unwrap_err().to_string()
    }

    #[test]
    fn laws_are_found_by_name() {
        for (name, law) in Law::NAMES {
            assert_eq!(name.parse(), Ok(law));
            assert_eq!(law.to_string(), name);
        }
        assert!("hookean".parse::<Law>().unwrap_err().to_string().contains("neo-hookean"));
    }

    #[test]
    fn moduli_that_no_solid_has_are_refused() {
        for (young, poisson) in [(0.0, 0.3), (-1.0, 0.3), (f64::NAN, 0.3), (1e5, 0.5), (1e5, -0.1)]
        {
            let moduli = Moduli { young, poisson };
            assert!(SoftBody::new(tetrahedron(), Law::Linear, moduli, &[]).is_err(), "{moduli:?}");
        }
    }

    #[test]
    fn unusable_meshes_are_named() {
        let mut inverted = tetrahedron();
        inverted.tets[0].swap(0, 1);
        assert!(message(inverted, gel(), &[]).contains("volume -1.667e-1"));
        let mut flat = tetrahedron();
        flat.vertices[3].z = 1e-10;
        assert!(message(flat, gel(), &[]).contains("expected more than 1e-9"));
        let mut loose = tetrahedron();
        loose.vertices.push(Point3::new(2.0, 2.0, 2.0));
        assert!(message(loose, gel(), &[]).contains("2 unconnected parts"));
        let mut infinite = tetrahedron();
        infinite.vertices[1].x = f64::INFINITY;
        assert!(message(infinite, gel(), &[]).contains("vertex 1 is not finite"));
        let mut missing = tetrahedron();
        missing.tets[0][2] = 9;
        assert!(message(missing, gel(), &[]).contains("uses vertex 9"));
        assert!(message(tetrahedron(), gel(), &[4]).contains("nodes below 4"));
    }
}
