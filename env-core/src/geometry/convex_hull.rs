//! Convex hull of a surface to within a tolerance.
//!
//! Quickhull: from a tetrahedron on, the point that is farthest outside is added, and joined to the
//! edges of the facets that it sees. No point is added that is nearer than the tolerance, so the
//! points of the hull are farther apart than that, a finely meshed round surface gets few facets,
//! and rounding decides nothing.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use nalgebra::{Point3, Vector3};

use super::Surface;

/// Depth below a facet's plane, relative to the tolerance, to which a point still sees the facet.
/// It is far above rounding, so a point in the plane is not joined to the facet's edges.
const COPLANAR: f64 = 1e-6;

impl Surface {
    /// Returns the convex hull of some of the vertices, such that none of the others lies farther
    /// than `tolerance` (m, above 0) outside the plane of a triangle; `None` for a surface that is
    /// flat to within it.
    pub(crate) fn convex_hull(&self, tolerance: f64) -> Option<Self> {
        let mut hull = Hull::new(self.vertices(), tolerance)?;
        while let Some(farthest) = hull.farthest() {
            hull.add(farthest)?;
        }
        let corners = || hull.facets.values().map(|facet| facet.corners);
        let used: Vec<_> = corners().flatten().collect::<BTreeSet<_>>().into_iter().collect();
        let place: HashMap<_, _> = used.iter().zip(0..).collect();
        let vertices = used.iter().map(|&i| self.vertices()[i as usize]).collect();
        let triangles = corners().map(|corners| corners.map(|i| place[&i])).collect();
        Some(Self::from_parts(vertices, triangles))
    }
}

/// A point that lies outside a facet's plane.
#[derive(Clone, Copy)]
struct Outside {
    point: u32,
    height: f64,
    facet: usize,
}

/// A triangle of the hull, counter-clockwise seen from outside.
struct Facet {
    corners: [u32; 3],
    normal: Vector3<f64>,
    /// Points that are farther outside than the tolerance; each waits at one facet.
    waiting: Vec<u32>,
    farthest: Option<Outside>,
}

impl Facet {
    fn edges(&self) -> [(u32, u32); 3] {
        let [a, b, c] = self.corners;
        [(a, b), (b, c), (c, a)]
    }
}

struct Hull<'a> {
    points: &'a [Point3<f64>],
    tolerance: f64,
    /// Facets in the order in which they were made.
    facets: BTreeMap<usize, Facet>,
    /// Facet of each directed edge.
    beside: HashMap<(u32, u32), usize>,
    made: usize,
}

impl<'a> Hull<'a> {
    /// Creates the tetrahedron to begin with.
    fn new(points: &'a [Point3<f64>], tolerance: f64) -> Option<Self> {
        let at = |i: u32| points[i as usize];
        let farthest = |measure: &dyn Fn(&Point3<f64>) -> f64| {
            let all = points.iter().zip(0..).map(|(p, i)| (measure(p), i));
            let (most, i) = all.max_by(|a, b| a.0.total_cmp(&b.0))?;
            (most > tolerance).then_some(i)
        };
        let first = *points.first()?;
        let a = farthest(&|p| (p - first).norm())?;
        let b = farthest(&|p| (p - at(a)).norm())?;
        let along = (at(b) - at(a)).normalize();
        let c = farthest(&|p| (p - at(a)).cross(&along).norm())?;
        let across = along.cross(&(at(c) - at(a))).normalize();
        let d = farthest(&|p| (p - at(a)).dot(&across).abs())?;
        let [b, c] = if (at(d) - at(a)).dot(&across) > 0.0 { [c, b] } else { [b, c] };
        let (facets, beside) = (BTreeMap::new(), HashMap::new());
        let mut hull = Self { points, tolerance, facets, beside, made: 0 };
        hull.join(&[[a, b, c], [a, c, d], [c, b, d], [b, a, d]])?;
        hull.wait(0..points.len() as u32, 0);
        Some(hull)
    }

    /// Height of a point above the plane of a facet (m).
    fn height(&self, facet: &Facet, point: u32) -> f64 {
        let corner = self.points[facet.corners[0] as usize];
        facet.normal.dot(&(self.points[point as usize] - corner))
    }

    /// Makes facets with these corners; `None` if one has no normal.
    fn join(&mut self, triangles: &[[u32; 3]]) -> Option<()> {
        for &corners in triangles {
            let [a, b, c] = corners.map(|i| self.points[i as usize]);
            let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
            let facet = Facet { corners, normal, waiting: Vec::new(), farthest: None };
            self.beside.extend(facet.edges().map(|edge| (edge, self.made)));
            self.facets.insert(self.made, facet);
            self.made += 1;
        }
        Some(())
    }

    /// Lets each of the points wait at that of the facets from `first` on which it is highest
    /// above, if it is above one by more than the tolerance.
    fn wait(&mut self, points: impl Iterator<Item = u32>, first: usize) {
        for point in points {
            let heights = self.facets.range(first..).map(|(&facet, f)| Outside {
                point,
                height: self.height(f, point),
                facet,
            });
            let Some(highest) = heights.max_by(|a, b| a.height.total_cmp(&b.height)) else {
                return;
            };
            if highest.height <= self.tolerance {
                continue;
            }
            if let Some(facet) = self.facets.get_mut(&highest.facet) {
                facet.waiting.push(point);
                let before = facet.farthest.filter(|before| before.height >= highest.height);
                facet.farthest = before.or(Some(highest));
            }
        }
    }

