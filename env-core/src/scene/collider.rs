//! Shapes as Rapier colliders, with the mass properties of the exact surface and the pose in which
//! the solid rests on a table.

use std::{f64::consts::FRAC_PI_2, sync::OnceLock};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rapier3d::{
    parry::shape::TriMeshFlags,
    prelude::{ColliderBuilder, MassProperties, Matrix, Pose, SharedShape, Vector},
};

use super::{Object, Scene, SceneConfig, units};
use crate::{
    Error, Result,
    geometry::{self, Shape, Surface},
};

/// Flats round a circle. A flat of 16 touches a pad over 0.39 radii, about the patch of a soft pad;
/// with finer ones the wall of a cup touches along a line and pivots.
const SEGMENTS: u32 = 16;
/// Most triangles of a non-convex mesh; past it one contact query costs more than a whole step.
const MOST_TRIANGLES: usize = 20_000;

/// A shape made ready for Rapier once, to be placed in any number of scenes.
#[derive(Clone)]
pub struct ObjectModel {
    shape: Shape,
    surface: Surface,
    collider: SharedShape,
    /// From the collider's frame to the shape's: Rapier's cylinder and cone stand along y.
    upright: UnitQuaternion<f64>,
    /// Of the solid at density 1.
    solid: geometry::MassProperties,
    resting: UnitQuaternion<f64>,
    /// The shape with quick distances: made on first use, and shared by copies made after.
    sampled: OnceLock<Shape>,
}

impl std::fmt::Debug for ObjectModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ObjectModel").field("shape", &self.shape).finish_non_exhaustive()
    }
}

