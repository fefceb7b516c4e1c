//! `palpate mesh`: meshes scans, segmentations and surfaces with tets, or extracts surfaces.

use super::convert::format_of;
use super::{Outcome, print_json, print_notes, progress};
use clap::Args;
use palpate::mesh::SurfaceDescription;
use palpate::mesher::{
    Labels, Length, MeshingConfig, RecipeReport, RegionSummary, TargetSize, ThresholdRange,
};
use palpate::scene::{Unit, write_pieces};
use palpate::{Error, io};
use std::path::{Path, PathBuf};

/// Arguments of `mesh`.
#[derive(Args)]
pub struct MeshArguments {
    /// A volume (.nii, .nii.gz, .nrrd, .nhdr, .mhd, .mha, a DICOM folder), closed surfaces (.stl,
    /// .ply, .obj, .vtk; one a region, later ones inside earlier ones), or, for a surface out, a
    /// tet mesh
    #[arg(required = true)]
    input: Vec<PathBuf>,
    /// The mesh (.vtu, .vtk, .msh, .mesh, .node with .ele, .inp; .pvtu with --pieces), or a surface
    /// (.ply, .obj, .stl): the isosurface of a volume at its full resolution, or the boundary of the labels of a tet
    /// mesh
    #[arg(long, short)]
    out: PathBuf,

    /// Regions from labels: all, or a list such as 1,2,5
    #[arg(long, help_heading = "Regions", value_parser = labels)]
    labels: Option<Labels>,
    /// A region of the values from a threshold on: [NAME=]VALUE; repeat it for regions inside
    /// each other
    #[arg(
        long,
        help_heading = "Regions",
        allow_hyphen_values = true,
        value_name = "[NAME=]VALUE"
    )]
    above: Vec<ThresholdRange>,
    /// A region of the values in a range: [NAME=]LOW..HIGH
    #[arg(
        long,
        help_heading = "Regions",
        allow_hyphen_values = true,
        value_name = "[NAME=]LOW..HIGH"
    )]
    between: Vec<ThresholdRange>,
    /// Smallest volume of a piece of a region that is kept, in cubic units of the input (mm³ for
    /// volumes)
    #[arg(long, help_heading = "Regions")]
    min_island: Option<f64>,

    /// Two regions that are parted where they meet, by name or label: each gets nodes of its own
    /// there. A seam ends where a third region holds the two together. Repeat it for several pairs
    #[arg(long, help_heading = "Regions", value_name = "FIRST:SECOND", value_parser = pair)]
    part: Vec<[String; 2]>,

    /// Edge length near boundaries: 2mm, or a number in the unit of the input
    #[arg(long, help_heading = "Size", conflicts_with = "tets")]
    edge: Option<Length>,
    /// About how many tets, within 15 % [default: 50000]
    #[arg(long, help_heading = "Size")]
    tets: Option<usize>,
    /// How many times longer edges may grow away from boundaries; 1 for none
    #[arg(long, help_heading = "Size", default_value_t = 8.0)]
    grading: f64,
    /// The unit of a surface file: m, cm, mm, um, in (volumes are in mm)
    #[arg(long, help_heading = "Size")]
    unit: Option<String>,
    /// lattice (our own), or tetgen: the installed program of that name, on surfaces
    #[arg(long, help_heading = "Size", default_value = "lattice")]
    with: String,

    /// A volume whose values the nodes take: [NAME=]FILE; repeat it for several
    #[arg(long, help_heading = "Fields", value_name = "[NAME=]FILE")]
    intensity: Vec<String>,
    /// Rounds of smoothing of a surface out
    #[arg(long, help_heading = "Fields", default_value_t = 0)]
    smooth: u32,
    /// Write the mesh as so many pieces, cut along a k-d tree: OUT, a .pvtu, lists them, and each is a
    /// .vtu beside it that can be drawn by itself (docs/cluster.md)
    #[arg(long, value_name = "N")]
    pieces: Option<usize>,
    /// Write what was made, how well and how fast as JSON
    #[arg(long)]
    report: Option<PathBuf>,
    /// Print the report on standard output as JSON
    #[arg(long)]
    json: bool,
}

fn labels(text: &str) -> Result<Labels, String> {
    if text.eq_ignore_ascii_case("all") {
        return Ok(Labels::All);
    }
    let numbers: Result<Vec<i64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    match numbers {
        Ok(numbers) => Ok(Labels::These(numbers)),
        Err(_) => Err("\"all\" or whole numbers separated by commas are expected".into()),
    }
}

fn pair(text: &str) -> Result<[String; 2], String> {
    match text.split_once(':') {
        Some((a, b)) if !a.is_empty() && !b.is_empty() => Ok([a.to_owned(), b.to_owned()]),
        _ => Err("two regions are expected, FIRST:SECOND".into()),
    }
}

impl MeshArguments {
    fn recipe(&self) -> palpate::Result<MeshingConfig> {
        let unit = match &self.unit {
            None => None,
            Some(unit) => Some(Unit::Name(unit.clone()).metres()?),
        };
        let tetgen = match self.with.as_str() {
            "lattice" => false,
            "tetgen" => true,
            other => {
                return Err(Error::Input(format!(
                    "there is no mesher \"{other}\"; use lattice or tetgen"
                )));
            }
        };
        let intensities = self
            .intensity
            .iter()
            .map(|text| match text.split_once('=') {
                Some((name, file)) => (name.to_owned(), PathBuf::from(file)),
                None => ("intensity".to_owned(), PathBuf::from(text)),
            });
        Ok(MeshingConfig {
            input: self.input.clone(),
            labels: self.labels.clone(),
            above: self.above.clone(),
            between: self.between.clone(),
            size: match (self.edge, self.tets) {
                (Some(edge), _) => Some(TargetSize::Edge(edge)),
                (None, tets) => tets.map(TargetSize::Tets),
            },
            grading: Some(self.grading),
            min_island: self.min_island,
            unit,
            intensities: intensities.collect(),
            split_interfaces: self.part.clone(),
            tetgen,
        })
    }
}

