//! Reactions of a body at its supports, grabs and tools, as a table over the frames.

use super::Motion;
use super::stage::Stage;
use crate::io::atomic_write;
use crate::mesh::TetCut;
use crate::physics::{Engine, NodalForces, Reaction};
use crate::{Error, Result};
use std::io::Write;
use std::path::{Path, PathBuf};

/// First line of the table.
const HEADER: &str = "time_s,name,fx,fy,fz,mx,my,mz,force_error_n";

/// A named group of pinned nodes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NamedPins {
    pub name: String,
    pub nodes: Vec<u32>,
}

/// A CSV file of the reactions at all supports, for each frame of a run: its time in s, the name of
/// the pin, move, grab or tool, the force in N and the moment in N·m about the origin of the file's
/// coordinates, for a kinematic tool about its centre, and for a dynamic tool about its centre of
/// mass. The spring of a tool has a row of its own, `NAME spring`.
///
/// The force is exerted by the body in the state of the frame: elastic and damping forces, weight
/// and external forces of the constrained nodes, minus their inertia if they move. For a grab with
/// springs it is the spring force; for an inactive grab it is zero. Only the CPU engine provides
/// reactions, for tetrahedral bodies. The last column is the estimated error of the length of the
/// force, N, in a frame that [`ReactionLog::set_errors`] was called for, and empty in others.
///
/// The file is rewritten atomically with every frame.
#[derive(Clone, Debug)]
pub struct ReactionLog {
    path: PathBuf,
    lines: Vec<String>,
}

impl ReactionLog {
    /// Creates a table without frames at `path`.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn create(path: impl AsRef<Path>) -> Result<ReactionLog> {
        let log = ReactionLog {
            path: path.as_ref().to_path_buf(),
            lines: Vec::new(),
        };
        log.write()?;
        Ok(log)
    }

    /// Resumes a table with the frames at `times`; later frames are dropped.
    ///
    /// # Errors
    /// [`Error::Format`] if the table is invalid, or lacks one of these frames.
    pub fn resume(path: impl AsRef<Path>, times: &[f64]) -> Result<ReactionLog> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
        let mut lines = text.lines();
        if lines.next() != Some(HEADER) {
            return Err(Error::format(
                path,
                format!("is not a table of reactions: the first line must be {HEADER}"),
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
                        "the reactions of frame {i}, at {time} s, are missing; start the run again without --resume"
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
    /// As [`Stage::reactions`]; [`Error::Io`] if the table cannot be written.
    pub fn push(&mut self, stage: &mut Stage) -> Result<()> {
        let time = stage.time();
        for (name, Reaction { force, moment }) in stage.reactions()? {
            let numbers = [force, moment].map(|v| format!("{},{},{}", v.x, v.y, v.z));
            let name = quoted(&name);
            self.lines
                .push(format!("{time},{name},{},", numbers.join(",")));
        }
        self.write()
    }

    /// Sets the errors of the forces of the last frame: names as in the table, with errors in N.
    ///
    /// # Errors
    /// [`Error::Io`] if the table cannot be written.
    pub fn set_errors(&mut self, errors: &[(String, f64)]) -> Result<()> {
        let time_of = |line: &str| line.split(',').next().map(str::to_owned);
        let Some(last) = self.lines.last().and_then(|line| time_of(line)) else {
            return Ok(());
        };
        for line in &mut self.lines {
            let Some(cells) = line.strip_prefix(&format!("{last},")) else {
                continue;
            };
            let of_row = |(name, _): &&(String, f64)| {
                let rest = cells.strip_prefix(&quoted(name));
                rest.is_some_and(|rest| rest.starts_with(','))
            };
            if let Some((_, error)) = errors.iter().find(of_row) {
                let numbers = line.rfind(',').map_or(line.len(), |end| end + 1);
                line.replace_range(numbers.., &error.to_string());
            }
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

/// Returns a table cell on one line, quoted if necessary.
fn quoted(text: &str) -> String {
    let text = text.replace(['\n', '\r'], " ");
    match text.contains([',', '"']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text,
    }
}

impl NamedPins {
    /// Applies a cut: duplicated nodes are pinned like their originals.
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
    /// Returns the reactions at the pins, moves, grabs and tools in the current state, by name and
    /// in this order. Moments are about the origin of the file's coordinates, of tools about their
    /// centres. A body on the GPU has reactions of tools only.
    ///
    /// # Errors
    /// [`Error::Input`] for a static body or one without supports; otherwise as
    /// [`Reactions::nodal_forces`](crate::physics::Reactions::nodal_forces).
    pub fn reactions(&mut self) -> Result<Vec<(String, Reaction)>> {
        let Some(motion) = self.motion_mut() else {
            return Err(Error::Input(
                "a static body has no reactions; set a solver, such as --solver implicit".into(),
            ));
        };
        let all = motion.reactions()?;
        if let Some((name, _)) = all.iter().find(|(_, on)| on.force.is_nan()) {
            return Err(Error::Input(format!(
                "no reaction of \"{name}\": it constrains nodes of a rigid region, whose nodal forces are unknown; make the region stiff instead of rigid, hold it by a spring, or remove --reactions"
            )));
        }
        match all.is_empty() {
            true => Err(Error::Input(
                "no reactions: the body has no supports or tools; add a [[pin]], [[move]], [[grab]] or [[tool]]"
                    .into(),
            )),
            false => Ok(all),
        }
    }
}

impl Motion {
    /// Returns the reactions of [`Stage::reactions`]: none without supports, NaN at nodes of rigid
    /// regions.
    ///
    /// # Errors
    /// As [`Reactions::nodal_forces`](crate::physics::Reactions::nodal_forces).
    pub(crate) fn reactions(&mut self) -> Result<Vec<(String, Reaction)>> {
        let time = self.time();
        let of_tools = self.tool_reactions()?;
        // The GPU engine provides the forces on tools, but not those on nodes.
        if self.simulator.engine() == Engine::Gpu && !of_tools.is_empty() {
            return Ok(of_tools);
        }
        let forces = NodalForces::of(self.simulator.as_mut())?;
        let body = self.simulator.as_ref();
        let pins = self.pins.iter();
        let mut all: Vec<(String, Reaction)> = pins
            .map(|pin| (pin.name.clone(), forces.reaction_on_pins(&pin.nodes)))
            .collect();
        let unit = body.loads().frame_and_unit().1;
        for scheduled_motion in &self.time_dependent_loads.scheduled_motions {
            let nodes = scheduled_motion.accelerations(time, self.dt);
            let reaction = forces.reaction_on_motion(nodes.map(|(v, a)| (v, unit * a)));
            all.push((scheduled_motion.name.clone(), reaction));
        }
        for (i, attachment) in self.attachments.iter().enumerate() {
            let reaction = match attachment.grab {
                None => Reaction::default(),
                Some(grab) => {
                    let acceleration = unit * attachment.acceleration(time, self.dt);
                    forces.reaction_on_grab(body, grab, acceleration)?
                }
            };
            all.push((attachment.name_or_number(i), reaction));
        }
        all.extend(of_tools);
        Ok(all)
    }
}
