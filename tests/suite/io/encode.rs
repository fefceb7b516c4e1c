//! The sample mesh in every variant of every format, encoded independently of the library.

use crate::io::sample::{Fixture, Sample};
use base64::Engine;
use palpate::mesh::{Field, Location, ScalarType, TetMesh};
use std::fmt::Write as _;
use std::io::Write as _;

/// Returns all fixtures.
pub fn all() -> Vec<Fixture> {
    let mut all = Vec::new();
    for format in ["ascii", "binary", "raw", "base64"] {
        for wide in [false, true] {
            for big in [false, true] {
                for block in [None, Some(40), Some(1 << 15)] {
                    all.push(vtu(format, wide, big, block, "ZLib"));
                }
                for compressor in ["LZ4", "LZMA"] {
                    all.push(vtu(format, wide, big, Some(40), compressor));
                }
            }
        }
    }
    for version in ["2.0", "3.0", "4.2", "5.1"] {
        all.extend([legacy(version, false), legacy(version, true)]);
    }
    for (version, binary, big) in [
        ("2.2", false, false),
        ("2.2", true, false),
        ("2.2", true, true),
        ("4.1", false, false),
        ("4.1", true, false),
        ("4.1", true, true),
    ] {
        all.push(gmsh(version, binary, big));
    }
    all.extend([tetgen(0), tetgen(1), tetgen(17), medit(false), medit(true)]);
    all.extend(crate::io::encode_others::all());
    all
}

fn number(out: &mut Vec<u8>, value: f64, scalar: ScalarType, big: bool) {
    macro_rules! put {
        ($t:ty) => {
            out.extend(if big {
                (value as $t).to_be_bytes()
            } else {
                (value as $t).to_le_bytes()
            })
        };
    }
    match scalar {
        ScalarType::U8 => out.push(value as u8),
        ScalarType::I32 => put!(i32),
        ScalarType::I64 => put!(i64),
        ScalarType::F32 => put!(f32),
        ScalarType::F64 => put!(f64),
        other => panic!("the sample has no {other:?}"),
    }
}

fn binary(values: &[f64], scalar: ScalarType, big: bool) -> Vec<u8> {
    let mut out = Vec::new();
    values
        .iter()
        .for_each(|v| number(&mut out, *v, scalar, big));
    out
}

fn text(values: &[f64], scalar: ScalarType) -> String {
    let shown = |v: &f64| match scalar {
        ScalarType::F32 => format!("{}", *v as f32),
        _ => format!("{v}"),
    };
    values.iter().map(shown).collect::<Vec<_>>().join(" ")
}

fn flat(sample: &Sample) -> Vec<f64> {
    sample.nodes.iter().flat_map(|p| p.to_array()).collect()
}

/// Compresses a block as VTK does.
fn compressed(block: &[u8], compressor: &str) -> Vec<u8> {
    match compressor {
        "LZ4" => lz4_flex::block::compress(block),
        "LZMA" => {
            let mut out = Vec::new();
            lzma_rs::xz_compress(&mut &block[..], &mut out).unwrap();
            out
        }
        _ => {
            let mut z = flate2::write::ZlibEncoder::new(Vec::new(), Default::default());
            z.write_all(block).unwrap();
            z.finish().unwrap()
        }
    }
}

