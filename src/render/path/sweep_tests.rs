//! A sweep of many light paths for pixels that are wrong rather than noisy.

#![allow(clippy::unwrap_used)]

use super::environment::Environment;
use super::picture::{PathPicture, luminance};
use super::tests::{Body, soft, walled};
use super::*;
use crate::progress::no_progress;
use glam::DVec3;

const SIZE: [u32; 2] = [128, 128];
const SAMPLES: u32 = 64;
/// Largest difference of two pictures of other seeds, in standard errors of the pixels around.
const MOST: f64 = 20.0;
/// Paths of a pixel that may see the brightest light where none around it does.
const LUCKY: f64 = 2.0;

/// Returns the body and the settings of a pair of pictures: all combinations take turns.
fn pair(number: u32) -> (Body, PathOptions) {
    let body = match number % 3 {
        0 => walled(),
        1 => Body::new("bar", 60, |s| s.y, soft()).bent(),
        _ => {
            let mut body = Body::new("ball", 300, |s| s.z, soft());
            body.lit = false;
            body
        }
    };
    let turn = |k: u32, count: u32| (number / k % count) as usize;
    let options = PathOptions {
        samples: SAMPLES,
        seed: 2 * number,
        environment: [Environment::Studio, Environment::Sun(DVec3::X)][turn(3, 2)].clone(),
        roughness: [0.1, 0.4, 1.0][turn(6, 3)],
        anisotropy: [0.95, 0.0, -0.95][turn(18, 3)],
        extinction: [1.0, 1000.0][turn(54, 2)],
        ..PathOptions::default()
    };
    (body, options)
}

fn light_of(picture: &PathPicture) -> Vec<f64> {
    let (pixels, _) = picture.linear().values.as_chunks();
    pixels.iter().map(luminance).collect()
}

/// Returns the largest difference of the luminance of two pictures in standard errors of the pixels
/// around it, or of its own where it is not off in one of them.
fn largest_difference(pictures: &[PathPicture; 2], [a, b]: [&[f64]; 2], brightest: f64) -> f64 {
    let [width, height] = SIZE.map(|n| n as usize);
    let variance = |n: usize| {
        pictures
            .iter()
            .map(|p| f64::from(p.variances[n]))
            .sum::<f64>()
    };
    let floor = LUCKY * brightest / f64::from(SAMPLES) / MOST;
    let mut most = 0.0f64;
    for n in 0..a.len() {
        let [x, y] = [n % width, n / width];
        let (mut sum, mut count) = (0.0, 0.0);
        for v in y.saturating_sub(2)..(y + 3).min(height) {
            for u in x.saturating_sub(2)..(x + 3).min(width) {
                if [u, v] != [x, y] {
                    sum += variance(u + width * v);
                    count += 1.0;
                }
            }
        }
        let own = 2.0
            * pictures
                .iter()
                .map(|p| f64::from(p.variances[n]))
                .fold(f64::MAX, f64::min);
        let error = ((sum / count).max(own) + floor * floor).sqrt();
        most = most.max((a[n] - b[n]).abs() / error);
    }
    most
}

#[test]
#[ignore = "takes as long as PALPATE_RAYS, the number of rays, says"]
fn no_pixel_is_negative_infinite_or_far_off() {
    let wanted: f64 = std::env::var("PALPATE_RAYS").map_or(6e6, |n| n.parse().unwrap());
    let gpu = Gpu::new().unwrap();
    let (mut rays, mut paths, mut number, mut farthest) = (0.0, 0u64, 0, 0.0f64);
    while rays < wanted {
        let (body, options) = pair(number);
        let camera = Camera::fit_mesh_in(&body.mesh, SIZE);
        let mut caster = body.caster(&gpu);
        let pictures = [0, 1].map(|k| {
            let options = PathOptions {
                seed: options.seed + k,
                ..options.clone()
            };
            let started = caster.start_paths(&camera, SIZE, (&options, &body.walls));
            started.unwrap().finish(&no_progress).unwrap()
        });
        for picture in &pictures {
            let mut values = picture.linear().values.iter();
            let bad = values.find(|v| !(v.is_finite() && **v >= 0.0));
            assert_eq!(bad, None, "pair {number}");
            assert_eq!(picture.lost(), 0, "pair {number}");
        }
        let texels = options.environment.map(&camera).unwrap().texels;
        let brightest = texels
            .iter()
            .map(environment::luminance)
            .fold(0.0, f64::max);
        let [a, mut b] = [0, 1].map(|k| light_of(&pictures[k]));
        let mean_most = a.iter().chain(&b).copied().fold(0.0, f64::max);
        assert!(
            mean_most <= brightest,
            "pair {number}: {mean_most} {brightest}"
        );
        let most = largest_difference(&pictures, [&a, &b], brightest);
        assert!(most < MOST, "pair {number}: {most} standard errors");
        farthest = farthest.max(most);
        if number == 0 {
            // A pixel that is off is found.
            b[(SIZE[0] * SIZE[1] / 2 + SIZE[0] / 2) as usize] += 10.0;
            assert!(largest_difference(&pictures, [&a, &b], brightest) > MOST);
        }
        // From each event a path goes on and looks for light.
        let (_, _, events) = body.traced(&camera, [8, 8], &options, 2);
        let own = 2 * u64::from(SAMPLES * SIZE[0] * SIZE[1]);
        paths += own;
        rays += own as f64 * (1.0 + 2.0 * events as f64 / 128.0);
        number += 1;
        if number % 10 == 0 {
            println!("{paths} paths, {rays:.3e} rays, at most {farthest:.1} standard errors");
        }
    }
    println!("{paths} paths, {rays:.3e} rays, at most {farthest:.1} standard errors");
}
