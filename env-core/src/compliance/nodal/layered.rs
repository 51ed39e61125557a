//! Compliance model of a pad that resolves small contacts: cells of 1.3 to 0.04 mm, as the contact
//! needs.
//!
//! Between the face nodes of a mesh, contact is not seen. Here it is evaluated on one of several
//! regular grids of cells ([`Grid`]), each twice as fine as the one before, chosen in every load
//! step by the number of cells that touch.

use std::{collections::BTreeMap, sync::Arc};

use nalgebra::{Matrix3, Point3, Vector3};

use super::{
    Settled,
    grid::{Cells, Grid, ROOT},
    kernel::PlaneKernel,
    load_stepping::{NodalLoadStepping, Scratch},
    skin::Skin,
};
use crate::{
    Result,
    compliance::Compliance,
    contact::ContactLaw,
    deformation::Press,
    geometry::{PadMesh, PadOutline, plan_shares},
};

/// Longest side of the cells of the first grid (m), and number of grids.
const FIRST: f64 = 1.33e-3;
const LEVELS: u32 = 6;
/// Distance in plan from the contact within which displacements are corrected (m).
const NEAR: f64 = 4e-3;

/// Compliance model of a pad with contact on grids of cells. Copies share the precomputed data.
#[derive(Clone)]
pub struct LayeredPad {
    levels: Arc<Vec<Skin>>,
    law: ContactLaw,
    model: Arc<ModelFace>,
}

/// Contact of the cells around a node.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NodeContact {
    /// Force (N).
    pub force: Vector3<f64>,
    /// Sum of the norms of the cells' forces (N).
    pub borne: f64,
    /// Area of the touching cells (m²).
    pub area: f64,
    /// Outward normal of the shapes, weighted by the cells' forces (N).
    pub normal: Vector3<f64>,
    /// Square of the shapes' slope against the face, weighted by the cells' forces (N).
    pub slope: f64,
}

/// The mesh on which fields are asked for: layers of nodes of one plan. C nodes a layer.
struct ModelFace {
    /// Nodes of the face (C).
    nodes: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// Triangles that a square of the plan may touch, row after row along y.
    squares: Vec<Vec<u32>>,
    /// Lowest corner of the squares (m).
    corner: [f64; 2],
    /// Free layers below the face.
    below: Vec<PlaneKernel>,
    /// Displacement of the nodes of each free layer under unit forces around each face node, by the
    /// elastic layer alone (C, C) in m/N.
    between: Vec<Vec<Matrix3<f32>>>,
}

impl LayeredPad {
    /// Builds the model of the pad of `outline` from its `compliance` on a `fine` mesh, for fields
    /// on a `model` mesh.
    pub fn new(
        compliance: &Compliance,
        outline: &PadOutline,
        fine: &PadMesh,
        model: &PadMesh,
    ) -> Result<Self> {
        let condensed = &compliance.condensed;
        let along = |extent: f64| ROOT * (extent / (FIRST * f64::from(ROOT))).ceil() as u32;
        let count = [along(outline.width), along(outline.length)];
        let cells = Cells::new(outline, count, LEVELS as usize, condensed, fine)?;
        let level =
            |level| Skin::of_grid(Arc::clone(condensed), Grid::new(&cells, level), level == 0);
        let levels: Vec<_> = (0..LEVELS).map(level).collect();
        let moduli = condensed.body.moduli()[0];
        // Layers are equally deep, as a part of the height, in all columns.
        let height = |layer: usize| model.mesh.vertices[layer * model.face.len()].z;
        let layers = model.cells[2] as usize;
        let part = |layer| (height(0) - height(layer)) / (height(0) - height(layers));
        let plane =
            |layer| PlaneKernel::new(outline.thickness * part(layer), outline.thickness, moduli);
        let below = (1..layers).map(plane).collect();
        let model = Arc::new(ModelFace::new(model, below, &Grid::new(&cells, 1)));
        Ok(Self { levels: Arc::new(levels), law: compliance.settings.law, model })
    }

    /// Solves every frame of `press`, in order; the first that fails is an error and the last.
    pub fn settled_path(&self, press: &Press) -> Vec<Result<Settled>> {
        let friction = press.friction().unwrap_or(self.law.friction);
        let law = ContactLaw { friction, ..self.law };
        let mut scratch = Scratch::default();
        match NodalLoadStepping::new(&self.levels, law, press, &mut scratch) {
            Ok(stepping) => stepping.every(press),
            Err(error) => vec![Err(error)],
        }
    }

    /// Contact of a solution distributed to the face nodes of the model mesh that bear some of it,
    /// ascending.
    pub fn contacts(&self, settled: &Settled) -> Vec<(u32, NodeContact)> {
        let grid = self.grid(settled);
        let mut sum = BTreeMap::<u32, NodeContact>::new();
        for ((rank, force), normal) in settled.forces.iter().zip(&settled.normals) {
            let (corners, shares) = self.model.under(&grid.place(*rank));
            let size = force.norm();
            // Slope of the shape against the face, up to that of a wall of 84°.
            let slope = normal.xy().norm_squared() / normal.z.powi(2).max(1e-2);
            for (corner, share) in corners.into_iter().zip(shares).filter(|(_, s)| *s > 0.0) {
                let contact = sum.entry(corner).or_default();
                contact.force += force * share;
                contact.borne += size * share;
                contact.area += grid.area() * share;
                contact.normal += normal * (size * share);
                contact.slope += slope * (size * share);
            }
        }
        sum.into_iter().collect()
    }

    /// Side of the cells on which a solution was found (m).
    pub fn spacing(&self, settled: &Settled) -> f64 {
        self.grid(settled).area().sqrt()
    }

