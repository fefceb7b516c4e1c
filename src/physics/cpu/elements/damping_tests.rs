//! Tests of the derivatives of damping against differences of the float64 reference.
#![allow(clippy::unwrap_used)]

use super::damping_derivatives::damping_derivatives;
use crate::generate;
use crate::mesh::ElementOrder;
use crate::physics::cpu::body::tests::some;
use crate::physics::cpu::vectors::{V4, from_metres, to_dvec};
use crate::physics::{DiscreteModel, Elements, LocalUnits, Material, MaterialModel};
use glam::{DMat3, DVec3};

/// Returns y·K⁺ w of the reference, J/s.
fn work(elements: &Elements, x: &[DVec3], [y, w]: [&[DVec3]; 2]) -> f64 {
    let with = (elements.law, true);
    let mut sum = 0.0;
    let mut add = |nodes: &[u32], blocks: &[&[DMat3]]| {
        for (a, row) in nodes.iter().zip(blocks) {
            for (b, block) in nodes.iter().zip(*row) {
                sum += y[*a as usize].dot(*block * w[*b as usize]);
            }
        }
    };
    for (t, tet) in elements.tets.iter().enumerate() {
        if elements.order() == 1 {
            let blocks = tet.projected_stiffness(elements.law, &tet.node_positions(x));
            add(&tet.nodes, &blocks.each_ref().map(|row| &row[..]));
            continue;
        }
        let nodes = elements.quadratic_nodes(t).unwrap();
        let shape = elements.quadratic_shape(t).unwrap();
        let strains = shape.deformation_gradients(&nodes.map(|v| x[v as usize]));
        for (point, f) in strains.iter().enumerate() {
            let (gradients, volume) = (&shape.gradients[point], shape.volumes[point]);
            let blocks = tet.blocks(with, f, gradients, (volume, 0.0));
            add(&nodes, &blocks.each_ref().map(|row| &row[..]));
        }
    }
    sum
}

fn moved(a: &[DVec3], by: f64, b: &[DVec3]) -> Vec<DVec3> {
    a.iter().zip(b).map(|(a, b)| *a + by * *b).collect()
}

/// Returns the errors of the derivatives by displacements along a random direction and by the Lamé parameters of
/// some elements at displacements of `size`, relative to the largest; the displacements of the derivatives are
/// `stretched` by a factor.
fn errors(order: ElementOrder, law: MaterialModel, size: f64, stretched: f64) -> [f64; 2] {
    let mut mesh = generate::bar([3, 2, 1], DVec3::new(0.3, 0.2, 0.1)).unwrap();
    if order == ElementOrder::Quadratic {
        mesh = mesh.with_mid_edge_nodes().unwrap();
    }
    let material = Material {
        model: law,
        order,
        poisson: 0.45,
        damping_time: 0.3,
        ..Material::from_young(1e5)
    };
    let model = DiscreteModel::new(&mesh, &material).unwrap();
    let elements = model.elements().unwrap();
    let units = LocalUnits::from_model(&model);
    let count = model.rest_positions.len();
    let [u, y, w, along] = [3, 4, 5, 6].map(|seed| some(count, seed, 1.0));
    let u = moved(&vec![DVec3::ZERO; count], size, &u);
    let local = |v: &[DVec3], unit: f64| -> Vec<V4<f64>> {
        v.iter().map(|v| from_metres(*v, unit)).collect()
    };
    let index: Vec<u32> = (0..count as u32).collect();
    let own = local(&u, units.length / stretched);
    let (local_w, local_y) = (local(&w, units.velocity()), local(&y, units.length));
    // Two at once, of which the first is tested.
    let ys: [&[V4<f64>]; 2] = [&local_y, &local_w];
    let found = damping_derivatives(&model, (&index, &units), [&own, &local_w], &ys);
    let found = &found[0];

    let x = moved(&model.rest_positions, 1.0, &u);
    let beta = model.damping_time;
    let h = 1e-7 * size.max(1e-3);
    let [up, down] = [h, -h].map(|h| work(elements, &moved(&x, h, &along), [&y, &w]));
    let slope = beta * (up - down) / (2.0 * h);
    let unit = units.energy() / units.length;
    let products = found.by_position.iter().zip(&along);
    let products: Vec<f64> = products.map(|(g, d)| unit * to_dvec(*g).dot(*d)).collect();
    let largest = products.iter().fold(0.0f64, |m, p| m.max(p.abs()));
    let by_position = (products.iter().sum::<f64>() - slope).abs() / largest;

    let (mut by_lame, mut largest) = (0.0f64, 0.0f64);
    for (t, k) in [(0, 0), (1, 1), (7, 0), (11, 1)] {
        let slope_of = |by: f64| {
            let mut changed = elements.clone();
            let mu = changed.tets[t].lame_parameters[0];
            changed.tets[t].lame_parameters[k] += by * mu;
            (work(&changed, &x, [&y, &w]), mu)
        };
        let ((up, mu), (down, _)) = (slope_of(1e-5), slope_of(-1e-5));
        let slope = beta * (up - down) / (2e-5 * mu);
        by_lame = by_lame.max((found.by_lame[t][k] * units.energy() - slope).abs());
        largest = largest.max(slope.abs());
    }
    [by_position, by_lame / largest]
}

/// Displacements from a thousandth of an element, where the stretches are alike, to its size, where tets are
/// inverted.
#[test]
fn damping_derivatives_match_differences_of_reference() {
    let mut worst = [0.0f64; 2];
    for order in [ElementOrder::Linear, ElementOrder::Quadratic] {
        for law in [MaterialModel::NeoHookean, MaterialModel::Corotated] {
            for size in [1e-4, 0.004, 0.03, 0.1] {
                let [by_position, by_lame] = errors(order, law, size, 1.0);
                println!("{order:?} {law:?} {size}: {by_position:.1e} {by_lame:.1e}");
                worst = [worst[0].max(by_position), worst[1].max(by_lame)];
            }
            // Derivatives of another state are found wrong.
            let [by_position, by_lame] = errors(order, law, 0.004, 1.1);
            assert!(
                by_position > 1e-3 && by_lame > 1e-4,
                "{by_position} {by_lame}"
            );
        }
    }
}
