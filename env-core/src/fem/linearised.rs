//! A body linearised at rest.
//!
//! At rest the stiffness is the same for all laws; unless another element is asked for, it is that
//! of `p1-bar`. Fixed nodes do not move. The stiffness of a free body has no inverse: each of its
//! nodes is tied to its position at rest by a spring so weak that contact alone determines where
//! the body lies.

use faer::dyn_stack::MemBuffer;
use nalgebra::{Point3, Vector3};

use super::{
    element::{Element, Nodes},
    pattern::{FIXED, Pattern},
    solid::{Solid, Strain, solid},
    spacing::{Faces, USUAL},
    sparse::{Factor, MOST_COLUMNS},
    surface::surface,
};
use crate::{
    Error, Result,
    contact::{Backing, SurfacePoint},
    deformation::{Press, SoftBody},
};

/// Total stiffness of the springs that tie a free body, over Young's modulus E times the cube root
/// L of its volume: moved by a hundredth of its size, it is held by 1e-6 of E L².
const TIE: f64 = 1e-4;

/// Spacing of the contact points of a free body (m). Compared with the [`USUAL`] spacing, the
/// forces on a ball of 40 mm between plates differ by 0.1 %, and the time by a half.
const FREE: f64 = 1e-3;

/// A body with the factor of its stiffness at rest.
pub(crate) struct Linearised {
    nodes: Nodes,
    solid: Box<dyn Solid>,
    pattern: Pattern,
    factor: Factor,
    faces: Faces,
    element: Element,
    /// Stiffness of the spring at each node of a free body (N/m), else 0.
    tie: f64,
}

/// Working memory of one thread.
pub(crate) struct SolverWorkspace {
    buffer: MemBuffer,
    strain: Strain,
}

impl Linearised {
    /// Linearises `body` in elements of the usual kind; returns an error if its fixed nodes leave
    /// it free to move as a whole.
    pub(crate) fn new(body: &SoftBody) -> Result<Self> {
        Self::of(body, Element::P1Bar)
    }

    /// Returns [`Linearised::new`] in elements of the kind `element`.
    pub(crate) fn of(body: &SoftBody, element: Element) -> Result<Self> {
        if held(body)
            && let Some(linearised) = Self::tied(body, element, 0.0)
        {
            return Ok(linearised);
        }
        let found = format!("{} nodes", body.fixed().len());
        let expected = "three or more that are not on a line, so that the body is held";
        Err(Error::invalid("fixed", found, expected))
    }

    /// Linearises a `body` without fixed nodes, tied by weak springs; returns an error if it has
    /// some.
    pub(crate) fn free(body: &SoftBody) -> Result<Self> {
        let mesh = body.mesh();
        let volume = mesh.volume();
        let tie = TIE * body.stiffest() * volume.cbrt() / mesh.vertices.len() as f64;
        let free = body.fixed().is_empty().then(|| Self::tied(body, Element::P1Bar, tie)).flatten();
        free.ok_or_else(|| {
            Error::invalid("fixed", format!("{} nodes", body.fixed().len()), "none: a free body")
        })
    }

    /// Linearises `body` with a spring of `tie` (N/m) at each node; `None` if its stiffness is then
    /// not positive definite.
    fn tied(body: &SoftBody, element: Element, tie: f64) -> Option<Self> {
        let nodes = Nodes::new(body, element);
        let solid = solid(body, &nodes, element);
        let pattern = Pattern::new(&nodes.places, &nodes.fixed, &solid.couplings());
        let rest = vec![Vector3::zeros(); nodes.places.len()];
        let (mut strain, mut forces) = (Strain::default(), rest.clone());
        let mut matrix = pattern.matrix();
        solid.evaluate(&rest, &mut strain, &mut forces).expect("no element is inverted at rest");
        solid.assemble(&strain, &solid.assembly_map(&pattern), &mut matrix, false);
        matrix.shift(&pattern, tie);
        if !matrix.factorise(&pattern) {
            return None;
        }
        let spacing = if tie > 0.0 { FREE } else { USUAL };
        let (factor, faces) = (matrix.into_factor(), Faces::new(body, spacing));
        Some(Self { nodes, solid, pattern, factor, faces, element, tie })
    }

    pub(crate) fn workspace(&self) -> SolverWorkspace {
        SolverWorkspace { buffer: self.pattern.workspace(), strain: Strain::default() }
    }

    /// Positions of the nodes at rest (V).
    pub(crate) fn places(&self) -> &[Point3<f64>] {
        &self.nodes.places
    }

    /// Contact points (C) of `body`, which must be the body that was linearised, and its backing.
    pub(crate) fn surface(&self, body: &SoftBody) -> (Vec<SurfacePoint>, Backing) {
        surface(body, &self.nodes, self.element, self.faces.usual)
    }

    /// Returns [`Linearised::surface`] with points as close as the thinnest shape of `press`
    /// requires, `None` if the usual spacing suffices, or an error if the shape is too thin.
    pub(crate) fn closer_surface(
        &self,
        body: &SoftBody,
        press: &Press,
    ) -> Result<Option<(Vec<SurfacePoint>, Backing)>> {
        let spacing = self.faces.for_press(body.mesh(), press)?;
        let closer = || surface(body, &self.nodes, self.element, spacing);
        Ok((spacing != self.faces.usual).then(closer))
    }

