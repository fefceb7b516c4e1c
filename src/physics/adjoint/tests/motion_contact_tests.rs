//! Gradients of motions with contact, friction, rigid regions, and supports, tools and loads that
//! move and change.

use super::motion_tests::{SCHEMES, TOLERANCE, damped, moving, of_body, of_motion};
use super::*;
use crate::physics::adjoint::motion::MotionQuantity::{AtEnd, Integral};
use crate::physics::cpu::{LoadUpdate, NodeConstraint, StepParts};
use crate::physics::{AmplitudeId, Shape, ToolId};

/// The coefficient of friction of the tool.
pub(super) const FRICTION: Parameter = Parameter::ToolFriction { tool: ToolId(0) };

impl Case {
    /// Returns the loads of a step, if they change: the far pins turn, the tool goes along and
    /// turns, pressure and activation grow.
    pub(super) fn step_loads(&self, network: &DiscreteModel, step: u32) -> Option<LoadUpdate> {
        if !self.is_driven {
            return None;
        }
        let at = |step: u32| f64::from(step) * self.dt;
        let place = |node: u32, time: f64| {
            let turn = DQuat::from_scaled_axis(DVec3::new(1.0, 0.5, -1.0) * time);
            let moved = self.pull + DVec3::new(0.05, 0.1, -0.1) * time;
            network.to_metres(turn * self.mesh.nodes[node as usize] + moved)
        };
        let (now, then) = (at(step), at(step + 1));
        let pins = self.far_pins().into_iter();
        let pins = pins.map(|node| NodeConstraint::Prescribed {
            node,
            place: place(node, now),
            velocity: (place(node, then) - place(node, now)) / self.dt,
        });
        let tool = self.tool.iter().map(|tool| {
            let origin = network.to_metres(tool.pose.position());
            let turn = DQuat::from_scaled_axis(DVec3::new(2.0, 5.0, 1.0) * then);
            let place = origin + DVec3::new(0.1, -0.1, -0.3) * then * network.length_unit;
            (ToolPose::new(place, turn * tool.pose.rotation()), 0)
        });
        let tools: Vec<_> = tool.collect();
        let levels = self.amplitudes().into_iter().zip([6e3, 8.0]);
        Some(LoadUpdate {
            gravity: self.gravity,
            attachments: Some(pins.collect()),
            levels: Some(levels.map(|(level, rate)| level + rate * then).collect()),
            tools: (!tools.is_empty()).then_some(tools),
            ..LoadUpdate::default()
        })
    }
}

/// Returns the bar moving up against a sphere with a coefficient of friction.
pub(super) fn bar_against_sphere(kind: SolverKind, friction: f64) -> Case {
    let mut case = super::contact_tests::tool_on_bar(Shape::Sphere { radius: 0.02 }, friction);
    let tool = case.tool.as_mut().unwrap();
    let above = tool.pose.position() + DVec3::new(0.0, 0.0, 0.006);
    tool.pose = ToolPose::new(above, tool.pose.rotation());
    case.gravity.z = 60.0;
    let mut case = moving(case, kind);
    case.difference = 0.03;
    for (u, v) in case.offsets.iter_mut().zip(&mut case.velocities) {
        (u.z, v.z) = (0.2 * u.z, v.z.abs());
    }
    case
}

#[test]
fn gradients_of_motion_with_friction_match_differences() {
    for kind in SCHEMES {
        let case = bar_against_sphere(kind, 0.3);
        let force = Quantity::ToolForce {
            tool: ToolId(0),
            direction: DVec3::new(1.0, -0.6, 0.3),
        };
        let of = [
            AtEnd(force.clone()),
            Integral(force),
            of_motion(&case).remove(1),
        ];
        let mut by = of_body(&case);
        by.extend(super::contact_tests::tool_parameters());
        by.pop();
        let mut by: Vec<_> = by.into_iter().step_by(thinning(kind, 1)).collect();
        by.push(FRICTION);
        case.check_motion(&of, &by);
        let smooth = bar_against_sphere(kind, 0.0);
        let [with, without] = [&case, &smooth].map(|case| case.motion_values(&of)[2]);
        assert!((with / without - 1.0).abs() > 1e-3, "{with} {without}");
    }
}

