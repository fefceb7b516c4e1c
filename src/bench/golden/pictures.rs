//! Pictures compared with stored ones and with exact ray integrals.

use super::LEVELS;
use crate::bench::{Case, Context, Row};
use crate::generate;
use crate::gpu::Gpu;
use crate::mesh::{LocalFrame, Location, TetMesh, Topology};
use crate::render::{
    Camera, Geometry, Image, ImageDifference, Light, Mode, RaycastOptions, Raycaster,
    ReferenceRaycaster, Shading, Surface, SurfaceColour, TableKind, TransferFunction, Traversal,
    local_positions,
};
use crate::study::scan::{BALL, ScanRepresentation, Subject};
use crate::study::{peers_camera, peers_transfer};
use crate::{Error, Result};
use glam::DVec3;
use std::path::Path;

/// Returns the name and the bytes of a stored picture.
macro_rules! stored {
    ($name:literal) => {
        (
            $name,
            include_bytes!(concat!("../../../tests/golden/", $name, ".png")),
        )
    };
}
/// The names of the stored pictures, and their files.
const STORED: [(&str, &[u8]); 6] = [
    stored!("limb-bone"),
    stored!("limb-tissue"),
    stored!("limb-skin"),
    stored!("cube-surface"),
    stored!("cube-viridis"),
    stored!("cube-thickness"),
];

/// The names of the pictures that are stored with the program.
pub const GOLDEN_PICTURES: [&str; 6] = [
    STORED[0].0,
    STORED[1].0,
    STORED[2].0,
    STORED[3].0,
    STORED[4].0,
    STORED[5].0,
];

/// Bounds of the root mean square and of the 99.9th percentile, in 1/255: of stored pictures, of
/// exact ones, and of exact ones with light.
const OF_STORED: [f64; 2] = [1.0, 6.0];
const OF_EXACT: [f64; 2] = [0.5, 2.0];
const OF_LIT: [f64; 2] = [0.5, 3.0];
const SIZE: [u32; 2] = [128, 128];
/// Voxels along a side of the scan, and cells across its ball.
const VOXELS: usize = 24;
const BALL_CELLS: usize = 6;
/// Distance of the samples of the scan in voxels, and samples per voxel of the exact picture.
const SCAN_STEP: f64 = 1.0 / 16.0;
const SAMPLES: f64 = 16.0;

pub(super) fn cases() -> Vec<Case> {
    let row = |what: String, bounds: [f64; 2]| Row::new(what, "gpu", LEVELS).bound(bounds[0]);
    let mut all: Vec<Case> = STORED
        .iter()
        .map(|(name, bytes)| {
            Case::new(row(format!("{name}, stored"), OF_STORED), |context, row| {
                with_stored(context, row, name, bytes)
            })
        })
        .collect();
    for (what, walk, table) in [
        ("integrals", Traversal::Vertices, TableKind::Integrals),
        ("integrals, planes", Traversal::Planes, TableKind::Integrals),
        ("slices", Traversal::Vertices, TableKind::Sliced),
        ("volume table", Traversal::Vertices, TableKind::Volume),
    ] {
        let row = row(format!("cube, {what}, exact"), OF_EXACT);
        all.push(Case::new(row, move |context, row| {
            cube(context, row, walk, table)
        }));
    }
    let case = Case::new(row("bent limb, exact".into(), OF_EXACT), bent_limb);
    all.push(case);
    let case = Case::new(row("bent lit duct, exact".into(), OF_LIT), lit_duct);
    all.push(case);
    let case = Case::new(row("bent scan, exact".into(), OF_EXACT), bent_scan);
    all.push(case);
    all
}

