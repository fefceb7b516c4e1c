//! Finite elements: tets of hyperelastic material, and the float64 reference form of linear ones,
//! against which engines are tested; [`super::quadratic`] has that of ten-node tets.
//!
//! F = Ds Dm⁻¹ is the deformation gradient of a tet; the columns of Ds and Dm are three of its
//! edges, deformed and at rest; J = det F. Both constitutive models reduce to Hooke's law for small
//! strains.
//!
//! - Stable Neo-Hookean (Smith, de Goes & Kim 2018, "Stable Neo-Hookean Flesh Simulation", equation
//!   13, without the barrier): Ψ = μ/2 (|F|² − 3) − μ (J − 1) + λ′/2 (J − 1)² with λ′ = λ + μ.
//! - Fixed corotated (Stomakhin et al. 2012, "Energetically Consistent Invertible Elasticity",
//!   section 3.4): Ψ = μ |F − R|² + λ/2 (J − 1)², R the rotation of F = R S, det R = 1 for inverted
//!   tets too.
//!
//! Both have a finite compressive strength: under a few times its Young's modulus a tet collapses
//! and inverts. A tet crushed to less than J₀ = [`CRUSH_THRESHOLD_J`] of its volume is therefore
//! stiffened: with c = (J₀ − J)/J₀ the second derivative of Ψ by J has the additional term 16 K c²
//! (1 − c)², K being [`CRUSH_STIFFNESS_RATIO`] μ, down to J = 0, and none beyond, where it would
//! only store energy. Tets that are not crushed are unaffected.

use super::quadratic::MidEdges;
use super::rigid_region::RigidBody;
use crate::physics::VolumetricFormulation;
use glam::{DMat3, DVec3};

/// J below which a tet counts as crushed. `shaders/lib/finite_elements.wgsl` has the same constant.
pub(crate) const CRUSH_THRESHOLD_J: f64 = 0.1;

/// Additional stiffness K of crushed tets, over μ.
pub(crate) const CRUSH_STIFFNESS_RATIO: f64 = 100.0;

/// Hessian of a tet's energy: the block of nodes a and b is at `[a][b]`.
pub(crate) type ElementHessian = [[DMat3; 4]; 4];

/// The constitutive model: energy density as a function of strain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ConstitutiveModel {
    /// Stable Neo-Hookean.
    #[default]
    NeoHookean,
    /// Fixed corotated.
    Corotated,
}

/// A tet at rest with its material parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// Its nodes.
    pub nodes: [u32; 4],
    /// Dm⁻¹, 1/m: the inverse of the edges from the first node to the others at rest.
    pub inverse_rest_shape: DMat3,
    /// Volume at rest, m³.
    pub volume: f64,
    /// μ and λ as they enter the energy, Pa; [`ConstitutiveModel::NeoHookean`] has λ + μ in place of
    /// λ.
    pub lame_parameters: [f64; 2],
    /// Its material region; tets of different regions do not share nodal volumes.
    pub region: u32,
}

/// The finite elements and rigid bodies of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Elements {
    /// The constitutive model of all elements.
    pub law: ConstitutiveModel,
    /// Formulation of the volumetric strain.
    pub volume: VolumetricFormulation,
    /// For [`VolumetricFormulation::NodalAveraged`]: λ over μ up to which each tet keeps its own
    /// volume. This part resists modes in which tets alternately grow and shrink while nodal
    /// volumes stay constant.
    pub per_tet_lambda_ratio: f64,
    /// The tets, without those of rigid bodies; in a body of order 2 the ten-node tets, with their
    /// corners as nodes.
    pub tets: Vec<Element>,
    /// The other nodes of each ten-node tet; empty in a body of order 1.
    pub(crate) mid_edges: Vec<MidEdges>,
    /// The rigid bodies.
    pub rigid: Vec<RigidBody>,
    /// α of Rayleigh damping, 1/s: a force −α m v on every node. The stiffness-proportional part is
    /// [`DiscreteModel::damping_time`](crate::physics::DiscreteModel::damping_time).
    pub mass_damping: f64,
}

