//! Materials, orders, volumes and springs.

use super::*;
use crate::mesh::ElementOrder;
use crate::physics::VolumetricFormulation;

const TOLERANCE: f64 = 1e-6;

/// All quantities that need no contact and no rigid region.
pub(super) fn quantities(case: &Case) -> Vec<Quantity> {
    let tip = node_at(&case.mesh, DVec3::new(0.12, 0.06, 0.05));
    let beside = node_at(&case.mesh, DVec3::new(0.08, 0.03, 0.05));
    let pins = 0..case.mesh.nodes.len();
    vec![
        Quantity::PinReaction {
            nodes: pins
                .filter(|v| case.pinned[*v] && case.mesh.nodes[*v].x < 1e-9)
                .map(|v| v as u32)
                .step_by(2)
                .collect(),
            direction: DVec3::new(0.3, -0.5, 1.0),
        },
        Quantity::Displacement {
            nodes: vec![(tip, 1.0), (beside, -0.4)],
            direction: DVec3::new(0.2, 1.0, -0.5),
        },
        Quantity::Volume {
            tets: case.region(1.0),
        },
        Quantity::ElasticEnergy,
    ]
}

/// The quantities of elements.
pub(super) fn stresses(case: &Case) -> Vec<Quantity> {
    let tet = case.region(1.0)[3];
    vec![
        Quantity::LargestDisplacement,
        Quantity::VonMises { tet },
        Quantity::Stress {
            tet,
            along: [DVec3::new(1.0, 0.2, 0.0), DVec3::new(0.9, 0.0, 0.4)],
        },
    ]
}

/// Parameters of material, loads and shape.
pub(super) fn parameters(case: &Case) -> Vec<Parameter> {
    let free = node_at(&case.mesh, DVec3::new(0.08, 0.06, 0.05));
    let inner = node_at(&case.mesh, DVec3::new(0.04, 0.03, 0.025));
    let pin = node_at(&case.mesh, DVec3::ZERO);
    let direction = DVec3::new(0.6, -0.3, 0.7);
    vec![
        Parameter::Young {
            tets: case.region(0.0),
        },
        Parameter::Young {
            tets: case.region(1.0),
        },
        Parameter::Density {
            tets: case.region(1.0),
        },
        Parameter::Load {
            node: free,
            direction,
        },
        Parameter::Gravity { direction },
        Parameter::RestPosition {
            node: inner,
            direction,
        },
        Parameter::RestPosition {
            node: pin,
            direction,
        },
    ]
}

pub(super) fn poisson(case: &Case) -> Vec<Parameter> {
    let of = |label| Parameter::Poisson {
        tets: case.region(label),
    };
    vec![of(0.0), of(1.0)]
}

fn check_all(case: &Case, with_stress: bool) {
    let mut all = quantities(case);
    if with_stress {
        all.extend(stresses(case));
    }
    let mut by = parameters(case);
    by.extend(poisson(case));
    case.check(&all, &by, TOLERANCE);
}

#[test]
fn gradients_of_neo_hookean_bar_match_differences() {
    check_all(&bar(MaterialModel::NeoHookean), true);
}

#[test]
fn gradients_of_corotated_bar_match_differences() {
    check_all(&bar(MaterialModel::Corotated), true);
}

#[test]
fn gradients_with_averaged_volumes_match_differences() {
    for model in [MaterialModel::NeoHookean, MaterialModel::Corotated] {
        let mut case = bar(model);
        case.material.volume = VolumetricFormulation::NodalAveraged;
        case.material.poisson = 0.45;
        case.material.regions.get_mut(&1).unwrap().poisson = 0.42;
        check_all(&case, false);
    }
}

/// Returns the bar of ten-node tets.
pub(super) fn quadratic_bar() -> Case {
    let mut case = bar(MaterialModel::NeoHookean);
    let size = DVec3::new(0.12, 0.06, 0.05);
    let mut mesh = box_mesh([2, 1, 1], size, Split::Five)
        .unwrap()
        .with_mid_edge_nodes()
        .unwrap();
    let pieces = 0..mesh.tets.len();
    let labels = pieces.map(|t| {
        let nodes = (t / 8 * 8..t / 8 * 8 + 8).flat_map(|t| mesh.tet_nodes(t));
        f64::from(u8::from(
            nodes.map(|p| p.x).sum::<f64>() / 32.0 > 0.5 * size.x,
        ))
    });
    let labels = Field::scalar("label", Location::Cell, labels.collect());
    mesh.set_field(labels).unwrap();
    case.pinned = mesh.nodes.iter().map(|p| p.x < 1e-9).collect();
    case.loads = vec![DVec3::ZERO; mesh.nodes.len()];
    case.mesh = mesh;
    case.material.order = ElementOrder::Quadratic;
    case
}

#[test]
fn gradients_of_quadratic_tets_match_differences() {
    check_all(&quadratic_bar(), true);
}

#[test]
fn gradients_of_springs_match_differences() {
    let mut case = bar(MaterialModel::Springs);
    case.steps = 60;
    let all = quantities(&case);
    case.check(&all, &parameters(&case), TOLERANCE);
    let mut settled = case.settle();
    assert!(
        case.gradient(&mut settled, &all[0], &poisson(&case))
            .is_err()
    );
    assert!(
        case.gradient(&mut settled, &stresses(&case)[1], &[])
            .is_err()
    );
}
