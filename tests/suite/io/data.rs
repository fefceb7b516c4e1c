//! Real meshes against their known counts.

use palpate::io;
use palpate::mesh::{Location, ScalarType, TetMesh, Topology};

fn read(name: &str) -> Option<TetMesh> {
    Some(io::read(crate::support::real_data(name)?).unwrap())
}

#[test]
fn real_meshes_have_expected_counts() {
    let table: [(&str, usize, usize, usize, f64); 12] = [
        ("tet/bullet_boot.vtk", 610, 2_419, 718, 0.563399),
        ("tet/bullet_ditto.vtk", 2_580, 10_415, 2_968, 23.4659),
        (
            "tet/chaste_ellipsoid_15811.node",
            3_432,
            15_811,
            3_666,
            0.279792,
        ),
        (
            "tet/chaste_ellipsoid_15811.ele",
            3_432,
            15_811,
            3_666,
            0.279792,
        ),
        ("tet/gaia_liver.mesh", 10_641, 40_240, 16_252, 498.584),
        ("tet/polyfem_cubes_v22.msh", 7_714, 32_981, 7_610, 2.0979),
        ("tet/polyfem_cubes_v41.msh", 7_714, 32_981, 7_610, 2.0979),
        ("tet/polyfem_41_binary.msh", 8, 5, 12, 0.8333),
        (
            "tet/polyfem_Armadillo13K.msh",
            13_230,
            54_985,
            17_296,
            237_516.0,
        ),
        ("tet/gaia_alligator.vtk", 25_966, 108_744, 34_376, 0.0441733),
        (
            "scalar/disk_out_ref_tets.vtu",
            8_499,
            44_832,
            3_976,
            1629.66,
        ),
        // 173 in the file; one of them is unused.
        ("scalar/chaste_heart_decimation.vtu", 172, 610, 312, 6.40447),
    ];
    for (name, nodes, tets, boundary, volume) in table {
        let Some(mesh) = read(name) else {
            continue;
        };
        assert_eq!(mesh.nodes.len(), nodes, "{name}");
        assert_eq!(mesh.tets.len(), tets, "{name}");
        assert_eq!(Topology::new(&mesh).boundary.len(), boundary, "{name}");
        assert_eq!(mesh.repairs.inverted_fixed, 0, "{name}");
        assert_eq!(mesh.repairs.degenerate, 0, "{name}");
        // The table has four to six digits.
        let error = (mesh.volume() - volume).abs() / volume;
        assert!(error < 5e-5, "{name}: volume {}", mesh.volume());
    }
}

#[test]
fn disk_fields_match_reference() {
    let Some(mesh) = read("scalar/disk_out_ref_tets.vtu") else {
        return;
    };
    let names: Vec<&str> = mesh.fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["Temp", "V", "Pres", "AsH3", "H2"]);
    let temperature = mesh.field("Temp", Location::Node).unwrap();
    assert_eq!(temperature.scalar_type, ScalarType::F32);
    let (low, high) = temperature.range().unwrap();
    assert!((low - 293.15).abs() < 1e-4 && (high - 913.15).abs() < 1e-4);
    assert_eq!(mesh.field("V", Location::Node).unwrap().components, 3);
}

#[test]
fn heart_fields_match_reference() {
    let Some(mesh) = read("scalar/chaste_heart_decimation.vtu") else {
        return;
    };
    assert_eq!(mesh.repairs.unused_nodes, 1);
    let distance = mesh.field("Distance from origin", Location::Node).unwrap();
    for (p, d) in mesh.nodes.iter().zip(&distance.values) {
        assert!((p.length() - d).abs() < 1e-12, "values follow their nodes");
    }
    let (low, high) = distance.range().unwrap();
    assert!((low - 0.5728).abs() < 1e-4 && (high - 2.0948).abs() < 1e-4);
    let centroid = mesh.field("Centroid", Location::Cell).unwrap();
    for t in 0..mesh.tets.len() {
        let c = mesh.tet_nodes(t).iter().sum::<glam::DVec3>() / 4.0;
        let given = glam::DVec3::from_slice(&centroid.values[3 * t..]);
        assert!((c - given).length() < 1e-9, "values follow their cells");
    }
}

#[test]
fn gmsh_versions_2_and_4_read_identically() {
    let files = ["tet/polyfem_cubes_v22.msh", "tet/polyfem_cubes_v41.msh"];
    let [Some(old), Some(new)] = files.map(read) else {
        return;
    };
    for mesh in [&old, &new] {
        let material = mesh.field("gmsh:physical", Location::Cell).unwrap();
        assert_eq!(material.range(), Some((1.0, 3.0)));
    }
    let volumes = |mesh: &TetMesh| {
        let material = mesh.field("gmsh:physical", Location::Cell).unwrap();
        let mut volumes = [0.0; 4];
        for (t, m) in material.values.iter().enumerate() {
            volumes[*m as usize] += mesh.tet_volume(t);
        }
        volumes
    };
    for (a, b) in volumes(&old).iter().zip(volumes(&new)) {
        assert!((a - b).abs() < 1e-9 * a.abs().max(1.0), "{a} {b}");
    }
}
