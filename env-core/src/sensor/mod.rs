//! Named tactile sensors: shape, material, markers and camera of their gel pads.
//!
//! A sensor is a TOML file that gives the source of every figure; the sensors in `assets/sensors`
//! are built in and selected by name. Published moduli of one gel differ by a factor of 1.4, so a
//! sensor has several named calibrations. [`fields`] lists what a file may hold, from which it is
//! checked and a template is written.

mod fields;

use std::{fs, path::Path};

use serde::{Deserialize, Serialize};

use crate::{
    Error, Result,
    geometry::{PadMesh, PadOutline},
};

#[cfg(test)]
pub(crate) use fields::LAWS;
pub use fields::template;
pub(crate) use fields::{LARGEST_POISSON, MOST_FRICTION};

const KNOWN: [(&str, &str); 2] = [
    ("gelsight-mini", include_str!("../../assets/sensors/gelsight-mini.toml")),
    ("digit", include_str!("../../assets/sensors/digit.toml")),
];

/// A tactile sensor.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Name by which it is selected.
    pub name: String,
    /// Description in one sentence, or empty.
    #[serde(default)]
    pub description: String,
    /// Undeformed gel pad.
    pub outline: PadOutline,
    /// Properties common to all calibrations of the gel.
    pub gel: Gel,
    /// Materials fitted to the gel; the first is the default.
    #[serde(rename = "calibration")]
    pub calibrations: Vec<Calibration>,
    /// Friction of the gel.
    pub friction: Friction,
    /// Printed markers, if any.
    pub markers: Option<Markers>,
    /// Camera behind the gel.
    pub camera: Camera,
}

/// Properties of a gel that do not depend on its calibration.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Gel {
    /// Density (kg/m³).
    pub density: f64,
    /// Source of the figures, or empty.
    #[serde(default)]
    pub source: String,
}

/// A material law fitted to a gel.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Name by which it is selected.
    pub name: String,
    /// Young's modulus at small strain (Pa).
    pub young: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Name of the material law.
    pub law: String,
    /// Source of the calibration, or empty.
    #[serde(default)]
    pub source: String,
    /// Elastic foundation fitted to the finite-element model of the gel; that of the `GelSight`
    /// Mini if `None`.
    #[serde(default)]
    pub elastic_foundation: Option<ElasticFoundation>,
}

/// An elastic foundation of independent bristles that represents a gel of any Young's modulus E.
/// `scene::fit_foundation` finds these coefficients.
///
/// With the gel's thickness h, the touched area A and Σ = ∫ δ² dA / h⁴, where δ is the depth of the
/// undeformed face inside the object, the stored energy is `normal` E h³ Σ^`coupling`, and the
/// stiffness against sideways motion is `shear` E h (A/h²)^`spread`.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ElasticFoundation {
    /// Factor of the stored energy.
    pub normal: f64,
    /// Exponent of Σ in the stored energy.
    pub coupling: f64,
    /// Factor of the sideways stiffness.
    pub shear: f64,
    /// Exponent of A/h² in the sideways stiffness.
    pub spread: f64,
}

/// Coulomb friction of a gel.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    /// Coefficient, at rest and while sliding.
    #[serde(rename = "static")]
    pub coefficient: f64,
    /// Source of the figures, or empty.
    #[serde(default)]
    pub source: String,
}

/// A centred grid of markers on the face.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Markers {
    /// Markers in a row across (x).
    pub across: u32,
    /// Markers in a row along (y).
    pub along: u32,
    /// Distance between neighbours (m).
    pub pitch: f64,
    /// Source of the figures, or empty.
    #[serde(default)]
    pub source: String,
}

/// A camera that looks at the face, its picture centred on the apex.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Pixels across (x) and along (y).
    pub pixels: [u32; 2],
    /// Size of a pixel on the face (m).
    pub pixel: f64,
    /// Source of the figures, or empty.
    #[serde(default)]
    pub source: String,
    /// Colours of its picture, if they are known.
    #[serde(default)]
    pub image: Option<ImageResponse>,
}

