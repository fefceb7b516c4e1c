//! Cutting of bodies on the GPU: uploads only what a cut has changed.

use super::rigid::GpuRigid;
use super::terms::GpuDiscretisation;
use crate::mesh::{Blade, TetCut, TetMesh, Topology, cut, remove};
use crate::physics::GpuBody;
use crate::{Error, Result};
use glam::{DVec3, Vec3};

impl GpuBody {
    /// Cuts the body along `blade` (file units) in its present configuration, together with `mesh`,
    /// from which it was built, and its `topology`; see [`cut`](crate::mesh::cut()). Waits for
    /// submitted work and reads positions and velocities back.
    ///
    /// Duplicated nodes take position, velocity and pin of their original, and share its mass and
    /// external force according to the tets on either side, which conserves mass and momentum. Springs
    /// follow the new edges. Solvers restart from positions and velocities with the next step; a
    /// `Geometry` or `Surface` that draws the body must be updated too. A blade that hits nothing
    /// changes nothing, see [`TetCut::is_empty`].
    ///
    /// # Errors
    /// As [`cut`](crate::mesh::cut()) and [`GpuBody::apply_cut`].
    pub fn cut(
        &mut self,
        mesh: &mut TetMesh,
        topology: &mut Topology,
        blade: &Blade,
    ) -> Result<TetCut> {
        self.check_mesh(mesh)?;
        let texels = self.nodes.local()?;
        let frame = self.nodes.frame();
        let positions: Vec<DVec3> = texels
            .iter()
            .map(|p| frame.to_file(Vec3::new(p[0], p[1], p[2])))
            .collect();
        let done = cut(mesh, topology, &positions, blade)?;
        self.apply_cut_with_positions(mesh, &done, &texels)?;
        Ok(done)
    }

    /// Removes `tets` from the body and from `mesh`, from which it was built; see
    /// [`remove`](crate::mesh::remove()). Nodes without tets stay where they are, without mass.
    ///
    /// # Errors
    /// As [`remove`](crate::mesh::remove()) and [`GpuBody::apply_cut`].
    pub fn remove(
        &mut self,
        mesh: &mut TetMesh,
        topology: &mut Topology,
        tets: &[u32],
    ) -> Result<TetCut> {
        self.check_mesh(mesh)?;
        let done = remove(mesh, topology, tets)?;
        self.apply_cut(mesh, &done)?;
        Ok(done)
    }

    /// Applies a cut that turned the body's mesh into `mesh`.
    ///
    /// # Errors
    /// [`Error::Input`] if `mesh` does not match, [`Error::Gpu`] if the device cannot hold the new
    /// arrays.
    pub fn apply_cut(&mut self, mesh: &TetMesh, cut: &TetCut) -> Result<()> {
        let texels = self.nodes.local()?;
        self.apply_cut_with_positions(mesh, cut, &texels)
    }

    /// [`GpuBody::apply_cut`] with the position texels given.
    fn apply_cut_with_positions(
        &mut self,
        mesh: &TetMesh,
        cut: &TetCut,
        positions: &[[f32; 4]],
    ) -> Result<()> {
        if cut.is_empty() {
            return self.check_mesh(mesh);
        }
        let edges = self.model.apply_cut(mesh, &self.material, cut)?;
        // Pins and releases that are not yet uploaded are sent together with the next step.
        let held = self.loads.versions.constraints;
        let known = self
            .uploaded_loads
            .is_some_and(|written| written.constraints == held);
        self.duplicate_nodes(cut, positions)?;
        let frame = self.nodes.frame();
        let rest = |v: u32| frame.to_local(mesh.nodes[v as usize]);
        if cut.removed.is_empty() {
            let node_count = self.nodes.len();
            let follower = (node_count, rest, &self.units);
            let replaced = self.edges.apply_cut(&self.gpu, cut, &edges, follower)?;
            if let GpuDiscretisation::Springs(springs) = &mut self.discretisation {
                springs.apply_cut(&self.gpu, &self.edges, &replaced)?;
            }
            let mass = |v: &u32| {
                let v = *v as usize;
                self.local_mass(self.model.masses[v], self.pinned()[v])
            };
            let masses: Vec<[f32; 2]> = cut.nodes.iter().map(mass).collect();
            self.gpu.scatter_items(&self.masses, &cut.nodes, &masses)?;
            if let (true, Some(written)) =
                (known && !self.loads.grabs.any(), &mut self.uploaded_loads)
            {
                written.constraints = self.loads.versions.constraints;
            }
        } else {
            let rest: Vec<Vec3> = (0..mesh.nodes.len() as u32).map(rest).collect();
            self.edges
                .rebuild(&self.gpu, &self.model, &rest, &self.units)?;
            if let GpuDiscretisation::Springs(springs) = &mut self.discretisation {
                springs.rebuild(&self.gpu, &self.edges)?;
            }
        }
        if self.model.elements().is_some() {
            let rest: Vec<Vec3> = (0..mesh.nodes.len() as u32).map(rest).collect();
            let with = (&self.edges, &self.units);
            self.discretisation = GpuDiscretisation::new(&self.gpu, &self.model, &rest, with)?;
            let made_of = (self.elements(), &self.units);
            let was = self.rigid.is_some();
            self.rigid = GpuRigid::new(&self.gpu, &self.model, made_of)?;
            if was {
                self.upload_masses_and_fixed_nodes()?;
            }
        }
        self.generation += 1;
        self.mark_changed();
        Ok(())
    }

    pub(in crate::physics) fn check_mesh(&self, mesh: &TetMesh) -> Result<()> {
        if mesh.nodes.len() == self.node_count() {
            return Ok(());
        }
        Err(Error::Input(format!(
            "cannot cut a body of {} nodes with a mesh of {}; give the mesh it was created from",
            self.node_count(),
            mesh.nodes.len()
        )))
    }

    /// Gives duplicated nodes the state of their originals, and distributes the loads.
    fn duplicate_nodes(&mut self, cut: &TetCut, positions: &[[f32; 4]]) -> Result<()> {
        let velocities: Vec<[f32; 4]> = self.gpu.read_array(&self.velocities)?;
        let of = |texels: &[[f32; 4]]| -> Vec<[f32; 4]> {
            let old = cut.duplicated_nodes.iter().map(|[_, old]| *old as usize);
            old.map(|old| texels[old]).collect()
        };
        let first = positions.len();
        let len = first + cut.duplicated_nodes.len();
        self.nodes.extend(&of(positions))?;
        let gpu = self.gpu.clone();
        gpu.resize(&mut self.velocities, "velocities", len)?;
        gpu.write_items(&self.velocities, first as u32, &of(&velocities))?;
        gpu.resize(&mut self.masses, "masses", len)?;
        gpu.resize(&mut self.external, "external forces", len)?;
        let shared = self.loads.apply_cut(cut, &self.model.masses);
        let from = if shared { 0 } else { first };
        let forces = self.loads.forces()[from..].iter();
        let texels: Vec<[f32; 4]> = forces.map(|f| f.as_vec3().extend(0.0).to_array()).collect();
        gpu.write_items(&self.external, from as u32, &texels)
    }
}
