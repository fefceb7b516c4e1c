//! Pictures whose light is known in closed form: slabs and a half space that scatter alike everywhere.

#![allow(clippy::unwrap_used)]

use super::picture::PathPicture;
use super::tests::{Body, grey, mean, picture};
use super::tone::srgb;
use super::{Environment, PathOptions};
use crate::gpu::Gpu;
use crate::mesh::LocalFrame;
use crate::render::Camera;
use glam::DVec3;
use std::f64::consts::PI;

/// Width of a slab over its thickness: no light comes in from its sides.
const FLATNESS: f64 = 25.0;
const SIZE: [u32; 2] = [64, 64];

/// Draws a slab of optical thickness `depth` and single-scattering albedo `albedo`, seen along its
/// normal.
fn slab(depth: f64, albedo: f64, options: &PathOptions) -> PathPicture {
    let brightness = f64::from(srgb(albedo as f32));
    let shape = |extinction: f64| {
        let mut body = Body::new("box", 100, |_| 0.5, grey(brightness, extinction));
        for p in body.mesh.nodes.iter_mut().chain(&mut body.nodes) {
            p.z /= FLATNESS;
        }
        body.lit = false;
        body
    };
    // Extinctions are per unit of the local frame.
    let mesh = shape(1.0).mesh;
    let (low, high) = mesh.bounds();
    let scale = LocalFrame::from_mesh(&mesh).scale;
    let body = shape(depth * scale / (high.z - low.z));
    let gpu = Gpu::new().unwrap();
    picture(&mut body.caster(&gpu), &camera(&body), SIZE, options)
}

fn camera(body: &Body) -> Camera {
    let (low, high) = body.mesh.bounds();
    let middle = 0.5 * (low + high);
    let height = 0.1 * (high.y - low.y);
    let eye = middle + DVec3::Z * (high.x - low.x);
    Camera::orthographic(eye, middle, DVec3::Y, height)
}

/// Light and opacity of a picture, and the standard error of the light.
fn seen(picture: &PathPicture) -> [f64; 3] {
    let [light, _, _, opacity] = mean(picture.linear());
    let pixels = f64::from(SIZE[0] * SIZE[1]);
    [light, opacity, light * picture.noise() / pixels.sqrt()]
}

/// Returns the light of radiance `sky` in each direction that a slab scatters once towards its normal
/// (Chandrasekhar 1960, section 47), with the phase function of Henyey and Greenstein.
fn scattered_once(depth: f64, albedo: f64, g: f64, sky: impl Fn(DVec3) -> f64) -> f64 {
    let (rows, columns) = (2000, 400);
    let mut sum = 0.0;
    for row in 0..rows {
        // Even in the cosine; never at 0 or 1, where the form has limits.
        let m = -1.0 + 2.0 * (f64::from(row) + 0.5) / f64::from(rows);
        let way = match m > 0.0 {
            true => (1.0 - (-depth * (1.0 + 1.0 / m)).exp()) * m / (1.0 + m),
            false => ((depth / m).exp() - (-depth).exp()) * m / (1.0 + m),
        };
        let base: f64 = 1.0 + g * g + 2.0 * g * m;
        let phase = (1.0 - g * g) / (4.0 * PI * base.powf(1.5));
        let r = (1.0 - m * m).sqrt();
        for column in 0..columns {
            let turn = 2.0 * PI * (f64::from(column) + 0.5) / f64::from(columns);
            sum += way * phase * sky(DVec3::new(r * turn.cos(), r * turn.sin(), m));
        }
    }
    albedo * sum * 4.0 * PI / f64::from(rows * columns)
}

