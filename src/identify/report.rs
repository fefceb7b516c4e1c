//! The result of an identification, in numbers and sentences.

use super::IdentifyOptions;
use super::best_press::best_press;
use super::correction::ForceCorrection;
use super::data::{Place, Presses};
use super::forward::{BodyExperimentKind, MeasuredBody, UNIT_NOISE};
use super::least_squares::{Model, Solution};
use super::profile;
use super::search::Found;
use super::sentences::{error_sentences, sentences};
use super::uncertainty::Uncertainty;
use super::unknown::Kind;
use crate::accuracy::{mesh_factor, of_order};
use crate::mesh::{FinerSpace, TetMesh};
use crate::number_format::significant;
use crate::press::{Press, PressOptions};
use crate::scene::{Scene, ScenePatch};
use crate::{Error, ProgressFn, Result, io};
use serde::Serialize;
use std::path::Path;

/// An unknown with its interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IdentifiedValue {
    /// Name of the unknown.
    pub name: String,
    /// The value that explains the data best.
    pub value: f64,
    /// Ends of the interval that holds it with a probability of 90 %.
    pub low: f64,
    /// The upper end.
    pub high: f64,
    /// `Pa`, `kg/m³`, `m/s²`, `file units`, or empty.
    pub unit: &'static str,
    /// Whether the value is at a bound.
    pub at_bound: bool,
}

/// The factor of a stiffness that varies at a node of its grid.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StiffnessFactor {
    /// The place of the node, in file units.
    pub at: [f64; 3],
    /// The factor that explains the data best.
    pub factor: f64,
    /// Ends of the interval that holds it with a probability of 90 %.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

/// A measured number and the predicted one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Residual {
    /// File of the experiment.
    pub experiment: String,
    /// What was measured: `force` (N), `stiffness` (N/m), or a number of a recording.
    pub quantity: String,
    /// Place, in file units.
    pub at: [f64; 3],
    /// Depth, m.
    pub depth_m: f64,
    /// Measured number.
    pub measured: f64,
    /// Predicted number.
    pub predicted: f64,
    /// Their difference over the standard deviation of the noise.
    pub residual: f64,
}

/// The press that would tell most.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PressAdvice {
    /// Place, in file units, as for `--at`.
    pub at: [f64; 3],
    /// Direction of the press.
    pub direction: [f64; 3],
    /// Depth, m.
    pub depth_m: f64,
    /// Expected gain of information, bits.
    pub bits: f64,
    /// The unknown with the widest interval.
    pub unknown: String,
    /// What is left of its width.
    pub narrower: f64,
}

/// The result of [`identify`](super::identify()).
#[derive(Clone, Debug, Serialize)]
pub struct Identified {
    /// The unknowns, without the nodes of a stiffness that varies.
    pub unknowns: Vec<IdentifiedValue>,
    /// The factors at the nodes of a stiffness that varies.
    pub stiffness: Vec<StiffnessFactor>,
    /// Root mean square of the residuals over the stated noise; over 1 % of the measured numbers if none is
    /// stated.
    pub misfit: f64,
    /// Standard deviation of the noise over the measured numbers, as stated or estimated.
    pub noise: f64,
    /// Whether the residuals are larger than the stated noise explains; intervals are widened then.
    pub is_misfit: bool,
    /// Whether the search ended by its own rule.
    pub converged: bool,
    /// Relative discretisation error of each experiment, which the intervals include; `null` if unknown.
    pub discretisation_errors: Vec<Option<f64>>,
    /// How quadratic tets corrected the forces of linear ones; `null` if they did not.
    pub correction: Option<ForceCorrection>,
    /// Correlations of the unknowns, without the nodes.
    pub correlations: Vec<Vec<f64>>,
    /// Other values that explain the data nearly as well, from other starts.
    pub other_optima: Vec<Vec<f64>>,
    /// The press that would tell most; `null` if none would, or if it was not asked for.
    pub next_press: Option<PressAdvice>,
    /// The results in sentences.
    pub sentences: Vec<String>,
    /// Computing time, s.
    pub seconds: f64,
    /// Measured and predicted numbers.
    #[serde(skip)]
    pub residuals: Vec<Residual>,
    /// The scene with the values, on the mesh of the identification.
    #[serde(skip)]
    pub scene: Scene,
    /// That mesh; with the fields of a lump or a stiffness that varies.
    #[serde(skip)]
    pub mesh: TetMesh,
    #[serde(skip)]
    has_field: bool,
}