impl ObjectModel {
    /// A model of `shape`; a shape without a finite surface, or with too many triangles, is an
    /// error.
    pub fn new(shape: Shape) -> Result<Self> {
        let shape = shape.validated()?;
        let surface = shape.surface(SEGMENTS).ok_or_else(|| {
            Error::invalid("object", format!("{shape:?}"), "a shape of finite size")
        })?;
        let collider = collider(&shape, &surface)?;
        let upright = match shape {
            Shape::Cylinder { .. } | Shape::Cone { .. } => {
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2)
            }
            _ => UnitQuaternion::identity(),
        };
        let solid = surface.mass_properties(1.0);
        let resting = UnitQuaternion::identity();
        let sampled = OnceLock::new();
        let mut model = Self { shape, surface, collider, upright, solid, resting, sampled };
        model.resting = model.settle();
        Ok(model)
    }

    /// The exact shape.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Its triangles, for a picture.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// The shape with distances that are quick to find, see [`Shape::sampled`].
    pub fn sampled(&self) -> &Shape {
        self.sampled.get_or_init(|| self.shape.sampled())
    }

    /// Radius about the frame's origin that holds the object (m).
    pub(super) fn radius(&self) -> f64 {
        let farthest = self.surface.vertices().iter().map(|v| v.coords.norm());
        // The polygons of the surface may cut what is round.
        1.02 * farthest.fold(0.0, f64::max)
    }

    /// The pose in which the object, `scale` times as large, rests on the table at `x`, `y` (m),
    /// turned by `yaw` (rad).
    pub fn rest(&self, scale: f64, x: f64, y: f64, yaw: f64) -> Isometry3<f64> {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * self.resting;
        let z = -scale * self.lowest(&rotation);
        Isometry3::from_parts(Translation3::new(x, y, z), rotation)
    }

    /// Lowest z of the turned surface (m).
    fn lowest(&self, rotation: &UnitQuaternion<f64>) -> f64 {
        let heights = self.surface.vertices().iter().map(|v| (rotation * v).z);
        heights.fold(f64::INFINITY, f64::min)
    }

    /// The collider, `scale` times as large, without mass of its own.
    pub(super) fn scaled(&self, scale: f64) -> Result<ColliderBuilder> {
        let shape = if scale == 1.0 {
            self.collider.clone()
        } else {
            let scaled = self.collider.scale_dyn(Vector::splat(scale as f32), 0);
            let scaled = scaled.ok_or_else(|| Error::invalid("scale", scale, "above zero"))?;
            SharedShape(scaled.into())
        };
        let pose = Pose::from_rotation(units::rotation(&self.upright));
        Ok(ColliderBuilder::new(shape).position(pose).density(0.0))
    }

    /// Mass properties of a body of `mass` (kg), `scale` times as large, in Rapier's units.
    pub(super) fn mass_properties(&self, mass: f64, scale: f64) -> MassProperties {
        let inertia = self.solid.inertia * (mass / self.solid.mass * (scale * units::UNIT).powi(2));
        let column = |i: usize| {
            Vector::new(inertia[(0, i)] as f32, inertia[(1, i)] as f32, inertia[(2, i)] as f32)
        };
        let inertia = Matrix::from_cols(column(0), column(1), column(2));
        let center = units::vector(&(self.solid.center.coords * scale));
        MassProperties::with_inertia_matrix(center, mass as f32, inertia)
    }

    /// Orientation in which the solid comes to rest when laid down as its frame stands.
    fn settle(&self) -> UnitQuaternion<f64> {
        /// Time in which a rocking body of hand size comes to rest under the damping of `settle`.
        const STEPS: usize = 750;
        let pose = self.rest(1.0, 0.0, 0.0, 0.0);
        let object = Object { model: self, scale: 1.0, mass: 0.1, friction: 1.0, pose };
        let away = Vector3::new(0.0, 0.0, 0.25);
        let Ok(mut scene) = Scene::new(&SceneConfig::default(), &object, &away, 0.0) else {
            return self.resting;
        };
        let rotation = scene.settle(STEPS);
        // Turn back about z, so that "yaw 0" keeps its meaning.
        let x = rotation * Vector3::x();
        let yaw = if x.xy().norm() > 0.1 { x.y.atan2(x.x) } else { 0.0 };
        let tilt = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -yaw) * rotation;
        // A body that stood still keeps its exact orientation, without the solver's rounding.
        if tilt.angle() < UPRIGHT { UnitQuaternion::identity() } else { self.laid_flat(tilt) }
    }

    /// `rotation` with the face that is nearest to the table laid flat on it, where the collider is a hull
    /// and that face is farther off than rounding: the solver's slow roll may end on an edge. A hull stands
    /// on the faces that hold their plane's nearest point to its centre of mass.
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

/// Angle to which the solver's rounding is let go (rad).
const UPRIGHT: f64 = 0.01;
/// Part of an edge by which a point beside a triangle counts as within.
const ROUNDING: f64 = 1e-3;

fn collider(shape: &Shape, surface: &Surface) -> Result<SharedShape> {
    use units::scalar;
    Ok(match shape {
        Shape::Sphere { radius } => SharedShape::ball(scalar(*radius)),
        Shape::Cuboid { half_extents: h } => {
            SharedShape::cuboid(scalar(h.x), scalar(h.y), scalar(h.z))
        }
        Shape::Cylinder { radius, half_height } => {
            SharedShape::cylinder(scalar(*half_height), scalar(*radius))
        }
        Shape::Cone { radius, half_height } => {
            SharedShape::cone(scalar(*half_height), scalar(*radius))
        }
        Shape::Capsule { radius, half_height } => {
            SharedShape::capsule_z(scalar(*half_height), scalar(*radius))
        }
        Shape::Annulus { outer, inner, half_height: h } => {
            SharedShape::compound(wedges([*outer, *outer], [*inner, *inner], [-h, *h])?)
        }
        Shape::Cup { bottom, rim, half_height: h, wall } => {
            let outer = |z: f64| bottom + (rim - bottom) * (z + h) / (2.0 * h);
            let floor = wall - h;
            let inner = [bottom - wall, rim - wall];
            let mut parts = wedges([outer(floor), *rim], inner, [floor, *h])?;
            parts.extend(sectors([*bottom, outer(floor)], [-h, floor])?);
            SharedShape::compound(parts)
        }
        _ => hull_or_triangles(surface)?,
    })
}

