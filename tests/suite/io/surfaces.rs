//! Surfaces in every encoding, damaged ones, and real ones.

use palpate::io;
use palpate::mesh::{Location, SurfaceDescription, TriMesh};
use proptest::prelude::*;

/// A pyramid on a square: four triangles and one quad, all outward.
const PLACES: [[f64; 3]; 5] = [
    [0.0, 0.0, 0.0],
    [2.0, 0.0, 0.0],
    [2.0, 2.0, 0.0],
    [0.0, 2.0, 0.0],
    [1.0, 1.0, 3.5],
];
const FACES: [&[usize]; 5] = [
    &[0, 3, 2, 1],
    &[0, 1, 4],
    &[1, 2, 4],
    &[2, 3, 4],
    &[3, 0, 4],
];
const VOLUME: f64 = 4.0 * 3.5 / 3.0;
/// A value at each vertex, exact in single precision.
const WARM: [f64; 5] = [0.5, -1.25, 3.0, 1e3, 7.0];

/// A file: its name and content, and whether it stores the values.
struct Fixture {
    name: &'static str,
    bytes: Vec<u8>,
    warm: bool,
}

fn fixture(name: &'static str, bytes: impl Into<Vec<u8>>, warm: bool) -> Fixture {
    Fixture {
        name,
        bytes: bytes.into(),
        warm,
    }
}

fn every() -> Vec<Fixture> {
    vec![
        fixture("ascii.ply", ply_ascii(), true),
        fixture("little.ply", ply_binary(false), true),
        fixture("big.ply", ply_binary(true), true),
        fixture("strips.ply", ply_strips(), false),
        fixture("text.stl", stl_text(), false),
        fixture("binary.stl", stl_binary(b"made by hand"), false),
        fixture("solid.stl", stl_binary(b"solid, but binary"), false),
        fixture("plain.obj", obj(), false),
        fixture("ascii.vtk", polydata("ASCII", "3.0"), true),
        fixture("binary.vtk", polydata("BINARY", "3.0"), true),
        fixture("offsets.vtk", polydata("ASCII", "5.1"), true),
        fixture("offsets_binary.vtk", polydata("BINARY", "5.1"), true),
        fixture("strip.vtk", polydata_strip(), false),
    ]
}

fn triangles() -> Vec<[usize; 3]> {
    FACES
        .iter()
        .flat_map(|f| f[1..].windows(2).map(|w| [f[0], w[0], w[1]]))
        .collect()
}

/// Lists between the coordinates, and elements of other kinds around the relevant ones.
fn ply_ascii() -> String {
    let mut text = String::from(
        "ply\r\nformat ascii 1.0\r\ncomment made by hand\r\nobj_info nothing\r\nelement camera 1\r\nproperty list uchar float view\r\nproperty int shutter\r\nelement vertex 5\r\nproperty double z\r\nproperty list int short touching\r\nproperty float warm\r\nproperty float64 x\r\nproperty float32 y\r\nelement face 5\r\nproperty uchar red\r\nproperty list uint8 int32 vertex_index\r\nproperty list uchar float texcoord\r\nend_header\r\n2 0.5 0.25 8\r\n",
    );
    for ([x, y, z], warm) in PLACES.iter().zip(WARM) {
        text += &format!("{z:e} 2 7 -7 {warm} {x} {y}\r\n");
    }
    for face in FACES {
        let corners: Vec<String> = face.iter().map(usize::to_string).collect();
        text += &format!("255 {} {} 2 0.5 1\r\n", face.len(), corners.join(" "));
    }
    text
}

