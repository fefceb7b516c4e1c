//! The book of docs/: its pages are short, and its reference agrees with the code.
//!
//! With `PALPATE_WRITE` set, the pages that these tests compare are written instead.

use super::command_line::schema;
use std::collections::BTreeSet;
use std::fs::read_to_string;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => found.extend(files(&path, ending)),
            false if path.to_string_lossy().ends_with(ending) => found.push(path),
            false => {}
        }
    }
    found.sort();
    found
}

/// Compares a page with its text, or writes it.
pub fn check_page(name: &str, text: &str) {
    let path = root().join("docs/reference").join(name);
    if std::env::var_os("PALPATE_WRITE").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
    }
    let stored = read_to_string(&path).unwrap_or_default();
    assert!(
        stored == text,
        "{name} is out of date; write it: PALPATE_WRITE=1 cargo test --test suite cli::book cli::report_keys"
    );
}

#[test]
fn pages_have_at_most_150_lines() {
    let mut written = 0;
    for page in files(&root().join("docs"), ".md") {
        let text = read_to_string(&page).unwrap();
        let place = page.strip_prefix(root().join("docs")).unwrap();
        // Studies are as long as their tables.
        if place.starts_with("study") {
            continue;
        }
        let lines = text.lines().count();
        assert!(lines <= 150, "{} has {lines} lines", place.display());
        if text.contains("<!-- Written by") {
            continue;
        }
        written += 1;
        let long = text.lines().filter(|line| !line.starts_with('|'));
        let long = long.map(|line| line.split_whitespace().count()).max();
        assert!(
            long <= Some(110),
            "{} has a paragraph of {long:?} words",
            place.display()
        );
    }
    assert!(written > 50, "{written} pages");
}

/// The schema, and the pages of scenes and commands, which depend on the features.
#[cfg(all(feature = "study", feature = "identify"))]
#[test]
fn reference_agrees_with_the_code() {
    let expected = schema::files().unwrap();
    for (name, text) in &expected {
        check_page(name, text);
    }
    let names: BTreeSet<&str> = expected.iter().map(|(name, _)| name.as_str()).collect();
    for folder in ["scene", "cli"] {
        for page in files(&root().join("docs/reference").join(folder), ".md") {
            let place = page.strip_prefix(root().join("docs/reference")).unwrap();
            let name = place.to_string_lossy();
            assert!(names.contains(name.as_ref()), "{name} describes nothing");
        }
    }
}

#[test]
fn shipped_scenes_name_their_schema() {
    let mut scenes = Vec::new();
    for folder in ["data/scenes", "docs/scan", "viewer/examples"] {
        scenes.extend(files(&root().join(folder), ".toml"));
    }
    assert!(scenes.len() > 30, "{} scenes", scenes.len());
    for scene in scenes {
        let text = read_to_string(&scene).unwrap();
        let schema = text
            .lines()
            .next()
            .and_then(|line| line.strip_prefix("#:schema "));
        let schema = schema.unwrap_or_else(|| panic!("{}: no #:schema", scene.display()));
        let schema = scene.parent().unwrap().join(schema);
        assert!(schema.is_file(), "{}", schema.display());
    }
}

/// Lines of Rust in the tutorials stand in the example that the page names, which CI compiles.
#[test]
fn rust_of_tutorials_stands_in_examples() {
    let mut compared = 0;
    for page in files(&root().join("docs/tutorials"), ".md") {
        let text = read_to_string(&page).unwrap();
        let Some(example) = text.split("](../../examples/").nth(1) else {
            continue;
        };
        let example = root()
            .join("examples")
            .join(example.split(')').next().unwrap());
        let source = read_to_string(&example).unwrap();
        let source: Vec<&str> = source.lines().collect();
        for block in text.split("```rust\n").skip(1) {
            for line in block.split("```").next().unwrap().lines() {
                assert!(source.contains(&line), "{}: {line}", page.display());
                compared += 1;
            }
        }
    }
    assert!(compared > 20, "{compared} lines");
}

