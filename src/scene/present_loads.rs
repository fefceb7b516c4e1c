//! The constraints and loads of a body at one moment, held constant for other bodies in the same
//! configuration.

use super::reactions::NamedPins;
use super::{Motion, Scene};
use crate::physics::{Capability, ToolPose};
use crate::{Error, Result};
use glam::DVec3;

/// The constraints and loads of a body at one moment.
#[derive(Clone, Debug)]
pub(crate) struct PresentLoads {
    /// Whether the position of each node is given: pinned, moved or grabbed.
    pub fixed: Vec<bool>,
    /// The named moves, grabs and pins, in this order.
    pub pins: Vec<NamedPins>,
    /// External force on each node, N.
    pub forces: Vec<DVec3>,
    /// m/s².
    gravity: DVec3,
    /// Amplitudes of pressures and muscles.
    amplitudes: Vec<f64>,
    tools: Vec<ToolPose>,
}

impl PresentLoads {
    /// Whether `other` has the same constraints and loads, whatever the pose of the tool of number `free`.
    pub fn equals_but_for_tool(&self, other: &PresentLoads, free: usize) -> bool {
        let tools = |loads: &PresentLoads| {
            let others = loads.tools.iter().enumerate();
            let others = others.filter(|(number, _)| *number != free);
            others.map(|(_, pose)| *pose).collect::<Vec<_>>()
        };
        self.fixed == other.fixed
            && self.forces == other.forces
            && self.gravity == other.gravity
            && self.amplitudes == other.amplitudes
            && tools(self) == tools(other)
    }
}

impl Scene {
    /// Returns the scene without moves and grabs, whose nodes [`PresentLoads`] fixes.
    pub(crate) fn without_paths(&self) -> Scene {
        let mut scene = self.clone();
        scene.moves.clear();
        scene.grab.clear();
        scene
    }
}

impl Motion {
    /// Returns the constraints and loads at this moment.
    ///
    /// # Errors
    /// [`Error::Input`] for grabs by springs, and for tools that move freely.
    pub(crate) fn present_loads(&self) -> Result<PresentLoads> {
        let loads = self.simulator.loads();
        if loads.has_spring_grabs() || !self.dynamic_tools.is_empty() {
            return Err(Error::Input(
                "the errors of a body that springs or free tools hold are not estimated; remove `spring_stiffness` of the [[grab]], or `mass` and `spring_stiffness` of the [[tool]]"
                    .into(),
            ));
        }
        let moves = self.time_dependent_loads.scheduled_motions.iter();
        let of_move = moves.map(|motion| NamedPins {
            name: motion.name.clone(),
            nodes: motion.nodes.clone(),
        });
        let mut pins: Vec<NamedPins> = of_move.collect();
        for (i, attachment) in self.attachments.iter().enumerate() {
            let Some(grab) = attachment.grab else {
                continue;
            };
            let held = self.simulator.held_by(grab)?;
            pins.push(NamedPins {
                name: attachment.name_or_number(i),
                nodes: held.into_iter().map(|held| held.node).collect(),
            });
        }
        pins.extend(self.pins.iter().cloned());
        let tools = self.time_dependent_loads.tools.iter();
        Ok(PresentLoads {
            fixed: loads.fixed_nodes(),
            pins,
            forces: loads.forces().to_vec(),
            gravity: loads.gravity(),
            amplitudes: loads.amplitudes().to_vec(),
            tools: tools
                .map(|tool| loads.tool(tool.id))
                .collect::<Result<_>>()?,
        })
    }

    /// Replaces the loads of a body of [`Scene::without_paths`] by those of another one at some moment,
    /// but for its forces. It is fixed at the nodes `fixed`, where they are, among them `pins`.
    ///
    /// # Errors
    /// [`Error::Input`] if the other body has more pressures or muscles than its scene, or for unknown
    /// nodes.
    pub(crate) fn hold_loads(
        &mut self,
        of: &PresentLoads,
        (fixed, pins): (&[u32], Vec<NamedPins>),
    ) -> Result<()> {
        let own = &mut self.time_dependent_loads;
        let levels = std::mem::take(&mut own.levels);
        if levels.len() != of.amplitudes.len() {
            return Err(Error::Input(
                "the body has pressures or muscles that its scene lacks; add them to the scene"
                    .into(),
            ));
        }
        for ((id, _), amplitude) in levels.into_iter().zip(&of.amplitudes) {
            let loads = Capability::Pressure.require(self.simulator.scaled_loads())?;
            loads.set_amplitude(id, *amplitude)?;
        }
        let loads = self.simulator.loads_mut();
        for (tool, pose) in own.tools.iter_mut().zip(&of.tools) {
            tool.stop();
            loads.teleport_tool(tool.id, *pose)?;
        }
        loads.set_gravity(of.gravity);
        loads.unpin_all();
        loads.pin_nodes(fixed)?;
        self.pins = pins;
        Ok(())
    }
}
