//! Shared helpers of the physics tests.

use glam::DVec3;
use palpate::gpu::Gpu;
use palpate::mesh::TetMesh;
use palpate::physics::reference::integrators::ReferenceIntegrator;
use palpate::physics::reference::springs::ReferenceSprings;
use palpate::physics::{DiscreteModel, GpuBody, Material, Solver, SolverKind};

/// A deterministic stream of numbers in −1..1.
pub struct Noise(pub u64);

impl Noise {
    pub fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    }

    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }

    pub fn vectors(&mut self, count: usize) -> Vec<DVec3> {
        (0..count).map(|_| self.vector()).collect()
    }
}

/// The same model on the GPU and in float64.
pub struct Twins {
    pub mesh: TetMesh,
    pub body: GpuBody,
    pub truth: ReferenceSprings,
}

impl Twins {
    pub fn new(gpu: &Gpu, mesh: &TetMesh, material: &Material) -> Twins {
        Twins {
            body: GpuBody::new(gpu, mesh, material).unwrap(),
            truth: ReferenceSprings::new(DiscreteModel::new(mesh, material).unwrap()),
            mesh: mesh.clone(),
        }
    }

    pub fn pin(&mut self, where_: impl Fn(DVec3) -> bool) {
        for (i, p) in self.mesh.nodes.iter().enumerate() {
            self.truth.pinned[i] |= where_(*p);
        }
        self.body.pin(where_);
    }

    pub fn gravity(&mut self, gravity: DVec3) {
        self.body.set_gravity(gravity);
        self.truth.gravity = gravity;
    }

    /// Displaces every node by up to `amount` of the extent, with velocities of up to `speed` m/s;
    /// the reference gets the values rounded to f32.
    pub fn disturb(&mut self, amount: f64, speed: f64, seed: u64) {
        let mut noise = Noise(seed);
        let extent = self.body.nodes().frame().scale;
        let unit = self.truth.model.length_unit;
        let x: Vec<DVec3> = self
            .mesh
            .nodes
            .iter()
            .map(|p| *p + amount * extent * noise.vector())
            .collect();
        let v: Vec<DVec3> = noise
            .vectors(x.len())
            .iter()
            .zip(self.body.pinned())
            .map(|(v, pinned)| {
                if *pinned {
                    DVec3::ZERO
                } else {
                    speed / unit * *v
                }
            })
            .collect();
        self.body.set_positions(&x).unwrap();
        self.body.set_velocities(&v).unwrap();
        self.take_over();
    }

    /// Sets the reference to the body's state.
    pub fn take_over(&mut self) {
        let model = &self.truth.model;
        let unit = model.length_unit;
        let x = self.body.positions().unwrap();
        let v = self.body.velocities().unwrap();
        self.truth.x = x.iter().map(|x| model.to_metres(*x)).collect();
        self.truth.v = v.iter().map(|v| *v * unit).collect();
    }

    /// Returns the largest differences of positions (m) and velocities (m/s).
    pub fn difference(&self) -> (f64, f64) {
        let model = &self.truth.model;
        let x = self.body.positions().unwrap();
        let v = self.body.velocities().unwrap();
        let most = |a: f64, b: f64| if b.is_nan() { f64::NAN } else { a.max(b) };
        let x = x.iter().zip(&self.truth.x);
        let v = v.iter().zip(&self.truth.v);
        (
            x.map(|(a, b)| model.to_metres(*a).distance(*b))
                .fold(0.0, most),
            v.map(|(a, b)| (*a * model.length_unit).distance(*b))
                .fold(0.0, most),
        )
    }
}

/// Makes `steps` steps of the scheme `kind` in float64.
pub fn step_truth(kind: SolverKind, p: &mut ReferenceSprings, steps: u32, h: f64) {
    let mut integrator = ReferenceIntegrator::new(kind, 1e-10);
    for _ in 0..steps {
        integrator.step(p, h).unwrap();
    }
}

pub fn solver(gpu: &Gpu, body: &GpuBody, kind: SolverKind) -> Box<dyn Solver> {
    kind.solver(gpu, body).unwrap()
}
