//! Negative controls of motions: the reverse of a step with a part left out must fail.

use super::load_tests::pressed_bar;
use super::material_tests::quantities;
use super::motion_contact_tests::{bar_against_sphere, falling_clip};
use super::motion_tests::{damped, moving};
use super::*;
use crate::physics::adjoint::motion::MotionQuantity;
use crate::physics::cpu::StepParts;

/// Returns the largest relative difference of a displacement's derivatives by gravity and by a
/// stiffness, with the parts of the reverse.
fn difference(case: &Case, parts: StepParts) -> f64 {
    let quantity = [MotionQuantity::Integral(quantities(case).remove(1))];
    let by = [
        Parameter::Gravity {
            direction: DVec3::new(0.6, -0.3, 0.7),
        },
        Parameter::Young {
            tets: case.region(1.0),
        },
    ];
    let expected = case.motion_differences(&quantity, &by).remove(0);
    let found = case.motion_gradient((&quantity[0], &by), parts).unwrap();
    let both = found.derivatives.iter().zip(expected);
    both.map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn reverse_without_part_of_step_fails() {
    let all = StepParts::default();
    let soft = || bar(MaterialModel::NeoHookean);
    let cases = [
        (
            "velocities",
            moving(soft(), SolverKind::Implicit),
            StepParts {
                velocities: false,
                ..all
            },
        ),
        (
            "damping",
            damped(moving(soft(), SolverKind::Implicit)),
            StepParts {
                damping: false,
                ..all
            },
        ),
        (
            "loads",
            moving(pressed_bar(), SolverKind::Midpoint),
            StepParts {
                loads: false,
                ..all
            },
        ),
        (
            "history",
            moving(soft(), SolverKind::Bdf2),
            StepParts {
                history: false,
                ..all
            },
        ),
        (
            "unprojected",
            moving(bar(MaterialModel::Corotated), SolverKind::Implicit),
            StepParts {
                unprojected: false,
                ..all
            },
        ),
        (
            "pairs",
            falling_clip(),
            StepParts {
                pairs: false,
                ..all
            },
        ),
        (
            "friction",
            bar_against_sphere(SolverKind::Implicit, 0.3),
            StepParts {
                friction: false,
                ..all
            },
        ),
    ];
    for (part, case, without) in cases {
        let (exact, wrong) = (difference(&case, all), difference(&case, without));
        println!("{part}: {exact:.1e} with it, {wrong:.1e} without");
        assert!(exact < 1e-6 && wrong > 1e-5, "{part}: {exact} {wrong}");
    }
}
