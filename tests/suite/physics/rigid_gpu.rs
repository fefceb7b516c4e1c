//! Rigid regions on the GPU against the CPU engine in float64.

use crate::support::gpu;
use glam::{DQuat, DVec3};
use palpate::generate;
use palpate::mesh::{Field, Location, TetMesh};
use palpate::physics::{
    CgSettings, CpuTets, Floor, GpuTets, GrabMode, Material, MaterialModel, Precision,
    RegionMaterial, Simulator, SolverKind,
};
use std::sync::Arc;

const SIZE: DVec3 = DVec3::new(0.8, 0.2, 0.2);

/// Returns a soft bar in which `bone` (in fractions of its size) is rigid with the given density.
fn bar(cells: [usize; 3], bone: impl Fn(DVec3) -> bool, density: f64) -> (TetMesh, Material) {
    let mut mesh = generate::bar(cells, SIZE).unwrap();
    let labels = (0..mesh.tets.len()).map(|t| {
        let middle = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
        f64::from(u8::from(bone(middle / SIZE)))
    });
    let labels = Field::scalar("label", Location::Cell, labels.collect());
    mesh.set_field(labels).unwrap();
    let mut material = Material {
        model: MaterialModel::NeoHookean,
        poisson: 0.3,
        damping_time: 1e-3,
        region_field: Some("label".into()),
        ..Material::from_young(1e5)
    };
    let made = RegionMaterial {
        stiffness: 1e5,
        density,
        poisson: 0.3,
    };
    material.regions.insert(1, made);
    material.rigid.insert(1);
    (mesh, material)
}

const SOLVES: CgSettings = CgSettings {
    tolerance: 1e-5,
    acceptable: 1e-3,
    max_iterations: 2000,
};

fn on_gpu((mesh, material): &(TetMesh, Material)) -> GpuTets {
    let mut body = GpuTets::new(&gpu(), mesh.clone(), material, SolverKind::Implicit).unwrap();
    body.set_integrator(SolverKind::Implicit, SOLVES).unwrap();
    body
}

/// Minimised to `tolerance`.
fn on_cpu((mesh, material): &(TetMesh, Material), tolerance: f64) -> CpuTets {
    let settings = CgSettings {
        tolerance,
        ..CgSettings::default()
    };
    let kind = SolverKind::Implicit;
    CpuTets::new(
        &gpu(),
        mesh.clone(),
        material,
        kind,
        settings,
        Precision::Double,
    )
    .unwrap()
}

fn nodes(body: &dyn Simulator, which: impl Fn(DVec3) -> bool) -> Vec<u32> {
    let all = body.mesh().nodes.iter().enumerate();
    all.filter(|(_, p)| which(**p))
        .map(|(i, _)| i as u32)
        .collect()
}

/// Returns the positions after `steps` steps, pinned at the low end, under gravity.
fn swung(body: &mut dyn Simulator, steps: u32) -> Vec<DVec3> {
    let end = nodes(body, |p| p.x < 1e-9);
    body.pin_nodes(&end).unwrap();
    body.loads_mut().set_gravity(DVec3::new(0.0, 2.0, -9.81));
    body.run(steps, 0.01).unwrap();
    body.positions().unwrap()
}

/// Returns the distance of `a` from `b`, relative to the displacement of `b` from rest.
fn apart(mesh: &TetMesh, a: &[DVec3], b: &[DVec3]) -> f64 {
    let square = |a: &[DVec3], b: &[DVec3]| -> f64 {
        a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum()
    };
    (square(a, b) / square(b, &mesh.nodes)).sqrt()
}

/// Returns the largest change of distances between nodes of rigid bodies.
fn strained(body: &dyn Simulator, x: &[DVec3]) -> f64 {
    let rest = &body.mesh().nodes;
    let mut worst = 0.0f64;
    for rigid in body.model().unwrap().rigid_bodies() {
        let some: Vec<usize> = rigid.nodes.iter().step_by(3).map(|v| *v as usize).collect();
        for a in &some {
            for b in &some {
                let off = x[*a].distance(x[*b]) - rest[*a].distance(rest[*b]);
                worst = worst.max(off.abs());
            }
        }
    }
    worst
}

/// Returns the momentum, and the angular momentum about the origin.
fn momenta(body: &dyn Simulator) -> (DVec3, DVec3) {
    let (x, v) = (body.positions().unwrap(), body.velocities().unwrap());
    let all = || body.masses().iter().zip(&x).zip(&v);
    (
        all().map(|((m, _), v)| *m * *v).sum(),
        all().map(|((m, x), v)| *m * x.cross(*v)).sum(),
    )
}

type Bone = fn(DVec3) -> bool;

