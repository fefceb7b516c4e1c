//! The coefficient of friction of a tool from the markers that it drags along.

use super::*;

/// A block with a ball that dents it and is dragged over it.
const BLOCK: &str = "[mesh]\ngenerate = \"box\"\ntets = 800\n[material]\nyoung = 2e4\npoisson = 0.4\n\
    [solver]\nname = \"implicit\"\nengine = \"cpu\"\ndt = 0.05\n\
    [[pin]]\naxis = \"z\"\nbelow = 0.001\n\
    [[tool]]\nname = \"ball\"\nsphere = { radius = 0.03 }\nat = [0.035, 0.05, 0.131]\nfriction = 0.4\n\
    path = [[0.0, 0, 0, 0], [0.1, 0, 0, -0.009], [0.3, 0.03, 0, -0.009]]\n";
const MARKERS: [[f64; 3]; 2] = [[0.05, 0.05, 0.1], [0.06, 0.06, 0.1]];

/// Writes a take with these displacements at two times, m, and its recording.
fn record(folder: &std::path::Path, moved: &[f64]) -> std::path::PathBuf {
    let mut text = "time_s,a_x_m,a_y_m,a_z_m,b_x_m,b_y_m,b_z_m\n".to_owned();
    let rows = [(1.0, &[0.0; 6][..]), (1.2, &moved[..6]), (1.3, &moved[6..])];
    for (time, moved) in rows {
        let places = MARKERS.as_flattened().iter().zip(moved);
        let places = places.map(|(at, by)| format!(",{}", at + by));
        text += &format!("{time}{}\n", places.collect::<String>());
    }
    std::fs::write(folder.join("take.csv"), text).unwrap();
    let mut about = "takes = [\"take.csv\"]\nstraight = [0.9, 1.0]\nmotion = [1.2, 1.3]\naxes = [\"x\", \"y\", \"z\"]\n".to_owned();
    for (name, at) in ["a", "b"].iter().zip(MARKERS) {
        about += &format!("[[marker]]\nname = \"{name}\"\nat = {at:?}\n");
    }
    let file = folder.join("dragged.toml");
    std::fs::write(&file, about).unwrap();
    file
}

/// The coefficient of a twin on a finer mesh is found, and derivatives are those of central differences.
#[test]
#[ignore = "long: scripts/test --full"]
fn friction_of_twin_is_found() {
    const NAME: &str = "tool.ball.friction";
    let folder = tempfile::tempdir().unwrap();
    let gpu = gpu();
    let fine = BLOCK.replace("tets = 800", "tets = 1500");
    let template = Experiment::read(record(folder.path(), &[0.001; 12])).unwrap();
    let predicted = |text: &str, value: f64| {
        let scene = Scene::parse(text).unwrap();
        let body = MeasuredBody::new(&gpu, &scene, &template, &options(&[NAME])).unwrap();
        body.predict(&[value], &no_progress).unwrap()
    };
    let truth = predicted(&fine, 0.4);
    let data = Experiment::read(record(folder.path(), &truth.numbers)).unwrap();
    let first = BLOCK.replace("friction = 0.4", "friction = 0.15");
    let mut on_step = |step: &IdentifyStep| {
        println!("{step:?}");
        Ok(())
    };
    let scene = Scene::parse(&first).unwrap();
    let wanted = options(&[NAME]);
    let found = identify(&gpu, &scene, &data, &wanted, &mut on_step, &no_progress).unwrap();
    println!("{}", found.sentences.join("\n"));
    let own = &found.unknowns[0];
    assert!((own.value / 0.4 - 1.0).abs() < 0.2, "{own:?}");
    assert!(own.low < 0.4 && 0.4 < own.high, "{own:?}");
    let written = folder.path().join("identified.toml");
    let from = folder.path().join("first.toml");
    std::fs::write(&from, &first).unwrap();
    found.write(&from, &written).unwrap();
    let again = Scene::parse(&std::fs::read_to_string(&written).unwrap()).unwrap();
    assert!((again.tool_friction("ball").unwrap() / own.value - 1.0).abs() < 1e-6);

    let at = |by: f64| predicted(BLOCK, 0.4 + by).numbers;
    let (h, middle) = (0.002, predicted(BLOCK, 0.4));
    let [a, b, c, d] = [at(-2.0 * h), at(-h), at(h), at(2.0 * h)];
    let largest = middle.slopes.iter().map(|row| row[0].abs());
    let largest = largest.fold(0.0, f64::max);
    let error = |factor: f64| {
        let each = middle.slopes.iter().enumerate().map(|(i, row)| {
            let difference = (8.0 * (c[i] - b[i]) - (d[i] - a[i])) / (12.0 * h);
            (factor * row[0] - difference).abs() / largest
        });
        each.fold(0.0, f64::max)
    };
    println!("{:.1e}, {:.1e}", error(1.0), error(1.1));
    assert!(largest > 1e-4, "{largest}");
    // Forward differences of 2 %.
    assert!(error(1.0) < 0.04 && error(1.1) > 0.06);
}

/// Tools without a name or friction, and times before the start.
#[test]
fn unsuited_friction_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let file = record(folder.path(), &[0.001; 12]);
    let data = Experiment::read(&file).unwrap();
    let refused = |text: &str, name: &str| {
        let scene = Scene::parse(text).unwrap();
        let wanted = options(&[name]);
        let mut on_step = |_: &IdentifyStep| Ok(());
        let found = identify(&gpu(), &scene, &data, &wanted, &mut on_step, &no_progress);
        found.unwrap_err().to_string()
    };
    let why = refused(BLOCK, "tool.plate.friction");
    assert!(why.contains("it has ball"), "{why}");
    let smooth = BLOCK.replace("friction = 0.4\n", "");
    let why = refused(&smooth, "tool.ball.friction");
    assert!(why.contains("no friction to begin with"), "{why}");
    let text = std::fs::read_to_string(&file).unwrap();
    for (from, to, wanted) in [
        ("[1.2, 1.3]", "[0.5, 1.3]", "increasing times"),
        ("[1.2, 1.3]", "[1.2, 1.6]", "around 1.6 s"),
        ("motion =", "swing = \"a\"\nmotion =", "not both"),
    ] {
        std::fs::write(&file, text.replace(from, to)).unwrap();
        let why = Experiment::read(&file).and_then(|data| {
            let scene = Scene::parse(BLOCK).unwrap();
            MeasuredBody::new(&gpu(), &scene, &data, &options(&[])).map(drop)
        });
        let why = why.unwrap_err().to_string();
        assert!(why.contains(wanted), "{why}");
    }
}
