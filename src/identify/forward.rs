//! The numbers that a scene predicts for the experiments, and their derivatives by the unknowns.

use super::IdentifyOptions;
use super::data::{Experiment, ExperimentKind, Observed, Presses};
use super::lump::{FACTOR_FIELD, Lump, LumpElements};
use super::recorded_body::RecordedBody;
use super::recording::Recorded;
use super::stiffness_grid::{self, StiffnessGrid};
use super::unknown::{Kind, ScaledUnknown, Unknown};
use crate::accuracy::of_order;
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, Field, TetMesh};
use crate::press::Presser;
use crate::scene::{AccuracyEntry, OrderChoice, Scene};
use crate::{Error, ProgressFn, Result, no_progress};
use glam::DVec3;
use std::ops::Range;

/// Noise for which standard deviations are calculated if none is stated; it is estimated then.
pub(super) const UNIT_NOISE: f64 = 0.01;
/// Depths beyond this part of the smallest extent of a body are taken for an error of units.
const MAX_DEPTH: f64 = 0.9;

/// Predicted numbers, and for each its derivative by each unknown.
pub(super) struct Prediction {
    pub numbers: Vec<f64>,
    pub slopes: Vec<Vec<f64>>,
}

impl Prediction {
    /// Multiplies the numbers and their derivatives by `ratios`, which may be none.
    pub fn multiply_by(&mut self, ratios: &[f64]) {
        let rows = self.numbers.iter_mut().zip(&mut self.slopes);
        for ((number, slopes), ratio) in rows.zip(ratios) {
            *number *= ratio;
            slopes.iter_mut().for_each(|slope| *slope *= ratio);
        }
    }
}

/// An experiment in the unit of a body.
pub(super) struct BodyExperiment {
    pub name: String,
    pub kind: BodyExperimentKind,
}

pub(super) enum BodyExperimentKind {
    Presses(Presses),
    Recorded(RecordedBody),
}

impl BodyExperiment {
    /// The presses, if it is some.
    pub fn presses(&self) -> Option<&Presses> {
        match &self.kind {
            BodyExperimentKind::Presses(presses) => Some(presses),
            BodyExperimentKind::Recorded(_) => None,
        }
    }

    /// Its measured numbers.
    pub fn observed(&self) -> Vec<&Observed> {
        match &self.kind {
            BodyExperimentKind::Presses(presses) => {
                let places = presses.places.iter();
                places.flat_map(|place| &place.observed).collect()
            }
            BodyExperimentKind::Recorded(recorded) => recorded.observed.iter().collect(),
        }
    }
}

/// The body of a scene, the experiments and the unknowns.
pub(super) struct MeasuredBody<'a> {
    pub gpu: &'a Gpu,
    scene: Scene,
    mesh: TetMesh,
    pub(super) unknowns: Vec<ScaledUnknown>,
    pub experiments: Vec<BodyExperiment>,
    observations: Vec<Observed>,
    sigma: Vec<f64>,
    pub(super) lump: LumpElements,
    /// The grid of a stiffness that varies, and the numbers of the unknowns at its nodes.
    pub(super) grid: Option<StiffnessGrid>,
    pub(super) grid_nodes: Range<usize>,
    /// The tets of each unknown of a tissue.
    pub(super) tets: Vec<Vec<u32>>,
    /// Metres per file unit.
    unit: f64,
}

