//! Written files read back identical; series stay valid.

use crate::io::sample::{Bench, Sample, bits};
use glam::DVec3;
use palpate::io::{self, PvdSeries};
use palpate::mesh::{Field, Location, ScalarType, TetMesh};
use proptest::prelude::*;

const TYPES: [ScalarType; 10] = [
    ScalarType::I8,
    ScalarType::U8,
    ScalarType::I16,
    ScalarType::U16,
    ScalarType::I32,
    ScalarType::U32,
    ScalarType::I64,
    ScalarType::U64,
    ScalarType::F32,
    ScalarType::F64,
];

/// Rounds `x` to a number that `scalar` can represent.
fn held(x: f64, scalar: ScalarType) -> f64 {
    match scalar {
        ScalarType::I8 => f64::from(x as i8),
        ScalarType::U8 => f64::from(x as u8),
        ScalarType::I16 => f64::from(x as i16),
        ScalarType::U16 => f64::from(x as u16),
        ScalarType::I32 => f64::from(x as i32),
        ScalarType::U32 => f64::from(x as u32),
        ScalarType::I64 => x as i64 as f64,
        ScalarType::U64 => x as u64 as f64,
        ScalarType::F32 => f64::from(x as f32),
        ScalarType::F64 => x,
    }
}

prop_compose! {
    fn field()(
        name in "[ -~äµ\t\n]{0,12}",
        node in any::<bool>(),
        components in 1..10usize,
        scalar in prop::sample::select(&TYPES[..]),
        values in prop::collection::vec(prop_oneof![any::<f64>(), -300.0..300.0f64, Just(f64::NAN), Just(-0.0)], 40 * 10),
    ) -> Field {
        Field {
            name,
            location: if node { Location::Node } else { Location::Cell },
            components,
            values: values.into_iter().map(|v| held(v, scalar)).collect(),
            scalar_type: scalar,
        }
    }
}

prop_compose! {
    fn mesh()(
        nodes in prop::collection::vec(prop::array::uniform3(-1e3..1e3f64), 4..40),
        tets in prop::collection::vec(prop::array::uniform4(any::<prop::sample::Index>()), 1..40),
        fields in prop::collection::vec(field(), 0..5),
    ) -> Option<TetMesh> {
        let tets = tets.iter().map(|t| t.map(|i| i.index(nodes.len()) as u32)).collect();
        let nodes = nodes.into_iter().map(DVec3::from_array).collect();
        let mut mesh = TetMesh::new(nodes, tets, Vec::new(), Vec::new()).ok()?;
        for mut field in fields {
            let items = if field.location == Location::Node { mesh.nodes.len() } else { mesh.tets.len() };
            field.values.truncate(items * field.components);
            mesh.set_field(field).unwrap();
        }
        Some(mesh)
    }
}

proptest! {
    #[test]
    fn vtu_round_trips_identically(mesh in mesh()) {
        let Some(mesh) = mesh else { return Ok(()) };
        let bench = Bench::new();
        let path = bench.path("mesh.vtu");
        io::write(&path, &mesh).unwrap();
        let back = io::read(&path).unwrap();
        prop_assert_eq!(bits(&back), bits(&mesh));
        let r = &back.repairs;
        let repaired = r.inverted_fixed + r.degenerate + r.repeated + r.unused_nodes;
        prop_assert_eq!(repaired, 0, "a mesh that was repaired once needs no repair: {:?}", r);
    }
}

