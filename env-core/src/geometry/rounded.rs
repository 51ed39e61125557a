//! Solids whose convex edges are rounded: all balls of one radius that fit into a sharp solid, its
//! morphological opening. It is the core, where the balls' centres are, grown by the radius.
//!
//! Distances are those to the core less the radius; exact, except inside a cup near the corner
//! between wall and bottom, where they are a lower bound of the depth.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Point3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    Distance, Shape, Surface,
    distance::{
        ray::{CLOSE, marched_gap},
        solids::revolved,
    },
};

/// A solid with its convex edges rounded; see [`Shape::rounded`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rounded {
    sharp: Box<Shape>,
    radius: f64,
    core: Core,
}

/// The solid shrunk by the radius.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Core {
    /// Cuboid, prism, cylinder or annulus about the origin.
    Solid(Box<Shape>),
    /// Solid of revolution under a profile of (radius, z) points.
    Revolved(Vec<[f64; 2]>),
}

impl Rounded {
    /// Returns `sharp` with its edges rounded, or `None` for a solid that is smooth or has no
    /// formula. The radius is less than [`Shape::largest_edge_radius`].
    pub(super) fn new(sharp: Shape, radius: f64) -> Option<Self> {
        let core = Core::new(&sharp, radius)?;
        Some(Self { sharp: Box::new(sharp), radius, core })
    }

    /// The solid before its edges were rounded.
    pub fn sharp(&self) -> &Shape {
        &self.sharp
    }

    /// Radius of the edges (m).
    pub fn radius(&self) -> f64 {
        self.radius
    }

    pub(super) fn scaled(&self, factor: f64) -> Self {
        let core = match &self.core {
            Core::Solid(solid) => Core::Solid(Box::new(solid.scaled(factor))),
            Core::Revolved(profile) => {
                Core::Revolved(profile.iter().map(|point| point.map(|x| factor * x)).collect())
            }
        };
        Self { sharp: Box::new(self.sharp.scaled(factor)), radius: factor * self.radius, core }
    }

    pub(super) fn distance(&self, point: &Point3<f64>) -> Distance {
        let found = match &self.core {
            Core::Solid(solid) => solid.distance(point),
            Core::Revolved(profile) => revolved(&point.coords, profile),
        };
        Distance { value: found.value - self.radius, ..found }
    }

    /// Returns [`Shape::distance_error`] of this solid.
    pub(super) fn distance_error(&self) -> f64 {
        // At the corner of the core, inside a cup whose wall leans inwards by up to 45°.
        if matches!(*self.sharp, Shape::Cup { .. }) { 2.0 * self.radius } else { 0.0 }
    }

    /// Returns [`Shape::ray_gap`] of this solid.
    ///
    /// A ray that grazes an annulus or a cup within a micrometre may be reported as a miss.
    pub(super) fn ray_gap(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let begin = self.sharp.ray_gap(origin, direction);
        let is_inside = self.distance(origin).value < 0.0;
        if matches!(*self.sharp, Shape::Annulus { .. } | Shape::Cup { .. }) {
            let start = if is_inside { 0.0 } else { begin?.max(0.0) };
            return marched_gap(|point| self.distance(point).value, origin, direction, start);
        }
        self.entered(origin, direction, begin?).filter(|&gap| gap >= 0.0 || is_inside)
    }

    /// Distance (m) along a ray to where it enters a convex solid, by Newton's method from a place
    /// `start` before. The distance to a convex solid is convex, so that no step leads too far.
    fn entered(&self, origin: &Point3<f64>, direction: &Vector3<f64>, start: f64) -> Option<f64> {
        /// A ray that only just touches takes most steps, each of which halves the distance.
        const MOST_STEPS: usize = 100;
        let mut gap = start;
        for _ in 0..MOST_STEPS {
            let found = self.distance(&(origin + gap * direction));
            if found.value <= CLOSE {
                break;
            }
            let slope = found.normal.dot(direction);
            if slope >= 0.0 {
                return None;
            }
            gap -= found.value / slope;
        }
        Some(gap)
    }

    /// Watertight triangles with about `segments` edges round a circle.
    pub(super) fn surface(&self, segments: u32) -> Surface {
        let radius = self.radius;
        let profile = match &self.core {
            Core::Revolved(profile) => profile.clone(),
            Core::Solid(solid) => match **solid {
                Shape::Cuboid { half_extents: h } => {
                    let corners =
                        [[h.x, h.y], [-h.x, h.y], [-h.x, -h.y], [h.x, -h.y]].map(Vector2::from);
                    return rounded_prism(&corners, h.z, radius, segments);
                }
                Shape::Prism { sides, radius: r, half_height } => {
                    let corner = |i: u32| r * unit(TAU * (f64::from(i) + 0.5) / f64::from(sides));
                    let corners: Vec<_> = (0..sides).map(corner).collect();
                    return rounded_prism(&corners, half_height, radius, segments);
                }
                ref round => round.profile().expect("a core is a prism or round"),
            },
        };
        let outline = grown(&profile, radius, segments);
        Surface::revolved(&outline, segments, PI / f64::from(segments))
    }
}

