//! `render --frames-from`: frames written by another program into a pipe.

use crate::cli::*;
use glam::DVec3;
use palpate::generate;
use palpate::io::FrameStream;
use palpate::mesh::{Field, Location, TetMesh};
use std::io::Write;
use std::process::Stdio;

/// Returns a stream of `frames` of `mesh`, with the mesh in the stream if `along` is true.
fn stream(mesh: &TetMesh, along: bool, frames: &[(f64, Vec<DVec3>)]) -> Vec<u8> {
    let mut bytes = b"PALPATE1".to_vec();
    let tets = if along { mesh.tets.len() } else { 0 };
    bytes.extend((mesh.nodes.len() as u32).to_le_bytes());
    bytes.extend((tets as u32).to_le_bytes());
    let points = |bytes: &mut Vec<u8>, points: &[DVec3]| {
        let numbers = points.iter().flat_map(|p| p.to_array());
        numbers.for_each(|x| bytes.extend(x.to_le_bytes()));
    };
    if along {
        points(&mut bytes, &mesh.nodes);
        for v in mesh.tets.iter().flatten() {
            bytes.extend(v.to_le_bytes());
        }
    }
    for (time, places) in frames {
        bytes.extend(time.to_le_bytes());
        points(&mut bytes, places);
    }
    bytes
}

/// Returns a bar, and three frames that bend it.
fn bar() -> (TetMesh, Vec<(f64, Vec<DVec3>)>) {
    let mesh = generate::bar([6, 2, 2], DVec3::new(3.0, 1.0, 1.0)).unwrap();
    let bent = |k: u32| {
        let by = |p: &DVec3| *p + DVec3::Z * 0.05 * f64::from(k) * p.x * p.x;
        (0.5 * f64::from(k), mesh.nodes.iter().map(by).collect())
    };
    let frames = (0..3).map(bent).collect();
    (mesh, frames)
}

fn piped(arguments: &[&str], bytes: &[u8]) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // A process that rejects the header does not read the rest.
    let _ = child.stdin.take().unwrap().write_all(bytes);
    child.wait_with_output().unwrap()
}

#[test]
fn streamed_frames_match_series_bitwise() {
    let folder = folder("frames");
    let (mesh, frames) = bar();
    let rest = folder.join("bar.vtu");
    palpate::io::write(&rest, &mesh).unwrap();
    let mut series = palpate::io::PvdSeries::create(&folder, "series").unwrap();
    for (time, places) in &frames {
        series.push_deformed(*time, &mesh, places, &[]).unwrap();
    }
    let view = [
        "--size",
        "64x48",
        "--eye",
        "1.5,-6,2",
        "--look-at",
        "1.5,0.5,0.5",
    ];
    let out = folder.join("again");
    let pvd = folder.join("series.pvd");
    let again = [&["simulate", text(&pvd), "--out", text(&out)], &view[..]].concat();
    stdout(&palpate(&again));
    // From a file next to a mesh, and from standard input with the mesh in the stream.
    let file = folder.join("frames.bin");
    std::fs::write(&file, stream(&mesh, false, &frames)).unwrap();
    let [one, two, film] = ["one.png", "two.png", "film.gif"].map(|n| folder.join(n));
    let beside = [
        "render",
        text(&rest),
        "--frames-from",
        text(&file),
        "--out",
        text(&one),
        "--film",
        text(&film),
    ];
    stdout(&palpate(&[&beside, &view[..]].concat()));
    let within = ["render", "-", "--frames-from", "-", "--out", text(&two)];
    let output = piped(
        &[&within, &view[..], &["--json", "--quiet"]].concat(),
        &stream(&mesh, true, &frames),
    );
    let report: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(report, serde_json::json!({ "frames": 3 }));
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    let read = |name: String| std::fs::read(folder.join(name)).unwrap();
    for k in 0..3 {
        let expected = read(format!("again/series_{k:04}.png"));
        assert!(expected == read(format!("one_{k:04}.png")), "{k}");
        assert!(expected == read(format!("two_{k:04}.png")), "{k}");
        assert!(k == 0 || expected != read("one_0000.png".into()), "{k}");
    }
    assert!(film.exists());
}

