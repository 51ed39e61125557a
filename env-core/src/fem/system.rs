//! Forces and stiffness of a body together with its contact, at one state.

use std::{
    collections::BTreeSet,
    sync::{Arc, OnceLock},
};

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::{
    element::{Element, Nodes},
    pattern::Pattern,
    solid::{AssemblyMap, Solid, Strain, solid},
    spacing::{Faces, USUAL},
    surface::surface,
};
use crate::{
    Result,
    contact::{Backing, ContactLaw, ContactStep, SurfacePoint, Touch},
    deformation::{ModelIdentity, Press, SoftBody},
    geometry::Shape,
};

/// A body, discretised and analysed once; shared by all presses. Copies differ in their friction
/// and their contact points.
#[derive(Clone)]
pub(super) struct System {
    pub(super) nodes: Arc<Nodes>,
    pub(super) solid: Arc<dyn Solid>,
    /// The pattern with contact anywhere, computed on first use.
    whole: Arc<OnceLock<(Arc<Pattern>, Arc<AssemblyMap>)>>,
    pub(super) element: Element,
    pub(super) identity: ModelIdentity,
    pub(super) surface: Arc<[SurfacePoint]>,
    /// The held faces, which no shape may enter.
    pub(super) backing: Arc<Backing>,
    faces: Arc<Faces>,
    pub(super) law: ContactLaw,
    /// `true` if the body can move as a whole.
    pub(super) floating: bool,
    /// Least extent of the body along an axis (m).
    thinnest: f64,
}

/// Depth of a touching point above which a solution is refused, in softnesses: the contact pressure
/// there is as many times Young's modulus.
const DEEPEST: f64 = 250.0;

/// Displacement of the body and poses of the shapes.
#[derive(Clone, Debug)]
pub(super) struct Configuration {
    /// Displacement of the nodes (N) in m.
    pub(super) displacement: Vec<Vector3<f64>>,
    /// Poses of the shapes (S).
    pub(super) poses: Vec<Isometry3<f64>>,
}

/// Method by which the stiffness matrix is made positive definite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Stiffness {
    /// Unchanged.
    Exact,
    /// Diagonal raised by this share of its mean.
    Shifted(f64),
    /// Filtered element by element.
    Filtered,
}

impl Stiffness {
    /// All methods, from the most accurate to the safest. Raising the diagonal little by little
    /// keeps more of the curvature than the filter, which converges slowly where a body is close to
    /// buckling.
    pub(super) const SAFER: [Self; 5] = [
        Self::Exact,
        Self::Shifted(1e-3),
        Self::Shifted(1e-2),
        Self::Shifted(1e-1),
        Self::Filtered,
    ];
}

/// Energy and forces at one state.
pub(super) struct Forces {
    /// Elastic energy (J).
    pub(super) elastic: f64,
    /// Gradient of the elastic energy less contact forces, by node (N); in equilibrium zero at free
    /// nodes.
    pub(super) gradient: Vec<Vector3<f64>>,
    /// Elastic strain, for the stiffness.
    pub(super) strain: Strain,
    pub(super) touches: Vec<Touch>,
}

impl System {
    pub(super) fn new(body: &SoftBody, element: Element, law: ContactLaw) -> Self {
        let nodes = Nodes::new(body, element);
        let solid = solid(body, &nodes, element).into();
        let faces = Faces::new(body, USUAL);
        let (surface, backing) = surface(body, &nodes, element, faces.usual);
        let (surface, backing) = (surface.into(), backing.into());
        let identity = ModelIdentity::new(element.into(), body, &nodes.places);
        let floating = body.fixed().len() < 3;
        let [low, high] = [Vector3::inf, Vector3::sup].map(|edge: fn(&Vector3<f64>, &_) -> _| {
            let places = body.mesh().vertices.iter().map(|place| place.coords);
            places.reduce(|a, b| edge(&a, &b)).unwrap_or_default()
        });
        let thinnest = (high - low).min();
        let (nodes, faces, whole) = (Arc::new(nodes), Arc::new(faces), Arc::default());
        Self {
            nodes,
            solid,
            whole,
            element,
            identity,
            surface,
            backing,
            faces,
            law,
            floating,
            thinnest,
        }
    }

