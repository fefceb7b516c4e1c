//! A body that is pressed at one place after another, with the derivatives of the force by parameters.

use super::session::PressSession;
use super::setup::PressSetup;
use super::site::{Boundary, PressSite};
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::{
    Capability, Gradient, Parameter, Quantity, Simulator, SimulatorState, SolverKind,
};
use crate::scene::{Motion, Scene};
use crate::{Error, Result};
use glam::DVec3;

/// Largest distance of a press point from the body, relative to its diagonal.
const MAX_DISTANCE: f64 = 0.05;

/// Largest number of further steps at a depth until the body is at rest.
const MAX_MORE_STEPS: u32 = 6;
/// Smallest cosine between the outward direction and that away from the table of a further press.
const MIN_UP_COSINE: f64 = 0.5;

/// A simulator with a fingertip, and its rest state.
pub(crate) struct Presser {
    motion: Motion,
    session: PressSession,
    rest: SimulatorState,
    boundary: Boundary,
}

impl Presser {
    /// Places the body of `scene`, which is `mesh`, on a table, with a fingertip of `radius` in file units.
    ///
    /// # Errors
    /// As [`PressSetup::on_table`] and [`Motion::new`].
    pub fn new(gpu: &Gpu, scene: &Scene, mesh: &TetMesh, radius: f64) -> Result<Presser> {
        let mut setup = PressSetup::on_table(scene, mesh, Some(radius))?;
        let material = &mut setup.scene.material;
        if material.damping.is_none_or(|own| own == 0.0) {
            // Viscous forces of a step, however long, are no part of the equilibrium that has derivatives.
            material.damping = Some(0.0);
            (material.damping_ratio, material.damping_hz) = (None, None);
        }
        let kind = SolverKind::Implicit;
        let (motion, _) = Motion::new(gpu, &setup.scene, kind, mesh.clone(), None)?;
        let saved = Capability::Checkpoints.require(motion.simulator.checkpoint())?;
        Ok(Presser {
            boundary: Boundary::at_rest(&motion),
            rest: saved.state()?,
            session: PressSession::new(setup, &motion),
            motion,
        })
    }

    /// Prepares derivatives: the simulator then takes steps in double precision, which are slower.
    ///
    /// # Errors
    /// [`Error::Input`] for a body without gradients.
    pub fn with_derivatives(mut self) -> Result<Presser> {
        let gradients = self.motion.simulator.gradients();
        Capability::Gradients
            .require(gradients)?
            .use_double_precision()?;
        let saved = Capability::Checkpoints.require(self.motion.simulator.checkpoint())?;
        self.rest = saved.state()?;
        Ok(self)
    }

    /// Returns metres per file unit.
    pub fn unit(&self) -> f64 {
        self.session.unit()
    }

    /// Returns the site at the boundary point nearest to `at`, with the given outward direction.
    ///
    /// # Errors
    /// [`Error::Input`] for a point that is not on the body.
    pub fn site(&self, at: DVec3, outward: DVec3) -> Result<PressSite> {
        let nearest = self.boundary.site_at(at, self.session.radius()).point;
        let away = nearest.distance(at);
        if away.is_nan() || away > MAX_DISTANCE * self.boundary.diagonal() {
            return Err(Error::Input(format!(
                "press point {at} is {away} from the body (file units), more than {} % of its size: the data are of another body, or in another unit or frame",
                100.0 * MAX_DISTANCE
            )));
        }
        Ok(self.boundary.spot(nearest, outward.normalize_or(DVec3::Z)))
    }

    /// Presses the body from rest at `site` to each of the `depths` (file units, increasing). Returns the
    /// force at each (N), with its derivatives by `parameters` if `is_wanted` for its number, which needs
    /// [`Presser::with_derivatives`].
    ///
    /// # Errors
    /// As a simulation step and [`Gradients::gradient`](crate::physics::Gradients::gradient);
    /// [`Error::Solver`] where tets would be inverted.
    pub fn press(
        &mut self,
        site: PressSite,
        depths: &[f64],
        (parameters, is_wanted): (&[Parameter], &dyn Fn(usize) -> bool),
    ) -> Result<Vec<Gradient>> {
        let saved = self.motion.simulator.checkpoint_mut();
        Capability::Checkpoints
            .require(saved)?
            .set_state(&self.rest)?;
        self.session
            .touch_site(&mut self.motion, &self.boundary, site)?;
        let tool = self.motion.tool_id(self.session.setup().tool)?;
        let quantity = Quantity::ToolForce {
            tool,
            direction: site.outward,
        };
        let mut forces = Vec::with_capacity(depths.len());
        for (k, depth) in depths.iter().enumerate() {
            let force = self.force_at(*depth)?;
            forces.push(match is_wanted(k) && force > 0.0 {
                true => self.gradient_at(*depth, (&quantity, parameters))?,
                false => Gradient {
                    value: force,
                    derivatives: vec![0.0; parameters.len()],
                    ..Gradient::default()
                },
            });
        }
        Ok(forces)
    }

    /// Takes a step to a depth, in file units. Returns the force there, N.
    fn force_at(&mut self, depth: f64) -> Result<f64> {
        let sample = self.session.press_to(&mut self.motion, depth, "load")?;
        sample.map(|sample| sample.force_n).ok_or_else(|| {
            Error::Input(format!(
                "tets would be inverted at a depth of {depth} (file units); press less deep, or on a finer mesh"
            ))
        })
    }

    /// Returns the force at the depth of the last step and its derivatives, after more steps there if the
    /// body is not at rest yet.
    fn gradient_at(
        &mut self,
        depth: f64,
        (quantity, parameters): (&Quantity, &[Parameter]),
    ) -> Result<Gradient> {
        let mut more = MAX_MORE_STEPS;
        loop {
            let gradients = self.motion.simulator.gradients();
            let found = Capability::Gradients
                .require(gradients)?
                .gradient(quantity, parameters);
            match found {
                Err(Error::Input(_)) if more > 0 => more -= 1,
                found => return found,
            }
            self.force_at(depth)?;
        }
    }

    /// Returns about `count` sites that are spread over the part of the surface that faces away from the
    /// table, with the outward direction of the surface.
    pub fn spread_sites(&self, count: usize) -> Vec<PressSite> {
        let table = self.session.setup().table.as_ref();
        let radius = self.session.radius();
        let middles = self.boundary.face_middles();
        let free: Vec<DVec3> = middles
            .into_iter()
            .filter(|(middle, outward)| {
                table.is_none_or(|table| {
                    outward.dot(table.up()) > MIN_UP_COSINE && !table.reaches(*middle)
                })
            })
            .map(|(middle, _)| middle)
            .collect();
        // Each is the farthest from those before.
        let Some(first) = free.first() else {
            return Vec::new();
        };
        let mut chosen = vec![*first];
        let mut away: Vec<f64> = free.iter().map(|p| p.distance(*first)).collect();
        while chosen.len() < count.min(free.len()) {
            let far = (0..free.len()).max_by(|a, b| away[*a].total_cmp(&away[*b]));
            let Some(next) = far.map(|k| free[k]) else {
                break;
            };
            chosen.push(next);
            for (away, p) in away.iter_mut().zip(&free) {
                *away = away.min(p.distance(next));
            }
        }
        chosen
            .into_iter()
            .map(|point| self.boundary.site_at(point, radius))
            .collect()
    }

    /// Returns the body at rest.
    pub fn simulator(&self) -> &dyn Simulator {
        self.motion.simulator.as_ref()
    }
}
