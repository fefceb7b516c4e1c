//! Tests of tools against closed formulas and finite differences.
#![allow(clippy::unwrap_used)]

use crate::generate::{Split, box_mesh};
use crate::mesh::{TetMesh, Topology};
use crate::physics::cpu::body::CpuBody;
use crate::physics::cpu::body::tests::some;
use crate::physics::cpu::implicit::contact_terms::tool_contact_mut;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::{V4, from_metres, to_metres};
use crate::physics::{
    CgSettings, DiscreteModel, Material, MaterialModel, Shape, SolverKind, Tool, ToolPose,
    VolumetricFormulation,
};
use glam::{DQuat, DVec3};

const YOUNG: f64 = 2e4;

/// A body with tools, and its model.
struct Pressed<T: Real> {
    body: CpuBody<T>,
    network: DiscreteModel,
    faces: Vec<[u32; 3]>,
}

fn material(poisson: f64) -> Material {
    Material {
        model: MaterialModel::NeoHookean,
        poisson,
        damping_time: 0.0,
        density: 1000.0,
        ..Material::from_young(YOUNG)
    }
}

fn boundary(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let topology = Topology::new(mesh);
    let boundary = topology.boundary.iter();
    boundary
        .map(|b| topology.boundary_nodes(mesh, *b))
        .collect()
}

impl<T: Real> Pressed<T> {
    fn new(mesh: &TetMesh, material: &Material, kind: SolverKind, chunks: usize) -> Pressed<T> {
        let network = DiscreteModel::new(mesh, material).unwrap();
        let settings = CgSettings::default();
        Pressed {
            body: CpuBody::new(&network, kind, settings, Some(chunks)).unwrap(),
            faces: boundary(mesh),
            network,
        }
    }

    fn add(&mut self, shape: Shape, at: DVec3, friction: f64) {
        let tool = tool(shape, at, friction);
        self.body.add_tool(&tool, &self.faces, &self.network);
    }

    /// Pins the nodes below a height at rest.
    fn pin(&mut self, mesh: &TetMesh, below: f64) -> Vec<bool> {
        let pinned: Vec<bool> = mesh.nodes.iter().map(|p| p.z < below).collect();
        self.body.set_pinned(&pinned).unwrap();
        pinned
    }

    /// Sets the target of the first tool at the end of the next step.
    fn guide(&mut self, to: DVec3) {
        let metres = self.network.to_metres(to);
        let guided = [(ToolPose::new(metres, DQuat::IDENTITY), 0)];
        self.body.set_tool_targets(&guided).unwrap();
    }

    /// Makes one step in which the first tool moves to `to`.
    fn go(&mut self, to: DVec3, dt: f64) {
        self.guide(to);
        self.body.run(1, dt).unwrap();
    }

    /// Returns the node positions in file units.
    fn places(&self) -> Vec<DVec3> {
        let metres = self.body.positions();
        metres.iter().map(|x| self.network.to_file(*x)).collect()
    }

    /// Returns the minimum distance of the boundary from a shape at `at`, sampled on a lattice on
    /// each face.
    fn nearest(&self, shape: &Shape, at: DVec3, parts: usize) -> f64 {
        let x = self.places();
        let mut least = f64::INFINITY;
        for face in &self.faces {
            let corners = face.map(|v| x[v as usize]);
            for i in 0..=parts {
                for j in 0..=parts - i {
                    let w = [i, j, parts - i - j].map(|n| n as f64 / parts as f64);
                    let p = w[0] * corners[0] + w[1] * corners[1] + w[2] * corners[2];
                    least = least.min(shape.distance(p - at));
                }
            }
        }
        least
    }
}

fn tool(shape: Shape, at: DVec3, friction: f64) -> Tool {
    Tool {
        shape,
        pose: ToolPose::new(at, DQuat::IDENTITY),
        friction,
        gap: None,
    }
}

/// Returns a block of height 1 that extends by 2 from its axis, refined at the centre of its top: of
/// 28 cells, 10 lie across a contact of radius ¼.
fn graded([wide, high]: [usize; 2]) -> TetMesh {
    let mut mesh = box_mesh([wide, wide, high], DVec3::splat(1.0), Split::Six).unwrap();
    let across = |s: f64| 0.68 * s + 1.32 * s.powi(5);
    for p in &mut mesh.nodes {
        let depth = 1.0 - p.z;
        *p = DVec3::new(
            across(2.0 * p.x - 1.0),
            across(2.0 * p.y - 1.0),
            -(0.5 * depth + 0.5 * depth.powi(3)),
        );
    }
    mesh
}

