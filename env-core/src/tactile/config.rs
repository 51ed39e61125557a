//! Settings of touch, as they come from Python.

use std::ops::RangeInclusive;

use serde::{Deserialize, Deserializer, Serialize, de::Error as _};
use serde_json::Value;

use crate::{
    Error, Result,
    compliance::nodal,
    deformation::{Law, Moduli, SoftBody},
    geometry::PadMesh,
    sensor::{Calibration, MOST_FRICTION, Sensor},
};

/// Model that solves presses.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Choice {
    /// None: the fingers are rigid, and only their wrenches are known.
    None,
    /// Linear elasticity with contact on cells ([`crate::surrogate::LinearPad`]).
    Compliance,
    /// Finite elements ([`crate::fem::Fem`]).
    Fem,
    /// Network that corrects the linear solution ([`crate::surrogate::Surrogate`]).
    #[default]
    Surrogate,
}

impl Choice {
    /// Returns whether a step may take so long that Ctrl-C has to end it early.
    pub fn is_slow(self) -> bool {
        match self {
            Self::Fem => true,
            Self::None | Self::Compliance | Self::Surrogate => false,
        }
    }

    /// Largest coefficient of friction that the model takes.
    pub(crate) fn most_friction(self) -> f64 {
        match self {
            Self::Compliance | Self::Surrogate => nodal::MOST_FRICTION,
            Self::None | Self::Fem => MOST_FRICTION,
        }
    }

    /// Returns whether presses have the sampled shapes of objects, whose error must then be smaller
    /// than the model's.
    pub(crate) fn takes_sampled_shapes(self) -> bool {
        match self {
            Self::Compliance | Self::Surrogate => true,
            Self::None | Self::Fem => false,
        }
    }
}

/// Material of a gel.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum GelMaterial {
    /// Calibration of the sensor with this name.
    Calibration(String),
    /// Neo-Hookean solid.
    Moduli {
        /// Young's modulus (Pa).
        young: f64,
        /// Poisson's ratio.
        poisson: f64,
    },
}

impl<'de> Deserialize<'de> for GelMaterial {
    /// Written by hand because the errors of serde's untagged enums do not name the wrong value.
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

/// Resolution of the pad's mesh and of its channels.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Resolution {
    /// Greatest number of nodes of the pad's mesh.
    pub nodes: usize,
    /// Markers across and along, over the area that the sensor's printed grid takes up.
    pub markers: [u32; 2],
    /// Cells of the stress and traction maps across and along, over the whole face.
    pub grid: [u32; 2],
    /// Pixels of the depth map across and along, over the camera's view.
    pub depth: [u32; 2],
    /// Pixels of the tactile image across and along, over the camera's view.
    pub image: [u32; 2],
}

impl Default for Resolution {
    fn default() -> Self {
        Self { nodes: 1000, markers: [5, 7], grid: [10, 12], depth: [24, 32], image: [60, 80] }
    }
}

impl Resolution {
    /// Counts across and along: place in the settings, value, greatest allowed count, meaning.
    pub(crate) fn counts(&self) -> [(&'static str, [u32; 2], u32, &'static str); 4] {
        [
            ("resolution.markers", self.markers, 64, "markers across and along"),
            ("resolution.grid", self.grid, 64, "cells of ``stress`` and ``traction``, likewise"),
            ("resolution.depth", self.depth, 512, "pixels of ``depth``, likewise"),
            ("resolution.image", self.image, 512, "pixels of ``image``, likewise"),
        ]
    }

    /// Returns an error if a count of markers, cells or pixels is out of range.
    pub fn validate(&self) -> Result<()> {
        for (name, counts, most, _) in self.counts() {
            if !counts.iter().all(|count| (1..=most).contains(count)) {
                let expected = format!("1 to {most} across and along");
                return Err(Error::invalid(name, format!("{counts:?}"), expected));
            }
        }
        Ok(())
    }
}

/// Settings of touch.
#[derive(Clone, Debug, PartialEq)]
pub struct TactileConfig {
    /// Model that solves presses.
    pub choice: Choice,
    /// Name of the sensor, or the path of its .toml file.
    pub sensor: String,
    /// Material of its gel; the sensor's first calibration if not given.
    pub material: Option<GelMaterial>,
    /// Resolution of mesh and channels.
    pub resolution: Resolution,
    /// Path of the weights of [`Choice::Surrogate`]; the shipped ones if not given.
    pub network: Option<String>,
}

impl Default for TactileConfig {
    fn default() -> Self {
        Self {
            choice: Choice::default(),
            sensor: "gelsight-mini".into(),
            material: None,
            resolution: Resolution::default(),
            network: None,
        }
    }
}

impl TactileConfig {
    /// Loads the sensor; returns an error if it is not known.
    pub fn sensor(&self) -> Result<Sensor> {
        Sensor::open(&self.sensor)
    }

    /// Calibration of `sensor`: the named one, or the first if none is named.
    pub fn calibration<'s>(&self, sensor: &'s Sensor) -> Result<&'s Calibration> {
        let name = match &self.material {
            Some(GelMaterial::Calibration(name)) => Some(name.as_str()),
            _ => None,
        };
        sensor.calibration(name).map_err(|error| error.renamed("material"))
    }

    /// Law and moduli of the gel of `sensor`.
    pub fn material(&self, sensor: &Sensor) -> Result<(Law, Moduli)> {
        if let Some(GelMaterial::Moduli { young, poisson }) = self.material {
            return Ok((Law::NeoHookean, Moduli { young, poisson }));
        }
        let gel = self.calibration(sensor)?;
        Ok((gel.law.parse()?, gel.into()))
    }

    /// Meshed pad of `sensor`, and its soft body.
    pub fn pad(&self, sensor: &Sensor) -> Result<(PadMesh, SoftBody)> {
        let (law, moduli) = self.material(sensor)?;
        let pad =
            sensor.pad(self.resolution.nodes).map_err(|error| error.renamed("resolution.nodes"))?;
        let body = SoftBody::new(pad.mesh.clone(), law, moduli, &pad.base)
            .map_err(|error| error.within("material"))?;
        Ok((pad, body))
    }

    /// Returns an error that names the first setting out of its range.
    pub fn validate(&self) -> Result<()> {
        let Resolution { nodes, .. } = &self.resolution;
        if !NODES.contains(nodes) {
            let expected = format!("{} to {}", NODES.start(), NODES.end());
            return Err(Error::invalid("resolution.nodes", nodes, expected));
        }
        self.resolution.validate()?;
        if let (Some(found), false) = (&self.network, self.choice == Choice::Surrogate) {
            let expected = "none where tactile is not \"surrogate\"";
            return Err(Error::invalid("network", found, expected));
        }
        self.material(&self.sensor()?)?;
        Ok(())
    }
}

/// Numbers of nodes that a pad's mesh in an environment may have.
pub(crate) const NODES: RangeInclusive<usize> = 100..=20_000;
