//! Lighting of the interior, against its float64 reference.

use crate::render::common::*;
use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{Blade, LocalFrame, Location, TetMesh, Topology, cut};
use palpate::render::*;

/// A positioned mesh, its scalars, and the sections that affect light.
struct Lit<'a> {
    mesh: &'a TetMesh,
    positions: Vec<DVec3>,
    scalars: Scalars<'a>,
    gradients: Vec<DVec3>,
    caster: Raycaster,
}

fn values<'a>(scalars: Scalars<'a>) -> (&'a [f64], bool) {
    match scalars {
        Scalars::Nodes(values) => (values, false),
        Scalars::Cells(values) => (values, true),
    }
}

impl<'a> Lit<'a> {
    fn new(
        gpu: &Gpu,
        mesh: &'a TetMesh,
        positions: &[DVec3],
        scalars: Scalars<'a>,
        options: RaycastOptions,
    ) -> Lit<'a> {
        let frame = LocalFrame::from_mesh(mesh);
        let array = local_positions(gpu, &frame, positions).unwrap();
        let topology = Topology::new(mesh);
        let mut geometry = Geometry::new(gpu, mesh, &topology, frame, &array, scalars).unwrap();
        geometry.enable_lighting(mesh, &topology, scalars).unwrap();
        let (low, high) = geometry.scalar_range();
        let (given, cells) = values(scalars);
        let shares: Vec<f64> = given.iter().map(|s| (s - low) / (high - low)).collect();
        let local: Vec<DVec3> = positions
            .iter()
            .map(|p| (*p - frame.origin) / frame.scale)
            .collect();
        let of_cells = cells.then_some(given);
        let gradients =
            Geometry::reference_node_gradients(mesh, &topology, &local, &shares, of_cells);
        let transfer = TransferFunction::preset("viridis").unwrap();
        Lit {
            caster: Raycaster::with_options(gpu, geometry, &transfer, options).unwrap(),
            mesh,
            positions: positions.to_vec(),
            scalars,
            gradients,
        }
    }

    /// Returns the root mean square and maximum of the differences between a picture and the
    /// reference, in 1/255.
    fn compare(&mut self, camera: &Camera, light: Light) -> (f64, f64) {
        let size = [64, 64];
        let image = self.caster.image(camera, size, Mode::Composite).unwrap();
        let (given, cells) = values(self.scalars);
        let rays = match cells {
            true => ReferenceRaycaster::from_cell_scalars(self.mesh, &self.positions, given),
            false => ReferenceRaycaster::new(self.mesh, &self.positions, given),
        };
        let transfer = self.caster.transfer();
        let truth = rays.render(camera, size, |rays, ray| {
            rays.composite_lit(ray, &transfer, |tet, p, way| {
                let weights = rays.barycentric_weights(tet, p);
                let nodes = self.mesh.tets[tet as usize];
                let parts = nodes.iter().zip(weights);
                let gradient = parts.map(|(v, w)| w * self.gradients[*v as usize]).sum();
                light.shade(gradient, way)
            })
        });
        difference(&image, &truth)
    }
}

fn bent(mesh: &TetMesh) -> Vec<DVec3> {
    let (low, high) = mesh.bounds();
    let size = (high - low).max_element();
    let bend = |p: &DVec3| {
        let u = (*p - low) / size;
        *p + size * DVec3::new(0.3 * u.y * u.y, 0.1 * u.x * u.z, 0.2 * u.x * u.y)
    };
    mesh.nodes.iter().map(bend).collect()
}

