//! A filter against the last noise: edge-avoiding à-trous wavelets (Dammertz et al. 2010), guided by
//! the picture of the raycaster, which has no noise, and by the variance of the light (after Schied
//! et al. 2017).
//!
//! The raycaster's colour is that of the first collision, on average, and its shading shows the
//! normals: so it stands for colour, normal and depth, which would be noisy themselves in a soft
//! medium. The filter works on light divided by that colour, so that it does not blur the latter.

use super::picture::luminance;
use super::tone::linear;
use crate::parallel;

/// Levels, whose taps are 1, 2, 4, … pixels apart.
const LEVELS: usize = 5;
/// Weights of the taps at distances 0, 1 and 2.
const KERNEL: [f32; 3] = [0.375, 0.25, 0.0625];
/// Differences at which a tap weighs 1/e: of the light, in standard errors; of the guide, in display
/// values from 0 to 1.
const LIGHT: f32 = 4.0;
const GUIDE: f32 = 0.15;
/// Smallest value that divides the light.
const LEAST: f32 = 0.01;

/// A pixel without the colour of the guide.
#[derive(Clone, Copy)]
struct Lit {
    /// Light and opacity, relative to the guide's.
    relative: [f32; 4],
    /// Variance of the luminance of `relative`.
    variance: f32,
}

/// Returns light and opacity of an image of `size` pixels without noise. `guide` is the picture of the
/// raycaster: display values, premultiplied.
pub(super) fn denoised(
    size: [u32; 2],
    light: &[[f32; 4]],
    variances: &[f32],
    guide: &[[f32; 4]],
) -> Vec<[f32; 4]> {
    let [width, height] = size.map(|n| n as usize);
    let divisors: Vec<[f32; 4]> = parallel::map(light.len(), |i| divisor(guide[i]));
    let mut now: Vec<Lit> = parallel::map(light.len(), |i| {
        let by = divisors[i];
        let grey = luminance(&by) as f32;
        Lit {
            relative: std::array::from_fn(|c| light[i][c] / by[c]),
            variance: variances[i] / (grey * grey),
        }
    });
    for level in 0..LEVELS {
        let step = 1isize << level;
        now = parallel::map(now.len(), |i| {
            let (x, y) = ((i % width) as isize, (i / width) as isize);
            filtered(
                &now,
                guide,
                (i, x, y),
                [width as isize, height as isize],
                step,
            )
        });
    }
    parallel::map(light.len(), |i| {
        let mut pixel: [f32; 4] = std::array::from_fn(|c| now[i].relative[c] * divisors[i][c]);
        pixel[3] = pixel[3].min(1.0);
        pixel
    })
}

/// Returns the linear colour and the opacity of the guide, bounded from below.
fn divisor([r, g, b, a]: [f32; 4]) -> [f32; 4] {
    let colour = |c: f32| a * linear(f64::from(c / a.max(1e-6)).clamp(0.0, 1.0)) as f32;
    [colour(r), colour(g), colour(b), a].map(|c| c.max(LEAST))
}

/// Returns the mean variance of a pixel and its neighbours: that of few samples is itself noisy, and
/// 0 where none met a light.
fn variance_around(now: &[Lit], (x, y): (isize, isize), [width, height]: [isize; 2]) -> f32 {
    let (mut sum, mut whole) = (0.0, 0.0);
    for (dy, dx) in (-1..=1isize).flat_map(|dy| (-1..=1isize).map(move |dx| (dy, dx))) {
        let (px, py) = (x + dx, y + dy);
        if (0..width).contains(&px) && (0..height).contains(&py) {
            let weight = 0.5f32.powi((dx.abs() + dy.abs()) as i32);
            sum += weight * now[(px + py * width) as usize].variance.max(0.0);
            whole += weight;
        }
    }
    sum / whole
}