/// A block inside, a rod through all but the pinned end, two bones with a joint between them.
const BONES: [(&str, Bone, usize); 3] = [
    (
        "block",
        |p| (p - DVec3::new(0.6, 0.5, 0.5)).abs().max_element() < 0.2,
        1,
    ),
    ("rod", |p| p.x > 0.25 && p.y < 0.3, 1),
    ("two", |p| p.x > 0.2 && (p.x - 0.6).abs() > 0.1, 2),
];

#[test]
fn rigid_regions_match_cpu_motion() {
    for (name, bone, count) in BONES {
        let scene = bar([10, 5, 5], bone, 1900.0);
        let (mut fast, mut truth) = (on_gpu(&scene), on_cpu(&scene, 1e-9));
        assert_eq!(fast.model().unwrap().rigid_bodies().len(), count);
        let found = swung(&mut fast, 40);
        let there = swung(&mut truth, 40);
        let off = apart(&scene.0, &found, &there);
        // The check is effective: a bone of another density has another inertia.
        let heavier = bar([10, 5, 5], bone, 2100.0);
        let other = swung(&mut on_cpu(&heavier, 1e-9), 40);
        let control = apart(&scene.0, &found, &other);
        let way = found
            .iter()
            .zip(&scene.0.nodes)
            .map(|(a, b)| a.distance(*b));
        let iterations = fast.iterations().unwrap();
        println!(
            "{name}: {off:.1e} apart, {control:.1e} with a bone denser by a tenth; nodes move {:.3} m; distances change by {:.1e} m; iterations {:?}",
            way.fold(0.0, f64::max),
            strained(&fast, &found),
            &iterations[iterations.len() - 4..],
        );
        assert!(off < 1e-3 && control > 4.0 * off, "{name} {off} {control}");
        assert!(strained(&fast, &found) < 5e-7);
    }
}

#[test]
fn rigid_regions_keep_their_shape() {
    let scene = bar([8, 4, 4], |p| p.x > 0.5, 1900.0);
    let mut body = on_gpu(&scene);
    let mut worst = 0.0f64;
    for _ in 0..20 {
        let x = swung(&mut body, 20);
        worst = worst.max(strained(&body, &x));
    }
    println!("distances change by {worst:.1e} m in 400 steps");
    // For positions in f32 in a frame of 0.8 m.
    assert!(worst < 5e-7, "{worst}");
}

/// Free, rotating and translating: momentum is conserved, and angular momentum agrees with the CPU.
#[test]
fn free_rigid_rotation_matches_cpu() {
    for (name, bone) in [("all", (|_| true) as Bone), ("half", |p| p.x > 0.5)] {
        let scene = bar([4, 3, 2], bone, 1900.0);
        let (whirl, fly) = (DVec3::new(3.0, 1.0, -0.5), DVec3::new(0.3, 0.1, 0.2));
        let spun = |body: &mut dyn Simulator| {
            let nodes = body.mesh().nodes.iter();
            let v = nodes.map(|x| fly + whirl.cross(*x)).collect::<Vec<_>>();
            body.set_velocities(&v).unwrap();
            let before = momenta(body);
            body.run(80, 0.005).unwrap();
            (before, momenta(body), body.positions().unwrap())
        };
        let (start, end, x) = spun(&mut on_gpu(&scene));
        let (_, there, y) = spun(&mut on_cpu(&scene, 1e-9));
        let kept = end.0.distance(start.0) / start.0.length();
        let [lost, by] = [end.1, there.1].map(|l| l.distance(start.1) / start.1.length());
        let off = apart(&scene.0, &x, &y);
        println!(
            "{name}: momentum changes by {kept:.1e}, its moment by {lost:.3e}, on the CPU {by:.3e}; {off:.1e} apart"
        );
        assert!(kept < 1e-5, "{name} {kept}");
        assert!(end.1.distance(there.1) < 1e-3 * start.1.length(), "{name}");
        assert!(off < 1e-3, "{name} {off}");
    }
}

/// Rigid-body modes that pins leave to a bone: rotation about a point, rotation about an axis,
/// none.
#[test]
fn rigid_regions_rotate_about_pins() {
    let scene = bar([6, 3, 3], |_| true, 1900.0);
    let pinned = |body: &dyn Simulator, count: usize| -> Vec<u32> {
        let corners = [
            DVec3::ZERO,
            DVec3::new(0.0, 0.2, 0.0),
            DVec3::new(0.0, 0.0, 0.2),
        ];
        let at = |c: &DVec3| nodes(body, |p| p.distance(*c) < 1e-9)[0];
        corners[..count].iter().map(at).collect()
    };
    for count in 1..=3 {
        let swing = |body: &mut dyn Simulator| {
            let held = pinned(body, count);
            body.pin_nodes(&held).unwrap();
            body.loads_mut().set_gravity(DVec3::new(0.0, 5.0, -9.81));
            body.run(60, 0.005).unwrap();
            (held, body.positions().unwrap())
        };
        let (held, x) = swing(&mut on_gpu(&scene));
        let (_, y) = swing(&mut on_cpu(&scene, 1e-9));
        let rest = &scene.0.nodes;
        let stays = |v: &u32| x[*v as usize].distance(rest[*v as usize]) < 1e-7;
        assert!(held.iter().all(stays), "{count} pins");
        if count == 3 {
            assert!((0..rest.len() as u32).all(|v| stays(&v)));
            continue;
        }
        let off = apart(&scene.0, &x, &y);
        println!("{count} pins: {off:.1e} apart");
        assert!(off < 1e-3, "{count} pins: {off}");
    }
}

