//! Integrals of the transfer function over the scalar s, tabulated at points. With extinction τ
//! relative to its maximum and colour c relative to the brightest:
//!
//! ```text
//! P(s) = ∫₀ˢ τ,   C(s) = ∫₀ˢ c τ,   Q(s) = ∫₀ˢ c τ P.
//! ```
//!
//! For a segment between the scalars a and b, the mean extinction is (P(b) − P(a)) / (b − a), and
//! the mean colour without self-attenuation is (C(b) − C(a)) / (P(b) − P(a)). Self-attenuation is
//! proportional to depth to first order, and requires the moment Q(b) − Q(a) − P(a) (C(b) − C(a));
//! see `shaders/terms/integrals.wgsl`.

use super::linear_pieces::{LinearPieces, gpu_data::Piece};
use super::{Table, TableKind, TableRequest, TableRow};
use crate::Result;
use crate::gpu::Gpu;

/// Number of points from scalar 0 to scalar 1, plus one beyond so that each point has a successor.
const POINTS: u32 = 4095;
/// Fixed-point scale of the integrals; fixed point makes differences exact. `terms/integrals.wgsl`
/// has the same number.
const FIXED_POINT_SCALE: f64 = 2_147_483_000.0;
/// Maximum mean depth of a segment for which one lookup keeps an image within half a grey level,
/// for smooth and for narrow-peaked functions; the error grows with its square.
const MAX_MEAN_DEPTH: f64 = 0.25;
const THIN_ERROR: f64 = 0.25 / 255.0;

/// Whether segments are thin enough for one lookup each at the accuracy of `wanted`.
pub(super) fn is_sufficient(pieces: &[LinearPieces], wanted: &TableRequest) -> bool {
    // Mean extinction over the scalar histogram of the body; maximum over the rows.
    let mean = |(p, row): (&LinearPieces, &TableRow)| {
        let sums = Row::of(p, 1.0, 1.0).values;
        let parts = row.spread.len();
        let up_to = |k: usize| {
            sums.get(k * (POINTS as usize - 1) / parts)
                .map_or(0.0, |s| s.p)
        };
        let part = |(k, share): (usize, &f64)| share * (up_to(k + 1) - up_to(k));
        let mean_extinction: f64 = row.spread.iter().enumerate().map(part).sum();
        p.max_extinction * mean_extinction * parts as f64
    };
    let rows = pieces.iter().zip(wanted.rows);
    let mean = rows.map(mean).fold(0.0, f64::max);
    let thin = MAX_MEAN_DEPTH * (wanted.accuracy / THIN_ERROR).sqrt();
    mean * wanted.scale * wanted.mean_segment <= thin
}

/// Creates the table of several transfer functions, two rows each: C and P, then Q. `most` is the
/// largest extinction, `opacity` the same in the unit of the table.
pub(super) fn table(
    gpu: &Gpu,
    pieces: &[LinearPieces],
    (most, opacity): (f64, f64),
    wanted: &TableRequest,
) -> Result<Table> {
    let colours = pieces.iter().flat_map(|p| &p.list);
    let colours = colours.flat_map(|p| p.first.into_iter().chain(p.last));
    let brightest = f64::from(colours.fold(1.0, f32::max));
    let rows: Vec<Row> = pieces
        .iter()
        .map(|p| Row::of(p, p.max_extinction / most.max(f64::MIN_POSITIVE), brightest))
        .collect();
    let size = [POINTS + 1, 2 * rows.len() as u32, 1];
    let texture = gpu.texture(
        "pre-integrated table",
        size,
        wgpu::TextureFormat::Rgba32Uint,
        wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::COPY_DST,
    )?;
    let texels: Vec<[u32; 4]> = rows.iter().flat_map(|row| row.texels()).collect();
    gpu.queue().write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(&texels),
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(16 * size[0]),
            rows_per_image: None,
        },
        texture.size(),
    );
    Ok(Table {
        form: TableKind::Integrals,
        view: texture.create_view(&wgpu::TextureViewDescriptor::default()),
        size: POINTS,
        layers: rows.len() as u32,
        max_depth: 1.0,
        opacity: opacity as f32,
        scalar: [POINTS as f32 - 1.0, 0.0],
        constants: vec![
            (
                "PIECES",
                f64::from(u8::from(!is_sufficient(pieces, wanted))),
            ),
            ("MAX_COLOUR", brightest),
        ],
        passes: Vec::new(),
    })
}

/// P, C and Q at a point.
#[derive(Clone, Copy, Default)]
struct Integral {
    p: f64,
    c: [f64; 3],
    q: [f64; 3],
}

/// Integrals of one transfer function at all points.
struct Row {
    values: Vec<Integral>,
}

impl Row {
    /// Integrates a function whose largest extinction is `share` of the unit.
    fn of(pieces: &LinearPieces, share: f64, brightest: f64) -> Row {
        let point = |k: u32| f64::from(k) / f64::from(POINTS - 1);
        let mut values = vec![Integral::default()];
        let mut sum = Integral::default();
        let mut first = 0;
        for k in 0..POINTS {
            let (low, high) = (point(k), point(k + 1));
            for (i, piece) in pieces.list.iter().enumerate().skip(first) {
                let [from, _, to, _] = piece.ends.map(f64::from);
                if from >= high {
                    break;
                }
                if to <= low {
                    first = i + 1;
                    continue;
                }
                sum.add(piece, (low.max(from), high.min(to)), share, brightest);
            }
            values.push(sum);
        }
        Row { values }
    }

    fn texels(&self) -> impl Iterator<Item = [u32; 4]> {
        // Beyond 1 at the last point; the differences are exact modulo 2³².
        let fixed = |x: f64| (x * FIXED_POINT_SCALE).round() as u32;
        let texel = move |v: [f64; 3], w: f64| [v[0], v[1], v[2], w].map(fixed);
        let sums = self.values.iter().map(move |v| texel(v.c, v.p));
        let moments = self.values.iter().map(move |v| texel(v.q, 0.0));
        sums.chain(moments)
    }
}

impl Integral {
    /// Extends the integrals from `low` to `high`, both in one piece with linear c and τ.
    /// Three-point Gauss-Legendre quadrature is exact up to degree five, and c τ P has degree four.
    fn add(&mut self, piece: &Piece, (low, high): (f64, f64), share: f64, brightest: f64) {
        let [from, t0, to, t1] = piece.ends.map(f64::from);
        let along = |s: f64| (s - from) / (to - from);
        let tau = |s: f64| share * (t0 + along(s) * (t1 - t0));
        let colour = |s: f64, k: usize| {
            let [a, b] = [piece.first, piece.last].map(|c| f64::from(c[k]));
            (a + along(s) * (b - a)) / brightest
        };
        let start = self.p;
        let below = |s: f64| start + 0.5 * (tau(low) + tau(s)) * (s - low);
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let off = half * 0.6f64.sqrt();
        for (s, weight) in [
            (middle - off, 5.0 / 9.0),
            (middle, 8.0 / 9.0),
            (middle + off, 5.0 / 9.0),
        ] {
            let w = weight * half;
            for k in 0..3 {
                let emitted = w * colour(s, k) * tau(s);
                self.c[k] += emitted;
                self.q[k] += emitted * below(s);
            }
        }
        self.p = below(high);
    }
}
