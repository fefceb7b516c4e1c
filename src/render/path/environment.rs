//! The surroundings that light a body: a map of colours over all directions, and how it is sampled.

use crate::gpu::{Array, Gpu, Texel};
use crate::render::Camera;
use crate::{Error, Result};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What lights a body.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) enum Environment {
    /// Three soft lights around the camera: a key light from the upper left, a weaker fill light from
    /// the right, a rim light from behind; and some light from all sides.
    #[default]
    Studio,
    /// White light of radiance 1 from all sides.
    White,
    /// A sun with soft edges of shadows, in this direction (file coordinates), and some light from
    /// all sides.
    Sun(DVec3),
    /// A picture of the surroundings, in equal steps of longitude and latitude: .hdr or .exr, linear.
    /// Its upper edge is the camera's up direction.
    File(PathBuf),
}

/// Texels around and from top to bottom; all have the same solid angle.
const SIZE: [u32; 2] = [192, 96];
/// Radiance of the light from all sides in the studio and beside the sun.
const DIM: f64 = 0.3;
/// Half-angle of the sun, in radians.
const SUN_RADIUS: f64 = 0.09;
/// Irradiance of the sun on a surface that faces it, over π.
const SUN: f64 = 0.9;

/// A map on the device.
pub(super) struct Sky {
    pub items: Array,
    pub size: [u32; 2],
}

/// Radiance of each texel, row by row from the top; its axes: x to the right, y up, z against the
/// view.
#[derive(Clone)]
pub(super) struct SkyMap {
    pub texels: Arc<[[f64; 3]]>,
    /// Probability per solid angle with which a texel is sampled.
    pub densities: Vec<f64>,
    pub axes: [DVec3; 3],
}

impl Environment {
    /// Parses `studio`, `white`, or the name of a file.
    pub fn parse(text: &str) -> Result<Environment> {
        match text {
            "studio" => Ok(Environment::Studio),
            "white" => Ok(Environment::White),
            file => {
                let path = Path::new(file);
                let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
                match extension.to_ascii_lowercase().as_str() {
                    "hdr" | "exr" => Ok(Environment::File(path.to_path_buf())),
                    _ => Err(Error::Input(format!(
                        "unknown environment \"{file}\"; use studio, white, or a file .hdr or .exr"
                    ))),
                }
            }
        }
    }

    /// Returns the map for a camera.
    pub(super) fn map(&self, camera: &Camera) -> Result<SkyMap> {
        let view = camera.axes();
        let (axes, texels): (_, Vec<[f64; 3]>) = match self {
            Environment::White => ([view.right, view.up, -view.forward], of_all(|_| [1.0; 3])),
            Environment::Studio => ([view.right, view.up, -view.forward], of_all(studio)),
            Environment::Sun(way) => {
                // The sun is at the pole, where the map has no seam.
                let up = way.normalize_or_zero();
                let right = up.any_orthonormal_vector();
                ([right, up, right.cross(up)], of_all(sun))
            }
            Environment::File(path) => {
                let up = camera.up.normalize_or_zero();
                // A fixed direction, so that the surroundings do not turn with the camera.
                let right = up.any_orthonormal_vector();
                ([right, up, right.cross(up)], read(path)?)
            }
        };
        Ok(SkyMap::new(texels.into(), axes))
    }

    pub(super) fn to_gpu(&self, gpu: &Gpu, camera: &Camera) -> Result<(Sky, [[f32; 4]; 3])> {
        let map = self.map(camera)?;
        let items = gpu.array_of("surroundings", Texel::F32x4, &map.items())?;
        let axes = map.axes.map(|a| a.as_vec3().extend(0.0).to_array());
        Ok((Sky { items, size: SIZE }, axes))
    }
}

impl SkyMap {
    fn new(texels: Arc<[[f64; 3]]>, axes: [DVec3; 3]) -> SkyMap {
        let solid_angle = 4.0 * std::f64::consts::PI / texels.len() as f64;
        let weights: Vec<f64> = texels.iter().map(luminance).collect();
        let whole: f64 = weights.iter().sum();
        // A tenth of the samples goes evenly to all directions, so that none has a density of 0.
        let even = 1.0 / texels.len() as f64;
        let share = |w: &f64| match whole > 0.0 {
            true => 0.9 * w / whole + 0.1 * even,
            false => even,
        };
        SkyMap {
            densities: weights.iter().map(|w| share(w) / solid_angle).collect(),
            texels,
            axes,
        }
    }

    /// Returns the texel of a direction.
    #[cfg(test)]
    pub fn texel(&self, way: DVec3) -> usize {
        let m = self.axes.map(|axis| axis.dot(way));
        let turn = m[0].atan2(m[2]) / (2.0 * std::f64::consts::PI) + 0.5;
        let [w, h] = SIZE.map(|n| n as usize);
        let column = ((turn.max(0.0) * w as f64) as usize).min(w - 1);
        let row = (((0.5 - 0.5 * m[1]).clamp(0.0, 1.0) * h as f64) as usize).min(h - 1);
        row * w + column
    }

