//! Force–depth curve of a press, and the stiffness and modulus fitted to it.

use super::error::PressError;
use crate::accuracy::Round;
use serde::Serialize;

/// Stiffness is fitted where the depth is at least this fraction of the maximum.
pub(crate) const FIT_FRACTION: f64 = 0.5;

/// One step of a press.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PressSample {
    /// Time of the quasi-static steps, s; without physical meaning.
    pub time_s: f64,
    /// `load` or `unload`.
    pub phase: &'static str,
    /// Advance of the fingertip beyond its first contact with the body at rest, m.
    pub depth_m: f64,
    /// Contact force on it in the outward direction, N.
    pub force_n: f64,
}

/// Result of a press.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PressReport {
    /// Slope of force over depth, fitted to the deeper half of the loading path up to the maximum
    /// force; `None` with warnings.
    pub stiffness_n_per_m: Option<f64>,
    /// Young's modulus of an elastic half space with the same resistance, by Hertz: F = 4/3 E √R
    /// d³ᐟ² / (1 − ν²), fitted to the loading path up to the maximum force. A body that is thin
    /// over the contact, or bonded to something hard, appears stiffer than it is.
    /// `None` with warnings.
    pub hertz_young_pa: Option<f64>,
    /// Maximum force.
    pub max_force_n: f64,
    /// Error of `max_force_n`, which is within it in most cases (`docs/validation/trust.md`); `None` without an
    /// estimate.
    pub max_force_error_n: Option<f64>,
    /// Error of `stiffness_n_per_m`.
    pub stiffness_error_n_per_m: Option<f64>,
    /// Error of `hertz_young_pa`.
    pub hertz_young_error_pa: Option<f64>,
    /// Parts of these errors.
    pub error_parts: Option<PressError>,
    /// Why there is no estimate of the errors, if so.
    pub no_error_because: Option<String>,
    /// The meshes on the way, if the body was refined for the press: the largest force on each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rounds: Vec<Round>,
    /// Why the largest force is not as exact as wanted, and what it would take, if so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub missed: Option<String>,
    /// Maximum depth.
    pub max_depth_m: f64,
    /// Where and how the press was made.
    #[serde(flatten)]
    pub conditions: PressConditions,
    /// Computing time, s.
    pub seconds: f64,
    /// Why the press did not measure the elastic response of the body, one sentence each with what
    /// to do; normally empty.
    pub warnings: Vec<String>,
}

/// Where and how a press was made.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PressConditions {
    /// Press point on the body at rest, in file units, as for `--at`.
    pub at: [f64; 3],
    /// Unit vector along which the fingertip advances.
    pub direction: [f64; 3],
    /// Metres per file unit.
    pub length_unit_m: f64,
    /// Thickness of the body at the site along the direction.
    pub thickness_m: f64,
    /// Radius of the fingertip.
    pub radius_m: f64,
    /// Distance of the mesh's boundary from that of the scan or surface that it was meshed from: root
    /// mean square and maximum; `None` where that is unknown. The errors do not include it.
    pub shape_error_m: Option<[f64; 2]>,
    /// Time step of the quasi-static steps, s.
    pub step_s: f64,
    /// The part of the body that is fixed; none where the scene's own supports hold it.
    pub bed: Option<Bed>,
    /// Poisson's ratio ν of the tissue at the site, used for `hertz_young_pa`.
    pub poisson: f64,
    /// Engine that computed the press.
    pub engine: String,
}

/// The part of a body that is fixed to a table.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Bed {
    /// Direction from the body to the table: `-x` to `+z`.
    pub side: String,
    /// Fraction of the body's extent in that direction, within which the surface that faces the
    /// table is fixed.
    pub fraction: f64,
    /// Area of that surface as seen from the table.
    pub area_m2: f64,
    /// Area of the faces that the mesh fixes for it.
    pub fixed_area_m2: f64,
    /// Number of fixed nodes, with those of the scene's pins.
    pub nodes: usize,
}

pub(super) fn report(
    samples: &[PressSample],
    conditions: PressConditions,
    seconds: f64,
    warnings: Vec<String>,
) -> PressReport {
    let (radius, poisson) = (conditions.radius_m, conditions.poisson);
    let way_in: Vec<[f64; 2]> = samples
        .iter()
        .filter(|s| s.phase == "load" && s.depth_m > 0.0)
        .map(|s| [s.depth_m, s.force_n])
        .collect();
    let most = |k: usize| way_in.iter().map(|s| s[k]).fold(0.0, f64::max);
    let (max_depth, max_force) = (most(0), most(1));
    // After the tissue below has slipped away from the fingertip, the curve no longer measures its
    // stiffness: uses only the samples up to the maximum force.
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
    let valid = warnings.is_empty();
    PressReport {
        stiffness_n_per_m: valid.then(|| slope(&deeper)),
        hertz_young_pa: valid.then_some(young),
        max_force_n: max_force,
        max_force_error_n: None,
        stiffness_error_n_per_m: None,
        hertz_young_error_pa: None,
        error_parts: None,
        no_error_because: None,
        rounds: Vec::new(),
        missed: None,
        max_depth_m: max_depth,
        conditions,
        seconds,
        warnings,
    }
}

/// Returns the least-squares slope of a line through the points; for one point, through the origin.
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
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn hertz_curve_recovers_modulus() {
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
        let conditions = PressConditions {
            radius_m: radius,
            poisson,
            ..PressConditions::default()
        };
        let of = |samples: &[PressSample], warnings: &[&str]| {
            let warnings = warnings.iter().map(|w| String::from(*w)).collect();
            report(samples, conditions.clone(), 1.0, warnings)
        };
        let found = of(&samples, &[]);
        assert!((found.hertz_young_pa.unwrap() / young - 1.0).abs() < 1e-12);
        assert!((found.max_depth_m - 1.6e-3).abs() < 1e-12);
        // The slope between half and full depth.
        let chord = (force(1.6e-3) - force(0.8e-3)) / 0.8e-3;
        assert!((found.stiffness_n_per_m.unwrap() / chord - 1.0).abs() < 0.01);
        // Samples after slipping do not change the fit.
        let mut slipped = samples[..18].to_vec();
        slipped.push(PressSample {
            depth_m: 1.7e-3,
            force_n: 0.1 * force(1.6e-3),
            ..slipped[17]
        });
        let again = of(&slipped, &[]);
        assert_eq!(again.stiffness_n_per_m, found.stiffness_n_per_m);
        assert!(again.max_depth_m > found.max_depth_m);
        let nothing = of(&[], &[]);
        assert_eq!(
            [nothing.hertz_young_pa, nothing.stiffness_n_per_m],
            [Some(0.0); 2]
        );
        let warned = of(&samples, &["slipped"]);
        assert_eq!([warned.hertz_young_pa, warned.stiffness_n_per_m], [None; 2]);
    }
}
