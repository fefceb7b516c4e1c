//! What each frame took, a line of JSON each.

use palpate::{Error, Result};
use serde::Serialize;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A frame of the window.
#[derive(Clone, Debug, Serialize)]
pub struct Frame {
    /// Since the frame before, ms.
    pub frame_ms: f64,
    /// What the interface took of that, ms.
    pub ui_ms: f64,
    /// What the driver took of that to take over what is drawn, ms: of a software driver, part of the
    /// drawing.
    pub driver_ms: f64,
    /// What the frame before took after that until it was on the screen, ms: of a software driver, all
    /// that it draws.
    pub paint_ms: f64,
    /// From what was done by hand to the picture that shows it on the screen, ms, of the last such.
    pub latency_ms: Option<f64>,
    /// Steps there were since the body was opened.
    pub steps: u64,
    /// Iterations of conjugate gradients in the last of them.
    pub iterations: u32,
    /// Pictures that were drawn.
    pub pictures: u64,
    /// Tets of the body.
    pub tets: usize,
    /// Eye, and what it looks at, in file units.
    pub camera: [[f64; 3]; 2],
    /// Force of a press, N.
    pub force_n: Option<f64>,
    /// How deep it is, m.
    pub depth_m: Option<f64>,
    /// Memory of the process, MB, where the system tells it.
    pub memory_mb: Option<f64>,
    /// Bodies that were opened.
    pub opened: u64,
    /// Why the device is gone.
    pub lost: Option<String>,
    /// What is said in the status line.
    pub said: String,
    /// Whether that is an error.
    pub error: bool,
    /// What is open.
    pub name: Option<String>,
    /// What is being opened.
    pub loading: Option<String>,
    /// Simulated time, s.
    pub time_s: f64,
    /// Whether time goes by.
    pub playing: bool,
    /// Of a recorded series the frame that is shown, from 0.
    pub series_frame: Option<usize>,
    /// Planes there are: a point and the normal of each.
    pub planes: Vec<[f64; 6]>,
    /// Whether anything is under way: a step, a body that is made ready, a finer picture.
    pub busy: bool,
    /// Where the pointer is, in points.
    pub pointer: Option<[f32; 2]>,
    /// Whether any of its buttons is down.
    pub down: bool,
    /// Keys that were hit.
    pub keys: u64,
}

/// A file of frames.
pub struct FrameLog {
    path: PathBuf,
    out: BufWriter<File>,
}

impl FrameLog {
    /// Begins one.
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be written.
    pub fn create(path: &Path) -> Result<FrameLog> {
        let out = BufWriter::new(File::create(path).map_err(Error::io(path))?);
        Ok(FrameLog {
            path: path.to_path_buf(),
            out,
        })
    }

    /// Adds a frame; whoever reads along has it at once.
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be written.
    pub fn push(&mut self, frame: &Frame) -> Result<()> {
        let io = Error::io(&self.path);
        let written = serde_json::to_writer(&mut self.out, frame)
            .map_err(std::io::Error::from)
            .and_then(|()| self.out.write_all(b"\n"))
            .and_then(|()| self.out.flush());
        written.map_err(io)
    }
}

/// Memory of this process, MB, where the system tells it.
#[cfg(not(target_arch = "wasm32"))]
pub fn memory_mb() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: f64 = text.split_whitespace().nth(1)?.parse().ok()?;
    Some(pages * 4096.0 * 1e-6)
}

/// Memory of the module, MB.
#[cfg(target_arch = "wasm32")]
pub fn memory_mb() -> Option<f64> {
    Some(core::arch::wasm32::memory_size(0) as f64 * 65536.0 * 1e-6)
}
