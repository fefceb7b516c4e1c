//! `palpate completions` and `palpate man`: shell completions and manual pages.

use super::{Outcome, command, print_notes};
use clap::Args;
use clap_complete::Shell;
use clap_mangen::Man;
use palpate::{Error, io};
use std::io::Write;
use std::path::PathBuf;

/// Source shown on the manual pages.
const SOURCE: &str = concat!("palpate ", env!("CARGO_PKG_VERSION"));

/// Arguments of `completions`.
#[derive(Args)]
pub struct CompletionsArguments {
    /// Shell of the completion script
    shell: Shell,
}

/// Prints the completions of a shell.
pub fn completions(arguments: &CompletionsArguments) -> anyhow::Result<Outcome> {
    // Into memory first: a closed pipe is not an error, but the generator would panic.
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut command(), "palpate", &mut script);
    std::io::stdout().lock().write_all(&script)?;
    Ok(Outcome::Done)
}

/// Arguments of `man`.
#[derive(Args)]
pub struct ManArguments {
    /// Folder of the pages: palpate.1, and one per subcommand
    folder: PathBuf,
}

/// Writes a page for the program and one for each subcommand.
pub fn man(arguments: &ManArguments) -> anyhow::Result<Outcome> {
    let folder = &arguments.folder;
    if folder.exists() && !folder.is_dir() {
        anyhow::bail!(
            "{}: not a folder; give a folder for the pages, such as man1",
            folder.display()
        );
    }
    std::fs::create_dir_all(folder).map_err(|e| {
        anyhow::anyhow!(
            "{}: cannot create the folder for the pages ({e}); give a writable location",
            folder.display()
        )
    })?;
    let mut whole = command();
    // Now each page has the global flags, too.
    whole.build();
    let own = whole.get_subcommands().filter(|of| of.get_name() != "help");
    let pages: Vec<&clap::Command> = std::iter::once(&whole).chain(own).collect();
    for of in &pages {
        let page = Man::new((*of).clone()).source(SOURCE);
        let path = folder.join(page.get_filename());
        io::atomic_write(&path, |file| page.render(file).map_err(Error::io(&path)))?;
    }
    print_notes(&[format!(
        "wrote {} pages to {}",
        pages.len(),
        folder.display()
    )]);
    Ok(Outcome::Done)
}
