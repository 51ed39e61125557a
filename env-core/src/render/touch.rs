//! Drawing of deformed pads and soft objects, coloured by stress, in the scene and from the
//! object's side.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{Color, Finish, Item, PinholeCamera, RenderMesh, Renderer};
use crate::{Error, Result, deformation::Deformation, geometry::Surface, tactile::Shell};

/// Contact state of the pads to be drawn.
#[derive(Clone, Copy, Debug)]
pub struct TouchView<'a> {
    /// Surface of the pads.
    pub shell: &'a Shell,
    /// Solutions of the pad on −x and of the one on +x; `None` without contact.
    pub fingers: [Option<&'a Deformation>; 2],
    /// Von Mises stress of the darkest colour (Pa).
    pub darkest: f64,
}

/// State of a soft object to be drawn.
#[derive(Clone, Copy, Debug)]
pub struct SoftView<'a> {
    /// Surface of the object.
    pub shell: &'a Shell,
    /// Solution of the object; `None` without contact.
    pub felt: Option<&'a Deformation>,
    /// Von Mises stress of the darkest colour (Pa).
    pub darkest: f64,
}

/// Colours (sRGB) from no stress to the highest, evenly spaced: light to dark, as in the reports.
const COLORS: [[u8; 3]; 6] = [
    [252, 243, 205],
    [254, 191, 132],
    [245, 121, 92],
    [197, 60, 117],
    [119, 34, 125],
    [38, 12, 62],
];

/// Colour of a stress, given as a `share` of the stress of the darkest colour.
fn color(share: f64) -> Color {
    let last = COLORS.len() - 1;
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = (place as usize).min(last - 1);
    let [from, to] = [below, below + 1].map(|i| COLORS[i]);
    let mixed = |k: usize| {
        let (from, to) = (f64::from(from[k]), f64::from(to[k]));
        (from + (place - below as f64) * (to - from)) as u8
    };
    Color::srgb(mixed(0), mixed(1), mixed(2))
}

/// Deformed pad or soft object to be drawn, in its own frame.
pub(super) struct TouchedPad {
    mesh: RenderMesh,
    colors: Vec<Color>,
    /// Highest stress at a node (Pa).
    peak: f64,
}

impl TouchedPad {
    /// Creates both pads of `view`.
    pub(super) fn both(view: &TouchView) -> Result<[Self; 2]> {
        let rest = Surface::new("pad", &view.shell.places(None), view.shell.triangles())?;
        let rest = RenderMesh::new(&rest);
        let pad = |felt: Option<&Deformation>| {
            let stress = view.shell.stress(felt);
            Ok::<_, Error>(Self {
                mesh: rest.moved(&view.shell.places(felt))?,
                colors: stress.iter().map(|stress| color(stress / view.darkest)).collect(),
                peak: stress.iter().copied().fold(0.0, f64::max),
            })
        };
        Ok([pad(view.fingers[0])?, pad(view.fingers[1])?])
    }

    /// Creates the object of `view`.
    pub(super) fn object(view: &SoftView) -> Result<Self> {
        let SoftView { shell, felt, darkest } = *view;
        let rest = Surface::new("object", &shell.places(None), shell.triangles())?;
        let stress = shell.stress(felt);
        Ok(Self {
            mesh: RenderMesh::new(&rest).moved(&shell.places(felt))?,
            colors: stress.iter().map(|stress| color(stress / darkest)).collect(),
            peak: stress.iter().copied().fold(0.0, f64::max),
        })
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
/// Smallest width and height of a picture with an inset (pixels).
const SMALLEST: usize = 96;

/// Second view: the more stressed pad, seen from the object, beside the colour scale.
pub(super) struct Inset {
    renderer: Renderer,
    camera: PinholeCamera,
}

impl Inset {
    /// Creates the inset for pictures of `width` × `height` pixels; `None` if they are too small
    /// for it.
    pub(super) fn new(width: usize, height: usize) -> Result<Option<Self>> {
        if width.min(height) < SMALLEST {
            return Ok(None);
        }
        let side = (SHARE * height.min(width) as f64) as usize;
        let camera = PinholeCamera {
            eye: Point3::new(0.008, -0.016, 0.062),
            target: Point3::new(0.0, 0.0, -0.001),
            up: Vector3::y(),
            vertical_fov: 0.46,
        };
        Ok(Some(Self { renderer: Renderer::new(side, side)?, camera }))
    }

    /// Draws the inset into the upper right corner of `picture`, which is `width` pixels wide, if a
    /// pad is under stress.
    pub(super) fn draw(
        &mut self,
        pads: &[TouchedPad; 2],
        picture: &mut [u8],
        width: usize,
    ) -> Result<()> {
        let [first, second] = pads;
        let pad = if second.peak > first.peak { second } else { first };
        if pad.peak <= 0.0 {
            return Ok(());
        }
        let side = self.renderer.size().0;
        let mut inset = self.renderer.draw(&self.camera, &[pad.item(Isometry3::identity())])?;
        paint_bar(&mut inset, side);
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

/// Paints the colour scale along the right edge of a square picture: no stress at the bottom, the
/// darkest colour at the top.
fn paint_bar(picture: &mut [u8], side: usize) {
    let width = ((BAR * side as f64) as usize).max(2);
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
        assert_eq!(color(0.0).bytes(), COLORS[0]);
    }
}
