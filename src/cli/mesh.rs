//! `palpate mesh`: meshes scans, segmentations and surfaces with tets, or extracts surfaces.

use super::convert::format_of;
use super::{Outcome, print_json, print_notes, progress};
use clap::Args;
use palpate::mesh::{AnatomicalFrame, Length, SurfaceDescription};
use palpate::mesher::{MeshReport, ThresholdRange};
use palpate::meshing::{Labels, MeshingConfig, RecipeReport, RegionSummary, TargetSize};
use palpate::number_format::significant;
use palpate::scene::{Unit, write_pieces};
use palpate::{Error, io};
use std::path::{Path, PathBuf};

/// Arguments of `mesh`.
#[derive(Args)]
pub struct MeshArguments {
    /// Volume (.nii, .nii.gz, .hdr with .img, .nrrd, .nhdr, .mhd, .mha, .mgz, DICOM: a file or a folder
    /// of slices), closed surfaces (.stl, .ply, .obj, .vtk; one per region, later ones inside earlier
    /// ones), or, to extract a surface, a tet mesh
    #[arg(required = true)]
    input: Vec<PathBuf>,
    /// Write the mesh (.vtu, .vtk, .msh, .mesh, .node with .ele, .inp; .pvtu with --pieces) or surface
    /// (.ply, .obj, .stl) to this file; a surface is the isosurface of a volume at its full
    /// resolution, or the boundary of the labels of a tet mesh
    #[arg(long, short)]
    out: PathBuf,

    /// Select one of several volumes in the file (times, echoes, components), counted from 0
    #[arg(long, value_name = "K")]
    volume: Option<usize>,

    /// Create regions from labels: all, or a list such as 1,2,5
    #[arg(long, help_heading = "Regions", value_parser = labels)]
    labels: Option<Labels>,
    /// Create a region of the values at or above a threshold: [NAME=]VALUE; repeat it for nested
    /// regions
    #[arg(
        long,
        help_heading = "Regions",
        allow_hyphen_values = true,
        value_name = "[NAME=]VALUE"
    )]
    above: Vec<ThresholdRange>,
    /// Create a region of the values in a range: [NAME=]LOW..HIGH
    #[arg(
        long,
        help_heading = "Regions",
        allow_hyphen_values = true,
        value_name = "[NAME=]LOW..HIGH"
    )]
    between: Vec<ThresholdRange>,
    /// Set the smallest volume of a component of a region that is kept, in cubic units of the input
    /// (mm³ for volumes)
    #[arg(long, help_heading = "Regions")]
    min_island: Option<f64>,

    /// Split the interface of two regions, by name or label: each side gets its own nodes. A split
    /// ends where a third region connects the two. Repeat it for several pairs
    #[arg(long, help_heading = "Regions", value_name = "FIRST:SECOND", value_parser = pair)]
    part: Vec<[String; 2]>,

    /// Set the edge length near boundaries: 2mm, or a number in the unit of the input
    #[arg(long, help_heading = "Size", conflicts_with = "tets")]
    edge: Option<Length>,
    /// Set the approximate number of tets, within 15 % [default: 50000]
    #[arg(long, help_heading = "Size")]
    tets: Option<usize>,
    /// Set the largest ratio of interior to boundary edge length; 1 for uniform edges
    #[arg(long, help_heading = "Size", default_value_t = 8.0)]
    grading: f64,
    /// Set the edge lengths by place, in place of --edge and --grading: a volume of lengths in mm, or a
    /// tet mesh, whose cell field `edge_length` they are, or else those at which its cell field `error`
    /// would be the same in all tets (error.vtu of a press), or else those of its tets; with --tets in
    /// proportion to these
    #[arg(long, help_heading = "Size", value_name = "FILE", conflicts_with_all = ["edge", "grading"])]
    size_field: Option<PathBuf>,
    /// Set the unit of a surface file: m, cm, mm, um, in (volumes are in mm)
    #[arg(long, help_heading = "Size")]
    unit: Option<String>,
    /// Set the frame of reference of surface files that do not state theirs: ras or lps [default:
    /// coordinates are kept; with --intensity, or together with a surface of known frame, lps]
    #[arg(long, help_heading = "Size")]
    frame: Option<AnatomicalFrame>,
    /// Select the mesher: lattice (built in), or tetgen (the installed program, for surfaces)
    #[arg(long, help_heading = "Size", default_value = "lattice")]
    with: String,

    /// Sample a volume at the nodes: [NAME=]FILE; repeat it for several
    #[arg(long, help_heading = "Fields", value_name = "[NAME=]FILE")]
    intensity: Vec<String>,
    /// Set the number of smoothing iterations of an extracted surface
    #[arg(long, help_heading = "Fields", default_value_t = 0)]
    smooth: u32,
    /// Write the mesh in this number of pieces, partitioned by a k-d tree: OUT, a .pvtu, lists
    /// them, and each is a .vtu in its folder that can be rendered separately (docs/how-to/clusters.md)
    #[arg(long, value_name = "N")]
    pieces: Option<usize>,
    /// Write a report of the mesh, its quality and the computing time as JSON
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
        Err(_) => Err("expected \"all\" or integers separated by commas".into()),
    }
}

