//! Bars of coarse meshes, against closed forms of linear elasticity.

use crate::physics::statics::cylinder::ring;
use crate::support::gpu;
use glam::DVec3;
use palpate::accuracy::RestErrors;
use palpate::generate::{Split, box_mesh};
use palpate::mesh::{Field, Location, TetMesh};
use palpate::no_progress;
use palpate::press::{Press, PressOptions};
use palpate::scene::{Scene, Stage};
use std::f64::consts::PI;

const YOUNG: f64 = 1e5;
const POISSON: f64 = 0.3;
/// Share of the closed form that the polygons of a mesh, its finite size, its large strain and bonded
/// supports may differ from it.
const MODEL_ERROR: f64 = 0.03;

/// Distances of the planes of a half-space's mesh from its middle, and from its surface.
const PLANES: [f64; 7] = [0.0, 0.5, 1.0, 2.0, 4.0, 7.0, 12.0];

/// A number, its bar and the exact value.
#[derive(Debug)]
struct Compared {
    value: f64,
    error: f64,
    exact: f64,
}

impl Compared {
    /// Checks that the bar holds, says something, and is needed: half of it would not do.
    fn check(&self, what: &str) {
        let off = (self.value - self.exact).abs() / self.exact;
        let bar = self.error / self.exact;
        println!("{what}: {off:.3} off, bar {bar:.3}, {self:?}");
        assert!(off <= bar + MODEL_ERROR, "{what}: {self:?}");
        assert!(bar <= 4.0 * (off + MODEL_ERROR), "{what}: {self:?}");
        assert!(off > 0.05 && off > 0.25 * bar, "{what}: {self:?}");
    }
}

/// Returns the errors of a body of linear tets at rest under loads.
fn at_rest(mesh: TetMesh, loads: &str) -> (Stage, RestErrors) {
    let text = format!(
        "[mesh]\nfile = \"unused.vtu\"\n[material]\nyoung = {YOUNG}\npoisson = {POISSON}\norder = 1\n{loads}\n[solver]\nname = \"implicit\"\ndt = 1000\nengine = \"cpu\"\ngravity = [0, 0, 0]\ntolerance = 1e-6\n"
    );
    let scene = Scene::parse(&text).unwrap();
    let mut stage = Stage::with_mesh(&gpu(), &scene, mesh).unwrap();
    stage.run(6, &mut |_| {}).unwrap();
    let errors = RestErrors::estimate(&mut stage, &no_progress).unwrap();
    (stage, errors.unwrap())
}

fn displacement(mesh: TetMesh, loads: &str, exact: f64) -> Compared {
    let (stage, errors) = at_rest(mesh, loads);
    let value = stage.motion().unwrap().report().unwrap().max_displacement;
    Compared {
        value,
        error: errors.max_displacement.total(),
        exact,
    }
}

fn energy(mesh: TetMesh, loads: &str, exact: f64) -> Compared {
    let (stage, errors) = at_rest(mesh, loads);
    let value = stage.motion().unwrap().report().unwrap().energy.elastic;
    Compared {
        value,
        error: errors.elastic_energy.total(),
        exact,
    }
}

/// Returns a block with its surface at z = 0, with planes that lie farther apart away from the origin;
/// with a layer on top of the middle, if asked for.
fn half_space(layer: Option<f64>) -> TetMesh {
    let (side, deep) = (PLANES.len() - 1, PLANES.len() - 1);
    let high = deep + usize::from(layer.is_some());
    let cells = [2 * side, 2 * side, high];
    let mut mesh = box_mesh(cells, DVec3::ONE, Split::Six).unwrap();
    let across = |t: f64| {
        let k = (t * (2 * side) as f64).round() as isize - side as isize;
        PLANES[k.unsigned_abs()] * k.signum() as f64
    };
    for p in &mut mesh.nodes {
        let k = (p.z * high as f64).round() as usize;
        let z = match deep.checked_sub(k) {
            Some(below) => -PLANES[below],
            None => layer.unwrap_or_default(),
        };
        *p = DVec3::new(across(p.x), across(p.y), z);
    }
    mesh
}

/// Returns how much less the middle of a loaded patch sinks, because the block of depth 12 is fixed
/// below: Boussinesq's displacement there, for a force F = 1 N.
fn of_depth() -> f64 {
    (1.0 + POISSON) * (3.0 - 2.0 * POISSON) / (2.0 * PI * YOUNG * PLANES[6])
}

