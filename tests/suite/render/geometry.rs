//! Normals and gradients refreshed on the GPU, against float64.

use crate::render::common::*;
use glam::{DVec3, Vec4};
use palpate::generate;
use palpate::gpu::{Gpu, Texel};
use palpate::mesh::{Blade, FACES, LocalFrame, NO_NEIGHBOUR, TetMesh, Topology, cut};
use palpate::render::*;

/// Returns the records of a mesh after a refresh: eight texels per tet, as floats.
fn records(gpu: &Gpu, mesh: &TetMesh, positions: &[DVec3], scalars: &[f64]) -> Vec<[Vec4; 8]> {
    let float = |t: [u32; 4]| Vec4::from(t.map(f32::from_bits));
    let texels = texels(gpu, mesh, positions, scalars);
    texels.into_iter().map(|record| record.map(float)).collect()
}

/// The same as raw bits.
fn texels(gpu: &Gpu, mesh: &TetMesh, positions: &[DVec3], scalars: &[f64]) -> Vec<[[u32; 4]; 8]> {
    let frame = LocalFrame::from_mesh(mesh);
    let array = local_positions(gpu, &frame, positions).unwrap();
    let mut geometry =
        Geometry::new(gpu, mesh, &Topology::new(mesh), frame, &array, scalars).unwrap();
    let mut work = gpu.start_recording();
    geometry.record_refresh(&mut work).unwrap();
    work.submit().unwrap();
    let records = geometry.records().unwrap();
    assert_eq!(records.texel(), Texel::U32x4);
    let texels: Vec<[u32; 4]> = gpu.read_array(records).unwrap();
    texels.as_chunks::<8>().0.to_vec()
}

fn in_frame(frame: &LocalFrame, p: DVec3) -> DVec3 {
    frame.to_local(p).as_dvec3()
}

/// Returns the largest error of normals, offsets and (relative) gradients.
fn worst(gpu: &Gpu, mesh: &TetMesh, positions: &[DVec3], twin: &[DVec3]) -> [f64; 3] {
    let scalars = waves(mesh);
    let low = scalars.iter().copied().fold(f64::INFINITY, f64::min);
    let high = scalars.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let frame = LocalFrame::from_mesh(mesh);
    let mut worst = [0.0f64; 3];
    let records = records(gpu, mesh, positions, &scalars);
    for (record, t) in records.iter().zip(mesh.morton_order()) {
        let tet = mesh.tets[t as usize];
        let v = tet.map(|i| in_frame(&frame, twin[i as usize]));
        let s = tet.map(|i| (scalars[i as usize] - low) / (high - low));
        for (plane, (normal, offset)) in record.iter().zip(Geometry::reference_tet_planes(v)) {
            let error = plane.truncate().as_dvec3() - normal;
            worst[0] = worst[0].max(error.length());
            worst[1] = worst[1].max((f64::from(plane.w) - offset).abs());
        }
        let gradient = Geometry::reference_tet_gradient(v, s);
        let error = record[4].truncate().as_dvec3() - gradient;
        worst[2] = worst[2].max(error.length() / (1.0 + gradient.length()));
        assert!((f64::from(record[4].w) - s[0]).abs() < 1e-6);
    }
    worst
}

#[test]
fn planes_and_gradients_match_reference() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(7, true).unwrap();
    let bent = bent(&mesh);
    let [normal, offset, gradient] = worst(&gpu, &mesh, &bent, &bent);
    println!("normal {normal:.2e} offset {offset:.2e} gradient {gradient:.2e}");
    assert!(normal < 1e-5 && offset < 1e-5 && gradient < 1e-4);
    // Negative control: the reference of another shape differs.
    let [normal, ..] = worst(&gpu, &mesh, &bent, &mesh.nodes);
    assert!(normal > 1e-2);
}

#[test]
fn shared_faces_have_identical_planes_and_mutual_links() {
    same_planes(&slivers());
    if let Some(liver) = real_mesh("tet/gaia_liver.mesh") {
        same_planes(&liver);
    }
}

fn same_planes(mesh: &TetMesh) {
    let gpu = gpu();
    let positions = bent(mesh);
    let texels = texels(&gpu, mesh, &positions, &waves(mesh));
    let plane = |slot: usize, f: usize| Vec4::from(texels[slot][f].map(f32::from_bits));
    let order = mesh.morton_order();
    let mut place = vec![0; order.len()];
    order
        .iter()
        .enumerate()
        .for_each(|(new, old)| place[*old as usize] = new);
    let mut shared_faces = 0;
    for (t, across) in Topology::new(mesh).neighbours.iter().enumerate() {
        for (f, code) in across.iter().enumerate() {
            let linked = texels[place[t]][6][f];
            if *code == NO_NEIGHBOUR {
                assert_eq!(linked, NO_NEIGHBOUR, "tet {t}, face {f}");
                continue;
            }
            let (slot, face) = (place[*code as usize / 4], *code as usize % 4);
            assert_eq!(linked as usize, 4 * slot + face, "tet {t}, face {f}");
            let (mine, other) = (plane(place[t], f), plane(slot, face));
            assert_eq!(mine, -other, "tet {t}, face {f} {:?}", FACES[f]);
            shared_faces += 1;
        }
    }
    assert!(shared_faces > mesh.tets.len());
}

