//! Shading: the light that a point of a surface sends to the eye, in linear light.
//!
//! The lights are ambient light from a hemisphere, a warm key light, which casts shadows, and a
//! cool fill light without shadow. Key and fill light have a Lambert and a Blinn–Phong term.

use nalgebra::Vector3;

/// Colour in linear light, each channel in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Color(pub [f32; 3]);

/// Reflection properties of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Finish {
    /// No highlight.
    Matte,
    /// Wide, faint highlight.
    Satin,
    /// Narrow, bright highlight.
    Glossy,
    /// Highlight in the colour of the surface, little else.
    Metal,
    /// Floor or table top: matte, with grid lines on its upper side; it receives shadows and casts
    /// none.
    Ground {
        /// Distance between grid lines (m).
        spacing: f64,
    },
}

/// Direction towards the key light; not normalised.
pub(super) const KEY: [f64; 3] = [-0.30, -0.85, 1.0];
const KEY_LIGHT: [f32; 3] = [0.95, 0.92, 0.86];
const FILL: [f32; 3] = [0.86, 0.05, 0.50];
const FILL_LIGHT: [f32; 3] = [0.17, 0.19, 0.23];
/// Ambient light from above (`SKY`) and from below (`FLOOR`).
const SKY: [f32; 3] = [0.30, 0.32, 0.35];
const FLOOR: [f32; 3] = [0.15, 0.14, 0.13];
/// Background colours at the top and at the bottom of a picture (sRGB).
const BACKGROUND: [[u8; 3]; 2] = [[222, 228, 234], [246, 247, 248]];
/// Half width of a grid line (m).
const LINE: f32 = 0.000_45;
/// Relative darkening of the ground on a grid line (`LIGHT`) and on every fifth one (`HEAVY`).
const LIGHT: f32 = 0.10;
const HEAVY: f32 = 0.26;

impl Color {
    /// Converts sRGB bytes to linear light.
    pub fn srgb(red: u8, green: u8, blue: u8) -> Self {
        Self([red, green, blue].map(|byte| {
            let v = f32::from(byte) / 255.0;
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        }))
    }

    /// Converts the colour to sRGB bytes.
    pub(super) fn bytes(self) -> [u8; 3] {
        self.0.map(encode)
    }

    fn vector(self) -> Vector3<f32> {
        self.0.into()
    }
}

/// Table that converts linear light to sRGB bytes.
pub(super) struct Gamma(Box<[u8; 4096]>);

impl Gamma {
    const STEPS: f32 = 4095.0;

    pub(super) fn new() -> Self {
        Self(Box::new(std::array::from_fn(|i| encode(i as f32 / Self::STEPS))))
    }

    pub(super) fn bytes(&self, light: &Vector3<f32>) -> [u8; 3] {
        let byte = |x: f32| self.0[(x.clamp(0.0, 1.0) * Self::STEPS + 0.5) as i32 as usize & 4095];
        [byte(light.x), byte(light.y), byte(light.z)]
    }
}

fn encode(v: f32) -> u8 {
    let v = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (255.0 * v + 0.5) as u8
}

/// Background at `height` of the picture, 0 at the top and 1 at the bottom.
pub(super) fn background(height: f32) -> Vector3<f32> {
    let [top, bottom] = BACKGROUND.map(|[r, g, b]| Color::srgb(r, g, b).vector());
    top.lerp(&bottom, height)
}

/// Visible point of a surface.
pub(super) struct Seen {
    /// Position in the world (m).
    pub(super) position: Vector3<f32>,
    /// Unit normal.
    pub(super) normal: Vector3<f32>,
    /// Unit vector to the eye.
    pub(super) to_eye: Vector3<f32>,
    /// Width of a pixel at that distance (m).
    pub(super) pixel: f32,
    pub(super) color: Color,
    pub(super) finish: Finish,
    /// Share of the ambient light that bodies close by block.
    pub(super) occlusion: f32,
}

/// Lights, with unit directions.
pub(super) struct Lights {
    key: Vector3<f32>,
    fill: Vector3<f32>,
}

impl Lights {
    pub(super) fn new() -> Self {
        let key = Vector3::from(KEY).cast::<f32>().normalize();
        Self { key, fill: Vector3::from(FILL).normalize() }
    }

    /// Returns whether a surface with `normal` faces the key light.
    pub(super) fn key_reaches(&self, normal: &Vector3<f32>) -> bool {
        normal.dot(&self.key) > 0.0
    }

    /// Light from `seen` to the eye, if the share `lit` of the key light reaches it.
    pub(super) fn shade(&self, seen: &Seen, lit: f32) -> Vector3<f32> {
        let albedo = match seen.finish {
            Finish::Ground { spacing } => ground_color(seen, spacing as f32),
            _ => seen.color.vector(),
        };
        let (diffuse, specular, shininess) = match seen.finish {
            Finish::Matte | Finish::Ground { .. } => (1.0, Vector3::zeros(), 3),
            Finish::Satin => (1.0, Vector3::repeat(0.10), 3),
            Finish::Glossy => (1.0, Vector3::repeat(0.28), 5),
            Finish::Metal => (0.75, 0.55 * albedo.add_scalar(0.08), 5),
        };
        let sky = 0.5 + 0.5 * seen.normal.z;
        let ambient = Vector3::from(FLOOR).lerp(&SKY.into(), sky) * (1.0 - seen.occlusion);
        let mut arriving = ambient;
        let mut reflected = Vector3::zeros();
        for (direction, light, share) in
            [(&self.key, KEY_LIGHT, lit), (&self.fill, FILL_LIGHT, 1.0 - 0.5 * seen.occlusion)]
        {
            let light = Vector3::from(light) * share;
            let cosine = seen.normal.dot(direction).max(0.0);
            arriving += light * cosine;
            if specular.x > 0.0 && cosine > 0.0 {
                reflected += light * highlight(seen, direction, shininess);
            }
        }
        arriving.component_mul(&albedo) * diffuse + reflected.component_mul(&specular)
    }
}

/// Blinn–Phong lobe of exponent 2^`doublings`.
fn highlight(seen: &Seen, direction: &Vector3<f32>, doublings: u32) -> f32 {
    let half = direction + seen.to_eye;
    let mut lobe = (seen.normal.dot(&half) / half.norm().max(1e-6)).max(0.0);
    for _ in 0..doublings {
        lobe *= lobe;
    }
    lobe
}

/// Rounds to the nearest integer, faster than `f32::round`, which is a library call on baseline
/// processors.
fn nearest_integer(x: f32) -> i32 {
    (x + 0.5f32.copysign(x)) as i32
}

/// Colour of the ground, darker on the lines of the grid. The edges of the lines are blurred over
/// the width of a pixel.
fn ground_color(seen: &Seen, spacing: f32) -> Vector3<f32> {
    let color = seen.color.vector();
    if seen.normal.z < 0.9 {
        return color;
    }
    let slant = seen.to_eye.z.abs().max(0.1);
    // A line narrower than the blur is drawn fainter instead.
    let blur = seen.pixel * (0.5 + 0.5 / slant);
    let strength = (2.0 * LINE / blur).min(1.0);
    let line = |x: f32| {
        let nearest = nearest_integer(x / spacing);
        let distance = (x - nearest as f32 * spacing).abs();
        let coverage = ((LINE - distance) / blur + 0.5).clamp(0.0, 1.0);
        coverage * if nearest % 5 == 0 { HEAVY } else { LIGHT }
    };
    color * (1.0 - strength * line(seen.position.x).max(line(seen.position.y)))
}
