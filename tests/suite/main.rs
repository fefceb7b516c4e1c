//! All tests of the library and of the command line, in one program: it is linked once, and its
//! tests share one device. `cargo test --test suite render::` runs those of one module.
#![allow(clippy::unwrap_used, missing_docs)]

mod annotate;
mod architecture;
mod cage;
mod cases;
mod cli;
mod generate;
mod gpu;
mod io;
mod mesh;
mod mesher;
mod meshing;
mod physics;
mod press;
mod render;
mod scene_bodies;
mod scene_carried;
mod scene_contact;
mod scene_fields;
mod scene_loads;
mod scene_pieces;
mod scene_reactions;
mod scene_scan;
mod scene_tools;
mod scene_window;
mod scenes;
mod sizes;
mod skin;
mod study;
mod support;
mod tint;
mod tune;
mod unprepared;
mod warp;
mod wrong_scenes;
