//! `palpate info` on meshes with known defects, and on real ones.

use glam::DVec3;
use palpate::generate::{Bore, ball, benchmark_cube, duct};
use palpate::mesh::{Field, Location, MeshDescription, TetMesh};

/// Returns two tets; the second shares its first `shared` corners with the first.
fn two_tets(shared: usize) -> TetMesh {
    let mut nodes = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let mut second = [0, 1, 2, 3];
    let apart = [
        -DVec3::ONE,
        DVec3::new(1.5, -1.0, -2.0),
        DVec3::new(-2.0, 0.5, -1.0),
        -DVec3::Z,
    ];
    for (corner, at) in second.iter_mut().zip(apart).skip(shared) {
        *corner = nodes.len() as u32;
        nodes.push(at);
    }
    TetMesh::new(nodes, vec![[0, 1, 2, 3], second], vec![], vec![]).unwrap()
}

#[test]
fn manifoldness_of_tets_sharing_face_edge_node_or_nothing() {
    let manifoldness = |shared| {
        let d = MeshDescription::new(&two_tets(shared));
        (
            d.components,
            d.euler_number,
            d.nonmanifold_edges,
            d.nonmanifold_nodes,
            d.closed,
        )
    };
    assert_eq!(manifoldness(3), (1, 2, 0, 0, true));
    // Two spheres with a common edge: 4 − 1 − 1 fewer nodes and edges.
    assert_eq!(manifoldness(2), (2, 3, 1, 2, true));
    assert_eq!(manifoldness(1), (2, 3, 0, 1, true));
    assert_eq!(manifoldness(0), (2, 4, 0, 0, true));
    let d = MeshDescription::new(&two_tets(1));
    assert!(d.edge_manifold && !d.vertex_manifold);
    assert!(!MeshDescription::new(&two_tets(2)).edge_manifold);
    assert!(
        d.warnings
            .iter()
            .any(|w| w.contains("touch at this node only")),
        "{:?}",
        d.warnings
    );
}

#[test]
fn reports_coincident_nodes_along_seam() {
    let cube = benchmark_cube(2, false).unwrap();
    let mut nodes = cube.nodes.clone();
    nodes.extend(cube.nodes.iter().map(|p| *p + DVec3::X));
    let offset = cube.nodes.len() as u32;
    let mut tets = cube.tets.clone();
    tets.extend(cube.tets.iter().map(|t| t.map(|v| v + offset)));
    let d = MeshDescription::new(&TetMesh::new(nodes, tets, vec![], vec![]).unwrap());
    assert_eq!(
        (d.components, d.coincident_nodes, d.euler_number),
        (2, 9, 4)
    );
    assert!(d.edge_manifold && d.vertex_manifold && d.closed);
    assert_eq!(d.warnings.len(), 2, "{:?}", d.warnings);
}

#[test]
fn overshared_faces_give_closed_non_manifold_boundary() {
    let nodes = vec![
        DVec3::ZERO,
        DVec3::X,
        DVec3::Y,
        DVec3::Z,
        -DVec3::Z,
        DVec3::ONE,
    ];
    let tets = vec![[0, 1, 2, 3], [0, 2, 1, 4], [0, 1, 2, 5]];
    let d = MeshDescription::new(&TetMesh::new(nodes, tets, vec![], vec![]).unwrap());
    assert_eq!(
        (d.overshared_faces, d.boundary_faces, d.components),
        (1, 12, 3)
    );
    assert!(d.closed && !d.edge_manifold);
}

