//! Import of tetrahedral meshes: Isaac Gym's .tet text and gmsh's ASCII .msh, 2.2 and 4.1.
//!
//! .tet: a line `v x y z` for every vertex and `t a b c d`, counted from 0, for every tetrahedron.
//! .msh: the sections `$MeshFormat`, `$Nodes` and `$Elements` of the gmsh manual, chapter "Gmsh
//! file formats". Elements other than tetrahedra are skipped; of ten-node tetrahedra only the
//! corners are read.

use std::{collections::HashMap, fs, iter::Enumerate, path::Path, str::FromStr, str::Lines};

use nalgebra::Point3;

use super::{TetMesh, tet_mesh::MOST_PARTS};
use crate::{Error, Result};

/// Largest file that is read (bytes): far more than [`MOST_PARTS`] vertices take.
const LARGEST: u64 = 1 << 30;

type VerticesAndTets = (Vec<Point3<f64>>, Vec<[u32; 4]>);
/// Parsed value, or a description of the defect with its line.
type Parsed<T> = std::result::Result<T, String>;

impl TetMesh {
    /// Reads a mesh from a .tet or .msh file, with `scale` metres to a unit of the file.
    ///
    /// Vertices that no tetrahedron uses are left out.
    pub fn read(path: &Path, scale: f64) -> Result<Self> {
        if !(scale.is_finite() && scale > 0.0) {
            return Err(Error::invalid("scale", scale, "a finite number of metres above 0"));
        }
        let name = path.display().to_string();
        let parse: fn(&str) -> Parsed<VerticesAndTets> =
            match path.extension().and_then(|e| e.to_str()).unwrap_or_default() {
                "tet" => parse_tet,
                "msh" => parse_msh,
                _ => return Err(Error::invalid("mesh file", name, "a name in .tet or .msh")),
            };
        let length = fs::metadata(path).map_err(|error| Error::file(path, error))?.len();
        if length > LARGEST {
            let reason = format!("{length} bytes, expected at most {LARGEST}");
            return Err(Error::file(path, reason));
        }
        let text = fs::read_to_string(path).map_err(|error| Error::file(path, error))?;
        let (vertices, tets) = parse(&text).map_err(|reason| Error::file(path, reason))?;
        let (vertices, tets) = without_unused(&vertices, tets, scale);
        Self::new(&name, vertices, tets)
    }
}

/// Keeps the used vertices and scales them. Indices out of range stay so, for the later check to
/// report.
fn without_unused(
    vertices: &[Point3<f64>],
    mut tets: Vec<[u32; 4]>,
    scale: f64,
) -> VerticesAndTets {
    let mut renumbered = vec![u32::MAX; vertices.len()];
    for &i in tets.iter().flatten() {
        if let Some(slot) = renumbered.get_mut(i as usize) {
            *slot = 0;
        }
    }
    let mut kept = Vec::new();
    for (vertex, slot) in vertices.iter().zip(&mut renumbered) {
        if *slot == 0 {
            *slot = kept.len() as u32;
            kept.push(vertex * scale);
        }
    }
    for i in tets.iter_mut().flatten() {
        *i = renumbered.get(*i as usize).copied().unwrap_or(u32::MAX);
    }
    (kept, tets)
}

fn parse_tet(text: &str) -> Parsed<VerticesAndTets> {
    let (mut vertices, mut tets) = (Vec::new(), Vec::new());
    for (i, line) in text.lines().enumerate() {
        let line = NumberedLine { number: i + 1, text: line };
        let text = line.text.trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let Some((kind, rest)) = text.split_once(char::is_whitespace) else {
            return Err(line.wrong(text, "`v x y z` or `t a b c d`"));
        };
        let record = NumberedLine { text: rest, ..line };
        match kind {
            "v" => vertices.push(Point3::from(record.exactly::<f64, 3>("three coordinates")?)),
            "t" => tets.push(record.exactly::<u32, 4>("four vertices")?),
            other => return Err(line.wrong(other, "`v x y z` or `t a b c d`")),
        }
        within(&line, vertices.len().max(tets.len()))?;
    }
    Ok((vertices, tets))
}

