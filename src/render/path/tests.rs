#![allow(clippy::unwrap_used)]

use super::environment::Environment;
use super::lobes::SpecularAlbedo;
use super::picture::PathPicture;
use super::reference::{ReferenceBody, ReferencePaths};
use super::reference_scan::ReferenceScan;
use super::reference_sections::{ReferenceSection, Shape};
use super::*;
use crate::generate;
use crate::mesh::{LocalFrame, TetMesh, Topology};
use crate::progress::no_progress;
use crate::random::Random;
use crate::render::scan::{Scan, ScanAppearance};
use crate::render::{
    Geometry, Image, Light, MeshAccess, Plane, PlaneKind, RaycastOptions, Sections,
    TransferFunction, Traversal,
};
use crate::volume::Volume;
use glam::{DAffine3, DVec3};
use std::sync::Arc;

/// A body and what its scalars look like.
pub(super) struct Body {
    pub mesh: TetMesh,
    topology: Topology,
    /// Current positions, in file units.
    pub nodes: Vec<DVec3>,
    scalars: Vec<f64>,
    transfer: TransferFunction,
    pub inside: Sections,
    pub lit: bool,
    pub walls: Vec<Wall>,
    /// Shares of the range, in place of the scalars; its world is the mesh's.
    pub scan: Option<Arc<Volume>>,
    /// How the raycaster finds tets and reads them.
    walk: Traversal,
    reads: MeshAccess,
}

impl Body {
    pub fn new(
        shape: &str,
        tets: usize,
        scalar: impl Fn(DVec3) -> f64,
        transfer: TransferFunction,
    ) -> Body {
        let mesh = generate::by_name(shape, Some(tets)).unwrap();
        let (low, high) = mesh.bounds();
        let share = |p: &DVec3| scalar((*p - low) / (high - low));
        Body {
            topology: Topology::new(&mesh),
            nodes: mesh.nodes.clone(),
            scalars: mesh.nodes.iter().map(share).collect(),
            mesh,
            transfer,
            inside: Sections::default(),
            lit: true,
            walls: Vec::new(),
            scan: None,
            walk: Traversal::default(),
            reads: MeshAccess::default(),
        }
    }

    /// Bends the body along its longest axis.
    pub fn bent(mut self) -> Body {
        let (low, high) = self.mesh.bounds();
        for p in &mut self.nodes {
            let share = (*p - low) / (high - low);
            let turn = 0.8 * (share.x - 0.5);
            let (s, c) = turn.sin_cos();
            let middle = 0.5 * (low + high);
            let q = *p - middle;
            *p = middle
                + DVec3::new(
                    c * q.x - s * q.y,
                    s * q.x + c * q.y + 0.3 * q.x * q.x / (high.x - low.x),
                    q.z,
                );
        }
        self
    }

    pub fn caster(&self, gpu: &Gpu) -> Raycaster {
        let frame = LocalFrame::from_mesh(&self.mesh);
        let positions = crate::render::local_positions(gpu, &frame, &self.nodes).unwrap();
        let mut geometry = Geometry::new(
            gpu,
            &self.mesh,
            &self.topology,
            frame,
            &positions,
            &self.scalars,
        )
        .unwrap();
        geometry
            .set_scalars(
                &self.mesh,
                crate::render::Scalars::Nodes(&self.scalars),
                (0.0, 1.0),
            )
            .unwrap();
        if self.inside.needs_rest_positions() || self.scan.is_some() {
            geometry.store_rest_positions(&self.mesh).unwrap();
        }
        if self.lit {
            geometry
                .enable_lighting(&self.mesh, &self.topology, &self.scalars)
                .unwrap();
        }
        let options = RaycastOptions {
            light: if self.lit { Light::Head } else { Light::None },
            walk: self.walk,
            reads: self.reads,
            ..RaycastOptions::default()
        };
        let mut caster = Raycaster::with_options(gpu, geometry, &self.transfer, options).unwrap();
        caster.set_sections(&self.inside).unwrap();
        if let Some(volume) = &self.scan {
            let scan = Scan {
                volume: volume.clone(),
                units_per_mm: 1.0,
                appearance: ScanAppearance::Values {
                    transfer: self.transfer.clone(),
                    range: Some((0.0, 1.0)),
                },
            };
            caster.set_scans(&self.mesh, &[scan]).unwrap();
        }
        caster
    }

