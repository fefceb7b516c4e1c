//! Unsupported combinations of averaged volumes are reported; in supported ones, cuts are followed.

use super::{VOLUMES, material};
use crate::support::gpu;
use glam::DVec3;
use palpate::Error;
use palpate::generate;
use palpate::mesh::Blade;
use palpate::physics::{
    CgSettings, CpuTets, DiscreteModel, Engine, EngineChoice, Material, MaterialModel, Precision,
    Simulator, SolverKind, VolumetricFormulation,
};

#[test]
fn rejects_averaged_volumes_on_gpu_and_for_springs() {
    let mesh = generate::bar([4, 2, 2], DVec3::new(0.4, 0.2, 0.2)).unwrap();
    let averaged = material(0.49, VolumetricFormulation::NodalAveraged);
    let (gpu, kind) = (gpu(), SolverKind::Implicit);
    let refused =
        EngineChoice::Exactly(Engine::Gpu).build_tets(&gpu, mesh.clone(), &averaged, kind);
    let Err(Error::Input(what)) = refused else {
        panic!("averaged volumes were accepted");
    };
    assert!(
        what.contains("CPU only") && what.contains("--engine"),
        "{what}"
    );
    let auto = EngineChoice::Auto.build_tets(&gpu, mesh.clone(), &averaged, kind);
    assert_eq!(auto.unwrap().engine(), Engine::Cpu);
    let springs = Material {
        model: MaterialModel::Springs,
        ..averaged
    };
    let Err(Error::Input(what)) = DiscreteModel::new(&mesh, &springs) else {
        panic!("averaged volumes were accepted");
    };
    assert!(what.contains("averaged"), "{what}");
    assert!(
        "mean"
            .parse::<VolumetricFormulation>()
            .unwrap_err()
            .to_string()
            .contains("per-tet")
    );
    for volume in VOLUMES {
        assert_eq!(
            volume.name().parse::<VolumetricFormulation>().unwrap(),
            volume
        );
    }
}

/// A body that was cut equals the one made of the cut mesh.
#[test]
fn cut_body_averages_volumes_on_both_sides() {
    let mesh = generate::bar([6, 2, 2], DVec3::new(0.6, 0.2, 0.2)).unwrap();
    let averaged = material(0.49, VolumetricFormulation::NodalAveraged);
    let (kind, settings) = (SolverKind::Implicit, CgSettings::default());
    let mut body =
        CpuTets::new(&gpu(), mesh, &averaged, kind, settings, Precision::Double).unwrap();
    let whole = body.model().unwrap().clone();
    let (low, high) = body.mesh().bounds();
    let at = low.x + 0.45 * (high.x - low.x);
    let corner = |y: f64, z: f64| DVec3::new(at, low.y + y, low.z + z);
    let blade = Blade::from_quad([
        corner(-0.1, -0.1),
        corner(0.1, -0.1),
        corner(0.1, 0.3),
        corner(-0.1, 0.3),
    ]);
    let change = body.cut(&blade.unwrap()).unwrap();
    assert!(!change.mesh.duplicated_nodes.is_empty());
    let discrete_model = body.model().unwrap().clone();
    let volume = discrete_model.elements().unwrap().volume;
    assert_eq!(volume, VolumetricFormulation::NodalAveraged);
    let anew = DiscreteModel::new(body.mesh(), &averaged).unwrap();
    let pull: Vec<DVec3> = discrete_model
        .rest_positions
        .iter()
        .map(|x| *x + 0.1 * DVec3::new(x.y, x.x * x.z, x.x * x.x))
        .collect();
    let energies = [&discrete_model, &anew, &whole].map(|n| n.elements().unwrap().energy(&pull));
    println!("{energies:?}");
    assert!((energies[0] / energies[1] - 1.0).abs() < 1e-12);
    // In the uncut body, the neighbourhood of a node is on both sides of the cut.
    assert!((energies[0] / energies[2] - 1.0).abs() > 1e-6);
    body.run(5, 0.01).unwrap();
}
