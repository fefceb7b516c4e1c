//! Shared helpers of the tests of scenes: stages of scenes in TOML, and a box on a table under a
//! finger.

use crate::support::gpu;
use glam::DVec3;
use palpate::physics::Reaction;
use palpate::scene::{Scene, Stage};

/// A scene of a box of 0.1 m: number of tets, more entries of its material, entries of its solver.
macro_rules! box_scene {
    ($tets:literal, $material:literal, $solver:literal) => {
        concat!(
            "[mesh]\ngenerate = \"box\"\nunit = 1.0\ntets = ",
            $tets,
            "\n[material]\nmodel = \"neo-hookean\"\nyoung = 2e4\npoisson = 0.3\ndensity = 1000\n",
            $material,
            "\n[solver]\nname = \"implicit\"\n",
            $solver,
            "\n[picture]\nsize = [48, 36]\n"
        )
    };
}
pub(crate) use box_scene;

/// Pins the lowest nodes of the box.
pub const TABLE: &str = "[[pin]]\nname = \"table\"\naxis = \"z\"\nbelow = 0.01\n";

/// A fingertip that is pressed 15 mm into the box within 0.2 s.
pub const FINGER: &str = r#"
[[tool]]
name = "finger"
sphere = { radius = 0.02 }
at = [0.05, 0.05, 0.125]
path = [[0.0, 0, 0, 0], [0.2, 0, 0, -0.02]]
"#;

pub fn stage(text: &str) -> Stage {
    Stage::new(&gpu(), &Scene::parse(text).unwrap()).unwrap()
}

/// Returns the error of a scene that parses and makes no stage.
pub fn refused(text: &str) -> String {
    refused_scene(&Scene::parse(text).unwrap())
}

pub fn refused_scene(scene: &Scene) -> String {
    match Stage::new(&gpu(), scene) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("invalid scene accepted: {scene:?}"),
    }
}

pub fn run(stage: &mut Stage, steps: u32) {
    stage.run(steps, &mut |_| {}).unwrap();
}

pub fn positions(stage: &Stage) -> Vec<DVec3> {
    stage.motion().unwrap().positions().unwrap()
}

/// Returns the reaction on the support or tool `name`.
pub fn reaction(stage: &mut Stage, name: &str) -> Reaction {
    let all = stage.reactions().unwrap();
    let found = all.iter().find(|(own, _)| own == name);
    found.unwrap_or_else(|| panic!("no {name} in {all:?}")).1
}
