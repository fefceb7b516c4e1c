//! The first picture of an arbitrary mesh: its regions, automatic supports and loads, and framing.

use crate::support::{gpu, real_data};
use glam::DVec3;
use palpate::generate;
use palpate::io;
use palpate::mesh::{Field, Location, MeshDescription, TetMesh};
use palpate::render::Image;
use palpate::scene::{PlannedRun, Scene, Stage};

const FRAMES: u32 = 6;

/// Returns a scene as the command line builds it if only the solver is given.
fn unprepared(drawn: bool, steps: u32) -> Scene {
    let mut scene = Scene::parse("mesh = {}\n[solver]\nname = \"implicit\"").unwrap();
    scene.solver.steps = Some(steps);
    scene.solver.run = Some(PlannedRun {
        steps,
        draws_frames: drawn,
    });
    scene.picture.size = Some([96, 72]);
    scene
}

fn touches_the_border(image: &Image) -> bool {
    let [width, height] = image.size;
    let lit = |x: u32, y: u32| image.pixel(x, y).iter().any(|v| *v > 0.0);
    (0..width).any(|x| lit(x, 0) || lit(x, height - 1))
        || (0..height).any(|y| lit(0, y) || lit(width - 1, y))
}

fn lit(image: &Image) -> usize {
    let pixels = image.values.chunks_exact(image.channels);
    pixels.filter(|p| p[3] > 0.02).count()
}

/// Simulates `mesh` and checks every frame. Returns its displacement relative to its diagonal.
fn gives_and_stays_in_the_picture(name: &str, mesh: TetMesh, size: [u32; 2]) -> f64 {
    let mut scene = unprepared(true, FRAMES);
    scene.picture.size = Some(size);
    let mut stage = Stage::with_mesh(&gpu(), &scene, mesh).unwrap();
    let said = stage.notes().join("\n");
    assert!(
        said.contains("clamped the") && said.contains("a load of"),
        "{name}: {said}"
    );
    let rest = stage.mesh().nodes.clone();
    let (low, high) = stage.mesh().bounds();
    let mut ratio = 0.0f64;
    for frame in 0..=FRAMES {
        if frame > 0 {
            stage.run(1, &mut |_| {}).unwrap();
        }
        let image = stage.image().unwrap();
        assert!(!touches_the_border(&image), "{name}, frame {frame}: {said}");
        let whole = (size[0] * size[1]) as usize;
        assert!(
            lit(&image) > whole / 50,
            "{name}, frame {frame}: {}",
            lit(&image)
        );
        let moved = stage.deformed_mesh().unwrap().nodes;
        let far = moved.iter().zip(&rest).map(|(x, r)| x.distance(*r));
        ratio = far.fold(0.0, f64::max) / (high - low).length();
    }
    println!("{name}: {ratio:.3} of the diagonal; {said}");
    assert!((0.03..0.3).contains(&ratio), "{name}: {ratio}; {said}");
    // A single picture of the end is framed for the end.
    stage.fit_view(&[]).unwrap();
    assert!(!touches_the_border(&stage.image().unwrap()), "{name}");
    ratio
}

/// Returns the tets of a block whose centroid is inside, as a mesh.
fn carved(cells: [usize; 3], size: DVec3, inside: impl Fn(DVec3) -> bool) -> TetMesh {
    let block = generate::bar(cells, size).unwrap();
    let tets = (0..block.tets.len())
        .filter(|t| inside(block.tet_nodes(*t).iter().sum::<DVec3>() / 4.0))
        .map(|t| block.tets[t])
        .collect();
    TetMesh::new(block.nodes, tets, Vec::new(), Vec::new()).unwrap()
}

#[test]
fn boot_is_clamped_at_flat_end() {
    let boot = carved([12, 6, 12], DVec3::new(12.0, 6.0, 12.0), |p| {
        p.z < 4.0 || p.x < 5.0
    });
    let ratio = gives_and_stays_in_the_picture("boot", boot, [96, 72]);
    assert!((ratio - 0.0879).abs() < 2e-3, "{ratio}");
}

