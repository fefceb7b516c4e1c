//! What a scene predicts for presses, with derivatives by the adjoint method.

use super::chain::{Chain, DerivedBy};
use super::data::Place;
use super::forward::{BodyExperiment, MeasuredBody, Prediction};
use super::unknown::Kind;
use crate::mesh::TetMesh;
use crate::physics::Gradient;
use crate::press::Presser;
use crate::progress::ProgressScope;
use crate::scene::Scene;
use crate::{Error, ProgressFn, Result};
use glam::DVec3;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// Change of θ of differences.
const DIFFERENCE: f64 = 0.02;

impl MeasuredBody<'_> {
    /// Returns the numbers of all presses, with derivatives by the adjoint method, or by central differences by
    /// how far the fingertip was off.
    ///
    /// # Errors
    /// As a press.
    pub(super) fn predict_presses(
        &self,
        values: &[f64],
        progress: ProgressFn,
    ) -> Result<Prediction> {
        let count = self.unknowns.len();
        let numbers = |values: &[f64]| {
            let places = self.places_at(values);
            let places: Vec<(f64, &Place)> = places.iter().map(|(r, p)| (*r, p)).collect();
            let asked = (values, DerivedBy::Unknowns);
            let found = self.press_all(asked, &places, progress)?;
            self.prediction(&places, found, count)
        };
        let mut prediction = numbers(values)?;
        for (k, unknown) in self.unknowns.iter().enumerate() {
            if !unknown.kind.by_differences() {
                continue;
            }
            let theta = unknown.theta(values[k]);
            let ends = [theta + DIFFERENCE, theta - DIFFERENCE].map(|theta| unknown.value(theta));
            let [up, down] = ends.map(|value| {
                let mut other = values.to_vec();
                other[k] = value;
                numbers(&other)
            });
            let (up, down) = (up?.numbers, down?.numbers);
            let pairs = up.iter().zip(&down);
            for (row, (up, down)) in prediction.slopes.iter_mut().zip(pairs) {
                row[k] = (up - down) / (ends[0] - ends[1]);
            }
        }
        Ok(prediction)
    }

    /// Returns all numbers of presses without derivatives, in the order of the observations; `None` for those of
    /// recordings.
    ///
    /// # Errors
    /// As a press.
    pub(super) fn predict_forces(
        &self,
        values: &[f64],
        progress: ProgressFn,
    ) -> Result<Vec<Option<f64>>> {
        let places = self.places_at(values);
        let places: Vec<(f64, &Place)> = places.iter().map(|(r, p)| (*r, p)).collect();
        let found = self.press_all((values, DerivedBy::Nothing), &places, progress)?;
        let mut forces = self.prediction(&places, found, 0)?.numbers.into_iter();
        let mut numbers = Vec::new();
        for experiment in &self.experiments {
            for _ in experiment.observed() {
                let is_press = experiment.presses().is_some();
                numbers.push(is_press.then(|| forces.next()).flatten());
            }
        }
        Ok(numbers)
    }

    /// Returns all places as the fingertip was off by the values of these unknowns.
    fn places_at(&self, values: &[f64]) -> Vec<(f64, Place)> {
        let mut offset = DVec3::ZERO;
        for (unknown, value) in self.unknowns.iter().zip(values) {
            if let Kind::FingerOffset(axis) = unknown.kind {
                offset[axis] += *value;
            }
        }
        let places = self.places().into_iter();
        let moved = places.map(|(radius, place)| {
            let mut place = place.clone();
            place.at += offset;
            (radius, place)
        });
        moved.collect()
    }

    /// As [`MeasuredBody::predict`], and for each number its derivatives by the logarithm of the stiffness
    /// of each element; both times `ratios`, which may be none.
    ///
    /// # Errors
    /// As a press.
    pub fn predict_by_elements(
        &self,
        values: &[f64],
        (ratios, progress): (&[f64], ProgressFn),
    ) -> Result<(Prediction, Vec<Vec<f64>>)> {
        let places = self.places();
        let found = self.press_all((values, DerivedBy::UnknownsAndElements), &places, progress)?;
        let count = self.unknowns.len();
        let all = count + self.lump.tets().len();
        let mut prediction = self.prediction(&places, found, all)?;
        prediction.multiply_by(ratios);
        let rows = prediction.slopes.iter_mut();
        let by_element = rows.map(|row| row.split_off(count)).collect();
        Ok((prediction, by_element))
    }

    /// All places that were pressed, with the radii of the fingertips.
    pub(super) fn places(&self) -> Vec<(f64, &Place)> {
        let presses = self.experiments.iter().filter_map(BodyExperiment::presses);
        presses
            .flat_map(|presses| presses.places.iter().map(|place| (presses.radius, place)))
            .collect()
    }

    /// Returns the numbers of places with these forces, and `count` derivatives of each.
    pub(super) fn prediction(
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
    /// force at each depth of each with the derivatives that are asked for, or why a place failed.
    ///
    /// # Errors
    /// [`Error::Cancelled`], and those of creating a simulator.
    pub fn press_all(
        &self,
        (values, by): (&[f64], DerivedBy),
        places: &[(f64, &Place)],
        progress: ProgressFn,
    ) -> Result<Vec<Result<Vec<Gradient>>>> {
        let (scene, mesh) = self.with_values(values);
        let threads = match cfg!(target_arch = "wasm32") {
            true => 1,
            false => std::thread::available_parallelism().map_or(1, usize::from),
        };
        let stage = match by {
            DerivedBy::Nothing => "correcting",
            _ => "pressing",
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
                let forces = self.press(&mut made, (&scene, &mesh, (values, by)), (*radius, place));
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
                let scope = ProgressScope::begin(progress, stage, share);
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
        (scene, mesh, asked): (&Scene, &TetMesh, (&[f64], DerivedBy)),
        (radius, place): (f64, &Place),
    ) -> Result<Vec<Gradient>> {
        if made.as_ref().is_none_or(|(own, ..)| *own != radius) {
            let mut presser = Presser::new(self.gpu, scene, mesh, radius)?;
            if asked.1 != DerivedBy::Nothing {
                presser = presser.with_derivatives()?;
            }
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
            asked.1 != DerivedBy::Nothing && weights.any(|(own, _)| *own == k)
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
}
