//! Tests of ten-node tets against their float64 reference.
#![allow(clippy::unwrap_used, clippy::needless_range_loop)]

use super::quadratic_batch::QuadraticBatch;
use super::term::ElementTerm;
use crate::generate;
use crate::mesh::{ElementOrder, TetMesh};
use crate::physics::cpu::aggregation::Aggregates;
use crate::physics::cpu::body::tests::some;
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::{V4, apply_symmetric, from_metres, to_dvec};
use crate::physics::{DiscreteModel, Elements, LocalUnits, Material, MaterialModel};
use glam::{DMat3, DVec3};

const MODELS: [MaterialModel; 2] = [MaterialModel::NeoHookean, MaterialModel::Corotated];

fn material(model: MaterialModel) -> Material {
    Material {
        model,
        order: ElementOrder::Quadratic,
        poisson: 0.45,
        damping_time: 0.3,
        ..Material::from_young(1e5)
    }
}

/// A bar of ten-node tets with straight edges, or with curved ones.
fn bar(curved: bool) -> TetMesh {
    let mesh = generate::bar([3, 2, 1], DVec3::new(0.3, 0.2, 0.1)).unwrap();
    let mut mesh = mesh.with_mid_edge_nodes().unwrap();
    if curved {
        for x in &mut mesh.nodes {
            *x += 0.1 * DVec3::new(x.y * x.z, 2.0 * x.x * x.x, x.x * x.y);
        }
    }
    mesh
}

/// Returns K p of the reference, with exact or projected blocks.
fn product(elements: &Elements, x: &[DVec3], p: &[DVec3], projected: bool) -> Vec<DVec3> {
    let mut out = vec![DVec3::ZERO; x.len()];
    let with = (elements.law, projected);
    for t in 0..elements.tets.len() {
        let nodes = elements.quadratic_nodes(t).unwrap().map(|v| v as usize);
        let shape = elements.quadratic_shape(t).unwrap();
        let strains = shape.deformation_gradients(&nodes.map(|v| x[v]));
        for (point, f) in strains.iter().enumerate() {
            let (gradients, volume) = (&shape.gradients[point], shape.volumes[point]);
            let blocks = elements.tets[t].blocks(with, f, gradients, (volume, 0.0));
            for (a, row) in nodes.into_iter().zip(blocks) {
                for (b, block) in nodes.into_iter().zip(row) {
                    out[a] += block * p[b];
                }
            }
        }
    }
    out
}

fn combined(a: &[DVec3], by: f64, b: &[DVec3]) -> Vec<DVec3> {
    a.iter().zip(b).map(|(a, b)| *a + by * *b).collect()
}

/// The reference: forces are the derivatives of the energy, and the Hessian that of the forces.
#[test]
fn quadratic_reference_is_consistent() {
    for model in MODELS {
        for curved in [false, true] {
            let model = DiscreteModel::new(&bar(curved), &material(model)).unwrap();
            let elements = model.elements().unwrap();
            let count = model.rest_positions.len();
            let x = combined(&model.rest_positions, 1.0, &some(count, 3, 0.004));
            let p = some(count, 4, 1.0);
            let h = 1e-6;
            let [ahead, behind] = [h, -h].map(|h| combined(&x, h, &p));
            let slope = (elements.energy(&ahead) - elements.energy(&behind)) / (2.0 * h);
            let forces = elements.forces(&x);
            let along: f64 = forces.iter().zip(&p).map(|(f, p)| f.dot(*p)).sum();
            assert!((slope / -along - 1.0).abs() < 1e-6, "{slope} {along}");
            let change = combined(&elements.forces(&ahead), -1.0, &elements.forces(&behind));
            let exact = product(elements, &x, &p, false);
            let size = exact.iter().map(|f| f.length()).fold(0.0, f64::max);
            for (change, exact) in change.iter().zip(&exact) {
                assert!((*change / (-2.0 * h)).distance(*exact) < 1e-6 * size);
            }
            let total: DVec3 = forces.iter().sum();
            assert!(total.length() < 1e-10 * size);
        }
    }
}

/// Affine displacements give the energy of the uniform strain on straight and curved elements.
#[test]
fn patch_of_quadratic_tets_has_uniform_strain() {
    let f = DMat3::from_cols(
        DVec3::new(1.1, 0.05, -0.02),
        DVec3::new(-0.03, 0.93, 0.04),
        DVec3::new(0.06, 0.02, 1.04),
    );
    for model in MODELS {
        for curved in [false, true] {
            let model = DiscreteModel::new(&bar(curved), &material(model)).unwrap();
            let elements = model.elements().unwrap();
            let x: Vec<DVec3> = model.rest_positions.iter().map(|x| f * *x).collect();
            let volume: f64 = elements.tets.iter().map(|t| t.volume).sum();
            let density = elements.tets[0].energy_density(elements.law, &f);
            let energy = elements.energy(&x);
            assert!((energy / (volume * density) - 1.0).abs() < 1e-12);
            for t in 0..elements.tets.len() {
                let nodes = elements.quadratic_nodes(t).unwrap();
                let shape = elements.quadratic_shape(t).unwrap();
                let here = nodes.map(|v| x[v as usize]);
                for strain in shape.deformation_gradients(&here) {
                    assert!((strain - f).abs_diff_eq(DMat3::ZERO, 1e-12));
                }
            }
        }
    }
}

