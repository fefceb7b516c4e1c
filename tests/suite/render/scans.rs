//! Scans carried by a body, against a float64 reference.

use crate::render::common::*;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use palpate::generate;
use palpate::mesh::{LocalFrame, TetMesh, Topology};
use palpate::render::*;
use palpate::volume::{Raw, Volume};
use std::collections::BTreeMap;
use std::sync::Arc;

const SIZE: [u32; 2] = [96, 72];

/// Returns a head-like phantom, 16-bit, in oblique, anisotropic voxels: skin, a shell of bone with
/// edges as sharp as in scans, internal structures.
fn phantom() -> Volume {
    let size = [40usize, 36, 28];
    let spacing = DVec3::new(0.027, 0.03, 0.038);
    let turn = DMat3::from_quat(DQuat::from_axis_angle(
        DVec3::new(0.3, 1.0, -0.2).normalize(),
        0.35,
    ));
    let axes = turn * DMat3::from_diagonal(spacing);
    let middle = DVec3::from(size.map(|n| 0.5 * (n as f64 - 1.0)));
    let to_world = DAffine3::from_mat3_translation(axes, DVec3::splat(0.5) - axes * middle);
    let soft = |x: f64| (1.0 / (1.0 + (-x).exp())).clamp(0.0, 1.0);
    let value = |p: DVec3| {
        let q = (p - 0.5) / DVec3::new(0.46, 0.4, 0.44);
        let r = q.length();
        let bone = soft((r - 0.7) / 0.03) * soft((0.85 - r) / 0.03);
        let inner = (-40.0 * (q - DVec3::new(0.2, -0.1, 0.15)).length_squared()).exp();
        let stripes = 0.5 + 0.5 * (18.0 * q.x + 6.0 * q.z).sin();
        -1000.0 + soft((1.0 - r) / 0.03) * (1000.0 + 900.0 * bone + 300.0 * inner + 80.0 * stripes)
    };
    let [nx, ny, _] = size;
    let raw = (0..size.iter().product()).map(|n| {
        let index = [n % nx, n / nx % ny, n / nx / ny].map(|i| i as f64);
        value(to_world.transform_point3(index.into())).round() as i16
    });
    Volume {
        size,
        raw: Raw::I16(raw.collect()),
        to_world,
        ..Volume::default()
    }
}

/// Air is transparent, tissue has low opacity, bone is dense.
fn transfer() -> TransferFunction {
    TransferFunction::new(
        vec![
            [-200.0, 0.9, 0.5, 0.4],
            [250.0, 0.8, 0.2, 0.15],
            [600.0, 1.0, 0.95, 0.8],
        ],
        vec![
            [-300.0, 0.0],
            [0.0, 1.5],
            [300.0, 2.5],
            [500.0, 12.0],
            [900.0, 40.0],
        ],
    )
    .unwrap()
}

fn scan_of(volume: Volume) -> Scan {
    Scan {
        volume: Arc::new(volume),
        units_per_mm: 1.0,
        appearance: ScanAppearance::Values {
            transfer: transfer(),
            range: None,
        },
    }
}

fn camera() -> Camera {
    Camera::perspective(DVec3::new(1.9, 1.2, 2.4), DVec3::splat(0.5), DVec3::Y, 32.0)
}

/// Returns a raycaster of `scans`, carried by `mesh` with its nodes at `positions`.
fn caster(
    mesh: &TetMesh,
    positions: &[DVec3],
    scans: &[Scan],
    options: RaycastOptions,
) -> Raycaster {
    let gpu = gpu();
    let frame = LocalFrame::from_mesh(mesh);
    let array = local_positions(&gpu, &frame, positions).unwrap();
    let topology = Topology::new(mesh);
    let nothing = vec![0.0; mesh.nodes.len()];
    let mut geometry = Geometry::new(&gpu, mesh, &topology, frame, &array, &nothing).unwrap();
    geometry.store_rest_positions(mesh).unwrap();
    let mut caster = Raycaster::with_options(&gpu, geometry, &transfer(), options).unwrap();
    assert_eq!(caster.set_scans(mesh, scans).unwrap(), Vec::<String>::new());
    caster
}

