//! Checks the tables of modules in ARCHITECTURE.md against the imports in `src/`: a module imports
//! only modules listed above it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// The modules of the table whose header starts with this cell, from the top down. A row may name
/// several files.
fn table_modules(text: &str, header: &str) -> Vec<String> {
    let rows = text.lines().skip_while(|l| !l.starts_with(header)).skip(2);
    let cells = rows
        .take_while(|l| l.starts_with('|'))
        .filter_map(|l| l.split('|').nth(1));
    let names = cells.flat_map(|cell| cell.split('`').skip(1).step_by(2));
    names
        .map(|n| n.trim_end_matches('/').trim_end_matches(".rs").to_owned())
        .collect()
}

/// The source without comments, strings and tests; lines keep their numbers.
fn code(source: &str) -> String {
    let (mut out, mut skip) = (String::new(), false);
    for line in source.lines() {
        if line == "#[cfg(test)]" {
            skip = true;
        } else if skip {
            // An inline module ends the file; anything else is one item.
            if line.starts_with("mod ") && line.ends_with('{') {
                break;
            }
            skip = !(line.ends_with(';') || line == "}");
        } else {
            let line = line.split("//").next().unwrap_or("");
            let mut parts = line.split('"');
            out.push_str(parts.next().unwrap_or(""));
            parts.skip(1).step_by(2).for_each(|p| out.push_str(p));
        }
        out.push('\n');
    }
    out
}

/// The paths of a tree of imports, and how far it goes.
fn paths(text: &str, prefix: &[String], found: &mut Vec<Vec<String>>) -> usize {
    let bytes = text.as_bytes();
    let (mut at, mut path) = (0, prefix.to_vec());
    loop {
        while bytes.get(at).is_some_and(u8::is_ascii_whitespace) {
            at += 1;
        }
        if bytes.get(at) == Some(&b'{') {
            at += 1;
            loop {
                at += paths(&text[at..], &path, found);
                while bytes.get(at).is_some_and(|b| b.is_ascii_whitespace()) {
                    at += 1;
                }
                match bytes.get(at) {
                    Some(b',') => at += 1,
                    Some(b'}') => return at + 1,
                    _ => return at,
                }
            }
        }
        let start = at;
        while bytes
            .get(at)
            .is_some_and(|b| b.is_ascii_alphanumeric() || *b == b'_')
        {
            at += 1;
        }
        if start == at {
            break;
        }
        path.push(text[start..at].to_owned());
        if !text[at..].starts_with("::") {
            break;
        }
        at += 2;
    }
    if path.len() > prefix.len() {
        if path.last().is_some_and(|l| l == "self") {
            path.pop();
        }
        found.push(path);
    }
    at
}

#[derive(Default)]
struct Sources {
    /// The code of every module, by its path from the root, and its file.
    modules: BTreeMap<Vec<String>, (String, String)>,
    /// What names that modules import stand for.
    names: BTreeMap<(Vec<String>, String), Vec<String>>,
}

impl Sources {
    fn add(&mut self, file: &str, source: &str) {
        let path = file.trim_end_matches(".rs").trim_end_matches("/mod");
        let module: Vec<String> = match path {
            "lib" => Vec::new(),
            path => path.split('/').map(str::to_owned).collect(),
        };
        self.modules.insert(module, (file.to_owned(), code(source)));
    }

    /// A path as written in `module`, from the root.
    fn absolute(&self, module: &[String], path: &[String]) -> Option<Vec<String>> {
        let supers = path.iter().take_while(|s| *s == "super").count();
        let start = match path.first()?.as_str() {
            "crate" => Vec::new(),
            "super" => module[..module.len().checked_sub(supers)?].to_vec(),
            "self" => module.to_vec(),
            first => {
                let mut child = module.to_vec();
                child.push(first.to_owned());
                if !self.modules.contains_key(&child) {
                    return None;
                }
                module.to_vec()
            }
        };
        let rest = path.iter().skip_while(|s| *s == "super");
        let rest = rest.filter(|s| *s != "crate" && *s != "self");
        Some(start.into_iter().chain(rest.cloned()).collect())
    }

    fn read_imports(&mut self) {
        for (module, (_, text)) in &self.modules {
            for (at, _) in text.match_indices("use ") {
                let mut found = Vec::new();
                paths(&text[at + 4..], &[], &mut found);
                for path in found {
                    let Some(full) = self.absolute(module, &path) else {
                        continue;
                    };
                    if let Some(name) = full.last() {
                        let key = (module.clone(), name.clone());
                        self.names.insert(key, full.clone());
                    }
                }
            }
        }
    }

