//! Studies: accuracy against speed, stability limits, cost against size.
//!
//! A study measures points, each with all of its settings, into one CSV that a later run resumes,
//! draws charts of them, and summarises the findings in a paragraph.

mod axis;
mod bodies;
mod cages;
mod chart;
#[cfg(feature = "identify")]
mod coverage;
mod csv_table;
mod elements;
#[cfg(feature = "identify")]
mod lump_intervals;
mod lumps;
mod motion;
mod pareto;
mod peers;
mod pictures;
pub mod reference_motion;
mod refinement;
mod run;
pub(crate) mod scaling;
pub(crate) mod scan;
mod stability;
mod state_map;
pub mod static_equilibrium;
mod trust;

pub use axis::Axis;
pub use bodies::hold_one_end;
pub use chart::{Chart, Series, SeriesStyle};
pub use csv_table::{Cell, Row};
pub use run::Run;
pub use scaling::computed_bytes;
pub use state_map::StateMap;

pub(crate) use peers::{peers_camera, peers_transfer};

use crate::Result;
use std::path::Path;

/// A study: measures, draws charts and reports; optionally on the user's scene.
pub(crate) type Study = fn(&Run, Option<&Path>) -> Result<()>;

/// The studies: command-line name, one-line description, function.
pub const STUDIES: &[(&str, &str, Study)] = &[
    (
        "motion",
        "Motion error against cost: solvers, time steps, linear solves and the model",
        motion::run,
    ),
    (
        "elements",
        "Error of linear and quadratic tets in static equilibrium, against tets, unknowns and time",
        elements::run,
    ),
    (
        "refinement",
        "Meshes refined where they are too coarse against equal tets: error against time",
        refinement::run,
    ),
    (
        "trust",
        "Estimated errors of presses, sags and twists compared with true ones",
        trust::run,
    ),
    (
        "stability",
        "Stable time steps of each solver against stiffness, and failures",
        stability::run,
    ),
    (
        "pictures",
        "Image error against time per frame: tables, samples, early ray termination, resolution",
        pictures::run,
    ),
    (
        "scaling",
        "Time and memory against tets, pixels, layers and texels, on the GPU and by the CPU reference",
        scaling::run,
    ),
    (
        "cages",
        "Error and time of cages that embed a fine mesh, against their number of nodes",
        cages::run,
    ),
    (
        "lumps",
        "Lumps found by stiffness maps, by size, depth and contrast",
        lumps::run,
    ),
    #[cfg(feature = "identify")]
    (
        "lump-intervals",
        "Lumps that a stiffness map determines, by size, depth, contrast and noise",
        lump_intervals::run,
    ),
    #[cfg(feature = "identify")]
    (
        "coverage",
        "Intervals of identified moduli, of 100 twins with noise, that hold the true ones",
        coverage::run,
    ),
    (
        "scan",
        "Scan in coarse cages compared with nodal values of fine meshes: error, time and tets",
        scan::run,
    ),
    (
        "accuracy",
        "Both the motion and the pictures study",
        accuracy,
    ),
];

/// Runs the accuracy studies: error against cost, of motion, then of images.
fn accuracy(run: &Run, scene: Option<&Path>) -> Result<()> {
    motion::run(run, scene)?;
    pictures::run(run, scene)
}
