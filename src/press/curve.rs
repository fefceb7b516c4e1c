//! What a press measures: force against depth, and what that says of the body.

use serde::Serialize;

/// The part of the depth, from the deepest point on, over which stiffness is fitted.
const FIT_FRACTION: f64 = 0.5;

/// One step of a press.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PressSample {
    /// s.
    pub time_s: f64,
    /// `load` or `unload`.
    pub phase: &'static str,
    /// How far the fingertip is beyond where it touched the body at rest, m.
    pub depth_m: f64,
    /// The force on it, out of the body, N.
    pub force_n: f64,
}

/// What a press found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PressReport {
    /// The slope of force over depth, fitted to the deeper half of the way to the largest force.
    pub stiffness_n_per_m: f64,
    /// The Young's modulus of an elastic half space that would resist as much, by Hertz:
    /// F = 4/3 E √R d³ᐟ² / (1 − ν²), fitted to the same way. A body that is thin over the contact, or
    /// bonded to what is hard, seems stiffer than it is.
    pub hertz_young_pa: f64,
    /// The largest force.
    pub max_force_n: f64,
    /// How deep it went.
    pub max_depth_m: f64,
    /// Radius of the fingertip.
    pub radius_m: f64,
    /// ν that `hertz_young_pa` goes by.
    pub poisson: f64,
    /// What computed it.
    pub engine: String,
    /// Time of computing.
    pub seconds: f64,
}

pub(super) fn report(
    samples: &[PressSample],
    [radius, poisson]: [f64; 2],
    engine: String,
    seconds: f64,
) -> PressReport {
    let way_in: Vec<[f64; 2]> = samples
        .iter()
        .filter(|s| s.phase == "load" && s.depth_m > 0.0)
        .map(|s| [s.depth_m, s.force_n])
        .collect();
    let most = |k: usize| way_in.iter().map(|s| s[k]).fold(0.0, f64::max);
    let (max_depth, max_force) = (most(0), most(1));
    // Where what is below has slipped away from under the fingertip, only what was before says how
    // hard it is.
    let held = way_in.iter().position(|s| s[1] >= max_force);
    let way_in = &way_in[..held.map_or(0, |k| k + 1)];
    let deepest = way_in.iter().map(|s| s[0]).fold(0.0, f64::max);
    let deeper = way_in.iter().filter(|s| s[0] >= FIT_FRACTION * deepest);
    let deeper: Vec<[f64; 2]> = deeper.copied().collect();
    let (mut hertz, mut weight) = (0.0, 0.0);
    for [depth, force] in way_in {
        hertz += force * depth.powf(1.5);
        weight += depth.powi(3);
    }
    let young = match weight > 0.0 {
        true => 0.75 * (1.0 - poisson * poisson) * hertz / (weight * radius.sqrt()),
        false => 0.0,
    };
    PressReport {
        stiffness_n_per_m: slope(&deeper),
        hertz_young_pa: young,
        max_force_n: max_force,
        max_depth_m: max_depth,
        radius_m: radius,
        poisson,
        engine,
        seconds,
    }
}

/// The slope of a line through points, by least squares; of one point, through the origin.
fn slope(points: &[[f64; 2]]) -> f64 {
    let n = points.len() as f64;
    let mean = |k: usize| points.iter().map(|p| p[k]).sum::<f64>() / n;
    match points {
        [] => 0.0,
        [[x, y]] if *x > 0.0 => y / x,
        _ => {
            let (x, y) = (mean(0), mean(1));
            let across = |p: &[f64; 2]| (p[0] - x) * (p[1] - y);
            let own: f64 = points.iter().map(|p| (p[0] - x).powi(2)).sum();
            points.iter().map(across).sum::<f64>() / own.max(f64::MIN_POSITIVE)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_of_hertz_gives_its_modulus_back() {
        let (young, poisson, radius) = (2.5e4, 0.4, 8e-3f64);
        let force =
            |d: f64| 4.0 / 3.0 * young / (1.0 - poisson * poisson) * radius.sqrt() * d.powf(1.5);
        let way = (-1..=16).chain((0..16).rev()).enumerate();
        let samples: Vec<PressSample> = way
            .map(|(k, depth)| {
                let depth = 1e-4 * f64::from(depth);
                PressSample {
                    time_s: k as f64,
                    phase: if k < 18 { "load" } else { "unload" },
                    depth_m: depth,
                    force_n: if k < 18 { force(depth.max(0.0)) } else { 0.0 },
                }
            })
            .collect();
        let found = report(&samples, [radius, poisson], "cpu".into(), 1.0);
        assert!((found.hertz_young_pa / young - 1.0).abs() < 1e-12);
        assert!((found.max_depth_m - 1.6e-3).abs() < 1e-12);
        // The slope between half and all of the depth.
        let chord = (force(1.6e-3) - force(0.8e-3)) / 0.8e-3;
        assert!((found.stiffness_n_per_m / chord - 1.0).abs() < 0.01);
        // What slips away in the end takes nothing from it.
        let mut slipped = samples[..18].to_vec();
        slipped.push(PressSample {
            depth_m: 1.7e-3,
            force_n: 0.1 * force(1.6e-3),
            ..slipped[17]
        });
        let again = report(&slipped, [radius, poisson], "cpu".into(), 1.0);
        assert_eq!(again.stiffness_n_per_m, found.stiffness_n_per_m);
        assert!(again.max_depth_m > found.max_depth_m);
        let nothing = report(&[], [radius, poisson], String::new(), 0.0);
        assert_eq!(
            [nothing.hertz_young_pa, nothing.stiffness_n_per_m],
            [0.0; 2]
        );
    }
}
