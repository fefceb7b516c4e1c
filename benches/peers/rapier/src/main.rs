//! The bar of the chart of motion, simulated by rapier's soft bodies: `compare.py` calls it.
//!
//!     rapier-bar MESH OUT SOLVER POISSON GRAVITY STEP FRAME FRAMES [ROD]
//!
//! The arguments are those of `peer_bar`, Palpate's program in the same folder. SOLVER is `fem`,
//! `constraints`, or `fem-solved`, whose linear systems get up to 1,000 iterations instead of 20.
//! STEP is one of rapier's substeps; a world's step is FRAME seconds, or 16 substeps if that is
//! less.

use rapier3d::prelude::*;
use std::error::Error;
use std::fmt::Debug;
use std::str::{FromStr, SplitWhitespace};
use std::time::{Duration, Instant};

const YOUNG: f32 = 1e6;
const DENSITY: f64 = 1000.0;
const MAX_SUBSTEPS: usize = 16;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

struct Bar {
    nodes: Vec<[f64; 3]>,
    tets: Vec<[u32; 4]>,
    rod: Vec<bool>,
}

struct Asked {
    solver: String,
    poisson: f64,
    gravity: f64,
    step: f64,
    frame: f64,
    frames: usize,
    rod: Option<f32>,
}

fn main() -> Result<()> {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let [mesh, out, solver, rest @ ..] = given.as_slice() else {
        return Err("give MESH OUT SOLVER POISSON GRAVITY STEP FRAME FRAMES [ROD]".into());
    };
    let numbers: Vec<f64> = rest
        .iter()
        .map(|n| n.parse())
        .collect::<std::result::Result<_, _>>()?;
    let [poisson, gravity, step, frame, frames, rod @ ..] = numbers.as_slice() else {
        return Err("expected five numbers after the solver".into());
    };
    let asked = Asked {
        solver: solver.clone(),
        poisson: *poisson,
        gravity: *gravity,
        step: *step,
        frame: *frame,
        frames: *frames as usize,
        rod: rod.first().map(|&factor| factor as f32),
    };
    let bar = read(mesh)?;
    let (mut motion, mut taken, begin) = (Vec::new(), Vec::new(), Instant::now());
    while taken.is_empty() || (taken.len() < 15 && begin.elapsed() < Duration::from_millis(300)) {
        let first = taken.is_empty();
        taken.push(run(&bar, &asked, |found| {
            // The motion is the same in every run.
            if first {
                for (x, rest) in found.iter().zip(&bar.nodes) {
                    let place = [x.x, x.y, x.z].map(f64::from);
                    let moved = [0, 1, 2].map(|k| place[k] - rest[k]);
                    motion.extend(moved.iter().flat_map(|v| v.to_le_bytes()));
                }
            }
        })?);
    }
    std::fs::write(out, motion)?;
    let median = |mut times: Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    let (busy, wall): (Vec<f64>, Vec<f64>) = taken.into_iter().unzip();
    println!("{} {}", median(busy), median(wall));
    Ok(())
}

