//! A grid body on the GPU: its state, loads and grabs.

use super::verlet::{BufferIndices, GrabPasses, InFlightSteps, Prepared, STATUS};
use crate::gpu::{Array, Gpu, ReadbackRing, Texel};
use crate::mesh::{NO_NORMAL, TetMesh};
use crate::physics::gpu::grab_lists::GrabLists;
use crate::physics::grid::model::GridModel;
use crate::physics::loads::LoadVersions;
use crate::physics::{GrabId, GrabMode, Loads, NodePositions, Report};
use crate::{Error, Result};
use glam::{DVec3, Vec3};
use std::collections::VecDeque;

/// A [`GridModel`] on the GPU. Node i of [`GridBody::nodes`] is particle i of its shape.
#[derive(Debug)]
pub struct GridBody {
    pub(in crate::physics) gpu: Gpu,
    pub(in crate::physics) model: GridModel,
    pub(in crate::physics) mesh: TetMesh,
    /// Its array is the first of the three position arrays.
    pub(in crate::physics) nodes: NodePositions,
    pub(in crate::physics) positions: [Array; 3],
    pub(in crate::physics) normals: Array,
    pub(in crate::physics) particles: Array,
    pub(in crate::physics) external: Array,
    pub(in crate::physics) velocities: Array,
    /// Backups of the positions, restored after a failure.
    pub(in crate::physics) backup: [Array; 2],
    pub(in crate::physics) status: wgpu::Buffer,
    pub(in crate::physics) buffers: BufferIndices,
    pub(in crate::physics) mean_mass: f64,
    pub(in crate::physics) loads: Loads,
    /// Versions of the loads on the GPU.
    pub(in crate::physics) written: Option<LoadVersions>,
    /// Whether the step passes read the external forces.
    pub(in crate::physics) has_forces: bool,
    /// Length of the step from `before` to the present positions; `None` if `before` must be
    /// computed from the velocities.
    pub(in crate::physics) previous_dt: Option<f64>,
    pub(in crate::physics) dirty: bool,
    pub(in crate::physics) prepared: Option<Prepared>,
    grabs: GrabLists,
    /// The grab passes for each of the three arrays.
    pub(in crate::physics) grab_passes: GrabPasses,
    pub(in crate::physics) steps: u64,
    pub(in crate::physics) time: f64,
    /// Counts changes from outside, except changes of loads.
    pub(in crate::physics) changes: u64,
    /// Root mean square speed at the last check, in body sizes per second.
    pub(in crate::physics) speed: f64,
    /// Requested steps that are not yet submitted, and their length in s.
    pub(in crate::physics) pending_steps: VecDeque<(u32, f64)>,
    /// Submitted steps, whose status is being read back.
    pub(in crate::physics) in_flight: Option<InFlightSteps>,
    pub(in crate::physics) ring: ReadbackRing,
}

impl GridBody {
    /// The body of `model`, at rest.
    ///
    /// # Errors
    /// [`Error::Gpu`] if it does not fit the device; [`Error::Input`] if no cell is complete.
    pub fn new(gpu: &Gpu, model: GridModel) -> Result<GridBody> {
        let mesh = model.shape.mesh(&model.springs)?;
        let nodes = NodePositions::new(gpu, &mesh)?;
        let rest = rest(&model, &mesh);
        gpu.write_array(nodes.array(), &rest)?;
        let total = rest.len();
        let [before, next] = [
            gpu.array_of("previous positions", Texel::F32x4, &rest)?,
            gpu.array_of("next positions", Texel::F32x4, &rest)?,
        ];
        let count = model.shape.count();
        let mass: f64 = model.masses.iter().sum();
        let mut body = GridBody {
            gpu: gpu.clone(),
            positions: [nodes.array().clone(), before, next],
            normals: gpu.array_of("approximate normals", Texel::U32, &vec![NO_NORMAL; total])?,
            particles: gpu.array("particles", Texel::U32x4, count)?,
            external: gpu.array("external forces", Texel::F32x4, total)?,
            velocities: gpu.array("velocities", Texel::F32x4, total)?,
            backup: [
                gpu.array("backup", Texel::F32x4, total)?,
                gpu.array("backup of previous positions", Texel::F32x4, total)?,
            ],
            status: gpu.buffer("grid status", STATUS)?,
            buffers: BufferIndices::FIRST,
            mean_mass: mass / count as f64,
            loads: Loads::new(total, model.frame, model.length_unit),
            written: None,
            has_forces: false,
            previous_dt: None,
            dirty: true,
            prepared: None,
            grabs: GrabLists::default(),
            grab_passes: GrabPasses::default(),
            steps: 0,
            time: 0.0,
            changes: 0,
            speed: 0.0,
            pending_steps: VecDeque::new(),
            in_flight: None,
            ring: ReadbackRing::new(gpu, STATUS),
            model,
            mesh,
            nodes,
        };
        let normals = body.rest_normals()?;
        gpu.write_array(&body.normals, &normals)?;
        Ok(body)
    }

