//! Panel of scans and skins: adding, visibility, appearance and removal.

use super::regions::eye;
use crate::app::App;
use crate::document::{numbers, set_all, tables};
use crate::loading::{BackgroundTask, ReadScan, read_scan};
use crate::path_prompt::PathPrompt;
use eframe::egui::{self, Color32};
use palpate::render::TransferFunction;
use palpate::scene::{LabelAppearanceEntry, ScanEntry, Scene, SkinEntry};
use palpate::skin::Mapping;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml_edit::{Item, Table, Value};

/// Purpose of a selected file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum ImportKind {
    /// Opened as a document.
    #[default]
    Open,
    /// Added as a scan embedded in the body.
    Scan,
    /// Transfer function of the scan of this index.
    Colours(usize),
    /// Added as a skin of the body.
    Skin,
}

impl ImportKind {
    /// Returns the title of the prompt.
    pub fn title(self) -> &'static str {
        match self {
            ImportKind::Open => "Open path",
            ImportKind::Scan => "Add a scan",
            ImportKind::Colours(_) => "Scan colours",
            ImportKind::Skin => "Add a skin",
        }
    }

    /// Returns the kinds of files to select.
    pub fn hint(self) -> &'static str {
        match self {
            ImportKind::Open => "Mesh, volume, surface, scene or series",
            ImportKind::Scan => "Volume: .nrrd, .nii.gz, .mha",
            ImportKind::Colours(_) => "Transfer function: .json",
            ImportKind::Skin => "Surface: .obj, .ply, .stl, .vtk",
        }
    }
}

/// An imported item.
enum ImportedItem {
    Scan(ReadScan),
    Skin(Box<SkinEntry>),
}

/// A scan or a skin that is being read.
pub(crate) struct PendingImport {
    file: PathBuf,
    work: BackgroundTask<ImportedItem>,
}

impl PendingImport {
    /// Returns the file name, and the current activity, its completed fraction and the elapsed
    /// time, s.
    pub fn progress(&self) -> (String, (String, f64, f64)) {
        let name = self.file.file_name().unwrap_or_default();
        (name.to_string_lossy().into_owned(), self.work.progress())
    }
}

/// A change of a table of the scene.
type Change = Box<dyn FnOnce(&mut Table)>;

impl App {
    /// Starts to import a file into the open scene.
    pub(crate) fn start_import(
        &mut self,
        purpose: ImportKind,
        file: &Path,
        context: &egui::Context,
    ) {
        let file = match crate::platform::absolute(file) {
            Ok(file) => file,
            Err(why) => return self.show_error(Err(why)),
        };
        let read = file.clone();
        let work = match purpose {
            ImportKind::Open => return self.open(&file, context),
            ImportKind::Colours(number) => {
                let text = self.beside(&file);
                return self.change(
                    ("scan", number),
                    "transfer",
                    Box::new(put("transfer", text)),
                );
            }
            ImportKind::Scan => BackgroundTask::spawn("reading", context, move |progress| {
                let entry = ScanEntry {
                    file: read,
                    ..ScanEntry::default()
                };
                read_scan(&entry, progress).map(ImportedItem::Scan)
            }),
            ImportKind::Skin => {
                let name = self.beside(&file);
                BackgroundTask::spawn("reading", context, move |progress| {
                    // Parsed like an entry of a scene, for its defaults.
                    let text = format!("[[skin]]\nfile = {}\n", Value::from(name.as_str()));
                    let mut skins = Scene::parse(&text)?.skin;
                    let mut skin = skins.swap_remove(0);
                    skin.file = read;
                    skin.surface.0 = Some(Arc::new(skin.read(progress)?));
                    Ok(ImportedItem::Skin(Box::new(skin)))
                })
            }
        };
        self.taking = Some(PendingImport { file, work });
    }

