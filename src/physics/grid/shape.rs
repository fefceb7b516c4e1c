//! The particles of a regular grid, carved out of a domain.

use crate::mesh::{Field, LocalFrame, Location, ScalarType, TetMesh, bounds, signed_volume};
use crate::mesher::Domain;
use crate::parallel;
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// Maximum number of grid points along one axis, and in total, empty ones included.
const MAX_PARTICLES_PER_AXIS: usize = 4096;
const MAX_PARTICLES: usize = 1 << 27;

/// Number of spring kinds: 3 along the axes and 6 along the face diagonals, each used in both
/// directions.
pub(crate) const SPRING_KINDS: usize = 9;

/// Minimum length of the sum of the unit vectors along a particle's springs for which its normal is
/// defined. A flat surface gives 3.8.
pub const MIN_NORMAL_SUM: f64 = 0.5;

/// Decomposition into six tets of a cell whose corners are numbered x + 2 y + 4 z.
const TETS: [[usize; 4]; 6] = [
    [0, 1, 3, 7],
    [0, 5, 1, 7],
    [0, 3, 2, 7],
    [0, 2, 6, 7],
    [0, 4, 5, 7],
    [0, 6, 4, 7],
];

/// Particles on a regular grid, carved to a shape (Mosegaard, Herborg & Sørensen 2005, section
/// 2.3).
///
/// Particles are numbered with x running fastest, then y, then z. The outermost layer is always
/// empty, so that every particle of the body has its 18 neighbours at fixed offsets.
#[derive(Clone, Debug, PartialEq)]
pub struct GridShape {
    /// Grid points along each axis, the empty layers included.
    pub size: [usize; 3],
    /// Distance between neighbours along each axis, in file units.
    pub spacing: DVec3,
    /// The grid axes: orthonormal vectors.
    pub axes: DMat3,
    /// Position of the first grid point, in file units.
    pub origin: DVec3,
    /// The region of each particle, 0 for empty grid points.
    pub regions: Vec<u16>,
    /// The label of each region, starting with region 1; by default the region's number.
    pub labels: Vec<i64>,
}

impl GridShape {
    /// Offset to the neighbour along a spring of each kind, in grid steps.
    pub const SPRING_OFFSETS: [[i64; 3]; SPRING_KINDS] = [
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
        [1, 1, 0],
        [1, -1, 0],
        [1, 0, 1],
        [1, 0, -1],
        [0, 1, 1],
        [0, 1, -1],
    ];

    /// Carves `domain`: creates particles on a grid with the given `axes` and `spacing` wherever
    /// the domain has a region.
    ///
    /// # Errors
    /// [`Error::Input`] if the spacing or the axes are invalid, or there are too many particles or
    /// none.
    pub fn from_domain(domain: &dyn Domain, spacing: DVec3, axes: DMat3) -> Result<GridShape> {
        check(spacing, axes)?;
        let (low, high) = domain.bounds();
        let corners = (0..8).map(|c| {
            let pick = |bit: u32, a: f64, b: f64| if c >> bit & 1 == 1 { b } else { a };
            let corner = DVec3::new(
                pick(0, low.x, high.x),
                pick(1, low.y, high.y),
                pick(2, low.z, high.z),
            );
            axes.transpose() * corner
        });
        let corners: Vec<DVec3> = corners.collect();
        let (low, high) = bounds(&corners);
        let cells = ((high - low) / spacing).ceil().max(DVec3::ONE);
        if cells.max_element() > MAX_PARTICLES_PER_AXIS as f64 - 3.0 {
            return Err(too_many(spacing));
        }
        let size = cells.to_array().map(|n| n as usize + 3);
        let total: usize = size.iter().product();
        if total > MAX_PARTICLES {
            return Err(too_many(spacing));
        }
        // The grid is centred in the bounds, with one empty layer around.
        let reach = spacing * (cells + 2.0);
        let first = 0.5 * (low + high) - 0.5 * reach;
        let mut shape = GridShape {
            size,
            spacing,
            axes,
            origin: axes * first,
            regions: Vec::new(),
            labels: Vec::new(),
        };
        shape.regions = parallel::collect(total, |range, regions| {
            let mut weights = Vec::new();
            regions.extend(range.map(|i| match shape.is_border(i) {
                true => 0,
                false => region_at(domain, shape.rest_position(i), &mut weights),
            }));
        });
        let last = shape.regions.iter().copied().max().unwrap_or(0);
        shape.labels = (1..=i64::from(last)).collect();
        match shape.count() {
            0 => Err(Error::Input(format!(
                "no particle lies inside the body at a spacing of {spacing}; decrease the spacing"
            ))),
            _ => Ok(shape),
        }
    }