    /// Normal and offset of a plane in the local frame.
    fn local_plane(&self, plane: &Plane) -> (DVec3, f64) {
        let frame = LocalFrame::from_mesh(&self.mesh);
        let n = plane.normal.normalize();
        (n, n.dot((plane.point - frame.origin) / frame.scale))
    }

    /// The slices and isosurfaces for the paths in float64.
    fn reference_sections(&self) -> Vec<ReferenceSection> {
        let mut found = Vec::new();
        for plane in &self.inside.planes {
            if let PlaneKind::Slice(opacity) = plane.kind {
                let (normal, offset) = self.local_plane(plane);
                found.push(ReferenceSection {
                    shape: Shape::Plane(normal, offset, plane.at_rest),
                    colour: None,
                    opacity,
                });
            }
        }
        found.extend(self.inside.isosurfaces.iter().map(|iso| ReferenceSection {
            shape: Shape::Value(iso.value),
            colour: iso.colour,
            opacity: iso.opacity,
        }));
        found
    }

    /// The same picture in float64: light and opacity, premultiplied; and the standard error of the
    /// mean of each channel.
    pub fn reference(
        &self,
        camera: &Camera,
        size: [u32; 2],
        options: &PathOptions,
        samples: u32,
    ) -> (Image, [f64; 4]) {
        let (image, errors, _) = self.traced(camera, size, options, samples);
        (image, errors)
    }

    /// As [`Body::reference`], and the number of the paths' events.
    pub fn traced(
        &self,
        camera: &Camera,
        size: [u32; 2],
        options: &PathOptions,
        samples: u32,
    ) -> (Image, [f64; 4], u64) {
        let frame = LocalFrame::from_mesh(&self.mesh);
        let to_local = |p: &DVec3| (*p - frame.origin) / frame.scale;
        let local: Vec<DVec3> = self.nodes.iter().map(to_local).collect();
        let rests: Vec<DVec3> = self.mesh.nodes.iter().map(to_local).collect();
        let sections = self.reference_sections();
        let scan = self.scan.as_ref().map(|volume| {
            let to_file = DAffine3::from_translation(frame.origin)
                * DAffine3::from_scale(DVec3::splat(frame.scale));
            ReferenceScan {
                volume: volume.clone(),
                voxel_from_rest: volume.to_world.inverse() * to_file,
            }
        });
        let gradients = match self.lit {
            true => Geometry::reference_node_gradients(
                &self.mesh,
                &self.topology,
                &local,
                &self.scalars,
                None,
            ),
            false => vec![DVec3::ZERO; local.len()],
        };
        let transfer = self.transfer.to_absolute((0.0, 1.0), frame.scale);
        let clips: Vec<(DVec3, f64)> = self
            .inside
            .clips()
            .map(|plane| self.local_plane(plane))
            .collect();
        let rows = crate::parallel::map_coarse(size[1] as usize, |y| {
            let mut paths = ReferencePaths {
                body: ReferenceBody {
                    nodes: &local,
                    tets: &self.mesh.tets,
                    scalars: &self.scalars,
                    gradients: &gradients,
                    transfer: &transfer,
                    scale: frame.scale,
                    clips: &clips,
                    walls: &self.walls,
                    sections: &sections,
                    rests: &rests,
                    draws_volume: self.inside.draw_volume,
                    scan: scan.as_ref(),
                },
                sky: options.environment.map(camera).unwrap(),
                roughness: options.roughness,
                anisotropy: options.anisotropy,
                albedo: SpecularAlbedo::new(options.roughness),
                random: Random::new(1000 + y as u64),
                events: 0,
            };
            let (mut row, mut variances) = (Vec::new(), [0.0f64; 4]);
            for x in 0..size[0] {
                let (mut sum, mut squares) = ([0.0f64; 4], [0.0f64; 4]);
                for _ in 0..samples {
                    let at = glam::DVec2::new(
                        f64::from(x) + paths.random.next(),
                        y as f64 + paths.random.next(),
                    );
                    let ray = camera.ray(at, size);
                    let (light, opacity) =
                        paths.trace((ray.origin - frame.origin) / frame.scale, ray.direction);
                    let [r, g, b] = light;
                    for (k, v) in [r, g, b, opacity].into_iter().enumerate() {
                        sum[k] += v;
                        squares[k] += v * v;
                    }
                }
                let n = f64::from(samples);
                for k in 0..4 {
                    variances[k] += (squares[k] / n - (sum[k] / n).powi(2)) / n;
                }
                row.extend(sum.map(|s| (s / n) as f32));
            }
            (row, variances, paths.events)
        });
        let pixels = f64::from(size[0] * size[1]);
        let whole = |k: usize| rows.iter().map(|(_, v, _)| v[k]).sum::<f64>();
        let errors = std::array::from_fn(|k| whole(k).sqrt() / pixels);
        let events = rows.iter().map(|(_, _, events)| events).sum();
        let values = rows.into_iter().flat_map(|(row, _, _)| row).collect();
        let image = Image {
            size,
            channels: 4,
            values,
        };
        (image, errors, events)
    }
}

