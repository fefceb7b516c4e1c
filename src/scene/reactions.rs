//! What a body exerts on its pins, grabs and tools, as a table of each frame.

use super::stage::Stage;
use crate::io::atomic_write;
use crate::mesh::TetCut;
use crate::physics::{Engine, NodalForces, Reaction};
use crate::{Error, Result};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The first line of the table.
const HEADER: &str = "time_s,name,fx,fy,fz,mx,my,mz";

/// Nodes that are pinned as one, and what they are called.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NamedPins {
    pub name: String,
    pub nodes: Vec<u32>,
}

/// A CSV file of what a body exerts on everything that holds it, for each frame of a run: its time
/// in s, the name of the pin, move, grab or tool, the force in N and its moment in N·m: about the
/// origin of the file's coordinates, of a tool about its middle, of one with a mass or a spring about
/// its centre of mass. The spring has a row of its own, `NAME spring`.
///
/// The force is that of the body in the state of the frame: elastic, damping, the weight of the
/// nodes held and what else pulls at them, less what accelerates them where they are moved. Of a
/// grab that pulls by springs it is the force of the springs; of one that holds nothing yet, or no
/// more, it is zero. Only the processor's engine knows them, of bodies of tets.
///
/// The file is written anew with every frame, to a temporary name first.
#[derive(Clone, Debug)]
pub struct ReactionLog {
    path: PathBuf,
    lines: Vec<String>,
}

impl ReactionLog {
    /// A table without frames at `path`.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written.
    pub fn create(path: impl AsRef<Path>) -> Result<ReactionLog> {
        let log = ReactionLog {
            path: path.as_ref().to_path_buf(),
            lines: Vec::new(),
        };
        log.write()?;
        Ok(log)
    }

    /// Goes on with a table of which the frames at `times` were finished; what followed them is
    /// dropped.
    ///
    /// # Errors
    /// [`Error::Format`] when the table is none, or one of these frames is not in it.
    pub fn resume(path: impl AsRef<Path>, times: &[f64]) -> Result<ReactionLog> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
        let mut lines = text.lines();
        if lines.next() != Some(HEADER) {
            return Err(Error::format(
                path,
                format!("is no table of reactions, which begins with {HEADER}"),
            ));
        }
        let mut left = lines.map(str::to_owned).peekable();
        let mut log = ReactionLog {
            path: path.to_path_buf(),
            lines: Vec::new(),
        };
        for (i, time) in times.iter().enumerate() {
            let of_frame = format!("{time},");
            let before = log.lines.len();
            while let Some(line) = left.next_if(|line| line.starts_with(&of_frame)) {
                log.lines.push(line);
            }
            if log.lines.len() == before {
                return Err(Error::format(
                    path,
                    format!(
                        "the reactions of frame {i}, which was finished at {time} s, are missing; start the run afresh, without --resume"
                    ),
                ));
            }
        }
        log.write()?;
        Ok(log)
    }

    /// Adds the reactions of a frame.
    ///
    /// # Errors
    /// As [`Stage::reactions`]; [`Error::Io`] when the table cannot be written.
    pub fn push(&mut self, stage: &mut Stage) -> Result<()> {
        let time = stage.time();
        for (name, Reaction { force, moment }) in stage.reactions()? {
            let numbers = [force, moment].map(|v| format!("{},{},{}", v.x, v.y, v.z));
            let name = quoted(&name);
            self.lines
                .push(format!("{time},{name},{}", numbers.join(",")));
        }
        self.write()
    }

    fn write(&self) -> Result<()> {
        atomic_write(&self.path, |file| {
            let lines = [HEADER]
                .into_iter()
                .chain(self.lines.iter().map(String::as_str));
            let mut text = String::new();
            lines.for_each(|line| text.extend([line, "\n"]));
            file.write_all(text.as_bytes())
                .map_err(Error::io(&self.path))
        })
    }
}

/// A cell of a table, on one line.
fn quoted(text: &str) -> String {
    let text = text.replace(['\n', '\r'], " ");
    match text.contains([',', '"']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text,
    }
}

impl NamedPins {
    /// Follows a cut: doubles are pinned as the nodes they come from.
    pub(super) fn apply_cut(&mut self, cut: &TetCut) {
        let own: std::collections::BTreeSet<u32> = self.nodes.iter().copied().collect();
        let doubled = cut
            .duplicated_nodes
            .iter()
            .filter(|[_, old]| own.contains(old));
        self.nodes.extend(doubled.map(|[new, _]| *new));
    }
}

impl Stage {
    /// What the body exerts on each of its pins, moves, grabs and tools where it stands, by name and in
    /// this order: moments are about the origin of the file's coordinates, of tools about their
    /// middles. Of a body that a GPU steps its tools alone, where it has any.
    ///
    /// # Errors
    /// [`Error::Input`] where nothing moves, or nothing holds the body; otherwise as
    /// [`Simulator::forces`](crate::physics::Simulator::forces).
    pub fn reactions(&mut self) -> Result<Vec<(String, Reaction)>> {
        let time = self.time();
        let Some(motion) = self.motion_mut() else {
            return Err(Error::Input(
                "what nothing moves exerts no reactions: name a solver (--solver implicit, for example)".into(),
            ));
        };
        let of_tools = motion.tool_reactions()?;
        // A GPU knows the forces on its tools, and not those on nodes.
        if motion.simulator.engine() == Engine::Gpu && !of_tools.is_empty() {
            return Ok(of_tools);
        }
        let forces = NodalForces::of(motion.simulator.as_mut())?;
        let body = motion.simulator.as_ref();
        let pins = motion.pins.iter();
        let mut all: Vec<(String, Reaction)> = pins
            .map(|pin| (pin.name.clone(), forces.reaction_on_pins(&pin.nodes)))
            .collect();
        let unit = body.loads().frame_and_unit().1;
        for mover in &motion.time_dependent_loads.movers {
            let nodes = mover.accelerations(time, motion.dt);
            let reaction = forces.reaction_on_motion(nodes.map(|(v, a)| (v, unit * a)));
            all.push((mover.name.clone(), reaction));
        }
        for (i, attachment) in motion.attachments.iter().enumerate() {
            let name = attachment.name().map(str::to_owned);
            let name = name.unwrap_or_else(|| format!("grab{}", i + 1));
            let reaction = match attachment.grab {
                None => Reaction::default(),
                Some(grab) => {
                    let acceleration = unit * attachment.acceleration(time, motion.dt);
                    forces.reaction_on_grab(body, grab, acceleration)?
                }
            };
            all.push((name, reaction));
        }
        all.extend(of_tools);
        if let Some((name, _)) = all.iter().find(|(_, on)| on.force.is_nan()) {
            return Err(Error::Input(format!(
                "\"{name}\" holds nodes of a rigid region, whose forces on single nodes are not known, and so no reaction; make the region stiff instead, hold it by a spring, or leave the reactions out"
            )));
        }
        match all.is_empty() {
            true => Err(Error::Input(
                "nothing holds the body or presses on it, so it exerts no reactions: [[pin]], [[move]] or [[grab]] holds it, a [[tool]] presses"
                    .into(),
            )),
            false => Ok(all),
        }
    }
}
