//! Ten-node tets in files: the order of their nodes, curved edges, and what follows them.

use crate::io::sample::{Bench, bits};
use crate::io::writers::ways;
use glam::DVec3;
use palpate::io::{self, MeshFormat};
use palpate::mesh::{
    ElementOrder, Field, Location, MeshDescription, ScalarType, TET_EDGES, TetMesh,
};

/// A bent bar of ten-node tets whose corners and mid-edge nodes are in a mixed order, with two named
/// regions and fields.
fn curved_bar() -> TetMesh {
    let bar = palpate::generate::bar([3, 1, 1], DVec3::new(3.0, 1.0, 1.0)).unwrap();
    let mut mesh = bar.with_mid_edge_nodes().unwrap();
    for p in &mut mesh.nodes {
        // A different bulge on every edge.
        let bulge = DVec3::new(
            (3.0 * p.y).sin(),
            (2.0 * p.x + p.z).cos(),
            (2.0 * p.x).sin(),
        );
        *p = *p / 3.0 + 0.04 * bulge;
    }
    let count = mesh.nodes.len();
    // 7 and the number of nodes have no common factor, so this is a permutation.
    assert!(!count.is_multiple_of(7));
    let place = |v: usize| 7 * v % count;
    let before = mesh.nodes.clone();
    for (v, p) in before.into_iter().enumerate() {
        mesh.nodes[place(v)] = p;
    }
    for v in mesh.tets.iter_mut().flatten() {
        *v = place(*v as usize) as u32;
    }
    let elements = mesh.ten_node_tets().unwrap();
    // The curved shape decides on the pieces.
    let made = TetMesh::from_ten_node_tets(mesh.nodes, &elements, Vec::new(), Vec::new());
    let mut mesh = made.unwrap();
    let elements = elements.len();
    let of_elements = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..8 * elements).map(|t| value(t / 8)).collect()
    };
    let set = |mesh: &mut TetMesh, name: &str, location, components, values| {
        let field = Field {
            name: name.into(),
            location,
            components,
            values,
            scalar_type: ScalarType::F64,
        };
        mesh.set_field(field).unwrap();
    };
    let thirds = |n: usize| (0..n).map(|i| i as f64 / 3.0 - 1.0).collect();
    set(&mut mesh, "warm", Location::Node, 1, thirds(count));
    set(&mut mesh, "flow", Location::Node, 3, thirds(3 * count));
    let soft = of_elements(&|k| 1.0 / (k as f64 + 3.0));
    set(&mut mesh, "soft", Location::Cell, 1, soft);
    let labels = of_elements(&|k| if 2 * k < elements { 3.0 } else { 8.0 });
    mesh.set_field(Field {
        scalar_type: ScalarType::I32,
        ..Field::scalar("label", Location::Cell, labels)
    })
    .unwrap();
    mesh.region_names = [(3, "left".to_owned()), (8, "right".to_owned())].into();
    mesh.length_unit = Some(0.01);
    assert_eq!(mesh.order, ElementOrder::Quadratic);
    mesh
}

/// Largest distance between the nodes of two meshes.
fn distance(a: &TetMesh, b: &TetMesh) -> f64 {
    assert_eq!(a.nodes.len(), b.nodes.len());
    let pairs = a.nodes.iter().zip(&b.nodes);
    pairs.map(|(p, q)| p.distance(*q)).fold(0.0, f64::max)
}

