//! Regularised unilateral contact and Coulomb friction at one surface point, per unit of area.
//!
//! The pressure is p = k δ at depth δ ≥ 0 with k = E/ℓ: it equals Young's modulus at a depth of the
//! softness ℓ. Friction is a spring of stiffness h = k/4 to the place where the point sticks, its
//! force limited to μp (Wriggers 2006, ch. 5: return mapping), so that elastic slip is at most 4μδ.
//! With the limit c = μp held fixed, friction has the potential H(s) = h s²/2 for hs ≤ c, else c s
//! − c²/2h. It is then a minimisation too, repeated until c has converged.

use nalgebra::{Matrix3, Vector3};

use super::{Bend, SurfacePoint, Touch};
use crate::{Error, Result, sensor::MOST_FRICTION};

/// Regularised contact with Coulomb friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactLaw {
    /// Depth at which the pressure equals Young's modulus (m).
    pub softness: f64,
    /// Coefficient of friction μ.
    pub friction: f64,
}

/// Traction of the shape on the body at a touching point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Traction {
    /// Part along the shape's normal, which pushes the body out (Pa).
    pub normal: Vector3<f64>,
    /// Tangential part, from friction (Pa).
    pub tangential: Vector3<f64>,
}

/// Part of the friction limit from which a point counts as sliding.
const USED_UP: f64 = 0.98;

/// Returns an error unless `friction` is a coefficient of friction, of `most` at most.
pub(crate) fn check_friction(friction: f64, most: f64) -> Result<()> {
    if (0.0..=most).contains(&friction) {
        return Ok(());
    }
    let expected = format!("a coefficient from 0 to {most}");
    Err(Error::invalid("friction", friction, expected))
}

impl ContactLaw {
    /// Returns a law with a `friction` coefficient from 0 to 100 and a `softness` above 0 m.
    pub fn new(softness: f64, friction: f64) -> Result<Self> {
        if !(softness.is_finite() && softness > 0.0) {
            return Err(Error::invalid("softness", softness, "a finite depth above 0 m"));
        }
        check_friction(friction, MOST_FRICTION)?;
        Ok(Self { softness, friction })
    }

    /// Depth at which the pressure is ten times Young's modulus (m): a deeper point is checked for
    /// having passed through the shape, and no shape may enter held faces deeper.
    pub fn deep(&self) -> f64 {
        10.0 * self.softness
    }

    /// Normal stiffness k (Pa/m).
    fn stiffness(&self, point: &SurfacePoint) -> f64 {
        point.young / self.softness
    }

    /// Stiffness h of a sticking point (Pa/m).
    fn stick_stiffness(&self, point: &SurfacePoint) -> f64 {
        0.25 * self.stiffness(point)
    }

    /// Normal compliance of a point, 1/(kA) (m/N).
    pub fn give(&self, point: &SurfacePoint) -> f64 {
        1.0 / (self.stiffness(point) * point.area)
    }

    /// Tangential compliance of a sticking point, 1/(hA) (m/N).
    pub fn stick_give(&self, point: &SurfacePoint) -> f64 {
        1.0 / (self.stick_stiffness(point) * point.area)
    }

    /// Friction limit c = μp of a touching point (Pa).
    pub fn limit(&self, point: &SurfacePoint, touch: &Touch) -> f64 {
        self.friction * self.stiffness(point) * touch.depth
    }

    /// Share of the normal force of a contact that its sliding points bear: those whose friction is
    /// at its limit. `forces` are the force on each point and the outward normal of the shape
    /// there; 0 without contact.
    ///
    /// Sliding begins at the rim of a contact and spreads inwards (Cattaneo, Mindlin); optical
    /// fingertips detect it in the non-uniform motion of their markers (Hu et al.,
    /// arXiv:2303.00935, on a GelSight Mini).
    pub fn sliding_share(
        &self,
        forces: impl IntoIterator<Item = (Vector3<f64>, Vector3<f64>)>,
    ) -> f64 {
        let (mut sliding, mut all) = (0.0, 0.0);
        for (force, normal) in forces {
            let pressing = force.dot(&normal).max(0.0);
            all += pressing;
            if self.slides(&force, &normal) {
                sliding += pressing;
            }
        }
        if all > 0.0 { sliding / all } else { 0.0 }
    }

    /// Returns whether the friction in the `force` on a point, where the shape has this outward
    /// `normal`, is at its limit.
    pub fn slides(&self, force: &Vector3<f64>, normal: &Vector3<f64>) -> bool {
        let pressing = force.dot(normal).max(0.0);
        (force - normal * pressing).norm() >= USED_UP * self.friction * pressing
    }

    /// Energy (J/m²) with friction limited to `limit` (Pa).
    pub fn energy(&self, point: &SurfacePoint, touch: &Touch, limit: f64) -> f64 {
        let (h, slip) = (self.stick_stiffness(point), touch.slip.norm());
        let friction = if h * slip <= limit {
            0.5 * h * slip * slip
        } else {
            limit * (slip - 0.5 * limit / h)
        };
        0.5 * self.stiffness(point) * touch.depth * touch.depth + friction
    }

