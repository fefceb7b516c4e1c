//! The problems of the study: a beam that bends, and a bump pressed into a bonded block.

use super::block::Block;
use crate::generate::{self, Split};
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, TetMesh};
use crate::physics::{
    Capability, CgSettings, Material, MaterialModel, Simulator, VolumetricFormulation,
};
use crate::study::static_equilibrium::{Cantilever, Convergence, at_rest, mesh_of_order};
use crate::{Error, Result};
use glam::DVec3;
use std::time::Instant;

/// Poisson's ratio.
pub const POISSON: f64 = 0.45;

/// The beam, which its weight bends by a few percent of its length.
const BEAM: Cantilever = Cantilever {
    length: 0.8,
    width: 0.2,
    young: 5e6,
    density: 1000.0,
    gravity: 9.81,
};

/// Ratio of the cells along the beam to the cells across.
const SLENDER: usize = 4;

/// The block into which the bump is pressed.
const BLOCK: Block = Block {
    radius: 0.05,
    height: 0.05,
    disc: 0.02,
};

/// Depth of the bump at its centre, m.
const DEPTH: f64 = 0.002;

/// Young's modulus of the block, Pa.
const BLOCK_YOUNG: f64 = 1e4;

/// Stopping criteria of the timed solves: an error far below that of the discretisation.
const TIMED: Convergence = Convergence {
    settings: CgSettings {
        tolerance: 1e-4,
        acceptable: 5e-2,
        max_iterations: 20_000,
    },
    change: 1e-3,
};

/// Those of the reference solution.
const REFERENCE: Convergence = Convergence {
    settings: CgSettings {
        tolerance: 1e-8,
        acceptable: 1e-2,
        max_iterations: 20_000,
    },
    change: 1e-6,
};

/// An element to compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementKind {
    PerTet,
    Averaged,
    Quadratic,
}

impl ElementKind {
    pub const ALL: [ElementKind; 3] = [Self::PerTet, Self::Averaged, Self::Quadratic];

    /// The name in tables and charts.
    pub fn name(self) -> &'static str {
        match self {
            Self::PerTet => "linear, per tet",
            Self::Averaged => "linear, averaged",
            Self::Quadratic => "quadratic",
        }
    }
}

/// An equilibrium to compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Problem {
    Beam,
    Bump,
}

/// A computed equilibrium.
#[derive(Clone, Copy, Debug)]
pub struct Solution {
    pub tets: usize,
    /// Coordinates of free nodes.
    pub unknowns: usize,
    /// Deflection of the beam's tip (m), or force against the depth of the bump (N).
    pub value: f64,
    /// Time from the mesh to the equilibrium, s.
    pub seconds: f64,
}