    pub(crate) fn is_free(&self, node: u32) -> bool {
        self.pattern.place[node as usize] != FIXED
    }

    /// Displacement (V) in m under `forces` (V) in N.
    pub(crate) fn displacement(
        &self,
        forces: &[Vector3<f64>],
        workspace: &mut SolverWorkspace,
    ) -> Vec<Vector3<f64>> {
        let mut unknowns = self.pattern.gather(forces);
        self.factor.solve(&self.pattern, &mut workspace.buffer, &mut unknowns);
        self.pattern.scatter(&unknowns)
    }

    /// The node in the middle of the edge between two vertices, or the vertex if they are one.
    pub(crate) fn node_between(&self, a: u32, b: u32) -> u32 {
        if a == b { a } else { self.nodes.middle(a, b) }
    }

    /// Displacement of `nodes` under unit forces on the free nodes `at`, one row of numbers for
    /// each component of each force (m/N).
    pub(crate) fn unit_responses(
        &self,
        at: &[u32],
        nodes: &[u32],
        workspace: &mut SolverWorkspace,
    ) -> Vec<f64> {
        let size = self.pattern.size();
        let place = |node: u32| 3 * self.pattern.place[node as usize] as usize;
        let loads: Vec<usize> = at
            .iter()
            .flat_map(|&node| (0..3).map(move |i| (node, i)))
            .map(|(node, i)| place(node) + i)
            .collect();
        let mut rows = Vec::with_capacity(9 * at.len() * nodes.len());
        for loads in loads.chunks(MOST_COLUMNS) {
            let mut columns = vec![0.0; size * loads.len()];
            for (column, &load) in columns.chunks_mut(size).zip(loads) {
                column[load] = 1.0;
            }
            self.factor.solve(&self.pattern, &mut workspace.buffer, &mut columns);
            for column in columns.chunks(size) {
                rows.extend(nodes.iter().flat_map(|&node| &column[place(node)..place(node) + 3]));
            }
        }
        rows
    }

    /// Norm of the residual force under a displacement of the nodes (m) and `contact` forces on
    /// them (N); `None` if an element is inverted.
    pub(crate) fn residual(
        &self,
        displacement: &[Vector3<f64>],
        contact: &[Vector3<f64>],
    ) -> Option<f64> {
        let mut left = self.elastic_force(displacement, &mut self.workspace())?;
        left.iter_mut().zip(contact).for_each(|(left, force)| *left -= force);
        self.release(&mut left);
        Some(left.iter().map(Vector3::norm_squared).sum::<f64>().sqrt())
    }

    /// Nodal forces (V) in N that balance `displacement` by the body's own law, or `None` if an
    /// element is inverted.
    pub(crate) fn elastic_force(
        &self,
        displacement: &[Vector3<f64>],
        workspace: &mut SolverWorkspace,
    ) -> Option<Vec<Vector3<f64>>> {
        let mut forces = vec![Vector3::zeros(); displacement.len()];
        self.solid.evaluate(displacement, &mut workspace.strain, &mut forces)?;
        forces.iter_mut().zip(displacement).for_each(|(force, u)| *force += self.tie * u);
        Some(forces)
    }

    /// Nodal forces (V) in N under which a free body is displaced by `displacement` (V). Its law is
    /// linear at rest, so they are those of a small part of the displacement, scaled up. `None` if
    /// the body is held.
    pub(crate) fn loads_of_free(
        &self,
        displacement: &[Vector3<f64>],
        workspace: &mut SolverWorkspace,
    ) -> Option<Vec<Vector3<f64>>> {
        /// Part of the displacement at which errors of linearity and of rounding are about equal.
        const PART: f64 = 1e-7;
        if self.tie == 0.0 {
            return None;
        }
        let part: Vec<_> = displacement.iter().map(|u| u * PART).collect();
        let forces = self.elastic_force(&part, workspace)?;
        Some(forces.iter().map(|force| force / PART).collect())
    }

    /// Sets `forces` (V) on fixed nodes to zero, since the base bears them.
    pub(crate) fn release(&self, forces: &mut [Vector3<f64>]) {
        let fixed = forces.iter_mut().zip(&self.nodes.fixed).filter(|(_, fixed)| **fixed);
        fixed.for_each(|(force, _)| *force = Vector3::zeros());
    }

    /// Von Mises stress by the body's own law (T) in Pa.
    pub(crate) fn von_mises(&self, displacement: &[Vector3<f64>]) -> Vec<f64> {
        self.solid.von_mises(displacement)
    }
}

/// Returns whether the fixed nodes span a plane.
fn held(body: &SoftBody) -> bool {
    let place = |&node: &u32| body.mesh().vertices[node as usize];
    let mut fixed = body.fixed().iter().map(place);
    let Some(first) = fixed.next() else { return false };
    let offsets: Vec<Vector3<f64>> = fixed.map(|place| place - first).collect();
    let Some(longest) = offsets.iter().max_by(|a, b| a.norm().total_cmp(&b.norm())) else {
        return false;
    };
    offsets.iter().any(|offset| offset.cross(longest).norm() > 1e-6 * longest.norm_squared())
}
