//! A deformable body: a mesh's nodes, edges and elements on the GPU.

use super::contact::GpuContact;
use super::edges::GpuEdges;
use super::grab_lists::GrabLists;
use super::rigid::GpuRigid;
use super::terms::GpuDiscretisation;
use crate::gpu::{Array, Gpu, Texel};
use crate::mesh::TetMesh;
use crate::physics::loads::grab::{GrabId, GrabMode};
use crate::physics::loads::{LoadVersions, Loads};
use crate::physics::model::discrete_model::DiscreteModel;
use crate::physics::model::discretisation::Edge;
use crate::physics::model::material::Material;
use crate::physics::model::node_term::NodeTerm;
use crate::physics::model::units::LocalUnits;
use crate::physics::simulator::node_positions::NodePositions;
use crate::{Error, Result};
use glam::{DVec3, Vec3};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The next unique number of a body.
static BODIES: AtomicU64 = AtomicU64::new(0);

/// Counts changes of a body from outside.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::physics) struct ChangeCounter {
    /// Changes of positions or velocities.
    pub state: u64,
    /// Changes of positions, velocities, loads or pins.
    pub any: u64,
}

/// A mesh made of a material, on the GPU: state, masses, edges, forces.
///
/// Node i of the mesh is item i of every array. The interface uses file units for positions, file
/// units per second for velocities, and newtons for forces. Changes take effect with the next step.
#[derive(Debug)]
pub struct GpuBody {
    pub(in crate::physics) gpu: Gpu,
    pub(in crate::physics) id: u64,
    pub(in crate::physics) nodes: NodePositions,
    pub(in crate::physics) velocities: Array,
    /// Mass and inverse mass; the inverse is 0 for a pinned node and negative for a node of a
    /// moving rigid body.
    pub(in crate::physics) masses: Array,
    /// External forces, N.
    pub(in crate::physics) external: Array,
    pub(in crate::physics) edges: GpuEdges,
    /// The springs or finite elements.
    pub(in crate::physics) discretisation: GpuDiscretisation,
    /// Rigid regions, if any.
    pub(in crate::physics) rigid: Option<GpuRigid>,
    /// Tools and the boundary they press on, if any.
    pub(in crate::physics) contact: Option<GpuContact>,
    pub(in crate::physics) model: DiscreteModel,
    pub(in crate::physics) material: Material,
    terms: Vec<Arc<dyn NodeTerm>>,
    /// Parameters of the node terms, if any.
    pub(in crate::physics) node_terms: Option<wgpu::Buffer>,
    pub(in crate::physics) units: LocalUnits,
    pub(in crate::physics) loads: Loads,
    /// Versions of the loads on the GPU; `None` before the first upload (zero forces, no pins).
    pub(in crate::physics) uploaded_loads: Option<LoadVersions>,
    pub(in crate::physics) grabs: GrabLists,
    /// Number of cuts; bindings to the arrays and their lengths are valid for one generation.
    pub(in crate::physics) generation: u64,
    /// Whether steps may invert tets of a body without inverted ones.
    pub(in crate::physics) inversion_allowed: bool,
    /// Counts changes of positions and velocities from outside.
    pub(in crate::physics) state_changes: u64,
}

impl GpuBody {
    /// The body of `mesh` made of `material`: at rest, nothing pinned, no gravity.
    ///
    /// # Errors
    /// [`Error::Input`] if a material parameter is out of range, [`Error::Gpu`] if the mesh does
    /// not fit the device.
    pub fn new(gpu: &Gpu, mesh: &TetMesh, material: &Material) -> Result<GpuBody> {
        let model = DiscreteModel::new(mesh, material)?;
        GpuBody::from_model(gpu, mesh, model, material)
    }

