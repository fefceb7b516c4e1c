//! A mesh on the GPU as the raycaster sees it: per-tet vertices, neighbours, normals and
//! gradients, the boundary, and the passes that refresh what moves.
//!
//! Tets are kept along a Morton curve, whatever their order in the file; nodes keep theirs, so
//! that positions come straight from whoever moves them.

use crate::gpu::{Array, Gpu, Pass, Positions, Recorder, Texel};
use crate::mesh::{LocalFrame, TetMesh, Topology, morton_order};
use crate::{Error, Result};

mod follow;
mod gradients;
mod placed;
mod scalars;

use gradients::Gradients;
use placed::Placed;

mod gpu_data {
    crate::gpu_struct! {
        pub(super) struct Refresh {
            pub tets: u32,
        }
    }
    crate::gpu_struct! {
        pub(super) struct Count {
            pub tets: u32,
        }
    }
}

/// Texels of a tet's record (see `refresh_geometry.wgsl`).
const RECORD: usize = 8;
/// The texel of a record that holds the neighbours.
const RECORD_LINKS: usize = 6;

/// The scalar that is seen.
#[derive(Clone, Copy, Debug)]
pub enum Scalars<'a> {
    /// One number a node, linear in each tet.
    Nodes(&'a [f64]),
    /// One number a tet, constant in it: labels of regions, for example.
    Cells(&'a [f64]),
}

impl<'a> From<&'a Vec<f64>> for Scalars<'a> {
    fn from(nodes: &'a Vec<f64>) -> Scalars<'a> {
        Scalars::Nodes(nodes)
    }
}

impl<'a> From<&'a [f64]> for Scalars<'a> {
    fn from(nodes: &'a [f64]) -> Scalars<'a> {
        Scalars::Nodes(nodes)
    }
}

impl Scalars<'_> {
    fn values(&self) -> &[f64] {
        match self {
            Scalars::Nodes(values) | Scalars::Cells(values) => values,
        }
    }
}

/// A mesh with a scalar at its nodes or in its tets, prepared for drawing; its nodes move with an array of positions.
pub struct Geometry {
    pub(super) gpu: Gpu,
    pub(super) frame: LocalFrame,
    pub(super) range: (f64, f64),
    /// Longest edge at rest, in local units.
    pub(super) longest_edge: f64,
    pub(super) positions: Array,
    pub(super) scalars: Array,
    /// One scalar a tet; a single item where scalars are at the nodes.
    pub(super) cells: Array,
    pub(super) per_cell: bool,
    pub(super) tets: Array,
    pub(super) links: Array,
    pub(super) boundary: Array,
    /// The same on the CPU.
    pub(super) boundary_faces: Vec<[u32; 4]>,
    pub(super) records: Array,
    /// The nodes in camera space, made anew for each picture.
    pub(super) projected: Array,
    refresh: Pass,
    inverted: wgpu::Buffer,
    count_inverted: Pass,
    /// Where each tet of the mesh is kept.
    pub(super) place: Vec<u32>,
    /// Counts cuts: what is prepared for its arrays is made for one generation.
    pub(super) generation: u64,
    /// The version of the positions that the records were made for.
    refreshed: Option<u64>,
    /// What light needs, where there is some.
    gradients: Option<Gradients>,
    /// Where the nodes rest, where somebody asked.
    rests: Option<Array>,
}

