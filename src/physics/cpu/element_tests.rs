//! The finite elements against their plain float64 form, and what steps of them must keep to.
#![allow(clippy::unwrap_used)]

use super::element_batches::{Batch, L33};
use super::element_kernels::PAIRS;
use super::lanes::Lane;
use super::real::Real;
use super::tests::noise;
use super::vectors::V4;
use crate::physics::{Element, Law};
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
            let plain = [e.stiffness(law, corners), e.projected_stiffness(law, corners)];
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
        let spoiled = errors::<f64>(law, |e| e.lame[0] *= 1.001);
        assert!(spoiled.iter().all(|e| *e > 1e-5), "{spoiled:?}");
    }
}

fn _unused(_: L33<glam::Vec4>) {}
