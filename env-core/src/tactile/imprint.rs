//! Height map of a face that objects press: their own surface where they touch it, the gel's
//! beside.
//!
//! Nodes of a pad's mesh stand more than a millimetre apart, too far for the rim of a contact. Near
//! contact the gel's surface is therefore smoothed ([`SmoothFace`]). Where nodes bear pressure p it
//! is first raised by β h p/E*, with E* = E/(1 − ν²) and the spacing h of the nodes, at most to a
//! little beyond the object; then it is lowered to the object wherever it lies inside. The rim is
//! where both meet. At the edge of an object that the smoothed surface cannot follow, it rises from
//! the object with a fixed slope ([`ease`]).
//!
//! Shapes: V nodes of the mesh, P pixels, those across the fastest.

use std::{cell::OnceCell, ops::Range, sync::OnceLock};

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    depth,
    ease::ease,
    face::{Face, PlanGrid},
    lower::{gap, lower},
    smooth_face::SmoothFace,
};
use crate::{
    deformation::{Deformation, Moduli},
    geometry::Shape,
};

/// Factor β of the raise. A larger one makes contacts look larger, by 0.1 mm at 0.6; with a smaller
/// one the scatter of finite elements from node to node shows.
const RAISE: f64 = 0.3;
/// Largest height over the object to which nodes are raised, in spacings of the nodes: more than
/// the smoothed surface falls short of the object inside of a flat contact with sharp edges.
const OVER: f64 = 0.05;
/// Share of the largest nodal force from which a node counts as bearing.
const BEARING: f64 = 0.02;
/// Rings of nodes around those that bear where the surface is smoothed.
const RINGS: usize = 3;
/// Longest edge of the fine triangles (m), unless pixels are larger than half of it.
const FINE: f64 = 4e-4;

/// Grid of pixels on a face, with what the picture of a contact needs.
#[derive(Debug)]
pub(super) struct FaceView {
    pub(super) grid: PlanGrid,
    /// Plane-strain modulus E* (Pa).
    modulus: f64,
    /// Made at the first contact.
    smooth: OnceLock<SmoothView>,
}

/// Smooth face under a grid of pixels.
#[derive(Debug)]
struct SmoothView {
    face: SmoothFace,
    /// Height at rest over the face of the mesh (P) in m.
    rise: Vec<f64>,
}

/// Nodes of a pressed face, the same for any pixels.
#[derive(Debug)]
pub(crate) struct RaisedFace {
    /// Displacements (V) in m, of nodes near contact raised by their pressure.
    motion: Vec<Vector3<f64>>,
    /// Shares of the smooth surface (V).
    shares: Vec<f64>,
}

/// Height map of a pressed face.
pub(super) struct Imprint {
    /// Heights (P) in m.
    pub(super) heights: Vec<f64>,
    /// By how much the surface that is deformed lies over that of the mesh at rest (P) in m: 0
    /// where both are the same.
    pub(super) rise: Vec<f64>,
}

impl SmoothView {
    fn new(face: &Face, grid: &PlanGrid) -> Self {
        let pixel = grid.cell[0].max(grid.cell[1]);
        let fine = SmoothFace::new(face, FINE.max(2.0 * pixel));
        let (still, shares) =
            (vec![Vector3::zeros(); face.places.len()], vec![1.0; face.places.len()]);
        let smooth = Covered::new(face, &fine, grid, &still, &shares).heights;
        let mesh = depth::heights(face, grid, None);
        let rise = smooth.iter().zip(mesh).map(|(smooth, mesh)| smooth - mesh).collect();
        Self { face: fine, rise }
    }
}

impl FaceView {
    /// Prepares the pixels of `grid` on a face of a gel with these `moduli`.
    pub(super) fn new(grid: PlanGrid, moduli: Moduli) -> Self {
        let modulus = moduli.young / (1.0 - moduli.poisson.powi(2));
        Self { grid, modulus, smooth: OnceLock::new() }
    }

    /// Height map of `face` deformed by `objects` at their poses; by the mesh alone if there are
    /// none. What other views of the same face need is kept in `raised`.
    pub(super) fn imprint(
        &self,
        face: &Face,
        deformation: &Deformation,
        objects: &[(&Shape, &Isometry3<f64>)],
        raised: &OnceCell<RaisedFace>,
    ) -> Imprint {
        let displacement = &deformation.displacement[..];
        if objects.is_empty() {
            let heights = depth::heights(face, &self.grid, Some(displacement));
            return Imprint { rise: vec![0.0; heights.len()], heights };
        }
        let SmoothView { face: fine, rise } =
            self.smooth.get_or_init(|| SmoothView::new(face, &self.grid));
        let RaisedFace { motion, shares } = raised.get_or_init(|| {
            let near = near(face, deformation);
            let motion = self.raised(face, fine, (deformation, objects), &near);
            let shares = near.iter().zip(&fine.is_border).map(|(near, border)| *near && !border);
            let shares = shares.map(|is_smooth| f64::from(u8::from(is_smooth))).collect();
            RaisedFace { motion, shares }
        });
        let Covered { mut heights, shares } = Covered::new(face, fine, &self.grid, motion, shares);
        let free = heights.clone();
        for (shape, pose) in objects {
            lower(&mut heights, &self.grid, shape, pose);
        }
        ease(&mut heights, &free, &self.grid);
        let rise = rise.iter().zip(shares).map(|(rise, share)| share * rise).collect();
        Imprint { heights, rise }
    }

