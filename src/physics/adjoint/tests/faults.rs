//! Negative controls: an adjoint with a part of the tangent left out must fail.

use super::contact_tests::{clip, tool_on_bar};
use super::load_tests::{bar_with_bone, pressed_bar};
use super::material_tests::quantities;
use super::*;
use crate::physics::Shape;

/// Returns the relative differences of a displacement's derivative by a load and by gravity, with
/// the parts of the tangent.
fn differences(case: &Case, parts: TangentParts) -> f64 {
    let quantity = &quantities(case)[1..2];
    let parameter = [Parameter::Gravity {
        direction: DVec3::new(0.6, -0.3, 0.7),
    }];
    let expected = case.differences(quantity, &parameter)[0][0];
    let mut settled = case.settle();
    let found = case.gradient_with(&mut settled, &quantity[0], &parameter, parts);
    (found.unwrap().derivatives[0] / expected - 1.0).abs()
}

#[test]
fn adjoint_without_part_of_tangent_fails() {
    let all = TangentParts::default();
    let cases = [
        (
            "unprojected",
            tool_on_bar(Shape::Sphere { radius: 0.02 }, 0.0),
            TangentParts {
                unprojected: false,
                ..all
            },
        ),
        (
            "loads",
            pressed_bar(),
            TangentParts {
                loads: false,
                ..all
            },
        ),
        (
            "rotations",
            bar_with_bone(),
            TangentParts {
                rotations: false,
                ..all
            },
        ),
        (
            "pairs",
            clip(),
            TangentParts {
                pairs: false,
                ..all
            },
        ),
    ];
    for (part, case, without) in cases {
        let (exact, wrong) = (differences(&case, all), differences(&case, without));
        println!("{part}: {exact:.1e} with it, {wrong:.1e} without");
        assert!(exact < 1e-6 && wrong > 1e-5, "{part}: {exact} {wrong}");
    }
}
