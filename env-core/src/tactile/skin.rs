//! Surface of a pad, with the weights that interpolate fields of its mesh to markers and maps.
//!
//! Shapes: V nodes of the mesh, T tetrahedra, S free surface nodes, M markers, G cells of the grid,
//! D pixels of the depth map. Grids run across (x) fastest, from the corner of least x and y.

use std::{cell::OnceCell, collections::BTreeMap};

use nalgebra::{Point3, Vector3};

use super::{
    Resolution, Shell, depth,
    face::{Face, FacePoint, PlanGrid},
    image::TactileCamera,
    imprint::{FaceView, RaisedFace},
};
use crate::{
    Error, Result,
    deformation::{Deformation, Moduli, SoftBody},
    geometry::{Shape, TetMesh, under},
    sensor::Sensor,
};

/// Deformation of the pads of both fingers, and the surface that they share.
#[derive(Clone, Copy, Debug)]
pub struct PadDeformations<'a> {
    /// Surface of the pads.
    pub skin: &'a Skin,
    /// Solution of the finger on −x and of the one on +x; `None` without contact.
    pub fingers: [Option<&'a Deformation>; 2],
    /// Shapes that the pads can touch, each in its own frame.
    pub bodies: &'a [Shape],
    /// Numbers of the bodies in the press of each finger.
    pub pressed: [&'a [usize]; 2],
    /// Faces near contact, computed by the first channel that needs them.
    pub(crate) raised: &'a [OnceCell<RaisedFace>; 2],
}

impl<'a> PadDeformations<'a> {
    /// Shapes in the press of a finger, in the order of its solution.
    pub fn shapes(&self, finger: usize) -> Vec<&'a Shape> {
        self.pressed[finger].iter().filter_map(|&body| self.bodies.get(body)).collect()
    }

    /// Highest von Mises stress in any tetrahedron of both pads (Pa), 0 without contact.
    pub fn peak_stress(&self) -> f64 {
        peak_stress(self.fingers.iter().flatten().copied())
    }
}

/// Highest von Mises stress in any tetrahedron of the `answers` (Pa), 0 without any.
pub fn peak_stress<'a>(answers: impl Iterator<Item = &'a Deformation>) -> f64 {
    answers.flat_map(|answer| &answer.von_mises).copied().fold(0.0, f64::max)
}

/// Surface of a pad at rest, with precomputed interpolation weights.
#[derive(Debug)]
pub struct Skin {
    /// Nodes and triangles of the face.
    pub(super) face: Face,
    /// Tetrahedra (T).
    pub(super) tets: usize,
    /// Elastic moduli of the gel.
    pub(super) moduli: Moduli,
    /// Nodes of the surface that are free to move (S), ascending.
    pub(super) free: Vec<u32>,
    /// Nodes of the whole surface, each with an upper bound of its distance from the surface points
    /// to which it is the nearest node (m).
    reach: Vec<(u32, f64)>,
    /// Upper bound of the distance of the surface from the apex (m).
    radius: f64,
    /// Whole surface, for rendering.
    shell: Shell,
    /// Markers (M).
    pub(super) markers: Vec<FacePoint>,
    /// Tetrahedra that contribute to the stress of each cell (G), with weights that sum to 1.
    pub(super) stress: Vec<Vec<(u32, f64)>>,
    pub(super) grid: PlanGrid,
    pub(super) view: FaceView,
    pub(super) picture: PlanGrid,
    /// Heights of the resting face at the pixels (D) in m.
    pub(super) rest_depth: Vec<f64>,
    /// Camera of the tactile image, if the sensor's colours are known.
    pub(super) camera: Option<TactileCamera>,
    pub(super) resolution: Resolution,
}

