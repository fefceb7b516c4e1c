//! Bodies of elements in static equilibrium under loads, against formulas and quadratic tets of
//! another library (benches/peers/reference_statics.py).

mod beam;
mod cantilever;
mod cook;
pub mod cylinder;
mod quadratic;
mod refusals;
mod twist;

use crate::support::gpu;
use glam::{DMat3, DVec3};
use palpate::mesh::{ElementOrder, LocalFrame, TET_EDGES, TetMesh};
use palpate::physics::{
    CgSettings, CpuTets, DiscreteModel, Elements, LocalUnits, Material, MaterialModel, NodeTerm,
    Precision, ScaledLoad, Simulator, SolverKind, VolumetricFormulation,
};
use std::sync::Arc;

const YOUNG: f64 = 1e5;

const VOLUMES: [VolumetricFormulation; 2] = VolumetricFormulation::ALL;

/// Elements of stable Neo-Hookean material.
fn material(poisson: f64, volume: VolumetricFormulation) -> Material {
    Material {
        model: MaterialModel::NeoHookean,
        poisson,
        volume,
        ..Material::from_young(YOUNG)
    }
}

/// A body at rest.
struct Rest {
    /// Current and rest positions of its nodes.
    places: Vec<DVec3>,
    from: Vec<DVec3>,
    elements: Elements,
}

impl Rest {
    fn moved(&self, node: usize) -> DVec3 {
        self.places[node] - self.from[node]
    }

    /// Elastic energy, J.
    fn energy(&self) -> f64 {
        self.elements.energy(&self.places)
    }
}

/// A body with its loads and constraints.
struct Setup<'a> {
    mesh: &'a TetMesh,
    material: Material,
    /// Ratio of λ to μ that tets keep, if it is not the default.
    kept: Option<f64>,
    pinned: Vec<u32>,
    /// On the nodes, N.
    forces: Vec<DVec3>,
    /// A load with its amplitude.
    scaled_load: Option<(ScaledLoad, f64)>,
    /// Initial positions of the nodes; pinned nodes stay there.
    start: Option<Vec<DVec3>>,
    slides: Option<Slides>,
}

