//! Order of modules: `lib.rs` declares them from the lowest layer up; none may import a later one,
//! and no files import each other in a circle.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

#[test]
fn no_module_imports_a_higher_floor() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let floors = modules(&source);
    for (floor, module) in floors.iter().enumerate() {
        for file in files(&source, module) {
            let text = fs::read_to_string(&file).unwrap();
            for above in &floors[floor + 1..] {
                assert!(!imports(&text, above), "{} reaches up to {above}", file.display());
            }
        }
    }
}

#[test]
fn the_readme_lists_every_module_in_order() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = fs::read_to_string(root.join("README.md")).unwrap();
    let names =
        |row: &str| row.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>();
    let rows = readme.lines().skip_while(|line| !line.starts_with("| module |")).skip(2);
    let rows = rows.map_while(|row| row.strip_prefix('|')?.split('|').next());
    assert_eq!(rows.flat_map(names).collect::<Vec<_>>(), modules(&root.join("src")));
}

/// Top-level modules, private and public, in the order of `lib.rs`.
fn modules(source: &Path) -> Vec<String> {
    let library = fs::read_to_string(source.join("lib.rs")).unwrap();
    let module = |line: &str| {
        let line = line.strip_prefix("pub ").unwrap_or(line);
        Some(line.strip_prefix("mod ")?.strip_suffix(';')?.to_owned())
    };
    let modules: Vec<String> = library.lines().filter_map(module).collect();
    assert!(modules.len() > 4, "found only {modules:?} in lib.rs");
    modules
}

/// Returns whether `text` names `module` right after `crate::`, alone or first in a brace's list.
fn imports(text: &str, module: &str) -> bool {
    text.match_indices("crate::").any(|(at, prefix)| {
        let rest = &text[at + prefix.len()..];
        match rest.strip_prefix('{') {
            Some(list) => entries(list).any(|entry| first_word(entry) == module),
            None => first_word(rest) == module,
        }
    })
}

/// Entries of an import list, nested lists uncut.
fn entries(list: &str) -> impl Iterator<Item = &str> {
    let (mut depth, mut start, mut entries) = (0, 0, Vec::new());
    for (i, c) in list.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => {
                entries.push(&list[start..i]);
                break;
            }
            '}' => depth -= 1,
            ',' if depth == 0 => {
                entries.push(&list[start..i]);
                start = i + 1;
            }
            _ => {}
        }
    }
    entries.into_iter().map(str::trim).filter(|entry| !entry.is_empty())
}

fn first_word(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    &text[..end]
}

fn files(source: &Path, module: &str) -> Vec<PathBuf> {
    let single = source.join(module).with_extension("rs");
    let mut files: Vec<_> = single.is_file().then_some(single).into_iter().collect();
    let mut folders = vec![source.join(module)];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = fs::read_dir(folder) else { continue };
        for path in entries.map(|entry| entry.unwrap().path()) {
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files
}

#[test]
fn an_upward_import_would_be_seen() {
    let text = "use crate::{Error, scene::{Object, task}, env::Row};\nuse crate::render::Item;";
    for (module, seen) in [("env", true), ("render", true), ("scene", true), ("task", false)] {
        assert_eq!(imports(text, module), seen, "{module}");
    }
}

/// Paths that each module imports, by its name, such as `crate::scene::world`.
type Imports = BTreeMap<String, Vec<String>>;

/// Imports that may close a circle: a `Shape` can be a rounded or a sampled solid, which holds the
/// `Shape` from which it was made.
const NATURAL: [[&str; 2]; 2] = [
    ["crate::geometry::shape", "crate::geometry::rounded"],
    ["crate::geometry::shape", "crate::geometry::sampled"],
];

#[test]
fn no_files_import_each_other_in_a_circle() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let read = |file: PathBuf| {
        let place = Path::new("crate").join(file.strip_prefix(&source).unwrap().with_extension(""));
        let name = place.iter().map(|part| part.to_str().unwrap()).collect::<Vec<_>>().join("::");
        let name = name.trim_end_matches("::lib").trim_end_matches("::mod");
        (name.to_owned(), paths(&fs::read_to_string(&file).unwrap()))
    };
    let mut edges = edges(&files(&source, "").into_iter().map(read).collect());
    for natural in NATURAL.map(|edge| edge.map(String::from)) {
        assert!(edges.remove(&natural), "{natural:?} is no longer an import");
    }
    let circles = circles(&edges);
    assert!(circles.is_empty(), "circles of imports: {circles:#?}");
}

