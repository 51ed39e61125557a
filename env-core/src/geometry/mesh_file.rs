//! Triangle surfaces from the files that CAD programs and scanners write.

use std::{fs::File, io::BufReader, path::Path};

use nalgebra::Point3;

use super::Surface;
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
    Surface::new(&name, &vertices, &triangles)
}

type Triangles = (Vec<[f64; 3]>, Vec<[u32; 3]>);

fn failure(path: &Path, reason: &impl ToString) -> Error {
    Error::File { path: path.display().to_string(), reason: reason.to_string() }
}

fn read_obj(path: &Path) -> Result<Triangles> {
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let (models, _) = tobj::load_obj(path, &options).map_err(|e| failure(path, &e))?;
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
    let file = File::open(path).map_err(|e| failure(path, &e))?;
    let mesh = stl_io::read_stl(&mut BufReader::new(file)).map_err(|e| failure(path, &e))?;
    let vertices = mesh.vertices.iter().map(|v| [v[0], v[1], v[2]].map(f64::from)).collect();
    let triangles = mesh.faces.iter().map(|f| f.vertices.map(|i| i as u32)).collect();
    Ok((vertices, triangles))
}