#[test]
fn every_format_keeps_curved_edges_fields_and_regions() {
    let (bench, mesh) = (Bench::new(), curved_bar());
    let elements = mesh.ten_node_tets().unwrap();
    let told = MeshDescription::new(&mesh);
    let regions: f64 = told.regions.iter().map(|r| r.volume).sum();
    assert!(told.regions.len() == 2 && (regions / told.volume - 1.0).abs() < 1e-12);
    assert!((told.volume / mesh.volume() - 1.0).abs() < 0.05);
    assert_eq!(told.tets, elements.len());
    for (format, text, name) in ways() {
        let path = bench.path(name);
        let left_out = io::write_as(&path, &mesh, format, text).unwrap();
        let read = io::read(&path).unwrap();
        if format == MeshFormat::Tetgen {
            assert!(left_out[0].contains("eight"), "{left_out:?}");
            assert_eq!(read.order, ElementOrder::Linear);
            assert_eq!(read.tets.len(), mesh.tets.len());
            continue;
        }
        assert_eq!(read.order, ElementOrder::Quadratic, "{name}");
        assert_eq!(read.ten_node_tets().unwrap(), elements, "{name}");
        assert_eq!(read.tets, mesh.tets, "{name}");
        // CalculiX limits the digits of Abaqus files.
        let tolerance = if format == MeshFormat::Abaqus {
            1e-14
        } else {
            0.0
        };
        assert!(distance(&mesh, &read) <= tolerance, "{name}");
        assert_eq!(read.length_unit, mesh.length_unit, "{name}");
        assert_eq!(read.region_names, mesh.region_names, "{name}");
        let values =
            |mesh: &TetMesh, name: &str, at| mesh.field(name, at).map(|f| f.values.clone());
        let label = values(&mesh, "label", Location::Cell);
        assert_eq!(values(&read, "label", Location::Cell), label, "{name}");
        if ![MeshFormat::Medit, MeshFormat::Abaqus].contains(&format) {
            for (field, at) in [
                ("warm", Location::Node),
                ("flow", Location::Node),
                ("soft", Location::Cell),
            ] {
                assert_eq!(
                    values(&read, field, at),
                    values(&mesh, field, at),
                    "{name}: {field}"
                );
            }
        }
        if format == MeshFormat::Vtu {
            assert!(bits(&read) == bits(&mesh));
        }
        assert!(
            read.repairs.warnings.is_empty(),
            "{name}: {:?}",
            read.repairs
        );
        // And once more.
        io::write_as(&path, &read, format, text).unwrap();
        assert!(bits(&io::read(&path).unwrap()) == bits(&read), "{name}");
    }
}

/// Nodes of one tet: corners, and for each edge, in the order of [`TET_EDGES`], a node near its middle.
fn one_tet() -> Vec<DVec3> {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let middles = TET_EDGES.iter().zip(1..).map(|([a, b], k)| {
        let bulge = DVec3::new(0.01, -0.02, 0.015) * f64::from(k);
        corners[*a].midpoint(corners[*b]) + bulge
    });
    corners.into_iter().chain(middles).collect()
}

/// The places of the nodes of [`one_tet`] in the order of VTK, Abaqus and Medit, and in that of Gmsh.
const VTK: [usize; 10] = [0, 1, 2, 3, 4, 7, 5, 6, 8, 9];
const GMSH: [usize; 10] = [0, 1, 2, 3, 4, 7, 5, 6, 9, 8];

/// One tet in each format as other programs write it, with its nodes in the order `vtk` or `gmsh`.
fn files(vtk: [usize; 10], gmsh: [usize; 10]) -> Vec<(&'static str, String)> {
    let nodes = one_tet();
    let place = |p: &DVec3| format!("{} {} {}", p.x, p.y, p.z);
    let lines = nodes.iter().map(|p| place(p) + "\n").collect::<String>();
    let numbered = |comma: &str| -> String {
        let line = |(i, p): (usize, &DVec3)| {
            format!(
                "{}{comma} {}\n",
                i + 1,
                place(p).replace(' ', &format!("{comma} "))
            )
        };
        nodes.iter().enumerate().map(line).collect()
    };
    let list = |order: [usize; 10], first: usize, separator: &str| {
        order.map(|k| (k + first).to_string()).join(separator)
    };
    let (from_0, from_1) = (list(vtk, 0, " "), list(vtk, 1, " "));
    let of_gmsh = list(gmsh, 1, " ");
    let tags: String = (1..=10).map(|v| format!("{v}\n")).collect();
    let vtk = |kind: u8| {
        format!(
            "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 10 double\n{lines}CELLS 1 11\n10 {from_0}\nCELL_TYPES 1\n{kind}\n"
        )
    };
    let vtu = |kind: u8| {
        let array = |kind: &str, name: &str, text: &str| {
            format!(
                "<DataArray type=\"{kind}\" Name=\"{name}\" format=\"ascii\" NumberOfComponents=\"{}\">{text}</DataArray>",
                if name == "p" { 3 } else { 1 }
            )
        };
        format!(
            "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\"><UnstructuredGrid><Piece NumberOfPoints=\"10\" NumberOfCells=\"1\"><Points>{}</Points><Cells>{}{}{}</Cells></Piece></UnstructuredGrid></VTKFile>",
            array("Float64", "p", &lines),
            array("Int64", "connectivity", &from_0),
            array("Int64", "offsets", "10"),
            array("UInt8", "types", &kind.to_string())
        )
    };
    let inp = |kind: &str| {
        // Two lines, as most programs write them.
        let own: Vec<&str> = from_1.split(' ').collect();
        format!(
            "*NODE\n{}*ELEMENT, TYPE={kind}\n1, {},\n{}\n",
            numbered(","),
            own[..7].join(", "),
            own[7..].join(", ")
        )
    };
    vec![
        ("a.vtk", vtk(24)),
        ("lagrange.vtk", vtk(71)),
        ("a.vtu", vtu(24)),
        ("lagrange.vtu", vtu(71)),
        (
            "a22.msh",
            format!(
                "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n10\n{}$EndNodes\n$Elements\n1\n1 11 2 0 1 {of_gmsh}\n$EndElements\n",
                numbered("")
            ),
        ),
        (
            "a41.msh",
            format!(
                "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 1\n1 0 0 0 1 1 1 0 0\n$EndEntities\n$Nodes\n1 10 1 10\n3 1 0 10\n{tags}{lines}$EndNodes\n$Elements\n1 1 1 1\n3 1 11 1\n1 {of_gmsh}\n$EndElements\n"
            ),
        ),
        ("c3d10.inp", inp("C3D10")),
        ("c3d10m.inp", inp("C3D10M")),
        ("c3d10h.inp", inp("C3D10H")),
        (
            "a.mesh",
            format!(
                "MeshVersionFormatted 2\nDimension 3\nVertices\n10\n{}TetrahedraP2\n1\n{from_1} 5\nEnd\n",
                nodes.iter().map(|p| place(p) + " 0\n").collect::<String>()
            ),
        ),
    ]
}

