//! The scene of a press: a body on a table, with a fingertip.

use super::finger::Finger;
use super::site::PressSite;
use super::support_table::Table;
use super::validity::in_pieces;
use crate::accuracy::of_order;
use crate::mesh::{TetMesh, Topology};
use crate::number_format::significant;
use crate::physics::{Engine, EngineChoice, SolverKind};
use crate::scene::{AccuracyEntry, OrderChoice, Scene, SphereEntry, ToolEntry};
use crate::{Error, Result};
use glam::DVec3;
use std::sync::Arc;

/// Time step between presses of a body without a solver, s.
const STEP: f64 = 0.02;
/// Distance of the parked fingertip from the body's centre, in body diagonals.
const PARKING_DISTANCE: f64 = 20.0;
/// Name of the fingertip among the tools.
const NAME: &str = "fingertip";

/// A scene with a fingertip that waits far from the body.
#[derive(Clone, Debug)]
pub(crate) struct PressSetup {
    /// The scene to simulate.
    pub scene: Scene,
    /// Number of the fingertip among the scene's kinematic tools.
    pub(super) tool: usize,
    /// Radius of the fingertip, in file units.
    pub radius: f64,
    /// Where it waits, in file units.
    pub(super) parking: DVec3,
    /// The table, unless the scene supports the body.
    pub(super) table: Option<Table>,
    /// Whether each step of a press is one of static equilibrium.
    pub(super) quasi_static: bool,
    /// How exact forces have to be, by the scene.
    pub(super) accuracy: AccuracyEntry,
}

impl PressSetup {
    /// Places the body of `scene`, which is `mesh`, on a table and fixes the lowest part of its
    /// surface along gravity there. Loads, grabs, prescribed motions, cuts, tools and the floor of the scene are
    /// left out, pins are kept. A `radius` that is not given is chosen from the body's shape.
    ///
    /// # Errors
    /// [`Error::Input`] for a scene of several bodies, a grid, a cage or a deformed mesh, or a body
    /// that cannot be supported.
    pub fn on_table(scene: &Scene, mesh: &TetMesh, radius: Option<f64>) -> Result<PressSetup> {
        check_scene(scene)?;
        let (mut prepared, down) = without_loads(scene);
        let table = Table::new(mesh, down)?;
        prepared.pin.push(table.region());
        Ok(PressSetup::with_fingertip(
            prepared,
            mesh,
            radius,
            Some(table),
        ))
    }

    /// As [`PressSetup::on_table`] for a scene without a solver; a scene with one keeps its
    /// supports, loads and solver. Its presses are quasi-static if it is stepped by `implicit` and
    /// its loads do not depend on time.
    ///
    /// # Errors
    /// As [`PressSetup::on_table`].
    pub fn interactive(scene: &Scene, mesh: &TetMesh, radius: Option<f64>) -> Result<PressSetup> {
        if scene.solver.name.is_none() {
            return PressSetup::on_table(scene, mesh, radius);
        }
        check_scene(scene)?;
        Ok(PressSetup::with_fingertip(
            scene.clone(),
            mesh,
            radius,
            None,
        ))
    }

    fn with_fingertip(
        mut scene: Scene,
        mesh: &TetMesh,
        radius: Option<f64>,
        table: Option<Table>,
    ) -> PressSetup {
        let radius =
            radius.unwrap_or_else(|| PressSite::default_radius(mesh, &Topology::new(mesh)));
        let (low, high) = mesh.bounds();
        let parking = 0.5 * (low + high) + DVec3::splat(PARKING_DISTANCE * low.distance(high));
        let dynamic = |t: &&ToolEntry| t.mass.is_some() || t.spring_stiffness.is_some();
        let tool = scene.tool.len() - scene.tool.iter().filter(dynamic).count();
        let implicit = SolverKind::Implicit.to_string();
        let quasi_static =
            scene.solver.name.as_ref() == Some(&implicit) && !scene.is_time_dependent();
        // The stage of a press does not refine by itself.
        let accuracy = std::mem::take(&mut scene.accuracy);
        scene.tool.push(ToolEntry {
            name: Some(NAME.into()),
            sphere: Some(SphereEntry { radius }),
            at: parking.to_array(),
            drawn: Some(Arc::new(Finger::tool_surface(radius))),
            ..ToolEntry::default()
        });
        PressSetup {
            scene,
            tool,
            radius,
            parking,
            table,
            quasi_static,
            accuracy,
        }
    }

