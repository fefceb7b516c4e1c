//! Cuts through meshes, and removal of tets.

use crate::mesh::support::check_topology;
use glam::DVec3;
use palpate::generate::{Split, ball, bar, box_mesh};
use palpate::mesh::{
    Blade, BoundaryReport, Field, Location, TetCut, TetMesh, Topology, components, cut, remove,
};
use proptest::prelude::*;
use std::collections::BTreeSet;

/// Returns a square blade about `centre` perpendicular to `normal`, of half-width `half`.
fn across(centre: DVec3, normal: DVec3, half: f64) -> Blade {
    let u = normal.any_orthonormal_vector();
    let v = normal.cross(u);
    let corner = |a: f64, b: f64| centre + half * (a * u + b * v);
    Blade::from_quad([
        corner(-1.0, -1.0),
        corner(1.0, -1.0),
        corner(1.0, 1.0),
        corner(-1.0, 1.0),
    ])
    .unwrap()
}

/// Returns the first error in a mesh and its topology after a cut of `before`, if there is one.
fn flaw(before: &TetMesh, after: &TetMesh, topology: &Topology, cut: &TetCut) -> Option<String> {
    let fresh = Topology::new(after);
    let corners = |mesh: &TetMesh| -> Vec<[DVec3; 4]> {
        (0..mesh.tets.len()).map(|t| mesh.tet_nodes(t)).collect()
    };
    let bare = Topology::new(before).boundary.len() + 2 * cut.opened_faces.len();
    let mut edges: BTreeSet<[u32; 2]> = before.edges().into_iter().collect();
    cut.previous_edges
        .iter()
        .for_each(|e| assert!(edges.remove(e)));
    edges.extend(cut.edge_tets.iter().map(|(edge, _)| *edge));
    let claims = [
        ("tets unchanged", corners(before) == corners(after)),
        ("neighbours", fresh.neighbours == topology.neighbours),
        ("boundary", fresh.boundary == topology.boundary),
        ("edges", edges == after.edges().into_iter().collect()),
        ("faces opened", bare == topology.boundary.len()),
        (
            "nodes duplicated",
            before.nodes.len() + cut.duplicated_nodes.len() == after.nodes.len(),
        ),
        (
            "field length matches the mesh",
            after.fields.iter().all(|f| {
                f.location == Location::Cell || f.values.len() == f.components * after.nodes.len()
            }),
        ),
    ];
    let wrong = claims.iter().find(|(_, holds)| !holds);
    wrong.map(|(claim, _)| (*claim).to_owned())
}

/// Cuts a copy of `mesh`, and checks the invariants of cuts.
fn checked(mesh: &TetMesh, positions: &[DVec3], blade: &Blade) -> (TetMesh, Topology, TetCut) {
    let (mut after, mut topology) = (mesh.clone(), Topology::new(mesh));
    let cut = cut(&mut after, &mut topology, positions, blade).unwrap();
    assert_eq!(flaw(mesh, &after, &topology, &cut), None);
    // Lists contain exactly the changes.
    let old = Topology::new(mesh);
    let changed = |t: &u32| {
        let t = *t as usize;
        mesh.tets[t] != after.tets[t] || old.neighbours[t] != topology.neighbours[t]
    };
    let all: Vec<u32> = (0..mesh.tets.len() as u32).collect();
    assert_eq!(
        cut.tets,
        all.iter().copied().filter(changed).collect::<Vec<_>>()
    );
    let at = |t: &u32| {
        after.tets[*t as usize]
            .iter()
            .any(|v| cut.nodes.contains(v))
    };
    assert_eq!(
        cut.incident_tets,
        all.into_iter().filter(at).collect::<Vec<_>>()
    );
    (after, topology, cut)
}

