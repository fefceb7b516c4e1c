//! What is saved: pictures, the scene, the body, the numbers of a press.

use crate::app::App;
use crate::ask::Saved;
use crate::document::Document;
use crate::system;
use eframe::egui;
use palpate::render::Image;
use palpate::scene::PendingImage;
use palpate::{Error, Result, io};
use std::path::{Path, PathBuf};

/// A picture on its way from the device, and where it is to be saved.
pub(crate) type SavedPicture = (PendingImage, PathBuf);

impl App {
    /// Saves, where a dialog said.
    ///
    /// # Errors
    /// What drawing or writing gives.
    pub(crate) fn save(&mut self, what: Saved, file: &Path, context: &egui::Context) -> Result<()> {
        let camera = self.orbit.camera();
        let (Some(document), Some(show)) = (&self.document, &mut self.show) else {
            return Ok(());
        };
        match what {
            #[cfg(not(target_arch = "wasm32"))]
            Saved::Film => return self.begin_film(file, context),
            // A browser cannot wait for it, and a window does not where it can do without.
            Saved::Picture if cfg!(target_arch = "wasm32") || in_eight_bits(document, file) => {
                let pending = self.ask_picture(self.picture)?;
                self.saved_picture = Some((pending, file.to_path_buf()));
                context.request_repaint();
                return Ok(());
            }
            Saved::Picture => {
                let stage = show.stage_mut();
                *stage.camera_mut() = camera;
                stage.set_size(self.picture);
                stage.save(file)?;
            }
            Saved::Scene => {
                let file = system::absolute(file)?;
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
                let text = document.text_seen(folder, &camera, self.picture, frame);
                write(&file, text.as_bytes())?;
                // What an example reads lies in no place that lasts.
                for (name, bytes) in document.ships {
                    let beside = folder.join(name);
                    if !io::exists(&beside) {
                        write(&beside, bytes)?;
                        system::hand_over(&beside)?;
                    }
                }
            }
            Saved::Mesh => {
                io::write(file, &show.stage().deformed_mesh()?)?;
            }
            Saved::Press => {
                let mut lines = "time_s,depth_m,force_n\n".to_owned();
                for s in &show.samples {
                    lines += &format!("{},{},{}\n", s.time_s, s.depth_m, s.force_n);
                }
                write(file, lines.as_bytes())?;
            }
        }
        self.saved(file)
    }

    /// Asks for the picture, so many pixels large.
    ///
    /// # Errors
    /// Where nothing is open; what drawing gives.
    pub(crate) fn ask_picture(&mut self, size: [u32; 2]) -> Result<PendingImage> {
        let camera = self.orbit.camera();
        let show = self.show.as_mut().ok_or_else(nothing_open)?;
        show.ask_image(&camera, size)
    }

    /// Saves a picture that was asked for.
    ///
    /// # Errors
    /// As [`Stage::save_asked`](palpate::scene::Stage::save_asked).
    pub(crate) fn save_picture(&self, image: Image, file: &Path) -> Result<()> {
        let show = self.show.as_ref().ok_or_else(nothing_open)?;
        show.stage().save_asked(image, file)
    }

    fn saved(&mut self, file: &Path) -> Result<()> {
        system::hand_over(file)?;
        self.watch_from_now();
        self.say(format!("saved {}", file.display()));
        Ok(())
    }

    /// Saves a picture that has arrived meanwhile.
    ///
    /// # Errors
    /// As [`App::save`].
    pub(crate) fn save_arrived(&mut self, context: &egui::Context) -> Result<()> {
        let Some((mut pending, file)) = self.saved_picture.take() else {
            return Ok(());
        };
        let Some(image) = pending.look()? else {
            self.saved_picture = Some((pending, file));
            context.request_repaint();
            return Ok(());
        };
        self.save_picture(image, &file)?;
        self.saved(&file)
    }
}

/// Whether a picture is to have eight bits a channel, as those have that are asked for.
fn in_eight_bits(document: &Document, file: &Path) -> bool {
    let bits = document.scene().map(|scene| scene.picture.bits);
    file.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("png"))
        && bits.is_ok_and(|bits| bits.is_none_or(|bits| bits == 8))
}

/// Why nothing can be saved.
fn nothing_open() -> Error {
    Error::Input("nothing is open yet".into())
}

fn write(file: &Path, bytes: &[u8]) -> Result<()> {
    io::atomic_write(file, |out| {
        use std::io::Write;
        out.write_all(bytes).map_err(Error::io(file))
    })
}