/// Draws one of the [`GOLDEN_PICTURES`].
///
/// # Errors
/// [`Error::Input`] for another name; an error if the device fails.
pub fn golden_picture(gpu: &Gpu, name: &str) -> Result<Image> {
    if let Some(preset) = name.strip_prefix("limb-") {
        let limb = generate::by_name("limb", Some(12_000))?;
        let geometry = Geometry::at_rest(gpu, &limb, &first_scalars(&limb))?;
        let mut caster = Raycaster::new(gpu, geometry, &TransferFunction::preset(preset)?)?;
        return caster.image(&Camera::fit_mesh(&limb), SIZE, Mode::Composite);
    }
    let cube = generate::benchmark_cube(8, true)?;
    let scalars = first_scalars(&cube);
    let transfer = TransferFunction::preset("viridis")?;
    let geometry = Geometry::at_rest(gpu, &cube, &scalars)?;
    let flat = Camera::orthographic(peers_camera().eye, peers_camera().look_at, DVec3::Y, 1.8);
    let raycast =
        |geometry, mode| Raycaster::new(gpu, geometry, &transfer)?.image(&flat, SIZE, mode);
    match name {
        "cube-surface" => {
            let colour = SurfaceColour::Field(transfer.clone());
            Surface::new(gpu, &geometry, &scalars, &colour, Shading::Smooth)?
                .image(&peers_camera(), SIZE)
        }
        "cube-viridis" => raycast(geometry, Mode::Composite),
        "cube-thickness" => raycast(geometry, Mode::Thickness),
        _ => Err(Error::Input(format!(
            "there is no golden picture \"{name}\"; choose among {}",
            GOLDEN_PICTURES.join(", ")
        ))),
    }
}

/// Returns the first scalar field at the nodes.
fn first_scalars(mesh: &TetMesh) -> Vec<f64> {
    let mut fields = mesh.fields.iter();
    let field = fields.find(|f| f.location == Location::Node && f.components == 1);
    field.map(|f| f.values.clone()).unwrap_or_default()
}

fn with_stored(context: &Context, row: Row, name: &str, bytes: &[u8]) -> Result<Row> {
    let folder = tempfile::tempdir().map_err(Error::io(std::env::temp_dir()))?;
    let file = format!("{name}.png");
    // Both are read from files, so that they have the same rounding.
    let drawn = folder.path().join(&file);
    golden_picture(context.gpu, name)?.save(&drawn)?;
    let golden = match context.goldens {
        Some(given) => given.join(&file),
        None => {
            let path = folder.path().join(format!("stored-{file}"));
            std::fs::write(&path, bytes).map_err(Error::io(&path))?;
            path
        }
    };
    let read = |path: &Path| Image::read_for_comparison(path);
    let difference = ImageDifference::between(&read(&drawn)?, &read(&golden)?)?;
    Ok(judge(row, &difference, OF_STORED))
}

/// Compares a picture with exact pixels.
fn with_exact(row: Row, image: &Image, exact: &[[f64; 4]], bounds: [f64; 2]) -> Result<Row> {
    let values = exact.as_flattened().iter().map(|v| *v as f32).collect();
    let exact = Image {
        size: image.size,
        channels: 4,
        values,
    };
    let difference = ImageDifference::between(image, &exact)?;
    Ok(judge(row, &difference, bounds))
}

fn judge(row: Row, difference: &ImageDifference, bounds: [f64; 2]) -> Row {
    let percentile = 255.0 * difference.percentile_999;
    let note = format!("99.9th percentile {percentile:.2}, bound {}", bounds[1]);
    row.judged(255.0 * difference.rmse, percentile <= bounds[1])
        .note(note)
}

fn cube(context: &Context, row: Row, walk: Traversal, table: TableKind) -> Result<Row> {
    let mesh = generate::benchmark_cube(12, false)?;
    let options = RaycastOptions {
        walk,
        table,
        ..Default::default()
    };
    let scalars = first_scalars(&mesh);
    let geometry = Geometry::at_rest(context.gpu, &mesh, &scalars)?;
    let caster = Raycaster::with_options(context.gpu, geometry, &peers_transfer()?, options)?;
    let exact = ReferenceRaycaster::new(&mesh, &mesh.nodes, &scalars);
    compare(row, caster, &exact, &peers_camera(), OF_EXACT)
}

fn compare(
    row: Row,
    mut caster: Raycaster,
    exact: &ReferenceRaycaster,
    camera: &Camera,
    bounds: [f64; 2],
) -> Result<Row> {
    let image = caster.image(camera, SIZE, Mode::Composite)?;
    let transfer = caster.transfer();
    let pixels = exact.render(camera, SIZE, |rays, ray| rays.composite(ray, &transfer));
    with_exact(row, &image, &pixels, bounds)
}