/// Paths after `use`, and others from `crate` or `super`, in a file's text; comments and tests are
/// left out.
fn paths(text: &str) -> Vec<String> {
    let code = text.split("mod tests {").next().unwrap().lines();
    let code: String =
        code.map(|line| line.split("//").next().unwrap().to_owned() + "\n").collect();
    let continues = |c: char| c.is_alphanumeric() || "_:".contains(c);
    let starts = ["use ", "crate::", "super::"].into_iter().flat_map(|s| code.match_indices(s));
    let starts = starts.filter(|(at, _)| !code[..*at].ends_with(continues));
    starts.flat_map(|(at, _)| leaves(code[at..].trim_start_matches("use "))).collect()
}

/// The single paths of an import such as `a::{b, c::d}`.
fn leaves(tree: &str) -> Vec<String> {
    let in_path = |c: char| c.is_alphanumeric() || "_:".contains(c);
    let (path, rest) = tree.split_at(tree.find(|c| !in_path(c)).unwrap_or(tree.len()));
    match rest.strip_prefix('{') {
        Some(list) => entries(list).flat_map(leaves).map(|leaf| path.to_owned() + &leaf).collect(),
        None => vec![path.to_owned()],
    }
}

/// Pairs of a module and another whose items it imports. Those inside it do not count.
fn edges(imports: &Imports) -> BTreeSet<[String; 2]> {
    let of = |(from, paths): (&String, &Vec<String>)| {
        let to = paths.iter().map(|path| definition(imports, from, path));
        let outside = to.filter(|to| !format!("{to}::").starts_with(&format!("{from}::")));
        outside.map(|to| [from.clone(), to]).collect::<Vec<_>>()
    };
    imports.iter().flat_map(of).collect()
}

/// Module that defines the item with this `path` as seen from `module`, past re-exports.
fn definition(imports: &Imports, module: &str, path: &str) -> String {
    let mut at = module.to_owned();
    for name in path.split("::") {
        let inside = format!("{at}::{name}");
        match name {
            "self" | "" => {}
            "crate" => name.clone_into(&mut at),
            "super" => at.truncate(at.rfind("::").expect("a module above")),
            _ if imports.contains_key(&inside) => at = inside,
            _ => {
                let end = format!("::{name}");
                let imported = imports[&at].iter().find(|path| path.ends_with(&end));
                return imported.map_or(at.clone(), |path| definition(imports, &at, path));
            }
        }
    }
    at
}

/// The `edges` from whose end imports lead back to their start.
fn circles(edges: &BTreeSet<[String; 2]>) -> Vec<String> {
    let is_circular = |[start, end]: &&[String; 2]| {
        let (mut reached, mut next) = (BTreeSet::from([end]), vec![end]);
        while let Some(at) = next.pop() {
            let from = edges.range([at.clone(), String::new()]..);
            let to = from.take_while(|[from, _]| from == at).map(|[_, to]| to);
            next.extend(to.filter(|to| reached.insert(to)));
        }
        reached.contains(start)
    };
    let circular = edges.iter().filter(is_circular);
    circular.map(|[module, other]| format!("{module} imports {other}")).collect()
}

#[test]
fn a_circle_of_imports_would_be_seen() {
    let module = |(name, text): (&str, &str)| (name.to_owned(), paths(text));
    let imports = [
        ("crate::m", "pub use a::{A, B};\npub use c::C;"),
        ("crate::m::a", "use super::{b::{self, Item}, C};"),
        ("crate::m::b", "fn f() -> super::A {}"),
        ("crate::m::c", "use crate::n::N; // use super::A;"),
        ("crate::n", "use std::fmt;\n#[cfg(test)]\nmod tests {\nuse crate::m::C;\n}"),
    ];
    let edges = edges(&imports.map(module).into());
    let circle = ["crate::m::a imports crate::m::b", "crate::m::b imports crate::m::a"];
    assert_eq!(edges.len(), 4, "{edges:?}");
    assert_eq!(circles(&edges), circle);
}
