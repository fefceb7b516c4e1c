//! Writes a scene file with tuned settings.

use super::Tuned;
use crate::Result;
use crate::scene::ScenePatch;
use std::path::Path;
use toml::Value;

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
    let mut patch = ScenePatch::read(from, to)?;
    for Change { table, key, value } in changes(tuned) {
        match (key, value) {
            (None, _) => patch.remove(table),
            (Some(key), None) => patch.remove_key(table, key),
            (Some(key), Some(value)) => patch.set(&[table, key], value)?,
        }
    }
    if tuned.has_refined_mesh
        && let Some(file) = &tuned.scene.mesh.file
    {
        patch.remove("accuracy");
        patch.use_mesh_beside(file, &tuned.scene)?;
    }
    patch.write(to, &tuned.notes)
}