    /// Returns the same setup for another mesh of the same shape.
    ///
    /// # Errors
    /// As [`Table::new`].
    pub(super) fn on_mesh(&self, mesh: &TetMesh) -> Result<PressSetup> {
        let mut setup = self.clone();
        setup.scene = of_order(&self.scene, mesh.order);
        if let Some(table) = &self.table {
            let table = Table::new(mesh, -table.up())?;
            // The pin of the table is the last one.
            if let Some(pin) = setup.scene.pin.last_mut() {
                *pin = table.region();
            }
            setup.table = Some(table);
        }
        Ok(setup)
    }

    /// Returns a warning if the body of `mesh` is in several pieces without contact.
    pub fn pieces_warning(&self, mesh: &TetMesh) -> Option<String> {
        match self.scene.contact {
            Some(_) => None,
            None => in_pieces(mesh),
        }
    }

    /// Returns the assumptions, as text; `step` is the time step of the presses, s.
    pub fn notes(&self, step: f64) -> Vec<String> {
        let Some(table) = &self.table else {
            let mut notes = vec![
                "presses add to the scene's own loads, which `palpate press` leaves out"
                    .to_string(),
            ];
            if !self.quasi_static {
                notes.push(
                    "forces of presses include inertia and damping: only presses of a body stepped by `implicit`, without time-dependent loads, are quasi-static".into(),
                );
            }
            notes.extend(self.order_note());
            return notes;
        };
        let own = format!(
            "the body is placed on a table and fixed there; quasi-static: solver {} with time steps of {} s; loads, grabs, moves, cuts, tools and floor of the scene are ignored",
            self.scene.solver.name.as_deref().unwrap_or_default(),
            significant(step)
        );
        let more = table.note().into_iter().chain(self.order_note());
        std::iter::once(own).chain(more).collect()
    }

    /// Returns a note if the body is of order 1 because nothing was asked for.
    pub(super) fn order_note(&self) -> Option<String> {
        self.scene.has_linear_tets_by_default().then(|| {
            "finite elements of order 1 (linear tets), whose forces are too high by up to tens of percent on coarse meshes; quadratic tets are slower and come much closer (--order 2, [material] order = 2; the default of a single `palpate press`)".to_owned()
        })
    }
}

/// Returns the scene of a single measured press, whose elements are of order 2 by default where that
/// pays: linear tets on coarse meshes resist too much. Maps and interactive presses take too long
/// with it.
pub(super) fn with_default_order(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    scene.material.order.get_or_insert(OrderChoice::Auto);
    scene
}

/// Rejects scenes other than a single tetrahedral body at rest.
fn check_scene(scene: &Scene) -> Result<()> {
    if !scene.body.is_empty() || scene.grid.is_some() || scene.cage.is_some() {
        return Err(Error::Input(
            "a press needs a single tetrahedral body; remove [[body]], [grid] and [cage]".into(),
        ));
    }
    if scene.mesh.rest.is_some() {
        return Err(Error::Input(
            "a deformed mesh ([mesh] rest) is not simulated; remove `rest` to press on it".into(),
        ));
    }
    Ok(())
}

/// Returns the scene without loads, prepared for quasi-static steps, and the downward direction.
fn without_loads(scene: &Scene) -> (Scene, DVec3) {
    let mut prepared = scene.clone();
    let down = scene.solver.gravity.map_or(DVec3::ZERO, DVec3::from);
    let down = down.try_normalize().unwrap_or(DVec3::NEG_Z);
    prepared.force.clear();
    prepared.grab.clear();
    prepared.moves.clear();
    prepared.pressure.clear();
    prepared.muscle.clear();
    prepared.cut.clear();
    prepared.tool.clear();
    prepared.floor = None;
    prepared.solver.gravity = Some([0.0; 3]);
    prepared.solver.name = Some(SolverKind::Implicit.to_string());
    prepared.solver.dt = Some(STEP);
    let engine = scene.solver.engine.unwrap_or(EngineChoice::Auto);
    prepared.solver.engine = Some(match engine {
        EngineChoice::Auto => EngineChoice::Exactly(Engine::Cpu),
        named => named,
    });
    (prepared, down)
}