impl Geometry {
    /// Prepares `mesh`, whose nodes stand at `positions`: xyz in `frame`, one item a node, written
    /// by whoever moves them. `scalars` holds one number a node, or one a tet.
    ///
    /// # Errors
    /// [`Error::Input`] when lengths differ or a scalar is not finite, [`Error::Gpu`] when the
    /// device cannot hold it.
    pub fn new<'a>(
        gpu: &Gpu,
        mesh: &TetMesh,
        topology: &Topology,
        frame: LocalFrame,
        positions: &Array,
        scalars: impl Into<Scalars<'a>>,
    ) -> Result<Geometry> {
        let scalars = scalars.into();
        let range = scalar_range(scalars.values());
        Geometry::with_range(gpu, mesh, topology, frame, positions, scalars, range)
    }

    /// Prepares `mesh`, whose nodes stand where `nodes` says: those of a body, or an array of the
    /// caller's with its frame. `scalars` holds one number a node, or one a tet.
    ///
    /// # Errors
    /// As [`Geometry::new`].
    pub fn following<'a, 'b>(
        gpu: &Gpu,
        mesh: &TetMesh,
        nodes: impl Into<Positions<'a>>,
        scalars: impl Into<Scalars<'b>>,
    ) -> Result<Geometry> {
        let Positions { array, frame } = nodes.into();
        Geometry::new(gpu, mesh, &Topology::new(mesh), frame, array, scalars)
    }

    fn with_range(
        gpu: &Gpu,
        mesh: &TetMesh,
        topology: &Topology,
        frame: LocalFrame,
        positions: &Array,
        scalars: Scalars,
        range: (f64, f64),
    ) -> Result<Geometry> {
        check_input(mesh, positions, scalars)?;
        let order = morton_order(mesh);
        let mut place = vec![0u32; order.len()];
        for (slot, t) in order.iter().enumerate() {
            place[*t as usize] = slot as u32;
        }
        let placed = Placed {
            mesh,
            topology,
            place: &place,
        };
        let tets: Vec<[u32; 4]> = order.iter().map(|t| mesh.tets[*t as usize]).collect();
        let links: Vec<[u32; 2]> = order.iter().flat_map(|t| placed.links(*t)).collect();
        let boundary_faces: Vec<[u32; 4]> = order.iter().flat_map(|t| placed.bare(*t)).collect();
        let (nodes, cells): (Vec<f32>, Vec<f32>) = match scalars {
            Scalars::Nodes(values) => {
                let shares = values.iter().map(|s| share(*s, range));
                (shares.collect(), vec![0.0])
            }
            Scalars::Cells(values) => {
                let sorted = order.iter().map(|t| share(values[*t as usize], range));
                (vec![0.0; mesh.nodes.len()], sorted.collect())
            }
        };
        let mut records = vec![[0u32; 4]; RECORD * tets.len()];
        for (record, t) in records.chunks_exact_mut(RECORD).zip(&order) {
            record[RECORD_LINKS] = placed.neighbours(*t);
        }
        let per_cell = matches!(scalars, Scalars::Cells(_));
        let scalars = gpu.roomy_array_of("scalars", Texel::F32, &nodes)?;
        let cells = gpu.array_of("cell scalars", Texel::F32, &cells)?;
        let nodes = gpu.array_of("tets", Texel::U32x4, &tets)?;
        let records = gpu.array_of("tet records", Texel::U32x4, &records)?;
        let inverted = gpu.buffer("inverted tets", 4)?;
        let refresh = refresh_pass(gpu, positions, &scalars, &nodes, &records)?;
        let count_inverted = count_pass(gpu, positions, &nodes, &inverted)?;
        Ok(Geometry {
            gpu: gpu.clone(),
            frame,
            range,
            longest_edge: longest_edge(mesh, topology) / frame.scale,
            positions: positions.clone(),
            scalars,
            cells,
            per_cell,
            links: gpu.array_of("links", Texel::U32x2, &links)?,
            boundary: gpu.roomy_array_of("boundary", Texel::U32x4, &boundary_faces)?,
            boundary_faces,
            tets: nodes,
            projected: gpu.roomy_array("projected nodes", Texel::F32x4, mesh.nodes.len())?,
            records,
            refresh,
            inverted,
            count_inverted,
            place,
            generation: 0,
            refreshed: None,
            gradients: None,
            rests: None,
        })
    }

    /// Prepares `mesh` where its file has it; to be moved by nobody.
    ///
    /// # Errors
    /// As [`Geometry::new`].
    pub fn at_rest<'a>(
        gpu: &Gpu,
        mesh: &TetMesh,
        scalars: impl Into<Scalars<'a>>,
    ) -> Result<Geometry> {
        let frame = LocalFrame::of_mesh(mesh);
        let positions = local_positions(gpu, &frame, &mesh.nodes)?;
        Geometry::new(gpu, mesh, &Topology::new(mesh), frame, &positions, scalars)
    }

    /// Remembers where the nodes of `mesh`, which it was made of, rest: for planes that bend with
    /// the body. It takes 16 bytes a node.
    ///
    /// # Errors
    /// [`Error::Input`] for another mesh; [`Error::Gpu`] when it does not fit the device.
    pub fn remember_rest(&mut self, mesh: &TetMesh) -> Result<()> {
        if mesh.nodes.len() != self.projected.len() as usize {
            return Err(Error::Input(
                "the rest of a body is that of the mesh that its geometry was made of".into(),
            ));
        }
        self.rests = Some(local_positions(&self.gpu, &self.frame, &mesh.nodes)?);
        // What was prepared without it is prepared anew.
        self.generation += 1;
        Ok(())
    }

    /// Where the nodes rest, xyz in the local frame, if it remembers.
    pub(super) fn rests(&self) -> Option<&Array> {
        self.rests.as_ref()
    }

    /// The positions it is drawn at: xyz in the local frame, one item a node. What depends on them
    /// is made anew in the recording of a picture whenever their version has changed.
    pub fn positions(&self) -> &Array {
        &self.positions
    }

    /// The frame of the positions.
    pub fn frame(&self) -> LocalFrame {
        self.frame
    }

    /// Smallest and largest scalar; apart by 1 where they are equal.
    pub fn scalar_range(&self) -> (f64, f64) {
        self.range
    }

    /// Number of tets.
    pub fn tet_count(&self) -> u32 {
        self.tets.len()
    }

    /// Three vertices for each boundary face.
    pub(super) fn corners(&self) -> u32 {
        3 * self.boundary.len()
    }

    /// Normals, gradients and neighbours of each tet, eight texels each, as the walk over planes
    /// reads them; laid out as `shaders/render/refresh_geometry.wgsl` says.
    pub fn records(&self) -> &Array {
        &self.records
    }

    /// Records the refresh of normals and gradients, if the positions changed since the last.
    pub fn record_refresh(&mut self, work: &mut Recorder) {
        let version = Some(self.positions.version());
        if self.refreshed != version {
            self.refresh.record(work);
            self.refreshed = version;
        }
    }

    /// Number of tets that are inside out or flat at the present positions. Reads back.
    ///
    /// # Errors
    /// As [`Gpu::read_buffer`].
    pub fn inverted(&self) -> Result<u32> {
        let mut work = self.gpu.record();
        work.encoder().clear_buffer(&self.inverted, 0, None);
        self.count_inverted.record(&mut work);
        work.submit()?;
        Ok(self
            .gpu
            .read_buffer::<u32>(&self.inverted)?
            .first()
            .copied()
            .unwrap_or(0))
    }
}

