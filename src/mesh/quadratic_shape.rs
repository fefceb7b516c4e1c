//! The map from barycentric coordinates to a ten-node tet.

use super::TET_EDGES;
use super::quadratic::TenNodes;
use glam::{DMat3, DVec3};

/// Number of quadrature points.
pub(crate) const QUADRATURE_POINTS: usize = 4;

/// α and β, the barycentric coordinates of the quadrature points.
pub(crate) const QUADRATURE: [f64; 2] = [0.585_410_196_624_968_5, 0.138_196_601_125_010_5];

/// Number of nodes.
const NODES: usize = 10;

/// Returns the barycentric coordinates of quadrature point `point`.
pub(crate) fn quadrature_point(point: usize) -> [f64; 4] {
    let [alpha, beta] = QUADRATURE;
    std::array::from_fn(|a| if a == point { alpha } else { beta })
}

/// Returns the shape functions at the barycentric coordinates `l`: of the corners, then of the middles
/// of edges.
pub(super) fn shape_functions(l: [f64; 4]) -> [f64; NODES] {
    let mut values = [0.0; NODES];
    for (value, l) in values.iter_mut().zip(l) {
        *value = l * (2.0 * l - 1.0);
    }
    for (value, [a, b]) in values[4..].iter_mut().zip(TET_EDGES) {
        *value = 4.0 * l[a] * l[b];
    }
    values
}

/// Returns dN/dL: for each shape function its derivative by each barycentric coordinate at `l`.
pub(crate) fn shape_derivatives(l: [f64; 4]) -> [[f64; 4]; NODES] {
    let mut derivatives = [[0.0; 4]; NODES];
    for (a, l) in l.iter().enumerate() {
        derivatives[a][a] = 4.0 * l - 1.0;
    }
    for (edge, [a, b]) in TET_EDGES.iter().enumerate() {
        derivatives[4 + edge][*a] = 4.0 * l[*b];
        derivatives[4 + edge][*b] = 4.0 * l[*a];
    }
    derivatives
}

/// Returns the map from (ξ, η, ζ) to the tet with nodes at `x`, with L_0 = 1 − ξ − η − ζ and L_1, L_2,
/// L_3 = ξ, η, ζ: its derivatives by them as columns, at `l`; also those of the shape functions.
pub(crate) fn unit_map(x: &[DVec3; NODES], l: [f64; 4]) -> (DMat3, [DVec3; NODES]) {
    let by_unit_coordinates =
        shape_derivatives(l).map(|d| DVec3::new(d[1] - d[0], d[2] - d[0], d[3] - d[0]));
    let mut map = DMat3::ZERO;
    for (x, d) in x.iter().zip(by_unit_coordinates) {
        map += DMat3::from_cols(*x * d.x, *x * d.y, *x * d.z);
    }
    (map, by_unit_coordinates)
}

/// Returns the Jacobians of a ten-node tet at its quadrature points: positive where it is not folded.
pub(super) fn jacobians(element: &TenNodes, nodes: &[DVec3]) -> [f64; QUADRATURE_POINTS] {
    let x = element.map(|v| nodes[v as usize]);
    std::array::from_fn(|point| unit_map(&x, quadrature_point(point)).0.determinant())
}