#[test]
fn through_cut_leaves_two_components() {
    let whole = bar([8, 4, 4], DVec3::new(0.12, 0.06, 0.06)).unwrap();
    let middle = DVec3::new(0.06, 0.03, 0.03);
    // In a plane of the lattice, where the result is known.
    let (mesh, topology, cut) = checked(&whole, &whole.nodes, &across(middle, DVec3::X, 0.1));
    assert_eq!(
        (cut.opened_faces.len(), cut.duplicated_nodes.len()),
        (32, 25)
    );
    check_topology(&mesh);
    let (piece, pieces) = components(&topology);
    assert_eq!(pieces, 2);
    let volume = |side: u32| -> f64 {
        let tets = (0..mesh.tets.len()).filter(|t| piece[*t] == side);
        tets.map(|t| mesh.tet_volume(t)).sum()
    };
    assert!((volume(0) - volume(1)).abs() < 1e-12 * mesh.volume());
    assert!((mesh.volume() - whole.volume()).abs() < 1e-12 * whole.volume());
    // No edge crosses the blade, and no node belongs to both components.
    let side = |v: u32| mesh.nodes[v as usize].x - middle.x;
    let edges = mesh.edges();
    assert!(edges.iter().all(|[a, b]| side(*a) * side(*b) > -1e-15));
    let mut owner = vec![None; mesh.nodes.len()];
    for (t, tet) in mesh.tets.iter().enumerate() {
        for v in tet {
            assert_eq!(*owner[*v as usize].get_or_insert(piece[t]), piece[t]);
        }
    }
    let shape = BoundaryReport::new(&mesh, &topology);
    assert!(shape.is_vertex_manifold() && shape.euler_number() == 4);
    // The same from the other side of the blade, and oblique.
    for normal in [-DVec3::X, DVec3::new(1.0, 0.4, -0.3).normalize()] {
        let (_, topology, _) = checked(&whole, &whole.nodes, &across(middle, normal, 0.2));
        assert_eq!(components(&topology).1, 2);
    }
}

#[test]
fn cut_leaves_no_isolated_tet() {
    let whole = ball(1.0, 6).unwrap();
    for k in 0..24 {
        let angle = f64::from(k);
        let normal = DVec3::new(angle.sin(), (2.3 * angle).cos(), 0.4).normalize();
        let blade = across(0.3 * angle.cos() * normal, normal, 2.0);
        let (_, topology, _) = checked(&whole, &whole.nodes, &blade);
        let (piece, pieces) = components(&topology);
        let mut sizes = vec![0; pieces];
        piece.iter().for_each(|p| sizes[*p as usize] += 1);
        assert!(pieces >= 2 && sizes.iter().all(|n| *n > 1), "{sizes:?}");
    }
    // But two of one size are separated.
    let pair = TetMesh::new(
        vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, -DVec3::Z],
        vec![[0, 1, 2, 3], [0, 2, 1, 4]],
        vec![],
        vec![],
    )
    .unwrap();
    let (_, topology, _) = checked(&pair, &pair.nodes, &across(DVec3::ZERO, DVec3::Z, 2.0));
    assert_eq!(components(&topology).1, 2);
}

#[test]
fn centroids_on_blade_are_assigned_to_one_side() {
    // The centroids of Kuhn's tets are at quarters of a cell; the offset of the blade is of the
    // order of the rounding error.
    let whole = box_mesh([4, 4, 4], DVec3::ONE, Split::Six).unwrap();
    for x in [0.4375, 0.4375 + 1e-16, 0.5625, 0.625] {
        for turn in [1e-17, 0.0] {
            let normal = DVec3::new(1.0, turn, turn).normalize();
            let blade = across(DVec3::new(x, 0.5, 0.5), normal, 1.0);
            let (_, topology, _) = checked(&whole, &whole.nodes, &blade);
            assert_eq!(components(&topology).1, 2, "{x}");
        }
    }
}

