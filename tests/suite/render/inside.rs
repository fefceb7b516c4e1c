//! Eyes inside the mesh, and objects that occlude parts of it.

use crate::render::common::*;
use glam::DVec3;
use palpate::generate;
use palpate::render::*;

#[test]
fn eye_inside_mesh_matches_reference() {
    let gpu = gpu();
    let cube = generate::benchmark_cube(9, true).unwrap();
    let scalars = node_scalars(&cube, "scalar");
    let positions = bent(&cube);
    let at = |x: f64, y: f64, z: f64| {
        // A point of the bent body: the mean of the nodes near a point of the cube.
        let target = DVec3::new(x, y, z);
        let near: Vec<DVec3> = cube
            .nodes
            .iter()
            .zip(&positions)
            .filter(|(p, _)| p.distance(target) < 0.3)
            .map(|(_, q)| *q)
            .collect();
        near.iter().sum::<DVec3>() / near.len() as f64
    };
    // In the body next to the duct, and in the duct itself, which is outside.
    let eyes = [at(0.15, 0.2, 0.5), at(0.85, 0.5, 0.3), at(0.5, 0.15, 0.9)];
    for walk in [Traversal::Vertices, Traversal::Planes] {
        let options = RaycastOptions {
            walk,
            ..Default::default()
        };
        let mut scene = Scene::new(
            &gpu,
            &cube,
            &positions,
            &scalars,
            &peers_transfer(),
            options,
        );
        for (i, eye) in eyes.into_iter().enumerate() {
            let look_at = at(0.5, 0.5, 0.5) + DVec3::new(0.013, 0.017, 0.0);
            for camera in [
                Camera::perspective(eye, look_at, DVec3::Y, 70.0),
                Camera::orthographic(eye, look_at, DVec3::Y, 0.6),
            ] {
                let (image, rms, worst) = scene.compare(&camera, [64, 64]);
                println!("{walk:?} eye {i}: rms {rms:.3} worst {worst:.3}");
                keep(&image, &format!("inside-{walk:?}-{i}.png"));
                assert!(
                    rms < 0.5 && worst < 2.0,
                    "{walk:?} {camera:?}: {rms} {worst}"
                );
                let thick = scene
                    .caster
                    .image(&camera, [64, 64], Mode::Thickness)
                    .unwrap();
                let truth = scene
                    .truth
                    .render(&camera, [64, 64], |r, ray| r.thickness(ray));
                let pairs = thick.values.iter().zip(&truth);
                let wrong = pairs
                    .filter(|(a, b)| (f64::from(**a) - **b).abs() > 1e-3)
                    .count();
                assert!(wrong < 8, "{wrong} of {} lengths are wrong", truth.len());
            }
        }
    }
}

#[test]
fn opaque_wall_terminates_rays() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(6, false).unwrap();
    let scalars = node_scalars(&mesh, "scalar");
    // The wall is the surface of a thin plate, drawn into a separate depth buffer.
    let plate =
        generate::box_mesh([1, 1, 1], DVec3::new(3.0, 3.0, 0.5), generate::Split::Six).unwrap();
    let wall: Vec<DVec3> = plate
        .nodes
        .iter()
        .map(|p| *p - DVec3::new(1.0, 1.0, 0.0))
        .collect();
    let frame = palpate::mesh::LocalFrame::from_mesh(&mesh);
    let topology = palpate::mesh::Topology::new(&plate);
    let array = local_positions(&gpu, &frame, &wall).unwrap();
    let heights = vec![0.0; wall.len()];
    let plate = Geometry::new(&gpu, &plate, &topology, frame, &array, &heights).unwrap();
    let colour = SurfaceColour::Plain([0.5; 3]);
    let mut wall = Surface::new(&gpu, &plate, &heights, &colour, Shading::Flat).unwrap();
    let size = [64, 64];
    let texture = |format, usage| {
        let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d {
                width: 64,
                height: 64,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
            view_formats: &[],
        });
        (
            texture.clone(),
            texture.create_view(&wgpu::TextureViewDescriptor::default()),
        )
    };
    let (picture, colour) = texture(
        wgpu::TextureFormat::Rgba32Float,
        wgpu::TextureUsages::COPY_SRC,
    );
    let (_, depth) = texture(
        wgpu::TextureFormat::Depth32Float,
        wgpu::TextureUsages::TEXTURE_BINDING,
    );
    let geometry = Geometry::at_rest(&gpu, &mesh, &scalars).unwrap();
    for walk in [Traversal::Vertices, Traversal::Planes] {
        let options = RaycastOptions {
            walk,
            ..Default::default()
        };
        let geometry = Geometry::at_rest(&gpu, &mesh, &scalars).unwrap();
        let mut caster =
            Raycaster::with_options(&gpu, geometry, &peers_transfer(), options).unwrap();
        let camera =
            Camera::orthographic(DVec3::new(0.5, 0.5, 3.0), DVec3::splat(0.5), DVec3::Y, 0.8);
        let mut work = gpu.start_recording();
        let behind = SurfaceTarget {
            colour: &colour,
            depth: &depth,
            background: Some([0.0; 4]),
        };
        wall.record(&mut work, &camera, &behind).unwrap();
        let target = Target {
            colour: &colour,
            depth: Some(&depth),
            background: Some([0.0; 4]),
        };
        caster
            .record(&mut work, &camera, Mode::Thickness, &target)
            .unwrap();
        work.submit().unwrap();
        let drawn: Vec<[f32; 4]> = gpu.read_texture(&picture).unwrap();
        assert_eq!(drawn.len(), (size[0] * size[1]) as usize);
        for pixel in drawn {
            assert!(
                (pixel[0] - 0.5).abs() < 1e-4,
                "{walk:?}: {} behind a wall at 0.5",
                pixel[0]
            );
        }
    }
    drop(geometry);
}
