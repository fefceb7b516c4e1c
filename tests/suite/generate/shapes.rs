//! Generated meshes: counts, volumes, Euler numbers, determinism.

use crate::mesh::support::check_generated;
use glam::{DMat3, DVec3};
use palpate::generate::{
    Bore, GENERATORS, Lump, Split, ball, bar_of_about, benchmark_cube, box_mesh, breast, by_name,
    duct, liver, paper_bar,
};
use palpate::mesh::{Location, QualityReport, TetMesh, Topology, point_triangle_distance};

#[test]
fn boxes_have_expected_volume_and_counts() {
    let size = DVec3::new(3.0, 2.0, 0.5);
    for (split, per_cell) in [(Split::Five, 5), (Split::Six, 6)] {
        for cells in [[1, 1, 1], [3, 2, 1], [2, 5, 4]] {
            let mesh = box_mesh(cells, size, split).unwrap();
            assert_eq!(mesh.tets.len(), per_cell * cells.iter().product::<usize>());
            assert_eq!(
                mesh.nodes.len(),
                cells.iter().map(|n| n + 1).product::<usize>()
            );
            assert!((mesh.volume() - 3.0).abs() < 1e-12);
            assert_eq!(check_generated(&mesh), 2);
            let [a, b, c] = cells;
            let boundary = 4 * (a * b + b * c + c * a);
            assert_eq!(Topology::new(&mesh).boundary.len(), boundary);
        }
    }
}

#[test]
fn generators_reject_invalid_sizes() {
    assert!(box_mesh([0, 1, 1], DVec3::ONE, Split::Five).is_err());
    assert!(box_mesh([usize::MAX, 2, 2], DVec3::ONE, Split::Six).is_err());
    assert!(box_mesh([1 << 20, 1 << 20, 1], DVec3::ONE, Split::Six).is_err());
    assert!(box_mesh([1; 3], DVec3::new(1.0, -1.0, 1.0), Split::Five).is_err());
    assert!(box_mesh([1; 3], DVec3::new(1.0, f64::NAN, 1.0), Split::Five).is_err());
    assert!(duct([4, 3, 1], DVec3::ONE, Bore::Square).is_err());
    assert!(duct([0, 0, 1], DVec3::ONE, Bore::Round).is_err());
    assert!(duct([usize::MAX, usize::MAX, 1], DVec3::ONE, Bore::Round).is_err());
    assert!(bar_of_about(4, DVec3::ONE).is_err());
}

/// Returns 2/ω_max, the largest stable step of undamped Verlet, with stiffness `kappa` on every
/// edge and a quarter of each tet's mass at its corners: power iteration of M⁻¹K at rest.
fn verlet_limit(mesh: &TetMesh, kappa: f64, density: f64) -> f64 {
    let mut mass = vec![0.0; mesh.nodes.len()];
    for (t, tet) in mesh.tets.iter().enumerate() {
        for &v in tet {
            mass[v as usize] += density * mesh.tet_volume(t) / 4.0;
        }
    }
    let blocks: Vec<(usize, usize, DMat3)> = mesh
        .edges()
        .iter()
        .map(|&[a, b]| (a as usize, b as usize))
        .map(|(a, b)| {
            let d = (mesh.nodes[b] - mesh.nodes[a]).normalize();
            (a, b, kappa * DMat3::from_cols(d * d.x, d * d.y, d * d.z))
        })
        .collect();
    let mut x: Vec<DVec3> = (0..mesh.nodes.len())
        .map(|i| {
            DVec3::new(
                (i as f64).sin(),
                (2.0 * i as f64).cos(),
                (3.0 * i as f64).sin(),
            )
        })
        .collect();
    let mut omega_squared = 0.0;
    for _ in 0..5000 {
        let mut y = vec![DVec3::ZERO; x.len()];
        for &(a, b, k) in &blocks {
            let f = k * (x[a] - x[b]);
            y[a] += f;
            y[b] -= f;
        }
        for (i, y) in y.iter_mut().enumerate() {
            *y /= mass[i];
        }
        omega_squared = y.iter().map(|v| v.length_squared()).sum::<f64>().sqrt();
        x = y.into_iter().map(|v| v / omega_squared).collect();
    }
    2.0 / omega_squared.sqrt()
}

#[test]
fn paper_bar_matches_published_mass_and_step_limits() {
    let mesh = paper_bar().unwrap();
    assert_eq!((mesh.tets.len(), mesh.nodes.len()), (80, 45));
    assert!((mesh.volume() - 0.432e-3).abs() < 1e-15);
    assert_eq!(check_generated(&mesh), 2);
    let soft = verlet_limit(&mesh, 3_000.0, 1000.0);
    let stiff = verlet_limit(&mesh, 30_000.0, 1000.0);
    assert!((soft - 1.08e-3).abs() < 0.005e-3, "{soft}");
    assert!((stiff - 0.342e-3).abs() < 0.0005e-3, "{stiff}");
}

