//! Images in memory and their files.

use crate::{Error, Result};
use std::path::Path;

/// Floating-point image, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Values per pixel: 4 (premultiplied red, green, blue, and opacity) or 1 (a length).
    pub channels: usize,
    /// All pixel values.
    pub values: Vec<f32>,
}

/// Background of an image in a PNG file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Background {
    /// None: the file keeps the opacity.
    Transparent,
    /// Black.
    #[default]
    Black,
    /// White.
    White,
    /// A soft gradient from nearly white at the top to a light blue grey at the bottom.
    Gradient,
}

/// Colours of the top and the bottom of [`Background::Gradient`].
const GRADIENT: [[f32; 3]; 2] = [[0.965, 0.972, 0.980], [0.725, 0.765, 0.810]];

impl Background {
    /// Returns the colour at a height from 0 (top) to 1 (bottom); black if transparent.
    pub(crate) fn colour_at(self, height: f32) -> [f32; 3] {
        match self {
            Background::Transparent | Background::Black => [0.0; 3],
            Background::White => [1.0; 3],
            Background::Gradient => {
                let [top, bottom] = GRADIENT;
                // Smooth at both ends.
                let share = height * height * (3.0 - 2.0 * height);
                [0, 1, 2].map(|k| top[k] + share * (bottom[k] - top[k]))
            }
        }
    }

    /// Whether text on it is dark.
    pub(crate) fn is_light(self) -> bool {
        matches!(self, Background::White | Background::Gradient)
    }
}

/// Bits per channel of a PNG file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum BitDepth {
    /// 256 levels.
    #[default]
    Eight,
    /// 65,536 levels.
    Sixteen,
}

impl Image {
    /// Returns the values of pixel (x, y).
    pub fn pixel(&self, x: u32, y: u32) -> &[f32] {
        let first = (y as usize * self.size[0] as usize + x as usize) * self.channels;
        &self.values[first..first + self.channels]
    }

    /// Returns the image resampled to `size` pixels by bilinear interpolation.
    pub fn upscaled(&self, size: [u32; 2]) -> Image {
        if size == self.size {
            return self.clone();
        }
        // The two source pixels around a position along one axis, and the weight of the second.
        let around = |i: u32, k: usize| {
            let at = (f64::from(i) + 0.5) * f64::from(self.size[k]) / f64::from(size[k]) - 0.5;
            let at = at.clamp(0.0, f64::from(self.size[k].max(1) - 1));
            let next = (at as u32 + 1).min(self.size[k].max(1) - 1);
            (at as u32, next, at.fract() as f32)
        };
        let mut values = Vec::with_capacity(size[0] as usize * size[1] as usize * self.channels);
        for y in 0..size[1] {
            let (y0, y1, v) = around(y, 1);
            for x in 0..size[0] {
                let (x0, x1, u) = around(x, 0);
                let rows = [(y0, 1.0 - v), (y1, v)]
                    .map(|(y, w)| (self.pixel(x0, y), self.pixel(x1, y), w));
                values.extend((0..self.channels).map(|k| {
                    rows.iter()
                        .map(|(a, b, w)| w * (a[k] + u * (b[k] - a[k])))
                        .sum::<f32>()
                }));
            }
        }
        Image {
            size,
            channels: self.channels,
            values,
        }
    }

