//! Skins in pictures: alone, lit with maps, and with a volume around and behind them.

use crate::skin::common::*;
use crate::skin::mapping::with_uvs;
use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{LocalFrame, TetMesh, Topology};
use palpate::render::{
    Camera, Geometry, Image, Raycaster, SurfaceTarget, Target, TransferFunction, local_positions,
};
use palpate::skin::{Compositor, CompositorOptions, Map, Mapping, Skin, SkinBase, SkinColouring};

fn target(gpu: &Gpu, size: u32, format: wgpu::TextureFormat) -> wgpu::TextureView {
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width: size,
            height: size,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// Returns the cube from −1 to 1 at rest, and the base of a skin on it.
fn cube(gpu: &Gpu) -> (TetMesh, LocalFrame, palpate::gpu::Array, SkinBase) {
    let mut mesh = generate::bar([4, 4, 4], DVec3::splat(2.0)).unwrap();
    mesh.nodes.iter_mut().for_each(|p| *p -= 1.0);
    let frame = LocalFrame::from_mesh(&mesh);
    let positions = local_positions(gpu, &frame, &mesh.nodes).unwrap();
    let carrier = SkinBase::from_mesh(gpu, &mesh, &positions, frame).unwrap();
    (mesh, frame, positions, carrier)
}

fn raycaster(
    gpu: &Gpu,
    mesh: &TetMesh,
    frame: LocalFrame,
    positions: &palpate::gpu::Array,
    transfer: &TransferFunction,
) -> Raycaster {
    let scalars = vec![0.0; mesh.nodes.len()];
    let topology = Topology::new(mesh);
    let geometry = Geometry::new(gpu, mesh, &topology, frame, positions, &scalars).unwrap();
    Raycaster::new(gpu, geometry, transfer).unwrap()
}

#[test]
fn opaque_skin_is_lit_at_correct_depth_without_readback() {
    // A separate device: read-backs are counted.
    let gpu = palpate::gpu::Gpu::new().unwrap();
    let (mesh, frame, positions, carrier) = cube(&gpu);
    let ball = sphere(60, 120, |p| 0.5 * p);
    let mut skin = Skin::new(&gpu, &ball, &carrier, Mapping::Auto).unwrap();
    let transfer = TransferFunction::preset("viridis").unwrap();
    let caster = raycaster(&gpu, &mesh, frame, &positions, &transfer);
    let size = 65;
    let colour = target(&gpu, size, wgpu::TextureFormat::Rgba32Float);
    let depth = target(&gpu, size, wgpu::TextureFormat::Depth32Float);
    let eye = DVec3::new(0.4, 0.3, 6.0);
    for shift in [DVec3::ZERO, DVec3::new(0.1, -0.2, 0.7)] {
        let moved: Vec<[f32; 4]> = mesh
            .nodes
            .iter()
            .map(|p| frame.to_local(*p + shift).extend(1.0).to_array())
            .collect();
        gpu.write_array(&positions, &moved).unwrap();
        let camera = Camera::perspective(eye, shift, DVec3::Y, 20.0);
        let before = gpu.readbacks();
        let mut work = gpu.start_recording();
        let into = SurfaceTarget {
            colour: &colour,
            depth: &depth,
            background: Some([0.0; 4]),
        };
        skin.record(&mut work, &camera, &into).unwrap();
        work.submit().unwrap();
        assert_eq!(gpu.readbacks(), before);
        let pixels: Vec<[f32; 4]> = gpu.read_texture(colour.texture()).unwrap();
        let depths: Vec<f32> = gpu.read_texture(depth.texture()).unwrap();
        // Intersection of the central ray with the ball.
        let front = shift + 0.5 * (eye - shift).normalize();
        let clip = caster.file_to_clip(&camera, [size, size]) * front.extend(1.0);
        let (found, expected) = (f64::from(depths[32 * 65 + 32]), clip.z / clip.w);
        assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
        assert!(pixels[32 * 65 + 32][1] > 0.3);
        // The number of pixels equals that of the ball's disc.
        let lit = pixels.iter().filter(|p| p[3] == 1.0).count() as f64;
        let away = (eye - shift).length();
        let radius = 0.5 / (away * away - 0.25).sqrt() / 10f64.to_radians().tan() * 32.5;
        let disc = std::f64::consts::PI * radius * radius;
        assert!((lit / disc - 1.0).abs() < 0.05, "{lit} {disc}");
        assert_eq!(pixels[0], [0.0; 4]);
    }
}

#[test]
fn skins_blend_in_depth_order_with_volume() {
    let gpu = gpu();
    let (mesh, frame, positions, carrier) = cube(&gpu);
    let (extinction, inside) = (0.8, [0.1, 0.3, 0.9]);
    let [r, g, b] = inside;
    let transfer = TransferFunction::new(vec![[0.0, r, g, b]], vec![[0.0, extinction]]).unwrap();
    let mut caster = raycaster(&gpu, &mesh, frame, &positions, &transfer);
    let camera = Camera::orthographic(DVec3::new(0.0, 0.0, 8.0), DVec3::ZERO, DVec3::Y, 4.0);
    let options = CompositorOptions {
        samples: 1,
        ..CompositorOptions::default()
    };
    let mut composer = Compositor::new(&gpu, options).unwrap();
    // The central pixel: the light of a skin that faces the eye there.
    let size = [33, 33];
    let middle = |image: &Image| [0, 1, 2, 3].map(|k| f64::from(image.pixel(16, 16)[k]));
    for radius in [0.5, 1.5] {
        let ball = sphere(60, 120, |p| radius * p);
        let mut skin = Skin::new(&gpu, &ball, &carrier, Mapping::Constant).unwrap();
        skin.set_colour(&SkinColouring::Plain([0.9, 0.4, 0.2]))
            .unwrap();
        let facing = middle(&skin.image(&camera, size).unwrap());
        for opacity in [1.0f32, 0.6] {
            skin.set_opacity(opacity).unwrap();
            let mut skins = [skin];
            let image = composer
                .image(&mut skins, Some(&mut caster), &camera, size)
                .unwrap();
            keep(&image, &format!("composed-{radius}-{opacity}.png"));
            let found = middle(&image);
            // From back to front, through the centre.
            let mut seen = [0.0; 4];
            let over = |front: [f64; 4], seen: [f64; 4]| {
                [0, 1, 2, 3].map(|k| front[k] + (1.0 - front[3]) * seen[k])
            };
            let volume = |length: f64| {
                let a = 1.0 - (-extinction * length).exp();
                [r * a, g * a, b * a, a]
            };
            let surface = facing.map(|c| c * f64::from(opacity));
            let layers = if radius < 1.0 {
                [volume(0.5), surface, volume(1.0), surface, volume(0.5)]
            } else {
                [[0.0; 4], surface, volume(2.0), surface, [0.0; 4]]
            };
            layers.iter().for_each(|layer| seen = over(*layer, seen));
            let off = (0..4).fold(0.0, |m: f64, k| m.max((found[k] - seen[k]).abs()));
            assert!(off < 4e-3, "{radius} {opacity}: {found:?} {seen:?}");
            // A skin in front of the whole volume gives another picture.
            let simple = over(surface, over(surface, volume(2.0)));
            let differs = (0..3).any(|k| (found[k] - simple[k]).abs() > 0.03);
            assert!(differs || opacity == 1.0 && radius > 1.0);
            [skin] = skins;
        }
    }
    // Opaque pixels of the caller occlude what is behind them: here everything.
    let colour = target(&gpu, 33, wgpu::TextureFormat::Rgba32Float);
    let depth = target(&gpu, 33, wgpu::TextureFormat::Depth32Float);
    for (near, expected) in [(1.0, 0), (0.0, 33 * 33 / 5)] {
        let mut work = gpu.start_recording();
        let attachment = wgpu::RenderPassDepthStencilAttachment {
            view: &depth,
            depth_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(near),
                store: wgpu::StoreOp::Store,
            }),
            stencil_ops: None,
        };
        work.render_pass("clear", &[], Some(attachment));
        let ball = sphere(20, 40, |p| 1.5 * p);
        let opaque = Skin::new(&gpu, &ball, &carrier, Mapping::Constant).unwrap();
        let mut thin = Skin::new(&gpu, &ball, &carrier, Mapping::Constant).unwrap();
        thin.set_opacity(0.5).unwrap();
        let into = Target {
            colour: &colour,
            depth: Some(&depth),
            background: Some([0.0; 4]),
        };
        composer
            .record(
                &mut work,
                &mut [opaque, thin],
                Some(&mut caster),
                &camera,
                &into,
            )
            .unwrap();
        work.submit().unwrap();
        let pixels: Vec<[f32; 4]> = gpu.read_texture(colour.texture()).unwrap();
        let lit = pixels.iter().filter(|p| p[3] > 0.0).count();
        assert!(
            if expected == 0 {
                lit == 0
            } else {
                lit > expected
            },
            "{lit}"
        );
    }
}

