use nalgebra::Point3;

use super::*;
use crate::{
    geometry::Shape,
    render::{GripperParts, table},
};

const SIZE: usize = 64;

fn cube(half: f64) -> RenderMesh {
    RenderMesh::new(&Shape::Cuboid { half_extents: Vector3::repeat(half) }.surface(8).unwrap())
}

/// Camera that looks along +y at the origin from 1 m; the picture is 2 tan(0.25) m high there.
fn camera() -> PinholeCamera {
    PinholeCamera {
        eye: Point3::new(0.0, -1.0, 0.0),
        target: Point3::origin(),
        up: Vector3::z(),
        vertical_fov: 0.5,
    }
}

fn red() -> Color {
    Color::srgb(220, 20, 20)
}

fn green() -> Color {
    Color::srgb(20, 220, 20)
}

fn draw(items: &[Item]) -> Vec<u8> {
    Renderer::new(SIZE, SIZE).unwrap().draw(&camera(), items).unwrap()
}

fn count(picture: &[u8], strong: usize, weak: usize) -> usize {
    let is = |p: &&[u8]| u16::from(p[strong]) > 2 * u16::from(p[weak]);
    picture.chunks(3).filter(is).count()
}

#[test]
fn a_cube_covers_its_projection() {
    let (mesh, half) = (cube(0.1), 0.1);
    let picture = draw(&[Item::new(&mesh, Isometry3::identity(), red())]);
    let pixels = count(&picture, 0, 1);
    // Only the near face of the cube is visible, 0.9 m away.
    let side = SIZE as f64 * half / ((1.0 - half) * 0.25f64.tan());
    let error = (pixels as f64).sqrt() - side;
    assert!(error.abs() < 1.0, "{pixels} pixels against a square of side {side}");
}

#[test]
fn nearer_hides_farther_in_either_order() {
    let mesh = cube(0.05);
    let near = Item::new(&mesh, Isometry3::translation(0.0, -0.2, 0.0), red());
    let far = Item::new(&mesh, Isometry3::translation(0.0, 0.2, 0.0), green());
    for items in [[near, far], [far, near]] {
        let picture = draw(&items);
        assert!(count(&picture, 0, 1) > 100, "the near cube shows");
        assert_eq!(count(&picture, 1, 0), 0, "the far cube is hidden");
    }
}

#[test]
fn the_same_items_give_the_same_bytes() {
    let (parts, table) = (GripperParts::default(), table());
    let mut items = parts.items(&Isometry3::translation(0.0, 0.0, 0.03), [0.02, 0.03]);
    let ground = Item::new(&table, Isometry3::identity(), Color::srgb(210, 210, 210));
    items.push(ground.with_finish(Finish::Ground { spacing: 0.025 }));
    let mut renderer = Renderer::new(SIZE, SIZE).unwrap();
    let first = renderer.draw(&PinholeCamera::default(), &items).unwrap();
    renderer.draw(&camera(), &items[..2]).unwrap();
    assert_eq!(renderer.draw(&PinholeCamera::default(), &items).unwrap(), first);
}

#[test]
fn shared_edges_leave_no_holes() {
    let sphere = RenderMesh::new(&Shape::Sphere { radius: 0.5 }.surface(40).unwrap());
    let mut renderer = Renderer::with_samples(1024, 1024, 1).unwrap();
    for turn in 0..8 {
        let pose = Isometry3::rotation(Vector3::new(0.3, 0.5, 0.7) * f64::from(turn));
        let item = Item::new(&sphere, pose, red());
        renderer.draw(&camera(), &[item]).unwrap();
        let holes = renderer.raster.facet.iter().filter(|&&facet| facet == NOTHING).count();
        assert_eq!(holes, 0, "the sphere fills the picture at turn {turn}");
    }
}

#[test]
fn bodies_behind_astride_and_far_from_the_camera_are_clipped() {
    let mesh = cube(0.1);
    let blank = draw(&[]);
    for y in [-2.0, 100.0, 1e300, -1e300] {
        let picture = draw(&[Item::new(&mesh, Isometry3::translation(0.0, y, 0.0), red())]);
        assert_eq!(picture, blank, "a cube at y = {y} m does not show");
    }
    for (x, y) in [(0.0, -0.89), (0.02, -0.91), (0.25, -0.3), (-0.1, -1.0), (0.099_999, -0.9)] {
        draw(&[Item::new(&mesh, Isometry3::translation(x, y, 0.05), red())]);
    }
}

#[test]
fn a_shadow_darkens_the_table_under_a_body() {
    let (table, cube) = (table(), cube(0.02));
    let ground = Item::new(&table, Isometry3::identity(), Color::srgb(210, 210, 210))
        .with_finish(Finish::Ground { spacing: 1.0 });
    let above = Item::new(&cube, Isometry3::translation(0.0, 0.0, 0.1), red());
    let brightness = |items: &[Item]| {
        let picture =
            Renderer::new(SIZE, SIZE).unwrap().draw(&PinholeCamera::default(), items).unwrap();
        picture.chunks(3).filter(|p| p[0].abs_diff(p[1]) < 30 && p[1] < 150).count()
    };
    let (without, with) = (brightness(&[ground]), brightness(&[ground, above]));
    assert!(with > without + 10, "{with} dark pixels with a cube, {without} without");
}

#[test]
fn vertex_colors_win_over_the_color() {
    let mesh = cube(0.1);
    let colors = vec![green(); mesh.vertex_count()];
    let item = Item::new(&mesh, Isometry3::identity(), red());
    let picture = draw(&[Item { vertex_colors: Some(&colors), ..item }]);
    assert!(count(&picture, 1, 0) > 100 && count(&picture, 0, 1) == 0);
}

#[test]
fn bad_input_is_named() {
    let mesh = cube(0.1);
    let mut renderer = Renderer::new(SIZE, SIZE).unwrap();
    let mut message = |camera: &PinholeCamera, item: Item| {
        renderer.draw(camera, &[item]).unwrap_err().to_string()
    };
    let item = Item::new(&mesh, Isometry3::identity(), red());
    let lost = Item { pose: Isometry3::translation(f64::NAN, 0.0, 0.0), ..item };
    assert!(message(&camera(), lost).starts_with("pose of item 0"));
    let bare = Item { vertex_colors: Some(&[]), ..item };
    assert!(message(&camera(), bare).contains("found 0 colours, expected 8"));
    let blind = PinholeCamera { target: camera().eye, ..camera() };
    assert!(message(&blind, item).starts_with("camera"));
    let wide = PinholeCamera { vertical_fov: f64::NAN, ..camera() };
    assert!(message(&wide, item).starts_with("vertical_fov"));
    assert!(renderer.draw_into(&camera(), &[item], &mut [0; 3]).is_err());
    for (width, height, samples) in [(15, 64, 1), (64, 4097, 1), (64, 64, 0), (64, 64, 5)] {
        assert!(Renderer::with_samples(width, height, samples).is_err());
    }
}