/// Whether the file has the middle of each edge of [`one_tet`] where it is.
fn has_edges_in_place(mesh: &TetMesh) -> bool {
    let expected: [u32; 10] = std::array::from_fn(|k| k as u32);
    mesh.order == ElementOrder::Quadratic && mesh.ten_node_tets().unwrap() == [expected]
}

#[test]
fn edge_order_of_every_format_is_its_own() {
    let bench = Bench::new();
    for (name, text) in files(VTK, GMSH) {
        let mesh = bench.read(name, text.as_bytes()).unwrap();
        assert!(has_edges_in_place(&mesh), "{name}");
        let moved = mesh.nodes.iter().zip(one_tet());
        assert!(moved.into_iter().all(|(p, q)| *p == q), "{name}");
        assert!(
            mesh.repairs.warnings.is_empty(),
            "{name}: {:?}",
            mesh.repairs
        );
    }
    // Medit files may state their order; Gmsh's here.
    let (name, text) = files(GMSH, VTK).pop().unwrap();
    let rows = "2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 2\n1 1 0 0\n0 1 1 0\n1 0 1 0\n1 0 0 1\n0 0 1 1\n0 1 0 1\n";
    let stated = |rows: &str| {
        let section = format!("TetrahedraP2Ordering\n10\n{rows}TetrahedraP2\n");
        bench.read(name, text.replace("TetrahedraP2\n", &section).as_bytes())
    };
    assert!(has_edges_in_place(&stated(rows).unwrap()));
    let twice = stated(&rows.replace("0 1 0 1", "0 0 1 1")).unwrap_err();
    assert!(
        twice.to_string().contains("TetrahedraP2Ordering"),
        "{twice}"
    );
    // Negative control: with the order of the other programs the nodes are on other edges.
    for (name, text) in files(GMSH, VTK) {
        let mesh = bench.read(name, text.as_bytes()).unwrap();
        assert!(!has_edges_in_place(&mesh), "{name}");
        let told = MeshDescription::new(&mesh);
        let warnings = told.warnings.join("\n");
        assert_eq!(told.folded_ten_node_tets, 1, "{name}: {warnings}");
        assert!(warnings.contains("check the order"), "{name}: {warnings}");
        assert!(told.to_string().contains("1 with a Jacobian"), "{told}");
    }
}

