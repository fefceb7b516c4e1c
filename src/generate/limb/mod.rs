//! Limb phantom: a forearm and hand with skin, fat, muscles, tendons, bones and joints.
//!
//! Every tissue is a solid given by a distance function (`anatomy`); the mesh fills the outermost,
//! and the tissues inside determine the intensity of each node and the label of each tet.

mod anatomy;

use super::lattice_fill::{check_size, fill_solid, lattice_step, phantom, separate_bones};
use crate::mesh::TetMesh;
use crate::mesher::MeshedDomain;
use crate::parallel;
use crate::{ProgressFn, Result, no_progress};
use anatomy::{Anatomy, Distances};
use glam::DVec3;

/// A tissue of the [`limb`] phantom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tissue {
    /// Its value in the cell field `label`.
    pub label: u8,
    /// Its name.
    pub name: &'static str,
    /// Its typical value in the node field `intensity`, in Hounsfield units.
    pub intensity: f64,
}

/// The tissues of the [`limb`] phantom, by label.
pub const TISSUES: [Tissue; 7] = [
    tissue(1, "skin", 20.0),
    tissue(2, "fat", -100.0),
    tissue(3, "muscle", 60.0),
    tissue(4, "tendon", 100.0),
    tissue(5, "cartilage", 170.0),
    tissue(6, "cortical bone", 1200.0),
    tissue(7, "marrow", 300.0),
];

const fn tissue(label: u8, name: &'static str, intensity: f64) -> Tissue {
    Tissue {
        label,
        name,
        intensity,
    }
}

/// Thickness of the skin in metres.
const SKIN: f64 = 0.0018;

/// Width of the transition between two tissues, in lattice cells.
const BLUR: f64 = 1.4;

/// The bounding box of the phantom, in metres.
const LOW: DVec3 = DVec3::new(0.0, -0.080, -0.042);
const HIGH: DVec3 = DVec3::new(0.352, 0.104, 0.032);

/// Factor on the size of lattice cells in the forearm.
const FOREARM_SCALE: f64 = 1.25;
/// Factor on the size of lattice cells in the hand.
const HAND_SCALE: f64 = 0.7;

/// Range of x, m, of the transition between these factors.
const GRADED: [f64; 2] = [0.06, 0.19];

/// Components below this volume, in cubic metres of lattice coordinates, are dropped: all but the
/// one with the forearm.
const MAIN_PIECE: f64 = 2e-4;

/// Lattice steps, in metres, of the two coarse meshes from which the step is estimated.
const TRIAL_STEPS: [f64; 2] = [0.0085, 0.0055];

/// Returns a forearm and hand with about `tets` tets, in metres, at any resolution.
///
/// The forearm is cut at x = 0, where it can be clamped; x runs to the fingertips, y to the thumb,
/// z to the back of the hand. The node field `intensity` resembles a CT scan in Hounsfield units,
/// the cell field `label` holds the labels of [`TISSUES`]. The digits are separate from about
/// 10,000 tets on; with fewer tets their proximal parts may join. Deterministic; dihedral angles
/// stay above 5°. No two bones share a node: there is cartilage between them. `data/limb.json` is a
/// suitable transfer function.
///
/// # Errors
/// An error for fewer than 2,000 tets, or more than 32-bit indices can address.
pub fn limb(tets: usize) -> Result<TetMesh> {
    generate_with_progress(tets, &no_progress)
}

/// As [`limb`], with progress reports.
pub(super) fn generate_with_progress(tets: usize, progress: ProgressFn) -> Result<TetMesh> {
    check_size("limb", tets)?;
    let anatomy = Anatomy::new();
    let step = lattice_step(tets, TRIAL_STEPS, |step| {
        Ok(fill(&anatomy, step, progress)?.tets.len())
    })?;
    let MeshedDomain { nodes, tets, .. } = fill(&anatomy, step, progress)?;
    let intensity = parallel::map(nodes.len(), |v| {
        let p = nodes[v];
        intensity(&anatomy.distances(p), step * scale(p.x))
    });
    let middle = |tet: &[u32; 4]| tet.iter().map(|v| nodes[*v as usize]).sum::<DVec3>() / 4.0;
    let distances = parallel::map(tets.len(), |t| anatomy.distances(middle(&tets[t])));
    let nearest: Vec<(usize, f64)> = distances.iter().map(|d| (d.nearest, d.bone)).collect();
    let bones = separate_bones(&tets, nodes.len(), &nearest);
    let labels = tets.iter().zip(&distances).zip(&bones);
    let label = labels
        .map(|((tet, d), bone)| f64::from(label(d, bone.is_some(), step * scale(middle(tet).x))))
        .collect();
    let names = TISSUES.iter().map(|t| (i64::from(t.label), t.name));
    phantom(nodes, tets, [intensity, label], names)
}

