//! Solids with distances tabulated on two grids, fast enough for a thousand queries in a control
//! step.
//!
//! Distances are interpolated linearly: within a few millimetres of the surface on a grid of 0.5
//! mm, or 1/80 of the solid's size where that is more; around it on a grid of 3 mm; beyond, they
//! are exact. At radius R the distance near the surface is off by at most h²/4R, 4 µm at 15 mm.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

use super::{Distance, Shape, Surface};

/// A sampled solid and the scale by which it is enlarged.
#[derive(Clone)]
pub struct Sampled(Arc<Samples>, f64);

struct Samples {
    exact: Shape,
    fine: DistanceGrid,
    coarse: DistanceGrid,
}

/// Distances at the nodes of a cubic grid, x fastest.
struct DistanceGrid {
    low: Vector3<f64>,
    spacing: f64,
    counts: [usize; 3],
    values: Vec<f32>,
}

/// Least distance between the nodes of the fine grid (m), and the most cells along an edge of it.
const FINEST: f64 = 5e-4;
const MOST_CELLS: f64 = 80.0;
/// Distance from the surface up to which the nodes of the fine grid are exact (m).
const BAND: f64 = 3e-3;
/// Nodes along an edge of the blocks in which the fine grid is filled.
const BLOCK: usize = 4;
/// Least distance between the nodes of the coarse grid, and its margin beyond the solid (m).
const COARSE: f64 = 3e-3;
const REACH: f64 = 12e-3;

impl Shape {
    /// Returns the same solid with distances that are quick to evaluate: sampled on grids if its
    /// exact distance takes an iteration or a search, unchanged if it has a closed form.
    ///
    /// Everything except [`Shape::distance`] stays exact.
    #[must_use]
    pub fn sampled(&self) -> Self {
        match self {
            Self::Ellipsoid { .. } | Self::StarShaped(_) | Self::Hollow(_) | Self::Mesh(_) => {
                Self::Sampled(Sampled(Samples::shared(self), 1.0))
            }
            _ => self.clone(),
        }
    }
}

impl Sampled {
    /// The solid that was sampled.
    pub fn exact(&self) -> &Shape {
        &self.0.exact
    }

    /// Scale relative to the solid that was sampled.
    pub fn scale(&self) -> f64 {
        self.1
    }

    pub(super) fn scaled(&self, factor: f64) -> Self {
        Self(Arc::clone(&self.0), factor * self.1)
    }

    pub(super) fn surface(&self, segments: u32) -> Option<Surface> {
        self.exact().surface(segments).map(|surface| surface.scaled(self.1))
    }

    pub(super) fn ray_gap(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        self.exact().ray_gap(&(origin / self.1), direction).map(|gap| self.1 * gap)
    }

    pub(super) fn distance(&self, point: &Point3<f64>) -> Distance {
        let found = self.0.distance(&(point / self.1));
        Distance { value: self.1 * found.value, normal: found.normal }
    }

    /// Returns [`Shape::distance_error`] of this solid: interpolation of a distance is off by at
    /// most √3/2 of the nodes' spacing, and that of a star-shaped solid at a node by a thousandth
    /// of the radius, of which the coarse spacing is a fortieth or more.
    pub(super) fn distance_error(&self) -> f64 {
        self.1 * self.0.coarse.spacing
    }
}

impl Serialize for Sampled {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        (self.exact(), self.1).serialize(to)
    }
}

/// The solid is sampled again, unless it is in use.
impl<'de> Deserialize<'de> for Sampled {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let (exact, scale) = <(Shape, f64)>::deserialize(from)?;
        match exact.validated().map_err(D::Error::custom)?.sampled() {
            Shape::Sampled(Self(samples, _)) => Ok(Self(samples, scale)),
            other => Err(D::Error::custom(format!("a {} is not sampled", other.name()))),
        }
    }
}

impl std::fmt::Debug for Sampled {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Sampled({:?}, {})", self.exact(), self.1)
    }
}

impl PartialEq for Sampled {
    fn eq(&self, other: &Self) -> bool {
        self.exact() == other.exact() && self.1 == other.1
    }
}

/// Samples in use, shared by the environments of a process.
static IN_USE: Mutex<Vec<Weak<Samples>>> = Mutex::new(Vec::new());

impl Samples {
    /// Returns the samples of `exact` that are in use, or new ones.
    fn shared(exact: &Shape) -> Arc<Self> {
        if let Some(samples) = Self::in_use(exact, None) {
            return samples;
        }
        // The lock is not held meanwhile, so that other shapes can be sampled. If the same shape is
        // sampled twice at once, the first result is kept.
        let made = Arc::new(Self::new(exact));
        Self::in_use(exact, Some(&made)).unwrap_or(made)
    }

