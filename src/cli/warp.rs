//! `palpate warp`: warps a scan by the deformation of a body, and writes the displacement field.

use super::{Outcome, driver, print_json, print_notes, progress};
use clap::Args;
use glam::DVec3;
use palpate::io;
use palpate::mesh::TetMesh;
use palpate::scene::{PlannedRun, Scene, Stage};
use palpate::warp::{Coverage, Warp, WarpFiles, WarpOptions, WarpReport};
use palpate::{Error, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Unit of scans in metres.
const MILLIMETRE: f64 = 1e-3;

/// Arguments of `warp`.
#[derive(Args)]
pub struct WarpArguments {
    /// Scan of the body at rest (.nii, .nii.gz, .hdr with .img, .nrrd, .nhdr, .mhd, .mha, .mgz, DICOM:
    /// a file or a folder of slices)
    scan: PathBuf,
    /// Select one of several volumes in the scan (times, echoes, components), counted from 0
    #[arg(long, value_name = "K")]
    volume: Option<usize>,
    /// Set the mesh at rest, in the scan's world coordinates (RAS; in mm, or the unit in its file), as
    /// made from the scan by `palpate mesh` [default: the mesh of the scene]
    #[arg(long, value_name = "REST")]
    mesh: Option<PathBuf>,
    /// Set the deformed body: the same mesh with displaced nodes, or a scene (.toml), which is
    /// simulated as for a picture
    #[arg(long, value_name = "BENT")]
    to: PathBuf,
    /// Set the number of steps of the scene [default: the scene's, or 50]
    #[arg(long)]
    steps: Option<u32>,

    /// Write the scan warped to the deformed body (.nii.gz, .nrrd, .mha), in the scan's number type
    #[arg(long, short, required_unless_present_any = ["displacement", "inverse"])]
    out: Option<PathBuf>,
    /// Write the displacement from rest to deformed, on the scan's grid: vectors in mm, LPS (ITK)
    #[arg(long, value_name = "FIELD")]
    displacement: Option<PathBuf>,
    /// Write the displacement from deformed to rest, on the grid of the output: the field with which
    /// ITK resamples the scan to the deformed body
    #[arg(long, value_name = "FIELD")]
    inverse: Option<PathBuf>,
    /// Treat voxels as labels: sample by nearest neighbour, without interpolation
    #[arg(long)]
    labels: bool,
    /// Use the grid of this volume for the output [default: the scan's]
    #[arg(long, value_name = "VOLUME")]
    like: Option<PathBuf>,
    /// Set the value outside the mesh, in the scan's unit [default: the scan's smallest; 0 for labels]
    #[arg(long, value_name = "VALUE", allow_hyphen_values = true)]
    background: Option<f64>,
    /// Print the report on standard output as JSON
    #[arg(long)]
    json: bool,
}

/// Warps the scan by the deformation of the body.
pub fn run(adapter: Option<&str>, arguments: &WarpArguments) -> anyhow::Result<Outcome> {
    let files = WarpFiles {
        image: arguments.out.as_deref(),
        displacement: arguments.displacement.as_deref(),
        inverse: arguments.inverse.as_deref(),
    };
    files.check()?;
    let is_scene = is_scene(&arguments.to);
    if !is_scene && arguments.steps.is_some() {
        anyhow::bail!("--steps requires a scene; remove it for a deformed mesh");
    }
    let scan = progress::with_message("reading", || {
        io::read_volume_number(&arguments.scan, arguments.volume)
    })?;
    print_notes(&scan.notes);
    let grid = match &arguments.like {
        // Several volumes have one grid.
        Some(path) => io::read_volume_number(path, Some(0))?.grid(),
        None => scan.grid(),
    };
    let rest = arguments.mesh.as_deref().map(read).transpose()?;
    let (rest, bent) = match is_scene {
        true => meshes_from_scene(adapter, arguments, rest)?,
        false => {
            let rest = rest.ok_or_else(|| {
                Error::Input(
                    "the mesh at rest is missing; set --mesh REST (only a scene provides its own)"
                        .into(),
                )
            })?;
            let mut bent = read(&arguments.to)?;
            // If only one of them has a unit, it applies to both.
            let unit = bent.length_unit.or(rest.length_unit);
            bent.length_unit = unit;
            let length_unit = rest.length_unit.or(unit);
            (
                TetMesh {
                    length_unit,
                    ..rest
                },
                bent,
            )
        }
    };
    let wrong = |e: Error| Error::format(&arguments.to, e.to_string());
    bent.check_same_connectivity(&rest).map_err(wrong)?;
    let (rest, bent) = (in_mm(rest)?, in_mm(bent)?.nodes);
    let warp = Warp::new(&rest, &bent)?;
    let options = WarpOptions {
        labels: arguments.labels,
        background: arguments.background,
    };
    let report = progress::with_stages(|on_progress| {
        // The command line does not cancel.
        let mut planes = |done: usize, all: usize| {
            let _ = on_progress("warping", done as f64 / all as f64);
        };
        warp.write(&scan, &grid, &options, &files, &mut planes)
    })?;
    print_notes(&report_notes(&report, rest.tets.len()));
    if arguments.json {
        print_json(&json!({
            "tets": rest.tets.len(),
            "inverted": report.inverted,
            "bent": report.bent.as_ref().map(coverage),
            "rest": report.rest.as_ref().map(coverage),
        }))?;
    }
    Ok(Outcome::Done)
}

/// Whether `path` is a scene file.
pub(super) fn is_scene(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

fn read(path: &Path) -> Result<TetMesh> {
    let mesh = io::read(path)?;
    print_notes(&mesh.repairs.warnings);
    Ok(mesh)
}

/// Returns the rest mesh, `given` or the scene's, and the deformed mesh.
fn meshes_from_scene(
    adapter: Option<&str>,
    arguments: &WarpArguments,
    given: Option<TetMesh>,
) -> anyhow::Result<(TetMesh, TetMesh)> {
    let mut scene = Scene::read(&arguments.to)?;
    let unit = scene.mesh.unit.as_ref().map(|u| u.metres()).transpose()?;
    scene.solver.steps = arguments.steps.or(scene.solver.steps);
    scene.solver.run = Some(PlannedRun {
        steps: scene.solver.steps.unwrap_or(PlannedRun::DEFAULT_STEPS),
        draws_frames: false,
    });
    let gpu = driver::gpu(adapter)?;
    let mut stage = progress::with_message("preparing", || Stage::new(&gpu, &scene))?;
    print_notes(stage.notes());
    if stage.motion().is_none() {
        anyhow::bail!(
            "{}: the scene is static, so it has no deformation; set a solver ([solver] name = \"implicit\")",
            arguments.to.display()
        );
    }
    let steps = stage.steps();
    progress::with_bar("steps", u64::from(steps), |bar| {
        progress::run(&mut stage, steps, &mut |done, iterations| {
            bar.set_position(u64::from(done));
            bar.detail(progress::iterations(iterations));
        })
    })?;
    let mut bent = stage.deformed_mesh()?;
    bent.length_unit = unit.or(bent.length_unit);
    let rest = match given {
        Some(given) => {
            bent.length_unit = bent.length_unit.or(given.length_unit);
            let length_unit = given.length_unit.or(bent.length_unit);
            TetMesh {
                length_unit,
                ..given
            }
        }
        None => TetMesh {
            length_unit: bent.length_unit,
            ..stage.mesh().clone()
        },
    };
    Ok((rest, bent))
}

/// Converts the mesh to mm, the unit of scans; one without a unit is in mm.
fn in_mm(mut mesh: TetMesh) -> Result<TetMesh> {
    let factor = mesh.length_unit.map_or(1.0, |unit| unit / MILLIMETRE);
    if !(factor > 0.0 && factor.is_finite()) {
        return Err(Error::Mesh(format!(
            "the length unit of the mesh must be positive and finite, got {factor} mm; write the mesh in mm"
        )));
    }
    if (factor - 1.0).abs() > 1e-9 {
        let scale = |p: &mut DVec3| *p *= factor;
        mesh.nodes.iter_mut().for_each(scale);
    }
    Ok(mesh)
}

/// Formats the voxel coverage of a body for the report.
fn coverage(of: &Coverage) -> Value {
    json!({
        "voxels": of.voxels,
        "uncovered": of.uncovered,
        "overlapping": of.overlapping,
        "beyond": of.beyond,
    })
}

/// Returns the warnings of a warp.
fn report_notes(report: &WarpReport, tets: usize) -> Vec<String> {
    let mut lines = Vec::new();
    let share = |n: usize, of: &Coverage| 100.0 * n as f64 / of.voxels.max(1) as f64;
    if let Some(bent) = &report.bent {
        let [uncovered, overlapping] = [bent.uncovered, bent.overlapping];
        lines.push(format!(
            "{uncovered} voxels ({:.1} %) are outside all tets and set to background; {overlapping} voxels are inside more than one tet; {} of {tets} tets are inverted in the deformed mesh",
            share(uncovered, bent),
            report.inverted
        ));
        if bent.beyond > 0 {
            lines.push(format!(
                "{} voxels ({:.1} %) are inside the body but outside the scan, and set to background",
                bent.beyond,
                share(bent.beyond, bent)
            ));
        }
        if overlapping > 0 {
            lines.push("the deformed body intersects itself; voxels in overlapping tets take the value of the first tet in the file".into());
        }
    }
    if let Some(rest) = &report.rest {
        lines.push(format!(
            "{} voxels ({:.1} %) of the scan are outside all tets at rest and are not moved",
            rest.uncovered,
            share(rest.uncovered, rest)
        ));
    }
    if report.inverted > 0 {
        lines.push("inverted tets are not sampled, because the body is crushed there; try smaller steps or a smaller load".into());
    }
    lines
}
