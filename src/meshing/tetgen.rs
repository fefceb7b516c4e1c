//! Meshing of closed surfaces by the installed program TetGen.
//!
//! TetGen (Hang Si, *TetGen, a Delaunay-based quality tetrahedral mesh generator*, 2015) preserves
//! the triangles of the surface, subdivided where necessary. It is licensed under the AGPL, so it
//! runs as a separate program and is not linked.

use crate::io;
use crate::mesh::{Location, TetMesh, TriMesh};
use crate::mesher::{
    ClosedSurface, Domain, MeshReport, MeshedDomain, Spacing, SurfaceDomain, find_spacing,
};
use crate::progress::ProgressScope;
use crate::{Error, ProgressFn, Result};
use glam::DVec3;
use std::collections::{BTreeMap, HashMap};
use std::ffi::OsStr;
use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// The program's name.
const PROGRAM: &str = "tetgen";

/// Maximum ratio of a tet's circumradius to its shortest edge, and target minimum dihedral angle in
/// degrees.
const QUALITY_SWITCH: &str = "q1.4/10";

/// Maximum volume of a tet relative to a regular one of the target edge.
const MAX_VOLUME_RATIO: f64 = 1.2;

/// Relative tolerance of the number of tets.
const TOLERANCE: f64 = 0.15;

/// Interval of the checks for the end of the program and for cancellation.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// Maximum length of the program's output quoted in an error, in characters.
const MAX_STDERR_CHARS: usize = 400;

/// Meshes closed surfaces by running the installed program `tetgen`.
///
/// Region n + 1 is the inside of surface n without that of later surfaces, which may lie inside
/// earlier ones but not cross them; cavities are components that face inward. `spacing` bounds the
/// volume of tets, or is searched for the target number of tets; the triangles of the surfaces
/// limit the minimum number.
///
/// # Errors
/// An [`Error::Input`] if the program is not installed, rejects the surfaces (those with
/// self-intersections), or cannot meet the target number within 15 %; an [`Error::Mesh`] for
/// surfaces without an inside; an [`Error::Io`] if no temporary folder can be written.
pub fn tetgen(
    surfaces: &[TriMesh],
    spacing: Spacing,
    progress: ProgressFn,
) -> Result<MeshedDomain> {
    run(PROGRAM.as_ref(), surfaces, spacing, progress)
}

fn run(
    program: &OsStr,
    surfaces: &[TriMesh],
    spacing: Spacing,
    progress: ProgressFn,
) -> Result<MeshedDomain> {
    if let Spacing::Edge(edge) = spacing
        && !(edge.is_finite() && edge > 0.0)
    {
        return Err(Error::Input(format!(
            "edge length must be finite and positive, got {edge}"
        )));
    }
    let closed = surfaces.iter().map(ClosedSurface::new);
    let regions = SurfaceDomain::new(closed.collect::<Result<_>>()?)?;
    let folder = tempfile::tempdir().map_err(Error::io(std::env::temp_dir()))?;
    let file = folder.path().join("surface.smesh");
    write_complex(surfaces, &file).map_err(Error::io(&file))?;
    let job = Job {
        program,
        folder: folder.path(),
        regions: &regions,
        progress,
    };
    let filling = match spacing {
        Spacing::Edge(edge) => job.fill(Some(edge))?,
        Spacing::Tets(wanted) => job.about(wanted)?,
    };
    ProgressScope::begin(progress, "done", 1.0)?;
    Ok(filling)
}

/// Writes the surfaces as one piecewise linear complex; coincident vertices are merged.
fn write_complex(surfaces: &[TriMesh], file: &Path) -> std::io::Result<()> {
    let mut numbers: HashMap<[u64; 3], usize> = HashMap::new();
    let mut places = Vec::new();
    let mut triangles = Vec::new();
    for surface in surfaces {
        for triangle in &surface.triangles {
            triangles.push(triangle.map(|v| {
                let place = surface.vertices[v as usize];
                let next = places.len();
                let key = place.to_array().map(f64::to_bits);
                let number = *numbers.entry(key).or_insert(next);
                if number == next {
                    places.push(place);
                }
                number
            }));
        }
    }
    let mut file = std::io::BufWriter::new(File::create(file)?);
    writeln!(file, "{} 3 0 0", places.len())?;
    for (n, p) in places.iter().enumerate() {
        writeln!(file, "{n} {:e} {:e} {:e}", p.x, p.y, p.z)?;
    }
    writeln!(file, "{} 0", triangles.len())?;
    for [a, b, c] in &triangles {
        writeln!(file, "3 {a} {b} {c}")?;
    }
    // No holes, no regions: regions are assigned afterwards.
    writeln!(file, "0\n0")?;
    file.flush()
}

