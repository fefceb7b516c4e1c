//! A stiffness that varies over the body: factors at the nodes of a coarse grid, whose logarithms are
//! interpolated.

use super::lump::LumpElements;
use crate::mesh::{Field, Location};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::BTreeMap;

/// Name of the unknowns, without their numbers.
pub(super) const NAME: &str = "stiffness";
/// Name of the field of stiffness factors.
pub(super) const FACTOR_FIELD: &str = "stiffness_factor";
/// Name of the field of the standard deviations of their logarithms.
pub(super) const SPREAD_FIELD: &str = "stiffness_spread";
/// Largest number of nodes of a grid.
const MAX_NODES: usize = 2_000;
/// Standard deviation before the data of the logarithm of a factor, and of its change from one node of the
/// grid to the next: factors of 5 and of 1.6.
const PRIOR: f64 = 1.6;
const PRIOR_CHANGE: f64 = 0.5;
/// Changes far below this one count by their squares in a piecewise stiffness, others by their length.
const SHARP: f64 = 0.05;

/// How a stiffness may vary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Variation {
    /// Changes count by their squares.
    Smooth,
    /// Changes count by their lengths (total variation: Rudin, Osher, Fatemi 1992), so that few are large.
    Piecewise,
}

/// A grid over a body. Node `n` of it is the unknown `n` of those of the grid.
#[derive(Clone, Debug)]
pub(super) struct StiffnessGrid {
    variation: Variation,
    /// Places of the nodes, in file units.
    pub places: Vec<DVec3>,
    /// Neighbours along the axes.
    pairs: Vec<[usize; 2]>,
    /// Of each element the nodes around it, with weights of sum 1.
    weights: Vec<Vec<(usize, f64)>>,
}

impl StiffnessGrid {
    /// Lays a grid with cells of `spacing` file units over the elements of a body.
    ///
    /// # Errors
    /// [`Error::Input`] for a grid with too many nodes.
    pub fn new(
        elements: &LumpElements,
        (low, high): (DVec3, DVec3),
        (spacing, variation): (f64, Variation),
    ) -> Result<StiffnessGrid> {
        let extent = high - low;
        let cells = (extent / spacing).map(|n| n.ceil().max(1.0));
        let all = (cells + DVec3::ONE).element_product();
        if !(spacing > 0.0 && all <= 64.0 * MAX_NODES as f64) {
            return Err(too_fine(all));
        }
        let size = cells.to_array().map(|n| n as usize + 1);
        // The grid is centred on the body.
        let origin = low - 0.5 * (cells * spacing - extent);
        let mut numbers: BTreeMap<[usize; 3], usize> = BTreeMap::new();
        let mut weights = Vec::new();
        for middle in elements.middles() {
            let along = (*middle - origin) / spacing;
            let cell = [0, 1, 2].map(|k| (along[k].max(0.0) as usize).min(size[k] - 2));
            let mut own = Vec::with_capacity(8);
            for corner in 0..8usize {
                let node = [0, 1, 2].map(|k| cell[k] + ((corner >> k) & 1));
                let weight = (0..3)
                    .map(|k| 1.0 - (along[k] - node[k] as f64).abs())
                    .product::<f64>();
                if weight > 0.0 {
                    let next = numbers.len();
                    own.push((*numbers.entry(node).or_insert(next), weight));
                }
            }
            weights.push(own);
        }
        if numbers.len() > MAX_NODES {
            return Err(too_fine(numbers.len() as f64));
        }
        let mut places = vec![DVec3::ZERO; numbers.len()];
        let mut pairs = Vec::new();
        for (node, number) in &numbers {
            places[*number] = origin + spacing * DVec3::from(node.map(|n| n as f64));
            for axis in 0..3 {
                let mut next = *node;
                next[axis] += 1;
                pairs.extend(numbers.get(&next).map(|other| [*number, *other]));
            }
        }
        Ok(StiffnessGrid {
            variation,
            places,
            pairs,
            weights,
        })
    }

    /// Returns the logarithm of the factor of each element, from those at the nodes.
    pub fn logarithms(&self, at_nodes: &[f64]) -> Vec<f64> {
        let of = |own: &Vec<(usize, f64)>| own.iter().map(|(n, w)| w * at_nodes[*n]).sum();
        self.weights.iter().map(of).collect()
    }

    /// Returns the nodes around an element, with weights: the derivatives of the logarithm of its factor by
    /// theirs.
    pub fn weights_of(&self, element: usize) -> &[(usize, f64)] {
        &self.weights[element]
    }

    /// Returns the field of the factors of all tets, `pieces` an element, times those of the scene.
    pub fn field(&self, at_nodes: &[f64], (own, pieces): (&[f64], usize)) -> Field {
        let logarithms = self.logarithms(at_nodes);
        let values = own.iter().enumerate();
        let values = values.map(|(t, factor)| factor * logarithms[t / pieces].exp());
        Field::scalar(FACTOR_FIELD, Location::Cell, values.collect())
    }

    /// Returns the field of the standard deviations of the logarithms of the factors, by the covariance of
    /// two nodes.
    pub fn spread(&self, pieces: usize, covariance: &dyn Fn(usize, usize) -> f64) -> Field {
        let of = |own: &Vec<(usize, f64)>| {
            let pairs = own
                .iter()
                .flat_map(|(a, x)| own.iter().map(move |(b, y)| (*a, *b, x * y)));
            let variance: f64 = pairs.map(|(a, b, w)| w * covariance(a, b)).sum();
            variance.max(0.0).sqrt()
        };
        let values = self.weights.iter().map(of);
        let values = values.flat_map(|spread| std::iter::repeat_n(spread, pieces));
        Field::scalar(SPREAD_FIELD, Location::Cell, values.collect())
    }

