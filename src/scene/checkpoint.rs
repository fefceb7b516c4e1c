//! Checkpoints: a file with the complete state of a simulation, from which a resumed run produces
//! the same frames as an uninterrupted one, byte for byte.
//!
//! The state is stored exactly. Cuts are stored as the blade and the positions of the body at the
//! time of the cut; they are repeated on resume, which restores the mesh, springs, skins and draw
//! lists.

use super::stage::{NodeSource, Stage};
use super::{PlannedRun, Scene};
use crate::mesh::{Blade, TetMesh};
use crate::physics::{Capability, Engine, ExactPositions, GrabId, SimulatorState, StepProgress};
use crate::scene::sleep::Sleep;
use crate::{Error, Result};
use flate2::Crc;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};

/// First line of the file: its type and the version of Palpate that wrote it. Steps and cuts may
/// differ between versions.
const HEADER: &str = concat!("palpate checkpoint 5 ", env!("CARGO_PKG_VERSION"), "\n");

/// A cut and the positions of the body at that time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct CutMade {
    /// End points of the blade's edge, at each of its positions.
    edges: Vec<[[f64; 3]; 2]>,
    pose: ExactPositions,
}

/// History of a stage for checkpoints: checksums of its scene and mesh, and its cuts.
#[derive(Clone, Debug)]
pub(super) struct CutHistory {
    scene: u32,
    mesh: u32,
    cuts: Vec<CutMade>,
}

impl CutHistory {
    /// Records a cut along `blade`, made with the body in `pose`.
    pub fn note(&mut self, blade: &Blade, pose: ExactPositions) {
        let edges = blade.edges().map(|e| e.map(|p| p.to_array())).collect();
        self.cuts.push(CutMade { edges, pose });
    }
}

/// State of a simulation on which its next steps depend.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    scene: u32,
    mesh: u32,
    adapter: String,
    engine: Engine,
    run: Option<PlannedRun>,
    times: Vec<f64>,
    cuts: Vec<CutMade>,
    /// Time up to which each cutter has cut.
    cutters: Vec<Option<f64>>,
    attachments: Vec<(Option<GrabId>, bool)>,
    sleep: Sleep,
    progress: Option<StepProgress>,
    dt: f64,
    /// Range so far of a computed field.
    found: Option<(f64, f64)>,
    simulator: SimulatorState,
}

impl Checkpoint {
    /// Returns the times of the finished frames, s.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Returns the graphics adapter on which it was made. Rounding differs between adapters.
    pub fn adapter(&self) -> &str {
        &self.adapter
    }

    /// Returns the run for which the default load, step and view were chosen.
    pub fn run(&self) -> Option<PlannedRun> {
        self.run
    }