/// A folder with a surface that can be meshed repeatedly.
struct Job<'a> {
    program: &'a OsStr,
    folder: &'a Path,
    regions: &'a SurfaceDomain,
    progress: ProgressFn<'a>,
}

impl Job<'_> {
    /// Meshes with edges of about that length, or with the fewest tets.
    fn fill(&self, edge: Option<f64>) -> Result<MeshedDomain> {
        let mut report = MeshReport::start(edge.unwrap_or(0.0));
        let part = ProgressScope::begin(self.progress, "TetGen", 0.1)?;
        let mut switches = format!("-p{QUALITY_SWITCH}AF");
        if let Some(edge) = edge {
            let volume = MAX_VOLUME_RATIO * edge.powi(3) / (6.0 * 2f64.sqrt());
            switches += &format!("a{volume:e}");
        }
        // A failed run must not be mistaken for the previous one.
        let elements = self.folder.join("surface.1.ele");
        if elements.exists() {
            std::fs::remove_file(&elements).map_err(Error::io(&elements))?;
        }
        let output = self.output(&switches, &part)?;
        if !output.status.success() || !elements.exists() {
            return Err(self.refused(&output));
        }
        let mesh = io::read(&elements)?;
        if edge.is_none() {
            report.edge = mean_edge(&mesh);
        }
        report.stage("TetGen");
        sorted(mesh, self.regions, report)
    }

    /// Runs the program and returns its output; a cancelled run is killed.
    fn output(&self, switches: &str, part: &ProgressScope) -> Result<Output> {
        // Output goes to files, so that no reader is needed while it runs.
        let create = |name: &str| {
            let file = self.folder.join(name);
            let made = File::create(&file).map_err(Error::io(&file))?;
            Ok((file, made))
        };
        let ((out, stdout), (err, stderr)) = (create("stdout")?, create("stderr")?);
        let mut run = Command::new(self.program)
            .args([switches, "surface.smesh"])
            .current_dir(self.folder)
            .stdin(Stdio::null())
            .stdout(stdout)
            .stderr(stderr)
            .spawn()
            .map_err(|e| not_started(self.program, &e))?;
        let status = loop {
            if let Some(status) = run.try_wait().map_err(Error::io(self.folder))? {
                break status;
            }
            if let Err(why) = part.check_cancelled() {
                // It may have ended just now.
                let _ = run.kill();
                let _ = run.wait();
                return Err(why);
            }
            std::thread::sleep(POLL_INTERVAL);
        };
        let read = |file: &Path| std::fs::read(file).map_err(Error::io(file));
        Ok(Output {
            status,
            stdout: read(&out)?,
            stderr: read(&err)?,
        })
    }

    /// Returns the error for a failed run.
    fn refused(&self, output: &Output) -> Error {
        // TetGen aborts without a usable message; a second run detects self-intersections.
        let crossings = Command::new(self.program)
            .args(["-d", "surface.smesh"])
            .current_dir(self.folder)
            .output()
            .ok()
            .and_then(|output| {
                let report = String::from_utf8_lossy(&output.stdout).into_owned();
                let line = report.lines().find_map(|l| l.trim().strip_prefix("!!"))?;
                Some(line.trim().to_owned())
            });
        let words = crossings.unwrap_or_else(|| last_words(output));
        Error::Input(format!(
            "TetGen failed on the surface ({}): {words} TetGen rejects surfaces that intersect \
            themselves or each other; use the lattice mesher (--with lattice)",
            output.status
        ))
    }

    /// Meshes with about `wanted` tets.
    fn about(&self, wanted: usize) -> Result<MeshedDomain> {
        let within = |filling: &MeshedDomain| {
            let made = filling.tets.len() as f64;
            (made / wanted as f64 - 1.0).abs() <= TOLERANCE
        };
        let fewest = self.fill(None)?;
        if within(&fewest) {
            return Ok(fewest);
        }
        if fewest.tets.len() > wanted {
            return Err(Error::Input(format!(
                "TetGen keeps the triangles of the surface and generates at least {} tets, more \
                than the requested {wanted}; increase the number, or use the lattice mesher \
                (--with lattice)",
                fewest.tets.len()
            )));
        }
        let (low, high) = self.regions.bounds();
        let volume = (high - low).to_array().iter().product();
        let trial = |edge| self.fill(Some(edge));
        let counts = |filling: &MeshedDomain| [filling.tets.len(); 2];
        let filling = find_spacing(wanted, volume, false, trial, counts)?;
        match within(&filling) {
            true => Ok(filling),
            false => Err(Error::Input(format!(
                "TetGen cannot generate about {wanted} tets, the closest is {}; set the edge \
                length instead (--edge)",
                filling.tets.len()
            ))),
        }
    }
}