fn plain(walk: Traversal) -> RaycastOptions {
    RaycastOptions {
        walk,
        opacity_cutoff: 1.0,
        light: Light::None,
        ..Default::default()
    }
}

/// Returns the exact picture of the scan carried by `mesh`.
fn exact(mesh: &TetMesh, positions: &[DVec3], scan: &Scan, camera: &Camera) -> Vec<[f64; 4]> {
    let truth = ReferenceRaycaster::from_scan(mesh, positions, scan, 24.0);
    let transfer = transfer().to_absolute(scan.range(), 1.0);
    truth.render(camera, SIZE, |r, ray| r.composite(ray, &transfer))
}

/// Returns the picture of the scan without a mesh: points of the ray are mapped to the rest state
/// by `rest`, if they lie in the unit cube there.
fn without_tets(scan: &Scan, camera: &Camera, rest: impl Fn(DVec3) -> DVec3) -> Vec<[f64; 4]> {
    let transfer = transfer().to_absolute(scan.range(), 1.0);
    let [width, height] = SIZE;
    let step = 1e-3;
    (0..width * height)
        .map(|n| {
            let pixel = glam::DVec2::new(f64::from(n % width) + 0.5, f64::from(n / width) + 0.5);
            let ray = camera.ray(pixel, SIZE);
            let way = ray.direction.normalize();
            let covered = |p: DVec3| {
                let x = rest(p);
                x.cmpge(DVec3::ZERO).all() && x.cmple(DVec3::ONE).all()
            };
            let mut sum = [0.0; 4];
            for k in 0..6000 {
                let [a, b] = [k, k + 1].map(|k| ray.origin + way * (step * f64::from(k)));
                let part = match (covered(a), covered(b)) {
                    (true, true) => step,
                    (false, false) => continue,
                    _ => 0.5 * step,
                };
                let [from, to] = [a, b].map(|p| {
                    let voxel = scan.rest_to_voxel().transform_point3(rest(p));
                    let last = DVec3::from(scan.volume.size.map(|n| n as f64 - 0.5));
                    let inside = voxel.cmpge(DVec3::splat(-0.5)).all() && voxel.cmple(last).all();
                    inside.then(|| scan.volume.sample(rest(p)))
                });
                let (Some(from), Some(to)) = (from, to) else {
                    continue;
                };
                let seen = transfer.segment_integral(from, to, part);
                let clear = 1.0 - sum[3];
                for k in 0..4 {
                    sum[k] += clear * seen[k];
                }
            }
            sum
        })
        .collect()
}

fn picture(caster: &mut Raycaster, camera: &Camera) -> Image {
    caster.image(camera, SIZE, Mode::Composite).unwrap()
}

#[test]
fn scan_at_rest_matches_direct_raycast() {
    let scan = scan_of(phantom());
    let camera = camera();
    let free = without_tets(&scan, &camera, |p| p);
    for cells in [1, 5] {
        let mesh = generate::box_mesh([cells; 3], DVec3::ONE, generate::Split::Six).unwrap();
        let truth = exact(&mesh, &mesh.nodes, &scan, &camera);
        for walk in [Traversal::Vertices, Traversal::Planes] {
            let mut caster = caster(&mesh, &mesh.nodes, std::slice::from_ref(&scan), plain(walk));
            let image = picture(&mut caster, &camera);
            keep(&image, &format!("scan-rest-{cells}-{walk:?}.png"));
            let (rms, worst) = difference(&image, &truth);
            let (of_free, _) = difference(&image, &free);
            println!(
                "{cells} cells, {walk:?}: rms {rms:.3}, 99.9 % {worst:.3}; without tets {of_free:.3}"
            );
            assert!(rms < 0.5 && of_free < 1.0, "{walk:?}: {rms} {of_free}");
        }
    }
    // The comparison detects another scan.
    let mut other = phantom();
    other.to_world.translation.x += 0.5 * other.spacing().x;
    let mesh = generate::box_mesh([1; 3], DVec3::ONE, generate::Split::Six).unwrap();
    let mut caster = caster(
        &mesh,
        &mesh.nodes,
        &[scan_of(other)],
        plain(Traversal::Vertices),
    );
    let (rms, _) = difference(&picture(&mut caster, &camera), &free);
    assert!(rms > 2.0, "half a voxel aside is {rms}");
}

