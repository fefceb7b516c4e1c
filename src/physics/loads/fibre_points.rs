//! Quadrature points of muscles.
//!
//! The energy of fibres m at full activation is ½ T ∫ |F m|² dV with F m = Σ x_i s_i, s_i = ∇N_i·m.
//! On a linear tet the slopes s_i are constant. A ten-node tet is integrated at the four points of its
//! passive energy, so that both stresses balance at the same strains. If a muscle has only some of
//! its pieces, or if they have several directions, the points are those of each piece with the
//! gradients of the ten-node tet; the energy is the same for straight edges.

use super::scaled_load::Muscle;
use crate::mesh::{PIECES, TET_EDGES, TenNodes, ten_nodes};
use crate::physics::DiscreteModel;
use crate::physics::model::quadratic::{
    QUADRATIC_NODES, QUADRATURE_POINTS, quadrature_point, shape_gradients,
};
use glam::{DMat3, DVec3};

/// A quadrature point of a muscle.
#[derive(Clone, Copy, Debug)]
pub(in crate::physics) struct FibrePoint {
    /// s_i of the nodes of the element, over the unit of length; zero beyond a linear tet's four.
    pub slopes: [f64; QUADRATIC_NODES],
    /// The fibre direction m at rest, a unit vector.
    pub direction: DVec3,
    /// Volume at rest that the point represents, m³.
    pub volume: f64,
}

/// A part of a ten-node tet with one fibre direction: the whole, or a piece.
struct FibrePart {
    /// Barycentric coordinates of its four corners.
    corners: [[f64; 4]; 4],
    /// Volume over that of the element, in barycentric coordinates.
    share: f64,
    direction: DVec3,
}

impl Muscle {
    /// Calls `visit` with the nodes and the quadrature points of each element that has fibres. `tets`
    /// are those of the mesh of `model`; slopes are per `length`, m. Elements without volume and those
    /// within a rigid body have no energy and are left out.
    pub(in crate::physics) fn for_each_element(
        &self,
        (model, tets): (&DiscreteModel, &[[u32; 4]]),
        length: f64,
        mut visit: impl FnMut(&[u32], &[FibrePoint]),
    ) {
        let bodies = rigid_bodies_of_nodes(model);
        let is_rigid = |nodes: &[u32]| {
            let body = bodies[nodes[0] as usize];
            body != u32::MAX && nodes.iter().all(|v| bodies[*v as usize] == body)
        };
        let rest = |v: u32| model.rest_positions[v as usize];
        if model
            .elements()
            .is_none_or(|elements| elements.order() == 1)
        {
            for (tet, direction) in &self.fibres {
                let nodes = tets[*tet as usize];
                if is_rigid(&nodes) {
                    continue;
                }
                if let Some(point) = linear_point(nodes.map(rest), *direction, length) {
                    visit(&nodes, &[point]);
                }
            }
            return;
        }
        let mut fibres = self.fibres.clone();
        fibres.sort_by_key(|(tet, _)| *tet);
        let element = |tet: u32| tet as usize / PIECES;
        for own in fibres.chunk_by(|(a, _), (b, _)| element(*a) == element(*b)) {
            let group = tets.chunks(PIECES).nth(element(own[0].0));
            let Some((pieces, nodes)) = group.and_then(|g| Some((g, ten_nodes(g)?))) else {
                continue;
            };
            if !is_rigid(&nodes) {
                let parts = fibre_parts(own, pieces, &nodes);
                visit(&nodes, &quadratic_points(&nodes.map(rest), &parts, length));
            }
        }
    }
}

/// Returns the rigid body of each node, or `u32::MAX`.
fn rigid_bodies_of_nodes(model: &DiscreteModel) -> Vec<u32> {
    let mut bodies = vec![u32::MAX; model.rest_positions.len()];
    for (b, body) in model.rigid_bodies().iter().enumerate() {
        body.nodes
            .iter()
            .for_each(|v| bodies[*v as usize] = b as u32);
    }
    bodies
}

/// Returns the point of a linear tet; `None` if it has no volume.
fn linear_point(corners: [DVec3; 4], direction: DVec3, length: f64) -> Option<FibrePoint> {
    let edges = DMat3::from_cols(
        corners[1] - corners[0],
        corners[2] - corners[0],
        corners[3] - corners[0],
    );
    let volume = edges.determinant() / 6.0;
    let inverse = edges.inverse();
    if !(volume > 0.0 && inverse.is_finite()) {
        return None;
    }
    let [a, b, c] = (inverse * direction * length).to_array();
    let mut slopes = [0.0; QUADRATIC_NODES];
    slopes[..4].copy_from_slice(&[-(a + b + c), a, b, c]);
    Some(FibrePoint {
        slopes,
        direction,
        volume,
    })
}

/// Returns the parts of an element with these pieces and nodes that have the fibres `own`, in the
/// order of its pieces.
fn fibre_parts(own: &[(u32, DVec3)], pieces: &[[u32; 4]], nodes: &TenNodes) -> Vec<FibrePart> {
    let are_all = own.len() == PIECES && own.windows(2).all(|pair| pair[0].0 < pair[1].0);
    if are_all && own.iter().all(|(_, direction)| *direction == own[0].1) {
        let unit = |k: usize| std::array::from_fn(|a| f64::from(u8::from(a == k)));
        return vec![FibrePart {
            corners: std::array::from_fn(unit),
            share: 1.0,
            direction: own[0].1,
        }];
    }
    let part = |(tet, direction): &(u32, DVec3)| FibrePart {
        corners: pieces[*tet as usize % PIECES].map(|v| barycentric(v, nodes)),
        share: 1.0 / PIECES as f64,
        direction: *direction,
    };
    own.iter().map(part).collect()
}

/// Returns the barycentric coordinates of node `v` in the element with these nodes.
fn barycentric(v: u32, nodes: &TenNodes) -> [f64; 4] {
    let mut l = [0.0; 4];
    match nodes.iter().position(|node| *node == v) {
        Some(corner @ 0..4) => l[corner] = 1.0,
        Some(middle) => TET_EDGES[middle - 4].iter().for_each(|a| l[*a] = 0.5),
        None => l = [f64::NAN; 4],
    }
    l
}

/// Returns the points of a ten-node tet with nodes at `rest`, without those where it is folded.
fn quadratic_points(
    rest: &[DVec3; QUADRATIC_NODES],
    parts: &[FibrePart],
    length: f64,
) -> Vec<FibrePoint> {
    let points = parts
        .iter()
        .flat_map(|part| (0..QUADRATURE_POINTS).map(move |n| (part, quadrature_point(n))));
    let made = points.filter_map(|(part, of_part)| {
        let corners = || part.corners.iter().zip(of_part);
        let l = std::array::from_fn(|a| corners().map(|(corner, l)| l * corner[a]).sum());
        let (gradients, determinant) = shape_gradients(rest, l)?;
        Some(FibrePoint {
            slopes: gradients.map(|g| g.dot(part.direction) * length),
            direction: part.direction,
            volume: part.share * determinant / 24.0,
        })
    });
    made.collect()
}