#[test]
fn truncated_files_of_ten_node_tets_never_panic() {
    let bench = Bench::new();
    let mut all: Vec<(String, Vec<u8>)> = files(VTK, GMSH)
        .into_iter()
        .map(|(name, text)| (name.to_owned(), text.into_bytes()))
        .collect();
    let mesh = bench.read("a.vtk", &all[0].1).unwrap();
    for (format, text, name) in ways() {
        io::write_as(bench.path(name), &mesh, format, text).unwrap();
        all.push((
            format!("own_{name}"),
            std::fs::read(bench.path(name)).unwrap(),
        ));
    }
    for (name, bytes) in all {
        for cut in 0..bytes.len() {
            let Ok(read) = bench.read(&name, &bytes[..cut]) else {
                continue;
            };
            assert!(
                read.tets
                    .iter()
                    .flatten()
                    .all(|v| (*v as usize) < read.nodes.len())
            );
            assert!(read.nodes.iter().all(|p| p.is_finite()));
        }
    }
}

/// Legacy VTK with these points and cells (type and nodes).
fn vtk(points: &[[f64; 3]], cells: &[(u8, &[usize])]) -> String {
    let places: String = points
        .iter()
        .map(|[x, y, z]| format!("{x} {y} {z}\n"))
        .collect();
    let lists: String = cells
        .iter()
        .map(|(_, nodes)| {
            let words: Vec<String> = nodes.iter().map(usize::to_string).collect();
            format!("{} {}\n", nodes.len(), words.join(" "))
        })
        .collect();
    let size: usize = cells.iter().map(|(_, nodes)| nodes.len() + 1).sum();
    let kinds: String = cells.iter().map(|(kind, _)| format!("{kind}\n")).collect();
    format!(
        "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {} double\n{places}CELLS {} {size}\n{lists}CELL_TYPES {}\n{kinds}",
        points.len(),
        cells.len(),
        cells.len()
    )
}

#[test]
fn tets_beside_ten_node_tets_share_their_edges() {
    let bench = Bench::new();
    let mut points: Vec<[f64; 3]> = one_tet().iter().map(DVec3::to_array).collect();
    // An unused node, the far corner of a four-node tet, and the corners of a pyramid.
    points.extend([[9.0; 3], [1.0, 1.0, 1.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0]]);
    let text = vtk(
        &points,
        &[(10, &[1, 2, 3, 11]), (24, &VTK), (5, &[0, 1, 2])],
    );
    let mesh = bench.read("mixed.vtk", text.as_bytes()).unwrap();
    let elements = mesh.ten_node_tets().unwrap();
    // The unused node is dropped; nodes of straight edges are last.
    assert_eq!(mesh.nodes.len(), 11 + 3);
    assert_eq!(mesh.nodes[10], DVec3::ONE);
    let [linear, curved] = elements[..] else {
        panic!("{elements:?}")
    };
    assert_eq!(curved, std::array::from_fn(|k| k as u32));
    for (edge, [a, b]) in TET_EDGES.into_iter().enumerate() {
        let ends = [linear[a], linear[b]];
        let shared = TET_EDGES.iter().position(|[c, d]| {
            let others = [curved[*c], curved[*d]];
            others == ends || others == [ends[1], ends[0]]
        });
        let middle = linear[4 + edge];
        match shared {
            Some(other) => assert_eq!(middle, curved[4 + other]),
            None => {
                let [p, q] = ends.map(|v| mesh.nodes[v as usize]);
                assert!(middle >= 11);
                assert_eq!(mesh.nodes[middle as usize], p.midpoint(q));
            }
        }
    }
    let told = mesh.repairs.warnings.join("\n");
    assert!(told.contains("1 tets of other cells"), "{told}");
    assert_eq!(MeshDescription::new(&mesh).tets, 2);
}

#[test]
fn second_order_hexahedra_keep_their_corners() {
    let bench = Bench::new();
    let mut points: Vec<[f64; 3]> = (0..8)
        .map(|i| {
            [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[x, y]| [x, y, i / 4])[i % 4].map(|x| x as f64)
        })
        .collect();
    points.extend([[0.5, 0.5, 0.5]; 12]);
    let all: Vec<usize> = (0..20).collect();
    let mesh = bench
        .read("hexahedron.vtk", vtk(&points, &[(25, &all)]).as_bytes())
        .unwrap();
    assert_eq!((mesh.order, mesh.nodes.len()), (ElementOrder::Linear, 8));
    let told = mesh.repairs.warnings.join("\n");
    assert!(told.contains("1 second-order hexahedron reduced"), "{told}");
}