#[test]
fn performance_bars_approximate_requested_counts() {
    let size = DVec3::new(0.12, 0.06, 0.06);
    for wanted in [80, 13_766, 17_312, 24_106, 35_118, 112_299, 156_612] {
        let mesh = bar_of_about(wanted, size).unwrap();
        let off = mesh.tets.len() as f64 / wanted as f64 - 1.0;
        println!(
            "{wanted}: {} tets, {} nodes",
            mesh.tets.len(),
            mesh.nodes.len()
        );
        assert!(off.abs() < 0.04, "{wanted}: {}", mesh.tets.len());
        assert!((mesh.volume() / 0.432e-3 - 1.0).abs() < 1e-10);
    }
    assert_eq!(
        bar_of_about(80, size).unwrap().nodes,
        paper_bar().unwrap().nodes
    );
    assert_eq!(bar_of_about(5, DVec3::ONE).unwrap().tets.len(), 5);
}

#[test]
fn ducts_are_tori_with_exact_volume() {
    let size = DVec3::new(0.3, 0.3, 0.2);
    let square = duct([6, 6, 3], size, Bore::Square).unwrap();
    assert_eq!(check_generated(&square), 0);
    assert!((square.volume() - 0.018 * 8.0 / 9.0).abs() < 1e-15);
    let round = duct([12, 12, 4], size, Bore::Round).unwrap();
    assert_eq!(check_generated(&round), 0);
    // The bore is a polygon inscribed in a circle of radius 0.05.
    let angle = |i: usize| (i as f64 / 6.0).atan();
    let polygon: f64 = (0..6)
        .map(|i| 8.0 * 0.5 * 0.05f64.powi(2) * (angle(i + 1) - angle(i)).sin())
        .sum();
    let exact = 0.018 - polygon * 0.2;
    assert!((round.volume() - exact).abs() < 1e-12, "{}", round.volume());
    let flat = duct([9, 3, 2], DVec3::new(3.0, 1.0, 1.0), Bore::Round).unwrap();
    assert_eq!(check_generated(&flat), 0);
}

#[test]
fn benchmark_cube_matches_peer_benchmarks() {
    let mesh = benchmark_cube(20, false).unwrap();
    assert_eq!((mesh.tets.len(), mesh.nodes.len()), (48_000, 9_261));
    assert!((mesh.volume() - 1.0).abs() < 1e-12);
    assert_eq!(check_generated(&mesh), 2);
    let scalar = &mesh.field("scalar", Location::Node).unwrap().values;
    // Node (3, 5, 7), x running fastest.
    let u = [3.0, 5.0, 7.0].map(|i: f64| i / 20.0 - 0.5);
    let expected =
        0.5 + 0.25 * ((9.0 * u[0]).sin() * (7.0 * u[1]).cos() + (8.0 * u[2] + 2.0 * u[0]).sin());
    let node = 3 + 21 * (5 + 21 * 7);
    assert!((scalar[node] - expected).abs() < 1e-12);
    assert_eq!(mesh.nodes[node], DVec3::new(0.15, 0.25, 0.35));
    // The first cell's tets, in the peers' order and orientation.
    assert_eq!(mesh.tets[0], [0, 1, 22, 463]);
    assert_eq!(check_generated(&benchmark_cube(10, true).unwrap()), 0);
}

#[test]
fn morton_order_is_permutation_with_better_locality() {
    let mesh = benchmark_cube(12, false).unwrap();
    let order = mesh.morton_order();
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert!(sorted.iter().enumerate().all(|(i, t)| i == *t as usize));
    let centroid = |t: u32| mesh.tet_nodes(t as usize).into_iter().sum::<DVec3>() / 4.0;
    // Diagonals of the bounding boxes of each 64 consecutive tets.
    let spread = |order: &[u32]| -> f64 {
        let size = |(low, high): (DVec3, DVec3)| low.distance(high);
        let boxes = order
            .chunks(64)
            .map(|c| c.iter().map(|t| centroid(*t)).collect::<Vec<_>>());
        boxes
            .map(|points| size(palpate::mesh::bounds(&points)))
            .sum()
    };
    let by_file: Vec<u32> = (0..mesh.tets.len() as u32).collect();
    assert!(
        spread(&order) < 0.5 * spread(&by_file),
        "{} {}",
        spread(&order),
        spread(&by_file)
    );
}

#[test]
fn balls_are_round_with_good_tet_quality() {
    for cells in [2, 5, 10, 24] {
        let mesh = ball(0.5, cells).unwrap();
        assert_eq!(check_generated(&mesh), 2);
        let q = QualityReport::new(&mesh);
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.125;
        assert!(q.min_dihedral > 10.0, "{cells}: {}", q.min_dihedral);
        assert_eq!(q.slivers, 0);
        // The surface is inscribed: the error of the volume is of second order in the cell size.
        let missing = 1.0 - mesh.volume() / exact;
        assert!(
            missing > 0.0 && missing < 1.5 / (cells * cells) as f64,
            "{missing}"
        );
        let reach = mesh.nodes.iter().map(|p| p.length()).fold(0.0, f64::max);
        assert!((reach - 0.5).abs() < 1e-9, "{reach}");
    }
    assert!(ball(1.0, 1).is_err() && ball(f64::INFINITY, 8).is_err() && ball(1.0, 99_999).is_err());
}

