//! Default appearance of the regions of a mesh: one colour each, with inner regions visible through
//! outer ones.

use crate::Result;
use crate::mesh::{FACES, Field, NO_NEIGHBOUR, TetMesh, Topology};
use crate::render::TransferFunction;
use std::collections::BTreeMap;

/// Colour palette of Okabe and Ito, safe for colour-blind viewers, with grey in place of black.
const COLOURS: [[u8; 3]; 8] = [
    [0xe6, 0x9f, 0x00],
    [0x56, 0xb4, 0xe9],
    [0x00, 0x9e, 0x73],
    [0xcc, 0x79, 0xa7],
    [0xf0, 0xe4, 0x42],
    [0xd5, 0x5e, 0x00],
    [0x00, 0x72, 0xb2],
    [0xbb, 0xbb, 0xbb],
];
/// Tints of repetitions of the palette: towards white, or towards black if negative.
const TINTS: [f64; 3] = [0.0, 0.55, -0.45];
/// Opacity over the mean chord length of a region: of one that hides no other, of one that encloses
/// others, and of one inside another.
const DEFAULT_OPACITY: f64 = 0.93;
const OUTER_OPACITY: f64 = 0.45;
const INNER_OPACITY: f64 = 0.97;
/// A region is an inner one if less than this fraction of its surface is on the boundary of the
/// body.
const INSIDE: f64 = 0.25;
/// Half width of the scalar range with the colour of one region; region numbers differ by 1.
const COLOUR_HALF_WIDTH: f64 = 0.35;
/// Largest number of regions in a legend.
const MAX_LEGEND_ENTRIES: usize = 24;

/// The regions of a mesh in the order of their values, numbered from 0.
pub(super) struct Regions {
    /// Region number of each tetrahedron.
    pub numbers: Vec<f64>,
    /// Number of regions.
    pub count: usize,
    /// Transfer function, over the region numbers.
    pub transfer: TransferFunction,
    /// Text that lists the colours of the regions.
    pub legend: String,
}

impl Regions {
    /// Creates the regions of `field`, which must satisfy [`TetMesh::is_region_field`].
    pub fn new(mesh: &TetMesh, topology: &Topology, field: &Field) -> Result<Regions> {
        let all = mesh.regions_of(field);
        let number_of: BTreeMap<i64, usize> = all
            .keys()
            .enumerate()
            .map(|(i, label)| (*label, i))
            .collect();
        let of_tet = |t: usize| number_of.get(&(field.values[t] as i64)).copied();
        let numbers: Vec<usize> = (0..mesh.tets.len()).filter_map(of_tet).collect();
        let volumes: Vec<f64> = all.values().map(|(_, volume)| *volume).collect();
        let extinctions = extinctions(mesh, topology, &numbers, &volumes);
        let (mut colour, mut extinction) = (Vec::new(), Vec::new());
        for (i, sigma) in extinctions.iter().enumerate() {
            let [r, g, b] = colour_of(i).map(|c| f64::from(c) / 255.0);
            for end in [i as f64 - COLOUR_HALF_WIDTH, i as f64 + COLOUR_HALF_WIDTH] {
                colour.push([end, r, g, b]);
                extinction.push([end, *sigma]);
            }
        }
        let mut named: Vec<String> = all
            .keys()
            .enumerate()
            .take(MAX_LEGEND_ENTRIES)
            .map(|(i, label)| {
                let name = mesh.region_names.get(label);
                let name = name.map_or(String::new(), |n| format!(" {n}"));
                let [r, g, b] = colour_of(i);
                format!("{label}{name} (#{r:02x}{g:02x}{b:02x})")
            })
            .collect();
        if all.len() > MAX_LEGEND_ENTRIES {
            named.push(format!("and {} more", all.len() - MAX_LEGEND_ENTRIES));
        }
        Ok(Regions {
            numbers: numbers.iter().map(|n| *n as f64).collect(),
            count: all.len(),
            transfer: TransferFunction::new(colour, extinction)?,
            legend: format!("regions of \"{}\": {}", field.name, named.join(", ")),
        })
    }
}

/// Returns the colour of region `i`.
pub(super) fn colour_of(i: usize) -> [u8; 3] {
    let tint = TINTS[i / COLOURS.len() % TINTS.len()];
    COLOURS[i % COLOURS.len()].map(|c| {
        let c = f64::from(c);
        let to = if tint > 0.0 { 255.0 } else { 0.0 };
        (c + tint.abs() * (to - c)).round() as u8
    })
}

/// Returns the extinction of each region per unit of length. The mean chord length of a body of
/// volume V and surface S is 4V/S (Cauchy) for any shape, so thin regions are as visible as
/// thick ones.
fn extinctions(
    mesh: &TetMesh,
    topology: &Topology,
    numbers: &[usize],
    volumes: &[f64],
) -> Vec<f64> {
    let count = volumes.len();
    let (mut surface, mut outer) = (vec![0.0; count], vec![0.0; count]);
    let mut shared: BTreeMap<[usize; 2], f64> = BTreeMap::new();
    for (t, neighbours) in topology.neighbours.iter().enumerate() {
        let own = numbers[t];
        for (face, neighbour) in FACES.iter().zip(neighbours) {
            let other = (*neighbour != NO_NEIGHBOUR).then(|| numbers[*neighbour as usize / 4]);
            if other == Some(own) {
                continue;
            }
            let [a, b, c] = face.map(|i| mesh.nodes[mesh.tets[t][i] as usize]);
            let area = (b - a).cross(c - a).length() / 2.0;
            surface[own] += area;
            match other {
                None => outer[own] += area,
                Some(other) => *shared.entry([own, other]).or_insert(0.0) += area,
            }
        }
    }
    let bare = |r: usize| outer[r] / surface[r].max(f64::MIN_POSITIVE);
    (0..count)
        .map(|r| {
            let hides = shared
                .iter()
                .filter(|([own, other], _)| *own == r && bare(*other) < INSIDE.min(bare(r)));
            let hidden: f64 = hides.map(|(_, area)| area).sum();
            let opacity = match bare(r) < INSIDE {
                true => INNER_OPACITY,
                // The opacity decreases with the fraction of the surface that encloses other
                // regions.
                false => {
                    let share = (4.0 * hidden / surface[r].max(f64::MIN_POSITIVE)).min(1.0);
                    DEFAULT_OPACITY + share * (OUTER_OPACITY - DEFAULT_OPACITY)
                }
            };
            let way = 4.0 * volumes[r] / surface[r].max(f64::MIN_POSITIVE);
            let sigma = -(1.0 - opacity).ln() / way;
            if sigma.is_finite() { sigma } else { 0.0 }
        })
        .collect()
}
