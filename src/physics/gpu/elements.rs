//! Finite elements as a term on the GPU; the CPU side of `shaders/terms/elements.wgsl`,
//! `shaders/lib/finite_elements.wgsl` and the passes over tets.
//!
//! A pass over tets computes the forces on the four corners of each; the pass that gathers all
//! forces of a node sums them through rows of the corners at each node.

use super::contact::GpuContact;
use super::edges::GpuEdges;
use super::sliced_ellpack::SlicedEllpack;
use super::terms::{GpuTerm, ProgramPart};
use crate::gpu::{Array, Gpu, Pass, PassBuilder, Texel};
use crate::physics::model::discrete_model::DiscreteModel;
use crate::physics::model::units::LocalUnits;
use crate::physics::{ConstitutiveModel, Elements, VolumetricFormulation};
use crate::{Error, Result};
use glam::Vec3;
use std::collections::BTreeMap;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/terms/elements.wgsl`.
        pub struct ElementParams {
            pub drag: f32,
            pub _pad0: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/tet_forces.wgsl`.
        pub struct TetForceParams {
            pub tets: u32,
            pub damping_time: f32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/tet_hessians.wgsl`.
        pub struct CurvatureParams {
            pub tets: u32,
            pub _pad0: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/edge_blocks.wgsl`.
        pub struct EdgeParams {
            pub edges: u32,
            pub scale: f32,
        }
    }
}
use gpu_data::{CurvatureParams, EdgeParams, ElementParams, TetForceParams};

/// Texels per tet of the Hessian data.
const CURVATURE_TEXELS: usize = 8;

/// Texels per directed edge of the matrix.
const BLOCK_TEXELS: usize = 3;

/// Cost of an edge block, an incidence and a tet, over that of a spring visit.
const TET_COST_IN_SPRINGS: u32 = 4;

/// The finite elements of a body.
#[derive(Debug)]
pub(in crate::physics) struct GpuElements {
    law: ConstitutiveModel,
    count: u32,
    tets: Array,
    shapes: Array,
    rest: Array,
    rows: Array,
    corners: Array,
    /// Rows of the edges: those of the mesh, or with rigid bodies those of the elements.
    edge_rows: Array,
    edge_columns: Array,
    matrix_texels: usize,
    /// With rigid bodies: the row of each node in `edge_rows`.
    edge_row_of: Vec<u32>,
    edges: Array,
    /// The two nodes of each edge.
    ends: Vec<[u32; 2]>,
    around: Array,
    tet_forces: Array,
    params: ElementParams,
    damping_time: f32,
}

/// The lists from which the arrays are created.
struct Lists {
    tets: Vec<[u32; 4]>,
    shapes: Vec<[f32; 4]>,
    /// The corners at each node.
    corners: Vec<Vec<u32>>,
    edges: Vec<[u32; 4]>,
    ends: Vec<[u32; 2]>,
    around: Vec<u32>,
}