impl Problem {
    pub const ALL: [Problem; 2] = [Self::Beam, Self::Bump];

    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Beam => "beam",
            Self::Bump => "bump",
        }
    }

    /// The title of its chart.
    pub fn title(self) -> &'static str {
        match self {
            Self::Beam => "A beam bends under its weight",
            Self::Bump => "A bump pressed into a bonded block",
        }
    }

    /// Cells across the meshes of an element.
    pub fn cells(self, element: ElementKind, quick: bool) -> &'static [usize] {
        match (self, element, quick) {
            (Self::Beam, _, true) => &[1, 2],
            (Self::Beam, ElementKind::Quadratic, _) => &[1, 2, 3, 4],
            (Self::Beam, ElementKind::Averaged, _) => &[4, 8, 16, 24],
            (Self::Beam, ElementKind::PerTet, _) => &[4, 8, 16, 32],
            (Self::Bump, _, true) => &[2, 4],
            (Self::Bump, ElementKind::Quadratic, _) => &[2, 4, 6, 8],
            (Self::Bump, _, _) => &[4, 8, 16, 24],
        }
    }

    /// Cells across the meshes of quadratic tets that give the reference, each twice the one before.
    pub fn reference_cells(self, quick: bool) -> [usize; 3] {
        match (self, quick) {
            (Self::Beam, true) => [1, 2, 4],
            (Self::Beam, false) => [3, 6, 12],
            (Self::Bump, true) => [1, 2, 4],
            (Self::Bump, false) => [3, 6, 12],
        }
    }

    fn material(self, element: ElementKind) -> Material {
        let (young, density) = match self {
            Self::Beam => (BEAM.young, BEAM.density),
            Self::Bump => (BLOCK_YOUNG, 1000.0),
        };
        Material {
            model: MaterialModel::NeoHookean,
            poisson: POISSON,
            density,
            volume: match element {
                ElementKind::Averaged => VolumetricFormulation::NodalAveraged,
                _ => VolumetricFormulation::PerTet,
            },
            order: match element {
                ElementKind::Quadratic => ElementOrder::Quadratic,
                _ => ElementOrder::Linear,
            },
            ..Material::from_young(young)
        }
    }

    /// Five tets a cell, with which linear tets are less stiff than with six.
    fn mesh(self, cells: usize) -> Result<TetMesh> {
        match self {
            Self::Beam => {
                let size = DVec3::new(BEAM.length, BEAM.width, BEAM.width);
                generate::box_mesh([SLENDER * cells, cells, cells], size, Split::Five)
            }
            Self::Bump => BLOCK.mesh(cells),
        }
    }

    /// Returns the positions from which the body starts, its held nodes, and gravity.
    fn start(self, mesh: &TetMesh) -> (Vec<DVec3>, Vec<u32>, DVec3) {
        let held = |is_held: &dyn Fn(&DVec3) -> bool| {
            let nodes = (0u32..).zip(&mesh.nodes);
            nodes.filter(|(_, x)| is_held(x)).map(|(v, _)| v).collect()
        };
        match self {
            Self::Beam => {
                let held = held(&|x| x.x < 1e-9 * BEAM.length);
                let gravity = BEAM.gravity * DVec3::NEG_Z;
                (mesh.nodes.clone(), held, gravity)
            }
            Self::Bump => {
                let held = held(&|x| BLOCK.is_base(*x) || BLOCK.is_disc(*x));
                // A displacement linear in depth, which inverts no tet.
                let pressed = |x: &DVec3| {
                    let share = 1.0 + x.z / BLOCK.height;
                    *x - DEPTH * bump(*x) * share * DVec3::Z
                };
                let start = mesh.nodes.iter().map(pressed).collect();
                (start, held, DVec3::ZERO)
            }
        }
    }

    /// Computes the equilibrium with `cells` cells across; as a reference more exactly.
    ///
    /// # Errors
    /// As [`at_rest`].
    pub fn solve(
        self,
        gpu: &Gpu,
        element: ElementKind,
        cells: usize,
        is_reference: bool,
    ) -> Result<Solution> {
        let material = self.material(element);
        let mut mesh = mesh_of_order(self.mesh(cells)?, material.order)?;
        if self == Self::Bump {
            BLOCK.round(&mut mesh);
        }
        let (start, held, gravity) = self.start(&mesh);
        let convergence = if is_reference { REFERENCE } else { TIMED };
        let begin = Instant::now();
        let from = (start.as_slice(), held.as_slice());
        let mut body = at_rest(gpu, &mesh, &material, from, gravity, convergence)?;
        let seconds = begin.elapsed().as_secs_f64();
        let value = match self {
            Self::Beam => BEAM.tip(&mesh, &body.positions()?),
            Self::Bump => {
                let forces = Capability::NodalForces.require(body.reactions())?;
                let forces = forces.nodal_forces()?;
                let nodes = forces.iter().zip(&mesh.nodes);
                let disc = nodes.filter(|(_, x)| BLOCK.is_disc(**x));
                disc.map(|(f, x)| f.z * bump(*x)).sum()
            }
        };
        if !(value > 0.0 && value.is_finite()) {
            return Err(Error::Input(format!(
                "the {} of {} tets does not resist its load: {value}",
                self.name(),
                mesh.tets.len()
            )));
        }
        Ok(Solution {
            tets: mesh.element_count(),
            unknowns: 3 * (mesh.nodes.len() - held.len()),
            value,
            seconds,
        })
    }
}

/// The height of the bump at `x` over that at its centre. A sphere that is pressed into a half-space
/// touches it in a disc at whose edge the bump has half of its height (Hertz).
fn bump(x: DVec3) -> f64 {
    let off = (x.x * x.x + x.y * x.y) / (BLOCK.disc * BLOCK.disc);
    (1.0 - 0.5 * off).max(0.0)
}
