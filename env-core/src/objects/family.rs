//! Kinds of objects, the number of each, and their sizes.

use std::fmt;

use nalgebra::Vector3;

use super::{draw::Draw, fruit, textured};
use crate::geometry::{Hollow, Shape};

/// Use of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FamilySplit {
    /// For training.
    Train,
    /// For the test; no family is used for both.
    Novel,
    /// For the ablation on soft objects only.
    Soft,
}

impl fmt::Display for FamilySplit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Train => "train",
            Self::Novel => "novel",
            Self::Soft => "soft",
        })
    }
}

/// Kind of object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[allow(missing_docs)] // The names suffice, with the exceptions documented.
pub enum Family {
    Prism,
    Annulus,
    Cuboid,
    /// Open vessel that widens towards the rim.
    Cup,
    Cylinder,
    Eggplant,
    Potato,
    Sphere,
    Lemon,
    Tomato,
    /// Lemon's rind round a closed cavity.
    HollowLemon,
    Ellipsoid,
    /// Open vessel that narrows towards the rim, for the paper's other cups.
    Jar,
    Cucumber,
    Apple,
    Strawberry,
    /// Cylinder with round ends; none in the catalogue.
    Capsule,
    /// Cone; none in the catalogue.
    Cone,
    /// Ellipsoid covered by bumps; none in the catalogue.
    Raspberry,
    /// Cylinder with grooves round it; none in the catalogue.
    Ribbed,
    /// Box with pyramids on two faces; none in the catalogue.
    Rasp,
}

use Family::{
    Annulus, Apple, Capsule, Cone, Cuboid, Cucumber, Cup, Cylinder, Eggplant, Ellipsoid,
    HollowLemon, Jar, Lemon, Potato, Prism, Rasp, Raspberry, Ribbed, Sphere, Strawberry, Tomato,
};

impl Family {
    /// All families of the catalogue, in its order.
    pub const ALL: [Self; 16] = [
        Prism,
        Annulus,
        Cuboid,
        Cup,
        Cylinder,
        Eggplant,
        Potato,
        Sphere,
        Lemon,
        Tomato,
        HollowLemon,
        Ellipsoid,
        Jar,
        Cucumber,
        Apple,
        Strawberry,
    ];

    /// Number of members in the catalogue.
    pub fn count(self) -> u32 {
        match self {
            Prism => 14,
            Cylinder => 8,
            Annulus => 7,
            Cuboid | Sphere => 6,
            Ellipsoid => 4,
            Cup | Potato | Jar | Apple => 3,
            Tomato => 2,
            Eggplant | Lemon | HollowLemon | Cucumber | Strawberry => 1,
            Capsule | Cone | Raspberry | Ribbed | Rasp => 0,
        }
    }

    /// Use of its members.
    pub fn split(self) -> FamilySplit {
        match self {
            Prism | Annulus | Cuboid | Cup | Cylinder | Eggplant | Potato | Sphere | Lemon
            | Capsule | Cone | Raspberry | Ribbed | Rasp => FamilySplit::Train,
            Tomato | HollowLemon | Ellipsoid | Jar | Cucumber | Apple => FamilySplit::Novel,
            Strawberry => FamilySplit::Soft,
        }
    }

    /// Solid of member `index`. The first length drawn is spread over the members.
    pub(super) fn shape(self, index: u32, seed: u64) -> Shape {
        self.drawn(&mut Draw::new(seed, index, self.count()), index)
    }

    fn drawn(self, draw: &mut Draw, index: u32) -> Shape {
        match self {
            Prism => Shape::Prism {
                sides: 3 + index % 7,
                radius: draw.spread(0.012, 0.026),
                half_height: draw.uniform(0.009, 0.026),
            },
            Annulus => annulus(draw),
            Cuboid => Shape::Cuboid {
                half_extents: Vector3::new(
                    draw.spread(0.008, 0.026),
                    draw.uniform(0.008, 0.026),
                    draw.uniform(0.010, 0.030),
                ),
            },
            Cup => cup(draw, [1.15, 1.4]),
            Jar => cup(draw, [0.72, 0.9]),
            Cylinder => Shape::Cylinder {
                radius: draw.spread(0.008, 0.026),
                half_height: draw.uniform(0.010, 0.030),
            },
            Sphere => Shape::Sphere { radius: draw.spread(0.010, 0.027) },
            Ellipsoid => Shape::Ellipsoid {
                semi_axes: Vector3::new(
                    draw.spread(0.012, 0.024),
                    draw.uniform(0.012, 0.024),
                    draw.uniform(0.020, 0.032),
                ),
            },
            Eggplant => Shape::StarShaped(fruit::eggplant(draw)),
            Potato => Shape::StarShaped(fruit::potato(draw)),
            Lemon => Shape::StarShaped(fruit::lemon(draw)),
            HollowLemon => Shape::Hollow(Hollow::new(fruit::lemon(draw), draw.uniform(0.72, 0.78))),
            Tomato => Shape::StarShaped(fruit::tomato(draw)),
            Cucumber => Shape::StarShaped(fruit::cucumber(draw)),
            Apple => Shape::StarShaped(fruit::apple(draw)),
            Strawberry => Shape::StarShaped(fruit::strawberry(draw)),
            Capsule => Shape::Capsule {
                radius: draw.spread(0.010, 0.026),
                half_height: draw.uniform(0.004, 0.030),
            },
            Cone => Shape::Cone {
                radius: draw.spread(0.012, 0.026),
                half_height: draw.uniform(0.004, 0.024),
            },
            Raspberry => textured::raspberry(draw),
            Ribbed => textured::ribbed(draw),
            Rasp => textured::rasp(draw),
        }
    }

    /// Solid of this family of hand size, `index` of any number, drawn from `seed`.
    pub(super) fn indenter(self, index: u32, seed: u64) -> Shape {
        self.drawn(&mut Draw::new(seed, 0, 1), index)
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Prism => "prism",
            Annulus => "annulus",
            Cuboid => "cuboid",
            Cup => "cup",
            Cylinder => "cylinder",
            Eggplant => "eggplant",
            Potato => "potato",
            Sphere => "sphere",
            Lemon => "lemon",
            Tomato => "tomato",
            HollowLemon => "hollow-lemon",
            Ellipsoid => "ellipsoid",
            Jar => "jar",
            Cucumber => "cucumber",
            Apple => "apple",
            Strawberry => "strawberry",
            Capsule => "capsule",
            Cone => "cone",
            Raspberry => "raspberry",
            Ribbed => "ribbed",
            Rasp => "rasp",
        })
    }
}

/// Ring with at least 4 mm between hole and side.
fn annulus(draw: &mut Draw) -> Shape {
    let outer = draw.spread(0.014, 0.027);
    let inner = draw.uniform(0.35, 0.7) * outer;
    Shape::Annulus { outer, inner, half_height: draw.uniform(0.006, 0.018) }
}

/// Vessel whose rim is `low` to `high` times as wide as its bottom.
fn cup(draw: &mut Draw, [low, high]: [f64; 2]) -> Shape {
    let bottom = draw.spread(0.015, 0.020);
    Shape::Cup {
        bottom,
        rim: draw.uniform(low, high) * bottom,
        half_height: draw.uniform(0.018, 0.028),
        wall: draw.uniform(0.003, 0.004),
    }
}