impl GpuElements {
    /// `elements`, those of `model`, whose nodes rest at the local positions `rest` and whose
    /// edges are `mesh_edges`.
    pub fn new(
        gpu: &Gpu,
        (model, elements): (&DiscreteModel, &Elements),
        rest: &[Vec3],
        (mesh_edges, units): (&GpuEdges, &LocalUnits),
    ) -> Result<GpuElements> {
        if elements.volume == VolumetricFormulation::NodalAveraged {
            return Err(Error::Input(
                "averaged volumes are supported on the CPU only; use the engine cpu or auto (--engine), or the volume per-tet (--volume)".into(),
            ));
        }
        let count = elements.tets.len();
        if count >= 1 << 28 {
            return Err(Error::Mesh(
                "the mesh has more tets than 32-bit indices allow; use a coarser mesh".into(),
            ));
        }
        // Edges within rigid bodies are left out, because they carry no elastic force.
        let own = match elements.rigid.is_empty() {
            true => None,
            false => Some(edges_of(model)?),
        };
        let (edge_rows, edge_columns) = match &own {
            None => (mesh_edges.rows.clone(), mesh_edges.columns.clone()),
            Some(kept) => (
                gpu.array_of("edge rows", Texel::U32x4, &kept.rows)?,
                gpu.array_of("edges of nodes", Texel::U32x4, &kept.columns)?,
            ),
        };
        let kept = own.as_ref().unwrap_or(mesh_edges.host_rows());
        let lists = Lists::new(model, kept, units)?;
        let rows = SlicedEllpack::from_lists(&lists.corners, Some(4 * count as u32))?;
        let places: Vec<[f32; 4]> = rest.iter().map(|x| x.extend(0.0).to_array()).collect();
        let array = |label: &str, len| gpu.array(label, Texel::F32x4, len);
        Ok(GpuElements {
            law: elements.law,
            count: count as u32,
            tets: gpu.array_of("tets", Texel::U32x4, &lists.tets)?,
            shapes: gpu.array_of("shapes", Texel::F32x4, &lists.shapes)?,
            rest: gpu.array_of("rest", Texel::F32x4, &places)?,
            rows: gpu.array_of("corner rows", Texel::U32x4, &rows.rows)?,
            corners: gpu.array_of("corners", Texel::U32x4, &rows.columns)?,
            edge_rows,
            edge_columns,
            matrix_texels: BLOCK_TEXELS * kept.stiffnesses.len(),
            edge_row_of: own.map_or(Vec::new(), |kept| kept.row_of().to_vec()),
            edges: gpu.array_of("edges", Texel::U32x4, &lists.edges)?,
            ends: lists.ends,
            around: gpu.array_of("tets of edges", Texel::U32, &lists.around)?,
            // One additional entry that stays zero.
            tet_forces: array("forces of tets", 4 * count + 1)?,
            params: ElementParams {
                drag: (elements.mass_damping * units.time) as f32,
                _pad0: 0,
            },
            damping_time: (model.damping_time / units.time) as f32,
        })
    }

    /// α of the force −α m v on every node, in local units.
    pub fn mass_damping(&self) -> f32 {
        self.params.drag
    }

    /// The edge rows, their columns, and the row of each node if there are rigid bodies.
    pub fn edges(&self) -> (&Array, &Array, &[u32]) {
        (&self.edge_rows, &self.edge_columns, &self.edge_row_of)
    }

    /// The two nodes of each edge, in the order of [`GpuElements::block_pass`].
    pub fn ends(&self) -> &[[u32; 2]] {
        &self.ends
    }

    /// Rest positions of the nodes.
    pub fn rest(&self) -> &Array {
        &self.rest
    }

    /// Number of tets.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Number of texels that [`GpuElements::curvature_pass`] writes.
    pub fn curvature_texels(&self) -> usize {
        CURVATURE_TEXELS * self.count as usize
    }

    /// The name of its constitutive model's file in `shaders/terms`.
    pub fn law(&self) -> &'static str {
        match self.law {
            ConstitutiveModel::NeoHookean => "neo_hookean",
            ConstitutiveModel::Corotated => "corotated",
        }
    }

    /// Binds the tet data of passes composed with the constitutive model.
    pub fn bind_law<'a>(&'a self, pass: PassBuilder<'a>) -> PassBuilder<'a> {
        pass.read(&self.tets).read(&self.shapes).read(&self.rest)
    }

    /// Builds the pass that computes the Hessian data of all tets at `positions`.
    pub fn curvature_pass(
        &self,
        gpu: &Gpu,
        positions: &Array,
        status: &wgpu::Buffer,
        curvatures: &Array,
    ) -> Result<Pass> {
        let name = format!("physics/tet_hessians {}", self.law());
        let params = CurvatureParams {
            tets: self.count,
            _pad0: 0,
        };
        let pass = gpu
            .pass(&name)
            .read(positions)
            .read(status)
            .write(curvatures)
            .params(&params);
        self.bind_law(pass).dispatch_items(self.count)
    }

    /// Builds the pass that computes the matrix blocks from `curvatures`, and those of tools if
    /// any, for a step of `dt` in local units.
    pub fn block_pass(
        &self,
        gpu: &Gpu,
        curvatures: &Array,
        status: &wgpu::Buffer,
        (matrix, dt, contact): (&Array, f32, Option<&GpuContact>),
    ) -> Result<Pass> {
        let params = EdgeParams {
            edges: self.edges.len(),
            scale: dt * (dt + self.damping_time),
        };
        let name = match contact {
            Some(_) => "physics/edge_blocks contact",
            None => "physics/edge_blocks",
        };
        let pass = gpu
            .pass(name)
            .read(&self.edges)
            .read(&self.around)
            .read(curvatures)
            .read(status)
            .write(matrix)
            .params(&params);
        match contact {
            Some(contact) => pass.read(&contact.edge_faces).read(&contact.faces),
            None => pass,
        }
        .dispatch_items(self.edges.len())
    }
}

