//! Checkpoints: everything that a simulation needs to go on where it stopped, in one file, so
//! that the frames that follow are those of a run that was never interrupted, byte for byte.
//!
//! State is kept to the bit. Cuts are kept as the blade and where the body stood when it fell;
//! they are made again, which gives the mesh, the springs, the skins and the lists for drawing
//! as they were.

use super::stage::{NodeSource, Stage};
use super::{PlannedRun, Scene};
use crate::mesh::{Blade, TetMesh};
use crate::physics::{Engine, ExactPositions, GrabId, SimulatorState, StepProgress};
use crate::scene::sleep::Sleep;
use crate::{Error, Result};
use flate2::Crc;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

/// The first line of the file: what it is, and the version of Palpate that wrote it. Another
/// version steps and cuts in its own way.
const HEADER: &str = concat!("palpate checkpoint 5 ", env!("CARGO_PKG_VERSION"), "\n");

/// A cut that was made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct CutMade {
    /// The two ends of the blade's edge, at each of its positions.
    edges: Vec<[[f64; 3]; 2]>,
    pose: ExactPositions,
}

/// What a stage notes so that it can be taken up again: what it began as, and its cuts.
#[derive(Clone, Debug)]
pub(super) struct CutHistory {
    scene: u32,
    mesh: u32,
    cuts: Vec<CutMade>,
}

impl CutHistory {
    /// Takes note of a cut made along `blade` where the body stood in `pose`.
    pub fn note(&mut self, blade: &Blade, pose: ExactPositions) {
        let edges = blade.edges().map(|e| e.map(|p| p.to_array())).collect();
        self.cuts.push(CutMade { edges, pose });
    }
}

/// How far a simulation came, and all that its next steps depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    scene: u32,
    mesh: u32,
    adapter: String,
    engine: Engine,
    run: Option<PlannedRun>,
    times: Vec<f64>,
    cuts: Vec<CutMade>,
    /// Of each cutter, the time up to which it has cut.
    cutters: Vec<Option<f64>>,
    attachments: Vec<(Option<GrabId>, bool)>,
    sleep: Sleep,
    progress: Option<StepProgress>,
    dt: f64,
    /// Of a field that is computed for each picture, what it has been.
    found: Option<(f64, f64)>,
    simulator: SimulatorState,
}

impl Checkpoint {
    /// The times of the frames that were finished, in seconds.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// The graphics adapter that it was made on. Another one rounds differently.
    pub fn adapter(&self) -> &str {
        &self.adapter
    }

    /// The run for which load, step and view were chosen where the scene does not give them.
    pub fn run(&self) -> Option<PlannedRun> {
        self.run
    }

