//! Writes a scene file with tuned settings.

use super::Tuned;
use crate::io::atomic_write;
use crate::{Error, Result};
use std::io::Write;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// A change of an entry of a scene file.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Name of the table.
    pub table: &'static str,
    /// Key in the table; `None` removes the whole table.
    pub key: Option<&'static str>,
    /// New value; `None` removes the key.
    pub value: Option<EntryValue>,
}

/// A value of an entry.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs)]
pub enum EntryValue {
    Text(String),
    Number(f64),
    Count(i64),
    Counts(Vec<i64>),
}

impl From<EntryValue> for Value {
    fn from(setting: EntryValue) -> Value {
        match setting {
            EntryValue::Text(text) => text.into(),
            EntryValue::Number(number) => number.into(),
            EntryValue::Count(count) => count.into(),
            EntryValue::Counts(counts) => counts.into(),
        }
    }
}

/// Returns the changes chosen in `tuned`.
pub(super) fn changes(tuned: &Tuned) -> Vec<Change> {
    let chosen = &tuned.scene;
    let mut changes = Vec::new();
    let mut put = |table, key, value: Option<EntryValue>| {
        changes.push(Change { table, key, value });
    };
    if tuned.motion.is_some() {
        put("cage", None, None);
        if let Some(cage) = &chosen.cage {
            let nodes = cage.nodes.map(|n| EntryValue::Count(n as i64));
            put("cage", Some("nodes"), nodes);
            let kind = cage.kind.map(|k| EntryValue::Text(k.name().into()));
            put("cage", Some("kind"), kind);
        }
        if let Some(order) = tuned.motion.as_ref().and_then(|m| m.point.order) {
            let number = EntryValue::Count(order.number().into());
            put("material", Some("order"), Some(number));
        }
        let solver = &chosen.solver;
        let steps = solver.steps.map(|n| EntryValue::Count(n.into()));
        for (key, value) in [
            ("name", solver.name.clone().map(EntryValue::Text)),
            ("dt", solver.dt.map(EntryValue::Number)),
            ("steps", steps),
            ("tolerance", solver.tolerance.map(EntryValue::Number)),
            ("iterations", None),
        ] {
            put("solver", Some(key), value);
        }
    }
    let size = chosen.picture.size;
    let size = size.map(|size| EntryValue::Counts(size.map(i64::from).to_vec()));
    put("picture", Some("size"), size);
    let accuracy = chosen.picture.accuracy.map(EntryValue::Number);
    put("picture", Some("accuracy"), accuracy);
    put("picture", Some("quality"), None);
    changes
}

/// Writes `from` as `to` with the settings of `tuned`.
pub(super) fn write(tuned: &Tuned, from: &Path, to: &Path) -> Result<()> {
    let text = std::fs::read_to_string(from).map_err(Error::io(from))?;
    let mut scene: Table = text
        .parse()
        .map_err(|e: toml::de::Error| Error::format(from, e.to_string()))?;
    let (old, new) = (folder(from)?, folder(to)?);
    if old != new {
        find_from_afar(&mut scene, &old);
    }
    for Change { table, key, value } in changes(tuned) {
        let Some(key) = key else {
            scene.remove(table);
            continue;
        };
        let mut own = taken(&mut scene, table);
        match value {
            Some(value) => drop(own.insert(key.into(), value.into())),
            None => drop(own.remove(key)),
        }
        scene.insert(table.into(), Value::Table(own));
    }
    let text = toml::to_string(&scene).map_err(|e| Error::format(to, e.to_string()))?;
    atomic_write(to, |file| {
        let notes = tuned.notes.iter().map(|n| format!("# {n}\n"));
        let notes: String = notes.collect();
        write!(file, "{notes}\n{text}").map_err(Error::io(to))
    })
}

/// Removes a table from a scene and returns it; an empty one if it does not exist.
fn taken(scene: &mut Table, key: &str) -> Table {
    match scene.remove(key) {
        Some(Value::Table(table)) => table,
        _ => Table::new(),
    }
}

/// Returns the canonical path of the folder of a file; the folder must exist.
fn folder(file: &Path) -> Result<PathBuf> {
    let folder = match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    std::fs::canonicalize(folder).map_err(Error::io(folder))
}

/// Makes the file paths in a scene absolute, relative to `folder`.
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
