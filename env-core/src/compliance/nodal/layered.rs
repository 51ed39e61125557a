//! Compliance model of a pad that resolves small contacts: cells of 1.3 to 0.01 mm, as the contact
//! needs.
//!
//! Contact at the face nodes of a mesh misses what lies between them. Here it is evaluated on one
//! of several regular grids of cells ([`CellGrid`]), each twice as fine as the one before, chosen
//! in every load step by the number of cells that touch.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::{cell::RefCell, sync::Arc};

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    check_friction,
    contact_nodes::ContactNodes,
    grid::{CellGrid, CellLevels, ROOT},
    half_space::PointForce,
    kernel::PlaneKernel,
    load_stepping::NodalLoadStepping,
    model_face::{ModelFace, NearNodes},
    near_field::NearField,
    patch::NodalScratch,
    resolution::{ContactResolution, LEVELS},
    side_field::SideField,
    sides::Sides,
    state::ContactSolution,
    wall_contact::WallContact,
};
use crate::{
    Result,
    compliance::Compliance,
    contact::{Backing, ContactLaw},
    deformation::Press,
    geometry::{PadMesh, PadOutline, Shape},
    interrupt,
    simd::{LANES, add_rows, vectorised},
};

/// Longest side of the cells of the first grid (m).
const FIRST: f64 = 1.33e-3;
/// Number of levels whose cells have precomputed data.
const KEPT: usize = 2;

thread_local! {
    /// Reused from press to press: to free and allocate megabytes costs as much as a small press.
    static SCRATCH: RefCell<NodalScratch> = RefCell::default();
}

/// Compliance model of a pad with contact on grids of cells. Copies share the precomputed data.
#[derive(Clone)]
pub struct LayeredPad {
    levels: Arc<Vec<ContactNodes>>,
    resolution: ContactResolution,
    law: ContactLaw,
    walls: Arc<WallContact>,
    model: Arc<ModelFace>,
    near_field: Arc<NearField>,
    /// Precomputed data of each cell of the first levels.
    known: Arc<Vec<Vec<Known>>>,
}

/// Precomputed data of a cell.
struct Known {
    /// [`ModelFace::under`] it.
    under: ([u32; 3], [f64; 3]),
    /// Changes of the displacement of [`NearNodes::parts`], layer after layer, by a unit force
    /// along each axis on it, and their unit (m/N).
    changes: [Vec<i16>; 3],
    unit: f32,
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
    /// Part of `borne` of cells that slide (N).
    pub sliding: f64,
}

impl LayeredPad {
    /// Builds the model of the pad of `outline`, of the body and friction of `compliance`, for
    /// fields on a `model` mesh, with fast contact. Returns an error if that is not a mesh of the
    /// pad whose `sides` are given.
    pub fn new(
        compliance: &Compliance,
        outline: &PadOutline,
        model: &PadMesh,
        sides: &Sides,
    ) -> Result<Self> {
        let condensed = &compliance.condensed;
        let along = |extent: f64| ROOT * (extent / (FIRST * f64::from(ROOT))).ceil() as u32;
        let count = [along(outline.width), along(outline.length)];
        let moduli = condensed.body.moduli()[0];
        let cells = CellLevels::new(outline, count, LEVELS as usize, moduli, sides);
        let level = |level| {
            ContactNodes::of_grid(Arc::clone(condensed), CellGrid::new(&cells, level), level == 0)
        };
        let levels: Vec<_> = (0..LEVELS).map(level).collect();
        interrupt::check()?;
        // Layers are equally deep, as a part of the height, in all columns.
        let height = |layer: usize| model.mesh.vertices[layer * model.face.len()].z;
        let layers = model.cells[2] as usize;
        let part = |layer| (height(0) - height(layer)) / (height(0) - height(layers));
        let depths: Vec<_> = (0..=layers).map(|layer| outline.thickness * part(layer)).collect();
        let plane = |depth: &f64| PlaneKernel::new(*depth, outline.thickness, moduli);
        let below = depths[1..layers].iter().map(plane).collect();
        let near_field = Arc::new(NearField::new(model, &depths, moduli));
        let side_field = SideField::new(sides, model)?;
        interrupt::check()?;
        let model = Arc::new(ModelFace::new(model, below, side_field, &CellGrid::new(&cells, 1)));
        interrupt::check()?;
        let known = levels.iter().take(KEPT).map(|nodes| {
            let grid = nodes.grid().expect("levels are grids");
            (0..grid.len() as u32).map(|cell| Known::new(&model, grid, cell)).collect()
        });
        let known = Arc::new(known.collect());
        let law = compliance.settings.law;
        let (resolution, walls) = (ContactResolution::FAST, Arc::new(WallContact::new(outline)));
        Ok(Self { levels: Arc::new(levels), resolution, law, walls, model, near_field, known })
    }

