//! Tets from closed surfaces by the installed program TetGen.
//!
//! TetGen (Hang Si, *TetGen, a Delaunay-based quality tetrahedral mesh generator*, 2015) keeps
//! the surface's triangles, divided where need be. Its licence is the AGPL, so it is run as a
//! program of its own and nothing of it is linked.

use super::{
    ClosedSurface, Domain, MeshReport, MeshedDomain, Spacing, SurfaceDomain, find_spacing, finish,
};
use crate::mesh::{Location, TetMesh, TriMesh};
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

/// Largest ratio of a tet's circumradius to its shortest edge, and the smallest dihedral angle in
/// degrees that it aims at.
const QUALITY_SWITCH: &str = "q1.4/10";

/// The largest tet is allowed this many times the volume of a regular one of the wanted edge.
const MAX_VOLUME_RATIO: f64 = 1.2;

/// How far the number of tets may be from what was asked for.
const TOLERANCE: f64 = 0.15;

/// Time between two looks at whether the program has ended, or is to.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// Characters of the program's last words that go into an error.
const MAX_STDERR_CHARS: usize = 400;

/// Fills closed surfaces with tets by running the installed program `tetgen`.
///
/// Region n + 1 is the inside of surface n, less later surfaces, which may lie inside earlier
/// ones but not cross them; cavities are pieces that face inward. `spacing` bounds the volume of
/// tets, or is searched for the wanted number of them; the surfaces' triangles are the least
/// there is.
///
/// # Errors
/// [`Error::Input`] when the program is not installed, refuses the surfaces (those that cross
/// themselves), or cannot come within 15 % of the wanted number; [`Error::Mesh`] for surfaces
/// without an inside; [`Error::Io`] when no temporary folder can be written.
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
            "the edge of the tets cannot be {edge}; give a positive length"
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

/// Writes the surfaces as one piecewise linear complex; vertices that coincide are one.
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
    // No holes, no regions: what lies where is found afterwards.
    writeln!(file, "0\n0")?;
    file.flush()
}

/// A folder with a surface in it, to be meshed as often as need be.
struct Job<'a> {
    program: &'a OsStr,
    folder: &'a Path,
    regions: &'a SurfaceDomain,
    progress: ProgressFn<'a>,
}

impl Job<'_> {
    /// The tets with edges of about that length, or the fewest there are.
    fn fill(&self, edge: Option<f64>) -> Result<MeshedDomain> {
        let mut report = MeshReport::start(edge.unwrap_or(0.0));
        let part = ProgressScope::begin(self.progress, "TetGen", 0.1)?;
        let mut switches = format!("-p{QUALITY_SWITCH}AF");
        if let Some(edge) = edge {
            let volume = MAX_VOLUME_RATIO * edge.powi(3) / (6.0 * 2f64.sqrt());
            switches += &format!("a{volume:e}");
        }
        // A failed run must not be taken for the one before.
        let elements = self.folder.join("surface.1.ele");
        if elements.exists() {
            std::fs::remove_file(&elements).map_err(Error::io(&elements))?;
        }
        let output = self.output(&switches, &part)?;
        if !output.status.success() || !elements.exists() {
            return Err(self.refused(&output));
        }
        let mesh = crate::io::read(&elements)?;
        if edge.is_none() {
            report.edge = mean_edge(&mesh);
        }
        report.stage("TetGen");
        sorted(mesh, self.regions, report)
    }

    /// What a run says once it has ended; one that is not to go on is ended.
    fn output(&self, switches: &str, part: &ProgressScope) -> Result<Output> {
        // Files take whatever it says, and nobody has to read along.
        let said = |name: &str| {
            let file = self.folder.join(name);
            let made = File::create(&file).map_err(Error::io(&file))?;
            Ok((file, made))
        };
        let ((out, stdout), (err, stderr)) = (said("stdout")?, said("stderr")?);
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

    /// What to say of a run that failed.
    fn refused(&self, output: &Output) -> Error {
        // It aborts without a word that gets through; asked for crossings it answers.
        let crossings = Command::new(self.program)
            .args(["-d", "surface.smesh"])
            .current_dir(self.folder)
            .output()
            .ok()
            .and_then(|output| {
                let said = String::from_utf8_lossy(&output.stdout).into_owned();
                let line = said.lines().find_map(|l| l.trim().strip_prefix("!!"))?;
                Some(line.trim().to_owned())
            });
        let words = crossings.unwrap_or_else(|| last_words(output));
        Error::Input(format!(
            "TetGen gave up on the surface ({}): {words} TetGen takes no surfaces that cross themselves or each other; the lattice mesher does (--with lattice)",
            output.status
        ))
    }

    /// About `wanted` tets.
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
                "TetGen keeps the triangles of the surface, so it makes at least {} tets of it, not {wanted}; ask for so many, or take the lattice mesher (--with lattice)",
                fewest.tets.len()
            )));
        }
        let (low, high) = self.regions.bounds();
        let volume = (high - low).to_array().iter().product();
        let trial = |edge| self.fill(Some(edge));
        let filling = find_spacing(wanted, volume, false, trial, |filling| filling.tets.len())?;
        match within(&filling) {
            true => Ok(filling),
            false => Err(Error::Input(format!(
                "the nearest to {wanted} tets that TetGen comes is {}; give the edge instead (--edge)",
                filling.tets.len()
            ))),
        }
    }
}

fn not_started(program: &OsStr, error: &std::io::Error) -> Error {
    let name = program.to_string_lossy();
    Error::Input(match error.kind() {
        std::io::ErrorKind::NotFound => format!(
            "the program {name} is not installed; TetGen is a program of its own under the AGPL: apt install tetgen (Debian, Ubuntu), brew install tetgen (macOS), or take the lattice mesher (--with lattice)"
        ),
        _ => format!("the program {name} cannot be run: {error}"),
    })
}

/// The end of what a program said, on one line.
fn last_words(output: &Output) -> String {
    let said = [&output.stdout[..], b"\n", &output.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    let from = said.char_indices().rev().nth(MAX_STDERR_CHARS - 1);
    format!("{}.", &said[from.map_or(0, |(n, _)| n)..])
}

/// Tets by region; those in cavities are left out.
fn sorted(mesh: TetMesh, regions: &SurfaceDomain, report: MeshReport) -> Result<MeshedDomain> {
    // TetGen numbers the parts that the surfaces divide space into: the largest tet tells which
    // region a part belongs to. A single part may go without a number.
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
    finish(mesh.nodes, pieces, report)
}

/// The mean length of the tets' edges.
fn mean_edge(mesh: &TetMesh) -> f64 {
    let edges = mesh.edges();
    let length = |[a, b]: &[u32; 2]| mesh.nodes[*a as usize].distance(mesh.nodes[*b as usize]);
    edges.iter().map(length).sum::<f64>() / edges.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_is_not_there_is_named_with_how_to_get_it() {
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
