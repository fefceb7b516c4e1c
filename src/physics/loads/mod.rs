//! Constraints and loads of a body, independent of the engine.

pub(super) mod fibre_points;
pub(super) mod force_balance;
pub(super) mod grab;
pub(super) mod grab_state;
pub(super) mod prescribed_motion;
pub(super) mod reactions;
pub(super) mod scaled_load;
mod tools;

use super::AmplitudeId;
use super::contact::ToolPose;
use super::loads::grab::{Grab, GrabId, GrabMode, Grabs};
use super::loads::prescribed_motion::PrescribedMotion;
use super::loads::reactions::GrabbedNode;
use crate::mesh::{LocalFrame, TetCut};
use crate::physics::loads::grab_state::GrabsState;
use crate::{Error, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Version numbers of the loads, by which engines detect changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct LoadVersions {
    /// All loads.
    pub any: u64,
    /// Grabs: moved targets.
    pub grabs: u64,
    /// External forces.
    pub forces: u64,
    /// Constrained nodes: pinned, or held by a grab.
    pub constraints: u64,
    /// Amplitudes.
    pub levels: u64,
    /// Tool targets.
    pub tools: u64,
}

/// Pins, grabs, gravity and forces, by the body's node numbers, in the same form for every engine;
/// changes take effect with the next step.
///
/// Positions are in file units, forces in newtons, gravity in m/s², all along the file's axes.
#[derive(Clone, Debug)]
pub struct Loads {
    frame: LocalFrame,
    length_unit: f64,
    gravity: DVec3,
    forces: Vec<DVec3>,
    pinned: Vec<bool>,
    pub(super) grabs: Grabs,
    prescribed_motions: Vec<PrescribedMotion>,
    levels: Vec<f64>,
    /// Targets of the tools, and how often each was teleported.
    tools: Vec<(ToolPose, u64)>,
    pub(super) versions: LoadVersions,
}

/// The serialisable state of [`Loads`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct LoadsState {
    gravity: [f64; 3],
    forces: Vec<[f64; 3]>,
    pinned: Vec<bool>,
    grabs: GrabsState,
    #[serde(rename = "led")]
    prescribed_motions: Vec<PrescribedMotion>,
    levels: Vec<f64>,
    tools: Vec<(ToolPose, u64)>,
    versions: LoadVersions,
}

impl Loads {
    /// No loads on `nodes` nodes; `length_unit` is metres per file unit.
    pub(super) fn new(nodes: usize, frame: LocalFrame, length_unit: f64) -> Loads {
        Loads {
            frame,
            length_unit,
            gravity: DVec3::ZERO,
            forces: vec![DVec3::ZERO; nodes],
            pinned: vec![false; nodes],
            grabs: Grabs::new(frame),
            prescribed_motions: Vec::new(),
            levels: Vec::new(),
            tools: Vec::new(),
            versions: LoadVersions::default(),
        }
    }

    pub(super) fn frame(&self) -> LocalFrame {
        self.frame
    }

    pub(super) fn length_unit(&self) -> f64 {
        self.length_unit
    }

    /// The local frame of the mesh, and metres per file unit.
    pub fn frame_and_unit(&self) -> (LocalFrame, f64) {
        (self.frame, self.length_unit)
    }

    /// Version number that increases with every change of a load.
    pub fn version(&self) -> u64 {
        self.versions.any
    }

    /// Whether each node is pinned.
    pub fn pinned(&self) -> &[bool] {
        &self.pinned
    }

    /// Pins the listed nodes at their present positions.
    ///
    /// # Errors
    /// [`Error::Input`] if a node does not exist.
    pub fn pin_nodes(&mut self, nodes: &[u32]) -> Result<()> {
        let count = self.pinned.len();
        if let Some(bad) = nodes.iter().find(|v| **v as usize >= count) {
            return Err(Error::Input(format!(
                "cannot pin node {bad}: the body has {count} nodes, numbered from 0"
            )));
        }
        for v in nodes {
            self.pinned[*v as usize] = true;
        }
        self.versions.constraints += 1;
        self.versions.any += 1;
        Ok(())
    }

    /// Unpins all nodes.
    pub fn unpin_all(&mut self) {
        self.pinned.fill(false);
        self.versions.constraints += 1;
        self.versions.any += 1;
    }

    /// Sets gravity, m/s².
    pub fn set_gravity(&mut self, gravity: DVec3) {
        self.gravity = gravity;
        self.versions.any += 1;
    }

    /// Gravity, m/s².
    pub fn gravity(&self) -> DVec3 {
        self.gravity
    }

