//! Time series of meshes: ParaView `.pvd` files.

use super::cursor::ParseResult;
use super::vtu_tags::{attribute, for_each_tag};
use super::vtu_write::{self, escaped};
use crate::mesh::{Field, TetMesh};
use crate::{Error, Result};
use glam::DVec3;
use std::io::Write;
use std::path::{Path, PathBuf};

/// An entry of a series.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Its time in seconds.
    pub time: f64,
    /// Its files, at least one: the parts of its mesh. Relative paths are resolved against the
    /// folder of the series.
    pub files: Vec<PathBuf>,
}

impl Frame {
    /// Returns its first file, which names the frame in messages.
    pub fn file(&self) -> &Path {
        self.files.first().map_or(Path::new(""), PathBuf::as_path)
    }

    /// Returns its only file; `None` for several parts.
    pub fn single_file(&self) -> Option<&Path> {
        match &self.files[..] {
            [file] => Some(file),
            _ => None,
        }
    }

    /// Reads the mesh; several parts are joined as the pieces of a `.pvtu`.
    ///
    /// # Errors
    /// As [`read`](super::read).
    pub fn read(&self) -> Result<TetMesh> {
        super::read_parts(&self.files)
    }
}

/// Writer of a series: `name.pvd` and, in the same folder, `name_00000.vtu` and so on.
///
/// The `.pvd` is rewritten after each frame, so an interrupted run leaves a series of all complete
/// frames.
#[derive(Debug)]
pub struct PvdSeries {
    folder: PathBuf,
    name: String,
    frames: Vec<(f64, String)>,
}

impl PvdSeries {
    /// Starts an empty series in `folder`, which is created if necessary. Files of an older series
    /// of the same name are overwritten frame by frame.
    ///
    /// # Errors
    /// An error for a name that is not a plain file name, or if the folder or file cannot be
    /// created.
    pub fn create(folder: impl AsRef<Path>, name: &str) -> Result<PvdSeries> {
        let folder = folder.as_ref().to_path_buf();
        if name.is_empty() || name.contains(['/', '\\']) {
            return Err(Error::Input(format!(
                "invalid series name \"{name}\"; give a file name without folder and without .pvd"
            )));
        }
        std::fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
        let series = PvdSeries {
            folder,
            name: name.to_string(),
            frames: Vec::new(),
        };
        series.write_index()?;
        Ok(series)
    }

    /// Resumes a series whose first frames, at `times`, are in `folder`; later frames are
    /// overwritten.
    ///
    /// # Errors
    /// As [`PvdSeries::create`]; an [`Error::Format`] if the file of one of these frames is
    /// missing.
    pub fn resume(folder: impl AsRef<Path>, name: &str, times: &[f64]) -> Result<PvdSeries> {
        let folder = folder.as_ref();
        let frames = times.iter().enumerate();
        let frames: Vec<(f64, String)> = frames.map(|(i, t)| (*t, file_of(name, i))).collect();
        for (i, (_, file)) in frames.iter().enumerate() {
            let path = folder.join(file);
            if !path.is_file() {
                return Err(Error::format(
                    path,
                    format!("file of finished frame {i} is missing; restart the series"),
                ));
            }
        }
        let series = PvdSeries {
            folder: folder.to_path_buf(),
            name: name.to_string(),
            frames,
        };
        series.write_index()?;
        Ok(series)
    }

    /// Returns the path of the `.pvd` file.
    pub fn path(&self) -> PathBuf {
        self.folder.join(format!("{}.pvd", self.name))
    }

    /// Adds `mesh` at `time` (seconds).
    ///
    /// # Errors
    /// An error for a non-finite time, or if a file cannot be written.
    pub fn push(&mut self, time: f64, mesh: &TetMesh) -> Result<()> {
        self.push_deformed(time, mesh, &mesh.nodes, &[])
    }

    /// Adds `mesh` with its nodes moved to `nodes`, and `extra` fields (displacement, velocity)
    /// that replace those of the mesh of the same name.
    ///
    /// # Errors
    /// An error for a non-finite time, for positions or fields of the wrong length, or if a file
    /// cannot be written.
    pub fn push_deformed(
        &mut self,
        time: f64,
        mesh: &TetMesh,
        nodes: &[DVec3],
        extra: &[Field],
    ) -> Result<()> {
        if !time.is_finite() {
            return Err(Error::Input(format!(
                "time of a frame must be finite, got {time}"
            )));
        }
        let file = file_of(&self.name, self.frames.len());
        vtu_write::write(&self.folder.join(&file), mesh, nodes, extra)?;
        self.frames.push((time, file));
        self.write_index()
    }

