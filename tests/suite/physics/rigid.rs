//! Rigid regions in scenes and engines.

use crate::support::gpu;
use glam::DVec3;
use palpate::generate;
use palpate::mesh::{Blade, Field, Location, TetMesh};
use palpate::physics::{
    Engine, EngineChoice, Material, MaterialModel, Member, MultiBody, Simulator, SolverKind,
};
use palpate::scene::{Scene, Stage};

/// A bar along x with a bone in its middle half.
fn bar() -> (TetMesh, Material) {
    let mut mesh = generate::bar([12, 4, 4], DVec3::new(1.2, 0.4, 0.4)).unwrap();
    let labels = (0..mesh.tets.len()).map(|t| {
        let x = mesh.tet_nodes(t).iter().map(|p| p.x).sum::<f64>() / 4.0;
        if (0.3..0.9).contains(&x) { 1.0 } else { 0.0 }
    });
    let labels = Field::scalar("label", Location::Cell, labels.collect());
    mesh.set_field(labels).unwrap();
    let mut material = Material {
        model: MaterialModel::NeoHookean,
        region_field: Some("label".into()),
        ..Material::soft_tissue()
    };
    material.rigid.insert(1);
    (mesh, material)
}

#[test]
fn implicit_schemes_support_rigid_regions() {
    let gpu = gpu();
    let (mesh, material) = bar();
    let made = |choice: EngineChoice, kind: SolverKind| {
        choice.build_tets(&gpu, mesh.clone(), &material, kind)
    };
    for engine in [Engine::Cpu, Engine::Gpu] {
        let body = made(EngineChoice::Exactly(engine), SolverKind::Implicit).unwrap();
        assert_eq!(body.engine(), engine);
        assert_eq!(body.model().unwrap().rigid_bodies().len(), 1);
    }
    let second = made(EngineChoice::Auto, SolverKind::Midpoint).unwrap();
    assert_eq!(second.engine(), Engine::Cpu);
    let refused = |engine, kind| {
        let made = made(EngineChoice::Exactly(engine), kind);
        made.err().unwrap().to_string()
    };
    for kind in [SolverKind::Verlet, SolverKind::Explicit] {
        let on_cpu = refused(Engine::Cpu, kind);
        let here = "use implicit, bdf2 or midpoint";
        assert!(on_cpu.contains(here), "{on_cpu}");
        let on_gpu = refused(Engine::Gpu, kind);
        let here = "use --solver implicit, or bdf2 or midpoint on the CPU";
        assert!(on_gpu.contains(here), "{on_gpu}");
    }
    let on_gpu = refused(Engine::Gpu, SolverKind::Bdf2);
    assert!(on_gpu.contains("--engine cpu"), "{on_gpu}");
    let springs = Material {
        model: MaterialModel::Springs,
        ..material.clone()
    };
    let springs = EngineChoice::Auto.build_tets(&gpu, mesh.clone(), &springs, SolverKind::Implicit);
    let springs = springs.err().unwrap().to_string();
    assert!(
        springs.contains("springs do not support rigid regions"),
        "{springs}"
    );
}

#[test]
fn bone_cut_through_becomes_two_bodies() {
    for (engine, shape) in [(Engine::Cpu, 1e-9), (Engine::Gpu, 1e-6)] {
        cut_through(engine, shape);
    }
}

/// `shape`: maximum change of distances within a bone, m.
fn cut_through(engine: Engine, shape: f64) {
    let (gpu, (mesh, material)) = (gpu(), bar());
    let choice = EngineChoice::Exactly(engine);
    let body = choice.build_tets(&gpu, mesh, &material, SolverKind::Implicit);
    let mut body = body.unwrap();
    let end = |v: &u32| body.mesh().nodes[*v as usize].x < 1e-6;
    let end: Vec<u32> = (0..body.mesh().nodes.len() as u32).filter(end).collect();
    body.pin_nodes(&end).unwrap();
    body.loads_mut().set_gravity(DVec3::new(0.0, 0.0, -9.81));
    body.run(5, 0.01).unwrap();
    let momentum = |body: &dyn Simulator| -> DVec3 {
        let all = body.velocities().unwrap().into_iter().zip(body.masses());
        all.map(|(v, m)| v * *m).sum()
    };
    let (before, was) = (body.positions().unwrap(), momentum(&*body));
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let blade = Blade::from_quad(corners.map(|[y, z]| DVec3::new(0.61, y, z))).unwrap();
    let change = body.cut(&blade).unwrap();
    assert!(!change.mesh.duplicated_nodes.is_empty());
    let bones = body.model().unwrap().rigid_bodies().to_vec();
    assert_eq!(bones.len(), 2);
    let after = body.positions().unwrap();
    let moved = before.iter().zip(&after).map(|(a, b)| a.distance(*b));
    assert!(moved.fold(0.0, f64::max) < 1e-6);
    assert!(momentum(&*body).distance(was) < 1e-2 * was.length());
    body.run(30, 0.01).unwrap();
    let now = body.positions().unwrap();
    let rest = &body.mesh().nodes;
    let gap = |nodes: &[u32], x: &[DVec3]| {
        let all = nodes.iter().flat_map(|a| nodes.iter().map(move |b| (a, b)));
        let off = all.map(|(a, b)| {
            let [a, b] = [a, b].map(|v| *v as usize);
            (x[a].distance(x[b]) - rest[a].distance(rest[b])).abs()
        });
        off.fold(0.0, f64::max)
    };
    for bone in &bones {
        assert!(gap(&bone.nodes, &now) < shape, "{engine}");
    }
    // The separated part has fallen.
    let both: Vec<u32> = bones.iter().flat_map(|b| b.nodes.clone()).collect();
    assert!(gap(&both, &now) > 0.1);
}