impl Skin {
    /// Prepares the surface of a pad, `body`, with the markers and the camera of `sensor`; returns
    /// an error if that is of another pad, or if markers, cells or pixels lie beyond the face.
    pub fn new(body: &SoftBody, sensor: &Sensor, resolution: &Resolution) -> Result<Self> {
        let mesh = body.mesh();
        let triangles = sensor.outline.face_of(mesh);
        if triangles.is_empty() {
            let expected = format!("the pad of {}", sensor.name);
            return Err(Error::invalid("body", "another one", expected));
        }
        let places = mesh.vertices.clone();
        let boundary = mesh.boundary();
        let reach = reach(&places, &boundary);
        let away = reach.iter().map(|&(node, reach)| places[node as usize].coords.norm() + reach);
        let radius = away.fold(0.0, f64::max);
        let fixed = body.fixed();
        let free = reach.iter().map(|&(node, _)| node).filter(|n| fixed.binary_search(n).is_err());
        let free = free.collect();
        let find = |name: &str, place| face_point(sensor, (mesh, &triangles), name, place);
        let view = view(sensor);
        let camera = PlanGrid::filling(view, resolution.depth);
        let printed = sensor.markers.as_ref().map_or(view, |markers| {
            [markers.across, markers.along].map(|count| markers.pitch * f64::from(count - 1))
        });
        let markers = lattice(printed, resolution.markers).map(|place| find("markers", place));
        let markers = markers.collect::<Result<_>>()?;
        let outline = &sensor.outline;
        let grid = PlanGrid::filling([outline.width, outline.length], resolution.grid);
        let shares = nodal_shares(mesh);
        let stress = grid.centres().map(|place| Ok(spread(&find("grid", place)?, &shares)));
        let stress = stress.collect::<Result<_>>()?;
        let picture = PlanGrid::filling(view, resolution.image);
        for pixels in [&camera, &picture] {
            find("camera", [0, 1].map(|axis| pixels.centre(axis, 0)))?;
            find("camera", [0, 1].map(|axis| pixels.centre(axis, pixels.counts[axis] - 1)))?;
        }
        let shell = Shell::new(&places, &boundary, &shares);
        let face = Face { places, triangles, outline: *outline };
        let image = sensor.camera.image.as_ref();
        let moduli = body.moduli()[0];
        Ok(Self {
            rest_depth: depth::heights(&face, &camera, None),
            camera: image.map(|response| {
                TactileCamera::new(&face, FaceView::new(picture, moduli), response)
            }),
            face,
            shell,
            tets: mesh.tets.len(),
            moduli,
            free,
            reach,
            radius,
            markers,
            stress,
            grid,
            view: FaceView::new(camera, moduli),
            picture,
            resolution: resolution.clone(),
        })
    }

    /// Young's modulus of the gel (Pa).
    pub fn young(&self) -> f64 {
        self.moduli.young
    }

    /// Whole surface, for rendering.
    pub fn shell(&self) -> &Shell {
        &self.shell
    }

    /// Rest positions of the surface nodes that the displacement channel lists (S) in m.
    pub fn surface(&self) -> Vec<Point3<f64>> {
        self.free.iter().map(|&node| self.face.places[node as usize]).collect()
    }

    /// Rest positions of the markers (M) in m.
    pub fn markers(&self) -> Vec<Point3<f64>> {
        let at = |(corners, shares): &FacePoint| {
            let sum = |i: usize| self.face.places[corners[i] as usize].coords * shares[i];
            Point3::from((0..3).map(sum).sum::<Vector3<f64>>())
        };
        self.markers.iter().map(at).collect()
    }

    /// Centres of the cells of the stress and traction maps (G), x and y in m.
    pub fn cells(&self) -> Vec<[f64; 2]> {
        self.grid.centres().collect()
    }

    /// Area of a cell of the stress and traction maps (m²).
    pub fn cell_area(&self) -> f64 {
        self.grid.cell[0] * self.grid.cell[1]
    }

    /// Centres of the pixels of the depth map (D), x and y in m.
    pub fn pixels(&self) -> Vec<[f64; 2]> {
        self.view.grid.centres().collect()
    }

    /// Centres of the pixels of the tactile image (P), x and y in m.
    pub fn image_pixels(&self) -> Vec<[f64; 2]> {
        self.picture.centres().collect()
    }

    /// Returns whether the sensor's tactile image can be computed.
    pub fn has_image(&self) -> bool {
        self.camera.is_some()
    }

