//! Distance to a solid along a ray: from the pieces of the line that lie in the solid where they
//! have a formula, else by steps of the distance.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector2, Vector3};

use crate::geometry::{Shape, StarShaped, Surface};

/// Start and end of a piece of a line in a solid (m along the line).
type Chord = [f64; 2];

const WHOLE: Chord = [f64::NEG_INFINITY, f64::INFINITY];

/// A line, by a point and a unit direction.
#[derive(Clone, Copy)]
struct Line {
    origin: Vector3<f64>,
    direction: Vector3<f64>,
}

impl Shape {
    /// Distance (m) from `origin` along the unit vector `direction` to where the ray enters the
    /// solid, or `None` if it never does.
    ///
    /// From inside the result is negative: minus the distance back along the ray to where it
    /// entered. From inside, `None` is returned only for a half-space that the ray cannot have
    /// entered.
    pub fn ray_gap(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        match self {
            Self::Mesh(surface) => return surface.ray_gap(origin, direction),
            Self::StarShaped(star) => return star.ray_gap(origin, direction),
            Self::Hollow(hollow) => return hollow.ray_gap(origin, direction),
            Self::Rounded(rounded) => return rounded.ray_gap(origin, direction),
            Self::Sampled(sampled) => return sampled.ray_gap(origin, direction),
            _ => {}
        }
        let line = Line { origin: origin.coords, direction: *direction };
        match line.in_solid(self) {
            Some((chord, hole)) => first_gap(&without(chord?, hole)),
            None => marched_gap(|point| self.distance(point).value, origin, direction, 0.0),
        }
    }
}

/// Returns [`Shape::ray_gap`] of the solid with this signed `distance` (m), by steps of the
/// distance; from outside, beginning `start` (m) along the ray.
///
/// A ray that meets the surface at less than 0.02 rad may be reported as a miss.
pub(in crate::geometry) fn marched_gap(
    distance: impl Fn(&Point3<f64>) -> f64,
    origin: &Point3<f64>,
    direction: &Vector3<f64>,
    start: f64,
) -> Option<f64> {
    const MOST_STEPS: usize = 2000;
    /// More than the diameter of any solid (m).
    const FARTHEST: f64 = 4.0;
    let is_inside = distance(origin) < 0.0;
    let (sign, start) = if is_inside { (-1.0, 0.0) } else { (1.0, start) };
    let mut gap = start;
    for _ in 0..MOST_STEPS {
        let step = distance(&(origin + gap * (sign * direction))).abs();
        if step <= CLOSE {
            return Some(sign * gap);
        }
        gap += step;
        if gap - start > FARTHEST {
            return None;
        }
    }
    None
}

/// Distance (m) from the surface at which a ray has arrived.
pub(in crate::geometry) const CLOSE: f64 = 1e-12;

impl Surface {
    /// Returns [`Shape::ray_gap`] of the solid inside.
    pub(in crate::geometry) fn ray_gap(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
    ) -> Option<f64> {
        match self.tree().first_hit(origin, direction)? {
            (gap, true) => Some(gap),
            (_, false) => self.tree().first_hit(origin, &-direction).map(|(back, _)| -back),
        }
    }
}

impl StarShaped {
    /// Returns [`Shape::ray_gap`]: the distance to the facets, corrected to the smooth surface by
    /// Newton's method.
    ///
    /// A ray that grazes the surface within the facets' sag may be reported as a miss.
    pub(super) fn ray_gap(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let start = self.facets().ray_gap(origin, direction)?;
        let size = self.semi_axes().max();
        let farthest = 0.04 * size;
        let mut gap = start;
        for _ in 0..20 {
            let (level, slope) = self.implicit(&(origin + gap * direction).coords, direction);
            let step = -level / slope;
            gap += step;
            // A grazing ray has no root near by.
            if !step.is_finite() || (gap - start).abs() > farthest {
                return Some(start);
            }
            if step.abs() <= 1e-14 * size {
                break;
            }
        }
        Some(gap)
    }
}

impl Line {
    /// Piece of the line inside a solid without its hole, if it meets it, and inside the hole;
    /// `None` for a solid without a formula.
    fn in_solid(&self, solid: &Shape) -> Option<(Option<Chord>, Option<Chord>)> {
        let chord = match solid {
            Shape::Sphere { radius } => self.in_ball(*radius),
            Shape::Cuboid { half_extents: h } => {
                (0..3).try_fold(WHOLE, |chord, i| both(chord, self.in_slab(i, [-h[i], h[i]])?))
            }
            Shape::Cylinder { radius, half_height } => self.in_cylinder(*radius, *half_height),
            Shape::Capsule { radius, half_height: h } => {
                let end = |z: f64| self.moved(z).in_ball(*radius);
                [self.in_cylinder(*radius, *h), end(-h), end(*h)].into_iter().flatten().reduce(hull)
            }
            Shape::Cone { radius, half_height: h } => self.in_frustum([-h, *h], [*radius, 0.0]),
            Shape::Prism { sides, radius, half_height } => {
                self.in_prism(*sides, *radius, *half_height)
            }
            Shape::Ellipsoid { semi_axes } => {
                let [origin, direction] =
                    [self.origin, self.direction].map(|v| v.component_div(semi_axes));
                Self { origin, direction }.in_ball(1.0)
            }
            Shape::HalfSpace => self.under(&Vector3::z(), 0.0),
            Shape::Annulus { outer, inner, half_height } => {
                let chord = self.in_cylinder(*outer, *half_height);
                return Some((chord, self.in_round(*inner)));
            }
            Shape::Cup { bottom, rim, half_height: h, wall } => {
                let inside = self.in_frustum([wall - h, *h], [bottom - wall, rim - wall]);
                return Some((self.in_frustum([-h, *h], [*bottom, *rim]), inside));
            }
            _ => return None,
        };
        Some((chord, None))
    }

