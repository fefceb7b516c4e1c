//! Scene files with some entries changed, written elsewhere.

use super::{MeshSource, Scene, Unit};
use crate::io::atomic_write;
use crate::{Error, Result};
use std::io::Write;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// The text of a scene file, with the paths of files that it refers to as seen from another folder.
pub(crate) struct ScenePatch {
    entries: Table,
}

impl ScenePatch {
    /// Reads the scene file `from`, to be written as `to`.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::Format`]; the folder of `to` must exist.
    pub fn read(from: &Path, to: &Path) -> Result<ScenePatch> {
        let text = std::fs::read_to_string(from).map_err(Error::io(from))?;
        let mut entries: Table = text
            .parse()
            .map_err(|e: toml::de::Error| Error::format(from, e.to_string()))?;
        let (old, new) = (folder(from)?, folder(to)?);
        if old != new {
            make_paths_absolute(&mut entries, &old);
        }
        Ok(ScenePatch { entries })
    }

    /// Removes a table.
    pub fn remove(&mut self, table: &str) {
        self.entries.remove(table);
    }

    /// Removes a key of a table, which is created if it does not exist.
    pub fn remove_key(&mut self, table: &str, key: &str) {
        let entry = self.entries.entry(table.to_owned());
        if let Value::Table(table) = entry.or_insert_with(|| Value::Table(Table::new())) {
            table.remove(key);
        }
    }

    /// Sets the entry at `path`, the names of tables and a key. A tissue that is a list of regions becomes
    /// a table with them.
    ///
    /// # Errors
    /// [`Error::Input`] if a table on the way is something else.
    pub fn set(&mut self, path: &[&str], value: impl Into<Value>) -> Result<()> {
        let Some((key, tables)) = path.split_last() else {
            return Ok(());
        };
        let mut here = &mut self.entries;
        for name in tables {
            let entry = here.entry((*name).to_owned());
            let entry = entry.or_insert_with(|| Value::Table(Table::new()));
            if let Value::Array(regions) = entry {
                let regions = Value::Array(std::mem::take(regions));
                *entry = Value::Table(Table::from_iter([("regions".to_owned(), regions)]));
            }
            let Value::Table(table) = entry else {
                return Err(Error::Input(format!("[{name}] of the scene is no table")));
            };
            here = table;
        }
        here.insert((*key).to_owned(), value.into());
        Ok(())
    }

    /// Sets the key of a table in the list of tables of this name.
    ///
    /// # Errors
    /// [`Error::Input`] if the scene has no such table.
    #[cfg(feature = "identify")]
    pub fn set_in_list(
        &mut self,
        (list, number): (&str, usize),
        key: &str,
        value: impl Into<Value>,
    ) -> Result<()> {
        let tables = self.entries.get_mut(list).and_then(Value::as_array_mut);
        let table = tables.and_then(|tables| tables.get_mut(number)?.as_table_mut());
        let table = table
            .ok_or_else(|| Error::Input(format!("the scene has no [[{list}]] {}", number + 1)))?;
        table.insert(key.to_owned(), value.into());
        Ok(())
    }

    /// Replaces the mesh by that in `file`, which is in the folder of the written scene, in the unit of
    /// `scene`.
    ///
    /// # Errors
    /// As [`ScenePatch::set`].
    pub fn use_mesh_beside(&mut self, file: &Path, scene: &Scene) -> Result<()> {
        self.remove("mesh");
        let name = file
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        self.set(&["mesh", "file"], name.unwrap_or_default())?;
        match &scene.mesh.unit {
            None => Ok(()),
            Some(Unit::Metres(metres)) => self.set(&["mesh", "unit"], *metres),
            Some(Unit::Name(name)) => self.set(&["mesh", "unit"], name.as_str()),
        }
    }

    /// Writes the scene with `notes` as comments at its head.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(self, to: &Path, notes: &[String]) -> Result<()> {
        let text = toml::to_string(&self.entries).map_err(|e| Error::format(to, e.to_string()))?;
        atomic_write(to, |file| {
            let notes: String = notes.iter().map(|note| format!("# {note}\n")).collect();
            write!(file, "{notes}\n{text}").map_err(Error::io(to))
        })
    }
}

impl Scene {
    /// Returns the scene with the mesh in `file`, in the same unit.
    pub(crate) fn with_mesh_file(&self, file: &Path) -> Scene {
        let mut scene = self.clone();
        scene.mesh = MeshSource {
            file: Some(file.to_owned()),
            unit: self.mesh.unit.clone(),
            ..MeshSource::default()
        };
        scene
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
fn make_paths_absolute(scene: &mut Table, folder: &Path) {
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
