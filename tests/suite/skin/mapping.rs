//! Properties of the mappings: at rest, under rigid motion, bent; and rejected input.

use crate::skin::common::*;
use glam::{DMat3, DQuat, DVec3};
use palpate::mesh::{NO_NORMAL, TriMesh, pack_normal};
use palpate::physics::grid::{GridModel, GridShape};
use palpate::physics::{GridBody, Material};
use palpate::render::Camera;
use palpate::skin::basis::VertexBinding;
use palpate::skin::{BaseMesh, Mapping, Skin, SkinBase, Vertices};
use std::collections::HashMap;

#[test]
fn mappings_reproduce_skin_at_rest() {
    let gpu = gpu();
    for scene in scenes() {
        let (carrier, _) = scene.carrier(&gpu, &scene.rest);
        let whole = size(&scene.skin.vertices);
        for mapping in Mapping::ALL {
            let skin = Skin::new(&gpu, &scene.skin, &carrier, mapping).unwrap();
            let binding = skin.binding();
            let error = apart(&skin.vertices().unwrap(), &scene.skin.vertices) / whole;
            println!("{}, {mapping}: {error:.1e}, {binding:?}", scene.name);
            let vertices = skin.bound().len();
            match mapping {
                // It snaps vertices to nodes, hence the large error.
                Mapping::OneToOne => assert!(error > 1e-2 && binding.one_to_one == vertices),
                Mapping::Constant => assert_eq!(binding.constant, vertices),
                Mapping::Interpolated => assert_eq!(binding.interpolated, vertices),
                Mapping::NormalOnly => {
                    assert!(binding.normal_only > vertices / 2);
                    assert_eq!(binding.normal_only + binding.constant, vertices);
                }
                Mapping::Auto => {
                    assert!(binding.interpolated > 0);
                    let others = binding.constant + binding.one_to_one + binding.normal_only;
                    assert_eq!(binding.interpolated + others, vertices);
                }
            }
            if mapping != Mapping::OneToOne {
                assert!(error < 1e-6, "{}, {mapping}: {error:e}", scene.name);
                let placed = skin.skinned_vertices().unwrap();
                let normals: Vec<DVec3> = placed.iter().map(|p| p.normal).collect();
                assert!(apart(&normals, &skin.rest().normals) < 2e-6);
                let tangents: Vec<DVec3> = placed.iter().map(|p| p.tangent).collect();
                assert!(apart(&tangents, &skin.rest().tangents) < 2e-6);
            }
        }
    }
}

#[test]
fn rigid_motion_moves_skin_rigidly() {
    let gpu = gpu();
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, -2.0, 0.7).normalize(), 2.2);
    for scene in scenes() {
        let moved = |p: &DVec3| turn * *p + DVec3::new(0.3, -0.2, 0.1);
        let nodes: Vec<DVec3> = scene.rest.iter().map(moved).collect();
        let (carrier, _) = scene.carrier(&gpu, &nodes);
        let whole = size(&scene.skin.vertices);
        for mapping in Mapping::ALL {
            let skin = Skin::new(&gpu, &scene.skin, &carrier, mapping).unwrap();
            let rest = skin.rest();
            let turned = |v: &[DVec3]| v.iter().map(|n| turn * *n).collect::<Vec<_>>();
            // The reference, with unrounded normals: exact.
            let frame = scene.frame();
            let base = carrier.rest_mesh();
            let normals = unpacked(base.normals);
            let there: Vec<DVec3> = base.nodes.iter().map(|p| turn * *p).collect();
            let turned_normals: Vec<Option<DVec3>> =
                normals.iter().map(|n| n.map(|n| turn * n)).collect();
            let exact = |b: &VertexBinding| {
                let before = b.skin(base.nodes, &normals);
                let after = b.skin(&there, &turned_normals);
                (after.position.distance(turn * before.position))
                    .max(after.normal.distance(turn * before.normal))
                    .max(after.tangent.distance(turn * before.tangent))
            };
            let worst = skin.bound().iter().map(exact).fold(0.0, f64::max);
            assert!(worst < 1e-12, "{}, {mapping}: {worst:e}", scene.name);
            // The GPU, with normals rounded to 4e-5 twice: proportional to the length of offsets.
            let placed = skin.skinned_vertices().unwrap();
            let at = |f: fn(&palpate::skin::basis::SkinnedVertex) -> DVec3| {
                placed.iter().map(f).collect::<Vec<_>>()
            };
            if mapping == Mapping::OneToOne {
                // On its node; the normals are those of the node, so only rounding errors occur.
                let home = |p: &DVec3| nodes.iter().any(|q| q.distance(*p) < 1e-6 * frame.scale);
                assert!(at(|p| p.position).iter().all(home));
                continue;
            }
            let expected: Vec<DVec3> = rest.positions.iter().map(moved).collect();
            let error = apart(&at(|p| p.position), &expected) / whole;
            let allowed = 1e-6 + 2e-4 * skin.binding().longest_offset / whole;
            assert!(error < allowed, "{}, {mapping}: {error:e}", scene.name);
            assert!(apart(&at(|p| p.normal), &turned(&rest.normals)) < 3e-4);
            assert!(apart(&at(|p| p.tangent), &turned(&rest.tangents)) < 3e-4);
            // With unmoved nodes, all of these checks would fail.
            assert!(apart(&at(|p| p.normal), &rest.normals) > 0.5);
        }
    }
}

