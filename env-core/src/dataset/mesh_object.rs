//! Objects of a dataset from mesh files of one's own.

use std::{
    ffi::OsStr,
    path::{Path, PathBuf},
};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::file::{read, sha256, write_whole};
use crate::{
    Error, Result,
    geometry::read_solid,
    objects::{FamilySplit, Object, is_family},
};

/// Mesh file with its unit and origin, an object of a dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshObject {
    /// Path of an .obj or .stl file. In a TOML file, it is relative to the folder of that file; in
    /// a finished dataset, it is the name of the copy in its folder `meshes`.
    pub mesh: String,
    /// Length of the file's unit (m).
    #[serde(default = "metre")]
    pub scale: f64,
    /// Moves the origin to the middle of the bounding box.
    #[serde(default)]
    pub centred: bool,
    /// Number of grasps of this object, if it is not that of the others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grasps: Option<usize>,
    /// SHA-256 of the file; if empty, it is filled in by
    /// [`DatasetConfig::validated`](super::DatasetConfig::validated).
    #[serde(default)]
    pub sha256: String,
}

fn metre() -> f64 {
    1.0
}

/// Returns the `meshes` with their hashes. Returns an error if a file is missing or not the one
/// that a hash names, or if a name occurs twice or is that of a family.
pub(super) fn identified(meshes: Vec<MeshObject>) -> Result<Vec<MeshObject>> {
    let mut names: Vec<String> = Vec::new();
    for mesh in &meshes {
        // Some file systems do not tell upper from lower case.
        let name = mesh.stem().to_lowercase();
        if names.contains(&name) || is_family(&name) {
            let expected = "a file name unlike those of other meshes and of families of objects";
            return Err(Error::invalid("object", &mesh.mesh, expected));
        }
        names.push(name);
    }
    let one = |mesh: MeshObject| Ok(MeshObject { sha256: mesh.read()?.1, ..mesh });
    meshes.into_iter().map(one).collect()
}

impl MeshObject {
    /// Name of the file without its ending, in place of a family's.
    fn stem(&self) -> &str {
        Path::new(&self.mesh).file_stem().and_then(OsStr::to_str).unwrap_or_default()
    }

    /// Name of the object: `mug-1` of the file `mug.obj`.
    pub(super) fn name(&self) -> String {
        format!("{}-1", self.stem())
    }

    /// Returns the mesh with its path relative to `folder`.
    pub(super) fn within(&self, folder: &Path) -> Self {
        Self { mesh: folder.join(&self.mesh).display().to_string(), ..self.clone() }
    }

    /// Returns the mesh with the name of its copy in a dataset as its path.
    pub(super) fn stored(&self) -> Self {
        let name = Path::new(&self.mesh).file_name().and_then(OsStr::to_str).unwrap_or_default();
        Self { mesh: name.to_owned(), ..self.clone() }
    }

    /// Writes the copy of the file into the `folder` of a dataset, unless it is there.
    pub(super) fn keep(&self, folder: &Path) -> Result<()> {
        let copy: PathBuf = folder.join("meshes").join(self.stored().mesh);
        let (bytes, _) = self.read()?;
        let is_there = read(&copy).is_ok_and(|found| found == bytes);
        if is_there { Ok(()) } else { write_whole(&copy, &bytes) }
    }

    /// Content of the file and its hash, or an error if it is not that of the mesh.
    fn read(&self) -> Result<(Vec<u8>, String)> {
        let bytes = read(Path::new(&self.mesh))?;
        let found = sha256(&bytes);
        if self.sha256.is_empty() || self.sha256 == found {
            return Ok((bytes, found));
        }
        let reason = format!("its SHA-256 is {found}, expected {}", self.sha256);
        Err(Error::file(&self.mesh, reason))
    }

