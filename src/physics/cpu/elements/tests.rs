//! Tests of the finite elements against their float64 reference, and of invariants of their steps.
#![allow(clippy::unwrap_used, clippy::needless_range_loop)]

use super::batch::{TetBatch, TetPoint};
use super::kernels::{NODE_PAIRS, unpack_blocks};
use super::term::ElementTerm;
use crate::generate;
use crate::physics::cpu::aggregation::Aggregates;
use crate::physics::cpu::body::tests::{noise, some};
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::simd::Lane;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::{V4, apply_symmetric, from_metres, outer};
use crate::physics::model::elements::eigen;
use crate::physics::{
    ConstitutiveModel, DiscreteModel, Discretisation, Element, Elements, LocalUnits, Material,
    VolumetricFormulation,
};
use glam::{DMat3, DVec3};

const LAWS: [ConstitutiveModel; 2] = [ConstitutiveModel::NeoHookean, ConstitutiveModel::Corotated];

/// Tetrahedra with deformed corners: slightly, strongly, rotated, inverted, nearly flat, and flat.
fn cases(law: ConstitutiveModel) -> Vec<(Element, [DVec3; 4])> {
    let mut next = noise(5);
    let mut vector = |size: f64| size * DVec3::new(next(), next(), next());
    let mut all = Vec::new();
    for n in 0..64 {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| 0.3 * p + vector(0.07));
        let e = Element::new([0, 1, 2, 3], corners, 1e4, 0.3, law).unwrap();
        let turn = DMat3::from_axis_angle(vector(1.0).normalize(), 3.0 * f64::from(n % 7));
        // The corotated energy has a ridge where two stretches are each other's negative.
        let mirrored = if law == ConstitutiveModel::Corotated {
            -0.5
        } else {
            -1.0
        };
        let squash = [1.0, 1.0, 0.5, -0.7, 1e-3, -1e-3, 0.0, mirrored][n as usize % 8];
        let shape = DMat3::from_diagonal(DVec3::new(1.0, 1.3, squash));
        let size = [1e-6, 0.01, 0.1, 0.2][n as usize / 16];
        let noise = if squash == 0.0 { 0.0 } else { size };
        all.push((e, corners.map(|p| turn * (shape * p + vector(0.3 * noise)))));
    }
    all
}

/// Returns four cases as a batch with their rest positions, and the displacements.
fn batch<T: Real>(four: &[(Element, [DVec3; 4])]) -> (TetBatch<T>, Vec<V4<T>>) {
    let mut u = Vec::new();
    let mut gradients = [[[T::ZERO; 4]; 3]; 3];
    let mut lame = [[T::ZERO; 4]; 2];
    for (l, (e, corners)) in four.iter().enumerate() {
        // Rest positions of the tetrahedron, up to a translation.
        let edges = e.inverse_rest_shape.inverse();
        for (a, p) in corners.iter().enumerate() {
            let rest = if a > 0 { edges.col(a - 1) } else { DVec3::ZERO };
            let d = *p - corners[0] - rest;
            u.push([d.x, d.y, d.z, 0.0].map(T::from_f64));
        }
        for k in 0..3 {
            for axis in 0..3 {
                gradients[k][axis][l] = T::from_f64(e.gradients()[k + 1][axis]);
            }
        }
        for k in 0..2 {
            lame[k][l] = T::from_f64(e.lame_parameters[k] * e.volume);
        }
    }
    let batch = TetBatch {
        nodes: std::array::from_fn(|l| std::array::from_fn(|a| (4 * l + a) as u32)),
        point: TetPoint {
            gradients: gradients.map(|g| g.map(|x| T::lanes(&x))),
            lame: lame.map(|x| T::lanes(&x)),
        },
    };
    (batch, u)
}

fn vector<T: Real>(a: V4<T>) -> DVec3 {
    DVec3::new(a[0].to_f64(), a[1].to_f64(), a[2].to_f64())
}