/// White, and as dense everywhere.
pub(super) fn white(extinction: f64) -> TransferFunction {
    grey(1.0, extinction)
}

/// Grey of this brightness in sRGB, and as dense everywhere.
pub(super) fn grey(brightness: f64, extinction: f64) -> TransferFunction {
    TransferFunction::relative(
        vec![[0.0, brightness, brightness, brightness]],
        vec![[0.0, extinction]],
    )
    .unwrap()
}

pub(super) fn soft() -> TransferFunction {
    TransferFunction::relative(
        vec![
            [0.0, 0.9, 0.4, 0.3],
            [0.6, 0.9, 0.85, 0.5],
            [1.0, 0.3, 0.5, 0.9],
        ],
        vec![[0.0, 2.0], [0.5, 6.0], [1.0, 14.0]],
    )
    .unwrap()
}

pub(super) fn picture(
    caster: &mut Raycaster,
    camera: &Camera,
    size: [u32; 2],
    options: &PathOptions,
) -> PathPicture {
    caster
        .start_paths(camera, size, (options, &[]))
        .unwrap()
        .finish(&no_progress)
        .unwrap()
}

/// Root mean square difference.
fn difference(a: &Image, b: &Image) -> f64 {
    let n = a.values.len() as f64;
    let sum: f64 = a
        .values
        .iter()
        .zip(&b.values)
        .map(|(x, y)| f64::from(x - y).powi(2))
        .sum();
    (sum / n).sqrt()
}

/// Mean of each channel.
pub(super) fn mean(image: &Image) -> [f64; 4] {
    let n = image.values.len() as f64 / 4.0;
    let mut sum = [0.0; 4];
    for p in image.values.chunks_exact(4) {
        for (s, v) in sum.iter_mut().zip(p) {
            *s += f64::from(*v) / n;
        }
    }
    sum
}