#[test]
fn wrong_mid_edge_nodes_are_named() {
    let bench = Bench::new();
    let points: Vec<[f64; 3]> = one_tet().iter().map(DVec3::to_array).collect();
    let read = |points: &[[f64; 3]], nodes: &[usize; 10], others: &[(u8, &[usize])]| {
        let cells: Vec<(u8, &[usize])> = std::iter::once((24, &nodes[..]))
            .chain(others.iter().copied())
            .collect();
        bench
            .read("wrong.vtk", vtk(points, &cells).as_bytes())
            .unwrap()
    };
    // One node on two edges, and a corner as a middle.
    let (mut twice, mut corner) = (VTK, VTK);
    twice[5] = twice[4];
    corner[9] = 0;
    for (nodes, straight, first) in [
        (twice, 2, "node 4 on the edge from node 0 to 1"),
        (corner, 1, "node 0 on the edge from node 2 to 3"),
    ] {
        let mesh = read(&points, &nodes, &[]);
        let told = mesh.repairs.warnings.join("\n");
        assert!(
            told.contains(&format!("{straight} mid-edge nodes")) && told.contains(first),
            "{told}"
        );
        let [element] = mesh.ten_node_tets().unwrap()[..] else {
            panic!("{told}")
        };
        let is_straight = |(edge, [a, b]): &(usize, [usize; 2])| {
            let at = |k: usize| mesh.nodes[element[k] as usize];
            at(4 + edge) == at(*a).midpoint(at(*b))
        };
        assert_eq!(
            TET_EDGES
                .into_iter()
                .enumerate()
                .filter(is_straight)
                .count(),
            straight
        );
    }
    // Two nodes on one edge of neighbours.
    let mut more = points.clone();
    more.extend([
        [1.0, 1.0, 1.0],
        [0.6, 0.6, 0.0],
        [0.0, 0.5, 0.5],
        [0.5, 0.0, 0.5],
        [1.0, 0.5, 0.5],
        [0.5, 1.0, 0.5],
        [0.5, 0.5, 1.0],
    ]);
    let second = [1, 2, 3, 10, 11, 9, 8, 14, 15, 16];
    let mesh = read(&more, &VTK, &[(24, &second)]);
    let told = mesh.repairs.warnings.join("\n");
    assert!(
        told.contains("1 edges of ten-node tets have several")
            && told.contains("edge from node 1 to 2"),
        "{told}"
    );
    // A node far from its edge.
    let mut far = points.clone();
    far[4] = [0.5, -0.8, 0.0];
    let told = read(&far, &VTK, &[]).repairs.warnings.join("\n");
    assert!(
        told.contains("1 mid-edge nodes of ten-node tets are further") && told.contains("node 4"),
        "{told}"
    );
}

/// An inverted tet is flipped with its edges; values of Gmsh at the corners only are interpolated.
#[test]
fn repairs_and_fields_of_corners_follow_the_edges() {
    let bench = Bench::new();
    let points: Vec<[f64; 3]> = one_tet().iter().map(DVec3::to_array).collect();
    let mirrored = [0, 2, 1, 3, 5, 7, 4, 6, 9, 8];
    let mesh = bench
        .read("flipped.vtk", vtk(&points, &[(24, &mirrored)]).as_bytes())
        .unwrap();
    assert_eq!(mesh.repairs.inverted_fixed, 1);
    let [element] = mesh.ten_node_tets().unwrap()[..] else {
        panic!()
    };
    for (edge, [a, b]) in TET_EDGES.into_iter().enumerate() {
        let ends = [element[a].min(element[b]), element[a].max(element[b])].map(|v| v as usize);
        let own = TET_EDGES.iter().position(|known| *known == ends).unwrap();
        assert_eq!(element[4 + edge] as usize, 4 + own);
    }
    let (_, text) = files(VTK, GMSH).swap_remove(4);
    let data =
        "$NodeData\n1\n\"heat\"\n1\n0.0\n3\n0\n1\n4\n1 1.0\n2 3.0\n3 5.0\n4 9.0\n$EndNodeData\n";
    let mesh = bench
        .read("corners.msh", format!("{text}{data}").as_bytes())
        .unwrap();
    let heat = &mesh.field("heat", Location::Node).unwrap().values;
    assert_eq!(heat[..], [1.0, 3.0, 5.0, 9.0, 2.0, 3.0, 5.0, 4.0, 6.0, 7.0]);
}
