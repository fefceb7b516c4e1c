//! `palpate bake COARSE FINE`: bakes the normal map of a fine surface for a coarse one.

use super::mesh::write_report;
use super::{Outcome, flags, print_json, print_notes};
use clap::Args;
use palpate::mesh::TriMesh;
use palpate::skin::{self, BakeReport};
use palpate::{Error, io};
use std::path::{Path, PathBuf};

/// Arguments of `bake`.
#[derive(Args)]
pub struct BakeArguments {
    /// The coarse surface, with texture coordinates (.obj, .ply, .vtk)
    coarse: PathBuf,
    /// The fine surface, in the same place and unit (.obj, .ply, .stl, .vtk)
    fine: PathBuf,
    /// The normal map (.png)
    #[arg(long, short)]
    out: PathBuf,
    /// Its size in texels, WIDTHxHEIGHT
    #[arg(long, default_value = "1024x1024", value_parser = flags::size)]
    size: [u32; 2],
    /// Write how much was covered and met as JSON
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
            "{}: a normal map is written as a PNG; name it .png",
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
            "is no surface; `palpate mesh` makes one of a volume or a tet mesh",
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
        notes.push("the surface covers no texel: the map is flat".to_owned());
    }
    if report.missed > 0 {
        notes.push(format!(
            "{} of {} texels do not face the fine surface and show its nearest point; are both surfaces in one place?",
            report.missed, report.covered
        ));
    }
    if report.unmapped > 0 {
        notes.push(format!(
            "{} triangles have no area in the texture",
            report.unmapped
        ));
    }
    notes
}