#[test]
fn white_body_vanishes_in_white_surroundings() {
    let gpu = Gpu::new().unwrap();
    for (extinction, lit, roughness, anisotropy) in [
        (8.0, true, 0.1, 0.0),
        (8.0, true, 0.5, 0.5),
        (8.0, true, 1.0, 0.0),
        (4.0, false, 0.4, -0.4),
    ] {
        let body = Body {
            lit,
            ..Body::new("ball", 300, |s| s.x, white(extinction))
        };
        let options = PathOptions {
            samples: 256,
            environment: Environment::White,
            roughness,
            anisotropy,
            ..PathOptions::default()
        };
        let camera = Camera::fit_mesh_in(&body.mesh, [24, 24]);
        let found = picture(&mut body.caster(&gpu), &camera, [24, 24], &options);
        assert_eq!(found.lost(), 0);
        let [r, _, _, opacity] = mean(found.linear());
        // Light of 1 wherever there is a body.
        let error = found.noise() / (24.0 * 24.0 * opacity).sqrt();
        assert!(error < 0.003, "{error}");
        assert!(
            (r / opacity - 1.0).abs() < 4.5 * error,
            "roughness {roughness}: {} ± {error}",
            r / opacity
        );
        assert!(opacity > 0.3);
    }
}

#[test]
fn opacity_of_slab_is_that_of_beer() {
    let gpu = Gpu::new().unwrap();
    let body = Body {
        lit: false,
        ..Body::new("box", 100, |_| 0.5, white(1.3))
    };
    let (low, high) = body.mesh.bounds();
    let middle = 0.5 * (low + high);
    let height = 0.2 * (high.y - low.y);
    let camera = Camera::orthographic(
        middle + DVec3::Z * 5.0 * (high.z - low.z),
        middle,
        DVec3::Y,
        height,
    );
    let options = PathOptions {
        samples: 64,
        ..PathOptions::default()
    };
    let found = picture(&mut body.caster(&gpu), &camera, [64, 64], &options);
    let frame = LocalFrame::from_mesh(&body.mesh);
    let depth = 1.3 * (high.z - low.z) / frame.scale;
    let expected = 1.0 - (-depth).exp();
    let opacity = mean(found.linear())[3];
    let sigma = (expected * (1.0 - expected) / (64.0 * 4096.0)).sqrt();
    assert!(
        (opacity - expected).abs() < 5.0 * sigma,
        "{opacity} for {expected}"
    );
}

/// Size of the compared pictures.
pub(super) const SIZE: [u32; 2] = [20, 20];
/// Samples per pixel in float64.
const REFERENCE_SAMPLES: u32 = 256;

/// Compares with float64 paths, for each number of samples: means of the picture. Returns the
/// differences of the pixels.
pub(super) fn compare<const N: usize>(
    body: &Body,
    camera: &Camera,
    options: &PathOptions,
    samples: [u32; N],
) -> [f64; N] {
    let gpu = Gpu::new().unwrap();
    let mut caster = body.caster(&gpu);
    let (truth, errors) = body.reference(camera, SIZE, options, REFERENCE_SAMPLES);
    samples.map(|samples| {
        let options = PathOptions {
            samples,
            ..options.clone()
        };
        let found = caster
            .start_paths(camera, SIZE, (&options, &body.walls))
            .unwrap()
            .finish(&no_progress)
            .unwrap();
        assert_eq!(found.lost(), 0);
        let (a, b) = (mean(found.linear()), mean(&truth));
        // The shader's paths, which test directions to the light, have less noise than these.
        let more = 1.0 + f64::from(REFERENCE_SAMPLES) / f64::from(samples);
        for k in 0..4 {
            let limit = 4.5 * errors[k] * more.sqrt();
            assert!(errors[k] < 0.03 * b[0], "{errors:?} of {b:?}");
            assert!(
                (a[k] - b[k]).abs() < limit,
                "{samples} samples, channel {k}: {a:?} for {b:?} ± {errors:?}"
            );
        }
        difference(found.linear(), &truth)
    })
}