#[test]
fn gradients_of_motion_in_self_contact_with_friction_match_differences() {
    let mut case = falling_clip();
    case.self_contact.as_mut().unwrap().friction = 0.3;
    case.steps = 4;
    let by = of_body(&case).into_iter();
    let by = by.filter(|p| !matches!(p, Parameter::RestPosition { .. }));
    let by: Vec<Parameter> = by.step_by(2).collect();
    case.check_motion_to(10.0 * TOLERANCE, &of_motion(&case)[1..4], &by);
}

#[test]
fn gradients_of_motion_against_tool_match_differences() {
    for kind in SCHEMES {
        let case = bar_against_sphere(kind, 0.0);
        let force = Quantity::ToolForce {
            tool: ToolId(0),
            direction: DVec3::new(0.2, 0.1, 1.0),
        };
        let of = [
            AtEnd(force.clone()),
            Integral(force),
            of_motion(&case).remove(1),
        ];
        assert!(case.motion_values(&of).iter().all(|f| f.abs() > 1e-4));
        let mut by = of_body(&case);
        by.extend(super::contact_tests::tool_parameters());
        // A sphere has no derivative by its rotation.
        by.pop();
        let by: Vec<_> = by.into_iter().step_by(thinning(kind, 1)).collect();
        case.check_motion(&of, &by);
    }
}

/// Returns the stride over the parameters that are checked: `step` for the implicit scheme, three
/// times as much for the others, whose contact is the same.
fn thinning(kind: SolverKind, step: usize) -> usize {
    if kind == SolverKind::Implicit {
        step
    } else {
        3 * step
    }
}

/// Angular velocity of the rigid half of a bar, 1/s, and its pinned node, if it has one, m.
const SPIN: DVec3 = DVec3::new(2.0, -3.0, 1.5);
const HINGE: DVec3 = DVec3::new(0.12, 0.0, 0.0);

fn rigid_nodes(case: &Case) -> Vec<usize> {
    let network = DiscreteModel::new(&case.mesh, &case.material).unwrap();
    let nodes = network.rigid_bodies().iter().flat_map(|b| &b.nodes);
    nodes.map(|v| *v as usize).collect()
}

/// Returns the bar with a rigid second half that turns.
pub(super) fn moving_bone(kind: SolverKind) -> Case {
    let mut case = moving(super::load_tests::bar_with_bone(), kind);
    for v in rigid_nodes(&case) {
        case.offsets[v] = DVec3::new(0.0, 0.0, 5e-4);
        let arm = case.mesh.nodes[v] - DVec3::new(0.06, 0.03, 0.025);
        case.velocities[v] = SPIN.cross(arm) + DVec3::new(0.0, 0.02, 0.0);
    }
    case
}

#[test]
fn gradients_of_motion_of_rigid_region_match_differences() {
    for kind in SCHEMES {
        for [is_damped, is_hinged] in [[false, false], [true, false], [false, true]] {
            let mut case = moving_bone(kind);
            case.dt = 1e-2;
            if is_damped {
                case = damped(case);
            }
            if is_hinged {
                let node = node_at(&case.mesh, HINGE) as usize;
                case.pinned[node] = true;
                for v in rigid_nodes(&case) {
                    case.velocities[v] = SPIN.cross(case.mesh.nodes[v] - HINGE);
                }
                case.offsets.fill(DVec3::ZERO);
                case.difference = 0.3;
            }
            let mut of = of_motion(&case);
            // A rigid region has no stress.
            of.truncate(4 - usize::from(is_damped));
            if is_hinged {
                // The displacement near the hinge hardly depends on the stiffness.
                of.remove(1);
            }
            if !is_damped {
                of.push(AtEnd(Quantity::RegionForce {
                    label: 1,
                    direction: DVec3::new(0.2, 0.5, 1.0),
                }));
            }
            let mut by = of_body(&case);
            by.retain(|p| has_derivative(&case, kind, p));
            // Differences of a hinged region have rounding errors of some 4e-6.
            let tolerance = if is_hinged { 10.0 } else { 1.0 } * TOLERANCE;
            case.check_motion_to(tolerance, &of, &by);
        }
    }
}

