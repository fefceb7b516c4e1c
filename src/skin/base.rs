//! The base mesh of a skin: node positions on the GPU, surface triangles, node normals.

use super::binder::triangles_around;
use super::binding::BaseMesh;
use crate::gpu::{Array, Gpu, Pass, Recorder, Texel};
use crate::mesh::{LocalFrame, NO_NORMAL, TetMesh, Topology, pack_normal};
use crate::physics::{GridBody, NodePositions, Simulator};
use crate::{Error, Result};
use glam::DVec3;

mod gpu_data {
    crate::gpu_struct! {
        pub(super) struct Normals {
            pub nodes: u32,
        }
    }
}

/// Nodes and surface triangles that a skin is bound to.
///
/// The owner of the nodes writes the position array; the normals are updated from it on the GPU,
/// either by the owner or by this struct.
#[derive(Clone, Debug)]
pub struct SkinBase {
    pub(super) positions: Array,
    pub(super) frame: LocalFrame,
    pub(super) normals: Array,
    /// Rest positions as stored on the GPU (local frame, single precision).
    rest: Vec<DVec3>,
    rest_normals: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    /// The pass that computes the normals, unless the owner of the nodes does.
    refresh: Option<Pass>,
}

impl SkinBase {
    /// Creates the base of nodes whose owner computes their normals (a grid body: equation 3 of the
    /// paper).
    ///
    /// `positions` is rgba32float, xyz in `frame`; `normals` is r32uint, packed as by
    /// [`pack_normal`](crate::mesh::pack_normal). `rest` are the rest positions in file units,
    /// `rest_normals` the packed rest normals, bit for bit as the GPU computes them. `triangles`
    /// are counter-clockwise seen from outside.
    ///
    /// # Errors
    /// [`Error::Input`] if lengths or kinds of arrays differ, or a triangle refers to a node that
    /// does not exist.
    pub fn new(
        positions: &Array,
        frame: LocalFrame,
        normals: &Array,
        rest: &[DVec3],
        rest_normals: &[u32],
        triangles: &[[u32; 3]],
    ) -> Result<SkinBase> {
        check(positions, rest, triangles)?;
        if normals.texel() != Texel::U32
            || normals.len() as usize != rest.len()
            || rest_normals.len() != rest.len()
        {
            return Err(Error::Input(format!(
                "number of normals must equal the number of nodes ({}), got {} on the GPU (texel {:?}, must be U32) and {} at rest",
                rest.len(),
                normals.len(),
                normals.texel(),
                rest_normals.len()
            )));
        }
        Ok(SkinBase {
            positions: positions.clone(),
            frame,
            normals: normals.clone(),
            rest: in_frame(rest, &frame),
            rest_normals: rest_normals.to_vec(),
            triangles: triangles.to_vec(),
            refresh: None,
        })
    }

    /// Creates the base of nodes whose normals are recomputed here whenever the skin is drawn: the
    /// area-weighted mean of the incident triangles' normals. For tetrahedral bodies, and for small
    /// sets of nodes given directly.
    ///
    /// Reads back once, because the binding needs the normals as the GPU computes them.
    ///
    /// # Errors
    /// [`Error::Input`] as [`SkinBase::new`]; [`Error::Gpu`] if the device cannot allocate it.
    pub fn with_area_normals(
        gpu: &Gpu,
        positions: &Array,
        frame: LocalFrame,
        rest: &[DVec3],
        triangles: &[[u32; 3]],
    ) -> Result<SkinBase> {
        check(positions, rest, triangles)?;
        let (firsts, around) = triangles_around(triangles, rest.len());
        let corners: Vec<[u32; 4]> = triangles.iter().map(|t| [t[0], t[1], t[2], 0]).collect();
        let firsts = gpu.array_of("first triangles", Texel::U32, &firsts)?;
        let around = gpu.array_of("triangles around nodes", Texel::U32, &around)?;
        let corners = gpu.array_of("base triangles", Texel::U32x4, &corners)?;
        let nodes = rest.len() as u32;
        let pass = |positions: &Array, normals: &Array| {
            gpu.pass("skin/node_normals")
                .read(positions)
                .read(&corners)
                .read(&firsts)
                .read(&around)
                .write(normals)
                .params(&gpu_data::Normals { nodes })
                .dispatch_items(nodes)
        };
        let normals = gpu.array("packed normals", Texel::U32, rest.len())?;
        let refresh = pass(positions, &normals)?;
        let rest_normals = match cfg!(target_arch = "wasm32") {
            // A browser cannot block on a read-back; the CPU normals differ only by rounding.
            true => BaseMesh::reference_normals(rest, triangles)
                .into_iter()
                .map(|n| n.map_or(NO_NORMAL, pack_normal))
                .collect(),
            false => {
                let places = crate::render::local_positions(gpu, &frame, rest)?;
                let made = gpu.array("packed normals at rest", Texel::U32, rest.len())?;
                let mut work = gpu.start_recording();
                pass(&places, &made)?.record(&mut work);
                work.submit()?;
                gpu.read_array(&made)?
            }
        };
        Ok(SkinBase {
            positions: positions.clone(),
            frame,
            normals,
            rest: in_frame(rest, &frame),
            rest_normals,
            triangles: triangles.to_vec(),
            refresh: Some(refresh),
        })
    }

