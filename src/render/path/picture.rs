//! A path-traced picture: means of the samples, their noise, and the picture shown.

use super::ITEMS;
use super::denoise::denoised;
use super::options::PathOptions;
use super::tone::tone_mapped;
use crate::render::Image;

/// Means of the samples of a picture.
pub(crate) struct PathPicture {
    /// Linear light, premultiplied by opacity: red, green, blue and opacity.
    linear: Image,
    /// Samples per pixel, and paths that were given up.
    samples: u32,
    lost: u32,
    noise: f64,
    exposure: f64,
    /// Variance of the mean luminance of each pixel, before filtering.
    #[cfg(test)]
    pub variances: Vec<f32>,
}

impl PathPicture {
    pub(super) fn new(
        size: [u32; 2],
        sums: &[[[f32; 4]; ITEMS]],
        (samples, lost): (u32, u32),
        options: &PathOptions,
        guide: Option<&Image>,
    ) -> PathPicture {
        let n = samples.max(1) as f32;
        let mut values: Vec<[f32; 4]> = sums.iter().map(|p| p[0].map(|s| s / n)).collect();
        let variances: Vec<f32> = sums.iter().map(|p| variance_of_mean(p, samples)).collect();
        let noise = noise(&values, &variances);
        if let Some(guide) = guide.filter(|_| samples > 1) {
            let (guide, _) = guide.values.as_chunks();
            values = denoised(size, &values, &variances, guide);
        }
        PathPicture {
            linear: Image {
                size,
                channels: 4,
                values: values.into_flattened(),
            },
            samples,
            lost,
            noise,
            exposure: options.exposure,
            #[cfg(test)]
            variances,
        }
    }

    /// Returns the root mean square of the pixels' standard errors, relative to their mean luminance;
    /// of the samples, before they were filtered.
    pub fn noise(&self) -> f64 {
        self.noise
    }

    /// Returns the samples per pixel.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Returns the number of paths that were given up after too many steps: 0 unless tets are
    /// inverted.
    pub fn lost(&self) -> u32 {
        self.lost
    }

    /// Returns the light before tone mapping, premultiplied by opacity.
    pub fn linear(&self) -> &Image {
        &self.linear
    }

    /// Returns the picture to be shown: tone mapped, in sRGB, premultiplied by opacity.
    pub fn shown(&self) -> Image {
        let exposure = self.exposure as f32;
        let pixels = self.linear.values.chunks_exact(4);
        let values = pixels.flat_map(|p| {
            let opacity = p[3].max(1e-6);
            let tone = |c: f32| tone_mapped(exposure * c / opacity) * p[3];
            [tone(p[0]), tone(p[1]), tone(p[2]), p[3]]
        });
        Image {
            size: self.linear.size,
            channels: 4,
            values: values.collect(),
        }
    }
}

/// Returns the variance of a pixel's mean luminance.
fn variance_of_mean(sums: &[[f32; 4]; ITEMS], samples: u32) -> f32 {
    let n = f64::from(samples.max(1));
    let mean = luminance(&sums[0]) / n;
    let of_squares = f64::from(sums[1][0]) / n;
    ((of_squares - mean * mean).max(0.0) / (n - 1.0).max(1.0)) as f32
}

pub(super) fn luminance(colour: &[f32; 4]) -> f64 {
    let [r, g, b, _] = colour.map(f64::from);
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

fn noise(values: &[[f32; 4]], variances: &[f32]) -> f64 {
    // Pixels beside the body have no noise and say nothing.
    let body = values.iter().zip(variances).filter(|(v, _)| v[3] > 0.0);
    let (mut light, mut variance, mut count) = (0.0, 0.0, 0.0);
    for (value, v) in body {
        light += luminance(value);
        variance += f64::from(*v);
        count += 1.0;
    }
    match light > 0.0 {
        true => (variance / count).sqrt() / (light / count),
        false => 0.0,
    }
}
