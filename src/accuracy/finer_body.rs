//! A body in the finer space of another one, at rest in the same configuration.

use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, FinerSpace, PIECES, TetMesh};
use crate::parallel;
use crate::physics::{DiscreteModel, Engine, EngineChoice, SolverKind};
use crate::scene::{Motion, OrderChoice, Scene};
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// Change of a number between two solutions, relative to it, up to which it counts as settled.
const SETTLED: f64 = 1e-4;
/// Tolerance of equilibria without contact: steps in motion are solved less accurately.
pub(crate) const EQUILIBRIUM_TOLERANCE: f64 = 1e-4;
/// Largest number of solutions.
const MAX_SOLUTIONS: u32 = 5;

/// Time step over the time in which a shear wave crosses the body: inertia is negligible even for
/// slender bodies, whose lowest frequencies are far below the inverse of that time.
const STEP_IN_CROSSINGS: f64 = 1e4;
/// Time step of a body of unknown stiffness, s.
const STEP: f64 = 100.0;

/// A body whose space contains that of another body of the same scene.
pub(crate) struct FinerBody {
    /// The body, which does not sleep.
    pub motion: Motion,
    space: FinerSpace,
}

/// Numbers of a body that have settled.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Settled {
    /// Their last values.
    pub values: Vec<f64>,
    /// Their changes in the last solution.
    pub changes: Vec<f64>,
}

impl FinerBody {
    /// Creates the finer body of the body of `motion`, which simulates `scene`. It is fixed where that
    /// body is.
    ///
    /// # Errors
    /// [`Error::Input`] for bodies that are not finite elements on tets; otherwise as [`Motion::new`].
    pub fn new(gpu: &Gpu, scene: &Scene, motion: &Motion) -> Result<FinerBody> {
        let of_elements = motion
            .simulator
            .model()
            .is_some_and(|m| m.elements().is_some());
        if !of_elements || motion.simulator.coarse_body().is_some() {
            return Err(Error::Input(
                "errors are estimated for finite elements only; use --material neo-hookean (or corotated), without [cage] and [grid]"
                    .into(),
            ));
        }
        let space = FinerSpace::new(motion.simulator.mesh())?;
        let finer = copy_of(scene, ElementOrder::Quadratic);
        let mut motion_of_finer = new_motion(gpu, &finer, space.mesh.clone())?;
        let fixed = space.fixed_nodes(motion.simulator.loads().pinned());
        let loads = motion_of_finer.simulator.loads_mut();
        loads.unpin_all();
        loads.pin_nodes(&fixed)?;
        Ok(FinerBody {
            motion: motion_of_finer,
            space,
        })
    }

    /// Returns the same positions at the nodes of the finer body.
    pub fn positions_from(&self, positions: &[DVec3]) -> Vec<DVec3> {
        self.space.interpolate(positions)
    }

    /// Returns for each tet of the coarser mesh the elastic energy (J) of the difference between the
    /// present configuration and `before`, the coarser solution at the nodes of the finer body, by
    /// linear elasticity: its share of the error in energy. Tets of rigid regions have none.
    ///
    /// # Errors
    /// Errors of reading the body back.
    pub fn energies_of_difference(&self, before: &[DVec3]) -> Result<Vec<f64>> {
        let (mesh, now) = (&self.space.mesh, self.motion.positions()?);
        let Some(elements) = self.motion.simulator.model().and_then(|m| m.elements()) else {
            return Ok(Vec::new());
        };
        let numbers = elements.of_tets(mesh);
        let unit = self.motion.length_unit();
        let energy_of_piece = |t: usize| {
            let Some(element) = numbers[t] else {
                return 0.0;
            };
            let [mu, lambda] = elements.tets[element].small_strain(elements.law);
            let edges = |x: &[DVec3]| {
                let [a, b, c, d] = mesh.tets[t].map(|v| x[v as usize]);
                DMat3::from_cols(b - a, c - a, d - a)
            };
            let rest = edges(&mesh.nodes);
            let gradient = (edges(&now) - edges(before)) * rest.inverse();
            let strain = 0.5 * (gradient + gradient.transpose());
            let square: f64 = strain.to_cols_array().iter().map(|x| x * x).sum();
            let trace = strain.x_axis.x + strain.y_axis.y + strain.z_axis.z;
            let volume = rest.determinant() / 6.0 * unit.powi(3);
            volume * (mu * square + 0.5 * lambda * trace * trace)
        };
        let pieces = parallel::map(mesh.tets.len(), energy_of_piece);
        Ok(pieces.chunks(PIECES).map(|own| own.iter().sum()).collect())
    }