    /// Installs a scan or a skin that was read.
    pub(crate) fn finish_import(&mut self) {
        let Some(read) = self
            .taking
            .as_ref()
            .and_then(|taking| taking.work.try_take())
        else {
            return;
        };
        let Some(taking) = self.taking.take() else {
            return;
        };
        let name = self.beside(&taking.file);
        let (what, read) = match read {
            Ok(ImportedItem::Scan(scan)) => ("scan", (vec![scan], Vec::new())),
            Ok(ImportedItem::Skin(skin)) => ("skin", (Vec::new(), vec![*skin])),
            Err(why) => return self.show_error(Err(why)),
        };
        if let Some(show) = &mut self.show {
            show.keep_read(read.0, read.1);
        }
        self.edit_appearance(&format!("a {what}"), |t| {
            let mut all = tables(t, what);
            let mut own = Table::new();
            own.insert("file", Item::Value(Value::from(name)));
            all.push(own);
            set_all(t, what, all);
        });
        if !self.status.1 {
            let notes = self.show.as_ref().map(|show| show.notes.join("; "));
            self.set_status(notes.unwrap_or_default());
        }
    }

    /// Returns a path as written in the scene.
    fn beside(&self, file: &Path) -> String {
        let document = self.document.as_ref();
        document.map_or_else(|| file.display().to_string(), |d| d.relative_path(file))
    }

    /// Changes a table of the scene, as an appearance edit.
    fn change(&mut self, (what, number): (&str, usize), how: &str, change: Change) {
        self.edit_appearance(&format!("{how} of {what} {number}"), |t| {
            let mut all = tables(t, what);
            if let Some(table) = all.get_mut(number) {
                change(table);
            }
            set_all(t, what, all);
        });
    }

    /// Removes a table from the scene.
    fn take_out(&mut self, what: &str, number: usize) {
        self.edit_appearance(&format!("no {what} {number}"), |t| {
            let mut all = tables(t, what);
            if number < all.len() {
                all.remove(number);
            }
            // Render mode `skin` would show nothing without a skin.
            if what == "skin" && all.is_empty() {
                let mode = t.get("picture").and_then(|p| p.get("mode"));
                if mode.and_then(Item::as_str) == Some("skin") {
                    crate::document::set(t, "picture", "mode", None);
                }
            }
            set_all(t, what, all);
        });
    }

    pub(super) fn carried(&mut self, ui: &mut egui::Ui) {
        let Some(scene) = self.scene() else { return };
        for (number, scan) in scene.scan.iter().enumerate() {
            ui.push_id(("scan", number), |ui| self.scan(ui, number, scan));
        }
        if ui.button("Add a scan…").clicked() {
            self.ask = Some(PathPrompt::of(ImportKind::Scan));
        }
        ui.separator();
        for (number, skin) in scene.skin.iter().enumerate() {
            ui.push_id(("skin", number), |ui| self.skin(ui, number, skin));
        }
        if ui.button("Add a skin…").clicked() {
            self.ask = Some(PathPrompt::of(ImportKind::Skin));
        }
    }

