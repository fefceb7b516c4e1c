//! `palpate completions` and `palpate man`.

use super::command_line::command;
use super::*;

/// Returns all subcommands, except the one added by clap.
fn subcommands() -> Vec<String> {
    let whole = command();
    let names = whole.get_subcommands().map(|of| of.get_name().to_owned());
    names.collect()
}

#[test]
fn completions_contain_every_subcommand() {
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = stdout(&palpate(&["completions", shell]));
        for name in subcommands() {
            assert!(script.contains(&name), "{shell}: {name}");
        }
        assert!(script.contains("report"), "{shell} knows no flags");
    }
    let unknown = palpate(&["completions", "no_such_shell"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("powershell"));
}

#[test]
fn man_writes_page_per_subcommand() {
    let folder = folder("man").join("new/man1");
    let output = palpate(&["man", text(&folder), "--quiet"]);
    assert_eq!(
        (stdout(&output), output.stderr),
        (String::new(), Vec::new())
    );
    let mut names = vec!["palpate".to_owned()];
    names.extend(subcommands().iter().map(|name| format!("palpate-{name}")));
    for name in &names {
        let page = std::fs::read_to_string(folder.join(format!("{name}.1"))).unwrap();
        // In roff a hyphen is written \-.
        let words = format!(".SH NAME\n{}", name.replace('-', "\\-"));
        let named = page.contains(&words) || page.contains(&format!(".SH NAME\n{name}"));
        assert!(named, "{page}");
        assert!(
            page.contains("\\-\\-quiet"),
            "{name} has no flag of all commands"
        );
    }
    let pages = std::fs::read_dir(&folder).unwrap().count();
    assert_eq!(pages, names.len());
}

#[test]
fn man_rejects_invalid_folder() {
    let file = folder("man_wrong").join("file");
    std::fs::write(&file, "").unwrap();
    let errors = failure(&palpate(&["man", text(&file)]));
    let start = format!("palpate: {}: not a folder", text(&file));
    assert!(errors.starts_with(&start), "{errors}");
    let errors = failure(&palpate(&["man", text(&file.join("in_it"))]));
    assert!(
        errors.contains("in_it: cannot create the folder for the pages"),
        "{errors}"
    );
}
