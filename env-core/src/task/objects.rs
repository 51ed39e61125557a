//! Objects as settings specify them.

use std::{fmt, path::Path};

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};
use serde_json::{Map, Value, from_value, json};

use crate::{
    Result,
    geometry::{Parameter, Shape, read_solid},
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

/// Solid of one of the [`Shape::kinds`] with its lengths (m); in settings the entry `"shape"` names
/// the kind.
#[derive(Clone, Debug, PartialEq)]
pub struct ShapeSpec {
    /// The solid with sharp edges.
    pub sharp: Shape,
    /// Radius of its edges (m); `None` leaves them sharp.
    pub edge_radius: Option<f64>,
}

impl ShapeSpec {
    /// The shape; an error if a radius of edges is given that they cannot have.
    pub fn shape(&self) -> Result<Shape> {
        match self.edge_radius {
            Some(radius) => self.sharp.rounded(radius),
            None => Ok(self.sharp.clone()),
        }
    }

    /// Entries of the setting in order.
    fn entries(&self) -> Vec<(&'static str, Value)> {
        let mut entries = vec![("shape", json!(self.sharp.name()))];
        entries.extend(numbers(&self.sharp));
        entries.extend(self.edge_radius.map(|radius| ("edge_radius", json!(radius))));
        entries
    }

    fn from_entries(mut given: Map<String, Value>) -> serde_json::Result<Self> {
        let custom = serde_json::Error::custom::<String>;
        let kind =
            given.remove("shape").ok_or_else(|| serde_json::Error::missing_field("shape"))?;
        let mut kinds = Shape::kinds();
        let Some(found) = kinds.iter().position(|solid| kind == solid.name()) else {
            let kinds: Vec<_> = kinds.iter().map(Shape::name).collect();
            let kind = kind.as_str().map_or_else(|| kind.to_string(), str::to_owned);
            let expected = format!("one of `{}`", kinds.join("`, `"));
            return Err(custom(format!("unknown variant `{kind}`, expected {expected}")));
        };
        let mut sharp = kinds.swap_remove(found);
        let mut known: Vec<_> = numbers(&sharp).into_iter().map(|(name, _)| name).collect();
        known.extend(sharp.can_be_rounded().then_some("edge_radius"));
        if let Some(name) = given.keys().find(|name| !known.contains(&name.as_str())) {
            let expected = format!("one of `{}`", known.join("`, `"));
            return Err(custom(format!("unknown field `{name}`, expected {expected}")));
        }
        for (name, parameter) in sharp.parameters() {
            let value = given.remove(name);
            let value = value.ok_or_else(|| serde_json::Error::missing_field(name))?;
            read(parameter, value).map_err(|error| custom(format!("{name}: {error}")))?;
        }
        let edge_radius = given.remove("edge_radius").unwrap_or_default();
        Ok(Self { sharp, edge_radius: from_value(edge_radius)? })
    }
}

/// Names and values of a shape's parameters.
pub(super) fn numbers(shape: &Shape) -> Vec<(&'static str, Value)> {
    let value = |(name, parameter): (_, Parameter)| match parameter {
        Parameter::Count(count) => (name, json!(count)),
        Parameter::Lengths([length]) => (name, json!(length)),
        Parameter::Lengths(lengths) => (name, json!(lengths)),
    };
    shape.clone().parameters().into_iter().map(value).collect()
}

fn read(parameter: Parameter, value: Value) -> serde_json::Result<()> {
    match parameter {
        Parameter::Count(count) => *count = from_value(value)?,
        Parameter::Lengths([length]) => *length = from_value(value)?,
        Parameter::Lengths(lengths) => {
            let found: Vec<f64> = from_value(value)?;
            if found.len() != lengths.len() {
                let expected = lengths.len();
                let message = format!("found {} numbers, expected {expected}", found.len());
                return Err(serde_json::Error::custom(message));
            }
            lengths.copy_from_slice(&found);
        }
    }
    Ok(())
}

impl Serialize for ShapeSpec {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_map(self.entries())
    }
}

