//! Export of tetrahedral meshes with fields: .vtu for `ParaView` and .npz for numpy.
//!
//! .vtu: VTK's XML unstructured grid; every array is base64 of its byte count (`UInt64`) and its
//! little-endian values. .npz: a zip archive, nothing compressed, of .npy arrays in format 1.0:
//! `vertices` (V, 3), `tets` (T, 4) and every field under its name. Both are exact to the bit.

use std::{fs, path::Path};

use super::TetMesh;
use crate::{Error, Result};

/// Mesh entities that a field has one value each for.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum FieldOn {
    /// Every vertex.
    Vertices,
    /// Every tetrahedron.
    Tets,
}

/// A named quantity over a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Field<'a> {
    /// Name, made of letters, digits, spaces and underscores.
    pub name: &'a str,
    /// Mesh entities that the values belong to.
    pub on: FieldOn,
    /// Numbers per value: 1 for a scalar, 3 for a vector.
    pub components: usize,
    /// The numbers, value after value.
    pub values: &'a [f64],
}

impl TetMesh {
    /// Writes the mesh and `fields` to a .vtu or .npz file.
    pub fn write(&self, path: &Path, fields: &[Field]) -> Result<()> {
        self.check(fields)?;
        let shown = path.display().to_string();
        let bytes = match path.extension().and_then(|e| e.to_str()).unwrap_or_default() {
            "vtu" => self.vtu(fields).into_bytes(),
            "npz" => self.npz(fields),
            _ => return Err(Error::invalid("file", shown, "a name in .vtu or .npz")),
        };
        fs::write(path, bytes).map_err(|error| Error::file(path, error))
    }

    fn check(&self, fields: &[Field]) -> Result<()> {
        for (i, field) in fields.iter().enumerate() {
            let name = field.name;
            let plain = name.chars().all(|c| c.is_alphanumeric() || c == '_' || c == ' ');
            if name.is_empty() || !plain || ["vertices", "tets"].contains(&name) {
                let expected = "letters, digits, spaces and underscores, not a part of the mesh";
                return Err(Error::invalid("field name", name, expected));
            }
            if fields[..i].iter().any(|other| other.name == name) {
                return Err(Error::invalid("field name", name, "every name once"));
            }
            let count = self.count(field.on) * field.components;
            if field.values.len() != count || field.components == 0 {
                let found = format!("{} numbers", field.values.len());
                let expected = format!("{} × {} of them", self.count(field.on), field.components);
                return Err(Error::invalid(format!("field {name}"), found, expected));
            }
        }
        Ok(())
    }

    fn count(&self, on: FieldOn) -> usize {
        match on {
            FieldOn::Vertices => self.vertices.len(),
            FieldOn::Tets => self.tets.len(),
        }
    }

    fn vtu(&self, fields: &[Field]) -> String {
        let section = |name: &str, on: FieldOn| {
            let of = fields.iter().filter(|field| field.on == on);
            let arrays = of.map(|f| array(f.name, "Float64", f.components, &bytes(f.values)));
            element(name, &arrays.collect::<String>())
        };
        let points: Vec<f64> = self.vertices.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
        let corners: Vec<u8> = self.tets.iter().flatten().flat_map(|i| i.to_le_bytes()).collect();
        let ends: Vec<u8> =
            (1..=self.tets.len()).flat_map(|t| (4 * t as u64).to_le_bytes()).collect();
        // VTK's number of a tetrahedron is 10.
        let kinds = vec![10; self.tets.len()];
        let cells = array("connectivity", "UInt32", 1, &corners)
            + &array("offsets", "UInt64", 1, &ends)
            + &array("types", "UInt8", 1, &kinds);
        format!(
            "<?xml version=\"1.0\"?>\n\
             <VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
             header_type=\"UInt64\">\n<UnstructuredGrid>\n\
             <Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n{}{}{}{}</Piece>\n\
             </UnstructuredGrid>\n</VTKFile>\n",
            self.vertices.len(),
            self.tets.len(),
            section("PointData", FieldOn::Vertices),
            section("CellData", FieldOn::Tets),
            element("Points", &array("points", "Float64", 3, &bytes(&points))),
            element("Cells", &cells),
        )
    }