impl Elements {
    /// Whether there are no tets and no rigid bodies.
    pub fn is_empty(&self) -> bool {
        self.tets.is_empty() && self.rigid.is_empty()
    }

    /// Ratio of the largest to the smallest μ; 1 without tets.
    pub fn stiffness_ratio(&self) -> f64 {
        let range = self.tets.iter().map(|t| t.lame_parameters[0]);
        let (soft, stiff) = range.fold((f64::INFINITY, 0.0f64), |(low, high), mu| {
            (low.min(mu), high.max(mu))
        });
        match soft > 0.0 && soft.is_finite() {
            true => stiff / soft,
            false => 1.0,
        }
    }
}

/// Stopping criteria of Newton's method in an implicit step of finite elements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NewtonSettings {
    /// Maximum number of Newton iterations per step; exceeded while they would invert tets.
    pub iterations: u32,
    /// Convergence tolerance: residual over the norm of the driving forces (√(rᵀD⁻¹r), D the
    /// diagonal blocks). 0 takes as few iterations as the energy allows: another iteration follows
    /// only if the last one lowered the energy by much less, or much more, than its quadratic model
    /// predicted, until the decrease is negligible.
    pub tolerance: f64,
    /// Relative residual of the linear solves.
    pub linear_tolerance: f64,
}

impl NewtonSettings {
    /// Settings for the residual `tolerance`, used when [`CgSettings::tolerance`] is not the
    /// default.
    ///
    /// [`CgSettings::tolerance`]: crate::physics::CgSettings::tolerance
    pub fn with_tolerance(tolerance: f64) -> NewtonSettings {
        NewtonSettings {
            iterations: 40,
            tolerance,
            linear_tolerance: 1e-2,
        }
    }
}

impl Default for NewtonSettings {
    fn default() -> Self {
        NewtonSettings {
            iterations: 12,
            tolerance: 0.0,
            linear_tolerance: 0.15,
        }
    }
}

impl Element {
    /// The tet with these nodes at `corners` (m), with Young's modulus `young` (Pa) and Poisson's
    /// ratio `poisson`. `None` if the volume is not positive or a parameter is out of range.
    pub fn new(
        nodes: [u32; 4],
        corners: [DVec3; 4],
        young: f64,
        poisson: f64,
        law: ConstitutiveModel,
    ) -> Option<Element> {
        let edges = edges(&corners);
        let volume = edges.determinant() / 6.0;
        let inverse = edges.inverse();
        let mu = young / (2.0 * (1.0 + poisson));
        let lambda = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
        let lame = match law {
            ConstitutiveModel::NeoHookean => [mu, lambda + mu],
            ConstitutiveModel::Corotated => [mu, lambda],
        };
        let sound = volume > 0.0
            && volume.is_finite()
            && inverse.is_finite()
            && young > 0.0
            && poisson > -1.0
            && poisson < 0.5
            && lame.iter().all(|l| l.is_finite());
        sound.then_some(Element {
            nodes,
            inverse_rest_shape: inverse,
            volume,
            lame_parameters: lame,
            region: 0,
        })
    }

    /// Returns the gradients of the shape functions, 1/m: F is the sum of x_a ⊗ g_a.
    pub fn gradients(&self) -> [DVec3; 4] {
        let rows = self.inverse_rest_shape.transpose();
        let [a, b, c] = [rows.x_axis, rows.y_axis, rows.z_axis];
        [-(a + b + c), a, b, c]
    }

    /// Returns the Lamé parameters μ and λ at small strain, Pa.
    pub(crate) fn small_strain(&self, law: ConstitutiveModel) -> [f64; 2] {
        let [mu, second] = self.lame_parameters;
        match law {
            ConstitutiveModel::NeoHookean => [mu, second - mu],
            ConstitutiveModel::Corotated => [mu, second],
        }
    }

    /// Returns the positions of its nodes, where `x` are those of all nodes.
    pub(crate) fn node_positions(&self, x: &[DVec3]) -> [DVec3; 4] {
        self.nodes.map(|v| x[v as usize])
    }

