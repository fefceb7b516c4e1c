//! Scalar gradients at the nodes for lighting, computed by a GPU pass when the nodes have moved.

use super::{Geometry, Scalars};
use crate::gpu::{Array, Pass, Recorder, Texel};
use crate::mesh::{TetMesh, Topology};
use crate::render::light::{BOUNDARY_GRADIENT, NodeIncidence};
use crate::{Error, Result};

mod gpu_data {
    crate::gpu_struct! {
        /// Parameters of `shaders/render/node_gradients.wgsl`.
        pub struct Gradients {
            pub nodes: u32,
            pub tets: u32,
            pub edge: f32,
        }
    }
}

/// Incidence lists of the nodes, and the pass that computes gradients from them.
pub(super) struct Gradients {
    array: Array,
    pass: Pass,
    /// Version of the positions for which the gradients were computed.
    made_of: Option<u64>,
}

impl Gradients {
    fn new(
        geometry: &Geometry,
        mesh: &TetMesh,
        topology: &Topology,
        cells: Option<&[f64]>,
    ) -> Result<Gradients> {
        let gpu = &geometry.gpu;
        let around = NodeIncidence::new(mesh, topology, cells, |t| geometry.tet_order[t]);
        let firsts = gpu.array_of("first entries of nodes", Texel::U32, &around.firsts)?;
        let items = gpu.array_of("node incidence", Texel::U32, &around.items)?;
        let ends = gpu.array_of("faces at ends", Texel::U32x4, &around.boundary_faces)?;
        let nodes = mesh.nodes.len();
        let array = gpu.array("gradients at nodes", Texel::F32x4, nodes)?;
        let pass = gpu
            .pass("render/node_gradients")
            .read(&geometry.positions)
            .read(&geometry.scalars)
            .read(&firsts)
            .read(&items)
            .read(&geometry.tets)
            .read(&ends)
            .write(&array)
            .params(&gpu_data::Gradients {
                nodes: nodes as u32,
                tets: mesh.tets.len() as u32,
                edge: BOUNDARY_GRADIENT as f32,
            })
            .dispatch_items(nodes as u32)?;
        Ok(Gradients {
            array,
            pass,
            made_of: None,
        })
    }
}

impl Geometry {
    /// Enables lighting: builds the node incidence lists from which gradients are computed when the
    /// nodes have moved. `mesh`, `topology` and `scalars` must be those of the geometry. Uses about
    /// 20 bytes per tet, and makes cuts slower to apply.
    ///
    /// # Errors
    /// [`Error::Input`] if mesh or scalars do not match the geometry; [`Error::Gpu`] if the lists
    /// do not fit the device.
    pub fn enable_lighting<'a>(
        &mut self,
        mesh: &TetMesh,
        topology: &Topology,
        scalars: impl Into<Scalars<'a>>,
    ) -> Result<()> {
        let scalars = scalars.into();
        let items = mesh.nodes.len() == self.projected.len() as usize
            && mesh.tets.len() == self.tets.len() as usize;
        if !items || matches!(scalars, Scalars::Cells(_)) != self.is_cell_scalar {
            return Err(Error::Input(
                "mesh and scalars for lighting must match those of the geometry; pass the mesh and the kind of scalars it was created from".into(),
            ));
        }
        self.build_gradients(mesh, topology, scalars)?;
        // Invalidates draws built without gradients.
        self.generation += 1;
        Ok(())
    }

    /// Builds the incidence lists and gradients of the current mesh.
    pub(super) fn build_gradients(
        &mut self,
        mesh: &TetMesh,
        topology: &Topology,
        scalars: Scalars,
    ) -> Result<()> {
        let cells = match scalars {
            Scalars::Cells(values) => Some(values),
            Scalars::Nodes(_) => None,
        };
        self.gradients = Some(Gradients::new(self, mesh, topology, cells)?);
        Ok(())
    }

    /// Returns the gradients at the nodes, xyz in the local frame, as of the last lit image; `None`
    /// unless lighting is enabled.
    pub fn gradients(&self) -> Option<&Array> {
        self.gradients.as_ref().map(|g| &g.array)
    }

    /// Forces recomputation of the gradients for the next lit image.
    pub(super) fn invalidate_gradients(&mut self) {
        if let Some(gradients) = &mut self.gradients {
            gradients.made_of = None;
        }
    }

    /// Records the gradient pass if the nodes have moved or the scalars have changed since the last
    /// time; returns whether it did.
    pub(in crate::render) fn record_gradients(&mut self, work: &mut Recorder) -> bool {
        let version = Some(self.positions.version());
        if let Some(gradients) = &mut self.gradients
            && gradients.made_of != version
        {
            gradients.made_of = version;
            gradients.pass.record(work);
            return true;
        }
        false
    }
}
