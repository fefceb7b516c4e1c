//! Opening, rebuilding and reloading of documents.

use crate::app::App;
use crate::body_session::BodySession;
use crate::camera_control::Orbit;
use crate::document::Document;
use crate::examples::Example;
use crate::loading::{Loading, ReusableBody};
use crate::platform::{self, DialogResult, DialogSender};
use crate::pointer_tool::PointerGesture;
use eframe::egui;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};
use web_time::Instant;

/// Polling interval of the open file.
const FILE_POLL_INTERVAL: Duration = Duration::from_secs(1);

/// The open file and its last modification time.
pub(crate) struct WatchedFile {
    file: PathBuf,
    at: Option<SystemTime>,
    looked: Instant,
}

/// Returns the modification time of a file; `None` in a browser.
fn changed(file: &Path) -> Option<SystemTime> {
    std::fs::metadata(file).and_then(|m| m.modified()).ok()
}

impl App {
    /// Returns the sender for dialog results.
    pub(crate) fn dialog_sender(&self, context: &egui::Context) -> DialogSender {
        DialogSender {
            send: self.chosen.0.clone(),
            context: context.clone(),
        }
    }

    /// Opens a file.
    pub(crate) fn open(&mut self, file: &Path, context: &egui::Context) {
        match Document::open(file) {
            Ok(document) => self.begin(document, context),
            Err(why) => self.show_error(Err(why)),
        }
    }

    /// Opens a file, with a default colour preset if its scene sets none.
    #[cfg(target_arch = "wasm32")]
    pub(crate) fn open_as(&mut self, file: &Path, transfer: Option<&str>, context: &egui::Context) {
        let opened = Document::open(file).and_then(|mut document| {
            if let Some(preset) = transfer
                && document.scene()?.picture.transfer.is_none()
            {
                document.set_initial_preset(preset)?;
            }
            Ok(document)
        });
        match opened {
            Ok(document) => self.begin(document, context),
            Err(why) => self.show_error(Err(why)),
        }
    }

    /// Opens a bundled example.
    pub(crate) fn open_example(&mut self, example: &Example, context: &egui::Context) {
        match example.open() {
            Ok(document) => self.begin(document, context),
            Err(why) => self.show_error(Err(why)),
        }
    }

    fn begin(&mut self, document: Document, context: &egui::Context) {
        self.status = (format!("opening {}", document.name), false);
        match Loading::open(&self.gpu, document, context) {
            Ok(loading) => self.loading = Some(loading),
            Err(why) => self.show_error(Err(why)),
        }
    }

    /// Cancels opening or importing.
    pub(crate) fn cancel_loading(&mut self) {
        if self.loading.is_none() && self.taking.take().is_some() {
            return self.set_status("import cancelled".into());
        }
        if let Some(loading) = self.loading.take() {
            // The thread stops at its next progress report.
            self.set_status(format!("opening {} was cancelled", loading.name));
        }
    }

    /// Rebuilds the body from its scene, at rest, with a finger of `radius`, or the current one. On
    /// an error, the scene is restored to `before`.
    pub(crate) fn rebuild_body(
        &mut self,
        radius: Option<f64>,
        before: Option<Document>,
        context: &egui::Context,
    ) {
        let (Some(document), Some(show)) = (&self.document, &self.show) else {
            return;
        };
        // Opening another document has priority.
        if self.loading.as_ref().is_some_and(Loading::opens) {
            return;
        }
        let kept = ReusableBody {
            mesh: show.mesh.clone(),
            radius: radius.unwrap_or(show.radius),
            series: show.player.as_ref().map(|player| player.series().clone()),
        };
        match Loading::rebuild(&self.gpu, document, kept, before, context) {
            Ok(loading) => self.loading = Some(loading),
            Err(why) => self.show_error(Err(why)),
        }
    }