    /// Returns the residuals of what is known before the data, with their derivatives by nodes: each
    /// logarithm, and each change from a node to the next, has mean 0 and a known spread. Their sum of squares is
    /// minus twice the logarithm of the probability.
    pub fn prior(&self, at_nodes: &[f64]) -> Vec<(f64, Vec<(usize, f64)>)> {
        let own = at_nodes.iter().enumerate();
        let own = own.map(|(n, x)| (x / PRIOR, vec![(n, 1.0 / PRIOR)]));
        let changes = self.pairs.iter().map(|[a, b]| {
            let (r, slope) = self.change(at_nodes[*b] - at_nodes[*a]);
            (r, vec![(*a, -slope), (*b, slope)])
        });
        own.chain(changes).collect()
    }

    /// Returns the residual of a change, and its derivative.
    fn change(&self, d: f64) -> (f64, f64) {
        match self.variation {
            Variation::Smooth => (d / PRIOR_CHANGE, 1.0 / PRIOR_CHANGE),
            Variation::Piecewise => {
                // r² = 2 (√(d² + ε²) − ε) / s
                let length = (d * d + SHARP * SHARP).sqrt();
                let r = (2.0 * d * d / (length + SHARP) / PRIOR_CHANGE).sqrt();
                match r > 0.0 {
                    true => (d.signum() * r, d.abs() / (length * r * PRIOR_CHANGE)),
                    false => (0.0, 1.0 / (SHARP * PRIOR_CHANGE).sqrt()),
                }
            }
        }
    }
}

fn too_fine(nodes: f64) -> Error {
    Error::Input(format!(
        "the grid of the stiffness has {nodes} nodes, more than {MAX_NODES}; set larger cells (--unknown stiffness:cage:LENGTH)"
    ))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::generate;

    fn grid(variation: Variation) -> StiffnessGrid {
        let mesh = generate::bar_of_about(900, DVec3::new(0.3, 0.1, 0.1)).unwrap();
        let elements = LumpElements::new(&mesh, None).unwrap();
        StiffnessGrid::new(&elements, mesh.bounds(), (0.06, variation)).unwrap()
    }

    /// Logarithms that are linear in space are so in each element; weights have the sum 1.
    #[test]
    fn linear_logarithms_are_interpolated() {
        let grid = grid(Variation::Smooth);
        assert_eq!(grid.places.len(), 6 * 3 * 3);
        let of = |p: DVec3| 2.0 + p.dot(DVec3::new(3.0, -7.0, 11.0));
        let at_nodes: Vec<f64> = grid.places.iter().map(|p| of(*p)).collect();
        let mesh = generate::bar_of_about(900, DVec3::new(0.3, 0.1, 0.1)).unwrap();
        let elements = LumpElements::new(&mesh, None).unwrap();
        for (found, middle) in grid.logarithms(&at_nodes).iter().zip(elements.middles()) {
            assert!((found - of(*middle)).abs() < 1e-12, "{found}");
        }
    }

    /// Residuals of both priors have the derivatives of differences; a jump costs less than many small
    /// steps only if the squares do not count.
    #[test]
    fn priors_match_differences() {
        for variation in [Variation::Smooth, Variation::Piecewise] {
            let grid = grid(variation);
            let at: Vec<f64> = (0..grid.places.len())
                .map(|n| (n as f64 * 0.7).sin())
                .collect();
            let h = 1e-6;
            for n in 0..at.len() {
                let moved = |by: f64| {
                    let mut other = at.clone();
                    other[n] += by;
                    grid.prior(&other)
                };
                let (up, down) = (moved(h), moved(-h));
                for (k, (_, slopes)) in grid.prior(&at).iter().enumerate() {
                    let wanted = (up[k].0 - down[k].0) / (2.0 * h);
                    let own = slopes.iter().filter(|(m, _)| *m == n);
                    let found: f64 = own.map(|(_, s)| s).sum();
                    assert!(
                        (found - wanted).abs() < 1e-6 * (1.0 + wanted.abs()),
                        "{found} {wanted}"
                    );
                }
            }
            let cost = |steps: &[f64]| steps.iter().map(|d| grid.change(*d).0.powi(2)).sum::<f64>();
            let (jump, ramp) = (cost(&[1.0]), cost(&[0.25; 4]));
            assert_eq!(
                jump > 1.5 * ramp,
                variation == Variation::Smooth,
                "{jump} {ramp}"
            );
            let (at_zero, near) = (grid.change(0.0).1, grid.change(1e-9).1);
            assert!((at_zero / near - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn grids_too_fine_are_refused() {
        let mesh = generate::bar_of_about(900, DVec3::new(0.3, 0.1, 0.1)).unwrap();
        let elements = LumpElements::new(&mesh, None).unwrap();
        for spacing in [1e-9, 1e-4, 0.0, f64::NAN] {
            let found = StiffnessGrid::new(&elements, mesh.bounds(), (spacing, Variation::Smooth));
            assert!(found.unwrap_err().to_string().contains("larger cells"));
        }
    }
}