#[test]
fn affine_motion_transforms_scan() {
    let scan = scan_of(phantom());
    let motion = DAffine3::from_mat3_translation(
        DMat3::from_cols_array(&[1.2, 0.1, -0.2, -0.3, 0.8, 0.15, 0.1, 0.25, 0.9]),
        DVec3::new(-0.1, 0.05, 0.12),
    );
    let camera = camera();
    let back = motion.inverse();
    let free = without_tets(&scan, &camera, |p| back.transform_point3(p));
    let mesh = generate::box_mesh([3; 3], DVec3::ONE, generate::Split::Five).unwrap();
    let moved: Vec<DVec3> = mesh
        .nodes
        .iter()
        .map(|p| motion.transform_point3(*p))
        .collect();
    for walk in [Traversal::Vertices, Traversal::Planes] {
        let mut caster = caster(&mesh, &moved, std::slice::from_ref(&scan), plain(walk));
        let image = picture(&mut caster, &camera);
        keep(&image, &format!("scan-affine-{walk:?}.png"));
        let (rms, _) = difference(&image, &free);
        println!("{walk:?}: {rms:.3}");
        assert!(rms < 1.0, "{walk:?}: {rms}");
    }
}

#[test]
fn bent_scan_matches_point_map() {
    let scan = scan_of(phantom());
    let camera = camera();
    let bend = |p: DVec3, sign: f64| {
        p + sign * DVec3::new(0.18 * (2.6 * p.y).sin(), 0.0, 0.15 * p.y * p.y)
    };
    let free = without_tets(&scan, &camera, |p| bend(p, -1.0));
    let mesh = generate::box_mesh([6, 24, 6], DVec3::ONE, generate::Split::Six).unwrap();
    let moved: Vec<DVec3> = mesh.nodes.iter().map(|p| bend(*p, 1.0)).collect();
    let truth = exact(&mesh, &moved, &scan, &camera);
    let mut bent = caster(
        &mesh,
        &moved,
        std::slice::from_ref(&scan),
        plain(Traversal::Vertices),
    );
    let image = picture(&mut bent, &camera);
    keep(&image, "scan-bend.png");
    let (rms, _) = difference(&image, &truth);
    let (of_free, _) = difference(&image, &free);
    println!("by tets {rms:.3}, by the bend itself {of_free:.3}");
    assert!(rms < 0.5 && of_free < 1.0, "{rms} {of_free}");
    // And it differs from the picture at rest.
    let mut still = caster(
        &mesh,
        &mesh.nodes,
        std::slice::from_ref(&scan),
        plain(Traversal::Vertices),
    );
    let (rest, _) = difference(&picture(&mut still, &camera), &free);
    assert!(rest > 10.0, "{rest}");
}

