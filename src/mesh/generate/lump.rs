//! Organs with a lump in them: what the phantoms for presses share.

use crate::mesh::{Field, Location, ScalarType, TetMesh};
use crate::mesher::{Domain, MeshOptions, MeshedDomain, Spacing, mesh_domain};
use crate::{Error, ProgressFn, Result};
use glam::DVec3;
use std::f64::consts::PI;

/// The field of factors on the stiffness that organs with a lump have.
const FACTORS: &str = "stiffness";
/// What is left between a lump and the organ's back, m.
const MIN_BACK_CLEARANCE: f64 = 2e-3;
/// A lump is made at most this many times wider, for its volume.
const MAX_WIDENING: f64 = 1.2;
/// A weight changes by at most so much per metre: what tells boxes that lie in one region.
const MAX_GRADIENT: f64 = 4.0;

/// A ball of stiffer tissue below the surface of an organ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lump {
    /// Its diameter, m.
    pub diameter: f64,
    /// How far its nearest point is below the surface, m.
    pub depth: f64,
    /// How many times as stiff it is as what it lies in.
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

/// An organ: a solid in metres, and the tissues in it.
pub(super) trait Organ: Sync {
    /// What it is called.
    const NAME: &'static str;
    /// Its tissues; those that come later lie over those before.
    const TISSUES: &'static [&'static str];

    /// The box that holds it.
    fn bounds(&self) -> (DVec3, DVec3);

    /// About how far inside a tissue a point is, negative outside it; of the first, which is all
    /// of the organ, and of those over it.
    fn inside(&self, tissue: usize, p: DVec3) -> f64;

    /// The place on the surface that a lump lies below, and which way is out there.
    fn above_lump(&self) -> (DVec3, DVec3);
}

/// An organ with its lump: regions 1, 2, … are its tissues, and the last is the lump.
struct Lumped<O> {
    organ: O,
    /// Middle and radius.
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
            // Not beyond the organ.
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

/// The mesh of an organ of about `tets` tets.
pub(super) fn organ<O: Organ>(
    organ: O,
    tets: usize,
    lump: Option<Lump>,
    progress: ProgressFn,
) -> Result<TetMesh> {
    let wrong = |why: String| Err(Error::Input(why));
    if !(1_000..=20_000_000).contains(&tets) {
        return wrong(format!(
            "a {} phantom cannot have {tets} tets; ask for 1,000 to 20,000,000",
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
        // Flat tets in a ball hold too little: another one holds what this one should.
        let over = volume(&filled, own) / (4.0 / 3.0 * PI * radius.powi(3));
        if over > 0.0 {
            *radius *= over.cbrt().recip().min(MAX_WIDENING);
            filled = mesh_domain(&domain, &options, progress)?;
        }
    }
    if lump.is_some() && !filled.regions.contains(&own) {
        return wrong(format!(
            "the lump is smaller than tets are where the {} has {tets} of them; ask for more tets, or a larger lump",
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

/// The volume of a region.
fn volume(filled: &MeshedDomain, region: u16) -> f64 {
    let own = filled.tets.iter().zip(&filled.regions);
    let own = own.filter(|(_, r)| **r == region).map(|(tet, _)| {
        let [a, b, c, d] = tet.map(|v| filled.nodes[v as usize]);
        (b - a).cross(c - a).dot(d - a) / 6.0
    });
    own.sum()
}

/// Where a lump lies, and its radius.
fn placed<O: Organ>(organ: &O, lump: &Lump) -> Result<(DVec3, f64)> {
    let wrong = |why: String| Err(Error::Input(why));
    let positive = |x: f64| x.is_finite() && x > 0.0;
    if !(positive(lump.diameter) && positive(lump.depth) && positive(lump.contrast)) {
        return wrong(format!(
            "a lump of {} mm, {} mm deep, {} times as stiff makes no sense; give positive numbers",
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
            "a lump of {} mm, {} mm deep, does not fit into the {}; give less of either",
            1e3 * lump.diameter,
            1e3 * lump.depth,
            O::NAME
        )),
    }
}

/// The place on the surface of an organ above (x, y), and which way is out there, found by halving
/// between two heights; none where it is not in between.
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