/// Compares measured numbers with those of a body without unknowns.
///
/// # Errors
/// As a press or a motion.
pub(super) fn compared(
    body: &MeasuredBody,
    now: &Solution,
    options: &IdentifyOptions,
    progress: ProgressFn,
) -> Result<Identified> {
    let (scene, mesh) = body.with_values(&[]);
    let errors = discretisation_errors(body, (&scene, &mesh), progress)?;
    let noise = options.noise.unwrap_or(UNIT_NOISE);
    let misfit = now.misfit();
    let mut found = Identified {
        unknowns: Vec::new(),
        stiffness: Vec::new(),
        misfit,
        noise: options.noise.unwrap_or(UNIT_NOISE * misfit),
        is_misfit: false,
        converged: true,
        discretisation_errors: errors,
        correction: None,
        correlations: Vec::new(),
        other_optima: Vec::new(),
        next_press: None,
        sentences: vec![format!(
            "measured and predicted numbers differ by {} % (root mean square)",
            significant(100.0 * noise * misfit)
        )],
        seconds: 0.0,
        residuals: residuals(body, now),
        scene,
        mesh,
        has_field: false,
    };
    let errors = error_sentences(&found.discretisation_errors, "");
    found.sentences.extend(errors);
    Ok(found)
}

/// Describes what was found; results are those of the body with quadratic tets, `exact`, if its forces
/// corrected those of `body`.
///
/// # Errors
/// As a press.
pub(super) fn identified(
    (body, exact): (&MeasuredBody, Option<&MeasuredBody>),
    found: Found,
    options: &IdentifyOptions,
    progress: ProgressFn,
) -> Result<Identified> {
    let correction = found.correction(body);
    let model = Model {
        ratios: &found.ratios,
        ..Model::new(body, progress)
    };
    let (best, exact) = (&found.best, exact.unwrap_or(body));
    if let Some(k) = (0..body.unknowns().len()).find(|k| best.jacobian.column(*k).amax() == 0.0) {
        return Err(Error::Input(format!(
            "the data do not depend on {}: no measured number changes with it; remove it (--unknown)",
            body.unknowns()[k].name
        )));
    }
    let (scene, mut mesh) = exact.with_values(&best.values);
    let errors = discretisation_errors(exact, (&scene, &mesh), progress)?;
    let relative: Vec<f64> = errors.iter().map(|error| error.unwrap_or(0.0)).collect();
    let mut uncertainty = Uncertainty::new(body, best, options.noise, &relative);
    uncertainty.add_shift(&model.left(best));
    if let Some(change) = &found.last_change {
        uncertainty.add_shift(change);
    }
    for (k, unknown) in body.unknowns().iter().enumerate() {
        if options.profiles(&unknown.name) && !body.grid_nodes.contains(&k) {
            uncertainty.reach[k] = profile::reach(&model, (best, k), &uncertainty)?;
            uncertainty.is_profiled[k] = true;
        }
    }
    let next_press = match options.advise {
        true => best_press(body, (best, &uncertainty), progress)?,
        false => None,
    };
    mesh.fields.extend(uncertainty.spread_of_stiffness(exact));
    let unknowns = values_with_intervals(body, best, &uncertainty);
    let others = found.others.iter().map(|other| other.values.clone());
    let noise = body.standard_deviations().iter().zip(body.observations());
    let noise = noise
        .map(|(sigma, observed)| sigma / observed.scale)
        .fold(0.0, f64::max);
    let mut report = Identified {
        stiffness: stiffness_factors(body, best, &uncertainty),
        misfit: best.misfit(),
        noise: match options.noise {
            Some(noise) => noise,
            None => noise * uncertainty.noise_factor,
        },
        is_misfit: uncertainty.is_misfit,
        converged: best.converged,
        discretisation_errors: errors,
        correction,
        correlations: uncertainty.correlations(&body.grid_nodes),
        other_optima: others.collect(),
        next_press,
        sentences: Vec::new(),
        seconds: 0.0,
        residuals: residuals(body, best),
        scene,
        mesh,
        has_field: body.unknowns().iter().any(|unknown| {
            unknown.kind.is_lump() || matches!(unknown.kind, Kind::StiffnessNode(_))
        }),
        unknowns,
    };
    report.sentences = sentences(&report, body.unknowns(), &uncertainty);
    Ok(report)
}

