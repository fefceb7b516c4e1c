//! Planes and isosurfaces in a volume, against their float64 reference.

use crate::render::common::*;
use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{LocalFrame, TetMesh, Topology};
use palpate::render::*;
use palpate::scene::{Scene, Stage};

const SIZE: [u32; 2] = [64, 64];

/// A positioned mesh with light.
pub struct Seen<'a> {
    mesh: &'a TetMesh,
    pub scalars: Vec<f64>,
    gradients: Vec<DVec3>,
    pub caster: Raycaster,
    rays: ReferenceRaycaster,
    light: Light,
    /// Appearances of regions, if any.
    looks: Option<RegionAppearance>,
}

impl<'a> Seen<'a> {
    pub fn new(
        gpu: &Gpu,
        mesh: &'a TetMesh,
        positions: &[DVec3],
        walk: Traversal,
        light: Light,
    ) -> Self {
        let scalars = waves(mesh);
        let frame = LocalFrame::from_mesh(mesh);
        let array = local_positions(gpu, &frame, positions).unwrap();
        let topology = Topology::new(mesh);
        let mut geometry = Geometry::new(gpu, mesh, &topology, frame, &array, &scalars).unwrap();
        geometry.enable_lighting(mesh, &topology, &scalars).unwrap();
        geometry.store_rest_positions(mesh).unwrap();
        let (low, high) = geometry.scalar_range();
        let shares: Vec<f64> = scalars.iter().map(|s| (s - low) / (high - low)).collect();
        let local = positions.iter().map(|p| (*p - frame.origin) / frame.scale);
        let local: Vec<DVec3> = local.collect();
        let gradients = Geometry::reference_node_gradients(mesh, &topology, &local, &shares, None);
        let options = RaycastOptions {
            walk,
            light,
            ..RaycastOptions::default()
        };
        let transfer = TransferFunction::preset("viridis").unwrap();
        Seen {
            mesh,
            gradients,
            caster: Raycaster::with_options(gpu, geometry, &transfer, options).unwrap(),
            rays: ReferenceRaycaster::new(mesh, positions, &scalars),
            scalars,
            light,
            looks: None,
        }
    }

    pub fn look(&mut self, looks: RegionAppearance) {
        self.caster.set_regions(Some(&looks)).unwrap();
        self.looks = Some(looks);
    }

    /// Interpolates values at the nodes of a tet with weights.
    fn mix(&self, of: &[DVec3], tet: u32, weights: [f64; 4]) -> DVec3 {
        let nodes = self.mesh.tets[tet as usize];
        let parts = nodes.iter().zip(weights);
        parts.map(|(v, w)| w * of[*v as usize]).sum()
    }

    pub fn truth(&self, camera: &Camera, inside: &Sections) -> Vec<[f64; 4]> {
        let own = self.caster.transfer();
        let geometry = self.caster.geometry();
        let (range, scale) = (geometry.scalar_range(), geometry.frame().scale);
        let looks = self.looks.clone().unwrap_or_default();
        let of_regions = looks.transfers.iter().map(|t| t.to_absolute(range, scale));
        let of_regions: Vec<AbsoluteTransferFunction> = of_regions.collect();
        let transfer = |tet: u32| match looks.tet_regions.get(tet as usize) {
            None => Some(&own),
            Some(look) => look.map(|row| &of_regions[row as usize]),
        };
        self.rays.render(camera, SIZE, |rays, ray| {
            let rest = |tet: u32, w: [f64; 4]| self.mix(&self.mesh.nodes, tet, w);
            let gradient = |tet: u32, p: DVec3| {
                self.mix(&self.gradients, tet, rays.barycentric_weights(tet, p))
            };
            let volume = |tet: u32, p: DVec3, way: DVec3| self.light.shade(gradient(tet, p), way);
            let surface =
                |tet: u32, p: DVec3, way: DVec3| self.light.shade_surface(gradient(tet, p), way);
            let light = Lighting {
                volume: &volume,
                surface: &surface,
            };
            rays.composite_sections(ray, &transfer, inside, &rest, Some(&light))
        })
    }

    /// Returns the fraction of pixels with an error above 4/255, and the root mean square of the
    /// others in 1/255. An edge of a surface may fall on either side of a pixel.
    pub fn compare(&mut self, camera: &Camera, inside: &Sections) -> (f64, f64, Image) {
        self.caster.set_sections(inside).unwrap();
        let image = self.caster.image(camera, SIZE, Mode::Composite).unwrap();
        let truth = self.truth(camera, inside);
        let (mut far, mut sum) = (0, 0.0);
        for (found, truth) in image.values.chunks(4).zip(&truth) {
            let errors = found.iter().zip(truth).map(|(a, b)| f64::from(*a) - b);
            let worst = errors.map(|e| 255.0 * e.abs()).fold(0.0, f64::max);
            match worst > 4.0 {
                true => far += 1,
                false => sum += worst * worst,
            }
        }
        let pixels = truth.len() as f64;
        (f64::from(far) / pixels, (sum / pixels).sqrt(), image)
    }
}

