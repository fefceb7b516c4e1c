//! Milliseconds of a cut of about a thousand faces, in meshes of increasing size.

use super::{Case, Context, Row, Spread};
use crate::Result;
use crate::generate;
use crate::mesh::{Blade, TetMesh, Topology, cut};
use crate::physics::{GpuBody, ImplicitEuler, Material, Solver};
use crate::render::{Camera, Geometry, Mode, Raycaster, TransferFunction};
use glam::DVec3;
use std::time::Instant;

pub(super) const ABOUT: &str = "Seven adjacent cuts through a cube of 20 kPa. Read waits for the \
    positions; find selects the faces and duplicates the nodes; springs and picture update the body \
    and the geometry of the raycaster; cut is the sum of these four. Then come the next implicit \
    step and the next picture of 256 × 256 pixels.";

/// Adjacent cuts, the first of which creates pipelines.
const CUTS: u32 = 8;
/// Cells along the side of the square that is cut, two faces each.
const SIDE: f64 = 22.4;
/// Names of the rows, and the marks in time between which they are measured.
const SPANS: [(&str, usize, usize); 7] = [
    ("cut", 0, 4),
    ("read", 0, 1),
    ("find", 1, 2),
    ("springs", 2, 3),
    ("picture", 3, 4),
    ("next step", 4, 5),
    ("next picture", 5, 6),
];

pub(super) fn cases(quick: bool) -> Vec<Case> {
    let cells: &[usize] = if quick { &[12] } else { &[12, 20, 32, 44] };
    let case = |cells: usize| {
        let row = Row::new(SPANS[0].0, "gpu and cpu", "ms").size(5 * cells.pow(3), "tets");
        Case::of_rows(row, move |context, row| measure(context, &row, cells))
    };
    cells.iter().map(|cells| case(*cells)).collect()
}

/// A body, its raycaster, and what cuts change of both.
struct Subject {
    mesh: TetMesh,
    topology: Topology,
    body: GpuBody,
    solver: ImplicitEuler,
    caster: Raycaster,
    camera: Camera,
    cells: usize,
}

impl Subject {
    fn new(context: &Context, cells: usize) -> Result<Subject> {
        let gpu = context.gpu;
        let mesh = generate::bar([cells; 3], DVec3::ONE)?;
        let topology = Topology::new(&mesh);
        let body = GpuBody::new(gpu, &mesh, &Material::from_young(20_000.0))?;
        let solver = ImplicitEuler::new(gpu, &body)?;
        let (positions, frame) = (body.nodes().array(), body.nodes().frame());
        let scalars = vec![0.5; mesh.nodes.len()];
        let geometry = Geometry::new(gpu, &mesh, &topology, frame, positions, &scalars)?;
        let caster = Raycaster::new(gpu, geometry, &TransferFunction::preset("tissue")?)?;
        Ok(Subject {
            camera: Camera::fit_mesh(&mesh),
            mesh,
            topology,
            body,
            solver,
            caster,
            cells,
        })
    }

    /// Makes a cut at a fraction of the length; returns the marks in time and the opened faces.
    fn cut(&mut self, context: &Context, x: f64) -> Result<(Vec<Instant>, usize)> {
        let gpu = context.gpu;
        // Less than the cross-section, or all of it.
        let half = 0.5 * (SIDE / self.cells as f64).min(1.5);
        let corner = |y: f64, z: f64| DVec3::new(x, 0.5 + half * y, 0.5 + half * z);
        let blade = Blade::from_sweep(&[
            [corner(-1.0, -1.0), corner(1.0, -1.0)],
            [corner(-1.0, 1.0), corner(1.0, 1.0)],
        ])?;
        gpu.wait()?;
        let mut marks = vec![Instant::now()];
        let positions = self.body.positions()?;
        marks.push(Instant::now());
        let done = cut(&mut self.mesh, &mut self.topology, &positions, &blade)?;
        marks.push(Instant::now());
        self.body.apply_cut(&self.mesh, &done)?;
        marks.push(Instant::now());
        let scalars = vec![0.5; self.mesh.nodes.len()];
        let nodes = self.body.nodes().array();
        let geometry = self.caster.geometry_mut();
        geometry.apply_cut(&self.mesh, &self.topology, &done, nodes, &scalars)?;
        gpu.wait()?;
        marks.push(Instant::now());
        self.solver.step(&mut self.body, 0.001)?;
        gpu.wait()?;
        marks.push(Instant::now());
        self.caster
            .image(&self.camera, [256, 256], Mode::Composite)?;
        marks.push(Instant::now());
        Ok((marks, done.opened_faces.len()))
    }
}

fn measure(context: &Context, row: &Row, cells: usize) -> Result<Vec<Row>> {
    let mut subject = Subject::new(context, cells)?;
    let tets = subject.mesh.tets.len();
    let mut times = vec![Vec::new(); SPANS.len()];
    let mut faces = 0;
    for k in 0..CUTS {
        let x = (f64::from(k) + 0.7) / (f64::from(CUTS) + 0.4);
        let (marks, opened) = subject.cut(context, x)?;
        faces = opened;
        for (times, (_, from, to)) in times.iter_mut().zip(SPANS).filter(|_| k > 0) {
            times.push((marks[to] - marks[from]).as_secs_f64() * 1e3);
        }
    }
    let rows = SPANS.iter().zip(times).map(|((name, ..), times)| {
        let row = Row {
            what: (*name).into(),
            ..row.clone()
        };
        let row = row.size(tets, "tets").spread(Spread::from_samples(times));
        row.note(format!("{faces} faces opened"))
    });
    Ok(rows.collect())
}
