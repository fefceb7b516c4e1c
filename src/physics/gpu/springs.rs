//! Springs as a term on the GPU; the CPU side of `shaders/terms/springs.wgsl`.

use super::edges::{GpuEdges, scatter};
use super::sliced_ellpack::Replaced;
use super::terms::{GpuTerm, ProgramPart};
use crate::Result;
use crate::gpu::{Array, Gpu, PassBuilder, Texel};
use crate::physics::model::discretisation::SpringNetwork;
use crate::physics::model::material::Damping;
use crate::physics::model::units::LocalUnits;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/terms/springs.wgsl`.
        pub struct SpringParams {
            pub damping: f32,
            pub damping_time: f32,
            pub axial: u32,
            pub _pad0: u32,
        }
    }
}
use gpu_data::SpringParams;

/// The springs along the edges of a body.
#[derive(Debug)]
pub(in crate::physics) struct GpuSprings {
    /// The arrays of the edges.
    rows: Array,
    columns: Array,
    /// Stiffness and rest length of every directed edge.
    springs: Array,
    params: SpringParams,
}

impl GpuSprings {
    /// The springs of `model`, with the stiffness-proportional damping `damping_time` (s), along
    /// `edges`.
    pub fn new(
        gpu: &Gpu,
        (model, damping_time): (&SpringNetwork, f64),
        (edges, units): (&GpuEdges, &LocalUnits),
    ) -> Result<GpuSprings> {
        let springs = &edges.host_rows().stiffnesses;
        Ok(GpuSprings {
            rows: edges.rows.clone(),
            columns: edges.columns.clone(),
            springs: gpu.array_of_with_headroom("springs", Texel::F32x2, springs)?,
            params: SpringParams {
                damping: (model.damping / units.damping()) as f32,
                damping_time: (damping_time / units.time) as f32,
                axial: u32::from(model.damping_kind == Damping::Axial),
                _pad0: 0,
            },
        })
    }

    /// Follows a cut that changed `edges` at the indices `replaced`.
    pub fn apply_cut(&mut self, gpu: &Gpu, edges: &GpuEdges, replaced: &Replaced) -> Result<()> {
        self.resize_arrays(gpu, edges)?;
        let springs = &edges.host_rows().stiffnesses;
        scatter(gpu, &self.springs, &replaced.stiffnesses, springs)
    }

    /// Rebuilds all springs along `edges`.
    pub fn rebuild(&mut self, gpu: &Gpu, edges: &GpuEdges) -> Result<()> {
        self.resize_arrays(gpu, edges)?;
        gpu.write_array(&self.springs, &edges.host_rows().stiffnesses)
    }

    /// Takes the arrays of `edges`, which may be new ones, and resizes its own to them.
    fn resize_arrays(&mut self, gpu: &Gpu, edges: &GpuEdges) -> Result<()> {
        (self.rows, self.columns) = (edges.rows.clone(), edges.columns.clone());
        let len = edges.host_rows().stiffnesses.len();
        gpu.resize(&mut self.springs, "springs", len)?;
        Ok(())
    }
}

impl GpuTerm for GpuSprings {
    fn name(&self) -> &'static str {
        "springs"
    }

    fn bind<'a>(&'a self, pass: PassBuilder<'a>, part: ProgramPart<'a>) -> PassBuilder<'a> {
        let pass = pass.read(&self.rows).read(&self.columns);
        match part {
            ProgramPart::Forces => pass.read(&self.springs).params(&self.params),
            ProgramPart::System { matrix, .. } => {
                pass.read(&self.springs).params(&self.params).write(matrix)
            }
            ProgramPart::Product { matrix, .. } => pass.read(matrix),
        }
    }

    /// One texel per directed spring.
    fn matrix_texels(&self) -> usize {
        self.springs.len() as usize
    }

    fn texels(&self) -> u32 {
        self.columns.len()
    }
}