    /// Reads the object. Its grasps are drawn from `seed` and its name, whatever else is listed.
    pub(super) fn object(&self, seed: u64) -> Result<Object> {
        self.read()?;
        let path = Path::new(&self.mesh);
        let shape = read_solid(path, self.scale, self.centred).map_err(|error| match error {
            Error::Invalid { .. } => Error::file(path, error),
            other => other,
        })?;
        let name = Sha256::digest(self.stem());
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(u64::from_le_bytes(std::array::from_fn(|i| name[i])));
        let (family, split, seed) = (None, FamilySplit::Train, random.next_u64());
        Ok(Object { name: self.name(), family, split, seed, shape })
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write;

    use nalgebra::Vector3;

    use super::*;
    use crate::{
        dataset::{DatasetConfig, plans},
        geometry::Shape,
    };

    /// Folder that is removed when a test ends.
    struct Folder(PathBuf);

    impl Folder {
        fn new(test: &str) -> Self {
            let name = format!("ruffini-{test}-{}", std::process::id());
            let path = std::env::temp_dir().join(name);
            std::fs::create_dir_all(&path).unwrap();
            Self(path)
        }

        /// Writes a box of `size` times 4, 3 and 2 cm, moved by `offset` of its width; the last
        /// `open` triangles are left out.
        fn write(&self, name: &str, size: f64, offset: f64, open: usize) {
            let half_extents = size * Vector3::new(0.02, 0.015, 0.01);
            let surface = Shape::Cuboid { half_extents }.surface(8).unwrap();
            let moved = surface.moved(&(2.0 * offset * half_extents.x * Vector3::x()));
            let mut text = String::new();
            for v in moved.vertices() {
                writeln!(text, "v {} {} {}", v.x, v.y, v.z).unwrap();
            }
            for [a, b, c] in &moved.triangles()[open..] {
                writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).unwrap();
            }
            std::fs::write(self.0.join(name), text).unwrap();
        }

        fn read(&self, text: &str) -> Result<DatasetConfig> {
            let path = self.0.join("config.toml");
            let start = "scenario = \"presses\"\nobjects = 2\ngrasps = 3\n";
            std::fs::write(&path, format!("{start}{text}")).unwrap();
            DatasetConfig::read(&path)
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn a_mesh_is_an_object_after_the_drawn_ones_with_presses_of_its_own() {
        let folder = Folder::new("mesh-object");
        folder.write("box.obj", 1000.0, 0.0, 0);
        folder.write("off.obj", 1.0, 3.0, 0);
        let own = "[[object]]\nmesh = \"box.obj\"\nscale = 0.001\ngrasps = 5\n";
        let off = "[[object]]\nmesh = \"off.obj\"\ncentred = true\n";
        let (one, both) = (folder.read(own).unwrap(), folder.read(&format!("{off}{own}")).unwrap());
        let (first, second) = (plans(&one).unwrap(), plans(&both).unwrap());
        let counts: Vec<_> = second.iter().map(|(o, plans)| (&*o.name, plans.len())).collect();
        assert_eq!(counts[2..], [("off-1", 3), ("box-1", 5)]);
        // Other meshes change nothing of it, nor of what is drawn.
        assert_eq!(first[..2], second[..2]);
        assert_eq!(first[2], second[3]);
        for (object, _) in &second[2..] {
            let (low, high) = object.surface(8).bounds();
            let size = Vector3::new(0.04, 0.03, 0.02);
            assert!((high - low - size).norm() < 1e-9, "{}", object.name);
            assert!((low.coords + high.coords).norm() < 1e-9, "{}", object.name);
        }
    }

    #[test]
    fn a_dataset_has_the_name_and_the_hash_of_a_mesh_and_nothing_without_one() {
        let folder = Folder::new("mesh-stored");
        folder.write("box.obj", 1.0, 0.0, 0);
        let config = folder.read("[[object]]\nmesh = \"box.obj\"\n").unwrap();
        let [stored] = &config.stored().meshes[..] else { panic!("{:?}", config.meshes) };
        assert_eq!((&*stored.mesh, stored.sha256.len()), ("box.obj", 64));
        folder.write("box.obj", 1.1, 0.0, 0);
        let said = config.own_objects().unwrap_err().to_string();
        assert!(said.contains("box.obj: its SHA-256 is"), "{said}");
        let text = serde_json::to_string(&folder.read("").unwrap().stored()).unwrap();
        assert!(!text.contains("\"object\""), "{text}");
    }

    #[test]
    fn a_mesh_that_cannot_be_used_is_named() {
        let folder = Folder::new("mesh-refused");
        folder.write("box.obj", 1.0, 0.0, 0);
        folder.write("mm.obj", 1000.0, 0.0, 0);
        folder.write("beside.obj", 1.0, 3.0, 0);
        folder.write("open.obj", 1.0, 0.0, 1);
        folder.write("prism.obj", 1.0, 0.0, 0);
        let refused = [
            ("none.obj", "", "none.obj: "),
            ("config.toml", "", "expected a name that ends in .obj or .stl"),
            ("mm.obj", "", "mm.obj: mesh size: found 40 m"),
            ("beside.obj", "", "beside.obj around (0.1200, 0.0000, 0.0000) m"),
            ("open.obj", "", "open.obj: not watertight"),
            ("prism.obj", "", "prism.obj, expected a file name unlike"),
            ("box.obj", "[[object]]\nmesh = \"./box.obj\"", "box.obj, expected a file name unlike"),
            ("box.obj", "size = 2", "unknown field `size`"),
            ("box.obj", "scale = -1.0", "box.obj: scale: found -1"),
            ("box.obj", "grasps = 0", "object.grasps: found 0, expected 1 to 1000"),
            ("box.obj", "sha256 = \"0\"", "expected 0"),
        ];
        for (file, more, expected) in refused {
            let said = folder.read(&format!("[[object]]\nmesh = \"{file}\"\n{more}"));
            let said = said.unwrap_err().to_string();
            assert!(said.contains(expected), "{file}: {said}");
        }
    }

    #[test]
    fn a_sensor_from_a_file_is_a_part_of_the_configuration() {
        let folder = Folder::new("own-sensor");
        let text = include_str!("../../assets/sensors/gelsight-mini.toml");
        let thicker = text.replace("thickness = 0.004", "thickness = 0.0042");
        assert_ne!(thicker, text);
        std::fs::write(folder.0.join("own.toml"), &thicker).unwrap();
        let gel = |sensor: &str| {
            let material = "young = 2e5, poisson = 0.46, friction = 0.5, share = 1.0";
            format!("gels = [{{ sensor = \"{sensor}\", {material} }}]\n")
        };
        let config = folder.read(&gel("own.toml")).unwrap();
        let thickness = |config: &DatasetConfig| config.gels[0].sensor().unwrap().outline.thickness;
        assert_eq!(thickness(&config), 0.0042);
        // What is stored needs the file no more.
        std::fs::remove_file(folder.0.join("own.toml")).unwrap();
        let stored = config.stored();
        assert_eq!((&*stored.gels[0].sensor, thickness(&stored)), ("own.toml", 0.0042));
        let read: DatasetConfig =
            serde_json::from_str(&serde_json::to_string(&stored).unwrap()).unwrap();
        assert_eq!(read.validated().unwrap().stored(), stored);
        let said = folder.read(&gel("own.toml")).unwrap_err().to_string();
        assert!(said.contains("own.toml"), "{said}");
        assert!(folder.read(&gel("digits")).unwrap_err().to_string().contains("digit"));
    }
}