impl<'de> Deserialize<'de> for ShapeSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        Self::from_entries(Map::deserialize(deserializer)?).map_err(D::Error::custom)
    }
}

impl ObjectSpec {
    /// Builds the model of the object for the scene.
    pub fn model(&self) -> Result<ObjectModel> {
        ObjectModel::new(self.shape()?).map_err(|error| match self.file() {
            Some(file) => error.of_mesh(file),
            None => error,
        })
    }

    /// Returns whether this is a name of the catalogue.
    pub fn is_in_catalogue(&self) -> bool {
        matches!(self, Self::Name(name) if !is_mesh_file(name))
    }

    /// Path of the mesh file, if it is one.
    pub fn file(&self) -> Option<&str> {
        match self {
            Self::Name(name) => Some(&**name).filter(|name| is_mesh_file(name)),
            Self::Mesh(spec) => Some(&spec.mesh),
            Self::Shape(_) => None,
        }
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

/// Returns whether a name is the path of a file: it has an extension, as no name of the catalogue does.
fn is_mesh_file(name: &str) -> bool {
    Path::new(name).extension().is_some()
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
            let unit = if value.is_u64() { "" } else { " m" };
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_shape_is_read_as_it_is_written() {
        for sharp in Shape::kinds() {
            let radius = sharp.can_be_rounded().then_some(0.001);
            for edge_radius in [None, radius] {
                let spec = ShapeSpec { sharp: sharp.scaled(2.0), edge_radius };
                let text = serde_json::to_string(&spec).unwrap();
                let read: ShapeSpec = serde_json::from_str(&text).unwrap();
                assert_eq!(read, spec, "{text}");
            }
        }
        let sharp = Shape::Prism { sides: 5, radius: 0.02, half_height: 0.03 };
        let spec = ObjectSpec::Shape(ShapeSpec { sharp, edge_radius: Some(0.001) });
        let text =
            r#"{"shape":"prism","sides":5,"radius":0.02,"half_height":0.03,"edge_radius":0.001}"#;
        assert_eq!(serde_json::to_string(&spec).unwrap(), text);
        let words = "prism, edge radius 0.001 m, half height 0.03 m, radius 0.02 m, sides 5";
        assert_eq!(spec.to_string(), words);
    }

    #[test]
    fn what_is_wrong_with_a_shape_is_named() {
        for (text, expected) in [
            (r#"{"radius": 1}"#, "missing field `shape`"),
            (r#"{"shape": 3}"#, "unknown variant `3`, expected one of `sphere`, `cuboid`"),
            (r#"{"shape": "blob"}"#, "unknown variant `blob`, expected one of `sphere`, `cuboid`"),
            (r#"{"shape": "half-space"}"#, "unknown variant `half-space`"),
            (r#"{"shape": "sphere"}"#, "missing field `radius`"),
            (
                r#"{"shape": "sphere", "radus": 1}"#,
                "unknown field `radus`, expected one of `radius`",
            ),
            (
                r#"{"shape": "sphere", "radius": 1, "edge_radius": 1}"#,
                "unknown field `edge_radius`, expected one of `radius`",
            ),
            (
                r#"{"shape": "cuboid", "half_extents": [1, 2]}"#,
                "half_extents: found 2 numbers, expected 3",
            ),
            (r#"{"shape": "cuboid", "half_extents": 1}"#, "half_extents: invalid type: integer"),
            (r#"{"shape": "sphere", "radius": "big"}"#, "radius: invalid type: string"),
            (
                r#"{"shape": "prism", "sides": 2.5, "radius": 1, "half_height": 1}"#,
                "sides: invalid type: floating point",
            ),
        ] {
            let message = serde_json::from_str::<ShapeSpec>(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }
}
