//! Desktop: file system, system dialogs and threads.

use super::{DialogResult, DialogSender, SaveDialog, endings, file_to_open};
use crate::panel::ImportKind;
use eframe::egui;
use palpate::{Error, Result};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A dialog that closes within this time is not available.
const DIALOG_FAILURE_TIME: Duration = Duration::from_millis(120);

/// Whether there is a save dialog.
pub(crate) const HAS_SAVE_DIALOG: bool = true;

/// Runs a long operation on a thread.
pub(crate) fn spawn(work: impl FnOnce() + Send + 'static) {
    std::thread::spawn(work);
}

/// Returns the absolute path of a file.
///
/// # Errors
/// [`Error::Io`] if there is no current folder.
pub(crate) fn absolute(file: &Path) -> Result<PathBuf> {
    std::path::absolute(file).map_err(Error::io(file))
}

/// Opens the system's file dialog.
pub(crate) fn choose_file(wish: DialogSender, purpose: ImportKind) {
    let dialog = rfd::AsyncFileDialog::new()
        .set_title(purpose.title())
        .add_filter(purpose.hint(), endings(purpose))
        .add_filter("All files", &["*"]);
    let chosen = move |file| DialogResult::File(purpose, file);
    wait_for(dialog.pick_file(), chosen, wish);
}

/// Opens the system's save dialog.
pub(crate) fn choose_place(place: &SaveDialog<'_>, wish: DialogSender) {
    let mut dialog = rfd::AsyncFileDialog::new()
        .set_title(place.title)
        .add_filter(place.kinds[0], place.kinds);
    if let Some(name) = place.path.file_name() {
        dialog = dialog.set_file_name(name.to_string_lossy());
    }
    if let Some(folder) = place.path.parent() {
        dialog = dialog.set_directory(folder);
    }
    wait_for(dialog.save_file(), DialogResult::Place, wish);
}

/// Forwards the result of a dialog.
fn wait_for(
    dialog: impl Future<Output = Option<rfd::FileHandle>> + Send + 'static,
    chosen: impl Fn(PathBuf) -> DialogResult + Send + 'static,
    wish: DialogSender,
) {
    spawn(move || {
        let asked = Instant::now();
        match pollster::block_on(dialog) {
            Some(file) => wish.send_result(chosen(file.path().to_path_buf())),
            // A user cannot close a dialog this quickly.
            None if asked.elapsed() < DIALOG_FAILURE_TIME => wish.send_result(DialogResult::Failed(
                "no file dialog is available (on Linux, install xdg-desktop-portal); type the path instead: Ctrl+L".into(),
            )),
            None => {}
        }
    });
}

/// Opens dropped files.
pub(crate) fn take_dropped(files: &[egui::DroppedFileHandle], wish: &DialogSender) {
    let files = files.iter().map(|f| f.path().to_path_buf()).collect();
    if let Some(file) = file_to_open(files) {
        wish.send_result(DialogResult::File(ImportKind::Open, file));
    }
}

/// Does nothing: a saved file is already in place.
pub(crate) fn start_download(_: &Path) -> Result<()> {
    Ok(())
}

/// Returns the stored settings.
pub(crate) fn stored_settings() -> Option<String> {
    std::fs::read_to_string(settings_file()?).ok()
}

/// Stores settings; errors are ignored.
pub(crate) fn store_settings(text: &str) {
    let Some(file) = settings_file() else { return };
    let folder = file.parent().unwrap_or(Path::new("."));
    if std::fs::create_dir_all(folder).is_ok() {
        let _ = palpate::io::atomic_write(&file, |out| {
            use std::io::Write;
            out.write_all(text.as_bytes()).map_err(Error::io(&file))
        });
    }
}

/// Returns the path of the settings file: `PALPATE_VIEW_SETTINGS`, or a file in the system's
/// configuration folder.
fn settings_file() -> Option<PathBuf> {
    let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty());
    if let Some(file) = variable("PALPATE_VIEW_SETTINGS") {
        return Some(file.into());
    }
    let folder = match std::env::consts::OS {
        "windows" => PathBuf::from(variable("APPDATA")?),
        "macos" => PathBuf::from(variable("HOME")?).join("Library/Application Support"),
        _ => match variable("XDG_CONFIG_HOME") {
            Some(folder) => folder.into(),
            None => PathBuf::from(variable("HOME")?).join(".config"),
        },
    };
    Some(folder.join("palpate").join("view.json"))
}

/// Stores the bundled files of an example. Returns their folder.
///
/// # Errors
/// [`Error::Io`] where they cannot be written.
pub(crate) fn bundle_files(files: &[(&str, &[u8])]) -> Result<PathBuf> {
    use std::io::Write;
    let folder = std::env::temp_dir().join(concat!("palpate-examples-", env!("CARGO_PKG_VERSION")));
    std::fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
    for (name, bytes) in files {
        let file = folder.join(name);
        if std::fs::metadata(&file).map_or(0, |m| m.len()) != bytes.len() as u64 {
            palpate::io::atomic_write(&file, |out| out.write_all(bytes).map_err(Error::io(&file)))?;
        }
    }
    Ok(folder)
}
