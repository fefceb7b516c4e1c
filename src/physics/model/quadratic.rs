//! Ten-node tets: finite elements of order 2, and their float64 reference form.
//!
//! With barycentric coordinates L the shape functions are N_a = L_a (2 L_a − 1) at the corners and
//! N_ab = 4 L_a L_b at the middle of the edges (Zienkiewicz, Taylor & Zhu 2013, "The Finite Element
//! Method: Its Basis and Fundamentals", section 6.3). The rest shape is isoparametric: an edge whose
//! middle node lies beside its chord is a parabola.
//!
//! Energies, forces and stiffness are integrated by four points, with L = α at one corner and β at
//! the others (Hammer & Stroud 1956, "Numerical Integration over Simplexes"). The rule is exact for
//! polynomials of degree 2, such as the stiffness of a straight element at rest, and has as many
//! strains as the element has deformation modes.

use super::elements::{ConstitutiveModel, Element, Elements};
use crate::mesh::{PIECES, TET_EDGES, TetMesh, unit_map};
pub(crate) use crate::mesh::{QUADRATURE, QUADRATURE_POINTS, quadrature_point};
use glam::{DMat3, DVec3};

/// Number of nodes of a ten-node tet: its corners, then the middles of its edges in the order of
/// [`TET_EDGES`].
pub(crate) const QUADRATIC_NODES: usize = 10;

/// The nodes of a ten-node tet in the middle of its edges, in the order of [`TET_EDGES`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MidEdges {
    /// Node of each edge.
    pub nodes: [u32; 6],
    /// Rest position of each node relative to the middle of the edge's chord, m: zero for a straight
    /// edge.
    pub offsets: [DVec3; 6],
}

/// A ten-node tet at rest: shape function gradients at its quadrature points.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct QuadraticShape {
    /// Gradients of the ten shape functions at each point, 1/m.
    pub gradients: [[DVec3; QUADRATIC_NODES]; QUADRATURE_POINTS],
    /// Volume at rest that each point represents, m³.
    pub volumes: [f64; QUADRATURE_POINTS],
}

/// Returns the shape function gradients (1/m) at `l` of a tet with rest positions `rest` (m), and
/// the determinant of its map from the unit tet, m³; `None` if the map is not invertible there.
pub(crate) fn shape_gradients(
    rest: &[DVec3; QUADRATIC_NODES],
    l: [f64; 4],
) -> Option<([DVec3; QUADRATIC_NODES], f64)> {
    let (map, by_unit_coordinates) = unit_map(rest, l);
    let determinant = map.determinant();
    let inverse = map.inverse().transpose();
    let is_valid = determinant > 0.0 && determinant.is_finite() && inverse.is_finite();
    is_valid.then(|| (by_unit_coordinates.map(|d| inverse * d), determinant))
}

/// Returns Σ x_i ⊗ g_i.
pub(crate) fn gradient_of<const N: usize>(x: &[DVec3; N], gradients: &[DVec3; N]) -> DMat3 {
    let mut sum = DMat3::ZERO;
    for (x, g) in x.iter().zip(gradients) {
        sum += DMat3::from_cols(*x * g.x, *x * g.y, *x * g.z);
    }
    sum
}

impl QuadraticShape {
    /// The shape of a tet with rest positions `rest`, m. `None` if it is folded at a quadrature
    /// point.
    pub fn new(rest: &[DVec3; QUADRATIC_NODES]) -> Option<QuadraticShape> {
        let mut shape = QuadraticShape {
            gradients: [[DVec3::ZERO; QUADRATIC_NODES]; QUADRATURE_POINTS],
            volumes: [0.0; QUADRATURE_POINTS],
        };
        for point in 0..QUADRATURE_POINTS {
            let (gradients, determinant) = shape_gradients(rest, quadrature_point(point))?;
            shape.gradients[point] = gradients;
            shape.volumes[point] = determinant / 24.0;
        }
        Some(shape)
    }

    /// Returns F at each quadrature point with the nodes at `x`, m.
    pub fn deformation_gradients(
        &self,
        x: &[DVec3; QUADRATIC_NODES],
    ) -> [DMat3; QUADRATURE_POINTS] {
        std::array::from_fn(|point| gradient_of(x, &self.gradients[point]))
    }

    /// Returns the energy of an element of this shape and the material of `element` with the nodes
    /// at `x` (m), J.
    pub fn energy(
        &self,
        element: &Element,
        law: ConstitutiveModel,
        x: &[DVec3; QUADRATIC_NODES],
    ) -> f64 {
        let points = self.deformation_gradients(x).into_iter().zip(self.volumes);
        points
            .map(|(f, volume)| volume * element.energy_density(law, &f))
            .sum()
    }