pub fn bent(mesh: &TetMesh) -> Vec<DVec3> {
    let (low, high) = mesh.bounds();
    let size = (high - low).max_element();
    let bend = |p: &DVec3| {
        let u = (*p - low) / size;
        *p + size * DVec3::new(0.3 * u.y * u.y, 0.1 * u.x * u.z, 0.2 * u.x * u.y)
    };
    mesh.nodes.iter().map(bend).collect()
}

/// Returns the tested sections: planes alone, surfaces alone, and all combined.
pub fn insides(mesh: &TetMesh, scalars: &[f64]) -> Vec<(&'static str, Sections)> {
    let (low, high) = mesh.bounds();
    let (middle, size) = (0.5 * (low + high), high - low);
    let off = |x: f64, y: f64, z: f64| middle + size * DVec3::new(x, y, z);
    let (least, most) = scalars
        .iter()
        .fold((f64::MAX, f64::MIN), |(a, b), s| (a.min(*s), b.max(*s)));
    let iso = |share: f64, colour: Option<[f64; 3]>, opacity: f64| Isosurface {
        value: least + share * (most - least),
        colour,
        opacity,
    };
    let clip = Plane::clip(off(0.1, 0.0, 0.03), DVec3::new(1.0, 0.2, 0.3));
    let resting = Plane::clip(off(0.0, 0.12, 0.0), DVec3::new(-0.1, 1.0, 0.2)).at_rest();
    let slice = Plane {
        kind: PlaneKind::Slice(0.7),
        ..Plane::slice(off(-0.06, 0.0, 0.01), DVec3::new(0.9, -0.3, 0.4))
    };
    let plain = Sections::default();
    let with = |planes: Vec<Plane>, isosurfaces: Vec<Isosurface>, volume: bool| Sections {
        planes,
        isosurfaces,
        draw_volume: volume,
    };
    let two = vec![iso(0.61, Some([0.9, 0.3, 0.2]), 0.5), iso(0.35, None, 0.8)];
    let around = Plane::clip_box(off(-0.3, -0.35, -0.3), off(0.25, 0.3, 0.35));
    vec![
        ("plain", plain),
        ("clip", with(vec![clip], Vec::new(), true)),
        ("box", with(around.to_vec(), Vec::new(), true)),
        ("clip at rest", with(vec![resting], Vec::new(), true)),
        ("slice alone", with(vec![slice], Vec::new(), false)),
        (
            "slice at rest",
            with(vec![slice.at_rest()], Vec::new(), true),
        ),
        ("isosurfaces", with(Vec::new(), two.clone(), true)),
        ("all", with(vec![clip, resting, slice], two, true)),
    ]
}

#[test]
fn planes_and_isosurfaces_match_float64() {
    let round = generate::Bore::Round;
    compare_with_float64(&[
        (
            "duct",
            generate::duct([6, 6, 6], DVec3::ONE, round).unwrap(),
        ),
        ("slivers", slivers()),
    ]);
}

#[test]
#[ignore = "long: scripts/test --full"]
fn organ_planes_and_isosurfaces_match_float64() {
    compare_with_float64(&[
        ("limb", generate::by_name("limb", Some(2_000)).unwrap()),
        (
            "bar",
            generate::bar_of_about(600, DVec3::new(0.12, 0.06, 0.06)).unwrap(),
        ),
        ("foot", generate::by_name("foot", Some(5_000)).unwrap()),
    ]);
}

