//! Animations written frame by frame: GIF, or MP4 through an installed ffmpeg.

use super::{Background, Image};
use crate::io::TempFile;
use crate::{Error, Result};
use std::ffi::OsStr;
use std::fs::File;
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// External program that encodes MP4.
const PROGRAM: &str = "ffmpeg";
/// Quantisation speed, from 1 (best palettes) to 30 (fastest).
const PALETTE_SPEED: i32 = 10;
/// Maximum number of trailing stderr characters of the encoder quoted in an error.
const MAX_STDERR_CHARS: usize = 400;

/// An animation written to a temporary file; [`finish`](Animation::finish) renames it, and without
/// `finish` no file remains.
///
/// `.gif` is an endless animation with a palette of 256 colours per frame; `.mp4` is encoded by
/// ffmpeg, which must be installed. Frames are not kept in memory.
pub struct Animation {
    path: PathBuf,
    unfinished: TempFile,
    size: [u32; 2],
    fps: f64,
    frames: u32,
    writer: Writer,
}

enum Writer {
    Gif(gif::Encoder<BufWriter<File>>),
    Ffmpeg(Program),
}

/// Child process; killed on drop.
struct Program(Child);

impl Animation {
    /// Creates an animation with frames of `size` pixels at `fps` frames per second.
    ///
    /// # Errors
    /// [`Error::Input`] for an extension other than `.gif` and `.mp4`, an unsupported size, a frame
    /// rate that is not positive or too high (GIF: 50, MP4: 240 frames per second), or a missing
    /// ffmpeg; [`Error::Io`] if the file cannot be created.
    pub fn create(path: impl AsRef<Path>, size: [u32; 2], fps: f64) -> Result<Animation> {
        begin(path.as_ref(), size, fps, PROGRAM.as_ref())
    }

    /// Checks whether an animation with this name and frame rate can be written, as far as is known
    /// before the first frame.
    ///
    /// # Errors
    /// As [`Animation::create`].
    pub fn check(path: impl AsRef<Path>, fps: f64) -> Result<()> {
        check(path.as_ref(), fps).map(drop)
    }

    /// Appends a frame on `background`; a transparent background becomes black.
    ///
    /// # Errors
    /// [`Error::Input`] for an image of another size; otherwise an error of the encoder or of
    /// writing.
    pub fn push(&mut self, image: &Image, background: Background) -> Result<()> {
        if image.size != self.size {
            let ([w, h], [x, y]) = (image.size, self.size);
            return Err(Error::Input(format!(
                "frame size {w} x {h} pixels differs from the animation size {x} x {y}"
            )));
        }
        self.push_pixels(image.rgb(background))
    }

    /// Appends a frame from an earlier picture: an opaque PNG of 8 bits per channel, as
    /// [`Image::save_as`] writes it.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::Format`] for a picture that cannot be read, [`Error::Input`] for one of
    /// another size or kind; otherwise as [`Animation::push`].
    pub fn push_file(&mut self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        let picture = image::load_from_memory(&bytes)
            .map_err(|e| Error::format(path, format!("cannot read the picture: {e}")))?;
        let size = [picture.width(), picture.height()];
        let is_plain = matches!(
            picture.color(),
            image::ColorType::L8 | image::ColorType::Rgb8
        );
        if size != self.size || !is_plain {
            return Err(Error::Input(format!(
                "{}: an earlier frame of a film must be an opaque PNG of 8 bits and {} x {} pixels; start the run again without --resume",
                path.display(),
                self.size[0],
                self.size[1]
            )));
        }
        self.push_pixels(picture.into_rgb8().into_raw())
    }

    /// Appends a frame of red, green and blue per pixel.
    fn push_pixels(&mut self, pixels: Vec<u8>) -> Result<()> {
        match &mut self.writer {
            Writer::Gif(gif) => {
                let [width, height] = self.size.map(|n| n as u16);
                let mut frame = gif::Frame::from_rgb_speed(width, height, &pixels, PALETTE_SPEED);
                // Delay in hundredths of a second, without accumulating rounding errors.
                let until = |frames: u32| (100.0 * f64::from(frames) / self.fps).round();
                frame.delay = (until(self.frames + 1) - until(self.frames)) as u16;
                gif.write_frame(&frame).map_err(|e| of_gif(&self.path, e))?;
            }
            Writer::Ffmpeg(Program(child)) => {
                let sent = child.stdin.as_mut().map(|to| to.write_all(&pixels));
                if !matches!(sent, Some(Ok(()))) {
                    return Err(refused(child));
                }
            }
        }
        self.frames += 1;
        Ok(())
    }