    /// Returns the forces on the nodes at `x` (m), N: −Σ V P ∇N.
    pub fn forces(
        &self,
        element: &Element,
        law: ConstitutiveModel,
        x: &[DVec3; QUADRATIC_NODES],
    ) -> [DVec3; QUADRATIC_NODES] {
        let mut forces = [DVec3::ZERO; QUADRATIC_NODES];
        for (point, f) in self.deformation_gradients(x).iter().enumerate() {
            let stress = element.stress(law, f, 0.0) * self.volumes[point];
            for (force, g) in forces.iter_mut().zip(self.gradients[point]) {
                *force -= stress * g;
            }
        }
        forces
    }
}

impl Elements {
    /// The order of the elements: 2 if they have nodes on their edges.
    pub fn order(&self) -> u32 {
        match self.mid_edges.is_empty() {
            true => 1,
            false => 2,
        }
    }

    /// Returns linear elements `tets` with these settings, without rigid bodies.
    pub(crate) fn with_linear_tets(&self, tets: Vec<Element>) -> Elements {
        Elements {
            tets,
            mid_edges: Vec::new(),
            rigid: Vec::new(),
            ..*self
        }
    }

    /// Returns the nodes of element `t`: four, or ten.
    pub fn nodes_of(&self, t: usize) -> impl Iterator<Item = u32> {
        let middles = self.mid_edges.get(t).map(|edges| edges.nodes);
        self.tets[t]
            .nodes
            .into_iter()
            .chain(middles.into_iter().flatten())
    }

    /// Returns the nodes of ten-node tet `t`; `None` in a body of order 1.
    pub fn quadratic_nodes(&self, t: usize) -> Option<[u32; QUADRATIC_NODES]> {
        let middles = self.mid_edges.get(t)?.nodes;
        let corners = self.tets[t].nodes;
        Some(std::array::from_fn(|i| match i {
            0..4 => corners[i],
            _ => middles[i - 4],
        }))
    }

    /// Returns the rest positions of ten-node tet `t` relative to its first corner, m; `None` in a
    /// body of order 1.
    pub(crate) fn quadratic_rest(&self, t: usize) -> Option<[DVec3; QUADRATIC_NODES]> {
        let offsets = self.mid_edges.get(t)?.offsets;
        let edges = self.tets[t].inverse_rest_shape.inverse();
        let corners = [DVec3::ZERO, edges.x_axis, edges.y_axis, edges.z_axis];
        Some(std::array::from_fn(|i| match i {
            0..4 => corners[i],
            _ => {
                let [a, b] = TET_EDGES[i - 4];
                0.5 * (corners[a] + corners[b]) + offsets[i - 4]
            }
        }))
    }

    /// Returns the element number of each tet of `mesh`, the mesh of this body, which in a body of
    /// order 2 is the one that it is a piece of; `None` for degenerate and rigid tets.
    pub fn of_tets(&self, mesh: &TetMesh) -> Vec<Option<usize>> {
        let mut left = self.tets.iter().enumerate().peekable();
        let mut next = |corners: [u32; 4]| {
            let is_here = left.next_if(|(_, e)| e.nodes == corners);
            is_here.map(|(t, _)| t)
        };
        if self.order() == 1 {
            return mesh.tets.iter().map(|tet| next(*tet)).collect();
        }
        let groups = mesh.tets.chunks(PIECES).flat_map(|group| {
            let corners = group.first_chunk::<4>();
            let element = corners.and_then(|c| next(std::array::from_fn(|a| c[a][a])));
            std::iter::repeat_n(element, group.len())
        });
        groups.collect()
    }

    /// Returns F of ten-node tet `t` at the centre of its piece with nodes `piece`, with all nodes
    /// at `x` (m); NaN if the piece is not its own.
    pub(crate) fn deformation_of_piece(&self, t: usize, piece: &[u32; 4], x: &[DVec3]) -> DMat3 {
        let element = self.quadratic_nodes(t).zip(self.quadratic_rest(t));
        let at_centre = element.and_then(|(nodes, rest)| {
            let mut centre = [0.0; 4];
            for v in piece {
                match nodes.iter().position(|node| node == v)? {
                    corner @ 0..4 => centre[corner] += 0.25,
                    middle => TET_EDGES[middle - 4]
                        .iter()
                        .for_each(|a| centre[*a] += 0.125),
                }
            }
            let (gradients, _) = shape_gradients(&rest, centre)?;
            Some(gradient_of(&nodes.map(|v| x[v as usize]), &gradients))
        });
        at_centre.unwrap_or(DMat3::NAN)
    }

    /// Returns the shape of ten-node tet `t`; `None` in a body of order 1.
    pub(crate) fn quadratic_shape(&self, t: usize) -> Option<QuadraticShape> {
        QuadraticShape::new(&self.quadratic_rest(t)?)
    }
}