/// Returns the force of a rigid sphere of radius 1 at an indentation depth on a layer of thickness
/// 1 bonded below, over Young's modulus (Dimitriadis et al. 2002, "Determination of elastic moduli
/// of thin layers of soft material using the atomic force microscope", equation 12).
fn dimitriadis(depth: f64, poisson: f64) -> f64 {
    let nu = poisson;
    let a = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu);
    let b = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1.0 - nu);
    let (chi, pi) = (depth.sqrt(), std::f64::consts::PI);
    let cubic = 8.0 / pi.powi(3) * (a.powi(3) + 4.0 * pi * pi / 15.0 * b);
    let fourth = 16.0 * a / pi.powi(4) * (a.powi(3) + 3.0 * pi * pi / 5.0 * b);
    let series = 1.0 - 2.0 * a / pi * chi + 4.0 * a * a / (pi * pi) * chi.powi(2)
        - cubic * chi.powi(3)
        + fourth * chi.powi(4);
    4.0 / (3.0 * (1.0 - nu * nu)) * depth.powf(1.5) * series
}

/// Returns the force of a sphere pressed to `depth` into a block of `cells` cells, over the theory
/// of Hertz and Dimitriadis; and the force on the pins over it.
fn indented(
    cells: [usize; 2],
    depth: f64,
    poisson: f64,
    volume: VolumetricFormulation,
) -> [f64; 2] {
    let mesh = graded(cells);
    let mut material = material(poisson);
    material.volume = volume;
    let mut pressed = Pressed::<f64>::new(&mesh, &material, SolverKind::Implicit, 2);
    let pinned = pressed.pin(&mesh, -0.999);
    pressed.add(
        Shape::Sphere { radius: 1.0 },
        DVec3::new(0.0, 0.0, 1.01),
        0.0,
    );
    for k in 1..=4 {
        let at = 1.01 + (1.0 - depth - 1.01) * f64::from(k) / 4.0;
        pressed.go(DVec3::new(0.0, 0.0, at), 100.0);
    }
    for _ in 0..2 {
        pressed.go(DVec3::new(0.0, 0.0, 1.0 - depth), 100.0);
    }
    let [[force, _]] = pressed.body.tool_forces()[..] else {
        panic!("expected one tool")
    };
    let forces = pressed.body.forces();
    let held: DVec3 = forces
        .iter()
        .zip(&pinned)
        .filter(|(_, pinned)| **pinned)
        .map(|(f, _)| *f)
        .sum();
    let expected = YOUNG * dimitriadis(depth, poisson);
    [force.z / expected, -held.z / force.z]
}

#[test]
#[ignore = "long: ten tets across the contact area"]
fn sphere_indentation_matches_hertz_and_dimitriadis() {
    for (poisson, volume) in [
        (0.3, VolumetricFormulation::PerTet),
        (0.45, VolumetricFormulation::NodalAveraged),
    ] {
        let [force, held] = indented([28, 14], 0.06, poisson, volume);
        assert!((held - 1.0).abs() < 1e-3, "{held}");
        assert!((force - 1.0).abs() < 0.05, "{force}");
    }
}

#[test]
fn coarse_block_sphere_indentation_matches_theory() {
    let [force, held] = indented([12, 6], 0.06, 0.3, VolumetricFormulation::PerTet);
    assert!((held - 1.0).abs() < 1e-3, "{held}");
    assert!((force - 1.0).abs() < 0.2, "{force}");
}

