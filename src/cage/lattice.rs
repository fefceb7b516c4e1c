//! Lattice cells that cover a fine body, with the mass and stiffness that each contains.

use crate::mesh::{TET_EDGES, TetMesh};
use crate::physics::DiscreteModel;
use crate::{Error, Result};
use glam::{DVec3, UVec3};

/// Samples per cell volume of the fine body.
const SAMPLES_A_CELL: f64 = 64.0;
/// Minimum and maximum number of samples in a tetrahedron.
const SAMPLES: [f64; 2] = [4.0, 4096.0];
/// Minimum fill fraction of a cell that the body touches.
const MIN_FILL_RATIO: f64 = 0.01;
/// Maximum ratio of cell sides; more elongated cells cannot have isotropic springs.
const MAX_STRETCH: f64 = 1.15;
/// Maximum number of cells along an axis, and in total.
const MAX_CELLS_PER_AXIS: f64 = 1024.0;
const MAX_CELLS: f64 = 1e8;

/// A sample point with its share of the fine body.
struct Sample {
    place: DVec3,
    /// Young's modulus times volume, Pa m³.
    stiffness: f64,
    /// Lamé parameters μ and λ times volume, Pa m³, for finite elements.
    lame: [f64; 2],
    /// Mass, kg.
    mass: f64,
}

/// Content of the fine body in a cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CellContent {
    /// Whether the cell contains a part of the body.
    pub occupied: bool,
    /// Young's modulus times fill fraction, Pa.
    pub young: f64,
    /// Lamé parameters μ and λ times fill fraction, Pa, for finite elements.
    pub lame: [f64; 2],
    /// Mass, kg.
    pub mass: f64,
}

/// Cells of a regular grid that covers a fine body.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    /// Lowest corner, in file units.
    pub low: DVec3,
    /// Cell sides, in file units.
    pub spacing: DVec3,
    pub count: [usize; 3],
    /// One a cell, x varying fastest.
    pub contents: Vec<CellContent>,
}

impl Cells {
    /// Creates cells with about `wanted` corners around `mesh`, which has the masses and stiffnesses of
    /// `model`.
    pub fn cover(mesh: &TetMesh, model: &DiscreteModel, wanted: usize) -> Result<Cells> {
        let volume = mesh.volume().abs();
        let first = (volume / wanted as f64).cbrt();
        let samples = samples(mesh, model, first.powi(3))?;
        let mut best: Option<(f64, Cells)> = None;
        let mut side = first;
        for _ in 0..12 {
            let cells = Cells::new(mesh, &samples, side, model.length_unit)?;
            let ratio = cells.corners() as f64 / wanted as f64;
            let off = ratio.ln().abs();
            if best.as_ref().is_none_or(|b| off < b.0) {
                best = Some((off, cells));
            }
            if off < 0.02 {
                break;
            }
            side *= ratio.cbrt();
        }
        best.map(|b| b.1).ok_or_else(|| {
            Error::Mesh("the mesh has no volume, so it cannot be embedded in a cage".into())
        })
    }

    fn new(mesh: &TetMesh, samples: &[Sample], side: f64, unit: f64) -> Result<Cells> {
        let (low, high) = mesh.bounds();
        let extent = high - low;
        let whole = (extent / side).round().max(DVec3::ONE);
        let fitted = extent / whole;
        let stretch = fitted.max_element() / fitted.min_element();
        let (low, spacing, whole) = match stretch <= MAX_STRETCH {
            true => (low, fitted, whole),
            false => {
                let whole = (extent / side).ceil().max(DVec3::ONE);
                let centre = 0.5 * (low + high);
                (centre - 0.5 * side * whole, DVec3::splat(side), whole)
            }
        };
        let total = whole.to_array().iter().product::<f64>();
        if !(whole.max_element() <= MAX_CELLS_PER_AXIS && total <= MAX_CELLS) {
            return Err(Error::Input(format!(
                "a cage with cells of side {side} exceeds {MAX_CELLS_PER_AXIS} cells along an axis or {MAX_CELLS:e} in total; reduce its number of nodes"
            )));
        }
        let count = whole.to_array().map(|n| n as usize);
        let mut cells = Cells {
            low,
            spacing,
            count,
            contents: vec![CellContent::default(); count.iter().product()],
        };
        cells.fill(mesh, samples, unit);
        Ok(cells)
    }

