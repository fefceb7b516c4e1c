//! Every output format reads back with the same counts, volume, regions and fields.

use crate::io::sample::Bench;
use palpate::io::{self, MeshFormat};
use palpate::mesh::{Field, Location, MeshDescription, ScalarType, TetMesh};

/// Returns all output variants: format, whether as text, and a name.
pub fn ways() -> Vec<(MeshFormat, bool, &'static str)> {
    vec![
        (MeshFormat::Vtu, false, "a.vtu"),
        (MeshFormat::Vtk, false, "a.vtk"),
        (MeshFormat::Vtk, true, "text.vtk"),
        (MeshFormat::Gmsh41, false, "a41.msh"),
        (MeshFormat::Gmsh41, true, "text41.msh"),
        (MeshFormat::Gmsh22, false, "a22.msh"),
        (MeshFormat::Gmsh22, true, "text22.msh"),
        (MeshFormat::Medit, false, "a.mesh"),
        (MeshFormat::Tetgen, false, "a.node"),
        (MeshFormat::Tetgen, false, "b.ele"),
        (MeshFormat::Abaqus, false, "a.inp"),
    ]
}

/// Returns a bar with fields of several widths and tets in regions with these labels.
pub fn bar(labels: &[i64]) -> TetMesh {
    let mut mesh = palpate::generate::paper_bar().unwrap();
    for node in &mut mesh.nodes {
        // Numbers with all their digits, and with exponents.
        *node = *node / 3.0 + glam::DVec3::new(0.0, 1e-7, -1.0 / 7.0);
    }
    let (nodes, tets) = (mesh.nodes.len(), mesh.tets.len());
    let mut set = |name: &str, location, components, scalar_type, values: Vec<f64>| {
        let field = Field {
            name: name.into(),
            location,
            components,
            values,
            scalar_type,
        };
        mesh.set_field(field).unwrap();
    };
    let thirds = |count: usize| (0..count).map(|i| i as f64 / 3.0 - 1e-9).collect();
    set(
        "warm & cosy",
        Location::Node,
        1,
        ScalarType::F64,
        thirds(nodes),
    );
    set(
        "flow",
        Location::Node,
        3,
        ScalarType::F64,
        thirds(3 * nodes),
    );
    set(
        "pair",
        Location::Node,
        2,
        ScalarType::F64,
        thirds(2 * nodes),
    );
    set("quality", Location::Cell, 1, ScalarType::F64, thirds(tets));
    let whole = (0..tets).map(|t| (t % 7) as f64 - 3.0).collect();
    set("rank", Location::Cell, 1, ScalarType::I32, whole);
    let label = |t: usize| labels[t % labels.len()] as f64;
    let of_tet = (0..tets).map(label).collect();
    set("label", Location::Cell, 1, ScalarType::I64, of_tet);
    mesh
}

fn named(labels: &[i64], names: &[(i64, &str)]) -> TetMesh {
    let mut mesh = bar(labels);
    mesh.region_names = names.iter().map(|(l, n)| (*l, (*n).to_owned())).collect();
    mesh.length_unit = Some(1e-3);
    mesh
}

/// Returns the meshes to write: plain labels, labels and names that most formats cannot store
/// unchanged, labels without names, no labels.
fn meshes() -> Vec<TetMesh> {
    let mut plain = bar(&[1]);
    plain.fields.retain(|f| f.name != "label");
    vec![
        named(
            &[1, 2, 7],
            &[(1, "bone"), (2, "left knee"), (7, "Knorpel ä")],
        ),
        named(
            &[0, -3, 5_000_000_000, 4],
            &[
                (0, "a \"b\" & <c>\nd"),
                (-3, "1st, region"),
                (5_000_000_000, "1st; region"),
            ],
        ),
        bar(&[0, 1, 2]),
        bar(&[9]),
        plain,
    ]
}

