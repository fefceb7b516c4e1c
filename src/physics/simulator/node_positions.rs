//! Node positions on the GPU: all that is needed to draw a body.

use crate::gpu::{Array, Gpu, Positions, Texel};
use crate::mesh::{LocalFrame, TetMesh};
use crate::{Error, Result};
use glam::{DVec3, Vec3};

/// The positions of a mesh's nodes on the GPU, with or without physics.
///
/// Node i of the mesh is item i of the array, in the local frame. The version changes when they may
/// have moved; code that writes the texture by other means must call [`Array::mark_written`].
#[derive(Clone, Debug)]
pub struct NodePositions {
    gpu: Gpu,
    positions: Array,
    frame: LocalFrame,
    /// The positions last uploaded, and the version this created.
    put: Option<(u64, Vec<Vec3>)>,
}

impl<'a> From<&'a NodePositions> for Positions<'a> {
    fn from(nodes: &'a NodePositions) -> Positions<'a> {
        Positions {
            array: &nodes.positions,
            frame: nodes.frame,
        }
    }
}

impl NodePositions {
    /// The nodes of `mesh`, at rest.
    ///
    /// # Errors
    /// [`Error::Gpu`] if they do not fit the device.
    pub fn new(gpu: &Gpu, mesh: &TetMesh) -> Result<NodePositions> {
        let frame = LocalFrame::from_mesh(mesh);
        let put: Vec<Vec3> = mesh.nodes.iter().map(|p| frame.to_local(*p)).collect();
        let local: Vec<[f32; 4]> = put.iter().map(|p| p.extend(1.0).to_array()).collect();
        let positions = gpu.array_of_with_headroom("positions", Texel::F32x4, &local)?;
        Ok(NodePositions {
            gpu: gpu.clone(),
            put: Some((positions.version(), put)),
            positions,
            frame,
        })
    }

    /// The positions: rgba32float, xyz in the local frame; steps preserve w. A cut lengthens the
    /// array and may replace it.
    pub fn array(&self) -> &Array {
        &self.positions
    }

    /// The device of the array.
    pub(in crate::physics) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The local frame.
    pub fn frame(&self) -> LocalFrame {
        self.frame
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.positions.len() as usize
    }

    /// Whether there are no nodes.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Version number that changes whenever the nodes may have moved.
    pub fn version(&self) -> u64 {
        self.positions.version()
    }

    /// Moves the nodes to `positions`, in file units; sets w to 1.
    ///
    /// # Errors
    /// [`Error::Input`] if the number of positions is wrong or one is not finite.
    pub fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        let local = self.check("positions", positions, |p| self.frame.to_local(p))?;
        self.gpu.write_array(&self.positions, &local)?;
        let put = local.iter().map(|p| Vec3::new(p[0], p[1], p[2])).collect();
        self.put = Some((self.version(), put));
        Ok(())
    }

    /// The uploaded positions in file units, without reading back; `None` if they were moved on the
    /// device since.
    pub fn put(&self) -> Option<Vec<DVec3>> {
        let (version, put) = self.put.as_ref()?;
        (*version == self.version()).then(|| put.iter().map(|p| self.frame.to_file(*p)).collect())
    }

    /// The positions in file units; read back unless they were uploaded and have not changed since.
    ///
    /// # Errors
    /// As [`Gpu::read_array`].
    pub fn positions(&self) -> Result<Vec<DVec3>> {
        if let Some(put) = self.put() {
            return Ok(put);
        }
        let local: Vec<[f32; 4]> = self.gpu.read_array(&self.positions)?;
        Ok(local
            .iter()
            .map(|p| self.frame.to_file(Vec3::new(p[0], p[1], p[2])))
            .collect())
    }

    /// Reads back the texels of all nodes.
    pub(in crate::physics) fn local(&self) -> Result<Vec<[f32; 4]>> {
        self.gpu.read_array(&self.positions)
    }

    /// Appends nodes with these texels.
    pub(in crate::physics) fn extend(&mut self, texels: &[[f32; 4]]) -> Result<()> {
        let first = self.len();
        let len = first + texels.len();
        self.gpu.resize(&mut self.positions, "positions", len)?;
        self.gpu
            .write_items(&self.positions, first as u32, texels)?;
        Ok(())
    }

    /// Checks for one finite vector per node, and converts to texels with w = 1.
    pub(in crate::physics) fn check(
        &self,
        what: &str,
        values: &[DVec3],
        local: impl Fn(DVec3) -> Vec3,
    ) -> Result<Vec<[f32; 4]>> {
        if values.len() != self.len() {
            return Err(Error::Input(format!(
                "got {} {what} for {} nodes; give one per node",
                values.len(),
                self.len()
            )));
        }
        let local: Vec<Vec3> = values.iter().map(|v| local(*v)).collect();
        match local.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(Error::Input(format!(
                "{what}: the value of node {i} must be finite and in range, got {}",
                values[i]
            ))),
            None => Ok(local.iter().map(|v| v.extend(1.0).to_array()).collect()),
        }
    }
}