/// Simulates the bar from rest; returns milliseconds of processor time and of wall time.
fn run(bar: &Bar, asked: &Asked, mut frame: impl FnMut(&[Vector])) -> Result<(f64, f64)> {
    let mut mass = vec![0.0_f64; bar.nodes.len()];
    for tet in &bar.tets {
        let [a, b, c, d] = tet.map(|v| bar.nodes[v as usize]);
        let [u, v, w] = [b, c, d].map(|p| [0, 1, 2].map(|k| p[k] - a[k]));
        let volume = ((u[1] * v[2] - u[2] * v[1]) * w[0]
            + (u[2] * v[0] - u[0] * v[2]) * w[1]
            + (u[0] * v[1] - u[1] * v[0]) * w[2])
            / 6.0;
        for &v in tet {
            mass[v as usize] += DENSITY * volume / 4.0;
        }
    }
    let substeps = (asked.frame / asked.step).round() as usize;
    let worlds = substeps.div_ceil(MAX_SUBSTEPS);
    let mut world = PhysicsWorld::new();
    world.gravity = Vector::new(0.0, 0.0, -asked.gravity as f32);
    let parameters = &mut world.integration_parameters;
    parameters.dt = (asked.frame / worlds as f64) as f32;
    parameters.num_solver_iterations = substeps / worlds;
    let solver = match asked.solver.as_str() {
        "fem" => SoftBodySolver::Fem,
        "fem-solved" => {
            parameters.soft_bodies.fem.max_linear_iterations = 1000;
            SoftBodySolver::Fem
        }
        "constraints" => SoftBodySolver::Constraints,
        other => {
            return Err(format!(
                "unknown solver {other}; available: fem, fem-solved, constraints"
            )
            .into());
        }
    };
    let place = |p: &[f64; 3]| Vector::new(p[0] as f32, p[1] as f32, p[2] as f32);
    let held = (0_u32..)
        .zip(&bar.nodes)
        .filter(|(_, p)| p[0] < 1e-9)
        .map(|(i, _)| i);
    let body = SoftBodyBuilder::new(bar.nodes.iter().map(place).collect())
        .cells(bar.tets.clone())
        .cell_model(SoftBodyCellModel::NeoHookean)
        .material(SoftBodyMaterial {
            young_modulus: YOUNG,
            poisson_ratio: asked.poisson as f32,
            elastic_damping_ratio: 0.0,
            ..Default::default()
        })
        .masses(mass.iter().map(|&m| m as f32).collect())
        .solver(solver)
        .pinned_particles(held)
        .no_surface_collider()
        .can_sleep(false);
    let handle = world.insert_soft_body(body);
    if let Some(factor) = asked.rod {
        let stiff = bar.tets.iter().zip(&bar.rod).filter(|(_, rod)| **rod);
        let mut nodes: Vec<u32> = stiff.flat_map(|(tet, _)| *tet).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let (bodies, colliders) = (&mut world.bodies, &mut world.colliders);
        let cluster = world
            .soft_bodies
            .add_cluster(handle, &nodes, bodies, colliders)
            .ok_or("rapier created no cluster for the rod's nodes")?;
        world.soft_bodies[handle].set_cluster_stiffness_scale(cluster, factor);
    }
    let (mut busy, mut wall) = (0.0, 0.0);
    for _ in 0..asked.frames {
        let (start, before) = (Instant::now(), processor_ms());
        for _ in 0..worlds {
            world.step();
        }
        busy += processor_ms() - before;
        wall += start.elapsed().as_secs_f64() * 1e3;
        let body = &world.soft_bodies[handle];
        let found: Vec<Vector> = (0..bar.nodes.len())
            .map(|i| body.particle_position(i))
            .collect();
        frame(&found);
    }
    Ok((busy, wall))
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

fn read(path: &str) -> Result<Bar> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{path}: {e}"))?;
    let mut words = text.split_whitespace();
    let (nodes, tets): (usize, usize) = (next(&mut words)?, next(&mut words)?);
    let mut bar = Bar {
        nodes: Vec::with_capacity(nodes),
        tets: Vec::with_capacity(tets),
        rod: Vec::with_capacity(tets),
    };
    for _ in 0..nodes {
        bar.nodes
            .push([next(&mut words)?, next(&mut words)?, next(&mut words)?]);
    }
    for _ in 0..tets {
        let mut corner = || next::<u32>(&mut words);
        bar.tets.push([corner()?, corner()?, corner()?, corner()?]);
        bar.rod.push(next::<u8>(&mut words)? == 1);
    }
    Ok(bar)
}

fn next<T: FromStr<Err: Debug>>(words: &mut SplitWhitespace) -> Result<T> {
    let word = words.next().ok_or("unexpected end of the mesh file")?;
    word.parse().map_err(|e| format!("{word}: {e:?}").into())
}