/// Whether the motion of a body with a rigid second half has a derivative by a parameter.
fn has_derivative(case: &Case, kind: SolverKind, parameter: &Parameter) -> bool {
    let rigid = rigid_nodes(case);
    let is_soft = |node: &u32| !rigid.contains(&(*node as usize));
    match parameter {
        Parameter::Young { tets } | Parameter::Poisson { tets } => *tets == case.region(0.0),
        Parameter::Density { .. } | Parameter::MassDamping => kind != SolverKind::Midpoint,
        Parameter::RestPosition { node, .. } => is_soft(node) && kind != SolverKind::Midpoint,
        Parameter::InitialPosition { node, .. } | Parameter::InitialVelocity { node, .. } => {
            is_soft(node)
        }
        _ => true,
    }
}

#[test]
fn gradients_of_driven_motion_match_differences() {
    for kind in SCHEMES {
        let mut case = super::load_tests::pressed_bar();
        for (v, p) in case.mesh.nodes.iter().enumerate() {
            case.pinned[v] |= p.x > 0.12 - 1e-9;
        }
        let fibres = case.region(0.0).into_iter().map(|t| (t, DVec3::X));
        let muscle = Muscle {
            fibres: fibres.collect(),
            tension: 5e3,
        };
        case.muscle = Some((muscle, 0.5));
        let mut case = moving(case, kind);
        case.is_driven = true;
        let mut by = of_body(&case);
        by.extend([0, 1].map(|k| Parameter::Amplitude(AmplitudeId(k))));
        by.push(shift_of_path(&case));
        case.check_motion(&of_motion(&case)[..4], &by);
    }
}

fn shift_of_path(case: &Case) -> Parameter {
    Parameter::Support {
        nodes: case.far_pins(),
        direction: DVec3::new(1.0, 0.4, -0.2),
    }
}

#[test]
fn gradients_of_motion_against_driven_tool_match_differences() {
    // The schemes share what a path changes.
    let mut case = bar_against_sphere(SolverKind::Bdf2, 0.3);
    case.is_driven = true;
    case.difference = 0.01;
    let force = Quantity::ToolForce {
        tool: ToolId(0),
        direction: DVec3::new(1.0, -0.6, 0.3),
    };
    let of = [AtEnd(force), of_motion(&case).remove(1)];
    assert!(case.motion_values(&of)[0].abs() > 1e-3);
    let mut by = super::contact_tests::tool_parameters();
    // A sphere has no derivative by its rotation.
    by.pop();
    by.extend([shift_of_path(&case), FRICTION]);
    by.extend(of_body(&case).into_iter().step_by(4));
    case.check_motion(&of, &by);
}

#[test]
fn driven_motion_in_little_memory_takes_its_steps_twice() {
    let mut case = bar_against_sphere(SolverKind::Bdf2, 0.0);
    case.is_driven = true;
    let (of, by) = (of_motion(&case).remove(1), [shift_of_path(&case)]);
    let run = |memory: usize| {
        let mut settled = case.start();
        let parts = StepParts::default();
        let result = case.motion(&mut settled, (&of, &by), (parts, memory));
        (result.gradients.unwrap(), settled.body.positions())
    };
    assert_eq!(run(usize::MAX), run(0));
}

#[test]
fn gradients_of_motion_in_self_contact_match_differences() {
    let case = falling_clip();
    let mut by = of_body(&case);
    by.retain(|p| !matches!(p, Parameter::RestPosition { .. }));
    // The reaction of the lower bar depends little on where the upper one begins.
    case.check_motion_to(10.0 * TOLERANCE, &of_motion(&case)[..4], &by);
}

/// Returns two bars, of which the upper one falls on the lower one.
pub(super) fn falling_clip() -> Case {
    let mut case = moving(super::contact_tests::clip(), SolverKind::Implicit);
    case.offsets.fill(DVec3::ZERO);
    for v in &mut case.velocities {
        *v *= 0.3;
    }
    case.difference = 0.003;
    case
}
