//! Scans carried by bodies in scenes. A scan and a mesh field that are the same linear function of
//! the rest position must give the same picture, whatever else is in the scene.

use crate::support::{gpu, real_data};
use glam::{DAffine3, DMat3, DVec3};
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::io;
use palpate::mesh::{Field, Location, TetMesh, Topology, TriMesh};
use palpate::render::Image;
use palpate::scene::{Scene, Stage};
use palpate::volume::{Raw, Volume};
use std::path::{Path, PathBuf};

/// The common linear function.
fn ramp(p: DVec3) -> f64 {
    p.dot(DVec3::new(17.0, 4.0, 9.0)) + 200.0
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("palpate-scan-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Returns a block of 40 mm with the ramp at its nodes.
fn block() -> TetMesh {
    let size = DVec3::splat(40.0);
    let mut mesh = generate::box_mesh([5, 5, 5], size, generate::Split::Five).unwrap();
    let low = mesh.bounds().0;
    mesh.nodes.iter_mut().for_each(|p| *p -= low);
    let values = mesh.nodes.iter().map(|p| ramp(*p)).collect();
    mesh.set_field(Field::scalar("ramp", Location::Node, values))
        .unwrap();
    mesh
}

fn volume(size: [usize; 3], spacing: f64, first: f64, value: impl Fn(DVec3) -> f64) -> Volume {
    let to_world = DAffine3::from_mat3_translation(
        DMat3::from_diagonal(DVec3::splat(spacing)),
        DVec3::splat(first),
    );
    let [nx, ny, _] = size;
    let values = (0..size.iter().product()).map(|n| {
        let index = [n % nx, n / nx % ny, n / nx / ny].map(|i| i as f64);
        value(to_world.transform_point3(index.into())).round() as i16
    });
    Volume {
        size,
        raw: Raw::I16(values.collect()),
        to_world,
        ..Volume::default()
    }
}

/// Writes the block, the scan, a skin, and their appearance.
fn files(name: &str) -> PathBuf {
    let folder = folder(name);
    let mesh = block();
    io::write(folder.join("block.vtu"), &mesh).unwrap();
    // The voxels extend to half a voxel beyond the block.
    io::write_volume(folder.join("ramp.nrrd"), &volume([24; 3], 2.0, -3.0, ramp)).unwrap();
    let topology = Topology::new(&mesh);
    let corners = topology
        .boundary
        .iter()
        .map(|b| topology.boundary_nodes(&mesh, *b));
    let surface = TriMesh {
        vertices: mesh.nodes.clone(),
        triangles: corners.collect(),
        ..TriMesh::default()
    };
    io::write_surface(folder.join("skin.ply"), &surface).unwrap();
    let look = r#"{"colour": [[200, 1, 0.2, 0.1], [800, 0.2, 0.9, 0.3], [1400, 0.9, 0.9, 1.0]],
        "extinction": [[200, 0.0], [500, 0.01], [800, 0.06], [1400, 0.02]]}"#;
    std::fs::write(folder.join("look.json"), look).unwrap();
    folder
}

const SCENE: &str = r#"
[mesh]
file = "block.vtu"
unit = "mm"
[material]
model = "neo-hookean"
young = 1500
[solver]
name = "implicit"
dt = 0.02
gravity = [0, -9.81, 0]
[[pin]]
axis = "x"
below = 0.05
[camera]
eye = [90, 60, 140]
look_at = [20, 15, 20]
up = [0, 1, 0]
fov = 26
[light]
from = "none"
[picture]
size = [80, 80]
range = [200, 1400]
transfer = "look.json"
"#;

const TOOL: &str = r#"
[[tool]]
sphere = { radius = 6 }
at = [30, 49, 30]
path = [[0, 0, 0, 0], [0.1, 0, -6, 0]]
"#;

/// Through half of the block, and open at the end.
const CUT: &str = r#"
[[cut]]
edge = [[10.1, 50, -5], [10.1, 50, 45]]
path = [[0.02, 0, 0, 0], [0.06, 0, -30, 0]]
"#;

fn stage(gpu: &Gpu, folder: &Path, text: &str) -> Stage {
    let file = folder.join("scene.toml");
    std::fs::write(&file, text).unwrap();
    Stage::new(gpu, &Scene::read(&file).unwrap()).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn refused(folder: &Path, text: &str) -> String {
    let file = folder.join("scene.toml");
    std::fs::write(&file, text).unwrap();
    let scene = match Scene::read(&file) {
        Ok(scene) => scene,
        Err(error) => return error.to_string(),
    };
    let stage = Stage::new(&gpu(), &scene);
    stage.err().expect("invalid scene accepted").to_string()
}

/// Returns the picture after `steps` steps.
fn seen(stage: &mut Stage, steps: u32) -> Image {
    stage.run(steps, &mut |_| {}).unwrap();
    stage.image().unwrap()
}

/// Returns the root mean square of the difference, in 1/255, or in 1/255 of the maximum for EXRs;
/// without the 0.1 % of rays with the largest difference, which are grazing.
fn unlike(a: &Image, b: &Image) -> f64 {
    let most = a.values.iter().fold(1.0f32, |m, v| m.max(*v));
    let rays = a.values.chunks(a.channels).zip(b.values.chunks(b.channels));
    let square = |(a, b): (&f32, &f32)| f64::from((a - b) / most).powi(2);
    let mut each: Vec<f64> = rays
        .map(|(a, b)| a.iter().zip(b).map(square).sum())
        .collect();
    each.sort_by(f64::total_cmp);
    each.truncate(each.len() * 999 / 1000);
    255.0 * (each.iter().sum::<f64>() / a.values.len() as f64).sqrt()
}

/// Name, additions to the scene, and replacements in it.
type Case<'a> = (&'a str, &'a str, &'a [(&'a str, &'a str)]);

#[test]
#[ignore = "long: scripts/test --full"]
fn scan_matches_field_with_all_scene_features() {
    let folder = files("alike");
    // Additional entries of a scene, and replaced words.
    let plain = [("", "")];
    let inside = [("eye = [90, 60, 140]", "eye = [22, 12, 24]")];
    let xray = "[xray]\nwater = 1000\nair = 0\n";
    let cases: &[Case<'_>] = &[
        ("plain", "", &plain),
        (
            "clip",
            "[[plane]]\nclip = [20, 20, 22, 0.2, 0, 1]\n",
            &plain,
        ),
        (
            "slice",
            "[[plane]]\nslice = [20, 20, 22, 0.2, 0, 1]\n",
            &plain,
        ),
        (
            "isosurface",
            "[[isosurface]]\nvalue = 700\nopacity = 0.7\n",
            &plain,
        ),
        (
            "skin",
            "[[skin]]\nfile = \"skin.ply\"\nopacity = 0.4\n",
            &plain,
        ),
        ("tool", TOOL, &plain),
        ("inside", "", &inside),
        ("cage", "[cage]\nnodes = 60\n", &plain),
        ("cut", CUT, &plain),
        ("mip", "", &[("[picture]", "[picture]\nmode = \"mip\"")]),
        ("mean", "", &[("[picture]", "[picture]\nmode = \"mean\"")]),
        ("xray", xray, &[("[picture]", "[picture]\nmode = \"xray\"")]),
    ];
    let gpu = gpu();
    let mut pictures = Vec::new();
    for (name, more, replaced) in cases {
        let mut text = format!("{SCENE}{more}");
        for (from, to) in *replaced {
            text = text.replacen(from, to, 1);
        }
        let field = text.replace("[picture]", "[picture]\nfield = \"ramp\"");
        let scan = format!("{text}[scan]\nfile = \"ramp.nrrd\"\n");
        let field = seen(&mut stage(&gpu, &folder, &field), 12);
        let scan = seen(&mut stage(&gpu, &folder, &scan), 12);
        let off = unlike(&field, &scan);
        println!("{name}: {off:.3} of 255");
        assert!(off < 0.1, "{name}: {off}");
        let lit = field.values.iter().filter(|v| **v > 0.02).count();
        assert!(lit > 1000, "{name}: only {lit} values are seen");
        // Each of them is visible, except for the coarse body, which equals the fine one.
        let other = pictures.first().map(|plain| unlike(plain, &field));
        assert!(
            other.is_none_or(|off| off > 1.0) || *name == "cage",
            "{name}"
        );
        pictures.push(field);
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Returns the fraction of light that remains with shadows.
fn left(gpu: &Gpu, folder: &Path, text: &str) -> f64 {
    let sum = |shadows: &str| {
        let text = text.replace("from = \"none\"", shadows);
        let image = stage(gpu, folder, &text).image().unwrap();
        image.values.iter().map(|v| f64::from(*v)).sum::<f64>()
    };
    sum("from = [1, 2, 0.5]\nshadows = 0.9") / sum("from = [1, 2, 0.5]")
}

#[test]
fn scan_shadows_match_field_shadows() {
    let (gpu, folder) = (gpu(), files("shadows"));
    let field = SCENE.replace("[picture]", "[picture]\nfield = \"ramp\"");
    let scan = format!("{SCENE}[scan]\nfile = \"ramp.nrrd\"\n");
    let [field, scan] = [field, scan].map(|text| left(&gpu, &folder, &text));
    println!("light left: {field:.4} by the field, {scan:.4} by the scan");
    assert!(field < 0.9, "{field}");
    assert!((scan - field).abs() < 0.1 * (1.0 - field), "{field} {scan}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn two_bodies_share_one_scan() {
    let (gpu, folder) = (gpu(), files("bodies"));
    let mut upper = block();
    upper.nodes.iter_mut().for_each(|p| p.z += 60.0);
    io::write(folder.join("upper.vtu"), &upper).unwrap();
    // Between the blocks it restarts, as does the field of the upper one.
    let wide = volume([48, 48, 96], 1.2, -3.0, |p| {
        ramp(p) - if p.z > 50.0 { 9.0 * 60.0 } else { 0.0 }
    });
    io::write_volume(folder.join("wide.nrrd"), &wide).unwrap();
    let view = "eye = [190, 60, 240]\nlook_at = [20, 20, 50]";
    let text = SCENE.replace("eye = [90, 60, 140]\nlook_at = [20, 15, 20]", view)
        + "[scan]\nfile = \"wide.nrrd\"\n";
    let start = text.find("[material]").unwrap();
    let (rest, pins) = text[start..].split_once("[[pin]]").unwrap();
    let after = pins.find("[camera]").unwrap();
    let body = |file: &str| {
        format!(
            "[[body]]\nmesh = {{ file = \"{file}\", unit = \"mm\" }}\n[[body.pin]]\naxis = \"x\"\nbelow = 0.05\n"
        )
    };
    let pins = &pins[after..];
    let bodies = format!("{rest}{pins}{}{}", body("block.vtu"), body("upper.vtu"));
    let scan = seen(&mut stage(&gpu, &folder, &bodies), 4);
    let own = "[scan]\nfile = \"wide.nrrd\"\n";
    let bodies = bodies
        .replace(own, "")
        .replace("[picture]", "[picture]\nfield = \"ramp\"");
    let field = seen(&mut stage(&gpu, &folder, &bodies), 4);
    let off = unlike(&field, &scan);
    println!("{off:.3} of 255");
    assert!(off < 0.1, "{off}");
    let one = seen(&mut stage(&gpu, &folder, &text), 4);
    assert!(unlike(&scan, &one) > 1.0);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn xray_uses_scan_values_not_appearance() {
    let (gpu, folder) = (gpu(), files("numbers"));
    let text = SCENE.replace("[picture]", "[picture]\nmode = \"xray\"");
    let (start, end) = text.split_once("range = [200, 1400]\n").unwrap();
    let wide = format!("{start}{end}");
    let narrow = format!("{start}range = [600, 700]\n{end}");
    let scan = "[scan]\nfile = \"ramp.nrrd\"\n";
    let mut said = Vec::new();
    let mut most = |text: &str| {
        let mut stage = stage(&gpu, &folder, text);
        said.push(stage.notes().join("; "));
        let image = stage.image().unwrap();
        image.values.iter().fold(0.0f32, |m, v| m.max(*v))
    };
    // Values from 200 to 1400 are interpreted as offset by 1024: μ from 0.036 to 0.28 per cm, over
    // at most 6.9 cm.
    let film = [
        &wide,
        &narrow,
        &format!("{wide}{scan}"),
        &format!("{narrow}{scan}"),
    ]
    .map(|t| most(t));
    println!("{film:?} {said:?}");
    assert!((film[0] / 0.956 - 1.0).abs() < 0.01, "{film:?}");
    assert!(
        film.iter().all(|f| (f / film[0] - 1.0).abs() < 1e-3),
        "{film:?}"
    );
    assert!(said.iter().all(|s| s.contains("water at 1024")), "{said:?}");
    // Hounsfield units are used unchanged, with fat and without air.
    let mut mesh = block();
    let hounsfield = mesh.nodes.iter().map(|p| ramp(*p) - 320.0).collect();
    mesh.set_field(Field::scalar("ramp", Location::Node, hounsfield))
        .unwrap();
    io::write(folder.join("block.vtu"), &mesh).unwrap();
    let mut own = stage(&gpu, &folder, &wide);
    assert!(
        !own.notes().join("; ").contains("1024"),
        "{:?}",
        own.notes()
    );
    let own = own
        .image()
        .unwrap()
        .values
        .iter()
        .fold(0.0f32, |m, v| m.max(*v));
    assert!(own > 1.2 * film[0], "{own} {film:?}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn projections_treat_integers_as_values() {
    let (gpu, folder) = (gpu(), files("values"));
    let few = volume([24; 3], 2.0, -3.0, |p| (p.x / 10.0).floor());
    io::write_volume(folder.join("few.nrrd"), &few).unwrap();
    let scan = "[scan]\nfile = \"few.nrrd\"\n";
    let (start, end) = SCENE.split_once("range = [200, 1400]\n").unwrap();
    let text = format!("{start}{end}");
    assert!(
        stage(&gpu, &folder, &format!("{text}{scan}"))
            .notes()
            .join("")
            .contains("labels")
    );
    let text = text.replace("transfer = \"look.json\"\n", "mode = \"mip\"\n");
    let mut projected = stage(&gpu, &folder, &format!("{text}{scan}"));
    let image = projected.image().unwrap();
    assert!(image.values.iter().any(|v| *v > 0.9));
    let file = folder.join("scene.toml");
    std::fs::write(&file, format!("{text}{scan}labels = true\n")).unwrap();
    let mut labelled = Stage::new(&gpu, &Scene::read(&file).unwrap()).unwrap();
    let said = labelled.image().unwrap_err().to_string();
    assert!(
        said.contains("label map") && said.contains("labels = false"),
        "{said}"
    );
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn scan_rejects_invalid_entries() {
    let folder = files("wrong");
    let labels = volume([24; 3], 2.0, -3.0, |p| f64::from(u8::from(p.x > 20.0)));
    io::write_volume(folder.join("labels.nrrd"), &labels).unwrap();
    let far = volume([24; 3], 2.0, 300.0, ramp);
    io::write_volume(folder.join("far.nrrd"), &far).unwrap();
    for (more, words) in [
        ("file = \"none.nrrd\"", &["none.nrrd"][..]),
        ("file = \"far.nrrd\"", &["do not overlap", "299.0"]),
        ("file = \"ramp.nrrd\"\nrange = [3, 3]", &["3", "range"]),
        (
            "file = \"ramp.nrrd\"\ntransfer = \"bonny\"",
            &["bonny", "bone"],
        ),
        (
            "file = \"ramp.nrrd\"\ncolour = \"red\"",
            &["colour", "transfer", "label"],
        ),
        ("file = \"block.vtu\"", &["block.vtu"]),
        (
            "file = \"labels.nrrd\"\n[scan.label.femur]\nopacity = 0.5",
            &["labels.nrrd", "femur", "available: 0, 1"],
        ),
        (
            "file = \"labels.nrrd\"\n[scan.label.1]\nopacity = 1.5",
            &["label 1", "1.5", "[0, 1]"],
        ),
        (
            "file = \"labels.nrrd\"\n[scan.label.1]\nhidden = true",
            &["all labels are hidden"],
        ),
        (
            "file = \"labels.nrrd\"\nlabels = false\n[scan.label.1]\nhidden = true",
            &["labels = false", "remove one"],
        ),
    ] {
        let said = refused(&folder, &format!("{SCENE}[scan]\n{more}\n"));
        println!("{said}");
        assert!(words.iter().all(|w| said.contains(w)), "{words:?}: {said}");
    }
    let many = "[[scan]]\nfile = \"ramp.nrrd\"\n".repeat(9);
    let said = refused(&folder, &format!("{SCENE}{many}"));
    assert!(said.contains('9') && said.contains('8'), "{said}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The scenes in the documentation, on their real scans.
#[test]
#[ignore = "long: three scenes of real scans"]
fn real_scan_scenes_deform() {
    let here = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/scan"));
    for (name, called, file, steps) in [
        ("cheek", "headsq.mhd", "volumes/headsq_ct_64x64x93.mhd", 20),
        ("jaw", "headsq.mhd", "volumes/headsq_ct_64x64x93.mhd", 10),
        (
            "chest",
            "chest.nrrd",
            "volumes/chest_ct_lidc2_256x256x133.nrrd",
            15,
        ),
    ] {
        let Some(real) = real_data(file) else {
            continue;
        };
        let text = std::fs::read_to_string(here.join(format!("{name}.toml"))).unwrap();
        assert_eq!(text.matches(called).count(), 2, "{name}");
        let folder = folder(name);
        for look in ["headsq.json", "chest.json"] {
            std::fs::copy(here.join(look), folder.join(look)).unwrap();
        }
        let text = text.replace(called, &real.to_string_lossy());
        let mut stage = stage(&gpu(), &folder, &text);
        let before = stage.image().unwrap();
        let rest = stage.mesh().nodes.clone();
        let after = seen(&mut stage, steps);
        let now = stage.motion().unwrap().positions().unwrap();
        let farthest = now.iter().zip(&rest).map(|(a, b)| a.distance(*b));
        let farthest = farthest.fold(0.0, f64::max);
        let off = unlike(&before, &after);
        println!("{name}: up to {farthest:.1} mm, {off:.1} of 255");
        assert!((4.0..60.0).contains(&farthest) && off > 1.0, "{name}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