/// Returns the largest relative errors of energy, force, and exact and projected blocks.
fn errors<T: Real>(law: ConstitutiveModel, spoil: impl Fn(&mut Element)) -> [f64; 4] {
    let mut worst = [0.0f64; 4];
    for four in cases(law).chunks(4) {
        let (batch, u) = batch::<T>(four);
        let g = batch.gradient(&u);
        let energy = T::array(batch.point.energy(law, &g));
        let mut forces = vec![[T::ZERO; 4]; 16];
        let (stress, same) = batch.point.stress(law, &g, T::Lanes::splat(0.0));
        batch.scatter::<true>(&stress, 0, &mut forces);
        let mut blocks = [[[DMat3::ZERO; 6]; 4]; 2];
        for (projected, blocks) in blocks.iter_mut().enumerate() {
            let (with, none, one) = (
                (law, projected > 0),
                T::Lanes::splat(0.0),
                T::Lanes::splat(1.0),
            );
            batch.point.blocks(with, &g, none, one, |n, block| {
                let tets = unpack_blocks::<T>(&block);
                for (l, [x, y, z]) in tets.into_iter().enumerate() {
                    blocks[l][n] = DMat3::from_cols(vector(x), vector(y), vector(z));
                }
            });
        }
        for (l, (e, corners)) in four.iter().enumerate() {
            let mut e = *e;
            spoil(&mut e);
            let size = e.volume * e.lame_parameters[0];
            let true_energy = e.energy(law, corners);
            let error = (energy[l].to_f64() - true_energy).abs() / true_energy.abs();
            worst[0] = worst[0].max(error);
            assert!((T::array(same)[l].to_f64() / energy[l].to_f64() - 1.0).abs() < 1e-3);
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
                for (n, [a, b]) in NODE_PAIRS.iter().enumerate() {
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
fn kernels_match_reference() {
    for law in LAWS {
        let wide = errors::<f64>(law, |_| ());
        let narrow = errors::<f32>(law, |_| ());
        println!("{law:?}: f64 {wide:?}, f32 {narrow:?}");
        assert!(wide.iter().all(|e| *e < 1e-9), "{wide:?}");
        // Flat tetrahedra are where the crush resistance is steepest.
        assert!(narrow.iter().all(|e| *e < 3e-3), "{narrow:?}");
        let spoiled = errors::<f64>(law, |e| e.lame_parameters[0] *= 1.001);
        assert!(spoiled.iter().all(|e| *e > 1e-5), "{spoiled:?}");
    }
}

#[test]
fn reference_forces_equal_negative_energy_gradient() {
    for law in LAWS {
        for (e, corners) in cases(law) {
            let size = e.volume * e.lame_parameters[0];
            let gradient = e.gradients()[1].length();
            let (forces, stiffness) = (e.forces(law, &corners), e.stiffness(law, &corners));
            for a in 0..4 {
                for axis in 0..3 {
                    let d = 2e-7;
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
fn small_strains_obey_hookes_law() {
    let (young, poisson) = (2e4, 0.37);
    let mu = young / (2.0 * (1.0 + poisson));
    let lambda = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
    for law in LAWS {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let e = Element::new([0, 1, 2, 3], corners, young, poisson, law).unwrap();
        let stiffness = e.stiffness(law, &corners);
        for (a, ga) in e.gradients().iter().enumerate() {
            for (b, gb) in e.gradients().iter().enumerate() {
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
fn projected_blocks_are_positive_semidefinite() {
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
            !x[0][1].abs_diff_eq(y[0][1], 1e-6 * e.lame_parameters[0])
        });
        assert!(indefinite.count() > 10);
    }
}

/// A bar of elements, with or without edges.
pub fn bar(cells: [usize; 3], law: ConstitutiveModel, edges: bool) -> DiscreteModel {
    let mesh = generate::bar(cells, DVec3::new(0.8, 0.2, 0.2)).unwrap();
    let mut network = DiscreteModel::new(&mesh, &Material::from_young(1e5)).unwrap();
    if !edges {
        network.edges.clear();
    }
    let (tets, rest) = (mesh.tets.iter(), &network.rest_positions);
    let element = |t: &[u32; 4]| Element::new(*t, t.map(|v| rest[v as usize]), 1e6, 0.3, law);
    network.discretisation = Discretisation::Elements(Elements {
        law,
        tets: tets.map(|t| element(t).unwrap()).collect(),
        ..Elements::default()
    });
    network
}

/// The bar with the given volumetric formulation and two materials, one `contrast` times as stiff;
/// a few tetrahedra have no cells.
fn mixed(law: ConstitutiveModel, volume: VolumetricFormulation, contrast: f64) -> DiscreteModel {
    let mut network = bar([5, 3, 2], law, false);
    let rest = network.rest_positions.clone();
    let elements = network.elements_mut().unwrap();
    elements.volume = volume;
    for e in &mut elements.tets {
        let corners = e.nodes.map(|v| rest[v as usize]);
        let stiff = corners.iter().map(|x| x.x).sum::<f64>() > 0.3;
        let (young, poisson) = if stiff {
            (contrast * 1e6, 0.45)
        } else {
            (1e6, 0.48)
        };
        *e = Element::new(e.nodes, corners, young, poisson, law).unwrap();
        e.region = u32::from(stiff);
        if corners[0].x > 0.3 {
            *e = Element::new(e.nodes, corners, young, 0.1, law).unwrap();
        }
    }
    network
}

/// Long because every function of the term is compared on one state.
#[test]
fn element_term_matches_reference() {
    use VolumetricFormulation::{NodalAveraged, PerTet};
    for (law, volume, contrast) in [
        (ConstitutiveModel::NeoHookean, PerTet, 1.0),
        (ConstitutiveModel::Corotated, PerTet, 1.0),
        (ConstitutiveModel::NeoHookean, NodalAveraged, 1.0),
        (ConstitutiveModel::NeoHookean, NodalAveraged, 1e5),
        (ConstitutiveModel::Corotated, NodalAveraged, 30.0),
    ] {
        let mut network = mixed(law, volume, contrast);
        network.damping_time = 0.3;
        let elements = network.elements().unwrap();
        let count = network.rest_positions.len();
        let moved: Vec<DVec3> = some(count, 3, 0.02);
        let p = some(count, 4, 1.0);
        let places: Vec<DVec3> = network
            .rest_positions
            .iter()
            .zip(&moved)
            .map(|(x, d)| *x + *d)
            .collect();
        let product = |projected: bool| -> Vec<DVec3> {
            let (blocks, squares) = elements.stiffness(&places, projected);
            assert_eq!(squares.is_empty(), volume == PerTet);
            let mut out = vec![DVec3::ZERO; count];
            for (e, k) in elements.tets.iter().zip(&blocks) {
                for a in 0..4 {
                    for b in 0..4 {
                        out[e.nodes[a] as usize] += k[a][b] * p[e.nodes[b] as usize];
                    }
                }
            }
            for square in &squares {
                let along: f64 = square.iter().map(|(v, s)| s.dot(p[*v as usize])).sum();
                for (v, s) in square {
                    out[*v as usize] += along * *s;
                }
            }
            out
        };
        let (energy, forces) = (elements.energy(&places), elements.forces(&places));
        let products = [product(false), product(true)];
        let with = |by: f64, of: &[DVec3], more: &[DVec3]| -> Vec<DVec3> {
            of.iter().zip(more).map(|(x, d)| *x + by * *d).collect()
        };
        for chunks in [1, 2, 3] {
            let lumps = Aggregates::new(&network.rest_positions, 12);
            let plan = Partition::with_chunks(lumps.group_starts, chunks);
            let units = LocalUnits::from_model(&network);
            let local = |v: &[DVec3], unit: f64| -> Vec<V4<f64>> {
                let places = lumps.order.iter();
                places.map(|i| from_metres(v[*i as usize], unit)).collect()
            };
            let (u, q) = (local(&moved, units.length), local(&p, units.length));
            let layout = (&lumps.order[..], units, &plan);
            let mut term =
                ElementTerm::<f64, TetBatch<f64>>::new((&network, elements), layout, true);
            let mut f = vec![[0.0; 4]; count];
            let sum = |f: &mut [V4<f64>]| -> f64 {
                (0..chunks)
                    .map(|c| term.elastic_forces(c, &u, &mut f[plan.range(c)]))
                    .sum()
            };
            let same = sum(&mut f) * units.energy();
            let again: f64 = (0..chunks).map(|c| term.energy(c, &u)).sum();
            assert!((same / energy - 1.0).abs() < 1e-12);
            assert!((again * units.energy() / energy - 1.0).abs() < 1e-12);
            let far = |a: &[V4<f64>], b: &[DVec3], unit: f64| {
                let size = b.iter().map(|b| b.length()).fold(0.0, f64::max);
                let both = a.iter().zip(&lumps.order);
                let off = both.map(|(a, i)| (vector(*a) * unit).distance(b[*i as usize]));
                off.fold(0.0, f64::max) / size
            };
            assert!(far(&f, &forces, units.force()) < 1e-12);
            // Explicit schemes use the exact damping at the current displacements.
            let mut f = vec![[0.0; 4]; count];
            let w = local(&p, units.length / units.time);
            let at = StateRef { u: &u, v: &w };
            for c in 0..chunks {
                term.forces(c, at, &mut f[plan.range(c)]);
            }
            // Metres of p are metres per second here.
            let damped = with(-network.damping_time, &forces, &products[0]);
            assert!(far(&f, &damped, units.force()) < 1e-10);
            assert!(far(&f, &forces, units.force()) > 1e-3);
            // Implicit schemes use projected damping, possibly frozen at other displacements.
            term.freeze_damping(&plan, &u);
            let mut f = vec![[0.0; 4]; count];
            let half_power: f64 = (0..chunks)
                .map(|c| term.damping_forces(c, at, &mut f[plan.range(c)]))
                .sum();
            let damped = with(
                -network.damping_time,
                &vec![DVec3::ZERO; count],
                &products[1],
            );
            assert!(far(&f, &damped, units.force()) < 1e-10);
            let power: f64 = damped.iter().zip(&p).map(|(f, p)| f.dot(*p)).sum();
            let watts = units.energy() / units.time;
            assert!((-2.0 * half_power * watts / power - 1.0).abs() < 1e-10);
            for (projected, product) in products.iter().enumerate() {
                let mut diagonal = vec![[0.0; 8]; count];
                let mut change = vec![[0.0; 4]; count];
                let share = SystemContribution {
                    diagonal: &mut diagonal,
                    stiffness_velocity: &mut change,
                };
                term.set_psd_projection(projected > 0);
                let h = 0.7;
                let seconds = h * units.time;
                term.linearise(&plan, StateRef { u: &u, v: &u }, h, share);
                let mut y = vec![[0.0; 4]; count];
                for c in 0..chunks {
                    term.multiply(c, &q, &mut y[plan.range(c)]);
                }
                let unit = units.force() * units.time * units.time;
                let both = with(network.damping_time / seconds, product, &products[1]);
                let both: Vec<DVec3> = both.iter().map(|x| *x * seconds * seconds).collect();
                let error = far(&y, &both, unit);
                assert!(error < 1e-10, "{law:?} {projected} {error}");
                let damping: Vec<DVec3> =
                    products[1].iter().map(|x| *x * seconds * seconds).collect();
                assert!(far(&y, &damping, unit) > 1e-3);
                // The visited blocks give the same product.
                let mut z: Vec<V4<f64>> = (0..count)
                    .map(|k| apply_symmetric(&diagonal[k], q[k]))
                    .collect();
                term.visit_off_diagonal(&mut |[i, j], m| {
                    let (i, j) = (i as usize, j as usize);
                    for (to, d) in [(i, *m * vector(q[j])), (j, m.transpose() * vector(q[i]))] {
                        for (z, d) in z[to].iter_mut().zip(d.to_array()) {
                            *z += d;
                        }
                    }
                });
                assert!(far(&z, &both, unit) < 1e-10);
            }
        }
    }
}

/// Averaged volumes: forces and Hessian are derivatives of one energy, which equals that of the
/// tetrahedra under uniform strain and is at most that otherwise.
#[test]
fn averaged_volume_forces_and_hessian_are_energy_derivatives() {
    for (law, contrast) in [
        (ConstitutiveModel::NeoHookean, 1e5),
        (ConstitutiveModel::Corotated, 3.0),
    ] {
        let network = mixed(law, VolumetricFormulation::NodalAveraged, contrast);
        let per_tet = Elements {
            volume: VolumetricFormulation::PerTet,
            ..network.elements().unwrap().clone()
        };
        let elements = network.elements().unwrap();
        let rest = &network.rest_positions;
        let strain = DMat3::from_cols(
            DVec3::new(1.1, 0.2, 0.0),
            DVec3::new(-0.1, 0.9, 0.3),
            DVec3::new(0.0, 0.1, 1.05),
        );
        let strained: Vec<DVec3> = rest.iter().map(|x| strain * *x).collect();
        let (a, b) = (elements.energy(&strained), per_tet.energy(&strained));
        assert!((a / b - 1.0).abs() < 1e-12, "{law:?} {a} {b}");
        assert!(elements.energy(rest).abs() < 1e-12 * a);
        let off = elements
            .forces(rest)
            .iter()
            .map(|f| f.length())
            .fold(0.0, f64::max);
        let most = elements
            .forces(&strained)
            .iter()
            .map(|f| f.length())
            .fold(0.0, f64::max);
        assert!(off < 1e-10 * most, "{law:?} {off} {most}");
        let count = rest.len();
        for size in [1e-3, 0.02, 0.1] {
            let moved = some(count, 8, size);
            let x: Vec<DVec3> = rest.iter().zip(&moved).map(|(x, d)| *x + *d).collect();
            assert!(elements.energy(&x) < 0.99 * per_tet.energy(&x));
            let p = some(count, 9, 1.0);
            let at =
                |s: f64| -> Vec<DVec3> { x.iter().zip(&p).map(|(x, p)| *x + s * *p).collect() };
            let d = 1e-6 * size.min(0.02);
            let slope = (elements.energy(&at(d)) - elements.energy(&at(-d))) / (2.0 * d);
            let forces = elements.forces(&x);
            let expected: f64 = forces.iter().zip(&p).map(|(f, p)| -f.dot(*p)).sum();
            assert!(
                (slope / expected - 1.0).abs() < 1e-5,
                "{law:?} {size} {slope} {expected}"
            );
            let [up, down] = [elements.forces(&at(d)), elements.forces(&at(-d))];
            let (blocks, squares) = elements.stiffness(&x, false);
            let mut product = vec![DVec3::ZERO; count];
            for (e, k) in elements.tets.iter().zip(&blocks) {
                for a in 0..4 {
                    for b in 0..4 {
                        product[e.nodes[a] as usize] += k[a][b] * p[e.nodes[b] as usize];
                    }
                }
            }
            for square in &squares {
                let along: f64 = square.iter().map(|(v, s)| s.dot(p[*v as usize])).sum();
                square
                    .iter()
                    .for_each(|(v, s)| product[*v as usize] += along * *s);
            }
            let most = product.iter().map(|f| f.length()).fold(0.0, f64::max);
            for (i, k) in product.iter().enumerate() {
                let slope = (down[i] - up[i]) / (2.0 * d);
                assert!(
                    slope.distance(*k) < 1e-5 * most,
                    "{law:?} {size} {slope} {k}"
                );
            }
        }
    }
}