#[test]
fn partial_cut_stays_connected_at_its_tip() {
    let whole = bar([8, 4, 4], DVec3::new(2.0, 1.0, 1.0)).unwrap();
    let edge = |z: f64| [DVec3::new(1.0, -1.0, z), DVec3::new(1.0, 2.0, z)];
    let half = Blade::from_sweep(&[edge(2.0), edge(0.5)]).unwrap();
    let (mesh, topology, cut) = checked(&whole, &whole.nodes, &half);
    assert_eq!(components(&topology).1, 1);
    // Two rows of four squares; the five nodes of the tip are not duplicated.
    assert_eq!(
        (cut.opened_faces.len(), cut.duplicated_nodes.len()),
        (16, 10)
    );
    assert!(
        cut.duplicated_nodes
            .iter()
            .all(|[_, old]| whole.nodes[*old as usize].z > 0.5)
    );
    check_topology(&mesh);
    // The second half separates it, as a single sweep would.
    let mut swept = (mesh, topology);
    let rest = Blade::from_sweep(&[edge(0.5), edge(-1.0)]).unwrap();
    let positions = swept.0.nodes.clone();
    let more = palpate::mesh::cut(&mut swept.0, &mut swept.1, &positions, &rest).unwrap();
    assert_eq!(
        (more.opened_faces.len(), more.duplicated_nodes.len()),
        (16, 15)
    );
    assert_eq!(components(&swept.1).1, 2);
}

#[test]
fn one_long_sweep_equals_many_short_sweeps() {
    let whole = ball(1.0, 8).unwrap();
    let edge = |k: f64| {
        let x = 0.3 * (2.0 * k).sin();
        [
            DVec3::new(x, -2.0, 1.5 - k),
            DVec3::new(x + 0.2, 2.0, 1.5 - k),
        ]
    };
    let edges: Vec<[DVec3; 2]> = (0..=20).map(|k| edge(0.15 * f64::from(k))).collect();
    let (once, topology, _) = checked(&whole, &whole.nodes, &Blade::from_sweep(&edges).unwrap());
    assert_eq!(components(&topology).1, 2);
    let (mut mesh, mut many) = (whole.clone(), Topology::new(&whole));
    for pair in edges.windows(2) {
        let positions = mesh.nodes.clone();
        let blade = Blade::from_sweep(pair).unwrap();
        cut(&mut mesh, &mut many, &positions, &blade).unwrap();
    }
    // Sets of faces too small to open when they were cut may have stayed closed.
    assert!(many.boundary.len() <= topology.boundary.len());
    assert!(many.boundary.len() > topology.boundary.len() / 2);
    assert_eq!(once.tets.len(), mesh.tets.len());
}

#[test]
fn cut_uses_deformed_positions() {
    let whole = bar([8, 4, 4], DVec3::new(2.0, 1.0, 1.0)).unwrap();
    let moved: Vec<DVec3> = whole.nodes.iter().map(|p| *p + DVec3::X * 10.0).collect();
    let blade = across(DVec3::new(11.0, 0.5, 0.5), DVec3::X, 2.0);
    let (_, topology, _) = checked(&whole, &moved, &blade);
    assert_eq!(components(&topology).1, 2);
    let (same, _, cut) = checked(&whole, &whole.nodes, &blade);
    assert!(cut.is_empty() && cut == TetCut::default());
    assert_eq!(same.nodes, whole.nodes);
}

#[test]
fn cut_preserves_node_fields() {
    let mut whole = ball(1.0, 5).unwrap();
    let values: Vec<f64> = whole.nodes.iter().flat_map(|p| p.to_array()).collect();
    let field = Field {
        components: 3,
        ..Field::scalar("place", Location::Node, values)
    };
    whole.set_field(field).unwrap();
    let blade = across(DVec3::ZERO, DVec3::new(0.3, 0.5, 0.8).normalize(), 2.0);
    let (mesh, _, cut) = checked(&whole, &whole.nodes, &blade);
    assert!(!cut.duplicated_nodes.is_empty());
    let places = mesh.field("place", Location::Node).unwrap();
    for (p, place) in mesh.nodes.iter().zip(places.values.chunks_exact(3)) {
        assert_eq!(*p, DVec3::from_slice(place));
    }
}