fn ply_binary(big: bool) -> Vec<u8> {
    let name = if big { "big" } else { "little" };
    let mut bytes = format!(
        "ply\nformat binary_{name}_endian 1.0\nelement vertex 5\nproperty list ushort char touching\nproperty double y\nproperty float x\nproperty float warm\nproperty short z2\nproperty double z\nelement edge 1\nproperty int vertex1\nproperty uint vertex2\nelement face 5\nproperty ushort flags\nproperty list int ushort vertex_indices\nend_header\n"
    )
    .into_bytes();
    let mut put = |number: &[u8]| match big {
        true => bytes.extend(number.iter().rev()),
        false => bytes.extend(number),
    };
    for ([x, y, z], warm) in PLACES.iter().zip(WARM) {
        put(&3u16.to_le_bytes());
        // 10 looks like a line end.
        [1i8, -1, 10].iter().for_each(|n| put(&n.to_le_bytes()));
        put(&y.to_le_bytes());
        put(&(*x as f32).to_le_bytes());
        put(&(warm as f32).to_le_bytes());
        put(&(-300i16).to_le_bytes());
        put(&z.to_le_bytes());
    }
    put(&0i32.to_le_bytes());
    put(&u32::MAX.to_le_bytes());
    for face in FACES {
        put(&513u16.to_le_bytes());
        put(&(face.len() as i32).to_le_bytes());
        face.iter().for_each(|v| put(&(*v as u16).to_le_bytes()));
    }
    bytes
}

fn ply_strips() -> String {
    let mut text = String::from(
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n",
    );
    for [x, y, z] in PLACES {
        text += &format!("{x} {y} {z}\n");
    }
    // The sides 0 1 4, 4 1 2; 2 3 4, 4 3 0; the square 0 3 1, 1 3 2.
    text + "14 0 1 4 2 -1 2 3 4 0 -1 0 3 1 2\n"
}

fn stl_text() -> String {
    let mut text = String::from("solid a pyramid\n");
    for triangle in triangles() {
        text += "  facet normal 0 0 0\n    outer loop\n";
        for v in triangle {
            let [x, y, z] = PLACES[v];
            text += &format!("      VERTEX {x:e} {y} {z:+}\n");
        }
        text += "    endloop\n  endfacet\n";
    }
    text + "endsolid a pyramid\n"
}

fn stl_binary(title: &[u8]) -> Vec<u8> {
    let mut bytes = title.to_vec();
    bytes.resize(80, b' ');
    bytes.extend(6u32.to_le_bytes());
    for triangle in triangles() {
        bytes.extend([0; 12]);
        for v in triangle {
            let place = PLACES[v].iter();
            place.for_each(|x| bytes.extend((*x as f32).to_le_bytes()));
        }
        bytes.extend(7u16.to_le_bytes());
    }
    bytes
}

/// Relative corners, normals and texture coordinates, a continued line, groups.
fn obj() -> String {
    let mut text = String::from("# by hand\nmtllib none.mtl\no pyramid\nvt 0 0\nvn 0 0 1\n");
    for [x, y, z] in &PLACES[..4] {
        text += &format!("v {x} {y} {z} 1.0\n");
    }
    text += "g floor\nf 1/1/1 4/1/1 \\\n 3//1 2/1\n";
    let [x, y, z] = PLACES[4];
    text += &format!("v {x} {y} {z}\ns off\nusemtl skin\n");
    text + "f -5 -4 -1\nf 2 3 5 # a side\nf -3 -2 -1\nf 4/1 1/1 5/1\n"
}

fn polydata(encoding: &str, version: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    let ascii = encoding == "ASCII";
    let line = |bytes: &mut Vec<u8>, text: String| bytes.extend((text + "\n").into_bytes());
    let floats = |bytes: &mut Vec<u8>, values: &[f64]| {
        for value in values {
            match ascii {
                true => bytes.extend(format!("{value} ").into_bytes()),
                false => bytes.extend((*value as f32).to_be_bytes()),
            }
        }
        bytes.push(b'\n');
    };
    let integers = |bytes: &mut Vec<u8>, values: &[usize], wide: bool| {
        for value in values {
            match (ascii, wide) {
                (true, _) => bytes.extend(format!("{value}\n").into_bytes()),
                (false, false) => bytes.extend((*value as i32).to_be_bytes()),
                (false, true) => bytes.extend((*value as i64).to_be_bytes()),
            }
        }
        bytes.push(b'\n');
    };
    line(
        &mut bytes,
        format!(
            "# vtk DataFile Version {version}\nby hand\n{encoding}\nDATASET POLYDATA\nPOINTS 5 float"
        ),
    );
    floats(&mut bytes, &PLACES.concat());
    let size: usize = FACES.iter().map(|f| f.len()).sum();
    if version == "3.0" {
        line(&mut bytes, format!("POLYGONS 5 {}", size + 5));
        let cells = FACES.iter().flat_map(|f| [&[f.len()], *f].concat());
        integers(&mut bytes, &cells.collect::<Vec<_>>(), false);
    } else {
        line(
            &mut bytes,
            format!("POLYGONS 6 {size}\nOFFSETS vtktypeint64"),
        );
        let mut offsets = vec![0];
        FACES
            .iter()
            .for_each(|f| offsets.push(offsets[offsets.len() - 1] + f.len()));
        integers(&mut bytes, &offsets, true);
        line(&mut bytes, "CONNECTIVITY vtktypeint64".into());
        integers(&mut bytes, &FACES.concat(), true);
    }
    line(
        &mut bytes,
        "POINT_DATA 5\nSCALARS warm float 1\nLOOKUP_TABLE default".into(),
    );
    floats(&mut bytes, &WARM);
    bytes
}