#[test]
fn slab_transmits_and_scatters_once_as_in_closed_form() {
    // Light that scatters twice is less than this share.
    let albedo = 0.004;
    for (environment, g) in [
        (Environment::White, 0.0),
        (Environment::Sun(DVec3::new(0.5, 0.2, 0.8)), 0.6),
        (Environment::Sun(DVec3::new(0.3, -0.4, -0.7)), 0.0),
    ] {
        let options = PathOptions {
            samples: 64,
            environment,
            anisotropy: g,
            ..PathOptions::default()
        };
        let found = slab(1.0, albedo, &options);
        let [light, opacity, error] = seen(&found);
        let expected = 1.0 - (-1.0f64).exp();
        let sigma = (expected * (1.0 - expected) / (64.0 * 4096.0)).sqrt();
        assert!(
            (opacity - expected).abs() < 5.0 * sigma,
            "{opacity} for {expected}"
        );
        let mesh = Body::new("box", 100, |_| 0.5, grey(1.0, 1.0));
        let sky = options.environment.map(&camera(&mesh)).unwrap();
        let radiance = |way: DVec3| sky.texels[sky.texel(way)][0];
        let form = |depth: f64| scattered_once(depth, albedo, g, radiance);
        let tolerance = albedo * light + 5.0 * error;
        assert!(error < 0.006 * light, "{error} of {light}");
        let truth = form(1.0);
        assert!(
            (light - truth).abs() < tolerance,
            "{light} for {truth} ± {error}"
        );
        // Another slab has other light.
        let wrong = form(1.5);
        assert!((light - wrong).abs() > tolerance, "{light} for {wrong}");
    }
}

/// Returns the function H of isotropic scattering at 1 (Chandrasekhar 1960, section 37).
fn h_at_1(albedo: f64) -> f64 {
    let n = 2000;
    let at = |k: usize| (k as f64 + 0.5) / n as f64;
    let mut h = vec![1.0; n];
    let value = |h: &[f64], m: f64| {
        let sum: f64 = (0..n).map(|k| at(k) * h[k] / (m + at(k))).sum();
        1.0 / ((1.0 - albedo).sqrt() + 0.5 * albedo * sum / n as f64)
    };
    for _ in 0..60 {
        h = (0..n).map(|k| value(&h, at(k))).collect();
    }
    value(&h, 1.0)
}

/// Returns the share of a beam that a half space of the same refractive index as its surroundings
/// reflects, by diffusion from a source and its mirror image (Jensen et al. 2001).
fn dipole(albedo: f64) -> f64 {
    let root = (3.0 * (1.0 - albedo)).sqrt();
    0.5 * albedo * (1.0 + (-4.0 / 3.0 * root).exp()) * (-root).exp()
}

#[test]
fn half_space_reflects_as_chandrasekhar_and_diffusion_say() {
    let options = PathOptions {
        samples: 32,
        environment: Environment::White,
        ..PathOptions::default()
    };
    for albedo in [0.9, 0.99] {
        // By reciprocity, white light from all sides shows the reflectance of a beam.
        let [light, opacity, error] = seen(&slab(50.0, albedo, &options));
        assert!((opacity - 1.0).abs() < 1e-6);
        let exact = |albedo: f64| 1.0 - h_at_1(albedo) * (1.0 - albedo).sqrt();
        assert!(error < 0.003 * light, "{error} of {light}");
        let truth = exact(albedo);
        assert!(
            (light - truth).abs() < 5.0 * error,
            "{light} for {truth} ± {error}"
        );
        let diffuse = dipole(albedo);
        assert!((light / diffuse - 1.0).abs() < 0.1, "{light} for {diffuse}");
        // A medium that absorbs twice as much has neither.
        let wrong = 2.0 * albedo - 1.0;
        assert!((light / dipole(wrong) - 1.0).abs() > 0.1);
        assert!((light - exact(wrong)).abs() > 20.0 * error);
    }
}

#[test]
fn a_million_paths_neither_make_nor_lose_energy() {
    let gpu = Gpu::new().unwrap();
    let size = [128, 128];
    let options = PathOptions {
        samples: 64,
        environment: Environment::White,
        anisotropy: 0.3,
        ..PathOptions::default()
    };
    for brightness in [1.0, 0.98] {
        // Dense, and with a gradient: every path scatters in soft tissue and at surfaces.
        let body = Body::new("box", 100, |s| s.x, grey(brightness, 30.0));
        let found = picture(&mut body.caster(&gpu), &camera(&body), size, &options);
        assert_eq!(found.lost(), 0);
        let [light, _, _, opacity] = mean(found.linear());
        assert!((opacity - 1.0).abs() < 1e-6);
        let error = found.noise() / 128.0;
        assert!(error < 0.0015, "{error}");
        // A body that takes 4 % at each collision must show.
        match brightness < 1.0 {
            true => assert!(light < 1.0 - 20.0 * error, "{light}"),
            false => assert!((light - 1.0).abs() < 5.0 * error, "{light} ± {error}"),
        }
    }
}
