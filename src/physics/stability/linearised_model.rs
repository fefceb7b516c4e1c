//! Stability limits of the time integrators: the eigenvalues of each scheme's step matrix for a
//! body linearised at rest, M ẍ + C ẋ + K x = 0.
//!
//! With damping proportional to stiffness (or to mass), the modes of M⁻¹K decouple, and each has
//! its own small step matrix ([`Mode::step_matrix`]). The limits of all schemes but explicit Euler
//! are exact for any damping: at the limit a displacement changes its sign in every step, and 4 is
//! the largest eigenvalue of M⁻¹(h²K + 2hC), for velocity Verlet of M⁻¹(h²K + 4hC).

use super::lanczos::{Eigenpair, dot, largest_eigenpair, start_vector};
pub use super::mode::Mode;
use crate::physics::grid::GridModel;
use crate::physics::{
    ConstitutiveModel, Damping, DiscreteModel, Discretisation, Edge, Element, Elements, SolverKind,
};
use glam::{DMat3, DVec3};

/// The largest stable step of a body, and the limiting mode.
#[derive(Clone, Debug)]
pub struct StepLimit {
    /// Seconds; 0 if no step is stable, infinite if all are.
    pub step: f64,
    /// Whether the limit is exact; otherwise `step` is a lower bound, certainly stable.
    pub exact: bool,
    /// λ and γ of the displacement that becomes unstable first: its Rayleigh quotients xᵀKx and
    /// xᵀCx over xᵀMx.
    pub mode: Mode,
    /// Displacement of every node in that mode, scaled to a maximum length of 1.
    pub displacement: Vec<DVec3>,
}

/// A body linearised at rest.
#[derive(Clone, Debug)]
pub struct LinearisedModel {
    links: Vec<LinearSpring>,
    tets: Vec<LinearElement<4>>,
    /// Quadrature points of ten-node tets.
    quadratic: Vec<LinearElement<10>>,
    /// Averaged nodal volumes: vectors v that contribute v vᵀ to K.
    volumes: Vec<Vec<(u32, DVec3)>>,
    /// Stiffness-proportional damping of the tets, s.
    damping_time: f64,
    /// 1/√m of every node; 0 for fixed nodes.
    weights: Vec<f64>,
    /// The damped velocity component of the springs.
    kind: Damping,
    /// Whether C = τK + drag M, in which case the modes decouple.
    proportional: bool,
    /// Mass-proportional damping, 1/s.
    mass_damping: f64,
}

/// A spring at rest, which resists along its direction.
#[derive(Clone, Copy, Debug)]
struct LinearSpring {
    nodes: [usize; 2],
    direction: DVec3,
    /// Stiffness, N/m.
    stiffness: f64,
    /// Damping, N·s/m.
    damping: f64,
}

/// An element of N nodes at rest, or a quadrature point of one: Hooke's law.
#[derive(Clone, Copy, Debug)]
struct LinearElement<const N: usize> {
    nodes: [usize; N],
    /// Gradients of the shape functions, 1/m.
    gradients: [DVec3; N],
    /// Volume, m³.
    volume: f64,
    /// Lamé parameters μ and λ, Pa.
    lame: [f64; 2],
}

impl LinearElement<4> {
    fn new(element: &Element, law: ConstitutiveModel) -> LinearElement<4> {
        LinearElement {
            nodes: element.nodes.map(|v| v as usize),
            gradients: element.gradients(),
            volume: element.volume,
            lame: element.small_strain(law),
        }
    }
}

/// The quadrature points of the ten-node tets of a body of order 2.
fn quadrature_points(elements: &Elements) -> Vec<LinearElement<10>> {
    let of_element = |t: usize| {
        let (nodes, shape) = elements
            .quadratic_nodes(t)
            .zip(elements.quadratic_shape(t))?;
        let lame = elements.tets[t].small_strain(elements.law);
        let points = shape.gradients.into_iter().zip(shape.volumes);
        Some(points.map(move |(gradients, volume)| LinearElement {
            nodes: nodes.map(|v| v as usize),
            gradients,
            volume,
            lame,
        }))
    };
    let count = elements.tets.len();
    (0..count).filter_map(of_element).flatten().collect()
}

