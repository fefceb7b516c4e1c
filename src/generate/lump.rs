//! Organs with a lump: shared code of the palpation phantoms.

use crate::mesh::{Field, Location, ScalarType, TetMesh};
use crate::mesher::{Domain, MeshOptions, MeshedDomain, Spacing, mesh_domain};
use crate::{Error, ProgressFn, Result};
use glam::DVec3;
use std::f64::consts::PI;

/// The stiffness-factor field of organs with a lump.
const FACTORS: &str = "stiffness";
/// Minimum clearance between a lump and the back of the organ, m.
const MIN_BACK_CLEARANCE: f64 = 2e-3;
/// Maximum widening factor of a lump to correct its volume.
const MAX_WIDENING: f64 = 1.2;
/// Maximum gradient of a weight per metre: it determines which boxes lie in one region.
const MAX_GRADIENT: f64 = 4.0;

/// A ball of stiffer tissue below the surface of an organ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lump {
    /// Its diameter, m.
    pub diameter: f64,
    /// Depth of its nearest point below the surface, m.
    pub depth: f64,
    /// Ratio of its stiffness to that of the surrounding tissue.
    pub contrast: f64,
}

impl Default for Lump {
    /// 15 mm wide, 10 mm deep, five times as stiff.
    fn default() -> Lump {
        Lump {
            diameter: 0.015,
            depth: 0.01,
            contrast: 5.0,
        }
    }
}

/// An organ: a solid in metres, and its tissues.
pub(super) trait Organ: Sync {
    /// Its name.
    const NAME: &'static str;
    /// Its tissues; later ones overlay earlier ones.
    const TISSUES: &'static [&'static str];

    /// Returns its bounding box.
    fn bounds(&self) -> (DVec3, DVec3);

    /// Returns the approximate signed distance of a point to a tissue, positive inside; the first
    /// tissue fills the whole organ, the others overlay it.
    fn inside(&self, tissue: usize, p: DVec3) -> f64;

    /// Returns the surface point above the lump, and the outward direction there.
    fn above_lump(&self) -> (DVec3, DVec3);
}

/// An organ with its lump: regions 1, 2, … are its tissues, the last is the lump.
struct Lumped<O> {
    organ: O,
    /// Centre and radius.
    lump: Option<(DVec3, f64)>,
}

impl<O: Organ> Domain for Lumped<O> {
    fn bounds(&self) -> (DVec3, DVec3) {
        self.organ.bounds()
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        let mut heaviest = self.organ.inside(0, p);
        weights.push((1, heaviest));
        let mut over = |region: u16, inside: f64| {
            // Clipped to the organ.
            let weight = heaviest + inside.min(heaviest);
            weights.push((region, weight));
            heaviest = heaviest.max(weight);
        };
        for tissue in 1..O::TISSUES.len() {
            over(tissue as u16 + 1, self.organ.inside(tissue, p));
        }
        if let Some((middle, radius)) = self.lump {
            over(O::TISSUES.len() as u16 + 1, radius - p.distance(middle));
        }
    }

    fn uniform(&self, low: DVec3, high: DVec3) -> Option<u16> {
        let reach = 0.5 * MAX_GRADIENT * low.distance(high);
        let mut weights = Vec::new();
        self.weights(0.5 * (low + high), &mut weights);
        weights.push((0, 0.0));
        weights.sort_by(|a, b| b.1.total_cmp(&a.1));
        (weights[0].1 - weights[1].1 > 2.0 * reach).then_some(weights[0].0)
    }
}

