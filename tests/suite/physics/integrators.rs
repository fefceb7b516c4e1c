//! User-defined integrators and terms, implemented outside of the library.

use crate::support::gpu;
use glam::{DMat3, DVec3};
use palpate::generate;
use palpate::gpu::{Pass, Shaders};
use palpate::mesh::LocalFrame;
use palpate::physics::integrator::{Integrator, Stage, Step, StepResources, Timing};
use palpate::physics::{
    GpuBody, GpuTets, LocalUnits, Material, NodeTerm, Simulator, Solver, SolverKind, Stepper,
    SymplecticEuler,
};
use palpate::{Error, Result};
use std::sync::Arc;

palpate::gpu_struct! {
    /// Parameters of `lib/explicit_state`.
    struct MoveParams {
        nodes: u32,
        dt: f32,
        kick: f32,
        _pad0: u32,
    }
}

/// Leapfrog by kick and drift: a reimplementation of symplectic Euler.
const LEAPFROG: &str = "
#import lib/explicit_state

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes || status.failed != 0u {
        return;
    }
    let kicked = textureLoad(velocities, array_texel(i), 0).xyz + params.kick * acceleration(i);
    store(i, textureLoad(positions, array_texel(i), 0), params.dt * kicked, vec4(kicked, 0.0));
}
";

/// The step of [`LEAPFROG`]; `FORCES` is the number of force evaluations, which should be 1.
struct Leapfrog<const FORCES: usize>;

impl<const FORCES: usize> Integrator for Leapfrog<FORCES> {
    const KIND: SolverKind = SolverKind::Symplectic;
    const NAME: &'static str = "leapfrog";

    fn new(_: &StepResources, _: &GpuBody) -> Result<Self> {
        Shaders::add("suite/leapfrog", LEAPFROG)?;
        Ok(Leapfrog)
    }

    fn step(&self, core: &StepResources, body: &GpuBody, timing: Timing) -> Result<Step> {
        let pass: Pass = core
            .gpu()
            .pass("suite/leapfrog")
            .read(body.nodes().array())
            .read(body.velocity_array())
            .read(core.forces())
            .read(body.mass_array())
            .read(core.status())
            .write(core.next_positions())
            .write(core.next_velocities())
            .params(&MoveParams {
                nodes: core.nodes(),
                dt: timing.dt,
                kick: timing.dt,
                _pad0: 0,
            })
            .dispatch_items(core.nodes())?;
        let mut step = Step::explicit(pass);
        step.stages.resize(1 + FORCES, Stage::Forces(None));
        Ok(step)
    }
}

/// Returns a bar clamped at one end, which sags, with the solver of `solver`.
fn bar<S: Solver + 'static>(solver: impl Fn(&GpuBody) -> Result<S>) -> GpuTets {
    let gpu = gpu();
    let mesh = generate::bar([8, 2, 2], DVec3::new(0.4, 0.1, 0.1)).unwrap();
    let material = Material {
        damping_time: 1e-3,
        ..Material::from_young(5e4)
    };
    let mut body = GpuBody::new(&gpu, &mesh, &material).unwrap();
    body.clamp_one_end(9.81);
    let solver = solver(&body).unwrap();
    GpuTets::of_body(mesh, body, Box::new(solver)).unwrap()
}

#[test]
fn custom_integrator_matches_library_integrator() {
    let gpu = gpu();
    let mut own = bar(|body| Stepper::<Leapfrog<1>>::new(&gpu, body));
    let mut known = bar(|body| SymplecticEuler::new(&gpu, body));
    let dt = 0.5 * known.largest_stable_step().unwrap();
    assert_eq!(own.largest_stable_step(), known.largest_stable_step());
    for simulator in [&mut own, &mut known] {
        assert_eq!(simulator.run(100, dt).unwrap().steps, 100);
    }
    let moved = own.report().unwrap().max_displacement;
    assert!(moved > 1e-4, "{moved}");
    assert_eq!(own.positions().unwrap(), known.positions().unwrap());
    // The states of different solvers are incompatible.
    let state = own.checkpoint().unwrap().state().unwrap();
    own.checkpoint_mut().unwrap().set_state(&state).unwrap();
    let refused = known.checkpoint_mut().unwrap().set_state(&state);
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("leapfrog"), "{refused}");
    // A solver that never evaluates the candidate, or does so twice, is reported.
    for mut wrong in [
        bar(|body| Stepper::<Leapfrog<0>>::new(&gpu, body)),
        bar(|body| Stepper::<Leapfrog<2>>::new(&gpu, body)),
    ] {
        let refused = wrong.run(1, dt).unwrap_err().to_string();
        assert!(refused.contains("exactly one stage of forces"), "{refused}");
    }
}

