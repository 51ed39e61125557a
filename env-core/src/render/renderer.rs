//! Drawing of a frame: facets to the visibility buffer, then shadow maps, then the shading of
//! pixels.

use nalgebra::{Isometry3, Matrix3, Vector3};

use super::{
    camera::{FAR, PinholeCamera, View},
    ground::ContactMap,
    mesh::RenderMesh,
    raster::{NOTHING, Plane, Raster, at},
    shade::{Color, Finish, Gamma, KEY, Lights, Seen, background},
    shadow::ShadowMap,
};
use crate::{Error, Result};

/// Body in a picture.
#[derive(Clone, Copy, Debug)]
pub struct Item<'a> {
    /// Triangles, in the body's frame.
    pub mesh: &'a RenderMesh,
    /// Pose of the body's frame in the world (m).
    pub pose: Isometry3<f64>,
    /// Colour of the body if `vertex_colors` is `None`.
    pub color: Color,
    /// Reflection properties.
    pub finish: Finish,
    /// Colour of every vertex of the mesh, interpolated over the triangles.
    pub vertex_colors: Option<&'a [Color]>,
}

impl<'a> Item<'a> {
    /// Creates a satin body of one colour.
    pub fn new(mesh: &'a RenderMesh, pose: Isometry3<f64>, color: Color) -> Self {
        Self { mesh, pose, color, finish: Finish::Satin, vertex_colors: None }
    }

    /// Returns the same body with another finish.
    #[must_use]
    pub fn with_finish(self, finish: Finish) -> Self {
        Self { finish, ..self }
    }

    fn is_ground(&self) -> bool {
        matches!(self.finish, Finish::Ground { .. })
    }
}

/// Renderer of pictures of one size; its buffers are kept from frame to frame.
pub struct Renderer {
    width: usize,
    height: usize,
    /// Samples along each side of a pixel.
    samples: usize,
    raster: Raster,
    facets: Vec<RasterFacet>,
    shadow: ShadowMap,
    contact: ContactMap,
    lights: Lights,
    gamma: Gamma,
    projected: Vec<[f32; 4]>,
}

/// Triangle that faces the eye.
struct RasterFacet {
    /// Planes of λ/w for the corners.
    planes: [Plane; 3],
    item: u32,
    triangle: u32,
}

/// Data for the shading of pixels that all facets share.
struct Frame<'a> {
    items: &'a [Item<'a>],
    rotations: Vec<Matrix3<f32>>,
    eye: Vector3<f32>,
    /// Coefficients of the view ray: through sample position (x, y) it is `ray[0] x + ray[1] y +
    /// ray[2]`.
    ray: [Vector3<f32>; 3],
    /// Width of a pixel at unit distance (m/m).
    pixel: f32,
}

impl Renderer {
    /// Creates a renderer of antialiased pictures (2 × 2 samples per pixel).
    pub fn new(width: usize, height: usize) -> Result<Self> {
        Self::with_samples(width, height, 2)
    }

    /// Creates a renderer with `samples` × `samples` samples per pixel. Returns an error if the
    /// picture is not 16 to 4096 pixels wide and high, or `samples` is not 1 to 4. It holds 8 bytes
    /// per sample.
    pub fn with_samples(width: usize, height: usize, samples: usize) -> Result<Self> {
        for (name, pixels) in [("width", width), ("height", height)] {
            if !(16..=4096).contains(&pixels) {
                return Err(Error::invalid(name, format!("{pixels} pixels"), "16 to 4096 pixels"));
            }
        }
        if !(1..=4).contains(&samples) {
            return Err(Error::invalid("samples", samples, "1 to 4 along each side of a pixel"));
        }
        Ok(Self {
            width,
            height,
            samples,
            raster: Raster::new(samples * width, samples * height),
            facets: Vec::new(),
            shadow: ShadowMap::new(&KEY.into()),
            contact: ContactMap::new(),
            lights: Lights::new(),
            gamma: Gamma::new(),
            projected: Vec::new(),
        })
    }