    /// Installs a body that is ready.
    pub(crate) fn install_body(&mut self, context: &egui::Context) {
        // The view depends on the picture size, which is known after the first frames.
        if self.loading.is_some() && !self.settled {
            context.request_repaint();
            return;
        }
        let Some(made) = self.loading.as_ref().and_then(Loading::ready) else {
            return;
        };
        let Some(loading) = self.loading.take() else {
            return;
        };
        let mut show = match made {
            Ok(show) => show,
            // The previous document stays open.
            Err(why) => {
                if let (Some(before), Some(document)) = (loading.before, &self.document)
                    && document.text() == loading.text
                {
                    self.document = Some(before);
                }
                return self.show_error(Err(why));
            }
        };
        self.status = (show.notes.join("; "), false);
        match (loading.document, &self.show, &self.document) {
            (Some(document), ..) => {
                let again = self
                    .document
                    .as_ref()
                    .is_some_and(|old| document.file.is_some() && old.file == document.file);
                if let Some(file) = &document.file {
                    self.settings.opened(file);
                }
                self.watched = document.file.as_ref().map(|file| WatchedFile {
                    file: file.clone(),
                    at: changed(file),
                    looked: Instant::now(),
                });
                // Keep the user's view.
                if !again {
                    self.apply_view(&mut show);
                }
                self.picture = show.stage().size();
                let title = format!("{} — Palpate", document.name);
                context.send_viewport_cmd(egui::ViewportCommand::Title(title));
                self.document = Some(document);
                self.opened += 1;
            }
            // Keep the playback settings and later edits.
            (None, Some(old), Some(document)) => {
                show.speed = old.speed;
                show.playing = old.playing || old.failed;
                if document.text() != loading.text {
                    let result = document
                        .scene()
                        .and_then(|scene| show.set_appearance(&scene));
                    self.show_error(result);
                }
            }
            (None, ..) => {}
        }
        self.stroke = PointerGesture::Idle;
        self.taking = None;
        self.ruler = None;
        self.histogram = None;
        self.screen.invalidate();
        self.show = Some(show);
    }

    /// Sets the view of the scene.
    fn apply_view(&mut self, show: &mut BodySession) {
        let camera = *show.stage_mut().camera_mut();
        self.orbit = Orbit::of(&camera, show.diagonal());
        // Fit a view of a different aspect ratio.
        if let Some(area) = self.area {
            let wide = |[w, h]: [u32; 2]| f64::from(w) / f64::from(h.max(1));
            let wanted = wide(show.stage().size());
            self.orbit.zoom((wide(area.size) / wanted).min(1.0));
        }
    }

    /// Handles dialog results and dropped files.
    pub(crate) fn take_files(&mut self, context: &egui::Context) {
        let dropped = context.input(|i| i.raw.dropped_files.clone());
        if !dropped.is_empty() {
            platform::take_dropped(&dropped, &self.dialog_sender(context));
        }
        while let Ok(chosen) = self.chosen.1.try_recv() {
            match chosen {
                DialogResult::File(purpose, file) => {
                    self.ask = None;
                    self.start_import(purpose, &file, context);
                }
                DialogResult::Place(file) => {
                    if let Some(ask) = &mut self.ask {
                        ask.path = file.to_string_lossy().into_owned();
                    }
                }
                DialogResult::Failed(why) => self.status = (why, true),
            }
        }
    }

    /// Reloads the open file if it has changed, unless its scene was edited here.
    pub(crate) fn watch(&mut self, context: &egui::Context) {
        let Some(watched) = &mut self.watched else {
            return;
        };
        context.request_repaint_after(FILE_POLL_INTERVAL);
        if watched.looked.elapsed() < FILE_POLL_INTERVAL || self.loading.is_some() {
            return;
        }
        watched.looked = Instant::now();
        let now = changed(&watched.file);
        if now.is_none() || now == watched.at {
            return;
        }
        // Only one attempt per change, even if it fails.
        watched.at = now;
        let file = watched.file.clone();
        match self.document.as_ref().is_some_and(|d| d.can_undo_redo()[0]) {
            true => self.set_status(format!(
                "{} has changed on disk; edits made here are kept, open the file again to reload it",
                file.display()
            )),
            false => self.open(&file, context),
        }
    }

    /// Ignores changes up to now, after saving the open file.
    pub(crate) fn watch_from_now(&mut self) {
        if let Some(watched) = &mut self.watched {
            watched.at = changed(&watched.file);
        }
    }
}
