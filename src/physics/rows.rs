//! The springs of every node, laid out for the GPU: sliced rows of directed edges.
//!
//! Rows are taken 32 at a time; within such a slice the q-th four neighbours of all lie side by
//! side, so neighbouring invocations load neighbouring texels, and one node with many springs
//! lengthens its own slice only. Rows of one length come together: within a window of the file's
//! order they are sorted by it, so that invocations running side by side finish together. The
//! twin of `shaders/lib/springs.wgsl`.

use super::network::SpringNetwork;
use super::units::Units;
use crate::{Error, Result};
use glam::Vec3;

/// Rows in a slice.
const LANES: usize = 32;

/// Rows sorted among each other.
const WINDOW: usize = 512;

/// The rows as they are uploaded.
pub(super) struct Rows {
    /// Of each row: its node, the first texel of its slice in `columns`, its own texels.
    pub rows: Vec<[u32; 4]>,
    /// Four neighbours a texel, filled up with the node itself.
    pub columns: Vec<[u32; 4]>,
    /// κ and L of each directed edge, in local units; zero where a row is filled up.
    pub springs: Vec<[f32; 2]>,
}

impl Rows {
    /// The rows of `network`, whose nodes rest at the local positions `rest`.
    ///
    /// Rest lengths are those of the rounded positions, so that a body at rest has no forces.
    pub fn new(network: &SpringNetwork, rest: &[Vec3], units: &Units) -> Result<Rows> {
        let nodes = rest.len();
        let mut neighbours: Vec<Vec<(u32, f32, f32)>> = vec![Vec::new(); nodes];
        for s in &network.springs {
            let [i, j] = s.nodes;
            let length = rest[i as usize]
                .as_dvec3()
                .distance(rest[j as usize].as_dvec3()) as f32;
            let stiffness = (s.stiffness / units.stiffness()) as f32;
            neighbours[i as usize].push((j, stiffness, length));
            neighbours[j as usize].push((i, stiffness, length));
        }
        for row in &mut neighbours {
            row.sort_unstable_by_key(|n| n.0);
        }
        let mut built = Rows {
            rows: Vec::with_capacity(nodes),
            columns: Vec::new(),
            springs: Vec::new(),
        };
        let mut order: Vec<u32> = (0..nodes as u32).collect();
        for window in order.chunks_mut(WINDOW) {
            window.sort_by_key(|i| std::cmp::Reverse(neighbours[*i as usize].len()));
        }
        for slice in order.chunks(LANES) {
            let base = built.columns.len();
            let texels = |node: &u32| neighbours[*node as usize].len().div_ceil(4);
            let width = slice.iter().map(texels).max().unwrap_or(0);
            let end = base + width * LANES;
            if 4 * end > u32::MAX as usize {
                return Err(Error::Mesh(
                    "there are more edges than 32-bit indices allow; use a coarser mesh".into(),
                ));
            }
            built.columns.resize(end, [0; 4]);
            built.springs.resize(4 * end, [0.0; 2]);
            for (lane, node) in slice.iter().enumerate() {
                built
                    .rows
                    .push([*node, base as u32, texels(node) as u32, 0]);
                let row = &neighbours[*node as usize];
                for e in 0..4 * width {
                    let (other, stiffness, length) =
                        row.get(e).copied().unwrap_or((*node, 0.0, 0.0));
                    built.columns[base + (e / 4) * LANES + lane][e % 4] = other;
                    built.springs[4 * base + e * LANES + lane] = [stiffness, length];
                }
            }
        }
        Ok(built)
    }
}
