//! Foot phantom: 26 bones in soft tissue, and the surfaces of these bones alone.
//!
//! Skin and bones are solids given by distance functions (`anatomy`); the mesh fills the skin, and
//! the bones inside determine the intensity of each node and the label of each tet.

mod anatomy;

pub(crate) use anatomy::FOOT_BONES;

use super::lattice_fill::{check_size, fill_solid, lattice_step, phantom, separate_bones};
use crate::mesh::{TetMesh, TriMesh};
use crate::mesher::MeshedDomain;
use crate::parallel;
use crate::volume::{Raw, Volume};
use crate::{Error, ProgressFn, Result, no_progress};
use anatomy::Anatomy;
use glam::{DAffine3, DMat3, DVec3};

/// The label of soft tissue; the bones follow in the order of [`FOOT_BONES`].
const FLESH: u8 = 1;

/// Typical values in Hounsfield units, from outside in.
const SKIN_VALUE: f64 = 10.0;
const FLESH_VALUE: f64 = 60.0;
const CORTEX_VALUE: f64 = 1200.0;
const SPONGE_VALUE: f64 = 450.0;

/// Thickness of the skin, and of the dense shell of bones, in metres.
const SKIN: f64 = 0.0022;
const CORTEX: f64 = 0.0032;

/// Width of the transition between two tissues, in lattice cells.
const BLUR: f64 = 1.4;

/// The bounding box of the phantom, in metres.
const LOW: DVec3 = DVec3::new(-0.016, -0.066, -0.010);
const HIGH: DVec3 = DVec3::new(0.304, 0.066, 0.112);

/// Components below this volume, in cubic metres, are dropped.
const MAIN_PIECE: f64 = 2e-4;

/// Lattice steps, in metres, of the two coarse meshes from which the step is estimated.
const TRIAL_STEPS: [f64; 2] = [0.0085, 0.0055];

/// Returns a right foot with about `tets` tets, in metres, at any resolution.
///
/// It stands on z = 0 and is cut off above the ankle, where it can be clamped; x runs from the heel
/// to the toes, y to the big toe, z up. The node field `intensity` resembles a CT scan in
/// Hounsfield units; in the cell field `label` 1 is soft tissue and 2 to 27 are the bones,
/// named in the mesh's regions. From about 30,000 tets on every bone has tets of its own and the
/// toes are separate; with fewer tets the smallest bones may have none. Deterministic; dihedral
/// angles stay above 5°. No two bones share a node: there is soft tissue between them.
/// `data/limb.json` is a suitable transfer function.
///
/// # Errors
/// An error for fewer than 2,000 tets, or more than 32-bit indices can address.
pub fn foot(tets: usize) -> Result<TetMesh> {
    generate_with_progress(tets, &no_progress)
}

/// As [`foot`], with progress reports.
pub(super) fn generate_with_progress(tets: usize, progress: ProgressFn) -> Result<TetMesh> {
    check_size("foot", tets)?;
    let anatomy = Anatomy::new();
    let step = lattice_step(tets, TRIAL_STEPS, |step| {
        Ok(fill(&anatomy, step, progress)?.tets.len())
    })?;
    let MeshedDomain { nodes, tets, .. } = fill(&anatomy, step, progress)?;
    let intensity = parallel::map(nodes.len(), |v| {
        let (outside, _, bone) = anatomy.distances(nodes[v]);
        intensity(outside, bone, step)
    });
    let nearest = parallel::map(tets.len(), |t| {
        let p = tets[t].iter().map(|v| nodes[*v as usize]).sum::<DVec3>() / 4.0;
        let (_, nearest, distance) = anatomy.distances(p);
        (nearest, distance)
    });
    let label = separate_bones(&tets, nodes.len(), &nearest)
        .into_iter()
        .map(|bone| bone.map_or(f64::from(FLESH), |bone| (bone + 2) as f64))
        .collect();
    let bones = (2..).zip(FOOT_BONES.iter().copied());
    let names = bones.chain([(i64::from(FLESH), "flesh")]);
    phantom(nodes, tets, [intensity, label], names)
}

/// Returns the bones of the [`foot`] as one surface of 26 closed components, in metres, with edges
/// of about `spacing`.
///
/// # Errors
/// An [`Error::Input`] for a spacing below 0.2 mm or above 3 mm, at which small bones vanish.
pub fn foot_bones(spacing: f64) -> Result<TriMesh> {
    if !(2e-4..=3e-3).contains(&spacing) {
        return Err(Error::Input(format!(
            "edge length of foot bones must be 0.0002 to 0.003 m, got {spacing} m"
        )));
    }
    let anatomy = Anatomy::new();
    let mut all = TriMesh::default();
    for n in 0..anatomy.bones() {
        let ((low, high), distance) = anatomy.bone(n);
        let low = low - DVec3::splat(spacing);
        let size = ((high - low) / spacing)
            .to_array()
            .map(|n| n.ceil() as usize + 2);
        let to_world =
            DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(spacing)), low);
        let [nx, ny, nz] = size;
        let values = parallel::map(nx * ny * nz, |i| {
            let index = [i % nx, i / nx % ny, i / (nx * ny)].map(|n| n as f64);
            -distance(to_world.transform_point3(index.into()))
        });
        let volume = Volume {
            size,
            raw: Raw::F64(values),
            to_world,
            ..Volume::default()
        };
        let bone = volume.isosurface(0.0, f64::INFINITY)?;
        let first = all.vertices.len() as u32;
        all.vertices.extend(bone.vertices);
        let triangles = bone.triangles.into_iter();
        all.triangles
            .extend(triangles.map(|t| t.map(|v| v + first)));
    }
    Ok(all)
}

/// Meshes the whole phantom on a lattice of the given step.
fn fill(anatomy: &Anatomy, step: f64, progress: ProgressFn) -> Result<MeshedDomain> {
    let place = |p: DVec3| LOW + p * step;
    let least = MAIN_PIECE / step.powi(3);
    let inside = |p: DVec3| -anatomy.outside(place(p)) / step;
    let mut filled = fill_solid((HIGH - LOW) / step, least, inside, progress)?;
    filled.nodes.iter_mut().for_each(|p| *p = place(*p));
    Ok(filled)
}

/// Returns the CT-like value for these distances to the outside and the nearest bone, for a mesh of
/// cell size `cell`.
fn intensity(outside: f64, bone: f64, cell: f64) -> f64 {
    // The transition between tissues is wider than a cell and smooth, so linear interpolation can
    // represent it: isosurfaces of the intensity are then smooth, without steps.
    let width = (BLUR * cell).max(0.0012);
    let within = |distance: f64| (0.5 - distance / width).clamp(0.0, 1.0);
    [
        (outside + SKIN, FLESH_VALUE),
        (bone, CORTEX_VALUE),
        (bone + CORTEX, SPONGE_VALUE),
    ]
    .into_iter()
    .fold(SKIN_VALUE, |value, (distance, tissue)| {
        value + within(distance) * (tissue - value)
    })
}