#[test]
fn every_format_preserves_counts_volume_regions_names_and_unit() {
    let bench = Bench::new();
    for (number, mesh) in meshes().iter().enumerate() {
        for (format, text, name) in ways() {
            let what = format!("mesh {number} as {name}");
            let path = bench.path(name);
            let notes = io::write_as(&path, mesh, format, text).unwrap();
            let back = io::read(&path).unwrap_or_else(|e| panic!("{what}: {e}"));
            let repairs = &back.repairs;
            assert_eq!(repairs.warnings, Vec::<String>::new(), "{what}");
            assert_eq!(repairs.inverted_fixed + repairs.unused_nodes, 0, "{what}");
            assert_eq!(back.tets.len(), mesh.tets.len(), "{what}");
            assert_eq!(back.region_names, mesh.region_names, "{what}");
            assert_eq!(back.length_unit, mesh.length_unit, "{what}");
            // CalculiX accepts numbers of at most 20 characters.
            let close = match format {
                MeshFormat::Abaqus => 1e-14,
                _ => 0.0,
            };
            for (a, b) in back.nodes.iter().zip(&mesh.nodes) {
                assert!((*a - *b).length() <= close, "{what}: {a} is not {b}");
            }
            let volume = mesh.volume();
            assert!((back.volume() - volume).abs() < 1e-12 * volume, "{what}");
            // "rank" is a numbering: it is used for regions only if there is no better field, and
            // not every format can store it.
            let regions = |mesh: &TetMesh| match mesh.region_field() {
                Some(field) if field.name != "rank" => MeshDescription::new(mesh).regions,
                _ => Vec::new(),
            };
            let (a, b) = (regions(&back), regions(mesh));
            assert_eq!(a.len(), b.len(), "{what}");
            for (a, b) in a.iter().zip(&b) {
                assert_eq!(
                    (a.label, &a.name, a.tets),
                    (b.label, &b.name, b.tets),
                    "{what}"
                );
                assert!((a.volume - b.volume).abs() < 1e-12 * volume, "{what}");
            }
            for field in &mesh.fields {
                // Gmsh orders tets by region; only node fields are compared.
                let kept = back.field(&field.name, field.location);
                let left = notes
                    .iter()
                    .any(|n| n.contains(&format!("\"{}\"", field.name)));
                assert_eq!(kept.is_none(), left, "{what}: {} and {notes:?}", field.name);
                if let Some(kept) = kept {
                    let mut both = [kept.values.clone(), field.values.clone()];
                    if field.location == Location::Cell {
                        both.iter_mut().for_each(|v| v.sort_by(f64::total_cmp));
                    }
                    assert_eq!(both[0], both[1], "{what}: {}", field.name);
                }
            }
        }
    }
}

#[test]
fn dropped_data_is_reported() {
    let bench = Bench::new();
    let mesh = named(&[1, 2], &[(1, "bone")]);
    let of = |name: &str| io::write(bench.path(name), &mesh).unwrap().join("; ");
    for name in ["a.vtu", "a.vtk"] {
        assert_eq!(of(name), "");
    }
    let gmsh = of("a.msh");
    assert!(
        gmsh.contains("\"pair\"") && !gmsh.contains("\"flow\""),
        "{gmsh}"
    );
    let tetgen = of("a.node");
    assert!(
        tetgen.contains("\"quality\"") && !tetgen.contains("\"rank\""),
        "{tetgen}"
    );
    for name in ["a.mesh", "a.inp"] {
        let notes = of(name);
        for field in ["warm & cosy", "flow", "pair", "quality", "rank"] {
            assert!(notes.contains(field), "{name}: {notes}");
        }
        assert!(!notes.contains("\"label\""), "{notes}");
    }
    let renumbered = io::write(bench.path("b.msh"), &bar(&[0, 1]))
        .unwrap()
        .join("; ");
    assert!(renumbered.contains("renumbered from 1"), "{renumbered}");
}

#[test]
fn groups_of_other_formats_round_trip() {
    let bench = Bench::new();
    let mut mesh = bar(&[1]);
    mesh.fields.clear();
    let groups: Vec<f64> = (0..mesh.tets.len()).map(|t| (t % 3) as f64).collect();
    let group = Field::scalar("gmsh:physical", Location::Cell, groups.clone());
    mesh.set_field(group).unwrap();
    let sorted = |mesh: &TetMesh, name: &str| {
        let mut values = mesh.field(name, Location::Cell).unwrap().values.clone();
        values.sort_by(f64::total_cmp);
        values
    };
    for (file, field) in [
        ("a.msh", "gmsh:physical"),
        ("a.mesh", "medit:ref"),
        ("a.ele", "tetgen:ref"),
        ("a.inp", "label"),
    ] {
        io::write(bench.path(file), &mesh).unwrap();
        let back = io::read(bench.path(file)).unwrap();
        assert_eq!(
            sorted(&back, field),
            sorted(&mesh, "gmsh:physical"),
            "{file}"
        );
        assert_eq!(file == "a.inp", !back.region_names.is_empty(), "{file}");
        mesh = back;
        if file == "a.inp" {
            break;
        }
        mesh.fields.retain(|f| f.name == field);
        let mut only = mesh.fields[0].clone();
        only.name = "gmsh:physical".into();
        mesh.fields = vec![only];
    }
}