/// VTU; `block`: size of the compressed blocks in bytes.
fn vtu(format: &str, wide: bool, big: bool, block: Option<usize>, compressor: &str) -> Fixture {
    let sample = Sample::new();
    let encode64 = |bytes: &[u8]| {
        base64::engine::general_purpose::STANDARD
            .encode(bytes)
            .into_bytes()
    };
    let header = |numbers: &[usize]| {
        let mut out = Vec::new();
        for n in numbers {
            match (wide, big) {
                (true, true) => out.extend((*n as u64).to_be_bytes()),
                (true, false) => out.extend((*n as u64).to_le_bytes()),
                (false, true) => out.extend((*n as u32).to_be_bytes()),
                (false, false) => out.extend((*n as u32).to_le_bytes()),
            }
        }
        out
    };
    let packed = |data: &[u8], base64: bool| -> Vec<u8> {
        let (head, body) = match block {
            None => (header(&[data.len()]), data.to_vec()),
            Some(size) => {
                let blocks: Vec<Vec<u8>> = data
                    .chunks(size)
                    .map(|b| compressed(b, compressor))
                    .collect();
                let mut numbers = vec![blocks.len(), size, data.len() % size];
                numbers.extend(blocks.iter().map(Vec::len));
                (header(&numbers), blocks.concat())
            }
        };
        match (base64, block) {
            (false, _) => [head, body].concat(),
            // VTK encodes header and data together, unless they are compressed.
            (true, None) => encode64(&[head, body].concat()),
            (true, Some(_)) => [encode64(&head), encode64(&body)].concat(),
        }
    };
    let mut appended = Vec::new();
    let mut array = |name: &str, components: usize, scalar: ScalarType, values: &[f64]| {
        let kind = match scalar {
            ScalarType::U8 => "UInt8",
            ScalarType::I32 => "Int32",
            ScalarType::I64 => "Int64",
            ScalarType::F32 => "Float32",
            _ => "Float64",
        };
        let name = name.replace('&', "&amp;");
        let start =
            format!("<DataArray type=\"{kind}\" Name='{name}' NumberOfComponents=\"{components}\"");
        let data = binary(values, scalar, big);
        match format {
            "ascii" => format!(
                "{start} format=\"ascii\">\n {}\n</DataArray>\n",
                text(values, scalar)
            ),
            "binary" => format!(
                "{start} format=\"binary\">\n {}\n<InformationKey name=\"x\"><Value index=\"0\">1</Value></InformationKey></DataArray>\n",
                String::from_utf8(packed(&data, true)).unwrap()
            ),
            _ => {
                let offset = appended.len();
                appended.extend(packed(&data, format == "base64"));
                format!("{start} format=\"appended\" offset=\"{offset}\" />\n")
            }
        }
    };
    let mut body = String::new();
    for (section, location) in [("PointData", Location::Node), ("CellData", Location::Cell)] {
        let _ = write!(body, "<{section}>");
        for f in sample.fields.iter().filter(|f| f.location == location) {
            body += &array(&f.name, f.components, f.scalar_type, &f.values);
        }
        let _ = writeln!(body, "</{section}>");
    }
    let ends = sample.cells.iter().scan(0, |end, c| {
        *end += c.1.len();
        Some(*end as f64)
    });
    let ends: Vec<f64> = ends.collect();
    let nodes: Vec<f64> = sample
        .cells
        .iter()
        .flat_map(|c| c.1.iter().map(|v| *v as f64))
        .collect();
    let kinds: Vec<f64> = sample.cells.iter().map(|c| f64::from(c.0)).collect();
    body += &format!(
        "<Points>{}</Points>\n",
        array("Points", 3, ScalarType::F64, &flat(&sample))
    );
    body += "<Cells>";
    body += &array("connectivity", 1, ScalarType::I64, &nodes);
    body += &array("offsets", 1, ScalarType::I32, &ends);
    body += &array("types", 1, ScalarType::U8, &kinds);
    body += "</Cells>\n";
    let mut file = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"{}\" header_type=\"{}\"{}>\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n{body}</Piece>\n</UnstructuredGrid>\n",
        if big { "BigEndian" } else { "LittleEndian" },
        if wide { "UInt64" } else { "UInt32" },
        match block {
            Some(_) => format!(" compressor=\"vtk{compressor}DataCompressor\""),
            None => String::new(),
        },
        sample.nodes.len(),
        sample.cells.len(),
    )
    .into_bytes();
    if !appended.is_empty() {
        file.extend(format!("<AppendedData encoding=\"{format}\">\n _").into_bytes());
        file.extend(appended);
        file.extend(b"\n</AppendedData>\n");
    }
    file.extend(b"</VTKFile>\n");
    let name = format!("{format}_wide{wide}_big{big}_block{block:?}_{compressor}.vtu");
    Fixture::new(name, file, sample.tets())
}

