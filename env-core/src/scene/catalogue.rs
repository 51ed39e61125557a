//! Named objects of a size that fits the default gripper.

use nalgebra::Vector3;

use crate::{
    Error, Result,
    geometry::{Shape, StarShaped, Wave},
    objects,
};

/// Names that [`named`] accepts.
pub const CATALOGUE: [&str; 14] = [
    "sphere",
    "cuboid",
    "cylinder",
    "prism",
    "annulus",
    "ellipsoid",
    "cup",
    "potato",
    "lemon",
    "apple",
    "eggplant",
    "square-peg",
    "round-peg",
    "hexagonal-peg",
];

/// Returns the shape of the catalogue with the given name; an unknown name is an error.
pub fn named(name: &str) -> Result<Shape> {
    Ok(match name {
        "sphere" => Shape::Sphere { radius: 0.018 },
        "cuboid" => Shape::Cuboid { half_extents: Vector3::new(0.015, 0.015, 0.020) },
        "cylinder" => Shape::Cylinder { radius: 0.015, half_height: 0.020 },
        "prism" => Shape::Prism { sides: 8, radius: 0.016, half_height: 0.018 },
        "annulus" => Shape::Annulus { outer: 0.020, inner: 0.013, half_height: 0.012 },
        "ellipsoid" => Shape::Ellipsoid { semi_axes: Vector3::new(0.016, 0.022, 0.018) },
        "cup" => Shape::Cup { bottom: 0.016, rim: 0.020, half_height: 0.022, wall: 0.002 },
        "potato" => star(
            [0.022, 0.016, 0.017],
            &[(0.05, [3.0, 2.0, 0.0], 1.0), (0.04, [2.0, 0.0, 5.0], 0.0)],
        ),
        "lemon" => star([0.017, 0.017, 0.022], &[(0.08, [0.0, 0.0, 6.0], 0.0)]),
        "apple" => star([0.020, 0.020, 0.019], &[(-0.12, [0.0, 0.0, 2.4], -0.6)]),
        "eggplant" => star([0.030, 0.016, 0.016], &[(0.14, [1.6, 0.0, 0.0], 0.8)]),
        // 12 mm between opposite sides.
        "square-peg" => Shape::Cuboid { half_extents: Vector3::new(0.006, 0.006, 0.030) },
        "round-peg" => Shape::Cylinder { radius: 0.006, half_height: 0.030 },
        "hexagonal-peg" => {
            Shape::Prism { sides: 6, radius: 0.012 / f64::sqrt(3.0), half_height: 0.030 }
        }
        _ => return Err(Error::invalid("object", format!("{name:?}"), known(name))),
    })
}

/// Names that can stand in the place of an unknown `name`.
fn known(name: &str) -> String {
    let known = CATALOGUE.join(", ");
    let solid = nearest_solid(name).map_or_else(String::new, |solid| {
        format!("; {solid} is a solid of ruffini.objects(), whose surface() makes a mesh file")
    });
    format!("one of {known}, a mesh file, or a shape with its lengths{solid}")
}

/// The solid of the dataset whose name is most like `name`, if it is near and none of [`CATALOGUE`]
/// is nearer.
fn nearest_solid(name: &str) -> Option<String> {
    /// Likeness of names with a letter wrong or left out.
    const LEAST: f64 = 0.9;
    let likeness = |known: &str| strsim::jaro_winkler(name, known);
    let own = CATALOGUE.map(likeness).into_iter().fold(LEAST, f64::max);
    let mut nearest = None;
    for solid in objects::names() {
        let like = likeness(&solid);
        if like >= own && nearest.as_ref().is_none_or(|(most, _)| like > *most) {
            nearest = Some((like, solid));
        }
    }
    nearest.map(|(_, solid)| solid)
}

fn star(semi_axes: [f64; 3], waves: &[(f64, [f64; 3], f64)]) -> Shape {
    let wave = |&(amplitude, vector, phase): &(f64, [f64; 3], f64)| Wave {
        amplitude,
        vector: vector.into(),
        phase,
    };
    Shape::StarShaped(StarShaped::new(semi_axes.into(), waves.iter().map(wave).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solids_of_the_dataset_are_told_from_unknown_names() {
        let solid = "is a solid of ruffini.objects(), whose surface() makes a mesh file";
        for (name, near) in [
            ("jar-1", "jar-1"),
            ("cup-9", "cup-1"),
            ("tomato", "tomato-1"),
            ("cucumbr-1", "cucumber-1"),
            ("prism-15", "prism-1"),
        ] {
            let message = named(name).unwrap_err().to_string();
            assert!(message.ends_with(&format!("; {near} {solid}")), "{message}");
        }
        for name in ["cupp", "potatoe", "thing"] {
            let message = named(name).unwrap_err().to_string();
            assert!(message.ends_with("or a shape with its lengths"), "{message}");
        }
    }

    #[test]
    fn every_name_makes_an_object_that_fits_between_the_open_pads() {
        let opening = crate::scene::Gripper::default().max_opening;
        for name in CATALOGUE {
            let model = crate::scene::ObjectModel::new(named(name).unwrap()).unwrap();
            let (low, high) = model.surface().bounds();
            let width = (high - low).xy().max();
            assert!(width < 0.9 * opening, "{name}: {width} m in {opening} m");
        }
    }
}
