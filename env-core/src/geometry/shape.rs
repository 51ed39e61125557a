//! Closed solids described by exact parameters rather than triangles.
//!
//! Every shape has its own frame: the origin at its middle, z along its axis of symmetry. Triangles
//! for rendering and for the rigid-body engine are derived by [`Shape::surface`].

use std::{
    f64::consts::{PI, TAU},
    slice,
    sync::Arc,
};

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    Distance, Hollow, Rounded, Sampled, StarShaped, Surface,
    distance::{ellipsoid, solids},
    length::{LARGEST, SMALLEST, length, less},
};
use crate::{Error, Result};

/// A closed solid in its own frame (m).
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Shape {
    /// Ball.
    Sphere {
        /// Radius (m).
        radius: f64,
    },
    /// Box with edges along the axes.
    Cuboid {
        /// Half of each edge (m).
        half_extents: Vector3<f64>,
    },
    /// Cylinder about z.
    Cylinder {
        /// Radius (m).
        radius: f64,
        /// Half of the height (m).
        half_height: f64,
    },
    /// Cylinder about z with hemispherical ends.
    Capsule {
        /// Radius of the shaft and of the ends (m).
        radius: f64,
        /// Half of the shaft's length, ends excluded (m).
        half_height: f64,
    },
    /// Cone about z, apex up.
    Cone {
        /// Radius of the base (m).
        radius: f64,
        /// Half of the height (m).
        half_height: f64,
    },
    /// Right prism over a regular polygon, a flat side facing +x.
    Prism {
        /// Number of sides, at least 3.
        sides: u32,
        /// Radius of the polygon's corners (m).
        radius: f64,
        /// Half of the height (m).
        half_height: f64,
    },
    /// Cylinder about z with a concentric hole.
    Annulus {
        /// Outer radius (m).
        outer: f64,
        /// Radius of the hole (m).
        inner: f64,
        /// Half of the height (m).
        half_height: f64,
    },
    /// Ellipsoid with axes along x, y, z.
    Ellipsoid {
        /// Semi-axes (m).
        semi_axes: Vector3<f64>,
    },
    /// Open vessel about z: a conical wall on a flat bottom, both of one thickness.
    Cup {
        /// Outer radius at the bottom (m).
        bottom: f64,
        /// Outer radius at the rim (m).
        rim: f64,
        /// Half of the height (m).
        half_height: f64,
        /// Thickness of wall and bottom (m).
        wall: f64,
    },
    /// Smooth solid that every ray from the origin leaves exactly once.
    StarShaped(StarShaped),
    /// Star-shaped solid with a closed cavity.
    Hollow(Hollow),
    /// Solid with its convex edges rounded: see [`Shape::rounded`].
    Rounded(Rounded),
    /// Solid under the plane z = 0. It has no surface of finite size.
    HalfSpace,
    /// Solid inside a watertight surface.
    Mesh(#[serde(with = "super::surface")] Arc<Surface>),
    /// One of the other solids with its distances tabulated on grids: see [`Shape::sampled`].
    Sampled(Sampled),
}

/// Number that describes a shape, or several of one name.
#[derive(Debug, PartialEq)]
pub enum Parameter<'a> {
    /// Number of sides, corners or the like.
    Count(&'a mut u32),
    /// One length, or those along x, y, z (m).
    Lengths(&'a mut [f64]),
}

impl<'a> From<&'a mut u32> for Parameter<'a> {
    fn from(count: &'a mut u32) -> Self {
        Self::Count(count)
    }
}

impl<'a> From<&'a mut f64> for Parameter<'a> {
    fn from(length: &'a mut f64) -> Self {
        Self::Lengths(slice::from_mut(length))
    }
}

impl<'a> From<&'a mut Vector3<f64>> for Parameter<'a> {
    fn from(lengths: &'a mut Vector3<f64>) -> Self {
        Self::Lengths(lengths.as_mut_slice())
    }
}

/// Hint for meshes that are larger than [`LARGEST`].
const UNIT: &str = "a file in millimetres needs the scale 0.001, one in centimetres 0.01";

