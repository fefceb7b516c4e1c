//! Prompt for a path to open or save: typed, or chosen in the system's dialog.

use crate::app::App;
use crate::panel::ImportKind;
use crate::platform::{self, SaveDialog};
use eframe::egui::{self, Key};
use std::path::{Path, PathBuf};

/// What to save.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SaveKind {
    /// The picture.
    Picture,
    /// The scene with its camera.
    Scene,
    /// The deformed body.
    Mesh,
    /// The samples of the last press.
    Press,
    /// A film that starts now.
    #[cfg(not(target_arch = "wasm32"))]
    Film,
}

impl SaveKind {
    /// Whether the output has a size in pixels.
    fn has_size(self) -> bool {
        match self {
            SaveKind::Picture => true,
            #[cfg(not(target_arch = "wasm32"))]
            SaveKind::Film => true,
            _ => false,
        }
    }

    /// Returns the title, the suffix of the proposed file name, and the allowed extensions.
    fn named(self) -> (&'static str, &'static str, &'static [&'static str]) {
        match self {
            SaveKind::Picture => ("Save picture", ".png", &["png", "exr"]),
            SaveKind::Scene => ("Save scene", "_view.toml", &["toml"]),
            SaveKind::Mesh => (
                "Save deformed body",
                "_bent.vtu",
                &["vtu", "vtk", "msh", "mesh", "inp"],
            ),
            SaveKind::Press => ("Save press", "_press.csv", &["csv"]),
            #[cfg(not(target_arch = "wasm32"))]
            SaveKind::Film => ("Save film", ".gif", &["gif", "mp4"]),
        }
    }
}

/// An open path prompt.
pub(crate) struct PathPrompt {
    /// What to save; `None` to open a file.
    what: Option<SaveKind>,
    /// Purpose of the file to open.
    purpose: ImportKind,
    /// The typed path.
    pub path: String,
    /// An existing file whose replacement was announced; saving again confirms it.
    replaced: Option<PathBuf>,
}

impl PathPrompt {
    /// Creates a prompt to open a file.
    pub fn of(purpose: ImportKind) -> PathPrompt {
        PathPrompt {
            what: None,
            purpose,
            path: String::new(),
            replaced: None,
        }
    }
}

impl App {
    /// Prompts for a path to save to, by default in the folder of the open document.
    pub(crate) fn prompt_save_path(&mut self, what: SaveKind) {
        let Some(document) = self.document.as_ref().filter(|_| self.show.is_some()) else {
            return;
        };
        let name = Path::new(&document.name).file_stem().unwrap_or_default();
        let name = name.to_string_lossy().to_lowercase().replace(' ', "_");
        let folder = document.file.as_deref().and_then(Path::parent);
        let here = std::env::current_dir().unwrap_or_default();
        let place = folder.unwrap_or(&here).join(name + what.named().1);
        self.ask = Some(PathPrompt {
            what: Some(what),
            purpose: ImportKind::Open,
            path: place.to_string_lossy().into_owned(),
            replaced: None,
        });
    }

    /// Draws the prompt.
    pub(crate) fn show_ask(&mut self, context: &egui::Context) {
        let Some(mut ask) = self.ask.take() else {
            return;
        };
        let title = ask.what.map_or(ask.purpose.title(), |what| what.named().0);
        let (mut done, mut browse) = (None, false);
        egui::Window::new(title)
            .collapsible(false)
            .resizable(false)
            .anchor(egui::Align2::CENTER_CENTER, [0.0, -80.0])
            .show(context, |ui| {
                let edit = egui::TextEdit::singleline(&mut ask.path)
                    .hint_text(ask.purpose.hint())
                    .desired_width(420.0);
                let response = ui.add(edit);
                let entered = response.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
                if ui.memory(|m| m.focused().is_none()) && !entered {
                    response.request_focus();
                }
                if ask.what.is_some_and(SaveKind::has_size) {
                    ui.horizontal(|ui| {
                        let [width, height] = &mut self.picture;
                        ui.add(egui::DragValue::new(width).range(16..=8192));
                        ui.label("×");
                        ui.add(egui::DragValue::new(height).range(16..=8192));
                        ui.label("pixels");
                    });
                }
                ui.horizontal(|ui| {
                    let go = if ask.what.is_some() { "Save" } else { "Open" };
                    if ui.button(go).clicked() || entered {
                        done = Some(true);
                    }
                    browse = platform::HAS_SAVE_DIALOG && ui.button("Browse…").clicked();
                    let escaped = ui.input(|i| i.key_pressed(Key::Escape));
                    if ui.button("Cancel").clicked() || escaped {
                        done = Some(false);
                    }
                });
            });
        if browse {
            self.browse(&ask, context);
        }
        let path = PathBuf::from(ask.path.trim());
        match (done, ask.what) {
            (None, _) => self.ask = Some(ask),
            (Some(false), _) => {}
            (Some(true), None) => self.start_import(ask.purpose, &path, context),
            (Some(true), Some(_)) if path.exists() && ask.replaced.as_ref() != Some(&path) => {
                self.set_status(format!(
                    "{} already exists; save again to overwrite it",
                    path.display()
                ));
                ask.replaced = Some(path);
                self.ask = Some(ask);
            }
            (Some(true), Some(what)) => {
                if let Err(why) = self.save(what, &path, context) {
                    self.show_error(Err(why));
                    self.ask = Some(ask);
                }
            }
        }
    }

    /// Opens the system's dialog for the prompt.
    fn browse(&self, ask: &PathPrompt, context: &egui::Context) {
        let wish = self.dialog_sender(context);
        match ask.what.map(SaveKind::named) {
            None => platform::choose_file(wish, ask.purpose),
            Some((title, _, kinds)) => {
                let path = Path::new(&ask.path);
                platform::choose_place(&SaveDialog { title, kinds, path }, wish);
            }
        }
    }
}
