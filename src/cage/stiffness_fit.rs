//! Linear static compliance of a body under loads, in float64 for small displacements.

use crate::parallel;
use crate::physics::{DiscreteModel, Discretisation, Element, Elements, outer};
use glam::{DMat3, DVec3};

/// Maximum iterations of conjugate gradients.
const ITERATIONS: usize = 3000;
/// Relative residual at which they stop.
const TOLERANCE: f64 = 1e-4;
/// Relative residual when estimating the size of a load.
const LOAD_ESTIMATE_TOLERANCE: f64 = 1e-3;

/// One list per load case: loads, N, or displacements, m.
pub(super) type LoadCases = Vec<Vec<DVec3>>;

/// Upper bound of the edge stiffness within rigid bodies, relative to the mean edge of deformable
/// parts: limits the condition number for conjugate gradients.
const RIGID: f64 = 100.0;

/// Returns the weight of a body at 1 m/s² along each axis.
pub(super) fn gravity_loads(model: &DiscreteModel) -> LoadCases {
    let along = |axis: DVec3| model.masses.iter().map(|m| *m * axis).collect();
    vec![along(DVec3::X), along(DVec3::Y), along(DVec3::Z)]
}

/// A linearised model with pinned nodes.
pub(super) struct ConstrainedModel<'a> {
    model: &'a DiscreteModel,
    /// Neighbours of each node with the connecting edge.
    rows: Vec<Vec<(u32, u32)>>,
    /// For each edge, from the smaller node i to j: B with force B (u_j − u_i) on i; the force on j
    /// is Bᵀ (u_i − u_j).
    edges: Vec<DMat3>,
    free: Vec<bool>,
    /// Inverse diagonal blocks of the stiffness matrix (block Jacobi preconditioner).
    inverse: Vec<DMat3>,
    /// Relative residual at which conjugate gradients stop.
    tolerance: f64,
}

