//! Displacements, reactions and volumes of a body at rest.

use super::*;
use crate::physics::{Capability, Quantity};

/// The hanging beam under a pressure on its upper side, whose gravity leans.
const LEANING: &str = "[mesh]\ngenerate = \"bar\"\ntets = 300\n[material]\nmodel = \"neo-hookean\"\n\
    young = 1e5\npoisson = 0.4\ndensity = 1000\norder = 1\n[solver]\nname = \"implicit\"\nengine = \"cpu\"\n\
    tolerance = 1e-10\ngravity = [0.0, 2.0, -9.0]\n[[pin]]\naxis = \"x\"\nbelow = 0.001\n\
    [[pressure]]\nnormal = [0.0, 0.0, 1.0]\npressure = 300.0\n";

/// Writes the measurements at rest of a scene: the displacements at all nodes, the reaction of its wall and its
/// volume.
fn measure_at_rest(folder: &std::path::Path, scene: &Scene) -> std::path::PathBuf {
    let gpu = gpu();
    let mut stage = crate::scene::Stage::new(&gpu, scene).unwrap();
    let mut mesh = stage.mesh().clone();
    let motion = stage.motion_mut().unwrap();
    motion.set_sleep_allowed(false);
    motion.dt = 100.0;
    let gradients = motion.simulator.gradients();
    let gradients = Capability::Gradients.require(gradients).unwrap();
    gradients.use_double_precision().unwrap();
    motion.run(40, &mut |_| {}).unwrap();
    let wall = Quantity::PinReaction {
        nodes: scene.pin[0].nodes(&mesh).unwrap(),
        direction: DVec3::NEG_Z,
    };
    let gradients = Capability::Gradients.require(motion.simulator.gradients());
    let reaction = gradients.unwrap().gradient(&wall, &[]).unwrap().value;
    let at = motion.positions().unwrap();
    let moved = at
        .iter()
        .zip(&mesh.nodes)
        .flat_map(|(x, p)| (*x - *p).to_array());
    mesh.fields.push(crate::mesh::Field {
        components: 3,
        values: moved.collect(),
        ..crate::mesh::Field::scalar("u", crate::mesh::Location::Node, Vec::new())
    });
    crate::io::write(folder.join("bent.vtu"), &mesh).unwrap();
    let file = folder.join("rest.toml");
    let text = format!(
        "[displacements]\nfile = \"bent.vtu\"\nfield = \"u\"\npoints = 9\n\
         [[reaction]]\non = {{ axis = \"x\", below = 0.001 }}\ndirection = [0, 0, -1]\nnewton = {reaction}\n"
    );
    std::fs::write(&file, text).unwrap();
    file
}

/// Returns a NIfTI file of 2 × 2 × 2 vectors (1, 2, 3) mm along the axes of LPS, with voxels of 30 mm from
/// (30, 10, 10) mm on.
fn vectors_in_lps() -> Vec<u8> {
    let mut bytes = vec![0u8; 352];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, &348i32.to_le_bytes());
    for (k, n) in [5i16, 2, 2, 2, 1, 3, 1, 1].iter().enumerate() {
        put(40 + 2 * k, &n.to_le_bytes());
    }
    put(68, &1007i16.to_le_bytes());
    put(70, &16i16.to_le_bytes());
    put(72, &32i16.to_le_bytes());
    for (k, x) in [1.0f32, 30.0, 30.0, 30.0, 1.0, 1.0, 1.0, 1.0]
        .iter()
        .enumerate()
    {
        put(76 + 4 * k, &x.to_le_bytes());
    }
    put(108, &352f32.to_le_bytes());
    put(123, &[2]);
    put(254, &1i16.to_le_bytes());
    for (row, place) in [30.0f32, 10.0, 10.0].iter().enumerate() {
        put(280 + 16 * row + 4 * row, &30f32.to_le_bytes());
        put(280 + 16 * row + 12, &place.to_le_bytes());
    }
    put(344, b"n+1\0");
    for component in [1.0f32, 2.0, 3.0] {
        bytes.extend((0..8).flat_map(|_| component.to_le_bytes()));
    }
    bytes
}