    fn npz(&self, fields: &[Field]) -> Vec<u8> {
        let points: Vec<f64> = self.vertices.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
        let corners: Vec<u8> = self.tets.iter().flatten().flat_map(|i| i.to_le_bytes()).collect();
        let mut archive = Archive::default();
        archive.add("vertices", &npy("<f8", &[self.vertices.len(), 3], &bytes(&points)));
        archive.add("tets", &npy("<u4", &[self.tets.len(), 4], &corners));
        for field in fields {
            let shape = [self.count(field.on), field.components];
            let shape = if field.components == 1 { &shape[..1] } else { &shape[..] };
            archive.add(field.name, &npy("<f8", shape, &bytes(field.values)));
        }
        archive.finish()
    }
}

fn bytes(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn element(name: &str, inside: &str) -> String {
    format!("<{name}>\n{inside}</{name}>\n")
}

fn array(name: &str, kind: &str, components: usize, data: &[u8]) -> String {
    let length = (data.len() as u64).to_le_bytes();
    let text = base64(&[&length, data].concat());
    // Some readers interpret an explicit 1 as vectors of one component.
    let vector = match components {
        1 => String::new(),
        n => format!(" NumberOfComponents=\"{n}\""),
    };
    format!(
        "<DataArray type=\"{kind}\" Name=\"{name}\"{vector} format=\"binary\">{text}</DataArray>\n"
    )
}

/// Base64 with padding (RFC 4648).
fn base64(data: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(data.len().div_ceil(3) * 4);
    for three in data.chunks(3) {
        let at = |i: usize| u32::from(three.get(i).copied().unwrap_or(0));
        let bits = at(0) << 16 | at(1) << 8 | at(2);
        for i in 0..4 {
            let letter = LETTERS[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= three.len() { char::from(letter) } else { '=' });
        }
    }
    text
}

/// An array in numpy's .npy format 1.0, C order.
fn npy(kind: &str, shape: &[usize], data: &[u8]) -> Vec<u8> {
    let shape = shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape},), }}");
    // Magic, version and length take 10 bytes; data starts at a multiple of 64.
    let padded = (10 + header.len() + 1).next_multiple_of(64) - 10;
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend((padded as u16).to_le_bytes());
    file.extend(format!("{header:<0$}\n", padded - 1).bytes());
    file.extend(data);
    file
}

/// A zip archive without compression (PKWARE APPNOTE 6.3, sections 4.3.7, 4.3.12 and 4.3.16).
///
/// Sizes are 32-bit: the largest mesh allowed takes a tenth of that.
#[derive(Default)]
struct Archive {
    entries: Vec<u8>,
    directory: Vec<u8>,
    count: u16,
}

impl Archive {
    fn add(&mut self, name: &str, data: &[u8]) {
        let name = format!("{name}.npy");
        let (start, size) = ((self.entries.len() as u32).to_le_bytes(), data.len() as u32);
        // Version 2.0, names in UTF-8, stored, midnight of 1980-01-01, checksum, sizes, lengths.
        let mut common = vec![20, 0, 0, 8, 0, 0, 0, 0, 0x21, 0];
        for word in [crc32(data), size, size, name.len() as u32] {
            common.extend(word.to_le_bytes());
        }
        self.entries.extend(b"PK\x03\x04");
        self.entries.extend(&common);
        self.entries.extend(name.bytes());
        self.entries.extend(data);
        self.directory.extend(b"PK\x01\x02\x14\x00");
        self.directory.extend(&common);
        // No comment, first disc, no attributes.
        self.directory.extend([0; 10]);
        self.directory.extend(start);
        self.directory.extend(name.bytes());
        self.count += 1;
    }

    fn finish(mut self) -> Vec<u8> {
        let (start, size) = (self.entries.len() as u32, self.directory.len() as u32);
        self.entries.append(&mut self.directory);
        self.entries.extend(b"PK\x05\x06\0\0\0\0");
        self.entries.extend([self.count.to_le_bytes(); 2].concat());
        self.entries.extend([size.to_le_bytes(), start.to_le_bytes()].concat());
        self.entries.extend([0; 2]);
        self.entries
    }
}

