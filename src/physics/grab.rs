//! Grabbing: nodes that follow a target, exactly or by springs with a limit.
//!
//! A target holds from one recording of steps to the next; whoever moves it fast records few steps
//! at a time. Nothing is read back but the positions when a grab starts.

use super::state::{GrabsState, HeldState};
use crate::gpu::{Array, Gpu, Pass, Texel};
use crate::mesh::LocalFrame;
use crate::{Error, Result};
use glam::DVec3;
use std::collections::BTreeMap;
use std::fmt;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/physics/hold.wgsl`.
        pub struct HoldParams {
            pub count: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/draw_near.wgsl`.
        pub struct DrawParams {
            pub count: u32,
        }
    }
}

/// Farther than so many sizes of the body from its middle no target makes sense.
const FARTHEST: f64 = 100.0;

/// How a grab holds its nodes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Grip {
    /// The nodes keep their places around the target, whatever pulls at them.
    Follow,
    /// A spring from each node to its place around the target.
    Spring {
        /// κ of all springs together, N/m.
        stiffness: f64,
        /// The largest force of all springs together, N.
        limit: f64,
    },
}

impl fmt::Display for Grip {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Grip::Follow => f.write_str("nodes that follow it"),
            Grip::Spring { stiffness, limit } => {
                write!(f, "springs of {stiffness} N/m up to {limit} N")
            }
        }
    }
}

/// Names a grab of a body.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
pub struct GrabId(u32);

#[derive(Clone, Debug)]
struct Grab {
    nodes: Vec<u32>,
    /// From the target to each node's place, in file units.
    offsets: Vec<DVec3>,
    target: DVec3,
    grip: Grip,
}

/// The grabs of a body, and their lists on the GPU.
#[derive(Debug)]
pub(super) struct Grabs {
    gpu: Gpu,
    frame: LocalFrame,
    /// Metres in a local unit.
    length: f64,
    grabs: BTreeMap<GrabId, Grab>,
    next: u32,
    held: Option<[Array; 2]>,
    drawn: Option<[Array; 3]>,
    /// Whether the lists are to be made anew, and how often they were.
    changed: bool,
    version: u64,
}

impl Grabs {
    pub(super) fn new(gpu: &Gpu, frame: LocalFrame, length_unit: f64) -> Grabs {
        Grabs {
            gpu: gpu.clone(),
            frame,
            length: frame.scale * length_unit,
            grabs: BTreeMap::new(),
            next: 0,
            held: None,
            drawn: None,
            changed: false,
            version: 0,
        }
    }

    /// Counts how often the lists on the GPU were made.
    pub(super) fn version(&self) -> u64 {
        self.version
    }

    /// Grabs the nodes within `radius` of `centre` that `free` allows; file units.
    pub(super) fn add(
        &mut self,
        positions: &[DVec3],
        free: impl Fn(usize) -> bool,
        centre: DVec3,
        radius: f64,
        grip: Grip,
    ) -> Result<GrabId> {
        let sound = match grip {
            Grip::Follow => true,
            Grip::Spring { stiffness, limit } => {
                stiffness.is_finite() && stiffness > 0.0 && limit > 0.0
            }
        };
        if !(sound && centre.is_finite() && radius.is_finite() && radius >= 0.0) {
            return Err(Error::Input(format!(
                "a grab at {centre} of radius {radius} with {grip} makes no sense; give finite positive numbers"
            )));
        }
        let nodes: Vec<u32> = (0..positions.len())
            .filter(|i| free(*i) && positions[*i].distance(centre) <= radius)
            .map(|i| i as u32)
            .collect();
        if nodes.is_empty() {
            let nearest = (0..positions.len())
                .filter(|i| free(*i))
                .map(|i| positions[i].distance(centre))
                .fold(f64::INFINITY, f64::min);
            return Err(Error::Input(format!(
                "nothing to grab within {radius} of {centre}: the nearest free node is {nearest:.4} away"
            )));
        }
        let id = GrabId(self.next);
        self.next += 1;
        let offsets = nodes
            .iter()
            .map(|i| positions[*i as usize] - centre)
            .collect();
        let grab = Grab {
            nodes,
            offsets,
            target: centre,
            grip,
        };
        self.grabs.insert(id, grab);
        self.changed = true;
        Ok(id)
    }

    /// Moves the target of a grab; file units. Whether it was elsewhere before.
    pub(super) fn set_target(&mut self, id: GrabId, target: DVec3) -> Result<bool> {
        let far = target.distance(self.frame.origin) > FARTHEST * self.frame.scale;
        if !target.is_finite() || far {
            return Err(Error::Input(format!(
                "the target {target} of a grab is {}; it stays where it was",
                if far && target.is_finite() {
                    "farther away than a hundred sizes of the body"
                } else {
                    "not a point"
                }
            )));
        }
        let grab = self.grabs.get_mut(&id).ok_or_else(unknown)?;
        let moved = grab.target != target;
        self.changed |= moved;
        grab.target = target;
        Ok(moved)
    }

    /// All of them, to be kept.
    pub(super) fn state(&self) -> GrabsState {
        let held = self.grabs.iter().map(|(id, grab)| HeldState {
            id: *id,
            nodes: grab.nodes.clone(),
            offsets: grab.offsets.iter().map(|o| o.to_array()).collect(),
            target: grab.target.to_array(),
            grip: grab.grip,
        });
        GrabsState {
            held: held.collect(),
            next: self.next,
        }
    }

