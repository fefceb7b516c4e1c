//! The numbers that a scene predicts for the experiments, and their derivatives by the unknowns.

use super::IdentifyOptions;
use super::data::{Experiment, ExperimentKind, Observed, Place, Presses};
use super::lump::{FACTOR_FIELD, FactorSlope, Lump, LumpElements};
use super::recorded_body::RecordedBody;
use super::unknown::{Kind, ScaledUnknown};
use crate::accuracy::of_order;
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, TetMesh};
use crate::physics::{Gradient, Parameter, Simulator};
use crate::press::Presser;
use crate::progress::ProgressScope;
use crate::scene::{AccuracyEntry, OrderChoice, Scene};
use crate::{Error, ProgressFn, Result, no_progress};
use glam::DVec3;
use std::cell::OnceCell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// Noise for which standard deviations are calculated if none is stated; it is estimated then.
pub(super) const UNIT_NOISE: f64 = 0.01;
/// Depths beyond this part of the smallest extent of a body are taken for an error of units.
const MAX_DEPTH: f64 = 0.9;

/// Change of θ of the differences of a swing.
const SWING_DIFFERENCE: f64 = 0.02;

/// Predicted numbers, and for each its derivative by each unknown.
pub(super) struct Prediction {
    pub numbers: Vec<f64>,
    pub slopes: Vec<Vec<f64>>,
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
    unknowns: Vec<ScaledUnknown>,
    pub experiments: Vec<BodyExperiment>,
    observations: Vec<Observed>,
    sigma: Vec<f64>,
    lump: LumpElements,
    /// The tets of each unknown of a tissue.
    tets: Vec<Vec<u32>>,
    /// Metres per file unit.
    unit: f64,
}