#[test]
fn paths_match_float64_paths_at_rest_bent_cut_and_from_inside() {
    let options = PathOptions {
        environment: Environment::Studio,
        anisotropy: 0.4,
        ..PathOptions::default()
    };
    let rest = Body::new("ball", 40, |s| s.x, soft());
    let camera = Camera::fit_mesh_in(&rest.mesh, SIZE);
    let [few, many] = compare(&rest, &camera, &options, [16, 256]);
    // The noise of the pixels falls as 1/√n, to that of the reference.
    assert!(many < 0.75 * few, "{few} then {many}");
    // Even light has less noise.
    let even = PathOptions {
        environment: Environment::White,
        ..options.clone()
    };
    let bent = Body::new("bar", 60, |s| s.y, soft()).bent();
    let camera = Camera::fit_mesh_in(&bent.mesh, SIZE);
    compare(&bent, &camera, &even, [64]);
    let (low, high) = rest.mesh.bounds();
    let middle = 0.5 * (low + high);
    let cut = Body {
        inside: Sections {
            planes: vec![Plane {
                point: middle,
                normal: DVec3::new(0.3, 0.2, 1.0),
                at_rest: false,
                kind: PlaneKind::Clip,
            }],
            ..Sections::default()
        },
        ..Body::new("ball", 40, |s| s.x, soft())
    };
    let from_front = Camera::perspective(
        middle + DVec3::new(0.4, 0.3, 3.0) * (high.z - low.z),
        middle,
        DVec3::Y,
        30.0,
    );
    compare(&cut, &from_front, &even, [64]);
    let inside = Camera::perspective(middle + 0.1 * (high - low), low, DVec3::Y, 60.0);
    compare(&rest, &inside, &even, [64]);
    // A wrong medium must show.
    let wrong = Body {
        transfer: white(6.0),
        ..Body::new("ball", 40, |s| s.x, soft())
    };
    let camera = Camera::fit_mesh_in(&rest.mesh, SIZE);
    let gpu = Gpu::new().unwrap();
    let few = PathOptions {
        samples: 64,
        ..options
    };
    let found = picture(&mut wrong.caster(&gpu), &camera, SIZE, &few);
    let (truth, errors) = rest.reference(&camera, SIZE, &few, 64);
    let (a, b) = (mean(found.linear()), mean(&truth));
    assert!((a[2] - b[2]).abs() > 10.0 * errors[2], "{a:?} for {b:?}");
}

/// Triangles of a square in the local frame of a body, around `middle` with the sides `a` and `b`,
/// in shares of the body's extent; its corners have different colours.
pub(super) fn square(body: &Body, middle: DVec3, [a, b]: [DVec3; 2], opacity: f32) -> [Wall; 2] {
    let (low, high) = body.mesh.bounds();
    let frame = LocalFrame::from_mesh(&body.mesh);
    let at = |u: f64, v: f64| frame.to_local(low + (high - low) * (middle + u * a + v * b));
    let corners = [at(-0.5, -0.5), at(0.5, -0.5), at(0.5, 0.5), at(-0.5, 0.5)];
    let flat = (corners[1] - corners[0])
        .cross(corners[2] - corners[0])
        .normalize();
    let colours = [
        glam::Vec3::new(0.9, 0.2, 0.2),
        glam::Vec3::new(0.3, 0.8, 0.2),
        glam::Vec3::new(0.2, 0.3, 0.9),
        glam::Vec3::new(0.9, 0.9, 0.7),
    ];
    [[0, 1, 2], [0, 2, 3]].map(|ids| Wall {
        corners: ids.map(|k| corners[k]),
        // A skin's normals are those of its nodes, not of its triangles.
        normals: ids.map(|k| (flat + 0.3 * (corners[k] - corners[0])).normalize()),
        colours: ids.map(|k| colours[k]),
        opacity,
    })
}

/// A body with an opaque square through it, such as a tool, and a translucent one before it, such as
/// a skin.
pub(super) fn walled() -> Body {
    let mut body = Body::new("ball", 40, |s| s.x, soft());
    let tool = square(
        &body,
        DVec3::new(0.2, 0.5, 0.6),
        [DVec3::new(0.7, 0.1, 0.5), DVec3::new(0.0, 0.8, 0.1)],
        1.0,
    );
    let skin = square(
        &body,
        DVec3::new(0.7, 0.6, 1.2),
        [DVec3::new(0.9, 0.0, -0.2), DVec3::new(0.1, 0.9, 0.0)],
        0.4,
    );
    body.walls.extend(tool.into_iter().chain(skin));
    body
}

