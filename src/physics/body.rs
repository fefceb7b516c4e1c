//! A deformable body: a mesh's nodes and springs on the GPU.

use super::grab::{GrabId, Grabs, Grip};
use super::material::Material;
use super::network::{Spring, SpringNetwork};
use super::nodes::Nodes;
use super::rows::Rows;
use super::units::Units;
use crate::gpu::{Array, Gpu, Texel};
use crate::mesh::TetMesh;
use crate::{Error, Result};
use glam::{DVec3, Vec3};
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU64, Ordering};

/// Gives every body its own number.
static BODIES: AtomicU64 = AtomicU64::new(0);

/// Counts what was done to a body from outside.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Revision {
    /// Changes of positions or velocities.
    pub state: u64,
    /// These, and changes of loads and pins.
    pub any: u64,
}

/// A mesh made of a material, on the GPU: state, masses, springs, forces.
///
/// Node i of the mesh is item i of every array. Positions and velocities go in and come out in
/// file units (and file units a second), forces in newtons. Changes made here take effect with
/// the next step.
#[derive(Debug)]
pub struct Body {
    pub(super) gpu: Gpu,
    pub(super) id: u64,
    pub(super) nodes: Nodes,
    pub(super) velocities: Array,
    /// Mass and inverse mass; the inverse is 0 for a pinned node.
    pub(super) masses: Array,
    /// Newtons.
    pub(super) external: Array,
    pub(super) rows: Array,
    pub(super) columns: Array,
    pub(super) springs: Array,
    /// What the three arrays above hold.
    pub(super) kept_rows: Rows,
    pub(super) network: SpringNetwork,
    pub(super) material: Material,
    pub(super) units: Units,
    gravity: DVec3,
    pub(super) pinned: Vec<bool>,
    pub(super) forces: Vec<[f32; 4]>,
    pub(super) masses_changed: bool,
    pub(super) grabs: Grabs,
    /// Counts cuts: what is bound to the arrays or their lengths is made for one generation.
    pub(super) generation: u64,
    /// Counts changes of positions and velocities from outside, and changes of any kind.
    revision: Revision,
}

impl Body {
    /// The body that `mesh` is when made of `material`: at rest, nothing pinned, no gravity.
    ///
    /// # Errors
    /// [`Error::Input`] for a material that makes no sense, [`Error::Gpu`] when the mesh does not
    /// fit the device.
    pub fn new(gpu: &Gpu, mesh: &TetMesh, material: &Material) -> Result<Body> {
        let network = SpringNetwork::new(mesh, material)?;
        Body::of_network(gpu, mesh, network, material)
    }

    /// As [`Body::new`], with masses and springs of one's own: those of a cage, for example. A cut
    /// takes the springs along it from `material` again.
    ///
    /// # Errors
    /// [`Error::Input`] when `network` is not one of `mesh`; otherwise as [`Body::new`].
    pub fn of_network(
        gpu: &Gpu,
        mesh: &TetMesh,
        network: SpringNetwork,
        material: &Material,
    ) -> Result<Body> {
        let count = mesh.nodes.len();
        let strange = |s: &Spring| s.nodes.iter().any(|v| *v as usize >= count);
        let fits = network.rest.len() == count && network.masses.len() == count;
        if !fits || network.springs.iter().any(strange) {
            return Err(Error::Input(format!(
                "masses of {} nodes and their springs are given for a mesh of {count}",
                network.masses.len()
            )));
        }
        let units = Units::of(&network);
        let nodes = Nodes::new(gpu, mesh)?;
        let frame = nodes.frame();
        let rest: Vec<Vec3> = mesh.nodes.iter().map(|p| frame.to_local(*p)).collect();
        let rows = Rows::new(&network, &rest, &units)?;
        let zero = vec![[0.0f32; 4]; nodes.len()];
        let grabs = Grabs::new(gpu, frame, network.length_unit);
        let mut body = Body {
            grabs,
            gpu: gpu.clone(),
            id: BODIES.fetch_add(1, Ordering::Relaxed),
            velocities: gpu.roomy_array("velocities", Texel::F32x4, nodes.len())?,
            masses: gpu.roomy_array("masses", Texel::F32x2, nodes.len())?,
            external: gpu.roomy_array("external forces", Texel::F32x4, nodes.len())?,
            rows: gpu.roomy_array_of("rows", Texel::U32x4, &rows.rows)?,
            columns: gpu.roomy_array_of("columns", Texel::U32x4, &rows.columns)?,
            springs: gpu.roomy_array_of("springs", Texel::F32x2, &rows.springs)?,
            kept_rows: rows,
            pinned: vec![false; nodes.len()],
            nodes,
            network,
            material: material.clone(),
            units,
            gravity: DVec3::ZERO,
            forces: zero,
            masses_changed: true,
            generation: 0,
            revision: Revision::default(),
        };
        body.flush()?;
        Ok(body)
    }

