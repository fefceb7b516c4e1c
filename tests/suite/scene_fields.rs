//! Computed fields of a moving body: rendering by name, and output.

use crate::stages::{refused_scene as refused, run};
use crate::support::gpu;
use palpate::gpu::Gpu;
use palpate::mesh::{Field, Location};
use palpate::physics::MaterialModel;
use palpate::scene::{Scene, Stage};

/// Returns a bar of 0.12 m that hangs from its end at x = 0.
fn scene(field: &str, more: &str) -> Scene {
    let text = format!(
        r#"
[mesh]
generate = "bar"
tets = 320
[material]
model = "neo-hookean"
young = 2e4
poisson = 0.3
[solver]
name = "implicit"
engine = "cpu"
dt = 0.02
gravity = [9.81, 0, 0]
[[pin]]
axis = "x"
below = 0.01
[picture]
field = "{field}"
size = [48, 36]
{more}
"#
    );
    Scene::parse(&text).unwrap()
}

fn values<'a>(fields: &'a [Field], name: &str, at: Location) -> &'a [f64] {
    let found = fields.iter().find(|f| f.name == name && f.location == at);
    &found.unwrap_or_else(|| panic!("no {name}")).values
}

#[test]
fn stress_field_is_rendered_over_its_observed_range() {
    let mut stage = Stage::new(&gpu(), &scene("von_mises", "")).unwrap();
    assert!(stage.notes().iter().any(|n| n.contains("--range")));
    let rest = stage.image().unwrap();
    assert!(stage.scalar_field().values.iter().all(|s| s.abs() < 1e-6));
    run(&mut stage, 60);
    let loaded = stage.image().unwrap();
    assert!(rest.values != loaded.values);
    let (low, high) = stage.scalar_field().range;
    let most = stage
        .scalar_field()
        .values
        .iter()
        .copied()
        .fold(0.0, f64::max);
    assert!(
        low.abs() < 1e-6 && high == most && high > 500.0,
        "{low} {high}"
    );
    let told = stage.field_note().unwrap();
    assert!(
        told.contains("von_mises") && told.contains("--range"),
        "{told}"
    );
    // The weight of the bar at its end: ρ g L, in tension along x; averaged over the nodes there,
    // whose tets extend one cell into the bar.
    let stress = Stage::new(&gpu(), &scene("stress_1", "")).map(|mut stage| {
        run(&mut stage, 60);
        stage.image().unwrap();
        let (mesh, field) = (stage.mesh().clone(), stage.scalar_field().clone());
        let ends = (0..mesh.nodes.len()).filter(|i| mesh.nodes[*i].x < 1e-6);
        let ends: Vec<f64> = ends.map(|i| field.values[i]).collect();
        ends.iter().sum::<f64>() / ends.len() as f64
    });
    let (stress, weight) = (stress.unwrap(), 1060.0 * 9.81 * 0.12);
    let share = stress / weight;
    assert!((share - 1.0379).abs() < 2e-3, "{share}");
}

#[test]
fn scene_range_overrides_observed_range() {
    let picture = |more: &str| {
        let mut stage = Stage::new(&gpu(), &scene("von_mises", more)).unwrap();
        run(&mut stage, 20);
        let image = stage.image().unwrap();
        (image, stage.scalar_field().range)
    };
    let (wide, range) = picture("range = [0.0, 5000.0]");
    assert_eq!(range, (0.0, 5000.0));
    let (narrow, _) = picture("range = [0.0, 500.0]");
    assert!(wide.values != narrow.values);
    // With the range found, the picture is the same.
    let (found, (low, high)) = picture("");
    let (again, _) = picture(&format!("range = [{low:?}, {high:?}]"));
    assert!(found.values == again.values);
    let wrong = refused(&scene("von_mises", "range = [2.0, 1.0]"));
    assert!(wrong.contains("2 to 1"), "{wrong}");
}

#[test]
fn computed_fields_match_across_engines_and_surface() {
    let seen = |engine: &str, mode: &str| {
        let mut scene = scene("J", &format!("mode = \"{mode}\""));
        scene.solver.engine = Some(engine.parse().unwrap());
        scene.solver.tolerance = Some(1e-6);
        let mut stage = Stage::new(&gpu(), &scene).unwrap();
        run(&mut stage, 60);
        stage.image().unwrap();
        stage.scalar_field().values.clone()
    };
    let (cpu, gpu) = (seen("cpu", "surface"), seen("gpu", "composite"));
    let off = cpu.iter().zip(&gpu).map(|(a, b)| (a - b).abs());
    let off = off.fold(0.0, f64::max);
    let most = cpu.iter().map(|j| (j - 1.0).abs()).fold(0.0, f64::max);
    assert!(most > 0.01 && off < 0.02 * most, "{most} {off}");
}