#[test]
#[ignore = "long: scripts/test --full"]
fn planes_isosurfaces_and_lighting_use_scan() {
    let scan = scan_of(phantom());
    let mesh = generate::box_mesh([4; 3], DVec3::ONE, generate::Split::Six).unwrap();
    let moved = bent(&mesh);
    let inside = Sections {
        planes: vec![
            Plane::clip(DVec3::splat(0.55), DVec3::new(0.4, 0.2, 1.0)).at_rest(),
            Plane::slice(DVec3::splat(0.5), DVec3::new(0.1, 1.0, 0.2)),
        ],
        isosurfaces: vec![Isosurface {
            value: 450.0,
            colour: None,
            opacity: 0.7,
        }],
        draw_volume: true,
    };
    let camera = camera();
    let truth = ReferenceRaycaster::from_scan(&mesh, &moved, &scan, 24.0);
    let resolved = transfer().to_absolute(scan.range(), 1.0);
    let rest = |t: u32, w: [f64; 4]| {
        let corners = mesh.tet_nodes(t as usize);
        (0..4).map(|k| w[k] * corners[k]).sum()
    };
    // Central differences of the scan over one voxel, transformed by F^(−T).
    let to_voxel = scan.rest_to_voxel();
    let back = to_voxel.inverse();
    let (low, high) = scan.range();
    let scale = LocalFrame::from_mesh(&mesh).scale;
    let gradient = |t: u32, place: DVec3| {
        let voxel = to_voxel.transform_point3(rest(t, truth.barycentric_weights(t, place)));
        let sample = |p: DVec3| scan.volume.sample(back.transform_point3(p));
        let at = |axis: DVec3| 0.5 * (sample(voxel + axis) - sample(voxel - axis)) / (high - low);
        let of_rest = to_voxel.matrix3.transpose() * DVec3::from(DVec3::AXES.map(at));
        let edges = |p: [DVec3; 4]| DMat3::from_cols(p[1] - p[0], p[2] - p[0], p[3] - p[0]);
        let now = mesh.tets[t as usize].map(|v| moved[v as usize]);
        let f = edges(now) * edges(mesh.tet_nodes(t as usize)).inverse();
        scale * (f.inverse().transpose() * of_rest)
    };
    let volume = |t: u32, p: DVec3, way: DVec3| Light::Head.shade(gradient(t, p), way);
    let surface = |t: u32, p: DVec3, way: DVec3| Light::Head.shade_surface(gradient(t, p), way);
    for walk in [Traversal::Vertices, Traversal::Planes] {
        for light in [Light::None, Light::Head] {
            let options = RaycastOptions {
                light,
                ..plain(walk)
            };
            let mut caster = caster(&mesh, &moved, std::slice::from_ref(&scan), options);
            caster.set_sections(&inside).unwrap();
            let image = picture(&mut caster, &camera);
            keep(&image, &format!("scan-inside-{walk:?}-{light:?}.png"));
            let all = truth.render(&camera, SIZE, |r, ray| {
                let lighting = Lighting {
                    volume: &volume,
                    surface: &surface,
                };
                let lighting = (light == Light::Head).then_some(&lighting);
                r.composite_sections(ray, &|_| Some(&resolved), &inside, &rest, lighting)
            });
            let (_, worst) = difference(&image, &all);
            // Rays that graze the isosurface between two samples may miss it.
            let pairs = image.values.chunks(4).zip(&all);
            let off = pairs.map(|(a, b)| (0..4).map(|k| (f64::from(a[k]) - b[k]).abs()));
            let grazing = off.filter(|off| off.clone().any(|e| e > 0.03)).count();
            println!("{walk:?} {light:?}: 99.9 % {worst:.2}, {grazing} pixels graze");
            assert!(
                worst < 2.5 && grazing < 12,
                "{walk:?} {light:?}: {worst} {grazing}"
            );
        }
    }
}

