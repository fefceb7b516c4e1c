//! ꟻLIP: perceptual difference of two images seen in alternation.
//!
//! Andersson et al., "FLIP: A Difference Evaluator for Alternating Images" (2020), the version for
//! low dynamic range, in float64. Colours are filtered by the contrast sensitivity of the eye and
//! compared in L*a*b*; edges and points that appear or vanish amplify the colour difference.

use super::Image;
use crate::parallel;
use glam::{DMat3, DVec3};

/// Pixels per degree of visual angle: a 0.7 m wide monitor of 3,840 pixels, seen from 0.7 m.
const PIXELS_PER_DEGREE: f64 = 67.020_643;

/// Contrast sensitivity as two Gaussians (weight and width) each: achromatic, red-green,
/// blue-yellow; table 1.
const SENSITIVITY: [[[f64; 2]; 2]; 3] = [
    [[1.0, 0.0047], [0.0, 1e-5]],
    [[1.0, 0.0053], [0.0, 1e-5]],
    [[34.1, 0.04], [13.5, 0.025]],
];
/// Width of the feature detectors, in degrees.
const FEATURE_WIDTH: f64 = 0.082;
/// Exponents of the colour and the feature difference.
const COLOUR_POWER: f64 = 0.7;
const FEATURE_POWER: f64 = 0.5;
/// Knee of the colour-difference mapping: fraction of the maximum difference, and the output value
/// it maps to.
const KNEE: [f64; 2] = [0.4, 0.95];

/// Returns the mean ꟻLIP of two images of the same size with three or more channels, from 0 to 1;
/// red, green and blue are display values, on black. A pixel that is non-finite in only one image
/// counts as 1.
pub(super) fn flip(a: &Image, b: &Image) -> f64 {
    let (first, second) = (Planes::of(a), Planes::of(b));
    let [seen_a, seen_b] = [&first, &second].map(Planes::as_seen);
    let [edges_a, edges_b] = [&first, &second].map(|p| p.features(false));
    let [points_a, points_b] = [&first, &second].map(|p| p.features(true));
    let largest = largest_difference();
    let sum: f64 = (0..first.len())
        .map(|i| {
            let broken = |image: &Image| {
                let start = i * image.channels;
                image.values[start..start + 3]
                    .iter()
                    .any(|v| !v.is_finite())
            };
            if broken(a) != broken(b) {
                return 1.0;
            }
            let colour = spread(hyab(seen_a[i], seen_b[i]).powf(COLOUR_POWER), largest);
            let edge = (edges_a[i] - edges_b[i]).abs();
            let point = (points_a[i] - points_b[i]).abs();
            let feature = (edge.max(point) / std::f64::consts::SQRT_2).powf(FEATURE_POWER);
            colour.powf(1.0 - feature)
        })
        .sum();
    sum / first.len().max(1) as f64
}

/// An image in YCxCz, stored by planes.
struct Planes {
    width: usize,
    planes: [Vec<f64>; 3],
}

impl Planes {
    fn of(image: &Image) -> Planes {
        let colours: Vec<DVec3> = image
            .values
            .chunks_exact(image.channels)
            .map(|p| {
                let linear = |v: f32| if v.is_finite() { linear(v.into()) } else { 0.0 };
                ycxcz(xyz_from_rgb() * DVec3::new(linear(p[0]), linear(p[1]), linear(p[2])))
            })
            .collect();
        Planes {
            width: image.size[0] as usize,
            planes: [0, 1, 2].map(|k| colours.iter().map(|c| c[k]).collect()),
        }
    }

    fn len(&self) -> usize {
        self.planes[0].len()
    }

    /// Returns the image filtered by contrast sensitivity, in L*a*b* with the Hunt effect.
    fn as_seen(&self) -> Vec<DVec3> {
        let widest = SENSITIVITY
            .iter()
            .flatten()
            .map(|g| g[1])
            .fold(0.0, f64::max);
        let pi = std::f64::consts::PI;
        let radius = (3.0 * (widest / (2.0 * pi * pi)).sqrt() * PIXELS_PER_DEGREE).ceil() as usize;
        let seen: [Vec<f64>; 3] = std::array::from_fn(|k| {
            let gaussians = SENSITIVITY[k].map(|[weight, width]| {
                let kernel = kernel(radius, |x| {
                    let x = x / PIXELS_PER_DEGREE;
                    (-pi * pi * x * x / width).exp()
                });
                (weight * (pi / width).sqrt(), kernel)
            });
            // In two dimensions, over the whole window, the two kernels sum to 1.
            let total: f64 = gaussians
                .iter()
                .map(|(weight, kernel)| weight * kernel.iter().sum::<f64>().powi(2))
                .sum();
            let mut sum = vec![0.0; self.len()];
            for (weight, kernel) in gaussians.iter().filter(|g| g.0 > 0.0) {
                let part = separable(&self.planes[k], self.width, kernel, kernel);
                for (sum, part) in sum.iter_mut().zip(part) {
                    *sum += weight / total * part;
                }
            }
            sum
        });
        let to_rgb = xyz_from_rgb().inverse();
        (0..self.len())
            .map(|i| {
                let rgb = to_rgb * xyz(DVec3::new(seen[0][i], seen[1][i], seen[2][i]));
                hunt(lab(xyz_from_rgb() * rgb.clamp(DVec3::ZERO, DVec3::ONE)))
            })
            .collect()
    }

