//! Time and memory from a large mesh to its first picture.

use super::raycast::cube;
use super::{Case, Context, Row};
use crate::Result;
use crate::mesh::{LocalFrame, Location, Topology};
use crate::mesher::peak_memory;
use crate::render::{
    Geometry, Light, RaycastOptions, Raycaster, TransferFunction, local_positions,
};
use crate::study::peers_camera;
use std::time::Instant;

pub(super) const ABOUT: &str = "The benchmark cube, lit, 1024 × 1024 pixels: seconds of each phase \
    once, and the largest memory of the process so far, which includes the textures of a software \
    driver.";

/// Memory at the peak, bytes a tet, measured at ten million tets on a software driver and rounded
/// up.
const BYTES_PER_TET: u64 = 250;
const PIXELS: [u32; 2] = [1024; 2];

pub(super) fn cases(quick: bool) -> Vec<Case> {
    let sizes: &[usize] = match quick {
        true => &[500_000],
        false => &[1_000_000, 10_000_000],
    };
    let case = |tets: usize| {
        let row = Row::new("all phases", "gpu and cpu", "s").size(tets, "tets");
        Case::of_rows(row, move |context, row| measure(context, &row, tets))
            .memory(BYTES_PER_TET * tets as u64)
    };
    sizes.iter().map(|tets| case(*tets)).collect()
}

/// The seconds and the peak memory of each phase so far.
struct Phases {
    start: Instant,
    done: Vec<(&'static str, f64, Option<u64>)>,
}

impl Phases {
    fn time<T>(&mut self, what: &'static str, make: impl FnOnce() -> Result<T>) -> Result<T> {
        let start = Instant::now();
        let made = make()?;
        let seconds = start.elapsed().as_secs_f64();
        self.done.push((what, seconds, peak_memory()));
        Ok(made)
    }
}

fn measure(context: &Context, row: &Row, tets: usize) -> Result<Vec<Row>> {
    let gpu = context.gpu;
    let mut phases = Phases {
        start: Instant::now(),
        done: Vec::new(),
    };
    let mesh = phases.time("mesh", || cube(tets))?;
    let topology = phases.time("neighbours", || Ok(Topology::new(&mesh)))?;
    let field = mesh.field("scalar", Location::Node);
    let scalars = field.map(|f| f.values.clone()).unwrap_or_default();
    let frame = LocalFrame::from_mesh(&mesh);
    let mut geometry = phases.time("geometry", || {
        let positions = local_positions(gpu, &frame, &mesh.nodes)?;
        let geometry = Geometry::new(gpu, &mesh, &topology, frame, &positions, &scalars)?;
        gpu.wait()?;
        Ok(geometry)
    })?;
    phases.time("lists for light", || {
        geometry.enable_lighting(&mesh, &topology, &scalars)?;
        gpu.wait()
    })?;
    let options = RaycastOptions {
        light: Light::Head,
        ..Default::default()
    };
    let transfer = TransferFunction::preset("tissue")?;
    let mut caster = Raycaster::with_options(gpu, geometry, &transfer, options)?;
    let camera = peers_camera();
    phases.time("first picture", || caster.picture(&camera, PIXELS))?;
    let total = phases.start.elapsed().as_secs_f64();
    phases.time("next picture", || {
        caster.picture(&camera.orbited(7.0), PIXELS)
    })?;
    let count = mesh.tets.len();
    let mut rows = vec![row.clone().size(count, "tets").value(total)];
    rows[0].note = "to the first picture".into();
    for (what, seconds, peak) in phases.done {
        let row = Row::new(what, &row.on, "s").size(count, "tets");
        let peak = peak.map(|bytes| format!("{:.2} GB at its end", bytes as f64 * 1e-9));
        rows.push(row.value(seconds).note(peak.unwrap_or_default()));
    }
    if let Some(peak) = peak_memory() {
        let row = Row::new("largest memory", &row.on, "GB").size(count, "tets");
        rows.push(row.value(peak as f64 * 1e-9));
    }
    Ok(rows)
}
