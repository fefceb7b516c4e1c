//! `palpate warp`.

use crate::cli::{DATA, failure, folder, palpate, stdout, text};
use glam::DVec3;
use palpate::io::{self, read_volume};
use palpate::mesh::TetMesh;
use palpate::warp::Warp;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Returns a folder with the meshed knee, and its bent mesh.
fn knee(name: &str) -> (PathBuf, String, TetMesh) {
    let folder = folder(name);
    let scan = format!("{DATA}/knee.nrrd");
    let rest = folder.join("rest.vtu");
    let size = ["--labels", "all", "--tets", "6000", "--out", text(&rest)];
    stdout(&palpate(&[&["mesh", &scan][..], &size].concat()));
    let mesh = io::read(&rest).unwrap();
    write(&folder.join("bent.vtu"), &mesh, bend);
    (folder, scan, mesh)
}

fn bend(p: DVec3) -> DVec3 {
    p + 4.0 * DVec3::new((0.03 * p.z).sin(), (0.02 * p.x).cos(), 0.0)
}

/// Writes the mesh with its nodes moved.
fn write(path: &Path, mesh: &TetMesh, to: impl Fn(DVec3) -> DVec3) {
    let nodes = mesh.nodes.iter().map(|p| to(*p)).collect();
    let moved = TetMesh {
        nodes,
        ..mesh.clone()
    };
    io::write(path, &moved).unwrap();
}

