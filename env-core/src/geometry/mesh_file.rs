//! Triangle surfaces from the files that CAD programs and scanners write.

use std::{
    fs::File,
    io::{BufReader, ErrorKind},
    path::Path,
    sync::Arc,
};

use nalgebra::Point3;

use super::{Shape, Surface};
use crate::{Error, Result};

/// Reads a watertight surface from an .obj or .stl file (ASCII or binary), with `scale` metres to a
/// unit of the file.
pub fn read_surface(path: &Path, scale: f64) -> Result<Surface> {
    if !(scale.is_finite() && scale > 0.0) {
        return Err(Error::invalid("scale", scale, "a finite number of metres above 0"));
    }
    let name = path.display().to_string();
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_lowercase();
    let (vertices, triangles) = match extension.as_str() {
        "obj" => read_obj(path)?,
        "stl" => read_stl(path)?,
        _ => return Err(Error::invalid("mesh file", name, "a name that ends in .obj or .stl")),
    };
    let vertices: Vec<_> =
        vertices.into_iter().map(|v| Point3::from(v.map(|x| x * scale))).collect();
    Surface::of_solid(&name, &vertices, &triangles)
}

/// Distance of a mesh's origin from the middle of its bounding box, relative to the box's edges,
/// above which the object would be placed and grasped beside where it is.
const OFF_CENTRE: f64 = 0.25;

/// Reads a solid of hand scale as [`read_surface`] does. Its origin is moved to the middle of its
/// bounding box if `centred`; otherwise one that lies beside the solid is an error.
pub fn read_solid(path: &Path, scale: f64, centred: bool) -> Result<Shape> {
    let surface = read_surface(path, scale)?;
    let (low, high) = surface.bounds();
    let middle = 0.5 * (low.coords + high.coords);
    let surface = if centred { surface.moved(&-middle) } else { surface };
    // One in a wrong unit is told so first.
    let shape = Shape::Mesh(Arc::new(surface)).validated()?;
    if !centred && middle.component_div(&(high - low)).amax() > OFF_CENTRE {
        let [x, y, z] = middle.into();
        let found = format!("{} around ({x:.4}, {y:.4}, {z:.4}) m", path.display());
        let expected = "a mesh around its origin; the entry centred = true moves it there";
        return Err(Error::invalid("mesh origin", found, expected));
    }
    Ok(shape)
}

type Triangles = (Vec<[f64; 3]>, Vec<[u32; 3]>);

fn read_obj(path: &Path) -> Result<Triangles> {
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    // The parser does not say why it cannot open a file.
    File::open(path).map_err(|error| Error::file(path, error))?;
    let (models, _) = tobj::load_obj(path, &options).map_err(|error| Error::file(path, error))?;
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for model in models {
        let first = vertices.len() as u32;
        vertices.extend_from_slice(model.mesh.positions.as_chunks().0);
        let (corners, _) = model.mesh.indices.as_chunks::<3>();
        triangles.extend(corners.iter().map(|t| t.map(|i| i + first)));
    }
    Ok((vertices, triangles))
}

fn read_stl(path: &Path) -> Result<Triangles> {
    let file = File::open(path).map_err(|error| Error::file(path, error))?;
    let mesh = stl_io::read_stl(&mut BufReader::new(file)).map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof => {
            Error::file(path, "no .stl file, or one cut short: it ends before its last triangle")
        }
        _ => Error::file(path, e),
    })?;
    let vertices = mesh.vertices.iter().map(|v| [v[0], v[1], v[2]].map(f64::from)).collect();
    let triangles = mesh.faces.iter().map(|f| f.vertices.map(|i| i as u32)).collect();
    Ok((vertices, triangles))
}
