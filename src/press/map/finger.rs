//! A simulator with a fingertip, which presses the points of a map one after another.

use super::PointResult;
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::{Capability, Shape, SimulatorState, SolverKind, Tool, ToolId, ToolPose};
use crate::press::curve::{self, PressSample};
use crate::press::site::PressSite;
use crate::press::{INITIAL_CLEARANCE, curve_warnings, make_quasi_static};
use crate::scene::{Motion, Scene};
use crate::{Error, Result};
use glam::{DQuat, DVec3};

/// Loading steps at each point.
const STEPS: u32 = 6;

/// Settings of a press.
pub(super) struct PressSettings {
    pub up: DVec3,
    pub depth: f64,
    pub unit: f64,
    pub poisson: f64,
    pub radius: f64,
}

/// Data to create a simulator with a fingertip.
pub(super) struct Bench<'a> {
    pub gpu: &'a Gpu,
    pub scene: &'a Scene,
    pub mesh: &'a TetMesh,
    pub radius: f64,
}

impl Bench<'_> {
    /// Creates a simulator whose fingertip is away from the body.
    pub fn finger(&self) -> Result<Finger> {
        let kind = SolverKind::Implicit;
        let (mut motion, _) = Motion::new(self.gpu, self.scene, kind, self.mesh.clone(), None)?;
        let (_, high) = self.mesh.bounds();
        let contact = Capability::Tools.require(motion.simulator.contact())?;
        let id = contact.add_tool(Tool {
            shape: Shape::Sphere {
                radius: self.radius,
            },
            pose: ToolPose::new(high + 4.0 * self.radius, DQuat::IDENTITY),
            friction: 0.0,
            gap: None,
        })?;
        make_quasi_static(&mut motion);
        let saved = motion.simulator.checkpoint();
        let rest = Capability::Checkpoints.require(saved)?.state()?;
        Ok(Finger { motion, id, rest })
    }
}

/// A simulator with a fingertip, and its rest state.
pub(super) struct Finger {
    motion: Motion,
    id: ToolId,
    rest: SimulatorState,
}

impl Finger {
    /// Presses the body from rest at a point at which the fingertip touches it at a height.
    pub fn press(
        &mut self,
        settings: &PressSettings,
        (spot, touch): &(PressSite, f64),
    ) -> Result<PointResult> {
        let at = |depth: f64| {
            ToolPose::new(spot.point + (touch - depth) * spot.outward, DQuat::IDENTITY)
        };
        let (id, dt) = (self.id, self.motion.dt);
        let body = self.motion.simulator.as_mut();
        let saved = Capability::Checkpoints.require(body.checkpoint_mut())?;
        saved.set_state(&self.rest)?;
        let begin = -INITIAL_CLEARANCE * settings.radius;
        body.loads_mut().teleport_tool(id, at(begin))?;
        let mut samples = Vec::new();
        for step in 1..=STEPS {
            let depth = begin + (settings.depth - begin) * f64::from(step) / f64::from(STEPS);
            body.loads_mut().set_tool_target(id, at(depth))?;
            match body.run(1, dt) {
                Err(Error::Solver { .. }) => return Ok(PointResult::Failed),
                other => other?,
            };
            let contact = Capability::Tools.require(body.contact())?;
            let force = contact
                .tool_forces()?
                .first()
                .map_or(DVec3::ZERO, |on| on.force);
            samples.push(PressSample {
                time_s: dt * f64::from(step),
                phase: "load",
                depth_m: settings.unit * depth,
                force_n: force.dot(settings.up),
            });
        }
        let radius = settings.unit * settings.radius;
        let warnings = curve_warnings(&samples);
        let numbers = [radius, settings.poisson];
        let report = curve::report(&samples, numbers, (String::new(), 0.0), warnings);
        Ok(match report.stiffness_n_per_m {
            Some(stiffness) => PointResult::Stiffness(stiffness),
            None => PointResult::Failed,
        })
    }
}
