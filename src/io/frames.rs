//! Frames of a body that another program moves, as it writes them into a pipe.

use crate::mesh::TetMesh;
use crate::{Error, Result};
use glam::DVec3;
use std::io::Read;
use std::path::{Path, PathBuf};

/// What a stream begins with.
const MAGIC: &[u8; 8] = b"PALPATE1";

/// Frames as they come, of the layout in docs/frames.md: `PALPATE1`, the numbers of nodes and of
/// tets (u32), then where the nodes rest (f64 × 3 each) and the nodes of every tet (u32 × 4 each),
/// unless there are 0 tets; then, frame by frame, its time in s (f64) and where the nodes are (f64 ×
/// 3 each), in the mesh's unit. All little-endian. It ends where a frame would begin.
pub struct FrameStream<R> {
    from: R,
    name: PathBuf,
    nodes: usize,
    frames: usize,
    /// Bytes read.
    at: u64,
}

/// A frame: its time in s, and where the nodes are.
pub type TimedPositions = (f64, Vec<DVec3>);

impl<R: Read> FrameStream<R> {
    /// Reads the beginning of a stream, `name` being what errors call it, and the mesh that it has.
    ///
    /// # Errors
    /// [`Error::Format`] for what is no such stream, one that ends too soon, and a mesh that makes
    /// no sense; [`Error::Io`] when it cannot be read.
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
            return Err(stream.wrong("is no stream of frames, which begins with PALPATE1"));
        }
        let count = |k: usize| u32::from_le_bytes([0, 1, 2, 3].map(|b| head[k + b])) as usize;
        let tets = count(12);
        stream.nodes = count(8);
        if stream.nodes == 0 {
            return Err(stream.wrong("is a stream of frames of 0 nodes; there have to be some"));
        }
        if tets == 0 {
            return Ok((stream, None));
        }
        let rest = stream.points("the rest places of its nodes")?;
        let bytes = stream.bytes(16 * tets as u64, "its tets")?;
        let words = bytes.chunks_exact(4);
        let words: Vec<u32> = words
            .map(|w| u32::from_le_bytes([w[0], w[1], w[2], w[3]]))
            .collect();
        let tets = words.chunks_exact(4).map(|t| [t[0], t[1], t[2], t[3]]);
        let mesh = TetMesh::new(rest.clone(), tets.collect(), Vec::new(), Vec::new())
            .map_err(|e| stream.wrong(&format!("has a mesh that makes no sense: {e}")))?;
        // Frames are in the order of the nodes as they came.
        if mesh.nodes != rest {
            return Err(stream.wrong(
                "has a mesh with nodes that no tet uses, or that lie in one place; leave out those nodes, in the frames too",
            ));
        }
        Ok((stream, Some(mesh)))
    }

    /// How many nodes a frame has.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// The next frame, as soon as all of it came; none at the end.
    ///
    /// # Errors
    /// [`Error::Format`] for one that is cut short, or has what is no number; [`Error::Io`] when it
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
                "{what} has node {v} at {}, which is no place",
                places[v]
            )));
        }
        if !time.is_finite() {
            return Err(self.wrong(&format!("{what} has the time {time} s, which is no number")));
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

    /// So many bytes. Room is made as they come: counts of a stream cannot be trusted.
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