impl Shape {
    /// A solid of each kind that its [`Shape::name`] and [`Shape::parameters`] describe. Settings,
    /// the command line and tests take the kinds from here.
    pub fn kinds() -> Vec<Self> {
        let v = Vector3::new(0.01, 0.02, 0.03);
        vec![
            Self::Sphere { radius: 0.02 },
            Self::Cuboid { half_extents: v },
            Self::Cylinder { radius: 0.02, half_height: 0.03 },
            Self::Capsule { radius: 0.01, half_height: 0.02 },
            Self::Cone { radius: 0.02, half_height: 0.03 },
            Self::Prism { sides: 6, radius: 0.02, half_height: 0.03 },
            Self::Annulus { outer: 0.03, inner: 0.02, half_height: 0.01 },
            Self::Ellipsoid { semi_axes: v },
            Self::Cup { bottom: 0.02, rim: 0.03, half_height: 0.03, wall: 0.003 },
        ]
    }

    /// The parameters with their names; none of a shape of which [`Shape::kinds`] has no kind.
    pub fn parameters(&mut self) -> Vec<(&'static str, Parameter<'_>)> {
        macro_rules! named {
            ($($parameter:ident),*) => {
                vec![$((stringify!($parameter), $parameter.into())),*]
            };
        }
        match self {
            Self::Sphere { radius } => named![radius],
            Self::Cuboid { half_extents } => named![half_extents],
            Self::Cylinder { radius, half_height }
            | Self::Capsule { radius, half_height }
            | Self::Cone { radius, half_height } => named![radius, half_height],
            Self::Prism { sides, radius, half_height } => named![sides, radius, half_height],
            Self::Annulus { outer, inner, half_height } => named![outer, inner, half_height],
            Self::Ellipsoid { semi_axes } => named![semi_axes],
            Self::Cup { bottom, rim, half_height, wall } => named![bottom, rim, half_height, wall],
            Self::StarShaped(_)
            | Self::Hollow(_)
            | Self::Rounded(_)
            | Self::HalfSpace
            | Self::Mesh(_)
            | Self::Sampled(_) => Vec::new(),
        }
    }

    /// Returns this shape if its parameters describe a solid of hand scale.
    pub fn validated(mut self) -> Result<Self> {
        for (name, parameter) in self.parameters() {
            match parameter {
                Parameter::Count(3..=256) => {}
                Parameter::Count(count) => return Err(Error::invalid(name, count, "3 to 256")),
                Parameter::Lengths(lengths) => {
                    lengths.iter().try_for_each(|&value| length(name, value))?;
                }
            }
        }
        match &self {
            Self::Annulus { outer, inner, .. } => less("inner", *inner, "outer", *outer)?,
            Self::Cup { bottom, rim, half_height, wall } => {
                less("wall", *wall, "bottom", *bottom)?;
                less("wall", *wall, "rim", *rim)?;
                less("wall", *wall, "the height", 2.0 * half_height)?;
            }
            Self::StarShaped(star) => star.validate()?,
            Self::Hollow(hollow) => hollow.validate()?,
            Self::Rounded(rounded) => {
                rounded.sharp().rounded(rounded.radius())?;
            }
            // A surface is checked when it is made, except for its size.
            Self::Mesh(surface) => {
                // Six digits: the size is a difference of coordinates.
                let size = format!("{:.5e}", surface.size()).parse().expect("a number");
                length("mesh size", size).map_err(|error| {
                    if surface.size() > LARGEST { error.hinting(UNIT) } else { error }
                })?;
            }
            Self::Sampled(sampled) => {
                sampled.exact().scaled(sampled.scale()).validated()?;
            }
            _ => {}
        }
        Ok(self)
    }

    /// Returns this solid with its convex edges rounded by `radius` (m): all balls of that radius
    /// that fit into it. Its faces stay where they are, and the tip of a cone becomes shorter.
    ///
    /// Returns an error for a shape other than a cuboid, cylinder, cone, prism, annulus or cup, and
    /// for a radius that does not leave 10 µm of the thinnest wall flat.
    pub fn rounded(&self, radius: f64) -> Result<Self> {
        let sharp = self.clone().validated()?;
        let expected = "a cuboid, cylinder, cone, prism, annulus or cup, with sharp edges";
        let refused = || Error::invalid("shape with edges to round", self.name(), expected);
        let largest = self.largest_edge_radius().ok_or_else(refused)?;
        less("edge_radius", radius, "half of the thinnest wall", largest)?;
        Rounded::new(sharp, radius).map(Self::Rounded).ok_or_else(refused)
    }

    /// Returns whether [`Shape::rounded`] has a formula for this kind of solid.
    pub fn can_be_rounded(&self) -> bool {
        self.largest_edge_radius().is_some()
    }

    /// The solid before its edges were rounded, or this solid.
    pub fn sharp(&self) -> &Self {
        match self {
            Self::Rounded(rounded) => rounded.sharp(),
            sharp => sharp,
        }
    }

