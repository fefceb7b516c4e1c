//! Discretisation of a body's elasticity: springs along the edges of its mesh, or finite elements.

use super::elements::{Element, Elements};
use super::material::Damping;
use super::rigid_region::RigidBody;

/// An edge of the mesh, with its axial stiffness.
///
/// In a body of springs it is a spring. In a body of finite elements its stiffness is a reference
/// for units, coarse bodies and the linear stiffness of rigid regions, and exerts no force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Its two nodes, the smaller first.
    pub nodes: [u32; 2],
    /// Axial stiffness κ, N/m: the spring constant that gives a body of springs the Young's modulus
    /// of the tets around the edge.
    pub stiffness: f64,
    /// Rest length L, m.
    pub length: f64,
}

/// Springs along all edges of a body, with the stiffness and rest length of the edge.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpringNetwork {
    /// Constant part of κ_d of every spring, N·s/m; see
    /// [`DiscreteModel::spring_damping`](crate::physics::DiscreteModel::spring_damping).
    pub damping: f64,
    /// The damped velocity component.
    pub damping_kind: Damping,
}

/// What resists deformation of a body.
#[derive(Clone, Debug, PartialEq)]
pub enum Discretisation {
    /// Springs along the edges.
    Springs(SpringNetwork),
    /// Finite elements in the tets, and rigid bodies.
    Elements(Elements),
}

impl Default for Discretisation {
    fn default() -> Discretisation {
        Discretisation::Springs(SpringNetwork::default())
    }
}

impl Discretisation {
    /// The springs; `None` for finite elements.
    pub fn springs(&self) -> Option<&SpringNetwork> {
        match self {
            Discretisation::Springs(springs) => Some(springs),
            Discretisation::Elements(_) => None,
        }
    }

    /// Mutable access to [`Discretisation::springs`].
    pub fn springs_mut(&mut self) -> Option<&mut SpringNetwork> {
        match self {
            Discretisation::Springs(springs) => Some(springs),
            Discretisation::Elements(_) => None,
        }
    }

    /// The finite elements; `None` for springs.
    pub fn elements(&self) -> Option<&Elements> {
        match self {
            Discretisation::Springs(_) => None,
            Discretisation::Elements(elements) => Some(elements),
        }
    }

    /// Mutable access to [`Discretisation::elements`].
    pub fn elements_mut(&mut self) -> Option<&mut Elements> {
        match self {
            Discretisation::Springs(_) => None,
            Discretisation::Elements(elements) => Some(elements),
        }
    }

    /// The tets of the finite elements; empty for springs.
    pub fn tets(&self) -> &[Element] {
        self.elements().map_or(&[], |elements| &elements.tets)
    }

    /// The rigid bodies; empty for springs.
    pub fn rigid_bodies(&self) -> &[RigidBody] {
        self.elements().map_or(&[], |elements| &elements.rigid)
    }
}