fn polydata_strip() -> String {
    let mut text = String::from(
        "# vtk DataFile Version 4.2\nby hand\nASCII\nDATASET POLYDATA\nPOINTS 5 double\n",
    );
    for [x, y, z] in PLACES {
        text += &format!("{x} {y} {z}\n");
    }
    text + "VERTICES 1 2\n1 0\nPOLYGONS 1 5\n4 0 3 2 1\nTRIANGLE_STRIPS 2 10\n4 0 1 4 2\n4 2 3 4 0\n"
}

/// A folder to read files from.
struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Bench {
        Bench(tempfile::tempdir().unwrap())
    }

    fn read(&self, name: &str, bytes: &[u8]) -> palpate::Result<TriMesh> {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        io::read_surface(path)
    }
}

/// Whether `surface` is the pyramid, with its values if `warm`.
fn is_pyramid(surface: &TriMesh, warm: bool) -> bool {
    let found = SurfaceDescription::new(surface);
    let field = surface.fields.iter().find(|f| f.name == "warm");
    let values = field.is_some_and(|f| {
        surface.vertices.iter().zip(&f.values).all(|(p, value)| {
            PLACES
                .iter()
                .position(|q| *q == p.to_array())
                .map(|n| WARM[n])
                == Some(*value)
        })
    });
    found.closed
        && found.consistently_oriented
        && (found.vertices, found.triangles, found.euler_number) == (5, 6, 2)
        && surface
            .vertices
            .iter()
            .all(|p| PLACES.contains(&p.to_array()))
        && (found.volume - VOLUME).abs() < 1e-12
        && values == warm
}

#[test]
fn surface_encodings_read_identically() {
    let bench = Bench::new();
    for Fixture { name, bytes, warm } in every() {
        let surface = bench.read(name, &bytes).unwrap();
        assert!(
            is_pyramid(&surface, warm),
            "{name}: {}",
            SurfaceDescription::new(&surface)
        );
        assert!(!is_pyramid(&surface, !warm), "{name}");
    }
}

#[test]
fn surface_formats_round_trip() {
    let bench = Bench::new();
    let surface = bench.read("ascii.ply", ply_ascii().as_bytes()).unwrap();
    for (name, warm) in [("out.ply", true), ("out.obj", false), ("out.stl", false)] {
        let path = bench.0.path().join(name);
        io::write_surface(&path, &surface).unwrap();
        assert!(
            is_pyramid(&io::read_surface(&path).unwrap(), warm),
            "{name}"
        );
        assert_eq!(
            std::fs::read_dir(bench.0.path())
                .unwrap()
                .filter(|f| {
                    f.as_ref()
                        .unwrap()
                        .file_name()
                        .to_string_lossy()
                        .ends_with(".part")
                })
                .count(),
            0
        );
    }
    let error = io::write_surface(bench.0.path().join("out.off"), &surface).unwrap_err();
    assert!(error.to_string().contains(".ply, .obj or .stl"), "{error}");
}