    /// Traction: minus the gradient of the energy with respect to the point's position.
    pub fn traction(&self, point: &SurfacePoint, touch: &Touch, limit: f64) -> Traction {
        let (h, slip) = (self.stick_stiffness(point), touch.slip.norm());
        let spring = if h * slip <= limit { h } else { limit / slip };
        Traction {
            normal: self.stiffness(point) * touch.depth * touch.normal,
            tangential: -spring * touch.slip,
        }
    }

    /// Second derivative of the energy with respect to the point's position (Pa/m), without the
    /// term of the shape's curvature: where that term matters it is negative and would spoil the
    /// descent.
    pub fn hessian(&self, point: &SurfacePoint, touch: &Touch, limit: f64) -> Matrix3<f64> {
        let (k, n) = (self.stiffness(point), touch.normal);
        let normal = n * n.transpose();
        let tangential = Matrix3::identity() - normal;
        let (h, slip) = (self.stick_stiffness(point), touch.slip.norm());
        if self.friction == 0.0 {
            return k * normal;
        }
        if h * slip <= limit {
            return k * normal + h * tangential;
        }
        let along = touch.slip / slip;
        k * normal + limit / slip * (tangential - along * along.transpose())
    }

    /// Term that [`ContactLaw::hessian`] leaves out and that appears when the limit follows the
    /// depth: the derivative of −`tangential` with respect to the point's position, μk ŝ ⊗ (−n)
    /// (Pa/m). `None` where the point sticks.
    pub fn limit_coupling(&self, point: &SurfacePoint, touch: &Touch) -> Option<Matrix3<f64>> {
        let (k, slip) = (self.stiffness(point), touch.slip.norm());
        let slips =
            self.friction > 0.0 && self.stick_stiffness(point) * slip > self.limit(point, touch);
        let along = touch.slip / slip;
        slips.then(|| -self.friction * k * along * touch.normal.transpose())
    }

    /// Term that appears at a point that slips, or has no friction, when the shape is curved, and
    /// that [`ContactLaw::hessian`] leaves out: the derivative of minus the traction with respect
    /// to the normal n, times ∂n/∂x (Pa/m). With s the slip, it is −k δ ∂n/∂x − μp/|s| ((1 − ŝ ⊗ ŝ)
    /// ∂n/∂x (n·w) + n ⊗ ∂n/∂x s), where w leads from the sticking place to the point.
    pub fn curvature_term(&self, point: &SurfacePoint, touch: &Touch, bend: &Bend) -> Matrix3<f64> {
        let (turn, pressure) = (&bend.turn, self.stiffness(point) * touch.depth);
        if self.friction == 0.0 {
            return -pressure * turn;
        }
        let along = touch.slip.normalize();
        let across = turn - along * (along.transpose() * turn);
        let turned = across * bend.lift + touch.normal * (turn * touch.slip).transpose();
        -pressure * (turn + self.friction / touch.slip.norm() * turned)
    }

    /// Force of the shape on a touching point (N).
    pub fn force(&self, point: &SurfacePoint, touch: &Touch) -> Vector3<f64> {
        let traction = self.traction(point, touch, self.limit(point, touch));
        (traction.normal + traction.tangential) * point.area
    }

    /// New sticking place relative to the point's position (m), such that the spring keeps its
    /// force.
    pub fn stuck_at(&self, point: &SurfacePoint, touch: &Touch) -> Vector3<f64> {
        let traction = self.traction(point, touch, self.limit(point, touch));
        traction.tangential / self.stick_stiffness(point)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Point3};

    use super::*;
    use crate::{contact::ContactStep, deformation::Anchor, geometry::Shape};

    const LAW: ContactLaw = ContactLaw { softness: 1e-6, friction: 0.6 };

    fn point() -> SurfacePoint {
        SurfacePoint { shares: vec![(0, 1.0)], area: 1e-7, young: 2e5 }
    }

    /// A touch of the half-space z < 0 that has slipped from the origin.
    fn touch(place: Vector3<f64>) -> Touch {
        let slip = Vector3::new(place.x, place.y, 0.0);
        let (normal, depth) = (Vector3::z(), -place.z);
        Touch { shape: 0, point: 0, place: Point3::from(place), depth, normal, slip }
    }

    /// Position of a sticking point and of a slipping one.
    fn places() -> [Vector3<f64>; 2] {
        [Vector3::new(1e-7, 5e-8, -4e-7), Vector3::new(1e-6, -2e-6, -4e-7)]
    }