    /// Writes the checkpoint; an older one of that name stays whole until the new one is.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        self.write_file(path.as_ref())
    }

    fn write_file(&self, path: &Path) -> Result<()> {
        let content = postcard::to_stdvec(self)
            .map_err(|e| Error::format(path, format!("the checkpoint cannot be packed: {e}")))?;
        crate::io::atomic_write(path, |file| {
            [HEADER.as_bytes(), &crc(&content).to_le_bytes(), &content]
                .into_iter()
                .try_for_each(|part| file.write_all(part))
                .map_err(Error::io(path))
        })
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Format`] for a file that is no checkpoint, one of another
    /// version, or a damaged one.
    pub fn read(path: impl AsRef<Path>) -> Result<Checkpoint> {
        Checkpoint::read_file(path.as_ref())
    }

    fn read_file(path: &Path) -> Result<Checkpoint> {
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        let afresh = "run without --resume to start afresh";
        let kind = b"palpate checkpoint ";
        let Some(rest) = bytes.strip_prefix(HEADER.as_bytes()) else {
            let line = bytes.split(|b| *b == b'\n').next().unwrap_or_default();
            let what = match line.strip_prefix(kind) {
                Some(version) if version.len() < 40 => format!(
                    "this checkpoint is of version {}, this is version {}, which does not step the same; {afresh}",
                    String::from_utf8_lossy(version),
                    HEADER.trim_start_matches("palpate checkpoint ").trim_end(),
                ),
                _ => format!("this is no checkpoint; {afresh}"),
            };
            return Err(Error::format(path, what));
        };
        let damaged = || Error::format(path, format!("the checkpoint is damaged; {afresh}"));
        let (sum, content) = rest.split_first_chunk::<4>().ok_or_else(damaged)?;
        if u32::from_le_bytes(*sum) != crc(content) {
            return Err(damaged());
        }
        postcard::from_bytes(content).map_err(|_| damaged())
    }
}

fn crc(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// What tells a scene from another: all its entries, and the files that it names beside the mesh.
/// Where these lie does not matter.
pub(crate) fn scene_hash(scene: &Scene) -> u32 {
    let mut crc = Crc::new();
    let mut plain = scene.clone();
    let mut file = |path: &mut std::path::PathBuf| {
        // A file that cannot be read has made the scene fail before.
        crc.update(&std::fs::read(&*path).unwrap_or_default());
        *path = path.file_name().unwrap_or_default().into();
    };
    let moves = plain.moves.iter_mut().filter_map(|m| m.file.as_mut());
    moves.for_each(&mut file);
    for tool in &mut plain.tool {
        let files = [&mut tool.file, &mut tool.surface];
        files.into_iter().flatten().for_each(&mut file);
    }
    for skin in &mut plain.skin {
        file(&mut skin.file);
        skin.normal_map.iter_mut().for_each(&mut file);
        skin.height_map.iter_mut().for_each(&mut file);
    }
    for transfer in plain.picture.transfer_files() {
        let mut path = transfer.as_str().into();
        file(&mut path);
        *transfer = path.to_string_lossy().into_owned();
    }
    let bodies = plain.body.iter_mut().map(|body| &mut body.mesh);
    for mesh in bodies.chain([&mut plain.mesh]) {
        let joined = mesh.join.iter_mut().filter_map(|other| other.file.as_mut());
        for path in mesh.file.iter_mut().chain(joined) {
            *path = path.file_name().unwrap_or_default().into();
        }
    }
    crc.update(format!("{plain:?}").as_bytes());
    crc.sum()
}

/// What tells a mesh from another: nodes, tets and fields.
fn of_mesh(mesh: &TetMesh) -> u32 {
    let mut crc = Crc::new();
    let nodes: Vec<[f64; 3]> = mesh.nodes.iter().map(|p| p.to_array()).collect();
    crc.update(bytemuck::cast_slice(&nodes));
    crc.update(bytemuck::cast_slice(&mesh.tets));
    for field in &mesh.fields {
        crc.update(field.name.as_bytes());
        crc.update(bytemuck::cast_slice(&field.values));
    }
    crc.sum()
}

impl Stage {
    /// Keeps what [`Stage::checkpoint`] needs from now on: to be called before the first step.
    pub fn keep_checkpoints(&mut self) {
        self.journal = Some(CutHistory {
            scene: scene_hash(&self.scene),
            mesh: of_mesh(self.mesh()),
            cuts: Vec::new(),
        });
    }

    /// Where the simulation is, read back. `times` are those of the frames finished so far.
    ///
    /// # Errors
    /// [`Error::Input`] where nothing moves, or [`Stage::keep_checkpoints`] was not called;
    /// otherwise what reading back gives.
    pub fn checkpoint(&self, times: &[f64]) -> Result<Checkpoint> {
        let (Some(journal), NodeSource::Simulated(motion)) = (&self.journal, &self.drive) else {
            return Err(Error::Input(
                "a checkpoint is of a simulation that keeps them from its first step on".into(),
            ));
        };
        Ok(Checkpoint {
            scene: journal.scene,
            mesh: journal.mesh,
            adapter: self.gpu.adapter_name(),
            engine: motion.engine(),
            run: self.scene.solver.run,
            times: times.to_vec(),
            cuts: journal.cuts.clone(),
            cutters: self.cutters.iter().map(|c| c.cut).collect(),
            attachments: motion
                .attachments
                .iter()
                .map(|a| (a.grab, a.done))
                .collect(),
            sleep: motion.sleep,
            progress: motion.progress,
            dt: motion.dt,
            found: self.computed_field.as_ref().map(|s| s.observed_range),
            simulator: motion.simulator.state()?,
        })
    }

    /// Brings a stage that was not stepped yet to where `checkpoint` was made. The next steps are
    /// those that would have followed it.
    ///
    /// # Errors
    /// [`Error::Input`] when it is of another scene or mesh, or does not fit this one; the stage
    /// is of no use then.
    pub fn resume(&mut self, checkpoint: &Checkpoint) -> Result<()> {
        self.keep_checkpoints();
        let Some(journal) = &self.journal else {
            return Ok(());
        };
        let other = |what: &str| {
            Err(Error::Input(format!(
                "the checkpoint is of another {what}; run without --resume to start afresh"
            )))
        };
        if journal.scene != checkpoint.scene {
            return other(
                "scene, or this one was changed since (its entries, the flags, or a file it names)",
            );
        }
        if journal.mesh != checkpoint.mesh {
            return other("mesh, or this one was changed since");
        }
        if let Some(motion) = self.motion()
            && motion.engine() != checkpoint.engine
        {
            let engine = checkpoint.engine;
            return Err(Error::Input(format!(
                "the checkpoint is of steps on the {engine}; run with --engine {engine}, or without --resume to start afresh"
            )));
        }
        for cut in &checkpoint.cuts {
            let edges: Vec<[DVec3; 2]> = cut.edges.iter().map(|e| e.map(DVec3::from)).collect();
            let blade = Blade::from_sweep(&edges)?;
            if let NodeSource::Simulated(motion) = &mut self.drive {
                motion.simulator.set_pose(&cut.pose)?;
            }
            self.cut(&blade)?;
        }
        let NodeSource::Simulated(motion) = &mut self.drive else {
            return other("kind: nothing moves in this scene");
        };
        let fits = motion.attachments.len() == checkpoint.attachments.len()
            && self.cutters.len() == checkpoint.cutters.len()
            && motion.dt == checkpoint.dt;
        if !fits {
            return other("scene: grabs, cuts and step size are not the same");
        }
        for (cutter, cut) in self.cutters.iter_mut().zip(&checkpoint.cutters) {
            cutter.cut = *cut;
        }
        let attachments = motion.attachments.iter_mut();
        for (attachment, (grab, done)) in attachments.zip(&checkpoint.attachments) {
            (attachment.grab, attachment.done) = (*grab, *done);
        }
        motion.simulator.set_state(&checkpoint.simulator)?;
        motion.sleep = checkpoint.sleep;
        motion.progress = checkpoint.progress;
        if let (Some(shown), Some(found)) = (&mut self.computed_field, checkpoint.found) {
            shown.observed_range = found;
        }
        self.cached = None;
        Ok(())
    }

    /// Where the body stands, as a cut finds it.
    pub(super) fn pose_now(&self) -> Result<Option<ExactPositions>> {
        let motion = self.motion();
        motion.map(|motion| motion.simulator.pose()).transpose()
    }
}
