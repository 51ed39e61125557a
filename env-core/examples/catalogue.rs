//! Draws a picture of all objects: `cargo run --release --example catalogue -- catalogue.png`.
//!
//! Each object has one tile, in the order of the catalogue from the upper left and all at one
//! scale; the objects' names are printed row by row.

use std::{error::Error, fs::File, io::BufWriter};

use nalgebra::{Isometry3, Point3, Vector3};
use ruffini_core::{
    objects::{Family, FamilySplit, Object, catalogue},
    render::{Color, Finish, Item, PinholeCamera, RenderMesh, Renderer, table},
};

/// Width and height of a tile (pixels).
const TILE: usize = 180;
/// Tiles in a row.
const COLUMNS: usize = 8;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: catalogue PICTURE.png [SEED]")?;
    let seed = std::env::args().nth(2).map_or(Ok(0), |seed| seed.parse())?;
    let objects = catalogue(seed);
    let mut renderer = Renderer::with_samples(TILE, TILE, 3)?;
    let (width, height) = (TILE * COLUMNS, TILE * objects.len().div_ceil(COLUMNS));
    let mut sheet = vec![255; 3 * width * height];
    for (i, object) in objects.iter().enumerate() {
        let tile = draw(&mut renderer, object)?;
        let corner = 3 * (i / COLUMNS * TILE * width + i % COLUMNS * TILE);
        for (row, pixels) in tile.chunks_exact(3 * TILE).enumerate() {
            sheet[corner + 3 * row * width..][..pixels.len()].copy_from_slice(pixels);
        }
    }
    for row in objects.chunks(COLUMNS) {
        println!("{}", row.iter().map(|o| o.name.as_str()).collect::<Vec<_>>().join("  "));
    }
    let mut encoder =
        png::Encoder::new(BufWriter::new(File::create(path)?), width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(&sheet)?;
    Ok(())
}

fn draw(renderer: &mut Renderer, object: &Object) -> Result<Vec<u8>, ruffini_core::Error> {
    let (mesh, table) = (RenderMesh::new(&object.surface(96)), table());
    let ground = match object.split {
        FamilySplit::Train => Color::srgb(214, 211, 205),
        FamilySplit::Novel => Color::srgb(190, 204, 214),
        FamilySplit::Soft => Color::srgb(222, 196, 196),
    };
    let ground = Item::new(&table, Isometry3::identity(), ground);
    let item = Item::new(
        &mesh,
        standing(object),
        color(object.family.expect("an object of the catalogue has one")),
    );
    let camera = PinholeCamera {
        eye: Point3::new(0.12, -0.28, 0.28),
        target: Point3::new(0.0, 0.0, 0.022),
        up: Vector3::z(),
        vertical_fov: 0.23,
    };
    renderer.draw(
        &camera,
        &[ground.with_finish(Finish::Ground { spacing: 0.02 }), item.with_finish(Finish::Glossy)],
    )
}

/// Pose of the object on the table; long ones lie.
fn standing(object: &Object) -> Isometry3<f64> {
    let lying = matches!(
        object.family,
        Some(
            Family::Eggplant
                | Family::Cucumber
                | Family::Potato
                | Family::Lemon
                | Family::HollowLemon
        )
    );
    let turn = if lying { Vector3::new(0.0, 1.4, 0.0) } else { Vector3::zeros() };
    let turned = Isometry3::rotation(turn);
    let surface = object.surface(48);
    let points: Vec<Point3<f64>> = surface.vertices().iter().map(|v| turned * v).collect();
    let (low, high) = points.iter().fold((points[0], points[0]), |(a, b), v| (a.inf(v), b.sup(v)));
    let middle = nalgebra::center(&low, &high);
    Isometry3::translation(-middle.x, -middle.y, -low.z) * turned
}

fn color(family: Family) -> Color {
    let [r, g, b] = match family {
        Family::Prism => [72, 145, 202],
        Family::Annulus => [230, 150, 60],
        Family::Cuboid => [120, 170, 120],
        Family::Cup => [240, 240, 235],
        Family::Cylinder => [160, 140, 200],
        Family::Eggplant => [92, 46, 110],
        Family::Potato => [196, 160, 110],
        Family::Sphere => [70, 180, 180],
        Family::Lemon => [245, 215, 60],
        Family::Tomato => [215, 60, 45],
        Family::HollowLemon => [225, 225, 110],
        Family::Ellipsoid => [150, 190, 220],
        Family::Jar => [200, 180, 160],
        Family::Cucumber => [80, 140, 70],
        Family::Apple => [180, 205, 80],
        Family::Strawberry => [220, 40, 70],
        Family::Capsule | Family::Cone | Family::Raspberry | Family::Ribbed | Family::Rasp => {
            [170, 170, 170]
        }
    };
    Color::srgb(r, g, b)
}