    /// Sets the external force on every node, N.
    ///
    /// # Errors
    /// [`Error::Input`] if the number of forces is wrong or a force is not finite.
    pub fn set_forces(&mut self, forces: &[DVec3]) -> Result<()> {
        if forces.len() != self.forces.len() {
            return Err(Error::Input(format!(
                "got {} forces for {} nodes; give one per node",
                forces.len(),
                self.forces.len()
            )));
        }
        if let Some(i) = forces.iter().position(|f| !f.as_vec3().is_finite()) {
            return Err(Error::Input(format!(
                "forces: the value of node {i} must be finite and in range, got {}",
                forces[i]
            )));
        }
        self.forces.copy_from_slice(forces);
        self.forces_changed();
        Ok(())
    }

    /// The external force on every node as set or added, N.
    pub fn forces(&self) -> &[DVec3] {
        &self.forces
    }

    /// Distributes the total `force` (N) equally over `nodes`.
    ///
    /// # Errors
    /// [`Error::Input`] if the force is not finite, or a node does not exist.
    pub fn add_force(&mut self, force: DVec3, nodes: &[u32]) -> Result<()> {
        let strange = nodes.iter().any(|v| *v as usize >= self.forces.len());
        if nodes.is_empty() || strange || !force.is_finite() {
            return Err(Error::Input(format!(
                "cannot apply a force of {force} N to {} nodes; give a finite force and at least one node, all existing",
                nodes.len()
            )));
        }
        let share = force / nodes.len() as f64;
        for v in nodes {
            self.forces[*v as usize] += share;
        }
        self.forces_changed();
        Ok(())
    }

    fn forces_changed(&mut self) {
        self.versions.forces += 1;
        self.versions.any += 1;
    }

    /// Grabs the unconstrained nodes within `radius` of `centre` for which `there` is true;
    /// `positions` are the present ones.
    pub(super) fn grab(
        &mut self,
        positions: &[DVec3],
        there: impl Fn(usize) -> bool,
        (centre, radius): (DVec3, f64),
        grip: GrabMode,
    ) -> Result<GrabId> {
        let free: Vec<bool> = self.constrained_nodes().iter().map(|held| !held).collect();
        let free = |i: usize| free[i] && there(i);
        let grab = self.grabs.add(positions, free, centre, radius, grip)?;
        self.grabs_changed();
        Ok(grab)
    }

    /// Moves the target of a grab; its nodes follow with the next step.
    ///
    /// # Errors
    /// [`Error::Input`] if the grab does not exist, or the target is not finite or too far from the
    /// body.
    pub fn set_target(&mut self, grab: GrabId, target: DVec3) -> Result<()> {
        if self.grabs.set_target(grab, target)? {
            self.versions.grabs += 1;
            self.versions.any += 1;
        }
        Ok(())
    }

    /// The nodes held by a grab.
    ///
    /// # Errors
    /// [`Error::Input`] if the grab does not exist.
    pub fn grabbed_nodes(&self, grab: GrabId) -> Result<Vec<GrabbedNode>> {
        self.grabs.held_by(grab)
    }

    /// Releases a grab. Returns the number of its nodes.
    ///
    /// # Errors
    /// [`Error::Input`] if the grab does not exist.
    pub fn release(&mut self, grab: GrabId) -> Result<usize> {
        let nodes = self.grabs.release(grab)?;
        self.grabs_changed();
        Ok(nodes)
    }

    /// Whether springs hold nodes.
    pub(crate) fn has_spring_grabs(&self) -> bool {
        let is_spring = |grab: &Grab| grab.grip != GrabMode::Follow;
        self.grabs.iter().any(is_spring)
    }

    fn grabs_changed(&mut self) {
        self.versions.grabs += 1;
        self.versions.constraints += 1;
        self.versions.any += 1;
    }

    /// Adds an amplitude with the value 0.
    pub(super) fn add_amplitude(&mut self) -> AmplitudeId {
        self.levels.push(0.0);
        self.versions.levels += 1;
        self.versions.any += 1;
        AmplitudeId(self.levels.len() - 1)
    }

    pub(crate) fn amplitudes(&self) -> &[f64] {
        &self.levels
    }

    /// Sets an amplitude, which the body has to accept.
    pub(crate) fn set_amplitude(&mut self, id: AmplitudeId, level: f64) {
        if let Some(own) = self.levels.get_mut(id.0).filter(|own| **own != level) {
            *own = level;
            self.versions.levels += 1;
            self.versions.any += 1;
        }
    }

    /// Whether each node is constrained: pinned, or held by a grab.
    pub(super) fn constrained_nodes(&self) -> Vec<bool> {
        let mut held = self.pinned.clone();
        let prescribed = self
            .prescribed_motions
            .iter()
            .flat_map(|motion| motion.nodes().iter().copied());
        self.grabs
            .held()
            .chain(prescribed)
            .for_each(|i| held[i as usize] = true);
        held
    }