/// Long because every function of the term is compared on one state.
///
/// Returns the relative errors of the forces, of the blocks and of the visited blocks of the tool
/// term against finite differences.
fn differences<T: Real>(pressed: &mut Pressed<T>, u: &[V4<T>], v: &[V4<T>]) -> [f64; 3] {
    let (free, plan) = (pressed.body.free_mask.clone(), pressed.body.plan.clone());
    let contact = tool_contact_mut(&mut pressed.body.terms).unwrap();
    assert_eq!(contact.begin(u, (&free, &plan), (0.1, 0.5)), 1);
    contact.set_tool_fraction(1.0);
    assert!(contact.update_lagged_friction(u) > 0.0);
    assert!(contact.has_contact(u));
    let n = u.len();
    let (count, h) = (plan.chunks(), 1e-7);
    let chunk = |c: usize| plan.range(c);
    let way: Vec<V4<T>> = some(n, 9, 1.0)
        .iter()
        .map(|w| from_metres(*w, 1.0))
        .collect();
    let off = |x: &[V4<T>], by: f64| -> Vec<V4<T>> {
        let moved = x.iter().zip(&way).map(|(x, w)| {
            let by = T::from_f64(by);
            std::array::from_fn(|k| x[k] + by * w[k])
        });
        moved.collect()
    };
    let energy = |contact: &dyn Term<T>, u: &[V4<T>], v: &[V4<T>]| -> f64 {
        let mut f = vec![[T::ZERO; 4]; n];
        (0..count)
            .map(|c| {
                let own = contact.damping_forces(c, StateRef { u, v }, &mut f[chunk(c)]);
                contact.energy(c, u) + own
            })
            .sum()
    };
    let forces = |contact: &dyn Term<T>, u: &[V4<T>], v: &[V4<T>]| -> Vec<V4<T>> {
        let mut f = vec![[T::ZERO; 4]; n];
        for c in 0..count {
            contact.forces(c, StateRef { u, v }, &mut f[chunk(c)]);
        }
        f
    };
    let dot = |f: &[V4<T>]| -> f64 {
        let pairs = f.iter().zip(&way);
        pairs
            .map(|(f, w)| to_metres(*f, 1.0).dot(to_metres(*w, 1.0)))
            .sum()
    };
    // Along u and v the forces are the negative derivatives of E and of the friction potential.
    let f = forces(contact, u, v);
    let along_u = (energy(contact, &off(u, h), v) - energy(contact, &off(u, -h), v)) / (2.0 * h);
    let along_v = (energy(contact, u, &off(v, h)) - energy(contact, u, &off(v, -h))) / (2.0 * h);
    let size: f64 = f.iter().map(|f| to_metres(*f, 1.0).length()).sum();
    let first = (along_u + along_v + dot(&f)).abs() / size;
    // A = −h ∂f/∂v − h² ∂f/∂u along the direction.
    let step = 0.3;
    let mut diagonal = vec![[T::ZERO; 8]; n];
    let mut change = vec![[T::ZERO; 4]; n];
    contact.set_psd_projection(false);
    let share = SystemContribution {
        diagonal: &mut diagonal,
        stiffness_velocity: &mut change,
    };
    contact.linearise(&plan, StateRef { u, v }, T::from_f64(step), share);
    let mut y = vec![[T::ZERO; 4]; n];
    for c in 0..count {
        contact.multiply(c, &way, &mut y[chunk(c)]);
    }
    let by_u = forces(contact, &off(u, h), v);
    let by_u = by_u.iter().zip(forces(contact, &off(u, -h), v));
    let by_v = forces(contact, u, &off(v, h));
    let by_v = by_v.iter().zip(forces(contact, u, &off(v, -h)));
    let (mut worst, mut largest) = (0.0f64, 0.0f64);
    for (((a, b), (c, d)), y) in by_u.zip(by_v).zip(&y) {
        let slope = |a: &V4<T>, b: &V4<T>| (to_metres(*b, 1.0) - to_metres(*a, 1.0)) / (2.0 * h);
        let expected = step * step * slope(a, &b) + step * slope(c, &d);
        worst = worst.max(expected.distance(to_metres(*y, 1.0)));
        largest = largest.max(expected.length());
    }
    // The diagonal and off-diagonal blocks give the same matrix.
    let mut z = vec![DVec3::ZERO; n];
    for (i, d) in diagonal.iter().enumerate() {
        z[i] += to_metres(
            crate::physics::cpu::vectors::apply_symmetric(d, way[i]),
            1.0,
        );
    }
    contact.visit_off_diagonal(&mut |[i, j], m| {
        let (i, j) = (i as usize, j as usize);
        z[i] += *m * to_metres(way[j], 1.0);
        z[j] += *m * to_metres(way[i], 1.0);
    });
    let apart = z
        .iter()
        .zip(&y)
        .map(|(z, y)| z.distance(to_metres(*y, 1.0)));
    let apart = apart.fold(0.0, f64::max);
    [first, worst / largest, apart / largest]
}