/// Returns the unknowns but the nodes of a grid, with their intervals.
fn values_with_intervals(
    body: &MeasuredBody,
    best: &Solution,
    uncertainty: &Uncertainty,
) -> Vec<IdentifiedValue> {
    let all = body.unknowns().iter().enumerate();
    all.filter(|(k, _)| !body.grid_nodes.contains(k))
        .map(|(k, unknown)| {
            let [low, high] = uncertainty.interval(k, unknown, best.theta[k]);
            IdentifiedValue {
                name: unknown.name.clone(),
                value: best.values[k],
                low,
                high,
                unit: unit_of(&unknown.kind),
                at_bound: best.at_bound[k],
            }
        })
        .collect()
}

/// Returns the factors at the nodes of a stiffness that varies.
fn stiffness_factors(
    body: &MeasuredBody,
    best: &Solution,
    uncertainty: &Uncertainty,
) -> Vec<StiffnessFactor> {
    let places = body.grid.iter().flat_map(|grid| &grid.places);
    let nodes = body.grid_nodes.clone().zip(places);
    nodes
        .map(|(k, at)| {
            let [low, high] = uncertainty.interval(k, &body.unknowns()[k], best.theta[k]);
            StiffnessFactor {
                at: at.to_array(),
                factor: best.values[k],
                low,
                high,
            }
        })
        .collect()
}

fn unit_of(kind: &Kind) -> &'static str {
    match kind {
        Kind::Young(_) => "Pa",
        Kind::Pressure(_) => "Pa",
        Kind::Gravity(_) => "m/s²",
        Kind::LumpPosition(_) | Kind::LumpDiameter | Kind::FingerOffset(_) => "file units",
        Kind::Density(_) => "kg/m³",
        Kind::Poisson(_)
        | Kind::DampingRatio
        | Kind::ToolFriction(_)
        | Kind::LumpContrast
        | Kind::StiffnessGrid(..)
        | Kind::StiffnessNode(_) => "",
    }
}

/// Returns the relative error of each experiment by the mesh, contact, supports and steps; `None` where it
/// is unknown.
fn discretisation_errors(
    body: &MeasuredBody,
    (scene, mesh): (&Scene, &TetMesh),
    progress: ProgressFn,
) -> Result<Vec<Option<f64>>> {
    let mut finer = None;
    let mut errors = Vec::new();
    for experiment in &body.experiments {
        let found = match &experiment.kind {
            BodyExperimentKind::Presses(presses) => {
                press_error((body, presses), (scene, mesh), progress)
            }
            BodyExperimentKind::Recorded(recorded) => {
                progress_of(progress)?;
                if finer.is_none() {
                    let space = FinerSpace::new(mesh)?.mesh;
                    finer = Some((of_order(scene, space.order), space));
                }
                let own = (body.gpu, scene, mesh);
                match &finer {
                    Some((scene, finer)) => {
                        let better = (scene, finer, mesh_factor(mesh.order));
                        recorded
                            .discretisation_error(own, better, progress)
                            .map(Some)
                    }
                    None => Ok(None),
                }
            }
        };
        errors.push(match found {
            Err(Error::Input(_) | Error::Solver { .. }) => None,
            found => found?,
        });
    }
    Ok(errors)
}

