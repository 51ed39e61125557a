//! Objects as settings specify them.

use std::{fmt, path::Path};

use serde::{Deserialize, Deserializer, Serialize, de::Error as _};
use serde_json::Value;

use crate::{
    Result,
    geometry::{Shape, read_solid},
    scene::{ObjectModel, named},
};

/// Object in the settings: a name of the catalogue, a mesh file, or a shape with its lengths (m).
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ObjectSpec {
    /// Name in the catalogue, or path of an .obj or .stl file in metres.
    Name(String),
    /// Mesh file with its unit.
    Mesh(MeshSpec),
    /// Shape with its lengths.
    Shape(ShapeSpec),
}

/// Mesh file with its unit and origin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshSpec {
    /// Path of an .obj or .stl file.
    pub mesh: String,
    /// Length of the file's unit (m).
    #[serde(default = "one")]
    pub scale: f64,
    /// Moves the origin to the middle of the bounding box.
    #[serde(default)]
    pub centred: bool,
}

fn one() -> f64 {
    1.0
}

/// Shape with its lengths (m); the entry `"shape"` names its kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "shape", rename_all = "kebab-case", deny_unknown_fields)]
#[allow(missing_docs)] // The fields are those of `geometry::Shape`.
pub enum ShapeSpec {
    Sphere {
        radius: f64,
    },
    Cuboid {
        half_extents: [f64; 3],
        #[serde(skip_serializing_if = "Option::is_none")]
        edge_radius: Option<f64>,
    },
    Cylinder {
        radius: f64,
        half_height: f64,
        #[serde(skip_serializing_if = "Option::is_none")]
        edge_radius: Option<f64>,
    },
    Capsule {
        radius: f64,
        half_height: f64,
    },
    Cone {
        radius: f64,
        half_height: f64,
        #[serde(skip_serializing_if = "Option::is_none")]
        edge_radius: Option<f64>,
    },
    Prism {
        sides: u32,
        radius: f64,
        half_height: f64,
        #[serde(skip_serializing_if = "Option::is_none")]
        edge_radius: Option<f64>,
    },
    Annulus {
        outer: f64,
        inner: f64,
        half_height: f64,
        #[serde(skip_serializing_if = "Option::is_none")]
        edge_radius: Option<f64>,
    },
    Ellipsoid {
        semi_axes: [f64; 3],
    },
    Cup {
        bottom: f64,
        rim: f64,
        half_height: f64,
        wall: f64,
        #[serde(skip_serializing_if = "Option::is_none")]
        edge_radius: Option<f64>,
    },
}

impl ShapeSpec {
    /// The shape; an error if a radius of edges is given that they cannot have.
    pub fn shape(&self) -> Result<Shape> {
        let (sharp, edge_radius) = match *self {
            Self::Sphere { radius } => (Shape::Sphere { radius }, None),
            Self::Cuboid { half_extents, edge_radius } => {
                (Shape::Cuboid { half_extents: half_extents.into() }, edge_radius)
            }
            Self::Cylinder { radius, half_height, edge_radius } => {
                (Shape::Cylinder { radius, half_height }, edge_radius)
            }
            Self::Capsule { radius, half_height } => (Shape::Capsule { radius, half_height }, None),
            Self::Cone { radius, half_height, edge_radius } => {
                (Shape::Cone { radius, half_height }, edge_radius)
            }
            Self::Prism { sides, radius, half_height, edge_radius } => {
                (Shape::Prism { sides, radius, half_height }, edge_radius)
            }
            Self::Annulus { outer, inner, half_height, edge_radius } => {
                (Shape::Annulus { outer, inner, half_height }, edge_radius)
            }
            Self::Ellipsoid { semi_axes } => {
                (Shape::Ellipsoid { semi_axes: semi_axes.into() }, None)
            }
            Self::Cup { bottom, rim, half_height, wall, edge_radius } => {
                (Shape::Cup { bottom, rim, half_height, wall }, edge_radius)
            }
        };
        match edge_radius {
            Some(radius) => sharp.rounded(radius),
            None => Ok(sharp),
        }
    }
}

impl ObjectSpec {
    /// Builds the model of the object for the scene.
    pub fn model(&self) -> Result<ObjectModel> {
        ObjectModel::new(self.shape()?)
    }

    /// The shape of the object.
    pub fn shape(&self) -> Result<Shape> {
        Ok(match self {
            Self::Name(name) if is_mesh_file(name) => read_solid(Path::new(name), 1.0, false)?,
            Self::Name(name) => named(name)?,
            Self::Mesh(spec) => read_solid(Path::new(&spec.mesh), spec.scale, spec.centred)?,
            Self::Shape(spec) => spec.shape()?,
        })
    }
}

fn is_mesh_file(name: &str) -> bool {
    let extension = Path::new(name).extension().map(std::ffi::OsStr::to_ascii_lowercase);
    extension.is_some_and(|e| e == "obj" || e == "stl")
}

impl fmt::Display for ObjectSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name(name) => f.write_str(name),
            Self::Mesh(spec) => f.write_str(&spec.mesh),
            Self::Shape(spec) => write!(f, "{spec}"),
        }
    }
}

impl fmt::Display for ShapeSpec {
    /// The kind of the shape with its lengths: `sphere, radius 0.02 m`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = serde_json::to_value(self).map_err(|_| fmt::Error)?;
        let fields = value.as_object().into_iter().flatten();
        f.write_str(value["shape"].as_str().unwrap_or_default())?;
        for (name, value) in fields.filter(|(name, _)| *name != "shape") {
            let unit = if name == "sides" { "" } else { " m" };
            let numbers = value.as_array().map_or_else(
                || value.to_string(),
                |all| all.iter().map(Value::to_string).collect::<Vec<_>>().join(" × "),
            );
            write!(f, ", {} {numbers}{unit}", name.replace('_', " "))?;
        }
        Ok(())
    }
}

impl<'de> Deserialize<'de> for ObjectSpec {
    /// Written by hand because the errors of serde's untagged enums do not name the wrong value.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let value = Value::deserialize(deserializer)?;
        let parsed = match &value {
            Value::String(name) => Ok(Self::Name(name.clone())),
            Value::Object(map) if map.contains_key("mesh") => {
                serde_json::from_value(value).map(Self::Mesh)
            }
            Value::Object(_) => serde_json::from_value(value).map(Self::Shape),
            other => {
                return Err(D::Error::custom(format!(
                    "found {other}, expected a name, a mesh file, or a shape with its lengths"
                )));
            }
        };
        parsed.map_err(D::Error::custom)
    }
}
