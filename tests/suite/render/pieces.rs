//! Rendering in pieces: the picture equals that of the whole, for any partition.

use crate::render::common::*;
use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{LocalFrame, MeshPartition, MeshPiece, TetMesh, Topology};
use palpate::render::*;

const SIZE: [u32; 2] = [160, 120];

/// Content of a picture.
struct Shown<'a> {
    mesh: &'a TetMesh,
    /// At the nodes, or in the tets.
    scalars: Vec<f64>,
    in_tets: bool,
    transfer: TransferFunction,
    options: RaycastOptions,
}

impl Shown<'_> {
    fn scalars<'b>(&self, values: &'b [f64]) -> Scalars<'b> {
        match self.in_tets {
            true => Scalars::Cells(values),
            false => Scalars::Nodes(values),
        }
    }

    fn whole(&self, gpu: &Gpu) -> Raycaster {
        let scalars = self.scalars(&self.scalars);
        let mut geometry = Geometry::at_rest(gpu, self.mesh, scalars).unwrap();
        geometry
            .enable_lighting(self.mesh, &Topology::new(self.mesh), scalars)
            .unwrap();
        Raycaster::with_options(gpu, geometry, &self.transfer, self.options).unwrap()
    }

    fn piece(&self, gpu: &Gpu, piece: &MeshPiece) -> Raycaster {
        let frame = LocalFrame::from_mesh(self.mesh);
        let measures = TableStatistics::new(self.mesh, self.scalars(&self.scalars));
        let items = if self.in_tets {
            &piece.tets
        } else {
            &piece.nodes
        };
        let own: Vec<f64> = items.iter().map(|i| self.scalars[*i as usize]).collect();
        let scalars = self.scalars(&own);
        let topology = Topology::new(&piece.mesh);
        let positions = local_positions(gpu, &frame, &piece.mesh.nodes).unwrap();
        let shown = topology.restricted_to(piece.owned_tets);
        let mut geometry =
            Geometry::new(gpu, &piece.mesh, &shown, frame, &positions, scalars).unwrap();
        geometry
            .set_scalars(&piece.mesh, scalars, measures.range)
            .unwrap();
        geometry.set_table_statistics(&measures);
        geometry
            .enable_lighting(&piece.mesh, &topology, scalars)
            .unwrap();
        Raycaster::with_options(gpu, geometry, &self.transfer, self.options).unwrap()
    }

    /// Returns the ray segments of each part of the mesh.
    fn segments(&self, gpu: &Gpu, part_of: &[u32], camera: &Camera) -> Vec<RaySegments> {
        let parted = MeshPartition::new(self.mesh, part_of).unwrap();
        (0..parted.len())
            .map(|k| {
                let mut caster = self.piece(gpu, &parted.extract(k).unwrap());
                caster.intervals(camera, SIZE).unwrap()
            })
            .collect()
    }
}

/// Merges all of them pairwise.
fn reduced(mut segments: Vec<RaySegments>) -> RaySegments {
    while segments.len() > 1 {
        segments = segments
            .chunks(2)
            .map(|pair| match pair {
                [a, b] => a.merged(b).unwrap(),
                rest => rest[0].clone(),
            })
            .collect();
    }
    segments.remove(0)
}

fn options(light: Light) -> RaycastOptions {
    RaycastOptions {
        light,
        ..Default::default()
    }
}

/// Returns cameras outside at several distances and sides, along an axis, and inside.
fn cameras(mesh: &TetMesh) -> [Camera; 3] {
    let (low, high) = mesh.bounds();
    let (middle, extent) = (0.5 * (low + high), (high - low).max_element());
    let framing = Camera::fit_mesh_in(mesh, SIZE);
    // The centre of a tet near the centre of the body: an eye inside it.
    let near = |t: &usize| {
        let p = mesh.tet_nodes(*t).iter().sum::<DVec3>() / 4.0;
        p.distance_squared(middle)
    };
    let t = (0..mesh.tets.len())
        .min_by(|a, b| near(a).total_cmp(&near(b)))
        .unwrap();
    let eye = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
    [
        framing,
        Camera::orthographic(
            middle + 2.0 * extent * DVec3::X,
            middle,
            DVec3::Y,
            1.1 * extent,
        ),
        Camera::perspective(eye, eye + DVec3::new(0.3, 0.2, 1.0), DVec3::Y, 70.0),
    ]
}

