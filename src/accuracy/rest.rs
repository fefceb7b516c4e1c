//! The errors of the numbers of a body at rest or in slow motion.

use super::{ErrorParts, RestBody, error_stage, mesh_factor, settle, with_error_field};
use crate::gpu::Gpu;
use crate::mesh::{TetMesh, signed_volume};
use crate::progress::ProgressScope;
use crate::scene::{Motion, Scene, Stage};
use crate::{Error, ProgressFn, Result};
use glam::DVec3;
use serde::Serialize;
use web_time::Instant;

/// Name of the estimate in progress reports.
const WHAT: &str = "estimating the error";

/// Largest kinetic energy of a body whose errors are estimated, over the elastic energy. Its motion is
/// part of the error.
pub(super) const MAX_KINETIC_SHARE: f64 = 0.01;

/// Estimated errors of the numbers of a body at rest or in slow motion, as those of its equilibrium
/// under the loads of the moment: pressures, muscles, moved and grabbed nodes and tools are held.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RestErrors {
    /// Parts of the error of the largest nodal displacement, file units.
    pub max_displacement: ErrorParts,
    /// Parts of the error of the elastic energy, J.
    pub elastic_energy: ErrorParts,
    /// Parts of the error of the ratio of the volume to that at rest.
    pub volume_ratio: ErrorParts,
    /// The force on each pin and tool.
    pub forces: Vec<ForceError>,
    /// Number of elements of the finer space.
    pub finer_elements: usize,
    /// Computing time of the estimate, s.
    pub seconds: f64,
    /// Share of each tet in the error in energy, %.
    #[serde(skip)]
    tet_shares: Vec<f64>,
}

/// The length of a reaction and its error.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ForceError {
    /// Name of the pin or tool.
    pub name: String,
    /// Length of the force, N.
    pub force_n: f64,
    /// Parts of its error, N.
    pub error_n: ErrorParts,
}

impl RestErrors {
    /// Estimates the errors of the body of `stage`: solves its equilibrium under the present loads again
    /// in a finer space. The inner error says why there is no estimate.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled), and errors of the device.
    pub fn estimate(
        stage: &mut Stage,
        progress: ProgressFn,
    ) -> Result<std::result::Result<RestErrors, String>> {
        let (gpu, scene) = stage.origin();
        let (gpu, scene) = (gpu.clone(), scene.clone());
        let Some(motion) = stage.motion_mut() else {
            return Ok(Err("the body is static".into()));
        };
        if kinetic_share(motion)? > MAX_KINETIC_SHARE {
            return Ok(Err(
                "the body is in fast motion: its errors are estimated at rest or in slow motion, which more steps may reach (--steps)".into(),
            ));
        }
        match errors_at_rest(&gpu, (&scene, motion), progress) {
            Ok(errors) => Ok(Ok(errors)),
            Err(Error::Input(why)) => Ok(Err(why)),
            Err(Error::Solver { what, .. }) => Ok(Err(format!(
                "the finer body has no equilibrium near this one ({what}); use a finer mesh (--tets)"
            ))),
            Err(other) => Err(other),
        }
    }

    /// Returns the body of `stage`, which has not moved since, with the field `error`: the share of
    /// each tet in the error in energy, %. Where it is high, the mesh is too coarse.
    ///
    /// # Errors
    /// [`Error::Input`] for the stage of another body.
    pub fn mesh(&self, stage: &Stage) -> Result<TetMesh> {
        with_error_field(stage.deformed_mesh()?, &self.tet_shares)
    }

    /// Returns a static stage of [`RestErrors::mesh`], seen as `stage`.
    ///
    /// # Errors
    /// As [`RestErrors::mesh`] and [`Stage::with_mesh`].
    pub fn picture(&self, stage: &mut Stage) -> Result<Stage> {
        error_stage(self.mesh(stage)?, stage)
    }
}

/// Returns the kinetic energy of a body over its elastic energy.
pub(super) fn kinetic_share(motion: &Motion) -> Result<f64> {
    let energy = motion.report()?.energy;
    Ok(match energy.kinetic > 0.0 && !motion.asleep() {
        true => energy.kinetic / energy.elastic,
        false => 0.0,
    })
}