    /// As [`GpuBody::new`], with a given model, for example that of a cage. A cut computes
    /// the new edges along it from `material`.
    ///
    /// # Errors
    /// [`Error::Input`] if `model` does not match `mesh`; otherwise as [`GpuBody::new`].
    pub fn from_model(
        gpu: &Gpu,
        mesh: &TetMesh,
        model: DiscreteModel,
        material: &Material,
    ) -> Result<GpuBody> {
        if model
            .elements()
            .is_some_and(|elements| elements.order() == 2)
        {
            return Err(Error::Input(
                "the GPU has no elements of order 2; use --engine cpu ([solver] engine = \"cpu\"), or order 1"
                    .into(),
            ));
        }
        let count = mesh.nodes.len();
        let strange = |e: &Edge| e.nodes.iter().any(|v| *v as usize >= count);
        let fits = model.rest_positions.len() == count && model.masses.len() == count;
        let corners = model.tets().iter().flat_map(|e| e.nodes);
        let fits = fits && corners.max().is_none_or(|v| (v as usize) < count);
        if !fits || model.edges.iter().any(strange) {
            return Err(Error::Input(format!(
                "the model, with masses of {} nodes, does not match the mesh of {count} nodes",
                model.masses.len()
            )));
        }
        let units = LocalUnits::from_model(&model);
        let nodes = NodePositions::new(gpu, mesh)?;
        let frame = nodes.frame();
        let rest: Vec<Vec3> = mesh.nodes.iter().map(|p| frame.to_local(*p)).collect();
        let edges = GpuEdges::new(gpu, &model, &rest, &units)?;
        let discretisation = GpuDiscretisation::new(gpu, &model, &rest, (&edges, &units))?;
        let rigid = GpuRigid::new(gpu, &model, (discretisation.elements(), &units))?;
        let mut body = GpuBody {
            loads: Loads::new(nodes.len(), frame, model.length_unit),
            uploaded_loads: None,
            grabs: GrabLists::default(),
            gpu: gpu.clone(),
            id: BODIES.fetch_add(1, Ordering::Relaxed),
            velocities: gpu.array_with_headroom("velocities", Texel::F32x4, nodes.len())?,
            masses: gpu.array_with_headroom("masses", Texel::F32x2, nodes.len())?,
            external: gpu.array_with_headroom("external forces", Texel::F32x4, nodes.len())?,
            edges,
            discretisation,
            rigid,
            contact: None,
            nodes,
            model,
            material: material.clone(),
            terms: Vec::new(),
            node_terms: None,
            units,
            generation: 0,
            inversion_allowed: false,
            state_changes: 0,
        };
        body.upload_changes()?;
        Ok(body)
    }

    /// Number of nodes.
    pub fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// The positions, for drawing.
    pub fn nodes(&self) -> &NodePositions {
        &self.nodes
    }

    /// The model in float64.
    pub fn model(&self) -> &DiscreteModel {
        &self.model
    }

    /// The units of the arrays on the GPU.
    pub fn units(&self) -> LocalUnits {
        self.units
    }

    /// Adds an energy term. Existing solvers of the body include it from their next step, after a
    /// restart.
    ///
    /// # Errors
    /// An error if the device rejects the work.
    pub fn add_term(&mut self, term: Arc<dyn NodeTerm>) -> Result<()> {
        // A term without its file in `shaders/terms` is rejected here, not in the middle of a run.
        crate::gpu::Shaders::compose(&format!(
            "{} {}",
            self.shader_name("physics/forces"),
            term.name()
        ))?;
        let (frame, unit) = self.loads.frame_and_unit();
        let all = self.terms.iter().chain([&term]);
        let numbers: Vec<[f32; 4]> = all
            .flat_map(|t| t.shader_parameters(&frame, &self.units, unit))
            .collect();
        self.node_terms = Some(self.gpu.buffer_of("node term parameters", &numbers)?);
        self.terms.push(term);
        self.generation += 1;
        self.mark_changed();
        Ok(())
    }

    /// The energy terms besides the springs or elements.
    pub fn terms(&self) -> &[Arc<dyn NodeTerm>] {
        &self.terms
    }

    /// Pins, forces, gravity and grabs.
    pub fn loads(&self) -> &Loads {
        &self.loads
    }

    /// Mutable access to [`GpuBody::loads`]; changes take effect with the next step.
    pub fn loads_mut(&mut self) -> &mut Loads {
        &mut self.loads
    }

    /// The nodes whose rest position, in file units, satisfies `where_`.
    pub fn nodes_where(&self, where_: impl Fn(DVec3) -> bool) -> Vec<u32> {
        let rest = self.model.rest_positions.iter().enumerate();
        rest.filter(|(_, x)| where_(self.model.to_file(**x)))
            .map(|(i, _)| i as u32)
            .collect()
    }

    /// Pins every node whose rest position, in file units, satisfies `where_`, at its present
    /// position. Returns the number of pinned nodes.
    pub fn pin(&mut self, where_: impl Fn(DVec3) -> bool) -> usize {
        let nodes = self.nodes_where(where_);
        // Cannot fail: these are nodes of the body.
        let _ = self.loads.pin_nodes(&nodes);
        self.loads.pinned().iter().filter(|p| **p).count()
    }

