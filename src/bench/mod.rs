//! `palpate bench`: the measurements of docs/performance/ on any machine, as one report.
//!
//! A [`Part`] is a list of cases, each measured separately. [`run_part`] measures the cases of a
//! part in this process; [`measure_all`] starts a process for each part and collects the rows into
//! a [`Report`], so that a crash or a lost device costs the row of one case.

mod case;
mod charts;
mod cuts;
mod elements;
mod golden;
mod grids;
mod large;
mod machine;
mod memory;
mod page;
mod raycast;
mod report;
mod row;
mod scans;
mod skins;
mod steps;
mod supervise;
mod timing;
mod tools;

pub(crate) use case::Message;
pub use case::{Case, Context, run_part};
pub use golden::{GOLDEN_PICTURES, golden_picture};
pub use machine::Machine;
pub use report::{Reference, Report};
pub use row::{Outcome, Row};
pub use supervise::{Supervision, measure_all};
pub(crate) use timing::Spread;
pub use timing::Timing;

pub use crate::study::hold_one_end;

use crate::{Error, Result};

/// A part of the benchmark.
#[derive(Debug)]
pub struct Part {
    /// Its name on the command line.
    pub name: &'static str,
    /// Its heading.
    pub title: &'static str,
    /// What is measured, in a paragraph.
    pub about: &'static str,
    /// Whether each case needs a process of its own, because it reports the memory of the process.
    pub separate: bool,
    /// Returns the cases; fewer and smaller ones for a quick look.
    pub cases: fn(quick: bool) -> Vec<Case>,
}

/// The name of the part with the golden comparisons, which always runs first.
pub const GOLDEN: &str = "golden";

/// The parts in the order of the report.
pub const PARTS: &[Part] = &[
    Part {
        name: GOLDEN,
        title: "Golden comparisons",
        about: golden::ABOUT,
        separate: false,
        cases: golden::cases,
    },
    Part {
        name: "steps",
        title: "Steps and pictures a second, as in Tejada & Ertl",
        about: steps::ABOUT,
        separate: false,
        cases: steps::cases,
    },
    Part {
        name: "grids",
        title: "Grid bodies, as in Mosegaard, Herborg & Sørensen",
        about: grids::ABOUT,
        separate: false,
        cases: grids::cases,
    },
    Part {
        name: "raycast",
        title: "Raycaster",
        about: raycast::ABOUT,
        separate: false,
        cases: raycast::cases,
    },
    Part {
        name: "elements",
        title: "Finite elements",
        about: elements::ABOUT,
        separate: false,
        cases: elements::cases,
    },
    Part {
        name: "tools",
        title: "Contact with a tool",
        about: tools::ABOUT,
        separate: false,
        cases: tools::cases,
    },
    Part {
        name: "cuts",
        title: "Cuts",
        about: cuts::ABOUT,
        separate: false,
        cases: cuts::cases,
    },
    Part {
        name: "skins",
        title: "Skins, as in Mosegaard & Sørensen",
        about: skins::ABOUT,
        separate: false,
        cases: skins::cases,
    },
    Part {
        name: "scans",
        title: "Scans in a bent body",
        about: scans::ABOUT,
        separate: false,
        cases: scans::cases,
    },
    Part {
        name: "memory",
        title: "Memory on the device",
        about: memory::ABOUT,
        separate: false,
        cases: memory::cases,
    },
    Part {
        name: "large",
        title: "From a mesh to its first picture",
        about: large::ABOUT,
        separate: true,
        cases: large::cases,
    },
];

/// Returns the part of that name.
///
/// # Errors
/// [`Error::Input`] with the names of all parts if there is none.
pub fn part(name: &str) -> Result<&'static Part> {
    PARTS.iter().find(|part| part.name == name).ok_or_else(|| {
        let names: Vec<&str> = PARTS.iter().map(|part| part.name).collect();
        Error::Input(format!(
            "there is no part \"{name}\" of the benchmark; choose among {}",
            names.join(", ")
        ))
    })
}