/// A ball as a domain to carve grids from.
struct Ball(f64);

impl palpate::mesher::Domain for Ball {
    fn bounds(&self) -> (DVec3, DVec3) {
        (DVec3::splat(-self.0), DVec3::splat(self.0))
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        weights.push((1, self.0 - p.length()));
    }
}

#[test]
fn grid_body_skin_uses_approximate_normals() {
    let gpu = gpu();
    let shape = GridShape::from_domain_with_count(&Ball(1.05), 3000, DMat3::IDENTITY).unwrap();
    let model = GridModel::new(shape, &Material::from_young(1e4)).unwrap();
    let mut body = GridBody::new(&gpu, model).unwrap();
    let surface = bumpy(40);
    let whole = size(&surface.vertices);
    let carrier = SkinBase::from_grid(&mut body).unwrap();
    let skins = Mapping::ALL.map(|m| Skin::new(&gpu, &surface, &carrier, m).unwrap());
    for (skin, mapping) in skins.iter().zip(Mapping::ALL) {
        let error = apart(&skin.vertices().unwrap(), &surface.vertices) / whole;
        println!("grid, {mapping}: {error:.1e}, {:?}", skin.binding());
        assert_eq!(error < 1e-6, mapping != Mapping::OneToOne, "{error:e}");
    }
    // Rotated and translated rigidly; its next step computes the normals there.
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 0.5).normalize(), 1.1);
    let moved = |p: &DVec3| turn * *p + DVec3::new(0.2, 0.1, -0.1);
    let nodes: Vec<DVec3> = body.mesh().nodes.iter().map(moved).collect();
    body.set_positions(&nodes).unwrap();
    body.run(1, 1e-6).unwrap();
    let expected: Vec<DVec3> = surface.vertices.iter().map(moved).collect();
    for (skin, mapping) in skins.iter().zip(Mapping::ALL).skip(1) {
        let error = apart(&skin.vertices().unwrap(), &expected) / whole;
        assert!(error < 3e-5, "{mapping}: {error:e}");
    }
}

/// The bar rolled up along x by `angle`, with its lower side inside.
fn rolled(p: DVec3, angle: f64) -> DVec3 {
    let radius = 8.0 / angle;
    let turn = p.x / radius;
    let arm = radius + p.z;
    DVec3::new(arm * turn.sin(), p.y, arm * turn.cos() - radius)
}