    /// Rest positions in the GPU's format.
    pub(in crate::physics) fn rest(&self) -> Vec<[f32; 4]> {
        rest(&self.model, &self.mesh)
    }

    /// Creates an array of undefined normals.
    pub(in crate::physics) fn undefined_normals(&self) -> Result<Array> {
        let none = vec![NO_NORMAL; self.mesh.nodes.len()];
        self.gpu.array_of("rest normals", Texel::U32, &none)
    }

    /// The masses and springs.
    pub fn model(&self) -> &GridModel {
        &self.model
    }

    /// The tets of the complete cells at rest, to be drawn at the positions of [`GridBody::nodes`].
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    /// The positions, for drawing. Their fourth component is the particle's relative stiffness.
    pub fn nodes(&self) -> &NodePositions {
        &self.nodes
    }

    /// The approximate normals of the particles after the last step, packed (see
    /// [`pack_normal`](crate::mesh::pack_normal)).
    pub fn normals(&self) -> &Array {
        &self.normals
    }

    /// Pins, forces, gravity and grabs. Loads on empty grid points have no effect.
    pub fn loads(&self) -> &Loads {
        &self.loads
    }

    /// Mutable access to [`GridBody::loads`]; changes take effect with the next step.
    pub fn loads_mut(&mut self) -> &mut Loads {
        &mut self.loads
    }

    /// As [`Loads::pin_nodes`].
    ///
    /// # Errors
    /// [`Error::Input`] if a particle does not exist.
    pub fn pin_nodes(&mut self, particles: &[u32]) -> Result<()> {
        self.loads.pin_nodes(particles)
    }

    /// Whether each particle is pinned.
    pub fn pinned(&self) -> &[bool] {
        self.loads.pinned()
    }

    /// Sets gravity, m/s² along the file's axes.
    pub fn set_gravity(&mut self, gravity: DVec3) {
        self.loads.set_gravity(gravity);
    }

    /// Sets the damping rate γ, 1/s.
    ///
    /// # Errors
    /// [`Error::Input`] if the rate is negative or not finite.
    pub fn set_damping(&mut self, rate: f64) -> Result<()> {
        if !(rate.is_finite() && rate >= 0.0) {
            return Err(Error::Input(format!(
                "damping rate must be finite and ≥ 0, got {rate} 1/s"
            )));
        }
        self.model.damping = rate;
        self.changes += 1;
        self.prepared = None;
        Ok(())
    }

    /// As [`Loads::set_forces`].
    ///
    /// # Errors
    /// [`Error::Input`] if the number of forces is wrong or a force is not finite.
    pub fn set_forces(&mut self, forces: &[DVec3]) -> Result<()> {
        self.loads.set_forces(forces)
    }