/// Meshes the whole phantom on a lattice of the given step.
fn fill(anatomy: &Anatomy, step: f64, progress: ProgressFn) -> Result<MeshedDomain> {
    // A lattice plane coincides with the cut at x = 0.
    let low = DVec3::new(0.0, LOW.y / HAND_SCALE, LOW.z / HAND_SCALE);
    let high = DVec3::new(to_lattice(HIGH.x), HIGH.y / HAND_SCALE, HIGH.z / HAND_SCALE);
    let place = |p: DVec3| from_lattice(low + p * step);
    let least = MAIN_PIECE / step.powi(3);
    let inside = |p: DVec3| -anatomy.outside(place(p));
    let mut filled = fill_solid((high - low) / step, least, inside, progress)?;
    filled.nodes.iter_mut().for_each(|p| *p = place(*p));
    Ok(filled)
}

/// Returns the ratio of the size of a lattice cell at `x` to the step.
fn scale(x: f64) -> f64 {
    let [from, to] = GRADED;
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    (1.0 / FOREARM_SCALE + t * (1.0 / HAND_SCALE - 1.0 / FOREARM_SCALE)).recip()
}

/// Returns the lattice coordinate of `x`: the integral of 1/scale.
fn to_lattice(x: f64) -> f64 {
    let [from, to] = GRADED;
    let (first, last) = (1.0 / FOREARM_SCALE, 1.0 / HAND_SCALE);
    let t = (x - from).clamp(0.0, to - from);
    first * x + (last - first) * (0.5 * t * t / (to - from) + (x - to).max(0.0))
}

/// Converts a point from lattice coordinates, the first of which is that of [`to_lattice`].
fn from_lattice(p: DVec3) -> DVec3 {
    let [from, to] = GRADED;
    let (first, last) = (1.0 / FOREARM_SCALE, 1.0 / HAND_SCALE);
    let slope = (last - first) / (to - from);
    let past = p.x - first * from;
    let x = if past <= 0.0 {
        p.x / first
    } else if p.x >= to_lattice(to) {
        to + (p.x - to_lattice(to)) / last
    } else {
        from + 2.0 * past / (first + (first * first + 2.0 * slope * past).sqrt())
    };
    let s = scale(x);
    DVec3::new(x, s * p.y, s * p.z)
}

/// Returns the CT-like value for the distances `d` to the tissues, for a mesh of cell size `cell`.
fn intensity(d: &Distances, cell: f64) -> f64 {
    // The transition between tissues is wider than a cell and smooth, so linear interpolation can
    // represent it: isosurfaces of the intensity are then smooth, without steps.
    let width = (BLUR * cell).max(0.0012);
    let within = |distance: f64| (0.5 - distance / width).clamp(0.0, 1.0);
    let [skin, fat, muscle, tendon, cartilage, cortical, marrow] = TISSUES.map(|t| t.intensity);
    [
        (d.skin + SKIN, fat),
        (d.muscle, muscle),
        (d.tendon, tendon),
        (d.cartilage, cartilage),
        (d.bone, cortical),
        (d.marrow, marrow),
    ]
    .into_iter()
    .fold(skin, |value, (distance, tissue)| {
        value + within(distance) * (tissue - value)
    })
}

/// Returns the label of a tet with the distances `d` at its centroid, part of a bone or not, for a
/// mesh of cell size `cell`.
fn label(d: &Distances, bone: bool, cell: f64) -> u8 {
    let [skin, fat, muscle, tendon, cartilage, cortical, marrow] = TISSUES.map(|t| t.label);
    // The skin is thinner than the cells of a coarse mesh: there, the outermost tets are skin.
    let skin_depth = SKIN.max(0.22 * cell);
    if bone && d.marrow < 0.0 {
        marrow
    } else if bone {
        cortical
    } else if d.bone < 0.0 || d.cartilage < 0.0 {
        cartilage
    } else if d.skin > -skin_depth {
        skin
    } else if d.tendon < 0.0 {
        tendon
    } else if d.muscle < 0.0 {
        muscle
    } else {
        fat
    }
}