impl<'a> MeasuredBody<'a> {
    /// Prepares the body.
    ///
    /// # Errors
    /// As [`super::identify`].
    pub fn new(
        gpu: &'a Gpu,
        scene: &Scene,
        data: &[Experiment],
        options: &IdentifyOptions,
    ) -> Result<MeasuredBody<'a>> {
        if let Some(noise) = options
            .noise
            .filter(|noise| !(noise.is_finite() && *noise > 0.0))
        {
            return Err(Error::Input(format!(
                "noise (standard deviation over the measured number) must be positive, got {noise}"
            )));
        }
        let mut scene = scene.clone();
        scene.accuracy = AccuracyEntry::default();
        if !data.iter().any(Experiment::is_map) {
            scene.material.order.get_or_insert(OrderChoice::Auto);
        }
        let mut mesh = scene.load_simulated_mesh(&no_progress)?;
        // The tets that the simulator has: the pieces of quadratic ones.
        let (order, _) = scene.element_order(&mesh);
        if order == ElementOrder::Quadratic && mesh.order == ElementOrder::Linear {
            mesh = mesh.with_mid_edge_nodes()?;
        }
        let scene = of_order(&scene, order);
        let (low, high) = mesh.bounds();
        let lump = LumpElements::new(&mesh, scene.material.stiffness_field.as_deref())?;
        let unit = scene.length_unit(&mesh)?.unwrap_or(1.0);
        let grid = grid_of(options, &lump, (unit, (low, high)))?;
        let (unknowns, grid_nodes) = scaled_unknowns(options, (&scene, &mesh), grid.as_ref())?;
        let tets = tets_of(&unknowns, (&scene, &mesh))?;
        let mut body = MeasuredBody {
            lump,
            grid,
            grid_nodes,
            gpu,
            scene,
            mesh,
            unknowns,
            experiments: Vec::new(),
            observations: Vec::new(),
            sigma: Vec::new(),
            tets,
            unit: 1.0,
        };
        body.add(data, options.noise.unwrap_or(UNIT_NOISE))?;
        Ok(body)
    }

    /// Adds experiments, in the unit of the body.
    fn add(&mut self, data: &[Experiment], noise: f64) -> Result<()> {
        if data.is_empty() {
            return Err(Error::Input("there are no data; give some (--data)".into()));
        }
        let recording = data.iter().find(|experiment| experiment.is_recording());
        if let Some(recording) = recording
            && self.unknowns.iter().any(|unknown| unknown.kind.is_lump())
        {
            return Err(Error::Input(format!(
                "a lump is identified from presses only; remove {} (--data), or the lump (--unknown)",
                recording.name
            )));
        }
        let mut presser = None;
        for experiment in data {
            let kind = match &experiment.kind {
                ExperimentKind::Presses(presses) => {
                    if presser.is_none() {
                        let radius = presses.in_unit(1.0).radius;
                        let made = Presser::new(self.gpu, &self.scene, &self.mesh, radius)?;
                        let made = made.with_derivatives()?;
                        self.unit = made.unit();
                        presser = Some(made);
                    }
                    let presses = presses.in_unit(self.unit);
                    if let Some(presser) = &presser {
                        self.check_presses(presser, &experiment.name, &presses)?;
                    }
                    BodyExperimentKind::Presses(presses)
                }
                ExperimentKind::Recording(recording) => {
                    let unit = self.scene.length_unit(&self.mesh)?.unwrap_or(1.0);
                    let body = (unit, self.mesh.bounds());
                    BodyExperimentKind::Recorded(RecordedBody::new(recording, body)?)
                }
            };
            let experiment = BodyExperiment {
                name: experiment.name.clone(),
                kind,
            };
            for observed in experiment.observed() {
                self.sigma.push(noise * observed.scale);
                self.observations.push(observed.clone());
            }
            self.experiments.push(experiment);
        }
        Ok(())
    }

    /// Checks that the presses are of this body.
    fn check_presses(&self, presser: &Presser, name: &str, presses: &Presses) -> Result<()> {
        let (low, high) = self.mesh.bounds();
        let thin = self.unit * (high - low).min_element();
        for place in &presses.places {
            presser
                .site(place.at, place.outward)
                .map_err(|why| Error::Input(format!("{name}: {why}")))?;
            let deepest = place.depths.iter().copied().fold(0.0, f64::max);
            if deepest > MAX_DEPTH * thin {
                return Err(Error::Input(format!(
                    "{name}: a depth of {deepest} m is more than the body is thick ({thin} m at most); depths must be in metres, and the scene needs the unit of its mesh ([mesh] unit)"
                )));
            }
        }
        Ok(())
    }

    pub fn unknowns(&self) -> &[ScaledUnknown] {
        &self.unknowns
    }

    /// All measured numbers, in the order of the experiments and places.
    pub fn observations(&self) -> &[Observed] {
        &self.observations
    }

    /// Their standard deviations.
    pub fn standard_deviations(&self) -> &[f64] {
        &self.sigma
    }

    /// Order of the elements.
    pub fn order(&self) -> ElementOrder {
        self.mesh.order
    }

    /// Metres per file unit.
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// Returns the field of the factors of a stiffness that varies, if it is among the unknowns.
    pub(super) fn grid_field(&self, values: &[f64]) -> Option<Field> {
        let grid = self.grid.as_ref()?;
        let nodes = values[self.grid_nodes.clone()].iter();
        let logarithms: Vec<f64> = nodes.map(|factor| factor.ln()).collect();
        Some(grid.field(&logarithms, self.lump.own_factors()))
    }

    /// Returns the residuals of what is known before the data, with their derivatives by θ.
    pub fn prior(&self, theta: &[f64]) -> Vec<(f64, Vec<(usize, f64)>)> {
        let Some(grid) = &self.grid else {
            return Vec::new();
        };
        let mut all = grid.prior(&theta[self.grid_nodes.clone()]);
        for (node, _) in all.iter_mut().flat_map(|(_, slopes)| slopes) {
            *node += self.grid_nodes.start;
        }
        all
    }

    pub(super) fn lump_of(&self, values: &[f64]) -> Option<Lump> {
        Lump::of(&self.unknowns, values, self.mesh.bounds())
    }

    /// Returns the scene and the mesh with these values.
    pub fn with_values(&self, values: &[f64]) -> (Scene, TetMesh) {
        let (mut scene, mut mesh) = (self.scene.clone(), self.mesh.clone());
        for (unknown, value) in self.unknowns.iter().zip(values) {
            match &unknown.kind {
                Kind::Young(tissue) => scene.material.set_young(tissue.as_deref(), *value),
                Kind::Poisson(tissue) => scene.material.set_poisson(tissue.as_deref(), *value),
                Kind::Density(tissue) => scene.material.set_density(tissue.as_deref(), *value),
                Kind::DampingRatio => scene.material.damping_ratio = Some(*value),
                Kind::Pressure(n) => scene.set_pressure(*n, *value),
                Kind::ToolFriction(name) => scene.set_tool_friction(name, *value),
                Kind::Gravity(axis) => {
                    scene.solver.gravity.get_or_insert_default()[*axis] = *value;
                }
                _ => {}
            }
        }
        if let Some(field) = self.grid_field(values) {
            mesh.fields.retain(|own| own.name != field.name);
            scene.material.stiffness_field = Some(field.name.clone());
            mesh.fields.push(field);
        }
        if let Some(lump) = self.lump_of(values) {
            mesh.fields.retain(|field| field.name != FACTOR_FIELD);
            mesh.fields.push(self.lump.field(&lump));
            scene.material.stiffness_field = Some(FACTOR_FIELD.into());
        }
        (scene, mesh)
    }

    /// Returns the numbers that the scene with these values predicts, and their derivatives.
    ///
    /// # Errors
    /// As a press.
    pub fn predict(&self, values: &[f64], progress: ProgressFn) -> Result<Prediction> {
        let pressed = self.predict_presses(values, progress)?;
        let mut pressed = pressed.numbers.into_iter().zip(pressed.slopes);
        let mut all = Prediction {
            numbers: Vec::new(),
            slopes: Vec::new(),
        };
        for experiment in &self.experiments {
            match &experiment.kind {
                BodyExperimentKind::Presses(_) => {
                    let own = pressed.by_ref().take(experiment.observed().len());
                    for (number, slopes) in own {
                        all.numbers.push(number);
                        all.slopes.push(slopes);
                    }
                }
                BodyExperimentKind::Recorded(recorded) => {
                    let own = match recorded.recorded {
                        Recorded::Swing { .. } => self.predict_swing(recorded, values, progress),
                        Recorded::Motion { .. } => {
                            self.predict_over_time(recorded, values, progress)
                        }
                        Recorded::AtRest { .. } => self.predict_rest(recorded, values),
                    };
                    let own = own.map_err(|error| match error {
                        Error::Input(what) => Error::Input(format!("{}: {what}", experiment.name)),
                        other => other,
                    })?;
                    all.numbers.extend(own.numbers);
                    all.slopes.extend(own.slopes);
                }
            }
        }
        Ok(all)
    }

    /// The elements, as far as their stiffness is unknown.
    pub fn lump_elements(&self) -> &LumpElements {
        &self.lump
    }

    /// The bounds of the body, in file units.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.mesh.bounds()
    }
}

