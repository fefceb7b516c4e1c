//! Studies: accuracy against speed, stability limits, cost against size.
//!
//! A study measures points, each with all of its settings, into one CSV that a later run resumes,
//! draws charts of them, and summarises the findings in a paragraph.

mod axis;
mod bodies;
mod cages;
mod chart;
mod csv_table;
mod lumps;
mod motion;
mod pictures;
pub mod reference_motion;
mod run;
mod scaling;
mod scan;
mod stability;
mod state_map;
pub mod static_equilibrium;

pub use axis::Axis;
pub use chart::{Chart, Series, SeriesStyle};
pub use csv_table::{Cell, Row};
pub use run::Run;
pub use scaling::computed_bytes;
pub use state_map::StateMap;

use crate::Result;
use std::path::Path;

/// A study: measures, draws charts and reports; optionally on the user's scene.
pub type Study = fn(&Run, Option<&Path>) -> Result<()>;

/// The studies: command-line name, one-line description, function.
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
    (
        "pictures",
        "Error of pictures against time a frame: tables, samples, early stop, resolution",
        pictures::run,
    ),
    (
        "scaling",
        "Time and memory against tets, pixels, layers and texels, by the GPU and its twin",
        scaling::run,
    ),
    (
        "cages",
        "Coarse bodies that carry a fine mesh: error and time against their nodes",
        cages::run,
    ),
    (
        "lumps",
        "Which lumps a map of presses finds, by their size, depth and contrast",
        lumps::run,
    ),
    (
        "scan",
        "A scan in coarse cages beside its values at the nodes of fine meshes: error, time and tets",
        scan::run,
    ),
    ("accuracy", "Both motion and pictures", accuracy),
];

/// Runs the accuracy studies: error against cost, of motion, then of images.
fn accuracy(run: &Run, scene: Option<&Path>) -> Result<()> {
    motion::run(run, scene)?;
    pictures::run(run, scene)
}
