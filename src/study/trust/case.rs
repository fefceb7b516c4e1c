//! The cases of the study: bodies, materials and loads, drawn at random with fixed seeds.

use crate::generate::by_name_with_progress;
use crate::mesh::{ElementOrder, Field, Location, TetMesh};
use crate::random::Random;
use crate::scene::{OrderChoice, Scene};
use crate::{Result, no_progress};
use glam::DVec3;

/// Bodies, in turn, with the smallest numbers of tets that they have.
const BODIES: [(&str, f64); 6] = [
    ("box", 0.0),
    ("breast", 1000.0),
    ("limb", 2000.0),
    ("liver", 1000.0),
    ("ball", 0.0),
    ("biceps", 1000.0),
];
/// Loads, in turn.
const LOADS: [Load; 4] = [Load::Press, Load::Sag, Load::Press, Load::Twist];
/// Poisson's ratios and stiffness ratios of the core, drawn at random.
const POISSON: [f64; 4] = [0.3, 0.4, 0.45, 0.49];
const CONTRASTS: [f64; 4] = [1.0, 10.0, 100.0, 1000.0];
/// Young's modulus outside of the core, Pa.
const YOUNG: f64 = 2e4;
/// Smallest and largest number of tets asked for.
const TETS: [f64; 2] = [200.0, 2000.0];
/// Radius of the core, over the largest extent.
const CORE_RADIUS: f64 = 0.2;

/// What a body is under.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Load {
    /// A fingertip; measures its force, N.
    Press,
    /// Its weight; measures the largest displacement, in file units.
    Sag,
    /// One end turned against the other; measures the elastic energy, J.
    Twist,
}

impl Load {
    pub fn name(self) -> &'static str {
        match self {
            Load::Press => "press",
            Load::Sag => "sag",
            Load::Twist => "twist",
        }
    }
}

/// A body under a load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Case {
    /// Its number, which all other numbers follow from.
    pub number: usize,
    pub body: &'static str,
    pub load: Load,
    /// Number of tets asked for.
    pub tets: usize,
    pub poisson: f64,
    /// Young's modulus of the core over that of the rest.
    pub contrast: f64,
    random: Random,
}

impl Case {
    /// Returns case `number`.
    pub fn new(number: usize) -> Case {
        let mut random = Random::new(1 + number as u64);
        let (body, fewest) = BODIES[(number / LOADS.len()) % BODIES.len()];
        let [least, most] = TETS.map(|tets| tets.max(fewest).ln());
        Case {
            number,
            body,
            load: LOADS[number % LOADS.len()],
            tets: (least + (most - least) * random.next()).exp().round() as usize,
            poisson: random.pick(&POISSON),
            contrast: random.pick(&CONTRASTS),
            random,
        }
    }

    /// Returns the random numbers that remain for the load.
    pub fn random(&self) -> Random {
        let mut random = self.random;
        random.point();
        random
    }

    /// Returns the mesh, with the stiffness of each tet as a field: a core around a random point is
    /// stiffer.
    ///
    /// # Errors
    /// Errors of the generator.
    pub fn mesh(&self) -> Result<TetMesh> {
        let mut mesh = by_name_with_progress(self.body, Some(self.tets), None, &no_progress)?;
        let (low, high) = mesh.bounds();
        let core = 0.5 * (low + high) + 0.25 * self.random.clone().point() * (high - low);
        let radius = CORE_RADIUS * (high - low).max_element();
        let stiffness = |t: usize| {
            let centre = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
            match centre.distance(core) < radius {
                true => self.contrast,
                false => 1.0,
            }
        };
        let values = (0..mesh.tets.len()).map(stiffness).collect();
        mesh.fields = vec![Field::scalar("contrast", Location::Cell, values)];
        Ok(mesh)
    }

    /// Returns the scene of the body with elements of `order`, without loads and supports.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if it is invalid.
    pub fn scene(&self, order: ElementOrder) -> Result<Scene> {
        let mut scene = Scene::parse(&format!(
            "[mesh]\ngenerate = \"{}\"\n[material]\nmodel = \"neo-hookean\"\nyoung = {YOUNG}\npoisson = {}\nstiffness_field = \"contrast\"\n[solver]\nname = \"implicit\"\nengine = \"cpu\"\ngravity = [0, 0, 0]\n[[pin]]\naxis = \"x\"\nbelow = 0.05",
            self.body, self.poisson
        ))?;
        scene.material.order = Some(OrderChoice::Exactly(order));
        Ok(scene)
    }

    /// Returns Young's modulus outside of the core, Pa.
    pub fn young(&self) -> f64 {
        YOUNG
    }
}
