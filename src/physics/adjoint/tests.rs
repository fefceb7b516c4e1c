//! Gradients against central differences of re-solved equilibria. Shared cases; the tests are in
//! the files below.
#![allow(clippy::unwrap_used)]

mod contact_tests;
mod faults;
mod load_tests;
mod material_tests;
mod motion_contact_tests;
mod motion_faults;
mod motion_tests;

use super::equilibrium::{Equilibrium, MeasuredForces, check_balance, elements_of_tets};
use super::parameters::gradient;
use super::quantities::{PreparedQuantity, prepare};
use crate::generate::{Split, box_mesh};
use crate::mesh::{Field, Location, TetMesh, Topology, traction_shares};
use crate::physics::cpu::{
    AdjointSeed, AdjointSolution, CpuBody, NodeConstraint, StaticAdjoint, TangentParts, TetBody,
};
use crate::physics::{
    CgSettings, DiscreteModel, Floor, Gradient, Material, MaterialModel, Muscle, NewtonSettings,
    NodeTerm, Parameter, Quantity, RegionMaterial, SelfContactSettings, SolverKind, Tool, ToolPose,
};
use glam::{DQuat, DVec3};
use std::sync::Arc;

pub(super) const YOUNG: f64 = 2e4;
const NEWTON: NewtonSettings = NewtonSettings {
    iterations: 60,
    tolerance: 1e-13,
    linear_tolerance: 1e-5,
};

/// A body and its loads.
#[derive(Clone)]
pub(super) struct Case {
    pub mesh: TetMesh,
    pub material: Material,
    pub kind: SolverKind,
    pub pinned: Vec<bool>,
    /// Displacement of the pinned nodes at the far end, file units.
    pub pull: DVec3,
    pub gravity: DVec3,
    pub loads: Vec<DVec3>,
    /// Loaded faces with the pressure, Pa.
    pub pressure: Option<(Vec<[u32; 3]>, f64)>,
    pub muscle: Option<(Muscle, f64)>,
    pub floor: Option<Floor>,
    pub tool: Option<Tool>,
    pub self_contact: Option<SelfContactSettings>,
    pub newton: Option<NewtonSettings>,
    pub steps: u32,
    /// Length of a step, s.
    pub dt: f64,
    /// Displacements and velocities at the start of a motion, file units; empty for a body at rest.
    pub offsets: Vec<DVec3>,
    pub velocities: Vec<DVec3>,
    /// Whether the far pins, the tool and the amplitudes move and change in a motion.
    pub is_driven: bool,
    /// Factor of the steps of differences: small where contact or an eigenvalue changes its sign.
    pub difference: f64,
}

/// A settled body.
pub(super) struct Settled {
    pub body: CpuBody<f64>,
    pub network: DiscreteModel,
    pub faces: Vec<[u32; 3]>,
    pub iterations: u32,
}

/// Returns a bar of 3 × 2 × 2 cells along x, with its low end pinned, of two regions.
pub(super) fn bar(model: MaterialModel) -> Case {
    let size = DVec3::new(0.12, 0.06, 0.05);
    let mut mesh = box_mesh([3, 2, 2], size, Split::Six).unwrap();
    let labels = (0..mesh.tets.len()).map(|t| {
        let middle = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
        f64::from(u8::from(middle.x > 0.5 * size.x))
    });
    let labels = Field::scalar("label", Location::Cell, labels.collect());
    mesh.set_field(labels).unwrap();
    let mut material = Material {
        model,
        poisson: 0.3,
        damping_time: 0.0,
        region_field: Some("label".into()),
        ..Material::from_young(YOUNG)
    };
    let second = RegionMaterial {
        stiffness: 1.7 * YOUNG,
        density: 1200.0,
        poisson: 0.35,
    };
    material.regions.insert(1, second);
    Case {
        pinned: mesh.nodes.iter().map(|p| p.x < 1e-9).collect(),
        loads: vec![DVec3::ZERO; mesh.nodes.len()],
        mesh,
        material,
        kind: SolverKind::Implicit,
        pull: DVec3::ZERO,
        gravity: DVec3::new(0.5, 1.0, -4.0),
        pressure: None,
        muscle: None,
        floor: None,
        tool: None,
        self_contact: None,
        newton: Some(NEWTON),
        steps: 8,
        dt: 1e4,
        offsets: Vec::new(),
        velocities: Vec::new(),
        is_driven: false,
        difference: 1.0,
    }
}

/// Returns the node nearest to `p`.
pub(super) fn node_at(mesh: &TetMesh, p: DVec3) -> u32 {
    let all = 0..mesh.nodes.len();
    let nearest = all.min_by(|a, b| {
        let of = |v: &usize| mesh.nodes[*v].distance(p);
        of(a).total_cmp(&of(b))
    });
    nearest.unwrap() as u32
}

