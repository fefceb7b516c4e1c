//! A build without the feature `rapier`.

use crate::support::gpu;
use glam::DVec3;
use palpate::generate;
use palpate::physics::{EngineChoice, Material, MaterialModel, SolverKind};

#[test]
fn requesting_missing_engine_reports_how_to_build_it() {
    let mesh = generate::bar([2, 1, 1], DVec3::new(0.2, 0.1, 0.1)).unwrap();
    let choice: EngineChoice = "rapier".parse().unwrap();
    let material = Material {
        model: MaterialModel::NeoHookean,
        ..Material::from_young(1e4)
    };
    let message = choice.build_tets(&gpu(), mesh, &material, SolverKind::Implicit);
    let message = message.err().unwrap().to_string();
    assert!(message.contains("--features rapier"), "{message}");
}