#[test]
fn projections_and_regions_use_scan() {
    let scan = scan_of(phantom());
    let mesh = generate::box_mesh([3; 3], DVec3::ONE, generate::Split::Six).unwrap();
    let moved = bent(&mesh);
    let camera = camera();
    let truth = ReferenceRaycaster::from_scan(&mesh, &moved, &scan, 24.0);
    let (low, high) = scan.range();
    let mut caster = caster(
        &mesh,
        &moved,
        std::slice::from_ref(&scan),
        plain(Traversal::Vertices),
    );
    for (mode, name) in [
        (Mode::Maximum, "mip"),
        (Mode::Minimum, "minip"),
        (Mode::Mean, "mean"),
    ] {
        let image = caster.image(&camera, SIZE, mode).unwrap();
        keep(&image, &format!("scan-{name}.png"));
        let all = truth.render(&camera, SIZE, |r, ray| {
            let parts = r.segments(ray);
            if parts.is_empty() {
                return [0.0; 4];
            }
            let values = parts.iter().flat_map(|p| p.s);
            let lengths: f64 = parts.iter().map(|p| p.t[1] - p.t[0]).sum();
            let grey = match mode {
                Mode::Maximum => values.fold(f64::MIN, f64::max),
                Mode::Minimum => values.fold(f64::MAX, f64::min),
                _ => {
                    let mean = |p: &Segment| (p.t[1] - p.t[0]) * 0.5 * (p.s[0] + p.s[1]);
                    parts.iter().map(mean).sum::<f64>() / lengths
                }
            };
            let grey = (grey - low) / (high - low);
            [grey, grey, grey, 1.0]
        });
        let (rms, _) = difference(&image, &all);
        println!("{name}: {rms:.3}");
        assert!(rms < 1.0, "{name}: {rms}");
    }
    // One half is hidden, the other has its own transfer function.
    let own = transfer().with_colour([0.2, 0.9, 0.4]);
    let upper = |t: usize| mesh.tet_nodes(t).iter().map(|p| p.y).sum::<f64>() > 2.0;
    let looks = RegionAppearance {
        transfers: vec![own.clone()],
        tet_regions: (0..mesh.tets.len())
            .map(|t| upper(t).then_some(0))
            .collect(),
    };
    caster.set_regions(Some(&looks)).unwrap();
    let image = picture(&mut caster, &camera);
    keep(&image, "scan-regions.png");
    let own = own.to_absolute(scan.range(), 1.0);
    let all = truth.render(&camera, SIZE, |r, ray| {
        let of = |t: u32| upper(t as usize).then_some(&own);
        r.composite_sections(ray, &of, &Sections::default(), &|_, _| DVec3::ZERO, None)
    });
    let (rms, _) = difference(&image, &all);
    println!("regions: {rms:.3}");
    assert!(rms < 0.5, "{rms}");
}

#[test]
fn outlier_values_keep_in_range_precision() {
    let mesh = generate::box_mesh([2; 3], DVec3::ONE, generate::Split::Six).unwrap();
    let camera = camera();
    let mut scan = scan_of(phantom());
    scan.appearance = ScanAppearance::Values {
        transfer: transfer(),
        range: Some((-400.0, 1200.0)),
    };
    let mut far = phantom();
    if let Raw::I16(values) = &mut far.raw {
        values[0] = i16::MAX;
        values[1] = i16::MIN;
    }
    let far = Scan {
        volume: Arc::new(far),
        ..scan.clone()
    };
    let [plain_one, far_one] = [&scan, &far].map(|scan| {
        let options = plain(Traversal::Vertices);
        let mut caster = caster(&mesh, &mesh.nodes, std::slice::from_ref(scan), options);
        picture(&mut caster, &camera)
    });
    // The two voxels are in a corner, most of which lies outside the cube.
    let each = plain_one.values.iter().zip(&far_one.values);
    let off = each.filter(|(a, b)| (*a - *b).abs() > 0.2 / 255.0).count();
    println!("{off} of {} differ", plain_one.values.len());
    assert!(off < plain_one.values.len() / 200, "{off}");
}

