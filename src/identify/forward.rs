//! The forces that a scene predicts for the experiments, and their derivatives by the unknowns.

use super::IdentifyOptions;
use super::data::{Experiment, Observed, Place};
use super::lump::{FACTOR_FIELD, FactorSlope, Lump, LumpElements};
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
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// Noise for which standard deviations are calculated if none is stated; it is estimated then.
const UNIT_NOISE: f64 = 0.01;
/// Depths beyond this part of the smallest extent of a body are taken for an error of units.
const MAX_DEPTH: f64 = 0.9;

/// Predicted numbers, and for each its derivative by each unknown.
pub(super) struct Prediction {
    pub numbers: Vec<f64>,
    pub slopes: Vec<Vec<f64>>,
}

/// The body of a scene, the experiments and the unknowns.
pub(super) struct PressedBody<'a> {
    pub gpu: &'a Gpu,
    scene: Scene,
    mesh: TetMesh,
    unknowns: Vec<ScaledUnknown>,
    pub experiments: Vec<Experiment>,
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

impl<'a> PressedBody<'a> {
    /// Prepares the body.
    ///
    /// # Errors
    /// As [`super::identify`].
    pub fn new(
        gpu: &'a Gpu,
        scene: &Scene,
        data: &[Experiment],
        options: &IdentifyOptions,
    ) -> Result<PressedBody<'a>> {
        if options.unknowns.is_empty() {
            return Err(Error::Input(
                "there is no unknown to identify; name some (--unknown material.young)".into(),
            ));
        }
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
        if !data.iter().any(|experiment| experiment.is_map) {
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
            Kind::Young(tissue) | Kind::Poisson(tissue) => {
                scene.material.tets_of(tissue.as_deref(), &mesh)
            }
            _ => Ok(Vec::new()),
        });
        let tets: Vec<Vec<u32>> = tets.collect::<Result<_>>()?;
        let empty = |(unknown, tets): &(&ScaledUnknown, &Vec<u32>)| {
            let of_tissue = matches!(unknown.kind, Kind::Young(_) | Kind::Poisson(_));
            of_tissue && tets.is_empty()
        };
        if let Some((unknown, _)) = unknowns.iter().zip(&tets).find(empty) {
            return Err(Error::Input(format!(
                "the data do not depend on {}: no tet consists of it",
                unknown.name
            )));
        }
        let mut body = PressedBody {
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
        let first = data
            .first()
            .ok_or_else(|| Error::Input("there are no data; give some (--data)".into()))?;
        let presser = Presser::new(self.gpu, &self.scene, &self.mesh, first.in_unit(1.0).radius)?;
        let unit = presser.unit();
        self.unit = unit;
        let (low, high) = self.mesh.bounds();
        let thin = unit * (high - low).min_element();
        for experiment in data {
            let experiment = experiment.in_unit(unit);
            for place in &experiment.places {
                let about = |why: &Error| Error::Input(format!("{}: {why}", experiment.name));
                presser
                    .site(place.at, place.outward)
                    .map_err(|why| about(&why))?;
                let deepest = place.depths.iter().copied().fold(0.0, f64::max);
                if deepest > MAX_DEPTH * thin {
                    return Err(Error::Input(format!(
                        "{}: a depth of {deepest} m is more than the body is thick ({thin} m at most); depths must be in metres, and the scene needs the unit of its mesh ([mesh] unit)",
                        experiment.name
                    )));
                }
                for observed in &place.observed {
                    self.sigma.push(noise * observed.scale);
                    self.observations.push(observed.clone());
                }
            }
            self.experiments.push(experiment);
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
        self.prediction(&places, found, self.unknowns.len())
    }

    /// As [`PressedBody::predict`], and for each number its derivatives by the logarithm of the stiffness
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

    /// All places, with the radii of the fingertips.
    fn places(&self) -> Vec<(f64, &Place)> {
        let all = self.experiments.iter().flat_map(|experiment| {
            let places = experiment.places.iter();
            places.map(|place| (experiment.radius, place))
        });
        all.collect()
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
            Kind::Young(_) | Kind::Poisson(_) => 0.0,
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
