//! Node layout of a body with rigid regions: soft nodes in aggregates, then each rigid body as a
//! group of its own, and beyond the plan their interior nodes.

use super::bodies::RigidBodies;
use super::pose::{DegreesOfFreedom, PROXY_NODES, RigidGroup, carriers};
use crate::physics::cpu::aggregation::Aggregates;
use crate::physics::model::rigid_region::{MassProperties, node_owners};
use crate::physics::{DiscreteModel, LocalUnits, SolverKind};
use crate::{Error, Result};
use glam::DVec3;
use std::borrow::Cow;

/// Checks that a scheme supports rigid bodies.
///
/// # Errors
/// [`Error::Input`].
fn check_rigid_support(kind: SolverKind) -> Result<()> {
    match kind {
        SolverKind::Implicit | SolverKind::Bdf2 | SolverKind::Midpoint => Ok(()),
        _ => Err(Error::Input(format!(
            "{kind} does not support rigid regions; use implicit, bdf2 or midpoint"
        ))),
    }
}

/// Returns the engine's network for `network`, the order of its nodes, and its rigid bodies; `most`
/// as for [`RigidLayout::new`].
///
/// # Errors
/// As [`RigidLayout::new`], and [`Error::Input`] for schemes that do not support rigid bodies.
pub(in crate::physics::cpu) fn build_layout<'a>(
    network: &'a DiscreteModel,
    kind: SolverKind,
    units: &LocalUnits,
    most: impl Fn(usize) -> usize,
) -> Result<(Cow<'a, DiscreteModel>, Aggregates, RigidBodies)> {
    if network.rigid_bodies().is_empty() {
        let lumps = Aggregates::new(&network.rest_positions, most(network.rest_positions.len()));
        return Ok((Cow::Borrowed(network), lumps, RigidBodies::default()));
    }
    check_rigid_support(kind)?;
    let RigidLayout {
        network,
        lumps,
        rigid,
    } = RigidLayout::new(network, units, most)?;
    Ok((Cow::Owned(network), lumps, rigid))
}

/// A network with proxy nodes, and the order of all of its nodes.
struct RigidLayout {
    /// The proxy nodes come last, four per body; they have the mass of its nodes, which become
    /// massless.
    network: DiscreteModel,
    lumps: Aggregates,
    rigid: RigidBodies,
}

impl RigidLayout {
    /// Creates the layout of `network`, which has rigid bodies, with its soft nodes in groups of at
    /// most `most(their number)`.
    ///
    /// # Errors
    /// [`Error::Input`] for a body without mass, a flat one, or one with nodes out of range.
    fn new(
        network: &DiscreteModel,
        units: &LocalUnits,
        most: impl Fn(usize) -> usize,
    ) -> Result<RigidLayout> {
        let count = network.rest_positions.len();
        let bodies = network.rigid_bodies();
        let owner = node_owners(bodies, count)?;
        let (outside, held) = outer_nodes(network);
        let free: Vec<u32> = (0..count as u32)
            .filter(|v| owner[*v as usize].is_none())
            .collect();
        let points = |nodes: &[u32]| -> Vec<DVec3> {
            nodes
                .iter()
                .map(|v| network.rest_positions[*v as usize])
                .collect()
        };
        let mut lumps = soft_aggregates(&free, &points(&free), most);
        let first = lumps.order.len();
        let mut extended = network.clone();
        let mut rigid = Vec::with_capacity(bodies.len());
        for (b, body) in bodies.iter().enumerate() {
            let start = lumps.order.len();
            let shown: Vec<u32> = body
                .nodes
                .iter()
                .copied()
                .filter(|v| outside[*v as usize])
                .collect();
            let near = Aggregates::new(&points(&shown), usize::MAX).order;
            lumps.order.extend(near.iter().map(|v| shown[*v as usize]));
            let own = (count + PROXY_NODES * b) as u32;
            lumps.order.extend(own..own + PROXY_NODES as u32);
            lumps.group_starts.push(lumps.order.len());
            let one = MassProperties::from_nodes(network, body, units)?;
            let (arms, spread) = carriers(&one);
            let places = arms.map(|r| (one.centre + r) * units.length);
            extended.rest_positions.extend(places);
            for v in &body.nodes {
                extended.masses[*v as usize] = 0.0;
            }
            let share = one.mass * units.mass / PROXY_NODES as f64;
            extended.masses.extend([share; PROXY_NODES]);
            rigid.push(RigidGroup {
                nodes: start..lumps.order.len(),
                inner: 0..0,
                centre: one.centre,
                mass: one.mass,
                inertia_map: spread,
                inverse_inertia_map: spread.inverse(),
                freedom: DegreesOfFreedom::Free,
                is_isolated: !body.nodes.iter().any(|v| held[*v as usize]),
            });
        }
        for (body, rigid) in bodies.iter().zip(&mut rigid) {
            let start = lumps.order.len();
            let inside = body.nodes.iter().filter(|v| !outside[**v as usize]);
            lumps.order.extend(inside);
            rigid.inner = start..lumps.order.len();
        }
        let arms = lever_arms(&extended, &lumps.order[first..], &rigid, units);
        let weight = |v: &u32| {
            network
                .masses
                .get(*v as usize)
                .map_or(0.0, |m| m / units.mass)
        };
        let weights = lumps.order[first..].iter().map(weight).collect();
        Ok(RigidLayout {
            network: extended,
            rigid: RigidBodies::new(first, rigid, arms, weights),
            lumps,
        })
    }
}

/// Returns the aggregates of the soft nodes `free`, which are at `points`.
fn soft_aggregates(free: &[u32], points: &[DVec3], most: impl Fn(usize) -> usize) -> Aggregates {
    if free.is_empty() {
        return Aggregates {
            order: Vec::new(),
            group_starts: vec![0],
        };
    }
    let mut aggregates = Aggregates::new(points, most(free.len()));
    for v in &mut aggregates.order {
        *v = free[*v as usize];
    }
    aggregates
}

/// Returns which nodes of `network` are on the surface of a rigid body or in a soft tetrahedron,
/// which take part wherever they are, and which are in a soft tetrahedron.
fn outer_nodes(network: &DiscreteModel) -> (Vec<bool>, Vec<bool>) {
    let count = network.rest_positions.len();
    let mut outside = vec![false; count];
    let surface = network.rigid_bodies().iter().flat_map(|b| &b.surface);
    surface.for_each(|v| outside[*v as usize] = true);
    let mut held = vec![false; count];
    if let Some(elements) = network.elements() {
        for v in (0..elements.tets.len()).flat_map(|t| elements.nodes_of(t)) {
            held[v as usize] = true;
            outside[v as usize] = true;
        }
    }
    (outside, held)
}

/// Returns the position of each of the nodes `slots`, those of rigid bodies, relative to its body's
/// centre, local units.
fn lever_arms(
    network: &DiscreteModel,
    slots: &[u32],
    rigid: &[RigidGroup],
    units: &LocalUnits,
) -> Vec<DVec3> {
    let places = slots.iter().map(|v| network.rest_positions[*v as usize]);
    let mut arms: Vec<DVec3> = places.map(|x| x / units.length).collect();
    let first = rigid.first().map_or(0, |body| body.nodes.start);
    for body in rigid {
        for i in body.nodes.clone().chain(body.inner.clone()) {
            arms[i - first] -= body.centre;
        }
    }
    arms
}
