//! Films of the window, recorded in real time.

use crate::app::App;
use eframe::egui;
use palpate::render::{Animation, Background, Image};
use palpate::scene::PendingImage;
use palpate::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, channel, sync_channel};
use std::time::{Duration, Instant};

/// Pictures per second.
const FPS: f64 = 12.0;
/// Maximum number of pictures waiting to be written; further pictures are dropped, and the next one
/// covers a longer time.
const WAITING: usize = 8;

/// A film that is being recorded.
pub(crate) struct Recording {
    file: PathBuf,
    size: [u32; 2],
    began: Instant,
    /// Number of film pictures sent to the writer.
    handed: u64,
    pending: Option<PendingImage>,
    /// Channel to the writer thread: each image with its number of film pictures. `None` once the
    /// film ends.
    pictures: Option<SyncSender<(Image, u64)>>,
    ended: Receiver<Result<u64>>,
}

impl Recording {
    /// Starts a film.
    ///
    /// # Errors
    /// The errors of [`Animation::create`].
    fn begin(file: &Path, size: [u32; 2], context: &egui::Context) -> Result<Recording> {
        let film = Animation::create(file, size, FPS)?;
        let (pictures, written) = sync_channel(WAITING);
        let (end, ended) = channel();
        let context = context.clone();
        std::thread::spawn(move || {
            // The receiver may be gone.
            let _ = end.send(write(film, &written));
            context.request_repaint();
        });
        Ok(Recording {
            file: file.to_path_buf(),
            size,
            began: Instant::now(),
            handed: 0,
            pending: None,
            pictures: Some(pictures),
            ended,
        })
    }

    /// Returns the number of pictures that the film should have by now.
    fn due(&self) -> u64 {
        (FPS * self.began.elapsed().as_secs_f64()) as u64 + 1
    }

    /// Sends a picture for all that are due.
    fn send_frame(&mut self, image: Image) {
        let count = self.due().saturating_sub(self.handed).max(1);
        let Some(pictures) = &self.pictures else {
            return;
        };
        match pictures.try_send((image, count)) {
            Ok(()) => self.handed += count,
            Err(TrySendError::Full(_)) => {}
            // The writer reports its error itself.
            Err(TrySendError::Disconnected(_)) => self.pictures = None,
        }
    }
}

/// Writes pictures until the channel closes. Returns their number.
fn write(mut film: Animation, pictures: &Receiver<(Image, u64)>) -> Result<u64> {
    let mut all = 0;
    while let Ok((image, count)) = pictures.recv() {
        for _ in 0..count {
            film.push(&image, Background::Black)?;
        }
        all += count;
    }
    film.finish()?;
    Ok(all)
}

impl App {
    /// Starts a film of the view, in the size of saved pictures.
    ///
    /// # Errors
    /// The errors of [`Animation::create`].
    pub(crate) fn begin_film(&mut self, file: &Path, context: &egui::Context) -> Result<()> {
        self.recording = Some(Recording::begin(file, self.picture, context)?);
        self.set_status("recording the film; stop it in the status bar".into());
        Ok(())
    }

    /// Returns the duration of the running film, s.
    pub(crate) fn films(&self) -> Option<f64> {
        let recording = self.recording.as_ref();
        let recording = recording.filter(|r| r.pictures.is_some());
        recording.map(|r| r.began.elapsed().as_secs_f64())
    }

    /// Ends the film; it is complete once the waiting pictures are written.
    pub(crate) fn end_film(&mut self) {
        if let Some(recording) = &mut self.recording {
            recording.pictures = None;
            recording.pending = None;
            self.set_status("writing the remaining pictures of the film".into());
        }
    }

    /// Captures pictures of the film, and reports its result.
    pub(crate) fn film(&mut self, context: &egui::Context) {
        let Some(mut recording) = self.recording.take() else {
            return;
        };
        match recording.ended.try_recv() {
            Ok(Ok(count)) => {
                let seconds = count as f64 / FPS;
                let file = recording.file.display();
                return self.set_status(format!("saved {file}, {seconds:.1} s"));
            }
            Ok(Err(why)) => return self.show_error(Err(why)),
            Err(TryRecvError::Disconnected) => {
                let why =
                    "internal error: the film writer ended without a result; please report it";
                return self.show_error(Err(Error::Input(why.into())));
            }
            Err(TryRecvError::Empty) => {}
        }
        let taken = self.take_picture(&mut recording);
        self.recording = Some(recording);
        if taken.is_err() {
            self.end_film();
        }
        self.show_error(taken);
        context.request_repaint_after(Duration::from_secs_f64(0.5 / FPS));
    }

    fn take_picture(&mut self, recording: &mut Recording) -> Result<()> {
        if recording.pictures.is_none() || self.show.is_none() {
            return Ok(());
        }
        if let Some(mut pending) = recording.pending.take() {
            match pending.try_take()? {
                Some(image) => recording.send_frame(image),
                None => recording.pending = Some(pending),
            }
        }
        if recording.pending.is_none() && recording.due() > recording.handed {
            recording.pending = Some(self.ask_picture(recording.size)?.0);
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn film_duration_matches_recording_time() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("film.gif");
        let mut recording = Recording::begin(&file, [16, 12], &egui::Context::default()).unwrap();
        let picture = |grey: f32| Image {
            size: [16, 12],
            channels: 4,
            values: [grey, grey, grey, 1.0].repeat(16 * 12),
        };
        recording.send_frame(picture(0.2));
        recording.began -= Duration::from_millis(500);
        // A late picture covers all that were due.
        recording.send_frame(picture(0.8));
        let handed = recording.handed;
        assert!((6..=recording.due()).contains(&handed), "{handed}");
        assert!(
            !file.exists(),
            "the file must not exist before the film is complete"
        );
        recording.pictures = None;
        let wait = recording.ended.recv_timeout(Duration::from_secs(600));
        assert_eq!(wait.unwrap().unwrap(), handed);
        assert!(std::fs::read(&file).unwrap().starts_with(b"GIF89a"));
        assert!(
            Recording::begin(
                &folder.path().join("film.txt"),
                [16, 12],
                &egui::Context::default()
            )
            .is_err()
        );
    }
}
