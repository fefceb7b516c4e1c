//! Scene edits that update the body, and their undo.

use crate::app::App;
use crate::body_edits::BodyEdit;
use crate::body_session::{BodySession, RebuildRequest};
use crate::document::Document;
use crate::loading::Loading;
use eframe::egui;
use palpate::Result;
use palpate::scene::Scene;
use toml_edit::DocumentMut;

impl App {
    /// Edits the appearance of the body and applies it immediately.
    pub(crate) fn edit_appearance(&mut self, what: &str, change: impl FnOnce(&mut DocumentMut)) {
        let result = self.try_edit(what, change, BodySession::set_appearance);
        self.show_error(result);
    }

    /// Edits planes and isosurfaces while they are dragged.
    pub(crate) fn edit_planes(&mut self, what: &str, change: impl FnOnce(&mut DocumentMut)) {
        let result = self.try_edit(what, change, BodySession::set_planes);
        self.show_error(result);
    }

    fn try_edit(
        &mut self,
        what: &str,
        change: impl FnOnce(&mut DocumentMut),
        follow: fn(&mut BodySession, &Scene) -> Result<()>,
    ) -> Result<()> {
        let Some(document) = &mut self.document else {
            return Ok(());
        };
        let before = document.clone();
        let scene = document.edit(what, change)?;
        let Some(show) = &mut self.show else {
            return Ok(());
        };
        if let Err(why) = follow(show, &scene) {
            *document = before;
            return Err(why);
        }
        Ok(())
    }

    /// Edits the material or the simulation settings, and rebuilds the body.
    pub(crate) fn edit_body(
        &mut self,
        what: &str,
        context: &egui::Context,
        change: impl FnOnce(&mut DocumentMut),
    ) {
        let Some(document) = &mut self.document else {
            return;
        };
        let before = document.clone();
        match document.edit(what, change) {
            Ok(_) => self.rebuild_body(None, Some(before), context),
            Err(why) => self.show_error(Err(why)),
        }
    }

    /// Undoes the last edit, or with `again` redoes the last undo.
    pub(crate) fn undo(&mut self, again: bool, context: &egui::Context) {
        let result = match self.can_undo_touch()[usize::from(again)] {
            true => self.undo_touch(again, context),
            false => self.try_undo(again, context),
        };
        self.show_error(result);
    }

    /// Returns the number of scene edits that can be undone.
    pub(crate) fn edits(&self) -> usize {
        self.document.as_ref().map_or(0, Document::edits)
    }

    /// Whether undo, and redo, are possible.
    pub(crate) fn can_undo(&self) -> [bool; 2] {
        let edits = self
            .document
            .as_ref()
            .map_or([false; 2], Document::can_undo_redo);
        let touches = self.can_undo_touch();
        [0, 1].map(|n| edits[n] || touches[n])
    }

    /// Whether the next undo, and the next redo, is a manual edit of the body.
    fn can_undo_touch(&self) -> [bool; 2] {
        let edits = self.edits();
        let touches = self.show.as_ref().map(|show| show.edits.can(edits));
        touches.unwrap_or_default()
    }

    fn undo_touch(&mut self, again: bool, context: &egui::Context) -> Result<()> {
        let edits = self.edits();
        let (Some(show), None) = (&mut self.show, &self.loading) else {
            return Ok(());
        };
        if again {
            return show.redo(edits);
        }
        let Some(touch) = show.edits.clone().undo() else {
            return Ok(());
        };
        match touch.as_ref() {
            BodyEdit::Pins(_) => show.undo_pins(),
            BodyEdit::Cut(..) => {
                let name = self.document.as_ref().map(|d| d.name.clone());
                let (anew, name) = (RebuildRequest::of(show), name.unwrap_or_default());
                self.loading = Some(Loading::rebuild_before_cut(
                    &self.gpu, name, anew, touch, context,
                ));
                Ok(())
            }
        }
    }

    fn try_undo(&mut self, again: bool, context: &egui::Context) -> Result<()> {
        let Some(document) = &mut self.document else {
            return Ok(());
        };
        let before = document.clone();
        if !document.undo(again)? {
            return Ok(());
        }
        if document.body() != before.body() {
            self.rebuild_body(None, Some(before), context);
            return Ok(());
        }
        let scene = document.scene()?;
        let Some(show) = &mut self.show else {
            return Ok(());
        };
        if let Err(why) = show.set_appearance(&scene) {
            *document = before;
            return Err(why);
        }
        Ok(())
    }

    /// Returns the scene of the open document.
    pub(crate) fn scene(&self) -> Option<Scene> {
        self.document.as_ref().and_then(|d| d.scene().ok())
    }
}
