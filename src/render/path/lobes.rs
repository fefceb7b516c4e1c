//! Scattering at surfaces and in soft tissue, in float64: reference of `shaders/lib/path_lobes.wgsl`,
//! and the table of directional albedos that it reads.

use std::f64::consts::PI;

/// Fresnel reflectance at normal incidence; as in the shader.
const F0: f64 = 0.0278;
/// Entries of the table.
const ENTRIES: usize = 32;
/// Points along each axis with which an entry is integrated.
const POINTS: usize = 256;

/// Directional albedo of the specular lobe at evenly spaced cosines of incidence.
pub(super) struct SpecularAlbedo([f64; ENTRIES]);

impl SpecularAlbedo {
    pub fn new(roughness: f64) -> SpecularAlbedo {
        let alpha = roughness * roughness;
        let mut table = [0.0; ENTRIES];
        for (k, entry) in table.iter_mut().enumerate() {
            // A cosine of 0 has no lobe; its limit stands in.
            let cosine = (k as f64 / (ENTRIES - 1) as f64).max(1e-3);
            *entry = directional_albedo(cosine, alpha);
        }
        SpecularAlbedo(table)
    }

    /// Returns the albedo at a cosine, linear between the entries.
    pub fn at(&self, cosine: f64) -> f64 {
        let x = cosine.clamp(0.0, 1.0) * (ENTRIES - 1) as f64;
        let k = (x as usize).min(ENTRIES - 2);
        self.0[k] + (x - k as f64) * (self.0[k + 1] - self.0[k])
    }

    /// Returns the albedo under light from all sides: 2 ∫ E μ dμ.
    pub fn mean(&self) -> f64 {
        // Exact for a piecewise linear function: Simpson's rule in each piece.
        let h = 1.0 / (ENTRIES - 1) as f64;
        let piece = |k: usize| {
            let at = |x: f64| self.at(x) * x;
            let a = k as f64 * h;
            h / 6.0 * (at(a) + 4.0 * at(a + 0.5 * h) + at(a + h))
        };
        2.0 * (0..ENTRIES - 1).map(piece).sum::<f64>()
    }

    pub fn to_gpu(&self) -> [[f32; 4]; 8] {
        std::array::from_fn(|i| std::array::from_fn(|k| self.0[4 * i + k] as f32))
    }
}

/// Returns the share of light from a direction that the specular lobe reflects: the mean over visible
/// normals of Fresnel's term times the masking of the reflected direction.
fn directional_albedo(cosine: f64, alpha: f64) -> f64 {
    let w = [(1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine];
    let n = POINTS as f64;
    let mut sum = 0.0;
    for i in 0..POINTS {
        for j in 0..POINTS {
            let (u, v) = ((i as f64 + 0.5) / n, (j as f64 + 0.5) / n);
            let h = visible_normal(w, alpha, u, v);
            let wh = dot(w, h);
            let l: [f64; 3] = std::array::from_fn(|k| 2.0 * wh * h[k] - w[k]);
            if l[2] > 0.0 {
                sum += fresnel(wh) * 2.0 * l[2] / masking(l[2], alpha);
            }
        }
    }
    sum / (n * n)
}

/// Samples the normals visible from w (Heitz 2018).
pub(super) fn visible_normal(w: [f64; 3], alpha: f64, u: f64, v: f64) -> [f64; 3] {
    let s = normalised([alpha * w[0], alpha * w[1], w[2]]);
    let flat = s[0] * s[0] + s[1] * s[1];
    let first = match flat > 1e-24 {
        true => [-s[1] / flat.sqrt(), s[0] / flat.sqrt(), 0.0],
        false => [1.0, 0.0, 0.0],
    };
    let second = cross(s, first);
    let (r, turn) = (u.sqrt(), 2.0 * PI * v);
    let x = r * turn.cos();
    let share = 0.5 * (1.0 + s[2]);
    let y = (1.0 - share) * (1.0 - x * x).max(0.0).sqrt() + share * r * turn.sin();
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    let n: [f64; 3] = std::array::from_fn(|k| x * first[k] + y * second[k] + z * s[k]);
    normalised([alpha * n[0], alpha * n[1], n[2].max(1e-12)])
}

pub(super) fn fresnel(cosine: f64) -> f64 {
    F0 + (1.0 - F0) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
}

pub(super) fn masking(cosine: f64, alpha: f64) -> f64 {
    let a2 = alpha * alpha;
    cosine + (a2 + (1.0 - a2) * cosine * cosine).sqrt()
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn normalised(a: [f64; 3]) -> [f64; 3] {
    let length = dot(a, a).sqrt();
    a.map(|x| x / length)
}
