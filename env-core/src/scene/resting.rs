//! Orientation in which an object rests on a table: released with its frame upright, it settles in
//! a scene without a hand near by.

use nalgebra::{UnitQuaternion, Vector3};

use super::{ObjectModel, Scene, SceneConfig, SceneObject, units};
use crate::{Result, geometry::Shape};

/// Largest angle that is attributed to the solver's rounding (rad).
const UPRIGHT: f64 = 0.01;
/// Distance from a triangle's edge, relative to its length, within which a point outside counts as
/// inside.
const ROUNDING: f64 = 1e-3;

impl ObjectModel {
    /// Creates the model of `shape`; a shape without a finite surface, or with too many triangles,
    /// is an error.
    pub fn new(shape: Shape) -> Result<Self> {
        let mut model = Self::unsettled(shape)?;
        model.resting = model.settle();
        Ok(model)
    }

    /// Orientation in which the solid comes to rest when released with its frame upright.
    fn settle(&self) -> UnitQuaternion<f64> {
        /// Steps in which a rocking body of hand size comes to rest under the damping of
        /// `Scene::settle`.
        const STEPS: usize = 750;
        let pose = self.rest(1.0, 0.0, 0.0, 0.0);
        let object = SceneObject { model: self, scale: 1.0, mass: 0.1, friction: 1.0, pose };
        let away = Vector3::new(0.0, 0.0, 0.25);
        let Ok(mut scene) = Scene::new(&SceneConfig::default(), &object, &away, 0.0) else {
            return self.resting;
        };
        let rotation = scene.settle(STEPS);
        // Turn back about z, so that a yaw of 0 keeps its meaning.
        let x = rotation * Vector3::x();
        let yaw = if x.xy().norm() > 0.1 { x.y.atan2(x.x) } else { 0.0 };
        let tilt = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -yaw) * rotation;
        // A body that did not move keeps its exact orientation, without the solver's rounding.
        if tilt.angle() < UPRIGHT { UnitQuaternion::identity() } else { self.laid_flat(tilt) }
    }

    /// Returns `rotation`, turned so that the hull's face nearest to the table lies flat on it,
    /// because the solver's slow roll may end on an edge. Returns it unchanged if the collider is
    /// not a hull or the face is off by rounding only. A hull stands only on faces that contain the
    /// projection of the centre of mass onto their plane.
    fn laid_flat(&self, rotation: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        let Some(hull) = self.collider.as_convex_polyhedron() else { return rotation };
        let center = self.solid.center.coords * units::UNIT;
        let corner = |i: u32| {
            let p = hull.points()[i as usize];
            Vector3::new(f64::from(p.x), f64::from(p.y), f64::from(p.z))
        };
        let (_, triangles) = hull.to_trimesh();
        let down = rotation.inverse_transform_vector(&-Vector3::z());
        let normals = triangles.iter().filter_map(|triangle| {
            let [a, b, c] = triangle.map(corner);
            let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
            let foot = center - normal * normal.dot(&(center - a));
            let inside = |p: &Vector3<f64>, q: &Vector3<f64>| {
                (q - p).cross(&(foot - p)).dot(&normal) > -ROUNDING * (q - p).norm_squared()
            };
            (inside(&a, &b) && inside(&b, &c) && inside(&c, &a)).then_some(normal)
        });
        let nearest = normals.max_by(|m, n| m.dot(&down).total_cmp(&n.dot(&down)));
        let turn = nearest.and_then(|n| UnitQuaternion::rotation_between(&n, &down));
        turn.filter(|turn| turn.angle() > UPRIGHT).map_or(rotation, |turn| rotation * turn)
    }
}
