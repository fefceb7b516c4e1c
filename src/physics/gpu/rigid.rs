//! Rigid bodies on the GPU; the CPU side of `shaders/lib/rigid.wgsl` and
//! `shaders/lib/rigid_members.wgsl`.
//!
//! Poses are not part of the state: each step fits them to the positions and projects the nodes
//! back to their rigid shape. Setting positions (by scenes, checkpoints, cuts or callers) therefore
//! sets the poses, and shapes do not drift.

use super::elements::GpuElements;
use crate::gpu::{Array, Gpu, PassBuilder, Texel};
use crate::physics::Loads;
use crate::physics::model::discrete_model::DiscreteModel;
use crate::physics::model::rigid_region::{DegreesOfFreedom, MassProperties, node_owners};
use crate::physics::model::units::LocalUnits;
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// Marks the absence of a node.
const NONE: u32 = u32::MAX;

/// The rigid bodies of a body.
#[derive(Debug)]
pub(in crate::physics) struct GpuRigid {
    bodies: Vec<RigidBodyRecord>,
    /// Rest positions relative to the centre of mass of the node's body, in local units.
    lever_arms: Vec<DVec3>,
    /// Node and row of each member.
    members: Vec<[u32; 2]>,
    arm_array: Array,
    shape_array: Array,
    member_array: Array,
    range_array: Array,
}

/// Constant data of a rigid body.
#[derive(Debug)]
struct RigidBodyRecord {
    moments: MassProperties,
    /// First member and number of members.
    members: [u32; 2],
    /// Three nodes far apart.
    reference_nodes: [u32; 3],
}

/// Constraints of a body: its degrees of freedom, the node it rotates about, and whether any of its
/// nodes follow targets.
struct RigidConstraint {
    freedom: DegreesOfFreedom,
    anchor: u32,
    follows: bool,
}

impl GpuRigid {
    /// The rigid bodies of `model`, unconstrained; `None` if it has none.
    ///
    /// # Errors
    /// [`Error::Input`] if a body is massless or flat, or its nodes do not exist or belong to
    /// another; [`Error::Gpu`] if the arrays do not fit the device.
    pub fn new(
        gpu: &Gpu,
        model: &DiscreteModel,
        (elements, units): (Option<&GpuElements>, &LocalUnits),
    ) -> Result<Option<GpuRigid>> {
        let (Some(elements), rigid) = (elements, model.rigid_bodies()) else {
            return Ok(None);
        };
        if rigid.is_empty() {
            return Ok(None);
        }
        if rigid.len() >= 1 << 24 {
            return Err(Error::Input(format!(
                "{} rigid bodies exceed the limit of the GPU (16,777,215); use the engine cpu (--engine)",
                rigid.len()
            )));
        }
        let (_, _, row_of) = elements.edges();
        node_owners(rigid, model.rest_positions.len())?;
        let mut arms = vec![DVec3::ZERO; model.rest_positions.len()];
        let mut texels = vec![[0.0f32; 4]; arms.len()];
        let (mut members, mut bodies) = (Vec::new(), Vec::with_capacity(rigid.len()));
        for (b, body) in rigid.iter().enumerate() {
            let moments = MassProperties::from_nodes(model, body, units)?;
            let first = members.len() as u32;
            for v in &body.nodes {
                let i = *v as usize;
                arms[i] = model.rest_positions[i] / units.length - moments.centre;
                texels[i] = arms[i].as_vec3().extend((b + 1) as f32).to_array();
                members.push([*v, row_of.get(i).copied().unwrap_or(0)]);
            }
            bodies.push(RigidBodyRecord {
                moments,
                members: [first, body.nodes.len() as u32],
                reference_nodes: spread_nodes(&body.nodes, &arms),
            });
        }
        let arm_array = gpu.array_of("arms", Texel::F32x4, &texels)?;
        let array = |label, texel, len| gpu.array(label, texel, len);
        let made = GpuRigid {
            arm_array,
            shape_array: array("rigid shapes", Texel::F32x4, 4 * bodies.len())?,
            member_array: array("rigid members", Texel::U32x4, members.len())?,
            range_array: array("rigid ranges", Texel::U32x4, 2 * bodies.len())?,
            bodies,
            lever_arms: arms,
            members,
        };
        Ok(Some(made))
    }

    /// Number of rigid bodies.
    pub fn count(&self) -> u32 {
        self.bodies.len() as u32
    }

    /// Number of their nodes.
    pub fn node_count(&self) -> u32 {
        self.members.len() as u32
    }