/// Meshes an organ with about `tets` tets.
pub(super) fn organ<O: Organ>(
    organ: O,
    tets: usize,
    lump: Option<Lump>,
    progress: ProgressFn,
) -> Result<TetMesh> {
    let wrong = |why: String| Err(Error::Input(why));
    if !(1_000..=20_000_000).contains(&tets) {
        return wrong(format!(
            "{} phantom must have 1,000 to 20,000,000 tets, got {tets}",
            O::NAME
        ));
    }
    let contrast = lump.map_or(1.0, |lump| lump.contrast);
    let lump = match lump {
        Some(lump) => Some(placed(&organ, &lump)?),
        None => None,
    };
    let mut domain = Lumped { organ, lump };
    let options = MeshOptions {
        spacing: Spacing::Tets(tets),
        grading: 2.0,
        ..MeshOptions::default()
    };
    let mut filled = mesh_domain(&domain, &options, progress)?;
    let own = O::TISSUES.len() as u16 + 1;
    if let Some((_, radius)) = &mut domain.lump {
        // The linear tets of a ball enclose too small a volume: the radius is enlarged accordingly.
        let over = volume(&filled, own) / (4.0 / 3.0 * PI * radius.powi(3));
        if over > 0.0 {
            *radius *= over.cbrt().recip().min(MAX_WIDENING);
            filled = mesh_domain(&domain, &options, progress)?;
        }
    }
    if lump.is_some() && !filled.regions.contains(&own) {
        return wrong(format!(
            "lump is smaller than the tets of a {} with {tets} tets; increase the number of tets \
            or the lump diameter",
            O::NAME
        ));
    }
    let regions = &filled.regions;
    let factor = |region: &u16| if *region == own { contrast } else { 1.0 };
    let fields = vec![
        Field {
            scalar_type: ScalarType::U8,
            ..Field::scalar(
                "label",
                Location::Cell,
                regions.iter().map(|r| f64::from(*r)).collect(),
            )
        },
        Field::scalar(
            FACTORS,
            Location::Cell,
            regions.iter().map(factor).collect(),
        ),
    ];
    let mut mesh = TetMesh::new(filled.nodes, filled.tets, fields, Vec::new())?;
    let names = O::TISSUES.iter().chain(lump.map(|_| &"lump"));
    mesh.region_names = (1..).zip(names.map(|name| (*name).to_owned())).collect();
    mesh.length_unit = Some(1.0);
    Ok(mesh)
}

/// Returns the volume of a region.
fn volume(filled: &MeshedDomain, region: u16) -> f64 {
    let own = filled.tets.iter().zip(&filled.regions);
    let own = own.filter(|(_, r)| **r == region).map(|(tet, _)| {
        let [a, b, c, d] = tet.map(|v| filled.nodes[v as usize]);
        (b - a).cross(c - a).dot(d - a) / 6.0
    });
    own.sum()
}

/// Returns the middle of a lump in the organ of a name, m.
///
/// # Errors
/// [`Error::Input`] for an organ without a lump, or for an invalid lump or one that does not fit.
#[cfg(all(feature = "study", feature = "identify"))]
pub(crate) fn middle_of_lump(organ: &str, lump: &Lump) -> Result<DVec3> {
    let placed = match organ {
        "breast" => placed(&super::breast::Breast, lump),
        "liver" => placed(&super::liver::Liver, lump),
        _ => Err(Error::Input(format!("{organ} has no lump"))),
    };
    placed.map(|(middle, _)| middle)
}

/// Returns the centre and radius of a lump.
fn placed<O: Organ>(organ: &O, lump: &Lump) -> Result<(DVec3, f64)> {
    let wrong = |why: String| Err(Error::Input(why));
    let positive = |x: f64| x.is_finite() && x > 0.0;
    if !(positive(lump.diameter) && positive(lump.depth) && positive(lump.contrast)) {
        return wrong(format!(
            "lump diameter ({} mm), depth ({} mm) and stiffness ratio ({}) must be finite and \
            positive",
            1e3 * lump.diameter,
            1e3 * lump.depth,
            lump.contrast
        ));
    }
    let radius = 0.5 * lump.diameter;
    let (top, out) = organ.above_lump();
    let middle = top - (lump.depth + radius) * out;
    match organ.inside(0, middle) >= radius + MIN_BACK_CLEARANCE {
        true => Ok((middle, radius)),
        false => wrong(format!(
            "lump of {} mm diameter at {} mm depth does not fit into the {}; reduce the diameter \
            or the depth",
            1e3 * lump.diameter,
            1e3 * lump.depth,
            O::NAME
        )),
    }
}

/// Returns the point on the surface of an organ above (x, y) and the outward direction there, found
/// by bisection between two heights; `None` if it is not in between.
pub(super) fn surface_above(
    inside: impl Fn(DVec3) -> f64,
    [x, y]: [f64; 2],
    [low, high]: [f64; 2],
) -> (DVec3, DVec3) {
    let (mut below, mut above) = (low, high);
    for _ in 0..60 {
        let z = 0.5 * (below + above);
        match inside(DVec3::new(x, y, z)) > 0.0 {
            true => below = z,
            false => above = z,
        }
    }
    let p = DVec3::new(x, y, below);
    let e = 1e-5;
    let slope = |axis: DVec3| inside(p - e * axis) - inside(p + e * axis);
    let out = DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z));
    (p, out.normalize_or(DVec3::Z))
}