    /// Returns the strength of edges, or of points and lines, at each pixel.
    fn features(&self, points: bool) -> Vec<f64> {
        let width = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
        let radius = (3.0 * width).ceil() as usize;
        let bell = |x: f64| (-x * x / (2.0 * width * width)).exp();
        let across = kernel(radius, bell);
        let across: Vec<f64> = across
            .iter()
            .map(|w| w / across.iter().sum::<f64>())
            .collect();
        let along = kernel(radius, |x| match points {
            true => (x * x / (width * width) - 1.0) * bell(x),
            false => -x * bell(x),
        });
        let sum = |sign: f64| along.iter().map(|w| (sign * w).max(0.0)).sum::<f64>();
        let (above, below) = (sum(1.0), sum(-1.0));
        let along: Vec<f64> = along
            .iter()
            .map(|w| w / if *w > 0.0 { above } else { below })
            .collect();
        let light: Vec<f64> = self.planes[0].iter().map(|y| (y + 16.0) / 116.0).collect();
        let x = separable(&light, self.width, &along, &across);
        let y = separable(&light, self.width, &across, &along);
        x.iter().zip(y).map(|(x, y)| x.hypot(y)).collect()
    }
}

/// Samples `of` at −radius, …, radius.
fn kernel(radius: usize, of: impl Fn(f64) -> f64) -> Vec<f64> {
    let radius = radius as i64;
    (-radius..=radius).map(|x| of(x as f64)).collect()
}

/// Filters `plane` by `x` along rows and by `y` along columns, with replicated border pixels.
fn separable(plane: &[f64], width: usize, x: &[f64], y: &[f64]) -> Vec<f64> {
    let height = plane.len() / width.max(1);
    // `length` pixels per line, `step` apart.
    let pass = |from: &[f64], kernel: &[f64], length: usize, step: usize| {
        let radius = kernel.len() / 2;
        parallel::map(from.len(), |i| {
            let at = i / step % length;
            let first = i - at * step;
            let pixels = kernel.iter().enumerate().map(|(k, w)| {
                w * from[first + (at + k).saturating_sub(radius).min(length - 1) * step]
            });
            pixels.sum::<f64>()
        })
    };
    let rows = pass(plane, x, width, 1);
    pass(&rows, y, height, width)
}

/// Converts sRGB to linear.
fn linear(shown: f64) -> f64 {
    let shown = shown.clamp(0.0, 1.0);
    if shown > 0.04045 {
        ((shown + 0.055) / 1.055).powf(2.4)
    } else {
        shown / 12.92
    }
}

/// Returns the matrix from linear sRGB to CIE XYZ.
fn xyz_from_rgb() -> DMat3 {
    DMat3::from_cols(
        DVec3::new(
            10_135_552.0 / 24_577_794.0,
            2_613_072.0 / 12_288_897.0,
            1_425_312.0 / 73_733_382.0,
        ),
        DVec3::new(
            8_788_810.0 / 24_577_794.0,
            8_788_810.0 / 12_288_897.0,
            8_788_810.0 / 73_733_382.0,
        ),
        DVec3::new(
            4_435_075.0 / 24_577_794.0,
            887_015.0 / 12_288_897.0,
            70_074_185.0 / 73_733_382.0,
        ),
    )
}

fn white() -> DVec3 {
    xyz_from_rgb() * DVec3::ONE
}

/// Converts XYZ to YCxCz, a linear form of L*a*b*.
fn ycxcz(xyz: DVec3) -> DVec3 {
    let n = xyz / white();
    DVec3::new(116.0 * n.y - 16.0, 500.0 * (n.x - n.y), 200.0 * (n.y - n.z))
}

/// Inverse of [`ycxcz`].
fn xyz(c: DVec3) -> DVec3 {
    let y = (c.x + 16.0) / 116.0;
    DVec3::new(y + c.y / 500.0, y, y - c.z / 200.0) * white()
}

fn lab(xyz: DVec3) -> DVec3 {
    let delta: f64 = 6.0 / 29.0;
    let f = |t: f64| {
        if t > delta.powi(3) {
            t.cbrt()
        } else {
            t / (3.0 * delta * delta) + 4.0 / 29.0
        }
    };
    let n = xyz / white();
    let [x, y, z] = [n.x, n.y, n.z].map(f);
    DVec3::new(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))
}

/// Reduces chroma at low lightness (Hunt effect).
fn hunt(lab: DVec3) -> DVec3 {
    DVec3::new(lab.x, 0.01 * lab.x * lab.y, 0.01 * lab.x * lab.z)
}

/// HyAB colour difference: absolute difference in lightness plus Euclidean distance in a*b*.
fn hyab(a: DVec3, b: DVec3) -> f64 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

/// Returns the maximum colour difference, that of green and blue.
fn largest_difference() -> f64 {
    let seen = |rgb: DVec3| hunt(lab(xyz_from_rgb() * rgb));
    hyab(seen(DVec3::Y), seen(DVec3::Z)).powf(COLOUR_POWER)
}

/// Maps a colour difference to 0…1; small differences take most of the range.
fn spread(difference: f64, largest: f64) -> f64 {
    let knee = KNEE[0] * largest;
    if difference < knee {
        KNEE[1] / knee * difference
    } else {
        KNEE[1] + (difference - knee) / (largest - knee) * (1.0 - KNEE[1])
    }
}
