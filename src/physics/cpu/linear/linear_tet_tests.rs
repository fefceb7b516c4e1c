//! Tests of the coarse space of linear tets.
#![allow(clippy::unwrap_used)]

use super::cg::SystemOperator;
use super::linear_tet_nodes::LinearTetNodes;
use super::linear_tet_space::LinearTetSpace;
use super::rigid_projection::RigidProjection;
use crate::generate;
use crate::mesh::{ElementOrder, Field, Location, TetMesh};
use crate::physics::cpu::aggregation::Aggregates;
use crate::physics::cpu::body::CpuBody;
use crate::physics::cpu::body::tests::some;
use crate::physics::cpu::elements::quadratic_batch::QuadraticBatch;
use crate::physics::cpu::elements::term::ElementTerm;
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::{V4, from_metres};
use crate::physics::{
    CgSettings, DiscreteModel, LocalUnits, Material, MaterialModel, RegionMaterial, SolverKind,
};
use glam::DVec3;

const MASS: f64 = 0.03;

fn material(poisson: f64) -> Material {
    Material {
        model: MaterialModel::NeoHookean,
        order: ElementOrder::Quadratic,
        poisson,
        damping_time: 0.3,
        ..Material::from_young(1e5)
    }
}

fn bar(cells: [usize; 3]) -> TetMesh {
    let mesh = generate::bar(cells, DVec3::new(0.4, 0.1, 0.1)).unwrap();
    mesh.with_mid_edge_nodes().unwrap()
}

fn dot(a: &[V4<f64>], b: &[V4<f64>]) -> f64 {
    let products = a.as_flattened().iter().zip(b.as_flattened());
    products.map(|(a, b)| a * b).sum()
}

/// A body's system matrix at a deformed state, with some nodes fixed.
struct System {
    plan: Partition,
    terms: Vec<Box<dyn Term<f64>>>,
    masses: Vec<f64>,
    free: Vec<f64>,
    space: LinearTetSpace<f64>,
    nodes: LinearTetNodes,
    rest: Vec<DVec3>,
}

impl System {
    fn new(chunks: usize) -> System {
        let model = DiscreteModel::new(&bar([4, 2, 2]), &material(0.45)).unwrap();
        let elements = model.elements().unwrap();
        let count = model.rest_positions.len();
        let groups = Aggregates::new(&model.rest_positions, 12);
        let plan = Partition::with_chunks(groups.group_starts, chunks);
        let units = LocalUnits::from_model(&model);
        let mut engine_index = vec![0; count];
        for (k, v) in groups.order.iter().enumerate() {
            engine_index[*v as usize] = k as u32;
        }
        let layout = (&groups.order[..], units, &plan);
        let mut term =
            ElementTerm::<f64, QuadraticBatch<f64>>::new((&model, elements), layout, true);
        let moved = some(count, 3, 0.002);
        let order = || groups.order.iter().map(|v| *v as usize);
        let u: Vec<_> = order()
            .map(|v| from_metres(moved[v], units.length))
            .collect();
        let x = |v: usize| model.rest_positions[v].x;
        let free: Vec<f64> = order().map(|v| f64::from(u8::from(x(v) > 0.06))).collect();
        let mut diagonal = vec![[MASS, MASS, MASS, 0.0, 0.0, 0.0, 0.0, 0.0]; count];
        let share = SystemContribution {
            diagonal: &mut diagonal,
            stiffness_velocity: &mut vec![[0.0; 4]; count],
        };
        term.linearise(&plan, StateRef { u: &u, v: &u }, 0.7, share);
        let nodes = LinearTetNodes::new(elements, &engine_index, &plan, usize::MAX).unwrap();
        let terms: Vec<Box<dyn Term<f64>>> = vec![Box::new(term)];
        let mut space = LinearTetSpace::new(nodes.clone());
        space.factorise(
            |k| model.rest_positions[groups.order[k] as usize],
            |k| free[k] > 0.0,
            &diagonal,
            &terms[..],
            &RigidProjection::empty(),
        );
        System {
            masses: vec![MASS; count],
            plan,
            terms,
            free,
            space,
            nodes,
            rest: order().map(|v| model.rest_positions[v]).collect(),
        }
    }

