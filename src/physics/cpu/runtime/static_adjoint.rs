//! Interface to the adjoint of a body's equilibrium, in SI units and the network's node order.

use crate::Result;
use glam::DVec3;

/// Parts of the tangent, which is exact with all of them; tests leave parts out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::physics) struct TangentParts {
    /// Hessians without projection.
    pub unprojected: bool,
    /// The tangent of pressures and target springs.
    pub loads: bool,
    /// The exact Hessian of self-contact.
    pub pairs: bool,
    /// The rotation of the forces on rigid bodies.
    pub rotations: bool,
    /// In a step: the dependence of friction on positions.
    pub friction: bool,
}

impl Default for TangentParts {
    fn default() -> TangentParts {
        TangentParts {
            unprojected: true,
            loads: true,
            pairs: true,
            rotations: true,
            friction: true,
        }
    }
}

/// A quantity Q of a body at rest: its derivative by the positions, or a force that it is.
#[derive(Clone, Debug, Default)]
pub(in crate::physics) struct AdjointSeed {
    /// ∂Q/∂x of every node, 1/m.
    pub gradient: Vec<DVec3>,
    /// Q is the sum of the static forces on these soft nodes, times this vector.
    pub reaction: Option<(Vec<u32>, DVec3)>,
    /// Q is the force of the rest of the body on a rigid body, times this vector.
    pub region: Option<(usize, DVec3)>,
    /// Q is the force on a tool, times this vector.
    pub tool: Option<(usize, DVec3)>,
    /// Number of amplitudes of the body.
    pub amplitudes: usize,
    /// Parts of the tangent.
    pub parts: TangentParts,
}

/// Derivatives of a quantity by the pose, the gap and the friction of a tool.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::physics) struct ToolSlopes {
    /// By a translation, 1/m.
    pub translation: DVec3,
    /// By a rotation vector about the origin of its shape, 1/rad.
    pub rotation: DVec3,
    /// By its gap, 1/m.
    pub gap: f64,
    /// By its coefficient of friction.
    pub friction: f64,
}

/// Derivatives of a quantity by the forces on the nodes, and by what the engine alone knows.
#[derive(Clone, Debug, Default)]
pub(in crate::physics) struct AdjointSolution {
    /// By the force of terms on every node, 1/N.
    pub terms: Vec<DVec3>,
    /// By the load on every node, 1/N.
    pub loads: Vec<DVec3>,
    /// By the position of every fixed soft node, 1/m; 0 for others.
    pub supports: Vec<DVec3>,
    /// By each tool.
    pub tools: Vec<ToolSlopes>,
    /// By area times Young's modulus of each boundary face, 1/N; empty without contact.
    pub faces: Vec<f64>,
    /// By the speed below which friction is static, s/m.
    pub static_speed: f64,
    /// By the Lamé parameters of each element through the damping of a step; empty without.
    pub lame: Vec<[f64; 2]>,
    /// In a step: by the time of stiffness-proportional and the rate of mass-proportional damping, 1/s and s.
    pub damping: [f64; 2],
    /// By each amplitude.
    pub amplitudes: Vec<f64>,
    /// Iterations of conjugate gradients.
    pub iterations: u32,
}

/// A body whose equilibrium has an adjoint.
pub(in crate::physics) trait StaticAdjoint {
    /// Solves for the derivatives of the quantity of `seed` at the current state.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the equilibrium is not stable, or the solve does
    /// not converge.
    fn adjoint(&mut self, seed: &AdjointSeed) -> Result<AdjointSolution>;
}
