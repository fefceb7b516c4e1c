//! Grid bodies: shapes, their model, Verlet on the GPU against float64.

use crate::physics::common::Noise;
use glam::{DMat3, DVec3};
use palpate::Error;
use palpate::gpu::Gpu;
use palpate::mesh::{Blade, Topology, pack_normal, unpack_normal};
use palpate::mesher::Domain;
use palpate::physics::grid::reference::GridReference;
use palpate::physics::grid::{GridModel, GridShape};
use palpate::physics::{GrabMode, GridBody, Material, RegionMaterial};

/// A box, containing a second region from x = 0 on.
struct Block {
    half: DVec3,
}

impl Domain for Block {
    fn bounds(&self) -> (DVec3, DVec3) {
        (-self.half, self.half)
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        let inside = (self.half - p.abs()).min_element() + 1e-9;
        weights.push((if p.x < 0.0 { 1 } else { 2 }, inside));
    }
}

struct Ball(f64);

impl Domain for Ball {
    fn bounds(&self) -> (DVec3, DVec3) {
        (DVec3::splat(-self.0), DVec3::splat(self.0))
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        weights.push((1, self.0 - p.length()));
    }
}

fn ball(wanted: usize) -> GridShape {
    GridShape::from_domain_with_count(&Ball(0.05), wanted, DMat3::IDENTITY).unwrap()
}

fn soft() -> Material {
    Material {
        density: 1000.0,
        ..Material::from_young(1e4)
    }
}

#[test]
fn ball_grid_has_requested_particle_count() {
    for (wanted, filled) in [(500, 0.5824), (5000, 0.7985)] {
        let shape = ball(wanted);
        let off = shape.count() as f64 / wanted as f64 - 1.0;
        assert!(off.abs() < 0.1, "{} for {wanted}", shape.count());
        let mesh = shape.mesh(&shape.springs()).unwrap();
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.05f64.powi(3);
        // Only full cells count, and the ball is 10 or 20 cells wide.
        let share = mesh.volume() / exact;
        assert!((share - filled).abs() < 1e-3, "{share}");
        assert!(
            mesh.tets
                .iter()
                .flatten()
                .all(|v| shape.regions[*v as usize] != 0)
        );
        let topology = Topology::new(&mesh);
        assert_eq!(palpate::mesh::components(&topology).1, 1);
    }
}

#[test]
fn springs_are_symmetric_and_between_particles_only() {
    let shape = GridShape::from_domain(
        &Ball(1.0),
        DVec3::new(0.2, 0.25, 0.3),
        DMat3::from_rotation_z(0.3),
    )
    .unwrap();
    let (springs, offsets) = (shape.springs(), shape.offsets());
    let mut met = 0;
    for i in shape.particles() {
        for (k, offset) in offsets.iter().enumerate() {
            for (bit, sign) in [(2 * k, 1), (2 * k + 1, -1)] {
                let j = (i as i64 + sign * offset) as usize;
                let there = springs[i] >> bit & 1 == 1;
                assert_eq!(there, shape.regions[j] != 0);
                if there {
                    assert_eq!(springs[j] >> (bit ^ 1) & 1, 1);
                    let length = shape.rest_position(i).distance(shape.rest_position(j));
                    assert!((length - shape.rest_lengths()[k]).abs() < 1e-12);
                    met += 1;
                }
            }
        }
    }
    assert!(met > 1000);
}

#[test]
fn grid_has_its_modulus_at_any_spacing() {
    // The stiffness tensor of the springs of one cell, against λ = μ = E / 2.5.
    for spacing in [DVec3::splat(0.01), DVec3::new(0.01, 0.011, 0.009)] {
        let shape = GridShape::from_domain(&Ball(0.05), spacing, DMat3::IDENTITY).unwrap();
        let model = GridModel::new(shape, &soft()).unwrap();
        let volume = spacing.x * spacing.y * spacing.z;
        let mut tensor = [[0.0; 3]; 3];
        for (k, step) in GridShape::SPRING_OFFSETS.iter().enumerate() {
            let along = spacing * DVec3::from(step.map(|n| n as f64));
            let (l, n) = (along.length(), along.normalize());
            for a in 0..3 {
                for b in 0..3 {
                    tensor[a][b] += model.stiffness[k] * l * l * n[a] * n[a] * n[b] * n[b] / volume;
                }
            }
        }
        for a in 0..3 {
            for b in 0..3 {
                let wanted = if a == b { 3.0 } else { 1.0 } * 1e4 / 2.5;
                assert!((tensor[a][b] / wanted - 1.0).abs() < 1e-9, "{tensor:?}");
            }
        }
    }
    let flat = GridShape::from_domain(&Ball(0.05), DVec3::new(0.01, 0.01, 0.003), DMat3::IDENTITY);
    let error = GridModel::new(flat.unwrap(), &soft()).unwrap_err();
    assert!(error.to_string().contains("spacings that differ less"));
}