    /// As [`GridShape::from_domain`], with the uniform spacing that gives about `wanted` particles.
    ///
    /// # Errors
    /// As [`GridShape::from_domain`].
    pub fn from_domain_with_count(
        domain: &dyn Domain,
        wanted: usize,
        axes: DMat3,
    ) -> Result<GridShape> {
        if !(8..=MAX_PARTICLES / 4).contains(&wanted) {
            return Err(Error::Input(format!(
                "the number of grid particles must be from 8 to {}, got {wanted}",
                MAX_PARTICLES / 4
            )));
        }
        let (low, high) = domain.bounds();
        let volume = (high - low).to_array().iter().product::<f64>();
        let mut spacing = (2.0 * volume / wanted as f64).cbrt();
        let mut best: Option<(f64, GridShape)> = None;
        for _ in 0..10 {
            let shape = match GridShape::from_domain(domain, DVec3::splat(spacing), axes) {
                Ok(shape) => shape,
                Err(_) if best.is_none() && spacing > 1e-3 * volume.cbrt() => {
                    spacing *= 0.5;
                    continue;
                }
                Err(e) => return best.map(|b| b.1).ok_or(e),
            };
            let ratio = shape.count() as f64 / wanted as f64;
            let off = ratio.ln().abs();
            if best.as_ref().is_none_or(|b| off < b.0) {
                best = Some((off, shape));
            }
            if off < 0.02 {
                break;
            }
            spacing *= ratio.cbrt();
        }
        best.map(|b| b.1).ok_or_else(|| {
            Error::Input(
                "the body has no interior for a grid; check that its surface is closed".into(),
            )
        })
    }

    /// Number of particles of the body.
    pub fn count(&self) -> usize {
        self.regions.iter().filter(|r| **r != 0).count()
    }

    /// The particles of the body, in order.
    pub fn particles(&self) -> impl Iterator<Item = usize> {
        let has = self.regions.iter().enumerate();
        has.filter(|(_, r)| **r != 0).map(|(i, _)| i)
    }

    /// Rest position of particle `i`, in file units.
    pub fn rest_position(&self, i: usize) -> DVec3 {
        let [x, y, z] = self.coordinates(i).map(|n| n as f64);
        self.origin + self.axes * (self.spacing * DVec3::new(x, y, z))
    }

    /// Offset from a particle's number to its neighbour's, for each kind of spring.
    pub fn offsets(&self) -> [i64; SPRING_KINDS] {
        let [nx, ny, _] = self.size.map(|n| n as i64);
        GridShape::SPRING_OFFSETS.map(|[x, y, z]| x + nx * (y + ny * z))
    }

    /// The rest length of the springs of each kind, in file units.
    pub fn rest_lengths(&self) -> [f64; SPRING_KINDS] {
        GridShape::SPRING_OFFSETS
            .map(|s| (self.spacing * DVec3::from(s.map(|n| n as f64))).length())
    }

    /// The springs of every particle: bit 2 k is the forward spring of kind k, bit 2 k + 1 the
    /// backward one.
    pub fn springs(&self) -> Vec<u32> {
        let offsets = self.offsets();
        parallel::map(self.regions.len(), |i| match self.regions[i] {
            0 => 0,
            _ => (0..2 * SPRING_KINDS).fold(0, |mask, bit| {
                let step = if bit % 2 == 0 { 1 } else { -1 } * offsets[bit / 2];
                let there = self.regions[(i as i64 + step) as usize] != 0;
                mask | u32::from(there) << bit
            }),
        })
    }

    /// Returns the approximate normal at rest of a particle with these springs, normalize(Σ_j
    /// normalize(p_i − p_j)). `None` where the sum nearly vanishes: in the interior, and where the
    /// body is one particle thick.
    pub fn rest_normal(&self, springs: u32) -> Option<DVec3> {
        let mut sum = DVec3::ZERO;
        for (k, step) in GridShape::SPRING_OFFSETS.iter().enumerate() {
            let along = self.spacing * DVec3::from(step.map(|n| n as f64));
            let along = self.axes * along.normalize();
            sum -= f64::from(springs >> (2 * k) & 1) * along;
            sum += f64::from(springs >> (2 * k + 1) & 1) * along;
        }
        (sum.length() >= MIN_NORMAL_SUM).then(|| sum.normalize())
    }

    /// The surface particles whose approximate normal is undefined, because the body is one
    /// particle thick there.
    pub fn undefined_normal_particles(&self) -> Vec<u32> {
        let springs = self.springs();
        let all = (1 << (2 * SPRING_KINDS)) - 1;
        let thin = |i: &usize| springs[*i] != all && self.rest_normal(springs[*i]).is_none();
        self.particles().filter(thin).map(|i| i as u32).collect()
    }