/// Returns the weighted mean around a pixel, and its variance.
fn filtered(
    now: &[Lit],
    guide: &[[f32; 4]],
    (i, x, y): (usize, isize, isize),
    [width, height]: [isize; 2],
    step: isize,
) -> Lit {
    let own = now[i];
    let grey = |lit: &Lit| luminance(&lit.relative) as f32;
    let deviation = variance_around(now, (x, y), [width, height]).sqrt();
    let (mut sum, mut variance, mut whole) = ([0.0f32; 4], 0.0, 0.0);
    for dy in -2..=2isize {
        for dx in -2..=2isize {
            let (px, py) = (x + dx * step, y + dy * step);
            if !((0..width).contains(&px) && (0..height).contains(&py)) {
                continue;
            }
            let j = (px + py * width) as usize;
            let apart: f32 = (0..4).map(|c| (guide[i][c] - guide[j][c]).abs()).sum();
            let lighter = (grey(&now[j]) - grey(&own)).abs() / (LIGHT * deviation + 1e-4);
            let weight = KERNEL[dx.unsigned_abs()]
                * KERNEL[dy.unsigned_abs()]
                * (-apart / GUIDE - lighter).exp();
            for (s, c) in sum.iter_mut().zip(now[j].relative) {
                *s += weight * c;
            }
            variance += weight * weight * now[j].variance;
            whole += weight;
        }
    }
    Lit {
        relative: sum.map(|s| s / whole),
        variance: variance / (whole * whole),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const SIZE: [u32; 2] = [64, 64];
    /// Relative noise of a pixel.
    const NOISE: f64 = 0.4;

    /// Two halves of different colour under light that grows from left to right: the light without
    /// noise and with it, and the guide.
    fn halves() -> [Vec<[f32; 4]>; 3] {
        let mut random = Random::new(3);
        let [mut truth, mut noisy, mut guide] = [const { Vec::new() }; 3];
        for i in 0..64 * 64 {
            let x = i % 64;
            let shade = if x < 32 { 0.3 } else { 0.8 };
            guide.push([shade, shade, shade, 1.0]);
            let value = (0.5 + x as f32 / 64.0) * linear(f64::from(shade)) as f32;
            truth.push([value, value, value, 1.0]);
            let factor = 1.0 + NOISE * 12.0f64.sqrt() * (random.next() - 0.5);
            let noised = value * factor as f32;
            noisy.push([noised, noised, noised, 1.0]);
        }
        [truth, noisy, guide]
    }

    fn error(image: &[[f32; 4]], truth: &[[f32; 4]], columns: std::ops::Range<usize>) -> f32 {
        let pixels = image.iter().zip(truth).enumerate();
        let within = pixels.filter(|(i, _)| columns.contains(&(i % 64)));
        let squares: Vec<f32> = within
            .map(|(_, (a, b))| ((a[0] - b[0]) / b[0]).powi(2))
            .collect();
        (squares.iter().sum::<f32>() / squares.len() as f32).sqrt()
    }

    #[test]
    fn noise_falls_and_the_edge_of_the_guide_stays() {
        let [truth, noisy, guide] = halves();
        let variances: Vec<f32> = truth
            .iter()
            .map(|p| (NOISE as f32 * p[0]).powi(2))
            .collect();
        let clean = denoised(SIZE, &noisy, &variances, &guide);
        let before = error(&noisy, &truth, 0..64);
        let after = error(&clean, &truth, 0..64);
        assert!(after < 0.25 * before, "{before} to {after}");
        let edge = error(&clean, &truth, 30..34);
        assert!(edge < 0.3 * before, "{edge} beside the edge");
        // A guide without the edge blurs it.
        let even = vec![[0.5, 0.5, 0.5, 1.0]; guide.len()];
        let blurred = denoised(SIZE, &noisy, &variances, &even);
        let blurred = error(&blurred, &truth, 30..34);
        assert!(blurred > 2.0 * edge, "{blurred} for {edge}");
    }
}
