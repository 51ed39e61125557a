//! Wall thickness of a shape, which determines how densely contact points must cover a surface to
//! detect the shape.

use std::f64::consts::PI;

use super::Shape;

impl Shape {
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
            Self::Hollow(hollow) => {
                2.0 * (1.0 - hollow.cavity()) * hollow.solid().semi_axes().min()
            }
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
