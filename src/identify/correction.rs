//! Corrections of the forces of linear tets by those of quadratic ones at the same values: the search takes the
//! derivatives of a cheap model and the numbers of an exact one (defect correction; Echeverría, Hemker 2005,
//! "Space mapping and defect correction").

use super::IdentifyOptions;
use super::data::Experiment;
use super::forward::MeasuredBody;
use crate::accuracy::of_order;
use crate::gpu::Gpu;
use crate::mesh::ElementOrder;
use crate::scene::Scene;
use crate::{Error, ProgressFn, Result};
use serde::Serialize;

/// By how much quadratic tets corrected the forces of linear ones.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ForceCorrection {
    /// Number of corrections.
    pub times: u32,
    /// The smallest and the largest ratio of a force of quadratic tets to that of linear ones.
    pub ratios: [f64; 2],
    /// By how much the last correction changed each unknown but the nodes of a grid, in its unit; `null` after a
    /// single one.
    pub last_changes: Option<Vec<f64>>,
}

/// The body with quadratic tets.
pub(super) struct Corrector<'a> {
    pub exact: MeasuredBody<'a>,
}

impl<'a> Corrector<'a> {
    /// Prepares the body with quadratic tets, if corrections are asked for.
    ///
    /// # Errors
    /// [`Error::Input`] if `body` has quadratic tets, or without presses or unknowns; as
    /// [`MeasuredBody::new`].
    pub fn new(
        (gpu, scene, data): (&'a Gpu, &Scene, &[Experiment]),
        body: &MeasuredBody,
        options: &IdentifyOptions,
    ) -> Result<Option<Corrector<'a>>> {
        if options.corrections == 0 {
            return Ok(None);
        }
        let refused = |why: &str| Err(Error::Input(format!("{why}; remove --correct")));
        if body.order() == ElementOrder::Quadratic {
            return refused(
                "the forces are those of quadratic tets, so that there is nothing to correct",
            );
        }
        if body.places().is_empty() {
            return refused("only forces of presses are corrected, and the data contain none");
        }
        if body.unknowns().is_empty() {
            return refused(
                "nothing is identified, and quadratic tets predict without corrections ([material] order = 2)",
            );
        }
        let scene = of_order(scene, ElementOrder::Quadratic);
        let exact = MeasuredBody::new(gpu, &scene, data, options)?;
        Ok(Some(Corrector { exact }))
    }

    /// Returns, for each number, the ratio of that of quadratic tets to that of `body`; 1 for numbers of
    /// recordings, and where the fingertip does not touch one of them.
    ///
    /// # Errors
    /// As a press.
    pub fn ratios(
        &self,
        body: &MeasuredBody,
        values: &[f64],
        progress: ProgressFn,
    ) -> Result<Vec<f64>> {
        let linear = body.predict_forces(values, progress)?;
        let quadratic = self.exact.predict_forces(values, progress)?;
        let pairs = linear.into_iter().zip(quadratic);
        Ok(pairs
            .map(|(linear, quadratic)| match (linear, quadratic) {
                (Some(linear), Some(quadratic)) if linear > 0.0 && quadratic > 0.0 => {
                    quadratic / linear
                }
                _ => 1.0,
            })
            .collect())
    }
}
