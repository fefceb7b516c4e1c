//! Reader for streams of frames of a body that is moved by another program.

use crate::mesh::TetMesh;
use crate::{Error, Result};
use glam::DVec3;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Magic bytes at the start of a stream.
const MAGIC: &[u8; 8] = b"PALPATE1";

/// A stream of frames in the layout of docs/how-to/frames.md: `PALPATE1`, the numbers of nodes and of tets
/// (u32), then the rest positions of the nodes (f64 × 3 each) and the nodes of every tet (u32 × 4
/// each), unless there are 0 tets; then, for each frame, its time in s (f64) and the positions of
/// the nodes (f64 × 3 each), in the mesh's unit. All little-endian. The stream ends at a frame
/// boundary.
pub struct FrameStream<R> {
    from: R,
    name: PathBuf,
    nodes: usize,
    frames: usize,
    /// Number of bytes read.
    at: u64,
}

/// A frame: its time in s, and the positions of the nodes.
pub(crate) type TimedPositions = (f64, Vec<DVec3>);

impl<R: Read> FrameStream<R> {
    /// Reads the header of a stream, named `name` in errors, and its mesh, if there is one.
    ///
    /// # Errors
    /// An [`Error::Format`] for invalid or truncated data and for an invalid mesh; an [`Error::Io`]
    /// if the stream cannot be read.
    pub fn new(from: R, name: impl AsRef<Path>) -> Result<(FrameStream<R>, Option<TetMesh>)> {
        let mut stream = FrameStream {
            from,
            name: name.as_ref().to_path_buf(),
            nodes: 0,
            frames: 0,
            at: 0,
        };
        let head = stream.bytes(16, "its first 16 bytes")?;
        if &head[..8] != MAGIC {
            return Err(stream.wrong("is not a frame stream: expected PALPATE1 at the start"));
        }
        let count = |k: usize| u32::from_le_bytes([0, 1, 2, 3].map(|b| head[k + b])) as usize;
        let tets = count(12);
        stream.nodes = count(8);
        if stream.nodes == 0 {
            return Err(stream.wrong("number of nodes must be ≥ 1, got 0"));
        }
        if tets == 0 {
            return Ok((stream, None));
        }
        let rest = stream.points("its node positions at rest")?;
        let bytes = stream.bytes(16 * tets as u64, "its tets")?;
        let words = bytes.chunks_exact(4);
        let words: Vec<u32> = words
            .map(|w| u32::from_le_bytes([w[0], w[1], w[2], w[3]]))
            .collect();
        let tets = words.chunks_exact(4).map(|t| [t[0], t[1], t[2], t[3]]);
        let mesh = TetMesh::new(rest.clone(), tets.collect(), Vec::new(), Vec::new())
            .map_err(|e| stream.wrong(&format!("has an invalid mesh: {e}")))?;
        // Frames use the node order of the stream.
        if mesh.nodes != rest {
            return Err(stream.wrong(
                "has a mesh with unused nodes or degenerate tets; remove them from the mesh and \
                the frames",
            ));
        }
        Ok((stream, Some(mesh)))
    }

    /// Returns the number of nodes of a frame.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Reads the next frame, as soon as it is complete; `None` at the end.
    ///
    /// # Errors
    /// An [`Error::Format`] for a truncated frame or a non-finite number; an [`Error::Io`] if it
    /// cannot be read.
    pub fn next_frame(&mut self) -> Result<Option<TimedPositions>> {
        let what = format!("frame {}", self.frames);
        let mut first = [0];
        let more = loop {
            match self.from.read(&mut first) {
                Ok(count) => break count > 0,
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(Error::io(&self.name)(e)),
            }
        };
        if !more {
            return Ok(None);
        }
        self.at += 1;
        let mut time = [0; 8];
        time[0] = first[0];
        time[1..].copy_from_slice(&self.bytes(7, &what)?);
        let time = f64::from_le_bytes(time);
        let places = self.points(&what)?;
        let bad = places.iter().position(|p| !p.is_finite());
        if let Some(v) = bad {
            return Err(self.wrong(&format!(
                "{what}: node {v} must have finite coordinates, got {}",
                places[v]
            )));
        }
        if !time.is_finite() {
            return Err(self.wrong(&format!("{what}: time must be finite, got {time} s")));
        }
        self.frames += 1;
        Ok(Some((time, places)))
    }

    fn points(&mut self, what: &str) -> Result<Vec<DVec3>> {
        let bytes = self.bytes(24 * self.nodes as u64, what)?;
        let number = |b: &[u8]| f64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|k| b[k]));
        let points = bytes.chunks_exact(24);
        let point = |b: &[u8]| DVec3::new(number(b), number(&b[8..]), number(&b[16..]));
        Ok(points.map(point).collect())
    }

    /// Reads `count` bytes. The buffer grows with the data, since counts in a stream are not
    /// trusted.
    fn bytes(&mut self, count: u64, what: &str) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut from = (&mut self.from).take(count);
        from.read_to_end(&mut bytes)
            .map_err(Error::io(&self.name))?;
        self.at += bytes.len() as u64;
        if (bytes.len() as u64) < count {
            return Err(self.wrong(&format!(
                "ends within {what}, after {} of its {count} bytes",
                bytes.len()
            )));
        }
        Ok(bytes)
    }

    fn wrong(&self, what: &str) -> Error {
        Error::format(&self.name, format!("{what} (byte {})", self.at))
    }
}
