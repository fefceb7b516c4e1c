//! Tests of pressure, muscles and prescribed motions against closed formulas.
#![allow(clippy::unwrap_used)]

use super::CpuBody;
use super::tests::some;
use crate::generate::{Split, ball, box_mesh};
use crate::mesh::{TetMesh, Topology};
use crate::physics::cpu::elements::muscle::MuscleTerm;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::pressure::LoadedFace;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::{V4, from_metres, to_metres};
use crate::physics::{CgSettings, DiscreteModel, Material, MaterialModel, Muscle, SolverKind};
use glam::{DMat3, DVec3};

pub(super) const YOUNG: f64 = 2e4;

/// Returns the model of a mesh, of elements of its order.
pub(super) fn network(mesh: &TetMesh, poisson: f64, damping_time: f64) -> DiscreteModel {
    let material = Material {
        model: MaterialModel::NeoHookean,
        poisson,
        damping_time,
        order: mesh.order,
        ..Material::from_young(YOUNG)
    };
    DiscreteModel::new(mesh, &material).unwrap()
}

pub(super) fn body(network: &DiscreteModel, kind: SolverKind, chunks: usize) -> CpuBody<f64> {
    let settings = CgSettings {
        tolerance: 1e-10,
        ..CgSettings::default()
    };
    CpuBody::new(network, kind, settings, Some(chunks)).unwrap()
}

/// Returns the boundary faces of a mesh.
pub(super) fn faces(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let topology = Topology::new(mesh);
    let boundary = topology.boundary.iter();
    boundary
        .map(|b| topology.boundary_nodes(mesh, *b))
        .collect()
}

/// Returns `faces` as those of linear tets.
fn linear(faces: &[[u32; 3]]) -> Vec<LoadedFace> {
    faces.iter().map(|face| (*face, [false; 3])).collect()
}

/// Returns the forces of a pressure alone on a body with nodes at `x`.
fn pressed(network: &DiscreteModel, faces: &[[u32; 3]], x: &[DVec3], chunks: usize) -> Vec<DVec3> {
    let mut body = body(network, SolverKind::Implicit, chunks);
    body.set_state(x, &vec![DVec3::ZERO; x.len()]).unwrap();
    let before = body.forces();
    body.add_pressure(&linear(faces), 1);
    // The amplitude of another index has no effect.
    body.set_levels(&[1e9, 700.0]);
    let after = body.forces();
    after.iter().zip(before).map(|(a, b)| *a - b).collect()
}

#[test]
fn pressure_on_closed_surface_has_no_resultant() {
    let mesh = ball(0.05, 7).unwrap();
    let network = network(&mesh, 0.3, 0.0);
    let faces = faces(&mesh);
    // Deformed and rotated.
    let turn = DMat3::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), 1.0);
    let bent = |p: &DVec3| turn * (*p + DVec3::new(4.0 * p.y * p.y, 0.3 * p.z, 2.0 * p.x * p.y));
    let x: Vec<DVec3> = network.rest_positions.iter().map(bent).collect();
    let forces = pressed(&network, &faces, &x, 1);
    let size: f64 = forces.iter().map(|f| f.length()).sum();
    let sum: DVec3 = forces.iter().sum();
    let moment: DVec3 = x.iter().zip(&forces).map(|(x, f)| x.cross(*f)).sum();
    assert!(sum.length() < 1e-12 * size, "{sum}");
    assert!(moment.length() < 1e-12 * size, "{moment}");
    // Its virtual work is p times the change of volume: exactly, for linear motion.
    let volume = |x: &[DVec3]| -> f64 {
        let of = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|v| x[v as usize]);
            a.dot(b.cross(c)) / 6.0
        };
        faces.iter().map(of).sum()
    };
    let (way, h) = (some(x.len(), 3, 1.0), 1e-6);
    let moved = |by: f64| -> Vec<DVec3> { x.iter().zip(&way).map(|(x, w)| *x + by * *w).collect() };
    let change = (volume(&moved(h)) - volume(&moved(-h))) / (2.0 * h);
    let work: f64 = forces.iter().zip(&way).map(|(f, w)| f.dot(*w)).sum();
    assert!(
        (work + 700.0 * change).abs() < 1e-7 * work.abs(),
        "{work} {change}"
    );
    // Partitioning among threads does not change the result.
    for (a, b) in forces.iter().zip(pressed(&network, &faces, &x, 3)) {
        assert!(a.distance(b) < 1e-12 * size);
    }
    // Without one face the surface is not closed.
    let sum: DVec3 = pressed(&network, &faces[1..], &x, 1).iter().sum();
    assert!(sum.length() > 1e-4 * size);
}