    /// Draws the settings of a scan: its type and colours.
    fn scan(&mut self, ui: &mut egui::Ui, number: usize, scan: &ScanEntry) {
        let at = ("scan", number);
        let labels = self
            .show
            .as_ref()
            .and_then(|show| show.labels_of(&scan.file));
        let labels = labels.map(<[_]>::to_vec);
        let plain = scan.transfer.is_none() && scan.range.is_none();
        let by_labels = scan
            .labels
            .unwrap_or(!scan.label.is_empty() || plain && labels.is_some());
        let mut removed = false;
        ui.horizontal(|ui| {
            ui.label(name_of(&scan.file))
                .on_hover_text(scan.file.display().to_string());
            removed = ui.button("×").on_hover_text("Remove the scan").clicked();
        });
        if removed {
            return self.take_out("scan", number);
        }
        ui.horizontal(|ui| {
            ui.label("Data");
            for (labels_of, called) in [(false, "values"), (true, "labels")] {
                let can = !labels_of || labels.is_some();
                let own = egui::Button::selectable(by_labels == labels_of, called);
                if ui.add_enabled(can, own).clicked() && by_labels != labels_of {
                    let set = move |t: &mut Table| {
                        t.insert("labels", Item::Value(Value::from(labels_of)));
                        if !labels_of {
                            t.remove("label");
                        }
                    };
                    self.change(at, "kind", Box::new(set));
                }
            }
        });
        match labels.filter(|_| by_labels) {
            Some(labels) => {
                for (label, name) in labels {
                    self.label(ui, at, (label, &name), scan);
                }
            }
            None => {
                let chosen = scan.transfer.as_deref().unwrap_or("scan");
                let chosen = match chosen.ends_with(".json") {
                    true => name_of(Path::new(chosen)),
                    false => chosen.to_owned(),
                };
                let mut preset = None;
                ui.horizontal(|ui| {
                    ui.label("Colours");
                    egui::ComboBox::from_id_salt("colours")
                        .selected_text(chosen)
                        .show_ui(ui, |ui| {
                            if ui.button("From file…").clicked() {
                                self.ask = Some(PathPrompt::of(ImportKind::Colours(number)));
                                ui.close();
                            }
                            for name in TransferFunction::preset_names() {
                                if ui.button(name).clicked() {
                                    preset = Some(name.to_owned());
                                    ui.close();
                                }
                            }
                        });
                });
                if let Some(preset) = preset {
                    self.change(at, "transfer", Box::new(put("transfer", preset)));
                }
            }
        }
    }

