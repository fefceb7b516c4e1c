//! The open document: the text of a scene, edited in place, with undo.

use crate::platform;
use palpate::render::{Camera, Projection};
use palpate::scene::Scene;
use palpate::{Error, Result};
use std::path::{Path, PathBuf};
use std::time::Duration;
use toml_edit::{ArrayOfTables, DocumentMut, Item, Table, Value};
use web_time::Instant;

/// Edits of one quantity within this time are undone together.
const UNDO_MERGE_WINDOW: Duration = Duration::from_millis(800);
/// Maximum number of undo steps.
const MAX_UNDO: usize = 200;

/// Tables that affect the appearance of the body only.
const APPEARANCE_TABLES: [&str; 9] = [
    "camera",
    "isosurface",
    "light",
    "output",
    "picture",
    "plane",
    "scan",
    "skin",
    "xray",
];

/// The text of a scene with its undo history.
#[derive(Clone)]
pub struct Document {
    /// Name shown in the window title.
    pub name: String,
    /// The file that was opened: a scene, a mesh, a volume or a surface.
    pub file: Option<PathBuf>,
    /// The recorded series (`.pvd`) that the document shows, if any.
    pub series: Option<PathBuf>,
    /// The bundled files that an example reads.
    pub bundled_files: &'static [(&'static str, &'static [u8])],
    /// Base folder of relative paths.
    folder: PathBuf,
    text: DocumentMut,
    undo: Vec<String>,
    redo: Vec<String>,
    last: Option<(String, Instant)>,
    /// Whether a mouse button is held; edits during a drag are undone together.
    held: bool,
}