#[test]
fn scene_declares_rigid_regions() {
    let (mut mesh, _) = bar();
    let label = mesh.fields.iter_mut().find(|f| f.name == "label").unwrap();
    // The bone consists of two regions.
    let labels = &mut label.values;
    for (l, tet) in labels.iter_mut().zip(&mesh.tets) {
        let x: f64 = tet.iter().map(|v| mesh.nodes[*v as usize].x / 4.0).sum();
        if *l == 1.0 && x > 0.6 {
            *l = 2.0;
        }
    }
    mesh.region_names = [(1, "long bone".to_owned()), (2, "marrow".to_owned())].into();
    let text = "[mesh]\ngenerate = \"box\"\n\
        [material]\nmodel = \"neo-hookean\"\nyoung = 1e5\n\
        bone = { rigid = true }\nmarrow = { rigid = true, density = 1000 }\n\
        [solver]\nname = \"implicit\"\ndt = 0.01\nsteps = 2\n\
        [[pin]]\naxis = \"x\"\nbelow = 0.04\n";
    for engine in [Engine::Cpu, Engine::Gpu] {
        named(text, engine, &mesh);
    }
}

fn named(text: &str, engine: Engine, mesh: &TetMesh) {
    let gpu = gpu();
    let text = &text.replace("[solver]", &format!("[solver]\nengine = \"{engine}\""));
    let scene = Scene::parse(text).unwrap();
    let staged = |scene: &Scene| Stage::with_mesh(&gpu, scene, mesh.clone());
    let mut stage = staged(&scene).unwrap();
    let motion = stage.motion().unwrap();
    assert_eq!(motion.engine(), engine);
    assert_eq!(motion.rigid_bodies(), 1);
    let notes = stage.notes().join("\n");
    assert!(
        notes.contains("long bone (1) is bone, rigid: 1920 kg/m³"),
        "{notes}"
    );
    assert!(notes.contains("1 rigid body of 175 nodes"), "{notes}");
    assert!(
        notes.contains("share nodes form one body: long bone, marrow"),
        "{notes}"
    );
    stage.keep_checkpoints();
    stage.run(3, &mut |_| {}).unwrap();
    let half = stage.checkpoint(&[]).unwrap();
    stage.run(3, &mut |_| {}).unwrap();
    let mut resumed = staged(&scene).unwrap();
    resumed.resume(&half).unwrap();
    resumed.run(3, &mut |_| {}).unwrap();
    let nodes = |stage: &Stage| stage.deformed_mesh().unwrap().nodes;
    assert_eq!(nodes(&stage), nodes(&resumed));
    assert_ne!(nodes(&stage), stage.mesh().nodes);
    // A missing region is reported, and an engine without rigid regions rejects them.
    for (more, words) in [
        ("[cage]\nnodes = 100\n", "do not support rigid regions"),
        ("", "springs do not support rigid regions"),
    ] {
        let mut scene = Scene::parse(&format!("{text}{more}")).unwrap();
        if more.is_empty() {
            scene.material.model = Some(MaterialModel::Springs);
        }
        let message = staged(&scene).err().unwrap().to_string();
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn scene_splits_region_interfaces() {
    let text = "[mesh]\ngenerate = \"biceps\"\ntets = 1000\n";
    let whole = Scene::parse(text).unwrap().mesh.load().unwrap();
    let parted = format!("{text}split = [[\"tendon\", \"MUSCLE\"]]\n");
    let parted = Scene::parse(&parted).unwrap().mesh.load().unwrap();
    assert_eq!(parted.tets.len(), whole.tets.len());
    assert!(parted.nodes.len() > whole.nodes.len());
    let wrong = format!("{text}split = [[\"tendon\", \"wood\"]]\n");
    let message = Scene::parse(&wrong).unwrap().mesh.load().unwrap_err();
    assert!(
        message.to_string().contains("\"wood\"; available"),
        "{message}"
    );
}

/// A rigid region of the second of two bodies has another label in the mesh of both.
#[test]
fn region_force_of_one_of_several_bodies_is_its_own() {
    let gpu = gpu();
    let (mesh, material) = bar();
    let build = || {
        let cpu = EngineChoice::Exactly(Engine::Cpu);
        let mut body = cpu
            .build_tets(&gpu, mesh.clone(), &material, SolverKind::Implicit)
            .unwrap();
        body.pin(|p| p.x < 1e-6).unwrap();
        body.loads_mut().set_gravity(DVec3::new(0.0, 0.0, -9.81));
        body
    };
    let member = |name: &str| Member {
        name: name.into(),
        simulator: build(),
        step: 0.01,
    };
    let mut both = MultiBody::new(&gpu, vec![member("one"), member("two")]).unwrap();
    both.loads_mut().set_gravity(DVec3::new(0.0, 0.0, -9.81));
    let mut alone = build();
    both.run(5, 0.01).unwrap();
    alone.run(5, 0.01).unwrap();
    let truth = alone.reactions().unwrap().region_force(1).unwrap().unwrap();
    assert!(truth.force.z > 1.0, "{truth:?}");
    let names = both.mesh().region_names.clone();
    let label = |name: &str| *names.iter().find(|(_, n)| *n == name).unwrap().0;
    let forces = both.reactions().unwrap();
    for name in ["one/1", "two/1"] {
        assert_eq!(
            forces.region_force(label(name)).unwrap(),
            Some(truth),
            "{name}"
        );
    }
    assert_eq!(forces.region_force(label("two/0")).unwrap(), None);
    assert_eq!(forces.region_force(99).unwrap(), None);
}
