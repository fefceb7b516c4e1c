//! Saving of pictures, the scene, the body and press measurements.

use crate::app::App;
use crate::document::Document;
use crate::loading::BackgroundTask;
use crate::path_prompt::SaveKind;
use crate::platform;
use eframe::egui;
use palpate::scene::{PendingImage, PictureWriter};
use palpate::{Error, Result, io};
use std::path::{Path, PathBuf};

/// A picture that is being saved.
pub(crate) enum PendingScreenshot {
    /// Being rendered and read back.
    Asked(PendingImage, Box<PictureWriter>, PathBuf),
    /// Being written to a file.
    Written(BackgroundTask<PathBuf>),
}

impl App {
    /// Saves to the selected path.
    ///
    /// # Errors
    /// An error if rendering or writing fails.
    pub(crate) fn save(
        &mut self,
        what: SaveKind,
        file: &Path,
        context: &egui::Context,
    ) -> Result<()> {
        let camera = self.orbit.camera();
        let (Some(document), Some(show)) = (&self.document, &mut self.show) else {
            return Ok(());
        };
        match what {
            #[cfg(not(target_arch = "wasm32"))]
            SaveKind::Film => return self.begin_film(file, context),
            // Asynchronous: required in a browser, and avoids blocking a window.
            SaveKind::Picture if cfg!(target_arch = "wasm32") || in_eight_bits(document, file) => {
                let (pending, writer) = self.ask_picture(self.picture)?;
                self.saved_picture = Some(PendingScreenshot::Asked(
                    pending,
                    Box::new(writer),
                    file.to_path_buf(),
                ));
                context.request_repaint();
                return Ok(());
            }
            SaveKind::Picture => {
                let stage = show.stage_mut();
                *stage.camera_mut() = camera;
                stage.set_size(self.picture);
                stage.save(file)?;
            }
            SaveKind::Scene => {
                let file = platform::absolute(file)?;
                let folder = file.parent().unwrap_or(Path::new(""));
                let frame = show.player.as_ref().and_then(|player| {
                    let field = show.stage().scalar_field();
                    let range = player.series().range(&field.name);
                    let range = range.filter(|_| field.regions.is_empty());
                    Some((
                        player.series().file(player.shown())?,
                        range.map(|(a, b)| [a, b]),
                    ))
                });
                let text = document.text_with_view(folder, &camera, self.picture, frame);
                write(&file, text.as_bytes())?;
                // The bundled files of an example are in a temporary folder.
                for (name, bytes) in document.bundled_files {
                    let beside = folder.join(name);
                    if !io::exists(&beside) {
                        write(&beside, bytes)?;
                        platform::start_download(&beside)?;
                    }
                }
            }
            SaveKind::Mesh => {
                io::write(file, &show.stage().deformed_mesh()?)?;
            }
            SaveKind::Press => {
                let mut lines = "time_s,depth_m,force_n\n".to_owned();
                for s in show.samples() {
                    lines += &format!("{},{},{}\n", s.time_s, s.depth_m, s.force_n);
                }
                write(file, lines.as_bytes())?;
            }
        }
        self.saved(file)
    }

    /// Requests a picture of `size` pixels; returns it with its writer.
    ///
    /// # Errors
    /// An error if nothing is open or rendering fails.
    pub(crate) fn ask_picture(&mut self, size: [u32; 2]) -> Result<(PendingImage, PictureWriter)> {
        let camera = self.orbit.camera();
        let show = self.show.as_mut().ok_or_else(nothing_open)?;
        let pending = show.ask_image(&camera, size)?;
        Ok((pending, show.stage().picture_writer()))
    }

    fn saved(&mut self, file: &Path) -> Result<()> {
        platform::start_download(file)?;
        self.watch_from_now();
        self.set_status(format!("saved {}", file.display()));
        Ok(())
    }

    /// Advances a picture that is being saved.
    ///
    /// # Errors
    /// The errors of [`App::save`].
    pub(crate) fn save_arrived(&mut self, context: &egui::Context) -> Result<()> {
        let next = match self.saved_picture.take() {
            None => return Ok(()),
            Some(PendingScreenshot::Asked(mut pending, writer, file)) => {
                match pending.try_take()? {
                    None => {
                        context.request_repaint();
                        PendingScreenshot::Asked(pending, writer, file)
                    }
                    Some(image) => PendingScreenshot::Written(BackgroundTask::spawn(
                        "saving",
                        context,
                        move |_| writer.save(image, &file).map(|()| file),
                    )),
                }
            }
            Some(PendingScreenshot::Written(work)) => match work.try_take() {
                None => PendingScreenshot::Written(work),
                Some(file) => return self.saved(&file?),
            },
        };
        self.saved_picture = Some(next);
        Ok(())
    }
}

/// Whether a picture is saved with eight bits per channel and one sample per pixel, as rendered by
/// [`App::ask_picture`].
fn in_eight_bits(document: &Document, file: &Path) -> bool {
    let bits = document.scene().map(|scene| scene.picture.bits);
    file.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("png"))
        && bits.is_ok_and(|bits| bits.is_none_or(|bits| bits == 8))
}

/// Returns the error for saving without an open document.
fn nothing_open() -> Error {
    Error::Input("no document is open; open one first".into())
}

fn write(file: &Path, bytes: &[u8]) -> Result<()> {
    io::atomic_write(file, |out| {
        use std::io::Write;
        out.write_all(bytes).map_err(Error::io(file))
    })
}