#[test]
fn thin_sheets_are_reported() {
    let thick = GridShape::from_domain(
        &Block {
            half: DVec3::new(0.5, 0.5, 0.2),
        },
        DVec3::splat(0.1),
        DMat3::IDENTITY,
    )
    .unwrap();
    assert_eq!(thick.undefined_normal_particles().len(), 0);
    let sheet = GridShape::from_domain(
        &Block {
            half: DVec3::new(0.5, 0.5, 0.01),
        },
        DVec3::new(0.1, 0.1, 0.02),
        DMat3::IDENTITY,
    )
    .unwrap();
    // One or two layers, depending on the alignment of the grid.
    let layers = sheet.count() / 121;
    assert_eq!(
        sheet.undefined_normal_particles().is_empty(),
        layers > 1,
        "{layers} layers"
    );
    let error = sheet.mesh(&sheet.springs());
    assert_eq!(error.is_err(), layers == 1);
}

/// Returns the body and its reference, perturbed.
fn twins(gpu: &Gpu, material: &Material, noise: &mut Noise) -> (GridBody, GridReference) {
    let shape = GridShape::from_domain(
        &Block {
            half: DVec3::new(0.05, 0.03, 0.02),
        },
        DVec3::new(0.01, 0.0105, 0.0095),
        DMat3::from_rotation_x(0.4),
    )
    .unwrap();
    let mut model = GridModel::new(shape, material).unwrap();
    model.damping = 3.0;
    let mut truth = model.reference();
    let mut body = GridBody::new(gpu, model).unwrap();
    let unit = body.model().length_unit;
    let pinned: Vec<u32> = truth.particles.iter().copied().take(40).collect();
    body.pin_nodes(&pinned).unwrap();
    for i in &pinned {
        truth.inverse_masses[*i as usize] = 0.0;
    }
    let gravity = DVec3::new(1.0, -9.0, 2.0);
    body.set_gravity(gravity);
    truth.gravity = gravity;
    let forces: Vec<DVec3> = noise
        .vectors(truth.x.len())
        .iter()
        .map(|f| 1e-3 * *f)
        .collect();
    body.set_forces(&forces).unwrap();
    truth.forces = forces;
    // Both start from the values rounded to f32.
    let moved: Vec<DVec3> = body
        .mesh()
        .nodes
        .iter()
        .map(|p| *p + 1e-3 / unit * noise.vector())
        .collect();
    body.set_positions(&moved).unwrap();
    let frame = body.model().frame;
    truth.x = body
        .positions()
        .unwrap()
        .iter()
        .map(|p| (*p - frame.origin) * unit)
        .collect();
    (body, truth)
}

/// Returns the largest distance between the body and the reference, in metres.
fn apart(body: &GridBody, truth: &GridReference) -> f64 {
    let frame = body.model().frame;
    let unit = body.model().length_unit;
    let found = body.positions().unwrap();
    truth
        .particles
        .iter()
        .map(|i| *i as usize)
        .map(|i| ((found[i] - frame.origin) * unit).distance(truth.x[i]))
        .fold(0.0, f64::max)
}