    /// Width and height (pixels).
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Draws a picture as sRGB bytes (height, width, 3); errors as for [`Renderer::draw_into`].
    pub fn draw(&mut self, camera: &PinholeCamera, items: &[Item]) -> Result<Vec<u8>> {
        let mut picture = vec![0; self.width * self.height * 3];
        self.draw_into(camera, items, &mut picture)?;
        Ok(picture)
    }

    /// Fills `picture`, sRGB bytes (height, width, 3). Returns an error if it has another size, the
    /// camera has no direction, a pose is not finite, or the number of vertex colours is wrong.
    ///
    /// Bodies behind the camera or farther away than 20 m are left out.
    pub fn draw_into(
        &mut self,
        camera: &PinholeCamera,
        items: &[Item],
        picture: &mut [u8],
    ) -> Result<()> {
        let expected = self.width * self.height * 3;
        if picture.len() != expected {
            let found = format!("{} bytes", picture.len());
            return Err(Error::invalid("picture", found, format!("{expected} bytes")));
        }
        items.iter().enumerate().try_for_each(|(i, item)| check(i, item))?;
        let view = camera.view(self.raster.width, self.raster.height)?;
        self.enter_facets(&view, items);
        self.cast_shadows(camera, items);
        let frame = Frame::new(&view, items, self.samples);
        for (y, row) in picture.chunks_exact_mut(3 * self.width).enumerate() {
            let behind = background(y as f32 / self.height as f32);
            let blank = self.gamma.bytes(&behind);
            for (x, bytes) in row.chunks_exact_mut(3).enumerate() {
                bytes.copy_from_slice(&self.pixel(&frame, x, y, &behind, blank));
            }
        }
        Ok(())
    }

    fn enter_facets(&mut self, view: &View, items: &[Item]) {
        self.raster.clear();
        self.facets.clear();
        for (index, item) in items.iter().enumerate() {
            let center = item.pose * item.mesh.center;
            if (center - view.eye).norm() > FAR + item.mesh.radius {
                continue;
            }
            self.projected.clear();
            self.projected.extend(item.mesh.vertices.iter().map(view.clip_from(&item.pose)));
            for (triangle, vertices) in item.mesh.triangles.iter().enumerate() {
                let corners = vertices.map(|i| self.projected[i as usize]);
                // 1/w is the depth value, since the barycentric coordinates add up to one.
                let Some(seen) = self.raster.triangle(corners, [1.0; 3]) else { continue };
                self.raster.fill(&seen, self.facets.len() as u32);
                let (item, triangle) = (index as u32, triangle as u32);
                let facet = RasterFacet { planes: seen.planes, item, triangle };
                self.facets.push(facet);
            }
        }
    }

    fn cast_shadows(&mut self, camera: &PinholeCamera, items: &[Item]) {
        let half_width = 0.75 * (camera.eye - camera.target).norm();
        let top = |item: &Item| {
            let heights = item.mesh.vertices.iter().map(|v| (item.pose * v).z);
            heights.fold(f64::NEG_INFINITY, f64::max)
        };
        let level = items.iter().find(|i| i.is_ground()).map_or(f64::NEG_INFINITY, top);
        self.shadow.begin(camera.target, half_width);
        self.contact.begin(camera.target, half_width, level);
        for item in items.iter().filter(|i| !i.is_ground()) {
            let center = item.pose * item.mesh.center;
            if (center - camera.target).norm() < FAR {
                self.shadow.cast(item.mesh, &item.pose, &mut self.projected);
                self.contact.cast(item.mesh, &item.pose, &mut self.projected);
            }
        }
        self.shadow.finish();
        self.contact.finish();
    }

