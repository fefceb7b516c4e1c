//! Pages of the commands, from clap.

use super::GENERATED;
use clap::{Arg, Command};

/// Returns a page for each command, and one that lists them.
pub fn of_commands(program: &Command) -> Vec<(String, String)> {
    let mut program = program.clone();
    // Now each command has the global flags, too.
    program.build();
    let own: Vec<&Command> = (program.get_subcommands())
        .filter(|command| command.get_name() != "help")
        .collect();
    let mut index = format!(
        "# Command line\n\n{GENERATED}\nEvery command and flag; `palpate COMMAND --help` prints the same. \
         [Commands at a glance](../commands.md) has examples, and [use from scripts](../scripts.md) \
         exit codes and JSON.\n\n| command | does |\n| --- | --- |\n"
    );
    for command in &own {
        let name = command.get_name();
        index += &format!("| [`palpate {name}`]({name}.md) | {} |\n", about(command));
    }
    index += "\n## Flags of every command\n\n";
    for arg in arguments(&program, |arg| arg.is_global_set()) {
        index += &described(arg);
    }
    let mut pages = vec![("cli/index.md".to_owned(), index)];
    for command in own {
        let path = format!("cli/{}.md", command.get_name());
        pages.push((path, page(command)));
    }
    pages
}

fn about(command: &Command) -> String {
    command
        .get_about()
        .map(ToString::to_string)
        .unwrap_or_default()
}

fn arguments(command: &Command, wanted: impl Fn(&Arg) -> bool) -> Vec<&Arg> {
    let ours = |arg: &&Arg| {
        let own = !["help", "version"].contains(&arg.get_id().as_str());
        own && !arg.is_hide_set() && wanted(arg)
    };
    command.get_arguments().filter(ours).collect()
}

fn page(command: &Command) -> String {
    let name = command.get_name();
    let usage = command.clone().render_usage().to_string();
    let mut page = format!(
        "# palpate {name}\n\n{GENERATED}\n{}.\n\n```text\n{usage}\n```\n",
        about(command).trim_end_matches('.')
    );
    let positional = arguments(command, |arg| arg.is_positional());
    let flags = arguments(command, |arg| !arg.is_positional() && !arg.is_global_set());
    for (heading, arguments) in [("Arguments", positional), ("Flags", flags)] {
        if arguments.is_empty() {
            continue;
        }
        page += &format!("\n## {heading}\n\n");
        for arg in arguments {
            page += &described(arg);
        }
    }
    page + "\n`--adapter` and `--quiet` work with [every command](index.md#flags-of-every-command).\n"
}

/// A list item: the argument, its help, and what it may be.
fn described(arg: &Arg) -> String {
    let mut facts = Vec::new();
    let values: Vec<String> = arg
        .get_possible_values()
        .iter()
        .filter(|value| !value.is_hide_set() && arg.get_action().takes_values())
        .map(|value| format!("`{}`", value.get_name()))
        .collect();
    if !values.is_empty() {
        facts.push(format!("one of {}", values.join(", ")));
    }
    let defaults: Vec<_> = arg
        .get_default_values()
        .iter()
        .map(|v| v.to_string_lossy())
        .collect();
    if !defaults.is_empty() && arg.get_action().takes_values() {
        facts.push(format!("default `{}`", defaults.join(" ")));
    }
    if let Some(variable) = arg.get_env() {
        facts.push(format!(
            "environment variable `{}`",
            variable.to_string_lossy()
        ));
    }
    let facts = match facts.is_empty() {
        true => String::new(),
        false => format!(" ({})", facts.join("; ")),
    };
    let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    format!("- `{}`: {}{facts}\n", spelled(arg), plain(&help))
}

/// The argument as it is typed: `-q, --quiet`, `--size WxH`, `FILE`.
fn spelled(arg: &Arg) -> String {
    let names = arg.get_value_names().unwrap_or_default();
    let names: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
    let value = names.join(" ");
    if arg.is_positional() {
        return value;
    }
    let short = arg.get_short().map(|short| format!("-{short}"));
    let long = arg.get_long().map(|long| format!("--{long}"));
    let flag: Vec<String> = short.into_iter().chain(long).collect();
    let flag = flag.join(", ");
    match arg.get_action().takes_values() {
        true => format!("{flag} {value}"),
        false => flag,
    }
}

/// Help texts are for terminals: `<` and brackets would be markup here.
fn plain(help: &str) -> String {
    help.replace('<', "&lt;")
        .replace('[', "\\[")
        .replace('*', "\\*")
}
