//! The errors of the numbers of a body at rest.

use super::{ErrorParts, FinerBody, copy_at_rest, mesh_factor, quasi_static_step, settle};
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

/// Largest kinetic energy of a body that counts as at rest, over the elastic energy. What is left of
/// its motion is part of the error.
const MAX_KINETIC_SHARE: f64 = 1e-4;

/// Estimated errors of the numbers of a body at rest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RestErrors {
    /// Parts of the error of the largest nodal displacement, file units.
    pub max_displacement: ErrorParts,
    /// Parts of the error of the elastic energy, J.
    pub elastic_energy: ErrorParts,
    /// Parts of the error of the ratio of the volume to that at rest.
    pub volume_ratio: ErrorParts,
    /// Parts of the error of the force on each tool: of its length, N.
    pub tool_forces: Vec<ErrorParts>,
    /// Number of elements of the finer space.
    pub finer_elements: usize,
    /// Computing time of the estimate, s.
    pub seconds: f64,
}

impl RestErrors {
    /// Estimates the errors of the body of `stage`, which is at rest: solves its equilibrium again in a
    /// finer space. The inner error says why there is no estimate.
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
        let energy = motion.report()?.energy;
        if !motion.asleep() && energy.kinetic > MAX_KINETIC_SHARE * energy.elastic {
            return Ok(Err(
                "the body is in motion: its errors are estimated at rest, which more steps reach (--steps)".into(),
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
}

/// Estimates the errors of the body of `motion`, which simulates `scene` and is at rest.
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
    check_static(motion)?;
    let rest = motion.simulator.mesh().nodes.clone();
    let positions = motion.positions()?;
    let given = numbers(motion, &rest)?;
    let dt = quasi_static_step(motion);
    let mut finer = FinerBody::new(gpu, scene, motion)?;
    let mut same = copy_at_rest(gpu, scene, motion)?;
    report(0.1)?;
    let own = settle(&mut same, (&positions, dt), &mut |m| numbers(m, &rest))?;
    report(0.2)?;
    let start_of_finer = finer.positions_from(&positions);
    let fine = settle(&mut finer.motion, (&start_of_finer, dt), &mut |m| {
        numbers(m, &rest)
    })?;
    report(1.0)?;
    let factor = mesh_factor(motion.simulator.mesh().order);
    let parts = |k: usize| ErrorParts {
        mesh: factor * (given[k] - fine.values[k]).abs(),
        time: (given[k] - own.values[k]).abs(),
        solver: own.changes[k] + fine.changes[k],
        contact: 0.0,
    };
    Ok(RestErrors {
        max_displacement: parts(0),
        elastic_energy: parts(1),
        volume_ratio: parts(2),
        tool_forces: (NUMBERS..given.len()).map(parts).collect(),
        finer_elements: finer.elements(),
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// Number of [`numbers`] besides the forces on tools.
const NUMBERS: usize = 3;

/// Returns the largest displacement of the first nodes, which are at `rest` without loads, the
/// elastic energy, the volume ratio and the force on each tool.
fn numbers(motion: &mut Motion, rest: &[DVec3]) -> Result<Vec<f64>> {
    let x = motion.positions()?;
    let moved = x.iter().zip(rest).map(|(x, rest)| x.distance(*rest));
    let farthest = moved.fold(0.0, f64::max);
    let energy = motion.report()?.energy.elastic;
    let mesh: &TetMesh = motion.simulator.mesh();
    let volume: f64 = mesh
        .tets
        .iter()
        .map(|tet| signed_volume(tet.map(|v| x[v as usize])))
        .sum();
    let ratio = volume / mesh.volume();
    let forces = motion.tool_reactions()?;
    let forces = forces.iter().map(|(_, on)| on.force.length());
    Ok([farthest, energy, ratio]
        .into_iter()
        .chain(forces)
        .collect())
}

/// Refuses bodies with loads that depend on time, or grabs.
fn check_static(motion: &Motion) -> Result<()> {
    match motion.has_constant_loads() {
        true => Ok(()),
        false => Err(Error::Input(
            "the errors of a body are estimated at rest under constant loads, but this scene has grabs, free tools, or paths or loads that depend on time"
                .into(),
        )),
    }
}
