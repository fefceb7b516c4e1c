//! A small rasteriser with a depth buffer: what is seen at each sample, and its light.

use super::view::View;
use glam::{DVec2, DVec3, Vec3};

/// Samples per pixel along each axis.
pub(super) const SAMPLES: u32 = 2;
/// Radius of ambient occlusion relative to the height of the picture, and its taps.
const OCCLUSION_RADIUS: f64 = 0.055;
const OCCLUSION_TAPS: usize = 16;
/// Strength of ambient occlusion.
const OCCLUSION: f32 = 0.85;
/// Texels of the shadow map along each side, and its offset in texels.
const SHADOW_TEXELS: u32 = 700;
const SHADOW_BIAS: f64 = 2.5;
/// Light that reaches a point in the shadow of the key light.
const SHADOW_FLOOR: f32 = 0.25;

/// What a sample shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(super) enum Kind {
    /// The background.
    #[default]
    Nothing,
    /// The boundary of the body.
    Skin,
    /// The cut face: its region, and the interval of values between two isolines.
    Cut(u16, u16),
    /// The finger.
    Finger,
    /// Its nail.
    Nail,
}

/// A point of a surface as a sample sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surfel {
    pub kind: Kind,
    /// Colour as displayed, from 0 to 1.
    pub colour: [f32; 3],
    /// Unit normal.
    pub normal: DVec3,
}

/// What each sample of a picture shows.
pub(super) struct Raster {
    pub size: [u32; 2],
    pub depth: Vec<f32>,
    kinds: Vec<Kind>,
    colours: Vec<[f32; 3]>,
    normals: Vec<Vec3>,
}

impl Raster {
    /// Creates the empty raster of `size` samples.
    pub fn new(size: [u32; 2]) -> Raster {
        let count = size[0] as usize * size[1] as usize;
        Raster {
            size,
            depth: vec![f32::INFINITY; count],
            kinds: vec![Kind::Nothing; count],
            colours: vec![[0.0; 3]; count],
            normals: vec![Vec3::Z; count],
        }
    }

    /// Draws a triangle; `surfel` gets the weights of its corners at a sample, and may leave it out.
    pub fn triangle(
        &mut self,
        view: &View,
        corners: [DVec3; 3],
        mut surfel: impl FnMut([f64; 3]) -> Option<Surfel>,
    ) {
        let seen = corners.map(|p| view.project(p));
        if seen.iter().any(|p| p.z <= view.near()) {
            return;
        }
        let [a, b, c] = seen.map(DVec3::truncate);
        let area = (b - a).perp_dot(c - a);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let range = |k: usize| {
            let end = f64::from(self.size[k]);
            let from = (low[k] - 0.5).ceil().clamp(0.0, end) as u32;
            let to = ((high[k] - 0.5).floor() + 1.0).clamp(0.0, end) as u32;
            from..to
        };
        let (columns, rows) = (range(0), range(1));
        let nearness = match view.is_perspective() {
            true => seen.map(|p| 1.0 / p.z),
            false => [1.0; 3],
        };
        for y in rows {
            for x in columns.clone() {
                let p = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let flat = [
                    (c - b).perp_dot(p - b),
                    (a - c).perp_dot(p - c),
                    (b - a).perp_dot(p - a),
                ]
                .map(|w| w / area);
                if flat.iter().any(|w| *w < -1e-9) {
                    continue;
                }
                let near: f64 = (0..3).map(|k| flat[k] * nearness[k]).sum();
                let weights = [0, 1, 2].map(|k| flat[k] * nearness[k] / near);
                let depth: f64 = (0..3).map(|k| weights[k] * seen[k].z).sum();
                let at = y as usize * self.size[0] as usize + x as usize;
                if depth as f32 >= self.depth[at] {
                    continue;
                }
                if let Some(found) = surfel(weights) {
                    self.depth[at] = depth as f32;
                    self.kinds[at] = found.kind;
                    self.colours[at] = found.colour;
                    self.normals[at] = found.normal.as_vec3();
                }
            }
        }
    }

    /// Returns what sample (x, y) shows.
    pub fn kind(&self, x: u32, y: u32) -> Kind {
        self.kinds[(y * self.size[0] + x) as usize]
    }

    /// Returns the regions of the cut face that are seen.
    pub fn regions(&self) -> std::collections::BTreeSet<u16> {
        let cut = self.kinds.iter().filter_map(|kind| match kind {
            Kind::Cut(region, _) => Some(*region),
            _ => None,
        });
        cut.collect()
    }