impl<'a> Setup<'a> {
    fn new(mesh: &'a TetMesh, poisson: f64, volume: VolumetricFormulation) -> Setup<'a> {
        Setup {
            mesh,
            material: material(poisson, volume),
            kept: None,
            pinned: Vec::new(),
            forces: Vec::new(),
            scaled_load: None,
            start: None,
            slides: None,
        }
    }

    /// Setup of a mesh with mid-edge nodes.
    fn quadratic(mesh: &'a TetMesh, poisson: f64) -> Setup<'a> {
        let mut setup = Setup::new(mesh, poisson, VolumetricFormulation::PerTet);
        setup.material.order = ElementOrder::Quadratic;
        setup
    }

    /// Returns the equilibrium in float64. The steps are long enough for inertia to be negligible.
    fn rest(self) -> Rest {
        let mut discrete_model = DiscreteModel::new(self.mesh, &self.material).unwrap();
        if let Some(kept) = self.kept {
            discrete_model.elements_mut().unwrap().per_tet_lambda_ratio = kept;
        }
        let settings = CgSettings {
            tolerance: 1e-8,
            acceptable: 1e-2,
            max_iterations: 20_000,
        };
        let from = discrete_model.rest_positions.clone();
        let elements = discrete_model.elements().unwrap().clone();
        let frame = discrete_model.frame;
        let (mesh, material, kind) = (self.mesh.clone(), &self.material, SolverKind::Implicit);
        let made = CpuTets::of_model(
            &gpu(),
            (mesh, discrete_model),
            material,
            (kind, settings),
            Precision::Double,
        );
        let mut body = made.unwrap();
        body.pin_nodes(&self.pinned).unwrap();
        if !self.forces.is_empty() {
            body.set_forces(&self.forces).unwrap();
        }
        if let Some((load, amplitude)) = self.scaled_load {
            let loads = body.scaled_loads().unwrap();
            let id = loads.add_scaled_load(load).unwrap();
            loads.set_amplitude(id, amplitude).unwrap();
        }
        if let Some(start) = &self.start {
            body.set_positions(start).unwrap();
        }
        if let Some(slides) = self.slides {
            body.add_term(Arc::new(slides.in_frame(frame))).unwrap();
        }
        body.run(3, 100.0).unwrap();
        let places = body.positions().unwrap();
        Rest {
            places: places.iter().map(|p| *p - frame.origin).collect(),
            from,
            elements,
        }
    }
}

/// Constrains the nodes of a slab one cell thick to the planes of its faces, and to the one halfway
/// between, where mid-edge nodes are: plane strain.
#[derive(Debug, Clone, Copy)]
struct Slides {
    /// z of both faces.
    faces: [f64; 2],
    /// N/m per node.
    stiffness: f64,
}

impl Slides {
    /// Stiff enough to reduce the out-of-plane displacement of the nodes to about 1e-5 of the free
    /// one.
    fn of(thickness: f64) -> Slides {
        Slides {
            faces: [0.0, thickness],
            stiffness: 1e5 * YOUNG * thickness,
        }
    }

    fn in_frame(self, frame: LocalFrame) -> Slides {
        Slides {
            faces: self.faces.map(|z| z - frame.origin.z),
            ..self
        }
    }

    fn off(&self, x: DVec3) -> f64 {
        let [low, high] = self.faces;
        let halves = (2.0 * (x.z - low) / (high - low)).round().clamp(0.0, 2.0);
        x.z - low - 0.5 * halves * (high - low)
    }
}

impl NodeTerm for Slides {
    fn name(&self) -> &'static str {
        "slides"
    }

    fn shader_parameters(&self, _: &LocalFrame, _: &LocalUnits, _: f64) -> [[f32; 4]; 2] {
        [[0.0; 4]; 2]
    }

    fn energy(&self, _: f64, x: DVec3) -> f64 {
        0.5 * self.stiffness * self.off(x).powi(2)
    }

    fn force(&self, _: f64, x: DVec3) -> DVec3 {
        -self.stiffness * self.off(x) * DVec3::Z
    }

    fn hessian(&self, _: f64, _: DVec3) -> DMat3 {
        DMat3::from_diagonal(self.stiffness * DVec3::Z)
    }

    fn max_stiffness(&self, _: f64) -> f64 {
        self.stiffness
    }
}

/// Returns the nodes at the positions accepted by `where_`.
fn nodes(mesh: &TetMesh, where_: impl Fn(DVec3) -> bool) -> Vec<u32> {
    let all = mesh.nodes.iter().enumerate();
    all.filter(|(_, p)| where_(**p))
        .map(|(i, _)| i as u32)
        .collect()
}

/// Returns the forces on the nodes of the flat boundary faces whose corners `on` accepts: the
/// integrals of the shape functions times `traction` of the area vector (outward). A third for each
/// corner of a linear tet, or for each node in the middle of an edge of a quadratic one.
fn face_forces(
    mesh: &TetMesh,
    order: ElementOrder,
    on: impl Fn(DVec3) -> bool,
    traction: impl Fn(DVec3) -> DVec3,
) -> Vec<DVec3> {
    let mut forces = vec![DVec3::ZERO; mesh.nodes.len()];
    let mut load = |corners: [u32; 4], loaded: &dyn Fn(usize) -> [u32; 3]| {
        let x = corners.map(|v| mesh.nodes[v as usize]);
        for opposite in 0..4 {
            let mut face = (0..4).filter(|k| *k != opposite).map(|k| x[k]);
            if !face.clone().all(&on) {
                continue;
            }
            let [a, b, c] = std::array::from_fn(|_| face.next().unwrap());
            let area = 0.5 * (b - a).cross(c - a);
            let inwards = area.dot(x[opposite] - a) > 0.0;
            let area = if inwards { -area } else { area };
            for v in loaded(opposite) {
                forces[v as usize] += traction(area) / 3.0;
            }
        }
    };
    match order {
        ElementOrder::Linear => {
            for tet in &mesh.tets {
                load(*tet, &|opposite| three(tet, |k| k != opposite));
            }
        }
        ElementOrder::Quadratic => {
            for element in mesh.ten_node_tets().unwrap() {
                let corners = std::array::from_fn(|k| element[k]);
                let middles = &element[4..];
                load(corners, &|opposite| {
                    three(middles, |edge| !TET_EDGES[edge].contains(&opposite))
                });
            }
        }
    }
    forces
}

/// Returns the three of `nodes` whose indices `is` accepts.
fn three(nodes: &[u32], is: impl Fn(usize) -> bool) -> [u32; 3] {
    let mut all = (0..nodes.len()).filter(|k| is(*k)).map(|k| nodes[k]);
    std::array::from_fn(|_| all.next().unwrap())
}

/// Returns the relative root mean square error of displacements.
fn relative_error(rest: &Rest, exact: impl Iterator<Item = DVec3>) -> f64 {
    let (mut off, mut all) = (0.0, 0.0);
    for (i, exact) in exact.enumerate() {
        off += rest.moved(i).distance_squared(exact);
        all += exact.length_squared();
    }
    (off / all).sqrt()
}

/// Returns the order of convergence of values on three meshes, each twice as fine as the one
/// before, and the extrapolated limit.
fn order([a, b, c]: [f64; 3]) -> (f64, f64) {
    let order = ((a - b) / (b - c)).abs().log2();
    (order, c + (c - b) / (2.0f64.powf(order) - 1.0))
}

#[test]
fn convergence_order_is_recovered() {
    let (found, limit) = order([1.0, 2.0, 4.0].map(|n: f64| 3.0 + 0.4 * n.powf(-1.5)));
    assert!((found - 1.5).abs() < 1e-9 && (limit - 3.0).abs() < 1e-9);
}