/// Compares the pieces of `shown` with the whole, with and without light, from every camera;
/// returns the largest root mean square and the largest difference, in 1/255.
fn check(name: &str, shown: &mut Shown, parts: &[usize]) -> (f64, f64) {
    let gpu = gpu();
    let (mut rmse, mut most) = (0.0f64, 0.0f64);
    for light in [Light::None, Light::Head] {
        shown.options.light = light;
        let mut caster = shown.whole(&gpu);
        for (c, camera) in cameras(shown.mesh).iter().enumerate() {
            let whole = caster.image(camera, SIZE, Mode::Composite).unwrap();
            for parts in parts {
                let part_of = MeshPartition::kd_parts(shown.mesh, *parts).unwrap();
                let segments = shown.segments(&gpu, &part_of, camera);
                let all: usize = segments.iter().map(|t| t.items().len()).sum();
                let joined = reduced(segments);
                let image = joined.image();
                keep(&image, &format!("pieces-{name}-{c}-{parts}-{light:?}.png"));
                let apart = ImageDifference::between(&image, &whole).unwrap();
                let (r, m) = (255.0 * apart.rmse, 255.0 * apart.max);
                println!(
                    "{name} {light:?} camera {c}, {parts} pieces: rmse {r:.4}, max {m:.3} of 255; {all} intervals, {} joined",
                    joined.items().len()
                );
                assert!(r < 0.1, "{name}, camera {c}, {parts} pieces: {apart:?}");
                (rmse, most) = (rmse.max(r), most.max(m));
                assert!(all >= joined.items().len());
            }
        }
    }
    println!("{name}: rmse at most {rmse:.4}, max {most:.3} of 255");
    (rmse, most)
}

fn cube() -> TetMesh {
    generate::benchmark_cube(13, true).unwrap()
}

#[test]
#[ignore = "sweep: limb, regions and faces are the shorter ones"]
fn cube_pieces_match_whole() {
    let mesh = cube();
    let mut shown = Shown {
        scalars: waves(&mesh),
        mesh: &mesh,
        in_tets: false,
        transfer: peers_transfer(),
        options: options(Light::None),
    };
    check("cube", &mut shown, &[1, 2, 5, 16]);
}

#[test]
fn limb_pieces_match_whole_by_field_and_region() {
    let mesh = generate::by_name("limb", Some(9_000)).unwrap();
    let mut shown = Shown {
        scalars: limb_scalars(&mesh),
        mesh: &mesh,
        in_tets: false,
        transfer: TransferFunction::preset("tissue").unwrap(),
        options: options(Light::None),
    };
    check("limb", &mut shown, &[3, 8]);
    shown.scalars = mesh.region_field().unwrap().values.clone();
    shown.in_tets = true;
    check("regions", &mut shown, &[8]);
}

#[test]
#[ignore = "long: scripts/test --full"]
fn pieces_match_whole_for_every_body() {
    let real = [
        ("heart", "scalar/chaste_heart_decimation.vtu"),
        ("ventricle", "tet/chaste_ellipsoid_15811.node"),
    ];
    let real = real
        .into_iter()
        .filter_map(|(name, file)| Some((name, real_mesh(file)?)));
    let made = [("cube", cube())].into_iter().chain(made_meshes());
    for (name, mesh) in made.chain(real) {
        let mut shown = Shown {
            scalars: waves(&mesh),
            mesh: &mesh,
            in_tets: false,
            transfer: peers_transfer(),
            options: options(Light::None),
        };
        check(name, &mut shown, &[2, 16]);
    }
}