impl Core {
    fn new(sharp: &Shape, r: f64) -> Option<Self> {
        let solid = match *sharp {
            Shape::Cuboid { half_extents } => {
                Shape::Cuboid { half_extents: half_extents.add_scalar(-r) }
            }
            Shape::Prism { sides, radius, half_height } => {
                let radius = radius - r / (PI / f64::from(sides)).cos();
                Shape::Prism { sides, radius, half_height: half_height - r }
            }
            Shape::Cylinder { radius, half_height } => {
                Shape::Cylinder { radius: radius - r, half_height: half_height - r }
            }
            Shape::Annulus { outer, inner, half_height } => {
                Shape::Annulus { outer: outer - r, inner: inner + r, half_height: half_height - r }
            }
            Shape::Cone { .. } | Shape::Cup { .. } => {
                return Some(Self::Revolved(shrunk(&sharp.profile()?, r)));
            }
            _ => return None,
        };
        Some(Self::Solid(Box::new(solid)))
    }
}

/// Profile, from the axis to the axis, of a solid whose sides are moved inwards by `radius` (m).
fn shrunk(profile: &[[f64; 2]], radius: f64) -> Vec<[f64; 2]> {
    // Lines n·x = c along the sides, and the axis at both ends.
    let axis = (-Vector2::x(), 0.0);
    let side = |ends: &[[f64; 2]]| {
        let normal = unit(outward_angle(ends[0], ends[1]));
        (normal, normal.dot(&Vector2::from(ends[0])) - radius)
    };
    let lines: Vec<_> = [axis].into_iter().chain(profile.windows(2).map(side)).collect();
    let crossing = |i: usize| {
        let ((m, c), (n, d)) = (lines[i], lines[(i + 1) % lines.len()]);
        let determinant = m.perp(&n);
        [(c * n.y - d * m.y) / determinant, (d * m.x - c * n.x) / determinant]
    };
    let mut core: Vec<_> = (0..lines.len()).map(crossing).collect();
    let last = core.len() - 1;
    (core[0][0], core[last][0]) = (0.0, 0.0);
    core
}

/// Profile of a solid of revolution grown by `radius` (m), with an arc at every convex corner.
fn grown(profile: &[[f64; 2]], radius: f64, segments: u32) -> Vec<[f64; 2]> {
    let sides = profile.len() - 1;
    let is_loop = profile[0] == profile[sides];
    let angle = |side: usize| outward_angle(profile[side], profile[side + 1]);
    let mut outline = Vec::new();
    for (i, &corner) in profile.iter().enumerate().take(sides + usize::from(!is_loop)) {
        let before = match i {
            0 if is_loop => angle(sides - 1),
            0 => -FRAC_PI_2,
            _ => angle(i - 1),
        };
        let after = if i < sides { angle(i) } else { FRAC_PI_2 };
        let turn = (after - before + PI).rem_euclid(TAU) - PI;
        // At a concave corner, and between two sides in line, the moved sides meet in a point.
        let (steps, reach) = if turn > FLAT {
            (arc_steps(turn, segments), radius)
        } else {
            (0, radius / (0.5 * turn).cos())
        };
        outline.extend((0..=steps).map(|k| {
            let share = if steps == 0 { 0.5 } else { f64::from(k) / f64::from(steps) };
            let point = Vector2::from(corner) + reach * unit(before + share * turn);
            [point.x, point.y]
        }));
    }
    if is_loop {
        outline.push(outline[0]);
    } else {
        let last = outline.len() - 1;
        (outline[0][0], outline[last][0]) = (0.0, 0.0);
    }
    outline
}

/// Angle (rad) below which two sides are in line.
const FLAT: f64 = 1e-9;

