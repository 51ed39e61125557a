//! Meshes of a parallel-jaw gripper and a table, for pictures.
//!
//! The tool frame has its origin midway between the pad faces, with z towards the wrist; the
//! fingers close along x. A finger's own frame has its origin at the centre of its pad's face, and
//! the finger extends towards +x; the opposite finger is the same one turned by 180° about z.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{Color, Finish, Item, RenderMesh};
use crate::geometry::Surface;

/// Half-extents of the pad: thickness, width, length (m).
const PAD: [f64; 3] = [0.002, 0.010_375, 0.012_625];
/// Height of the centre of a pad's face above its rim (m).
const DOME: f64 = 0.0007;

/// Meshes of a parallel-jaw gripper of 80 mm stroke.
#[derive(Clone, Debug)]
pub struct GripperParts {
    /// Housing with the wrist, in the tool frame.
    pub palm: RenderMesh,
    /// Rail under the housing and ring on the wrist, in the tool frame.
    pub trim: RenderMesh,
    /// Finger, in the finger frame.
    pub finger: RenderMesh,
    /// Slide and pad holder, in the finger frame.
    pub holder: RenderMesh,
    /// Soft pad of 4 × 20.75 × 25.25 mm, in the finger frame.
    pub pad: RenderMesh,
}

impl Default for GripperParts {
    fn default() -> Self {
        let block = |x: [f64; 2], y: f64, z: [f64; 2], corner: f64, bevel: f64| RoundedBox {
            center: Vector3::new(0.5 * (x[0] + x[1]), 0.0, 0.5 * (z[0] + z[1])),
            half: Vector3::new(0.5 * (x[1] - x[0]), y, 0.5 * (z[1] - z[0])),
            corner,
            bevel,
        };
        let palm = [
            block([-0.070, 0.070], 0.024, [0.081, 0.112], 0.010, 0.0025),
            block([-0.029, 0.029], 0.029, [0.110, 0.150], 0.029, 0.002),
        ];
        let trim = [
            block([-0.064, 0.064], 0.0105, [0.074, 0.083], 0.003, 0.001),
            block([-0.0305, 0.0305], 0.0305, [0.121, 0.128], 0.0305, 0.001),
        ];
        let finger = [block([0.0072, 0.0170], 0.0085, [-0.0125, 0.0640], 0.002, 0.0015)];
        let holder = [
            block([0.0036, 0.0090], 0.0112, [-0.0135, 0.0135], 0.0015, 0.0010),
            block([0.0010, 0.0230], 0.0150, [0.0620, 0.0785], 0.003, 0.0015),
        ];
        Self {
            palm: joined(&palm),
            trim: joined(&trim),
            finger: joined(&finger),
            holder: joined(&holder),
            pad: pad(),
        }
    }
}

impl GripperParts {
    /// Eight items of a gripper with its tool frame at `tool` and its pad faces at x = −`jaws[0]`
    /// and x = `jaws[1]` (m).
    pub fn items(&self, tool: &Isometry3<f64>, jaws: [f64; 2]) -> Vec<Item<'_>> {
        let mut items = self.rigid_items(tool, jaws);
        let color = Color::srgb(240, 122, 72);
        items.extend(finger_frames(tool, jaws).map(|frame| Item::new(&self.pad, frame, color)));
        items
    }

    /// Items of [`GripperParts::items`] without the two pads.
    pub fn rigid_items(&self, tool: &Isometry3<f64>, jaws: [f64; 2]) -> Vec<Item<'_>> {
        let shell = Color::srgb(212, 215, 220);
        let dark = Color::srgb(62, 68, 77);
        let mut items = vec![
            Item::new(&self.palm, *tool, shell).with_finish(Finish::Glossy),
            Item::new(&self.trim, *tool, dark),
        ];
        for frame in finger_frames(tool, jaws) {
            items.extend([
                Item::new(&self.finger, frame, Color::srgb(168, 175, 184))
                    .with_finish(Finish::Metal),
                Item::new(&self.holder, frame, dark),
            ]);
        }
        items
    }
}

/// Frames of the finger at −x and of the one at +x, with their pad faces at distances `jaws` (m)
/// from the middle.
fn finger_frames(tool: &Isometry3<f64>, jaws: [f64; 2]) -> [Isometry3<f64>; 2] {
    let half_turn = Vector3::z() * std::f64::consts::PI;
    [
        tool * Isometry3::new(Vector3::x() * -jaws[0], half_turn),
        tool * Isometry3::translation(jaws[1], 0.0, 0.0),
    ]
}

/// Creates a table of 0.5 × 0.5 m, 12 mm thick, with its top at z = 0.
pub fn table() -> RenderMesh {
    let half = Vector3::new(0.25, 0.25, 0.006);
    joined(&[RoundedBox { center: Vector3::z() * -0.006, half, corner: 0.012, bevel: 0.0015 }])
}

