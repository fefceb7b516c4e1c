//! Timed operations: on either engine of the library, and by the float64 reference implementation.

use super::{GPU, Point};
use crate::Result;
use crate::generate;
use crate::gpu::Gpu;
use crate::mesh::{Blade, Location, TetMesh, Topology};
use crate::parallel;
use crate::physics::{Engine, EngineChoice, GpuBody, Material, SolverKind};
use crate::render::{
    Camera, Geometry, RaycastOptions, Raycaster, ReferenceRaycaster, TableKind, TransferFunction,
};
use crate::scene::median_ms;
use crate::study::pictures::frame_ms;
use crate::study::{Cell, hold_one_end, peers_camera};
use glam::DVec3;
use rayon::prelude::*;
use std::hint::black_box;
use std::time::Instant;

/// Time step of implicit steps, s.
const IMPLICIT_STEP: f64 = 0.01;

/// Times points; caches the last mesh.
pub(super) struct Cases<'a> {
    gpu: &'a Gpu,
    repeats: u32,
    cube: Option<Cube>,
}

/// A cube of about `asked` tets.
struct Cube {
    asked: usize,
    mesh: TetMesh,
    topology: Topology,
    scalars: Vec<f64>,
}

impl<'a> Cases<'a> {
    pub fn new(gpu: &'a Gpu, quick: bool) -> Cases<'a> {
        Cases {
            gpu,
            repeats: if quick { 3 } else { 5 },
            cube: None,
        }
    }

    /// Returns nodes, iterations and milliseconds of `point`.
    pub fn measure(&mut self, point: &Point) -> Result<Vec<Cell>> {
        if self.cube.as_ref().is_none_or(|c| c.asked != point.tets) {
            // Drop the old mesh first, to limit memory.
            self.cube = None;
        }
        let repeats = self.repeats;
        let gpu = self.gpu;
        let cube = match self.cube.take() {
            Some(cube) => cube,
            None => Cube::new(point.tets)?,
        };
        let mut iterations = 0;
        let ms = match (point.what, point.on) {
            ("symplectic step", on) => cube.step(gpu, SolverKind::Symplectic, on, repeats)?.0,
            ("implicit step", on) => {
                let (ms, last) = cube.step(gpu, SolverKind::Implicit, on, repeats)?;
                iterations = last;
                ms
            }
            ("refresh", GPU) => cube.refresh(gpu, repeats)?,
            ("refresh", _) => cube.twin_refresh(repeats)?,
            ("raycast", GPU) if point.layers > 0 => layers(gpu, point, repeats)?,
            ("raycast", GPU) => {
                let mut caster = cube.raycaster(gpu, RaycastOptions::default())?;
                frame_ms(gpu, &mut caster, &peers_camera(), size(point), repeats)?
            }
            ("raycast", _) => cube.twin_raycast(gpu, size(point))?,
            ("cut", _) => cube.cut(gpu)?,
            ("table", GPU) => cube.table(gpu, point.texels, repeats)?,
            _ => cube.twin_table(gpu, point.texels)?,
        };
        let nodes = cube.mesh.nodes.len();
        self.cube = Some(cube);
        Ok(vec![nodes.into(), (iterations as usize).into(), ms.into()])
    }
}

fn size(point: &Point) -> [u32; 2] {
    let side = (point.pixels as f64).sqrt().round() as u32;
    [side, side]
}

fn transfer() -> Result<TransferFunction> {
    TransferFunction::preset("viridis")
}

impl Cube {
    fn new(tets: usize) -> Result<Cube> {
        let cells = ((tets as f64 / 6.0).cbrt().round() as usize).max(1);
        let mesh = generate::benchmark_cube(cells, false)?;
        let field = mesh.field("scalar", Location::Node);
        let scalars = field.map(|f| f.values.clone()).unwrap_or_default();
        Ok(Cube {
            asked: tets,
            topology: Topology::new(&mesh),
            scalars,
            mesh,
        })
    }

    fn body(&self, gpu: &Gpu) -> Result<GpuBody> {
        let mut body = GpuBody::new(gpu, &self.mesh, &Material::soft_tissue())?;
        body.clamp_one_end(9.81);
        Ok(body)
    }

    /// Returns the milliseconds per step on an engine, and the iterations of the last step.
    fn step(&self, gpu: &Gpu, kind: SolverKind, on: &str, repeats: u32) -> Result<(f64, u32)> {
        let engine = if on == GPU { Engine::Gpu } else { Engine::Cpu };
        let choice = EngineChoice::Exactly(engine);
        let mut body = choice.build_tets(gpu, self.mesh.clone(), &Material::soft_tissue(), kind)?;
        hold_one_end(body.as_mut())?;
        let limit = body.largest_stable_step();
        let dt = limit.map_or(IMPLICIT_STEP, |limit| 0.5 * limit);
        let ms = median_ms(repeats, || body.run(1, dt).map(drop))?;
        Ok((ms, body.iterations()?.last().copied().unwrap_or(0)))
    }

    fn refresh(&self, gpu: &Gpu, repeats: u32) -> Result<f64> {
        let mut geometry = Geometry::at_rest(gpu, &self.mesh, &self.scalars)?;
        median_ms(repeats, || {
            geometry.positions().mark_written();
            let mut work = gpu.start_recording();
            geometry.record_refresh(&mut work)?;
            work.submit()?;
            gpu.wait()
        })
    }

    fn twin_refresh(&self, repeats: u32) -> Result<f64> {
        median_ms(repeats, || {
            let made: Vec<_> = self
                .mesh
                .tets
                .par_iter()
                .enumerate()
                .map(|(t, nodes)| {
                    let corners = self.mesh.tet_nodes(t);
                    let scalars = nodes.map(|v| self.scalars[v as usize]);
                    (
                        Geometry::reference_tet_planes(corners),
                        Geometry::reference_tet_gradient(corners, scalars),
                    )
                })
                .collect();
            black_box(made);
            Ok(())
        })
    }