    /// Returns the samples of `exact` that are in use. If there are none, registers `made` and
    /// returns `None`.
    fn in_use(exact: &Shape, made: Option<&Arc<Self>>) -> Option<Arc<Self>> {
        let mut kept = IN_USE.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|samples| samples.strong_count() > 0);
        let found = kept.iter().filter_map(Weak::upgrade).find(|samples| samples.exact == *exact);
        if found.is_none() {
            kept.extend(made.map(Arc::downgrade));
        }
        found
    }

    fn new(exact: &Shape) -> Self {
        let surface = exact.surface(32).expect("what is sampled has a finite surface");
        let (low, high) = surface.bounds();
        let size = (high - low).max();
        let spacing = FINEST.max(size / MOST_CELLS);
        let mut fine = DistanceGrid::around(low, high, BAND.max(2.0 * spacing), spacing);
        fine.sample_band(exact);
        let spacing = COARSE.max(size / MOST_CELLS);
        let mut coarse = DistanceGrid::around(low, high, REACH, spacing);
        coarse.sample(exact);
        Self { exact: exact.clone(), fine, coarse }
    }

    fn distance(&self, point: &Point3<f64>) -> Distance {
        let near = |found: &Distance| found.value.abs() < BAND - 2.0 * self.fine.spacing;
        let fine = self.fine.at(&point.coords).filter(near);
        fine.or_else(|| self.coarse.at(&point.coords)).unwrap_or_else(|| self.exact.distance(point))
    }
}

impl DistanceGrid {
    /// Returns a grid of whole blocks of cells over a box and a `margin` (m) around it, with zero
    /// values.
    fn around(low: Point3<f64>, high: Point3<f64>, margin: f64, spacing: f64) -> Self {
        let low = low.coords.add_scalar(-margin);
        let counts = (high.coords - low)
            .map(|edge| ((edge + margin) / spacing).ceil() as usize + 1)
            .map(|count| count.div_ceil(BLOCK) * BLOCK);
        let counts: [usize; 3] = counts.into();
        Self { low, spacing, counts, values: vec![0.0; counts.iter().product()] }
    }

    /// Fills every node with the exact distance.
    fn sample(&mut self, shape: &Shape) {
        let [nx, ny, _] = self.counts;
        for index in 0..self.values.len() {
            let node = [index % nx, index / nx % ny, index / (nx * ny)];
            self.values[index] = shape.distance(&self.node(node).into()).value as f32;
        }
    }

    /// Fills the nodes block by block: with exact distances near the surface, elsewhere with the
    /// distance at the block's middle.
    fn sample_band(&mut self, shape: &Shape) {
        let distance = |at: Vector3<f64>| shape.distance(&Point3::from(at)).value;
        let half = 0.5 * (BLOCK - 1) as f64;
        let reach = 3f64.sqrt() * half * self.spacing;
        let [nx, ny, nz] = self.counts.map(|count| count / BLOCK);
        for block in 0..nx * ny * nz {
            let corner = [block % nx, block / nx % ny, block / (nx * ny)].map(|i| i * BLOCK);
            let middle = self.node(corner).add_scalar(half * self.spacing);
            let of_block = distance(middle);
            let far = of_block.abs() > BAND + reach;
            for i in 0..BLOCK.pow(3) {
                let within = [i % BLOCK, i / BLOCK % BLOCK, i / (BLOCK * BLOCK)];
                let node = [0, 1, 2].map(|axis| corner[axis] + within[axis]);
                let value = if far { of_block } else { distance(self.node(node)) };
                let index = self.index(node);
                self.values[index] = value as f32;
            }
        }
    }

    fn node(&self, [i, j, k]: [usize; 3]) -> Vector3<f64> {
        self.low + Vector3::new(i as f64, j as f64, k as f64) * self.spacing
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.counts[0] * (j + self.counts[1] * k)
    }

    /// Interpolated distance at a place, or `None` outside the grid.
    fn at(&self, place: &Vector3<f64>) -> Option<Distance> {
        let (cell, fraction) = self.cell(place)?;
        let first = self.index(cell);
        let [across, up] = [self.counts[0], self.counts[0] * self.counts[1]];
        let value = |offset: usize| f64::from(self.values[first + offset]);
        let [x, y, z] = fraction.into();
        let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
        let edges = [0, across, up, across + up].map(|row| [value(row), value(row + 1)]);
        let [e0, e1, e2, e3] = edges.map(|[a, b]| mix(a, b, x));
        let (low, high) = (mix(e0, e1, y), mix(e2, e3, y));
        let [g0, g1, g2, g3] = edges.map(|[a, b]| b - a);
        let slope = Vector3::new(
            mix(mix(g0, g1, y), mix(g2, g3, y), z),
            mix(e1 - e0, e3 - e2, z),
            high - low,
        );
        let normal = slope.try_normalize(0.0).unwrap_or(Vector3::z());
        Some(Distance { value: mix(low, high, z), normal })
    }

