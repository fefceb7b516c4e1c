//! The shaders against `skin::basis`, on random input.

use crate::skin::common::*;
use glam::DVec3;
use palpate::gpu::{Gpu, Texel};
use palpate::mesh::{LocalFrame, NO_NORMAL, pack_normal};
use palpate::render::local_positions;
use palpate::skin::BaseMesh;
use palpate::skin::basis::VertexBinding;
use palpate::skin::{Mapping, Skin, SkinBase};

/// Returns the errors of position, normal and tangent over all vertices, with the reference given
/// `bound`.
fn errors(
    gpu: &Gpu,
    skin: &Skin,
    positions: &palpate::gpu::Array,
    bound: impl Fn(&VertexBinding) -> VertexBinding,
) -> [f64; 3] {
    let placed = skin.skinned_vertices().unwrap();
    let local: Vec<[f32; 4]> = gpu.read_array(positions).unwrap();
    let nodes: Vec<DVec3> = local
        .iter()
        .map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()))
        .collect();
    let packed: Vec<u32> = gpu.read_array(skin.carrier().normals()).unwrap();
    let normals = unpacked(&packed);
    let frame = skin.carrier().frame();
    let mut worst = [0.0f64; 3];
    for (found, b) in placed.iter().zip(skin.bound()) {
        let truth = bound(b).skin(&nodes, &normals);
        let errors = [
            ((found.position - frame.origin) / frame.scale).distance(truth.position),
            found.normal.distance(truth.normal),
            found.tangent.distance(truth.tangent),
        ];
        assert!(errors.iter().all(|e| e.is_finite()));
        (0..3).for_each(|k| worst[k] = worst[k].max(errors[k]));
    }
    worst
}

#[test]
fn skinned_vertices_match_float64_on_random_input() {
    let gpu = gpu();
    let mut next = noise(7);
    for scene in scenes() {
        let frame = scene.frame();
        let rest_normals: Vec<u32> = BaseMesh::reference_normals(&scene.rest, &scene.triangles)
            .iter()
            .map(|n| n.map_or(NO_NORMAL, pack_normal))
            .collect();
        // Random positions, some coincident nodes, some degenerate triangles.
        let mut nodes: Vec<DVec3> = scene
            .rest
            .iter()
            .map(|_| frame.origin + 0.5 * frame.scale * DVec3::new(next(), next(), next()))
            .collect();
        let [a, b, c] = scene.triangles[0].map(|v| v as usize);
        nodes[c] = 0.5 * (nodes[a] + nodes[b]);
        let [a, b, c] = scene.triangles[5].map(|v| v as usize);
        (nodes[b], nodes[c]) = (nodes[a], nodes[a]);
        let packed: Vec<u32> = (0..nodes.len())
            .map(|i| match i % 7 {
                3 => NO_NORMAL,
                _ => pack_normal(DVec3::new(next(), next(), next())),
            })
            .collect();
        let positions = local_positions(&gpu, &frame, &nodes).unwrap();
        let normals = gpu.array_of("normals", Texel::U32, &packed).unwrap();
        let carrier = SkinBase::new(
            &positions,
            frame,
            &normals,
            &scene.rest,
            &rest_normals,
            &scene.triangles,
        )
        .unwrap();
        for mapping in Mapping::ALL {
            let skin = Skin::new(&gpu, &scene.skin, &carrier, mapping).unwrap();
            let found = errors(&gpu, &skin, &positions, |b| *b);
            println!("{}, {mapping}: {found:?}", scene.name);
            // Random normals give nearly degenerate bases, which lose up to three digits.
            assert!(found.iter().all(|e| *e < 2e-3), "{mapping}: {found:?}");
            // Another order of the nodes gives other positions: the comparison is effective.
            let wrong = errors(&gpu, &skin, &positions, |b| VertexBinding {
                nodes: [b.nodes[1], b.nodes[0], b.nodes[2]],
                ..*b
            });
            assert!(wrong[0] > 1e-2, "{mapping}: {wrong:?}");
        }
    }
}

#[test]
fn skinned_vertices_match_float64_on_bent_bodies() {
    let gpu = gpu();
    let mut next = noise(11);
    for scene in scenes() {
        let push = 0.02 * scene.frame().scale;
        let moved: Vec<DVec3> = scene
            .rest
            .iter()
            .map(|p| {
                let bend = DVec3::new(0.3 * p.y * p.z, 0.2 * p.x.sin(), 0.1 * p.x);
                *p + bend + push * DVec3::new(next(), next(), next())
            })
            .collect();
        let (carrier, positions) = scene.carrier(&gpu, &moved);
        for mapping in Mapping::ALL {
            let skin = Skin::new(&gpu, &scene.skin, &carrier, mapping).unwrap();
            let found = errors(&gpu, &skin, &positions, |b| *b);
            println!("{}, {mapping}: {found:?}", scene.name);
            assert!(
                found[0] < 2e-6 && found[1] < 2e-5 && found[2] < 2e-5,
                "{found:?}"
            );
        }
    }
}

#[test]
fn area_weighted_normals_match_float64() {
    let gpu = gpu();
    let mut next = noise(3);
    let mut scene = scenes().remove(0);
    // A node without triangles.
    scene.rest.push(DVec3::ZERO);
    let moved: Vec<DVec3> = scene
        .rest
        .iter()
        .map(|p| *p + 0.05 * DVec3::new(next(), next(), next()))
        .collect();
    let (carrier, _) = scene.carrier(&gpu, &moved);
    let mut work = gpu.start_recording();
    carrier.record_normals(&mut work);
    work.submit().unwrap();
    let found = unpacked(&gpu.read_array(carrier.normals()).unwrap());
    let frame: LocalFrame = scene.frame();
    let local: Vec<DVec3> = moved
        .iter()
        .map(|p| frame.to_local(*p).as_dvec3())
        .collect();
    let compare = |nodes: &[DVec3]| {
        let truth = BaseMesh::reference_normals(nodes, &scene.triangles);
        let pairs = found.iter().zip(&truth);
        pairs.fold(0.0f64, |worst, pair| match pair {
            (Some(a), Some(b)) => worst.max(a.distance(*b)),
            (None, None) => worst,
            _ => f64::INFINITY,
        })
    };
    let error = compare(&local);
    assert!(error < 1e-4 && error > 1e-6, "{error:e}");
    // At rest they differ: the comparison is effective.
    assert!(compare(&scene.rest) > 0.05);
    assert_eq!(found.last(), Some(&None));
}