/// Returns the nodes of a bent mesh, without inverted tets.
fn bent(mesh: &TetMesh) -> Vec<DVec3> {
    let (low, high) = mesh.bounds();
    let size = (high - low).max_element();
    let bend = |p: &DVec3| {
        let u = (*p - low) / size;
        *p + size * DVec3::new(0.3 * u.y * u.y, 0.1 * u.x * u.z, 0.2 * u.x * u.y)
    };
    mesh.nodes.iter().map(bend).collect()
}

fn bent_limb(context: &Context, row: Row) -> Result<Row> {
    let mesh = generate::by_name("limb", Some(12_000))?;
    let (positions, scalars) = (bent(&mesh), first_scalars(&mesh));
    let (gpu, topology) = (context.gpu, Topology::new(&mesh));
    let frame = LocalFrame::from_mesh(&mesh);
    let array = local_positions(gpu, &frame, &positions)?;
    let geometry = Geometry::new(gpu, &mesh, &topology, frame, &array, &scalars)?;
    let caster = Raycaster::new(gpu, geometry, &TransferFunction::preset("bone")?)?;
    let exact = ReferenceRaycaster::new(&mesh, &positions, &scalars);
    compare(row, caster, &exact, &Camera::fit_mesh(&mesh), OF_EXACT)
}

fn lit_duct(context: &Context, row: Row) -> Result<Row> {
    let size = DVec3::new(1.0, 1.0, 1.5);
    let mesh = generate::duct([9, 9, 9], size, generate::Bore::Round)?;
    let wave = |p: &DVec3| {
        let u = *p / size.z;
        0.5 + 0.25 * ((7.0 * u.x).sin() * (5.0 * u.y).cos() + (6.0 * u.z + 2.0 * u.x).sin())
    };
    let scalars: Vec<f64> = mesh.nodes.iter().map(wave).collect();
    let (gpu, topology, positions) = (context.gpu, Topology::new(&mesh), bent(&mesh));
    let frame = LocalFrame::from_mesh(&mesh);
    let array = local_positions(gpu, &frame, &positions)?;
    let mut geometry = Geometry::new(gpu, &mesh, &topology, frame, &array, &scalars)?;
    geometry.enable_lighting(&mesh, &topology, &scalars)?;
    let (low, high) = geometry.scalar_range();
    let options = RaycastOptions {
        light: Light::Head,
        ..Default::default()
    };
    let transfer = TransferFunction::preset("viridis")?;
    let mut caster = Raycaster::with_options(gpu, geometry, &transfer, options)?;
    let camera = Camera::fit_mesh(&mesh);
    let image = caster.image(&camera, SIZE, Mode::Composite)?;
    let to_local = |p: &DVec3| (*p - frame.origin) / frame.scale;
    let local: Vec<DVec3> = positions.iter().map(to_local).collect();
    let shares: Vec<f64> = scalars.iter().map(|s| (s - low) / (high - low)).collect();
    let gradients = Geometry::reference_node_gradients(&mesh, &topology, &local, &shares, None);
    let exact = ReferenceRaycaster::new(&mesh, &positions, &scalars);
    let transfer = caster.transfer();
    let pixels = exact.render(&camera, SIZE, |rays, ray| {
        rays.composite_lit(ray, &transfer, |tet, p, way| {
            let weights = rays.barycentric_weights(tet, p);
            let parts = mesh.tets[tet as usize].iter().zip(weights);
            let gradient = parts.map(|(v, w)| w * gradients[*v as usize]).sum();
            Light::Head.shade(gradient, way)
        })
    });
    with_exact(row, &image, &pixels, OF_LIT)
}

fn bent_scan(context: &Context, row: Row) -> Result<Row> {
    let subject = Subject::new(VOXELS, SIZE[0] as usize)?;
    let mesh = generate::ball(BALL, BALL_CELLS)?;
    let options = RaycastOptions {
        opacity_cutoff: 1.0,
        // The phantom's edges are as sharp as a voxel.
        scan_step: SCAN_STEP,
        ..Default::default()
    };
    let as_scan = ScanRepresentation::Scan;
    let (mut caster, _) = subject.raycaster(context.gpu, &mesh, as_scan, options)?;
    let image = caster.image(&subject.camera, SIZE, Mode::Composite)?;
    let pixels = subject.exact_through(&mesh, SAMPLES);
    with_exact(row, &image, &pixels, OF_EXACT)
}