    /// Finishes the animation and renames the file.
    ///
    /// # Errors
    /// [`Error::Input`] for an animation without frames; otherwise an error of the encoder or of
    /// writing.
    pub fn finish(self) -> Result<()> {
        if self.frames == 0 {
            return Err(Error::Input(format!(
                "{}: an animation must have at least one frame, got none",
                self.path.display()
            )));
        }
        match self.writer {
            Writer::Gif(gif) => {
                let mut file = gif.into_inner().map_err(|e| of_gif(&self.path, e))?;
                file.flush().map_err(Error::io(&self.path))?;
            }
            Writer::Ffmpeg(mut program) => {
                let child = &mut program.0;
                // Closing stdin signals the end of the stream.
                drop(child.stdin.take());
                let ended = child.wait().map_err(Error::io(&self.path))?;
                if !ended.success() {
                    return Err(refused(child));
                }
            }
        }
        self.unfinished.finish()
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        if let Ok(None) = self.0.try_wait() {
            self.0.kill().ok();
            self.0.wait().ok();
        }
    }
}

/// File format of an animation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Gif,
    Mp4,
}

fn check(path: &Path, fps: f64) -> Result<Format> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let (format, most) = match extension.to_ascii_lowercase().as_str() {
        "gif" => (Format::Gif, 50.0),
        "mp4" => (Format::Mp4, 240.0),
        _ => {
            return Err(Error::Input(format!(
                "{}: animation file extension must be .gif or .mp4",
                path.display()
            )));
        }
    };
    if !(fps >= 0.01 && fps <= most) {
        return Err(Error::Input(format!(
            "{}: frame rate must be in 0.01 to {most} per second, got {fps}",
            path.display()
        )));
    }
    Ok(format)
}

fn begin(path: &Path, size: [u32; 2], fps: f64, program: &OsStr) -> Result<Animation> {
    let format = check(path, fps)?;
    let [width, height] = size;
    if size.iter().any(|n| !(1..=16_384).contains(n)) {
        return Err(Error::Input(format!(
            "animation size must be 1 to 16384 pixels per side, got {width} x {height}"
        )));
    }
    let (file, unfinished) = TempFile::create(path)?;
    let writer = match format {
        Format::Gif => {
            let file = BufWriter::new(file);
            let sides = size.map(|n| n as u16);
            let mut gif =
                gif::Encoder::new(file, sides[0], sides[1], &[]).map_err(|e| of_gif(path, e))?;
            gif.set_repeat(gif::Repeat::Infinite)
                .map_err(|e| of_gif(path, e))?;
            Writer::Gif(gif)
        }
        Format::Mp4 => {
            drop(file);
            let child = encoder(program, size, fps, unfinished.temporary())?;
            Writer::Ffmpeg(Program(child))
        }
    };
    Ok(Animation {
        path: path.to_path_buf(),
        unfinished,
        size,
        fps,
        frames: 0,
        writer,
    })
}

/// Starts the encoder, which reads frames from stdin and writes `to`.
fn encoder(program: &OsStr, [width, height]: [u32; 2], fps: f64, to: &Path) -> Result<Child> {
    let (size, fps) = (format!("{width}x{height}"), fps.to_string());
    // Common players need chroma subsampled by two in both directions, so the sides must be even.
    let even = "pad=ceil(iw/2)*2:ceil(ih/2)*2";
    Command::new(program)
        .args(["-y", "-loglevel", "error", "-f", "rawvideo"])
        .args(["-pix_fmt", "rgb24", "-s", &size, "-r", &fps, "-i", "-"])
        .args(["-an", "-vf", even, "-pix_fmt", "yuv420p"])
        .args(["-movflags", "+faststart", "-f", "mp4"])
        .arg(to)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| {
            let program = program.to_string_lossy();
            Error::Input(match e.kind() {
                std::io::ErrorKind::NotFound => format!(
                    "MP4 output needs the program {program}, which is not installed; install it (ffmpeg.org; Debian: apt install ffmpeg), or write a .gif"
                ),
                _ => format!("cannot start the program {program}: {e}"),
            })
        })
}

/// Returns the error for a failed encoder.
fn refused(child: &mut Child) -> Error {
    drop(child.stdin.take());
    let mut message = String::new();
    if let Some(errors) = &mut child.stderr {
        errors.read_to_string(&mut message).ok();
    }
    let from = message
        .char_indices()
        .rev()
        .nth(MAX_STDERR_CHARS)
        .map_or(0, |(i, _)| i);
    let ended = child
        .wait()
        .map_or_else(|e| e.to_string(), |s| s.to_string());
    Error::Input(format!(
        "ffmpeg failed to encode the animation ({ended}): {}",
        message[from..].trim()
    ))
}

