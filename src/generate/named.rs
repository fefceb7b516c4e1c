//! Lookup of generators by name, for scenes and the command line.

use super::breast::Breast;
use super::liver::Liver;
use super::lump::organ;
use super::{
    Bore, Lump, PAPER_BAR_SIZE, Split, ball, bar_of_about, benchmark_cube, biceps, box_mesh, duct,
    foot, limb,
};
use crate::mesh::TetMesh;
use crate::{Error, ProgressFn, Result, no_progress};
use glam::DVec3;

/// The names accepted by [`by_name`], with a description of each mesh.
pub const GENERATORS: [(&str, &str); 11] = [
    (
        "bar",
        "the bar of Tejada & Ertl 2005, 12 × 6 × 6 cm; 80 tets",
    ),
    ("box", "a cube of 10 cm in cells of six tets; 6,000 tets"),
    (
        "beam",
        "a beam of 10 × 3 × 3 cm in cells of six tets; 540 tets",
    ),
    ("ball", "a ball of 10 cm; 6,000 tets"),
    (
        "duct",
        "a cube of 10 cm with a round duct through it; 6,000 tets",
    ),
    (
        "cube",
        "the unit cube of the rendering benchmark, with a field; 48,000 tets",
    ),
    (
        "limb",
        "a forearm and hand with seven tissues; 100,000 tets",
    ),
    (
        "biceps",
        "a muscle between two tendons, 24 cm, with its fibres; 8,000 tets",
    ),
    (
        "breast",
        "a breast of fat and gland with a lump, 14 cm wide; 20,000 tets",
    ),
    ("liver", "a liver with a lump, 22 cm wide; 20,000 tets"),
    ("foot", "a foot of 26 bones in flesh; 100,000 tets"),
];

/// Whether the meshes of the generator `name` have a lump.
pub(crate) fn has_lump(name: &str) -> bool {
    matches!(name, "breast" | "liver")
}

/// Checks that there is a generator `name`.
///
/// # Errors
/// An [`Error::Input`] if there is none; the message lists the valid names.
pub(crate) fn check_name(name: &str) -> Result<()> {
    match GENERATORS.iter().any(|g| g.0 == name) {
        true => Ok(()),
        false => Err(unknown(name)),
    }
}

fn unknown(name: &str) -> Error {
    let names: Vec<&str> = GENERATORS.iter().map(|g| g.0).collect();
    Error::Input(format!(
        "unknown generator \"{name}\"; use one of {}",
        names.join(", ")
    ))
}

/// Generates the mesh `name`, one of [`GENERATORS`], with about `tets` tets, or the default number.
///
/// # Errors
/// An error for an unknown name, or a number of tets that the generator cannot make.
pub fn by_name(name: &str, tets: Option<usize>) -> Result<TetMesh> {
    by_name_with_progress(name, tets, Some(Lump::default()), &no_progress)
}

/// As [`by_name`], with the given lump, or none, in organs that have one, and with progress reports
/// for the large ones.
///
/// # Errors
/// As [`by_name`], and an error for a lump that does not fit into the organ.
pub(crate) fn by_name_with_progress(
    name: &str,
    tets: Option<usize>,
    lump: Option<Lump>,
    progress: ProgressFn,
) -> Result<TetMesh> {
    // Number of cells per side for this many tets per cell of the unit cube.
    let side =
        |tets: usize, per_cell: f64| ((tets as f64 / per_cell).cbrt().round() as usize).max(1);
    let size = DVec3::splat(0.1);
    match name {
        "bar" => bar_of_about(tets.unwrap_or(80), PAPER_BAR_SIZE),
        "box" => box_mesh([side(tets.unwrap_or(6_000), 6.0); 3], size, Split::Six),
        "beam" => {
            // Of about cubes: 10/3 as many along as across.
            let across = side(tets.unwrap_or(540), 20.0);
            box_mesh(
                [(across * 10 + 1) / 3, across, across],
                DVec3::new(0.1, 0.03, 0.03),
                Split::Six,
            )
        }
        // A ball fills π/6 of its box, with twelve tets per cell.
        "ball" => ball(0.05, side(tets.unwrap_or(6_000), 6.5).max(2)),
        // Around, out and along: 4n · n/3 · m cells of six tets.
        "duct" => {
            let tets = tets.unwrap_or(6_000);
            let across = 3 * side(tets, 8.0 * 27.0);
            let along = ((tets as f64 / (8 * across * across) as f64).round() as usize).max(1);
            duct([across, across, along], size, Bore::Round)
        }
        "cube" => benchmark_cube(side(tets.unwrap_or(48_000), 6.0), false),
        "limb" => limb::generate_with_progress(tets.unwrap_or(100_000), progress),
        "biceps" => biceps(tets.unwrap_or(8_000)),
        "breast" => organ(Breast, tets.unwrap_or(20_000), lump, progress),
        "liver" => organ(Liver, tets.unwrap_or(20_000), lump, progress),
        "foot" => foot::generate_with_progress(tets.unwrap_or(100_000), progress),
        _ => Err(unknown(name)),
    }
}