#[test]
fn removing_scans_restores_scalars() {
    let gpu = gpu();
    let mesh = generate::box_mesh([2; 3], DVec3::ONE, generate::Split::Six).unwrap();
    let frame = LocalFrame::from_mesh(&mesh);
    let array = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
    let topology = Topology::new(&mesh);
    let values = node_field(&mesh);
    let mut geometry = Geometry::new(&gpu, &mesh, &topology, frame, &array, &values).unwrap();
    geometry.store_rest_positions(&mesh).unwrap();
    let own = TransferFunction::preset("viridis").unwrap();
    let options = plain(Traversal::Vertices);
    let mut caster = Raycaster::with_options(&gpu, geometry, &own, options).unwrap();
    let camera = camera();
    let before = picture(&mut caster, &camera);
    caster.set_scans(&mesh, &[scan_of(phantom())]).unwrap();
    let scanned = picture(&mut caster, &camera);
    caster
        .set_transfer(&TransferFunction::preset("magma").unwrap())
        .unwrap();
    assert_ne!(picture(&mut caster, &camera), scanned);
    caster.set_scans(&mesh, &[]).unwrap();
    assert_eq!(picture(&mut caster, &camera), before);
    // Isosurfaces need values, not labels: the combination is rejected in either order.
    let inside = Sections {
        isosurfaces: vec!["0.5".parse().unwrap()],
        ..Sections::default()
    };
    caster.set_sections(&inside).unwrap();
    let labels = Scan {
        volume: Arc::new(labels()),
        units_per_mm: 1.0,
        appearance: ScanAppearance::Labels(label_looks()),
    };
    let message = caster.set_scans(&mesh, &[labels]).unwrap_err().to_string();
    assert!(message.contains("isosurfaces"), "{message}");
}

#[test]
#[ignore = "long: scripts/test --full"]
fn x_rays_conserve_attenuation_under_bending() {
    let scan = scan_of(phantom());
    let mesh = generate::box_mesh([4; 3], DVec3::ONE, generate::Split::Six).unwrap();
    let source = Xray {
        energy: 60.0,
        cm_per_unit: 3.0,
        ..Xray::default()
    };
    let values = node_field(&mesh);
    let camera = Camera::orthographic(DVec3::new(2.0, 1.4, 2.6), DVec3::splat(0.5), DVec3::Y, 2.4);
    let size = [160, 120];
    let moved = bent(&mesh);
    let squeezed: Vec<DVec3> = mesh
        .nodes
        .iter()
        .map(|p| *p * DVec3::new(0.6, 1.1, 0.9))
        .collect();
    for walk in [Traversal::Vertices, Traversal::Planes] {
        for scanned in [true, false] {
            let mut totals = Vec::new();
            for (name, positions) in [
                ("rest", &mesh.nodes),
                ("bent", &moved),
                ("squeezed", &squeezed),
            ] {
                let options = RaycastOptions {
                    xray: source,
                    ..plain(walk)
                };
                let gpu = gpu();
                let frame = LocalFrame::from_mesh(&mesh);
                let array = local_positions(&gpu, &frame, positions).unwrap();
                let topology = Topology::new(&mesh);
                let mut geometry =
                    Geometry::new(&gpu, &mesh, &topology, frame, &array, &values).unwrap();
                geometry.store_rest_positions(&mesh).unwrap();
                let mut caster =
                    Raycaster::with_options(&gpu, geometry, &transfer(), options).unwrap();
                if scanned {
                    caster
                        .set_scans(&mesh, std::slice::from_ref(&scan))
                        .unwrap();
                }
                let image = caster.image(&camera, size, Mode::Xray).unwrap();
                assert_eq!(image.channels, 1);
                let truth = match scanned {
                    true => ReferenceRaycaster::from_scan(&mesh, positions, &scan, 16.0),
                    false => ReferenceRaycaster::new(&mesh, positions, &values),
                };
                let all = truth.render(&camera, size, |r, ray| {
                    let parts = r.segments(ray).into_iter().map(|part| {
                        let of = |p: [DVec3; 4]| palpate::mesh::signed_volume(p);
                        let tet = part.tet as usize;
                        let now = of(mesh.tets[tet].map(|v| positions[v as usize]));
                        let dense = of(mesh.tet_nodes(tet)) / now;
                        let at =
                            |u: f64| source.attenuation(part.s[0] + u * (part.s[1] - part.s[0]));
                        let mean = (0..50)
                            .map(|n| at((f64::from(n) + 0.5) / 50.0))
                            .sum::<f64>()
                            / 50.0;
                        dense * mean * (part.t[1] - part.t[0])
                    });
                    parts.sum::<f64>()
                });
                let most = all.iter().copied().fold(0.0, f64::max);
                let pairs = image.values.iter().zip(&all);
                let square: f64 = pairs.map(|(a, b)| (f64::from(*a) - b).powi(2)).sum();
                let rms = 255.0 * (square / all.len() as f64).sqrt() / most;
                let total: f64 = image.values.iter().map(|v| f64::from(*v)).sum();
                println!("{walk:?} scan {scanned} {name}: rms {rms:.3} of 255, in all {total:.4}");
                assert!(rms < 1.0 && most > 0.5, "{rms} {most}");
                totals.push(total);
            }
            // The total mass is constant for any bend, up to the resolution of the picture.
            for total in &totals {
                assert!((total / totals[0] - 1.0).abs() < 1e-3, "{totals:?}");
            }
        }
    }
}