/// Legacy VTK.
fn legacy(version: &str, is_binary: bool) -> Fixture {
    let sample = Sample::new();
    let mut may_end = Vec::new();
    let mut file = format!(
        "# vtk DataFile Version {version}\nthe sample\n{}\nDATASET UNSTRUCTURED_GRID\n",
        if is_binary { "BINARY" } else { "ASCII" }
    )
    .into_bytes();
    let values = |file: &mut Vec<u8>, head: &str, values: &[f64], scalar: ScalarType| {
        file.extend(head.as_bytes());
        file.push(b'\n');
        if is_binary {
            file.extend(binary(values, scalar, true));
        } else {
            file.extend(text(values, scalar).into_bytes());
        }
        file.push(b'\n');
    };
    // Fields of the whole file: skipped, including strings.
    file.extend(b"FIELD FieldData 2\n");
    values(&mut file, "TIME 1 1 double", &[1.5], ScalarType::F64);
    file.extend(b"note 1 1 string\n");
    file.extend(if is_binary {
        &b"\xc5a b c\n"[..]
    } else {
        &b"a%20b%20c\n"[..]
    });
    values(
        &mut file,
        "POINTS 5 double",
        &flat(&sample),
        ScalarType::F64,
    );
    file.extend(
        b"METADATA\nCOMPONENT_NAMES\nx\n\nz\nINFORMATION 1\nNAME L2 LOCATION vtk\nDATA 2 0 6\n\n",
    );
    let nodes: Vec<f64> = sample
        .cells
        .iter()
        .flat_map(|c| c.1.iter().map(|v| *v as f64))
        .collect();
    if version.starts_with('5') {
        values(
            &mut file,
            "CELLS 4 11\nOFFSETS vtktypeint64",
            &[0.0, 4.0, 7.0, 11.0],
            ScalarType::I64,
        );
        values(
            &mut file,
            "CONNECTIVITY vtktypeint64",
            &nodes,
            ScalarType::I64,
        );
    } else {
        let counted: Vec<f64> = sample
            .cells
            .iter()
            .flat_map(|c| std::iter::once(c.1.len() as f64).chain(c.1.iter().map(|v| *v as f64)))
            .collect();
        values(&mut file, "CELLS 3 14", &counted, ScalarType::I32);
    }
    let kinds: Vec<f64> = sample.cells.iter().map(|c| f64::from(c.0)).collect();
    values(&mut file, "CELL_TYPES 3", &kinds, ScalarType::I32);
    // Type 10 truncated to 1 is a vertex: undetectable.
    may_end.extend(file.len() - 2..=file.len());
    file.extend(b"POINT_DATA 5\n");
    may_end.extend([file.len() - 1, file.len()]);
    let field = |name: &str| sample.fields.iter().find(|f| f.name == name).unwrap();
    let warm = "SCALARS warm%20&%20cosy float 1\nLOOKUP_TABLE default";
    values(
        &mut file,
        warm,
        &field("warm & cosy").values,
        ScalarType::F32,
    );
    may_end.extend([file.len() - 1, file.len()]);
    values(
        &mut file,
        "VECTORS flow double",
        &field("flow").values,
        ScalarType::F64,
    );
    may_end.extend([file.len() - 1, file.len()]);
    file.extend(b"CELL_DATA 3\n");
    may_end.extend([file.len() - 1, file.len()]);
    file.extend(b"FIELD FieldData 2\n");
    values(
        &mut file,
        "label 1 3 int",
        &field("label").values,
        ScalarType::I32,
    );
    file.extend(b"METADATA\nINFORMATION 0\n\n");
    values(
        &mut file,
        "kind 2 3 unsigned_char",
        &field("kind").values,
        ScalarType::U8,
    );
    let mut fixture = Fixture::new(
        format!("v{version}_binary{is_binary}.vtk"),
        file,
        sample.tets(),
    );
    fixture.may_end = may_end;
    fixture
}