#[test]
fn cube_under_pressure_shrinks_by_bulk_modulus() {
    let mesh = box_mesh([2; 3], DVec3::splat(0.1), Split::Six).unwrap();
    for (poisson, kind) in [(0.3, SolverKind::Implicit), (0.45, SolverKind::Bdf2)] {
        let network = network(&mesh, poisson, 0.02);
        let mut body = body(&network, kind, 2);
        body.add_pressure(&linear(&faces(&mesh)), 0);
        let pressure = 1e-6 * YOUNG;
        body.set_levels(&[pressure]);
        body.run(60, 0.1).unwrap();
        let strain = -pressure * (1.0 - 2.0 * poisson) / YOUNG;
        let x = body.positions();
        let middle = x.iter().sum::<DVec3>() / x.len() as f64;
        let rest_middle = network.rest_positions.iter().sum::<DVec3>() / x.len() as f64;
        for (x, rest) in x.iter().zip(&network.rest_positions) {
            let moved = (*x - middle) - (*rest - rest_middle);
            let expected = strain * (*rest - rest_middle);
            let off = (moved - expected).length();
            assert!(
                off < 1e-4 * strain.abs() * 0.05,
                "{poisson}: {moved} {expected}"
            );
        }
    }
}

/// A muscle in all tetrahedra, with fibres along `along`.
pub(super) fn muscle(mesh: &TetMesh, along: impl Fn(usize) -> DVec3, tension: f64) -> Muscle {
    Muscle {
        fibres: (0..mesh.tets.len())
            .map(|t| (t as u32, along(t).normalize()))
            .collect(),
        tension,
    }
}

#[test]
fn muscle_forces_and_blocks_are_energy_derivatives() {
    let mesh = ball(0.05, 6).unwrap();
    let network = network(&mesh, 0.3, 0.0);
    let ways = some(mesh.tets.len(), 8, 1.0);
    let mut muscle = muscle(&mesh, |t| ways[t], 3e4);
    muscle.fibres.retain(|(t, _)| t % 3 != 0);
    // Energy by its definition, tetrahedron by tetrahedron.
    let energy = |x: &[DVec3]| -> f64 {
        let of = |(t, m): &(u32, DVec3)| {
            let element = network.tets()[*t as usize];
            let f = element.deformation_gradient(&mesh.tets[*t as usize].map(|v| x[v as usize]));
            0.5 * muscle.tension * element.volume * (f * *m).length_squared()
        };
        muscle.fibres.iter().map(of).sum()
    };
    check_muscle_term((&network, &mesh), &muscle, energy);
}

