//! What the mesher fills: space divided into regions.

use glam::DVec3;

/// Space divided into regions 1, 2, … and the outside, 0.
///
/// Each region has a weight at every point, which changes continuously; a point belongs to the
/// region of the largest weight (the lowest region where several are equal). Regions stay below
/// `u16::MAX`.
pub trait Domain: Sync {
    /// A box beyond which everything is outside: (lower corner, upper corner).
    fn bounds(&self) -> (DVec3, DVec3);

    /// Empties `weights` and fills it with (region, weight) at `p`, in no particular order. A
    /// region that is not named has the weight 0.
    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>);

    /// The one region that all of the closed box from `low` to `high` belongs to; none where
    /// there are several, or where that is not known cheaply. What this says decides how coarse
    /// the lattice may be, so that a domain that never knows is filled evenly.
    fn uniform(&self, low: DVec3, high: DVec3) -> Option<u16> {
        let _ = (low, high);
        None
    }

    /// What is known of the true volumes of regions 1, 2, …: all of them, or nothing.
    ///
    /// Flat tets between nodes on a curved boundary hold too little or too much, and smoothing
    /// shrinks what is round. Where the true volumes are known, weights are raised or lowered a
    /// little so that the mesh has them.
    fn volumes(&self) -> Vec<RegionVolume> {
        Vec::new()
    }
}

/// The true volume of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionVolume {
    /// The volume.
    pub volume: f64,
    /// About how much the region grows when 1 is added to its weight everywhere.
    pub area: f64,
}

/// A domain, and what is added to the weights of its regions.
#[derive(Clone, Copy)]
pub(super) struct OffsetDomain<'a> {
    pub domain: &'a dyn Domain,
    /// For regions 1, 2, …; nothing where it is not given.
    pub added: &'a [f64],
}

/// A domain with room for the weights at one point: one for each thread.
pub(super) struct Sampler<'a> {
    domain: &'a dyn Domain,
    /// What is added to the weights of regions 1, 2, …, where it is given.
    added: &'a [f64],
    weights: Vec<(u16, f64)>,
}

impl<'a> Sampler<'a> {
    pub(super) fn new(weighed: OffsetDomain<'a>) -> Sampler<'a> {
        Sampler {
            domain: weighed.domain,
            added: weighed.added,
            weights: Vec::new(),
        }
    }

    /// The region `p` belongs to.
    pub(super) fn region(&mut self, p: DVec3) -> u16 {
        self.at(p);
        self.heaviest()
    }

    /// The region `p` belongs to, and the weights there.
    pub(super) fn region_and_weights(&mut self, p: DVec3) -> (u16, Box<[(u16, f64)]>) {
        let region = self.region(p);
        (region, self.weights.as_slice().into())
    }

    /// By how much the weight of `a` exceeds that of `b` where the weights are `known`.
    pub(super) fn excess_of(&self, known: &[(u16, f64)], a: u16, b: u16) -> f64 {
        self.weight_in(known, a) - self.weight_in(known, b)
    }

    fn at(&mut self, p: DVec3) {
        self.domain.weights(p, &mut self.weights);
    }

    fn heaviest(&self) -> u16 {
        let outside = self.weight(0);
        let mut best = (0, outside);
        for &(region, weight) in &self.weights {
            let weight = weight + self.added(region);
            if weight > best.1 || (weight == best.1 && region < best.0) {
                best = (region, weight);
            }
        }
        best.0
    }

    /// The weights of `regions` at `p`.
    pub(super) fn weights_of<const N: usize>(&mut self, p: DVec3, regions: [u16; N]) -> [f64; N] {
        self.at(p);
        regions.map(|r| self.weight(r))
    }

    /// By how much the weight of `a` exceeds that of `b` at `p`.
    pub(super) fn weight_difference(&mut self, p: DVec3, a: u16, b: u16) -> f64 {
        let [a, b] = self.weights_of(p, [a, b]);
        a - b
    }

    fn weight(&self, region: u16) -> f64 {
        self.weight_in(&self.weights, region)
    }

    fn weight_in(&self, weights: &[(u16, f64)], region: u16) -> f64 {
        let named = weights.iter().find(|w| w.0 == region);
        named.map_or(0.0, |w| w.1) + self.added(region)
    }

    fn added(&self, region: u16) -> f64 {
        let place = usize::from(region).checked_sub(1);
        place
            .and_then(|r| self.added.get(r))
            .copied()
            .unwrap_or(0.0)
    }
}