    /// Lights all samples and returns their mean per pixel: premultiplied red, green, blue and opacity.
    pub fn lit(&self, view: &View, shadow: Option<&Shadow>) -> Vec<f32> {
        let occlusion = self.occlusion(view);
        let size = self.size.map(|n| n / SAMPLES);
        let share = 1.0 / (SAMPLES * SAMPLES) as f32;
        let lamp = view.lamp().as_vec3();
        let (up, ahead) = (view.up.as_vec3(), view.forward.as_vec3());
        let mut pixels = Vec::with_capacity(4 * (size[0] * size[1]) as usize);
        for (y, x) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (y, x))) {
            let mut sum = [0.0f32; 4];
            for (dy, dx) in (0..SAMPLES).flat_map(|dy| (0..SAMPLES).map(move |dx| (dy, dx))) {
                let (sx, sy) = (SAMPLES * x + dx, SAMPLES * y + dy);
                let at = (sy * self.size[0] + sx) as usize;
                let kind = self.kinds[at];
                if kind == Kind::Nothing {
                    continue;
                }
                let open = occlusion[(y * size[0] + x) as usize];
                let mut normal = self.normals[at];
                if normal.dot(ahead) > 0.0 {
                    normal = -normal;
                }
                let lit = match (kind, shadow) {
                    // A cut face is drawn flat, so that its colours compare.
                    (Kind::Cut(..), _) | (_, None) => 1.0,
                    (_, Some(shadow)) => {
                        shadow.light_at(view.unproject([sx, sy], f64::from(self.depth[at])))
                    }
                };
                let key = ((normal.dot(lamp) + 0.25) / 1.25).max(0.0)
                    * (SHADOW_FLOOR + (1.0 - SHADOW_FLOOR) * lit);
                let sky = 0.5 + 0.5 * normal.dot(up);
                let (ambient, direct) = match kind {
                    // Cut faces keep their colours.
                    Kind::Cut(..) => (0.72, 0.36),
                    _ => (0.30 + 0.16 * sky, 0.78),
                };
                let half = (lamp - ahead).normalize_or_zero();
                let (gloss, power) = match kind {
                    Kind::Nail => (0.30, 40),
                    Kind::Finger => (0.06, 18),
                    Kind::Skin => (0.05, 18),
                    _ => (0.0, 1),
                };
                let shine = gloss * lit * normal.dot(half).max(0.0).powi(power);
                let ink = self.ink(sx, sy);
                for (sum, colour) in sum.iter_mut().zip(self.colours[at]) {
                    let linear = colour.powf(2.2) * (ambient * open + direct * key) + shine;
                    *sum += share * ink * linear.clamp(0.0, 1.0).powf(1.0 / 2.2);
                }
                sum[3] += share;
            }
            pixels.extend(sum);
        }
        pixels
    }

    /// Returns the factor of a drawn line at a sample: darker at the edges of what is shown.
    fn ink(&self, x: u32, y: u32) -> f32 {
        let own = self.kind(x, y);
        let deep = self.depth[(y * self.size[0] + x) as usize];
        let mut ink = 1.0f32;
        for (dx, dy) in [(1i64, 0i64), (-1, 0), (0, 1), (0, -1)] {
            let (nx, ny) = (i64::from(x) + dx, i64::from(y) + dy);
            if nx < 0 || ny < 0 || nx >= i64::from(self.size[0]) || ny >= i64::from(self.size[1]) {
                continue;
            }
            let other = self.kind(nx as u32, ny as u32);
            let apart = self.depth[(ny as u32 * self.size[0] + nx as u32) as usize];
            let line = match (own, other) {
                (a, b) if a == b => match (a, (deep - apart).abs() > 0.03 * deep) {
                    (Kind::Finger | Kind::Skin, true) => 0.55,
                    _ => 1.0,
                },
                (Kind::Cut(a, _), Kind::Cut(b, _)) if a == b => 0.60,
                (Kind::Cut(..), Kind::Cut(..)) => 0.42,
                (Kind::Finger, Kind::Nail) | (Kind::Nail, Kind::Finger) => 0.8,
                (_, Kind::Nothing) => 0.6,
                _ => 0.5,
            };
            ink = ink.min(line);
        }
        ink
    }

    /// Returns the open share of the surroundings of each pixel.
    fn occlusion(&self, view: &View) -> Vec<f32> {
        let size = self.size.map(|n| n / SAMPLES);
        let radius = OCCLUSION_RADIUS * f64::from(self.size[1]);
        let mut open = Vec::with_capacity((size[0] * size[1]) as usize);
        for (y, x) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (y, x))) {
            let (sx, sy) = (SAMPLES * x, SAMPLES * y);
            let at = (sy * self.size[0] + sx) as usize;
            if self.kinds[at] == Kind::Nothing {
                open.push(1.0);
                continue;
            }
            let here = view.unproject([sx, sy], f64::from(self.depth[at]));
            let reach = radius * view.pixel_at(f64::from(self.depth[at]));
            let mut normal = self.normals[at].as_dvec3();
            if normal.dot(view.forward) > 0.0 {
                normal = -normal;
            }
            // Another pattern at each of 4 × 4 pixels, which the eye averages.
            let turn = f64::from((5 * x + 3 * y) % 16) / 16.0;
            let mut hidden = 0.0;
            for k in 0..OCCLUSION_TAPS {
                let share = (k as f64 + turn) / OCCLUSION_TAPS as f64;
                let angle = std::f64::consts::TAU * (share * 3.0 + turn);
                let (tx, ty) = (
                    f64::from(sx) + radius * share * angle.cos(),
                    f64::from(sy) + radius * share * angle.sin(),
                );
                if tx < 0.0
                    || ty < 0.0
                    || tx >= f64::from(self.size[0])
                    || ty >= f64::from(self.size[1])
                {
                    continue;
                }
                let tap = [tx as u32, ty as u32];
                let depth = self.depth[(tap[1] * self.size[0] + tap[0]) as usize];
                if !depth.is_finite() {
                    continue;
                }
                let to = view.unproject(tap, f64::from(depth)) - here;
                let far = to.length() / reach.max(f64::MIN_POSITIVE);
                hidden += (to.normalize_or_zero().dot(normal) - 0.12).max(0.0) / (1.0 + far * far);
            }
            let hidden = (2.0 * hidden / OCCLUSION_TAPS as f64).min(1.0) as f32;
            open.push(1.0 - OCCLUSION * hidden);
        }
        blurred(&open, size)
    }
}