    /// Draws the settings of a label of a scan: visibility, colour and opacity.
    fn label(
        &mut self,
        ui: &mut egui::Ui,
        at: (&'static str, usize),
        (label, name): (i64, &str),
        scan: &ScanEntry,
    ) {
        let number = label.to_string();
        let said = scan
            .label
            .get_key_value(name)
            .or(scan.label.get_key_value(&number));
        let key = said.map_or_else(|| number.clone(), |(key, _)| key.clone());
        let before = said.map(|(_, look)| look.clone()).unwrap_or_default();
        let mut look = before.clone();
        let mut changed = false;
        ui.horizontal(|ui| {
            if eye(ui, !look.hidden)
                .on_hover_text("Show or hide")
                .clicked()
            {
                look.hidden = !look.hidden;
                changed = true;
            }
            let colour = look
                .colour
                .as_deref()
                .and_then(|c| Color32::from_hex(c).ok());
            let mut own = colour.unwrap_or(Color32::GRAY);
            if ui.color_edit_button_srgba(&mut own).changed() {
                look.colour = Some(hex(own));
                changed = true;
            }
            let mut opacity = look.opacity.unwrap_or(0.9);
            let field = egui::DragValue::new(&mut opacity)
                .range(0.0..=1.0)
                .speed(0.01);
            if ui
                .add(field)
                .on_hover_text("Opacity over the mean chord length of the label")
                .changed()
            {
                look.opacity = Some(opacity);
                changed = true;
            }
            ui.label(name);
        });
        if changed {
            let change = move |t: &mut Table| set_label(t, &key, &look);
            self.change(at, &format!("label {label}"), Box::new(change));
        }
    }

    /// Draws the settings of a skin: visibility, attachment, colour and opacity.
    fn skin(&mut self, ui: &mut egui::Ui, number: usize, skin: &SkinEntry) {
        let at = ("skin", number);
        let mut change: Option<(&str, Change)> = None;
        let mut removed = false;
        ui.horizontal(|ui| {
            if eye(ui, !skin.hidden)
                .on_hover_text("Show or hide")
                .clicked()
            {
                let hidden = !skin.hidden;
                let hide = move |t: &mut Table| match hidden {
                    true => drop(t.insert("hidden", Item::Value(Value::from(true)))),
                    false => drop(t.remove("hidden")),
                };
                change = Some(("eye", Box::new(hide)));
            }
            let mut own = skin.colour.unwrap_or([0.8, 0.8, 0.8]);
            if ui.color_edit_button_rgb(&mut own).changed() {
                let own = own.map(|c| (1e3 * f64::from(c)).round() / 1e3);
                let paint =
                    move |t: &mut Table| drop(t.insert("colour", Item::Value(numbers(own))));
                change = Some(("colour", Box::new(paint)));
            }
            let mut opacity = f64::from(skin.opacity.unwrap_or(1.0));
            let field = egui::DragValue::new(&mut opacity)
                .range(0.0..=1.0)
                .speed(0.01);
            if ui.add(field).on_hover_text("Opacity").changed() {
                let opacity = (1e3 * opacity).round() / 1e3;
                let set = move |t: &mut Table| {
                    drop(t.insert("opacity", Item::Value(Value::from(opacity))))
                };
                change = Some(("opacity", Box::new(set)));
            }
            ui.label(name_of(&skin.file))
                .on_hover_text(skin.file.display().to_string());
            removed = ui.button("×").on_hover_text("Remove the skin").clicked();
        });
        ui.horizontal(|ui| {
            ui.label("Mapping");
            let mapping = skin.mapping.unwrap_or_default();
            egui::ComboBox::from_id_salt("mapping")
                .selected_text(mapping.to_string())
                .show_ui(ui, |ui| {
                    for other in Mapping::ALL {
                        if ui
                            .selectable_label(other == mapping, other.to_string())
                            .clicked()
                        {
                            let name = other.to_string();
                            change = Some(("mapping", Box::new(put("mapping", name))));
                        }
                    }
                });
        });
        if removed {
            self.take_out("skin", number);
        } else if let Some((how, change)) = change {
            self.change(at, how, change);
        }
    }
}

/// Returns a change that sets a text of a table.
fn put(key: &'static str, text: String) -> impl FnOnce(&mut Table) {
    move |table| drop(table.insert(key, Item::Value(Value::from(text))))
}

fn name_of(file: &Path) -> String {
    file.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Formats a colour as in scene files.
fn hex(colour: Color32) -> String {
    let [r, g, b, _] = colour.to_array();
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Sets the appearance of a label of a scan.
fn set_label(scan: &mut Table, key: &str, look: &LabelAppearanceEntry) {
    let all = scan.entry("label").or_insert(Item::Table(Table::new()));
    let Some(all) = all.as_table_like_mut() else {
        return;
    };
    let mut own = Table::new();
    if let Some(colour) = &look.colour {
        own.insert("colour", Item::Value(Value::from(colour.as_str())));
    }
    if let Some(opacity) = look.opacity {
        own.insert("opacity", Item::Value(Value::from(opacity)));
    }
    if look.hidden {
        own.insert("hidden", Item::Value(Value::from(true)));
    }
    all.insert(key, Item::Table(own));
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use toml_edit::DocumentMut;

    #[test]
    fn scans_are_edited_in_every_table_notation() {
        for text in [
            "[scan]\nfile = \"a.nrrd\"\n",
            "[[scan]]\nfile = \"a.nrrd\"\n",
            "scan = { file = \"a.nrrd\" }\n",
            "scan = [{ file = \"a.nrrd\" }]\n",
        ] {
            let mut document: DocumentMut = text.parse().unwrap();
            let mut all = tables(&document, "scan");
            assert_eq!(all.len(), 1, "{text}");
            let look = LabelAppearanceEntry {
                hidden: true,
                opacity: Some(0.5),
                ..LabelAppearanceEntry::default()
            };
            set_label(&mut all[0], "3", &look);
            set_all(&mut document, "scan", all);
            let scene = Scene::parse(&document.to_string()).unwrap();
            assert_eq!(scene.scan[0].file, Path::new("a.nrrd"));
            let own = &scene.scan[0].label["3"];
            assert!(own.hidden && own.opacity == Some(0.5), "{document}");
            set_all(&mut document, "scan", Vec::new());
            assert!(Scene::parse(&document.to_string()).unwrap().scan.is_empty());
        }
    }
}
