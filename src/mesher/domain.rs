//! Domains to be meshed: space divided into regions.

use glam::DVec3;

/// Space divided into regions 1, 2, … and the outside, 0.
///
/// Each region has a weight at every point, which is a continuous function; a point belongs to the
/// region of the largest weight (the lowest region among equals). Region numbers are less than
/// `u16::MAX`.
pub trait Domain: Sync {
    /// Returns a bounding box of all regions: (lower corner, upper corner).
    fn bounds(&self) -> (DVec3, DVec3);

    /// Clears `weights` and fills it with (region, weight) at `p`, in any order. Missing regions
    /// have weight 0.
    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>);

    /// Returns the single region that contains the closed box from `low` to `high`; `None` if there
    /// are several, or if the test is expensive. The result determines how coarse the lattice may
    /// be: without it the domain is meshed uniformly.
    fn uniform(&self, low: DVec3, high: DVec3) -> Option<u16> {
        let _ = (low, high);
        None
    }

    /// Returns the true volumes of regions 1, 2, …, or an empty list if they are unknown.
    ///
    /// Linear tets between nodes on a curved boundary enclose too small or too large a volume, and
    /// smoothing shrinks convex shapes. If the true volumes are known, the weights are offset
    /// slightly so that the mesh reproduces them.
    fn volumes(&self) -> Vec<RegionVolume> {
        Vec::new()
    }

    /// Returns an edge length at which every part of every region has tets, if there is one that is
    /// known.
    fn resolving_edge(&self) -> Option<f64> {
        None
    }
}

/// The true volume of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionVolume {
    /// The volume.
    pub volume: f64,
    /// Approximate derivative of the volume of the region with respect to a uniform offset of its
    /// weight.
    pub area: f64,
}

/// A domain with offsets added to the weights of its regions.
#[derive(Clone, Copy)]
pub(super) struct OffsetDomain<'a> {
    pub domain: &'a dyn Domain,
    /// The offsets of regions 1, 2, …; 0 where missing.
    pub added: &'a [f64],
}

/// A domain with a buffer for the weights at a point, one per thread.
pub(super) struct Sampler<'a> {
    domain: &'a dyn Domain,
    /// The offsets of the weights of regions 1, 2, …, where given.
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

    /// Returns the region of `p`.
    pub(super) fn region(&mut self, p: DVec3) -> u16 {
        self.at(p);
        self.heaviest()
    }

    /// Returns the region of `p` and the weights there.
    pub(super) fn region_and_weights(&mut self, p: DVec3) -> (u16, Box<[(u16, f64)]>) {
        let region = self.region(p);
        (region, self.weights.as_slice().into())
    }

    /// Returns the weight of `a` minus that of `b` for the weights `known`.
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

    /// Returns the weights of `regions` at `p`.
    pub(super) fn weights_of<const N: usize>(&mut self, p: DVec3, regions: [u16; N]) -> [f64; N] {
        self.at(p);
        regions.map(|r| self.weight(r))
    }

    /// Returns the weight of `a` minus that of `b` at `p`.
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
