//! Decomposition of a transfer function into pieces with linear colour and extinction.

use super::SIZES;
use crate::render::AbsoluteTransferFunction;

pub(super) mod gpu_data {
    crate::gpu_struct! {
        /// Layout of `shaders/lib/linear_pieces.wgsl`.
        pub(in super::super) struct Piece {
            pub ends: [f32; 4],
            pub first: [f32; 4],
            pub last: [f32; 4],
        }
    }
}

/// Transfer function split at its breakpoints, over scalars from −1 to 2 (the range is 0 to 1).
pub(super) struct LinearPieces {
    /// Pieces in ascending scalar order.
    pub list: Vec<gpu_data::Piece>,
    /// Largest extinction in the range, per file unit.
    pub max_extinction: f64,
}

impl LinearPieces {
    pub fn new(transfer: &AbsoluteTransferFunction, range: (f64, f64)) -> LinearPieces {
        let span = range.1 - range.0;
        let mut cuts: Vec<f64> = transfer
            .breakpoints()
            .iter()
            .map(|s| (s - range.0) / span)
            .filter(|s| *s > -1.0 && *s < 2.0)
            .collect();
        cuts.insert(0, -1.0);
        cuts.push(2.0);
        // Both functions are linear in a piece: two inner points determine its ends, including
        // jumps.
        let ends = |a: f64, b: f64| {
            let at = |w: f64| range.0 + span * (a + w * (b - a));
            let line = |p: f64, q: f64| [1.5 * p - 0.5 * q, 1.5 * q - 0.5 * p];
            let (p, q) = (transfer.colour(at(0.25)), transfer.colour(at(0.75)));
            let colour = [0, 1, 2].map(|k| line(p[k], q[k]));
            let [first, last] = line(transfer.extinction(at(0.25)), transfer.extinction(at(0.75)));
            (colour, [first.max(0.0), last.max(0.0)])
        };
        let wide = |pair: &&[f64]| pair[1] - pair[0] > 1e-9;
        let inside = |s: f64| transfer.extinction(range.0 + span * s);
        let max_extinction = cuts
            .windows(2)
            .filter(wide)
            .filter(|pair| pair[0] < 1.0 && pair[1] > 0.0)
            .flat_map(|pair| ends(pair[0].max(0.0), pair[1].min(1.0)).1)
            .fold(inside(0.0).max(inside(1.0)), f64::max);
        let unit = if max_extinction > 0.0 {
            max_extinction
        } else {
            1.0
        };
        let list = cuts
            .windows(2)
            .filter(wide)
            .map(|pair| {
                let (c, t) = ends(pair[0], pair[1]);
                gpu_data::Piece {
                    ends: [pair[0], t[0] / unit, pair[1], t[1] / unit].map(|x| x as f32),
                    first: [c[0][0], c[1][0], c[2][0], 0.0].map(|x| x as f32),
                    last: [c[0][1], c[1][1], c[2][1], 0.0].map(|x| x as f32),
                }
            })
            .collect();
        LinearPieces {
            list,
            max_extinction,
        }
    }

    /// Returns the texels along each scalar needed for images within `accuracy`. Linear
    /// interpolation has an error of (change of slope) h²/8 at a bend and (jump) h/4 at a jump: in
    /// extinction, over a path of about the extent of the mesh; in colour, over weights that sum to
    /// 1.
    pub fn required_size(&self, opacity: f64, accuracy: f64) -> u32 {
        // Beyond a depth of some units a ray is opaque and errors do not accumulate.
        let depth = opacity.min(16.0);
        let error = |h: f64| {
            let pairs = self.list.windows(2).map(|pair| {
                let [a, b] = [&pair[0], &pair[1]];
                // Values at the start and end of a piece, of extinction (0) or of a colour channel
                // (1 to 3).
                let ends = |p: &gpu_data::Piece, k: usize| match k {
                    0 => [p.ends[1], p.ends[3]],
                    _ => [p.first[k - 1], p.last[k - 1]],
                };
                let missed = |k: usize| {
                    let (before, after) = (ends(a, k), ends(b, k));
                    let slope = |p: &gpu_data::Piece, v: [f32; 2]| {
                        f64::from((v[1] - v[0]) / (p.ends[2] - p.ends[0]))
                    };
                    let bend = (slope(b, after) - slope(a, before)).abs();
                    let jump = f64::from((after[0] - before[1]).abs());
                    bend * h * h / 8.0 + jump * h / 4.0
                };
                let colour = (1..4).map(missed).fold(0.0, f64::max);
                [depth * missed(0), colour]
            });
            let most = pairs.fold([0.0f64; 2], |m, e| [m[0].max(e[0]), m[1].max(e[1])]);
            most[0] + most[1]
        };
        let enough = |size: &u32| error(1.0 / f64::from(*size)) <= accuracy;
        SIZES
            .into_iter()
            .find(enough)
            .unwrap_or(SIZES[SIZES.len() - 1])
    }
}
