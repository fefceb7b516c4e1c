//! The edges of a body on the GPU, at their nodes.

use super::sliced_ellpack::{DirectedEdge, Replaced, SlicedEllpack, directed_pair};
use crate::Result;
use crate::gpu::{Array, Gpu, Texel};
use crate::mesh::TetCut;
use crate::physics::model::discrete_model::DiscreteModel;
use crate::physics::model::discretisation::Edge;
use crate::physics::model::units::LocalUnits;
use glam::Vec3;

/// The edges of every node in sliced ELLPACK rows of directed edges.
#[derive(Debug)]
pub(in crate::physics) struct GpuEdges {
    pub rows: Array,
    pub columns: Array,
    /// CPU copy of both arrays, with the stiffness and rest length of every directed edge.
    host: SlicedEllpack,
}

impl GpuEdges {
    /// The edges of `model`, whose nodes rest at the local positions `rest`.
    pub fn new(
        gpu: &Gpu,
        model: &DiscreteModel,
        rest: &[Vec3],
        units: &LocalUnits,
    ) -> Result<GpuEdges> {
        let host = SlicedEllpack::new(model, rest, units)?;
        Ok(GpuEdges {
            rows: gpu.array_of_with_headroom("rows", Texel::U32x4, &host.rows)?,
            columns: gpu.array_of_with_headroom("columns", Texel::U32x4, &host.columns)?,
            host,
        })
    }

    /// The CPU copy of the rows.
    pub fn host_rows(&self) -> &SlicedEllpack {
        &self.host
    }

    /// Applies a cut that replaced the edges at duplicated nodes by `new`; the body has `nodes`
    /// nodes now. Returns the changed indices.
    pub fn apply_cut(
        &mut self,
        gpu: &Gpu,
        cut: &TetCut,
        new: &[Edge],
        (nodes, rest, units): (usize, impl Fn(u32) -> Vec3 + Copy, &LocalUnits),
    ) -> Result<Replaced> {
        let directed = new.iter().flat_map(|e| directed_pair(e, rest, units));
        let lists = self.lists_around(cut, nodes, directed);
        let replaced = self.host.replace(lists)?;
        self.resize_arrays(gpu)?;
        scatter(gpu, &self.rows, &replaced.rows, &self.host.rows)?;
        scatter(gpu, &self.columns, &replaced.columns, &self.host.columns)?;
        Ok(replaced)
    }

    /// Rebuilds all edges from `model`.
    pub fn rebuild(
        &mut self,
        gpu: &Gpu,
        model: &DiscreteModel,
        rest: &[Vec3],
        units: &LocalUnits,
    ) -> Result<()> {
        self.host = SlicedEllpack::new(model, rest, units)?;
        self.resize_arrays(gpu)?;
        gpu.write_array(&self.rows, &self.host.rows)?;
        gpu.write_array(&self.columns, &self.host.columns)
    }

    /// Resizes the arrays to the CPU copy.
    fn resize_arrays(&mut self, gpu: &Gpu) -> Result<()> {
        gpu.resize(&mut self.rows, "rows", self.host.rows.len())?;
        gpu.resize(&mut self.columns, "columns", self.host.columns.len())?;
        Ok(())
    }

    /// Returns the complete lists of every node with an edge at a duplicated node: unchanged edges
    /// and those of `new`.
    fn lists_around(
        &self,
        cut: &TetCut,
        nodes: usize,
        new: impl Iterator<Item = (u32, DirectedEdge)>,
    ) -> Vec<(u32, Vec<DirectedEdge>)> {
        let mut touched = vec![false; nodes];
        cut.nodes.iter().for_each(|v| touched[*v as usize] = true);
        // Index of each node's list plus one; 0 if it has none.
        let mut place = vec![0u32; nodes];
        let mut lists: Vec<(u32, Vec<DirectedEdge>)> = Vec::new();
        for (node, directed) in new {
            if place[node as usize] == 0 {
                let stay: Vec<DirectedEdge> = match touched[node as usize] {
                    true => Vec::new(),
                    false => {
                        let row = self.host.row(node);
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

/// Uploads the items of `host` at `places`.
pub(super) fn scatter<T: bytemuck::Pod>(
    gpu: &Gpu,
    array: &Array,
    places: &[u32],
    host: &[T],
) -> Result<()> {
    let items: Vec<T> = places.iter().map(|p| host[*p as usize]).collect();
    gpu.scatter_items(array, places, &items)
}