/// First lines of CSV files in the page of tables are those that the code writes.
#[test]
fn columns_of_tables_are_those_of_the_code() {
    let page = read_to_string(root().join("docs/reference/tables.md")).unwrap();
    for (file, first) in [
        (
            "src/cli/press.rs",
            "time_s,phase,depth_m,force_n,force_error_n",
        ),
        ("src/cli/press_map.rs", "x,y,z,stiffness,error"),
        ("src/cli/press_map.rs", "x,y,z,stiffness"),
        (
            "src/scene/reactions.rs",
            "time_s,name,fx,fy,fz,mx,my,mz,force_error_n",
        ),
        (
            "src/cli/identify/files.rs",
            "experiment,quantity,x,y,z,depth_m,measured,predicted,residual",
        ),
        ("src/scene/trajectory.rs", "time_s,x,y,z"),
    ] {
        let source = read_to_string(root().join(file)).unwrap();
        let ends = [format!("\"{first}\""), format!("\"{first}\\n\"")];
        assert!(
            ends.iter().any(|end| source.contains(end)),
            "{file}: {first}"
        );
        assert!(page.contains(&format!("`{first}`")), "tables.md: {first}");
        for column in first.split(',') {
            assert!(page.contains(&format!("`{column}`")), "tables.md: {column}");
        }
    }
    // Columns that the code lists one by one.
    for (file, start) in [("src/bench/report.rs", "const COLUMNS: [&str;")] {
        let source = read_to_string(root().join(file)).unwrap();
        let block = source
            .split(start)
            .nth(1)
            .unwrap_or_else(|| panic!("{file}: {start}"));
        let end = block.find("\n];").unwrap();
        let names = block[..end]
            .lines()
            .filter_map(|line| line.split('"').nth(1));
        let names: Vec<&str> = names.collect();
        assert!(names.len() > 3, "{file}");
        for name in names {
            assert!(
                page.contains(&format!("`{name}`")),
                "tables.md: {name} of {file}"
            );
        }
    }
}

/// Quoted messages in the page of troubleshooting are those of the code; `…` stands for anything.
#[test]
fn troubleshooting_quotes_messages_of_the_code() {
    let mut code = String::new();
    for file in files(&root().join("src"), ".rs") {
        code += &read_to_string(&file).unwrap();
    }
    // Long messages go on in the next line.
    let lines: Vec<&str> = code.split("\\\n").map(str::trim_start).collect();
    let code = lines.concat().replace("\\\"", "\"");
    let page = read_to_string(root().join("docs/how-to/troubleshooting.md")).unwrap();
    let mut compared = 0;
    for line in page.lines().filter(|line| line.starts_with("**")) {
        let message = line.split("**").nth(1).unwrap();
        for quoted in message.split('"').skip(1).step_by(2) {
            for part in quoted.split('…').map(str::trim) {
                assert!(code.contains(part), "no message of the code has: {part}");
                compared += 1;
            }
        }
    }
    assert!(compared > 20, "{compared} quotes");
}

/// Blocks of TOML are scenes, or parts of one.
#[test]
fn scenes_in_pages_parse() {
    let mut parsed = 0;
    for page in files(&root().join("docs"), ".md") {
        let text = read_to_string(&page).unwrap();
        for block in text.split("\n```toml\n").skip(1) {
            let block = block.split("\n```").next().unwrap();
            // Manifests, and recordings of `palpate identify`.
            let others = ["[dependencies]", "takes = ", "[displacements]"];
            if others.iter().any(|other| block.contains(other)) {
                continue;
            }
            if let Err(error) = palpate::scene::Scene::parse(block) {
                panic!("{}: {error}\n{block}", page.display());
            }
            parsed += 1;
        }
    }
    assert!(parsed > 30, "{parsed} blocks");
    assert!(palpate::scene::Scene::parse("[[pin]]\ninside = 1\n").is_err());
}