    /// The module in which what this path names is defined.
    fn home(&self, path: &[String], depth: usize) -> Vec<String> {
        let mut module = Vec::new();
        for (k, name) in path.iter().enumerate() {
            let mut child = module.clone();
            child.push(name.clone());
            if self.modules.contains_key(&child) {
                module = child;
                continue;
            }
            if let Some(target) = self.names.get(&(module.clone(), name.clone()))
                && depth < 8
                && target[..] != path[..=k]
            {
                let mut target = target.clone();
                target.extend_from_slice(&path[k + 1..]);
                return self.home(&target, depth + 1);
            }
            break;
        }
        module
    }

    /// Every import, as file, line, module and the module where what it names is defined.
    fn imports(&self) -> Vec<(String, usize, Vec<String>, Vec<String>)> {
        let mut all = Vec::new();
        for (module, (file, text)) in &self.modules {
            if file.ends_with("tests.rs") {
                continue;
            }
            for root in ["crate::", "super::"] {
                for (at, _) in text.match_indices(root) {
                    let before = text[..at].chars().next_back();
                    if before.is_some_and(|c| c.is_alphanumeric() || "_:$".contains(c)) {
                        continue;
                    }
                    // The place at which a path may be seen is none that it uses.
                    if text[..at].ends_with("pub(in ") {
                        continue;
                    }
                    let line = text[..at].matches('\n').count() + 1;
                    let mut found = Vec::new();
                    paths(&text[at..], &[], &mut found);
                    for path in found {
                        if let Some(path) = self.absolute(module, &path) {
                            all.push((file.clone(), line, module.clone(), self.home(&path, 0)));
                        }
                    }
                }
            }
        }
        all
    }
}

/// What another crate can name, by the module where it is defined: types, traits and free
/// functions.
#[derive(Default)]
struct PublicItems {
    modules: BTreeSet<Vec<String>>,
    items: BTreeSet<(Vec<String>, String)>,
}

impl PublicItems {
    /// Adds the public items of `module`, of its public modules and of what it exports.
    fn add(&mut self, sources: &Sources, module: &[String]) {
        if !self.modules.insert(module.to_vec()) {
            return;
        }
        let (_, text) = &sources.modules[module];
        for (at, _) in text.match_indices("pub ") {
            // Only items of the module itself begin a line.
            if at > 0 && !text[..at].ends_with('\n') {
                continue;
            }
            let item = &text[at + 4..];
            let mut words = item.split(|c: char| !(c.is_alphanumeric() || c == '_'));
            let mut next = || words.next().unwrap_or_default().to_owned();
            let mut kind = next();
            if kind == "use" {
                self.add_exports(sources, module, &item[4..]);
                continue;
            }
            let mut name = next();
            while ["fn", "trait"].contains(&name.as_str()) {
                (kind, name) = (name, next());
            }
            let mut path = module.to_vec();
            path.push(name.clone());
            match kind.as_str() {
                "mod" => self.add(sources, &path),
                "const" | "static" => {}
                _ => drop(self.items.insert((module.to_vec(), name))),
            }
        }
        for macros in text.split("#[macro_export]").skip(1) {
            let name = macros.split_whitespace().nth(1).unwrap_or_default();
            self.items.insert((Vec::new(), name.to_owned()));
        }
    }

    fn add_exports(&mut self, sources: &Sources, module: &[String], tree: &str) {
        let mut found = Vec::new();
        paths(tree, &[], &mut found);
        for path in found {
            // Other crates have no path here.
            let Some(path) = sources.absolute(module, &path) else {
                continue;
            };
            match path.split_last() {
                Some((name, _)) if !sources.modules.contains_key(&path) => {
                    // Constants are neither types nor functions.
                    if !name.chars().any(char::is_lowercase) {
                        continue;
                    }
                    let item = (sources.home(&path, 0), name.clone());
                    self.items.insert(item);
                }
                _ => self.add(sources, &path),
            }
        }
    }
}

/// The innermost of the table `rows` that a module below `prefix` is in, by its number.
fn row_of(rows: &[String], prefix: &[&str], module: &[String]) -> Option<usize> {
    let rest = module.strip_prefix(&prefix.iter().map(|p| (*p).to_owned()).collect::<Vec<_>>()[..]);
    let rest = rest?.join("/");
    let inside = |r: &&String| rest == **r || rest.starts_with(&format!("{r}/"));
    let best = rows.iter().filter(inside).max_by_key(|r| r.len());
    match best {
        Some(best) => rows.iter().position(|r| r == best),
        None => rows.iter().position(|r| r == "mod"),
    }
}

