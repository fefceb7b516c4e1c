//! Gradients of a quantity of a body at rest or in motion by its parameters.

use crate::Result;
use crate::physics::{AmplitudeId, Loads, ToolId};
use crate::progress::ProgressFn;
use glam::DVec3;

/// A number that the state of a body determines. Directions need not be unit vectors.
#[derive(Clone, Debug, PartialEq)]
pub enum Quantity {
    /// Force of the body on a tool along a direction, N.
    ToolForce {
        /// The tool.
        tool: ToolId,
        /// The direction.
        direction: DVec3,
    },
    /// Force of the body and its loads on the supports of fixed nodes along a direction, N.
    PinReaction {
        /// The nodes: pinned, or held by grabs.
        nodes: Vec<u32>,
        /// The direction.
        direction: DVec3,
    },
    /// Force of the rest of the body on a rigid region along a direction, N.
    RegionForce {
        /// The label of the region.
        label: i64,
        /// The direction.
        direction: DVec3,
    },
    /// Sum of the displacements of nodes along a direction, each times its weight, in file units.
    Displacement {
        /// Nodes and weights.
        nodes: Vec<(u32, f64)>,
        /// The direction.
        direction: DVec3,
    },
    /// Largest distance of a node from its rest position, in file units.
    LargestDisplacement,
    /// Volume of tets, in file units cubed.
    Volume {
        /// The tets of the mesh.
        tets: Vec<u32>,
    },
    /// Component a·σ b of the Cauchy stress in the middle of a tet, Pa.
    Stress {
        /// The tet.
        tet: u32,
        /// a and b.
        along: [DVec3; 2],
    },
    /// Von Mises stress in the middle of a tet, Pa.
    VonMises {
        /// The tet.
        tet: u32,
    },
    /// Elastic energy of the material and of the terms on nodes, J.
    ElasticEnergy,
}

/// A number on which the equilibrium or the motion of a body depends; constant in time. Directions
/// need not be unit vectors: the derivative is by their multiple.
#[derive(Clone, Debug, PartialEq)]
pub enum Parameter {
    /// The stiffness of the material of tets, of all by the same amount: Young's modulus in Pa, or
    /// for uniform springs N/m. Fields of stiffness factors multiply it.
    Young {
        /// The tets of the mesh.
        tets: Vec<u32>,
    },
    /// Poisson's ratio of tets.
    Poisson {
        /// The tets of the mesh.
        tets: Vec<u32>,
    },
    /// Density of tets, kg/m³.
    Density {
        /// The tets of the mesh.
        tets: Vec<u32>,
    },
    /// Force on a node along a direction, N.
    Load {
        /// The node.
        node: u32,
        /// The direction.
        direction: DVec3,
    },
    /// Gravity along a direction, m/s².
    Gravity {
        /// The direction.
        direction: DVec3,
    },
    /// Amplitude of a pressure (Pa) or of a muscle.
    Amplitude(AmplitudeId),
    /// Position of a tool along a direction, in file units.
    ToolPosition {
        /// The tool.
        tool: ToolId,
        /// The direction.
        direction: DVec3,
    },
    /// Rotation of a tool by an angle (rad) about an axis through the origin of its shape.
    ToolRotation {
        /// The tool.
        tool: ToolId,
        /// The axis.
        axis: DVec3,
    },
    /// Coefficient of friction of a tool that has friction; of a motion.
    ToolFriction {
        /// The tool.
        tool: ToolId,
    },
    /// Time of stiffness-proportional damping, s, of a body that has some; of a motion.
    DampingTime,
    /// Rate of mass-proportional damping, 1/s, of finite elements; of a motion.
    MassDamping,
    /// Position of fixed nodes along a direction, in file units.
    Support {
        /// The nodes: pinned, or held by grabs.
        nodes: Vec<u32>,
        /// The direction.
        direction: DVec3,
    },
    /// Rest position of a node along a direction, in file units; pinned nodes move with it, and in
    /// a motion all nodes: their displacements at the start stay.
    RestPosition {
        /// The node.
        node: u32,
        /// The direction.
        direction: DVec3,
    },
    /// Position of a free node at the start of a motion along a direction, in file units.
    InitialPosition {
        /// The node.
        node: u32,
        /// The direction.
        direction: DVec3,
    },
    /// Velocity of a free node at the start of a motion along a direction, in file units/s.
    InitialVelocity {
        /// The node.
        node: u32,
        /// The direction.
        direction: DVec3,
    },
}