/// Checksum of zip (CRC-32, reflected polynomial 0xEDB88320).
fn crc32(data: &[u8]) -> u32 {
    let table: [u32; 256] = std::array::from_fn(|i| {
        (0..8).fold(i as u32, |c, _| if c & 1 == 1 { c >> 1 ^ 0xEDB8_8320 } else { c >> 1 })
    });
    !data.iter().fold(!0, |c, &byte| table[((c ^ u32::from(byte)) & 0xFF) as usize] ^ c >> 8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Grading, PadMesh, PadOutline};

    fn pad() -> TetMesh {
        let outline = PadOutline::flat(0.02, 0.01, 0.003);
        PadMesh::new(&outline, &Grading::uniform(0.002)).unwrap().mesh
    }

    #[test]
    fn checksums_and_letters_are_those_of_the_standards() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
        let samples: [(&[u8], &str); 4] =
            [(b"", ""), (b"f", "Zg=="), (b"fo", "Zm8="), (b"foobar", "Zm9vYmFy")];
        for (data, text) in samples {
            assert_eq!(base64(data), text);
        }
    }

    #[test]
    fn arrays_start_at_multiples_of_64() {
        for shape in [&[3][..], &[12_345, 3]] {
            let file = npy("<f8", shape, &[]);
            assert_eq!(file.len() % 64, 0, "{} bytes of header", file.len());
            assert_eq!(file.last(), Some(&b'\n'));
        }
    }

    /// The entries of an archive, by the sizes in their headers.
    fn entries(mut archive: &[u8]) -> Vec<(String, Vec<u8>)> {
        let mut found = Vec::new();
        while archive.starts_with(b"PK\x03\x04") {
            let word = |at: usize| u32::from_le_bytes(archive[at..at + 4].try_into().unwrap());
            let (sum, size, name) = (word(14), word(18) as usize, word(26) as usize);
            let (name, rest) = archive[30..].split_at(name);
            let (data, rest) = rest.split_at(size);
            assert_eq!(crc32(data), sum);
            found.push((String::from_utf8(name.to_vec()).unwrap(), data.to_vec()));
            archive = rest;
        }
        assert!(archive.starts_with(b"PK\x01\x02"), "the directory follows the entries");
        found
    }

    #[test]
    fn what_is_written_is_there_to_the_bit() {
        let mesh = pad();
        let values: Vec<f64> = (0..3 * mesh.vertices.len()).map(|i| (i as f64).sqrt()).collect();
        let field =
            Field { name: "displacement", on: FieldOn::Vertices, components: 3, values: &values };
        let entries = entries(&mesh.npz(std::slice::from_ref(&field)));
        let names: Vec<_> = entries.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["vertices.npy", "tets.npy", "displacement.npy"]);
        assert!(entries[2].1.ends_with(&bytes(&values)));
        let header = String::from_utf8_lossy(&entries[2].1[10..128]).into_owned();
        let shape = format!("'shape': ({}, 3,)", mesh.vertices.len());
        assert!(header.contains(&shape) && header.contains("'descr': '<f8'"), "{header}");
        let data = bytes(&values);
        let text = base64(&[&(data.len() as u64).to_le_bytes(), &data[..]].concat());
        let vtu = mesh.vtu(&[field]);
        let vector = "Name=\"displacement\" NumberOfComponents=\"3\" format=\"binary\">";
        assert!(vtu.contains(&format!("{vector}{text}</DataArray>")), "no displacement in .vtu");
        assert!(vtu.contains("<PointData>") && vtu.contains("types"), "{}", &vtu[..400]);
    }

    #[test]
    fn fields_that_do_not_fit_are_named() {
        let mesh = pad();
        let values = vec![0.0; mesh.tets.len()];
        let field =
            |name, components| Field { name, on: FieldOn::Tets, components, values: &values };
        let message = |path: &str, fields: &[Field]| {
            mesh.write(Path::new(path), fields).unwrap_err().to_string()
        };
        assert!(message("a.vtu", &[field("stress", 3)]).starts_with("field stress: found"));
        assert!(message("a.vtu", &[field("a<b", 1)]).starts_with("field name"));
        assert!(message("a.npz", &[field("a", 1), field("a", 1)]).contains("every name once"));
        assert!(message("a.npz", &[field("tets", 1)]).starts_with("field name"));
        assert!(message("a.txt", &[]).contains(".vtu or .npz"));
        assert!(message("no/such/folder/a.vtu", &[]).starts_with("no/such/folder"));
    }
}
