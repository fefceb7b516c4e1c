//! Derivatives of a quantity by the material of each element, spring and node.

use super::equilibrium::Equilibrium;
use super::quantities::{StateFunction, derivative};
use crate::physics::cpu::{AdjointSolution, face_stiffness_transpose};
use crate::physics::model::nodal_volume::NO_NODAL_VOLUME;
use crate::physics::{ConstitutiveModel, Element, Elements};
use glam::DVec3;

/// Step of the differences of node terms by mass, over the mass.
const MASS_DIFFERENCE_STEP: f64 = 1e-3;

/// Derivatives of a quantity at equilibrium.
pub(super) struct MaterialSlopes {
    /// By the two Lamé parameters of each element, as they enter the energy.
    pub lame: Vec<[f64; 2]>,
    /// By the stiffness of each edge, for springs.
    pub edges: Vec<f64>,
    /// By the mass of each node.
    pub masses: Vec<f64>,
}

impl MaterialSlopes {
    /// Returns the derivatives of the quantity whose adjoint is `solution`; `function` is the
    /// quantity itself, unless it is a force.
    pub fn new(
        body: &Equilibrium<'_>,
        solution: &AdjointSolution,
        function: Option<&dyn StateFunction>,
    ) -> MaterialSlopes {
        let is_energy = function.is_some_and(StateFunction::is_energy);
        let mut slopes = MaterialSlopes {
            lame: vec![[0.0; 2]; body.network.tets().len()],
            edges: Vec::new(),
            masses: mass_slopes(body, solution, is_energy),
        };
        match body.network.elements() {
            Some(elements) => {
                add_elements(&mut slopes.lame, body, elements, &solution.terms, is_energy);
                let of_faces = face_slopes(body, solution);
                let of_elements = face_stiffness_transpose(body.faces, body.network, &of_faces);
                for (lame, mu) in slopes.lame.iter_mut().zip(of_elements) {
                    lame[0] += mu;
                }
                for (sum, lame) in slopes.lame.iter_mut().zip(&solution.lame) {
                    sum.iter_mut().zip(lame).for_each(|(sum, by)| *sum += by);
                }
            }
            None => slopes.edges = edge_slopes(body, solution, is_energy),
        }
        if let Some(function) = function {
            function.add_lame_slopes(body, &mut slopes.lame);
        }
        slopes
    }
}

/// Returns the derivatives by Young's modulus behind each boundary face.
fn face_slopes(body: &Equilibrium<'_>, solution: &AdjointSolution) -> Vec<f64> {
    let rest = &body.network.rest_positions;
    let faces = body.faces.iter().zip(&solution.faces);
    faces
        .map(|(face, slope)| slope * face_area(face, rest))
        .collect()
}

/// Returns the area of a face with the nodes at `x`.
pub(super) fn face_area(face: &[u32; 3], x: &[DVec3]) -> f64 {
    let [a, b, c] = face.map(|v| x[v as usize]);
    0.5 * (b - a).cross(c - a).length()
}

/// Returns λ times the forces of each node per mass, plus the energy if that is the quantity.
pub(super) fn mass_slopes(
    body: &Equilibrium<'_>,
    solution: &AdjointSolution,
    is_energy: bool,
) -> Vec<f64> {
    let of_node = |v: usize| {
        let (m, x) = (body.network.masses[v], body.x[v]);
        let of_term = |term: &std::sync::Arc<dyn crate::physics::NodeTerm>| {
            let at = |by: f64| {
                let energy = if is_energy {
                    term.energy(m + by, x)
                } else {
                    0.0
                };
                energy + solution.terms[v].dot(term.force(m + by, x))
            };
            derivative(at, MASS_DIFFERENCE_STEP * m.max(f64::MIN_POSITIVE))
        };
        let terms: f64 = body.terms.iter().map(of_term).sum();
        let inertia = body.inertia.get(v).copied().unwrap_or_default();
        solution.loads[v].dot(body.gravity - inertia) + terms
    };
    (0..body.x.len()).map(of_node).collect()
}

fn edge_slopes(body: &Equilibrium<'_>, solution: &AdjointSolution, is_energy: bool) -> Vec<f64> {
    let of_edge = |e: &crate::physics::Edge| {
        let [a, b] = e.nodes.map(|v| v as usize);
        let d = body.x[b] - body.x[a];
        let stretch = d.length() - e.length;
        let force = stretch * d.normalize_or_zero();
        let energy = if is_energy {
            0.5 * stretch * stretch
        } else {
            0.0
        };
        energy + (solution.terms[a] - solution.terms[b]).dot(force)
    };
    body.network.edges.iter().map(of_edge).collect()
}