#[test]
fn limb_is_clamped_at_thick_end() {
    let limb = carved([40, 4, 4], DVec3::new(10.0, 1.0, 1.0), |p| {
        (p.y - 0.5).abs().max((p.z - 0.5).abs()) < 0.15 + 0.35 * p.x / 10.0
    });
    let scene = unprepared(false, FRAMES);
    let stage = Stage::with_mesh(&gpu(), &scene, limb.clone()).unwrap();
    let said = stage.notes().join("\n");
    assert!(said.contains("highest 5 % of the x extent"), "{said}");
    let ratio = gives_and_stays_in_the_picture("limb", limb, [96, 72]);
    assert!((ratio - 0.0971).abs() < 2e-3, "{ratio}");
}

#[test]
fn ball_of_any_size_is_not_clamped_at_a_tip() {
    for radius in [0.001, 10.0] {
        let ball = generate::ball(radius, 5).unwrap();
        gives_and_stays_in_the_picture("ball", ball, [96, 72]);
    }
}

#[test]
fn explicit_settings_override_automatic_choices() {
    let bar = generate::paper_bar().unwrap();
    let mut scene = unprepared(true, 4);
    scene.solver.gravity = Some([0.0, 0.0, -3.0]);
    scene.solver.dt = Some(0.002);
    scene.camera.eye = Some([1.0, 2.0, 3.0]);
    let mut stage = Stage::with_mesh(&gpu(), &scene, bar).unwrap();
    stage.run(4, &mut |_| {}).unwrap();
    assert!((stage.time() - 0.008).abs() < 1e-12);
    stage.fit_view(&[]).unwrap();
    assert_eq!(stage.camera_mut().eye, DVec3::new(1.0, 2.0, 3.0));
    let said = stage.notes().join("\n");
    assert!(said.contains("gravity of 3.00 m/s²"), "{said}");
}

/// The report of `render` contains the reference scale of the motion.
#[test]
fn render_report_contains_bounds_diagonal() {
    let bar = generate::paper_bar().unwrap();
    let (low, high) = bar.bounds();
    let mut stage = Stage::with_mesh(&gpu(), &unprepared(false, 2), bar).unwrap();
    let report = stage.measure(1).unwrap();
    assert!((report.diagonal - (high - low).length()).abs() < 1e-12);
}

fn real(file: &str, size: [u32; 2]) {
    if let Some(path) = real_data(&format!("tet/{file}")) {
        gives_and_stays_in_the_picture(file, io::read(path).unwrap(), size);
    }
}

#[test]
#[ignore = "real data: scripts/test --full"]
fn real_boots_and_blobs_are_clamped_and_framed() {
    real("bullet_boot.vtk", [160, 120]);
    real("bullet_ditto.vtk", [160, 120]);
}

#[test]
#[ignore = "real data: scripts/test --full"]
fn real_liver_and_armadillo_are_clamped_and_framed() {
    real("gaia_liver.mesh", [160, 120]);
    real("polyfem_Armadillo13K.msh", [160, 120]);
}

#[test]
#[ignore = "real data: scripts/test --full"]
fn real_alligator_is_not_clamped_at_its_nose() {
    real("gaia_alligator.vtk", [160, 120]);
}

/// Writes a ball with a core: the core has the value 7, its surroundings 3.
fn cored(name: &str) -> TetMesh {
    let mut ball = generate::ball(1.0, 6).unwrap();
    let inside = |t: usize| ball.tet_nodes(t).iter().sum::<DVec3>().length() / 4.0 < 0.5;
    let values = (0..ball.tets.len())
        .map(|t| if inside(t) { 7.0 } else { 3.0 })
        .collect();
    let count = ball.tets.len();
    let mut cells = |name: &str, values: Vec<f64>| {
        ball.set_field(Field::scalar(name, Location::Cell, values))
            .unwrap();
    };
    cells("flat", vec![1.0; count]);
    cells("number", (0..count).map(|t| t as f64).collect());
    cells("stress", (0..count).map(|t| 0.5 + (t % 3) as f64).collect());
    cells(name, values);
    ball.region_names = [(7, "core".to_owned())].into();
    ball
}