/// One number's parameters: which of the engine's parameters it takes, with factors.
struct Chain {
    parameters: Vec<Parameter>,
    /// For each unknown, numbers of parameters with factors.
    terms: Vec<Vec<(usize, f64)>>,
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
        let extents = (low.to_array(), high.to_array());
        let scaled = options.unknowns.iter();
        let unknowns = scaled.map(|unknown| ScaledUnknown::new(unknown, &scene, extents));
        let unknowns: Vec<ScaledUnknown> = unknowns.collect::<Result<_>>()?;
        for (k, unknown) in unknowns.iter().enumerate() {
            if unknowns[..k].iter().any(|other| other.name == unknown.name) {
                return Err(Error::Input(format!(
                    "{} is named twice (--unknown)",
                    unknown.name
                )));
            }
        }
        let tets = unknowns.iter().map(|unknown| match &unknown.kind {
            Kind::Young(tissue) | Kind::Poisson(tissue) | Kind::Density(tissue) => {
                scene.material.tets_of(tissue.as_deref(), &mesh)
            }
            _ => Ok(Vec::new()),
        });
        let tets: Vec<Vec<u32>> = tets.collect::<Result<_>>()?;
        let empty = |(unknown, tets): &(&ScaledUnknown, &Vec<u32>)| {
            let of_tissue = matches!(
                unknown.kind,
                Kind::Young(_) | Kind::Poisson(_) | Kind::Density(_)
            );
            of_tissue && tets.is_empty()
        };
        if let Some((unknown, _)) = unknowns.iter().zip(&tets).find(empty) {
            return Err(Error::Input(format!(
                "the data do not depend on {}: no tet consists of it",
                unknown.name
            )));
        }
        let mut body = MeasuredBody {
            lump: LumpElements::new(&mesh, scene.material.stiffness_field.as_deref())?,
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
                    BodyExperimentKind::Recorded(RecordedBody::new(recording, unit)?)
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

    /// Metres per file unit.
    pub fn unit(&self) -> f64 {
        self.unit
    }

    fn lump_of(&self, values: &[f64]) -> Option<Lump> {
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
                _ => {}
            }
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
        let places = self.places();
        let found = self.press_all((values, false), &places, progress)?;
        let pressed = self.prediction(&places, found, self.unknowns.len())?;
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
                    let own = match recorded.swings() {
                        true => self.predict_swing(recorded, values, progress),
                        false => self.predict_rest(recorded, values),
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

    /// Predicts a recording at rest, with derivatives by the adjoint method.
    fn predict_rest(&self, recorded: &RecordedBody, values: &[f64]) -> Result<Prediction> {
        let (scene, mesh) = self.with_values(values);
        let chain = OnceCell::new();
        let found = recorded.at_rest((self.gpu, &scene, &mesh), &|simulator| {
            let own = self.chain((values, false), simulator)?;
            let parameters = own.parameters.clone();
            chain.set(own).ok();
            Ok(parameters)
        })?;
        let slopes = |gradient: &Gradient| {
            let chain = chain.get();
            chain.map_or(Vec::new(), |chain| chain.by_unknowns(&gradient.derivatives))
        };
        Ok(Prediction {
            slopes: found.iter().map(slopes).collect(),
            numbers: found.iter().map(|gradient| gradient.value).collect(),
        })
    }

    /// Predicts a swing, with derivatives by differences: a swing has few numbers, each of a whole motion.
    fn predict_swing(
        &self,
        recorded: &RecordedBody,
        values: &[f64],
        progress: ProgressFn,
    ) -> Result<Prediction> {
        let mut tried = vec![values.to_vec()];
        for (k, unknown) in self.unknowns.iter().enumerate() {
            // Away from the upper bound.
            let theta = unknown.theta(values[k]);
            let above = theta + SWING_DIFFERENCE;
            let other = match above < unknown.theta(unknown.bounds[1]) {
                true => above,
                false => theta - SWING_DIFFERENCE,
            };
            let mut changed = values.to_vec();
            changed[k] = unknown.value(other);
            tried.push(changed);
        }
        let found = on_threads(tried.len(), |n| {
            let (scene, mesh) = self.with_values(&tried[n]);
            recorded.swing((self.gpu, &scene, &mesh), 1, progress)
        });
        let found = found.into_iter().collect::<Result<Vec<_>>>()?;
        let numbers = found[0].clone();
        let slopes = (0..numbers.len()).map(|i| {
            let by = |k: usize| {
                let change = tried[k + 1][k] - values[k];
                (found[k + 1][i] - numbers[i]) / change
            };
            (0..self.unknowns.len()).map(by).collect()
        });
        Ok(Prediction {
            slopes: slopes.collect(),
            numbers,
        })
    }

    /// As [`MeasuredBody::predict`], and for each number its derivatives by the logarithm of the stiffness
    /// of each element.
    ///
    /// # Errors
    /// As a press.
    pub fn predict_by_elements(
        &self,
        values: &[f64],
        progress: ProgressFn,
    ) -> Result<(Prediction, Vec<Vec<f64>>)> {
        let places = self.places();
        let found = self.press_all((values, true), &places, progress)?;
        let count = self.unknowns.len();
        let all = count + self.lump.tets().len();
        let mut prediction = self.prediction(&places, found, all)?;
        let rows = prediction.slopes.iter_mut();
        let by_element = rows.map(|row| row.split_off(count)).collect();
        Ok((prediction, by_element))
    }

    /// All places that were pressed, with the radii of the fingertips.
    fn places(&self) -> Vec<(f64, &Place)> {
        let presses = self.experiments.iter().filter_map(BodyExperiment::presses);
        presses
            .flat_map(|presses| presses.places.iter().map(|place| (presses.radius, place)))
            .collect()
    }

    /// Returns the numbers of places with these forces, and `count` derivatives of each.
    fn prediction(
        &self,
        places: &[(f64, &Place)],
        found: Vec<Result<Vec<Gradient>>>,
        count: usize,
    ) -> Result<Prediction> {
        let mut prediction = Prediction {
            numbers: Vec::new(),
            slopes: Vec::new(),
        };
        for ((_, place), forces) in places.iter().zip(found) {
            let forces = forces?;
            for observed in &place.observed {
                let sum = |of: &dyn Fn(&Gradient) -> f64| -> f64 {
                    let terms = observed.weights.iter();
                    terms.map(|(k, weight)| weight * of(&forces[*k])).sum()
                };
                prediction.numbers.push(sum(&|force| force.value));
                let by = |k: usize| sum(&|force: &Gradient| force.derivatives[k]);
                prediction.slopes.push((0..count).map(by).collect());
            }
        }
        Ok(prediction)
    }

    /// Presses at all `places`, with the radii of the fingertips in file units, on all cores. Returns the
    /// force at each depth of each with its derivatives by the unknowns, and by the stiffness of each element if
    /// `by_elements`, or why a place failed.
    ///
    /// # Errors
    /// [`Error::Cancelled`], and those of creating a simulator.
    pub fn press_all(
        &self,
        (values, by_elements): (&[f64], bool),
        places: &[(f64, &Place)],
        progress: ProgressFn,
    ) -> Result<Vec<Result<Vec<Gradient>>>> {
        let (scene, mesh) = self.with_values(values);
        let threads = match cfg!(target_arch = "wasm32") {
            true => 1,
            false => std::thread::available_parallelism().map_or(1, usize::from),
        };
        let next = AtomicUsize::new(0);
        let (sender, receiver) = mpsc::channel();
        let work = |sender: mpsc::Sender<(usize, Result<Vec<Gradient>>)>| {
            let mut made: Option<(f64, Presser, Chain)> = None;
            loop {
                let k = next.fetch_add(1, Ordering::Relaxed);
                let Some((radius, place)) = places.get(k) else {
                    return;
                };
                let forces = self.press(
                    &mut made,
                    (&scene, &mesh, (values, by_elements)),
                    (*radius, place),
                );
                if sender.send((k, forces)).is_err() {
                    return;
                }
            }
        };
        let mut found: Vec<Option<Result<Vec<Gradient>>>> = places.iter().map(|_| None).collect();
        std::thread::scope(|scope| {
            for _ in 1..threads.min(places.len()) {
                let sender = sender.clone();
                scope.spawn(|| work(sender));
            }
            if threads == 1 || places.len() == 1 {
                work(sender);
            } else {
                scope.spawn(|| work(sender));
            }
            let mut done = 0;
            while let Ok((k, forces)) = receiver.recv() {
                found[k] = Some(forces);
                done += 1;
                let share = f64::from(done) / places.len() as f64;
                let scope = ProgressScope::begin(progress, "pressing", share);
                if let Err(cancelled) = scope.and_then(|scope| scope.check_cancelled()) {
                    next.store(usize::MAX / 2, Ordering::Relaxed);
                    return Err(cancelled);
                }
            }
            Ok(())
        })?;
        let unknown = || Err(Error::Input("a press was not made".into()));
        Ok(found
            .into_iter()
            .map(|one| one.unwrap_or_else(unknown))
            .collect())
    }

    /// Presses at a place with the simulator that is `made` already, or a new one.
    fn press(
        &self,
        made: &mut Option<(f64, Presser, Chain)>,
        (scene, mesh, asked): (&Scene, &TetMesh, (&[f64], bool)),
        (radius, place): (f64, &Place),
    ) -> Result<Vec<Gradient>> {
        if made.as_ref().is_none_or(|(own, ..)| *own != radius) {
            let presser = Presser::new(self.gpu, scene, mesh, radius)?;
            let chain = self.chain(asked, presser.simulator())?;
            *made = Some((radius, presser, chain));
        }
        let Some((_, presser, chain)) = made else {
            return Ok(Vec::new());
        };
        let site = presser.site(place.at, place.outward)?;
        let depths: Vec<f64> = place.depths.iter().map(|d| d / presser.unit()).collect();
        let is_wanted = |k: usize| {
            let mut weights = place.observed.iter().flat_map(|observed| &observed.weights);
            weights.any(|(own, _)| *own == k)
        };
        let forces = presser.press(site, &depths, (&chain.parameters, &is_wanted))?;
        Ok(forces
            .into_iter()
            .map(|force| Gradient {
                derivatives: chain.by_unknowns(&force.derivatives),
                ..force
            })
            .collect())
    }

    /// Returns how the unknowns depend on parameters of the engine.
    fn chain(
        &self,
        (values, by_elements): (&[f64], bool),
        simulator: &dyn Simulator,
    ) -> Result<Chain> {
        let mut chain = Chain {
            parameters: Vec::new(),
            terms: vec![Vec::new(); self.unknowns.len()],
        };
        for (k, unknown) in self.unknowns.iter().enumerate() {
            let tets = || self.tets[k].clone();
            let parameter = match unknown.kind {
                Kind::Young(_) => Parameter::Young { tets: tets() },
                Kind::Poisson(_) => Parameter::Poisson { tets: tets() },
                Kind::Density(_) => Parameter::Density { tets: tets() },
                _ => continue,
            };
            chain.terms[k].push((chain.parameters.len(), 1.0));
            chain.parameters.push(parameter);
        }
        let lump = self.lump_of(values);
        if lump.is_none() && !by_elements {
            return Ok(chain);
        }
        let elements = simulator.model().and_then(|model| model.elements());
        let elements = elements.ok_or_else(|| {
            Error::Input(
                "a lump needs finite elements; remove `stiffness` and `damping` of springs".into(),
            )
        })?;
        let numbers = elements.of_tets(simulator.mesh());
        let factors = lump.map(|lump| self.lump.field(&lump).values);
        // Young's modulus of an element without the field: the derivative by a parameter is by that.
        let of_tissue = |tets: &[u32]| {
            let tet = *tets.first()? as usize;
            let [mu, lambda] = elements.tets[numbers[tet]?].small_strain(elements.law);
            let young = mu * (3.0 * lambda + 2.0 * mu) / (lambda + mu);
            Some(young / factors.as_ref().map_or(1.0, |factors| factors[tet]))
        };
        for (tets, slope) in lump.map(|lump| self.lump.slopes(&lump)).unwrap_or_default() {
            let Some(young) = of_tissue(&tets) else {
                continue;
            };
            for (k, unknown) in self.unknowns.iter().enumerate() {
                let by = slope.by(&unknown.kind);
                if by != 0.0 {
                    chain.terms[k].push((chain.parameters.len(), young * by));
                }
            }
            chain.parameters.push(Parameter::Young { tets });
        }
        if by_elements {
            for tets in self.lump.tets() {
                // Rigid elements have no stiffness.
                let term = of_tissue(&tets).map(|young| (chain.parameters.len(), young));
                chain.terms.push(term.into_iter().collect());
                if term.is_some() {
                    chain.parameters.push(Parameter::Young { tets });
                }
            }
        }
        Ok(chain)
    }

    /// The elements, as far as a lump concerns them.
    pub fn lump_elements(&self) -> &LumpElements {
        &self.lump
    }

    /// The bounds of the body, in file units.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.mesh.bounds()
    }
}

impl FactorSlope {
    /// Returns d ln f by an unknown.
    fn by(&self, kind: &Kind) -> f64 {
        match kind {
            Kind::LumpPosition(axis) => self.by_middle.dot(DVec3::AXES[*axis]),
            Kind::LumpDiameter => self.by_diameter,
            Kind::LumpContrast => self.by_contrast,
            Kind::Young(_) | Kind::Poisson(_) | Kind::Density(_) | Kind::DampingRatio => 0.0,
        }
    }
}

impl Chain {
    fn by_unknowns(&self, derivatives: &[f64]) -> Vec<f64> {
        let of = |terms: &Vec<(usize, f64)>| -> f64 {
            terms
                .iter()
                .map(|(k, factor)| factor * derivatives[*k])
                .sum()
        };
        self.terms.iter().map(of).collect()
    }
}

/// Returns `of(0)`, `of(1)` … on as many threads as there are cores: each may wait for a simulator, which
/// a pool's threads must not.
fn on_threads<T: Send>(count: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let threads = match cfg!(target_arch = "wasm32") {
        true => 1,
        false => std::thread::available_parallelism().map_or(1, usize::from),
    };
    let (next, found) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let work = || {
        loop {
            let n = next.fetch_add(1, Ordering::Relaxed);
            if n >= count {
                return;
            }
            let one = of(n);
            found
                .lock()
                .unwrap_or_else(|e| e.into_inner())
                .push((n, one));
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads.min(count) {
            scope.spawn(work);
        }
        work();
    });
    let mut found = found.into_inner().unwrap_or_else(|e| e.into_inner());
    found.sort_by_key(|(n, _)| *n);
    found.into_iter().map(|(_, one)| one).collect()
}