/// Checks the term of a muscle whose energy at full activation is `energy`. Long because every
/// function of the term is compared on one state.
pub(super) fn check_muscle_term(
    (network, mesh): (&DiscreteModel, &TetMesh),
    muscle: &Muscle,
    full_energy: impl Fn(&[DVec3]) -> f64,
) {
    let x: Vec<DVec3> = network
        .rest_positions
        .iter()
        .zip(some(network.rest_positions.len(), 1, 0.004))
        .map(|(x, d)| *x + d)
        .collect();
    let level = 0.6;
    let energy = |x: &[DVec3]| level * full_energy(x);
    let mut all = Vec::new();
    for chunks in [1, 3] {
        let host = body(network, SolverKind::Implicit, chunks);
        let (order, units, plan) = host.layout();
        let mut place = vec![0u32; order.len()];
        order
            .iter()
            .enumerate()
            .for_each(|(k, v)| place[*v as usize] = k as u32);
        let with = (&place[..], units, plan);
        let mut term = MuscleTerm::<f64>::new(muscle, 0, (network, &mesh.tets), with);
        let local = |x: &[DVec3]| -> Vec<V4<f64>> {
            let of = |v: &u32| {
                from_metres(
                    x[*v as usize] - network.rest_positions[*v as usize],
                    units.length,
                )
            };
            order.iter().map(of).collect()
        };
        let u = local(&x);
        let forces = |term: &MuscleTerm<f64>, u: &[V4<f64>]| {
            let mut f = vec![[0.0; 4]; u.len()];
            let energy: f64 = (0..plan.chunks())
                .map(|c| {
                    let e = term.elastic_forces(c, u, &mut f[plan.range(c)]);
                    assert_eq!(e, term.energy(c, u));
                    e
                })
                .sum();
            (f, energy * units.energy())
        };
        // Without activation there are no forces.
        assert!(forces(&term, &u).0.iter().flatten().all(|f| *f == 0.0));
        term.set_amplitudes(&[level]);
        let (f, found) = forces(&term, &u);
        let expected = energy(&x) - energy(&network.rest_positions);
        assert!(
            (found - expected).abs() < 1e-12 * expected.abs().max(energy(&x)),
            "{found} {expected}"
        );
        // Along a random direction: forces are the derivative of the energy, which is quadratic,
        // and the product is the change of forces.
        let way = some(x.len(), 4, 1e-3);
        let moved =
            |by: f64| -> Vec<DVec3> { x.iter().zip(&way).map(|(x, w)| *x + by * *w).collect() };
        let slope = 0.5 * (energy(&moved(1.0)) - energy(&moved(-1.0)));
        let work: f64 = f
            .iter()
            .zip(order)
            .map(|(f, v)| to_metres(*f, units.force()).dot(way[*v as usize]))
            .sum();
        assert!((work + slope).abs() < 1e-10 * slope.abs(), "{work} {slope}");
        let p: Vec<V4<f64>> = order
            .iter()
            .map(|v| from_metres(way[*v as usize], units.length))
            .collect();
        let h = 0.7;
        let (mut diagonal, mut change) = (vec![[0.0; 8]; u.len()], vec![[0.0; 4]; u.len()]);
        let share = SystemContribution {
            diagonal: &mut diagonal,
            stiffness_velocity: &mut change,
        };
        term.linearise(plan, StateRef { u: &u, v: &p }, h, share);
        let mut y = vec![[0.0; 4]; u.len()];
        (0..plan.chunks()).for_each(|c| term.multiply(c, &p, &mut y[plan.range(c)]));
        let after = forces(&term, &local(&moved(1.0))).0;
        let size = y.iter().flatten().fold(0.0f64, |a, b| a.max(b.abs()));
        for i in 0..u.len() {
            for k in 0..3 {
                let expected = h * h * (f[i][k] - after[i][k]);
                assert!((y[i][k] - expected).abs() < 1e-10 * size);
                assert!((h * h * change[i][k] + y[i][k]).abs() < 1e-10 * size);
            }
        }
        // The visited blocks give the same matrix.
        let mut z: Vec<V4<f64>> = (0..u.len())
            .map(|i| std::array::from_fn(|k| if k < 3 { diagonal[i][k] * p[i][k] } else { 0.0 }))
            .collect();
        term.visit_off_diagonal(&mut |[i, j], block| {
            let (i, j) = (i as usize, j as usize);
            for k in 0..3 {
                z[i][k] += block.col(k)[k] * p[j][k];
                z[j][k] += block.col(k)[k] * p[i][k];
            }
        });
        for (z, y) in z.iter().flatten().zip(y.iter().flatten()) {
            assert!((z - y).abs() < 1e-10 * size);
        }
        let mut by_node = vec![[0.0; 4]; f.len()];
        order
            .iter()
            .zip(&f)
            .for_each(|(v, f)| by_node[*v as usize] = *f);
        all.push(by_node);
    }
    for (a, b) in all[0].iter().flatten().zip(all[1].iter().flatten()) {
        assert!((a - b).abs() < 1e-9);
    }
}

/// Returns the stretches along and across the fibres that minimise `energy`.
fn least(energy: impl Fn(f64, f64) -> f64) -> [f64; 2] {
    // Newton's method with finite differences of a smooth function.
    let (mut at, h) = ([1.0, 1.0], 1e-4);
    for _ in 0..60 {
        let e = |a: f64, b: f64| energy(at[0] + a * h, at[1] + b * h);
        let g = [e(1.0, 0.0) - e(-1.0, 0.0), e(0.0, 1.0) - e(0.0, -1.0)].map(|d| 0.5 * d / h);
        let xx = (e(1.0, 0.0) - 2.0 * e(0.0, 0.0) + e(-1.0, 0.0)) / (h * h);
        let yy = (e(0.0, 1.0) - 2.0 * e(0.0, 0.0) + e(0.0, -1.0)) / (h * h);
        let xy = (e(1.0, 1.0) - e(1.0, -1.0) - e(-1.0, 1.0) + e(-1.0, -1.0)) / (4.0 * h * h);
        let over = 1.0 / (xx * yy - xy * xy);
        at[0] -= over * (yy * g[0] - xy * g[1]);
        at[1] -= over * (xx * g[1] - xy * g[0]);
    }
    at
}

