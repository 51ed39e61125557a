//! Writes pictures of a gripper at work: `cargo run --release --example picture [folder]`.

use std::{error::Error, fs::File, io::BufWriter, path::Path};

use nalgebra::{Isometry3, Vector3};
use ruffini_core::{
    geometry::{Shape, StarShaped, Wave},
    render::{Camera, Color, Finish, GripperParts, Item, RenderMesh, Renderer, table},
};

const SIZE: (usize, usize) = (640, 480);

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| ".".to_owned());
    let mut renderer = Renderer::new(SIZE.0, SIZE.1)?;
    for (name, shape, height, lift) in scenes() {
        let mesh = RenderMesh::new(&shape.surface(64).ok_or("a half-space has no surface")?);
        let width = half_width(&shape);
        let (parts, table) = (GripperParts::default(), table());
        let held = Isometry3::translation(0.0, 0.0, height + lift);
        let tool = Isometry3::new(Vector3::z() * (height + lift + 0.004), Vector3::z() * 0.35);
        let top = Item::new(&table, Isometry3::identity(), Color::srgb(214, 211, 205));
        let mut items = vec![top.with_finish(Finish::Ground { spacing: 0.025 })];
        items.push(Item::new(&mesh, held, Color::srgb(72, 145, 202)).with_finish(Finish::Glossy));
        items.extend(parts.items(&tool, [width, width]));
        let picture = renderer.draw(&Camera::default(), &items)?;
        write_png(&Path::new(&folder).join(format!("{name}.png")), &picture)?;
    }
    Ok(())
}

/// Name, shape, height of its middle when it stands (m), and lift above that (m).
fn scenes() -> Vec<(&'static str, Shape, f64, f64)> {
    let wave = |amplitude, x, y, z, phase| Wave { amplitude, vector: [x, y, z].into(), phase };
    let potato = StarShaped::new(
        Vector3::new(0.024, 0.036, 0.028),
        vec![wave(0.08, 3.0, 2.0, 1.0, 0.3), wave(0.05, -2.0, 4.0, 3.0, 1.0)],
    );
    vec![
        ("cylinder", Shape::Cylinder { radius: 0.02, half_height: 0.035 }, 0.035, 0.04),
        (
            "cup",
            Shape::Cup { bottom: 0.022, rim: 0.032, half_height: 0.035, wall: 0.002 },
            0.035,
            0.0,
        ),
        ("sphere", Shape::Sphere { radius: 0.028 }, 0.028, 0.06),
        ("cuboid", Shape::Cuboid { half_extents: Vector3::new(0.018, 0.025, 0.03) }, 0.03, 0.0),
        ("potato", Shape::StarShaped(potato), 0.028, 0.02),
    ]
}

/// Half of what the jaws hold (m).
fn half_width(shape: &Shape) -> f64 {
    match shape {
        Shape::Cylinder { radius, .. } | Shape::Sphere { radius } => *radius,
        Shape::Cup { bottom, rim, .. } => 0.5 * (bottom + rim),
        Shape::Cuboid { half_extents } => half_extents.x,
        _ => 0.025,
    }
}

fn write_png(path: &Path, picture: &[u8]) -> Result<(), Box<dyn Error>> {
    let file = BufWriter::new(File::create(path)?);
    let mut encoder = png::Encoder::new(file, SIZE.0 as u32, SIZE.1 as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header()?.write_image_data(picture)?;
    println!("{}", path.display());
    Ok(())
}
