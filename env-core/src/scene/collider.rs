//! Rapier colliders of shapes, with the mass properties of the exact surface and the pose in which
//! the solid rests on a table.

use std::{f64::consts::FRAC_PI_2, sync::OnceLock};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rapier3d::{
    parry::shape::TriMeshFlags,
    prelude::{ColliderBuilder, MassProperties, Matrix, Pose, SharedShape, Vector},
};

use super::{hull, units};
use crate::{
    Error, Result,
    geometry::{self, Rounded, Shape, Surface},
};

/// Number of flat faces round a circle. With 16, a face is 0.39 radii wide, about the contact width
/// of a soft pad; with more, the wall of a cup touches along a line and pivots.
const SEGMENTS: u32 = 16;
/// Largest number of triangles of a non-convex mesh; with more, one contact query costs more than a
/// whole step.
const MOST_TRIANGLES: usize = 20_000;

/// A shape prepared for Rapier once, to be placed in any number of scenes.
#[derive(Clone)]
pub struct ObjectModel {
    shape: Shape,
    surface: Surface,
    pub(super) collider: SharedShape,
    /// Rotation from the collider's frame to the shape's: Rapier's cylinder and cone have y as
    /// axis.
    upright: UnitQuaternion<f64>,
    /// Mass properties of the solid at density 1.
    pub(super) solid: geometry::MassProperties,
    /// Orientation of the shape's frame at rest on a table.
    pub(super) resting: UnitQuaternion<f64>,
    /// The shape with fast distance evaluation, created on first use; later clones share it.
    sampled: OnceLock<Shape>,
}

impl std::fmt::Debug for ObjectModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ObjectModel").field("shape", &self.shape).finish_non_exhaustive()
    }
}

impl ObjectModel {
    /// Creates the model of `shape` as if it rested with its frame upright; a shape without a
    /// finite surface, or with too many triangles, is an error.
    pub(super) fn unsettled(shape: Shape) -> Result<Self> {
        let shape = shape.validated()?;
        let surface = shape.surface(SEGMENTS).ok_or_else(|| {
            Error::invalid("object", format!("{shape:?}"), "a shape of finite size")
        })?;
        let collider = collider(&shape, &surface)?;
        let upright = match shape.sharp() {
            Shape::Cylinder { .. } | Shape::Cone { .. } => {
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2)
            }
            _ => UnitQuaternion::identity(),
        };
        let solid = surface.mass_properties(1.0);
        let resting = UnitQuaternion::identity();
        let sampled = OnceLock::new();
        Ok(Self { shape, surface, collider, upright, solid, resting, sampled })
    }

    /// Exact shape of the object.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Triangles of its surface, for rendering.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// The shape with fast distance evaluation, see [`Shape::sampled`].
    pub fn sampled(&self) -> &Shape {
        self.sampled.get_or_init(|| self.shape.sampled())
    }

    /// Radius of a sphere about the frame's origin that contains the object (m).
    pub(super) fn radius(&self) -> f64 {
        let farthest = self.surface.vertices().iter().map(|v| v.coords.norm());
        // The triangles of a round surface may lie inside it.
        1.02 * farthest.fold(0.0, f64::max)
    }

    /// Pose in which the object, scaled by `scale`, rests on the table at `x`, `y` (m), turned by
    /// `yaw` (rad).
    pub fn rest(&self, scale: f64, x: f64, y: f64, yaw: f64) -> Isometry3<f64> {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * self.resting;
        let z = -scale * self.lowest(&rotation);
        Isometry3::from_parts(Translation3::new(x, y, z), rotation)
    }

    /// Radius of an upright cylinder about the frame of the object, scaled by `scale` and at rest
    /// on the table, that contains it (m).
    pub fn rest_radius(&self, scale: f64) -> f64 {
        let turned = self.surface.vertices().iter().map(|v| (self.resting * v).coords.xy().norm());
        scale * turned.fold(0.0, f64::max)
    }

    /// Lowest z of the turned surface (m).
    fn lowest(&self, rotation: &UnitQuaternion<f64>) -> f64 {
        let heights = self.surface.vertices().iter().map(|v| (rotation * v).z);
        heights.fold(f64::INFINITY, f64::min)
    }

    /// Collider scaled by `scale`, without mass of its own.
    pub(super) fn scaled(&self, scale: f64) -> Result<ColliderBuilder> {
        let shape = if scale == 1.0 {
            self.collider.clone()
        } else if matches!(self.shape, Shape::Rounded(_)) {
            // Rapier leaves the radius of an edge as it is.
            collider(&self.shape.scaled(scale), &self.surface.scaled(scale))?
        } else {
            let scaled = self.collider.scale_dyn(Vector::splat(scale as f32), 0);
            let scaled = scaled.ok_or_else(|| Error::invalid("scale", scale, "above zero"))?;
            SharedShape(scaled.into())
        };
        let pose = Pose::from_rotation(units::rotation(&self.upright));
        Ok(ColliderBuilder::new(shape).position(pose).density(0.0))
    }

    /// Mass properties of a body of `mass` (kg) scaled by `scale`, in Rapier's units.
    pub(super) fn mass_properties(&self, mass: f64, scale: f64) -> MassProperties {
        let inertia = self.solid.inertia * (mass / self.solid.mass * (scale * units::UNIT).powi(2));
        let column = |i: usize| {
            Vector::new(inertia[(0, i)] as f32, inertia[(1, i)] as f32, inertia[(2, i)] as f32)
        };
        let inertia = Matrix::from_cols(column(0), column(1), column(2));
        let center = units::vector(&(self.solid.center.coords * scale));
        MassProperties::with_inertia_matrix(center, mass as f32, inertia)
    }
}

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
        Shape::Rounded(rounded) => rounded_collider(rounded, surface)?,
        _ => hull_or_triangles(surface)?,
    })
}

