//! Intersections of the region boundaries with the edges of the lattice, and snapping of lattice
//! points to them.

use super::domain::{OffsetDomain, Sampler};
use super::lattice::LatticeMesh;
use crate::Result;
use crate::mesh::{TET_EDGES, signed_volume};
use crate::parallel;
use crate::progress::ProgressScope;
use glam::DVec3;
use rayon::slice::ParallelSliceMut;

/// A point is snapped if a long edge (along an axis) is cut within this fraction of its length.
const SNAP_LONG: f64 = 0.24999;

/// The fraction for a short edge, which runs from a corner to the centre of a leaf.
const SNAP_SHORT: f64 = 0.41189;

/// Tolerance of a cut: the weights of the two sides differ by this fraction of their difference at
/// the ends.
const ROOT_TOLERANCE: f64 = 1e-7;

/// Smallest volume of a lattice tet with snapped points, relative to that before.
const LEAST_VOLUME: f64 = 0.05;

/// In place of a region: the point has been snapped to a boundary and touches every region.
pub(super) const ON_BOUNDARY: u16 = u16::MAX;

/// The lattice with its points assigned to regions and its edges cut.
pub(super) struct CutLattice {
    /// The region of each point, or [`ON_BOUNDARY`].
    pub region: Vec<u16>,
    /// The points, snapped ones at their positions on the boundary.
    pub positions: Vec<DVec3>,
    /// The two regions at each point on a boundary, the lower first.
    pub sides: Vec<[u16; 2]>,
    /// The cut edges whose ends were not snapped, (smaller, larger) point, sorted.
    pub edges: Vec<[u32; 2]>,
    /// The positions of the cuts.
    pub cuts: Vec<DVec3>,
    /// Number of snapped points.
    pub snapped: usize,
}

/// The points of the lattice before it is cut.
pub(super) struct SampledLattice {
    /// The region of each point.
    pub region: Vec<u16>,
    /// The weights there; empty if the region is known without them.
    weights: Vec<Box<[(u16, f64)]>>,
}

impl SampledLattice {
    pub(super) fn new(
        domain: OffsetDomain,
        lattice: &LatticeMesh,
        part: &ProgressScope,
    ) -> Result<SampledLattice> {
        let sampled = parallel::collect(lattice.positions.len(), |range, sampled| {
            if !part.should_continue() {
                return;
            }
            let mut sampler = Sampler::new(domain);
            sampled.extend(range.map(|p| match lattice.known[p] {
                Some(region) => (region, Box::default()),
                None => sampler.region_and_weights(lattice.positions[p]),
            }));
        });
        part.check_cancelled()?;
        let (region, weights) = sampled.into_iter().unzip();
        Ok(SampledLattice { region, weights })
    }
}

impl CutLattice {
    pub(super) fn new(
        domain: OffsetDomain,
        lattice: &LatticeMesh,
        points: SampledLattice,
        part: &ProgressScope,
    ) -> Result<CutLattice> {
        let SampledLattice { region, weights } = points;
        let mut edges = parallel::collect(lattice.tets.len(), |range, edges| {
            for tet in &lattice.tets[range] {
                edges.extend(TET_EDGES.into_iter().filter_map(|[i, j]| {
                    let (a, b) = (tet[i], tet[j]);
                    let cut = region[a as usize] != region[b as usize];
                    cut.then_some([a.min(b), a.max(b)])
                }));
            }
        });
        edges.par_sort_unstable();
        edges.dedup();
        let cuts = parallel::collect(edges.len(), |range, cuts| {
            if !part.should_continue() {
                return;
            }
            let mut sampler = Sampler::new(domain);
            for edge in &edges[range] {
                let points = edge.map(|p| lattice.positions[p as usize]);
                let [a, b] = edge.map(|p| region[p as usize]);
                let mut excess = |end: usize| match &*weights[edge[end] as usize] {
                    [] => sampler.weight_difference(points[end], a, b),
                    known => sampler.excess_of(known, a, b),
                };
                let ends = [excess(0), excess(1)];
                cuts.push(crossing(&mut sampler, points, [a, b], ends));
            }
        });
        part.check_cancelled()?;
        let mut whole = CutLattice {
            sides: vec![[0; 2]; region.len()],
            region,
            positions: lattice.positions.clone(),
            edges: Vec::new(),
            cuts: Vec::new(),
            snapped: 0,
        };
        let regions = whole.region.clone();
        whole.snap(lattice, &edges, &cuts);
        if lattice.has_unequal_leaves_at_boundaries {
            whole.keep_orientations(lattice, &regions);
        }
        for (edge, t) in edges.iter().zip(&cuts) {
            if edge
                .iter()
                .all(|p| whole.region[*p as usize] != ON_BOUNDARY)
            {
                let [a, b] = edge.map(|p| lattice.positions[p as usize]);
                whole.edges.push(*edge);
                whole.cuts.push(a.lerp(b, *t));
            }
        }
        Ok(whole)
    }