#[test]
fn lit_images_match_float64() {
    let gpu = gpu();
    let duct = generate::duct([9, 9, 9], DVec3::new(1.0, 1.0, 1.5), generate::Bore::Round).unwrap();
    let limb = generate::by_name("limb", Some(3_000)).unwrap();
    let smooth = waves(&duct);
    let regions = limb.field("label", Location::Cell).unwrap().values.clone();
    let from = Light::From(DVec3::new(0.3, 1.0, -0.5));
    for (name, mesh, scalars) in [
        ("duct", &duct, Scalars::Nodes(&smooth)),
        ("limb", &limb, Scalars::Cells(&regions)),
    ] {
        let outside = Camera::fit_mesh(mesh);
        let mut inside = Camera::fit_mesh(mesh);
        inside.eye = mesh.nodes[mesh.tets[mesh.tets.len() / 2][0] as usize] + DVec3::splat(1e-4);
        for (walk, light, camera, positions) in [
            (
                Traversal::Vertices,
                Light::Head,
                outside,
                mesh.nodes.clone(),
            ),
            (Traversal::Planes, Light::Head, outside, bent(mesh)),
            (Traversal::Vertices, from, outside, bent(mesh)),
            (Traversal::Vertices, Light::Head, inside, mesh.nodes.clone()),
            (Traversal::Planes, from, inside, mesh.nodes.clone()),
        ] {
            let options = RaycastOptions {
                walk,
                light,
                ..RaycastOptions::default()
            };
            let mut lit = Lit::new(&gpu, mesh, &positions, scalars, options);
            let (rms, worst) = lit.compare(&camera, light);
            println!("{name} {walk:?} {light:?}: rms {rms:.3} worst {worst:.3}");
            assert!(
                rms < 0.5 && worst < 3.0,
                "{name} {walk:?} {light:?}: {rms} {worst}"
            );
            // It differs from the picture without light.
            let (dark, _) = lit.compare(&camera, Light::None);
            assert!(dark > 1.0, "{name} {walk:?}: {dark}");
        }
    }
}

#[test]
fn gpu_gradients_match_float64_after_cut() {
    let gpu = gpu();
    let mut mesh = slivers();
    let mut topology = Topology::new(&mesh);
    let mut scalars = waves(&mesh);
    let frame = LocalFrame::from_mesh(&mesh);
    let check = |geometry: &Geometry, mesh: &TetMesh, topology: &Topology, scalars: &[f64]| {
        let array = geometry.gradients().unwrap();
        let found: Vec<[f32; 4]> = gpu.read_array(array).unwrap();
        let (low, high) = geometry.scalar_range();
        let shares: Vec<f64> = scalars.iter().map(|s| (s - low) / (high - low)).collect();
        let local: Vec<DVec3> = mesh
            .nodes
            .iter()
            .map(|p| (*p - frame.origin) / frame.scale)
            .collect();
        let truth = Geometry::reference_node_gradients(mesh, topology, &local, &shares, None);
        let apart = found.iter().zip(&truth).map(|(f, t)| {
            let f = DVec3::new(f[0].into(), f[1].into(), f[2].into());
            f.distance(*t) / t.length().max(1.0)
        });
        apart.fold(0.0, f64::max)
    };
    let positions = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
    let mut geometry = Geometry::new(&gpu, &mesh, &topology, frame, &positions, &scalars).unwrap();
    let lit = RaycastOptions {
        light: Light::Head,
        ..RaycastOptions::default()
    };
    let transfer = TransferFunction::preset("viridis").unwrap();
    geometry
        .enable_lighting(&mesh, &topology, &scalars)
        .unwrap();
    let mut caster = Raycaster::with_options(&gpu, geometry, &transfer, lit).unwrap();
    let camera = Camera::fit_mesh(&mesh);
    caster.image(&camera, [16, 16], Mode::Composite).unwrap();
    let error = check(caster.geometry(), &mesh, &topology, &scalars);
    assert!(error < 1e-3, "{error}");
    // The check is effective.
    let other: Vec<f64> = scalars.iter().map(|s| s * s).collect();
    assert!(check(caster.geometry(), &mesh, &topology, &other) > 0.05);
    let corners = [[-1.0, -1.0], [2.0, -1.0], [2.0, 2.0], [-1.0, 2.0]];
    let blade = Blade::from_quad(corners.map(|[y, z]| DVec3::new(0.47, y, z))).unwrap();
    let at = mesh.nodes.clone();
    let done = cut(&mut mesh, &mut topology, &at, &blade).unwrap();
    assert!(!done.duplicated_nodes.is_empty());
    for [_, old] in &done.duplicated_nodes {
        scalars.push(scalars[*old as usize]);
    }
    let positions = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
    caster
        .geometry_mut()
        .apply_cut(&mesh, &topology, &done, &positions, &scalars)
        .unwrap();
    caster.image(&camera, [16, 16], Mode::Composite).unwrap();
    let error = check(caster.geometry(), &mesh, &topology, &scalars);
    assert!(error < 1e-3, "{error}");
}

