//! Derivatives of the stiffness-proportional damping of elements: of y·D(u) w, D = β K⁺, by the
//! displacements u and by the material, where K⁺ is the projected Hessian.
//!
//! They are central differences within each element, exact to about 1e-8 of the damping forces away
//! from states where an eigenvalue of an element changes its sign.

use super::batch::TetBatch;
use super::element_batch::{Counted, ElementBatch, ElementSources};
use super::quadratic_batch::QuadraticBatch;
use crate::parallel;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{V4, add, outer, sub, to_dvec, to_v4, zero};
use crate::physics::{DiscreteModel, Elements, LocalUnits};
use glam::DVec3;

/// Steps of the differences: by positions over the size of the element, by the Lamé parameters over
/// μ. So small that hardly an eigenvalue changes its sign within a step.
const POSITION_STEP: f64 = 1e-7;
const MATERIAL_STEP: f64 = 1e-7;

/// A vector of every slot, or of the nodes of a batch.
type Vectors<'a> = &'a [V4<f64>];

/// Derivatives of y·D(u) w.
#[derive(Clone, Debug, Default)]
pub(in crate::physics::cpu) struct DampingDerivatives {
    /// By the displacement of every slot, local units.
    pub by_position: Vec<V4<f64>>,
    /// By the Lamé parameters of every element as they enter the energy, Pa.
    pub by_lame: Vec<[f64; 2]>,
}