#[test]
fn json_report_has_documented_keys() {
    let mut mesh = duct([3, 3, 2], DVec3::ONE, Bore::Square).unwrap();
    let values = (0..mesh.nodes.len()).map(|i| i as f64 - 3.0).collect();
    mesh.set_field(Field::scalar("load", Location::Node, values))
        .unwrap();
    let nothing = vec![f64::NAN; mesh.tets.len()];
    mesh.set_field(Field::scalar("lost", Location::Cell, nothing))
        .unwrap();
    let description = MeshDescription::new(&mesh);
    let json = serde_json::to_value(&description).unwrap();
    assert_eq!(json["nodes"], 48);
    assert_eq!(json["tets"], 96);
    assert_eq!(json["boundary_faces"], 96);
    assert_eq!(json["components"], 1);
    assert_eq!(json["euler_number"], 0);
    assert!((json["volume"].as_f64().unwrap() - 8.0 / 9.0).abs() < 1e-12);
    assert_eq!(
        json["bounds"],
        serde_json::json!([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    );
    assert_eq!(
        (&json["inverted_fixed"], &json["degenerate"]),
        (&0.into(), &0.into())
    );
    let load = serde_json::json!(
        {"name": "load", "location": "point", "components": 1, "min": -3.0, "max": 44.0}
    );
    assert_eq!(json["fields"][0], load);
    assert!(json["fields"][1]["min"].is_null());
    assert_eq!(json["warnings"].as_array().unwrap().len(), 1);

    let text = description.to_string();
    for part in [
        "nodes            48\n",
        "Euler number 0",
        "closed, manifold",
        "load",
        "-3 … 44",
        "96 values",
    ] {
        assert!(text.contains(part), "{part} is missing in\n{text}");
    }
}

#[test]
fn text_report_is_readable_at_any_scale() {
    let mut mesh = ball(1e-5, 12).unwrap();
    for p in &mut mesh.nodes {
        *p += 1234.5;
    }
    let text = MeshDescription::new(&mesh).to_string();
    println!("{text}");
    assert!(text.contains("volume           4.1"), "{text}");
    assert!(text.contains("e-15"), "{text}");
    assert!(
        text.contains("1234.5 … 1234.5  (size 2.00000e-5)"),
        "{text}"
    );
}

/// The real meshes: name, nodes, tets, boundary faces, slivers, Euler number, volume; missing
/// numbers are not checked.
type Row = (
    &'static str,
    usize,
    usize,
    usize,
    Option<usize>,
    Option<i64>,
    f64,
);

const REAL: [Row; 12] = [
    (
        "tet/bullet_boot.vtk",
        610,
        2_419,
        718,
        Some(0),
        Some(2),
        0.563399,
    ),
    (
        "tet/bullet_ditto.vtk",
        2_580,
        10_415,
        2_968,
        Some(0),
        Some(2),
        23.4659,
    ),
    (
        "tet/chaste_ellipsoid_15811.node",
        3_432,
        15_811,
        3_666,
        Some(0),
        Some(2),
        0.279792,
    ),
    (
        "tet/gaia_liver.mesh",
        10_641,
        40_240,
        16_252,
        Some(75),
        Some(2),
        498.584,
    ),
    (
        "tet/polyfem_cubes_v22.msh",
        7_714,
        32_981,
        7_610,
        Some(0),
        Some(2),
        2.0979,
    ),
    (
        "tet/polyfem_cubes_v41.msh",
        7_714,
        32_981,
        7_610,
        Some(0),
        Some(2),
        2.0979,
    ),
    (
        "tet/polyfem_41_binary.msh",
        8,
        5,
        12,
        Some(0),
        Some(2),
        0.8333,
    ),
    (
        "tet/polyfem_Armadillo13K.msh",
        13_230,
        54_985,
        17_296,
        Some(0),
        Some(2),
        237_516.0,
    ),
    (
        "tet/gaia_alligator.vtk",
        25_966,
        108_744,
        34_376,
        Some(174),
        Some(2),
        0.0441733,
    ),
    (
        "scalar/disk_out_ref_tets.vtu",
        8_499,
        44_832,
        3_976,
        None,
        None,
        1629.66,
    ),
    // 173 nodes in the file, one of which is unused.
    (
        "scalar/chaste_heart_decimation.vtu",
        172,
        610,
        312,
        Some(13),
        Some(2),
        6.40447,
    ),
    (
        "tet/chaste_ellipsoid_15811.ele",
        3_432,
        15_811,
        3_666,
        Some(0),
        Some(2),
        0.279792,
    ),
];

#[test]
fn real_mesh_reports_match_reference() {
    for (name, nodes, tets, boundary, slivers, euler, volume) in REAL {
        let Some(path) = crate::support::real_data(name) else {
            continue;
        };
        let mesh = palpate::io::read(path).unwrap();
        let d = MeshDescription::new(&mesh);
        assert_eq!(
            (d.nodes, d.tets, d.boundary_faces),
            (nodes, tets, boundary),
            "{name}"
        );
        assert!(
            slivers.is_none_or(|n| n == d.quality.slivers),
            "{name}: {}",
            d.quality.slivers
        );
        assert!(
            euler.is_none_or(|n| n == d.euler_number),
            "{name}: {}",
            d.euler_number
        );
        assert!(
            (d.volume / volume - 1.0).abs() < 1e-4,
            "{name}: {}",
            d.volume
        );
        assert!(d.closed && d.edge_manifold, "{name}");
        assert_eq!(d.components, 1, "{name}");
        crate::mesh::support::check_topology(&mesh);
    }
}
