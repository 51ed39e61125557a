//! Drawing of deformed pads and soft objects, coloured by stress, in the scene and from where they
//! are touched.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Point3, Vector3};

use super::{Color, Finish, Item, PinholeCamera, RenderMesh, Renderer, font};
use crate::{Result, deformation::Deformation, tactile::Shell};

/// Soft bodies to be drawn.
#[derive(Clone, Copy, Debug)]
pub struct DeformationView<'a> {
    /// Surface of a body.
    pub shell: &'a Shell,
    /// The bodies with their solutions.
    pub bodies: DeformedBodies<'a>,
    /// Von Mises stress of the darkest colour (Pa).
    pub darkest: f64,
}

/// Bodies with their solutions; `None` without contact.
#[derive(Clone, Copy, Debug)]
pub enum DeformedBodies<'a> {
    /// The pad on −x and the one on +x.
    Pads([Option<&'a Deformation>; 2]),
    /// The object.
    Object(Option<&'a Deformation>),
}

/// Colours (sRGB) from no stress to the highest, evenly spaced: light to dark, as in the reports.
pub const STRESS_COLORS: [[u8; 3]; 6] = [
    [252, 243, 205],
    [254, 191, 132],
    [245, 121, 92],
    [197, 60, 117],
    [119, 34, 125],
    [38, 12, 62],
];

/// Colour of a stress, given as a `share` of the stress of the darkest colour.
fn color(share: f64) -> Color {
    let last = STRESS_COLORS.len() - 1;
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = (place as usize).min(last - 1);
    let [from, to] = [below, below + 1].map(|i| STRESS_COLORS[i]);
    let mixed = |k: usize| {
        let (from, to) = (f64::from(from[k]), f64::from(to[k]));
        (from + (place - below as f64) * (to - from)) as u8
    };
    Color::srgb(mixed(0), mixed(1), mixed(2))
}

/// Deformed pad or soft object to be drawn, in its own frame.
pub(super) struct StressedBody {
    mesh: RenderMesh,
    colors: Vec<Color>,
    /// Highest stress at a node (Pa).
    pub(super) peak: f64,
    /// Stress of the darkest colour (Pa).
    darkest: f64,
}

impl StressedBody {
    /// Creates the bodies of `view`: both pads, or the object.
    pub(super) fn all(view: &DeformationView) -> Result<Vec<Self>> {
        let DeformationView { shell, bodies, darkest } = *view;
        let body = |deformation: Option<&Deformation>| {
            let stress = shell.stress(deformation);
            Ok(Self {
                mesh: RenderMesh::deformed(shell.places(deformation), shell.triangles())?,
                colors: stress.iter().map(|stress| color(stress / darkest)).collect(),
                peak: stress.iter().copied().fold(0.0, f64::max),
                darkest,
            })
        };
        match bodies {
            DeformedBodies::Pads(deformation) => deformation.into_iter().map(body).collect(),
            DeformedBodies::Object(deformation) => Ok(vec![body(deformation)?]),
        }
    }

    /// Item of the body with its frame at `pose`.
    pub(super) fn item(&self, pose: Isometry3<f64>) -> Item<'_> {
        let item = Item::new(&self.mesh, pose, color(0.0)).with_finish(Finish::Matte);
        Item { vertex_colors: Some(&self.colors), ..item }
    }
}

/// Distance between the inset and the picture's edge (`MARGIN`), and width of its frame (`FRAME`),
/// in pixels.
const MARGIN: usize = 6;
const FRAME: usize = 2;
/// Size of the inset relative to the shorter side of the picture (`SHARE`), and width of the colour
/// bar relative to the inset (`BAR`).
const SHARE: f64 = 0.36;
const BAR: f64 = 0.06;
/// Smallest width and height of a picture with an inset, and smallest width of an inset with
/// numbers (pixels).
const SMALLEST: usize = 96;
const SMALLEST_NUMBERED: usize = 64;
/// Vertical field of view of the inset (rad).
const FIELD_OF_VIEW: f64 = 0.46;

/// Second view: the more stressed pad or the soft object, beside the colour scale.
pub(super) struct Inset {
    renderer: Renderer,
}

impl Inset {
    /// Creates the inset for pictures of `width` × `height` pixels; `None` if they are too small
    /// for it.
    pub(super) fn new(width: usize, height: usize) -> Result<Option<Self>> {
        if width.min(height) < SMALLEST {
            return Ok(None);
        }
        let side = (SHARE * height.min(width) as f64) as usize;
        Ok(Some(Self { renderer: Renderer::new(side, side)? }))
    }

    /// Draws `body` into the upper right corner of `picture`, which is `width` pixels wide: a soft
    /// object, which is at `object` in the hand, from the finger on −x, a pad from the object.
    pub(super) fn draw(
        &mut self,
        body: &StressedBody,
        object: Option<Isometry3<f64>>,
        picture: &mut [u8],
        width: usize,
    ) -> Result<()> {
        let side = self.renderer.size().0;
        // A quarter turn brings the side of −x to the front, into the light.
        let quarter_turn = Isometry3::rotation(Vector3::z() * FRAC_PI_2);
        let pose = object.map_or_else(Isometry3::identity, |object| quarter_turn * object);
        let camera = match object {
            Some(_) => in_front_of_object(&body.mesh, &pose),
            None => in_front_of_pad(),
        };
        let mut inset = self.renderer.draw(&camera, &[body.item(pose)])?;
        paint_bar(&mut inset, side);
        if side >= SMALLEST_NUMBERED {
            write_numbers(&mut inset, side, &upper_end(body.peak, body.darkest));
        }
        let whole = side + 2 * FRAME;
        let left = width - MARGIN - whole;
        for y in 0..whole {
            let row = &mut picture[3 * ((MARGIN + y) * width + left)..][..3 * whole];
            row.fill(90);
            if (FRAME..FRAME + side).contains(&y) {
                let from = &inset[3 * (y - FRAME) * side..][..3 * side];
                row[3 * FRAME..3 * (FRAME + side)].copy_from_slice(from);
            }
        }
        Ok(())
    }
}

fn in_front_of_pad() -> PinholeCamera {
    PinholeCamera {
        eye: Point3::new(0.008, -0.016, 0.062),
        target: Point3::new(0.0, 0.0, -0.001),
        up: Vector3::y(),
        vertical_fov: FIELD_OF_VIEW,
    }
}

fn in_front_of_object(mesh: &RenderMesh, pose: &Isometry3<f64>) -> PinholeCamera {
    let radius = mesh.vertices.iter().map(|v| (v - mesh.center).norm()).fold(0.0, f64::max);
    let target = pose * mesh.center;
    let direction = Vector3::new(0.3, -0.9, 0.3).normalize();
    let eye = target + direction * (radius / (0.36 * FIELD_OF_VIEW).sin());
    PinholeCamera { eye, target, up: Vector3::z(), vertical_fov: FIELD_OF_VIEW }
}

/// Number at the upper end of the colour scale, with `>` where the `peak` of stress is above it.
fn upper_end(peak: f64, darkest: f64) -> String {
    let above = if peak > darkest { ">" } else { "" };
    format!("{above}{}", font::stress(darkest))
}

/// Writes the ends of the colour scale beside it.
fn write_numbers(picture: &mut [u8], side: usize, upper_end: &str) {
    let scale = (side / 80).max(1);
    let [right, bottom] = [side - bar_width(side), side].map(|end| end - 2 * scale);
    for (text, is_top) in [(upper_end, true), ("0", false)] {
        let [width, height] = font::size(text, scale);
        let top = if is_top { 2 * scale } else { bottom - height };
        font::write(picture, side, text, scale, [right.saturating_sub(width), top]);
    }
}

fn bar_width(side: usize) -> usize {
    ((BAR * side as f64) as usize).max(2)
}

/// Paints the colour scale along the right edge of a square picture: no stress at the bottom, the
/// darkest colour at the top.
fn paint_bar(picture: &mut [u8], side: usize) {
    let width = bar_width(side);
    for y in 0..side {
        let share = 1.0 - y as f64 / (side - 1) as f64;
        let bytes = color(share).bytes();
        for x in side - width..side {
            picture[3 * (y * side + x)..][..3].copy_from_slice(&bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_darken_with_stress() {
        let light = |share: f64| color(share).bytes().iter().map(|&x| u32::from(x)).sum::<u32>();
        for step in 0..20 {
            let [less, more] = [step, step + 1].map(|i| light(0.05 * f64::from(i)));
            assert!(more < less, "{more} after {less} at step {step}");
        }
        assert_eq!(color(7.0), color(1.0));
        assert_eq!(color(0.0).bytes(), STRESS_COLORS[0]);
    }

    #[test]
    fn the_scale_says_that_stress_is_above_its_end() {
        assert_eq!(upper_end(60e3, 60e3), "60 kPa");
        assert_eq!(upper_end(61e3, 60e3), ">60 kPa");
    }

    #[test]
    fn the_longest_number_fits_beside_the_bar_of_every_inset() {
        for side in SMALLEST_NUMBERED..400 {
            let [width, _] = font::size(&upper_end(2e6, 43.68e3), (side / 80).max(1));
            assert!(width + bar_width(side) + 2 <= side, "{width} of {side} pixels");
        }
    }
}