    /// Creates the base of the boundary of `mesh`, whose nodes are at `positions`: xyz in `frame`.
    ///
    /// # Errors
    /// As [`SkinBase::with_area_normals`].
    pub fn from_mesh(
        gpu: &Gpu,
        mesh: &TetMesh,
        positions: &Array,
        frame: LocalFrame,
    ) -> Result<SkinBase> {
        SkinBase::with_area_normals(gpu, positions, frame, &mesh.nodes, &boundary(mesh))
    }

    /// Creates the base of the boundary of a simulated body.
    ///
    /// # Errors
    /// As [`SkinBase::with_area_normals`].
    pub fn from_body(gpu: &Gpu, body: &dyn Simulator) -> Result<SkinBase> {
        let nodes = body.nodes();
        SkinBase::from_mesh(gpu, body.mesh(), nodes.array(), nodes.frame())
    }

    /// Creates the base of a grid body, with the approximate normals that its steps compute
    /// (equation 3): its particles are the nodes, the boundary of its full cells the base
    /// triangles. Reads back once.
    ///
    /// # Errors
    /// As [`SkinBase::new`] and [`GridBody::rest_normals`].
    pub fn from_grid(body: &mut GridBody) -> Result<SkinBase> {
        let at_rest = body.rest_normals()?;
        SkinBase::with_normals(body.nodes(), body.mesh(), body.normals(), &at_rest)
    }

    /// Creates the base of the boundary of `mesh` with packed node `normals` on the GPU and the
    /// rest normals `at_rest`.
    ///
    /// # Errors
    /// As [`SkinBase::new`].
    pub fn with_normals(
        nodes: &NodePositions,
        mesh: &TetMesh,
        normals: &Array,
        at_rest: &[u32],
    ) -> Result<SkinBase> {
        SkinBase::new(
            nodes.array(),
            nodes.frame(),
            normals,
            &mesh.nodes,
            at_rest,
            &boundary(mesh),
        )
    }

    /// Returns the local frame of the positions.
    pub fn frame(&self) -> LocalFrame {
        self.frame
    }

    /// Returns the rest mesh that skins are bound to.
    pub fn rest_mesh(&self) -> BaseMesh<'_> {
        BaseMesh {
            nodes: &self.rest,
            triangles: &self.triangles,
            normals: &self.rest_normals,
        }
    }

    /// Returns the packed normals on the GPU.
    pub fn normals(&self) -> &Array {
        &self.normals
    }

    /// Records the update of the normals, unless the owner of the nodes does it.
    pub fn record_normals(&self, work: &mut Recorder) {
        if let Some(refresh) = &self.refresh {
            refresh.record(work);
        }
    }
}

fn boundary(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let topology = Topology::new(mesh);
    let faces = topology.boundary.iter();
    faces.map(|f| topology.boundary_nodes(mesh, *f)).collect()
}

/// Rest positions in the local frame, rounded to single precision as on the GPU.
fn in_frame(rest: &[DVec3], frame: &LocalFrame) -> Vec<DVec3> {
    rest.iter().map(|p| frame.to_local(*p).as_dvec3()).collect()
}

fn check(positions: &Array, rest: &[DVec3], triangles: &[[u32; 3]]) -> Result<()> {
    if positions.texel() != Texel::F32x4 || positions.len() as usize != rest.len() {
        return Err(Error::Input(format!(
            "number of positions must equal the number of nodes ({}), got {} on the GPU (texel {:?}, must be F32x4)",
            rest.len(),
            positions.len(),
            positions.texel()
        )));
    }
    let mut corners = triangles.iter().flatten();
    match corners.find(|v| **v as usize >= rest.len()) {
        None => Ok(()),
        Some(bad) => Err(Error::Input(format!(
            "node index {bad} of a base triangle is out of range: there are {} nodes, counted from 0",
            rest.len()
        ))),
    }
}