impl Document {
    /// Opens a scene file, or creates a scene for a mesh, a volume, a surface or a recorded series.
    ///
    /// # Errors
    /// [`Error::Io`] if the file does not exist; [`Error::Format`] if a scene is invalid. Other
    /// files are validated when they are read.
    pub fn open(file: &Path) -> Result<Document> {
        let file = platform::absolute(file)?;
        let name = file.file_name().map(|n| n.to_string_lossy().into_owned());
        let name = name.unwrap_or_default();
        let folder = file.parent().map(Path::to_path_buf).unwrap_or_default();
        if file
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("toml"))
        {
            let text = palpate::io::read_text(&file)?;
            let document = Document::new(name, folder, &text);
            return document
                .map(|document| Document {
                    file: Some(file.clone()),
                    ..document
                })
                .map_err(|e| Error::format(&file, e.to_string()));
        }
        if !palpate::io::exists(&file) {
            return Err(Error::io(&file)(std::io::ErrorKind::NotFound.into()));
        }
        let is_series = file
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("pvd"));
        let shown = match is_series {
            false => name.clone(),
            true => {
                let frames = palpate::io::read_pvd(&file)?;
                let first = frames.first().map(|frame| frame.file().to_owned());
                let first =
                    first.ok_or_else(|| Error::format(&file, "the series has no frames"))?;
                let beside = first.strip_prefix(&folder).unwrap_or(&first);
                beside.to_string_lossy().into_owned()
            }
        };
        let mut document = Document::new(name, folder, "[mesh]\n")?;
        document.text["mesh"]["file"] = Item::Value(Value::from(shown));
        document.series = is_series.then(|| file.clone());
        document.file = Some(file);
        Ok(document)
    }

    /// Creates the document of this text, with paths relative to `folder`.
    ///
    /// # Errors
    /// [`Error::Input`] with the line that is invalid.
    pub fn new(name: String, folder: PathBuf, text: &str) -> Result<Document> {
        Scene::parse_in(text, &folder)?;
        Ok(Document {
            name,
            file: None,
            series: None,
            bundled_files: &[],
            folder,
            text: parsed(text)?,
            undo: Vec::new(),
            redo: Vec::new(),
            last: None,
            held: false,
        })
    }

    /// Returns the current scene.
    ///
    /// # Errors
    /// [`Error::Input`] if it is invalid.
    pub fn scene(&self) -> Result<Scene> {
        Scene::parse_in(&self.text.to_string(), &self.folder)
    }

    /// Returns the path of a file as written in the text.
    pub fn relative_path(&self, file: &Path) -> String {
        let beside = file.strip_prefix(&self.folder).unwrap_or(file);
        beside.to_string_lossy().into_owned()
    }

    /// Returns the text.
    pub fn text(&self) -> String {
        self.text.to_string()
    }

    /// Returns the text with paths relative to `folder`.
    pub fn text_in(&self, folder: &Path) -> String {
        moved(self.text.clone(), &self.folder, folder)
    }

    /// Edits the scene. Consecutive edits with the same name `what` are undone together. An invalid
    /// edit is discarded.
    ///
    /// # Errors
    /// [`Error::Input`] if the edit is invalid.
    pub fn edit(&mut self, what: &str, change: impl FnOnce(&mut DocumentMut)) -> Result<Scene> {
        let mut text = self.text.clone();
        change(&mut text);
        let scene = Scene::parse_in(&text.to_string(), &self.folder)?;
        let now = Instant::now();
        let continues = self.last.as_ref().is_some_and(|(last, at)| {
            last == what && (self.held || now.duration_since(*at) < UNDO_MERGE_WINDOW)
        });
        if !continues {
            self.undo.push(self.text.to_string());
            if self.undo.len() > MAX_UNDO {
                self.undo.remove(0);
            }
        }
        self.last = Some((what.to_owned(), now));
        self.redo.clear();
        self.text = text;
        Ok(scene)
    }

    /// Records whether a mouse button is held and whether it was just pressed: edits during one
    /// drag are undone together, separately from earlier ones.
    pub fn track_drag(&mut self, held: bool, pressed: bool) {
        self.held = held;
        if pressed {
            self.last = None;
        }
    }

    /// Sets an initial colour preset, without an undo entry.
    ///
    /// # Errors
    /// [`Error::Input`] for an unknown preset.
    #[cfg(target_arch = "wasm32")]
    pub fn set_initial_preset(&mut self, preset: &str) -> Result<()> {
        self.edit("transfer", |text| {
            set(text, "picture", "transfer", Some(Value::from(preset)));
        })?;
        self.undo.clear();
        Ok(())
    }

    /// Returns the text without the appearance tables.
    pub fn body(&self) -> String {
        let mut text = self.text.clone();
        APPEARANCE_TABLES.iter().for_each(|table| {
            text.remove(table);
        });
        text.to_string()
    }

    /// Returns the text of [`Document::text_in`] with the view of `camera` and pictures of `size`
    /// pixels. For a series, `frame` is the file of the displayed frame and its scalar range.
    pub fn text_with_view(
        &self,
        folder: &Path,
        camera: &Camera,
        size: [u32; 2],
        frame: Option<(&Path, Option<[f64; 2]>)>,
    ) -> String {
        let mut text = self.text.clone();
        if let Some((file, range)) = frame {
            let beside = Value::from(self.relative_path(file));
            set(&mut text, "mesh", "file", Some(beside));
            if let Some(range) = range {
                set(&mut text, "picture", "range", Some(numbers(range)));
            }
        }
        let [fov, height] = match camera.projection {
            Projection::Perspective { fov } => [Some(fov), None],
            Projection::Orthographic { height } => [None, Some(height)],
        };
        for (key, place) in [
            ("eye", camera.eye),
            ("look_at", camera.look_at),
            ("up", camera.up),
        ] {
            set(&mut text, "camera", key, Some(numbers(place.to_array())));
        }
        set(&mut text, "camera", "fov", fov.map(Value::from));
        set(&mut text, "camera", "orthographic", height.map(Value::from));
        let size = Value::Array(size.into_iter().map(i64::from).collect());
        set(&mut text, "picture", "size", Some(size));
        match self.bundled_files {
            [] => moved(text, &self.folder, folder),
            // Bundled files are saved in the folder of the scene, so their paths stay relative.
            _ => text.to_string(),
        }
    }

    /// Returns the number of edits that can be undone.
    pub fn edits(&self) -> usize {
        self.undo.len()
    }

    /// Whether undo, and redo, are possible.
    pub fn can_undo_redo(&self) -> [bool; 2] {
        [!self.undo.is_empty(), !self.redo.is_empty()]
    }

    /// Undoes the last edit, or with `again` redoes the last undo. Returns whether there was any.
    ///
    /// # Errors
    /// [`Error::Input`] if the restored text is invalid, which edits rule out.
    pub fn undo(&mut self, again: bool) -> Result<bool> {
        let (from, to) = match again {
            false => (&mut self.undo, &mut self.redo),
            true => (&mut self.redo, &mut self.undo),
        };
        let Some(text) = from.pop() else {
            return Ok(false);
        };
        to.push(self.text.to_string());
        self.text = parsed(&text)?;
        self.last = None;
        Ok(true)
    }
}

