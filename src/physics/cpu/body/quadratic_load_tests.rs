//! Tests of pressure on ten-node tets.
#![allow(clippy::unwrap_used)]

use super::CpuBody;
use super::scaled_load_tests::{YOUNG, body, faces, network};
use super::tests::some;
use crate::generate::{Split, ball, box_mesh};
use crate::mesh::{TetMesh, unit_map};
use crate::physics::cpu::pressure::LoadedFace;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{V4, add, from_metres, sub, to_metres, zero};
use crate::physics::{CgSettings, DiscreteModel, SolverKind};
use glam::{DMat3, DVec3};
use std::slice::from_ref;

const PRESSURE: f64 = 700.0;

/// A ball of ten-node tets with curved edges: the nodes in the middle of boundary edges are on the
/// sphere.
fn curved_ball() -> TetMesh {
    let mut mesh = ball(0.05, 6).unwrap().with_mid_edge_nodes().unwrap();
    let middles = mesh.mid_edge_nodes();
    for v in faces(&mesh).into_iter().flatten().map(|v| v as usize) {
        if middles[v] {
            let p = mesh.nodes[v];
            mesh.nodes[v] = p * (0.05 / p.length());
        }
    }
    mesh
}

/// Returns the boundary faces of a mesh with their nodes in the middle of edges.
fn loaded(mesh: &TetMesh) -> Vec<LoadedFace> {
    let middles = mesh.mid_edge_nodes();
    let of = |face: [u32; 3]| (face, face.map(|v| middles[v as usize]));
    faces(mesh).into_iter().map(of).collect()
}

/// Returns the pieces at the corners of faces, and the others: none is the whole of a face.
fn apart(faces: &[LoadedFace]) -> [Vec<LoadedFace>; 2] {
    let inner = |(_, is_middle): &&LoadedFace| *is_middle == [true; 3];
    let inner: Vec<LoadedFace> = faces.iter().filter(inner).copied().collect();
    let others = faces.iter().filter(|face| !inner.contains(face));
    [others.copied().collect(), inner]
}

/// Returns a body with its nodes at `x` and a pressure on each group of faces.
fn pressed<T: Real>(
    network: &DiscreteModel,
    groups: &[Vec<LoadedFace>],
    x: &[DVec3],
    chunks: usize,
) -> CpuBody<T> {
    let settings = CgSettings::default();
    let mut body =
        CpuBody::<T>::new(network, SolverKind::Implicit, settings, Some(chunks)).unwrap();
    body.set_state(x, &vec![DVec3::ZERO; x.len()]).unwrap();
    groups.iter().for_each(|faces| body.add_pressure(faces, 0));
    body.set_levels(&[PRESSURE]);
    body
}

/// Returns the loads on a body at the displacements `u`, in its units and order.
fn loads_at<T: Real>(body: &CpuBody<T>, u: &[V4<T>]) -> Vec<V4<T>> {
    let mut f = vec![zero(); u.len()];
    for chunk in 0..body.plan.chunks() {
        let own = &mut f[body.plan.range(chunk)];
        body.loads
            .write_forces(&body.plan, chunk, &body.masses, u, own);
    }
    f
}

/// Returns the loads on a body by node, N.
fn loads<T: Real>(body: &CpuBody<T>) -> Vec<DVec3> {
    let f = loads_at(body, &body.state.u);
    let places = body.engine_index.iter();
    places
        .map(|k| to_metres(f[*k as usize], body.units.force()))
        .collect()
}

/// Returns the volume of a body of ten-node tets with its nodes at `x`, by a rule of degree 3.
fn volume(mesh: &TetMesh, x: &[DVec3]) -> f64 {
    let of = |nodes: &[u32; 10]| -> f64 {
        let x = nodes.map(|v| x[v as usize]);
        let at = |l: [f64; 4]| unit_map(&x, l).0.determinant() / 6.0;
        let corner = |a: usize| {
            at(std::array::from_fn(
                |b| if a == b { 0.5 } else { 1.0 / 6.0 },
            ))
        };
        -0.8 * at([0.25; 4]) + 0.45 * (0..4).map(corner).sum::<f64>()
    };
    mesh.ten_node_tets().unwrap().iter().map(of).sum()
}

fn moved(x: &[DVec3], by: f64, way: &[DVec3]) -> Vec<DVec3> {
    x.iter().zip(way).map(|(x, w)| *x + by * *w).collect()
}

fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

/// The state of a body, deformed and rotated.
fn bent(network: &DiscreteModel) -> Vec<DVec3> {
    let turn = DMat3::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), 1.0);
    let bent = |p: &DVec3| turn * (*p + DVec3::new(4.0 * p.y * p.y, 0.3 * p.z, 2.0 * p.x * p.y));
    network.rest_positions.iter().map(bent).collect()
}