/// Returns the CT numbers at the nodes.
fn node_field(mesh: &TetMesh) -> Vec<f64> {
    let middle = DVec3::splat(0.5);
    let at = |p: &DVec3| 700.0 - 2600.0 * p.distance(middle).powi(2);
    mesh.nodes.iter().map(at).collect()
}

/// Returns three labels in voxels of another grid.
fn labels() -> Volume {
    let size = [13usize, 11, 12];
    let to_world = DAffine3::from_scale_rotation_translation(
        DVec3::new(0.06, 0.07, 0.065),
        DQuat::from_rotation_z(-0.2),
        DVec3::new(0.05, 0.15, 0.12),
    );
    let raw = (0..size.iter().product::<usize>()).map(|n| {
        let p = DVec3::new((n % 13) as f64, (n / 13 % 11) as f64, (n / 143) as f64);
        let off = p - DVec3::new(6.0, 5.0, 6.0);
        match off.length() {
            r if r < 2.6 => 7,
            r if r < 4.4 && off.y > 0.0 => 2,
            _ => 0,
        }
    });
    Volume {
        size,
        raw: Raw::U8(raw.collect()),
        to_world,
        ..Volume::default()
    }
}

fn label_looks() -> BTreeMap<i64, LabelAppearance> {
    let look = |colour, extinction| LabelAppearance { colour, extinction };
    BTreeMap::from([
        (2, look([0.1, 0.4, 0.9], 3.0)),
        (7, look([0.9, 0.8, 0.1], 20.0)),
    ])
}

