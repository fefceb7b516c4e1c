//! Several pictures with a skin recorded before one submission, each with its own settings.

use crate::skin::common::*;
use glam::DVec3;
use palpate::generate;
use palpate::mesh::{LocalFrame, Topology};
use palpate::render::{Camera, Geometry, Raycaster, Target, TransferFunction, local_positions};
use palpate::skin::{Compositor, CompositorOptions, Mapping, Skin, SkinBase, SkinColouring};

#[test]
fn composites_in_one_submit_keep_settings() {
    let gpu = gpu();
    let mut mesh = generate::bar([4, 4, 4], DVec3::splat(2.0)).unwrap();
    mesh.nodes.iter_mut().for_each(|p| *p -= 1.0);
    let frame = LocalFrame::from_mesh(&mesh);
    let positions = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
    let carrier = SkinBase::from_mesh(&gpu, &mesh, &positions, frame).unwrap();
    let ball = sphere(20, 40, |p| p * 1.2);
    let front = Camera::perspective(DVec3::new(0.5, 0.9, 5.0), DVec3::ZERO, DVec3::Y, 40.0);
    let side = Camera::perspective(DVec3::new(5.0, 0.3, 0.4), DVec3::ZERO, DVec3::Y, 40.0);
    let (red, blue) = ([0.9, 0.2, 0.1], [0.1, 0.3, 0.9]);
    let pictures = [
        (front, red, true),
        (side, red, true),
        (side, blue, true),
        (side, blue, false),
    ];
    // Opaque and culled, and translucent and peeled.
    for opacity in [1.0, 0.5] {
        let scalars = vec![0.0; mesh.nodes.len()];
        let topology = Topology::new(&mesh);
        let geometry = Geometry::new(&gpu, &mesh, &topology, frame, &positions, &scalars).unwrap();
        let bone = TransferFunction::preset("bone").unwrap();
        let mut inside = Raycaster::new(&gpu, geometry, &bone).unwrap();
        let mut skin = Skin::new(&gpu, &ball, &carrier, Mapping::Auto).unwrap();
        skin.set_opacity(opacity).unwrap();
        skin.set_culling(true);
        let triangles = skin.shown().len();
        let mut composer = Compositor::new(&gpu, CompositorOptions::default()).unwrap();
        let mut draw = |at_once: bool| -> Vec<Vec<[f32; 4]>> {
            let mut targets = Vec::new();
            let mut work = gpu.start_recording();
            for (camera, colour, whole) in pictures {
                let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
                let format = wgpu::TextureFormat::Rgba32Float;
                let view = gpu.target("picture", [64, 48], format, usage).unwrap();
                skin.set_colour(&SkinColouring::Plain(colour)).unwrap();
                let shown: Vec<bool> = (0..triangles).map(|t| whole || t % 3 == 0).collect();
                skin.set_visible_triangles(&shown).unwrap();
                let target = Target {
                    colour: &view,
                    depth: None,
                    background: Some([0.0; 4]),
                };
                let skins = std::slice::from_mut(&mut skin);
                composer
                    .record(&mut work, skins, Some(&mut inside), &camera, &target)
                    .unwrap();
                targets.push(view);
                if !at_once {
                    std::mem::replace(&mut work, gpu.start_recording())
                        .submit()
                        .unwrap();
                }
            }
            work.submit().unwrap();
            let read = |view: &wgpu::TextureView| gpu.read_texture(view.texture()).unwrap();
            targets.iter().map(read).collect()
        };
        let truth = draw(false);
        assert!((1..4).all(|i| truth[i] != truth[i - 1]));
        for (i, (found, truth)) in draw(true).iter().zip(&truth).enumerate() {
            assert!(found == truth, "opacity {opacity}: picture {i}");
        }
    }
}