    /// Takes over what [`Grabs::state`] gave of a body of so many nodes.
    pub(super) fn set_state(&mut self, state: &GrabsState, nodes: usize) -> Result<()> {
        let strange = |held: &HeldState| {
            held.nodes.len() != held.offsets.len()
                || held.nodes.iter().any(|v| *v as usize >= nodes)
                || held.id.0 >= state.next
        };
        if state.held.iter().any(strange) {
            return Err(Error::Input(
                "the grabs of another body, or damaged ones".into(),
            ));
        }
        let grabs = state.held.iter().map(|held| {
            let grab = Grab {
                nodes: held.nodes.clone(),
                offsets: held.offsets.iter().map(|o| DVec3::from(*o)).collect(),
                target: held.target.into(),
                grip: held.grip,
            };
            (held.id, grab)
        });
        self.grabs = grabs.collect();
        self.next = state.next;
        self.changed = true;
        Ok(())
    }

    /// The forces that act anyway have changed, or who is held by whom.
    pub(super) fn touch(&mut self) {
        self.changed = true;
    }

    /// Lets go. Returns how many nodes were held.
    pub(super) fn release(&mut self, id: GrabId) -> Result<usize> {
        let grab = self.grabs.remove(&id).ok_or_else(unknown)?;
        self.changed = true;
        Ok(grab.nodes.len())
    }

    /// Whether anything is grabbed.
    pub(super) fn any(&self) -> bool {
        !self.grabs.is_empty()
    }

    /// The nodes that follow exactly.
    pub(super) fn held(&self) -> impl Iterator<Item = u32> {
        let follow = self.grabs.values().filter(|g| g.grip == Grip::Follow);
        follow.flat_map(|g| g.nodes.iter().copied())
    }

    /// Makes the lists anew if a grab has changed; whether one has. `loads` are the forces that
    /// act anyway, N, `w` the fourth component of each node's position.
    pub(super) fn flush(&mut self, loads: &[[f32; 4]], w: impl Fn(usize) -> f32) -> Result<bool> {
        if !std::mem::take(&mut self.changed) {
            return Ok(false);
        }
        self.version += 1;
        let (mut held, mut places) = (Vec::new(), Vec::new());
        let (mut drawn, mut targets, mut forces) = (Vec::new(), Vec::new(), Vec::new());
        for grab in self.grabs.values() {
            for (i, offset) in grab.nodes.iter().zip(&grab.offsets) {
                let place = self.frame.to_local(grab.target + *offset);
                match grab.grip {
                    Grip::Follow => {
                        held.push(*i);
                        places.push(place.extend(w(*i as usize)).to_array());
                    }
                    Grip::Spring { stiffness, limit } => {
                        let share = grab.nodes.len() as f64;
                        let [x, y, z, _] = loads[*i as usize];
                        drawn.push(*i);
                        let pull = (stiffness / share * self.length) as f32;
                        targets.push(place.extend(pull).to_array());
                        forces.push([x, y, z, (limit / share) as f32]);
                    }
                }
            }
        }
        let gpu = &self.gpu;
        self.held = match held.is_empty() {
            true => None,
            false => Some([
                gpu.array_of("nodes held", Texel::U32, &held)?,
                gpu.array_of("places of nodes held", Texel::F32x4, &places)?,
            ]),
        };
        self.drawn = match drawn.is_empty() {
            true => None,
            false => Some([
                gpu.array_of("nodes drawn", Texel::U32, &drawn)?,
                gpu.array_of("targets of nodes drawn", Texel::F32x4, &targets)?,
                gpu.array_of("loads of nodes drawn", Texel::F32x4, &forces)?,
            ]),
        };
        Ok(true)
    }

    /// Whether springs draw nodes, as of the last flush.
    pub(super) fn draws(&self) -> bool {
        self.drawn.is_some()
    }

    /// The pass that puts the nodes that follow where they are to be.
    pub(super) fn hold_pass(&self, positions: &Array) -> Result<Option<Pass>> {
        let Some([numbers, places]) = &self.held else {
            return Ok(None);
        };
        let pass = self
            .gpu
            .pass("physics/hold")
            .read(numbers)
            .read(places)
            .write(positions)
            .params(&gpu_data::HoldParams {
                count: numbers.len(),
            })
            .over(numbers.len())?;
        Ok(Some(pass))
    }

    /// The pass that writes the springs' pull at `positions` into the external forces.
    pub(super) fn draw_pass(&self, positions: &Array, external: &Array) -> Result<Option<Pass>> {
        let Some([numbers, targets, loads]) = &self.drawn else {
            return Ok(None);
        };
        let pass = self
            .gpu
            .pass("physics/draw_near")
            .read(positions)
            .read(numbers)
            .read(targets)
            .read(loads)
            .write(external)
            .params(&gpu_data::DrawParams {
                count: numbers.len(),
            })
            .over(numbers.len())?;
        Ok(Some(pass))
    }
}

fn unknown() -> Error {
    Error::Input("there is no such grab, or it was released".into())
}
