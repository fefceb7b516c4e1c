//! The finite elements against their plain float64 form, and what steps of them must keep to.
#![allow(clippy::unwrap_used, clippy::needless_range_loop)]

use super::element_batches::Batch;
use super::element_kernels::PAIRS;
use super::element_term::Tets;
use super::lanes::Lane;
use super::order::Lumps;
use super::pool::Plan;
use super::real::Real;
use super::terms::{At, Share, Term};
use super::tests::{noise, some};
use super::vectors::{V4, apply_symmetric, of_metres};
use crate::mesh::generate;
use crate::physics::elements::eigen;
use crate::physics::{Element, Law, Material, SpringNetwork, Units};
use glam::{DMat3, DVec3};

const LAWS: [Law; 2] = [Law::NeoHookean, Law::Corotated];

/// Tets of some shape and where their corners are: a little off, far off, turned, inverted, nearly
/// flat, and flat.
fn cases(law: Law) -> Vec<(Element, [DVec3; 4])> {
    let mut next = noise(5);
    let mut vector = |size: f64| size * DVec3::new(next(), next(), next());
    let mut all = Vec::new();
    for n in 0..64 {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| 0.3 * p + vector(0.07));
        let e = Element::new([0, 1, 2, 3], corners, 1e4, 0.3, law).unwrap();
        let turn = DMat3::from_axis_angle(vector(1.0).normalize(), 3.0 * f64::from(n % 7));
        // Where two stretches are each other's negative the corotated energy has a ridge.
        let mirrored = if law == Law::Corotated { -0.5 } else { -1.0 };
        let squash = [1.0, 1.0, 0.5, -0.7, 1e-3, -1e-3, 0.0, mirrored][n as usize % 8];
        let shape = DMat3::from_diagonal(DVec3::new(1.0, 1.3, squash));
        let size = [1e-6, 0.01, 0.1, 0.2][n as usize / 16];
        let noise = if squash == 0.0 { 0.0 } else { size };
        all.push((e, corners.map(|p| turn * (shape * p + vector(0.3 * noise)))));
    }
    all
}

/// Four cases as a batch whose rest positions are those of the cases, with displacements.
fn batch<T: Real>(four: &[(Element, [DVec3; 4])]) -> (Batch<T>, Vec<V4<T>>) {
    let mut u = Vec::new();
    let mut gradients = [[[T::ZERO; 4]; 3]; 3];
    let mut lame = [[T::ZERO; 4]; 2];
    for (l, (e, corners)) in four.iter().enumerate() {
        // Rest positions of the tet, but for where it is.
        let edges = e.inverse.inverse();
        for (a, p) in corners.iter().enumerate() {
            let rest = if a > 0 { edges.col(a - 1) } else { DVec3::ZERO };
            let d = *p - corners[0] - rest;
            u.push([d.x, d.y, d.z, 0.0].map(T::of));
        }
        for k in 0..3 {
            for axis in 0..3 {
                gradients[k][axis][l] = T::of(e.gradients()[k + 1][axis]);
            }
        }
        for k in 0..2 {
            lame[k][l] = T::of(e.lame[k] * e.volume);
        }
    }
    let batch = Batch {
        nodes: std::array::from_fn(|l| std::array::from_fn(|a| (4 * l + a) as u32)),
        gradients: gradients.map(|g| g.map(|x| T::lanes(&x))),
        lame: lame.map(|x| T::lanes(&x)),
    };
    (batch, u)
}

fn vector<T: Real>(a: V4<T>) -> DVec3 {
    DVec3::new(a[0].wide(), a[1].wide(), a[2].wide())
}

/// The largest errors of energy, force and exact and projected blocks over their sizes.
fn errors<T: Real>(law: Law, spoil: impl Fn(&mut Element)) -> [f64; 4] {
    let mut worst = [0.0f64; 4];
    for four in cases(law).chunks(4) {
        let (batch, u) = batch::<T>(four);
        let g = batch.gradient(&u);
        let energy = T::array(batch.energy(law, &g));
        let mut forces = vec![[T::ZERO; 4]; 16];
        let (stress, same) = batch.stress(law, &g);
        batch.scatter::<true>(&stress, 0, &mut forces);
        let mut blocks = [[[DMat3::ZERO; 6]; 4]; 2];
        for (projected, blocks) in blocks.iter_mut().enumerate() {
            batch.blocks(law, &g, projected > 0, T::Lanes::of(1.0), |n, tets| {
                for (l, [x, y, z]) in tets.into_iter().enumerate() {
                    blocks[l][n] = DMat3::from_cols(vector(x), vector(y), vector(z));
                }
            });
        }
        for (l, (e, corners)) in four.iter().enumerate() {
            let mut e = *e;
            spoil(&mut e);
            let size = e.volume * e.lame[0];
            let true_energy = e.energy(law, corners);
            let error = (energy[l].wide() - true_energy).abs() / true_energy.abs();
            worst[0] = worst[0].max(error);
            assert!((T::array(same)[l].wide() / energy[l].wide() - 1.0).abs() < 1e-3);
            let plain = e.forces(law, corners);
            let scale: f64 = plain.iter().map(|f| f.length()).sum::<f64>();
            for (a, f) in plain.iter().enumerate() {
                let error = vector(forces[4 * l + a]).distance(*f) / scale;
                worst[1] = worst[1].max(error);
            }
            let plain = [
                e.stiffness(law, corners),
                e.projected_stiffness(law, corners),
            ];
            for (k, plain) in plain.iter().enumerate() {
                let gradient = e.gradients()[1].length();
                for (n, [a, b]) in PAIRS.iter().enumerate() {
                    let d = blocks[k][l][n] - plain[*a][*b];
                    let error = (0..3).map(|c| d.col(c).length()).fold(0.0, f64::max);
                    worst[2 + k] = worst[2 + k].max(error / (size * gradient * gradient));
                }
            }
        }
    }
    worst
}