/// Right prism over a convex polygon, which turns by the same angle at each of its `corners`,
/// counter-clockwise from the side that faces +x; grown by `radius` (m).
fn rounded_prism(
    corners: &[Vector2<f64>],
    half_height: f64,
    radius: f64,
    segments: u32,
) -> Surface {
    let turn = TAU / corners.len() as f64;
    let (steps, rises) = (arc_steps(turn, segments), arc_steps(FRAC_PI_2, segments));
    let around: Vec<_> = corners
        .iter()
        .enumerate()
        .flat_map(|(i, corner)| {
            let direction = move |k| unit(turn * (i as f64 + f64::from(k) / f64::from(steps)));
            (0..=steps).map(move |k| (*corner, direction(k)))
        })
        .collect();
    // Radius and height of the rings over one quarter, from the side to the edge of the cap.
    let quarter = |k: u32| {
        let [x, z]: [f64; 2] = unit(FRAC_PI_2 * f64::from(k) / f64::from(rises)).into();
        // The cosine of a right angle is not exactly zero.
        [if k == rises { 0.0 } else { radius * x }, half_height + radius * z]
    };
    let lower = (0..=rises).rev().map(quarter).map(|[x, z]| [x, -z]);
    let ring = |[reach, z]: [f64; 2]| {
        let point = move |(corner, direction): &(Vector2<f64>, Vector2<f64>)| {
            let at = corner + reach * direction;
            Point3::new(at.x, at.y, z)
        };
        around.iter().map(point).collect::<Vec<_>>()
    };
    let top = Point3::new(0.0, 0.0, half_height + radius);
    let bottom = Point3::new(0.0, 0.0, -top.z);
    let rings = lower.chain((0..=rises).map(quarter)).map(ring);
    let rings = [vec![bottom]].into_iter().chain(rings).chain([vec![top]]);
    Surface::lofted(rings, false).merged()
}

/// Steps of an arc of `turn` (rad): edges are small, so half as many as round a large circle.
fn arc_steps(turn: f64, segments: u32) -> u32 {
    (0.5 * turn / TAU * f64::from(segments)).ceil().max(1.0) as u32
}

/// Angle (rad) of the outward normal of a side of a profile, which has the solid on its left.
fn outward_angle([x0, z0]: [f64; 2], [x1, z1]: [f64; 2]) -> f64 {
    (x0 - x1).atan2(z1 - z0)
}

