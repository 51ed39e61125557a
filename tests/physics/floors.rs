//! Order of modules: `lib.rs` declares them from the lowest layer up; none may import a later one.

use std::{
    fs,
    path::{Path, PathBuf},
};

#[test]
fn no_module_imports_a_higher_floor() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let library = fs::read_to_string(source.join("lib.rs")).unwrap();
    let module = |line: &str| Some(line.strip_prefix("pub mod ")?.strip_suffix(';')?.to_owned());
    let floors: Vec<String> = library.lines().filter_map(module).collect();
    assert!(floors.len() > 4, "found only {floors:?} in lib.rs");
    for (floor, module) in floors.iter().enumerate() {
        for file in files(&source, module) {
            let text = fs::read_to_string(&file).unwrap();
            for above in &floors[floor + 1..] {
                assert!(!imports(&text, above), "{} reaches up to {above}", file.display());
            }
        }
    }
}

/// Returns whether `text` names `module` right after `crate::`, alone or first in a brace's list.
fn imports(text: &str, module: &str) -> bool {
    text.match_indices("crate::").any(|(at, prefix)| {
        let rest = &text[at + prefix.len()..];
        match rest.strip_prefix('{') {
            Some(list) => top_level(list).any(|name| name == module),
            None => first_word(rest) == module,
        }
    })
}

/// First words of the entries of an import list, without those of nested lists.
fn top_level(list: &str) -> impl Iterator<Item = &str> {
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
    entries.into_iter().map(|entry| first_word(entry.trim_start()))
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