#[test]
fn tool_forces_and_blocks_match_finite_differences() {
    let mesh = box_mesh([4, 4, 3], DVec3::new(1.0, 1.0, 0.75), Split::Five).unwrap();
    let shapes = [
        Shape::Sphere { radius: 0.3 },
        Shape::Capsule {
            radius: 0.2,
            length: 0.3,
        },
        Shape::Box {
            half: DVec3::new(0.3, 0.2, 0.1),
        },
    ];
    for shape in shapes {
        let mut pressed = Pressed::<f64>::new(&mesh, &material(0.3), SolverKind::Implicit, 3);
        let deep = match &shape {
            Shape::Sphere { radius } => *radius,
            Shape::Capsule { radius, length } => radius + 0.5 * length,
            Shape::Box { half } => half.z,
            _ => 0.0,
        };
        // Slightly above the top, which is perturbed.
        let at = DVec3::new(0.47, 0.52, 0.75 + deep + 0.02);
        let tool = Tool {
            gap: Some(0.08),
            ..tool(shape.clone(), at, 0.4)
        };
        let faces = pressed.faces.clone();
        pressed.body.add_tool(&tool, &faces, &pressed.network);
        let to = at + DVec3::new(0.01, 0.02, 0.0);
        pressed.guide(to);
        let n = pressed.body.state.u.len();
        let local = |x: &DVec3| from_metres(*x, 1.0);
        let u: Vec<V4<f64>> = some(n, 3, 0.004).iter().map(local).collect();
        for speed in [1e-5, 2.0] {
            let v: Vec<V4<f64>> = some(n, 5, speed).iter().map(local).collect();
            let [first, second, apart] = differences(&mut pressed, &u, &v);
            assert!(first < 1e-6, "{shape:?}: {first}");
            assert!(second < 1e-5, "{shape:?} at {speed}: {second}");
            assert!(apart < 1e-12, "{shape:?}: {apart}");
        }
    }
}

/// Returns the distance that a block has slid on a plane with friction ½ inclined by `degrees`,
/// after ¼ and ½ of a second, in its edge lengths.
fn slid(degrees: f64) -> [f64; 2] {
    let edge = 0.1;
    let mesh = box_mesh([3, 3, 2], DVec3::new(edge, edge, 0.5 * edge), Split::Five).unwrap();
    let mut pressed = Pressed::<f64>::new(&mesh, &material(0.3), SolverKind::Implicit, 1);
    pressed.add(Shape::Plane, DVec3::new(0.0, 0.0, -1e-3), 0.5);
    pressed.body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
    pressed.body.run(40, 0.01).unwrap();
    let angle = degrees.to_radians();
    let down = DVec3::new(angle.sin(), 0.0, -angle.cos());
    // Tilted gradually to avoid oscillations.
    for k in 1..=20 {
        let part = (f64::from(k) / 20.0 * degrees).to_radians();
        let way = DVec3::new(part.sin(), 0.0, -part.cos());
        pressed.body.set_gravity(9.81 * way);
        pressed.body.run(1, 0.01).unwrap();
    }
    pressed.body.set_gravity(9.81 * down);
    let along = |pressed: &Pressed<f64>| {
        let x = pressed.places();
        x.iter().map(|x| x.x).sum::<f64>() / (edge * x.len() as f64)
    };
    let start = along(&pressed);
    [(); 2].map(|()| {
        pressed.body.run(25, 0.01).unwrap();
        along(&pressed) - start
    })
}

#[test]
fn block_sticks_below_friction_angle_and_slides_above() {
    let angle = 0.5f64.atan().to_degrees();
    let [quarter, half] = slid(angle - 1.0);
    // When sticking, it creeps at less than the regularisation speed of the friction.
    assert!((half - quarter).abs() < 0.25 * 1e-4, "{quarter} {half}");
    let [quarter, half] = slid(angle + 1.0);
    let steep = (angle + 1.0).to_radians();
    let acceleration = 9.81 * (steep.sin() - 0.5 * steep.cos());
    // It begins to slide during the tilt and thus has an initial velocity.
    let expected = acceleration * 0.25f64.powi(2) / 0.1;
    let curve = half - 2.0 * quarter;
    assert!((curve / expected - 1.0).abs() < 0.05, "{curve} {expected}");
}

