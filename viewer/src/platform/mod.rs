//! Platform-specific parts for desktop and browser: files, dialogs, settings and background work.

#[cfg(not(target_arch = "wasm32"))]
mod desktop;
#[cfg(target_arch = "wasm32")]
mod web;

#[cfg(not(target_arch = "wasm32"))]
pub(crate) use desktop::*;
#[cfg(target_arch = "wasm32")]
pub(crate) use web::*;

use crate::panel::ImportKind;
use eframe::egui;
use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;

/// File extensions that can be opened.
const OPEN_EXTENSIONS: [&str; 25] = [
    "toml", "pvd", "vtu", "pvtu", "vtk", "msh", "mesh", "inp", "node", "ele", "nrrd", "nhdr",
    "nii", "gz", "bz2", "hdr", "img", "mgz", "mgh", "mha", "mhd", "dcm", "stl", "ply", "obj",
];

/// File extensions of scans and skins.
const VOLUMES: [&str; 12] = [
    "nrrd", "nhdr", "nii", "gz", "bz2", "hdr", "img", "mgz", "mgh", "mha", "mhd", "dcm",
];
const SURFACES: [&str; 10] = [
    "obj", "ply", "stl", "vtk", "nrrd", "nhdr", "nii", "gz", "mha", "mhd",
];

/// Returns the file extensions for a purpose.
fn endings(purpose: ImportKind) -> &'static [&'static str] {
    match purpose {
        ImportKind::Open => &OPEN_EXTENSIONS,
        ImportKind::Scan => &VOLUMES,
        ImportKind::Colours(_) => &["json"],
        ImportKind::Skin => &SURFACES,
    }
}

/// Result of a dialog, or dropped files.
pub(crate) enum DialogResult {
    /// A file and its purpose.
    File(ImportKind, PathBuf),
    /// A path to save to.
    Place(PathBuf),
    /// An error message.
    Failed(String),
}

/// Sender of dialog results; also repaints the interface.
#[derive(Clone)]
pub(crate) struct DialogSender {
    pub send: Sender<DialogResult>,
    pub context: egui::Context,
}

impl DialogSender {
    fn send_result(&self, chosen: DialogResult) {
        // The window may be closed already.
        let _ = self.send.send(chosen);
        self.context.request_repaint();
    }
}

/// Returns the file to open of several dropped ones: a scene, or else the first.
fn file_to_open(mut files: Vec<PathBuf>) -> Option<PathBuf> {
    let is_scene = |file: &PathBuf| file.extension().is_some_and(|e| e == "toml");
    let first = files.iter().position(is_scene).unwrap_or(0);
    (!files.is_empty()).then(|| files.swap_remove(first))
}

/// Options of a save dialog: title, extensions and proposed path.
#[cfg_attr(target_arch = "wasm32", allow(dead_code))]
pub(crate) struct SaveDialog<'a> {
    pub title: &'a str,
    pub kinds: &'a [&'a str],
    pub path: &'a Path,
}