/// Returns the relative error of the force at the first place that was pressed, of a map the stiffest one.
fn press_error(
    (body, presses): (&MeasuredBody, &Presses),
    (scene, mesh): (&Scene, &TetMesh),
    progress: ProgressFn,
) -> Result<Option<f64>> {
    let strength = |place: &Place| place.observed.last().map_or(0.0, |o| o.value);
    let places = presses.places.iter();
    let Some(place) = places.max_by(|a, b| strength(a).total_cmp(&strength(b))) else {
        return Ok(None);
    };
    let wanted = PressOptions {
        at: Some(place.at),
        radius: Some(presses.radius),
        depth: place
            .observed
            .last()
            .map(|observed| observed.depth / body.unit()),
        ..PressOptions::default()
    };
    let mut press = Press::with_mesh(body.gpu, (scene, mesh.clone()), &wanted)?;
    while !press.at_max_depth() {
        progress_of(progress)?;
        if press.advance()?.is_none() {
            break;
        }
    }
    press.estimate_error(progress)?;
    let report = press.report(0.0);
    Ok(match presses.is_map {
        true => {
            let both = report.stiffness_error_n_per_m.zip(report.stiffness_n_per_m);
            both.map(|(error, stiffness)| error / stiffness)
        }
        false => {
            let error = report.max_force_error_n;
            error.map(|error| error / report.max_force_n)
        }
    })
}

fn progress_of(progress: ProgressFn) -> Result<()> {
    crate::progress::ProgressScope::begin(progress, "estimating the error", 0.9).map(drop)
}

fn residuals(body: &MeasuredBody, best: &Solution) -> Vec<Residual> {
    let mut rows = Vec::new();
    for experiment in &body.experiments {
        for observed in experiment.observed() {
            let k = rows.len();
            rows.push(Residual {
                experiment: experiment.name.clone(),
                quantity: observed.quantity.clone(),
                at: observed.at.to_array(),
                depth_m: observed.depth,
                measured: observed.value,
                predicted: best.predicted[k],
                residual: best.residuals[k],
            });
        }
    }
    rows
}

impl Identified {
    /// Returns the mesh with the field of stiffness factors, if a lump or a stiffness that varies is among
    /// the unknowns.
    pub fn mesh_with_field(&self) -> Option<&TetMesh> {
        self.has_field.then_some(&self.mesh)
    }

    /// Writes the scene file `from` with the values as `to`, with quadratic tets if they corrected the forces.
    /// A lump, or a stiffness that varies, is written as a field of the mesh, beside the scene with the
    /// extension `.vtu`.
    ///
    /// # Errors
    /// As reading and writing a scene.
    pub fn write(&self, from: &Path, to: &Path) -> Result<()> {
        let mut patch = ScenePatch::read(from, to)?;
        if self.correction.is_some() {
            // Linear tets with the same values have other forces.
            patch.set(&["material", "order"], 2_i64)?;
            patch.remove_key("material", "volume");
        }
        if self.has_field {
            let file = to.with_extension("vtu");
            io::write(&file, &self.mesh)?;
            patch.use_mesh_beside(&file, &self.scene)?;
            if let Some(field) = &self.scene.material.stiffness_field {
                patch.set(&["material", "stiffness_field"], field.as_str())?;
            }
        }
        for value in &self.unknowns {
            let path: Vec<&str> = value.name.split('.').collect();
            match path[..] {
                ["material", ..] => patch.set(&path, value.value)?,
                ["gravity", _] => {
                    let gravity = self.scene.solver.gravity.unwrap_or_default();
                    patch.set(&["solver", "gravity"], gravity.to_vec())?;
                }
                ["tool", name, "friction"] => {
                    let number = self.scene.tool_number(name)?;
                    patch.set_in_list(("tool", number), "friction", value.value)?;
                }
                ["pressure", number] => {
                    let number: usize = number.parse().unwrap_or(1);
                    patch.set_in_list(("pressure", number - 1), "pressure", value.value)?;
                }
                _ => {}
            }
        }
        patch.write(to, &self.sentences)
    }
}