    /// As [`Loads::pin_nodes`].
    ///
    /// # Errors
    /// [`Error::Input`] if a node does not exist.
    pub fn pin_nodes(&mut self, nodes: &[u32]) -> Result<()> {
        self.loads.pin_nodes(nodes)
    }

    /// Clamps the end chosen by `DiscreteModel::find_clamped_end` and applies `gravity` (m/s²)
    /// across it. Returns a sentence that describes both.
    pub fn clamp_one_end(&mut self, gravity: f64) -> String {
        let (end, _) = self.model.find_clamped_end(DVec3::NEG_Z);
        // Cannot fail: these are nodes of the body.
        let _ = self.loads.pin_nodes(&end.nodes);
        self.loads.set_gravity(gravity * end.load_direction());
        let along = if end.axis == 2 { "-y" } else { "-z" };
        format!("clamped {end}; gravity of {gravity} m/s² acts along {along}")
    }

    /// Whether each node is pinned.
    pub fn pinned(&self) -> &[bool] {
        self.loads.pinned()
    }

    /// Sets whether steps may invert tets of elements; by default such a step fails unless the body
    /// had inverted tets before.
    pub fn set_inversion_allowed(&mut self, allowed: bool) {
        if self.inversion_allowed != allowed {
            self.inversion_allowed = allowed;
            // Clears a failure.
            self.mark_changed();
        }
    }

    /// Sets gravity, m/s² along the file's axes.
    pub fn set_gravity(&mut self, gravity: DVec3) {
        self.loads.set_gravity(gravity);
    }

    /// Gravity, m/s².
    pub fn gravity(&self) -> DVec3 {
        self.loads.gravity()
    }

    /// Sets the external force on every node, N, and uploads it.
    ///
    /// # Errors
    /// [`Error::Input`] if the number of forces is wrong or a force is not finite.
    pub fn set_forces(&mut self, forces: &[DVec3]) -> Result<()> {
        self.loads.set_forces(forces)?;
        self.write_forces()
    }

    /// Distributes the total `force` (N) equally over the nodes whose rest position, in file units,
    /// satisfies `where_`. Returns their number.
    ///
    /// # Errors
    /// [`Error::Input`] if the force is not finite or there are no such nodes.
    pub fn add_force(&mut self, force: DVec3, where_: impl Fn(DVec3) -> bool) -> Result<usize> {
        let nodes = self.nodes_where(where_);
        self.loads.add_force(force, &nodes)?;
        self.write_forces()?;
        Ok(nodes.len())
    }

    /// Grabs the nodes within `radius` of `centre`, in file units. Reads the positions back once.
    /// The nodes follow the target of the grab from the next step on.
    ///
    /// # Errors
    /// [`Error::Input`] if there are no nodes there, or a number is out of range.
    pub fn grab(&mut self, centre: DVec3, radius: f64, grip: GrabMode) -> Result<GrabId> {
        let positions = self.positions()?;
        self.loads
            .grab(&positions, |_| true, (centre, radius), grip)
    }

    /// As [`Loads::set_target`].
    ///
    /// # Errors
    /// [`Error::Input`] if the grab does not exist, or the target is not finite or too far from the
    /// body.
    pub fn set_target(&mut self, grab: GrabId, target: DVec3) -> Result<()> {
        self.loads.set_target(grab, target)
    }

    /// As [`Loads::release`].
    ///
    /// # Errors
    /// [`Error::Input`] if the grab does not exist.
    pub fn release(&mut self, grab: GrabId) -> Result<usize> {
        self.loads.release(grab)
    }

    /// The array of external forces, for callers that write them on the GPU: rgba32float, xyz in
    /// newtons along the file's axes. [`GpuBody::set_forces`] and [`GpuBody::add_force`] overwrite
    /// it; a cut may replace the array.
    pub fn force_array(&self) -> &Array {
        &self.external
    }

    /// The velocities on the GPU: rgba32float, xyz in local units (see [`LocalUnits`]).
    pub fn velocity_array(&self) -> &Array {
        &self.velocities
    }

    /// The masses on the GPU, in units of the mean mass: rg32float, mass and inverse mass. The
    /// inverse is 0 for fixed nodes and negative for nodes of moving rigid bodies.
    pub fn mass_array(&self) -> &Array {
        &self.masses
    }

    /// Reads back the positions in file units.
    ///
    /// # Errors
    /// As [`Gpu::read_array`].
    pub fn positions(&self) -> Result<Vec<DVec3>> {
        self.nodes.positions()
    }