/// Collider of a solid with rounded edges. Those of a cone, an annulus and a cup stay sharp: a hull
/// does not stand on a round base, and their walls are many parts.
fn rounded_collider(rounded: &Rounded, surface: &Surface) -> Result<SharedShape> {
    use units::scalar;
    let edge = rounded.radius();
    Ok(match rounded.sharp() {
        Shape::Cuboid { half_extents } => {
            let inner = half_extents.map(|half| scalar(half - edge));
            SharedShape::round_cuboid(inner.x, inner.y, inner.z, scalar(edge))
        }
        Shape::Cylinder { radius, half_height } => {
            let inner = [half_height - edge, radius - edge].map(scalar);
            SharedShape::round_cylinder(inner[0], inner[1], scalar(edge))
        }
        Shape::Prism { .. } => hull_or_triangles(surface)?,
        sharp => collider(sharp, surface)?,
    })
}

/// Largest relative volume that a hull may add to a solid; 1.6 % of radius add as much to a ball. A
/// hull takes a sixth of the time of triangles.
const HULL_EXCESS: f64 = 0.05;

/// Convex hull of a nearly convex surface, triangles of any other.
fn hull_or_triangles(surface: &Surface) -> Result<SharedShape> {
    let volume = surface.mass_properties(1.0).mass;
    let is_near = |hull: &_| hull::volume(hull) / volume - 1.0 < HULL_EXCESS;
    let hull = hull::of_surface(surface).filter(is_near);
    hull.map_or_else(|| triangles(surface), |hull| Ok(SharedShape::new(hull)))
}

/// Convex hull of the corners of a part.
fn part(points: &[Vector]) -> Result<SharedShape> {
    let hull = hull::of_points(points).ok_or_else(|| {
        let reason = format!("no convex hull of its {} points", points.len());
        Error::BadMesh { name: "object".into(), reason }
    })?;
    Ok(SharedShape::new(hull))
}

fn triangles(surface: &Surface) -> Result<SharedShape> {
    let bad = |reason| Error::BadMesh { name: "object".into(), reason };
    let count = surface.triangles().len();
    if count > MOST_TRIANGLES {
        return Err(bad(format!(
            "{count} triangles, expected at most {MOST_TRIANGLES} for a shape that is not convex{}",
            geometry::simplify(MOST_TRIANGLES)
        )));
    }
    let flags = TriMeshFlags::ORIENTED | TriMeshFlags::FIX_INTERNAL_EDGES;
    SharedShape::trimesh_with_flags(hull::vertices(surface), surface.triangles().to_vec(), flags)
        .map_err(|e| bad(e.to_string()))
}

/// Ring as convex wedges between an outer and an inner radius, each given at two heights (m).
fn wedges(outer: [f64; 2], inner: [f64; 2], z: [f64; 2]) -> Result<Vec<(Pose, SharedShape)>> {
    let wedge = |i: u32| {
        let points: Vec<_> = [0, 1]
            .into_iter()
            .flat_map(|end| [outer[end], inner[end]].map(|r| (r, z[end])))
            .flat_map(|(r, z)| [corner(i, r, z), corner(i + 1, r, z)])
            .collect();
        Ok((Pose::IDENTITY, part(&points)?))
    };
    (0..SEGMENTS).map(wedge).collect()
}