#[test]
fn paths_with_skins_and_tools_match_float64_paths() {
    let options = PathOptions {
        environment: Environment::White,
        ..PathOptions::default()
    };
    let body = walled();
    let camera = Camera::fit_mesh_in(&body.mesh, SIZE);
    compare(&body, &camera, &options, [64]);
    let (low, high) = body.mesh.bounds();
    let cut = Body {
        inside: Sections {
            planes: vec![Plane {
                point: low + 0.6 * (high - low),
                normal: DVec3::new(0.1, 1.0, 0.3),
                at_rest: false,
                kind: PlaneKind::Clip,
            }],
            ..Sections::default()
        },
        ..walled()
    };
    compare(&cut, &camera, &options, [64]);
    // Without its skin the picture differs.
    let gpu = Gpu::new().unwrap();
    let few = PathOptions {
        samples: 64,
        ..options
    };
    let (truth, errors) = body.reference(&camera, SIZE, &few, 64);
    let mut caster = body.caster(&gpu);
    let found = caster
        .start_paths(&camera, SIZE, (&few, &body.walls[..2]))
        .unwrap()
        .finish(&no_progress)
        .unwrap();
    let (a, b) = (mean(found.linear()), mean(&truth));
    assert!((a[3] - b[3]).abs() > 10.0 * errors[3], "{a:?} for {b:?}");
}

#[test]
fn both_walks_and_accesses_give_the_paths_of_float64() {
    let gpu = Gpu::new().unwrap();
    let options = PathOptions {
        samples: 32,
        environment: Environment::White,
        ..PathOptions::default()
    };
    let bodies = [Traversal::Vertices, Traversal::Planes]
        .iter()
        .flat_map(|walk| [MeshAccess::Stored, MeshAccess::Sampled].map(|reads| (*walk, reads)))
        .map(|(walk, reads)| Body {
            walk,
            reads,
            ..Body::new("bar", 60, |s| s.y, soft()).bent()
        });
    let mut first = None;
    for body in bodies {
        let camera = Camera::fit_mesh_in(&body.mesh, SIZE);
        let found = picture(&mut body.caster(&gpu), &camera, SIZE, &options);
        let first = first.get_or_insert_with(|| {
            compare(&body, &camera, &options, [32]);
            found.linear().clone()
        });
        assert_eq!(first, found.linear(), "{:?} {:?}", body.walk, body.reads);
    }
}

#[test]
fn same_seed_gives_the_same_picture_and_noise_ends_early() {
    let gpu = Gpu::new().unwrap();
    let body = Body::new("ball", 40, |s| s.x, soft());
    let camera = Camera::fit_mesh_in(&body.mesh, [24, 18]);
    let mut caster = body.caster(&gpu);
    let options = PathOptions {
        samples: 4,
        ..PathOptions::default()
    };
    let [a, b] = [0; 2].map(|_| {
        picture(&mut caster, &camera, [24, 18], &options)
            .linear()
            .clone()
    });
    assert_eq!(a, b);
    // However the samples are divided among dispatches.
    let mut slow = caster
        .start_paths(&camera, [24, 18], (&options, &[]))
        .unwrap();
    for tile in &mut slow.tiles {
        tile.params.max_work = 1;
    }
    slow.draw_until(3).unwrap();
    let parts = slow.finish(&no_progress).unwrap();
    assert_eq!(&a, parts.linear());
    assert!(slow.counts().unwrap().unfinished > 0);
    let other = picture(
        &mut caster,
        &camera,
        [24, 18],
        &PathOptions {
            seed: 1,
            ..options.clone()
        },
    );
    assert_ne!(&a, other.linear());
    let noisy = PathOptions {
        samples: 4096,
        noise: Some(0.15),
        ..PathOptions::default()
    };
    let found = picture(&mut caster, &camera, [24, 18], &noisy);
    assert!(
        found.samples() < 4096 && found.noise() <= 0.15,
        "{} {}",
        found.samples(),
        found.noise()
    );
}