/// Gmsh. Nodes have tags 3, 6, 9 ..., elements 10, 12, ...
fn gmsh(version: &str, is_binary: bool, big: bool) -> Fixture {
    let old = version == "2.2";
    let sample = Sample::new().with_fields(|f| f.name == "flow");
    let mut file = format!("$MeshFormat\n{version} {} 8\n", u8::from(is_binary)).into_bytes();
    let int = |file: &mut Vec<u8>, values: &[i32]| {
        for v in values {
            match (is_binary, big) {
                (false, _) => file.extend(format!("{v} ").into_bytes()),
                (true, true) => file.extend(v.to_be_bytes()),
                (true, false) => file.extend(v.to_le_bytes()),
            }
        }
    };
    // size_t in 4.1, int in 2.2
    let size = |file: &mut Vec<u8>, values: &[usize]| {
        for v in values {
            match (is_binary, big) {
                _ if old => int(file, &[*v as i32]),
                (false, _) => file.extend(format!("{v} ").into_bytes()),
                (true, true) => file.extend((*v as u64).to_be_bytes()),
                (true, false) => file.extend((*v as u64).to_le_bytes()),
            }
        }
    };
    let real = |file: &mut Vec<u8>, values: &[f64]| {
        if is_binary {
            file.extend(binary(values, ScalarType::F64, big));
        } else {
            file.extend(text(values, ScalarType::F64).into_bytes());
            file.push(b'\n');
        }
    };
    if is_binary {
        int(&mut file, &[1]);
        file.push(b'\n');
    }
    file.extend(b"$EndMeshFormat\n$PhysicalNames\n1\n2 7 \"soft $stuff\"\n$EndPhysicalNames\n");
    let vtk_to_gmsh = |kind| if kind == 10 { 4 } else { 2 };
    if old {
        file.extend(b"$Nodes\n5\n");
        for (i, p) in sample.nodes.iter().enumerate() {
            int(&mut file, &[3 * i as i32 + 3]);
            real(&mut file, &p.to_array());
        }
        file.extend(b"\n$EndNodes\n$Elements\n3\n");
        for (i, (kind, nodes)) in sample.cells.iter().enumerate() {
            let (tag, physical) = (10 + 2 * i as i32, if *kind == 10 { 7 } else { 0 });
            if is_binary {
                int(&mut file, &[vtk_to_gmsh(*kind), 1, 2, tag]);
            } else {
                int(&mut file, &[tag, vtk_to_gmsh(*kind), 2]);
            }
            int(&mut file, &[physical, 1 + i as i32]);
            let nodes: Vec<i32> = nodes.iter().map(|v| 3 * *v as i32 + 3).collect();
            int(&mut file, &nodes);
        }
        file.extend(b"\n$EndElements\n");
    } else {
        file.extend(b"$Entities\n");
        size(&mut file, &[1, 0, 1, 2]);
        int(&mut file, &[1]);
        real(&mut file, &[0.0; 3]);
        size(&mut file, &[0]);
        for (tag, physical) in [(2, None), (1, Some(7)), (3, Some(7))] {
            int(&mut file, &[tag]);
            real(&mut file, &[0.0; 6]);
            size(&mut file, &[physical.iter().len()]);
            physical.iter().for_each(|p| int(&mut file, &[*p]));
            size(&mut file, &[1]);
            int(&mut file, &[1]);
        }
        file.extend(b"\n$EndEntities\n$Nodes\n");
        size(&mut file, &[2, 5, 3, 15]);
        for (parametric, nodes) in [(0, 0..2), (1, 2..5)] {
            int(&mut file, &[3, 1, parametric]);
            size(&mut file, &[nodes.len()]);
            nodes.clone().for_each(|i| size(&mut file, &[3 * i + 3]));
            for i in nodes {
                real(&mut file, &sample.nodes[i].to_array());
                if parametric == 1 {
                    real(&mut file, &[0.25; 3]);
                }
            }
        }
        file.extend(b"\n$EndNodes\n$Elements\n");
        size(&mut file, &[3, 3, 10, 14]);
        for (i, (kind, nodes)) in sample.cells.iter().enumerate() {
            int(
                &mut file,
                &[
                    if *kind == 10 { 3 } else { 2 },
                    1 + i as i32,
                    vtk_to_gmsh(*kind),
                ],
            );
            size(&mut file, &[1, 10 + 2 * i]);
            let nodes: Vec<usize> = nodes.iter().map(|v| 3 * v + 3).collect();
            size(&mut file, &nodes);
        }
        file.extend(b"\n$EndElements\n");
    }
    let may_end = vec![file.len() - 1, file.len()];
    let flow = &sample.fields[0];
    file.extend(b"$NodeData\n1\n\"flow\"\n1\n0.5\n3\n0\n3\n5\n");
    for (i, tuple) in flow.values.chunks(3).enumerate() {
        int(&mut file, &[3 * i as i32 + 3]);
        real(&mut file, tuple);
    }
    file.extend(b"\n$EndNodeData\n");
    let mut expected = sample.tets();
    let label = |name: &str, values: Vec<f64>| Field {
        name: name.into(),
        location: Location::Cell,
        components: 1,
        values,
        scalar_type: ScalarType::I32,
    };
    expected
        .set_field(label("gmsh:physical", vec![7.0, 7.0]))
        .unwrap();
    expected
        .set_field(label("gmsh:geometrical", vec![1.0, 3.0]))
        .unwrap();
    let name = format!("v{version}_binary{is_binary}_big{big}.msh");
    let mut fixture = Fixture::new(name, file, expected);
    fixture.may_end = may_end;
    fixture
}