/// Share of its volume that a hull may add to a solid: as much as 1.6 % of radius adds to a ball, for
/// a sixth of the time that triangles take.
const HULL_EXCESS: f64 = 0.05;

/// The hull of a nearly convex surface, the triangles of any other.
fn hull_or_triangles(surface: &Surface) -> Result<SharedShape> {
    let hull = hull(&surface_points(surface))?;
    let volume = surface.mass_properties(1.0).mass * units::UNIT.powi(3);
    let excess = f64::from(hull.mass_properties(1.0).mass()) / volume - 1.0;
    if excess < HULL_EXCESS { Ok(hull) } else { triangles(surface) }
}

fn surface_points(surface: &Surface) -> Vec<Vector> {
    surface.vertices().iter().map(|v| units::vector(&v.coords)).collect()
}

fn hull(points: &[Vector]) -> Result<SharedShape> {
    SharedShape::convex_hull(points).ok_or_else(|| Error::BadMesh {
        name: "object".into(),
        reason: format!("no convex hull of its {} points", points.len()),
    })
}

fn triangles(surface: &Surface) -> Result<SharedShape> {
    let bad = |reason| Error::BadMesh { name: "object".into(), reason };
    let count = surface.triangles().len();
    if count > MOST_TRIANGLES {
        let expected = "expected at most 20000 for a shape that is not convex";
        return Err(bad(format!("{count} triangles, {expected}")));
    }
    let flags = TriMeshFlags::ORIENTED | TriMeshFlags::FIX_INTERNAL_EDGES;
    SharedShape::trimesh_with_flags(surface_points(surface), surface.triangles().to_vec(), flags)
        .map_err(|e| bad(e.to_string()))
}

/// A ring as convex wedges between an outer and an inner radius, each given at two heights (m).
fn wedges(outer: [f64; 2], inner: [f64; 2], z: [f64; 2]) -> Result<Vec<(Pose, SharedShape)>> {
    let wedge = |i: u32| {
        let points: Vec<_> = [0, 1]
            .into_iter()
            .flat_map(|end| [outer[end], inner[end]].map(|r| (r, z[end])))
            .flat_map(|(r, z)| [corner(i, r, z), corner(i + 1, r, z)])
            .collect();
        Ok((Pose::IDENTITY, hull(&points)?))
    };
    (0..SEGMENTS).map(wedge).collect()
}

/// A disc as convex sectors of radii given at two heights (m). In one piece its many corners, of which
/// the solver takes now these, now those, let it creep over the table.
fn sectors(radius: [f64; 2], z: [f64; 2]) -> Result<Vec<(Pose, SharedShape)>> {
    const EACH: u32 = SEGMENTS / 4;
    let sector = |part: u32| {
        let end = |end: usize| {
            let arc = move |i| corner(part * EACH + EACH / 2 + i, radius[end], z[end]);
            (0..=EACH).map(arc).chain([corner(0, 0.0, z[end])])
        };
        let points: Vec<_> = [0, 1].into_iter().flat_map(end).collect();
        Ok((Pose::IDENTITY, hull(&points)?))
    };
    (0..4).map(sector).collect()
}

/// Corner `i` of the polygon of radius `r` at height `z`, in Rapier's units.
fn corner(i: u32, r: f64, z: f64) -> Vector {
    // A flat faces the grip axis: between rigid pads, a round wall touches along it only.
    let angle = std::f64::consts::TAU * (f64::from(i) - 0.5) / f64::from(SEGMENTS);
    units::vector(&Vector3::new(r * angle.cos(), r * angle.sin(), z))
}