#[test]
fn label_maps_are_sharp_and_combine_with_values() {
    let mesh = generate::box_mesh([2; 3], DVec3::ONE, generate::Split::Six).unwrap();
    let moved = bent(&mesh);
    let camera = camera();
    let values = scan_of(phantom());
    let labelled = Scan {
        volume: Arc::new(labels()),
        units_per_mm: 1.0,
        appearance: ScanAppearance::Labels(label_looks()),
    };
    let looks = label_looks();
    let (volume, to_voxel) = (labels(), labelled.rest_to_voxel());
    let label_at = |rest: DVec3| {
        let voxel = to_voxel.transform_point3(rest);
        let last = DVec3::from(volume.size.map(|n| n as f64 - 0.5));
        let inside = voxel.cmpge(DVec3::splat(-0.5)).all() && voxel.cmple(last).all();
        inside.then(|| {
            let at = (voxel + 0.5)
                .floor()
                .max(DVec3::ZERO)
                .to_array()
                .map(|x| x as usize);
            let at: [usize; 3] = std::array::from_fn(|k| at[k].min(volume.size[k] - 1));
            volume.value(at[0] + 13 * (at[1] + 11 * at[2])) as i64
        })
    };
    let transfer = transfer().to_absolute(values.range(), 1.0);
    let of_tets = ReferenceRaycaster::new(&mesh, &moved, &vec![0.0; mesh.nodes.len()]);
    // Both together, with short segments.
    let truth = |with_values: bool| {
        of_tets.render(&camera, SIZE, |r, ray| {
            let mut sum = [0.0f64; 4];
            for part in r.segments(ray) {
                let at = |t: f64| {
                    let w = r.barycentric_weights(part.tet, ray.origin + ray.direction * t);
                    let corners = mesh.tet_nodes(part.tet as usize);
                    (0..4).map(|k| w[k] * corners[k]).sum::<DVec3>()
                };
                let length = part.t[1] - part.t[0];
                let (front, back) = (at(part.t[0]), at(part.t[1]));
                let count = (front.distance(back) / 4e-4).ceil().max(1.0) as usize;
                for n in 0..count {
                    let rest = front.lerp(back, (n as f64 + 0.5) / count as f64);
                    let mut tau = 0.0;
                    let mut emitted = [0.0; 3];
                    let mut add = |colour: [f64; 3], extinction: f64| {
                        tau += extinction;
                        (0..3).for_each(|k| emitted[k] += extinction * colour[k]);
                    };
                    if with_values {
                        let s = values.volume.sample(rest);
                        let voxel = values.rest_to_voxel().transform_point3(rest);
                        let last = DVec3::from(values.volume.size.map(|n| n as f64 - 0.5));
                        if voxel.cmpge(DVec3::splat(-0.5)).all() && voxel.cmple(last).all() {
                            add(transfer.colour(s), transfer.extinction(s));
                        }
                    }
                    if let Some(look) = label_at(rest).and_then(|l| looks.get(&l)) {
                        add(look.colour, look.extinction);
                    }
                    let alpha = 1.0 - (-tau * length / count as f64).exp();
                    let clear = 1.0 - sum[3];
                    for k in 0..3 {
                        sum[k] += clear * alpha * emitted[k] / tau.max(1e-300);
                    }
                    sum[3] += clear * alpha;
                }
            }
            sum
        })
    };
    for (scans, with_values) in [
        (vec![labelled.clone()], false),
        (vec![values.clone(), labelled.clone()], true),
        (vec![labelled.clone(), values.clone()], true),
    ] {
        let first = matches!(scans[0].appearance, ScanAppearance::Labels(_));
        let mut caster = caster(&mesh, &moved, &scans, plain(Traversal::Vertices));
        let image = picture(&mut caster, &camera);
        keep(&image, &format!("scan-labels-{with_values}-{first}.png"));
        let (rms, worst) = difference(&image, &truth(with_values));
        println!("values {with_values}, labels first {first}: {rms:.3} {worst:.2}");
        assert!(rms < 1.0, "{rms}");
    }
}

#[test]
fn rejects_invalid_scans() {
    let mesh = generate::box_mesh([2; 3], DVec3::ONE, generate::Split::Six).unwrap();
    let mut caster = caster(
        &mesh,
        &mesh.nodes,
        &[scan_of(phantom())],
        plain(Traversal::Vertices),
    );
    let mut refused = |change: &dyn Fn(&mut Scan), expected: &str| {
        let mut scan = scan_of(phantom());
        change(&mut scan);
        let message = caster.set_scans(&mesh, &[scan]).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    };
    refused(
        &|scan| Arc::make_mut(&mut scan.volume).to_world.translation.z += 40.0,
        "do not overlap",
    );
    refused(
        &|scan| scan.units_per_mm = f64::NAN,
        "mesh units per millimetre",
    );
    refused(
        &|scan| scan.appearance = ScanAppearance::Labels(label_looks()),
        "not a label map",
    );
    refused(
        &|scan| {
            let volume = Arc::make_mut(&mut scan.volume);
            volume.raw = Raw::F32(vec![f32::NAN; volume.voxels()]);
        },
        "finite",
    );
    refused(
        &|scan| {
            scan.appearance = ScanAppearance::Values {
                transfer: transfer(),
                range: Some((3.0, 3.0)),
            }
        },
        "finite and increasing, got 3 to 3",
    );
    let other = generate::box_mesh([1; 3], DVec3::ONE, generate::Split::Six).unwrap();
    let message = caster.set_scans(&other, &[scan_of(phantom())]).unwrap_err();
    assert!(
        message
            .to_string()
            .contains("must be the mesh of the geometry"),
        "{message}"
    );
    // The previous contents are kept.
    assert!(caster.shows_scans());
    caster.image(&camera(), SIZE, Mode::Composite).unwrap();
}
