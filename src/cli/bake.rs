//! `palpate bake COARSE FINE`: bakes the normal map of a fine surface for a coarse one.

use super::mesh::write_report;
use super::{Outcome, flag_values, print_json, print_notes};
use clap::Args;
use palpate::mesh::TriMesh;
use palpate::skin::{self, BakeReport};
use palpate::{Error, io};
use std::path::{Path, PathBuf};

/// Arguments of `bake`.
#[derive(Args)]
pub struct BakeArguments {
    /// Coarse surface, with texture coordinates (.obj, .ply, .vtk)
    coarse: PathBuf,
    /// Fine surface, in the same position and unit (.obj, .ply, .stl, .vtk)
    fine: PathBuf,
    /// Write the normal map to this file (.png)
    #[arg(long, short)]
    out: PathBuf,
    /// Set the size of the normal map in texels, WIDTHxHEIGHT
    #[arg(long, default_value = "1024x1024", value_parser = flag_values::size)]
    size: [u32; 2],
    /// Write the coverage report as JSON
    #[arg(long)]
    report: Option<PathBuf>,
    /// Print the report on standard output as JSON
    #[arg(long)]
    json: bool,
}

/// Bakes the normal map and writes it.
pub fn run(arguments: &BakeArguments) -> anyhow::Result<Outcome> {
    let is_png = |path: &Path| {
        path.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("png"))
    };
    if !is_png(&arguments.out) {
        anyhow::bail!(
            "{}: the normal map must have the extension .png",
            arguments.out.display()
        );
    }
    let (coarse, fine) = (read(&arguments.coarse)?, read(&arguments.fine)?);
    let (map, report) = skin::bake(&coarse, &fine, arguments.size).map_err(|e| {
        let (coarse, fine) = (arguments.coarse.display(), arguments.fine.display());
        anyhow::anyhow!("{coarse} from {fine}: {e}")
    })?;
    map.save(&arguments.out)?;
    if let Some(path) = &arguments.report {
        write_report(path, &report)?;
    }
    print_notes(&notes(&report));
    if arguments.json {
        print_json(&report)?;
    }
    Ok(Outcome::Done)
}

fn read(path: &Path) -> palpate::Result<TriMesh> {
    if io::detect_kind(path)? != io::Kind::Surface {
        return Err(Error::format(
            path,
            "is not a surface; extract one from a volume or a tet mesh with `palpate mesh`",
        ));
    }
    let surface = io::read_surface(path)?;
    print_notes(&surface.notes);
    Ok(surface)
}

/// Returns the warnings of a bake, one sentence each.
fn notes(report: &BakeReport) -> Vec<String> {
    let mut notes = Vec::new();
    if report.covered == 0 {
        notes.push("the surface covers no texel, so the map is flat".to_owned());
    }
    if report.missed > 0 {
        notes.push(format!(
            "{} of {} texels do not face the fine surface and use its nearest point; check that both surfaces have the same position",
            report.missed, report.covered
        ));
    }
    if report.unmapped > 0 {
        notes.push(format!(
            "{} triangles have zero area in texture coordinates",
            report.unmapped
        ));
    }
    notes
}