    /// Reads back the velocities in file units per second. Verlet stores only the mean velocity
    /// over the last step.
    ///
    /// # Errors
    /// As [`Gpu::read_array`].
    pub fn velocities(&self) -> Result<Vec<DVec3>> {
        let local: Vec<[f32; 4]> = self.gpu.read_array(&self.velocities)?;
        let unit = self.units.velocity() / self.model.length_unit;
        Ok(local
            .iter()
            .map(|v| Vec3::new(v[0], v[1], v[2]).as_dvec3() * unit)
            .collect())
    }

    /// Moves the nodes to `positions`, in file units.
    ///
    /// # Errors
    /// As [`NodePositions::set_positions`].
    pub fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        self.nodes.set_positions(positions)?;
        self.mark_changed();
        Ok(())
    }

    /// Sets the velocities, in file units per second. Pinned nodes stay at rest.
    ///
    /// # Errors
    /// [`Error::Input`] if the number of velocities is wrong or one is not finite.
    pub fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()> {
        let unit = self.units.velocity() / self.model.length_unit;
        let local = self
            .nodes
            .check("velocities", velocities, |v| (v / unit).as_vec3())?;
        self.gpu.write_array(&self.velocities, &local)?;
        self.mark_changed();
        Ok(())
    }

    /// Marks positions and velocities as changed from outside, so that solvers restart from them.
    /// Not needed after writing [`GpuBody::force_array`].
    pub fn mark_changed(&mut self) {
        self.state_changes += 1;
        self.nodes.array().mark_written();
    }

    /// Version number that increases with every change from outside: state, pins, forces, grabs or
    /// topology. Writes to [`GpuBody::force_array`] do not count.
    pub fn change_count(&self) -> u64 {
        self.revision().any
    }

    pub(in crate::physics) fn revision(&self) -> ChangeCounter {
        let versions = self.loads.versions;
        ChangeCounter {
            state: self.state_changes + versions.grabs,
            any: self.state_changes + versions.any,
        }
    }

    /// Uploads the external forces that were set.
    pub(in crate::physics) fn write_forces(&mut self) -> Result<()> {
        let forces = self.loads.forces().iter();
        let texels: Vec<[f32; 4]> = forces.map(|f| f.as_vec3().extend(0.0).to_array()).collect();
        self.gpu.write_array(&self.external, &texels)?;
        if let Some(written) = &mut self.uploaded_loads {
            written.forces = self.loads.versions.forces;
        }
        Ok(())
    }

    /// Uploads changes made on the CPU.
    pub(in crate::physics) fn upload_changes(&mut self) -> Result<()> {
        let versions = self.loads.versions;
        let stale = self.grabs.has_springs() && self.grabs.source_versions[1] != versions.forces;
        if self.uploaded_loads == Some(versions) && !stale {
            return Ok(());
        }
        let known = self.uploaded_loads.unwrap_or_default();
        let first = self.uploaded_loads.is_none();
        let grabs = known.grabs != versions.grabs;
        let forces = known.forces != versions.forces;
        let listed = self.grabs.source_versions;
        if grabs || (self.grabs.has_springs() && listed != [versions.grabs, versions.forces]) {
            self.grabs = GrabLists::new(&self.gpu, &self.loads, |_| 1.0)?;
        }
        if forces || (grabs && !first) {
            self.write_forces()?;
        }
        if first || known.constraints != versions.constraints {
            self.upload_masses_and_fixed_nodes()?;
        }
        if let Some(contact) = self
            .contact
            .as_mut()
            .filter(|_| known.tools != versions.tools)
        {
            contact.set_tool_targets(&self.loads);
        }
        self.uploaded_loads = Some(versions);
        Ok(())
    }

    /// Uploads the masses with the constrained nodes.
    pub(in crate::physics) fn upload_masses_and_fixed_nodes(&self) -> Result<()> {
        let masses = self.model.masses.iter().zip(self.loads.constrained_nodes());
        let mut masses: Vec<[f32; 2]> = masses
            .map(|(mass, held)| self.local_mass(*mass, held))
            .collect();
        if let Some(rigid) = &self.rigid {
            rigid.write_constraints(&self.gpu, &self.loads, &mut masses)?;
        }
        self.gpu.write_array(&self.masses, &masses)
    }

    /// Mass and inverse mass of a node in the GPU's format.
    pub(in crate::physics) fn local_mass(&self, mass: f64, pinned: bool) -> [f32; 2] {
        let mass = (mass / self.units.mass) as f32;
        // A massless node has no equation of motion, so it is fixed.
        let free = !pinned && mass.is_normal() && (1.0 / mass).is_finite();
        [mass, if free { 1.0 / mass } else { 0.0 }]
    }
}