#[test]
fn scattered_pieces_match_whole_with_plane_traversal() {
    let mesh = generate::benchmark_cube(7, true).unwrap();
    let gpu = gpu();
    let camera = peers_camera();
    for walk in [Traversal::Vertices, Traversal::Planes] {
        let mut shown = Shown {
            scalars: waves(&mesh),
            mesh: &mesh,
            in_tets: false,
            transfer: peers_transfer(),
            options: RaycastOptions {
                walk,
                ..options(Light::Head)
            },
        };
        let whole = shown.whole(&gpu).image(&camera, SIZE, Mode::Composite);
        let whole = whole.unwrap();
        // The required number of layers is determined automatically.
        shown.options.layers = 1;
        let mut random = Random::new(5);
        let part_of: Vec<u32> = mesh
            .tets
            .iter()
            .map(|_| (3.0 * random.unit()) as u32)
            .collect();
        let segments = shown.segments(&gpu, &part_of, &camera);
        // A ray enters and leaves each part many times.
        let rays = whole.values.chunks(4).filter(|p| p[3] > 0.0).count();
        let ways: usize = segments.iter().map(|t| t.items().len()).sum();
        println!("{ways} segments of {rays} rays");
        assert!(ways > 4 * rays);
        let apart = ImageDifference::between(&reduced(segments.clone()).image(), &whole).unwrap();
        println!("scattered, {walk:?}: {apart:?}");
        assert!(255.0 * apart.rmse < 0.1, "{walk:?}: {apart:?}");
        // Composited without depth order, it differs from the whole.
        let mut wrong = segments[0].image();
        for part in &segments[1..] {
            for (a, b) in wrong
                .values
                .chunks_mut(4)
                .zip(part.image().values.chunks(4))
            {
                let clear = 1.0 - a[3];
                a.iter_mut().zip(b).for_each(|(a, b)| *a += clear * b);
            }
        }
        let apart = ImageDifference::between(&wrong, &whole).unwrap();
        assert!(255.0 * apart.rmse > 1.0, "{apart:?}");
    }
}

#[test]
fn ray_segments_match_float64() {
    let mesh = cube();
    let gpu = gpu();
    let shown = Shown {
        scalars: waves(&mesh),
        mesh: &mesh,
        in_tets: false,
        transfer: peers_transfer(),
        options: options(Light::None),
    };
    let camera = peers_camera();
    let part_of = MeshPartition::kd_parts(&mesh, 6).unwrap();
    let parted = MeshPartition::new(&mesh, &part_of).unwrap();
    let frame = LocalFrame::from_mesh(&mesh);
    let forward = (camera.look_at - camera.eye).normalize();
    let mut exact: Vec<Vec<ReferenceSegment>> = vec![Vec::new(); (SIZE[0] * SIZE[1]) as usize];
    let (mut alike, mut rays) = (0, 0);
    let transfer = shown.whole(&gpu).transfer();
    for k in 0..parted.len() {
        let piece = parted.extract(k).unwrap();
        let mut caster = shown.piece(&gpu, &piece);
        assert_eq!(caster.transfer(), transfer);
        let segments = caster.intervals(&camera, SIZE).unwrap();
        let mut own = piece.mesh.clone();
        own.tets.truncate(piece.owned_tets);
        let scalars: Vec<f64> = piece
            .nodes
            .iter()
            .map(|v| shown.scalars[*v as usize])
            .collect();
        let truth = ReferenceRaycaster::new(&own, &own.nodes, &scalars);
        let truth = truth.render(&camera, SIZE, |reference, ray| {
            let depth = ray.direction.dot(forward);
            let all = reference.intervals(ray, &transfer);
            (depth, all)
        });
        let mut of_pixel = vec![Vec::new(); exact.len()];
        segments
            .items()
            .iter()
            .for_each(|i| of_pixel[i.pixel as usize].push(*i));
        for ((exact, (depth, truth)), segments) in exact.iter_mut().zip(truth).zip(&of_pixel) {
            exact.extend(&truth);
            let seen = |(_, seen): &&ReferenceSegment| seen[3] > 1e-4;
            let truth: Vec<&ReferenceSegment> = truth.iter().filter(seen).collect();
            let segments: Vec<&RaySegment> = segments.iter().filter(|i| i.rgba[3] > 1e-4).collect();
            rays += usize::from(!truth.is_empty());
            if truth.len() != segments.len() {
                // Along a silhouette of the piece, with a tiny offset.
                continue;
            }
            let eye = (camera.eye - frame.origin).dot(forward) / frame.scale;
            let near = truth.iter().zip(&segments).all(|((t, seen), i)| {
                let depths = t.map(|t| eye + t * depth / frame.scale);
                let deep = (0..2).all(|k| (f64::from(i.depths[k]) - depths[k]).abs() < 1e-3);
                deep && (0..4).all(|k| (f64::from(i.rgba[k]) - seen[k]).abs() < 4.0 / 255.0)
            });
            alike += usize::from(near && !truth.is_empty());
        }
    }
    println!("{alike} of {rays} rays through pieces match float64");
    assert!(
        rays > 10_000 && alike as f64 > 0.98 * rays as f64,
        "{alike} of {rays}"
    );
    // The merged segments of all pieces equal the whole ray; in the wrong order they do not.
    let whole = ReferenceRaycaster::new(&mesh, &mesh.nodes, &shown.scalars);
    let whole = whole.render(&camera, SIZE, |r, ray| r.composite(ray, &transfer));
    let (mut worst, mut wrong) = (0.0f64, 0.0f64);
    for (parts, whole) in exact.iter().zip(&whole) {
        let turned: Vec<ReferenceSegment> =
            parts.iter().map(|(t, s)| ([-t[0], -t[1]], *s)).collect();
        let off = |found: [f64; 4]| {
            (0..4)
                .map(|k| (found[k] - whole[k]).abs())
                .fold(0.0, f64::max)
        };
        worst = worst.max(off(ReferenceRaycaster::composite_intervals(parts)));
        wrong = wrong.max(off(ReferenceRaycaster::composite_intervals(&turned)));
    }
    println!("float64: error {worst:.1e} in depth order, {wrong:.2} in wrong order");
    assert!(worst < 1e-9 && wrong > 0.1, "{worst} {wrong}");
}

