//! Tests of muscles on ten-node tets.
#![allow(clippy::unwrap_used)]

use super::CpuBody;
use super::quadratic_load_tests::{moduli, root};
use super::scaled_load_tests::{body, check_muscle_term, muscle, network};
use super::tests::some;
use crate::generate::{Split, box_mesh};
use crate::mesh::{ElementOrder, PIECES, TetMesh};
use crate::physics::cpu::elements::muscle::MuscleTerm;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::Term;
use crate::physics::{CgSettings, DiscreteModel, Muscle, SolverKind};
use glam::{DMat3, DVec3};

/// A block of ten-node tets with curved edges inside and outside.
fn curved_block() -> TetMesh {
    let mesh = box_mesh([2; 3], DVec3::splat(0.1), Split::Six).unwrap();
    let mut mesh = mesh.with_mid_edge_nodes().unwrap();
    for x in &mut mesh.nodes {
        *x += 3.0 * DVec3::new(x.y * x.z, x.x * x.x, x.x * x.y);
    }
    mesh
}

/// Returns the mesh as one of order 1, with its pieces as tets.
fn of_pieces(mesh: &TetMesh) -> TetMesh {
    TetMesh {
        order: ElementOrder::Linear,
        ..mesh.clone()
    }
}

/// Returns the term of a muscle on a body; `model` may have the pieces as elements.
fn term<T: Real>(
    body: &CpuBody<T>,
    (model, mesh): (&DiscreteModel, &TetMesh),
    muscle: &Muscle,
) -> MuscleTerm<T> {
    let with = (&body.engine_index[..], body.units, &*body.plan);
    let mut term = MuscleTerm::new(muscle, 0, (model, &mesh.tets), with);
    term.set_amplitudes(&[1.0]);
    term
}

/// Returns the energy of a muscle at full activation with the nodes at `x`, without that at rest, J.
fn muscle_energy<T: Real>(
    (model, mesh): (&DiscreteModel, &TetMesh),
    muscle: &Muscle,
    x: &[DVec3],
) -> f64 {
    let settings = CgSettings::default();
    let mut body = CpuBody::<T>::new(model, SolverKind::Implicit, settings, Some(2)).unwrap();
    body.set_state(x, &vec![DVec3::ZERO; x.len()]).unwrap();
    let term = term(&body, (model, mesh), muscle);
    let chunks = 0..body.plan.chunks();
    chunks.map(|c| term.energy(c, &body.state.u)).sum::<f64>() * body.units.energy()
}

/// A displacement that is quadratic in the position, m.
fn quadratic(p: DVec3) -> DVec3 {
    2.0 * DVec3::new(
        p.x * p.y + 0.1 * p.z,
        p.x * p.x - p.y * p.z,
        p.y * p.y + p.x * p.z,
    )
}

/// Returns F m of [`quadratic`].
fn stretched(p: DVec3, m: DVec3) -> DVec3 {
    m + 0.5 * (quadratic(p + m) - quadratic(p - m))
}

#[test]
fn muscle_energy_of_quadratic_motion_is_exact() {
    let along = DVec3::new(1.0, 2.0, 0.5).normalize();
    let tension = 3e4;
    // By Gauss points, which are exact.
    let gauss = [-1.0, 1.0].map(|s: f64| 0.05 * (1.0 + s / 3f64.sqrt()));
    let mut exact = 0.0;
    for (x, y, z) in gauss
        .iter()
        .flat_map(|x| gauss.map(|y| gauss.map(|z| (*x, y, z))))
        .flatten()
    {
        let fibre = stretched(DVec3::new(x, y, z), along).length_squared();
        exact += 0.125 * 0.5 * tension * 1e-3 * (fibre - 1.0);
    }
    let mut of_pieces_off = Vec::new();
    for cells in [1, 2, 4] {
        let mesh = box_mesh([cells; 3], DVec3::splat(0.1), Split::Six).unwrap();
        let mesh = mesh.with_mid_edge_nodes().unwrap();
        let model = network(&mesh, 0.3, 0.0);
        let nodes = mesh.nodes.iter().zip(&model.rest_positions);
        let x: Vec<DVec3> = nodes.map(|(p, rest)| *rest + quadratic(*p)).collect();
        let muscle = muscle(&mesh, |_| along, tension);
        let off = |energy: f64| (energy / exact - 1.0).abs();
        assert!(off(muscle_energy::<f64>((&model, &mesh), &muscle, &x)) < 1e-12);
        assert!(off(muscle_energy::<f32>((&model, &mesh), &muscle, &x)) < 1e-5);
        // The order of the tets does not matter, and parts add up to the whole.
        let mut reversed = muscle.clone();
        reversed.fibres.reverse();
        assert!(off(muscle_energy::<f64>((&model, &mesh), &reversed, &x)) < 1e-12);
        let parts = [0, 1, 2].map(|k| {
            let mut part = muscle.clone();
            part.fibres.retain(|(t, _)| t % 3 == k);
            muscle_energy::<f64>((&model, &mesh), &part, &x)
        });
        assert!(off(parts.iter().sum()) < 1e-12, "{parts:?} {exact}");
        assert!(off(parts[0] + parts[1]) > 1e-2);
        // Linear pieces converge to it at second order.
        let pieces = of_pieces(&mesh);
        let model = network(&pieces, 0.3, 0.0);
        of_pieces_off.push(off(muscle_energy::<f64>((&model, &pieces), &muscle, &x)));
    }
    println!("pieces: off by {of_pieces_off:.5?}");
    assert!(of_pieces_off[2] > 1e-4);
    assert!((of_pieces_off[1] / of_pieces_off[2] - 4.0).abs() < 0.2);
}