    fn raycaster(&self, gpu: &Gpu, options: RaycastOptions) -> Result<Raycaster> {
        let geometry = Geometry::at_rest(gpu, &self.mesh, &self.scalars)?;
        Raycaster::with_options(gpu, geometry, &transfer()?, options)
    }

    /// Times one reference image, including its bounding volume hierarchy, which must be updated as
    /// the nodes move.
    fn twin_raycast(&self, gpu: &Gpu, size: [u32; 2]) -> Result<f64> {
        let transfer = self.raycaster(gpu, RaycastOptions::default())?.transfer();
        let start = Instant::now();
        let rays = ReferenceRaycaster::new(&self.mesh, &self.mesh.nodes, &self.scalars);
        let picture = rays.render(&peers_camera(), size, |rays, ray| {
            rays.composite(ray, &transfer)
        });
        black_box(picture);
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// Times a cut through the whole cube and the update of the raycaster: the median of three.
    fn cut(&self, gpu: &Gpu) -> Result<f64> {
        let (mut mesh, mut topology) = (self.mesh.clone(), self.topology.clone());
        let mut scalars = self.scalars.clone();
        let mut body = self.body(gpu)?;
        let nodes = body.nodes();
        let frame = nodes.frame();
        let mut geometry = Geometry::new(gpu, &mesh, &topology, frame, nodes.array(), &scalars)?;
        let mut times = Vec::new();
        for height in [0.31, 0.52, 0.73] {
            let edge = |x: f64| {
                [
                    DVec3::new(x, height, -0.5),
                    DVec3::new(x, height + 0.01, 1.5),
                ]
            };
            let blade = Blade::from_sweep(&[edge(-0.5), edge(1.5)])?;
            let start = Instant::now();
            let cut = body.cut(&mut mesh, &mut topology, &blade)?;
            scalars.extend(
                cut.duplicated_nodes
                    .iter()
                    .map(|[_, from]| self.scalars.get(*from as usize).copied().unwrap_or(0.0)),
            );
            geometry.apply_cut(&mesh, &topology, &cut, body.nodes().array(), &scalars)?;
            gpu.wait()?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        Ok(times[1])
    }

    /// Times a new transfer function: its table is built and used once.
    fn table(&self, gpu: &Gpu, texels: usize, repeats: u32) -> Result<f64> {
        let options = RaycastOptions {
            table: TableKind::Sliced,
            table_size: Some((texels as f64).sqrt().round() as u32),
            ..Default::default()
        };
        let mut caster = self.raycaster(gpu, options)?;
        let transfer = transfer()?;
        median_ms(repeats, || {
            caster.set_transfer(&transfer)?;
            caster.sample_table(&[[0.2, 0.7, 0.1]]).map(|found| {
                black_box(found);
            })
        })
    }

    /// Times the exact integral for every texel, with as many slices.
    fn twin_table(&self, gpu: &Gpu, texels: usize) -> Result<f64> {
        let options = RaycastOptions {
            table: TableKind::Sliced,
            ..Default::default()
        };
        let caster = self.raycaster(gpu, options)?;
        let (transfer, slices) = (caster.transfer(), caster.table_layers());
        let side = (texels as f64).sqrt().round() as usize;
        median_ms(1, || {
            let made = parallel::map_coarse(slices as usize * texels, |i| {
                let [x, y] = [i % side, i / side % side].map(|k| k as f64 / side as f64);
                let depth = f64::from(2.0f32).powi((i / texels / 4) as i32 - 5);
                transfer.segment_integral(x, y, depth / transfer.max_extinction())
            });
            black_box(made);
            Ok(())
        })
    }
}

/// Times an image of plates behind each other, as many as a ray has to enter, with the given total
/// number of tets.
fn layers(gpu: &Gpu, point: &Point, repeats: u32) -> Result<f64> {
    let deep = 32;
    let across = ((point.tets as f64 / (6.0 * deep as f64)).sqrt().round() as usize).max(1);
    let plates = point.layers;
    let thickness = 1.0 / (2 * plates) as f64;
    let plate = generate::box_mesh(
        [across, across, deep / plates],
        DVec3::new(1.0, 1.0, thickness),
        generate::Split::Six,
    )?;
    let (mut nodes, mut tets) = (Vec::new(), Vec::new());
    let (low, _) = plate.bounds();
    for k in 0..plates {
        let first = nodes.len() as u32;
        let shift = DVec3::new(0.0, 0.0, 2.0 * thickness * k as f64) - low;
        nodes.extend(plate.nodes.iter().map(|p| *p + shift));
        tets.extend(plate.tets.iter().map(|t| t.map(|v| v + first)));
    }
    let mesh = TetMesh::new(nodes, tets, Vec::new(), Vec::new())?;
    let scalars: Vec<f64> = mesh.nodes.iter().map(|p| p.x).collect();
    let geometry = Geometry::at_rest(gpu, &mesh, &scalars)?;
    // Transparent enough that rays leave the last plate.
    let transfer = TransferFunction::relative(vec![[0.0, 0.9, 0.6, 0.3]], vec![[0.0, 1.0]])?;
    let mut caster = Raycaster::new(gpu, geometry, &transfer)?;
    let middle = DVec3::new(0.5, 0.5, 0.5);
    let eye = middle + DVec3::new(0.07, 0.05, 3.0);
    let camera = Camera::perspective(eye, middle, DVec3::Y, 24.0);
    frame_ms(gpu, &mut caster, &camera, size(point), repeats)
}