/// Colours of the face in the camera's picture: red, green and blue from 0 to 1.
///
/// The colour at (x, y), in halves of the view's longer edge, where the slopes of the face have
/// grown by p = ∂z/∂x and q = ∂z/∂y since rest, is
/// Σ `background` xᵃ yᵇ + Σ `response` pᵃ qᵇ xᶜ yᵈ.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ImageResponse {
    /// Exponents a and b of the terms of the resting face (A).
    pub background_terms: Vec<[u8; 2]>,
    /// Their coefficients (A, 3).
    pub background: Vec<[f64; 3]>,
    /// Exponents a, b, c and d of the terms of the slope (B), a + b at least 1.
    pub terms: Vec<[u8; 4]>,
    /// Their coefficients (B, 3).
    pub response: Vec<[f64; 3]>,
    /// Steepest slope to which the terms hold; steeper ones are shortened to it.
    pub steepest: f64,
    /// Standard deviation of the Gaussian that smooths the face's height (m).
    pub smoothing: f64,
    /// Source of the figures, or empty.
    #[serde(default)]
    pub source: String,
}

impl Sensor {
    /// Returns the built-in sensor `name`, or an error that lists the built-in ones.
    pub fn named(name: &str) -> Result<Self> {
        let known = KNOWN.iter().find(|(known, _)| *known == name);
        let (name, text) = known.ok_or_else(|| {
            let names = Self::names().collect::<Vec<_>>().join(", ");
            Error::invalid("sensor", name, format!("one of {names}, or the path of a .toml file"))
        })?;
        Self::parse(name, text)
    }

    /// Names of the built-in sensors, accepted by [`Sensor::named`].
    pub fn names() -> impl Iterator<Item = &'static str> {
        KNOWN.iter().map(|(name, _)| *name)
    }

    /// Reads a sensor from a TOML file in the format of `assets/sensors`.
    pub fn read(path: &Path) -> Result<Self> {
        let text = fs::read_to_string(path).map_err(|error| Error::file(path, error))?;
        Self::parse(&path.display().to_string(), &text)
    }

    /// Returns the built-in sensor `name`, or reads the file if `name` is the path of a .toml file.
    pub fn open(name: &str) -> Result<Self> {
        if Self::is_file(name) { Self::read(Path::new(name)) } else { Self::named(name) }
    }

    /// Returns whether `name` is the path of a .toml file.
    pub fn is_file(name: &str) -> bool {
        Path::new(name).extension().is_some_and(|extension| extension == "toml")
    }

    /// Returns the calibration `name`, or the first if none is named; an error lists the available
    /// ones.
    pub fn calibration(&self, name: Option<&str>) -> Result<&Calibration> {
        let Some(name) = name else { return Ok(&self.calibrations[0]) };
        self.calibrations.iter().find(|c| c.name == name).ok_or_else(|| {
            let names: Vec<_> = self.calibrations.iter().map(|c| c.name.as_str()).collect();
            let expected = format!("one of {} for the sensor {}", names.join(", "), self.name);
            Error::invalid("calibration", name, expected)
        })
    }

    /// Returns the pad meshed with at most `nodes` nodes, finest in the middle of the face.
    pub fn pad(&self, nodes: usize) -> Result<PadMesh> {
        PadMesh::with_nodes(&self.outline, nodes)
    }

    /// Reads a sensor from the `text` of its file, whose `path` stands in errors.
    pub fn parse(path: &str, text: &str) -> Result<Self> {
        fields::check(text)
            .and_then(|()| toml::from_str::<Self>(text).map_err(|error| vec![error.to_string()]))
            .and_then(Self::validated)
            .map_err(|defects| Error::file(path, defects.join("; ")))
    }

    /// Returns this sensor, or the defects of values that depend on each other.
    fn validated(self) -> std::result::Result<Self, Vec<String>> {
        let mut defects = Vec::new();
        defects.extend(
            self.outline.validated().err().map(|error| error.within("outline").to_string()),
        );
        for (i, calibration) in self.calibrations.iter().enumerate() {
            if self.calibrations[..i].iter().any(|other| other.name == calibration.name) {
                let found = format!("{} twice", calibration.name);
                let error = Error::invalid("calibration.name", found, "names that differ");
                defects.push(error.to_string());
            }
        }
        defects.extend(self.camera.image.iter().flat_map(ImageResponse::defects));
        if defects.is_empty() { Ok(self) } else { Err(defects) }
    }
}