#[test]
fn topology_comparison_detects_corruption() {
    let whole = ball(1.0, 5).unwrap();
    let blade = across(DVec3::ZERO, DVec3::Z, 2.0);
    let (mesh, topology, cut) = checked(&whole, &whole.nodes, &blade);
    let mut wrong = mesh.clone();
    let [new, old] = cut.duplicated_nodes[0];
    for tet in &mut wrong.tets {
        tet.iter_mut().filter(|v| **v == new).for_each(|v| *v = old);
    }
    assert!(flaw(&whole, &wrong, &topology, &cut).is_some());
    let mut linked = topology.clone();
    linked.boundary.pop();
    assert_eq!(flaw(&whole, &mesh, &linked, &cut).unwrap(), "boundary");
}

#[test]
fn external_meshes_are_cut() {
    for name in [
        "tet/gaia_liver.mesh",
        "tet/bullet_ditto.vtk",
        "scalar/chaste_heart_decimation.vtu",
    ] {
        let Some(path) = crate::support::real_data(name) else {
            continue;
        };
        let whole = palpate::io::read(path).unwrap();
        let (low, high) = whole.bounds();
        let (centre, reach) = (0.5 * (low + high), (high - low).length());
        for normal in [DVec3::X, DVec3::new(-0.48, 0.6, 0.64)] {
            let pieces = components(&Topology::new(&whole)).1;
            let (mesh, topology, cut) =
                checked(&whole, &whole.nodes, &across(centre, normal, reach));
            assert!(cut.opened_faces.len() > 20, "{name}");
            assert!(components(&topology).1 > pieces, "{name}");
            assert!((mesh.volume() / whole.volume() - 1.0).abs() < 1e-12);
            let (_, topology, cut) =
                checked(&whole, &whole.nodes, &across(low, normal, 0.6 * reach));
            assert!(topology.boundary.len() >= cut.opened_faces.len());
        }
    }
}

/// 48 random cases; 6 if others are reduced to a quarter.
fn some_cases() -> ProptestConfig {
    let usual = ProptestConfig::default();
    ProptestConfig::with_cases(if usual.cases < 256 { 6 } else { 48 })
}

proptest! {
    #![proptest_config(some_cases())]
    #[test]
    fn random_cuts_preserve_mesh_invariants(
        corners in prop::collection::vec((-1.2..1.2, -1.2..1.2, -1.2..1.2), 4..12),
        cells in 3..7usize,
    ) {
        let mut mesh = ball(1.0, cells).unwrap();
        let mut topology = Topology::new(&mesh);
        let points: Vec<DVec3> = corners.into_iter().map(DVec3::from).collect();
        let edges: Vec<[DVec3; 2]> = points.chunks_exact(2).map(|p| [p[0], p[1]]).collect();
        // Deformed, then cut again through the previous cut.
        for blade in [Blade::from_sweep(&edges).unwrap(), Blade::from_sweep(&edges[..2]).unwrap()] {
            let before = mesh.clone();
            let positions = mesh.nodes.clone();
            let faces = topology.boundary.len();
            let done = cut(&mut mesh, &mut topology, &positions, &blade).unwrap();
            prop_assert_eq!(faces + 2 * done.opened_faces.len(), topology.boundary.len());
            prop_assert_eq!(flaw(&before, &mesh, &topology, &done), None);
        }
        check_topology(&mesh);
    }

    #[test]
    fn removing_random_tets_preserves_mesh_invariants(cells in 3..6usize, chosen in prop::collection::vec(any::<u32>(), 0..60)) {
        let mut mesh = ball(1.0, cells).unwrap();
        let count = mesh.tets.len() as u32;
        let ids = (0..count).map(f64::from).collect();
        mesh.set_field(Field::scalar("id", Location::Cell, ids)).unwrap();
        let (whole, mut topology) = (mesh.clone(), Topology::new(&mesh));
        let chosen: Vec<u32> = chosen.iter().map(|t| t % count).collect();
        let done = remove(&mut mesh, &mut topology, &chosen).unwrap();
        let gone: std::collections::BTreeSet<u32> = chosen.into_iter().collect();
        prop_assert_eq!(&done.removed, &gone.into_iter().collect::<Vec<_>>());
        check_topology(&mesh);
        let ids = &mesh.field("id", Location::Cell).unwrap().values;
        prop_assert_eq!(ids.len(), mesh.tets.len());
        for (t, id) in ids.iter().enumerate() {
            prop_assert!(!done.removed.contains(&(*id as u32)));
            prop_assert_eq!(mesh.tet_nodes(t), whole.tet_nodes(*id as usize));
        }
        prop_assert_eq!(&topology.neighbours, &Topology::new(&mesh).neighbours);
    }
}

