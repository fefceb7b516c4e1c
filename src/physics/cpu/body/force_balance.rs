//! Balance of the static forces of a body.

use super::CpuBody;
use super::force_assembly::ForceSources;
use crate::physics::cpu::external_loads::ExternalLoads;
use crate::physics::cpu::implicit::contact_terms::{self_contact, tool_contact};
use crate::physics::cpu::rigid::pose::{DegreesOfFreedom, PROXY_NODES};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::StateRef;
use crate::physics::cpu::vectors::{V4, to_dvec, to_metres, zero};
use crate::physics::loads::force_balance::{ForceBalance, ForceSums};
use glam::DVec3;

impl<T: Real> CpuBody<T> {
    /// Returns the balance of the static forces. `stiffness` is that of each node, N/m.
    pub(in crate::physics::cpu) fn force_balance(&self, stiffness: &[f64]) -> ForceBalance {
        let nodes = self.engine_index.len();
        let still = vec![zero(); nodes];
        let forces_of = |loads: &ExternalLoads<T>| {
            let mut forces: Vec<V4<T>> = vec![zero(); nodes];
            let sources = ForceSources {
                plan: &self.plan,
                masses: &self.masses,
                loads,
                terms: &self.terms,
            };
            let at = StateRef {
                u: &self.state.u,
                v: &still,
            };
            self.plan.in_pool(|| sources.forces(at, &mut forces));
            forces
        };
        let internal = forces_of(&ExternalLoads::empty(nodes));
        // Not the difference of both sums: loads may be far below the rounding of the forces.
        let mut loads: Vec<V4<T>> = vec![zero(); nodes];
        for chunk in 0..self.plan.chunks() {
            let own = self.plan.range(chunk);
            self.loads.write_forces(
                &self.plan,
                chunk,
                &self.masses,
                &self.state.u,
                &mut loads[own],
            );
        }
        let force = self.units.force();
        let rounding = |k: usize| {
            let v = self.node_order[k] as usize;
            let moved = to_metres(self.state.u[k], self.units.length).length();
            T::UNIT_ROUNDOFF * stiffness.get(v).copied().unwrap_or(0.0) * moved
        };
        let mut sums = ForceSums::default();
        sums.contact = tool_contact(&self.terms).is_some() || self_contact(&self.terms).is_some();
        let rigid = self.newton.as_ref().map(|newton| &newton.rigid);
        let soft = rigid.map_or(nodes, |rigid| rigid.first.min(nodes));
        for k in 0..soft {
            let (own, load) = (to_metres(internal[k], force), to_metres(loads[k], force));
            sums.add(own, load, self.free_mask[k] > T::ZERO, rounding(k));
            let v = self.node_order[k] as usize;
            let stiffness = stiffness.get(v).copied().unwrap_or(0.0);
            sums.add_negligible(stiffness, self.units.length);
        }
        let Some(rigid) = rigid else {
            return sums.balance();
        };
        for (body, pose) in rigid.bodies.iter().zip(&rigid.now) {
            let (mut own, mut moment, mut load, mut error) =
                (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, 0.0);
            let (pivot, within) = body.pivot(pose);
            for k in body.nodes.clone() {
                let (f, l) = (to_dvec(internal[k]), to_dvec(loads[k]));
                own += f;
                load += l;
                moment +=
                    (pose.rotation * (rigid.lever_arms[k - rigid.first] - pivot)).cross(f + l);
                if k < body.nodes.end - PROXY_NODES {
                    error += rounding(k);
                }
            }
            let moment = within * moment / body.radius().max(f64::MIN_POSITIVE) * force;
            match body.freedom {
                DegreesOfFreedom::Fixed => sums.add(own * force, load * force, false, 0.0),
                DegreesOfFreedom::Rotational(..) => {
                    sums.add(own * force, load * force, false, 0.0);
                    sums.add_rigid(DVec3::ZERO, moment, DVec3::ZERO, error);
                }
                DegreesOfFreedom::Free => {
                    sums.add_rigid((own + load) * force, moment, load * force, error);
                }
            }
        }
        sums.balance()
    }
}