    /// Number of elements.
    pub fn elements(&self) -> usize {
        self.space.mesh.element_count()
    }
}

/// Returns the time step of `motion` at which inertia and damping are negligible, s.
pub(crate) fn quasi_static_step(motion: &Motion) -> f64 {
    let model = motion.simulator.model();
    let crossing = model.and_then(DiscreteModel::wave_crossing_time);
    crossing.map_or(STEP, |time| STEP_IN_CROSSINGS * time)
}

/// Creates a body equal to that of `motion`, which simulates `scene`, at rest.
///
/// # Errors
/// As [`Motion::new`].
pub(crate) fn copy_at_rest(gpu: &Gpu, scene: &Scene, motion: &Motion) -> Result<Motion> {
    let mesh = motion.simulator.mesh().clone();
    let pinned = motion.simulator.loads().pinned();
    let fixed = (0u32..).zip(pinned).filter(|(_, is)| **is).map(|(v, _)| v);
    let fixed: Vec<u32> = fixed.collect();
    let mut copy = new_motion(gpu, &copy_of(scene, mesh.order), mesh)?;
    let loads = copy.simulator.loads_mut();
    loads.unpin_all();
    loads.pin_nodes(&fixed)?;
    Ok(copy)
}

/// Returns `scene` with elements of `order` on the CPU, whose equilibria are solved accurately. Steps
/// with contact are by default.
fn copy_of(scene: &Scene, order: ElementOrder) -> Scene {
    let mut copy = scene.clone();
    if copy.tool.is_empty() && copy.contact.is_none() {
        copy.solver.tolerance = Some(EQUILIBRIUM_TOLERANCE);
    }
    copy.material.order = Some(OrderChoice::Exactly(order));
    if order == ElementOrder::Quadratic {
        copy.material.volume = None;
    }
    copy.solver.engine = Some(EngineChoice::Exactly(Engine::Cpu));
    copy
}

fn new_motion(gpu: &Gpu, scene: &Scene, mesh: TetMesh) -> Result<Motion> {
    let (mut motion, _) = Motion::new(gpu, scene, SolverKind::Implicit, mesh, None)?;
    motion.set_sleep_allowed(false);
    Ok(motion)
}

/// Starts `motion` at rest from `positions` and takes steps of `dt` seconds until the numbers that
/// `measure` reads have settled.
///
/// # Errors
/// As a simulation step; errors of `measure`.
pub(crate) fn settle(
    motion: &mut Motion,
    (positions, dt): (&[DVec3], f64),
    measure: &mut dyn FnMut(&mut Motion) -> Result<Vec<f64>>,
) -> Result<Settled> {
    motion.simulator.set_positions(positions)?;
    let at_rest = vec![DVec3::ZERO; positions.len()];
    motion.simulator.set_velocities(&at_rest)?;
    motion.dt = dt;
    motion.run(1, &mut |_| {})?;
    let mut values = measure(motion)?;
    let mut changes = vec![f64::INFINITY; values.len()];
    for _ in 1..MAX_SOLUTIONS {
        motion.run(1, &mut |_| {})?;
        let next = measure(motion)?;
        let pairs = values.iter().zip(&next);
        changes = pairs.map(|(a, b)| (a - b).abs()).collect();
        values = next;
        let small = |(change, value): (&f64, &f64)| *change <= SETTLED * value.abs();
        if changes.iter().zip(&values).all(small) {
            break;
        }
    }
    Ok(Settled { values, changes })
}