#[test]
fn kernels_are_the_plain_form() {
    for law in LAWS {
        let wide = errors::<f64>(law, |_| ());
        let narrow = errors::<f32>(law, |_| ());
        println!("{law:?}: f64 {wide:?}, f32 {narrow:?}");
        assert!(wide.iter().all(|e| *e < 1e-9), "{wide:?}");
        assert!(narrow.iter().all(|e| *e < 1e-3), "{narrow:?}");
        let spoiled = errors::<f64>(law, |e| e.lame[0] *= 1.001);
        assert!(spoiled.iter().all(|e| *e > 1e-5), "{spoiled:?}");
    }
}

#[test]
fn the_plain_form_is_the_slope_of_its_energy() {
    for law in LAWS {
        for (e, corners) in cases(law) {
            let size = e.volume * e.lame[0];
            let gradient = e.gradients()[1].length();
            let (forces, stiffness) = (e.forces(law, &corners), e.stiffness(law, &corners));
            for a in 0..4 {
                for axis in 0..3 {
                    let d = 1e-6;
                    let moved = |by: f64| {
                        let mut corners = corners;
                        corners[a][axis] += by;
                        corners
                    };
                    let [up, down] = [moved(d), moved(-d)];
                    let slope = (e.energy(law, &up) - e.energy(law, &down)) / (2.0 * d);
                    let error = (slope + forces[a][axis]).abs();
                    assert!(error < 1e-6 * size * gradient, "{slope} {}", forces[a]);
                    let [fu, fd] = [e.forces(law, &up), e.forces(law, &down)];
                    for b in 0..4 {
                        let slope = (fd[b] - fu[b]) / (2.0 * d);
                        let error = slope.distance(stiffness[b][a].col(axis));
                        assert!(error < 1e-5 * size * gradient * gradient, "{law:?} {error}");
                    }
                }
            }
        }
    }
}

#[test]
fn small_strains_are_hookes() {
    let (young, poisson) = (2e4, 0.37);
    let mu = young / (2.0 * (1.0 + poisson));
    let lambda = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
    for law in LAWS {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let e = Element::new([0, 1, 2, 3], corners, young, poisson, law).unwrap();
        let stiffness = e.stiffness(law, &corners);
        for (a, ga) in e.gradients().iter().enumerate() {
            for (b, gb) in e.gradients().iter().enumerate() {
                let outer = |x: DVec3, y: DVec3| DMat3::from_cols(x * y.x, x * y.y, x * y.z);
                // λ g_a g_bᵀ + μ g_b g_aᵀ + μ g_a·g_b I.
                let hooke = outer(*ga, *gb) * lambda
                    + outer(*gb, *ga) * mu
                    + DMat3::from_diagonal(DVec3::splat(mu * ga.dot(*gb)));
                let difference = stiffness[a][b] - hooke * e.volume;
                assert!(
                    difference.abs_diff_eq(DMat3::ZERO, 1e-9 * young),
                    "{law:?} {difference}"
                );
            }
        }
        assert!(e.energy(law, &corners).abs() < 1e-12 * young);
        assert!(Element::new([0, 1, 2, 3], corners, young, 0.5, law).is_none());
        let flipped = [corners[1], corners[0], corners[2], corners[3]];
        assert!(Element::new([0, 1, 2, 3], flipped, young, poisson, law).is_none());
    }
}

#[test]
fn projected_blocks_lower_no_energy() {
    for law in LAWS {
        for (e, corners) in cases(law) {
            let least = |blocks: [[DMat3; 4]; 4]| {
                let full: [[f64; 12]; 12] = std::array::from_fn(|i| {
                    std::array::from_fn(|j| blocks[i / 3][j / 3].col(j % 3)[i % 3])
                });
                let values = eigen(full).0;
                let largest = values.iter().fold(0.0f64, |a, b| a.max(b.abs()));
                values.into_iter().fold(f64::MAX, f64::min) / largest
            };
            assert!(least(e.projected_stiffness(law, &corners)) > -1e-10);
        }
        let all = cases(law);
        let indefinite = all.iter().filter(|(e, corners)| {
            let [x, y] = [
                e.stiffness(law, corners),
                e.projected_stiffness(law, corners),
            ];
            !x[0][1].abs_diff_eq(y[0][1], 1e-6 * e.lame[0])
        });
        assert!(indefinite.count() > 10);
    }
}

