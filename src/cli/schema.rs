//! `palpate schema`: the JSON Schema of scene files, and the pages of the reference.

use super::reference_pages;
use super::{Outcome, command, print_json, print_notes};
use clap::Args;
use palpate::scene::Scene;
use palpate::{Error, io};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `schema`.
#[derive(Args)]
pub struct SchemaArguments {
    /// Write the reference of the book to this folder: the schema, and a page for each table of a
    /// scene and for each command
    #[arg(long, hide = true, value_name = "DIR")]
    pages: Option<PathBuf>,
}

/// Prints the schema, or writes the pages of the reference.
pub fn run(arguments: &SchemaArguments) -> anyhow::Result<Outcome> {
    let Some(folder) = &arguments.pages else {
        print_json(&Scene::schema())?;
        return Ok(Outcome::Done);
    };
    let files = files()?;
    for (name, text) in &files {
        write(&folder.join(name), text)?;
    }
    print_notes(&[format!(
        "wrote {} files to {}",
        files.len(),
        folder.display()
    )]);
    Ok(Outcome::Done)
}

/// Returns the files of the reference: names and texts.
pub fn files() -> anyhow::Result<Vec<(String, String)>> {
    let schema = Scene::schema();
    let text = serde_json::to_string_pretty(&schema)? + "\n";
    let mut files = vec![("scene.schema.json".to_owned(), text)];
    files.extend(reference_pages::of_scenes(&schema));
    files.extend(reference_pages::of_commands(&command()));
    files.push(reference_pages::of_bodies());
    Ok(files)
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|e| {
            anyhow::anyhow!(
                "{}: cannot create the folder ({e}); give a writable location",
                folder.display()
            )
        })?;
    }
    io::atomic_write(path, |file| {
        file.write_all(text.as_bytes()).map_err(Error::io(path))
    })?;
    Ok(())
}