impl ImageResponse {
    /// Defects of the response: missing coefficients, and terms that do not vanish on the resting
    /// face.
    fn defects(&self) -> Vec<String> {
        let counts = [
            ("background", self.background.len(), self.background_terms.len()),
            ("response", self.response.len(), self.terms.len()),
        ];
        let wrong = counts.into_iter().filter(|(_, found, expected)| found != expected);
        let mut defects: Vec<_> = wrong
            .map(|(name, found, expected)| {
                let expected = format!("{expected}, one for each of its terms");
                Error::invalid(format!("camera.image.{name}"), found, expected).to_string()
            })
            .collect();
        if let Some(term) = self.terms.iter().find(|[a, b, ..]| [a, b] == [&0, &0]) {
            let expected = "a power of p or q in each";
            let error = Error::invalid("camera.image.terms", format!("{term:?}"), expected);
            defects.push(error.to_string());
        }
        defects
    }
}

impl Default for ElasticFoundation {
    /// Foundation of the `GelSight` Mini with its first calibration.
    fn default() -> Self {
        Self { normal: 1.667, coupling: 1.036, shear: 1.237, spread: 0.689 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_known_sensor_reads_and_meshes() {
        for name in Sensor::names() {
            let sensor = Sensor::named(name).unwrap();
            assert_eq!(sensor.name, name);
            let pad = sensor.pad(1000).unwrap();
            let ([low, high], outline) = (extent(&pad), &sensor.outline);
            let size = [high[0] - low[0], high[1] - low[1], high[2] - low[2]];
            let exact = [outline.width, outline.length, outline.thickness];
            for (found, exact) in size.into_iter().zip(exact) {
                assert!((found - exact).abs() < 1e-12, "{name}: {found} m against {exact} m");
            }
            assert!(high[2].abs() < 1e-12, "{name}: apex at {} m", high[2]);
        }
    }

    fn extent(pad: &PadMesh) -> [[f64; 3]; 2] {
        let of = |i: usize, pick: fn(f64, f64) -> f64| {
            pad.mesh.vertices.iter().map(|v| v[i]).reduce(pick).expect("a pad has vertices")
        };
        [[0, 1, 2].map(|i| of(i, f64::min)), [0, 1, 2].map(|i| of(i, f64::max))]
    }

    #[test]
    fn the_mini_has_the_height_of_its_cad_model() {
        let outline = Sensor::named("gelsight-mini").unwrap().outline;
        // (x, y, drop under the apex) in mm: vertices of the CAD model on its face.
        let vertices = [
            [0.0, 6.0, 0.0953],
            [4.5, 0.0, 0.0891],
            [4.5, 6.0, 0.1605],
            [7.535, 0.0, 0.25],
            [7.535, 6.0, 0.2783],
            [10.375, 0.0, 1.25],
            [0.0, 12.625, 1.25],
        ];
        for [x, y, drop] in vertices {
            let found = -1e3 * outline.height(1e-3 * x, 1e-3 * y);
            assert!((found - drop).abs() < 0.04, "({x}, {y}) mm: {found} mm against {drop} mm");
        }
    }

    #[test]
    fn the_feats_calibration_is_that_of_its_neo_hookean_constant() {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        let Calibration { young, poisson, .. } = sensor.calibration(Some("feats")).unwrap();
        let exact = 2.0 * (2.0 * 0.0725e6) * (1.0 + poisson);
        assert!((young / exact - 1.0).abs() < 1e-12, "{young} Pa against {exact} Pa");
    }

    #[test]
    fn unknown_names_list_the_known_ones() {
        let sensor = Sensor::named("gelsight").unwrap_err().to_string();
        assert!(sensor.contains("gelsight-mini, digit"), "{sensor}");
        let mini = Sensor::named("gelsight-mini").unwrap();
        let calibration = mini.calibration(Some("fem")).unwrap_err().to_string();
        assert!(calibration.contains("tacflex, feats"), "{calibration}");
    }

    #[test]
    fn defects_of_a_file_are_named() {
        let good = KNOWN[0].1;
        let message = |from: &str, to: &str| {
            assert!(good.contains(from), "nothing replaced: {from}");
            Sensor::parse("mine.toml", &good.replace(from, to)).unwrap_err().to_string()
        };
        assert!(message("poisson = 0.475", "poisson = 0.5").contains("poisson"));
        assert!(message("thickness = 0.004", "thickness = 4").contains("thickness"));
        assert!(message("name = \"feats\"", "name = \"tacflex\"").contains("tacflex twice"));
        assert!(message("[gel]", "[jelly]").contains("mine.toml"));
        assert!(message("elastic_foundation = {", "bristles = {").contains("unknown"));
        assert!(Sensor::read(Path::new("no-such.toml")).is_err());
    }
}