    /// Returns this model with other friction and contact at another `resolution`; both share the
    /// precomputed data.
    pub fn with(&self, friction: f64, resolution: ContactResolution) -> Result<Self> {
        check_friction(friction)?;
        let law = ContactLaw { friction, ..self.law };
        Ok(Self { resolution, law, ..self.clone() })
    }

    /// Held faces of the pad.
    pub(crate) fn backing(&self) -> &Backing {
        &self.levels[0].condensed.backing
    }

    /// Part of the contact of `shapes` at `poses` (S) that is on the pad's walls, which have no
    /// cells: 0 to 1.
    pub fn share_on_walls(&self, shapes: &[Shape], poses: &[Isometry3<f64>]) -> f64 {
        self.walls.share(shapes, poses)
    }

    /// Solves every frame of `press`, in order; the first that fails is an error and the last.
    pub fn settled_path(&self, press: &Press) -> Vec<Result<ContactSolution>> {
        let mut scratch = SCRATCH.take();
        let levels = (&self.levels[..], self.resolution);
        let answers = match NodalLoadStepping::new(levels, self.law, press, &mut scratch) {
            Ok(stepping) => stepping.every(press),
            Err(error) => vec![Err(error)],
        };
        SCRATCH.set(scratch.trimmed());
        answers
    }

    /// Contact of a solution distributed to the face nodes of the model mesh that bear some of it,
    /// ascending.
    pub fn contacts(&self, settled: &ContactSolution) -> Vec<(u32, NodeContact)> {
        let grid = self.grid(settled);
        let mut sum = vec![NodeContact::default(); self.model.nodes.len()];
        let mut bears = vec![false; sum.len()];
        for ((rank, force), normal) in settled.forces.iter().zip(&settled.normals) {
            let (corners, shares) = match self.known.get(settled.level) {
                Some(by_cell) => by_cell[*rank as usize].under,
                None => self.model.under(&grid.place(*rank)),
            };
            let size = force.norm();
            let sliding = if self.law.slides(force, normal) { size } else { 0.0 };
            // Slope of the shape against the face, up to that of a wall of 84°.
            let slope = normal.xy().norm_squared() / normal.z.powi(2).max(1e-2);
            for (corner, share) in corners.into_iter().zip(shares).filter(|(_, s)| *s > 0.0) {
                bears[corner as usize] = true;
                let contact = &mut sum[corner as usize];
                contact.force += force * share;
                contact.borne += size * share;
                contact.area += grid.area() * share;
                contact.normal += normal * (size * share);
                contact.slope += slope * (size * share);
                contact.sliding += sliding * share;
            }
        }
        (0..).zip(sum).zip(bears).filter_map(|(contact, bears)| bears.then_some(contact)).collect()
    }

    /// Contact of a solution as forces (N) on points of the face at rest (m), `count` along each
    /// side of a touching cell, over which its force is spread evenly.
    pub fn point_forces(
        &self,
        settled: &ContactSolution,
        count: u32,
    ) -> Vec<(Point3<f64>, Vector3<f64>)> {
        let (grid, share) = (self.grid(settled), 1.0 / f64::from(count * count));
        let spread = |(cell, force): &(u32, Vector3<f64>)| {
            let part = force * share;
            grid.points(*cell, count).map(move |point| (point, part))
        };
        settled.forces.iter().flat_map(spread).collect()
    }

    /// Side of the cells on which a solution was found (m).
    pub fn spacing(&self, settled: &ContactSolution) -> f64 {
        self.grid(settled).area().sqrt()
    }

    /// Displacement (m/N) of the model mesh's free nodes under a unit force along each axis around
    /// each node of its face, by the node and the axis.
    pub fn unit_responses(&self) -> impl Iterator<Item = Vec<Vector3<f64>>> {
        let count = self.model.nodes.len();
        let response = move |i: usize| {
            let [loaded, axis] = [i / 3, i % 3];
            let rows =
                self.model.between.iter().flat_map(move |rows| &rows[loaded * count..][..count]);
            rows.map(|block| Vector3::from(block.column(axis)).cast()).collect()
        };
        (0..3 * count).map(response)
    }