/// A quantity and its derivatives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gradient {
    /// The quantity.
    pub value: f64,
    /// Its derivative by each parameter.
    pub derivatives: Vec<f64>,
    /// Net force on the free nodes over the loads: how far the state is from equilibrium. The
    /// derivatives are in error by about as much. In a motion: the largest net force of a step,
    /// inertia included, over its largest force.
    pub imbalance: f64,
    /// Iterations of conjugate gradients, without those of steps.
    pub iterations: u32,
}

/// Sets the loads of the step of an index.
pub(crate) type LoadSchedule<'a> = &'a mut dyn FnMut(u32, &mut Loads) -> Result<()>;

/// Gets the values of a quantity after each step so far. Returns numbers that they determine, each with its
/// derivatives by the values, or `None` for another step.
pub(crate) type SeriesReader<'a> =
    &'a mut dyn FnMut(&[f64]) -> Result<Option<Vec<(f64, Vec<f64>)>>>;

/// Gradients by the adjoint method: one linear solve for any number of parameters, in a motion one
/// for each step.
pub trait Gradients {
    /// Returns a quantity of the body at rest and its derivatives by parameters: those of the
    /// equilibrium near the current state, which must be one. Friction has no part in it.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the body is not at rest or not stable, is not
    /// stepped by an implicit scheme in double precision, for an unknown node, tet, tool or region,
    /// and if the linear solve does not converge.
    fn gradient(&mut self, quantity: &Quantity, parameters: &[Parameter]) -> Result<Gradient>;

    /// Takes a number of steps of a length in seconds from the current state and returns a quantity
    /// at their end and its derivatives by parameters. If `integral`, the quantity is integrated over
    /// time: summed after every step, times the length of the step, s.
    ///
    /// Loads are constant, or `schedule` sets the prescribed motions, tool targets and amplitudes of
    /// the step of an index; it is called more than once for some steps. A parameter of one of these
    /// is a shift of its whole path. Steps are solved to a residual of 1e-10, and friction until it
    /// changes by less than 1e-9. Up to 1 GiB of states is kept; a longer motion is computed twice.
    /// `progress` gets the fraction of both passes.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) if a step fails;
    /// [`Error::Input`](crate::Error::Input) as [`Gradients::gradient`], and for what has no gradient
    /// of a motion: springs; nodes that begin inside a tool; forces on supports and rigid regions
    /// under damping or friction; masses of rigid regions in the midpoint rule; averaged volumes and
    /// rest positions under stiffness-proportional damping;
    /// [`Error::Cancelled`](crate::Error::Cancelled). The body keeps the steps that were taken.
    fn gradient_of_motion(
        &mut self,
        steps: (u32, f64),
        quantity: &Quantity,
        integral: bool,
        parameters: &[Parameter],
        schedule: Option<LoadSchedule<'_>>,
        progress: ProgressFn<'_>,
    ) -> Result<Gradient>;

    /// Takes steps as [`Gradients::gradient_of_motion`], under constant loads, until `read` returns numbers
    /// that the values of a quantity after every step determine, such as a period; at most `steps`. Returns
    /// each number and its derivatives by parameters: one pass forward, and one back for each number.
    ///
    /// # Errors
    /// As [`Gradients::gradient_of_motion`], those of `read`, and [`Error::Input`](crate::Error::Input) if
    /// it returns none.
    fn gradients_of_series(
        &mut self,
        steps: (u32, f64),
        quantity: &Quantity,
        read: SeriesReader<'_>,
        parameters: &[Parameter],
        progress: ProgressFn<'_>,
    ) -> Result<Vec<Gradient>>;

    /// Steps the body in double precision from now on; it keeps its state.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) if a requested step failed.
    fn use_double_precision(&mut self) -> Result<()>;
}