/// Disc as four convex sectors with radii given at two heights (m). A disc in one piece creeps over
/// the table, because the solver uses changing subsets of its many corners.
fn sectors(radius: [f64; 2], z: [f64; 2]) -> Result<Vec<(Pose, SharedShape)>> {
    const EACH: u32 = SEGMENTS / 4;
    let sector = |k: u32| {
        let end = |end: usize| {
            let arc = move |i| corner(k * EACH + EACH / 2 + i, radius[end], z[end]);
            (0..=EACH).map(arc).chain([corner(0, 0.0, z[end])])
        };
        let points: Vec<_> = [0, 1].into_iter().flat_map(end).collect();
        Ok((Pose::IDENTITY, part(&points)?))
    };
    (0..4).map(sector).collect()
}

/// Corner `i` of the polygon of radius `r` at height `z`, in Rapier's units.
fn corner(i: u32, r: f64, z: f64) -> Vector {
    // A flat face is centred on x, the grip axis of an unturned hand, so that rigid pads meet a
    // face and not an edge.
    let angle = std::f64::consts::TAU * (f64::from(i) - 0.5) / f64::from(SEGMENTS);
    units::vector(&Vector3::new(r * angle.cos(), r * angle.sin(), z))
}

#[cfg(test)]
mod tests {
    use std::{f64::consts::TAU, sync::Arc};

    use super::*;
    use crate::scene::{Scene, SceneConfig, SceneObject};

    #[test]
    fn finely_meshed_round_solids_rest_on_the_table() {
        let can = |sides| {
            let profile = [[0.0, -0.025], [0.02, -0.025], [0.02, 0.025], [0.0, 0.025]];
            Surface::revolved(&profile, sides, 0.0)
        };
        for surface in [Surface::radial(160, |_| 0.025), can(256), can(700), can(1024)] {
            let model = ObjectModel::new(Shape::Mesh(Arc::new(surface))).unwrap();
            assert!(model.collider.as_convex_polyhedron().is_some());
            let pose = model.rest(1.0, 0.0, 0.0, 0.0);
            let object = SceneObject { model: &model, scale: 1.0, mass: 0.1, friction: 1.0, pose };
            let away = Vector3::new(0.0, 0.0, 0.25);
            let mut scene = Scene::new(&SceneConfig::default(), &object, &away, 0.0).unwrap();
            scene.settle(500);
            let fall = pose.translation.z - scene.state().object.pose.translation.z;
            // The hull is off by 0.05 mm, and contact gives way by about as much.
            assert!(fall.abs() < 2e-4, "it sank by {fall} m into the table");
        }
    }

    #[test]
    fn solids_with_rounded_edges_rest_on_the_table_at_every_scale() {
        let scale = 1.2;
        let half_extents = Vector3::new(0.012, 0.015, 0.02);
        for sharp in [
            Shape::Cuboid { half_extents },
            Shape::Cylinder { radius: 0.015, half_height: 0.02 },
            Shape::Annulus { outer: 0.02, inner: 0.01, half_height: 0.02 },
        ] {
            let model = ObjectModel::new(sharp.rounded(1e-3).unwrap()).unwrap();
            // Rapier itself does not scale the radius.
            let upright = Pose::from_rotation(units::rotation(&model.upright));
            let collider = model.scaled(scale).unwrap().build();
            let height = collider.shape().compute_aabb(&upright).maxs.z;
            assert!((height - units::scalar(scale * 0.02)).abs() < 1e-5, "{sharp:?}: {height}");
            let pose = model.rest(scale, 0.0, 0.0, 0.0);
            let object = SceneObject { model: &model, scale, mass: 0.1, friction: 1.0, pose };
            let away = Vector3::new(0.0, 0.0, 0.25);
            let mut scene = Scene::new(&SceneConfig::default(), &object, &away, 0.0).unwrap();
            scene.settle(500);
            let fall = pose.translation.z - scene.state().object.pose.translation.z;
            assert!(fall.abs() < 2e-4, "{sharp:?} sank by {fall} m into the table");
        }
    }

    #[test]
    fn too_fine_a_mesh_that_is_not_convex_is_refused_by_its_number_of_triangles() {
        let profile = |k: u32| {
            let angle = TAU * f64::from(k % 160) / 160.0;
            [0.02 + 0.008 * angle.cos(), 0.008 * angle.sin()]
        };
        let profile: Vec<_> = (0..=160).map(profile).collect();
        let torus = Shape::Mesh(Arc::new(Surface::revolved(&profile, 160, 0.0)));
        let message = ObjectModel::new(torus).unwrap_err().to_string();
        assert!(message.contains("51200 triangles, expected at most 20000"), "{message}");
        assert!(message.ends_with("simplify_quadric_decimation(face_count=20000)"), "{message}");
    }
}
