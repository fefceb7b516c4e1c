//! Surfaces as other programs write them: the same shape in spite of what is unusual.

use crate::support::real_data;
use palpate::io;
use palpate::mesh::{SurfaceDescription, TriMesh};
use palpate::mesher::ClosedSurface;

/// The corners of a cube of side 1, and its sides, outward.
const CORNERS: [[u8; 3]; 8] = [
    [0, 0, 0],
    [1, 0, 0],
    [1, 1, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 0, 1],
    [1, 1, 1],
    [0, 1, 1],
];
const SIDES: [[usize; 4]; 6] = [
    [0, 3, 2, 1],
    [4, 5, 6, 7],
    [0, 1, 5, 4],
    [1, 2, 6, 5],
    [2, 3, 7, 6],
    [3, 0, 4, 7],
];

fn triangles() -> Vec<[usize; 3]> {
    let halves = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, c, d]];
    SIDES.into_iter().flat_map(halves).collect()
}

fn parsed(name: &str, bytes: impl AsRef<[u8]>) -> TriMesh {
    io::parse_surface(name, bytes.as_ref()).unwrap()
}

/// Checks that a surface is the cube.
fn is_cube(surface: &TriMesh) {
    let seen = SurfaceDescription::new(surface);
    let notes = &surface.notes;
    assert_eq!(seen.triangles, 12, "{notes:?}");
    assert!(seen.closed && seen.consistently_oriented, "{notes:?}");
    assert!((seen.volume - 1.0).abs() < 1e-12, "{notes:?}");
}

fn noted(surface: &TriMesh, words: &str) {
    let notes = &surface.notes;
    assert!(notes.iter().any(|n| n.contains(words)), "{notes:?}");
}

fn facet_text(corners: [[u8; 3]; 3]) -> String {
    let vertex = |[x, y, z]: [u8; 3]| format!("   vertex {x} {y} {z}\n");
    let vertices: String = corners.map(vertex).concat();
    format!(" facet normal 0 0 0\n  outer loop\n{vertices}  endloop\n endfacet\n")
}

fn cube_text() -> String {
    let facets = triangles().into_iter();
    facets.map(|t| facet_text(t.map(|n| CORNERS[n]))).collect()
}

