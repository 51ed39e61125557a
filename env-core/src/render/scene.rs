//! Pictures of a scene: gripper, objects and table, and the deformation of the pads or the object.

use nalgebra::Isometry3;

use super::{
    Color, DeformationView, DeformedBodies, Finish, GripperParts, Item, RenderMesh, Renderer,
    Viewpoint, table,
    touch::{Inset, StressedBody},
};
use crate::{
    Error, Result,
    geometry::Shape,
    scene::{Fixture, SceneState},
};

/// Number of edges that approximate a circle.
const SEGMENTS: u32 = 64;

/// Renderer of scenes at one picture size; keeps the data that do not change between frames.
pub struct SceneRenderer {
    renderer: Renderer,
    gripper: GripperParts,
    table: RenderMesh,
    /// Object and distractors drawn last, with their shapes: most frames show them again.
    bodies: Vec<(Shape, RenderMesh)>,
    /// Inset, created when a picture first shows touch and has room for it.
    inset: Option<Inset>,
}

impl SceneRenderer {
    /// Creates a renderer of pictures of `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Result<Self> {
        Ok(Self {
            renderer: Renderer::new(width, height)?,
            gripper: GripperParts::default(),
            table: table(),
            bodies: Vec::new(),
            inset: None,
        })
    }

    /// Width and height of a picture (pixels).
    pub fn size(&self) -> (usize, usize) {
        self.renderer.size()
    }

    /// Draws a scene with an object and distractors of `shapes`, the object first, as an sRGB
    /// picture (height, width, 3), with a `fixture` on the table if there is one. With a `view`,
    /// the pads or the object are drawn deformed and coloured by stress, and an inset shows the
    /// more stressed pad from the object's side, or the object from a finger's side.
    pub fn draw(
        &mut self,
        viewpoint: &Viewpoint,
        state: &SceneState,
        shapes: &[Shape],
        fixture: Option<&Fixture>,
        view: Option<&DeformationView>,
    ) -> Result<Vec<u8>> {
        if !self.bodies.iter().map(|(known, _)| known).eq(shapes) {
            self.bodies = shapes.iter().map(body).collect::<Result<_>>()?;
        }
        let table = Item::new(&self.table, Isometry3::identity(), Color::srgb(214, 211, 205));
        let mut items = vec![table.with_finish(Finish::Ground { spacing: 0.025 })];
        let blocks = fixture.map(blocks).transpose()?.unwrap_or_default();
        items.extend(blocks.iter().map(|(pose, mesh)| {
            Item::new(mesh, *pose, Color::srgb(150, 156, 164)).with_finish(Finish::Metal)
        }));
        let bodies = view.map(StressedBody::all).transpose()?.unwrap_or_default();
        let is_object = view.is_some_and(|view| matches!(view.bodies, DeformedBodies::Object(_)));
        if is_object {
            items.extend(bodies.iter().map(|body| body.item(state.object.pose)));
        } else if let Some((_, mesh)) = self.bodies.first() {
            let object = Item::new(mesh, state.object.pose, Color::srgb(72, 145, 202));
            items.push(object.with_finish(Finish::Glossy));
        }
        items.extend(self.bodies.iter().skip(1).zip(&state.distractors).map(
            |((_, mesh), body)| {
                Item::new(mesh, body.pose, Color::srgb(196, 130, 92)).with_finish(Finish::Glossy)
            },
        ));
        let jaws = [0, 1].map(|k| state.fingers[k].position);
        if view.is_some() && !is_object {
            items.extend(self.gripper.rigid_items(&state.wrist.pose, jaws));
            let pads = bodies.iter().zip(&state.fingers);
            items.extend(pads.map(|(pad, finger)| pad.item(finger.pad)));
        } else {
            items.extend(self.gripper.items(&state.wrist.pose, jaws));
        }
        let mut picture = self.renderer.draw(&viewpoint.camera(state), &items)?;
        let body = bodies.iter().reduce(|a, b| if b.peak > a.peak { b } else { a });
        let object = is_object.then(|| state.object_in_wrist());
        if let Some(body) = body.filter(|body| body.peak > 0.0) {
            let (width, height) = self.renderer.size();
            if self.inset.is_none() {
                self.inset = Inset::new(width, height)?;
            }
            if let Some(inset) = &mut self.inset {
                inset.draw(body, object, &mut picture, width)?;
            }
        }
        Ok(picture)
    }
}

/// Shape of a body with its mesh.
fn body(shape: &Shape) -> Result<(Shape, RenderMesh)> {
    let surface = shape
        .surface(SEGMENTS)
        .ok_or_else(|| Error::invalid("object", format!("{shape:?}"), "a shape of finite size"))?;
    Ok((shape.clone(), RenderMesh::new(&surface)))
}

/// Boxes of a fixture with their poses.
fn blocks(fixture: &Fixture) -> Result<Vec<(Isometry3<f64>, RenderMesh)>> {
    let block = |(pose, half_extents)| {
        let surface = Shape::Cuboid { half_extents }.surface(SEGMENTS);
        let surface = surface.ok_or_else(|| Error::invalid("fixture", half_extents, "a box"))?;
        Ok((pose, RenderMesh::new(&surface)))
    };
    fixture.boxes().into_iter().map(block).collect()
}