#[test]
fn bent_bar_skin_is_continuous_with_interpolated_bases_only() {
    let gpu = gpu();
    let scene = bar();
    let bent: Vec<DVec3> = scene.rest.iter().map(|p| rolled(*p, 3.0)).collect();
    let (carrier, _) = scene.carrier(&gpu, &bent);
    let stretch = |mapping| {
        let mut skin = Skin::new(&gpu, &scene.skin, &carrier, mapping).unwrap();
        let camera = Camera::perspective(
            DVec3::new(3.5, -10.0, 3.0),
            DVec3::new(1.0, 0.5, -2.7),
            DVec3::Z,
            42.0,
        );
        let image = skin.image(&camera, [480, 480]).unwrap();
        keep(&image, &format!("bent-bar-{mapping}.png"));
        let placed = skin.skinned_vertices().unwrap();
        let (rest, bound) = (skin.rest(), skin.bound());
        let sorted = |v: u32| {
            let mut nodes = bound[v as usize].nodes;
            nodes.sort_unstable();
            nodes
        };
        let (mut largest, mut across) = (0.0f64, 0);
        for [a, b, c] in &rest.triangles {
            for (v, w) in [(*a, *b), (*b, *c), (*c, *a)] {
                if sorted(v) == sorted(w) {
                    continue;
                }
                across += 1;
                let (v, w) = (v as usize, w as usize);
                let before = rest.positions[v].distance(rest.positions[w]);
                let after = placed[v].position.distance(placed[w].position);
                largest = largest.max(after / before);
            }
        }
        assert!(across > 1000, "{across}");
        largest
    };
    let constant = stretch(Mapping::Constant);
    let interpolated = stretch(Mapping::Interpolated);
    println!("largest stretch: constant {constant:.2}, interpolated {interpolated:.2}");
    assert!(interpolated <= 0.5 * constant, "{interpolated} {constant}");
    // Rolling up stretches the outside of the bar by about half.
    assert!(interpolated > 1.2 && interpolated < 2.0);
}

#[test]
fn auto_mapping_uses_constant_basis_where_needed_or_invisible() {
    let scene = &scenes()[0];
    let frame = scene.frame();
    let nodes: Vec<DVec3> = scene
        .rest
        .iter()
        .map(|p| frame.to_local(*p).as_dvec3())
        .collect();
    let mut normals: Vec<u32> = BaseMesh::reference_normals(&nodes, &scene.triangles)
        .iter()
        .map(|n| n.map_or(NO_NORMAL, pack_normal))
        .collect();
    let vertices = Vertices::new(&scene.skin).unwrap();
    let count = |normals: &[u32], vertices: &Vertices, mapping| {
        let base = BaseMesh {
            nodes: &nodes,
            triangles: &scene.triangles,
            normals,
        };
        base.bind(vertices, &frame, mapping).unwrap()
    };
    let (_, good) = count(&normals, &vertices, Mapping::Auto);
    assert_eq!(good.fallbacks, 0);
    // One node without a normal, one with an inward normal.
    normals[10] = NO_NORMAL;
    normals[40] = pack_normal(-scene.rest[40]);
    let (bound, report) = count(&normals, &vertices, Mapping::Auto);
    assert!(report.fallbacks > 10 && report.fallbacks < bound.len() / 4);
    for b in &bound {
        let bad = b.nodes.contains(&10) || b.nodes.contains(&40);
        assert!(!(bad && b.interpolated));
    }
    // A skin on the body's own surface is the same with either mapping: `Auto` does not interpolate.
    let close = TriMesh {
        vertices: scene.rest.iter().map(|p| *p * 1.001).collect(),
        triangles: scene.triangles.clone(),
        ..TriMesh::default()
    };
    let close = Vertices::new(&close).unwrap();
    let (_, report) = count(&normals, &close, Mapping::Auto);
    assert_eq!(report.interpolated, 0);
    let (_, report) = count(&normals, &close, Mapping::Interpolated);
    // One vertex is not over a face.
    assert_eq!(report.interpolated, close.positions.len() - 1);
    // Without any normals every mapping falls back to the constant basis, with a note.
    let none = vec![NO_NORMAL; normals.len()];
    for mapping in [Mapping::Interpolated, Mapping::NormalOnly, Mapping::Auto] {
        let (_, report) = count(&none, &vertices, mapping);
        assert_eq!(report.fallbacks, vertices.positions.len());
    }
}