    /// Replaces, in the displacement of nodes (m) near the contact, the effect of forces
    /// distributed over the face nodes by that of the forces on cells.
    pub fn refine(&self, settled: &ContactSolution, displacement: &mut [Vector3<f64>]) {
        let (grid, model) = (self.grid(settled), &self.model);
        let layer = 3 * model.nodes.len();
        // Parts of the last nodes reach beyond them.
        let mut sum = vec![0f32; 3 * displacement.len() + LANES];
        for (cell, force) in &settled.forces {
            let force: [f32; 3] = force.cast::<f32>().into();
            let near = model.near(&grid.place(*cell));
            if let Some(by_cell) = self.known.get(settled.level) {
                let Known { unit, changes, .. } = &by_cell[*cell as usize];
                let force = force.map(|f| f * unit);
                vectorised(
                    #[inline(always)]
                    || add(&mut sum, layer, near, changes, force),
                );
            } else {
                let changes = model.changes(grid, *cell, force);
                let layers = sum.chunks_exact_mut(layer);
                for (layer, changes) in layers.zip(changes.chunks_exact(near.nodes.len())) {
                    let layer = layer.as_chunks_mut::<3>().0;
                    for (node, change) in near.nodes.iter().zip(changes) {
                        let sum = &mut layer[*node as usize];
                        (0..3).for_each(|i| sum[i] += change[i]);
                    }
                }
            }
        }
        for (u, &sum) in displacement.iter_mut().zip(sum.as_chunks::<3>().0) {
            *u += Vector3::from(sum).cast::<f64>();
        }
    }

    /// Von Mises stress (T) in Pa of the model mesh's tetrahedra near the contact under the forces
    /// on cells, given the refined `displacement` (V) in m; `None` of those farther away.
    pub fn stress_near_contact(
        &self,
        settled: &ContactSolution,
        displacement: &[Vector3<f64>],
    ) -> Vec<Option<f64>> {
        let grid = self.grid(settled);
        let point = |(cell, force): &(u32, Vector3<f64>)| {
            let place = grid.place(*cell);
            PointForce { place: [place.x as f32, place.y as f32], force: force.cast().into() }
        };
        let forces: Vec<_> = settled.forces.iter().map(point).collect();
        self.near_field.von_mises(&forces, self.spacing(settled), displacement)
    }

    fn grid(&self, settled: &ContactSolution) -> &CellGrid {
        self.levels[settled.level].grid().expect("levels are grids")
    }
}

impl Known {
    fn new(model: &ModelFace, grid: &CellGrid, cell: u32) -> Self {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let place = grid.place(cell);
        let near = model.near(&place);
        let [x, y, z] = axes.map(|force| model.changes(grid, cell, force));
        let all = [&x, &y, &z].map(|changes| changes.as_flattened());
        let largest = all.into_iter().flatten().fold(0f32, |most, u| most.max(u.abs()));
        let unit = largest / f32::from(i16::MAX);
        let round = |u: f32| (u / unit.max(f32::MIN_POSITIVE)).round() as i16;
        let changes = [x, y, z].map(|changes| {
            let layers = changes.chunks_exact(near.nodes.len());
            layers.flat_map(|layer| near.in_parts(layer)).map(round).collect()
        });
        Self { under: model.under(&place), changes, unit }
    }
}

