//! Frame log: timings and state of each frame, one JSON object per line.

use palpate::{Error, Result};
use serde::Serialize;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// A frame of the window.
#[derive(Clone, Debug, Serialize)]
pub struct Frame {
    /// Number of the frame, from 1.
    pub number: u64,
    /// Number of the last frame that was presented.
    pub presented: u64,
    /// Whether the interface requested another frame immediately after it.
    pub soon: bool,
    /// Time since the previous frame, ms.
    pub frame_ms: f64,
    /// Time of the interface, ms.
    pub ui_ms: f64,
    /// Time of the driver for the submit, ms; with a software driver this includes part of the
    /// rendering.
    pub driver_ms: f64,
    /// Time from the end of the interface of the previous frame to its presentation, ms; with a
    /// software driver this includes all rendering.
    pub paint_ms: f64,
    /// Latency of the last user input to the presentation of its picture, ms.
    pub latency_ms: Option<f64>,
    /// Number of steps since the body was opened.
    pub steps: u64,
    /// Conjugate gradient iterations in the last step.
    pub iterations: u32,
    /// Number of pictures rendered.
    pub pictures: u64,
    /// Samples per pixel of the light paths shown.
    pub light_path_samples: Option<u32>,
    /// Number of tets.
    pub tets: usize,
    /// Eye and focus, in file units.
    pub camera: [[f64; 3]; 2],
    /// Force of a press, N.
    pub force_n: Option<f64>,
    /// Its error, N, once it is estimated.
    pub force_error_n: Option<f64>,
    /// Whether that error was estimated at this depth.
    pub force_error_is_estimated: Option<bool>,
    /// Most exact force at this depth on a finer mesh, and its error, N.
    pub refined_force_n: Option<[f64; 2]>,
    /// Indentation depth of a press, m.
    pub depth_m: Option<f64>,
    /// Memory of the process, MB, if the system reports it.
    pub memory_mb: Option<f64>,
    /// Number of readbacks from the device.
    pub readbacks: u64,
    /// Bytes of all buffers and arrays allocated on the device so far.
    pub bytes_allocated: u64,
    /// Number of bodies opened.
    pub opened: u64,
    /// Reason for device loss.
    pub lost: Option<String>,
    /// Text of the status line.
    pub said: String,
    /// Whether the status line shows an error.
    pub error: bool,
    /// Name of the open document.
    pub name: Option<String>,
    /// Name of the document being opened.
    pub loading: Option<String>,
    /// Number of progress reports of that task.
    pub reports: u64,
    /// Number of background tasks whose threads have not ended, cancelled ones included.
    pub tasks: usize,
    /// Simulated time, s.
    pub time_s: f64,
    /// Whether the simulation or series is playing.
    pub playing: bool,
    /// Displayed frame of a recorded series, from 0.
    pub series_frame: Option<usize>,
    /// Point and normal of each plane.
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

/// The presentation of a frame.
#[derive(Clone, Debug, Serialize)]
pub struct Presented {
    /// Number of the frame.
    pub presented: u64,
    /// Whether the interface requested another frame immediately.
    pub soon: bool,
    /// Number of live allocations on the device, if no frame was requested and the driver reports
    /// them.
    pub allocations: Option<usize>,
    /// Bytes of the live allocations.
    pub device_bytes: Option<u64>,
}

/// A log file of frames and their presentations.
#[derive(Clone)]
pub struct FrameLog {
    path: PathBuf,
    out: Arc<Mutex<BufWriter<File>>>,
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
            out: Arc::new(Mutex::new(out)),
        })
    }

    /// Appends a line and flushes, so that readers see it at once.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn push(&self, line: &impl Serialize) -> Result<()> {
        let io = Error::io(&self.path);
        let mut out = self.out.lock().unwrap_or_else(PoisonError::into_inner);
        let written = serde_json::to_writer(&mut *out, line)
            .map_err(std::io::Error::from)
            .and_then(|()| out.write_all(b"\n"))
            .and_then(|()| out.flush());
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