    /// Returns the system of the same `body` for `press`: with its friction, and with contact
    /// points as close as its thinnest shape requires. Returns an error if that shape is too thin.
    pub(super) fn suited(&self, body: &SoftBody, press: &Press) -> Result<Self> {
        let mut system = self.clone();
        system.law.friction = press.friction().unwrap_or(self.law.friction);
        let spacing = self.faces.for_press(body.mesh(), press)?;
        if spacing != self.faces.usual {
            let (surface, backing) = surface(body, &self.nodes, self.element, spacing);
            (system.surface, system.backing) = (surface.into(), backing.into());
        }
        Ok(system)
    }

    /// Returns an error unless `shape` is detected by the contact points as they are.
    pub(super) fn check_felt(&self, shape: &Shape) -> Result<()> {
        self.faces.check_felt(shape)
    }

    /// Positions of the surface points (C).
    pub(super) fn surface_places(&self, displacement: &[Vector3<f64>]) -> Vec<Point3<f64>> {
        let place = |point: &SurfacePoint| point.place(&self.nodes.places, displacement);
        self.surface.iter().map(place).collect()
    }

    /// Energy and forces, or `None` if an element is inverted or a point came out on the far side
    /// of a shape.
    pub(super) fn forces(&self, state: &Configuration, step: &mut ContactStep) -> Option<Forces> {
        let mut gradient = vec![Vector3::zeros(); self.nodes.places.len()];
        let mut strain = Strain::default();
        let elastic = self.solid.evaluate(&state.displacement, &mut strain, &mut gradient)?;
        let touches = step.touches_displaced(&state.poses, &self.nodes.places, &state.displacement);
        if touches
            .iter()
            .any(|touch| touch.depth > self.law.deep() && step.passed_through(touch, &state.poses))
        {
            return None;
        }
        for touch in &touches {
            let point = &self.surface[touch.point as usize];
            point.spread(&-self.contact_force(touch), &mut gradient);
        }
        Some(Forces { elastic, gradient, strain, touches })
    }

    /// Depth of a touching point above which a solution is refused (m), at most half of the body's
    /// smallest extent: from there a shape might go on to the other side.
    pub(super) fn refused(&self) -> f64 {
        (DEEPEST * self.law.softness).min(0.5 * self.thinnest)
    }

    /// Force of a shape on the body at a touching point (N).
    pub(super) fn contact_force(&self, touch: &Touch) -> Vector3<f64> {
        self.law.force(&self.surface[touch.point as usize], touch)
    }

    /// Energy of contact with friction limited to the `limit` of each touch (J).
    pub(super) fn contact_energy(&self, touches: &[Touch], limit: impl Fn(&Touch) -> f64) -> f64 {
        let energy = |touch: &Touch| {
            let point = &self.surface[touch.point as usize];
            self.law.energy(point, touch, limit(touch)) * point.area
        };
        touches.iter().map(energy).sum()
    }

    /// Stiffness of a touch (N/m).
    pub(super) fn contact_stiffness(&self, touch: &Touch) -> Matrix3<f64> {
        let point = &self.surface[touch.point as usize];
        self.law.hessian(point, touch, self.law.limit(point, touch)) * point.area
    }

    /// The pattern of the body with contact anywhere on its surface.
    pub(super) fn whole_pattern(&self) -> (Arc<Pattern>, Arc<AssemblyMap>) {
        let whole = || {
            let stencils = stencils(&self.surface);
            let mut couplings = self.solid.couplings();
            couplings.extend(stencils.iter().map(|stencil| &stencil[..]));
            let pattern = Pattern::new(&self.nodes.places, &self.nodes.fixed, &couplings);
            let map = self.solid.assembly_map(&pattern);
            (Arc::new(pattern), Arc::new(map))
        };
        self.whole.get_or_init(whole).clone()
    }

    /// The pattern of the body with contact on its free `nodes` alone; they are eliminated last.
    pub(super) fn pattern_around(&self, nodes: &[u32]) -> (Arc<Pattern>, Arc<AssemblyMap>) {
        let (places, fixed) = (&self.nodes.places, &self.nodes.fixed);
        let pattern = Pattern::ending_in(nodes, places, fixed, &self.solid.couplings());
        let map = self.solid.assembly_map(&pattern);
        (Arc::new(pattern), Arc::new(map))
    }
}

/// Sets of nodes that surface points are interpolated from.
fn stencils(surface: &[SurfacePoint]) -> BTreeSet<Vec<u32>> {
    let nodes = |point: &SurfacePoint| point.shares.iter().map(|&(node, _)| node).collect();
    surface.iter().map(nodes).collect()
}
