//! Transfer functions per region, against the float64 reference.

use crate::render::common::*;
use crate::render::planes::{Seen, bent, insides};
use glam::DVec3;
use palpate::generate;
use palpate::mesh::{Field, Location, TetMesh};
use palpate::render::*;
use palpate::scene::{Scene, Stage};

/// Returns appearances of four regions: default, one colour, another preset, and hidden.
fn looks(mesh: &TetMesh) -> RegionAppearance {
    let preset = |name| TransferFunction::preset(name).unwrap();
    let (low, high) = mesh.bounds();
    let size = high - low;
    let of_tet = |t: usize| {
        let middle = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
        let u = (middle - low) / size;
        match (u.x + 0.3 * u.y, u.z) {
            (x, z) if x < 0.4 && z < 0.6 => Some(1),
            (x, _) if x < 0.7 => Some(0),
            (_, z) if z < 0.5 => None,
            _ => Some(2),
        }
    };
    RegionAppearance {
        transfers: vec![
            preset("viridis"),
            preset("viridis")
                .with_colour([0.9, 0.5, 0.3])
                .with_constant_extinction(2.0 / size.x, size.x),
            preset("bone").scale_extinction(3.0),
        ],
        tet_regions: (0..mesh.tets.len()).map(of_tet).collect(),
    }
}

#[test]
fn regions_match_float64() {
    let gpu = gpu();
    let round = generate::Bore::Round;
    let bodies = [
        (
            "duct",
            generate::duct([6, 6, 6], DVec3::ONE, round).unwrap(),
        ),
        ("limb", generate::by_name("limb", Some(2_000)).unwrap()),
        ("foot", generate::by_name("foot", Some(5_000)).unwrap()),
    ];
    for (name, mesh) in &bodies {
        let outside = Camera::fit_mesh(mesh);
        let mut within = outside;
        within.eye = mesh.tet_nodes(mesh.tets.len() / 2).iter().sum::<DVec3>() / 4.0;
        for (walk, light, camera, positions) in [
            (Traversal::Vertices, Light::Head, outside, bent(mesh)),
            (Traversal::Planes, Light::None, outside, mesh.nodes.clone()),
            (Traversal::Planes, Light::Head, within, bent(mesh)),
        ] {
            let mut seen = Seen::new(&gpu, mesh, &positions, walk, light);
            let all = insides(mesh, &seen.scalars.clone());
            let plain = seen
                .caster
                .image(&camera, [64, 64], Mode::Composite)
                .unwrap();
            seen.look(looks(mesh));
            for (what, inside) in [&all[0], &all[all.len() - 1]] {
                let (far, rms, image) = seen.compare(&camera, inside);
                println!("{name} {walk:?} {light:?} {what}: rms {rms:.3}, far {far:.4}");
                keep(&image, &format!("regions_{name}_{walk:?}_{what}.png"));
                // Faces of a hidden region are silhouettes.
                assert!(
                    rms < 0.5 && far < 0.01,
                    "{name} {walk:?} {what}: {rms} {far}"
                );
                let changed = image.values.iter().zip(&plain.values);
                let changed: f64 = changed.map(|(a, b)| f64::from((a - b).abs())).sum();
                // An eye inside may see little except its own region.
                let from_inside = camera == within;
                assert!(
                    from_inside || changed / image.values.len() as f64 > 0.003,
                    "{name} {what} {changed}"
                );
            }
            if camera == within {
                continue;
            }
            // Another hidden region is detected.
            let mut other = looks(mesh);
            for look in &mut other.tet_regions {
                *look = look.map_or(Some(1), |k| (k != 1).then_some(k));
            }
            seen.caster.set_regions(Some(&other)).unwrap();
            let (far, rms, _) = seen.compare(&camera, &all[0].1);
            assert!(far > 0.05 || rms > 1.0, "{name}: {far} {rms}");
        }
    }
}

#[test]
fn projections_skip_hidden_regions() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(6, false).unwrap();
    let mut seen = Seen::new(&gpu, &mesh, &mesh.nodes, Traversal::Vertices, Light::None);
    let camera = peers_camera();
    let looks = RegionAppearance {
        transfers: vec![TransferFunction::preset("viridis").unwrap()],
        tet_regions: vec![None; mesh.tets.len()],
    };
    seen.caster.set_regions(Some(&looks)).unwrap();
    for mode in [Mode::Composite, Mode::Maximum, Mode::Mean, Mode::Thickness] {
        let image = seen.caster.image(&camera, [32, 32], mode).unwrap();
        assert!(image.values.iter().all(|v| *v == 0.0), "{mode:?}");
    }
    seen.caster.set_regions(None).unwrap();
    let image = seen
        .caster
        .image(&camera, [32, 32], Mode::Composite)
        .unwrap();
    assert!(image.values.iter().any(|v| *v > 0.1));
}