fn unit(angle: f64) -> Vector2<f64> {
    Vector2::new(angle.cos(), angle.sin())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::geometry::{StarShaped, examples::points};

    const RADIUS: f64 = 1.5e-3;

    fn sharp() -> [Shape; 8] {
        [
            Shape::Cuboid { half_extents: Vector3::new(0.01, 0.02, 0.03) },
            Shape::Cylinder { radius: 0.02, half_height: 0.03 },
            Shape::Cone { radius: 0.02, half_height: 0.03 },
            Shape::Prism { sides: 3, radius: 0.03, half_height: 0.02 },
            Shape::Prism { sides: 7, radius: 0.03, half_height: 0.02 },
            Shape::Annulus { outer: 0.03, inner: 0.02, half_height: 0.01 },
            Shape::Cup { bottom: 0.02, rim: 0.03, half_height: 0.03, wall: 0.005 },
            Shape::Cup { bottom: 0.03, rim: 0.02, half_height: 0.02, wall: 0.005 },
        ]
    }

    #[test]
    fn a_ball_lies_inside_just_where_it_fits_into_the_sharp_solid() {
        for sharp in sharp() {
            let largest = sharp.largest_edge_radius().unwrap();
            for radius in [RADIUS, 0.999 * largest] {
                let rounded = sharp.rounded(radius).unwrap();
                // Every point of the surface is on a ball that fits.
                for vertex in rounded.surface(40).unwrap().vertices() {
                    let found = rounded.distance(vertex);
                    assert!(found.value.abs() < 1e-12, "{rounded:?} at {vertex}: {}", found.value);
                    let middle = vertex - radius * found.normal;
                    let room = -sharp.distance(&middle).value;
                    assert!(room > radius - 1e-12, "{rounded:?} at {vertex}: {room} m of room");
                }
                // Every ball that fits is inside.
                for p in points(3000, 0.03) {
                    if sharp.distance(&p).value <= -radius {
                        let depth = -rounded.distance(&p).value;
                        let least = radius - rounded.distance_error();
                        assert!(
                            depth > least.max(0.0) - 1e-12,
                            "{rounded:?} at {p}: {depth} m deep"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn distances_are_those_to_its_triangles() {
        for sharp in sharp() {
            let rounded = sharp.rounded(RADIUS).unwrap();
            let mesh = Shape::Mesh(Arc::new(rounded.surface(200).unwrap()));
            for p in points(1000, 0.04) {
                let (exact, found) = (mesh.distance(&p).value, rounded.distance(&p).value);
                // The sag of 200 facets round 3 cm is 3.7 µm, that of an edge 0.4 µm.
                let is_bound = exact < 0.0 && rounded.distance_error() > 0.0;
                let off = if is_bound { (exact - found).max(0.0) } else { (exact - found).abs() };
                assert!(off < 5e-6, "{rounded:?} at {p}: {found} m against {exact} m");
                assert!(found - exact < rounded.distance_error() + 5e-6, "{rounded:?} at {p}");
            }
        }
    }

    #[test]
    fn rays_end_where_they_meet_its_triangles() {
        for sharp in sharp() {
            let rounded = sharp.rounded(RADIUS).unwrap();
            let mesh = Shape::Mesh(Arc::new(rounded.surface(200).unwrap()));
            let rays = points(1000, 0.05).zip(points(1000, 1.0).skip(3));
            let missed = rays.filter(|(p, d)| {
                let direction = d.coords.normalize();
                match (rounded.ray_gap(p, &direction), mesh.ray_gap(p, &direction)) {
                    (Some(a), Some(b)) => (a - b).abs() > 1e-4,
                    (None, None) => false,
                    _ => true,
                }
            });
            // Those that graze an edge within the sag of the triangles.
            let missed = missed.count();
            assert!(missed <= 3, "{rounded:?}: {missed} of 1000 rays");
        }
    }

    #[test]
    fn its_volume_is_that_of_steiners_formula() {
        let half_extents = Vector3::new(0.01, 0.02, 0.03);
        let rounded = Shape::Cuboid { half_extents }.rounded(RADIUS).unwrap();
        let [a, b, c]: [f64; 3] = (2.0 * half_extents.add_scalar(-RADIUS)).into();
        let exact = a * b * c
            + 2.0 * (a * b + b * c + c * a) * RADIUS
            + PI * (a + b + c) * RADIUS.powi(2)
            + 4.0 / 3.0 * PI * RADIUS.powi(3);
        let volume = rounded.surface(160).unwrap().mass_properties(1.0).mass;
        assert!((volume / exact - 1.0).abs() < 3e-5, "{volume} m³ against {exact} m³");
    }

    #[test]
    fn as_many_points_are_inside_as_its_volume_tells() {
        for sharp in sharp() {
            let rounded = sharp.rounded(RADIUS).unwrap();
            let volume = rounded.surface(200).unwrap().mass_properties(1.0).mass;
            let (count, half) = (40_000, 0.031);
            let inside = points(count, half).filter(|p| rounded.distance(p).value < 0.0).count();
            let share = inside as f64 / f64::from(count);
            let found = share * (2.0 * half).powi(3);
            // An even spread of points is off by less than as many drawn at random are.
            let deviation = ((1.0 - share) / (share * f64::from(count))).sqrt();
            assert!((found / volume - 1.0).abs() < 2.0 * deviation, "{rounded:?}: {found} m³");
        }
    }

    #[test]
    fn faces_stay_where_they_are() {
        for sharp in sharp() {
            let extent = |shape: &Shape| shape.surface(64).unwrap().bounds();
            let ((low, high), (a, b)) = (extent(&sharp), extent(&sharp.rounded(RADIUS).unwrap()));
            assert!((low.z - a.z).abs() < 1e-12, "{sharp:?}: {low} {a}");
            match sharp {
                Shape::Cone { radius, half_height } => {
                    let tip = RADIUS * (radius.hypot(2.0 * half_height) / radius - 1.0);
                    assert!((high.z - b.z - tip).abs() < 1e-12, "shorter by {}", high.z - b.z);
                }
                Shape::Prism { sides: 3, .. } => assert!(b.y < high.y, "{b} {high}"),
                Shape::Cuboid { .. } | Shape::Cylinder { .. } | Shape::Annulus { .. } => {
                    assert!((low - a).norm() + (high - b).norm() < 1e-6, "{sharp:?}: {a} {b}");
                }
                _ => assert!((high.z - b.z).abs() < 1e-12, "{sharp:?}: {high} {b}"),
            }
        }
    }

    #[test]
    fn the_thickness_bounds_the_radius() {
        let message =
            |shape: &Shape, radius| shape.rounded(radius).map(|_| ()).unwrap_err().to_string();
        for sharp in sharp() {
            let most = 0.5 * sharp.thickness();
            for radius in [most, 2.0 * most, -RADIUS, 0.0, f64::NAN] {
                assert!(message(&sharp, radius).contains("edge_radius"), "{sharp:?}, {radius} m");
            }
            let twice = message(&sharp.rounded(RADIUS).unwrap(), RADIUS);
            assert!(twice.contains("solid with rounded edges"), "{twice}");
        }
        let axes = Vector3::repeat(0.02);
        for (shape, name) in [
            (Shape::Sphere { radius: 0.02 }, "sphere"),
            (Shape::HalfSpace, "half-space"),
            (Shape::StarShaped(StarShaped::new(axes, vec![])), "star-shaped"),
            (Shape::Mesh(Arc::new(Surface::cuboid(&axes))), "mesh"),
        ] {
            let found = message(&shape, RADIUS);
            assert!(found.contains(name) && found.contains("a cuboid, cylinder, cone"), "{found}");
        }
    }
}
