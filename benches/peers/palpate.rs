//! The bar of the chart of motion, simulated by Palpate's engine on the CPU: `compare.py` calls it.
//!
//!     peer_bar MESH OUT SCHEME POISSON GRAVITY STEP FRAME FRAMES [ROD]
//!
//! MESH is text: the numbers of nodes and tets, the nodes, and the tets, with a 1 after those of
//! the rod. Nodes at x = 0 are clamped. SCHEME is a solver's name; the suffix `-tight` sets the
//! tolerance of linear solves to 1e-5 instead of 1e-3. FRAME is the interval in seconds of the
//! FRAMES whose displacements are written to OUT as float64. ROD is a factor on the modulus of the
//! rod, or `rigid`. The program prints milliseconds of processor time and of wall time of all
//! steps, the medians of several runs.

use glam::DVec3;
use palpate::gpu::Gpu;
use palpate::mesh::{Field, Location, TetMesh};
use palpate::physics::{
    CgSettings, CpuTets, Material, MaterialModel, Precision, RegionMaterial, Simulator, SolverKind,
    Stiffness,
};
use palpate::{Error, Result};
use std::fmt::Display;
use std::path::Path;
use std::str::{FromStr, SplitWhitespace};
use std::time::{Duration, Instant};

const YOUNG: f64 = 1e6;

fn main() -> Result<()> {
    let given: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| a != "--bench")
        .collect();
    let [mesh, out, scheme, rest @ ..] = given.as_slice() else {
        return Err(Error::Input(
            "give MESH OUT SCHEME POISSON GRAVITY STEP FRAME FRAMES [ROD]".into(),
        ));
    };
    let numbers = rest.iter().take(5).map(|text| text.parse().map_err(bad));
    let numbers: Vec<f64> = numbers.collect::<Result<_>>()?;
    let [poisson, gravity, step, frame, frames] = numbers[..] else {
        return Err(bad("expected five numbers after the scheme"));
    };
    let mesh = read(Path::new(mesh))?;
    let (scheme, tolerance) = match scheme.strip_suffix("-tight") {
        Some(scheme) => (scheme, 1e-5),
        None => (scheme.as_str(), CgSettings::default().tolerance),
    };
    let kind: SolverKind = scheme.parse()?;
    let material = Material {
        model: MaterialModel::NeoHookean,
        poisson,
        ..Material::from_young(YOUNG)
    };
    let material = with_rod(material, rest.get(5).map(String::as_str))?;
    let held: Vec<u32> = (0_u32..)
        .zip(&mesh.nodes)
        .filter_map(|(i, p)| (p.x < 1e-9).then_some(i))
        .collect();
    let gpu = Gpu::new()?;
    let settings = CgSettings {
        tolerance,
        ..CgSettings::default()
    };
    let mut body = CpuTets::new(&gpu, mesh, &material, kind, settings, Precision::Single)?;
    body.pin_nodes(&held)?;
    body.loads_mut().set_gravity(DVec3::NEG_Z * gravity);

    let each = (frame / step).round() as u32;
    let (mut motion, mut taken, begin) = (Vec::new(), Vec::new(), Instant::now());
    while taken.is_empty() || (taken.len() < 15 && begin.elapsed() < Duration::from_millis(300)) {
        if !taken.is_empty() {
            body.restart()?;
        }
        let (mut busy, mut wall) = (0.0, 0.0);
        for _ in 0..frames as u32 {
            let (start, before) = (Instant::now(), processor_ms());
            body.run(each, step)?;
            busy += processor_ms() - before;
            wall += start.elapsed().as_secs_f64() * 1e3;
            // The motion is the same in every run.
            if taken.is_empty() {
                for (x, rest) in body.positions()?.iter().zip(&body.mesh().nodes) {
                    let moved: [f64; 3] = (*x - *rest).into();
                    motion.extend(moved.iter().flat_map(|v| v.to_le_bytes()));
                }
            }
        }
        taken.push((busy, wall));
    }
    std::fs::write(out, motion).map_err(Error::io(out))?;
    let median = |mut times: Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    let (busy, wall): (Vec<f64>, Vec<f64>) = taken.into_iter().unzip();
    println!("{} {}", median(busy), median(wall));
    Ok(())
}

fn bad(why: impl Display) -> Error {
    Error::Input(format!(
        "peer_bar: {why}; see the usage at the top of its source"
    ))
}

/// Returns the processor time of the threads of this program, if Linux reports it.
fn processor_ms() -> f64 {
    // A running thread is counted up to its last time slice: yield, so that this one is.
    std::thread::sleep(Duration::from_micros(200));
    let Ok(threads) = std::fs::read_dir("/proc/self/task") else {
        return f64::NAN;
    };
    let of_thread = |entry: std::io::Result<std::fs::DirEntry>| {
        let text = std::fs::read_to_string(entry.ok()?.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    };
    threads.filter_map(of_thread).sum::<f64>() * 1e-6
}

fn with_rod(mut material: Material, rod: Option<&str>) -> Result<Material> {
    let Some(rod) = rod else {
        return Ok(material);
    };
    material.region_field = Some("rod".into());
    let Stiffness::Young(young) = material.stiffness else {
        return Err(bad("the bar needs a Young's modulus"));
    };
    let factor = match rod {
        "rigid" => {
            material.rigid.insert(1);
            1.0
        }
        factor => factor.parse().map_err(bad)?,
    };
    let rod = RegionMaterial {
        stiffness: factor * young,
        density: material.density,
        poisson: material.poisson,
    };
    material.regions.insert(1, rod);
    Ok(material)
}

fn read(path: &Path) -> Result<TetMesh> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    let mut words = text.split_whitespace();
    let (nodes, tets): (usize, usize) = (next(&mut words)?, next(&mut words)?);
    let mut points = Vec::with_capacity(nodes);
    for _ in 0..nodes {
        points.push(DVec3::new(
            next(&mut words)?,
            next(&mut words)?,
            next(&mut words)?,
        ));
    }
    let (mut corners, mut labels) = (Vec::with_capacity(tets), Vec::with_capacity(tets));
    for _ in 0..tets {
        let mut corner = || next::<u32>(&mut words);
        corners.push([corner()?, corner()?, corner()?, corner()?]);
        labels.push(next(&mut words)?);
    }
    let fields = vec![Field::scalar("rod", Location::Cell, labels)];
    TetMesh::new(points, corners, fields, Vec::new())
}

fn next<T: FromStr<Err: Display>>(words: &mut SplitWhitespace) -> Result<T> {
    let word = words
        .next()
        .ok_or_else(|| bad("unexpected end of the mesh file"))?;
    word.parse().map_err(bad)
}