#[test]
fn computed_field_costs_nothing_when_unused() {
    let gpu = Gpu::new().unwrap();
    let readbacks = |field: Option<&str>| {
        let mut scene = scene("", "");
        scene.picture.field = field.map(Into::into);
        scene.solver.engine = Some("gpu".parse().unwrap());
        let mut stage = Stage::new(&gpu, &scene).unwrap();
        run(&mut stage, 2);
        let target = gpu
            .target(
                "picture",
                [48, 36],
                palpate::wgpu::TextureFormat::Rgba32Float,
                palpate::wgpu::TextureUsages::RENDER_ATTACHMENT
                    | palpate::wgpu::TextureUsages::TEXTURE_BINDING,
            )
            .unwrap();
        let before = gpu.readbacks();
        for _ in 0..3 {
            let mut work = gpu.start_recording();
            stage.record(&mut work, &target).unwrap();
            work.submit().unwrap();
        }
        gpu.readbacks() - before
    };
    // Once for three pictures of a body at rest.
    assert_eq!(readbacks(Some("von_mises")), 1);
    assert_eq!(readbacks(None), 0);
}

#[test]
fn output_fields_are_written() {
    let more = "[output]\nfields = [\"von_mises\", \"J@nodes\", \"J\", \"displacement\"]";
    let mut stage = Stage::new(&gpu(), &scene("strain", more)).unwrap();
    run(&mut stage, 30);
    let mesh = stage.deformed_mesh().unwrap();
    let (cells, nodes) = (mesh.tets.len(), mesh.nodes.len());
    assert_eq!(
        values(&mesh.fields, "von_mises", Location::Cell).len(),
        cells
    );
    assert_eq!(values(&mesh.fields, "J", Location::Node).len(), nodes);
    let moved = values(&mesh.fields, "displacement", Location::Node);
    assert_eq!(moved.len(), 3 * nodes);
    // J is the ratio of volume to rest volume.
    let rest = stage.mesh();
    for (t, j) in values(&mesh.fields, "J", Location::Cell).iter().enumerate() {
        assert!((mesh.tet_volume(t) / rest.tet_volume(t) - j).abs() < 1e-9);
    }
    let none = Stage::new(&gpu(), &scene("strain", "")).unwrap();
    let mesh = none.deformed_mesh().unwrap();
    assert!(mesh.field("von_mises", Location::Cell).is_none());
}

#[test]
fn computed_field_rejects_unsupported_bodies() {
    let mut springs = scene("von_mises", "");
    springs.material.model = Some(MaterialModel::Springs);
    let said = refused(&springs);
    assert!(
        said.contains("springs") && said.contains("--material neo-hookean"),
        "{said}"
    );
    for of_shape in ["displacement", "strain", "J"] {
        springs.picture.field = Some(of_shape.into());
        let mut stage = Stage::new(&gpu(), &springs).unwrap();
        run(&mut stage, 5);
        stage.image().unwrap();
        let (low, high) = stage.scalar_field().range;
        assert!(high - low > 1e-4, "{of_shape}: {low} {high}");
    }
    springs.picture.field = None;
    springs.output.fields = vec!["energy_density".into()];
    assert!(refused(&springs).contains("--material neo-hookean"));
    springs.output.fields = vec!["tension".into()];
    assert!(refused(&springs).contains("von_mises"));
    let mut still = scene("von_mises", "");
    still.solver.name = None;
    let said = refused(&still);
    assert!(said.contains("--solver implicit"), "{said}");
    still.picture.field = None;
    still.output.fields = vec!["J".into()];
    assert!(refused(&still).contains("--solver implicit"));
    let mut caged = scene("von_mises", "[cage]\nnodes = 40");
    let said = refused(&caged);
    assert!(said.contains("cage"), "{said}");
    caged.picture.field = Some("J".into());
    let mut stage = Stage::new(&gpu(), &caged).unwrap();
    run(&mut stage, 5);
    stage.image().unwrap();
}

#[test]
fn bodies_share_one_field() {
    let text = r#"
[solver]
name = "implicit"
engine = "cpu"
dt = 0.01
gravity = [0, 0, -9.81]
[material]
model = "neo-hookean"
young = 1e4
[[body]]
mesh = { generate = "bar", tets = 80 }
[[body.pin]]
axis = "x"
below = 0.01
[[body]]
name = "stiff"
mesh = { generate = "bar", tets = 80 }
offset = [0.0, 0.2, 0.0]
material = { model = "corotated", young = 1e7 }
[[body.pin]]
axis = "x"
below = 0.01
[picture]
field = "strain"
size = [48, 36]
"#;
    let mut stage = Stage::new(&gpu(), &Scene::parse(text).unwrap()).unwrap();
    run(&mut stage, 30);
    stage.image().unwrap();
    let values = &stage.scalar_field().values;
    let half = values.len() / 2;
    let most = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let (soft, stiff) = (most(&values[..half]), most(&values[half..]));
    assert!(soft > 100.0 * stiff && stiff > 0.0, "{soft} {stiff}");
    let springs = text.replace(
        "material = { model = \"corotated\", young = 1e7 }",
        "material = { model = \"springs\", young = 1e7 }",
    );
    let mut springs = Scene::parse(&springs).unwrap();
    springs.picture.field = Some("stress_1".into());
    let said = refused(&springs);
    assert!(
        said.contains("\"stiff\"") && said.contains("springs"),
        "{said}"
    );
}