#[test]
fn disabled_lighting_has_no_cost() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::benchmark_cube(6, false).unwrap();
    let scalars = node_scalars(&mesh, "scalar");
    let transfer = TransferFunction::preset("viridis").unwrap();
    let camera = Camera::fit_mesh(&mesh);
    let geometry = Geometry::at_rest(&gpu, &mesh, &scalars).unwrap();
    let lit = RaycastOptions {
        light: Light::Head,
        ..RaycastOptions::default()
    };
    let mut caster = Raycaster::new(&gpu, geometry, &transfer).unwrap();
    caster.image(&camera, [16, 16], Mode::Composite).unwrap();
    assert!(caster.geometry().gradients().is_none());
    caster.set_options(lit).unwrap();
    let message = caster
        .image(&camera, [16, 16], Mode::Composite)
        .unwrap_err();
    assert!(message.to_string().contains("enable_lighting"), "{message}");
    // Thickness pictures are not lit.
    caster.image(&camera, [16, 16], Mode::Thickness).unwrap();
    let topology = Topology::new(&mesh);
    caster
        .geometry_mut()
        .enable_lighting(&mesh, &topology, &scalars)
        .unwrap();
    for _ in 0..3 {
        caster.image(&camera, [16, 16], Mode::Composite).unwrap();
    }
    let passes = gpu.passes_recorded();
    // Nothing has moved.
    assert_eq!(passes["render/node_gradients"], 1);
    let wrong = RaycastOptions {
        light: Light::From(DVec3::ZERO),
        ..lit
    };
    assert!(caster.set_options(wrong).is_err());
    let other = generate::benchmark_cube(5, false).unwrap();
    let refused = caster
        .geometry_mut()
        .enable_lighting(&other, &Topology::new(&other), &scalars);
    assert!(refused.is_err());
}

/// Returns the fraction of light at the nodes in float64, as the caster should compute it.
fn shares_of_light(lit: &Lit, light: Light, strength: f64, inside: &Sections) -> Vec<f64> {
    let transfer = lit.caster.transfer();
    let (given, cells) = values(lit.scalars);
    let extinction = |t: usize, w: [f64; 4]| {
        let nodes = lit.mesh.tets[t];
        let s = match cells {
            true => given[t],
            false => (0..4).map(|k| w[k] * given[nodes[k] as usize]).sum(),
        };
        transfer.extinction(s)
    };
    let at = [&lit.positions[..], &lit.mesh.nodes[..], &lit.gradients[..]];
    Geometry::reference_node_shadows(lit.mesh, at, light, strength, &extinction, inside)
}

