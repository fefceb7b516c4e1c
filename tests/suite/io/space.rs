//! Frames of reference that files state, `SPACE=LPS` or `SPACE=RAS`.

use glam::DVec3;
use palpate::io;
use palpate::mesh::{AnatomicalFrame, TetMesh, TriMesh};

const CORNERS: [DVec3; 4] = [
    DVec3::new(3.0, 5.0, 7.0),
    DVec3::new(4.0, 5.0, 7.0),
    DVec3::new(3.0, 6.0, 7.0),
    DVec3::new(3.0, 5.0, 8.0),
];
const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

/// Surfaces in every format with `said` where 3D Slicer puts it.
fn surfaces(said: &str) -> Vec<(&'static str, Vec<u8>)> {
    let places: Vec<String> = CORNERS
        .iter()
        .map(|p| format!("{} {} {}\n", p.x, p.y, p.z))
        .collect();
    let faces: String = FACES
        .iter()
        .map(|[a, b, c]| format!("3 {a} {b} {c}\n"))
        .collect();
    let obj_faces: String = FACES
        .iter()
        .map(|f| format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1))
        .collect();
    let facets: String = FACES
        .iter()
        .map(|f| {
            let vertices: String = f.iter().map(|n| format!("vertex {}", places[*n])).collect();
            format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n")
        })
        .collect();
    let mut binary = format!("{said:<80}").into_bytes();
    binary.extend(4u32.to_le_bytes());
    for face in FACES {
        binary.extend([0; 12]);
        let numbers = face.into_iter().flat_map(|n| CORNERS[n].to_array());
        binary.extend(numbers.flat_map(|x| (x as f32).to_le_bytes()));
        binary.extend([0; 2]);
    }
    let all = places.concat();
    vec![
        ("binary.stl", binary),
        (
            "text.stl",
            format!("solid {said}\n{facets}endsolid\n").into_bytes(),
        ),
        (
            "a.ply",
            format!("ply\nformat ascii 1.0\ncomment {said}\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n{all}{faces}").into_bytes(),
        ),
        (
            "a.obj",
            format!(
                "# {said}\n{}{obj_faces}",
                places.iter().map(|p| format!("v {p}")).collect::<String>()
            )
            .into_bytes(),
        ),
        (
            "a.vtk",
            format!("# vtk DataFile Version 3.0\n{said}\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n{all}POLYGONS 4 16\n{faces}").into_bytes(),
        ),
    ]
}

fn has(surface: &TriMesh, sign: f64) -> bool {
    CORNERS.iter().all(|p| {
        let wanted = DVec3::new(sign * p.x, sign * p.y, p.z);
        surface.vertices.contains(&wanted)
    })
}

#[test]
fn stated_frame_of_surfaces_is_obeyed() {
    let cases = [
        (
            "3D Slicer output. SPACE=LPS",
            -1.0,
            Some(AnatomicalFrame::Ras),
        ),
        (
            "3D Slicer output. SPACE=RAS",
            1.0,
            Some(AnatomicalFrame::Ras),
        ),
        ("made by hand", 1.0, None),
    ];
    for (said, sign, frame) in cases {
        for (name, bytes) in surfaces(said) {
            let surface = io::parse_surface(name, &bytes).unwrap();
            assert!(has(&surface, sign), "{name} {said}: {:?}", surface.vertices);
            assert_eq!(surface.frame, frame, "{name} {said}");
            assert!((surface.volume() - 1.0 / 6.0).abs() < 1e-6, "{name} {said}");
            let noted = surface.notes.iter().any(|n| n.contains("LPS"));
            assert_eq!(noted, sign < 0.0, "{name} {said}");
        }
    }
}

#[test]
fn silent_surface_is_lps_where_it_meets_a_scan() {
    let (name, bytes) = surfaces("made by hand").remove(0);
    let mut surface = io::parse_surface(name, &bytes).unwrap();
    surface.meet_ras();
    assert!(has(&surface, -1.0));
    assert!(surface.notes.iter().any(|n| n.contains("--frame ras")));
    // A second time changes nothing.
    let notes = surface.notes.len();
    surface.meet_ras();
    assert!(has(&surface, -1.0) && surface.notes.len() == notes);
}

#[test]
fn written_files_state_their_frame_and_read_back_unchanged() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("space");
    std::fs::create_dir_all(&folder).unwrap();
    for frame in [Some(AnatomicalFrame::Ras), None] {
        let surface = TriMesh {
            vertices: CORNERS.to_vec(),
            triangles: FACES.iter().map(|f| f.map(|n| n as u32)).collect(),
            frame,
            ..TriMesh::default()
        };
        for extension in ["ply", "obj", "stl"] {
            let path = folder.join(format!("a.{extension}"));
            io::write_surface(&path, &surface).unwrap();
            let back = io::read_surface(&path).unwrap();
            assert!(has(&back, 1.0) && back.frame == frame, "{extension}");
        }
        let mut mesh =
            TetMesh::new(CORNERS.to_vec(), vec![[0, 1, 2, 3]], Vec::new(), Vec::new()).unwrap();
        mesh.frame = frame;
        for extension in ["vtu", "vtk", "msh", "mesh", "node", "inp"] {
            let path = folder.join(format!("a.{extension}"));
            io::write(&path, &mesh).unwrap();
            let back = io::read(&path).unwrap();
            assert_eq!(back.nodes, mesh.nodes, "{extension}");
            assert_eq!(back.frame, frame, "{extension}");
        }
    }
}

#[test]
fn meshes_in_lps_are_converted_with_their_vectors() {
    let text = "# vtk DataFile Version 3.0\n3D Slicer output. SPACE=LPS\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n3 5 7 4 5 7 3 6 7 3 5 8\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\nPOINT_DATA 4\nVECTORS push double\n1 2 3 1 2 3 1 2 3 1 2 3\n";
    let mesh = io::parse("a.vtk", text.as_bytes()).unwrap();
    assert_eq!(mesh.nodes[0], DVec3::new(-3.0, -5.0, 7.0));
    assert_eq!(mesh.fields[0].values[..3], [-1.0, -2.0, 3.0]);
    assert_eq!(mesh.frame, Some(AnatomicalFrame::Ras));
    assert!(mesh.volume() > 0.0);
    assert!(mesh.repairs.warnings.iter().any(|n| n.contains("LPS")));
}