/// An array of positions in `frame`, as [`Geometry::new`] takes it.
///
/// # Errors
/// As [`Gpu::array_of`].
pub fn local_positions(gpu: &Gpu, frame: &LocalFrame, nodes: &[glam::DVec3]) -> Result<Array> {
    let local: Vec<[f32; 4]> = nodes
        .iter()
        .map(|p| frame.to_local(*p).extend(1.0).to_array())
        .collect();
    gpu.array_of("positions", Texel::F32x4, &local)
}

fn check_input(mesh: &TetMesh, positions: &Array, scalars: Scalars) -> Result<()> {
    let (what, items) = match scalars {
        Scalars::Nodes(_) => ("node", mesh.nodes.len()),
        Scalars::Cells(_) => ("tet", mesh.tets.len()),
    };
    let values = scalars.values();
    if values.len() != items || positions.len() as usize != mesh.nodes.len() {
        return Err(Error::Input(format!(
            "{items} {what}s, but {} scalars for them, and {} positions for {} nodes",
            values.len(),
            positions.len(),
            mesh.nodes.len()
        )));
    }
    if mesh.tets.is_empty() {
        return Err(Error::Mesh("there are no tets to draw".into()));
    }
    match values.iter().position(|s| !s.is_finite()) {
        None => Ok(()),
        Some(i) => Err(Error::Input(format!(
            "the scalar of {what} {i} is {}; choose another field, or replace such values",
            values[i]
        ))),
    }
}

/// Smallest and largest scalar, apart by 1 where they are equal.
fn scalar_range(scalars: &[f64]) -> (f64, f64) {
    let (low, high) = scalars
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), s| {
            (a.min(*s), b.max(*s))
        });
    if high > low {
        (low, high)
    } else {
        (low, low + 1.0)
    }
}

fn longest_edge(mesh: &TetMesh, topology: &Topology) -> f64 {
    topology
        .edges
        .iter()
        .map(|[a, b]| mesh.nodes[*a as usize].distance(mesh.nodes[*b as usize]))
        .fold(0.0, f64::max)
}

fn refresh_pass(
    gpu: &Gpu,
    positions: &Array,
    scalars: &Array,
    tets: &Array,
    records: &Array,
) -> Result<Pass> {
    gpu.pass("render/refresh_geometry")
        .read(positions)
        .read(scalars)
        .read(tets)
        .write(records)
        .params(&gpu_data::Refresh { tets: tets.len() })
        .over(tets.len())
}

fn count_pass(gpu: &Gpu, positions: &Array, tets: &Array, inverted: &wgpu::Buffer) -> Result<Pass> {
    gpu.pass("render/count_inverted")
        .read(positions)
        .read(tets)
        .write(inverted)
        .params(&gpu_data::Count { tets: tets.len() })
        .over(tets.len())
}

/// A scalar as a share of the range, whose ends stand for what is beyond them.
fn share(scalar: f64, range: (f64, f64)) -> f32 {
    ((scalar - range.0) / (range.1 - range.0)).clamp(0.0, 1.0) as f32
}
