//! The `[cage]` entry: a coarse body that is simulated in place of the mesh embedded in it.

use super::Scene;
use super::default_load::ChosenSupport;
#[cfg(feature = "cli")]
use super::schema;
use super::simulator::{SimulatorSetup, choose_step, stable_damping};
use super::time_dependent_loads::TimeDependentLoads;
use crate::cage::{Cage, CageKind, EmbeddedSimulator};
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::{
    DiscreteModel, Material, MaterialModel, Simulator, SolverKind, safe_step_ratio,
};
use crate::{Error, Result};
use glam::DVec3;
use serde::Deserialize;

/// Default number of nodes.
const NODES: usize = 2000;

/// A cage: a coarse body built from the mesh and its material and simulated in its place. The mesh
/// is embedded in it and drawn. Pins, forces, grabs and materials are those of the mesh; a lattice
/// uses the material model of the mesh, a grid uses springs.
///
/// ```toml
/// [cage]
/// nodes = 2000            # approximate number
/// kind = "lattice"        # tets, for any solver; or "grid": particles with springs, stepped by verlet
/// # damping = 8.0         # mass-proportional damping rate of a grid, 1/s
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct CageEntry {
    /// Approximate number of nodes; default 2,000.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 2000, "minimum" = 8, "maximum" = 4_000_000, "examples" = [5000])))]
    pub nodes: Option<usize>,
    /// Kind of discretisation.
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::cage_kind", extend("default" = "lattice", "examples" = ["grid"])))]
    pub kind: Option<CageKind>,
    /// Damping rate of a grid, 1/s; default: that of the lowest vibration mode of the mesh.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "1/s", "minimum" = 0.0, "examples" = [8.0])))]
    pub damping: Option<f64>,
}

/// Returns a flag per node, set for those in `nodes`.
fn flags(nodes: &[u32], count: usize) -> Vec<bool> {
    let mut flags = vec![false; count];
    for v in nodes {
        flags[*v as usize] = true;
    }
    flags
}

impl Scene {
    /// Creates the simulator of a cage in which `mesh` of `material` is embedded.
    pub(super) fn caged_simulator(
        &self,
        gpu: &Gpu,
        entry: &CageEntry,
        kind: SolverKind,
        mesh: TetMesh,
        material: &Material,
        notes: &mut Vec<String>,
    ) -> Result<SimulatorSetup> {
        let form = entry.kind.unwrap_or_default();
        self.check_cage(entry, form, kind, material)?;
        let fine = DiscreteModel::new(&mesh, material)?;
        let mut cage = Cage::new(&mesh, &fine, form, entry.nodes.unwrap_or(NODES))?;
        let (held, end) = self.held(&mesh, &fine)?;
        let mut own = Vec::new();
        for nodes in &held {
            own.extend(cage.coarse_nodes_for(nodes));
        }
        let fine_pinned = flags(&held.concat(), mesh.nodes.len());
        let pinned = flags(&own, cage.mesh.nodes.len());
        let forces = self.forces(&mesh, &fine.masses)?;
        // The step of an explicit scheme is not known yet, so the load is chosen as for an implicit
        // one.
        let dt = choose_step(self.solver.dt, None, 1.0, notes);
        let implicit = SolverKind::Implicit;
        let fine_held = Some((&fine, fine_pinned.as_slice()));
        let pull = self.default_load(implicit, fine_held, end, forces.as_deref(), dt, notes);
        let gravity = pull.gravity;
        let load = forces.as_ref().map(|forces| -> Vec<DVec3> {
            let both = forces.iter().zip(&fine.masses);
            both.map(|(f, m)| *f + *m * gravity).collect()
        });
        cage.fit_stiffness(&fine, &fine_pinned, &pinned, load.as_deref())?;
        let report = cage.report();
        notes.push(format!(
            "cage: {form} of {} nodes ({}) in which the {} nodes of the mesh are embedded; stiffness scaled by {:.3} to match the deflection of the mesh",
            report.nodes,
            material.model,
            mesh.nodes.len(),
            report.stiffness_scale
        ));
        let forces = forces
            .map(|f| cage.transfer().apply_transpose(&f))
            .transpose()?;
        let grid = cage.grid.is_some();
        let mut inner = self.cage_body(gpu, entry, kind, &mut cage, material, notes)?;
        inner.pin_nodes(&own)?;
        inner.loads_mut().set_gravity(gravity);
        if let Some(forces) = &forces {
            inner.set_forces(forces)?;
        }
        let dt = match kind == implicit {
            true => pull.dt,
            false => {
                let limit = match self.solver.dt {
                    Some(_) => None,
                    None => inner.largest_stable_step(),
                };
                let ratio = safe_step_ratio(inner.model());
                choose_step(self.solver.dt, limit, ratio, notes)
            }
        };
        Ok(SimulatorSetup {
            simulator: Box::new(EmbeddedSimulator::new(gpu, mesh, cage, inner)?),
            dt,
            cage: Some(report),
            grid,
            automatic_load: pull.automatic,
            motion_envelope: pull.reach,
            pins: Vec::new(),
            actors: TimeDependentLoads::default(),
        })
    }

