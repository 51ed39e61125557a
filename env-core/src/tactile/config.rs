//! Settings of the sense of touch, as they come from Python.

use std::path::Path;

use serde::{Deserialize, Deserializer, Serialize, de::Error as _};
use serde_json::Value;

use crate::{
    Error, Result,
    deformation::{Law, Moduli, SoftBody},
    geometry::PadMesh,
    sensor::{Calibration, Sensor},
};

/// Which model answers presses.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Choice {
    /// None: the fingers are rigid and feel no more than their wrench.
    None,
    /// Linear elasticity ([`crate::compliance`]).
    Compliance,
    /// Finite elements ([`crate::fem`]).
    Fem,
    /// The shipped network made for speed, `swift` ([`crate::surrogate`]).
    #[default]
    Surrogate,
    /// The shipped network made for accuracy, `default`.
    #[serde(rename = "surrogate-fine")]
    SurrogateFine,
}

/// What a gel is made of.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Material {
    /// The sensor's calibration of that name.
    Calibration(String),
    /// A neo-Hookean solid.
    Moduli {
        /// Young's modulus (Pa).
        young: f64,
        /// Poisson's ratio.
        poisson: f64,
    },
}

impl<'de> Deserialize<'de> for Material {
    /// By hand, because serde's untagged enums cannot say what was wrong.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Numbers {
            young: f64,
            poisson: f64,
        }
        match Value::deserialize(deserializer)? {
            Value::String(name) => Ok(Self::Calibration(name)),
            value @ Value::Object(_) => {
                let Numbers { young, poisson } =
                    serde_json::from_value(value).map_err(D::Error::custom)?;
                Ok(Self::Moduli { young, poisson })
            }
            other => Err(D::Error::custom(format!(
                "found {other}, expected a calibration's name or the numbers young and poisson"
            ))),
        }
    }
}

/// How finely the pad is computed and seen.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Resolution {
    /// Most nodes of the pad's mesh.
    pub nodes: usize,
    /// Markers across and along, over the area that the sensor's printed grid takes up.
    pub markers: [u32; 2],
    /// Cells of the stress and traction maps across and along, over the whole face.
    pub grid: [u32; 2],
    /// Pixels of the depth map across and along, over the camera's view.
    pub depth: [u32; 2],
}

impl Default for Resolution {
    fn default() -> Self {
        Self { nodes: 1000, markers: [5, 7], grid: [10, 12], depth: [24, 32] }
    }
}

/// Everything about touch that can be set.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Who answers.
    pub choice: Choice,
    /// Name of the sensor, or the path of its .toml file.
    pub sensor: String,
    /// What its gel is made of; the sensor's first calibration if not given.
    pub material: Option<Material>,
    /// How finely.
    pub resolution: Resolution,
}

impl Default for Config {
    fn default() -> Self {
        let (material, resolution) = (None, Resolution::default());
        Self { choice: Choice::default(), sensor: "gelsight-mini".into(), material, resolution }
    }
}

impl Config {
    /// The sensor, or an error if it is not known.
    pub fn sensor(&self) -> Result<Sensor> {
        let path = Path::new(&self.sensor);
        let is_file = path.extension().is_some_and(|extension| extension == "toml");
        if is_file { Sensor::read(path) } else { Sensor::named(&self.sensor) }
    }

    /// The calibration of `sensor` that is closest to what is set: the named one or the first.
    pub fn calibration<'s>(&self, sensor: &'s Sensor) -> Result<&'s Calibration> {
        match &self.material {
            Some(Material::Calibration(name)) => {
                sensor.calibration(name).map_err(|error| error.renamed("material"))
            }
            _ => Ok(&sensor.calibrations[0]),
        }
    }

    /// Law and moduli of the gel of `sensor`.
    pub fn material(&self, sensor: &Sensor) -> Result<(Law, Moduli)> {
        if let Some(Material::Moduli { young, poisson }) = self.material {
            return Ok((Law::NeoHookean, Moduli { young, poisson }));
        }
        let gel = self.calibration(sensor)?;
        Ok((gel.law.parse()?, Moduli { young: gel.young, poisson: gel.poisson }))
    }

    /// The meshed pad of `sensor`, and the soft body that it is.
    pub fn pad(&self, sensor: &Sensor) -> Result<(PadMesh, SoftBody)> {
        let (law, moduli) = self.material(sensor)?;
        let pad =
            sensor.pad(self.resolution.nodes).map_err(|error| error.renamed("resolution.nodes"))?;
        let body = SoftBody::new(pad.mesh.clone(), law, moduli, &pad.base)
            .map_err(|error| error.within("material"))?;
        Ok((pad, body))
    }

    /// An error that names the first setting out of its range.
    pub fn validate(&self) -> Result<()> {
        let Resolution { nodes, markers, grid, depth } = &self.resolution;
        if !(100..=MOST_NODES).contains(nodes) {
            let expected = format!("100 to {MOST_NODES}");
            return Err(Error::invalid("resolution.nodes", nodes, expected));
        }
        for (name, counts, most) in
            [("markers", markers, 64), ("grid", grid, 64), ("depth", depth, 512)]
        {
            if !counts.iter().all(|count| (1..=most).contains(count)) {
                let expected = format!("1 to {most} across and along");
                let name = format!("resolution.{name}");
                return Err(Error::invalid(name, format!("{counts:?}"), expected));
            }
        }
        self.material(&self.sensor()?)?;
        Ok(())
    }
}

/// Most nodes of a pad that an environment steps with.
const MOST_NODES: usize = 20_000;