#[test]
fn muscle_cube_shortens_to_energy_minimum() {
    let linear = box_mesh([2; 3], DVec3::splat(0.1), Split::Six).unwrap();
    let quadratic = linear.with_mid_edge_nodes().unwrap();
    for (mesh, poisson, activation, kind) in [
        (&linear, 0.3, 1.0, SolverKind::Implicit),
        (&linear, 0.49, 0.5, SolverKind::Implicit),
        (&linear, 0.4, 0.3, SolverKind::Bdf2),
        (&quadratic, 0.49, 0.5, SolverKind::Implicit),
        (&quadratic, 0.4, 0.3, SolverKind::Bdf2),
    ] {
        let network = network(mesh, poisson, 0.02);
        let mut body = body(&network, kind, 2);
        let tension = 1.5e4;
        let along = muscle(mesh, |_| DVec3::Z, tension);
        body.add_muscle(&along, 0, (&network, &mesh.tets));
        body.set_levels(&[activation]);
        body.run(80, 0.1).unwrap();
        let mu = YOUNG / (2.0 * (1.0 + poisson));
        let more = YOUNG * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)) + mu;
        let pull = activation * tension;
        let [long, wide] = least(|l, w| {
            let j = l * w * w;
            0.5 * mu * (l * l + 2.0 * w * w - 3.0) - mu * (j - 1.0)
                + 0.5 * more * (j - 1.0).powi(2)
                + 0.5 * pull * l * l
        });
        assert!(long < 0.9 && wide > 1.02, "{long} {wide}");
        // Measured along the edges of the cube, which may have rotated.
        let x = body.positions();
        let corner = |p: DVec3| {
            mesh.nodes
                .iter()
                .position(|q| q.distance(p) < 1e-9)
                .unwrap()
        };
        let edge = |axis: DVec3| {
            let [a, b] = [DVec3::ZERO, 0.1 * axis].map(|p| x[corner(p)]);
            a.distance(b) / 0.1
        };
        let stretch = DVec3::new(edge(DVec3::X), edge(DVec3::Y), edge(DVec3::Z));
        let expected = DVec3::new(wide, wide, long);
        assert!(
            stretch.distance(expected) < 1e-5,
            "{poisson}: {stretch} {expected}"
        );
        if poisson == 0.49 {
            // The incompressible limit: μ (λ − 1/λ²) + a T λ = 0.
            let incompressible = (mu / (mu + pull)).cbrt();
            assert!(
                (stretch.z / incompressible - 1.0).abs() < 0.02,
                "{stretch} {incompressible}"
            );
        }
    }
}

#[test]
fn steady_prescribed_motion_translates_body_without_strain() {
    let mesh = box_mesh([3, 2, 2], DVec3::new(0.12, 0.06, 0.06), Split::Six).unwrap();
    let elements = network(&mesh, 0.3, 0.02);
    let springs = Material {
        damping_time: 0.002,
        ..Material::from_young(YOUNG)
    };
    let springs = DiscreteModel::new(&mesh, &springs).unwrap();
    let velocity = DVec3::new(0.3, -0.2, 0.5);
    for (network, kind, h) in [
        (&elements, SolverKind::Implicit, 0.01),
        (&elements, SolverKind::Bdf2, 0.01),
        (&elements, SolverKind::Midpoint, 0.01),
        (&elements, SolverKind::Symplectic, 1e-4),
        (&springs, SolverKind::Implicit, 0.01),
        (&springs, SolverKind::Verlet, 1e-4),
        (&springs, SolverKind::VelocityVerlet, 1e-4),
    ] {
        let mut body = body(network, kind, 1);
        let count = network.rest_positions.len();
        let ends: Vec<u32> = (0..count as u32)
            .filter(|v| mesh.nodes[*v as usize].x < 1e-9)
            .collect();
        body.set_state(&network.rest_positions, &vec![velocity; count])
            .unwrap();
        let mut off = 0.0f64;
        for n in 0..40 {
            let moved = f64::from(n) * h * velocity;
            let prescribed: Vec<NodeConstraint> = ends
                .iter()
                .map(|v| NodeConstraint::Prescribed {
                    node: *v,
                    place: network.rest_positions[*v as usize] + moved,
                    velocity,
                })
                .collect();
            body.set_node_constraints(&prescribed).unwrap();
            body.run(1, h).unwrap();
            let after = moved + h * velocity;
            for (x, rest) in body.positions().iter().zip(&network.rest_positions) {
                off = off.max(x.distance(*rest + after));
            }
        }
        assert!(off < 1e-9, "{kind} {off}");
        // Placed without a velocity, like a pin that jumps, they hold the body back.
        let holds: Vec<NodeConstraint> = ends
            .iter()
            .map(|v| NodeConstraint::Fixed {
                node: *v,
                place: network.rest_positions[*v as usize] + 41.0 * h * velocity,
            })
            .collect();
        body.set_node_constraints(&holds).unwrap();
        body.run(1, h).unwrap();
        let late = |(x, rest): (&DVec3, &DVec3)| x.distance(*rest + 41.0 * h * velocity);
        let late = body
            .positions()
            .iter()
            .zip(&network.rest_positions)
            .map(late)
            .fold(0.0, f64::max);
        assert!(late > 1e-7, "{kind} {late}");
    }
}