    /// Whether the position of each node is given: pinned, moved, or held exactly by a grab.
    pub(crate) fn fixed_nodes(&self) -> Vec<bool> {
        let mut fixed = self.pinned.clone();
        let moved = self
            .prescribed_motions
            .iter()
            .flat_map(|motion| motion.nodes().iter().copied());
        let followers = self.grabs.iter().filter(|g| g.grip == GrabMode::Follow);
        let followers = followers.flat_map(|grab| grab.nodes.iter().copied());
        moved
            .chain(followers)
            .for_each(|i| fixed[i as usize] = true);
        fixed
    }

    /// Returns gravity, forces and the springs of grabs on the nodes of these masses (kg) at
    /// `positions` (file units), N; without pressures.
    pub(super) fn static_forces(&self, masses: &[f64], positions: &[DVec3]) -> Vec<DVec3> {
        let given = self.forces.iter().zip(masses);
        let mut forces: Vec<DVec3> = given.map(|(f, m)| *f + *m * self.gravity).collect();
        for held in self.grabs.iter().flat_map(|grab| grab.held()) {
            if let GrabMode::Spring { stiffness, limit } = held.grip {
                let v = held.node as usize;
                let stretch = (held.place - positions[v]) * self.length_unit;
                forces[v] += (stiffness * stretch).clamp_length_max(limit);
            }
        }
        forces
    }

    /// Updates the loads after a cut: duplicated nodes are pinned as their originals, and forces
    /// are distributed by `masses`, those after the cut. Returns whether a force was distributed.
    pub(super) fn apply_cut(&mut self, cut: &TetCut, masses: &[f64]) -> bool {
        for [_, old] in &cut.duplicated_nodes {
            self.pinned.push(self.pinned[*old as usize]);
        }
        for motion in &mut self.prescribed_motions {
            motion.apply_cut(cut);
        }
        self.forces.resize(masses.len(), DVec3::ZERO);
        let mut shared = false;
        for doubles in cut.duplicated_nodes.chunk_by(|a, b| a[1] == b[1]) {
            let old = doubles[0][1] as usize;
            let force = self.forces[old];
            if force == DVec3::ZERO {
                continue;
            }
            shared = true;
            let nodes = || doubles.iter().map(|d| d[0] as usize).chain([old]);
            let total_mass: f64 = nodes().map(|v| masses[v]).sum();
            for v in nodes() {
                let share = if total_mass > 0.0 {
                    masses[v] / total_mass
                } else {
                    0.0
                };
                self.forces[v] = share * force;
            }
        }
        self.versions.constraints += 1;
        self.versions.any += 1;
        if self.grabs.any() {
            // Masses and loads around the cut have changed, so those of held nodes are computed
            // again.
            self.versions.grabs += 1;
        }
        shared
    }

    pub(super) fn state(&self) -> LoadsState {
        LoadsState {
            gravity: self.gravity.to_array(),
            forces: self.forces.iter().map(|f| f.to_array()).collect(),
            pinned: self.pinned.clone(),
            grabs: self.grabs.state(),
            prescribed_motions: self.prescribed_motions.clone(),
            levels: self.levels.clone(),
            tools: self.tools.clone(),
            versions: self.versions,
        }
    }

    /// Restores a state from [`Loads::state`] of a body with the same number of nodes.
    pub(super) fn set_state(&mut self, state: &LoadsState) -> Result<()> {
        let nodes = self.pinned.len();
        if state.pinned.len() != nodes || state.forces.len() != nodes {
            return Err(Error::Input(format!(
                "the saved loads are of {} nodes, but the body has {nodes}",
                state.pinned.len()
            )));
        }
        let alike = state.prescribed_motions.len() == self.prescribed_motions.len()
            && state.levels.len() == self.levels.len()
            && state.tools.len() == self.tools.len()
            && state
                .prescribed_motions
                .iter()
                .zip(&self.prescribed_motions)
                .all(|(a, b)| a.fits(b));
        if !alike {
            return Err(Error::Input(
                "the saved loads are of a body with other prescribed motions, pressures, muscles or tools".into(),
            ));
        }
        self.grabs.set_state(&state.grabs, nodes)?;
        self.prescribed_motions
            .clone_from(&state.prescribed_motions);
        self.levels.clone_from(&state.levels);
        self.tools.clone_from(&state.tools);
        self.gravity = state.gravity.into();
        self.forces = state.forces.iter().map(|f| DVec3::from(*f)).collect();
        self.pinned.clone_from(&state.pinned);
        self.versions = state.versions;
        Ok(())
    }
}