fn parse_msh(text: &str) -> Parsed<VerticesAndTets> {
    let mut file = Reader { lines: text.lines().enumerate() };
    let mut version = None;
    let (mut numbers, mut vertices, mut tets) = (HashMap::new(), Vec::new(), Vec::new());
    while let Some(line) = file.next_filled() {
        match (line.text.trim(), version) {
            ("$MeshFormat", _) => version = Some(read_version(&file.line()?)?),
            ("$Nodes" | "$Elements", None) => {
                return Err(line.wrong(line.text, "$MeshFormat before it"));
            }
            ("$Nodes", Some(4)) => {
                file.blocks(&mut |file, head| file.node_block(head, &mut numbers, &mut vertices))?;
            }
            ("$Nodes", _) => file.nodes_2(&mut numbers, &mut vertices)?,
            ("$Elements", Some(4)) => {
                file.blocks(&mut |file, block| file.element_block(block, &numbers, &mut tets))?;
            }
            ("$Elements", _) => file.elements_2(&numbers, &mut tets)?,
            _ => {}
        }
    }
    if version.is_none() {
        return Err("no $MeshFormat section, expected a gmsh file".to_owned());
    }
    Ok((vertices, tets))
}

/// Major version 2 or 4 of an ASCII file of version 2.2 or 4.1.
fn read_version(line: &NumberedLine) -> Parsed<u32> {
    let mut words = line.text.split_whitespace();
    match (words.next(), words.next()) {
        (Some("2.2"), Some("0")) => Ok(2),
        (Some("4.1"), Some("0")) => Ok(4),
        (Some("2.2" | "4.1"), _) => Err(line.wrong("a binary file", "an ASCII one")),
        _ => Err(line.wrong(line.text, "version 2.2 or 4.1")),
    }
}

/// Returns whether `kind` is a tetrahedral element type of gmsh, with 4 or with 10 nodes.
fn is_tetrahedron(kind: usize) -> bool {
    kind == 4 || kind == 11
}

struct Reader<'a> {
    lines: Enumerate<Lines<'a>>,
}

#[derive(Clone, Copy)]
struct NumberedLine<'a> {
    number: usize,
    text: &'a str,
}

impl<'a> Reader<'a> {
    fn next_filled(&mut self) -> Option<NumberedLine<'a>> {
        let (i, text) = self.lines.find(|(_, text)| !text.trim().is_empty())?;
        Some(NumberedLine { number: i + 1, text })
    }

    fn line(&mut self) -> Parsed<NumberedLine<'a>> {
        self.next_filled().ok_or_else(|| "the file ends inside a section".to_owned())
    }

    /// `$Nodes` of version 2.2: a count, then `number x y z` on every line.
    fn nodes_2(
        &mut self,
        numbers: &mut HashMap<u64, u32>,
        vertices: &mut Vec<Point3<f64>>,
    ) -> Parsed<()> {
        for _ in 0..self.count()? {
            let line = self.line()?;
            let [number, x, y, z] = line.exactly::<f64, 4>("a number and three coordinates")?;
            line.insert(number as u64, numbers, vertices.len())?;
            vertices.push(Point3::new(x, y, z));
        }
        Ok(())
    }

    /// `$Elements` of version 2.2: a count, then `number type tags… nodes…` with the count of tags.
    fn elements_2(&mut self, numbers: &HashMap<u64, u32>, tets: &mut Vec<[u32; 4]>) -> Parsed<()> {
        for _ in 0..self.count()? {
            let line = self.line()?;
            let words = line.words::<u64>("whole numbers")?;
            let [_, kind, tags, ..] = words[..] else {
                return Err(line.wrong(line.text, "a number, a type and tags"));
            };
            if is_tetrahedron(kind as usize) {
                let nodes = words.get(3usize.saturating_add(tags as usize)..).unwrap_or_default();
                tets.push(line.corners(nodes, numbers)?);
            }
        }
        Ok(())
    }

    /// A section of version 4.1: a line of totals, then blocks that begin with their own four
    /// numbers, of which the last counts entries.
    fn blocks(&mut self, block: &mut dyn FnMut(&mut Self, [usize; 4]) -> Parsed<()>) -> Parsed<()> {
        let [blocks, ..] = self.line()?.exactly::<usize, 4>("four totals")?;
        for _ in 0..blocks {
            let line = self.line()?;
            let head = line.words::<i64>("four numbers")?;
            let [a, b, c, entries] = head[..] else {
                return Err(line.wrong(line.text, "four numbers"));
            };
            within(&line, entries as usize)?;
            block(self, [a, b, c, entries].map(|x| x as usize))?;
        }
        Ok(())
    }

    fn node_block(
        &mut self,
        [.., entries]: [usize; 4],
        numbers: &mut HashMap<u64, u32>,
        vertices: &mut Vec<Point3<f64>>,
    ) -> Parsed<()> {
        for i in 0..entries {
            let line = self.line()?;
            let [number] = line.exactly::<u64, 1>("a node number")?;
            line.insert(number, numbers, vertices.len() + i)?;
        }
        for _ in 0..entries {
            let line = self.line()?;
            // Parametric coordinates may follow.
            let words = line.words::<f64>("three coordinates")?;
            let [x, y, z, ..] = words[..] else {
                return Err(line.wrong(line.text, "three coordinates"));
            };
            vertices.push(Point3::new(x, y, z));
        }
        Ok(())
    }

    fn element_block(
        &mut self,
        [_, _, kind, entries]: [usize; 4],
        numbers: &HashMap<u64, u32>,
        tets: &mut Vec<[u32; 4]>,
    ) -> Parsed<()> {
        for _ in 0..entries {
            let line = self.line()?;
            if is_tetrahedron(kind) {
                let words = line.words::<u64>("whole numbers")?;
                tets.push(line.corners(words.get(1..).unwrap_or_default(), numbers)?);
            }
        }
        Ok(())
    }

    fn count(&mut self) -> Parsed<usize> {
        let line = self.line()?;
        let [count] = line.exactly::<usize, 1>("a count")?;
        within(&line, count)?;
        Ok(count)
    }
}

