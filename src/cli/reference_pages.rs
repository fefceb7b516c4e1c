//! The pages of the book that follow from the code: tables of scene files, and commands.

mod bodies;
mod commands;
mod scenes;

pub use bodies::of_bodies;
pub use commands::of_commands;
pub use scenes::of_scenes;

/// First line of a generated page.
const GENERATED: &str =
    "<!-- Written by `palpate schema --pages docs/reference`; change the source instead. -->\n";
