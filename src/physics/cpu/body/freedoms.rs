//! The degrees of freedom of a body: three of each soft node, then a translation and a rotation of
//! each rigid body.

use super::CpuBody;
use crate::physics::cpu::rigid::pose::{
    DegreesOfFreedom, PROXY_NODES, inertia_of, rotation_response,
};
use crate::physics::cpu::vectors::{V4, scale, to_dvec, to_v4, zero};
use glam::{DMat3, DVec3};

impl CpuBody<f64> {
    /// Returns the number of soft nodes in the plan.
    pub(super) fn soft_nodes(&self) -> usize {
        let first = self.newton.as_ref().map_or(usize::MAX, |n| n.rigid.first);
        first.min(self.plan.nodes())
    }

    /// Returns the displacements of all slots for the degrees of freedom `x`: three of each soft
    /// node, then a translation and a rotation of each rigid body.
    pub(super) fn prolong_freedoms(&self, x: &[f64]) -> Vec<V4<f64>> {
        let soft = self.soft_nodes();
        let mut p = vec![zero(); self.state.u.len()];
        for (i, x) in x.chunks_exact(3).take(soft).enumerate() {
            p[i] = scale(self.free_mask[i], [x[0], x[1], x[2], 0.0]);
        }
        let Some(newton) = &self.newton else {
            return p;
        };
        let rigid = &newton.rigid;
        let motions = x[3 * soft..].chunks_exact(6);
        for ((body, pose), m) in rigid.bodies.iter().zip(&rigid.now).zip(motions) {
            let (pivot, within) = body.pivot(pose);
            let shift = match body.freedom {
                DegreesOfFreedom::Free => DVec3::new(m[0], m[1], m[2]),
                _ => DVec3::ZERO,
            };
            let turn = within * DVec3::new(m[3], m[4], m[5]);
            for i in body.nodes.clone().chain(body.inner.clone()) {
                let arm = pose.rotation * (rigid.lever_arms[i - rigid.first] - pivot);
                p[i] = to_v4(shift + turn.cross(arm));
            }
        }
        p
    }

    /// Returns the transpose of [`CpuBody::prolong_freedoms`] times the forces `f` on all slots.
    pub(super) fn restrict_forces(&self, f: &[V4<f64>]) -> Vec<f64> {
        let soft = self.soft_nodes();
        let mut x = Vec::with_capacity(3 * soft);
        for (f, free) in f[..soft].iter().zip(&self.free_mask) {
            x.extend(f[..3].iter().map(|f| free * f));
        }
        let Some(newton) = &self.newton else {
            return x;
        };
        let rigid = &newton.rigid;
        for (b, (body, pose)) in rigid.bodies.iter().zip(&rigid.now).enumerate() {
            let (_, within) = body.pivot(pose);
            let [mut sum, moment] = rigid.resultant(b, pose, f);
            if body.freedom != DegreesOfFreedom::Free {
                sum = DVec3::ZERO;
            }
            x.extend(sum.to_array());
            x.extend((within * moment).to_array());
        }
        x
    }

    /// Returns forces on the nodes of the plan that act on the degrees of freedom as `r`: those on
    /// rigid bodies are on their proxy nodes.
    pub(super) fn spread_forces(&self, r: &[f64]) -> Vec<V4<f64>> {
        let (soft, nodes) = (self.soft_nodes(), self.plan.nodes());
        let mut f = vec![zero(); nodes];
        for (f, r) in f.iter_mut().zip(r.chunks_exact(3)).take(soft) {
            *f = [r[0], r[1], r[2], 0.0];
        }
        let rigid = self.newton.as_ref().map(|n| &n.rigid);
        for (b, r) in r[3 * soft..].chunks_exact(6).enumerate() {
            let Some(rigid) = rigid else {
                break;
            };
            let (force, moment) = (DVec3::new(r[0], r[1], r[2]), DVec3::new(r[3], r[4], r[5]));
            for (i, share) in rigid.proxy_forces(b, (force, moment)) {
                f[i] = to_v4(share);
            }
        }
        f
    }

    /// Returns the degrees of freedom that move the nodes of the plan by `p`, times `by`.
    pub(super) fn read_freedoms(&self, p: &[V4<f64>], by: f64) -> Vec<f64> {
        let soft = self.soft_nodes();
        let mut x = Vec::with_capacity(3 * soft);
        for p in &p[..soft] {
            x.extend(p[..3].iter().map(|p| by * p));
        }
        let Some(newton) = &self.newton else {
            return x;
        };
        let rigid = &newton.rigid;
        for (body, pose) in rigid.bodies.iter().zip(&rigid.now) {
            let (pivot, within) = body.pivot(pose);
            let (mut sum, mut moment, mut inertia) = (DVec3::ZERO, DVec3::ZERO, DMat3::ZERO);
            let is_free = body.freedom == DegreesOfFreedom::Free;
            let arm = |i: usize| pose.rotation * (rigid.lever_arms[i - rigid.first] - pivot);
            for i in body.proxy_nodes() {
                let moved = by * to_dvec(p[i]);
                sum += moved;
                moment += arm(i).cross(moved);
                inertia += inertia_of(arm(i));
            }
            // A free body has its centre as pivot.
            let shift = if is_free { sum } else { DVec3::ZERO } / PROXY_NODES as f64;
            x.extend(shift.to_array());
            x.extend((within * rotation_response(inertia, moment, within)).to_array());
        }
        x
    }
}