impl NumberedLine<'_> {
    fn wrong(&self, found: &str, expected: &str) -> String {
        let found: String = found.chars().take(40).collect();
        format!("line {}: found {found}, expected {expected}", self.number)
    }

    fn words<T: FromStr>(&self, expected: &str) -> Parsed<Vec<T>> {
        let parse = |word: &str| word.parse().map_err(|_| self.wrong(word, expected));
        // No valid record has more words; a damaged line must not fill the memory.
        self.text.split_whitespace().take(256).map(parse).collect()
    }

    fn exactly<T: FromStr, const N: usize>(&self, expected: &str) -> Parsed<[T; N]> {
        self.words(expected)?.try_into().map_err(|_| self.wrong(self.text, expected))
    }

    /// Records that the file's node `number` is vertex `index`.
    fn insert(&self, number: u64, numbers: &mut HashMap<u64, u32>, index: usize) -> Parsed<()> {
        match numbers.insert(number, index as u32) {
            Some(_) => Err(self.wrong(&format!("node {number} again"), "every number once")),
            None => Ok(()),
        }
    }

    fn corners(&self, nodes: &[u64], numbers: &HashMap<u64, u32>) -> Parsed<[u32; 4]> {
        let [a, b, c, d, ..] = nodes[..] else {
            return Err(self.wrong(self.text, "at least four nodes of a tetrahedron"));
        };
        let mut corners = [0; 4];
        for (corner, node) in corners.iter_mut().zip([a, b, c, d]) {
            let known = numbers.get(&node);
            *corner = *known
                .ok_or_else(|| self.wrong(&format!("node {node}"), "one listed under $Nodes"))?;
        }
        Ok(corners)
    }
}