    fn fill(&mut self, mesh: &TetMesh, samples: &[Sample], unit: f64) {
        let volume = (self.spacing * unit).to_array().iter().product::<f64>();
        let (mut stiffness, mut lame, mut mass) = (0.0, [0.0; 2], 0.0);
        for sample in samples {
            let cell = self.at(sample.place);
            let content = &mut self.contents[cell];
            content.occupied = true;
            content.young += sample.stiffness / volume;
            for (k, share) in sample.lame.iter().enumerate() {
                content.lame[k] += share / volume;
                lame[k] += share;
            }
            content.mass += sample.mass;
            stiffness += sample.stiffness;
            mass += sample.mass;
        }
        let body = mesh.volume().abs() * unit.powi(3);
        // Nodes that are not in or on an occupied cell, within a small tolerance, mark their cell
        // as occupied.
        let nudge = 1e-6 * self.spacing;
        let sides = (0..8u32).map(|k| {
            let sign = |bit: u32| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
            nudge * DVec3::new(sign(0), sign(1), sign(2))
        });
        let sides: Vec<DVec3> = sides.collect();
        for p in &mesh.nodes {
            if !sides
                .iter()
                .any(|d| self.contents[self.at(*p + *d)].occupied)
            {
                let cell = self.at(*p);
                self.contents[cell].occupied = true;
            }
        }
        let mut total = 0.0;
        for content in self.contents.iter_mut().filter(|c| c.occupied) {
            content.young = content.young.max(MIN_FILL_RATIO * stiffness / body);
            // One factor for both, to preserve Poisson's ratio.
            let least = MIN_FILL_RATIO / body;
            match content.lame[0] {
                0.0 => content.lame = lame.map(|l| least * l),
                mu => {
                    let more = (least * lame[0] / mu).max(1.0);
                    content.lame = content.lame.map(|l| more * l);
                }
            }
            content.mass = content.mass.max(MIN_FILL_RATIO * mass / body * volume);
            total += content.mass;
        }
        // Rescales all cells to the total mass, which the minimum fill increased.
        for content in self.contents.iter_mut().filter(|c| c.occupied) {
            content.mass *= mass / total;
        }
    }

    /// Returns the index of the cell that contains `p`, or of the nearest one.
    fn at(&self, p: DVec3) -> usize {
        let cell = ((p - self.low) / self.spacing).floor().max(DVec3::ZERO);
        let [nx, ny, nz] = self.count.map(|n| n as u32);
        let cell = cell.as_uvec3().min(UVec3::new(nx, ny, nz) - 1);
        cell.x as usize + self.count[0] * (cell.y as usize + self.count[1] * cell.z as usize)
    }

    /// Returns the content of a cell by its indices; empty outside of the grid.
    pub fn content(&self, cell: [i64; 3]) -> CellContent {
        let inside = (0..3).all(|a| (0..self.count[a] as i64).contains(&cell[a]));
        match inside {
            false => CellContent::default(),
            true => {
                let [x, y, z] = cell.map(|n| n as usize);
                self.contents[x + self.count[0] * (y + self.count[1] * z)]
            }
        }
    }

    /// Returns the number of corners of occupied cells.
    fn corners(&self) -> usize {
        let [nx, ny, nz] = self.count.map(|n| n as i64);
        let around = |x, y, z| {
            (0..8).any(|k: i64| {
                let cell = [x - (k & 1), y - (k >> 1 & 1), z - (k >> 2)];
                self.content(cell).occupied
            })
        };
        let rows = (0..=nz).flat_map(|z| (0..=ny).map(move |y| (y, z)));
        rows.map(|(y, z)| (0..=nx).filter(|x| around(*x, y, z)).count())
            .sum()
    }
}