impl<const N: usize> LinearElement<N> {
    /// Adds `share` K y to `product`, both scaled by `weights`.
    fn add_product(&self, share: f64, weights: &[f64], y: &[DVec3], product: &mut [DVec3]) {
        let u = self.nodes.map(|v| y[v] * weights[v]);
        for (v, f) in self.nodes.into_iter().zip(self.product(u)) {
            product[v] += share * f;
        }
    }

    /// Returns K u for the displacements u of its nodes: V σ g with σ = μ (∇u + ∇uᵀ) + λ tr ∇u.
    fn product(&self, u: [DVec3; N]) -> [DVec3; N] {
        let mut gradient = DMat3::ZERO;
        for (u, g) in u.iter().zip(self.gradients) {
            gradient += DMat3::from_cols(*u * g.x, *u * g.y, *u * g.z);
        }
        let [mu, lambda] = self.lame;
        let trace = gradient.x_axis.x + gradient.y_axis.y + gradient.z_axis.z;
        let stress = (gradient + gradient.transpose()) * mu
            + DMat3::from_diagonal(DVec3::splat(lambda * trace));
        self.gradients.map(|g| self.volume * (stress * g))
    }
}

impl LinearisedModel {
    /// Linearises `model` at rest, with the nodes marked in `pinned` fixed.
    pub fn new(model: &DiscreteModel, pinned: &[bool]) -> LinearisedModel {
        let mut body = vec![u32::MAX; model.rest_positions.len()];
        for (b, rigid) in model.rigid_bodies().iter().enumerate() {
            for v in &rigid.nodes {
                body[*v as usize] = b as u32;
            }
        }
        let is_link = |edge: &&Edge| match model.discretisation {
            Discretisation::Springs(_) => true,
            // The stiffness of their edges holds rigid regions together here; otherwise loads would
            // tear them apart.
            Discretisation::Elements(_) => {
                let [a, b] = edge.nodes.map(|v| body[v as usize]);
                a == b && a != u32::MAX
            }
        };
        let links = model.edges.iter().filter(is_link).map(|edge| {
            let [i, j] = edge.nodes.map(|v| v as usize);
            LinearSpring {
                nodes: [i, j],
                direction: (model.rest_positions[j] - model.rest_positions[i]).normalize_or_zero(),
                stiffness: edge.stiffness,
                damping: model.spring_damping(edge),
            }
        });
        let springs = model.springs().copied().unwrap_or_default();
        let axial = springs.damping_kind == Damping::Axial;
        let undamped = springs.damping == 0.0 && model.damping_time == 0.0;
        let elements = model.elements();
        LinearisedModel {
            links: links.collect(),
            tets: elements
                .filter(|e| e.order() == 1)
                .map_or(Vec::new(), |elements| {
                    let tets = elements.tets.iter();
                    tets.map(|e| {
                        LinearElement::new(&elements.without_averaged_lambda(e), elements.law)
                    })
                    .collect()
                }),
            quadratic: elements.map_or(Vec::new(), quadrature_points),
            volumes: elements.map_or(Vec::new(), |elements| {
                elements.volume_gradients(&model.rest_positions)
            }),
            damping_time: model.damping_time,
            weights: model
                .masses
                .iter()
                .zip(pinned)
                .map(|(m, p)| if *p || *m <= 0.0 { 0.0 } else { 1.0 / m.sqrt() })
                .collect(),
            kind: springs.damping_kind,
            proportional: undamped || axial && springs.damping == 0.0,
            mass_damping: elements.map_or(0.0, |elements| elements.mass_damping),
        }
    }

    /// Linearises the particles of a grid at rest.
    pub fn from_grid(grid: &GridModel) -> LinearisedModel {
        let (shape, offsets) = (&grid.shape, grid.shape.offsets());
        let mut links = Vec::new();
        for i in shape.particles() {
            for (kind, offset) in offsets.into_iter().enumerate() {
                if grid.springs[i] >> (2 * kind) & 1 == 0 {
                    continue;
                }
                let j = (i as i64 + offset) as usize;
                links.push(LinearSpring {
                    nodes: [i, j],
                    direction: (shape.rest_position(j) - shape.rest_position(i))
                        .normalize_or_zero(),
                    stiffness: 0.5
                        * (grid.stiffness_scales[i] + grid.stiffness_scales[j])
                        * grid.stiffness[kind],
                    damping: 0.0,
                });
            }
        }
        let inverse = |m: &f64| if *m > 0.0 { 1.0 / m } else { 0.0 };
        LinearisedModel {
            links,
            tets: Vec::new(),
            quadratic: Vec::new(),
            volumes: Vec::new(),
            damping_time: 0.0,
            weights: grid.masses.iter().map(|m| inverse(m).sqrt()).collect(),
            kind: Damping::Axial,
            proportional: true,
            mass_damping: grid.damping,
        }
    }

