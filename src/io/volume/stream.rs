//! Incremental writer of volumes, a few planes at a time, in bounded memory.
//!
//! Deflate blocks can be compressed independently and concatenated: here on all cores, and so that
//! the three consecutive parts of a vector NIfTI can be written at the same time.

use super::header::Layout;
use crate::files::OutFile;
use crate::io::extension;
use crate::parallel;
use crate::{Error, Result};
use flate2::write::ZlibEncoder;
use flate2::{Compress, Compression, Crc, FlushCompress};
#[cfg(not(target_arch = "wasm32"))]
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::Path;

/// Bytes compressed independently: large enough for little loss of compression.
const BLOCK_BYTES: usize = 1 << 18;
/// Header of a gzip member without a name, of no particular system.
const GZIP: [u8; 10] = [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 0xff];
/// The last block of a deflate stream, empty.
const LAST: [u8; 2] = [3, 0];

/// An output format of volumes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum VolumeFormat {
    Nrrd,
    MetaImage,
    Nifti,
}

impl VolumeFormat {
    /// Returns the format of the extension of a file.
    pub fn from_path(path: &Path) -> Result<VolumeFormat> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        match extension(path).as_str() {
            "nrrd" => Ok(VolumeFormat::Nrrd),
            "mha" => Ok(VolumeFormat::MetaImage),
            "gz" if name.to_lowercase().ends_with(".nii.gz") => Ok(VolumeFormat::Nifti),
            other => Err(Error::Input(format!(
                "{}: unsupported volume extension \".{other}\"; use .nrrd, .mha or .nii.gz",
                path.display()
            ))),
        }
    }
}

/// Temporary file for data that belong later in the output; removed when the process ends in any
/// case.
#[cfg(not(target_arch = "wasm32"))]
type Spool = File;
#[cfg(target_arch = "wasm32")]
type Spool = io::Cursor<Vec<u8>>;

#[cfg(not(target_arch = "wasm32"))]
fn spool(path: &Path) -> io::Result<Spool> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => tempfile::tempfile_in(folder),
        _ => tempfile::tempfile_in("."),
    }
}

#[cfg(target_arch = "wasm32")]
fn spool(_: &Path) -> io::Result<Spool> {
    Ok(Spool::default())
}

/// Deflate blocks of the pushed bytes, and the data of the gzip trailer.
struct Blocks {
    level: Compression,
    waiting: Vec<u8>,
    crc: Crc,
}

impl Blocks {
    fn new(level: Compression) -> Blocks {
        Blocks {
            level,
            waiting: Vec::new(),
            crc: Crc::new(),
        }
    }

    /// Compresses the complete blocks, or all data.
    fn pack(&mut self, all: bool, out: &mut dyn Write) -> io::Result<()> {
        let whole = self.waiting.len() / BLOCK_BYTES * BLOCK_BYTES;
        let length = if all { self.waiting.len() } else { whole };
        let pieces: Vec<&[u8]> = self.waiting[..length].chunks(BLOCK_BYTES).collect();
        let packed = parallel::map_coarse(pieces.len(), |n| {
            let mut crc = Crc::new();
            crc.update(pieces[n]);
            deflated(pieces[n], self.level).map(|bytes| (bytes, crc))
        });
        for piece in packed {
            let (bytes, crc) = piece?;
            out.write_all(&bytes)?;
            self.crc.combine(&crc);
        }
        self.waiting.drain(..length);
        Ok(())
    }
}

/// Compresses `bytes` to deflate blocks, none of them the last of the stream, that end on a byte
/// boundary.
fn deflated(bytes: &[u8], level: Compression) -> io::Result<Vec<u8>> {
    // The buffer must fit all output: a flush that runs out of room is not resumed.
    let room = bytes.len() + bytes.len() / 4 + 4096;
    let mut blocks = Vec::with_capacity(room);
    let mut packer = Compress::new(level, false);
    packer
        .compress_vec(bytes, &mut blocks, FlushCompress::Sync)
        .map_err(io::Error::other)?;
    match packer.total_in() == bytes.len() as u64 && blocks.len() < blocks.capacity() {
        true => Ok(blocks),
        false => Err(io::Error::other("compressed block exceeds its buffer")),
    }
}

/// Compressed voxels.
enum Packed {
    /// One gzip stream, with a part for each of the consecutive arrays: the first is written in
    /// place, the others to temporary files.
    Gzip(Vec<Blocks>, Vec<Spool>),
    /// A stream whose size is stored in the header.
    Zlib(Box<ZlibEncoder<Spool>>),
}

/// A volume being written: voxels are pushed in order, then it is closed.
pub(crate) struct VolumeStream<'a> {
    path: &'a Path,
    out: &'a mut BufWriter<OutFile>,
    layout: Layout<'a>,
    packed: Packed,
}