fn labels(expected: &mut TetMesh, name: &str, location: Location, values: &[f64]) {
    let field = Field {
        name: name.into(),
        location,
        components: 1,
        values: values.to_vec(),
        scalar_type: ScalarType::I32,
    };
    expected.set_field(field).unwrap();
}

/// TetGen, numbered from `first`.
fn tetgen(first: usize) -> Fixture {
    let sample = Sample::new().with_fields(|_| false);
    let mut node = "# the sample\n5 3 1 1 # nodes\n\n".to_string();
    for (i, p) in sample.nodes.iter().enumerate() {
        let _ = writeln!(
            node,
            "  {} {} {} {} {}.5 {} # a node",
            i + first,
            p.x,
            p.y,
            p.z,
            i,
            i + 1
        );
    }
    let mut ele = "2  4  1\n".to_string();
    for (i, (_, nodes)) in sample.cells.iter().filter(|c| c.0 == 10).enumerate() {
        let n: Vec<String> = nodes.iter().map(|v| (v + first).to_string()).collect();
        let _ = writeln!(ele, "{}\t{} {}", i + first, n.join(" "), i + 4);
    }
    let mut expected = sample.tets();
    let attributes = (0..5).map(|i| f64::from(i) + 0.5).collect();
    expected
        .set_field(Field::scalar("tetgen:attr1", Location::Node, attributes))
        .unwrap();
    labels(
        &mut expected,
        "tetgen:ref",
        Location::Node,
        &[1.0, 2.0, 3.0, 4.0, 5.0],
    );
    labels(&mut expected, "tetgen:ref", Location::Cell, &[4.0, 5.0]);
    let last_comment = node.rfind('#').unwrap_or(0);
    let may_end = (last_comment - 1..node.len()).collect();
    let mut fixture = Fixture::new(format!("from{first}.node"), node.into_bytes(), expected);
    fixture.may_end = may_end;
    fixture.second = Some(ele.into_bytes());
    fixture
}

/// Medit, in regular form or with the irregularities of other writers.
fn medit(odd: bool) -> Fixture {
    let sample = Sample::new().with_fields(|_| false);
    let mut file = String::from(if odd {
        "# a comment\n meshversionformatted\n2\nDIMENSION\n3\n\nCorners 2 1 2\n"
    } else {
        "MeshVersionFormatted 2\nDimension 3\n"
    });
    file += "Vertices # all\n5\n";
    for (i, p) in sample.nodes.iter().enumerate() {
        let _ = writeln!(file, "{} {} {} {}", p.x, p.y, p.z, i + 1);
    }
    file += if odd {
        "TRIANGLES 1\n2 3 4 9\nTetrahedra\n2\n"
    } else {
        "Triangles\n1\n2 3 4 9\nTetrahedra\n2\n"
    };
    for (i, (_, nodes)) in sample.cells.iter().filter(|c| c.0 == 10).enumerate() {
        let n: Vec<String> = nodes.iter().map(|v| (v + 1).to_string()).collect();
        let _ = writeln!(file, "{} {}", n.join(" "), i + 6);
    }
    // A file that ends here, or has lost the word End, cannot be told from a complete one.
    let mut may_end = vec![file.len() - 1, file.len()];
    file += "Normals\n1\n0.5 1e3 inf\n";
    let tetrahedra_end = may_end[1];
    file += "\nEnd\n";
    may_end.extend(tetrahedra_end..file.len());
    let mut expected = sample.tets();
    labels(
        &mut expected,
        "medit:ref",
        Location::Node,
        &[1.0, 2.0, 3.0, 4.0, 5.0],
    );
    labels(&mut expected, "medit:ref", Location::Cell, &[6.0, 7.0]);
    let mut fixture = Fixture::new(format!("odd{odd}.mesh"), file.into_bytes(), expected);
    fixture.may_end.extend(may_end);
    fixture
}
