//! Interactive viewer: presses on, pulls, cuts and renders a body in a window.
//!
//! The open document is the text of a scene ([`document`]). A background task builds the body from
//! it ([`loading`], [`body_session`]). The CPU engine steps the body on a separate thread, while the
//! interface ([`app`]) renders it ([`screen`]) into its own frame on the same device. Every edit
//! changes the scene text, so that edits can be undone and saved, and is then applied to the body.

pub mod app;
mod blit;
pub mod body_edits;
pub mod body_session;
pub mod camera_control;
mod device;
pub mod document;
mod editing;
pub mod examples;
mod frames;
mod handles;
mod histogram;
pub mod loading;
pub mod log;
mod menu;
mod open;
mod panel;
mod path_prompt;
mod picture;
mod platform;
mod pointer_tool;
mod probe;
#[cfg(not(target_arch = "wasm32"))]
mod recording;
mod save;
pub mod screen;
mod section;
pub mod series;
pub mod settings;
#[cfg(not(target_arch = "wasm32"))]
mod ui_cache;
mod viewport;
#[cfg(target_arch = "wasm32")]
pub mod web;
#[cfg(not(target_arch = "wasm32"))]
mod window;

pub use app::{InitialFile, Options};
#[cfg(not(target_arch = "wasm32"))]
pub use window::run;