impl<'a> VolumeStream<'a> {
    /// Begins the volume at `path`, currently the temporary file `out`, with its header.
    pub fn begin(
        path: &'a Path,
        layout: Layout<'a>,
        out: &'a mut BufWriter<OutFile>,
    ) -> Result<VolumeStream<'a>> {
        let format = VolumeFormat::from_path(path)?;
        // The last digits of displacements are noise, which cannot be compressed.
        let level = Compression::new(if layout.components > 1 { 1 } else { 6 });
        let packed = match format {
            VolumeFormat::MetaImage => {
                let spool = spool(path).map_err(Error::io(path))?;
                Packed::Zlib(Box::new(ZlibEncoder::new(spool, level)))
            }
            VolumeFormat::Nrrd => Packed::Gzip(vec![Blocks::new(level)], Vec::new()),
            VolumeFormat::Nifti => {
                let parts = (0..layout.components).map(|_| Blocks::new(level));
                let later = (1..layout.components).map(|_| spool(path));
                let later: io::Result<Vec<Spool>> = later.collect();
                Packed::Gzip(parts.collect(), later.map_err(Error::io(path))?)
            }
        };
        let mut stream = VolumeStream {
            path,
            out,
            layout,
            packed,
        };
        if let Packed::Gzip(parts, _) = &mut stream.packed {
            let begun = match format {
                VolumeFormat::Nifti => {
                    parts[0].waiting = stream.layout.nifti()?;
                    stream.out.write_all(&GZIP)
                }
                _ => {
                    let header = stream.layout.nrrd()?;
                    stream.out.write_all(&[&header, &GZIP[..]].concat())
                }
            };
            begun.map_err(Error::io(path))?;
        }
        Ok(stream)
    }

    /// Adds voxels, little-endian; the components of each voxel are adjacent.
    pub fn push(&mut self, bytes: &[u8]) -> Result<()> {
        self.pack(bytes).map_err(Error::io(self.path))
    }

    fn pack(&mut self, bytes: &[u8]) -> io::Result<()> {
        match &mut self.packed {
            Packed::Zlib(encoder) => encoder.write_all(bytes),
            Packed::Gzip(parts, later) => {
                let count = parts.len();
                let one = super::voxels::bytes_in(self.layout.scalar);
                for (n, part) in parts.iter_mut().enumerate() {
                    match count {
                        1 => part.waiting.extend_from_slice(bytes),
                        _ => {
                            let own = bytes.chunks_exact(one).skip(n).step_by(count);
                            own.for_each(|number| part.waiting.extend_from_slice(number));
                        }
                    }
                    match n {
                        0 => part.pack(false, self.out)?,
                        _ => part.pack(false, &mut later[n - 1])?,
                    }
                }
                Ok(())
            }
        }
    }

    /// Writes the remaining data and completes the file.
    pub fn close(self) -> Result<()> {
        let path = self.path;
        self.finish().map_err(Error::io(path))
    }

    fn finish(self) -> io::Result<()> {
        match self.packed {
            Packed::Zlib(encoder) => {
                let mut spool = encoder.finish()?;
                let length = spool.stream_position()?;
                self.out.write_all(&self.layout.metaimage(length))?;
                append(&mut spool, self.out)?;
            }
            Packed::Gzip(parts, mut later) => {
                let mut crc = Crc::new();
                for (n, mut part) in parts.into_iter().enumerate() {
                    match n {
                        0 => part.pack(true, self.out)?,
                        _ => {
                            part.pack(true, &mut later[n - 1])?;
                            append(&mut later[n - 1], self.out)?;
                        }
                    }
                    crc.combine(&part.crc);
                }
                self.out.write_all(&LAST)?;
                self.out.write_all(&crc.sum().to_le_bytes())?;
                self.out.write_all(&crc.amount().to_le_bytes())?;
            }
        }
        self.out.flush()
    }
}

fn append(spool: &mut Spool, out: &mut BufWriter<OutFile>) -> io::Result<()> {
    spool.rewind()?;
    io::copy(spool, out).map(|_| ())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use flate2::read::GzDecoder;
    use std::io::Read;

    #[test]
    fn blockwise_gzip_is_one_member_and_round_trips() {
        // Noise, which grows under compression, then compressible data; in pushes of any size.
        let mut noise = 1u64;
        let mut next = || {
            noise = noise
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (noise >> 56) as u8
        };
        let mut bytes: Vec<u8> = (0..3 * BLOCK_BYTES + 77).map(|_| next()).collect();
        bytes.extend((0..2 * BLOCK_BYTES).map(|n| (n / 1000) as u8));
        for level in [1, 6] {
            let mut blocks = Blocks::new(Compression::new(level));
            let mut packed = GZIP.to_vec();
            for part in bytes.chunks(BLOCK_BYTES / 3 + 5) {
                blocks.waiting.extend_from_slice(part);
                blocks.pack(false, &mut packed).unwrap();
            }
            blocks.pack(true, &mut packed).unwrap();
            packed.extend(LAST);
            packed.extend(blocks.crc.sum().to_le_bytes());
            packed.extend(blocks.crc.amount().to_le_bytes());
            let mut back = Vec::new();
            let mut reader = GzDecoder::new(packed.as_slice());
            reader.read_to_end(&mut back).unwrap();
            assert!(
                back == bytes,
                "level {level}: {} bytes decompressed",
                back.len()
            );
            assert!(reader.into_inner().is_empty());
        }
    }
}
