//! What a desktop and a browser have each in their own way: files, dialogs, settings, work that takes
//! a while.

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

/// Endings of what can be opened.
const OPEN_EXTENSIONS: [&str; 19] = [
    "toml", "pvd", "vtu", "pvtu", "vtk", "msh", "mesh", "inp", "node", "ele", "nrrd", "nhdr",
    "nii", "gz", "mha", "mhd", "stl", "ply", "obj",
];

/// Endings of what else can be chosen.
const VOLUMES: [&str; 6] = ["nrrd", "nhdr", "nii", "gz", "mha", "mhd"];
const SURFACES: [&str; 10] = [
    "obj", "ply", "stl", "vtk", "nrrd", "nhdr", "nii", "gz", "mha", "mhd",
];

/// Endings of files for a purpose.
fn endings(purpose: ImportKind) -> &'static [&'static str] {
    match purpose {
        ImportKind::Open => &OPEN_EXTENSIONS,
        ImportKind::Scan => &VOLUMES,
        ImportKind::Colours(_) => &["json"],
        ImportKind::Skin => &SURFACES,
    }
}

/// What a dialog of the system was closed with, or what was dropped.
pub(crate) enum DialogResult {
    /// A file, and what it is for.
    File(ImportKind, PathBuf),
    /// Where to save what is asked for.
    Place(PathBuf),
    /// Nothing, for this reason.
    Failed(String),
}

/// Where what was chosen is sent to, and the interface that looks there.
#[derive(Clone)]
pub(crate) struct DialogSender {
    pub send: Sender<DialogResult>,
    pub context: egui::Context,
}

impl DialogSender {
    fn grant(&self, chosen: DialogResult) {
        // A window that was closed meanwhile wants nothing.
        let _ = self.send.send(chosen);
        self.context.request_repaint();
    }
}

/// Of files that were dropped together the one to open: the scene among them, or the first.
fn foremost(mut files: Vec<PathBuf>) -> Option<PathBuf> {
    let is_scene = |file: &PathBuf| file.extension().is_some_and(|e| e == "toml");
    let first = files.iter().position(is_scene).unwrap_or(0);
    (!files.is_empty()).then(|| files.swap_remove(first))
}

/// What is asked of a dialog that saves: its title, the endings that there are, the path proposed.
#[cfg_attr(target_arch = "wasm32", allow(dead_code))]
pub(crate) struct SaveDialog<'a> {
    pub title: &'a str,
    pub kinds: &'a [&'a str],
    pub path: &'a Path,
}