#[test]
fn grid_steps_match_reference() {
    let gpu = Gpu::new().unwrap();
    let mut material = soft();
    material.length_unit = 0.5;
    material.regions.insert(
        2,
        RegionMaterial {
            stiffness: 3e4,
            density: 1500.0,
            poisson: 0.4,
        },
    );
    let mut noise = Noise(7);
    for steps in [1u32, 2, 3, 4, 50] {
        let (mut body, mut truth) = twins(&gpu, &material, &mut noise);
        let h = 0.5 * body.model().conservative_step();
        let speeds: Vec<DVec3> = noise
            .vectors(truth.x.len())
            .iter()
            .map(|v| 0.1 * *v)
            .collect();
        let files: Vec<DVec3> = speeds.iter().map(|v| *v / 0.5).collect();
        body.set_velocities(&files).unwrap();
        let back = h * (1.0 + 0.5 * truth.damping * h);
        let before = truth.x.iter().zip(&speeds).map(|(x, v)| *x - back * *v);
        truth.previous = before.collect();
        body.run(steps, h).unwrap();
        truth.first_step(h);
        for _ in 1..steps {
            truth.step(h);
        }
        let size = 0.05;
        let off = apart(&body, &truth);
        assert!(
            off < 2e-6 * size * f64::from(steps).sqrt().max(1.0),
            "{steps} steps: {off}"
        );
        // The comparison is effective: an additional step changes the positions.
        truth.step(h);
        assert!(apart(&body, &truth) > 10.0 * off.max(1e-9));
    }
}

#[test]
fn normals_match_reference() {
    let gpu = Gpu::new().unwrap();
    let mut noise = Noise(11);
    let (mut body, mut truth) = twins(&gpu, &soft(), &mut noise);
    let h = 0.3 * body.model().conservative_step();
    truth.previous = truth.x.clone();
    // The normals written in the third step belong to the positions after the second.
    body.run(3, h).unwrap();
    truth.first_step(h);
    truth.step(h);
    let normals: Vec<u32> = gpu.read_array(body.normals()).unwrap();
    let mut compared = 0;
    for i in truth.particles.iter().map(|i| *i as usize) {
        let sum = truth.normal(i);
        match unpack_normal(normals[i]) {
            Some(n) => {
                assert!(n.distance(sum.normalize()) < 5e-4, "{i}");
                compared += 1;
            }
            None => assert!(sum.length() < 0.501),
        }
    }
    assert!(compared > 200);
}

#[test]
fn time_step_change_preserves_velocity() {
    let gpu = Gpu::new().unwrap();
    let model = GridModel::new(ball(600), &soft()).unwrap();
    let h = 0.2 * model.conservative_step();
    let mut body = GridBody::new(&gpu, model).unwrap();
    body.set_damping(0.0).unwrap();
    let v = DVec3::new(0.3, -0.1, 0.2);
    let all = body.mesh().nodes.len();
    body.set_velocities(&vec![v; all]).unwrap();
    body.run(7, h).unwrap();
    body.run(5, 0.5 * h).unwrap();
    let time = 9.5 * h;
    assert!((body.clock().1 - time).abs() < 1e-12);
    let rest = body.mesh().nodes.clone();
    let now = body.positions().unwrap();
    let speeds = body.velocities().unwrap();
    for i in body.model().shape.particles() {
        assert!((now[i] - rest[i] - time * v).length() < 1e-6 * 0.1);
        assert!(
            (speeds[i] - v).length() < 2e-2 * v.length(),
            "{}",
            speeds[i]
        );
    }
}

#[test]
fn unstable_step_is_detected_and_undone() {
    let gpu = Gpu::new().unwrap();
    let model = GridModel::new(ball(600), &soft()).unwrap();
    let h = model.conservative_step();
    let mut body = GridBody::new(&gpu, model).unwrap();
    body.set_gravity(DVec3::NEG_Z);
    body.run(200, 0.95 * h).unwrap();
    let before = body.positions().unwrap();
    let error = (0..20)
        .find_map(|_| body.run(256, 2.0 * h).err())
        .expect("twice the stable step must fail");
    assert!(matches!(error, Error::Solver { .. }), "{error}");
    assert!(error.to_string().contains("--dt"), "{error}");
    let after = body.positions().unwrap();
    assert!(after.iter().all(|p| p.is_finite()));
    assert!(before.len() == after.len());
    body.run(10, 0.5 * h).ok();
}

