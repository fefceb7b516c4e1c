//! Files compressed with gzip, in UTF-16, and with other line ends read as plain ones.

use crate::io::errors::{GMSH_2, LEGACY};
use crate::io::sample::{Bench, bits};
use crate::io::volume_files::gzip;
use crate::support::real_data;
use palpate::io;

fn utf16(text: &str, big_endian: bool, mark: bool) -> Vec<u8> {
    let units = mark
        .then_some(0xfeff)
        .into_iter()
        .chain(text.encode_utf16());
    let bytes = units.map(|unit| match big_endian {
        true => unit.to_be_bytes(),
        false => unit.to_le_bytes(),
    });
    bytes.flatten().collect()
}

#[test]
fn encoded_text_reads_as_plain_text() {
    let bench = Bench::new();
    for (name, text) in [("a.vtk", LEGACY), ("a.msh", GMSH_2)] {
        let plain = bits(&bench.read(name, text.as_bytes()).unwrap());
        let cr = text.replace('\n', "\r");
        let crlf = text.replace('\n', "\r\n");
        for (what, bytes) in [
            ("CR", cr.clone().into_bytes()),
            ("CR LF", crlf.into_bytes()),
            (
                "UTF-8 with a mark",
                ["\u{feff}", text].concat().into_bytes(),
            ),
            ("UTF-16", utf16(text, false, true)),
            ("UTF-16, big-endian", utf16(text, true, true)),
            ("UTF-16 without a mark", utf16(text, false, false)),
            (
                "UTF-16, big-endian, without a mark",
                utf16(text, true, false),
            ),
            ("UTF-16 with CR", utf16(&cr, false, true)),
        ] {
            let read = bench.read(name, &bytes);
            assert_eq!(bits(&read.unwrap()), plain, "{name}, {what}");
            let packed = format!("{name}.gz");
            let read = bench.read(&packed, &gzip(&bytes));
            assert_eq!(bits(&read.unwrap()), plain, "{packed}, {what}");
            let parsed = io::parse(&packed, &gzip(&bytes));
            assert_eq!(bits(&parsed.unwrap()), plain, "{packed} parsed, {what}");
        }
    }
}

#[test]
fn every_fixture_reads_from_gzip() {
    let bench = Bench::new();
    for fixture in crate::io::encode::all() {
        if fixture.second.is_some() {
            continue;
        }
        let read = bench.read(&format!("{}.gz", fixture.name), &gzip(&fixture.bytes));
        let read = read.unwrap_or_else(|e| panic!("{}: {e}", fixture.name));
        assert_eq!(bits(&read), bits(&fixture.expected), "{}", fixture.name);
    }
}

#[test]
fn binary_files_are_not_decoded_as_text() {
    // A binary STL whose header starts as a mark of UTF-16, without any line end.
    let mut stl = vec![0xff, 0xfe];
    stl.resize(80, b'\r');
    stl.extend(1u32.to_le_bytes());
    for x in [
        0.0f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0,
    ] {
        stl.extend(x.to_le_bytes());
    }
    stl.extend([0, 0]);
    let surface = io::parse_surface("a.stl", &stl).unwrap();
    assert_eq!(surface.triangles.len(), 1);
    assert_eq!(surface.vertices[1].to_array(), [1.0, 0.0, 0.0]);
}

#[test]
fn damaged_gzip_is_reported() {
    let mut packed = gzip(LEGACY.as_bytes());
    packed.truncate(packed.len() - 9);
    let error = Bench::new().read("a.vtk.gz", &packed).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("a.vtk.gz: cannot decompress the file with gzip"),
        "{error}"
    );
}

#[test]
fn case_with_cr_line_ends_reads() {
    let Some(path) = real_data("cases/24_c_cr_only.vtk") else {
        return;
    };
    let mesh = io::read(path).unwrap();
    assert_eq!((mesh.nodes.len(), mesh.tets.len()), (27, 48));
    assert!((mesh.volume() - 8.0).abs() < 1e-12);
}
