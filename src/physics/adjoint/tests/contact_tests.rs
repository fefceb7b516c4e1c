//! Tools, self-contact, friction, and the cost of a gradient.

use super::material_tests::{parameters, poisson, quantities, stresses};
use super::*;
use crate::physics::{Shape, ToolId};

const TOLERANCE: f64 = 1e-6;

/// Returns the bar with a tool pressed into its upper side.
pub(super) fn tool_on_bar(shape: Shape, friction: f64) -> Case {
    let mut case = bar(MaterialModel::NeoHookean);
    let radius = match &shape {
        Shape::Sphere { radius } | Shape::Capsule { radius, .. } => *radius,
        _ => 0.01,
    };
    let at = DVec3::new(0.085, 0.032, 0.05 + radius - 0.004);
    case.tool = Some(Tool {
        shape,
        pose: ToolPose::new(at, DQuat::from_rotation_x(1.4)),
        friction,
        gap: Some(1e-3),
    });
    case.pinned = case.mesh.nodes.iter().map(|p| p.z < 1e-9).collect();
    case.steps = 12;
    case
}

pub(super) fn tool_parameters() -> Vec<Parameter> {
    let tool = ToolId(0);
    vec![
        Parameter::ToolPosition {
            tool,
            direction: DVec3::Z,
        },
        Parameter::ToolPosition {
            tool,
            direction: DVec3::new(1.0, -0.5, 0.0),
        },
        Parameter::ToolRotation {
            tool,
            axis: DVec3::new(0.3, 1.0, 0.2),
        },
    ]
}

fn tool_force() -> Quantity {
    Quantity::ToolForce {
        tool: ToolId(0),
        direction: DVec3::new(0.2, 0.1, 1.0),
    }
}

#[test]
fn gradients_under_tools_match_differences() {
    let shapes = [
        Shape::Sphere { radius: 0.02 },
        Shape::Capsule {
            radius: 0.012,
            length: 0.03,
        },
    ];
    for shape in shapes {
        let case = tool_on_bar(shape, 0.0);
        let mut all = quantities(&case);
        all.extend(stresses(&case));
        all.push(tool_force());
        // The others do not depend on the shape of the tool.
        let mut by = parameters(&case)[..2].to_vec();
        by.extend(tool_parameters());
        case.check(&all, &by, TOLERANCE);
    }
}

/// Returns two bars, one above the other, pressed together by gravity: the lower one is pinned
/// below, the upper one at its ends.
pub(super) fn clip() -> Case {
    let mut case = bar(MaterialModel::NeoHookean);
    let size = DVec3::new(0.12, 0.06, 0.03);
    let lower = box_mesh([3, 2, 1], size, Split::Six).unwrap();
    let upper = box_mesh([4, 2, 1], size, Split::Six).unwrap();
    let lift = DVec3::new(0.003, 0.004, size.z + 0.0015);
    let count = lower.nodes.len() as u32;
    let nodes = lower.nodes.iter().copied();
    let nodes = nodes.chain(upper.nodes.iter().map(|p| *p + lift)).collect();
    let tets = lower.tets.iter().copied();
    let tets: Vec<[u32; 4]> = tets
        .chain(upper.tets.iter().map(|tet| tet.map(|v| v + count)))
        .collect();
    let labels = (0..tets.len()).map(|t| f64::from(u8::from(t >= lower.tets.len())));
    let labels = Field::scalar("label", Location::Cell, labels.collect());
    case.mesh = TetMesh::new(nodes, tets, vec![labels], Vec::new()).unwrap();
    let ends = |p: &DVec3| p.z > size.z + 1e-3 && (p.x < 0.004 || p.x > 0.1225);
    case.pinned = case
        .mesh
        .nodes
        .iter()
        .map(|p| p.z < 1e-9 || ends(p))
        .collect();
    case.loads = vec![DVec3::ZERO; case.mesh.nodes.len()];
    case.gravity = DVec3::new(0.5, 1.0, -40.0);
    case.self_contact = Some(SelfContactSettings {
        gap: Some(1.2e-3),
        ..SelfContactSettings::default()
    });
    case.steps = 12;
    case
}

#[test]
fn gradients_in_self_contact_match_differences() {
    let case = clip();
    let by = [&parameters(&case)[..5], &poisson(&case)[..1]].concat();
    case.check(&quantities(&case), &by, TOLERANCE);
    let refused = &parameters(&case)[5..6];
    let mut settled = case.settle();
    assert!(
        case.gradient(&mut settled, &quantities(&case)[1], refused)
            .is_err()
    );
}

#[test]
fn friction_has_no_part_at_rest() {
    // In long steps friction vanishes with the velocity.
    let mut case = tool_on_bar(Shape::Sphere { radius: 0.02 }, 0.4);
    let by = tool_parameters();
    case.check(&[tool_force()], &by, TOLERANCE);
    let mut settled = case.settle();
    let friction = [super::motion_contact_tests::FRICTION];
    let refused = case.gradient(&mut settled, &tool_force(), &friction);
    assert!(refused.unwrap_err().to_string().contains("friction"));
    // In short ones it holds the body: that is no equilibrium without it.
    case.dt = 1e-3;
    let mut settled = case.settle();
    let refused = case.gradient(&mut settled, &tool_force(), &by);
    assert!(refused.unwrap_err().to_string().contains("at rest"));
}

#[test]
fn gradient_costs_at_most_as_many_iterations_as_equilibrium() {
    let mut case = tool_on_bar(Shape::Sphere { radius: 0.02 }, 0.0);
    case.newton = None;
    case.steps = 6;
    let mut by = parameters(&case);
    by.extend(poisson(&case));
    by.extend(tool_parameters());
    let mut settled = case.settle();
    let found = case.gradient(&mut settled, &tool_force(), &by).unwrap();
    println!("{} of {} iterations", found.iterations, settled.iterations);
    assert!(found.iterations > 0 && found.iterations <= settled.iterations);
    // One parameter costs as much as all of them.
    let one = case
        .gradient(&mut settled, &tool_force(), &by[..1])
        .unwrap();
    assert_eq!(one.iterations, found.iterations);
}