    /// Replaces the displacement of nodes (m) near the contact, which elements give for tractions
    /// `forces` around the face nodes, by that of the layer under the forces on cells, and keeps the
    /// influence of the sides.
    pub fn refine(
        &self,
        settled: &Settled,
        forces: &[(u32, Vector3<f64>)],
        displacement: &mut [Vector3<f64>],
    ) {
        let (grid, model) = (self.grid(settled), &self.model);
        let count = model.nodes.len();
        let cells: Vec<_> =
            settled.forces.iter().map(|(cell, f)| (*cell, grid.place(*cell), f)).collect();
        let forces: Vec<_> = forces.iter().map(|(n, f)| (*n as usize, f.cast::<f32>())).collect();
        for (node, place) in model.nodes.iter().enumerate() {
            let is_near = |(other, _): &(usize, _)| {
                (model.nodes[*other] - place).xy().norm_squared() < NEAR * NEAR
            };
            if !forces.iter().any(is_near) {
                continue;
            }
            let share = grid.cells().share_of_sides(place.x, place.y);
            let sides = |layer: usize, displacement: Vector3<f64>| {
                if share == 0.0 {
                    return Vector3::zeros();
                }
                let row = &model.between[layer][node * count..];
                let around = forces.iter().map(|(other, force)| row[*other] * force);
                (displacement - around.sum::<Vector3<f32>>().cast::<f64>()) * share
            };
            let on_face = cells
                .iter()
                .map(|(cell, _, force)| grid.at_point(*cell, place).cast::<f64>() * *force);
            displacement[node] = on_face.sum::<Vector3<f64>>() + sides(0, displacement[node]);
            for (layer, plane) in (1..).zip(&model.below) {
                let at_depth = cells
                    .iter()
                    .map(|(_, from, force)| plane.at(place.x - from.x, place.y - from.y) * *force);
                let moved = &mut displacement[layer * count + node];
                *moved = at_depth.sum::<Vector3<f64>>() + sides(layer, *moved);
            }
        }
    }

    fn grid(&self, settled: &Settled) -> &Grid {
        self.levels[settled.level].grid().expect("levels are grids")
    }
}

/// Squares of the plan along each axis.
const SQUARES: usize = 48;

impl ModelFace {
    /// Takes `grid` for the layer's response.
    fn new(model: &PadMesh, below: Vec<PlaneKernel>, grid: &Grid) -> Self {
        let nodes: Vec<_> =
            model.face.iter().map(|&node| model.mesh.vertices[node as usize]).collect();
        let corner = [0, 1].map(|axis| nodes.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min));
        let mut face = Self {
            triangles: model.face_triangles.clone(),
            squares: vec![Vec::new(); SQUARES * SQUARES],
            corner,
            between: Vec::new(),
            below,
            nodes,
        };
        for (t, corners) in face.triangles.iter().enumerate() {
            let ends = [0, 1].map(|axis| {
                let along = corners.map(|node| face.nodes[node as usize][axis]);
                let (low, high) = along
                    .iter()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |e, p| (e.0.min(*p), e.1.max(*p)));
                [face.square(axis, low), face.square(axis, high)]
            });
            for i in ends[0][0]..=ends[0][1] {
                for j in ends[1][0]..=ends[1][1] {
                    face.squares[i * SQUARES + j].push(t as u32);
                }
            }
        }
        face.between = face.between(grid);
        face
    }

    fn square(&self, axis: usize, p: f64) -> usize {
        let extent = -2.0 * self.corner[axis];
        ((p - self.corner[axis]) / extent * SQUARES as f64).clamp(0.0, SQUARES as f64 - 1.0)
            as usize
    }

    /// Face nodes around a point, with weights that sum to 1.
    fn under(&self, point: &Point3<f64>) -> ([u32; 3], [f64; 3]) {
        let [i, j] = [self.square(0, point.x), self.square(1, point.y)];
        let candidates = self.squares[i * SQUARES + j].iter().filter_map(|&t| {
            let corners = self.triangles[t as usize];
            let places = corners.map(|node| self.nodes[node as usize]);
            Some((corners, plan_shares(&places, point.x, point.y)?))
        });
        let least = |shares: &[f64; 3]| shares.iter().copied().fold(f64::INFINITY, f64::min);
        let best = candidates.max_by(|(_, a), (_, b)| least(a).total_cmp(&least(b)));
        best.expect("the mesh covers the face")
    }

    fn between(&self, grid: &Grid) -> Vec<Vec<Matrix3<f32>>> {
        let mut tents = vec![Vec::new(); self.nodes.len()];
        for cell in 0..grid.len() as u32 {
            let place = grid.place(cell);
            let (corners, shares) = self.under(&place);
            for (corner, share) in corners.into_iter().zip(shares).filter(|(_, s)| *s > 0.0) {
                tents[corner as usize].push((cell, place, share));
            }
        }
        let layer = |plane: Option<&PlaneKernel>| -> Vec<Matrix3<f32>> {
            let under = |at: &Point3<f64>, cells: &[(u32, Point3<f64>, f64)]| {
                let part = |(cell, from, share): &(u32, Point3<f64>, f64)| match plane {
                    None => grid.at_point(*cell, at) * *share as f32,
                    Some(plane) => plane.at(at.x - from.x, at.y - from.y).cast() * *share as f32,
                };
                let sum: f64 = cells.iter().map(|(_, _, share)| share).sum();
                cells.iter().map(part).sum::<Matrix3<f32>>() / sum as f32
            };
            self.nodes
                .iter()
                .flat_map(|at| tents.iter().map(move |cells| under(at, cells)))
                .collect()
        };
        std::iter::once(None).chain(self.below.iter().map(Some)).map(layer).collect()
    }
}