#[test]
fn degenerate_base_triangles_are_unused_and_invalid_input_rejected() {
    let gpu = gpu();
    let mut scene = scenes().remove(0);
    // A sliver along an edge of the first triangle, and a point.
    let [a, b, _] = scene.triangles[0];
    let middle = 0.5 * (scene.rest[a as usize] + scene.rest[b as usize]);
    scene.rest.push(middle * 1.0001);
    let m = scene.rest.len() as u32 - 1;
    scene.triangles.push([a, m, b]);
    scene.triangles.push([m, m, m]);
    let (carrier, _) = scene.carrier(&gpu, &scene.rest);
    let skin = Skin::new(&gpu, &scene.skin, &carrier, Mapping::Constant).unwrap();
    assert_eq!(skin.binding().flat_triangles, 2);
    assert!(skin.bound().iter().all(|b| !b.nodes.contains(&m)));
    let error = apart(&skin.vertices().unwrap(), &scene.skin.vertices);
    assert!(error < 1e-6 * size(&scene.skin.vertices), "{error:e}");

    let refused = |carrier: &_, surface: &TriMesh| {
        Skin::new(&gpu, surface, carrier, Mapping::Auto)
            .err()
            .unwrap()
            .to_string()
    };
    let flat = Scene {
        triangles: vec![[0, 0, 1]],
        rest: scene.rest.clone(),
        skin: scene.skin.clone(),
        ..scene
    };
    let (nothing, _) = flat.carrier(&gpu, &flat.rest);
    assert!(refused(&nothing, &flat.skin).contains("base triangles are degenerate"));
    assert!(refused(&carrier, &TriMesh::default()).contains("triangles"));
    let mut broken = flat.skin.clone();
    broken.triangles[3][1] = 1_000_000;
    assert!(refused(&carrier, &broken).contains("1000000"));
    let mut broken = flat.skin.clone();
    broken.vertices[5].x = f64::NAN;
    assert!(refused(&carrier, &broken).contains("vertex 5"));
    assert!("curly".parse::<Mapping>().is_err());
    for mapping in Mapping::ALL {
        assert_eq!(mapping.to_string().parse::<Mapping>().unwrap(), mapping);
    }
}

#[test]
fn holes_are_reported_and_triangles_oriented() {
    let gpu = gpu();
    let scene = scenes().remove(0);
    let mut skin = scene.skin.clone();
    // A hole of one triangle, and one flipped triangle.
    skin.triangles.remove(500);
    skin.triangles[100].swap(0, 1);
    let (carrier, _) = scene.carrier(&gpu, &scene.rest);
    let skin = Skin::new(&gpu, &skin, &carrier, Mapping::Auto).unwrap();
    let report = skin.report();
    assert_eq!((report.open_edges, report.flipped_triangles), (3, 1));
    let notes = report.notes().join("; ");
    assert!(notes.contains("3 open edges"), "{notes}");
}

#[test]
fn texture_seams_split_vertices_without_gaps() {
    let gpu = gpu();
    let scene = scenes().remove(0);
    // A texture once around: at the seam u is 0 on one side and 1 on the other.
    let skin = with_uvs(&scene.skin);
    let stretched: Vec<DVec3> = scene
        .rest
        .iter()
        .map(|p| DVec3::new(p.x * 1.4 + 0.2 * p.y * p.z, p.y, 0.8 * p.z))
        .collect();
    let (carrier, _) = scene.carrier(&gpu, &stretched);
    let skin = Skin::new(&gpu, &skin, &carrier, Mapping::Interpolated).unwrap();
    assert!(skin.report().drawn_vertices > skin.report().vertices + 20);
    let placed = skin.skinned_vertices().unwrap();
    let mut first = HashMap::new();
    for (p, source) in placed.iter().zip(&skin.rest().sources) {
        assert_eq!(*first.entry(*source).or_insert(p.position), p.position);
    }
    // Tangents run along u: around the z axis, at rest.
    let rest = skin.rest();
    for (p, t) in rest.positions.iter().zip(&rest.tangents) {
        if p.truncate().length() > 0.4 {
            let around = DVec3::new(-p.y, p.x, 0.0).normalize();
            assert!(t.dot(around) > 0.7, "{p} {t}");
        }
    }
    assert!(rest.handedness.iter().all(|h| *h == 1.0));
}

/// Returns `surface`, a sphere, with longitude and latitude as texture coordinates.
pub fn with_uvs(surface: &TriMesh) -> TriMesh {
    let mut values = Vec::new();
    for t in 0..surface.triangles.len() {
        let corners = surface.corners(t);
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let longitude = |p: DVec3| p.y.atan2(p.x) / std::f64::consts::TAU;
        for p in corners {
            let mut u = longitude(p) - longitude(middle);
            // At a pole any value will do; elsewhere the side of the seam of the centroid.
            u = if p.truncate().length() < 1e-6 {
                0.0
            } else {
                u - u.round()
            };
            values.push(u + longitude(middle) + 0.5);
            values.push(0.5 + (p.z / p.length()).asin() / std::f64::consts::PI);
        }
    }
    let mut surface = surface.clone();
    surface.fields.push(palpate::mesh::Field {
        components: 6,
        ..palpate::mesh::Field::scalar("uv", palpate::mesh::Location::Cell, values)
    });
    surface
}