    /// Checks that the scene and its material allow a cage of this kind.
    fn check_cage(
        &self,
        entry: &CageEntry,
        form: CageKind,
        kind: SolverKind,
        material: &Material,
    ) -> Result<()> {
        if form == CageKind::Grid && kind != SolverKind::Verlet {
            return Err(Error::Input(format!(
                "a cage of kind \"grid\" requires the solver verlet, got {kind}; set name = \"verlet\" or kind = \"lattice\""
            )));
        }
        if entry.damping.is_some() && form != CageKind::Grid {
            return Err(Error::Input(
                "[cage] damping requires kind = \"grid\"; set the damping of a lattice in [material]".into(),
            ));
        }
        if !self.cut.is_empty() {
            return Err(Error::Input(
                "a mesh embedded in a cage cannot be cut; remove [cage] or [[cut]]".into(),
            ));
        }
        if self.floor.is_some() {
            return Err(Error::Input(
                "a mesh embedded in a cage has no contact with a floor; remove [cage] or [floor]"
                    .into(),
            ));
        }
        if form == CageKind::Grid && material.model != MaterialModel::Springs {
            return Err(Error::Input(format!(
                "a cage of kind \"grid\" requires springs, but the material model is {}; remove `model` (--material), or set kind = \"lattice\"",
                material.model
            )));
        }
        Ok(())
    }

    /// Creates the simulator of the cage itself; takes its grid model.
    fn cage_body(
        &self,
        gpu: &Gpu,
        entry: &CageEntry,
        kind: SolverKind,
        cage: &mut Cage,
        material: &Material,
        notes: &mut Vec<String>,
    ) -> Result<Box<dyn Simulator>> {
        match cage.grid.take() {
            Some(mut model) => {
                model.damping = entry.damping.unwrap_or(model.damping);
                let engine = self.solver.engine.unwrap_or_default();
                engine.build_grid(gpu, cage.mesh.clone(), model)
            }
            None => {
                let mut discrete_model = cage.model.clone();
                if !self.material.says_damping() && !kind.is_implicit() {
                    discrete_model.damping_time = 0.0;
                    if let Some((damping, note)) = stable_damping(&discrete_model, kind) {
                        discrete_model.damping_time = damping;
                        notes.push(note);
                    }
                }
                self.simulator_of(gpu, cage.mesh.clone(), discrete_model, material, kind)
            }
        }
    }

    /// Returns the nodes of `mesh` held by each pin; without pins, the clamped end, which is also
    /// returned with the number of pieces.
    fn held(
        &self,
        mesh: &TetMesh,
        fine: &DiscreteModel,
    ) -> Result<(Vec<Vec<u32>>, Option<ChosenSupport>)> {
        if !self.pin.is_empty() {
            let held = self.pin.iter().map(|region| region.nodes(mesh));
            return Ok((held.collect::<Result<_>>()?, None));
        }
        let (end, pieces) = self.held_end_of(fine);
        Ok((vec![end.nodes.clone()], Some((end, pieces))))
    }
}