#[test]
fn pressure_on_closed_curved_surface_works_on_its_volume() {
    let mesh = curved_ball();
    let network = network(&mesh, 0.3, 0.0);
    let (faces, x) = (loaded(&mesh), bent(&network));
    let forces = loads(&pressed::<f64>(&network, from_ref(&faces), &x, 1));
    let size: f64 = forces.iter().map(|f| f.length()).sum();
    let sum: DVec3 = forces.iter().sum();
    let moment: DVec3 = x.iter().zip(&forces).map(|(x, f)| x.cross(*f)).sum();
    println!(
        "sum {:.1e}, moment {:.1e}",
        sum.length() / size,
        moment.length() / size
    );
    assert!(sum.length() < 1e-13 * size, "{sum}");
    assert!(moment.length() < 1e-13 * size, "{moment}");
    // The volume is cubic in the motion, for which differences of fourth order are exact.
    let way = some(x.len(), 3, 1e-3);
    let at = |by: f64| volume(&mesh, &moved(&x, by, &way));
    let change = (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / 12.0;
    let off = |forces: &[DVec3]| (dot(forces, &way) / (-PRESSURE * change) - 1.0).abs();
    let pieces = loads(&pressed::<f64>(&network, &apart(&faces), &x, 1));
    println!(
        "work: off by {:.1e}, of pieces {:.1e}",
        off(&forces),
        off(&pieces)
    );
    assert!(off(&forces) < 1e-9);
    assert!(off(&pieces) > 1e-3);
    // Partitioning among threads does not change the result, and single precision is near it.
    for (a, b) in forces
        .iter()
        .zip(loads(&pressed::<f64>(&network, from_ref(&faces), &x, 3)))
    {
        assert!(a.distance(b) < 1e-14 * size);
    }
    let single = loads(&pressed::<f32>(&network, from_ref(&faces), &x, 3));
    let off = forces.iter().zip(&single).map(|(a, b)| a.distance(*b));
    let off = off.fold(0.0, f64::max) / (size / forces.len() as f64);
    assert!(off < 1e-5, "{off}");
    // Without one face the surface is not closed.
    let open = pressed::<f64>(&network, &[faces[1..].to_vec()], &x, 1);
    let sum: DVec3 = loads(&open).iter().sum();
    assert!(sum.length() > 1e-4 * size);
}

#[test]
fn pressure_on_straight_faces_is_that_on_their_pieces() {
    let mesh = box_mesh([2; 3], DVec3::splat(0.1), Split::Six).unwrap();
    let mesh = mesh.with_mid_edge_nodes().unwrap();
    let network = network(&mesh, 0.3, 0.0);
    let faces = loaded(&mesh);
    let of =
        |x: &[DVec3], groups: &[Vec<LoadedFace>]| loads(&pressed::<f64>(&network, groups, x, 1));
    let off = |x: &[DVec3]| {
        let [whole, pieces] = [of(x, from_ref(&faces)), of(x, &apart(&faces))];
        let size: f64 = whole.iter().map(|f| f.length()).sum();
        let all = whole.iter().zip(&pieces);
        all.map(|(a, b)| a.distance(*b)).sum::<f64>() / size
    };
    assert!(off(&network.rest_positions) < 1e-14);
    assert!(off(&bent(&network)) > 1e-3);
}

#[test]
fn tangent_of_pressure_on_curved_faces_is_that_of_its_forces() {
    fn check<T: Real>(tolerance: f64) {
        let mesh = curved_ball();
        let network = network(&mesh, 0.3, 0.0);
        // An open surface, on which some faces lack a piece.
        let all = loaded(&mesh);
        let faces: Vec<LoadedFace> = all[all.len() / 3..].to_vec();
        let faces = [&faces[..40], &faces[41..]].concat();
        for chunks in [1, 3] {
            let body = pressed::<T>(&network, from_ref(&faces), &bent(&network), chunks);
            let u = &body.state.u;
            let local = |seed: u64| -> Vec<V4<T>> {
                let all = some(u.len(), seed, 1.0).into_iter();
                all.map(|d| from_metres(d, 10.0)).collect()
            };
            let (y, way) = (local(5), local(6));
            let product = |body: &CpuBody<T>, y: &[V4<T>], way: &[V4<T>]| -> f64 {
                let mut out = vec![zero(); u.len()];
                body.loads
                    .subtract_transposed_tangent(&body.plan, (u, y), &mut out);
                -inner(&out, way)
            };
            // Forces are quadratic in the displacements.
            let shifted = |by: fn(V4<T>, V4<T>) -> V4<T>| -> Vec<V4<T>> {
                u.iter().zip(&way).map(|(u, w)| by(*u, *w)).collect()
            };
            let [ahead, behind] = [add, sub].map(|by| loads_at(&body, &shifted(by)));
            let expected = 0.5 * (inner(&ahead, &y) - inner(&behind, &y));
            let off = |found: f64| (found / expected - 1.0).abs();
            let found = off(product(&body, &y, &way));
            println!("{chunks} chunks: off by {found:.1e}");
            assert!(found < tolerance, "{found}");
            // It is not symmetric, and not that of the pieces.
            let transposed = off(product(&body, &way, &y));
            let pieces = pressed::<T>(&network, &apart(&faces), &bent(&network), chunks);
            let of_pieces = off(product(&pieces, &y, &way));
            assert!(
                transposed > 1e-3 && of_pieces > 1e-3,
                "{transposed} {of_pieces}"
            );
        }
    }
    check::<f64>(1e-11);
    check::<f32>(1e-3);
}

fn inner<T: Real>(a: &[V4<T>], b: &[V4<T>]) -> f64 {
    let all = a.iter().zip(b);
    all.map(|(a, b)| to_metres(*a, 1.0).dot(to_metres(*b, 1.0)))
        .sum()
}

/// Returns the root of `of` between `low`, where it is negative, and `high`.
pub(super) fn root(of: impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2]) -> f64 {
    assert!(of(low) < 0.0 && of(high) > 0.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match of(middle) < 0.0 {
            true => low = middle,
            false => high = middle,
        }
    }
    0.5 * (low + high)
}