/// A bar, pulled about, of elements with springs along its edges or none.
pub fn bar(cells: [usize; 3], law: Law, springs: bool) -> SpringNetwork {
    let mesh = generate::bar(cells, DVec3::new(0.8, 0.2, 0.2)).unwrap();
    let mut network = SpringNetwork::new(&mesh, &Material::young(1e5)).unwrap();
    if !springs {
        network.springs.clear();
    }
    network.elements.law = law;
    let (tets, rest) = (mesh.tets.iter(), &network.rest);
    let element = |t: &[u32; 4]| Element::new(*t, t.map(|v| rest[v as usize]), 1e6, 0.3, law);
    network.elements.tets = tets.map(|t| element(t).unwrap()).collect();
    network
}

#[test]
fn the_term_is_the_sum_of_plain_tets() {
    for law in LAWS {
        let network = bar([5, 3, 2], law, false);
        let count = network.rest.len();
        let moved: Vec<DVec3> = some(count, 3, 0.02);
        let p = some(count, 4, 1.0);
        let places: Vec<DVec3> = network
            .rest
            .iter()
            .zip(&moved)
            .map(|(x, d)| *x + *d)
            .collect();
        let mut plain = (
            0.0,
            vec![DVec3::ZERO; count],
            [vec![DVec3::ZERO; count], vec![DVec3::ZERO; count]],
        );
        for e in &network.elements.tets {
            let corners = e.nodes.map(|v| places[v as usize]);
            plain.0 += e.energy(law, &corners);
            let blocks = [
                e.stiffness(law, &corners),
                e.projected_stiffness(law, &corners),
            ];
            for (a, f) in e.forces(law, &corners).into_iter().enumerate() {
                plain.1[e.nodes[a] as usize] += f;
                for (product, k) in plain.2.iter_mut().zip(&blocks) {
                    for b in 0..4 {
                        product[e.nodes[a] as usize] += k[a][b] * p[e.nodes[b] as usize];
                    }
                }
            }
        }
        for chunks in [1, 2, 3] {
            let lumps = Lumps::new(&network.rest, 12);
            let plan = Plan::with(lumps.starts, chunks);
            let units = Units::of(&network);
            let local = |v: &[DVec3], unit: f64| -> Vec<V4<f64>> {
                let places = lumps.order.iter();
                places.map(|i| of_metres(v[*i as usize], unit)).collect()
            };
            let (u, q) = (local(&moved, units.length), local(&p, units.length));
            let mut term = Tets::<f64>::new(&network, (&lumps.order, units, &plan), true);
            let mut f = vec![[0.0; 4]; count];
            let sum = |f: &mut [V4<f64>]| -> f64 {
                (0..chunks)
                    .map(|c| term.elastic(c, &u, &mut f[plan.range(c)]))
                    .sum()
            };
            let energy = sum(&mut f) * units.energy();
            let again: f64 = (0..chunks).map(|c| term.energy(c, &u)).sum();
            assert!((energy / plain.0 - 1.0).abs() < 1e-12);
            assert!((again * units.energy() / plain.0 - 1.0).abs() < 1e-12);
            let far = |a: &[V4<f64>], b: &[DVec3], unit: f64| {
                let size = b.iter().map(|b| b.length()).fold(0.0, f64::max);
                let both = a.iter().zip(&lumps.order);
                let off = both.map(|(a, i)| (vector(*a) * unit).distance(b[*i as usize]));
                off.fold(0.0, f64::max) / size
            };
            assert!(far(&f, &plain.1, units.force()) < 1e-12);
            for (projected, product) in plain.2.iter().enumerate() {
                let mut diagonal = vec![[0.0; 8]; count];
                let mut change = vec![[0.0; 4]; count];
                let share = Share {
                    diagonal: &mut diagonal,
                    change: &mut change,
                };
                term.project(projected > 0);
                term.linearise(&plan, At { u: &u, v: &u }, 1.0, share);
                let mut y = vec![[0.0; 4]; count];
                for c in 0..chunks {
                    term.multiply(c, &q, &mut y[plan.range(c)]);
                }
                let error = far(&y, product, units.force());
                assert!(error < 1e-10, "{law:?} {projected} {error}");
                assert!(far(&y, &plain.2[1 - projected], units.force()) > 1e-6);
                // The same from the blocks that it tells.
                let mut z: Vec<V4<f64>> = (0..count)
                    .map(|k| apply_symmetric(&diagonal[k], q[k]))
                    .collect();
                term.pairs(&mut |[i, j], m| {
                    let (i, j) = (i as usize, j as usize);
                    for (to, d) in [(i, *m * vector(q[j])), (j, m.transpose() * vector(q[i]))] {
                        for (z, d) in z[to].iter_mut().zip(d.to_array()) {
                            *z += d;
                        }
                    }
                });
                assert!(far(&z, product, units.force()) < 1e-10);
            }
        }
    }
}