    /// Returns M^-½ (a K + b C) M^-½ y.
    fn product(&self, a: f64, b: f64, y: &[DVec3]) -> Vec<DVec3> {
        let mut product = vec![DVec3::ZERO; y.len()];
        for link in &self.links {
            let [i, j] = link.nodes;
            let w = y[j] * self.weights[j] - y[i] * self.weights[i];
            let along = link.direction * link.direction.dot(w);
            let f = match self.kind {
                Damping::Axial => (a * link.stiffness + b * link.damping) * along,
                Damping::Relative => a * link.stiffness * along + b * link.damping * w,
            };
            product[i] -= f;
            product[j] += f;
        }
        let share = a + b * self.damping_time;
        for tet in &self.tets {
            tet.add_product(share, &self.weights, y, &mut product);
        }
        for point in &self.quadratic {
            point.add_product(share, &self.weights, y, &mut product);
        }
        for slope in &self.volumes {
            let each = slope.iter().map(|(v, g)| {
                let v = *v as usize;
                self.weights[v] * g.dot(y[v])
            });
            let change = share * each.sum::<f64>();
            for (v, g) in slope {
                product[*v as usize] += change * *g;
            }
        }
        for ((f, w), y) in product.iter_mut().zip(&self.weights).zip(y) {
            *f = *f * *w
                + if *w > 0.0 {
                    b * self.mass_damping * *y
                } else {
                    DVec3::ZERO
                };
        }
        product
    }

    /// The largest eigenpair of M^-½ (a K + b C) M^-½.
    fn largest_eigenpair(&self, a: f64, b: f64) -> Eigenpair {
        largest_eigenpair(|y| self.product(a, b, y), self.start(), 1e-5, 100)
    }

    /// Returns the stiffest mode of M⁻¹K: its λ = ω² and its damping.
    pub fn stiffest_mode(&self) -> Mode {
        self.mode_of(&self.largest_eigenpair(1.0, 0.0).vector)
    }

    fn start(&self) -> Vec<DVec3> {
        let mut start = start_vector(self.weights.len());
        for (y, w) in start.iter_mut().zip(&self.weights) {
            *y *= f64::from(u8::from(*w > 0.0));
        }
        start
    }

    /// Returns λ and γ along the unit vector y.
    fn mode_of(&self, y: &[DVec3]) -> Mode {
        Mode {
            stiffness: dot(y, &self.product(1.0, 0.0, y)).max(0.0),
            damping: dot(y, &self.product(0.0, 1.0, y)).max(0.0),
        }
    }

    fn step_limit(&self, step: f64, exact: bool, y: &[DVec3]) -> StepLimit {
        let mut displacement: Vec<DVec3> =
            y.iter().zip(&self.weights).map(|(y, w)| *y * *w).collect();
        let longest = displacement.iter().map(|u| u.length()).fold(0.0, f64::max);
        if longest > 0.0 {
            displacement.iter_mut().for_each(|u| *u /= longest);
        }
        StepLimit {
            step,
            exact,
            mode: self.mode_of(y),
            displacement,
        }
    }

    /// Returns the largest stable step of `scheme`; `None` for implicit Euler, which has none.
    ///
    /// Exact, except for explicit Euler with damping that is not proportional to stiffness, where
    /// it is a lower bound: the smaller of min κ_d/κ and 2/γ_max.
    pub fn largest_step(&self, scheme: SolverKind) -> Option<StepLimit> {
        Some(match scheme {
            SolverKind::Implicit | SolverKind::Bdf2 | SolverKind::Midpoint => return None,
            SolverKind::Explicit => self.explicit_limit(),
            _ => self.period_doubling_limit(scheme),
        })
    }

