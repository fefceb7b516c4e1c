//! Meshing of implicit solids with tets of uniform size.

use crate::mesh::{Field, Location, ScalarType, TetMesh};
use crate::mesher::{Domain, MeshOptions, MeshedDomain, Spacing, mesh_domain};
use crate::{Error, ProgressFn, Result};
use glam::DVec3;

/// A solid in lattice units: {p : inside(p) > 0} in the box from the origin to `size`.
struct Solid<F> {
    size: DVec3,
    inside: F,
}

impl<F: Fn(DVec3) -> f64 + Sync> Domain for Solid<F> {
    fn bounds(&self) -> (DVec3, DVec3) {
        (DVec3::ZERO, self.size)
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        weights.push((1, (self.inside)(p)));
    }
}

/// Meshes {p : inside(p) > 0}, contained in the box from the origin to `size`, with edges of about
/// 1. Components with a volume below `least` are dropped.
pub(super) fn fill_solid(
    size: DVec3,
    least: f64,
    inside: impl Fn(DVec3) -> f64 + Sync,
    progress: ProgressFn,
) -> Result<MeshedDomain> {
    let options = MeshOptions {
        spacing: Spacing::Edge(1.0),
        grading: 1.0,
        min_island: least,
        ..MeshOptions::default()
    };
    mesh_domain(&Solid { size, inside }, &options, progress)
}

/// Rejects a number of tets that a phantom cannot have.
pub(super) fn check_size(name: &str, tets: usize) -> Result<()> {
    if (2_000..=50_000_000).contains(&tets) {
        return Ok(());
    }
    Err(Error::Input(format!(
        "{name} phantom must have 2,000 to 50,000,000 tets, got {tets}"
    )))
}

/// Returns the mesh of a phantom, in metres, with the intensities of its nodes, the labels of its
/// tets, and the names of these.
pub(super) fn phantom<'a>(
    nodes: Vec<DVec3>,
    tets: Vec<[u32; 4]>,
    [intensity, label]: [Vec<f64>; 2],
    names: impl Iterator<Item = (i64, &'a str)>,
) -> Result<TetMesh> {
    // Written as 32-bit numbers, so that a mesh read from a file equals this one.
    let intensity = intensity.into_iter().map(|x| f64::from(x as f32)).collect();
    let fields = vec![
        Field {
            scalar_type: ScalarType::F32,
            ..Field::scalar("intensity", Location::Node, intensity)
        },
        Field {
            scalar_type: ScalarType::U8,
            ..Field::scalar("label", Location::Cell, label)
        },
    ];
    let mut mesh = TetMesh::new(nodes, tets, fields, Vec::new())?;
    mesh.region_names = names
        .map(|(label, name)| (label, name.to_owned()))
        .collect();
    mesh.length_unit = Some(1.0);
    Ok(mesh)
}

/// Assigns tets to bones so that no two bones share a node: stiff or rigid bones with a common node
/// would act as one. For each tet of a mesh with the given number of nodes, `nearest` holds the
/// nearest bone and the signed distance of its surface to the centroid of the tet, negative inside.
/// At a node between bones the one with the deepest centroid is kept.
pub(super) fn separate_bones(
    tets: &[[u32; 4]],
    nodes: usize,
    nearest: &[(usize, f64)],
) -> Vec<Option<usize>> {
    let mut at_node: Vec<Option<(usize, f64)>> = vec![None; nodes];
    for (tet, (bone, distance)) in tets.iter().zip(nearest) {
        if *distance < 0.0 {
            for v in tet {
                let known = &mut at_node[*v as usize];
                if known.is_none_or(|(_, deepest)| *distance < deepest) {
                    *known = Some((*bone, *distance));
                }
            }
        }
    }
    let of_tet = |(tet, (bone, distance)): (&[u32; 4], &(usize, f64))| {
        let own = |v: &u32| at_node[*v as usize].is_some_and(|(b, _)| b == *bone);
        (*distance < 0.0 && tet.iter().all(own)).then_some(*bone)
    };
    tets.iter().zip(nearest).map(of_tet).collect()
}

/// Number of tets below which the step is corrected by trial meshes.
const MAX_TRIAL_TETS: usize = 20_000;

/// Estimates the lattice step for which a solid has about `tets` tets from the `count` of two
/// coarse meshes: the number is a/step³ + b/step², for the volume and the surface.
pub(super) fn lattice_step(
    tets: usize,
    [coarse, fine]: [f64; 2],
    count: impl Fn(f64) -> Result<usize>,
) -> Result<f64> {
    let count = |step: f64| count(step).map(|n| n as f64);
    let (n, m) = (count(coarse)? * coarse.powi(3), count(fine)? * fine.powi(3));
    let b = (n - m) / (coarse - fine);
    let a = m - b * fine;
    let (mut low, mut high) = (1e-5f64, 0.1f64);
    for _ in 0..60 {
        let step = 0.5 * (low + high);
        match a / step.powi(3) + b / step.powi(2) > tets as f64 {
            true => low = step,
            false => high = step,
        }
    }
    let mut step = 0.5 * (low + high);
    if tets < MAX_TRIAL_TETS {
        // If cells are as large as fingers the estimate is poor, but trials are cheap.
        for _ in 0..3 {
            step *= (count(step)? / tets as f64).cbrt();
        }
    }
    Ok(step)
}
