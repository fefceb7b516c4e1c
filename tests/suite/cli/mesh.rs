//! `palpate mesh`, and scenes that mesh their input.

use crate::cli::{DATA, failure, folder, palpate, real, stdout, text};
use std::path::Path;

/// Returns the path of a shipped file.
fn shipped(file: &str) -> String {
    format!("{DATA}/{file}")
}

#[test]
fn segmentation_is_meshed_with_named_regions() {
    let folder = folder("mesh_labels");
    let (mesh, report) = (folder.join("knee.vtu"), folder.join("knee.json"));
    let made = |mesh: &Path| {
        palpate(&[
            "mesh",
            &shipped("knee.nrrd"),
            "--labels",
            "all",
            "--tets",
            "20000",
            "--out",
            text(mesh),
            "--report",
            text(&report),
        ])
    };
    stdout(&made(&mesh));
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    assert_eq!(json["regions"].as_array().unwrap().len(), 10);
    assert!(json["mesher"]["min_dihedral"].as_f64().unwrap() > 4.0);
    let read = palpate::io::read(&mesh).unwrap();
    assert!((17_000..=23_000).contains(&read.tets.len()));
    assert_eq!(read.length_unit, Some(1e-3));
    assert_eq!(read.region_names[&5], "femur bone");
    let told = stdout(&palpate(&["info", text(&mesh)]));
    for name in read.region_names.values() {
        assert!(told.contains(name), "{name}: {told}");
    }
    // The output is deterministic.
    let again = folder.join("again.vtu");
    stdout(&made(&again));
    assert_eq!(
        std::fs::read(&mesh).unwrap(),
        std::fs::read(&again).unwrap()
    );
}