/// Estimates the errors of the body of `motion`, which simulates `scene` and is at rest or slow.
///
/// # Errors
/// [`Error::Input`] for a body whose errors cannot be estimated; [`Error::Solver`] if the finer body
/// has no equilibrium near the given one.
pub(crate) fn errors_at_rest(
    gpu: &Gpu,
    (scene, motion): (&Scene, &mut Motion),
    progress: ProgressFn,
) -> Result<RestErrors> {
    let start = Instant::now();
    let report = |share: f64| ProgressScope::begin(progress, WHAT, share).map(drop);
    report(0.0)?;
    let body = RestBody::new(scene, motion)?;
    let dt = body.quasi_static_step;
    let forces = motion.reactions().unwrap_or_default();
    // Unknown at nodes of rigid regions.
    let known = forces.iter().filter(|(_, on)| on.force.is_finite());
    let numbers = Numbers {
        rest: body.mesh().nodes.clone(),
        names: known.map(|(name, _)| name.clone()).collect(),
    };
    let positions = motion.positions()?;
    let given = numbers.measure(motion)?;
    let (mut finer, mut same) = (body.finer(gpu)?, body.copy(gpu)?);
    report(0.1)?;
    let own = settle(&mut same, (&positions, dt), &mut |m| numbers.measure(m))?;
    report(0.2)?;
    let start_of_finer = finer.positions_from(&positions);
    let fine = settle(&mut finer.motion, (&start_of_finer, dt), &mut |m| {
        numbers.measure(m)
    })?;
    report(1.0)?;
    let factor = mesh_factor(body.order());
    // Bounds the amplitude of an oscillation, also while it passes through the equilibrium.
    let amplitude = kinetic_share(motion)?.sqrt();
    let swing = |k: usize| match k {
        1 => 2.0 * amplitude * given[k],
        2 => amplitude * (given[k] - 1.0).abs(),
        _ => amplitude * given[k],
    };
    let parts = |k: usize| ErrorParts {
        mesh: factor * (own.values[k] - fine.values[k]).abs(),
        time: (given[k] - own.values[k]).abs() + swing(k),
        solver: own.changes[k] + fine.changes[k],
        contact: 0.0,
        support: 0.0,
    };
    let force = |(k, name): (usize, &String)| ForceError {
        name: name.clone(),
        force_n: given[k],
        error_n: parts(k),
    };
    Ok(RestErrors {
        max_displacement: parts(0),
        elastic_energy: parts(1),
        volume_ratio: parts(2),
        forces: (Numbers::OF_BODY..)
            .zip(&numbers.names)
            .map(force)
            .collect(),
        finer_elements: finer.elements(),
        seconds: start.elapsed().as_secs_f64(),
        tet_shares: finer.shares_of_difference(&start_of_finer)?,
    })
}

/// The numbers of a body whose errors are estimated.
struct Numbers {
    /// Rest positions of the nodes of the coarser body.
    rest: Vec<DVec3>,
    /// Names of the pins and tools.
    names: Vec<String>,
}

impl Numbers {
    /// How many there are besides the forces.
    const OF_BODY: usize = 3;

    /// Returns the largest displacement of the coarser body's nodes, the elastic energy, the volume
    /// ratio and the length of each force.
    fn measure(&self, motion: &mut Motion) -> Result<Vec<f64>> {
        let x = motion.positions()?;
        let moved = x.iter().zip(&self.rest).map(|(x, rest)| x.distance(*rest));
        let farthest = moved.fold(0.0, f64::max);
        let energy = motion.report()?.energy.elastic;
        let mesh: &TetMesh = motion.simulator.mesh();
        let volume: f64 = mesh
            .tets
            .iter()
            .map(|tet| signed_volume(tet.map(|v| x[v as usize])))
            .sum();
        let ratio = volume / mesh.volume();
        let forces = match self.names.is_empty() {
            true => Vec::new(),
            false => motion.reactions()?,
        };
        let length = |name: &String| {
            let found = forces.iter().find(|(own, _)| own == name);
            found.map_or(f64::NAN, |(_, on)| on.force.length())
        };
        let forces = self.names.iter().map(length);
        Ok([farthest, energy, ratio]
            .into_iter()
            .chain(forces)
            .collect())
    }
}