    /// Moves snapped points of lattice tets that they invert or flatten back, into their `regions`: tets
    /// between equal leaves keep their shape, those between leaves of different sizes may not.
    fn keep_orientations(&mut self, lattice: &LatticeMesh, regions: &[u16]) {
        let volume =
            |positions: &[DVec3], tet: &[u32; 4]| signed_volume(tet.map(|p| positions[p as usize]));
        loop {
            let flattened = parallel::collect(lattice.tets.len(), |range, flattened| {
                flattened.extend(lattice.tets[range].iter().copied().filter(|tet| {
                    let is_snapped = |p: &u32| self.region[*p as usize] == ON_BOUNDARY;
                    let before = volume(&lattice.positions, tet);
                    let now = volume(&self.positions, tet) * before.signum();
                    tet.iter().any(is_snapped) && now < LEAST_VOLUME * before.abs()
                }));
            });
            let mut is_any_moved = false;
            for tet in flattened {
                // The one that was moved farthest; the others may be next, and cuts close to points that
                // are not snapped give small tets.
                let moved = |p: &u32| {
                    let p = *p as usize;
                    self.positions[p].distance_squared(lattice.positions[p])
                };
                let snapped = tet
                    .iter()
                    .filter(|p| self.region[**p as usize] == ON_BOUNDARY);
                let Some(p) = snapped.max_by(|a, b| moved(a).total_cmp(&moved(b))) else {
                    continue;
                };
                let p = *p as usize;
                self.region[p] = regions[p];
                self.positions[p] = lattice.positions[p];
                self.sides[p] = [0; 2];
                self.snapped -= 1;
                is_any_moved = true;
            }
            if !is_any_moved {
                return;
            }
        }
    }

    /// Snaps every point with a nearby cut to the nearest one.
    fn snap(&mut self, lattice: &LatticeMesh, edges: &[[u32; 2]], cuts: &[f64]) {
        let mut nearest = vec![(f64::INFINITY, u32::MAX); lattice.positions.len()];
        for (e, (edge, &t)) in edges.iter().zip(cuts).enumerate() {
            let length = edge.map(|p| lattice.positions[p as usize]);
            let length = length[0].distance(length[1]);
            let limit = match lattice.is_long(edge[0], edge[1]) {
                true => SNAP_LONG,
                false => SNAP_SHORT,
            };
            for (point, part) in [(edge[0], t), (edge[1], 1.0 - t)] {
                let best = &mut nearest[point as usize];
                if part < limit && part * length < best.0 {
                    *best = (part * length, e as u32);
                }
            }
        }
        let regions = self.region.clone();
        for (p, (_, e)) in nearest.into_iter().enumerate() {
            let Some(edge) = edges.get(e as usize) else {
                continue;
            };
            let [a, b] = edge.map(|p| lattice.positions[p as usize]);
            self.positions[p] = a.lerp(b, cuts[e as usize]);
            let [r, s] = edge.map(|p| regions[p as usize]);
            self.sides[p] = [r.min(s), r.max(s)];
            self.region[p] = ON_BOUNDARY;
            self.snapped += 1;
        }
    }
}

/// Returns the point of an edge at which the regions of its two ends have equal weights, as a
/// fraction from the first end; `f_low` and `f_high` are the weight differences, first minus
/// second, at the ends.
fn crossing(
    sampler: &mut Sampler,
    [from, to]: [DVec3; 2],
    [a, b]: [u16; 2],
    [mut f_low, mut f_high]: [f64; 2],
) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    match (f_low > 0.0, f_high < 0.0) {
        (true, true) => {}
        (true, false) => return 1.0,
        (false, true) => return 0.0,
        (false, false) => return 0.5,
    }
    let least = ROOT_TOLERANCE * (f_low - f_high);
    let (mut t, mut moved_last) = (0.5, None);
    // False position, Illinois variant; three to five iterations for smooth functions.
    for _ in 0..12 {
        t = (low * f_high - high * f_low) / (f_high - f_low);
        if !(t > low && t < high) {
            t = 0.5 * (low + high);
        }
        let f = sampler.weight_difference(from.lerp(to, t), a, b);
        if f.abs() <= least || high - low < 1e-9 {
            break;
        }
        // Illinois rule: halves the value at an end that was kept twice.
        if f > 0.0 {
            (low, f_low) = (t, f);
            f_high *= if moved_last == Some(true) { 0.5 } else { 1.0 };
        } else {
            (high, f_high) = (t, f);
            f_low *= if moved_last == Some(false) { 0.5 } else { 1.0 };
        }
        moved_last = Some(f > 0.0);
    }
    t
}
