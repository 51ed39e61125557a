//! Gels of a dataset as graphs: nodes, edges of tetrahedra, corners.

use std::{collections::BTreeSet, sync::Arc};

use nalgebra::{Isometry3, Point3};

use crate::{
    Result, dataset,
    geometry::{PadMesh, Shape},
    surrogate::{material::PadMaterial, ops::Sparse},
};

/// The gels of a dataset.
pub(super) struct PaperGels {
    pub(super) pads: Vec<Pad>,
}

/// A gel.
pub(super) struct Pad {
    pub(super) gel: PadMaterial,
    pub(super) graph: Arc<Graph>,
}

/// Data shared by all presses of a pad mesh.
pub(super) struct Graph {
    /// Nodes at rest (V) in m.
    pub(super) places: Vec<Point3<f64>>,
    /// Nodes of the face, which come first.
    pub(super) columns: usize,
    /// 1 for a node that moves, 0 for a bonded one (V).
    pub(super) free: Vec<f32>,
    /// Receiver and sender of each directed edge, sorted.
    pub(super) pairs: Vec<(u32, u32)>,
    /// Matrix that sums over the corners of each tetrahedron (T, V).
    pub(super) corners: Arc<Sparse>,
    /// Half of the extent across and along (m).
    pub(super) half: [f64; 2],
}

/// Largest depth at first touch (m).
const TOUCH: f64 = 1e-6;
/// Greatest number of steps to first touch, each as long as the remaining depth.
const STEPS: usize = 100;

impl PaperGels {
    /// Builds the gels of `config`.
    pub(super) fn new(config: &dataset::DatasetConfig) -> Result<Self> {
        let pad = |gel: &dataset::GelConfig| {
            let sensor = gel.sensor()?;
            let moduli = gel.moduli();
            let thickness = sensor.outline.thickness;
            let graph = Arc::new(Graph::new(&sensor.pad(config.model_nodes)?));
            Ok(Pad { gel: PadMaterial { moduli, friction: gel.friction, thickness }, graph })
        };
        Ok(Self { pads: config.gels.iter().map(pad).collect::<Result<_>>()? })
    }
}

impl Graph {
    pub(super) fn new(pad: &PadMesh) -> Self {
        let places = pad.mesh.vertices.clone();
        let mut free = vec![1.0; places.len()];
        pad.base.iter().for_each(|&i| free[i as usize] = 0.0);
        let tets = pad.mesh.tets.iter();
        let both = |&a: &u32, tet: &[u32; 4]| tet.map(|b| (a, b));
        let pairs = tets.clone().flat_map(|tet| tet.iter().flat_map(move |a| both(a, tet)));
        let pairs: BTreeSet<_> = pairs.filter(|(a, b)| a != b).collect();
        let corners: Vec<Vec<_>> =
            tets.map(|tet| tet.iter().map(|&i| (i, 1.0)).collect()).collect();
        let reach = |axis: usize| places.iter().map(|p| p[axis].abs()).fold(0.0, f64::max);
        Self {
            half: [reach(0), reach(1)],
            columns: pad.face.len(),
            free,
            pairs: pairs.into_iter().collect(),
            corners: Arc::new(Sparse::new(&corners, places.len())),
            places,
        }
    }

    /// The pose at which `shape`, drawn out along the pad's axis from `pose`, just touches the
    /// face.
    pub(super) fn touch(&self, shape: &Shape, mut pose: Isometry3<f64>) -> Isometry3<f64> {
        for _ in 0..STEPS {
            let distance = |p: &Point3<f64>| shape.distance(&pose.inverse_transform_point(p)).value;
            let gap =
                self.places[..self.columns].iter().map(distance).fold(f64::INFINITY, f64::min);
            if gap > -TOUCH {
                break;
            }
            pose.translation.z -= gap;
        }
        pose
    }
}