#[test]
fn rejects_surface_truncated_at_any_byte() {
    let bench = Bench::new();
    for Fixture { name, bytes, warm } in every() {
        for cut in 0..bytes.len() {
            let Ok(surface) = bench.read(name, &bytes[..cut]) else {
                continue;
            };
            let whole = is_pyramid(&surface, warm) && bytes[cut..].trim_ascii().is_empty();
            // OBJ and ASCII STL have no counts: a file that ends with a line is complete.
            let noted = match name {
                "plain.obj" => true,
                "text.stl" => {
                    let ended = bytes[cut..].len() <= b" a pyramid\n".len();
                    ended || surface.notes.iter().any(|n| n.contains("endsolid"))
                }
                // An additional section is optional: values and strips are last.
                _ => {
                    let rest = bytes[cut..].trim_ascii_start();
                    let sections = [&b"POINT_DATA"[..], b"SCALARS", b"TRIANGLE_STRIPS"];
                    name.ends_with(".vtk") && sections.iter().any(|s| rest.starts_with(s))
                }
            };
            assert!(
                whole || noted,
                "{name} truncated at byte {cut} of {} is accepted",
                bytes.len()
            );
        }
    }
}

#[test]
fn invalid_counts_and_indices_are_reported() {
    let bench = Bench::new();
    let swapped = |text: &str, from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1).into_bytes()
    };
    let ply = ply_ascii();
    let mut stl = stl_binary(b"lies");
    stl[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    let vtk = String::from_utf8(polydata("ASCII", "3.0")).unwrap();
    let table: [(&str, Vec<u8>, &str); 12] = [
        (
            "a.ply",
            swapped(&ply, "vertex 5", "vertex 99999999999"),
            "\"vertex\" is 99999999999",
        ),
        (
            "b.ply",
            swapped(&ply, "face 5", "face 18446744073709551615"),
            "\"face\"",
        ),
        (
            "c.ply",
            swapped(&ply, "4 0 3 2 1", "4 0 3 2 5"),
            "vertex 5, but there are 5",
        ),
        (
            "d.ply",
            swapped(&ply, "4 0 3 2 1", "4 0 3 2 -1"),
            "refers to vertex",
        ),
        (
            "e.ply",
            swapped(&ply, "4 0 3 2 1", "4000000000 0 3 2 1"),
            "\"vertex_index\" is 4000000000",
        ),
        (
            "f.ply",
            swapped(&ply, "float64 x", "float64 w"),
            "x, y and z",
        ),
        ("g.stl", stl, "4294967295 triangles"),
        ("h.obj", swapped(&obj(), "f -5", "f -6"), "\"-6\""),
        ("i.obj", swapped(&obj(), "f 2 3 5", "f 2 0 5"), "\"0\""),
        (
            "j.vtk",
            swapped(&vtk, "POINTS 5", "POINTS 5000000000000000000"),
            "POINTS",
        ),
        (
            "k.vtk",
            swapped(&vtk, "POLYGONS 5 ", "POLYGONS 5000000 "),
            "POLYGONS",
        ),
        (
            "l.stl",
            swapped(&stl_text(), "VERTEX 1e0", "VERTEX nan"),
            "must have finite coordinates",
        ),
    ];
    for (name, bytes, expected) in table {
        let error = bench.read(name, &bytes).unwrap_err().to_string();
        assert!(
            error.contains(name) && error.contains(expected),
            "{name}: {error}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    /// Random damage is read or rejected; the result has valid indices.
    #[test]
    fn damaged_surfaces_never_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        insert in any::<bool>(),
    ) {
        let bench = Bench::new();
        for Fixture { name, mut bytes, .. } in every() {
            for (at, value) in &damage {
                let at = at.index(bytes.len());
                match insert {
                    true => bytes.insert(at, *value),
                    false => bytes[at] = *value,
                }
            }
            if let Ok(surface) = bench.read(name, &bytes) {
                let count = surface.vertices.len() as u32;
                prop_assert!(surface.triangles.iter().flatten().all(|v| *v < count));
                prop_assert!(surface.vertices.iter().all(|p| p.is_finite()));
                let fits = surface.fields.iter().all(|f| {
                    let items = match f.location {
                        Location::Node => surface.vertices.len(),
                        Location::Cell => surface.triangles.len(),
                    };
                    f.values.len() == items * f.components
                });
                prop_assert!(fits);
                SurfaceDescription::new(&surface);
            }
        }
    }
}

fn real(name: &str) -> Option<TriMesh> {
    let path = crate::support::real_data(&format!("surfaces/{name}"))?;
    Some(io::read_surface(path).unwrap())
}

#[test]
fn real_surfaces_have_expected_counts() {
    let Some(lung) = real("chaste_lung_lul.stl") else {
        return;
    };
    let found = SurfaceDescription::new(&lung);
    assert_eq!((found.vertices, found.triangles), (22_300, 44_596));
    assert!(found.closed && found.consistently_oriented, "{found}");
    assert!((found.volume / 2.134e6 - 1.0).abs() < 5e-4, "{found}");

    let Some(femur) = real("pymskt_femur_thickness_mm_10k_pts.vtk") else {
        return;
    };
    let found = SurfaceDescription::new(&femur);
    assert_eq!((found.vertices, found.triangles), (10_000, 19_996));
    let thickness = femur
        .fields
        .iter()
        .find(|f| f.name == "thickness (mm)")
        .unwrap();
    assert_eq!(
        (thickness.location, thickness.components),
        (Location::Node, 1)
    );
    let (least, most) = thickness.range().unwrap();
    assert!(
        least == 0.0 && (most - 4.4326).abs() < 5e-5,
        "{least} to {most}"
    );

    let Some(feet) = real("fsu_footbones.ply") else {
        return;
    };
    let found = SurfaceDescription::new(&feet);
    assert_eq!((found.vertices, found.triangles), (2_154, 4_204));
    assert_eq!((found.components, found.closed), (26, true));
    assert_eq!(found.euler_number, 52);
}

/// Two triangles folded along an edge, with a texture seam at one of its ends.
const SEAM: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n\
    vt 0 0\nvt 0.5 0\nvt 0.5 1\nvt 1 0.25\nvn 0 0 1\nvn 0 2 0\n";

#[test]
fn obj_preserves_texture_coordinates_and_normals_per_corner() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seam.obj");
    let read = |faces: &str| {
        std::fs::write(&path, format!("{SEAM}{faces}")).unwrap();
        io::read_surface(&path).unwrap()
    };
    let mut surface = read("f 1/1/1 2/2/1 3/3/1\nf 2/4/2 1/-4/-1 4/3/-1\n");
    let [a, b] = surface.corner_uvs().unwrap()[..] else {
        panic!("two triangles")
    };
    assert_eq!(
        a.map(|u| u.to_array()),
        [[0.0, 0.0], [0.5, 0.0], [0.5, 1.0]]
    );
    assert_eq!(
        b.map(|u| u.to_array()),
        [[1.0, 0.25], [0.0, 0.0], [0.5, 1.0]]
    );
    let normals = surface.corner_normals().unwrap();
    assert_eq!(normals[1][2].to_array(), [0.0, 2.0, 0.0]);
    // A flipped triangle keeps the coordinates of its corners.
    surface.triangles[1].swap(1, 2);
    let [v, w] = [surface.triangles[1][1], surface.triangles[1][2]];
    assert_eq!(surface.orient_consistently(), 1);
    assert_eq!(surface.triangles[1][1..], [w, v]);
    let turned = surface.corner_uvs().unwrap()[1];
    assert_eq!(
        turned.map(|u| u.to_array()),
        [[1.0, 0.25], [0.5, 1.0], [0.0, 0.0]]
    );
    // They are preserved by writing and reading.
    let again = folder.path().join("again.obj");
    io::write_surface(&again, &surface).unwrap();
    let again = io::read_surface(&again).unwrap();
    assert_eq!(again.corner_uvs(), surface.corner_uvs());
    assert_eq!(again.triangles, surface.triangles);

    // If a corner has none, all are dropped with a note.
    let part = read("f 1/1 2/2 3/3\nf 2/4 1 4/3\n");
    assert!(part.corner_uvs().is_none());
    assert!(part.notes.iter().any(|n| n.contains("texture coordinates")));
    // PLY stores them as vertex scalars.
    let mut ply = read("f 1 2 3\nf 2 1 4\n");
    for (name, values) in [("s", [0.0, 0.1, 0.2, 0.3]), ("t", [1.0, 0.9, 0.8, 0.7])] {
        let field = palpate::mesh::Field::scalar(name, Location::Node, values.to_vec());
        ply.fields.push(field);
    }
    assert_eq!(ply.corner_uvs().unwrap()[1][2].to_array(), [0.3, 0.7]);
}