#[test]
fn rejects_invalid_regions() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(3, false).unwrap();
    let mut seen = Seen::new(&gpu, &mesh, &mesh.nodes, Traversal::Vertices, Light::None);
    let own = looks(&mesh);
    let mut error_of = |looks: &RegionAppearance| {
        seen.caster
            .set_regions(Some(looks))
            .unwrap_err()
            .to_string()
    };
    let few = RegionAppearance {
        tet_regions: vec![Some(0); 5],
        ..own.clone()
    };
    assert!(error_of(&few).contains("one entry per tet, got 5"));
    let none = RegionAppearance {
        transfers: Vec::new(),
        ..own.clone()
    };
    assert!(error_of(&none).contains("transfer functions of the regions must be 1 to 1024, got 0"));
    let beyond = RegionAppearance {
        tet_regions: vec![Some(9); mesh.tets.len()],
        ..own.clone()
    };
    assert!(error_of(&beyond).contains("got 9"));
    let sliced = RaycastOptions {
        table: TableKind::Sliced,
        ..RaycastOptions::default()
    };
    seen.caster.set_options(sliced).unwrap();
    let error = seen.caster.set_regions(Some(&own)).unwrap_err().to_string();
    assert!(error.contains("table of integrals"), "{error}");
}

#[test]
fn scene_sets_region_appearance() {
    let gpu = gpu();
    let mut mesh = generate::benchmark_cube(5, false).unwrap();
    let half = |t: usize| f64::from(u8::from(mesh.tet_nodes(t).iter().sum::<DVec3>().x > 2.0));
    let labels: Vec<f64> = (0..mesh.tets.len()).map(|t| 1.0 + half(t)).collect();
    mesh.fields
        .push(Field::scalar("label", Location::Cell, labels));
    mesh.region_names.insert(2, "bone".into());
    let image = |picture: &str| {
        let text = format!(
            "[mesh]\nfile = \"cube.vtu\"\n[light]\nfrom = \"none\"\n[picture]\nsize = [48, 48]\n{picture}"
        );
        let scene = Scene::parse(&text)?;
        Stage::with_mesh(&gpu, &scene, mesh.clone())?.image()
    };
    let seen = |image: &Image, red: bool| {
        let count = image
            .values
            .chunks(4)
            .filter(|p| (p[3] > 0.05) && ((p[0] > 4.0 * p[1].max(p[2])) == red));
        count.count()
    };
    let red = image("[picture.region.bone]\ncolour = \"#ff0000\"\n").unwrap();
    assert!(seen(&red, true) > 100, "{}", seen(&red, true));
    let hidden = image("hide = [\"bone\"]\n[picture.region.1]\ncolour = \"red\"\n").unwrap();
    assert!(seen(&hidden, true) > 100 && seen(&hidden, false) == 0);
    let hiding = |opacity: f64| {
        let bone = format!("[picture.region.bone]\ncolour = \"red\"\nopacity = {opacity}\n");
        image(&format!("hide = [\"1\"]\n{bone}")).unwrap()
    };
    // Each opacity is that of the same length, so depths of all rays have one ratio.
    let depths = |image: Image| -> Vec<f64> {
        let opacities = image.values.into_iter().skip(3).step_by(4);
        opacities.map(|a| -(1.0 - f64::from(a)).ln()).collect()
    };
    let (faint, dense) = (depths(hiding(0.1)), depths(hiding(0.5)));
    let crossed = faint.iter().zip(&dense).filter(|(_, dense)| **dense > 0.1);
    let ratios: Vec<f64> = crossed.map(|(faint, dense)| faint / dense).collect();
    let expected = 0.9f64.ln() / 0.5f64.ln();
    assert!(ratios.len() > 100, "{}", ratios.len());
    for ratio in ratios {
        assert!((ratio / expected - 1.0).abs() < 2e-3, "{ratio} {expected}");
    }
    for (picture, expected) in [
        ("hide = [\"heart\"]", "heart"),
        ("hide = [\"7\"]", "region 7 has no tets"),
        (
            "[picture.region.bone]
opacity = 2",
            "got 2",
        ),
        (
            "[picture.region.bone]
colour = \"reddish\"",
            "unknown colour",
        ),
        ("[picture.region.bone]\nshown = true", "unknown field"),
    ] {
        let error = image(picture).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}