    /// The line relative to the point (0, 0, `z`).
    fn moved(&self, z: f64) -> Self {
        Self { origin: self.origin - z * Vector3::z(), ..*self }
    }

    /// Piece of the line with `normal`·x ≤ `offset`.
    fn under(&self, normal: &Vector3<f64>, offset: f64) -> Option<Chord> {
        linear(normal.dot(&self.direction), normal.dot(&self.origin) - offset)
    }

    /// Piece of the line with low ≤ xᵢ ≤ high.
    fn in_slab(&self, i: usize, [low, high]: [f64; 2]) -> Option<Chord> {
        let (origin, direction) = (self.origin[i], self.direction[i]);
        both(linear(direction, origin - high)?, linear(-direction, low - origin)?)
    }

    fn in_ball(&self, radius: f64) -> Option<Chord> {
        let c = self.origin.norm_squared() - radius * radius;
        roots(self.direction.norm_squared(), self.origin.dot(&self.direction), c)
    }

    /// Piece of the line inside the infinite cylinder about z.
    fn in_round(&self, radius: f64) -> Option<Chord> {
        let [o, d] = [self.origin.xy(), self.direction.xy()];
        let c = o.norm_squared() - radius * radius;
        if d == Vector2::zeros() {
            return (c <= 0.0).then_some(WHOLE);
        }
        roots(d.norm_squared(), o.dot(&d), c)
    }

    fn in_cylinder(&self, radius: f64, half_height: f64) -> Option<Chord> {
        both(self.in_round(radius)?, self.in_slab(2, [-half_height, half_height])?)
    }

    fn in_prism(&self, sides: u32, radius: f64, half_height: f64) -> Option<Chord> {
        let sector = TAU / f64::from(sides);
        let apothem = radius * (0.5 * sector).cos();
        (0..sides).try_fold(self.in_slab(2, [-half_height, half_height])?, |chord, k| {
            let (sin, cos) = (sector * f64::from(k)).sin_cos();
            both(chord, self.under(&Vector3::new(cos, sin, 0.0), apothem)?)
        })
    }

    /// Piece of the line inside the frustum between two discs about z, at heights `z` and of radii
    /// `r`.
    fn in_frustum(&self, z: [f64; 2], r: [f64; 2]) -> Option<Chord> {
        let slab = self.in_slab(2, z)?;
        let slope = (r[1] - r[0]) / (z[1] - z[0]);
        let radius = r[0] + slope * (self.origin.z - z[0]);
        let growth = slope * self.direction.z;
        let [o, d] = [self.origin.xy(), self.direction.xy()];
        let a = d.norm_squared() - growth * growth;
        let b = o.dot(&d) - growth * radius;
        let c = o.norm_squared() - radius * radius;
        if a > 0.0 {
            return both(roots(a, b, c)?, slab);
        }
        if a == 0.0 {
            return both(linear(2.0 * b, c)?, slab);
        }
        // A line steeper than the cone's side is inside beyond a root; beyond the other root lies
        // the mirrored cone past the apex, which the slab does not reach.
        let beyond = match roots(a, b, c) {
            Some([low, high]) if growth < 0.0 => [f64::NEG_INFINITY, low.min(high)],
            Some([low, high]) => [low.max(high), f64::INFINITY],
            None if c <= 0.0 => WHOLE,
            None => return None,
        };
        both(beyond, slab)
    }
}

/// Interval of s with a s + b ≤ 0.
fn linear(a: f64, b: f64) -> Option<Chord> {
    if a == 0.0 {
        return (b <= 0.0).then_some(WHOLE);
    }
    Some(if a < 0.0 { [-b / a, f64::INFINITY] } else { [f64::NEG_INFINITY, -b / a] })
}

/// The roots of a s² + 2 b s + c in rising order, without cancellation, if they are real.
fn roots(a: f64, b: f64, c: f64) -> Option<Chord> {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 {
        return None;
    }
    let q = -(b + discriminant.sqrt().copysign(b));
    if q == 0.0 {
        return (a != 0.0).then_some([0.0, 0.0]);
    }
    let (s, t) = (c / q, q / a);
    Some([s.min(t), s.max(t)])
}

fn both(a: Chord, b: Chord) -> Option<Chord> {
    let chord = [a[0].max(b[0]), a[1].min(b[1])];
    (chord[0] <= chord[1]).then_some(chord)
}

fn hull(a: Chord, b: Chord) -> Chord {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// Parts of `chord` on both sides of `hole`.
fn without(chord: Chord, hole: Option<Chord>) -> [Chord; 2] {
    let [start, end] = chord;
    match hole {
        Some([from, to]) => [[start, end.min(from)], [start.max(to), end]],
        None => [chord, [end, end]],
    }
}

/// The start of the first piece that does not end behind the origin.
fn first_gap(pieces: &[Chord; 2]) -> Option<f64> {
    let met = pieces.iter().find(|[start, end]| start < end && *end >= 0.0)?;
    met[0].is_finite().then_some(met[0])
}