/// Returns the grid of a stiffness that varies, if it is among the unknowns.
fn grid_of(
    options: &IdentifyOptions,
    elements: &LumpElements,
    (unit, bounds): (f64, (DVec3, DVec3)),
) -> Result<Option<StiffnessGrid>> {
    let mut grids = options
        .unknowns
        .iter()
        .filter_map(|unknown| match unknown.kind {
            Kind::StiffnessGrid(micrometres, variation) => Some((micrometres, variation)),
            _ => None,
        });
    let Some((micrometres, variation)) = grids.next() else {
        return Ok(None);
    };
    let has_lump = options
        .unknowns
        .iter()
        .any(|unknown| unknown.kind.is_lump());
    if grids.next().is_some() || has_lump {
        return Err(Error::Input(
            "a stiffness that varies is one unknown, and contains a lump; name one of them (--unknown)".into(),
        ));
    }
    if options.noise.is_none() {
        return Err(Error::Input(
            "a stiffness that varies needs the noise of the data, such as --noise 2%: it says how closely the data are to be followed".into(),
        ));
    }
    let spacing = 1e-6 * micrometres as f64 / unit;
    StiffnessGrid::new(elements, bounds, (spacing, variation)).map(Some)
}

/// Returns the unknowns of a body, and the numbers of those at the nodes of a grid.
fn scaled_unknowns(
    options: &IdentifyOptions,
    (scene, mesh): (&Scene, &TetMesh),
    grid: Option<&StiffnessGrid>,
) -> Result<(Vec<ScaledUnknown>, Range<usize>)> {
    let (low, high) = mesh.bounds();
    let extents = (low.to_array(), high.to_array());
    let listed = with_grid_nodes(&options.unknowns, grid);
    let is_node = |unknown: &Unknown| matches!(unknown.kind, Kind::StiffnessNode(_));
    let first = listed.iter().position(is_node).unwrap_or(0);
    let nodes = first..first + grid.map_or(0, |grid| grid.places.len());
    let scaled = listed.iter();
    let scaled = scaled.map(|unknown| ScaledUnknown::new(unknown, scene, extents));
    let unknowns: Vec<ScaledUnknown> = scaled.collect::<Result<_>>()?;
    for (k, unknown) in unknowns.iter().enumerate() {
        if unknowns[..k].iter().any(|other| other.name == unknown.name) {
            return Err(Error::Input(format!(
                "{} is named twice (--unknown)",
                unknown.name
            )));
        }
    }
    Ok((unknowns, nodes))
}

