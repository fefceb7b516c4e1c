//! Every variant of every format gives the same mesh.

use crate::sample::{Bench, bits};

#[test]
fn every_variant_reads_as_the_sample() {
    let bench = Bench::new();
    for fixture in crate::encode::all() {
        let mesh = bench
            .read_as(&fixture, &fixture.bytes, fixture.second.as_deref())
            .unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(bits(&mesh), bits(&fixture.expected), "{}", fixture.name);
    }
}

#[test]
fn windows_line_ends_and_a_byte_order_mark_change_nothing() {
    let bench = Bench::new();
    for fixture in crate::encode::all() {
        let Ok(text) = std::str::from_utf8(&fixture.bytes) else {
            continue;
        };
        // Not the binary ones, where it would change numbers.
        if text.contains('\0') || fixture.name.contains("raw") {
            continue;
        }
        let windows = format!("\u{feff}{}", text.replace('\n', "\r\n"));
        let windows = windows
            .strip_prefix('\u{feff}')
            .filter(|_| fixture.second.is_some())
            .unwrap_or(&windows);
        let second = fixture.second.as_deref();
        let mesh = bench
            .read_as(&fixture, windows.as_bytes(), second)
            .unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(bits(&mesh), bits(&fixture.expected), "{}", fixture.name);
    }
}

#[test]
fn the_content_counts_more_than_the_extension() {
    let bench = Bench::new();
    for fixture in crate::encode::all().iter().filter(|f| f.second.is_none()) {
        for name in ["mesh.dat", "mesh", "mesh.VTU", "mesh.mesh"] {
            let mesh = bench
                .read(name, &fixture.bytes)
                .unwrap_or_else(|e| panic!("{}: {e}", fixture.name));
            assert_eq!(bits(&mesh), bits(&fixture.expected), "{}", fixture.name);
        }
    }
}

#[test]
fn either_file_of_tetgen_may_be_named() {
    let bench = Bench::new();
    let fixture = crate::encode::all()
        .into_iter()
        .find(|f| f.second.is_some())
        .unwrap();
    bench
        .read_as(&fixture, &fixture.bytes, fixture.second.as_deref())
        .unwrap();
    let mesh = palpate::io::read(bench.path(&fixture.name).with_extension("ele")).unwrap();
    assert_eq!(bits(&mesh), bits(&fixture.expected));
}
