//! Gradients through the simulator, and their refusals.

use crate::support::gpu;
use glam::{DQuat, DVec3};
use palpate::generate;
use palpate::physics::{
    Capability, CgSettings, CpuTets, Engine, EngineChoice, Material, MaterialModel, Parameter,
    Precision, Quantity, Shape, Simulator, SolverKind, Tool, ToolId, ToolPose,
};

/// The edges of the bar, in file units of 1 mm.
const SIZE: DVec3 = DVec3::new(80.0, 40.0, 40.0);

fn material(young: f64) -> Material {
    Material {
        model: MaterialModel::NeoHookean,
        length_unit: 1e-3,
        ..Material::from_young(young)
    }
}

/// Returns a bar on its pinned lower side with a sphere pressed into the upper one.
fn pressed(
    young: f64,
    depth: f64,
    kind: SolverKind,
    precision: Precision,
) -> (CpuTets, Option<ToolId>) {
    let mesh = generate::bar([6, 3, 3], SIZE).unwrap();
    let low: Vec<u32> = (0..mesh.nodes.len() as u32)
        .filter(|v| mesh.nodes[*v as usize].z < mesh.bounds().0.z + 1e-6)
        .collect();
    let (centre, top) = (0.5 * (mesh.bounds().0 + mesh.bounds().1), mesh.bounds().1.z);
    let settings = CgSettings {
        tolerance: 1e-10,
        ..CgSettings::default()
    };
    let mut body = CpuTets::new(&gpu(), mesh, &material(young), kind, settings, precision).unwrap();
    body.loads_mut().pin_nodes(&low).unwrap();
    let mut id = None;
    if kind == SolverKind::Implicit {
        let at = DVec3::new(centre.x + 3.0, centre.y, top + 15.0 - depth);
        let tool = Tool {
            shape: Shape::Sphere { radius: 15.0 },
            pose: ToolPose::new(at, DQuat::IDENTITY),
            friction: 0.0,
            gap: None,
        };
        let contact = Capability::Tools.require(body.contact()).unwrap();
        id = Some(contact.add_tool(tool).unwrap());
        body.run(12, 1e3).unwrap();
    }
    (body, id)
}

fn force(body: &CpuTets, tool: ToolId) -> (Quantity, [Parameter; 2]) {
    let quantity = Quantity::ToolForce {
        tool,
        direction: DVec3::Z,
    };
    let tets = (0..body.mesh().tets.len() as u32).collect();
    let depth = Parameter::ToolPosition {
        tool,
        direction: DVec3::NEG_Z,
    };
    (quantity, [Parameter::Young { tets }, depth])
}

#[test]
fn gradient_of_tool_force_matches_differences_and_leaves_body_unchanged() {
    let double = |young, depth| pressed(young, depth, SolverKind::Implicit, Precision::Double);
    let (mut body, tool) = double(1e4, 4.0);
    let (quantity, parameters) = force(&body, tool.unwrap());
    let before = body.positions().unwrap();
    let gradients = Capability::Gradients.require(body.gradients()).unwrap();
    let found = gradients.gradient(&quantity, &parameters).unwrap();
    assert_eq!(before, body.positions().unwrap());
    let value = |body: &mut CpuTets| body.contact().unwrap().tool_forces().unwrap()[0].force.z;
    assert_eq!(found.value, value(&mut body));
    assert!(found.imbalance < 1e-6 && found.iterations > 0, "{found:?}");
    let value = |young, depth| value(&mut double(young, depth).0);
    let by_young = (value(1.005e4, 4.0) - value(0.995e4, 4.0)) / 100.0;
    let by_depth = (value(1e4, 4.01) - value(1e4, 3.99)) / 0.02;
    for (found, expected) in found.derivatives.iter().zip([by_young, by_depth]) {
        assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}");
    }
    // The force is proportional to Young's modulus, and grows with depth.
    assert!((found.derivatives[0] * 1e4 / found.value - 1.0).abs() < 1e-6);
    assert!((found.derivatives[1] / by_young).abs() > 10.0);
}

#[test]
fn gradients_are_refused_with_advice() {
    let refusal = |body: &mut CpuTets, quantity: &Quantity| {
        let found = body.gradients().unwrap().gradient(quantity, &[]);
        found.unwrap_err().to_string()
    };
    let (mut single, tool) = pressed(1e4, 4.0, SolverKind::Implicit, Precision::Single);
    let (quantity, _) = force(&single, tool.unwrap());
    let message = refusal(&mut single, &quantity);
    assert!(message.contains("Precision::Double"), "{message}");
    let (mut explicit, _) = pressed(1e4, 0.0, SolverKind::Symplectic, Precision::Double);
    let message = refusal(&mut explicit, &Quantity::ElasticEnergy);
    assert!(message.contains("--solver implicit"), "{message}");
    let (mut double, _) = pressed(1e4, 4.0, SolverKind::Implicit, Precision::Double);
    let missing = Quantity::VonMises { tet: 1 << 20 };
    assert!(refusal(&mut double, &missing).contains("does not exist"));
    double.loads_mut().set_gravity(DVec3::new(0.0, 30.0, 0.0));
    let message = refusal(&mut double, &quantity);
    assert!(message.contains("at rest"), "{message}");
    let mesh = generate::bar([6, 3, 3], SIZE).unwrap();
    let kind = SolverKind::Implicit;
    let mut on_gpu = EngineChoice::Exactly(Engine::Gpu)
        .build_tets(&gpu(), mesh, &material(1e4), kind)
        .unwrap();
    let refused = Capability::Gradients.require(on_gpu.gradients());
    assert!(refused.err().unwrap().to_string().contains("--engine cpu"));
}