    /// Returns ∂J/∂F with its nodes at `corners`, m.
    pub(crate) fn cofactor(&self, corners: &[DVec3; 4]) -> DMat3 {
        cofactor(&self.deformation_gradient(corners))
    }

    /// Returns F of the tet with its nodes at `corners`, m.
    pub fn deformation_gradient(&self, corners: &[DVec3; 4]) -> DMat3 {
        edges(corners) * self.inverse_rest_shape
    }

    /// Returns the energy of the tet with its nodes at `corners` (m), J.
    pub fn energy(&self, law: ConstitutiveModel, corners: &[DVec3; 4]) -> f64 {
        self.volume * self.energy_density(law, &self.deformation_gradient(corners))
    }

    /// Returns the energy per volume at rest at F = `f`, J/m³.
    pub fn energy_density(&self, law: ConstitutiveModel, f: &DMat3) -> f64 {
        let [mu, lambda] = self.lame_parameters;
        let j = f.determinant();
        let density = match law {
            ConstitutiveModel::NeoHookean => 0.5 * mu * (norm_squared(f) - 3.0) - mu * (j - 1.0),
            ConstitutiveModel::Corotated => mu * norm_squared(&(*f - polar_decomposition(f).0)),
        };
        let c = ((CRUSH_THRESHOLD_J - j) / CRUSH_THRESHOLD_J).clamp(0.0, 1.0);
        let crushed = c.powi(4) / 12.0 - c.powi(5) / 10.0 + c.powi(6) / 30.0;
        let beyond = (-j).max(0.0) / 30.0;
        let stop = 16.0
            * CRUSH_STIFFNESS_RATIO
            * mu
            * CRUSH_THRESHOLD_J
            * (CRUSH_THRESHOLD_J * crushed + beyond);
        density + 0.5 * lambda * (j - 1.0).powi(2) + stop
    }

    /// Returns the forces on the nodes at `corners` (m), N: −V P g_a.
    pub fn forces(&self, law: ConstitutiveModel, corners: &[DVec3; 4]) -> [DVec3; 4] {
        self.forces_with_pressure(law, corners, 0.0)
    }

    /// As [`Element::forces`] with the additional `pressure` (Pa, positive in tension).
    pub(crate) fn forces_with_pressure(
        &self,
        law: ConstitutiveModel,
        corners: &[DVec3; 4],
        pressure: f64,
    ) -> [DVec3; 4] {
        let stress = self.stress(law, &self.deformation_gradient(corners), pressure);
        self.gradients().map(|g| stress * g * -self.volume)
    }

    /// Returns the first Piola–Kirchhoff stress P = ∂Ψ/∂F at F = `f`, Pa, with the additional
    /// `pressure` (Pa, positive in tension).
    pub fn stress(&self, law: ConstitutiveModel, f: &DMat3, pressure: f64) -> DMat3 {
        let (j, c) = (f.determinant(), cofactor(f));
        let mu = self.lame_parameters[0];
        let pressure = pressure + self.volumetric_derivatives(j)[0];
        match law {
            ConstitutiveModel::NeoHookean => *f * mu + c * (pressure - mu),
            ConstitutiveModel::Corotated => {
                (*f - polar_decomposition(f).0) * (2.0 * mu) + c * pressure
            }
        }
    }

    /// Returns the exact Hessian of the energy, N/m; the block of nodes a and b is at `[a][b]`.
    pub fn stiffness(&self, law: ConstitutiveModel, corners: &[DVec3; 4]) -> ElementHessian {
        self.stiffness_with_pressure(law, corners, 0.0)
    }

    /// As [`Element::stiffness`] under a constant pressure.
    pub(crate) fn stiffness_with_pressure(
        &self,
        law: ConstitutiveModel,
        corners: &[DVec3; 4],
        pressure: f64,
    ) -> ElementHessian {
        self.tangent((law, false), corners, pressure)
    }