#[test]
fn fibres_of_several_directions_act_in_their_pieces() {
    let mesh = box_mesh([2; 3], DVec3::splat(0.1), Split::Six).unwrap();
    let mesh = mesh.with_mid_edge_nodes().unwrap();
    let model = network(&mesh, 0.3, 0.0);
    let nodes = mesh.nodes.iter().zip(&model.rest_positions);
    let x: Vec<DVec3> = nodes.map(|(p, rest)| *rest + quadratic(*p)).collect();
    let directions = some(mesh.tets.len(), 8, 1.0);
    let muscle = muscle(&mesh, |t| directions[t], 3e4);
    let exact = |fibre: &(u32, DVec3)| {
        let corners = mesh.tet_nodes(fibre.0 as usize);
        let at = |k: usize| {
            let l = crate::mesh::quadrature_point(k);
            let p = corners.iter().zip(l).map(|(p, l)| *p * l).sum::<DVec3>();
            0.25 * (stretched(p, fibre.1).length_squared() - 1.0)
        };
        0.5 * muscle.tension * mesh.tet_volume(fibre.0 as usize) * (0..4).map(at).sum::<f64>()
    };
    let exact: f64 = muscle.fibres.iter().map(exact).sum();
    let found = muscle_energy::<f64>((&model, &mesh), &muscle, &x);
    assert!((found / exact - 1.0).abs() < 1e-11, "{found} {exact}");
    let mut turned = muscle.clone();
    turned.fibres[5].1 = turned.fibres[6].1;
    let other = muscle_energy::<f64>((&model, &mesh), &turned, &x);
    assert!((other / exact - 1.0).abs() > 1e-6);
}

#[test]
fn muscle_forces_of_curved_elements_are_energy_derivatives() {
    let mesh = curved_block();
    let network = network(&mesh, 0.3, 0.0);
    let elements = network.elements().unwrap();
    let ways = some(mesh.tets.len(), 8, 1.0);
    let mut muscle = muscle(&mesh, |t| ways[t / PIECES], 3e4);
    muscle
        .fibres
        .retain(|(t, _)| !(t / PIECES as u32).is_multiple_of(3));
    let of_tets = elements.of_tets(&mesh);
    let energy = |x: &[DVec3]| -> f64 {
        let firsts = muscle.fibres.iter().step_by(PIECES);
        let of = |(tet, m): &(u32, DVec3)| {
            let t = of_tets[*tet as usize].unwrap();
            let shape = elements.quadratic_shape(t).unwrap();
            let nodes = elements.quadratic_nodes(t).unwrap();
            let strains = shape.deformation_gradients(&nodes.map(|v| x[v as usize]));
            let points = strains.iter().zip(shape.volumes);
            0.5 * muscle.tension
                * points
                    .map(|(f, volume)| volume * (*f * *m).length_squared())
                    .sum::<f64>()
        };
        firsts.map(of).sum()
    };
    check_muscle_term((&network, &mesh), &muscle, energy);
}

