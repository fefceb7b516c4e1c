//! Tests of valid and invalid scenes.
#![allow(clippy::unwrap_used)]

use super::{Region, Scene, Unit};
use crate::generate;
use crate::mesh::{Field, Location, TetMesh, Topology};

#[test]
fn parse_error_reports_entry_and_line() {
    let error = Scene::parse("[mesh]\nfile = \"a.vtu\"\n[solver]\nnam = \"implicit\"\n");
    let text = error.unwrap_err().to_string();
    assert!(text.contains("line 4") && text.contains("nam"), "{text}");
    let error = Scene::parse("[mesh]\nfile = \"a.vtu\"\n[[force]]\ntotal = [0, 0, -1]\n");
    assert!(error.unwrap_err().to_string().contains("`on`"));
}

#[test]
fn unit_names_convert_to_metres() {
    let metres = |text: &str| Unit::Name(text.into()).metres();
    assert_eq!(metres("mm").unwrap(), 1e-3);
    assert_eq!(Unit::Metres(0.5).metres().unwrap(), 0.5);
    assert!(
        metres("furlong")
            .unwrap_err()
            .to_string()
            .contains("furlong")
    );
    assert!(Unit::Metres(-1.0).metres().is_err());
}

#[test]
fn region_selects_nodes_inside_its_bounds() {
    let bar = generate::paper_bar().unwrap();
    let nodes = |toml: &str| toml::from_str::<Region>(toml).unwrap().nodes(&bar);
    let (low, high) = bar.bounds();
    let end = nodes("axis = \"x\"\nbelow = 0.1").unwrap();
    assert_eq!(end.len(), 9);
    assert!(end.iter().all(|v| bar.nodes[*v as usize].x == low.x));
    let corner = format!("sphere = [{}, {}, {}, 1e-6]", high.x, high.y, high.z);
    assert_eq!(nodes(&corner).unwrap().len(), 1);
    let all = format!("box = [{:?}, {:?}]", high.to_array(), low.to_array());
    assert_eq!(nodes(&all).unwrap().len(), bar.nodes.len());
    for wrong in [
        "",
        "axis = \"x\"",
        "below = 0.5",
        "label = 3",
        "sphere = [9, 9, 9, 1]",
    ] {
        assert!(nodes(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn default_field_is_first_scalar_or_depth() {
    let mut bar = generate::paper_bar().unwrap();
    let seen = |bar: &TetMesh, field: Option<&str>| {
        let mut scene = Scene::default();
        scene.picture.field = field.map(Into::into);
        scene.scalar_field(bar, &Topology::new(bar))
    };
    let count = bar.nodes.len();
    let labels = (0..count).map(|i| i as f64).collect();
    bar.set_field(Field::scalar("medit:ref", Location::Node, labels))
        .unwrap();
    bar.set_field(Field::scalar("flat", Location::Node, vec![1.0; count]))
        .unwrap();
    let depth = seen(&bar, None).unwrap();
    assert!(depth.note.is_some() && depth.range.0 == 0.0 && depth.range.1 > 0.0);
    let heat = bar.nodes.iter().map(|p| 2.0 * p.x).collect();
    bar.set_field(Field::scalar("heat", Location::Node, heat))
        .unwrap();
    assert_eq!(seen(&bar, None).unwrap().name, "heat");
    // A cell field is displayed by the mean around each node.
    bar.set_field(Field::scalar(
        "tissue",
        Location::Cell,
        vec![3.0; bar.tets.len()],
    ))
    .unwrap();
    let tissue = seen(&bar, Some("tissue")).unwrap();
    assert!(tissue.values.iter().all(|v| (v - 3.0).abs() < 1e-12));
    let error = seen(&bar, Some("cold")).unwrap_err().to_string();
    assert!(error.contains("cold") && error.contains("heat"), "{error}");
}

/// A bar whose tets have the labels 1 (bone), 2 (knee cartilage) and 7 (no name) in turn.
fn labelled_bar() -> TetMesh {
    let mut bar = generate::paper_bar().unwrap();
    let labels = (0..bar.tets.len())
        .map(|t| [1.0, 2.0, 7.0][t % 3])
        .collect();
    bar.set_field(Field::scalar("label", Location::Cell, labels))
        .unwrap();
    bar.region_names = [
        (1, "Femur bone".to_owned()),
        (2, "knee cartilage".to_owned()),
    ]
    .into();
    bar
}

#[test]
fn tissues_set_region_materials() {
    let bar = labelled_bar();
    let material = |toml: &str| {
        let entry = Scene::parse(&format!("mesh = {{}}\n[material]\n{toml}"))?.material;
        entry.material(&bar, true)
    };
    let (made, notes) =
        material("bone = [1]\ncartilage = {}\nglue = { regions = [7], young = 5 }").unwrap();
    let stiffness = |label| made.regions[&label].stiffness;
    assert_eq!((stiffness(1), stiffness(2), stiffness(7)), (17e9, 6e5, 5.0));
    assert_eq!(made.regions[&1].density, 1920.0);
    assert!(
        notes.iter().any(|n| n.contains("Femur bone (1) is bone")),
        "{notes:?}"
    );
    let (made, _) = material(
        "young = 1e3\nmax_stiffness_ratio = 50\nbone = { regions = [\"femur bone\"], density = 9 }",
    )
    .unwrap();
    assert_eq!(
        (made.regions[&1].stiffness, made.regions[&1].density),
        (5e4, 9.0)
    );
    for (wrong, part) in [
        ("bone = 3", "`bone` is neither a key"),
        ("yuong = 3", "`yuong` is neither a key"),
        ("glue = [1]", "requires `young`"),
        ("liver = {}", "Femur bone, knee cartilage"),
        ("bone = [\"hip\"]", "Femur bone, knee cartilage"),
        ("bone = [1]\nfat = [1]", "two tissues"),
        ("bone = { regions = [1], mass = 2 }", "`bone`"),
        ("stiffness = 3\nbone = [1]", "not `stiffness`"),
        (
            "max_stiffness_ratio = 0.5\nbone = [1]",
            "max_stiffness_ratio",
        ),
    ] {
        let error = material(wrong).unwrap_err().to_string();
        assert!(error.contains(part), "{wrong}: {error}");
    }
    let pinned = toml::from_str::<Region>("label = \"femur bone\"").unwrap();
    let by_number = toml::from_str::<Region>("label = 1").unwrap();
    assert_eq!(pinned.nodes(&bar).unwrap(), by_number.nodes(&bar).unwrap());
}

#[test]
fn missing_values_are_left_out_of_the_range_and_noted() {
    let mut bar = generate::paper_bar().unwrap();
    let mut heat: Vec<f64> = bar.nodes.iter().map(|p| 2.0 * p.x).collect();
    let whole = heat.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    heat[3] = f64::NAN;
    bar.set_field(Field::scalar("heat", Location::Node, heat.clone()))
        .unwrap();
    let mut cells = vec![5.0; bar.tets.len()];
    cells[1] = f64::INFINITY;
    bar.set_field(Field::scalar("stress", Location::Cell, cells))
        .unwrap();
    let none = vec![f64::NAN; heat.len()];
    bar.set_field(Field::scalar("none", Location::Node, none))
        .unwrap();
    let seen = |field: &str| {
        let mut scene = Scene::default();
        scene.picture.field = Some(field.into());
        scene.scalar_field(&bar, &Topology::new(&bar))
    };
    let found = seen("heat").unwrap();
    assert!(found.values.iter().all(|v| v.is_finite()));
    assert!(found.range.1 <= whole);
    let note = found.note.unwrap();
    assert!(note.contains("\"heat\": the value at node 3"), "{note}");
    let stress = seen("stress").unwrap();
    // A constant field lies in the middle of a range of ±10 %.
    assert_eq!((stress.range, stress.values[0]), ((4.5, 5.5), 5.0));
    assert!(stress.note.unwrap().contains("tet 1"));
    let error = seen("none").unwrap_err().to_string();
    assert!(error.contains("must have finite values"), "{error}");
}

#[test]
fn region_bounds_use_mesh_unit() {
    let bar = generate::paper_bar().unwrap();
    let nodes = |toml: &str| {
        let scene = Scene::parse(&format!("[[pin]]\n{toml}")).unwrap();
        scene.pin[0].nodes(&bar)
    };
    let (low, high) = bar.bounds();
    let middle = 0.5 * (low + high);
    for (k, axis) in ["x", "y", "z"].iter().enumerate() {
        let below = nodes(&format!("{axis}_below = {}", middle[k])).unwrap();
        let above = nodes(&format!("{axis}_above = {}", middle[k])).unwrap();
        let at = |v: &u32| bar.nodes[*v as usize][k];
        assert!(below.iter().all(|v| at(v) <= middle[k]));
        assert!(above.iter().all(|v| at(v) >= middle[k]));
        let both = (0..bar.nodes.len() as u32).filter(|v| at(v) == middle[k]);
        assert_eq!(below.len() + above.len(), bar.nodes.len() + both.count());
        // Half of the extent is the same position.
        let part = nodes(&format!("axis = \"{axis}\"\nbelow = 0.5")).unwrap();
        assert_eq!(part, below);
    }
    let corner = format!("x_below = {}\nz_above = {}", low.x, high.z);
    assert!(nodes(&corner).unwrap().iter().all(|v| {
        let p = bar.nodes[*v as usize];
        p.x == low.x && p.z == high.z
    }));
    let said = nodes("axis = \"y\"\nabove = 0.5\nz_below = -0.6")
        .unwrap_err()
        .to_string();
    assert!(
        said.contains("{ axis = \"y\", above = 0.5, z_below = -0.6 }"),
        "{said}"
    );
    let said = nodes("label = \"hip\"\nbox = [[0, 0, 0], [1, 1, 1]]")
        .unwrap_err()
        .to_string();
    assert!(said.contains("hip"), "{said}");
    // Regions created by code are checked as well.
    let made = Region {
        axis: Some(super::region::Axis::Z),
        below: Some(-0.6),
        ..Region::default()
    };
    assert!(
        made.nodes(&bar)
            .unwrap_err()
            .to_string()
            .contains("z_below")
    );
}

#[test]
fn scene_hash_covers_scan_files_and_not_their_folders() {
    let root = tempfile::tempdir().unwrap();
    let write = |folder: &str, name: &str, text: &str| {
        let folder = root.path().join(folder);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(name), text).unwrap();
        folder
    };
    let hash = |folder: &std::path::Path, scan: &str| {
        let text = format!("[scan]\nfile = \"{scan}\"\ntransfer = \"t.json\"\n");
        super::scene_hash(&Scene::parse_in(&text, folder).unwrap())
    };
    let one = write("one", "a.nrrd", "scan");
    let two = write("two", "a.nrrd", "scan");
    write("one", "t.json", "transfer");
    write("two", "t.json", "transfer");
    assert_eq!(hash(&one, "a.nrrd"), hash(&two, "a.nrrd"));
    write("two", "a.nrrd", "other scan");
    assert_ne!(hash(&one, "a.nrrd"), hash(&two, "a.nrrd"));
    write("two", "a.nrrd", "scan");
    write("two", "t.json", "other transfer");
    assert_ne!(hash(&one, "a.nrrd"), hash(&two, "a.nrrd"));
    // A folder of slices.
    write("one/slices", "1.dcm", "slice");
    write("two/slices", "1.dcm", "slice");
    write("two", "t.json", "transfer");
    assert_eq!(hash(&one, "slices"), hash(&two, "slices"));
    write("two/slices", "1.dcm", "other slice");
    assert_ne!(hash(&one, "slices"), hash(&two, "slices"));
}