    /// Returns the image downsampled by averaging blocks of `factor` × `factor` pixels; incomplete
    /// blocks at the right and bottom are dropped. Colours are premultiplied, so averaging a body
    /// pixel with an empty pixel keeps the colour and halves the opacity.
    pub fn box_downsampled(&self, factor: u32) -> Image {
        let n = factor.max(1);
        let size = self.size.map(|side| side / n);
        let share = 1.0 / (n * n) as f32;
        let mut values = Vec::with_capacity(size[0] as usize * size[1] as usize * self.channels);
        for (y, x) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (y, x))) {
            let first = values.len();
            values.resize(first + self.channels, 0.0);
            for (dy, dx) in (0..n).flat_map(|dy| (0..n).map(move |dx| (dy, dx))) {
                let fine = self.pixel(n * x + dx, n * y + dy);
                let sum = values[first..].iter_mut();
                sum.zip(fine).for_each(|(sum, v)| *sum += share * v);
            }
        }
        Image {
            size,
            channels: self.channels,
            values,
        }
    }

    /// Returns the image with four channels, and for an image of lengths the maximum length, which
    /// maps to white; `None` for an image that already has four channels.
    pub fn to_rgba(&self) -> (Image, Option<f32>) {
        if self.channels != 1 {
            return (self.clone(), None);
        }
        let longest = self.values.iter().copied().fold(0.0, f32::max);
        (self.to_grey(longest), Some(longest))
    }

    /// Converts an image of one channel to opaque grey; the value `white` maps to white.
    pub fn to_grey(&self, white: f32) -> Image {
        let unit = if white > 0.0 { white } else { 1.0 };
        let grey = |v: &f32| (v / unit).clamp(0.0, 1.0);
        let shown = self.values.iter().map(grey);
        Image {
            size: self.size,
            channels: 4,
            values: shown.flat_map(|v| [v, v, v, 1.0]).collect(),
        }
    }

    /// Returns red, green and blue of each pixel as in an 8-bit PNG; a transparent background
    /// becomes black.
    #[cfg(not(target_arch = "wasm32"))]
    pub(super) fn rgb(&self, background: Background) -> Vec<u8> {
        let background = match background {
            Background::Transparent => Background::Black,
            opaque => opaque,
        };
        let (colour, shown) = self.shown(background);
        let byte = |v: &f32| (255.0 * v.clamp(0.0, 1.0)).round() as u8;
        match colour {
            image::ColorType::L8 => shown.iter().flat_map(|v| [byte(v); 3]).collect(),
            _ => shown.iter().map(byte).collect(),
        }
    }

    /// Writes a PNG (8 bits, on black) or an EXR (float, premultiplied), according to the
    /// extension.
    ///
    /// # Errors
    /// An error if the extension is neither, or the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        self.save_as(path, Background::default(), BitDepth::default())
    }

    /// As [`Image::save`], with a background and a bit depth for PNG.
    ///
    /// # Errors
    /// As [`Image::save`].
    pub fn save_as(
        &self,
        path: impl AsRef<Path>,
        background: Background,
        depth: BitDepth,
    ) -> Result<()> {
        self.save_file(path.as_ref(), background, depth)
    }

    fn save_file(&self, path: &Path, background: Background, depth: BitDepth) -> Result<()> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        let bytes = match extension.to_ascii_lowercase().as_str() {
            "png" => self.png(background, depth),
            #[cfg(not(target_arch = "wasm32"))]
            "exr" => self.exr(),
            #[cfg(target_arch = "wasm32")]
            "exr" => {
                return Err(Error::Input(format!(
                    "{}: in a browser, images can only be written as .png",
                    path.display()
                )));
            }
            _ => {
                return Err(Error::Input(format!(
                    "{}: image file extension must be .png or .exr",
                    path.display()
                )));
            }
        };
        let bytes =
            bytes.map_err(|e| Error::format(path, format!("cannot encode the image: {e}")))?;
        crate::io::atomic_write(path, |file| {
            std::io::Write::write_all(file, &bytes).map_err(Error::io(path))
        })
    }

    /// Returns the PNG channels from 0 to 1, not premultiplied if transparent: a byte is round(255
    /// · value). Lengths are scaled by the maximum.
    fn shown(&self, background: Background) -> (image::ColorType, Vec<f32>) {
        if self.channels == 1 {
            let longest = self.values.iter().copied().fold(0.0, f32::max);
            let unit = if longest > 0.0 { longest } else { 1.0 };
            return (
                image::ColorType::L8,
                self.values.iter().map(|v| v / unit).collect(),
            );
        }
        let pixels = self.values.chunks_exact(self.channels);
        match background {
            Background::Transparent => {
                let straight = pixels.flat_map(|p| {
                    let a = p[3].max(f32::MIN_POSITIVE);
                    [p[0] / a, p[1] / a, p[2] / a, p[3]]
                });
                (image::ColorType::Rgba8, straight.collect())
            }
            opaque => {
                let [width, height] = self.size.map(|n| n.max(1) as usize);
                let behind = |row: usize| opaque.colour_at((row as f32 + 0.5) / height as f32);
                let over = pixels.enumerate().flat_map(|(at, p)| {
                    let behind = behind(at / width);
                    [0, 1, 2].map(|k| p[k] + (1.0 - p[3]) * behind[k])
                });
                (image::ColorType::Rgb8, over.collect())
            }
        }
    }

    /// Returns the image with `background` behind it: opaque, unless that is transparent. Lengths stay as
    /// they are.
    pub(crate) fn on(self, background: Background) -> Image {
        if self.channels == 1 || background == Background::Transparent {
            return self;
        }
        let (_, over) = self.shown(background);
        Image {
            channels: 4,
            values: over
                .chunks_exact(3)
                .flat_map(|p| [p[0], p[1], p[2], 1.0])
                .collect(),
            ..self
        }
    }

    /// Returns the image on `background` as in an 8-bit PNG: red, green, blue and opacity per
    /// pixel, not premultiplied, row by row from the top. Lengths are grey.
    pub fn rgba8(&self, background: Background) -> Vec<u8> {
        let (colour, shown) = self.shown(background);
        let pixels = shown.chunks_exact(colour.channel_count().into());
        let rgba = pixels.flat_map(|p| match *p {
            [grey] => [grey, grey, grey, 1.0],
            [r, g, b] => [r, g, b, 1.0],
            _ => [p[0], p[1], p[2], p[3]],
        });
        rgba.map(byte).collect()
    }

    fn png(&self, background: Background, depth: BitDepth) -> image::ImageResult<Vec<u8>> {
        let (colour, shown) = self.shown(background);
        let (colour, bytes): (_, Vec<u8>) = match depth {
            BitDepth::Eight => (colour, shown.iter().copied().map(byte).collect()),
            BitDepth::Sixteen => {
                let word = |v: &f32| ((65535.0 * v.clamp(0.0, 1.0)).round() as u16).to_ne_bytes();
                let colour = match colour {
                    image::ColorType::L8 => image::ColorType::L16,
                    image::ColorType::Rgba8 => image::ColorType::Rgba16,
                    _ => image::ColorType::Rgb16,
                };
                (colour, shown.iter().flat_map(word).collect())
            }
        };
        let mut file = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut file);
        image::ImageEncoder::write_image(
            encoder,
            &bytes,
            self.size[0],
            self.size[1],
            colour.into(),
        )?;
        Ok(file)
    }

    /// Encodes an EXR of raw floats; a single channel is written three times because EXR readers
    /// expect colours.
    #[cfg(not(target_arch = "wasm32"))]
    fn exr(&self) -> image::ImageResult<Vec<u8>> {
        let mut file = std::io::Cursor::new(Vec::new());
        let encoder = image::codecs::openexr::OpenExrEncoder::new(&mut file);
        let (colour, values): (_, Vec<f32>) = if self.channels == 1 {
            let grey = self.values.iter().flat_map(|v| [*v; 3]);
            (image::ExtendedColorType::Rgb32F, grey.collect())
        } else {
            (image::ExtendedColorType::Rgba32F, self.values.clone())
        };
        let bytes: &[u8] = bytemuck::cast_slice(&values);
        image::ImageEncoder::write_image(encoder, bytes, self.size[0], self.size[1], colour)?;
        Ok(file.into_inner())
    }
}

