//! The commands of the tutorials run as they stand.

use super::{folder, palpate};
use std::fs::{read_to_string, write};
use std::path::Path;
use std::process::Command;

/// What a page has a reader do.
#[derive(Debug, PartialEq)]
enum Task {
    /// Save this text as a file of that name.
    Save(String, String),
    /// Run `palpate` with these arguments; `true` if it ends with exit code 1.
    Run(Vec<String>, bool),
}

/// Returns the tasks of a page: TOML blocks after ``as `NAME` ``, and indented command lines.
fn tasks(markdown: &str) -> Vec<Task> {
    let mut tasks = Vec::new();
    let mut name = None;
    let mut block: Option<(bool, String)> = None;
    for line in markdown.lines() {
        if let Some(language) = line.strip_prefix("```") {
            match block.take() {
                Some((true, text)) => {
                    tasks.extend(name.take().map(|name| Task::Save(name, text)));
                }
                Some(_) => {}
                None => block = Some((language == "toml", String::new())),
            }
        } else if let Some((_, text)) = &mut block {
            *text += line;
            *text += "\n";
        } else if let Some(command) = line.strip_prefix("    palpate ") {
            let (command, comment) = command.split_once(" #").unwrap_or((command, ""));
            let words = command.split_whitespace().map(str::to_owned).collect();
            tasks.push(Task::Run(words, comment.contains("fails")));
        } else if let Some((_, rest)) = line.split_once("as `") {
            name = rest.split('`').next().map(str::to_owned);
        }
    }
    tasks
}

/// Small pictures, so that the software driver is no reason to leave a command out.
fn quickly(mut arguments: Vec<String>) -> Vec<String> {
    let draws = ["render", "simulate", "press"].contains(&arguments[0].as_str());
    if draws && !arguments.iter().any(|word| word == "--size") {
        arguments.extend(["--size", "48x36"].map(str::to_owned));
    }
    arguments
}

fn run_page(page: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = read_to_string(root.join("docs").join(page)).unwrap();
    let name = page.replace(['/', '.'], "_");
    let place = folder(&format!("book_{name}"));
    for shared in ["data", "docs"] {
        std::os::unix::fs::symlink(root.join(shared), place.join(shared)).unwrap();
    }
    let mut commands = 0;
    for task in tasks(&text) {
        match task {
            Task::Save(name, text) => write(place.join(name), text).unwrap(),
            Task::Run(arguments, fails) => {
                let arguments = quickly(arguments);
                let done = Command::new(env!("CARGO_BIN_EXE_palpate"))
                    .args(&arguments)
                    .current_dir(&place)
                    .output()
                    .unwrap();
                let errors = String::from_utf8_lossy(&done.stderr);
                let code = done.status.code();
                let expected = Some(i32::from(fails));
                assert_eq!(
                    code,
                    expected,
                    "{page}: palpate {}\n{errors}",
                    arguments.join(" ")
                );
                commands += 1;
            }
        }
    }
    assert!(commands > 0, "{page} has no command");
}

#[test]
fn press_your_segmentation_runs() {
    run_page("tutorials/press-your-segmentation.md");
}

#[test]
fn bend_a_ct_runs() {
    run_page("tutorials/bend-a-ct.md");
}

#[test]
fn picture_in_ci_runs() {
    run_page("tutorials/picture-in-ci.md");
}

#[test]
fn force_in_pandas_runs() {
    run_page("how-to/force-in-pandas.md");
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join("book_how-to_force-in-pandas_md");
    let forces = read_to_string(place.join("forces.csv")).unwrap();
    assert!(forces.starts_with("time_s,name,fx,fy,fz"), "{forces}");
    assert!(forces.contains(",finger,"), "{forces}");
}

#[test]
fn tasks_of_a_page_are_found() {
    let page = "Save this as `a.toml`:\n\n```toml\n[mesh]\n```\n\n    palpate info a.vtu\n    palpate compare a.png b.png   # fails\n\n```toml\nother = 1\n```\n";
    let words = |text: &str| text.split_whitespace().map(str::to_owned).collect();
    assert_eq!(
        tasks(page),
        [
            Task::Save("a.toml".into(), "[mesh]\n".into()),
            Task::Run(words("info a.vtu"), false),
            Task::Run(words("compare a.png b.png"), true),
        ]
    );
    // A command that does not exist is a failure.
    assert_eq!(palpate(&["no-such-command"]).status.code(), Some(2));
}