    /// Kind of the shape, in words.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Sphere { .. } => "sphere",
            Self::Cuboid { .. } => "cuboid",
            Self::Cylinder { .. } => "cylinder",
            Self::Capsule { .. } => "capsule",
            Self::Cone { .. } => "cone",
            Self::Prism { .. } => "prism",
            Self::Annulus { .. } => "annulus",
            Self::Ellipsoid { .. } => "ellipsoid",
            Self::Cup { .. } => "cup",
            Self::StarShaped(_) => "star-shaped solid",
            Self::Hollow(_) => "hollow solid",
            Self::Rounded(_) => "solid with rounded edges",
            Self::HalfSpace => "half-space",
            Self::Mesh(_) => "mesh",
            Self::Sampled(_) => "sampled solid",
        }
    }

    /// Returns the same solid, `factor` times as large.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let mut shape = self.clone();
        for (_, parameter) in shape.parameters() {
            if let Parameter::Lengths(lengths) = parameter {
                for length in lengths {
                    *length *= factor;
                }
            }
        }
        match &mut shape {
            Self::StarShaped(star) => *star = star.scaled(factor),
            Self::Hollow(hollow) => *hollow = hollow.scaled(factor),
            Self::Rounded(rounded) => *rounded = rounded.scaled(factor),
            Self::Mesh(surface) => *surface = Arc::new(surface.scaled(factor)),
            Self::Sampled(sampled) => *sampled = sampled.scaled(factor),
            _ => {}
        }
        shape
    }

    /// Signed distance and its gradient at `point`, in the shape's frame (m).
    #[inline]
    pub fn distance(&self, point: &Point3<f64>) -> Distance {
        let p = &point.coords;
        match self {
            Self::Sphere { radius } => solids::sphere(p, *radius),
            Self::Cuboid { half_extents } => solids::cuboid(p, half_extents),
            Self::Cylinder { radius, half_height } => solids::cylinder(p, *radius, *half_height),
            Self::Capsule { radius, half_height } => solids::capsule(p, *radius, *half_height),
            Self::Prism { sides, radius, half_height } => {
                solids::prism(p, *sides, *radius, *half_height)
            }
            Self::Annulus { outer, inner, half_height } => {
                solids::annulus(p, *outer, *inner, *half_height)
            }
            Self::Cone { radius: r, half_height: h } => {
                solids::revolved(p, &Self::cone_profile(*r, *h))
            }
            Self::Cup { bottom, rim, half_height, wall } => {
                solids::revolved(p, &Self::cup_profile(*bottom, *rim, *half_height, *wall))
            }
            Self::Ellipsoid { semi_axes } => ellipsoid::distance(p, semi_axes),
            Self::StarShaped(star) => star.distance(point),
            Self::Hollow(hollow) => hollow.distance(point),
            Self::Rounded(rounded) => rounded.distance(point),
            Self::HalfSpace => Distance { value: p.z, normal: Vector3::z() },
            Self::Mesh(surface) => surface.distance(point),
            Self::Sampled(sampled) => sampled.distance(point),
        }
    }

    /// Bound of the error of [`Shape::distance`] (m): 0 if it is exact to rounding, infinite if it
    /// has none.
    pub fn distance_error(&self) -> f64 {
        match self {
            Self::StarShaped(_) | Self::Hollow(_) => f64::INFINITY,
            Self::Rounded(rounded) => rounded.distance_error(),
            Self::Sampled(sampled) => sampled.distance_error(),
            _ => 0.0,
        }
    }

    /// Thickness of the thinnest wall (m): a ball of this diameter fits anywhere in the solid
    /// except at its edges and corners. Infinite for a half-space, and for star-shaped solids and
    /// meshes, whose thickness is not computed.
    pub fn thickness(&self) -> f64 {
        match self {
            Self::Sphere { radius } | Self::Capsule { radius, .. } => 2.0 * radius,
            Self::Cuboid { half_extents: v } | Self::Ellipsoid { semi_axes: v } => 2.0 * v.min(),
            Self::Cylinder { radius, half_height } => 2.0 * radius.min(*half_height),
            Self::Cone { radius, half_height } => {
                // Inscribed ball: its radius is area over half the perimeter of the triangular
                // section through the axis.
                let side = radius.hypot(2.0 * half_height);
                4.0 * radius * half_height / (radius + side)
            }
            Self::Prism { sides, radius, half_height } => {
                2.0 * (radius * (PI / f64::from(*sides)).cos()).min(*half_height)
            }
            Self::Annulus { outer, inner, half_height } => (outer - inner).min(2.0 * half_height),
            Self::Cup { bottom, rim, half_height, wall } => {
                // `wall` is the horizontal thickness of an inclined wall.
                let lean = (rim - bottom).atan2(2.0 * half_height);
                wall * lean.cos()
            }
            Self::Hollow(hollow) => (1.0 - hollow.cavity()) * hollow.solid().semi_axes().min(),
            Self::Rounded(rounded) => rounded.sharp().thickness(),
            Self::Sampled(sampled) => sampled.scale() * sampled.exact().thickness(),
            Self::StarShaped(_) | Self::HalfSpace | Self::Mesh(_) => f64::INFINITY,
        }
    }

    /// Smallest extent of the walls along themselves (m); that of the thickness for solids that are
    /// not walls all over.
    pub fn breadth(&self) -> f64 {
        match self {
            Self::Cuboid { half_extents: v } => {
                let mut extents = [v.x, v.y, v.z];
                extents.sort_unstable_by(f64::total_cmp);
                2.0 * extents[1]
            }
            Self::Cup { bottom, half_height, .. } => 2.0 * bottom.min(*half_height),
            Self::Rounded(rounded) => rounded.sharp().breadth(),
            _ => self.thickness(),
        }
    }

    /// Returns whether the surface may have an edge, as every mesh may.
    pub fn has_edges(&self) -> bool {
        match self {
            Self::Sphere { .. }
            | Self::Ellipsoid { .. }
            | Self::Capsule { .. }
            | Self::StarShaped(_)
            | Self::HalfSpace => false,
            Self::Sampled(sampled) => sampled.exact().has_edges(),
            _ => true,
        }
    }

    /// Returns whether it is a convex solid whose faces meet in edges, sharp or rounded.
    pub fn is_creased(&self) -> bool {
        matches!(
            self.sharp(),
            Self::Cuboid { .. } | Self::Prism { .. } | Self::Cone { .. } | Self::Cylinder { .. }
        )
    }

    /// Watertight triangles, with about `segments` edges round a circle, or `None` for a
    /// half-space.
    pub fn surface(&self, segments: u32) -> Option<Surface> {
        let segments = segments.max(8);
        // A flat faces +x, as a prism's does.
        let ring =
            |profile: &[[f64; 2]]| Surface::revolved(profile, segments, PI / f64::from(segments));
        Some(match self {
            Self::Sphere { radius } => Surface::radial(segments, |_| *radius),
            Self::Ellipsoid { semi_axes } => {
                Surface::radial(segments, |d| 1.0 / d.component_div(semi_axes).norm())
            }
            Self::StarShaped(star) => Surface::radial(segments, |d| star.radius(d)),
            Self::Hollow(hollow) => {
                let outer = Surface::radial(segments, |d| hollow.solid().radius(d));
                outer.without(&outer.scaled(hollow.cavity()))
            }
            Self::Rounded(rounded) => rounded.surface(segments),
            Self::Cuboid { half_extents } => Surface::cuboid(half_extents),
            Self::Cylinder { .. } | Self::Cone { .. } | Self::Annulus { .. } | Self::Cup { .. } => {
                ring(&self.profile()?)
            }
            Self::Capsule { radius, half_height } => {
                ring(&capsule_profile(*radius, *half_height, segments))
            }
            Self::Prism { sides, radius: r, half_height: h } => {
                let profile = [[0.0, -h], [*r, -h], [*r, *h], [0.0, *h]];
                Surface::revolved(&profile, *sides, PI / f64::from(*sides))
            }
            Self::HalfSpace => return None,
            Self::Mesh(surface) => (**surface).clone(),
            Self::Sampled(sampled) => return sampled.surface(segments),
        })
    }

    /// (radius, z) points of a solid of revolution with straight sides, solid on the left, from the
    /// axis to the axis or round a loop that ends where it began; `None` for any other.
    pub(super) fn profile(&self) -> Option<Vec<[f64; 2]>> {
        Some(match *self {
            Self::Cylinder { radius: r, half_height: h } => {
                vec![[0.0, -h], [r, -h], [r, h], [0.0, h]]
            }
            Self::Cone { radius, half_height } => Self::cone_profile(radius, half_height).into(),
            Self::Annulus { outer, inner, half_height: h } => {
                vec![[outer, -h], [outer, h], [inner, h], [inner, -h], [outer, -h]]
            }
            Self::Cup { bottom, rim, half_height, wall } => {
                Self::cup_profile(bottom, rim, half_height, wall).into()
            }
            _ => return None,
        })
    }

    /// Upper bound of the radius of rounded edges (m): half of the thinnest wall, of which
    /// [`SMALLEST`] is left; `None` for a solid that has no edges or no formula.
    pub(super) fn largest_edge_radius(&self) -> Option<f64> {
        let thinnest = match self {
            Self::Cuboid { .. }
            | Self::Cylinder { .. }
            | Self::Cone { .. }
            | Self::Prism { .. }
            | Self::Annulus { .. } => self.thickness(),
            // A wall that leans inwards is thinner at the bottom.
            Self::Cup { bottom, rim, half_height, .. } => {
                self.thickness() * (1.0 + ((rim - bottom) / (2.0 * half_height)).min(0.0))
            }
            _ => return None,
        };
        Some(0.5 * (thinnest - SMALLEST))
    }

    /// (radius, z) points of a cone's side and base, solid on the left.
    fn cone_profile(radius: f64, half_height: f64) -> [[f64; 2]; 3] {
        [[0.0, -half_height], [radius, -half_height], [0.0, half_height]]
    }

    /// (radius, z) points of a cup, solid on the left.
    fn cup_profile(bottom: f64, rim: f64, half_height: f64, wall: f64) -> [[f64; 2]; 6] {
        let h = half_height;
        [
            [0.0, -h],
            [bottom, -h],
            [rim, h],
            [rim - wall, h],
            [bottom - wall, wall - h],
            [0.0, wall - h],
        ]
    }
}