#[test]
fn pieces_reject_unsupported_settings_and_grow_segment_buffer() {
    let mesh = generate::benchmark_cube(5, true).unwrap();
    let gpu = gpu();
    let mut shown = Shown {
        scalars: waves(&mesh),
        mesh: &mesh,
        in_tets: false,
        transfer: peers_transfer(),
        options: RaycastOptions {
            shadows: 0.5,
            ..options(Light::Head)
        },
    };
    let part_of = MeshPartition::kd_parts(&mesh, 2).unwrap();
    let parted = MeshPartition::new(&mesh, &part_of).unwrap();
    let piece = parted.extract(0).unwrap();
    let camera = peers_camera();
    let error_of =
        |caster: &mut Raycaster| caster.intervals(&camera, SIZE).unwrap_err().to_string();
    let message = error_of(&mut shown.piece(&gpu, &piece));
    assert!(message.contains("shadows"), "{message}");
    shown.options.shadows = 0.0;
    let mut caster = shown.piece(&gpu, &piece);
    let iso = Sections {
        isosurfaces: vec![Isosurface {
            value: 0.5,
            colour: None,
            opacity: 1.0,
        }],
        ..Sections::default()
    };
    caster.set_sections(&iso).unwrap();
    let message = error_of(&mut caster);
    assert!(message.contains("isosurfaces"), "{message}");
    // Without it, pictures of the same raycaster are unaffected.
    caster.set_sections(&Sections::default()).unwrap();
    let before = caster.picture(&camera, SIZE).unwrap();
    let segments = caster.intervals(&camera, SIZE).unwrap();
    let apart = ImageDifference::between(&segments.image(), &before).unwrap();
    assert!(255.0 * apart.rmse < 0.1, "{apart:?}");
    assert_eq!(caster.picture(&camera, SIZE).unwrap(), before);
}

#[test]
fn lighting_without_ghost_tets_shows_seams() {
    let mesh = cube();
    let gpu = gpu();
    let camera = peers_camera();
    let mut shown = Shown {
        scalars: waves(&mesh),
        mesh: &mesh,
        in_tets: false,
        transfer: peers_transfer(),
        options: options(Light::Head),
    };
    let part_of = MeshPartition::kd_parts(&mesh, 8).unwrap();
    let parted = MeshPartition::new(&mesh, &part_of).unwrap();
    let mut off = Vec::new();
    for light in [Light::None, Light::Head] {
        shown.options.light = light;
        let whole = shown.whole(&gpu).image(&camera, SIZE, Mode::Composite);
        let segments = (0..parted.len()).map(|k| {
            let mut piece = parted.extract(k).unwrap();
            piece.tets.truncate(piece.owned_tets);
            piece.mesh.tets.truncate(piece.owned_tets);
            shown.piece(&gpu, &piece).intervals(&camera, SIZE).unwrap()
        });
        let image = reduced(segments.collect()).image();
        off.push(
            255.0
                * ImageDifference::between(&image, &whole.unwrap())
                    .unwrap()
                    .rmse,
        );
    }
    println!("without ghost tets: error {off:?} of 255");
    assert!(off[0] < 0.1 && off[1] > 1.0, "{off:?}");
}
