//! Browser: chosen, dropped or fetched files are stored in memory, and saved files are downloaded.
//! There is one thread.

use super::{DialogResult, DialogSender, SaveDialog, endings, file_to_open};
use crate::panel::ImportKind;
use eframe::egui;
use js_sys::{Array, Uint8Array};
use palpate::{Error, Result, io};
use std::path::{Path, PathBuf};
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::{JsFuture, spawn_local};

/// Whether there is a save dialog; saved files are downloaded instead.
pub(crate) const HAS_SAVE_DIALOG: bool = false;

/// Key of the settings in local storage.
const SETTINGS: &str = "palpate.view";
/// Delay before a long operation, ms, in which a frame shows its progress text.
const PAINT_DELAY_MS: i32 = 40;

/// Runs a long operation, after a frame has shown its progress text.
pub(crate) fn spawn(work: impl FnOnce() + 'static) {
    spawn_local(async move {
        crate::web::pause(PAINT_DELAY_MS).await;
        work();
    });
}

/// Returns the name of a file in memory.
pub(crate) fn absolute(file: &Path) -> Result<PathBuf> {
    Ok(file.to_path_buf())
}

/// Opens the browser's file dialog.
pub(crate) fn choose_file(wish: DialogSender, purpose: ImportKind) {
    let Some(input) = file_input() else { return };
    let endings: Vec<String> = endings(purpose).iter().map(|e| format!(".{e}")).collect();
    input.set_type("file");
    input.set_multiple(true);
    input.set_accept(&endings.join(","));
    let chosen = input.clone();
    let take = Closure::once_into_js(move || {
        let files = chosen.files();
        let count = files.as_ref().map_or(0, web_sys::FileList::length);
        let files: Vec<web_sys::File> = (0..count).filter_map(|i| files.as_ref()?.get(i)).collect();
        spawn_local(async move {
            let mut names = Vec::new();
            for file in files {
                match JsFuture::from(file.array_buffer()).await {
                    Ok(buffer) => {
                        let bytes = Uint8Array::new(&buffer).to_vec();
                        io::insert_file(file.name(), bytes);
                        names.push(PathBuf::from(file.name()));
                    }
                    Err(_) => return wish.send_result(unreadable(&file.name())),
                }
            }
            if let Some(file) = file_to_open(names) {
                wish.send_result(DialogResult::File(purpose, file));
            }
        });
    });
    input.set_onchange(Some(take.unchecked_ref()));
    input.click();
}

fn file_input() -> Option<web_sys::HtmlInputElement> {
    let document = web_sys::window()?.document()?;
    document.create_element("input").ok()?.dyn_into().ok()
}

fn unreadable(name: &str) -> DialogResult {
    DialogResult::Failed(format!("{name}: the browser cannot read the file"))
}

/// Saves under the proposed name without a dialog.
pub(crate) fn choose_place(place: &SaveDialog<'_>, wish: DialogSender) {
    wish.send_result(DialogResult::Place(place.path.to_path_buf()));
}

/// Opens files dropped on the page.
pub(crate) fn take_dropped(files: &[egui::DroppedFileHandle], wish: &DialogSender) {
    let (files, wish) = (files.to_vec(), wish.clone());
    spawn_local(async move {
        let mut names = Vec::new();
        for file in files {
            let path = file.path().to_path_buf();
            match file.bytes_async().await {
                Ok(bytes) => io::insert_file(&path, bytes),
                Err(_) => return wish.send_result(unreadable(&path.to_string_lossy())),
            }
            names.push(path);
        }
        if let Some(file) = file_to_open(names) {
            wish.send_result(DialogResult::File(ImportKind::Open, file));
        }
    });
}

/// Downloads a saved file.
pub(crate) fn start_download(file: &Path) -> Result<()> {
    let Some(bytes) = io::take_file(file) else {
        return Ok(());
    };
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    download(&name, &bytes)
        .ok_or_else(|| Error::Input(format!("{name}: the browser cannot download the file")))
}

fn download(name: &str, bytes: &[u8]) -> Option<()> {
    let parts = Array::of1(&Uint8Array::from(bytes));
    let blob = web_sys::Blob::new_with_u8_array_sequence(&parts).ok()?;
    let url = web_sys::Url::create_object_url_with_blob(&blob).ok()?;
    let document = web_sys::window()?.document()?;
    let link: web_sys::HtmlAnchorElement = document.create_element("a").ok()?.dyn_into().ok()?;
    link.set_href(&url);
    link.set_download(name);
    link.click();
    web_sys::Url::revoke_object_url(&url).ok()
}

fn storage() -> Option<web_sys::Storage> {
    web_sys::window()?.local_storage().ok()?
}

/// Returns the stored settings.
pub(crate) fn stored_settings() -> Option<String> {
    storage()?.get_item(SETTINGS).ok()?
}

/// Stores settings; ignored if the browser forbids it.
pub(crate) fn store_settings(text: &str) {
    if let Some(storage) = storage() {
        let _ = storage.set_item(SETTINGS, text);
    }
}

/// Stores the bundled files of an example in memory. Returns their folder.
pub(crate) fn bundle_files(files: &[(&str, &[u8])]) -> Result<PathBuf> {
    for (name, bytes) in files {
        io::insert_file(name, bytes.to_vec());
    }
    Ok(PathBuf::new())
}