#[test]
fn muscle_balances_uniform_strain_in_curved_elements() {
    let mesh = curved_block();
    let (poisson, tension) = (0.3, 1e4);
    let network = network(&mesh, poisson, 0.0);
    let [mu, lambda] = moduli(poisson);
    // With k = 1 + T/μ, P = 0 along the fibre at the stretch l if that across it has w² = k l², and
    // across it if λ′ (k l³ − 1) = μ (1 − 1/l).
    let k = 1.0 + tension / mu;
    let across = |l: f64| lambda * (k * l.powi(3) - 1.0) - mu * (1.0 - 1.0 / l);
    let l = root(across, [0.7 / k.cbrt(), 1.0 / k.cbrt()]);
    let stretch = DVec3::new(k.sqrt() * l, k.sqrt() * l, l);
    let turn = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7);
    let rest = network.rest_positions.iter();
    let x: Vec<DVec3> = rest.map(|p| turn * (stretch * *p)).collect();
    let muscle = muscle(&mesh, |_| DVec3::Z, tension);
    let largest = |with_pieces: bool, level: f64| {
        let mut body = body(&network, SolverKind::Implicit, 2);
        body.set_state(&x, &vec![DVec3::ZERO; x.len()]).unwrap();
        match with_pieces {
            false => body.add_muscle(&muscle, 0, (&network, &mesh.tets)),
            true => {
                let pieces = of_pieces(&mesh);
                let model = self::network(&pieces, poisson, 0.0);
                let term = term(&body, (&model, &pieces), &muscle);
                body.add_term(Box::new(term));
            }
        }
        body.set_levels(&[level]);
        let forces = body.forces();
        forces.iter().map(|f| f.length()).fold(0.0, f64::max) / (tension * 0.01)
    };
    let [exact, other, pieces] =
        [(false, 1.0), (false, 1.001), (true, 1.0)].map(|(with, level)| largest(with, level));
    println!("net force over T A: {exact:.1e}; other activation {other:.1e}, pieces {pieces:.1e}");
    assert!(exact < 1e-13 && other > 1e-5 && pieces > 1e-3);
}

/// Returns how far the middle of a free bar moves off the line between its ends, m, when the fibres
/// of its upper half contract.
fn bow(mesh: &TetMesh, muscle_mesh: &TetMesh) -> f64 {
    let size = mesh.bounds().1;
    let model = network(mesh, 0.3, 0.02);
    let mut muscle = muscle(mesh, |_| DVec3::X, 1e3);
    muscle.fibres.retain(|(t, _)| {
        let middle = mesh.tet_nodes(*t as usize).iter().sum::<DVec3>() / 4.0;
        middle.z > 0.5 * size.z
    });
    let mut body = body(&model, SolverKind::Implicit, 2);
    let of_muscle = network(muscle_mesh, 0.3, 0.02);
    let term = term(&body, (&of_muscle, muscle_mesh), &muscle);
    body.add_term(Box::new(term));
    body.set_levels(&[1.0]);
    body.run(12, 10.0).unwrap();
    let x = body.positions();
    let at = |share: f64| {
        let p = DVec3::new(share * size.x, 0.0, 0.0);
        let node = mesh.nodes.iter().position(|q| q.distance(p) < 1e-9);
        x[node.unwrap()]
    };
    let ends = at(1.0) - at(0.0);
    let off = at(0.5) - at(0.0);
    (off - ends * (off.dot(ends) / ends.length_squared())).length()
}

#[test]
fn bar_bent_by_muscle_is_the_limit_of_linear_tets() {
    let mesh = |k: usize| {
        let size = DVec3::new(0.12, 0.03, 0.03);
        box_mesh([4 * k, k, 2 * k], size, Split::Six).unwrap()
    };
    let bows = |k: usize| {
        let quadratic = mesh(k).with_mid_edge_nodes().unwrap();
        let pieces = of_pieces(&quadratic);
        [&quadratic, &pieces].map(|muscle_mesh| bow(&quadratic, muscle_mesh))
    };
    let [[coarse, of_pieces], [fine, _]] = [1, 3].map(bows);
    let off = |bow: f64| (bow / fine - 1.0).abs();
    let linear = [2, 4, 8].map(|k| off(bow(&mesh(k), &mesh(k))));
    println!("coarse {:.5}, of pieces {:.5}", off(coarse), off(of_pieces));
    println!("linear {linear:.4?}");
    assert!(off(coarse) < 3e-3 && off(of_pieces) > 1.5 * off(coarse));
    assert!(linear[0] > 0.25 && linear[2] < 0.04, "{linear:?}");
    let order = (linear[1] / linear[2]).log2();
    assert!((1.5..2.2).contains(&order), "{order}");
}