#[test]
fn truncated_file_never_reads_as_another_mesh() {
    let bench = Bench::new();
    let mut mesh = palpate::generate::bar([1, 1, 1], glam::DVec3::ONE).unwrap();
    let label = Field::scalar("label", Location::Cell, vec![3.0; mesh.tets.len()]);
    mesh.set_field(label).unwrap();
    mesh.region_names = [(3, "bone".to_owned())].into();
    for (format, text, name) in ways() {
        let path = bench.path(name);
        io::write_as(&path, &mesh, format, text).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes.len() < 20_000, "{name} is small: {}", bytes.len());
        for cut in 0..bytes.len() {
            // Cell type 10 truncated to 1 is a vertex: undetectable.
            if name == "text.vtk" && bytes[..cut].ends_with(b"\n1") {
                continue;
            }
            if let Ok(part) = bench.read(name, &bytes[..cut]) {
                let same = part.nodes == mesh.nodes && part.tets == mesh.tets;
                assert!(same, "{name} truncated at byte {cut} of {}", bytes.len());
            }
        }
        std::fs::write(&path, &bytes).unwrap();
    }
}

#[test]
fn rejects_unwritable_mesh_before_creating_file() {
    let bench = Bench::new();
    let mesh = bar(&[1]);
    for (name, format, text, expected) in [
        ("a.vtu", MeshFormat::Medit, false, "extension .mesh"),
        (
            "a.msh",
            MeshFormat::Tetgen,
            false,
            "extension .node or .ele",
        ),
        ("a.vtu", MeshFormat::Vtu, true, "cannot be written as text"),
    ] {
        let error = io::write_as(bench.path(name), &mesh, format, text).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
        assert!(!bench.path(name).exists());
    }
    let error = io::write(bench.path("a.stl"), &mesh)
        .unwrap_err()
        .to_string();
    for extension in [".vtu", ".vtk", ".msh", ".mesh", ".node", ".inp"] {
        assert!(error.contains(extension), "{error}");
    }
    let error = "obj".parse::<MeshFormat>().unwrap_err();
    assert!(error.contains("gmsh22"), "{error}");
    for (format, ..) in ways() {
        assert_eq!(format.to_string().parse(), Ok(format));
    }
    let mut odd = mesh.clone();
    odd.fields[0].values.pop();
    let mut out_of_range = mesh;
    out_of_range.tets[0][0] = u32::MAX;
    for (format, text, name) in ways() {
        for mesh in [&odd, &out_of_range] {
            assert!(io::write_as(bench.path(name), mesh, format, text).is_err());
            assert!(!bench.path(name).exists(), "{name}");
        }
    }
}

#[test]
#[ignore = "real data: scripts/test --full"]
fn real_meshes_preserve_counts_and_volume_in_every_format() {
    let bench = Bench::new();
    for name in [
        "tet/gaia_liver.mesh",
        "tet/polyfem_cubes_v41.msh",
        "scalar/chaste_heart_decimation.vtu",
    ] {
        let Some(path) = crate::support::real_data(name) else {
            return;
        };
        let mesh = io::read(path).unwrap();
        for (format, text, file) in ways() {
            io::write_as(bench.path(file), &mesh, format, text).unwrap();
            let back = io::read(bench.path(file)).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!(back.nodes.len(), mesh.nodes.len(), "{name} as {file}");
            assert_eq!(back.tets.len(), mesh.tets.len(), "{name} as {file}");
            let off = (back.volume() / mesh.volume() - 1.0).abs();
            assert!(off < 1e-12, "{name} as {file}: {off}");
        }
    }
}