/// Box with rounded upright edges and bevelled rims.
struct RoundedBox {
    center: Vector3<f64>,
    half: Vector3<f64>,
    /// Radius of the upright edges (m).
    corner: f64,
    /// Radius of all other edges (m), at most `corner`.
    bevel: f64,
}

impl RoundedBox {
    /// Outlines from bottom to top, each as (inset (m), height (m)).
    fn rings(&self) -> Vec<[f64; 2]> {
        let arc = |side: f64| {
            quarter(3).into_iter().map(move |[cos, sin]| {
                [self.bevel * (1.0 - cos), side * (self.half.z - self.bevel * (1.0 - sin))]
            })
        };
        arc(-1.0).rev().chain(arc(1.0)).collect()
    }

    /// Outline at `inset` (m), counter-clockwise from the side of +x.
    fn outline(&self, inset: f64) -> Vec<[f64; 2]> {
        let radius = self.corner - inset;
        let (x, y) = (self.half.x - self.corner, self.half.y - self.corner);
        let quarter = quarter(if self.corner < 0.005 { 3 } else { 9 });
        let turned = |turn: usize| {
            quarter.iter().map(move |&[cos, sin]| match turn {
                0 => [x + radius * cos, y + radius * sin],
                1 => [-x - radius * sin, y + radius * cos],
                2 => [-x - radius * cos, -y - radius * sin],
                _ => [x + radius * sin, -y - radius * cos],
            })
        };
        (0..4).flat_map(turned).collect()
    }

    /// Outlines from bottom to top (m).
    fn outlines(&self) -> Vec<Vec<Point3<f64>>> {
        let lifted = |[inset, z]: [f64; 2]| {
            let point = |[x, y]: [f64; 2]| Point3::from(self.center + Vector3::new(x, y, z));
            self.outline(inset).into_iter().map(point).collect()
        };
        self.rings().into_iter().map(lifted).collect()
    }
}

/// Closed surface over outlines of equal length, from bottom to top. Points may coincide.
fn lofted(outlines: &[Vec<Point3<f64>>]) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let around = outlines[0].len() as u32;
    let top = around * (outlines.len() as u32 - 1);
    let mut triangles = Vec::new();
    for first in (0..top).step_by(around as usize) {
        for j in 0..around {
            let [a, b] = [first + j, first + (j + 1) % around];
            triangles.extend([[a, b, b + around], [a, b + around, a + around]]);
        }
    }
    for j in 1..around - 1 {
        triangles.extend([[0, j + 1, j], [top, top + j, top + j + 1]]);
    }
    (outlines.concat(), triangles)
}

/// Cosines and sines from 0 to a right angle, exact at both ends.
fn quarter(steps: u32) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = (0..=steps)
        .map(|i| (std::f64::consts::FRAC_PI_2 * f64::from(i) / f64::from(steps)).sin_cos())
        .map(|(sin, cos)| [cos, sin])
        .collect();
    points[steps as usize] = [0.0, 1.0];
    points
}

fn joined(blocks: &[RoundedBox]) -> RenderMesh {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for block in blocks {
        let (points, corners) = lofted(&block.outlines());
        let first = vertices.len() as u32;
        triangles.extend(corners.iter().map(|t| t.map(|i| i + first)));
        vertices.extend(points);
    }
    mesh(&vertices, &triangles)
}

/// Creates the pad: a bevelled block whose face is a shallow dome with its top at x = 0.
fn pad() -> RenderMesh {
    let [thickness, width, length] = PAD;
    // Built upright, its face towards +z, and turned at the end; the dome adds the thickness that
    // the block lacks.
    let half = Vector3::new(length, width, thickness - 0.5 * DOME);
    let block = RoundedBox { center: Vector3::zeros(), half, corner: 0.002, bevel: 0.0008 };
    let mut outlines = block.outlines();
    let rim = outlines[outlines.len() - 1].clone();
    for scale in [0.85, 0.7, 0.5, 0.3, 0.1] {
        let inner = |p: &Point3<f64>| {
            let [x, y] = [scale * p.x, scale * p.y];
            let rise = (1.0 - (x / rim[0].x).powi(2)) * (1.0 - (y / width).powi(2));
            Point3::new(x, y, p.z + DOME * rise)
        };
        outlines.push(rim.iter().map(inner).collect());
    }
    let (upright, triangles) = lofted(&outlines);
    let turned = |v: &Point3<f64>| Point3::new(thickness + 0.5 * DOME - v.z, v.y, v.x);
    mesh(&upright.iter().map(turned).collect::<Vec<_>>(), &triangles)
}

fn mesh(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> RenderMesh {
    let surface = Surface::new("gripper part", vertices, triangles);
    RenderMesh::new(&surface.expect("blocks are closed and have volume"))
}
