//! Rasterisation of triangles: the nearest facet, and its depth, at every sample of a raster.
//!
//! `retrofire-core` clips a triangle against the view frustum and turns it into spans of samples.
//! Depth and barycentric coordinates come from the planes of the unclipped triangle (Olano and
//! Greer, "Triangle scan conversion using 2D homogeneous coordinates", 1997): with vertex i at
//! `M_i` = (x w, y w, w) on the raster, λ/w = M⁻ᵀ (x, y, 1), whatever the sign of w.

use nalgebra::{Point3, Vector3};
use retrofire_core::{
    geom::vertex,
    math::{Vector, pt3},
    render::{
        clip::{ClipVert, Status, clip_simple_polygon, view_frustum},
        raster::{Scanline, ScreenPt, tri_fill},
    },
};

use super::{camera::FAR, mesh::RenderMesh};

/// Facet number of a sample that no facet covers.
pub(super) const NOTHING: u32 = u32::MAX;

/// Affine function on the raster: its value at (x, y) is a x + b y + c.
pub(super) type Plane = [f32; 3];

/// Value of `plane` at the sample position (x, y).
pub(super) fn at(plane: &Plane, x: f32, y: f32) -> f32 {
    plane[0] * x + plane[1] * y + plane[2]
}

/// Triangle that faces the viewer.
pub(super) struct ScreenTriangle {
    /// Corners in clip space: x, y, z, w.
    corners: [[f32; 4]; 3],
    /// Planes of λ/w for the corners.
    pub(super) planes: [Plane; 3],
    /// Plane of the depth value.
    depth: Plane,
}

impl ScreenTriangle {
    /// Returns whether the triangle covers the sample position (x, y), with a margin for rounding.
    fn covers(&self, x: f32, y: f32) -> bool {
        let weights = self.planes.map(|plane| at(&plane, x, y));
        let least = -1e-4 * weights.iter().sum::<f32>();
        weights.iter().all(|&weight| weight >= least)
    }
}

/// Raster that keeps, for every sample, the facet of greatest depth value.
pub(super) struct Raster {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Depth value (width × height); greater is nearer.
    pub(super) depth: Vec<f32>,
    /// Facet (width × height), or [`NOTHING`].
    pub(super) facet: Vec<u32>,
    clipped: [Vec<ClipVert<()>>; 2],
}

impl Raster {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            depth: vec![f32::NEG_INFINITY; width * height],
            facet: vec![NOTHING; width * height],
            clipped: [Vec::new(), Vec::new()],
        }
    }

    pub(super) fn clear(&mut self) {
        self.depth.fill(f32::NEG_INFINITY);
        self.facet.fill(NOTHING);
    }

    /// Prepares the triangle with these corners in clip space and with depth values `depths`/w.
    /// Returns `None` if it is seen from behind or edge-on, or if its planes are not finite.
    pub(super) fn triangle(
        &self,
        corners: [[f32; 4]; 3],
        depths: [f32; 3],
    ) -> Option<ScreenTriangle> {
        let (half_width, half_height) = (0.5 * self.width as f64, 0.5 * self.height as f64);
        let [a, b, c] = corners.map(|[x, y, _, w]| {
            let [x, y, w] = [x, y, w].map(f64::from);
            Vector3::new(half_width * (x + w), half_height * (w - y), w)
        });
        let normals = [b.cross(&c), c.cross(&a), a.cross(&b)];
        let determinant = a.dot(&normals[0]);
        // The raster's y points down, so counter-clockwise in the world is negative here.
        if !(determinant < 0.0 && determinant.is_finite()) {
            return None;
        }
        let planes: [Plane; 3] = normals.map(|n| (n / determinant).map(|x| x as f32).into());
        let depth = [0, 1, 2].map(|k| (0..3).map(|i| depths[i] * planes[i][k]).sum());
        let finite = planes.iter().flatten().chain(&depth).all(|x| x.is_finite());
        finite.then_some(ScreenTriangle { corners, planes, depth })
    }

    /// Draws `triangle` as number `facet` at every sample where it is the nearest so far.
    pub(super) fn fill(&mut self, triangle: &ScreenTriangle, facet: u32) {
        let vertices = triangle.corners.map(|c| ClipVert::new(vertex(Vector::new(c), ())));
        match view_frustum::status(&vertices) {
            Status::Hidden => {}
            Status::Visible => self.fill_polygon(&vertices, triangle, facet),
            Status::Clipped => {
                let [mut input, mut output] = std::mem::take(&mut self.clipped);
                input.extend(vertices);
                clip_simple_polygon(&view_frustum::PLANES, &mut input, &mut output);
                self.fill_polygon(&output, triangle, facet);
                input.clear();
                output.clear();
                self.clipped = [input, output];
            }
        }
    }

    /// Draws the depth values of `mesh` seen in parallel: [`FAR`] times the z of `to_clip`. `seen`
    /// is scratch memory.
    pub(super) fn fill_depth(
        &mut self,
        mesh: &RenderMesh,
        to_clip: impl Fn(&Point3<f64>) -> [f32; 4],
        seen: &mut Vec<[f32; 4]>,
    ) {
        seen.clear();
        seen.extend(mesh.vertices.iter().map(to_clip));
        for vertices in &mesh.triangles {
            let corners = vertices.map(|i| seen[i as usize]);
            let depths = corners.map(|c| c[2] * FAR as f32);
            if let Some(triangle) = self.triangle(corners, depths) {
                self.fill(&triangle, 0);
            }
        }
    }

    fn fill_polygon(&mut self, polygon: &[ClipVert<()>], triangle: &ScreenTriangle, facet: u32) {
        let [first, rest @ ..] = polygon else { return };
        let (half_width, half_height) = (0.5 * self.width as f32, 0.5 * self.height as f32);
        let screen = |v: &ClipVert<()>| {
            let [x, y, _, w] = v.pos.0;
            let point: ScreenPt = pt3(half_width * (x / w + 1.0), half_height * (1.0 - y / w), 0.0);
            vertex(point, ())
        };
        for pair in rest.windows(2) {
            let corners = [first, &pair[0], &pair[1]].map(screen);
            tri_fill(corners, |span: Scanline<()>| self.fill_span(&span, triangle, facet));
        }
    }

    fn fill_span(&mut self, span: &Scanline<()>, triangle: &ScreenTriangle, facet: u32) {
        let (mut start, mut end) = (span.xs.start, span.xs.end.min(self.width));
        if span.y >= self.height || start > end {
            return;
        }
        // The ends of a span are summed up line by line; by rounding, both triangles at a shared
        // edge may miss the sample next to it.
        let y = span.y as f32 + 0.5;
        start -= usize::from(start > 0 && triangle.covers(start as f32 - 0.5, y));
        end += usize::from(end < self.width && triangle.covers(end as f32 + 0.5, y));
        let row = span.y * self.width;
        let depths = &mut self.depth[row + start..row + end];
        let facets = &mut self.facet[row + start..row + end];
        let [step, ..] = triangle.depth;
        let left = at(&triangle.depth, start as f32 + 0.5, y);
        for (i, (nearest, shown)) in depths.iter_mut().zip(facets).enumerate() {
            let value = left + step * i as f32;
            let nearer = value > *nearest;
            *nearest = if nearer { value } else { *nearest };
            *shown = if nearer { facet } else { *shown };
        }
    }
}