const NAMES: [&str; 3] = ["material.young", "gravity.y", "pressure.1"];

/// The hanging beam with other values of these.
fn first_guess() -> Scene {
    let first = LEANING.replace("young = 1e5", "young = 7e4");
    let first = first.replace("[0.0, 2.0, -9.0]", "[0.0, 0.0, -9.0]");
    Scene::parse(&first.replace("pressure = 300.0", "pressure = 150.0")).unwrap()
}

/// Modulus, gravity and pressure from displacements and a reaction at rest; derivatives against differences.
#[test]
fn measurements_at_rest_are_explained() {
    let folder = tempfile::tempdir().unwrap();
    let truth = Scene::parse(LEANING).unwrap();
    let file = measure_at_rest(folder.path(), &truth);
    let data = Experiment::read(&file).unwrap();
    let scene = first_guess();
    let gpu = gpu();
    let body = MeasuredBody::new(&gpu, &scene, &data, &options(&NAMES)).unwrap();
    let values = [9e4, 1.5, 200.0];
    let own = body.predict(&values, &no_progress).unwrap();
    for (k, value) in values.into_iter().enumerate() {
        let at = |by: f64| {
            let mut other = values;
            other[k] += by * value;
            body.predict(&other, &no_progress).unwrap().numbers
        };
        // Pressures follow the faces from step to step, and end at rest with fewer digits.
        let (low, high) = (at(-5e-3), at(5e-3));
        // Over each number: displacements and a force.
        let rows = own
            .slopes
            .iter()
            .zip(low.iter().zip(&high))
            .zip(body.observations());
        let off = rows.map(|((row, (low, high)), observed)| {
            (row[k] * value - (high - low) / 1e-2).abs() / observed.scale
        });
        let worst = off.fold(0.0, f64::max);
        println!("{}: {worst:.1e}", NAMES[k]);
        assert!(worst < 1e-4, "{}: {worst}", NAMES[k]);
    }
    let found = identify(
        &gpu,
        &scene,
        &data,
        &options(&NAMES),
        &mut |_| Ok(()),
        &no_progress,
    )
    .unwrap();
    println!("{}", found.sentences.join("\n"));
    assert_eq!(found.residuals.len(), 9 * 3 + 1);
    for (value, truth) in found.unknowns.iter().zip([1e5, 2.0, 300.0]) {
        assert!(
            (value.value / truth - 1.0).abs() < 5e-3,
            "{value:?} {truth}"
        );
    }
}

/// Displacements of a NIfTI file, and files that are wrong.
#[test]
fn files_of_displacements_are_read_or_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let file = measure_at_rest(folder.path(), &Scene::parse(LEANING).unwrap());
    let scene = first_guess();
    let gpu = gpu();
    // The file by itself, whose field has another name.
    let why = Experiment::read(folder.path().join("bent.vtu")).and_then(|data| {
        identify(
            &gpu,
            &scene,
            &data,
            &options(&NAMES),
            &mut |_| Ok(()),
            &no_progress,
        )
    });
    let why = why.unwrap_err().to_string();
    assert!(why.contains("no vectors \"displacement\""), "{why}");
    let text = std::fs::read_to_string(&file).unwrap();
    let volume = folder.path().join("moved.nii");
    std::fs::write(&volume, vectors_in_lps()).unwrap();
    let here = text
        .replace("bent.vtu", "moved.nii")
        .replace("field = \"u\"\n", "");
    std::fs::write(&file, here).unwrap();
    let data = Experiment::read(&file).unwrap();
    let body = MeasuredBody::new(&gpu, &scene, &data, &options(&NAMES)).unwrap();
    let observed = body.observations();
    assert_eq!(observed.len(), 8 * 3 + 1);
    let (at, moved) = (observed[0].at, [0, 1, 2].map(|k| observed[k].value));
    assert!(at.distance(DVec3::new(0.03, 0.01, 0.01)) < 1e-9, "{at}");
    assert!(DVec3::from(moved).distance(DVec3::new(-1e-3, -2e-3, 3e-3)) < 1e-9);
    for (what, with, expected) in [
        ("newton = ", "newton = nan # ", "needs a finite force"),
        ("points = 9", "points = 9\nmoved = 3", "invalid type"),
        ("bent.vtu", "none.vtu", "none.vtu"),
    ] {
        assert!(text.contains(what));
        std::fs::write(&file, text.replace(what, with)).unwrap();
        let why = Experiment::read(&file).and_then(|data| {
            identify(
                &gpu,
                &scene,
                &data,
                &options(&NAMES),
                &mut |_| Ok(()),
                &no_progress,
            )
        });
        let why = why.unwrap_err().to_string();
        assert!(why.contains(expected), "{why}");
    }
}