#[test]
fn components_sharing_only_a_node_are_separated() {
    // A row of cells without its middle one, except for tets that touch along an edge.
    let mut mesh = box_mesh([3, 1, 1], DVec3::new(3.0, 1.0, 1.0), Split::Six).unwrap();
    let mut topology = Topology::new(&mesh);
    let middle = |t: &u32| {
        let x = mesh.tet_nodes(*t as usize).iter().map(|p| p.x).sum::<f64>() / 4.0;
        x > 1.0 && x < 2.0
    };
    let chosen: Vec<u32> = (0..18).filter(middle).collect();
    assert_eq!(chosen.len(), 6);
    // The last tet of the middle, connected only at nodes, is removed at the end.
    let done = remove(&mut mesh, &mut topology, &chosen).unwrap();
    assert!(done.duplicated_nodes.is_empty());
    assert_eq!(components(&topology).1, 2);
    // Of a 2 × 2 block of cells, two on a diagonal: they touch along an edge, which is duplicated.
    let mut mesh = box_mesh([2, 2, 1], DVec3::new(2.0, 2.0, 1.0), Split::Six).unwrap();
    let mut topology = Topology::new(&mesh);
    let off = |t: &u32| {
        let c = mesh.tet_nodes(*t as usize).iter().sum::<DVec3>() / 4.0;
        (c.x > 1.0) != (c.y > 1.0)
    };
    let chosen: Vec<u32> = (0..24).filter(off).collect();
    let done = remove(&mut mesh, &mut topology, &chosen).unwrap();
    assert_eq!((done.duplicated_nodes.len(), done.removed.len()), (2, 12));
    let shape = BoundaryReport::new(&mesh, &topology);
    assert!(shape.is_vertex_manifold() && shape.euler_number() == 4);
}

#[test]
fn invalid_cut_is_rejected_and_leaves_mesh_unchanged() {
    let mut mesh = ball(1.0, 3).unwrap();
    let (whole, mut topology) = (mesh.clone(), Topology::new(&mesh));
    let count = mesh.tets.len() as u32;
    let error = remove(&mut mesh, &mut topology, &[count]).unwrap_err();
    assert!(error.to_string().contains("counted from 0"), "{error}");
    let all: Vec<u32> = (0..count).collect();
    let error = remove(&mut mesh, &mut topology, &all).unwrap_err();
    assert!(error.to_string().contains("at least one"), "{error}");
    assert!(remove(&mut mesh, &mut topology, &[]).unwrap().is_empty());
    let blade = across(DVec3::ZERO, DVec3::Z, 2.0);
    let few = vec![DVec3::ZERO; 3];
    assert!(cut(&mut mesh, &mut topology, &few, &blade).is_err());
    let mut other = Topology::new(&ball(1.0, 4).unwrap());
    let positions = mesh.nodes.clone();
    assert!(cut(&mut mesh, &mut other, &positions, &blade).is_err());
    assert_eq!((mesh.tets, mesh.nodes), (whole.tets, whole.nodes));
    assert_eq!(
        topology.boundary,
        Topology::new(&ball(1.0, 3).unwrap()).boundary
    );
}
