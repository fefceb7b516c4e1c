//! Springs as a term on the GPU; the CPU side of `shaders/terms/springs.wgsl`.

use super::sliced_ellpack::{DirectedSpring, SlicedEllpack, directed_pair};
use super::terms::{GpuTerm, ProgramPart};
use crate::Result;
use crate::gpu::{Array, Gpu, PassBuilder, Texel};
use crate::mesh::TetCut;
use crate::physics::model::discrete_model::DiscreteModel;
use crate::physics::model::discretisation::Edge;
use crate::physics::model::material::Damping;
use crate::physics::model::units::LocalUnits;
use glam::Vec3;

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

/// The edges of every node in sliced ELLPACK rows of directed edges, with the springs along them;
/// [`GpuElements`](super::elements::GpuElements) use the rows only.
#[derive(Debug)]
pub(in crate::physics) struct GpuSprings {
    pub rows: Array,
    pub columns: Array,
    springs: Array,
    /// CPU copy of the three arrays.
    kept: SlicedEllpack,
    params: SpringParams,
}

impl GpuSprings {
    /// The edges of `network`, whose nodes rest at the local positions `rest`.
    pub fn new(
        gpu: &Gpu,
        network: &DiscreteModel,
        rest: &[Vec3],
        units: &LocalUnits,
    ) -> Result<Self> {
        let kept = SlicedEllpack::new(network, rest, units)?;
        let springs = network.springs().copied().unwrap_or_default();
        Ok(GpuSprings {
            rows: gpu.array_of_with_headroom("rows", Texel::U32x4, &kept.rows)?,
            columns: gpu.array_of_with_headroom("columns", Texel::U32x4, &kept.columns)?,
            springs: gpu.array_of_with_headroom("springs", Texel::F32x2, &kept.springs)?,
            kept,
            params: SpringParams {
                damping: (springs.damping / units.damping()) as f32,
                damping_time: (network.damping_time / units.time) as f32,
                axial: u32::from(springs.damping_kind == Damping::Axial),
                _pad0: 0,
            },
        })
    }

    /// The CPU copy of the rows.
    pub fn host_rows(&self) -> &SlicedEllpack {
        &self.kept
    }

    /// Applies a cut that replaced the edges at duplicated nodes by `new`; the body has `nodes`
    /// nodes now.
    pub fn apply_cut(
        &mut self,
        gpu: &Gpu,
        cut: &TetCut,
        new: &[Edge],
        (nodes, rest, units): (usize, impl Fn(u32) -> Vec3 + Copy, &LocalUnits),
    ) -> Result<()> {
        let directed = new.iter().flat_map(|s| directed_pair(s, rest, units));
        let lists = self.lists_around(cut, nodes, directed);
        let replaced = self.kept.replace(lists)?;
        self.resize_arrays(gpu)?;
        let kept = &self.kept;
        put(gpu, &self.rows, &replaced.rows, &kept.rows)?;
        put(gpu, &self.columns, &replaced.columns, &kept.columns)?;
        put(gpu, &self.springs, &replaced.springs, &kept.springs)
    }

    /// Rebuilds all edges from `network`.
    pub fn rebuild(
        &mut self,
        gpu: &Gpu,
        network: &DiscreteModel,
        rest: &[Vec3],
        units: &LocalUnits,
    ) -> Result<()> {
        self.kept = SlicedEllpack::new(network, rest, units)?;
        self.resize_arrays(gpu)?;
        gpu.write_array(&self.rows, &self.kept.rows)?;
        gpu.write_array(&self.columns, &self.kept.columns)?;
        gpu.write_array(&self.springs, &self.kept.springs)
    }

    /// Resizes the arrays to the CPU copy.
    fn resize_arrays(&mut self, gpu: &Gpu) -> Result<()> {
        let kept = &self.kept;
        gpu.resize(&mut self.rows, "rows", kept.rows.len())?;
        gpu.resize(&mut self.columns, "columns", kept.columns.len())?;
        gpu.resize(&mut self.springs, "springs", kept.springs.len())?;
        Ok(())
    }

    /// Returns the complete spring lists of every node with a spring at a duplicated node:
    /// unchanged springs and those of `new`.
    fn lists_around(
        &self,
        cut: &TetCut,
        nodes: usize,
        new: impl Iterator<Item = (u32, DirectedSpring)>,
    ) -> Vec<(u32, Vec<DirectedSpring>)> {
        let mut touched = vec![false; nodes];
        cut.nodes.iter().for_each(|v| touched[*v as usize] = true);
        // Index of each node's list plus one; 0 if it has none.
        let mut place = vec![0u32; nodes];
        let mut lists: Vec<(u32, Vec<DirectedSpring>)> = Vec::new();
        for (node, directed) in new {
            if place[node as usize] == 0 {
                let stay: Vec<DirectedSpring> = match touched[node as usize] {
                    true => Vec::new(),
                    false => {
                        let row = self.kept.row(node);
                        row.filter(|other| !touched[other.0 as usize]).collect()
                    }
                };
                lists.push((node, stay));
                place[node as usize] = lists.len() as u32;
            }
            lists[place[node as usize] as usize - 1].1.push(directed);
        }
        lists
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

/// Uploads the items of `kept` at `places`.
fn put<T: bytemuck::Pod>(gpu: &Gpu, array: &Array, places: &[u32], kept: &[T]) -> Result<()> {
    let items: Vec<T> = places.iter().map(|p| kept[*p as usize]).collect();
    gpu.scatter_items(array, places, &items)
}