fn parsed(text: &str) -> Result<DocumentMut> {
    text.parse()
        .map_err(|e: toml_edit::TomlError| Error::Input(e.to_string()))
}

/// Returns the text with paths relative to `to` instead of `from`.
fn moved(mut text: DocumentMut, from: &Path, to: &Path) -> String {
    if from != to {
        absolute(text.as_item_mut(), from);
    }
    text.to_string()
}

/// Sets `table.key`; `None` removes it.
pub fn set(text: &mut DocumentMut, table: &str, key: &str, value: Option<Value>) {
    match value {
        Some(value) => {
            let entry = text.entry(table).or_insert(Item::Table(Table::new()));
            if let Some(entry) = entry.as_table_like_mut() {
                entry.insert(key, Item::Value(value));
            }
        }
        None => {
            let entry = text.get_mut(table).and_then(Item::as_table_like_mut);
            entry.map(|entry| entry.remove(key));
        }
    }
}

/// Replaces the tables `[[name]]`; an empty list removes them.
pub fn set_all(text: &mut DocumentMut, name: &str, tables: Vec<Table>) {
    if tables.is_empty() {
        text.remove(name);
        return;
    }
    let mut all = ArrayOfTables::new();
    tables.into_iter().for_each(|table| all.push(table));
    text.insert(name, Item::ArrayOfTables(all));
}

/// Returns the tables called `name`, `[name]` or several `[[name]]`.
pub fn tables(text: &DocumentMut, name: &str) -> Vec<Table> {
    match text.get(name) {
        Some(Item::Table(one)) => vec![one.clone()],
        Some(Item::ArrayOfTables(all)) => all.iter().cloned().collect(),
        Some(Item::Value(Value::InlineTable(one))) => vec![one.clone().into_table()],
        Some(Item::Value(Value::Array(all))) => {
            let own = all.iter().filter_map(Value::as_inline_table);
            own.map(|one| one.clone().into_table()).collect()
        }
        _ => Vec::new(),
    }
}

/// Returns an array of numbers.
pub fn numbers<const N: usize>(values: [f64; N]) -> Value {
    Value::Array(values.into_iter().collect())
}

/// Makes relative paths absolute: strings that are the path of an existing file in `folder`.
fn absolute(item: &mut Item, folder: &Path) {
    match item {
        Item::Value(value) => absolute_value(value, folder),
        Item::Table(table) => table
            .iter_mut()
            .for_each(|(_, item)| absolute(item, folder)),
        Item::ArrayOfTables(all) => all
            .iter_mut()
            .flat_map(|table| table.iter_mut().map(|(_, item)| item).collect::<Vec<_>>())
            .for_each(|item| absolute(item, folder)),
        Item::None => {}
    }
}