/// Love 1929: under an even pressure p on a square of side 2a, the middle sinks by
/// 8 ln(1 + √2) (1 − ν²) p a / (π E).
#[test]
fn bar_holds_boussinesq() {
    let p = 1e-4 * YOUNG;
    let front = 8.0 * (1.0 + 2f64.sqrt()).ln() / PI;
    let exact = front * (1.0 - POISSON * POISSON) * p / YOUNG - 4.0 * p * of_depth();
    let loads = format!(
        "[[pressure]]\non = {{ box = [[-1.01, -1.01, -0.01], [1.01, 1.01, 0.01]] }}\nnormal = [0, 0, 1]\npressure = {p}\n[[pin]]\nz_below = -11.9"
    );
    displacement(half_space(None), &loads, exact).check("Boussinesq");
}

/// Mossakovskii 1954: a rigid punch of radius a bonded to a half-space carries
/// F = 4 G a ln(3 − 4ν)/(1 − 2ν) u.
#[test]
fn bar_holds_flat_punch() {
    let mut mesh = half_space(Some(0.3));
    let square = |p: DVec3| p.x.abs().max(p.y.abs());
    let middle = |mesh: &TetMesh, t: usize| mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
    let above = |p: DVec3| p.z > 0.0;
    let kept: Vec<[u32; 4]> = (0..mesh.tets.len())
        .filter(|t| {
            let p = middle(&mesh, *t);
            !above(p) || square(p) < 1.0
        })
        .map(|t| mesh.tets[t])
        .collect();
    // Squares become circles in the middle.
    for p in &mut mesh.nodes {
        let size = square(*p);
        if size > 0.0 {
            let round = ((PLANES[6] - size) / (PLANES[6] - 1.0)).min(1.0);
            let scale = 1.0 + round * (size / p.truncate().length() - 1.0);
            *p = DVec3::new(scale * p.x, scale * p.y, p.z);
        }
    }
    let mut mesh = TetMesh::new(mesh.nodes, kept, Vec::new(), Vec::new()).unwrap();
    let labels = (0..mesh.tets.len()).map(|t| f64::from(u8::from(above(middle(&mesh, t)))));
    let labels = Field::scalar("label", Location::Cell, labels.collect());
    mesh.set_field(labels).unwrap();
    mesh.region_names.insert(1, "punch".into());
    let force = 1e-3 * YOUNG;
    let shear = 0.5 * YOUNG / (1.0 + POISSON);
    let stiffness = 4.0 * shear * (3.0 - 4.0 * POISSON).ln() / (1.0 - 2.0 * POISSON);
    let exact = force * (1.0 / stiffness - of_depth());
    let loads = format!(
        "[material.punch]\nrigid = true\n[[force]]\non = {{ z_above = 0.29 }}\ntotal = [0, 0, {}]\n[[pin]]\nz_below = -11.9",
        -force
    );
    displacement(mesh, &loads, exact).check("flat punch");
}

/// Dimitriadis et al. 2002, equation 13: a sphere of radius R pressed by δ into a layer of thickness h
/// that is bonded to its support; Hertz for h → ∞.
fn dimitriadis(radius: f64, depth: f64, thickness: f64) -> f64 {
    let v = POISSON;
    let alpha = -(1.2876 - 1.4678 * v + 1.3442 * v * v) / (1.0 - v);
    let beta = (0.6387 - 1.0277 * v + 1.5164 * v * v) / (1.0 - v);
    let x = (radius * depth).sqrt() / thickness;
    let series = 1.0 - 2.0 * alpha / PI * x + 4.0 * (alpha * x / PI).powi(2)
        - 8.0 / PI.powi(3) * (alpha.powi(3) + 4.0 * PI * PI / 15.0 * beta) * x.powi(3)
        + 16.0 * alpha / PI.powi(4) * (alpha.powi(3) + 3.0 * PI * PI / 5.0 * beta) * x.powi(4);
    4.0 / 3.0 * YOUNG / (1.0 - v * v) * (radius * depth.powi(3)).sqrt() * series
}