fn compare_with_float64(bodies: &[(&str, TetMesh)]) {
    let gpu = gpu();
    let mut wrong = Vec::new();
    for (n, (name, mesh)) in bodies.iter().enumerate() {
        let outside = Camera::fit_mesh(mesh);
        let mut within = Camera::fit_mesh(mesh);
        within.eye = mesh.tet_nodes(mesh.tets.len() / 2).iter().sum::<DVec3>() / 4.0;
        let from = Light::From(DVec3::new(0.3, 1.0, -0.5));
        let rest = mesh.nodes.clone();
        for (k, (walk, light, camera, positions)) in [
            (Traversal::Vertices, Light::Head, outside, bent(mesh)),
            (Traversal::Planes, from, outside, bent(mesh)),
            (Traversal::Vertices, Light::None, within, rest.clone()),
            (Traversal::Planes, Light::Head, within, rest),
        ]
        .into_iter()
        .enumerate()
        {
            let mut seen = Seen::new(&gpu, mesh, &positions, walk, light);
            let all = insides(mesh, &seen.scalars.clone());
            let plain = seen.compare(&camera, &Sections::default()).2;
            for (m, (what, inside)) in all.iter().enumerate() {
                // Each with some, and the whole body with each.
                if what != &"all" && (m + n + k) % 3 != 0 {
                    continue;
                }
                let (far, rms, image) = seen.compare(&camera, inside);
                keep(&image, &format!("planes_{name}_{k}_{m}.png"));
                let apart = 255.0 * ImageDifference::between(&image, &plain).unwrap().rmse;
                println!("{name} {walk:?} {what}: {far:.4} far, rms {rms:.3}, moved {apart:.1}");
                // It differs from the picture without sections; an eye inside may see none of them.
                let differs = inside.is_empty() || k > 1 || apart > 1.0;
                if far > 0.01 || rms > 0.5 || !differs {
                    wrong.push(format!("{name} {walk:?} {what} {k}: {far} {rms} {apart}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn rejects_invalid_planes() {
    for wrong in ["", "1,2,3", "0,0,0,0,0,0", "0,0,0,1,0,nan", "a,0,0,1,0,0"] {
        let message = wrong.parse::<Plane>().unwrap_err().to_string();
        assert!(message.contains("plane"), "{message}");
    }
    for wrong in ["", "x", "1,nocolour", "1,red,2", "1,red,0.5,3"] {
        let message = wrong.parse::<Isosurface>().unwrap_err().to_string();
        assert!(message.contains("isosurface"), "{message}");
    }
    let iso: Isosurface = "0.25,tomato,0.5".parse().unwrap();
    assert_eq!((iso.value, iso.opacity), (0.25, 0.5));
    assert!(iso.colour.unwrap()[0] == 1.0);
    let gpu = gpu();
    let mesh = generate::paper_bar().unwrap();
    let geometry = Geometry::at_rest(&gpu, &mesh, &waves(&mesh)).unwrap();
    let transfer = TransferFunction::preset("viridis").unwrap();
    let mut caster = Raycaster::new(&gpu, geometry, &transfer).unwrap();
    let inside = Sections {
        planes: vec![Plane::clip(DVec3::ZERO, DVec3::X).at_rest()],
        ..Sections::default()
    };
    let message = caster.set_sections(&inside).unwrap_err().to_string();
    assert!(message.contains("store_rest_positions"), "{message}");
    assert!(caster.inside().is_empty());
}

#[test]
fn clipped_boundary_has_watertight_cut_faces() {
    let gpu = gpu();
    let scene = |more: &str| {
        let text = format!(
            "[mesh]\ngenerate = \"box\"\ntets = 600\n[picture]\nsize = [96, 72]\nmode = \"surface\"\n{more}"
        );
        let mut stage = Stage::new(&gpu, &Scene::parse(&text).unwrap()).unwrap();
        (stage.image().unwrap(), stage.mesh().bounds())
    };
    let (whole, (low, high)) = scene("");
    let middle = 0.5 * (low + high);
    for (at, rest) in [(0.4, false), (0.4, true), (0.6, false)] {
        let p = low + at * (high - low);
        // For any direction of the camera, one side of the plane faces it.
        let faces: Vec<Image> = [1.0, -1.0]
            .map(|way: f64| {
                scene(&format!(
                    "[[plane]]\nclip = [{}, {}, {}, {way}, 0, 0]\nrest = {rest}",
                    p.x, middle.y, middle.z
                ))
                .0
            })
            .into();
        let lit = |image: &Image| image.values.chunks(4).filter(|p| p[3] > 0.99).count();
        let parts: Vec<usize> = faces.iter().map(lit).collect();
        assert!(
            parts.iter().all(|n| *n < lit(&whole) && *n > 0),
            "{parts:?}"
        );
        // A pixel of the picture shows the boundary, a cut face, or nothing; none shows through.
        for image in &faces {
            let (width, height) = (96, 72);
            let alpha = |x: usize, y: usize| image.values[4 * (y * width + x) + 3];
            for y in 1..height - 1 {
                for x in 1..width - 1 {
                    let around = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)];
                    let covered = around.iter().all(|(x, y)| alpha(*x, *y) > 0.99);
                    assert!(!covered || alpha(x, y) > 0.99, "a hole at {x}, {y}");
                }
            }
        }
    }
}

#[test]
fn scene_planes_and_isosurfaces_parse_or_report_errors() {
    let gpu = gpu();
    let stage = |more: &str| {
        let scene = Scene::parse(&format!(
            "[mesh]\ngenerate = \"box\"\ntets = 200\n[picture]\nsize = [32, 24]\n{more}"
        ))?;
        Stage::new(&gpu, &scene)
    };
    let all = "[[plane]]\nclip = [0, 0, 0, 1, 0, 0]\n[[plane]]\nslice = [0, 0, 0, 0, 1, 0]\nopacity = 0.5\nrest = true\n[[plane]]\nbox = [-1, -1, -1, 1, 1, 1]\n[[isosurface]]\nvalue = 0.1\ncolour = \"gold\"\nopacity = 0.7";
    stage(all).unwrap();
    for (more, word) in [
        ("[[plane]]\nrest = true", "one of"),
        (
            "[[plane]]\nclip = [0, 0, 0, 1, 0, 0]\nopacity = 0.5",
            "slice",
        ),
        ("[[plane]]\nclip = [0, 0, 0, 0, 0, 0]", "normal"),
        (
            "[[isosurface]]\nvalue = 0.1\ncolour = \"no such\"",
            "isosurface",
        ),
        ("volume = false", "nothing to draw"),
    ] {
        let message = stage(more).err().unwrap().to_string();
        assert!(message.contains(word), "{more}: {message}");
    }
}
