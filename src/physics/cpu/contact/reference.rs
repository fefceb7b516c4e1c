//! Tool contact in float64 for a body that another engine steps: the reference of its kernels, and
//! the computation of the forces on its tools.

use super::boundary_surface::BoundarySurface;
use super::tool_contact::{LocalToolPose, ToolContact, ToolState};
use crate::physics::Shape;
use crate::physics::contact::ToolMotion;
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::term::StateRef;
#[cfg(test)]
use crate::physics::cpu::term::{SystemContribution, Term};
use crate::physics::cpu::vectors::V4;
#[cfg(test)]
use crate::physics::cpu::vectors::from_metres;
use glam::DVec3;

/// The boundary of a body and the tools near it, in local units and that engine's node order.
pub(in crate::physics) struct ReferenceToolContact {
    contact: ToolContact<f64>,
    plan: Partition,
}

impl ReferenceToolContact {
    /// Creates the contact without tools; `static_friction_speed` is the regularisation speed of
    /// the friction.
    pub fn new(hull: BoundarySurface, static_friction_speed: f64) -> ReferenceToolContact {
        let plan = Partition::with_chunks(vec![0, hull.rest.len()], 1);
        ReferenceToolContact {
            contact: ToolContact::new(hull, &plan, static_friction_speed),
            plan,
        }
    }

    /// Adds a tool with this friction and gap.
    pub fn add(&mut self, shape: Shape, friction: f64, gap: f64) {
        let nowhere = LocalToolPose {
            position: DVec3::ZERO,
            rotation: glam::DQuat::IDENTITY,
        };
        self.contact.tools.push(ToolState {
            shape,
            from: nowhere,
            at: nowhere,
            to: nowhere,
            friction,
            gap,
            teleport_count: 0,
        });
    }

    /// Begins a step of `time` from the displacements `u`, in which tools move along their paths
    /// and nodes by at most `margin`; friction uses the normal forces at `u`. Leaves the tools at
    /// the end of their paths.
    fn begin(
        &mut self,
        u: &[V4<f64>],
        free: &[f64],
        paths: &[ToolMotion],
        (time, margin): (f64, f64),
    ) {
        let pose = |[position, rotation]: [[f64; 4]; 2]| LocalToolPose {
            position: DVec3::new(position[0], position[1], position[2]),
            rotation: glam::DQuat::from_array(rotation).normalize(),
        };
        for (tool, path) in self.contact.tools.iter_mut().zip(paths) {
            (tool.from, tool.to) = (pose(path.from), pose(path.to));
        }
        self.contact.begin(u, (free, &self.plan), (time, margin));
        self.contact.set_tool_fraction(1.0);
    }

    /// Returns the force of the body on each tool, and its moment about the origin of the tool's
    /// shape, at the displacements and velocities at the end of a step of `time` in which the tools
    /// moved along their paths.
    pub fn reactions(
        &mut self,
        [u, v]: [&[V4<f64>]; 2],
        free: &[f64],
        paths: &[ToolMotion],
        time: f64,
    ) -> Vec<[DVec3; 2]> {
        self.begin(u, free, paths, (time, 0.0));
        self.contact.update_lagged_friction(u);
        self.contact.reactions(StateRef { u, v })
    }

    /// Returns the forces on all nodes with the tools at the end of their paths, and the product of
    /// −h² ∂f/∂u − h ∂f/∂v with `way`, for a step that began at `before`.
    #[cfg(test)]
    pub fn forces(
        &mut self,
        before: &[V4<f64>],
        [u, v]: [&[V4<f64>]; 2],
        (free, paths): (&[f64], &[ToolMotion]),
        (time, way): (f64, &[V4<f64>]),
    ) -> [Vec<V4<f64>>; 2] {
        self.begin(before, free, paths, (time, 1.0));
        let mut f = vec![from_metres(DVec3::ZERO, 1.0); u.len()];
        self.contact.forces(0, StateRef { u, v }, &mut f);
        let (mut diagonal, mut change) = (vec![[0.0; 8]; u.len()], f.clone());
        let share = SystemContribution {
            diagonal: &mut diagonal,
            stiffness_velocity: &mut change,
        };
        self.contact.set_psd_projection(true);
        self.contact
            .linearise(&self.plan, StateRef { u, v }, time, share);
        let mut y = vec![from_metres(DVec3::ZERO, 1.0); u.len()];
        self.contact.multiply(0, way, &mut y);
        [f, y]
    }

    /// Returns the fraction of the path between two displacements on which no point penetrates a
    /// tool, at the end of its path, too deeply.
    #[cfg(test)]
    pub fn collision_free_fraction(
        &mut self,
        [from, to]: [&[V4<f64>]; 2],
        free: &[f64],
        paths: &[ToolMotion],
    ) -> f64 {
        self.begin(from, free, paths, (1.0, 1.0));
        self.contact
            .collision_free_fraction(from, to, (free, &self.plan))
    }
}