/// Returns the derivatives of y·D(u) w, with `at` = [u, w], for each y and the elements of `model`, whose node
/// `v` is the engine's `engine_index[v]`. Elements with averaged nodal volumes have none.
pub(in crate::physics::cpu) fn damping_derivatives(
    model: &DiscreteModel,
    (engine_index, units): (&[u32], &LocalUnits),
    at: [Vectors<'_>; 2],
    all: &[Vectors<'_>],
) -> Vec<DampingDerivatives> {
    let count = model.elements().map_or(0, |elements| elements.tets.len());
    let none = || DampingDerivatives {
        by_position: vec![zero(); at[0].len()],
        by_lame: vec![[0.0; 2]; count],
    };
    let mut found: Vec<DampingDerivatives> = all.iter().map(|_| none()).collect();
    let Some(elements) = model.elements() else {
        return found;
    };
    let damping = model.damping_time / units.time;
    let sources = ElementSources {
        elements,
        units,
        engine_index,
    };
    match elements.order() {
        1 => add_batches::<TetBatch<f64>>(&sources, damping, (at, all), &mut found),
        _ => add_batches::<QuadraticBatch<f64>>(&sources, damping, (at, all), &mut found),
    }
    found
}

/// Returns `elements` with one Lamé parameter changed by `by` times μ.
fn with_changed_lame(elements: &Elements, k: usize, by: f64) -> Elements {
    let mut changed = elements.clone();
    for element in &mut changed.tets {
        element.lame_parameters[k] += by * element.lame_parameters[0];
    }
    changed
}

/// Derivatives of one y of up to four elements.
#[derive(Clone, Default)]
struct FourDerivatives {
    /// By the positions of the nodes of each element.
    by_position: Vec<DVec3>,
    by_lame: [[f64; 2]; 4],
}

fn add_batches<B: ElementBatch<f64>>(
    sources: &ElementSources<'_>,
    damping: f64,
    (at, all): ([Vectors<'_>; 2], &[Vectors<'_>]),
    found: &mut [DampingDerivatives],
) where
    B::Item: Send + Sync,
{
    let elements = sources.elements;
    let changed = [0, 1]
        .map(|k| [MATERIAL_STEP, -MATERIAL_STEP].map(|by| with_changed_lame(elements, k, by)));
    let sorted = B::sorted(sources);
    let batches: Vec<&[B::Item]> = sorted.chunks(4).collect();
    let of_batches = parallel::map_coarse(batches.len(), |n| {
        of_four::<B>(batches[n], (sources, damping, &changed), at, all)
    });
    for (four, of_four) in batches.iter().zip(of_batches) {
        for (found, own) in found.iter_mut().zip(of_four) {
            let nodes = four.iter().flat_map(|item| B::nodes(item));
            for (v, g) in nodes.zip(own.by_position) {
                let to = &mut found.by_position[*v as usize];
                *to = add(*to, to_v4(g));
            }
            for (item, lame) in four.iter().zip(own.by_lame) {
                found.by_lame[B::element(item)] = lame;
            }
        }
    }
}

/// Returns the derivatives of each y of `all` for up to four elements.
fn of_four<B: ElementBatch<f64>>(
    four: &[B::Item],
    (sources, damping, changed): (&ElementSources<'_>, f64, &[[Elements; 2]; 2]),
    at: [Vectors<'_>; 2],
    all: &[Vectors<'_>],
) -> Vec<FourDerivatives> {
    let elements = sources.elements;
    let nodes: Vec<&[u32]> = four.iter().map(B::nodes).collect();
    let count = nodes[0].len();
    // Elements of a batch may share nodes, which are apart in local arrays.
    let local = |all: &[V4<f64>]| -> Vec<V4<f64>> {
        let own = nodes
            .iter()
            .flat_map(|n| n.iter().map(|v| all[*v as usize]));
        own.collect()
    };
    let [mut u, w] = at.map(local);
    let size = (count, four.len());
    let weights = all.iter().map(|y| pair_weights::<B>(size, [&local(y), &w]));
    let weights: Vec<Vec<PairWeights>> = weights.collect();
    let own: Vec<Counted<B::Item>> = four
        .iter()
        .enumerate()
        .map(|(l, item)| (B::renumbered(item, (l * count) as u32), true))
        .collect();
    let batch = B::new(&own, sources, 0);
    let work =
        |batch: &B, u: &[V4<f64>]| damping_work(batch, (elements.law, damping), (u, &weights));
    let mut found = vec![
        FourDerivatives {
            by_position: vec![DVec3::ZERO; count * own.len()],
            ..FourDerivatives::default()
        };
        all.len()
    ];
    for (k, changed) in changed.iter().enumerate() {
        let [up, down] = changed.each_ref().map(|elements| {
            let changed = ElementSources {
                elements,
                ..*sources
            };
            work(&B::new(&own, &changed, 0), &u)
        });
        for (l, (item, _)) in own.iter().enumerate() {
            let step = MATERIAL_STEP * elements.tets[B::element(item)].lame_parameters[0];
            for (found, (up, down)) in found.iter_mut().zip(up.iter().zip(&down)) {
                found.by_lame[l][k] = (up[l] - down[l]) / (2.0 * step);
            }
        }
    }
    let steps: Vec<f64> = own
        .iter()
        .map(|(item, _)| {
            let volume = elements.tets[B::element(item)].volume;
            POSITION_STEP * volume.cbrt() / sources.units.length
        })
        .collect();
    // A translation changes nothing, so that the last node has what the others lack.
    for (k, axis) in (0..count - 1).flat_map(|k| (0..3).map(move |axis| (k, axis))) {
        let before = u.clone();
        let mut moved = |by: f64| {
            for (l, h) in steps.iter().enumerate() {
                u[l * count + k][axis] = before[l * count + k][axis] + by * h;
            }
            work(&batch, &u)
        };
        let (up, down) = (moved(1.0), moved(-1.0));
        u = before;
        for (found, (up, down)) in found.iter_mut().zip(up.iter().zip(&down)) {
            for (l, step) in steps.iter().enumerate() {
                let slope = (up[l] - down[l]) / (2.0 * step);
                found.by_position[l * count + k][axis] += slope;
                found.by_position[l * count + count - 1][axis] -= slope;
            }
        }
    }
    found
}

/// Weights of the blocks of each pair of nodes in y·D(u) w, for four elements.
type PairWeights = [[[f64; 3]; 3]; 4];

/// Returns the weights of the blocks of a batch whose elements have `count` nodes each.
fn pair_weights<B: ElementBatch<f64>>(
    (count, used): (usize, usize),
    [y, w]: [Vectors<'_>; 2],
) -> Vec<PairWeights> {
    let of_pair = |[a, b]: &[usize; 2]| {
        let mut weights = [[[0.0; 3]; 3]; 4];
        for (l, weights) in weights.iter_mut().enumerate().take(used) {
            let [i, j] = [a, b].map(|k| l * count + k);
            // The rows sum to zero, and the blocks below the diagonal are transposes.
            let apart = to_dvec(sub(w[j], w[i]));
            let block = outer(to_dvec(y[i]), apart) - outer(apart, to_dvec(y[j]));
            *weights = block.to_cols_array_2d();
        }
        weights
    };
    B::PAIRS.iter().map(of_pair).collect()
}

/// Returns y·D(u) w of the elements of a batch, for the weights of each y.
fn damping_work<B: ElementBatch<f64>>(
    batch: &B,
    (law, damping): (crate::physics::ConstitutiveModel, f64),
    (u, all): (Vectors<'_>, &[Vec<PairWeights>]),
) -> Vec<[f64; 4]> {
    let mut sums = vec![[0.0; 4]; all.len()];
    let none = <f64 as Real>::Lanes::splat(0.0);
    let scale = <f64 as Real>::Lanes::splat(damping);
    batch.blocks((law, true), u, none, scale, |n, blocks| {
        for (sums, weights) in sums.iter_mut().zip(all) {
            let each = sums.iter_mut().zip(&weights[n]).zip(&blocks);
            for ((sum, weights), columns) in each {
                for (weights, column) in weights.iter().zip(columns) {
                    let products = weights.iter().zip(column);
                    *sum += products.map(|(weight, x)| weight * x).sum::<f64>();
                }
            }
        }
    });
    sums
}