/// The lower side of a block sticks to a plane that is pressed against it and moves sideways, whatever
/// the scheme: also where forces are evaluated in the middle of a step.
#[test]
fn block_sticks_to_moving_plane() {
    for kind in [SolverKind::Implicit, SolverKind::Bdf2, SolverKind::Midpoint] {
        let mesh = box_mesh([3, 3, 2], DVec3::new(0.1, 0.1, 0.05), Split::Five).unwrap();
        let mut pressed = Pressed::<f64>::new(&mesh, &material(0.3), kind, 1);
        let below = DVec3::new(0.0, 0.0, -1e-3);
        pressed.add(Shape::Plane, below, 0.5);
        let pinned = mesh.nodes.iter().map(|p| p.z > 0.049).collect::<Vec<_>>();
        pressed.body.set_pinned(&pinned).unwrap();
        let steps = |count: u32| (1..=count).map(move |k| f64::from(k) / f64::from(count));
        for share in steps(20) {
            pressed.go(below + DVec3::Z * (3e-3 * share), 0.01);
        }
        let lower = |pressed: &Pressed<f64>| {
            let x = pressed.places().into_iter().zip(&mesh.nodes);
            let (sum, count) = x
                .filter(|(_, rest)| rest.z < 1e-9)
                .fold((0.0, 0.0), |(sum, count), (x, _)| (sum + x.x, count + 1.0));
            sum / count
        };
        let (start, pressed_plane) = (lower(&pressed), below + DVec3::Z * 3e-3);
        let way = 2e-4;
        for share in steps(20) {
            pressed.go(pressed_plane + DVec3::X * (way * share), 0.01);
        }
        let moved = lower(&pressed) - start;
        assert!((moved / way - 1.0).abs() < 0.1, "{kind}: {moved} m");
    }
}

#[test]
fn fast_sphere_has_no_tunnelling() {
    let mesh = box_mesh([10, 10, 5], DVec3::new(1.0, 1.0, 0.5), Split::Five).unwrap();
    let shape = Shape::Sphere { radius: 0.15 };
    let mut pressed = Pressed::<f64>::new(&mesh, &material(0.3), SolverKind::Implicit, 2);
    pressed.pin(&mesh, 1e-3);
    let mut at = DVec3::new(0.3, 0.5, 0.8);
    pressed.add(shape.clone(), at, 0.3);
    pressed.body.set_inversion_allowed(true);
    let down = DVec3::new(0.0, 0.0, -0.15);
    let aside = DVec3::new(0.15, 0.0, 0.0);
    for way in [down, down, aside, aside, aside, -down] {
        at += way;
        pressed.go(at, 0.01);
        let nearest = pressed.nearest(&shape, at, 6);
        assert!(nearest > -0.15 / 64.0, "{nearest} at {at}");
        let nodes = pressed.nearest(&shape, at, 1);
        assert!(nodes > 0.0, "{nodes} at {at}");
    }
}

#[test]
fn tool_forces_agree_across_precisions_and_threads() {
    fn force<T: Real>(chunks: usize) -> [f64; 6] {
        let mesh = box_mesh([6, 6, 6], DVec3::splat(0.1), Split::Five).unwrap();
        let mut pressed = Pressed::<T>::new(&mesh, &material(0.4), SolverKind::Bdf2, chunks);
        pressed.pin(&mesh, 1e-4);
        let start = DVec3::new(0.05, 0.05, 0.125);
        pressed.add(Shape::Sphere { radius: 0.02 }, start, 0.3);
        for k in 1..=12 {
            let way = f64::from(k) / 12.0 * DVec3::new(0.01, 0.0, -0.02);
            pressed.go(start + way, 0.05);
        }
        let [[force, moment]] = pressed.body.tool_forces()[..] else {
            panic!("expected one tool")
        };
        let [a, b, c] = force.to_array();
        let [d, e, f] = (moment / 0.02).to_array();
        [a, b, c, d, e, f]
    }
    let truth = force::<f64>(1);
    let size = truth.iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!(truth[2] > 0.05 && -truth[0] > 0.1 * truth[2], "{truth:?}");
    // Steps are solved until contact forces change by 10⁻³ and lagged friction by 3·10⁻³.
    for (other, tolerance) in [(force::<f64>(3), 4e-3), (force::<f32>(2), 1e-2)] {
        for (a, b) in truth.iter().zip(other) {
            assert!((a - b).abs() < tolerance * size, "{truth:?} {other:?}");
        }
    }
}

