//! Studies: accuracy charted against speed, stability where methods fail, cost against size.
//!
//! A study measures points, each with all of its settings, into one CSV that a second run goes on
//! from, draws charts of them, and says in a paragraph what was found.

mod chart;
mod motion;
mod run;
mod scale;
mod sheet;
mod stability;
mod state_map;

pub use chart::{Chart, Look, Series};
pub use run::Run;
pub use scale::Axis;
pub use sheet::{Cell, Row};
pub use state_map::StateMap;

use crate::Result;
use std::path::Path;

/// A study: measures, draws and tells, perhaps of a scene of the user's.
pub type Study = fn(&Run, Option<&Path>) -> Result<()>;

/// The studies by their names on the command line, each with a line that says what it is.
pub const STUDIES: &[(&str, &str, Study)] = &[
    (
        "motion",
        "Error of motion against its cost: every solver, step and linear solve, and the model itself",
        motion::run,
    ),
    (
        "stability",
        "Which steps each solver holds at which stiffness, and where methods fail",
        stability::run,
    ),
];