    /// Number of nodes.
    pub fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// The positions, for drawing.
    pub fn nodes(&self) -> &Nodes {
        &self.nodes
    }

    /// Masses and springs in float64.
    pub fn network(&self) -> &SpringNetwork {
        &self.network
    }

    /// The units of the arrays on the GPU.
    pub fn units(&self) -> Units {
        self.units
    }

    /// Pins every node whose rest position, in file units, satisfies `where_`: it stays where it
    /// is from now on. Returns how many nodes are pinned now.
    pub fn pin(&mut self, where_: impl Fn(DVec3) -> bool) -> usize {
        for (pinned, x) in self.pinned.iter_mut().zip(&self.network.rest) {
            *pinned |= where_(self.network.to_file(*x));
        }
        self.masses_changed = true;
        self.loads_changed();
        self.pinned_count()
    }

    /// Pins the nodes listed.
    ///
    /// # Errors
    /// [`Error::Input`] for a node that does not exist.
    pub fn pin_nodes(&mut self, nodes: &[u32]) -> Result<()> {
        let count = self.node_count();
        if let Some(bad) = nodes.iter().find(|v| **v as usize >= count) {
            return Err(Error::Input(format!(
                "node {bad} cannot be pinned: there are {count} nodes, counted from 0"
            )));
        }
        for v in nodes {
            self.pinned[*v as usize] = true;
        }
        self.masses_changed = true;
        self.loads_changed();
        Ok(())
    }

    /// Holds the body by the end that suits it ([`SpringNetwork::held_end`]) and lets `gravity`
    /// (m/s²) act across it. Returns a sentence that says so.
    pub fn hold_one_end(&mut self, gravity: f64) -> String {
        let (end, _) = self.network.held_end(DVec3::NEG_Z);
        for v in &end.nodes {
            self.pinned[*v as usize] = true;
        }
        self.masses_changed = true;
        self.set_gravity(gravity * end.across());
        let along = if end.axis == 2 { "-y" } else { "-z" };
        format!("held {end}; gravity of {gravity} m/s² acts along {along}")
    }

    /// Lets every node go.
    pub fn unpin_all(&mut self) {
        self.pinned.fill(false);
        self.masses_changed = true;
        self.loads_changed();
    }

    /// Which nodes are pinned.
    pub fn pinned(&self) -> &[bool] {
        &self.pinned
    }

    fn pinned_count(&self) -> usize {
        self.pinned.iter().filter(|p| **p).count()
    }

    /// Sets gravity, m/s² along the file's axes.
    pub fn set_gravity(&mut self, gravity: DVec3) {
        self.gravity = gravity;
        self.loads_changed();
    }

    /// Gravity, m/s².
    pub fn gravity(&self) -> DVec3 {
        self.gravity
    }

    /// Sets the external force on every node, N.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of forces or one that is not finite.
    pub fn set_forces(&mut self, forces: &[DVec3]) -> Result<()> {
        self.forces = self.nodes.check("forces", forces, |f| f.as_vec3())?;
        self.grabs.touch();
        self.gpu.write_array(&self.external, &self.forces)?;
        self.loads_changed();
        Ok(())
    }

    /// The external force on every node as it was set or added, N.
    pub fn forces(&self) -> Vec<DVec3> {
        let forces = self.forces.iter();
        forces
            .map(|f| Vec3::new(f[0], f[1], f[2]).as_dvec3())
            .collect()
    }

    /// Adds `force` (N in all) in equal shares to the nodes whose rest position, in file units,
    /// satisfies `where_`. Returns how many they are.
    ///
    /// # Errors
    /// [`Error::Input`] when the force is not finite or there are no such nodes.
    pub fn add_force(&mut self, force: DVec3, where_: impl Fn(DVec3) -> bool) -> Result<usize> {
        let rest = self.network.rest.iter().enumerate();
        let chosen: Vec<usize> = rest
            .filter(|(_, x)| where_(self.network.to_file(**x)))
            .map(|(i, _)| i)
            .collect();
        if chosen.is_empty() || !force.is_finite() {
            return Err(Error::Input(format!(
                "a force of {force} N on {} nodes cannot be applied",
                chosen.len()
            )));
        }
        self.grabs.touch();
        let share = (force / chosen.len() as f64).as_vec3();
        for i in &chosen {
            for (axis, f) in share.to_array().iter().enumerate() {
                self.forces[*i][axis] += f;
            }
        }
        self.gpu.write_array(&self.external, &self.forces)?;
        self.loads_changed();
        Ok(chosen.len())
    }

    /// Grabs the nodes within `radius` of `centre`, file units: reads the positions back once.
    /// They follow the target of the grab from the next step on.
    ///
    /// # Errors
    /// [`Error::Input`] where there is nothing to grab, or for numbers that make no sense.
    pub fn grab(&mut self, centre: DVec3, radius: f64, grip: Grip) -> Result<GrabId> {
        let positions = self.positions()?;
        let held: BTreeSet<u32> = self.grabs.held().collect();
        let pinned = &self.pinned;
        let free = |i: usize| !pinned[i] && !held.contains(&(i as u32));
        let grab = self.grabs.add(&positions, free, centre, radius, grip)?;
        self.changed();
        Ok(grab)
    }

