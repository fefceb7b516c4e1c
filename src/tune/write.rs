//! A scene file written again with what was chosen.

use super::Tuned;
use crate::io::atomic_write;
use crate::{Error, Result};
use std::io::Write;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Writes `from` as `to` with what `tuned` has chosen.
pub(super) fn write(tuned: &Tuned, from: &Path, to: &Path) -> Result<()> {
    let text = std::fs::read_to_string(from).map_err(Error::io(from))?;
    let mut scene: Table = text
        .parse()
        .map_err(|e: toml::de::Error| Error::format(from, e.to_string()))?;
    let (old, new) = (folder(from)?, folder(to)?);
    if old != new {
        find_from_afar(&mut scene, &old);
    }
    let chosen = &tuned.scene;
    if tuned.motion.is_some() {
        match &chosen.cage {
            None => {
                scene.remove("cage");
            }
            Some(cage) => {
                let mut table = Table::new();
                put(&mut table, "nodes", cage.nodes.map(|n| n as i64));
                put(&mut table, "kind", cage.kind.map(|k| k.name()));
                scene.insert("cage".into(), Value::Table(table));
            }
        }
        let mut solver = taken(&mut scene, "solver");
        put(&mut solver, "name", chosen.solver.name.clone());
        put(&mut solver, "dt", chosen.solver.dt);
        put(&mut solver, "steps", chosen.solver.steps.map(i64::from));
        put(&mut solver, "tolerance", chosen.solver.tolerance);
        solver.remove("iterations");
        scene.insert("solver".into(), Value::Table(solver));
    }
    let mut picture = taken(&mut scene, "picture");
    let size = chosen.picture.size.map(|s| s.map(i64::from).to_vec());
    put(&mut picture, "size", size);
    put(&mut picture, "accuracy", chosen.picture.accuracy);
    picture.remove("quality");
    scene.insert("picture".into(), Value::Table(picture));
    let text = toml::to_string(&scene).map_err(|e| Error::format(to, e.to_string()))?;
    atomic_write(to, |file| {
        let notes = tuned.notes.iter().map(|n| format!("# {n}\n"));
        let notes: String = notes.collect();
        write!(file, "{notes}\n{text}").map_err(Error::io(to))
    })
}

fn put(table: &mut Table, key: &str, value: Option<impl Into<Value>>) {
    match value {
        Some(value) => {
            table.insert(key.into(), value.into());
        }
        None => {
            table.remove(key);
        }
    }
}

/// Takes a table out of a scene, an empty one where there is none.
fn taken(scene: &mut Table, key: &str) -> Table {
    match scene.remove(key) {
        Some(Value::Table(table)) => table,
        _ => Table::new(),
    }
}

/// The folder of a file, which exists, as the file system knows it.
fn folder(file: &Path) -> Result<PathBuf> {
    let folder = match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    std::fs::canonicalize(folder).map_err(Error::io(folder))
}

/// Makes the paths of files that a scene in `folder` names absolute.
fn find_from_afar(scene: &mut Table, folder: &Path) {
    let absolute = |value: &mut Value| {
        if let Value::String(file) = value {
            *file = folder.join(&*file).to_string_lossy().into_owned();
        }
    };
    if let Some(file) = scene.get_mut("mesh").and_then(|m| m.get_mut("file")) {
        absolute(file);
    }
    if let Some(transfer) = scene
        .get_mut("picture")
        .and_then(|p| p.get_mut("transfer"))
        .filter(|t| t.as_str().is_some_and(|t| t.ends_with(".json")))
    {
        absolute(transfer);
    }
    let skins = scene.get_mut("skin").and_then(Value::as_array_mut);
    for skin in skins.into_iter().flatten() {
        for key in ["file", "normal_map", "height_map"] {
            if let Some(file) = skin.get_mut(key) {
                absolute(file);
            }
        }
    }
}
