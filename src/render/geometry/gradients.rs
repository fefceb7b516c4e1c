//! Gradients at the nodes, for light: made by a pass whenever the nodes have moved, where light is
//! on.

use super::{Geometry, Scalars};
use crate::gpu::{Array, Pass, Recorder, Texel};
use crate::mesh::{TetMesh, Topology};
use crate::render::light::{BOUNDARY_GRADIENT, NodeIncidence};
use crate::{Error, Result};

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/render/node_gradients.wgsl`.
        pub struct Gradients {
            pub nodes: u32,
            pub tets: u32,
            pub edge: f32,
        }
    }
}

/// What each node has around it, and the pass that makes gradients of that.
pub(super) struct Gradients {
    array: Array,
    pass: Pass,
    /// The version of the positions that they were made of.
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
        let items = gpu.array_of("what is around nodes", Texel::U32, &around.items)?;
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
    /// Makes ready for light: lists what is around every node, from which gradients are made
    /// whenever the nodes have moved. `mesh`, `topology` and `scalars` are those that it was made
    /// of. It takes some 20 bytes a tet, and cuts take longer to follow.
    ///
    /// # Errors
    /// [`Error::Input`] for other scalars than it has; [`Error::Gpu`] when the lists do not fit
    /// the device.
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
                "light needs the mesh and the scalars that the geometry was made of".into(),
            ));
        }
        self.build_gradients(mesh, topology, scalars)?;
        // What was prepared without them is prepared anew.
        self.generation += 1;
        Ok(())
    }

    /// The lists and gradients of the mesh as it is now.
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

    /// The gradients at the nodes, xyz in the local frame, where it was made ready for light: as of
    /// the last picture that was lit.
    pub fn gradients(&self) -> Option<&Array> {
        self.gradients.as_ref().map(|g| &g.array)
    }

    /// Has them made anew for the next picture that is lit.
    pub(super) fn invalidate_gradients(&mut self) {
        if let Some(gradients) = &mut self.gradients {
            gradients.made_of = None;
        }
    }

    /// Records the gradients of the nodes where they are now, if they have moved since the last, or
    /// other scalars are shown. Whether it did.
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
