//! Quantities as functions of the positions, or as forces of which the engine has the tangent.

use super::equilibrium::Equilibrium;
use crate::physics::cpu::AdjointSeed;
use crate::physics::{DiscreteModel, Discretisation, Element, Quantity, outer};
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// Step of central differences of stresses, over the size of the tet.
const DIFFERENCE_STEP: f64 = 1e-3;

/// A function of the positions `x` of a body (m), at fixed loads.
pub(super) trait StateFunction {
    /// Returns its value in a body of the model `network`, which has the same elements as the
    /// body's own.
    fn value(&self, body: &Equilibrium<'_>, network: &DiscreteModel, x: &[DVec3]) -> f64;

    /// As [`StateFunction::value`], apart from a constant and from what is of second order in the
    /// distance from the state of `body`: smooth where the value is a norm.
    fn linearised(&self, body: &Equilibrium<'_>, network: &DiscreteModel, x: &[DVec3]) -> f64 {
        self.value(body, network, x)
    }

    /// Returns its derivative by the position of every node, 1/m.
    fn gradient(&self, body: &Equilibrium<'_>) -> Vec<DVec3>;

    /// Adds its derivatives by the Lamé parameters of elements, at fixed positions.
    fn add_lame_slopes(&self, _: &Equilibrium<'_>, _: &mut [[f64; 2]]) {}

    /// Whether it is the elastic energy, which depends on the material everywhere.
    fn is_energy(&self) -> bool {
        false
    }
}

/// A quantity, prepared for a body.
pub(super) enum PreparedQuantity {
    /// A function of the positions.
    Function(Box<dyn StateFunction>),
    /// A force, with its value, N.
    Force(Box<AdjointSeed>, f64),
}

/// The seed of an adjoint, the value of its quantity, and the quantity if it is a function.
pub(super) type PreparedSeed = (AdjointSeed, f64, Option<Box<dyn StateFunction>>);

impl PreparedQuantity {
    /// Returns the seed of the adjoint at the state of `body`.
    pub fn into_seed(self, body: &Equilibrium<'_>) -> PreparedSeed {
        match self {
            PreparedQuantity::Force(seed, value) => (*seed, value, None),
            PreparedQuantity::Function(function) => {
                let seed = AdjointSeed {
                    gradient: function.gradient(body),
                    amplitudes: body.amplitudes.len(),
                    ..AdjointSeed::default()
                };
                let value = function.value(body, body.network, &body.x);
                (seed, value, Some(function))
            }
        }
    }
}

/// Prepares a quantity of `body`, whose forces are measured.
///
/// # Errors
/// [`Error::Input`] for an unknown node, tet, tool or region.
pub(super) fn prepare(quantity: &Quantity, body: &Equilibrium<'_>) -> Result<PreparedQuantity> {
    let function = |f: Box<dyn StateFunction>| Ok(PreparedQuantity::Function(f));
    let seed = AdjointSeed {
        gradient: vec![DVec3::ZERO; body.x.len()],
        amplitudes: body.amplitudes.len(),
        ..AdjointSeed::default()
    };
    match quantity {
        Quantity::ToolForce { tool, direction } => {
            body.check_tool(*tool)?;
            let value = body.forces.tools[tool.0][0].dot(*direction);
            let tool = Some((tool.0, *direction));
            Ok(PreparedQuantity::Force(
                Box::new(AdjointSeed { tool, ..seed }),
                value,
            ))
        }
        Quantity::PinReaction { nodes, direction } => {
            body.check_fixed(nodes)?;
            let forces = nodes.iter().map(|v| body.forces.nodes[*v as usize]);
            let value = forces.map(|f| f.dot(*direction)).sum();
            let reaction = Some((nodes.clone(), *direction));
            Ok(PreparedQuantity::Force(
                Box::new(AdjointSeed { reaction, ..seed }),
                value,
            ))
        }
        Quantity::RegionForce { label, direction } => {
            let mut bodies = body.network.rigid_bodies().iter();
            let Some(b) = bodies.position(|body| body.labels.contains(label)) else {
                return Err(Error::Input(format!(
                    "region {label} is not rigid, or does not exist; give the label of a rigid region"
                )));
            };
            let value = body.forces.rigid[b][0].dot(*direction);
            let region = Some((b, *direction));
            Ok(PreparedQuantity::Force(
                Box::new(AdjointSeed { region, ..seed }),
                value,
            ))
        }
        Quantity::Displacement { nodes, direction } => {
            body.check_nodes(nodes.iter().map(|(v, _)| *v))?;
            function(Box::new(Displacement(nodes.clone(), *direction)))
        }
        Quantity::LargestDisplacement => {
            let moved = |v: &usize| body.x[*v].distance(body.network.rest_positions[*v]);
            let all = 0..body.x.len();
            let node = all.max_by(|a, b| moved(a).total_cmp(&moved(b)));
            match node {
                Some(node) if moved(&node) > 0.0 => function(Box::new(Distance(node))),
                _ => Err(Error::Input(
                    "the largest displacement of a body that has not moved has no derivative; load the body".into(),
                )),
            }
        }
        Quantity::Volume { tets } => {
            body.check_tets(tets)?;
            function(Box::new(Volume(tets.clone())))
        }
        Quantity::Stress { tet, along } => {
            function(Box::new(Stress::new(body, *tet, Some(*along))?))
        }
        Quantity::VonMises { tet } => function(Box::new(Stress::new(body, *tet, None)?)),
        Quantity::ElasticEnergy => function(Box::new(ElasticEnergy)),
    }
}

/// Returns the derivative at 0 of `f` by central differences of fourth order with the step `h`.
pub(super) fn derivative(mut f: impl FnMut(f64) -> f64, h: f64) -> f64 {
    (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)
}

/// Weighted sum of displacements along a direction.
struct Displacement(Vec<(u32, f64)>, DVec3);

impl StateFunction for Displacement {
    fn value(&self, body: &Equilibrium<'_>, network: &DiscreteModel, x: &[DVec3]) -> f64 {
        let nodes = self.0.iter().map(|(v, w)| (*v as usize, w));
        let sum: DVec3 = nodes
            .map(|(v, w)| *w * (x[v] - network.rest_positions[v]))
            .sum();
        sum.dot(self.1) / body.network.length_unit
    }

    fn gradient(&self, body: &Equilibrium<'_>) -> Vec<DVec3> {
        let mut gradient = vec![DVec3::ZERO; body.x.len()];
        for (v, w) in &self.0 {
            gradient[*v as usize] += self.1 * (*w / body.network.length_unit);
        }
        gradient
    }
}

/// Distance of a node from its rest position.
struct Distance(usize);

impl StateFunction for Distance {
    fn value(&self, body: &Equilibrium<'_>, network: &DiscreteModel, x: &[DVec3]) -> f64 {
        x[self.0].distance(network.rest_positions[self.0]) / body.network.length_unit
    }

    fn linearised(&self, body: &Equilibrium<'_>, network: &DiscreteModel, x: &[DVec3]) -> f64 {
        let along = self.gradient(body)[self.0];
        along.dot(x[self.0] - network.rest_positions[self.0])
    }

    fn gradient(&self, body: &Equilibrium<'_>) -> Vec<DVec3> {
        let mut gradient = vec![DVec3::ZERO; body.x.len()];
        let moved = body.x[self.0] - body.network.rest_positions[self.0];
        gradient[self.0] = moved.normalize_or_zero() / body.network.length_unit;
        gradient
    }
}

/// Volume of tets.
struct Volume(Vec<u32>);

impl StateFunction for Volume {
    fn value(&self, body: &Equilibrium<'_>, _: &DiscreteModel, x: &[DVec3]) -> f64 {
        let of_tet = |t: &u32| {
            let [o, a, b, c] = body.mesh.tets[*t as usize].map(|v| x[v as usize]);
            (a - o).dot((b - o).cross(c - o)) / 6.0
        };
        let volume: f64 = self.0.iter().map(of_tet).sum();
        volume / body.network.length_unit.powi(3)
    }

    fn gradient(&self, body: &Equilibrium<'_>) -> Vec<DVec3> {
        let mut gradient = vec![DVec3::ZERO; body.x.len()];
        let by = 1.0 / (6.0 * body.network.length_unit.powi(3));
        for t in &self.0 {
            let nodes = body.mesh.tets[*t as usize];
            let [o, a, b, c] = nodes.map(|v| body.x[v as usize]);
            let (a, b, c) = (a - o, b - o, c - o);
            let faces = [b.cross(c), c.cross(a), a.cross(b)].map(|n| n * by);
            gradient[nodes[0] as usize] -= faces.iter().sum::<DVec3>();
            for (v, n) in nodes[1..].iter().zip(faces) {
                gradient[*v as usize] += n;
            }
        }
        gradient
    }
}

/// Cauchy stress in a tet: a component, or von Mises.
struct Stress {
    tet: usize,
    element: usize,
    nodes: Vec<u32>,
    along: Option<[DVec3; 2]>,
}

impl Stress {
    fn new(body: &Equilibrium<'_>, tet: u32, along: Option<[DVec3; 2]>) -> Result<Stress> {
        body.check_tets(&[tet])?;
        let Some(elements) = body.network.elements() else {
            return Err(Error::Input(
                "springs have no stress; use --material neo-hookean (or corotated)".into(),
            ));
        };
        if !elements.cells().cells.is_empty() {
            return Err(Error::Input(
                "the gradient of a stress is not available with averaged volumes, in which it depends on the surrounding tets; remove volume (--volume), or use order 2".into(),
            ));
        }
        let tet = tet as usize;
        let Some(element) = body.element_of_tet[tet] else {
            return Err(Error::Input(format!(
                "tet {tet} is rigid or degenerate and has no stress; choose another"
            )));
        };
        Ok(Stress {
            tet,
            element,
            nodes: elements.nodes_of(element).collect(),
            along,
        })
    }

    /// Returns the Cauchy stress, Pa.
    fn sigma(
        &self,
        body: &Equilibrium<'_>,
        (network, element): (&DiscreteModel, &Element),
        x: &[DVec3],
    ) -> DMat3 {
        let Some(elements) = network.elements() else {
            return DMat3::NAN;
        };
        let f = match elements.order() {
            1 => element.deformation_gradient(&element.node_positions(x)),
            _ => elements.deformation_of_piece(self.element, &body.mesh.tets[self.tet], x),
        };
        element.stress(elements.law, &f, 0.0) * f.transpose() * (1.0 / f.determinant())
    }

    /// Returns the stress at the state of `body`.
    fn current(&self, body: &Equilibrium<'_>) -> DMat3 {
        let element = &body.network.tets()[self.element];
        self.sigma(body, (body.network, element), &body.x)
    }

    /// Returns W, so that the quantity changes by W : dσ from the state of `body`.
    fn weights(&self, body: &Equilibrium<'_>) -> DMat3 {
        match self.along {
            Some([a, b]) => outer(a, b),
            None => {
                let sigma = self.current(body);
                deviator(&sigma) * (1.5 / von_mises(&sigma).max(f64::MIN_POSITIVE))
            }
        }
    }
}

fn deviator(sigma: &DMat3) -> DMat3 {
    let mean = (sigma.x_axis.x + sigma.y_axis.y + sigma.z_axis.z) / 3.0;
    *sigma - DMat3::from_diagonal(DVec3::splat(mean))
}

fn von_mises(sigma: &DMat3) -> f64 {
    let s = deviator(sigma);
    (1.5 * double_dot(&s, &s)).sqrt()
}

fn double_dot(a: &DMat3, b: &DMat3) -> f64 {
    (0..3).map(|k| a.col(k).dot(b.col(k))).sum()
}

impl StateFunction for Stress {
    fn value(&self, body: &Equilibrium<'_>, network: &DiscreteModel, x: &[DVec3]) -> f64 {
        let sigma = self.sigma(body, (network, &network.tets()[self.element]), x);
        match self.along {
            Some([a, b]) => a.dot(sigma * b),
            None => von_mises(&sigma),
        }
    }

    fn linearised(&self, body: &Equilibrium<'_>, network: &DiscreteModel, x: &[DVec3]) -> f64 {
        let sigma = self.sigma(body, (network, &network.tets()[self.element]), x);
        double_dot(&self.weights(body), &sigma)
    }

    fn gradient(&self, body: &Equilibrium<'_>) -> Vec<DVec3> {
        let mut gradient = vec![DVec3::ZERO; body.x.len()];
        let element = &body.network.tets()[self.element];
        let (h, weights) = (DIFFERENCE_STEP * element.volume.cbrt(), self.weights(body));
        let mut x = body.x.clone();
        for v in self.nodes.iter().map(|v| *v as usize) {
            for axis in 0..3 {
                gradient[v][axis] = derivative(
                    |by| {
                        x[v][axis] = body.x[v][axis] + by;
                        double_dot(&weights, &self.sigma(body, (body.network, element), &x))
                    },
                    h,
                );
                x[v] = body.x[v];
            }
        }
        gradient
    }

    fn add_lame_slopes(&self, body: &Equilibrium<'_>, slopes: &mut [[f64; 2]]) {
        let element = &body.network.tets()[self.element];
        let weights = self.weights(body);
        // The stress is linear in both parameters.
        let unit = [[1.0, 0.0], [0.0, 1.0]].map(|lame_parameters| Element {
            lame_parameters,
            ..*element
        });
        for (slope, unit) in slopes[self.element].iter_mut().zip(unit) {
            *slope += double_dot(&weights, &self.sigma(body, (body.network, &unit), &body.x));
        }
    }
}

/// Elastic energy of elements or springs and of the terms on nodes.
struct ElasticEnergy;

impl StateFunction for ElasticEnergy {
    fn value(&self, body: &Equilibrium<'_>, network: &DiscreteModel, x: &[DVec3]) -> f64 {
        let matter = match &network.discretisation {
            Discretisation::Elements(elements) => elements.energy(x),
            Discretisation::Springs(_) => {
                let of_edge = |e: &crate::physics::Edge| {
                    let [a, b] = e.nodes.map(|v| x[v as usize]);
                    0.5 * e.stiffness * (a.distance(b) - e.length).powi(2)
                };
                network.edges.iter().map(of_edge).sum()
            }
        };
        let terms = body.terms.iter().flat_map(|term| {
            let nodes = network.masses.iter().zip(x);
            nodes.map(|(m, x)| term.energy(*m, *x))
        });
        matter + terms.sum::<f64>()
    }

    fn gradient(&self, body: &Equilibrium<'_>) -> Vec<DVec3> {
        let forces = body.network.static_forces(&body.x, body.terms);
        forces.into_iter().map(|f| -f).collect()
    }

    fn is_energy(&self) -> bool {
        true
    }
}