#[test]
fn regions_have_distinct_colours_for_any_field_name() {
    for name in ["gmsh:physical", "part", "Region_Id", "anything"] {
        let mesh = cored(name);
        let info = MeshDescription::new(&mesh);
        assert_eq!(info.region_field.as_deref(), Some(name));
        assert_eq!(info.regions.len(), 2);
        let mut scene = Scene::parse("mesh = {}").unwrap();
        scene.picture.size = Some([64, 64]);
        let mut stage = Stage::with_mesh(&gpu(), &scene, mesh).unwrap();
        let said = stage.notes().join("\n");
        let legend = format!("regions of \"{name}\": 3 (#e69f00), 7 core (#56b4e9)");
        assert!(said.contains(&legend), "{said}");
        let image = stage.image().unwrap();
        // In the middle the blue core is visible through its orange surroundings.
        let (middle, rim) = (image.pixel(32, 32), image.pixel(32, 8));
        assert!(middle[2] > middle[0] * 0.9 && middle[0] > 0.2, "{middle:?}");
        assert!(rim[0] > 1.3 * rim[1] && rim[1] > 5.0 * rim[2], "{rim:?}");
    }
}

#[test]
fn explicit_field_overrides_region_colours() {
    let mut mesh = cored("part");
    let heat = mesh.nodes.iter().map(|p| p.x).collect();
    mesh.set_field(Field::scalar("heat", Location::Node, heat))
        .unwrap();
    let seen = |field: Option<&str>, transfer: Option<&str>| {
        let mut scene = Scene::parse("mesh = {}").unwrap();
        scene.picture.field = field.map(Into::into);
        scene.picture.transfer = transfer.map(Into::into);
        let stage = Stage::with_mesh(&gpu(), &scene, mesh.clone()).unwrap();
        (
            stage.scalar_field().name.clone(),
            stage.scalar_field().transfer.is_some(),
        )
    };
    assert_eq!(seen(None, None), ("part".into(), true));
    assert_eq!(seen(Some("heat"), None), ("heat".into(), false));
    assert_eq!(seen(Some("stress"), None), ("stress".into(), false));
    assert_eq!(seen(Some("part"), None), ("part".into(), true));
    // Through a user-defined transfer function the values themselves are visible.
    assert_eq!(seen(Some("part"), Some("viridis")), ("part".into(), false));
    assert_eq!(seen(None, Some("viridis")), ("heat".into(), false));
}

#[test]
#[ignore = "real data: scripts/test --full"]
fn three_real_materials_have_three_colours() {
    let Some(path) = real_data("tet/polyfem_cubes_v41.msh") else {
        return;
    };
    let mut scene = Scene::parse("mesh = {}").unwrap();
    scene.picture.size = Some([160, 120]);
    let mut stage = Stage::with_mesh(&gpu(), &scene, io::read(path).unwrap()).unwrap();
    assert!(
        stage
            .notes()
            .join("\n")
            .contains("regions of \"gmsh:physical\": 1 (#e69f00), 2 (#")
    );
    let image = stage.image().unwrap();
    let some = |like: &dyn Fn(&[f32]) -> bool| {
        let pixels = image.values.chunks_exact(4).filter(|p| like(p));
        pixels.count() > 100
    };
    assert!(some(&|p| p[0] > 0.4 && p[0] > 3.0 * p[2]), "orange");
    assert!(some(&|p| p[2] > 0.5 && p[2] > 1.5 * p[0]), "blue");
    assert!(some(&|p| p[1] > 0.3 && p[1] > 3.0 * p[0]), "green");
}
