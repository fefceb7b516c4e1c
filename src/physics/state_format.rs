//! The form in which the state of any engine is stored: the number of its type, then its content.

use super::{BodiesState, CpuGridState, CpuState, GridState, SimulatorState, TetState};
use serde::de::{Deserialize, Deserializer};
use serde::ser::{Error as _, Serialize, Serializer};

/// A state to be stored. Files hold the position of the variant, so their order stays.
#[derive(serde::Serialize)]
#[serde(rename = "SimulatorState")]
enum StoredRef<'a> {
    /// A tetrahedral body on the GPU.
    Tets(&'a TetState),
    /// A grid body on the GPU.
    Grid(&'a GridState),
    /// A tetrahedral body on the CPU.
    Cpu(&'a CpuState),
    /// A grid body on the CPU.
    CpuGrid(&'a CpuGridState),
    /// Several bodies.
    Bodies(&'a BodiesState),
}

/// A stored state; the variants are those of [`StoredRef`].
#[derive(serde::Deserialize)]
#[serde(rename = "SimulatorState")]
enum Stored {
    Tets(TetState),
    Grid(GridState),
    Cpu(CpuState),
    CpuGrid(CpuGridState),
    Bodies(BodiesState),
}

impl Serialize for SimulatorState {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let tets = self.get().map(StoredRef::Tets);
        let stored = tets
            .or_else(|| self.get().map(StoredRef::Grid))
            .or_else(|| self.get().map(StoredRef::Cpu))
            .or_else(|| self.get().map(StoredRef::CpuGrid))
            .or_else(|| self.get().map(StoredRef::Bodies));
        let stored = stored.ok_or_else(|| S::Error::custom("a state of an unknown engine"))?;
        stored.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for SimulatorState {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<SimulatorState, D::Error> {
        Ok(match Stored::deserialize(deserializer)? {
            Stored::Tets(state) => SimulatorState::new(state),
            Stored::Grid(state) => SimulatorState::new(state),
            Stored::Cpu(state) => SimulatorState::new(state),
            Stored::CpuGrid(state) => SimulatorState::new(state),
            Stored::Bodies(state) => SimulatorState::new(state),
        })
    }
}
