//! Derivatives of the stiffness-proportional damping of elements: of y·D(u) w, D = β K⁺, by the
//! displacements u and by the material, where K⁺ is the projected Hessian.
//!
//! They are central differences within each element, exact to about 1e-8 of the damping forces away
//! from states where an eigenvalue of an element changes its sign.

use super::batch::TetBatch;
use super::element_batch::{Counted, ElementBatch, ElementSources};
use super::quadratic_batch::QuadraticBatch;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{V4, sub, to_dvec, zero};
use crate::physics::{DiscreteModel, Elements, LocalUnits};
use glam::{DMat3, DVec3};

/// Steps of the differences: by positions over the size of the element, by the Lamé parameters over
/// μ. So small that hardly an eigenvalue changes its sign within a step.
const POSITION_STEP: f64 = 1e-7;
const MATERIAL_STEP: f64 = 1e-7;

/// Derivatives of y·D(u) w.
#[derive(Clone, Debug, Default)]
pub(in crate::physics::cpu) struct DampingDerivatives {
    /// By the displacement of every slot, local units.
    pub by_position: Vec<V4<f64>>,
    /// By the Lamé parameters of every element as they enter the energy, Pa.
    pub by_lame: Vec<[f64; 2]>,
}

/// Returns the derivatives of y·D(u) w for the elements of `model`, whose node `v` is the engine's
/// `engine_index[v]`. Elements with averaged nodal volumes have none.
pub(in crate::physics::cpu) fn damping_derivatives(
    model: &DiscreteModel,
    (engine_index, units): (&[u32], &LocalUnits),
    vectors: [&[V4<f64>]; 3],
) -> DampingDerivatives {
    let mut found = DampingDerivatives {
        by_position: vec![zero(); vectors[0].len()],
        by_lame: Vec::new(),
    };
    let Some(elements) = model.elements() else {
        return found;
    };
    found.by_lame = vec![[0.0; 2]; elements.tets.len()];
    let damping = model.damping_time / units.time;
    let sources = ElementSources {
        elements,
        units,
        engine_index,
    };
    match elements.order() {
        1 => add_batches::<TetBatch<f64>>(&sources, damping, vectors, &mut found),
        _ => add_batches::<QuadraticBatch<f64>>(&sources, damping, vectors, &mut found),
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

fn add_batches<B: ElementBatch<f64>>(
    sources: &ElementSources<'_>,
    damping: f64,
    vectors: [&[V4<f64>]; 3],
    found: &mut DampingDerivatives,
) {
    let elements = sources.elements;
    let changed = [0, 1]
        .map(|k| [MATERIAL_STEP, -MATERIAL_STEP].map(|by| with_changed_lame(elements, k, by)));
    for four in B::sorted(sources).chunks(4) {
        let nodes: Vec<&[u32]> = four.iter().map(B::nodes).collect();
        let count = nodes[0].len();
        // Elements of a batch may share nodes, which are apart in local arrays.
        let mut local = vectors.map(|all| {
            let own = nodes
                .iter()
                .flat_map(|n| n.iter().map(|v| all[*v as usize]));
            own.collect::<Vec<_>>()
        });
        let own: Vec<Counted<B::Item>> = four
            .iter()
            .enumerate()
            .map(|(l, item)| (B::renumbered(item, (l * count) as u32), true))
            .collect();
        let batch = B::new(&own, sources, 0);
        let law = elements.law;
        let work = |batch: &B, [u, y, w]: &[Vec<V4<f64>>; 3]| {
            damping_work(batch, law, damping, (count, own.len()), [u, y, w])
        };
        for (k, changed) in changed.iter().enumerate() {
            let [up, down] = changed.each_ref().map(|elements| {
                let changed = ElementSources {
                    elements,
                    ..*sources
                };
                work(&B::new(&own, &changed, 0), &local)
            });
            for (l, (item, _)) in own.iter().enumerate() {
                let t = B::element(item);
                let step = MATERIAL_STEP * elements.tets[t].lame_parameters[0];
                found.by_lame[t][k] += (up[l] - down[l]) / (2.0 * step);
            }
        }
        let steps: Vec<f64> = own
            .iter()
            .map(|(item, _)| {
                let volume = elements.tets[B::element(item)].volume;
                POSITION_STEP * volume.cbrt() / sources.units.length
            })
            .collect();
        for (k, axis) in (0..count).flat_map(|k| (0..3).map(move |axis| (k, axis))) {
            let mut at = |by: f64| {
                let before = local[0].clone();
                for (l, h) in steps.iter().enumerate() {
                    local[0][l * count + k][axis] += by * h;
                }
                let work = work(&batch, &local);
                local[0] = before;
                work
            };
            let (up, down) = (at(1.0), at(-1.0));
            for (l, nodes) in nodes.iter().enumerate() {
                let slope = (up[l] - down[l]) / (2.0 * steps[l]);
                found.by_position[nodes[k] as usize][axis] += slope;
            }
        }
    }
}

/// Returns y·D(u) w of the `used` elements of a batch with `count` nodes each.
fn damping_work<B: ElementBatch<f64>>(
    batch: &B,
    law: crate::physics::ConstitutiveModel,
    damping: f64,
    (count, used): (usize, usize),
    [u, y, w]: [&[V4<f64>]; 3],
) -> [f64; 4] {
    let mut sum = [0.0; 4];
    let none = <f64 as Real>::Lanes::splat(0.0);
    let scale = <f64 as Real>::Lanes::splat(damping);
    batch.blocks((law, true), u, none, scale, |n, blocks| {
        let [a, b] = B::PAIRS[n];
        for (l, columns) in blocks.iter().enumerate().take(used) {
            let [i, j] = [a, b].map(|k| l * count + k);
            let block = DMat3::from_cols_array_2d(&columns.map(|c| [c[0], c[1], c[2]]));
            // The rows sum to zero, and the blocks below the diagonal are transposes.
            let apart: DVec3 = to_dvec(sub(w[j], w[i]));
            sum[l] +=
                to_dvec(y[i]).dot(block * apart) - to_dvec(y[j]).dot(block.transpose() * apart);
        }
    });
    sum
}