    /// Returns the point that is farthest outside, if one is outside by more than the tolerance.
    fn farthest(&mut self) -> Option<Outside> {
        let farthest = |hull: &Self| {
            let all = hull.facets.values().filter_map(|facet| facet.farthest);
            all.max_by(|a, b| a.height.total_cmp(&b.height))
        };
        farthest(self).or_else(|| {
            // A point may be above no facet of those that replace its own by more than the
            // tolerance, and yet be so above another.
            let corners: BTreeSet<_> = self.facets.values().flat_map(|f| f.corners).collect();
            let others = (0..self.points.len() as u32).filter(|i| !corners.contains(i));
            self.wait(others, 0);
            farthest(self)
        })
    }

    /// Adds a point: the facets that it sees give way to facets between it and their rim. `None` if
    /// the facets are no closed surface.
    fn add(&mut self, Outside { point, facet, .. }: Outside) -> Option<()> {
        let (mut seen, mut next, mut rim) = (BTreeSet::from([facet]), vec![facet], Vec::new());
        while let Some(facet) = next.pop() {
            for (a, b) in self.facets.get(&facet)?.edges() {
                let other = *self.beside.get(&(b, a))?;
                if seen.contains(&other) {
                    continue;
                }
                let is_seen =
                    self.height(self.facets.get(&other)?, point) > -COPLANAR * self.tolerance;
                if is_seen {
                    seen.insert(other);
                    next.push(other);
                } else {
                    rim.push([a, b, point]);
                }
            }
        }
        let mut waiting = Vec::new();
        for facet in seen {
            let facet = self.facets.remove(&facet)?;
            for edge in facet.edges() {
                self.beside.remove(&edge);
            }
            waiting.extend(facet.waiting);
        }
        let first = self.made;
        self.join(&rim)?;
        self.wait(waiting.into_iter().filter(|&i| i != point), first);
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;

    /// Farthest that a vertex of `surface` lies outside the plane of a triangle of `hull` (m).
    fn outside(hull: &Surface, surface: &Surface) -> f64 {
        let heights = hull.triangles().iter().flat_map(|corners| {
            let [a, b, c] = corners.map(|i| hull.vertices()[i as usize]);
            let normal = (b - a).cross(&(c - a)).normalize();
            surface.vertices().iter().map(move |v| normal.dot(&(v - a)))
        });
        heights.fold(0.0, f64::max)
    }

    #[test]
    fn no_vertex_is_farther_outside_than_the_tolerance() {
        let ball = Surface::radial(160, |_| 0.025);
        assert_eq!(ball.triangles().len(), 20_480);
        let can = [[0.0, -0.025], [0.02, -0.025], [0.02, 0.025], [0.0, 0.025]];
        let can = Surface::revolved(&can, 1024, 0.0);
        let lens = |k: u32| {
            let angle = 0.1 * f64::from(k) / 40.0;
            [0.3 * angle.sin(), 0.3 * (angle.cos() - 0.1f64.cos())]
        };
        let lens: Vec<_> = [[0.0, 0.0]].into_iter().chain((1..=40).rev().map(lens)).collect();
        let lens = Surface::revolved(
            &[&lens[..], &[[0.0, 0.3 * (1.0 - 0.1f64.cos())]]].concat(),
            200,
            0.0,
        );
        for (surface, most) in [(&ball, 2500), (&can, 200), (&lens, 200)] {
            let volume = surface.mass_properties(1.0).mass;
            for relative in [1e-3, 4e-3] {
                let tolerance = relative * surface.size();
                let hull = surface.convex_hull(tolerance).unwrap();
                let (count, found) = (hull.vertices().len(), outside(&hull, surface));
                assert!(found <= 1.000_001 * tolerance, "{found} m for {tolerance} m");
                assert!(count < most, "{count} vertices");
                let checked = Surface::new("hull", hull.vertices(), hull.triangles());
                assert_eq!(checked.as_ref(), Ok(&hull));
                let ratio = hull.mass_properties(1.0).mass / volume;
                assert!(ratio < 1.0 + 1e-9, "{ratio} times the volume of what is inside");
            }
        }
    }

    #[test]
    fn a_hull_of_few_vertices_is_exact() {
        let half = nalgebra::Vector3::new(0.01, 0.02, 0.03);
        let cuboid = Surface::cuboid(&half);
        let hull = cuboid.convex_hull(1e-5).unwrap();
        assert_eq!((hull.vertices().len(), hull.triangles().len()), (8, 12));
        let [found, exact] = [&hull, &cuboid].map(|s| s.mass_properties(1.0).mass);
        assert!((found / exact - 1.0).abs() < 1e-12, "{found} m³ for {exact} m³");
        let cup = Shape::Cup { bottom: 0.02, rim: 0.03, half_height: 0.03, wall: 2e-3 };
        let cup = cup.surface(16).unwrap();
        // The outer polygons at the bottom and the rim.
        assert_eq!(cup.convex_hull(1e-5).unwrap().vertices().len(), 32);
        assert!(Surface::cuboid(&half).convex_hull(0.1).is_none(), "flat to within 10 cm");
    }
}
