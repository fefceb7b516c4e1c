//! The numbers of a press, with its conditions and errors.

use super::Press;
use super::curve::{self, PressConditions, PressReport};
use super::validity::curve_warnings;
use crate::accuracy::ErrorParts;
use crate::number_format::significant;

impl Press {
    /// Returns the result after `seconds` of computing time.
    pub fn report(&self, seconds: f64) -> PressReport {
        let conditions = self.conditions();
        let mut report = curve::report(self.samples(), conditions, seconds, self.warnings());
        report.rounds = self.rounds().to_vec();
        report.missed = self.missed().map(str::to_owned);
        let total = |parts: &ErrorParts| Some(parts.total());
        match &self.error {
            Some(Ok(error)) => {
                report.warnings.extend(error.warning(report.max_force_n));
                if report.warnings.is_empty() {
                    report.stiffness_error_n_per_m = total(&error.stiffness_n_per_m);
                    report.hertz_young_error_pa = total(&error.hertz_young_pa);
                } else {
                    report.stiffness_n_per_m = None;
                    report.hertz_young_pa = None;
                }
                report.max_force_error_n = total(&error.max_force_n);
                report.error_parts = Some(error.clone());
            }
            Some(Err(why)) => report.no_error_because = Some(why.clone()),
            None => {}
        }
        report
    }

    pub(super) fn conditions(&self) -> PressConditions {
        let engine = self.stage.motion().map(|m| m.engine().to_string());
        let unit = self.session.unit();
        PressConditions {
            at: self.site.point.to_array(),
            direction: (-self.site.outward).to_array(),
            length_unit_m: unit,
            thickness_m: unit * self.site.thickness,
            radius_m: unit * self.radius(),
            shape_error_m: self.shape_error,
            step_s: self.session.step(),
            bed: self
                .session
                .setup()
                .table
                .as_ref()
                .map(|table| table.report(self.fixed_nodes, unit)),
            poisson: self.poisson,
            engine: engine.unwrap_or_default(),
        }
    }

    /// Returns why the press does not measure the elastic response of the body, one sentence each
    /// with what to do.
    pub fn warnings(&self) -> Vec<String> {
        let body = self.session.site_warnings().iter().chain(&self.ended);
        body.cloned()
            .chain(curve_warnings(self.samples()))
            .collect()
    }
}

/// Returns a note about the error of the shape: root mean square and maximum distance, m.
pub(super) fn shape_note([rms, most]: [f64; 2]) -> String {
    format!(
        "the surface of the mesh is {} mm (root mean square), at most {} mm, from that of the scan or surface it was meshed from; the errors leave this out",
        significant(1e3 * rms),
        significant(1e3 * most)
    )
}