fn told(output: &std::process::Output) -> String {
    stdout(output);
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn warp_moves_segmentation_with_mesh() {
    let (folder, scan, _) = knee("warp_mesh");
    let at = |name: &str| text(&folder.join(name)).to_owned();
    let files = [at("warped.nii.gz"), at("there.nii.gz"), at("back.nrrd")];
    let output = palpate(&[
        "warp",
        &scan,
        "--mesh",
        &at("rest.vtu"),
        "--to",
        &at("bent.vtu"),
        "--out",
        &files[0],
        "--displacement",
        &files[1],
        "--inverse",
        &files[2],
        "--labels",
    ]);
    let told = told(&output);
    let [rest, bent] = ["rest.vtu", "bent.vtu"].map(|name| io::read(folder.join(name)).unwrap());
    let volume = read_volume(&scan).unwrap();
    let (grid, warp) = (volume.grid(), Warp::new(&rest, &bent.nodes).unwrap());
    let outside = warp.inverse(&grid).unwrap().coverage.uncovered;
    let unmoved = warp.displacement(&grid).unwrap().coverage.uncovered;
    let share = |n: usize| {
        format!(
            "{n} voxels ({:.1} %)",
            100.0 * n as f64 / volume.voxels() as f64
        )
    };
    for words in [
        format!(
            "{} are outside all tets and set to background; 0 voxels are inside more than one tet; 0 of {} tets are inverted in the deformed mesh",
            share(outside),
            rest.tets.len()
        ),
        format!(
            "{} of the scan are outside all tets at rest and are not moved",
            share(unmoved)
        ),
    ] {
        assert!(told.contains(&words), "{words}: {told}");
    }
    let [before, after] = [scan.as_str(), &files[0]].map(|f| read_volume(f).unwrap());
    assert_eq!(after.size, before.size);
    assert_eq!(after.raw.scalar_type(), before.raw.scalar_type());
    let [before, after] = [before, after].map(|v| v.labels().unwrap());
    let set = |labels: &std::collections::BTreeMap<i64, usize>| -> BTreeSet<i64> {
        labels.keys().copied().collect()
    };
    assert_eq!(set(&before), set(&after));
    // Bent, but neither compressed nor truncated: the femur keeps its volume, up to the error of a
    // coarse mesh.
    let femur = |labels: &std::collections::BTreeMap<i64, usize>| labels[&5] as f64;
    let share = femur(&after) / femur(&before);
    assert!((0.9..1.05).contains(&share), "{share}");
    assert!(files.iter().all(|f| Path::new(f).is_file()));
    // On the grid of another scan, with its own type.
    let (other, like) = (format!("{DATA}/head_ct.mha"), at("like.mha"));
    let on_other = ["--like", &other, "--labels", "--background", "200"];
    let given = [
        "warp",
        &scan,
        "--mesh",
        &at("rest.vtu"),
        "--to",
        &at("bent.vtu"),
    ];
    stdout(&palpate(
        &[&given[..], &on_other, &["--out", &like]].concat(),
    ));
    let [other, like] = [other, like].map(|f| read_volume(f).unwrap());
    assert_eq!(like.size, other.size);
    assert!(like.to_world.abs_diff_eq(other.to_world, 1e-6));
    let found = like.labels().unwrap();
    let fits = |label: &i64| *label == 200 || before.contains_key(label);
    assert!(found.len() > 5 && found.contains_key(&200) && found.keys().all(fits));
}

#[test]
fn warp_simulates_scene_from_its_rest_mesh() {
    let (folder, scan, mesh) = knee("warp_scene");
    // In metres, stated in the file: positions are converted to the scan's mm.
    let small = TetMesh {
        nodes: mesh.nodes.iter().map(|p| 1e-3 * *p).collect(),
        length_unit: Some(1.0),
        ..mesh
    };
    io::write(folder.join("metres.vtu"), &small).unwrap();
    let at = |name: &str| text(&folder.join(name)).to_owned();
    let of = |mesh: &str, name: &str| {
        let scene = folder.join(format!("{name}.toml"));
        let said = "[solver]\nname = \"implicit\"\nengine = \"cpu\"\ndt = 0.01\nsteps = 2\n[material]\nyoung = 20000.0\n";
        std::fs::write(&scene, format!("[mesh]\nfile = \"{mesh}\"\n{said}")).unwrap();
        let out = at(&format!("{name}.nrrd"));
        let output = palpate(&[
            "warp",
            &scan,
            "--to",
            text(&scene),
            "--labels",
            "--out",
            &out,
        ]);
        (told(&output), read_volume(&out).unwrap())
    };
    let (words, of_mm) = of("rest.vtu", "mm");
    assert!(words.contains("set to background"), "{words}");
    let (_, of_metres) = of("metres.vtu", "metres");
    let same = (0..of_mm.voxels()).filter(|n| of_mm.raw.get(*n) == of_metres.raw.get(*n));
    let share = same.count() as f64 / of_mm.voxels() as f64;
    assert!(share > 0.999, "{share}");
    let before = read_volume(&scan).unwrap();
    let moved = (0..before.voxels()).filter(|n| of_mm.raw.get(*n) != before.raw.get(*n));
    assert!(moved.count() > 1000);
}

#[test]
fn warp_rejects_mismatched_input() {
    let (folder, scan, mesh) = knee("warp_wrong");
    let at = |name: &str| text(&folder.join(name)).to_owned();
    let (rest, bent, out) = (at("rest.vtu"), at("bent.vtu"), at("out.nii.gz"));
    let refused = |scan: &str, rest: &str, bent: &str, out: &str| {
        let given = ["warp", scan, "--mesh", rest, "--to", bent, "--out", out];
        let errors = failure(&palpate(&given));
        assert!(!Path::new(out).exists());
        errors
    };
    let holds = |errors: &str, words: &[&str]| {
        assert!(words.iter().all(|w| errors.contains(w)), "{errors}");
    };
    // Different nodes, different tets, the same number of others.
    write_part(&folder.join("fewer.vtu"), &mesh, |tets| tets.truncate(3000));
    let errors = refused(&scan, &rest, &at("fewer.vtu"), &out);
    holds(&errors, &["fewer.vtu", "nodes", "--mesh-out"]);
    write_part(&folder.join("one_less.vtu"), &mesh, |tets| {
        let full = |t: &[u32; 4]| mesh_without(&mesh, t);
        let spare = tets.iter().position(full).unwrap();
        tets.remove(spare);
    });
    let errors = refused(&scan, &rest, &at("one_less.vtu"), &out);
    let tets = mesh.tets.len();
    holds(
        &errors,
        &[&format!("{} tets", tets - 1), &format!("{tets};")],
    );
    write_part(&folder.join("other.vtu"), &mesh, |tets| {
        let spare = tets.iter().position(|t| mesh_without(&mesh, t)).unwrap();
        let far = (0..mesh.nodes.len() as u32)
            .rev()
            .find(|v| !tets[spare].contains(v));
        tets[spare][3] = far.unwrap();
    });
    let errors = refused(&scan, &rest, &at("other.vtu"), &out);
    holds(
        &errors,
        &["other.vtu", "which form no tet of the mesh at rest"],
    );
    // Invalid numbers, missing files, a missing folder, an unknown format.
    let text_mesh = at("bent.vtk");
    stdout(&palpate(&["convert", &bent, &text_mesh, "--text"]));
    let mut lines: Vec<String> = std::fs::read_to_string(&text_mesh)
        .unwrap()
        .lines()
        .map(str::to_owned)
        .collect();
    let points = lines.iter().position(|l| l.starts_with("POINTS")).unwrap();
    let first = lines[points + 1].split_once(' ').unwrap().1.to_owned();
    lines[points + 1] = format!("nan {first}");
    std::fs::write(&text_mesh, lines.join("\n")).unwrap();
    let errors = refused(&scan, &rest, &text_mesh, &out);
    holds(&errors, &["bent.vtk", "must have finite coordinates"]);
    for missing in [
        refused("/no/such.nii.gz", &rest, &bent, &out),
        refused(&scan, "/no/such.vtu", &bent, &out),
        refused(&scan, &rest, "/no/such.vtu", &out),
        refused(&scan, &rest, "/no/such.toml", &out),
    ] {
        holds(&missing, &["/no/such"]);
    }
    let errors = refused(&scan, &rest, &bent, &at("none/out.nii.gz"));
    holds(&errors, &["none", "create it first"]);
    let errors = refused(&scan, &rest, &bent, &at("out.dcm"));
    holds(&errors, &["out.dcm", ".nii.gz"]);
    // A scan of another region, a missing rest mesh, a flag for scenes only.
    write(&folder.join("far.vtu"), &mesh, |p| p + 1e4);
    let errors = refused(&scan, &rest, &at("far.vtu"), &out);
    holds(&errors, &["no voxel is inside the body", "RAS"]);
    let errors = failure(&palpate(&["warp", &scan, "--to", &bent, "--out", &out]));
    holds(&errors, &["--mesh"]);
    let steps = ["--steps", "3"];
    let given = ["warp", &scan, "--mesh", &rest, "--to", &bent, "--out", &out];
    let errors = failure(&palpate(&[&given[..], &steps].concat()));
    holds(&errors, &["--steps"]);
    let errors = failure(&palpate(&[&given[..], &["--background", "1000"]].concat()));
    holds(&errors, &["1000", "--background"]);
    assert!(!Path::new(&out).exists());
}

/// Whether all nodes of a tet also belong to others, so it can be dropped.
fn mesh_without(mesh: &TetMesh, tet: &[u32; 4]) -> bool {
    tet.iter()
        .all(|v| mesh.tets.iter().filter(|t| t.contains(v)).count() > 1)
}

/// Writes the bent mesh with modified tets.
fn write_part(path: &Path, mesh: &TetMesh, change: impl FnOnce(&mut Vec<[u32; 4]>)) {
    let mut tets = mesh.tets.clone();
    change(&mut tets);
    let nodes = mesh.nodes.iter().map(|p| bend(*p)).collect();
    let part = TetMesh::new(nodes, tets, Vec::new(), Vec::new()).unwrap();
    io::write(path, &part).unwrap();
}

#[test]
fn warp_reports_inverted_tets() {
    let (folder, scan, mesh) = knee("warp_inverted");
    let at = |name: &str| text(&folder.join(name)).to_owned();
    // Readers flip such tets; the rest mesh identifies them.
    let (low, high) = mesh.bounds();
    let middle = 0.5 * (low + high);
    let near = (0..mesh.nodes.len()).min_by(|a, b| {
        let far = |v: usize| mesh.nodes[v].distance(middle);
        far(*a).total_cmp(&far(*b))
    });
    let moved = mesh.nodes[near.unwrap()];
    let push = |p: DVec3| if p == moved { p + 30.0 } else { p };
    write(&folder.join("folded.vtu"), &mesh, push);
    let turned = |t: &&[u32; 4]| {
        let [a, b, c, d] = t.map(|v| push(mesh.nodes[v as usize]));
        (b - a).cross(c - a).dot(d - a) <= 0.0
    };
    let inverted = mesh.tets.iter().filter(turned).count();
    assert!(inverted > 0);
    let (rest, folded, out) = (at("rest.vtu"), at("folded.vtu"), at("folded.mha"));
    let given = [
        "warp", &scan, "--mesh", &rest, "--to", &folded, "--out", &out,
    ];
    let words = told(&palpate(&given));
    let count = format!("; {inverted} of {} tets are inverted", mesh.tets.len());
    assert!(words.contains(&count), "{words}");
    assert!(words.contains("intersects itself"), "{words}");
}
