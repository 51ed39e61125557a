//! Part of a pad's face that rigid shapes would cover if the gel deformed nowhere else.

use std::{collections::HashSet, f64::consts::FRAC_PI_4};

use nalgebra::{Isometry3, Point3};

use super::{PadOutline, Shape};

/// Places on the undeformed face that shapes cover.
#[derive(Clone, Debug)]
pub struct Footprint {
    /// Middles of squares of the face in plan.
    places: Vec<Point3<f64>>,
}

/// Distance between the places at which a face is searched first, for whether shapes are near (m).
pub(crate) const COARSE: f64 = 4e-4;
/// Distance between the places that are searched near shapes, and side of the squares of a
/// footprint (m).
const FINE: f64 = 1e-4;

impl Footprint {
    /// Finds what `shapes` at these poses in the frame of the pad cover of its face: the places
    /// whose distance to the nearest shape is less than `most` of the least distance of all (m,
    /// below zero inside). It is empty where the face is farther from all of them than 0.4 mm.
    pub fn new(
        outline: &PadOutline,
        shapes: &[(&Shape, Isometry3<f64>)],
        most: impl Fn(f64) -> f64,
    ) -> Self {
        let gap = |p: &Point3<f64>| {
            let gaps = shapes.iter().map(|(shape, pose)| gap(shape, pose, p));
            gaps.fold(f64::INFINITY, f64::min)
        };
        let coarse = face(outline, COARSE).into_iter().filter(|p| gap(p) < COARSE);
        let mut places: Vec<_> = coarse.flat_map(|p| finer(outline, &p)).collect();
        let most = most(places.iter().map(gap).fold(f64::INFINITY, f64::min));
        places.retain(|p| gap(p) < most);
        places.sort_unstable_by_key(square);
        places.dedup_by_key(|p| square(p));
        Self { places }
    }

    /// Mean width (m): four times the area over the perimeter, which is the diameter of a disc and
    /// twice the thickness of a ring.
    pub(crate) fn width(&self) -> f64 {
        width_of(&self.places.iter().map(square).collect())
    }

    /// At most `most` places, spread evenly.
    pub fn places(self, most: usize) -> Vec<Point3<f64>> {
        let every = self.places.len().div_ceil(most).max(1);
        self.places.into_iter().step_by(every).collect()
    }
}

/// Distance (m) of a point from a shape, below zero inside.
pub(crate) fn gap(shape: &Shape, pose: &Isometry3<f64>, point: &Point3<f64>) -> f64 {
    shape.distance(&pose.inverse_transform_point(point)).value
}

/// Places on the face, `apart` (m) from each other.
pub(crate) fn face(outline: &PadOutline, apart: f64) -> Vec<Point3<f64>> {
    let line = |extent: f64| {
        let count = (extent / apart).ceil() as usize;
        (0..=count).map(move |i| (i as f64 / count as f64 - 0.5) * extent)
    };
    let place = |x: f64, y: f64| Point3::new(x, y, outline.height(x, y));
    line(outline.width).flat_map(|x| line(outline.length).map(move |y| place(x, y))).collect()
}

/// Places on the face around one of those that are [`COARSE`].
pub(crate) fn finer(outline: &PadOutline, place: &Point3<f64>) -> Vec<Point3<f64>> {
    let count = (COARSE / FINE).ceil() as i32;
    let (x, y) = (place.x, place.y);
    let step = |i: i32| f64::from(i) * FINE;
    let all = (-count / 2..=count / 2)
        .flat_map(|i| (-count / 2..=count / 2).map(move |j| (x + step(i), y + step(j))));
    let within =
        |(x, y): &(f64, f64)| x.abs() <= 0.5 * outline.width && y.abs() <= 0.5 * outline.length;
    all.filter(within).map(|(x, y)| Point3::new(x, y, outline.height(x, y))).collect()
}

/// Numbers of the square of a place, along x and y.
fn square(place: &Point3<f64>) -> [i64; 2] {
    [place.x, place.y].map(|x| (x / FINE).round() as i64)
}

/// Mean width (m) of a region of `squares` with sides of [`FINE`].
fn width_of(squares: &HashSet<[i64; 2]>) -> f64 {
    let sides = |[x, y]: &[i64; 2]| {
        let around = [[x - 1, *y], [x + 1, *y], [*x, y - 1], [*x, y + 1]];
        around.iter().filter(|square| !squares.contains(*square)).count()
    };
    // Along a smooth boundary there are 4/π times as many sides as it is long, on average.
    let perimeter = FRAC_PI_4 * squares.iter().map(sides).sum::<usize>() as f64;
    4.0 * squares.len() as f64 / perimeter.max(1.0) * FINE
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn a_disc_is_as_wide_as_its_diameter_and_a_ring_as_twice_its_thickness() {
        let between = |low: f64, high: f64| {
            let squares = (-60..=60).flat_map(|x| (-60..=60).map(move |y| [x, y]));
            let far = |[x, y]: &[i64; 2]| (*x as f64).hypot(*y as f64);
            squares.filter(|square| (low..high).contains(&far(square))).collect()
        };
        for (low, high, width) in [(0.0, 20.0, 40.0), (0.0, 50.0, 100.0), (40.0, 46.0, 12.0)] {
            let found = width_of(&between(low, high)) / FINE;
            assert!((found / width - 1.0).abs() < 0.05, "{found} for {width}");
        }
        assert!(width_of(&HashSet::new()) == 0.0);
    }

    #[test]
    fn a_ball_covers_the_disc_in_which_it_cuts_a_flat_face() {
        let outline = PadOutline::flat(0.02, 0.02, 0.004);
        let (radius, depth) = (4e-3, 5e-4);
        let ball = Shape::Sphere { radius };
        let at = |z| Isometry3::translation(1e-3, -2e-3, z);
        let found = Footprint::new(&outline, &[(&ball, at(radius - depth))], |_| 0.0);
        let reach = f64::sqrt(depth * (2.0 * radius - depth));
        assert!((found.width() / (2.0 * reach) - 1.0).abs() < 0.03, "{}", found.width());
        let places = found.places(100);
        assert!((50..=100).contains(&places.len()));
        for place in places {
            assert!((place.coords - Vector3::new(1e-3, -2e-3, 0.0)).norm() < reach);
        }
        let above = Footprint::new(&outline, &[(&ball, at(radius + 1e-3))], |least| 1.2 * least);
        assert!(above.places(100).is_empty());
    }
}
