//! Examples shared by the tests of this module: one solid of every kind, the outline of a pad, and
//! points spread over a box.

use nalgebra::{Point3, Vector3};

use super::{Bump, Hollow, PadOutline, Shape, StarShaped, Wave};

/// One solid of every kind that has a finite surface and is not a mesh.
pub(super) fn solids() -> Vec<Shape> {
    let v = Vector3::new(0.01, 0.02, 0.03);
    let wave = Wave { amplitude: 0.1, vector: Vector3::new(3.0, 2.0, 1.0), phase: 0.3 };
    let dimple = |amplitude, axis| Bump { amplitude, axis, concentration: 12.0 };
    let dimples = vec![dimple(-0.25, Vector3::z_axis()), dimple(0.1, -Vector3::y_axis())];
    let apple = StarShaped::new(Vector3::new(0.022, 0.022, 0.02), vec![]).with_bumps(dimples);
    let mut all = Shape::kinds();
    all.extend([
        Shape::Prism { sides: 3, radius: 0.02, half_height: 0.01 },
        Shape::Cup { bottom: 0.03, rim: 0.02, half_height: 0.02, wall: 0.004 },
    ]);
    // Every kind of which the distance is exact everywhere, which it is not inside a rounded cup.
    let sharp = all.iter().filter(|s| s.can_be_rounded() && !matches!(s, Shape::Cup { .. }));
    let rounded: Vec<_> = sharp.map(|shape| shape.rounded(2e-3).expect("thick")).collect();
    all.extend(rounded);
    all.extend([
        Shape::StarShaped(apple.clone()),
        Shape::Hollow(Hollow::new(apple, 0.6)),
        Shape::StarShaped(StarShaped::new(v, vec![wave])),
    ]);
    all
}

/// The outline of a GelSight Mini, which has a dome and a rim.
pub(super) fn mini() -> PadOutline {
    PadOutline {
        length: 0.02525,
        width: 0.02075,
        thickness: 0.004,
        radius_along: 0.210,
        radius_across: 0.133,
        rim_width: 0.00287,
        rim_radius: 0.00524,
    }
}

/// The first `count` points of a Halton sequence in the cube from −`half` to `half` on every axis.
pub(super) fn points(count: u32, half: f64) -> impl Iterator<Item = Point3<f64>> {
    let radical_inverse = |base: u32, mut i: u32| {
        let (mut value, mut digit) = (0.0, 1.0);
        while i > 0 {
            digit /= f64::from(base);
            value += digit * f64::from(i % base);
            i /= base;
        }
        value
    };
    (1..=count).map(move |i| {
        Point3::from([2, 3, 5].map(|base| half * (2.0 * radical_inverse(base, i) - 1.0)))
    })
}