/// A body that was pressed elsewhere before takes the same steps from a restored state as a new one, and one
/// in contact those of an uninterrupted run.
#[test]
fn restored_body_takes_same_steps_whatever_was_pressed_before() {
    let mesh = box_mesh([6, 6, 6], DVec3::splat(0.1), Split::Five).unwrap();
    for kind in [SolverKind::Implicit, SolverKind::Bdf2, SolverKind::Midpoint] {
        for friction in [0.0, 0.3] {
            let make = || {
                let mut pressed = Pressed::<f64>::new(&mesh, &material(0.4), kind, 2);
                pressed.pin(&mesh, 1e-4);
                let above = DVec3::new(0.05, 0.05, 0.125);
                pressed.add(Shape::Sphere { radius: 0.02 }, above, friction);
                pressed
            };
            let press = |pressed: &mut Pressed<f64>, at: DVec3, steps: std::ops::Range<u32>| {
                for k in steps {
                    let way = f64::from(k) / 6.0 * DVec3::new(0.005, 0.0, -0.012);
                    pressed.go(at + way, 0.05);
                }
            };
            let [here, there] = [0.05, 0.03].map(|x| DVec3::new(x, 0.05, 0.122));
            let mut whole = make();
            let rest = whole.body.state();
            press(&mut whole, here, 0..4);
            let middle = whole.body.state();
            press(&mut whole, here, 4..7);
            let moved = whole.body.displacements();
            assert!(moved.iter().flatten().any(|x| x.abs() > 1e-3), "{kind}");
            let mut used = make();
            press(&mut used, there, 0..7);
            used.body.resume(&rest).unwrap();
            press(&mut used, here, 0..7);
            assert_eq!(used.body.state(), whole.body.state(), "{kind}");
            let mut late = make();
            late.body.resume(&middle).unwrap();
            press(&mut late, here, 4..7);
            assert_eq!(late.body.state(), whole.body.state(), "{kind}");
        }
    }
}

#[test]
fn initially_penetrating_nodes_are_pushed_out() {
    let mesh = box_mesh([6, 6, 3], DVec3::new(1.0, 1.0, 0.5), Split::Five).unwrap();
    let shape = Shape::Sphere { radius: 0.3 };
    let mut pressed = Pressed::<f64>::new(&mesh, &material(0.3), SolverKind::Implicit, 2);
    pressed.pin(&mesh, 1e-3);
    let at = DVec3::new(0.5, 0.5, 0.7);
    let tool = tool(shape.clone(), at, 0.0);
    let overlap = tool.initial_penetration(&mesh, &Topology::new(&mesh));
    assert!(
        overlap.nodes > 0 && (overlap.depth - 0.1).abs() < 1e-9,
        "{overlap:?}"
    );
    let faces = pressed.faces.clone();
    pressed.body.add_tool(&tool, &faces, &pressed.network);
    pressed.body.run(3, 0.05).unwrap();
    assert!(pressed.nearest(&shape, at, 1) > 0.0);
    assert!(pressed.body.tool_forces()[0][0].z > 0.0);
}

#[test]
fn distant_tool_leaves_steps_unchanged() {
    let mesh = box_mesh([4, 4, 4], DVec3::splat(1.0), Split::Five).unwrap();
    let run = |tools: bool| {
        let mut pressed = Pressed::<f64>::new(&mesh, &material(0.3), SolverKind::Implicit, 1);
        pressed.pin(&mesh, 1e-3);
        pressed.body.set_gravity(DVec3::new(3.0, 0.0, -9.81));
        if tools {
            pressed.add(Shape::Sphere { radius: 0.2 }, DVec3::splat(5.0), 0.5);
        }
        pressed.body.run(5, 0.02).unwrap();
        pressed.body.displacements()
    };
    assert_eq!(run(true), run(false));
}