    /// Bytes of one pixel: the average over its samples, each facet shaded once.
    fn pixel(
        &self,
        frame: &Frame,
        x: usize,
        y: usize,
        behind: &Vector3<f32>,
        blank: [u8; 3],
    ) -> [u8; 3] {
        let n = self.samples;
        let first = y * n * self.raster.width + x * n;
        let rows = (0..n).map(|j| &self.raster.facet[first + j * self.raster.width..][..n]);
        let id = self.raster.facet[first];
        let (left, top) = ((x * n) as f32, (y * n) as f32);
        if rows.clone().all(|row| row.iter().all(|&other| other == id)) {
            if id == NOTHING {
                return blank;
            }
            let middle = 0.5 * n as f32;
            return self.gamma.bytes(&self.light(frame, id, left + middle, top + middle));
        }
        let here = rows.flatten();
        let mut sum = Vector3::zeros();
        for (k, &id) in here.clone().enumerate() {
            if here.clone().take(k).any(|&earlier| earlier == id) {
                continue;
            }
            let (mut count, mut dx, mut dy) = (0.0, 0.0, 0.0);
            for (l, _) in here.clone().enumerate().filter(|&(_, &other)| other == id) {
                count += 1.0;
                dx += (l % n) as f32 + 0.5;
                dy += (l / n) as f32 + 0.5;
            }
            let light = match id {
                NOTHING => *behind,
                _ => self.light(frame, id, left + dx / count, top + dy / count),
            };
            // Light above white counts as white; otherwise highlights would have jagged edges.
            sum += light.map(|x| x.min(1.0)) * count;
        }
        self.gamma.bytes(&(sum / (n * n) as f32))
    }

    /// Light that facet `id` sends to the eye at sample position (x, y).
    fn light(&self, frame: &Frame, id: u32, x: f32, y: f32) -> Vector3<f32> {
        let facet = &self.facets[id as usize];
        let item = &frame.items[facet.item as usize];
        let weights = facet.planes.map(|plane| at(&plane, x, y));
        let distance = 1.0 / weights.iter().sum::<f32>();
        let weights = weights.map(|w| w * distance);
        let [a, b, c] = &item.mesh.normals[facet.triangle as usize];
        let local = a * weights[0] + b * weights[1] + c * weights[2];
        let normal = (frame.rotations[facet.item as usize] * local).normalize();
        let ray = frame.ray[0] * x + frame.ray[1] * y + frame.ray[2];
        let position = frame.eye + ray * distance;
        let occlusion = if item.is_ground() { self.contact.at(&position) } else { 0.0 };
        let seen = Seen {
            position,
            normal,
            to_eye: -ray.normalize(),
            pixel: frame.pixel * distance,
            color: item.vertex_colors.map_or(item.color, |colors| {
                blend(colors, &item.mesh.triangles[facet.triangle as usize], &weights)
            }),
            finish: item.finish,
            occlusion,
        };
        let reached = self.lights.key_reaches(&normal);
        let lit = if reached { self.shadow.light_at(&position, &normal) } else { 0.0 };
        self.lights.shade(&seen, lit)
    }
}

impl<'a> Frame<'a> {
    fn new(view: &View, items: &'a [Item<'a>], samples: usize) -> Self {
        let rotation = |i: &Item| i.pose.rotation.to_rotation_matrix().matrix().cast::<f32>();
        let origin = view.ray(0.0, 0.0);
        Self {
            items,
            rotations: items.iter().map(rotation).collect(),
            eye: view.eye.coords.cast(),
            ray: [view.ray(1.0, 0.0) - origin, view.ray(0.0, 1.0) - origin, origin]
                .map(Vector3::cast),
            pixel: (samples as f64 * view.sample_size()) as f32,
        }
    }
}

fn blend(colors: &[Color], triangle: &[u32; 3], weights: &[f32; 3]) -> Color {
    let corners = triangle.map(|i| colors[i as usize].0);
    Color([0, 1, 2].map(|k| (0..3).map(|i| weights[i] * corners[i][k]).sum()))
}

fn check(index: usize, item: &Item) -> Result<()> {
    let pose = &item.pose;
    let rotation = pose.rotation.coords.iter();
    if !pose.translation.vector.iter().chain(rotation).all(|x| x.is_finite()) {
        return Err(Error::invalid(format!("pose of item {index}"), pose, "finite numbers"));
    }
    let (colors, vertices) = (item.vertex_colors.map(<[Color]>::len), item.mesh.vertex_count());
    if colors.is_some_and(|count| count != vertices) {
        let found = format!("{} colours", colors.unwrap_or(0));
        let name = format!("vertex_colors of item {index}");
        return Err(Error::invalid(name, found, format!("{vertices}, one a vertex")));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