/// Whether `path` has the extension of a surface format.
pub fn is_surface(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    ["ply", "obj", "stl"].contains(&extension.to_str().unwrap_or(""))
}

/// Generates the mesh or surface and prints a summary.
pub fn run(arguments: &MeshArguments) -> anyhow::Result<Outcome> {
    let recipe = arguments.recipe()?;
    if is_surface(&arguments.out) {
        if arguments.pieces.is_some() {
            let why = "--pieces is for meshes, and a surface is written as one";
            return Err(Error::Input(why.into()).into());
        }
        return surface(arguments, &recipe);
    }
    if arguments.smooth > 0 {
        return Err(Error::Input(
            "--smooth is for surfaces out (.ply, .obj, .stl); the mesher follows its input as it is".into(),
        )
        .into());
    }
    // Checked before the work: the extension must be supported.
    let format = format_of(&arguments.out, arguments.pieces)?;
    let made = progress::with_stages(|progress| recipe.mesh(progress))?;
    let left_out = match (format, arguments.pieces) {
        (None, Some(pieces)) => {
            write_pieces(&arguments.out, &made.mesh, pieces)?;
            Vec::new()
        }
        _ => io::write(&arguments.out, &made.mesh)?,
    };
    print_notes(&made.notes);
    print_notes(&left_out);
    print_notes(&summary(&made.report));
    if let Some(path) = &arguments.report {
        write_report(path, &made.report)?;
    }
    if arguments.json {
        print_json(&made.report)?;
    }
    Ok(Outcome::Done)
}

/// Extracts a surface instead of meshing.
fn surface(arguments: &MeshArguments, recipe: &MeshingConfig) -> anyhow::Result<Outcome> {
    let surface =
        progress::with_stages(|progress| recipe.extract_surface(arguments.smooth, progress))?;
    io::write_surface(&arguments.out, &surface)?;
    let description = SurfaceDescription::new(&surface);
    print_notes(&surface.notes);
    print_notes(&[format!(
        "{} vertices, {} triangles, {}, area {:.1}, volume {:.1}",
        description.vertices,
        description.triangles,
        if description.closed {
            "closed"
        } else {
            "not closed"
        },
        description.area,
        description.volume
    )]);
    if let Some(path) = &arguments.report {
        write_report(path, &description)?;
    }
    if arguments.json {
        print_json(&description)?;
    }
    Ok(Outcome::Done)
}

/// Writes a report as JSON.
pub fn write_report(path: &Path, report: &impl serde::Serialize) -> palpate::Result<()> {
    io::atomic_write(path, |file| {
        serde_json::to_writer_pretty(file, report).map_err(|e| Error::io(path)(e.into()))
    })
}

/// Regions that lose more than this fraction of their volume are reported.
const LOST: f64 = 0.1;

/// Returns a line per region, and the quality.
fn summary(report: &RecipeReport) -> Vec<String> {
    let mut lines: Vec<String> = report
        .regions
        .iter()
        .map(|region| {
            let name = region.name.as_ref();
            let name = name.map_or(String::new(), |name| format!(" {name}"));
            let off = region.input_volume.map(|input| {
                format!(
                    " ({:+.1} % of the input's)",
                    100.0 * (region.volume / input - 1.0)
                )
            });
            format!(
                "region {}{name}: {} tets, volume {:.1}{}",
                region.label,
                region.tets,
                region.volume,
                off.unwrap_or_default()
            )
        })
        .collect();
    let Some(mesher) = &report.mesher else {
        return lines;
    };
    let lost = |r: &&RegionSummary| r.input_volume.is_some_and(|v| r.volume < (1.0 - LOST) * v);
    let thin: Vec<String> = report
        .regions
        .iter()
        .filter(lost)
        .map(|r| r.label.to_string())
        .collect();
    if !thin.is_empty() {
        lines.push(format!(
            "regions {} lose more than {:.0} % of their volume: they are thinner than the edges of {:.3} in places; --edge {:.1} keeps them",
            thin.join(", "), 100.0 * LOST, mesher.edge, 0.5 * mesher.edge
        ));
    }
    let islands: usize = mesher.islands.iter().map(|i| i.islands).sum();
    if islands > 0 {
        let volume: f64 = mesher.islands.iter().map(|i| i.volume).sum();
        lines.push(format!(
            "{islands} islands, {volume:.1} in all, were given to what surrounds them"
        ));
    }
    lines.push(format!(
        "{} tets, {} nodes, edges of {:.3} at boundaries; dihedral angles {:.1}° to {:.1}°, 1 in 100 tets below {:.1}°",
        mesher.tets,
        mesher.nodes,
        mesher.edge,
        mesher.min_dihedral,
        mesher.max_dihedral,
        mesher.first_percentile
    ));
    let memory = mesher.peak_memory.map_or(String::new(), |bytes| {
        format!(", {:.0} MB at most", bytes as f64 / 1e6)
    });
    lines.push(format!("{:.2} s{memory}", report.seconds));
    lines
}