fn pair(text: &str) -> Result<[String; 2], String> {
    match text.split_once(':') {
        Some((a, b)) if !a.is_empty() && !b.is_empty() => Ok([a.to_owned(), b.to_owned()]),
        _ => Err("expected two regions, FIRST:SECOND".into()),
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
                    "unknown mesher \"{other}\"; use lattice or tetgen"
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
            size_field: self.size_field.clone(),
            min_island: self.min_island,
            number: self.volume,
            unit,
            frame: self.frame,
            meets_scan: false,
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
            let why = "--pieces requires a mesh as output, not a surface";
            return Err(Error::Input(why.into()).into());
        }
        return surface(arguments, &recipe);
    }
    if arguments.smooth > 0 {
        return Err(Error::Input(
            "--smooth requires a surface as output (.ply, .obj, .stl); remove it".into(),
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
        "{} vertices, {} triangles, {}, area {}, volume {}",
        description.vertices,
        description.triangles,
        if description.closed {
            "closed"
        } else {
            "not closed"
        },
        significant(description.area),
        significant(description.volume)
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

/// Returns notes about regions that lose volume: because of the edge length, or of the smoothing of a
/// label map.
fn loss_notes(regions: &[RegionSummary], mesher: &MeshReport) -> Vec<String> {
    let is_resolved = mesher.resolving_edge.is_some_and(|e| mesher.edge <= e);
    let listed = |by_smoothing: bool| {
        let lost = |r: &&RegionSummary| {
            let fraction = r.input_volume.map_or(0.0, |v| 1.0 - r.volume / v);
            fraction > LOST
                && (is_resolved || fraction - r.smoothed_fraction < LOST) == by_smoothing
        };
        let labels = regions.iter().filter(lost).map(|r| r.label.to_string());
        let labels: Vec<String> = labels.collect();
        (!labels.is_empty()).then(|| {
            format!(
                "regions {} lose more than {:.0} % of their volume",
                labels.join(", "),
                100.0 * LOST
            )
        })
    };
    let by_smoothing = listed(true).map(|regions| {
        format!(
            "{regions}: parts one voxel thick are rounded off or lost at any edge length; preserve \
            them by resampling the label map to voxels of half the size"
        )
    });
    let by_edge = listed(false).map(|regions| {
        format!(
            "{regions}: parts are thinner than the edge length {}; --edge {} keeps more of them",
            significant(mesher.edge),
            mesher.finer_edge()
        )
    });
    by_smoothing.into_iter().chain(by_edge).collect()
}

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
                    " ({:+.1} % relative to the input)",
                    100.0 * (region.volume / input - 1.0)
                )
            });
            format!(
                "region {}{name}: {} tets, volume {}{}",
                region.label,
                region.tets,
                significant(region.volume),
                off.unwrap_or_default()
            )
        })
        .collect();
    let Some(mesher) = &report.mesher else {
        return lines;
    };
    lines.extend(loss_notes(&report.regions, mesher));
    let islands: usize = mesher.islands.iter().map(|i| i.islands).sum();
    if islands > 0 {
        let volume: f64 = mesher.islands.iter().map(|i| i.volume).sum();
        lines.push(format!(
            "{islands} islands (total volume {}) were merged into the surrounding regions",
            significant(volume)
        ));
    }
    lines.push(format!(
        "{} tets, {} nodes, edge length {} at boundaries; dihedral angles {:.1}° to {:.1}°, 1 in 100 tets below {:.1}°",
        mesher.tets,
        mesher.nodes,
        significant(mesher.edge),
        mesher.min_dihedral,
        mesher.max_dihedral,
        mesher.first_percentile
    ));
    if let Some([rms, most]) = mesher.surface_distance {
        lines.push(format!(
            "the surface is {} (root mean square), at most {}, from that of the input",
            significant(rms),
            significant(most)
        ));
    }
    let memory = mesher.peak_memory.map_or(String::new(), |bytes| {
        format!(", peak memory {:.0} MB", bytes as f64 / 1e6)
    });
    lines.push(format!("{:.2} s{memory}", report.seconds));
    lines
}