/// Returns the means over blocks of 4 × 4 pixels, which removes the pattern of the taps.
fn blurred(values: &[f32], size: [u32; 2]) -> Vec<f32> {
    let [w, h] = size.map(|n| n as usize);
    let along = |values: &[f32], step: usize, count: usize, index: &dyn Fn(usize) -> usize| {
        let mut blurred = vec![0.0; values.len()];
        for (at, blurred) in blurred.iter_mut().enumerate() {
            let i = index(at);
            let (low, high) = (i.min(2), (count - 1 - i).min(1));
            let taps = (at - low * step..=at + high * step).step_by(step);
            *blurred = taps.map(|t| values[t]).sum::<f32>() / (low + high + 1) as f32;
        }
        blurred
    };
    let rows = along(values, 1, w, &|at| at % w);
    along(&rows, w, h, &|at| at / w)
}

/// The shadow map of the key light.
pub(super) struct Shadow {
    pub view: View,
    pub map: Raster,
}

impl Shadow {
    /// Creates an empty map around `centre`, `reach` wide to each side.
    pub fn new(view: &View, centre: DVec3, reach: f64) -> Shadow {
        let lamp = view.lamp();
        Shadow {
            view: View::orthographic(
                centre + 4.0 * reach * lamp,
                centre,
                view.up,
                2.0 * reach,
                [SHADOW_TEXELS; 2],
            ),
            map: Raster::new([SHADOW_TEXELS; 2]),
        }
    }

    /// Returns the share of the key light that reaches `point`.
    fn light_at(&self, point: DVec3) -> f32 {
        let at = self.view.project(point);
        let bias = SHADOW_BIAS * self.view.pixel_at(at.z);
        let mut lit = 0.0;
        for (dx, dy) in (-2..=2).flat_map(|dx| (-2..=2).map(move |dy| (dx, dy))) {
            let (x, y) = (at.x + 1.5 * f64::from(dx), at.y + 1.5 * f64::from(dy));
            let end = f64::from(SHADOW_TEXELS);
            let outside = x < 0.0 || y < 0.0 || x >= end || y >= end;
            let hit = !outside && {
                let depth = self.map.depth[y as usize * SHADOW_TEXELS as usize + x as usize];
                f64::from(depth) < at.z - bias
            };
            lit += f32::from(u8::from(!hit));
        }
        lit / 25.0
    }
}