impl<'a> ConstrainedModel<'a> {
    /// Linearises the model with the nodes in `pinned` fixed. Components with fewer than three
    /// pins stay at rest.
    pub fn new(model: &'a DiscreteModel, pinned: &[bool]) -> ConstrainedModel<'a> {
        let count = model.rest_positions.len();
        let mut rows = vec![Vec::new(); count];
        let mut blocks = vec![DMat3::ZERO; count];
        let edges = match &model.discretisation {
            Discretisation::Springs(_) => blocks_of_springs(model),
            Discretisation::Elements(elements) => blocks_of_elements(model, elements),
        };
        for (e, (edge, b)) in model.edges.iter().zip(&edges).enumerate() {
            if *b == DMat3::ZERO {
                continue;
            }
            let [i, j] = edge.nodes.map(|v| v as usize);
            rows[i].push((j as u32, e as u32));
            rows[j].push((i as u32, e as u32));
            blocks[i] += *b;
            blocks[j] += b.transpose();
        }
        let free = reached(&rows, pinned);
        let inverse = blocks
            .iter()
            .zip(&free)
            .map(|(block, free)| {
                // Collinear springs give a node no lateral stiffness: regularises the singular
                // block.
                let trace = block.x_axis.x + block.y_axis.y + block.z_axis.z;
                let block = *block + DMat3::IDENTITY * (1e-9 * trace);
                match *free && trace > 0.0 {
                    true => block.inverse(),
                    false => DMat3::ZERO,
                }
            })
            .collect();
        ConstrainedModel {
            model,
            rows,
            edges,
            free,
            inverse,
            tolerance: TOLERANCE,
        }
    }

    /// Whether any node can move.
    pub fn has_free_nodes(&self) -> bool {
        self.free.contains(&true)
    }

    fn product(&self, p: &[DVec3]) -> Vec<DVec3> {
        let row = |i: usize| {
            if !self.free[i] {
                return DVec3::ZERO;
            }
            let own = p[i];
            let parts = self.rows[i].iter();
            parts
                .map(|(j, e)| {
                    let (b, apart) = (&self.edges[*e as usize], own - p[*j as usize]);
                    match i < *j as usize {
                        true => *b * apart,
                        false => b.transpose() * apart,
                    }
                })
                .sum::<DVec3>()
        };
        parallel::map(p.len(), row)
    }

    /// Solves for the displacements under `loads`, with the initial guess `start`.
    pub fn solve_cases(&self, loads: &LoadCases, start: Option<&LoadCases>) -> LoadCases {
        let guess = |case: usize| start.and_then(|s| s.get(case)).map(Vec::as_slice);
        let cases = loads.iter().enumerate();
        cases
            .map(|(case, load)| self.solve(load, guess(case)))
            .collect()
    }

    fn solve(&self, load: &[DVec3], guess: Option<&[DVec3]>) -> Vec<DVec3> {
        let masked = |v: &[DVec3]| -> Vec<DVec3> {
            let kept = v.iter().zip(&self.free);
            kept.map(|(v, free)| if *free { *v } else { DVec3::ZERO })
                .collect()
        };
        let precondition = |r: &[DVec3]| -> Vec<DVec3> {
            let parts = r.iter().zip(&self.inverse);
            parts.map(|(r, m)| *m * *r).collect()
        };
        let load = masked(load);
        let scale = dot(&load, &precondition(&load));
        let mut x = guess.map_or_else(|| vec![DVec3::ZERO; load.len()], masked);
        let mut r = load;
        if guess.is_some() {
            let kx = self.product(&x);
            r.iter_mut().zip(&kx).for_each(|(r, k)| *r -= *k);
        }
        let mut z = precondition(&r);
        let mut direction = z.clone();
        let mut rz = dot(&r, &z);
        for _ in 0..ITERATIONS {
            if rz <= self.tolerance * self.tolerance * scale {
                break;
            }
            let q = self.product(&direction);
            let curvature = dot(&direction, &q);
            if !(curvature > 0.0 && curvature.is_finite()) {
                break;
            }
            let alpha = rz / curvature;
            for i in 0..x.len() {
                x[i] += alpha * direction[i];
                r[i] -= alpha * q[i];
            }
            z = precondition(&r);
            let next = dot(&r, &z);
            let beta = next / rz;
            rz = next;
            for i in 0..x.len() {
                direction[i] = z[i] + beta * direction[i];
            }
        }
        x
    }

    /// Estimates ω² of the lowest mode by the Rayleigh quotient of the load case with the largest
    /// compliance.
    pub fn lowest_eigenvalue(&self, loads: &LoadCases, given: &LoadCases) -> f64 {
        let most = loads
            .iter()
            .zip(given)
            .max_by(|a, b| dot(a.0, a.1).total_cmp(&dot(b.0, b.1)));
        let Some((load, u)) = most else {
            return 0.0;
        };
        let moving = self.model.masses.iter().zip(u);
        let inertia: f64 = moving.map(|(m, u)| m * u.length_squared()).sum();
        match inertia > 0.0 {
            true => dot(load, u) / inertia,
            false => 0.0,
        }
    }
}

/// Returns κ n nᵀ of each spring.
fn blocks_of_springs(model: &DiscreteModel) -> Vec<DMat3> {
    parallel::map(model.edges.len(), |e| axial_block(model, e, f64::MAX))
}

/// Returns κ n nᵀ of an edge, with κ limited to `most`.
fn axial_block(model: &DiscreteModel, e: usize, most: f64) -> DMat3 {
    let edge = &model.edges[e];
    let [a, b] = edge.nodes.map(|v| model.rest_positions[v as usize]);
    let along = (b - a).normalize_or_zero();
    outer(along, along) * edge.stiffness.clamp(0.0, most)
}

/// Returns the negative off-diagonal blocks of linear elasticity at rest; the diagonal block of a
/// node is the sum of those of its edges. Rigid bodies are represented by the axial stiffness of
/// their edges.
fn blocks_of_elements(model: &DiscreteModel, elements: &Elements) -> Vec<DMat3> {
    let edges = &model.edges;
    let mut blocks = vec![DMat3::ZERO; edges.len()];
    let mut soft = vec![false; edges.len()];
    for element in &elements.tets {
        let stiffness = stiffness(element, elements);
        for (a, va) in element.nodes.iter().enumerate() {
            for (b, vb) in element.nodes.iter().enumerate().filter(|(_, vb)| va < vb) {
                let found = edges.binary_search_by_key(&[*va, *vb], |e| e.nodes);
                if let Ok(e) = found {
                    blocks[e] -= stiffness(a, b);
                    soft[e] = true;
                }
            }
        }
    }
    if elements.rigid.is_empty() {
        return blocks;
    }
    let count = soft.iter().filter(|s| **s).count().max(1);
    let (all, flags) = (edges.iter(), soft.iter());
    let sum: f64 = all
        .zip(flags)
        .map(|(e, soft)| if *soft { e.stiffness } else { 0.0 })
        .sum();
    let most = RIGID * sum / count as f64;
    let mut body = vec![usize::MAX; model.rest_positions.len()];
    for (k, rigid) in elements.rigid.iter().enumerate() {
        rigid.nodes.iter().for_each(|v| body[*v as usize] = k);
    }
    for (e, edge) in edges.iter().enumerate() {
        let [a, b] = edge.nodes.map(|v| body[v as usize]);
        if a != usize::MAX && a == b {
            blocks[e] = axial_block(model, e, most);
        }
    }
    blocks
}

/// Returns K_ab of a tetrahedron at rest, N/m: V (μ (g_a·g_b I + g_b g_aᵀ) + λ g_a g_bᵀ); with
/// nodal averaging of volumes, only with the per-tetrahedron part of λ.
fn stiffness(element: &Element, elements: &Elements) -> impl Fn(usize, usize) -> DMat3 {
    let [mu, lambda] = element.small_strain(elements.law);
    let lambda = lambda - elements.averaged_lambda(element);
    let (gradients, volume) = (element.gradients(), element.volume);
    move |a, b| {
        let (ga, gb) = (gradients[a], gradients[b]);
        let shear = DMat3::from_diagonal(DVec3::splat(ga.dot(gb))) + outer(gb, ga);
        (shear * mu + outer(ga, gb) * lambda) * volume
    }
}

/// Returns the compliance: the total work of the loads.
pub(super) fn compliance(loads: &LoadCases, given: &LoadCases) -> f64 {
    loads.iter().zip(given).map(|(f, u)| dot(f, u)).sum()
}

fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

/// Returns the nodes that can move, in components with at least three pins.
fn reached(rows: &[Vec<(u32, u32)>], pinned: &[bool]) -> Vec<bool> {
    let mut free = vec![false; rows.len()];
    let mut seen = vec![false; rows.len()];
    for first in 0..rows.len() {
        if seen[first] {
            continue;
        }
        seen[first] = true;
        let mut part = vec![first];
        let mut next = 0;
        while next < part.len() {
            for (j, _) in &rows[part[next]] {
                let j = *j as usize;
                if !seen[j] {
                    seen[j] = true;
                    part.push(j);
                }
            }
            next += 1;
        }
        let pins = part.iter().filter(|i| pinned[**i]).count();
        if pins >= 3 {
            part.iter().for_each(|i| free[*i] = !pinned[*i]);
        }
    }
    free
}

/// Compliance of a model with pinned nodes, for small displacements.
pub(crate) struct Compliance<'a>(ConstrainedModel<'a>);

impl<'a> Compliance<'a> {
    /// Creates the linear system; `None` if no node can move, or no component is constrained.
    pub fn new(model: &'a DiscreteModel, pinned: &[bool]) -> Option<Compliance<'a>> {
        let mut held = ConstrainedModel::new(model, pinned);
        held.tolerance = LOAD_ESTIMATE_TOLERANCE;
        held.has_free_nodes().then_some(Compliance(held))
    }

    /// Returns the displacement of each node under `load` (N on the nodes), m, and the angular
    /// frequency of the lowest mode estimated from it, rad/s.
    pub fn solve_load(&self, load: &[DVec3]) -> (Vec<DVec3>, f64) {
        let loads = vec![load.to_vec()];
        let mut given = self.0.solve_cases(&loads, None);
        let rate = self.0.lowest_eigenvalue(&loads, &given).max(0.0).sqrt();
        (given.pop().unwrap_or_default(), rate)
    }
}