#[test]
fn bar_holds_hertz_on_layer() {
    let (radius, depth, thickness) = (3.0, 0.25, 12.0);
    let file = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("layer.vtu");
    palpate::io::write(&file, &half_space(None)).unwrap();
    let text = format!(
        "[mesh]\nfile = {file:?}\n[material]\nyoung = {YOUNG}\npoisson = {POISSON}\norder = 1\n"
    );
    let wanted = PressOptions {
        at: Some(DVec3::ZERO),
        radius: Some(radius),
        depth: Some(depth),
        ..PressOptions::default()
    };
    let scene = Scene::parse(&text).unwrap();
    let mut press = Press::new(&gpu(), &scene, &wanted).unwrap();
    while press.advance().unwrap().is_some() {}
    press.estimate_error(&no_progress).unwrap();
    let report = press.report(0.0);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let found = Compared {
        value: report.max_force_n,
        error: report.max_force_error_n.unwrap(),
        exact: dimitriadis(radius, depth, thickness),
    };
    found.check("Hertz on a layer");
}

/// Lamé: a thick ring in plane stress under the pressure p inside; its energy is the work ½ p u of
/// the inner wall.
#[test]
fn bar_holds_lame_ring() {
    let (mesh, thickness) = ring(2);
    let [a, b] = [1.0f64, 2.0];
    let p = 1e-4 * YOUNG;
    let front = p * a / (YOUNG * (b * b - a * a));
    let moved = front * ((1.0 - POISSON) * a * a + (1.0 + POISSON) * b * b);
    let exact = 0.5 * p * moved * 2.0 * PI * a * thickness;
    let inner = a.hypot(thickness) + 1e-6;
    let loads = format!(
        "[[pressure]]\non = {{ sphere = [0, 0, 0, {inner}] }}\npressure = {p}\n[[pin]]\nbox = [[1.99, -0.01, -0.01], [2.01, 0.01, 0.01]]"
    );
    energy(mesh, &loads, exact).check("Lamé");
}

/// A spherical cavity of radius a in a ball of radius b under the pressure p inside.
#[test]
fn bar_holds_spherical_cavity() {
    let [a, b] = [1.0f64, 2.5];
    let half = 4;
    let mut mesh = box_mesh([2 * half; 3], DVec3::ONE, Split::Six).unwrap();
    for p in &mut mesh.nodes {
        *p = (2.0 * *p - 1.0).map(|x| (x * half as f64).round() / half as f64);
    }
    let size = |p: DVec3| p.abs().max_element();
    let middle = |t: &[u32; 4]| t.iter().map(|v| mesh.nodes[*v as usize]).sum::<DVec3>() / 4.0;
    let kept: Vec<[u32; 4]> = mesh
        .tets
        .iter()
        .filter(|t| size(middle(t)) > 0.5)
        .copied()
        .collect();
    // Cubes become spheres.
    let nodes = mesh.nodes.iter().map(|p| {
        let radius = a + (b - a) * (size(*p) - 0.5) / 0.5;
        p.normalize_or_zero() * radius
    });
    let shell = TetMesh::new(nodes.collect(), kept, Vec::new(), Vec::new()).unwrap();
    let p = 1e-4 * YOUNG;
    let front = p * a.powi(3) / (YOUNG * (b.powi(3) - a.powi(3)));
    let moved = front * ((1.0 - 2.0 * POISSON) * a + (1.0 + POISSON) * b.powi(3) / (2.0 * a * a));
    let exact = 0.5 * p * moved * 4.0 * PI * a * a;
    let loads = format!(
        "[[pressure]]\non = {{ sphere = [0, 0, 0, 1.001] }}\npressure = {p}\n[[pin]]\nbox = [[2.49, -0.01, -0.01], [2.51, 0.01, 0.01]]"
    );
    energy(shell, &loads, exact).check("cavity");
}

/// A clamped beam with a force at its end: F L³/(3 E I) + F L/(κ G A), κ = 5/6 (Timoshenko).
#[test]
fn bar_holds_cantilever() {
    let (length, side) = (1.0, 0.2f64);
    let mesh = box_mesh([10, 2, 2], DVec3::new(length, side, side), Split::Six).unwrap();
    let force = 2e-6 * YOUNG;
    let shear = 0.5 * YOUNG / (1.0 + POISSON);
    let bending = force * length.powi(3) / (3.0 * YOUNG * side.powi(4) / 12.0);
    let exact = bending + force * length / (5.0 / 6.0 * shear * side * side);
    let loads = format!(
        "[[force]]\non = {{ axis = \"x\", above = 0.99 }}\ntotal = [0, 0, {}]\n[[pin]]\naxis = \"x\"\nbelow = 0.01",
        -force
    );
    displacement(mesh, &loads, exact).check("cantilever");
}