/// Returns the tets of each unknown of a tissue.
fn tets_of(unknowns: &[ScaledUnknown], (scene, mesh): (&Scene, &TetMesh)) -> Result<Vec<Vec<u32>>> {
    let of = |unknown: &ScaledUnknown| match &unknown.kind {
        Kind::Young(tissue) | Kind::Poisson(tissue) | Kind::Density(tissue) => {
            let tets = scene.material.tets_of(tissue.as_deref(), mesh)?;
            match tets.is_empty() {
                true => Err(Error::Input(format!(
                    "the data do not depend on {}: no tet consists of it",
                    unknown.name
                ))),
                false => Ok(tets),
            }
        }
        _ => Ok(Vec::new()),
    };
    unknowns.iter().map(of).collect()
}

/// Returns the unknowns with those at the nodes of the grid in place of the grid.
fn with_grid_nodes(unknowns: &[Unknown], grid: Option<&StiffnessGrid>) -> Vec<Unknown> {
    let nodes = |unknown: &Unknown| -> Vec<Unknown> {
        let count = grid.map_or(0, |grid| grid.places.len());
        let node = |n: usize| Unknown {
            name: format!("{}.{}", stiffness_grid::NAME, n + 1),
            kind: Kind::StiffnessNode(n),
            ..unknown.clone()
        };
        (0..count).map(node).collect()
    };
    let all = unknowns.iter().flat_map(|unknown| match unknown.kind {
        Kind::StiffnessGrid(..) => nodes(unknown),
        _ => vec![unknown.clone()],
    });
    all.collect()
}