#[test]
fn compositor_rejects_skins_of_different_bodies() {
    let gpu = gpu();
    let (_, _, _, carrier) = cube(&gpu);
    let scene = bar();
    let (other, _) = scene.carrier(&gpu, &scene.rest);
    let mut skins = [&carrier, &other]
        .map(|carrier| Skin::new(&gpu, &bumpy(20), carrier, Mapping::Auto).unwrap());
    let camera = Camera::perspective(DVec3::Z * 5.0, DVec3::ZERO, DVec3::Y, 30.0);
    let mut composer = Compositor::new(&gpu, CompositorOptions::default()).unwrap();
    let refused = composer.image(&mut skins, None, &camera, [16, 16]);
    assert!(refused.err().unwrap().to_string().contains("local frame"));
}

/// Returns the mean difference of two pictures.
fn difference(a: &Image, b: &Image) -> f64 {
    let pairs = a.values.iter().zip(&b.values);
    pairs.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / a.values.len() as f64
}

#[test]
fn maps_and_scalars_affect_shading() {
    let gpu = gpu();
    let (_, _, _, carrier) = cube(&gpu);
    let mut ball = with_uvs(&sphere(30, 60, |p| p));
    let heights = ball.vertices.iter().map(|p| p.z).collect();
    ball.fields.push(palpate::mesh::Field::scalar(
        "height",
        palpate::mesh::Location::Node,
        heights,
    ));
    let mut skin = Skin::new(&gpu, &ball, &carrier, Mapping::Interpolated).unwrap();
    let camera = Camera::perspective(DVec3::new(2.0, 3.0, 1.0), DVec3::ZERO, DVec3::Z, 40.0);
    let picture = |skin: &mut Skin| skin.image(&camera, [96, 96]).unwrap();
    let plain = picture(&mut skin);
    let map = |texel: fn(u32, u32) -> [u8; 4]| Map {
        size: [64, 32],
        texels: (0..32)
            .flat_map(|y| (0..64).map(move |x| texel(x, y)))
            .collect(),
    };
    let flat = map(|_, _| [128, 128, 255, 255]);
    skin.set_normal_map(Some(&flat)).unwrap();
    let same = picture(&mut skin);
    assert!(difference(&plain, &same) < 1e-3);
    let bumps = map(|x, y| {
        let slope = |i: u32| (128.0 + 60.0 * (f64::from(i) * 0.8).sin()) as u8;
        [slope(x), slope(y), 220, 255]
    });
    skin.set_normal_map(Some(&bumps)).unwrap();
    let bumpy = picture(&mut skin);
    keep(&bumpy, "normal-map.png");
    assert!(difference(&plain, &bumpy) > 0.01);
    // The light comes from above and from the left; north is up, and east to the right.
    let tilted = |skin: &mut Skin, texel| {
        skin.set_normal_map(Some(&map(texel))).unwrap();
        f64::from(picture(skin).pixel(48, 48)[1])
    };
    let north = tilted(&mut skin, |_, _| [128, 200, 230, 255]);
    let south = tilted(&mut skin, |_, _| [128, 56, 230, 255]);
    let east = tilted(&mut skin, |_, _| [200, 128, 230, 255]);
    let west = tilted(&mut skin, |_, _| [56, 128, 230, 255]);
    assert!(
        north > south + 0.1 && west > east + 0.1,
        "{north} {south} {east} {west}"
    );
    skin.set_normal_map(Some(&bumps)).unwrap();
    // A height map at the surface everywhere has no effect; otherwise the bumps move.
    let level = map(|_, _| [255; 4]);
    skin.set_height_map(Some((&level, 0.1))).unwrap();
    assert!(difference(&picture(&mut skin), &bumpy) < 1e-6);
    let deep = map(|x, _| if x % 16 < 8 { [255; 4] } else { [0; 4] });
    skin.set_height_map(Some((&deep, 0.05))).unwrap();
    let sunk = picture(&mut skin);
    keep(&sunk, "height-map.png");
    assert!(difference(&sunk, &bumpy) > 0.003);
    skin.set_normal_map(None).unwrap();
    skin.set_height_map(None).unwrap();
    assert_eq!(picture(&mut skin), plain);

    // A scalar mapped to colours: the upper half has another one.
    let transfer = TransferFunction::relative(
        vec![[0.5, 1.0, 0.0, 0.0], [0.5, 0.0, 0.0, 1.0]],
        vec![[0.0, 1.0]],
    )
    .unwrap();
    let colour = |name: &str| SkinColouring::Field {
        name: name.into(),
        transfer: transfer.clone(),
    };
    skin.set_colour(&colour("height")).unwrap();
    let halves = picture(&mut skin);
    keep(&halves, "scalars.png");
    let (top, bottom) = (halves.pixel(48, 20), halves.pixel(48, 76));
    assert!(top[2] > 0.2 && top[0] < 0.2 && bottom[0] > 0.1 && bottom[2] < 0.2);
    assert!(skin.set_colour(&colour("width")).is_err());
    // Hidden triangles are absent.
    let count = skin.rest().triangles.len();
    skin.set_visible_triangles(&vec![false; count]).unwrap();
    assert!(picture(&mut skin).values.iter().all(|v| *v == 0.0));
    assert!(skin.set_visible_triangles(&[true]).is_err());

    // Maps need texture coordinates; opacities and reliefs must be valid.
    let bare = sphere(8, 16, |p| p);
    let mut bare = Skin::new(&gpu, &bare, &carrier, Mapping::Auto).unwrap();
    assert!(bare.set_normal_map(Some(&flat)).is_err());
    assert!(bare.set_opacity(0.0).is_err() && bare.set_opacity(f32::NAN).is_err());
    assert!(skin.set_height_map(Some((&flat, -1.0))).is_err());
    let empty = Map {
        size: [4, 4],
        texels: Vec::new(),
    };
    assert!(skin.set_normal_map(Some(&empty)).is_err());
}

#[test]
fn map_round_trips() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.png");
    let map = Map {
        size: [3, 2],
        texels: (0..6).map(|i| [i, 2 * i, 255 - i, 255]).collect(),
    };
    map.save(&path).unwrap();
    assert_eq!(Map::read(&path).unwrap(), map);
    std::fs::write(&path, b"no picture").unwrap();
    let error = Map::read(&path).unwrap_err().to_string();
    assert!(
        error.contains("map.png") && error.contains("PNG"),
        "{error}"
    );
    assert!(Map::read(folder.path().join("none.png")).is_err());
}