    /// Moves the particles to `positions` in file units and sets their velocities to zero.
    ///
    /// # Errors
    /// As [`NodePositions::set_positions`].
    pub fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        let frame = self.nodes.frame();
        let mut local = self
            .nodes
            .check("positions", positions, |p| frame.to_local(p))?;
        for (p, k) in local.iter_mut().zip(&self.model.stiffness_scales) {
            p[3] = *k as f32;
        }
        for array in &self.positions {
            self.gpu.write_array(array, &local)?;
        }
        self.buffers = BufferIndices::FIRST;
        // The backups of the steps in flight are no longer valid.
        self.in_flight = None;
        self.set_velocities(&vec![DVec3::ZERO; local.len()])?;
        self.refresh_normals()
    }

    /// Sets the velocities, in file units per second.
    ///
    /// # Errors
    /// [`Error::Input`] if the number of velocities is wrong or one is not finite.
    pub fn set_velocities(&mut self, velocities: &[DVec3]) -> Result<()> {
        let scale = self.model.frame.scale;
        let local = self
            .nodes
            .check("velocities", velocities, |v| (v / scale).as_vec3())?;
        self.gpu.write_array(&self.velocities, &local)?;
        self.changes += 1;
        self.previous_dt = None;
        Ok(())
    }

    /// Reads back the positions of all particles in file units; empty grid points keep their
    /// initial positions.
    ///
    /// # Errors
    /// As [`Gpu::read_array`].
    pub fn positions(&self) -> Result<Vec<DVec3>> {
        self.nodes.positions()
    }

    /// Reads back the mean velocities of the last step, in file units per second.
    ///
    /// # Errors
    /// As [`Gpu::read_array`].
    pub fn velocities(&self) -> Result<Vec<DVec3>> {
        let vectors = |array: &Array| -> Result<Vec<DVec3>> {
            let read: Vec<[f32; 4]> = self.gpu.read_array(array)?;
            Ok(read
                .iter()
                .map(|p| Vec3::new(p[0], p[1], p[2]).as_dvec3() * self.model.frame.scale)
                .collect())
        };
        let Some(lag) = self.previous_dt else {
            return vectors(&self.velocities);
        };
        let now = vectors(&self.positions[self.buffers.now])?;
        let before = vectors(&self.positions[self.buffers.before])?;
        Ok(now
            .iter()
            .zip(before)
            .map(|(a, b)| (*a - b) / lag)
            .collect())
    }

    /// Computes energies, volume and displacement from the state read back. Volume and inverted
    /// tets refer to the tets of the complete cells.
    ///
    /// # Errors
    /// As [`Gpu::read_array`].
    pub fn report(&self) -> Result<Report> {
        let positions = self.positions()?;
        let velocities = self.velocities()?;
        let energy = self.model.energy(&positions, &velocities);
        Ok(Report::from_positions(energy, &self.mesh, &positions))
    }

    /// Version number that increases with every change from outside: state, pins, forces, grabs or
    /// springs.
    pub fn change_count(&self) -> u64 {
        self.changes + self.loads.version()
    }

    /// Mass-weighted root mean square speed after the last [`GridBody::run`], in body sizes per
    /// second.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Number of steps known to be completed, and the simulated time in s.
    pub fn clock(&self) -> (u64, f64) {
        let flight = self.in_flight.as_ref();
        flight.map_or((self.steps, self.time), |flight| flight.clock)
    }

    /// Grabs the particles within `radius` of `centre`, in file units. Reads the positions back
    /// once.
    ///
    /// # Errors
    /// [`Error::Input`] if there are no particles there, or a number is out of range.
    pub fn grab(&mut self, centre: DVec3, radius: f64, grip: GrabMode) -> Result<GrabId> {
        let positions = self.positions()?;
        let regions = &self.model.shape.regions;
        let there = |i: usize| regions[i] != 0;
        self.loads.grab(&positions, there, (centre, radius), grip)
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

    /// Uploads changes made on the CPU: grabs, parameters, springs and inverse masses.
    pub(in crate::physics) fn upload_changes(&mut self) -> Result<()> {
        let versions = self.loads.versions;
        if !self.dirty && self.written == Some(versions) {
            return Ok(());
        }
        let known = self.written.unwrap_or_default();
        if self.written.is_none()
            || known.grabs != versions.grabs
            || known.forces != versions.forces
        {
            let factors = &self.model.stiffness_scales;
            self.grabs = GrabLists::new(&self.gpu, &self.loads, |i| factors[i] as f32)?;
            let forces = self.loads.forces().iter();
            let texels: Vec<[f32; 4]> =
                forces.map(|f| f.as_vec3().extend(0.0).to_array()).collect();
            self.gpu.write_array(&self.external, &texels)?;
            self.grab_passes =
                GrabPasses::new(&self.gpu, &self.grabs, &self.positions, &self.external)?;
            let loaded = self.loads.forces().iter().any(|f| *f != DVec3::ZERO);
            let forced = loaded || self.grabs.has_springs();
            if forced != self.has_forces {
                self.has_forces = forced;
                self.prepared = None;
            }
        }
        if self.dirty || known.constraints != versions.constraints {
            self.write_particles()?;
        }
        self.written = Some(versions);
        Ok(())
    }

    fn write_particles(&mut self) -> Result<()> {
        let held = self.loads.constrained_nodes();
        let particles: Vec<[u32; 4]> = self
            .model
            .shape
            .particles()
            .map(|i| {
                let inverse = match held[i] {
                    true => 0.0,
                    false => (self.mean_mass / self.model.masses[i]) as f32,
                };
                [i as u32, self.model.springs[i], inverse.to_bits(), 0]
            })
            .collect();
        self.gpu.write_array(&self.particles, &particles)?;
        self.dirty = false;
        Ok(())
    }
}

/// Rest positions in the local frame, and the relative stiffness of each particle.
fn rest(model: &GridModel, mesh: &TetMesh) -> Vec<[f32; 4]> {
    let places = mesh.nodes.iter().zip(&model.stiffness_scales);
    places
        .map(|(p, k)| model.frame.to_local(*p).extend(*k as f32).to_array())
        .collect()
}