fn of_gif(path: &Path, e: gif::EncodingError) -> Error {
    match e {
        gif::EncodingError::Io(e) => Error::io(path)(e),
        other => Error::format(path, format!("cannot encode the animation: {other}")),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn frame(size: [u32; 2], grey: f32) -> Image {
        let pixels = size[0] as usize * size[1] as usize;
        Image {
            size,
            channels: 4,
            values: [grey, grey, grey, 1.0].repeat(pixels),
        }
    }

    #[test]
    fn gif_preserves_frames_and_duration() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.gif");
        let mut film = Animation::create(&path, [12, 7], 30.0).unwrap();
        for i in 0..31 {
            let frame = frame([12, 7], i as f32 / 30.0);
            film.push(&frame, Background::Black).unwrap();
        }
        assert!(
            !path.exists(),
            "an unfinished animation must not exist at its path"
        );
        film.finish().unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut read = options.read_info(File::open(&path).unwrap()).unwrap();
        let (mut frames, mut hundredths) = (0, 0);
        while let Some(frame) = read.read_next_frame().unwrap() {
            let grey = (255.0 * frames as f32 / 30.0).round() as u8;
            assert_eq!(frame.buffer[..4], [grey, grey, grey, 255]);
            hundredths += u32::from(frame.delay);
            frames += 1;
        }
        assert_eq!((frames, hundredths), (31, 103));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn frames_of_files_equal_those_of_images() {
        let folder = tempfile::tempdir().unwrap();
        let film_of = |name: &str, from_files: bool| {
            let path = folder.path().join(name);
            let mut film = Animation::create(&path, [5, 3], 10.0).unwrap();
            for i in 0..3 {
                let image = frame([5, 3], i as f32 / 3.0);
                let file = folder.path().join("frame.png");
                match from_files {
                    true => {
                        let depth = crate::render::BitDepth::Eight;
                        image.save_as(&file, Background::Gradient, depth).unwrap();
                        film.push_file(&file).unwrap();
                    }
                    false => film.push(&image, Background::Gradient).unwrap(),
                }
            }
            film.finish().unwrap();
            std::fs::read(path).unwrap()
        };
        assert_eq!(film_of("a.gif", false), film_of("b.gif", true));
        // Another size, bits that a film loses, and no picture are refused.
        let path = folder.path().join("c.gif");
        let mut film = Animation::create(path, [5, 3], 10.0).unwrap();
        let file = folder.path().join("frame.png");
        let mut refused = |size: [u32; 2], background: Background, depth| {
            frame(size, 0.5).save_as(&file, background, depth).unwrap();
            film.push_file(&file).unwrap_err().to_string()
        };
        let (eight, sixteen) = (
            crate::render::BitDepth::Eight,
            crate::render::BitDepth::Sixteen,
        );
        assert!(refused([5, 4], Background::Black, eight).contains("5 x 3"));
        assert!(refused([5, 3], Background::Transparent, eight).contains("opaque"));
        assert!(refused([5, 3], Background::Black, sixteen).contains("8 bits"));
        std::fs::write(&file, "no picture").unwrap();
        assert!(film.push_file(&file).is_err());
    }

    #[test]
    fn aborted_animation_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.gif");
        let mut film = Animation::create(&path, [4, 4], 10.0).unwrap();
        film.push(&frame([4, 4], 0.5), Background::Black).unwrap();
        let other = film.push(&frame([4, 5], 0.5), Background::Black);
        assert!(other.unwrap_err().to_string().contains("4 x 5"));
        drop(film);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(
            Animation::create(&path, [4, 4], 10.0)
                .unwrap()
                .finish()
                .is_err()
        );
    }

    #[test]
    fn check_rejects_invalid_extensions_and_frame_rates() {
        let error = |path: &str, fps: f64| Animation::check(path, fps).unwrap_err().to_string();
        assert!(error("film.avi", 10.0).contains(".gif or .mp4"));
        assert!(error("film.gif", 60.0).contains("0.01 to 50"));
        assert!(error("film.mp4", 0.0).contains("0.01 to 240"));
        assert!(error("film.mp4", f64::NAN).contains("NaN"));
        assert!(Animation::check("film.MP4", 60.0).is_ok());
    }

    #[test]
    fn missing_encoder_is_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.mp4");
        let film = begin(&path, [4, 4], 10.0, "no-such-ffmpeg".as_ref());
        let message = film.err().unwrap().to_string();
        assert!(message.contains("install"), "{message}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    /// Creates a program that runs `script`, in place of ffmpeg.
    #[cfg(unix)]
    fn program(folder: &Path, script: &str) -> PathBuf {
        use std::os::unix::fs::PermissionsExt;
        let path = folder.join("encoder");
        std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).unwrap();
        path
    }

    #[test]
    #[cfg(unix)]
    fn encoder_receives_every_pixel_and_failures_are_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.mp4");
        // The last argument is the output file.
        let keeps = program(folder.path(), "for last; do :; done; cat > \"$last\"");
        let mut film = begin(&path, [5, 3], 10.0, keeps.as_os_str()).unwrap();
        for grey in [0.0, 1.0] {
            film.push(&frame([5, 3], grey), Background::Black).unwrap();
        }
        film.finish().unwrap();
        let expected = [[0u8; 45], [255; 45]].concat();
        assert_eq!(std::fs::read(&path).unwrap(), expected);
        std::fs::remove_file(&path).unwrap();
        let fails = program(
            folder.path(),
            "cat > /dev/null; echo no such codec >&2; exit 3",
        );
        let mut film = begin(&path, [5, 3], 10.0, fails.as_os_str()).unwrap();
        film.push(&frame([5, 3], 0.5), Background::Black).unwrap();
        let message = film.finish().unwrap_err().to_string();
        assert!(message.contains("no such codec"), "{message}");
        assert!(!path.exists());
    }
}