    /// Returns whether a solid may overlap the resting pad; `distance` returns the distance of a
    /// point from the solid (m). Conservative: `false` is never wrong.
    pub(super) fn may_touch(&self, distance: impl Fn(&Point3<f64>) -> f64) -> bool {
        distance(&Point3::origin()) <= self.radius
            && self
                .reach
                .iter()
                .any(|&(node, reach)| distance(&self.face.places[node as usize]) <= reach)
    }
}

/// Point of the face, `triangles` of `mesh`, at (x, y) in plan (m). Returns an error if there is
/// none; it names the part of the sensor, `name`, that needs the point.
fn face_point(
    sensor: &Sensor,
    (mesh, triangles): (&TetMesh, &[[u32; 3]]),
    name: &str,
    [x, y]: [f64; 2],
) -> Result<FacePoint> {
    under(&mesh.vertices, triangles, x, y).ok_or_else(|| {
        let found = format!("({x:.4}, {y:.4}) m");
        let expected = match name {
            "markers" => {
                "places on the face: a smaller pitch, fewer across or along, or no [markers] in \
                 its file"
            }
            _ => "places on the face",
        };
        Error::invalid(format!("{name} of {}", sensor.name), found, expected)
    })
}

/// Extent of the camera's view on the face (m).
fn view(sensor: &Sensor) -> [f64; 2] {
    let outline = [sensor.outline.width, sensor.outline.length];
    let seen = |axis: usize| f64::from(sensor.camera.pixels[axis]) * sensor.camera.pixel;
    [0, 1].map(|axis| f64::min(seen(axis), outline[axis]))
}

/// `counts` evenly spaced points on a centred rectangle of `extent` (m), its edges included.
fn lattice(extent: [f64; 2], counts: [u32; 2]) -> impl Iterator<Item = [f64; 2]> {
    let along = move |axis: usize, i: u32| {
        let intervals = f64::from(counts[axis].max(2) - 1);
        let middle = 0.5 * f64::from(counts[axis] - 1);
        extent[axis] * (f64::from(i) - middle) / intervals
    };
    (0..counts[1]).flat_map(move |j| (0..counts[0]).map(move |i| [along(0, i), along(1, j)]))
}

/// Nodes of the `boundary`, ascending, each with an upper bound of its distance from the surface
/// points to which it is the nearest node (m). The bound is 1/√3 of the longest edge around the
/// node: the circumradius of a triangle that is not obtuse is at most that, and in an obtuse
/// triangle half of the longest edge is enough.
fn reach(places: &[Point3<f64>], boundary: &[[u32; 3]]) -> Vec<(u32, f64)> {
    let mut reach = BTreeMap::new();
    for triangle in boundary {
        let [a, b, c] = triangle.map(|node| places[node as usize]);
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        for &node in triangle {
            let most: &mut f64 = reach.entry(node).or_default();
            *most = most.max(longest / 3f64.sqrt());
        }
    }
    reach.into_iter().collect()
}

/// Tetrahedra around each node, with their shares of the volume (V).
fn nodal_shares(mesh: &TetMesh) -> Vec<Vec<(u32, f64)>> {
    let around = mesh.tets_of_vertices();
    let of = |node: usize| {
        let tets = around.of(node as u32);
        let volumes = tets.iter().map(|&tet| mesh.tet_volume(tet as usize));
        let volume: f64 = volumes.clone().sum();
        tets.iter().copied().zip(volumes.map(|v| v / volume)).collect()
    };
    (0..mesh.vertices.len()).map(of).collect()
}

/// Weights of the tetrahedra in the value at a site of a field given on them: the field is averaged
/// at the nodes, then interpolated.
fn spread((corners, weights): &FacePoint, shares: &[Vec<(u32, f64)>]) -> Vec<(u32, f64)> {
    let mut sum = BTreeMap::new();
    for (&node, weight) in corners.iter().zip(weights) {
        for &(tet, share) in &shares[node as usize] {
            *sum.entry(tet).or_default() += weight * share;
        }
    }
    sum.into_iter().collect()
}
