//! Gradients of tetrahedral bodies on the CPU.

use super::equilibrium::{Equilibrium, MeasuredForces, check_balance, elements_of_tets};
use super::parameters::gradient;
use crate::physics::{
    CpuTets, Gradient, Gradients, Parameter, Precision, Quantity, ScaledLoad, Simulator,
};
use crate::{Error, Result};

impl Gradients for CpuTets {
    fn gradient(&mut self, quantity: &Quantity, parameters: &[Parameter]) -> Result<Gradient> {
        if !self.model.kind.is_implicit() {
            return Err(Error::Input(format!(
                "a gradient requires an implicit scheme, not {}; use --solver implicit",
                self.model.kind
            )));
        }
        if self.model.precision != Precision::Double {
            return Err(single_precision());
        }
        self.sync_loads()?;
        self.finish()?;
        let network = &self.model.network;
        let stiffness = network.nodal_stiffness();
        let loads = self.model.scaled_loads.iter().zip(self.loads.amplitudes());
        let muscles = loads.filter_map(|(load, amplitude)| match load {
            ScaledLoad::Muscle(muscle) => Some((muscle, *amplitude)),
            ScaledLoad::Pressure(_) => None,
        });
        let muscles = muscles.collect();
        let faces = self.boundary();
        let mut body = self.worker.body();
        let imbalance = check_balance(&body.force_balance(&stiffness))?;
        let equilibrium = Equilibrium {
            mesh: &self.mesh,
            material: &self.model.material,
            network,
            terms: &self.model.terms,
            tools: &self.model.tools,
            faces: &faces,
            muscles,
            has_self_contact: self.model.self_contact.is_some(),
            amplitudes: self.model.scaled_loads.len(),
            gravity: self.loads.gravity(),
            pinned: self.loads.pinned(),
            fixed: self.loads.fixed_nodes(),
            element_of_tet: elements_of_tets(network, &self.mesh),
            x: body.positions(),
            forces: MeasuredForces {
                tools: body.tool_forces(),
                nodes: body.forces(),
                rigid: body.rigid_forces(),
            },
        };
        let Some(adjoint) = body.static_adjoint() else {
            return Err(single_precision());
        };
        let found = gradient(&equilibrium, adjoint, quantity, parameters)?;
        Ok(Gradient { imbalance, ..found })
    }
}

fn single_precision() -> Error {
    Error::Input(
        "a gradient requires double precision; create the body with Precision::Double".into(),
    )
}