#[test]
fn grabbed_particles_follow_and_are_released() {
    let gpu = Gpu::new().unwrap();
    let model = GridModel::new(ball(600), &soft()).unwrap();
    let h = 0.5 * model.conservative_step();
    let mut body = GridBody::new(&gpu, model).unwrap();
    let low: Vec<u32> = body
        .model()
        .shape
        .particles()
        .filter(|i| body.model().shape.rest_position(*i).z < -0.03)
        .map(|i| i as u32)
        .collect();
    body.pin_nodes(&low).unwrap();
    let top = DVec3::new(0.0, 0.0, 0.045);
    let rest = body.positions().unwrap();
    let near: Vec<usize> = body
        .model()
        .shape
        .particles()
        .filter(|i| rest[*i].distance(top) <= 0.015)
        .collect();
    assert!(near.len() > 3);
    let grab = body.grab(top, 0.015, GrabMode::Follow).unwrap();
    let up = DVec3::new(0.002, 0.0, 0.01);
    for n in 1..=10 {
        body.set_target(grab, top + up * f64::from(n) / 10.0)
            .unwrap();
        body.run(5, h).unwrap();
    }
    let held = body.positions().unwrap();
    for i in &near {
        assert!(held[*i].distance(rest[*i] + up) < 1e-7);
    }
    // Nodes outside the grab are pulled along with a lag.
    let middle = body
        .model()
        .shape
        .particles()
        .find(|i| rest[*i].length() < 0.01)
        .unwrap();
    let moved = held[middle].z - rest[middle].z;
    assert!(moved > 1e-5 && moved < 0.01, "{moved}");
    for bad in [DVec3::NAN, DVec3::splat(1e9)] {
        assert!(body.set_target(grab, bad).is_err());
    }
    let error = body
        .grab(DVec3::splat(1.0), 0.01, GrabMode::Follow)
        .unwrap_err();
    assert!(error.to_string().contains("nothing to grab"), "{error}");
    assert_eq!(body.release(grab).unwrap(), near.len());
    assert!(body.release(grab).is_err());
    body.run(40, h).unwrap();
    let free = body.positions().unwrap();
    assert!(free[near[0]].distance(held[near[0]]) > 1e-4);
}

#[test]
fn grab_springs_respect_force_limit() {
    let gpu = Gpu::new().unwrap();
    let model = GridModel::new(ball(600), &soft()).unwrap();
    let mass: f64 = model.masses.iter().sum();
    let h = 0.5 * model.conservative_step();
    for (target, stiffness, limit) in [(0.01, 2.0, 1e9), (0.04, 1e3, 0.05)] {
        let mut body = GridBody::new(&gpu, model.clone()).unwrap();
        body.set_damping(0.0).unwrap();
        // The whole body is grabbed: its centre moves as a single mass.
        let grip = GrabMode::Spring { stiffness, limit };
        let grab = body.grab(DVec3::ZERO, 1.0, grip).unwrap();
        body.set_target(grab, DVec3::new(target, 0.0, 0.0)).unwrap();
        body.run(60, h).unwrap();
        let time = 60.0 * h;
        let rest = body.mesh().nodes.clone();
        let now = body.positions().unwrap();
        let count = body.model().shape.count() as f64;
        let moved: f64 = body
            .model()
            .shape
            .particles()
            .map(|i| (now[i] - rest[i]).x / count)
            .sum();
        let force = (stiffness * target).min(limit);
        let exact = match stiffness * target < limit {
            true => target * (1.0 - ((stiffness / mass).sqrt() * time).cos()),
            false => 0.5 * force / mass * time * time,
        };
        assert!((moved / exact - 1.0).abs() < 0.02, "{moved} for {exact}");
        // After release no force remains.
        body.release(grab).unwrap();
        let before = body.velocities().unwrap();
        body.run(30, h).unwrap();
        let after = body.velocities().unwrap();
        let mean =
            |v: &[DVec3]| -> f64 { body.model().shape.particles().map(|i| v[i].x / count).sum() };
        assert!((mean(&after) / mean(&before) - 1.0).abs() < 0.02);
    }
}

/// Returns the connected component of each particle, by its smallest particle number.
fn pieces(model: &GridModel) -> Vec<usize> {
    let offsets = model.shape.offsets();
    let mut piece: Vec<usize> = (0..model.springs.len()).collect();
    loop {
        let mut changed = false;
        for i in model.shape.particles() {
            for (k, offset) in offsets.iter().enumerate() {
                if model.springs[i] >> (2 * k) & 1 == 1 {
                    let j = (i as i64 + offset) as usize;
                    let low = piece[i].min(piece[j]);
                    changed |= piece[i] != low || piece[j] != low;
                    (piece[i], piece[j]) = (low, low);
                }
            }
        }
        if !changed {
            return piece;
        }
    }
}