/// Grabbed nodes move a bone, and the soft tissue with it.
#[test]
fn rigid_regions_follow_grabs() {
    let scene = bar([8, 4, 4], |p| p.x > 0.5, 1900.0);
    for grip in [
        GrabMode::Follow,
        GrabMode::Spring {
            stiffness: 2e4,
            limit: 1e4,
        },
    ] {
        let led = |body: &mut dyn Simulator| {
            let end = nodes(body, |p| p.x < 1e-9);
            body.pin_nodes(&end).unwrap();
            let from = DVec3::new(0.8, 0.1, 0.1);
            let grab = body.grab(from, 0.08, grip).unwrap();
            for k in 1..=20 {
                let to = from + 0.005 * f64::from(k) * DVec3::new(0.0, 0.3, 1.0);
                body.loads_mut().set_target(grab, to).unwrap();
                body.run(1, 0.01).unwrap();
            }
            let along = body.positions().unwrap();
            body.loads_mut().release(grab).unwrap();
            body.run(20, 0.01).unwrap();
            (along, body.positions().unwrap())
        };
        let mut fast = on_gpu(&scene);
        let (x, later) = led(&mut fast);
        let (y, there) = led(&mut on_cpu(&scene, 1e-9));
        let off = [apart(&scene.0, &x, &y), apart(&scene.0, &later, &there)];
        println!(
            "{grip:?}: {off:?} apart, {:.1e} m strained",
            strained(&fast, &x)
        );
        assert!(strained(&fast, &x) < 5e-7 && strained(&fast, &later) < 5e-7);
        assert!(off[0] < 2e-3 && off[1] < 1e-2, "{grip:?} {off:?}");
    }
}

/// Forces at any node of a bone, its weight, and a floor under it.
#[test]
fn forces_act_at_any_node_of_rigid_region() {
    let scene = bar([6, 4, 4], |p| p.x < 0.7, 1900.0);
    let inside = DVec3::new(0.8 / 6.0, 0.1, 0.15);
    let pushed = |body: &mut dyn Simulator| {
        let at = nodes(body, |p| p.distance(inside) < 1e-6);
        assert_eq!(at.len(), 1);
        body.loads_mut()
            .add_force(DVec3::new(4.0, 30.0, 60.0), &at)
            .unwrap();
        body.loads_mut().set_gravity(DVec3::new(0.0, 0.0, -9.81));
        let floor = Floor::new(DVec3::new(0.0, 0.0, -0.11), DVec3::Z, 200.0).unwrap();
        body.add_term(Arc::new(floor)).unwrap();
        body.run(50, 0.01).unwrap();
        body.positions().unwrap()
    };
    let mut fast = on_gpu(&scene);
    let x = pushed(&mut fast);
    let y = pushed(&mut on_cpu(&scene, 1e-9));
    let off = apart(&scene.0, &x, &y);
    println!("{off:.1e} apart");
    assert!(off < 5e-3, "{off}");
}

/// The pose follows from the positions: these may be set far from rest, and need not be exactly
/// rigid.
#[test]
fn poses_are_fitted_to_positions() {
    let scene = bar([8, 4, 4], |p| p.x > 0.5, 1900.0);
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 2.8);
    let place = |p: &DVec3| turn * *p + DVec3::new(0.1, 0.2, -0.3);
    let mut x: Vec<DVec3> = scene.0.nodes.iter().map(place).collect();
    let mut body = on_gpu(&scene);
    body.set_positions(&x).unwrap();
    body.run(5, 0.01).unwrap();
    let off = body.positions().unwrap();
    let off = off.iter().zip(&x).map(|(a, b)| a.distance(*b));
    let off = off.fold(0.0, f64::max);
    println!("fitted to the set positions within {off:.1e} m");
    assert!(off < 1e-5, "{off}");
    // A single displaced node of the bone is projected back.
    let bone = body.model().unwrap().rigid_bodies()[0].nodes[3] as usize;
    x[bone] += DVec3::new(0.01, 0.0, 0.0);
    body.set_positions(&x).unwrap();
    body.run(1, 0.01).unwrap();
    let now = body.positions().unwrap();
    assert!(strained(&body, &now) < 1e-6);
    assert!(now[bone].distance(x[bone]) > 8e-3);
}