    /// Uploads the degrees of freedom of the bodies under `loads`, and writes into `masses` (masses
    /// and inverse masses of all nodes) the inverses at their nodes: negative where the body moves.
    pub fn write_constraints(
        &self,
        gpu: &Gpu,
        loads: &Loads,
        masses: &mut [[f32; 2]],
    ) -> Result<()> {
        let stays = loads.constrained_nodes();
        let mut follows = vec![false; stays.len()];
        loads.grabs.held().for_each(|v| follows[v as usize] = true);
        let mut members = Vec::with_capacity(self.members.len());
        let (mut shapes, mut ranges) = (Vec::new(), Vec::new());
        for known in &self.bodies {
            let [first, count] = known.members;
            let own = &self.members[first as usize..(first + count) as usize];
            let held = self.held(known, own, &stays, &follows);
            for [v, row] in own {
                let v = *v as usize;
                members.push([v as u32, *row, u32::from(stays[v]), 0]);
                let inverse = match held.freedom {
                    DegreesOfFreedom::Fixed => 0.0,
                    _ if masses[v][0].is_normal() => -1.0 / masses[v][0],
                    _ => -1.0,
                };
                masses[v][1] = inverse;
            }
            shapes.extend(shape(&known.moments, held.freedom));
            ranges.push([first, count, held.anchor, u32::from(held.follows)]);
            let [a, b, c] = known.reference_nodes;
            ranges.push([a, b, c, 0]);
        }
        gpu.write_array(&self.member_array, &members)?;
        gpu.write_array(&self.shape_array, &shapes)?;
        gpu.write_array(&self.range_array, &ranges)
    }

    fn held(
        &self,
        known: &RigidBodyRecord,
        own: &[[u32; 2]],
        stays: &[bool],
        follows: &[bool],
    ) -> RigidConstraint {
        let moments = &known.moments;
        let radius = (trace(&moments.second_moment) / moments.mass).sqrt();
        let held = || own.iter().map(|[v, _]| *v).filter(|v| stays[*v as usize]);
        let freedom = DegreesOfFreedom::of(held().map(|v| self.lever_arms[v as usize]), radius);
        let turns = matches!(freedom, DegreesOfFreedom::Rotational(..));
        RigidConstraint {
            freedom,
            anchor: held().next().filter(|_| turns).unwrap_or(NONE),
            follows: held().any(|v| follows[v as usize]),
        }
    }

    /// Binds the data of passes composed with `terms/rigid`.
    pub fn bind<'a>(&'a self, pass: PassBuilder<'a>) -> PassBuilder<'a> {
        pass.read(&self.arm_array).read(&self.shape_array)
    }

    /// Binds the data of passes over the nodes of the bodies.
    pub fn bind_members<'a>(&'a self, pass: PassBuilder<'a>) -> PassBuilder<'a> {
        let pass = self.bind(pass);
        pass.read(&self.member_array).read(&self.range_array)
    }
}

fn trace(m: &DMat3) -> f64 {
    m.x_axis.x + m.y_axis.y + m.z_axis.z
}

/// The texels of `RigidShape`.
fn shape(moments: &MassProperties, freedom: DegreesOfFreedom) -> [[f32; 4]; 4] {
    let (number, anchor, axis) = match freedom {
        DegreesOfFreedom::Free => (0.0, DVec3::ZERO, DVec3::ZERO),
        DegreesOfFreedom::Rotational(at, None) => (1.0, at, DVec3::ZERO),
        DegreesOfFreedom::Rotational(at, Some(axis)) => (2.0, at, axis),
        DegreesOfFreedom::Fixed => (3.0, DVec3::ZERO, DVec3::ZERO),
    };
    let a = anchor;
    let second = moments.second_moment + DMat3::from_cols(a * a.x, a * a.y, a * a.z) * moments.mass;
    let radius = (trace(&second) / moments.mass).sqrt();
    let (on, off) = (
        DVec3::new(second.x_axis.x, second.y_axis.y, second.z_axis.z),
        DVec3::new(second.x_axis.y, second.x_axis.z, second.y_axis.z),
    );
    let texel = |v: DVec3, w: f64| v.as_vec3().extend(w as f32).to_array();
    [
        texel(anchor, moments.mass),
        texel(on, radius),
        texel(off, number),
        texel(axis, 0.0),
    ]
}

/// Picks three of `nodes` that are far apart and not collinear.
fn spread_nodes(nodes: &[u32], arms: &[DVec3]) -> [u32; 3] {
    let arm = |v: u32| arms[v as usize];
    let most = |measure: &dyn Fn(DVec3) -> f64| {
        let all = nodes.iter().copied();
        all.max_by(|a, b| measure(arm(*a)).total_cmp(&measure(arm(*b))))
            .unwrap_or(0)
    };
    let first = most(&|r| r.length_squared());
    let second = most(&|r| r.distance_squared(arm(first)));
    let along = arm(second) - arm(first);
    let third = most(&|r| (r - arm(first)).cross(along).length_squared());
    [first, second, third]
}