#[test]
fn mesh_splits_region_interfaces() {
    let folder = folder("mesh_part");
    let made = |name: &str, part: &[&str]| {
        let mesh = folder.join(name);
        let knee = shipped("knee.nrrd");
        let all = ["mesh", &knee, "--labels", "all", "--tets", "6000", "--out"];
        let output = palpate(&[&all[..], &[text(&mesh)], part].concat());
        (output, mesh)
    };
    let (output, whole) = made("whole.vtu", &[]);
    stdout(&output);
    let read = |mesh: &Path| palpate::io::read(mesh).unwrap();
    let whole = read(&whole);
    let names: Vec<&str> = whole.region_names.values().map(String::as_str).collect();
    let [bone, cartilage] = ["femur bone", "femoral cartilage"];
    assert!(
        names.contains(&bone) && names.contains(&cartilage),
        "{names:?}"
    );
    let (output, parted) = made("parted.vtu", &["--part", "femur bone:femoral cartilage"]);
    stdout(&output);
    let parted = read(&parted);
    assert_eq!(parted.tets.len(), whole.tets.len());
    let nodes = |name: &str| -> std::collections::BTreeSet<u32> {
        let label = parted.region_label(name).unwrap() as f64;
        let labels = parted
            .field("label", palpate::mesh::Location::Cell)
            .unwrap();
        let tets = parted.tets.iter().zip(&labels.values);
        tets.filter(|(_, l)| **l == label)
            .flat_map(|(t, _)| *t)
            .collect()
    };
    // If other regions connect the two, they stay connected.
    let left = nodes(bone).intersection(&nodes(cartilage)).count();
    let more = parted.nodes.len() - whole.nodes.len();
    assert!(more > 20 && left < 2 * more, "{more} {left}");
    // Missing regions and invalid pairs are reported.
    let (output, _) = made("none.vtu", &["--part", "femur bone:rib"]);
    assert!(failure(&output).contains("\"rib\"; available"));
    let (output, _) = made("one.vtu", &["--part", "femur bone"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn nested_thresholds_keep_intensities() {
    let folder = folder("mesh_thresholds");
    let mesh = folder.join("head.vtu");
    let output = palpate(&[
        "mesh",
        &shipped("head_ct.mha"),
        "--above",
        "bone=1300",
        "--above",
        "soft=500",
        "--intensity",
        &format!("mri={}", shipped("head_mri.nii.gz")),
        "--edge",
        "1.2cm",
        "--out",
        text(&mesh),
    ]);
    stdout(&output);
    let read = palpate::io::read(&mesh).unwrap();
    let names: Vec<&str> = read.region_names.values().map(String::as_str).collect();
    assert_eq!(names, ["soft", "bone"]);
    for name in ["intensity", "mri"] {
        let field = read.field(name, palpate::mesh::Location::Node).unwrap();
        let (low, high) = field.range().unwrap();
        assert!(low < 200.0 && high > 250.0, "{name}: {low} {high}");
    }
}

#[test]
fn surfaces_are_extracted_and_meshed() {
    let folder = folder("mesh_surfaces");
    let (skull, bone) = (folder.join("skull.ply"), folder.join("bone.vtu"));
    stdout(&palpate(&[
        "mesh",
        &shipped("head_ct.mha"),
        "--above",
        "1300",
        "--smooth",
        "5",
        "--out",
        text(&skull),
    ]));
    let json: serde_json::Value =
        serde_json::from_str(&stdout(&palpate(&["info", text(&skull), "--json"]))).unwrap();
    assert_eq!(json["closed"], true);
    let volume = json["volume"].as_f64().unwrap();
    stdout(&palpate(&[
        "mesh",
        text(&skull),
        "--unit",
        "mm",
        "--tets",
        "15000",
        "--out",
        text(&bone),
    ]));
    let mesh = palpate::io::read(&bone).unwrap();
    assert!((mesh.volume() / volume - 1.0).abs() < 0.1);
    // The boundary of the tets is a surface again.
    let back = folder.join("back.stl");
    stdout(&palpate(&["mesh", text(&bone), "--out", text(&back)]));
    let surface = palpate::io::read_surface(&back).unwrap();
    assert!((surface.volume() / mesh.volume() - 1.0).abs() < 1e-4);
}

#[test]
fn mesh_rejects_invalid_input_with_advice() {
    let folder = folder("mesh_errors");
    let out = folder.join("x.vtu");
    let refused = |arguments: &[&str], part: &str| {
        let mut all = vec!["mesh"];
        all.extend(arguments);
        let at = ["--out", text(&out)];
        all.extend(at);
        let words = failure(&palpate(&all));
        assert!(words.contains(part), "{arguments:?}: {words}");
        assert!(!out.exists());
    };
    let (knee, head, lobe) = (
        shipped("knee.nrrd"),
        shipped("head_ct.mha"),
        shipped("lobe.stl"),
    );
    refused(&[&head], "--above");
    refused(&[&knee, "--labels", "77"], "no voxel has label 77");
    refused(&[&head, "--above", "9999"], "no voxel has a value");
    refused(&[&lobe, "--above", "3"], "thresholds apply to volumes only");
    refused(&[&lobe, "--edge", "2mm"], "--unit");
    refused(&[&knee, "--with", "tetgen"], "TetGen meshes surfaces");
    refused(&[&knee, "--with", "gmsh"], "lattice or tetgen");
    refused(&[&shipped("bar.vtu")], "already a tetrahedral mesh");
    refused(&[&knee, &lobe], "must be the only input");
    refused(&["nowhere.nrrd"], "nowhere.nrrd");
    refused(&[&knee, "--edge", "900"], "decrease the edge length");
}

/// Returns the range of a field of a mesh.
fn field_range(path: &Path, name: &str) -> (f64, f64) {
    let mesh = palpate::io::read(path).unwrap();
    let field = mesh.fields.iter().find(|f| f.name == name).unwrap();
    field.range().unwrap()
}

#[test]
fn surface_meets_a_scan_in_its_frame() {
    let (Some(lps), Some(ras), Some(scan)) = (
        real("cases/07_box_lps.stl"),
        real("cases/07_box_ras.stl"),
        real("cases/07_scan.nii.gz"),
    ) else {
        return;
    };
    let folder = folder("mesh_frames");
    let silent = |name: &str, of: &str| {
        let mut bytes = std::fs::read(of).unwrap();
        bytes[..80].fill(b' ');
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        text(&path).to_owned()
    };
    let (silent_lps, silent_ras) = (silent("lps.stl", &lps), silent("ras.stl", &ras));
    let out = folder.join("box.vtu");
    let intensity = format!("ct={scan}");
    let meshed = |file: &str, more: &[&str]| {
        let mut words = vec!["mesh", file, "--tets", "2000", "--out", text(&out)];
        words.extend(["--intensity", &intensity]);
        words.extend(more);
        let done = palpate(&words);
        stdout(&done);
        String::from_utf8_lossy(&done.stderr).into_owned()
    };
    let is_right = || {
        let (low, high) = field_range(&out, "ct");
        assert!(
            (555.0..570.0).contains(&low) && (895.0..915.0).contains(&high),
            "{low} {high}"
        );
        let info = stdout(&palpate(&["info", text(&out)]));
        assert!(info.contains("RAS"), "{info}");
    };
    for file in [&lps, &ras] {
        assert!(!meshed(file, &[]).contains("--frame"));
        is_right();
    }
    let notes = meshed(&silent_lps, &[]);
    assert!(
        notes.contains("taken as LPS") && notes.contains("--frame ras"),
        "{notes}"
    );
    is_right();
    assert!(!meshed(&silent_ras, &["--frame", "ras"]).contains("taken as"));
    is_right();
    meshed(&silent_lps, &["--frame", "lps"]);
    is_right();
    // A scene takes a silent surface in the same way.
    let scene = folder.join("scene.toml");
    for (file, frame) in [(&silent_lps, ""), (&silent_ras, "frame = \"ras\"\n")] {
        let source = format!(
            "[mesh]\nfile = \"{file}\"\n{frame}tets = 2000\nunit = \"mm\"\n[[scan]]\nfile = \"{scan}\"\n"
        );
        std::fs::write(&scene, source).unwrap();
        let read = palpate::scene::Scene::read(&scene).unwrap();
        let mesh = read.load_mesh(&palpate::no_progress).unwrap();
        let (low, high) = mesh.bounds();
        assert!(low.x > 0.0 && high.x < 45.0 && low.y > 0.0, "{low} {high}");
    }
    // Alone it keeps its coordinates.
    let alone = palpate(&["mesh", &silent_lps, "--tets", "2000", "--out", text(&out)]);
    stdout(&alone);
    let mesh = palpate::io::read(&out).unwrap();
    assert!(mesh.bounds().1.x < 0.0 && mesh.frame.is_none());
}

#[test]
fn lone_voxels_are_meshed_within_seconds() {
    let folder = folder("mesh_lone");
    for (name, voxels, side) in [
        ("09_one_voxel", 1.0, 2.0f64),
        ("10_diagonal_line", 20.0, 1.0),
    ] {
        let Some(file) = real(&format!("cases/{name}.nii.gz")) else {
            return;
        };
        let out = folder.join("lone.vtu");
        let done = palpate(&["mesh", &file, "--tets", "5000", "--out", text(&out)]);
        stdout(&done);
        let notes = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(notes.contains("lone or diagonal voxels"), "{notes}");
        let volume = palpate::io::read(&out).unwrap().volume();
        let wanted = voxels * side.powi(3);
        assert!((volume / wanted - 1.0).abs() < 0.1, "{name}: {volume}");
    }
}

#[test]
fn one_of_several_volumes_is_meshed_by_number() {
    let folder = folder("mesh_number");
    let path = folder.join("times.mha");
    let header = "ObjectType = Image\nNDims = 4\nDimSize = 8 8 8 2\nElementType = MET_UCHAR\n\
                  ElementDataFile = LOCAL\n";
    // A block of label 1, then the same of label 2.
    let inside = |n: usize| {
        [n % 8, n / 8 % 8, n / 64 % 8]
            .iter()
            .all(|i| (2..6).contains(i))
    };
    let voxels = (0..1024).map(|n| if inside(n) { 1 + (n / 512) as u8 } else { 0 });
    let bytes: Vec<u8> = header.bytes().chain(voxels).collect();
    std::fs::write(&path, bytes).unwrap();
    let input = text(&path);

    let error = failure(&palpate(&["info", input]));
    assert!(
        error.contains("2 volumes") && error.contains("--volume"),
        "{error}"
    );
    for (number, label) in [("0", 1), ("1", 2)] {
        let told = stdout(&palpate(&["info", input, "--volume", number, "--json"]));
        let told: serde_json::Value = serde_json::from_str(&told).unwrap();
        assert_eq!(told["labels"][1]["label"], label);
        let out = folder.join("mesh.vtu");
        let arguments = ["--tets", "500", "--volume", number, "--json", "--out"];
        let told = stdout(&palpate(
            &[&["mesh", input], &arguments[..], &[text(&out)]].concat(),
        ));
        let told: serde_json::Value = serde_json::from_str(&told).unwrap();
        assert_eq!(told["regions"][0]["label"], label);
        let mut scene = palpate::scene::Scene::of_mesh(&path);
        scene.mesh.volume = number.parse().ok();
        scene.mesh.tets = Some(500);
        let mesh = scene.mesh.load().unwrap();
        let field = mesh.field("label", palpate::mesh::Location::Cell).unwrap();
        assert!(field.values.iter().all(|v| *v == f64::from(label)));
    }
    let mesh = folder.join("mesh.vtu");
    let error = failure(&palpate(&["info", text(&mesh), "--volume", "0"]));
    assert!(error.contains("volumes only"), "{error}");
}

/// The tets that a press divides are small in a mesh by their sizes, others large.
#[test]
fn size_field_of_mesh_or_volume_sets_edge_lengths() {
    let folder = folder("mesh_size_field");
    let knee = shipped("knee.nrrd");
    let (first, second) = (folder.join("first.vtu"), folder.join("second.vtu"));
    let labels = ["mesh", &knee, "--labels", "all", "--out"];
    let made = |out: &Path, more: &[&str]| palpate(&[&labels[..], &[text(out)], more].concat());
    stdout(&made(&first, &["--tets", "4000"]));
    let mut mesh = palpate::io::read(&first).unwrap();
    let (low, high) = mesh.bounds();
    let middle = 0.5 * (low.x + high.x);
    let centre = |mesh: &palpate::mesh::TetMesh, t: usize| {
        mesh.tets[t]
            .iter()
            .map(|v| mesh.nodes[*v as usize].x)
            .sum::<f64>()
            / 4.0
    };
    let on_right = |mesh: &palpate::mesh::TetMesh| {
        let right = (0..mesh.tets.len()).filter(|t| centre(mesh, *t) > middle);
        right.count() as f64 / mesh.tets.len() as f64
    };
    let errors: Vec<f64> = (0..mesh.tets.len())
        .map(|t| if centre(&mesh, t) > middle { 1.0 } else { 0.01 })
        .collect();
    let before = on_right(&mesh);
    let field = palpate::mesh::Field::scalar("error", palpate::mesh::Location::Cell, errors);
    mesh.set_field(field).unwrap();
    let sizes = folder.join("error.vtu");
    palpate::io::write(&sizes, &mesh).unwrap();
    stdout(&made(
        &second,
        &["--size-field", text(&sizes), "--tets", "8000"],
    ));
    let finer = palpate::io::read(&second).unwrap();
    assert!(
        (6_800..=9_200).contains(&finer.tets.len()),
        "{}",
        finer.tets.len()
    );
    let after = on_right(&finer);
    assert!(after > before + 0.2, "{before}, {after}");

    let expect = |more: &[&str], why: &str| {
        let said = failure(&made(&second, more));
        assert!(said.contains(why), "{said}");
    };
    let far = folder.join("far.vtu");
    mesh.nodes.iter_mut().for_each(|p| p.x += 1e4);
    palpate::io::write(&far, &mesh).unwrap();
    expect(&["--size-field", text(&far)], "do not overlap");
    let surface = folder.join("knee.ply");
    stdout(&palpate(&[
        "mesh",
        &knee,
        "--labels",
        "all",
        "--out",
        text(&surface),
    ]));
    expect(&["--size-field", text(&surface)], "is a surface");
}