fn absolute_value(value: &mut Value, folder: &Path) {
    match value {
        Value::String(string) => {
            let file = folder.join(string.value());
            if Path::new(string.value()).extension().is_some() && file.is_file() {
                *value = Value::from(file.to_string_lossy().into_owned());
            }
        }
        Value::Array(all) => all.iter_mut().for_each(|v| absolute_value(v, folder)),
        Value::InlineTable(table) => {
            table
                .iter_mut()
                .for_each(|(_, v)| absolute_value(v, folder));
        }
        _ => {}
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const TEXT: &str = "# A bar.\n[mesh]\ngenerate = \"bar\"\ntets = 500\n";

    fn document() -> Document {
        Document::new("bar".into(), PathBuf::new(), TEXT).unwrap()
    }

    #[test]
    fn edits_undo_and_redo_and_preserve_comments() {
        let mut document = document();
        let colour = |v: &str| Some(Value::from(v));
        document
            .edit("transfer", |t| {
                set(t, "picture", "transfer", colour("bone"))
            })
            .unwrap();
        // The edits have the same name and are merged, however long the first one takes.
        let later = Instant::now() + Duration::from_secs(3600);
        document.last = document.last.map(|(what, _)| (what, later));
        document
            .edit("transfer", |t| {
                set(t, "picture", "transfer", colour("tissue"))
            })
            .unwrap();
        document
            .edit("mode", |t| set(t, "picture", "mode", colour("mip")))
            .unwrap();
        assert!(document.text_in(Path::new("")).starts_with("# A bar.\n"));
        assert_eq!(
            document.scene().unwrap().picture.mode.as_deref(),
            Some("mip")
        );
        assert!(document.undo(false).unwrap());
        assert_eq!(document.scene().unwrap().picture.mode, None);
        // Both edits are merged and undone at once.
        assert!(document.undo(false).unwrap());
        assert_eq!(document.text_in(Path::new("")), TEXT);
        assert!(!document.undo(false).unwrap());
        assert!(document.undo(true).unwrap() && document.undo(true).unwrap());
        assert_eq!(
            document.scene().unwrap().picture.mode.as_deref(),
            Some("mip")
        );
        assert_eq!(document.can_undo_redo(), [true, false]);
    }

    #[test]
    fn edits_of_one_drag_are_one_undo_step() {
        let mut document = document();
        let mut drag = |mode: &str| {
            let mode = Value::from(mode);
            document
                .edit("mode", |t| set(t, "picture", "mode", Some(mode)))
                .unwrap();
            document.track_drag(true, false);
            document.edits()
        };
        assert_eq!([drag("mip"), drag("mean"), drag("minip")], [1, 1, 1]);
        // The pause between edits of one drag does not matter.
        document.last = document
            .last
            .map(|(what, at)| (what, at - 4 * UNDO_MERGE_WINDOW));
        document
            .edit("mode", |t| set(t, "picture", "mode", None))
            .unwrap();
        assert_eq!(document.edits(), 1);
        document.track_drag(true, true);
        let mode = Some(Value::from("mip"));
        document
            .edit("mode", |t| set(t, "picture", "mode", mode))
            .unwrap();
        assert_eq!(document.edits(), 2, "a new drag must add an undo step");
    }

    #[test]
    fn invalid_edit_is_rejected_and_leaves_text_unchanged() {
        let mut document = document();
        let wrong = document.edit("mode", |t| {
            set(t, "picture", "mode", Some(Value::from("sideways")));
        });
        assert!(wrong.is_err());
        assert_eq!(document.text_in(Path::new("")), TEXT);
        assert_eq!(document.can_undo_redo(), [false, false]);
    }

    #[test]
    fn text_for_other_folder_preserves_file_references() {
        let dir = tempfile::tempdir().unwrap();
        let (here, there) = (dir.path().join("a"), dir.path().join("b"));
        std::fs::create_dir_all(&here).unwrap();
        std::fs::write(here.join("limb.vtu"), "").unwrap();
        let text = "[mesh]\nfile = \"limb.vtu\"\n[picture]\ntransfer = \"bone\"\n";
        let document = Document::new("x".into(), here.clone(), text).unwrap();
        assert_eq!(document.text_in(&here), text);
        let moved = document.text_in(&there);
        let scene = Scene::parse_in(&moved, &there).unwrap();
        assert_eq!(scene.mesh.file, Some(here.join("limb.vtu")));
        assert_eq!(scene.picture.transfer.as_deref(), Some("bone"));
    }
}