fn byte(v: f32) -> u8 {
    (255.0 * v.clamp(0.0, 1.0)).round() as u8
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn box_downsampling_averages_blocks() {
        let large = Image {
            size: [5, 4],
            channels: 1,
            values: (0..20).map(|v| v as f32).collect(),
        };
        let small = large.box_downsampled(2);
        assert_eq!(small.size, [2, 2]);
        assert_eq!(small.values, [3.0, 5.0, 13.0, 15.0]);
        assert_eq!(large.box_downsampled(1), large);
    }

    #[test]
    fn rgba8_matches_png_bytes() {
        let picture = Image {
            size: [2, 1],
            channels: 4,
            values: vec![0.2, 0.1, 0.0, 0.4, 0.0, 0.0, 0.0, 0.0],
        };
        let file = picture
            .png(Background::Transparent, BitDepth::Eight)
            .unwrap();
        let read = image::load_from_memory(&file).unwrap().into_rgba8();
        assert_eq!(picture.rgba8(Background::Transparent), read.into_raw());
        let on_white = [204, 179, 153, 255, 255, 255, 255, 255];
        assert_eq!(picture.rgba8(Background::White), on_white);
    }

    #[test]
    fn gradient_is_light_and_gets_darker_downwards() {
        let empty = Image {
            size: [3, 64],
            channels: 4,
            values: vec![0.0; 3 * 64 * 4],
        };
        let rows: Vec<[u8; 4]> = empty
            .rgba8(Background::Gradient)
            .as_chunks::<4>()
            .0
            .to_vec();
        let column: Vec<u8> = rows.iter().step_by(3).map(|p| p[0]).collect();
        assert!(column.windows(2).all(|w| w[0] >= w[1]), "{column:?}");
        assert!(
            column[0] > 240 && column[63] < 200 && column[63] > 150,
            "{column:?}"
        );
        assert!(rows.chunks(3).all(|row| row[0] == row[2]));
        // The old background is what it was, and an opaque body hides any.
        assert!(
            empty
                .rgba8(Background::Black)
                .as_chunks::<4>()
                .0
                .iter()
                .all(|p| *p == [0, 0, 0, 255])
        );
        let full = Image {
            values: vec![1.0; 3 * 64 * 4],
            ..empty
        };
        assert_eq!(
            full.rgba8(Background::Gradient),
            full.rgba8(Background::Black)
        );
    }

    #[test]
    fn downsampling_half_covered_block_halves_opacity() {
        let large = Image {
            size: [2, 2],
            channels: 4,
            values: [
                [0.8, 0.4, 0.0, 1.0],
                [0.0; 4],
                [0.8, 0.4, 0.0, 1.0],
                [0.0; 4],
            ]
            .concat(),
        };
        assert_eq!(large.box_downsampled(2).values, [0.4, 0.2, 0.0, 0.5]);
    }

    #[test]
    fn length_image_converts_to_normalised_grey() {
        let lengths = Image {
            size: [2, 1],
            channels: 1,
            values: vec![1.0, 4.0],
        };
        let (grey, longest) = lengths.to_rgba();
        assert_eq!(longest, Some(4.0));
        assert_eq!(grey.values, [0.25, 0.25, 0.25, 1.0, 1.0, 1.0, 1.0, 1.0]);
        assert_eq!(lengths.rgb(Background::White), [64, 64, 64, 255, 255, 255]);
    }
}