/// Returns sample points that fill the body, with shares of the mass and stiffness of their
/// tetrahedra.
fn samples(mesh: &TetMesh, model: &DiscreteModel, cell: f64) -> Result<Vec<Sample>> {
    let unit = model.length_unit;
    let volume = |t: usize| mesh.tet_volume(t).abs() * unit.powi(3);
    let edge_of = |a: u32, b: u32| {
        let nodes = [a.min(b), a.max(b)];
        model.edges.binary_search_by_key(&nodes, |e| e.nodes).ok()
    };
    // An edge has κ = E ΣV / L² of its incident tetrahedra; κ L² is distributed to them by volume,
    // and so is the mass of nodes.
    let mut around_edge = vec![0.0; model.edges.len()];
    let mut around_node = vec![0.0; mesh.nodes.len()];
    let edges = |t: usize| {
        let tet = mesh.tets[t];
        TET_EDGES.map(|[a, b]| edge_of(tet[a], tet[b]))
    };
    for t in 0..mesh.tets.len() {
        for e in edges(t).into_iter().flatten() {
            around_edge[e] += volume(t);
        }
        for v in mesh.tets[t] {
            around_node[v as usize] += volume(t);
        }
    }
    let mut samples = Vec::new();
    let law = model.elements().map(|elements| elements.law);
    let mut elements = model.tets().iter().peekable();
    for t in 0..mesh.tets.len() {
        let own = volume(t);
        // Elements are in the order of the mesh's tetrahedra, some of which may have none.
        let element = elements.next_if(|e| e.nodes == mesh.tets[t]);
        let lame = match (element, law) {
            (Some(e), Some(law)) => e.small_strain(law).map(|l| l * own),
            _ => [0.0; 2],
        };
        if own <= 0.0 {
            continue;
        }
        let stiffness: f64 = edges(t)
            .into_iter()
            .flatten()
            .map(|e| {
                let edge = &model.edges[e];
                edge.stiffness * edge.length.powi(2) * own / around_edge[e] / 6.0
            })
            .sum();
        let mass: f64 = mesh.tets[t]
            .iter()
            .map(|v| model.masses[*v as usize] * own / around_node[*v as usize])
            .sum();
        let wanted = SAMPLES_A_CELL * mesh.tet_volume(t).abs() / cell;
        let count = wanted.ceil().clamp(SAMPLES[0], SAMPLES[1]) as usize;
        let corners = mesh.tet_nodes(t);
        samples.extend((0..count).map(|n| Sample {
            place: place_in(corners, n),
            stiffness: stiffness / count as f64,
            lame: lame.map(|l| l / count as f64),
            mass: mass / count as f64,
        }));
    }
    match samples.is_empty() {
        true => Err(Error::Mesh(
            "all tets of the mesh are degenerate, so it cannot be embedded in a cage".into(),
        )),
        false => Ok(samples),
    }
}

/// Returns point `n` of a uniform low-discrepancy set in a tetrahedron: a Weyl sequence in the
/// cube, folded into the tetrahedron (Rocchini & Cignoni, *Generating random points in a
/// tetrahedron*, 2001).
fn place_in(corners: [DVec3; 4], n: usize) -> DVec3 {
    let step = DVec3::new(
        0.819_172_513_396_164_4,
        0.671_043_606_703_789_2,
        0.549_700_477_901_970_3,
    );
    let [mut s, mut t, mut u] = (0.5 + step * (n + 1) as f64).fract().to_array();
    if s + t > 1.0 {
        (s, t) = (1.0 - s, 1.0 - t);
    }
    if t + u > 1.0 {
        (t, u) = (1.0 - u, 1.0 - s - t);
    } else if s + t + u > 1.0 {
        (s, u) = (1.0 - t - u, s + t + u - 1.0);
    }
    let [a, b, c, d] = corners;
    a + s * (b - a) + t * (c - a) + u * (d - a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::bounds;

    #[test]
    fn tet_samples_are_uniform() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let count = 4000;
        let points: Vec<DVec3> = (0..count).map(|n| place_in(corners, n)).collect();
        let (low, high) = bounds(&points);
        assert!(low.min_element() >= 0.0 && high.element_sum() < 3.0);
        assert!(points.iter().all(|p| p.element_sum() <= 1.0 + 1e-12));
        // Moments of a tetrahedron: mean 1/4, mean square 1/10. A missing fold causes an error of
        // at least 0.07.
        let mean = points.iter().sum::<DVec3>() / count as f64;
        let square = points.iter().map(|p| *p * *p).sum::<DVec3>() / count as f64;
        assert!((mean - 0.25).abs().max_element() < 5e-3, "{mean}");
        assert!((square - 0.1).abs().max_element() < 5e-3, "{square}");
    }
}
