//! Pressure, muscles, terms on nodes, supports and rigid regions.

use super::material_tests::{parameters, poisson, quadratic_bar, quantities, stresses};
use super::*;
use crate::physics::AmplitudeId;

const TOLERANCE: f64 = 1e-6;

/// Returns the bar with pressure on its upper side, which is an open surface.
pub(super) fn pressed_bar() -> Case {
    let mut case = bar(MaterialModel::NeoHookean);
    let top = |v: u32| case.mesh.nodes[v as usize].z > 0.05 - 1e-9;
    let faces = case.faces().into_iter();
    let faces = faces.filter(|f| f.iter().all(|v| top(*v))).collect();
    case.pressure = Some((faces, 300.0));
    case.steps = 60;
    case
}

#[test]
fn gradients_under_pressure_match_differences() {
    let case = pressed_bar();
    let mut all = quantities(&case);
    all.extend(stresses(&case));
    let mut by = parameters(&case);
    by.push(Parameter::Amplitude(AmplitudeId(0)));
    case.check(&all, &by, TOLERANCE);
}

#[test]
fn gradients_with_muscle_match_differences() {
    let mut case = bar(MaterialModel::NeoHookean);
    let fibres = case.region(0.0).into_iter().map(|t| (t, DVec3::X));
    let muscle = Muscle {
        fibres: fibres.collect(),
        tension: 5e3,
    };
    case.muscle = Some((muscle, 0.5));
    let mut by = parameters(&case);
    by.extend(poisson(&case));
    by.push(Parameter::Amplitude(AmplitudeId(1)));
    case.check(&quantities(&case), &by, TOLERANCE);
}

#[test]
fn gradients_on_floor_match_differences() {
    let mut case = bar(MaterialModel::NeoHookean);
    let origin = DiscreteModel::new(&case.mesh, &case.material)
        .unwrap()
        .frame
        .origin;
    let height = DVec3::new(0.0, 0.0, -5e-4) - origin;
    case.floor = Some(Floor::new(height, DVec3::new(0.1, 0.0, 1.0), 60.0).unwrap());
    // Moving the inner node and the pin leaves the frame in place.
    let mut by = parameters(&case);
    by.truncate(6);
    case.check(&quantities(&case), &by, TOLERANCE);
}

#[test]
fn gradients_by_supports_match_differences() {
    let mut case = bar(MaterialModel::NeoHookean);
    for (v, p) in case.mesh.nodes.iter().enumerate() {
        case.pinned[v] |= p.x > 0.12 - 1e-9;
    }
    case.pull = DVec3::new(0.006, 0.002, -0.004);
    let mut by = parameters(&case);
    by.push(Parameter::Support {
        nodes: case.far_pins(),
        direction: DVec3::new(1.0, 0.4, -0.2),
    });
    let mut all = quantities(&case);
    all.push(Quantity::PinReaction {
        nodes: case.far_pins(),
        direction: DVec3::X,
    });
    case.check(&all, &by, TOLERANCE);
}

/// Returns the bar with a rigid second half.
pub(super) fn bar_with_bone() -> Case {
    let mut case = bar(MaterialModel::NeoHookean);
    case.material.rigid.insert(1);
    case.steps = 40;
    case
}

#[test]
fn gradients_with_rigid_region_match_differences() {
    let case = bar_with_bone();
    let mut all = quantities(&case);
    all.push(Quantity::RegionForce {
        label: 1,
        direction: DVec3::new(0.2, 0.5, 1.0),
    });
    let mut by = parameters(&case);
    // The stiffness of a rigid region has no effect.
    by.remove(1);
    let inner = by.remove(4);
    assert!(matches!(inner, Parameter::RestPosition { .. }));
    by.push(poisson(&case).swap_remove(0));
    case.check(&all, &by, TOLERANCE);
    let mut settled = case.settle();
    assert!(case.gradient(&mut settled, &all[0], &[inner]).is_err());
}

/// Returns the bar of ten-node tets with curved edges, with pressure on its upper side and a muscle in
/// its first half.
pub(super) fn loaded_quadratic_bar() -> Case {
    let mut case = quadratic_bar();
    let top = |v: u32| case.mesh.nodes[v as usize].z > 0.05 - 1e-9;
    let faces = case.faces().into_iter();
    let faces = faces.filter(|f| f.iter().all(|v| top(*v))).collect();
    for p in &mut case.mesh.nodes {
        *p += DVec3::new(0.0, p.x * p.z, 1.5 * p.x * p.x);
    }
    case.pressure = Some((faces, 300.0));
    let fibres = case.region(0.0).into_iter().map(|t| (t, DVec3::X));
    let muscle = Muscle {
        fibres: fibres.collect(),
        tension: 5e3,
    };
    case.muscle = Some((muscle, 0.5));
    case.steps = 60;
    case
}

#[test]
fn gradients_of_loaded_quadratic_bar_match_differences() {
    let case = loaded_quadratic_bar();
    let mut by = parameters(&case);
    by.push(Parameter::Amplitude(AmplitudeId(0)));
    by.push(Parameter::Amplitude(AmplitudeId(1)));
    case.check(&quantities(&case), &by, TOLERANCE);
}
