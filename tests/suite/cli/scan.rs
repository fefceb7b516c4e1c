//! `--scan`, `--rest`, `--mode xray`: scans carried by bodies, from the command line.

use crate::cli::*;
use glam::DVec3;
use palpate::io;
use palpate::mesh::{Field, Location};
use palpate::render::Image;

/// Writes meshes of a phantom's scan, at rest and bent, the second also with its displacement.
fn meshes(folder: &Path, scan: &str, regions: &[&str]) -> [PathBuf; 3] {
    let [rest, bent, told] = ["rest.vtu", "bent.vtu", "told.vtu"].map(|f| folder.join(f));
    let mesh = [
        &["mesh", scan, "--tets", "4000", "--out", text(&rest)],
        regions,
    ]
    .concat();
    stdout(&palpate(&mesh));
    let mut mesh = io::read(&rest).unwrap();
    let (low, high) = mesh.bounds();
    let middle = 0.5 * (low + high);
    let moved: Vec<DVec3> = mesh
        .nodes
        .iter()
        .map(|p| *p - middle)
        .map(|p| DVec3::new(0.004 * p.z * p.z, 0.0, 6.0 + 0.1 * p.z))
        .collect();
    mesh.nodes
        .iter_mut()
        .zip(&moved)
        .for_each(|(p, u)| *p += *u);
    io::write(&bent, &mesh).unwrap();
    let values = moved.iter().flat_map(|u| u.to_array()).collect();
    mesh.set_field(Field {
        components: 3,
        ..Field::scalar("displacement", Location::Node, values)
    })
    .unwrap();
    io::write(&told, &mesh).unwrap();
    [rest, bent, told]
}

const VIEW: &[&str] = &["--size", "80x80", "--eye=-60,420,60", "--look-at=2,4,0"];

fn drawn(mesh: &Path, scan: &str, out: &Path, more: &[&str]) -> (Image, String) {
    let fixed = ["render", text(mesh), "--scan", scan, "--out", text(out)];
    let output = palpate(&[&fixed, VIEW, more].concat());
    stdout(&output);
    let said = String::from_utf8(output.stderr).unwrap();
    (Image::read_for_comparison(out).unwrap(), said)
}

#[test]
fn scan_deforms_with_mesh_of_known_rest_state() {
    let folder = folder("scan_rest");
    let scan = format!("{DATA}/knee.nrrd");
    let [rest, bent, told] = meshes(&folder, &scan, &["--labels", "all"]);
    let out = |name: &str| folder.join(name);
    let (straight, said) = drawn(&rest, &scan, &out("rest.exr"), &[]);
    assert!(said.contains("11 different integer values"), "{said}");
    let (by_mesh, _) = drawn(&bent, &scan, &out("a.exr"), &["--rest", text(&rest)]);
    let (by_field, said) = drawn(&told, &scan, &out("b.exr"), &[]);
    assert!(said.contains("field displacement"), "{said}");
    let unlike = |a: &Image, b: &Image| {
        let each = a.values.iter().zip(&b.values);
        each.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / a.values.len() as f64
    };
    assert!(unlike(&by_mesh, &by_field) < 1e-4);
    assert!(unlike(&straight, &by_mesh) > 0.01);
    // Without --rest, the mesh is taken as the rest state: the scan stays in place.
    let (unmoved, _) = drawn(&bent, &scan, &out("c.exr"), &[]);
    assert!(unlike(&unmoved, &by_mesh) > 0.01);
    let file = out("d.png");
    let by_hand = bent.clone();
    let bent = ["render", text(&bent), "--scan", &scan, "--out", text(&file)];
    let limb = format!("{DATA}/limb.vtu");
    let said = failure(&palpate(&[&bent[..], &["--rest", &limb]].concat()));
    assert!(
        said.contains("limb.vtu") && said.contains("rest state"),
        "{said}"
    );
    let nothing = [
        "render",
        &limb,
        "--scan",
        "nothing.nrrd",
        "--out",
        text(&file),
    ];
    assert!(failure(&palpate(&nothing)).contains("nothing.nrrd"));
    // X-rays of fields, too, depend on the ratio of the density to that at rest.
    let film = |mesh: &Path, name: &str, more: &[&str]| {
        let (file, mode) = (out(name), ["--mode", "xray"]);
        let fixed = ["render", text(mesh), "--out", text(&file)];
        stdout(&palpate(&[&fixed, VIEW, &mode, more].concat()));
        Image::read_for_comparison(&file).unwrap()
    };
    let by_mesh = film(&by_hand, "f.exr", &["--rest", text(&rest)]);
    assert!(unlike(&by_mesh, &film(&told, "g.exr", &[])) < 1e-4);
    assert!(unlike(&by_mesh, &film(&by_hand, "h.exr", &[])) > 1e-3);
    // Tets inverted by the motion are flipped by a reader.
    let mut folded = io::read(&rest).unwrap();
    let [a, b, c, d] = folded.tet_nodes(0);
    let node = folded.tets[0][0] as usize;
    folded.nodes[node] = 2.0 / 3.0 * (b + c + d) - a;
    let file = folder.join("folded.vtu");
    io::write(&file, &folded).unwrap();
    assert!(io::read(&file).unwrap().tets != folded.tets);
    let (folded, _) = drawn(&file, &scan, &out("i.exr"), &["--rest", text(&rest)]);
    let apart = unlike(&folded, &straight);
    assert!(apart < 0.01, "{apart}");
}

#[test]
fn xray_uses_energy_flag_and_scene_film() {
    let folder = folder("scan_xray");
    let scan = format!("{DATA}/chest_ct.mha");
    let regions = [
        "--between",
        "air=-1100..-400",
        "--between",
        "body=-400..3000",
    ];
    let [rest, ..] = meshes(&folder, &scan, &regions);
    let sum = |energy: &str| {
        let out = folder.join(format!("{energy}.exr"));
        let (image, _) = drawn(&rest, &scan, &out, &["--mode", "xray", "--energy", energy]);
        let values = image.values.chunks(image.channels).map(|p| f64::from(p[0]));
        let most = values.clone().fold(0.0, f64::max);
        (values.sum::<f64>(), most)
    };
    let (soft, most) = sum("60");
    let (hard, _) = sum("120");
    println!("∫ μ dl sums to {soft:.1} at 60 keV, {hard:.1} at 120; at most {most:.2}");
    // Water: 0.206 and 0.161 per cm, a ratio of 1.28; bones have a larger one. 22 cm of a chest,
    // with a spine.
    let ratio = soft / hard;
    assert!((ratio - 1.3336).abs() < 2e-3, "{ratio}");
    assert!((most / 5.80 - 1.0).abs() < 0.01, "{most}");
    let film = |out: &str, more: &[&str]| {
        let out = folder.join(out);
        let (_, said) = drawn(&rest, &scan, &out, &[&["--mode", "xray"], more].concat());
        (Image::read_for_comparison(&out).unwrap(), said)
    };
    let (film, _) = film("film.png", &[]);
    let brightest = film.values.iter().fold(0.0f32, |m, v| m.max(*v));
    assert!(brightest > 0.9, "{brightest}");
    let mut rgb = film.values.chunks(film.channels);
    assert!(
        rgb.all(|p| p[0] == p[1] && p[1] == p[2]),
        "picture must be grey"
    );
    let fixed = ["render", text(&rest), "--scan", &scan, "--out", "a.png"];
    let wrong = palpate(&[&fixed[..], &["--mode", "xray", "--energy", "5"]].concat());
    let said = failure(&wrong);
    assert!(said.contains('5') && said.contains("20"), "{said}");
}