fn not_started(program: &OsStr, error: &std::io::Error) -> Error {
    let name = program.to_string_lossy();
    Error::Input(match error.kind() {
        std::io::ErrorKind::NotFound => format!(
            "program {name} is not installed; TetGen is a separate program under the AGPL: install \
            it with apt install tetgen (Debian, Ubuntu) or brew install tetgen (macOS), or use the \
            lattice mesher (--with lattice)"
        ),
        _ => format!("cannot run program {name}: {error}"),
    })
}

/// Returns the end of the program's output, on one line.
fn last_words(output: &Output) -> String {
    let text = [&output.stdout[..], b"\n", &output.stderr].concat();
    let text = String::from_utf8_lossy(&text);
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let from = text.char_indices().rev().nth(MAX_STDERR_CHARS - 1);
    format!("{}.", &text[from.map_or(0, |(n, _)| n)..])
}

/// Sorts tets by region; those in cavities are dropped.
fn sorted(mesh: TetMesh, regions: &SurfaceDomain, report: MeshReport) -> Result<MeshedDomain> {
    // TetGen numbers the parts into which the surfaces divide space: the largest tet of a part
    // determines its region. A single part may have no number.
    let part = mesh.field("tetgen:ref", Location::Cell);
    let part = |t: usize| part.map_or(0, |f| f.values[t] as i64);
    let mut largest: BTreeMap<i64, (f64, usize)> = BTreeMap::new();
    for t in 0..mesh.tets.len() {
        let volume = mesh.tet_volume(t);
        let entry = largest.entry(part(t)).or_insert((volume, t));
        if volume > entry.0 {
            *entry = (volume, t);
        }
    }
    let region_of: BTreeMap<i64, u16> = largest
        .iter()
        .map(|(part, (_, t))| {
            let middle = mesh.tet_nodes(*t).iter().sum::<DVec3>() / 4.0;
            let holds = |s: &ClosedSurface| s.is_inside(middle);
            let last = regions.surfaces().iter().rposition(holds);
            (*part, last.map_or(0, |n| n as u16 + 1))
        })
        .collect();
    let pieces = mesh.tets.iter().enumerate();
    let pieces = pieces.map(|(t, tet)| (*tet, region_of[&part(t)])).collect();
    let mut filled = MeshedDomain::from_pieces(mesh.nodes, pieces, report)?;
    filled.measure_surface_distance(regions);
    Ok(filled)
}

/// Returns the mean edge length of the tets.
fn mean_edge(mesh: &TetMesh) -> f64 {
    let edges = mesh.edges();
    let length = |[a, b]: &[u32; 2]| mesh.nodes[*a as usize].distance(mesh.nodes[*b as usize]);
    edges.iter().map(length).sum::<f64>() / edges.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_tetgen_is_reported_with_install_command() {
        let corner = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let surface = TriMesh {
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
            triangles: corner.to_vec(),
            ..TriMesh::default()
        };
        let name = OsStr::new("no-such-tetgen");
        let result = run(name, &[surface], Spacing::Edge(1.0), &crate::no_progress);
        let said = result.map(|_| ()).map_err(|e| e.to_string());
        let expected = [
            "no-such-tetgen is not installed",
            "AGPL",
            "apt install tetgen",
            "brew",
        ];
        assert!(
            expected
                .iter()
                .all(|e| said.clone().is_err_and(|s| s.contains(e))),
            "{said:?}"
        );
    }
}