/// A body whose tangent has some parts only.
struct WithParts<'a>(&'a mut CpuBody<f64>, TangentParts);

impl StaticAdjoint for WithParts<'_> {
    fn adjoint(&mut self, seed: &AdjointSeed) -> crate::Result<AdjointSolution> {
        let seed = AdjointSeed {
            parts: self.1,
            ..seed.clone()
        };
        self.0.adjoint(&seed)
    }
}

impl Case {
    /// The tets of a region.
    pub fn region(&self, label: f64) -> Vec<u32> {
        let labels = &self.mesh.field("label", Location::Cell).unwrap().values;
        let all = 0..labels.len();
        all.filter(|t| labels[*t] == label)
            .map(|t| t as u32)
            .collect()
    }

    fn faces(&self) -> Vec<[u32; 3]> {
        let topology = Topology::new(&self.mesh);
        topology.boundary_triangles(&self.mesh)
    }

    /// The pinned nodes at the far end.
    pub fn far_pins(&self) -> Vec<u32> {
        let far = self.mesh.nodes.iter().map(|p| p.x).fold(0.0, f64::max);
        let nodes = 0..self.mesh.nodes.len();
        nodes
            .filter(|v| self.pinned[*v] && self.mesh.nodes[*v].x > 0.5 * far)
            .map(|v| v as u32)
            .collect()
    }

    fn amplitudes(&self) -> Vec<f64> {
        let pressure = self.pressure.as_ref().map_or(0.0, |(_, p)| *p);
        vec![pressure, self.muscle.as_ref().map_or(0.0, |(_, a)| *a)]
    }

    fn terms(&self) -> Vec<Arc<dyn NodeTerm>> {
        let floor = self.floor.iter();
        floor
            .map(|floor| Arc::new(*floor) as Arc<dyn NodeTerm>)
            .collect()
    }

    /// Creates the body at its start.
    pub fn start(&self) -> Settled {
        let network = DiscreteModel::new(&self.mesh, &self.material).unwrap();
        let settings = match self.newton {
            Some(_) => CgSettings {
                tolerance: 1e-13,
                acceptable: 1e-6,
                max_iterations: 20000,
            },
            None => CgSettings::default(),
        };
        let mut body = CpuBody::<f64>::new(&network, self.kind, settings, Some(2)).unwrap();
        if let Some(newton) = self.newton {
            body.set_newton(newton).unwrap();
        }
        let faces = self.faces();
        for term in self.terms() {
            body.add_node_term(term, &network);
        }
        if let Some((loaded, _)) = &self.pressure {
            let middles = match network.elements() {
                Some(elements) if elements.order() == 2 => self.mesh.mid_edge_nodes(),
                _ => vec![false; self.mesh.nodes.len()],
            };
            let with = |f: &[u32; 3]| (*f, f.map(|v| middles[v as usize]));
            assert_eq!(traction_shares([false; 3]), [1.0 / 3.0; 3]);
            body.add_pressure(&loaded.iter().map(with).collect::<Vec<_>>(), 0);
        }
        if let Some((muscle, _)) = &self.muscle {
            body.add_muscle(muscle, 1, (&network, &self.mesh.tets));
        }
        if let Some(tool) = &self.tool {
            body.add_tool(tool, &faces, &network);
        }
        if let Some(settings) = &self.self_contact {
            assert_eq!(body.set_self_contact(settings, &faces, &network), 0);
        }
        body.set_pinned(&self.pinned).unwrap();
        body.set_gravity(self.gravity);
        body.set_forces(&self.loads).unwrap();
        body.set_levels(&self.amplitudes());
        if self.pull != DVec3::ZERO {
            let unit = network.length_unit;
            let fixed = self.far_pins().into_iter().map(|node| {
                let place = network.rest_positions[node as usize] + self.pull * unit;
                NodeConstraint::Fixed { node, place }
            });
            body.set_node_constraints(&fixed.collect::<Vec<_>>())
                .unwrap();
        }
        if !self.offsets.is_empty() {
            let mut x = network.rest_positions.clone();
            x.iter_mut().zip(&self.offsets).for_each(|(x, u)| *x += *u);
            for v in self.far_pins() {
                x[v as usize] += self.pull;
            }
            body.set_state(&x, &self.velocities).unwrap();
        }
        Settled {
            body,
            network,
            faces,
            iterations: 0,
        }
    }

    /// Settles the body in long steps.
    pub fn settle(&self) -> Settled {
        let mut settled = self.start();
        for _ in 0..self.steps {
            settled.iterations += settled.body.run(1, self.dt).unwrap().iterations;
        }
        settled
    }

