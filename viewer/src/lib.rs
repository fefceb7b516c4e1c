//! The interactive viewer: a body in a window, to press on, pull, cut and look into.
//!
//! What is open is the text of a scene ([`document`]); of it a body is made ([`loading`], [`body_session`]),
//! which the engine on the CPU steps on a thread of its own while the interface ([`app`]) draws it
//! ([`screen`]) into its own frame, on one device. Who edits the scene edits its text, so that all of
//! it can be undone and saved; the body follows.

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