#[test]
fn cut_through_leaves_two_separating_pieces() {
    let gpu = Gpu::new().unwrap();
    let model = GridModel::new(ball(2000), &soft()).unwrap();
    let h = 0.5 * model.conservative_step();
    let mut body = GridBody::new(&gpu, model).unwrap();
    let count = body.mesh().nodes.len();
    body.set_damping(0.0).unwrap();
    // A rotation, so that angular momentum is conserved nontrivially.
    let spin: Vec<DVec3> = body
        .mesh()
        .nodes
        .iter()
        .map(|p| 5.0 * DVec3::Z.cross(*p))
        .collect();
    body.set_velocities(&spin).unwrap();
    body.run(30, h).unwrap();
    let miss =
        Blade::from_quad([1.0, 2.0, 3.0, 4.0].map(|a| DVec3::new(5.0 + a, a * a, a))).unwrap();
    assert_eq!(body.cut(&miss).unwrap().springs, 0);
    let mass: f64 = body.model().masses.iter().sum();
    let before = body.velocities().unwrap();
    let r = 0.2;
    let corner = |y: f64, z: f64| DVec3::new(0.001, y * r, z * r);
    let blade = Blade::from_quad([
        corner(-1.0, -1.0),
        corner(1.0, -1.0),
        corner(1.0, 1.0),
        corner(-1.0, 1.0),
    ])
    .unwrap();
    let cut = body.cut(&blade).unwrap();
    assert_eq!((cut.springs, cut.tets), (924, 1020));
    let model = body.model();
    assert_eq!(model.masses.iter().sum::<f64>(), mass);
    assert_eq!(body.velocities().unwrap(), before);
    // No remaining spring crosses the blade; the components are those of its two sides.
    let now = body.positions().unwrap();
    let offsets = model.shape.offsets();
    let piece = pieces(model);
    let mut seen: Vec<usize> = Vec::new();
    for i in model.shape.particles() {
        for (k, offset) in offsets.iter().enumerate() {
            let j = (i as i64 + offset) as usize;
            if model.springs[i] >> (2 * k) & 1 == 1 {
                assert_eq!(now[i].x > 0.001, now[j].x > 0.001);
                assert_eq!(model.springs[j] >> (2 * k + 1) & 1, 1);
            }
        }
        seen.push(piece[i]);
    }
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(seen.len(), 2);
    let side: Vec<bool> = now.iter().map(|p| p.x > 0.001).collect();
    let pull = |i: usize| DVec3::X * if side[i] { 2e-3 } else { -2e-3 };
    body.set_forces(&(0..count).map(pull).collect::<Vec<_>>())
        .unwrap();
    body.run(400, h).unwrap();
    let apart = body.positions().unwrap();
    let least = body
        .model()
        .shape
        .particles()
        .filter(|i| side[*i])
        .map(|i| apart[i].x);
    let most = body
        .model()
        .shape
        .particles()
        .filter(|i| !side[*i])
        .map(|i| apart[i].x);
    assert!(least.fold(1.0, f64::min) > most.fold(-1.0, f64::max));
    // A single spring is erased without affecting others.
    let one = body
        .model()
        .shape
        .particles()
        .find(|i| body.model().springs[*i] & 1 == 1)
        .unwrap();
    let springs = body.model().springs[one].count_ones() as usize;
    assert_eq!(body.remove(&[one as u32]).unwrap().springs, springs);
    assert_eq!(body.model().springs[one], 0);
    body.run(10, h).unwrap();
}

#[test]
fn rest_normals_equal_gpu_normals() {
    let gpu = Gpu::new().unwrap();
    let model = GridModel::new(ball(2000), &soft()).unwrap();
    let h = 0.1 * model.conservative_step();
    let mut body = GridBody::new(&gpu, model).unwrap();
    let rest = body.rest_normals().unwrap();
    // At rest nothing moves, and steps are bitwise identical.
    body.run(1, h).unwrap();
    let stepped: Vec<u32> = gpu.read_array(body.normals()).unwrap();
    assert_eq!(rest, stepped);
    let mut near = 0;
    for i in body.model().shape.particles() {
        let exact = body.model().shape.rest_normal(body.model().springs[i]);
        let exact = exact.and_then(|n| unpack_normal(pack_normal(n)));
        assert_eq!(exact.is_some(), unpack_normal(rest[i]).is_some());
        if let (Some(a), Some(b)) = (exact, unpack_normal(rest[i])) {
            assert!(a.distance(b) < 1e-3);
            near += 1;
        }
    }
    assert!(near > 200);
}
