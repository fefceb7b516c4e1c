//! Checks the command lines in the documentation against the program, its targets and its scripts.

use super::command_line::command;
use clap::error::ErrorKind;
use std::collections::BTreeSet;
use std::fs::read_to_string;
use std::path::{Path, PathBuf};

/// A line of a document that may be executed.
struct Line {
    /// Its line number, from 1.
    number: usize,
    text: String,
    /// Whether it is inline code, where a command may be named without its required arguments.
    inline: bool,
}

/// Returns the lines of code blocks, fenced and indented, with continued ones joined, and inline
/// code.
fn lines_of_code(markdown: &str) -> Vec<Line> {
    let mut found = Vec::new();
    let mut fenced = false;
    let mut lines = (1..).zip(markdown.lines());
    while let Some((number, line)) = lines.next() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        } else if fenced || line.starts_with("    ") || line.starts_with('\t') {
            let mut text = line.trim().to_owned();
            while let Some(start) = text.strip_suffix('\\') {
                let next = lines.next().map_or("", |(_, next)| next.trim());
                text = format!("{start} {next}");
            }
            let prompt = text.strip_prefix("$ ").map(str::to_owned);
            found.push(Line {
                number,
                text: prompt.unwrap_or(text),
                inline: false,
            });
        } else {
            let code = line.split('`').skip(1).step_by(2);
            found.extend(code.map(|code| Line {
                number,
                text: code.to_owned(),
                inline: true,
            }));
        }
    }
    found
}