    /// Returns the items of `lib/path_sky`: colour and density, then the entry of the alias table
    /// (Walker 1977; Vose 1991).
    fn items(&self) -> Vec<[f32; 4]> {
        let n = self.texels.len();
        let whole: f64 = self.densities.iter().sum();
        let mut scaled: Vec<f64> = self
            .densities
            .iter()
            .map(|d| d / whole * n as f64)
            .collect();
        let mut aliases: Vec<(f64, u32)> = (0..n as u32).map(|k| (1.0, k)).collect();
        let (mut small, mut large): (Vec<usize>, Vec<usize>) =
            (0..n).partition(|k| scaled[*k] < 1.0);
        while let (Some(less), Some(more)) = (small.pop(), large.last().copied()) {
            aliases[less] = (scaled[less], more as u32);
            scaled[more] -= 1.0 - scaled[less];
            if scaled[more] < 1.0 {
                large.pop();
                small.push(more);
            }
        }
        let texels = self.texels.iter().zip(&self.densities).zip(&aliases);
        texels
            .flat_map(|(([r, g, b], density), (keeps, other))| {
                [
                    [*r as f32, *g as f32, *b as f32, *density as f32],
                    [*keeps as f32, *other as f32, 0.0, 0.0],
                ]
            })
            .collect()
    }
}

/// Returns the centre of a texel in the axes of the map.
fn centre(k: usize) -> DVec3 {
    let [w, h] = SIZE.map(|n| n as usize);
    direction([
        ((k % w) as f64 + 0.5) / w as f64,
        ((k / w) as f64 + 0.5) / h as f64,
    ])
}

/// Returns the direction of a place in the map, in its axes.
fn direction([x, y]: [f64; 2]) -> DVec3 {
    let turn = 2.0 * std::f64::consts::PI * (x - 0.5);
    let up = 1.0 - 2.0 * y;
    let r = (1.0 - up * up).max(0.0).sqrt();
    DVec3::new(r * turn.sin(), up, r * turn.cos())
}

fn of_all(radiance: impl Fn(DVec3) -> [f64; 3]) -> Vec<[f64; 3]> {
    (0..(SIZE[0] * SIZE[1]) as usize)
        .map(|k| radiance(centre(k)))
        .collect()
}

/// Returns the radiance of the studio: each light is a disc with a soft edge.
fn studio(way: DVec3) -> [f64; 3] {
    // Direction (right, up, towards the eye), half-angle in degrees, radiance, and warmth.
    const LIGHTS: [([f64; 3], f64, f64, [f64; 3]); 3] = [
        ([-0.55, 0.60, 0.65], 24.0, 5.2, [1.0, 0.97, 0.92]),
        ([0.85, 0.10, 0.50], 32.0, 1.1, [0.92, 0.96, 1.0]),
        ([0.45, 0.55, -0.80], 22.0, 4.5, [1.0, 1.0, 1.0]),
    ];
    let mut sum = [DIM; 3];
    for (towards, radius, radiance, tint) in LIGHTS {
        let angle = way
            .dot(DVec3::from(towards).normalize())
            .clamp(-1.0, 1.0)
            .acos()
            .to_degrees();
        let share = ((radius - angle) / (0.25 * radius)).clamp(0.0, 1.0);
        let soft = share * share * (3.0 - 2.0 * share);
        for (s, t) in sum.iter_mut().zip(tint) {
            *s += soft * radiance * t;
        }
    }
    sum
}

/// Returns the radiance of a sun at the pole of the map.
fn sun(way: DVec3) -> [f64; 3] {
    let angle = way.y.clamp(-1.0, 1.0).acos();
    let radiance = SUN / (1.0 - SUN_RADIUS.cos()) / 2.0;
    [DIM + if angle < SUN_RADIUS { radiance } else { 0.0 }; 3]
}

/// Reads a picture of the surroundings; each texel is the mean of points in it.
fn read(path: &Path) -> Result<Vec<[f64; 3]>> {
    let bytes = crate::files::read(path)?;
    let picture = image::load_from_memory(&bytes)
        .map_err(|e| Error::format(path, format!("cannot read the surroundings: {e}")))?
        .into_rgb32f();
    let (w, h) = picture.dimensions();
    if w == 0 || h == 0 {
        return Err(Error::format(path, "the picture has no pixels"));
    }
    /// Points along each axis of a texel.
    const POINTS: usize = 8;
    let [across, down] = SIZE.map(|n| n as usize);
    let at = |k: usize| {
        let mut sum = [0.0; 3];
        for i in 0..POINTS * POINTS {
            let part = |j: usize| (j as f64 + 0.5) / POINTS as f64;
            let x = ((k % across) as f64 + part(i % POINTS)) / across as f64;
            let y = ((k / across) as f64 + part(i / POINTS)) / down as f64;
            // The map's y is even in height, the picture's in latitude.
            let latitude = (1.0 - 2.0 * y).clamp(-1.0, 1.0).acos() / std::f64::consts::PI;
            let pixel = |share: f64, n: u32| ((share * f64::from(n)) as u32).min(n - 1);
            let colour = picture.get_pixel(pixel(x, w), pixel(latitude, h)).0;
            for (s, c) in sum.iter_mut().zip(colour) {
                *s += f64::from(c);
            }
        }
        sum.map(|s| s / (POINTS * POINTS) as f64)
    };
    let texels: Vec<[f64; 3]> = (0..across * down).map(at).collect();
    match texels.iter().flatten().all(|c| c.is_finite() && *c >= 0.0) {
        true => Ok(texels),
        false => Err(Error::format(
            path,
            "the surroundings must be finite and not negative",
        )),
    }
}

pub(super) fn luminance([r, g, b]: &[f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}