#[test]
fn shadows_match_float64() {
    let gpu = gpu();
    let duct = generate::duct([9, 9, 9], DVec3::new(1.0, 1.0, 1.5), generate::Bore::Round).unwrap();
    let limb = generate::by_name("limb", Some(3_000)).unwrap();
    let smooth = waves(&duct);
    let regions = limb.field("label", Location::Cell).unwrap().values.clone();
    let from = Light::From(DVec3::new(0.3, 1.0, -0.5));
    for (name, mesh, scalars) in [
        ("duct", &duct, Scalars::Nodes(&smooth)),
        ("limb", &limb, Scalars::Cells(&regions)),
    ] {
        let (low, high) = mesh.bounds();
        let plane = Plane::clip(0.5 * (low + high), DVec3::new(0.2, 1.0, 0.1)).at_rest();
        let cut = Sections {
            planes: vec![plane],
            ..Sections::default()
        };
        for (walk, light, inside) in [
            (Traversal::Vertices, Light::Head, Sections::default()),
            (Traversal::Planes, from, Sections::default()),
            (Traversal::Vertices, from, cut),
        ] {
            let options = RaycastOptions {
                walk,
                light,
                shadows: 0.8,
                ..RaycastOptions::default()
            };
            let mut lit = Lit::new(&gpu, mesh, &bent(mesh), scalars, options);
            lit.caster
                .geometry_mut()
                .store_rest_positions(mesh)
                .unwrap();
            lit.caster.set_sections(&inside).unwrap();
            let colours = vec![[0.0, 0.2, 0.4, 0.9], [1.0, 0.9, 0.6, 0.3]];
            let dense = vec![[0.0, 5.0], [1.0, 60.0]];
            let dense = TransferFunction::relative(colours, dense).unwrap();
            lit.caster.set_transfer(&dense).unwrap();
            let camera = Camera::fit_mesh(mesh);
            let image = lit
                .caster
                .image(&camera, [64, 64], Mode::Composite)
                .unwrap();
            let array = lit.caster.shadowed_gradients().unwrap();
            let found: Vec<[f32; 4]> = gpu.read_array(array).unwrap();
            let off = |truth: &[f64]| {
                let squares = found
                    .iter()
                    .zip(truth)
                    .map(|(f, t)| (f64::from(f[3]) - t).powi(2));
                (squares.sum::<f64>() / truth.len() as f64).sqrt()
            };
            let truth = shares_of_light(&lit, light, 0.8, &inside);
            let spread = truth.iter().cloned().fold(1.0, f64::min);
            // Points on the borders of cells may count for either cell.
            let rms = off(&truth);
            println!("{name} {walk:?} {light:?}: {rms:.5}, darkest {spread:.2}");
            assert!(
                rms < 2e-3 && spread < 0.6,
                "{name} {walk:?}: {rms} {spread}"
            );
            // Another light, and half the extinction, give different results.
            let other = shares_of_light(&lit, Light::From(DVec3::Z), 0.8, &inside);
            assert!(off(&other) > 0.02, "{name} {walk:?}");
            assert!(off(&shares_of_light(&lit, light, 0.4, &inside)) > 0.02);
            if !inside.is_empty() {
                continue;
            }
            let (given, cells) = values(lit.scalars);
            let rays = match cells {
                true => ReferenceRaycaster::from_cell_scalars(mesh, &lit.positions, given),
                false => ReferenceRaycaster::new(mesh, &lit.positions, given),
            };
            let transfer = lit.caster.transfer();
            let picture = |shares: &[f64]| {
                rays.render(&camera, [64, 64], |rays, ray| {
                    rays.composite_lit(ray, &transfer, |tet, p, way| {
                        let weights = rays.barycentric_weights(tet, p);
                        let nodes = mesh.tets[tet as usize].map(|v| v as usize);
                        let gradient = (0..4).map(|k| weights[k] * lit.gradients[nodes[k]]).sum();
                        let share: f64 = (0..4).map(|k| weights[k] * shares[nodes[k]]).sum();
                        light.shade(gradient, way).map(|x| share * x)
                    })
                })
            };
            let (rms, worst) = difference(&image, &picture(&truth));
            println!("{name} {walk:?} {light:?}: rms {rms:.3} worst {worst:.3}");
            assert!(rms < 0.5 && worst < 3.0, "{name} {walk:?}: {rms} {worst}");
            let (open, _) = difference(&image, &picture(&vec![1.0; truth.len()]));
            assert!(open > 0.5 && open > 10.0 * rms, "{name} {walk:?}: {open}");
        }
    }
}