    /// The largest difference of xᵀ (Pᵀ A P) y from (P x)ᵀ A (P y) for random x and y, relative.
    fn error(&self) -> f64 {
        let count = self.nodes.nodes.len();
        let operator = SystemOperator {
            plan: &self.plan,
            masses: &self.masses,
            free: &self.free,
            terms: &self.terms[..],
        };
        let [x, y] = [5, 6].map(|seed| -> Vec<V4<f64>> {
            let all = some(count, seed, 1.0).into_iter().enumerate();
            all.map(|(k, v)| {
                let free = self.free[self.nodes.nodes[k] as usize];
                [v.x * free, v.y * free, v.z * free, 0.0]
            })
            .collect()
        });
        let [px, py] = [&x, &y].map(|x| -> Vec<V4<f64>> {
            let parents = self.nodes.parents.iter().zip(&self.free);
            parents
                .map(|([a, b], free)| {
                    let (a, b) = (x[*a as usize], x[*b as usize]);
                    std::array::from_fn(|c| 0.5 * free * (a[c] + b[c]))
                })
                .collect()
        });
        let mut apy = vec![[0.0; 4]; px.len()];
        operator.multiply(&py, &mut apy);
        let exact = dot(&px, &apy);
        let mut ay = vec![[0.0; 4]; count];
        self.space.multiply(&y, &mut ay);
        (dot(&x, &ay) - exact).abs() / exact.abs()
    }
}

#[test]
fn matrix_of_linear_tets_is_the_galerkin_product() {
    for chunks in [1, 2, 3] {
        let mut system = System::new(chunks);
        assert!(system.space.is_ready());
        let error = system.error();
        assert!(error < 1e-12, "{chunks} chunks: {error}");
        // A wrong matrix is found.
        system.masses[system.nodes.nodes[40] as usize] *= 1.1;
        assert!(system.error() > 1e-6);
    }
}

/// Every node of the straight bar rests in the middle of its parents.
#[test]
fn parents_are_the_ends_of_each_edge() {
    let System { nodes, rest, .. } = System::new(2);
    let at = |k: u32| rest[nodes.nodes[k as usize] as usize];
    for (x, [a, b]) in rest.iter().zip(&nodes.parents) {
        assert!(x.distance(0.5 * (at(*a) + at(*b))) < 1e-12);
    }
    // A grid of 5 × 3 × 3 corners; a middle counts for both ends of its edge.
    assert_eq!(nodes.nodes.len(), 45);
    let children: usize = (0..45).map(|k| nodes.middles(k).len()).sum();
    assert_eq!(children, 2 * nodes.removed());
}

/// Returns the iterations of conjugate gradients in the first step of a bar that bends, with a core
/// of another stiffness, or rigid.
fn iterations(cells: [usize; 3], poisson: f64, core: Option<f64>, rigid: bool) -> u32 {
    let mut mesh = bar(cells);
    let labels = (0..mesh.tets.len()).map(|t| {
        let centre = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
        let inside = (centre.y - 0.05).abs() < 0.025 && (centre.z - 0.05).abs() < 0.025;
        f64::from(u8::from(inside && centre.x > 0.1))
    });
    mesh.fields
        .push(Field::scalar("core", Location::Cell, labels.collect()));
    let mut material = Material {
        region_field: Some("core".into()),
        ..material(poisson)
    };
    if let Some(factor) = core {
        let stiffer = RegionMaterial {
            stiffness: 1e5 * factor,
            density: material.density,
            poisson,
        };
        material.regions.insert(1, stiffer);
    }
    if rigid {
        material.rigid.insert(1);
    }
    let model = DiscreteModel::new(&mesh, &material).unwrap();
    let settings = CgSettings::default();
    let mut body = CpuBody::<f64>::new(&model, SolverKind::Implicit, settings, Some(2)).unwrap();
    let pinned: Vec<bool> = mesh.nodes.iter().map(|x| x.x < 1e-9).collect();
    body.set_pinned(&pinned).unwrap();
    body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
    body.run(1, 0.02).unwrap().iterations
}

#[test]
fn iterations_do_not_grow_with_the_mesh() {
    for (poisson, core, rigid, most) in [
        (0.3, None, false, 18),
        (0.45, None, false, 32),
        (0.45, Some(1e4), false, 66),
        (0.45, None, true, 30),
    ] {
        let [coarse, fine] =
            [[8, 4, 4], [16, 8, 8]].map(|cells| iterations(cells, poisson, core, rigid));
        println!("ν {poisson}, core {core:?}, rigid {rigid}: {coarse}, {fine} iterations");
        assert!(
            coarse.max(fine) <= most && fine <= coarse + 2,
            "ν {poisson}, core {core:?}, rigid {rigid}: {coarse}, then {fine} iterations"
        );
    }
}
