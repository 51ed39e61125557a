//! Soft object between two rigid fingers: its presses and its deformation.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Vector3};

use super::Shell;
use crate::{
    Result,
    deformation::{Deformation, History, Moduli, Press, SoftBody},
    geometry::{RigidFit, Shape, TetMesh},
    recent::Recent,
    surrogate::soft::SoftSurrogate,
};

/// Number of markers on the surface of a soft object.
pub const MARKERS: usize = 16;
/// Young's modulus of the built models (Pa). Displacements do not depend on it; stresses and forces
/// are proportional to it.
const YOUNG: f64 = 1e5;

/// Model of a soft object.
#[derive(Clone)]
pub struct SoftObject {
    surrogate: SoftSurrogate,
    /// Nodes that carry markers, far from each other on the surface.
    markers: Arc<[u32]>,
    shell: Arc<Shell>,
    /// Volumes of the tetrahedra at rest (T) in m³.
    volumes: Arc<[f64]>,
    /// Half-extents of a finger's box (m), whose +z side presses.
    finger: Vector3<f64>,
}

/// Deformation of a squeezed object.
#[derive(Clone, Debug, PartialEq)]
pub struct Squeezed {
    /// Displacement of each marker relative to the best-fitting rigid motion of the object, in the
    /// object's frame (m).
    pub markers: Vec<Vector3<f64>>,
    /// Root mean square of the same displacement over all nodes (m).
    pub deviation: f64,
    /// Largest von Mises stress of a tetrahedron (Pa).
    pub peak: f64,
    /// Volume mean of the von Mises stress (Pa).
    pub mean: f64,
    /// Normal force of the object on each finger (N).
    pub forces: [f64; 2],
}

/// Parameters that determine a model.
#[derive(Clone, PartialEq)]
struct ModelParameters {
    shape: Shape,
    finger: Vector3<f64>,
    poisson: f64,
}

static BUILT: Recent<ModelParameters, SoftObject> = Recent::new(16);

impl std::fmt::Debug for SoftObject {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SoftObject").field("finger", &self.finger).finish_non_exhaustive()
    }
}

impl SoftObject {
    /// Loads the shipped network for an object of `shape` between fingers of half-extents `finger`
    /// (m), or returns a recently built instance.
    pub fn new(shape: &Shape, finger: Vector3<f64>, poisson: f64) -> Result<Arc<Self>> {
        let parameters = ModelParameters { shape: shape.clone(), finger, poisson };
        BUILT.get(&parameters, || {
            let moduli = Moduli { young: YOUNG, poisson };
            let surrogate = SoftSurrogate::named("soft", shape, moduli, 1.0)?;
            let mesh = surrogate.body().mesh();
            let markers = spread_out(surrogate.body());
            let shell = Arc::new(shell(mesh));
            let volumes = (0..mesh.tets.len()).map(|t| mesh.tet_volume(t)).collect();
            Ok(Self { surrogate, markers, shell, volumes, finger })
        })
    }

    /// Model of the object.
    pub fn model(&self) -> &SoftSurrogate {
        &self.surrogate
    }

    /// Creates the press by fingers whose faces are at `faces` in the object's frame, z towards the
    /// object.
    pub fn press(
        &self,
        faces: &[Isometry3<f64>; 2],
        friction: f64,
        history: Option<History>,
    ) -> Result<Press> {
        let back = Isometry3::translation(0.0, 0.0, -self.finger.z);
        let poses = faces.iter().map(|face| face * back).collect();
        let fingers = vec![Shape::Cuboid { half_extents: self.finger }; 2];
        let press = Press::along(fingers, vec![poses])?.with_friction(friction)?;
        match history {
            Some(history) => press.after(history),
            None => Ok(press),
        }
    }

    /// Evaluates a solution for an object of Young's modulus `young` (Pa); `None` without contact.
    pub fn squeezed(&self, answer: &Deformation, young: f64) -> Result<Option<Squeezed>> {
        if answer.contact_force.iter().all(|force| *force == Vector3::zeros()) {
            return Ok(None);
        }
        let (rest, share) = (&self.surrogate.body().mesh().vertices, young / YOUNG);
        let moved: Vec<_> = rest.iter().zip(&answer.displacement).map(|(p, u)| p + u).collect();
        let RigidFit { motion, residual } = RigidFit::new(rest, &moved)?;
        let marker = |&node: &u32| moved[node as usize] - motion * rest[node as usize];
        let stresses = answer.von_mises.iter().copied();
        let all: f64 = stresses.clone().zip(&*self.volumes).map(|(s, volume)| s * volume).sum();
        let wrenches = self.surrogate.of_fingers(&self.finger, answer);
        let face = |i: usize| answer.poses[i].rotation * Vector3::z();
        Ok(Some(Squeezed {
            markers: self.markers.iter().map(marker).collect(),
            deviation: residual,
            peak: share * stresses.fold(0.0, f64::max),
            mean: share * all / self.volumes.iter().sum::<f64>(),
            forces: [0, 1].map(|i| share * wrenches[i].force.dot(&face(i))),
        }))
    }

    /// Surface of the object, for rendering.
    pub fn shell(&self) -> &Shell {
        &self.shell
    }

    /// Stress of a built model (Pa) that is `share` of Young's modulus.
    pub fn stress(&self, share: f64) -> f64 {
        share * YOUNG
    }
}

fn shell(mesh: &TetMesh) -> Shell {
    let mut shares = vec![Vec::new(); mesh.vertices.len()];
    for (number, tet) in mesh.tets.iter().enumerate() {
        for &node in tet {
            shares[node as usize].push((number as u32, 1.0));
        }
    }
    for shares in &mut shares {
        let all = shares.len() as f64;
        for (_, share) in shares {
            *share /= all;
        }
    }
    Shell::new(&mesh.vertices, &mesh.boundary(), &shares)
}

/// Nodes of the surface, each as far as possible from those before it.
fn spread_out(body: &SoftBody) -> Arc<[u32]> {
    let places = &body.mesh().vertices;
    let mut surface: Vec<u32> = body.mesh().boundary().into_iter().flatten().collect();
    surface.sort_unstable();
    surface.dedup();
    let mut gaps = vec![f64::INFINITY; surface.len()];
    let mut next = 0;
    (0..MARKERS.min(surface.len()))
        .map(|_| {
            let chosen = surface[next];
            for (gap, &node) in gaps.iter_mut().zip(&surface) {
                *gap = gap.min((places[node as usize] - places[chosen as usize]).norm());
            }
            let farthest = (0..gaps.len()).max_by(|&a, &b| gaps[a].total_cmp(&gaps[b]));
            next = farthest.unwrap_or_default();
            chosen
        })
        .collect()
}

impl Squeezed {
    /// Displacements of the markers rotated by `turn` (m).
    pub fn seen(&self, turn: &Matrix3<f64>) -> Vec<Vector3<f64>> {
        self.markers.iter().map(|marker| turn * marker).collect()
    }
}
