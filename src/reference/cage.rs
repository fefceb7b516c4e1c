//! Nodes of a fine mesh carried by the tets of a cage, in float64: the twin of
//! `shaders/cage/carry.wgsl`.

use glam::DVec3;

/// Where each point is that is tied to four of the `nodes` by weights of sum 1: Σ w_k x_k.
pub fn carry(shares: &[([u32; 4], [f64; 4])], nodes: &[DVec3]) -> Vec<DVec3> {
    let at = |(corners, weights): &([u32; 4], [f64; 4])| {
        let parts = corners.iter().zip(weights);
        parts.map(|(v, w)| *w * nodes[*v as usize]).sum()
    };
    shares.iter().map(at).collect()
}