#[test]
fn multi_block_arrays_round_trip_identically() {
    let side = 40;
    let node = |x: usize, y: usize, z: usize| (x + side * (y + side * z)) as u32;
    let mut nodes = Vec::new();
    let mut tets = Vec::new();
    for i in 0..side * side * side {
        let (x, y, z) = (i % side, i / side % side, i / side / side);
        nodes.push(DVec3::new(x as f64 / 3.0, y as f64, z as f64));
        if x + 1 < side && y + 1 < side && z + 1 < side {
            tets.push([
                node(x, y, z),
                node(x + 1, y, z),
                node(x, y + 1, z),
                node(x, y, z + 1),
            ]);
        }
    }
    let mesh = TetMesh::new(nodes, tets, Vec::new(), Vec::new()).unwrap();
    assert!(
        mesh.nodes.len() * 24 > 4 << 18,
        "several blocks, and a last one that is not full"
    );
    let path = Bench::new();
    let path = path.path("blocks.vtu");
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    io::write(&path, &mesh).unwrap();
    assert_eq!(bits(&io::read(&path).unwrap()), bits(&mesh));
    std::fs::remove_dir_all(path.parent().unwrap()).unwrap();
}

#[test]
fn values_out_of_type_range_are_preserved() {
    let mut mesh = Sample::new().tets();
    let mut label = mesh.field("label", Location::Cell).unwrap().clone();
    label.scalar_type = ScalarType::U8;
    label.values = vec![0.5, 1e9];
    mesh.set_field(label).unwrap();
    let bench = Bench::new();
    io::write(bench.path("a.vtu"), &mesh).unwrap();
    let back = io::read(bench.path("a.vtu")).unwrap();
    let label = back.field("label", Location::Cell).unwrap();
    assert_eq!(
        (label.values.as_slice(), label.scalar_type),
        (&[0.5, 1e9][..], ScalarType::F64)
    );
}

#[test]
fn series_is_valid_after_every_frame() {
    let bench = Bench::new();
    let folder = bench.path("out/series");
    let mesh = Sample::new().tets();
    let mut series = PvdSeries::create(&folder, "a & b").unwrap();
    assert!(series.path().exists());
    for frame in 0..3u32 {
        let nodes: Vec<DVec3> = mesh
            .nodes
            .iter()
            .map(|p| *p + DVec3::X * f64::from(frame))
            .collect();
        let moved: Vec<f64> = nodes
            .iter()
            .zip(&mesh.nodes)
            .flat_map(|(a, b)| (*a - *b).to_array())
            .collect();
        let displacement = Field {
            name: "displacement".into(),
            location: Location::Node,
            components: 3,
            values: moved,
            scalar_type: ScalarType::F64,
        };
        series
            .push_deformed(
                f64::from(frame) * 0.1,
                &mesh,
                &nodes,
                std::slice::from_ref(&displacement),
            )
            .unwrap();
        let frames = io::read_pvd(series.path()).unwrap();
        assert_eq!(frames.len(), frame as usize + 1);
        let last = frames.last().unwrap();
        assert_eq!(last.time, f64::from(frame) * 0.1);
        let back = io::read(last.file()).unwrap();
        assert_eq!(back.nodes, nodes);
        assert_eq!(back.tets, mesh.tets);
        assert_eq!(
            back.field("displacement", Location::Node),
            Some(&displacement)
        );
        assert_eq!(back.fields.len(), mesh.fields.len() + 1);
    }
    let left: Vec<_> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert_eq!(
        left.len(),
        4,
        "three frames and the series, nothing temporary: {left:?}"
    );
    assert!(
        series
            .push_deformed(f64::NAN, &mesh, &mesh.nodes, &[])
            .is_err()
    );
    assert!(
        series
            .push_deformed(1.0, &mesh, &mesh.nodes[1..], &[])
            .is_err()
    );
    assert!(PvdSeries::create(&folder, "../up").is_err());
}

#[test]
fn failed_write_keeps_previous_file() {
    let bench = Bench::new();
    let path = bench.path("old.txt");
    std::fs::write(&path, "old").unwrap();
    let failed = io::atomic_write(&path, |file| {
        use std::io::Write;
        file.write_all(b"half").unwrap();
        Err(palpate::Error::Input("changed my mind".into()))
    });
    assert!(failed.is_err());
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
    assert_eq!(
        std::fs::read_dir(path.parent().unwrap()).unwrap().count(),
        1
    );
    io::atomic_write(&path, |_| Ok(())).unwrap();
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "");
    assert!(io::atomic_write(bench.path("no/such/folder/x"), |_| Ok(())).is_err());
    assert!(io::atomic_write(bench.path(""), |_| Ok(())).is_err());
}