    #[test]
    fn traction_and_hessian_are_derivatives_of_the_energy() {
        let point = point();
        for place in places() {
            let limit = LAW.limit(&point, &touch(place));
            let traction = LAW.traction(&point, &touch(place), limit);
            let exact = -(traction.normal + traction.tangential);
            let hessian = LAW.hessian(&point, &touch(place), limit);
            for i in 0..3 {
                let step = 1e-12;
                let moved = |d: f64| touch(place + Vector3::ith(i, d));
                let energy = |d: f64| LAW.energy(&point, &moved(d), limit);
                let slope = (energy(step) - energy(-step)) / (2.0 * step);
                // Truncation (step/slip)² and rounding 1e-16 slip/step are both below 1e-7.
                let error = (slope - exact[i]).abs() / exact.norm();
                assert!(error < 1e-6, "{place} {i}: {slope} Pa against {} Pa", exact[i]);
                let force = |d: f64| {
                    let t = LAW.traction(&point, &moved(d), limit);
                    -(t.normal + t.tangential)
                };
                let column = (force(step) - force(-step)) / (2.0 * step);
                let error = (column - hessian.column(i)).norm() / hessian.norm();
                assert!(error < 1e-6, "{place} {i}: relative error {error:.1e}");
            }
        }
    }

    #[test]
    fn the_limit_follows_the_depth() {
        let (point, step) = (point(), 1e-12);
        let tangential = |place: Vector3<f64>| {
            let touch = touch(place);
            LAW.traction(&point, &touch, LAW.limit(&point, &touch)).tangential
        };
        let [stuck, slipping] = places();
        assert!(LAW.limit_coupling(&point, &touch(stuck)).is_none());
        let coupling = LAW.limit_coupling(&point, &touch(slipping)).unwrap();
        let up = Vector3::z() * step;
        let change = -(tangential(slipping + up) - tangential(slipping - up)) / (2.0 * step);
        let error = (change - coupling.column(2)).norm() / coupling.norm();
        assert!(error < 1e-6, "relative error {error:.1e}");
    }

    #[test]
    fn curvature_completes_the_derivative_at_a_point_that_moves_along_a_ball() {
        let (surface, shapes) = ([point()], [Shape::Sphere { radius: 1e-3 }]);
        let stuck = Point3::new(0.0, 6e-4, 8e-4);
        let anchors = [Anchor { shape: 0, point: 0, place: stuck }];
        let poses = vec![Isometry3::identity()];
        let mut step = ContactStep::new(&shapes, &surface, poses.clone(), vec![stuck], &anchors);
        let place = Point3::from(Vector3::new(5e-5, 6e-4, 8e-4).normalize() * (1e-3 - 4e-7));
        let (here, d) = (step.touches(&poses, &[place])[0], 1e-10);
        for law in [LAW, ContactLaw { friction: 0.0, ..LAW }] {
            let mut traction = |place: Point3<f64>| {
                let touch = step.touches(&poses, &[place])[0];
                let traction = law.traction(&surface[0], &touch, law.limit(&surface[0], &touch));
                traction.normal + traction.tangential
            };
            let columns = [0, 1, 2].map(|i| {
                let aside = Vector3::ith(i, d);
                (traction(place - aside) - traction(place + aside)) / (2.0 * d)
            });
            let exact = Matrix3::from_columns(&columns);
            let limit = law.limit(&surface[0], &here);
            let flat = law.hessian(&surface[0], &here, limit)
                + law.limit_coupling(&surface[0], &here).unwrap_or_default();
            let curved = flat + law.curvature_term(&surface[0], &here, &step.bend(&here, &poses));
            let [without, with] = [flat, curved].map(|found| (found - exact).norm() / exact.norm());
            // Rounding 1e-19 m over the step; the term is as large as depth over radius.
            assert!(
                without > 1e-4 && with < 1e-7,
                "{with:.1e} off, {without:.1e} without the term"
            );
        }
    }

    #[test]
    fn friction_sticks_below_and_slips_at_its_limit() {
        let point = point();
        let [stuck, slipping] = places().map(|place| {
            let touch = touch(place);
            let limit = LAW.limit(&point, &touch);
            LAW.traction(&point, &touch, limit).tangential.norm() / limit
        });
        assert!(stuck < 1.0, "{stuck} of the limit");
        assert!((slipping - 1.0).abs() < 1e-14, "{slipping} of the limit");
    }

    #[test]
    fn a_slipped_point_sticks_where_its_force_stays_the_same() {
        let point = point();
        let slipped = touch(places()[1]);
        let anchor = slipped.place.coords + LAW.stuck_at(&point, &slipped);
        let again = Touch { slip: (slipped.place.coords - anchor), ..slipped };
        let limit = LAW.limit(&point, &slipped);
        let force = |touch: &Touch| LAW.traction(&point, touch, limit).tangential;
        let change = (force(&again) - force(&slipped)).norm() / limit;
        assert!(change < 1e-9, "changed by {change:.1e} of the limit");
    }

    #[test]
    fn a_law_outside_its_range_is_refused() {
        for (softness, friction) in [(0.0, 0.5), (1e-6, -0.1), (1e-6, f64::NAN), (f64::NAN, 0.5)] {
            assert!(ContactLaw::new(softness, friction).is_err(), "{softness} m, {friction}");
        }
    }
}