/// Adds to the displacement of layers of `layer` numbers the `changes` of what is `near`, by layer,
/// under a `force`.
#[inline(always)]
fn add(
    displacement: &mut [f32],
    layer: usize,
    near: &NearNodes,
    changes: &[Vec<i16>; 3],
    force: [f32; 3],
) {
    let (mut begin, mut done) = (0, 0);
    while done < changes[0].len() {
        for &[first, last] in &near.parts {
            let sum = &mut displacement[begin + first..begin + last];
            let changes = changes.each_ref().map(|changes| &changes[done..][..last - first]);
            add_rows(sum, changes, force);
            done += last - first;
        }
        begin += layer;
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use nalgebra::{Matrix3, Translation3, UnitQuaternion};

    use super::*;
    use crate::{
        compliance::ComplianceOptions,
        compliance::nodal::{model_face::SPREAD, near_field::LIFT},
        deformation::{Law, Moduli, SoftBody},
        geometry::sample_shares,
        sensor::Sensor,
    };

    fn layered() -> LayeredPad {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        let pad = sensor.pad(1000).unwrap();
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let body = SoftBody::new(pad.mesh.clone(), Law::default(), moduli, &pad.base).unwrap();
        let options = ComplianceOptions { friction: 0.5, corrections: 0 };
        let compliance = Compliance::new(body, options).unwrap();
        let sides = Sides::new(&sensor.outline, moduli, 300).unwrap();
        LayeredPad::new(&compliance, &sensor.outline, &pad, &sides).unwrap()
    }

    #[test]
    fn walls_are_felt_by_cells_as_wide_only_from_their_side() {
        let layered = layered();
        let cup = Shape::Cup { bottom: 0.018, rim: 0.0181, half_height: 0.022, wall: 2e-3 };
        let under = |turn: f64, [x, height]: [f64; 2]| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), turn);
            let at = |depth: f64| {
                vec![Isometry3::from_parts(Translation3::new(x, 0.0, height - depth), turn)]
            };
            let path = [2e-4, 4e-4, 6e-4, 8e-4].map(at).to_vec();
            let press = Press::along(vec![cup.clone()], path).unwrap();
            layered.settled_path(&press).pop().unwrap().unwrap()
        };
        let (side, rim) = (under(-FRAC_PI_2, [0.0, 0.018]), under(PI, [-0.017, 0.022]));
        assert!(
            side.level == 0 && side.forces.len() > 64,
            "{} on {}",
            side.forces.len(),
            side.level
        );
        assert!(rim.level == 1 && rim.forces.len() > 96, "{} on {}", rim.forces.len(), rim.level);
    }

    #[test]
    fn forces_on_points_of_cells_add_up_to_the_wrench() {
        let layered = layered();
        let pose = Isometry3::translation(2e-3, -1e-3, 5e-3 - 4e-4);
        let press = Press::along(vec![Shape::Sphere { radius: 5e-3 }], vec![vec![pose]]).unwrap();
        let settled = layered.settled_path(&press).pop().unwrap().unwrap();
        let points = layered.point_forces(&settled, 3);
        assert_eq!(points.len(), 9 * settled.forces.len());
        let sum: Vector3<f64> = points.iter().map(|(_, force)| force).sum();
        let whole = settled.wrench.force;
        // Rounding of hundreds of forces.
        assert!((sum - whole).norm() < 1e-12 * whole.norm(), "{sum} N against {whole} N");
        let middle =
            points.iter().map(|(at, force)| at.coords * force.z).sum::<Vector3<f64>>() / sum.z;
        // It touches around the lowest point of the ball; cells are smaller than 0.4 mm.
        assert!((middle.xy() - pose.translation.vector.xy()).norm() < 2e-4, "{middle}");
    }

    /// Cells beside an edge must stay on the side where the block met them, not be pushed out at
    /// the side that is nearest once they are inside.
    #[test]
    fn a_block_presses_the_same_in_one_step_and_in_many() {
        let layered = layered();
        let form = Shape::Cuboid { half_extents: Vector3::repeat(5e-3) };
        let under = |steps: usize| {
            let at = |step: usize| {
                let depth = 4.5e-4 * step as f64 / steps as f64;
                vec![Isometry3::translation(1.3e-3, -7e-4, 5e-3 - depth)]
            };
            let press = Press::along(vec![form.clone()], (1..=steps).map(at).collect()).unwrap();
            layered.settled_path(&press).pop().unwrap().unwrap().wrench.force
        };
        let (one, many) = (under(1), under(20));
        assert!((one - many).norm() < 0.01 * many.norm(), "{one} instead of {many}");
    }

    #[test]
    fn a_first_touch_is_found_on_cells_as_large_as_it_allows() {
        let layered = layered();
        let touch = |shape: Shape, height: f64| {
            let path = vec![vec![Isometry3::translation(0.0, 0.0, height)]];
            let press = Press::along(vec![shape], path).unwrap();
            layered.settled_path(&press).pop().unwrap().unwrap()
        };
        let radius = 1e-3;
        let ball = |depth: f64| touch(Shape::Sphere { radius }, radius - depth);
        assert!(ball(-1e-5).forces.is_empty());
        let little = ball(1e-5);
        assert!(little.level >= 5 && !little.forces.is_empty(), "on level {}", little.level);
        let block = Shape::Cuboid { half_extents: Vector3::repeat(1.5e-2) };
        assert!(touch(block.clone(), 1.5e-2 + 1e-5).forces.is_empty());
        let wide = touch(block, 1.5e-2 - 3e-4);
        assert!(
            wide.level == 0 && wide.forces.len() > 96,
            "{} on {}",
            wide.forces.len(),
            wide.level
        );
    }

    /// Displacement (m) of a node of a free layer of the model mesh under the forces on all cells,
    /// by the elastic layer and the sides.
    fn under_cells(
        layered: &LayeredPad,
        settled: &ContactSolution,
        [layer, node]: [usize; 2],
    ) -> Vector3<f64> {
        let (model, grid) = (&layered.model, layered.grid(settled));
        let at = &model.nodes[node];
        let by_cell = |(cell, force): &(u32, Vector3<f64>)| {
            let from = grid.place(*cell);
            if layer == 0 {
                return grid.at_point(*cell, at).cast::<f64>() * force;
            }
            let in_layer = grid.tilt(*cell).tr_mul(force);
            let away = at - from;
            grid.tilt_at(at) * (model.below[layer - 1].at(away.x, away.y) * in_layer)
        };
        let by_sides = |(point, force): &(Point3<f64>, Vector3<f64>)| {
            let at = layer * model.nodes.len() + node;
            let part = |(from, share): (usize, f64)| {
                model.sides.row(from)[at].cast::<f64>() * (force * share)
            };
            model.sides.around(point).into_iter().map(part).sum::<Vector3<f64>>()
        };
        let points = layered.point_forces(settled, SPREAD);
        settled.forces.iter().map(by_cell).sum::<Vector3<f64>>()
            + points.iter().map(by_sides).sum::<Vector3<f64>>()
    }

    /// Displacement (m) times 4πμ at `away` from a `force` on a half-space, as Johnson (1985,
    /// eqs. 3.18 and 3.75) writes it, with z and the force along it into the half-space.
    fn half_space(away: Vector3<f64>, force: Vector3<f64>, nu: f64) -> Vector3<f64> {
        let (x, y, z) = (away.x, away.y, away.z);
        let (r, m) = (away.norm(), 1.0 - 2.0 * nu);
        let normal = Vector3::new(
            x * z / r.powi(3) - m * x / (r * (r + z)),
            y * z / r.powi(3) - m * y / (r * (r + z)),
            z * z / r.powi(3) + 2.0 * (1.0 - nu) / r,
        );
        let along = |x: f64, y: f64| {
            let even = 1.0 / r + x * x / r.powi(3);
            [
                even + m * (1.0 / (r + z) - x * x / (r * (r + z).powi(2))),
                x * y / r.powi(3) - m * x * y / (r * (r + z).powi(2)),
                x * z / r.powi(3) + m * x / (r * (r + z)),
            ]
        };
        let ([a, b, c], [d, e, f]) = (along(x, y), along(y, x));
        normal * force.z + Vector3::new(a, b, c) * force.x + Vector3::new(e, d, f) * force.y
    }

    #[test]
    fn refined_stress_is_that_of_all_cells_at_many_points() {
        const STEP: f64 = 1e-8;
        let (sensor, layered) = (Sensor::named("gelsight-mini").unwrap(), layered());
        let pad = sensor.pad(1000).unwrap();
        let (mesh, moduli) = (&pad.mesh, Moduli { young: 3e5, poisson: 0.47 });
        let pose = Isometry3::translation(1e-3, 2e-3, 2e-3 - 3e-4);
        let press = Press::along(vec![Shape::Sphere { radius: 2e-3 }], vec![vec![pose]]).unwrap();
        let settled = layered.settled_path(&press).pop().unwrap().unwrap();
        let (grid, count) = (layered.grid(&settled), pad.face.len());
        let mut displacement = vec![Vector3::zeros(); mesh.vertices.len()];
        for (k, moved) in displacement.iter_mut().enumerate().take(pad.cells[2] as usize * count) {
            *moved = under_cells(&layered, &settled, [k / count, k % count]);
        }
        let found = layered.stress_near_contact(&settled, &displacement);

        let lift = LIFT[0] * layered.spacing(&settled);
        let scale = 1.0 / (4.0 * PI * moduli.shear());
        let half_space = |x: f64, y: f64, depth: f64| -> Vector3<f64> {
            let by_cell = |(cell, force): &(u32, Vector3<f64>)| {
                let from = grid.place(*cell);
                let away = Vector3::new(x - from.x, y - from.y, depth + lift);
                let force = Vector3::new(force.x, force.y, -force.z);
                half_space(away, force, moduli.poisson)
            };
            let u = settled.forces.iter().map(by_cell).sum::<Vector3<f64>>() * scale;
            Vector3::new(u.x, u.y, -u.z)
        };
        let bottom = mesh.vertices[pad.base[0] as usize].z;
        // Depths in the layer are parts of its thickness, those of the mesh parts of its height.
        let rest = |node: u32| {
            let (place, face) =
                (mesh.vertices[node as usize], mesh.vertices[node as usize % count]);
            let depth = sensor.outline.thickness * (face.z - place.z) / (face.z - bottom);
            displacement[node as usize] - half_space(place.x, place.y, depth)
        };
        let von_mises = |tet: usize| -> f64 {
            let corners = mesh.tets[tet];
            let [a, b, c, d] = corners.map(rest);
            let [p, q, r, s] = mesh.corners(tet);
            let edges = Matrix3::from_columns(&[q - p, r - p, s - p]).try_inverse().unwrap();
            let smooth = Matrix3::from_columns(&[b - a, c - a, d - a]) * edges;
            let samples = sample_shares(12);
            let at = |shares: &[f64; 4]| {
                let places = corners.map(|node| {
                    let (place, face) =
                        (mesh.vertices[node as usize], mesh.vertices[node as usize % count]);
                    Vector3::new(place.x, place.y, face.z - place.z)
                });
                let place: Vector3<f64> = (0..4).map(|a| places[a] * shares[a]).sum();
                let by = |axis: usize| {
                    let step = Vector3::ith(axis, if axis == 2 { -STEP } else { STEP });
                    let moved = |p: Vector3<f64>| half_space(p.x, p.y, p.z);
                    (moved(place + step) - moved(place - step)) / (2.0 * STEP)
                };
                let gradient = smooth + Matrix3::from_columns(&[by(0), by(1), by(2)]);
                let strain = (gradient + gradient.transpose()) * 0.5;
                let deviator = strain - Matrix3::from_diagonal_element(strain.trace() / 3.0);
                2.0 * moduli.shear() * 1.5_f64.sqrt() * deviator.norm()
            };
            samples.iter().map(at).sum::<f64>() / samples.len() as f64
        };
        let near: Vec<_> =
            (0..).zip(&found).filter_map(|(tet, found)| Some((tet, (*found)?))).collect();
        let (mut error, mut all) = (0.0, 0.0);
        for &(tet, found) in near.iter().step_by(7) {
            let right = von_mises(tet);
            error += (found - right).powi(2);
            all += right.powi(2);
        }
        assert!(near.len() > 300 && near.len() < found.len(), "{} near", near.len());
        let error = (error / all).sqrt();
        assert!(error < 0.1, "{error} on cells of {} m", layered.spacing(&settled));
    }

    #[test]
    fn refined_displacement_is_that_under_all_cells() {
        let layered = layered();
        // At one side and in the middle, by small and large balls.
        for (radius, x) in [(1.5e-3, 0.0), (8e-3, 0.0), (3e-3, 7e-3)] {
            let pose = Isometry3::translation(x, 2e-3, radius - 5e-4);
            let press = Press::along(vec![Shape::Sphere { radius }], vec![vec![pose]]).unwrap();
            let settled = layered.settled_path(&press).pop().unwrap().unwrap();
            let forces: Vec<_> = layered
                .contacts(&settled)
                .iter()
                .map(|(node, c)| (*node as usize, c.force))
                .collect();
            assert!(forces.len() > 3, "{} nodes bear some", forces.len());
            let count = layered.model.nodes.len();
            let mut found = vec![Vector3::zeros(); layered.model.between.len() * count];
            let units: Vec<_> = layered.unit_responses().collect();
            for (node, force) in &forces {
                for axis in 0..3 {
                    let unit = &units[3 * node + axis];
                    found.iter_mut().zip(unit).for_each(|(sum, u)| *sum += u * force[axis]);
                }
            }
            layered.refine(&settled, &mut found);
            let (mut error, mut most, mut squares) = (0f64, 0f64, [0.0; 2]);
            for (k, found) in found.iter().enumerate() {
                let right = under_cells(&layered, &settled, [k / count, k % count]);
                error = error.max((found - right).norm());
                most = most.max(right.norm());
                squares[0] += (found - right).norm_squared();
                squares[1] += right.norm_squared();
            }
            let mean = (squares[0] / squares[1]).sqrt();
            assert!(error < 1e-2 * most, "{error} m of {most} m under a ball of {radius} m");
            // Far from the contact, the sides change what they do under tractions around the nodes.
            assert!(mean < 2.5e-2, "{mean} under a ball of {radius} m");
        }
    }
}