fn within(line: &NumberedLine, count: usize) -> Parsed<()> {
    if count <= MOST_PARTS {
        return Ok(());
    }
    Err(line.wrong(&format!("{count} entries"), &format!("at most {MOST_PARTS}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TET: &str = "#pair\n#\n\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 9 9 9\nv 0.2 0.2 -1e0\n\
                       t 0 1 2 3\nt 0 2 1 5\n";
    const MSH_2: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n6\n1 0 0 0\n2 1 0 0\n\
        3 0 1 0\n4 0 0 1\n50 9 9 9\n6 0.2 0.2 -1\n$EndNodes\n$Elements\n3\n1 2 2 1 1 1 2 3\n\
        2 4 2 1 1 1 2 3 4\n3 4 2 1 1 1 3 2 6\n$EndElements\n";
    const MSH_4: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 1\n\
        1 0 0 0 1 1 1 0 0\n$EndEntities\n$Nodes\n2 6 1 50\n2 1 0 2\n1\n2\n0 0 0\n1 0 0\n\
        3 1 0 4\n3\n4\n50\n6\n0 1 0\n0 0 1\n9 9 9\n0.2 0.2 -1\n$EndNodes\n$Elements\n2 3 1 3\n\
        2 1 2 1\n1 1 2 3\n3 1 4 2\n2 1 2 3 4\n3 1 3 2 6\n$EndElements\n";

    fn mesh(parts: &VerticesAndTets) -> TetMesh {
        let (vertices, tets) = without_unused(&parts.0, parts.1.clone(), 1e-3);
        TetMesh::new("pair", vertices, tets).unwrap()
    }

    #[test]
    fn every_format_gives_the_same_mesh() {
        let tet = mesh(&parse_tet(TET).unwrap());
        assert_eq!((tet.vertices.len(), tet.tets.len()), (5, 2));
        // Bases of 1/2 mm², heights of 1 mm.
        assert!((tet.volume() - 1e-9 / 3.0).abs() < 1e-24, "{} m³", tet.volume());
        assert_eq!(mesh(&parse_msh(MSH_2).unwrap()), tet);
        assert_eq!(mesh(&parse_msh(MSH_4).unwrap()), tet);
    }

    #[test]
    fn files_are_told_apart_by_their_names() {
        let folder = std::env::temp_dir().join(format!("ruffini-tet-file-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let read = |name: &str, text: &str, scale: f64| {
            let path = folder.join(name);
            fs::write(&path, text).unwrap();
            TetMesh::read(&path, scale)
        };
        let tet = read("pair.tet", TET, 1e-3).unwrap();
        assert_eq!(read("pair.msh", MSH_4, 1e-3).unwrap(), tet);
        let message = |result: Result<TetMesh>| result.unwrap_err().to_string();
        assert!(message(read("pair.txt", TET, 1.0)).contains(".tet or .msh"));
        assert!(message(read("pair.tet", TET, -1.0)).starts_with("scale"));
        assert!(message(read("pair.tet", "v 0 0", 1.0)).contains("line 1"));
        assert!(message(read("pair.tet", "", 1.0)).contains("0 tetrahedra"));
        assert!(message(TetMesh::read(&folder.join("none.tet"), 1.0)).contains("none.tet"));
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn defects_are_named_with_their_line() {
        let tet = |from: &str, to: &str| parse_tet(&TET.replacen(from, to, 1)).unwrap_err();
        assert!(tet("v 1 0 0", "v 1 0").starts_with("line 5: found 1 0, expected three"));
        assert!(tet("t 0 1 2 3", "t 0 1 x 3").starts_with("line 10: found x"));
        assert!(tet("v 0 0 0", "f 0 0 0").starts_with("line 4: found f"));
        let two = |from: &str, to: &str| parse_msh(&MSH_2.replacen(from, to, 1)).unwrap_err();
        assert!(two("2.2 0", "2.2 1").contains("line 2: found a binary file"));
        assert!(two("2.2 0", "3.0 0").contains("line 2"));
        assert!(two("$Nodes\n6", "$Nodes\n99999999").contains("99999999 entries"));
        assert!(two("50 9 9 9", "4 9 9 9").contains("node 4 again"));
        assert!(two("1 3 2 6\n", "1 3 2 7\n").contains("line 17: found node 7"));
        assert!(two("$MeshFormat\n", "").contains("$MeshFormat before it"));
        assert!(two("2 4 2 1", "2 4 99 1").contains("at least four nodes"));
        assert!(
            parse_msh(&MSH_4[..MSH_4.find("9 9 9").unwrap()])
                .unwrap_err()
                .contains("the file ends")
        );
        assert!(parse_msh("").unwrap_err().contains("no $MeshFormat"));
        assert!(parse_msh(&MSH_4.replace("3 1 4 2\n", "3 1 4 -2\n")).is_err());
    }

    #[test]
    fn no_damage_of_a_file_panics() {
        for (text, parse) in [
            (TET, parse_tet as fn(&str) -> Parsed<VerticesAndTets>),
            (MSH_2, parse_msh),
            (MSH_4, parse_msh),
        ] {
            for i in 0..text.len() {
                for damage in ["", "-", "9e99", "\n", "18446744073709551615", "é"] {
                    let damaged = [&text[..i], damage, &text[i + 1..]].concat();
                    if let Ok((vertices, tets)) = parse(&damaged) {
                        let (vertices, tets) = without_unused(&vertices, tets, 1.0);
                        drop(TetMesh::new("damaged", vertices, tets));
                    }
                }
            }
        }
    }
}