fn stl(triangles: &[[[f32; 3]; 3]], count: u32) -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend(count.to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        bytes.extend(triangle.iter().flatten().flat_map(|x| x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn cube() -> Vec<[[f32; 3]; 3]> {
    let place = |n: usize| CORNERS[n].map(f32::from);
    triangles().into_iter().map(|t| t.map(place)).collect()
}

#[test]
fn stl_text_of_other_programs_reads() {
    let facets = cube_text();
    is_cube(&parsed("c.stl", format!("solid c\n{facets}end solid c\n")));
    let words = facets
        .replace("endloop", "end loop")
        .replace("endfacet", "END FACET");
    is_cube(&parsed("c.stl", format!("solid c\n{words}end solid\n")));
    let before = parsed(
        "c.stl",
        format!("# exported\nunits mm\nsolid c\n{facets}endsolid c\n"),
    );
    is_cube(&before);
    noted(&before, "2 lines before \"solid\"");
    is_cube(&parsed("c.stl", format!("{facets}endsolid\n")));
}

#[test]
fn stl_without_count_has_all_triangles() {
    let surface = parsed("c.stl", stl(&cube(), 0));
    is_cube(&surface);
    noted(&surface, "all 12 in the file");
    // A wrong count is still an error: triangles may be missing.
    assert!(io::parse_surface("c.stl", &stl(&cube(), 13)).is_err());
}

#[test]
fn repeated_and_opposite_triangles_are_dropped() {
    let once = cube();
    let twice: Vec<_> = once.iter().flat_map(|t| [*t, *t]).collect();
    let surface = parsed("c.stl", stl(&twice, 24));
    is_cube(&surface);
    noted(&surface, "12 triangles that repeat");
    let turned = |[a, b, c]: [[f32; 3]; 3]| [b, a, c];
    let sides: Vec<_> = once.iter().flat_map(|t| [*t, turned(*t)]).collect();
    let inner_first: Vec<_> = once.iter().flat_map(|t| [turned(*t), *t]).collect();
    let mixed: Vec<_> = (0..)
        .zip(&once)
        .flat_map(|(n, t)| match n % 3 {
            0 => [*t, turned(*t)],
            _ => [turned(*t), *t],
        })
        .collect();
    for two_sided in [sides, inner_first, mixed] {
        let surface = parsed("c.stl", stl(&two_sided, 24));
        is_cube(&surface);
        noted(&surface, "two-sided");
    }
}

#[test]
fn wall_between_two_closed_bodies_is_kept() {
    let mut both = cube();
    let moved = |t: [[f32; 3]; 3]| t.map(|[x, y, z]| [x + 1.0, y, z]);
    both.extend(cube().into_iter().map(moved));
    let surface = parsed("two.stl", stl(&both, 24));
    assert_eq!(surface.triangles.len(), 24, "{:?}", surface.notes);
    assert!((surface.volume() - 2.0).abs() < 1e-9);
}

#[test]
fn exact_t_junction_is_closed_and_others_are_named() {
    // The side y = 0 is divided at the middle of one of its edges, which its neighbour is not.
    let with_middle = |depth: f32| {
        let middle = [0.5, depth, 0.0];
        let [a, b] = [[0.0; 3], [1.0, 0.0, 0.0]];
        let mut all = cube();
        let edge = all
            .iter()
            .position(|t| t.contains(&a) && t.contains(&b) && t.iter().all(|p| p[1] == 0.0));
        let old = all.remove(edge.unwrap());
        let replaced = |from| old.map(|p| if p == from { middle } else { p });
        all.extend([replaced(a), replaced(b)]);
        parsed("t.stl", stl(&all, 13))
    };
    let exact = with_middle(0.0);
    let seen = SurfaceDescription::new(&exact);
    assert!(seen.closed && seen.triangles == 14, "{:?}", exact.notes);
    assert!((seen.volume - 1.0).abs() < 1e-12);
    noted(&exact, "1 T-junctions closed");
    let beside = with_middle(2e-4);
    let seen = SurfaceDescription::new(&beside);
    assert_eq!(seen.open_edges, 3);
    noted(&beside, "1 T-junctions left open");
}

/// An L of area 3 and height 1: concave ends, from each first corner.
#[test]
fn concave_polygons_have_their_area_in_every_format() {
    let flat = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]];
    for first in 0..6usize {
        let end: Vec<usize> = (0..6).map(|n| (n + first) % 6).collect();
        let mut faces = vec![end.iter().rev().copied().collect::<Vec<_>>()];
        faces.push(end.iter().map(|n| n + 6).collect());
        faces.extend((0..6).map(|n| vec![n, (n + 1) % 6, (n + 1) % 6 + 6, n + 6]));
        let places: Vec<String> = [0, 1]
            .iter()
            .flat_map(|z| flat.map(|[x, y]| format!("{x} {y} {z}\n")))
            .collect();
        let listed = |from: usize| {
            faces.iter().map(move |face| {
                let words: Vec<String> = face.iter().map(|n| (n + from).to_string()).collect();
                (face.len(), words.join(" "))
            })
        };
        let obj: String = places.iter().map(|p| format!("v {p}")).collect();
        let obj = obj
            + &listed(1)
                .map(|f| format!("f {}\n", f.1))
                .collect::<String>();
        let counted: String = listed(0).map(|f| format!("{} {}\n", f.0, f.1)).collect();
        let ply = format!(
            "ply\nformat ascii 1.0\nelement vertex 12\nproperty float x\nproperty float y\nproperty float z\nelement face 8\nproperty list uchar int vertex_indices\nend_header\n{}{counted}",
            places.concat()
        );
        let size: usize = faces.iter().map(|f| f.len() + 1).sum();
        let vtk = format!(
            "# vtk DataFile Version 3.0\nL\nASCII\nDATASET POLYDATA\nPOINTS 12 float\n{}POLYGONS 8 {size}\n{counted}",
            places.concat()
        );
        for (name, content) in [("l.obj", obj), ("l.ply", ply), ("l.vtk", vtk)] {
            let seen = SurfaceDescription::new(&parsed(name, content));
            assert!(
                (seen.area - 14.0).abs() < 1e-12,
                "{name} {first}: {}",
                seen.area
            );
            assert!((seen.volume - 3.0).abs() < 1e-12, "{name} {first}");
            assert!(seen.closed, "{name} {first}");
        }
    }
}

#[test]
fn ply_lines_with_more_values_than_declared_read_by_lines() {
    let place = |[x, y, z]: [u8; 3]| format!("{x} {y} {z} 0.25\n");
    let face = |t: [usize; 3]| format!("3 {} {} {} 9 1 1 1\n", t[0], t[1], t[2]);
    let header = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement face 12\nproperty list uchar int vertex_indices\nend_header\n";
    let places: String = CORNERS.map(place).concat();
    let faces: String = triangles().into_iter().map(face).collect();
    let surface = parsed("c.ply", format!("{header}{places}\n{faces}"));
    is_cube(&surface);
    noted(&surface, "20 lines have more values");
    // Several elements on a line still read by values.
    let face = |t: [usize; 3]| format!("3 {} {} {} ", t[0], t[1], t[2]);
    let one_line: String = triangles().into_iter().map(face).collect();
    let places = CORNERS.map(|[x, y, z]| format!("{x} {y} {z} ")).concat();
    is_cube(&parsed("c.ply", format!("{header}{places}\n{one_line}\n")));
}

#[test]
fn obj_faces_of_any_order_and_size_read() {
    let places: String = CORNERS.map(|[x, y, z]| format!("v {x} {y} {z}\n")).concat();
    let face = |side: [usize; 4]| {
        let [a, b, c, d] = side.map(|n| n + 1);
        format!("f {a} {b} {c} {d}\n")
    };
    let faces: String = SIDES.map(face).concat();
    is_cube(&parsed("c.obj", format!("{faces}{places}")));
    let surface = parsed("c.obj", format!("{places}{faces}f 1 2\nf 3\n"));
    is_cube(&surface);
    noted(&surface, "2 faces of fewer than three vertices");
    let error = io::parse_surface("c.obj", format!("{faces}{places}f 1 2 9\n").as_bytes());
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("line 15") && error.contains("\"9\""),
        "{error}"
    );
}

