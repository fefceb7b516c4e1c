//! Holds the sources to sizes that can be read at once: no file has more than 500 lines without its
//! tests, and a function of more than 80 lines says in its documentation why it is long.

use std::fs;
use std::path::{Path, PathBuf};

const MAX_FILE_LINES: usize = 500;
const MAX_FUNCTION_LINES: usize = 80;
/// Words in the documentation of a long function, before the reason.
const REASON: &str = "Long because";
/// Folders of production code.
const FOLDERS: &[&str] = &["src", "viewer/src", "python/src", "data/generate/src"];

/// The lines before the module of tests that ends the file.
fn production(source: &str) -> Vec<&str> {
    let lines: Vec<&str> = source.lines().collect();
    let starts_tests = |n: &usize| {
        let mut items = lines[*n..].iter().filter(|l| !l.starts_with("#["));
        lines[*n] == "#[cfg(test)]"
            && items
                .next()
                .is_some_and(|l| l.starts_with("mod ") && l.ends_with('{'))
    };
    let end = (0..lines.len()).find(starts_tests);
    lines[..end.unwrap_or(lines.len())].to_vec()
}

/// The name of the function that starts in a line, if one does.
fn function_name(line: &str) -> Option<&str> {
    let mut rest = line.trim_start();
    if let Some(after) = rest.strip_prefix("pub") {
        rest = match after.strip_prefix('(') {
            Some(after) => after.split_once(')')?.1,
            None => after,
        };
        rest = rest.strip_prefix(' ')?;
    }
    for word in ["default ", "const ", "async ", "unsafe ", "extern \"C\" "] {
        rest = rest.strip_prefix(word).unwrap_or(rest);
    }
    let rest = rest.strip_prefix("fn ")?;
    let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_'))?;
    Some(&rest[..end])
}

/// The number of lines of the function that starts at the first of `lines`; none without a body.
fn function_length(lines: &[&str]) -> Option<usize> {
    let indentation = lines[0].len() - lines[0].trim_start().len();
    let end = format!("{}}}", &lines[0][..indentation]);
    let signature = lines.iter().position(|l| l.ends_with(['{', '}', ';']))?;
    if !lines[signature].ends_with('{') {
        return lines[signature].ends_with('}').then_some(signature + 1);
    }
    lines.iter().position(|l| *l == end).map(|last| last + 1)
}

/// Whether the documentation that ends before a line gives the reason of a long function.
fn has_reason(before: &[&str]) -> bool {
    let attached = before.iter().rev().map(|l| l.trim_start());
    let mut attached = attached.take_while(|l| {
        l.starts_with("///") || l.starts_with("#[") || l.ends_with(']') || l.ends_with(',')
    });
    attached.any(|l| l.starts_with("///") && l.contains(REASON))
}

/// What is too long in a source.
fn too_long(file: &str, source: &str) -> Vec<String> {
    let lines = production(source);
    let mut found = Vec::new();
    if lines.len() > MAX_FILE_LINES {
        let count = lines.len();
        found.push(format!("{file}: {count} lines, limit {MAX_FILE_LINES}"));
    }
    for (n, line) in lines.iter().enumerate() {
        let length =
            function_name(line).and_then(|name| Some((name, function_length(&lines[n..])?)));
        if let Some((name, length)) = length
            && length > MAX_FUNCTION_LINES
            && !has_reason(&lines[..n])
        {
            found.push(format!(
                "{file}:{}: {name} has {length} lines, limit {MAX_FUNCTION_LINES}; split it, or document \"{REASON} …\"",
                n + 1
            ));
        }
    }
    found
}

/// The sources in a folder, without files of tests.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("");
        if path.is_dir() {
            sources(&path, found);
        } else if name.ends_with(".rs") && !name.ends_with("tests.rs") {
            found.push(path);
        }
    }
}

#[test]
fn files_and_functions_keep_their_limits() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    for folder in FOLDERS {
        sources(&root.join(folder), &mut files);
    }
    assert!(files.len() > 300, "{} files", files.len());
    let mut found = Vec::new();
    let mut functions = 0;
    for path in files {
        let source = fs::read_to_string(&path).expect("a source");
        let name = path.strip_prefix(root).unwrap_or(&path);
        found.extend(too_long(&name.display().to_string(), &source));
        let lines = source.lines();
        functions += lines.filter(|l| function_name(l).is_some()).count();
    }
    assert!(functions > 3000, "{functions} functions");
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn long_files_and_functions_without_reason_are_found() {
    let filler = |count: usize| "        work();\n".repeat(count);
    let of = |documentation: &str, count: usize| {
        format!(
            "impl Thing {{\n    {documentation}\n    #[must_use]\n    pub(crate) const fn long(\n        &self,\n    ) -> u32 {{\n{}    }}\n}}\n",
            filler(count)
        )
    };
    assert!(too_long("a.rs", &of("/// Works.", 76)).is_empty());
    let found = too_long("a.rs", &of("/// Works.", 77));
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(
        found[0].starts_with("a.rs:4: long has 81 lines"),
        "{found:?}"
    );
    let reason = "/// Works. Long because it lists all.";
    assert!(too_long("a.rs", &of(reason, 200)).is_empty());
    // The reason of one function is none of the next.
    let two = format!("{}{}", of(reason, 200), of("/// Works.", 77));
    assert_eq!(too_long("a.rs", &two).len(), 1);
    // Declarations end at once.
    let declared = format!("trait A {{\n    fn a(&self);\n{}}}\n", filler(90));
    assert!(too_long("a.rs", &declared).is_empty());
    let tests = format!("#[cfg(test)]\nmod tests {{\n{}}}\n", of("", 600));
    assert!(too_long("a.rs", &format!("{}{tests}", filler(500))).is_empty());
    let found = too_long("a.rs", &format!("{}{tests}", filler(501)));
    assert_eq!(found, ["a.rs: 501 lines, limit 500"]);
}