/// Every upward import: both table rows, and where it is.
fn upward(sources: &Sources, rows: &[String], prefix: &[&str]) -> Vec<(String, String, String)> {
    let mut found = BTreeSet::new();
    for (file, line, from, to) in sources.imports() {
        let places = (row_of(rows, prefix, &from), row_of(rows, prefix, &to));
        if let (Some(a), Some(b)) = places {
            // A folder shows what lies in it.
            let facade = file.ends_with("mod.rs") && to.starts_with(&from);
            if b > a && !facade {
                let place = format!("{file}:{line}");
                found.insert((rows[a].clone(), rows[b].clone(), place));
            }
        }
    }
    found.into_iter().collect()
}

fn read(folder: &Path, name: &str, sources: &mut Sources) {
    let entries = fs::read_dir(folder).expect("a folder of sources");
    for entry in entries {
        let path = entry.expect("an entry").path();
        let file = path.file_name().and_then(|f| f.to_str()).expect("a name");
        let full = format!("{name}{file}");
        if path.is_dir() {
            read(&path, &format!("{full}/"), sources);
        } else if full.ends_with(".rs") {
            let text = fs::read_to_string(&path).expect("a source");
            sources.add(&full, &text);
        }
    }
}

#[test]
fn modules_import_only_modules_above_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = fs::read_to_string(root.join("ARCHITECTURE.md")).expect("the table of modules");
    let mut sources = Sources::default();
    read(&root.join("src"), "", &mut sources);
    sources.read_imports();
    let outer = table_modules(&text, "| `src/` |");
    let inner = table_modules(&text, "| `src/physics/` |");
    assert!(outer.len() > 10 && inner.len() > 10, "{outer:?} {inner:?}");
    let mut wrong = upward(&sources, &outer, &[]);
    wrong.extend(upward(&sources, &inner, &["physics"]));
    let wrong = wrong.iter();
    let wrong = wrong.map(|(a, b, place)| format!("{place}: {a} uses {b}, which stands below it"));
    let wrong: Vec<String> = wrong.collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn upward_import_is_found_through_a_re_export() {
    let mut sources = Sources::default();
    sources.add("lib.rs", "mod low;\nmod high;\npub use high::Thing;\n");
    sources.add("high/mod.rs", "mod part;\npub use part::Thing;\n");
    sources.add("high/part.rs", "pub struct Thing;\n");
    sources.add("low.rs", "//! Low.\n\nuse crate::{\n    Thing,\n};\n");
    sources.read_imports();
    let rows = ["low".to_owned(), "high".to_owned()];
    let found = upward(&sources, &rows, &[]);
    let place = "low.rs:3".to_owned();
    assert_eq!(found, [("low".to_owned(), "high".to_owned(), place)]);
    let turned = ["high".to_owned(), "low".to_owned()];
    assert!(upward(&sources, &turned, &[]).is_empty());
}

/// The library exports what its users need, and no more.
#[test]
fn library_exports_at_most_412_items() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut sources = Sources::default();
    read(&root.join("src"), "", &mut sources);
    sources.read_imports();
    let mut public = PublicItems::default();
    public.add(&sources, &[]);
    let items = public.items;
    let known = |module: &[&str], name: &str| {
        let module: Vec<String> = module.iter().map(|m| (*m).to_owned()).collect();
        items.contains(&(module, name.to_owned()))
    };
    assert!(known(&["scene"], "Scene") && known(&["mesh"], "TetMesh"));
    assert!(known(&["gpu", "device"], "Gpu") && !known(&["gpu", "device"], "Inner"));
    let names = items
        .iter()
        .map(|(m, name)| format!("{}::{name}", m.join("::")));
    let names: Vec<String> = names.collect();
    assert!(
        names.len() <= 412,
        "{} items; make what no other crate needs `pub(crate)`:\n{}",
        names.len(),
        names.join("\n")
    );
}

#[test]
fn public_items_are_counted_once_and_through_exports() {
    let mut sources = Sources::default();
    sources.add(
        "lib.rs",
        "mod a;\npub mod b;\npub use a::{One, part};\npub use glam;\n",
    );
    sources.add(
        "a/mod.rs",
        "pub mod part;\npub struct One;\npub struct Hidden;\n",
    );
    sources.add(
        "a/part.rs",
        "pub const fn two() {}\npub(crate) fn no() {}\nfn no() {}\n",
    );
    sources.add(
        "b.rs",
        "pub use crate::a::One;\nimpl One {\n    pub fn no() {}\n}\npub type Three = u8;\n",
    );
    sources.read_imports();
    let mut public = PublicItems::default();
    public.add(&sources, &[]);
    let names: Vec<&str> = public.items.iter().map(|(_, name)| name.as_str()).collect();
    assert_eq!(names, ["One", "two", "Three"]);
}