    fn write_index(&self) -> Result<()> {
        let mut text = String::from(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n<Collection>\n",
        );
        for (time, file) in &self.frames {
            text += &format!(
                "<DataSet timestep=\"{time}\" group=\"\" part=\"0\" file=\"{}\"/>\n",
                escaped(file)
            );
        }
        text += "</Collection>\n</VTKFile>\n";
        let path = self.path();
        super::atomic_write(&path, |file| {
            file.write_all(text.as_bytes()).map_err(Error::io(&path))
        })
    }
}

/// Returns the file name of frame `i` of a series.
fn file_of(name: &str, i: usize) -> String {
    format!("{name}_{i:05}.vtu")
}

/// Reads the frames of a `.pvd` series, sorted by time. Files of one time with different `part` or
/// `group` are the parts of one frame.
///
/// # Errors
/// An error if the file cannot be read, is damaged, lists no frame, or lists two files for the same
/// part of a frame.
pub fn read_pvd(path: impl AsRef<Path>) -> Result<Vec<Frame>> {
    let path = path.as_ref();
    let bytes = super::content(path)?;
    let listed = parse(&bytes).map_err(|e| Error::format(path, e))?;
    let frames = frames_of(listed).map_err(|e| Error::format(path, e))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let placed = |frame: Frame| Frame {
        files: frame.files.iter().map(|file| folder.join(file)).collect(),
        ..frame
    };
    Ok(frames.into_iter().map(placed).collect())
}

/// A `<DataSet>` tag.
pub(super) struct Listed {
    time: f64,
    /// Its group and its part.
    part: (String, String),
    file: PathBuf,
}

/// Collects the files of each time, sorted by time and part.
pub(super) fn frames_of(mut listed: Vec<Listed>) -> ParseResult<Vec<Frame>> {
    let number = |part: &str| part.trim().parse::<u64>().unwrap_or(u64::MAX);
    listed.sort_by(|a, b| {
        let parts = |l: &Listed| (l.part.0.clone(), number(&l.part.1), l.part.1.clone());
        a.time
            .total_cmp(&b.time)
            .then_with(|| parts(a).cmp(&parts(b)))
    });
    let mut frames: Vec<Frame> = Vec::new();
    let mut last: Option<Listed> = None;
    for entry in listed {
        match (frames.last_mut(), &last) {
            (Some(_), Some(last)) if last.time == entry.time && last.part == entry.part => {
                return Err(format!(
                    "several files for part {:?} at time {}; a series must have one file per part and time",
                    entry.part.1, entry.time
                ));
            }
            (Some(frame), _) if frame.time == entry.time => frame.files.push(entry.file.clone()),
            _ => frames.push(Frame {
                time: entry.time,
                files: vec![entry.file.clone()],
            }),
        }
        last = Some(entry);
    }
    Ok(frames)
}

pub(super) fn parse(bytes: &[u8]) -> ParseResult<Vec<Listed>> {
    let mut frames = Vec::new();
    for_each_tag(bytes, |tag| {
        let value = |name| attribute(tag, name);
        match tag.name().as_ref() {
            b"VTKFile" if value("type").as_deref() != Some("Collection") => {
                return Err(format!(
                    "VTK file contains {:?}, expected \"Collection\" (a series)",
                    value("type").unwrap_or_default()
                ));
            }
            b"DataSet" => {
                let frame = frames.len();
                let file = value("file").filter(|f| !f.is_empty()).ok_or_else(|| {
                    format!("frame {frame} (counted from 0) has no attribute file")
                })?;
                let time = value("timestep").unwrap_or_else(|| frame.to_string());
                let time: f64 = time.trim().parse().map_err(|_| {
                    format!(
                        "frame {frame} (counted from 0) has timestep=\"{time}\", expected a number"
                    )
                })?;
                let part = value("part").filter(|part| !part.trim().is_empty());
                frames.push(Listed {
                    time,
                    part: (
                        value("group").unwrap_or_default(),
                        part.unwrap_or_else(|| "0".into()),
                    ),
                    file: file.into(),
                });
            }
            _ => {}
        }
        Ok(())
    })?;
    match frames.is_empty() {
        true => Err("series has no frames (<DataSet> tags)".into()),
        false => Ok(frames),
    }
}