fn capsule_profile(radius: f64, half_height: f64, segments: u32) -> Vec<[f64; 2]> {
    let steps = (segments / 4).max(2);
    let arc = |from: f64, z: f64| {
        (0..=steps).map(move |i| {
            let angle = from + 0.25 * TAU * f64::from(i) / f64::from(steps);
            // The cosine of a right angle is not exactly zero, the axis is.
            [(radius * angle.cos()).max(0.0), z + radius * angle.sin()]
        })
    };
    let mut profile: Vec<_> = arc(-0.25 * TAU, -half_height).chain(arc(0.0, half_height)).collect();
    let last = profile.len() - 1;
    profile[0][0] = 0.0;
    profile[last][0] = 0.0;
    profile
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;

    #[test]
    fn walls_are_as_broad_as_they_are_small() {
        let plate = Shape::Cuboid { half_extents: Vector3::new(8e-3, 1e-3, 4e-3) };
        let cup = Shape::Cup { bottom: 5e-3, rim: 6e-3, half_height: 9e-3, wall: 1e-3 };
        assert!((plate.breadth() - 8e-3).abs() < 1e-12 && (cup.breadth() - 1e-2).abs() < 1e-12);
        assert!((Shape::Sphere { radius: 1e-3 }.breadth() - 2e-3).abs() < 1e-12);
    }

    #[test]
    fn a_ball_of_the_thickness_just_fits() {
        let cases = [
            (Shape::Sphere { radius: 1e-3 }, Point3::origin()),
            (Shape::Cuboid { half_extents: Vector3::new(3e-3, 2e-3, 1e-4) }, Point3::origin()),
            (Shape::Prism { sides: 3, radius: 2e-3, half_height: 5e-3 }, Point3::origin()),
            (
                Shape::Annulus { outer: 3e-3, inner: 2e-3, half_height: 4e-3 },
                Point3::new(2.5e-3, 0.0, 0.0),
            ),
            (
                Shape::Cup { bottom: 2e-3, rim: 4e-3, half_height: 3e-3, wall: 5e-4 },
                Point3::new(2.75e-3, 0.0, 0.0),
            ),
            (
                Shape::Hollow(Hollow::new(
                    StarShaped::new(Vector3::new(5e-3, 4e-3, 2e-3), Vec::new()),
                    0.8,
                )),
                Point3::new(0.0, 0.0, 1.8e-3),
            ),
        ];
        for (shape, middle) in cases {
            let (fits, thickness) = (-2.0 * shape.distance(&middle).value, shape.thickness());
            assert!((fits / thickness - 1.0).abs() < 1e-6, "{shape:?}: {fits} m, {thickness} m");
        }
        let (radius, half_height) = (2e-3, 3e-3);
        let cone = Shape::Cone { radius, half_height };
        let height = 0.5 * cone.thickness() - half_height;
        let fits = -2.0 * cone.distance(&Point3::new(0.0, 0.0, height)).value;
        assert!((fits / cone.thickness() - 1.0).abs() < 1e-9, "{fits} m, {} m", cone.thickness());
    }
}
