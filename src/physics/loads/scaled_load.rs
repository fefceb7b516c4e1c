//! Loads scaled by a time-dependent amplitude: pressure on faces and muscles.

use crate::mesh::{BoundaryFace, TetCut, TetMesh};
use crate::physics::DiscreteModel;
use crate::{Error, Result};
use glam::DVec3;

/// Identifies an amplitude of a body: a pressure in Pa, or a muscle activation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AmplitudeId(pub(in crate::physics) usize);

impl AmplitudeId {
    /// Returns the amplitude of the load of a body that was added after `index` others.
    pub fn from_index(index: usize) -> AmplitudeId {
        AmplitudeId(index)
    }
}

/// Tets that contract along fibres.
///
/// Ψ = ½ a T |F m|² per volume at rest, where m is the fibre direction at rest, T the tension at
/// full activation and a the activation (Modi et al. 2021, "EMU: Efficient Muscle Simulation in
/// Deformation Space", section 3): an active Cauchy stress a T (F m)(F m)ᵀ/J with a constant
/// Hessian.
#[derive(Clone, Debug, PartialEq)]
pub struct Muscle {
    /// Tets of the mesh with their fibre directions at rest, unit vectors.
    pub fibres: Vec<(u32, DVec3)>,
    /// Tension T at full activation, Pa.
    pub tension: f64,
}

/// A load scaled by an amplitude.
#[derive(Clone, Debug, PartialEq)]
pub enum ScaledLoad {
    /// Pressure on these tet faces, of the boundary or of interfaces between regions, along their
    /// current normals (a follower load): positive into the tet. The amplitude is the pressure in
    /// Pa.
    Pressure(Vec<BoundaryFace>),
    /// A muscle, for finite elements. The amplitude is the activation, from 0 to 1.
    Muscle(Muscle),
}

impl ScaledLoad {
    /// Validates the load for the body of `mesh` and `model`.
    pub(in crate::physics) fn check(&self, mesh: &TetMesh, model: &DiscreteModel) -> Result<()> {
        let tets = mesh.tets.len() as u32;
        match self {
            ScaledLoad::Pressure(faces) => {
                let strange = |f: &BoundaryFace| f.tet >= tets || f.face > 3;
                if faces.is_empty() || faces.iter().any(strange) {
                    return Err(Error::Input(format!(
                        "invalid pressure on {} faces of a mesh of {tets} tets; give at least one face, and only faces of its tets",
                        faces.len()
                    )));
                }
            }
            ScaledLoad::Muscle(Muscle { fibres, tension }) => {
                if model.elements().is_none() {
                    return Err(Error::Input(
                        "a muscle requires finite elements, but the body is made of springs; use --material neo-hookean (or corotated)".into(),
                    ));
                }
                let strange = |(tet, along): &(u32, DVec3)| *tet >= tets || !along.is_normalized();
                if fibres.is_empty() || fibres.iter().any(strange) {
                    return Err(Error::Input(format!(
                        "invalid muscle of {} tets; give a fibre of length 1 for each, and only tets of the mesh, which has {tets}",
                        fibres.len()
                    )));
                }
                if !(tension.is_finite() && *tension >= 0.0) {
                    return Err(Error::Input(format!(
                        "muscle tension must be finite and ≥ 0, got {tension} Pa"
                    )));
                }
            }
        }
        Ok(())
    }

    /// Validates an amplitude.
    pub(in crate::physics) fn check_amplitude(&self, level: f64) -> Result<()> {
        match self {
            ScaledLoad::Pressure(_) if level.is_finite() => Ok(()),
            ScaledLoad::Muscle(_) if (0.0..=1.0).contains(&level) => Ok(()),
            ScaledLoad::Pressure(_) => Err(Error::Input(format!(
                "pressure must be finite, got {level} Pa"
            ))),
            ScaledLoad::Muscle(_) => Err(Error::Input(format!(
                "muscle activation must be from 0 to 1, got {level}"
            ))),
        }
    }

    /// Updates the load after a cut: removed tets and faces no longer carry it, and newly exposed
    /// faces are free of pressure.
    pub(in crate::physics) fn apply_cut(&mut self, cut: &TetCut) {
        let removed = &cut.removed;
        if removed.is_empty() {
            return;
        }
        let stays = |tet: &mut u32| match removed.binary_search(tet) {
            Ok(_) => false,
            Err(before) => {
                *tet -= before as u32;
                true
            }
        };
        match self {
            ScaledLoad::Pressure(faces) => faces.retain_mut(|f| stays(&mut f.tet)),
            ScaledLoad::Muscle(muscle) => muscle.fibres.retain_mut(|(tet, _)| stays(tet)),
        }
    }
}
