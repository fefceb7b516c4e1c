//! Frame log: timings and state of each frame, one JSON object per line.

use palpate::{Error, Result};
use serde::Serialize;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A frame of the window.
#[derive(Clone, Debug, Serialize)]
pub struct Frame {
    /// Time since the previous frame, ms.
    pub frame_ms: f64,
    /// Time of the interface, ms.
    pub ui_ms: f64,
    /// Time of the driver for the submit, ms; with a software driver this includes part of the
    /// rendering.
    pub driver_ms: f64,
    /// What the frame before took after that until it was on the screen, ms: of a software driver, all
    /// that it draws.
    pub paint_ms: f64,
    /// Latency of the last user input to the presentation of its picture, ms.
    pub latency_ms: Option<f64>,
    /// Number of steps since the body was opened.
    pub steps: u64,
    /// Conjugate gradient iterations in the last step.
    pub iterations: u32,
    /// Number of pictures rendered.
    pub pictures: u64,
    /// Number of tets.
    pub tets: usize,
    /// Eye and focus, in file units.
    pub camera: [[f64; 3]; 2],
    /// Force of a press, N.
    pub force_n: Option<f64>,
    /// Indentation depth, m.
    pub depth_m: Option<f64>,
    /// Memory of the process, MB, if the system reports it.
    pub memory_mb: Option<f64>,
    /// Number of bodies opened.
    pub opened: u64,
    /// Reason for device loss.
    pub lost: Option<String>,
    /// Text of the status line.
    pub said: String,
    /// Whether that is an error.
    pub error: bool,
    /// Name of the open document.
    pub name: Option<String>,
    /// Name of the document being opened.
    pub loading: Option<String>,
    /// Simulated time, s.
    pub time_s: f64,
    /// Whether the simulation or series is playing.
    pub playing: bool,
    /// Displayed frame of a recorded series, from 0.
    pub series_frame: Option<usize>,
    /// Planes: a point and the normal of each.
    pub planes: Vec<[f64; 6]>,
    /// Whether work is pending: a step, loading, or a refinement.
    pub busy: bool,
    /// Pointer position, in points.
    pub pointer: Option<[f32; 2]>,
    /// Whether a pointer button is down.
    pub down: bool,
    /// Number of keys pressed.
    pub keys: u64,
}

/// A log file of frames.
pub struct FrameLog {
    path: PathBuf,
    out: BufWriter<File>,
}

impl FrameLog {
    /// Creates a log file.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn create(path: &Path) -> Result<FrameLog> {
        let out = BufWriter::new(File::create(path).map_err(Error::io(path))?);
        Ok(FrameLog {
            path: path.to_path_buf(),
            out,
        })
    }

    /// Appends a frame and flushes, so that readers see it at once.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn push(&mut self, frame: &Frame) -> Result<()> {
        let io = Error::io(&self.path);
        let written = serde_json::to_writer(&mut self.out, frame)
            .map_err(std::io::Error::from)
            .and_then(|()| self.out.write_all(b"\n"))
            .and_then(|()| self.out.flush());
        written.map_err(io)
    }
}

/// Returns the memory of this process, MB, if the system reports it.
#[cfg(not(target_arch = "wasm32"))]
pub fn memory_mb() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: f64 = text.split_whitespace().nth(1)?.parse().ok()?;
    Some(pages * 4096.0 * 1e-6)
}

/// Returns the memory of the module, MB.
#[cfg(target_arch = "wasm32")]
pub fn memory_mb() -> Option<f64> {
    Some(core::arch::wasm32::memory_size(0) as f64 * 65536.0 * 1e-6)
}