impl GpuTerm for GpuElements {
    fn name(&self) -> &'static str {
        "elements"
    }

    fn bind<'a>(&'a self, pass: PassBuilder<'a>, part: ProgramPart<'a>) -> PassBuilder<'a> {
        match part {
            ProgramPart::Forces => pass
                .read(&self.rows)
                .read(&self.corners)
                .read(&self.tet_forces)
                .params(&self.params),
            ProgramPart::System { matrix, velocities } => pass
                .read(&self.edge_rows)
                .read(&self.edge_columns)
                .read(matrix)
                .read(velocities),
            ProgramPart::Product { matrix, .. } => pass
                .read(&self.edge_rows)
                .read(&self.edge_columns)
                .read(matrix),
        }
    }

    /// Builds the pass that computes the tet forces.
    fn prepare_forces(
        &self,
        gpu: &Gpu,
        positions: &Array,
        velocities: &Array,
        status: &wgpu::Buffer,
    ) -> Result<Option<Pass>> {
        let name = format!("physics/tet_forces {}", self.law());
        let params = TetForceParams {
            tets: self.count,
            damping_time: self.damping_time,
        };
        let pass = gpu
            .pass(&name)
            .read(positions)
            .read(velocities)
            .read(status)
            .write(&self.tet_forces)
            .params(&params);
        self.bind_law(pass).dispatch_items(self.count).map(Some)
    }

    fn matrix_texels(&self) -> usize {
        self.matrix_texels
    }

    fn texels(&self) -> u32 {
        TET_COST_IN_SPRINGS * self.edge_columns.len()
    }
}

/// The directed edges of the elements of `model`, in sliced ELLPACK.
fn edges_of(model: &DiscreteModel) -> Result<SlicedEllpack> {
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); model.rest_positions.len()];
    for element in model.tets() {
        for i in element.nodes {
            let others = element.nodes.iter().filter(|j| **j != i);
            neighbours[i as usize].extend(others);
        }
    }
    for row in &mut neighbours {
        row.sort_unstable();
        row.dedup();
    }
    SlicedEllpack::from_lists(&neighbours, None)
}

impl Lists {
    fn new(model: &DiscreteModel, kept: &SlicedEllpack, units: &LocalUnits) -> Result<Lists> {
        let mut lists = Lists {
            tets: Vec::new(),
            shapes: Vec::new(),
            corners: vec![Vec::new(); model.rest_positions.len()],
            edges: Vec::new(),
            ends: Vec::new(),
            around: Vec::new(),
        };
        // Each edge with its incident tets: tet number and local corners of the two ends.
        let mut edges: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
        for (e, element) in model.tets().iter().enumerate() {
            let e = e as u32;
            lists.tets.push(element.nodes);
            let [_, gradients @ ..] = element.gradients();
            let lame = element
                .lame_parameters
                .map(|l| l * element.volume / units.energy());
            let w = [lame[0], lame[1], 0.0];
            for (g, w) in gradients.iter().zip(w) {
                let g = (*g * units.length).as_vec3();
                lists.shapes.push(g.extend(w as f32).to_array());
            }
            for (a, i) in element.nodes.iter().enumerate() {
                lists.corners[*i as usize].push(4 * e + a as u32);
                for (b, j) in element.nodes.iter().enumerate() {
                    if i < j {
                        let corners = 4 * a as u32 + b as u32;
                        edges.entry([*i, *j]).or_default().push(16 * e + corners);
                    }
                }
            }
        }
        for ([i, j], tets) in edges {
            let first = lists.around.len() as u32;
            let (Some(there), Some(back)) = (kept.entry(i, j), kept.entry(j, i)) else {
                return Err(Error::Input(format!(
                    "a tet connects nodes {i} and {j}, but the body has no edge between them"
                )));
            };
            lists.edges.push([first, tets.len() as u32, there, back]);
            lists.ends.push([i, j]);
            lists.around.extend(tets);
        }
        Ok(lists)
    }
}
