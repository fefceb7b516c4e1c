//! A mesh on the GPU as the raycaster sees it: per-tet vertices, neighbours, normals and
//! gradients, the boundary, and the passes that refresh what moves.
//!
//! Tets are kept along a Morton curve, whatever their order in the file; nodes keep theirs, so
//! that positions come straight from whoever moves them.

use crate::gpu::{Array, Gpu, Pass, Positions, Texel};
use crate::mesh::{LocalFrame, TetMesh, Topology, morton_order};
use crate::{Error, Result, parallel};

mod apply_cut;
mod gradients;
mod records;
mod reordered;
mod scalars;
mod table_statistics;

use gradients::Gradients;
use records::TetRecords;
use reordered::ReorderedMesh;
pub use table_statistics::TableStatistics;
use table_statistics::{longest_edge, mean_chord, scalar_histogram, scalar_range};

mod gpu_data {
    crate::gpu_struct! {
        pub(super) struct Count {
            pub tets: u32,
        }
    }
}

/// Links of a tet, one a face.
const LINKS_PER_TET: usize = 4;
/// Tets whose data are made and sent at a time, so that no list of all is needed.
const UPLOAD_BATCH: usize = 1 << 20;
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
    /// Mean length of a random ray in a tet, at rest, in local units.
    pub(super) mean_chord: f64,
    /// The share of the volume at rest whose scalar lies in each of equal parts of the range.
    pub(super) spread: std::sync::Arc<[f64]>,
    pub(super) positions: Array,
    pub(super) scalars: Array,
    /// One scalar a tet; a single item where scalars are at the nodes.
    pub(super) cells: Array,
    pub(super) is_cell_scalar: bool,
    pub(super) tets: Array,
    pub(super) links: Array,
    pub(super) boundary: Array,
    /// The same on the CPU.
    pub(super) boundary_faces: Vec<[u32; 4]>,
    /// What the walk over planes reads, where it was asked for.
    records: Option<TetRecords>,
    /// The nodes in camera space, made anew for each picture.
    pub(super) projected: Array,
    inverted: wgpu::Buffer,
    count_inverted: Pass,
    /// Where each tet of the mesh is kept.
    pub(super) tet_order: Vec<u32>,
    /// Counts cuts: what is prepared for its arrays is made for one generation.
    pub(super) generation: u64,
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
    pub fn from_nodes<'a, 'b>(
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
        let (count, most) = (mesh.tets.len(), gpu.max_items() / LINKS_PER_TET);
        if count > most {
            return Err(Error::Gpu(format!(
                "{count} tets are more than the {most} that this device can draw: it holds {} links in one texture, {LINKS_PER_TET} for each tet; use a coarser mesh",
                gpu.max_items()
            )));
        }
        let order = morton_order(mesh);
        let mut place = vec![0u32; order.len()];
        for (slot, t) in order.iter().enumerate() {
            place[*t as usize] = slot as u32;
        }
        let placed = ReorderedMesh {
            mesh,
            topology,
            place: &place,
        };
        let tets = gpu.array("tets", Texel::U32x4, count)?;
        let links = gpu.array("links", Texel::U32x2, LINKS_PER_TET * count)?;
        for (first, part) in (0..).step_by(UPLOAD_BATCH).zip(order.chunks(UPLOAD_BATCH)) {
            let nodes = parallel::map(part.len(), |k| mesh.tets[part[k] as usize]);
            gpu.write_items(&tets, first, &nodes)?;
            let across = parallel::map(part.len(), |k| placed.links(part[k]));
            gpu.write_items(&links, LINKS_PER_TET as u32 * first, across.as_flattened())?;
        }
        let boundary_faces = parallel::collect(count, |range, faces| {
            faces.extend(range.flat_map(|slot| placed.boundary_faces(order[slot])));
        });
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
        let inverted = gpu.buffer("inverted tets", 4)?;
        Ok(Geometry {
            gpu: gpu.clone(),
            frame,
            range,
            longest_edge: longest_edge(mesh) / frame.scale,
            mean_chord: mean_chord(mesh) / frame.scale,
            spread: scalar_histogram(mesh, scalars, range),
            positions: positions.clone(),
            scalars: gpu.array_of_with_headroom("scalars", Texel::F32, &nodes)?,
            cells: gpu.array_of("cell scalars", Texel::F32, &cells)?,
            is_cell_scalar: matches!(scalars, Scalars::Cells(_)),
            boundary: gpu.array_of_with_headroom("boundary", Texel::U32x4, &boundary_faces)?,
            boundary_faces,
            count_inverted: count_pass(gpu, positions, &tets, &inverted)?,
            tets,
            links,
            projected: gpu.array_with_headroom(
                "projected nodes",
                Texel::F32x4,
                mesh.nodes.len(),
            )?,
            records: None,
            inverted,
            tet_order: place,
            generation: 0,
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
        let frame = LocalFrame::from_mesh(mesh);
        let positions = local_positions(gpu, &frame, &mesh.nodes)?;
        Geometry::new(gpu, mesh, &Topology::new(mesh), frame, &positions, scalars)
    }

    /// Remembers where the nodes of `mesh`, which it was made of, rest: for planes that bend with
    /// the body. It takes 16 bytes a node.
    ///
    /// # Errors
    /// [`Error::Input`] for another mesh; [`Error::Gpu`] when it does not fit the device.
    pub fn store_rest_positions(&mut self, mesh: &TetMesh) -> Result<()> {
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
    pub(super) fn rest_positions(&self) -> Option<&Array> {
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

    /// Number of tets that are inside out or flat at the present positions. Reads back.
    ///
    /// # Errors
    /// As [`Gpu::read_buffer`].
    pub fn count_inverted(&self) -> Result<u32> {
        let mut work = self.gpu.start_recording();
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

fn count_pass(gpu: &Gpu, positions: &Array, tets: &Array, inverted: &wgpu::Buffer) -> Result<Pass> {
    gpu.pass("render/count_inverted")
        .read(positions)
        .read(tets)
        .write(inverted)
        .params(&gpu_data::Count { tets: tets.len() })
        .dispatch_items(tets.len())
}

/// A scalar as a share of the range, whose ends stand for what is beyond them.
fn share(scalar: f64, range: (f64, f64)) -> f32 {
    ((scalar - range.0) / (range.1 - range.0)).clamp(0.0, 1.0) as f32
}
