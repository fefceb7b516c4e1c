//! Update of a geometry after cuts in its mesh.

use super::reordered::ReorderedMesh;
use super::{Geometry, Scalars, check_input, count_pass, share};
use crate::gpu::Array;
use crate::mesh::{NO_NEIGHBOUR, TetCut, TetMesh, Topology, replace_sorted};
use crate::{Error, Result};

impl Geometry {
    /// Applies a cut that produced `mesh` and `topology` from those of the geometry or of the
    /// previous cut; the next image shows the gap. `positions` are the current positions of the
    /// mesh, and `scalars` its values, of which only those of new nodes are read. Uploads the
    /// changed tets and the boundary from the first new face on; after a removal of tets, uploads
    /// everything.
    ///
    /// # Errors
    /// As [`Geometry::new`]; the geometry is unchanged if `mesh` is not the mesh after the cut.
    pub fn apply_cut<'a>(
        &mut self,
        mesh: &TetMesh,
        topology: &Topology,
        cut: &TetCut,
        positions: &Array,
        scalars: impl Into<Scalars<'a>>,
    ) -> Result<()> {
        let scalars = scalars.into();
        check_input(mesh, positions, scalars)?;
        let known = self.scalars.len() as usize;
        if matches!(scalars, Scalars::Cells(_)) != self.is_cell_scalar {
            return Err(Error::Input(
                "scalars of a cut must be at the nodes or in the tets as in the geometry; give scalars of the same kind"
                    .into(),
            ));
        }
        if known + cut.duplicated_nodes.len() != mesh.nodes.len()
            || self.tet_order.len() != mesh.tets.len() + cut.removed.len()
        {
            return Err(Error::Input(format!(
                "cut does not match the geometry: {known} nodes and {} tets, with {} nodes duplicated and {} tets removed, do not give a mesh of {} and {}; apply every cut in order",
                self.tet_order.len(),
                cut.duplicated_nodes.len(),
                cut.removed.len(),
                mesh.nodes.len(),
                mesh.tets.len()
            )));
        }
        if cut.is_empty() {
            return Ok(());
        }
        let generation = self.generation + 1;
        let (lit, remembers) = (self.gradients.is_some(), self.rests.is_some());
        if cut.removed.is_empty() {
            self.open(mesh, topology, cut, positions, scalars)?;
        } else {
            let gpu = self.gpu.clone();
            *self = Geometry::with_range(
                &gpu, mesh, topology, self.frame, positions, scalars, self.range,
            )?;
        }
        self.generation = generation;
        if lit {
            self.build_gradients(mesh, topology, scalars)?;
        }
        if remembers {
            self.store_rest_positions(mesh)?;
        }
        Ok(())
    }

    /// Implements [`Geometry::apply_cut`] for cuts without removed tets.
    fn open(
        &mut self,
        mesh: &TetMesh,
        topology: &Topology,
        cut: &TetCut,
        positions: &Array,
        scalars: Scalars,
    ) -> Result<()> {
        let gpu = self.gpu.clone();
        let known = self.scalars.len();
        let shares: Vec<f32> = match scalars {
            Scalars::Nodes(values) => {
                let new = values[known as usize..].iter();
                new.map(|s| share(*s, self.range)).collect()
            }
            Scalars::Cells(_) => vec![0.0; cut.duplicated_nodes.len()],
        };
        let nodes = mesh.nodes.len();
        let replaced = gpu.resize(&mut self.scalars, "scalars", nodes)?;
        gpu.write_items(&self.scalars, known, &shares)?;
        gpu.resize(&mut self.projected, "projected nodes", nodes)?;
        let moved_away = self.positions.texture() != positions.texture();
        self.positions = positions.clone();

        let placed = ReorderedMesh {
            mesh,
            topology,
            place: &self.tet_order,
        };
        let slot = |t: &u32| self.tet_order[*t as usize];
        let slots: Vec<u32> = cut.tets.iter().map(slot).collect();
        let tets: Vec<[u32; 4]> = cut.tets.iter().map(|t| mesh.tets[*t as usize]).collect();
        gpu.scatter_items(&self.tets, &slots, &tets)?;
        // A link stores the nodes of the neighbouring tet, so the links of neighbours change too.
        let behind = cut
            .tets
            .iter()
            .flat_map(|t| topology.neighbours[*t as usize]);
        let behind = behind
            .filter(|code| *code != NO_NEIGHBOUR)
            .map(|code| code / 4);
        let mut linked: Vec<u32> = cut.tets.iter().copied().chain(behind).collect();
        linked.sort_unstable();
        linked.dedup();
        let places: Vec<u32> = linked
            .iter()
            .flat_map(|t| [0, 1, 2, 3].map(|k| 4 * slot(t) + k))
            .collect();
        let links: Vec<[u32; 2]> = linked.iter().flat_map(|t| placed.links(*t)).collect();
        gpu.scatter_items(&self.links, &places, &links)?;

        let mut bare: Vec<[u32; 4]> = cut
            .tets
            .iter()
            .flat_map(|t| placed.boundary_faces(*t))
            .collect();
        bare.sort_unstable_by_key(|face| face[3]);
        let mut changed: Vec<u32> = slots
            .iter()
            .flat_map(|s| [0, 1, 2, 3].map(|f| 4 * s + f))
            .collect();
        changed.sort_unstable();
        replace_sorted(&mut self.boundary_faces, |face| face[3], &changed, &bare);
        gpu.resize(&mut self.boundary, "boundary", self.boundary_faces.len())?;
        let first_code = changed.first().copied().unwrap_or(0);
        let first = self.boundary_faces.partition_point(|f| f[3] < first_code);
        gpu.write_items(&self.boundary, first as u32, &self.boundary_faces[first..])?;

        if replaced || moved_away {
            self.count_inverted = count_pass(&gpu, positions, &self.tets, &self.inverted)?;
        }
        if let Some(mut records) = self.records.take() {
            records.follow(&gpu, self.sources())?;
            self.records = Some(records);
        }
        Ok(())
    }
}