/// A steady wind: E = −m a·x.
#[derive(Debug)]
struct Wind(DVec3);

const WIND: &str = "#term node

fn suite_wind_force(slot: u32, m: f32, x: vec3<f32>) -> vec4<f32> {
    let force = m * node_terms[2u * slot].xyz;
    return vec4(force, -dot(force, x));
}

fn suite_wind_block(slot: u32, m: f32, x: vec3<f32>) -> NodeBlock {
    return NodeBlock(vec3(0.0), vec3(0.0));
}
";

impl NodeTerm for Wind {
    fn name(&self) -> &'static str {
        "suite_wind"
    }

    fn shader_parameters(&self, _: &LocalFrame, units: &LocalUnits, _: f64) -> [[f32; 4]; 2] {
        let local = self.0 / units.acceleration();
        [local.as_vec3().extend(0.0).to_array(), [0.0; 4]]
    }

    fn energy(&self, m: f64, x: DVec3) -> f64 {
        -m * self.0.dot(x)
    }

    fn force(&self, m: f64, _: DVec3) -> DVec3 {
        m * self.0
    }

    fn hessian(&self, _: f64, _: DVec3) -> DMat3 {
        DMat3::ZERO
    }

    fn max_stiffness(&self, _: f64) -> f64 {
        0.0
    }
}

#[test]
fn custom_term_matches_equal_gravity() {
    Shaders::add("terms/suite_wind", WIND).unwrap();
    let across = DVec3::new(0.0, 3.0, -2.0);
    let gpu = gpu();
    let ends = [true, false].map(|blown| {
        let mut bar = bar(|body| SymplecticEuler::new(&gpu, body));
        bar.loads_mut().set_gravity(DVec3::ZERO);
        match blown {
            true => bar.add_term(Arc::new(Wind(across))).unwrap(),
            false => bar.loads_mut().set_gravity(across),
        }
        let dt = 0.5 * bar.largest_stable_step().unwrap();
        bar.run(100, dt).unwrap();
        bar.positions().unwrap()
    });
    let far = ends[0].iter().zip(&ends[1]);
    let far = far.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    let rest = generate::bar([8, 2, 2], DVec3::new(0.4, 0.1, 0.1)).unwrap();
    let moved = ends[0].iter().zip(&rest.nodes);
    let moved = moved.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    assert!(moved > 1e-4 && far < 1e-4 * moved, "{far} of {moved}");
}

#[test]
fn rejects_invalid_shaders() {
    for (name, source, words) in [
        ("alone", "", "a folder and a name"),
        ("suite/two words", "", "a folder and a name"),
        ("physics/forces", "", "already"),
        ("suite/broken", "fn main( {", "suite/broken"),
        ("suite/lost", "#import lib/nowhere\n", "lib/nowhere"),
    ] {
        let error: Error = Shaders::add(name, source).unwrap_err();
        assert!(error.to_string().contains(words), "{name}: {error}");
    }
    Shaders::add("suite/fine", "@compute @workgroup_size(1) fn main() {}").unwrap();
    Shaders::add("suite/fine", "@compute @workgroup_size(1) fn main() {}").unwrap();
    let other = "@compute @workgroup_size(2) fn main() {}";
    assert!(Shaders::add("suite/fine", other).is_err());
    // A rejected state can be corrected.
    Shaders::add("suite/broken", other).unwrap();
}