#[test]
fn degenerate_tets_have_finite_planes_and_gradients() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(2, false).unwrap();
    let mut flat = mesh.nodes.clone();
    // The centre node moved into a face of its tets, others onto each other.
    flat[13] = 0.5 * (flat[0] + flat[2]);
    flat[5] = flat[4];
    let scalars = waves(&mesh);
    for record in records(&gpu, &mesh, &flat, &scalars) {
        assert!(
            record[..6].iter().all(|v| v.truncate().is_finite()),
            "{record:?}"
        );
    }
}

#[test]
fn inverted_tet_count_is_exact() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(4, false).unwrap();
    let count = |positions: &[DVec3]| {
        let frame = LocalFrame::from_mesh(&mesh);
        let array = local_positions(&gpu, &frame, positions).unwrap();
        let topology = Topology::new(&mesh);
        let geometry = Geometry::new(&gpu, &mesh, &topology, frame, &array, &waves(&mesh)).unwrap();
        geometry.count_inverted().unwrap()
    };
    assert_eq!(count(&mesh.nodes), 0);
    let mut torn = mesh.nodes.clone();
    torn[62] += DVec3::new(0.4, 0.1, 0.05);
    let expected = mesh
        .tets
        .iter()
        .filter(|t| palpate::mesh::signed_volume(t.map(|v| torn[v as usize])) <= 0.0)
        .count();
    assert_eq!(expected, 6);
    assert_eq!(count(&torn) as usize, expected);
}

#[test]
fn tet_records_are_created_for_plane_traversal_only() {
    // A separate device: bytes are counted by device.
    let gpu = Gpu::new().unwrap();
    let mut mesh = generate::benchmark_cube(8, true).unwrap();
    let mut topology = Topology::new(&mesh);
    let scalars = node_scalars(&mesh, "scalar");
    let frame = LocalFrame::from_mesh(&mesh);
    let array = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
    let geometry = Geometry::new(&gpu, &mesh, &topology, frame, &array, &scalars).unwrap();
    let mut caster = Raycaster::new(&gpu, geometry, &peers_transfer()).unwrap();
    let camera = peers_camera();
    let draw = |caster: &mut Raycaster, walk: Traversal| {
        let options = RaycastOptions {
            walk,
            ..Default::default()
        };
        caster.set_options(options).unwrap();
        caster.picture(&camera, [60; 2]).unwrap()
    };
    let first = draw(&mut caster, Traversal::Vertices);
    assert!(caster.geometry().records().is_none());
    let made = gpu.bytes_allocated();
    let planes = draw(&mut caster, Traversal::Planes);
    let records = 128 * mesh.tets.len() as u64;
    assert!(caster.geometry().records().is_some() && gpu.bytes_allocated() - made >= records);
    // Either traversal draws the same as before, and both agree up to rounding.
    assert_eq!(draw(&mut caster, Traversal::Vertices), first);
    assert_eq!(draw(&mut caster, Traversal::Planes), planes);
    let apart = ImageDifference::between(&planes, &first).unwrap();
    assert!(apart.within(0.5 / 255.0, 4.0 / 255.0), "{apart}");
    // After a cut, the previous plane traversal is reset completely.
    let blade = Blade::from_quad(
        [[0.0, -0.1], [1.1, -0.1], [1.1, 1.1], [0.0, 1.1]]
            .map(|[x, y]| DVec3::new(x, y, 0.5 + 0.2 * x)),
    )
    .unwrap();
    let at = mesh.nodes.clone();
    let done = cut(&mut mesh, &mut topology, &at, &blade).unwrap();
    assert!(done.opened_faces.len() > 20);
    let mut moved = mesh.nodes.clone();
    for [_, from] in &done.duplicated_nodes {
        moved[*from as usize].z += 0.03;
    }
    let positions = local_positions(&gpu, &frame, &moved).unwrap();
    let mut scalars = scalars;
    scalars.extend(
        done.duplicated_nodes
            .iter()
            .map(|[_, from]| scalars[*from as usize])
            .collect::<Vec<_>>(),
    );
    caster
        .geometry_mut()
        .apply_cut(&mesh, &topology, &done, &positions, &scalars)
        .unwrap();
    let fresh = Geometry::new(&gpu, &mesh, &topology, frame, &positions, &scalars).unwrap();
    let mut other = Raycaster::new(&gpu, fresh, &peers_transfer()).unwrap();
    let cut_open = draw(&mut caster, Traversal::Planes);
    let apart = ImageDifference::between(&cut_open, &draw(&mut other, Traversal::Planes)).unwrap();
    assert!(apart.within(0.1 / 255.0, 2.0 / 255.0), "{apart}");
    assert!(
        !ImageDifference::between(&cut_open, &planes)
            .unwrap()
            .within(1.0 / 255.0, 6.0 / 255.0)
    );
}