    /// Projected SPD Hessian: [`Element::stiffness`] with the negative eigenvalues of ∂P/∂F set to
    /// zero (Teran et al. 2005, "Robust Quasistatic Finite Elements and Flesh Simulation", section
    /// 6).
    pub fn projected_stiffness(
        &self,
        law: ConstitutiveModel,
        corners: &[DVec3; 4],
    ) -> ElementHessian {
        self.projected_stiffness_under(law, corners, 0.0)
    }

    /// As [`Element::projected_stiffness`] under a constant pressure.
    pub(crate) fn projected_stiffness_under(
        &self,
        law: ConstitutiveModel,
        corners: &[DVec3; 4],
        pressure: f64,
    ) -> ElementHessian {
        self.tangent((law, true), corners, pressure)
    }

    fn tangent(
        &self,
        with: (ConstitutiveModel, bool),
        corners: &[DVec3; 4],
        pressure: f64,
    ) -> ElementHessian {
        let f = self.deformation_gradient(corners);
        self.blocks(with, &f, &self.gradients(), (self.volume, pressure))
    }

    /// Returns the blocks V g_a·∂P/∂F·g_b at F = `f` for shape functions of the given gradients
    /// (1/m), a volume V (m³) and a constant pressure (Pa): exact, or with the negative eigenvalues
    /// of ∂P/∂F set to zero.
    pub(crate) fn blocks<const N: usize>(
        &self,
        (law, projected): (ConstitutiveModel, bool),
        f: &DMat3,
        gradients: &[DVec3; N],
        (volume, pressure): (f64, f64),
    ) -> [[DMat3; N]; N] {
        let mut blocks = [[DMat3::ZERO; N]; N];
        if !projected {
            for (b, gb) in gradients.iter().enumerate() {
                for (k, axis) in DVec3::AXES.iter().enumerate() {
                    // Displaces node b along the axis.
                    let change = DMat3::from_cols(*axis * gb.x, *axis * gb.y, *axis * gb.z);
                    let stress = self.stress_differential(law, f, &change, pressure);
                    for (a, ga) in gradients.iter().enumerate() {
                        *blocks[a][b].col_mut(k) = stress * *ga * volume;
                    }
                }
            }
            return blocks;
        }
        let mut full = [[0.0; 9]; 9];
        for (k, row) in full.iter_mut().enumerate() {
            let mut change = DMat3::ZERO;
            change.col_mut(k / 3)[k % 3] = 1.0;
            let differential = self.stress_differential(law, f, &change, pressure);
            *row = differential.to_cols_array();
        }
        let (values, vectors) = eigen(full);
        let positive = values
            .iter()
            .zip(&vectors)
            .filter(|(value, _)| **value > 0.0);
        for (value, v) in positive {
            let m = DMat3::from_cols_array(v);
            let pulls = gradients.map(|g| m * g);
            for (a, pa) in pulls.iter().enumerate() {
                for (b, pb) in pulls.iter().enumerate() {
                    let scaled = *pb * (value * volume);
                    blocks[a][b] +=
                        DMat3::from_cols(*pa * scaled.x, *pa * scaled.y, *pa * scaled.z);
                }
            }
        }
        blocks
    }

    /// Returns the first and second derivatives of the volumetric energy density at J = `j`, Pa.
    fn volumetric_derivatives(&self, j: f64) -> [f64; 2] {
        let [mu, lambda] = self.lame_parameters;
        let c = ((CRUSH_THRESHOLD_J - j) / CRUSH_THRESHOLD_J).clamp(0.0, 1.0);
        let by = 16.0 * CRUSH_STIFFNESS_RATIO * mu;
        let stop = by * CRUSH_THRESHOLD_J * (c.powi(3) / 3.0 - c.powi(4) / 2.0 + c.powi(5) / 5.0);
        let more = by * (c * (1.0 - c)).powi(2);
        [lambda * (j - 1.0) - stop, lambda + more]
    }