/// A stiff end is found on a grid from displacements, in both priors.
#[test]
fn varying_stiffness_of_twin_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let stiff_end = |p: DVec3| match p.x < 0.06 {
        true => 3.0,
        false => 1.0,
    };
    let bar = LEANING.replace("tets = 300", "tets = 500");
    let mut scene = Scene::parse(&bar).unwrap();
    let gpu = gpu();
    let plain = crate::scene::Stage::new(&gpu, &scene)
        .unwrap()
        .mesh()
        .clone();
    let mut mesh = plain.clone();
    let middles = mesh
        .tets
        .iter()
        .map(|tet| stiff_end(tet.iter().map(|v| mesh.nodes[*v as usize]).sum::<DVec3>() / 4.0));
    let values = middles.collect();
    mesh.fields.push(crate::mesh::Field::scalar(
        "factor",
        crate::mesh::Location::Cell,
        values,
    ));
    let file = folder.path().join("truth.vtu");
    crate::io::write(&file, &mesh).unwrap();
    let own = bar.replace(
        "generate = \"bar\"\ntets = 500",
        &format!("file = {:?}", file.display().to_string()),
    );
    let own = own.replace("[material]", "[material]\nstiffness_field = \"factor\"");
    let data = measure_at_rest(folder.path(), &Scene::parse(&own).unwrap());
    let text = std::fs::read_to_string(&data).unwrap();
    std::fs::write(&data, text.replace("points = 9", "points = 20")).unwrap();
    let data = Experiment::read(&data).unwrap();
    scene.material.young = Some(1e5);
    for name in ["stiffness:cage:30mm", "stiffness:cage:30mm:piecewise"] {
        let found = identify(
            &gpu,
            &scene,
            &data,
            &options(&[name]),
            &mut |step| {
                println!("{} {:.3}", step.step, step.misfit);
                Ok(())
            },
            &no_progress,
        )
        .unwrap();
        println!("{}", found.sentences.join("\n"));
        assert!(found.misfit < 1.5 && found.converged, "{}", found.misfit);
        let mean = |is_far: bool| {
            let own = found.stiffness.iter().filter(|one| match is_far {
                true => one.at[0] > 0.07,
                false => one.at[0] < 0.05,
            });
            let all: Vec<f64> = own.map(|one| one.factor.ln()).collect();
            assert!(!all.is_empty());
            (all.iter().sum::<f64>() / all.len() as f64).exp()
        };
        let (near, far) = (mean(false), mean(true));
        println!("{name}: {near:.2} {far:.2}");
        assert!((2.2..3.8).contains(&near) && (0.6..0.6 * near).contains(&far));
        let mesh = found.mesh_with_field().unwrap();
        for name in [stiffness_grid::FACTOR_FIELD, stiffness_grid::SPREAD_FIELD] {
            let field = mesh.field(name, crate::mesh::Location::Cell).unwrap();
            assert!(field.values.iter().all(|x| *x > 0.0));
        }
    }
    let wanted = IdentifyOptions {
        noise: None,
        ..options(&["stiffness:cage:30mm"])
    };
    let why = identify(&gpu, &scene, &data, &wanted, &mut |_| Ok(()), &no_progress);
    assert!(why.unwrap_err().to_string().contains("--noise"));
}