    /// Writes the checkpoint atomically: an older file of that name stays valid until replaced.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        self.write_file(path.as_ref())
    }

    fn write_file(&self, path: &Path) -> Result<()> {
        let content = postcard::to_stdvec(self)
            .map_err(|e| Error::format(path, format!("cannot encode the checkpoint: {e}")))?;
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
    /// [`Error::Io`], or [`Error::Format`] if the file is not a checkpoint, is of another version
    /// or is damaged.
    pub fn read(path: impl AsRef<Path>) -> Result<Checkpoint> {
        Checkpoint::read_file(path.as_ref())
    }

    fn read_file(path: &Path) -> Result<Checkpoint> {
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        let afresh = "run without --resume to start again";
        let kind = b"palpate checkpoint ";
        let Some(rest) = bytes.strip_prefix(HEADER.as_bytes()) else {
            let line = bytes.split(|b| *b == b'\n').next().unwrap_or_default();
            let what = match line.strip_prefix(kind) {
                Some(version) if version.len() < 40 => format!(
                    "checkpoint version {} is not compatible with version {} of this program; {afresh}",
                    String::from_utf8_lossy(version),
                    HEADER.trim_start_matches("palpate checkpoint ").trim_end(),
                ),
                _ => format!("not a checkpoint; {afresh}"),
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

/// Returns a checksum of a scene: all its entries and the contents of the files that it names,
/// except meshes. The folders of the files do not matter.
pub(crate) fn scene_hash(scene: &Scene) -> u32 {
    let mut crc = Crc::new();
    let mut plain = scene.clone();
    // A key under its old name does not change the scene.
    plain.notes.clear();
    let mut file = |path: &mut std::path::PathBuf| {
        for part in files_of(path) {
            // A file that cannot be read has caused an error earlier.
            crc.update(&std::fs::read(part).unwrap_or_default());
        }
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
    for scan in &mut plain.scan {
        file(&mut scan.file);
    }
    let of_scans = plain
        .scan
        .iter_mut()
        .filter_map(|scan| scan.transfer_file());
    for transfer in plain.picture.transfer_files().chain(of_scans) {
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

/// Returns the file itself, or the files of a folder of slices by name.
fn files_of(path: &Path) -> Vec<PathBuf> {
    match std::fs::read_dir(path) {
        Ok(entries) => {
            let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
            files.sort();
            files
        }
        Err(_) => vec![path.to_owned()],
    }
}

/// Returns a checksum of the nodes, tetrahedra and fields of a mesh.
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
    /// Starts recording what [`Stage::checkpoint`] needs; call it before the first step.
    pub fn keep_checkpoints(&mut self) {
        self.journal = Some(CutHistory {
            scene: scene_hash(&self.scene),
            mesh: of_mesh(self.mesh()),
            cuts: Vec::new(),
        });
    }

    /// Reads back the state of the simulation. `times` are those of the finished frames.
    ///
    /// # Errors
    /// [`Error::Input`] for a static body, or without [`Stage::keep_checkpoints`]; otherwise an
    /// error of the read-back.
    pub fn checkpoint(&self, times: &[f64]) -> Result<Checkpoint> {
        let (Some(journal), NodeSource::Simulated(motion)) = (&self.journal, &self.drive) else {
            return Err(Error::Input(
                "no checkpoint available: call `keep_checkpoints` before the first step of a simulation".into(),
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
            found: self.looks.computed_field.as_ref().map(|s| s.observed_range),
            simulator: Capability::Checkpoints
                .require(motion.simulator.checkpoint())?
                .state()?,
        })
    }

    /// Restores the state of `checkpoint` in a stage that was not stepped yet. The next steps are
    /// the same as those after the checkpoint.
    ///
    /// # Errors
    /// [`Error::Input`] if it is of another scene or mesh, or incompatible; the stage is unusable
    /// then.
    pub fn resume(&mut self, checkpoint: &Checkpoint) -> Result<()> {
        self.keep_checkpoints();
        let Some(journal) = &self.journal else {
            return Ok(());
        };
        let other = |what: &str| {
            Err(Error::Input(format!(
                "the checkpoint belongs to a different {what}; run without --resume to start again"
            )))
        };
        if journal.scene != checkpoint.scene {
            return other(
                "scene, or the scene has changed since (its entries, the flags, or a file it refers to)",
            );
        }
        if journal.mesh != checkpoint.mesh {
            return other("mesh, or the mesh has changed since");
        }
        if let Some(motion) = self.motion()
            && motion.engine() != checkpoint.engine
        {
            let engine = checkpoint.engine;
            return Err(Error::Input(format!(
                "the checkpoint was computed by engine {engine}; run with --engine {engine}, or without --resume to start again"
            )));
        }
        for cut in &checkpoint.cuts {
            let edges: Vec<[DVec3; 2]> = cut.edges.iter().map(|e| e.map(DVec3::from)).collect();
            let blade = Blade::from_sweep(&edges)?;
            if let NodeSource::Simulated(motion) = &mut self.drive {
                let saved = motion.simulator.checkpoint_mut();
                Capability::Checkpoints
                    .require(saved)?
                    .set_exact_positions(&cut.pose)?;
            }
            self.cut(&blade)?;
        }
        let NodeSource::Simulated(motion) = &mut self.drive else {
            return other("kind: this scene is static");
        };
        let fits = motion.attachments.len() == checkpoint.attachments.len()
            && self.cutters.len() == checkpoint.cutters.len()
            && motion.dt == checkpoint.dt;
        if !fits {
            return other("scene: the grabs, cuts or time step differ");
        }
        for (cutter, cut) in self.cutters.iter_mut().zip(&checkpoint.cutters) {
            cutter.cut = *cut;
        }
        let attachments = motion.attachments.iter_mut();
        for (attachment, (grab, done)) in attachments.zip(&checkpoint.attachments) {
            (attachment.grab, attachment.done) = (*grab, *done);
        }
        let saved = motion.simulator.checkpoint_mut();
        let saved = Capability::Checkpoints.require(saved)?;
        saved.set_state(&checkpoint.simulator)?;
        motion.sleep = checkpoint.sleep;
        motion.progress = checkpoint.progress;
        if let (Some(shown), Some(found)) = (&mut self.looks.computed_field, checkpoint.found) {
            shown.observed_range = found;
        }
        self.cached = None;
        Ok(())
    }

    /// Returns the current exact positions, as recorded with a cut.
    pub(super) fn current_exact_positions(&self) -> Result<Option<ExactPositions>> {
        let Some(motion) = self.motion() else {
            return Ok(None);
        };
        let saved = Capability::Checkpoints.require(motion.simulator.checkpoint())?;
        Ok(Some(saved.exact_positions()?))
    }
}
