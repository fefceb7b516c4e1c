//! Shares of the regions of a mesh at its nodes.

use super::TetMesh;
use glam::DVec3;

/// Shares of regions at a node, in ascending order of the regions.
pub(super) type Shares = Vec<(u32, f64)>;

/// Returns the share of the solid angle of each region at each node.
pub(super) fn tet_shares(mesh: &TetMesh, regions: &[u32]) -> Vec<Shares> {
    let mut shares: Vec<Shares> = vec![Vec::new(); mesh.nodes.len()];
    for (tet, region) in mesh.tets.iter().zip(regions) {
        let x = tet.map(|v| mesh.nodes[v as usize]);
        for corner in 0..4 {
            add(
                &mut shares[tet[corner] as usize],
                *region,
                solid_angle(x, corner),
            );
        }
    }
    shares.iter_mut().for_each(normalise);
    shares
}

/// Returns the solid angle of a tet at one of its corners.
fn solid_angle(x: [DVec3; 4], corner: usize) -> f64 {
    let [a, b, c] = [1, 2, 3].map(|k| (x[(corner + k) % 4] - x[corner]).normalize_or_zero());
    let triple = a.dot(b.cross(c)).abs();
    2.0 * triple.atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a)).abs()
}

/// Adds to the share of a region.
pub(super) fn add(shares: &mut Shares, region: u32, share: f64) {
    match shares.binary_search_by_key(&region, |s| s.0) {
        Ok(k) => shares[k].1 += share,
        Err(k) => shares.insert(k, (region, share)),
    }
}

/// Scales shares to the sum 1.
pub(super) fn normalise(shares: &mut Shares) {
    let sum: f64 = shares.iter().map(|s| s.1).sum();
    if sum > 0.0 {
        shares.iter_mut().for_each(|s| s.1 /= sum);
    }
}

/// Returns the share of a region, 0 if it has none.
pub(super) fn share_of(shares: &Shares, region: u32) -> f64 {
    shares
        .binary_search_by_key(&region, |s| s.0)
        .map_or(0.0, |k| shares[k].1)
}

/// Returns the region with the largest share; the first one of equal ones.
pub(super) fn largest(shares: &Shares) -> u32 {
    let best = shares.iter().fold(
        (0, f64::NEG_INFINITY),
        |best, s| if s.1 > best.1 { *s } else { best },
    );
    best.0
}

/// Returns `(1 − share) a + share b`.
pub(super) fn blend((a, b): (&Shares, &Shares), share: f64) -> Shares {
    let mut sum: Shares = a.iter().map(|s| (s.0, (1.0 - share) * s.1)).collect();
    b.iter().for_each(|s| add(&mut sum, s.0, share * s.1));
    sum
}