#[test]
#[ignore = "long: scripts/test --full"]
fn named_generators_match_their_descriptions() {
    for (name, what) in GENERATORS {
        let digits: String = what
            .rsplit(';')
            .next()
            .unwrap()
            .chars()
            .filter(char::is_ascii_digit)
            .collect();
        let said: f64 = digits.parse().unwrap();
        let mesh = by_name(name, None).unwrap();
        let off = mesh.tets.len() as f64 / said - 1.0;
        assert!(
            off.abs() < 0.15,
            "{name}: {} tets, not {said}",
            mesh.tets.len()
        );
        let more = by_name(name, Some(20_000)).unwrap();
        let off = more.tets.len() as f64 / 20_000.0 - 1.0;
        assert!(
            off.abs() < 0.25,
            "{name}: {} tets, not 20,000",
            more.tets.len()
        );
    }
    let Err(palpate::Error::Input(text)) = by_name("spleen", None) else {
        panic!("unknown generator accepted");
    };
    assert!(text.contains("spleen") && text.contains("limb"), "{text}");
}

/// Returns the tets of a region.
fn region(mesh: &TetMesh, name: &str) -> Vec<usize> {
    let label = mesh.region_names.iter().find(|(_, own)| *own == name);
    let label = *label.unwrap().0 as f64;
    let labels = &mesh.field("label", Location::Cell).unwrap().values;
    (0..labels.len()).filter(|t| labels[*t] == label).collect()
}

#[test]
fn organs_contain_requested_lump_at_requested_depth() {
    for (organ, make) in [("breast", breast as fn(_, _) -> _), ("liver", liver)] {
        let lump = Lump {
            diameter: 0.02,
            depth: 0.008,
            contrast: 7.0,
        };
        let mesh: TetMesh = make(20_000, Some(lump)).unwrap();
        check_generated(&mesh);
        assert!((14_000..28_000).contains(&mesh.tets.len()), "{organ}");
        let own = region(&mesh, "lump");
        let volume: f64 = own.iter().map(|t| mesh.tet_volume(*t)).sum();
        let ball = std::f64::consts::PI / 6.0 * lump.diameter.powi(3);
        assert!(
            (volume / ball - 1.0).abs() < 0.2,
            "{organ} {}",
            volume / ball
        );
        // Factors are the contrast inside, and 1 elsewhere.
        let factors = &mesh.field("stiffness", Location::Cell).unwrap().values;
        for (t, factor) in factors.iter().enumerate() {
            let expected = if own.contains(&t) { 7.0 } else { 1.0 };
            assert_eq!(*factor, expected);
        }
        // Its nearest point has the requested depth.
        let topology = Topology::new(&mesh);
        let boundary = topology.boundary.iter().map(|b| {
            let nodes = topology.boundary_nodes(&mesh, *b);
            nodes.map(|v| mesh.nodes[v as usize])
        });
        let faces: Vec<[DVec3; 3]> = boundary.collect();
        let depth = |p: DVec3| {
            let away = faces.iter().map(|f| point_triangle_distance(p, *f));
            away.fold(f64::INFINITY, f64::min)
        };
        let mut nodes: Vec<u32> = own.iter().flat_map(|t| mesh.tets[*t]).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let nearest = nodes.iter().map(|v| depth(mesh.nodes[*v as usize]));
        let nearest = nearest.fold(f64::INFINITY, f64::min);
        assert!((nearest - lump.depth).abs() < 1.5e-3, "{organ} {nearest}");
        // Without a lump there is no such region.
        let plain = make(5_000, None).unwrap();
        assert!(plain.region_names.values().all(|name| name != "lump"));
        let factors = &plain.field("stiffness", Location::Cell).unwrap().values;
        assert!(factors.iter().all(|f| *f == 1.0));
        let error_of = |tets: usize, lump: Lump| make(tets, Some(lump)).unwrap_err().to_string();
        let large = Lump {
            diameter: 0.2,
            ..lump
        };
        assert!(error_of(5_000, large).contains("does not fit"), "{organ}");
        let small = Lump {
            diameter: 1e-3,
            ..lump
        };
        assert!(
            error_of(2_000, small).contains("increase the number of tets"),
            "{organ}"
        );
        let wrong = Lump {
            contrast: -1.0,
            ..lump
        };
        assert!(
            error_of(5_000, wrong).contains("stiffness ratio (-1) must be finite and positive"),
            "{organ}"
        );
        assert!(make(10, None).is_err());
    }
}