/// The engine's term against the reference: energy, forces, damping, Hessian products, diagonal and
/// visited blocks, for several partitions.
fn compare<T: Real>(tolerance: f64) {
    for (material_model, curved) in MODELS.into_iter().flat_map(|m| [(m, false), (m, true)]) {
        let model = DiscreteModel::new(&bar(curved), &material(material_model)).unwrap();
        let elements = model.elements().unwrap();
        let count = model.rest_positions.len();
        let moved = some(count, 3, 0.004);
        let p = some(count, 4, 1.0);
        let x = combined(&model.rest_positions, 1.0, &moved);
        let (energy, forces) = (elements.energy(&x), elements.forces(&x));
        let products = [false, true].map(|projected| product(elements, &x, &p, projected));
        for chunks in [1, 2, 3] {
            let groups = Aggregates::new(&model.rest_positions, 12);
            let plan = Partition::with_chunks(groups.group_starts, chunks);
            let units = LocalUnits::from_model(&model);
            let local = |v: &[DVec3], unit: f64| -> Vec<V4<T>> {
                let order = groups.order.iter();
                order.map(|i| from_metres(v[*i as usize], unit)).collect()
            };
            let error = |a: &[V4<T>], b: &[DVec3], unit: f64| {
                let size = b.iter().map(|b| b.length()).fold(0.0, f64::max);
                let both = a.iter().zip(&groups.order);
                let off = both.map(|(a, i)| (to_dvec(*a) * unit).distance(b[*i as usize]));
                off.fold(0.0, f64::max) / size
            };
            let (u, q) = (local(&moved, units.length), local(&p, units.length));
            let layout = (&groups.order[..], units, &plan);
            let mut term =
                ElementTerm::<T, QuadraticBatch<T>>::new((&model, elements), layout, true);
            let mut f = vec![[T::ZERO; 4]; count];
            let sum: f64 = (0..chunks)
                .map(|c| term.elastic_forces(c, &u, &mut f[plan.range(c)]))
                .sum();
            assert!((sum * units.energy() / energy - 1.0).abs() < tolerance);
            let sum: f64 = (0..chunks).map(|c| term.energy(c, &u)).sum();
            assert!((sum * units.energy() / energy - 1.0).abs() < tolerance);
            assert!(error(&f, &forces, units.force()) < tolerance);
            // A wrong force is found.
            f[count / 2][1] += T::from_f64(forces[0].length().max(1.0));
            assert!(error(&f, &forces, units.force()) > 10.0 * tolerance);
            // Explicit damping; metres of p are metres per second here.
            let mut f = vec![[T::ZERO; 4]; count];
            let w = local(&p, units.velocity());
            for c in 0..chunks {
                term.forces(c, StateRef { u: &u, v: &w }, &mut f[plan.range(c)]);
            }
            let damped = combined(&forces, -model.damping_time, &products[0]);
            assert!(error(&f, &damped, units.force()) < tolerance);
            term.freeze_damping(&plan, &u);
            for (projected, product) in products.iter().enumerate() {
                let mut diagonal = vec![[T::ZERO; 8]; count];
                let mut change = vec![[T::ZERO; 4]; count];
                let share = SystemContribution {
                    diagonal: &mut diagonal,
                    stiffness_velocity: &mut change,
                };
                term.set_psd_projection(projected > 0);
                let h = 0.7;
                let seconds = h * units.time;
                let at = StateRef { u: &u, v: &u };
                term.linearise(&plan, at, T::from_f64(h), share);
                let mut y = vec![[T::ZERO; 4]; count];
                for c in 0..chunks {
                    term.multiply(c, &q, &mut y[plan.range(c)]);
                }
                let unit = units.force() * units.time * units.time;
                let both = combined(product, model.damping_time / seconds, &products[1]);
                let both: Vec<DVec3> = both.iter().map(|x| *x * seconds * seconds).collect();
                let off = error(&y, &both, unit);
                assert!(off < tolerance, "{material_model} {projected} {off}");
                let mut z: Vec<V4<T>> = (0..count)
                    .map(|k| apply_symmetric(&diagonal[k], q[k]))
                    .collect();
                term.visit_off_diagonal(&mut |[i, j], m| {
                    let (i, j) = (i as usize, j as usize);
                    for (to, d) in [(i, *m * to_dvec(q[j])), (j, m.transpose() * to_dvec(q[i]))] {
                        for (z, d) in z[to].iter_mut().zip(d.to_array()) {
                            *z += T::from_f64(d);
                        }
                    }
                });
                assert!(error(&z, &both, unit) < tolerance);
            }
        }
    }
}

#[test]
fn quadratic_term_matches_reference_in_f64() {
    compare::<f64>(1e-10);
}

#[test]
fn quadratic_term_matches_reference_in_f32() {
    compare::<f32>(2e-4);
}
