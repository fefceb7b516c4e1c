//! A continuum in float64: linear elasticity by constant-strain tets, small displacements. What a
//! body of springs is held against to know the error of the model itself.

use crate::mesh::TetMesh;
use crate::physics::plain::linear::{Solution, conjugate_gradients};
use crate::physics::plain::springs::Particles;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// A mesh of linear tets of one isotropic material, in SI units.
#[derive(Clone, Debug)]
pub struct Elements {
    nodes: usize,
    tets: Vec<Tet>,
    /// Lamé's λ and μ, Pa.
    lame: [f64; 2],
}

/// A tet, its volume and the gradients of its four shape functions.
#[derive(Clone, Copy, Debug)]
struct Tet {
    nodes: [u32; 4],
    volume: f64,
    gradients: [DVec3; 4],
}

impl Elements {
    /// The elements of `mesh`, given in metres, of Young's modulus `young` (Pa) and Poisson's
    /// ratio `poisson`, which is below ½. Tets without volume are left out.
    pub fn new(mesh: &TetMesh, young: f64, poisson: f64) -> Elements {
        let lambda = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
        let mu = young / (2.0 * (1.0 + poisson));
        let tets = (0..mesh.tets.len()).filter(|t| mesh.tet_volume(*t) > 0.0);
        Elements {
            nodes: mesh.nodes.len(),
            tets: tets
                .map(|t| Tet {
                    nodes: mesh.tets[t],
                    volume: mesh.tet_volume(t),
                    gradients: shape_gradients(mesh.tet_nodes(t)),
                })
                .collect(),
            lame: [lambda, mu],
        }
    }

    /// K u: the forces that hold the nodes displaced by u, N.
    pub fn product(&self, u: &[DVec3]) -> Vec<DVec3> {
        let [lambda, mu] = self.lame;
        let shares: Vec<[DVec3; 4]> = self
            .tets
            .par_iter()
            .map(|tet| {
                let mut gradient = DMat3::ZERO;
                for (v, g) in tet.nodes.iter().zip(tet.gradients) {
                    let u = u[*v as usize];
                    gradient += DMat3::from_cols(u * g.x, u * g.y, u * g.z);
                }
                let strain = 0.5 * (gradient + gradient.transpose());
                let trace = strain.x_axis.x + strain.y_axis.y + strain.z_axis.z;
                let stress = lambda * trace * DMat3::IDENTITY + 2.0 * mu * strain;
                tet.gradients.map(|g| tet.volume * (stress * g))
            })
            .collect();
        let mut forces = vec![DVec3::ZERO; self.nodes];
        for (tet, share) in self.tets.iter().zip(shares) {
            for (v, f) in tet.nodes.iter().zip(share) {
                forces[*v as usize] += f;
            }
        }
        forces
    }

    /// The 3×3 diagonal blocks of K, N/m.
    pub fn blocks(&self) -> Vec<DMat3> {
        let [lambda, mu] = self.lame;
        let mut blocks = vec![DMat3::ZERO; self.nodes];
        for tet in &self.tets {
            for (v, g) in tet.nodes.iter().zip(tet.gradients) {
                let outer = DMat3::from_cols(g * g.x, g * g.y, g * g.z);
                let block = (lambda + mu) * outer + mu * g.length_squared() * DMat3::IDENTITY;
                blocks[*v as usize] += tet.volume * block;
            }
        }
        blocks
    }

    /// Where `load` (N on each node) brings the nodes that are not `held`: displacements in
    /// metres, to the relative residual `tolerance`. Without enough held nodes there is no
    /// answer, and the residual says so.
    pub fn equilibrium(&self, load: &[DVec3], held: &[bool], tolerance: f64) -> Solution {
        equilibrium(|u| self.product(u), &self.blocks(), load, held, tolerance)
    }
}

/// The same of a body of springs, displaced little from where it is at rest.
pub fn spring_equilibrium(
    particles: &Particles,
    load: &[DVec3],
    held: &[bool],
    tolerance: f64,
) -> Solution {
    let product = |u: &[DVec3]| -> Vec<DVec3> {
        let forces = particles.stiffness_product(u, false);
        forces.iter().map(|f| -*f).collect()
    };
    let blocks = particles.stiffness_blocks(false);
    equilibrium(product, &blocks, load, held, tolerance)
}

fn equilibrium(
    product: impl Fn(&[DVec3]) -> Vec<DVec3>,
    blocks: &[DMat3],
    load: &[DVec3],
    held: &[bool],
    tolerance: f64,
) -> Solution {
    let masked = |values: Vec<DVec3>| -> Vec<DVec3> {
        let kept = values.into_iter().zip(held);
        kept.map(|(f, held)| if *held { DVec3::ZERO } else { f })
            .collect()
    };
    let most = 20 * load.len() as u32;
    let load = masked(load.to_vec());
    conjugate_gradients(|u| masked(product(u)), blocks, held, load, tolerance, most)
}

/// A bar of square section held at one end, bending under its own weight.
#[derive(Clone, Copy, Debug)]
pub struct Cantilever {
    /// Length, m.
    pub length: f64,
    /// Side of the section, m.
    pub width: f64,
    /// Young's modulus, Pa.
    pub young: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Mass per volume, kg/m³.
    pub density: f64,
    /// m/s².
    pub gravity: f64,
}

impl Cantilever {
    /// How far its free end sinks, m: Timoshenko's beam, w L⁴/8EI + w L²/2kGA with Cowper's
    /// k = 10 (1 + ν)/(12 + 11 ν) of a rectangle.
    pub fn tip(&self) -> f64 {
        let area = self.width * self.width;
        let inertia = area * area / 12.0;
        let load = self.density * self.gravity * area;
        let shear = self.young / (2.0 * (1.0 + self.poisson));
        let cowper = 10.0 * (1.0 + self.poisson) / (12.0 + 11.0 * self.poisson);
        load * self.length.powi(4) / (8.0 * self.young * inertia)
            + load * self.length.powi(2) / (2.0 * cowper * shear * area)
    }
}

/// The gradients of the functions that are 1 at one corner of a tet and 0 at the others.
fn shape_gradients(v: [DVec3; 4]) -> [DVec3; 4] {
    let edges = DMat3::from_cols(v[1] - v[0], v[2] - v[0], v[3] - v[0]);
    let rows = edges.inverse().transpose();
    let [a, b, c] = [rows.x_axis, rows.y_axis, rows.z_axis];
    [-(a + b + c), a, b, c]
}