    /// h²λ + s hγ = 4 (s = 2 or 4) has its smallest h where y is an eigenvector of h²K + s hC; any
    /// other y gives a larger h, so h decreases monotonically.
    fn period_doubling_limit(&self, scheme: SolverKind) -> StepLimit {
        let share = match scheme {
            SolverKind::VelocityVerlet => 4.0,
            _ => 2.0,
        };
        let mut y = self.largest_eigenpair(1.0, 0.0).vector;
        let mut step = self.mode_of(&y).largest_step(scheme);
        if !self.proportional {
            for _ in 0..50 {
                let (a, b) = match step.is_finite() {
                    true => (step * step, share * step),
                    false => (0.0, 1.0),
                };
                y = self.largest_eigenpair(a, b).vector;
                let next = self.mode_of(&y).largest_step(scheme);
                let fell = step - next;
                step = step.min(next);
                if fell.is_nan() || fell <= 1e-9 * step {
                    break;
                }
            }
        }
        self.step_limit(step, true, &y)
    }

    fn explicit_limit(&self) -> StepLimit {
        let stiffest = self.largest_eigenpair(1.0, 0.0).vector;
        if self.proportional {
            let step = self.mode_of(&stiffest).largest_step(SolverKind::Explicit);
            return self.step_limit(step, true, &stiffest);
        }
        let most_damped = self.largest_eigenpair(0.0, 1.0);
        let ratio = self
            .links
            .iter()
            .filter(|l| l.stiffness > 0.0)
            .map(|l| l.damping / l.stiffness)
            .fold(f64::INFINITY, f64::min);
        let overdamped = 2.0 / most_damped.value;
        match ratio <= overdamped {
            true => self.step_limit(ratio, false, &stiffest),
            false => self.step_limit(overdamped, false, &most_damped.vector),
        }
    }

    /// Returns the largest stable step of Verlet with centred mass-proportional damping, as in grid
    /// bodies: 2/ω for any damping.
    pub fn grid_limit(&self) -> StepLimit {
        let y = self.largest_eigenpair(1.0, 0.0).vector;
        self.step_limit(2.0 / self.mode_of(&y).stiffness.sqrt(), true, &y)
    }

    /// Returns the mean growth factor per step of a small displacement over the later half of
    /// `steps` steps of an explicit scheme, an estimate of the spectral radius of the whole step
    /// matrix for any damping; and the final displacement, scaled to a maximum length of 1.
    pub fn growth_rate(&self, scheme: SolverKind, h: f64, steps: usize) -> (f64, Vec<DVec3>) {
        let x = self.start();
        let mut state = [x.clone(), vec![DVec3::ZERO; x.len()], self.force(&x, None)];
        let (mut logarithm, mut counted) = (0.0, 0);
        for step in 0..steps {
            self.advance(scheme, h, &mut state);
            let [x, v, _] = &state;
            let size = (dot(x, &self.product(1.0, 0.0, x)) + dot(v, v)).sqrt();
            if !(size > 0.0 && size.is_finite()) {
                break;
            }
            if step >= steps / 2 {
                logarithm += size.ln();
                counted += 1;
            }
            for y in state.iter_mut().flatten() {
                *y /= size;
            }
        }
        let growth = (logarithm / f64::from(counted.max(1))).exp();
        (growth, self.step_limit(h, true, &state[0]).displacement)
    }

    /// Returns −Kx − Cv, for unit masses.
    fn force(&self, x: &[DVec3], v: Option<&[DVec3]>) -> Vec<DVec3> {
        let mut force = self.product(-1.0, 0.0, x);
        if let Some(v) = v {
            for (f, c) in force.iter_mut().zip(self.product(0.0, -1.0, v)) {
                *f += c;
            }
        }
        force
    }

    /// Advances an explicit scheme by one step from (x, v, a). (Verlet is symplectic Euler in other
    /// variables.)
    fn advance(&self, scheme: SolverKind, h: f64, [x, v, a]: &mut [Vec<DVec3>; 3]) {
        if scheme == SolverKind::VelocityVerlet {
            let before = a.clone();
            for i in 0..x.len() {
                x[i] += h * v[i] + 0.5 * h * h * before[i];
                v[i] += h * before[i];
            }
            *a = self.force(x, Some(v));
            for i in 0..x.len() {
                v[i] += 0.5 * h * (a[i] - before[i]);
            }
            return;
        }
        let force = self.force(x, Some(v));
        for i in 0..x.len() {
            let before = v[i];
            v[i] += h * force[i];
            x[i] += h * match scheme {
                SolverKind::Explicit => before,
                _ => v[i],
            };
        }
    }
}