    /// Returns the differential of the stress P at F = `f` in the direction `d`, under a constant
    /// pressure.
    fn stress_differential(
        &self,
        law: ConstitutiveModel,
        f: &DMat3,
        d: &DMat3,
        pressure: f64,
    ) -> DMat3 {
        let (j, c) = (f.determinant(), cofactor(f));
        let mu = self.lame_parameters[0];
        let [own, stiffness] = self.volumetric_derivatives(j);
        let pressure = pressure + own;
        let volume = c * (stiffness * double_dot(&c, d));
        let turning = cofactor_differential(f, d);
        match law {
            ConstitutiveModel::NeoHookean => *d * mu + volume + turning * (pressure - mu),
            ConstitutiveModel::Corotated => {
                let (r, s) = polar_decomposition(f);
                // dR = R [ω]×, (tr S I − S) ω the axial vector of RᵀdF − dFᵀR.
                let a = r.transpose() * *d;
                let twice = a - a.transpose();
                let axial = DVec3::new(twice.y_axis.z, twice.z_axis.x, twice.x_axis.y);
                let trace = s.x_axis.x + s.y_axis.y + s.z_axis.z;
                let w = (DMat3::from_diagonal(DVec3::splat(trace)) - s).inverse() * axial;
                let cross = DMat3::from_cols(
                    DVec3::new(0.0, w.z, -w.y),
                    DVec3::new(-w.z, 0.0, w.x),
                    DVec3::new(w.y, -w.x, 0.0),
                );
                (*d - r * cross) * (2.0 * mu) + volume + turning * pressure
            }
        }
    }
}

fn edges(corners: &[DVec3; 4]) -> DMat3 {
    let [o, a, b, c] = *corners;
    DMat3::from_cols(a - o, b - o, c - o)
}

/// The squared Frobenius norm |m|².
fn norm_squared(m: &DMat3) -> f64 {
    double_dot(m, m)
}

/// The double contraction a : b.
fn double_dot(a: &DMat3, b: &DMat3) -> f64 {
    (0..3).map(|k| a.col(k).dot(b.col(k))).sum()
}

/// The cofactor matrix ∂J/∂F.
fn cofactor(f: &DMat3) -> DMat3 {
    let [a, b, c] = [f.x_axis, f.y_axis, f.z_axis];
    DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b))
}

/// The differential of the cofactor matrix at `f` in the direction `d`.
fn cofactor_differential(f: &DMat3, d: &DMat3) -> DMat3 {
    let pair = |i: usize, j: usize| d.col(i).cross(f.col(j)) + f.col(i).cross(d.col(j));
    DMat3::from_cols(pair(1, 2), pair(2, 0), pair(0, 1))
}

/// Polar decomposition F = R S with det R = 1 and S symmetric; only the smallest eigenvalue of S is
/// negative if F is inverted.
pub(crate) fn polar_decomposition(f: &DMat3) -> (DMat3, DMat3) {
    let square = f.transpose() * *f;
    let rows: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| square.col(j)[i]));
    let (values, vectors) = eigen(rows);
    let mut turns: Vec<usize> = vec![0, 1, 2];
    turns.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
    let v0 = DVec3::from(vectors[turns[0]]);
    let v1 = DVec3::from(vectors[turns[1]]);
    let u0 = (*f * v0).normalize_or(DVec3::X);
    let across = *f * v1;
    let u1 = (across - u0 * u0.dot(across)).normalize_or(u0.any_orthonormal_vector());
    let rotation =
        DMat3::from_cols(u0, u1, u0.cross(u1)) * DMat3::from_cols(v0, v1, v0.cross(v1)).transpose();
    (rotation, rotation.transpose() * *f)
}

/// Eigenvalues of a symmetric matrix, and its eigenvectors as rows, by Jacobi rotations.
pub(crate) fn eigen<const N: usize>(mut a: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut v = [[0.0; N]; N];
    for (i, row) in v.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    for _ in 0..40 {
        for p in 0..N {
            for q in p + 1..N {
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for row in a.iter_mut() {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                for k in 0..N {
                    (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                    (v[p][k], v[q][k]) = (c * v[p][k] - s * v[q][k], s * v[p][k] + c * v[q][k]);
                }
            }
        }
    }
    (std::array::from_fn(|i| a[i][i]), v)
}
