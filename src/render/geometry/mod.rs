//! GPU representation of a mesh for raycasting: vertices, neighbours, normals and gradients of the
//! tets, the boundary, and the passes that refresh position-dependent data.
//!
//! Tets are stored in Morton order, independent of their order in the file. Nodes keep their order,
//! so that the positions of a simulation can be used directly.

use crate::gpu::{Array, Gpu, Pass, Positions, Texel};
use crate::mesh::{LocalFrame, TetMesh, Topology};
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

/// Links of a tet, one per face.
const LINKS_PER_TET: usize = 4;
/// Tets processed and uploaded at a time, to avoid a list of the whole mesh.
const UPLOAD_BATCH: usize = 1 << 20;
/// Scalar field to display.
#[derive(Clone, Copy, Debug)]
pub enum Scalars<'a> {
    /// One value per node, linear in each tet.
    Nodes(&'a [f64]),
    /// One value per tet, constant in it, such as region labels.
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

/// A mesh with a scalar field at the nodes or in the tets, prepared for rendering. Its nodes move
/// with an array of positions.
pub struct Geometry {
    pub(super) gpu: Gpu,
    pub(super) frame: LocalFrame,
    pub(super) range: (f64, f64),
    /// Longest edge at rest, in local units.
    pub(super) longest_edge: f64,
    /// Mean chord length of random rays in the tets at rest, in local units.
    pub(super) mean_chord: f64,
    /// Histogram: volume fraction at rest per equal-width bin of the scalar range.
    pub(super) spread: std::sync::Arc<[f64]>,
    pub(super) positions: Array,
    pub(super) scalars: Array,
    /// One scalar per tet; a single item if the scalars are at the nodes.
    pub(super) cells: Array,
    pub(super) is_cell_scalar: bool,
    pub(super) tets: Array,
    pub(super) links: Array,
    pub(super) boundary: Array,
    /// CPU copy of `boundary`.
    pub(super) boundary_faces: Vec<[u32; 4]>,
    /// Tet records for the plane traversal, if used.
    records: Option<TetRecords>,
    /// Nodes in camera space, recomputed for each image.
    pub(super) projected: Array,
    inverted: wgpu::Buffer,
    count_inverted: Pass,
    /// Position of each mesh tet in the stored order.
    pub(super) tet_order: Vec<u32>,
    /// Change counter: draws bound to the arrays are valid for one generation.
    pub(super) generation: u64,
    /// Gradients, if lighting is enabled.
    gradients: Option<Gradients>,
    /// Rest positions of the nodes, if stored.
    rests: Option<Array>,
}

impl Geometry {
    /// Prepares `mesh` with node positions `positions`: xyz in `frame`, one item per node, updated
    /// by the caller or a simulation. `scalars` holds one value per node or per tet.
    ///
    /// # Errors
    /// [`Error::Input`] if lengths differ or a scalar is not finite, [`Error::Gpu`] if the mesh
    /// does not fit the device.
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

    /// Prepares `mesh` with positions from `nodes`: those of a body, or an array with its frame.
    /// `scalars` holds one value per node or per tet.
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
                "{count} tets exceed the limit of {most} on this device ({} links in one texture, {LINKS_PER_TET} per tet); use a coarser mesh",
                gpu.max_items()
            )));
        }
        let order = mesh.morton_order();
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

    /// Prepares `mesh` as a static geometry at the node positions of its file.
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

    /// Stores the rest positions of `mesh`, the mesh of the geometry, as needed for section planes
    /// that deform with the body. Uses 16 bytes per node.
    ///
    /// # Errors
    /// [`Error::Input`] for another mesh; [`Error::Gpu`] if the positions do not fit the device.
    pub fn store_rest_positions(&mut self, mesh: &TetMesh) -> Result<()> {
        if mesh.nodes.len() != self.projected.len() as usize {
            return Err(Error::Input(
                "rest mesh must have the nodes of the geometry; pass the mesh it was created from"
                    .into(),
            ));
        }
        self.rests = Some(local_positions(&self.gpu, &self.frame, &mesh.nodes)?);
        // Invalidates draws built without rest positions.
        self.generation += 1;
        Ok(())
    }

    /// Returns the rest positions of the nodes, xyz in the local frame, if stored.
    pub(super) fn rest_positions(&self) -> Option<&Array> {
        self.rests.as_ref()
    }

    /// Returns the current positions: xyz in the local frame, one item per node. Dependent data are
    /// recomputed in the recording of an image if the version of the array has changed.
    pub fn positions(&self) -> &Array {
        &self.positions
    }

    /// Returns the local frame of the positions.
    pub fn frame(&self) -> LocalFrame {
        self.frame
    }

    /// Returns the smallest and largest scalar; the width is 1 for a constant field.
    pub fn scalar_range(&self) -> (f64, f64) {
        self.range
    }

    /// Returns the number of tets.
    pub fn tet_count(&self) -> u32 {
        self.tets.len()
    }

    /// Returns the vertex count of the boundary draw: three per boundary face.
    pub(super) fn corners(&self) -> u32 {
        3 * self.boundary.len()
    }

    /// Returns the number of inverted or degenerate tets at the current positions. Reads back.
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

/// Uploads positions in `frame`, in the form required by [`Geometry::new`].
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
            "array lengths do not match the mesh: {} scalars for {items} {what}s, and {} positions for {} nodes",
            values.len(),
            positions.len(),
            mesh.nodes.len()
        )));
    }
    if mesh.tets.is_empty() {
        return Err(Error::Mesh("the mesh has no tets to draw".into()));
    }
    match values.iter().position(|s| !s.is_finite()) {
        None => Ok(()),
        Some(i) => Err(Error::Input(format!(
            "scalar of {what} {i} must be finite, got {}; choose another field, or replace such values",
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

/// Normalises a scalar to its range, clamped to 0…1.
fn share(scalar: f64, range: (f64, f64)) -> f32 {
    ((scalar - range.0) / (range.1 - range.0)).clamp(0.0, 1.0) as f32
}