    /// Returns the tets of all complete cells, those with eight particles and all springs of
    /// `springs` between them, numbered by the particles. Nodes at empty grid points lie in the
    /// middle of the bounds. Regions become the cell field `label`.
    ///
    /// # Errors
    /// [`Error::Input`] if no cell is complete.
    pub fn mesh(&self, springs: &[u32]) -> Result<TetMesh> {
        let [nx, ny, _] = self.size;
        let corner = |c: usize| (c & 1) + nx * ((c >> 1 & 1) + ny * (c >> 2));
        // All springs within a cell: pairs of a corner and a kind that leads to another corner.
        let inner: Vec<(usize, usize)> = (0..8usize)
            .flat_map(|c| (0..SPRING_KINDS).map(move |k| (c, k)))
            .filter(|(c, k)| {
                let at = [c & 1, c >> 1 & 1, c >> 2].map(|n| n as i64);
                (0..3).all(|a| (0..=1).contains(&(at[a] + GridShape::SPRING_OFFSETS[*k][a])))
            })
            .collect();
        let frame = self.frame();
        let (mut tets, mut labels) = (Vec::new(), Vec::new());
        let last = self.regions.len().saturating_sub(corner(7));
        for i in 0..last {
            let is_complete = (0..8).all(|c| self.regions[i + corner(c)] != 0)
                && inner
                    .iter()
                    .all(|(c, k)| springs[i + corner(*c)] >> (2 * k) & 1 == 1);
            if !is_complete {
                continue;
            }
            for tet in TETS {
                let mut tet = tet.map(|c| (i + corner(c)) as u32);
                if signed_volume(tet.map(|v| self.rest_position(v as usize))) < 0.0 {
                    tet.swap(1, 2);
                }
                tets.push(tet);
                labels.push(self.majority_label(&tet));
            }
        }
        if tets.is_empty() {
            return Err(Error::Input(
                "the grid has no complete cell, so its interior cannot be rendered; decrease the spacing".into(),
            ));
        }
        let nodes = (0..self.regions.len())
            .map(|i| match self.regions[i] {
                0 => frame.origin,
                _ => self.rest_position(i),
            })
            .collect();
        let label = Field {
            name: "label".into(),
            location: Location::Cell,
            components: 1,
            values: labels,
            scalar_type: ScalarType::I32,
        };
        // Bypasses the mesh repairs, which would drop unused nodes and renumber the others.
        let mut mesh = TetMesh {
            nodes,
            tets,
            ..TetMesh::default()
        };
        mesh.set_field(label)?;
        Ok(mesh)
    }

    /// The local frame of the body at rest.
    pub fn frame(&self) -> LocalFrame {
        let places: Vec<DVec3> = self.particles().map(|i| self.rest_position(i)).collect();
        let (low, high) = bounds(&places);
        LocalFrame::from_bounds(low, high)
    }

    /// The label of a region.
    pub fn label(&self, region: u16) -> i64 {
        let place = usize::from(region).checked_sub(1);
        let label = place.and_then(|n| self.labels.get(n));
        label.copied().unwrap_or(i64::from(region))
    }

    /// The label of most corners of a tet; the lowest in a tie.
    fn majority_label(&self, tet: &[u32; 4]) -> f64 {
        let regions = tet.map(|v| self.regions[v as usize]);
        let count = |r: u16| regions.iter().filter(|s| **s == r).count();
        let best = regions.iter().max_by_key(|r| (count(**r), u16::MAX - **r));
        self.label(best.copied().unwrap_or(0)) as f64
    }

    fn coordinates(&self, i: usize) -> [usize; 3] {
        let [nx, ny, _] = self.size;
        [i % nx, i / nx % ny, i / (nx * ny)]
    }

    fn is_border(&self, i: usize) -> bool {
        let at = self.coordinates(i);
        (0..3).any(|a| at[a] == 0 || at[a] + 1 == self.size[a])
    }
}

fn region_at(domain: &dyn Domain, p: DVec3, weights: &mut Vec<(u16, f64)>) -> u16 {
    domain.weights(p, weights);
    let outside = weights.iter().find(|w| w.0 == 0).map_or(0.0, |w| w.1);
    let best = weights
        .iter()
        .filter(|w| w.0 != 0 && w.1 > outside)
        .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
    best.map_or(0, |w| w.0)
}

fn check(spacing: DVec3, axes: DMat3) -> Result<()> {
    if !(spacing.is_finite() && spacing.min_element() > 0.0) {
        return Err(Error::Input(format!(
            "grid spacing must be finite and > 0, got {spacing}"
        )));
    }
    let square = (axes.transpose() * axes).abs_diff_eq(DMat3::IDENTITY, 1e-6);
    if !axes.is_finite() || !square {
        return Err(Error::Input(
            "the axes of a grid must be orthogonal unit vectors".into(),
        ));
    }
    Ok(())
}

fn too_many(spacing: DVec3) -> Error {
    Error::Input(format!(
        "a grid with a spacing of {spacing} exceeds {MAX_PARTICLES_PER_AXIS} particles along an axis or {MAX_PARTICLES} in total; increase the spacing"
    ))
}
