//! Binding of energy terms to the passes they are composed with: each term binds the declarations
//! of its file in `shaders/terms`.

use super::edges::GpuEdges;
use super::elements::GpuElements;
use super::springs::GpuSprings;
use crate::Result;
use crate::gpu::{Array, Gpu, Pass, PassBuilder};
use crate::physics::{DiscreteModel, Discretisation, GpuBody, LocalUnits};
use glam::Vec3;

/// The programs that terms are composed into.
#[derive(Clone, Copy)]
pub(in crate::physics) enum ProgramPart<'a> {
    /// `physics/forces`.
    Forces,
    /// `physics/implicit_euler_begin`.
    System {
        /// The terms' data of the system matrix, written here or before.
        matrix: &'a Array,
        /// The velocities at the start of the step.
        velocities: &'a Array,
    },
    /// `physics/implicit_euler_direction`.
    Product {
        /// The terms' data of the system matrix.
        matrix: &'a Array,
        /// The preconditioner, and the diagonal blocks that terms add to nodes.
        blocks: &'a Array,
    },
}

/// An energy term on the GPU.
pub(in crate::physics) trait GpuTerm {
    /// The name of its file in `shaders/terms`.
    fn name(&self) -> &'static str;

    /// Binds the declarations of that file in a program, in their order.
    fn bind<'a>(&'a self, pass: PassBuilder<'a>, part: ProgramPart<'a>) -> PassBuilder<'a>;

    /// Returns the passes needed before forces are gathered at a state.
    ///
    /// # Errors
    /// An error if the device rejects the work.
    fn prepare_forces(
        &self,
        _gpu: &Gpu,
        _positions: &Array,
        _velocities: &Array,
        _status: &wgpu::Buffer,
    ) -> Result<Option<Pass>> {
        Ok(None)
    }

    /// Texels of its data of the system matrix of an implicit step, for [`ProgramPart::System`].
    fn matrix_texels(&self) -> usize;

    /// Texels of its lists: the cost of visiting every node.
    fn texels(&self) -> u32;
}

/// The springs or finite elements of a body.
#[derive(Debug)]
pub(in crate::physics) enum GpuDiscretisation {
    Springs(Box<GpuSprings>),
    Elements(Box<GpuElements>),
}

impl GpuDiscretisation {
    /// The springs or elements of `model`, whose nodes rest at the local positions `rest` and
    /// whose edges are `edges`.
    pub fn new(
        gpu: &Gpu,
        model: &DiscreteModel,
        rest: &[Vec3],
        with: (&GpuEdges, &LocalUnits),
    ) -> Result<GpuDiscretisation> {
        Ok(match &model.discretisation {
            Discretisation::Springs(springs) => {
                let springs = GpuSprings::new(gpu, (springs, model.damping_time), with)?;
                GpuDiscretisation::Springs(Box::new(springs))
            }
            Discretisation::Elements(elements) => {
                let elements = GpuElements::new(gpu, (model, elements), rest, with)?;
                GpuDiscretisation::Elements(Box::new(elements))
            }
        })
    }

    /// The finite elements; `None` for springs.
    pub fn elements(&self) -> Option<&GpuElements> {
        match self {
            GpuDiscretisation::Springs(_) => None,
            GpuDiscretisation::Elements(elements) => Some(elements.as_ref()),
        }
    }
}

impl GpuBody {
    /// The finite elements; `None` for springs.
    pub(in crate::physics) fn elements(&self) -> Option<&GpuElements> {
        self.discretisation.elements()
    }

    /// The term of elastic deformation.
    pub(in crate::physics) fn material_term(&self) -> &dyn GpuTerm {
        match &self.discretisation {
            GpuDiscretisation::Springs(springs) => springs.as_ref(),
            GpuDiscretisation::Elements(elements) => elements.as_ref(),
        }
    }

    /// The shader `name` composed with all terms except tools.
    pub(in crate::physics) fn shader_name(&self, name: &str) -> String {
        self.named(name, self.material_term().name())
    }

    /// The shader `name` composed with all terms; with tools if `tools`.
    pub(in crate::physics) fn shader_name_with_contact(&self, name: &str, tools: bool) -> String {
        match tools && self.contact.is_some() {
            true => self.shader_name(name) + " contact",
            false => self.shader_name(name),
        }
    }

    /// The shader `name` composed with `first` and the node terms.
    pub(in crate::physics) fn named(&self, name: &str, first: &str) -> String {
        let terms = self.terms().iter().map(|t| t.name());
        let words = [name, first].into_iter().chain(terms);
        words.collect::<Vec<_>>().join(" ")
    }

    /// Binds the declarations of all terms, in the order of [`GpuBody::shader_name_with_contact`].
    pub(in crate::physics) fn bind_pressed<'a>(
        &'a self,
        pass: PassBuilder<'a>,
        part: ProgramPart<'a>,
        tools: bool,
    ) -> PassBuilder<'a> {
        let pass = self.bind_terms(pass, part);
        match self.contact.as_ref().filter(|_| tools) {
            Some(contact) => contact.bind(pass),
            None => pass,
        }
    }

    /// Binds the declarations of all terms, in the order of [`GpuBody::shader_name`].
    pub(in crate::physics) fn bind_terms<'a>(
        &'a self,
        pass: PassBuilder<'a>,
        part: ProgramPart<'a>,
    ) -> PassBuilder<'a> {
        let pass = self.material_term().bind(pass, part);
        match (&self.node_terms, part) {
            (None, _) => pass,
            (Some(_), ProgramPart::Product { blocks, .. }) => pass.read(blocks),
            (Some(numbers), _) => pass.read(numbers),
        }
    }
}