/// μ and λ′ of the stable Neo-Hookean law at this Poisson's ratio.
pub(super) fn moduli(poisson: f64) -> [f64; 2] {
    let mu = YOUNG / (2.0 * (1.0 + poisson));
    [mu, mu / (1.0 - 2.0 * poisson)]
}

#[test]
fn pressure_on_all_faces_has_uniform_hydrostatic_stress() {
    let mut mesh = box_mesh([3; 3], DVec3::splat(0.1), Split::Six).unwrap();
    // Irregular inside.
    let shifts = some(mesh.nodes.len(), 9, 0.006);
    for (p, shift) in mesh.nodes.iter_mut().zip(shifts) {
        let is_inside = p.min_element() > 1e-9 && p.max_element() < 0.1 - 1e-9;
        *p += if is_inside { shift } else { DVec3::ZERO };
    }
    let mesh = mesh.with_mid_edge_nodes().unwrap();
    let poisson = 0.3;
    let network = network(&mesh, poisson, 0.02);
    let faces = loaded(&mesh);
    let pressure = 0.2 * YOUNG;
    // σ = (μ (s² − s³) + λ′ (s³ − 1) s³)/s³ = −p at the stretch s.
    let [mu, lambda] = moduli(poisson);
    let stress = |s: f64| mu * (1.0 / s - 1.0) + lambda * (s.powi(3) - 1.0);
    let stretch = root(|s| stress(s) + pressure, [0.7, 1.0]);
    let turn = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7);
    let x: Vec<DVec3> = network
        .rest_positions
        .iter()
        .map(|p| stretch * (turn * *p))
        .collect();
    let mut body = body(&network, SolverKind::Implicit, 2);
    body.set_state(&x, &vec![DVec3::ZERO; x.len()]).unwrap();
    body.add_pressure(&faces, 0);
    let mut largest = |pressure: f64| {
        body.set_levels(&[pressure]);
        let forces = body.forces();
        forces.iter().map(|f| f.length()).fold(0.0, f64::max) / (pressure * 0.01)
    };
    let [exact, other] = [1.0, 1.001].map(|by| largest(by * pressure));
    println!("net force over p A: {exact:.1e}, at another pressure {other:.1e}");
    assert!(exact < 1e-13 && other > 1e-6);
    // A body at rest comes there by itself. Steps evaluate a pressure at their start, so that a free
    // body would slowly begin to turn in long ones.
    let pressure = 0.02 * YOUNG;
    let stretch = root(|s| stress(s) + pressure, [0.7, 1.0]);
    let start = &network.rest_positions;
    body.set_state(start, &vec![DVec3::ZERO; x.len()]).unwrap();
    body.set_levels(&[pressure]);
    body.run(100, 0.004).unwrap();
    let found = body.positions();
    let spread = |x: &[DVec3]| -> Vec<f64> {
        let middle = x.iter().sum::<DVec3>() / x.len() as f64;
        x.iter().map(|p| p.distance(middle)).collect()
    };
    for (now, then) in spread(&found).into_iter().zip(spread(start)) {
        assert!((now - stretch * then).abs() < 1e-6 * 0.1, "{now} {then}");
    }
}