#[test]
fn shadows_update_on_motion_only() {
    // A separate device: passes are counted.
    let gpu = Gpu::new().unwrap();
    let mesh = generate::by_name("box", Some(2_000)).unwrap();
    let scalars: Vec<f64> = mesh.nodes.iter().map(|p| p.z).collect();
    let options = RaycastOptions {
        light: Light::From(DVec3::X),
        shadows: 1.0,
        ..RaycastOptions::default()
    };
    let mut lit = Lit::new(&gpu, &mesh, &mesh.nodes, Scalars::Nodes(&scalars), options);
    let mut camera = Camera::fit_mesh(&mesh);
    let made = || {
        gpu.passes_recorded()
            .get("render/shadow_march")
            .copied()
            .unwrap_or(0)
    };
    let before = made();
    let shares = |lit: &Lit| -> Vec<f32> {
        let found: Vec<[f32; 4]> = gpu
            .read_array(lit.caster.shadowed_gradients().unwrap())
            .unwrap();
        found.iter().map(|f| f[3]).collect()
    };
    lit.caster
        .image(&camera, [16, 16], Mode::Composite)
        .unwrap();
    let first = shares(&lit);
    camera.eye += DVec3::Z;
    lit.caster
        .image(&camera, [16, 16], Mode::Composite)
        .unwrap();
    lit.caster
        .image(&camera, [16, 16], Mode::Thickness)
        .unwrap();
    assert_eq!(made() - before, 1);
    // After a rigid translation, the same nodes have the same light.
    let frame = LocalFrame::from_mesh(&mesh);
    let places = lit.caster.geometry().positions().clone();
    let put = |at: &dyn Fn(DVec3) -> DVec3| {
        let local: Vec<[f32; 4]> = mesh
            .nodes
            .iter()
            .map(|p| frame.to_local(at(*p)).extend(1.0).to_array())
            .collect();
        gpu.write_array(&places, &local).unwrap();
    };
    put(&|p| p + DVec3::new(0.7, -3.0, 0.2));
    lit.caster
        .image(&camera, [16, 16], Mode::Composite)
        .unwrap();
    assert_eq!(made() - before, 2);
    let most = |a: &[f32], b: &[f32]| {
        let off = a.iter().zip(b).map(|(a, b)| (a - b).abs());
        off.fold(0.0, f32::max)
    };
    let moved = most(&first, &shares(&lit));
    assert!(moved < 0.1, "{moved}");
    put(&|p| DVec3::new(-p.x, -p.y, p.z));
    lit.caster
        .image(&camera, [16, 16], Mode::Composite)
        .unwrap();
    assert!(most(&first, &shares(&lit)) > 0.5);
}

#[test]
fn shadows_use_current_scalars() {
    let gpu = gpu();
    let mesh = generate::by_name("box", Some(2_000)).unwrap();
    let scalars: Vec<f64> = mesh.nodes.iter().map(|p| p.z).collect();
    let options = RaycastOptions {
        light: Light::Head,
        shadows: 1.0,
        ..RaycastOptions::default()
    };
    let mut lit = Lit::new(&gpu, &mesh, &mesh.nodes, Scalars::Nodes(&scalars), options);
    let camera = Camera::fit_mesh(&mesh);
    let shown = |lit: &mut Lit| -> Vec<[f32; 4]> {
        lit.caster.update_range().unwrap();
        lit.caster
            .image(&camera, [16, 16], Mode::Composite)
            .unwrap();
        gpu.read_array(lit.caster.shadowed_gradients().unwrap())
            .unwrap()
    };
    let first = shown(&mut lit);
    let range = lit.caster.geometry().scalar_range();
    let other: Vec<f64> = mesh.nodes.iter().map(|p| range.1 - p.z).collect();
    lit.caster
        .geometry_mut()
        .set_scalars(&mesh, &other, range)
        .unwrap();
    assert_ne!(first, shown(&mut lit));
    lit.caster
        .geometry_mut()
        .set_scalars(&mesh, &scalars, range)
        .unwrap();
    assert_eq!(first, shown(&mut lit));
}
