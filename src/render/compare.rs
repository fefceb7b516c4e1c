//! Image comparison for regression tests and `palpate compare`.

use super::Image;
use super::flip_metric::flip;
use crate::{Error, Result};
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// Difference of two images of the same size, over all channels of all pixels.
///
/// Values are in the range of the images, 0 to 1 for colours.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ImageDifference {
    /// Root mean square difference.
    pub rmse: f64,
    /// 99.9th percentile of the absolute differences of channel values.
    pub percentile_999: f64,
    /// Maximum difference.
    pub max: f64,
    /// Mean perceptual difference, 0 to 1: ꟻLIP (Andersson et al. 2020) at 67 pixels per degree, on
    /// black; `None` for images without colours.
    pub flip: Option<f64>,
}

impl ImageDifference {
    /// Compares `a` with `b`. A value that is non-finite in only one image counts as an infinite
    /// difference.
    ///
    /// # Errors
    /// [`Error::Input`] if the sizes differ or the images have no pixels.
    pub fn between(a: &Image, b: &Image) -> Result<ImageDifference> {
        check_sizes(a, b)?;
        let mut apart: Vec<f64> = a
            .values
            .iter()
            .zip(&b.values)
            .map(|(x, y)| distance(*x, *y))
            .collect();
        let rmse = (apart.iter().map(|d| d * d).sum::<f64>() / apart.len() as f64).sqrt();
        let rank = ((apart.len() as f64 * 0.999).ceil() as usize).clamp(1, apart.len()) - 1;
        let (_, percentile, _) = apart.select_nth_unstable_by(rank, f64::total_cmp);
        let percentile_999 = *percentile;
        Ok(ImageDifference {
            rmse,
            percentile_999,
            max: apart.iter().copied().fold(0.0, f64::max),
            flip: (a.channels >= 3).then(|| flip(a, b)),
        })
    }

    /// Whether the root mean square and the 99.9th percentile are within these limits.
    pub fn within(&self, rmse: f64, percentile_999: f64) -> bool {
        self.rmse <= rmse && self.percentile_999 <= percentile_999
    }

    /// Returns an opaque image of the differences, multiplied by `gain`.
    ///
    /// # Errors
    /// As [`ImageDifference::between`].
    pub fn difference_image(a: &Image, b: &Image, gain: f32) -> Result<Image> {
        check_sizes(a, b)?;
        let apart = |i: usize| distance(a.values[i], b.values[i]) as f32;
        let values = (0..a.values.len())
            .step_by(a.channels)
            .flat_map(|first| {
                let channel = |k: usize| apart(first + k.min(a.channels - 1));
                // A difference in opacity only is shown as grey.
                let opacity = if a.channels == 4 {
                    apart(first + 3)
                } else {
                    0.0
                };
                let shown = |k: usize| (gain * channel(k).max(opacity)).min(1.0);
                [shown(0), shown(1), shown(2), 1.0]
            })
            .collect();
        Ok(Image {
            size: a.size,
            channels: 4,
            values,
        })
    }
}

impl Image {
    /// Reads a PNG or EXR for comparison: converted to red, green, blue and opacity, with the
    /// values as stored in the file.
    ///
    /// # Errors
    /// An error if the file cannot be read or is not a supported image.
    pub fn read_for_comparison(path: impl AsRef<Path>) -> Result<Image> {
        Image::open_file(path.as_ref())
    }

    fn open_file(path: &Path) -> Result<Image> {
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        let picture = image::load_from_memory(&bytes)
            .map_err(|e| Error::format(path, format!("not a PNG or EXR image: {e}")))?
            .into_rgba32f();
        Ok(Image {
            size: [picture.width(), picture.height()],
            channels: 4,
            values: picture.into_raw(),
        })
    }
}

fn check_sizes(a: &Image, b: &Image) -> Result<()> {
    if a.size != b.size || a.channels != b.channels || a.values.is_empty() {
        return Err(Error::Input(format!(
            "images differ in size: {} x {} pixels ({} channels) and {} x {} ({}); render both at the same size",
            a.size[0], a.size[1], a.channels, b.size[0], b.size[1], b.channels
        )));
    }
    Ok(())
}

fn distance(x: f32, y: f32) -> f64 {
    if x.to_bits() == y.to_bits() {
        return 0.0;
    }
    let d = (f64::from(x) - f64::from(y)).abs();
    if d.is_nan() { f64::INFINITY } else { d }
}

impl fmt::Display for ImageDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "RMSE {:.3}/255, 99.9th percentile {:.3}/255, maximum {:.3}/255",
            self.rmse * 255.0,
            self.percentile_999 * 255.0,
            self.max * 255.0
        )?;
        match self.flip {
            Some(flip) => write!(f, ", FLIP {flip:.4}"),
            None => Ok(()),
        }
    }
}