#[test]
fn rejects_damaged_series() {
    let bench = Bench::new();
    let whole = "<?xml version=\"1.0\"?><VTKFile type=\"Collection\"><Collection><DataSet timestep=\"2\" file=\"b.vtu\"/><DataSet timestep=\"1\" part=\"0\" file=\"sub/a.vtu\"/></Collection></VTKFile>";
    let path = bench.path("s.pvd");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        io::read_pvd(&path)
    };
    let frames = read(whole).unwrap();
    assert_eq!(
        frames[0].files,
        [bench.path("sub/a.vtu")],
        "sorted by time, relative to the series"
    );
    assert_eq!(frames[1].time, 2.0);
    for cut in 0..whole.len() {
        assert!(read(&whole[..cut]).is_err(), "cut at {cut}");
    }
    for (from, to, expected) in [
        (
            "timestep=\"2\"",
            "timestep=\"1\"",
            "several files for part \"0\"",
        ),
        ("timestep=\"2\"", "timestep=\"soon\"", "expected a number"),
        ("file=\"b.vtu\"", "", "no attribute file"),
        ("\"Collection\"", "\"Table\"", "Table"),
    ] {
        let error = read(&whole.replace(from, to)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let error = io::read(&path).unwrap_err().to_string();
    assert!(error.contains("Table"), "{error}");
}

#[test]
fn region_names_and_unit_round_trip() {
    let mut mesh = palpate::generate::paper_bar().unwrap();
    let labels = (0..mesh.tets.len()).map(|t| (t % 2) as f64).collect();
    mesh.set_field(Field::scalar("label", Location::Cell, labels))
        .unwrap();
    mesh.region_names = [(0, "Muskel <ä> & \"x\"".to_owned()), (1, "bone".to_owned())].into();
    mesh.length_unit = Some(1e-3);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("named.vtu");
    palpate::io::write(&path, &mesh).unwrap();
    let back = palpate::io::read(&path).unwrap();
    assert_eq!(back.region_names, mesh.region_names);
    assert_eq!(back.length_unit, mesh.length_unit);
    // The names are those of numeric arrays, which every reader accepts.
    let text = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
    assert!(text.contains("Name=\"region:bone\""));
    assert!(!text.contains("type=\"String\""));
}

#[test]
fn first_version_region_names_are_read() {
    let mut mesh = palpate::generate::paper_bar().unwrap();
    mesh.region_names.clear();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("named.vtu");
    palpate::io::write(&path, &mesh).unwrap();
    let plain = std::fs::read(&path).unwrap();
    let named = |labels: &str| {
        let tags = format!(
            "<UnstructuredGrid>\n<FieldData>\n<DataArray type=\"Int64\" Name=\"region_labels\" NumberOfTuples=\"2\" format=\"ascii\">{labels}</DataArray>\n<Array type=\"String\" Name=\"region_names\" NumberOfTuples=\"2\" format=\"ascii\">195 164 0 98 111 0</Array>\n</FieldData>\n"
        );
        let tag = b"<UnstructuredGrid>\n";
        let at = plain.windows(tag.len()).position(|w| w == tag).unwrap();
        let text = [&plain[..at], tags.as_bytes(), &plain[at + tag.len()..]].concat();
        std::fs::write(&path, text).unwrap();
        palpate::io::read(&path).unwrap().region_names
    };
    assert_eq!(
        named("0 1"),
        [(0, "ä".to_owned()), (1, "bo".to_owned())].into()
    );
    // Fewer names than labels are ambiguous.
    assert!(named("0 1 2").is_empty());
}