    /// Moves the target of a grab, in file units: its nodes follow with the next step.
    ///
    /// # Errors
    /// [`Error::Input`] for a grab that is not there, or a target that is no point near the body.
    pub fn set_target(&mut self, grab: GrabId, target: DVec3) -> Result<()> {
        if self.grabs.set_target(grab, target)? {
            self.changed();
        }
        Ok(())
    }

    /// Lets go of a grab's nodes. Returns how many they are.
    ///
    /// # Errors
    /// [`Error::Input`] for a grab that is not there.
    pub fn release(&mut self, grab: GrabId) -> Result<usize> {
        let nodes = self.grabs.release(grab)?;
        self.changed();
        Ok(nodes)
    }

    /// The external force on every node, for callers who write it on the GPU: rgba32float, xyz in
    /// newtons along the file's axes. [`Body::set_forces`] and [`Body::add_force`] overwrite it;
    /// a cut may put another array in its place.
    pub fn force_array(&self) -> &Array {
        &self.external
    }

    /// The velocities on the GPU: rgba32float, xyz in local units (see [`Units`]).
    pub fn velocity_array(&self) -> &Array {
        &self.velocities
    }

    /// Positions in file units, read back.
    ///
    /// # Errors
    /// As [`Gpu::read_array`].
    pub fn positions(&self) -> Result<Vec<DVec3>> {
        self.nodes.positions()
    }

    /// Velocities in file units a second, read back. Of Verlet, which has no other: the mean over
    /// the last step.
    ///
    /// # Errors
    /// As [`Gpu::read_array`].
    pub fn velocities(&self) -> Result<Vec<DVec3>> {
        let local: Vec<[f32; 4]> = self.gpu.read_array(&self.velocities)?;
        let unit = self.units.velocity() / self.network.length_unit;
        Ok(local
            .iter()
            .map(|v| Vec3::new(v[0], v[1], v[2]).as_dvec3() * unit)
            .collect())
    }

    /// Moves the nodes to `positions`, in file units.
    ///
    /// # Errors
    /// As [`Nodes::set_positions`].
    pub fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        self.nodes.set_positions(positions)?;
        self.changed();
        Ok(())
    }

    /// Sets the velocities, in file units a second. Pinned nodes stay at rest.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of velocities or one that is not finite.
    pub fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()> {
        let unit = self.units.velocity() / self.network.length_unit;
        let local = self
            .nodes
            .check("velocities", velocities, |v| (v / unit).as_vec3())?;
        self.gpu.write_array(&self.velocities, &local)?;
        self.changed();
        Ok(())
    }

    /// Says that positions or velocities were changed from outside: the solvers start afresh from
    /// what they find. Not needed after writing [`Body::force_array`].
    pub fn changed(&mut self) {
        self.revision.state += 1;
        self.revision.any += 1;
        self.nodes.mark_moved();
    }

    /// What acts on the body has changed, not where it is: schemes that live on their last step
    /// go on with it.
    fn loads_changed(&mut self) {
        self.revision.any += 1;
    }

    /// A number that changes whenever the body is changed from outside: its state, pins, forces,
    /// grabs or shape. What is written to [`Body::force_array`] does not count.
    pub fn touched(&self) -> u64 {
        self.revision.any
    }

    pub(super) fn set_revision(&mut self, revision: Revision) {
        self.revision = revision;
    }

    pub(super) fn revision(&self) -> Revision {
        self.revision
    }

    pub(super) fn mark_moved(&mut self) {
        self.nodes.mark_moved();
    }

    /// Uploads what was changed on the CPU only.
    pub(super) fn flush(&mut self) -> Result<()> {
        if self.grabs.flush(&self.forces, |_| 1.0)? {
            self.gpu.write_array(&self.external, &self.forces)?;
            self.masses_changed = true;
        }
        if !self.masses_changed {
            return Ok(());
        }
        let mut held = self.pinned.clone();
        self.grabs.held().for_each(|i| held[i as usize] = true);
        let masses: Vec<[f32; 2]> = self
            .network
            .masses
            .iter()
            .zip(&held)
            .map(|(mass, pinned)| self.local_mass(*mass, *pinned))
            .collect();
        self.gpu.write_array(&self.masses, &masses)?;
        self.masses_changed = false;
        Ok(())
    }

    /// A node's mass and inverse mass as the GPU has them.
    pub(super) fn local_mass(&self, mass: f64, pinned: bool) -> [f32; 2] {
        let mass = (mass / self.units.mass) as f32;
        // A massless node has no equation of motion: it stays.
        let free = !pinned && mass.is_normal() && (1.0 / mass).is_finite();
        [mass, if free { 1.0 / mass } else { 0.0 }]
    }
}