    /// Cell that contains a place, and the relative position in it.
    fn cell(&self, place: &Vector3<f64>) -> Option<([usize; 3], Vector3<f64>)> {
        let at = (place - self.low) / self.spacing;
        let cell = at.map(f64::floor);
        let inside = |axis: usize| cell[axis] >= 0.0 && cell[axis] + 1.0 < self.counts[axis] as f64;
        (0..3).all(inside).then(|| ([0, 1, 2].map(|axis| cell[axis] as usize), at - cell))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{StarShaped, Wave};

    /// Solids whose smallest radius of curvature is 10 mm: near a sharp edge interpolation is
    /// inaccurate.
    fn smooth() -> [Shape; 2] {
        let semi_axes = Vector3::new(0.016, 0.02, 0.025);
        let wave = Wave { amplitude: 0.03, vector: Vector3::new(3.0, 2.0, 1.0), phase: 0.3 };
        let potato = StarShaped::new(Vector3::new(0.02, 0.02, 0.025), vec![wave]);
        [Shape::Ellipsoid { semi_axes }, Shape::StarShaped(potato)]
    }

    #[test]
    fn a_solid_is_sampled_once_while_it_is_in_use() {
        let semi_axes = Vector3::new(0.011, 0.012, 0.013);
        let (one, other) =
            (Shape::Ellipsoid { semi_axes }, Shape::Ellipsoid { semi_axes: 1.1 * semi_axes });
        let samples = |shape: &Shape| match shape.sampled() {
            Shape::Sampled(Sampled(samples, _)) => samples,
            shape => panic!("{shape:?} is not sampled"),
        };
        let first = samples(&one);
        assert!(Arc::ptr_eq(&first, &samples(&one)));
        assert!(!Arc::ptr_eq(&first, &samples(&other)));
        let gone = Arc::downgrade(&first);
        drop(first);
        assert!(gone.upgrade().is_none(), "nobody uses it");
    }

    #[test]
    fn near_the_surface_the_fine_grid_is_right_to_its_sag() {
        for shape in smooth() {
            let (sampled, exact) = (shape.sampled().scaled(1.2), shape.scaled(1.2));
            for vertex in exact.surface(24).unwrap().vertices() {
                let normal = exact.distance(vertex).normal;
                for depth in [-1.5e-3, -0.5e-3, 0.0, 0.5e-3] {
                    let place = vertex + depth * normal;
                    let (exact, found) = (exact.distance(&place), sampled.distance(&place));
                    let error = (found.value - exact.value).abs();
                    // h²/4R with h = 0.75 mm and R = 12 mm less the depth of 1.5 mm.
                    assert!(error < 1.5e-5, "{shape:?} at {depth} m: off by {error:.1e} m");
                    let turned = found.normal.angle(&exact.normal);
                    assert!(turned < 0.1, "{shape:?} at {depth} m: normal off by {turned:.3} rad");
                }
            }
        }
    }

    #[test]
    fn away_from_it_distance_and_normal_stay_those_of_the_solid() {
        for shape in smooth() {
            let sampled = shape.sampled();
            for vertex in shape.surface(16).unwrap().vertices() {
                let normal = shape.distance(vertex).normal;
                for away in [4e-3, 8e-3, 20e-3] {
                    let place = vertex + away * normal;
                    let (exact, found) = (shape.distance(&place), sampled.distance(&place));
                    let error = (found.value - exact.value).abs();
                    // h²/4R with h = 3 mm and R = 14 mm.
                    assert!(error < 1.8e-4, "{shape:?}, {away} m away: off by {error:.1e} m");
                    let turned = found.normal.angle(&exact.normal);
                    assert!(turned < 0.15, "{shape:?}, {away} m away: off by {turned:.3} rad");
                }
            }
        }
    }

    #[test]
    fn closed_forms_stay_themselves() {
        let ball = Shape::Sphere { radius: 0.01 };
        assert_eq!(ball.sampled(), ball);
        let [_, potato] = smooth();
        assert_eq!(potato.sampled().scaled(2.0), potato.sampled().scaled(2.0));
        assert_ne!(potato.sampled().scaled(2.0), potato.sampled());
    }
}