    /// Displacements (V) in m, with the nodes `near` contact (V) raised by their pressure.
    fn raised(
        &self,
        face: &Face,
        fine: &SmoothFace,
        (deformation, objects): (&Deformation, &[(&Shape, &Isometry3<f64>)]),
        near: &[bool],
    ) -> Vec<Vector3<f64>> {
        let over = OVER * fine.spacing;
        let above = |place: &Point3<f64>| {
            let gaps = objects.iter().filter_map(|(shape, pose)| gap(shape, pose, place));
            gaps.reduce(f64::min).map_or(0.0, |gap| gap.max(0.0))
        };
        let raised = |node: usize, displacement: &Vector3<f64>| {
            let (force, area) = (-deformation.contact_force[node].z, fine.areas[node]);
            if !near[node] || force <= 0.0 || area == 0.0 {
                return *displacement;
            }
            let most = RAISE * fine.spacing * force / (area * self.modulus);
            let raise = if most > over {
                most.min(over + above(&(face.places[node] + displacement)))
            } else {
                most
            };
            displacement + raise * Vector3::z()
        };
        deformation.displacement.iter().enumerate().map(|(node, u)| raised(node, u)).collect()
    }
}

/// Marks the nodes (V) on the face around those that bear.
fn near(face: &Face, deformation: &Deformation) -> Vec<bool> {
    let strengths: Vec<_> = deformation.contact_force.iter().map(Vector3::norm).collect();
    let most = strengths.iter().copied().fold(0.0, f64::max);
    let bears = |strength: &f64| most > 0.0 && *strength >= BEARING * most;
    let mut near: Vec<bool> = strengths.iter().map(bears).collect();
    for _ in 0..RINGS {
        let before = near.clone();
        for triangle in &face.triangles {
            if triangle.iter().any(|&node| before[node as usize]) {
                for &node in triangle {
                    near[node as usize] = true;
                }
            }
        }
    }
    near
}

/// Pixels covered by a face.
struct Covered {
    /// Heights (P) in m.
    heights: Vec<f64>,
    /// Share of the smooth surface (P).
    shares: Vec<f64>,
}

impl Covered {
    /// Covers pixels by the face under `motion` of its nodes (V) in m, smooth by `shares` (V).
    fn new(
        face: &Face,
        fine: &SmoothFace,
        grid: &PlanGrid,
        motion: &[Vector3<f64>],
        shares: &[f64],
    ) -> Self {
        let pixels = (grid.counts[0] * grid.counts[1]) as usize;
        let mut covered =
            Self { heights: vec![-face.thickness(); pixels], shares: vec![0.0; pixels] };
        let mut known = vec![None; fine.len()];
        let mut place = |node: u32| {
            let known = &mut known[node as usize];
            *known.get_or_insert_with(|| fine.place(node, motion, shares))
        };
        for (number, corners) in face.triangles.iter().enumerate() {
            let places = corners.map(|node| face.places[node as usize] + motion[node as usize]);
            let is_far = corners.iter().all(|&node| shares[node as usize] == 0.0);
            if is_far || grid.misses(&places, fine.spacing) {
                let heights = places.map(|place| place.z);
                depth::cover_by(&places, [heights], grid, |pixels, [z]| {
                    covered.raise(pixels, |k| [z.at(k), 0.0]);
                });
                continue;
            }
            for triangle in fine.fine(number) {
                let nodes = triangle.map(&mut place);
                let (places, smooth) =
                    (nodes.map(|(place, _)| place), nodes.map(|(_, share)| share));
                let heights = places.map(|place| place.z);
                depth::cover_by(&places, [heights, smooth], grid, |pixels, [z, share]| {
                    covered.raise(pixels, |k| [z.at(k), share.at(k)]);
                });
            }
        }
        covered
    }

    /// Raises a row of pixels to the height (m) that `found` gives of each, with its share.
    fn raise(&mut self, pixels: Range<usize>, found: impl Fn(i32) -> [f64; 2]) {
        let row = self.heights[pixels.clone()].iter_mut().zip(&mut self.shares[pixels]);
        for (k, (height, share)) in (0..).zip(row) {
            let [z, smooth] = found(k);
            if z > *height {
                (*height, *share) = (z, smooth);
            }
        }
    }
}
