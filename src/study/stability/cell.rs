//! One cell of a stability map: a body released under gravity, stepped, and compared with float64.

use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::linearised_model::LinearisedModel;
use crate::physics::{
    CgSettings, CpuTets, DiscreteModel, EngineChoice, Material, Precision, Simulator, SolverKind,
};
use crate::{Error, FailureCause, Result};
use glam::DVec3;

/// Maximum and minimum steps of a cell: instability needs some steps to show.
const STEPS: [u32; 2] = [40, 500];

/// Duration of the observed motion, in largest stable steps of undamped Verlet: two or three
/// oscillations.
const OBSERVED_STEPS: f64 = 200.0;

/// Number of comparisons with the reference.
const SAMPLES: u32 = 4;

/// Maximum error of an accurate motion: RMS over the nodes, relative to the largest RMS
/// displacement of the reference.
pub const ACCURATE: f64 = 0.1;

const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);

/// A solver of the maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Method {
    pub name: &'static str,
    pub kind: SolverKind,
    /// Maximum iterations per step, if below the solver's own limit.
    pub iterations: Option<u32>,
}

impl Method {
    fn settings(&self) -> CgSettings {
        let default = CgSettings::default();
        CgSettings {
            max_iterations: self.iterations.unwrap_or(default.max_iterations),
            ..default
        }
    }
}

/// Result of a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// An index into [`STATES`].
    pub state: usize,
    /// RMS error over the nodes, relative to the largest displacement of the reference; NaN if the
    /// run ended before the first comparison.
    pub error: f64,
    /// Steps completed.
    pub steps: u64,
}

/// The states of a cell.
pub const STATES: [&str; 4] = ["stable", "inaccurate", "diverged", "CG not converged"];

/// A body to be released, with its float64 reference motion.
pub struct Trial {
    mesh: TetMesh,
    material: Material,
    pinned: Vec<u32>,
    /// Reference positions in file units at equal intervals, from time 0.
    truth: Vec<Vec<DVec3>>,
    /// Interval between them and total duration, s.
    interval: f64,
    watched: f64,
    /// Largest RMS displacement of the reference, in file units.
    largest: f64,
    linear: LinearisedModel,
}

impl Trial {
    /// Creates the trial of `mesh` and `material`, pinned where `held` is true.
    pub fn new(
        gpu: &Gpu,
        mesh: &TetMesh,
        material: &Material,
        held: impl Fn(DVec3) -> bool,
    ) -> Result<Trial> {
        let model = DiscreteModel::new(mesh, material)?;
        let pinned: Vec<bool> = mesh.nodes.iter().map(|p| held(*p)).collect();
        let linear = LinearisedModel::new(&model, &pinned);
        let undamped = 2.0 / linear.stiffest_mode().stiffness.sqrt();
        let limit = linear.largest_step(SolverKind::VelocityVerlet);
        let limit = limit.map_or(undamped, |l| l.step);
        // A fraction of both: stiff damping must be stable, but need not be resolved.
        let step = (undamped / 16.0).min(limit / 3.0);
        let watched = OBSERVED_STEPS * undamped;
        let samples = 1000usize;
        let each = (watched / samples as f64 / step).ceil() as usize;
        let interval = watched / samples as f64;
        let step = interval / each as f64;
        let held: Vec<u32> = (0u32..)
            .zip(&pinned)
            .filter(|h| *h.1)
            .map(|h| h.0)
            .collect();
        let settings = CgSettings::default();
        let kind = SolverKind::VelocityVerlet;
        let mut body = CpuTets::of_model(
            gpu,
            (mesh.clone(), model),
            material,
            (kind, settings),
            Precision::Double,
        )?;
        body.pin_nodes(&held)?;
        body.loads_mut().set_gravity(GRAVITY);
        let mut truth = vec![mesh.nodes.clone()];
        for _ in 0..samples {
            body.run(each as u32, step)?;
            truth.push(body.positions()?);
        }
        let largest = truth
            .iter()
            .map(|x| rms_distance(x, &mesh.nodes))
            .fold(0.0, f64::max);
        Ok(Trial {
            mesh: mesh.clone(),
            material: material.clone(),
            pinned: held,
            truth,
            interval,
            watched,
            largest,
            linear,
        })
    }

    /// Returns the largest stable step of `kind` by linear theory, s; none if there is no limit.
    pub fn limit(&self, kind: SolverKind) -> Option<f64> {
        self.linear.largest_step(kind).map(|l| l.step)
    }

    /// Releases the body and steps it by `h` seconds.
    pub fn run(&self, gpu: &Gpu, method: Method, h: f64) -> Result<Outcome> {
        let model = DiscreteModel::new(&self.mesh, &self.material)?;
        let own = (self.mesh.clone(), model);
        let how = (method.kind, method.settings());
        let mut body = EngineChoice::Auto.build_tets_from_model(gpu, own, &self.material, how)?;
        body.pin_nodes(&self.pinned)?;
        body.loads_mut().set_gravity(GRAVITY);
        let within = (self.watched / h).floor();
        let compared = within.clamp(1.0, f64::from(STEPS[1])) as u32;
        let total = compared.max(STEPS[0]);
        let (mut done, mut error) = (0, f64::NAN);
        let stops = (1..=SAMPLES).map(|s| (compared * s / SAMPLES, true));
        for (stop, compare) in stops.chain([(total, false)]) {
            if stop <= done {
                continue;
            }
            match body.run(stop - done, h) {
                Ok(_) => done = stop,
                Err(Error::Solver { step, cause, .. }) => {
                    let state = match cause {
                        FailureCause::NotConverged => 3,
                        _ => 2,
                    };
                    let steps = step - 1;
                    return Ok(Outcome {
                        state,
                        error,
                        steps,
                    });
                }
                Err(other) => return Err(other),
            }
            if compare {
                let truth = self.truth_at(f64::from(done) * h);
                let off = rms_distance(&body.positions()?, &truth) / self.largest;
                error = error.max(off);
            }
        }
        Ok(Outcome {
            state: usize::from(error > ACCURATE),
            error,
            steps: u64::from(done),
        })
    }

    /// Returns the interpolated reference positions; after the end, the last ones.
    fn truth_at(&self, time: f64) -> Vec<DVec3> {
        let at = time / self.interval;
        let last = self.truth.len() - 1;
        let before = (at.floor() as usize).min(last);
        let after = (before + 1).min(last);
        let share = (at - before as f64).clamp(0.0, 1.0);
        let pairs = self.truth[before].iter().zip(&self.truth[after]);
        pairs.map(|(a, b)| a.lerp(*b, share)).collect()
    }
}

/// Returns the RMS distance.
fn rms_distance(a: &[DVec3], b: &[DVec3]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum();
    (sum / a.len() as f64).sqrt()
}