/// Adds the derivatives by the Lamé parameters of elements of λ times their forces, and of their
/// energy.
fn add_elements(
    slopes: &mut [[f64; 2]],
    body: &Equilibrium<'_>,
    elements: &Elements,
    lambda: &[DVec3],
    is_energy: bool,
) {
    let shared = averaged_slopes(body, elements, lambda, is_energy);
    for (t, slope) in slopes.iter_mut().enumerate() {
        let element = &elements.tets[t];
        // Energy and forces are linear in both parameters.
        let own = [[1.0, 0.0], [0.0, 1.0]].map(|lame| {
            let unit = Element {
                lame_parameters: lame,
                ..*element
            };
            of_element(body, elements, (t, &unit), lambda, is_energy)
        });
        let averaged = elements.averaged_lambda(element);
        if averaged <= 0.0 {
            slope.iter_mut().zip(own).for_each(|(s, own)| *s += own);
            continue;
        }
        // Of λ, only the part below the averaged one λ̂ = λ − ρ μ is the element's own.
        let by_mu = match elements.law {
            ConstitutiveModel::NeoHookean => -1.0 - elements.per_tet_lambda_ratio,
            ConstitutiveModel::Corotated => -elements.per_tet_lambda_ratio,
        };
        slope[0] += own[0] + by_mu * (shared[t] - own[1]);
        slope[1] += shared[t];
    }
}

/// Returns λ times the forces of an element, plus its energy if that is the quantity.
fn of_element(
    body: &Equilibrium<'_>,
    elements: &Elements,
    (t, element): (usize, &Element),
    lambda: &[DVec3],
    is_energy: bool,
) -> f64 {
    let dot = |nodes: &[u32], forces: &[DVec3]| -> f64 {
        let all = nodes.iter().zip(forces);
        all.map(|(v, f)| lambda[*v as usize].dot(*f)).sum()
    };
    if let Some((nodes, shape)) = elements.quadratic_nodes(t).zip(elements.quadratic_shape(t)) {
        let x = nodes.map(|v| body.x[v as usize]);
        let energy = match is_energy {
            true => shape.energy(element, elements.law, &x),
            false => 0.0,
        };
        return energy + dot(&nodes, &shape.forces(element, elements.law, &x));
    }
    let x = element.node_positions(&body.x);
    let energy = match is_energy {
        true => element.energy(elements.law, &x),
        false => 0.0,
    };
    energy + dot(&element.nodes, &element.forces(elements.law, &x))
}

/// Returns for each tet the derivative by λ̂ of the energy of averaged nodal volumes, E = ½ Σ
/// N_a²/Λ_a with N_a = Σ w (J − 1), Λ_a = Σ w, w = ¼ V λ̂ (if that is the quantity), and of λ times
/// its forces, −Σ N_a D_a/Λ_a with D_a = Σ w ∂J·λ.
fn averaged_slopes(
    body: &Equilibrium<'_>,
    elements: &Elements,
    lambda: &[DVec3],
    is_energy: bool,
) -> Vec<f64> {
    let cells = elements.cells();
    if cells.cells.is_empty() {
        return vec![0.0; elements.tets.len()];
    }
    let growths: Vec<[f64; 2]> = elements
        .tets
        .iter()
        .map(|tet| {
            let x = tet.node_positions(&body.x);
            let cofactor = tet.cofactor(&x);
            let change = tet.nodes.iter().zip(tet.gradients());
            let change = change.map(|(v, g)| lambda[*v as usize].dot(cofactor * g));
            [
                tet.deformation_gradient(&x).determinant() - 1.0,
                change.sum(),
            ]
        })
        .collect();
    let mut sums = vec![[0.0; 2]; cells.cells.len()];
    for (t, tet) in elements.tets.iter().enumerate() {
        let w = 0.25 * tet.volume * elements.averaged_lambda(tet);
        for c in cells.of_tet[t].iter().filter(|c| **c != NO_NODAL_VOLUME) {
            let sum = &mut sums[*c as usize];
            for (sum, growth) in sum.iter_mut().zip(growths[t]) {
                *sum += w * growth;
            }
        }
    }
    let of_tet = |(t, tet): (usize, &Element)| {
        let [n, d] = growths[t];
        let corners = cells.of_tet[t].iter().filter(|c| **c != NO_NODAL_VOLUME);
        let by_weight = corners.map(|c| {
            let ([sum_n, sum_d], all) = (sums[*c as usize], cells.cells[*c as usize].stiffness);
            let work = (n * sum_d + d * sum_n) / all - sum_n * sum_d / (all * all);
            let energy = sum_n * n / all - 0.5 * (sum_n / all).powi(2);
            if is_energy { energy - work } else { -work }
        });
        0.25 * tet.volume * by_weight.sum::<f64>()
    };
    elements.tets.iter().enumerate().map(of_tet).collect()
}