#[test]
fn filter_takes_noise_away() {
    let gpu = Gpu::new().unwrap();
    let body = Body::new("ball", 300, |s| s.x, soft());
    let size = [32, 32];
    let camera = Camera::fit_mesh_in(&body.mesh, size);
    let mut caster = body.caster(&gpu);
    let many = PathOptions {
        samples: 128,
        ..PathOptions::default()
    };
    let truth = picture(&mut caster, &camera, size, &many);
    let few = PathOptions {
        samples: 4,
        seed: 7,
        ..PathOptions::default()
    };
    let noisy = picture(&mut caster, &camera, size, &few);
    let mut filtered = caster.start_paths(&camera, size, (&few, &[])).unwrap();
    filtered
        .filter_by(caster.picture(&camera, size).unwrap())
        .unwrap();
    let clean = filtered.finish(&no_progress).unwrap();
    let [before, after] = [&noisy, &clean].map(|p| difference(p.linear(), truth.linear()));
    assert!(after < 0.5 * before, "{before} to {after}");
}

#[test]
fn values_out_of_range_are_refused() {
    let gpu = Gpu::new().unwrap();
    let body = Body::new("ball", 60, |s| s.x, soft());
    let camera = Camera::fit_mesh(&body.mesh);
    let mut caster = body.caster(&gpu);
    let mut error = |options: PathOptions| {
        caster
            .start_paths(&camera, [8, 8], (&options, &[]))
            .err()
            .unwrap()
            .to_string()
    };
    assert!(
        error(PathOptions {
            roughness: 0.0,
            ..PathOptions::default()
        })
        .contains("roughness")
    );
    assert!(
        error(PathOptions {
            samples: 0,
            ..PathOptions::default()
        })
        .contains("samples")
    );
    assert!(
        error(PathOptions {
            environment: Environment::File("no.hdr".into()),
            ..PathOptions::default()
        })
        .contains("no.hdr")
    );
}

#[test]
fn walls_hide_the_body_by_their_opacity() {
    let gpu = Gpu::new().unwrap();
    let body = Body::new("ball", 40, |s| s.x, soft());
    let (low, high) = body.mesh.bounds();
    let middle = 0.5 * (low + high);
    let camera = Camera::orthographic(
        middle + 5.0 * (high - low).z * DVec3::Z,
        middle,
        DVec3::Y,
        2.0 * (high.y - low.y),
    );
    let mut caster = body.caster(&gpu);
    let frame = LocalFrame::from_mesh(&body.mesh);
    // A square before the body, wider than the picture, which faces the camera.
    let corner =
        |x: f64, y: f64| frame.to_local(middle + (high - low) * DVec3::new(4.0 * x, 4.0 * y, 1.0));
    let wall = |corners: [glam::Vec3; 3], opacity: f32| Wall {
        corners,
        normals: [glam::Vec3::Z; 3],
        colours: [glam::Vec3::ONE; 3],
        opacity,
    };
    let options = PathOptions {
        samples: 64,
        environment: Environment::White,
        ..PathOptions::default()
    };
    // The ball takes a fifth of the picture.
    let bare = picture(&mut caster, &camera, SIZE, &options);
    let [.., behind] = mean(bare.linear());
    let mut seen = |opacity: f32| {
        let [a, b, c, d] = [
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
        ];
        let walls = [wall([a, b, c], opacity), wall([a, c, d], opacity)];
        let found = caster
            .start_paths(&camera, SIZE, (&options, &walls))
            .unwrap()
            .finish(&no_progress)
            .unwrap();
        mean(found.linear())
    };
    let [light, _, _, opacity] = seen(1.0);
    assert!((opacity - 1.0).abs() < 1e-9);
    assert!((light - 1.0).abs() < 0.01, "{light}");
    let [.., half] = seen(0.5);
    assert!(
        (half - (0.5 + 0.5 * behind)).abs() < 0.02,
        "{half} with {behind} behind"
    );
}
