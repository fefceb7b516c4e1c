//! A body at rest, and the body in its finer space in the same configuration.

use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, FinerSpace, PIECES, TetMesh};
use crate::parallel;
use crate::physics::{DiscreteModel, Engine, EngineChoice, SolverKind};
use crate::scene::{Motion, NamedPins, OrderChoice, PresentLoads, Scene};
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// Change of a number between two solutions, relative to it, up to which it counts as settled.
const SETTLED: f64 = 1e-3;
/// Tolerance of equilibria without contact: steps in motion are solved less accurately.
pub(crate) const EQUILIBRIUM_TOLERANCE: f64 = 1e-4;
/// Largest number of solutions.
const MAX_SOLUTIONS: u32 = 5;

/// Time step over the time in which a shear wave crosses the body: inertia is negligible even for
/// slender bodies, whose lowest frequencies are far below the inverse of that time.
const STEP_IN_CROSSINGS: f64 = 1e4;
/// Time step of a body of unknown stiffness, s.
const STEP: f64 = 100.0;

/// What a body of a scene is at one moment, without its simulator: from it, bodies under the loads of
/// this moment are created, on any thread.
#[derive(Clone, Debug)]
pub(crate) struct RestBody {
    scene: Scene,
    mesh: TetMesh,
    loads: PresentLoads,
    /// Time step at which inertia is negligible, s.
    pub quasi_static_step: f64,
}

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

impl RestBody {
    /// Returns the body of `motion`, which simulates `scene`.
    ///
    /// # Errors
    /// [`Error::Input`] for bodies that are not finite elements on tets, and those that springs or free
    /// tools hold.
    pub fn new(scene: &Scene, motion: &Motion) -> Result<RestBody> {
        let simulator = motion.simulator.as_ref();
        let of_elements = simulator.model().is_some_and(|m| m.elements().is_some());
        if !of_elements || simulator.coarse_body().is_some() {
            return Err(Error::Input(
                "errors are estimated for finite elements only; use --material neo-hookean (or corotated), without [cage] and [grid]"
                    .into(),
            ));
        }
        Ok(RestBody {
            scene: scene.without_paths(),
            mesh: simulator.mesh().clone(),
            loads: motion.present_loads()?,
            quasi_static_step: quasi_static_step(motion),
        })
    }

    /// Returns the body with its last pin at other corners of elements, and its nodes there.
    pub fn with_last_pin(mut self, corners: &[u32]) -> (RestBody, Vec<u32>) {
        let nodes = self.mesh.nodes_between(corners.to_vec());
        let PresentLoads { fixed, pins, .. } = &mut self.loads;
        if let Some(last) = pins.last_mut() {
            let before = std::mem::replace(&mut last.nodes, nodes.clone());
            before.iter().for_each(|v| fixed[*v as usize] = false);
        }
        for v in pins.iter().flat_map(|pin| &pin.nodes) {
            fixed[*v as usize] = true;
        }
        (self, nodes)
    }

    /// Whether `motion`, of an equal mesh, has the same constraints and loads, whatever the pose of the
    /// tool of number `free`.
    ///
    /// # Errors
    /// [`Error::Input`] for a body that springs or free tools hold.
    pub fn has_loads_of(&self, motion: &Motion, free: usize) -> Result<bool> {
        Ok(self
            .loads
            .equals_but_for_tool(&motion.present_loads()?, free))
    }

    /// Returns the order of its elements.
    pub fn order(&self) -> ElementOrder {
        self.mesh.order
    }

    /// Returns its mesh.
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    /// Creates an equal body, which does not sleep.
    ///
    /// # Errors
    /// As [`Motion::new`]; [`Error::Input`] if the body has other loads than its scene.
    pub fn copy(&self, gpu: &Gpu) -> Result<Motion> {
        let loads = &self.loads;
        let fixed = (0u32..).zip(&loads.fixed).filter(|(_, is)| **is);
        let fixed: Vec<u32> = fixed.map(|(v, _)| v).collect();
        let copy = self.held_motion(gpu, self.mesh.clone(), (&fixed, loads.pins.clone()))?;
        // Forces are even tractions, so that those of the finer body follow from the scene only.
        match copy.simulator.loads().forces() == loads.forces {
            true => Ok(copy),
            false => Err(Error::Input(
                "the errors of a body are estimated with the forces of its scene, but others were set since; add them to the scene ([[force]])"
                    .into(),
            )),
        }
    }

    /// Creates the body in the finer space, fixed where this body is.
    ///
    /// # Errors
    /// As [`Motion::new`].
    pub fn finer(&self, gpu: &Gpu) -> Result<FinerBody> {
        let space = FinerSpace::new(&self.mesh)?;
        let pins = self.loads.pins.iter().map(|pin| {
            let mut own = vec![false; self.mesh.nodes.len()];
            pin.nodes.iter().for_each(|v| own[*v as usize] = true);
            NamedPins {
                name: pin.name.clone(),
                nodes: space.fixed_nodes(&own),
            }
        });
        let (fixed, pins) = (space.fixed_nodes(&self.loads.fixed), pins.collect());
        let motion = self.held_motion(gpu, space.mesh.clone(), (&fixed, pins))?;
        Ok(FinerBody { motion, space })
    }

    /// Creates a body of `mesh`, which does not sleep, under the loads of this moment.
    fn held_motion(
        &self,
        gpu: &Gpu,
        mesh: TetMesh,
        fixed: (&[u32], Vec<NamedPins>),
    ) -> Result<Motion> {
        let scene = copy_of(&self.scene, mesh.order);
        let (mut motion, _) = Motion::new(gpu, &scene, SolverKind::Implicit, mesh, None)?;
        motion.set_sleep_allowed(false);
        motion.hold_loads(&self.loads, fixed)?;
        Ok(motion)
    }
}

impl FinerBody {
    /// Returns the same positions at the nodes of the finer body.
    pub fn positions_from(&self, positions: &[DVec3]) -> Vec<DVec3> {
        self.space.interpolate(positions)
    }

    /// Returns for each tet of the coarser mesh its share (%) of the elastic energy of the difference
    /// between the present configuration and `before`, the coarser solution at the nodes of the finer
    /// body: of the error in energy.
    ///
    /// # Errors
    /// Errors of reading the body back.
    pub fn shares_of_difference(&self, before: &[DVec3]) -> Result<Vec<f64>> {
        let mut shares = self.energies_of_difference(before)?;
        let sum: f64 = shares.iter().sum();
        let whole = if sum > 0.0 { sum } else { 1.0 };
        shares.iter_mut().for_each(|share| *share *= 100.0 / whole);
        Ok(shares)
    }

    /// Returns the energies of [`FinerBody::shares_of_difference`], J, by linear elasticity. Tets of
    /// rigid regions have none.
    fn energies_of_difference(&self, before: &[DVec3]) -> Result<Vec<f64>> {
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
