//! The engines that compute the steps of a body, and their selection.

use super::Engine;
use super::grid::GridModel;
use super::{
    CgSettings, CpuGrid, CpuTets, DiscreteModel, GpuBody, GpuGrid, GpuTets, GridBody,
    ImplicitEuler, Material, Precision, Simulator, Solver, SolverKind, VolumetricFormulation,
};
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::{Error, Result};
use std::str::FromStr;

/// The engine that computes the steps of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EngineChoice {
    /// The GPU if there is one, else the CPU.
    #[default]
    Auto,
    /// The given engine.
    Exactly(Engine),
}

impl EngineChoice {
    /// Resolves the choice for the device `gpu`; a software adapter does not count as a GPU.
    pub fn resolve(self, gpu: &Gpu) -> Engine {
        match self {
            EngineChoice::Exactly(engine) => engine,
            EngineChoice::Auto if gpu.adapter().device_type == wgpu::DeviceType::Cpu => Engine::Cpu,
            EngineChoice::Auto => Engine::Gpu,
        }
    }
}

impl FromStr for EngineChoice {
    type Err = Error;

    fn from_str(name: &str) -> Result<EngineChoice> {
        match name {
            "auto" => Ok(EngineChoice::Auto),
            "gpu" => Ok(EngineChoice::Exactly(Engine::Gpu)),
            "cpu" => Ok(EngineChoice::Exactly(Engine::Cpu)),
            "rapier" => Ok(EngineChoice::Exactly(Engine::Rapier)),
            _ => Err(Error::Input(format!(
                "unknown engine \"{name}\"; expected auto, gpu, cpu or rapier"
            ))),
        }
    }
}

impl EngineChoice {
    /// A simulator of `mesh` made of `material`, at rest, with the solver `kind`, on the chosen
    /// engine.
    ///
    /// # Errors
    /// [`Error::Input`] if a material parameter is out of range, [`Error::Gpu`] if the mesh does
    /// not fit the device.
    pub fn build_tets(
        self,
        gpu: &Gpu,
        mesh: TetMesh,
        material: &Material,
        kind: SolverKind,
    ) -> Result<Box<dyn Simulator>> {
        let discrete_model = DiscreteModel::new(&mesh, material)?;
        let settings = CgSettings::default();
        self.build_tets_from_model(gpu, (mesh, discrete_model), material, (kind, settings))
    }

    /// A simulator of the particles of `model`, at rest, drawn as `mesh`, on the chosen engine.
    ///
    /// # Errors
    /// [`Error::Input`] if the mesh is not that of the model or the damping is out of range,
    /// [`Error::Gpu`] if the particles do not fit the device.
    pub fn build_grid(
        self,
        gpu: &Gpu,
        mesh: TetMesh,
        model: GridModel,
    ) -> Result<Box<dyn Simulator>> {
        let rate = model.damping;
        if !(rate.is_finite() && rate >= 0.0) {
            return Err(Error::Input(format!(
                "damping rate must be finite and ≥ 0, got {rate} 1/s"
            )));
        }
        Ok(match self.resolve(gpu) {
            Engine::Gpu => Box::new(GpuGrid::new(gpu, GridBody::new(gpu, model)?, mesh)?),
            Engine::Cpu => Box::new(CpuGrid::new(gpu, model, mesh, Precision::Single)?),
            Engine::Rapier => {
                return Err(Error::Input(
                    "rapier supports tet bodies only, not grids; remove [grid], or use --engine cpu or gpu".into(),
                ));
            }
        })
    }

    /// As [`EngineChoice::build_tets`], with a given model and the tolerances of the
    /// linear solves.
    ///
    /// # Errors
    /// As [`EngineChoice::build_tets`], and [`Error::Input`] if the model does not match the mesh.
    pub fn build_tets_from_model(
        self,
        gpu: &Gpu,
        (mesh, discrete_model): (TetMesh, DiscreteModel),
        material: &Material,
        (kind, settings): (SolverKind, CgSettings),
    ) -> Result<Box<dyn Simulator>> {
        if self == EngineChoice::Exactly(Engine::Rapier) {
            return rapier(gpu, (mesh, discrete_model), (kind, settings));
        }
        // Models supported by one engine only use that engine, unless the other was requested.
        let only_on_cpu = discrete_model.elements().is_some_and(|elements| {
            elements.volume == VolumetricFormulation::NodalAveraged || elements.order() == 2
        });
        let of_cpu = SolverKind::ELEMENT_ONLY.contains(&kind) || only_on_cpu;
        if of_cpu && self == EngineChoice::Auto || self.resolve(gpu) == Engine::Cpu {
            let body = CpuTets::of_model(
                gpu,
                (mesh, discrete_model),
                material,
                (kind, settings),
                Precision::Single,
            )?;
            return Ok(Box::new(body));
        }
        let body = GpuBody::from_model(gpu, &mesh, discrete_model, material)?;
        let solver: Box<dyn Solver> = match kind {
            SolverKind::Implicit => Box::new(ImplicitEuler::with(gpu, &body, settings)?),
            kind => kind.solver(gpu, &body)?,
        };
        Ok(Box::new(GpuTets::of_body(mesh, body, solver)?))
    }
}

/// A body stepped by rapier.
#[cfg(feature = "rapier")]
fn rapier(
    gpu: &Gpu,
    body: (TetMesh, DiscreteModel),
    how: (SolverKind, CgSettings),
) -> Result<Box<dyn Simulator>> {
    Ok(Box::new(super::RapierTets::new(gpu, body, how)?))
}

/// The error of a build without rapier.
#[cfg(not(feature = "rapier"))]
fn rapier(
    _: &Gpu,
    _: (TetMesh, DiscreteModel),
    _: (SolverKind, CgSettings),
) -> Result<Box<dyn Simulator>> {
    Err(Error::Input(
        "this build of palpate does not include the engine rapier; rebuild with `--features rapier`, or use --engine cpu or gpu".into(),
    ))
}