/// Files as users have them: (name, area, volume, triangles).
#[test]
fn unusual_real_files_have_expected_shapes() {
    let expected = [
        ("11_each_twice.stl", 6.0, 1.0, 12),
        ("11_two_sided.stl", 6.0, 1.0, 12),
        ("14_concave_L.obj", 14.0, 3.0, 20),
        ("15_extra_tokens.ply", 6.0, 1.0, 12),
        ("23_b_count0.stl", 6.0, 1.0, 12),
        ("23_d_tjunction.stl", 6.0, 1.0, 14),
        ("23_o_faces_first.obj", 6.0, 1.0, 12),
        ("23_o_two_vertex_face.obj", 6.0, 1.0, 12),
        ("23_s_end_solid.stl", 6.0, 1.0, 12),
        ("23_s_garbage_head.stl", 6.0, 1.0, 12),
    ];
    for (name, area, volume, triangles) in expected {
        let Some(path) = real_data(&format!("cases/{name}")) else {
            return;
        };
        let surface = io::read_surface(path).unwrap();
        let seen = SurfaceDescription::new(&surface);
        assert!(
            (seen.area - area).abs() < 1e-6,
            "{name}: area {}",
            seen.area
        );
        assert!(
            (seen.volume.abs() - volume).abs() < 1e-6,
            "{name}: volume {}",
            seen.volume
        );
        assert_eq!(seen.triangles, triangles, "{name}");
        assert!(seen.closed, "{name}");
        assert!((ClosedSurface::new(&surface).unwrap().volume() - volume).abs() < 1e-6);
    }
}