#[cfg(unix)]
#[test]
fn frame_is_rendered_before_the_next_arrives() {
    let folder = folder("frames_fifo");
    let (mesh, frames) = bar();
    let pipe = folder.join("pipe");
    let made = Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    let out = folder.join("frame.png");
    let mut child = Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args([
            "render",
            "-",
            "--frames-from",
            text(&pipe),
            "--size",
            "32x24",
            "--out",
            text(&out),
        ])
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    // Opened for reading and writing: opening a pipe for writing alone would block if the child
    // died.
    let mut writer = std::fs::File::options()
        .read(true)
        .write(true)
        .open(&pipe)
        .unwrap();
    writer
        .write_all(&stream(&mesh, true, &frames[..1]))
        .unwrap();
    writer.flush().unwrap();
    let first = folder.join("frame_0000.png");
    let waited = std::time::Instant::now();
    while !first.exists() {
        assert!(
            waited.elapsed().as_secs() < 600 && child.try_wait().unwrap().is_none(),
            "first frame missing"
        );
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert!(!folder.join("frame_0001.png").exists());
    let all = stream(&mesh, true, &frames);
    let head = stream(&mesh, true, &frames[..1]).len();
    writer.write_all(&all[head..]).unwrap();
    drop(writer);
    assert!(child.wait().unwrap().success());
    assert!(folder.join("frame_0002.png").exists());
}

#[test]
fn truncated_stream_fails_or_ends_between_frames() {
    let (mesh, frames) = bar();
    let whole = stream(&mesh, true, &frames);
    let frame = 8 + 24 * mesh.nodes.len();
    let ends: Vec<usize> = (0..=3).map(|k| whole.len() - k * frame).collect();
    for cut in (0..whole.len()).step_by(7).chain(ends.iter().copied()) {
        let read = FrameStream::new(&whole[..cut], "cut").and_then(|(mut frames, mesh)| {
            assert!(mesh.is_some());
            let mut count = 0;
            while frames.next_frame()?.is_some() {
                count += 1;
            }
            Ok(count)
        });
        match ends.iter().position(|end| *end == cut) {
            Some(k) => assert_eq!(read.unwrap(), 3 - k),
            None => {
                let said = read.unwrap_err().to_string();
                assert!(
                    said.contains("cut") && said.contains("ends within"),
                    "{said}"
                );
            }
        }
    }
}

#[test]
fn invalid_stream_is_rejected_with_advice() {
    let (mesh, frames) = bar();
    let refused = |bytes: &[u8]| {
        let read = FrameStream::new(bytes, "wrong").and_then(|(mut frames, _)| {
            while frames.next_frame()?.is_some() {}
            Ok(())
        });
        read.unwrap_err().to_string()
    };
    let whole = stream(&mesh, true, &frames);
    assert!(refused(b"P6 640 480 255 and so on").contains("expected PALPATE1 at the start"));
    // Counts beyond the actual data do not size an allocation.
    let mut many = whole.clone();
    many[8..16].fill(0xff);
    assert!(refused(&many).contains("ends within its node positions at rest"));
    let mut none = whole.clone();
    none[8..12].fill(0);
    assert!(refused(&none).contains("number of nodes must be ≥ 1, got 0"));
    let first = 16 + 24 * mesh.nodes.len();
    let mut wrong = whole.clone();
    wrong[first..first + 4].fill(0xff);
    assert!(refused(&wrong).contains("invalid mesh"));
    let mut nowhere = whole.clone();
    let last = whole.len() - 8;
    nowhere[last..].copy_from_slice(&f64::NAN.to_le_bytes());
    let said = refused(&nowhere);
    assert!(
        said.contains("frame 2") && said.contains("must have finite coordinates"),
        "{said}"
    );
    let mut endless = whole.clone();
    let time = whole.len() - 8 - 24 * mesh.nodes.len();
    endless[time..time + 8].copy_from_slice(&f64::INFINITY.to_le_bytes());
    assert!(refused(&endless).contains("time must be finite, got inf"));
    // Invalid combinations of arguments.
    let dash = [
        "render",
        "-",
        "--frames-from",
        "-",
        "--out",
        "x.png",
        "--size",
        "8x8",
    ];
    let said = failure(&piped(&dash, &stream(&mesh, false, &frames)));
    assert!(said.contains("contains no mesh"), "{said}");
    let limb = format!("{DATA}/limb.vtu");
    let named = [
        "render",
        &limb,
        "--frames-from",
        "-",
        "--out",
        "x.png",
        "--size",
        "8x8",
    ];
    assert!(failure(&piped(&named, &whole)).contains("is given as well"));
    let said = failure(&piped(&named, &stream(&mesh, false, &frames)));
    assert!(said.contains("but the mesh has"), "{said}");
    let orbit = [&dash[..], &["--film", "x.gif", "--orbit", "90"]].concat();
    assert!(failure(&piped(&orbit, &whole)).contains("number of frames"));
    assert!(failure(&piped(&dash, &stream(&mesh, true, &[]))).contains("before the first frame"));
}

/// Writes a bar of `mesh` with its nodes in reversed order, and the field `f`.
fn write_frame(path: &Path, mesh: &TetMesh, reversed: bool, f: impl Fn(DVec3) -> f64) {
    let last = mesh.nodes.len() as u32 - 1;
    let mut mesh = mesh.clone();
    if reversed {
        mesh.nodes.reverse();
        mesh.tets.iter_mut().flatten().for_each(|v| *v = last - *v);
    }
    let values = mesh.nodes.iter().map(|p| f(*p)).collect();
    let fields = vec![Field::scalar("f", Location::Node, values)];
    let mesh = TetMesh::new(mesh.nodes, mesh.tets, fields, Vec::new()).unwrap();
    palpate::io::write(path, &mesh).unwrap();
}

#[test]
fn each_frame_of_a_series_has_its_own_numbering_and_field() {
    let folder = folder("own_frames");
    let (mesh, _) = bar();
    let (low, high) = mesh.bounds();
    let rises = |p: DVec3| (p.x - low.x) / (high.x - low.x);
    let falls = |p: DVec3| 1.0 - rises(p);
    write_frame(&folder.join("a.vtu"), &mesh, false, rises);
    write_frame(&folder.join("b.vtu"), &mesh, true, rises);
    write_frame(&folder.join("c.vtu"), &mesh, true, falls);
    let listed = |k: usize, file: &str| format!("<DataSet timestep=\"{k}\" file=\"{file}.vtu\"/>");
    let files = ["a", "b", "c"];
    let sets: String = files
        .iter()
        .enumerate()
        .map(|(k, f)| listed(k, f))
        .collect();
    let series = folder.join("s.pvd");
    std::fs::write(
        &series,
        format!("<VTKFile type=\"Collection\"><Collection>{sets}</Collection></VTKFile>"),
    )
    .unwrap();
    let view = [
        "--size",
        "64x48",
        "--eye",
        "1.5,-6,2",
        "--look-at",
        "1.5,0.5,0.5",
        "--field",
        "f",
        "--transfer",
        "viridis",
    ];
    let played = ["simulate", text(&series), "--out", text(&folder)];
    let output = palpate(&[&played, &view[..]].concat());
    stdout(&output);
    let notes = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(notes.contains("1 of 3 frames have other tets"), "{notes}");
    let mut pictures = Vec::new();
    for (k, file) in files.iter().enumerate() {
        let mesh = folder.join(format!("{file}.vtu"));
        let picture = folder.join(format!("{file}.png"));
        let drawn = ["render", text(&mesh), "--out", text(&picture)];
        stdout(&palpate(&[&drawn, &view[..]].concat()));
        let alone = std::fs::read(&picture).unwrap();
        let frame = std::fs::read(folder.join(format!("s_{k:04}.png"))).unwrap();
        assert!(alone == frame, "frame {k} differs from its own picture");
        pictures.push(alone);
    }
    assert!(pictures[1] != pictures[2], "the fields differ");
}