/// Splits a line into commands as a shell does: words, without comments and redirections.
fn commands(line: &str) -> Vec<Vec<String>> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    for c in line.chars() {
        match quote {
            Some(q) if c == q => quote = None,
            Some(_) => word.get_or_insert_default().push(c),
            None if c == '"' || c == '\'' => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            None if c.is_whitespace() => words.extend(word.take()),
            None if c == '#' && word.is_none() => break,
            None => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    let mut commands = vec![Vec::new()];
    let mut words = words.into_iter();
    while let Some(word) = words.next() {
        match word.as_str() {
            "|" | "&&" | "||" | ";" | "&" => commands.push(Vec::new()),
            ">" | ">>" | "2>" | "<" => drop(words.next()),
            // An ellipsis of the author.
            "…" | "..." => {}
            _ => commands.last_mut().unwrap().push(word),
        }
    }
    commands
}

/// Returns a value for a placeholder.
fn filled_in(word: &str) -> String {
    match word {
        "COMMAND" => "info",
        "SHELL" => "bash",
        "N" => "2",
        "NxM" => "2x2",
        "X,Y" => "1,1",
        "X,Y,Z" => "1,1,1",
        "DEGREES" => "45",
        word => word,
    }
    .to_owned()
}

/// Returns the error in the arguments of `palpate`, if there is one.
fn wrong_arguments(words: &[String], inline: bool) -> Option<String> {
    let ends_in_a_flag = words.last().is_some_and(|word| word.starts_with("--"));
    let words = words.iter().map(|word| filled_in(word));
    let words = std::iter::once("palpate".to_owned()).chain(words);
    let error = command().try_get_matches_from(words).err()?;
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => None,
        ErrorKind::MissingRequiredArgument
        | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
            if inline =>
        {
            None
        }
        // A flag that is named without its value.
        ErrorKind::InvalidValue if inline && ends_in_a_flag => None,
        _ => Some(error.to_string()),
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Collects all files under a folder with that ending.
fn files(folder: &Path, ending: &str, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy();
        if path.is_dir() && name != "target" && name != "node_modules" {
            files(&path, ending, found);
        } else if name.ends_with(ending) {
            found.push(path);
        }
    }
}

/// Returns the paths of all functions under a folder of sources, as `cargo test` writes them.
fn functions(folder: &Path) -> Vec<String> {
    let mut sources = Vec::new();
    files(folder, ".rs", &mut sources);
    let mut paths = Vec::new();
    for source in sources {
        let module = source.strip_prefix(folder).unwrap().with_extension("");
        let parts = module.iter().map(|part| part.to_string_lossy());
        let module: Vec<_> = parts.filter(|part| part != "mod").collect();
        let text = read_to_string(&source).unwrap();
        for line in text.lines() {
            if let Some(rest) = line.trim_start().strip_prefix("fn ") {
                let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_');
                let name = &rest[..end.unwrap_or(rest.len())];
                paths.push(format!("{}::{name}", module.join("::")));
            }
        }
    }
    paths
}

/// Whether `folder` has a target of that kind, from a file or from a folder with a main file.
fn has_target(member: &str, kind: &str, name: &str) -> bool {
    let folder = root().join(member).join(kind);
    folder.join(format!("{name}.rs")).is_file() || folder.join(name).join("main.rs").is_file()
}

fn manifest(folder: &str) -> toml::Table {
    let path = root().join(folder).join("Cargo.toml");
    read_to_string(path).unwrap().parse().unwrap()
}

/// Returns the names of the workspace members, with their folders.
fn members() -> Vec<(String, String)> {
    let whole = manifest("");
    let members = whole["workspace"]["members"].as_array().unwrap().iter();
    let folders = members.map(|member| member.as_str().unwrap());
    std::iter::once("")
        .chain(folders)
        .map(|folder| {
            let own = manifest(folder);
            (
                own["package"]["name"].as_str().unwrap().into(),
                folder.into(),
            )
        })
        .collect()
}

/// Returns the error in the arguments of `cargo`, if there is one.
fn wrong_cargo(words: &[String], inline: bool) -> Option<String> {
    let (own, others) = match words.iter().position(|word| word == "--") {
        Some(at) => (&words[..at], &words[at + 1..]),
        None => (words, &[][..]),
    };
    let (subcommand, own) = own.split_first()?;
    let mut folder = String::new();
    let mut named = false;
    // The folder of the functions that the words select.
    let mut places = vec!["src", "tests/suite", "tests"];
    let mut filters = Vec::new();
    let mut own = own.iter();
    while let Some(word) = own.next() {
        let mut value = || own.next().map_or("", String::as_str);
        let exists = match word.as_str() {
            "-p" => {
                let name = value();
                let member = members().into_iter().find(|(member, _)| member == name);
                named = true;
                folder = member.as_ref().map_or(String::new(), |(_, at)| at.clone());
                member.is_some()
            }
            "--test" => {
                let name = value();
                named = true;
                places.retain(|place| place.strip_prefix("tests/") == Some(name));
                has_target(&folder, "tests", name)
            }
            "--example" => {
                named = true;
                has_target(&folder, "examples", value())
            }
            "--bench" => {
                let name = value();
                let whole = manifest(&folder);
                let benches = whole.get("bench").and_then(|b| b.as_array());
                let mut benches = benches.into_iter().flatten();
                benches.any(|bench| bench["name"].as_str() == Some(name))
            }
            "--features" => {
                let whole = manifest(&folder);
                let known = whole["features"].as_table().unwrap();
                value().split(',').all(|name| known.contains_key(name))
            }
            "--path" => root().join(value()).join("Cargo.toml").is_file(),
            "--lib" => {
                places.truncate(1);
                true
            }
            flag if flag.starts_with('-') => true,
            filter => {
                filters.push(filter);
                true
            }
        };
        if !exists {
            return Some(format!("there is nothing that {word} could mean there"));
        }
    }
    match subcommand.as_str() {
        "test" => {
            filters.extend(
                others
                    .iter()
                    .map(String::as_str)
                    .filter(|o| !o.starts_with('-')),
            );
            let at = root().join(&folder);
            let known = places.iter().flat_map(|place| functions(&at.join(place)));
            let known: Vec<String> = known.collect();
            let missing = filters
                .iter()
                .find(|filter| !known.iter().any(|path| path.contains(**filter)));
            missing.map(|filter| format!("no test's path has \"{filter}\""))
        }
        "run" if !named => wrong_arguments(others, inline),
        _ => None,
    }
}

/// Returns the error in a script or its arguments, if there is one.
fn wrong_script(name: &str, words: &[String]) -> Option<String> {
    let path = root().join("scripts").join(name);
    let Ok(text) = read_to_string(path) else {
        return Some(format!("there is no script {name}"));
    };
    let argument = words.first()?;
    let case = |line: &str| line.trim() == format!("{argument})");
    let known = name != "test" || text.lines().any(case);
    (!known).then(|| format!("scripts/{name} knows no {argument}"))
}

/// Returns the error in a line, if there is one.
fn wrong(line: &Line) -> Option<String> {
    commands(&line.text).iter().find_map(|words| {
        // Variables and interpreters precede the command.
        let before = |word: &&String| {
            let variable = word
                .split_once('=')
                .is_some_and(|(name, _)| name.chars().all(|c| c.is_ascii_uppercase() || c == '_'));
            variable || ["python3", "bash", "sudo", "env"].contains(&word.as_str())
        };
        let words = &words[words.iter().take_while(before).count()..];
        let (program, arguments) = words.split_first()?;
        match program.as_str() {
            // A dependency in a manifest.
            "palpate" if arguments.first().is_some_and(|word| word == "=") => None,
            "palpate" => wrong_arguments(arguments, line.inline),
            "cargo" => wrong_cargo(arguments, line.inline),
            program => wrong_script(program.strip_prefix("scripts/")?, arguments),
        }
    })
}

/// Returns the documents for users and developers.
fn documents() -> Vec<PathBuf> {
    let mut found = vec![root().join("README.md"), root().join("ARCHITECTURE.md")];
    for folder in ["docs", "python", "viewer", "benches"] {
        files(&root().join(folder), ".md", &mut found);
    }
    found
}

#[test]
fn documented_commands_parse() {
    let mut wrongs = Vec::new();
    let mut programs: BTreeSet<String> = BTreeSet::new();
    let mut checked = 0;
    for document in documents() {
        for line in lines_of_code(&read_to_string(&document).unwrap()) {
            for words in commands(&line.text) {
                checked += usize::from(words.first().is_some_and(|word| word == "palpate"));
                programs.extend(words.into_iter().next());
            }
            if let Some(why) = wrong(&line) {
                let document = document.strip_prefix(root()).unwrap().display();
                wrongs.push(format!("{document}:{}: {}\n{why}", line.number, line.text));
            }
        }
    }
    assert!(wrongs.is_empty(), "{}", wrongs.join("\n"));
    // Documents were found.
    assert!(checked > 100, "{checked} command lines of palpate");
    for program in ["cargo", "scripts/test", "scripts/demo"] {
        assert!(programs.contains(program), "{programs:?}");
    }
}

#[test]
fn invalid_documented_commands_are_detected() {
    for (markdown, wrongs) in [
        ("    palpate render a.vtu --out a.png", 0),
        ("    palpate render a.vtu --oout a.png", 1),
        ("    palpate render a.vtu   # without --out", 1),
        (
            "```\n$ palpate render a.vtu \\\n    --out a.png --size 8x\n```",
            1,
        ),
        (
            "    python3 a.py | palpate render - --frames-from - --out a.png > log",
            0,
        ),
        ("    python3 a.py | palpate rendre - --out a.png", 1),
        (
            "    PALPATE_ADAPTER=cpu palpate press a.toml --map NxM --out map",
            0,
        ),
        (
            "    palpate render a.vtu --title \"of # two\" --out a.png",
            0,
        ),
        ("say `palpate mesh`, or `palpate mush`", 1),
        (
            "say `palpate simulate … --film out.gif`, not `palpate simulate --flim out.gif`",
            1,
        ),
        (
            "`palpate COMMAND --help`, `palpate press --map`, `palpate press --mop`",
            1,
        ),
        ("`palpate = { version = \"0.1\" }`", 0),
        ("    cargo run --release -- demo --out here", 0),
        ("    cargo run --release -- dmeo", 1),
        (
            "`cargo test --test suite cli::docs -- --ignored`, `cargo test --test docs`",
            1,
        ),
        ("`cargo test --test suite cli::no_such_test`", 1),
        ("`cargo test --test suite -- --nocapture no_such_test`", 1),
        (
            "`cargo bench --bench steps`, `cargo bench --bench stpes`",
            1,
        ),
        (
            "`cargo run --example quickstart`, `cargo run --example slowstart`",
            1,
        ),
        (
            "`cargo test -p palpate-view --lib`, `cargo test -p palpate-veiw`",
            1,
        ),
        ("`scripts/test web`, `scripts/test wbe`, `scripts/tset`", 2),
    ] {
        let lines = lines_of_code(markdown);
        let found: Vec<String> = lines.iter().filter_map(wrong).collect();
        assert_eq!(found.len(), wrongs, "{markdown}: {found:?}");
    }
}