    /// Returns the body at rest.
    fn equilibrium<'a>(
        &'a self,
        body: &CpuBody<f64>,
        (network, faces): (&'a DiscreteModel, &'a [[u32; 3]]),
        terms: &'a [Arc<dyn NodeTerm>],
        tools: &'a [Tool],
    ) -> Equilibrium<'a> {
        let muscles = self.muscle.iter().map(|(muscle, _)| (muscle, 1));
        Equilibrium {
            mesh: &self.mesh,
            material: &self.material,
            network,
            terms,
            tools,
            faces,
            muscles: muscles.collect(),
            self_contact: self.self_contact.as_ref(),
            amplitudes: self.amplitudes(),
            gravity: self.gravity,
            pinned: &self.pinned,
            fixed: self.pinned.clone(),
            element_of_tet: elements_of_tets(network, &self.mesh),
            x: body.positions(),
            inertia: Vec::new(),
            forces: MeasuredForces {
                tools: body.tool_forces(),
                nodes: body.forces(),
                rigid: body.rigid_forces(),
            },
        }
    }

    /// Returns the values of quantities at the settled state.
    fn values(&self, settled: &Settled, quantities: &[Quantity]) -> Vec<f64> {
        let terms = self.terms();
        let tools: Vec<Tool> = self.tool.iter().cloned().collect();
        let of_model = (&settled.network, &settled.faces[..]);
        let body = self.equilibrium(&settled.body, of_model, &terms, &tools);
        let value = |quantity: &Quantity| match prepare(quantity, &body).unwrap() {
            PreparedQuantity::Force(_, value) => value,
            PreparedQuantity::Function(f) => f.value(&body, body.network, &body.x),
        };
        quantities.iter().map(value).collect()
    }

    /// Returns the gradient at the settled state, with these parts of the tangent.
    pub fn gradient_with(
        &self,
        settled: &mut Settled,
        quantity: &Quantity,
        parameters: &[Parameter],
        parts: TangentParts,
    ) -> crate::Result<Gradient> {
        let balance = TetBody::force_balance(&settled.body, &settled.network.nodal_stiffness());
        let imbalance = check_balance(&balance)?;
        let terms = self.terms();
        let tools: Vec<Tool> = self.tool.iter().cloned().collect();
        let Settled {
            body,
            network,
            faces,
            ..
        } = settled;
        let equilibrium = self.equilibrium(body, (network, faces), &terms, &tools);
        let mut body = WithParts(body, parts);
        let found = gradient(&equilibrium, &mut body, quantity, parameters)?;
        Ok(Gradient { imbalance, ..found })
    }
    pub fn gradient(
        &self,
        settled: &mut Settled,
        quantity: &Quantity,
        parameters: &[Parameter],
    ) -> crate::Result<Gradient> {
        self.gradient_with(settled, quantity, parameters, TangentParts::default())
    }

    /// Returns the case with a parameter changed, which is of a whole region.
    fn changed(&self, parameter: &Parameter, by: f64) -> Case {
        let mut case = self.clone();
        let label = |tets: &[u32]| i64::from(*tets == self.region(1.0)[..]);
        match parameter {
            Parameter::Young { tets } if label(tets) == 1 => {
                case.material.regions.get_mut(&1).unwrap().stiffness += by;
            }
            Parameter::Young { .. } => {
                case.material.stiffness = crate::physics::Stiffness::Young(YOUNG + by);
            }
            Parameter::Poisson { tets } if label(tets) == 1 => {
                case.material.regions.get_mut(&1).unwrap().poisson += by;
            }
            Parameter::Poisson { .. } => case.material.poisson += by,
            Parameter::Density { tets } if label(tets) == 1 => {
                case.material.regions.get_mut(&1).unwrap().density += by;
            }
            Parameter::Density { .. } => case.material.density += by,
            Parameter::Load { node, direction } => {
                case.loads[*node as usize] += by * *direction;
            }
            Parameter::Gravity { direction } => case.gravity += by * *direction,
            Parameter::Amplitude(id) if id.0 == 0 => case.pressure.as_mut().unwrap().1 += by,
            Parameter::Amplitude(_) => case.muscle.as_mut().unwrap().1 += by,
            Parameter::ToolPosition { direction, .. } => {
                let pose = &mut case.tool.as_mut().unwrap().pose;
                *pose = ToolPose::new(pose.position() + by * *direction, pose.rotation());
            }
            Parameter::ToolRotation { axis, .. } => {
                let pose = &mut case.tool.as_mut().unwrap().pose;
                let turn = DQuat::from_scaled_axis(by * *axis) * pose.rotation();
                *pose = ToolPose::new(pose.position(), turn);
            }
            Parameter::ToolFriction { .. } => case.tool.as_mut().unwrap().friction += by,
            Parameter::Support { direction, .. } => case.pull += by * *direction,
            Parameter::RestPosition { node, direction } => {
                case.mesh.nodes[*node as usize] += by * *direction;
            }
            Parameter::InitialPosition { node, direction } => {
                case.offsets[*node as usize] += by * *direction;
            }
            Parameter::InitialVelocity { node, direction } => {
                case.velocities[*node as usize] += by * *direction;
            }
            Parameter::DampingTime => case.material.damping_time += by,
            Parameter::MassDamping => case.material.mass_damping += by,
        }
        case
    }

    /// Step of the differences of a parameter.
    fn step(&self, parameter: &Parameter) -> f64 {
        let step = match parameter {
            Parameter::Young { .. } => 5e-3 * YOUNG,
            Parameter::Poisson { .. } => 2e-4,
            Parameter::Density { .. } => 10.0,
            Parameter::Load { .. } => 2e-4,
            Parameter::Gravity { .. } => 0.05,
            Parameter::Amplitude(id) if id.0 == 0 => 2.0,
            Parameter::Amplitude(_) => 5e-3,
            Parameter::ToolPosition { .. } => 2e-6,
            Parameter::ToolRotation { .. } => 2e-4,
            // A node that begins to slide is a kink.
            Parameter::ToolFriction { .. } => 2e-3,
            Parameter::Support { .. } => 2e-5,
            Parameter::RestPosition { .. } | Parameter::InitialPosition { .. } => 2e-5,
            Parameter::InitialVelocity { .. } => 2e-3,
            Parameter::DampingTime => 2e-5,
            Parameter::MassDamping => 0.2,
        };
        self.difference * step
    }

    /// Returns for each quantity and parameter the derivative by differences of fourth order.
    pub fn differences(&self, quantities: &[Quantity], parameters: &[Parameter]) -> Vec<Vec<f64>> {
        self.differences_of(parameters, |case| case.values(&case.settle(), quantities))
    }

    /// As [`Case::differences`], of the numbers that `values` returns.
    fn differences_of(
        &self,
        parameters: &[Parameter],
        values: impl Fn(&Case) -> Vec<f64>,
    ) -> Vec<Vec<f64>> {
        let mut all = Vec::new();
        for parameter in parameters {
            let h = self.step(parameter);
            let values = [-2.0, -1.0, 1.0, 2.0].map(|by| values(&self.changed(parameter, by * h)));
            all.resize(values[0].len(), Vec::new());
            for (q, derivatives) in all.iter_mut().enumerate() {
                let [a, b, c, d] = [0, 1, 2, 3].map(|k| values[k][q]);
                derivatives.push((8.0 * (c - b) - (d - a)) / (12.0 * h));
            }
        }
        all
    }

    /// Checks all derivatives against differences, and that one in error by a thousandth would not
    /// pass. Returns the largest relative difference.
    pub fn check(&self, quantities: &[Quantity], parameters: &[Parameter], tolerance: f64) -> f64 {
        let differences = self.differences(quantities, parameters);
        let mut settled = self.settle();
        let mut worst: f64 = 0.0;
        for (quantity, expected) in quantities.iter().zip(&differences) {
            let found = self.gradient(&mut settled, quantity, parameters).unwrap();
            let name = format!("{quantity:?}");
            worst = worst.max(self.compare(&name, &found, (parameters, expected), tolerance));
        }
        println!("largest relative difference {worst:.1e}");
        worst
    }

    /// Checks the derivatives of the quantity `name` against differences. Returns the largest
    /// relative difference.
    fn compare(
        &self,
        name: &str,
        found: &Gradient,
        (parameters, expected): (&[Parameter], &[f64]),
        tolerance: f64,
    ) -> f64 {
        let mut worst: f64 = 0.0;
        for (k, parameter) in parameters.iter().enumerate() {
            let (a, b) = (found.derivatives[k], expected[k]);
            // Values of the quantity have rounding errors, which differences magnify.
            let floor = 1e-7 * found.value.abs() / self.step(parameter);
            let scale = b.abs().max(floor);
            let off = (a - b).abs() / scale;
            println!("{name} {parameter:.60?}: {a:.9e} {b:.9e} {off:.1e}");
            worst = worst.max(off);
            assert!(
                off <= tolerance,
                "{name} by {parameter:?}: {a} instead of {b} ({off:.1e})"
            );
            let wrong = (1.001 * a - b).abs() / scale;
            assert!(a.abs() < 1e-2 * scale || wrong > tolerance);
        }
        worst
    }
}
