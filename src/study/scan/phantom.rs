//! The phantom to scan: a head-like object whose detail is a few voxels wide at any resolution.

use crate::Result;
use crate::parallel;
use crate::render::{Scan, ScanAppearance, TransferFunction};
use crate::volume::{Raw, Volume};
use glam::{DAffine3, DVec3};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Air, flesh, contrast medium in vessels, spongy and compact bone, HU.
const AIR: f64 = -1000.0;
const FLESH: f64 = 50.0;
const VESSEL: f64 = 350.0;
const SPONGY: f64 = 700.0;
const COMPACT: f64 = 1400.0;
/// Distance of the surface and of both tables of the skull from the centre.
const SURFACE: f64 = 0.45;
const OUTER_TABLE: f64 = 0.4;
const INNER_TABLE: f64 = 0.34;
/// In voxels: thickness of a table of the skull, period of the spongy bone, and width of blurred
/// edges as in a scanner.
const TABLE: f64 = 3.0;
const PERIOD: f64 = 16.0;
const EDGE: f64 = 0.5;
/// Threshold of the level set of spongy bone: gives walls of two voxels.
const WALL: f64 = 0.5;
/// Vessels are helices about the z-axis: distance from it, initial angle, turns per length, and
/// radius in voxels.
const VESSELS: [[f64; 4]; 6] = [
    [0.07, 0.0, 1.5, 3.0],
    [0.13, 2.0, -1.0, 2.0],
    [0.18, 4.0, 2.0, 1.5],
    [0.22, 1.0, -2.5, 1.5],
    [0.26, 3.0, 1.2, 2.0],
    [0.29, 5.0, -0.7, 1.2],
];

/// Returns the CT number at `p`, relative to the centre of a head in the unit cube, with voxels of
/// size `voxel`.
fn ct_number(p: DVec3, voxel: f64) -> f64 {
    let soft = |x: f64| 1.0 / (1.0 + (-x / (EDGE * voxel)).exp());
    let shell = |r: f64, at: f64| soft(r - at) * soft(at + TABLE * voxel - r);
    let r = p.length();
    let k = TAU / (PERIOD * voxel);
    let (sin, cos) = ((k * p).map(f64::sin), (k * p).map(f64::cos));
    let gyroid = sin.x * cos.y + sin.y * cos.z + sin.z * cos.x;
    let walls = soft((WALL - gyroid.abs()) / k);
    // The skull is open towards the eye.
    let closed = soft(p.y + 0.05);
    let sponge = walls * soft(r - INNER_TABLE) * soft(OUTER_TABLE - r) * closed;
    let tables = (shell(r, OUTER_TABLE) + shell(r, INNER_TABLE)) * closed;
    let kernel = walls * soft(0.05 - r);
    let vessels = VESSELS.iter().map(|[out, from, turns, radius]| {
        let (s, c) = (from + TAU * turns * p.z).sin_cos();
        let away = DVec3::new(p.x - out * c, p.y - out * s, 0.0).length();
        // Oblique, so its cross-section in the plane is elongated.
        let slant = (1.0 + (TAU * turns * out).powi(2)).sqrt();
        soft(radius * voxel - away / slant)
    });
    let vessels = vessels.fold(0.0, f64::max) * soft(INNER_TABLE - r);
    let fibres = 15.0 * (k * (0.6 * p.x + 0.8 * p.z)).sin();
    let inside = FLESH
        + fibres
        + (VESSEL - FLESH) * vessels
        + (SPONGY - FLESH) * sponge.max(kernel)
        + (COMPACT - FLESH) * tables;
    AIR + soft(SURFACE - r) * (inside - AIR)
}

/// Transfer function: a faint surface, transparent flesh, and vessels and spongy bone transparent
/// enough to see behind them.
pub(super) fn transfer() -> Result<TransferFunction> {
    TransferFunction::new(
        vec![
            [-400.0, 0.9, 0.7, 0.55],
            [100.0, 0.8, 0.4, 0.3],
            [200.0, 0.85, 0.12, 0.1],
            [400.0, 0.9, 0.2, 0.1],
            [600.0, 0.95, 0.8, 0.5],
            [1200.0, 1.0, 1.0, 0.95],
        ],
        vec![
            [-700.0, 0.0],
            [-450.0, 8.0],
            [-200.0, 0.0],
            [100.0, 0.1],
            [200.0, 10.0],
            [350.0, 60.0],
            [550.0, 20.0],
            [700.0, 40.0],
            [1400.0, 90.0],
        ],
    )
}

/// Returns the scan, with `voxels` voxels along each axis, over the unit cube about the origin.
pub(super) fn scan(voxels: usize) -> Result<Scan> {
    let voxel = 1.0 / voxels as f64;
    let first = DVec3::splat(0.5 * voxel - 0.5);
    let to_world = DAffine3::from_translation(first) * DAffine3::from_scale(DVec3::splat(voxel));
    let raw = parallel::map(voxels.pow(3), |n| {
        let index = [n % voxels, n / voxels % voxels, n / voxels / voxels].map(|i| i as f64);
        ct_number(to_world.transform_point3(index.into()), voxel).round() as i16
    });
    Ok(Scan {
        volume: Arc::new(Volume {
            size: [voxels; 3],
            raw: Raw::I16(raw),
            to_world,
            ..Volume::default()
        }),
        units_per_mm: 1.0,
        appearance: ScanAppearance::Values {
            transfer: transfer()?,
            range: None,
        },
    })
}
